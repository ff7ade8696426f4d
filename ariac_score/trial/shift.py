"""A trial on a clock that started earlier or later."""

from __future__ import annotations

from dataclasses import replace

from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import Span
from ariac_score.trial.work import at_times

__all__ = ["shifted"]


def shifted(trial: Trial, by_s: float) -> Trial:
    """The same trial with every time later by a number of seconds."""
    recorded = trial.recorded
    return replace(
        trial,
        work=at_times(trial.work, lambda t_s: t_s + by_s),
        submissions=tuple(replace(s, submitted_s=s.submitted_s + by_s) for s in trial.submissions),
        events=tuple(replace(event, t_s=event.t_s + by_s) for event in trial.events),
        signals={name: _shifted_signal(signal, by_s) for name, signal in trial.signals.items()},
        as_consumed={name: replace(s, t=s.t + by_s) for name, s in trial.as_consumed.items()},
        recorded=None if recorded is None else Span(recorded.start_s + by_s, recorded.end_s + by_s),
        records=tuple(record.shifted(by_s) for record in trial.records),
        cut=None if trial.cut is None else trial.cut.shifted(by_s),
    )


def _shifted_signal(signal: Signal, by_s: float) -> Signal:
    return replace(
        signal,
        t=signal.t + by_s,
        holes=_later(signal.holes, by_s),
        disbelieved=tuple(
            replace(one, span=_later((one.span,), by_s)[0], at_s=one.at_s + by_s)
            for one in signal.disbelieved
        ),
    )


def _later(spans: tuple[Span, ...], by_s: float) -> tuple[Span, ...]:
    return tuple(Span(span.start_s + by_s, span.end_s + by_s) for span in spans)
