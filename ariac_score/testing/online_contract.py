"""The contract of monitors that watch while a trial goes on, as checks: online equals offline.

A recording is stepped through in two ways, each sample alone and each instant as a whole.
Both must end in the findings of the whole log, and the verdicts of instants must fit them.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from typing import Any

from ariac_score.checks.contracts import InstantVerdict, OnlineMonitor
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.trial.events import Event
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Sample

__all__ = ["OnlineChecks"]

Step = tuple[tuple[Sample, ...], tuple[Event, ...]]


class OnlineChecks:
    """Examines a monitor that offers to watch online.

    Args:
        monitor: The monitor; it has `begin`.
        trial: The recording, with what the monitor needs.
        needed: The quantities it needs.
        broken: Makes the error that names the plugin.
    """

    def __init__(
        self, monitor: Any, trial: Trial, needed: Sequence[str], broken: Callable[[str], Exception]
    ) -> None:
        self._monitor, self._trial, self._broken = monitor, trial, broken
        self._items = _items(trial, frozenset(needed))
        self._blind = replace(trial, signals={})

    def one_by_one(self) -> list[Finding]:
        """Its findings when each sample comes alone."""
        return self._stepped([_step(item) for item in self._items])[1]

    def instant_by_instant(self) -> list[Finding]:
        """Its findings when everything of one time comes together; verdicts of instants stay the same."""
        together, found = self._stepped(self._instants())
        alone, _ = self._stepped([_step(item) for item in self._items])
        if _by_subject(together) != _by_subject(alone):
            raise self._broken("gives other verdicts when the samples of an instant come together")
        return found

    def standings(self, findings: Sequence[Finding]) -> None:
        """Verdicts of instants are never of the future, are in order, and fit the findings."""
        steps = self._instants()
        watch = self._watch()
        verdicts: list[InstantVerdict] = []
        now_s = -math.inf
        for samples, events in steps:
            now_s = max(now_s, *(s.t_s for s in samples), *(e.t_s for e in events))
            for standing in watch.step(samples, events):
                self._require_sound(standing, now_s)
                verdicts.append(standing)
        for subject, own in _by_subject(verdicts).items():
            self._require_fitting(subject, own, [f for f in findings if f.subject == subject])

    def repeated_time(self) -> None:
        """A time that does not increase is refused."""
        watch = self._watch()
        firsts = {item.signal: item for item in reversed(self._items) if isinstance(item, Sample)}
        if not firsts:
            return
        list(watch.step(tuple(firsts.values())))
        try:
            list(watch.step(tuple(firsts.values())))
        except ValueError:
            return
        raise self._broken(f"takes two samples of one time without a word: {sorted(firsts)}")

    def nothing_stepped(self) -> list[Finding]:
        """Its findings when nothing came."""
        return list(self._watch().end(self._blind))

    def _watch(self) -> Any:
        if not isinstance(self._monitor, OnlineMonitor):
            raise self._broken("has begin() and is no monitor otherwise")
        watch = self._monitor.begin(self._trial.bodies)
        if not callable(getattr(watch, "step", None)) or not callable(getattr(watch, "end", None)):
            raise self._broken(f"begins a {type(watch).__name__}, which has no step() and end()")
        return watch

    def _stepped(self, steps: Sequence[Step]) -> tuple[list[InstantVerdict], list[Finding]]:
        watch = self._watch()
        verdicts = [standing for samples, events in steps for standing in watch.step(samples, events)]
        return verdicts, list(watch.end(self._blind))

    def _instants(self) -> list[Step]:
        return [
            (
                tuple(item for item in together if isinstance(item, Sample)),
                tuple(item for item in together if isinstance(item, Event)),
            )
            for _, group in groupby(self._items, key=lambda item: item.t_s)
            for together in [list(group)]
        ]

    def _require_sound(self, standing: Any, now_s: float) -> None:
        if not isinstance(standing, InstantVerdict):
            raise self._broken(f"steps to a {type(standing).__name__}, which is no InstantVerdict")
        if not standing.t_s <= now_s:
            raise self._broken(f"judges {standing.t_s:g} s when only {now_s:g} s has come")
        if standing.robustness is not None and not (standing.unit and math.isfinite(standing.robustness)):
            raise self._broken(f"gives a margin that is infinite or has no unit: {standing.message!r}")

    def _require_fitting(
        self, subject: str, verdicts: Sequence[InstantVerdict], found: Sequence[Finding]
    ) -> None:
        for before, after in pairwise(verdicts):
            if not before.t_s < after.t_s:
                raise self._broken(f"judges {subject!r} at {before.t_s:g} s and then at {after.t_s:g} s")
            if before.final and after.verdict is not before.verdict:
                raise self._broken(
                    f"calls {subject!r} {before.verdict.value} for good at {before.t_s:g} s, "
                    f"and {after.verdict.value} at {after.t_s:g} s"
                )
        for finding in found:
            if finding.verdict is not Verdict.VIOLATED or finding.span is None:
                continue
            span = finding.span
            during = [one.verdict for one in verdicts if span.start_s <= one.t_s <= span.end_s]
            # A span between two instants has no verdict that could fit.
            if during and Verdict.VIOLATED not in during:
                raise self._broken(
                    f"finds {subject!r} violated from {span.start_s:g} s and calls it so at no "
                    f"instant: {finding.message!r}"
                )


def _items(trial: Trial, needed: frozenset[str]) -> list[Sample | Event]:
    """What comes while the trial goes on, in order of time."""
    signals = [one for name, one in sorted(trial.signals.items()) if name.partition("/")[0] in needed]
    # A derived signal keeps its values only while somebody holds them: else each sample computes them anew.
    held = [signal.values for signal in signals]
    samples: list[Sample | Event] = [signal.sample(i) for signal in signals for i in range(len(signal))]
    del held
    # What happens at an instant is known before what is measured at it.
    return sorted((*trial.events, *samples), key=lambda item: item.t_s)


def _step(item: Sample | Event) -> Step:
    return ((item,), ()) if isinstance(item, Sample) else ((), (item,))


def _by_subject(verdicts: Sequence[InstantVerdict]) -> Mapping[str, list[InstantVerdict]]:
    found: dict[str, list[InstantVerdict]] = defaultdict(list)
    for standing in verdicts:
        found[standing.subject].append(standing)
    return found
