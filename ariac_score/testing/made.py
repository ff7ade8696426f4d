"""A trial that has everything: every well-known quantity, every kind of order, an official result.

For checking plugins, not for scoring: its signals are independent triangle waves,
except those of the example trial, which it contains.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ariac_score.errors import PluginError
from ariac_score.testing.trials import kitting_trial
from ariac_score.trial.events import ARM_COLLISION, PART_DROPPED, Event
from ariac_score.trial.model import (
    Body,
    OfficialOrder,
    OfficialResult,
    Order,
    Pose,
    Product,
    Submission,
    Task,
    TeamSetup,
    Tray,
    Trial,
    WantedProduct,
    orders_of,
)
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vocabulary import ENVIRONMENT, QUANTITIES, Quantity

__all__ = ["made_trial"]

_WAVES = {"m": (1.5, 1.4), "m/s": (0.6, 0.6), "N": (80.0, 80.0), "Pa": (5e5, 5e5), "m2": (1e-3, 1e-3)}
"""Middle and amplitude of a quantity in this unit; others swing about 0 by 1."""

_EVENTS = (
    Event(6.0, "emergency_stop", "robot"),
    Event(9.0, "emergency_stop_reset", "robot"),
    Event(10.0, "start", "robot"),
    Event(12.0, "pose_attained", "robot"),
    Event(16.0, "protective_stop", "robot"),
    Event(20.0, "pose_attained", "robot"),
    Event(21.0, "quality_check", "ABCD1234"),
    Event(25.0, PART_DROPPED),
    Event(28.0, "pose_attained", "robot"),
    Event(31.0, "part_assembled", "as2", "battery"),
)
_FLAG_PERIODS_S = (10.0, 14.0)
"""Two, so that a flag is also on while another is off."""


def made_trial(*, seed: int = 2020, duration_s: float = 40.0) -> Trial:
    """The example trial with an AGV, every quantity of the vocabulary and every kind of task.

    Args:
        seed: As for `kitting_trial`.
        duration_s: Length of the recording at 100 Hz, s; at least 35.
    """
    example = kitting_trial(seed=seed, duration_s=duration_s)
    bodies = (
        Body("agv1", "agv", radius_m=0.5),
        Body("human", "human", radius_m=0.3),
        Body("robot", "robot", radius_m=0.2, links=("tcp",)),
    )
    orders = (*orders_of(example), *_orders())
    trial = replace(
        example,
        id="made",
        bodies=bodies,
        work=orders,
        submissions=(*example.submissions, *_submissions()),
        events=tuple(sorted((*example.events, *_EVENTS))),
        # Every kind of event it has, so that checks of events are not all inconclusive.
        witnessed=example.witnessed | {"bodies", ARM_COLLISION, *(event.kind for event in _EVENTS)},
        team=TeamSetup("team", {"camera_1": "logical_camera", "beam_1": "break_beam"}, 600.0),
        official=_official(orders),
        facts=_FACTS,
    )
    t = example.signals["position/robot"].t
    made = {name: _made(name, quantity, t, k) for k, (name, quantity) in enumerate(_names(trial))}
    # Signals of the example replace waves of their name: its near miss can be checked by hand.
    return replace(trial, signals=dict(sorted({**made, **example.signals}.items())))


def _usable() -> Iterator[tuple[str, Quantity]]:
    """The quantities, less those whose distributions are broken or contradict each other."""
    for name in QUANTITIES:
        with suppress(PluginError):
            yield name, QUANTITIES[name]


def _names(trial: Trial) -> Iterator[tuple[str, Quantity]]:
    """Every signal that the vocabulary allows for these bodies."""
    for name, quantity in _usable():
        if quantity.of == ENVIRONMENT:
            points: list[str] = [ENVIRONMENT]
        elif quantity.of == "body":
            points = [p for b in trial.bodies for p in (b.id, *(f"{b.id}::{link}" for link in b.links))]
        elif quantity.any_bodies:
            points = [f"{a.id}/{b.id}" for a, b in trial.body_pairs()]
        else:
            points = [f"{robot.id}/{human.id}" for robot, human in trial.pairs()]
        yield from ((f"{name}/{point}", quantity) for point in points)


def _made(name: str, quantity: Quantity, t: FloatArray, k: int) -> Signal:
    """A wave of its own period; flags are on for the first half of theirs."""
    if quantity.unit == "1":
        period_s = _FLAG_PERIODS_S[k % 2]
        return Signal(name, "1", t, (np.mod(t, period_s) < period_s / 2).astype(np.float64))
    middle, amplitude = _WAVES.get(quantity.unit, (0.0, 1.0))
    columns = [middle + amplitude * _triangle(t, 7.0 + k % 13 + c) for c in range(quantity.components)]
    values = columns[0] if quantity.components == 1 else np.stack(columns, axis=1)
    return Signal(name, quantity.unit, t, np.maximum(values, quantity.at_least))


def _triangle(t: FloatArray, period_s: float) -> FloatArray:
    """From 1 to -1 and back; no sine, whose last bits differ between machines."""
    wave: FloatArray = np.abs(np.mod(t, period_s) / period_s * 4.0 - 2.0) - 1.0
    return wave


# Kits on quadrants, assemblies ----------------------------------------------------------

_PLACES = ((-0.1, 0.1), (0.1, 0.1), (-0.1, -0.1), (0.1, -0.1))
_PARTS = ("battery_blue", "pump_purple", "sensor_green", "regulator_orange")
_QUADRANTS = tuple(
    WantedProduct(f"part_{k}", part, Pose((x, y, 0.0)), k + 1, challenged=False)
    for k, (part, (x, y)) in enumerate(zip(_PARTS, _PLACES, strict=True))
)
_INSERTED = (
    WantedProduct("part_0", "battery_red", Pose((-0.15, 0.035, 0.043))),
    WantedProduct("part_1", "pump_blue", Pose((0.14, 0.0, 0.02))),
)
_TRAY = Tray("kit_tray_03", Pose((0.0, 0.0, 0.0)))


def _orders() -> Iterator[Order]:
    yield Order("ABCD1234", (Task("ABCD1234", "kitting", _QUADRANTS, "agv2", "warehouse", _TRAY),), 15.0)
    yield Order("ABCD1235", (Task("ABCD1235", "assembly", _INSERTED, station="as2"),), 16.0)
    yield Order("ABCD1236", (Task("ABCD1236", "combined", _INSERTED, station="as4"),), 17.0, priority=3)


def _submissions() -> Iterator[Submission]:
    # One quadrant stays empty, so that rules about kits have a violation to show.
    kit = tuple(Product(wanted.type, wanted.pose) for wanted in _QUADRANTS[:3])
    assembly = tuple(Product(wanted.type, wanted.pose) for wanted in _INSERTED)
    yield Submission("ABCD1234", 32.0, kit, "agv2", "warehouse", _TRAY)
    yield Submission("ABCD1235", 33.0, assembly, station="as2", tray=Tray("assembly_insert_2"))


# Official record -----------------------------------------------------------------------

# Every name that a shipped check reads, so that its page and its contract are tried with values.
_FACTS = {
    "time_limit_s": 600.0,
    "duration_s": 37.5,
    "num_kits": 2.0,
    "num_modules": 1.0,
    "num_high_priority": 1.0,
    "total_cells": 8.0,
    "defective_cells": 2.0,
    "avg_report_time_s": 1.5,
    "num_reports_submitted": 2.0,
    "num_correct_reports": 2.0,
    "num_correct_report_classifications": 1.0,
    "completed": 1.0,
    "aborted": 0.0,
}


def _official(orders: tuple[Order, ...]) -> OfficialResult:
    submitted_s = {"order_0": 13.5, "order_1": 30.5, "ABCD1234": 31.5, "ABCD1235": 32.5}
    summaries = tuple(
        OfficialOrder(
            order.id,
            order.tasks[0].kind,
            submitted=order.id in submitted_s,
            priority=order.priority > 1,
            score=5.0 if order.id in submitted_s else 0.0,
            max_score=9.0,
            announced_s=1.0,
            submitted_s=submitted_s.get(order.id),
        )
        for order in orders
    )
    scores = {order.id: order.score or 0.0 for order in summaries}
    return OfficialResult(
        "made", 20.0, 37.5, scores, summaries=summaries, items={"was_arm_arm_collision": "1"}
    )
