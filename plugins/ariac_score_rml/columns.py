"""Event types over whole columns: one numpy expression for each type instead of one match for each event.

An event is decided here only where the interpreter is certain to decide the same. Whether it
is, depends on that event alone; where a verdict is needed on one that is not, `NotColumnarError`
is raised, and the interpreter takes the stream event by event.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ariac_score_rml.arithmetic import holds
from ariac_score_rml.guards import FLOAT_FUNCTIONS, ExprSlot, PatternSlot, Scope, Slot, Unknown, slot_of_name
from ariac_score_rml.machine import slots_of
from ariac_score_rml.matching import Declared, Matcher, alternatives, scope_of, slot_of
from ariac_score_rml.syntax import (
    Anything,
    Const,
    Data,
    ListPattern,
    Literal_,
    Name,
    Num,
    Op,
    Pattern,
    RecordPattern,
)
from ariac_score_rml.terms import Given
from ariac_score_rml.values import Bound, Json, fits, is_number

__all__ = ["Columns", "Match", "NotColumnarError", "Stream", "Topic"]

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.intp]
Rows: TypeAlias = "IntArray | slice"
_Numbers: TypeAlias = "FloatArray | float"
_Value: TypeAlias = "FloatArray | Json"
_Values: TypeAlias = "Mapping[Unknown, _Value]"


class NotColumnarError(Exception):
    """This can only be decided event by event."""


@dataclass(frozen=True)
class Topic:
    """Events of one kind: records with the same numeric fields.

    Attributes:
        name: Value of the field `topic`.
        t: Times, shape (n,), s; also the field `time`.
        fields: Values by field, each shape (n,).
    """

    name: str
    t: FloatArray
    fields: Mapping[str, FloatArray]

    def record(self) -> dict[str, Any]:
        """The fields of its events: as columns, or as a value where it is the same in all."""
        return {"time": self.t, **self.fields, "topic": self.name}


class Stream:
    """The events of all topics in order of time; at equal times in the order of the topics.

    Attributes:
        topics: The topics.
        t: Time of each event, shape (n,), s.
        topic: Which topic each event is of, shape (n,).
        row: Which sample of that topic it is, shape (n,).
    """

    def __init__(self, topics: Sequence[Topic]) -> None:
        self.topics = tuple(topics)
        if len(self.topics) == 1:
            self.t = self.topics[0].t
            self.topic = np.broadcast_to(np.intp(0), len(self.t))
            self.row = np.arange(len(self.t))
            return
        t = np.concatenate([topic.t for topic in topics]) if topics else np.zeros(0)
        of = np.repeat(np.arange(len(self.topics)), [len(topic.t) for topic in topics])
        row = np.concatenate([np.arange(len(topic.t)) for topic in topics]) if topics else np.zeros(0, int)
        order = np.argsort(t, kind="stable")
        self.t, self.topic, self.row = t[order], of[order], row[order].astype(np.intp)

    def __len__(self) -> int:
        return len(self.t)

    def event(self, i: int) -> dict[str, Json]:
        """One event as JSON."""
        topic = self.topics[int(self.topic[i])]
        row = int(self.row[i])
        return {key: _at(value, row) for key, value in topic.record().items()}

    def rows_of(self, topic: int) -> Rows:
        """The events of one topic, in the order of its samples."""
        if len(self.topics) == 1:
            return slice(None)
        return np.flatnonzero(self.topic == topic)


def _at(value: Any, row: int) -> Json:
    """The value of a field in one event."""
    if isinstance(value, np.ndarray):
        number: Json = value[row].item()
        return number
    if isinstance(value, dict):
        return {key: _at(inner, row) for key, inner in value.items()}
    return [_at(inner, row) for inner in value] if isinstance(value, list) else value


@dataclass(frozen=True)
class Match:
    """Which events are of a type, and by how much.

    Attributes:
        holds: Whether the event is of the type, shape (n,).
        margin: How far it is from not being so; negative: from being so. Infinite where
            no inequality decides.
        bound: What the inequality that decides compares with; NaN where there is none.
        field: Which field of its topic the inequality limits; -1 where none stands alone on a side.
        sure: The answer where it is the same for every event and no inequality decides it.
    """

    holds: BoolArray
    margin: FloatArray
    bound: FloatArray
    field: IntArray
    sure: bool | None = None

    @classmethod
    def of(cls, holds: BoolArray) -> Match:
        """A match that no inequality decides."""
        margin = np.where(holds, np.inf, -np.inf)
        return cls(holds, margin, np.full(len(holds), np.nan), np.full(len(holds), -1))

    @classmethod
    def alike(cls, holds: bool, count: int) -> Match:
        """A match with one answer for every event; read-only."""
        margin = np.inf if holds else -np.inf
        return cls(
            np.broadcast_to(np.bool_(holds), count),
            np.broadcast_to(np.float64(margin), count),
            np.broadcast_to(np.float64(np.nan), count),
            np.broadcast_to(np.intp(-1), count),
            sure=holds,
        )

    def __getitem__(self, rows: Rows) -> Match:
        return Match(self.holds[rows], self.margin[rows], self.bound[rows], self.field[rows], self.sure)

    def where(self, condition: Match, other: Match) -> Match:
        """This where the condition holds, the other elsewhere."""
        if condition.sure is not None:
            return self if condition.sure else other
        chosen = condition.holds
        return self._chosen(other, np.where(chosen, self.holds, other.holds), chosen)

    def __and__(self, other: Match) -> Match:
        for one, another in ((self, other), (other, self)):
            if one.sure is not None:
                return another if one.sure else one
        return self._chosen(other, self.holds & other.holds, self.margin <= other.margin)

    def __or__(self, other: Match) -> Match:
        for one, another in ((self, other), (other, self)):
            if one.sure is not None:
                return one if one.sure else another
        return self._chosen(other, self.holds | other.holds, self.margin >= other.margin)

    def __invert__(self) -> Match:
        sure = None if self.sure is None else not self.sure
        return Match(~self.holds, -self.margin, self.bound, self.field, sure)

    def _chosen(self, other: Match, holds: BoolArray, mine: BoolArray) -> Match:
        return Match(
            holds,
            np.where(mine, self.margin, other.margin),
            np.where(mine, self.bound, other.bound),
            np.where(mine, self.field, other.field),
        )


_ALL = slice(None)


class Columns:
    """The event types of a specification over a stream of events.

    Args:
        matcher: Its event types.
        stream: The events.

    Attributes:
        close: How many comparisons would come out differently without the tolerance.
    """

    def __init__(self, matcher: Matcher, stream: Stream) -> None:
        self.close = 0
        self._matcher, self._stream = matcher, stream
        self._tolerance = matcher.solver.tolerance
        self._known: dict[object, tuple[Match, BoolArray]] = {}

    def count(self, rows: Rows) -> int:
        """How many events some rows are."""
        return len(range(len(self._stream))[rows]) if isinstance(rows, slice) else len(rows)

    def match(self, name: str, given: tuple[Given, ...], rows: Rows = _ALL) -> Match:
        """Which of some events are of a type with these arguments.

        Raises:
            NotColumnarError: Only the interpreter can decide one of them.
        """
        key = (name, tuple(g.key for g in given))
        if key not in self._known:
            self._known[key] = self._match(name, given)
        found, undecided = self._known[key]
        if undecided[rows].any():
            raise NotColumnarError(name)
        return found if isinstance(rows, slice) and rows == _ALL else found[rows]

    def _match(self, name: str, given: tuple[Given, ...]) -> tuple[Match, BoolArray]:
        each = [self._of_topic(topic, name, given) for topic in self._stream.topics]
        if len(each) == 1:
            return each[0]
        found = Match.of(np.zeros(len(self._stream), dtype=bool))
        undecided = np.zeros(len(self._stream), dtype=bool)
        for index, (here, undecided_here) in enumerate(each):
            rows = self._stream.rows_of(index)
            found.holds[rows], found.margin[rows] = here.holds, here.margin
            found.bound[rows], found.field[rows] = here.bound, here.field
            undecided[rows] = undecided_here
        return found, undecided

    def _of_topic(self, topic: Topic, name: str, given: tuple[Given, ...]) -> tuple[Match, BoolArray]:
        one, count = _OneTopic(self._matcher, topic, self._tolerance), len(topic.t)
        try:
            return one.type(name, slots_of(given, {}), {}), one.undecided
        except NotColumnarError:
            return Match.alike(False, count), np.ones(count, dtype=bool)
        finally:
            self.close += one.close


@dataclass(frozen=True, eq=False)
class _Doubts:
    """Events for which a guard cannot simply be computed.

    Attributes:
        zero: Where something is divided by zero, shape (n,).
        undecided: Where only the interpreter can decide, shape (n,).
    """

    zero: BoolArray
    undecided: BoolArray


def _value_of(function: Callable[..., float], args: Sequence[float]) -> float | None:
    """A value, where the function has one."""
    try:
        return function(*args)
    except (ValueError, OverflowError):
        return None


class _OneTopic:
    """The event types over one topic.

    Attributes:
        close: How many comparisons would come out differently without the tolerance.
        undecided: Which events only the interpreter can decide, shape (n,).
    """

    def __init__(self, matcher: Matcher, topic: Topic, tolerance: float) -> None:
        self._matcher, self._tolerance, self.close = matcher, tolerance, 0
        self._topic, self._count, self._event = topic, len(topic.t), topic.record()
        self.undecided = self._all(False)

    def _all(self, holds: bool) -> BoolArray:
        return np.full(self._count, holds)

    def _match_of(self, holds: BoolArray) -> Match:
        sure = bool(holds[0]) if len(holds) else False
        return Match.alike(sure, self._count) if (holds == sure).all() else Match.of(holds)

    def type(self, name: str, slots: list[Slot], values: _Values) -> Match:
        """Whether each event is of a type, with every way in which it can be."""
        found = Match.alike(False, self._count)
        for match, _ in self._ways(name, slots, values):
            found |= match
        return found

    def _ways(self, name: str, slots: list[Slot], values: _Values) -> Iterator[tuple[Match, _Values]]:
        for declared in self._matcher.declared(name, len(slots)):
            scope, known = scope_of(declared.params, slots, {})
            if known is None or known:
                raise NotColumnarError(name)
            if declared.negated:
                if declared.guard is not None:
                    raise NotColumnarError(name)
                inner = Match.alike(False, self._count)
                for match, _ in self._alternatives(declared, scope, values):
                    inner |= match
                yield ~inner, values
                continue
            for match, found in self._alternatives(declared, scope, values):
                if declared.guard is None or not match.holds.any():
                    yield match, found
                else:
                    yield self._guarded(match, declared.guard, scope, found), found

    def _guarded(self, match: Match, guard: Data, scope: Scope, values: _Values) -> Match:
        """A match where the guard holds too."""
        try:
            kept, undecided = self._guard(guard, scope, values)
        except NotColumnarError:
            self.undecided |= match.holds
            return Match.alike(False, self._count)
        self.undecided |= match.holds & undecided
        return match & kept

    def _alternatives(
        self, declared: Declared, scope: Scope, values: _Values
    ) -> Iterator[tuple[Match, _Values]]:
        for pattern in declared.patterns:
            found = dict(values)
            yield self._match_of(self._takes(pattern, self._event, scope, found)), found
        for parent in declared.parents:
            yield from self._ways(parent.name, [slot_of(arg, scope) for arg in parent.args], values)

    # Patterns ------------------------------------------------------------------------

    def _takes(
        self, pattern: Pattern, value: object, scope: Scope, values: dict[Unknown, _Value]
    ) -> BoolArray:
        if isinstance(pattern, Anything):
            return self._all(True)
        if isinstance(pattern, Name):
            return self._slot_takes(slot_of_name(pattern.name, scope), value, values)
        if isinstance(pattern, Literal_):
            return self._fits(pattern.value, value)
        if isinstance(pattern, RecordPattern) and isinstance(value, dict):
            taken = self._all(True)
            for key, inner in pattern.fields:
                if key not in value:
                    return self._all(False)
                taken &= self._takes(inner, value[key], scope, values)
            return taken
        if isinstance(pattern, ListPattern) and isinstance(value, list):
            raise NotColumnarError
        if isinstance(pattern, RecordPattern | ListPattern):
            return self._all(False)
        raise NotColumnarError

    def _slot_takes(self, slot: Slot, value: object, values: dict[Unknown, _Value]) -> BoolArray:
        if isinstance(value, dict | list):
            raise NotColumnarError  # whether two of these are the same, only the interpreter knows
        if isinstance(slot, Bound):
            return self._fits(slot.value, value)
        if isinstance(slot, Unknown):
            if slot in values:
                return self._fits(values[slot], value)
            values[slot] = value  # type: ignore[assignment]  # a column or a constant
            return self._all(True)
        if isinstance(slot, PatternSlot):
            taken = self._all(False)
            for option in alternatives(slot.pattern):
                taken |= self._takes(option, value, slot.scope, dict(values))
            self.undecided |= taken
            return taken
        return self._all(False)

    def _fits(self, pattern: object, value: object) -> BoolArray:
        if isinstance(value, list | dict) or isinstance(pattern, list | dict):
            return self._all(False)
        if not isinstance(value, np.ndarray):
            return self._all(not isinstance(pattern, np.ndarray) and fits(pattern, value))  # type: ignore[arg-type]
        if not isinstance(pattern, np.ndarray) and not is_number(pattern):
            return self._all(False)
        number = np.asarray(pattern)
        if number.dtype.kind != value.dtype.kind:
            return self._all(False)  # 1 is not 1.0
        alike: BoolArray = value == number
        # 0.0 does not match -0.0.
        return alike if value.dtype.kind == "i" else alike & (np.signbit(value) == np.signbit(number))

    # Guards --------------------------------------------------------------------------

    def _guard(self, guard: Data, scope: Scope, values: _Values) -> tuple[Match, BoolArray]:
        """Where a guard holds, and where only the interpreter can decide."""
        if not isinstance(guard, Op):
            raise NotColumnarError
        if guard.op in ("&&", "||"):
            (left, undecided), (right, further) = (self._guard(arg, scope, values) for arg in guard.args)
            # As in the interpreter, which leaves the right side alone where the left decides.
            undecided = undecided | (further & (left.holds if guard.op == "&&" else ~left.holds))
            return left & right if guard.op == "&&" else left | right, undecided
        doubts = _Doubts(self._all(False), self._all(False))
        fields = [self._field(arg, scope, values) for arg in guard.args]
        limited = 1 if fields[0] < 0 <= fields[1] else 0
        with np.errstate(all="ignore"):
            sides = [self._number(arg, scope, values, doubts) for arg in guard.args]
            difference = np.broadcast_to(sides[0] - sides[1], self._count)
        bound = np.broadcast_to(sides[1 - limited], self._count)
        failed = doubts.zero | doubts.undecided
        return self._compared(guard.op, difference, bound, fields[limited], failed), doubts.undecided

    def _field(self, side: Data, scope: Scope, values: _Values) -> int:
        """Which field one side of an inequality is; -1: none, or something computed."""
        if isinstance(side, Num | Const | Op):
            return -1
        slot = slot_of_name(side.name, scope)
        if isinstance(slot, ExprSlot):
            return self._field(slot.data, slot.scope, values)
        column = values.get(slot) if isinstance(slot, Unknown) else None
        return next((i for i, one in enumerate(self._topic.fields.values()) if one is column), -1)

    def _compared(
        self, op: str, difference: FloatArray, bound: FloatArray, field: int, failed: BoolArray
    ) -> Match:
        """One comparison; where something was divided by zero, or has no value, it fails."""
        held = holds(op, difference, self._tolerance)
        self.close += int(np.count_nonzero(held != holds(op, difference, 0.0)))
        if op in ("==", "!="):
            margin = np.abs(difference) * (-1.0 if op == "==" else 1.0)
        else:
            margin = difference if op in (">", ">=") else -difference
        fields = np.broadcast_to(np.intp(field), (self._count,))
        if not failed.any():
            return Match(held, margin, bound, fields)
        return Match(
            held & ~failed,
            np.where(failed, -np.inf, margin),
            np.where(failed, np.nan, bound),
            np.where(failed, -1, fields),
        )

    def _number(self, data: Data, scope: Scope, values: _Values, doubts: _Doubts) -> _Numbers:
        if isinstance(data, Num):
            return float(data.value)
        if isinstance(data, Const):
            raise NotColumnarError
        if not isinstance(data, Op):
            return self._named(data.name, scope, values, doubts)
        args = [self._number(arg, scope, values, doubts) for arg in data.args]
        if data.op == "-" and len(args) == 1:
            return -1.0 * args[0]
        if data.op in ("+", "-", "*"):
            a, b = args
            return a + b if data.op == "+" else a - b if data.op == "-" else a * b
        if data.op == "/":
            divisor = np.broadcast_to(args[1], doubts.zero.shape)
            np.logical_or(doubts.zero, divisor == 0, out=doubts.zero)
            return args[0] / np.where(divisor == 0, 1.0, divisor)
        return self._function(data.op, args, doubts.undecided)

    def _function(self, name: str, args: list[_Numbers], undecided: BoolArray) -> _Numbers:
        if name == "abs":
            return np.abs(args[0])
        if name in ("min", "max"):
            a, b = np.broadcast_arrays(*args)
            # Not np.minimum: of 0.0 and -0.0, and of NaN, Python takes the first argument.
            return np.where(b < a if name == "min" else b > a, b, a)
        if name not in FLOAT_FUNCTIONS:
            raise NotColumnarError  # a condition
        # Value by value: numpy's own functions may differ from Python's in the last bit.
        columns = [np.broadcast_to(arg, undecided.shape).tolist() for arg in args]
        found = [_value_of(FLOAT_FUNCTIONS[name], row) for row in zip(*columns, strict=True)]
        np.logical_or(undecided, [value is None for value in found], out=undecided)
        return np.array([math.nan if value is None else value for value in found], dtype=np.float64)

    def _named(self, name: str, scope: Scope, values: _Values, doubts: _Doubts) -> _Numbers:
        slot = slot_of_name(name, scope)
        if isinstance(slot, ExprSlot):
            return self._number(slot.data, slot.scope, values, doubts)
        value: object = None
        if isinstance(slot, Bound):
            value = slot.value
        elif isinstance(slot, Unknown):
            value = values.get(slot)
        if isinstance(value, np.ndarray):
            return value if value.dtype.kind == "f" else value.astype(np.float64)
        if is_number(value):
            try:
                return float(value)  # type: ignore[arg-type]
            except OverflowError:
                raise NotColumnarError from None
        raise NotColumnarError
