"""What a plugin prints, raises and leaves behind stays where it was called."""

from __future__ import annotations

import decimal
import io
import json
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest

from ariac_score.errors import PluginError
from ariac_score.installed.captured_output import EscapedError, fault_of, quiet
from ariac_score.installed.running import EndedError, _Interrupts
from ariac_score.testing import near_miss_trial, write_trial_log

ORIGIN = "odd.check (odd-rules 6.6)"


class _Odd(BaseException):
    pass


@pytest.mark.parametrize("escaped", [SystemExit(0), GeneratorExit(), _Odd("odd")])
def test_what_is_no_exception_becomes_one_that_says_what_it_was(escaped: BaseException) -> None:
    with pytest.raises(EscapedError) as raised, quiet(ORIGIN):
        raise escaped

    assert str(fault_of(raised.value)) == f"{type(escaped).__name__}: {escaped}"


def test_what_this_program_itself_ends_is_let_through() -> None:
    with pytest.raises(EndedError), quiet(ORIGIN):
        raise EndedError


def test_an_interrupt_is_of_a_person_where_a_signal_came_or_nobody_listens(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    interrupts = _Interrupts()
    monkeypatch.setattr("ariac_score.installed.running._INTERRUPTS", interrupts)
    with pytest.raises(KeyboardInterrupt), quiet(ORIGIN):
        raise KeyboardInterrupt

    interrupts.heard = False  # as once a process listens
    with pytest.raises(EscapedError), quiet(ORIGIN):
        raise KeyboardInterrupt
    with pytest.raises(KeyboardInterrupt), quiet(ORIGIN):
        interrupts.take(2, None)


@pytest.mark.parametrize("says", [lambda _: 1 / 0, lambda _: 5, lambda _: sys.exit(7)])
def test_an_exception_whose_text_fails_is_named_all_the_same(says: Callable[[object], str]) -> None:
    mute = type("Mute", (Exception,), {"__str__": says})

    assert str(fault_of(mute())).startswith("Mute: (its text cannot be shown: ")


def test_the_working_directory_is_brought_back_and_the_plugin_named(tmp_path: Path) -> None:
    before = Path.cwd()

    named = r"plugin odd.check \(odd-rules 6.6\) changed the working directory"
    with pytest.raises(PluginError, match=named), quiet(ORIGIN, deep=True):
        os.chdir(tmp_path)

    assert Path.cwd() == before


def test_standard_error_is_brought_back_and_the_plugin_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "stderr", io.StringIO())
    with pytest.raises(PluginError, match="closed standard error"), quiet(ORIGIN, deep=True):
        sys.stderr.close()
    assert not sys.stderr.closed

    with pytest.raises(PluginError, match="closed standard error"), quiet(ORIGIN, deep=True):
        os.close(2)
    os.fstat(2)


def _leave_for(folder: Path) -> None:
    os.chdir(folder)
    raise ZeroDivisionError


def test_what_the_plugin_raised_is_said_before_what_it_left_behind(tmp_path: Path) -> None:
    before = Path.cwd()

    with pytest.raises(ZeroDivisionError), quiet(ORIGIN, deep=True):
        _leave_for(tmp_path)

    assert Path.cwd() == before


def test_the_precision_of_decimal_numbers_stays_ours() -> None:
    with quiet(ORIGIN, deep=True):
        decimal.getcontext().prec = 3

    assert str(decimal.Decimal(1) / 3) == "0.3333333333333333333333333333"


def test_what_was_printed_is_said_although_the_plugin_closed_standard_output() -> None:
    said: list[str] = []

    with quiet(ORIGIN, lambda _origin, fault: said.append(fault)):
        sys.stdout.write("hello\n")
        sys.stdout.close()

    assert said == ["printed 'hello'; plugins speak through findings alone"]


# As its user would ---------------------------------------------------------------------

