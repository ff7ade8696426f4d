"""The page on the guests is done as it is written: every command run, every output compared."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest

from ariac_score.cli import main

pytestmark = pytest.mark.usefixtures("guests")

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/guests.md"
BLOCK = re.compile(r"```sh\n(?P<command>[^\n]*)\n```\n\n```text\n(?P<shown>.*?)```", re.DOTALL)
LEFT_OUT = "…"


def missing(output: list[str], shown: list[str]) -> str:
    """The first line of the page that the output does not have in its turn; lines are left out at `…`."""
    at, loose = 0, False
    for line in shown:
        if line.strip() == LEFT_OUT:
            loose = True
            continue
        where = next((k for k in range(at, len(output)) if output[k].rstrip() == line.rstrip()), None)
        if where is None or not (loose or where == at):
            return line
        at, loose = where + 1, False
    return ""


STEPS = [(found["command"], found["shown"]) for found in BLOCK.finditer(PAGE.read_text("utf-8"))]


def test_the_page_shows_a_command_for_each_guest() -> None:
    assert {name for name in ("barn", "robocup_work", "carla") if any(name in c for c, _ in STEPS)} == {
        "barn",
        "robocup_work",
        "carla",
    }


@pytest.mark.parametrize(("command", "shown"), STEPS, ids=[command for command, _ in STEPS])
def test_a_command_of_the_page_says_what_the_page_shows(
    command: str, shown: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(ROOT)

    code = main(shlex.split(command)[1:])

    said = capsys.readouterr()
    assert code == 0, said.err
    assert missing(said.out.splitlines(), shown.splitlines()) == "", said.out


@pytest.mark.parametrize("guest", ["barn", "robocup_work", "carla"])
def test_the_numbers_of_the_pages_are_those_derived_by_hand(guest: str) -> None:
    readme = (ROOT / "examples/competitions" / guest / "README.md").read_text("utf-8")
    by_hand = json.loads((ROOT / "examples/competitions" / guest / "expected.json").read_text("utf-8"))
    for of in by_hand.values():
        for expected in of.values():
            assert expected["score"] in readme
            for amount in (expected["earned"], *expected["taken"].values()):
                assert amount in readme
