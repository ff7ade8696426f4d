"""What every monitor measures: episodes beyond a limit, and how severe each is (catalogue, section 1).

How to build a monitor. Watch signals (`watching`), compute the measured value and its
limit at every sample, and hand both to `limit_findings` as a `Bound`. It groups the
violating samples into episodes (opened after `t_on_s` of violation, closed after `t_off_s`
without), measures each (`time_in_violation_s`, depth, its integral, the same relative
to the limit), and yields one finding for each; or the closest moment, if there is no
episode and no gap. Before them it yields the `JudgedLimit` they rest on, from which a
`LimitMonitor` charts its margins over time. Sample k stands for [t_k, t_k+1): durations are
sums of those, never counts of samples. Who is to blame, and for how long somebody was
exposed, is in `blame`.

>>> distance_m, required_m = np.array([3.0, 1.5, 3.0]), np.array([2.0, 2.0, 2.0])
>>> watched = Watched(np.array([0.0, 0.1, 0.2]), {}, [], 0.2, {})
>>> limit = JudgedLimit("r/h", watched, Bound("distance", distance_m, required_m, "m"))
>>> (episode,) = limit.episodes(t_on_s=0.0, t_off_s=1.0)
>>> {name: round(number, 6) for name, number in episode.quantities.items()}["depth_integral_m_s"]
0.05
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ariac_score import Chart, Finding, Sample, Span, Trial, Verdict, episodes_where, exact_sum
from ariac_score_standards.watching import BoolArray, FloatArray, Watched

Rows: TypeAlias = NDArray[np.intp]
"""Indices of samples, increasing."""

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


_SEVERITIES = (
    "time_in_violation_s",
    "{depth}",
    "{integral}",
    "relative_depth_max",
    "relative_depth_integral_s",
)


# One limit, sample by sample ------------------------------------------------------------------


@dataclass(frozen=True)
class Bound:
    """A measured value against its limit, sample by sample.

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

    @cached_property
    def margin(self) -> FloatArray:
        """Signed distance to the limit, shape (n,), negative where it is broken."""
        return self.limit - self.actual if self.at_most else self.actual - self.limit

    @property
    def limited(self) -> BoolArray:
        """Where there is a limit, shape (n,)."""
        limited: BoolArray = np.isfinite(self.limit)
        return limited if self.applies is None else limited & self.applies

    @property
    def broken(self) -> BoolArray:
        """Where it is broken, shape (n,)."""
        return self.limited & (self.margin < 0)

    def relation(self, row: int) -> str:
        """The limit at one sample in words."""
        return f"{'at most' if self.at_most else 'at least'} {self.limit[row]:.3f}"


