"""The score sheet: named formulas for each scope, and the functions on checks they may use."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from ariac_score.checks.findings import COUNT, POINTS, Finding, Verdict
from ariac_score.errors import FormulaError, NeedsCohortError, UnknownFactError, did_you_mean
from ariac_score.scoring.charge import charge
from ariac_score.scoring.cohort import CohortTerm, CohortValues, Contribution
from ariac_score.scoring.expression import Expression, Number, Traced, add_up, text_of
from ariac_score.scoring.scope import LEVELS, Scope

__all__ = [
    "AGGREGATES",
    "CHECK_FUNCTIONS",
    "FACTS",
    "VIOLATION_FUNCTIONS",
    "Pricing",
    "ScopeNames",
    "ScoreSheet",
    "scopes_inside",
]

_COHORT, _RUNS = "cohort", "runs"
_NO_COHORT = CohortValues()

FACTS: Mapping[str, Mapping[str, str]] = {
    "part": {},
    "submission": {"parts": "number of wanted products"},
    "order": {
        "index": "0 for the first order announced, 1 for the second, …",
        "priority": "as the order gives it",
        "parts": "number of wanted products",
    },
    "trial": {"duration_s": "from start to end of the competition", "orders": "number of orders"},
}
"""The facts a formula may name at each level, as `order.priority`."""


def _points(findings: Mapping[str, Finding]) -> list[tuple[str, Number]]:
    return [(key, int(f.verdict is Verdict.SATISFIED)) for key, f in findings.items()]


def _violations(findings: Mapping[str, Finding]) -> list[tuple[str, Number]]:
    return [(key, 1) for key, f in findings.items() if f.verdict is Verdict.VIOLATED]


def _seconds(findings: Mapping[str, Finding]) -> list[tuple[str, Number]]:
    # An episode bridges short pauses, so its time in violation can be less than its length.
    return [
        (key, f.quantities.get("time_in_violation_s", f.span.duration_s if f.span else 0.0))
        for key, f in findings.items()
        if f.verdict is Verdict.VIOLATED
    ]


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
    "charged": "what violations of several checks cost, one event once: charged(check=weight, …)",
}
_OPTIONS: Mapping[str, frozenset[str]] = {
    "demerits": frozenset({"tau_s"}),
    "product": frozenset({"p"}),
    "occurrences": frozenset({"every_s"}),
    "charged": frozenset({"again_after_s"}),
}
_UNITS: Mapping[str, str] = {"points": POINTS, "count": COUNT, "seconds": "s"}
"""Units of what functions on checks give; `measure` gives what the quantity is in."""
_DEFAULT_S = 5.0
"""After how long a violation that goes on costs the same again, unless a formula says otherwise.

