"""Monitors without Python: a formula over signals that always holds, never, or in time.

The formula is of the expression language of score sheets, on columns. Names are those
of `signals` (templates such as `speed/{robot}`, filled in for every body of the kinds
they name) and of `parameters`:

    separation:
      use: formula.always
      with:
        holds: distance >= k_H * (t1 + t2) + k_R * t1 + B + delta
        signals: {distance: "centre_distance/{robot}/{human}", k_H: "speed/{human}", k_R: "speed/{robot}"}
        parameters: {t1: 1.0, t2: 1.5, B: 0.0, delta: 2.6}
        unit: m

A signal beyond the vocabulary names its unit, `pressure/{robot} [bar]`; of a vector one
component is taken, `position/{robot}.z`.
"""

from __future__ import annotations

import ast
import keyword
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import cached_property
from string import Formatter
from typing import Any, ClassVar, Literal

import numpy as np

from ariac_score import (
    QUANTITIES,
    Expression,
    Finding,
    FloatArray,
    FormulaError,
    Measure,
    Span,
    Verdict,
    check_parameters,
    directions,
    parameter,
)
from ariac_score.monitors import (
    TOLERANCE_S,
    BoolArray,
    Bound,
    Episode,
    FindingRules,
    JudgedLimit,
    MarginMonitor,
    Signals,
    SubjectMonitor,
    Subjects,
    UndecidedError,
    Watched,
    Worse,
    rows_of_episodes,
)
from ariac_score_standards.deadlines import asked_at_worst, late_at_worst

_KINDS = ("robot", "agv", "human")
_EXAMPLES = ", ".join(_KINDS)
_KIND = re.compile(r"[a-z][a-z0-9_]*")
_AXES = {".x": 0, ".y": 1, ".z": 2}
MAX_SOURCE_LENGTH = 500
"""A longer text is no signal; to refuse it the pattern would take time that grows with its square."""

_TEMPLATE = re.compile(r"(?P<name>[^\[\]]+?)(?P<axis>\.[xyz])?\s*(?:\[(?P<unit>[^\[\]]+)\])?")
_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]*")

Columns = Mapping[str, Any]


# A formula on columns --------------------------------------------------------------------------


@dataclass(frozen=True)
class FormulaValues:
    """A formula on columns.

    Attributes:
        true: Whether it holds, shape (n,).
        margin: By how much; negative (or 0, at a strict comparison) where it does not, shape (n,).
        limit: The right side of a formula that is one comparison, shape (n,); else `None`.
    """

    true: BoolArray
    margin: FloatArray
    limit: FloatArray | None = None


def judge_columns(formula: Expression, values: Columns, rows: int) -> FormulaValues:
    """Truth and margin of a formula, row by row.

    The margin of a comparison is the difference of its sides; of `and` the least, of
    `or` the largest of the operands that are evaluated, of `not` the negative; of a plain
    number 1 or -1.

    Raises:
        FormulaError: It has no value in some row.
    """
    return _judge(formula, formula.root, values, rows)


def _judge(formula: Expression, node: ast.expr, values: Columns, rows: int) -> FormulaValues:
    if isinstance(node, ast.Compare):
        return _compare(formula, node, values, rows)
    if isinstance(node, ast.BoolOp):
        return _either(formula, node, values, rows)
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
        inner = _judge(formula, node.operand, values, rows)
        return FormulaValues(~inner.true, -inner.margin)
    if isinstance(node, ast.IfExp):
        test = _judge(formula, node.test, values, rows).true
        true, margin = np.zeros(rows, dtype=bool), np.zeros(rows)
        for part, chosen in ((node.body, test), (node.orelse, ~test)):
            found = _judge(formula, part, _only(values, chosen), int(chosen.sum()))
            true[chosen], margin[chosen] = found.true, found.margin
        return FormulaValues(true, margin)
    true = _column(formula, node, values, rows) != 0
    return FormulaValues(true, np.where(true, 1.0, -1.0))


