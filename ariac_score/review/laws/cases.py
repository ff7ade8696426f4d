"""Made trials: small, random, and simple enough to be read as counter-examples.

A case states which task findings are violated, and when each safety check was. Its findings
are made as a monitor would make them, from samples. Nothing here reads a log.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from random import Random

import numpy as np

from ariac_score.checks.depth import DepthProfile, depth_profile
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.expression import Expression, Number, text_of
from ariac_score.scoring.left_open import LeftOpen
from ariac_score.scoring.levels import TEXT, TRIAL
from ariac_score.scoring.pricing import value_of
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import VIOLATION_FUNCTIONS
from ariac_score.trial.spans import Span, episodes_where
from ariac_score.trial.sums import exact_sum

__all__ = ["TICKS_PER_S", "Case", "Violation", "World", "draw_case", "draw_violation"]

TICKS_PER_S = 10
"""Cases are sampled at 10 Hz, or at 5 Hz where the law asks what half the rate gives."""

LONGEST_S = 60
"""Violations of random cases lie in the first minute."""

# Two, so that a price for each pair and one for the whole trial differ.
PAIRS = ("robot/human_1", "robot/human_2")
_SEVERITIES = frozenset({"time_in_violation_s", "relative_depth_integral_s", "relative_depth_max"})
_NUMBERS = (1.0, 2.0, 3.0, 5.0, 10.0)
_DEPTHS = (1.0, 0.5, 0.1)


@dataclass(frozen=True, order=True)
class Violation:
    """One stretch in which a safety check is violated.

    Attributes:
        check: Name in the rule set.
        pair: Index into `PAIRS`, the two pairs there are.
        start: First tick.
        end: The tick after the last; the first, for a single event.
        depth: Relative depth, the same throughout.
        critical: Whether it is a critical event.
    """

    check: str
    pair: int
    start: int
    end: int
    depth: float = 1.0
    critical: bool = False

    def __str__(self) -> str:
        when = f"from {_s(self.start)} to {_s(self.end)}" if self.end > self.start else f"at {_s(self.start)}"
        words = f"{self.check} of {PAIRS[self.pair]} {when}"
        depth = f", relative depth {self.depth:g}" if self.depth != 1 else ""
        return f"{words}{depth}{', critical' if self.critical else ''}"


def _s(ticks: int) -> str:
    return f"{ticks / TICKS_PER_S:g} s"


@dataclass(frozen=True)
class Case:
    """One made trial.

    Attributes:
        orders: For each order the number of parts of each of its submissions.
        failed: Task findings that are violated, by check and subject.
        violations: Of safety checks.
        numbers: What was measured, by `check.quantity`; the same for every subject.
        duration: Ticks.
        step: 1 for every sample, 2 for half the rate.
        unknown: Safety checks of a pair, or task findings, that are undecided.
    """

    orders: tuple[tuple[int, ...], ...]
    failed: frozenset[tuple[str, str]] = frozenset()
    violations: tuple[Violation, ...] = ()
    numbers: Mapping[str, float] = field(default_factory=dict)
    duration: int = LONGEST_S * TICKS_PER_S
    step: int = 1
    unknown: frozenset[tuple[str, str]] = frozenset()


@dataclass(frozen=True)
class World:
    """A rule set as the laws see it.

    Attributes:
        rule_set: The rule set.
        events: Checks about single events, which have a moment and no duration.
        bridged: Below which pause a monitor makes one of two violations, s, by check; 1 s where nothing
            is given, as in the made competition, whose monitors are not installed.
        ungraded: Checks whose violations have no depth, such as contacts.
        humans: For each check about humans whether it charges a machine that stands still; `None` where it
            does not say.
        paid: For each rule that reads an official record the quantities that say what work earned, which are
            0 where it was not done.
    """

    rule_set: RuleSet
    events: frozenset[str] = frozenset()
    bridged: Mapping[str, float] = field(default_factory=dict)
    ungraded: frozenset[str] = frozenset()
    humans: Mapping[str, bool | None] = field(default_factory=dict)
    paid: Mapping[str, frozenset[str]] = field(default_factory=dict)

    @cached_property
    def uses(self) -> dict[str, list[tuple[str, str]]]:
        """For each check the score depends on: at which level and in which function."""
        found: dict[str, list[tuple[str, str]]] = {}
        for level, function, check in self.rule_set.sheet.uses(self.rule_set.sheet.score):
            found.setdefault(check, []).append((level, function))
        return {check: found[check] for check in sorted(found)}

    @cached_property
    def measured(self) -> dict[str, tuple[str, ...]]:
        """The quantities of each check that formulas use."""
        found: dict[str, set[str]] = {}
        for formula in _all_formulas(self.rule_set):
            for call in formula.walk():
                if isinstance(call, ast.Call) and ast.unparse(call.func) == "measure" and len(call.args) == 2:
                    check, quantity = (ast.unparse(argument) for argument in call.args)
                    found.setdefault(check, set()).add(quantity)
        return {check: tuple(sorted(found[check])) for check in sorted(found)}

    @cached_property
    def numbers(self) -> tuple[float, ...]:
        """The numbers above 0 that formulas state and parameters name, with 1, sorted."""
        stated = {
            float(node.value)
            for formula in _all_formulas(self.rule_set)
            for node in formula.walk()
            if isinstance(node, ast.Constant) and isinstance(node.value, int | float)
        }
        named = {float(parameter.value) for parameter in self.rule_set.parameters.values()}
        return tuple(sorted(number for number in {1.0, *stated, *named} if number > 0))

    @cached_property
    def kinds(self) -> frozenset[str]:
        """Checks that choose which of two formulas counts, such as one for the kind of a task."""
        choosing: set[str] = set()
        for formula in _all_formulas(self.rule_set):
            for node in formula.walk():
                if (
                    isinstance(node, ast.IfExp)
                    and not self._constant(node.body)
                    and not self._constant(node.orelse)
                ):
                    choosing |= {name.id for name in ast.walk(node.test) if isinstance(name, ast.Name)}
        return frozenset(choosing & set(self.rule_set.checks))

    def _constant(self, node: ast.expr) -> bool:
        """Whether it is the same number in every trial, as what a row of a table is worth."""
        if isinstance(node, ast.Name | ast.Attribute):
            return text_of(node) in self.rule_set.parameters
        inner = (each for each in ast.iter_child_nodes(node) if isinstance(each, ast.expr))
        return all(self._constant(each) for each in inner)

    @cached_property
    def safety(self) -> tuple[str, ...]:
        """Monitors whose violations the score depends on."""
        return tuple(
            check
            for check, uses in self.uses.items()
            if self._is_monitor(check)
            and any(function in VIOLATION_FUNCTIONS or function == "measure" for _, function in uses)
            and set(self.measured.get(check, ())) <= _SEVERITIES
        )

    @cached_property
    def watched(self) -> tuple[str, ...]:
        """Safety checks about stretches of time."""
        return tuple(check for check in self.safety if check not in self.events)

    @cached_property
    def graded(self) -> tuple[str, ...]:
        """Those of them whose violations have a depth."""
        return tuple(check for check in self.watched if check not in self.ungraded)

    @cached_property
    def task(self) -> tuple[str, ...]:
        """Rules whose verdicts earn points."""
        return tuple(
            check
            for check, uses in self.uses.items()
            if not self._is_monitor(check)
            and check not in self.kinds
            and any(function != "measure" for _, function in uses)
        )

    @cached_property
    def earning(self) -> tuple[str, ...]:
        """Rules that say what work earned, by their satisfied findings or by what they measure."""
        counted = {check for check in self.task if "points" in {f for _, f in self.uses[check]}}
        measured = {check for check, names in self.paid.items() if names & set(self.measured.get(check, ()))}
        return tuple(check for check in self.uses if check in counted | measured)

    def t_off_s(self, check: str) -> float:
        """Below which pause the monitor makes one of two violations."""
        return self.bridged.get(check, 1.0)

    def _is_monitor(self, check: str) -> bool:
        return self.rule_set.checks[check].group == "ariac_score.monitors"

    @cached_property
    def levels(self) -> dict[str, str]:
        """The level of each rule's findings."""
        return {check: self._level(check) for check in self.uses if not self._is_monitor(check)}

    def _level(self, check: str) -> str:
        """The level of a rule's subjects: the innermost where points are counted, else where it is used."""
        levels = self.rule_set.sheet.levels
        used = [levels.index(level) for level, _ in self.uses[check]]
        counted = any(function in ("points", "count") for _, function in self.uses[check])
        if counted and check not in self.measured:
            return levels[0]
        return levels[min(*used, max(len(levels) - 2, 0))]

    def subjects(self, case: Case, check: str) -> tuple[str, ...]:
        """The subjects of a rule's findings."""
        level = self.levels[check]
        return ("",) if level == TRIAL else _paths(self._shape, case.orders, level)

    def scopes(self, case: Case) -> Scope:
        """The work of a case."""
        return _scopes(self._shape, case.orders, case.duration)

    @cached_property
    def _shape(self) -> _Shape:
        """What made work looks like under the rule set."""
        sheet = self.rule_set.sheet
        compared = [
            node.value
            for formula in _all_formulas(self.rule_set)
            for node in formula.walk()
            if isinstance(node, ast.Constant) and isinstance(node.value, str)
        ]
        facts = tuple(
            (level, tuple((name, fact.type == TEXT) for name, fact in sheet.facts.get(level, {}).items()))
            for level in sheet.levels
        )
        return _Shape(sheet.levels[:-1][::-1], facts, compared[0] if compared else "text")

    def findings(self, case: Case) -> dict[str, Finding]:
        """The findings of all checks about a case."""
        found = [finding for check in self.uses for finding in self._findings(check, case)]
        numbered: dict[str, Finding] = {}
        for number, finding in enumerate(found):
            numbered[f"{finding.check}#{number:03d}"] = finding  # padded: ids are sorted as text
        return numbered

    def _findings(self, check: str, case: Case) -> Iterator[Finding]:
        if check in self.safety:
            yield from self._watches(check, case)
        elif self._is_monitor(check):
            yield Finding(
                "team", Verdict.SATISFIED, "recorded", quantities=self._numbers(check, case), check=check
            )
        else:
            for subject in self.subjects(case, check):
                verdict = Verdict.VIOLATED if (check, subject) in case.failed else Verdict.SATISFIED
                verdict = Verdict.INCONCLUSIVE if (check, subject) in case.unknown else verdict
                numbers = self._numbers(check, case)
                paid = self.paid.get(check, frozenset()) & numbers.keys()
                if verdict is Verdict.VIOLATED:
                    numbers |= dict.fromkeys(paid, 0.0)
                elif verdict is Verdict.INCONCLUSIVE:  # a record that is not there says nothing of points
                    numbers = {name: number for name, number in numbers.items() if name not in paid}
                yield Finding(subject, verdict, check, quantities=numbers, check=check)

    def _numbers(self, check: str, case: Case) -> dict[str, float]:
        return {name: case.numbers[f"{check}.{name}"] for name in self.measured.get(check, ())}

    def _watches(self, check: str, case: Case) -> Iterator[Finding]:
        """The findings of a safety check about each pair, made from samples."""
        none = True
        for pair, subject in enumerate(PAIRS):
            violations = [v for v in case.violations if (v.check, v.pair) == (check, pair)]
            if not violations:
                continue
            none = False
            if (check, subject) in case.unknown:
                first, last = min(v.start for v in violations), max(v.end for v in violations)
                hidden = Span(first / TICKS_PER_S, last / TICKS_PER_S)
                yield Finding(subject, Verdict.INCONCLUSIVE, "not recorded", span=hidden, check=check)
            elif check in self.events:
                for violation in violations:
                    moment = Span(violation.start / TICKS_PER_S, violation.start / TICKS_PER_S)
                    yield _violated(check, subject, moment, critical=violation.critical)
            else:
                graded = check not in self.ungraded
                yield from _episodes(violations, case, subject, self.t_off_s(check), graded=graded)
        if none:
            yield Finding(
                PAIRS[0], Verdict.SATISFIED, "kept", quantities=dict.fromkeys(_SEVERITIES, 0.0), check=check
            )

    def score(self, case: Case, *, runs: int = 1) -> Number | None:
        """The score, not rounded; `None` when what is undecided withholds it.

        Args:
            case: The trial.
            runs: How often the team makes this very run of it.

        Raises:
            FormulaError: It has no value in this case.
        """
        sheet = self.rule_set.sheet
        scopes, findings = self.scopes(case), self.findings(case)
        cohort = self._cohort(scopes)
        if runs > 1:
            values = {
                name: [sheet.evaluate_in(sheet.terms[TRIAL][name], scopes, findings)[""].value] * runs
                for name in sheet.pooled
            }
            pooled = {f"runs.{name}": {"": max(each)} for name, each in values.items()}
            cohort = replace(cohort, values={**cohort.values, **pooled})
        return value_of(
            findings,
            scopes,
            sheet,
            self.rule_set.policies,
            cohort=cohort,
            left_open=LeftOpen(counts=self.rule_set.counts, monitors=self.rule_set.monitors),
        )

    def is_behind(self, case: Case, other: Case) -> bool:
        """Whether a tie-break of the ranking puts a trial behind another one."""
        for name, lowest in self.ties:
            formula = self.rule_set.sheet.terms[TRIAL][name]
            mine, others = (
                self.rule_set.sheet.evaluate_in(formula, self.scopes(each), self.findings(each))[""].value
                for each in (case, other)
            )
            if mine != others:
                return (mine > others) is lowest
        return False

    @cached_property
    def ties(self) -> tuple[tuple[str, bool], ...]:
        """The terms of the trial that separate equal teams, and whether less of each is better."""
        found: list[tuple[str, bool]] = []
        for key in self.rule_set.ranking.get("ties", ()):
            ((side, name),) = key.items()
            if name in self.rule_set.sheet.terms.get(TRIAL, {}):
                found.append((name, side == "lowest"))
        return tuple(found)

    def _cohort(self, scopes: Scope) -> CohortValues:
        """Values of other teams, always the same ones."""
        levels = {term.level for term in self.rule_set.sheet.cohort.values()}
        paths = ["", *(scope.path for level in sorted(levels) for scope in scopes.each(level))]
        return CohortValues("", {name: dict.fromkeys(paths, 10.0) for name in self.rule_set.sheet.cohort})


