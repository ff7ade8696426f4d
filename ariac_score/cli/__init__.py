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

Results go to stdout, everything else to stderr.
"""

from __future__ import annotations

import argparse
import atexit
import gc
import os
import sys
from collections.abc import Sequence
from importlib import import_module
from typing import TYPE_CHECKING, Any, NoReturn

if TYPE_CHECKING:
    from ariac_score.errors import ScoreError

__all__ = ["main"]

EXIT_INTERRUPTED = 2
EXIT_INTERNAL = 3
EXIT_USAGE = 4

_COMMANDS = (
    "check",
    "score",
    "info",
    "explain",
    "report",
    "price",
    "adjust",
    "verify",
    "export",
    "annotate",
    "audit",
    "rank",
    "batch",
    "merge",
    "sign",
    "platform",
    "sensitivity",
    "rules",
    "plugins",
    "new",
    "oracle",
)


class _Parser(argparse.ArgumentParser):
    """A parser whose usage errors have the documented exit code."""

    def error(self, message: str) -> NoReturn:
        self.print_usage(sys.stderr)
        print(f"error: {message}", file=sys.stderr)
        print(f"hint: {self.prog} --help", file=sys.stderr)
        self.exit(EXIT_USAGE)


class _Version(argparse.Action):
    """Prints the version; looked up only then, because that takes longer than parsing."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> NoReturn:
        print(f"ariac-score {_version()}")
        parser.exit()


def _version() -> str:
    """The version by the name of the installed metadata; reading them takes longer than Python to start."""
    for folder in sys.path:
        try:
            names = os.listdir(folder or ".")  # noqa: PTH208  # pathlib takes longer to load than all else
        except OSError:
            continue
        for name in names:
            if name.startswith("ariac_score-") and name.endswith(".dist-info"):
                return name.removeprefix("ariac_score-").removesuffix(".dist-info")
    from importlib.metadata import version  # noqa: PLC0415  # see above

    return version("ariac-score")


def _parser(first: str = "") -> argparse.ArgumentParser:
    """The parser of the command that a command line begins with; of none for the version, else of all.

    Of a command that a plugin brings only the wanted one is imported, and never for the help of all.
    """
    parser = _Parser(
        prog="ariac-score",
        description="Score robot competition trials: task points, safety monitors, one explained score.",
        epilog="Exit codes: 0 scored, 1 a criterion failed, or an audit or verification found a difference, "
        "2 interrupted, 3 internal or plugin error, 4 usage or invalid rules, 5 nothing to score, "
        "6 damaged log or undecided score, 7 a batch could not be finished.",
    )
    parser.add_argument("--version", action=_Version, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(dest="command", metavar="COMMAND", required=True)
    if first == "--version":
        return parser
    for name in [first] if first in _COMMANDS else _COMMANDS:
        import_module(f"ariac_score.cli.{name}").register(commands)
    if first not in _COMMANDS:
        _add_brought(first, commands)
    return parser


def _add_brought(first: str, commands: Any) -> None:
    """Add the commands that plugins bring: the one that is wanted, of the others a line for the help."""
    from ariac_score.cli.brought import (  # noqa: PLC0415  # our own commands need none of it
        brought_commands,
        register_brought,
        summary_of,
    )

    for name, points in brought_commands(_COMMANDS).items():
        if name == first:
            register_brought(name, points, commands)
        else:
            commands.add_parser(name, help=summary_of(points), add_help=False)


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    # Nothing here multiplies matrices large enough to be worth the threads that numpy would start, which
    # wait for work by spinning.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What is left at the end goes with the process; looking through it takes longer than some commands.
    atexit.unregister(gc.freeze)
    atexit.register(gc.freeze)
    words, author = sys.argv[1:] if argv is None else argv, ""
    try:
        arguments = _parser(words[0] if words else "").parse_args(words)
        author = getattr(arguments, "author", "")
        code: int = arguments.run(arguments)
        sys.stdout.flush()
    except KeyboardInterrupt:
        print("interrupted; nothing was written", file=sys.stderr)
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader of our output has gone, as with `| head`: not an error of ours.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except OSError as error:
        # Reading has errors of its own; what is left is that the output cannot be written.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        print(f"error: the output cannot be written: {error.strerror}", file=sys.stderr)
        print("hint: check the disk, or write to a file with -o", file=sys.stderr)
        return EXIT_USAGE
    except Exception as error:  # noqa: BLE001  # no traceback reaches a user
        return _failed(error, author or "ariac-score")
    return code


def _failed(error: Exception, author: str) -> int:
    """Say what went wrong, in words and whose fault it is, and give the exit code."""
    from ariac_score.errors import ScoreError  # noqa: PLC0415  # only when something failed

    if isinstance(error, ScoreError):
        _say(error)
        return error.exit_code
    if os.environ.get("ARIAC_SCORE_DEBUG"):
        raise error
    print(f"internal error: {type(error).__name__}: {error}", file=sys.stderr)
    print(
        f"hint: this is a fault of {author}; set ARIAC_SCORE_DEBUG=1 and report the traceback",
        file=sys.stderr,
    )
    return EXIT_INTERNAL


def _say(error: ScoreError) -> None:
    from ariac_score.terminal.style import plain, style_for  # noqa: PLC0415  # only when something failed

    style = style_for(sys.stderr)
    print(f"{style('error:', 'bold', 'red')} {plain(str(error))}", file=sys.stderr)
    if error.hint:
        print(f"{style('hint:', 'bold', 'cyan')} {plain(error.hint)}", file=sys.stderr)
