"""Both worlds of what nothing bounds: kept at best where samples lack, and broken at full depth at worst."""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

from ariac_score.checks.depth import DepthProfile, joined_profiles
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.open_findings import Cause, Worlds
from ariac_score.monitors.causes import causes_of_spans
from ariac_score.monitors.cells import TOLERANCE_S, Stream
from ariac_score.monitors.limits import DEPTHS
from ariac_score.monitors.pauses import (
    beginning_in,
    in_time_order,
    meeting,
    one_by_one,
    profile_of,
    together,
    touch,
    violations_of,
    without,
    without_these,
)
from ariac_score.monitors.worsening import Worsening
from ariac_score.trial.model import Trial
from ariac_score.trial.spans import Span, merged
from ariac_score.trial.sums import exact_sum

__all__ = ["Judged", "blunt_worlds", "nothing_broken", "whole_window"]


@dataclass(frozen=True)
class Judged:
    """A limit of a monitor, in the worst world as far as samples show it.

    Attributes:
        broken: When it was, as samples stand, however briefly.
        findings: What was found of it.
        depth: How deep in each of these; empty: as deep as can be.
        by_course: Whether the monitor says that its findings are of what takes a course.
    """

    broken: Sequence[Span]
    findings: Sequence[Finding]
    depth: Sequence[DepthProfile] = ()
    by_course: bool = False

    @property
    def is_told(self) -> bool:
        """Whether its violations are the stretches in which it was broken, not what takes a course."""
        when_kept = (one.span for one in self.findings if one.verdict is Verdict.SATISFIED)
        if self.by_course or any(when_kept):  # nobody asks when a limit was kept
            return False
        begins_s = [one.start_s for one in self.broken]
        for violation in violations_of(self.findings):
            start_s = violation.span.start_s if violation.span else math.nan
            row = bisect_left(begins_s, start_s - TOLERANCE_S)
            if row == len(begins_s) or not begins_s[row] <= start_s + TOLERANCE_S:
                return False
        return True


def blunt_worlds(
    subject: str,
    monitor: Worsening,
    readings: Sequence[Sequence[Judged]],
    opened: Sequence[Stream],
    spans: Sequence[Span],
    *,
    courses: Sequence[Span] = (),
    limits: int = 1,
    at_worst: Sequence[Finding] | None = None,
) -> Worlds:
    """Both worlds where nothing says what can have been in some spans.

    Args:
        subject: Whom they are about.
        monitor: What it measures.
        readings: What the samples show, by limit, in each way in which they may be read: that what was before
            a gap goes on behind it, or that it does not.
        opened: The streams that lack samples.
        spans: Where they do; at least one.
        courses: What is judged each by itself.
        limits: How many limits it has: one that nothing shows may have been broken, too.
        at_worst: What may have been at worst; `None`: whatever was seen, and all of what is hidden.
    """
    # What a monitor itself leaves undecided may be due to what else it reads, and a gap hides.
    undecided = [
        finding.span
        for limits in readings
        for limit in limits
        for finding in limit.findings
        if finding.verdict is Verdict.INCONCLUSIVE and finding.span is not None
    ]
    hidden = merged([*spans, *undecided], within_s=TOLERANCE_S)
    least = [
        [one for limit in limits for one in _fewest(limit, hidden, monitor)]
        or [nothing_broken(subject, monitor)]
        for limits in readings
    ]
    most = (
        [_most(subject, hidden, monitor, _all_limits(judged, limits), courses) for judged in readings]
        if at_worst is None
        else [list(at_worst)]
    )
    best, worst = _least_of(least), _most_of(most)
    if all(one.verdict is Verdict.NOT_APPLICABLE for one in best):  # or it applied in a gap, and was kept
        best = [nothing_broken(subject, monitor)]
    return Worlds(subject, tuple(best), tuple(worst), causes_of_spans(opened, spans))


def _all_limits(judged: Sequence[Judged], limits: int) -> list[Judged]:
    return [*judged, *[Judged((), ())] * (limits - len(judged))]


def _lasting(findings: Sequence[Finding]) -> float:
    """How long violations last, s."""
    return exact_sum(one.quantities.get("time_in_violation_s", 0.0) for one in violations_of(findings))


