"""Reading the SQLite database of 2025: runs, penalties and accepted submissions.

The file may come from a stranger. It is opened for reading only and as immutable, so
that no other file is opened or changed; only plain tables are read, column by
column, and any program in its schema (views, virtual tables, generated columns,
functions) is refused or never run. The score itself is not stored.

Source: ARIAC notes on log formats, section 10; `ariac_db/schema/ariac.sql`.
"""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ariac_score import (
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    ORDER_ANNOUNCED,
    Clock,
    Event,
    LogDescription,
    LogError,
    NothingToScoreError,
    OfficialOrder,
    OfficialResult,
    ReaderFacts,
    TeamSetup,
    Trial,
    TrialBuilder,
    Wanted,
)
from ariac_score_ariac.work import KitSubmission, SensorBill

__all__ = [
    "ORDER_TYPES",
    "PENALTY_TYPES",
    "AriacDatabaseReader",
    "DatabaseRun",
    "read_run",
    "run_ids",
    "run_owners",
]

CLOCK = Clock("competition time", detail="simulated seconds since the start")
FORMAT = "ARIAC database (2025)"
MAX_ROWS = 100_000
MAX_ORDERS = 1000
"""Orders of one kind that a trial may ask for."""
MAX_STEPS = 50_000_000
"""Steps of SQLite's machine, so that no query runs for ever."""

PENALTY_TYPES: Mapping[int, str] = MappingProxyType(
    {
        0: "cell_in_inspection_bin",
        1: "cell_in_conveyor_bin",
        2: "object_on_invalid_surface",
        3: "agv_collision",
        4: "robot_collision",
    }
)
"""Event kinds of the penalties, by their number in the database."""

ORDER_TYPES: Mapping[int, str] = MappingProxyType({1: "kit", 2: "module", 3: "high_priority", -1: "unknown"})
"""Kinds of orders, by their number in the database."""

_ORDERED: Mapping[str, str] = MappingProxyType(
    {"kit": "num_kits", "module": "num_modules", "high_priority": "num_high_priority"}
)
"""Where a trial says how many orders of a kind there are."""

_TABLES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "Competitor": ("id", "name"),
        "Trial": ("id", "trial_id", "time_limit", "num_kits", "num_modules", "num_high_priority"),
        "Run": (
            "id",
            "trial_id",
            "competitor_id",
            "completed",
            "aborted",
            "sensor_cost",
            "duration",
            "total_cells",
            "defective_cells",
            "avg_report_time",
            "num_reports_submitted",
            "num_correct_reports",
            "num_correct_report_classifications",
        ),
        "Penalty": ("id", "run_id", "type", "description", "time"),
        "OrderSubmission": ("id", "run_id", "submission_time", "announcement_time", "order_type"),
    }
)
_MAGIC = b"SQLite format 3\0"
_HEADER_BYTES = 100
_SNIFFED_BYTES = 1_000_000
_SHOWN = 100
"""Runs that a description lists one by one."""
_TRIAL_FACTS = ("time_limit", *_ORDERED.values())
_RUN_FACTS = _TABLES["Run"][5:]
_TIMES = ("time_limit", "duration", "avg_report_time")
_DAMAGED = "copy the database again while no simulator uses it"


@dataclass(frozen=True)
class DatabaseRun:
    """One run as stored.

    Attributes:
        id: Its number in the database.
        trial: Name of its trial.
        competitor: Name of the team.
        completed: Whether it ran to its end.
        aborted: Whether it ended before all orders were in.
        facts: Numbers of run and trial by column, such as `duration` and `num_kits`; times in s.
        penalties: Event kind, time in s and description of each, in order of id.
        submissions: Kind of order, announcement and submission in s of each, in order of id.
    """

    id: int
    trial: str
    competitor: str
    completed: bool
    aborted: bool
    facts: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    penalties: tuple[tuple[str, float, str], ...] = ()
    submissions: tuple[tuple[str, float, float], ...] = ()


