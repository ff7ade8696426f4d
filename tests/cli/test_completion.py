"""Completion: what may come next, and that real shells offer it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ariac_score.cli import _parser, main
from ariac_score.cli.completion import SCRIPTS, candidates

ROOT = Path(__file__).parents[2]


def _offered(line: str) -> list[str]:
    return [word for word, _ in candidates(line.split(" "), _parser)]


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("sc", ["score"]),
        ("-v sc", ["score"]),
        ("--config sc", []),  # a file
        ("rm", ["rml"]),  # of a plugin
        ("rules ", ["list", "show", "diff", "validate", "check", "prove"]),
        ("rules sh", ["show"]),
        ("rules show paper", ["paper2020", "paper2020.human_state", "paper2020.published"]),
        ("rules diff paper2020 paper2020.", ["paper2020.human_state", "paper2020.published"]),
        ("rules diff paper2020 paper2020 ", []),
        ("score trial.mcap --rules paper", ["paper2020", "paper2020.human_state", "paper2020.published"]),
        ("score --rules=paper2020.", ["--rules=paper2020.human_state", "--rules=paper2020.published"]),
        ("score --fai", ["--fail-on"]),
        ("score ", []),
        ("score trial.mcap --output-format j", ["json", "jsonl", "junit"]),
        ("score x --rules paper2020 --fail-on violation:sep", ["violation:separation"]),
        ("score x --fail-on v", ["violation"]),
        ("score --log-map ariac2019", ["ariac2019"]),
        ("plugins show iso_9283", ["iso_9283.pose_performance"]),
        ("platform codabench dry", ["dry-run"]),
        ("new mo", ["monitor"]),
        ("no_such_command ", []),
    ],
)
def test_what_may_come_next_is_offered(line: str, offered: list[str]) -> None:
    assert _offered(line) == offered


def test_every_command_is_offered_with_a_few_words(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--complete", ""]) == 0

    lines = dict(line.split("\t") for line in capsys.readouterr().out.splitlines())
    assert lines["score"] == "score a trial"
    assert "rml" in lines


def test_a_rule_set_that_cannot_be_read_offers_nothing_and_says_nothing(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["--complete", "score", "--rules", "nowhere.yaml", "--fail-on", "v"]) == 1
    assert capsys.readouterr() == ("", "")


def test_another_shell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["--print-completion", "bsh"])
    assert left.value.code == 4
    assert "did you mean 'bash'?" in capsys.readouterr().err


_ASK = {
    "bash": "{script}\nCOMP_LINE={line!r} COMP_POINT=${{#COMP_LINE}}\n"
    "COMP_LINE={line!r}; COMP_POINT=${{#COMP_LINE}}; _ariac_score; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
    "fish": "{script}\ncomplete -C {line!r}",
}


def _asked(shell: str, line: str, folder: Path) -> list[str]:
    """What a shell offers for a line, and the words about it left out."""
    bin_folder = folder / "bin"
    bin_folder.mkdir(exist_ok=True)
    program = bin_folder / "ariac-score"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m ariac_score.cli "$@"\n')
    program.chmod(0o755)
    done = subprocess.run(
        [shell, "-c", _ASK[shell].format(script=SCRIPTS[shell], line=line)],
        env={**os.environ, "PATH": f"{bin_folder}:{os.environ['PATH']}", "HOME": str(folder)},
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return [text.partition("\t")[0] for text in done.stdout.splitlines() if text]


@pytest.mark.slow
@pytest.mark.parametrize("shell", ["bash", pytest.param("fish", marks=pytest.mark.slow)])
def test_a_real_shell_offers_it(shell: str, tmp_path: Path) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell} here")
    (tmp_path / "trial.mcap").touch()

    assert _asked(shell, "ariac-score -q rules sho", tmp_path) == ["show"]
    assert _asked(shell, "ariac-score score trial.mcap --rules paper2020.h", tmp_path) == [
        "paper2020.human_state"
    ]
    criterion = "ariac-score score x --rules paper2020 --fail-on violation:sepa"
    # To bash, what follows the colon is a word of its own.
    assert _asked(shell, criterion, tmp_path) == ["separation" if shell == "bash" else "violation:separation"]
    # Files are left to the shell: bash completes them by itself where nothing is offered.
    assert _asked(shell, "ariac-score score tri", tmp_path) == ([] if shell == "bash" else ["trial.mcap"])


@pytest.mark.slow
def test_zsh_offers_it_on_a_terminal(tmp_path: Path) -> None:
    if shutil.which("zsh") is None:
        pytest.skip("there is no zsh here")
    (tmp_path / "_ariac-score").write_text(SCRIPTS["zsh"])
    # Outside of its editor zsh completes nothing: functions in place of its own show what it would list.
    ask = (
        'compdef() {{ }}; _describe() {{ print -rl -- "${{(@P)2}}"; }}; _files() {{ print FILES; }}\n'
        "source ./_ariac-score; words=({words}); CURRENT=$#words; _ariac_score"
    )
    program = tmp_path / "ariac-score"
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m ariac_score.cli "$@"\n')
    program.chmod(0o755)
    for words, offered in (
        ("./ariac-score score x --rules paper2020.h", ["paper2020.human_state:rule set"]),
        ("./ariac-score score x --rules paper2020 --fail-on unknown:sep", ["unknown\\:separation:"]),
        ("./ariac-score score ''", ["FILES"]),
    ):
        done = subprocess.run(
            ["zsh", "-f", "-c", ask.format(words=words)],  # noqa: S607  # the shell of whoever runs the tests
            capture_output=True,
            text=True,
            check=True,
            cwd=tmp_path,
        )
        assert [line[: len(offered[0])] for line in done.stdout.splitlines()] == offered, done.stderr
