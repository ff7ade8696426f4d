"""The messages in which ARIAC, and the paper's node that watches it, would have recorded a trial."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal

from ariac_score import COMPETITION_ENDED, COMPETITION_STARTED, Trial
from ariac_score.testing import Recorded
from ariac_score.testing.recordings import (
    event_messages,
    frame_messages,
    pose_fields,
    stamp_ns,
    xyz_fields,
)
from ariac_score_ariac.recorder_messages import NO_TRAY
from ariac_score_ariac.work import KitSubmission, Order, orders_of, submissions_of

__all__ = ["MOTIONS", "Motion", "recorded_messages"]

Motion = Literal["snapshot", "human_state", "frames"]

_STATES = {COMPETITION_STARTED: "go", COMPETITION_ENDED: "end_game"}
"""Words of `/ariac/competition_state`, ARIAC 2017 to 2022."""


def recorded_messages(trial: Trial, *, motion: Motion = "snapshot") -> list[Recorded]:
    """The messages a bag of this trial would hold, with orders in the form of 2020.

    Args:
        trial: Such as `kitting_trial()`.
        motion: How robot and human are recorded: the paper's `snapshot`, the
            `HumanState` of ARIAC 2023, or tf `frames`.

    Returns:
        In order of time; the first has time 0 of the trial.
    """
    messages = [
        *event_messages(trial, leave_out=_STATES),
        *_state_messages(trial),
        *_order_messages(trial),
        *submission_messages(trial),
        *MOTIONS[motion](trial),
    ]
    return sorted(messages, key=lambda message: message.t_ns)


def _state_messages(trial: Trial) -> Iterator[Recorded]:
    for event in trial.events:
        if event.kind in _STATES:
            fields = {"data": _STATES[event.kind]}
            yield Recorded("/ariac/competition_state", "std_msgs/msg/String", stamp_ns(event.t_s), fields)


def _order_messages(trial: Trial) -> Iterator[Recorded]:
    for order in orders_of(trial):
        t_ns = stamp_ns(order.announced_s or 0.0)
        yield Recorded("/ariac/orders", "nist_gear/msg/Order", t_ns, _order_fields(order))


def _order_fields(order: Order) -> dict[str, Any]:
    shipments = [
        {
            "shipment_type": task.id,
            "agv_id": task.agv,
            "products": [{"type": p.type, "pose": pose_fields(p.pose)} for p in task.products],
        }
        for task in order.tasks
    ]
    return {"order_id": order.id, "shipments": shipments}


# What moves ----------------------------------------------------------------------------


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
        yield Recorded("/snapshot", "nist_gear/msg/Snapshot", stamp_ns(t_s), fields)


def _human_states(trial: Trial) -> Iterator[Recorded]:
    """At 10 Hz, with velocities from the positions, as that release publishes them."""
    robot, human = trial.signals["position/robot"], trial.signals["position/human"]
    for i in range(0, len(robot.t) - 1, 10):
        step_s = robot.t[i + 1] - robot.t[i]
        fields = {
            "human_position": xyz_fields(human.values[i]),
            "robot_position": xyz_fields(robot.values[i]),
            "human_velocity": xyz_fields((human.values[i + 1] - human.values[i]) / step_s),
            "robot_velocity": xyz_fields((robot.values[i + 1] - robot.values[i]) / step_s),
        }
        yield Recorded("/ariac_human/state", "ariac_msgs/msg/HumanState", stamp_ns(robot.t[i]), fields)


def _frames(trial: Trial) -> Iterator[Recorded]:
    """Robot and human by the names of their frames in the simulator."""
    return frame_messages(trial, {"robot": "torso_base", "human": "human_base"})


MOTIONS: Mapping[str, Callable[[Trial], Iterator[Recorded]]] = {
    "snapshot": _snapshots,
    "human_state": _human_states,
    "frames": _frames,
}


def submission_messages(trial: Trial) -> Iterator[Recorded]:
    """The submissions, as our own messages."""
    for submission in submissions_of(trial):
        yield Recorded(
            "/ariac_score/submissions",
            "ariac_score_msgs/msg/Submission",
            stamp_ns(submission.submitted_s),
            _submission_fields(submission),
        )


def _submission_fields(submission: KitSubmission) -> dict[str, Any]:
    products = [
        {"type": p.type, "name": p.name, "is_faulty": p.faulty, "pose": pose_fields(p.pose)}
        for p in submission.contents or ()
    ]
    return {
        "shipment_type": submission.item_id,
        "agv": submission.agv,
        "station": submission.station,
        "products": products,
        "tray": "" if submission.tray is None else submission.tray.type or NO_TRAY,
        "contents_unknown": submission.contents is None,
    }