def _pressing(findings: Iterable[Finding]) -> float:
    """The depth of violations over time, s; where a violation has none, with the pauses that it bridges."""
    return exact_sum(_area(profile_of(one)) for one in violations_of(findings))


def _area(profile: DepthProfile) -> float:
    return exact_sum((ends_s - begins_s) * deep for begins_s, ends_s, deep in profile.steps())


def _least_of(readings: Sequence[list[Finding]]) -> list[Finding]:
    """The violations that last the shortest, and no more of them than in any other reading."""
    number = min(len(violations_of(one)) for one in readings)
    shortest = min(readings, key=lambda one: (_lasting(one), _pressing(one), len(violations_of(one))))
    rest = violations_of(shortest)[max(number, 1) - 1 :]
    if len(rest) < 2:
        return shortest
    return [*without_these(shortest, rest), together(rest)]


def _most_of(readings: Sequence[list[Finding]]) -> list[Finding]:
    """The violations that last the longest, and no fewer of them than in any other reading."""
    number = max(len(violations_of(one)) for one in readings)
    longest = max(readings, key=lambda one: (_lasting(one), _pressing(one), len(violations_of(one))))
    own = violations_of(longest)
    further = [touch(one, one.span.start_s) for one in own[:1] if one.span for _ in range(number - len(own))]
    return [*longest, *further]


def _touches(finding: Finding, hidden: Sequence[Span]) -> bool:
    """Whether a violation is hidden in part."""
    if finding.verdict is not Verdict.VIOLATED:
        return False
    return bool(hidden if finding.span is None else meeting(hidden, finding.span))


def _fewest(limit: Judged, hidden: Sequence[Span], monitor: Worsening) -> list[Finding]:
    """What was found, without what is hidden of it; violations that no pause need part are one."""
    decided = [one for one in limit.findings if one.verdict is not Verdict.INCONCLUSIVE]
    if not limit.is_told:  # what a gap hides of its course may have made it none
        decided = [one for one in decided if not _touches(one, hidden)]
    # Where a verdict rests on the samples beside it, too, one alone shows no instant of its own.
    alone = monitor.beside == 0 and monitor.shows_itself
    shown = [
        one
        for each in decided
        if (one := _shown_of(each, hidden, limit.broken, alone=alone, t_on_s=monitor.t_on_s))
    ]
    found = [one for one in shown if one.verdict is not Verdict.VIOLATED or _lasts(one, monitor.t_on_s)]
    violations = in_time_order(violations_of(found))
    known = [one.span for one in violations if one.span]
    rows = [one for one in found if one.verdict is not Verdict.VIOLATED or one.span is None]
    # What is too short for a violation may part two no longer, together with what is hidden around it.
    for whole in merged([*hidden, *known, *limit.broken], within_s=_near_s(monitor)):
        inside = beginning_in(violations, whole)
        joined = one_by_one(inside)
        rows += [together(joined)] if len(joined) > 1 else joined
        rows += without_these(inside, joined)
    return rows


def _lasts(violation: Finding, least_s: float) -> bool:
    return violation.quantities.get("time_in_violation_s", math.inf) >= least_s - TOLERANCE_S


def _near_s(monitor: Worsening) -> float:
    """Stretches no further from each other than this may be one violation, s."""
    return max(monitor.t_off_s - TOLERANCE_S, TOLERANCE_S)


