"""The score sheet: named formulas for each scope, and the functions on checks they may use."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from ariac_score.checks.findings import COUNT, POINTS, Finding, Verdict
from ariac_score.errors import FormulaError, NeedsCohortError, OtherFactError, UnknownFactError, did_you_mean
from ariac_score.scoring.charge import SHORTEST_AGAIN_S, charge
from ariac_score.scoring.cohort import CohortTerm, CohortValues, Contribution
from ariac_score.scoring.expression import FUNCTIONS, Expression, Number, Traced, add_up, arity_of, text_of
from ariac_score.scoring.levels import (
    ALWAYS,
    TEXT,
    TRIAL,
    DeclaredFact,
    check_levels,
    no_such_level,
)
from ariac_score.scoring.scope import Scope

__all__ = [
    "AGAIN_AFTER_S",
    "AGGREGATES",
    "CHECK_FUNCTIONS",
    "RESERVED",
    "VIOLATION_FUNCTIONS",
    "Pricing",
    "ScopeNames",
    "ScoreSheet",
    "charge_options",
    "scopes_inside",
]

_COHORT, _RUNS = "cohort", "runs"
_NO_COHORT = CohortValues()


def _points(findings: Mapping[str, Finding]) -> list[tuple[str, Number]]:
    return [(key, int(f.verdict is Verdict.SATISFIED)) for key, f in findings.items()]


def _violations(findings: Mapping[str, Finding]) -> list[tuple[str, Number]]:
    return [(key, 1) for key, f in findings.items() if f.verdict is Verdict.VIOLATED]


def _seconds(findings: Mapping[str, Finding], label: str) -> list[tuple[str, Number]]:
    # An episode bridges short pauses, so its time in violation can be less than its length.
    return [
        (
            key,
            f.span.duration_s
            if f.span and _TIME not in f.quantities
            else _priced_quantity(key, f, _TIME, label, "price it with count() or product()"),
        )
        for key, f in findings.items()
        if f.verdict is Verdict.VIOLATED
    ]


def _priced_quantity(key: str, finding: Finding, quantity: str, label: str, instead: str) -> Number:
    """A quantity that a function prices; what was not measured has no price, and is not 0.

    Raises:
        FormulaError: The finding has no such quantity.
    """
    if quantity not in finding.quantities:
        raise FormulaError(
            f"{label}: finding {key!r} of check {finding.check!r} has no {quantity!r}",
            hint=f"let the check measure it, or {instead}",
        )
    return finding.quantities[quantity]


_TIME, _DEPTH = "time_in_violation_s", "relative_depth_integral_s"


CHECK_FUNCTIONS: Mapping[str, str] = {
    "points": "number of its findings that are satisfied",
    "count": "number of its violations; of a scope: how many there are",
    "holds": "1 when none of its findings is violated, else 0",
    "violated": "1 when one of its findings is violated, else 0",
    "seconds": "time in violation, in s",
    "demerits": "sum over its violations of 1 + (integral of relative depth, s) / tau_s",
    "gate": "0 when one of its violations is critical, else 1",
    "measure": "sum of a named quantity over its findings: measure(check, quantity)",
    "product": "p to the power of its violations: product(check, p=0.6)",
    "occurrences": "sum over its violations of 1 + whole times that every_s fits into their length",
    "charged": "what violations of several checks cost by depth, one event once: charged(check=weight, …)",
}
_OPTIONS: Mapping[str, frozenset[str]] = {
    "demerits": frozenset({"tau_s"}),
    "product": frozenset({"p"}),
    "occurrences": frozenset({"every_s"}),
    "charged": frozenset({"again_after_s", "severity"}),
}
_UNITS: Mapping[str, str] = {"points": POINTS, "count": COUNT, "seconds": "s"}
"""Units of what functions on checks give; `measure` gives what the quantity is in."""
AGAIN_AFTER_S = 5.0
"""After how long a violation that goes on costs the same again, unless a formula says otherwise.

