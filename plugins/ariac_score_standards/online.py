"""Watching robots and humans while a trial goes on: instant by instant, from samples as they come.

An instant is judged as soon as every signal has reached it, from the same values that
`ariac_score.align` gives afterwards; nothing is judged in a gap. What was stepped is
kept, so that the findings at the end are those of the whole log.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ariac_score import Alignment, Arrivals, Body, Event, Finding, Sample, Standing, Trial
from ariac_score_standards.watching import Watched


@dataclass(frozen=True)
class _Pair:
    """Whose signals are judged together."""

    subject: str
    names: Mapping[str, str]
    units: Mapping[str, str]
    alignment: Alignment


class PairsOnline:
    """Watches every robot and human of whom all signals come.

    Args:
        wanted: Unit by signal template; the first names both `{robot}` and `{human}`.
        bodies: Those known beforehand; who is not among them is what its signal says.
        max_gap_s: Longest stretch between two samples that is bridged, s.
        judge: What holds at one instant, given a subject and its signals there.
        watch: What the monitor finds in a whole trial.
    """

    def __init__(
        self,
        wanted: Mapping[str, str],
        bodies: Sequence[Body],
        *,
        max_gap_s: float,
        judge: Callable[[str, Watched], Standing],
        watch: Callable[[Trial], Iterable[Finding]],
    ) -> None:
        self._wanted, self._max_gap_s, self._judge, self._watch = wanted, max_gap_s, judge, watch
        self._kinds = {body.id: body.kind for body in bodies}
        first = (
            re.escape(next(iter(wanted))).replace(r"\{robot\}", "([^/]+)").replace(r"\{human\}", "([^/]+)")
        )
        self._of_pair = re.compile(first)
        self._arrivals = Arrivals()
        self._seen: set[str] = set()
        self._by_signal: dict[str, list[_Pair]] = {}

    def step(self, samples: Sequence[Sample], events: Sequence[Event] = ()) -> Iterator[Standing]:
        """Take samples, and judge every instant that all signals have reached by now."""
        del events  # of which nothing hangs
        self._arrivals.take(samples)
        touched: dict[str, _Pair] = {}
        for sample in samples:
            if sample.signal not in self._seen:
                self._begin(sample.signal)
            for pair in self._by_signal.get(sample.signal, ()):
                touched[pair.subject] = pair
        for subject in sorted(touched):
            yield from self._judged(touched[subject])

    def end(self, trial: Trial) -> Iterable[Finding]:
        """What the monitor finds in the trial with the samples that were stepped."""
        return self._watch(self._arrivals.complete(trial))

    def _begin(self, signal: str) -> None:
        self._seen.add(signal)
        named = self._of_pair.fullmatch(signal)
        if named is None:
            return
        robot, human = named.groups()
        if self._kinds.get(robot, "robot") != "robot" or self._kinds.get(human, "human") != "human":
            return
        names = {template: template.format(robot=robot, human=human) for template in self._wanted}
        units = dict(zip(names.values(), self._wanted.values(), strict=True))
        aligned = self._arrivals.aligned(list(units), max_gap_s=self._max_gap_s)
        pair = _Pair(f"{robot}/{human}", names, units, aligned)
        for name in units:
            self._by_signal.setdefault(name, []).append(pair)

    def _judged(self, pair: _Pair) -> Iterator[Standing]:
        for t_s, values in pair.alignment.rows():
            columns = {name: np.array([value]) for name, value in zip(pair.units, values, strict=True)}
            now = Watched(np.array([t_s]), columns, [], self._max_gap_s, pair.units, pair.names)
            yield self._judge(pair.subject, now)
