"""Arithmetic of quaternions w, x, y, z, in plain numbers.

Every sum is added up left to right, as the simulators' maths library does. Not by `sum`, which
rounds differently from Python 3.12 on, nor by numpy, whose dot product may: either could decide a
pose at its limit. `ariac_score.logs.gather.transforms` turns columns of positions by a formula of
its own, for which a product of quaternions would take twice as long.
"""

from __future__ import annotations

import math

__all__ = [
    "Quaternion",
    "Vector",
    "angle",
    "conjugate",
    "from_rpy",
    "inner_product",
    "product",
    "turned",
    "unit",
    "up_axis",
    "yaw",
]

Quaternion = tuple[float, float, float, float]
Vector = tuple[float, float, float]


def from_rpy(rpy_rad: Vector) -> Quaternion:
    """The rotation by roll, pitch, yaw about fixed axes: q = qz(yaw) qy(pitch) qx(roll)."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(a / 2), math.cos(a / 2)) for a in rpy_rad)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


def inner_product(p: Quaternion, q: Quaternion) -> float:
    """The scalar product."""
    a, b, c, d = p
    e, f, g, h = q
    return a * e + b * f + c * g + d * h


def unit(q: Quaternion) -> Quaternion:
    """The same rotation as a quaternion of norm 1."""
    norm = math.sqrt(inner_product(q, q))
    w, x, y, z = q
    return w / norm, x / norm, y / norm, z / norm


def conjugate(q: Quaternion) -> Quaternion:
    """The rotation back, of a quaternion of norm 1."""
    w, x, y, z = q
    return w, -x, -y, -z


def product(p: Quaternion, q: Quaternion) -> Quaternion:
    """The Hamilton product: rotation q, then rotation p."""
    a, b, c, d = p
    e, f, g, h = q
    return (
        a * e - b * f - c * g - d * h,
        a * f + b * e + c * h - d * g,
        a * g - b * h + c * e + d * f,
        a * h + b * g - c * f + d * e,
    )


def turned(vector: Vector, q: Quaternion) -> Vector:
    """A vector after the rotation of a quaternion of norm 1."""
    _, x, y, z = product(product(q, (0.0, *vector)), conjugate(q))
    return x, y, z


def angle(p: Quaternion, q: Quaternion) -> float:
    """The angle of the rotation from one orientation to the other, in rad, 0 to pi, whatever their norms.

    By the arctangent, which keeps small angles that an arccosine near 1 would lose.

    >>> angle((1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, -2.0)) == math.pi
    True
    """
    w, x, y, z = product(conjugate(p), q)
    # abs: q and -q are one rotation, and the shorter way counts.
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))


def up_axis(q: Quaternion) -> Vector:
    """Where the vertical axis points after a rotation."""
    w, x, y, z = unit(q)
    # The third column of the rotation matrix.
    return 2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z


def yaw(q: Quaternion) -> float:
    """The rotation about z as Gazebo's maths library extracts it, in rad."""
    w, x, y, z = unit(q)
    return math.atan2(2 * (x * y + w * z), w * w + x * x - y * y - z * z)
