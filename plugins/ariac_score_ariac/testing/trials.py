"""Trials of ARIAC made to order: kits with flaws that can be checked by hand, and every kind of order."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from dataclasses import replace

from ariac_score import ORDER_ANNOUNCED, Event, OfficialOrder, OfficialResult, Pose, Record, TeamSetup, Trial
from ariac_score.testing import made_trial as plain_trial
from ariac_score.testing import near_miss_trial
from ariac_score_ariac.work import (
    KitSubmission,
    Order,
    Product,
    SensorBill,
    Task,
    Tray,
    WantedProduct,
)

__all__ = ["kitting_trial", "made_trial"]


def kitting_trial(*, seed: int = 2020, duration_s: float = 40.0, human: bool = True) -> Trial:
    """A trial with two orders, one wrong colour, one pose just outside, one near miss of 2.4 s.

    Everything else is right; parts lie up to 5 mm from their places, by `seed`.

    Args:
        seed: Same seed, same trial, on every machine.
        duration_s: Length of the recording at 100 Hz, s; at least 35.
        human: Whether the human's signals are recorded.
    """
    jitter = random.Random(seed)  # noqa: S311  # no secret depends on where a part lies
    orders = tuple(_kit_orders())
    trial = near_miss_trial(duration_s=duration_s, human=human)
    return replace(
        trial,
        id="kitting_near_miss",
        work=orders,
        submissions=tuple(_kit_submissions(jitter)),
        events=tuple(sorted([*trial.events, *_announcements(orders)])),
    )


def made_trial(*, seed: int = 2020, duration_s: float = 40.0) -> Trial:
    """The trial that has everything, with every kind of order and task, and its official result.

    Args:
        seed: As for `kitting_trial`.
        duration_s: Length of the recording at 100 Hz, s; at least 35.
    """
    plain, kits = (
        plain_trial(duration_s=duration_s, kinds=("agv",)),
        kitting_trial(seed=seed, duration_s=duration_s),
    )
    orders = (*(order for order in kits.work if isinstance(order, Order)), *_orders())
    events = [event for event in plain.events if event.kind != ORDER_ANNOUNCED]
    sensors = {"camera_1": "logical_camera", "beam_1": "break_beam"}
    bill: tuple[Record, ...] = (SensorBill(600.0, sensors),)
    return replace(
        plain,
        work=orders,
        submissions=(*kits.submissions, *_submissions()),
        events=tuple(sorted([*events, *_announcements(orders[:2])])),
        team=TeamSetup("team", sensors),
        official=_official(orders),
        facts={**plain.facts, **_FACTS},
        records=bill,
    )


def _announcements(orders: tuple[Order, ...]) -> Iterator[Event]:
    for order in orders:
        if order.announced_s is not None:
            yield Event(order.announced_s, ORDER_ANNOUNCED, order.id)


def _wanted(*parts: tuple[str, float, float, float]) -> tuple[WantedProduct, ...]:
    return tuple(
        WantedProduct(f"part_{i}", kind, Pose.from_rpy((x, y, 0.0), (0.0, 0.0, yaw)))
        for i, (kind, x, y, yaw) in enumerate(parts)
    )


_KITS = {
    "order_0": _wanted(
        ("gear_part_red", 0.1, 0.15, 0.0),
        ("gear_part_blue", -0.1, 0.15, math.pi / 4),
        ("piston_rod_part_green", 0.0, -0.15, 0.0),
    ),
    "order_1": _wanted(("pulley_part_red", 0.12, 0.1, 0.0), ("disk_part_blue", -0.12, -0.1, -math.pi / 2)),
}
_ANNOUNCED_S = {"order_0": 1.0, "order_1": 8.0}
_SUBMITTED_S = {"order_0": 14.0, "order_1": 31.0}
_AGV = {"order_0": "agv1", "order_1": "agv2"}


def _kit_orders() -> Iterator[Order]:
    for order, products in _KITS.items():
        task = Task(f"{order}_shipment_0", products=products, agv=_AGV[order])
        yield Order(order, (task,), _ANNOUNCED_S[order])


def _kit_submissions(jitter: random.Random) -> Iterator[KitSubmission]:
    for order, products in _KITS.items():
        contents = tuple(_delivered(order, wanted, jitter) for wanted in products)
        yield KitSubmission(f"{order}_shipment_0", _SUBMITTED_S[order], contents, _AGV[order])


def _delivered(order: str, wanted: WantedProduct, jitter: random.Random) -> Product:
    """The product as delivered: one of the two flaws, or a few millimetres off its place."""
    assert wanted.pose is not None
    kind = "gear_part_green" if (order, wanted.slot) == ("order_0", "part_1") else wanted.type
    dx, dy = 0.005 * jitter.random(), 0.003 * jitter.random()
    if (order, wanted.slot) == ("order_1", "part_1"):
        dx, dy = 0.031, 0.0  # the limit of the rule set is 0.03 m
    x, y, z = wanted.pose.position_m
    return Product(kind, Pose((x + dx, y + dy, z), wanted.pose.orientation_wxyz), name=f"{kind}_1")


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


def _submissions() -> Iterator[KitSubmission]:
    # One quadrant stays empty, so that rules about kits have a violation to show.
    kit = tuple(Product(wanted.type, wanted.pose) for wanted in _QUADRANTS[:3])
    assembly = tuple(Product(wanted.type, wanted.pose) for wanted in _INSERTED)
    yield KitSubmission("ABCD1234", 32.0, kit, "agv2", "warehouse", _TRAY)
    yield KitSubmission("ABCD1235", 33.0, assembly, station="as2", tray=Tray("assembly_insert_2"))


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