class AriacDatabaseReader:
    """Reads the run of a database that holds one.

    Reads:
        The numbers of the run and its trial, penalties, and the submissions that were
        accepted. Of several runs one is chosen by its number.
    Refuses:
        A file that is damaged or no plain database, a table without its columns, no run at
        all, and several of which none was chosen.
    Source:
        ARIAC notes on log formats, section 10; `ariac_db/schema/ariac.sql`.
    """

    facts = ReaderFacts(
        role="official", a_file="an official result", formats="the database of ARIAC 2025", holds_runs=True
    )

    def can_read(self, path: Path) -> bool:
        """Whether it is an SQLite file with the tables of 2025, whole or not."""
        try:
            if not path.is_file():
                return False
            with path.open("rb") as file:
                head = file.read(_SNIFFED_BYTES)
        except OSError:
            return False
        return head.startswith(_MAGIC) and all(name in head for name in (b"OrderSubmission", b"Competitor"))

    def runs(self, path: Path) -> tuple[tuple[int, str, str], ...]:
        """Number, team and trial of every run; see `run_owners`."""
        return run_owners(path)

    def describe(self, path: Path) -> LogDescription:
        """How many runs it holds; of one run its numbers, of several what each is."""
        try:
            ids = run_ids(path)
            facts: dict[str, int | float | str] = {"runs": len(ids)}
            if len(ids) > 1:
                facts |= {f"run {run_id}": _in_words(path, run_id) for run_id in ids[:_SHOWN]}
            duration_s = 0.0
            if len(ids) == 1:
                run = read_run(path, ids[0])
                duration_s = run.facts["duration"]
                facts |= {"trial": run.trial, "team": run.competitor, "penalties": len(run.penalties)}
                facts |= {"submissions": len(run.submissions), "sensor_cost": run.facts["sensor_cost"]}
        except LogError as error:
            return LogDescription(format=FORMAT, clock=str(CLOCK), damage=str(error))
        return LogDescription(format=FORMAT, clock=str(CLOCK), facts=facts, duration_s=duration_s)

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """Orders, penalties, start and end of the wanted run or the only one, and its numbers as facts.

        Raises:
            NothingToScoreError: There is no run in it, or not the wanted one.
            LogError: It holds several and none is wanted, is damaged, or has an unknown type of
                penalty or order.
        """
        ids = run_ids(path)
        if not ids:
            raise NothingToScoreError("the database holds no run", file=path, hint="was the trial finished?")
        if len(ids) > 1 and wanted.run is None:
            raise LogError(
                f"the database holds {len(ids)} runs, and one trial is one run",
                file=path,
                hint=f"name one, such as '{path.name}#run={ids[0]}'; 'info' lists them",
            )
        run = read_run(path, ids[0] if wanted.run is None else wanted.run)
        wanted.progress(1.0)
        return _trial(run, path)


def _trial(run: DatabaseRun, path: Path) -> Trial:
    builder = TrialBuilder(run.trial or path.stem, file=path, clock=CLOCK)
    duration_s = run.facts["duration"]
    builder.add(Event(0.0, COMPETITION_STARTED))
    builder.add(Event(duration_s, COMPETITION_ENDED))
    # Every accepted submission and every penalty is a row: what has none did not happen.
    builder.witnessed |= {"submissions", *PENALTY_TYPES.values()}
    for number, (kind, t_s, description) in enumerate(run.penalties, start=1):
        # Numbered subjects: each penalty is one finding, also several of one kind and time. The organisers'
        # program counts every row, so one that is stamped after the end is one at the end.
        builder.add(Event(min(max(t_s, 0.0), duration_s), kind, f"penalty_{number}", description))
    orders: list[OfficialOrder] = []
    for kind, announced_s, submitted_s in run.submissions:
        # The database names no orders: they are numbered within their kind.
        order_id = f"{kind}_{1 + sum(1 for order in orders if order.kind == kind)}"
        orders.append(
            OfficialOrder(
                order_id,
                kind,
                submitted=True,
                priority=kind == "high_priority",
                announced_s=announced_s,
                submitted_s=submitted_s,
            )
        )
        builder.add(Event(announced_s, ORDER_ANNOUNCED, order_id))
        builder.add(KitSubmission(order_id, submitted_s))
    orders += _never_submitted(run, orders)
    builder.team = TeamSetup(run.competitor)
    builder.add(SensorBill(run.facts["sensor_cost"]))
    builder.official = OfficialResult(
        source=path.name,
        total=None,
        process_time_s=duration_s,
        outcome="aborted" if run.aborted else "",
        summaries=tuple(orders),
        items=MappingProxyType({name: repr(value) for name, value in sorted(run.facts.items())}),
    )
    builder.facts |= _facts(run)
    return builder.build()


