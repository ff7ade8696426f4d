"""How well a pose is attained, after ISO 9283 (arms) and ISO 18646-2 (mobile robots)."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from ariac_score import (
    Finding,
    FloatArray,
    Limit,
    Measure,
    MissingSignalError,
    Signal,
    SignalNeed,
    Trial,
    Verdict,
    check_parameters,
    exact_sum,
    parameter,
)
from ariac_score.monitors import Subject, bodies, nobody, shown_within_s

ATTAINED = "pose_attained"
"""Event kind: a body or link (its subject) has attained a commanded pose; the detail may name the pose."""


@dataclass(frozen=True)
class PosePerformance:
    """Accuracy and repeatability of n attained positions of one commanded pose.

    Attributes:
        n: Attained positions.
        mean_m: Their mean (bar), m.
        accuracy_m: AP, from the commanded position to the mean, m.
        spread_mean_m: Mean of the distances from the mean (l_bar), m.
        spread_deviation_m: Standard deviation of these with n - 1 (S_l), m; NaN below two.
        repeatability_m: RP = l_bar + 3 S_l, m; NaN below two.
    """

    part_of: ClassVar[str] = "task"

    n: int
    mean_m: tuple[float, ...]
    accuracy_m: float
    spread_mean_m: float
    spread_deviation_m: float
    repeatability_m: float


def pose_performance(attained_m: FloatArray, commanded_m: FloatArray) -> PosePerformance:
    """Accuracy and repeatability of positions, shape (n, 3), of one commanded position, shape (3,).

    >>> pose_performance(np.array([[1.0, 0, 0], [-1.0, 0, 0]]), np.zeros(3)).repeatability_m
    1.0
    """
    mean = np.array([_mean(column) for column in attained_m.T])
    spread = _norms(attained_m - mean)
    deviation = _deviation(spread)
    return PosePerformance(
        len(attained_m),
        tuple(float(v) for v in mean),
        float(_norms((mean - commanded_m)[np.newaxis])[0]),
        _mean(spread),
        deviation,
        _mean(spread) + 3.0 * deviation,  # may exceed every single distance: one outlier widens S_l
    )


def angle_performance(attained_rad: FloatArray, commanded_rad: float) -> tuple[float, float]:
    """AP and RP of an angle: mean less command, and 3 standard deviations; angles are unwrapped, rad.

    >>> ap, rp = angle_performance(np.array([3.1, -3.1]), np.pi)
    >>> bool(abs(ap) < 0.1)
    True
    """
    errors = np.asarray(attained_rad, dtype=np.float64) - commanded_rad
    errors = np.mod(errors + np.pi, 2.0 * np.pi) - np.pi
    # Into one turn first, so that a command near pi is not missed by 2 pi; then without the jump, so that
    # headings on both sides of it have a mean between them.
    errors = np.unwrap(errors)
    return _mean(errors), 3.0 * _deviation(errors)


def _mean(numbers: FloatArray) -> float:
    return exact_sum(numbers) / len(numbers)


def _deviation(numbers: FloatArray) -> float:
    """The standard deviation with n - 1; NaN below two."""
    if len(numbers) < 2:
        return math.nan
    return math.sqrt(exact_sum((numbers - _mean(numbers)) ** 2) / (len(numbers) - 1))


def _norms(vectors: FloatArray) -> FloatArray:
    """Lengths of vectors of shape (n, 3)."""
    x, y, z = vectors.T
    lengths: FloatArray = np.sqrt(x * x + y * y + z * z)
    return lengths


_LIMIT: Any = {"at_least": 0, "source": "for the task to set"}


@dataclass(frozen=True)
class PoseAttained:
    """A machine comes back to one commanded pose, near it and always the same.

    Measures:
        For every body of `kind` (or its link) the positions at its events
        `pose_attained` (of `goal`, where given): accuracy AP and repeatability RP in
        m, the accuracy also along each axis, and in rad where a heading is commanded.
        RP is not the largest deviation: one outlier can push it above every single one.
    Violated when:
        AP or RP exceeds a limit that is set. Without limits nothing is violated.
    Source:
        ISO 9283: AP, RP = l_bar + 3 S_l, 30 cycles (fewer are taken here, with their number);
        for angles from memory.
    """

    in_gaps: ClassVar[str] = "blunt"
    example: ClassVar[Mapping[str, Any]] = {
        "link": "tcp",
        "commanded_m": [1.5, 1.5, 1.5],
        "max_accuracy_m": 0.5,
        "max_repeatability_m": 1.0,
    }

    kind: Literal["robot", "agv"] = parameter("robot", source="which machines")
    link: str = parameter("", source="link that attains the pose; empty: the origin")
    goal: str = parameter("", source="detail of the events that count; empty: all")
    commanded_m: tuple[float, ...] = parameter((), unit="m", source="x, y, z; required")
    commanded_heading_rad: float | None = parameter(
        None, unit="rad", at_least=-100, at_most=100, source="for the task"
    )
    max_accuracy_m: float | None = parameter(None, unit="m", **_LIMIT)
    max_repeatability_m: float | None = parameter(None, unit="m", **_LIMIT)
    max_heading_accuracy_rad: float | None = parameter(None, unit="rad", **_LIMIT)
    max_heading_repeatability_rad: float | None = parameter(None, unit="rad", **_LIMIT)
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=60, source="catalogue, 1.4")

    _clause = "derived from ISO 9283, pose accuracy and repeatability"

    measures: ClassVar[Mapping[str, Measure]] = {
        "attained": Measure("count", meaning="attained positions"),
        "accuracy_m": Measure("m", meaning="AP, from the commanded position to the mean"),
        "repeatability_m": Measure("m", meaning="RP"),
        "heading_accuracy_rad": Measure("rad", meaning="AP of the heading"),
        "heading_repeatability_rad": Measure("rad", meaning="RP of the heading"),
        **{f"accuracy_{axis}_m": Measure("m", meaning=f"mean less commanded {axis}") for axis in "xyz"},
    }

    def __post_init__(self) -> None:
        check_parameters(self)
        if len(self.commanded_m) not in (0, 3):
            raise ValueError(f"commanded_m is {list(self.commanded_m)!r}, not [x, y, z] in m")
        heading = (self.max_heading_accuracy_rad, self.max_heading_repeatability_rad)
        if heading != (None, None) and self.commanded_heading_rad is None:
            raise ValueError("a limit of the heading is given, but no commanded_heading_rad")

    def needs(self) -> Iterator[SignalNeed]:
        """Positions, and headings where one is commanded."""
        yield SignalNeed("position", "m", self.max_gap_s)
        if self.commanded_heading_rad is not None:
            yield SignalNeed("heading", "rad", self.max_gap_s)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """One finding for each body."""
        subjects = bodies(self.kind).of(trial.bodies)
        if not subjects:
            yield nobody(trial, (self.kind,), self._clause)
        for subject in subjects:
            try:
                yield self._judge(trial, subject)
            except MissingSignalError as missing:  # what one machine lacks leaves the others to be judged
                yield self._open(trial, self._point(subject), missing.cause)

    def _point(self, subject: Subject) -> str:
        return f"{subject.name}::{self.link}" if self.link else subject.name

    def _times(self, trial: Trial, body: str, point: str) -> FloatArray:
        """When the pose was attained; the subject of the events may be the body or the link itself."""
        window = trial.window
        about = [e for e in trial.events_of(ATTAINED) if e.subject in ("", body, point)]
        return np.array(
            [
                e.t_s
                for e in sorted(about)
                if (not self.goal or e.detail == self.goal)
                and (window is None or window.start_s <= e.t_s <= window.end_s)
            ]
        )

    def _judge(self, trial: Trial, subject: Subject) -> Finding:
        point = self._point(subject)
        times = self._times(trial, subject.name, point)
        if not self.commanded_m:
            return self._open(trial, point, "no commanded position is given")
        if not len(times):
            if ATTAINED in trial.witnessed:
                return Finding.not_applicable(point, "the pose was never attained", clause=self._clause)
            return self._open(trial, point, "the log does not show when the pose was attained")
        signal = trial.signal(f"position/{point}", unit="m")
        if not signal.covers(times, max_gap_s=self._shown_within_s(trial, signal)).all():
            return self._open(trial, point, f"'position/{point}' is missing where the pose was attained")
        found = pose_performance(signal.at(times), np.array(self.commanded_m))
        limits = [Limit("accuracy", found.accuracy_m, "m", at_most=self.max_accuracy_m)]
        limits.append(Limit("repeatability", found.repeatability_m, "m", at_most=self.max_repeatability_m))
        if self.commanded_heading_rad is not None:
            heading = trial.signal(f"heading/{point}", unit="rad")
            if not heading.covers(times, max_gap_s=self._shown_within_s(trial, heading)).all():
                return self._open(trial, point, f"'heading/{point}' is missing where the pose was attained")
            ap, rp = angle_performance(heading.at(times), self.commanded_heading_rad)
            limits.append(Limit("heading accuracy", abs(ap), "rad", at_most=self.max_heading_accuracy_rad))
            limits.append(
                Limit("heading repeatability", rp, "rad", at_most=self.max_heading_repeatability_rad)
            )
        return self._finding(trial, point, found, limits)

    def _shown_within_s(self, trial: Trial, signal: Signal) -> float:
        """How far apart samples may be for a pose between them; where every interval is bounded none is."""
        every = trial.between is not None and trial.between.every
        return 0.0 if every else shown_within_s(signal, self.max_gap_s)

    def _finding(self, trial: Trial, point: str, found: PosePerformance, limits: list[Limit]) -> Finding:
        limited = [limit for limit in limits if limit.at_most is not None]
        known = [limit for limit in limited if not math.isnan(limit.value)]
        broken = [limit for limit in known if not limit.kept]
        if len(known) < len(limited) and not broken:
            return self._open(trial, point, "one attained pose has no repeatability")
        quantities = {
            f"{limit.what.replace(' ', '_')}_{limit.unit}": limit.value
            for limit in limits
            if not math.isnan(limit.value)
        }
        for axis, mean_m, commanded_m in zip("xyz", found.mean_m, self.commanded_m, strict=True):
            quantities[f"accuracy_{axis}_m"] = mean_m - commanded_m
        shown = ", ".join(
            f"{limit.what} {limit.value:.6g} {limit.unit}"
            + (f" (at most {limit.at_most:g})" if limit in broken else "")
            for limit in limits
            if not math.isnan(limit.value)
        )
        decisive = next(iter(broken or known), None)
        return Finding(
            point,
            Verdict.VIOLATED if broken else Verdict.SATISFIED,
            f"{found.n} attained: {shown}",
            robustness=decisive.margin if decisive else None,
            unit=decisive.unit if decisive else "",
            quantities={"attained": float(found.n), **quantities},
            clause=self._clause,
        )

    def _open(self, trial: Trial, point: str, message: str) -> Finding:
        return Finding.inconclusive(point, message, span=trial.window, clause=self._clause)
