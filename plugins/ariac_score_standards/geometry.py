"""Zones on the floor: polygons checked when they are given, and where points lie in them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ariac_score import FloatArray
from ariac_score.monitors import BoolArray

Polygon = tuple[tuple[float, ...], ...]
"""Corners in order, each (x, y) in m; the last is joined to the first."""


def check_polygon(name: str, polygon: Polygon) -> None:
    """Refuse what is no polygon. No corners at all mean that none is given.

    Raises:
        ValueError: Naming the parameter, and what is wrong with it.
    """
    if not polygon:
        return
    if len(polygon) < 3:
        raise ValueError(f"{name} is not a polygon: it has {len(polygon)} corners and needs 3")
    for number, corner in enumerate(polygon):
        if len(corner) != 2 or not all(np.isfinite(corner)):
            raise ValueError(f"{name} is not a polygon: corner {number} is {list(corner)!r}, not [x, y] in m")
    corners = [(corner[0], corner[1]) for corner in polygon]
    edges = [(a, corners[(i + 1) % len(corners)]) for i, a in enumerate(corners)]
    if any(a == b for a, b in edges):
        raise ValueError(f"{name} is not a polygon: a corner is given twice in a row")
    for i, first in enumerate(edges):
        for j in range(i + 2, len(edges)):
            if (i, j) != (0, len(edges) - 1) and _cross(*first, *edges[j]):
                raise ValueError(f"{name} is not a polygon: edges {i} and {j} cross")
    if _doubled_area(corners) == 0:
        raise ValueError(f"{name} is not a polygon: it has no area")


_Point = tuple[float, float]


def _doubled_area(corners: Sequence[_Point]) -> float:
    total = 0.0
    for (x1, y1), (x2, y2) in zip(corners, [*corners[1:], corners[0]], strict=True):
        total += x1 * y2 - x2 * y1
    return total


def _turn(a: _Point, b: _Point, c: _Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _cross(a: _Point, b: _Point, c: _Point, d: _Point) -> bool:
    """Whether two segments share a point."""
    turns = _turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)  # signs: which side of a line
    if turns[0] * turns[1] < 0 and turns[2] * turns[3] < 0:
        return True
    ends = ((turns[0], a, b, c), (turns[1], a, b, d), (turns[2], c, d, a), (turns[3], c, d, b))
    return any(turn == 0 and _between(p, q, x) for turn, p, q, x in ends)


def _between(p: _Point, q: _Point, x: _Point) -> bool:
    return min(p[0], q[0]) <= x[0] <= max(p[0], q[0]) and min(p[1], q[1]) <= x[1] <= max(p[1], q[1])


def _edges(polygon: Polygon) -> list[tuple[FloatArray, FloatArray]]:
    corners = [np.asarray(corner[:2], dtype=np.float64) for corner in polygon]
    return list(zip(corners, [*corners[1:], corners[0]], strict=True))


def distance_to_segment_m(points_m: FloatArray, a: FloatArray, b: FloatArray) -> FloatArray:
    """Distance of each point, shape (n, 2), to a segment, m."""
    along = b - a
    length2 = float(along[0] * along[0] + along[1] * along[1])
    offset = points_m[:, :2] - a
    share = np.zeros(len(points_m))
    if length2 > 0:
        share = np.clip((offset[:, 0] * along[0] + offset[:, 1] * along[1]) / length2, 0.0, 1.0)
    away = offset - share[:, None] * along
    return np.sqrt(away[:, 0] * away[:, 0] + away[:, 1] * away[:, 1])


def depth_inside_m(points_m: FloatArray, polygon: Polygon) -> FloatArray:
    """How deep each point, shape (n, 2 or 3), lies in a polygon; negative: how far outside, m.

    >>> square = ((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))
    >>> depth_inside_m(np.array([[1.0, 1.5], [3.0, 1.0], [2.0, 1.0]]), square).tolist()
    [0.5, -1.0, 0.0]
    """
    nearest = np.full(len(points_m), np.inf)
    odd = np.zeros(len(points_m), dtype=bool)
    x, y = points_m[:, 0], points_m[:, 1]
    for a, b in _edges(polygon):
        np.minimum(nearest, distance_to_segment_m(points_m, a, b), out=nearest)
        if a[1] != b[1]:
            # Half open: a ray through a corner crosses one of its two edges, not both or neither.
            between = (a[1] > y) != (b[1] > y)
            odd ^= between & (x < (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1]) + a[0])
    # On the edge itself the crossings may count either way; and -0.0 would print as "-0".
    return np.where(odd, nearest, np.where(nearest == 0, 0.0, -nearest))


def inside(points_m: FloatArray, polygon: Polygon) -> BoolArray:
    """Whether each point, shape (n, 2 or 3), lies in a polygon; its edge belongs to it."""
    result: BoolArray = depth_inside_m(points_m, polygon) >= 0
    return result


def distance_between_m(a: FloatArray, b: FloatArray, polygon: Polygon) -> float:
    """Smallest distance between a segment and a polygon, m; 0 where they touch or overlap."""
    ends = np.stack([a, b])
    if inside(ends, polygon).any():
        return 0.0
    (ax, ay), (bx, by) = a.tolist(), b.tolist()
    edges = _edges(polygon)
    if any(_cross((ax, ay), (bx, by), (c[0], c[1]), (d[0], d[1])) for c, d in edges):
        return 0.0
    corners = np.array([corner[:2] for corner in polygon])
    to_edges = [float(distance_to_segment_m(ends, c, d).min()) for c, d in edges]
    return min([float(distance_to_segment_m(corners, a, b).min()), *to_edges])
