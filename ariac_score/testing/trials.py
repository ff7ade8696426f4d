"""Trials made to order: a kitting trial with known flaws, and its record in every log format."""

from __future__ import annotations

import json
import math
import random
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from ariac_score.logs.jsonl import FORMAT
from ariac_score.logs.own_messages import NO_TRAY
from ariac_score.testing.bags import Recorded
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.clock import LOG_TIME, Clock
from ariac_score.trial.events import ARM_COLLISION, COMPETITION_ENDED, COMPETITION_STARTED, WATCHING, Event
from ariac_score.trial.model import (
    Body,
    Order,
    Pose,
    Product,
    Submission,
    Task,
    Trial,
    WantedProduct,
)
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray

__all__ = [
    "NEAR_MISS",
    "SNAPSHOT_SIGNALS",
    "NearMiss",
    "kitting_trial",
    "recorded_messages",
    "write_trial_log",
]

ORIGIN_NS = 1_700_000_000_000_000_000
STEP_NS = 10_000_000


@dataclass(frozen=True)
class NearMiss:
    """The approach built into the example, in numbers that can be checked by hand.

    Human and robot move side by side at `robot_speed_m_s`; around `worst_s` the human
    comes nearer at `closing_m_s` and leaves again, for `lasts_s` within what the
    paper's formula requires.
    """

    worst_s: float = 20.005
    lasts_s: float = 2.4
    closing_m_s: float = 0.8
    robot_speed_m_s: float = 0.5
    approach_lasts_s: float = 8.0

    @property
    def human_speed_m_s(self) -> float:
        """Scalar speed of the human while nearing and leaving, m/s."""
        return math.hypot(self.robot_speed_m_s, self.closing_m_s)

    @property
    def required_m(self) -> float:
        """What the paper's formula requires meanwhile, m."""
        return self.human_speed_m_s * (1.0 + 1.5) + self.robot_speed_m_s * 1.0 + 0.0 + 2.6

    @property
    def closest_m(self) -> float:
        """Distance at the turning point, m."""
        return self.required_m - self.closing_m_s * self.lasts_s / 2


NEAR_MISS = NearMiss()

SNAPSHOT_SIGNALS = ("centre_distance/robot/human", "speed/human", "speed/robot")
"""What the paper's snapshot message carries."""


def kitting_trial(*, seed: int = 2020, duration_s: float = 40.0, human: bool = True) -> Trial:
    """A trial with two orders, one wrong colour, one pose just outside, one near miss of 2.4 s.

    Everything else is right; parts lie up to 5 mm from their places, by `seed`.

    Args:
        seed: Same seed, same trial, on every machine.
        duration_s: Length of the recording at 100 Hz, s; at least 35.
        human: Whether the human's signals are recorded.
    """
    builder = TrialBuilder("kitting_near_miss", file="made", clock=Clock(LOG_TIME, ORIGIN_NS))
    builder.witnessed |= {"submissions", ARM_COLLISION}
    jitter = random.Random(seed)  # noqa: S311  # no secret hangs on where a part lies
    items: list[Order | Submission | Event] = [*_events(duration_s), *_orders(), *_submissions(jitter)]
    for item in items:
        builder.add(item)
    builder.add_body(Body("robot", "robot"))
    steps = round(duration_s * 1e9) // STEP_NS + 1
    t = np.array([k * STEP_NS / 1e9 for k in range(steps)])
    signals = _motion(t)
    if human:
        builder.add_body(Body("human", "human"))
    for name in sorted(signals):
        if human or "human" not in name:
            builder.add_signal(name, "m/s" if name.startswith("speed/") else "m", t, signals[name])
    return builder.build()


def _events(duration_s: float) -> Iterator[Event]:
    yield Event(0.5, COMPETITION_STARTED)
    yield Event(duration_s - 2.0, COMPETITION_ENDED)


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


def _orders() -> Iterator[Order]:
    for order, products in _KITS.items():
        task = Task(f"{order}_shipment_0", products=products, agv=_AGV[order])
        yield Order(order, (task,), _ANNOUNCED_S[order])


def _submissions(jitter: random.Random) -> Iterator[Submission]:
    for order, products in _KITS.items():
        contents = tuple(_delivered(order, wanted, jitter) for wanted in products)
        yield Submission(f"{order}_shipment_0", _SUBMITTED_S[order], contents, _AGV[order])


def _delivered(order: str, wanted: WantedProduct, jitter: random.Random) -> Product:
    """The product as delivered: the two flaws, or a few millimetres beside its place."""
    assert wanted.pose is not None
    kind = "gear_part_green" if (order, wanted.slot) == ("order_0", "part_1") else wanted.type
    dx, dy = 0.005 * jitter.random(), 0.003 * jitter.random()
    if (order, wanted.slot) == ("order_1", "part_1"):
        dx, dy = 0.031, 0.0  # the limit is 0.03 m
    x, y, z = wanted.pose.position_m
    return Product(kind, Pose((x + dx, y + dy, z), wanted.pose.orientation_wxyz), name=f"{kind}_1")


