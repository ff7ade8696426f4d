"""The margins of this moment, from the last second of what came: at a cost that does not grow."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from ariac_score.checks.contracts import Margined, Wanted
from ariac_score.engine.ask import margins_of
from ariac_score.engine.prepared import Prepared
from ariac_score.errors import CutOffError, ScoreError
from ariac_score.live.recent import Recent
from ariac_score.live.running import Instant, Place
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.trial.model import Trial

__all__ = ["Tail"]


class Tail:
    """The last moments of a trial, judged alone by every monitor that gives its margin at every sample.

    It shows and prices nothing: what a margin was is settled by the trial as a whole.

    Args:
        wanted: What the log map and the checks need.
        prepared: The rules.
        file: The recording.
        length_s: How much is kept, s: at least what a speed needs.
    """

    def __init__(self, wanted: Wanted, prepared: Prepared, file: Path, *, length_s: float = 0.25) -> None:
        self._prepared, self._file, self._length_ns = prepared, file, round(length_s * 1e9)
        self._wanted = replace(wanted, tracks=None)
        self._recent = Recent(self._wanted)
        self._margined = {
            name: each for name, each in prepared.checks.items() if isinstance(each.check, Margined)
        }

    def take(self, item: Connection | Message) -> None:
        """Take one item."""
        if self._margined:
            self._recent.take(item)

    def moment(self, elapsed_s: float) -> tuple[tuple[Instant, ...], tuple[Place, ...]]:
        """The latest margin of each check about each subject, and where bodies are, as far as it is known.

        Args:
            elapsed_s: From the first message of the trial to the latest, s.
        """
        if not self._margined:
            return (), ()
        self._recent.forget(self._recent.latest_ns - self._length_ns)
        intake = self._recent.intake(self._of_those_there, self._file)
        try:
            trial = intake.trial(CutOffError("the trial goes on", file=self._file), as_it_came=True)
            # What may have been between samples is not looked at: before the last moments nothing is kept.
            trial = replace(self._prepared.derived(trial), between=None)
            found = [
                (name, chart)
                for name, each in self._margined.items()
                for chart in margins_of(each.plugin, name, each.check, trial)
            ]
        except ScoreError:  # the judgement of the whole trial says what is wrong
            return (), ()
        assert trial.recorded is not None
        instants = []
        for name, chart in found:
            known = np.flatnonzero(~np.isnan(chart.margin))
            if len(known):
                last = int(known[-1])
                at_s = elapsed_s - (trial.recorded.end_s - float(chart.t[last]))
                numbers = float(chart.actual[last]), float(chart.limit[last])
                instants.append(
                    Instant(name, chart.subject, chart.what, at_s, *numbers, chart.unit, chart.at_most)
                )
        return tuple(instants), tuple(_places(trial))

    @property
    def _of_those_there(self) -> Wanted:
        """What is wanted of the topics that there are: to look for others takes as long as to judge."""
        log_map, there = self._wanted.log_map, self._recent.topics
        channels = tuple(one for one in log_map.channels if one.topic.lstrip("/") in there)
        return replace(self._wanted, log_map=replace(log_map, channels=channels))


def _places(trial: Trial) -> Iterator[Place]:
    """Where bodies and their links were seen last."""
    kinds = {body.id: body.kind for body in trial.bodies}
    for name, signal in trial.signals.items():
        quantity, _, body = name.partition("/")
        kind = kinds.get(body.partition("::")[0])
        if quantity == "position" and kind and len(signal) and signal.values.ndim > 1:
            x_m, y_m, *_ = signal.values[-1].tolist()
            yield Place(body, kind, x_m, y_m)
