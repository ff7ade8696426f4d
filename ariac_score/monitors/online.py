"""Watching subjects while a trial goes on: instant by instant, from samples as they come.

An instant is judged as soon as every signal has reached it, from the same values that
`ariac_score.align` gives afterwards; nothing is judged in a gap. What was stepped is
kept, so that the findings at the end are those of the whole log.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ariac_score.checks.contracts import InstantVerdict
from ariac_score.checks.findings import Finding
from ariac_score.monitors.subjects import Subject, Subjects
from ariac_score.trial.arrivals import Alignment, Arrivals, Value
from ariac_score.trial.events import Event
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.signals import Sample

__all__ = ["SubjectsOnline"]

Judge = Callable[[str, float, Mapping[str, Any]], InstantVerdict]
"""What holds at one instant, given a subject, the time, and its values by template.

Plain numbers, not columns of one row: formulas take both, and arrays of length 1 take ten times as long.
"""


@dataclass(frozen=True)
class _Followed:
    """A subject, and its signals on one time base."""

    subject: str
    names: Mapping[str, str]
    alignment: Alignment


class SubjectsOnline:
    """Watches every subject of whom all signals come, by a monitor that judges each sample alone.

    Who is not known beforehand shows by a signal that names a whole pair: a body not among
    `bodies` is of the kind that its place in that name says.

    Args:
        subjects: Whom the monitor is about.
        templates: Its signals.
        bodies: Those known beforehand.
        max_gap_s: Longest stretch between two samples that is bridged, s.
        judge: What holds at one instant.
        watch: What the monitor finds in a whole trial.
        lacks: Why nothing can be judged at all; empty: it can.
    """

    def __init__(
        self,
        subjects: Subjects,
        templates: Sequence[str],
        bodies: Sequence[Body],
        *,
        max_gap_s: float,
        judge: Judge,
        watch: Callable[[Trial], Iterable[Finding]],
        lacks: str = "",
    ) -> None:
        self._subjects, self._templates = subjects, templates
        self._max_gap_s, self._judge, self._watch = max_gap_s, judge, watch
        self._kinds = {body.id: body.kind for body in bodies}
        self._naming = None if lacks else _naming(subjects, templates)
        self._arrivals = Arrivals()
        self._by_signal: dict[str, list[_Followed]] = {}
        known = [] if lacks else subjects.of(bodies)
        unknown = "" if known or self._naming else "whom it is about is not known before the trial"
        self.undecided = lacks or unknown
        for subject in known:
            self._follow(subject)

    def step(self, samples: Sequence[Sample], events: Sequence[Event] = ()) -> Iterator[InstantVerdict]:
        """Take samples, and judge every instant that all signals have reached by now."""
        del events  # nothing depends on them
        self._arrivals.take(samples)
        touched: dict[str, _Followed] = {}
        for sample in samples:
            watching = self._by_signal.get(sample.signal)
            if watching is None:
                watching = self._by_signal[sample.signal] = []
                self._on_new_signal(sample.signal)  # may add to `watching`
            for followed in watching:
                touched[followed.subject] = followed
        # By name, so that the order of samples within an instant does not show in the verdicts.
        for subject in sorted(touched) if len(touched) > 1 else touched:
            followed = touched[subject]
            for t_s, values in followed.alignment.rows():
                yield self._judge(subject, t_s, dict(zip(followed.names, map(_plain, values), strict=True)))

    def end(self, trial: Trial) -> Iterable[Finding]:
        """What the monitor finds in the trial with the samples that were stepped."""
        return self._watch(self._arrivals.complete(trial))

    def _on_new_signal(self, signal: str) -> None:
        """Follow the pair that a signal names when it comes for the first time."""
        named = self._naming.fullmatch(signal) if self._naming else None
        if named is None:
            return
        ids = dict(zip(self._subjects.places, map(named.group, self._subjects.places), strict=True))
        if all(
            self._kinds.get(id_, kind) == kind
            for id_, kind in zip(ids.values(), self._subjects.kinds, strict=True)
        ):
            self._follow(Subject("/".join(ids.values()), ids))

    def _follow(self, subject: Subject) -> None:
        names = {template: subject.fill(template) for template in self._templates}
        alignment = self._arrivals.aligned([*names.values()], max_gap_s=self._max_gap_s)
        followed = _Followed(subject.name, names, alignment)
        for name in dict.fromkeys(names.values()):
            self._by_signal.setdefault(name, []).append(followed)


def _plain(value: Value) -> Any:
    return np.array(value) if isinstance(value, tuple) else value


def _naming(subjects: Subjects, templates: Sequence[str]) -> re.Pattern[str] | None:
    """What finds a whole pair in the name of a signal; of a single body no name tells the kind."""
    if len(subjects.places) < 2:
        return None
    for template in templates:
        if all(f"{{{place}}}" in template for place in subjects.places):
            pattern = re.escape(template)
            for place in subjects.places:
                pattern = pattern.replace(re.escape(f"{{{place}}}"), f"(?P<{place}>[^/]+)", 1)
            return re.compile(pattern)
    return None
