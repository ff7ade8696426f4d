"""A rule set, or a penalty on the made competition, as what laws are proven of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import inf

from ariac_score.checks.measures import Measure, measures_of
from ariac_score.checks.registry import Registry
from ariac_score.engine.facts import facts_of_competition
from ariac_score.errors import FormulaError
from ariac_score.review.laws.cases import World
from ariac_score.review.laws.proving import (
    about_humans,
    bridged_pauses,
    event_checks,
    paid_quantities,
    ungraded_checks,
)
from ariac_score.review.laws.reference import REFERENCE_EVENTS, REFERENCE_UNGRADED, reference_rules
from ariac_score.review.proofs.grades import Grade, Grades
from ariac_score.review.proofs.quantities import TASK, VIOLATIONS, Quantity
from ariac_score.review.proofs.tree import Node, Term, inputs_of, trees
from ariac_score.scoring.levels import DeclaredFact
from ariac_score.scoring.penalties import penalty_names
from ariac_score.scoring.ruleset import RuleSet, load_rule_set

__all__ = ["Subject", "subject_of", "subject_of_rules"]


@dataclass(frozen=True)
class Subject:
    """What laws are proven of.

    Attributes:
        name: As it was asked for.
        world: The rule set as laws see it.
        tree: Its score.
        ties: What breaks ties in its ranking, by name of the term, and whether less of it is better.
        is_penalty: Whether it is a penalty, on the made competition.
        whole: What is known of the score.
        grades: Where signs were lost.
    """

    name: str
    world: World
    tree: Term
    ties: Mapping[str, tuple[Term, bool]] = field(default_factory=dict)
    is_penalty: bool = False
    grades: Grades = field(default_factory=Grades)

    @property
    def rule_set(self) -> RuleSet:
        """The rule set."""
        return self.world.rule_set

    @cached_property
    def whole(self) -> Grade:
        """What is known of the score."""
        return self.grades.of(self.tree)

    @cached_property
    def alive(self) -> Grade:
        """What is known of it where it is above 0."""
        return Grades(positive=True).of(self.tree)

    @cached_property
    def quantities(self) -> Mapping[str, Quantity]:
        """Everything that the score takes from a trial, by name."""
        return {one.name: one for one in inputs_of(self.tree)}

    @property
    def all_quantities(self) -> list[Quantity]:
        """Those of the score and of what breaks ties."""
        behind = [one for tree, _ in self.ties.values() for one in inputs_of(tree)]
        return list(dict.fromkeys([*self.quantities.values(), *behind]))

    def of(self, what: str) -> list[Quantity]:
        """The quantities of one kind that move the score."""
        return [
            one for name, one in self.quantities.items() if one.of == what and name in self.whole.typed.signs
        ]

    @cached_property
    def idle(self) -> Mapping[str, float]:
        """What the quantities of the task are where nothing is done: nothing earned, and nothing broken."""
        earning = self.world.earning
        return {
            one.name: float(one.switch and one.checks[0] in earning)
            for one in self.quantities.values()
            if one.earns or (one.of == TASK and (one.grows or one.checks[0] in earning))
        }

    @property
    def priced_violations(self) -> list[Quantity]:
        """The quantities of violations that move the score."""
        return self.of(VIOLATIONS)


def subject_of(name: str, registry: Registry) -> Subject:
    """A rule set by name or file, or a penalty.

    Raises:
        RuleSetError: There is none of that name, or it is not sound.
        PluginError: A plugin of the rule set is not installed or broken.
    """
    if name in penalty_names() or name.startswith("penalty."):
        world = World(reference_rules(name), REFERENCE_EVENTS, ungraded=REFERENCE_UNGRADED)
        return _subject(name, world, {}, {}, is_penalty=True)
    return subject_of_rules(load_rule_set(name), registry, name)


def subject_of_rules(rule_set: RuleSet, registry: Registry, name: str = "") -> Subject:
    """A rule set that is loaded.

    Raises:
        PluginError: A plugin of the rule set is not installed or broken.
    """
    measures = {check: measures_of(built) for check, built in rule_set.build(registry).items()}
    world = World(
        rule_set,
        event_checks(rule_set, registry),
        bridged_pauses(rule_set, registry),
        ungraded_checks(rule_set, registry),
        about_humans(rule_set, registry),
        paid_quantities(rule_set, registry),
    )
    return _subject(
        name or rule_set.id, world, measures, facts_of_competition(rule_set.competition, registry)
    )


def _subject(
    name: str,
    world: World,
    measures: Mapping[str, Mapping[str, Measure]],
    facts: Mapping[str, Mapping[str, DeclaredFact]],
    *,
    is_penalty: bool = False,
) -> Subject:
    ties = dict(world.ties)
    score, terms = trees(
        world.rule_set,
        ties,
        events=world.events,
        bridged=world.bridged,
        measures=measures,
        safety=world.safety,
        facts=facts,
        range_of=_range_of,
    )
    behind = {term: (tree, ties[term]) for term, tree in terms.items()}
    return Subject(name, world, score, behind, is_penalty=is_penalty)


def _range_of(node: Node) -> tuple[float, float]:
    """Between what the values of a tree lie; anything where nothing bounds them, or they have none."""
    try:
        typed = Grades().of(node).typed
    except (FormulaError, ZeroDivisionError):
        return -inf, inf
    return typed.least, typed.most