def _all_formulas(rule_set: RuleSet) -> list[Expression]:
    return rule_set.sheet.reached(rule_set.sheet.score)


@dataclass(frozen=True)
class _Shape:
    """What made work looks like.

    Attributes:
        levels: Those inside the trial, from the outermost inwards.
        facts: For each level the name of each fact, and whether it is a text.
        text: What each text is.
    """

    levels: tuple[str, ...]
    facts: tuple[tuple[str, tuple[tuple[str, bool], ...]], ...]
    text: str

    def work(self, index: int, tasks: Sequence[int]) -> Scope:
        """One outermost piece of work, with so much of the innermost in each piece inside it."""
        level, *within = self.levels
        path = f"{level}_{index}"
        if len(within) > 1:
            inner = tuple(
                self.made(
                    within[0],
                    f"{path}/{within[0]}_{k}",
                    k,
                    self._below(within[1:], f"{path}/{within[0]}_{k}", count),
                )
                for k, count in enumerate(tasks)
            )
        else:
            inner = self._below(within, path, sum(tasks))
        return self.made(level, path, index, inner)

    def _below(self, levels: Sequence[str], path: str, count: int) -> tuple[Scope, ...]:
        """So much of the innermost level; of a level in between, one."""
        if not levels:
            return ()
        level, *within = levels
        paths = [f"{path}/{level}_{k}" for k in range(1 if within else count)]
        return tuple(self.made(level, one, k, self._below(within, one, count)) for k, one in enumerate(paths))

    def made(self, level: str, path: str, index: int, inner: tuple[Scope, ...]) -> Scope:
        """A scope with the facts its level has: its place, how much is inside it, and numbers that differ."""
        known: dict[str, Number | str] = {"index": index}
        for within in self.levels:
            known[f"{within}s"] = sum(1 for one in inner for _ in _levels_in(one, within))
        facts = {
            name: known.get(name, self.text if is_text else 1 if index == 0 else 3)
            for name, is_text in dict(self.facts).get(level, ())
        }
        return Scope(level, path, facts, inner)


