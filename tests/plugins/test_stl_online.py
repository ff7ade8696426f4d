"""Formulas watched while the trial goes on: every margin as in the whole log, and the findings too."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    Body,
    Event,
    InstantVerdict,
    OnlineMonitor,
    Sample,
    Signal,
    Span,
    Trial,
    Verdict,
    uncovered_spans,
)
from ariac_score.testing import ContractCheck, contract_checks
from ariac_score_ariac.testing import made_trial
from ariac_score_stl import StlFormula, discrete
from ariac_score_stl.discrete import Discrete
from ariac_score_stl.margins import NEXT_TO_ZERO, decisive, margins
from ariac_score_stl.online import undecided_online
from ariac_score_stl.rows import Rows
from ariac_score_stl.syntax import parse

LAWS = settings(max_examples=80, derandomize=True, deadline=None)


@pytest.fixture(autouse=True, scope="module")
def _forgetful() -> Iterator[None]:
    """Rows are forgotten as soon as nobody looks at them, so that whoever still does is found out."""
    before, discrete._FORGOTTEN_AT_ONCE = discrete._FORGOTTEN_AT_ONCE, 0
    yield
    discrete._FORGOTTEN_AT_ONCE = before


COMPARISONS = st.sampled_from(["<", "<=", ">", ">=", "==", "!="])
LEAVES = st.tuples(st.sampled_from("xy"), COMPARISONS, st.integers(0, 4)).map(
    lambda p: f"{p[0]} {p[1]} {p[2]}"
)
WINDOW = st.tuples(st.integers(0, 4), st.integers(0, 6)).map(
    lambda pair: f"[{pair[0] / 10:g},{(pair[0] + pair[1]) / 10:g}]"
)


def _larger(parts: st.SearchStrategy[str]) -> st.SearchStrategy[str]:
    inside = parts.map(lambda text: f"({text})")
    one = st.sampled_from(["not", "next", "rise", "fall", "once", "historically"])
    two = st.sampled_from(["and", "or", "xor", "->", "<->", "since"])
    windowed = st.sampled_from(["always", "eventually", "once", "historically"])
    return (
        st.tuples(one, inside).map(" ".join)
        | st.tuples(inside, two, inside).map(" ".join)
        | st.tuples(windowed, WINDOW, inside).map("".join)
        | st.tuples(inside, st.sampled_from([" until", " since"]), WINDOW, inside).map("".join)
    )


FORMULAS = st.recursive(LEAVES | st.just("true"), _larger, max_leaves=5)
VALUES = st.sampled_from([k / 4 for k in range(-2, 18)])
BEYOND = st.sampled_from(["undecided", "weak", "strong", "cut"])


@st.composite
def traces(draw: st.DrawFn, steps: Sequence[int]) -> tuple[list[float], dict[str, list[float]]]:
    n = draw(st.integers(1, 25))
    ticks = np.cumsum(draw(st.lists(st.sampled_from(steps), min_size=n, max_size=n)))
    return (ticks / 10).tolist(), {name: draw(st.lists(VALUES, min_size=n, max_size=n)) for name in "xy"}


def offline(
    text: str, t: list[float], values: dict[str, list[float]], start_s: float, beyond: Any, gap_s: float
) -> Any:
    """Begin, lower and upper bound of every row of the whole log; then whether each bound is broken.

    The latter by judging truth, 1 and -1, instead of margins: no trick about a margin of 0 is in that.
    """
    tree, span = parse(text, ["x", "y"]), Span(start_s, t[-1])
    at = np.array(t)
    rows = Rows.of(at, span, uncovered_spans(at, span, max_gap_s=gap_s))
    found = margins(tree, {name: np.array(column) for name, column in values.items()}, len(t))
    truths = {
        node: np.where(margin > 0 if node.comparison in ("<", ">", "!=") else margin >= 0, 1.0, -1.0)
        for node, margin in found.items()
    }
    margin, truth = (Discrete.whole(tree, rows, leaves, beyond).of(tree) for leaves in (found, truths))
    return rows.begin, margin.lower, margin.upper, truth.lower < 0, truth.upper < 0


def online(
    text: str, t: list[float], values: dict[str, list[float]], start_s: float, beyond: Any, gap_s: float
) -> Any:
    """The rows as they are given, one sample after the other, and how many samples had come then."""
    tree = parse(text, ["x", "y"])
    formula = Discrete(tree, Rows(start_s), beyond)
    given_rows, when = [], []
    for k, t_s in enumerate(t):
        found = margins(tree, {name: np.array([column[k]]) for name, column in values.items()}, 1)
        rows = formula.take(t_s, decisive(found), gap_s)
        given_rows += rows
        when += [t_s] * len(rows)
    return given_rows, when


def plain(values: Sequence[float]) -> list[float]:
    return [0.0 if abs(value) <= NEXT_TO_ZERO else value for value in values]


def reach_s(text: str) -> float:
    """How far a formula looks ahead, s; what `next` needs comes as steps of a tenth of a second."""

    def of(node: Any) -> float:
        own = 0.0
        if node.operator in ("always", "eventually", "until"):
            own = node.bounds.end_s
        return own + (0.1 if node.operator == "next" else 0.0) + max(map(of, node.parts), default=0.0)

    return of(parse(text, ["x", "y"]))


@given(text=FORMULAS, trace=traces([1, 1, 1, 1, 5]), beyond=BEYOND, late=st.sampled_from([0.0, 0.1, 0.7]))
@LAWS
def test_every_margin_is_that_of_the_whole_log_holes_and_limits_included(
    text: str, trace: Any, beyond: Any, late: float
) -> None:
    t, values = trace
    begin, lower, upper, below, above = offline(text, t, values, t[0] - late, beyond, 0.15)

    rows, _ = online(text, t, values, t[0] - late, beyond, 0.15)

    n = len(rows)
    assert [row[0] for row in rows] == begin[:n].tolist()
    assert plain([row[2] for row in rows]) == lower[:n].tolist()
    assert plain([row[3] for row in rows]) == upper[:n].tolist()
    assert [row[2] < 0 for row in rows] == below[:n].tolist()
    assert [row[3] < 0 for row in rows] == above[:n].tolist()


@given(text=FORMULAS, trace=traces([1]), beyond=BEYOND)
@LAWS
def test_an_instant_is_judged_as_soon_as_all_that_it_looks_at_has_come(
    text: str, trace: Any, beyond: Any
) -> None:
    t, values = trace

    rows, when = online(text, t, values, t[0], beyond, 0.15)

    reach = reach_s(text)
    assert when == pytest.approx([row[0] + reach for row in rows])
    assert len(rows) == sum(t_s + reach <= t[-1] + 1e-9 for t_s in t)


@pytest.mark.slow
@given(text=FORMULAS, trace=traces([1, 2, 3, 5]), beyond=BEYOND)
@LAWS
def test_where_a_window_holds_no_sample_every_margin_is_that_of_the_whole_log_too(
    text: str, trace: Any, beyond: Any
) -> None:
    t, values = trace
    begin, lower, upper, *_ = offline(text, t, values, t[0], beyond, 0.45)

    rows, _ = online(text, t, values, t[0], beyond, 0.45)

    assert [row[0] for row in rows] == begin[: len(rows)].tolist()
    assert plain([low for _, _, low, _ in rows]) == lower[: len(rows)].tolist()
    assert plain([high for *_, high in rows]) == upper[: len(rows)].tolist()


def test_what_is_kept_does_not_grow_with_the_trial() -> None:
    text = "historically ((x > 1 since[0.5,2] y > 0) -> eventually[0,3] (x < 2 until[1,2] rise y > 1))"
    tree = parse(text, ["x", "y"])
    predicates = [node for node in tree.walk() if node.margin is not None]
    formula, most = Discrete(tree, Rows(0.0), "undecided"), 0
    for k in range(1_000):
        margins_now = {node: np.array([(k * i) % 7 - 3.0]) for i, node in enumerate(predicates)}
        formula.take(k / 10, margins_now, 0.15)
        most = max(most, formula.kept)

    assert most < 100


# The monitor -----------------------------------------------------------------------------

BODIES = (Body("human", "human"), Body("robot", "robot"))
SIGNALS = {"d": "centre_distance in m", "v": "speed of robot in m/s"}
UNITS = {"centre_distance/robot/human": "m", "speed/robot": "m/s"}
STOPS = "always (d < 1 -> eventually[0,0.2] v < 0.1)"


def log(t: Sequence[float], d: Sequence[float], v: Sequence[float]) -> Trial:
    columns = dict(zip(UNITS, (d, v), strict=True))
    signals = {n: Signal(n, UNITS[n], np.array(t), np.array(columns[n])) for n in UNITS}
    return Trial("t", bodies=BODIES, signals=signals, recorded=Span(t[0], t[-1]))


def samples(trial: Trial) -> list[Sample]:
    found = [signal.sample(i) for signal in trial.signals.values() for i in range(len(signal))]
    return sorted(found, key=lambda sample: (sample.t_s, sample.signal))


def stepped(monitor: StlFormula, trial: Trial) -> list[tuple[float, InstantVerdict]]:
    """Every verdict, with the time at which it was given."""
    watch = monitor.begin(trial.bodies)
    return [(s.t_s, verdict) for s in samples(trial) for verdict in watch.step([s])]


def formula(text: str, **more: Any) -> StlFormula:
    used = {name: SIGNALS[name] for name in SIGNALS if name in text}
    return StlFormula(formula=text, signals=used, **{"max_gap_s": 0.15, **more})


def test_a_promise_is_judged_when_its_time_is_up_and_not_before() -> None:
    t = [k / 10 for k in range(8)]
    near = log(t, d=[9, 0.5, 9, 9, 9, 9, 9, 9], v=[1, 1, 1, 1, 1, 1, 1, 1])

    found = stepped(formula(STOPS), near)

    assert [(now, s.t_s) for now, s in found] == [(round(k / 10 + 0.2, 1), k / 10) for k in range(6)]
    broken = [s for _, s in found if s.verdict is Verdict.VIOLATED]
    assert [s.t_s for s in broken] == [0.1]
    assert broken[0].message == "'d < 1 -> eventually[0,0.2] v < 0.1' fails"
    assert broken[0].robustness is None  # metres or metres per second?


def test_looking_back_needs_no_waiting_and_a_margin_has_its_unit() -> None:
    trial = log([0.0, 0.1, 0.2], d=[9, 9, 9], v=[0.5, 0.2, 0.1])

    found = stepped(formula("always historically[0,0.1] v < 0.4"), trial)

    assert [(now, s.t_s) for now, s in found] == [(0.0, 0.0), (0.1, 0.1), (0.2, 0.2)]
    assert [s.verdict for _, s in found] == [Verdict.VIOLATED, Verdict.VIOLATED, Verdict.SATISFIED]
    assert [(s.robustness, s.unit) for _, s in found] == [
        (0.4 - 0.5, "m/s"),
        (0.4 - 0.5, "m/s"),
        (0.4 - 0.2, "m/s"),
    ]


def test_what_is_before_the_trial_is_unknown_unless_a_policy_decides_it() -> None:
    trial = log([0.0, 0.1, 0.2], d=[9, 9, 9], v=[0.2, 0.2, 0.2])
    text = "always historically[0,0.1] v < 0.4"

    first = {b: stepped(formula(text, beyond=b), trial)[0][1] for b in ("undecided", "weak", "strong", "cut")}

    assert {b: s.verdict.value for b, s in first.items()} == {
        "undecided": "inconclusive",
        "weak": "satisfied",
        "strong": "violated",
        "cut": "satisfied",
    }


@pytest.mark.parametrize("text", ["v < 0.4", "v > 0.4", "eventually[0,0.1] v > 0.4"])
def test_a_formula_without_always_is_judged_at_the_start_and_for_good(text: str) -> None:
    trial = log([0.0, 0.1, 0.2, 0.3], d=[9] * 4, v=[0.1, 0.2, 0.5, 0.5])

    ((_, only),) = stepped(formula(text), trial)

    assert (only.t_s, only.final) == (0.0, True)
    (found,) = formula(text).watch(trial)
    assert only.verdict is found.verdict


def test_an_always_with_bounds_is_final_when_they_have_passed() -> None:
    trial = log([k / 10 for k in range(6)], d=[9] * 6, v=[0.9, 0.1, 0.1, 0.9, 0.9, 0.9])
    kept, broken = (stepped(formula(f"always[0.1,{end}] v < 0.4"), trial) for end in (0.2, 0.3))

    assert [(s.t_s, s.verdict, s.final) for _, s in kept] == [
        (0.1, Verdict.SATISFIED, False),
        (0.2, Verdict.SATISFIED, False),
        (0.3, Verdict.SATISFIED, True),
    ]
    assert [(s.t_s, s.verdict, s.final) for _, s in broken][-2:] == [
        (0.3, Verdict.VIOLATED, False),
        (0.4, Verdict.VIOLATED, True),
    ]


def test_what_cannot_be_decided_before_the_end_is_reported_as_such(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, Any, str]] = [
        ("always (d < 1 -> eventually v < 0.1)", {}, "'eventually v < 0.1' (column 18) looks ahead without"),
        ("always (v < 1 until d < 1)", {}, "'v < 1 until d < 1' (column 9) looks ahead without a bound"),
        ("eventually v < 1", {}, "give it bounds, as in 'eventually[0,5]'"),
        ("always v < 1", {"time": "dense"}, "dense time is judged at the end"),
    ]
    for text, more, why in cases:
        with subtests.test(text=text, why=why):
            monitor = formula(text, **more)
            trial = log([0.0, 0.1], d=[9, 9], v=[0, 0])

            assert why in undecided_online(monitor.specification)
            assert monitor.begin(BODIES).undecided == undecided_online(monitor.specification)  # type: ignore[attr-defined]
            assert stepped(monitor, trial) == []
            assert ending(monitor, trial) == list(monitor.watch(trial))


def test_a_formula_about_nobody_known_says_so() -> None:
    watch = formula("always v < 1").begin((Body("human", "human"),))

    assert watch.undecided == "whom it is about is not known before the trial"  # type: ignore[attr-defined]


@pytest.mark.parametrize("text", ["always v < 1", "historically v < 1", "always eventually[0,9] v < 1"])
def test_what_can_be_decided_is_not_put_off(text: str) -> None:
    assert undecided_online(formula(text).specification) == ""


def test_an_outermost_always_without_bounds_is_no_look_ahead() -> None:
    assert undecided_online(formula("always v < 1").specification) == ""
    assert undecided_online(formula("always always v < 1").specification) != ""


def test_a_formula_without_value_is_undecided_from_there_on() -> None:
    trial = log([0.0, 0.1, 0.2], d=[9, 9, 9], v=[1, 0, 1])

    found = stepped(formula("always 1 / v < 4"), trial)

    assert [(s.verdict, s.final) for _, s in found] == [
        (Verdict.SATISFIED, False),
        (Verdict.INCONCLUSIVE, True),
    ]
    assert "division by zero" in found[1][1].message


def test_with_the_start_of_the_competition_the_formula_begins_and_with_its_end_it_ends() -> None:
    events = (Event(0.2, COMPETITION_STARTED), Event(0.4, COMPETITION_ENDED))
    trial = replace(
        log([k / 10 for k in range(7)], d=[9] * 7, v=[0.9, 0.1, 0.2, 0.1, 0.9, 0.9, 0.9]), events=events
    )
    text = "always historically[0,0.2] v < 0.4"
    watch = formula(text).begin(trial.bodies)
    came = sorted((*events, *samples(trial)), key=lambda item: item.t_s)

    steps = [([], [item]) if isinstance(item, Event) else ([item], []) for item in came]
    found = [s for own, happened in steps for s in watch.step(own, happened)]

    # 0.9 at the first sample is before the competition, of which nothing is known.
    assert [(s.t_s, s.verdict.value) for s in found] == [
        (0.0, "violated"),
        (0.1, "violated"),
        (0.2, "inconclusive"),
        (0.3, "inconclusive"),
        (0.4, "violated"),
    ]
    (violation, undecided) = formula(text).watch(trial)
    assert violation.span == Span(0.4, 0.4)
    assert undecided.span == Span(0.2, 0.4)


def ending(monitor: StlFormula, trial: Trial) -> list[Any]:
    watch = monitor.begin(trial.bodies)
    for sample in samples(trial):
        list(watch.step([sample]))
    return list(watch.end(replace(trial, signals={})))


@given(
    text=FORMULAS,
    trace=traces([1, 1, 2]),
    time=st.sampled_from(["discrete", "dense"]),
    beyond=BEYOND,
)
@settings(max_examples=60, derandomize=True, deadline=None)
def test_the_findings_in_the_end_are_those_of_the_whole_log(
    text: str, trace: Any, time: Any, beyond: Any
) -> None:
    if time == "dense" and any(word in text for word in ("next", "rise", "fall")):
        return
    names = {"x": SIGNALS["d"], "y": SIGNALS["v"]}
    used = parse(text, names).names
    if not used:
        return
    signals = {name: names[name] for name in names if name in used}
    t, values = trace
    trial = log(t, values["x"], values["y"])
    for whole in (text, f"always ({text})"):
        monitor = StlFormula(formula=whole, signals=signals, max_gap_s=0.15, time=time, beyond=beyond)

        assert ending(monitor, trial) == list(monitor.watch(trial))


@pytest.mark.slow
@pytest.mark.parametrize(
    "monitor",
    [
        formula(STOPS, max_gap_s=0.05),
        pytest.param(
            formula("always historically[0,1] v < 0.3", max_gap_s=0.05, t_on_s=0.1), marks=pytest.mark.slow
        ),
        pytest.param(
            formula(
                "always[1,4] (rise v > 0.2 -> d > 1 since[0.1,2] v < 0.1)", max_gap_s=0.05, beyond="weak"
            ),
            marks=pytest.mark.slow,
        ),
        formula("eventually v > 0.2", max_gap_s=0.05),
        formula("always v < 0.3", max_gap_s=0.05, time="dense"),
    ],
    ids=lambda monitor: monitor.formula,
)
def test_it_keeps_the_contract_online(monitor: StlFormula) -> None:
    assert isinstance(monitor, OnlineMonitor)
    checks: list[ContractCheck] = contract_checks(monitor, made_trial())
    names = {check.name for check in checks}
    assert "standings" in names
    for check in checks:
        if check.name in (
            "one_by_one",
            "instant_by_instant",
            "standings",
            "nothing_stepped",
            "repeated_time",
        ):
            check()
