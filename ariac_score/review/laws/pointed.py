"""Made trials at the edges of a rule set: of the numbers that its formulas name, and of those beside them.

Where a formula changes its mind at 25 violations or at 41 s, trials by chance seldom come near; who wants
more points reads the rules.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from random import Random
from typing import TypeVar

from ariac_score.review.laws.cases import TICKS_PER_S, Case, Violation, World, draw_violation
from ariac_score.review.laws.laws import Law, Situation

__all__ = ["pointed_draw"]

_MOST = 120
"""Violations in a case, and seconds that one lasts: more take long to price, and rules seldom name more."""

_One = TypeVar("_One")


def pointed_draw(law: Law, world: World, rng: Random) -> Situation:
    """A situation that the law may be tried in, with one or two of its numbers at an edge of the rules."""
    situation = law.draw(world, rng)
    for _ in range(1 + int(rng.random() * 2)):
        number = _pick(rng, world.numbers)
        situation = _pick(rng, _CHANGES)(world, situation, number, rng)
    return situation


def _pick(rng: Random, of: Sequence[_One]) -> _One:
    """One of them; `random()` alone is the same in every Python."""
    return of[int(rng.random() * len(of))]


def _beside(number: float, step: float, rng: Random) -> float:
    """The number, or one step below or above it."""
    return number + _pick(rng, (-step, 0.0, 0.0, step))


def _ticks(number: float, rng: Random) -> int:
    return max(1, round(min(_beside(number, 0.1, rng), _MOST) * TICKS_PER_S))


def _some(world: World, case: Case, rng: Random) -> Violation:
    return _pick(rng, case.violations) if case.violations else draw_violation(world, rng)


def _many(world: World, situation: Situation, number: float, rng: Random) -> Situation:
    """One violation as often as a number says, too far apart to be joined."""
    if not world.safety:
        return situation
    one = _some(world, situation.case, rng)
    length = one.end - one.start
    apart = length + round(world.t_off_s(one.check) * TICKS_PER_S) + 5
    count = max(1, min(round(_beside(number, 1.0, rng)), _MOST))
    again = tuple(replace(one, start=k * apart, end=k * apart + length) for k in range(count))
    return _with(situation, again)


def _with(situation: Situation, violations: tuple[Violation, ...]) -> Situation:
    """The case with these, or the further violation behind them where the law adds one."""
    case, extra = situation.case, situation.violation
    if extra is not None:
        behind = max((v.end for v in violations), default=0) + 10
        if extra.start < behind:
            extra = replace(extra, start=behind, end=behind + extra.end - extra.start)
    duration = max(case.duration, *(v.end + 10 for v in violations), extra.end if extra else 0)
    whole = replace(case, violations=tuple(sorted(violations)), duration=duration)
    return replace(situation, case=whole, violation=extra)


def _long(world: World, situation: Situation, number: float, rng: Random) -> Situation:
    """A violation that lasts as long as a number says, or as long together with what the law adds."""
    if not world.watched:
        return situation
    one = _some(world, situation.case, rng)
    if one.check in world.events:
        one = replace(one, check=_pick(rng, world.watched))
    length = _ticks(number, rng)
    extra = situation.violation
    if extra is not None and rng.random() < 0.5:
        length = max(1, length - (extra.end - extra.start))
    return _with(situation, (replace(one, start=0, end=length),))


def _paused(world: World, situation: Situation, number: float, rng: Random) -> Situation:
    """Two violations with a pause between them as long as a number says."""
    if not world.watched:
        return situation
    one = replace(_some(world, situation.case, rng), check=_pick(rng, world.watched))
    length = max(1, one.end - one.start)
    later = length + _ticks(number, rng)
    pair = (replace(one, start=0, end=length), replace(one, start=later, end=later + length))
    return _with(situation, pair)


def _deep(_world: World, situation: Situation, number: float, rng: Random) -> Situation:
    """Violations as deep as a number says."""
    depth = min(max(_beside(number, 0.01, rng), 0.01), 1.0)
    case = situation.case
    deep = tuple(sorted(replace(v, depth=depth) for v in case.violations))
    return replace(situation, case=replace(case, violations=deep))


def _lasting(_world: World, situation: Situation, number: float, rng: Random) -> Situation:
    """A trial, or a wait, as long as a number says."""
    ticks = _ticks(number, rng)
    if situation.ticks and rng.random() < 0.5:
        return replace(situation, ticks=ticks)
    case = situation.case
    ends = max((v.end for v in case.violations), default=0)
    return replace(situation, case=replace(case, duration=max(ticks, ends, TICKS_PER_S)))


def _measured(world: World, situation: Situation, number: float, rng: Random) -> Situation:
    """What was measured is what a number says, or beside it."""
    case = situation.case
    if not case.numbers:
        return _many(world, situation, number, rng)
    name = _pick(rng, sorted(case.numbers))
    value = max(number * _pick(rng, (1.0, 0.99, 1.01, 2.0)), 0.0)
    return replace(situation, case=replace(case, numbers={**case.numbers, name: value}))


_CHANGES: tuple[Callable[[World, Situation, float, Random], Situation], ...] = (
    _many,
    _long,
    _paused,
    _deep,
    _lasting,
    _measured,
)
