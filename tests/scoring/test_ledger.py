"""The ledger adds up to the score, exactly; and an edited one does not pass."""

from __future__ import annotations

from collections.abc import Iterator
from decimal import Decimal

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import FormulaError, ResultError
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.expression import LARGEST_INTEGER, Expression
from ariac_score.scoring.ledger import Line, make_ledger, reconcile, rounded
from ariac_score.scoring.levels import declared_facts
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.scoring.worlds import tree_of
from ariac_score_ariac.competition import Ariac

LAWFUL = settings(max_examples=100, derandomize=True, deadline=None)
S, V = Verdict.SATISFIED, Verdict.VIOLATED


def scopes(*parts: int) -> Scope:
    """One order for each number, of that many parts."""
    orders = tuple(
        Scope(
            "order",
            f"order_{k}",
            {"index": k, "priority": 1 + 2 * k, "parts": n},
            (
                Scope(
                    "submission",
                    f"order_{k}/task",
                    {"parts": n},
                    tuple(Scope("part", f"order_{k}/task/part_{i}") for i in range(n)),
                ),
            ),
        )
        for k, n in enumerate(parts)
    )
    return Scope("trial", "", {"duration_s": 60.0, "orders": len(orders)}, orders)


def findings(verdicts: list[list[Verdict]], *episodes_s: float) -> dict[str, Finding]:
    found: dict[str, Finding] = {}
    for k, parts in enumerate(verdicts):
        for i, verdict in enumerate(parts):
            key = f"right#{len(found)}"
            found[key] = Finding(f"order_{k}/task/part_{i}", verdict, "a part", check="right")
    for i, depth_s in enumerate(episodes_s):
        found[f"near#{i}"] = Finding(
            "r/h", V, "too near", quantities={"relative_depth_integral_s": depth_s}, check="near"
        )
    found["near#kept"] = Finding("r/h2", S, "kept", check="near")
    return found


def ledger_of(
    score: str,
    scope: Scope,
    found: dict[str, Finding],
    *,
    digits: int = 6,
    **terms: dict[str, str],
) -> Line:
    sheet = ScoreSheet(
        {level: {n: Expression.parse(x) for n, x in formulas.items()} for level, formulas in terms.items()},
        Expression.parse(score, where="$.score"),
        frozenset({"right", "near"}),
        {"k": 0.4},
        levels=Ariac.levels,
        facts=declared_facts(Ariac.facts),
    )
    return ledger_by(sheet, scope, found, digits)


def ledger_by(sheet: ScoreSheet, scope: Scope, found: dict[str, Finding], digits: int = 6) -> Line:
    tree = tree_of(sheet, sheet.score, scope, found, CohortValues(), {})
    return make_ledger(tree, sheet.evaluate(scope, found), found, digits=digits)


ONE = scopes(3)
RIGHT = findings([[S, S, V]], 1.0)  # two right parts, one wrong; one episode of demerit 1.2


def told(ledger: Line) -> dict[str, str]:
    """The amounts of a ledger by path below its root, without the zeros at their end."""
    lines = (line for line in ledger.walk() if line is not ledger)
    return {line.path.removeprefix("score/"): f"{line.amount.normalize():f}" for line in lines}


# Rounding ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("value", "digits", "expected"),
    [
        (0.5, 0, "0"),
        (1.5, 0, "2"),
        (2.5, 0, "2"),
        (2.675, 2, "2.68"),  # as written, not as stored (2.67499…): the decimal figure is the half
        (2.665, 2, "2.66"),
        (-0.5, 0, "0"),
        (-0.0, 2, "0.00"),
        (-1.5, 0, "-2"),
        (7, 3, "7.000"),
        (0.1 + 0.2, 6, "0.300000"),
    ],
)
def test_halves_go_to_even_and_zero_has_no_sign(value: float, digits: int, expected: str) -> None:
    assert str(rounded(value, digits)) == expected


@pytest.mark.parametrize("value", [LARGEST_INTEGER, -LARGEST_INTEGER, float(LARGEST_INTEGER)])
def test_the_largest_number_a_score_may_be_is_kept_to_the_last_digit(value: float) -> None:
    assert rounded(value, 9) == Decimal(int(value))


