"""Quaternions, against rotation matrices computed by numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from ariac_score.trial import quaternions
from ariac_score.trial.quaternions import Quaternion

PARTS = st.floats(-1, 1)
ROTATIONS = st.tuples(PARTS, PARTS, PARTS, PARTS).filter(lambda q: math.hypot(*q) > 0.1)
ANGLES = st.tuples(*[st.floats(-math.pi, math.pi)] * 3)


def matrix(q: Quaternion) -> NDArray[np.float64]:
    """The rotation as q v q*, written out as sums of squares (Hamilton's convention, any norm)."""
    w, v = q[0], np.array(q[1:])
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    turned = (w * w - v @ v) * np.eye(3) + 2 * np.outer(v, v) + 2 * w * cross
    return turned / (w * w + v @ v)


def about(axis: int, angle_rad: float) -> NDArray[np.float64]:
    s, c = math.sin(angle_rad), math.cos(angle_rad)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    turned = np.eye(3)
    turned[i, i] = turned[j, j] = c
    turned[i, j], turned[j, i] = -s, s
    return turned


@given(ROTATIONS, ROTATIONS)
def test_a_product_is_one_rotation_after_the_other(p: Quaternion, q: Quaternion) -> None:
    assert matrix(quaternions.product(p, q)) == pytest.approx(matrix(p) @ matrix(q), abs=1e-9)


@given(ROTATIONS, st.tuples(PARTS, PARTS, PARTS))
def test_a_vector_is_turned_as_by_the_matrix_and_back(q: Quaternion, v: tuple[float, float, float]) -> None:
    there = quaternions.turned(v, quaternions.unit(q))

    assert there == pytest.approx(matrix(q) @ np.array(v), abs=1e-9)
    assert quaternions.turned(there, quaternions.conjugate(quaternions.unit(q))) == pytest.approx(v, abs=1e-9)


@given(ANGLES)
def test_roll_pitch_and_yaw_turn_about_fixed_axes(rpy_rad: tuple[float, float, float]) -> None:
    roll, pitch, yaw = rpy_rad
    expected = about(2, yaw) @ about(1, pitch) @ about(0, roll)

    assert matrix(quaternions.from_rpy(rpy_rad)) == pytest.approx(expected, abs=1e-9)


@given(ROTATIONS)
def test_the_vertical_axis_and_yaw_are_those_of_the_matrix(q: Quaternion) -> None:
    turned = matrix(q)

    assert quaternions.up_axis(q) == pytest.approx(turned[:, 2], abs=1e-9)
    assume(math.hypot(turned[0, 0], turned[1, 0]) > 1e-3)  # upright: any yaw is as good
    assert quaternions.yaw(q) == pytest.approx(math.atan2(turned[1, 0], turned[0, 0]), abs=1e-9)


@given(ROTATIONS, ROTATIONS)
def test_the_angle_is_that_of_the_trace_and_signs_do_not_matter(p: Quaternion, q: Quaternion) -> None:
    trace = float(np.trace(matrix(p).T @ matrix(q)))
    expected = math.acos(min(1.0, max(-1.0, (trace - 1) / 2)))
    w, x, y, z = q

    assert quaternions.angle(p, q) == pytest.approx(expected, abs=1e-6)
    assert quaternions.angle(p, (-w, -x, -y, -z)) == quaternions.angle(p, q)
