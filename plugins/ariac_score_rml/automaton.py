"""Running a specification over columns: a table of states, built as it is needed, that jumps over self-loops.

Which event types an event is of decides what it does to a state, where no data is
bound. So a state and the pattern of matches of the types it asks about are all that
a transition depends on, and a stretch of events that leave the state as it is is
passed over in one look. Where data is bound the interpreter takes each event.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import inf
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ariac_score_rml.columns import Columns, Match, NotColumnarError, Rows, Stream
from ariac_score_rml.faults import RmlRunError
from ariac_score_rml.machine import Letter, Machine, match_key
from ariac_score_rml.terms import Term

__all__ = [
    "MAX_TABLES",
    "AfterViolation",
    "Between",
    "PartByPart",
    "Watch",
    "margins",
    "watch_by_interpreter",
    "watch_columns",
    "watch_stream",
]

AfterViolation: TypeAlias = Literal["resume", "restart", "once"]
"""resume: the rejected event is passed over; restart: Main begins anew; once: nothing more is judged."""

MAX_TABLES = 5_000
_Codes: TypeAlias = "NDArray[np.uint16]"
_UNKNOWN, _STAYS, _REJECTS, _LEAVES = range(4)
_FIRST_LOOK = 64


@dataclass(frozen=True)
class Between:
    """Where a specification is between two events.

    Attributes:
        state: The state that the next event finds.
        letter: What may be said of the events so far.
        fresh: Whether nothing was accepted since the start or the last restart.
    """

    state: Term
    letter: Letter
    fresh: bool

    @classmethod
    def start(cls, machine: Machine) -> Between:
        """Before any event.

        Raises:
            RmlRunError: Nothing can be said there.
        """
        return cls(machine.start, machine.letter(machine.start), True)


@dataclass(frozen=True)
class Watch:
    """What a specification said of a stream of events.

    Attributes:
        states: States met, each once.
        before: Which of them the stream was in before each event, shape (n,); -1: not judged.
        rejected: Whether the event was rejected, shape (n,).
        initial: Letter before any event.
        end: Letter after the last event judged; `E` when one could not be.
        fresh: Whether nothing was accepted since the start or the last restart.
        error: Why an event could not be judged.
        error_at: Which event that was; -1: none, or before any event.
        then: Where the specification is after the last event; `None`: nothing more is judged.
    """

    states: tuple[Term, ...]
    before: NDArray[np.intp]
    rejected: NDArray[np.bool_]
    initial: Letter
    end: Letter
    fresh: bool
    error: RmlRunError | None = None
    error_at: int = -1
    then: Between | None = None


def watch_stream(
    machine: Machine, stream: Stream, after: AfterViolation, columns: Columns | None = None
) -> Watch:
    """Run a specification over a stream, over columns where that can be."""
    try:
        return watch_columns(machine, stream, after, columns or Columns(machine.matcher, stream))
    except NotColumnarError:
        return watch_by_interpreter(machine, stream, after)


class PartByPart:
    """A specification that runs over the parts of a stream, over columns where that can be.

    Once it cannot be, it goes on event by event.
    """

    def __init__(self, machine: Machine, after: AfterViolation) -> None:
        self._machine, self._after = machine, after
        self._table = _Table(machine)
        self._events_from: float = inf
        """The first part that only the interpreter can run over."""

    def run(self, number: int, stream: Stream, columns: Columns, begin: Between) -> Watch:
        """Run over a part, from where the parts before it lead; parts may come again."""
        if number < self._events_from:
            try:
                return self._table.run(stream, columns, self._after, begin)
            except NotColumnarError:
                self._events_from = number
        return watch_by_interpreter(self._machine, stream, self._after, begin)


def watch_columns(machine: Machine, stream: Stream, after: AfterViolation, columns: Columns) -> Watch:
    """Run a specification over the columns of a stream.

    Raises:
        NotColumnarError: Only the interpreter can.
    """
    try:
        begin = Between.start(machine)
    except RmlRunError as error:
        return _Recorder(len(stream)).broken(error)
    return _Table(machine).run(stream, columns, after, begin)


class _Recorder:
    """Keeps what is found out, in either way of running."""

    def __init__(self, count: int) -> None:
        self.states: list[Term] = []
        self._index: dict[Term, int] = {}
        self.before = np.full(count, -1, dtype=np.intp)
        self.rejected = np.zeros(count, dtype=bool)

    def number(self, state: Term) -> int:
        index = self._index.get(state)
        if index is None:
            index = self._index[state] = len(self.states)
            self.states.append(state)
        return index

    def watch(
        self, initial: Letter, end: Letter, fresh: bool, error: RmlRunError | None = None, at: int = -1
    ) -> Watch:
        return Watch(tuple(self.states), self.before, self.rejected, initial, end, fresh, error, at)

    def broken(self, error: RmlRunError) -> Watch:
        """Nothing can be said, not even before any event."""
        return self.watch("E", "E", True, error)

    def whole(self, initial: Letter, then: Between) -> Watch:
        """Every event was judged."""
        return replace(self.watch(initial, then.letter, then.fresh), then=then)


def watch_by_interpreter(
    machine: Machine, stream: Stream, after: AfterViolation, begin: Between | None = None
) -> Watch:
    """Run a specification over a stream, event by event, from its start or from where it has come to."""
    recorder = _Recorder(len(stream))
    try:
        begin = begin or Between.start(machine)
    except RmlRunError as error:
        return recorder.broken(error)
    state, initial, letter, fresh = begin.state, begin.letter, begin.letter, begin.fresh
    for i in range(len(stream)):
        recorder.before[i] = recorder.number(state)
        try:
            found = machine.after(state, stream.event(i))
            letter = letter if found is None else machine.letter(found)
        except RmlRunError as error:
            return recorder.watch(initial, "E", fresh, error, i)
        if found is not None:
            state, fresh = found, False
            continue
        recorder.rejected[i] = True
        if after == "once":
            return recorder.watch(initial, "F", fresh)
        if after == "restart":
            state, letter, fresh = machine.start, machine.letter(machine.start), True
    return recorder.whole(initial, Between(state, letter, fresh))


def _unfolded(machine: Machine, state: Term) -> Term:
    """The body of `Main`, which is what most specifications come back to; the reference to it is not."""
    body = machine.unfold(state) if state.kind == "ref" else None
    return state if body is None else body


class _Row:
    """What is known of one state: for each pattern of matches what comes of it."""

    def __init__(self, types: tuple[Term, ...]) -> None:
        self.types = types
        self.keys = tuple(match_key(term) for term in types)
        self.outcome = np.zeros(1 << len(types), dtype=np.int8)
        self.next: dict[int, Term] = {}


class _Table:
    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._rows: dict[Term, _Row] = {}

    def run(self, stream: Stream, columns: Columns, after: AfterViolation, begin: Between) -> Watch:
        """Run over a stream from where the specification has come to.

        Raises:
            NotColumnarError: Only the interpreter can.
        """
        machine, recorder, found_codes = self._machine, _Recorder(len(stream)), _MatchCodes(columns)
        start = _unfolded(machine, machine.start)
        state = start if begin.state is machine.start else begin.state
        initial, letter, fresh, i = begin.letter, begin.letter, begin.fresh, 0
        while i < len(stream):
            row = self._row(state)
            codes = found_codes.of(row)
            j = _leaves_at(row, codes, i, passes=after == "resume")
            if j > i:
                outcomes = row.outcome[codes[i:j]]
                recorder.before[i:j] = recorder.number(state)
                recorder.rejected[i:j] = outcomes == _REJECTS
                fresh = fresh and bool((outcomes == _REJECTS).all())
                i = j
                continue
            recorder.before[i] = recorder.number(state)
            code = int(codes[i])
            try:
                found = self._after(row, state, code)
                letter = letter if found is None else machine.letter(found)
            except RmlRunError as error:
                return recorder.watch(initial, "E", fresh, error, i)
            if found is not None:
                state, fresh = found, False
            else:
                recorder.rejected[i] = True
                if after == "once":
                    return recorder.watch(initial, "F", fresh)
                if after == "restart":
                    state, letter, fresh = start, machine.letter(start), True
            i += 1
        return recorder.whole(initial, Between(state, letter, fresh))

    def _row(self, state: Term) -> _Row:
        row = self._rows.get(state)
        if row is None:
            if len(self._rows) >= MAX_TABLES:
                self._rows.clear()
            types = self._machine.asked(state)
            if types is None:
                raise NotColumnarError
            row = self._rows[state] = _Row(types)
        return row

    def _after(self, row: _Row, state: Term, code: int) -> Term | None:
        outcome = row.outcome[code]
        if outcome == _UNKNOWN:
            matches = {key: bool(code >> bit & 1) for bit, key in enumerate(row.keys)}
            found = self._machine.after_matches(state, matches)
            row.outcome[code] = _REJECTS if found is None else _STAYS if found is state else _LEAVES
            if found is not None:
                row.next[code] = found
            return found
        return row.next.get(code)


class _MatchCodes:
    """Which of the types that a state asks about each event is of, as bits of a number."""

    def __init__(self, columns: Columns) -> None:
        self._columns = columns
        self._known: dict[tuple[object, ...], _Codes] = {}

    def of(self, row: _Row) -> _Codes:
        """The number of each event, shape (n,).

        Raises:
            NotColumnarError: Only the interpreter can say.
        """
        found = self._known.get(row.keys)
        if found is None:
            found = np.zeros(self._columns.count(slice(None)), dtype=np.uint16)
            for bit, term in enumerate(row.types):
                found |= self._columns.match(term.name, term.given).holds.astype(np.uint16) << bit
            self._known[row.keys] = found
        return found


def _leaves_at(row: _Row, codes: _Codes, i: int, *, passes: bool) -> int:
    """The first event from `i` on that may change the state (or is rejected, unless that passes)."""
    quiet = row.outcome == _STAYS
    if passes:
        quiet |= row.outcome == _REJECTS
    if not quiet[codes[i]]:
        return i
    look, end = _FIRST_LOOK, len(codes)
    while i < end:
        loud = ~quiet[codes[i : i + look]]
        if loud.any():
            return i + int(loud.argmax())
        i, look = i + look, look * 4
    return end


# Margins ---------------------------------------------------------------------------------


def margins(machine: Machine, stream: Stream, watch: Watch, columns: Columns | None = None) -> Match | None:
    """How far each event was from being rejected (negative: from being accepted), and from what bound.

    Of alternatives the best counts, of joint demands the worst. Infinite where no
    inequality over numbers decides. `None` when that can only be said event by event.
    """
    columns = columns or Columns(machine.matcher, stream)
    if not len(stream):
        return Match.alike(True, 0)
    if watch.before[0] >= 0 and (watch.before == watch.before[0]).all():
        try:
            return _margin(machine, columns, watch.states[watch.before[0]], slice(None))
        except (NotColumnarError, RmlRunError):
            return None
    whole = Match.of(np.ones(len(stream), dtype=bool))
    try:
        for state, rows in _stretches(watch):
            match = _margin(machine, columns, state, rows)
            whole.margin[rows], whole.bound[rows] = match.margin, match.bound
            whole.field[rows] = match.field
    except (NotColumnarError, RmlRunError):
        return None
    return whole


def _stretches(watch: Watch) -> Iterator[tuple[Term, Rows]]:
    """For each state the events that found it, those that were not judged left out.

    Raises:
        NotColumnarError: There are too many states.
    """
    before = watch.before
    (changes,) = np.nonzero(before[1:] != before[:-1])
    starts, ends = np.append(0, changes + 1), np.append(changes + 1, len(before))
    states = before[starts]
    order = np.argsort(states, kind="stable")
    numbers, first = np.unique(states[order], return_index=True)
    if len(numbers) > MAX_TABLES:
        raise NotColumnarError
    for number, runs in zip(numbers.tolist(), np.split(order, first[1:]), strict=True):
        if number >= 0:
            at = [slice(start, end) for start, end in zip(starts[runs], ends[runs], strict=True)]
            rows: Rows = at[0] if len(at) == 1 else np.concatenate([np.arange(s.start, s.stop) for s in at])
            yield watch.states[number], rows


_MAX_DEPTH = 200


def _margin(machine: Machine, columns: Columns, term: Term, rows: Rows, depth: int = 0) -> Match:
    """The margin by which a state takes each of some events."""
    if depth > _MAX_DEPTH:
        raise NotColumnarError
    kind = term.kind

    def of(part: Term) -> Match:
        return _margin(machine, columns, part, rows, depth + 1)

    if kind in ("empty", "all") or (kind == "times" and term.count == 0):
        return Match.alike(kind == "all", columns.count(rows))
    if kind in ("event", "filter"):
        here = columns.match(term.name, term.given, rows)
        return here if kind == "event" else of(term.parts[0]).where(here, of(term.parts[1]))
    if kind in ("ref", "apply"):
        body = machine.unfold(term)
        return Match.alike(False, columns.count(rows)) if body is None else of(body)
    if kind == "if":
        return of(machine.branch(term))
    if kind in ("or", "shuffle"):
        return of(term.parts[0]) | of(term.parts[1])
    if kind == "and":
        return of(term.parts[0]) & of(term.parts[1])
    first = of(term.parts[0])
    if kind == "seq" and machine.halts(term.parts[0]):
        return first | of(term.parts[1])
    return first