@pytest.mark.parametrize("value", [LARGEST_INTEGER * 2, -1e17, 1e300, 16**300], ids=range(4))
def test_a_number_too_large_to_be_a_score_is_refused(value: float) -> None:
    with pytest.raises(FormulaError, match="too large to be a score"):
        rounded(value, 6)


# How a score is told -------------------------------------------------------------------


def test_points_are_told_finding_by_finding() -> None:
    ledger = ledger_of("points(right)", ONE, RIGHT)
    (earned,) = ledger.children

    assert (ledger.amount, earned.label) == (2, "earned")
    assert [str(line.amount) for line in earned.children] == ["1.000000", "1.000000", "0.000000"]
    assert [line.findings for line in earned.children] == [("right#0",), ("right#1",), ("right#2",)]
    assert [line.reason for line in earned.children] == ["", "", "it earned nothing"]


def test_a_factor_that_is_given_shows_in_the_amounts() -> None:
    # 3 / 4 for each of two right parts
    assert told(ledger_of("3 * points(right) / 4", ONE, RIGHT)) == {
        "earned": "1.5",
        "earned/part_0": "0.75",
        "earned/part_1": "0.75",
        "earned/part_2": "0",
    }


def test_a_closed_gate_takes_what_was_earned_and_names_its_finding() -> None:
    ledger = ledger_of("holds(near) * points(right)", ONE, RIGHT)
    (line,) = ledger.children[1].children

    assert ledger.amount == 0
    assert (line.kind, str(line.amount), line.findings) == ("taken", "-2.000000", ("near#0",))


def test_demerits_divide_what_was_earned() -> None:
    # 2 / (1 + 0.4 * 1.2) = 2 / 1.48 = 1.351351…
    ledger = ledger_of("points(right) / (1 + k * demerits(near, tau_s=5))", ONE, RIGHT)

    assert str(ledger.amount) == "1.351351"
    assert told(ledger)["taken/near#0"] == "-0.648649"


def test_a_mean_shares_each_order_by_its_number() -> None:
    ledger = ledger_of("mean(order.x)", scopes(2, 1), findings([[S, S], [S]]), order={"x": "points(right)"})

    assert [told(ledger)[f"earned/order_{k}"] for k in (0, 1)] == ["1", "0.5"]
    assert ledger.amount == Decimal("1.5")


def test_every_subtrahend_is_a_line_and_a_score_may_be_negative() -> None:
    ledger = ledger_of("1 - 5 * count(near) - 2 * violated(right)", ONE, RIGHT)

    assert ledger.amount == -6
    assert told(ledger)["taken/near#0"] == "-5"
    assert told(ledger)["taken/right#2"] == "-2"
    reconcile(ledger, Decimal(-6), digits=6)


def test_what_was_kept_changed_nothing_and_says_so() -> None:
    ledger = ledger_of("points(right) if holds(near) else 0", ONE, findings([[S, S, V]]))
    (line,) = ledger.children[-1].children

    assert (line.kind, line.reason, line.findings) == ("neutral", "kept", ("near#kept",))


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("10 - count(near)", "9.000000"),
        ("10 - points(right) * 2", "6.000000"),
        ("-points(right)", "-2.000000"),
        ("max(points(right) - 3, 0)", "0.000000"),
        ("max(points(right), 1)", "2.000000"),
        ("min(points(right), 1)", "1.000000"),
        ("clip(points(right), 0, 1.5)", "1.500000"),
        ("mean(points(right), 4)", "3.000000"),
        ("sum(points(right), 4)", "6.000000"),
        ("points(right) * points(right)", "4.000000"),
        ("points(right) / count(near)", "2.000000"),
        ("points(right) ** 2", "4.000000"),
        ("points(right) if holds(near) else -1", "-1.000000"),
        ("points(right) if violated(near) else -1", "2.000000"),
        ("(points(right) if violated(near) else 0) * 3", "6.000000"),
        ("3 * max(points(right) - 1, 0) / 2", "1.500000"),
        ("2 * (10 - count(near))", "18.000000"),
        ("points(right) and 5", "1.000000"),
        ("points(right) > 1", "1.000000"),
        ("7", "7.000000"),
        ("k", "0.400000"),
        ("measure(near, relative_depth_integral_s) + 1", "2.000000"),
        ("1 + 2 + points(right) + 0.5", "5.500000"),
        ("points(right) - 1 - 1 - 1", "-1.000000"),
    ],
)
def test_every_shape_of_formula_has_a_ledger_that_adds_up(formula: str, expected: str) -> None:
    ledger = ledger_of(formula, ONE, RIGHT)

    assert str(ledger.amount) == expected
    reconcile(ledger, ledger.amount, digits=6)


