"""RML as text: what is refused and where, what is warned about, one form for every specification.

Expected readings are those of the language's grammar and of the conformance cases.
"""

from __future__ import annotations

import re
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score_rml import RmlError, compile_rml, format_rml
from ariac_score_rml.parser import MAX_DEPTH, parse
from ariac_score_rml.syntax import (
    All,
    Anything,
    Chain,
    Declaration,
    Empty,
    Equation,
    Event,
    EventType,
    Filter,
    If,
    Let,
    ListPattern,
    Literal_,
    Name,
    Num,
    Op,
    OrPattern,
    Post,
    RecordPattern,
    Ref,
    Spec,
    Var,
)
from ariac_score_rml.tree import tree

A = "a matches {x:1}; b matches {x:2}; "


def refused(text: str, **how: Any) -> RmlError:
    with pytest.raises(RmlError) as error:
        compile_rml(text, **how)
    return error.value


# Places ----------------------------------------------------------------------------------


def test_a_text_that_breaks_the_grammar_is_refused_at_its_place(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, int, int, str]] = [
        ("Main = a", 1, 9, "';' was expected, not the end of the text"),
        ("Main = a) ;", 1, 9, "';' was expected, not '\\)'"),
        ("a matches {x:-1}; Main = a;", 1, 14, "a pattern was expected, not '-'"),
        ("a matches {x:1}\n;\n\nMain = (a\n b;", 5, 3, "an operator or '\\)' was expected, not ';'"),
        ("Main = a \\/ ;", 1, 13, "an expression was expected"),
        ("a matches {x:v} with v > ;\nMain=a;", 1, 26, "a value was expected"),
        ('a matches {x:"y"}; Main = a;', 1, 14, "means nothing here"),
        ("a matches {x:'y\n}; Main = a;", 1, 14, "this string has no end"),
        ("a matches {x:'\\q'}; Main = a;", 1, 14, "escape"),
        ("Main = {let x a};", 1, 15, "',' or ';' was expected"),
        ("Main = if (1<2) a;", 1, 18, "'else' was expected"),
        ("Main = a; b matches {};", 1, 11, "type declarations come before all equations"),
        ("a matches {x:[...,1]}; Main = a;", 1, 18, "expected, not ','"),
        ("a matches {Abc:1}; Main = a;", 1, 12, "a key was expected"),
        ("_a matches {}; Main = all;", 1, 1, "expected, not '_'"),
        ("a matches {x:1.}; Main = a;", 1, 15, "expected, not '.'"),
        ("", 1, 1, "an equation was expected"),
        ("é", 1, 1, "means nothing here"),
        ("a matches {s:'é'}; // ü\nMain = é;", 2, 8, "means nothing here"),
    ]
    for text, line, column, cause in cases:
        with subtests.test(text=text, line=line, column=column):
            error = refused(text)

            assert (error.kind, error.line, error.column) == ("syntax", line, column)
            assert re.search(cause, error.cause)
            assert str(error).startswith(f"line {line}, column {column}: ")


def test_what_can_mean_nothing_is_refused_before_any_event(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, str, int]] = [
        ("Main = X;", "undefined_identifier", 8),
        ("X = empty;", "undefined_identifier", 1),
        ("Main<n> = a;", "main_is_generic", 1),
        ("Main = a Main<1>;", "main_is_generic", 10),
        ("Main = a; Main = b;", "duplicate_equation", 11),
        ("Main = a? Main;", "not_contractive", 11),
        ("Main = {let x; X}; X = a* \\/ X;", "not_contractive", 30),
        ("a matches b; b matches a; Main = a;", "cyclic_event_type", 1),
        ("a(1) matches {}; Main = a;", "declared_parameter_not_a_name", 1),
        ("Main = a{1.0};", "repetition_count_not_int_literal", 9),
        ("Main = a('s');", "pattern_argument_in_expression", 8),
        ("a matches {x:2147483648}; Main = a;", "number_out_of_range", 14),
    ]
    for text, kind, column in cases:
        with subtests.test(text=text, kind=kind, column=column):
            error = refused(text)

            assert (error.kind, error.line, error.column) == (kind, 1, column)


