"""Watching robots and humans while a trial goes on: instant by instant, from samples as they come.

An instant is judged as soon as every signal has reached it, from the same values that
`ariac_score.align` gives afterwards; nothing is judged in a gap. What was stepped is
kept, so that the findings at the end are those of the whole log.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ariac_score import Alignment, Arrivals, Body, Event, Finding, InstantVerdict, Sample, Trial

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

    Args:
        subjects: For each, by its name, the signal name of each template.
        max_gap_s: Longest stretch between two samples that is bridged, s.
        judge: What holds at one instant.
        watch: What the monitor finds in a whole trial.
    """

    def __init__(
        self,
        subjects: Mapping[str, Mapping[str, str]],
        *,
        max_gap_s: float,
        judge: Judge,
        watch: Callable[[Trial], Iterable[Finding]],
    ) -> None:
        self._max_gap_s, self._judge, self._watch = max_gap_s, judge, watch
        self._arrivals = Arrivals()
        self.undecided = "" if subjects else "whom it is about is not known before the trial"
        self._by_signal: dict[str, list[_Followed]] = {}
        for subject, names in subjects.items():
            self._follow(subject, names)

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
                yield self._judge(subject, t_s, dict(zip(followed.names, values, strict=True)))

    def end(self, trial: Trial) -> Iterable[Finding]:
        """What the monitor finds in the trial with the samples that were stepped."""
        return self._watch(self._arrivals.complete(trial))

    def _on_new_signal(self, signal: str) -> None:
        """Called when a signal comes for the first time."""

    def _follow(self, subject: str, names: Mapping[str, str]) -> None:
        alignment = self._arrivals.aligned([*names.values()], max_gap_s=self._max_gap_s)
        followed = _Followed(subject, names, alignment)
        for name in dict.fromkeys(names.values()):
            self._by_signal.setdefault(name, []).append(followed)


class PairsOnline(SubjectsOnline):
    """Watches every robot and human of whom all signals come.

    Args:
        wanted: Unit by signal template; the first names both `{robot}` and `{human}`.
        bodies: Those known beforehand; any other is a robot or a human by its place in the signal's name.
        max_gap_s: Longest stretch between two samples that is bridged, s.
        judge: What holds at one instant.
        watch: What the monitor finds in a whole trial.
    """

    def __init__(
        self,
        wanted: Mapping[str, str],
        bodies: Sequence[Body],
        *,
        max_gap_s: float,
        judge: Judge,
        watch: Callable[[Trial], Iterable[Finding]],
    ) -> None:
        self._wanted = wanted
        self._kinds = {body.id: body.kind for body in bodies}
        first = (
            re.escape(next(iter(wanted))).replace(r"\{robot\}", "([^/]+)").replace(r"\{human\}", "([^/]+)")
        )
        self._of_pair = re.compile(first)
        super().__init__({}, max_gap_s=max_gap_s, judge=judge, watch=watch)
        self.undecided = ""  # pairs show by their signals

    def _on_new_signal(self, signal: str) -> None:
        named = self._of_pair.fullmatch(signal)
        if named is None:
            return
        robot, human = named.groups()
        if self._kinds.get(robot, "robot") == "robot" and self._kinds.get(human, "human") == "human":
            names = {template: template.format(robot=robot, human=human) for template in self._wanted}
            self._follow(f"{robot}/{human}", names)