def measured(units: dict[str, str]) -> dict[str, Finding]:
    """One finding with three quantities, whose names tell other units than are declared."""
    quantities = {"bonus_n": 4.0, "accel_m_s2": 5.0, "extra": 6.0}
    return {"near#1": Finding("r/h", S, "kept", quantities=quantities, check="near", units=units)}


@pytest.mark.parametrize(
    ("quantity", "unit", "by_finding"),
    [
        ("bonus_n", "points", True),
        ("bonus_n", "count", True),
        ("bonus_n", "N", False),
        ("accel_m_s2", "m/s2", False),
        ("extra", "1", False),
        ("extra", "dollars", False),
    ],
)
def test_what_is_points_is_declared_and_never_guessed_from_a_name(
    quantity: str, unit: str, by_finding: bool
) -> None:
    # Points begin at 0 where nothing was done; of other numbers nobody says where they begin.
    tree = tree_of(
        ScoreSheet({}, Expression.parse(f"2 * measure(near, {quantity})"), frozenset({"near"})),
        Expression.parse(f"2 * measure(near, {quantity})"),
        scopes(),
        measured({quantity: unit}),
        CohortValues(),
        {},
    )

    assert tree.exact[0] == (0 if by_finding else tree.exact[2])


def test_a_quantity_without_a_declared_unit_is_no_points() -> None:
    ledger = ledger_of("2 * measure(near, extra)", scopes(), measured({}))
    (line,) = ledger.children[0].children

    assert (line.amount, ledger.amount) == (Decimal("12.000000"), Decimal("12.000000"))


@pytest.mark.parametrize("check", ["held_s", "far_m", "big_factor"])
def test_points_of_a_check_are_points_whatever_its_name_ends_in(check: str) -> None:
    found = {f"{check}#1": Finding("r/h", S, "kept", check=check)}
    ledger = ledger_by(
        ScoreSheet({}, Expression.parse(f"3 * points({check})"), frozenset({check})), scopes(), found
    )
    (line,) = ledger.children[0].children

    assert (line.findings, line.amount) == ((f"{check}#1",), 3)


def test_a_unit_belongs_to_a_quantity_of_its_finding() -> None:
    with pytest.raises(ValueError, match="'depth_m', which is no quantity"):
        Finding("r/h", S, "kept", quantities={"depth": 1.0}, units={"depth_m": "m"})


def test_scores_without_findings_or_orders_have_a_ledger() -> None:
    ledger = ledger_of("sum(order.x)", scopes(), {}, order={"x": "points(right)"})

    assert (ledger.amount, [line.label for line in ledger.children]) == (Decimal(0), ["earned"])
    reconcile(ledger, Decimal(0), digits=6)


def test_what_rounding_moves_is_a_line_of_its_own() -> None:
    # Three thirds: 0.33 each, 1.00 in all; the missing cent is told.
    (earned,) = ledger_of("sum(part.x)", ONE, RIGHT, digits=2, part={"x": "1 / 3"}).children

    assert [str(line.amount) for line in earned.children] == ["0.33", "0.33", "0.33", "0.01"]
    assert earned.children[-1].kind == "rounding"


def test_paths_are_unique() -> None:
    ledger = ledger_of("points(right) + points(right) + sum(order.x) + 1 + 1", ONE, RIGHT, order={"x": "1"})
    paths = [line.path for line in ledger.walk()]

    assert len(paths) == len(set(paths))


# Laws ----------------------------------------------------------------------------------

