"""What types alone prove of a score, law by law.

Every function gives an argument: what proves the law, or what is not known that would. "Not proven" never
means "broken".
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from math import isfinite

from ariac_score.review.proofs.elasticity import going_on_pays
from ariac_score.review.proofs.grades import Grades
from ariac_score.review.proofs.quantities import DURATION, TASK, VIOLATIONS, Quantity
from ariac_score.review.proofs.subject import Subject
from ariac_score.scoring.policy import OPEN
from ariac_score.scoring.signs import Sign

__all__ = ["BY_TYPES", "Argument"]


@dataclass(frozen=True)
class Argument:
    """Why a law holds, or what is not known of it.

    Attributes:
        proves: Whether it is a proof.
        because: Its steps, or what is missing, each in a sentence.
    """

    proves: bool
    because: tuple[str, ...]


def _argued(missing: Iterable[str], because: Iterable[str]) -> Argument:
    """A proof, unless something is missing."""
    missing = tuple(dict.fromkeys(missing))
    return Argument(not missing, missing or tuple(dict.fromkeys(because)))


def _lost(subject: Subject, quantity: Quantity) -> str:
    """Where it is no longer known which way a quantity moves the score."""
    loss = subject.grades.losses.get(quantity.name)
    where = f"{loss.formula!r} in the term {loss.term!r}" if loss else "the score"
    return f"{quantity} may move {where} either way"


def _falls(subject: Subject, quantities: Iterable[Quantity], *, alive: bool = False) -> Argument:
    """The score falls, or stays, when each of some quantities gets worse; or does so where it is above 0."""
    missing, because = [], []
    grade = subject.alive if alive else subject.whole
    allowed = (Sign.DOWN, Sign.NONE) if alive else (Sign.DOWN,)
    for one in quantities:
        if not one.grows:
            missing.append(f"{one} does not grow with violations: {one.why_not}")
        if grade.sign(one.name) not in allowed:
            missing.append(
                _lost(subject, one) if grade.sign(one.name) is Sign.BOTH else f"the score rises with {one}"
            )
        because.append(f"{one} never falls when violations get worse, and the score never rises with it")
    return _argued(missing, because or ["no violation enters the score"])


def more_violations(subject: Subject) -> Argument:
    """The score falls in quantities that all grow with violations."""
    return _falls(subject, subject.priced_violations)


def always_costs(subject: Subject) -> Argument:
    """Of every check one quantity grows with every further violation, and moves a score above 0 strictly.

    A violation that takes the score out of where it is above 0 costs as well, so that it is enough to know
    the score there.
    """
    return _strictly(subject, "grows with every further violation", lambda one: one.always)


def nothing_left(subject: Subject) -> Argument:
    """Of every check one quantity grows with every violation apart, and the score or a tie-break with it."""
    told = [("the score", subject.whole, Sign.DOWN)]
    for name, (tree, is_lowest_better) in subject.ties.items():
        told.append((f"the tie-break {name}", Grades().of(tree), Sign.UP if is_lowest_better else Sign.DOWN))
    missing: list[str] = []
    because: list[str] = []
    for check in subject.world.safety:
        found = [
            f"{words} always goes with {one}, which every further violation that is apart adds to"
            for words, grade, sign in told
            for one in subject.all_quantities
            if check in one.checks and one.apart and one.name in grade.strict and grade.sign(one.name) is sign
        ]
        (because if found else missing).append(
            found[0] if found else f"neither the score nor a tie-break always goes with violations of {check}"
        )
    return _argued(missing, because)


def severity(subject: Subject) -> Argument:
    """Of every check that measures depth one quantity grows with it, and moves a score above 0 strictly.

    The violation is there, and as long, in both: what hangs on nothing else is the same.
    """
    return _strictly(
        subject,
        "grows with depth",
        lambda one: one.deepens,
        only=frozenset(subject.world.graded),
        same=lambda one: one.depthless,
    )


def _strictly(
    subject: Subject,
    words: str,
    which: Callable[[Quantity], bool],
    *,
    only: frozenset[str] | None = None,
    same: Callable[[Quantity], bool] = lambda _: False,
) -> Argument:
    """Whether the score, where it is above 0, falls with each check that gets worse in some way.

    Args:
        subject: The rule set.
        words: The way, of a quantity.
        which: The quantities that always grow in that way.
        only: The checks that can; all where none are given.
        same: The quantities that stay as they are.
    """
    missing: list[str] = []
    because: list[str] = []
    for check in subject.world.safety:
        if only is not None and check not in only:
            continue
        if _takes_all(subject, check):
            because.append(f"one violation of {check} takes everything that is above 0")
            continue
        moved = [q for q in subject.priced_violations if check in q.checks and not same(q)]
        falls = _falls(subject, moved, alive=True)
        moving = [q for q in moved if which(q)]
        strict = [q for q in moving if q.name in subject.alive.strict]
        if not falls.proves:
            missing += falls.because
        elif strict:
            because.append(f"{strict[0]} {words}, and where the score is not 0 it always falls with it")
        elif moving:
            missing.append(f"the score may stay as it is when {moving[0]} grows")
        else:
            missing.append(f"nothing that the score takes from {check} {words}")
    return _argued(missing, because)


def _takes_all(subject: Subject, check: str) -> bool:
    """Whether the first violation of a check leaves no score above 0, so that nothing is left for another."""
    first = {q.name: 1.0 for q in subject.priced_violations if q.checks == (check,) and q.switch}
    first = {name: one for name, one in first.items() if name.startswith("violated(")}
    return bool(first) and Grades(pins=first).of(subject.tree).typed.most <= 0


def no_cliff(subject: Subject) -> Argument:
    """The score moves by little with everything that a violation changes by little."""
    missing, because = [], []
    for one in subject.priced_violations:
        if one.switch and one.name.startswith("critical("):
            missing.append(f"{one} turns at once, and the score with it")
        elif one.switch:
            because.append(f"{one} turns with the first violation alone")
        elif not one.smooth:
            missing.append(f"{one} jumps: {one.why_not or 'a whole step at a time'}")
        elif one.name in subject.whole.jumps:
            missing.append(f"the score may jump with {one}")
        else:
            steep = subject.whole.steep.get(one.name, 0.0)
            much = (
                f"by at most {steep:g} for each 1" if isfinite(steep) else "by a bounded rate in every trial"
            )
            because.append(f"the score moves with {one} {much}")
    return _argued(missing, because or ["no violation enters the score"])


def waiting(subject: Subject) -> Argument:
    """Nothing that the score takes hangs on how long the trial is."""
    times = [str(one) for one in subject.of(DURATION)]
    return _argued((f"the score takes {name}" for name in times), ["the score does not take the duration"])


def log_rate(subject: Subject) -> Argument:
    """Every end of a violation moves by a sample at most, and the score by a bounded rate with it."""
    missing, because = [], []
    for one in subject.priced_violations:
        if one.same_at_rates:
            because.append(f"{one} is the same at every rate that sees the violation")
        elif not one.smooth:
            missing.append(f"{one} jumps: a sample more or less may be a whole step")
        elif one.name in subject.whole.jumps:
            missing.append(f"the score may jump with {one}")
        else:
            because.append(
                f"an end that moves by a sample moves {one} by a bounded rate, and the score with it"
            )
    return _argued(missing, because or ["no violation enters the score"])


def short_pause(subject: Subject) -> Argument:
    """Everything that the score takes stays as it is over a pause that the monitor bridges."""
    missing = [
        f"{one} is less by what a short pause leaves out"
        for one in subject.priced_violations
        if not one.bridged
    ]
    because = [
        f"{one} stays as it is over a pause that the monitor bridges" for one in subject.priced_violations
    ]
    return _argued(missing, because or ["no violation enters the score"])


def more_points(subject: Subject) -> Argument:
    """The score rises with what is satisfied and falls with what is violated of the task."""
    missing, because = [], []
    for one in subject.of(TASK):
        wanted = Sign.DOWN if one.grows else Sign.UP
        sign = subject.whole.sign(one.name)
        if sign is not wanted:
            missing.append(
                _lost(subject, one) if sign is Sign.BOTH else f"the score goes the wrong way with {one}"
            )
        because.append(f"the score never {'rises' if one.grows else 'falls'} with {one}")
    return _argued(missing, because)


def doing_nothing(subject: Subject) -> Argument:
    """The score is never below what it is at most where nothing is done."""
    clean = {one.name: 0.0 for one in subject.quantities.values() if one.of == VIOLATIONS}
    nothing = Grades(pins={**clean, **subject.idle}).of(subject.tree).typed.most
    least = subject.whole.typed.least
    if nothing <= least:
        return Argument(True, (f"doing nothing gives at most {nothing:g}, and no score is below {least:g}",))
    return Argument(False, (f"a score may be {least:g}, and doing nothing may give {nothing:g}",))


def running_again(subject: Subject) -> Argument:
    """What counts over several runs is the greatest, of which the same number again makes no more."""
    pooled = ", ".join(subject.rule_set.sheet.pooled)
    if not pooled:
        return Argument(True, ("each run is scored for itself",))
    return Argument(
        True, (f"{pooled}: over several runs the greatest counts, which the same run again leaves as it is",)
    )


def standing_still(subject: Subject) -> Argument:
    """No check about a human finds a violation of a machine at rest."""
    missing, because = [], []
    for check in subject.world.safety:
        if check not in subject.world.humans:
            continue
        charges = subject.world.humans[check]
        if charges is None:
            missing.append(f"{check} does not say whether it charges a robot at rest")
        elif charges:
            missing.append(f"{check} charges a robot at rest")
        else:
            because.append(f"{check} asks whether the robot moves, and finds nothing while it does not")
    return _argued(missing, because)


def unknown(subject: Subject) -> Argument:
    """Every undecided finding is priced at the worst that it can be, or withholds the score."""
    missing: list[str] = []
    because: list[str] = []
    for check in subject.world.uses:
        policy = subject.rule_set.policies.get(check, OPEN)
        own = [one for one in subject.quantities.values() if check in one.checks]
        if policy == OPEN:
            told = _open_counts(subject.rule_set.counts, check)
            (because if subject.rule_set.counts != "best" else missing).append(told)
        elif policy == "withhold":
            because.append(f"{check} undecided: no score")
        elif policy == "zero":
            least = subject.whole.typed.least
            told = f"{check} undecided: 0 points, and a score may be {least:g}"
            (because if least >= 0 else missing).append(told)
        elif policy == "worst_case":
            falls = _falls(subject, [one for one in own if one.of == VIOLATIONS])
            missing += () if falls.proves else falls.because
            if not any(one.of == VIOLATIONS for one in own):
                missing.append(f"{check} undecided: counted as violated, of which nothing is known here")
            because.append(f"{check} undecided: violated all of the time, and the score falls with that")
        else:
            missing.append(f"{check} undecided: left out")
    return _argued(missing, because or ["the score asks no check"])


def _open_counts(counts: str, check: str) -> str:
    words = {
        "worst": "the least score that the log allows counts",
        "withhold": "no score",
        "best": "the greatest score that the log allows counts",
    }
    return f"{check} undecided: {words[counts]}"


def stopping_early(subject: Subject) -> Argument:
    """With equal pieces at a constant rate the score does not fall with their number."""
    proves, because = going_on_pays(subject.tree, subject.idle)
    return Argument(proves, because)


BY_TYPES: Mapping[str, Callable[[Subject], Argument]] = {
    "more_violations": more_violations,
    "always_costs": always_costs,
    "nothing_left": nothing_left,
    "severity": severity,
    "no_cliff": no_cliff,
    "more_points": more_points,
    "waiting": waiting,
    "log_rate": log_rate,
    "doing_nothing": doing_nothing,
    "stopping_early": stopping_early,
    "unknown": unknown,
    "short_pause": short_pause,
    "running_again": running_again,
    "standing_still": standing_still,
}
"""The laws, in the order in which they are shown."""