def _never_submitted(run: DatabaseRun, submitted: Sequence[OfficialOrder]) -> Iterator[OfficialOrder]:
    """The orders of the trial that the run has no submission of, numbered on."""
    for kind, column in _ORDERED.items():
        first = 1 + sum(1 for order in submitted if order.kind == kind)
        for number in range(first, int(run.facts[column]) + 1):
            yield OfficialOrder(f"{kind}_{number}", kind, submitted=False, priority=kind == "high_priority")


def _in_words(path: Path, run_id: int) -> str:
    """What one of several runs is, or why it cannot be read."""
    try:
        run = read_run(path, run_id)
    except LogError as error:
        return f"cannot be read: {error.cause}"
    ended = "aborted" if run.aborted else "completed" if run.completed else "not finished"
    counts = f"{len(run.submissions)} submissions, {len(run.penalties)} penalties"
    team = run.competitor or "no team"
    return f"{team}, trial {run.trial}, {ended} after {run.facts['duration']:g} s, {counts}"


def _facts(run: DatabaseRun) -> dict[str, float]:
    """The numbers of run and trial with the unit in their names; the cost is the team's."""
    facts = {f"{name}_s" if name in _TIMES else name: value for name, value in run.facts.items()}
    del facts["sensor_cost"]
    return facts | {"completed": float(run.completed), "aborted": float(run.aborted)}


def run_ids(path: Path) -> tuple[int, ...]:
    """The numbers of the runs in a database, ascending.

    Raises:
        NothingToScoreError: The file is missing or empty.
        LogError: It is damaged, in use, or not the database of 2025.
    """
    with _opened(path) as database:
        return tuple(_Row(path, "Run", row).whole("id") for row in _rows(database, path, "Run"))


def run_owners(path: Path) -> tuple[tuple[int, str, str], ...]:
    """Number, team and trial of every run, ascending, whatever else is wrong with it.

    Raises:
        NothingToScoreError: The file is missing or empty.
        LogError: It is damaged, in use, not the database of 2025, or a run has no team or trial.
    """
    with _opened(path) as database:
        owners = []
        for values in _rows(database, path, "Run"):
            run = _Row(path, "Run", values)
            run_id = run.whole("id")
            trial = _only(database, path, "Trial", run.whole("trial_id"), run_id)
            competitor = _only(database, path, "Competitor", run.whole("competitor_id"), run_id)
            owners.append((run_id, competitor.text("name"), trial.text("trial_id")))
    return tuple(owners)


def read_run(path: Path, run_id: int) -> DatabaseRun:
    """One run with its trial, team, penalties and submissions.

    Mistakes of other runs do no harm to it.

    Raises:
        NothingToScoreError: The file is missing or empty, or has no such run.
        LogError: It is damaged, or the run has an unknown type of penalty or order,
            a number that is none, or a negative time.
    """
    with _opened(path) as database:
        runs = [_Row(path, "Run", row) for row in _rows(database, path, "Run", "id", run_id)]
        if not runs:
            raise NothingToScoreError(f"run {run_id} is not in the database", file=path, hint="see `info`")
        run = runs[0]
        trial = _only(database, path, "Trial", run.whole("trial_id"), run_id)
        competitor = _only(database, path, "Competitor", run.whole("competitor_id"), run_id)
        penalties = _rows(database, path, "Penalty", "run_id", run_id)
        submissions = _rows(database, path, "OrderSubmission", "run_id", run_id)
    facts = {name: trial.number(name) for name in _TRIAL_FACTS}
    facts |= {name: run.number(name) for name in _RUN_FACTS}
    for name in _ORDERED.values():
        if not (facts[name].is_integer() and 0 <= facts[name] <= MAX_ORDERS):
            raise trial.fault(name, "is no number of orders")
    if facts["duration"] < 0:
        raise run.fault("duration", "is a negative time")
    return DatabaseRun(
        id=run_id,
        trial=trial.text("trial_id"),
        competitor=competitor.text("name"),
        completed=run.number("completed") != 0,
        aborted=run.number("aborted") != 0,
        facts=MappingProxyType(facts),
        penalties=tuple(_penalty(_Row(path, "Penalty", row)) for row in penalties),
        submissions=tuple(_submission(_Row(path, "OrderSubmission", row)) for row in submissions),
    )