def _either(formula: Expression, node: ast.BoolOp, values: Columns, rows: int) -> FormulaValues:
    """`and`, `or`: an operand is evaluated only where the earlier ones leave the answer open.

    As in Python, so that `d > 0 and 1 / d < 5` has a value everywhere.
    """
    either = isinstance(node.op, ast.Or)
    first = _judge(formula, node.values[0], values, rows)
    true, margin = first.true.copy(), first.margin.copy()
    for operand in node.values[1:]:
        open_rows = ~true if either else true.copy()
        further = _judge(formula, operand, _only(values, open_rows), int(open_rows.sum()))
        choose = np.maximum if either else np.minimum
        true[open_rows], margin[open_rows] = further.true, choose(margin[open_rows], further.margin)
    return FormulaValues(true, margin)


def _compare(formula: Expression, node: ast.Compare, values: Columns, rows: int) -> FormulaValues:
    sides = [_column(formula, side, values, rows) for side in (node.left, *node.comparators)]
    true, margin = np.ones(rows, dtype=bool), np.full(rows, np.inf)
    for op, a, b in zip(node.ops, sides, sides[1:], strict=False):
        if isinstance(op, ast.Gt | ast.GtE):
            difference = a - b
        elif isinstance(op, ast.Lt | ast.LtE):
            difference = b - a
        else:
            difference = np.abs(a - b) if isinstance(op, ast.NotEq) else -np.abs(a - b)
        strict = isinstance(op, ast.Gt | ast.Lt | ast.NotEq)
        true &= difference > 0 if strict else difference >= 0
        np.minimum(margin, difference, out=margin)
    return FormulaValues(true, margin, sides[1] if len(sides) == 2 else None)


def _column(formula: Expression, node: ast.expr, values: Columns, rows: int) -> FloatArray:
    return np.array(np.broadcast_to(formula.part(node).columns(values), (rows,)), dtype=np.float64)


def _only(values: Columns, rows: BoolArray) -> Columns:
    return {name: value[rows] if np.ndim(value) else value for name, value in values.items()}


# What the three monitors share -----------------------------------------------------------------


@dataclass(frozen=True)
class _Source:
    """Where the values of one name come from."""

    template: str
    unit: str
    axis: int | None

    @property
    def quantity(self) -> str:
        return self.template.partition("/")[0]


def _source(name: str, text: str) -> _Source:
    match = _TEMPLATE.fullmatch(text.strip()) if len(text) <= MAX_SOURCE_LENGTH else None
    if match is None or "/" not in text:
        raise ValueError(f"signal {name!r} is {text[:80]!r}, not quantity/subject such as speed/{{robot}}")
    template, axis, unit = match["name"], match["axis"], match["unit"]
    try:
        placeholders = {field for _, field, _, _ in Formatter().parse(template) if field is not None}
    except ValueError as wrong:
        raise ValueError(f"signal {name!r} is {text!r}: {wrong}") from None
    for kind in sorted(placeholders):
        misspelt = [] if kind in _KINDS else get_close_matches(kind, _KINDS, n=1, cutoff=0.7)
        if misspelt or not _KIND.fullmatch(kind):
            meant = f"did you mean {misspelt[0]}?" if misspelt else f"it may name a kind of body: {_EXAMPLES}"
            raise ValueError(f"signal {name!r} names {{{kind}}}; {meant}")
    known = QUANTITIES.get(template.partition("/")[0])
    if known is not None and unit not in (None, known.unit):
        raise ValueError(f"signal {name!r} is wanted in {unit!r}, but it is measured in {known.unit!r}")
    if known is None and unit is None:
        near = get_close_matches(template.partition("/")[0], QUANTITIES, n=1)
        raise ValueError(
            f"signal {name!r} is of no known quantity: name its unit, such as {template!r} followed by [bar]"
            + (f"; or did you mean {near[0]!r}?" if near else "")
        )
    if known is not None and (known.components == 3) is not (axis is not None):
        has = "3 components: take one with .x, .y or .z" if known.components == 3 else "no components"
        raise ValueError(f"signal {name!r} is {text!r}, but {template.partition('/')[0]} has {has}")
    return _Source(template, unit or (known.unit if known else ""), None if axis is None else _AXES[axis])


