"""RML over whole columns gives what the interpreter gives, event by event; only faster."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score_rml import compile_rml, run_trace
from ariac_score_rml.automaton import Watch, watch_by_interpreter, watch_stream
from ariac_score_rml.columns import Columns, Match, NotColumnarError, Stream, Topic
from ariac_score_rml.machine import Machine
from ariac_score_rml.margins import margins
from ariac_score_rml.progress import AfterViolation

POLICIES = get_args(AfterViolation)

TYPES = """
s matches {topic: 's'};
low matches {topic: 's', x: v} with v <= 1;
high matches {topic: 's', x: v, y: w} with v > 1 && w / v >= 0.5;
odd matches {topic: 's'|'t', x: 0.0};
odd matches {topic: 't', y: v} with abs(v) < 1;
far not matches low | odd;
pair(k) matches {topic: 's', x: v, y: v} with max(v, 1) >= k || min(v, 0.5) == k - 1;
top matches pair(2) | pair(1);
"""

event_types = st.sampled_from(
    ["s", "low", "high", "odd", "far", "pair(1)", "pair(0 + 1)", "top", "any", "none"]
)


def _exps(inner: Any) -> Any:
    def joined(operator: str) -> Any:
        return st.builds(lambda a, b: f"({a} {operator} {b})", inner, inner)

    return (
        joined("")
        | joined("\\/")
        | joined("/\\")
        | joined("|")
        | st.builds(
            lambda a, post: f"({a}){post}", inner, st.sampled_from(["*", "+", "?", "!", "{2}", "{0}"])
        )
        | st.builds(lambda kind, a: f"({kind} >> {a})", event_types, inner)
        | st.builds(lambda kind, a, b: f"({kind} >> {a} : {b})", event_types, inner, inner)
        | st.builds(lambda kind, a: f"(({kind}) ({a} | Main))", event_types, inner)
        | st.builds(lambda kind, n: f"({kind} \\/ G<{n}>)", event_types, st.integers(0, 2))
        | st.builds(lambda a, b: f"(if (1 < 2) {a} else {b})", inner, inner)
    )


exps = st.recursive(event_types | st.sampled_from(["empty", "all"]), _exps, max_leaves=8)
values = st.sampled_from([0.0, -0.0, 0.5, 1.0, 1.0 + 1e-11, 1.0 + 1e-9, 2.0, 4.0])


@st.composite
def streams(draw: st.DrawFn) -> Stream:
    counts = draw(st.integers(0, 12)), draw(st.integers(0, 6))
    times = [np.cumsum([draw(st.sampled_from([0.5, 1.0])) for _ in range(count)]) for count in counts]
    columns = {
        key: [np.array([draw(values) for _ in range(count)], dtype=float) for count in counts] for key in "xy"
    }
    first = Topic("s", times[0], {"x": columns["x"][0], "y": columns["y"][0]})
    return Stream([first, Topic("t", times[1], {"y": columns["y"][1]})])


def fast_watch(machine: Machine, stream: Stream, after: Any) -> Watch:
    return watch_stream(machine, stream, after, Columns(machine.matcher, stream))


def margins_of(machine: Machine, stream: Stream, watch: Watch) -> Match | None:
    return margins(machine, stream, watch, Columns(machine.matcher, stream))


@pytest.mark.slow
@given(exps, streams(), st.sampled_from(POLICIES))
@settings(max_examples=100)
def test_the_table_gives_the_verdicts_of_the_interpreter(exp: str, stream: Stream, after: Any) -> None:
    program = compile_rml(TYPES + f"Main = {exp}; G<n> = if (n > 0) low G<n - 1> else high;")

    fast = fast_watch(program.machine(), stream, after)
    slow = watch_by_interpreter(program.machine(), stream, after)

    assert (fast.rejected == slow.rejected).all()
    assert ((fast.before < 0) == (slow.before < 0)).all()
    assert (fast.initial, fast.end, fast.fresh, fast.error_at) == (
        slow.initial,
        slow.end,
        slow.fresh,
        slow.error_at,
    )


@given(exps, streams())
@settings(max_examples=60)
def test_the_first_rejection_is_that_of_a_run_over_the_events(exp: str, stream: Stream) -> None:
    program = compile_rml(TYPES + f"Main = {exp}; G<n> = low;")

    watch = fast_watch(program.machine(), stream, "once")
    run = run_trace(program.machine(), [stream.event(i) for i in range(len(stream))])

    assert (watch.initial, watch.end) == (run.initial, run.end)
    assert int(watch.rejected.sum()) == run.letters.count("F")


@pytest.mark.slow
@given(event_types.filter(lambda text: "(" not in text), streams())
@settings(max_examples=60)
def test_a_column_of_matches_is_the_match_of_each_event(kind: str, stream: Stream) -> None:
    machine = compile_rml(TYPES + f"Main = {kind};").machine()
    state = machine.start
    (term,) = machine.event_types(state) or ()

    column = Columns(machine.matcher, stream).match(term.name, term.given)

    singly = [machine.after(state, stream.event(i)) is not None for i in range(len(stream))]
    assert column.holds.tolist() == singly


@pytest.mark.parametrize(
    "text",
    [
        "a(v) matches {topic:'s', x:v}; Main = {let v; a(v) a(v)};",  # data is bound
        "a matches {topic:'s', x:v} with w > 3 && w == v; Main = a*;",  # an unknown
        "a matches {topic:t, x:v} with t > 3; Main = a*;",  # an error, which only a step may meet
        "a not matches {topic:'s', x:v} with 1 > 2; Main = a*;",
        "a matches {topic:'s', x:v} with v ^ 0.5 > 1; Main = a*;",
    ],
)
@pytest.mark.parametrize("after", POLICIES)
def test_what_columns_cannot_say_the_interpreter_does(text: str, after: Any) -> None:
    column = np.array([1.0, 5.0, -2.0, 5.0, 5.0])
    stream = Stream([Topic("s", np.arange(5.0), {"x": column})])
    program = compile_rml(text)

    fast = fast_watch(program.machine(), stream, after)
    slow = watch_by_interpreter(program.machine(), stream, after)

    assert (fast.rejected == slow.rejected).all()
    assert (fast.end, fast.error_at) == (slow.end, slow.error_at)


def test_a_type_that_binds_data_is_no_column() -> None:
    machine = compile_rml("a(v) matches {topic:'s', x:v}; Main = {let v; a(v)};").machine()

    assert machine.event_types(machine.start) is None


def test_a_stretch_that_changes_nothing_is_jumped_over(monkeypatch: pytest.MonkeyPatch) -> None:
    x = np.zeros(50_000)
    x[20_000] = 2.0  # the one event that opens and the one that closes
    x[40_000] = 3.0
    stream = Stream([Topic("s", np.arange(50_000.0), {"x": x})])
    text = """
    quiet matches {topic:'s', x:v} with v < 1; opens matches {topic:'s', x:2.0};
    closes matches {topic:'s', x:3.0}; Main = quiet* opens quiet* closes quiet*;
    """
    machine = compile_rml(text).machine()
    steps = []
    step = machine.after_matches
    monkeypatch.setattr(machine, "after_matches", lambda *given_: steps.append(1) or step(*given_))

    watch = fast_watch(machine, stream, "resume")

    assert watch.end == "t"
    assert not watch.rejected.any()
    assert len(steps) < 20


def test_events_at_one_time_come_in_the_order_of_the_topics() -> None:
    topics = [Topic(name, np.array([0.0, 1.0]), {"x": np.zeros(2)}) for name in ("b", "a")]

    stream = Stream(topics)

    assert [stream.event(i)["topic"] for i in range(4)] == ["b", "a", "b", "a"]
    assert stream.event(3) == {"time": 1.0, "x": 0.0, "topic": "a"}


# Margins ---------------------------------------------------------------------------------


def margin_of(text: str, x: list[float]) -> list[float]:
    stream = Stream([Topic("s", np.arange(float(len(x))), {"x": np.array(x)})])
    machine = compile_rml(text).machine()
    found = margins_of(machine, stream, fast_watch(machine, stream, "resume"))
    assert found is not None
    return found.margin.tolist()


def test_the_margin_is_that_of_the_inequality_that_decides(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, list[float]]] = [
        ("a matches {x:v} with v >= 1; Main = a*;", [-1.0, 0.0, 2.0]),
        ("a matches {x:v} with v <= 1; Main = a*;", [1.0, 0.0, -2.0]),
        ("a matches {x:v} with 1 <= v; Main = a*;", [-1.0, 0.0, 2.0]),
        ("a matches {x:v} with v >= 1 && v <= 2; Main = a*;", [-1.0, 0.0, -1.0]),
        ("a matches {x:v} with v >= 2 || v <= 0.5; Main = a*;", [0.5, -0.5, 1.0]),
        ("a matches {x:v} with v >= 1; b not matches a; Main = b*;", [1.0, 0.0, -2.0]),
        ("a matches {x:v} with v >= 1; c matches {x:v} with v <= 2; Main = (a /\\ c)*;", [-1.0, 0.0, -1.0]),
        ("a matches {x:v} with v >= 1; c matches {y:_}; Main = c >> a*;", [np.inf] * 3),
        ("a matches {x:v} with 1 / v >= 1; Main = a*;", [-np.inf, 0.0, 1 / 3 - 1]),
    ]
    for text, expected in cases:
        with subtests.test(text=text):
            assert margin_of(text, [0.0, 1.0, 3.0]) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("guard", "field", "bound"),
    [
        ("v >= 3", "x", 3.0),
        ("3 <= v", "x", 3.0),
        ("w > 2", "y", 2.0),
        ("2 < w", "y", 2.0),
        ("v <= w", "x", 7.0),  # two fields: the left one is limited
        ("w >= v", "y", 5.0),
        ("v + 1 < w", "y", 6.0),  # computed from fields is none
        ("v + 1 > 2", "", 2.0),
    ],
)
def test_an_inequality_limits_the_field_that_stands_alone_by_the_other_side(
    guard: str, field: str, bound: float
) -> None:
    names = ["x", "y"]
    stream = Stream([Topic("s", np.array([0.0]), {"x": np.array([5.0]), "y": np.array([7.0])})])
    machine = compile_rml(f"a matches {{x:v, y:w}} with {guard}; Main = a;").machine()

    match = Columns(machine.matcher, stream).match("a", ())

    assert match.bound.tolist() == [bound]
    assert match.field.tolist() == [names.index(field) if field else -1]


@pytest.mark.slow
@given(exps, streams())
@settings(max_examples=100)
def test_a_rejected_event_never_has_a_positive_margin_nor_an_accepted_one_a_negative(
    exp: str, stream: Stream
) -> None:
    machine = compile_rml(TYPES + f"Main = {exp}; G<n> = low;").machine()
    watch = fast_watch(machine, stream, "resume")
    found = margins_of(machine, stream, watch)

    if found is not None and watch.error is None:
        judged = watch.before >= 0
        assert (found.margin[watch.rejected & judged] <= 1e-9).all()
        assert (found.margin[~watch.rejected & judged] >= -1e-9).all()


def test_a_margin_that_only_the_interpreter_could_say_is_not_guessed() -> None:
    stream = Stream([Topic("s", np.arange(2.0), {"x": np.zeros(2)})])
    machine = compile_rml("a matches {x:v} with w > 3 && w == v; Main = a*;").machine()

    assert margins_of(machine, stream, fast_watch(machine, stream, "resume")) is None
    with pytest.raises(NotColumnarError):
        Columns(machine.matcher, stream).match("a", ())
