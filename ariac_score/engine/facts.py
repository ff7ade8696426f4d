"""The facts of a trial and its work items, held against the schemas that their competition brings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ariac_score.checks.contracts import FactSchemas
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.documents.schema import value_errors
from ariac_score.errors import LogError, PluginError
from ariac_score.scoring.levels import DeclaredFact, declared_facts
from ariac_score.scoring.ruleset import Check
from ariac_score.trial.model import Trial
from ariac_score.trial.work import Facts, WorkItem

__all__ = [
    "GROUP",
    "TRIAL",
    "fact_schemas_of",
    "facts_of_competition",
    "refuse_facts_below",
    "refuse_other_facts",
]

GROUP = "ariac_score.fact_schemas"

TRIAL = "trial"
"""The level of the trial itself."""


def fact_schemas_of(competition: str, registry: Registry) -> tuple[Plugin, FactSchemas] | None:
    """The schemas of a competition, with who brings them; `None` where nobody does.

    Raises:
        PluginError: Two distributions bring them, or what is brought is broken.
    """
    if competition not in registry.names(GROUP):
        return None
    plugin = registry.find(GROUP, competition)
    return plugin, plugin.value()


def refuse_other_facts(trial: Trial, schemas: FactSchemas, *, by: Plugin, file: object) -> None:
    """Refuse a trial of which a fact is not as its competition says.

    Args:
        trial: As read.
        schemas: What facts there are at each level.
        by: Who brings the schemas.
        file: What was read, for messages.

    Raises:
        LogError: Naming the item, the fact, what is wrong, and the remedy.
    """
    for level, path, facts in _all_facts(trial):
        faults = value_errors(dict(facts), schemas.levels[level]) if level in schemas.levels else []
        if faults:
            where, cause, hint = faults[0]
            name = ".".join(map(str, where))
            place = f"{level} {path}".rstrip() + (f", fact {name}" if name else "")
            words = f"{cause} (by {by.origin}, which says what facts there are)"
            raise LogError(words, file=file, place=place, hint=hint)


def facts_of_competition(
    competition: Check | None, registry: Registry
) -> Mapping[str, Mapping[str, DeclaredFact]]:
    """The facts that a competition declares, by level and name; none without one, or without a declaration.

    Raises:
        PluginError: It is not installed, or declares facts that are none.
    """
    if competition is None:
        return {}
    plugin = registry.find(competition.group, competition.use)
    try:
        return declared_facts(getattr(plugin.load(), "facts", {}))
    except (ValueError, TypeError, AttributeError) as cause:
        raise PluginError(f"declares facts that are none: {cause}", origin=plugin.origin) from cause


def refuse_facts_below(
    trial: Trial, facts: Mapping[str, Mapping[str, DeclaredFact]], *, by: str, file: object
) -> None:
    """Refuse a trial in which a fact is less than its competition says that it can be, as proofs rely on.

    Args:
        trial: As read.
        facts: What its competition declares, by level and name.
        by: The name of the competition.
        file: What was read, for messages.

    Raises:
        LogError: Naming the item and the fact.
    """
    limits = {
        level: {name: one.least for name, one in own.items() if one.least is not None}
        for level, own in facts.items()
    }
    if not any(limits.values()):
        return
    for level, path, stated in _all_facts(trial):
        for name, least in limits.get(level, {}).items():
            value = stated.get(name)
            if isinstance(value, int | float) and value < least:
                raise LogError(
                    f"{name} is {value:g}, and {by} says that it is never below {least:g}",
                    file=file,
                    place=f"{level} {path}".rstrip(),
                    hint="mend the record that states it",
                )


def _all_facts(trial: Trial) -> Iterator[tuple[str, str, Facts]]:
    """Level, path and facts of the trial and of every item."""
    yield TRIAL, "", trial.facts

    def walk(items: Sequence[WorkItem], above: str) -> Iterator[tuple[str, str, Facts]]:
        for item in items:
            path = f"{above}{item.id}"
            yield item.level, path, item.facts
            yield from walk(item.items, f"{path}/")

    yield from walk(trial.work, "")