TERMS = {
    "part": st.sampled_from(
        ["points(right)", "3 - violated(right)", "points(right) / 7", "0.1 * points(right)"]
    ),
    "submission": st.sampled_from(
        ["sum(part.x)", "mean(part.x)", "max(sum(part.x) - 2, 0)", "sum(part.x) + points(right) / 3"]
    ),
    "order": st.sampled_from(
        [
            "order.priority * sum(submission.x)",
            "sum(submission.x) / order.parts if order.parts else 0",
            "sum(submission.x) - 0.7 * count(right)",
            "holds(right) * (sum(submission.x) + 1)",
        ]
    ),
}
SCORES = st.sampled_from(
    [
        "sum(order.x)",
        "mean(order.x)",
        "sum(order.x) / (1 + k * demerits(near, tau_s=5))",
        "gate(near) * product(near, p=0.65) * sum(order.x) - 1 / 3",
        "max(sum(order.x) - 2 * count(near), 0)",
        "sum(order.x) - 5 * count(near)",
        "10 - count(near) + mean(order.x) / 7",
        "(sum(order.x) if holds(near) else sum(order.x) / 3) * 0.1",
        "sum(order.x * order.priority) / sum(order.priority)",
    ]
)
TRIALS = st.lists(st.lists(st.sampled_from([S, V]), min_size=1, max_size=4), min_size=1, max_size=3)
LEDGERS = st.builds(
    lambda score, part, submission, order, verdicts, episodes_s, digits: (
        ledger_of(
            score,
            scopes(*map(len, verdicts)),
            findings(verdicts, *episodes_s),
            digits=digits,
            part={"x": part},
            submission={"x": submission},
            order={"x": order},
        ),
        digits,
    ),
    SCORES,
    TERMS["part"],
    TERMS["submission"],
    TERMS["order"],
    TRIALS,
    st.lists(st.floats(0, 60), max_size=3),
    st.integers(0, 9),
)


@LAWFUL
@given(LEDGERS)
def test_the_leaves_add_up_to_the_score_and_each_line_to_its_parent(made: tuple[Line, int]) -> None:
    ledger, digits = made

    assert sum((leaf.amount for leaf in ledger.leaves), Decimal(0)) == ledger.amount
    for line in ledger.walk():
        if line.children:
            assert sum((child.amount for child in line.children), Decimal(0)) == line.amount
    reconcile(ledger, ledger.amount, digits=digits)


@LAWFUL
@given(LEDGERS)
def test_rounding_moves_no_more_than_half_a_unit_for_each_line_beside_it(made: tuple[Line, int]) -> None:
    ledger, digits = made
    unit = Decimal(1).scaleb(-digits)

    for line in ledger.walk():
        moved = sum((abs(c.amount) for c in line.children if c.kind == "rounding"), Decimal(0))
        # Each line beside it is off by half a unit at most; a factor by one, as it is a difference.
        assert moved <= unit * len(line.children)
        assert sum(c.kind == "rounding" for c in line.children) <= 1


def edited(line: Line, path: str, amount: Decimal) -> Line:
    """The ledger with the amount of one line replaced."""
    children = tuple(edited(child, path, amount) for child in line.children)
    return replace(line, children=children, amount=amount if line.path == path else line.amount)


def each_line(ledger: Line) -> Iterator[str]:
    return (line.path for line in ledger.walk())


@pytest.mark.slow
@LAWFUL
@given(LEDGERS, st.data(), st.integers(-3, 3).filter(bool))
def test_no_amount_of_a_ledger_can_be_changed_unnoticed(
    made: tuple[Line, int], data: st.DataObject, units: int
) -> None:
    ledger, digits = made
    line = data.draw(st.sampled_from(sorted(ledger.walk(), key=lambda line: line.path)))
    forged = edited(ledger, line.path, line.amount + units * Decimal(1).scaleb(-digits))

    with pytest.raises(ResultError):
        reconcile(forged, ledger.amount, digits=digits)
    if ledger.children:  # a score of one line alone has nothing that could contradict it
        with pytest.raises(ResultError):
            reconcile(forged, forged.amount, digits=digits)


# What is refused -----------------------------------------------------------------------

LEDGER = ledger_of(
    "holds(near) * points(right) + 3 * order_x", ONE, RIGHT, trial={"order_x": "points(right)"}
)


