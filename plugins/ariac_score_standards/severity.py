"""What every monitor measures: episodes, severities, exposure, blame (catalogue, section 1).

How to build a monitor. Watch signals (`watching`), compute for every sample what was
and what the limit is, and hand both to `limit_findings` as a `Bound`: it groups the
violating samples into episodes (open after `t_on_s` of truth, closed after `t_off_s`
of none), measures each (`time_in_violation_s`, depth, its integral, the same relative
to the limit), and yields one finding for each, or one that tells the closest moment
when there is none and no gap; before them what they rest on, from which a `Sampled`
monitor has its margins over time. `Meeting` says of a robot and a human who moved, who
closed in and for how long the human was exposed; `travelled_m` integrates speeds. Sample
k stands for [t_k, t_k+1): durations are sums of those, never counts of samples.
Parameters are declared with `ariac_score.parameter`, which carries unit, status and
source, and checked by `check_parameters`.

>>> margin_m, required_m = np.array([1.0, -0.5, 1.0]), np.array([2.0, 2.0, 2.0])
>>> watched = Watched(np.array([0.0, 0.1, 0.2]), {}, [], 0.2, {})
>>> (episode,) = episodes_below(watched, margin_m, required_m, t_on_s=0.0, t_off_s=1.0)
>>> {name: round(number, 6) for name, number in episode.quantities.items()}["depth_integral_m_s"]
0.05
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ariac_score import (
    Course,
    Finding,
    Sample,
    SignalNeed,
    Span,
    Trial,
    Verdict,
    episodes_where,
    sample_durations,
)
from ariac_score_standards.watching import BoolArray, FloatArray, Watched

STANDSTILL_SPEED_M_S = 0.01
"""Above this a robot moves (monitor catalogue, M7; ARIAC 2023 uses the same for AGVs)."""

EXPOSURE_DISTANCE_M = 5.0
"""Within this of a moving robot a human is exposed (catalogue, 1.3; our choice)."""

_DEPTH_NAMES: Mapping[str, tuple[str, str]] = {
    "m": ("depth_max_m", "depth_integral_m_s"),
    "m/s": ("excess_max_m_s", "excess_integral_m"),
    "rad": ("depth_max_rad", "depth_integral_rad_s"),
    "rad/s": ("excess_max_rad_s", "excess_integral_rad"),
    "N": ("excess_max_N", "excess_integral_N_s"),
    "Pa": ("excess_max_Pa", "excess_integral_Pa_s"),
    "s": ("excess_max_s", "excess_integral_s2"),
    "1": ("excess_max", "excess_integral_s"),
}
"""Names of the depth and of its integral, by unit of the limit."""


@dataclass(frozen=True)
class Episode:
    """One violation over time, with the severities of the monitor catalogue, section 1.3.

    Attributes:
        span: From its first to the end of its last violating sample.
        rows: Indices of its violating samples.
        worst: Row with the least margin.
        quantities: `time_in_violation_s`, depth and its integral (such as `depth_max_m` and
            `depth_integral_m_s`), `relative_depth_integral_s`, `relative_depth_max`.
    """

    span: Span
    rows: NDArray[np.intp]
    worst: int
    quantities: Mapping[str, float]


def episodes_below(
    watched: Watched, margin_m: FloatArray, required_m: FloatArray, *, t_on_s: float, t_off_s: float
) -> list[Episode]:
    """The episodes in which a distance falls short of what is required.

    Args:
        watched: The time base.
        margin_m: Distance less required distance, shape (n,), m; negative violates.
        required_m: Required distance, shape (n,), m.
        t_on_s: Shortest violation that counts, s.
        t_off_s: Pauses shorter than this are bridged, s.
    """
    return episodes_of(watched, margin_m < 0, margin_m, required_m, unit="m", t_on_s=t_on_s, t_off_s=t_off_s)


def episodes_of(
    watched: Watched,
    holds: BoolArray,
    margin: FloatArray,
    limit: FloatArray,
    *,
    unit: str,
    t_on_s: float,
    t_off_s: float,
) -> list[Episode]:
    """The episodes in which a limit is broken.

    Args:
        watched: The time base.
        holds: Where it is broken, shape (n,).
        margin: Signed distance to the limit, shape (n,); negative where broken.
        limit: The limit, shape (n,); depths relative to it count as 1 where it is 0.
        unit: Of margin and limit.
        t_on_s: Shortest violation that counts, s.
        t_off_s: Pauses shorter than this are bridged, s.
    """
    depth_name, integral_name = _DEPTH_NAMES.get(unit, ("depth_max", "depth_integral"))
    weights_s = sample_durations(watched.t, longest_s=watched.max_gap_s)
    broken = np.flatnonzero(holds)
    broken_t = watched.t[broken]
    found = []
    for span in episodes_where(watched.t, holds, t_on_s=t_on_s, t_off_s=t_off_s, longest_s=watched.max_gap_s):
        rows = broken[broken_t.searchsorted(span.start_s) : broken_t.searchsorted(span.end_s, side="right")]
        weight_s, depth, bound = weights_s[rows], np.maximum(-margin[rows], 0.0), limit[rows]
        relative = np.clip(np.divide(depth, bound, out=np.ones_like(depth), where=bound > 0), 0.0, 1.0)
        found.append(
            Episode(
                span,
                rows,
                int(rows[np.argmin(margin[rows])]),
                {
                    "time_in_violation_s": float(weight_s.sum()),
                    depth_name: float(depth.max()),
                    integral_name: float((depth * weight_s).sum()),
                    "relative_depth_max": float(relative.max()),
                    "relative_depth_integral_s": float((relative * weight_s).sum()),
                },
            )
        )
    return found


# One limit, judged from its samples to its findings ------------------------------------------


@dataclass(frozen=True)
class Bound:
    """What was, against what may be, sample by sample.

    Attributes:
        what: Name of what is measured, such as `speed`.
        actual: Measured, shape (n,).
        limit: Its limit, shape (n,); infinite where there is none.
        unit: Of both.
        at_most: Whether the limit is an upper one; equality always keeps it.
        applies: Where the limit applies, shape (n,); `None`: everywhere.
        evidence: Name under which the limit stands in the evidence; empty leaves it out.
    """

    what: str
    actual: FloatArray
    limit: FloatArray
    unit: str
    at_most: bool = False
    applies: BoolArray | None = None
    evidence: str = ""

    @property
    def margin(self) -> FloatArray:
        """Signed distance to the limit, negative where it is broken."""
        return self.limit - self.actual if self.at_most else self.actual - self.limit


@dataclass(frozen=True, eq=False)
class Seen:
    """One limit of one subject, as it was judged: its findings and its margins come from the same numbers.

    Attributes:
        subject: Whom it is about.
        watched: The signals.
        bound: What was, and what may be.
    """

    subject: str
    watched: Watched
    bound: Bound

    @property
    def course(self) -> Course:
        """The same over time; without a limit where it does not apply."""
        limit = np.where(self.limited, self.bound.limit, np.nan)
        return Course(
            self.subject,
            self.bound.what,
            self.bound.unit,
            self.watched.t,
            self.bound.actual,
            limit,
            self.bound.at_most,
            self.watched.max_gap_s,
        )

    @property
    def limited(self) -> BoolArray:
        """Where there is a limit, shape (n,)."""
        limited: BoolArray = np.isfinite(self.bound.limit)
        return limited if self.bound.applies is None else limited & self.bound.applies


Said = Finding | Seen
"""What is said of a trial: findings, and before them what they rest on."""


class Sampled:
    """A monitor that judges sample by sample, so that it knows its margin at every one.

    It gives everything in `_say`; `watch` takes the findings of it, `margins` the rest.
    """

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """Findings about every subject: its violations, or its closest moment."""
        return (said for said in self._say(trial) if isinstance(said, Finding))

    def margins(self, trial: Trial) -> Iterator[Course]:
        """What was beside what may be at every sample, for every subject and limit."""
        return (said.course for said in self._say(trial) if isinstance(said, Seen))

    def _say(self, trial: Trial) -> Iterator[Said]:
        raise NotImplementedError


@dataclass(frozen=True)
class Rules:
    """How samples become findings.

    Attributes:
        clause: Where the standard asks for it.
        t_on_s: Shortest violation that counts, s.
        t_off_s: Pauses shorter than this are bridged, s.
        idle: What to say when the limit never applied.
        critical: Whether a violation is a critical event.
    """

    clause: str
    t_on_s: float = 0.0
    t_off_s: float = 1.0
    idle: str = "the limit never applied"
    critical: bool = False


@dataclass(frozen=True)
class Told:
    """What a monitor adds to the finding about an episode."""

    quantities: Mapping[str, float] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)

    def __add__(self, other: Told) -> Told:
        """Both."""
        return Told({**self.quantities, **other.quantities}, {**self.labels, **other.labels})


def _nothing_more(_episode: Episode | None) -> Told:
    return Told()


def no_severities(unit: str) -> dict[str, float]:
    """The severities of an episode that was none, so that prices may speak of them in a clean trial."""
    depth_name, integral_name = _DEPTH_NAMES.get(unit, ("depth_max", "depth_integral"))
    names = (
        "time_in_violation_s",
        depth_name,
        integral_name,
        "relative_depth_max",
        "relative_depth_integral_s",
    )
    return dict.fromkeys(names, 0.0)


def limit_findings(
    subject: str,
    watched: Watched,
    bound: Bound,
    rules: Rules,
    more: Callable[[Episode | None], Told] = _nothing_more,
) -> Iterator[Said]:
    """One finding for each episode beyond a limit; else the closest moment, if no gap hides one.

    What they rest on comes first.

    Args:
        subject: Whom it is about.
        watched: The signals.
        bound: What was, and what may be.
        rules: How samples become findings.
        more: What else to tell about an episode, or (given `None`) about a subject without any.
    """
    seen = Seen(subject, watched, bound)
    yield seen
    margin, limited = bound.margin, seen.limited
    episodes = episodes_of(
        watched,
        limited & (margin < 0),
        margin,
        bound.limit,
        unit=bound.unit,
        t_on_s=rules.t_on_s,
        t_off_s=rules.t_off_s,
    )
    for episode in episodes:
        yield _broken(subject, watched, bound, rules, episode, more(episode))
    if not episodes and not watched.gaps:
        yield _kept(subject, watched, bound, rules, limited, more(None))


def _broken(
    subject: str, watched: Watched, bound: Bound, rules: Rules, episode: Episode, told: Told
) -> Finding:
    worst = episode.worst
    relation = "at most" if bound.at_most else "at least"
    return Finding(
        subject,
        Verdict.VIOLATED,
        f"{bound.what} beyond its limit for {episode.quantities['time_in_violation_s']:.2f} s; at worst "
        f"{bound.actual[worst]:.3f} {bound.unit} ({relation} {bound.limit[worst]:.3f}), "
        f"at {watched.t[worst]:.3f} s",
        span=episode.span,
        robustness=float(bound.margin[worst]),
        unit=bound.unit,
        quantities={**episode.quantities, **told.quantities},
        labels=told.labels,
        evidence=_evidence(watched, bound, worst, subject),
        clause=rules.clause,
        critical=rules.critical,
    )


def _kept(
    subject: str, watched: Watched, bound: Bound, rules: Rules, limited: BoolArray, told: Told
) -> Finding:
    rows = np.flatnonzero(limited)
    if not len(rows):
        return Finding.not_applicable(subject, rules.idle, clause=rules.clause)
    closest = int(rows[np.argmin(bound.margin[rows])])
    relation = "at most" if bound.at_most else "at least"
    return Finding(
        subject,
        Verdict.SATISFIED,
        f"{bound.what} keeps its limit; closest {bound.actual[closest]:.3f} {bound.unit} "
        f"({relation} {bound.limit[closest]:.3f}), at {watched.t[closest]:.3f} s",
        robustness=float(bound.margin[closest]),
        unit=bound.unit,
        quantities={**no_severities(bound.unit), **told.quantities},
        labels=told.labels,
        evidence=_evidence(watched, bound, closest, subject),
        clause=rules.clause,
    )


def _evidence(watched: Watched, bound: Bound, row: int, subject: str) -> tuple[Sample, ...]:
    if not bound.evidence:
        return watched.samples(row)
    limit = Sample(f"{bound.evidence}/{subject}", float(watched.t[row]), float(bound.limit[row]), bound.unit)
    return (*watched.samples(row), limit)


# Blame, exposure, ways ------------------------------------------------------------------------


def closing_by(robot_m_s: float, human_m_s: float, *, standstill_m_s: float = STANDSTILL_SPEED_M_S) -> str:
    """Who closes the distance: `robot`, `human`, `both` or `neither`; `unknown` for NaN.

    Args:
        robot_m_s: Speed of the robot towards the human, m/s.
        human_m_s: Speed of the human towards the robot, m/s.
        standstill_m_s: A speed up to this closes nothing, m/s.

    >>> closing_by(0.5, 0.0), closing_by(-0.5, 1.2), closing_by(0.3, 0.3)
    ('robot', 'human', 'both')
    """
    if np.isnan(robot_m_s) or np.isnan(human_m_s):
        return "unknown"
    robot, human = robot_m_s > standstill_m_s, human_m_s > standstill_m_s
    if robot and human:
        return "both"
    return "robot" if robot else "human" if human else "neither"


def robot_moving(speed_m_s: FloatArray, standstill_m_s: float = STANDSTILL_SPEED_M_S) -> str:
    """Whether a robot moved at one of some samples: `yes`, `no`; `unknown` where NaN leaves it open.

    >>> robot_moving(np.array([0.0, 0.02])), robot_moving(np.array([0.01])), robot_moving(np.array([np.nan]))
    ('yes', 'no', 'unknown')
    """
    if (speed_m_s > standstill_m_s).any():
        return "yes"
    return "unknown" if np.isnan(speed_m_s).any() else "no"


APART = "separation/{robot}/{human}"
SPEED = "speed/{robot}"
TOWARDS_HUMAN = "approach_speed_robot/{robot}/{human}"
TOWARDS_ROBOT = "approach_speed_human/{robot}/{human}"
MEETING: Mapping[str, str] = {APART: "m", SPEED: "m/s", TOWARDS_HUMAN: "m/s", TOWARDS_ROBOT: "m/s"}
"""Unit by template of what tells who is to blame and who was exposed, where a log has it."""


def meeting_needs(max_gap_s: float, *needed: str) -> Iterator[SignalNeed]:
    """What `Meeting` reads besides the quantities that a monitor needs anyway."""
    for template, unit in MEETING.items():
        quantity = template.partition("/")[0]
        if quantity not in needed:
            yield SignalNeed(quantity, unit, max_gap_s, optional=True)


@dataclass(frozen=True)
class Meeting:
    """A robot and a human over time: who is to blame, and who is exposed. NaN where the log does not tell.

    Attributes:
        distance_m: How far apart they are, shape (n,), m.
        robot_speed_m_s: Scalar speed of the robot, m/s.
        robot_towards_m_s: Its speed towards the human, m/s.
        human_towards_m_s: Speed of the human towards the robot, m/s.
        standstill_m_s: Above this something moves, m/s.
        within_m: Within this of the moving robot the human is exposed, m.
    """

    distance_m: FloatArray
    robot_speed_m_s: FloatArray
    robot_towards_m_s: FloatArray
    human_towards_m_s: FloatArray
    standstill_m_s: float = STANDSTILL_SPEED_M_S
    within_m: float = EXPOSURE_DISTANCE_M

    @classmethod
    def of(
        cls,
        watched: Watched,
        distance: str = APART,
        *,
        standstill_m_s: float = STANDSTILL_SPEED_M_S,
        within_m: float = EXPOSURE_DISTANCE_M,
    ) -> Meeting:
        """What is watched of them, by the templates of `MEETING` or with another distance."""
        unknown = np.full(len(watched.t), np.nan)
        apart, speed, robot, human = (
            watched[name] if name in watched.names else watched.extra.get(name, unknown)
            for name in (distance, SPEED, TOWARDS_HUMAN, TOWARDS_ROBOT)
        )
        return cls(apart, speed, robot, human, standstill_m_s, within_m)

    def labels(self, rows: NDArray[np.intp], *, before: bool = False) -> dict[str, str]:
        """Whether the robot moved in the rows of an episode, and who closed in at the first of them.

        Args:
            rows: Of the episode.
            before: Ask the row before the first: at a contact nothing approaches any more.
        """
        onset = max(int(rows[0]) - before, 0)
        robot, human = float(self.robot_towards_m_s[onset]), float(self.human_towards_m_s[onset])
        return {
            "robot_moving": robot_moving(self.robot_speed_m_s[rows], self.standstill_m_s),
            "closing_by": closing_by(robot, human, standstill_m_s=self.standstill_m_s),
        }

    def exposure(self, watched: Watched) -> dict[str, float]:
        """`exposure_s` of the whole trial, where the log tells it of every sample; else nothing."""
        if not (np.isfinite(self.distance_m) & np.isfinite(self.robot_speed_m_s)).all():
            return {}
        exposed = (self.distance_m <= self.within_m) & (self.robot_speed_m_s > self.standstill_m_s)
        weights_s = sample_durations(watched.t, longest_s=watched.max_gap_s)
        return {"exposure_s": float(weights_s[exposed].sum())}


def travelled_m(t: FloatArray, speed_m_s: FloatArray, span: Span) -> float:
    """The way covered during a span, by straight lines between the samples of a speed, m.

    Speeds inside the span alone count: where samples do not reach its ends, those
    ends add nothing.

    >>> travelled_m(np.array([0.0, 1.0, 2.0]), np.array([1.0, 1.0, 0.0]), Span(0.5, 2.0))
    1.0
    """
    if not len(t):
        return 0.0
    start, end = np.clip([span.start_s, span.end_s], t[0], t[-1])
    inside = t[(t > start) & (t < end)]
    at = np.concatenate(([start], inside, [end]))
    speeds = np.interp(at, t, speed_m_s)
    return float((np.diff(at) * (speeds[1:] + speeds[:-1]) / 2.0).sum())


def covered_share(covered_s: float, exposure_time_s: float) -> float:
    """Share of the exposure for which signals were present; 1 when there was no exposure.

    >>> covered_share(9.0, 10.0)
    0.9
    """
    return covered_s / exposure_time_s if exposure_time_s > 0 else 1.0


def closing_energy_j(reduced_mass_kg: float, closing_m_s: FloatArray) -> FloatArray:
    """Energy of the two bodies moving against each other: mu v^2 / 2, shape (n,), J."""
    closing = np.maximum(closing_m_s, 0.0)
    return 0.5 * reduced_mass_kg * closing * closing
