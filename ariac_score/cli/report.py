"""`ariac-score report RESULT -o trial.html`: a result as a page to look at, print and share."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ariac_score.cli.site import add_arguments as add_site_arguments
from ariac_score.cli.site import (
    is_competition,
    refuse_site_arguments,
    site_of_competition,
    site_of_ranking,
)
from ariac_score.errors import ResultError
from ariac_score.report.html.trial import embedded_result, trial_page
from ariac_score.results.result_file import as_json, load_result
from ariac_score.terminal.output import refuse_inputs, write


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
    parser.add_argument("-o", "--output", type=Path, metavar="OUT", help="write to OUT instead of stdout")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Make the page or site for this kind of file."""
    refuse_inputs(arguments.output, arguments.result)
    if arguments.extract:
        return _extract(arguments)
    if is_competition(arguments.result):
        return site_of_competition(arguments)
    return _WRITERS.get(_kind(arguments.result), _trial)(arguments)


def _kind(file: Path) -> str:
    """The kind of a file by its `schema`, such as `ariac-score/result`; empty without one."""
    try:
        stored = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return ""  # reading it as a result reports what is wrong
    schema = stored.get("schema") if isinstance(stored, dict) else None
    return schema.rpartition("/")[0] if isinstance(schema, str) else ""


def _trial(arguments: argparse.Namespace) -> int:
    refuse_site_arguments(arguments)
    result = load_result(arguments.result)
    write(trial_page(result, as_json(result)), arguments.output)
    return 0


def _extract(arguments: argparse.Namespace) -> int:
    hint = "give a page that 'ariac-score report' made of a trial's result"
    try:
        stored = embedded_result(arguments.result.read_text(encoding="utf-8"))
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