Source: ARIAC 2025, penalties; monitor catalogue, section 3.
"""
VIOLATION_FUNCTIONS = frozenset(CHECK_FUNCTIONS) - {"points", "measure"}
"""The functions of violations, rather than of points or measured numbers."""
AGGREGATES = ("sum", "mean", "min", "max", "any", "all", "count")


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
    """

    terms: Mapping[str, Mapping[str, Expression]]
    score: Expression
    checks: frozenset[str]
    parameters: Mapping[str, Number] = field(default_factory=dict)
    cohort: Mapping[str, CohortTerm] = field(default_factory=dict)
    task: Expression | None = None

    def __post_init__(self) -> None:
        for level in LEVELS:
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

    @cached_property
    def about_orders(self) -> bool:
        """Whether any formula names orders, their submissions or parts."""
        below = LEVELS[:-1]
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

    @property
    def pooled(self) -> tuple[str, ...]:
        """The terms of the trial that the score takes from all runs of a team together (`runs.…`)."""
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

    def facts(self, formula: Expression, level: str = "trial") -> frozenset[str]:
        """The facts a formula names, itself or through the terms it rests on, such as `order.priority`."""
        known = {f"{at}.{name}" for at, names in FACTS.items() for name in names}
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
            level: One of `LEVELS`.
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

    def _validate_term(self, name: str, formula: Expression, level: str) -> None:
        """A term may not hide behind a parameter or a fact of the same name, which would win."""
        for kind, names in (("parameter", self.parameters), (f"fact of each {level}", FACTS[level])):
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

    def _validate_call(self, formula: Expression, call: ast.Call, level: str) -> set[int]:
        function = call.func.id if isinstance(call.func, ast.Name) else ""
        first = call.args[0] if call.args else None
        name = first.id if isinstance(first, ast.Name) else ""
        if function == "count" and name in LEVELS:
            self._inside(formula, name, level)
            return {id(first)}
        if function == "charged":
            self._validate_charged(formula, call)
            return set()
        # count() is an aggregate as well, but never of a bare name.
        if function in CHECK_FUNCTIONS and (function not in AGGREGATES or isinstance(first, ast.Name)):
            if name not in self.checks:
                given = ast.unparse(first) if first else "nothing"
                raise FormulaError(
                    f"{function}() asks about {given!r}, which is no check",
                    place=formula.where,
                    hint=did_you_mean(name, self.checks, what="checks of this rule set"),
                )
            wanted = 2 if function == "measure" else 1
            options = {str(keyword.arg) for keyword in call.keywords}
            if len(call.args) != wanted or options - _OPTIONS.get(function, frozenset()):
                raise _wrong_arguments(function, ast.unparse(call), formula.where)
            return {id(argument) for argument in call.args}
        if function not in ("min", "max", "abs", "clip", *AGGREGATES):
            known = {*CHECK_FUNCTIONS, "min", "max", "abs", "clip", *AGGREGATES}
            raise FormulaError(
                f"unknown function {function!r}", place=formula.where, hint=did_you_mean(function, known)
            )
        return set()

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

    def _validate_name(self, formula: Expression, dotted: str, level: str, known: Sequence[str]) -> None:
        prefix, _, name = dotted.rpartition(".")
        # What may be named is above in the file (so no term rests on itself), or further in.
        if prefix == _RUNS and level == "trial":
            names = [*known]
        elif prefix == _COHORT:
            names = [n for n, t in self.cohort.items() if LEVELS.index(t.level) >= LEVELS.index(level)]
        elif not prefix:
            names = [*known, *self.parameters]
        elif prefix == level:
            names = [*known, *FACTS[level]]
        elif prefix in LEVELS and LEVELS.index(prefix) < LEVELS.index(level):
            names = [*self.terms.get(prefix, {}), *FACTS[prefix]]
        elif prefix in LEVELS:
            names = [*FACTS[prefix]]
        else:
            raise FormulaError(
                f"unknown name {dotted!r}",
                place=formula.where,
                hint=did_you_mean(prefix, LEVELS, what="scopes"),
            )
        if name not in names:
            hint = did_you_mean(name, names, what="known here")
            if name in self.checks:
                hint = f"{name!r} is a check: ask points({name}), holds({name}), count({name}), …"
            raise FormulaError(f"unknown name {dotted!r}", place=formula.where, hint=hint)

    def _inside(self, formula: Expression, inner: str, level: str) -> None:
        if LEVELS.index(inner) >= LEVELS.index(level):
            raise FormulaError(
                f"there is no {inner} inside a {level}",
                place=formula.where,
                hint=f"scopes from inside out: {', '.join(LEVELS)}",
            )


class Pricing:
    """One evaluation of a sheet over one trial; every term of every scope is evaluated once."""

    def __init__(
        self, sheet: ScoreSheet, trial: Scope, findings: Mapping[str, Finding], cohort: CohortValues
    ) -> None:
        self.sheet, self.trial, self.cohort = sheet, trial, cohort
        # Sorted, so that sums and traces do not depend on the order in which findings were stored.
        self.findings = {key: findings[key] for key in sorted(findings)}
        self._terms: dict[tuple[str, str], Traced] = {}
        self._by_check: dict[str, list[tuple[str, Finding]]] = {}
        for key, finding in self.findings.items():
            self._by_check.setdefault(finding.check, []).append((key, finding))

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
        return {k: f for k, f in self._by_check.get(check, ()) if scope.contains(f.subject)}


