"""What a recording of the engine holds, as its scorer takes it: messages in order of consumption."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ariac_score import FloatArray, Record

__all__ = [
    "ACTIVATED",
    "COMMANDS",
    "CONTACTS",
    "CONTACTS_HZ",
    "CONTROLLER",
    "EVENT",
    "FORCES_HZ",
    "LOG",
    "SCORING_STATIC",
    "SCORING_TF",
    "TF",
    "TF_STATIC",
    "WRENCHES",
    "AicMessages",
    "Controller",
    "IntArray",
    "Texts",
    "Transforms",
    "Wrenches",
    "seconds_of",
]

IntArray = NDArray[np.int64]

TF, TF_STATIC = "/tf", "/tf_static"
SCORING_TF, SCORING_STATIC = "/scoring/tf", "/scoring/tf_static"
CONTROLLER = "/aic_controller/controller_state"
WRENCHES = ("/fts_broadcaster/wrench", "/axia80_m20/wrench")
CONTACTS = "/aic/gazebo/contacts/off_limit"
FORCES_HZ, CONTACTS_HZ = 50.0, 5.0
"""How often the simulator publishes forces and contacts. Source: PR 346 of intrinsic-dev/aic; its worlds."""
EVENT = "/scoring/insertion_event"
ACTIVATED = "/scoring/cable_activated"
LOG = "/rosout"
COMMANDS = ("/aic_controller/pose_commands", "/aic_controller/joint_commands")

NO_ROWS: IntArray = np.empty(0, dtype=np.int64)


def seconds_of(stamps_ns: IntArray) -> FloatArray:
    """Stamps as the scorer adds seconds and nanoseconds up; the last bits differ from a division."""
    found: FloatArray = stamps_ns // 10**9 + (stamps_ns % 10**9) * 1e-9
    return found


@dataclass(frozen=True, eq=False)
class Transforms:
    """All transforms of the tf topics.

    Attributes:
        order: The place of each one's message in order of consumption, not decreasing, shape (n,).
        topic: Its topic, as an index into `topics`.
        stamp_ns: Its header stamp.
        parent, child: Names, as indices into `names`.
        rows: x, y, z in m and the quaternion x, y, z, w, shape (n, 7).
        topics: The names of topics.
        names: The names of frames, without a leading slash.
    """

    order: IntArray = field(default_factory=lambda: NO_ROWS)
    topic: IntArray = field(default_factory=lambda: NO_ROWS)
    stamp_ns: IntArray = field(default_factory=lambda: NO_ROWS)
    parent: IntArray = field(default_factory=lambda: NO_ROWS)
    child: IntArray = field(default_factory=lambda: NO_ROWS)
    rows: FloatArray = field(default_factory=lambda: np.empty((0, 7)))
    topics: tuple[str, ...] = ()
    names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.order)


@dataclass(frozen=True, eq=False)
class Controller:
    """The states of the controller: order, stamps, the tool's velocity in m/s, the offset of forces in N."""

    order: IntArray = field(default_factory=lambda: NO_ROWS)
    stamp_ns: IntArray = field(default_factory=lambda: NO_ROWS)
    velocity_m_s: FloatArray = field(default_factory=lambda: np.empty((0, 3)))
    offset_n: FloatArray = field(default_factory=lambda: np.empty((0, 3)))


@dataclass(frozen=True, eq=False)
class Wrenches:
    """The forces of one sensor topic in N, as recorded, with order and stamps."""

    order: IntArray = field(default_factory=lambda: NO_ROWS)
    stamp_ns: IntArray = field(default_factory=lambda: NO_ROWS)
    force_n: FloatArray = field(default_factory=lambda: np.empty((0, 3)))


@dataclass(frozen=True, eq=False)
class Texts:
    """Texts of a topic, as bytes, for the scorer compares bytes; with order and the stamps of recording."""

    order: IntArray = field(default_factory=lambda: NO_ROWS)
    log_ns: IntArray = field(default_factory=lambda: NO_ROWS)
    stamp_ns: IntArray = field(default_factory=lambda: NO_ROWS)
    texts: tuple[bytes, ...] = ()


@dataclass(frozen=True, eq=False)
class AicMessages(Record):
    """The messages of one recording that a score can rest on.

    Attributes:
        name: Of the recording, such as `bag_trial_1_20260514_191811_949`.
        recorded_ns: First and last time of recording; `None` of an empty one.
        topics: The topics that it declares, with the number of messages of each.
        transforms: Of all four tf topics.
        controller: The states of the controller.
        wrenches: By topic.
        contacts: The messages of contacts that are not empty: order, and the first pair of names.
        contact_topic: Whether contacts were recorded at all.
        events: The insertion events.
        activated: Which cables were activated (phase 1).
        log: The texts of `/rosout`.
        commands_ns: By topic, when commands were recorded.
        repeats: How often a message is in it, where all of one topic are there several times; else 1.
        contact_ns: When messages of contacts were recorded, empty ones among them.
    """

    timed: ClassVar[bool] = False

    name: str
    recorded_ns: tuple[int, int] | None = None
    topics: dict[str, int] = field(default_factory=dict)
    transforms: Transforms = field(default_factory=Transforms)
    controller: Controller = field(default_factory=Controller)
    wrenches: dict[str, Wrenches] = field(default_factory=dict)
    contacts: Texts = field(default_factory=Texts)
    events: Texts = field(default_factory=Texts)
    activated: Texts = field(default_factory=Texts)
    log: Texts = field(default_factory=Texts)
    commands_ns: dict[str, IntArray] = field(default_factory=dict)
    repeats: int = 1
    contact_ns: IntArray = field(default_factory=lambda: NO_ROWS)

    @property
    def witnesses_contacts(self) -> bool:
        """Whether contacts were recorded, so that silence means that there was none."""
        return CONTACTS in self.topics