@pytest.mark.parametrize("path", list(each_line(LEDGER)))
@pytest.mark.parametrize("by", ["0.000001", "-0.000001", "1"])
def test_a_changed_amount_is_refused_wherever_it_stands(path: str, by: str) -> None:
    amount = next(line.amount for line in LEDGER.walk() if line.path == path)

    with pytest.raises(ResultError) as refused:
        reconcile(edited(LEDGER, path, amount + Decimal(by)), LEDGER.amount, digits=6)
    assert "score the trial again" in refused.value.hint


def test_another_score_beside_a_sound_ledger_is_refused() -> None:
    with pytest.raises(ResultError, match=r"the ledger adds up to 6\.000000, the score is 7"):
        reconcile(LEDGER, Decimal(7), digits=6)


def test_amounts_finer_than_declared_are_refused() -> None:
    # Both changes cancel, so that every sum is still right.
    fine = Decimal("0.0000001")
    line = Line(
        "score",
        "score",
        "sum",
        Decimal(2),
        2,
        children=(
            Line("score/a", "a", "amount", 1 + fine, 1),
            Line("score/b", "b", "amount", 1 - fine, 1),
        ),
    )

    with pytest.raises(ResultError, match="more than 6 decimals"):
        reconcile(line, Decimal(2), digits=6)
    reconcile(line, Decimal(2), digits=7)


@pytest.mark.parametrize("amount", ["NaN", "sNaN", "Infinity", "-Infinity", "1e40"])
def test_an_amount_that_is_no_number_is_refused(amount: str) -> None:
    path = LEDGER.children[0].path

    with pytest.raises(ResultError):
        reconcile(edited(LEDGER, path, Decimal(amount)), LEDGER.amount, digits=6)
    with pytest.raises(ResultError):
        reconcile(edited(LEDGER, "score", Decimal(amount)), LEDGER.amount, digits=6)


@pytest.mark.parametrize(
    ("moved", "allowed"), [("0.000003", True), ("0.000004", False), ("-0.000004", False)]
)
def test_a_rounding_line_can_move_no_more_than_rounding_can(moved: str, allowed: bool) -> None:
    # One amount and its rounding: two lines, so at most (2 + 1) units.
    amount = Decimal(moved)
    line = Line(
        "score",
        "score",
        "sum",
        1 + amount,
        1,
        children=(
            Line("score/a", "a", "amount", Decimal(1), 1),
            Line("score/rounding", "rounding", "rounding", amount, float(amount)),
        ),
    )

    if allowed:
        reconcile(line, line.amount, digits=6)
    else:
        with pytest.raises(ResultError, match="rounding cannot move"):
            reconcile(line, line.amount, digits=6)


@pytest.mark.parametrize(("moved", "allowed"), [("4.000003", True), ("4.000004", False)])
def test_of_a_large_number_rounding_moves_what_float64_does_not_know(moved: str, allowed: bool) -> None:
    # 2 ** -48 of 2 ** 50 is 4, beside the (2 + 1) units of two lines.
    amount = Decimal(2) ** 50
    lines = (
        Line("score/a", "a", "amount", amount - Decimal(moved), 1),
        Line("score/rounding", "rounding", "rounding", Decimal(moved), float(moved)),
    )
    line = Line("score", "score", "sum", amount, 1, children=lines)

    if allowed:
        reconcile(line, amount, digits=6)
    else:
        with pytest.raises(ResultError, match="rounding cannot move"):
            reconcile(line, amount, digits=6)


def test_rounding_lines_that_cancel_are_refused_all_the_same() -> None:
    lines = (
        Line("score/a", "a", "amount", Decimal(1), 1),
        *(Line(f"score/r{by}", "rounding", "rounding", Decimal(by), by) for by in (3, -3)),
    )

    with pytest.raises(ResultError, match="rounding cannot move 6"):
        reconcile(Line("score", "score", "sum", Decimal(1), 1, children=lines), Decimal(1), digits=6)


def test_a_line_taken_out_or_added_is_refused() -> None:
    with pytest.raises(ResultError, match="its lines add up to"):
        reconcile(replace(LEDGER, children=LEDGER.children[1:]), LEDGER.amount, digits=6)
    with pytest.raises(ResultError, match="its lines add up to"):
        reconcile(replace(LEDGER, children=(*LEDGER.children, LEDGER.children[0])), LEDGER.amount, digits=6)
