"""`ariac-score score PATH --rules NAME`: score a trial."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ariac_score.result import Result

EXIT_UNDECIDED = 6


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "score",
        help="score a trial",
        description="Score a trial: a log, a rosbag2 folder, a folder with all its logs, or a bundle.yaml.",
    )
    parser.add_argument(
        "path", type=Path, metavar="PATH", help="log, bag folder, bundle folder or bundle.yaml"
    )
    parser.add_argument(
        "--rules", required=True, metavar="NAME", help="rule set: a name ('rules list') or a .yaml file"
    )
    parser.add_argument("--log-map", default="", metavar="NAME", help="log map instead of the rule set's own")
    parser.add_argument("--output-format", choices=("text", "json"), default="text", help="default: text")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write to FILE instead of stdout")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Score, show, and say with the exit code whether there is a score."""
    # Imported here, so that --help and --version stay quick.
    from ariac_score.cli.output import progress_bar, refuse_inputs  # noqa: PLC0415
    from ariac_score.engine import score_trial  # noqa: PLC0415

    refuse_inputs(arguments.output, arguments.path)
    with progress_bar(arguments.path) as progress:
        result = score_trial(arguments.path, arguments.rules, log_map=arguments.log_map, progress=progress)
    return show(result, arguments)


def show(result: Result, arguments: argparse.Namespace) -> int:
    """Print or write a result as the arguments ask, and say what withholds a score."""
    from ariac_score.cli.output import write  # noqa: PLC0415  # keeps --help quick
    from ariac_score.report.style import Style, plain, style_for  # noqa: PLC0415
    from ariac_score.report.text import score_text  # noqa: PLC0415
    from ariac_score.result_json import as_json  # noqa: PLC0415

    if arguments.output_format == "json":
        write(as_json(result), arguments.output)
    else:
        style = Style() if arguments.output else style_for(sys.stdout)
        write(score_text(result, style), arguments.output)
    if result.score is None:
        for assumption in result.assumptions:
            if assumption.policy == "withhold":
                print(f"undecided: {assumption.finding}: {plain(assumption.message)}", file=sys.stderr)
        return EXIT_UNDECIDED
    return 0
