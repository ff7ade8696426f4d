"""The command line: `ariac-score COMMAND`.

Exit codes:
    0  scored (or done), criteria met
    1  scored, but a criterion of --fail-on failed; audited or verified, and something differs
    2  interrupted
    3  internal error, or a plugin failed
    4  usage error, or an invalid rule set, log map or configuration
    5  nothing to score: no such file, empty, or not a trial log
    6  a log is damaged, or something the score depends on is undecided
    7  a batch could not be finished, as when the disk is full; what it has done is kept
    8  a verified result is consistent in itself, but was not compared with its log

Results go to stdout, everything else to stderr.
"""

from __future__ import annotations

import argparse
import errno
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

from ariac_score.cli import settings
from ariac_score.cli.completion import ASKED, SCRIPTS, PrintCompletion, print_candidates
from ariac_score.cli.notes import is_apart
from ariac_score.cli.parser import EXIT_USAGE, Parser, add_everywhere, command_in, leaves
from ariac_score.errors import ScoreError, UsageError
from ariac_score.installed.captured_output import fault_of, keep_results_apart
from ariac_score.installed.running import listen_for_interrupts
from ariac_score.terminal.style import plain, style_for

__all__ = ["main", "program"]

EXIT_INTERRUPTED = 2
EXIT_INTERNAL = 3

_GROUPS = {
    "for teams: from a recording to its page": {
        "example": "write an example to try things on, and a command to begin with",
        "record": "print, or run, the commands that record a trial so that it can be scored",
        "check": "check whether a log can be scored, and what is missing",
        "score": "score a trial",
        "watch": "judge a running cell while it runs, record it and score it",
        "report": "make a page of a result, or the site of a competition",
        "explain": "follow any number of a result back to its samples",
        "info": "show the contents of a log, and which checks it could decide",
        "map": "draft the log map of a recording: who is who, and where it is stated",
        "annotate": "write the findings of a result as a recording to open with its log",
    },
    "for organisers: from runs to a ranking that holds": {
        "rank": "rank the teams of a competition",
        "batch": "score many trials, each in a process of its own; call again to go on",
        "merge": "join the shards of a batch",
        "verify": "check a stored result, alone or against its log",
        "audit": "compare the official score with the log, item by item",
        "adjust": "apply decisions of stewards on top of a result",
        "sign": "sign results with a key",
        "platform": "host a competition on Codabench or EvalAI",
    },
    "for authors of rules and plugins": {
        "rules": "list, show, validate, compare and test rule sets",
        "redteam": "search what a team could leave out, forge or do to score more than an honest log",
        "plugins": "list, show and check installed plugins",
        "new": "start a plugin in one file, and let it grow into a distribution",
    },
    "for researchers": {
        "price": "price a stored result under other rules, without its log",
        "sensitivity": "vary every parameter and show whether score or ranks would change",
        "export": "write a result as JUnit, SARIF, Markdown, CSV, …; a batch as a table",
        "oracle": "answer running monitors of ROSMonitoring, event by event",
    },
}
_COMMANDS = {name: summary for group in _GROUPS.values() for name, summary in group.items()}
"""The line about each command in `--help`: the module of a command is imported only to run it."""


