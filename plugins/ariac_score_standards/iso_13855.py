"""Distance between a sensing line and the hazard behind it, after ISO 13855 (2010 and 2024).

And after the rules of the USA, which have the same form with other numbers: S = K T + D_pf + Z.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from ariac_score import Finding, FloatArray, Measure, Trial, Verdict, exact_sum, parameter
from ariac_score.monitors import (
    STANDSTILL_SPEED_M_S,
    TOLERANCE_S,
    BoolArray,
    Bound,
    Encounter,
    LimitMonitor,
    Reach,
    Statement,
    Watched,
    first_of_runs,
    no_severities,
    pairs,
)
from ariac_score_standards.geometry import check_polygon, depth_inside_m, distance_between_m
from ariac_score_standards.parameters import LENGTH

Edition = Literal["2010", "2024", "us"]
Arrangement = Literal["orthogonal", "whole_body", "parallel", "two_hand", "interlocked_guard"]

HAND_SPEED_M_S = 2.0
"""Approach of a hand, up to `SWITCH_M` (verified: manuals of C4000 and miniTwin4)."""
WALKING_SPEED_M_S = 1.6
"""Approach of a walking person (verified: the same)."""
SWITCH_M = 0.5
"""Above this distance, intrusion included, the walking speed counts."""
LEAST_M = 0.1
"""An orthogonal field is never nearer to the hazard than this."""

US_SPEED_M_S = 63 * 0.0254
"""63 inches per second, the hand speed of OSHA 29 CFR 1910.217 (verified: osha.gov); walking is no faster."""
US_COARSE_M = 0.064
"""From this resolution on D_pf is that of an arm (verified: manuals of SICK M4000 and Banner SX5)."""
US_ARM_M = 0.9
"""D_pf where an arm reaches through before anything is detected (verified: the same)."""
US_PARALLEL_M = 1.2
"""D_pf of a field parallel to the floor, or one that can be reached over (verified: the same)."""

_ISO_CLAUSE = "derived from ISO 13855:{edition}, minimum distance"
_US_CLAUSE = "derived from OSHA 29 CFR 1910.217 and ANSI B11.19, safety distance"
_AROUND = 1e6
"""So many lengths of the line beside it nobody crosses it on the way."""
_ROUNDING_M = 1e-12
"""500 mm, worked out in m, is 0.5 m whatever the last bit says. All else would switch speeds on rounding."""


@dataclass(frozen=True)
class MinimumDistance:
    """A minimum distance and how it came about.

    Attributes:
        total_m: S, m.
        intrusion_m: C (2010), the reach D (2024) or D_pf (us), without the supplement Z, m.
        first_step_m: S with the speed of a hand, before the switch at 500 mm, m.
    """

    total_m: float
    intrusion_m: float
    first_step_m: float


def minimum_distance(
    edition: Edition,
    arrangement: Arrangement,
    stopping_time_s: float,
    *,
    resolution_m: float = 0.03,
    height_m: float = 0.0,
    supplement_m: float = 0.0,
    reach_m: float = 0.0,
    covered: bool = False,
) -> MinimumDistance:
    """S = K T + C (2010), S = K T + D + Z (2024), S = K T + D_pf + Z (us).

    Args:
        edition: Of ISO 13855, `2010` or `2024` (whose values come from free vendor guides); or `us`.
        arrangement: How the safeguard stands to the approach.
        stopping_time_s: T, overall stopping performance, s (not ms).
        resolution_m: d, smallest detected object, m.
        height_m: H, height of a field parallel to the floor, m.
        supplement_m: Z, 2024 and us, m.
        reach_m: Reach through the opening of a guard; us: also over beams, m.
        covered: Whether a two-hand control is covered.

    Raises:
        ValueError: The combination is one the standard excludes or the sources do not give.

    >>> minimum_distance("2010", "orthogonal", 0.32, resolution_m=0.014).total_m
    0.512
    """
    z = supplement_m
    if edition == "2010" and supplement_m:
        raise ValueError("supplement_m (Z) belongs to edition 2024 and to us")
    if edition == "us":
        depth = _us_depth_m(arrangement, resolution_m, reach_m)
        total = US_SPEED_M_S * stopping_time_s + depth + z
        return MinimumDistance(total, depth, total)
    if arrangement == "orthogonal":
        return _orthogonal(edition, stopping_time_s, resolution_m, z)
    if arrangement == "parallel":
        intrusion = _parallel_intrusion_m(edition, height_m, resolution_m)
    elif arrangement == "two_hand":
        if covered and edition == "2024":
            raise ValueError("for a covered two-hand control the sources give no value of edition 2024")
        intrusion = 0.0 if covered else 0.25 if edition == "2010" else 0.55
    elif arrangement == "interlocked_guard":
        intrusion = reach_m
    else:
        intrusion = 0.85
    total = WALKING_SPEED_M_S * stopping_time_s + intrusion + z
    return MinimumDistance(total, intrusion, total)


def _us_depth_m(arrangement: Arrangement, resolution_m: float, reach_m: float) -> float:
    """D_pf, how far somebody gets before being detected, m: 3.4 (d - 6.875 mm) through a fine field.

    >>> round(_us_depth_m("orthogonal", 0.014, 0.0), 6)
    0.024225
    """
    if arrangement == "orthogonal" and resolution_m < US_COARSE_M - _ROUNDING_M:
        return max(3.4 * (resolution_m - 0.006875), 0.0)
    if arrangement == "parallel":
        return US_PARALLEL_M
    if arrangement == "two_hand":  # nothing is reached through: both hands are at the control
        return 0.0
    return reach_m if arrangement == "interlocked_guard" else max(US_ARM_M, reach_m)


def _orthogonal(edition: Edition, t_s: float, d_m: float, z_m: float) -> MinimumDistance:
    fine_to_m = 0.04 if edition == "2010" else 0.055
    if d_m > fine_to_m + _ROUNDING_M:
        total = WALKING_SPEED_M_S * t_s + 0.85 + z_m
        return MinimumDistance(total, 0.85, total)
    # The standard is in mm: 8 (d - 14 mm); 2024 adds the row 208 mm + 12 (d - 40 mm) for d up to 55 mm.
    coarse = d_m > 0.04 + _ROUNDING_M
    reach = 0.208 + 12.0 * (d_m - 0.04) if coarse else max(8.0 * (d_m - 0.014), 0.0)
    first = HAND_SPEED_M_S * t_s + reach + z_m
    # The switch is on S with the intrusion in it; before adding that, a common mistake, it comes too late.
    if first > SWITCH_M + _ROUNDING_M:
        return MinimumDistance(max(WALKING_SPEED_M_S * t_s + reach + z_m, SWITCH_M), reach, first)
    # The row for coarse resolutions of 2024 asks for 500 mm at least, whatever the first step gives.
    return MinimumDistance(max(first, SWITCH_M if coarse else LEAST_M), reach, first)


def _parallel_intrusion_m(edition: Edition, height_m: float, resolution_m: float) -> float:
    if edition == "2024":
        return 1.2
    if height_m > 1.0:
        raise ValueError(f"height_m is {height_m:g} but a parallel field lies at most 1 m high")
    least = 15.0 * (resolution_m - 0.05)
    if height_m < least - _ROUNDING_M:
        raise ValueError(f"height_m is {height_m:g} but resolution {resolution_m:g} m needs {least:g} m")
    return max(0.85, 1.2 - 0.4 * height_m)


@dataclass(frozen=True)
class SafeguardDistance(LimitMonitor):
    """A sensing line is far enough from its hazard, and the hazard rests when somebody is past it.

    Measures:
        Once: the distance from `line` to `hazard` against the minimum distance, in m.
        For every robot and human: the robot's speed after the human crossed the line
        towards the hazard, from `stopping_time_s` later on or as soon as the human is
        within the intrusion distance of the hazard, until the human is back. Who is found
        behind the line when the log begins, or after a gap, counts as crossing it then.
    Violated when:
        The line is too near, or the robot then moves faster than standstill.
    Source:
        ISO 13855, editions 2010 and 2024, from manuals and free vendor guides. `us`: OSHA
        29 CFR 1910.217 and ANSI B11.19 as OSHA's own page and makers' guides (Rockwell,
        SICK, Banner) give them. The check at run time is our reading of both.
    """

    example: ClassVar[Mapping[str, Any]] = {
        "line": [[-2.0, 6.0], [2.0, 6.0]],
        "hazard": [[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]],
    }

    edition: Edition = parameter(
        "2010", source="2024 is known from free vendor guides only; us: OSHA and ANSI, likewise"
    )
    arrangement: Arrangement = parameter("orthogonal", source="set per cell")
    stopping_time_s: float = parameter(
        0.5, unit="s", above=0, at_most=20, source="T, overall stopping performance; measured per machine"
    )
    resolution_m: float = parameter(
        0.03, unit="m", at_least=0, at_most=1, source="d; data of the sensing device"
    )
    height_m: float = parameter(0.3, source="H of a field parallel to the floor; per cell", **LENGTH)
    supplement_m: float = parameter(0.0, source="Z, edition 2024 and us", **LENGTH)
    reach_m: float = parameter(0.0, source="reach through a guard, us: also over beams; per guard", **LENGTH)
    covered: bool = parameter(False, source="whether a two-hand control is covered")
    line: tuple[tuple[float, ...], ...] = parameter(
        (), unit="m", source="both ends [x, y] of the sensing line; required"
    )
    hazard: tuple[tuple[float, ...], ...] = parameter(
        (), unit="m", source="corners [x, y] of the hazard zone; required"
    )
    standstill_speed_m_s: float = parameter(
        STANDSTILL_SPEED_M_S, unit="m/s", at_least=0, at_most=20, source="catalogue, M7"
    )
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=60, source="catalogue, 1.4")
    t_on_s: float = parameter(0.0, unit="s", at_least=0, at_most=60, source="catalogue, 1.2")
    t_off_s: float = parameter(1.0, unit="s", at_least=0, at_most=60, source="catalogue, 1.2")

    subjects = pairs("robot", "human")
    wanted: ClassVar[Mapping[str, str]] = {"position/{human}": "m", "speed/{robot}": "m/s"}
    what, unit = "speed behind the line", "m/s"
    idle = "nobody was past the line for long enough"
    encounter = Encounter()
    reach = Reach("run")  # rest is due some time after the human crossed the line
    severities: ClassVar[Mapping[str, Measure]] = {
        "distance_m": Measure("m", meaning="from the sensing line to the hazard"),
        "minimum_distance_m": Measure("m", meaning="the least it may be"),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        self.minimum()
        check_polygon("hazard", self.hazard)
        ends = [tuple(end) for end in self.line]
        if ends and (len(ends) != 2 or any(len(end) != 2 for end in ends) or ends[0] == ends[1]):
            raise ValueError(f"line is {[list(end) for end in ends]!r}, not two different ends [x, y] in m")

    def minimum(self) -> MinimumDistance:
        """The minimum distance of these parameters."""
        return minimum_distance(
            self.edition,
            self.arrangement,
            self.stopping_time_s,
            resolution_m=self.resolution_m,
            height_m=self.height_m,
            supplement_m=self.supplement_m,
            reach_m=self.reach_m,
            covered=self.covered,
        )

    @property
    def clause(self) -> str:
        """Of the edition."""
        return _US_CLAUSE if self.edition == "us" else _ISO_CLAUSE.format(edition=self.edition)

    @property
    def lacks(self) -> str:
        """The line or the zone, where one is not given."""
        return "" if self.line and self.hazard else "the sensing line or the hazard zone is not given"

    @property
    def may_hide(self) -> tuple[dict[str, tuple[float, ...]], ...]:
        """A step through the middle of the line, or far around its end."""
        if self.lacks:
            return ()
        of_line, of_zone = _middle_m(self.line), _middle_m(self.hazard)
        just_past = of_line + _ROUNDING_M * (of_zone - of_line)
        a, b = (np.asarray(end, dtype=np.float64)[:2] for end in self.line)
        places = just_past, just_past + _AROUND * (b - a)
        return tuple({"position/{human}": (float(x_m), float(y_m), 0.0)} for x_m, y_m in places)

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """About the line itself, then for every pair where the robot moved, or that it did not."""
        if not self.lacks:
            yield self._line()
        yield from super().statements(trial)

    def _line(self) -> Finding:
        a, b = (np.asarray(end, dtype=np.float64) for end in self.line)
        distance = distance_between_m(a, b, self.hazard)
        needed = self.minimum().total_m
        return Finding(
            "trial",
            Verdict.of(distance - needed),
            f"the sensing line is {distance:.3f} m from the hazard (at least {needed:.3f} m)",
            robustness=distance - needed,
            unit="m",
            quantities={**no_severities("m/s"), "distance_m": distance, "minimum_distance_m": needed},
            clause=self.clause,
        )

    def past_line(
        self, t: FloatArray, position_m: FloatArray, max_gap_s: float | None = None
    ) -> tuple[BoolArray, FloatArray]:
        """Whether a human is past the line, and since when.

        Args:
            t: Sample times, shape (n,), s.
            position_m: Shape (n, 2 or 3), m.
            max_gap_s: What was before a longer gap is not known, s; `None`: as the monitor accepts.
        """
        longest_s = self.max_gap_s if max_gap_s is None else max_gap_s
        side, share = self._relative_to_line(position_m)
        beyond = side >= 0
        unseen = np.ones(len(t), dtype=bool)
        unseen[1:] = np.diff(t) > longest_s + TOLERANCE_S
        # Who is behind the line where the log or a stretch of it begins has crossed it at some time before.
        # When is not known; the latest it can be is now, so that what is missing violates nothing.
        entered = unseen & (share >= 0) & (share <= 1)
        when = np.array(t, dtype=np.float64)
        cross = np.flatnonzero(beyond[1:] & ~beyond[:-1] & ~unseen[1:])
        part = -side[cross] / (side[cross + 1] - side[cross])
        where = share[cross] + part * (share[cross + 1] - share[cross])
        through = (where >= 0) & (where <= 1)
        entered[cross[through] + 1] = True
        when[cross + 1] = t[cross] + part * (t[cross + 1] - t[cross])
        first = first_of_runs(t, beyond, longest_s)
        past: BoolArray = beyond & entered[first]
        return past, when[first]

    def _relative_to_line(self, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How far each point is on the hazard's side of the line, and where along it (0 to 1)."""
        a, b = (np.asarray(end, dtype=np.float64) for end in self.line)
        along, offset = b - a, position_m[:, :2] - a
        middle = _middle_m(self.hazard) - a
        side = along[0] * offset[:, 1] - along[1] * offset[:, 0]
        if along[0] * middle[1] - along[1] * middle[0] < 0:
            side = -side
        share = (offset[:, 0] * along[0] + offset[:, 1] * along[1]) / (
            along[0] * along[0] + along[1] * along[1]
        )
        return side, share

    def margin(self, signals: Watched) -> Bound:
        """Standstill - speed of the robot behind whom somebody is past the line, m/s."""
        position = signals["position/{human}"]
        past, since = self.past_line(signals.t, position, signals.max_gap_s)
        late = signals.t - since >= self.stopping_time_s - TOLERANCE_S
        near = -depth_inside_m(position, self.hazard) < self.minimum().intrusion_m
        return self.at_most(signals["speed/{robot}"], self.standstill_speed_m_s, where=past & (late | near))


def _middle_m(corners: Sequence[Sequence[float]]) -> FloatArray:
    """The middle of some corners on the floor, shape (2,), m."""
    axes = [*zip(*corners, strict=False)][:2]
    return np.array([exact_sum(axis) / len(axis) for axis in axes])
