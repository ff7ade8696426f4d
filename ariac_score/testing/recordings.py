"""The messages a recorder would have written of a trial, in types that belong to no competition.

A competition adds its own: work, its state, how it shows what moves. Its plugin may offer a
recording in them (`RecordsTrials`), made of these building blocks and of its own messages.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Protocol, runtime_checkable

from ariac_score.testing.bags import Recorded
from ariac_score.testing.trials import ORIGIN_NS
from ariac_score.trial.events import ORDER_ANNOUNCED, WATCHING
from ariac_score.trial.model import Pose, Trial
from ariac_score.trial.spans import FloatArray

__all__ = [
    "RecordsTrials",
    "event_messages",
    "frame_messages",
    "pose_fields",
    "recorded_messages",
    "scalar_messages",
    "stamp_ns",
    "xyz_fields",
]


@runtime_checkable
class RecordsTrials(Protocol):
    """A competition that can say in which messages it would have recorded a trial.

    Attributes:
        motions: The ways in which it records what moves, the usual one first.
    """

    motions: Sequence[str]

    def recorded_messages(self, trial: Trial, *, motion: str) -> list[Recorded]:
        """The messages a bag of this trial would hold, in order of time."""
        ...


def recorded_messages(trial: Trial) -> list[Recorded]:
    """The messages of a trial without those of any competition, so without its work and submissions.

    Events are our own messages, positions are tf frames named like their bodies, and
    other signals of one component are `std_msgs/msg/Float64` on a topic named like the signal.

    Args:
        trial: Such as `near_miss_trial()`.

    Returns:
        In order of time; time 0 of the trial is `ORIGIN_NS`.
    """
    # Of one time the recorder's events stand first: they say what the rest witnesses. Sorting is stable.
    messages = [
        *event_messages(trial),
        *frame_messages(trial),
        *scalar_messages(trial),
    ]
    return sorted(messages, key=lambda message: message.t_ns)


def stamp_ns(t_s: float) -> int:
    """The log time of a trial time, ns."""
    return ORIGIN_NS + round(t_s * 1e9)


def event_messages(trial: Trial, *, leave_out: Collection[str] = ()) -> Iterator[Recorded]:
    """What the recorder watches for, and the events it saw.

    Args:
        trial: Whose events.
        leave_out: Kinds of events that the recording has as other messages.
    """
    topic, msgtype = "/ariac_score/events", "ariac_score_msgs/msg/TrialEvent"
    # Submissions and bodies are witnessed by messages of their own.
    for kind in sorted(trial.witnessed - {"submissions", "bodies"}):
        yield Recorded(topic, msgtype, stamp_ns(0.0), {"kind": WATCHING, "subject": kind, "detail": ""})
    for event in trial.events:
        # A reader makes this event of the item itself; a second one would be another item.
        if event.kind != ORDER_ANNOUNCED and event.kind not in leave_out:
            fields = {"kind": event.kind, "subject": event.subject, "detail": event.detail}
            yield Recorded(topic, msgtype, stamp_ns(event.t_s), fields)


def frame_messages(trial: Trial, frames: Mapping[str, str] | None = None) -> Iterator[Recorded]:
    """Positions as tf frames in the world.

    Args:
        trial: Whose positions.
        frames: Frame for each body; by default every body that has a position, by its own name.
    """
    named = frames or {body.id: body.id for body in trial.bodies if f"position/{body.id}" in trial.signals}
    for body, frame in named.items():
        signal = trial.signals[f"position/{body}"]
        for i, t_s in enumerate(signal.t):
            # The stamp of the header is the log time: a made recording has no delay.
            t_ns = stamp_ns(t_s)
            stamp = {"sec": t_ns // 10**9, "nanosec": t_ns % 10**9}
            transform = {
                "header": {"stamp": stamp, "frame_id": "world"},
                "child_frame_id": frame,
                "transform": {
                    "translation": xyz_fields(signal.values[i]),
                    "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                },
            }
            yield Recorded("/tf", "tf2_msgs/msg/TFMessage", t_ns, {"transforms": [transform]})


def scalar_messages(trial: Trial) -> Iterator[Recorded]:
    """Every signal of one component, on a topic of its name."""
    for name, signal in sorted(trial.signals.items()):
        if signal.values.ndim == 1:  # vectors would need a message of their own; positions are frames
            for t_s, value in zip(signal.t.tolist(), signal.values.tolist(), strict=True):
                yield Recorded(f"/{name}", "std_msgs/msg/Float64", stamp_ns(t_s), {"data": value})


def pose_fields(pose: Pose | None) -> dict[str, Any]:
    """The fields of `geometry_msgs/msg/Pose`; not a number where the pose is not known."""
    if pose is None:
        nan = float("nan")
        return {
            "position": {"x": nan, "y": nan, "z": nan},
            "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        }
    x, y, z = pose.position_m
    qw, qx, qy, qz = pose.orientation_wxyz
    return {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": qx, "y": qy, "z": qz, "w": qw}}


def xyz_fields(values: FloatArray) -> dict[str, float]:
    """The fields of a vector or point."""
    return dict(zip("xyz", map(float, values), strict=True))
