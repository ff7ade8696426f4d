"""Every law of a rule set: proven, refuted with its smallest exploit, or open."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from ariac_score.review.laws.laws import Law
from ariac_score.review.laws.pointed import pointed_draw
from ariac_score.review.laws.prices import ALL_LAWS
from ariac_score.review.laws.proving import MOST_STEPS, Draw, Outcome, any_draw, check_laws
from ariac_score.review.proofs.by_types import BY_TYPES, Argument
from ariac_score.review.proofs.solver import BY_SOLVER, OutsideError, Solver
from ariac_score.review.proofs.subject import Subject

__all__ = [
    "DEFAULT_CASES",
    "MISSING",
    "PROVEN",
    "REFUTED",
    "Judged",
    "Search",
    "Verdict",
    "law_named",
    "prove",
]

DEFAULT_CASES = 400
"""Random cases that are searched for an exploit of each law that is not proven."""

Verdict = Literal["proven", "refuted", "open", "not_applicable"]
PROVEN: Verdict = "proven"
REFUTED: Verdict = "refuted"

MISSING = "z3, which may know, is not installed: pip install 'ariac-score[prove]'"


@dataclass(frozen=True)
class Search:
    """Something that looks for an exploit of a law.

    Attributes:
        where: What it tries, behind a number: "random trials".
        look: Looks for one: the counter-example, or what was tried; `None` where it cannot try the law.
    """

    where: str
    look: Callable[[Subject, Law], Outcome | None]


@dataclass(frozen=True)
class Judged:
    """What is known of one law.

    Attributes:
        law: The law.
        verdict: `proven`, `refuted`, `open`, or `not_applicable`.
        by: What decided it: `types`, `solver` or `search`; empty for what is open.
        because: The steps of the proof, what is not known, or why it does not apply.
        searched: What was tried in vain, with its number.
        exploit: The counter-example, priced by the engine.
        declared: Why the rule set says itself that it does not keep the law; empty when it does not.
    """

    law: Law
    verdict: Verdict
    by: str = ""
    because: tuple[str, ...] = ()
    searched: tuple[str, ...] = ()
    exploit: Outcome | None = None
    declared: str = ""


def law_named(name: str) -> Law:
    """A law by its name."""
    return next(law for law in ALL_LAWS if law.name == name)


def random_search(*, cases: int, seed: int, steps: int = MOST_STEPS) -> Search:
    """A search among random trials; the same seed tries the same ones, and what is found is reduced."""
    return _made("random trials", any_draw, cases=cases, seed=seed, steps=steps)


def pointed_search(*, cases: int, seed: int, steps: int = MOST_STEPS) -> Search:
    """A search among trials made of the numbers that the rules themselves name, and of those beside them."""
    return _made("trials at the numbers of its formulas", pointed_draw, cases=cases, seed=seed, steps=steps)


def _made(where: str, draw: Draw, *, cases: int, seed: int, steps: int) -> Search:
    def look(subject: Subject, law: Law) -> Outcome | None:
        world = subject.world
        (outcome,) = check_laws(
            subject.rule_set,
            cases=cases,
            seed=seed,
            events=world.events,
            bridged=world.bridged,
            ungraded=world.ungraded,
            humans=world.humans,
            paid=world.paid,
            only=[law.name],
            steps=steps,
            draw=draw,
        )
        return outcome if outcome.cases else None

    return Search(where, look)


def prove(
    subject: Subject,
    *,
    cases: int = DEFAULT_CASES,
    seed: int = 0,
    steps: int = MOST_STEPS,
    solver: Solver | None = None,
    searches: Iterable[Search] = (),
) -> tuple[Judged, ...]:
    """Every law, proven by types or the solver, else refuted where a search finds an exploit.

    Args:
        subject: A rule set or a penalty.
        cases: Random trials that are searched for each law that is not proven.
        seed: Where the random numbers start.
        steps: How many tries an exploit is reduced by.
        solver: What is asked where types do not suffice; `None` where none is installed.
        searches: Others that look for an exploit where random trials show none.
    """
    wanted = [random_search(cases=cases, seed=seed, steps=steps), *searches]
    return tuple(_judged(subject, law_named(name), solver, wanted) for name in BY_TYPES)


def _judged(subject: Subject, law: Law, solver: Solver | None, searches: Iterable[Search]) -> Judged:
    declared = subject.rule_set.breaks.get(law.name, "")
    idle = law.idle(subject.world)
    if idle:
        return Judged(law, "not_applicable", because=(idle,), declared=declared)
    argument, by = BY_TYPES[law.name](subject), "types"
    if not argument.proves and law.name in BY_SOLVER:
        argument, by = _asked(subject, law, solver, argument), "solver"
    if argument.proves:
        return Judged(law, PROVEN, by, argument.because, declared=declared)
    searched: list[str] = []
    for search in searches:
        found = search.look(subject, law)
        if found and found.broken:
            because, tried = argument.because, tuple(searched)
            return Judged(law, REFUTED, "search", because, tried, exploit=found, declared=declared)
        if found and found.cases:
            searched.append(f"{found.cases} {search.where}")
    return Judged(law, "open", "", argument.because, tuple(searched), declared=declared)


def _asked(subject: Subject, law: Law, solver: Solver | None, argument: Argument) -> Argument:
    """What the solver proves where types do not, or what neither knows."""
    if solver is None:
        return Argument(False, (*argument.because, MISSING))
    try:
        answer = BY_SOLVER[law.name](solver, subject)
    except OutsideError as outside:
        return Argument(False, tuple(dict.fromkeys((*argument.because, str(outside)))))
    return Argument(answer.proves, (answer.words,) if answer.proves else (*argument.because, answer.words))