def test_a_guarded_recursion_and_the_largest_number_are_fine() -> None:
    compile_rml("Main = a Main?; ")
    compile_rml("Main = (a b?) X; X = a? (b Main)?;")
    compile_rml("a matches {x:2147483647}; Main = a;")  # of Java, in which the reference compiler is written


def test_an_undefined_equation_is_refused_with_the_nearest_name() -> None:
    assert refused("Main = a Unsave; UnSafe = a;").hint == "did you mean 'UnSafe'?"


@pytest.mark.parametrize(
    "text",
    [
        "Main = " + "(" * 10_000 + "a" + ")" * 10_000 + ";",
        "Main = a" + "+" * 10_000 + ";",
        "Main = " + "a >> " * 10_000 + "a;",
        "Main = " + "if (1<2) " * 10_000,
        "a matches {x:v} with " + "(" * 10_000 + "1",
        "a matches {x:v} with " + "-" * 10_000 + "1 > 0; Main = a;",
        "a matches {x:v} with 1" + "+1" * 10_000 + " > 0; Main = a;",
        "a matches " + "[" * 10_000,
        "a matches " + "{x:" * 10_000,
        "Main = a (" * 10_000,
    ],
    ids=lambda text: text[:24],
)
def test_ten_thousand_levels_are_refused_and_crash_nothing(text: str) -> None:
    assert refused(text).kind in ("too_deep", "syntax")


def test_the_depth_limit_is_where_it_says() -> None:
    deepest = MAX_DEPTH - 1

    compile_rml("Main = " + "(" * deepest + "a" + ")" * deepest + ";")
    assert refused("Main = " + "(" * MAX_DEPTH + "a" + ")" * MAX_DEPTH + ";").kind == "too_deep"


def test_a_sequence_of_ten_thousand_events_is_not_deep() -> None:
    assert len(parse("Main = " + "a " * 10_000 + ";").equations[0].body.parts) == 10_000  # type: ignore[union-attr]


def test_a_pattern_that_stands_for_too_many_is_refused() -> None:
    fields = ", ".join(f"k{i}: 0|1" for i in range(13))

    assert refused(f"a matches {{{fields}}}; Main = a;").kind == "too_many_alternatives"


# Readings --------------------------------------------------------------------------------


def test_operators_bind_as_the_grammar_says(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, Any]] = [
        ("a b c", ["cat", "a", ["cat", "b", "c"]]),
        ("a \\/ b \\/ c", ["or", ["or", "a", "b"], "c"]),
        ("a | b /\\ c \\/ d", ["shuffle", "a", ["or", ["and", "b", "c"], "d"]]),
        ("a >> b >> c : d", ["filter", ["a"], ["filter", ["b"], "c", "d"], ["all"]]),
        ("a (b >> c)* d", ["cat", "a", ["cat", ["star", ["filter", ["b"], "c", ["all"]]], "d"]]),
        ("a{2}?", ["opt", ["times", "a", 2]]),
        ("a (b c)", ["cat", "a", ["cat", "b", "c"]]),
    ]
    for text, reading in cases:
        with subtests.test(text=text):

            def events(node: Any) -> Any:
                if isinstance(node, list) and node[0] == "event" and len(node) == 2:
                    return node[1]
                return [events(child) for child in node] if isinstance(node, list) else node

            assert events(tree(parse(f"Main = {text};"))["Main"]) == reading


def test_arithmetic_binds_as_in_the_reference(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, Any]] = [
        ("12/2*3", ["op", "/", 12, ["op", "*", 2, 3]]),
        ("12-2+3", ["op", "-", 12, ["op", "+", 2, 3]]),
        ("1-1-1", ["op", "-", ["op", "-", 1, 1], 1]),
        ("2^3^2", ["op", "^", ["op", "^", 2, 3], 2]),
        ("-v^2", ["op", "-", ["op", "^", ["var", "v"], 2]]),
        ("-v*2", ["op", "*", ["op", "-", ["var", "v"]], 2]),
        ("v - -1", ["op", "-", ["var", "v"], -1]),
        ("1<2", ["op", "<", 1, 2]),
        ("v > 2", ["op", ">", ["var", "v"], 2]),
        ("min(v, 1)", ["op", "min", ["var", "v"], 1]),
    ]
    for text, reading in cases:
        with subtests.test(text=text):
            assert tree(parse(f"Main = G<{text}>; G<n> = a(n);"))["Main"] == [
                "apply",
                ["ref", "G"],
                [reading],
            ]


