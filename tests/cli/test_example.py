"""`ariac-score example`: files where the pages have them, and nothing of anybody's replaced."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ariac_score.cli import main
from ariac_score.cli.example import examples

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", examples())
def test_an_example_lies_where_the_pages_have_it(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["example", name, "--into", str(tmp_path)]) == 0

    files = [file for file in tmp_path.rglob("*") if file.is_file()]
    assert files
    for file in files:
        assert file.read_bytes() == (ROOT / file.relative_to(tmp_path)).read_bytes()
    named = [
        word for word in capsys.readouterr().out.splitlines()[-1].split() if word.startswith("examples/")
    ]
    assert named
    assert all((tmp_path / word).exists() for word in named)


def test_written_again_it_stays_and_what_somebody_changed_is_not_replaced(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    again = ["example", "--into", str(tmp_path)]
    assert main(again) == main(again) == 0
    changed = tmp_path / "examples/kitting_near_miss.mcap"
    changed.write_bytes(changed.read_bytes()[::-1])
    other = tmp_path / "examples/kitting_near_miss.result.json"
    other.unlink()

    assert main(again) == 4
    assert "something else has this name" in capsys.readouterr().err
    assert not other.exists()


def test_where_nothing_can_be_written_it_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").touch()

    assert main(["example", "--into", str(tmp_path / "file")]) == 4
    assert "cannot be written" in capsys.readouterr().err


def test_the_package_is_a_program() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "ariac_score", "--version"], capture_output=True, text=True, check=False
    )

    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("ariac-score ")
