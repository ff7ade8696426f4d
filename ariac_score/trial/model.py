"""The trial: work, submissions, bodies, signals, and which of these the log could have shown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np

from ariac_score.errors import LogError, MissingSignalError, UsageError
from ariac_score.trial import quaternions
from ariac_score.trial.attestation import Attestation
from ariac_score.trial.bounds import BetweenSamples
from ariac_score.trial.clock import Clock
from ariac_score.trial.cut import Cut
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.frames import frame
from ariac_score.trial.frozen import FrozenMap
from ariac_score.trial.signals import LARGEST_VALUE, Series, Signal, align, columns_of
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.statements import FileOrigin, Statement
from ariac_score.trial.work import Fact, Record, Submission, WorkItem, announced_s, checked_facts

__all__ = [
    "Body",
    "LogDefect",
    "OfficialOrder",
    "OfficialResult",
    "Pose",
    "TeamSetup",
    "Trial",
]


@dataclass(frozen=True)
class Pose:
    """Where something lies, in the frame of what it lies on.

    Attributes:
        position_m: x, y, z in m.
        orientation_wxyz: Quaternion, scalar first, as recorded (not normalised).

    Raises:
        ValueError: A number is not finite, or the quaternion has norm 0 (or one that float64 cannot hold).
    """

    position_m: tuple[float, float, float]
    orientation_wxyz: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        # `<=` and not `>`, because every comparison with NaN is false.
        if not all(abs(v) <= LARGEST_VALUE for v in (*self.position_m, *self.orientation_wxyz)):
            raise ValueError("a pose must be finite, and near enough to compute with")
        # The square of a tiny component is 0 in float64, and that of a huge one infinite.
        if not 0 < quaternions.inner_product(self.orientation_wxyz, self.orientation_wxyz) < math.inf:
            raise ValueError("a quaternion of norm 0, or of one beyond all numbers, is no orientation")

    @classmethod
    def from_rpy(cls, position_m: tuple[float, float, float], rpy_rad: tuple[float, float, float]) -> Pose:
        """From roll, pitch, yaw about fixed axes: q = qz(yaw) qy(pitch) qx(roll).

        Source: rulebooks 2017-2022, order poses.
        """
        return cls(position_m, quaternions.from_rpy(rpy_rad))

    @property
    def yaw_rad(self) -> float:
        """Rotation about z as Gazebo's maths library extracts it, in rad."""
        return quaternions.yaw(self.orientation_wxyz)

    @property
    def up_axis(self) -> tuple[float, float, float]:
        """The thing's own vertical axis in the frame of what it lies on, of length 1."""
        return quaternions.up_axis(self.orientation_wxyz)

    def normalised(self) -> Pose:
        """The same pose with a quaternion of norm 1."""
        return Pose(self.position_m, quaternions.unit(self.orientation_wxyz))

    def quaternion_dot(self, other: Pose) -> float:
        """Absolute dot product of the two quaternions as recorded."""
        return abs(quaternions.inner_product(self.orientation_wxyz, other.orientation_wxyz))

    def rotation_to(self, other: Pose) -> float:
        """The angle of the whole rotation that takes this orientation to the other, in rad, 0 to pi."""
        return quaternions.angle(self.orientation_wxyz, other.orientation_wxyz)

    def seen_from(self, frame: Pose) -> Pose:
        """This pose in the frame of another, both given in one frame.

        >>> turned = Pose.from_rpy((1.0, 1.0, 0.0), (0.0, 0.0, math.pi / 2))
        >>> [round(v, 9) + 0.0 for v in Pose((1.0, 3.0, 0.5)).seen_from(turned).position_m]
        [2.0, 0.0, 0.5]
        """
        back = quaternions.conjugate(quaternions.unit(frame.orientation_wxyz))
        (x, y, z), (fx, fy, fz) = self.position_m, frame.position_m
        return Pose(
            quaternions.turned((x - fx, y - fy, z - fz), back),
            quaternions.product(back, quaternions.unit(self.orientation_wxyz)),
        )


@dataclass(frozen=True)
class Body:
    """Something that moves and that checks are about.

    Attributes:
        id: Such as `arm` or `person_1`.
        kind: What it is, such as `robot`, `human` or `vehicle`, as the log map or the reader names it.
        radius_m: Radius of the sphere that stands for it (and for each link), m; `None`: not known, so that
            nobody knows how far its surface is from another. A point has 0.
        links: Names of its links whose positions are recorded.
    """

    id: str
    kind: str
    radius_m: float | None = None
    links: tuple[str, ...] = ()


