"""Entry points of installed distributions: what `importlib.metadata` finds, found without it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError, entry_points, version
from pathlib import Path
from zipfile import ZipFile

import pytest

from ariac_score.checks.contracts import GROUPS
from ariac_score.installed import Point, attribute_of, brought_by, points_in, version_of

RULES = "ariac_score.rules"
Install = Callable[..., str]


def by_importlib() -> list[Point]:
    found = (p for group in GROUPS for p in entry_points(group=group))
    return sorted(Point(p.group, p.name, p.value, *brought_by(p)) for p in found)


def put(place: Path, folder: str, points: str, metadata: str | None = "Name: x\nVersion: 1\n") -> None:
    (place / folder).mkdir(parents=True)
    (place / folder / "entry_points.txt").write_text(points, encoding="utf-8")
    if metadata is not None:
        (place / folder / "METADATA").write_text(metadata, encoding="utf-8")


def test_what_is_shipped_is_found_as_importlib_finds_it() -> None:
    assert points_in(GROUPS) == by_importlib()
    assert len(points_in(GROUPS)) > 50


ONE = f"[{RULES}]\nfair.play = m:A\n"
ODD: dict[str, tuple[str, str, str | None]] = {
    "plain": ("fair_play-1.0.dist-info", ONE, "Name: fair.Play\nVersion: 1.0\n"),
    "an egg": ("fair_play.egg-info", ONE, "Name: fair-play\nVersion: 2\n"),
    "capitals": ("fair_play-1.0.DIST-INFO", ONE, "Name: fair\nVersion: 1.0\n"),
    "comments and spaces": (
        "a-1.dist-info",
        f"# x\n\n[other]\nb = c:d\n [{RULES}] \n  # y\n\tfair.play=m : A [more] \n",
        "Metadata-Version: 2.1\nversion: 3\nNAME:  a\n",
    ),
    "folded metadata": ("a-1.dist-info", ONE, "Summary: long\n  words: more\nName: a\nVersion: 1\n"),
    "folded before the name": ("a-1.dist-info", ONE, "Summary: long\n  words\nName: a\nVersion: 1\n"),
    "no metadata": ("a-1.dist-info", ONE, None),
    "no name": ("a-1.dist-info", ONE, "Version: 1\n"),
    "no version": ("a-1.dist-info", ONE, "Name: a\n\nVersion: 1\n"),
    "an equals sign in the target": ("a-1.dist-info", f"[{RULES}]\nx = m:A = b\n", "Name: a\nVersion: 1\n"),
    "not of ours": ("a-1.dist-info", "[console_scripts]\nx = m:A\n", None),
    "before any group": ("a-1.dist-info", f"x = m:A\n{ONE}", "Name: a\nVersion: 1\n"),
}


@pytest.mark.parametrize("odd", ODD)
def test_odd_distributions_are_found_as_importlib_finds_them(
    odd: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, *ODD[odd])
    monkeypatch.syspath_prepend(str(tmp_path))

    assert points_in(GROUPS) == by_importlib()


def test_of_one_distribution_in_two_places_the_first_on_the_path_counts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number in ("1", "2"):
        metadata = f"Name: Fair.Play\nVersion: {number}\n"
        put(
            tmp_path / number,
            f"{'fair_play' if number == '1' else 'Fair.Play'}-{number}.dist-info",
            ONE,
            metadata,
        )
        monkeypatch.syspath_prepend(str(tmp_path / number))

    found = points_in(GROUPS)

    assert found == by_importlib()
    assert [p.version for p in found if p.name == "fair.play"] == ["2"]


def test_a_distribution_in_an_archive_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("a-1.dist-info/entry_points.txt", ONE)
        archive.writestr("a-1.dist-info/METADATA", "Name: a\nVersion: 1\n")
    monkeypatch.syspath_prepend(str(tmp_path / "a.zip"))

    found = points_in(GROUPS)

    assert Point(RULES, "fair.play", "m:A", "a", "1") in found
    assert found == by_importlib()


def test_a_finder_of_a_stranger_is_asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    put(tmp_path, "a-1.dist-info", ONE, "Name: a\nVersion: 1\n")

    class Elsewhere:
        @staticmethod
        def find_spec(*_: object) -> None:
            return None

        @staticmethod
        def find_distributions(*_: object) -> object:
            from importlib.metadata import DistributionFinder, MetadataPathFinder  # noqa: PLC0415  # of the test alone

            return MetadataPathFinder.find_distributions(DistributionFinder.Context(path=[str(tmp_path)]))

    monkeypatch.setattr(sys, "meta_path", [*sys.meta_path, Elsewhere])

    assert Point(RULES, "fair.play", "m:A", "a", "1") in points_in(GROUPS)


def test_a_line_that_is_no_entry_is_refused_as_importlib_refuses_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path, "a-1.dist-info", f"[{RULES}]\nno sign\n")
    monkeypatch.syspath_prepend(str(tmp_path))

    with pytest.raises(TypeError):
        entry_points(group=RULES)
    with pytest.raises(TypeError):
        points_in(GROUPS)


@pytest.mark.parametrize("target", ["os.path:join", "os : path.join", "os.path:join [extra]", "os.path"])
def test_what_an_entry_point_leads_to(target: str) -> None:
    import os  # noqa: PLC0415  # of the test alone

    assert attribute_of(target) is (os.path if target == "os.path" else os.path.join)


@pytest.mark.parametrize("target", ["", "a b", "os:path:join", "os;path", "../x:y"])
def test_what_is_no_entry_point_is_refused(target: str) -> None:
    with pytest.raises((ValueError, ImportError)):
        attribute_of(target)


@pytest.mark.parametrize("name", ["ariac-score", "Ariac.Score", "numpy", "PyYAML"])
def test_the_version_of_a_distribution(name: str) -> None:
    assert version_of(name) == version(name)


def test_what_is_not_installed_has_no_version() -> None:
    with pytest.raises(PackageNotFoundError):
        version_of("nobody-has-this")


def test_checking_any_rule_set_loads_neither_numpy_nor_jsonschema() -> None:
    script = (
        "import sys; from ariac_score.cli import main; from ariac_score.scoring.ruleset import rule_set_names\n"
        "for name in rule_set_names(): assert main(['rules', 'validate', name]) == 0\n"
        "print(*({'numpy', 'jsonschema', 'importlib.metadata', 'rosbags'} & {*sys.modules}))"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)

    assert "ariac2020.official: sound, 4 checks\n" in done.stdout
    assert done.stdout.endswith("\n\n")