def _motion(t: FloatArray) -> dict[str, FloatArray]:
    """Positions, and what the paper's snapshot node would publish of them."""
    miss = NEAR_MISS
    turn_s = 12.0
    phase = np.mod(t, 2 * turn_s)
    robot_x = miss.robot_speed_m_s * np.where(phase < turn_s, phase, 2 * turn_s - phase) - 3.0
    away_s = np.minimum(np.abs(t - miss.worst_s), miss.approach_lasts_s / 2)
    distance = miss.closest_m + miss.closing_m_s * away_s
    closing = np.abs(t - miss.worst_s) < miss.approach_lasts_s / 2
    still = np.zeros_like(t)
    return {
        "position/robot": np.stack([robot_x, still, still], axis=1),
        "position/human": np.stack([robot_x, distance, still], axis=1),
        "speed/robot": np.full_like(t, miss.robot_speed_m_s),
        "speed/human": np.where(closing, miss.human_speed_m_s, miss.robot_speed_m_s),
        "centre_distance/robot/human": distance,
    }


# Records -------------------------------------------------------------------------------

Motion = Literal["snapshot", "human_state", "frames"]


def recorded_messages(trial: Trial, *, motion: Motion = "snapshot") -> list[Recorded]:
    """The messages a bag of this trial would hold.

    Args:
        trial: Such as `kitting_trial()`.
        motion: How robot and human are recorded: the paper's `snapshot`, the
            `HumanState` of ARIAC 2023, or tf `frames`.

    Returns:
        In order of time; the first has time 0 of the trial.
    """
    messages = [*_task_messages(trial), *_MOTIONS[motion](trial)]
    return sorted(messages, key=lambda message: message.t_ns)


def _at(t_s: float) -> int:
    return ORIGIN_NS + round(t_s * 1e9)


def _task_messages(trial: Trial) -> Iterator[Recorded]:
    event = "ariac_score_msgs/msg/TrialEvent"
    for kind in sorted(trial.witnessed - {"submissions", "bodies"}):
        yield Recorded(
            "/ariac_score/events", event, _at(0.0), {"kind": WATCHING, "subject": kind, "detail": ""}
        )
    states = {COMPETITION_STARTED: "go", COMPETITION_ENDED: "end_game"}
    for item in trial.events:
        if item.kind in states:
            yield Recorded(
                "/ariac/competition_state", "std_msgs/msg/String", _at(item.t_s), {"data": states[item.kind]}
            )
        elif item.kind != "order_announced":
            fields = {"kind": item.kind, "subject": item.subject, "detail": item.detail}
            yield Recorded("/ariac_score/events", event, _at(item.t_s), fields)
    for order in trial.orders:
        yield Recorded(
            "/ariac/orders", "nist_gear/msg/Order", _at(order.announced_s or 0.0), _order_fields(order)
        )
    for submission in trial.submissions:
        yield Recorded(
            "/ariac_score/submissions",
            "ariac_score_msgs/msg/Submission",
            _at(submission.submitted_s),
            _submission_fields(submission),
        )


