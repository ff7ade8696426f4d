"""The core, its schemas and the first-party plugins do not know the guests."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
NAMES = re.compile(r"\bbarn|robocup|carla\b|carla_", re.IGNORECASE)


@pytest.mark.parametrize("folder", ["ariac_score", "schemas", "plugins"])
def test_no_file_of_the_core_names_a_guest(folder: str) -> None:
    files = [
        path
        for path in (ROOT / folder).rglob("*")
        if path.suffix in (".py", ".json", ".yaml", ".j2", ".css", ".js", ".tmpl", ".msg", ".md")
    ]
    assert len(files) >= 3

    named = {
        f"{path.relative_to(ROOT)}:{number}: {line.strip()[:80]}"
        for path in files
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1)
        if NAMES.search(line)
    }

    assert named == set()


def test_the_names_are_found_where_they_stand() -> None:
    # The test above would pass with a pattern that finds nothing.
    for guest, word in (("barn", "BARN"), ("robocup_work", "RoboCup"), ("carla", "CARLA")):
        text = (ROOT / "examples/competitions" / guest / "pyproject.toml").read_text(encoding="utf-8")
        assert NAMES.search(text)
        assert NAMES.search(word)


def test_the_metadata_of_the_project_names_no_guest() -> None:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")

    assert not NAMES.search(text)


def test_the_guests_import_the_public_names_alone() -> None:
    wrong = subprocess.run(
        ["git", "grep", "-nE", r"(from|import) ariac_score[._]", "--", "examples/competitions/*.py"],  # noqa: S607
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    ).stdout.splitlines()
    allowed = re.compile(r"from ariac_score\.(monitors|testing)( |\.)|from ariac_score import")

    assert [line for line in wrong if not allowed.search(line)] == []
