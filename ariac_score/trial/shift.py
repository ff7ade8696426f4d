"""A trial on a clock that started earlier or later."""

from __future__ import annotations

from dataclasses import replace

from ariac_score.trial.model import Kit, KitRecord, Trial
from ariac_score.trial.spans import Span
from ariac_score.trial.work import at_times

__all__ = ["shifted"]


class _ShiftedKits:
    """A record of kits on the other clock."""

    def __init__(self, record: KitRecord, by_s: float) -> None:
        self._record, self._by_s = record, by_s

    def seen(self, place: str, t_s: float, *, max_age_s: float) -> Kit | None:
        """What the record shows at the same moment."""
        kit = self._record.seen(place, t_s - self._by_s, max_age_s=max_age_s)
        return None if kit is None else replace(kit, t_s=kit.t_s + self._by_s)


def shifted(trial: Trial, by_s: float) -> Trial:
    """The same trial with every time later by a number of seconds."""
    recorded = trial.recorded
    return replace(
        trial,
        work=at_times(trial.work, lambda t_s: t_s + by_s),
        submissions=tuple(replace(s, submitted_s=s.submitted_s + by_s) for s in trial.submissions),
        events=tuple(replace(event, t_s=event.t_s + by_s) for event in trial.events),
        signals={name: replace(s, t=s.t + by_s) for name, s in trial.signals.items()},
        recorded=None if recorded is None else Span(recorded.start_s + by_s, recorded.end_s + by_s),
        kits=tuple(_ShiftedKits(record, by_s) for record in trial.kits),
    )
