"""`stl.formula`: a formula of signal temporal logic as a monitor."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from types import MappingProxyType
from typing import ClassVar, Literal

import numpy as np

from ariac_score import (
    Aligned,
    Body,
    Course,
    Episodes,
    Finding,
    FormulaError,
    MissingSignalError,
    OnlineWatch,
    Sample,
    Signal,
    SignalNeed,
    Span,
    Stretch,
    Total,
    Trial,
    Verdict,
    exact_sum,
    gaps_between,
    sample_durations,
)
from ariac_score_stl.explain import Cause, causes
from ariac_score_stl.judging import Asked, DenseTime, DiscreteTime, Judgement, Piece
from ariac_score_stl.online import FormulaOnline
from ariac_score_stl.robustness import Beyond
from ariac_score_stl.rows import TOLERANCE_S, BoolArray
from ariac_score_stl.signals import Source, Subject, check_name, parse_source, subjects
from ariac_score_stl.sliding import FloatArray
from ariac_score_stl.syntax import STEPS, Node, StlError, parse
from ariac_score_stl.units import check_units, unit_of
from ariac_score_stl.windows import WINDOW_ROWS, Line

__all__ = ["StlFormula"]

_NO_NUMBERS: Mapping[str, float] = MappingProxyType({})
_NO_TEXTS: Mapping[str, str] = MappingProxyType({})


SHORTEST_GAP_S = 1e-6
"""A gap must be long beside the rounding of stamps."""


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
        human or pair that its signals speak of. With `time: discrete` a window holds the samples in
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
    max_gap_s: float = 0.05
    t_on_s: float = 0.0
    t_off_s: float = 0.0
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
        _ = self.sources, self.tree

    @cached_property
    def sources(self) -> Mapping[str, Source]:
        """Where each name of the formula has its values from."""
        return {name: parse_source(name, text) for name, text in self.signals.items()}

    @cached_property
    def tree(self) -> Node:
        """The formula, read and checked.

        Raises:
            StlError: It is no formula; or it puts metres beside seconds.
        """
        tree = parse(self.formula, self.signals, constants=self.constants)
        if not tree.names & self.signals.keys():
            raise StlError("the formula speaks of no signal")
        unused = sorted(self.signals.keys() - tree.names)
        if unused:
            raise StlError(f"the formula does not speak of signal {unused[0]!r}")
        for node in tree.walk():
            if self.time == "dense" and node.operator in STEPS:
                raise StlError(
                    f"column {node.column}: {node.operator!r} is about neighbouring samples, which dense "
                    "time has not; use bounds in seconds, or 'time: discrete'"
                )
        check_units(tree, self._units)
        return tree

    @property
    def _units(self) -> dict[str, str]:
        return {name: source.unit for name, source in self.sources.items()}

    @cached_property
    def margin_units(self) -> Mapping[Node, str]:
        """The unit of every predicate's margin."""
        predicates = [node for node in self.tree.walk() if node.operator == "predicate"]
        return {node: unit_of(node, self._units) for node in predicates}

    def needs(self) -> Iterator[SignalNeed]:
        """The quantities of its signals."""
        for quantity, unit in sorted({(s.quantity, s.unit) for s in self.sources.values()}):
            yield SignalNeed(quantity, unit, self.max_gap_s)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """Findings for everyone the formula speaks of."""
        return (said for said in self._say(trial) if isinstance(said, Finding))

    def margins(self, trial: Trial) -> Iterator[Course]:
        """The robustness at every sample that is judged, where all predicates share a unit.

        Dense time has moments of its own between the samples, so it tells none.
        """
        if self.time == "discrete":
            found = (said.course for said in self._say(trial) if isinstance(said, Judged))
            yield from (course for course in found if course is not None)

    def _say(self, trial: Trial) -> Iterator[Finding | Judged]:
        judged = list(subjects(trial, self.sources))
        if not judged:
            yield self._nobody(trial)
        for subject in judged:
            yield from self._about(trial, subject)

    def begin(self, bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch that judges every instant once what the formula looks at there has come."""
        return FormulaOnline(self, bodies)

    def _nobody(self, trial: Trial) -> Finding:
        kinds = {kind for source in self.sources.values() for kind in source.kinds}
        missing = " and no ".join(k for k in ("robot", "human") if k in kinds and not trial.bodies_of(k))
        if "bodies" in trial.witnessed:
            message = f"the log records every body, and there is no {missing} among them"
            return Finding.not_applicable("trial", message, clause=self.clause)
        message = f"the log shows no {missing}"
        return Finding.inconclusive("trial", message, span=trial.window, clause=self.clause)

    def _about(self, trial: Trial, subject: Subject) -> Iterator[Finding | Judged]:
        names = {name: source.signal(subject) for name, source in self.sources.items()}
        try:
            found = [trial.signal(names[n], unit=self.sources[n].unit) for n in names]
        except MissingSignalError as missing:
            message = str(missing)
            yield Finding.inconclusive(str(subject), message, span=trial.window, clause=self.clause)
            return
        for signal in found:
            (_, *components) = signal.stretch(0, 0)[1].shape
            if components:
                message = f"signal {signal.name!r} has {components[0]} components; a formula takes one"
                yield Finding.inconclusive(str(subject), message, clause=self.clause)
                return
        if (trial.started_s is None) != (trial.ended_s is None):
            end = "end" if trial.ended_s is None else "start"
            message = f"the log does not show the {end} of the competition, so part of it may be missing"
            yield Finding.inconclusive(str(subject), message, span=trial.window, clause=self.clause)
        yield from self._judge(trial, str(subject), dict(zip(names, found, strict=True)))

    def _judge(self, trial: Trial, subject: str, found: Mapping[str, Signal]) -> Iterator[Finding | Judged]:
        span = trial.window
        track = None if span is None else Aligned(found, span, max_gap_s=self.max_gap_s)
        if span is None or not track:
            message = "there is no sample during the competition"
            yield Finding.inconclusive(subject, message, span=span, clause=self.clause)
            return
        judged = Judged(self, subject, track, found, span)
        wrong = judged.judge()
        if wrong is not None:
            message = f"the formula has no value: {wrong.cause}"
            yield Finding.inconclusive(subject, message, span=span, clause=self.clause)
            return
        yield judged
        yield from judged.findings()


class Judged:
    """A formula on the signals of one subject.

    Args:
        monitor: The formula.
        subject: Whom it is about.
        track: The signals, sample by sample.
        signals: The same by the name that the formula has for them.
        span: The trial.
        kept: Whether what is judged stays for a while, to be looked at again.

    Attributes:
        body: What is judged at every moment of `stretch`: all of the formula, or what follows its `always`.
        stretch: When it is judged.
    """

    def __init__(
        self,
        monitor: StlFormula,
        subject: str,
        track: Aligned,
        signals: Mapping[str, Signal],
        span: Span,
        *,
        kept: bool = True,
    ) -> None:
        self.monitor, self.subject, self.span = monitor, subject, span
        self.track, self.signals, self._stays = track, signals, kept
        self.gaps = gaps_between(track.stretches(), span, max_gap_s=monitor.max_gap_s)
        tree = monitor.tree
        self.body = tree.parts[0] if tree.operator == "always" else tree
        self.stretch, self.overrun, self.late = self._stretch()
        self.asked = Asked(
            tree, self.body, monitor.constants, monitor.beyond, span, self.stretch, late=self.late
        )
        self.violations: list[Stretch] = []
        self.open_spans: list[Span] = []
        self.closest: tuple[float, float, bool] | None = None
        """When the lower bound is the least, how small it is, and whether the formula is broken there."""

    @cached_property
    def judgement(self) -> Judgement:
        """The formula at every moment."""
        if self.monitor.time == "dense":
            return DenseTime(self.asked, self.track, self.monitor.max_gap_s)
        line = Line(self.track, self.span, self.gaps)
        return DiscreteTime(self.asked, self.track, line, kept=self._stays)

    def judge(self) -> FormulaError | None:
        """Go through all moments; why that cannot be, where a predicate has no value."""
        try:
            self._go_through()
        except FormulaError as first:  # of a window; of all samples another may be the first
            return self.asked.fault(self.track) or first
        return None

    def _go_through(self) -> None:
        violations, opened, last_s = self._episodes(), _Runs(self.stretch.end_s), -math.inf
        for piece in self.judgement.pieces():
            if piece.anew:
                violations, opened, self.closest = self._episodes(), _Runs(self.stretch.end_s), None
            violations.take(piece.begin, piece.violated)
            opened.take(piece)
            last_s = float(piece.begin[-1])
            least = int(np.argmin(piece.lower))
            if self.closest is None or piece.lower[least] < self.closest[1]:
                self.closest = (
                    float(piece.begin[least]),
                    float(piece.lower[least]) + 0.0,  # a zero without its sign, which hangs on windows
                    bool(piece.violated[least]),
                )
        if self.monitor.time == "dense" and last_s > -math.inf:  # the last step lasts as long as it is judged
            end_s = max(self.stretch.end_s, last_s + TOLERANCE_S)
            violations.take(np.array([end_s]), np.array([False]))
        self.violations = violations.end()
        self.open_spans = [self._settled(span) for span in opened.found]

    def _episodes(self) -> Episodes:
        monitor = self.monitor
        t_on_s = monitor.t_on_s if monitor.tree.operator == "always" else 0.0
        longest_s = math.inf if monitor.time == "dense" else monitor.max_gap_s
        return Episodes(t_on_s=t_on_s, t_off_s=monitor.t_off_s, longest_s=longest_s)

    def _within(self, span: Span) -> Span:
        if self.monitor.time != "dense":
            return span
        return Span(span.start_s, max(min(span.end_s, self.stretch.end_s), span.start_s))

    def _stretch(self) -> tuple[Span, bool, bool]:
        """When the body is judged; whether that ends, and whether it begins, after the trial."""
        tree, start_s, end_s = self.monitor.tree, self.span.start_s, self.span.end_s
        if tree.operator != "always":
            return Span(start_s, start_s), False, False
        if tree.bounds is None:
            return self.span, False, False
        first_s, last_s = start_s + tree.bounds.start_s, start_s + tree.bounds.end_s
        latest_s = end_s + TOLERANCE_S
        return Span(min(first_s, end_s), min(last_s, end_s)), last_s > latest_s, first_s > latest_s

    def findings(self) -> Iterator[Finding]:
        """Every violation, everything undecided, or that the formula holds."""
        yield from self._violations()
        undecided = self._undecided()
        yield from undecided
        beyond = self._beyond()
        if beyond is not None:
            yield beyond
        if not self.violations and not undecided and beyond is None:
            yield self._kept()

    def _violations(self) -> Iterator[Finding]:
        """A finding for each violation, in order of time."""
        found = [self._violation(broken) for broken in self._broken()]
        units = self._units_anywhere({size for _, size in found if size is not None})
        for finding, size in found:
            yield finding if size is None else replace(finding, unit=units.get(size, ""))

    def _broken(self) -> Iterator[_Broken]:
        """The violations in order of time, measured."""
        waiting = [_Broken(one) for one in self.violations]
        first = 0
        for piece in self.judgement.pieces() if waiting else ():
            durations_s, last_s = self._durations_s(piece), float(piece.begin[-1])
            for one in waiting[first:]:
                if one.span.start_s > last_s:
                    break
                one.take(piece, durations_s)
            while first < len(waiting) and waiting[first].complete:
                yield waiting[first]
                first += 1

    @property
    def course(self) -> Course | None:
        """The robustness of what is judged, over time; `None` where its unit changes or nothing is judged."""
        units = {*self.monitor.margin_units.values()}
        if len(units) != 1 or self.closest is None:
            return None
        first = next(self.judgement.pieces())
        if first.until_s is None:
            return self._course(first)
        about = self.monitor, self.subject, self.track, self.signals, self.span
        anew = partial(Judged, *about, kept=False)
        return Course.late(
            self.subject,
            f"robustness of {self.body.text}",
            units.pop(),
            lambda: anew().courses(),
            times=lambda: (course.t for course in anew().courses()),
            max_gap_s=self.monitor.max_gap_s,
        )

    def courses(self) -> Iterator[Course]:
        """The same in parts, one after the other."""
        return (self._course(piece) for piece in self.judgement.pieces())

    def _course(self, piece: Piece) -> Course:
        t, margin, known = _margins(piece)
        (unit,) = {*self.monitor.margin_units.values()}
        return Course(
            self.subject,
            f"robustness of {self.body.text}",
            unit,
            t,
            np.where(known, margin, 0.0),
            np.where(known, 0.0, np.nan),
            max_gap_s=self.monitor.max_gap_s,
        )

    def _settled(self, span: Span) -> Span:
        """A span without the tolerances that windows are laid out with."""
        return Span(*sorted(self._moment(t_s) for t_s in (span.start_s, span.end_s)))

    def _moment(self, t_s: float) -> float:
        row = self.track.row(t_s)
        around = self.track.times(max(row - 1, 0), min(row + 1, len(self.track)))
        if around[-1] == t_s:
            return t_s
        near = (*around.tolist(), self.span.start_s, self.span.end_s)
        exact = min(near, key=lambda one: abs(one - t_s))
        return exact if abs(exact - t_s) <= 4 * TOLERANCE_S else round(t_s, 8)

    def _durations_s(self, piece: Piece) -> FloatArray:
        """How long the moments that are judged stand for, s."""
        if self.monitor.time == "dense":
            end_s = piece.until_s
            if end_s is None:
                end_s = max(self.stretch.end_s, float(piece.begin[-1]))
            return np.diff(piece.begin, append=end_s)
        if piece.until_s is None:
            return sample_durations(piece.begin, longest_s=self.monitor.max_gap_s)
        begin = np.append(piece.begin, piece.until_s)
        return sample_durations(begin, longest_s=self.monitor.max_gap_s)[:-1]

    def _violation(self, broken: _Broken) -> tuple[Finding, float | None]:
        """The finding; with the size of its robustness where its unit is to be looked for anywhere."""
        worst_s, robustness = self._moment(broken.worst_s), broken.margin
        span = self._settled(self._within(broken.span))
        judgement = self.judgement
        evaluated = judgement.evaluated if robustness < 0 else judgement.decided
        chain = causes(evaluated, self.body, worst_s)
        finite = math.isfinite(robustness)
        unit = self._unit(chain, robustness) if finite else ""
        finding = Finding(
            self.subject,
            Verdict.VIOLATED,
            f"{self._how_long(span, worst_s)}: {self._told(chain)}",
            span=span,
            robustness=robustness if finite else None,
            unit=unit or "",
            quantities={
                "time_in_violation_s": broken.time_s,
                "failed_at_s": self._moment(chain[-1].t_s),
            },
            labels={"failed": chain[0].node.text, "because_of": chain[-1].node.text},
            evidence=self._evidence([worst_s, *(cause.t_s for cause in chain)]),
            clause=self.monitor.clause,
            critical=self.monitor.critical,
        )
        return finding, abs(robustness) if unit is None else None

    def _how_long(self, span: Span, worst_s: float) -> str:
        if self.monitor.tree.operator != "always":
            return "does not hold"
        return f"violated for {span.duration_s:.3f} s, at worst at {worst_s:.3f} s"

    def _told(self, chain: list[Cause]) -> str:
        words = [
            f"{cause.node.text!r} {'holds' if cause.holds else 'fails'} at {cause.t_s:.3f} s"
            for cause in chain
        ]
        last = chain[-1]
        if last.node.operator == "predicate":
            margin = abs(self.judgement.predicate(last.node, self._row(last.t_s)))
            words[-1] += f" by {margin:.6g} {self.monitor.margin_units[last.node]}".rstrip()
        return ", for ".join(words)

    def _unit(self, chain: list[Cause], robustness: float) -> str | None:
        last = chain[-1]
        known = self.monitor.margin_units.get(last.node)
        return self._unit_at(robustness, last.t_s) if known is None else known

    def _row(self, t_s: float) -> int:
        return max(self.track.row(math.nextafter(t_s + TOLERANCE_S, math.inf)) - 1, 0)

    def _evidence(self, moments: Sequence[float]) -> tuple[Sample, ...]:
        found = []
        for row in sorted({self._row(t_s) for t_s in moments}):
            t_s, columns = float(self.track.times(row, row + 1)[0]), self.track.columns(row, row + 1)
            found += [Sample(s.name, t_s, float(columns[n][0]), s.unit) for n, s in self.signals.items()]
        return tuple(found)

    def _undecided(self) -> list[Finding]:
        """One finding for each stretch that a gap, the end of the trial or a short window leaves open."""
        spans = self.open_spans
        return [
            Finding.inconclusive(
                self.subject,
                f"cannot be decided from {span.start_s:.3f} to {span.end_s:.3f} s: {self._why(span)}",
                span=span,
                clause=self.monitor.clause,
            )
            for span in spans
        ]

    def _why(self, span: Span) -> str:
        back_s, ahead_s = self._reach(back=True), self._reach()
        undecided = self.monitor.beyond == "undecided"
        reasons = [
            f"no samples for {gap.duration_s:.3f} s, from {gap.start_s:.3f} s"
            for gap in self.gaps
            if gap.end_s > span.start_s - back_s and gap.start_s < span.end_s + ahead_s
        ]
        if undecided and span.end_s + ahead_s > self.span.end_s + TOLERANCE_S:
            reasons.append(f"it looks beyond the end of the trial at {self.span.end_s:.3f} s")
        if undecided and span.start_s - back_s < self.span.start_s - TOLERANCE_S:
            reasons.append(f"it looks back beyond the start of the trial at {self.span.start_s:.3f} s")
        return "; ".join(reasons) or "its bounds are shorter than the time between two samples"

    def _reach(self, *, back: bool = False) -> float:
        """How far the body looks ahead, or back, at most, s."""
        return _reach(self.body, back=back, step_s=self.monitor.max_gap_s)

    def _beyond(self) -> Finding | None:
        """What the bounds of the outermost `always` ask for after the end of the trial."""
        policy = self.monitor.beyond
        if not self.overrun or policy in ("weak", "cut"):
            return None
        message = f"its window does not end before the trial does, at {self.span.end_s:.3f} s"
        if policy == "undecided":
            return Finding.inconclusive(self.subject, message, span=self.stretch, clause=self.monitor.clause)
        return Finding(
            self.subject,
            Verdict.VIOLATED,
            message,
            span=Span(self.span.end_s, self.span.end_s),
            clause=self.monitor.clause,
            critical=self.monitor.critical,
        )

    def _kept(self) -> Finding:
        if self.closest is None:
            return self._none_judged()
        at_s, robustness, violated = self.closest
        finite = math.isfinite(robustness)
        if violated:
            message = f"never broken for {self.monitor.t_on_s:g} s; at its worst at {at_s:.3f} s"
        elif self.monitor.tree.operator == "always":
            message = f"holds throughout, at its closest at {at_s:.3f} s"
        else:
            message = "holds"
        unit = self._unit_at(robustness, at_s) if finite else ""
        if unit is None:
            unit = self._units_anywhere([abs(robustness)]).get(abs(robustness), "")
        return Finding(
            self.subject,
            Verdict.SATISFIED,
            message + (f" by {robustness:.6g} {unit}".rstrip() if finite else ""),
            robustness=robustness if finite else None,
            unit=unit,
            evidence=self._evidence([at_s]),
            clause=self.monitor.clause,
        )

    def _none_judged(self) -> Finding:
        if self.late:
            message = f"its window begins after the trial, which ends at {self.span.end_s:.3f} s"
            return Finding.satisfied(self.subject, message, clause=self.monitor.clause)
        message = "no sample lies in the window of its outermost 'always'"
        return Finding.inconclusive(self.subject, message, span=self.stretch, clause=self.monitor.clause)

    def _unit_at(self, robustness: float, at_s: float) -> str | None:
        """The unit all predicates share; of different ones that of the predicate that is as far then."""
        units = self.monitor.margin_units
        if len(set(units.values())) == 1:
            return next(iter(units.values()))
        row = self._row(at_s)
        far = (u for n, u in units.items() if abs(self.judgement.predicate(n, row)) == abs(robustness))
        return next(far, None)

    def _units_anywhere(self, sizes: Collection[float]) -> dict[float, str]:
        """The units of the first predicates that are as far at any sample."""
        wanted, units = np.array(sorted(sizes)), self.monitor.margin_units
        found: dict[float, int] = {}
        for window in self.track.runs(WINDOW_ROWS) if len(wanted) else ():
            leaves = self.asked.leaves(self.track, *window)
            for number, node in enumerate(units):
                size = np.abs(leaves[node])
                at = np.minimum(wanted.searchsorted(size), len(wanted) - 1)
                for one in wanted[np.unique(at[wanted[at] == size])].tolist():
                    found[one] = min(found.get(one, number), number)
        names = list(units.values())
        return {size: names[number] for size, number in found.items()}


class _Broken:
    """A violation, as its moments come.

    Attributes:
        span: When.
        worst_s: When it is at its worst.
        margin: How far it is from being kept, then.
        time_s: For how long the formula is broken in it.
    """

    def __init__(self, stretch: Stretch) -> None:
        self.span, self._left = stretch.span, stretch.samples
        self._time: Total | None = None
        self.time_s = 0.0
        self.worst_s, self.margin = math.nan, math.inf

    @property
    def complete(self) -> bool:
        """Whether all of its moments have come."""
        return self._left <= 0

    def take(self, piece: Piece, durations_s: FloatArray) -> None:
        """Take those of its moments that are in a piece."""
        first = int(piece.begin.searchsorted(self.span.start_s))
        last = int(piece.begin.searchsorted(self.span.end_s, side="right"))
        upper, broken = piece.upper[first:last], piece.violated[first:last]
        broken_s = durations_s[first:last][broken]
        if not len(broken_s):
            return
        self._add(broken_s)
        worst = int(upper.argmin())
        if upper[worst] >= 0:  # broken by < where <= would have been kept
            worst = int(broken.argmax())
        if math.isnan(self.worst_s) or upper[worst] < min(self.margin, 0.0):
            self.worst_s, self.margin = float(piece.begin[first + worst]), float(upper[worst]) + 0.0

    def _add(self, broken_s: FloatArray) -> None:
        """Add up how long it lasts; most violations are in one piece."""
        if self._time is None and len(broken_s) == self._left:
            self.time_s = exact_sum(broken_s)
        else:
            self._time = self._time or Total(self._left)
            self._time.take(broken_s)
            self.time_s = self._time.value
        self._left -= len(broken_s)


class _Runs:
    """Undecided moments next to each other, with the gaps among them, of pieces that come one by one."""

    def __init__(self, end_s: float) -> None:
        self.found: list[Span] = []
        self._end_s, self._goes_on = end_s, False

    def take(self, piece: Piece) -> None:
        """Take the moments after those before."""
        begin = piece.begin
        (rows,) = np.nonzero(piece.open)
        going, self._goes_on = self._goes_on, bool(piece.open[-1])
        if not len(rows):
            return
        ends = np.append(begin[1:], self._end_s if piece.until_s is None else piece.until_s)
        for run in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1):
            start_s, end_s = float(begin[run[0]]), float(max(ends[run[-1]], begin[run[-1]]))
            if run[0] == 0 and going:
                start_s = self.found.pop().start_s
            self.found.append(Span(start_s, end_s))


def _margins(piece: Piece) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Times of samples, margins there, and whether they are known."""
    margin = np.where(piece.upper < 0, piece.upper, piece.lower)
    known = np.isfinite(margin) & ~piece.open
    if piece.hole is None:
        return piece.begin, margin, known
    sampled = ~piece.hole
    return piece.begin[sampled], margin[sampled], known[sampled]


def _reach(node: Node, *, back: bool, step_s: float) -> float:
    own = 0.0
    looks_back = node.operator in ("once", "historically", "since", "rise", "fall")
    if looks_back is back and node.operator not in ("predicate", "true", "false"):
        if node.bounds is not None:
            own = node.bounds.end_s
        elif node.operator in ("next", "rise", "fall"):
            own = step_s
        elif node.operator in ("always", "eventually", "until", "once", "historically", "since"):
            own = np.inf
    return own + max((_reach(part, back=back, step_s=step_s) for part in node.parts), default=0.0)