def _shown_of(
    violation: Finding, hidden: Sequence[Span], broken: Sequence[Span], *, alone: bool, t_on_s: float
) -> Finding | None:
    """A violation without what is hidden of it; `None`: nothing shows it.

    Args:
        violation: As samples stand.
        hidden: Where nothing shows what was.
        broken: When its limit was broken.
        alone: Whether a sample by itself shows its own instant.
        t_on_s: Shortest stretch that a violation begins with, s.
    """
    whole = violation.span
    if violation.verdict is not Verdict.VIOLATED or whole is None:
        return violation
    parts = [
        Span(max(span.start_s, whole.start_s), min(span.end_s, whole.end_s))
        for span in meeting(hidden, whole)
        if span.start_s < whole.end_s and span.end_s > whole.start_s
    ]
    if not parts:
        return violation
    quantities = dict(violation.quantities)
    own = meeting(broken, whole)
    lasts_s = quantities.get("time_in_violation_s", 0.0)
    hidden_s, span = _measure(parts), whole
    if own:
        left = [shown for one in own for shown in without(one, meeting(parts, one))]
        begins = (row for row, one in enumerate(left) if one.duration_s >= t_on_s - TOLERANCE_S)
        first = next(begins, len(left))
        parts, left = merged([*parts, *left[:first]]), left[first:]
        if not (left or alone):
            return None
        hidden_s = lasts_s - _measure(left)
        span = Span(left[0].start_s, left[-1].end_s) if left else whole
    for most, over_time in (("", "time_in_violation_s"), *DEPTHS):
        if over_time in quantities:
            at_most = quantities.get(most, 1.0)
            quantities[over_time] = max(0.0, quantities[over_time] - at_most * hidden_s)
    profile = _shallowest(profile_of(violation), parts, alone=alone)
    return replace(violation, span=span, quantities=quantities, profile=profile)


def _most(
    subject: str,
    hidden: Sequence[Span],
    monitor: Worsening,
    judged: Sequence[Judged],
    courses: Sequence[Span] = (),
) -> list[Finding]:
    """What was seen to be broken, and all that is hidden, at full depth.

    What no pause parts is one violation, whether it was seen or hidden: else whoever hides one that was seen
    would have one less.
    """
    seen = [one for limit in judged for one in limit.findings]
    open_verdicts, told = {Verdict.INCONCLUSIVE}, all(limit.is_told for limit in judged)
    if not told:  # it judges courses, of which a gap may hide a part
        judged, open_verdicts = [Judged((), seen)], {Verdict.INCONCLUSIVE, Verdict.SATISFIED}
    rows = [one for one in seen if one.verdict is Verdict.VIOLATED and one.span is None]
    for limit in judged:
        violations = in_time_order(violations_of(limit.findings))
        undecided = in_time_order(
            one
            for one in limit.findings
            if one.verdict in open_verdicts and one.span is not None and meeting(hidden, one.span)
        )
        # A violation may go on where its limit is kept, as a contact does.
        lasting = merged(one.span for one in violations if one.span)
        spans = limit.broken or lasting
        # A course of which a part is hidden may have been bad as a whole.
        as_a_whole = [] if told else [one.span for one in undecided if one.span]
        for whole in merged([*hidden, *spans, *lasting, *as_a_whole], within_s=_near_s(monitor)):
            inside = beginning_in(violations, whole)
            parts, shown = meeting(hidden, whole), meeting(spans, whole)
            may_be = merged(
                (one.span for one in beginning_in(undecided, whole) if one.span), within_s=_near_s(monitor)
            )
            each = [one for one in courses if one.overlaps(whole)]
            if not parts:
                rows += inside
                continue
            deep = [one for one in limit.depth if one.t_s[0] < whole.end_s and one.t_s[-1] > whole.start_s]
            rows += _all_of(subject, whole, parts, shown, inside, may_be, each, monitor, seen, deep)
    return rows


