"""`ariac-score merge OUT PART…`: join the shards of a batch."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ariac_score.batch.merge import merge_batches
from ariac_score.batch.store import Store
from ariac_score.cli.batch import EXIT_UNSETTLED
from ariac_score.cli.batch_progress import outcomes_text
from ariac_score.cli.notes import counted
from ariac_score.errors import UsageError
from ariac_score.terminal.style import plain


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "merge",
        description="Join the folders that 'batch --shard' wrote. The result has the same bytes as one batch "
        "of all runs.",
    )
    parser.add_argument("output", type=Path, metavar="OUT", help="folder of the joined batch")
    parser.add_argument("parts", type=Path, nargs="+", metavar="PART", help="folder of a shard")
    parser.add_argument("--mixed-code", action="store_true", help="also join results of different code")
    parser.add_argument(
        "--public-key",
        default="",
        metavar="KEY",
        help="who must have signed the table of each part; default: whom their rules name, if anybody",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Join the parts, and print the number of runs and outcomes."""
    if arguments.output.resolve() in [part.resolve() for part in arguments.parts]:
        raise UsageError(
            "a part cannot be joined into itself",
            file=arguments.output,
            hint="give a new folder as the first argument",
        )
    store = Store(arguments.output)
    with store.working() as work:
        report = merge_batches(
            arguments.parts,
            store,
            work,
            mixed_code=arguments.mixed_code,
            public_key=str(arguments.public_key),
        )
    print(f"{plain(str(arguments.output))}: {counted(report.runs, 'run')}: {outcomes_text(report.outcomes)}")
    return EXIT_UNSETTLED if report.unsettled else 0