class ScopeNames:
    """What names and functions mean within one scope."""

    def __init__(self, pricing: Pricing, scope: Scope, outer: tuple[Scope, ...]) -> None:
        self.pricing, self.scope, self.outer = pricing, scope, outer

    def name(self, dotted: str) -> Traced:
        """The value of a name, as `Environment` has it."""
        prefix, _, name = dotted.rpartition(".")
        sheet = self.pricing.sheet
        if not prefix and name in sheet.parameters:
            return Traced(name, sheet.parameters[name], "parameter")
        if prefix == _COHORT:
            return self._across_teams(name, dotted)
        if prefix == _RUNS:
            return self._across_runs(name, dotted)
        scope = self._scope(prefix or self.scope.level, dotted)
        fact = scope.facts.get(name)
        if isinstance(fact, (int, float)):
            return Traced(dotted, fact, "fact", subject=scope.path)
        if name in sheet.terms.get(scope.level, {}) and scope is self.scope:
            return self.pricing.term(scope, name, self.outer)
        # A fact the sheet knows and this trial lacks is unknown: never 0, and never a misspelt name.
        if name in FACTS[scope.level]:
            raise UnknownFactError(
                f"nothing says the {name} of {scope.path or 'the trial'}",
                hint="add the trial configuration, which states it",
            )
        raise FormulaError(f"{dotted!r} has no value in {scope.path or 'the trial'}")

    def _across_runs(self, name: str, dotted: str) -> Traced:
        """A term summed over all runs of the team; for a run scored alone, that of the run."""
        values = self.pricing.cohort.values.get(dotted, {})
        if "" in values:
            return Traced(dotted, values[""], "fact")
        own = self.pricing.term(self.pricing.trial, name, ())
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
        if function == "count" and first in LEVELS:
            scopes = list(self.scope.each(first))
            return Traced(f"count({first})", len(scopes), "fact", subject=self.scope.path)
        if function == "charged":
            return self._charged(options)
        if function in CHECK_FUNCTIONS and first in self.pricing.sheet.checks:
            return self._of_check(function, first, arguments[1:], options)
        level = self.inner_level(arguments) if len(arguments) == 1 else ""
        if function in AGGREGATES and level:
            return self._aggregate(function, arguments[0], level)
        return None

    def inner_level(self, arguments: Iterable[Expression]) -> str:
        """The outermost level below this one that the argument names."""
        inner = LEVELS[: LEVELS.index(self.scope.level)]
        # The outermost, because an aggregate over orders may itself hold one over their parts.
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

    def _charged(self, options: Mapping[str, Number]) -> Traced:
        """What the violations of several checks cost, each moment under its heaviest."""
        weights = {name: weight for name, weight in options.items() if name not in _OPTIONS["charged"]}
        again_after_s = options.get("again_after_s", _DEFAULT_S)
        label = f"charged({', '.join(f'{name}={value:g}' for name, value in options.items())})"
        for name, weight in weights.items():
            if weight < 0:
                raise FormulaError(
                    f"{label}: the weight of {name!r} is negative", hint="a violation never brings points"
                )
        if not again_after_s > 0:
            raise FormulaError(f"{label}: again_after_s must be positive", hint="give a time in s, such as 5")
        findings = {key: f for name in weights for key, f in self.findings_of(name).items()}
        shares = charge(findings, weights, again_after_s=again_after_s)
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
        known = name in sheet.terms.get(level, {}) and name not in self.scope.facts
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
            shares = _seconds(findings)
        elif function == "demerits":
            shares = _demerits(findings, options.get("tau_s", _DEFAULT_S), label)
        elif function == "measure":
            shares = _measures(findings, rest[0].source, label)
        elif function == "occurrences":
            shares = _occurrences(findings, options.get("every_s", _DEFAULT_S), label)
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


# 5 s as the default of all three: ARIAC 2025, penalties; monitor catalogue, section 3.
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


def _wrong_arguments(function: str, call: str, where: str) -> FormulaError:
    return FormulaError(f"{call}: wrong arguments", place=where, hint=CHECK_FUNCTIONS[function])


def _product(p: Number, times: int, label: str) -> Number:
    try:
        return p**times
    except OverflowError:
        raise FormulaError(f"{label}: overflow", hint=CHECK_FUNCTIONS["product"]) from None


def _measures(findings: Mapping[str, Finding], quantity: str, label: str) -> list[tuple[str, Number]]:
    """A named quantity of each finding that has it; a name that no satisfied finding has is misspelt.

    Satisfied findings without any quantity are those of checks that measure violations alone: 0.
    """
    kept = any(f.verdict is Verdict.SATISFIED and f.quantities for f in findings.values())
    known = {name for finding in findings.values() for name in finding.quantities}
    if kept and quantity not in known:
        raise FormulaError(
            f"{label}: no finding has the quantity {quantity!r}",
            hint=did_you_mean(quantity, known, what="quantities of this check"),
        )
    return [(key, f.quantities[quantity]) for key, f in findings.items() if quantity in f.quantities]


def _unit_of(findings: Mapping[str, Finding], quantity: str) -> str:
    """The declared unit of a quantity, which has one over all findings of a check; empty without one."""
    return next((f.units[quantity] for f in findings.values() if quantity in f.units), "")


def _demerits(findings: Mapping[str, Finding], tau_s: Number, label: str) -> list[tuple[str, Number]]:
    if not tau_s > 0:
        raise FormulaError(f"{label}: tau_s must be positive", hint="give a time in s, such as 5")
    return [
        (key, 1 + finding.quantities.get("relative_depth_integral_s", 0.0) / tau_s)
        for key, finding in findings.items()
        if finding.verdict is Verdict.VIOLATED
    ]
