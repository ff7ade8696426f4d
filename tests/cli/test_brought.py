"""Commands that plugins bring: listed without being loaded, run, and refused where two bring one."""

from __future__ import annotations

import sys
from collections.abc import Callable

import pytest

from ariac_score.cli import main

Install = Callable[..., str]
GROUP = "ariac_score.commands"
GREET = '''"""`ariac-score greet`: greet whoever scores, 100 % politely."""

def register(commands):
    parser = commands.add_parser("greet")
    parser.add_argument("name")
    parser.set_defaults(run=run)

def run(arguments):
    if arguments.name == "nobody":
        raise RuntimeError("there is nobody")
    print(f"good day, {arguments.name}")
    return 1

class Command:
    register = staticmethod(register)
'''


def left_with(words: list[str]) -> int | str | None:
    with pytest.raises(SystemExit) as left:
        main(words)
    return left.value.code


def help_text(capsys: pytest.CaptureFixture[str]) -> str:
    assert left_with(["--help"]) == 0
    return " ".join(capsys.readouterr().out.split())


def test_a_command_of_a_plugin_runs_and_gives_the_exit_code(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install("cell-manners", {"greet": "Command"}, source=GREET, group=GROUP)

    assert main(["greet", "referee"]) == 1
    assert capsys.readouterr().out == "good day, referee\n"
    assert left_with(["greet"]) == 4  # its usage errors are as ours


def test_the_help_lists_it_without_importing_it(install: Install, capsys: pytest.CaptureFixture[str]) -> None:
    module = install("cell-manners", {"greet": "Command"}, source=GREET, group=GROUP)

    assert "greet greet whoever scores, 100 % politely " in help_text(capsys)
    assert module not in sys.modules


@pytest.mark.slow
@pytest.mark.parametrize("source", ["import nothing_of_that_name", "def broken(", ""])
def test_a_broken_command_harms_no_other(
    install: Install, capsys: pytest.CaptureFixture[str], source: str
) -> None:
    install("cell-manners", {"greet": "Command"}, source=source, group=GROUP)

    assert "greet a command of cell-manners" in help_text(capsys)
    assert main(["rules", "list"]) == 0
    capsys.readouterr()
    assert main(["greet", "referee"]) == 3
    assert "the command 'greet' (cell-manners 1.0) cannot be used: " in capsys.readouterr().err


def test_a_command_that_two_distributions_bring_is_refused(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    for distribution in ("cell-manners", "other-manners"):
        install(distribution, {"greet": "Command"}, source=GREET, group=GROUP)

    assert "greet cannot be used: it is brought by " in help_text(capsys)
    assert main(["greet", "referee"]) == 4
    said = capsys.readouterr().err
    assert "cell-manners 1.0" in said
    assert "other-manners 1.0" in said


@pytest.mark.slow
def test_a_command_of_ours_cannot_be_replaced(install: Install, capsys: pytest.CaptureFixture[str]) -> None:
    module = install("cell-manners", {"rules": "Command"}, source=GREET, group=GROUP)

    assert main(["rules", "list"]) == 0
    assert help_text(capsys).count(" rules list, show, validate") == 1
    assert module not in sys.modules


def test_a_command_that_is_not_added_is_a_fault_of_its_authors(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    source = GREET.replace('add_parser("greet")', 'add_parser("great")')
    install("cell-manners", {"greet": "Command"}, source=source, group=GROUP)

    assert main(["greet", "referee"]) == 3
    assert "does not add a parser of that name" in capsys.readouterr().err


def test_an_error_in_a_command_is_a_fault_of_its_distribution(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    install("cell-manners", {"greet": "Command"}, source=GREET, group=GROUP)

    assert main(["greet", "nobody"]) == 3
    assert "this is a fault of cell-manners 1.0;" in capsys.readouterr().err
