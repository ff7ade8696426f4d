"""The facts of a trial and its work items, held against the schemas that their competition brings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ariac_score.checks.contracts import FactSchemas
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.documents.schema import value_errors
from ariac_score.errors import LogError
from ariac_score.trial.model import Trial
from ariac_score.trial.work import Facts, WorkItem

__all__ = ["GROUP", "TRIAL", "fact_schemas_of", "refuse_other_facts"]

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


def _all_facts(trial: Trial) -> Iterator[tuple[str, str, Facts]]:
    """Level, path and facts of the trial and of every item."""
    yield TRIAL, "", trial.facts

    def walk(items: Sequence[WorkItem], above: str) -> Iterator[tuple[str, str, Facts]]:
        for item in items:
            path = f"{above}{item.id}"
            yield item.level, path, item.facts
            yield from walk(item.items, f"{path}/")

    yield from walk(trial.work, "")
