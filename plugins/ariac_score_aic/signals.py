"""What a recording says of the tool, the plug and its port over time, as bodies and signals for monitors.

The scorer's own numbers do not rest on these: here stamps are in order, and each counts once.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from ariac_score import Body, FloatArray, Quantity, Signal, Trial
from ariac_score_aic.chains import Poses, first_of_each
from ariac_score_aic.consumption import Consumed
from ariac_score_aic.messages import CONTACTS, CONTACTS_HZ, CONTROLLER, FORCES_HZ, IntArray

__all__ = ["OFF_LIMIT_CONTACT", "WRIST_FORCE", "with_signals"]

WRIST_FORCE = Quantity(
    "N", 1, "body", "force at the wrist, without the offset that the controller states", 0.0
)
OFF_LIMIT_CONTACT = Quantity("1", 1, "body", "1 while anything off limits is touched, else 0", 0.0)

TOOL, PLUG, PORT = "tool", "plug", "port"
NO_HUMAN = "human bodies"
"""What is witnessed where nobody is in the cell: a human would be known."""


def with_signals(trial: Trial, consumed: Consumed) -> Trial:
    """The trial with the bodies and the signals of what was consumed, beside those that it has."""
    signals = {one.name: one for one in _signals(consumed) if one.name not in trial.signals}
    named = {name.rpartition("/")[2] for name in signals} | {TOOL}
    kinds = {TOOL: "robot", PLUG: "plug", PORT: "port"}
    known = {body.id for body in trial.bodies}
    new = tuple(Body(name, kind) for name, kind in kinds.items() if name in named - known)
    return replace(trial, bodies=(*trial.bodies, *new), signals={**trial.signals, **signals})


def _signals(consumed: Consumed) -> Iterator[Signal]:
    stamps, force = consumed.forces
    yield from _signal(
        consumed, f"wrist_force/{TOOL}", "N", stamps, _lengths(force), consumed.how.wrench_topic, FORCES_HZ
    )
    states = consumed.messages.controller
    speeds = _lengths(states.velocity_m_s)
    yield from _signal(consumed, f"tcp_speed/{TOOL}", "m/s", states.stamp_ns, speeds, CONTROLLER)
    at_ns = consumed.messages.contact_ns
    touched = np.isin(at_ns, consumed.messages.contacts.log_ns).astype(np.float64)
    yield from _signal(consumed, f"off_limit_contact/{TOOL}", "1", at_ns, touched, CONTACTS, CONTACTS_HZ)
    yield from _place(consumed, TOOL, consumed.places_of(consumed.how.gripper_frame))
    if consumed.connections:
        frames = consumed.frames_of(consumed.connections[0])
        for name, frame in zip((PLUG, PORT), frames[:2], strict=True):
            yield from _place(consumed, name, consumed.places_of(frame))


def _place(consumed: Consumed, name: str, poses: Poses) -> Iterator[Signal]:
    yield from _signal(consumed, f"position/{name}", "m", poses.stamp_ns, poses.position_m, "/tf")


def _lengths(vectors: FloatArray) -> FloatArray:
    lengths: FloatArray = np.sqrt((vectors**2).sum(axis=1))
    return lengths


def _signal(
    consumed: Consumed,
    name: str,
    unit: str,
    stamp_ns: IntArray,
    values: FloatArray,
    source: str,
    rate_hz: float = 0.0,
) -> Iterator[Signal]:
    """The signal of that name; none without a sample that is finite and stamped within the recording."""
    stamps, first = first_of_each(stamp_ns)
    kept = values[first]
    finite = np.isfinite(kept) if kept.ndim == 1 else np.isfinite(kept).all(axis=1)
    recorded = consumed.messages.recorded_ns
    if recorded is None:
        return
    finite &= (stamps >= recorded[0]) & (stamps <= recorded[1])
    if finite.any():
        t_s = (stamps[finite] - recorded[0]) / 1e9 + consumed.later_s
        yield Signal(name, unit, t_s, kept[finite], source, stated_rate_hz=rate_hz)
