"""What can have been between two samples: worked cases, and paths that nothing may lead outside."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ariac_score.monitors.gaps import (
    Place,
    between,
    distance_to_lens,
    highest_speed,
    off_the_chord,
    places_apart,
)


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
