"""`stl.formula`: a formula of signal temporal logic as a monitor."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from ariac_score import (
    Body,
    Chart,
    Finding,
    FormulaError,
    Measure,
    MissingSignalError,
    OnlineWatch,
    Signal,
    SignalNeed,
    Trial,
    Worlds,
    align,
    parameter,
)
from ariac_score.monitors import FilledSignals, nobody, worlds_between
from ariac_score_stl.judging import JudgedFormula
from ariac_score_stl.margins import Beyond
from ariac_score_stl.online import FormulaOnline
from ariac_score_stl.outcome import Outcome
from ariac_score_stl.signals import Source, Subject, check_name, parse_source, subjects
from ariac_score_stl.specification import Specification
from ariac_score_stl.syntax import STEPS, Node, StlError, parse, reach_s
from ariac_score_stl.units import check_units
from ariac_score_stl.worlds import is_monotone, predicates_of_world

__all__ = ["StlFormula"]

_NO_NUMBERS: Mapping[str, float] = MappingProxyType({})
_NO_TEXTS: Mapping[str, str] = MappingProxyType({})


SHORTEST_GAP_S = 1e-6
"""Shorter ones would be of the size of the tolerance of windows, 1e-9 s, and of the rounding of stamps."""


@dataclass(frozen=True)
class StlFormula:
    """A formula of signal temporal logic holds.

    `formula` is such as `always (d < d_min -> eventually[0,0.5] v < 0.1)`. It has predicates (an
    inequality between arithmetic over the names in `signals` and `constants`); `not`, `and`, `or`, `xor`,
    `->`, `<->`; `always`, `eventually`, `until`, `once`, `historically`, `since` with bounds in s, as in
    `[0,0.5]`, or without: the rest of the trial, or all of it so far; `next`, `rise` and `fall` from one
    sample to the next.

    `signals` gives each name its quantity and unit: `d: centre_distance in m` for every robot and
    human, `v: speed of robot in m/s` for every robot, `speed of human in m/s`, or `speed of agv1 in
    m/s` for one body.

    Measures:
        The robustness of the formula at the start of the competition: how far every predicate could
        be shifted before the verdict changes, in the unit of the predicate that decides. Where a
        robustness is exactly 0, `<` and `<=` still differ. The formula is judged for every robot,
        human or pair that its signals are of. With `time: discrete` a window holds the samples in
        it; with `dense` a sample stands for the time up to the next one.
    Violated when:
        The formula does not hold. One that begins with `always` is judged at every sample of its
        window: one violation for each episode in which what follows does not hold (pauses shorter than
        `t_off_s` bridged, episodes shorter than `t_on_s` ignored). The message names the
        sub-formula that failed and when. What a gap longer than `max_gap_s` may decide is
        inconclusive, and so is what lies beyond the trial, unless `beyond` says otherwise: `weak` (it
        would have kept the formula), `strong` (it would have broken it), `cut` (windows end where the
        trial does).
    Source:
        Maler and Nickovic 2004; robustness after Donzé and Maler 2010; `weak` and `strong` after
        Eisner and others 2003; `cut` is what the rtamt library does.
    """

    measures: ClassVar[Mapping[str, Measure]] = {
        "time_in_violation_s": Measure("s", best=0.0, meaning="how long the formula did not hold"),
        "failed_at_s": Measure("s", signed=True, meaning="when what it failed by was sampled, trial time"),
    }
    example: ClassVar[Mapping[str, object]] = {
        "formula": "always (d < near -> eventually[0,0.5] v < slow)",
        "signals": {"d": "centre_distance in m", "v": "speed of robot in m/s"},
        "constants": {"near": 1.0, "slow": 0.1},
    }

    formula: str = ""
    signals: Mapping[str, str] = field(default_factory=lambda: _NO_TEXTS)
    constants: Mapping[str, float] = field(default_factory=lambda: _NO_NUMBERS)
    time: Literal["discrete", "dense"] = "discrete"
    beyond: Beyond = "undecided"
    max_gap_s: float = parameter(0.05, unit="s", status="")
    t_on_s: float = parameter(0.0, unit="s", status="")
    t_off_s: float = parameter(0.0, unit="s", status="")
    clause: str = ""
    critical: bool = False

    def __post_init__(self) -> None:
        for name in ("t_on_s", "t_off_s"):
            if not 0 <= getattr(self, name) < np.inf:
                raise ValueError(f"{name} is {getattr(self, name):g} but cannot be negative")
        if not SHORTEST_GAP_S <= self.max_gap_s < np.inf:
            raise ValueError(f"max_gap_s is {self.max_gap_s:g} but must be at least {SHORTEST_GAP_S:g}")
        both = sorted(self.signals.keys() & self.constants.keys())
        if both:
            raise ValueError(f"{both[0]!r} is a signal and a constant; give one another name")
        if not all(np.isfinite(value) for value in self.constants.values()):
            raise ValueError("constants must be finite")
        for name in (*self.signals, *self.constants):
            check_name(name)
        _ = self.specification

    @cached_property
    def sources(self) -> Mapping[str, Source]:
        """Where each name of the formula has its values from."""
        return {name: parse_source(name, text) for name, text in self.signals.items()}

    @cached_property
    def tree(self) -> Node:
        """The formula, read and checked.

        Raises:
            StlError: It is no formula; or it compares metres with seconds.
        """
        tree = parse(self.formula, self.signals, constants=self.constants)
        if not tree.names & self.signals.keys():
            raise StlError("the formula uses no signal")
        unused = sorted(self.signals.keys() - tree.names)
        if unused:
            raise StlError(f"the formula does not use signal {unused[0]!r}")
        for node in tree.walk():
            if self.time == "dense" and node.operator in STEPS:
                raise StlError(
                    f"column {node.column}: {node.operator!r} is about neighbouring samples, which dense "
                    "time has not; use bounds in seconds, or 'time: discrete'"
                )
        check_units(tree, {name: source.unit for name, source in self.sources.items()})
        return tree

    @cached_property
    def specification(self) -> Specification:
        """The formula and the parameters, as those need them that judge it."""
        return Specification(
            tree=self.tree,
            sources=self.sources,
            constants=self.constants,
            time=self.time,
            beyond=self.beyond,
            max_gap_s=self.max_gap_s,
            t_on_s=self.t_on_s,
            t_off_s=self.t_off_s,
            clause=self.clause,
            critical=self.critical,
        )

    def needs(self) -> Iterator[SignalNeed]:
        """The quantities of its signals."""
        for quantity, unit, pair in sorted({(s.quantity, s.unit, s.pair) for s in self.sources.values()}):
            yield SignalNeed(quantity, unit, self.max_gap_s, pair=pair)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """Findings for everyone whom the formula is about."""
        for outcome in self._outcomes(trial):
            if isinstance(outcome, Finding):
                yield outcome
            else:
                yield from outcome.findings()
            del outcome  # the columns of one subject go before those of the next one are made

    @property
    def in_gaps(self) -> str:
        """`outer` where every predicate goes one way with its signals; else nothing is known in a gap."""
        return "outer" if is_monotone(self.specification) else "blunt"

    def watch_worlds(self, trial: Trial) -> Iterator[Finding | Worlds]:
        """The same, and for what gaps leave open the findings of the best and of the worst world."""
        for outcome in self._outcomes(trial):
            if isinstance(outcome, Finding):
                yield outcome
                continue
            yield from worlds_between(
                trial,
                outcome.subject,
                outcome.signals,
                list(outcome.findings()),
                max_gap_s=self.max_gap_s,
                measures=self.measures,
                t_off_s=self.t_off_s,
                t_on_s=self.t_on_s,
                clause=self.clause,
                critical=self.critical,
                judge=partial(self._in_world, outcome) if is_monotone(self.specification) else None,
                ahead_s=reach_s(self.specification.body),
                back_s=reach_s(self.specification.body, back=True),
            )
            del outcome  # as in `watch`

    def _in_world(self, outcome: Outcome, filled: FilledSignals, worst: bool) -> list[Finding]:
        """The findings of one world; no sample is evidence of it."""
        # Nothing lacks in it: what was not seen has its end there.
        specification = replace(self.specification, max_gap_s=outcome.span.duration_s + 1.0)
        predicates = predicates_of_world(specification, filled, worst=worst)
        columns = filled.least if worst else filled.most
        judged = JudgedFormula(specification, filled.t, columns, outcome.span, predicates=predicates)
        found = Outcome(judged, outcome.subject, outcome.signals).findings()
        return [replace(one, evidence=()) for one in found]

    def margins(self, trial: Trial) -> Iterator[Chart]:
        """The robustness at every sample that is judged, where all predicates share a unit.

        There is none in dense time, whose margins also change between samples.
        """
        for outcome in self._outcomes(trial) if self.time == "discrete" else ():
            chart = outcome.chart if isinstance(outcome, Outcome) else None
            if chart is not None:
                yield chart
            del outcome, chart  # as in `watch`

    def begin(self, bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch that judges every instant as soon as all that the formula looks at from there has come."""
        return FormulaOnline(self.specification, bodies, self.watch)

    def _outcomes(self, trial: Trial) -> Iterator[Finding | Outcome]:
        judged = list(subjects(trial, self.sources))
        if not judged:
            kinds = {kind for source in self.sources.values() for kind in source.kinds}
            yield nobody(trial, tuple(kind for kind in ("robot", "human") if kind in kinds), self.clause)
        for subject in judged:
            yield from self._about(trial, subject)

    def _about(self, trial: Trial, subject: Subject) -> Iterator[Finding | Outcome]:
        names = {name: source.signal(subject) for name, source in self.sources.items()}
        try:
            found = {name: trial.signal(names[name], unit=self.sources[name].unit) for name in names}
        except MissingSignalError as missing:
            message = str(missing)
            yield Finding.inconclusive(str(subject), message, span=trial.window, clause=self.clause)
            return
        for signal in found.values():
            if signal.values.ndim > 1:
                components = signal.values.shape[1]
                message = f"signal {signal.name!r} has {components} components; a formula takes one"
                yield Finding.inconclusive(str(subject), message, clause=self.clause)
                return
        # With neither event the recording is taken for the competition; with one, the other is missing.
        if (trial.started_s is None) != (trial.ended_s is None):
            end = "end" if trial.ended_s is None else "start"
            message = f"the log does not show the {end} of the competition, so part of it may be missing"
            yield Finding.inconclusive(str(subject), message, span=trial.window, clause=self.clause)
        yield self._judge(trial, str(subject), found)

    def _judge(self, trial: Trial, subject: str, found: Mapping[str, Signal]) -> Finding | Outcome:
        span = trial.window
        t, values = align(list(found.values()), max_gap_s=self.max_gap_s)
        if span is not None:
            inside = slice(int(t.searchsorted(span.start_s)), int(t.searchsorted(span.end_s, side="right")))
            t, values = t[inside], [column[inside] for column in values]
        if span is None or not len(t):
            message = "there is no sample during the competition"
            return Finding.inconclusive(subject, message, span=span, clause=self.clause)
        columns = dict(zip(found, values, strict=True))
        holes = [hole for signal in found.values() for hole in signal.holes]
        try:
            judged = JudgedFormula(self.specification, t, columns, span, holes)
        except FormulaError as error:
            message = f"the formula has no value: {error.cause}"
            return Finding.inconclusive(subject, message, span=span, clause=self.clause)
        return Outcome(judged, subject, found)