# Warnings --------------------------------------------------------------------------------


def test_what_runs_but_hardly_as_meant_is_warned_about(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, str]] = [
        ("Main = c;", "event type 'c' with 0 parameters is not declared"),
        (A + "Main = a(1);", "event type 'a' with 1 parameter is not declared"),
        (A + "Main = a; Y = Y;", "equation 'Y' is never used"),
        (A + "Main = G<1,2>; G<n> = a;", "'G' has 1 parameter but is given 2"),
        ("p(x) matches {x:x}; Main = p(x) p(x);", "no let declares the name 'x'"),
        ("a matches b | {x:1}; Main = a;", "is a variable that matches everything"),
        ("a not matches {x:v} with v > 3; Main = a;", "negates its pattern but not its guard"),
        ("a matches {x:1, x:2}; Main = a;", "has the key 'x' twice"),
        ("a matches {x:v} with 12/2*v > 1; Main = a;", "'*' binds tighter than '/'"),
    ]
    for text, warning in cases:
        with subtests.test(text=text, warning=warning):
            assert any(warning in str(w) for w in compile_rml(text).warnings)


def test_a_sound_specification_is_not_warned_about(subtests: pytest.Subtests) -> None:
    cases: list[str] = [
        A + "Main = a b* any?;",
        "a matches {x:v} with 12/(2*v) > 1; Main = a;",
        "p(x) matches {x:x}; Main = {let x; p(x) B}; B = p(x);",
        "p(x) matches {x:x}; Main = G<1>; G<n> = p(n) G<n+1>?;",
    ]
    for text in cases:
        with subtests.test(text=text):
            assert compile_rml(text).warnings == ()


# The older dialect -----------------------------------------------------------------------


def test_the_older_dialect_takes_patterns_as_arguments_and_min_as_a_name() -> None:
    text = (
        "in(min,max) matches {n:v} with v >= min && v < max; d(x,y) matches {n:[x,y]};"
        "Main = in(0,2) d(_, 's');"
    )

    compile_rml(text, dialect="rosmonitoring")
    assert refused(text).kind == "syntax"


def test_even_the_older_dialect_takes_no_alternatives_as_an_argument() -> None:
    error = refused("p(x) matches {n:x}; Main = p('s'|'t');", dialect="rosmonitoring")

    assert error.kind == "or_pattern_as_argument"


# One form --------------------------------------------------------------------------------


def test_comments_stay_with_their_statement() -> None:
    text = (
        "// what it is\n// in two lines\na matches {x:1}; // one\n"
        "b matches /" + "/ inside\n  {x:2};\n// main\nMain = a b; // done\n// last\n"
    )

    assert format_rml(parse(text)).splitlines() == [
        "// what it is",
        "// in two lines",
        "a matches {x: 1}; // one",
        "// inside",
        "b matches {x: 2};",
        "",
        "// main",
        "Main = a b; // done",
        "// last",
    ]


names = st.sampled_from(["a", "b", "place", "let_", "minx"])
uppers = st.sampled_from(["Main", "G", "X1"])
numbers = st.sampled_from(["0", "7", "2147483647", "0.5", "100.0"]).map(
    lambda text: Num(float(text) if "." in text else int(text), text)
)
negative = numbers.filter(lambda n: n.value != 0).map(lambda n: Num(-n.value, f"-{n.text}"))
binary = st.sampled_from("^ * / + - < <= > >= == != && ||".split())  # noqa: SIM905  # the table of the language


def _data(inner: Any) -> Any:
    return (
        st.builds(lambda op, a, b: Op(op, (a, b)), binary, inner, inner)
        | inner.filter(lambda d: not isinstance(d, Num)).map(lambda d: Op("-", (d,)))
        | st.builds(lambda f, a: Op(f, (a,)), st.sampled_from(["abs", "sin"]), inner)
        | st.builds(lambda a, b: Op("max", (a, b)), inner, inner)
    )


