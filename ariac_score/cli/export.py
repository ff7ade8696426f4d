"""`ariac-score export RESULT --output-format FORMAT`: a stored result as what other programs read."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def register(commands: Any) -> None:
    """Add the command."""
    from ariac_score.cli.outcome import add_output  # noqa: PLC0415  # commands are registered one by one

    parser = commands.add_parser(
        "export",
        help="a stored result as JUnit, SARIF, GitHub annotations, Markdown, CSV or JSON Lines",
        description="Show a stored result in another format, without its log.",
    )
    parser.add_argument(
        "result", type=Path, metavar="RESULT", help="JSON written by 'score --output-format json'"
    )
    add_output(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Load and show; the same output and exit codes as `score`."""
    # Imported here, so that --help and --version stay quick.
    from ariac_score.cli.outcome import show  # noqa: PLC0415
    from ariac_score.cli.output import refuse_inputs  # noqa: PLC0415
    from ariac_score.result_json import load_result  # noqa: PLC0415

    refuse_inputs(arguments.output, arguments.result)
    return show(load_result(arguments.result), arguments)
