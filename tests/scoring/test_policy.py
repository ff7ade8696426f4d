"""What an undecided finding counts as, and the law that not knowing never pays."""

from __future__ import annotations

from dataclasses import replace
from decimal import Decimal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.scoring import pricing
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.policy import POLICIES, Assumption, assume, ideal
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.trial.spans import Span

LAWFUL = settings(max_examples=100, derandomize=True, deadline=None)
TRIAL = Scope("trial", "", {"duration_s": 60.0, "orders": 0})

UNDECIDED = Finding("r/h", Verdict.INCONCLUSIVE, "no samples", span=Span(10.0, 14.0), check="separation")
KEPT = Finding("r/h", Verdict.SATISFIED, "kept", check="separation")
BROKEN = Finding(
    "r/h",
    Verdict.VIOLATED,
    "too near",
    span=Span(0.0, 4.0),
    quantities={"time_in_violation_s": 4.0, "relative_depth_integral_s": 1.0},
    check="separation",
)


def price(finding: Finding, score: str) -> float:
    sheet = ScoreSheet({}, Expression.parse(score, where="$.score"), frozenset({"separation"}))
    return sheet.evaluate(TRIAL, {"separation#1": finding}).value


def assumed(policy: str, *findings: Finding, priced: tuple[str, ...] = ("separation",)) -> list[Finding]:
    by_id = {f"separation#{i}": f for i, f in enumerate(findings)}
    return list(assume(by_id, {"separation": policy}, priced=priced).findings.values())


@pytest.mark.parametrize("policy", sorted(POLICIES))
@pytest.mark.parametrize("decided", [KEPT, BROKEN, replace(KEPT, verdict=Verdict.NOT_APPLICABLE)])
def test_what_is_decided_stays_as_it_is(policy: str, decided: Finding) -> None:
    outcome = assume({"a": decided}, {"separation": policy}, priced=["separation"])

    assert outcome.findings == {"a": decided}
    assert outcome.assumptions == ()


@pytest.mark.parametrize("policy", sorted(POLICIES))
def test_what_is_undecided_and_not_priced_stays_undecided_and_withholds_nothing(policy: str) -> None:
    outcome = assume({"a": UNDECIDED}, {"separation": policy}, priced=["other"])

    assert outcome.findings == {"a": UNDECIDED}
    assert (outcome.assumptions, outcome.withheld, outcome.zeroed) == ((), (), ())


def test_a_rule_set_can_withhold_the_score_for_an_undecided_finding() -> None:
    findings = {"a": UNDECIDED, "b": BROKEN}
    outcome = assume(findings, {"separation": "withhold"}, priced=["separation"])

    assert outcome.withheld == (Assumption("a", "separation", "withhold", "no samples"),)
    assert outcome.zeroed == ()


def test_one_undecided_finding_among_many_withholds_the_score() -> None:
    findings = {f"f{i}": KEPT for i in range(9)} | {"f4": UNDECIDED}

    outcome = assume(findings, {"separation": "withhold"}, priced=["separation"])
    assert [a.finding for a in outcome.withheld] == ["f4"]


@pytest.mark.parametrize("policies", [{"separation": "open"}, {}])
def test_by_default_an_undecided_finding_stays_open_and_nothing_is_assumed(policies: dict[str, str]) -> None:
    outcome = assume({"a": UNDECIDED}, policies, priced=["separation"])

    assert (outcome.findings, outcome.assumptions) == ({"a": UNDECIDED}, ())


def test_zero_says_so_and_does_not_withhold() -> None:
    outcome = assume({"a": UNDECIDED}, {"separation": "zero"}, priced=["separation"])

    assert [a.finding for a in outcome.zeroed] == ["a"]
    assert outcome.withheld == ()


def test_the_worst_case_is_a_critical_violation_at_full_depth_for_all_of_the_time() -> None:
    (worst,) = assumed("worst_case", UNDECIDED)

    assert worst.verdict is Verdict.VIOLATED
    assert worst.critical
    assert worst.quantities == {"time_in_violation_s": 4.0, "relative_depth_integral_s": 4.0}
    assert price(worst, "demerits(separation)") == 1 + 4.0 / 5
    assert price(worst, "gate(separation)") == 0


def test_an_excluded_finding_counts_as_though_nobody_had_asked() -> None:
    (left_out,) = assumed("exclude", UNDECIDED)

    assert left_out.verdict is Verdict.NOT_APPLICABLE
    assert [price(left_out, f"{f}(separation)") for f in ("points", "count", "violated", "demerits")] == [
        0
    ] * 4
    assert price(left_out, "holds(separation)") == 1