data = st.recursive(numbers | negative | names.map(Var), _data, max_leaves=6)
strings = st.text(st.sampled_from("ab'\\\n\t \u00e9\u4e2d\U0001f600\""), max_size=4)
literals = (
    strings.map(Literal_)
    | numbers.map(lambda n: Literal_(n.value, n.text))
    | st.sampled_from([True, False, None]).map(Literal_)
)


def _patterns(inner: Any) -> Any:
    record = st.lists(
        st.tuples(strings | names | st.just("min"), inner), max_size=3, unique_by=lambda f: f[0]
    )
    return (
        record.map(lambda fields: RecordPattern(tuple(fields)))
        | st.builds(
            lambda items, rest: ListPattern(tuple(items), rest), st.lists(inner, max_size=3), st.booleans()
        )
        | st.lists(inner, min_size=2, max_size=3).map(lambda options: OrPattern(tuple(options)))
    )


patterns = st.recursive(literals | names.map(Name) | st.just(Anything()), _patterns, max_leaves=6)
types = st.builds(lambda name, args: EventType(name, tuple(args)), names, st.lists(data, max_size=2))


def _exps(inner: Any) -> Any:
    chain = st.sampled_from(["cat", "and", "or", "shuffle"])
    post = st.sampled_from(["star", "plus", "opt", "closure"])
    return (
        st.builds(lambda op, parts: Chain(op, tuple(parts)), chain, st.lists(inner, min_size=2, max_size=3))
        | st.builds(Post, post, inner)
        | st.builds(lambda body, count: Post("times", body, count), inner, st.integers(0, 9))
        | st.builds(lambda xs, body: Let(tuple(xs), body), st.lists(names, min_size=1, max_size=2), inner)
        | st.builds(If, data, inner, inner)
        | st.builds(Filter, types, inner, st.none() | inner)
    )


references = st.builds(lambda name, args: Ref(name, tuple(args) or None), uppers, st.lists(data, max_size=2))
exps = st.recursive(types.map(Event) | references | st.sampled_from([Empty(), All()]), _exps, max_leaves=10)
direct = st.builds(
    lambda negated, pattern, guard: Declaration(EventType("t", (Var("a"),)), negated, (), pattern, guard),
    st.booleans(),
    patterns,
    st.none() | data,
)


@given(direct, exps)
@settings(max_examples=100)
def test_what_is_formatted_reads_the_same_and_formats_the_same(declaration: Declaration, exp: Any) -> None:
    spec = Spec((declaration,), (Equation("Main", (), exp),))

    text = format_rml(spec)

    assert parse(text) == spec
    assert format_rml(parse(text)) == text


@pytest.mark.parametrize(
    "exp",
    [
        "(a) (b | c)",
        "(a) (b | c) d",
        "d? (a) (b | c)",
        "(a) (b) (c | d)",
        "a b (c \\/ d)",  # no pattern, so it cannot be taken for arguments
        "a? (b | c)",
    ],
)
def test_a_type_keeps_its_parentheses_where_the_next_ones_read_as_its_arguments(exp: str) -> None:
    text = f"Main = {exp};\n"

    assert format_rml(parse(text)) == text


@given(st.text(st.sampled_from("ab G<>(){}[];:,.|/\\*+?!=_&'1-^\n"), max_size=40))
@settings(max_examples=100)
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        spec = parse(text)
    except RmlError as refusal:
        spec, error = None, refusal

    if spec is None:
        assert error.line >= 1
    else:
        assert parse(format_rml(spec)) == spec


def test_a_text_in_a_guard_is_answered_with_where_texts_are_compared() -> None:
    with pytest.raises(RmlError, match="a value was expected, not 'abc'") as refused:
        compile_rml("a matches {x:v} with v == 'abc'; Main = a;")

    assert "by the pattern" in refused.value.hint


@pytest.mark.slow
def test_a_long_chain_of_equations_is_checked_link_by_link() -> None:
    links = [f"A{i} = A{i + 1}; " for i in range(3_000)]

    for text in ("".join(links), "".join(reversed(links))):
        assert not compile_rml("a matches {x:1}; Main = A0; " + text + "A3000 = a*;").warnings
