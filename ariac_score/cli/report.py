"""`ariac-score report RESULT`: a result as a page to look at, print and share."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ariac_score.cli.notes import note
from ariac_score.cli.site import add_arguments as add_site_arguments
from ariac_score.cli.site import (
    is_competition,
    refuse_site_arguments,
    site_of_competition,
    site_of_ranking,
)
from ariac_score.cli.stored import is_log, result_given
from ariac_score.documents.plain_file import read_plain
from ariac_score.errors import NoResultError, ResultError, UsageError
from ariac_score.report.html.trial import embedded_result, trial_page
from ariac_score.results.codec import MAX_BYTES
from ariac_score.results.result_file import as_json
from ariac_score.terminal.output import refuse_inputs, write

_LARGEST_PAGE_BYTES = 4 * MAX_BYTES
"""A page holds its result, and is larger."""


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "report",
        description="Make one self-contained HTML page of a trial's result, or a folder of pages of a "
        "competition: no network, no server.",
    )
    parser.add_argument(
        "result",
        type=Path,
        metavar="RESULT|RANKING|COMPETITION",
        help="JSON written by 'score' or 'rank'; or a competition.yaml, or its folder",
    )
    add_site_arguments(parser)
    parser.add_argument(
        "--extract", action="store_true", help="extract the result from a page (RESULT is the page)"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="OUT",
        help="file of a page (-: stdout), or folder of a site; default: the name of RESULT, with .html",
    )
    parser.add_argument(
        "--output-folder", type=Path, metavar="DIR", help="where a page goes that -o does not name"
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Make the page or site for this kind of file."""
    refuse_inputs(arguments.output, arguments.result)
    if arguments.extract:
        return _extract(arguments)
    if is_competition(arguments.result) and not _is_folder_of_a_log(arguments.result):
        return site_of_competition(arguments)
    return _WRITERS.get(_kind(arguments.result), _trial)(arguments)


def _kind(file: Path) -> str:
    """The kind of a file by its `schema`, such as `ariac-score/result`; empty without one."""
    try:
        stored = json.loads(read_plain(file, MAX_BYTES))
    except (OSError, ValueError, RecursionError):
        return ""  # reading it as a result reports what is wrong
    schema = stored.get("schema") if isinstance(stored, dict) else None
    return schema.rpartition("/")[0] if isinstance(schema, str) else ""


def _is_folder_of_a_log(path: Path) -> bool:
    """Whether a folder is a recording, or all parts of one trial, and no competition."""
    competition = (path / "competition.yaml").is_file() or (path / "logs").is_dir()
    return path.is_dir() and not competition and is_log(path)


def _trial(arguments: argparse.Namespace) -> int:
    refuse_site_arguments(arguments)
    result = result_given(arguments.result, "report")
    page = trial_page(result, as_json(result))
    if arguments.output is not None:
        write(page, arguments.output)
        return 0
    file = (arguments.output_folder or Path()) / f"{arguments.result.stem.removesuffix('.result')}.html"
    _refuse_other_pages(file)
    write(page, file)
    note(arguments, f"open {file}")
    return 0


def _refuse_other_pages(file: Path) -> None:
    """Refuse to replace a file that nobody named, unless it is a page of a trial itself.

    Raises:
        UsageError: It is something else.
    """
    try:
        before = read_plain(file, _LARGEST_PAGE_BYTES).decode("utf-8")
    except FileNotFoundError:
        return
    except (OSError, UnicodeDecodeError):
        before = ""
    if embedded_result(before) is None:
        raise UsageError(
            "there is such a file already, and it is no page of a trial",
            file=file,
            hint="name another with -o FILE",
        )


def _extract(arguments: argparse.Namespace) -> int:
    hint = "give a page that 'ariac-score report' made of a trial's result"
    try:
        stored = embedded_result(read_plain(arguments.result, _LARGEST_PAGE_BYTES).decode("utf-8"))
    except FileNotFoundError:
        raise NoResultError("no such file", file=arguments.result, hint="check the path") from None
    except (OSError, UnicodeDecodeError) as cause:
        reason = getattr(cause, "strerror", None) or "it is not text"
        raise ResultError(f"cannot be read: {reason}", file=arguments.result, hint=hint) from None
    if stored is None:
        raise ResultError("there is no result in it", file=arguments.result, hint=hint)
    write(stored, arguments.output)
    return 0


_WRITERS: Mapping[str, Callable[[argparse.Namespace], int]] = {
    "ariac-score/result": _trial,
    "ariac-score/ranking": site_of_ranking,
}
"""What is made of each kind of file."""