@dataclass(frozen=True)
class TeamSetup:
    """What the team brought.

    Attributes:
        name: Team name; empty when unknown.
        sensors: Sensor types by sensor name; `None` when no file lists them, which is not the same as
            having none.
    """

    name: str = ""
    sensors: Mapping[str, str] | None = None

    def __post_init__(self) -> None:
        if self.sensors is not None:
            # A check must not be able to change what the next one reads.
            object.__setattr__(self, "sensors", FrozenMap(dict(self.sensors)))


@dataclass(frozen=True)
class OfficialOrder:
    """What an official record says about one order, where it has a summary of each; `None`: not printed.

    Attributes:
        id: Of the order.
        kind: Of its task, in the competition's words; empty when not printed.
        submitted: Whether it was submitted.
        priority: Whether it is a priority order.
        score: Points of its task, without any factor for priority; may be negative.
        max_score: The most points it could have had.
        announced_s: When it was announced, s since the start of the competition.
        submitted_s: When it was submitted, s since the start of the competition.
        items: Everything printed in detail, as printed, by path, such as `part_1/flipped`.
    """

    id: str
    kind: str = ""
    submitted: bool | None = None
    priority: bool | None = None
    score: int | float | None = None
    max_score: int | float | None = None
    announced_s: int | float | None = None
    submitted_s: int | float | None = None
    items: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))

    def __post_init__(self) -> None:
        object.__setattr__(self, "items", FrozenMap(dict(self.items)))


@dataclass(frozen=True)
class OfficialResult:
    """What the official scorer printed, kept next to our result and never used in its place.

    Attributes:
        source: File it was read from.
        total: Printed final score; of a text that prints scores of orders only, their sum; `None`: neither.
        process_time_s: Printed total process time, s.
        orders: Printed total by order id.
        outcome: How the run ended unless it ended regularly: `crashed` (the simulator died, nothing was
            scored), `cancelled` (by the user), `aborted` (before all orders were submitted); else empty.
        summaries: What is printed of each order, in the order of the record.
        items: Whatever else is printed of the trial, as printed, by label, such as `trial_time_limit`;
            `final_score` is the total with the digits it is printed with, where it is rounded.
    """

    source: str
    total: int | float | None
    process_time_s: int | float | None
    orders: Mapping[str, int | float] = field(default_factory=lambda: FrozenMap({}))
    outcome: str = ""
    summaries: tuple[OfficialOrder, ...] = ()
    items: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))

    def __post_init__(self) -> None:
        for name in ("orders", "items"):
            object.__setattr__(self, name, FrozenMap(dict(getattr(self, name))))


@dataclass(frozen=True, order=True)
class LogDefect:
    """Something wrong with the log that was survived, with a count.

    Attributes:
        kind: Such as `repeated_stamps`.
        where: Topic, signal or file it concerns.
        count: How often.
        message: One sentence for people.
    """

    kind: str
    where: str
    count: int
    message: str

    def __post_init__(self) -> None:
        if self.count < 0:
            raise ValueError(f"defect {self.kind!r} of {self.where!r} has a count of {self.count}")


_Column = TypeVar("_Column", Signal, Series)


def _in_unit(column: _Column, unit: str) -> _Column:
    if column.unit != unit:
        raise LogError(f"signal {column.name!r} is in {column.unit!r}, the check asks for {unit!r}")
    return column


@dataclass(frozen=True)
class Due:
    """Where a signal would have been recorded, by what an organiser states.

    Attributes:
        topic: Such as `/snapshot`.
        rate_hz: How often it is published.
    """

    topic: str
    rate_hz: float