def _all_of(
    subject: str,
    whole: Span,
    parts: Sequence[Span],
    shown: Sequence[Span],
    inside: Sequence[Finding],
    may_be: Sequence[Span],
    each: Sequence[Span],
    monitor: Worsening,
    seen: Sequence[Finding],
    deep: Sequence[DepthProfile],
) -> list[Finding]:
    """One violation that lasts all of what is hidden and was seen around it, as often as pauses fit into it.

    Args:
        subject: Whom it is about.
        whole: From where to where.
        parts: What is hidden of it; at least one.
        shown: When the limit was seen to be broken, however briefly.
        inside: The violations that were found.
        may_be: When further ones may have been, each of its own.
        each: What is judged each by itself.
        monitor: What it measures.
        seen: All that was found.
        deep: How deep the limit was broken where it was seen to be; empty: as deep as can be.
    """
    counted = [one.span for one in inside if one.span]
    long = merged(counted)
    # Too short to be found by themselves, they may be part of what is hidden.
    brief = [one for one in shown if not meeting(long, one)]
    shallow = [one for one in deep if meeting(brief, Span(one.t_s[0], one.t_s[-1]))]
    full = merged(parts if deep else [*parts, *brief])
    # Of what takes its course, several that overlap last longer than the time in which one of them did.
    lasts_s = max(_measure([*parts, *shown]), _one_over_another(inside, parts))
    deep_s = [_measure(full), *(one.quantities.get("relative_depth_integral_s", lasts_s) for one in inside)]
    deep_s += [_area(one) for one in shallow]
    known = {
        "time_in_violation_s": lasts_s,
        "relative_depth_max": 1.0,
        "relative_depth_integral_s": min(lasts_s, exact_sum(deep_s)),
        "exposure_s": max([_measure(parts), *(one.quantities.get("exposure_s", 0.0) for one in seen)]),
    }
    from_s, to_s = parts[0].start_s, parts[-1].end_s
    message = f"nothing shows that the limit was kept, from {from_s:.3f} s to {to_s:.3f} s"
    worst = Finding(
        subject,
        Verdict.VIOLATED,
        "; ".join([*_told_of(inside), message]),
        span=whole,
        quantities={name: n for name, n in known.items() if name in monitor.measures},
        clause=monitor.clause,
        critical=monitor.critical or any(one.critical for one in seen),
        profile=_deepest(full, inside, shallow) if inside or shallow or len(full) > 1 else None,
    )
    rows = [worst]
    certain = [left for span in shown for left in without(span, meeting(parts, span))]
    bad = [*parts, *shown, *counted]  # the rest of a course is bad only together with these
    for span in without(Span(min(bad).start_s, max(one.end_s for one in bad)), certain):
        rows += [touch(worst, t_s) for t_s in _after_pauses(span, parts, monitor.t_off_s)]
    # What is judged each by itself, as after a stop, is not one with the others for want of a pause.
    rows += [touch(worst, max(span.start_s, whole.start_s)) for span in each[1:]]
    # Of what is no limit, several may be bad at once.
    at_once = [*counted, *may_be]
    return rows + [touch(worst, span.start_s) for span in at_once[len(rows) :]]


def _told_of(violations: Sequence[Finding]) -> list[str]:
    """What was found of several violations, in words; of more than two only how many more there are."""
    told = [one.message for one in violations[:1]]
    return told + ([f"{len(violations) - 1} more were seen"] if len(violations) > 1 else [])


def _after_pauses(span: Span, parts: Sequence[Span], pause_s: float) -> list[float]:
    """When a violation that begins with a span may begin again within it, or at its end, after pauses, s."""
    found: list[float] = []
    next_s = span.start_s + pause_s
    while pause_s > 0.0 and next_s <= span.end_s + TOLERANCE_S:
        part = bisect_left(parts, next_s - TOLERANCE_S, key=lambda one: one.end_s)
        begins_s = max(next_s, parts[part].start_s) if part < len(parts) else span.end_s
        found.append(min(begins_s, span.end_s))
        next_s = found[-1] + pause_s
    return found


def _one_over_another(violations: Sequence[Finding], parts: Sequence[Span]) -> float:
    """How long violations that overlap each other last, and what is hidden besides, s; 0 of others."""
    spans = [one.span for one in violations if one.span]
    if len(one_by_one(violations)) == len(violations):
        return 0.0
    each = exact_sum(one.quantities.get("time_in_violation_s", 0.0) for one in violations)
    shown = merged(spans)
    left = (left for part in parts for left in without(part, meeting(shown, part)))
    return exact_sum([each, _measure(left)])


def _measure(spans: Iterable[Span]) -> float:
    """How long they last together, s."""
    return exact_sum(one.duration_s for one in merged(spans))


def _shallowest(profile: DepthProfile, hidden: Sequence[Span], *, alone: bool) -> DepthProfile:
    """No depth where it is hidden, but for the instant that was the deepest, if its sample alone shows it."""
    ends = {t for one in hidden for t in (one.start_s, one.end_s)}
    t_s = sorted({*profile.t_s, *ends})
    depth = [0.0 if _is_in(hidden, t) else profile.at(t) for t in t_s]
    instants = [(t, deep) for t, deep in _instants(profile) if not _is_in(hidden, t)]
    most, at_s = max(zip(profile.depth, profile.t_s, strict=True), key=lambda one: one[0])
    if alone and max([*depth, *(deep for _, deep in instants)]) < most:
        instants.append((at_s, most))
    return _profile(t_s, depth, instants)


