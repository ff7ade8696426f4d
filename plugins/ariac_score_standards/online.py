"""Watching robots and humans while a trial goes on: instant by instant, from samples as they come.

An instant is judged as soon as every signal has reached it, from the same values that
`ariac_score.align` gives afterwards; nothing is judged in a gap. What was stepped is
kept, so that the findings at the end are those of the whole log.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from ariac_score import Alignment, Arrivals, Body, Event, Finding, Sample, Standing, Trial

Judge = Callable[[str, float, tuple[float, ...]], Standing]
"""What holds at one instant, given a subject, the time and its values in the order of the templates."""


@dataclass(frozen=True)
class _Pair:
    """Whose signals are judged together."""

    subject: str
    alignment: Alignment


class PairsOnline:
    """Watches every robot and human of whom all signals come.

    Args:
        wanted: Unit by signal template; the first names both `{robot}` and `{human}`.
        bodies: Those known beforehand; who is not among them is what its signal says.
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
        self._wanted, self._max_gap_s, self._judge, self._watch = wanted, max_gap_s, judge, watch
        self._kinds = {body.id: body.kind for body in bodies}
        first = (
            re.escape(next(iter(wanted))).replace(r"\{robot\}", "([^/]+)").replace(r"\{human\}", "([^/]+)")
        )
        self._of_pair = re.compile(first)
        self._arrivals = Arrivals()
        self._by_signal: dict[str, list[_Pair]] = {}

    def step(self, samples: Sequence[Sample], events: Sequence[Event] = ()) -> Iterator[Standing]:
        """Take samples, and judge every instant that all signals have reached by now."""
        del events  # of which nothing hangs
        self._arrivals.take(samples)
        touched: dict[str, _Pair] = {}
        for sample in samples:
            pairs = self._by_signal.get(sample.signal)
            if pairs is None:
                pairs = self._begun(sample.signal)
            for pair in pairs:
                touched[pair.subject] = pair
        for subject in sorted(touched) if len(touched) > 1 else touched:
            for t_s, values in touched[subject].alignment.rows():
                yield self._judge(subject, t_s, values)  # type: ignore[arg-type]  # they have one component

    def end(self, trial: Trial) -> Iterable[Finding]:
        """What the monitor finds in the trial with the samples that were stepped."""
        return self._watch(self._arrivals.complete(trial))

    def _begun(self, signal: str) -> list[_Pair]:
        """The pairs that a signal, which is new, speaks of."""
        own = self._by_signal.setdefault(signal, [])
        named = self._of_pair.fullmatch(signal)
        if named is None:
            return own
        robot, human = named.groups()
        if self._kinds.get(robot, "robot") == "robot" and self._kinds.get(human, "human") == "human":
            names = [template.format(robot=robot, human=human) for template in self._wanted]
            aligned = self._arrivals.aligned(names, max_gap_s=self._max_gap_s)
            pair = _Pair(f"{robot}/{human}", aligned)
            for name in names:
                self._by_signal.setdefault(name, []).append(pair)
        return own
