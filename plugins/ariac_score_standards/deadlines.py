"""Responses that may have been late where nothing shows when they were asked for."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

from ariac_score import FloatArray, Span
from ariac_score.monitors import TOLERANCE_S

__all__ = ["Asked", "asked_at_worst", "late_at_worst"]


@dataclass(frozen=True)
class Asked:
    """A stretch in which a response may have been asked for, all of which has the same answer.

    Attributes:
        from_s: From when on, s.
        to_s: Until when, s.
        answered_s: When the answer came, s; the end of the competition, where none did.
        in_vain: Whether none did.
    """

    from_s: float
    to_s: float
    answered_s: float
    in_vain: bool

    @property
    def longest_s(self) -> float:
        """How long the response took at most, s."""
        return self.answered_s - self.from_s


def asked_at_worst(
    seen_s: Iterable[float], hidden: Sequence[Span], answered: FloatArray, ends_s: float
) -> list[Asked]:
    """When a response may have been asked for, and when it came.

    Args:
        seen_s: When it was seen to be asked for.
        hidden: Where nothing shows whether it was, in time order.
        answered: When samples show the response, shape (n,), in time order, s.
        ends_s: End of the competition, s.
    """
    outside = [Span(s, s) for s in seen_s if not any(one.start_s <= s <= one.end_s for one in hidden)]
    found = []
    for span in sorted([*outside, *hidden]):
        first, last = (int(answered.searchsorted(t)) for t in (span.start_s, span.end_s))
        between = answered[first:last].tolist()
        in_vain = last == len(answered)
        answers = [*between, max(ends_s, span.end_s) if in_vain else float(answered[last])]
        begins, ends = [span.start_s, *between], [*between, span.end_s]
        found += [
            Asked(from_s, to_s, answer_s, in_vain and row == len(between))
            for row, (from_s, to_s, answer_s) in enumerate(zip(begins, ends, answers, strict=True))
        ]
    return found


def late_at_worst(asked: Iterable[Asked], within_s: float, pause_s: float) -> Iterator[tuple[Span, float]]:
    """As many late responses as there may have been, and how much too late they were together.

    A response may have been asked for from the earliest moment on, and again after each pause. Where the
    last one of an earlier answer leaves no room for the first of the next, both count as one, with the time
    of both.

    Args:
        asked: When it may have been asked for, in time order.
        within_s: It is late after so long, s.
        pause_s: It is asked for no sooner again, s.

    Yields:
        From when to when each took, and how much too late it counts, s.
    """
    found: list[tuple[Span, float]] = []
    next_s = -math.inf
    for answered_s, stretches in _by_answer(asked, within_s):
        soonest, counted = -math.inf, len(found)
        each: list[float] = []
        for one in stretches:
            latest_s = min(one.to_s, answered_s - within_s - 2 * TOLERANCE_S)
            for began_s in _every(max(one.from_s, soonest), latest_s, pause_s):
                soonest = began_s + pause_s
                each.append(began_s)
            for began_s in _every(max(one.from_s, next_s), latest_s, pause_s):
                next_s = began_s + pause_s
                found.append((Span(began_s, answered_s), answered_s - began_s - within_s))
        left_s = math.fsum(answered_s - began_s - within_s for began_s in each)
        left_s -= math.fsum(late_s for _, late_s in found[counted:])
        if left_s > TOLERANCE_S:
            span, late_s = found[-1]
            longer = max(span, Span(each[0], answered_s), key=lambda one: one.duration_s)
            found[-1] = longer, late_s + left_s
    return iter(found)


def _by_answer(asked: Iterable[Asked], within_s: float) -> Iterator[tuple[float, list[Asked]]]:
    """The stretches in which the response may have been late, by when it came."""
    known: dict[float, list[Asked]] = {}
    for one in asked:
        if one.longest_s > within_s + TOLERANCE_S:
            known.setdefault(one.answered_s, []).append(one)
    return iter(known.items())


def _every(first_s: float, last_s: float, pause_s: float) -> Iterator[float]:
    """Moments from a first one up to a last one, a pause apart, s."""
    if first_s <= last_s + TOLERANCE_S:
        number = math.floor((last_s - first_s) / pause_s + TOLERANCE_S) + 1
        yield from (first_s + k * pause_s for k in range(max(number, 1)))
