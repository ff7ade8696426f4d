"""Trying every law on a rule set, and reducing a counter-example to a small one."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence, Set
from dataclasses import dataclass
from random import Random
from types import MappingProxyType

from ariac_score.checks.contracts import Monitor
from ariac_score.checks.measures import measures_of
from ariac_score.checks.registry import Registry
from ariac_score.errors import FormulaError
from ariac_score.review.laws.cases import World
from ariac_score.review.laws.laws import LAWS, Broken, Law, Situation, simpler
from ariac_score.review.laws.prices import ALL_LAWS
from ariac_score.review.laws.words import trial_in_words
from ariac_score.scoring.ruleset import RuleSet

__all__ = [
    "DEFAULT_CASES",
    "Draw",
    "Outcome",
    "about_humans",
    "any_draw",
    "bridged_pauses",
    "check_laws",
    "event_checks",
    "paid_quantities",
    "ungraded_checks",
]

DEFAULT_CASES = 400
"""Random cases for each law."""

MOST_STEPS = 2000
"""A counter-example is reduced by so many tries at most; it is one at every step."""


@dataclass(frozen=True)
class Outcome:
    """The outcome of one law.

    Attributes:
        law: The law.
        verdict: `holds`, `broken`, `not_applicable`, or `untried` when the score had no
            value in any case.
        reason: Why it does not apply or could not be tried.
        cases: How many cases were tried.
        situation: The smallest counter-example found; `None` where it is of a log.
        broken: What is wrong with it.
        log: The log that it is of, in words; empty where the trial is made.
    """

    law: Law
    verdict: str
    reason: str = ""
    cases: int = 0
    situation: Situation | None = None
    broken: Broken | None = None
    log: str = ""

    def trial(self, levels: Sequence[str]) -> str:
        """The trial of the counter-example in words; `levels` are those of the rule set."""
        return self.log if self.situation is None else trial_in_words(self.situation.case, levels)


Draw = Callable[[Law, World, Random], Situation]
"""The next situation in which a law is tried."""


def any_draw(law: Law, world: World, rng: Random) -> Situation:
    """Any situation that the law may be tried in."""
    return law.draw(world, rng)


def check_laws(
    rule_set: RuleSet,
    *,
    cases: int = DEFAULT_CASES,
    seed: int = 0,
    events: Set[str] = frozenset(),
    bridged: Mapping[str, float] = MappingProxyType({}),
    ungraded: Set[str] = frozenset(),
    humans: Mapping[str, bool | None] = MappingProxyType({}),
    paid: Mapping[str, frozenset[str]] = MappingProxyType({}),
    only: Collection[str] = (),
    steps: int = MOST_STEPS,
    draw: Draw = any_draw,
) -> tuple[Outcome, ...]:
    """Try every law on random cases; the same seed gives the same cases.

    Args:
        rule_set: What findings are worth.
        cases: How many for each law.
        seed: Where the random numbers start.
        events: The checks that speak of single events (`event_checks`); every other monitor
            is taken to watch stretches of time.
        bridged: Below which pause each of these makes one of two violations, s (`bridged_pauses`).
        ungraded: The checks whose violations have no depth (`ungraded_checks`).
        humans: The checks about humans, and whether they charge a machine at rest (`about_humans`).
        paid: The quantities of official records that say what work earned (`paid_quantities`).
        only: Names of the laws to try; empty: all.
        steps: How many tries a counter-example is reduced by, which take time.
        draw: What the next case is; any that the law may be tried in, where nothing is given.
    """
    world = World(rule_set, frozenset(events), bridged, frozenset(ungraded), humans, paid)
    laws = [law for law in (ALL_LAWS if only else LAWS) if not only or law.name in only]
    return tuple(_tried(law, world, cases, seed, steps=steps, draw=draw) for law in laws)


def event_checks(rule_set: RuleSet, registry: Registry) -> frozenset[str]:
    """The monitors of a rule set that need no signal: they speak of single events.

    Raises:
        PluginError: A plugin of the rule set is not installed or broken.
        RuleSetError: A plugin refuses its parameters.
    """
    built = rule_set.build(registry)
    return frozenset(
        name for name, check in built.items() if isinstance(check, Monitor) and not list(check.needs())
    )


def bridged_pauses(rule_set: RuleSet, registry: Registry) -> dict[str, float]:
    """Below which pause each monitor of a rule set makes one of two violations, s.

    Raises:
        PluginError: A plugin of the rule set is not installed or broken.
        RuleSetError: A plugin refuses its parameters.
    """
    built = rule_set.build(registry)
    return {
        name: float(getattr(check, "t_off_s", 0.0))
        for name, check in built.items()
        if isinstance(check, Monitor)
    }


def ungraded_checks(rule_set: RuleSet, registry: Registry) -> frozenset[str]:
    """The monitors of a rule set whose violations have no depth: they do not say that theirs have.

    Raises:
        PluginError: A plugin of the rule set is not installed or broken.
        RuleSetError: A plugin refuses its parameters.
    """
    built = rule_set.build(registry)
    return frozenset(
        name
        for name, check in built.items()
        if isinstance(check, Monitor) and not getattr(check, "graded", False)
    )


def paid_quantities(rule_set: RuleSet, registry: Registry) -> dict[str, frozenset[str]]:
    """For each rule that reads an official record the quantities that say what work earned.

    Raises:
        PluginError: A plugin of the rule set is not installed or broken.
        RuleSetError: A plugin refuses its parameters.
    """
    found = {
        name: frozenset(
            quantity for quantity, measure in measures_of(check).items() if measure.role == "points"
        )
        for name, check in rule_set.build(registry).items()
        if not isinstance(check, Monitor) and getattr(check, "reads_official", False)
    }
    return {name: quantities for name, quantities in found.items() if quantities}


def about_humans(rule_set: RuleSet, registry: Registry) -> dict[str, bool | None]:
    """The monitors about humans, and whether each charges a machine at rest; `None`: it does not say.

    Raises:
        PluginError: A plugin of the rule set is not installed or broken.
        RuleSetError: A plugin refuses its parameters.
    """
    found: dict[str, bool | None] = {}
    for name, check in rule_set.build(registry).items():
        kinds = getattr(getattr(check, "subjects", None), "kinds", ())
        if isinstance(check, Monitor) and "human" in kinds and len(kinds) > 1:
            found[name] = getattr(check, "charges_rest", None)
    return found


def _tried(law: Law, world: World, cases: int, seed: int, *, steps: int, draw: Draw) -> Outcome:
    reason = law.idle(world)
    if reason:
        return Outcome(law, "not_applicable", reason)
    # A seed for each law: the cases of one do not depend on which others are tried.
    rng = Random(f"{law.name}:{seed}")  # noqa: S311  # no secrets are made of it
    tried, unpriced = 0, ""
    for _ in range(cases):
        situation = draw(law, world, rng)
        try:
            broken = law.broken(world, situation)
        except FormulaError as error:
            unpriced = error.cause
            continue
        tried += 1
        if broken:
            situation, broken = _shrunk(law, world, situation, broken, steps)
            return Outcome(law, "broken", cases=tried, situation=situation, broken=broken)
    if not tried and cases:
        return Outcome(law, "untried", unpriced)
    return Outcome(law, "holds", cases=tried)


def _shrunk(
    law: Law, world: World, situation: Situation, broken: Broken, most: int
) -> tuple[Situation, Broken]:
    """The simplest situation near this one that still breaks the law."""
    # A step that does not break the law is given up; the first that does starts over, boldest steps first.
    steps = 0
    shrinking = True
    while shrinking:
        shrinking = False
        for plainer in simpler(situation):
            steps += 1
            if steps > most:
                return situation, broken
            try:
                still = law.broken(world, plainer)
            except FormulaError:
                continue
            if still:
                situation, broken, shrinking = plainer, still, True
                break
    return situation, broken
