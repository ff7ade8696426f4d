"""The tables of a batch for spreadsheets and data frames."""

from __future__ import annotations

import csv
import io
import sqlite3
from collections.abc import Iterable, Iterator
from itertools import groupby, islice
from operator import itemgetter
from pathlib import Path
from typing import Any
from urllib.parse import quote

from ariac_score.batch.description import refuse_other_version
from ariac_score.batch.index import AGAIN, INDEX, check_index, checked_rows
from ariac_score.errors import UsageError

__all__ = ["COLUMNS", "TABLES", "table_csv", "write_parquet", "write_partitions"]

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


def _rows(root: Path, table: str, *, first: str = "") -> Iterator[tuple[Any, ...]]:
    """The rows of a table, sorted by its key, or by a column of it before the others.

    Raises:
        UsageError: The folder holds no finished batch.
    """
    file = root / INDEX
    if file.exists() and not file.is_file():  # a pipe would be waited for
        raise UsageError("it is no plain file", file=file, hint=AGAIN)
    columns = ", ".join(COLUMNS[table])
    try:
        connection = sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro", uri=True)
        try:
            named = ", name" if table == "checks" else ""
            order = f" ORDER BY {first}, team, trial, run{named}" if first else ""
            select = f"SELECT {columns} FROM {table}{order}"  # noqa: S608  # names of our own
            yield from connection.execute(select)
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
    if (root / INDEX).is_file():
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
    schema = _schema(table)
    _check(root)
    _write(file, _rows(root, table), schema)


def write_partitions(root: Path, table: str, by: str, folder: Path) -> int:
    """A table as a folder of Parquet files, one for each value of a column: `team=a/runs.parquet`.

    Readers that know such folders (DuckDB, Polars, Spark, pyarrow) read the value from the name and open only
    the files that a query asks for. The same batch gives the same bytes.

    Args:
        root: Of the batch.
        table: Which table.
        by: The column, `team` or `trial`; it is in the names, and in no file.
        folder: New or empty.

    Returns:
        How many files were written.

    Raises:
        UsageError: pyarrow is not installed, the folder is in use, or `root` holds no finished batch.
        BatchError: Its tables contradict its documents.
    """
    schema = _schema(table, without=by)
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError("it is not an empty folder", file=folder, hint="name a new one")
    _check(root)
    place = COLUMNS[table].index(by)
    count = 0
    for value, rows in groupby(_rows(root, table, first=by), key=itemgetter(place)):
        part = folder / f"{by}={quote(str(value), safe='') or _NO_VALUE}"
        part.mkdir(parents=True)
        _write(part / f"{table}.parquet", ((*row[:place], *row[place + 1 :]) for row in rows), schema)
        count += 1
    return count


_ROWS_AT_A_TIME = 10_000
_NO_VALUE = "__HIVE_DEFAULT_PARTITION__"
"""What stands for an empty value in the name of a folder, by the convention of Hive."""


def _schema(table: str, *, without: str = "") -> Any:
    """The columns of a table with their types.

    Raises:
        UsageError: pyarrow is not installed.
    """
    try:
        import pyarrow as pa  # noqa: PLC0415  # an extra
    except ImportError as cause:
        raise UsageError(
            "writing Parquet needs pyarrow", hint="pip install 'ariac-score[parquet]', or export CSV"
        ) from cause
    numbers = ("score", "task", "score_least", "score_most", "worst_robustness")
    kinds = {"run": pa.int64(), **dict.fromkeys(numbers, pa.float64())}
    counts = dict.fromkeys(("satisfied", "violated", "inconclusive", "not_applicable"), pa.int64())
    named = [name for name in COLUMNS[table] if name != without]
    return pa.schema([(name, {**kinds, **counts}.get(name, pa.string())) for name in named])


def _write(file: Path, rows: Iterable[tuple[Any, ...]], schema: Any) -> None:
    import pyarrow as pa  # noqa: PLC0415  # an extra, which is here: it has made the schema
    from pyarrow import parquet  # noqa: PLC0415

    left = iter(rows)
    with parquet.ParquetWriter(file, schema) as writer:
        while held := list(islice(left, _ROWS_AT_A_TIME)):
            columns = [list(column) for column in zip(*held, strict=True)]
            writer.write_table(pa.table(columns, schema=schema))
