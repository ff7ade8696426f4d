"""What a robot itself must keep, after ISO 10218-1: reduced speed, limits of axes and space."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from ariac_score import Finding, SignalNeed, Trial, check_parameters, parameter
from ariac_score_standards.geometry import check_polygon, depth_inside_m, inside
from ariac_score_standards.parameters import (
    GAP,
    SPEED,
    TIME,
)
from ariac_score_standards.severity import (
    Bound,
    JudgedLimit,
    LimitMonitor,
    Rules,
    Statement,
    limit_findings,
)
from ariac_score_standards.watching import (
    BoolArray,
    FloatArray,
    Subject,
    Watched,
    bodies_of,
    flag_over,
    nobody,
    watch_subjects,
)


@dataclass(frozen=True)
class ReducedSpeed(LimitMonitor):
    """The robot keeps its reduced speed.

    Measures:
        For every robot its speed: of the tool centre point (`tcp_speed`), or of its
        fastest link (`speed`, which is never smaller).
    Violated when:
        The speed exceeds `max_speed_m_s` while the limit applies: always, in manual
        mode (flag `manual_mode`), or while a human is inside `zone`. Equality keeps it.
    Source:
        ISO 10218-1, reduced-speed control: 250 mm/s at the tool centre point; also the
        bound of Class I robots of the 2025 edition.
    """

    max_speed_m_s: float = parameter(
        0.25, status="verified", source="many public sources, such as OSHA STD 01-12-002", **SPEED
    )
    speed: Literal["speed", "tcp_speed"] = parameter("speed", source="what a log is most likely to have")
    applies: Literal["always", "manual_mode", "human_in_zone"] = parameter("always", source="catalogue, M6")
    zone: tuple[tuple[float, ...], ...] = parameter((), unit="m", source="corners [x, y] of the slow zone")
    max_flag_age_s: float = parameter(1.0, unit="s", above=0, at_most=60, source="how long a flag holds")
    max_gap_s: float = parameter(0.05, **GAP)
    t_on_s: float = parameter(0.03, source="catalogue, 1.2", **TIME)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **TIME)

    _clause = "derived from ISO 10218-1, reduced-speed control"

    def __post_init__(self) -> None:
        check_parameters(self)
        check_polygon("zone", self.zone)
        if self.applies == "human_in_zone" and not self.zone:
            raise ValueError("applies is 'human_in_zone' but no zone is given")

    def needs(self) -> Iterator[SignalNeed]:
        """The speed, and the signal that shows when the limit applies."""
        yield SignalNeed(self.speed, "m/s", self.max_gap_s)
        if self.applies == "manual_mode":
            yield SignalNeed("manual_mode", "1", self.max_flag_age_s)
        if self.applies == "human_in_zone":
            yield SignalNeed("position", "m", self.max_gap_s)

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every robot where it was too fast, or its closest moment."""
        wanted = {f"{self.speed}/{{robot}}": "m/s"}
        by_zone = self.applies == "human_in_zone"
        humans = [human.id for human in trial.bodies_of("human")] if by_zone else []
        if by_zone and not humans:
            return iter([nobody(trial, self._clause, ("human",))])
        wanted |= {f"position/{human}": "m" for human in humans}
        return watch_subjects(
            trial,
            bodies_of(trial, "robot"),
            wanted,
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=lambda subject, watched: self._judge(trial, subject, watched, humans),
        )

    def _judge(
        self, trial: Trial, subject: Subject, watched: Watched, humans: list[str]
    ) -> Iterator[Statement]:
        applies, idle = self._applies(trial, subject, watched, humans)
        if isinstance(applies, Finding):
            yield applies
            return
        # The standard limits the tool centre point. The fastest link is never slower, so that it violates
        # sooner: a log that has links alone is judged on the safe side.
        speed = watched[f"{self.speed}/{{robot}}"]
        limit = np.full_like(speed, self.max_speed_m_s)
        bound = Bound("speed", speed, limit, "m/s", True, applies)
        rules = Rules(self._clause, self.t_on_s, self.t_off_s, idle)
        yield from limit_findings(JudgedLimit(subject.name, watched, bound), rules)

    def _applies(
        self, trial: Trial, subject: Subject, watched: Watched, humans: list[str]
    ) -> tuple[BoolArray | Finding | None, str]:
        """Where the limit applies (`None`: everywhere), or why that is unknown; the message if nowhere."""
        if self.applies == "manual_mode":
            flag = flag_over(trial, subject, "manual_mode", self.max_flag_age_s, watched, self._clause)
            return flag, "the robot was never in manual mode"
        if self.applies == "always":
            return None, "the limit never applied"
        applies: BoolArray = np.zeros(len(watched), dtype=bool)
        for human in humans:
            applies |= inside(watched[f"position/{human}"], self.zone)
        return applies, "nobody was in the slow zone"


