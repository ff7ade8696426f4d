"""A sketch as JSON, and back: arrays of numbers, each checked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from decimal import Decimal
from typing import Any

from ariac_score.results.sketch import AskedPart, AskedTask, Brought, Curve, Route, Sketch

__all__ = ["sketch_data", "sketch_from"]


def sketch_data(sketch: Sketch) -> dict[str, Any]:
    """A sketch as what JSON can say."""
    return {
        "curves": [
            {
                "check": c.check,
                "subject": c.subject,
                "what": c.what,
                "unit": c.unit,
                "at_most": c.at_most,
                "samples": c.samples,
                "t_s": list(c.t_s),
                "actual": list(c.actual),
                "limit": list(c.limit),
                "holes_s": list(c.holes_s),
            }
            for c in sketch.curves
        ],
        "routes": [
            {
                "body": r.body,
                "kind": r.kind,
                "t_s": list(r.t_s),
                "x_m": list(r.x_m),
                "y_m": list(r.y_m),
                "holes_s": list(r.holes_s),
            }
            for r in sketch.routes
        ],
        "asked": [
            {
                "order": a.order,
                "task": a.task,
                "kind": a.kind,
                "agv": a.agv,
                "station": a.station,
                "parts": [{"slot": p.slot, "type": p.type, "quadrant": p.quadrant} for p in a.parts],
            }
            for a in sketch.asked
        ],
        "brought": [
            {
                "task": b.task,
                "submitted_s": b.submitted_s,
                "agv": b.agv,
                "station": b.station,
                "parts": None if b.parts is None else list(b.parts),
            }
            for b in sketch.brought
        ],
    }


def sketch_from(data: Mapping[str, Any]) -> Sketch:
    """The sketch that a file holds.

    Raises:
        ValueError: A number is none, or columns differ in length.
    """
    return Sketch(
        curves=tuple(_curve(curve) for curve in data["curves"]),
        routes=tuple(_route(route) for route in data["routes"]),
        asked=tuple(
            AskedTask(
                a["order"],
                a["task"],
                a["kind"],
                a["agv"],
                a["station"],
                tuple(AskedPart(p["slot"], p["type"], p["quadrant"]) for p in a["parts"]),
            )
            for a in data["asked"]
        ),
        brought=tuple(
            Brought(
                b["task"],
                _numbers([b["submitted_s"]])[0],
                b["agv"],
                b["station"],
                None if b["parts"] is None else tuple(b["parts"]),
            )
            for b in data["brought"]
        ),
    )


def _curve(data: Mapping[str, Any]) -> Curve:
    limited = iter(_numbers([v for v in data["limit"] if v is not None]))
    limit = tuple(None if v is None else next(limited) for v in data["limit"])
    t_s, actual = _numbers(data["t_s"]), _numbers(data["actual"])
    _same_length(t_s, actual, limit)
    return Curve(
        data["check"],
        data["subject"],
        data["what"],
        data["unit"],
        data["at_most"],
        data["samples"],
        t_s,
        actual,
        limit,
        _numbers(data["holes_s"]),
    )


def _route(data: Mapping[str, Any]) -> Route:
    t_s, x_m, y_m = (_numbers(data[name]) for name in ("t_s", "x_m", "y_m"))
    _same_length(t_s, x_m, y_m)
    return Route(data["body"], data["kind"], t_s, x_m, y_m, _numbers(data["holes_s"]))


def _same_length(*columns: Sequence[object]) -> None:
    if len({len(column) for column in columns}) > 1 or not columns[0]:
        raise ValueError("a series of the sketch has columns of different length, or none")


def _numbers(values: Sequence[Any]) -> tuple[float, ...]:
    if not {*map(type, values)} <= {int, float, Decimal}:
        raise ValueError("a series of the sketch holds something that is no number")
    numbers = tuple(map(float, values))
    if not all(map(math.isfinite, numbers)):
        raise ValueError("a series of the sketch holds a number that is not finite")
    return numbers