def _penalty(row: _Row) -> tuple[str, float, str]:
    number = row.whole("type")
    if number not in PENALTY_TYPES:
        raise row.fault("type", f"is an unknown penalty type; known are {_listed(PENALTY_TYPES)}")
    return PENALTY_TYPES[number], row.time("time"), row.text("description")


def _submission(row: _Row) -> tuple[str, float, float]:
    number = row.whole("order_type")
    if number not in ORDER_TYPES:
        raise row.fault("order_type", f"is an unknown order type; known are {_listed(ORDER_TYPES)}")
    announced_s, submitted_s = row.time("announcement_time"), row.time("submission_time")
    if submitted_s < announced_s:
        raise row.fault("submission_time", f"is before the announcement at {announced_s:g} s")
    return ORDER_TYPES[number], announced_s, submitted_s


def _listed(types: Mapping[int, str]) -> str:
    return ", ".join(f"{number} ({name})" for number, name in types.items())


class _Row:
    """Takes values out of one row, refusing those that are not what their column says."""

    def __init__(self, path: Path, table: str, values: tuple[Any, ...]) -> None:
        self.path, self.table = path, table
        self.values = dict(zip(_TABLES[table], values, strict=True))

    def fault(self, column: str, cause: str) -> LogError:
        shown = repr(self.values[column])
        shown = shown if len(shown) <= 60 else f"{shown[:57]}…"
        place = f"table {self.table}, id {self.values['id']!r}"
        hint = "the row is damaged, or written by another release"
        return LogError(f"{column} {shown} {cause}", file=self.path, place=place, hint=hint)

    def number(self, column: str) -> float:
        value = self.values[column]
        if value is None:
            return 0.0  # the schema's own default
        # SQLite stores what it is given, whatever type the column was declared with.
        if not isinstance(value, (int, float)) or not math.isfinite(value):
            raise self.fault(column, "is not a finite number")
        return float(value)

    def whole(self, column: str) -> int:
        value = self.values[column]
        if not isinstance(value, int):
            raise self.fault(column, "is not a whole number")
        return value

    def time(self, column: str) -> float:
        value = self.number(column)
        if value < 0:
            raise self.fault(column, "is a negative time")
        return value

    def text(self, column: str) -> str:
        value = self.values[column]
        if value is None:
            return ""
        if not isinstance(value, str):
            raise self.fault(column, "is not text")
        return value


def _only(database: sqlite3.Connection, path: Path, table: str, row_id: int, run_id: int) -> _Row:
    rows = _rows(database, path, table, "id", row_id)
    if len(rows) != 1:
        raise LogError(
            f"run {run_id} names {table} {row_id}, of which there are {len(rows)}", file=path, hint=_DAMAGED
        )
    return _Row(path, table, rows[0])


def _rows(
    database: sqlite3.Connection, path: Path, table: str, where: str = "", value: int = 0
) -> list[tuple[Any, ...]]:
    """The known columns of the rows of a table, in order of id; `where` is a column of it."""
    columns = ", ".join(f'"{column}"' for column in _TABLES[table])
    # The names are those of this module; the value is bound.
    condition = f' WHERE "{where}" = ?' if where else ""
    query = f'SELECT {columns} FROM "{table}"{condition} ORDER BY "id" LIMIT {MAX_ROWS + 1}'  # noqa: S608
    # One more than the limit is fetched, so that too many are noticed and never counted.
    rows = database.execute(query, (value,) if where else ()).fetchall()
    if len(rows) > MAX_ROWS:
        raise LogError(f"table {table} has more than {MAX_ROWS:,} rows", file=path, hint=_DAMAGED)
    return rows


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    """The database, checked to be what it should be and unable to run any program of its own."""
    _check_files(path)
    address = f"{path.resolve().as_uri()}?mode=ro&immutable=1"
    try:
        database = sqlite3.connect(address, uri=True)
        try:
            database.text_factory = lambda raw: raw.decode("utf-8", "replace")
            database.execute("PRAGMA trusted_schema = OFF")
            database.execute("PRAGMA cell_size_check = ON")
            # Any value but 0 stops the query.
            database.set_progress_handler(lambda: 1, MAX_STEPS)
            _check_schema(database, path)
            _check_pages(database, path)
            # Last, for it forbids the pragmas above.
            database.set_authorizer(_only_reading)
            yield database
        finally:
            database.close()
    except (sqlite3.Error, OverflowError, UnicodeDecodeError) as cause:
        # Python decodes SQLite's own words, which may quote the damaged bytes.
        raise LogError(f"the database cannot be read: {cause}", file=path, hint=_DAMAGED) from cause


