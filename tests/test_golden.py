"""Every situation a user can meet, told by what the command prints and its exit code.

Golden files are rewritten with `--update-golden`; read their diff as if it were code:
it is the score of somebody's trial.
"""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import pytest

from ariac_score.cli import main

GOLDEN = Path(__file__).parent / "golden"
CASES = runpy.run_path(str(Path(__file__).parent / "golden_cases.py"))["CASES"]


def _shown(command: list[str], code: int, out: str, err: str) -> str:
    text = f"$ ariac-score {' '.join(command)}\n[exit {code}]\n--- stdout\n{out}--- stderr\n{err}"
    return re.sub(r"\b[0-9a-f]{16}…", "<hash>…", text)


@pytest.mark.parametrize("name", sorted(CASES))
def test_every_situation_prints_what_it_should(
    name: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    update_golden: bool,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "100")
    command = CASES[name](tmp_path)
    before = sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*"))
    try:
        code = main(command)
    except SystemExit as exit_:  # argparse leaves this way
        code = int(exit_.code or 0)
    out, err = capsys.readouterr()

    assert "Traceback" not in err
    assert sorted(p.relative_to(tmp_path) for p in tmp_path.rglob("*")) == before, "something was written"
    if code not in (0, 1, 6, 8):
        assert out == "", "a command that fails prints no half result"
    shown, expected = _shown(command, code, out, err), GOLDEN / f"{name}.txt"
    if update_golden:
        expected.write_text(shown, encoding="utf-8")
    assert shown == expected.read_text(encoding="utf-8")


def test_no_golden_file_is_left_over() -> None:
    assert sorted(p.stem for p in GOLDEN.glob("*.txt")) == sorted(CASES)