def _levels_in(scope: Scope, level: str) -> Iterator[Scope]:
    """A scope and those inside it, as far as they are of a level."""
    if scope.level == level:
        yield scope
    yield from scope.each(level)


@lru_cache(maxsize=1024)
def _paths(shape: _Shape, orders: tuple[tuple[int, ...], ...], level: str) -> tuple[str, ...]:
    return tuple(scope.path for scope in _scopes(shape, orders, 0).each(level))


@lru_cache(maxsize=256)
def _scopes(shape: _Shape, orders: tuple[tuple[int, ...], ...], duration: int) -> Scope:
    found = tuple(shape.work(index, tasks) for index, tasks in enumerate(orders)) if shape.levels else ()
    whole = shape.made(TRIAL, "", 0, found)
    return replace(whole, facts={**whole.facts, "duration_s": duration / TICKS_PER_S})


def _episodes(
    violations: list[Violation], case: Case, subject: str, t_off_s: float, *, graded: bool
) -> Iterator[Finding]:
    """As a monitor finds them: violating samples, grouped over pauses shorter than `t_off_s`."""
    # Two more ticks, so that half the rate has a sample after the last violation as well.
    until = max(case.duration, *(violation.end + 2 for violation in violations))
    ticks = np.arange(0, until, case.step)
    depth = np.zeros(len(ticks))
    for violation in violations:
        inside = (ticks >= violation.start) & (ticks < violation.end)
        # Where violations of one pair overlap, a monitor sees one, as deep as the deeper.
        depth[inside] = np.maximum(depth[inside], violation.depth)
    t = ticks / TICKS_PER_S
    sample_s = case.step / TICKS_PER_S
    for span in episodes_where(t, depth > 0, t_off_s=t_off_s):
        rows = (t >= span.start_s) & (t < span.end_s) & (depth > 0)
        yield _violated(
            violations[0].check,
            subject,
            span,
            critical=any(
                v.critical and v.start / TICKS_PER_S < span.end_s and v.end / TICKS_PER_S > span.start_s
                for v in violations
            ),
            time_in_violation_s=int(rows.sum()) * sample_s,
            relative_depth_integral_s=exact_sum(depth[rows]) * sample_s,
            relative_depth_max=float(depth[rows].max()),
            profile=depth_profile(t[rows], np.full(int(rows.sum()), sample_s), depth[rows])
            if graded
            else None,
        )


