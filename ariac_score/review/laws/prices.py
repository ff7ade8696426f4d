"""Laws of prices that exclude each other or other laws, so that a rule set has to choose between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from random import Random

from ariac_score.review.laws.cases import TICKS_PER_S, Case, Violation, World, draw_case, draw_violation
from ariac_score.review.laws.laws import LAWS, Broken, Law, Situation, margin_of, scores_of, without_safety
from ariac_score.scoring.expression import Number

__all__ = ["ALL_LAWS", "PRICE_LAWS"]


def _without_time(world: World) -> str:
    return without_safety(world) or ("" if world.watched else "every safety check is about single events")


def _without_depth(world: World) -> str:
    return _without_time(world) or ("" if world.graded else "no safety check measures depth")


# A further violation always costs ------------------------------------------------------


def _draw_further(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng, most_violations=2)
    more = replace(draw_violation(world, rng), critical=False)
    if case.violations and rng.random() < 0.5:  # beside, or soon after, one that is there
        first = case.violations[0]
        start = first.start + int(rng.random() * 2 * TICKS_PER_S)
        more = replace(more, pair=first.pair, start=start, end=start + more.end - more.start)
    return Situation(replace(case, failed=frozenset()), violation=more)


def _further(world: World, situation: Situation) -> Broken | None:
    extra, case = situation.violation, situation.case
    if extra is None or not _is_further(extra, case):
        return None
    after = replace(case, violations=tuple(sorted([*case.violations, extra])))
    before_score, after_score = scores_of(world, case, after)
    margin = margin_of(before_score, after_score)
    if before_score <= margin or after_score < before_score - margin:
        return None
    return Broken("as it is", before_score, f"with one more violation, {extra}", after_score)


def _is_further(extra: Violation, case: Case) -> bool:
    """Whether it violates at an instant at which its check does not see these two bodies violate already."""
    same = [v for v in case.violations if (v.check, v.pair) == (extra.check, extra.pair)]
    if extra.end == extra.start:
        return all(v.start != extra.start for v in same)
    covered = {tick for v in same for tick in range(v.start, v.end)}
    return not set(range(extra.start, extra.end)) <= covered


# Where nothing is left, a further violation still counts ---------------------------------


def _draw_after(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng, most_violations=0)
    worst = replace(draw_violation(world, rng), critical=rng.random() < 0.7)
    length = 0 if worst.check in world.events else 1
    count = 1 if worst.critical else 40
    apart = round(world.t_off_s(worst.check) * TICKS_PER_S) + 5
    again = tuple(replace(worst, start=n * apart, end=n * apart + length) for n in range(count))
    later = replace(draw_violation(world, rng), pair=worst.pair, critical=False)
    later = replace(later, start=case.duration - 50, end=case.duration - 50 + later.end - later.start)
    return Situation(replace(case, failed=frozenset(), violations=again), violation=later)


def _after(world: World, situation: Situation) -> Broken | None:
    extra, case = situation.violation, situation.case
    if extra is None or any(v.end + _APART > extra.start for v in case.violations):
        return None
    more = replace(case, violations=tuple(sorted([*case.violations, extra])))
    clean, before, after = scores_of(world, replace(case, violations=()), case, more)
    margin = margin_of(clean, before, after)
    if clean <= margin or abs(before) > margin or after < before - margin:
        return None
    if world.is_behind(more, case):
        return None
    return Broken("as it is", before, f"with one more violation, {extra}; no tie-break tells", after)


_APART = 20 * TICKS_PER_S
"""Ticks: no penalty takes violations so far apart for one."""

# A deeper violation costs more ---------------------------------------------------------


def _draw_deeper(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng, most_violations=0)
    violation = draw_violation(world, rng, shortest=TICKS_PER_S)
    check = world.graded[int(rng.random() * len(world.graded))]
    shallow = replace(violation, check=check, depth=0.1, critical=False)
    shallow = replace(shallow, end=max(shallow.end, shallow.start + TICKS_PER_S))
    return Situation(replace(case, failed=frozenset()), violation=shallow)


def _deeper(world: World, situation: Situation) -> Broken | None:
    shallow, case = situation.violation, situation.case
    if shallow is None or shallow.depth >= 1:
        return None
    deep = replace(shallow, depth=1.0)
    at_edge, at_full = scores_of(
        world, *(replace(case, violations=tuple(sorted([*case.violations, one]))) for one in (shallow, deep))
    )
    margin = margin_of(at_edge, at_full)
    if at_edge <= margin or at_full < at_edge - margin:
        return None
    return Broken(f"with {shallow}", at_edge, "as deep as can be, for as long", at_full)


# No cliff ------------------------------------------------------------------------------

_LENGTHS = (1, 10, 50, 100, 200, 400, 599)
"""Ticks: between these a step is looked for by halving where most is lost."""

_STEEPEST = 10
"""A step this many times as high as those beside it is a cliff, and not a slope."""

_LEAST_CLIFF = 0.01
"""Of what the trial is worth without violations: what is lower is no cliff to anybody."""


def _draw_cliff(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng, most_violations=0)
    check = world.watched[int(rng.random() * len(world.watched))]
    violation = Violation(check, 0, 0, _LENGTHS[-1], depth=(1.0, 0.5)[int(rng.random() * 2)])
    return Situation(replace(case, failed=frozenset()), violation=violation)


def _cliff(world: World, situation: Situation) -> Broken | None:
    violation, case = situation.violation, situation.case
    if violation is None or violation.end <= violation.start + 3:
        return None

    def score(length: int, *, critical: bool = False) -> Number:
        one = replace(violation, end=violation.start + length, critical=critical)
        return scores_of(world, replace(case, violations=(*case.violations, one)))[0]

    (clean,) = scores_of(world, case)
    least = max(_LEAST_CLIFF * abs(clean), margin_of(clean))
    at_end = violation.end - violation.start
    if abs(score(at_end) - score(at_end, critical=True)) > least:
        words = f"the same, a hair deeper, where {violation.check} calls it critical"
        return Broken(f"with {violation}", score(at_end), words, score(at_end, critical=True))
    for low, high in pairwise(_LENGTHS):
        at = _highest_step(score, low, min(high, at_end))
        if at is not None and _is_cliff(score, at, least):
            before, after = (f"{ticks / TICKS_PER_S:g} s of {violation.check}" for ticks in (at, at + 1))
            return Broken(f"after {before}", score(at), f"after {after}", score(at + 1))
    return None


def _highest_step(score: Callable[[int], Number], low: int, high: int) -> int | None:
    """The length after which one more tick costs most, found by halving."""
    if high <= low:
        return None
    while high - low > 1:
        middle = (low + high) // 2
        lower, upper = abs(score(middle) - score(low)), abs(score(high) - score(middle))
        low, high = (low, middle) if lower / (middle - low) > upper / (high - middle) else (middle, high)
    return low


def _is_cliff(score: Callable[[int], Number], at: int, least: float) -> bool:
    if at < 2:  # nothing is known of what comes before it
        return False
    step = abs(score(at + 1) - score(at))
    beside = max(abs(score(at) - score(at - 1)), abs(score(at + 2) - score(at + 1)))
    return step > least and step > _STEEPEST * beside


# Running again changes nothing ---------------------------------------------------------


def _over_one_run(world: World) -> str:
    if world.rule_set.sheet.pooled:
        return ""
    return "each run is scored for itself; how several runs of a team count, its ranking says"


def _draw_again(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng, most_violations=2)
    return Situation(replace(case, failed=frozenset()), ticks=2)


def _again(world: World, situation: Situation) -> Broken | None:
    if situation.ticks < 2:
        return None
    once, again = (world.score(situation.case, runs=runs) for runs in (1, situation.ticks))
    if once is None or again is None or abs(again - once) <= margin_of(once, again):
        return None
    return Broken("run once", once, "run twice, the second exactly as the first", again)


# Standing still is not charged for what the human does -----------------------------------


def _without_humans(world: World) -> str:
    if any(check in world.humans for check in world.safety):
        return ""
    return without_safety(world) or "no safety check says that it is about a machine and a human"


def _draw_still(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng, most_violations=0)
    among = [check for check in world.safety if check in world.humans]
    violation = replace(draw_violation(world, rng), check=among[int(rng.random() * len(among))])
    return Situation(replace(case, failed=frozenset()), violation=violation)


def _still(world: World, situation: Situation) -> Broken | None:
    met, case = situation.violation, situation.case
    if met is None or not world.humans.get(met.check):
        return None
    before, after = scores_of(world, case, replace(case, violations=tuple(sorted([*case.violations, met]))))
    if after >= before - margin_of(before, after):
        return None
    return Broken("the robot stands still", before, f"and a human walks up to it: {met}", after)


PRICE_LAWS: tuple[Law, ...] = (
    Law(
        "nothing_left",
        "where nothing is left, a further violation still counts",
        "a violation is added, long after others that have taken all the points; the score or what "
        "breaks ties must tell the two apart",
        without_safety,
        _draw_after,
        _after,
    ),
    Law(
        "always_costs",
        "a further violation always costs, until nothing is left",
        "a violation is added at an instant that was not violated, in half of the cases beside another one; "
        "a score above 0 must fall",
        without_safety,
        _draw_further,
        _further,
    ),
    Law(
        "severity",
        "a deeper violation costs more",
        "the only violation, at a tenth of the greatest depth, becomes as deep as can be; a score above 0 "
        "must fall; a check that measures no depth, as of contacts, is not asked",
        _without_depth,
        _draw_deeper,
        _deeper,
    ),
    Law(
        "no_cliff",
        "no small change of a violation changes the score by much",
        "a violation grows from a sample to a minute; no tenth of a second may cost a hundredth of the "
        "points and ten times as much as those beside it, and the step to what is critical none at all",
        _without_time,
        _draw_cliff,
        _cliff,
    ),
    Law(
        "running_again",
        "the same run again changes nothing",
        "a team makes the same run twice; the score stays",
        _over_one_run,
        _draw_again,
        _again,
    ),
    Law(
        "standing_still",
        "standing still is not charged for what the human does",
        "a human walks up to a robot that stands still; a check that finds a violation in that may not cost",
        _without_humans,
        _draw_still,
        _still,
    ),
)

ALL_LAWS: tuple[Law, ...] = (*LAWS, *PRICE_LAWS)
"""Every law."""
