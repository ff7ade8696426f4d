"""`ariac-score merge OUT PART…`: join the shards of a batch."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ariac_score.batch.bucket import Bucket, brought, fetched_batches, mirror_of
from ariac_score.batch.merge import merge_batches
from ariac_score.batch.remote import is_uri, shown
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
    parser.add_argument(
        "output",
        metavar="OUT",
        help="folder of the joined batch; also by URI of an object storage: s3://, gs://",
    )
    parser.add_argument("parts", nargs="+", metavar="PART", help="folder of a shard; also by URI")
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
    if _named(arguments.output) in map(_named, arguments.parts):
        raise UsageError(
            "a part cannot be joined into itself",
            file=shown(arguments.output),
            hint="give a new folder as the first argument",
        )
    there = is_uri(arguments.output)
    store = Store(mirror_of(arguments.output) if there else Path(arguments.output))
    bucket = Bucket(arguments.output, store.root) if there else None
    with store.working() as work, brought(bucket, work), fetched_batches(arguments.parts) as parts:
        report = merge_batches(
            parts,
            store,
            work,
            mixed_code=arguments.mixed_code,
            public_key=str(arguments.public_key),
        )
    out = plain(shown(arguments.output))
    print(f"{out}: {counted(report.runs, 'run')}: {outcomes_text(report.outcomes)}")
    return EXIT_UNSETTLED if report.unsettled else 0


def _named(given: str) -> str | Path:
    """What two names of one folder have in common."""
    return given.rstrip("/") if is_uri(given) else Path(given).resolve()
