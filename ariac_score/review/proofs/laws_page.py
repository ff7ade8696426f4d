"""The table of `docs/laws.md`: which law is proven of which shipped rule set, and which must be."""

from __future__ import annotations

from collections.abc import Iterator

from ariac_score.checks.registry import Registry
from ariac_score.review.laws.prices import ALL_LAWS
from ariac_score.review.proofs.proving import Judged, prove
from ariac_score.review.proofs.solver import find_solver
from ariac_score.review.proofs.subject import Subject, subject_of
from ariac_score.scoring.ruleset import rule_set_names

__all__ = ["laws_table", "must_be_proven"]

_ALWAYS = frozenset({"waiting", "unknown"})
_OF_PENALTIES = frozenset(
    {
        "more_violations",
        "nothing_left",
        "log_rate",
        "short_pause",
        "severity",
        "running_again",
        "standing_still",
    }
)
_MARKS = {"proven": "proven", "refuted": "**no**", "open": "?", "not_applicable": ""}


def must_be_proven(subject: Subject) -> frozenset[str]:
    """The laws that a shipped rule set may neither break nor leave open.

    Of every rule set that waiting changes nothing and that unknown never beats known; of one with a penalty
    also that violations never help, whatever the log rate and however they are split, that deeper ones cost
    more, that they still count where nothing is left, that running again changes nothing, and that who stands
    still is not charged for what a human does.
    """
    has_penalty = "safety_demerits" in subject.rule_set.sheet.terms.get("trial", {})
    return _ALWAYS | _OF_PENALTIES if has_penalty else _ALWAYS


def laws_table(*, cases: int = 25) -> str:
    """The table, a row for all rule sets of which the same is known; the solver must be installed."""
    registry, solver = Registry(), find_solver()
    rows: dict[tuple[str, ...], list[str]] = {}
    for name in rule_set_names(registry):
        subject = subject_of(name, registry)
        judged = prove(subject, cases=cases, steps=0, solver=solver)
        rows.setdefault(tuple(_marks(subject, judged)), []).append(f"`{name}`")
    return "".join(_lines(rows))


def _marks(subject: Subject, judged: tuple[Judged, ...]) -> Iterator[str]:
    must = must_be_proven(subject)
    found = {one.law.name: one for one in judged}
    for law in ALL_LAWS:
        one = found[law.name]
        mark = _MARKS[one.verdict]
        if one.declared and one.verdict != "proven":
            mark = "**no**, declared"
        yield f"{mark} (must)" if mark and law.name in must else mark


def _lines(rows: dict[tuple[str, ...], list[str]]) -> Iterator[str]:
    yield f"| rule sets | {' | '.join(law.says for law in ALL_LAWS)} |\n|---|{'---|' * len(ALL_LAWS)}\n"
    for marks, names in sorted(rows.items(), key=lambda row: row[1]):
        yield f"| {', '.join(names)} | {' | '.join(marks)} |\n"