@pytest.mark.parametrize("policy", ["worst_case", "exclude", "zero"])
def test_every_assumption_is_told_in_order_of_the_findings(policy: str) -> None:
    outcome = assume({"b": UNDECIDED, "a": UNDECIDED}, {"separation": policy}, priced=["separation"])

    assert [(a.finding, a.policy) for a in outcome.assumptions] == [("a", policy), ("b", policy)]


SHEETS = st.sampled_from(
    [
        "10 - 0.4 * demerits(separation, tau_s=5)",
        "10 / (1 + demerits(separation))",
        "10 * gate(separation)",
        "10 * holds(separation)",
        "10 - violated(separation)",
        "10 - count(separation)",
        "10 - seconds(separation)",
        "10 * product(separation, p=0.6)",
        "points(separation)",
    ]
)


@LAWFUL
@given(SHEETS, st.floats(0, 60), st.floats(0, 1), st.floats(0, 1), st.booleans())
def test_under_the_worst_case_not_knowing_never_beats_a_known_violation(
    sheet: str, lasts_s: float, share: float, depth: float, critical: bool
) -> None:
    # Whatever happened in a stretch that was not seen: one violation within it, of any length and depth.
    span = Span(0.0, lasts_s)
    unseen = replace(UNDECIDED, span=span)
    seconds = lasts_s * share
    known = replace(
        BROKEN,
        span=Span(0.0, seconds),
        quantities={"time_in_violation_s": seconds, "relative_depth_integral_s": seconds * depth},
        critical=critical,
    )

    (worst,) = assumed("worst_case", unseen)

    assert (
        price(worst, sheet) <= price(known, sheet) <= price(replace(known, verdict=Verdict.SATISFIED), sheet)
    )


def test_the_ideal_trial_kept_everything_it_was_asked() -> None:
    none = replace(KEPT, verdict=Verdict.NOT_APPLICABLE)
    best = ideal({"a": BROKEN, "b": UNDECIDED, "c": none, "d": KEPT})

    assert [best[key].verdict for key in "abcd"] == [
        Verdict.SATISFIED,
        Verdict.SATISFIED,
        Verdict.NOT_APPLICABLE,
        Verdict.SATISFIED,
    ]


@pytest.mark.parametrize("verdict", [Verdict.SATISFIED, Verdict.VIOLATED, Verdict.INCONCLUSIVE])
def test_the_ideal_trial_measured_the_best_that_a_check_declares(verdict: Verdict) -> None:
    declared = {
        "time_s": Measure("s", best=2.0),
        "fine": Measure("1", "penalty"),
        "share": Measure("1", "factor"),
        "points": Measure("points", "points", best=9.0),
        "mass_kg": Measure("kg"),
    }
    quantities = {"time_s": 7.0, "fine": 7.0, "share": 0.7, "points": 7.0, "mass_kg": 7.0, "other": 7.0}
    finding = replace(KEPT, verdict=verdict, check="c", quantities=quantities)

    best = ideal({"c#0": finding}, {"c": declared, "d": {"other": Measure("1", best=1.0)}})["c#0"]

    assert best.quantities == quantities | {"time_s": 2.0, "fine": 0.0, "share": 1.0}
    assert best.verdict is Verdict.SATISFIED


def test_the_ideal_trial_has_no_numbers_of_what_does_not_apply_or_was_not_measured() -> None:
    declared = {"c": {"share": Measure("1", "factor"), "mass_kg": Measure("kg")}}
    none = replace(KEPT, verdict=Verdict.NOT_APPLICABLE, check="c", quantities={"share": 0.5})
    kept = replace(KEPT, check="c", quantities={})
    unknown = replace(UNDECIDED, check="c", quantities={})

    best = ideal({"none": none, "kept": kept, "unknown": unknown}, declared)

    assert best["none"] == none
    assert best["kept"] == kept
    # Nobody could judge it: without a number a product with it would be 0.
    assert best["unknown"].quantities == {"share": 1.0}


@pytest.mark.parametrize(
    ("declared", "possible"),
    [
        (None, "0.3125"),  # nobody says what is best: as it was measured
        (Measure("s", best=0.0), "0.5"),
        (Measure("s", best=20.0), "0.25"),
        (Measure("s", "points", best=0.0), "0.3125"),
    ],
)
def test_what_was_possible_is_with_the_best_that_a_check_declares(
    declared: Measure | None, possible: str
) -> None:
    # 5 s are optimal, and no less than 10 s count: in 16 s 5/16, at best 5/10.
    measured = replace(BROKEN, check="way", quantities={"time_s": 16.0})
    sheet = ScoreSheet(
        {}, Expression.parse("holds(way) * 5 / clip(measure(way, time_s), 10, 40)"), frozenset({"way"})
    )

    priced = pricing.price(
        {"way#0": measured},
        Scope("trial", "", {}),
        sheet,
        {},
        digits=4,
        measures={"way": {"time_s": declared}} if declared else None,
    )

    assert priced.possible == Decimal(possible)
