"""A rule set, or a penalty on the made competition, as what laws are proven of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from ariac_score.checks.measures import measures_of
from ariac_score.checks.registry import Registry
from ariac_score.review.laws.cases import World
from ariac_score.review.laws.proving import bridged_pauses, event_checks
from ariac_score.review.laws.reference import REFERENCE_EVENTS, reference_rules
from ariac_score.review.proofs.grades import Grade, Grades
from ariac_score.review.proofs.quantities import TASK, VIOLATIONS, Quantity
from ariac_score.review.proofs.tree import Term, inputs_of, score_tree
from ariac_score.scoring.penalties import penalty_names
from ariac_score.scoring.ruleset import RuleSet, load_rule_set

__all__ = ["Subject", "subject_of"]


@dataclass(frozen=True)
class Subject:
    """What laws are proven of.

    Attributes:
        name: As it was asked for.
        world: The rule set as laws see it.
        tree: Its score.
        is_penalty: Whether it is a penalty, on the made competition.
        whole: What is known of the score.
        grades: Where signs were lost.
    """

    name: str
    world: World
    tree: Term
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
        """What is known of it where it is not 0."""
        return Grades(nonzero=True).of(self.tree)

    @cached_property
    def quantities(self) -> Mapping[str, Quantity]:
        """Everything that the score takes from a trial, by name."""
        return {one.name: one for one in inputs_of(self.tree)}

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
            if one.of == TASK and (one.grows or one.checks[0] in earning)
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
        rule_set = reference_rules(name)
        world = World(rule_set, REFERENCE_EVENTS)
        tree = score_tree(rule_set, events=REFERENCE_EVENTS, bridged={}, measures={}, safety=world.safety)
        return Subject(name, world, tree, is_penalty=True)
    rule_set = load_rule_set(name)
    events, bridged = event_checks(rule_set, registry), bridged_pauses(rule_set, registry)
    measures = {check: measures_of(built) for check, built in rule_set.build(registry).items()}
    world = World(rule_set, events, bridged)
    tree = score_tree(rule_set, events=events, bridged=bridged, measures=measures, safety=world.safety)
    return Subject(name, world, tree)