@dataclass(frozen=True, eq=False)
class Episode:
    """One violation over time, with the severities of the monitor catalogue, section 1.3.

    Attributes:
        span: From its first to the end of its last violating sample.
        rows: Its violating samples.
        worst: The sample with the least margin.
        quantities: `time_in_violation_s`, depth and its integral (such as `depth_max_m` and
            `depth_integral_m_s`), `relative_depth_integral_s`, `relative_depth_max`.
    """

    span: Span
    rows: Rows
    worst: int
    quantities: Mapping[str, float]


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
        subject: Whom it is about.
        watched: The signals.
        bound: The measured value, and its limit.
    """

    subject: str
    watched: Watched
    bound: Bound

    @property
    def chart(self) -> Chart:
        """The measured value and its limit over time; without a limit where none applies."""
        bound = self.bound
        limit = np.where(bound.limited, bound.limit, np.nan)
        return Chart(
            self.subject,
            bound.what,
            bound.unit,
            self.watched.t,
            bound.actual,
            limit,
            bound.at_most,
            self.watched.max_gap_s,
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
        # Clipped to 1 (catalogue, 1.3): twice the permitted speed and ten times cost the same. Of a limit
        # of 0, nothing is left at any depth.
        relative = np.clip(np.divide(depth, limit, out=np.ones_like(depth), where=limit > 0), 0.0, 1.0)
        numbers = (
            exact_sum(weight_s),
            float(depth.max()),
            exact_sum(depth * weight_s),
            float(relative.max()),
            exact_sum(relative * weight_s),
        )
        # Sums, never shares of the trial's length: else waiting would dilute a violation.
        names = _severity_names(self.bound.unit)
        return Episode(span, rows, int(rows[np.argmin(margin)]), dict(zip(names, numbers, strict=True)))

    def evidence(self, row: int) -> tuple[Sample, ...]:
        """What was measured at one sample, and the limit where it has a name."""
        measured, bound = self.watched.samples(row), self.bound
        if not bound.evidence:
            return measured
        t_s, limit = float(self.watched.t[row]), float(bound.limit[row])
        return (*measured, Sample(f"{bound.evidence}/{self.subject}", t_s, limit, bound.unit))


def _severity_names(unit: str) -> tuple[str, ...]:
    depth, integral = _DEPTH_NAMES.get(unit, ("depth_max", "depth_integral"))
    return tuple(name.format(depth=depth, integral=integral) for name in _SEVERITIES)


def no_severities(unit: str) -> dict[str, float]:
    """The severities of a clean trial, all 0: a rule set may price them without asking whether they exist."""
    return dict.fromkeys(_severity_names(unit), 0.0)


# From limits to findings -----------------------------------------------------------------------

Statement = Finding | JudgedLimit
"""What a monitor yields about a trial: findings, and before them the limits they rest on."""


@dataclass(frozen=True)
class Reach:
    """Which samples the verdict on one sample rests on: what a live form must keep, and wait for.

    Attributes:
        back: `sample`: none before it; `neighbour`: the one before; `run`: all since a condition
            began to hold, of which a live form carries the beginning only; `start`: all since
            the trial began.
        ahead: How many samples after it.
        ahead_s: The samples of how much time after it, s; infinite: all.
    """

    back: Literal["sample", "neighbour", "run", "start"] = "sample"
    ahead: int = 0
    ahead_s: float = 0.0


class LimitMonitor:
    """A monitor that judges sample by sample, and so has a margin at every one.

    It yields everything in `statements`; `watch` picks the findings, `margins` the limits.
    """

    @property
    def reach(self) -> Reach:
        """Which samples the verdict on one rests on."""
        return Reach()

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """Findings about every subject: its violations, or its closest moment."""
        return (one for one in self.statements(trial) if isinstance(one, Finding))

    def margins(self, trial: Trial) -> Iterator[Chart]:
        """The measured value and its limit at every sample, for every subject and limit."""
        return (one.chart for one in self.statements(trial) if isinstance(one, JudgedLimit))

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """All findings about a trial, and the limits they rest on."""
        raise NotImplementedError


@dataclass(frozen=True)
class Rules:
    """How samples become findings.

    Attributes:
        clause: Where the standard asks for it.
        t_on_s: Shortest violation that counts, s.
        t_off_s: Pauses shorter than this are bridged, s.
        idle: The message when the limit never applied.
        critical: Whether a violation is a critical event.
    """

    clause: str
    t_on_s: float = 0.0
    t_off_s: float = 1.0
    idle: str = "the limit never applied"
    critical: bool = False


@dataclass(frozen=True)
class Details:
    """What a monitor adds to a finding."""

    quantities: Mapping[str, float] = field(default_factory=dict)
    labels: Mapping[str, str] = field(default_factory=dict)


def _no_details(_episode: Episode | None) -> Details:
    return Details()


def limit_findings(
    limit: JudgedLimit, rules: Rules, details: Callable[[Episode | None], Details] = _no_details
) -> Iterator[Statement]:
    """The limit, then one finding for each episode beyond it; else the closest moment, if no gap hides one.

    Args:
        limit: The measured value, and its limit.
        rules: How samples become findings.
        details: What to add about an episode, or (given `None`) about a subject without any.
    """
    yield limit
    episodes = limit.episodes(t_on_s=rules.t_on_s, t_off_s=rules.t_off_s)
    for episode in episodes:
        yield _violation(limit, rules, episode, details(episode))
    # With a gap there is no "kept throughout": the gap's own finding already leaves the limit open.
    if not episodes and not limit.watched.gaps:
        yield _closest(limit, rules, details)


def _violation(limit: JudgedLimit, rules: Rules, episode: Episode, details: Details) -> Finding:
    bound, worst = limit.bound, episode.worst
    return Finding(
        limit.subject,
        Verdict.VIOLATED,
        f"{bound.what} beyond its limit for {episode.quantities['time_in_violation_s']:.2f} s; at worst "
        f"{bound.actual[worst]:.3f} {bound.unit} ({bound.relation(worst)}), "
        f"at {limit.watched.t[worst]:.3f} s",
        span=episode.span,
        robustness=float(bound.margin[worst]),
        unit=bound.unit,
        quantities={**episode.quantities, **details.quantities},
        labels=details.labels,
        evidence=limit.evidence(worst),
        clause=rules.clause,
        critical=rules.critical,
    )


def _closest(limit: JudgedLimit, rules: Rules, details: Callable[[None], Details]) -> Finding:
    bound, closest = limit.bound, limit.closest
    if closest is None:
        return Finding.not_applicable(limit.subject, rules.idle, clause=rules.clause)
    more = details(None)
    outcome = "keeps its limit; closest"
    if bound.broken[closest]:  # but too briefly to count
        outcome = f"never beyond its limit for {rules.t_on_s:g} s; at worst"
    return Finding(
        limit.subject,
        Verdict.SATISFIED,
        f"{bound.what} {outcome} {bound.actual[closest]:.3f} {bound.unit} "
        f"({bound.relation(closest)}), at {limit.watched.t[closest]:.3f} s",
        robustness=float(bound.margin[closest]),
        unit=bound.unit,
        quantities={**no_severities(bound.unit), **more.quantities},
        labels=more.labels,
        evidence=limit.evidence(closest),
        clause=rules.clause,
    )


def violations_only(statements: Iterator[Statement]) -> Iterator[Statement]:
    """What a second limit adds: itself and its violations; the first limit reports that all is well."""
    for one in statements:
        if isinstance(one, JudgedLimit) or one.verdict is Verdict.VIOLATED:
            yield one
