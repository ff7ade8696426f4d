"""What violations cost when one physical event may be seen by several checks."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.scoring.expression import Number

__all__ = ["charge"]


def charge(
    findings: Mapping[str, Finding], weights: Mapping[str, Number], *, again_after_s: Number
) -> list[tuple[str, Number]]:
    """What each violation costs, no moment being charged twice for one pair of bodies.

    A violation weighs on its subject from its start until `again_after_s` after its
    end. At each moment the heaviest violation of a subject counts and no other; the
    time so weighed, divided by `again_after_s`, is what the subject pays. So one
    violation of length L alone costs its weight times 1 + L / `again_after_s`: one
    demerit, and one more for every `again_after_s` it lasts. Two that are at least so far
    apart cost what each costs alone; two that are nearer share the time they both cover.
    A violation without a time costs its weight.

    Why not 1 + (integral of relative depth) / tau for each episode, as the monitor
    catalogue suggests: there, violating in the pause between two episodes makes one
    of them and can be cheaper. With U the times in violation, the law that more
    violations never help says that the charge may only grow with U. Two instants T
    apart that cost 2 are part of any violation that lasts from one to the other, so a
    violation of length L must cost at least 1 + floor(L / T), however shallow it is.
    Here the cost of one weight is |U + [0, T]| / T, the time covered by U and by the T
    after each of its instants:

    - it grows with U, because U + [0, T] does; with several weights, the greatest at
      each moment does;
    - a pause shorter than T inside a violation is covered from before, so it changes
      nothing, bridged or not;
    - moving an end by one sample moves it by one sample / T, never by a whole demerit.

    How deep a violation is does not enter: what is worse than a breach of separation
    is a check of its own, in a heavier class.

    Args:
        findings: By id.
        weights: Demerits of one violation, by check.
        again_after_s: After how long a violation that goes on costs the same again, s.

    Returns:
        For each violation, in order of id, the part of the cost that is charged to it;
        0 where a heavier one, or an equal one of earlier id, covers all of its time.

    Source:
        Monitor catalogue, section 3 (one event, largest class only; its penalties that
        come again after 5 s); the measure is our choice.
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
        end_s = finding.span.end_s + again_after_s
        subjects.setdefault(pair, []).append(_Weighing(-weight, key, finding.span.start_s, end_s))
    for weighings in subjects.values():
        for key, weighed in _envelope(weighings):
            shares[key] += weighed / again_after_s
    return sorted(shares.items())


@dataclass(frozen=True, order=True)
class _Weighing:
    """One violation while it weighs; the heaviest sorts first, then the lowest id."""

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
