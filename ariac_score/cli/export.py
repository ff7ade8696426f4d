"""`ariac-score export RESULT|BATCH`: a stored result, or a table of a batch, for other programs."""

from __future__ import annotations

import argparse
from typing import Any

from ariac_score.batch.bucket import fetched_batch
from ariac_score.batch.export import TABLES, table_csv, write_parquet, write_partitions
from ariac_score.cli.notes import counted
from ariac_score.cli.outcome import add_output, show
from ariac_score.cli.stored import result_given
from ariac_score.errors import UsageError
from ariac_score.terminal.output import refuse_inputs, write
from ariac_score.terminal.style import plain


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "export",
        description="Show a stored result in another format, without its log; or write a table of a batch "
        "as CSV or Parquet.",
    )
    parser.add_argument(
        "result",
        metavar="RESULT|BATCH",
        help="JSON written by 'score -o FILE.json'; or the folder of a batch, also by URI: s3://, gs://",
    )
    parser.add_argument(
        "--table", choices=TABLES, default="runs", help="which table of a batch; default: runs"
    )
    parser.add_argument(
        "--by",
        choices=("team", "trial"),
        help="write the table of a batch as Parquet into a folder (-o DIR), with a file for each of these",
    )
    add_output(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Load and show; the same output and exit codes as `score`."""
    with fetched_batch(arguments.result) as here:
        arguments.result = here
        return _run(arguments)


def _run(arguments: argparse.Namespace) -> int:
    refuse_inputs(arguments.output, arguments.result)
    if arguments.by is not None and not arguments.result.is_dir():
        raise UsageError("--by is for the tables of a batch", hint="name the folder of a batch")
    if arguments.result.is_dir():
        return _table(arguments)
    return show(result_given(arguments.result, "export"), arguments)


def _table(arguments: argparse.Namespace) -> int:
    """A table of a batch: Parquet if the name of the file ends so, else CSV."""
    if arguments.output_format not in ("text", "csv"):
        raise UsageError(
            f"a batch cannot be written as {arguments.output_format}",
            hint="give --output-format csv, or -o FILE.parquet",
        )
    if arguments.by is not None:
        if arguments.output is None:
            raise UsageError("--by writes a folder, and none is named", hint="give -o DIR")
        count = write_partitions(arguments.result, arguments.table, arguments.by, arguments.output)
        print(f"wrote {counted(count, 'file')} in {plain(str(arguments.output))}")
        return 0
    if arguments.output is not None and arguments.output.suffix == ".parquet":
        write_parquet(arguments.result, arguments.table, arguments.output)
    else:
        write(table_csv(arguments.result, arguments.table), arguments.output)
    return 0
