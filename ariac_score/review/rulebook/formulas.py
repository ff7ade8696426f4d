"""A formula in words, as far as words are shorter to understand than the formula."""

from __future__ import annotations

import ast
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ariac_score.checks.measures import Measure
from ariac_score.review.rulebook.blocks import figure, in_words, with_unit
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.named import NamedParameter
from ariac_score.trial.frozen import FrozenMap
from ariac_score.trial.words import Words

__all__ = ["Speaker", "quoted"]

_SIGNS: Mapping[type[ast.operator], str] = {
    ast.Add: "+",
    ast.Sub: "\N{MINUS SIGN}",
    ast.Mult: "\N{MULTIPLICATION SIGN}",
    ast.Div: "divided by",
    ast.Pow: "to the power of",
}
_COMPARED: Mapping[type[ast.cmpop], str] = {
    ast.Lt: "is less than",
    ast.LtE: "is at most",
    ast.Gt: "is more than",
    ast.GtE: "is at least",
    ast.Eq: "is",
    ast.NotEq: "is not",
}
_OF_ONE = ("abs", "floor")
"""Functions of one number, which may be an aggregate, and never are one."""

_OF_ALL = {"sum": "the sum", "mean": "the mean", "min": "the least", "max": "the greatest"}
_GATES = ("holds", "violated", "gate")


def quoted(name: str) -> str:
    """A name of a check or term, in words and marked as one."""
    return f"\N{LEFT DOUBLE QUOTATION MARK}{in_words(name)}\N{RIGHT DOUBLE QUOTATION MARK}"


