"""The tables of a batch for spreadsheets and data frames."""

from __future__ import annotations

import csv
import io
import sqlite3
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ariac_score.batch.description import refuse_other_version
from ariac_score.batch.index import AGAIN, INDEX, RUNS, check_index, checked_rows
from ariac_score.errors import UsageError

__all__ = ["COLUMNS", "TABLES", "table_csv", "write_parquet"]

COLUMNS = {
    "runs": (
        "team",
        "trial",
        "run",
        "outcome",
        "reason",
        "score",
        "task",
        "object",
        "sha256",
        "score_least",
        "score_most",
    ),
    "checks": (
        "team",
        "trial",
        "run",
        "name",
        "satisfied",
        "violated",
        "inconclusive",
        "not_applicable",
        "worst_robustness",
    ),
}
"""Columns by table: `runs` has a row for each run, `checks` one for each check of each result."""
TABLES = tuple(COLUMNS)

_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""With what a cell begins that a spreadsheet runs as a formula (OWASP, "CSV Injection")."""


def _rows(root: Path, table: str) -> Iterator[tuple[Any, ...]]:
    """The rows of a table, sorted by its key.

    Raises:
        UsageError: The folder holds no finished batch.
    """
    file = root / INDEX
    columns = ", ".join(COLUMNS[table])
    try:
        connection = sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)
        try:
            yield from connection.execute(f"SELECT {columns} FROM {table}")  # noqa: S608  # names of our own
        finally:
            connection.close()
    except sqlite3.Error as cause:
        raise UsageError(
            f"cannot be read: {cause}",
            file=file,
            hint=AGAIN,
        ) from cause


def _check(root: Path) -> None:
    """Compare the tables with each other and with the documents, before anything is written.

    Raises:
        BatchError: They contradict each other.
        UsageError: Another version made the batch.
    """
    refuse_other_version(root)
    if (root / INDEX).is_file() and (root / RUNS).is_file():
        check_index(root, (row for row, _ in checked_rows(root)))


def table_csv(root: Path, table: str) -> str:
    """A table as CSV; text that a spreadsheet would take for a formula has an apostrophe before it.

    Raises:
        UsageError: The folder holds no finished batch.
        BatchError: Its tables contradict its documents.
    """
    _check(root)
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(COLUMNS[table])
    for row in _rows(root, table):
        writer.writerow([_safe(value) for value in row])
    return out.getvalue()


def _safe(value: Any) -> Any:
    if isinstance(value, str):
        return f"'{value}" if value.startswith(_FORMULA) else value
    return "" if value is None else value


def write_parquet(root: Path, table: str, file: Path) -> None:
    """A table as Parquet, in batches, so that memory does not grow with it.

    Raises:
        UsageError: pyarrow is not installed, or the folder holds no finished batch.
        BatchError: Its tables contradict its documents.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415  # an extra
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError as cause:
        raise UsageError(
            "writing Parquet needs pyarrow", hint="pip install 'ariac-score[parquet]', or export CSV"
        ) from cause
    _check(root)
    numbers = ("score", "task", "score_least", "score_most", "worst_robustness")
    kinds = {"run": pa.int64(), **dict.fromkeys(numbers, pa.float64())}
    counts = dict.fromkeys(("satisfied", "violated", "inconclusive", "not_applicable"), pa.int64())
    fields = [(name, {**kinds, **counts}.get(name, pa.string())) for name in COLUMNS[table]]
    schema = pa.schema(fields)
    with parquet.ParquetWriter(file, schema) as writer:
        held: list[tuple[Any, ...]] = []
        for row in _rows(root, table):
            held.append(row)
            if len(held) == _ROWS_AT_A_TIME:
                writer.write_table(_as_table(pa, held, schema))
                held.clear()
        if held:
            writer.write_table(_as_table(pa, held, schema))


_ROWS_AT_A_TIME = 10_000


def _as_table(pa: Any, rows: list[tuple[Any, ...]], schema: Any) -> Any:
    columns = zip(*rows, strict=True)
    return pa.table([list(column) for column in columns], schema=schema)
