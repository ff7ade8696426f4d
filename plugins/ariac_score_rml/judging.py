"""From the verdicts on events to the findings about one subject."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan

import numpy as np

from ariac_score import (
    Chart,
    Finding,
    Sample,
    Signal,
    Span,
    Trial,
    Verdict,
    episodes_where,
    exact_sum,
    sample_durations,
)
from ariac_score_rml.automaton import watch_stream
from ariac_score_rml.columns import Columns, FloatArray, IntArray, Match, Stream
from ariac_score_rml.faults import RmlRunError
from ariac_score_rml.machine import Machine
from ariac_score_rml.margins import margins
from ariac_score_rml.progress import AfterViolation
from ariac_score_rml.recorded import Recorded

__all__ = ["Judgement", "Settings"]

_TIME_TOLERANCE_S = 1e-9


@dataclass(frozen=True)
class Settings:
    """How a trial is judged.

    Attributes:
        after: What follows a rejection.
        max_gap_s: An event stands for no longer than this, s.
        t_on_s: Shorter violations are none, s.
        t_off_s: Violations with a shorter pause between them are one, s.
        spec_sha256: SHA-256 of the specification.
    """

    after: AfterViolation
    max_gap_s: float
    t_on_s: float
    t_off_s: float
    spec_sha256: str


class Judgement:
    """A specification over the events of one subject.

    Args:
        machine: The specification.
        settings: How it is judged.
        subject: Whom the events are about.
        recorded: The events, by topic; there has to be one.
        decided: Whether nothing is undecided before the events are judged.
    """

    def __init__(
        self,
        machine: Machine,
        settings: Settings,
        subject: str,
        recorded: Sequence[Recorded],
        *,
        decided: bool,
    ) -> None:
        self.subject = subject
        self._settings, self._recorded = settings, recorded
        self._decided, self._labels = decided, {"spec_sha256": settings.spec_sha256}
        self._stream = Stream([item.topic for item in recorded])
        columns = Columns(machine.matcher, self._stream)
        self._watch = watch_stream(machine, self._stream, settings.after, columns)
        match = margins(machine, self._stream, self._watch, columns) or Match.alike(True, len(self._stream))
        # NaN where no inequality decides, which is where a margin is infinite.
        measured = np.isfinite(match.margin)
        self._margin = match.margin if measured.all() else np.where(measured, match.margin, nan)
        self._bound, self._field = match.bound, match.field

    def _unit(self, row: int) -> str:
        """The unit of a margin: that of the field which an inequality limits."""
        return self._recorded[int(self._stream.topic[row])].unit(int(self._field[row]))

    @property
    def signals(self) -> dict[str, Signal]:
        """What it reads, by name."""
        return {one.name: one for item in self._recorded for one in item.signals.values()}

    # Margins -----------------------------------------------------------------------------

    @property
    def chart(self) -> Chart | None:
        """The margin over time, the least of events at one time; `None` unless all have one unit."""
        known = np.isfinite(self._margin)
        if self._watch.error_at >= 0:
            known[self._watch.error_at] = False
        units = {self._unit(row) for row in self._examples(np.flatnonzero(known))}
        if len(units) != 1:
            return None
        # The tolerance of guards decides near a limit: a rejected event is never shown within its limit.
        margin = np.where(self._watch.rejected, np.minimum(self._margin, 0.0), np.maximum(self._margin, 0.0))
        t, first = np.unique(self._stream.t, return_index=True)
        least = np.minimum.reduceat(np.where(known, margin, inf), first)
        has_margin = np.isfinite(least)
        return Chart(
            self.subject,
            "margin of the specification",
            units.pop(),
            t,
            np.where(has_margin, least, 0.0),
            np.where(has_margin, 0.0, nan),
            max_gap_s=self._settings.max_gap_s,
        )

    def _examples(self, rows: IntArray) -> list[int]:
        """One of these events for each topic and limited field."""
        pairs = np.stack([self._stream.topic[rows], self._field[rows]])
        _, first = np.unique(pairs, axis=1, return_index=True)
        return [int(row) for row in rows[first]]

    # Findings ----------------------------------------------------------------------------

    def findings(self, trial: Trial) -> Iterator[Finding]:
        """Its violations, or that there are none."""
        spans = self._episodes()
        yield from self._violations(spans)
        if self._watch.error is not None:
            yield self._not_judged(trial, self._watch.error)
            return
        ends = self._end(trial)
        yield from ends
        if not spans and not ends and self._decided:
            yield self._kept()

    def _episodes(self) -> list[Span]:
        """The episodes of rejected events: of each topic, then joined across topics."""
        settings, found = self._settings, list[Span]()
        for index, item in enumerate(self._recorded):
            rejected = self._watch.rejected[self._stream.rows_of(index)]
            found += episodes_where(
                item.topic.t,
                rejected,
                t_on_s=settings.t_on_s,
                t_off_s=settings.t_off_s,
                longest_s=settings.max_gap_s,
            )
        joined: list[Span] = []
        for span in sorted(found):
            if joined and (
                span.overlaps(joined[-1])
                or span.start_s - joined[-1].end_s < settings.t_off_s - _TIME_TOLERANCE_S
            ):
                joined[-1] = Span(joined[-1].start_s, max(joined[-1].end_s, span.end_s))
            else:
                joined.append(span)
        return joined

    def _violations(self, spans: Sequence[Span]) -> Iterator[Finding]:
        rejected = np.flatnonzero(self._watch.rejected)
        t, lasts_s = self._stream.t[rejected], self._lasts_s(rejected)
        for span in spans:
            inside = slice(t.searchsorted(span.start_s), t.searchsorted(span.end_s, "right"))
            yield self._violation(span, rejected[inside], lasts_s[inside])

    def _violation(self, span: Span, rows: IntArray, lasts_s: FloatArray) -> Finding:
        """One violation: the events rejected in it and how long they stand, the worst of them as evidence."""
        measured = rows[np.isfinite(self._margin[rows])]
        worst = int(measured[self._margin[measured].argmin()] if len(measured) else rows[0])
        margin = min(float(self._margin[worst]), 0.0) if len(measured) else None
        unit = self._unit(worst) if len(measured) else ""
        many = "event is" if len(rows) == 1 else f"{len(rows)} events are"
        topic = self._recorded[int(self._stream.topic[worst])].topic
        where = f"{topic.name!r} at {self._stream.t[worst]:.3f} s"
        by = (
            f"; at worst {-margin:.3f} {unit or 'units'} beyond its limit"
            if margin is not None
            else "; first"
        )
        final = " and nothing later is judged" if self._settings.after == "once" else ""
        return Finding(
            self.subject,
            Verdict.VIOLATED,
            f"{many} rejected{final}{by}, {where}",
            span=span,
            robustness=margin,
            unit=unit,
            quantities=self._quantities(rows, lasts_s, in_metres=unit == "m" and len(measured) == len(rows)),
            labels=self._labels,
            evidence=self._evidence(worst),
        )

    def _quantities(self, rows: IntArray, lasts_s: FloatArray, *, in_metres: bool) -> dict[str, float]:
        """What is measured of rejected events: how long, and how far beyond their limits."""
        found = {"time_in_violation_s": exact_sum(lasts_s)}
        if in_metres:
            depth, bound = np.maximum(-self._margin[rows], 0.0), self._bound[rows]
            with np.errstate(over="ignore"):  # of a limit near 0, where all of it is the share
                share = np.divide(depth, bound, out=np.ones_like(depth), where=bound > 0).clip(0.0, 1.0)
            found["depth_max_m"] = float(depth.max())
            found["depth_integral_m_s"] = exact_sum(depth * lasts_s)
            found["relative_depth_max"] = float(share.max())
            found["relative_depth_integral_s"] = exact_sum(share * lasts_s)
        return found

    def _lasts_s(self, rows: IntArray) -> FloatArray:
        """How long events stand for, each until the next one of its topic."""
        lasts_s = np.zeros(len(rows))
        for index, item in enumerate(self._recorded):
            here = np.flatnonzero(self._stream.topic[rows] == index)
            durations_s = sample_durations(item.topic.t, longest_s=self._settings.max_gap_s)
            lasts_s[here] = durations_s[self._stream.row[rows[here]]]
        return lasts_s

    def _evidence(self, row: int) -> tuple[Sample, ...]:
        samples = self._recorded[int(self._stream.topic[row])].samples(int(self._stream.row[row]))
        t_s, bound = float(self._stream.t[row]), float(self._bound[row])
        if not isfinite(bound) or not isfinite(self._margin[row]):
            return samples
        return (*samples, Sample(f"bound/{self.subject}", t_s, bound, self._unit(row)))

    def _not_judged(self, trial: Trial, error: RmlRunError) -> Finding:
        at, span, where = self._watch.error_at, trial.window, "the beginning"
        if at >= 0:
            t_s = float(self._stream.t[at])
            where = f"event {at + 1}, at {t_s:.3f} s"
            span = span and Span(min(t_s, span.end_s), span.end_s)
        message = f"cannot be judged from {where}: {error}"
        return Finding(self.subject, Verdict.INCONCLUSIVE, message, span=span, labels=self._labels)

    def _end(self, trial: Trial) -> list[Finding]:
        """The finding about a trial that ends where the specification may not."""
        watch = self._watch
        restarted = self._settings.after == "restart" and bool(watch.rejected.any())
        if watch.end != "f" or (restarted and watch.fresh):
            return []
        end_s = float(self._stream.t[-1])
        message, verdict = "the trial ends where the specification still asks for something", Verdict.VIOLATED
        if trial.ended_s is None:
            # What it asks for may have come after the recording. A log with a start and no end has
            # its own finding about that.
            if not self._decided:
                return []
            message = (
                "the log ends where the specification still asks for something, and does not show "
                "the end of the competition"
            )
            verdict = Verdict.INCONCLUSIVE
        return [Finding(self.subject, verdict, message, span=Span(end_s, end_s), labels=self._labels)]

    def _kept(self) -> Finding:
        if not np.isfinite(self._margin).any():
            message = f"all {len(self._stream)} events are accepted"
            return Finding(self.subject, Verdict.SATISFIED, message, labels=self._labels)
        closest = int(np.nanargmin(self._margin))
        margin, unit = max(float(self._margin[closest]), 0.0), self._unit(closest)
        return Finding(
            self.subject,
            Verdict.SATISFIED,
            f"at its closest {margin:.3f}{unit and ' '}{unit} within its limit, "
            f"at {self._stream.t[closest]:.3f} s",
            robustness=margin,
            unit=unit,
            labels=self._labels,
            evidence=self._evidence(closest),
        )