@dataclass(frozen=True)
class Formula(SubjectMonitor):
    """Signals, parameters and episodes of a monitor that is written as a formula."""

    signals: Mapping[str, str] | None = parameter(None, source="signal template by name")
    parameters: Mapping[str, float] | None = parameter(None, source="number by name")
    clause: str = parameter("", source="where the standard or rulebook asks for it")
    critical: bool = parameter(False, source="whether a violation is a critical event")
    max_gap_s: float = parameter(0.05, unit="s", above=0, at_most=600, source="catalogue, 1.4")
    t_on_s: float = parameter(0.0, unit="s", at_least=0, at_most=600, source="catalogue, 1.2")
    t_off_s: float = parameter(1.0, unit="s", at_least=0, at_most=600, source="catalogue, 1.2")

    def __post_init__(self) -> None:
        check_parameters(self)
        sources = self._sources
        for name in (*sources, *self._numbers):
            if not _NAME.fullmatch(name) or keyword.iskeyword(name):
                raise ValueError(f"{name!r} cannot be used as a name in a formula")
        both = sorted(set(sources) & set(self._numbers))
        if both:
            raise ValueError(f"{both[0]!r} is both a signal and a parameter")
        for text in self._texts:
            self._check(text)

    @property
    def _texts(self) -> tuple[str, ...]:
        return ()

    def _check(self, text: str) -> None:
        """Evaluate on columns of length 0: unknown names and functions show, and no value can be wrong."""
        if not text:
            return
        if not self.signals:
            raise ValueError("signals is empty: a formula needs at least one")
        nothing: dict[str, Any] = {name: np.zeros(0) for name in self._sources}
        try:
            judge_columns(Expression.parse(text), {**nothing, **self._numbers}, 0)
        except FormulaError as wrong:
            raise ValueError(f"{wrong.cause}{f'; {wrong.hint}' if wrong.hint else ''}") from None

    @property
    def _numbers(self) -> Mapping[str, float]:
        return self.parameters or {}

    @cached_property
    def _sources(self) -> dict[str, _Source]:
        return {name: _source(name, text) for name, text in (self.signals or {}).items()}

    @cached_property
    def _parsed(self) -> Mapping[str, Expression]:
        return {text: Expression.parse(text) for text in self._texts}

    @property
    def lacks(self) -> str:
        """A formula."""
        return "" if all(self._texts) else "no formula is given"

    @property
    def rules(self) -> FindingRules:
        """As the rule set has them."""
        clause = self.clause or "formula of the rule set"
        critical = self.critical
        return FindingRules(clause, self.t_on_s, self.t_off_s, critical=critical, measures_clean=False)

    @property
    def wanted(self) -> dict[str, str]:
        """Its signals."""
        return {source.template: source.unit for source in self._sources.values()}

    @property
    def subjects(self) -> Subjects:
        """Every combination of bodies of the kinds that the templates name."""
        named = [field for template in self.wanted for _, field, _, _ in Formatter().parse(template) if field]
        known = [kind for kind in _KINDS if kind in named]
        return Subjects(tuple(dict.fromkeys([*known, *named])))

    def _of(self, text: str, signals: Signals) -> FormulaValues:
        """A formula on columns, or at one instant.

        Raises:
            UndecidedError: It has no value.
        """
        values: dict[str, Any] = dict(self._numbers)
        for name, source in self._sources.items():
            column = signals[source.template]
            values[name] = np.atleast_1d(column if source.axis is None else column[..., source.axis])
        rows = len(values[next(iter(self._sources))])
        try:
            return judge_columns(self._parsed[text], values, rows)
        except FormulaError as wrong:
            raise UndecidedError(f"the formula has no value: {wrong.cause}") from wrong


