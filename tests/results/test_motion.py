"""Positions for a replay: near the truth where their number suffices, and never more than that number."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Body, Signal, Span, Trial
from ariac_score.results.codec import plain
from ariac_score.results.motion import places_kept
from ariac_score.results.sketch import MOST_PLACES, NEAR_M, PLACES, sketch_of


def departures(t: np.ndarray, x: np.ndarray, y: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """How far each sample is from a body that moves straight and steadily between the rows, m."""
    return np.hypot(np.interp(t, t[rows], x[rows]) - x, np.interp(t, t[rows], y[rows]) - y)


def moved(signal: np.ndarray, t: np.ndarray, *, window: Span | None = None) -> Trial:
    places = np.stack([signal, np.zeros(len(t)), np.zeros(len(t))], axis=1)
    return Trial(
        "t",
        bodies=(Body("arm", "robot"),),
        signals={"position/arm": Signal("position/arm", "m", t, places)},
        recorded=window or Span(float(t[0]), float(t[-1])),
    )


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=1, max_size=60),
    st.floats(0.001, 1.0),
)
def test_between_the_places_that_are_kept_a_body_is_near_where_it_was(
    places: list[tuple[float, float]], near_m: float
) -> None:
    t = np.arange(float(len(places)))
    x, y = np.array([p[0] for p in places]), np.array([p[1] for p in places])

    rows = places_kept(t, x, y, fixed=(), most=len(places), near_m=near_m)

    assert rows[0] == 0
    assert rows[-1] == len(places) - 1
    assert departures(t, x, y, rows).max() <= near_m * (1 + 1e-9)


@settings(max_examples=30)
@given(st.integers(2, 30), st.integers(0, 2**32 - 1))
def test_there_are_never_more_places_than_may_be_and_fixed_ones_are_among_them(most: int, seed: int) -> None:
    draw = np.random.default_rng(seed)
    t = np.cumsum(draw.uniform(0.01, 1.0, 300))
    x, y = draw.normal(size=300), draw.normal(size=300)
    fixed = sorted(int(row) for row in draw.integers(0, 300, 3))

    rows = places_kept(t, x, y, fixed=fixed, most=most, near_m=0.0)

    assert len(rows) <= max(most, 5)
    assert set(fixed) <= set(rows.tolist())
    assert (np.diff(rows) > 0).all()


def test_the_worst_departure_is_kept_first() -> None:
    x = np.array([0.0, 0.2, 0.0, 5.0, 0.0, 0.1, 0.0])

    rows = places_kept(np.arange(7.0), x, np.zeros(7), fixed=(), most=3, near_m=0.01)

    assert rows.tolist() == [0, 3, 6]


def test_straight_and_steady_motion_needs_its_ends_alone_and_a_standstill_is_seen() -> None:
    t = np.arange(1000.0)
    steady = places_kept(t, t * 0.5, t * 0.25, fixed=(), most=100, near_m=0.01)
    stands = places_kept(t, np.maximum(t - 500, 0), np.zeros(1000), fixed=(), most=100, near_m=0.01)

    assert steady.tolist() == [0, 999]
    assert stands.tolist() == [0, 500, 999]


def test_the_places_of_the_worst_moments_are_exact_however_long_the_trial_is() -> None:
    # Three hours at 100 Hz, a body that trembles so that its places cannot suffice.
    t = np.arange(1_080_000) / 100
    tremble = np.random.default_rng(3).normal(0, 1, len(t)).round(4)
    sketch = sketch_of(moved(tremble, t), {}, {}, instants_s={"arm/ann": [5000.0, 7000.004]})

    (route,) = sketch.routes
    assert len(route.t_s) == MOST_PLACES
    kept = dict(zip(route.t_s, route.x_m, strict=True))
    for row in (500_000, 700_000, 700_001):  # at the moment, or before and after it
        assert kept[t[row]] == tremble[row]


def test_all_bodies_share_the_places() -> None:
    t = np.arange(2000) / 10
    draw = np.random.default_rng(1)
    names = [f"p{i}" for i in range(100)]
    signals = {f"position/{n}": Signal(f"position/{n}", "m", t, draw.normal(size=(len(t), 3))) for n in names}
    trial = Trial(
        "t", bodies=tuple(Body(n, "human") for n in names), signals=signals, recorded=Span(0.0, 200.0)
    )

    routes = sketch_of(trial, {}, {}).routes

    assert len(routes) == 100
    assert sum(len(route.t_s) for route in routes) <= PLACES


@pytest.mark.parametrize(("rise_m", "heights"), [(0.049, ()), (0.051, (1.0, 1.051))])
def test_heights_are_kept_where_a_body_rises_by_more_than_five_centimetres(
    rise_m: float, heights: tuple[float, ...]
) -> None:
    at_m = {"hook": [(0.0, 0.0, 1.0), (8.0, 0.0, 1.0 + rise_m)], "post": [(4.0, 0.0, 0.5), (4.0, 0.0, 0.5)]}
    t = np.array([0.0, 10.0])
    signals = {f"position/{n}": Signal(f"position/{n}", "m", t, np.array(p)) for n, p in at_m.items()}
    bodies = (Body("hook", "robot"), Body("post", "thing"))

    hook, post = sketch_of(Trial("t", bodies=bodies, signals=signals), {}, {}).routes

    assert hook.z_m == heights
    assert post.z_m == ((0.5, 0.5) if heights else ())
    assert ("z_m" in plain(post)) == bool(heights)  # otherwise the bytes are those of earlier versions


@pytest.mark.parametrize(
    ("way_m", "aside_m", "is_kept"), [(0.3, 0.0028, 0), (0.3, 0.0032, 1), (2.0, 0.009, 0)]
)
def test_a_small_scene_is_kept_to_a_hundredth_of_it(way_m: float, aside_m: float, is_kept: int) -> None:
    t = np.array([0.0, 1.0, 2.0])
    places = np.array([(0.0, 0.0, 0.0), (way_m / 2, aside_m, 0.0), (way_m, 0.0, 0.0)])
    signals = {"position/arm": Signal("position/arm", "m", t, places)}

    (route,) = sketch_of(Trial("t", bodies=(Body("arm", "robot"),), signals=signals), {}, {}).routes

    assert len(route.t_s) == 2 + is_kept


@pytest.mark.parametrize("count", [1, 2, 3])
def test_few_samples_are_kept_as_they_are(count: int) -> None:
    x = np.array([0.0, 7.0, 1.0])[:count]

    rows = places_kept(np.arange(float(count)), x, np.zeros(count), fixed=(), most=10, near_m=NEAR_M)

    assert rows.tolist() == list(range(count))


def test_a_hole_is_kept_with_both_its_ends() -> None:
    t = np.concatenate([np.arange(0, 10, 0.1), np.arange(20, 30, 0.1)])

    (route,) = sketch_of(moved(np.zeros(len(t)), t), {}, {}).routes

    assert route.holes_s == (9.9,)
    assert {9.9, 20.0} <= set(route.t_s)