@dataclass(frozen=True)
class SpaceLimit(LimitMonitor):
    """Every monitored point stays where it may be, and every joint within its limits.

    Measures:
        For every robot (or AGV) the signed distance of each point to the border of the
        space: positive inside `box` and `area` and outside every zone of `keep_out`
        (within its heights `keep_out_z_m`), in m; for a joint the angle left to its nearer limit, in rad.
    Violated when:
        It is negative: the point or the angle is outside. The border itself is inside.
    Source:
        ISO 10218-1, soft axis and space limiting. All limits are for the cell to set.
    """

    example: ClassVar[Mapping[str, Any]] = {"link": "tcp", "box_high_m": [2.5, 2.5, 2.5]}

    kind: Literal["robot", "agv"] = parameter("robot", source="whose space is limited")
    link: str = parameter("", source="link to follow; empty: the origin, and every link that is followed")
    box_low_m: tuple[float, ...] = parameter((), unit="m", source="least x, y, z; set per cell")
    box_high_m: tuple[float, ...] = parameter((), unit="m", source="largest x, y, z; set per cell")
    area: tuple[tuple[float, ...], ...] = parameter((), unit="m", source="corners [x, y]; set per cell")
    keep_out: tuple[tuple[tuple[float, ...], ...], ...] = parameter(
        (), unit="m", source="zones, each by its corners [x, y]; set per cell"
    )
    keep_out_z_m: tuple[float, ...] = parameter(
        (), unit="m", source="lowest and highest z of every keep_out zone; empty: at any height"
    )
    joint: str = parameter("", source="joint whose angle is limited; set per robot")
    joint_low_rad: float | None = parameter(None, unit="rad", at_least=-100, at_most=100, source="per robot")
    joint_high_rad: float | None = parameter(None, unit="rad", at_least=-100, at_most=100, source="per robot")
    max_gap_s: float = parameter(0.05, **GAP)
    t_on_s: float = parameter(0.03, source="catalogue, 1.2", **TIME)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **TIME)

    _clause = "derived from ISO 10218-1, axis and space limiting"

    def __post_init__(self) -> None:
        check_parameters(self)
        for name in ("box_low_m", "box_high_m"):
            if len(getattr(self, name)) not in (0, 2, 3):
                raise ValueError(f"{name} is {list(getattr(self, name))!r}, not [x, y] or [x, y, z] in m")
        for low, high in zip(self.box_low_m, self.box_high_m, strict=False):
            if not low <= high:
                raise ValueError(f"box_low_m has {low:g} where box_high_m has {high:g}: the box is empty")
        check_polygon("area", self.area)
        for number, zone in enumerate(self.keep_out):
            if not zone:
                raise ValueError(f"keep_out zone {number} is not a polygon: it has no corners")
            check_polygon(f"keep_out zone {number}", zone)
        if len(self.keep_out_z_m) not in (0, 2) or list(self.keep_out_z_m) != sorted(self.keep_out_z_m):
            raise ValueError(f"keep_out_z_m is {list(self.keep_out_z_m)!r}, not [lowest z, highest z] in m")
        if self.keep_out_z_m and not self.keep_out:
            raise ValueError("keep_out_z_m is given, but no keep_out zone")
        limits = (self.joint_low_rad, self.joint_high_rad)
        if self.joint and limits == (None, None):
            raise ValueError(f"joint {self.joint!r} has no limit: give joint_low_rad or joint_high_rad")
        if not self.joint and limits != (None, None):
            raise ValueError("a joint limit is given, but joint does not say whose")

    @property
    def _limits_space(self) -> bool:
        return bool(self.box_low_m or self.box_high_m or self.area or self.keep_out)

    def needs(self) -> Iterator[SignalNeed]:
        """Positions of the points, or angles of the joint."""
        if self._limits_space:
            yield SignalNeed("position", "m", self.max_gap_s)
        if self.joint:
            yield SignalNeed("joint_position", "rad", self.max_gap_s)

    def inside_by_m(self, position_m: FloatArray) -> FloatArray:
        """How far inside the permitted space each point, shape (n, 3), is; negative outside, m."""
        left = np.full(len(position_m), np.inf)
        for axis, low in enumerate(self.box_low_m):
            np.minimum(left, position_m[:, axis] - low, out=left)
        for axis, high in enumerate(self.box_high_m):
            np.minimum(left, high - position_m[:, axis], out=left)
        if self.area:
            np.minimum(left, depth_inside_m(position_m, self.area), out=left)
        for zone in self.keep_out:
            depth = depth_inside_m(position_m, zone)
            if self.keep_out_z_m:
                low, high = self.keep_out_z_m
                depth = np.minimum(depth, np.minimum(position_m[:, 2] - low, high - position_m[:, 2]))
            np.minimum(left, -depth, out=left)
        return left

    def joint_left_rad(self, angle_rad: FloatArray) -> FloatArray:
        """Angle left to the nearer limit of the joint; negative beyond it, rad."""
        left = np.full(len(angle_rad), np.inf)
        if self.joint_low_rad is not None:
            np.minimum(left, angle_rad - self.joint_low_rad, out=left)
        if self.joint_high_rad is not None:
            np.minimum(left, self.joint_high_rad - angle_rad, out=left)
        return left

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every point and joint where it was outside, or its closest moment."""
        if not (self._limits_space or self.joint):
            message = "no limit of space and none of a joint is given"
            yield Finding.inconclusive("trial", message, span=trial.window, clause=self._clause)
        if self._limits_space:
            yield from self._watch(trial, self._points(trial), "position", "m")
        if self.joint:
            joints = [
                Subject(f"{body.id}::{self.joint}", {"point": f"{body.id}::{self.joint}"})
                for body in trial.bodies_of(self.kind)
            ]
            yield from self._watch(trial, joints, "joint_position", "rad")

    def _points(self, trial: Trial) -> list[Subject]:
        names = []
        for body in trial.bodies_of(self.kind):
            if self.link:
                names.append(f"{body.id}::{self.link}")
                continue
            # A log may follow the links alone; then a missing origin is no missing signal.
            if f"position/{body.id}" in trial.signals or not body.links:
                names.append(body.id)
            names += [f"{body.id}::{link}" for link in body.links]
        return [Subject(name, {"point": name}) for name in names]

    def _watch(self, trial: Trial, points: list[Subject], quantity: str, unit: str) -> Iterator[Statement]:
        template = f"{quantity}/{{point}}"

        def judge(subject: Subject, watched: Watched) -> Iterator[Statement]:
            values = watched[template]
            left = self.inside_by_m(values) if unit == "m" else self.joint_left_rad(values)
            what = "way left to the border" if unit == "m" else "angle left to the limit"
            bound = Bound(what, left, np.zeros_like(left), unit)
            rules = Rules(self._clause, self.t_on_s, self.t_off_s)
            return limit_findings(JudgedLimit(subject.name, watched, bound), rules)

        return watch_subjects(
            trial,
            points,
            {template: unit},
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=judge,
            kinds=(self.kind,),
        )
