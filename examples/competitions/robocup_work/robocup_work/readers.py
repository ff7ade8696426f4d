"""The two files of a run: the task that was set, and the sheet of its referee."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ariac_score import (
    Body,
    Clock,
    Event,
    Item,
    LogDescription,
    LogError,
    NothingToScoreError,
    ReaderFacts,
    ScoreError,
    Span,
    TopicDescription,
    Trial,
    Wanted,
    did_you_mean,
    load_yaml,
)
from robocup_work.run import KINDS, OF_OBJECTS, OF_PLACES, ROBOT

__all__ = ["RefereeReader", "TaskReader"]

_HEAD = ["time_s", "event", "object", "place", "remark"]
_MAX_ROWS = 10_000
_SHEET = "complete the sheet; a score must not rest on part of it"


class TaskReader:
    """Reads `task.yaml`: which objects go from where to where, in how much time.

    Reads:
        The test, its time limit, the objects that were used, and the tasks with their objects.
    Refuses:
        A key that is missing or unknown, and two things of one name.
    Source:
        Rulebook 2024, Basic Manipulation Test; the form is that of this distribution.
    """

    facts = ReaderFacts("task", "a task of RoboCup@Work", "tasks of RoboCup@Work (task.yaml)")

    def can_read(self, path: Path) -> bool:
        """Whether it is called `task.yaml`."""
        return path.is_file() and path.name == "task.yaml"

    def describe(self, path: Path) -> LogDescription:
        """How much there is to do."""
        try:
            trial = self.read(path, None)
        except ScoreError as error:
            return LogDescription("task of RoboCup@Work", damage=str(error))
        objects = sum(len(task.items) for task in trial.work)
        return LogDescription("task of RoboCup@Work", facts={"tasks": len(trial.work), "objects": objects})

    def read(self, path: Path, wanted: Wanted | None) -> Trial:
        """The tasks as work items, and what is stated of the run as facts."""
        data = load_yaml(path).data
        _keys(path, "$", data, {"test": str, "objects": str, "time_limit_s": (int, float), "tasks": list})
        if data["objects"] not in ("real", "april_tags"):
            raise LogError(
                f"'objects' is {data['objects']!r}", file=path, place="$.objects", hint="real or april_tags"
            )
        if not 0 < data["time_limit_s"] <= 86_400:
            raise LogError(
                f"'time_limit_s' is {data['time_limit_s']!r}",
                file=path,
                place="$.time_limit_s",
                hint="give the time for the run in s",
            )
        tasks = tuple(_task(path, f"$.tasks[{i}]", task) for i, task in enumerate(data["tasks"]))
        _no_twice(path, [task.id for task in tasks])
        _no_twice(path, [item.id for task in tasks for item in task.items])
        facts = {
            "test": data["test"],
            "objects": data["objects"],
            "time_limit_s": float(data["time_limit_s"]),
        }
        return Trial(id=path.parent.name, work=tasks, facts=facts)


def _task(path: Path, place: str, task: Any) -> Item:
    _keys(path, place, task, {"id": str, "source": str, "target": str, "objects": list})
    _check_name(path, place, task["id"])
    where = {"source": task["source"], "target": task["target"]}
    inner = []
    for i, thing in enumerate(task["objects"]):
        _keys(path, f"{place}.objects[{i}]", thing, {"id": str, "type": str})
        _check_name(path, f"{place}.objects[{i}]", thing["id"])
        inner.append(Item(thing["id"], "object", {"type": thing["type"], **where}))
    return Item(task["id"], "task", where, tuple(inner))


def _keys(path: Path, place: str, data: object, kinds: Mapping[str, Any]) -> None:
    """Refuse a mapping that has other keys than these, or values of another kind."""
    if not isinstance(data, dict):
        raise LogError("it is no mapping", file=path, place=place, hint=f"keys: {', '.join(kinds)}")
    unknown = [key for key in data if key not in kinds]
    if unknown:
        raise LogError(
            f"unknown key {unknown[0]!r}",
            file=path,
            place=place,
            hint=did_you_mean(str(unknown[0]), kinds, what="keys"),
        )
    for key, kind in kinds.items():
        value = data.get(key)
        if not isinstance(value, kind) or isinstance(value, bool) or value in ("", []):
            fault = f"{key!r} is missing" if key not in data else f"{key!r} is {str(value)[:40]!r}"
            raise LogError(fault, file=path, place=place, hint="see recording/bmt_1/task.yaml for an example")


def _check_name(path: Path, place: str, name: str) -> None:
    if "/" in name:  # it separates the names in the path of an item
        raise LogError(
            f"the id {name[:40]!r} has a slash", file=path, place=place, hint="give it another name"
        )


def _no_twice(path: Path, names: list[str]) -> None:
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise LogError(f"{twice[0]!r} is there twice", file=path, hint="give each its own name")


class RefereeReader:
    """Reads `referee.csv`: what the referee wrote down, one event in each row.

    Reads:
        Time since the start of the run in s, what happened, to which object, at which place.
    Refuses:
        An event of an unknown kind, times that run backwards, a sheet without start or end.
    Source:
        Rulebook 2024, Scoring; the form is that of this distribution.
    """

    facts = ReaderFacts(a_file="a referee's sheet", formats="referees' sheets of RoboCup@Work (referee.csv)")

    def can_read(self, path: Path) -> bool:
        """Whether the first line is the head of a sheet."""
        try:
            with path.open("rb") as stream:
                return stream.read(200).startswith(",".join(_HEAD).encode())
        except OSError:
            return False

    def describe(self, path: Path) -> LogDescription:
        """How often what happened."""
        try:
            events = list(_events(path))
        except ScoreError as error:
            return LogDescription("referee's sheet", damage=str(error))
        times = {kind: [e.t_s for e in events if e.kind == kind] for kind in KINDS}
        topics = tuple(
            TopicDescription(k, "event", len(t), t[0], t[-1]) for k, t in sorted(times.items()) if t
        )
        return LogDescription("referee's sheet", topics, clock="referee's watch", duration_s=events[-1].t_s)

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The events; a referee sees everything that the sheet has a word for."""
        events = tuple(_events(path))
        return Trial(
            id=path.parent.name,
            events=tuple(sorted(set(events))),
            bodies=(Body(ROBOT, "robot"),),
            witnessed=frozenset(KINDS),
            clocks=(Clock("referee's watch"),),
            recorded=Span(events[0].t_s, events[-1].t_s),
        )


