"""What a robot itself must keep, after ISO 10218-1: reduced speed, limits of axes and space."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from ariac_score import FloatArray, Measure, SignalNeed, Trial, parameter
from ariac_score.monitors import (
    BoolArray,
    Bound,
    LimitMonitor,
    Statement,
    Subject,
    Subjects,
    Watched,
    Worse,
    bodies,
    nobody,
    severity_measures,
)
from ariac_score_standards.geometry import check_polygon, depth_inside_m, inside
from ariac_score_standards.parameters import GAP, SPEED, TIME


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

    subjects = bodies("robot")
    what, unit = "speed", "m/s"
    clause = "derived from ISO 10218-1, reduced-speed control"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_polygon("zone", self.zone)
        if self.applies == "human_in_zone" and not self.zone:
            raise ValueError("applies is 'human_in_zone' but no zone is given")

    @property
    def wanted(self) -> dict[str, str]:
        """The speed."""
        return {f"{self.speed}/{{robot}}": "m/s"}

    @property
    def worse(self) -> dict[str, Worse]:
        """Faster; who is in a zone, no bound of a distance tells."""
        return {} if self.applies == "human_in_zone" else dict.fromkeys(self.wanted, "high")

    @property
    def flags(self) -> tuple[str, ...]:
        """The mode, where it counts."""
        return ("manual_mode",) if self.applies == "manual_mode" else ()

    @property
    def idle(self) -> str:
        """When the limit would have applied."""
        never = {
            "manual_mode": "the robot was never in manual mode",
            "human_in_zone": "nobody was in the slow zone",
        }
        return never.get(self.applies, "the limit never applied")

    def needs(self) -> Iterator[SignalNeed]:
        """The speed, and the signal that shows when the limit applies."""
        yield from super().needs()
        if self.applies == "human_in_zone":
            yield SignalNeed("position", "m", self.max_gap_s)

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every robot where it was too fast, or its closest moment."""
        places = self._places(trial)
        if self.applies == "human_in_zone" and not places:
            yield nobody(trial, ("human",), self.clause)
            return
        robots = self.subjects.of(trial.bodies)
        yield from self.judged(trial, robots, {**self.wanted, **dict.fromkeys(places, "m")})

    def _places(self, trial: Trial) -> list[str]:
        """The signals that show whether somebody is in the zone, where that counts."""
        by_zone = self.applies == "human_in_zone"
        return [f"position/{human.id}" for human in trial.bodies_of("human") if by_zone]

    def margin(self, signals: Watched) -> Bound:
        """Reduced speed - speed, m/s."""
        # The standard limits the tool centre point. The fastest link is never slower, so that it violates
        # sooner: a log that has links alone is judged on the safe side.
        speed = signals[f"{self.speed}/{{robot}}"]
        return self.at_most(speed, self.max_speed_m_s, where=self._where(signals))

    def _where(self, signals: Watched) -> BoolArray | None:
        """Where the limit applies; `None`: everywhere."""
        if self.applies == "always":
            return None
        if self.applies == "manual_mode":
            return signals.flag("manual_mode", self.max_flag_age_s)
        within = [inside(signals[place], self.zone) for place in self._places(signals.trial)]
        somebody: BoolArray = np.any(within, axis=0)
        return somebody


_PLACE, _ANGLE = "position/{point}", "joint_position/{point}"


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

    clause = "derived from ISO 10218-1, axis and space limiting"

    def __post_init__(self) -> None:
        super().__post_init__()
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
    def subjects(self) -> Subjects:
        """The machines; findings are about their points and joints."""
        return bodies(self.kind)

    @property
    def lacks(self) -> str:
        """Any limit."""
        given = self._limits_space or self.joint
        return "" if given else "no limit of space and none of a joint is given"

    @property
    def measures(self) -> Mapping[str, Measure]:
        """Those of lengths and of angles, as far as each is limited."""
        of_space = severity_measures("m") if self._limits_space else {}
        return {**of_space, **(severity_measures("rad") if self.joint else {})}

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
        if self.lacks:
            yield from super().statements(trial)
        if self._limits_space:
            yield from self.judged(trial, self._points(trial), {_PLACE: "m"})
        if self.joint:
            names = [f"{body.id}::{self.joint}" for body in trial.bodies_of(self.kind)]
            joints = [Subject(name, {"point": name}) for name in names]
            yield from self.judged(trial, joints, {_ANGLE: "rad"})

    def margin(self, signals: Watched) -> Bound:
        """How far inside, m or rad."""
        if _PLACE in signals.names:
            left, words = self.inside_by_m(signals[_PLACE]), ("way left to the border", "m")
        else:
            left, words = self.joint_left_rad(signals[_ANGLE]), ("angle left to the limit", "rad")
        return self.at_least(left, 0.0, what=words[0], unit=words[1])

    def _points(self, trial: Trial) -> list[Subject]:
        names = []
        for body in trial.bodies_of(self.kind):
            if self.link:
                names.append(f"{body.id}::{self.link}")
                continue
            # A log may follow the links alone; then a missing origin is no missing signal.
            if f"position/{body.id}" in {one.name for one in trial.sampled} or not body.links:
                names.append(body.id)
            names += [f"{body.id}::{link}" for link in body.links]
        return [Subject(name, {"point": name}) for name in names]
