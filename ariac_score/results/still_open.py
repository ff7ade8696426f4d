"""What a log leaves open after verdicts of stewards: each decides what lies within its finding, and no more.

Both worlds of a check are of all its gaps together, so what lies beside the ruled findings is a bound: the
worst world loses what it certainly had within them, and the best keeps what it certainly had beside them.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from math import inf

from ariac_score.checks.depth import DepthProfile, joined_profiles
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.open_findings import MOST_SPANS, OpenFindings
from ariac_score.results.doubt import as_scored
from ariac_score.results.result import Result
from ariac_score.scoring.left_open import DEPTH, TIME, TIMES, LeftOpen
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.spans import Span, merged

__all__ = ["as_counted", "still_open"]

_Step = tuple[float, float, float]
"""Beginning, end and relative depth."""

_ALWAYS = Span(-1e12, 1e12)
_INSTANT_S = 1e-9
"""For so long stands the sample at which a gap begins: it was seen, and is no part of the gap."""
_SLIVER_S = 1e-6
"""What remains of a violation is longer: stamps and their sums differ by less."""


def as_counted(result: Result, findings: Mapping[str, Finding], rule_set: RuleSet) -> dict[str, Finding]:
    """Findings as they are priced: a worst case that stewards confirm costs what it cost before."""
    before = result.measured.findings
    return {
        key: before[key]
        if _is_confirmed(before[key], one) and rule_set.policies.get(one.check) == "worst_case"
        else one
        for key, one in findings.items()
    }


def _is_confirmed(before: Finding, after: Finding) -> bool:
    """Whether nobody saw it, and stewards call it violated."""
    return before.verdict is Verdict.INCONCLUSIVE and _is_violated(after)


def still_open(result: Result, findings: Mapping[str, Finding], rule_set: RuleSet) -> LeftOpen:
    """What is open after decisions.

    Args:
        result: An automatic result.
        findings: Its findings, with the verdicts that were decided.
        rule_set: That of the result.
    """
    before, known = result.measured.findings, as_scored(result, rule_set)
    kept = []
    for one in known.findings:
        own = {k: f for k, f in findings.items() if (f.check, f.subject) == (one.check, one.subject)}
        decided = {key: f for key, f in own.items() if f.verdict is not before[key].verdict}
        kept.append(_after(one, before, decided, known) if decided else one)
    ruled = frozenset(
        key for key, f in findings.items() if f.check in known.monitors and _is_confirmed(before[key], f)
    )
    return replace(known, findings=tuple(kept), ruled=ruled)


def _after(
    one: OpenFindings, before: Mapping[str, Finding], decided: Mapping[str, Finding], known: LeftOpen
) -> OpenFindings:
    """Both worlds of a check after the decisions about it."""
    # A check that was kept all the time has nothing to be cleared of.
    cleared = {
        key: finding
        for key, finding in decided.items()
        if not _is_violated(finding) and before[key].verdict is not Verdict.SATISFIED
    }
    unseen = [
        _behind_its_sample(f.span)
        for key, f in cleared.items()
        if before[key].verdict is Verdict.INCONCLUSIVE and f.span
    ]
    seen = [f for key, f in cleared.items() if before[key].verdict is not Verdict.INCONCLUSIVE or not f.span]
    violated = [f.span for key, f in decided.items() if _is_confirmed(before[key], f) and f.span]
    cut = _Cut.of(seen, unseen, merged(violated), one)
    worst = {key: left for key, f in one.worst.items() if (left := cut.worst(f)) is not None}
    best = {key: left for key, f in one.best.items() if (left := cut.best(f)) is not None}
    room = {name: _total(name, one.worst) - _total(name, one.best) for name in TIMES}
    pause_s = known.pauses_s.get(one.check, 0.0)
    # What is satisfied first: whether a world says so may not hang on what else is not applicable.
    for key, finding in sorted(
        decided.items(), key=lambda item: (item[1].verdict is not Verdict.SATISFIED, item[1].span or _ALWAYS)
    ):
        there = _within(finding, one.worst) if _is_confirmed(before[key], finding) else None
        if there is None:
            for world in (best, worst):
                # A check says something in every world. A gap that is cleared says no more than that.
                if not world or Verdict.INCONCLUSIVE is not before[key].verdict or _is_violated(finding):
                    world[key] = finding if _is_violated(finding) else _cleared(finding)
            continue
        # What all gaps have together is not more than the worst world has.
        taken = {name: min(n, max(0.0, room.get(name, n))) for name, n in there.quantities.items()}
        room = {name: left - taken.get(name, 0.0) for name, left in room.items()}
        _add(replace(there, quantities=taken), key, best, pause_s)
    return replace(one, best=best, worst=worst, tight=False)


# What a gap takes that is called violated ----------------------------------------------------------


def _total(name: str, world: Mapping[str, Finding]) -> float:
    return sum(f.quantities.get(name, 0.0) for f in world.values() if _is_violated(f))


def _is_violated(finding: Finding) -> bool:
    return finding.verdict is Verdict.VIOLATED


def _cleared(finding: Finding) -> Finding:
    """A finding of which nothing is left to be priced."""
    return replace(finding, quantities={}, units={})


def _within(finding: Finding, world: Mapping[str, Finding]) -> Finding | None:
    """A finding as the violation that a world has within its time; `None` where it has none."""
    within = finding.span or _ALWAYS
    pieces = [
        (one, [piece for step in _steps(one) if (piece := _clipped(step, within))[0] < piece[1]])
        for one in filter(_is_violated, world.values())
    ]
    found = [(one, steps) for one, steps in pieces if steps]
    if not found:
        return None
    steps = sorted(step for _, own in found for step in own)
    deepest = max((one for one, _ in found), key=lambda one: one.quantities.get(DEPTH, 0.0))
    sums = {
        TIME: sum(end_s - start_s for start_s, end_s, _ in steps),
        DEPTH: sum((end_s - start_s) * depth for start_s, end_s, depth in steps),
        "relative_depth_max": max(depth for _, _, depth in steps),
    }
    return replace(
        finding,
        verdict=Verdict.VIOLATED,
        span=Span(steps[0][0], steps[-1][1]),
        # Of what a profile does not say, at least nothing.
        quantities={name: sums.get(name, 0.0) for name in deepest.quantities},
        units=deepest.units,
        critical=any(one.critical for one, _ in found),
        profile=_profile_of(steps) if deepest.profile is not None else None,
    )


def _clipped(step: _Step, span: Span) -> _Step:
    return max(step[0], span.start_s), min(step[1], span.end_s), step[2]


def _add(violation: Finding, key: str, world: dict[str, Finding], pause_s: float) -> None:
    """Add a violation to a world: to the one that it is one with, or as one of its own."""
    for name, one in world.items():
        if _is_violated(one) and _are_one(one, violation, pause_s):
            quantities = {
                n: max(v, violation.quantities.get(n, v))
                if _is_greatest(n)
                else v + violation.quantities.get(n, 0.0)
                for n, v in one.quantities.items()
            }
            critical = one.critical or violation.critical
            world[name] = replace(_around(one, violation), quantities=quantities, critical=critical)
            return
    world[key] = violation


def _around(one: Finding, other: Finding) -> Finding:
    """A violation that lasts until the end of another one, where that lies beside it."""
    spans = [each for each in (_extent(one), _extent(other)) if each is not None]
    if spans[0].overlaps(spans[1]) or one.profile is None or other.profile is None:
        return one
    span = Span(min(each.start_s for each in spans), max(each.end_s for each in spans))
    return replace(one, span=span, profile=joined_profiles([one.profile, other.profile]))


def _are_one(one: Finding, other: Finding, pause_s: float) -> bool:
    """Whether no pause is between two violations that is long enough for them to be two."""
    (first, second) = (_extent(each) for each in (one, other))
    if first is None or second is None:
        return False
    return max(first.start_s, second.start_s) - min(first.end_s, second.end_s) < max(pause_s, _SLIVER_S)


def _extent(violation: Finding) -> Span | None:
    """From its beginning to its end; that of several counted as one is longer than its span."""
    if violation.profile is None:
        return violation.span
    return Span(violation.profile.t_s[0], violation.profile.t_s[-1])


# What lies beside what is cleared ------------------------------------------------------------------


@dataclass(frozen=True)
class _Cut:
    """Stretches in which stewards say that nothing was violated.

    Attributes:
        spans: The stretches, in time order.
        unseen: Those of them that are gaps, each as its finding has it.
        certain: The violations that every world has, with the least that each had within them.
        beside: Where else a violation may have been: in the best world, or in a gap; `None` where not all
            gaps were kept.
    """

    spans: Sequence[Span]
    unseen: Sequence[Span]
    certain: Sequence[Finding]
    beside: Sequence[Span] | None

    @classmethod
    def of(
        cls, cleared: Sequence[Finding], unseen: Sequence[Span], violated: Sequence[Span], one: OpenFindings
    ) -> _Cut:
        """The stretches of what is cleared, but for those of them that are called violated."""
        # A finding without a time is about all of it.
        whole = merged([*(_ALWAYS if finding.span is None else finding.span for finding in cleared), *unseen])
        steps = (each for span in whole for each in _beside((span.start_s, span.end_s, 1.0), violated))
        spans = [Span(start_s, end_s) for start_s, end_s, _ in steps]
        in_best = [finding for finding in one.best.values() if _is_violated(finding)]
        certain = [_less(f, violated) for f in in_best if (own := _extent(f)) and _is_in(own, whole)]
        known = [Span(start_s, end_s) for f in in_best for start_s, end_s, _ in _steps(f)]
        gaps = [span for cause in one.causes for span in cause.spans]
        are_all = gaps and all(0 < len(cause.spans) < MOST_SPANS for cause in one.causes)
        return cls(spans, unseen, certain, merged([*known, *gaps]) if are_all else None)

    def worst(self, finding: Finding) -> Finding | None:
        """The most that a violation of the worst world can have beside the stretches; `None`: nothing."""
        left = self._left(finding)
        if left is None or left is finding:
            return left
        gone = self._certain_of(finding)
        shares = [
            (step[1] - step[0] if self.beside is None else _overlap_s(step, self.beside), step[2])
            for step in _steps(left)
        ]
        most = {
            TIME: sum(seconds for seconds, _ in shares),
            DEPTH: sum(seconds * depth for seconds, depth in shares),
        }
        quantities = {
            name: value
            if _is_greatest(name)
            else min(max(0.0, value - gone.get(name, 0.0)), most.get(name, inf))
            for name, value in finding.quantities.items()
        }
        return replace(left, quantities=quantities)

    def _certain_of(self, finding: Finding) -> dict[str, float]:
        """What a violation of the worst world certainly had within the stretches, by quantity."""
        whole = _extent(finding)
        every = [one for one in self.certain if (own := _extent(one)) and whole and _is_in(own, [whole])]
        found: dict[str, float] = {}
        for one in every:
            for name, value in one.quantities.items():
                found[name] = found.get(name, 0.0) + value
        # A step of a profile that goes beyond a gap may be a valley that was filled; one within it is none.
        tips = [
            step for span in self.unseen for step in _steps(finding) if _is_in(Span(step[0], step[1]), [span])
        ]
        found[TIME] = max(found.get(TIME, 0.0), sum(end_s - start_s for start_s, end_s, _ in tips))
        found[DEPTH] = max(found.get(DEPTH, 0.0), sum((e - s) * depth for s, e, depth in tips))
        return found

    def best(self, finding: Finding) -> Finding | None:
        """The least that a violation of the best world had beside the stretches; `None`: nothing."""
        left = self._left(finding)
        if left is None or left is finding:
            return left
        return replace(left, quantities=_less(finding, self.spans, self.unseen).quantities)

    def _left(self, finding: Finding) -> Finding | None:
        """A violation beside the stretches, as one in however many pieces; `None` where none is left."""
        if not _is_violated(finding):
            return finding
        if finding.span is None:
            return finding if _ALWAYS not in self.spans else None
        steps = _steps(finding)
        if not steps:
            return None if _is_in(finding.span, self.spans) else finding
        if not any(_overlap_s(step, self.spans) for step in steps):
            return finding
        left = [piece for step in steps for piece in _beside(step, self.spans)]
        if sum(end_s - start_s for start_s, end_s, _ in left) <= _SLIVER_S:
            return None
        return replace(finding, span=Span(left[0][0], left[-1][1]), profile=_profile_of(left))


def _steps(finding: Finding) -> list[_Step]:
    """When a violation was, and how deep; as deep as can be where it has no depth."""
    if finding.profile is not None:
        return list(finding.profile.steps())
    span = finding.span
    return [(span.start_s, span.end_s, 1.0)] if span is not None and span.duration_s > 0 else []


def _behind_its_sample(gap: Span) -> Span:
    return Span(min(gap.start_s + _INSTANT_S, gap.end_s), gap.end_s)


def _less(finding: Finding, spans: Sequence[Span], unseen: Sequence[Span] = ()) -> Finding:
    """A violation with the least that it had outside of stretches, some of which are gaps.

    A step of a profile that goes beyond a gap is a valley that was filled, and nothing of it was in the gap.
    """
    gaps = merged(unseen)

    def within_s(step: _Step) -> float:
        is_filled = not _is_in(Span(step[0], step[1]), gaps)
        return max(0.0, _overlap_s(step, spans) - (_overlap_s(step, gaps) if is_filled else 0.0))

    inside = [(step, within_s(step)) for step in _steps(finding)]
    gone = {
        TIME: sum(seconds for _, seconds in inside),
        DEPTH: sum(seconds * step[2] for step, seconds in inside),
    }
    if not gone[TIME]:
        return finding
    quantities = {
        name: value if name == "exposure_s" else max(0.0, value - gone.get(name, inf))
        for name, value in finding.quantities.items()
    }
    return replace(finding, quantities=quantities)


def _profile_of(steps: Sequence[_Step]) -> DepthProfile:
    return joined_profiles([DepthProfile((start_s, end_s), (depth, 0.0)) for start_s, end_s, depth in steps])


def _overlap_s(step: _Step, spans: Sequence[Span]) -> float:
    """How much of a step lies in stretches, which are in time order and apart."""
    found = 0.0
    for span in _from(step[0], spans):
        if span.start_s >= step[1]:
            break
        found += max(0.0, min(step[1], span.end_s) - max(step[0], span.start_s))
    return found


def _from(start_s: float, spans: Sequence[Span]) -> Iterator[Span]:
    """Those of the stretches that end no earlier."""
    return islice(spans, bisect_left(spans, start_s, key=lambda span: span.end_s), None)


def _beside(step: _Step, spans: Sequence[Span]) -> Iterator[_Step]:
    """The pieces of a step outside of stretches, which are in time order."""
    start_s, end_s, depth = step
    for span in _from(start_s, spans):
        if span.start_s >= end_s:
            break
        if span.start_s > start_s:
            yield start_s, span.start_s, depth
        start_s = max(start_s, span.end_s)
    if start_s < end_s:
        yield start_s, end_s, depth


def _is_in(span: Span, spans: Sequence[Span]) -> bool:
    return any(
        each.start_s - _SLIVER_S <= span.start_s and span.end_s <= each.end_s + _SLIVER_S for each in spans
    )


def _is_greatest(name: str) -> bool:
    """Whether a quantity is the most at any time, and no sum over it."""
    return "max" in name or name == "exposure_s"
