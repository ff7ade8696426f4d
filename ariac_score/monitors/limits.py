"""A measured value against its limit: episodes beyond it, how severe each is, and the findings.

The violating samples are grouped into episodes (opened after `t_on_s` of violation, closed after
`t_off_s` without), each is measured (`time_in_violation_s`, depth, its integral, the same relative
to the limit), and each is one finding; or the closest moment is, if there is no episode and no gap.
Sample k stands for [t_k, t_k+1): durations are sums of those, never counts of samples.

>>> distance_m, required_m = np.array([3.0, 1.5, 3.0]), np.array([2.0, 2.0, 2.0])
>>> watched = Watched(np.array([0.0, 0.1, 0.2]), {}, [], 0.2, {})
>>> limit = JudgedLimit(watched, Bound("distance", distance_m, required_m, "m"))
>>> (episode,) = limit.episodes(t_on_s=0.0, t_off_s=1.0)
>>> {name: round(number, 6) for name, number in episode.quantities.items()}["depth_integral_m_s"]
0.05
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ariac_score.checks.depth import DepthProfile, depth_profile
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.checks.open_findings import Worlds
from ariac_score.monitors.watched import Watched
from ariac_score.trial.chart import Chart
from ariac_score.trial.signals import Sample
from ariac_score.trial.spans import BoolArray, FloatArray, Span, episodes_where
from ariac_score.trial.sums import exact_sum

__all__ = [
    "DEPTHS",
    "Bound",
    "Details",
    "Episode",
    "FindingRules",
    "JudgedLimit",
    "Rows",
    "Statement",
    "limit_findings",
    "no_severities",
    "rows_of_episodes",
    "severity_measures",
    "violations_only",
]

Rows: TypeAlias = NDArray[np.intp]
"""Indices of samples, increasing."""

_DEPTHS: Mapping[str, tuple[str, str, str]] = {
    "m": ("depth_max_m", "depth_integral_m_s", "m s"),
    "m/s": ("excess_max_m_s", "excess_integral_m", "m"),
    "rad": ("depth_max_rad", "depth_integral_rad_s", "rad s"),
    "rad/s": ("excess_max_rad_s", "excess_integral_rad", "rad"),
    "N": ("excess_max_N", "excess_integral_N_s", "N s"),
    "Pa": ("excess_max_Pa", "excess_integral_Pa_s", "Pa s"),
    "s": ("excess_max_s", "excess_integral_s2", "s2"),
    "1": ("excess_max", "excess_integral_s", "s"),
}
"""Names of the depth and of its integral, and unit of the integral, by unit of the limit."""


DEPTHS: tuple[tuple[str, str], ...] = (
    *((depth, integral) for depth, integral, _ in _DEPTHS.values()),
    ("depth_max", "depth_integral"),
    ("relative_depth_max", "relative_depth_integral_s"),
)
"""Names of each depth and of its integral over time."""


def severity_measures(unit: str) -> dict[str, Measure]:
    """What is measured of every episode beyond a limit in some unit, by name.

    >>> {name: measure.unit for name, measure in severity_measures("m/s").items()}["excess_integral_m"]
    'm'
    """
    depth, integral, integral_unit = _DEPTHS.get(unit, ("depth_max", "depth_integral", f"{unit} s"))
    return {
        "time_in_violation_s": Measure("s", best=0.0, meaning="how long the limit was broken"),
        depth: Measure(unit, best=0.0, meaning="the most by which it was broken"),
        integral: Measure(integral_unit, best=0.0, meaning="the same, summed over time"),
        "relative_depth_max": Measure("1", best=0.0, meaning="the most as a share of the limit, up to 1"),
        "relative_depth_integral_s": Measure("s", best=0.0, meaning="that share, summed over time"),
    }


def no_severities(unit: str) -> dict[str, float]:
    """The severities of a clean trial, all 0: a rule set may price them without asking whether they exist."""
    return dict.fromkeys(severity_measures(unit), 0.0)


# One limit, sample by sample ------------------------------------------------------------------


@dataclass(frozen=True)
class Bound:
    """A measured value against its limit, sample by sample, or (with numbers for columns) at one instant.

    Attributes:
        what: Name of what is measured, such as `speed`.
        actual: Measured, shape (n,).
        limit: Its limit, shape (n,); infinite where there is none.
        unit: Of both.
        at_most: Whether the limit is an upper one; equality keeps it.
        applies: Where the limit applies, shape (n,); `None`: everywhere.
        evidence: Name under which the limit stands in the evidence; empty leaves it out.
        strict: Whether equality breaks it.
    """

    what: str
    actual: FloatArray
    limit: FloatArray
    unit: str
    at_most: bool = False
    applies: BoolArray | None = None
    evidence: str = ""
    strict: bool = False

    @cached_property
    def margin(self) -> FloatArray:
        """Signed distance to the limit, shape (n,), negative where it is broken."""
        return self.limit - self.actual if self.at_most else self.actual - self.limit

    def allowing(self, error: FloatArray | float) -> Bound:
        """The same limit, broken only by more than what is measured may be wrong by.

        Args:
            error: How far what is measured may lie from the true value, shape (n,) or one number.
        """
        return replace(self, limit=self.limit + error if self.at_most else self.limit - error)

    @property
    def unknown(self) -> BoolArray:
        """Where the limit applies, but what is measured or the limit itself is NaN, shape (n,)."""
        unknown: BoolArray = np.isnan(self.actual) | np.isnan(self.limit)
        return unknown if self.applies is None else unknown & self.applies

    @cached_property
    def limited(self) -> BoolArray:
        """Where there is a limit, shape (n,)."""
        limited: BoolArray = np.isfinite(self.limit)
        return limited if self.applies is None else limited & self.applies

    @cached_property
    def broken(self) -> BoolArray:
        """Where it is broken, shape (n,)."""
        return self.limited & ((self.margin <= 0) if self.strict else (self.margin < 0))

    @property
    def shown(self) -> tuple[FloatArray, FloatArray]:
        """What a chart draws: the measured value, and its limit, NaN where none applies."""
        return self.actual, np.where(self.limited, self.limit, np.nan)

    def relation(self, row: int) -> str:
        """The limit at one sample in words."""
        return f"{'at most' if self.at_most else 'at least'} {self.limit[row]:.3f}"


@dataclass(frozen=True, eq=False)
class Episode:
    """One violation over time.

    Attributes:
        span: From its first to the end of its last violating sample.
        rows: Its violating samples.
        worst: The sample with the least margin.
        quantities: Those of `severity_measures`.
        profile: Its relative depth over time.
    """

    span: Span
    rows: Rows
    worst: int
    quantities: Mapping[str, float]
    profile: DepthProfile


def rows_of_episodes(
    watched: Watched, holds: BoolArray, *, t_on_s: float = 0.0, t_off_s: float
) -> list[tuple[Span, Rows]]:
    """The episodes in which something holds, each with the samples at which it does.

    Args:
        watched: The time base.
        holds: Where it holds, shape (n,).
        t_on_s: Shortest episode that counts, s.
        t_off_s: Pauses shorter than this are bridged, s.
    """
    t, rows = watched.t, np.flatnonzero(holds)
    row_t = t[rows]
    spans = episodes_where(t, holds, t_on_s=t_on_s, t_off_s=t_off_s, longest_s=watched.max_gap_s)
    return [
        (span, rows[row_t.searchsorted(span.start_s) : row_t.searchsorted(span.end_s, side="right")])
        for span in spans
    ]


@dataclass(frozen=True, eq=False)
class JudgedLimit:
    """One limit of one subject: its findings and its margins come from the same numbers.

    Attributes:
        watched: The signals of the subject.
        bound: The measured value, and its limit.
    """

    watched: Watched
    bound: Bound

    @property
    def subject(self) -> str:
        """Whom it is about."""
        return self.watched.subject.name

    @property
    def chart(self) -> Chart:
        """The measured value and its limit over time; without a limit where none applies."""
        bound, watched = self.bound, self.watched
        return Chart(
            self.subject,
            bound.what,
            bound.unit,
            watched.t,
            *bound.shown,
            at_most=bound.at_most,
            max_gap_s=watched.max_gap_s,
        )

    @property
    def closest(self) -> int | None:
        """The sample with the least margin, of equal ones the first; `None` where there is no limit."""
        rows = np.flatnonzero(self.bound.limited)
        return int(rows[np.argmin(self.bound.margin[rows])]) if len(rows) else None

    def episodes(self, *, t_on_s: float, t_off_s: float) -> list[Episode]:
        """The episodes in which the limit is broken.

        Args:
            t_on_s: Shortest violation that counts, s.
            t_off_s: Pauses shorter than this are bridged, s.
        """
        found = rows_of_episodes(self.watched, self.bound.broken, t_on_s=t_on_s, t_off_s=t_off_s)
        return [self._episode(span, rows) for span, rows in found]

    def _episode(self, span: Span, rows: Rows) -> Episode:
        margin, limit = self.bound.margin[rows], self.bound.limit[rows]
        weight_s, depth = self.watched.durations_s[rows], np.maximum(-margin, 0.0)
        if self.bound.strict:  # equality is a violation, and a violation of no depth at all is none
            limit = np.nextafter(limit, -np.inf if self.bound.at_most else np.inf)
            depth = np.abs(self.bound.actual[rows] - limit)
        # Clipped to 1: twice the permitted speed and ten times cost the same. Of a limit of 0, nothing is
        # left at any depth.
        relative = np.clip(np.divide(depth, limit, out=np.ones_like(depth), where=limit > 0), 0.0, 1.0)
        numbers = (
            exact_sum(weight_s),
            float(depth.max()),
            exact_sum(depth * weight_s),
            float(relative.max()),
            exact_sum(relative * weight_s),
        )
        # Sums, never shares of the trial's length: else waiting would dilute a violation.
        names = severity_measures(self.bound.unit)
        profile = depth_profile(self.watched.t[rows], weight_s, relative)
        worst = int(rows[np.argmin(margin)])
        return Episode(span, rows, worst, dict(zip(names, numbers, strict=True)), profile)

    def evidence(self, row: int) -> tuple[Sample, ...]:
        """What was measured at one sample, and the limit where it has a name."""
        measured, bound = self.watched.samples(row), self.bound
        if not (bound.evidence and measured):
            return measured
        t_s, limit = float(self.watched.t[row]), float(bound.limit[row])
        return (*measured, Sample(f"{bound.evidence}/{self.subject}", t_s, limit, bound.unit))


# From limits to findings -----------------------------------------------------------------------

Statement: TypeAlias = Finding | JudgedLimit | Worlds
"""What a monitor yields about a trial: findings, before them the limits they rest on, and what is open."""


@dataclass(frozen=True)
class FindingRules:
    """How samples become findings.

    Attributes:
        clause: Where the standard asks for it.
        t_on_s: Shortest violation that counts, s.
        t_off_s: Pauses shorter than this are bridged, s.
        idle: The message when the limit never applied.
        critical: Whether a violation is a critical event.
        measures_clean: Whether a subject without a violation has the severities, all 0.
        graded: Whether the depth relative to the limit says how bad a violation is; a contact, say, is one
            at any depth.
    """

    clause: str = ""
    t_on_s: float = 0.0
    t_off_s: float = 0.0
    idle: str = "the limit never applied"
    critical: bool = False
    measures_clean: bool = True
    graded: bool = True


@dataclass(frozen=True)
class Details:
    """What a monitor adds to a finding.

    Attributes:
        quantities: By name; they stand after the severities, and in place of one of the same name.
        labels: By name.
        message: In place of the usual one; empty keeps that.
    """

    quantities: Mapping[str, float] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)
    message: str = ""


Describe: TypeAlias = Callable[[int, Episode | None], Details]
"""What to add about an episode and its worst sample, or about a subject without any and its closest one."""


def _nothing_more(_row: int, _episode: Episode | None) -> Details:
    return Details()


def limit_findings(
    limit: JudgedLimit, rules: FindingRules, describe: Describe = _nothing_more
) -> Iterator[Statement]:
    """The limit, then one finding for each episode beyond it; else the closest moment, if no gap hides one.

    Args:
        limit: The measured value, and its limit.
        rules: How samples become findings.
        describe: What to add.
    """
    yield limit
    episodes = limit.episodes(t_on_s=rules.t_on_s, t_off_s=rules.t_off_s)
    for episode in episodes:
        yield _finding(limit, rules, episode.worst, episode, describe(episode.worst, episode))
    # With a gap there is no "kept throughout": the gap's own finding already leaves the limit open.
    if not episodes and not limit.watched.gaps:
        closest = limit.closest
        if closest is None:
            yield Finding.not_applicable(limit.subject, rules.idle, clause=rules.clause)
        else:
            yield _finding(limit, rules, closest, None, describe(closest, None))


def _finding(
    limit: JudgedLimit, rules: FindingRules, row: int, episode: Episode | None, details: Details
) -> Finding:
    clean = no_severities(limit.bound.unit) if rules.measures_clean else {}
    return Finding(
        limit.subject,
        Verdict.SATISFIED if episode is None else Verdict.VIOLATED,
        details.message or _usual_message(limit, rules, row, episode),
        span=None if episode is None else episode.span,
        robustness=float(limit.bound.margin[row]),
        unit=limit.bound.unit,
        quantities={**(clean if episode is None else episode.quantities), **details.quantities},
        labels=details.labels,
        evidence=limit.evidence(row),
        clause=rules.clause,
        critical=rules.critical and episode is not None,
        profile=episode.profile if rules.graded and episode is not None else None,
    )


def _usual_message(limit: JudgedLimit, rules: FindingRules, row: int, episode: Episode | None) -> str:
    bound = limit.bound
    if episode is not None:
        outcome = f"beyond its limit for {episode.quantities['time_in_violation_s']:.2f} s; at worst"
    elif bound.broken[row]:  # but too briefly to count
        outcome = f"never beyond its limit for {rules.t_on_s:g} s; at worst"
    else:
        outcome = "keeps its limit; closest"
    measured = f"{bound.actual[row]:.3f} {bound.unit} ({bound.relation(row)})"
    return f"{bound.what} {outcome} {measured}, at {limit.watched.t[row]:.3f} s"


def violations_only(statements: Iterator[Statement]) -> Iterator[Statement]:
    """What a second limit adds: itself and its violations; the first limit reports that all is well."""
    for one in statements:
        if not isinstance(one, Finding) or one.verdict is Verdict.VIOLATED:
            yield one
