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

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ariac_score import (
    Course,
    Episodes,
    Finding,
    Sample,
    SignalNeed,
    Span,
    Total,
    Trial,
    Verdict,
    episodes_where,
    exact_sum,
    sample_durations,
)
from ariac_score_standards.watching import BoolArray, FloatArray, Watched, Watching

if TYPE_CHECKING:
    from numpy.typing import NDArray

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
                    "time_in_violation_s": exact_sum(weight_s),
                    depth_name: float(depth.max()),
                    integral_name: exact_sum(depth * weight_s),
                    "relative_depth_max": float(relative.max()),
                    "relative_depth_integral_s": exact_sum(relative * weight_s),
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


Judging = Callable[[Watched], Bound]
"""What was, and what may be, in one window; windows come one after the other."""


@dataclass(frozen=True, eq=False)
class Seen:
    """One limit of one subject, as it was judged: its findings and its margins come from the same numbers.

    Attributes:
        subject: Whom it is about.
        watched: The signals, window by window.
        begin: How each window is judged, once through the trial.
        apart: Whether a window can be judged without those before it.
    """

    subject: str
    watched: Iterable[Watched]
    begin: Callable[[], Judging]
    apart: bool = True

    @classmethod
    def at_once(cls, subject: str, watched: Watched, bound: Bound) -> Seen:
        """Of something that was judged as a whole."""
        return cls(subject, [watched], lambda: lambda _watched: bound)

    @property
    def course(self) -> Course:
        """The same over time; without a limit where it does not apply."""
        first = next(self._courses())
        if next(iter(self.watched)).following is None:
            return first
        return Course.late(
            self.subject,
            first.what,
            first.unit,
            self._courses,
            times=self._times,
            max_gap_s=first.max_gap_s,
            at_most=first.at_most,
        )

    def _courses(self) -> Iterator[Course]:
        judge = self.begin()
        return (_course_of(self.subject, watched, judge(watched)) for watched in self.watched)

    def _times(self) -> Iterator[FloatArray]:
        return (watched.t for watched in self.watched)


def limited_by(bound: Bound) -> BoolArray:
    """Where there is a limit, shape (n,)."""
    limited: BoolArray = np.isfinite(bound.limit)
    return limited if bound.applies is None else limited & bound.applies