def _check_files(path: Path) -> None:
    try:
        size = path.stat().st_size
        if not size:
            raise NothingToScoreError("the file is empty", file=path, hint="was the trial finished?")
        with path.open("rb") as file:
            header = file.read(_HEADER_BYTES)
        if size < _whole_size(header):
            cause = f"the database is cut off: it has {size:,} bytes of {_whole_size(header):,}"
            raise LogError(cause, file=path, hint=_DAMAGED)
        for ending in ("-wal", "-journal"):
            # An immutable database is read without its journal, and so without these changes.
            journal = path.with_name(path.name + ending)
            if journal.is_file() and journal.stat().st_size:
                raise LogError(
                    f"{journal.name!r} next to it holds changes that are not in the database yet",
                    file=path,
                    hint="close the simulator, open the database once with sqlite3, and copy it again",
                )
    except FileNotFoundError:
        raise NothingToScoreError("no such file", file=path, hint="check the path") from None
    except OSError as cause:
        raise LogError(
            f"cannot be read: {cause.strerror}", file=path, hint="check the permissions"
        ) from cause


def _whole_size(header: bytes) -> int:
    """The size that an SQLite file says it has: SQLite itself reads less without a word.

    Source: SQLite database file format, section 1.3: page size at 16, size in pages at 28.
    """
    if len(header) < _HEADER_BYTES or not header.startswith(_MAGIC):
        return _HEADER_BYTES
    page = int.from_bytes(header[16:18], "big")
    return (65_536 if page == 1 else page) * int.from_bytes(header[28:32], "big")


def _check_schema(database: sqlite3.Connection, path: Path) -> None:
    """That every table is a plain one with its columns; a view of that name could be a program."""
    master = database.execute("SELECT type, name, sql FROM sqlite_master LIMIT 1000").fetchall()
    for table, columns in _TABLES.items():
        found = [(kind, sql or "") for kind, name, sql in master if name == table]
        if not found:
            raise LogError(
                f"there is no table {table!r}: this is not the database of 2025", file=path, hint=_DAMAGED
            )
        kind, sql = found[0]
        words = " ".join(str(sql).split()).upper()
        if kind != "table" or len(found) > 1 or not words.startswith("CREATE TABLE"):
            raise LogError(f"{table!r} is not a plain table, so it is not read", file=path, hint=_DAMAGED)
        # xinfo, not info: it lists generated columns, too, and says which they are.
        listed = database.execute(f'PRAGMA table_xinfo("{table}")').fetchall()
        hidden = {row[1]: row[6] for row in listed}
        for column in columns:
            if column not in hidden:
                raise LogError(f"table {table!r} has no column {column!r}", file=path, hint=_DAMAGED)
            if hidden[column]:
                raise LogError(
                    f"column {column!r} of table {table!r} is computed, so it is not read",
                    file=path,
                    hint=_DAMAGED,
                )


def _check_pages(database: sqlite3.Connection, path: Path) -> None:
    # Not `integrity_check`: it evaluates the expressions of indexes, which are a stranger's program.
    (verdict,) = database.execute("PRAGMA quick_check(1)").fetchone()
    if verdict != "ok":
        raise LogError(f"the database is damaged: {str(verdict)[:200]}", file=path, hint=_DAMAGED)


def _only_reading(
    action: int, first: str | None, _second: str | None, _database: str | None, _inside: str | None
) -> int:
    """Let SQLite read our tables and do nothing else."""
    if action == sqlite3.SQLITE_SELECT or (action == sqlite3.SQLITE_READ and first in _TABLES):
        return sqlite3.SQLITE_OK
    return sqlite3.SQLITE_DENY