Source: monitor catalogue, section 3.
"""
VIOLATION_FUNCTIONS = frozenset(CHECK_FUNCTIONS) - {"points", "measure"}
"""The functions of violations, rather than of points or measured numbers."""
AGGREGATES = ("sum", "mean", "min", "max", "any", "all", "count")
_ABSENT = "absent"
_KNOWN = frozenset({*CHECK_FUNCTIONS, *FUNCTIONS, *AGGREGATES, _ABSENT})
"""Every function of the language."""

RESERVED: Mapping[str, Iterable[str]] = {
    "function": _KNOWN,
    "kind of value across runs": (_COHORT, _RUNS),
    "number that every rule set has": ("score",),
}
"""The names that no level and no check may have, by what they stand for."""


@dataclass(frozen=True)
class ScoreSheet:
    """The priced side of a rule set.

    Attributes:
        terms: For each level its named formulas, in the order of the file.
        score: The formula of the trial's score.
        checks: The names of the checks the formulas may name.
        parameters: Named numbers an organiser may turn.
        cohort: The values across teams that formulas may name as `cohort.…`.
        task: What the trial is worth before any value across teams enters, where that has a name.
        levels: From the innermost outwards, the order of evaluation; the last is `trial`.
        facts: The facts of each level that are declared; formulas name them as `task.time_s`.
    """

    terms: Mapping[str, Mapping[str, Expression]]
    score: Expression
    checks: frozenset[str]
    parameters: Mapping[str, Number] = field(default_factory=dict)
    cohort: Mapping[str, CohortTerm] = field(default_factory=dict)
    task: Expression | None = None
    levels: tuple[str, ...] = (TRIAL,)
    facts: Mapping[str, Mapping[str, DeclaredFact]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._validate_levels()
        for level in self.levels:
            known: list[str] = []
            for name, formula in self.terms.get(level, {}).items():
                self._validate_term(name, formula, level)
                self._validate(formula, level, known)
                known.append(name)
        for term in self.cohort.values():
            for formula in term.formulas:
                self._validate(formula, term.level, list(self.terms.get(term.level, {})))
                self._validate_cohort_free(formula, term.level, f"cohort.{term.name}")
        for formula in (self.score, *([self.task] if self.task else [])):
            self._validate(formula, "trial", list(self.terms.get("trial", {})))
        if self.task:
            self._validate_cohort_free(self.task, "trial", "task")

    def facts_of(self, level: str) -> Mapping[str, DeclaredFact]:
        """The facts that formulas may name at a level; none at what is no level."""
        return self._facts.get(level, {})

    @cached_property
    def _facts(self) -> dict[str, dict[str, DeclaredFact]]:
        return {level: {**self.facts.get(level, {}), **ALWAYS.get(level, {})} for level in self.levels}

    @cached_property
    def about_work(self) -> bool:
        """Whether any formula names a level inside the trial."""
        below = self.levels[:-1]
        formulas = [self.score, *([self.task] if self.task else [])]
        formulas += [formula for term in self.cohort.values() for formula in term.formulas]
        for level, terms in self.terms.items():
            if terms and level in below:
                return True
            formulas += terms.values()
        return any(isinstance(n, ast.Name) and n.id in below for f in formulas for n in f.walk())

    @cached_property
    def scored(self) -> frozenset[str]:
        """The checks the score depends on."""
        return self.checks_in(self.score)

    @cached_property
    def priced_by_task(self) -> frozenset[str]:
        """The checks the task score depends on; none where there is no task score."""
        return self.checks_in(self.task) if self.task else frozenset()

    @cached_property
    def priced(self) -> frozenset[str]:
        """The checks the score or the task score depends on."""
        return self.scored | self.priced_by_task

    @cached_property
    def needs_cohort(self) -> bool:
        """Whether the score takes values across teams."""
        return any(level == _COHORT for level, _ in self._reached(self.score, "trial"))

    @cached_property
    def scored_across(self) -> frozenset[str]:
        """The checks, and the facts, that the values across teams rest on which the score takes."""
        names = {name for level, name in self._reached(self.score, "trial") if level == _COHORT}
        formulas = [(f, self.cohort[name].level) for name in names for f in self.cohort[name].formulas]
        return frozenset(
            used for each, at in formulas for used in (*self.checks_in(each, at), *self.facts_in(each, at))
        )

    @cached_property
    def pooled(self) -> tuple[str, ...]:
        """The terms of the trial that the score takes at their greatest over all runs (`runs.…`)."""
        formulas = [
            self.score,
            *(
                self.terms[level][name]
                for level, name in self._reached(self.score, "trial")
                if level != _COHORT
            ),
        ]
        named = (dotted.rpartition(".") for each in formulas for dotted in _names(each, self.checks))
        return tuple(dict.fromkeys(name for prefix, _, name in named if prefix == _RUNS))

    @property
    def priced_quantities(self) -> Iterator[tuple[str, str, str, Expression]]:
        """Every quantity that a formula prices by its name: function, check, quantity, formula."""
        formulas = [self.score, *([self.task] if self.task else [])]
        formulas += [formula for term in self.cohort.values() for formula in term.formulas]
        formulas += [formula for named in self.terms.values() for formula in named.values()]
        for formula in formulas:
            for call in formula.walk():
                if isinstance(call, ast.Call) and _is_call_of(call, "measure"):
                    check, quantity = (text_of(argument) for argument in call.args)
                    yield "measure", check, quantity, formula
                elif isinstance(call, ast.Call) and _is_call_of(call, "demerits"):
                    yield "demerits", text_of(call.args[0]), _DEPTH, formula

    def parameters_named(self, others: Iterable[Expression] = ()) -> frozenset[str]:
        """The parameters that any formula names, of the sheet or of `others`."""
        formulas = [self.score, *([self.task] if self.task else []), *others]
        formulas += [formula for term in self.cohort.values() for formula in term.formulas]
        formulas += [formula for named in self.terms.values() for formula in named.values()]
        return frozenset(name for each in formulas for name in _names(each, self.checks)) & set(
            self.parameters
        )

    def checks_in(self, formula: Expression, level: str = "trial") -> frozenset[str]:
        """The checks a formula depends on, itself or through the terms it names."""
        reached = [self.terms[at][name] for at, name in self._reached(formula, level) if at != _COHORT]
        return frozenset(name for each in (formula, *reached) for _, name in self._uses(each))

    def uses(self, formula: Expression, level: str = "trial") -> list[tuple[str, str, str]]:
        """Every use of a check, in a formula or the terms it rests on: level, function, check."""
        reached = [(at, self.terms[at][name]) for at, name in self._reached(formula, level) if at != _COHORT]
        return [(at, *use) for at, each in ((level, formula), *reached) for use in self._uses(each)]

    def reached(self, formula: Expression, level: str = "trial") -> list[Expression]:
        """A formula and those of all terms it rests on."""
        terms = [self.terms[at][name] for at, name in self._reached(formula, level) if at != _COHORT]
        return [formula, *terms]

    def facts_in(self, formula: Expression, level: str = "trial") -> frozenset[str]:
        """The facts a formula names, itself or through the terms it rests on, such as `task.time_s`."""
        known = {f"{at}.{name}" for at in self.levels for name in self.facts_of(at)}
        named = (name for each in self.reached(formula, level) for name in _names(each, self.checks))
        return frozenset(named) & known

    def _uses(self, formula: Expression) -> Iterator[tuple[str, str]]:
        """Every use of a check in the formula itself: function and check."""
        for call in formula.walk():
            if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name)):
                continue
            function, first = call.func.id, call.args[0] if call.args else None
            if function == "charged":  # names its checks by keyword, each with its weight
                yield from ((function, str(k.arg)) for k in call.keywords if k.arg in self.checks)
            elif function in CHECK_FUNCTIONS and isinstance(first, ast.Name) and first.id in self.checks:
                yield function, first.id

    def evaluate(
        self, trial: Scope, findings: Mapping[str, Finding], cohort: CohortValues = _NO_COHORT
    ) -> Traced:
        """The score with its trace.

        Args:
            trial: The scopes, outermost.
            findings: By id; undecided ones are settled beforehand (`policy.assume`).
            cohort: Values across teams, for formulas that name `cohort.…`.

        Raises:
            NeedsCohortError: The score needs a value across teams that is not given.
            FormulaError: Naming the term and the scope in which it cannot be evaluated.
        """
        return Pricing(self, trial, findings, cohort).root(self.score, "score")

    def value_of(
        self, formula: Expression, trial: Scope, findings: Mapping[str, Finding], cohort: CohortValues
    ) -> Traced:
        """A formula of the whole trial with its trace: the score or the task score.

        Raises:
            ScoreError: As `evaluate`.
        """
        return Pricing(self, trial, findings, cohort).root(
            formula, "score" if formula is self.score else "task score"
        )

    def evaluate_task(self, trial: Scope, findings: Mapping[str, Finding]) -> Traced | None:
        """The task score, before any value across teams enters; `None` when the sheet has none.

        Raises:
            FormulaError: It has no value here.
        """
        return Pricing(self, trial, findings, _NO_COHORT).root(self.task, "task score") if self.task else None

    def evaluate_in(
        self,
        formula: Expression,
        trial: Scope,
        findings: Mapping[str, Finding],
        *,
        level: str = "trial",
        cohort: CohortValues = _NO_COHORT,
    ) -> dict[str, Traced]:
        """A formula of one level in every scope of that level, by path.

        Args:
            formula: Checked beforehand with `check_formula`.
            trial: The scopes, outermost.
            findings: By id.
            level: One of `levels`.
            cohort: Values across teams.

        Raises:
            FormulaError: It has no value in one of the scopes.
        """
        pricing = Pricing(self, trial, findings, cohort)
        scopes = [(trial, ())] if level == "trial" else scopes_inside(trial, level, ())
        return {scope.path: formula.evaluate(ScopeNames(pricing, scope, outer)) for scope, outer in scopes}

    def check_formula(self, formula: Expression, level: str) -> None:
        """Find misspelt names in a formula that stands outside the sheet.

        Raises:
            FormulaError: It names something this sheet does not have at that level.
        """
        self._validate(formula, level, list(self.terms.get(level, {})))

    def contributions(
        self, trial: Scope, findings: Mapping[str, Finding], *, only: str
    ) -> list[Contribution]:
        """What this trial contributes to one value across teams.

        Raises:
            FormulaError: A formula of the cohort has no value here.
        """
        term = self.cohort[only]
        values = self.evaluate_in(term.value, trial, findings, level=term.level)
        counts = self.evaluate_in(term.where, trial, findings, level=term.level) if term.where else {}
        return [
            Contribution(only, path, traced.value, bool(counts[path].value) if term.where else True)
            for path, traced in values.items()
        ]

    def _reached(self, formula: Expression, level: str) -> list[tuple[str, str]]:
        """Every term a formula rests on, by level and name; values across teams as level `cohort`."""
        reached: dict[tuple[str, str], None] = {}
        open_ = [(formula, level)]
        while open_:
            inner, at = open_.pop()
            for dotted in _names(inner, self.checks):
                prefix, _, name = dotted.rpartition(".")
                key = ("trial" if prefix == _RUNS else prefix or at, name)
                if key in reached or not (prefix == _COHORT or name in self.terms.get(key[0], {})):
                    continue
                reached[key] = None
                if prefix != _COHORT:
                    open_.append((self.terms[key[0]][name], key[0]))
        return list(reached)

    def _validate_cohort_free(self, formula: Expression, level: str, what: str) -> None:
        if any(at == _COHORT for at, _ in self._reached(formula, level)):
            raise FormulaError(
                f"{what} rests on a value across teams",
                place=formula.where,
                hint="what a cohort is made of, and the task score, must be known for each team alone",
            )

    def _validate_levels(self) -> None:
        """Levels that formulas can name, and nothing declared for any other."""
        taken = {**RESERVED, "parameter": {name.partition(".")[0] for name in self.parameters}}
        check_levels(self.levels, taken)
        stated = {"terms": self.terms, "facts": self.facts}
        for key, levels in stated.items():
            for level in levels:
                if level not in self.levels:
                    raise no_such_level(level, self.levels, place=f"$.{key}.{level}", where=key)
        for term in self.cohort.values():
            if term.level not in self.levels:
                where = f"cohort.{term.name}"
                raise no_such_level(term.level, self.levels, place=f"$.{where}.of", where=where)
        for name in ALWAYS[TRIAL].keys() & self.facts.get(TRIAL, {}).keys():
            if self.facts[TRIAL][name].type == TEXT:
                raise FormulaError(
                    f"trial.{name} is a number of every trial",
                    place=f"$.facts.{TRIAL}.{name}",
                    hint="give the text another name",
                )

    def _validate_term(self, name: str, formula: Expression, level: str) -> None:
        """A term may not hide behind a parameter or a fact of the same name, which would win."""
        named = {*self.parameters, *(one.partition(".")[0] for one in self.parameters)}
        for kind, names in (("parameter", named), (f"fact of each {level}", self.facts_of(level))):
            if name in names:
                raise FormulaError(
                    f"term {name!r} is also the name of a {kind}",
                    place=formula.where,
                    hint="formulas use these names: each must be one thing",
                )

    def _validate(self, formula: Expression, level: str, known: Sequence[str]) -> None:
        """Find misspelt names when the rule set is loaded, not when a trial is scored."""
        # Nodes that are not names of their own: functions, checks as arguments, the `order` of `order.x`.
        consumed: set[int] = set()
        for node in formula.walk():
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
                consumed.add(id(node.func))
                consumed |= self._validate_call(formula, node, level)
        for node in formula.walk():
            if isinstance(node, ast.Attribute):
                consumed |= {id(inner) for inner in ast.walk(node.value)}
        for node in formula.walk():
            if isinstance(node, ast.Name | ast.Attribute) and id(node) not in consumed:
                self._validate_name(formula, ast.unparse(node), level, known)
        self._validate_texts(formula)
        formula.refuse_turned_ramps(self.parameters)

    def _validate_texts(self, formula: Expression) -> None:
        """A text is compared with a text, or asked whether it is absent, and nothing else."""
        compared: set[int] = set()
        for node in formula.walk():
            if isinstance(node, ast.Compare):
                operands = (node.left, *node.comparators)
                texts = [operand for operand in operands if self._is_text(operand)]
                if all(isinstance(op, ast.Eq | ast.NotEq) for op in node.ops) and len(texts) == len(operands):
                    compared |= {id(operand) for operand in texts}
                elif texts:
                    raise self._no_number(formula, texts[0])
                if compared and all(isinstance(operand, ast.Constant) for operand in operands):
                    raise self._no_number(formula, operands[0])
            elif isinstance(node, ast.Call) and _is_call_of(node, _ABSENT):
                compared |= {id(argument) for argument in node.args}
        for node in formula.walk():
            if isinstance(node, ast.Attribute) and self._is_text(node) and id(node) not in compared:
                raise self._no_number(formula, node)

    def _is_text(self, node: ast.expr) -> bool:
        if isinstance(node, ast.Constant):
            return isinstance(node.value, str)
        level, _, name = text_of(node).rpartition(".")
        fact = self.facts_of(level).get(name) if isinstance(node, ast.Attribute) else None
        return fact is not None and fact.type == TEXT

    def _no_number(self, formula: Expression, node: ast.expr) -> FormulaError:
        text = text_of(node)
        constant = isinstance(node, ast.Constant)
        return FormulaError(
            f"{text} is a text, no number: {formula.source!r}",
            place=formula.where,
            hint="compare it with == or != to a fact that is declared as a text"
            if constant
            else f'compare it with == or != to a text, as in {text} == "…"',
        )

    def _validate_call(self, formula: Expression, call: ast.Call, level: str) -> set[int]:
        function = call.func.id if isinstance(call.func, ast.Name) else ""
        first = call.args[0] if call.args else None
        name = first.id if isinstance(first, ast.Name) else ""
        if function == "count" and name in self.levels:
            self._inside(formula, name, level)
            return {id(first)}
        if function == "charged":
            self._validate_charged(formula, call)
            return set()
        if function == _ABSENT:
            self._validate_absent(formula, call, level)
            return {id(argument) for argument in call.args}
        # count() is an aggregate as well, but never of a bare name.
        if function in CHECK_FUNCTIONS and (function not in AGGREGATES or isinstance(first, ast.Name)):
            if name not in self.checks:
                given = ast.unparse(first) if first else "nothing"
                hint = did_you_mean(name, self.checks, what="checks of this rule set")
                raise FormulaError(
                    f"{function}() asks about {given!r}, which is no check"
                    + (" and no declared level" if function == "count" else ""),
                    place=formula.where,
                    hint=hint + (f"; levels: {', '.join(self.levels)}" if function == "count" else ""),
                )
            wanted = 2 if function == "measure" else 1
            options = {str(keyword.arg) for keyword in call.keywords}
            if len(call.args) != wanted or options - _OPTIONS.get(function, frozenset()):
                raise _wrong_arguments(function, ast.unparse(call), formula.where)
            return {id(argument) for argument in call.args}
        if function not in _KNOWN:
            raise FormulaError(
                f"unknown function {function!r}", place=formula.where, hint=did_you_mean(function, _KNOWN)
            )
        arity = arity_of(function) if function in FUNCTIONS else None
        if arity is not None and (len(call.args) != arity or call.keywords):
            raise FormulaError(
                f"{ast.unparse(call)}: {function!r} takes {arity} numbers",
                place=formula.where,
                hint=FUNCTIONS[function],
            )
        return set()

    def _validate_absent(self, formula: Expression, call: ast.Call, level: str) -> None:
        dotted = text_of(call.args[0]) if call.args else ""
        at, _, name = dotted.rpartition(".")
        if at in self.levels:
            self._validate_name(formula, dotted, level, ())
        if len(call.args) != 1 or call.keywords or name not in self.facts_of(at):
            raise FormulaError(
                f"{ast.unparse(call)}: absent() asks about one fact",
                place=formula.where,
                hint=f"name it with its level, as in absent({level}.time_s), and declare it under 'facts:'",
            )

    def _validate_charged(self, formula: Expression, call: ast.Call) -> None:
        named = [str(keyword.arg) for keyword in call.keywords if keyword.arg not in _OPTIONS["charged"]]
        for name in named:
            if name not in self.checks:
                raise FormulaError(
                    f"charged() asks about {name!r}, which is no check",
                    place=formula.where,
                    hint=did_you_mean(name, self.checks, what="checks of this rule set"),
                )
        if call.args or not named:
            raise _wrong_arguments("charged", ast.unparse(call), formula.where)

    def _behind(self, prefix: str, level: str, known: Sequence[str]) -> list[str] | None:
        """The names that may follow a prefix at a level; `None` where nothing has that prefix."""
        # What may be named is above in the file (so no term rests on itself), or further in.
        if prefix == _RUNS:
            return [*known] if level == TRIAL else []
        if prefix == _COHORT:
            return [n for n, t in self.cohort.items() if self._depth(t.level) >= self._depth(level)]
        if not prefix:
            return [*known, *self.parameters]
        if prefix == level:
            return [*known, *self.facts_of(level)]
        if prefix in self.levels:
            inner = self.terms.get(prefix, {}) if self._depth(prefix) < self._depth(level) else {}
            return [*inner, *self.facts_of(prefix)]
        group = [name.removeprefix(f"{prefix}.") for name in self.parameters if name.startswith(f"{prefix}.")]
        return group if group or prefix in self.checks else None

    def _validate_name(self, formula: Expression, dotted: str, level: str, known: Sequence[str]) -> None:
        prefix, _, name = dotted.rpartition(".")
        names = self._behind(prefix, level, known)
        if names is None:
            where = f"unknown name {dotted!r}"
            raise no_such_level(prefix, self.levels, place=formula.where, where=where)
        if name not in names:
            hint = did_you_mean(name, names, what="known here")
            if prefix in self.levels:
                hint += "; a fact that the trial states must be declared under 'facts:'"
            if name in self.checks:
                hint = f"{name!r} is a check: ask points({name}), holds({name}), count({name}), …"
            if not prefix and name in self.facts_of(level):
                hint = f"it is a fact, which is named with its level: {level}.{name}"
            raise FormulaError(f"unknown name {dotted!r}", place=formula.where, hint=hint)

    def _inside(self, formula: Expression, inner: str, level: str) -> None:
        if self._depth(inner) >= self._depth(level):
            raise FormulaError(
                f"there is no {inner} inside a {level}",
                place=formula.where,
                hint=f"levels from inside out: {', '.join(self.levels)}",
            )

    def _depth(self, level: str) -> int:
        return self.levels.index(level)


class Pricing:
    """One evaluation of a sheet over one trial; every term of every scope is evaluated once."""

    def __init__(
        self, sheet: ScoreSheet, trial: Scope, findings: Mapping[str, Finding], cohort: CohortValues
    ) -> None:
        self.sheet, self.trial, self.cohort = sheet, trial, cohort
        # Sorted, so that sums and traces do not depend on the order in which findings were stored.
        self.findings = {key: findings[key] for key in sorted(findings)}
        self._terms: dict[tuple[str, str], Traced] = {}
        # By check and every path that the subject lies in: asked for each scope, of which there may be many.
        self._within: dict[tuple[str, str], dict[str, Finding]] = {}
        for key, finding in self.findings.items():
            steps = finding.subject.split("/")
            for path in {"", *("/".join(steps[: i + 1]) for i in range(len(steps)))}:
                self._within.setdefault((finding.check, path), {})[key] = finding

    def root(self, formula: Expression, label: str) -> Traced:
        """A formula of the whole trial, such as its score."""
        try:
            value = formula.evaluate(ScopeNames(self, self.trial, ()))
        except FormulaError as error:
            error.place = error.place or formula.where
            raise
        return Traced(label, value.value, "term", children=(value,))

    def term(self, scope: Scope, name: str, outer: tuple[Scope, ...]) -> Traced:
        """A named term of one scope."""
        key = (scope.path, f"{scope.level}.{name}")
        # Evaluated once: terms of parts are named by many formulas further out.
        if key not in self._terms:
            formula = self.sheet.terms[scope.level][name]
            try:
                value = formula.evaluate(ScopeNames(self, scope, outer))
            except FormulaError as error:
                error.place = error.place or formula.where
                if scope.path and scope.path not in error.place:
                    error.place = f"{error.place} of {scope.path}"
                raise
            self._terms[key] = Traced(name, value.value, "term", children=(value,), subject=scope.path)
        return self._terms[key]

    def of_check(self, check: str, scope: Scope) -> dict[str, Finding]:
        """The findings of a check within a scope, by id."""
        return dict(self._within.get((check, scope.path), {}))


class ScopeNames:
    """What names and functions mean within one scope."""

    def __init__(self, pricing: Pricing, scope: Scope, outer: tuple[Scope, ...]) -> None:
        self.pricing, self.scope, self.outer = pricing, scope, outer

    def name(self, dotted: str) -> Traced:
        """The value of a name, as `Environment` has it."""
        prefix, _, name = dotted.rpartition(".")
        sheet = self.pricing.sheet
        if dotted in sheet.parameters:
            return Traced(dotted, sheet.parameters[dotted], "parameter")
        if prefix == _COHORT:
            return self._across_teams(name, dotted)
        if prefix == _RUNS:
            return self._across_runs(name, dotted)
        scope = self._scope(prefix or self.scope.level, dotted)
        # Only what is declared: an item may state anything, and a term of that name is not to change with it.
        if name in sheet.facts_of(scope.level):
            return Traced(dotted, self._number(scope, name, dotted), "fact", subject=scope.path)
        if name in sheet.terms.get(scope.level, {}) and scope is self.scope:
            return self.pricing.term(scope, name, self.outer)
        raise FormulaError(f"{dotted!r} has no value in {scope.path or 'the trial'}")

    def text_named(self, dotted: str) -> str | None:
        """The text of a fact; `None` for what is no fact, or declared as a number."""
        level, _, name = dotted.rpartition(".")
        declared = self.pricing.sheet.facts_of(level).get(name)
        if declared is None or declared.type != TEXT:
            return None
        scope = self._scope(level, dotted)
        value = self._present(scope, name, dotted)
        if not isinstance(value, str):
            raise _declared_otherwise(dotted, scope, value, "a text")
        return value

    def _number(self, scope: Scope, name: str, dotted: str) -> Number:
        value = self._present(scope, name, dotted)
        if isinstance(value, str):
            raise _declared_otherwise(dotted, scope, value, "a number")
        return value

    def _present(self, scope: Scope, name: str, dotted: str) -> Number | str:
        """A fact that is known to be there.

        Raises:
            UnknownFactError: Nothing says it.
            FormulaError: It is known to be absent.
        """
        value = self._fact(scope, name)
        if value is None:
            raise FormulaError(
                f"{dotted} of {scope.path or 'the trial'} is known to be absent",
                hint=f"say what counts then: … if not absent({dotted}) else …",
            )
        return value

    def _fact(self, scope: Scope, name: str) -> Number | str | None:
        # A fact the sheet knows and this trial lacks is unknown: never 0, and never a misspelt name.
        if name not in scope.facts:
            raise UnknownFactError(
                f"nothing says the {name} of {scope.path or 'the trial'}",
                hint="add the configuration or record of the trial that states it",
            )
        return scope.facts[name]

    def _across_runs(self, name: str, dotted: str) -> Traced:
        """A term at its greatest over all runs of the team; for a run scored alone, that of the run."""
        values = self.pricing.cohort.values.get(dotted, {})
        own = self.pricing.term(self.pricing.trial, name, ())
        if "" in values and values[""] > own.value:
            return Traced(dotted, values[""], "fact")
        return Traced(dotted, own.value, "term", children=(own,))

    def _across_teams(self, name: str, dotted: str) -> Traced:
        scope = self._scope(self.pricing.sheet.cohort[name].level, dotted)
        values = self.pricing.cohort.values.get(name, {})
        if scope.path not in values:
            raise NeedsCohortError(
                f"{dotted} of {scope.path or 'the trial'} comes from all teams and is not given",
                hint="give the organisers' cohort file with --cohort, or rank all teams together",
            )
        return Traced(dotted, values[scope.path], "fact", subject=scope.path)

    def _scope(self, level: str, dotted: str) -> Scope:
        for scope in (self.scope, *self.outer):
            if scope.level == level:
                return scope
        raise FormulaError(
            f"{dotted!r} speaks of each {level}, so it needs an aggregate",
            hint=f"say sum({dotted}), mean({dotted}), all({dotted} > 0), …",
        )

    def call(
        self, function: str, arguments: Sequence[Expression], options: Mapping[str, Number]
    ) -> Traced | None:
        """The value of a function on checks or scopes, as `Environment` has it."""
        first = arguments[0].as_name if arguments else ""
        if function == _ABSENT:
            return self._absent(first)
        if function == "count" and first in self.pricing.sheet.levels:
            scopes = list(self.scope.each(first))
            return Traced(f"count({first})", len(scopes), "fact", subject=self.scope.path)
        if function == "charged":
            return self.charged(options)
        if function in CHECK_FUNCTIONS and first in self.pricing.sheet.checks:
            return self._of_check(function, first, arguments[1:], options)
        level = self.inner_level(arguments) if len(arguments) == 1 else ""
        if function in AGGREGATES and level:
            return self._aggregate(function, arguments[0], level)
        return None

    def _absent(self, dotted: str) -> Traced:
        level, _, name = dotted.rpartition(".")
        scope = self._scope(level, dotted)
        return Traced(f"absent({dotted})", int(self._fact(scope, name) is None), "fact", subject=scope.path)

    def inner_level(self, arguments: Iterable[Expression]) -> str:
        """The outermost level below this one that the argument names."""
        levels = self.pricing.sheet.levels
        inner = levels[: levels.index(self.scope.level)]
        # The outermost, because an aggregate over tasks may itself hold one over what is inside them.
        named = {
            text_of(node).split(".")[0]
            for argument in arguments
            for node in argument.walk()
            if isinstance(node, ast.Attribute)
        }
        return next((level for level in reversed(inner) if level in named), "")

    def _aggregate(self, function: str, argument: Expression, level: str) -> Traced:
        inside = scopes_inside(self.scope, level, self.outer)
        each = [argument.evaluate(ScopeNames(self.pricing, scope, outer)) for scope, outer in inside]
        scoped = tuple(
            Traced(value.label, value.value, "each", "value", (value,), subject=scope.path)
            for value, (scope, _) in zip(each, inside, strict=True)
        )
        label = f"{function}({argument.source})"
        values = [value.value for value in each]
        # The sum of nothing is 0; a mean, least or largest of nothing is no number.
        if function in ("mean", "min", "max") and not values:
            raise FormulaError(
                f"{label}: there is no {level} in {self.scope.path or 'the trial'}",
                place=argument.where,
                hint=f"guard it: {label} if count({level}) else 0",
            )
        combine: Mapping[str, Callable[[list[Number]], Number]] = {
            "sum": add_up,
            "mean": lambda v: add_up(v) / len(v),
            "min": min,
            "max": max,
            "any": lambda v: int(any(v)),
            "all": lambda v: int(all(v)),
            "count": lambda v: sum(1 for x in v if x),
        }
        return Traced(label, combine[function](values), "each", function, scoped, subject=self.scope.path)

    def _of_check(
        self, function: str, check: str, rest: Sequence[Expression], options: Mapping[str, Number]
    ) -> Traced:
        findings = self.findings_of(check)
        shown = ", ".join([check, *(r.source for r in rest), *(f"{k}={v:g}" for k, v in options.items())])
        label = f"{function}({shown})"
        value, parts = self.value_and_shares(function, findings, rest, options, label)
        # `measure(check, quantity)` alone has a unit of its own: that of the quantity.
        unit = _unit_of(findings, rest[0].source) if function == "measure" else _UNITS.get(function, "")
        return self._trace(function, (check,), label, value, parts, findings, unit)

    def charged(self, options: Mapping[str, Number]) -> Traced:
        """What the violations of several checks cost, each moment under its heaviest."""
        weights = {name: weight for name, weight in options.items() if name not in _OPTIONS["charged"]}
        label = f"charged({', '.join(f'{name}={value:g}' for name, value in options.items())})"
        for name, weight in weights.items():
            if weight < 0:
                raise FormulaError(
                    f"{label}: the weight of {name!r} is negative", hint="a violation never brings points"
                )
        findings = {key: f for name in weights for key, f in self.findings_of(name).items()}
        shares = charge(findings, weights, **charge_options(options, label))
        value = add_up(share for _, share in shares)
        return self._trace("charged", tuple(weights), label, value, shares, findings)

    def term_of(self, dotted: str) -> tuple[Scope, str, tuple[Scope, ...]] | None:
        """The scope, the name and the scopes around it of the term that a name means; `None` for others."""
        prefix, _, name = dotted.rpartition(".")
        sheet, level = self.pricing.sheet, prefix or self.scope.level
        if prefix == _RUNS:
            return self.pricing.trial, name, ()
        if prefix == _COHORT or level != self.scope.level or (not prefix and name in sheet.parameters):
            return None
        known = name in sheet.terms.get(level, {}) and name not in sheet.facts_of(level)
        return (self.scope, name, self.outer) if known else None

    def findings_of(self, check: str) -> dict[str, Finding]:
        """The findings of a check within this scope.

        Raises:
            FormulaError: There are none.
        """
        findings = self.pricing.of_check(check, self.scope)
        # No finding is not "no violation": a gate on it would open for want of evidence.
        if not findings:
            raise FormulaError(
                f"check {check!r} says nothing about {self.scope.path or 'the trial'}",
                hint="ask for it in the scope its findings are about; an excluded finding leaves none",
            )
        return findings

    def _trace(
        self,
        function: str,
        checks: tuple[str, ...],
        label: str,
        value: Number,
        parts: Sequence[tuple[str, Number]],
        findings: Mapping[str, Finding],
        unit: str = "",
    ) -> Traced:
        """The trace of a function on checks, with the share of each finding."""
        children = tuple(
            Traced(findings[key].message, part, "finding", subject=findings[key].subject, findings=(key,))
            for key, part in parts
        )
        return Traced(
            label,
            value,
            "check",
            function,
            children,
            subject=self.scope.path,
            findings=tuple(k for k, _ in parts),
            checks=checks,
            unit=unit,
        )

    def value_and_shares(
        self,
        function: str,
        findings: Mapping[str, Finding],
        rest: Sequence[Expression],
        options: Mapping[str, Number],
        label: str,
    ) -> tuple[Number, list[tuple[str, Number]]]:
        """The value of a function on a check, and the share of each finding in it."""
        violations = _violations(findings)
        if function == "points":
            shares = _points(findings)
        elif function == "seconds":
            shares = _seconds(findings, label)
        elif function == "demerits":
            shares = _demerits(findings, options.get("tau_s", AGAIN_AFTER_S), label)
        elif function == "measure":
            shares = _measures(findings, rest[0].source, label)
        elif function == "occurrences":
            shares = _occurrences(findings, options.get("every_s", AGAIN_AFTER_S), label)
        elif function == "gate":
            critical = [(key, one) for key, one in violations if findings[key].critical]
            return int(not critical), critical
        elif function in ("holds", "violated"):
            return int(bool(violations) is (function == "violated")), violations
        elif function == "product":
            return _product(options.get("p", 0.5), len(violations), label), violations
        else:
            shares = violations
        return add_up(share for _, share in shares), shares


def charge_options(options: Mapping[str, Number], label: str) -> dict[str, Number]:
    """How `charged` counts time and depth.

    Args:
        options: As the formula states them.
        label: The formula.

    Raises:
        FormulaError: Of the time or the depth something impossible is asked.
    """
    again_after_s, severity = options.get("again_after_s", AGAIN_AFTER_S), options.get("severity", 1)
    if not again_after_s >= SHORTEST_AGAIN_S:
        raise FormulaError(
            f"{label}: again_after_s must be at least {SHORTEST_AGAIN_S:g} s",
            hint="depth over time is kept with shorter valleys filled; give a time in s, such as 5",
        )
    if not severity >= 0:
        raise FormulaError(
            f"{label}: severity must not be negative", hint="1 counts depth in proportion, 0 not at all"
        )
    return {"again_after_s": again_after_s, "severity": severity}


# 5 s as the default of all three: monitor catalogue, section 3.
def _occurrences(findings: Mapping[str, Finding], every_s: Number, label: str) -> list[tuple[str, Number]]:
    if not every_s > 0:
        raise FormulaError(f"{label}: every_s must be positive", hint="give a time in s, such as 5")
    return [
        # What happens at one moment has no length and counts once.
        (key, 1 + math.floor(f.span.duration_s / every_s + _WHOLE) if f.span else 1)
        for key, f in findings.items()
        if f.verdict is Verdict.VIOLATED
    ]


_WHOLE = 1e-9
"""A length of 5 s counts as 5 s, however its ends were rounded."""


def _names(formula: Expression, checks: frozenset[str]) -> Iterator[str]:
    """The dotted names of a formula, without functions and their arguments where these are checks."""
    consumed: set[int] = set()
    for node in formula.walk():
        if isinstance(node, ast.Call):
            consumed.add(id(node.func))
            first = node.args[0] if node.args else None
            if isinstance(first, ast.Name) and first.id in checks:
                consumed |= {id(argument) for argument in node.args}
        elif isinstance(node, ast.Attribute):
            consumed |= {id(inner) for inner in ast.walk(node.value)}
    for node in formula.walk():
        if isinstance(node, ast.Name | ast.Attribute) and id(node) not in consumed:
            yield ast.unparse(node)


def scopes_inside(
    scope: Scope, level: str, outer: tuple[Scope, ...]
) -> list[tuple[Scope, tuple[Scope, ...]]]:
    """The scopes of a level inside one, each with those around it from the inside out."""
    around = (scope, *outer)
    return [
        found
        for inner in scope.inner
        for found in ([(inner, around)] if inner.level == level else scopes_inside(inner, level, around))
    ]


def _is_call_of(call: ast.Call, function: str) -> bool:
    return isinstance(call.func, ast.Name) and call.func.id == function


def _declared_otherwise(dotted: str, scope: Scope, value: object, wanted: str) -> OtherFactError:
    return OtherFactError(
        f"{dotted} of {scope.path or 'the trial'} is {value!r}, but declared as {wanted}",
        hint="correct the log, competition or reader that states it, or its declaration under 'facts:'",
    )


def _wrong_arguments(function: str, call: str, where: str) -> FormulaError:
    return FormulaError(f"{call}: wrong arguments", place=where, hint=CHECK_FUNCTIONS[function])


def _product(p: Number, times: int, label: str) -> Number:
    try:
        return p**times
    except OverflowError:
        raise FormulaError(f"{label}: overflow", hint=CHECK_FUNCTIONS["product"]) from None


def _measures(findings: Mapping[str, Finding], quantity: str, label: str) -> list[tuple[str, Number]]:
    """A named quantity of each finding; a name that no satisfied finding has is misspelt.

    Satisfied findings without it are those of checks that measure violations alone: 0.
    """
    kept = any(f.verdict is Verdict.SATISFIED and f.quantities for f in findings.values())
    known = {name for finding in findings.values() for name in finding.quantities}
    if kept and quantity not in known:
        raise FormulaError(
            f"{label}: no finding has the quantity {quantity!r}",
            hint=did_you_mean(quantity, known, what="quantities of this check"),
        )
    instead = f"ask first whether there is one, as in '{label} if not violated(…) else …'"
    return [
        (key, _priced_quantity(key, f, quantity, label, instead))
        for key, f in findings.items()
        if quantity in f.quantities or f.verdict is Verdict.VIOLATED
    ]


def _unit_of(findings: Mapping[str, Finding], quantity: str) -> str:
    """The declared unit of a quantity, which has one over all findings of a check; empty without one."""
    return next((f.units[quantity] for f in findings.values() if quantity in f.units), "")


_NO_DEPTH = "price a check without depth with count(), occurrences() or charged()"


def _demerits(findings: Mapping[str, Finding], tau_s: Number, label: str) -> list[tuple[str, Number]]:
    if not tau_s > 0:
        raise FormulaError(f"{label}: tau_s must be positive", hint="give a time in s, such as 5")
    return [
        (key, 1 + _priced_quantity(key, finding, _DEPTH, label, _NO_DEPTH) / tau_s)
        for key, finding in findings.items()
        if finding.verdict is Verdict.VIOLATED
    ]