def _events(path: Path) -> Iterator[Event]:
    """The rows as events, from the start of the run to its end."""
    last: Event | None = None
    for number, row in _rows(path):
        event = _event(path, number, row)
        if (last is None) != (event.kind == KINDS[0]):
            raise _fault(path, number, f"{event.kind!r} cannot stand here", f"the first row is {KINDS[0]!r}")
        if last is not None and (event.t_s < last.t_s or last.kind == KINDS[1]):
            raise _fault(path, number, "it is out of order", "put the rows in order, up to the end")
        yield (last := event)
    if last is None:
        raise NothingToScoreError("the sheet holds no event", file=path, hint="was the run started?")
    if last.kind != KINDS[1]:
        raise LogError(f"the sheet is cut off: its last row is not {KINDS[1]!r}", file=path, hint=_SHEET)


def _rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    try:
        with path.open(encoding="utf-8", newline="") as stream:
            rows = csv.reader(stream, strict=True)
            next(rows)  # `can_read` saw the head
            for row in rows:
                if rows.line_num > _MAX_ROWS:
                    raise LogError(f"more than {_MAX_ROWS:,} rows", file=path, hint="one run in each sheet")
                if row:
                    yield rows.line_num, row
    except (UnicodeDecodeError, csv.Error) as cause:
        raise LogError(f"it is not a table: {cause}", file=path, hint=_SHEET) from cause


def _event(path: Path, number: int, row: list[str]) -> Event:
    if len(row) != len(_HEAD):
        raise _fault(path, number, f"{len(row)} columns", f"a row is {','.join(_HEAD)}")
    time, kind, thing, place, _ = (cell.strip() for cell in row)
    try:
        t_s = float(time)
    except ValueError:
        t_s = math.nan
    if not 0 <= t_s <= 86_400:  # neither is NaN
        raise _fault(path, number, f"time {time[:20]!r}", "give s since the start of the run")
    if kind not in KINDS:
        raise _fault(path, number, f"unknown event {kind[:40]!r}", did_you_mean(kind, KINDS, what="events"))
    if bool(thing) != (kind in OF_OBJECTS):
        raise _fault(
            path, number, f"{kind!r} of object {thing[:40]!r}", "name what it was done to, and nothing else"
        )
    if kind in (*OF_PLACES, "placed") and not place:
        raise _fault(path, number, f"{kind!r} without a place", "say at which service area")
    return Event(t_s, kind, thing or place, place if thing else "")


def _fault(path: Path, number: int, cause: str, hint: str) -> LogError:
    return LogError(cause, file=path, place=f"line {number}", hint=hint)