FILE = """
import atexit, os, sys, threading
from ariac_score import Finding

class Spoils:
    def needs(self):
        return ()

    def watch(self, trial):
        {body}
        yield Finding.satisfied("trial", "fine")
"""
SOUND = {
    "writes at the end": 'atexit.register(lambda: (os.write(1, b"late"), print("late")))',
    "copies the process": "os.fork()",
    "writes meanwhile": 'threading.Timer(0.2, lambda: os.write(1, b"late")).start()',
}
NAMED = {
    "raises what has no text": (
        'raise type("Mute", (Exception,), {"__str__": lambda self: 1 / 0})',
        "raised Mute: (its text",
    ),
    "raises what is no exception": ('raise type("Odd", (BaseException,), {})("odd")', "raised Odd: odd"),
    "raises an interrupt": ("raise KeyboardInterrupt", "raised KeyboardInterrupt"),
    "closes standard error": ("sys.stderr.close()", "closed standard error"),
    "goes elsewhere": ('os.chdir("/")', "changed the working directory"),
    "never ends": (
        'while True: yield Finding.satisfied("trial", "fine")',
        "gives more than 250,000 findings",
    ),
}


def scored(
    folder: Path, body: str, *more: str, before: Sequence[str] = ()
) -> subprocess.CompletedProcess[str]:
    (folder / "ours.py").write_text(FILE.format(body=body), encoding="utf-8")
    (folder / "rules.yaml").write_text(
        "{id: ours, title: ours, source: test, log_map: ariac2020, score: 10 * holds(spoils), "
        "monitors: {spoils: {use: './ours.py:Spoils'}}}",
        encoding="utf-8",
    )
    write_trial_log(folder / "trial.jsonl", near_miss_trial())
    command = ["score", "trial.jsonl", "--rules", "rules.yaml", "--local-plugins", "--output-format", "json"]
    return subprocess.run(
        [*before, sys.executable, "-m", "ariac_score.cli", *command, *more],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow  # a process for each
@pytest.mark.parametrize("name", SOUND)
def test_no_plugin_spoils_the_result(tmp_path: Path, name: str) -> None:
    done = scored(tmp_path, SOUND[name])

    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["score"] == 10


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMED)
def test_a_plugin_that_misbehaves_is_named(tmp_path: Path, name: str) -> None:
    body, words = NAMED[name]

    done = scored(tmp_path, body)

    assert (done.returncode, done.stdout) == (3, "")
    assert done.stderr.startswith("error: check 'spoils': plugin ./ours.py:Spoils (local file ")
    assert words in done.stderr.splitlines()[0]


@pytest.mark.slow
@pytest.mark.skipif(os.name == "nt", reason="there is no shell that ignores the signal")
def test_an_interrupt_is_that_of_the_plugin_in_the_background_of_a_script_too(tmp_path: Path) -> None:
    """Which has its programs ignore the signal, so that no person can have sent it."""
    body, words = NAMED["raises an interrupt"]

    done = scored(tmp_path, body, before=("sh", "-c", "trap '' INT; exec \"$@\"", "sh"))

    assert (done.returncode, done.stdout) == (3, "")
    assert words in done.stderr.splitlines()[0]


@pytest.mark.slow
def test_apart_even_one_that_ends_its_process_or_closes_everything_is_named(tmp_path: Path) -> None:
    for body in ("os._exit(0)", "os.closerange(0, 200)"):
        done = scored(tmp_path, body, "--time-limit-s", "300")

        assert (done.returncode, done.stdout) == (3, "")
        assert "plugin ./ours.py:Spoils" in done.stderr
        assert "ended the process it ran in" in done.stderr


@pytest.mark.slow
def test_the_command_itself_runs_as_a_process_of_its_own(tmp_path: Path) -> None:
    done = scored(tmp_path, SOUND["writes at the end"])

    assert json.loads(done.stdout)["score"] == 10
    assert "late" in done.stderr
