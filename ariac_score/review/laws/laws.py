"""The laws: what must hold for any findings, and how each is tried on one case."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from random import Random

from ariac_score.review.laws.cases import (
    PAIRS,
    TICKS_PER_S,
    Case,
    Violation,
    World,
    draw_case,
    draw_violation,
)
from ariac_score.scoring.expression import Number, add_up
from ariac_score.scoring.levels import ALWAYS, TRIAL

__all__ = ["LAWS", "Broken", "Law", "Situation", "margin_of", "scores_of", "simpler", "without_safety"]

_TOLERANCE = 1e-9
"""Of a score: sums in another order may differ in their last bits, never by this much."""


@dataclass(frozen=True)
class Situation:
    """A case and what the law changes about it.

    Attributes:
        case: The case.
        violation: One more violation, or the one that is split.
        subject: A finding: check and subject.
        ticks: A time: how long to wait, or how long the pause is.
        at: Where the pause begins.
    """

    case: Case
    violation: Violation | None = None
    subject: tuple[str, str] | None = None
    ticks: int = 0
    at: int = 0


@dataclass(frozen=True)
class Broken:
    """A law that does not hold.

    Attributes:
        first: One way it can go, in words.
        first_score: What that gives.
        second: Another way.
        second_score: What that gives.
    """

    first: str
    first_score: Number
    second: str
    second_score: Number


@dataclass(frozen=True)
class Law:
    """One law.

    Attributes:
        name: Short name.
        says: The law in words.
        how: How it is tried.
        idle: Why it does not apply to a rule set; empty when it does.
        draw: A random situation.
        broken: What the law finds wrong in a situation; `None` when it holds or does not apply.
    """

    name: str
    says: str
    how: str
    idle: Callable[[World], str]
    draw: Callable[[World, Random], Situation]
    broken: Callable[[World, Situation], Broken | None]


def scores_of(world: World, *cases: Case) -> list[Number]:
    """Scores that are not withheld; these cases have nothing undecided."""
    return [score for case in cases if (score := world.score(case)) is not None]


def margin_of(*scores: Number) -> float:
    """By how much scores may differ and still be one."""
    return _TOLERANCE * max(1.0, *(abs(score) for score in scores))


def _fine(_world: World) -> str:
    return ""


def _recorded(world: World) -> bool:
    """Whether formulas ask a rule for numbers, such as those that an official text prints."""
    checks = world.rule_set.checks
    return any(checks[name].group == "ariac_score.rules" for name in world.measured if name in checks)


def _from_facts(world: World) -> bool:
    """Whether the score rests on facts that a log states."""
    sheet = world.rule_set.sheet
    return bool(sheet.facts_in(sheet.score) - {f"{TRIAL}.{name}" for name in ALWAYS[TRIAL]})


_NO_WORK = "nothing in it earns points, so whoever does nothing always has the most"


_FACTS = "no rule earns points; what it takes from facts of a trial cannot be made up"


def without_safety(world: World) -> str:
    """Why laws about violations do not apply; empty where they do."""
    return "" if world.safety else "the score asks about no violation of a monitor"


def _without_time(world: World) -> str:
    if not world.safety:
        return without_safety(world)
    return "" if world.watched else "every safety check is about single events, which have no duration"


def _without_points(world: World) -> str:
    if world.task:
        return ""
    if _recorded(world):
        return "its points are numbers read from a record, not verdicts"
    return _FACTS if _from_facts(world) else _NO_WORK


def _without_work(world: World) -> str:
    if not world.safety:
        return without_safety(world)
    if not world.earning and not _recorded(world):
        return _FACTS if _from_facts(world) else _NO_WORK
    if not world.earning or set(world.earning) & set(world.measured):
        return "what work earns is read from a record, so no work cannot be made up"
    return ""


def _upto(rng: Random, count: int) -> int:
    return int(rng.random() * count)


# More violations never help ------------------------------------------------------------


def _draw_more(world: World, rng: Random) -> Situation:
    case, more = draw_case(world, rng), draw_violation(world, rng)
    # Half of the time where a price for each episode fails: one more violation makes one episode of two.
    if world.watched and rng.random() < 0.5:
        return _draw_joined(world, rng, case)
    if case.violations and rng.random() < 0.5:  # another of the same, overlapping or not
        of = case.violations[_upto(rng, len(case.violations))]
        length = 0 if of.check in world.events else max(1, more.end - more.start)
        more = replace(more, check=of.check, pair=of.pair, end=more.start + length)
    return Situation(case, violation=more)


def _draw_joined(world: World, rng: Random, case: Case) -> Situation:
    """Two short violations, and one more in the pause between them, so that they become one."""
    check = world.watched[_upto(rng, len(world.watched))]
    start = _upto(rng, 20 * TICKS_PER_S)
    first = Violation(check, 0, start, start + 1 + _upto(rng, TICKS_PER_S))
    pause_end = first.end + TICKS_PER_S + _upto(rng, 5 * TICKS_PER_S)
    second = replace(first, start=pause_end, end=pause_end + 1 + _upto(rng, TICKS_PER_S))
    between = replace(first, start=first.end, end=second.start, depth=(1.0, 0.5, 0.1)[_upto(rng, 3)])
    kept = [v for v in case.violations if v.check != check] if rng.random() < 0.5 else []
    return Situation(replace(case, violations=tuple(sorted([*kept, first, second]))), violation=between)


def _more(world: World, situation: Situation) -> Broken | None:
    extra = situation.violation
    if extra is None:
        return None
    case = situation.case
    after = replace(case, violations=tuple(sorted([*case.violations, extra])))
    before_score, after_score = scores_of(world, case, after)
    if after_score <= before_score + margin_of(before_score, after_score):
        return None
    return Broken("as it is", before_score, f"with one more violation, {extra}", after_score)


# More task points never hurt -----------------------------------------------------------


def _draw_point(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng)
    check = world.task[_upto(rng, len(world.task))]
    subjects = world.subjects(case, check)
    subject = (check, subjects[_upto(rng, len(subjects))])
    return Situation(replace(case, failed=case.failed | {subject}), subject=subject)


def _point(world: World, situation: Situation) -> Broken | None:
    case, subject = situation.case, situation.subject
    if subject is None or subject not in case.failed:
        return None
    better = replace(case, failed=case.failed - {subject})
    before, after = scores_of(world, case, better)
    if after >= before - margin_of(before, after):
        return None
    return Broken("as it is", before, f"with {subject[0]} satisfied for {subject[1]}", after)


# Waiting changes nothing ---------------------------------------------------------------


def _draw_waiting(world: World, rng: Random) -> Situation:
    return Situation(draw_case(world, rng), ticks=TICKS_PER_S * (1 + _upto(rng, 300)))


def _waiting(world: World, situation: Situation) -> Broken | None:
    case = situation.case
    if situation.ticks <= 0:
        return None
    before, after = scores_of(world, case, replace(case, duration=case.duration + situation.ticks))
    if abs(after - before) <= margin_of(before, after):
        return None
    waited = f"after waiting {situation.ticks / TICKS_PER_S:g} s more at the end"
    return Broken(f"after {case.duration / TICKS_PER_S:g} s", before, waited, after)


# Halving the log rate changes at most one sample's worth -------------------------------

_SHORTEST = 15
"""Ticks: so long are violations that both rates see, and see as separate ones."""


def _draw_rate(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng, most_violations=0)
    found: dict[tuple[str, int], Violation] = {}
    for _ in range(1 + _upto(rng, 3)):
        violation = draw_violation(world, rng, shortest=_SHORTEST)
        if violation.check in world.watched:
            found[violation.check, violation.pair] = violation
    return Situation(replace(case, violations=tuple(sorted(found.values()))))


def _rate(world: World, situation: Situation) -> Broken | None:
    """Each violation may lose or gain a sample, at what such a time costs where it costs most."""
    case = situation.case
    violations = case.violations
    separate = {(v.check, v.pair) for v in violations}
    if len(separate) < len(violations) or any(v.end - v.start < _SHORTEST for v in violations):
        return None
    whole, half = scores_of(world, case, replace(case, step=2))
    allowed = add_up(_second_costs(world, case, each) / TICKS_PER_S for each in violations)
    if abs(half - whole) <= allowed + margin_of(whole, half):
        return None
    return Broken(f"from {TICKS_PER_S} samples/s", whole, f"from {TICKS_PER_S // 2} samples/s", half)


def _second_costs(world: World, case: Case, violation: Violation) -> Number:
    """What a second of a violation costs where it costs most: as the first and only one, or at its end."""
    short = replace(violation, start=0, end=5)
    others = [one for one in case.violations if one != violation]

    def lasting(ticks: int) -> Case:
        as_long = replace(violation, end=max(violation.start + 1, violation.end + ticks))
        return replace(case, violations=tuple(sorted([*others, as_long])))

    alone = [replace(case, violations=(replace(short, end=end),)) for end in (5, 5 + TICKS_PER_S)]
    at_its_end = [lasting(-TICKS_PER_S), case, lasting(TICKS_PER_S)]
    return max(
        abs(second - first)
        for cases in (alone, at_its_end)
        for first, second in pairwise(scores_of(world, *cases))
    )


# Doing nothing is not optimal ----------------------------------------------------------


def _undone(world: World, case: Case, *, but: int = 0) -> frozenset[tuple[str, str]]:
    """The task findings when only the first orders are done: the others earn nothing and break nothing.

    Findings that earn points are violated, those that only have to be kept are satisfied;
    the kind of a task stays as it is.
    """
    left_out = world.scopes(case).inner[but:]

    def is_left_out(subject: str) -> bool:
        return any(order.contains(subject) for order in left_out)

    undone = {
        (check, subject)
        for check in world.earning
        for subject in world.subjects(case, check)
        if is_left_out(subject)
    }
    kept = {each for each in case.failed if each[0] in world.kinds or not is_left_out(each[1])}
    return frozenset(undone | kept)


def _draw_work(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng)
    return Situation(replace(case, violations=_again(world, rng, 40)) if rng.random() < 0.3 else case)


def _again(world: World, rng: Random, count: int, *, events: int = 0) -> tuple[Violation, ...]:
    """One short violation again and again, the pauses too long to be bridged; of events as many as given."""
    first = replace(draw_violation(world, rng), critical=False)
    length = 0 if first.check in world.events else 1
    if events and not length:  # which nothing joins, however close they are
        return tuple(replace(first, start=2 * n, end=2 * n) for n in range(events))
    step = round(world.t_off_s(first.check) * TICKS_PER_S) + 5
    return tuple(replace(first, start=n * step, end=n * step + length) for n in range(count))


def _nothing(world: World, situation: Situation) -> Broken | None:
    case = situation.case
    clean = replace(case, violations=())
    idle = replace(clean, failed=_undone(world, case))
    with_violations, without, doing_nothing = scores_of(world, case, clean, idle)
    worth_something = without > doing_nothing + margin_of(without, doing_nothing)
    if not worth_something or with_violations >= doing_nothing - margin_of(with_violations, doing_nothing):
        return None
    return Broken(
        f"as it is ({without:g} without its violations)",
        with_violations,
        "having done nothing",
        doing_nothing,
    )


# Stopping early does not pay at a constant violation rate ------------------------------

_PERIOD = 30 * TICKS_PER_S
_PIECES, _MANY_PIECES = 2, 6
_EVENTS = 60
"""Single events with each piece: more than any piece of work is worth points."""


def _draw_pieces(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng, most_violations=3)
    failed = frozenset[tuple[str, str]]()
    # Into the first 15 s, which `_pieces` requires: they must end before the next piece begins.
    first = tuple(
        replace(v, start=v.start % 100, end=v.start % 100 + min(v.end - v.start, 50)) for v in case.violations
    )
    if rng.random() < 0.2:  # more often than the least piece of work is worth points
        first = _again(world, rng, 9, events=_EVENTS)
        first = first if first[-1].end <= _PERIOD // 2 else first[:3]
    # What is capped, or grows faster than work, may only be beyond what work brings after several pieces.
    pieces = _MANY_PIECES if len(first) == 1 else _PIECES
    return Situation(
        replace(case, orders=(case.orders[0],) * pieces, failed=failed, violations=tuple(sorted(first)))
    )


def _pieces(world: World, situation: Situation) -> Broken | None:
    """Pieces of work alike, each done in the same time with the same violations; stop after some of them."""
    case, level = situation.case, (TRIAL, *world.rule_set.sheet.levels)[-2]
    if len(set(case.orders)) > 1 or any(v.end > _PERIOD // 2 for v in case.violations):
        return None
    counts = range(len(case.orders) + 1)
    clean = scores_of(world, *(_after(world, replace(case, violations=()), n) for n in counts))
    gains = [later - sooner for sooner, later in pairwise(clean)]
    worthless_later = gains[0] > 0 and not any(gains[1:])  # as where the best piece alone counts
    if not worthless_later and (any(gain <= 0 for gain in gains) or any(b < a for a, b in pairwise(gains))):
        return None  # the pieces are not alike: the law says nothing about unequal ones
    scores = scores_of(world, *(_after(world, case, n) for n in counts))
    for n, (sooner, later) in enumerate(pairwise(scores)):
        if later < sooner - margin_of(sooner, later):
            return Broken(
                f"stopping after {n} {level}{'' if n == 1 else 's'}",
                sooner,
                f"going on to {level} {n + 1}, with the same violations again",
                later,
            )
    return None


def _after(world: World, case: Case, done: int) -> Case:
    """The case when it ends after so many orders; violations repeat with each."""
    again = tuple(
        sorted(
            replace(v, start=v.start + n * _PERIOD, end=v.end + n * _PERIOD)
            for v in case.violations
            for n in range(done)
        )
    )
    return replace(
        case, failed=_undone(world, case, but=done), violations=again, duration=_PERIOD * max(done, 1)
    )


# Unknown never beats known -------------------------------------------------------------


def _draw_unknown(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng)
    if world.safety and rng.random() < 0.3:
        case = replace(case, violations=_again(world, rng, 4))
    hidden: list[tuple[str, str]] = [(v.check, PAIRS[v.pair]) for v in case.violations]
    hidden += [(check, s) for check in world.task for s in world.subjects(case, check)]
    return Situation(case, subject=hidden[_upto(rng, len(hidden))] if hidden else None)


def _unknown(world: World, situation: Situation) -> Broken | None:
    case, subject = situation.case, situation.subject
    if subject is None:
        return None
    hidden = world.score(replace(case, unknown=frozenset({subject})))
    known = world.score(case)
    if hidden is None or known is None or hidden <= known + margin_of(hidden, known):
        return None
    return Broken("as it is", known, f"with nothing known of {subject[0]} for {subject[1]}", hidden)


# A pause shorter than t_off changes nothing --------------------------------------------


def _draw_pause(world: World, rng: Random) -> Situation:
    case = draw_case(world, rng)
    split = draw_violation(world, rng, shortest=2 * TICKS_PER_S)
    check = world.watched[_upto(rng, len(world.watched))]
    split = replace(split, check=check)
    longest = max(1, round(world.t_off_s(check) * TICKS_PER_S) - 1)
    pause = 1 + _upto(rng, longest)
    at = split.start + 1 + _upto(rng, max(1, split.end - split.start - pause - 1))
    return Situation(case, violation=split, ticks=pause, at=at)


def _pause(world: World, situation: Situation) -> Broken | None:
    case, split, until = situation.case, situation.violation, situation.at + situation.ticks
    if split is None or not split.start < situation.at < until < split.end:
        return None
    # A pause as long as t_off separates two violations; the law is about shorter ones.
    if situation.ticks / TICKS_PER_S >= world.t_off_s(split.check) - 1e-6:
        return None
    whole = replace(case, violations=tuple(sorted([*case.violations, split])))
    parts = [replace(split, end=situation.at), replace(split, start=until)]
    two = replace(case, violations=tuple(sorted([*case.violations, *parts])))
    before, after = scores_of(world, whole, two)
    if abs(after - before) <= margin_of(before, after):
        return None
    words = f"with a pause in it from {situation.at / TICKS_PER_S:g} s to {until / TICKS_PER_S:g} s"
    return Broken(f"with {split}", before, words, after)


LAWS: tuple[Law, ...] = (
    Law(
        "more_violations",
        "more violations never help",
        "a violation is added, in half of the cases just where it joins two others; the score may not rise",
        without_safety,
        _draw_more,
        _more,
    ),
    Law(
        "more_points",
        "more task points never hurt",
        "a violated finding of a rule is satisfied instead; the score may not fall",
        _without_points,
        _draw_point,
        _point,
    ),
    Law(
        "waiting",
        "waiting changes nothing",
        "the trial ends later and nothing else happens; the score stays",
        _fine,
        _draw_waiting,
        _waiting,
    ),
    Law(
        "log_rate",
        "halving the log rate changes at most one sample's worth",
        "the findings are made from every second sample; for each violation the score may move by what "
        "a tenth of a second costs where it costs most, in the first second of a first one or at its end",
        _without_time,
        _draw_rate,
        _rate,
    ),
    Law(
        "doing_nothing",
        "doing nothing is not optimal",
        "work that would be worth something without its violations may not be worth less than none at all",
        _without_work,
        _draw_work,
        _nothing,
    ),
    Law(
        "stopping_early",
        "stopping early does not pay at a constant violation rate",
        "pieces of work alike, each done in 30 s with the same violations; going on may not give less than "
        "stopping after any of them, or before the first",
        _without_work,
        _draw_pieces,
        _pieces,
    ),
    Law(
        "unknown",
        "unknown never beats known",
        "what is known of one check about one subject is taken away; there is no score then, "
        "or none above the known",
        _fine,
        _draw_unknown,
        _unknown,
    ),
    Law(
        "short_pause",
        "splitting a violation by a gap shorter than t_off changes nothing",
        "a violation is interrupted for less than the pause its monitor bridges; the score stays",
        _without_time,
        _draw_pause,
        _pause,
    ),
)


def simpler(situation: Situation) -> Iterator[Situation]:
    """Situations that are one step plainer, the boldest steps first."""
    for case in _simpler_cases(situation.case):
        yield replace(situation, case=case)
    if situation.violation is not None:
        for plainer in _simpler_violations(situation.violation):
            yield replace(situation, violation=plainer)
        yield from _simpler_splits(situation, situation.violation)
    for ticks in _rounder(situation.ticks):
        yield replace(situation, ticks=ticks)
    for at in _rounder(situation.at):
        yield replace(situation, at=at)


def _simpler_splits(situation: Situation, split: Violation) -> Iterator[Situation]:
    """A violation with a pause in it, moved to an earlier time or shortened around its pause."""
    until = situation.at + situation.ticks
    if split.start < situation.at < until < split.end:
        for start in _rounder(split.start):
            moved = replace(split, start=start, end=start + split.end - split.start)
            yield replace(situation, violation=moved, at=start + situation.at - split.start)
        if situation.at > split.start + 1:
            yield replace(situation, violation=replace(split, start=situation.at - 1))
        if until < split.end - 1:
            yield replace(situation, violation=replace(split, end=until + 1))


def _simpler_cases(case: Case) -> Iterator[Case]:
    if len(case.violations) > 3:
        half = len(case.violations) // 2
        yield replace(case, violations=case.violations[:half])
    for i in range(len(case.violations)):
        yield replace(case, violations=case.violations[:i] + case.violations[i + 1 :])
    for i in range(len(case.orders) if len(case.orders) > 1 else 0):
        yield replace(case, orders=case.orders[:i] + case.orders[i + 1 :])
    if len(set(case.orders)) == 1:  # laws about orders that are alike keep them so
        for tasks in _simpler_tasks(case.orders[0]):
            yield replace(case, orders=(tasks,) * len(case.orders))
    for i, order in enumerate(case.orders):
        for tasks in _simpler_tasks(order):
            yield replace(case, orders=(*case.orders[:i], tasks, *case.orders[i + 1 :]))
    yield from _simpler_failures(case)
    for i, violation in enumerate(case.violations):
        for plainer in _simpler_violations(violation):
            changed = [*case.violations[:i], plainer, *case.violations[i + 1 :]]
            yield replace(case, violations=tuple(sorted(changed)))
    for name, value in case.numbers.items():
        if value != 1:
            yield replace(case, numbers={**case.numbers, name: 1.0})


def _simpler_failures(case: Case) -> Iterator[Case]:
    if case.failed:
        yield replace(case, failed=frozenset())
    for check in sorted({check for check, _ in case.failed}):
        yield replace(case, failed=frozenset(each for each in case.failed if each[0] != check))
    for each in sorted(case.failed):
        yield replace(case, failed=case.failed - {each})


def _simpler_tasks(tasks: tuple[int, ...]) -> Iterator[tuple[int, ...]]:
    if len(tasks) > 1:
        yield from (tasks[:i] + tasks[i + 1 :] for i in range(len(tasks)))
    for i, parts in enumerate(tasks):
        if parts > 1:
            yield (*tasks[:i], parts - 1, *tasks[i + 1 :])


def _simpler_violations(violation: Violation) -> Iterator[Violation]:
    if violation.critical:
        yield replace(violation, critical=False)
    if violation.pair:
        yield replace(violation, pair=0)
    if violation.depth != 1:
        yield replace(violation, depth=1.0)
    length = violation.end - violation.start
    for start in _rounder(violation.start):
        yield replace(violation, start=start, end=start + length)
    for shorter in _rounder(length):
        if shorter:
            yield replace(violation, end=violation.start + shorter)


def _rounder(ticks: int) -> Iterator[int]:
    """Smaller and rounder times."""
    tried = [
        0,
        TICKS_PER_S,
        ticks // 2 // TICKS_PER_S * TICKS_PER_S,
        ticks // TICKS_PER_S * TICKS_PER_S,
        ticks - 1,
    ]
    yield from (each for each in dict.fromkeys(tried) if 0 <= each < ticks)
