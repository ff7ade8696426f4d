"""A plugin that hangs or takes its process with it is named, where a command runs apart."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ariac_score.cli import main
from ariac_score.installed.running import _Notes, note_in, noted, running
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

pytestmark = pytest.mark.slow  # processes that die

Install = Callable[..., str]

HEAD = """
from dataclasses import dataclass
from ariac_score import Finding


@dataclass(frozen=True)
class Odd:
    '''Something odd.

    Measures:
        Nothing.
    Violated when:
        Never.
    Source:
        Nobody.
    '''

    def needs(self):
        return ()

    def watch(self, trial):
"""
SOUND = "        yield Finding.satisfied('trial', 'fine')\n"
DEADLY = {
    "sleeps": ("        import time\n        time.sleep(3600)\n", "did not end within 12 s"),
    "gives findings without end": (
        "        while True:\n            yield Finding.satisfied('trial', 'fine')\n",
        "gives more than 250,000 findings",
    ),
    "exits at once": ("        import os\n        os._exit(0)\n", "with exit code 0"),
    "crashes": ("        import ctypes\n        ctypes.string_at(0)\n", "by signal 11 (SIGSEGV)"),
    "aborts": ("        import os\n        os.abort()\n", "by signal 6 (SIGABRT)"),
}
LIMITS = {"sleeps": "12"}
"""Others end by themselves, however slow the machine."""


@pytest.fixture
def rules(tmp_path: Path) -> str:
    file = tmp_path / "odd.yaml"
    file.write_text(
        "{id: odd, title: odd, source: test, log_map: ariac2020, monitors: {oddity: {use: odd.check}}, "
        "score: holds(oddity)}",
        encoding="utf-8",
    )
    return str(file)


@pytest.fixture
def log(tmp_path: Path) -> str:
    return str(write_trial_log(tmp_path / "trial.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS))


def put(install: Install, body: str) -> None:
    source = HEAD + body + SOUND
    install("odd-rules", {"odd.check": "Odd"}, source=source, version="6.6", group="ariac_score.monitors")


@pytest.mark.parametrize("name", DEADLY)
def test_what_ends_or_hangs_the_scorer_is_named(
    install: Install, rules: str, log: str, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    body, how = DEADLY[name]
    put(install, body)

    code = main(["score", log, "--rules", rules, "--time-limit-s", LIMITS.get(name, "300")])

    out, err = capsys.readouterr()
    assert (code, out) == (3, "")
    assert "check 'oddity': plugin odd.check (odd-rules 6.6) " in err
    assert how in err


def test_apart_the_result_is_the_same_to_the_byte(
    install: Install, rules: str, log: str, capsys: pytest.CaptureFixture[str]
) -> None:
    put(install, "")
    as_stored = ["score", log, "--rules", rules, "--output-format", "json"]

    assert main(as_stored) == 0
    here = capsys.readouterr().out
    assert main([*as_stored, "--time-limit-s", "60"]) == 0
    assert capsys.readouterr().out == here
    assert json.loads(here)["score"] == 1


def test_errors_and_their_exit_codes_come_through(
    rules: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(
        ["score", str(tmp_path / "nowhere"), "--rules", "paper2020.published", "--time-limit-s", "60"]
    )

    assert code == 5
    assert "nowhere" in capsys.readouterr().err


@pytest.mark.parametrize("limit", ["0", "-1", "soon", "inf", "nan"])
def test_a_limit_that_is_none_is_refused(limit: str, log: str) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["score", log, "--rules", "paper2020.published", f"--time-limit-s={limit}"])

    assert ended.value.code == 4


@pytest.mark.parametrize("name", ["sleeps", "exits at once", "crashes"])
def test_checking_a_plugin_survives_it_and_names_it(
    install: Install, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    body, how = DEADLY[name]
    put(install, body)

    code = main(["plugins", "check", "odd.check", "--time-limit-s", LIMITS.get(name, "300")])

    out = capsys.readouterr().out
    assert code == 1
    assert "kept    docstring_sections" in out
    assert "BROKEN  ends" in out
    assert "plugin odd.check (odd-rules 6.6) " in out
    assert how in out


@pytest.mark.parametrize(("name", "outcome"), [("sleeps", "timed_out"), ("crashes", "killed")])
def test_a_batch_names_the_plugin_and_not_only_the_run(
    install: Install, rules: str, log: str, tmp_path: Path, name: str, outcome: str
) -> None:
    put(install, DEADLY[name][0])
    runs = tmp_path / "runs"
    runs.mkdir()
    Path(log).rename(runs / "trial.jsonl")

    limit = ["--time-limit-s", LIMITS.get(name, "300")]
    command = ["batch", str(runs), "--rules", rules, "-o", str(tmp_path / "out"), "-j", "1", *limit]

    # A process of its own: the server of this one may be older than the plugin.
    done = subprocess.run(
        [sys.executable, "-m", "ariac_score.cli", *command],
        env={**os.environ, "PYTHONPATH": str(tmp_path / "odd-rules-6.6")},
        check=False,
    )

    assert done.returncode == 6
    (row,) = [json.loads(line) for line in (tmp_path / "out/runs.jsonl").read_text().splitlines()]
    assert row["outcome"] == outcome
    assert "at last in check 'oddity': plugin odd.check (odd-rules 6.6)" in row["reason"]


def test_the_note_says_what_runs_innermost_and_then_what_it_returned_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ariac_score.installed.running._NOTES", _Notes())
    file = tmp_path / "note"
    with running("nobody reads this"):
        assert noted(file) == (0, "")

    note_in(file)
    with running("a reader"):
        assert noted(file)[1] == "a reader"
        with running("a decoder of quite another length"):
            assert noted(file)[1] == "a decoder of quite another length"
        assert noted(file) == (3, "a reader")
    assert noted(file) == (4, "")
