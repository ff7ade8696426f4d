"""Trials made for a rulebook, and what they score: nothing here knows a formula."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from ariac_score.checks.findings import COUNT, POINTS
from ariac_score.checks.measures import Measure
from ariac_score.errors import FormulaError
from ariac_score.review.laws.cases import TICKS_PER_S, Case, Violation, World
from ariac_score.review.rulebook.blocks import figure, in_words
from ariac_score.review.rulebook.formulas import quoted
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.expression import Number, Traced
from ariac_score.scoring.levels import TRIAL
from ariac_score.scoring.policy import assume
from ariac_score.scoring.pricing import value_of
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["PARTS", "Made", "Step", "violation"]

PARTS = 3
"""Pieces of work in the trial that examples start from, where their competition has no usual number."""

_OTHERS = 1.2
"""The mean of all teams, as a multiple of what the made trial brings to it."""

_NUMBERS: Mapping[str, float] = {"s": 30.0, "dollars": 1000.0, POINTS: 10.0, COUNT: 1.0, "m": 1.0}
"""What a made trial measures, by unit; 1 of anything else."""


@dataclass(frozen=True)
class Step:
    """One term of a worked example.

    Attributes:
        term: Its name.
        level: Of it.
        paths: The scopes in which it has this value.
        how: The numbers that it was made of; empty where there is but one.
        value: What came out.
    """

    term: str
    level: str
    paths: tuple[str, ...]
    how: str
    value: Number


def violation(check: str, start_s: float, seconds: float, *, critical: bool = False) -> Violation:
    """A violation of a check, as deep as can be."""
    start = round(start_s * TICKS_PER_S)
    return Violation(check, 0, start, start + round(seconds * TICKS_PER_S), critical=critical)


@dataclass(frozen=True)
class Made:
    """Made trials of a rule set.

    Attributes:
        rule_set: The rules.
        events: Its monitors of single events.
        bridged: Which pauses its monitors bridge, s.
        measures: What its checks declare of their quantities, by check.
        parts: Pieces of work in each order.
    """

    rule_set: RuleSet
    events: frozenset[str]
    bridged: Mapping[str, float]
    measures: Mapping[str, Mapping[str, Measure]]
    parts: int = PARTS
    _cohorts: dict[int, tuple[Case, CohortValues]] = field(default_factory=dict, repr=False)

    @cached_property
    def world(self) -> World:
        """The rules as the laws see them."""
        return World(self.rule_set, self.events, self.bridged)

    @property
    def kinds(self) -> list[str]:
        """The kinds of tasks; one without a name where the rules know none."""
        return list(self.rule_set.expanded.get("kinds", {})) or [""]

    def perfect(self, kind: str = "") -> Case:
        """One piece of work with everything right, of one kind."""
        case = Case(((self.parts,),), numbers=self._numbers)
        kinds: Mapping[str, str] = self.rule_set.expanded.get("kinds", {})
        before = list(kinds)[: list(kinds).index(kind)] if kind else []
        # The kinds are asked for one after the other, so those before it must not apply.
        others = {check for one in before for check in self.world.kinds if check in str(kinds[one])}
        failed = {(check, subject) for check in others for subject in self.world.subjects(case, check)}
        return replace(case, failed=frozenset(failed))

    @cached_property
    def _numbers(self) -> dict[str, float]:
        return {
            f"{check}.{name}": self._number(check, name)
            for check, names in self.world.measured.items()
            for name in names
        }

    def _number(self, check: str, name: str) -> float:
        declared = self.measures.get(check, {}).get(name)
        unit = declared.unit if declared else "s" if name.endswith("_s") else "1"
        # Of what is counted, most is said by yes and no: all is right where the best is counted.
        if declared and unit == COUNT and declared.best is not None:
            return declared.best
        return _NUMBERS.get(unit, 1.0)

    def cohort(self, case: Case) -> CohortValues:
        """The means of all teams: a fifth above what the made trial brings."""
        sheet, values = self.rule_set.sheet, dict[str, dict[str, float]]()
        if not sheet.needs_cohort:
            return CohortValues()
        known = self._cohorts.get(id(case))
        if known is not None and known[0] is case:
            return known[1]
        for name in sheet.cohort:
            for each in sheet.contributions(self.world.scopes(case), self.world.findings(case), only=name):
                values.setdefault(name, {})[each.path] = float(each.value) * _OTHERS
        self._cohorts[id(case)] = case, CohortValues("", values)
        return self._cohorts[id(case)][1]

    def score(self, case: Case) -> Number | None:
        """The score of a made trial; `None` where it has none."""
        world, sheet = self.world, self.rule_set.sheet
        try:
            return value_of(
                world.findings(case),
                world.scopes(case),
                sheet,
                self.rule_set.policies,
                cohort=self.cohort(case),
            )
        except FormulaError:
            return None

    def with_numbers(self, **values: Number) -> Made:
        """The same trials under other named numbers."""
        sheet = self.rule_set.sheet
        changed = replace(sheet, parameters={**sheet.parameters, **values})
        return replace(self, rule_set=replace(self.rule_set, sheet=changed))

    def mistakes(self, kind: str) -> Iterator[tuple[str, Case]]:
        """For each rule that earns or keeps points the perfect trial with one thing wrong."""
        case = self.perfect(kind)
        for check in self.world.task:
            subjects = self.world.subjects(case, check)
            if subjects:
                yield check, replace(case, failed=case.failed | {(check, subjects[-1])})

    def direction(self, parameter: str) -> int:
        """Whether more of a named number gives more points (1), fewer (-1) or neither (0)."""
        value = self.rule_set.parameters[parameter].value
        other = self.with_numbers(**{parameter: value * 2 if value else 1})
        moved = [after - before for case, before in self._tried if (after := other.score(case)) is not None]
        largest = max(moved, key=abs, default=0)
        return (largest > 1e-9) - (largest < -1e-9)

    @cached_property
    def _tried(self) -> list[tuple[Case, Number]]:
        """Cases in which numbers are told apart, and what they score."""
        cases = []
        for kind in self.kinds:
            perfect = self.perfect(kind)
            cases += [perfect, replace(perfect, orders=((self.parts,), (self.parts,)), failed=frozenset())]
            cases += [case for _, case in self.mistakes(kind)]
            for check in self.world.safety:
                seconds = 0 if check in self.events else 7
                cases.append(replace(perfect, violations=(violation(check, 0, seconds),)))
        return [(case, score) for case in cases if (score := self.score(case)) is not None]

    # Worked ----------------------------------------------------------------------------

    def steps(self, case: Case) -> list[Step]:
        """Every term that the score rests on here, from the inside out; alike ones in one step.

        Raises:
            FormulaError: The case has no score.
        """
        sheet, world = self.rule_set.sheet, self.world
        found = assume(world.findings(case), self.rule_set.policies, priced=sheet.scored).findings
        score = sheet.evaluate(world.scopes(case), found, self.cohort(case))
        levels = {scope.path: scope.level for scope in world.scopes(case).walk()}
        terms = {(levels[each.subject], each.label, each.subject): each for each in _terms_in(score)}
        steps: list[Step] = []
        for level in sheet.levels:
            for name in sheet.terms.get(level, {}):
                alike: dict[tuple[str, Number], list[str]] = {}
                for (at, label, path), each in sorted(terms.items(), key=lambda item: item[0]):
                    if (at, label) == (level, name):
                        alike.setdefault((_calculation(each.children[0]), each.value), []).append(path)
                steps += [Step(name, level, tuple(paths), *made) for made, paths in alike.items()]
        whole = score.children[0] if score.kind == "term" and score.children else score
        return [*steps, Step("score", TRIAL, ("",), _calculation(whole), score.value)]


def _terms_in(traced: Traced) -> Iterator[Traced]:
    """The terms that a number rests on; each as often as it is named."""
    if traced.kind == "term" and traced.children and "." not in traced.label:
        yield traced
    for child in traced.children:
        yield from _terms_in(child)


_SIGNS = {"*": "\N{MULTIPLICATION SIGN}", "-": "\N{MINUS SIGN}", "/": "/", "+": "+", "**": "to the power of"}


def _calculation(traced: Traced) -> str:
    """The numbers that a number was made of: `3 + 3 + 2`; of one taken as it is, where it comes from."""
    said = _said(traced, inside=False)
    return _taken_from(traced) if said == figure(traced.value) else said


def _taken_from(traced: Traced) -> str:
    """Where a number comes from that nothing was reckoned with."""
    inner = [child for child in traced.children if child.kind != "finding"]
    if traced.kind == "op" and traced.op == "if":
        chosen = _taken_from(inner[-1])
        return chosen if inner[-1].kind != "number" else "the case that applies here"
    if traced.kind == "each" and len(inner) == 1:
        only = _taken_from(inner[0])
        return only if only.endswith("inside it") else f"{only} of the only one inside it"
    if traced.kind in ("parameter", "term"):
        return quoted(traced.label)
    if traced.kind == "check":
        check, _, quantity = traced.label.partition("(")[2].rstrip(")").partition(", ")
        return f"{quoted(quantity)} by {quoted(check)}" if quantity else f"{traced.op} of {quoted(check)}"
    return "as stated"


def _said(traced: Traced, *, inside: bool = True) -> str:
    children = [child for child in traced.children if child.kind != "finding"]
    if traced.kind == "each" and traced.op == "sum" and len(children) > 1:
        return _bracketed(" + ".join(figure(child.value) for child in children), inside)
    if traced.kind == "op" and traced.op == "if":
        return _said(children[-1], inside=inside)
    if traced.kind == "op" and traced.op in _SIGNS and len(children) == 2:
        first = children[0]
        # From left to right, so that sums of sums and products of products need no brackets.
        tight = first.kind == "op" and (first.op == traced.op or {first.op, traced.op} <= {"+", "-"})
        if traced.op in ("+", "-"):
            left, right = (_said(child, inside=child.op not in ("*", "/")) for child in children)
            left = _said(first, inside=False) if tight else left
        else:
            left, right = _said(first, inside=not tight), _said(children[1])
        return _bracketed(f"{left} {_SIGNS[traced.op]} {right}", inside)
    if traced.kind == "op" and traced.op in ("min", "max"):
        of = ", ".join(_said(child, inside=False) for child in children)
        return _bracketed(f"the {'least' if traced.op == 'min' else 'greatest'} of {of}", inside)
    return figure(traced.value)


def _bracketed(said: str, inside: bool) -> str:
    return f"({said})" if inside else said


def place_in_words(path: str, one: Mapping[str, str]) -> str:
    """A path of made work in words: `part 3`, the innermost alone, for there is one of each other.

    >>> place_in_words("order_0/part_2", {"order": "order", "part": "piece"})
    'piece 3'
    """
    level, _, number = path.rpartition("/")[2].rpartition("_")
    return f"{one.get(level, in_words(level))} {int(number) + 1}" if number.isdigit() else ""