@dataclass(frozen=True)
class Always(Formula, MarginMonitor):
    """A formula over signals holds at every sample of the competition.

    Measures:
        For every combination of the bodies that its signals name: the margin of the
        formula, in `unit`. Stretches longer than `max_gap_s` without a sample are
        inconclusive, and so is a formula that has no value.
    Violated when:
        It does not hold. One stretch is one violation (episode): pauses shorter than
        `t_off_s` are bridged, violations shorter than `t_on_s` ignored.
    Source:
        The rule set that writes it.
    """

    example: ClassVar[Mapping[str, Any]] = {
        "holds": "distance >= k_R * t1 + 0.5",
        "signals": {"distance": "separation/{robot}/{human}", "k_R": "speed/{robot}"},
        "parameters": {"t1": 1.0},
        "unit": "m",
    }

    holds: str = parameter("", source="the formula; required")
    unit: str = parameter("1", source="unit of the margin, for the names of the severities")

    @property
    def _texts(self) -> tuple[str, ...]:
        return (self.holds,)

    @property
    def _unit(self) -> str:
        return "" if self.unit == "1" else f" {self.unit}"

    def _required(self, found: FormulaValues) -> FormulaValues:
        """The formula as a requirement; a subclass may turn it round."""
        return found

    @property
    def worse(self) -> dict[str, Worse]:
        """What brings the formula nearer to being broken, where its signs show it."""
        goes = directions(self._parsed[self.holds], self._numbers) if self.holds else None
        found: dict[str, Worse] = {}
        for name, source in self._sources.items():
            way = None if goes is None else self._sign * goes.get(name, 1)
            end: Worse = "low" if way == 1 else "high"
            if way is None or source.axis is not None or found.get(source.template, end) != end:
                return {}
            found[source.template] = end
        return found

    _sign: ClassVar[int] = 1

    def margin(self, signals: Signals) -> _FormulaBound:
        """The margin of the formula, in its unit."""
        found = self._required(self._of(self.holds, signals))
        limit = np.zeros_like(found.margin) if found.limit is None else found.limit
        bound = _FormulaBound(
            "margin of the formula",
            found.margin,
            limit,
            self.unit,
            evidence="" if found.limit is None else "limit",
            holds=found.true,
        )
        return bound if isinstance(signals, Watched) else bound.at(0)

    def instant(self, bound: Bound) -> str:
        """Whether it holds, and by how much."""
        holds = "does not hold" if bound.broken else "holds"
        return f"{self._quoted} {holds} by {abs(float(bound.margin)):.3f}{self._unit}"

    def message(self, limit: JudgedLimit, row: int, episode: Episode | None) -> str:
        """Whether it held, and by how much."""
        margin, at = float(limit.bound.margin[row]), f"at {limit.watched.t[row]:.3f} s"
        if episode is not None:
            outcome = f"does not hold; at worst by {-margin:.3f}"
        elif limit.bound.broken[row]:  # but too briefly to count
            outcome = f"never broken for {self.t_on_s:g} s; at worst by {-margin:.3f}"
        else:
            outcome = f"holds; closest by {margin:.3f}"
        return f"{self._quoted} {outcome}{self._unit}, {at}"

    @property
    def _quoted(self) -> str:
        return f"'{self.holds}'"


@dataclass(frozen=True, kw_only=True)
class _FormulaBound(Bound):
    """A formula as a limit: margin and truth are those of the formula."""

    holds: BoolArray

    @cached_property
    def margin(self) -> FloatArray:
        """That of the formula; the limit is what it compares with."""
        return self.actual

    @cached_property
    def limited(self) -> BoolArray:
        """Everywhere."""
        return np.ones_like(self.holds)

    @cached_property
    def broken(self) -> BoolArray:
        """Where it is not true; that can be at a margin of 0."""
        return ~self.holds

    @property
    def shown(self) -> tuple[FloatArray, FloatArray]:
        """The margin, against 0."""
        return self.actual, np.zeros_like(self.actual)

    def at(self, row: int) -> _FormulaBound:
        """The same at one sample, as numbers."""
        return replace(self, actual=self.actual[row], limit=self.limit[row], holds=self.holds[row])


