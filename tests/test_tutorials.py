"""The tutorials are walked: every command runs, and prints what the page shows."""

from __future__ import annotations

import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from pathlib import Path

import pytest

from ariac_score.cli import main

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "docs/tutorials"
DOORS = {"team": 9, "organiser": 7, "author": 5, "researcher": 5}
"""How many commands each takes, those for the installation included."""
INSTALL = "python3 -m venv .venv && .venv/bin/pip install -q . && . .venv/bin/activate"


@dataclass(frozen=True)
class Block:
    """A fenced block of a page: its language, the file it is for, and its text."""

    language: str
    title: str
    text: str


def _blocks(page: str) -> Iterator[Block]:
    for head, text in re.findall(r"^```(\S[^\n]*)\n(.*?)^```", page, re.DOTALL | re.MULTILINE):
        title = re.search(r'title="([^"]+)"', head)
        yield Block(head.split()[0], title[1] if title else "", text)


def _commands(block: Block) -> list[str]:
    return [line for line in block.text.replace("\\\n", " ").splitlines() if line.strip()]


def _page(door: str) -> str:
    return (PAGES / f"{door}.md").read_text(encoding="utf-8")


def _shows(excerpt: str, printed: str) -> None:
    """Hold an excerpt, in which `…` stands for left out lines, against what was printed."""
    lines = iter(printed.splitlines())
    for wanted in excerpt.splitlines():
        if wanted != "…":
            assert any(line.startswith(wanted) for line in lines), f"not printed, or not there: {wanted}"


def _walk(door: str, folder: Path, run: Callable[[str], str]) -> int:
    """Do what a tutorial says; the number of its commands."""
    printed, steps = "", 0
    (folder / "examples").symlink_to(ROOT / "examples")
    for block in _blocks(_page(door)):
        if block.title:
            (folder / block.title).write_text(block.text, encoding="utf-8")
        elif block.language == "sh":
            printed = ""
            for command in _commands(block):
                steps += 1
                printed += "" if command == INSTALL else run(command)
        elif block.language == "python" and "import" in block.text:  # else it is part of a file
            out = io.StringIO()
            with redirect_stdout(out):
                exec(compile(block.text, door, "exec"), {})  # noqa: S102  # our own text
            printed = out.getvalue()
        elif block.language == "text":
            _shows(block.text, printed)
    return steps


def _run(command: str) -> str:
    program, *arguments = shlex.split(command.partition(" #")[0])
    out = io.StringIO()
    with redirect_stdout(out), redirect_stderr(out):
        code = main(arguments)
    assert (program, code) == ("ariac-score", _code_of(command)), (command, out.getvalue())
    return out.getvalue()


def _code_of(command: str) -> int:
    """The exit code that a page announces in a comment; else 0."""
    announced = re.search(r"# exit code (\d)", command)
    return int(announced[1]) if announced else 0


SLOW = {"organiser"}  # it draws a page for every run


@pytest.mark.slow
@pytest.mark.parametrize(
    "door", [pytest.param(door, marks=[pytest.mark.slow] if door in SLOW else []) for door in DOORS]
)
def test_every_command_of_a_tutorial_does_what_its_page_shows(
    door: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)

    assert _walk(door, tmp_path, _run) == DOORS[door]


def test_a_team_has_its_page_after_three_commands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    (first, *_) = (block for block in _blocks(_page("team")) if block.language == "sh")

    commands = _commands(first)
    assert len(commands) == 3
    for command in commands[1:]:
        _run(command)
    assert (tmp_path / "trial.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


@pytest.mark.slow
@pytest.mark.skipif("ARIAC_SCORE_LONG" not in os.environ, reason="takes two minutes: part of .ci/long")
def test_the_doors_open_on_a_fresh_machine(tmp_path: Path) -> None:
    """The checkout is installed as the first tutorial says, and each tutorial walked in a shell."""
    python = tmp_path / ".venv/bin"
    subprocess.run([sys.executable, "-m", "venv", str(tmp_path / ".venv")], check=True)
    subprocess.run([str(python / "pip"), "install", "-q", str(ROOT)], check=True)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("ARIAC_SCORE")}
    environment |= {"PATH": f"{python}:{os.environ['PATH']}"}

    for door, steps in DOORS.items():
        folder = tmp_path / door
        folder.mkdir()

        def run(command: str, folder: Path = folder) -> str:
            done = subprocess.run(
                ["/bin/sh", "-c", f"{command} 2>&1"],
                cwd=folder,
                env=environment,
                capture_output=True,
                text=True,
                check=False,
            )
            assert done.returncode == _code_of(command), (command, done.stdout)
            return done.stdout

        before = Path.cwd()
        os.chdir(folder)  # for the block of Python, which runs here
        try:
            assert _walk(door, folder, run) == steps
        finally:
            os.chdir(before)
