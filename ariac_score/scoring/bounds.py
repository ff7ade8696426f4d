"""Between which values a formula lies in all worlds that a log allows.

Each open thing is an input. Where a formula is typed to go one way with an input, its ends lie at the ends
of that input. Inputs that may move it either way are tried out where they are verdicts, which have two
values; where they have more, interval arithmetic bounds the formula, and the bound is said not to be tight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from math import floor, inf

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.errors import FormulaError
from ariac_score.scoring.charge import charge
from ariac_score.scoring.cohort import LEAST, MOST, CohortValues
from ariac_score.scoring.expression import Expression, Number
from ariac_score.scoring.left_open import DEPTH, DURATION, Variable
from ariac_score.scoring.scope import Scope, is_inside, lasting
from ariac_score.scoring.sheet import (
    AGAIN_AFTER_S,
    AGGREGATES,
    CHECK_FUNCTIONS,
    Pricing,
    ScopeNames,
    ScoreSheet,
    charge_options,
    scopes_inside,
)
from ariac_score.scoring.signs import Sign, Typed, constant, most_of, of_function, power, total, type_of

__all__ = ["Bound", "Pins", "Worlds"]

Pins = Mapping[str, bool]
"""Inputs that are known, by name: whether each is at its worst end."""

MOST_TRIED = 512
"""Evaluations for one end. Beyond, interval arithmetic bounds what is left: a result may not take minutes."""


@dataclass(frozen=True)
class Bound:
    """One end of what a formula can be.

    Attributes:
        value: The end; infinite where nothing bounds it.
        pins: Where its inputs are there.
        is_reached: Whether every input that moves it is at an end, so that a world of these ends has it.
    """

    value: float
    pins: Pins
    is_reached: bool


@dataclass
class Worlds:
    """A formula over one trial in all worlds that its log allows.

    Attributes:
        sheet: The formulas.
        formula: Which of them.
        trial: The scopes, outermost.
        findings: What is certain, by id.
        variables: What is open.
        cohort: Values across teams.
        measures: What checks declare of their quantities, by check and quantity.
        beyond: The `runs.…` that nothing bounds above: what a run did whose log is lost.
    """

    sheet: ScoreSheet
    formula: Expression
    trial: Scope
    findings: Mapping[str, Finding]
    variables: Sequence[Variable]
    cohort: CohortValues
    measures: Mapping[str, Mapping[str, Measure]]
    beyond: frozenset[str] = frozenset()
    unbounded: dict[str, None] = field(default_factory=dict)
    """What nothing bounds, in words."""
    sums: dict[tuple[str, ...], tuple[float, ...]] = field(default_factory=dict)
    """Sums over findings, which many evaluations need: of a function in a scope, and of what is open."""

    def __post_init__(self) -> None:
        self.pricing = Pricing(self.sheet, self.trial, self.findings, self.cohort)
        self.verdicts = frozenset(one.key for one in self.variables if one.is_verdict or one.turns)
        durations = (one.limits[DURATION] for one in self.variables if one.check == DURATION and one.limits)
        self.lasts_s = next(durations, None)
        self.tried, self._may_try = 0, 0

    def typed(self, pins: Pins) -> Typed:
        """The type of the formula where some inputs are known.

        Raises:
            FormulaError: It has no value, whatever the others are.
        """
        self.tried += 1
        evaluation = _Evaluation(self, pins)
        return type_of(self.formula, _Around(evaluation, self.trial, ()))

    def end(self, *, least: bool, pins: Pins | None = None, most_tried: int = MOST_TRIED) -> Bound:
        """The least or the greatest value.

        Args:
            least: Which of both.
            pins: Inputs that are known.
            most_tried: Evaluations after which interval arithmetic bounds what is left; `tried` then says
                that there were so many.
        """
        self.tried, self._may_try = 0, most_tried
        return self._end(dict(pins or {}), least)

    def _end(self, pins: dict[str, bool], least: bool) -> Bound:
        found = self.typed(pins)
        while ways := {name: s for name, s in found.signs.items() if s in (Sign.UP, Sign.DOWN)}:
            # An input that raises the value is at its worst end where the value is greatest.
            pins = {**pins, **{name: (sign is Sign.UP) is not least for name, sign in ways.items()}}
            found = self.typed(pins)
        here = Bound(found.least if least else found.most, pins, not any(found.signs.values()))
        both = sorted(name for name, sign in found.signs.items() if sign and name in self.verdicts)
        if not both or self.tried >= self._may_try:
            return here
        ends = [self._end({**pins, both[0]: worst}, least) for worst in (True, False)]
        return (min if least else max)(ends, key=lambda bound: bound.value)

    def world(self, pins: Pins, *, worst: bool) -> dict[str, Finding]:
        """The findings of a world.

        Args:
            pins: The inputs that are known.
            worst: Where the others are.
        """
        replaced = {key for one in self.variables for key in one.seen}
        found = {key: f for key, f in self.findings.items() if key not in replaced}
        for one in self.variables:
            # Where only what it gives, such as a number of violations, has an end, that one decides.
            inner = (pins[name] for name in pins if name.startswith(f"{one.key}#"))
            found.update(one.world(worst=pins.get(one.key, next(inner, worst))))
        return found

    def cohort_in(self, pins: Pins) -> CohortValues:
        """The values across teams and runs of a world."""
        return self.cohort.at(pins)

    def trial_in(self, pins: Pins) -> Scope:
        """The scopes of a world: those of the log, with a duration that is pinned where it has an end."""
        if self.lasts_s is None or DURATION not in pins:
            return self.trial
        lasts_s = self.lasts_s[pins[DURATION]]
        return lasting(self.trial, lasts_s) if lasts_s < inf else self.trial


class _Evaluation:
    """One evaluation: every term of every scope is typed once."""

    def __init__(self, worlds: Worlds, pins: Pins) -> None:
        self.worlds, self.pins = worlds, pins
        self._terms: dict[tuple[str, str], Typed] = {}

    def term(self, scope: Scope, name: str, outer: tuple[Scope, ...]) -> Typed:
        key = (scope.path, f"{scope.level}.{name}")
        if key not in self._terms:
            formula = self.worlds.sheet.terms[scope.level][name]
            self._terms[key] = type_of(formula, _Around(self, scope, outer))
        return self._terms[key]

    def input(self, name: str, at_best: float, at_worst: float) -> Typed:
        """A number that goes from one end to the other with an input."""
        if name in self.pins:
            return constant(at_worst if self.pins[name] else at_best)
        if at_best == at_worst:
            return constant(at_best)
        sign = Sign.UP if at_worst > at_best else Sign.DOWN
        return Typed(min(at_best, at_worst), max(at_best, at_worst), {name: sign})


class _Around:
    """The names and functions of one scope, as types."""

    def __init__(self, evaluation: _Evaluation, scope: Scope, outer: tuple[Scope, ...]) -> None:
        self.evaluation, self.scope, self.outer = evaluation, scope, outer
        self.worlds = evaluation.worlds
        self.names = ScopeNames(self.worlds.pricing, scope, outer)

    def name(self, dotted: str) -> Typed:
        term = self.names.term_of(dotted)
        if term is None:
            return self._duration() if dotted == DURATION else constant(self.names.name(dotted).value)
        own = self.evaluation.term(*term)
        pooled = self.worlds.cohort.values.get(dotted, {}) if dotted.startswith("runs.") else {}
        known = most_of([own, self._of_others(dotted, pooled)]) if "" in pooled else own
        if dotted not in self.worlds.beyond or self.evaluation.pins.get(dotted) is False:
            return known
        signs = known.signs if dotted in self.evaluation.pins else {**known.signs, dotted: Sign.UP}
        return Typed(known.least, inf, signs)

    def _of_others(self, dotted: str, pooled: Mapping[str, float]) -> Typed:
        """What other runs of the team did at most."""
        if LEAST not in pooled:
            return constant(pooled[""])
        return self.evaluation.input(dotted, pooled[LEAST], pooled[MOST])

    def _duration(self) -> Typed:
        """How long the competition lasted."""
        if self.worlds.lasts_s is None:
            return constant(self.names.name(DURATION).value)
        least_s, most_s = self.worlds.lasts_s
        if most_s < inf or self.evaluation.pins.get(DURATION) is False:
            return self.evaluation.input(DURATION, least_s, most_s)
        (lasted,) = (one for one in self.worlds.variables if one.check == DURATION)
        self._note_unbounded(DURATION, lasted)
        return Typed(least_s, inf, {} if DURATION in self.evaluation.pins else {DURATION: Sign.UP})

    def text_named(self, dotted: str) -> str | None:
        return self.names.text_named(dotted)

    def call(
        self, function: str, arguments: Sequence[Expression], options: Mapping[str, Number]
    ) -> Typed | None:
        first = arguments[0].as_name if arguments else ""
        if function == "charged":
            return self._charged(options)
        if function in CHECK_FUNCTIONS and first in self.worlds.sheet.checks:
            return self._of_check(function, first, arguments[1:], options)
        level = self.names.inner_level(arguments) if len(arguments) == 1 else ""
        if function in AGGREGATES and level:
            inside = scopes_inside(self.scope, level, self.outer)
            return of_function(
                function, [type_of(arguments[0], _Around(self.evaluation, *one)) for one in inside]
            )
        found = self.names.call(function, arguments, options)  # what only says what is there
        return None if found is None else constant(found.value)

    # Functions on checks -----------------------------------------------------------------

    def _split(self, check: str) -> tuple[dict[str, Finding], list[Variable]]:
        """What is certain of a check in this scope, and what is open.

        Raises:
            FormulaError: It says nothing here.
        """
        inside = [
            one
            for one in self.worlds.variables
            if one.check == check and is_inside(one.subject, self.scope.path)
        ]
        replaced = {key for one in inside for key in one.seen}
        certain = self.worlds.pricing.of_check(check, self.scope)
        if not certain and not inside:
            self.names.findings_of(check)  # which says so
        return {key: f for key, f in certain.items() if key not in replaced}, inside

    def _of_check(
        self, function: str, check: str, rest: Sequence[Expression], options: Mapping[str, Number]
    ) -> Typed:
        certain, variables = self._split(check)
        label = f"{function}({', '.join([check, *(r.source for r in rest)])})"
        given = (label, *(f"{name}={value!r}" for name, value in options.items()))

        def priced(findings: Mapping[str, Finding], of: str = function) -> float:
            if not findings:
                return 0
            return self.names.value_and_shares(of, findings, rest, options, label)[0]

        def seen() -> Typed:
            sums, key = self.worlds.sums, (self.scope.path, *given)
            if key not in sums:
                sums[key] = (priced(certain),)
            return constant(*sums[key])

        if function in ("measure", "occurrences"):
            settled = [one for one in variables if _is_settled(one, [each.source for each in rest])]
            certain = {**certain, **{key: f for one in settled for key, f in one.best.items()}}
            variables = [one for one in variables if one not in settled]
            given = (*given, *(one.key for one in settled))
        if not variables:
            return seen()
        if function == "points" and (
            endless := [one for one in variables if one.endless and one.limits is not None]
        ):
            self._note_unbounded(label, endless[0])  # a later violation takes what was kept so far
            return Typed(-inf, inf, {one.key: Sign.BOTH for one in variables})
        if function in ("holds", "violated", "gate"):
            return self._turning(function, certain, variables)
        of_one: Callable[[Variable], Typed]
        if function == "product":
            p = constant(options.get("p", 0.5))
            return power(p, total([constant(priced(certain, "count")), *map(self._count, variables)]))
        if function == "count":
            of_one = self._count
        elif function == "measure":
            quantity = rest[0].source
            kept = {key: f for key, f in certain.items() if quantity in f.quantities or _is_violated(f)}
            known = [constant(priced(kept))] if kept else []
            return total([*known, *(self._measured(one, quantity, label) for one in variables)])
        elif function == "demerits":
            tau_s = options.get("tau_s", AGAIN_AFTER_S)
            of_one = lambda one: total(  # noqa: E731  # one line, as its neighbours have a method
                [self._count(one), self._summed(one, lambda f: _depth(f) / tau_s, given, lasts=True)]
            )
        elif function == "occurrences":
            of_one = lambda one: self._occurrences(one, options.get("every_s", AGAIN_AFTER_S))  # noqa: E731
        else:  # points and seconds: sums that are never beyond those of the two worlds
            lasts = function == "seconds"
            of_one = lambda one: self._summed(one, lambda f: priced({"": f}), given, lasts=lasts)  # noqa: E731
        return total([seen(), *map(of_one, variables)])

    def _summed(
        self, one: Variable, worth: Callable[[Finding], float], given: tuple[str, ...], *, lasts: bool
    ) -> Typed:
        """A sum over findings that is between those of the best and of the worst world in all others.

        Args:
            one: Of which findings.
            worth: What each adds.
            given: The function as the formula has it, and its options.
            lasts: Whether it is the more, the longer a violation lasts.
        """
        key = (one.key, self.scope.path, *given)
        if key not in self.worlds.sums:
            ends = [self._sum_in(one.world(worst=worst), worth) for worst in (False, True)]
            if lasts and one.endless:
                ends[1] = inf
            if inf in ends:
                self._note_unbounded(given[0], one)
            self.worlds.sums[key] = tuple(ends)
        return self.evaluation.input(one.key, *self.worlds.sums[key])

    @staticmethod
    def _sum_in(world: Mapping[str, Finding], worth: Callable[[Finding], float]) -> float:
        try:
            return sum(map(worth, world.values()))
        except FormulaError:
            return inf

    def _count(self, one: Variable) -> Typed:
        best, worst = (sum(map(_is_violated, one.world(worst=side).values())) for side in (False, True))
        if (one.fewest, one.most) == (best, worst):
            return self.evaluation.input(one.key, best, worst)
        if one.most == inf:
            self._note_unbounded(f"count({one.check})", one)
        # Two violations that are joined are one, so neither world need have the most.
        return self.evaluation.input(f"{one.key}#count", one.fewest, one.most)

    def _occurrences(self, one: Variable, every_s: Number) -> Typed:
        if one.is_verdict:
            return self._count(one)
        best_s, worst_s = (
            sum(f.span.duration_s for f in one.world(worst=side).values() if _is_violated(f) and f.span)
            for side in (False, True)
        )
        if one.most == inf:
            self._note_unbounded(f"occurrences({one.check})", one)
        fewest = max(one.fewest, floor(best_s / every_s)) if best_s else one.fewest
        return self.evaluation.input(f"{one.key}#again", fewest, one.most + floor(worst_s / every_s + 1e-9))

    def _measured(self, one: Variable, quantity: str, label: str) -> Typed:
        if one.limits is not None:
            declared = self.worlds.measures.get(one.check, {}).get(quantity)
            bottom = 0.0 if declared is not None and declared.is_never_negative else -inf
            best, worst = one.limits.get(quantity, (bottom, inf))
            if inf in (abs(best), abs(worst)):
                self._note_unbounded(label, one)
            return self.evaluation.input(f"{one.key}#{quantity}", best, worst)
        values = [
            [f.quantities.get(quantity, 0.0 if not _is_violated(f) else inf) for f in world.values()]
            for world in (one.best, one.worst)
        ]
        if _adds_up(quantity):
            if one.endless:
                values[1].append(inf)
            if inf in values[0] + values[1]:
                self._note_unbounded(label, one)
            return self.evaluation.input(one.key, sum(values[0]), sum(values[1]))
        largest, smallest = max(values[0] + values[1], default=0.0), min(values[0] + values[1], default=0.0)
        count = max(one.most, len(values[0]), len(values[1]))
        high, low = (0.0 if not end else end * count for end in (max(largest, 0.0), min(smallest, 0.0)))
        if max(len(one.best), len(one.worst), one.most) <= 1:
            high, low = largest, smallest
        if inf in (high, -low):
            self._note_unbounded(label, one)
        return self.evaluation.input(f"{one.key}#{quantity}", low, high)

    def _turning(self, function: str, certain: Mapping[str, Finding], variables: Iterable[Variable]) -> Typed:
        def turns(finding: Finding) -> bool:
            return _is_violated(finding) and (function != "gate" or finding.critical)

        any_of = [constant(int(any(map(turns, certain.values()))))]
        for one in variables:
            ends = (int(any(map(turns, world.values()))) for world in (one.best, one.worst))
            any_of.append(self.evaluation.input(one.key, *ends))
        violated = of_function("max", any_of)
        if function == "violated":
            return violated
        return Typed(1 - violated.most, 1 - violated.least, {n: s.turned for n, s in violated.signs.items()})

    def _charged(self, options: Mapping[str, Number]) -> Typed:
        weights = {name: weight for name, weight in options.items() if name in self.worlds.sheet.checks}
        certain: dict[str, Finding] = {}
        variables: list[Variable] = []
        for check in weights:
            known, inside = self._split(check)
            certain.update(known)
            variables += inside
        if not variables:
            return constant(self.names.charged(options).value)
        ends = []
        for default in (False, True):
            world = dict(certain)
            for one in variables:
                world.update(one.world(worst=self.evaluation.pins.get(one.key, default)))
            shares = charge(world, weights, **charge_options(options, "charged(…)"))
            ends.append(total([constant(share) for _, share in shares]).least)
        timeless = [
            one
            for one in variables
            if not one.is_verdict
            and (one.endless or any(_is_violated(f) and f.span is None for f in one.worst.values()))
        ]
        for one in timeless:
            ends[1] = inf
            self._note_unbounded("charged(…)", one)
        moved = {one.key: Sign.UP for one in variables if one.key not in self.evaluation.pins}
        best, worst = ends
        if best == worst:
            return constant(best)
        return Typed(
            min(best, worst), max(best, worst), moved if best < worst else dict.fromkeys(moved, Sign.BOTH)
        )

    def _note_unbounded(self, label: str, one: Variable) -> None:
        self.worlds.unbounded[
            f"nothing bounds {label} of {one.subject or 'the trial'}: {one.causes[0].text}"
        ] = None


def _is_settled(one: Variable, quantities: Sequence[str]) -> bool:
    """Whether both worlds have the same violations, as far as some quantities say: only others are open."""
    if one.limits is not None or one.endless or one.is_verdict:
        return False
    ends = [
        sorted(
            (f.span.start_s, f.span.end_s, *(f.quantities.get(name, inf) for name in quantities))
            if f.span
            else (-inf, inf, *(f.quantities.get(name, inf) for name in quantities))
            for f in world.values()
            if _is_violated(f) or any(name in f.quantities for name in quantities)
        )
        for world in (one.best, one.worst)
    ]
    number = sum(map(_is_violated, one.worst.values()))
    return ends[0] == ends[1] and one.fewest == one.most == number


def _is_violated(finding: Finding) -> bool:
    return finding.verdict is Verdict.VIOLATED


def _depth(finding: Finding) -> float:
    if not _is_violated(finding):
        return 0.0
    if DEPTH not in finding.quantities:
        raise FormulaError(f"a violation of {finding.check} has no depth")
    return finding.quantities[DEPTH]


def _adds_up(quantity: str) -> bool:
    """Whether the sum of a quantity over violations is that over all time in violation."""
    return quantity == "time_in_violation_s" or "integral" in quantity
