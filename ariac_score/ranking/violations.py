"""Violations in the runs of a competition, counted by standard and clause."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.ranking.competition import RunKey
from ariac_score.results.result import Measured

__all__ = ["Clause", "Tally", "clause_of", "tallied", "verdicts_of"]

Clause = tuple[str, str]
"""A standard or rulebook, and the place in it."""
Verdicts = Mapping[Clause, Mapping[str, int]]
"""How many findings of each verdict there are, by clause."""

_DERIVED = "derived from "


@dataclass(frozen=True)
class Tally:
    """One clause over a whole competition.

    Attributes:
        clause: Standard and place.
        verdicts: How many findings of each verdict, over all teams.
        violated: By team how many violations.
        undecided: By team how many findings could not be decided.
        runs: By team in how many runs it was violated.
    """

    clause: Clause
    verdicts: Mapping[str, int] = field(default_factory=dict)
    violated: Mapping[str, int] = field(default_factory=dict)
    undecided: Mapping[str, int] = field(default_factory=dict)
    runs: Mapping[str, int] = field(default_factory=dict)


def clause_of(finding: Finding, use: str) -> Clause:
    """The standard and the place in it that a finding cites; without any the plugin that made it.

    Authors of plugins and rule sets write citations as text, so the text is all there is to go by.
    Up to the first comma it names the standard, unless the comma is in brackets.

    >>> clause_of(Finding("robot", Verdict.SATISFIED, "", clause="ISO/TS 15066:2016, 5.5.4"), "x")
    ('ISO/TS 15066:2016', '5.5.4')
    """
    derived = finding.clause.startswith(_DERIVED)
    cited = finding.clause.removeprefix(_DERIVED)
    comma = _first_comma_outside_brackets(cited)
    standard, place = cited[:comma], cited[comma + 2 :]
    if not standard:
        return use, ""
    return standard, f"{place} (derived)" if derived else place


def _first_comma_outside_brackets(text: str) -> int:
    commas = (found.start() for found in re.finditer(", ", text))
    return next((at for at in commas if text.count("(", 0, at) <= text.count(")", 0, at)), len(text))


def verdicts_of(measured: Measured, uses: Mapping[str, str]) -> dict[Clause, dict[str, int]]:
    """The findings of one run, counted by clause and verdict.

    Args:
        measured: The run.
        uses: For each check the plugin it uses.
    """
    found: dict[Clause, Counter[str]] = {}
    for finding in measured.findings.values():
        clause = clause_of(finding, uses.get(finding.check, finding.check))
        found.setdefault(clause, Counter())[finding.verdict.value] += 1
    return {clause: dict(counts) for clause, counts in sorted(found.items())}


def tallied(runs: Iterable[tuple[RunKey, Verdicts]]) -> tuple[Tally, ...]:
    """The clauses of a competition, those violated most first.

    Args:
        runs: The counts of each run (`verdicts_of`).
    """
    verdicts: dict[Clause, Counter[str]] = {}
    by_team: dict[tuple[Clause, str], Counter[str]] = {}
    for (team, _, _), found in runs:
        for clause, counts in found.items():
            verdicts.setdefault(clause, Counter()).update(counts)
            for verdict in (Verdict.VIOLATED.value, Verdict.INCONCLUSIVE.value):
                by_team.setdefault((clause, verdict), Counter())[team] += counts.get(verdict, 0)
            by_team.setdefault((clause, "runs"), Counter())[team] += bool(counts.get(Verdict.VIOLATED.value))
    tallies = [
        Tally(
            clause,
            dict(counts),
            dict(by_team[clause, Verdict.VIOLATED.value]),
            dict(by_team[clause, Verdict.INCONCLUSIVE.value]),
            dict(by_team[clause, "runs"]),
        )
        for clause, counts in verdicts.items()
    ]
    return tuple(
        sorted(tallies, key=lambda tally: (-tally.verdicts.get(Verdict.VIOLATED.value, 0), tally.clause))
    )
