"""The three guests, put on the path as an installer does, from their own `pyproject.toml`."""

from __future__ import annotations

import configparser
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

GUESTS = Path(__file__).parents[2] / "examples/competitions"


def entry_points_of(pyproject: Path) -> dict[str, dict[str, str]]:
    """The entry points that a `pyproject.toml` declares, by group; Python 3.10 has no reader of TOML."""
    # Of TOML these tables use what ini files have too: sections, names and texts in quotes.
    parser = configparser.ConfigParser(delimiters=("=",), interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]  # names are not made lower case
    text = pyproject.read_text(encoding="utf-8")
    tables = [table for table in text.split("\n[") if table.startswith("project.entry-points.")]
    parser.read_string("".join(f"\n[{table}\n" for table in tables))
    return {
        section.removeprefix("project.entry-points.").strip('"'): {
            name.strip('"'): value.strip('"') for name, value in parser[section].items()
        }
        for section in parser.sections()
    }


def put_on_path(guest: str, site: Path) -> list[Path]:
    """Write what an installer would write of a guest; the folders that `sys.path` then needs."""
    folder = GUESTS / guest
    text = (folder / "pyproject.toml").read_text(encoding="utf-8")
    name, version = (_value(text, key) for key in ("name", "version"))
    info = site / f"{name.replace('-', '_')}-{version}.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\n", "utf-8")
    groups = entry_points_of(folder / "pyproject.toml")
    lines = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in of.items()) for group, of in groups.items()]
    (info / "entry_points.txt").write_text("\n".join(lines), "utf-8")
    return [site, folder]


def _value(text: str, key: str) -> str:
    return next(
        line.partition('"')[2].rstrip('"') for line in text.splitlines() if line.startswith(f"{key} =")
    )


@pytest.fixture(params=["barn", "robocup_work", "carla"])
def each_guest(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def guests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """All three guests installed side by side; the folder of their sources."""
    before = set(sys.modules)
    for guest in ("barn", "robocup_work", "carla"):
        for folder in put_on_path(guest, tmp_path / "site" / guest):
            monkeypatch.syspath_prepend(str(folder))
    yield GUESTS
    for name in set(sys.modules) - before:
        if name.split(".")[0] in ("barn_challenge", "robocup_work", "carla_leaderboard"):
            del sys.modules[name]