class _Version(argparse.Action):
    """Prints the version, which is looked up only then."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> NoReturn:
        from importlib.metadata import version  # noqa: PLC0415  # takes as long to load as all of this

        print(f"ariac-score {version('ariac-score')}")
        parser.exit()


def _parser(name: str) -> Parser:
    """The parser of one command, or one with a line about each where the command line names none."""
    parser = Parser(
        prog="ariac-score",
        usage="ariac-score COMMAND … ('ariac-score COMMAND --help' says what it takes)",
        description="Score robot competition trials: task points, safety monitors, one explained score.",
        epilog="Exit codes: 0 scored, 1 a criterion failed, or an audit or verification found a difference, "
        "2 interrupted, 3 internal or plugin error, 4 usage or invalid rules, 5 nothing to score, "
        "6 damaged log or undecided score, 7 a batch could not be finished, 8 verified without a log.",
        groups=_GROUPS,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    parser.add_argument(
        "--print-completion",
        action=PrintCompletion,
        choices=tuple(SCRIPTS),
        metavar="SHELL",
        help="print what completes command lines in bash, zsh or fish, and exit",
    )
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True, prog=parser.prog)
    if name in _COMMANDS:
        import_module(f"ariac_score.cli.{name}").register(commands)
    elif name != "--version":
        for known, summary in _COMMANDS.items():
            commands.add_parser(known, help=summary)
        _add_brought(name, commands)
    for each in (parser, *leaves(parser)):
        add_everywhere(each)
    return parser


def _add_brought(name: str, commands: Any) -> None:
    """Add the commands of plugins: the one that is called, and a line about each of the others."""
    from ariac_score.cli.brought import (  # noqa: PLC0415  # our own commands need none of it
        brought_commands,
        register_brought,
        summary_of,
    )

    for brought, plugins in brought_commands(_COMMANDS).items():
        if brought == name:
            register_brought(brought, plugins, commands)
        else:
            commands.add_parser(brought, help=summary_of(plugins), add_help=False)


def program() -> NoReturn:
    """Be the process of one command: what plugins start, or leave to be done at its end, spoils no result."""
    results = keep_results_apart()
    listen_for_interrupts()
    try:
        code = main()
    finally:
        sys.stdout = sys.__stdout__  # which leads to standard error now
        if results is not None:
            with suppress(ValueError):  # a plugin has closed it
                results.close()
    sys.exit(code)


def _arguments(given: Sequence[str]) -> argparse.Namespace:
    """The command line, and what it leaves out and settings say."""
    command = command_in(given)
    parser = _parser(command)
    if command not in settings.COMMANDS or {"-h", "--help"} & set(given):
        return _with_format(parser.parse_args(given))
    found = settings.load_settings(Path.cwd(), os.environ, **_said_of_files(given))
    arguments, taken = settings.settle(parser, command, given, found)
    if not is_apart():  # else it was said before
        settings.tell(arguments, taken, found)
    return _with_format(arguments)


def _with_format(arguments: argparse.Namespace) -> argparse.Namespace:
    """The arguments with a format where none is named: that of the file to write, else text."""
    if getattr(arguments, "output_format", "") is None:
        as_json = arguments.output is not None and arguments.output.suffix == ".json"
        arguments.output_format = "json" if as_json else "text"
    return arguments


def _refuse_overlong_paths(arguments: argparse.Namespace) -> None:
    """Refuse names that no file can have, which many a question about a file answers with an error.

    Raises:
        UsageError: A path, or a name in it, is longer than the system takes.
    """
    for name, value in vars(arguments).items():
        for path in value if isinstance(value, list) else (value,):
            if not isinstance(path, Path) and name != "path":  # which may be an address as well
                continue
            try:
                os.lstat(path)
            except OSError as error:
                if error.errno == errno.ENAMETOOLONG:
                    shown = f"{str(path)[:60]}…"
                    raise UsageError(
                        f"the file name {shown!r} is too long", hint="is it a text in place of a path?"
                    ) from None


def _said_of_files(given: Sequence[str]) -> dict[str, Any]:
    """What a command line says of files with settings, which has to be known before it is parsed."""
    named = [word.partition("=")[2] for word in given if word.startswith("--config=")]
    named += [after for word, after in pairwise(given) if word == "--config"]
    search = "--no-config" not in given
    return {"file": Path(named[-1]) if named and search else None, "search": search}


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    # No matrix here is large enough for the threads that numpy would start, and these wait by spinning.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    given, author, code = sys.argv[1:] if argv is None else argv, "", 0
    try:
        if given and given[0] == ASKED:
            return print_candidates(given[1:], _parser)
        arguments = _arguments(given)
        _refuse_overlong_paths(arguments)
        arguments.given = list(given)  # for a command that runs itself in another process
        author = getattr(arguments, "author", "")
        code = int(arguments.run(arguments))
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except OSError as error:
        # Readers raise errors of their own, so it is the output that cannot be written.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"error: the output cannot be written: {error.strerror}", file=sys.stderr)
        print("hint: check the disk, or write to a file with -o", file=sys.stderr)
        return EXIT_USAGE
    except SystemExit:
        raise
    except BaseException as error:  # noqa: BLE001  # no traceback reaches a user
        return _failed(error, author or "ariac-score")
    return code


def _failed(error: BaseException, author: str) -> int:
    """Print what went wrong, and for an internal error whose fault it is; the exit code."""
    if isinstance(error, ScoreError):
        _print_error(error)
        return error.exit_code
    if os.environ.get("ARIAC_SCORE_DEBUG"):
        raise error
    print(f"internal error: {fault_of(error)}", file=sys.stderr)
    print(
        f"hint: this is a fault of {author}; set ARIAC_SCORE_DEBUG=1 and report the traceback",
        file=sys.stderr,
    )
    return EXIT_INTERNAL


def _print_error(error: ScoreError) -> None:
    style = style_for(sys.stderr)
    print(f"{style('error:', 'bold', 'red')} {plain(str(error))}", file=sys.stderr)
    if error.hint:
        print(f"{style('hint:', 'bold', 'cyan')} {plain(error.hint)}", file=sys.stderr)
