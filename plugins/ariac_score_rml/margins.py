"""How far each event of a stream was from the opposite verdict."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ariac_score_rml.automaton import MAX_TABLES, Watch
from ariac_score_rml.columns import Columns, Match, NotColumnarError, Rows, Stream
from ariac_score_rml.faults import RmlRunError
from ariac_score_rml.machine import Machine
from ariac_score_rml.terms import Term

__all__ = ["margins"]


def margins(machine: Machine, stream: Stream, watch: Watch, columns: Columns) -> Match | None:
    """How far each event was from being rejected (negative: from being accepted), and from which bound.

    Of alternatives the best counts, of joint demands the worst. Infinite where no
    inequality over numbers decides. `None` when it can only be found event by event.
    """
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
    """Each state with the events that were judged in it.

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