def _course_of(subject: str, watched: Watched, bound: Bound) -> Course:
    """What was beside what may be, of a judged window."""
    limit = np.where(limited_by(bound), bound.limit, np.nan)
    return Course(
        subject,
        bound.what,
        bound.unit,
        watched.t,
        bound.actual,
        limit,
        bound.at_most,
        watched.max_gap_s,
    )


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

    What they rest on comes first. All samples are judged at once; see `findings_of` for windows.

    Args:
        subject: Whom it is about.
        watched: The signals.
        bound: What was, and what may be.
        rules: How samples become findings.
        more: What else to tell about an episode, or (given `None`) about a subject without any.
    """
    yield Seen.at_once(subject, watched, bound)
    margin, limited = bound.margin, limited_by(bound)
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
        moment = Moment.of(watched, bound, episode.worst, subject)
        yield broken(subject, moment, rules, episode.span, episode.quantities, more(episode))
    if not episodes and not watched.gaps:
        rows = np.flatnonzero(limited)
        closest = int(rows[np.argmin(margin[rows])]) if len(rows) else None
        at_best = None if closest is None else Moment.of(watched, bound, closest, subject)
        yield kept(subject, at_best, rules, more(None) if at_best else Told())


@dataclass(frozen=True)
class Moment:
    """One sample beside its limit: the worst of an episode, or the closest of all.

    Attributes:
        what: Name of what is measured.
        t_s: When, s.
        actual: What was.
        limit: What may be.
        margin: Signed distance to the limit.
        unit: Of these.
        at_most: Whether the limit is an upper one.
        evidence: What was measured then.
    """

    what: str
    t_s: float
    actual: float
    limit: float
    margin: float
    unit: str
    at_most: bool
    evidence: tuple[Sample, ...]

    @classmethod
    def of(cls, watched: Watched, bound: Bound, row: int, subject: str) -> Moment:
        """That of one row."""
        return cls(
            bound.what,
            float(watched.t[row]),
            float(bound.actual[row]),
            float(bound.limit[row]),
            float(bound.margin[row]),
            bound.unit,
            bound.at_most,
            _evidence(watched, bound, row, subject),
        )

    @property
    def relation(self) -> str:
        """The limit in words."""
        return f"{'at most' if self.at_most else 'at least'} {self.limit:.3f}"


def broken(
    subject: str, worst: Moment, rules: Rules, span: Span, quantities: Mapping[str, float], told: Told
) -> Finding:
    """The finding about an episode."""
    return Finding(
        subject,
        Verdict.VIOLATED,
        f"{worst.what} beyond its limit for {quantities['time_in_violation_s']:.2f} s; at worst "
        f"{worst.actual:.3f} {worst.unit} ({worst.relation}), at {worst.t_s:.3f} s",
        span=span,
        robustness=worst.margin,
        unit=worst.unit,
        quantities={**quantities, **told.quantities},
        labels=told.labels,
        evidence=worst.evidence,
        clause=rules.clause,
        critical=rules.critical,
    )


def kept(subject: str, closest: Moment | None, rules: Rules, told: Told) -> Finding:
    """The finding where there was no episode."""
    if closest is None:
        return Finding.not_applicable(subject, rules.idle, clause=rules.clause)
    return Finding(
        subject,
        Verdict.SATISFIED,
        f"{closest.what} keeps its limit; closest {closest.actual:.3f} {closest.unit} "
        f"({closest.relation}), at {closest.t_s:.3f} s",
        robustness=closest.margin,
        unit=closest.unit,
        quantities={**no_severities(closest.unit), **told.quantities},
        labels=told.labels,
        evidence=closest.evidence,
        clause=rules.clause,
    )


def _evidence(watched: Watched, bound: Bound, row: int, subject: str) -> tuple[Sample, ...]:
    if not bound.evidence:
        return watched.samples(row)
    limit = Sample(f"{bound.evidence}/{subject}", float(watched.t[row]), float(bound.limit[row]), bound.unit)
    return (*watched.samples(row), limit)


# The same window by window ---------------------------------------------------------------------


class Gathered:
    """What is gathered over the windows of an episode, to be told in its finding; as it is, nothing."""

    def take(self, watched: Watched, bound: Bound, rows: NDArray[np.intp]) -> None:
        """Rows of the episode, in order; at least one."""

    def told(self) -> Told:
        """What there is to tell."""
        return Told()


@dataclass(frozen=True)
class Violation:
    """An episode of a limit that was judged window by window.

    Attributes:
        span: From its first to the end of its last violating sample.
        worst: Its sample with the least margin.
        quantities: As of `Episode`.
        told: What was gathered besides.
    """

    span: Span
    worst: Moment
    quantities: Mapping[str, float]
    told: Told


class Judged:
    """A limit over all windows: its episodes, and the moment closest to it.

    The windows are gone through once, and those with violations once more: what is held
    does not grow with the trial, for sums are told how many numbers they will get.

    Args:
        seen: Whose limit, and how it is judged.
        rules: How samples become findings.
        broken: Where the limit is broken; by default where the margin is negative.
        gathered: For each episode what gathers what else is told about it.
        handed: Whether windows are handed to `take`, and `end` is called; by default it goes through them.
        approached: Whether the closest moment is looked for.
    """

    def __init__(
        self,
        seen: Seen,
        rules: Rules,
        *,
        broken: Callable[[Bound], BoolArray] | None = None,
        gathered: Callable[[], Gathered] = Gathered,
        handed: bool = False,
        approached: bool = True,
    ) -> None:
        self._seen, self._rules, self._gathered, self._approached = seen, rules, gathered, approached
        self._broken = broken or (lambda bound: limited_by(bound) & (bound.margin < 0))
        self.closest: Moment | None = None
        self._judge, self._episodes = seen.begin(), Episodes()
        self._last: tuple[FloatArray, Bound] | None = None
        if not handed:
            for watched in seen.watched:
                self.take(watched)
            self.end()

    def take(self, watched: Watched) -> None:
        """Judge the next window."""
        if self._last is None:
            t_on_s, t_off_s = self._rules.t_on_s, self._rules.t_off_s
            self._episodes = Episodes(t_on_s=t_on_s, t_off_s=t_off_s, longest_s=watched.max_gap_s)
        bound = self._judge(watched)
        self._last = watched.t, bound
        self._episodes.take(watched.t, self._broken(bound))
        if self._approached:
            self._approach(watched, bound)

    def end(self) -> None:
        """All windows were taken."""
        self._stretches = self._episodes.end()
        self.violated = bool(self._stretches)

    @property
    def lasting(self) -> list[tuple[Span, float]]:
        """The spans of the episodes, each with the time of its last violating sample."""
        return [(one.span, one.last_s) for one in self._stretches]

    def _known(self, watched: Watched) -> Bound | None:
        """What was judged last, if that is all there is: short trials are one window."""
        return self._last[1] if self._last is not None and self._last[0] is watched.t else None

    def _approach(self, watched: Watched, bound: Bound) -> None:
        """Note the closest moment so far; of equal ones the first."""
        margin = bound.margin
        rows = np.flatnonzero(limited_by(bound))
        if len(rows) < len(margin):
            margin = margin[rows]
        if not len(rows):
            return
        least = int(np.argmin(margin))
        if self.closest is None or margin[least] < self.closest.margin:
            self.closest = Moment.of(watched, bound, int(rows[least]), self._seen.subject)

    def violations(self) -> Iterator[Violation]:
        """The episodes in time order."""
        waiting = [_Severities(one.span, one.samples, self._gathered()) for one in self._stretches]
        judge = self._seen.begin()
        first = 0
        for watched in self._seen.watched if waiting else ():
            end_s = float(watched.t[-1])
            beside = waiting[first].span.start_s > end_s
            if beside and self._seen.apart:
                continue
            bound = self._known(watched) or judge(watched)
            if beside:
                continue
            rows = np.flatnonzero(self._broken(bound))
            times = watched.t[rows]
            for number in range(first, len(waiting)):
                span = waiting[number].span
                if span.start_s > end_s:
                    break
                own = rows[times.searchsorted(span.start_s) : times.searchsorted(span.end_s, side="right")]
                if len(own):
                    waiting[number].take(watched, bound, own, self._seen.subject)
            while waiting[first].complete:
                yield waiting[first].violation()
                first += 1
                if first == len(waiting):
                    return


class _Severities:
    """The severities of one episode, as its samples come."""

    def __init__(self, span: Span, samples: int, gathered: Gathered) -> None:
        self.span, self._left, self._gathered = span, samples, gathered
        self._weight_s, self._integral, self._relative_s = Total(samples), Total(samples), Total(samples)
        self._deepest, self._relative = -np.inf, -np.inf
        self._worst: Moment | None = None

    @property
    def complete(self) -> bool:
        return self._left <= 0

    def take(self, watched: Watched, bound: Bound, rows: NDArray[np.intp], subject: str) -> None:
        self._left -= len(rows)
        margin, limit, weight_s = bound.margin[rows], bound.limit[rows], watched.durations_s[rows]
        depth = np.maximum(-margin, 0.0)
        relative = np.clip(np.divide(depth, limit, out=np.ones_like(depth), where=limit > 0), 0.0, 1.0)
        self._weight_s.take(weight_s)
        self._integral.take(depth * weight_s)
        self._relative_s.take(relative * weight_s)
        self._deepest = max(self._deepest, float(depth.max()))
        self._relative = max(self._relative, float(relative.max()))
        least = int(np.argmin(margin))
        if self._worst is None or margin[least] < self._worst.margin:
            self._worst = Moment.of(watched, bound, int(rows[least]), subject)
        self._gathered.take(watched, bound, rows)

    def violation(self) -> Violation:
        assert self._worst is not None  # an episode has a sample
        depth_name, integral_name = _DEPTH_NAMES.get(self._worst.unit, ("depth_max", "depth_integral"))
        quantities = {
            "time_in_violation_s": self._weight_s.value,
            depth_name: self._deepest,
            integral_name: self._integral.value,
            "relative_depth_max": self._relative,
            "relative_depth_integral_s": self._relative_s.value,
        }
        return Violation(self.span, self._worst, quantities, self._gathered.told())


def findings_of(
    subject: str,
    watched: Watching,
    begin: Callable[[], Judging],
    rules: Rules,
    *,
    gathered: Callable[[], Gathered] = Gathered,
    idle: Callable[[], Told] = Told,
    apart: bool = True,
) -> Iterator[Said]:
    """As `limit_findings`, window by window.

    Args:
        subject: Whom it is about.
        watched: The signals.
        begin: How each window is judged, once through the trial.
        rules: How samples become findings.
        gathered: For each episode what gathers what else is told about it.
        idle: What else to tell about a subject without any.
        apart: Whether a window can be judged without those before it.
    """
    seen = Seen(subject, watched, begin, apart)
    yield seen
    judged = Judged(seen, rules, gathered=gathered)
    for one in judged.violations():
        yield broken(subject, one.worst, rules, one.span, one.quantities, one.told)
    if not judged.violated and not watched.gaps:
        yield kept(subject, judged.closest, rules, idle() if judged.closest else Told())


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
        if not self.known.all():
            return {}
        return {"exposure_s": exact_sum(watched.durations_s[self.exposed])}

    @property
    def known(self) -> BoolArray:
        """Where the log tells whether the human is exposed, shape (n,)."""
        known: BoolArray = np.isfinite(self.distance_m) & np.isfinite(self.robot_speed_m_s)
        return known

    @property
    def exposed(self) -> BoolArray:
        """Where the human is, shape (n,)."""
        exposed: BoolArray = (self.distance_m <= self.within_m) & (self.robot_speed_m_s > self.standstill_m_s)
        return exposed


def exposure_of(
    watched: Watching, distance: str = APART, *, meeting: Callable[[Watched], Meeting] | None = None
) -> dict[str, float]:
    """`Meeting.exposure` of the whole trial, window by window.

    Args:
        watched: The signals.
        distance: As of `Meeting.of`.
        meeting: Who meets, in a window; by default `Meeting.of`.
    """
    exposure = Exposure(meeting or (lambda window: Meeting.of(window, distance)))
    for window in watched:
        if not exposure.take(window):
            break
    return exposure.of(watched)


class Exposure:
    """`exposure_of` for who goes through the windows anyway.

    Args:
        meeting: Who meets, in a window.
    """

    def __init__(self, meeting: Callable[[Watched], Meeting] = Meeting.of) -> None:
        self._meeting, self._exposed = meeting, Marks()
        self._known, self._samples = True, 0

    def take(self, window: Watched) -> bool:
        """Look at the next window; whether the log tells the exposure so far."""
        if self._known:
            meeting = self._meeting(window)
            self._known = bool(meeting.known.all())
            exposed = meeting.exposed
            self._samples += int(np.count_nonzero(exposed))
            self._exposed.put(window, exposed)
        return self._known

    def of(self, watched: Watching) -> dict[str, float]:
        """The exposure, all windows having been taken."""
        if not self._known:
            return {}
        total = Total(self._samples)
        for window in watched if self._samples else ():
            total.take(window.durations_s[self._exposed.of(window)])
        return {"exposure_s": total.value}


class Marks:
    """For which samples something holds, window by window, eight samples to a byte."""

    def __init__(self) -> None:
        self._bits: dict[int, bytes] = {}
        self._last: tuple[int, BoolArray] = -1, np.zeros(0, dtype=bool)

    def put(self, window: Watched, holds: BoolArray) -> None:
        """Note it for a window."""
        number, before = self._last
        if before.any():
            self._bits[number] = np.packbits(before).tobytes()
        self._last = window.number, holds

    def of(self, window: Watched) -> BoolArray:
        """As it was noted, shape (n,); not to be written to."""
        if self._last[0] == window.number:
            return self._last[1]
        bits = self._bits.get(window.number)
        if bits is None:
            return np.zeros(len(window.t), dtype=bool)
        return np.unpackbits(np.frombuffer(bits, dtype=np.uint8), count=len(window.t)).view(np.bool_)


class Constant(Gathered):
    """Tells the same of every episode."""

    def __init__(self, told: Told) -> None:
        self._told = told

    def told(self) -> Told:
        """What it was given."""
        return self._told


class Several(Gathered):
    """Tells what each of several gathers."""

    def __init__(self, *those: Gathered) -> None:
        self._those = those

    def take(self, watched: Watched, bound: Bound, rows: NDArray[np.intp]) -> None:
        """Hand the rows to each."""
        for one in self._those:
            one.take(watched, bound, rows)

    def told(self) -> Told:
        """All of it."""
        told = Told()
        for one in self._those:
            told = told + one.told()
        return told


class Blame(Gathered):
    """The labels of `Meeting`, gathered window by window.

    Args:
        meeting: Who meets, in a window.
        before: As of `Meeting.labels`.
    """

    def __init__(self, meeting: Callable[[Watched], Meeting], *, before: bool = False) -> None:
        self._meeting, self._before = meeting, before
        self._closing = ""
        self._moved, self._unknown = False, False

    def take(self, watched: Watched, bound: Bound, rows: NDArray[np.intp]) -> None:
        """Who closes in at the first row, and whether the robot moves in any."""
        del bound
        self.look(watched, rows)

    def look(self, watched: Watched, rows: NDArray[np.intp]) -> None:
        """The same, whatever is judged."""
        meeting = self._meeting(watched)
        labels = meeting.labels(rows, before=self._before)
        if not self._closing and self._before and rows[0] == 0 and watched.previous is not None:
            earlier = self._meeting(watched.previous)
            last = np.array([len(watched.previous.t) - 1])
            self._closing = earlier.labels(last)["closing_by"]
        self._closing = self._closing or labels["closing_by"]
        self._moved = self._moved or labels["robot_moving"] == "yes"
        self._unknown = self._unknown or labels["robot_moving"] == "unknown"

    def told(self) -> Told:
        """Both labels."""
        moving = "yes" if self._moved else "unknown" if self._unknown else "no"
        return Told(labels={"robot_moving": moving, "closing_by": self._closing})


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
    return exact_sum(np.diff(at) * (speeds[1:] + speeds[:-1]) / 2.0)


def ways_m(watched: Watching, speed: str, spans: Sequence[Span]) -> list[float]:
    """`travelled_m` of several spans, window by window, to the bit.

    Args:
        watched: The signals; there is a sample.
        speed: Template of the speed.
        spans: In order of their starts.
    """
    ways = [_Way.of(watched, span) for span in spans]
    first = 0
    for window in watched.between(ways[0].start_s) if ways else ():
        last_s = float(window.t[-1])
        for way in ways[first:]:
            if way.start_s > last_s:
                break
            if not way.done:
                way.take(window, speed)
        while first < len(ways) and ways[first].done:
            first += 1
        if first == len(ways):
            break
    return [way.metres for way in ways]


class _Way:
    """A way, as the samples of a speed come.

    Args:
        start_s: Where it begins, not before the first sample, s.
        end_s: Where it ends, not after the last sample, s.
        inside: How many samples there are between both.
    """

    def __init__(self, start_s: float, end_s: float, inside: int) -> None:
        self.start_s, self.end_s, self.done = start_s, end_s, False
        self._steps = Total(inside + 1)
        self._t, self._speed = np.zeros(0), np.zeros(0)

    @classmethod
    def of(cls, watched: Watching, span: Span) -> _Way:
        """That of a span, as far as samples reach."""
        all_of_it = watched.span
        start_s, end_s = (
            min(max(t_s, all_of_it.start_s), all_of_it.end_s) for t_s in (span.start_s, span.end_s)
        )
        after_start = float(np.nextafter(start_s, np.inf))
        inside = watched.rows_before(end_s) - watched.rows_before(after_start)
        return cls(start_s, end_s, max(inside, 0))

    @property
    def metres(self) -> float:
        """How long it is, once all samples have come."""
        return self._steps.value

    def take(self, window: Watched, speed: str) -> None:
        """Go on to the end of a window, from its beginning or from where the way begins."""
        t, speed_m_s = window.t, window[speed]
        inside = slice(int(t.searchsorted(self.start_s, side="right")), int(t.searchsorted(self.end_s)))
        at, speeds = [self._t, t[inside]], [self._speed, speed_m_s[inside]]
        if not len(self._t):
            at[0], speeds[0] = np.array([self.start_s]), _speed_at(window, speed, self.start_s)
        self.done = self.end_s <= t[-1]
        if self.done:
            at.append(np.array([self.end_s]))
            speeds.append(_speed_at(window, speed, self.end_s))
        t, speed_m_s = np.concatenate(at), np.concatenate(speeds)
        self._steps.take(np.diff(t) * (speed_m_s[1:] + speed_m_s[:-1]) / 2.0)
        self._t, self._speed = t[-1:].copy(), speed_m_s[-1:].copy()


def _speed_at(window: Watched, speed: str, t_s: float) -> FloatArray:
    """By a straight line between samples of a window, or from the last one before it; shape (1,)."""
    t, speed_m_s, before = window.t, window[speed], window.previous
    if t_s < t[0] and before is not None:
        t, speed_m_s = (
            np.array([before.t[-1], t[0]]),
            np.array([before[speed][-1], speed_m_s[0]]),
        )
    at: FloatArray = np.interp(np.array([t_s]), t, speed_m_s)
    return at


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
