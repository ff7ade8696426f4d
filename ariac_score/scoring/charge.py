"""What violations cost over time when one physical event may be seen by several checks."""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

from ariac_score.checks.depth import FILLED_S
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.scoring.expression import Number

__all__ = ["SHORTEST_AGAIN_S", "charge"]

SHORTEST_AGAIN_S = FILLED_S
"""No charge may last for less: profiles of depth are stored with shorter valleys filled."""


def charge(
    findings: Mapping[str, Finding],
    weights: Mapping[str, Number],
    *,
    again_after_s: Number,
    severity: Number = 1,
) -> list[tuple[str, Number]]:
    """What each violation costs, no moment being charged twice for one pair of bodies.

    A violation presses on its subject with its weight times its relative depth to the power of `severity`;
    one without a depth with its weight. f(t) is the most that presses on a subject at a moment, and M(t) the
    most that did within `again_after_s` before it. The subject pays the integral of M, up to `again_after_s`
    after the last violation, divided by `again_after_s`. A violation without a time costs its weight.

    Why the sliding maximum: with f nowhere greater M is nowhere greater, so that

    - more, longer or deeper violations never cost less, and there are no episodes to be merged or split;
    - two sets of violations cost at most what each costs, and that if they are `again_after_s` apart;
    - a pause up to `again_after_s` long between two violations that are at least as deep is free of charge,
      and so is filling it;
    - one rise and fall costs its peak plus its integral / `again_after_s` (every level set of f is one
      stretch, and becomes longer by `again_after_s`): a violation of length L and one depth costs that times
      1 + L / `again_after_s`;
    - the price is continuous in depth and in every end, but for the least one: an instant at some depth
      costs that depth.

    What happens in the shadow of something heavier, at the same time or up to `again_after_s` after it, is
    free: one event is charged once.

    Args:
        findings: By id.
        weights: Demerits of one violation, by check.
        again_after_s: So long after its end a violation is charged, and so long as it lasts it costs the
            same again, s; at least `SHORTEST_AGAIN_S`.
        severity: Power of the relative depth; 1: in proportion to it, 0: all are as deep as can be.

    Returns:
        For each violation, in order of id, the part of the cost that is charged to it;
        0 where a heavier one, or an equal one of earlier id, covers all of its time.

    Source:
        Monitor catalogue, section 3 (one event, largest class only; its penalties that
        come again after 5 s); the sliding maximum is our choice.
    """
    shares: dict[str, Number] = {}
    subjects: dict[tuple[str, ...], list[_Weighing]] = {}
    for key, finding in findings.items():
        if finding.verdict is not Verdict.VIOLATED:
            continue
        weight = weights[finding.check]
        if finding.span is None:
            shares[key] = weight
            continue
        shares[key] = 0.0
        # `robot/human` and `human/robot` are one pair, in whichever order a monitor names it.
        pair = tuple(sorted(finding.subject.split("/")))
        subjects.setdefault(pair, []).extend(
            _Weighing(-weight * share, key, begins_s, ends_s + again_after_s)
            for begins_s, ends_s, share in _pressing(finding, severity)
        )
    for weighings in subjects.values():
        for key, weighed in _envelope(weighings):
            shares[key] += weighed / again_after_s
    return sorted(shares.items())


def _pressing(finding: Finding, severity: Number) -> Iterator[tuple[float, float, Number]]:
    """From when to when a violation presses with which share of its weight."""
    assert finding.span is not None  # the caller asks only about what has a time
    if finding.profile is None:
        yield finding.span.start_s, finding.span.end_s, 1
        return
    for begins_s, ends_s, depth in finding.profile.steps():
        # Without a power where none is needed: the last bits of powers differ between machines.
        yield begins_s, ends_s, 1 if severity == 0 else depth if severity == 1 else depth**severity


class _Weighing(NamedTuple):
    """One step of a violation while it weighs; the heaviest sorts first, then the lowest id."""

    # The order of the fields is the sort order; of equal weights the id decides, so that the
    # ledger does not depend on the order in which findings come.

    minus_weight: Number
    key: str
    start_s: float
    end_s: float


def _envelope(weighings: Sequence[_Weighing]) -> list[tuple[str, Number]]:
    """The pieces of the upper envelope: the finding each belongs to, and weight times duration."""
    marks = sorted({t for each in weighings for t in (each.start_s, each.end_s)})
    coming = sorted(weighings, key=lambda each: each.start_s, reverse=True)
    active: list[_Weighing] = []
    pieces: list[tuple[str, Number]] = []
    for from_s, to_s in pairwise(marks):
        while coming and coming[-1].start_s <= from_s:
            heapq.heappush(active, coming.pop())
        # Only the top has to be current: what has ended further down is dropped once it gets there.
        while active and active[0].end_s <= from_s:
            heapq.heappop(active)
        if active:
            pieces.append((active[0].key, -active[0].minus_weight * (to_s - from_s)))
    return pieces
