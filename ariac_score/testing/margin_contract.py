"""The contract of monitors that give their margin at every sample, as a check: margins fit findings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ariac_score.checks.findings import Finding
from ariac_score.results.result import canonical
from ariac_score.trial.chart import Chart
from ariac_score.trial.model import Trial
from ariac_score.trial.vocabulary import quantity_of

__all__ = ["margin_fault"]


def margin_fault(
    trial: Trial, needed: Sequence[str], findings: Sequence[Finding], charts: Sequence[Chart]
) -> str:
    """Where margins contradict the findings, in words; empty when they fit.

    Args:
        trial: With what the monitor needs.
        needed: The quantities it needs.
        findings: What it found, with the digits of a result.
        charts: Its margins.
    """
    times = [signal.t for name, signal in trial.signals.items() if quantity_of(name) in needed]
    recorded = np.unique(np.concatenate(times)) if times else np.zeros(0)
    for chart in charts:
        strange = np.setdiff1d(chart.t, recorded)
        if len(strange):
            return f"gives a margin of {chart.subject!r} at {strange[0]:g} s, where there is no sample"
    for finding in findings:
        own = [chart for chart in charts if chart.subject == finding.subject]
        if not own or finding.robustness is None or not (finding.span or finding.evidence):
            continue
        # Equal, not close: both come from one judgement, and both have the digits of a result.
        if not any(_least(chart, finding) == finding.robustness for chart in own):
            where = f"{finding.verdict.value} {finding.subject!r} by {finding.robustness:g} {finding.unit}"
            least = ", ".join(f"{_least(chart, finding)} {chart.unit}" for chart in own)
            return f"found {where}, but the least margin it gives there is {least}"
    return ""


def _least(chart: Chart, finding: Finding) -> float | None:
    """The least margin within the span of a finding, or of all; `None` where there is none in its unit."""
    inside = np.isfinite(chart.margin)
    if finding.span is not None:
        inside &= (chart.t >= finding.span.start_s) & (chart.t <= finding.span.end_s)
    if chart.unit != finding.unit or not inside.any():
        return None
    return canonical(float(chart.margin[inside].min()))
