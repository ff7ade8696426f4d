"""Monitored standstill: the robot rests while a person is in its workspace, after ISO 10218-2:2025."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ariac_score import Finding, SignalNeed, Span, Trial, check_parameters, parameter
from ariac_score_standards.blame import (
    MEETING,
    SPEED,
    STANDSTILL_SPEED_M_S,
    Meeting,
    exposure_of,
    meeting_needs,
)
from ariac_score_standards.geometry import check_polygon, inside
from ariac_score_standards.parameters import GAP, LENGTH, TIME, TOLERANCE_S
from ariac_score_standards.parameters import SPEED as SPEED_LIMIT
from ariac_score_standards.severity import (
    Bound,
    Details,
    Episode,
    JudgedLimit,
    LimitMonitor,
    Reach,
    Rules,
    Statement,
    limit_findings,
    no_severities,
    violations_only,
)
from ariac_score_standards.travel import travelled_m
from ariac_score_standards.watching import (
    BoolArray,
    FloatArray,
    Subject,
    Watched,
    first_of_runs,
    pairs_of,
    watch_subjects,
)

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

    _clause = "derived from ISO 10218-2:2025, monitored standstill"

    def __post_init__(self) -> None:
        check_parameters(self)
        check_polygon("workspace", self.workspace)

    def needs(self) -> Iterator[SignalNeed]:
        """Where the human is, how fast the robot is, and where."""
        yield SignalNeed("position", "m", self.max_gap_s)
        yield SignalNeed("speed", "m/s", self.max_gap_s)
        yield SignalNeed("joint_speed", "rad/s", self.max_gap_s, optional=True)
        yield from meeting_needs(self.max_gap_s, "speed")

    @property
    def reach(self) -> Reach:
        """Rest is due some time after the person came in; drift counts from where the robot came to rest."""
        return Reach("run")

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every pair each movement, or that there was none."""
        if not self.workspace:
            message = "no workspace is given, so nobody can be inside"
            yield Finding.inconclusive("trial", message, span=trial.window, clause=self._clause)
            return
        yield from watch_subjects(
            trial,
            pairs_of(trial),
            {"position/{human}": "m", SPEED: "m/s"},
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=self._judge,
            optional={_PLACE: "m", _JOINTS: "rad/s", **MEETING},
            kinds=("robot", "human"),
        )

    def held(self, t: FloatArray, within: BoolArray) -> BoolArray:
        """Whether the robot must be at rest: a person inside, and the grace over."""
        first = first_of_runs(t, within, self.max_gap_s)
        over: BoolArray = within & (t - t[first] >= self.grace_s - TOLERANCE_S)
        return over

    def _judge(self, subject: Subject, watched: Watched) -> Iterator[Statement]:
        within = inside(watched["position/{human}"], self.workspace)
        standing = _Standing(self, watched, within, self.held(watched.t, within))
        rules = Rules(self._clause, self.t_on_s, self.t_off_s, "nobody was in the workspace for long enough")
        exposure = exposure_of(watched)

        def labels(episode: Episode | None) -> Mapping[str, str]:
            return {} if episode is None else Meeting.of(watched).labels(episode.rows)

        def moved(episode: Episode | None) -> Details:
            if episode is None:
                others = {**no_severities("rad/s"), **no_severities("m")}  # of the joints and of the drift
                return Details({**exposure, **others, "travel_m": 0.0, "speed_max_m_s": 0.0})
            quantities = {
                **exposure,
                "travel_m": standing.travelled_m(episode),
                "speed_max_m_s": float(watched[SPEED][episode.rows].max()),
            }
            return Details(quantities, {**labels(episode), "resumed": standing.resumed(episode)})

        hidden = standing.hidden(subject.name, self._clause)
        speed = limit_findings(JudgedLimit(subject.name, watched, standing.speed()), rules, moved)
        yield from violations_only(speed) if hidden else speed
        yield from hidden
        for bound in standing.others():
            limit = JudgedLimit(subject.name, watched, bound)
            more = limit_findings(limit, rules, lambda episode: Details(exposure, labels(episode)))
            yield from violations_only(more)


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

    def speed(self) -> Bound:
        """The speed while it must be 0."""
        speed = self.watched[SPEED]
        limit = np.full_like(speed, self.monitor.standstill_speed_m_s)
        return Bound("speed in the workspace", speed, limit, "m/s", True, self.held)

    def others(self) -> Iterator[Bound]:
        """Its joints, and its place, where the log has them."""
        joints, place = self.watched.get(_JOINTS), self.watched.get(_PLACE)
        if joints is not None:
            yield self._joints(joints)
        if place is not None:
            yield self._drift(place)

    def hidden(self, subject: str, clause: str) -> list[Finding]:
        """What gaps of its joints, or of its place, leave open."""
        resting = self.held & ~self._moving
        return [
            finding
            for template in (_JOINTS, _PLACE)
            for finding in self.watched.hidden_findings(subject, template, resting, clause)
        ]

    def _joints(self, joints: FloatArray) -> Bound:
        """The speed of the joints, where the robot itself keeps its limit."""
        # Where the tool moves, `speed` has the violation already: one movement is charged once.
        known = self.held & np.isfinite(joints) & ~self._moving
        limit = np.full_like(joints, self.monitor.standstill_joint_speed_rad_s)
        return Bound("joint speed in the workspace", np.nan_to_num(joints), limit, "rad/s", True, known)

    def _drift(self, place: FloatArray) -> Bound:
        """Creep below the standstill speed, from where the robot last came to rest."""
        resting = self.held & ~self._moving
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
        limit = np.full_like(drift, self.monitor.drift_m)
        applies = resting & np.isfinite(drift)
        return Bound("drift while standing still", np.nan_to_num(drift), limit, "m", True, applies)

    def travelled_m(self, episode: Episode) -> float:
        """The way of a movement, until the person left or the next movement began."""
        t, last = self.watched.t, int(episode.rows[-1])
        ended = np.flatnonzero(~self.within[last + 1 :] | self._moving[last + 1 :])
        stop = last + 1 + int(ended[0]) if len(ended) else len(t) - 1
        end_s = max(float(t[stop]), episode.span.end_s)
        return travelled_m(t, self.watched[SPEED], Span(episode.span.start_s, end_s))

    def resumed(self, episode: Episode) -> str:
        """Whether the robot had to be at rest before it moved, so that it started again."""
        first = int(episode.rows[0])
        return "yes" if first > 0 and self.held[first - 1] else "no"
