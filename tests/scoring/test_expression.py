"""The formula language: what it computes, on scalars and on columns alike, and what it refuses."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.errors import FormulaError
from ariac_score.scoring.expression import (
    LARGEST_INTEGER,
    MAX_DEPTH,
    MAX_LENGTH,
    MAX_NODES,
    Expression,
    Number,
    Traced,
)

LAWFUL = settings(max_examples=100, derandomize=True, deadline=None)


class Names:
    """An environment of plain numbers, which remembers what was asked for."""

    def __init__(self, values: Mapping[str, Number]) -> None:
        self.values, self.asked = values, list[str]()

    def name(self, dotted: str) -> Traced:
        self.asked.append(dotted)
        if dotted not in self.values:
            raise FormulaError(f"unknown name {dotted!r}")
        return Traced(dotted, self.values[dotted], "fact")

    def call(
        self,
        function: str,
        arguments: Sequence[Expression],
        options: Mapping[str, Number],  # noqa: ARG002  # the protocol has it
    ) -> Traced | None:
        if function == "twice":
            return Traced("twice", 2 * arguments[0].evaluate(self).value, "check")
        return None


def scalar(formula: str | Number, **values: Number) -> Number:
    return Expression.parse(formula, where="$.terms.trial.x").evaluate(Names(values)).value


def column(formula: str, **values: Number | list[float]) -> list[float]:
    columns = {name: np.array(v, dtype=float) for name, v in values.items()}
    result: list[float] = Expression.parse(formula, where="$.monitors.x").columns(columns).tolist()
    return result


# What it computes ----------------------------------------------------------------------

WORKED = [
    ("1 + 2 * 3", 7),
    ("(1 + 2) * 3", 9),
    ("7 - 2 - 1", 4),
    ("1 / 4", 0.25),
    ("12 / 2 / 3", 2),
    ("2 ** 3 ** 2", 512),  # from the right: 2 ** 9
    ("-2 ** 2", -4),  # as in Python and on paper
    ("4 ** 0.5", 2),
    ("2 ** -1", 0.5),
    ("0 ** 0", 1),
    ("+5", 5),
    ("--5", 5),
    ("1 < 2", 1),
    ("2 < 2", 0),
    ("2 <= 2", 1),
    ("3 > 3", 0),
    ("3 >= 3", 1),
    ("3 == 3", 1),
    ("3 != 3", 0),
    ("1 < 2 < 3", 1),
    ("1 < 3 < 2", 0),
    ("(1 < 2) + (3 > 1)", 2),  # truths are numbers and add up
    ("3 - (1 < 2) - (2 > 1)", 1),
    ("-(1 < 2)", -1),
    ("not 0", 1),
    ("not 7", 0),
    ("2 and 3", 1),
    ("2 and 0", 0),
    ("0 or 5", 1),
    ("0 or 0", 0),
    ("1 and 1 and 0", 0),
    ("10 if 1 else 20", 10),
    ("10 if 0 else 20", 20),
    ("1 if 0 else 2 if 0 else 3", 3),
    ("min(3, 1, 2)", 1),
    ("max(3, 1, 2)", 3),
    ("max(4)", 4),
    ("abs(-2.5)", 2.5),
    ("clip(5, 0, 3)", 3),
    ("clip(-5, 0, 3)", 0),
    ("clip(2, 0, 3)", 2),
    ("sum(1, 2, 3)", 6),
    ("mean(1, 2, 6)", 3),
    ("1e2", 100),
]


@pytest.mark.parametrize(("formula", "expected"), WORKED)
def test_a_formula_has_its_value_by_hand(formula: str, expected: float) -> None:
    assert scalar(formula) == expected


@pytest.mark.parametrize(("formula", "expected"), WORKED)
def test_a_formula_has_the_same_value_in_each_row_of_a_column(formula: str, expected: float) -> None:
    assert column(formula, any_column=[0.0, 1.0, 2.0]) == [expected] * 3


@pytest.mark.parametrize("number", [0, 7, -3, 2.5, LARGEST_INTEGER, -LARGEST_INTEGER])
def test_a_plain_number_is_a_formula(number: Number) -> None:
    assert scalar(number) == number


def test_names_may_have_dots() -> None:
    assert scalar("order.weight * order.total", **{"order.weight": 3, "order.total": 2}) == 6


def test_white_space_and_line_breaks_do_not_matter() -> None:
    assert Expression.parse("  a\n   +  b ").source == "a + b"


def test_whole_numbers_stay_whole() -> None:
    assert isinstance(scalar("2 ** 3 + 3 * 4 - 1"), int)
    assert isinstance(scalar("1 < 2"), int)


def test_a_part_of_a_formula_is_a_formula_of_its_own() -> None:
    whole = Expression.parse("a + max(b, 2)", where="$.score")
    part = whole.part(whole.root.right)  # type: ignore[attr-defined]

    assert (part.source, part.where) == ("max(b, 2)", "$.score")
    assert part.evaluate(Names({"b": 5})).value == 5


@pytest.mark.parametrize(("formula", "name"), [("a", "a"), ("a.b.c", "a.b.c"), ("a + 0", ""), ("1", "")])
def test_a_formula_that_is_but_a_name_tells_it(formula: str, name: str) -> None:
    assert Expression.parse(formula).as_name == name


def test_the_environment_may_answer_functions() -> None:
    assert scalar("1 + twice(a)", a=4) == 9


def test_the_trace_holds_every_number_that_entered() -> None:
    traced = Expression.parse("a * (b + 1)").evaluate(Names({"a": 2, "b": 3}))

    assert (traced.label, traced.value, traced.op) == ("a * (b + 1)", 8, "*")
    assert [(part.label, part.value) for part in traced.children] == [("a", 2), ("b + 1", 4)]
    assert [part.value for part in traced.children[1].children] == [3, 1]


@pytest.mark.parametrize(
    ("formula", "asked"),
    [
        ("a and b", ["a"]),
        ("b or a", ["b"]),
        ("x if a else b", ["a", "b"]),
        ("x if b else a", ["b", "x"]),
        ("a and 1 / a > 2", ["a"]),
    ],
)
def test_only_the_branch_that_counts_is_evaluated(formula: str, asked: list[str]) -> None:
    names = Names({"a": 0, "b": 1, "x": 5})

    Expression.parse(formula).evaluate(names)

    assert names.asked == asked


# Scalars and columns agree -------------------------------------------------------------

_LEAVES = st.sampled_from(["a", "b", "c", "0", "1", "2", "0.5", "-3"])


def _combined(inner: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    two, three = st.tuples(inner, inner), st.tuples(inner, inner, inner)
    symbols = st.sampled_from(["+", "-", "*", "/", "<", "<=", ">", ">=", "==", "!=", "and", "or"])
    return st.one_of(
        st.tuples(symbols, two).map(lambda x: f"({x[1][0]} {x[0]} {x[1][1]})"),
        inner.map(lambda x: f"(not {x})"),
        inner.map(lambda x: f"(-{x})"),
        inner.map(lambda x: f"abs({x})"),
        three.map(lambda x: f"({x[0]} if {x[1]} else {x[2]})"),
        three.map(lambda x: f"clip({x[0]}, {x[1]}, {x[2]})"),
        st.tuples(st.sampled_from(["min", "max", "sum", "mean"]), three).map(
            lambda x: f"{x[0]}({', '.join(x[1])})"
        ),
    )


FORMULAS = st.recursive(_LEAVES, _combined, max_leaves=8)
ROWS = st.lists(st.tuples(*[st.floats(-8, 8)] * 3), min_size=1, max_size=5)


@LAWFUL
@given(FORMULAS, ROWS)
def test_a_column_holds_what_the_formula_gives_row_by_row(
    formula: str, rows: list[tuple[float, ...]]
) -> None:
    expected: list[float] = []
    refused = False
    for row in rows:
        try:
            expected.append(scalar(formula, **dict(zip("abc", row, strict=True))))
        except FormulaError:
            refused = True
    columns = {name: [row[i] for row in rows] for i, name in enumerate("abc")}

    if refused:
        with pytest.raises(FormulaError):
            column(formula, **columns)
    else:
        assert column(formula, **columns) == expected


@LAWFUL
@given(st.floats(0.1, 8), st.floats(-4, 4))
def test_powers_agree_on_scalars_and_columns(base: float, exponent: float) -> None:
    expected = scalar("a ** b", a=base, b=exponent)

    assert column("a ** b", a=[base], b=[exponent]) == pytest.approx([expected], rel=1e-14)


def test_a_guard_keeps_the_rows_it_leaves_out_from_being_refused() -> None:
    assert column("a / b if b else 0", a=[1.0, 2.0], b=[0.0, 4.0]) == [0.0, 0.5]
    assert column("0 if b == 0 else a / b", a=[1.0, 2.0], b=[0.0, 4.0]) == [0.0, 0.5]
    assert column("b and a / b > 0", a=[1.0, 2.0], b=[0.0, 4.0]) == [0.0, 1.0]
    assert column("b == 0 or a / b > 1", a=[1.0, 2.0], b=[0.0, 4.0]) == [1.0, 0.0]


def test_a_guard_for_some_rows_does_not_excuse_the_others() -> None:
    with pytest.raises(FormulaError, match="division by zero in row 2"):
        column("a / b if a else 0", a=[0.0, 1.0, 1.0], b=[0.0, 1.0, 0.0])


def test_a_formula_on_columns_leaves_them_as_they_are() -> None:
    a = np.array([1.0, 2.0])

    Expression.parse("a").columns({"a": a})[0] = 9.0

    assert a.tolist() == [1.0, 2.0]


# What is refused when it is read -------------------------------------------------------


@pytest.mark.parametrize(
    "formula",
    [
        "a.__class__",
        "a.__class__.__mro__",
        "__import__",
        "__import__('os')",
        "_private",
        "a._b",
        "().__class__",
        "(1).real",
        "'a'.upper()",
        "f(a).b",
        "a.b(1)",
        "f(1)(2)",
        "(lambda: 1)()",
        "lambda: 1",
        "[1, 2]",
        "(1, 2)",
        "{1: 2}",
        "{1}",
        "[x for x in a]",
        "(x for x in a)",
        "{x for x in a}",
        "{x: x for x in a}",
        "sum(x for x in a)",
        "a[0]",
        "a[1:2]",
        "(a := 1)",
        "'text'",
        "f'{a}'",
        "b'bytes'",
        "None",
        "...",
        "1j",
        "a // b",
        "a % b",
        "a @ b",
        "a | b",
        "a & b",
        "a ^ b",
        "a << b",
        "a >> b",
        "~a",
        "a in b",
        "a not in b",
        "a is b",
        "a is not b",
        "f(*a)",
        "f(**a)",
        "await a",
        "yield",
    ],
)
def test_what_is_no_formula_is_refused_with_its_place(formula: str) -> None:
    with pytest.raises(FormulaError) as refused:
        Expression.parse(formula, where="$.score")
    assert refused.value.place == "$.score"
    assert refused.value.hint


@pytest.mark.parametrize(
    "formula",
    ["", "   ", "1 +", "(1", "1)", "a b", "a = 1", "import os", "1; 2", "if", "a..b", "a,", "\0", "1__0"],
)
def test_text_that_does_not_parse_is_refused(formula: str) -> None:
    with pytest.raises(FormulaError, match=r"not a formula|not allowed"):
        Expression.parse(formula)


def test_nothing_is_written_beside_a_result_about_a_number_that_runs_into_a_word() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # which some Pythons make a slip of
        assert Expression.parse("1if a else 2").source == "1if a else 2"


def test_the_column_of_a_slip_is_told() -> None:
    with pytest.raises(FormulaError, match=r"'1 [+] [)]' is not a formula at column 5"):
        Expression.parse("1 + )")


def test_a_formula_as_long_as_allowed_is_read_and_one_longer_is_not() -> None:
    name = "a" * MAX_LENGTH

    assert Expression.parse(name).source == name
    with pytest.raises(FormulaError, match=f"{MAX_LENGTH + 1} characters is longer than {MAX_LENGTH}"):
        Expression.parse(name + "a")


def test_a_formula_of_10_kb_is_refused() -> None:
    with pytest.raises(FormulaError, match="is longer than"):
        Expression.parse("1+" * 5000 + "1")


def test_a_formula_as_deep_as_allowed_is_read_and_one_deeper_is_not() -> None:
    deepest = "-" * (MAX_DEPTH - 1) + "1"

    assert Expression.parse(deepest).evaluate(Names({})).value == (-1) ** (MAX_DEPTH - 1)
    with pytest.raises(FormulaError, match=f"{MAX_DEPTH} deep"):
        Expression.parse("-" + deepest)


def test_a_formula_of_as_many_parts_as_allowed_is_read_and_a_larger_one_is_not() -> None:
    def wide(parts: int) -> str:  # the call, its name, its arguments
        return "max(" + ",".join(["1"] * (parts - 2)) + ")"

    assert Expression.parse(wide(MAX_NODES)).evaluate(Names({})).value == 1
    with pytest.raises(FormulaError, match=f"may have {MAX_NODES} parts"):
        Expression.parse(wide(MAX_NODES + 1))


@pytest.mark.parametrize(
    "formula",
    [
        "(" * 900 + "1" + ")" * 900,
        "[" * 900 + "]" * 900,
        "-" * 1900 + "1",
        "not " * 450 + "1",
        "a" + ".b" * 990,
        "+".join(["1"] * 900),
        "+".join(["1"] * 900) + " << 2",  # deep below something that has to be shown
        "f(" * 300 + "1" + ")" * 300,
        "f(x=" * 200 + "1" + ")" * 200,
        "lambda: " * 200 + "1",
        "1 if 1 else " * 150 + "1",
        "1 < " * 450 + "1",
    ],
    ids=lambda formula: formula[:10],
)
def test_hostile_nesting_is_refused_and_breaks_nothing(formula: str) -> None:
    with pytest.raises(FormulaError):
        Expression.parse(formula)


@pytest.mark.parametrize(
    "constant", [LARGEST_INTEGER + 1, "9" * 400, "1e999", "1e17", "0x" + "f" * 400, 16**5000], ids=range(6)
)
def test_a_constant_larger_than_json_keeps_is_refused(constant: str | int) -> None:
    with pytest.raises(FormulaError, match=r"so large a number|not a formula"):
        Expression.parse(constant)


# What is refused when it is evaluated --------------------------------------------------


def test_division_by_zero_names_the_term_and_the_divisor() -> None:
    with pytest.raises(
        FormulaError, match=r"division by zero: 'a / \(b - 1\)' in '2 \+ a / \(b - 1\)'"
    ) as refused:
        scalar("2 + a / (b - 1)", a=1, b=1)
    assert refused.value.place == "$.terms.trial.x"
    assert refused.value.hint == "guard it: … if b - 1 else 0"


@pytest.mark.parametrize("zero", [0, 0.0, -0.0])
def test_every_zero_is_zero_as_a_divisor(zero: Number) -> None:
    with pytest.raises(FormulaError, match="division by zero"):
        scalar("1 / a", a=zero)


@pytest.mark.parametrize(
    ("formula", "cause"),
    [
        ("9**9**9", "overflow"),
        ("10.0 ** 400", "overflow"),
        ("0 ** -1", "division by zero"),
        ("(-8) ** (1 / 3)", "root of a negative number"),
        ("(-1) ** 0.5", "root of a negative number"),
        ("9007199254740992 * 2", "too large to be a score"),
        ("9007199254740992 + 1", "too large to be a score"),
        ("big * big", "too large to be a score"),
        ("sum(big, big)", "too large to be a score"),
        ("nan", "too large to be a score"),
        ("inf", "too large to be a score"),
        ("twice(big)", "too large to be a score"),
        ("nothing(1)", "unknown function 'nothing'"),
        ("abs(1, 2)", "'abs' takes 1 values"),
        ("clip(1)", "'clip' takes 3 values"),
        ("max()", "'max' takes one or more values"),
        ("max(1, k=2)", "'max' takes one or more values"),
    ],
)
def test_what_has_no_value_is_refused_and_names_the_term(formula: str, cause: str) -> None:
    with pytest.raises(FormulaError, match=cause) as refused:
        scalar(formula, big=1.7e308, nan=math.nan, inf=math.inf)
    assert refused.value.place == "$.terms.trial.x"


def test_a_misspelt_function_is_answered_with_the_nearest_one() -> None:
    with pytest.raises(FormulaError) as refused:
        scalar("maxx(1, 2)")
    assert refused.value.hint == "did you mean 'max'?"


@pytest.mark.parametrize(
    ("formula", "cause"),
    [
        ("a / b", "division by zero in row 1"),
        ("a ** 400", "not finite in row 2"),
        ("(0 - a) ** 0.5", "not finite in row 0"),
        ("b ** -1", "not finite in row 1"),
        ("sum(c, c)", "not finite in row 0"),
        ("n", "not finite in row 0"),
        ("9**9**9", "not finite in row 0"),
        ("unknwn", "unknown name 'unknwn'"),
        ("a.b", "unknown name 'a.b'"),
        ("median(a)", "unknown function 'median'"),
        ("abs(a, b)", "'abs' takes 1 values"),
        ("clip(a)", "'clip' takes 3 values"),
        ("max(a, k=b)", "'max' takes one or more values"),
    ],
)
def test_a_column_without_a_value_is_refused_with_its_first_row(formula: str, cause: str) -> None:
    with pytest.raises(FormulaError, match=cause) as refused:
        column(formula, a=[1.0, 2.0, 9.0], b=[1.0, 0.0, 0.0], c=[1.7e308] * 3, n=[math.nan, 1.0, 1.0])
    assert refused.value.place == "$.monitors.x"


def test_a_misspelt_column_is_answered_with_the_nearest_one() -> None:
    with pytest.raises(FormulaError) as refused:
        column("sped * 2", speed=[1.0], time=[2.0])
    assert refused.value.hint == "did you mean 'speed'?"


def test_any_and_all_of_several_values_are_1_or_0_on_scalars_and_on_columns() -> None:
    a, b = np.array([0.0, 0.0, 2.0]), np.array([0.0, 3.0, 1.0])

    assert Expression.parse("any(a, b)").columns({"a": a, "b": b}).tolist() == [0.0, 1.0, 1.0]
    assert Expression.parse("all(a, b)").columns({"a": a, "b": b}).tolist() == [0.0, 0.0, 1.0]


def test_a_column_longer_than_a_block_has_the_same_values_and_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    a = np.array([4.0, 2.0, 1.0, 0.0, 5.0, 0.0])
    formula = Expression.parse("2 / a if a > 0 else k")
    whole = formula.columns({"a": a, "k": 7}).tolist()
    monkeypatch.setattr("ariac_score.scoring.expression._BLOCK_ROWS", 2)

    assert formula.columns({"a": a, "k": 7}).tolist() == whole == [0.5, 1.0, 2.0, 7.0, 0.4, 7.0]
    with pytest.raises(FormulaError, match="division by zero in row 3"):
        Expression.parse("2 / a").columns({"a": a})