def _instants(profile: DepthProfile) -> list[tuple[float, float]]:
    """Times and depths of the steps of no length, such as of the last sample of a competition."""
    steps = zip(pairwise(profile.t_s), profile.depth, strict=False)
    return [(begins_s, deep) for (begins_s, ends_s), deep in steps if begins_s == ends_s and deep > 0.0]


def _profile(
    t_s: Sequence[float], depth: Sequence[float], instants: Sequence[tuple[float, float]]
) -> DepthProfile:
    """A profile of steps, the last of which has no depth, and of instants, each before the step then."""
    steps = sorted([*instants, *zip(t_s, depth, strict=True)], key=lambda one: one[0])
    return DepthProfile(tuple(at for at, _ in steps), (*(deep for _, deep in steps[:-1]), 0.0))


def _is_in(spans: Sequence[Span], t_s: float) -> bool:
    """Whether a time lies in one of some spans in time order, but for its end."""
    row = bisect_right(spans, t_s, key=lambda one: one.start_s) - 1
    return row >= 0 and t_s < spans[row].end_s


def _deepest(parts: Sequence[Span], seen: Sequence[Finding], brief: Sequence[DepthProfile]) -> DepthProfile:
    """Full depth in all parts, and what was seen between them."""
    profiles = [profile_of(one) for one in seen]
    if len(one_by_one(seen)) == len(seen) > 0:
        profiles = [joined_profiles(profiles)]
    profiles += brief
    ends = {t for one in parts for t in (one.start_s, one.end_s)}
    ends |= {t for one in profiles for t in one.t_s}
    t_s = tuple(sorted(ends)) if len(ends) > 1 else (*ends, *ends)  # a competition of one instant
    depth = [1.0 if _is_in(parts, t) else max((one.at(t) for one in profiles), default=0.0) for t in t_s]
    instants = [one for profile in profiles for one in _instants(profile) if not _is_in(parts, one[0])]
    return _profile(t_s, depth, instants)


def whole_window(
    trial: Trial,
    subject: str,
    monitor: Worsening,
    why: str,
    *,
    seen: Worlds | None = None,
    certain: Sequence[Finding] = (),
    courses: Sequence[Span] = (),
    limits: int = 1,
    at_worst: Sequence[Finding] | None = None,
) -> Worlds | None:
    """What is open where nothing shows a subject in the whole competition; `None` without a window.

    Args:
        trial: The trial.
        subject: Whom it is about.
        monitor: What it measures.
        why: In words.
        seen: What was found all the same.
        certain: What is found in every competition that may have been.
        courses: What is judged each by itself.
        limits: How many limits it has.
        at_worst: What may have been at worst; `None`: all limits were broken throughout.
    """
    window = trial.window
    if trial.between is None or window is None:
        return None
    worst: tuple[Finding, ...] = () if seen is None else seen.worst
    judged = _all_limits([Judged((), worst)], limits)
    broken = _most(subject, [window], monitor, judged, courses) if at_worst is None else at_worst
    kept = [one for one in certain if one.verdict is not Verdict.INCONCLUSIVE]
    best = tuple(kept) or (nothing_broken(subject, monitor),)
    cause = Cause(why, spans=(window,))
    causes = (cause,) if seen is None else (cause, *seen.causes)
    return Worlds(subject, best, tuple(broken), causes)


def nothing_broken(subject: str, monitor: Worsening) -> Finding:
    """That the limit was kept, of whom nothing shows it."""
    measures = monitor.measures
    quantities = {name: one.reference for name, one in measures.items() if one.reference is not None}
    quantities |= {"exposure_s": 0.0} if "exposure_s" in measures else {}
    kept = Finding.satisfied(subject, "nothing shows that the limit was broken", clause=monitor.clause)
    return replace(kept, quantities=quantities)
