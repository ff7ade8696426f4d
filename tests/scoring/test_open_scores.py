"""A trial is priced in the best and in the worst world that its log allows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from itertools import product
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.checks.open_findings import Cause, OpenFindings
from ariac_score.scoring.bounds import MOST_TRIED, Worlds
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.left_open import LeftOpen
from ariac_score.scoring.pricing import Priced, price
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.settled import MOST_TRIED_FOR_CAUSES
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.scoring.signs import Typed
from ariac_score.trial.spans import Span

TRIAL = Scope("trial", "", {"duration_s": 60.0})
CHECKS = frozenset({"collision", "drop", "near", "pose", "worth"})
VERDICTS = {"s": Verdict.SATISFIED, "v": Verdict.VIOLATED, "i": Verdict.INCONCLUSIVE}


def sheet(score: str, **terms: str) -> ScoreSheet:
    return ScoreSheet(
        {"trial": {name: Expression.parse(text, where=name) for name, text in terms.items()}},
        Expression.parse(score, where="score"),
        CHECKS,
    )


def found(**verdicts: str) -> dict[str, Finding]:
    """Findings by check: a letter each for satisfied, violated, inconclusive."""
    return {
        f"{check}#{n}": Finding(f"part_{n}", VERDICTS[letter], "the tray was not seen", check=check)
        for check, letters in verdicts.items()
        for n, letter in enumerate(letters, start=1)
    }


def priced(score: str, findings: Mapping[str, Finding], **more: Any) -> Priced:
    more = {"digits": 6, "policies": {}, "left_open": LeftOpen(), **more}
    policies = more.pop("policies")
    return price(findings, TRIAL, sheet(score), policies, **more)


def ends(one: Priced) -> tuple[Decimal, Decimal] | None:
    return None if one.interval is None else (one.interval.least, one.interval.most)


def gap(
    best: Mapping[str, Finding], worst: Mapping[str, Finding], *spans: Span, tight: bool = True
) -> OpenFindings:
    some = next(iter({**best, **worst}.values()))
    return OpenFindings(
        some.check, some.subject, best, worst, (Cause("a gap of 3 s", "/snapshot", spans),), tight
    )


def near(start_s: float, end_s: float, name: str = "1", *, depth: float = 1.0) -> dict[str, Finding]:
    """A violation of the separation."""
    length_s = end_s - start_s
    quantities = {"time_in_violation_s": length_s, "relative_depth_integral_s": depth * length_s}
    key = f"near#{name}"
    return {
        key: Finding(
            "robot/human",
            Verdict.VIOLATED,
            "too near",
            Span(start_s, end_s),
            quantities=quantities,
            check="near",
        )
    }


CLEAR = {"near#best1": Finding("robot/human", Verdict.SATISFIED, "never near", check="near")}


# Worked cases (methods, sections 4.7 and 4.8) ------------------------------------------


def test_g21_a_price_that_falls_is_exact_at_both_ends() -> None:
    # 12 / (1 + 0.55) and 12 / 1: 7.741935 and 12.
    open_ = gap(CLEAR, near(10.0, 10.55, "worst1"), Span(9.0, 12.0))
    one = priced("12 / (1 + measure(near, relative_depth_integral_s))", {}, left_open=LeftOpen((open_,)))

    assert ends(one) == (Decimal("7.741935"), Decimal("12.000000"))
    assert one.interval is not None
    assert one.interval.tight
    assert one.ledger is not None
    assert one.ledger.amount == Decimal("7.741935")


def test_g22_the_world_where_all_is_worst_is_not_the_worst_world() -> None:
    # 0 if collision else 10 - 2 n, n up to 7: all worst gives 0, all best 10, the least is -4.
    one = priced("0 if violated(collision) else 10 - 2 * count(drop)", found(collision="i", drop="iiiiiii"))

    assert ends(one) == (Decimal("-4.000000"), Decimal("10.000000"))
    assert one.status == "scored"
    assert one.ledger is not None
    assert one.ledger.amount == Decimal(-4)
    assert {a.policy for a in one.assumptions if a.check == "drop"} == {"worst"}
    assert {a.policy for a in one.assumptions if a.check == "collision"} == {"best"}


@pytest.mark.parametrize(
    ("score", "worth"), [("100 - measure(near, force_N)", 93), ("100 - occurrences(near, every_s=1)", 93)]
)
def test_what_both_worlds_have_alike_is_open_for_nobody(score: str, worth: int) -> None:
    """Two violations, of 5 and of 2 N, of 4 and of 1 s; only how long somebody was near is open."""

    def world(name: str, exposure_s: float) -> dict[str, Finding]:
        each = {**near(10.0, 14.0, f"{name}1"), **near(20.0, 21.0, f"{name}2")}
        return {
            key: replace(f, quantities={**f.quantities, "exposure_s": exposure_s, "force_N": force_n})
            for (key, f), force_n in zip(each.items(), (5.0, 2.0), strict=True)
        }

    alike = LeftOpen((gap(world("best", 6.0), world("worst", 7.0)),))
    one = priced(score, {}, left_open=alike)
    assert ends(one) is None
    assert one.ledger is not None
    assert one.ledger.amount == worth

    # Where one of the forces may have been larger, nobody knows which.
    other = {
        key: replace(f, quantities={**f.quantities, "force_N": 6.0}) for key, f in world("worst", 7.0).items()
    }
    open_ = ends(
        priced("100 - measure(near, force_N)", {}, left_open=LeftOpen((gap(world("best", 6.0), other),)))
    )
    assert open_ is not None
    assert open_[0] <= 88


# What counts ---------------------------------------------------------------------------

UNDECIDED = found(pose="siv")


def test_the_rule_set_says_which_end_counts() -> None:
    by = {
        counts: priced("points(pose)", UNDECIDED, left_open=LeftOpen(counts=counts))
        for counts in ("worst", "best", "withhold")
    }

    assert {name: ends(one) for name, one in by.items()} == dict.fromkeys(by, (Decimal(1), Decimal(2)))
    assert by["worst"].ledger is not None
    assert by["worst"].ledger.amount == 1
    assert by["best"].ledger is not None
    assert by["best"].ledger.amount == 2
    assert (by["withhold"].status, by["withhold"].ledger) == ("incomplete", None)


def test_a_check_with_a_policy_of_its_own_is_not_open() -> None:
    assert ends(priced("points(pose)", UNDECIDED, policies={"pose": "exclude"})) is None
    assert priced("points(pose)", UNDECIDED, policies={"pose": "withhold"}).status == "incomplete"
    assert priced("points(pose)", UNDECIDED, policies={"pose": "zero"}).ledger.amount == 0  # type: ignore[union-attr]


def test_what_cannot_change_the_score_leaves_it_a_number() -> None:
    one = priced("0 * points(pose) + 3", UNDECIDED)
    assert (one.status, one.interval, one.ledger and one.ledger.amount) == ("scored", None, 3)


def test_the_ledger_says_what_was_not_seen() -> None:
    one = priced("10 - 2 * count(pose)", found(pose="sii"))

    assert one.ledger is not None
    told = {line.label for line in one.ledger.walk()}
    assert "not seen, counted at its worst: the tray was not seen" in told


def test_what_nothing_bounds_has_no_score_and_says_why() -> None:
    # Nobody watched for drops, so there may have been any number; and any time may be the best.
    monitors = LeftOpen(monitors=frozenset({"drop"}))
    one = priced("10 - count(drop)", found(drop="i"), left_open=monitors)
    assert (one.status, one.interval) == ("incomplete", None)
    assert one.missing == "nothing bounds count(drop) of part_1: the tray was not seen"

    bounded = priced("max(0, 10 - count(drop))", found(drop="i"), left_open=monitors)
    assert ends(bounded) == (Decimal(0), Decimal(10))


def test_what_stewards_call_violated_is_one_violation_at_best_and_all_that_it_was_at_worst() -> None:
    # In 10 s with pauses of 2 s between them there may have been 5, as long as 10 s together.
    key, undecided = next(iter(found(drop="i").items()))
    stretch = replace(undecided, span=Span(0.0, 10.0))
    ruled = {key: replace(stretch, verdict=Verdict.VIOLATED)}
    before = LeftOpen(monitors=frozenset({"drop"}), pauses_s={"drop": 2.0})
    after = replace(before, ruled=frozenset({key}))

    for score, least, at_best in (("10 - count(drop)", 5, 9), ("10 - seconds(drop)", 0, 10)):
        assert ends(priced(score, {key: stretch}, left_open=before)) == (least, 10)
        assert ends(priced(score, ruled, left_open=after)) == (least, at_best)


def test_a_score_without_a_bound_says_between_what_its_terms_lie() -> None:
    """Four parts at 2 points, one of them undecided: 6 to 8. Drops cost a point each, and nobody watched."""
    work = sheet("earned - lost", earned="2 * points(pose)", lost="count(drop)")
    one = price(
        found(drop="i", pose="sssi"),
        TRIAL,
        work,
        {},
        digits=6,
        left_open=LeftOpen(monitors=frozenset({"drop"})),
    )
    assert one.status == "incomplete"
    assert one.missing.endswith("; what is known: the score at most 8, earned 6 to 8, lost at least 0")


def test_a_rule_that_bounds_its_numbers_is_kept_or_broken_in_what_hangs_on_it_either_way() -> None:
    """0.5 less for what was not worth it, 1 to 3 where it was: nothing between says more."""
    ends_of = {
        "best": {
            "worth#best1": Finding("part_1", VERDICTS["s"], "it was", check="worth", quantities={"w": 3.0})
        },
        "worst": {
            "worth#worst1": Finding(
                "part_1", VERDICTS["v"], "it was not", check="worth", quantities={"w": 1.0}
            )
        },
    }
    left_open = LeftOpen((OpenFindings("worth", "part_1", **ends_of),))
    formula = "max(0, 5 - measure(worth, w) / points(worth)) if points(worth) else 2"
    assert ends(priced(formula, found(worth="i"), left_open=left_open)) == (2, 4)


def test_declared_quantities_bound_what_is_undecided() -> None:
    measures = {"worth": {"value": Measure("points", "points", best=5.0, worst=-1.0)}}
    one = priced("measure(worth, value)", found(worth="i"), measures=measures)
    assert ends(one) == (Decimal(-1), Decimal(5))

    assert priced("measure(worth, value)", found(worth="i")).status == "incomplete"


# Episodes (methods, 4.6) ---------------------------------------------------------------


def test_a_worst_world_with_more_violations_costs_more_however_they_are_priced() -> None:
    # Two in the best world that may be one; in the worst all the gap, within which one may have begun twice.
    best = near(9.0, 11.0, "best1")
    touches = {**near(11.0, 11.0, "worst2"), **near(12.0, 12.0, "worst3")}
    left = LeftOpen((gap(best, {**near(9.0, 14.0, "worst1"), **touches}, Span(10.0, 13.0)),))

    assert ends(priced("-count(near)", {}, left_open=left)) == (Decimal(-3), Decimal(-1))
    assert ends(priced("-seconds(near)", {}, left_open=left)) == (Decimal(-5), Decimal(-2))
    assert ends(priced("-demerits(near)", {}, left_open=left)) == (Decimal(-4), Decimal("-1.4"))
    assert ends(priced("12 * product(near, p=0.5)", {}, left_open=left)) == (Decimal("1.5"), Decimal(6))


def test_a_bound_that_no_single_world_has_is_a_line_of_its_own_and_not_called_tight() -> None:
    # Again every 2 s: two of 3.9 s are 2 x 2, and all of it in one 1 + 3; nobody knows which it was.
    worst = {**near(9.0, 12.9, "worst1"), **near(14.0, 17.9, "worst2")}
    left = LeftOpen((gap(CLEAR, worst, Span(9.0, 18.0)),))
    one = priced("20 - occurrences(near, every_s=2)", {}, left_open=left)

    assert one.interval is not None
    assert not one.interval.tight
    assert one.ledger is not None
    assert one.ledger.amount == one.interval.least == 20 - (2 + 3)
    assert [line.amount for line in one.ledger.children if line.path.endswith("/bound")] == [Decimal(-1)]


# What would narrow it ------------------------------------------------------------------


def test_what_would_narrow_it_is_told_by_cause_most_first() -> None:
    findings = {**found(pose="ii"), **found(drop="i")}
    findings["drop#1"] = replace(findings["drop#1"], message="nobody watched the floor")
    one = priced("3 * points(pose) - count(drop)", findings)

    assert one.interval is not None
    assert [(n.cause, n.checks, n.at_most) for n in one.interval.narrowing] == [
        ("the tray was not seen", ("pose",), Decimal(6)),
        ("nobody watched the floor", ("drop",), Decimal(1)),
    ]
    assert one.interval.narrowing[0].findings == ("pose#1", "pose#2")


# Laws ----------------------------------------------------------------------------------

LEAVES = st.sampled_from(
    [
        "points(pose)",
        "count(drop)",
        "holds(collision)",
        "violated(drop)",
        "gate(collision)",
        "product(pose, p=0.5)",
        "2",
        "-3",
        "0.5",
    ]
)


def joined(parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    two = st.tuples(parts, parts)
    return st.one_of(
        st.tuples(two, st.sampled_from("+-*")).map(lambda f: f"({f[0][0]} {f[1]} {f[0][1]})"),
        two.map(lambda f: f"min({f[0]}, {f[1]})"),
        two.map(lambda f: f"clip({f[0]}, -2, {f[1]})"),
        two.map(lambda f: f"abs({f[0]}) ** 2 / (1 + abs({f[1]}))"),
        parts.map(lambda f: f"floor({f} / 2)"),
        st.tuples(parts, parts, parts).map(lambda f: f"({f[0]} if {f[1]} > 1 else {f[2]})"),
        st.tuples(parts, parts, parts).map(lambda f: f"({f[0]} if {f[1]} and not {f[2]} else 1)"),
        st.tuples(parts, parts).map(lambda f: f"ramp(4, 1, 3, 0, {f[0]} + {f[1]})"),
    )


FORMULAS = st.recursive(LEAVES, joined, max_leaves=7)
SEEN = st.fixed_dictionaries(
    {name: st.text("svi", min_size=1, max_size=3) for name in ("pose", "drop", "collision")}
)


def worlds_of(findings: Mapping[str, Finding]) -> list[dict[str, Finding]]:
    open_ = [key for key, f in findings.items() if f.verdict is Verdict.INCONCLUSIVE]
    return [
        {
            **findings,
            **{
                k: replace(findings[k], verdict=v, critical=v is Verdict.VIOLATED)
                for k, v in zip(open_, chosen, strict=True)
            },
        }
        for chosen in product((Verdict.SATISFIED, Verdict.VIOLATED), repeat=len(open_))
    ]


@pytest.mark.slow
@settings(max_examples=150, deadline=None)
@given(formula=FORMULAS, seen=SEEN)
def test_the_true_score_is_within_the_interval_and_where_it_is_tight_at_its_ends(
    formula: str, seen: Mapping[str, str]
) -> None:
    findings = {k: replace(f, critical=f.verdict is not Verdict.SATISFIED) for k, f in found(**seen).items()}
    one = priced(formula, findings)
    assert one.status == "scored"
    assert one.ledger is not None
    scores = [w.ledger.amount for w in (priced(formula, world) for world in worlds_of(findings)) if w.ledger]
    least, most = ends(one) or (one.ledger.amount, one.ledger.amount)

    assert least <= min(scores)
    assert max(scores) <= most
    assert one.ledger.amount == least
    if one.interval is None or one.interval.tight:
        assert (least, most) == (min(scores), max(scores))


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@given(formula=FORMULAS, seen=SEEN, of=st.integers(0, 8))
def test_what_is_not_known_never_scores_above_what_is(formula: str, seen: Mapping[str, str], of: int) -> None:
    findings = found(**seen)
    key = sorted(findings)[of % len(findings)]
    unseen = {**findings, key: replace(findings[key], verdict=Verdict.INCONCLUSIVE)}
    before, after = priced(formula, findings), priced(formula, unseen)

    assert before.ledger is not None
    assert after.ledger is not None
    assert after.ledger.amount <= before.ledger.amount


@pytest.mark.parametrize(
    "function",
    [
        "charged(near=1, again_after_s=5)",
        "seconds(near)",
        "demerits(near)",
        "occurrences(near, every_s=2)",
        "count(near)",
        "measure(near, time_in_violation_s)",
    ],
)
def test_no_violations_within_a_gap_cost_more_than_the_worst_or_less_than_the_best(function: str) -> None:
    # A gap of 6 s between two violations that were seen; any stretches within it may have been others.
    best = {**near(9.0, 10.0, "best1"), **near(16.0, 17.5, "best2")}
    joined = replace(best["near#best1"], quantities=dict.fromkeys(best["near#best1"].quantities, 2.5))
    touches = {k: f for n in range(6) for k, f in near(10.0 + n, 10.0 + n, f"worst{n + 2}").items()}
    open_ = gap({"near#best1": joined}, {**near(9.0, 17.5, "worst1"), **touches}, Span(10.0, 16.0))
    left = LeftOpen((open_,))
    interval = ends(priced(f"-{function}", {}, left_open=left))
    assert interval is not None

    inside: list[list[tuple[float, float]]] = [
        [],
        [(10.0, 16.0)],
        [(11.2, 11.3)],
        [(11.2, 13.0)],
        [(10.0, 11.0), (12.5, 13.0)],
        [(11.0 + n, 11.0 + n) for n in (0, 1.1, 2.2, 3.3)],
    ]
    for stretches in inside:
        true: dict[str, Finding] = {}
        merged: list[list[float]] = []
        for start, end in sorted([(9.0, 10.0), *stretches, (16.0, 17.5)]):
            if merged and start - merged[-1][1] < 1.0:  # a pause that is bridged
                merged[-1][1] = max(end, merged[-1][1])
            else:
                merged.append([start, end])
        for n, (start, end) in enumerate(merged):
            true |= near(start, end, str(n))
        score = priced(f"-{function}", true).ledger
        assert score is not None
        assert interval[0] <= score.amount <= interval[1], stretches


def test_a_log_with_very_much_undecided_is_priced_in_bounded_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each of 16 causes may move the score either way, so that their worlds are 65 536; all are named."""
    evaluations = 0
    typed = Worlds.typed

    def counted(worlds: Worlds, pins: Mapping[str, bool]) -> Typed:
        nonlocal evaluations
        evaluations += 1
        return typed(worlds, pins)

    monkeypatch.setattr(Worlds, "typed", counted)
    undecided = {
        key: replace(one, message=f"nobody saw {one.subject}") for key, one in found(pose="i" * 16).items()
    }
    one = priced("(points(pose) - 8) * (points(pose) - 3)", undecided)

    assert one.interval is not None
    assert evaluations < 2 * MOST_TRIED + MOST_TRIED_FOR_CAUSES + 100
    assert {narrowing.cause for narrowing in one.interval.narrowing} == {
        f"nobody saw part_{n}" for n in range(1, 17)
    }
    assert any(narrowing.at_most is None for narrowing in one.interval.narrowing)
