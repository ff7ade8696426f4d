"""Whether a log holds enough for the other monitors to decide anything."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Set
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Literal

import numpy as np

from ariac_score import (
    QUANTITIES,
    Finding,
    FloatArray,
    Measure,
    MissingSignalError,
    Signal,
    SignalNeed,
    Span,
    Trial,
    Verdict,
    add_up,
    check_parameters,
    exact_sum,
    parameter,
)
from ariac_score.monitors import EXPOSURE_DISTANCE_M, nobody, pairs
from ariac_score_standards.exposed_time import ExposedTime

_PAIRS = pairs("robot", "human")
_BACKWARDS = "disordered_stamps"
_CLAUSE = "signal coverage (monitor catalogue, 1.4 and M19)"


def tracks_of(t: FloatArray, position_m: FloatArray, *, teleport_speed_m_s: float) -> list[slice]:
    """The rows of each unbroken track: a step faster than a teleport begins a new one.

    >>> tracks_of(np.arange(3.0), np.array([[0.0], [1.0], [90.0]]), teleport_speed_m_s=5.0)
    [slice(0, 2, None), slice(2, 3, None)]
    """
    # ARIAC 2023 teleports its human: a jump of 8 m in 0.01 s is a new track, and no speed of 800 m/s.
    step = np.diff(position_m, axis=0)
    jump = np.sqrt(add_up((step * step).T)) > teleport_speed_m_s * np.diff(t)
    cuts = [0, *(np.flatnonzero(jump) + 1).tolist(), len(t)]
    return [slice(a, b) for a, b in pairwise(cuts) if b > a]


def covered_share(covered_s: float, exposure_time_s: float) -> float:
    """Share of the exposure for which signals were present; 1 when there was no exposure.

    >>> covered_share(9.0, 10.0)
    0.9
    """
    return covered_s / exposure_time_s if exposure_time_s > 0 else 1.0


@dataclass(frozen=True)
class SignalCoverage:
    """The signals that monitors rest on are there nearly all the time.

    Measures:
        For every signal of `quantities` the share of the competition (or of the exposure
        alone: what time a human was, or may have been, within `exposure_distance_m` of a
        moving robot) that its samples cover, the age of the stalest sample, stamps that
        ran backwards, and (for positions) jumps faster than `teleport_speed_m_s`, which
        split a track and are never a speed.
    Violated when:
        Never: too little coverage is inconclusive, for what is missing is unknown.
    Source:
        Monitor catalogue, 1.4 and M19: 0.99 and 0.05 s are our choice.
    """

    when_cut: ClassVar[str] = "adds"
    part_of: ClassVar[str] = "task"
    in_gaps: ClassVar[str] = "reported"

    quantities: tuple[str, ...] = parameter(("position",), source="what the other monitors read")
    min_coverage: float = parameter(0.99, unit="1", at_least=0, at_most=1, source="catalogue, M19")
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=60, source="catalogue, 1.4")
    teleport_speed_m_s: float = parameter(5.0, unit="m/s", above=0, at_most=1000, source="catalogue, M19")
    share_of: Literal["competition", "exposure"] = parameter(
        "competition", source="catalogue, M19: exposure; the whole competition is the stricter one"
    )
    exposure_distance_m: float = parameter(
        EXPOSURE_DISTANCE_M, unit="m", at_least=0, at_most=100, source="catalogue, 1.3"
    )

    measures: ClassVar[Mapping[str, Measure]] = {
        "coverage": Measure("1", best=1.0, meaning="share of the time with samples"),
        "missing_s": Measure("s", best=0.0, meaning="time without samples"),
        "stalest_s": Measure("s", meaning="age of the stalest sample"),
        "exposure_s": Measure("s", meaning="how long somebody was, or may have been, near a moving robot"),
        "clock_jumps": Measure("count", best=0.0, meaning="stamps that ran backwards"),
        "jumps": Measure("count", best=0.0, meaning="jumps too fast for a speed"),
    }

    def __post_init__(self) -> None:
        check_parameters(self)
        for quantity in self.quantities:
            if quantity not in QUANTITIES:
                raise ValueError(f"quantity {quantity!r} is unknown; known: {', '.join(QUANTITIES)}")

    def needs(self) -> Iterator[SignalNeed]:
        """The quantities that are to be covered."""
        exposing = ("separation", "speed") if self.share_of == "exposure" else ()
        for quantity in dict.fromkeys((*self.quantities, *exposing)):
            yield SignalNeed(quantity, QUANTITIES[quantity].unit, self.max_gap_s)

    def verdict(self, coverage: float) -> Verdict:
        """What a share of coverage means."""
        return Verdict.SATISFIED if coverage >= self.min_coverage else Verdict.INCONCLUSIVE

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """One finding for each signal; one for each quantity without any."""
        if self.share_of == "exposure" and not _PAIRS.of(trial.bodies):
            yield nobody(trial, _PAIRS.kinds, _CLAUSE)
            return
        exposed = None
        if self.share_of == "exposure":
            pairs, within_m = _PAIRS.of(trial.bodies), self.exposure_distance_m
            try:
                exposed = ExposedTime(trial, pairs, within_m=within_m, max_gap_s=self.max_gap_s)
            except MissingSignalError as missing:
                yield Finding.inconclusive("trial", missing.cause, span=trial.window, clause=_CLAUSE)
                return
        for quantity in self.quantities:
            signals = [s for name, s in sorted(trial.signals.items()) if name.startswith(f"{quantity}/")]
            for signal in signals:
                yield self._judge(trial, signal, exposed)
            consumed = [name for name in sorted(trial.as_consumed) if name.startswith(f"{quantity}/")]
            for name in consumed:
                message = MissingSignalError(name, trial.signals, trial.as_consumed).cause
                yield Finding.inconclusive(name, message, span=trial.window, clause=_CLAUSE)
            there = {*(signal.name for signal in signals), *consumed}
            lacking = dict.fromkeys(_lacking(trial, quantity, there), "there is one of another subject")
            due = sorted(name for name in trial.stand_ins if name.startswith(f"{quantity}/"))
            lacking |= {name: "it is published" for name in due if name not in there}
            for name, why in sorted(lacking.items()):
                message = f"there is no signal {name!r}, but {why}"
                yield Finding.inconclusive(name, message, span=trial.window, clause=_CLAUSE)
            if not signals and not consumed:
                message = f"there is no signal of {quantity!r}"
                yield Finding.inconclusive(quantity, message, span=trial.window, clause=_CLAUSE)
        if not self.quantities:
            yield Finding.not_applicable("trial", "no quantity is asked for", clause=_CLAUSE)

    def _judge(self, trial: Trial, signal: Signal, exposed: ExposedTime | None) -> Finding:
        window = trial.window or signal.span or Span(0.0, 0.0)
        if not window.duration_s:  # of no time at all any share is covered
            message = f"{len(signal)} samples in a recording of 0 s cover nothing"
            return Finding.inconclusive(signal.name, message, span=window, clause=_CLAUSE)
        gaps = signal.gaps(window, max_gap_s=self.max_gap_s)
        if exposed is None:
            whole_s, missing_s = window.duration_s, exact_sum(gap.duration_s for gap in gaps)
        else:
            whole_s, missing_s = exposed.of(window, gaps)
        share = covered_share(whole_s - missing_s, whole_s)
        quantities = {"coverage": share, "missing_s": missing_s, "stalest_s": _stalest_s(signal, window)}
        if self.share_of == "exposure":
            quantities["exposure_s"] = whole_s
        quantities["clock_jumps"] = float(
            sum(d.count for d in trial.log_defects if (d.kind, d.where) == (_BACKWARDS, signal.name))
        )
        if signal.name.startswith("position/") and len(signal):
            tracks = tracks_of(signal.t, signal.values, teleport_speed_m_s=self.teleport_speed_m_s)
            quantities["jumps"] = float(len(tracks) - 1)
        return Finding(
            signal.name,
            self.verdict(share),
            f"covers {100 * share:.2f} % of the {self.share_of} (at least {100 * self.min_coverage:g} %)",
            span=gaps[0] if gaps else None,
            robustness=share - self.min_coverage,
            unit="1",
            quantities=quantities,
            clause=_CLAUSE,
        )


def _lacking(trial: Trial, quantity: str, names: Set[str]) -> list[str]:
    """The signals of a quantity that the log lacks, although it has that of another subject.

    Among bodies of one kind: a competition may know its robots by distances alone, and no human has joints.
    """
    recorded = {name.partition("/")[2] for name in names}
    if QUANTITIES[quantity].of == "pair":  # all of one kind: a robot and a human
        having = {pair.name for pair in _PAIRS.of(trial.bodies)} & recorded
        return [
            f"{quantity}/{pair.name}"
            for pair in _PAIRS.of(trial.bodies)
            if having and pair.name not in having
        ]
    # A link is a part of its body: `position/gantry::torso` places the gantry.
    having = {subject.partition("::")[0] for subject in recorded}
    kinds = {body.kind for body in trial.bodies if body.id in having}
    return [f"{quantity}/{b.id}" for b in trial.bodies if b.kind in kinds and b.id not in having]


def _stalest_s(signal: Signal, window: Span) -> float:
    """The longest time in a window until the next sample, or to its end, s."""
    inside = signal.t[(signal.t >= window.start_s) & (signal.t <= window.end_s)]
    ages = np.diff(np.concatenate(([window.start_s], inside, [window.end_s])))
    return float(ages.max())
