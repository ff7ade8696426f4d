"""Levels of work and the facts of each: what a rule set, or the competition it names, declares."""

from __future__ import annotations

import keyword
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ariac_score.errors import FormulaError, did_you_mean

__all__ = [
    "ALWAYS",
    "NUMBER",
    "TEXT",
    "TRIAL",
    "DeclaredFact",
    "check_levels",
    "declared_facts",
    "facts_as_written",
    "no_such_level",
    "other_name",
]

TRIAL = "trial"
"""The outermost level, which every rule set has."""

NUMBER, TEXT = "number", "text"


@dataclass(frozen=True)
class DeclaredFact:
    """What formulas may know of a fact before any trial states it.

    Attributes:
        type: `number` or `text`.
        unit: Of a number, such as `s`; empty where none is said.
        meaning: In words.
        least: A number is never less, which a competition states of what it counts; `None`: nobody says so. A
            trial in which it is less is refused.
    """

    type: str = NUMBER
    unit: str = ""
    meaning: str = ""
    least: float | None = None


ALWAYS: Mapping[str, Mapping[str, DeclaredFact]] = {
    TRIAL: {"duration_s": DeclaredFact(NUMBER, "s", "from start to end of the competition")}
}
"""The facts that every trial has, whoever judges it."""


def check_levels(levels: Sequence[str], taken: Mapping[str, Iterable[str]]) -> None:
    """Refuse levels that formulas could not name, or could mistake for something else.

    Args:
        levels: From the innermost outwards.
        taken: The names that formulas use for something else, by what that is.

    Raises:
        FormulaError: Naming the level.
    """
    for number, level in enumerate(levels):
        cause = hint = ""
        if not level.isidentifier() or level.startswith("_") or keyword.iskeyword(level):
            cause, hint = f"level {level!r} is no name", "a name is a word of letters, digits and underscores"
        elif level in levels[:number]:
            cause, hint = f"level {level!r} is declared twice", "name each level once"
        for what, names in taken.items():
            if level in names:
                cause, hint = f"level {level!r} is also the name of a {what}", other_name(taken)
        if cause:
            raise FormulaError(cause, place="$.levels", hint=hint)
    if not levels or levels[-1] != TRIAL:
        raise FormulaError(
            f"the last level is {levels[-1]!r}, not {TRIAL!r}" if levels else "there is no level",
            place="$.levels",
            hint=f"name them from the inside out: levels: [object, task, {TRIAL}]",
        )


def other_name(taken: Mapping[str, Iterable[str]]) -> str:
    """What to do about a name that formulas use for something else."""
    names = sorted({name for names in taken.values() for name in names})
    return f"each name must be one thing; formulas use {', '.join(names)} already"


def no_such_level(level: str, levels: Sequence[str], *, place: str, where: str) -> FormulaError:
    """The refusal of a level that is used but not declared, `where` saying by what."""
    inner = ", ".join([level, *levels])
    return FormulaError(
        f"{where}: level {level!r} is not declared",
        place=place,
        hint=f"{did_you_mean(level, levels, what='declared levels')}; to add it, write for instance "
        f"'levels: [{inner}]', or name the competition that declares it",
    )


def declared_facts(stated: Mapping[str, Any]) -> dict[str, dict[str, DeclaredFact]]:
    """The facts of each level, from how a file or a plugin writes them.

    Args:
        stated: By level and name: `number` or `text`, or a mapping with `type`, `unit`, `meaning`, `least`.

    Raises:
        ValueError: Naming a fact that is declared as anything else.
    """
    return {
        level: {name: _fact(f"{level}.{name}", body) for name, body in facts.items()}
        for level, facts in stated.items()
    }


def _fact(name: str, body: Any) -> DeclaredFact:
    if isinstance(body, DeclaredFact):
        return body
    if isinstance(body, str):
        body = {"type": body}
    known: Mapping[str, type | tuple[type, ...]] = {
        "type": str,
        "unit": str,
        "meaning": str,
        "least": (int, float),
    }
    whole = isinstance(body, Mapping) and all(
        key in known and isinstance(value, known[key]) for key, value in body.items()
    )
    if not whole or body.get("type") not in (NUMBER, TEXT):
        raise ValueError(f"fact {name} is declared as {body!r}, not as {NUMBER!r} or {TEXT!r}")
    return DeclaredFact(**body)


def facts_as_written(facts: Mapping[str, Mapping[str, DeclaredFact]]) -> dict[str, dict[str, Any]]:
    """Facts as a rule set writes them, the shortest way; how little they can be is for proofs and readers."""
    return {
        level: {name: _as_written(fact) for name, fact in own.items()} for level, own in facts.items() if own
    }


def _as_written(fact: DeclaredFact) -> Any:
    more = {key: value for key, value in (("unit", fact.unit), ("meaning", fact.meaning)) if value}
    return {"type": fact.type, **more} if more else fact.type
