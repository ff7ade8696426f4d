"""The force rule of the finals: offline, from recordings of the real cell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from ariac_score import (
    Finding,
    FloatArray,
    Measure,
    Span,
    Trial,
    Verdict,
    WorkItem,
    check_parameters,
    parameter,
)
from ariac_score_aic.checks import NO_RECORDING
from ariac_score_aic.consumption import Consumed, consumed_of
from ariac_score_aic.messages import COMMANDS, WRENCHES, AicMessages, Wrenches, seconds_of

__all__ = ["EndForce", "FinalsForce", "Insertions", "insertions_of"]

_SOURCE = "aic_engine/scripts/batch_score_bags.py of intrinsic-dev/aic, 06338567"
_MARKS = (b"SwitchToAICController", b"TareForceTorqueSensorSkill")
_LEAST_PAUSE_S = 1.0
"""A message that comes sooner after the one before begins no interval."""
_AFTER_STRETCH_S = 0.1
"""Forces count so long after the last command, or the next mark."""
ENDS = ("sfp", "sc")


@dataclass(frozen=True)
class Insertions:
    """The stretches of a recording in which plugs were inserted: one end of a cable, the other, and so on.

    Attributes:
        starts_s: When each begins, s of the wall clock.
        by_switch: Whether messages of the switch to the controller mark them; otherwise those of the tare.
    """

    starts_s: tuple[float, ...]
    by_switch: bool

    @property
    def cables(self) -> int:
        """How many cables they are of."""
        return (len(self.starts_s) + 1) // 2


@dataclass(frozen=True)
class EndForce:
    """The force at one end of a cable.

    Attributes:
        end: `sfp` or `sc`.
        mean_n: The mean of the force along z, without its bias, over the stretch, N.
        peak_n: Its largest.
        violations: First stamp, last stamp (s of the wall clock) and peak (N) of each time too long.
        seen: Whether there was any force in the stretch.
    """

    end: str
    mean_n: float
    peak_n: float
    violations: tuple[tuple[float, float, float], ...]
    seen: bool = True


def insertions_of(messages: AicMessages) -> Insertions:
    """Where the stretches begin, by what the log says; without any force the scorer looks at none."""
    if not len(messages.wrenches.get(WRENCHES[0], Wrenches()).order):
        return Insertions((), by_switch=False)
    for number, mark in enumerate(_MARKS):
        rows = [i for i, text in enumerate(messages.log.texts) if mark in text]
        starts: list[float] = []
        for at_s in seconds_of(messages.log.stamp_ns[rows]).tolist():  # in the order of recording
            if not starts or at_s - starts[-1] > _LEAST_PAUSE_S:
                starts.append(at_s)
        if starts:
            return Insertions(tuple(starts), by_switch=number == 0)
    return Insertions((), by_switch=False)


@dataclass(frozen=True)
class FinalsForce:
    """Neither end of a cable is pushed hard for long.

    Measures:
        For each end the force along z of the sensor, less its mean in the first `bias_s`: its mean, its peak,
        and every time above the threshold without a break.
    Violated when:
        Such a time is longer than `limit_s`; each is one violation, and the first to begin is named first.
    Attributes:
        sfp_threshold_n: Force at the SFP end above which time counts.
        sc_threshold_n: Force at the SC end above which time counts.
        limit_s: The longest unbroken time above it that costs nothing.
        bias_s: The time at the beginning of a stretch whose mean force is its bias.
        within: Whether a stretch is cut to its commands, or goes from mark to mark.
        unseen: What no force in a stretch means: nothing (none), or that it is undecided (open).
    Source:
        `aic_engine/scripts/batch_score_bags.py` of intrinsic-dev/aic at 06338567. Forces have the
        sensor's stamps, commands the recorder's.
    """

    part_of: ClassVar[str] = "safety"
    mistake: ClassVar[tuple[str, str]] = ("excessive force at a cable", "times of excessive force at cables")
    level: ClassVar[str] = "task"
    measures: ClassVar[Mapping[str, Measure]] = {
        "peak_force_n": Measure("N", best=0.0, meaning="the largest force"),
        "mean_force_n": Measure("N", best=0.0, meaning="the mean force over the stretch"),
        "time_above_s": Measure("s", best=0.0, meaning="how long it was above the threshold"),
    }

    sfp_threshold_n: float = parameter(20.0, unit="N", above=0, at_most=1e4, source=_SOURCE)
    sc_threshold_n: float = parameter(30.0, unit="N", above=0, at_most=1e4, source=_SOURCE)
    limit_s: float = parameter(1.0, unit="s", at_least=0, at_most=1e4, source=_SOURCE)
    bias_s: float = parameter(0.5, unit="s", at_least=0, at_most=100, source=_SOURCE)
    within: Literal["commands", "marks"] = parameter("commands", source="commands since 06338567")
    unseen: Literal["none", "open"] = parameter("open", source="the scorer counts none where none was seen")

    def __post_init__(self) -> None:
        check_parameters(self)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """A finding for each time above the threshold, and one for each end without any."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        number = int(str(item.id).rpartition("_")[2]) - 1
        ends = [self.end_force(consumed, 2 * number + which) for which in (0, 1)]
        found = [one for end in ends if end is not None for one in self._findings(consumed, item, end)]
        yield from found or [Finding.inconclusive(item.id, "no force was recorded")]

    def _findings(self, consumed: Consumed, item: WorkItem, end: EndForce) -> Iterator[Finding]:
        if not end.seen and self.unseen == "open":
            yield Finding.inconclusive(item.id, f"{end.end}: no force was recorded in its stretch")
            return
        quantities = {"peak_force_n": end.peak_n, "mean_force_n": end.mean_n, "time_above_s": 0.0}
        for first_s, last_s, peak_n in end.violations:
            times = consumed.trial_s([round(first_s * 1e9), round(last_s * 1e9)])
            yield Finding(
                item.id,
                Verdict.VIOLATED,
                f"{end.end}: above its threshold for {last_s - first_s:.3f} s, at most {peak_n:.2f} N",
                span=Span(times[0], times[1]) if times else None,
                quantities={**quantities, "peak_force_n": peak_n, "time_above_s": last_s - first_s},
            )
        if not end.violations:
            words = f"{end.end}: at most {end.peak_n:.2f} N" if end.seen else f"{end.end}: no force, so none"
            yield Finding(item.id, Verdict.SATISFIED, words, quantities=quantities)

    def end_force(self, consumed: Consumed, number: int) -> EndForce | None:
        """The force in one stretch, by its number from 0; `None` where there is none."""
        messages = consumed.messages
        starts_s = insertions_of(messages).starts_s
        if number >= len(starts_s):
            return None
        begin_s = starts_s[number]
        next_s = starts_s[number + 1] if number + 1 < len(starts_s) else float("inf")
        wrenches = messages.wrenches.get(consumed.how.wrench_topic, Wrenches())
        t_s = seconds_of(wrenches.stamp_ns)
        if not len(t_s):
            return None
        first_s, last_s = self._stretch(messages, begin_s, next_s, float(t_s[-1]))
        # Also beyond the next mark, where that comes sooner.
        rows = (t_s >= first_s) & (t_s <= last_s + _AFTER_STRETCH_S)
        t_s, force_n = t_s[rows], wrenches.force_n[rows, 2]
        end = ENDS[number % 2]
        if not len(t_s):
            return EndForce(end, 0.0, 0.0, (), seen=False)
        early = force_n[t_s <= first_s + self.bias_s]
        bias_n = float(np.cumsum(early)[-1]) / len(early) if len(early) else float(force_n[0])
        net_n = np.abs(force_n - bias_n)
        threshold_n = self.sc_threshold_n if number % 2 else self.sfp_threshold_n
        mean_n = float(np.cumsum(net_n)[-1]) / len(net_n)
        return EndForce(end, mean_n, float(net_n.max()), tuple(self._above(t_s, net_n, threshold_n)))

    def _stretch(
        self, messages: AicMessages, begin_s: float, next_s: float, last_s: float
    ) -> tuple[float, float]:
        """From the first to the last command between two marks; without commands from mark to mark.

        The last stretch without commands goes on to the last force, at `last_s`.
        """
        for topic in COMMANDS if self.within == "commands" else ():
            # One product, as the scorer has times of recording: the last bits of a stamp differ.
            at_s = messages.commands_ns.get(topic, np.empty(0, dtype=np.int64)) * 1e-9
            at_s = at_s[(at_s >= begin_s) & (at_s < next_s)]
            if len(at_s):
                return float(at_s[0]), float(at_s[-1])
        return begin_s, last_s if next_s == float("inf") else next_s

    def _above(
        self, t_s: FloatArray, net_n: FloatArray, threshold_n: float
    ) -> Iterator[tuple[float, float, float]]:
        """The times above a threshold without a break that are too long."""
        above = np.concatenate(([False], net_n > threshold_n, [False]))
        turns = np.flatnonzero(np.diff(above.astype(np.int8)))
        for first, behind in turns.reshape(-1, 2).tolist():
            if t_s[behind - 1] - t_s[first] > self.limit_s:
                yield float(t_s[first]), float(t_s[behind - 1]), float(net_n[first:behind].max())
