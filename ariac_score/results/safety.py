"""Which checks of a rule set are about safety."""

from __future__ import annotations

from ariac_score.results.result import Measured
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["safety_checks"]

_MONITORS = "ariac_score.monitors"
_OF_SAFETY = frozenset({"penalty", "factor"})


def safety_checks(rule_set: RuleSet, measured: Measured) -> tuple[str, ...]:
    """The checks that are about safety, in the order of the rule set.

    That is declared, never read from a name. A plugin may say `part_of`; of others a monitor watches
    for safety, and so does a rule whose quantities are all penalties or factors, which can only take.

    Args:
        rule_set: The rules.
        measured: What was found by them, with what each check declares.
    """
    return tuple(name for name in rule_set.checks if _part_of(name, rule_set, measured) == "safety")


def _part_of(name: str, rule_set: RuleSet, measured: Measured) -> str:
    said = measured.settings.get(name) if measured.settings else None
    if said is not None and said.part_of:
        return said.part_of
    declared = measured.measures.get(name, {}).values()
    only_takes = bool(declared) and all(one.role in _OF_SAFETY for one in declared)
    return "safety" if only_takes or rule_set.checks[name].group == _MONITORS else "task"