def _pose_fields(pose: Pose | None) -> dict[str, Any]:
    if pose is None:
        nan = float("nan")
        return {
            "position": {"x": nan, "y": nan, "z": nan},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        }
    x, y, z = pose.position_m
    qw, qx, qy, qz = pose.orientation_wxyz
    return {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": qx, "y": qy, "z": qz, "w": qw}}


def _order_fields(order: Order) -> dict[str, Any]:
    shipments = [
        {
            "shipment_type": task.id,
            "agv_id": task.agv,
            "products": [{"type": p.type, "pose": _pose_fields(p.pose)} for p in task.products],
        }
        for task in order.tasks
    ]
    return {"order_id": order.id, "shipments": shipments}


def _submission_fields(submission: Submission) -> dict[str, Any]:
    products = [
        {"type": p.type, "name": p.name, "is_faulty": p.faulty, "pose": _pose_fields(p.pose)}
        for p in submission.contents or ()
    ]
    return {
        "shipment_type": submission.task_id,
        "agv": submission.agv,
        "station": submission.station,
        "products": products,
        "tray": "" if submission.tray is None else submission.tray.type or NO_TRAY,
        "contents_unknown": submission.contents is None,
    }


def _snapshots(trial: Trial) -> Iterator[Recorded]:
    columns = {
        "human_operator_speed": trial.signals.get("speed/human"),
        "robot_speed": trial.signals.get("speed/robot"),
        "distance_robot_human_operator": trial.signals.get("centre_distance/robot/human"),
    }
    present = {field: signal for field, signal in columns.items() if signal is not None}
    if len(present) < len(columns):
        return  # the node publishes all three or nothing
    clock = next(iter(present.values()))
    for i, t_s in enumerate(clock.t):
        fields = {field: float(signal.values[i]) for field, signal in present.items()}
        yield Recorded("/snapshot", "nist_gear/msg/Snapshot", _at(t_s), fields)


def _xyz(values: FloatArray) -> dict[str, float]:
    return dict(zip("xyz", map(float, values), strict=True))


def _human_states(trial: Trial) -> Iterator[Recorded]:
    """At 10 Hz, with velocities from the positions, as that release publishes them."""
    robot, human = trial.signals["position/robot"], trial.signals["position/human"]
    for i in range(0, len(robot.t) - 1, 10):
        step_s = robot.t[i + 1] - robot.t[i]
        fields = {
            "human_position": _xyz(human.values[i]),
            "robot_position": _xyz(robot.values[i]),
            "human_velocity": _xyz((human.values[i + 1] - human.values[i]) / step_s),
            "robot_velocity": _xyz((robot.values[i + 1] - robot.values[i]) / step_s),
        }
        yield Recorded("/ariac_human/state", "ariac_msgs/msg/HumanState", _at(robot.t[i]), fields)


def _frames(trial: Trial) -> Iterator[Recorded]:
    for name, frame in (("position/robot", "torso_base"), ("position/human", "human_base")):
        signal = trial.signals[name]
        for i, t_s in enumerate(signal.t):
            t_ns = _at(t_s)
            stamp = {"sec": t_ns // 10**9, "nanosec": t_ns % 10**9}
            transform = {
                "header": {"stamp": stamp, "frame_id": "world"},
                "child_frame_id": frame,
                "transform": {
                    "translation": _xyz(signal.values[i]),
                    "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                },
            }
            yield Recorded("/tf", "tf2_msgs/msg/TFMessage", t_ns, {"transforms": [transform]})


_MOTIONS = {"snapshot": _snapshots, "human_state": _human_states, "frames": _frames}


def write_trial_log(path: Path, trial: Trial, *, signals: Iterable[str] | None = None) -> Path:
    """Write a trial as a JSON Lines log in the format of `schemas/trial_log.schema.json`.

    Args:
        path: The file.
        trial: What to write.
        signals: Names of the signals to write; all of them by default.

    Returns:
        The path.
    """
    names = sorted(trial.signals if signals is None else signals)
    records = [*_head(trial), *_timed([trial.signals[name] for name in names], trial)]
    records.append({"record": "end", "records": len(records) + 1})
    path.write_text("".join(json.dumps(record) + "\n" for record in records), encoding="utf-8")
    return path


def _head(trial: Trial) -> Iterator[dict[str, Any]]:
    yield {
        "record": "trial",
        "format": FORMAT,
        "id": trial.id,
        "clock": trial.clock,
        "witnessed": sorted(trial.witnessed),
    }
    for body in trial.bodies:
        yield {
            "record": "body",
            "id": body.id,
            "kind": body.kind,
            "radius_m": body.radius_m,
            "links": [*body.links],
        }


def _timed(signals: list[Signal], trial: Trial) -> list[dict[str, Any]]:
    """Everything with a time, in order of it."""
    records: list[dict[str, Any]] = []
    for order in trial.orders:
        records.append(
            {
                "record": "order",
                "t_s": order.announced_s,
                "id": order.id,
                "priority": order.priority,
                "tasks": [_task_record(task) for task in order.tasks],
            }
        )
    for event in trial.events:
        if event.kind != "order_announced":
            fields = {"kind": event.kind, "subject": event.subject, "detail": event.detail}
            records.append({"record": "event", "t_s": event.t_s, **fields})
    for submission in trial.submissions:
        records.append(_submission_record(submission))
    rows: dict[float, dict[str, Any]] = {}
    for signal in signals:
        for t_s, value in zip(signal.t.tolist(), signal.values.tolist(), strict=True):
            rows.setdefault(t_s, {})[signal.name] = value
    records += [{"record": "sample", "t_s": t_s, "values": values} for t_s, values in rows.items()]
    return sorted(records, key=lambda record: record["t_s"] or 0.0)


def _pose_record(pose: Pose) -> dict[str, Any]:
    return {"position_m": [*pose.position_m], "orientation_wxyz": [*pose.orientation_wxyz]}


def _task_record(task: Task) -> dict[str, Any]:
    products = []
    for wanted in task.products:
        product: dict[str, Any] = {"slot": wanted.slot, "type": wanted.type}
        if wanted.pose is not None:
            product["pose"] = _pose_record(wanted.pose)
        products.append(product)
    return {"id": task.id, "kind": task.kind, "agv": task.agv, "station": task.station, "products": products}


def _submission_record(submission: Submission) -> dict[str, Any]:
    record: dict[str, Any] = {
        "record": "submission",
        "t_s": submission.submitted_s,
        "task_id": submission.task_id,
        "agv": submission.agv,
        "station": submission.station,
    }
    if submission.contents is not None:
        contents = []
        for product in submission.contents:
            fields: dict[str, Any] = {"type": product.type, "name": product.name, "faulty": product.faulty}
            if product.pose is not None:
                fields["pose"] = _pose_record(product.pose)
            contents.append(fields)
        record["contents"] = contents
    return record
