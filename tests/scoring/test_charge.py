"""What violations cost when one event may be seen by several checks: by hand, at its limits, and its laws."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import FormulaError
from ariac_score.scoring.charge import charge
from ariac_score.scoring.expression import Expression, Number
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.trial.spans import Span, episodes_where

WEIGHTS: dict[str, Number] = {"separation": 0.4, "contact": 1.0}
Timed = tuple[str, float, float]  # check, start, end


def violated(check: str, start_s: float, end_s: float, subject: str = "robot/human") -> Finding:
    return Finding(subject, Verdict.VIOLATED, "m", span=Span(start_s, end_s), check=check)


def numbered(*findings: Finding) -> dict[str, Finding]:
    return {f"{finding.check}#{number}": finding for number, finding in enumerate(findings, start=1)}


def total(*findings: Finding, again_after_s: float = 5.0) -> float:
    return sum(share for _, share in charge(numbered(*findings), WEIGHTS, again_after_s=again_after_s))


@pytest.mark.parametrize(
    ("findings", "expected"),
    [
        ([], 0),
        ([("separation", 10, 10)], 0.4),  # one demerit at once
        ([("separation", 10, 14)], 0.4 * (1 + 4 / 5)),
        ([("separation", 10, 15)], 0.8),  # and one more for 5 s
        ([("contact", 10, 10), ("contact", 16, 16)], 2.0),  # 5 s apart and more: each alone
        ([("contact", 10, 10), ("contact", 15, 15)], 2.0),
        ([("contact", 10, 10), ("contact", 12, 12)], 1.4),  # 10 to 17: 7 s
        ([("contact", 10, 12)], 1.4),  # which is what violating in between costs as well
        # separation 10 to 14 weighs until 19, contact 12 to 12.5 until 17.5: 2 s and 1.5 s at 0.4, 5.5 s at 1
        ([("separation", 10, 14), ("contact", 12, 12.5)], (3.5 * 0.4 + 5.5 * 1.0) / 5),
        ([("separation", 10, 14), ("separation", 10, 14)], 0.72),  # the same thing seen twice
    ],
)
def test_a_charge_is_what_it_is_by_hand(findings: Sequence[Timed], expected: float) -> None:
    assert total(*(violated(*each) for each in findings)) == pytest.approx(expected)


def test_the_share_of_each_finding_is_the_time_it_is_the_heaviest() -> None:
    shares = charge(
        numbered(violated("separation", 10, 14), violated("contact", 12, 12.5)), WEIGHTS, again_after_s=5
    )

    assert dict(shares) == {"separation#1": pytest.approx(3.5 * 0.4 / 5), "contact#2": pytest.approx(1.1)}


def test_a_violation_hidden_under_a_heavier_one_is_named_and_costs_nothing() -> None:
    shares = charge(
        numbered(violated("separation", 10, 11), violated("contact", 9, 12)), WEIGHTS, again_after_s=5
    )

    assert dict(shares)["separation#1"] == 0


def test_other_pairs_of_bodies_are_other_events_whichever_body_is_named_first() -> None:
    one, same = violated("contact", 1, 1, "robot/human"), violated("contact", 1, 1, "human/robot")
    other = violated("contact", 1, 1, "robot/human_2")

    assert total(one, same) == pytest.approx(1.0)
    assert total(one, other) == pytest.approx(2.0)


def test_a_violation_without_a_time_costs_its_weight_and_kept_requirements_nothing() -> None:
    untimed = Finding("robot/human", Verdict.VIOLATED, "m", check="contact")
    kept = Finding("robot/human", Verdict.SATISFIED, "m", span=Span(0, 9), check="contact")

    assert total(untimed, untimed, kept) == 2.0


def test_two_that_are_nearly_5_s_apart_share_what_is_missing() -> None:
    def two(apart_s: float) -> float:
        return total(violated("contact", 10, 10), violated("contact", 10 + apart_s, 10 + apart_s))

    assert two(5 - 1e-6) == pytest.approx(2 - 2e-7, abs=1e-9)
    assert two(np.nextafter(5.0, 9)) == pytest.approx(2.0, abs=1e-12)


# Laws ----------------------------------------------------------------------------------

times = st.integers(0, 200).map(lambda tenths: tenths / 10)
violations = st.builds(
    lambda check, start, length, subject: violated(check, start, start + length, subject),
    st.sampled_from(["separation", "contact"]),
    times,
    st.integers(0, 60).map(lambda tenths: tenths / 10),
    st.sampled_from(["robot/human", "robot/human_2"]),
)


@given(st.lists(violations, max_size=8), violations)
def test_one_more_violation_never_costs_less(some: list[Finding], more: Finding) -> None:
    assert total(*some, more) >= total(*some) - 1e-9


@given(st.lists(violations, max_size=6))
def test_no_more_is_charged_than_each_alone_and_no_less_than_the_costliest(some: list[Finding]) -> None:
    alone = [total(each) for each in some]

    assert total(*some) <= sum(alone) + 1e-9
    assert total(*some) >= max(alone, default=0) - 1e-9


@given(st.lists(st.booleans(), min_size=20, max_size=120), st.data())
def test_a_sample_more_in_violation_never_costs_less_whatever_is_bridged(
    holds: list[bool], data: st.DataObject
) -> None:
    """The trap of counting episodes: filling a pause makes one of two."""
    t = np.arange(len(holds)) / 5
    more = list(holds)
    more[data.draw(st.integers(0, len(holds) - 1))] = True

    def cost(samples: list[bool]) -> float:
        spans = episodes_where(t, np.array(samples), t_off_s=1.0)
        return total(*(violated("separation", span.start_s, span.end_s) for span in spans))

    assert cost(more) >= cost(holds) - 1e-9


@given(times, st.integers(20, 60), st.integers(1, 18), st.integers(1, 9))
def test_a_pause_shorter_than_the_5_s_changes_nothing(start: float, length: int, at: int, gap: int) -> None:
    end, pause = start + length / 10, start + at / 10
    until = min(pause + gap / 10, end)

    whole = total(violated("contact", start, end))
    parts = total(violated("contact", start, pause), violated("contact", until, end))

    assert parts == pytest.approx(whole)


# In formulas ---------------------------------------------------------------------------

TRIAL = Scope("trial", "", {"duration_s": 60.0, "orders": 0})


def sheet(formula: str, **parameters: Number) -> ScoreSheet:
    return ScoreSheet({}, Expression.parse(formula, where="$.score"), frozenset(WEIGHTS), parameters)


def test_a_formula_charges_checks_at_weights_that_may_be_parameters() -> None:
    formula = "charged(separation=w, contact=2 * w, again_after_s=10)"
    findings = numbered(violated("separation", 0, 5), violated("contact", 30, 30))

    found = sheet(formula, w=0.5).evaluate(TRIAL, findings)

    assert found.value == pytest.approx(0.5 * 1.5 + 1.0)
    assert sheet(formula, w=0.5).priced == {"separation", "contact"}
    assert [child.value for child in found.children[0].children] == [1.0, 0.75]  # in order of id


@pytest.mark.parametrize(
    ("formula", "cause"),
    [
        ("charged()", "wrong arguments"),
        ("charged(again_after_s=5)", "wrong arguments"),
        ("charged(separation)", "wrong arguments"),
        ("charged(seperation=0.4)", "'seperation', which is no check"),
        ("charged(separation=nothing)", "unknown name 'nothing'"),
        ("occurrences(separation, tau_s=5)", "wrong arguments"),
    ],
)
def test_a_mistaken_charge_is_refused_when_the_sheet_is_made(formula: str, cause: str) -> None:
    with pytest.raises(FormulaError) as refused:
        sheet(formula)

    assert cause in str(refused.value)


@pytest.mark.parametrize(
    ("formula", "cause"),
    [
        ("charged(separation=0 - 0.4)", "the weight of 'separation' is negative"),
        ("charged(separation=1, again_after_s=0)", "again_after_s must be at least 1 s"),
        ("charged(contact=1)", "'contact' says nothing about the trial"),
        ("occurrences(separation, every_s=0)", "every_s must be positive"),
    ],
)
def test_a_charge_that_makes_no_sense_is_refused_when_it_is_made(formula: str, cause: str) -> None:
    with pytest.raises(FormulaError) as refused:
        sheet(formula).evaluate(TRIAL, numbered(violated("separation", 0, 1)))

    assert cause in str(refused.value)


@pytest.mark.parametrize(
    ("duration_s", "expected"),
    [(0.5, 1), (4.9, 1), (5.0, 2), (12.3, 3), (25.0, 6), (np.nextafter(5.0, 9), 2), (4.999999, 1)],
)
def test_worked_example_w16_1_occurrences_come_again_every_5_s(duration_s: float, expected: int) -> None:
    findings = numbered(violated("separation", 0, duration_s))

    assert sheet("occurrences(separation, every_s=5)").evaluate(TRIAL, findings).value == expected


def test_an_occurrence_of_5_s_is_one_however_its_ends_were_rounded() -> None:
    findings = numbered(violated("separation", 0.1 + 0.2, 5.3))  # 4.999999999999999… s

    assert sheet("occurrences(separation)").evaluate(TRIAL, findings).value == 2
