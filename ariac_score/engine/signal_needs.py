"""What the checks of a rule set need of a log, and whether anybody has heard of it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ariac_score.checks.captured_output import quiet
from ariac_score.checks.contracts import Monitor, SignalNeed
from ariac_score.checks.guarded import broken
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.errors import RuleSetError, did_you_mean
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.channels import LogMap
from ariac_score.trial.vocabulary import QUANTITIES, Quantity

__all__ = ["check_needs", "needs_of", "needs_of_all", "refuse_other_units"]


def needs_of(plugin: Plugin, name: str, check: Any) -> list[SignalNeed]:
    """What a monitor needs; nothing for a rule.

    Raises:
        PluginError: It raised, or asks for something that is no `SignalNeed`.
    """
    if not isinstance(check, Monitor):
        return []
    try:
        with quiet(plugin.origin):
            asked = check.needs()
            if asked is None:
                raise TypeError("None was returned; yield each, or return a list of them")
            needs = list(asked)
    except (Exception, SystemExit) as cause:
        raise broken(
            plugin, f"raised {type(cause).__name__} when asked what it needs: {cause}", of=name
        ) from cause
    for need in needs:
        if not isinstance(need, SignalNeed):
            raise broken(plugin, f"needs a {type(need).__name__} instead of a SignalNeed", of=name)
    return needs


def needs_of_all(checks: Mapping[str, Any], rule_set: RuleSet, registry: Registry) -> list[SignalNeed]:
    """What all monitors of a rule set need."""
    found = []
    for name, check in checks.items():
        plugin = registry.find(rule_set.checks[name].group, rule_set.checks[name].use)
        found += needs_of(plugin, name, check)
    return found


def check_needs(
    rule_set: RuleSet, checks: Mapping[str, Any], log_map: LogMap, registry: Registry | None = None
) -> None:
    """Find monitors that ask for quantities nobody has heard of, or in another unit, before a log is read.

    Raises:
        RuleSetError: Naming the check and the quantity.
    """
    known = {**QUANTITIES, **log_map.quantities}
    registry = registry or Registry()
    for name in checks:
        for need in needs_of_all({name: checks[name]}, rule_set, registry):
            if need.quantity not in known:
                raise RuleSetError(
                    f"check {name!r} asks for the quantity {need.quantity!r}, which is unknown",
                    file=rule_set.file,
                    place=rule_set.checks[name].place.get("use", name),
                    hint=did_you_mean(need.quantity, known, what="known")
                    + "; declare it under 'quantities:' in the log map",
                )
    refuse_other_units(rule_set, checks, known, registry)


def refuse_other_units(
    rule_set: RuleSet, checks: Mapping[str, Any], known: Mapping[str, Quantity], registry: Registry
) -> None:
    """Refuse a monitor that would read a quantity in another unit than it is measured in.

    Raises:
        RuleSetError: Naming the check, its plugin and both units.
    """
    for name in checks:
        plugin = registry.find(rule_set.checks[name].group, rule_set.checks[name].use)
        for need in needs_of_all({name: checks[name]}, rule_set, registry):
            measured = known.get(need.quantity)
            if measured is not None and measured.unit != need.unit:
                raise RuleSetError(
                    f"check {name!r}: plugin {plugin.origin} reads {need.quantity!r} in {need.unit!r}, "
                    f"but it is measured in {measured.unit!r}",
                    file=rule_set.file,
                    place=rule_set.checks[name].place.get("use", name),
                    hint=f"read it in {measured.unit!r}: in its parameters where they name the unit, "
                    f"else in the code of {plugin.distribution}",
                )