def _violated(
    check: str,
    subject: str,
    span: Span,
    *,
    critical: bool,
    profile: DepthProfile | None = None,
    **quantities: float,
) -> Finding:
    numbers = {**dict.fromkeys(_SEVERITIES, 0.0), **quantities}
    return Finding(
        subject,
        Verdict.VIOLATED,
        f"{check} violated",
        span=span,
        quantities=numbers,
        critical=critical,
        check=check,
        profile=profile,
    )


# Drawing -------------------------------------------------------------------------------


def _upto(rng: Random, count: int) -> int:
    """A whole number below `count`; `random()` alone is the same in every Python."""
    return int(rng.random() * count)


def draw_violation(world: World, rng: Random, *, shortest: int = 1) -> Violation:
    """A random violation of one of the safety checks."""
    check = world.safety[_upto(rng, len(world.safety))]
    start = _upto(rng, 40 * TICKS_PER_S)
    length = shortest + _upto(rng, (3 if rng.random() < 0.5 else 15) * TICKS_PER_S)
    pair = int(rng.random() < 0.2)
    length = 0 if check in world.events else length
    return Violation(check, pair, start, start + length, _DEPTHS[_upto(rng, 3)], rng.random() < 0.15)


def draw_case(world: World, rng: Random, *, most_violations: int = 4) -> Case:
    """A random case: an order or two, some parts wrong, some violations."""
    tasks = 1 + int(rng.random() < 0.15)
    orders = tuple(tuple(1 + _upto(rng, 2) for _ in range(tasks)) for _ in range(1 + int(rng.random() < 0.3)))
    numbers = {
        f"{check}.{name}": _NUMBERS[_upto(rng, len(_NUMBERS))]
        for check, names in world.measured.items()
        for name in names
    }
    case = Case(orders, numbers=numbers)
    share = (0.0, 0.1, 0.5, 0.9, 1.0)[_upto(rng, 5)]
    failed = frozenset(
        (check, subject)
        for check in world.uses
        if check in world.levels
        for subject in world.subjects(case, check)
        if rng.random() < (0.5 if check in world.kinds else share)
    )
    # Few violations mostly; some laws break only where there are many.
    most = 3 * most_violations if rng.random() < 0.2 else most_violations
    count = _upto(rng, most + 1) if world.safety else 0
    violations = tuple(sorted(draw_violation(world, rng) for _ in range(count)))
    return Case(orders, failed, violations, numbers)