@dataclass(frozen=True)
class Never(Always):
    """A formula over signals never holds during the competition.

    Measures:
        For every combination of the bodies that its signals name: the margin by which
        the formula fails to hold, in `unit`.
    Violated when:
        It holds. Episodes as for `formula.always`.
    Source:
        The rule set that writes it.
    """

    example: ClassVar[Mapping[str, Any]] = {
        "holds": "v > 0.4",
        "signals": {"v": "speed/{robot}"},
        "unit": "m/s",
    }

    _sign: ClassVar[int] = -1

    def _required(self, found: FormulaValues) -> FormulaValues:
        return FormulaValues(~found.true, -found.margin, found.limit)

    @property
    def _quoted(self) -> str:
        return f"'not ({' '.join(self.holds.split())})'"


@dataclass(frozen=True)
class Within(Formula):
    """Whenever one formula begins to hold, another one holds within some time.

    Measures:
        For every combination of the bodies that the signals name, and for every time
        that `trigger` begins to hold: how long it takes until `response` holds, in s;
        0 where it holds already.
    Violated when:
        It takes longer than `within_s`. Where the log ends, or has a gap, before the
        time is up, that is inconclusive; where the competition ends, no response was due.
    Source:
        The rule set that writes it.
    """

    example: ClassVar[Mapping[str, Any]] = {
        "trigger": "distance < 0.5",
        "response": "v < 0.1",
        "signals": {"distance": "separation/{robot}/{human}", "v": "speed/{robot}"},
        "within_s": 1.0,
    }

    trigger: str = parameter("", source="what begins to hold; required")
    response: str = parameter("", source="what has to hold then; required")
    in_gaps: ClassVar[Literal["outer"]] = "outer"
    within_s: float = parameter(1.0, unit="s", at_least=0, at_most=1e6, source="for the rule set to set")

    @property
    def _texts(self) -> tuple[str, ...]:
        return (self.trigger, self.response)

    measures: ClassVar[Mapping[str, Measure]] = {
        "response_s": Measure("s", meaning="how long the response took"),
        "time_in_violation_s": Measure("s", best=0.0, meaning="how much too long"),
    }

    def about(self, signals: Watched) -> Iterator[Finding]:
        """Each late response, or the latest that was in time."""
        answers = self._due(signals)
        late = [(began, takes) for began, takes in answers if takes > self.within_s + TOLERANCE_S]
        for began, takes in late:
            yield self._late(signals, began, takes)
        if late or signals.gaps:
            return
        if not answers:
            in_time = " so that a response was due" if self._answers(signals) else ""
            yield self._never_asked(signals, f"'{self.trigger}' never began to hold{in_time}")
            return
        yield self._in_time(signals, answers)

    def _never_asked(self, watched: Watched, message: str) -> Finding:
        return Finding.not_applicable(watched.subject.name, message, clause=self.rules.clause)

    def _due(self, watched: Watched) -> list[tuple[float, float]]:
        """The answers but for those that would have been due after the end of the competition."""
        ended_s = watched.trial.ended_s
        last_s = math.inf if ended_s is None else ended_s - self.within_s + TOLERANCE_S
        return [one for one in self._answers(watched) if one[0] <= last_s or math.isfinite(one[1])]

    def _in_time(self, watched: Watched, answers: Sequence[tuple[float, float]]) -> Finding:
        if not answers:
            message = f"'{self.trigger}' did not hold so that a response was due"
            return Finding.satisfied(watched.subject.name, message, clause=self.rules.clause)
        began, takes = max(answers, key=lambda answer: (answer[1], answer[0]))
        return Finding(
            watched.subject.name,
            Verdict.SATISFIED,
            f"the latest response took {takes:.3f} s, to {began:.3f} s (at most {self.within_s:g} s)",
            robustness=max(self.within_s - takes, 0.0),
            unit="s",
            quantities={"response_s": takes, "time_in_violation_s": 0.0},
            clause=self.rules.clause,
        )

    def at_worst(self, signals: Watched, hidden: Sequence[Span]) -> Sequence[Finding]:
        """Each late response, with a trigger as early, and as often, as what is hidden lets it have been."""
        window = signals.trial.window
        ends_s = signals.end_s if window is None else window.end_s
        counted_s = [began_s for began_s, _ in self._answers(signals)]
        # Who leaves out samples makes another interval usual, but none longer than the monitor accepts.
        usual_s = min(signals.usual_s, self.max_gap_s)
        # What was seen to begin twice can begin so soon again.
        pause_s = min([max(self.t_on_s + self.t_off_s, usual_s), *np.diff(counted_s).tolist()])
        # A run that is too brief to count may have gone on where nothing shows it.
        triggered = self._of(self.trigger, signals).true
        runs = rows_of_episodes(signals, triggered, t_off_s=self.t_off_s)
        cut_s = [run.start_s for run, _ in runs if any(run.overlaps(gap) for gap in hidden)]
        seen_s = sorted({*counted_s, *cut_s})
        answered = self._answered(signals)
        answered = answered[self._measured(self.response, signals, answered, hidden)]
        asked = asked_at_worst(seen_s, hidden, answered, ends_s)
        late = [
            self._too_late(signals, span, f"came after {span.duration_s:.3f} s at worst", late_s)
            for span, late_s in late_at_worst(asked, self.within_s, pause_s)
        ]
        if signals.trial.ended_s is None:  # nobody knows whether a response was due
            late += [
                self._too_late(signals, Span(one.from_s, ends_s), "is not in the log", ends_s - one.from_s)
                for one in asked
                if one.in_vain and one.longest_s <= self.within_s + TOLERANCE_S
            ]
        in_time = [(one.from_s, one.longest_s) for one in asked if not one.in_vain]
        is_seen = any(not any(gap.start_s <= s <= gap.end_s for gap in hidden) for s in seen_s)
        if not (late or is_seen):  # what earns points by being kept may have had nothing to keep
            return [self._never_asked(signals, f"'{self.trigger}' may never have begun to hold")]
        return late or [self._in_time(signals, in_time)]

    def _answers(self, watched: Watched) -> list[tuple[float, float]]:
        """When the trigger began to hold, and how long the response then took; infinite: it never came."""
        answered = self._answered(watched)
        triggered = self._of(self.trigger, watched).true
        found = []
        for span, _ in rows_of_episodes(watched, triggered, t_on_s=self.t_on_s, t_off_s=self.t_off_s):
            found.append((span.start_s, _until(answered, span.start_s)))
        return found

    def _answered(self, watched: Watched) -> FloatArray:
        """When the response held, s."""
        return watched.t[self._of(self.response, watched).true]

    def _measured(self, text: str, watched: Watched, t: FloatArray, hidden: Sequence[Span]) -> BoolArray:
        """Which of some times are samples of all signals that a formula reads, not between two of them."""
        measured = np.ones(len(t), dtype=bool)
        for name, source in self._sources.items():
            if re.search(rf"\b{name}\b", text):
                measured &= watched.measured(source.template, t, hidden)
        return measured

    def _late(self, watched: Watched, began: float, takes: float) -> Finding:
        subject, clause = watched.subject.name, self.rules.clause
        deadline, last = began + self.within_s, watched.end_s
        unseen = [gap for gap in watched.gaps if gap.start_s < deadline and gap.end_s > began]
        if unseen or last < deadline - TOLERANCE_S:
            message = f"the response to {began:.3f} s is not in the log until {deadline:.3f} s"
            return Finding.inconclusive(subject, message, span=Span(began, max(began, last)), clause=clause)
        answered = np.isfinite(takes)
        end = began + takes if answered else last
        came = f"came after {takes:.3f} s" if answered else "never came"
        return self._too_late(watched, Span(began, end), came, end - deadline)

    def _too_late(self, watched: Watched, span: Span, came: str, late_s: float) -> Finding:
        return Finding(
            watched.subject.name,
            Verdict.VIOLATED,
            f"the response to {span.start_s:.3f} s {came} (at most {self.within_s:g} s)",
            span=span,
            robustness=min(self.within_s - span.duration_s, 0.0),
            unit="s",
            quantities={"response_s": span.duration_s, "time_in_violation_s": late_s},
            clause=self.rules.clause,
            critical=self.critical,
        )


def _until(answered: FloatArray, began_s: float) -> float:
    """How long it takes from a time until a response, s; infinite: none comes."""
    after = int(answered.searchsorted(began_s))
    return float(answered[after]) - began_s if after < len(answered) else math.inf
