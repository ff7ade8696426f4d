"""`ariac-score adjust RESULT [ADJUSTMENTS]`: decisions of stewards on top of an automatic result."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ariac_score.cli.notes import note
from ariac_score.cli.outcome import add_output, show
from ariac_score.cli.stored import result_given
from ariac_score.results.adjustments import adjust, adjustments_template, load_adjustments
from ariac_score.results.result_file import measured_sha256
from ariac_score.terminal.output import refuse_inputs, write


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "adjust",
        description="Apply an adjustments.yaml to a stored result. The automatic result stays in it "
        "unchanged, and both are shown. Without ADJUSTMENTS, print a file to start from.",
    )
    parser.add_argument("result", type=Path, metavar="RESULT", help="JSON written by 'score -o FILE.json'")
    parser.add_argument(
        "adjustments", nargs="?", type=Path, metavar="ADJUSTMENTS", help="adjustments.yaml of the stewards"
    )
    add_output(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Load both, apply, show; the same output and exit codes as `score`."""
    refuse_inputs(arguments.output, arguments.result)
    stored = result_given(arguments.result, "adjust")
    measured = measured_sha256(stored)
    if arguments.adjustments is None:
        write(adjustments_template(stored, measured=measured), arguments.output)
        return 0
    refuse_inputs(arguments.output, arguments.adjustments)
    adjusted, others = adjust(stored, load_adjustments(arguments.adjustments), measured=measured)
    if others:
        are = "adjustment of the file is" if others == 1 else "adjustments of the file are"
        note(arguments, f"{others} {are} about other results")
    return show(adjusted, arguments)
