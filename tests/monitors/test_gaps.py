"""What can have been between two samples: worked cases, and paths that nothing may lead outside."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ariac_score.monitors.cells import Stream
from ariac_score.monitors.gaps import (
    Drive,
    Place,
    between,
    distance_to_lens,
    highest_speed,
    off_the_chord,
    places_apart,
)
from ariac_score.trial.bounds import BetweenSamples
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import Span


def test_least_and_most_distance_of_the_worked_cases(subtests: pytest.Subtests) -> None:
    for case, before, after, gap_s, rate, least, most in (
        ("G1", 2, 2, 1, 1.6, 1.2, 2.8),
        ("G2", 3, 2, 2, 2, 0.5, 4.5),
        ("G3", 1, 1, 2, 1.5, 0.0, 2.5),
        ("G9", 1.2, 1.2, 0.3, 1, 1.05, 1.35),
    ):
        with subtests.test(case):
            since = np.linspace(0.0, gap_s, 100_001)
            low, high = between(before, after, since, gap_s - since, rate)
            assert (low.min(), high.max()) == (pytest.approx(least, abs=1e-4), pytest.approx(most, abs=1e-4))
    with subtests.test("G18, nearest of two humans"):
        since = np.linspace(0.0, 1.0, 1001)
        ends = [between(first, last, since, since[::-1], 1.6) for first, last in ((3.0, 3.0), (2.0, 2.5))]
        nearest = [np.min([both[end] for both in ends], axis=0) for end in (0, 1)]
        assert (nearest[0].min(), nearest[1].max()) == (
            pytest.approx(1.45, abs=1e-3),
            pytest.approx(3.05, abs=2e-3),
        )


def test_acceleration_and_speeds_have_the_worked_bounds(subtests: pytest.Subtests) -> None:
    with subtests.test("G10, the required distance grows with the speeds"):
        d_min = (1.6 * 0.4 + 1.0 * 0.1 + 0.3, 0.3)
        for gap_s, margins in ((0.5, (0.31, 2.35)), (1.0, (-0.34, 3.0))):
            low, high = between(2.0, 2.0, gap_s / 2, gap_s / 2, 2.6)
            assert (float(low) - d_min[0], float(high) - d_min[1]) == pytest.approx(margins)
        assert (2 + 2 - 2 * d_min[0]) / 2.6 == pytest.approx(0.738462, abs=1e-6)
    with subtests.test("G11"):
        since = np.linspace(0.0, 0.4, 4001)
        fastest = highest_speed(0.2, 0.3, since, 0.4 - since, speed=1.0, acceleration=2.0)
        assert fastest.max() == pytest.approx(0.65)
    with subtests.test("G12"):
        assert off_the_chord(np.linspace(0, 1, 101), np.linspace(1, 0, 101), 2.0).max() == 0.25


def test_speed_and_acceleration_together_have_the_worked_bounds(subtests: pytest.Subtests) -> None:
    """G12 to G15, of 2 m before and after."""
    for case, gap_s, fastest_m_s, change_m_s2, at_ends_m_s, least_m in (
        ("G12, an acceleration, and any speed at both ends", 1.0, 1e3, 2.0, 1e3, 1.75),
        ("G13, at rest at both ends", 1.0, 1e3, 2.0, 0.0, 1.875),
        ("G14, the same, and a top speed", 2.0, 0.5, 4.0, 0.0, 1.5625),
        ("G15, a top speed, and any speed at both ends", 2.0, 0.5, 1.0, 0.5, 1.625),
    ):
        with subtests.test(case):
            since = np.arange(1, 202, dtype=np.float64) * (gap_s / 202)
            ends = np.full(len(since), at_ends_m_s)
            drive = Drive(since, gap_s - since, fastest_m_s, change_m_s2, ends, ends)
            two = np.full(len(since), 2.0)
            assert drive.least(two, two).min() == pytest.approx(least_m, abs=1e-6)
            assert drive.off_the_chord().max() == pytest.approx(2.0 - least_m, abs=1e-6)


def test_no_drive_along_a_line_leaves_its_bounds() -> None:
    random, fastest_m_s, steps = np.random.default_rng(15), 1.0, 60
    for _ in range(12):
        change, step_s = 10.0 ** random.uniform(-0.3, 1.3), random.uniform(0.002, 0.04)
        speeds, push = [random.uniform(-fastest_m_s, fastest_m_s)], 0.0
        for _ in range(steps):
            push = float(random.choice([-change, 0.0, change])) if random.random() < 0.1 else push
            speeds.append(float(np.clip(speeds[-1] + push * step_s, -fastest_m_s, fastest_m_s)))
        v = np.array(speeds)
        x = np.concatenate([[0.0], np.cumsum((v[1:] + v[:-1]) / 2.0 * step_s)])
        since = np.arange(1, steps) * step_s
        one = np.ones(steps - 1)
        chord = x[-1] * since / (steps * step_s)
        for first, last in ((fastest_m_s, fastest_m_s), (abs(v[0]), abs(v[-1]))):
            drive = Drive(since, since[::-1], fastest_m_s, change, first * one, last * one)
            assert (drive.least(x[0] * one, x[-1] * one) <= x[1:-1] + 1e-9).all()
            assert (np.abs(x[1:-1] - chord) <= drive.off_the_chord() + 1e-9).all()


def test_a_place_bounds_a_distance_at_least_as_well_as_the_distance_alone(subtests: pytest.Subtests) -> None:
    def apart(before: Any, after: Any, robot: Any, way_m: float) -> float:
        since = np.linspace(0.0, way_m, 2001)
        rows = np.ones((len(since), 1))
        fixed = Place(rows * robot, rows * robot, np.zeros(len(since)), np.zeros(len(since)))
        low, _ = places_apart(Place(rows * before, rows * after, since, way_m - since), fixed)
        return float(low.min())

    with subtests.test("G16: 1.105551 by the distance alone"):
        assert apart([[0.0, 0.0]], [[4.0, 0.0]], [[2.0, 3.0]], 5.0) == pytest.approx(1.5, abs=1e-6)
    with subtests.test("G17: no freedom, so the place itself"):
        assert apart([[0.0, 0.0]], [[2.0, 0.0]], [[1.0, 1.0]], 2.0) == pytest.approx(1.0, abs=1e-4)


def test_no_walk_through_the_samples_is_anywhere_but_where_the_bounds_say() -> None:
    """Random walks of two bodies at their greatest speeds at most, seen at both ends of a gap alone."""
    random = np.random.default_rng(20)
    human_m_s, robot_m_s, step_s = 1.6, 1.0, 0.01
    for _ in range(200):
        steps = int(random.integers(2, 60))
        tracks = []
        for fastest in (human_m_s, robot_m_s):
            way = random.normal(size=(steps, 2))
            way /= np.linalg.norm(way, axis=1)[:, None]
            way *= fastest * step_s * random.random((steps, 1)) ** 0.2
            tracks.append(random.normal(size=2) + np.concatenate([np.zeros((1, 2)), way.cumsum(0)]))
        human, robot = tracks
        distance = np.linalg.norm(human - robot, axis=1)
        since = np.arange(steps + 1, dtype=np.float64) * step_s
        until = since[::-1]
        low, high = between(distance[0], distance[-1], since, until, human_m_s + robot_m_s)
        ends = [
            Place(np.tile(one[0], (steps + 1, 1)), np.tile(one[-1], (steps + 1, 1)), top * since, top * until)
            for one, top in ((human, human_m_s), (robot, robot_m_s))
        ]
        near, far = places_apart(ends[0], ends[1])

        assert (low - 1e-9 <= distance).all()
        assert (distance <= high + 1e-9).all()
        assert (near - 1e-9 <= distance).all()
        assert (distance <= far + 1e-9).all()
        assert (low - 1e-9 <= near).all()
        assert (far <= high + (human_m_s + robot_m_s) * since[-1]).all()


def test_the_distance_to_a_lens_is_that_of_the_nearest_of_its_points() -> None:
    """Against points drawn in it: none is nearer, and one is nearly as near."""
    random = np.random.default_rng(7)
    for _ in range(20):
        first, second, point = random.normal(size=2), random.normal(size=2), random.normal(scale=3, size=2)
        apart = float(np.linalg.norm(first - second))
        radii = apart * (0.55 + random.random(2))
        drawn = first + (2 * random.random((40_000, 2)) - 1) * radii[0]
        inside = (np.linalg.norm(drawn - first, axis=1) <= radii[0]) & (
            np.linalg.norm(drawn - second, axis=1) <= radii[1]
        )
        nearest = np.linalg.norm(drawn[inside] - point, axis=1).min()
        given = (point, first, radii[:1], second, radii[1:])

        found = float(distance_to_lens(*(np.atleast_2d(v) if v.size == 2 else v for v in given))[0])

        assert found <= nearest + 1e-12
        assert found == pytest.approx(nearest, abs=0.1)


@pytest.mark.parametrize(("first_s", "is_open"), [(0.0, False), (0.02, True)])
def test_whoever_leaves_out_the_first_sample_leaves_a_gap(first_s: float, is_open: bool) -> None:
    """No sample stands for the time before the first, though it is no longer than any other interval."""
    t = np.arange(first_s, 1.01, 0.02)
    stream = Stream.of(Signal("separation/arm/ann", "m", t, t), Span(0.0, 1.0), 0.05, BetweenSamples())
    assert bool(stream.open[0]) is is_open
    assert not stream.open[1:].any()


@pytest.mark.parametrize(
    ("last_s", "ended", "is_open"), [(1.0, True, False), (0.98, True, True), (0.98, False, False)]
)
def test_whoever_leaves_out_the_last_sample_before_a_stated_end_leaves_a_gap(
    last_s: float, ended: bool, is_open: bool
) -> None:
    """A recording that is the competition as far as anybody knows ends with its last sample."""
    t = np.arange(0.0, last_s + 0.01, 0.02)
    signal = Signal("separation/arm/ann", "m", t, t)
    stream = Stream.of(signal, Span(0.0, 1.0), 0.05, BetweenSamples(), ended=ended)
    assert bool(stream.open[-1]) is is_open
    assert not stream.open[:-1].any()


def test_leaving_out_a_sample_never_narrows_what_an_acceleration_bounds() -> None:
    """The ball around the way of a longer gap contains those of its two parts, whatever lay between.

    By hand: the ways differ by at most A t (g2 - g1) / 2, which is what the radius A t (g - t) / 2 grows by.
    """
    random = np.random.default_rng(3)
    for _ in range(200):
        acceleration = random.uniform(0.1, 5.0)
        first_s, whole_s = np.sort(random.uniform(0.1, 2.0, size=2))
        end_m = random.uniform(-2.0, 2.0)
        # Any place between that the acceleration allows, its limits included.
        off = random.choice([-1.0, random.uniform(-1.0, 1.0), 1.0])
        way = end_m * first_s / whole_s
        between_m = way + off * float(off_the_chord(first_s, whole_s - first_s, acceleration))
        t = np.linspace(0.0, first_s, 20)
        centre, radius = between_m * t / first_s, off_the_chord(t, first_s - t, acceleration)
        longer, longer_m = end_m * t / whole_s, off_the_chord(t, whole_s - t, acceleration)
        assert np.all(np.abs(centre - longer) + radius <= longer_m + 1e-12)
