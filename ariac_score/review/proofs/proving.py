"""Every law of a rule set: proven, refuted with its smallest exploit, or open."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Literal

from ariac_score.review.laws.laws import Law
from ariac_score.review.laws.prices import ALL_LAWS
from ariac_score.review.laws.proving import Outcome, check_laws
from ariac_score.review.proofs.by_types import BY_TYPES, Argument
from ariac_score.review.proofs.subject import Subject

__all__ = ["DEFAULT_CASES", "PROVEN", "REFUTED", "Judged", "Search", "Verdict", "law_named", "prove"]

DEFAULT_CASES = 400
"""Random cases that are searched for an exploit of each law that is not proven."""

Verdict = Literal["proven", "refuted", "open", "not_applicable"]
PROVEN: Verdict = "proven"
REFUTED: Verdict = "refuted"

Search = Callable[[Subject, Law], Outcome | None]
"""Something that looks for an exploit of a law: a counter-example, or `None` where it found none."""


@dataclass(frozen=True)
class Judged:
    """What is known of one law.

    Attributes:
        law: The law.
        verdict: `proven`, `refuted`, `open`, or `not_applicable`.
        by: What decided it: `types`, `solver` or `search`; empty for what is open.
        because: The steps of the proof, what is not known, or why it does not apply.
        exploit: The counter-example, priced by the engine.
        declared: Why the rule set says itself that it does not keep the law; empty when it does not.
    """

    law: Law
    verdict: Verdict
    by: str = ""
    because: tuple[str, ...] = ()
    exploit: Outcome | None = None
    declared: str = ""


def law_named(name: str) -> Law:
    """A law by its name."""
    return next(law for law in ALL_LAWS if law.name == name)


def random_search(*, cases: int, seed: int) -> Search:
    """A search among random trials; the same seed tries the same ones, and what is found is reduced."""

    def search(subject: Subject, law: Law) -> Outcome | None:
        world = subject.world
        (outcome,) = check_laws(
            subject.rule_set,
            cases=cases,
            seed=seed,
            events=world.events,
            bridged=world.bridged,
            only=[law.name],
        )
        return outcome if outcome.broken else None

    return search


def prove(
    subject: Subject, *, cases: int = DEFAULT_CASES, seed: int = 0, searches: Iterable[Search] = ()
) -> tuple[Judged, ...]:
    """Every law, proven by types where they suffice, else refuted where a search finds an exploit.

    Args:
        subject: A rule set or a penalty.
        cases: Random trials that are searched for each law that is not proven.
        seed: Where the random numbers start.
        searches: Others that look for an exploit where random trials show none.
    """
    wanted = [random_search(cases=cases, seed=seed), *searches]
    return tuple(
        _judged(subject, law_named(name), argue(subject), wanted) for name, argue in BY_TYPES.items()
    )


def _judged(subject: Subject, law: Law, argument: Argument, searches: Iterable[Search]) -> Judged:
    declared = subject.rule_set.breaks.get(law.name, "")
    idle = law.idle(subject.world)
    if idle:
        return Judged(law, "not_applicable", because=(idle,), declared=declared)
    if argument.proves:
        return Judged(law, PROVEN, "types", argument.because, declared=declared)
    for search in searches:
        if exploit := search(subject, law):
            return Judged(law, REFUTED, "search", argument.because, exploit, declared)
    return Judged(law, "open", because=argument.because, declared=declared)
