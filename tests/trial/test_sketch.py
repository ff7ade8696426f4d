"""Sketches: nothing that a drawing shows is lost by reducing, and nothing is invented."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Body, Chart, Signal, Span, Trial, as_json, load_result, score_trial
from ariac_score.errors import ResultError
from ariac_score.results import sketch as sketch_module
from ariac_score.results.sketch import DECIMALS, NEAR_M, extremes, sketch_of
from ariac_score.testing import NEAR_MISS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

EXAMPLE = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"


def _chart(t: Any, actual: Any, limit: Any = None, **more: Any) -> Chart:
    t, actual = np.asarray(t, dtype=float), np.asarray(actual, dtype=float)
    limit = np.full(len(t), np.nan) if limit is None else np.asarray(limit, dtype=float)
    return Chart("robot/human", "distance", "m", t, actual, limit, **more)


def _curve(chart: Chart, *moments: Span) -> Any:
    (curve,) = sketch_of(
        Trial("made"), {"separation": [chart]}, {("separation", "robot/human"): moments}
    ).curves
    return curve


VALUES = st.lists(st.floats(-50, 50), min_size=2, max_size=400)


@given(values=VALUES, pixels=st.integers(1, 60))
def test_no_pixel_loses_its_lowest_or_highest_value(values: list[float], pixels: int) -> None:
    t = np.arange(len(values)) / 100.0
    column = np.array(values)

    kept = extremes(t, [column], pixels)

    pixel = np.minimum((t / (t[-1] / pixels)).astype(int), pixels - 1)
    for number in np.unique(pixel):
        whole, reduced = column[pixel == number], column[kept[pixel[kept] == number]]
        assert (whole.min(), whole.max()) == (reduced.min(), reduced.max())
    assert (kept[0], kept[-1]) == (0, len(t) - 1)
    assert len(kept) <= 2 * pixels + 2


def test_of_equal_samples_the_first_is_the_lowest_and_the_last_the_highest() -> None:
    t = np.arange(6.0)

    assert extremes(t, [np.ones(6)], 1).tolist() == [0, 5]
    assert extremes(t, [np.array([2.0, 1.0, 1.0, 3.0, 3.0, 2.0])], 1).tolist() == [0, 1, 4, 5]
    assert extremes(t[:1], [np.ones(1)], 3).tolist() == [0]


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), steps=st.integers(10, 3000))
def test_a_curve_keeps_every_extreme_of_value_limit_and_margin(seed: int, steps: int) -> None:
    draw = np.random.default_rng(seed)
    t = np.cumsum(draw.uniform(0.005, 0.02, steps))
    actual, limit = draw.normal(3, 1, steps), draw.normal(2, 1, steps)

    curve = _curve(_chart(t, actual, limit))

    a, b = np.round(actual, DECIMALS), np.round(limit, DECIMALS)
    assert (min(curve.actual), max(curve.actual)) == (a.min(), a.max())
    assert (min(curve.limit), max(curve.limit)) == (b.min(), b.max())
    margins = [x - y for x, y in zip(curve.actual, curve.limit, strict=True)]
    assert min(margins) == (a - b).min()
    assert set(zip(curve.t_s, curve.actual, strict=True)) <= set(
        zip(np.round(t, DECIMALS).tolist(), a.tolist(), strict=True)
    )
    assert list(curve.t_s) == sorted(curve.t_s)


def test_one_sample_of_a_breach_among_sixty_thousand_stays() -> None:
    t = np.arange(60_000) / 100.0
    actual = np.full(60_000, 5.0)
    actual[34_567] = 1.25

    curve = _curve(_chart(t, actual, np.full(60_000, 2.0)))

    assert len(curve.t_s) < 5000
    assert (curve.t_s[curve.actual.index(1.25)], curve.samples) == (345.67, 60_000)


def test_around_a_violation_the_curve_is_finer() -> None:
    t = np.arange(60_000) / 100.0
    actual = np.random.default_rng(1).normal(5, 1, 60_000)

    plain, finer = _curve(_chart(t, actual)), _curve(_chart(t, actual), Span(300.0, 301.0))

    def near(curve: Any) -> int:
        return sum(298.0 <= moment <= 303.0 for moment in curve.t_s)

    assert near(finer) > 5 * near(plain)


def test_a_hole_is_kept_as_a_hole() -> None:
    t = [0.0, 0.01, 0.02, 5.0, 5.01]

    curve = _curve(_chart(t, [1.0, 1.0, 1.0, 1.0, 1.0], max_gap_s=0.05))

    assert curve.holes_s == (0.02,)
    assert {0.02, 5.0} <= set(curve.t_s)


def test_where_no_limit_applies_there_is_none() -> None:
    curve = _curve(_chart([0.0, 1.0, 2.0, 3.0], [4.0, 3.0, 2.0, 1.0], [np.nan, 2.5, 2.5, np.nan]))

    assert curve.limit == (None, 2.5, 2.5, None)


def test_a_pair_that_nobody_has_a_limit_for_is_drawn_without_one() -> None:
    sketch = sketch_of(kitting_trial(), {}, {})

    (curve,) = sketch.curves
    assert (curve.check, curve.subject, set(curve.limit)) == ("", "robot/human", {None})
    assert min(curve.actual) == pytest.approx(NEAR_MISS.closest_m, abs=0.005)


@given(
    st.lists(
        st.tuples(st.sampled_from([0.1, 1.0, 1.5, 3.0]), st.integers(-2, 2), st.integers(-2, 2)),
        min_size=1,
        max_size=60,
    ),
    st.sampled_from([0, 1, 3, 500]),
    st.none() | st.tuples(st.floats(-1, 40), st.floats(0, 60)),
)
@settings(max_examples=120, derandomize=True, deadline=None)
def test_a_route_is_near_every_sample_and_keeps_both_sides_of_its_longest_holes(
    steps: list[tuple[float, int, int]],
    holes: int,
    window: tuple[float, float] | None,
) -> None:
    t = np.cumsum([step for step, *_ in steps])
    places = np.array([(x / 3, y / 3, 0.0) for _, x, y in steps])
    recorded = None if window is None else Span(window[0], window[0] + window[1])
    signals = {"position/r": Signal("position/r", "m", t, places)}
    trial = Trial("t", bodies=(Body("r", "robot"),), signals=signals, recorded=recorded)
    with patch.object(sketch_module, "MOST_HOLES", holes):
        routes = sketch_of(trial, {}, {}).routes

    inside = [k for k in range(len(t)) if recorded is None or recorded.start_s <= t[k] <= recorded.end_s]
    if not inside:
        assert routes == ()
        return
    t, places = t[inside], np.round(places[inside], DECIMALS)
    ends = sorted(range(len(t) - 1), key=lambda k: -(t[k + 1] - t[k]))
    longest = sorted([k for k in ends if t[k + 1] - t[k] > 1.0 + 1e-9][:holes])
    (route,) = routes
    assert (route.body, route.kind) == ("r", "robot")
    for k in (0, len(t) - 1, *longest, *(k + 1 for k in longest)):
        assert round(float(t[k]), DECIMALS) in route.t_s
    drawn = [np.interp(t, route.t_s, along) for along in (route.x_m, route.y_m)]
    assert np.hypot(drawn[0] - places[:, 0], drawn[1] - places[:, 1]).max() <= NEAR_M + 1e-3
    assert route.holes_s == tuple(float(v) for v in np.round(t[longest], DECIMALS))


def test_routes_orders_and_submissions_are_taken_along() -> None:
    trial = kitting_trial()

    sketch = sketch_of(trial, {}, {})

    assert [(route.body, route.kind) for route in sketch.routes] == [("human", "human"), ("robot", "robot")]
    # From -3 m at 0.5 m/s for 12 s, and back.
    assert (min(sketch.routes[1].x_m), max(sketch.routes[1].x_m)) == (-3.0, 3.0)
    assert [one.path for one in sketch.asked if one.level == "order"] == ["order_0", "order_1"]
    words = {one.path: one.words for one in sketch.asked}
    assert words["order_0/order_0_shipment_0"] == "kitting, on agv1"
    assert words["order_0/order_0_shipment_0/part_1"] == "blue gear"
    assert [(one.submitted_s, one.contents is not None) for one in sketch.brought] == [
        (14.0, True),
        (31.0, True),
    ]


def test_without_contents_it_is_not_said_that_nothing_came() -> None:
    trial = kitting_trial()
    bare = replace(trial, submissions=(replace(trial.submissions[0], contents=None),))

    assert sketch_of(bare, {}, {}).brought[0].contents is None


def test_many_curves_share_the_room() -> None:
    t = np.arange(20_000) / 100.0
    draw = np.random.default_rng(7)
    charts = {
        f"check_{i}": [_chart(t, draw.normal(3, 1, len(t)), draw.normal(2, 1, len(t)))] for i in range(60)
    }

    sketch = sketch_of(Trial("made"), charts, {})

    assert len(sketch.curves) == 60
    assert sum(len(curve.t_s) for curve in sketch.curves) < 60 * 40 * 6 + 60 * 2 + 1


@pytest.mark.parametrize(
    ("t", "actual", "limit", "words"),
    [
        ([0.0, 1.0], [1.0], [1.0, 1.0], "different length"),
        ([0.0, 1.0], [1.0, np.inf], [1.0, 1.0], "not finite"),
        ([1.0, 1.0], [1.0, 1.0], [1.0, 1.0], "do not increase"),
    ],
)
def test_a_chart_that_makes_no_sense_is_refused(t: Any, actual: Any, limit: Any, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        _chart(t, actual, limit)


# In a result ---------------------------------------------------------------------------


def test_the_result_holds_each_column_of_the_sketch_on_one_line_and_reads_it_back(tmp_path: Path) -> None:
    result = score_trial(EXAMPLE, "paper2020.published")
    text = as_json(result)
    (tmp_path / "result.json").write_text(text, encoding="utf-8")

    again = load_result(tmp_path / "result.json")

    assert again.measured.sketch == result.measured.sketch
    assert as_json(again) == text
    curves = json.loads(text)["measured"]["sketch"]["curves"]
    _, _, sketched = text.partition('"sketch": {')  # profiles of depth have times as well
    lines = [line for line in sketched.splitlines() if line.strip().startswith('"t_s": [')]
    assert len(lines) == len(curves)
    for curve, line in zip(curves, lines, strict=True):
        assert line.rstrip(",").count(",") == len(curve["t_s"]) - 1


def test_the_curve_of_the_example_is_that_of_its_monitor() -> None:
    sketch = score_trial(EXAMPLE, "paper2020.published").measured.sketch

    assert sketch is not None
    curves = {curve.check: curve for curve in sketch.curves}
    assert set(curves) == {"separation", "human_contact"}
    curve = curves["separation"]
    depth_m = max(b - a for a, b in zip(curve.actual, curve.limit, strict=True) if b is not None)
    # The finding of the example: 0.956 m nearer than the required.
    assert round(depth_m, 3) == 0.956


def test_a_result_of_before_has_no_sketch_and_is_still_read(tmp_path: Path) -> None:
    data = json.loads(as_json(score_trial(EXAMPLE, "paper2020.published")))
    del data["measured"]["sketch"]
    (tmp_path / "old.json").write_text(json.dumps(data), encoding="utf-8")

    assert load_result(tmp_path / "old.json").measured.sketch is None


@pytest.mark.slow
def test_the_sketch_does_not_depend_on_the_order_of_signals(tmp_path: Path) -> None:
    trial = kitting_trial()
    turned: dict[str, Signal] = dict(reversed(trial.signals.items()))

    assert sketch_of(replace(trial, signals=turned), {}, {}) == sketch_of(trial, {}, {})
    log = write_trial_log(tmp_path / "a.jsonl", trial)
    assert as_json(score_trial(log, "paper2020.published")) == as_json(
        score_trial(log, "paper2020.published")
    )


@pytest.mark.parametrize(
    "change",
    [
        lambda curve: curve["t_s"].pop(),
        lambda curve: curve["actual"].__setitem__(0, "1"),
        lambda curve: curve["actual"].__setitem__(0, None),
        lambda curve: curve["limit"].__setitem__(0, float("nan")),
        lambda curve: curve.update(t_s=[], actual=[], limit=[]),
        lambda curve: curve.pop("unit"),
        lambda curve: curve.update(colour="red"),
    ],
)
def test_a_damaged_sketch_is_refused(tmp_path: Path, change: Any) -> None:
    data = json.loads(as_json(score_trial(EXAMPLE, "paper2020.published")))
    change(data["measured"]["sketch"]["curves"][0])
    (tmp_path / "bad.json").write_text(json.dumps(data), encoding="utf-8")

    with pytest.raises(ResultError):
        load_result(tmp_path / "bad.json")