@dataclass(frozen=True)
class Speaker:
    """Says formulas of a rule set.

    Attributes:
        parameters: Its named numbers.
        checks: The names of its checks.
        words: Of its competition.
        innermost: The level of work inside which there is none.
        measures: What each check measures, by its name.
    """

    parameters: Mapping[str, NamedParameter]
    checks: frozenset[str]
    words: Words
    innermost: str
    measures: Mapping[str, Mapping[str, Measure]] = field(default_factory=lambda: FrozenMap({}))

    def says(self, formula: Expression) -> str:
        """The formula in words."""
        return self._value(formula.root)

    def condition(self, formula: Expression) -> str:
        """The formula in words, where it asks whether something is so."""
        return self._asked(formula.root)

    # Numbers ---------------------------------------------------------------------------

    def _value(self, node: ast.expr) -> str:
        if isinstance(node, ast.Constant):
            return figure(node.value) if isinstance(node.value, int | float) else f"{node.value!r}"
        if isinstance(node, ast.Name | ast.Attribute):
            return self._name(ast.unparse(node))
        if isinstance(node, ast.UnaryOp):
            if isinstance(node.op, ast.Not):
                return f"1 if {self._asked(node)}, else 0"
            return f"\N{MINUS SIGN}{self._inner(node.operand)}"
        if isinstance(node, ast.BinOp):
            return self._product(node) if isinstance(node.op, ast.Mult) else self._joined(node)
        if isinstance(node, ast.IfExp):
            return self._chosen(node)
        if isinstance(node, ast.Call):
            return self._call(node)
        return f"1 if {self._asked(node)}, else 0"

    def _inner(self, node: ast.expr) -> str:
        """A value inside another: in brackets where it is more than a name or a number."""
        said = self._value(node)
        plain = isinstance(node, ast.Constant | ast.Name | ast.Attribute)
        called = isinstance(node, ast.Call) and "," not in said and " if " not in said
        return said if plain or called else f"({said})"

    def _joined(self, node: ast.BinOp) -> str:
        if isinstance(node.op, ast.Add | ast.Sub):
            return self._sum(node)
        left = self._value(node.left) if self._as_tight(node.left, node) else self._inner(node.left)
        return f"{left} {_SIGNS[type(node.op)]} {self._inner(node.right)}"

    def _sum(self, node: ast.BinOp) -> str:
        """Terms from left to right, only those with commas of their own in brackets."""
        terms: list[str] = []
        rest: ast.expr = node
        while isinstance(rest, ast.BinOp) and isinstance(rest.op, ast.Add | ast.Sub):
            terms[:0] = [_SIGNS[type(rest.op)], self._term(rest.right)]
            rest = rest.left
        return " ".join([self._term(rest), *terms])

    def _term(self, node: ast.expr) -> str:
        said = self._value(node)
        product = isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult | ast.Div)
        return said if product and "," not in said else self._inner(node)

    def _as_tight(self, inner: ast.expr, outer: ast.BinOp) -> bool:
        """Whether an inner operation needs no brackets on the left of the outer one."""
        if not isinstance(inner, ast.BinOp) or "," in self._value(inner):
            return False
        return isinstance(inner.op, ast.Mult) and isinstance(outer.op, ast.Mult | ast.Div)

    def _product(self, node: ast.BinOp) -> str:
        """Factors; those that are 1 or 0 say when nothing counts."""
        factors = _factors(node)
        gates = [each for each in factors if _is_call(each, *_GATES)]
        others = [each for each in factors if each not in gates]
        rest = f" {_SIGNS[ast.Mult]} ".join(
            self._value(each) if len(others) == 1 else self._inner(each) for each in others
        )
        if not gates:
            return rest
        lost = " or ".join(self._lost(gate) for gate in gates)
        return f"{rest or '1'}, but 0 if {lost}"

    def _lost(self, gate: ast.expr) -> str:
        assert isinstance(gate, ast.Call)
        check = quoted(ast.unparse(gate.args[0]))
        function = ast.unparse(gate.func)
        if function == "gate":
            return f"a violation of {check} is critical"
        return f"{check} is violated" if function == "holds" else f"{check} is kept"

    def _chosen(self, node: ast.IfExp) -> str:
        cases, rest = [f"{self._value(node.body)} if {self._asked(node.test)}"], node.orelse
        while isinstance(rest, ast.IfExp):
            cases.append(f"{self._value(rest.body)} if {self._asked(rest.test)}")
            rest = rest.orelse
        return "; ".join([*cases, f"otherwise {self._value(rest)}"])

    def _name(self, dotted: str) -> str:
        if dotted in self.parameters:
            value, unit, _ = self.parameters[dotted]
            return f"{with_unit(value, unit)} [{in_words(dotted)}]"
        first, dot, rest = dotted.partition(".")
        if first == "cohort":
            return f"the mean of {quoted(rest)} over all teams"
        if first == "runs":
            return f"the greatest {quoted(rest)} of all runs of the team"
        return f"{quoted(rest)} of the {self.words.one(first)}" if dot else quoted(first)

    # Functions -------------------------------------------------------------------------

    def _call(self, node: ast.Call) -> str:
        function, arguments = ast.unparse(node.func), node.args
        options = {str(key.arg): self._value(key.value) for key in node.keywords}
        first = ast.unparse(arguments[0]) if arguments else ""
        if function == "charged":
            return self._charged(node, options)
        if first in self.checks:
            return self._of_check(function, first, arguments, options)
        if function == "count":
            return f"the number of {self.words.many(first)}"
        if function == "absent":
            return f"1 if there is no {self._name(first)}, else 0"
        level = self._level(arguments[0]) if len(arguments) == 1 else ""
        if level and function in _OF_ALL:
            return f"{_OF_ALL[function]} of {self._inside(arguments[0])} over all {self.words.many(level)}"
        if level and function not in _OF_ONE:
            return f"1 if {self._asked(node)}, else 0"
        return self._of_numbers(function, arguments)

    def _of_numbers(self, function: str, arguments: Sequence[ast.expr]) -> str:
        said = [self._inner(each) for each in arguments]
        if function in ("min", "max") and len(said) == 2:
            numbers = [n for n, each in enumerate(arguments) if self._is_number(each)]
            at = numbers[0] if numbers else 1
            bound = "at least" if function == "max" else "at most"
            return f"{said[1 - at]}, but {bound} {said[at]}"
        if function == "clip":
            return f"{said[0]}, but at least {said[1]} and at most {said[2]}"
        if function == "ramp":
            best, worst, hi, lo, x = said
            return f"{best} where {x} is at most {lo}, {worst} from {hi} on, in between a straight line"
        if function == "abs":
            return f"the size of {said[0]}"
        if function == "floor":
            return f"{said[0]}, rounded down"
        return f"{_OF_ALL.get(function, function)} of {', '.join(said)}"

    def _is_number(self, node: ast.expr) -> bool:
        return isinstance(node, ast.Constant) or ast.unparse(node) in self.parameters

    def _of_check(
        self, function: str, check: str, arguments: Sequence[ast.expr], options: Mapping[str, str]
    ) -> str:
        name = quoted(check)
        every = options.get("tau_s") or options.get("every_s") or "5"
        if function == "measure":
            return f"the {in_words(ast.unparse(arguments[1]))} that {name} measures"
        said = {
            "points": f"the number of times that {name} is kept",
            "count": f"the number of violations of {name}",
            "holds": f"1, but 0 if {name} is violated",
            "violated": f"1 if {name} is violated, else 0",
            "gate": f"1, but 0 if a violation of {name} is critical",
            "seconds": f"the seconds in which {name} is violated",
            "demerits": f"the demerits of {name} (1 each, 1 more for every {every} s at full depth)",
            "product": f"{options.get('p', '0.5')} for each violation of {name}, multiplied",
            "occurrences": f"the violations of {name}, each once and again for every {every} s that it lasts",
        }
        return said.get(function, f"{function} of {name}")

    def _charged(self, node: ast.Call, options: Mapping[str, str]) -> str:
        weights = ", ".join(
            f"{quoted(str(key.arg))} {self._value(key.value)}"
            for key in node.keywords
            if key.arg in self.checks
        )
        again, severity = options.get("again_after_s", "5 s"), options.get("severity", "1")
        return (
            "what violations cost, what happens at one time once (over time the most of weight times "
            f"relative depth to the power of {severity} within {again}, divided by that time: {weights})"
        )

    def _level(self, node: ast.expr) -> str:
        """The level that an aggregate is over: that of the names inside it."""
        of_levels = [
            name.value.id
            for name in ast.walk(node)
            if isinstance(name, ast.Attribute) and isinstance(name.value, ast.Name)
        ]
        known = [level for level in of_levels if level in self.words.levels]
        return min(known, key=self.words.levels.index) if known else ""

    def _inside(self, node: ast.expr) -> str:
        """What an aggregate takes of each; its names need no level."""
        said = self._inner(node)
        return said.replace(f" of the {self.words.one(self._level(node))}", "")

    # Questions -------------------------------------------------------------------------

    def _asked(self, node: ast.expr) -> str:
        if isinstance(node, ast.BoolOp):
            word = " and " if isinstance(node.op, ast.And) else " or "
            return word.join(
                f"({self._asked(each)})" if isinstance(each, ast.BoolOp) else self._asked(each)
                for each in node.values
            )
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            return f"not {self._asked(node.operand)}"
        if isinstance(node, ast.Compare):
            said = [self._inner(node.left)]
            for sign, right in zip(node.ops, node.comparators, strict=True):
                said += [_COMPARED[type(sign)], self._inner(right)]
            return " ".join(said)
        if isinstance(node, ast.Call):
            return self._asked_of(node)
        return f"{self._inner(node)} is not 0"

    def _asked_of(self, node: ast.Call) -> str:
        function, first = ast.unparse(node.func), ast.unparse(node.args[0]) if node.args else ""
        if first in self.checks:
            asked = {
                "holds": f"{quoted(first)} is kept",
                "violated": f"{quoted(first)} is violated",
                "points": f"{quoted(first)} is kept",
                "count": f"{quoted(first)} is violated",
                "gate": f"no violation of {quoted(first)} is critical",
            }
            if function in asked:
                return asked[function]
        if function == "measure" and first in self.measures:
            measure = self.measures[first].get(ast.unparse(node.args[1]))
            if measure is not None and measure.condition:
                return measure.condition
        if function == "absent":
            return f"there is no {self._name(first)}"
        if function in ("any", "all") and len(node.args) == 1 and (level := self._level(node.args[0])):
            each = "any" if function == "any" else "every"
            return f"{self._inside(node.args[0])} is not 0 for {each} {self.words.one(level)}"
        return f"{self._value(node)} is not 0"


def _factors(node: ast.expr) -> list[ast.expr]:
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        return [*_factors(node.left), *_factors(node.right)]
    return [node]


def _is_call(node: ast.expr, *functions: str) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func) in functions
