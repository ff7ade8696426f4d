"""The mutation run: which changes it makes, and that it tells what a test finds from what none does."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / ".ci" / "mutants"

MODULE = "ariac_score/scoring/limits.py"
SOURCE = '''"""A module with two limits."""


def too_fast(speed_m_s: float) -> bool:
    return speed_m_s > 3


def too_near(distance_m: float) -> bool:
    return distance_m < 7
'''
TESTS = """from ariac_score.scoring.limits import too_fast


def test_the_limit_of_speed_from_both_sides() -> None:
    assert (too_fast(2.5), too_fast(3), too_fast(3.5)) == (False, False, True)
"""


def git(*words: str, cwd: Path) -> str:
    names = ["-c", "user.name=t", "-c", "user.email=t@example.org", "-c", "commit.gpgsign=false"]
    done = subprocess.run(["git", *names, *words], cwd=cwd, check=True, capture_output=True, text=True)  # noqa: S607
    return done.stdout


@pytest.fixture
def repository(tmp_path: Path) -> Path:
    root = tmp_path / "clone"
    files = {
        MODULE: SOURCE,
        "tests/scoring/test_limits.py": TESTS,
        ".gitignore": ".venv\nbuild/\n__pycache__/\n",
    }
    files |= {"ariac_score/__init__.py": "", "ariac_score/scoring/__init__.py": ""}
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text, encoding="utf-8")
    (root / ".ci").mkdir()
    shutil.copy(SCRIPT, root / ".ci" / "mutants")
    (root / ".venv").symlink_to(sys.prefix)
    git("init", "-q", cwd=root)
    git("add", "-A", cwd=root)
    git("commit", "-q", "-m", "Begin", cwd=root)
    return root


def mutants(root: Path, *words: str) -> str:
    command = [sys.executable, root / ".ci" / "mutants", *words]
    return subprocess.run(command, check=True, capture_output=True, text=True, cwd=root).stdout


def rows(text: str) -> list[str]:
    return sorted(line for line in text.splitlines() if line.startswith("| ariac_score"))


def test_every_kind_of_change_is_made_where_it_can_be(repository: Path) -> None:
    assert rows(mutants(repository, "--list", "ariac_score")) == sorted(
        [
            f"| {MODULE}:5 | `return speed_m_s > 3` | `return None` |",
            f"| {MODULE}:5 | `speed_m_s > 3` | `(speed_m_s >= 3)` |",
            f"| {MODULE}:5 | `3` | `(4)` |",
            f"| {MODULE}:5 | `3` | `(2)` |",
            f"| {MODULE}:9 | `return distance_m < 7` | `return None` |",
            f"| {MODULE}:9 | `distance_m < 7` | `(distance_m <= 7)` |",
            f"| {MODULE}:9 | `7` | `(8)` |",
            f"| {MODULE}:9 | `7` | `(6)` |",
        ]
    )


@pytest.mark.slow
def test_what_a_test_finds_dies_and_what_none_looks_at_lives(repository: Path) -> None:
    sample = ("--count", "4", "--seed", "1", "ariac_score")
    planted = rows(mutants(repository, "--list", *sample))
    unseen = [f"{row} lived |" for row in planted if row.startswith(f"| {MODULE}:9 ")]
    assert 0 < len(unseen) < len(planted)  # of both functions, or nothing would be tried

    assert rows(mutants(repository, *sample)) == unseen
    assert git("status", "--porcelain", cwd=repository) == ""  # the checkout is never touched
    assert len(git("worktree", "list", cwd=repository).splitlines()) == 1


def test_a_seed_is_a_sample(repository: Path) -> None:
    first = mutants(repository, "--list", "--count", "4", "--seed", "1", "ariac_score")

    assert first == mutants(repository, "--list", "--count", "4", "--seed", "1", "ariac_score")
    others = {
        mutants(repository, "--list", "--count", "4", "--seed", str(k), "ariac_score") for k in range(5)
    }
    assert len(others) > 1


@pytest.mark.slow
def test_a_test_that_fails_without_a_change_kills_nothing(repository: Path) -> None:
    broken = repository / "tests/scoring/test_limits.py"
    broken.write_text(TESTS.replace("False, False, True", "True, True, True"), encoding="utf-8")
    git("commit", "-q", "-a", "-m", "Break a test", cwd=repository)

    assert len(rows(mutants(repository, "--count", "1", "ariac_score"))) == 1
