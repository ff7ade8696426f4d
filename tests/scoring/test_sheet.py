"""Score sheets: what formulas may ask of checks, in which scope, and what is refused on loading."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import pytest

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import FormulaError
from ariac_score.scoring.expression import Expression, Number
from ariac_score.scoring.levels import declared_facts
from ariac_score.scoring.policy import assume
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.trial.spans import Span
from ariac_score_ariac.competition import Ariac

CHECKS = frozenset({"type", "pose", "destination", "separation", "contact", "dropped"})


def order(index: int, priority: int, *parts_of_tasks: int) -> Scope:
    path = f"order_{index}"
    tasks = tuple(
        Scope(
            "submission",
            f"{path}/task_{k}",
            {"parts": n},
            tuple(Scope("part", f"{path}/task_{k}/part_{i}") for i in range(n)),
        )
        for k, n in enumerate(parts_of_tasks)
    )
    return Scope("order", path, {"index": index, "priority": priority, "parts": sum(parts_of_tasks)}, tasks)


def trial(*orders: Scope) -> Scope:
    return Scope("trial", "", {"duration_s": 60.0, "orders": len(orders)}, orders)


TWO_ORDERS = trial(order(0, 1, 2), order(1, 3, 1, 1))
S, V, N = Verdict.SATISFIED, Verdict.VIOLATED, Verdict.NOT_APPLICABLE


def finding(
    check: str, subject: str, verdict: Verdict, *, critical: bool = False, **quantities: float
) -> Finding:
    return Finding(
        subject, verdict, f"{check} {verdict.value}", quantities=quantities, critical=critical, check=check
    )


def numbered(*findings: Finding) -> dict[str, Finding]:
    return {f"{f.check}#{i}": f for i, f in enumerate(findings, start=1)}


FINDINGS = numbered(
    finding("type", "order_0/task_0/part_0", S),
    finding("type", "order_0/task_0/part_1", V),
    finding("type", "order_1/task_0/part_0", S),
    finding("type", "order_1/task_1/part_0", S),
    finding("destination", "order_0/task_0", S),
    finding("destination", "order_1/task_0", V),
    finding("destination", "order_1/task_1", S),
)


def sheet(
    score: Number | str,
    *,
    parameters: Mapping[str, Number] | None = None,
    **terms: Mapping[str, Number | str],
) -> ScoreSheet:
    return ScoreSheet(
        {
            level: {n: Expression.parse(text, where=f"$.terms.{level}.{n}") for n, text in formulas.items()}
            for level, formulas in terms.items()
        },
        Expression.parse(score, where="$.score", texts=True),
        CHECKS,
        parameters or {},
        levels=Ariac.levels,
        facts=declared_facts(Ariac.facts),
    )


def score(
    formula: Number | str,
    findings: Mapping[str, Finding] = FINDINGS,
    scope: Scope = TWO_ORDERS,
    *,
    parameters: Mapping[str, Number] | None = None,
    **terms: Mapping[str, Number | str],
) -> Number:
    return sheet(formula, parameters=parameters, **terms).evaluate(scope, findings).value


# Functions on checks -------------------------------------------------------------------

EPISODES = numbered(
    finding("separation", "r/h", V, time_in_violation_s=4.0, relative_depth_integral_s=1.0),
    finding("separation", "r/h", V, time_in_violation_s=2.0, relative_depth_integral_s=0.5),
    finding("separation", "r/h2", S, time_in_violation_s=99.0, relative_depth_integral_s=99.0),
    finding("contact", "r/h", S),
    finding("dropped", "trial", N),
)


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("points(separation)", 1),
        ("count(separation)", 2),
        ("holds(separation)", 0),
        ("violated(separation)", 1),
        ("seconds(separation)", 6),  # 4 + 2; a kept requirement has no time in violation
        ("demerits(separation)", 2.3),  # (1 + 1/5) + (1 + 0.5/5)
        ("demerits(separation, tau_s=5)", 2.3),
        ("demerits(separation, tau_s=0.5)", 5),  # (1 + 2) + (1 + 1)
        ("gate(separation)", 1),  # violated, but nothing critical
        ("product(separation, p=0.6)", 0.36),
        ("product(separation)", 0.25),
        ("measure(separation, time_in_violation_s)", 105),  # a measurement is one, whatever the verdict
        ("points(contact)", 1),
        ("count(contact)", 0),
        ("holds(contact)", 1),
        ("violated(contact)", 0),
        ("seconds(contact)", 0),
        ("demerits(contact)", 0),
        ("gate(contact)", 1),
        ("product(contact, p=0.6)", 1),
        ("points(dropped)", 0),  # where there was nothing to judge there is nothing to earn
        ("holds(dropped)", 1),
        ("count(dropped)", 0),
    ],
)
def test_a_function_on_a_check_has_its_value_by_hand(formula: str, expected: float) -> None:
    assert score(formula, EPISODES) == pytest.approx(expected)


def test_a_violation_without_a_measured_time_lasts_as_long_as_its_span() -> None:
    spans = numbered(Finding("r/h", V, "m", span=Span(1.0, 3.5), check="separation"))

    assert score("seconds(separation)", spans) == 2.5


@pytest.mark.parametrize(
    ("formula", "lacking", "remedy"),
    [
        ("seconds(separation)", "time_in_violation_s", "count()"),
        ("demerits(separation, tau_s=5)", "relative_depth_integral_s", "charged()"),
        ("measure(separation, depth_m)", "depth_m", "if not violated(…) else"),
    ],
)
def test_what_a_violation_does_not_measure_is_not_priced_as_0(
    formula: str, lacking: str, remedy: str
) -> None:
    complete = finding("separation", "r/h", V, **{lacking: 2.0})
    bare = finding("separation", "r/h2", V, other_m=1.0)

    assert score(formula, numbered(complete)) > 0
    with pytest.raises(FormulaError) as refused:
        score(formula, numbered(complete, bare))

    assert formula in refused.value.cause
    assert f"finding 'separation#2' of check 'separation' has no '{lacking}'" in refused.value.cause
    assert remedy in refused.value.hint


def test_a_worst_case_of_unknown_length_has_no_price_by_time() -> None:
    timed = Finding.inconclusive("r/h", "not seen", span=Span(1.0, 3.0))
    rules = {"separation": "worst_case"}
    for undecided, priced in ((timed, 1 + 2.0 / 5), (replace(timed, span=None), None)):
        open_ = numbered(replace(undecided, check="separation"))
        assumed = assume(open_, rules, priced=["separation"]).findings
        assert score("count(separation)", assumed) == 1
        if priced:
            assert score("demerits(separation, tau_s=5)", assumed) == priced
            continue
        with pytest.raises(FormulaError, match="has no 'relative_depth_integral_s'"):
            score("demerits(separation, tau_s=5)", assumed)


def test_the_gate_closes_for_a_critical_violation_only() -> None:
    assert score("gate(contact)", numbered(finding("contact", "r/h", V, critical=True))) == 0
    assert score("gate(contact)", numbered(finding("contact", "r/h", S, critical=True))) == 1
    assert score("gate(contact)", numbered(finding("contact", "r/h", V))) == 1


ONE_EPISODE = numbered(
    finding("separation", "r/h", V, relative_depth_integral_s=1.0, time_in_violation_s=4.0)
)


def test_worked_example_w3h_1_one_episode_costs_0_48() -> None:
    assert score("0.4 * demerits(separation, tau_s=5)", ONE_EPISODE) == pytest.approx(0.48)


def test_worked_example_w3h_2_in_occurrence_mode_it_costs_0_40() -> None:
    assert score("0.4 * count(separation)", ONE_EPISODE) == pytest.approx(0.40)


@pytest.mark.parametrize(
    ("demerits", "multiplier"),
    [
        ("0.4 * demerits(separation, tau_s=5)", 0.67568),
        ("1.0 + 0.7", 0.37037),
        ("2 * 0.6", 0.45455),
        ("0", 1),
    ],
)
def test_worked_example_w3h_3_the_multiplier_is_hyperbolic(demerits: str, multiplier: float) -> None:
    found = score("1 / (1 + demerits)", ONE_EPISODE, trial={"demerits": demerits})

    assert found == pytest.approx(multiplier, abs=5e-6)


# Scopes --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("formula", "terms", "expected"),
    [
        ("points(type)", {}, 3),
        ("sum(order.x)", {"order": {"x": "points(type)"}}, 3),
        ("sum(submission.x)", {"submission": {"x": "holds(destination) * points(type)"}}, 2),
        ("sum(part.x)", {"part": {"x": "3 * points(type)"}}, 9),
        ("sum(order.index * order.x)", {"order": {"x": "points(type)"}}, 2),
        ("sum(order.priority * order.parts)", {}, 8),  # 1*2 + 3*2
        ("sum(submission.parts)", {}, 4),
        ("mean(order.x)", {"order": {"x": "points(type)"}}, 1.5),
        ("min(order.x)", {"order": {"x": "points(type)"}}, 1),
        ("max(order.x)", {"order": {"x": "points(type)"}}, 2),
        ("any(order.x == 2)", {"order": {"x": "points(type)"}}, 1),
        ("all(order.x == 2)", {"order": {"x": "points(type)"}}, 0),
        ("any(order.x == 3)", {"order": {"x": "points(type)"}}, 0),
        ("all(order.x > 0)", {"order": {"x": "points(type)"}}, 1),
        ("count(order.x == 2)", {"order": {"x": "points(type)"}}, 1),
        ("count(order)", {}, 2),
        ("count(submission)", {}, 3),
        ("count(part)", {}, 4),
        ("sum(order.n)", {"order": {"n": "count(part) * 10 + count(submission)"}}, 43),  # 21 + 22
        ("trial.orders + trial.duration_s", {}, 62),
        (
            "sum(order.total)",
            {"order": {"total": "sum(submission.x)"}, "submission": {"x": "points(type)"}},
            3,
        ),
        # orders of 2 and 2: nested aggregates, the inner one per order
        ("sum(order.priority * sum(submission.parts))", {}, 8),
        # an inner scope may use what surrounds it, wherever the question comes from
        ("sum(part.x)", {"part": {"x": "order.priority * points(type)"}}, 7),  # 1*1 + 3*1 + 3*1
        ("sum(submission.x)", {"submission": {"x": "order.index + trial.orders"}}, 8),  # 2 + 3 + 3
        ("a * b", {"trial": {"a": "2", "b": "a + 1"}}, 6),
    ],
)
def test_terms_are_evaluated_in_their_scope_and_aggregated(
    formula: str, terms: dict[str, dict[str, str]], expected: float
) -> None:
    assert score(formula, **terms) == expected


def test_the_2023_kitting_sheet_gives_points_per_part_with_a_floor() -> None:
    # score_sheets.md: part 0 right (3), part 1 wrong (0); all right is needed for the bonus; 3 for the tray.
    terms = {
        "part": {"points": "0 if violated(type) else 3"},
        "submission": {
            "bonus": "count(part) if all(part.points == 3) else 0",
            "completion": "holds(destination) * max(3 + sum(part.points) + bonus - 1, 0)",
        },
    }
    # order_0: 3 + 3 + 0 - 1 = 5; order_1/task_0: wrong destination; order_1/task_1: 3 + 3 + 1 - 1 = 6
    assert score("sum(submission.completion)", **terms) == 11


def test_a_floor_holds_a_score_at_0() -> None:
    assert score("max(points(type) - 10, 0)") == 0


def test_parameters_are_names_everywhere() -> None:
    assert score("sum(order.x) * k", parameters={"k": 0.5}, order={"x": "k * order.priority"}) == 1.0


def test_the_order_in_which_findings_are_stored_changes_no_bit_of_a_sum() -> None:
    times = (0.1, 0.2, 0.3)  # from the left they add up to 0.6000000000000001, from the right to 0.6
    found = numbered(*(finding("separation", "r/h", V, time_in_violation_s=each) for each in times))
    turned = dict(reversed(found.items()))

    assert score("seconds(separation)", turned) == score("seconds(separation)", found)


def test_orders_with_similar_names_do_not_share_findings() -> None:
    scope = trial(Scope("order", "order_1", {"index": 0, "priority": 1, "parts": 0}), order(10, 1, 1))
    found = numbered(finding("type", "order_1", S), finding("type", "order_10/task_0/part_0", V))

    assert score("sum(order.x * (1 + order.index))", found, scope, order={"x": "points(type)"}) == 1


def test_without_orders_a_sum_is_0_and_a_mean_is_refused() -> None:
    nothing = trial()

    assert score("sum(order.x)", {}, nothing, order={"x": "1"}) == 0
    assert score("mean(order.x) if count(order) else 0", {}, nothing, order={"x": "1"}) == 0
    with pytest.raises(FormulaError, match="there is no order in the trial") as refused:
        score("mean(order.x)", {}, nothing, order={"x": "1"})
    assert refused.value.hint == "guard it: mean(order.x) if count(order) else 0"


def test_what_is_not_reached_is_not_asked() -> None:
    # No finding of `dropped` exists, so asking for it would be an error.
    assert score("0 and count(dropped)") == 0
    assert score("1 or count(dropped)") == 1
    assert score("5 if 1 else count(dropped)") == 5


def test_a_term_is_evaluated_once_however_often_it_is_used() -> None:
    traced = sheet("a + a", trial={"a": "points(type)"}).evaluate(TWO_ORDERS, FINDINGS)
    first, second = traced.children[0].children

    assert first is second


def test_the_trace_names_the_findings_a_number_rests_on() -> None:
    traced = sheet("count(type)").evaluate(TWO_ORDERS, FINDINGS)

    assert traced.children[0].findings == ("type#2",)


def test_the_priced_checks_are_those_a_formula_asks_about() -> None:
    priced = sheet(
        "sum(order.x) * holds(contact)", order={"x": "points(type) + demerits(separation, tau_s=5)"}
    ).priced

    assert priced == {"contact", "type", "separation"}


# Silence -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "function", ["points", "count", "holds", "violated", "seconds", "demerits", "gate", "product"]
)
def test_a_check_that_says_nothing_is_an_error_and_not_a_0(function: str) -> None:
    with pytest.raises(FormulaError, match="check 'dropped' says nothing about the trial") as refused:
        score(f"{function}(dropped)")
    assert refused.value.place == "$.score"


def test_a_check_that_says_nothing_in_one_scope_is_an_error_that_names_it() -> None:
    with pytest.raises(FormulaError, match="check 'separation' says nothing about order_0") as refused:
        score("sum(order.x)", EPISODES, order={"x": "count(separation)"})
    assert refused.value.place == "$.terms.order.x of order_0"


# Errors while scoring ------------------------------------------------------------------


def test_a_division_by_zero_names_term_and_scope() -> None:
    with pytest.raises(FormulaError, match="division by zero") as refused:
        score("sum(order.x)", order={"x": "1 / (order.index - 1)"})
    assert refused.value.place == "$.terms.order.x of order_1"


@pytest.mark.parametrize("tau_s", ["0", "-1"])
def test_a_time_constant_that_is_not_positive_is_refused(tau_s: str) -> None:
    with pytest.raises(FormulaError, match="tau_s must be positive") as refused:
        score("d", EPISODES, trial={"d": f"demerits(separation, tau_s={tau_s})"})
    assert refused.value.place == "$.terms.trial.d"


def test_a_term_of_each_order_needs_an_aggregate() -> None:
    with pytest.raises(FormulaError, match=r"'order\.index' speaks of each order") as refused:
        score("order.index + 1")
    assert "sum(order.index)" in refused.value.hint


@pytest.mark.parametrize("p", ["1e15", "9007199254740992"])
def test_a_product_beyond_all_numbers_is_refused(p: str) -> None:
    many = numbered(*[finding("dropped", "trial", V)] * 40)

    with pytest.raises(FormulaError, match=r"overflow|too large"):
        score(f"product(dropped, p={p})", many)


# Refused on loading --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("terms", "formula", "cause", "hint"),
    [
        ({}, "points(typ)", "points() asks about 'typ', which is no check", "did you mean 'type'?"),
        ({}, "holds(contct)", "holds() asks about 'contct', which is no check", "did you mean 'contact'?"),
        ({}, "count(droped)", "count() asks about 'droped', which is no check", "did you mean 'dropped'?"),
        ({}, "points()", "points() asks about 'nothing', which is no check", ""),
        ({}, "points(2)", "points() asks about '2', which is no check", ""),
        ({}, "points(order.index)", "points() asks about 'order.index', which is no check", ""),
        ({}, "pionts(type)", "unknown function 'pionts'", "did you mean 'points'?"),
        ({}, "open(type)", "unknown function 'open'", ""),
        ({}, "type + 1", "unknown name 'type'", "'type' is a check: ask points(type)"),
        ({"trial": {"weight": "1"}}, "wieght * 2", "unknown name 'wieght'", "did you mean 'weight'?"),
        ({"order": {"total": "1"}}, "sum(order.totl)", "unknown name 'order.totl'", "did you mean 'total'?"),
        ({"order": {"total": "1"}}, "sum(ordr.total)", "unknown name 'ordr.total'", "did you mean 'order'?"),
        ({}, "trial.duration", "unknown name 'trial.duration'", "did you mean 'duration_s'?"),
        ({}, "a.b.c", "unknown name 'a.b.c'", ""),
        ({"order": {"x": "index"}}, "1", "unknown name 'index'", ""),
        ({"trial": {"a": "b", "b": "1"}}, "a", "unknown name 'b'", ""),  # terms come in order: no cycles
        ({"trial": {"a": "a"}}, "a", "unknown name 'a'", ""),
        ({"order": {"x": "sum(order.index)", "y": "trial.t"}}, "1", "unknown name 'trial.t'", ""),
        ({"order": {"x": "count(order)"}}, "1", "there is no order inside a order", "from inside out"),
        (
            {"part": {"x": "count(submission)"}},
            "1",
            "there is no submission inside a part",
            "from inside out",
        ),
        ({}, "demerits(separation, tau=5)", "wrong arguments", "tau_s"),
        ({}, "product(separation, q=1)", "wrong arguments", "p=0.6"),
        ({}, "points(type, pose)", "wrong arguments", "number of its findings"),
        ({}, "points(type, k=1)", "wrong arguments", "number of its findings"),
        ({}, "measure(type)", "wrong arguments", "measure(check, quantity)"),
        ({}, "measure(type, a, b)", "wrong arguments", "measure(check, quantity)"),
        (
            {"order": {"priority": "2"}},
            "1",
            "term 'priority' is also the name of a fact of each order",
            "one thing",
        ),
        ({"trial": {"k": "2"}}, "k", "term 'k' is also the name of a parameter", "one thing"),
    ],
)
def test_a_mistake_in_a_formula_is_found_on_loading(
    terms: dict[str, dict[str, str]], formula: str, cause: str, hint: str
) -> None:
    with pytest.raises(FormulaError) as refused:
        sheet(formula, parameters={"k": 1}, **terms)
    assert cause in refused.value.cause
    assert hint in refused.value.hint
    assert refused.value.place.startswith("$.")


def test_the_place_of_a_mistake_is_its_term() -> None:
    with pytest.raises(FormulaError) as refused:
        sheet("1", order={"fine": "1"}, submission={"x": "points(typ)"})
    assert refused.value.place == "$.terms.submission.x"


def test_scopes_of_a_level_come_in_order() -> None:
    assert [scope.path for scope in TWO_ORDERS.each("submission")] == [
        "order_0/task_0",
        "order_1/task_0",
        "order_1/task_1",
    ]
    assert list(order(0, 1, 2).each("order")) == []


def test_a_quantity_that_no_finding_has_is_misspelt_and_not_zero() -> None:
    kept = Finding("trial", Verdict.SATISFIED, "fine", quantities={"time_taken_s": 3.0}, check="time")
    sheet = ScoreSheet({}, Expression.parse("measure(time, time_takn_s)"), frozenset({"time"}))

    with pytest.raises(FormulaError) as refused:
        sheet.evaluate(Scope("trial", ""), {"time#1": kept})

    assert "no finding has the quantity 'time_takn_s'" in str(refused.value)
    assert refused.value.hint == "did you mean 'time_taken_s'?"
