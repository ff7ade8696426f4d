"""Worlds for monitors that judge signals in their own way: their samples, filled with what may have been."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.checks.open_findings import Worlds
from ariac_score.monitors.blunt import Judged, blunt_worlds
from ariac_score.monitors.causes import causes_of_cells
from ariac_score.monitors.cells import TOLERANCE_S, Cells, Stream, cells_of
from ariac_score.monitors.pauses import joined_where_one, split_by_pauses
from ariac_score.monitors.unseen import Unseen
from ariac_score.monitors.worlds import alike
from ariac_score.monitors.worsening import Worsening
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import BoolArray, FloatArray, Span, merged, uncovered_spans
from ariac_score.trial.sums import exact_sum

__all__ = ["FilledSignals", "worlds_between"]


@dataclass(frozen=True, eq=False)
class FilledSignals:
    """What some signals can have been at every moment of a competition, cell by cell.

    Attributes:
        t: When each cell begins, shape (n,), s; the last one is the end of the competition.
        least: The least of each signal in each cell, shape (n,), by the name it was given under.
        most: The most, likewise; the same where it was seen.
        open: In which cells one of them was not seen, shape (n,).
    """

    t: FloatArray
    least: Mapping[str, FloatArray]
    most: Mapping[str, FloatArray]
    open: BoolArray


JudgeWorld = Callable[[FilledSignals, bool], Sequence[Finding]]
"""What is found in one world; true: in the worst."""


def worlds_between(
    trial: Trial,
    subject: str,
    signals: Mapping[str, Signal],
    seen: Sequence[Finding],
    *,
    max_gap_s: float,
    measures: Mapping[str, Measure],
    t_off_s: float = 0.0,
    t_on_s: float = 0.0,
    clause: str = "",
    critical: bool = False,
    judge: JudgeWorld | None = None,
    ahead_s: float = 0.0,
    back_s: float = 0.0,
) -> Iterator[Finding | Worlds]:
    """What was found about a subject, and what the time without samples leaves open of it.

    For monitors that are no `SubjectMonitor`. Where both worlds are alike nothing is open, and what they
    have in common is said instead of what the samples alone left undecided.

    Args:
        trial: The trial, with what bounds it between samples.
        subject: Whom it is about.
        signals: What it reads, by any names.
        seen: What the samples show.
        max_gap_s: Longest stretch without a sample that it accepts, s.
        measures: The quantities of its findings.
        t_off_s: Pauses shorter than this are bridged, s.
        t_on_s: Shortest violation that counts, s: so long beside a gap one may be that does not count alone.
        clause: Where it is asked for.
        critical: Whether a violation is a critical event.
        judge: Its findings in one world; `None`: nothing bounds what may have been in a gap.
        ahead_s: How far ahead a verdict looks at most, s: so long before a gap it may hang on it.
        back_s: How far back, s: so long behind a gap.
    """
    assumed, window = trial.between, trial.window
    if assumed is None or window is None or not signals:
        yield from seen
        return
    unseen = Unseen(trial, assumed, window, max_gap_s)
    opened = [one for one in unseen.all_streams(signals.values()) if one.open.any()]
    filled = _filled(unseen, signals, opened, window) if opened and judge is not None else None
    if not opened:
        yield from seen
    elif filled is not None and judge is not None:
        best, worst = judge(filled, False), judge(filled, True)
        kept = _decided(best, Verdict.SATISFIED)
        broken = _decided(_joined(worst, max(t_off_s, max_gap_s)), Verdict.VIOLATED)
        # Numbers of violations are not monotone: pauses may have been in a gap, or not.
        further = split_by_pauses(kept, broken, t_off_s)
        if not split_by_pauses(best, worst, t_off_s) and alike(joined_where_one(best, worst), worst):
            undecided = any(one.verdict is Verdict.INCONCLUSIVE for one in seen)
            yield from worst if undecided else seen
            return
        yield from seen
        causes = causes_of_cells(opened, window, tuple(unseen.remarks))
        yield Worlds(subject, tuple(joined_where_one(kept, broken)), (*broken, *further), causes)
    else:
        yield from seen
        monitor = Worsening({}, measures, t_off_s, clause, critical=critical)
        spans = _spans(signals, opened, window, max_gap_s)
        reached = [
            Span(
                max(window.start_s, one.start_s - ahead_s - t_on_s),
                min(window.end_s, one.end_s + back_s + t_on_s),
            )
            for one in spans
        ]
        if reached:
            hidden = merged(reached, within_s=TOLERANCE_S)
            yield blunt_worlds(subject, monitor, [[Judged((), seen)]], opened, hidden)


def _filled(
    unseen: Unseen, signals: Mapping[str, Signal], opened: Sequence[Stream], window: Span
) -> FilledSignals | None:
    """Both ends of all signals; `None` where nothing bounds one of them."""
    rate_m_s = max(unseen.rate_m_s(signal) for signal in signals.values())
    measured = [t for signal in signals.values() for t in unseen.measured(signal)]
    cells: Cells = cells_of(window, measured, opened, rate_m_s)
    ends = dict(zip(signals, unseen.bounds([*signals.values()], cells), strict=True))
    known = {name: both for name, both in ends.items() if both is not None}
    if len(known) < len(ends):
        return None
    is_open = np.any([least != most for least, most in known.values()], axis=0)
    least, most = ({name: both[end] for name, both in known.items()} for end in (0, 1))
    return FilledSignals(cells.t, least, most, is_open)


def _spans(
    signals: Mapping[str, Signal], opened: Sequence[Stream], window: Span, max_gap_s: float
) -> list[Span]:
    """Where something may have been that no sample shows."""
    found = [
        span
        for signal in signals.values()
        for span in uncovered_spans(signal.t, window, max_gap_s=max_gap_s, holes=signal.holes)
        if not signal.constant
    ]
    found += [span for stream in opened for span in stream.spans(window)]
    return merged(found, within_s=TOLERANCE_S)


def _joined(findings: Sequence[Finding], within_s: float) -> list[Finding]:
    """The same with undecided stretches joined that are no further apart: they may have been one."""
    found: list[Finding] = []
    for one in findings:
        found.append(_as_one(found.pop(), one) if found and _goes_on(found[-1], one, within_s) else one)
    return found


def _as_one(one: Finding, other: Finding) -> Finding:
    """Two undecided stretches as one."""
    assert one.span is not None
    assert other.span is not None
    names = sorted({*one.quantities, *other.quantities})
    quantities = {n: exact_sum(f.quantities.get(n, 0.0) for f in (one, other)) for n in names}
    span = Span(one.span.start_s, max(one.span.end_s, other.span.end_s))
    return replace(one, span=span, quantities=quantities)


def _goes_on(one: Finding, other: Finding, within_s: float) -> bool:
    """Whether two undecided stretches are no further apart."""
    undecided = one.verdict is other.verdict is Verdict.INCONCLUSIVE
    if not undecided or one.span is None or other.span is None:
        return False
    return other.span.start_s - one.span.end_s <= within_s + TOLERANCE_S


def _decided(findings: Sequence[Finding], as_verdict: Verdict) -> tuple[Finding, ...]:
    """What not even a world decides, such as what lies beyond the trial, counted as an end."""
    return tuple(
        replace(one, verdict=as_verdict) if one.verdict is Verdict.INCONCLUSIVE else one for one in findings
    )
