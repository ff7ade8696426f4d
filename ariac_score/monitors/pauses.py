"""Violations that may be one or several, and what both cost.

Their number is not monotone: two that touch are one, and one with a pause in it is two. A pause may have been
wherever nothing shows that there was none.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import replace

from ariac_score.checks.depth import DepthProfile, joined_profiles
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.trial.spans import Span, merged
from ariac_score.trial.sums import exact_sum

__all__ = [
    "beginning_in",
    "in_time_order",
    "joined_where_one",
    "meeting",
    "one_by_one",
    "profile_of",
    "split_by_pauses",
    "together",
    "touch",
    "violations_of",
    "without",
    "without_these",
]


def violations_of(findings: Iterable[Finding]) -> list[Finding]:
    """Those that have a time."""
    return [one for one in findings if one.verdict is Verdict.VIOLATED and one.span is not None]


def joined_where_one(best: Sequence[Finding], worst: Sequence[Finding]) -> list[Finding]:
    """The best findings with as few violations as there can be: what one in the worst world covers is one."""
    found = list(best)
    for whole in violations_of(worst):
        inside = [
            one for one in violations_of(found) if one.span and whole.span and one.span.overlaps(whole.span)
        ]
        if len(inside) > 1:
            found = [one for one in found if one not in inside[1:]]
            found[found.index(inside[0])] = together(inside)
    return found


def together(violations: Sequence[Finding]) -> Finding:
    """One violation with all the time of several; its span is that of the first, so that none costs more."""
    first = violations[0]
    quantities = {
        name: (max if _is_maximum(name) else exact_sum)(one.quantities.get(name, 0.0) for one in violations)
        for name in first.quantities
    }
    margins = [one.robustness for one in violations if one.robustness is not None]
    return replace(
        first,
        message=f"{first.message}; {len(violations) - 1} more may be one with it",
        quantities=quantities,
        robustness=min(margins) if margins else None,
        profile=joined_profiles([profile_of(one) for one in violations if one.span]),
    )


def profile_of(violation: Finding) -> DepthProfile:
    """How deep a violation was over time; as deep as can be, where it has no depth."""
    if violation.profile is not None or violation.span is None:
        return violation.profile or DepthProfile((0.0, 0.0), (0.0, 0.0))
    return DepthProfile((violation.span.start_s, violation.span.end_s), (1.0, 0.0))


def _is_maximum(name: str) -> bool:
    return "max" in name or name == "exposure_s"


def split_by_pauses(best: Sequence[Finding], worst: Sequence[Finding], pause_s: float) -> list[Finding]:
    """The same of findings alone: a pause may have been wherever the best world has no violation."""
    further: list[Finding] = []
    kept = merged(one.span for one in violations_of(best) if one.span)
    for violation in violations_of(worst) if pause_s > 0.0 else ():
        assert violation.span is not None
        at_s = violation.span.start_s
        for other in [*kept, Span(violation.span.end_s, violation.span.end_s)]:
            lasts_s = min(other.start_s, violation.span.end_s) - at_s
            further += [
                touch(violation, at_s + k * pause_s) for k in range(math.floor(lasts_s / pause_s + 1e-9))
            ]
            at_s = max(at_s, other.end_s)
    return further


def touch(violation: Finding, at_s: float) -> Finding:
    """One more violation at an instant: that it was parted from the one around it."""
    nothing = {name: n if name == "exposure_s" else 0.0 for name, n in violation.quantities.items()}
    return replace(
        violation,
        message="may have ended and begun again; its time and depth are in the violation around it",
        span=Span(at_s, at_s),
        robustness=None if violation.robustness is None else 0.0,
        quantities=nothing,
        evidence=(),
        profile=DepthProfile((at_s, at_s), (0.0, 0.0)),
    )


def one_by_one(violations: Sequence[Finding]) -> list[Finding]:
    """Those that follow each other, and so may be one; what overlaps them is of another limit."""
    found: list[Finding] = []
    for one in in_time_order(violations):
        if not found or (found[-1].span and one.span and one.span.start_s >= found[-1].span.end_s):
            found.append(one)
    return found


def in_time_order(violations: Iterable[Finding]) -> list[Finding]:
    """Violations by when they begin."""
    return sorted(violations, key=lambda one: one.span or Span(0.0, 0.0))


def beginning_in(violations: Sequence[Finding], whole: Span) -> Sequence[Finding]:
    """Those of violations in time order that begin within a span."""
    first = bisect_left(violations, whole.start_s, key=_start_s)
    return violations[first : bisect_right(violations, whole.end_s, key=_start_s)]


def _start_s(violation: Finding) -> float:
    return violation.span.start_s if violation.span else 0.0


def without_these(findings: Iterable[Finding], these: Iterable[Finding]) -> list[Finding]:
    """The findings but for some of them."""
    left_out = {id(one) for one in these}
    return [one for one in findings if id(one) not in left_out]


def meeting(spans: Sequence[Span], whole: Span) -> Sequence[Span]:
    """Those of spans in time order, and apart from each other, that share an instant with another one.

    >>> meeting([Span(0.0, 1.0), Span(2.0, 3.0), Span(4.0, 5.0)], Span(1.0, 2.5))
    [Span(start_s=0.0, end_s=1.0), Span(start_s=2.0, end_s=3.0)]
    """
    first = bisect_left(spans, whole.start_s, key=lambda one: one.end_s)
    return spans[first : bisect_right(spans, whole.end_s, key=lambda one: one.start_s)]


def without(whole: Span, spans: Iterable[Span]) -> list[Span]:
    """What is left of a span without some others in time order.

    >>> without(Span(0.0, 4.0), [Span(1.0, 2.0), Span(3.0, 9.0), Span(10.0, 11.0)])
    [Span(start_s=0.0, end_s=1.0), Span(start_s=2.0, end_s=3.0)]
    """
    left, at_s = [], whole.start_s
    for span in (*spans, Span(whole.end_s, whole.end_s)):
        ends_s = min(span.start_s, whole.end_s)
        if ends_s > at_s:
            left.append(Span(at_s, ends_s))
        at_s = max(at_s, span.end_s)
    return left
