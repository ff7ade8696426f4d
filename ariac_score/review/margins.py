"""Margin and verdict of every monitor of a result, instant by instant.

Of a monitor that gives its margin at every sample these are shown; one that can watch online
is stepped through the trial. Of any other only its findings are known: where they begin and
end, and the samples they rest on.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ariac_score.checks.contracts import InstantVerdict, OnlineMonitor
from ariac_score.checks.finding_contract import margin_breach
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.guarded import broken
from ariac_score.checks.registry import Plugin
from ariac_score.engine.ask import margins_of
from ariac_score.engine.prepared import Prepared
from ariac_score.engine.provenance import file_hashes
from ariac_score.engine.read import find_trial, read_needed
from ariac_score.engine.signal_needs import needs_of
from ariac_score.errors import ResultError
from ariac_score.installed.captured_output import fault_of, quiet
from ariac_score.results.result import Result
from ariac_score.trial.chart import Chart
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Sample, Signal
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.vocabulary import quantity_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["VERDICTS", "MarginSeries", "Moment", "read_again", "tracks"]

VERDICTS: tuple[Verdict | None, ...] = (
    Verdict.SATISFIED,
    Verdict.VIOLATED,
    Verdict.INCONCLUSIVE,
    Verdict.NOT_APPLICABLE,
    None,
)
"""The verdicts of an instant, by number; `None`: there is none."""

JUST_AFTER_S = 1e-9
"""The shortest time that a stamp resolves."""


@dataclass(frozen=True, slots=True)
class Moment:
    """The verdict of a monitor about one instant.

    Attributes:
        t_s: The instant, s of trial time.
        verdict: What holds from here on; `None`: there is no verdict.
        margin: Signed distance to the limit, negative when violated; `None` without one.
        message: One sentence for people; empty where nothing is new.
    """

    t_s: float
    verdict: Verdict | None
    margin: float | None
    message: str = ""


@dataclass(frozen=True, eq=False)
class MarginSeries:
    """Margins and verdicts of one monitor about one subject, in order of time.

    Attributes:
        check: Name of the check.
        subject: What it is about.
        unit: Unit of the margins.
        t_s: The instants, shape (n,), s of trial time, strictly increasing.
        verdicts: The verdict of each, as its number in `VERDICTS`, shape (n,).
        margin: Signed distance to the limit at each; NaN without one.
        messages: One sentence for people, by row; none where nothing is new.
        what: What its margin is of, where a subject has several; empty for the first.
        sampled: Whether its margin is known at every sample, not only where findings rest.
    """

    check: str
    subject: str
    unit: str
    t_s: FloatArray
    verdicts: NDArray[np.uint8]
    margin: FloatArray
    messages: Mapping[int, str]
    what: str = ""
    sampled: bool = False

    @classmethod
    def of(
        cls, check: str, subject: str, unit: str, moments: Sequence[Moment], *, sampled: bool = False
    ) -> MarginSeries:
        """Some moments as columns."""
        return cls(
            check,
            subject,
            unit,
            np.array([moment.t_s for moment in moments], dtype=np.float64),
            np.array([VERDICTS.index(moment.verdict) for moment in moments], dtype=np.uint8),
            np.array([math.nan if m.margin is None else m.margin for m in moments], dtype=np.float64),
            {row: moment.message for row, moment in enumerate(moments) if moment.message},
            sampled=sampled,
        )

    @property
    def moments(self) -> tuple[Moment, ...]:
        """The same one by one."""
        columns = zip(self.t_s.tolist(), self.verdicts.tolist(), self.margin.tolist(), strict=True)
        return tuple(
            Moment(t_s, VERDICTS[number], None if math.isnan(margin) else margin, self.messages.get(row, ""))
            for row, (t_s, number, margin) in enumerate(columns)
        )


def read_again(result: Result, path: Path, prepared: Prepared) -> Trial:
    """The trial of a result, read from its log with every signal its monitors need.

    Raises:
        ResultError: The log is not one the result was made from.
        ScoreError: The log cannot be read.
    """
    bundle, readers = find_trial(path, prepared.registry)
    known = {source.sha256 for source in result.provenance.inputs}
    for source in file_hashes(bundle):
        if source.role == "log" and source.sha256 not in known:
            raise ResultError(
                f"the result was not made from {source.name}: its sha256 is {source.sha256[:16]}…",
                file=path,
                hint="give the log the result is of; 'ariac-score verify' says what differs",
            )
    return prepared.derived(read_needed(bundle, readers, prepared))


def tracks(result: Result, trial: Trial, prepared: Prepared) -> list[MarginSeries]:
    """Margins and verdicts of every monitor over time, in the order of the rule set.

    Args:
        result: The result.
        trial: Its trial, with the derived signals.
        prepared: The rules by which it was scored.

    Raises:
        PluginError: A monitor raised.
    """
    found: list[MarginSeries] = []
    for name, each in prepared.checks.items():
        plugin, check = each.plugin, each.check
        if plugin.group != "ariac_score.monitors":
            continue
        findings = list(result.measured.of(name).values())
        charts = margins_of(plugin, name, check, trial)
        needed = {need.quantity for need in needs_of(plugin, name, check)}
        if charts and (fault := margin_breach(trial, needed, findings, charts)):
            raise broken(plugin, fault, of=name)
        own = _sampled(name, charts, findings)
        if not own and isinstance(check, OnlineMonitor):
            own = _watched(plugin, name, check, trial)
        own = [_with_undecided(track, findings) for track in own]
        known = {track.subject for track in own}
        found += [*own, *_from_findings(name, [f for f in findings if f.subject not in known], result)]
    return found


def _with_undecided(track: MarginSeries, findings: Sequence[Finding]) -> MarginSeries:
    """A track with the undecided stretches between its samples."""
    undecided = [
        Moment(f.span.start_s, f.verdict, None, f.message)
        for f in findings
        if f.subject == track.subject and f.verdict is Verdict.INCONCLUSIVE and f.span is not None
    ]
    known = set(track.t_s[np.isin(track.t_s, [moment.t_s for moment in undecided])].tolist())
    more: dict[float, Moment] = {}
    for moment in undecided:
        # A gap begins at its last sample, which itself was judged.
        t_s = moment.t_s + JUST_AFTER_S if moment.t_s in known else moment.t_s
        more[t_s] = replace(moment, t_s=t_s)
    return _inserted(track, [more[t_s] for t_s in sorted(more)]) if more else track


def _inserted(track: MarginSeries, moments: Sequence[Moment]) -> MarginSeries:
    """A track with more moments, after those of the same time."""
    new = MarginSeries.of("", "", "", moments)
    rows = track.t_s.searchsorted(new.t_s, side="right")
    # Each message moves by the number of moments inserted before its row.
    messages = {row + int(np.searchsorted(rows, row, side="right")): m for row, m in track.messages.items()}
    messages |= {int(rows[k]) + k: message for k, message in new.messages.items()}
    return replace(
        track,
        t_s=np.insert(track.t_s, rows, new.t_s),
        verdicts=np.insert(track.verdicts, rows, new.verdicts),
        margin=np.insert(track.margin, rows, new.margin),
        messages=messages,
    )


# Monitors that give their margins ------------------------------------------------------


def _sampled(name: str, charts: Sequence[Chart], findings: Sequence[Finding]) -> list[MarginSeries]:
    """The margins of a monitor with the state at each; in the order of its subjects."""
    found: list[MarginSeries] = []
    for chart in charts:
        t, margin = chart.t, chart.margin
        if not len(t):
            continue
        # The first keeps the plain topic name, so that it does not depend on how many limits follow.
        several = any(track.subject == chart.subject for track in found)
        violations = [
            f.span
            for f in findings
            if f.span is not None and f.subject == chart.subject and f.verdict is Verdict.VIOLATED
        ]
        verdicts = _verdicts_at(t, margin, violations)
        changed = np.flatnonzero(np.diff(verdicts, prepend=np.array([-1], dtype=np.int8)))
        messages = _words(chart, margin, changed)
        what = chart.what if several else ""
        found.append(
            MarginSeries(
                name,
                chart.subject,
                chart.unit,
                t,
                verdicts.astype(np.uint8),
                margin,
                messages,
                what,
                sampled=True,
            )
        )
    return found


_SATISFIED, _VIOLATED, _IDLE = (
    VERDICTS.index(verdict) for verdict in (Verdict.SATISFIED, Verdict.VIOLATED, Verdict.NOT_APPLICABLE)
)


def _verdicts_at(t: FloatArray, margin: FloatArray, violations: Sequence[Span]) -> NDArray[np.int8]:
    """The verdict at each sample; a margin of exactly 0 is violated where a finding says so."""
    broken, unsure = margin < 0, margin == 0
    for span in violations if unsure.any() else ():
        broken |= unsure & (t >= span.start_s) & (t <= span.end_s)
    verdicts = np.where(broken, _VIOLATED, _SATISFIED)
    return np.where(np.isnan(margin), _IDLE, verdicts).astype(np.int8)


def _words(chart: Chart, margin: FloatArray, rows: NDArray[np.intp]) -> dict[int, str]:
    """The measured number and its limit at some samples, in words."""
    actual, limit = chart.actual[rows].tolist(), chart.limit[rows].tolist()
    relation = "at most" if chart.at_most else "at least"
    return {
        row: "the limit does not apply"
        if math.isnan(margin[row])
        else f"{chart.what} {was:.3f} {chart.unit} ({relation} {may:.3f})"
        for row, was, may in zip(rows.tolist(), actual, limit, strict=True)
    }


# Monitors that watch online ------------------------------------------------------------


def _watched(plugin: Plugin, name: str, monitor: OnlineMonitor, trial: Trial) -> list[MarginSeries]:
    """The verdicts of an online monitor about every instant of the competition, by subject."""
    wanted = {need.quantity for need in needs_of(plugin, name, monitor)}
    signals = [s for key, s in sorted(trial.signals.items()) if quantity_of(key) in wanted]
    window = trial.window
    verdicts: dict[str, list[InstantVerdict]] = {}
    try:
        with quiet(plugin.origin):
            watch = monitor.begin()
            for samples in _steps(signals):
                for verdict in watch.step(samples):
                    if window is not None and window.start_s <= verdict.t_s <= window.end_s:
                        verdicts.setdefault(verdict.subject, []).append(verdict)
    except Exception as cause:  # a plugin that calls sys.exit must not end the program
        raise broken(plugin, f"raised {fault_of(cause)}", of=name) from cause
    return [_online_track(name, subject, own) for subject, own in verdicts.items()]


def _online_track(name: str, subject: str, verdicts: Sequence[InstantVerdict]) -> MarginSeries:
    """The verdicts about one subject, with a message only where the state changes."""
    moments, before = [], None
    for one in verdicts:
        words = one.message if one.verdict is not before else ""
        moments.append(Moment(one.t_s, one.verdict, one.robustness, words))
        before = one.verdict
    return MarginSeries.of(name, subject, verdicts[-1].unit, moments, sampled=True)


def _steps(signals: Sequence[Signal]) -> Iterator[list[Sample]]:
    """All samples, those of one instant together."""
    times = np.concatenate([np.zeros(0), *(signal.t for signal in signals)])
    which = np.repeat(np.arange(len(signals)), [len(signal) for signal in signals])
    index = np.concatenate([np.zeros(0, dtype=np.intp), *(np.arange(len(s)) for s in signals)])
    values = [signal.values for signal in signals]  # kept: derived ones are computed at each access
    # By time, then by signal in the order of names: an online monitor gets the same steps every time.
    order = np.lexsort((which, times))
    for group in np.split(order, np.flatnonzero(np.diff(times[order])) + 1) if len(order) else ():
        yield [
            _sample(signals[number], float(times[place]), values[number][row])
            for place, number, row in zip(group, which[group], index[group], strict=True)
        ]


def _sample(signal: Signal, t_s: float, value: FloatArray) -> Sample:
    plain = float(value) if np.ndim(value) == 0 else tuple(value.tolist())
    return Sample(signal.name, t_s, plain, signal.unit)


# Monitors of which only the findings are known ------------------------------------------


def _from_findings(name: str, findings: Sequence[Finding], result: Result) -> Iterator[MarginSeries]:
    """A track for each subject, made of its findings."""
    subjects: dict[str, list[Finding]] = {}
    for finding in findings:
        subjects.setdefault(finding.subject, []).append(finding)
    for subject, own in subjects.items():
        moments: dict[float, Moment] = {}
        for finding in own:
            moments |= {m.t_s: m for m in _moments(finding, result) if _says_more(m, moments.get(m.t_s))}
        ordered = tuple(moments[t_s] for t_s in sorted(moments))
        unit = next((finding.unit for finding in own if finding.unit), "")
        if ordered:
            yield MarginSeries.of(name, subject, unit, ordered)


def _says_more(moment: Moment, known: Moment | None) -> bool:
    """Whether a moment replaces another at the same time: the worse verdict counts."""
    if known is None or known.verdict is None:
        return True
    return moment.verdict is not None and _rank(moment) < _rank(known)


def _rank(moment: Moment) -> tuple[int, float]:
    # A recording has one state for each instant, so one finding has to win.
    order = [Verdict.VIOLATED, Verdict.INCONCLUSIVE, Verdict.SATISFIED, Verdict.NOT_APPLICABLE, None]
    return order.index(moment.verdict), math.inf if moment.margin is None else moment.margin


def _moments(finding: Finding, result: Result) -> Iterator[Moment]:
    """Where a finding begins, its samples, and where it ends."""
    window = result.measured.window
    at = [sample.t_s for sample in finding.evidence]
    margin = finding.robustness
    if finding.span is None:
        start_s = min(at) if at else window.start_s if window else None
        if start_s is not None:
            yield Moment(start_s, finding.verdict, margin, finding.message)
        return
    span = finding.span
    yield Moment(span.start_s, finding.verdict, margin if span.start_s in at else None, finding.message)
    inside = {t_s for t_s in at if span.start_s < t_s <= span.end_s}
    for t_s in sorted(inside):
        yield Moment(t_s, finding.verdict, margin)
    if span.end_s > span.start_s and span.end_s not in inside:
        yield Moment(span.end_s, None, None)  # its finding says nothing about the time after
