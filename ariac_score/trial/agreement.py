"""Whether two files that state the same of a trial agree, and which of them counts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import fields, is_dataclass
from typing import Any

from ariac_score.errors import ContradictionError
from ariac_score.trial.model import Trial
from ariac_score.trial.statements import Statement, statement_of
from ariac_score.trial.work import WorkItem, announced_s

__all__ = ["counting_parts", "refuse_other_work", "statements_of"]

_TIMES = ("announced_s",)
"""Fields of work that files may state differently: when it was announced only a log can say."""


def counting_parts(parts: Sequence[Trial], file: object) -> list[Trial]:
    """The parts of a trial of which each states what is its own.

    Where the caller gave a file, another one of its role that lies with the run must agree, and
    then adds nothing.

    Raises:
        ContradictionError: It says something else.
    """
    given = {p.origin.role: p for p in parts if p.origin is not None and p.origin.given}
    kept = []
    for part in parts:
        counts = given.get(part.origin.role) if part.origin is not None else None
        if counts is None or part.origin is None or part.origin.given:
            kept.append(part)
            continue
        refuse_other_work(counts, part, file)
        _refuse_other_statements(counts, part, file)
    return kept


def refuse_other_work(first: Trial, second: Trial, file: object) -> None:
    """Refuse work that two parts of a trial state differently, times aside.

    Raises:
        ContradictionError: Naming both files and the first thing in which they differ.
    """
    for what, one, other in _differences(first.work, second.work):
        raise ContradictionError(what, (_named(first), one), (_named(second), other), file=file)


def _refuse_other_statements(first: Trial, second: Trial, file: object) -> None:
    one, other = dict(first.facts), dict(second.facts)
    pairs: list[tuple[str, Any, Any]] = [
        (name, one.get(name), other.get(name)) for name in sorted({*one, *other})
    ]
    sensors = [
        dict(t.team.sensors) if t.team and t.team.sensors is not None else None for t in (first, second)
    ]
    if None not in sensors:
        pairs.append(("the sensors of the team", *(sorted((s or {}).items()) for s in sensors)))  # type: ignore[arg-type]
    pairs += [("what else it states", a, b) for a, b in [(first.records, second.records)]]
    for what, a, b in pairs:
        if a != b:
            raise ContradictionError(what, (_named(first), _said(a)), (_named(second), _said(b)), file=file)


def _named(part: Trial) -> str:
    return str(part.origin) if part.origin is not None else repr(part.id)


def _said(value: Any) -> str:
    if isinstance(value, tuple | list) and len(value) == 1:
        return _said(value[0])
    text = (
        "nothing"
        if value is None or value in ((), [])
        else f"{value:g}"
        if isinstance(value, float)
        else repr(value)
    )
    return text if len(text) <= 200 else f"{text[:197]}..."


def _differences(
    first: Sequence[WorkItem], second: Sequence[WorkItem], inside: str = ""
) -> Iterator[tuple[str, str, str]]:
    """What differs between two statements of work: what, and what each says of it."""
    one, other = ({item.id: item for item in items} for items in (first, second))
    for name in dict.fromkeys([*one, *other]):
        path = f"{inside}/{name}" if inside else name
        a, b = one.get(name), other.get(name)
        if a is None or b is None:
            known = a or b
            assert known is not None  # the name is of one of them
            there = f"there is {known.level} {name!r}"
            yield (
                f"{known.level} {path!r}",
                there if a else f"there is no {known.level} of that name",
                (there if b else f"there is no {known.level} of that name"),
            )
            continue
        yield from _differences(a.items, b.items, path)
        yield from _in_fields(f"{a.level} {path!r}", a, b)


def _in_fields(what: str, one: WorkItem, other: WorkItem) -> Iterator[tuple[str, str, str]]:
    kept: Any = one
    if is_dataclass(kept) and type(one) is type(other):
        names = [f.name for f in fields(kept) if f.compare and f.name not in _TIMES]
        inner = {id(one.items), id(other.items)}
        for name in names:
            a, b = getattr(one, name), getattr(other, name)
            if a != b and id(a) not in inner:
                yield f"{name} of {what}", _said(a), _said(b)
    elif (one.level, dict(one.facts)) != (other.level, dict(other.facts)):
        yield f"facts of {what}", _said(dict(one.facts)), _said(dict(other.facts))


def statements_of(parts: Sequence[Trial]) -> tuple[Statement, ...]:
    """Whose statement work and set-up of a trial rest on; nothing of a trial that was made by hand.

    Work is the organiser's where he gave it, otherwise that of the log which announces it, otherwise that
    of a file of the run.
    """
    named = [(part, part.origin) for part in parts if part.origin is not None]
    if not named:
        return ()
    given = [origin for part, origin in named if part.work and origin.given]
    announced = [origin for part, origin in named if any(announced_s(item) is not None for item in part.work)]
    others = [origin for part, origin in named if part.work or part.official is not None]
    found = []
    if given or announced or others:
        both = "the log announces the same" if given and announced else ""
        found.append(statement_of("work", given or announced or others, both))
    bounds = [origin for part, origin in named if part.started_s is not None or part.ended_s is not None]
    if bounds:
        found.append(statement_of("window", bounds))
    teams = [origin for part, origin in named if part.team is not None and part.team.sensors is not None]
    if teams:
        registered = [origin for origin in teams if origin.given]
        found.append(statement_of("set-up", registered or teams))
    return tuple(found)