# eq=False: signals hold arrays, which have no single truth to compare by.
@dataclass(frozen=True, eq=False)
class Trial:
    """One trial as its logs show it.

    Times are s of trial time. Trial time 0 is the recording's first stamp for bags
    and JSON Lines, and the simulator's own zero for Gazebo logs.

    Attributes:
        id: Name of the trial.
        work: What was to be done: the outermost items, in order of announcement, updates applied.
        submissions: What was handed in, in order of time; of the competition's own class, where it has one.
        events: In order of time.
        bodies: What moves: robots, humans, whatever the log map names.
        signals: By name.
        as_consumed: By name, what a reader delivers in the order in which an official program takes it.
        team: What the team brought; `None` when no log says.
        official: The official scorer's own result, when the bundle holds it.
        witnessed: Kinds of things this log would have shown had they happened:
            `submissions`, `bodies`, or an event kind. For anything else silence
            means nothing was recorded, not that nothing happened.
        unrecorded: What readers looked for and did not find, in words.
        log_defects: What was wrong with the log.
        clocks: Of the logs it was read from, the one that its times are on first; empty when no log says.
        recorded: From the first to the last stamp of the recording.
        facts: What a configuration or an official record states of the trial, by name, such as
            `time_limit_s`; `None`: known to be absent; what is not stated has no entry.
        records: What the readers of a competition keep for its own checks; the core never looks inside.
        read_with: The entry points, as group and name, that its readers asked for help; a result names them.
        published_kinds: Kinds of bodies that a log map names: a configuration that knows of none of these
            speaks of those of its simulator alone.
        between: What is assumed of the time between samples; `None`: nothing, and gaps are not bounded.
        origin: Of a part of a trial, the file it was read from and who gave it; `None` for a trial made of
            several, or by hand.
        statements: Whose statement its facts rest on, where it was read from files.
        window_open: Why it is undecided what happened in the competition, in words: nobody knows when it
            started or ended, or messages are known to be missing. Empty where it is decided; trials made by
            hand are.
        attestation: Of a part of a trial, what its recorder attests; `None` where it attests nothing.
        attestations: Of each log that it was read from, by name of the file.
        cut: How far a log of it goes that is cut off; `None`: all are whole.
        stand_ins: By name of a signal, what would have recorded it and is not there, so that what else shows
            the same stands in for it.
        twins: By name of a recorded signal, the same once more, as it follows from others.

    Raises:
        ValueError: A fact is not finite, or a name is that of a signal and of a series.
    """

    id: str
    work: tuple[WorkItem, ...] = ()
    submissions: tuple[Submission, ...] = ()
    events: tuple[Event, ...] = ()
    bodies: tuple[Body, ...] = ()
    signals: Mapping[str, Signal] = field(default_factory=lambda: FrozenMap({}))
    team: TeamSetup | None = None
    official: OfficialResult | None = None
    witnessed: frozenset[str] = frozenset()
    unrecorded: tuple[str, ...] = ()
    log_defects: tuple[LogDefect, ...] = ()
    clocks: tuple[Clock, ...] = ()
    recorded: Span | None = None
    facts: Mapping[str, Fact] = field(default_factory=lambda: FrozenMap({}))
    records: tuple[Record, ...] = ()
    as_consumed: Mapping[str, Series] = field(default_factory=lambda: FrozenMap({}))
    read_with: frozenset[tuple[str, str]] = field(default=frozenset(), compare=False)
    published_kinds: frozenset[str] = field(default=frozenset(), compare=False)
    between: BetweenSamples | None = field(default=None, compare=False)
    origin: FileOrigin | None = field(default=None, compare=False)
    statements: tuple[Statement, ...] = field(default=(), compare=False)
    window_open: str = ""
    attestation: Attestation | None = None
    attestations: tuple[tuple[str, Attestation | None], ...] = field(default=(), compare=False)
    cut: Cut | None = None
    stand_ins: Mapping[str, Due] = field(default_factory=FrozenMap)
    twins: Mapping[str, Signal] = field(default_factory=FrozenMap, compare=False)

    def __post_init__(self) -> None:
        for name in ("signals", "stand_ins", "twins"):
            object.__setattr__(self, name, FrozenMap(dict(getattr(self, name))))
        object.__setattr__(self, "as_consumed", FrozenMap(dict(self.as_consumed)))
        if both := sorted(self.signals.keys() & self.as_consumed.keys()):
            raise ValueError(f"{both[0]!r} is given as a signal and as consumed")
        object.__setattr__(self, "facts", FrozenMap(dict(checked_facts(self.facts, self.id))))

    def signal(self, name: str, *, unit: str) -> Signal:
        """The signal of that name.

        Raises:
            MissingSignalError: It is not in the log, or only as consumed (see `series`).
            LogError: It is there in another unit.
        """
        if name not in self.signals:
            raise MissingSignalError(name, self.signals, self.as_consumed)
        return _in_unit(self.signals[name], unit)

    def find_signal(self, name: str, *, unit: str = "") -> Signal | None:
        """The signal of that name, in any unit unless one is given; `None` when the log has none.

        Raises:
            MissingSignalError: The log has it only as consumed, so that nothing else may stand in for it.
            LogError: It is there in another unit.
        """
        if name in self.as_consumed:
            raise MissingSignalError(name, self.signals, self.as_consumed)
        found = self.signals.get(name)
        return found if found is None or not unit else _in_unit(found, unit)

    def series(self, name: str, *, unit: str) -> Series:
        """The series of that name, as consumed.

        Raises:
            MissingSignalError: The log has none of that name; signals are no series.
            LogError: It is there in another unit.
        """
        if name not in self.as_consumed:
            raise MissingSignalError(name, self.as_consumed)
        return _in_unit(self.as_consumed[name], unit)

    @property
    def sampled(self) -> tuple[Signal | Series, ...]:
        """Everything that has samples: the signals, then the series as consumed."""
        return (*self.signals.values(), *self.as_consumed.values())

    def to_frame(self, *names: str, max_gap_s: float = math.inf) -> Any:
        """Signals side by side as a `pandas.DataFrame`: one row for each time that all of them cover.

        Between its samples a signal runs straight (`align`). The units are in `attrs["units"]`.

        Args:
            names: Of signals; without any, all of them.
            max_gap_s: Longest stretch between two samples that is crossed, s.

        Raises:
            MissingSignalError: A signal is not in the log.
            UsageError: A name is no text, or pandas is not installed.
        """
        for name in names:
            if not isinstance(name, str):
                raise UsageError(
                    f"signals are named one by one, not by a {type(name).__name__}",
                    hint="write to_frame('speed/arm', 'separation/arm/ann'), or to_frame(*names)",
                )
            if name not in self.signals:
                raise MissingSignalError(name, self.signals, self.as_consumed)
        chosen = [self.signals[name] for name in names or self.signals]
        t, values = align(chosen, max_gap_s=max_gap_s) if chosen else (np.empty(0), [])
        columns: dict[str, FloatArray] = {"t_s": t}
        units: dict[str, str] = {}
        for signal, own in zip(chosen, values, strict=True):
            these = columns_of(signal.name, own)
            columns.update(these)
            units.update(dict.fromkeys(these, signal.unit))
        return frame(columns, index="t_s", units=units)

    def bodies_of(self, kind: str) -> tuple[Body, ...]:
        """The bodies of one kind, sorted by id."""
        # Sorted: findings must not depend on the order in which a log lists bodies.
        return tuple(sorted((b for b in self.bodies if b.kind == kind), key=lambda b: b.id))

    def pairs(self, first: str = "robot", second: str = "human") -> Iterator[tuple[Body, Body]]:
        """Every pair of bodies of two kinds, in order of their ids; each two bodies of one kind once."""
        for one in self.bodies_of(first):
            for other in self.bodies_of(second):
                if first != second or one.id < other.id:
                    yield one, other

    def body_pairs(self) -> Iterator[tuple[Body, Body]]:
        """Every two bodies of which one at least is no human: robots first, then other kinds, then humans."""
        kinds = sorted({body.kind for body in self.bodies} - {"robot", "human"})
        machines = [body for kind in ("robot", *kinds) for body in self.bodies_of(kind)]
        everybody = [*machines, *self.bodies_of("human")]
        for index, machine in enumerate(machines):
            for other in everybody[index + 1 :]:
                yield machine, other

    def events_of(self, kind: str) -> tuple[Event, ...]:
        """The events of one kind in order of time."""
        return tuple(sorted(e for e in self.events if e.kind == kind))

    @property
    def clock(self) -> str:
        """Its clocks in words, as results store them; empty when no log says."""
        return "; ".join(sorted(map(str, self.clocks)))

    @property
    def started_s(self) -> float | None:
        """When the competition started, s of trial time; `None` when the log does not say."""
        started = self.events_of(COMPETITION_STARTED)
        return started[0].t_s if started else None

    @property
    def ended_s(self) -> float | None:
        """When the competition ended, s of trial time; `None` when the log does not say."""
        ended = self.events_of(COMPETITION_ENDED)
        return ended[-1].t_s if ended else None

    @property
    def window(self) -> Span | None:
        """The stretch in which behaviour counts: start to end of the competition.

        Work announced before the start opens it early: from then on there is work. Where
        the log gives no start or end, the first or last stamp of the recording stands in; where
        the end is not after the start, the whole recording counts.
        """
        if self.recorded is None:
            return None
        start_s = self.recorded.start_s if self.started_s is None else self.started_s
        end_s = self.recorded.end_s if self.ended_s is None else self.ended_s
        if not start_s < end_s:  # noted as the defect `no_window` when logs are merged
            return self.recorded
        announced = [announced_s(item) for item in self.work]
        return Span(min([start_s, *(t_s for t_s in announced if t_s is not None)]), end_s)

    @property
    def duration_s(self) -> float:
        """Length of the window, s; 0 when nothing was recorded."""
        return self.window.duration_s if self.window else 0.0
