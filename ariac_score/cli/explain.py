"""`ariac-score explain RESULT [PATH]`: follow any number back to the samples it rests on."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from ariac_score.cli.stored import result_given
from ariac_score.errors import UsageError, did_you_mean
from ariac_score.report.text import INTERVAL, explain_text, score_text
from ariac_score.terminal.style import style_for


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "explain",
        description="Show the ledger of a stored result; or, with PATH, one line, item of work, check or "
        "finding with everything that it rests on.",
    )
    parser.add_argument("result", type=Path, metavar="RESULT", help="JSON written by 'score -o FILE.json'")
    parser.add_argument(
        "path",
        nargs="?",
        default="",
        metavar="PATH",
        help="path in the ledger or a part of one, name of a check, id or subject of a finding; "
        "'interval': what is open, and when",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Load the result, which checks its sums, and print the ledger or a part of it."""
    result = result_given(arguments.result, "explain")
    style = style_for(sys.stdout)
    if result.ledger is None and not arguments.path:
        sys.stdout.write(score_text(result, style))
        return 0
    text = explain_text(result, arguments.path, style)
    if not text and arguments.path == INTERVAL and not result.measured.open:
        text = "no gap is open\n"
    if not text:
        lines = [line.path for line in result.ledger.walk()] if result.ledger else []
        known = {
            *(part for path in lines for part in path.split("/")),
            *result.measured.findings,
            *(key for one in result.measured.open for key in (*one.best, *one.worst)),
            INTERVAL,
            *result.checks,
            *(scope.path for scope in result.measured.scopes.walk() if scope.path),
        }
        raise UsageError(
            f"nothing in the result has the name {arguments.path!r}",
            file=arguments.result,
            hint=did_you_mean(arguments.path, known, what="it has"),
        )
    sys.stdout.write(text)
    return 0
