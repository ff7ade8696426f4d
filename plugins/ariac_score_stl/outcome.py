"""Findings and margins of a formula that was judged: violations, what is undecided, or that it holds."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ariac_score import Chart, Finding, Sample, Signal, Span, Verdict, exact_sum
from ariac_score_stl.explain import Cause
from ariac_score_stl.judging import JudgedFormula
from ariac_score_stl.rows import TOLERANCE_S
from ariac_score_stl.syntax import reach_s

__all__ = ["Outcome"]


class Outcome:
    """The findings and the margins of one subject.

    Args:
        judged: The formula, judged.
        subject: Whom it is about.
        signals: The signals, by the names used in the formula.
    """

    def __init__(self, judged: JudgedFormula, subject: str, signals: Mapping[str, Signal]) -> None:
        self.judged, self.subject, self.signals = judged, subject, signals
        self.specification, self.span = judged.specification, judged.span

    def findings(self) -> Iterator[Finding]:
        """Every violation, everything undecided, or that the formula holds."""
        violations = self._violations()
        yield from violations
        undecided = [self._undecided(span) for span in self._undecided_spans()]
        yield from undecided
        beyond = self._beyond_the_trial()
        if beyond is not None:
            yield beyond
        if not violations and not undecided and beyond is None:
            yield self._kept()

    @property
    def chart(self) -> Chart | None:
        """The robustness of what is judged, over time; `None` where its unit changes or nothing is judged."""
        unit, judged = self.specification.shared_unit, self.judged
        if unit is None or not len(judged.begin):
            return None
        # By the verdict: of a margin of 0 the sign alone does not say whether it is broken.
        margin = np.where(judged.violated, judged.upper, judged.lower)
        known = np.isfinite(margin) & ~judged.undecided
        return Chart(
            self.subject,
            f"robustness of {judged.body.text}",
            unit,
            judged.begin[judged.sampled],
            np.where(known, margin, 0.0)[judged.sampled],
            np.where(known, 0.0, np.nan)[judged.sampled],
            max_gap_s=self.specification.max_gap_s,
        )

    # Violations --------------------------------------------------------------------------

    def _violations(self) -> list[Finding]:
        found = [self._violation(span) for span in self.judged.episodes()]
        units = self._units_anywhere({size for _, size in found if size is not None})
        return [one if size is None else replace(one, unit=units.get(size, "")) for one, size in found]

    def _violation(self, episode: Span) -> tuple[Finding, float | None]:
        """The finding; and the size of its robustness, where no predicate at that moment gives its unit."""
        judged = self.judged
        first = int(judged.begin.searchsorted(episode.start_s))
        last = int(judged.begin.searchsorted(episode.end_s, side="right"))
        worst = judged.worst(first, last)
        broken_s = judged.durations_s[first:last][judged.violated[first:last]]
        worst_s = judged.exactly(float(judged.begin[worst]))
        robustness = float(judged.upper[worst]) + 0.0  # so that -0.0 is written as 0
        span = self._exactly(self._within(episode))
        chain = judged.causes(worst_s, robustness)
        finite = math.isfinite(robustness)
        unit = self._unit(chain[-1], robustness) if finite else ""
        finding = Finding(
            self.subject,
            Verdict.VIOLATED,
            f"{self._how_long(span, worst_s)}: {self._why_broken(chain)}",
            span=span,
            robustness=robustness if finite else None,
            unit=unit or "",
            quantities={
                "time_in_violation_s": exact_sum(broken_s),
                "failed_at_s": judged.exactly(chain[-1].t_s),
            },
            labels={"failed": chain[0].node.text, "because_of": chain[-1].node.text},
            evidence=self._evidence([worst_s, *(cause.t_s for cause in chain)]),
            clause=self.specification.clause,
            critical=self.specification.critical,
        )
        return finding, abs(robustness) if unit is None else None

    def _within(self, episode: Span) -> Span:
        """The part of an episode that is judged: in dense time its last step may last longer than that."""
        if self.specification.time != "dense":
            return episode
        end_s = min(episode.end_s, self.judged.stretch.end_s)
        return Span(episode.start_s, max(end_s, episode.start_s))

    def _exactly(self, span: Span) -> Span:
        """A span without the tolerances that windows are laid out with."""
        # Each end moves by some tolerances, so of one moment the end may come to lie before the start.
        return Span(*sorted(self.judged.exactly(t_s) for t_s in (span.start_s, span.end_s)))

    def _how_long(self, span: Span, worst_s: float) -> str:
        if not self.specification.is_rule:
            return "does not hold"
        return f"violated for {span.duration_s:.3f} s, at worst at {worst_s:.3f} s"

    def _why_broken(self, chain: Sequence[Cause]) -> str:
        words = [
            f"{cause.node.text!r} {'holds' if cause.holds else 'fails'} at {cause.t_s:.3f} s"
            for cause in chain
        ]
        last = chain[-1]
        if last.node.operator == "predicate":
            margin = abs(float(self.judged.predicates[last.node][self.judged.sample(last.t_s)]))
            words[-1] += f" by {margin:.6g} {self.specification.margin_units[last.node]}".rstrip()
        return ", for ".join(words)

    def _evidence(self, moments: Sequence[float]) -> tuple[Sample, ...]:
        t, columns = self.judged.t, self.judged.columns
        return tuple(
            Sample(signal.name, float(t[row]), float(columns[name][row]), signal.unit)
            for row in sorted({self.judged.sample(t_s) for t_s in moments})
            for name, signal in self.signals.items()
        )

    # Undecided ---------------------------------------------------------------------------

    def _undecided_spans(self) -> Iterator[Span]:
        """Undecided moments next to each other, with the gaps among them."""
        begin = self.judged.begin
        (rows,) = np.nonzero(self.judged.undecided)
        if not len(rows):
            return
        ends = np.append(begin[1:], self.judged.stretch.end_s)
        for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            start_s, end_s = float(begin[run[0]]), float(max(ends[run[-1]], begin[run[-1]]))
            yield self._exactly(Span(start_s, end_s))

    def _undecided(self, span: Span) -> Finding:
        """A stretch that a gap, the end of the trial or a short window leaves open."""
        return Finding.inconclusive(
            self.subject,
            f"cannot be decided from {span.start_s:.3f} to {span.end_s:.3f} s: {self._why_undecided(span)}",
            span=span,
            clause=self.specification.clause,
        )

    def _why_undecided(self, span: Span) -> str:
        step_s = self.specification.max_gap_s
        back_s, ahead_s = (reach_s(self.judged.body, back=back, step_s=step_s) for back in (True, False))
        undecided = self.specification.beyond == "undecided"
        reasons = [
            f"no samples for {gap.duration_s:.3f} s, from {gap.start_s:.3f} s"
            for gap in self.judged.gaps
            if gap.end_s > span.start_s - back_s and gap.start_s < span.end_s + ahead_s
        ]
        if undecided and span.end_s + ahead_s > self.span.end_s + TOLERANCE_S:
            reasons.append(f"it looks beyond the end of the trial at {self.span.end_s:.3f} s")
        if undecided and span.start_s - back_s < self.span.start_s - TOLERANCE_S:
            reasons.append(f"it looks back beyond the start of the trial at {self.span.start_s:.3f} s")
        return "; ".join(reasons) or "its bounds are shorter than the time between two samples"

    def _beyond_the_trial(self) -> Finding | None:
        """The finding about the part of the outermost `always` that lies after the trial."""
        policy = self.specification.beyond
        if not self.judged.ends_beyond or policy in ("weak", "cut"):
            return None
        message = f"its window does not end before the trial does, at {self.span.end_s:.3f} s"
        clause = self.specification.clause
        if policy == "undecided":
            return Finding.inconclusive(self.subject, message, span=self.judged.stretch, clause=clause)
        return Finding(
            self.subject,
            Verdict.VIOLATED,
            message,
            span=Span(self.span.end_s, self.span.end_s),
            clause=clause,
            critical=self.specification.critical,
        )

    # Kept --------------------------------------------------------------------------------

    def _kept(self) -> Finding:
        judged = self.judged
        if not len(judged.begin):
            return self._none_judged()
        closest = int(judged.lower.argmin())
        robustness, at_s = float(judged.lower[closest]) + 0.0, float(judged.begin[closest])
        finite = math.isfinite(robustness)
        if judged.violated[closest]:
            message = f"never broken for {self.specification.t_on_s:g} s; at its worst at {at_s:.3f} s"
        elif self.specification.is_rule:
            message = f"holds throughout, at its closest at {at_s:.3f} s"
        else:
            message = "holds"
        unit = self._unit_at(robustness, at_s) if finite else ""
        if unit is None:
            unit = self._units_anywhere([abs(robustness)]).get(abs(robustness), "")
        return Finding(
            self.subject,
            Verdict.SATISFIED,
            message + (f" by {robustness:.6g} {unit}".rstrip() if finite else ""),
            robustness=robustness if finite else None,
            unit=unit,
            evidence=self._evidence([at_s]),
            clause=self.specification.clause,
        )

    def _none_judged(self) -> Finding:
        if self.judged.begins_beyond:
            message = f"its window begins after the trial, which ends at {self.span.end_s:.3f} s"
            return Finding.satisfied(self.subject, message, clause=self.specification.clause)
        message = "no sample lies in the window of its outermost 'always'"
        return Finding.inconclusive(
            self.subject, message, span=self.judged.stretch, clause=self.specification.clause
        )

    # Units -------------------------------------------------------------------------------

    def _unit(self, last: Cause, robustness: float) -> str | None:
        """The unit of a violation: of the predicate that it comes down to."""
        known = self.specification.margin_units.get(last.node)
        return self._unit_at(robustness, last.t_s) if known is None else known

    def _unit_at(self, robustness: float, at_s: float) -> str | None:
        """The unit that all predicates share; else that of one whose margin then has this size."""
        units, row = self.specification.margin_units, self.judged.sample(at_s)
        if self.specification.shared_unit is not None:
            return self.specification.shared_unit
        far = (u for n, u in units.items() if abs(self.judged.predicates[n][row]) == abs(robustness))
        return next(far, None)

    def _units_anywhere(self, sizes: Collection[float]) -> dict[float, str]:
        """For each size the unit of the first predicate whose margin has it at any sample."""
        wanted, found = np.array(sorted(sizes)), dict[float, str]()
        for node, unit in self.specification.margin_units.items() if len(wanted) else ():
            # Once for all sizes: there may be a thousand violations, of a million samples.
            size = np.abs(self.judged.predicates[node])
            at = np.minimum(wanted.searchsorted(size), len(wanted) - 1)
            for one in wanted[np.unique(at[wanted[at] == size])].tolist():
                found.setdefault(one, unit)
        return found
