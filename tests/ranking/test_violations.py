"""What was violated in a competition, by standard and clause."""

from __future__ import annotations

import pytest

from ariac_score import Finding, Verdict
from ariac_score.ranking.violations import Tally, clause_of, tallied

VIOLATED, SATISFIED, UNDECIDED = "violated", "satisfied", "inconclusive"
SEPARATION, CONTACT = ("ISO/TS 15066:2016", "5.5.4"), ("ISO/TS 15066:2016", "5.5.5")


@pytest.mark.parametrize(
    ("cited", "expected"),
    [
        ("ISO/TS 15066:2016, 5.5.4", ("ISO/TS 15066:2016", "5.5.4")),
        (
            "derived from ISO 13850, resetting the emergency stop",
            ("ISO 13850", "resetting the emergency stop (derived)"),
        ),
        ("ARIAC scoring", ("ARIAC scoring", "")),
        ("IEC 60204-1, 9.2.3, stop category 1", ("IEC 60204-1", "9.2.3, stop category 1")),
        (
            "signal coverage (monitor catalogue, 1.4 and M19)",
            ("signal coverage (monitor catalogue, 1.4 and M19)", ""),
        ),
        ("house rules (2024, spring), 3", ("house rules (2024, spring)", "3")),
        ("a bracket (that is never closed, 3", ("a bracket (that is never closed, 3", "")),
        ("", ("plugin.name", "")),
    ],
)
def test_a_citation_names_a_standard_and_a_place_in_it(cited: str, expected: tuple[str, str]) -> None:
    assert clause_of(Finding("robot", Verdict.VIOLATED, "", clause=cited), "plugin.name") == expected


def test_runs_of_all_teams_are_counted_by_clause_those_violated_most_first() -> None:
    runs = [
        (("alpha", "kit", 1), {SEPARATION: {SATISFIED: 1}, CONTACT: {VIOLATED: 1}}),
        (("alpha", "kit", 2), {SEPARATION: {VIOLATED: 2, UNDECIDED: 1}}),
        (("beta", "kit", 1), {SEPARATION: {VIOLATED: 3}}),
    ]

    first, second = tallied(runs)

    assert first == Tally(
        SEPARATION,
        verdicts={SATISFIED: 1, VIOLATED: 5, UNDECIDED: 1},
        violated={"alpha": 2, "beta": 3},
        undecided={"alpha": 1, "beta": 0},
        runs={"alpha": 1, "beta": 1},
    )
    assert (second.clause, second.violated) == (CONTACT, {"alpha": 1})


def test_without_runs_there_is_nothing_to_count() -> None:
    assert tallied([]) == ()
