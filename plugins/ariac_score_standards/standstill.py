"""Monitored standstill: the robot rests while a person is in its workspace, after ISO 10218-2:2025."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ariac_score import Finding, FloatArray, Measure, Span, parameter
from ariac_score.monitors import (
    SPEED,
    STANDSTILL_SPEED_M_S,
    TOLERANCE_S,
    BoolArray,
    Bound,
    Encounter,
    Episode,
    JudgedLimit,
    LimitMonitor,
    Reach,
    Statement,
    Watched,
    first_of_runs,
    no_severities,
    pairs,
    rows_of_episodes,
    severity_measures,
    violations_only,
)
from ariac_score_standards.geometry import check_polygon, inside
from ariac_score_standards.parameters import GAP, LENGTH, TIME
from ariac_score_standards.parameters import SPEED as SPEED_LIMIT
from ariac_score_standards.travel import travelled_m

_JOINTS, _PLACE = "joint_speed/{robot}", "position/{robot}"


@dataclass(frozen=True)
class MonitoredStandstill(LimitMonitor):
    """The robot stands still while a person is in the collaborative workspace.

    Measures:
        For every robot and human, while the human is inside `workspace` and once
        `grace_s` has passed since it came in: the robot's speed (and that of its
        joints, where recorded), its drift from where it came to rest, and the way it
        covers until the human has left.
    Violated when:
        A speed exceeds its standstill limit, or the drift exceeds `drift_m`.
    Source:
        ISO 10218-2, monitored standstill (2011: safety-rated monitored stop; stop
        category 2: drives may stay on). Limits and grace are our choice (catalogue, M7).
    """

    example: ClassVar[Mapping[str, Any]] = {"workspace": [[-1.0, 4.0], [1.0, 4.0], [1.0, 6.0], [-1.0, 6.0]]}

    workspace: tuple[tuple[float, ...], ...] = parameter((), unit="m", source="corners [x, y]; required")
    standstill_speed_m_s: float = parameter(STANDSTILL_SPEED_M_S, source="catalogue, M7", **SPEED_LIMIT)
    standstill_joint_speed_rad_s: float = parameter(
        0.01, unit="rad/s", at_least=0, at_most=100, source="catalogue, M7"
    )
    drift_m: float = parameter(0.005, source="catalogue, M7", **LENGTH)
    grace_s: float = parameter(0.5, source="T_r + T_s; catalogue, M7", **TIME)
    max_gap_s: float = parameter(0.05, **GAP)
    t_on_s: float = parameter(0.03, source="catalogue, 1.2", **TIME)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **TIME)

    subjects = pairs("robot", "human")
    wanted: ClassVar[Mapping[str, str]] = {"position/{human}": "m", SPEED: "m/s"}
    optional: ClassVar[Mapping[str, str]] = {_PLACE: "m", _JOINTS: "rad/s"}
    what, unit = "speed in the workspace", "m/s"
    clause = "derived from ISO 10218-2:2025, monitored standstill"
    idle = "nobody was in the workspace for long enough"
    encounter = Encounter()
    reach = Reach("run")  # rest is due some time after the person came in; drift counts from that rest
    severities: ClassVar[Mapping[str, Measure]] = {
        **severity_measures("rad/s"),
        **severity_measures("m"),
        "travel_m": Measure("m", best=0.0, meaning="way covered until the person left"),
        "speed_max_m_s": Measure("m/s", best=0.0, meaning="largest speed while it had to rest"),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        check_polygon("workspace", self.workspace)

    @property
    def lacks(self) -> str:
        """The workspace, where it is not given."""
        return "" if self.workspace else "no workspace is given, so nobody can be inside"

    @property
    def may_hide(self) -> tuple[dict[str, tuple[float, ...]], ...]:
        """A person who came in, so that rest is due behind the gap, and drift counts from then on."""
        return ({"position/{human}": (*self.workspace[0][:2], 0.0)},) if self.workspace else ()

    def limits(self, signals: Watched) -> int:
        """Of the speed, and where the log has them of the joints and of the drift."""
        return 1 + len(signals.optional.keys() & {_PLACE, _JOINTS})

    def held(self, t: FloatArray, within: BoolArray, max_gap_s: float | None = None) -> BoolArray:
        """Whether the robot must be at rest: a person inside, and the grace over.

        Args:
            t: Sample times, shape (n,), s.
            within: Whether a person is inside, shape (n,).
            max_gap_s: Behind a longer gap the person is inside anew, s; `None`: as the monitor accepts.
        """
        first = first_of_runs(t, within, self.max_gap_s if max_gap_s is None else max_gap_s)
        over: BoolArray = within & (t - t[first] >= self.grace_s - TOLERANCE_S)
        return over

    def about(self, signals: Watched) -> Iterator[Statement]:
        """Each movement, or that there was none; then what joints and drift add."""
        within = inside(signals["position/{human}"], self.workspace)
        standing = _Standing(self, signals, within, self.held(signals.t, within, signals.max_gap_s))
        hidden = standing.hidden(self.clause)
        speed = self.findings(signals, standing.speed(), severity=standing.severity, labels=standing.labels)
        yield from violations_only(speed) if hidden else speed
        yield from hidden
        for bound in standing.others():
            yield from violations_only(self.findings(signals, bound))


@dataclass(frozen=True, eq=False)
class _Standing:
    """A robot that must be at rest.

    Attributes:
        monitor: With the limits.
        watched: The signals.
        within: Where the person is inside, shape (n,).
        held: Where the robot must be at rest, shape (n,).
    """

    monitor: MonitoredStandstill
    watched: Watched
    within: BoolArray
    held: BoolArray

    @property
    def _moving(self) -> BoolArray:
        moving: BoolArray = self.watched[SPEED] > self.monitor.standstill_speed_m_s
        return moving

    @property
    def _resting(self) -> BoolArray:
        """Where it must be at rest, and is no faster than that."""
        return self.held & ~self._moving

    def speed(self) -> Bound:
        """The speed while it must be 0."""
        return self.monitor.at_most(self.watched[SPEED], self.monitor.standstill_speed_m_s, where=self.held)

    def severity(self, _limit: JudgedLimit, episode: Episode | None) -> dict[str, float]:
        """The way and the speed of a movement; without one everything is 0, of joints and drift too."""
        if episode is None:
            return {**no_severities("rad/s"), **no_severities("m"), "travel_m": 0.0, "speed_max_m_s": 0.0}
        return {
            "travel_m": self.travelled_m(episode),
            "speed_max_m_s": float(self.watched[SPEED][episode.rows].max()),
        }

    def others(self) -> Iterator[Bound]:
        """Its joints, and its place, where the log has them."""
        joints, place = self.watched.get(_JOINTS), self.watched.get(_PLACE)
        if joints is not None:
            yield self._joints(joints)
        if place is not None:
            yield self._drift(place)

    def hidden(self, clause: str) -> list[Finding]:
        """What gaps of its joints, or of its place, leave open."""
        watched = self.watched
        found = [
            finding
            for template in (_JOINTS, _PLACE)
            for finding in watched.hidden_findings(template, self._resting, clause)
        ]
        return found if watched.get(_PLACE) is None else [*found, *self._unanchored(clause)]

    def _unanchored(self, clause: str) -> Iterator[Finding]:
        """The rests of which nothing shows where they began, so that any drift may have been."""
        subject = self.watched.subject.name
        shown = self.watched.shown_before & ~self.watched.lacks(_PLACE, self._resting)
        for span, rows in rows_of_episodes(self.watched, self._resting, t_off_s=0.0):
            if not shown[rows[0]]:
                message = f"nothing shows where it came to rest, before {span.start_s:.3f} s"
                yield Finding.inconclusive(subject, message, span=span, clause=clause)

    def _joints(self, joints: FloatArray) -> Bound:
        """The speed of the joints, where the robot itself keeps its limit."""
        # Where the tool moves, `speed` has the violation already: one movement is charged once.
        known = self.held & np.isfinite(joints) & ~self._moving
        return self.monitor.at_most(
            np.nan_to_num(joints),
            self.monitor.standstill_joint_speed_rad_s,
            where=known,
            what="joint speed in the workspace",
            unit="rad/s",
        )

    def _drift(self, place: FloatArray) -> Bound:
        """Creep below the standstill speed, from where the robot last came to rest."""
        resting = self._resting
        anchored = ~resting
        anchored[1:] |= ~resting[:-1]  # it comes to rest here
        anchored[:1] = True
        row, last = np.arange(len(resting)), len(resting) - 1
        # Not the place at rest itself, which a gap may hide: the first one that is known from then on.
        known = np.where(np.isfinite(place).all(axis=1), row, last)
        known = np.minimum.accumulate(known[::-1])[::-1]
        anchor = known[np.maximum.accumulate(np.where(anchored, row, 0))]
        away = place - place[anchor]
        drift = np.sqrt(away[:, 0] ** 2 + away[:, 1] ** 2 + away[:, 2] ** 2)
        return self.monitor.at_most(
            np.nan_to_num(drift),
            self.monitor.drift_m,
            where=resting & np.isfinite(drift),
            what="drift while standing still",
            unit="m",
        )

    def travelled_m(self, episode: Episode) -> float:
        """The way of a movement, until the person left or the next movement began."""
        t, last = self.watched.t, int(episode.rows[-1])
        ended = np.flatnonzero(~self.within[last + 1 :] | self._moving[last + 1 :])
        stop = last + 1 + int(ended[0]) if len(ended) else len(t) - 1
        end_s = max(float(t[stop]), episode.span.end_s)
        return travelled_m(t, self.watched[SPEED], Span(episode.span.start_s, end_s))

    def labels(self, _limit: JudgedLimit, episode: Episode | None) -> dict[str, str]:
        """Whether the robot had to be at rest before it moved, so that it started again."""
        if episode is None:
            return {}
        first = int(episode.rows[0])
        return {"resumed": "yes" if first > 0 and self.held[first - 1] else "no"}
