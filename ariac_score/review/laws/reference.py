"""The made competition on which penalties are compared."""

from __future__ import annotations

from ariac_score.scoring.ruleset import RuleSet, draft_rule_set

__all__ = ["DEFAULT", "REFERENCE_EVENTS", "REFERENCE_UNGRADED", "reference_rules"]

DEFAULT = "penalty.gated_hyperbolic"

# No such plugins are installed, and none are needed: laws are tried on made findings, not on a log.
_REFERENCE = """\
id: reference
title: A made competition, to compare penalties on
source: this program
log_map: none
levels: [part, task, trial]
rules:
  part_color: {use: made.part_color}
  none_unwanted: {use: made.none_unwanted}
monitors:
  separation: {use: made.separation, on_inconclusive: worst_case}
  human_contact: {use: made.human_contact, on_inconclusive: worst_case}
  arm_collision: {use: made.arm_collision}
terms:
  task:
    worth: points(part_color) - 2 * violated(none_unwanted)
score: sum(task.worth)
include: [PENALTY]
safety:
  separation: {class: separation}
  human_contact: {class: contact}
  arm_collision: {class: robot_collision}
"""


REFERENCE_EVENTS = frozenset({"arm_collision"})
"""The checks of the made competition that speak of single events."""


REFERENCE_UNGRADED = frozenset({"human_contact"})
"""Those whose violations have no depth."""


def reference_rules(penalty: str) -> RuleSet:
    """The made competition under one penalty: a point for each part, two off for anything unwanted.

    Raises:
        RuleSetError: There is no such penalty.
    """
    return draft_rule_set(_REFERENCE.replace("PENALTY", penalty), file=f"{penalty} on the made competition")
