"""The restricted expression language of score sheets and declarative monitors.

Formulas are parsed with `ast`, every node type is whitelisted, size and depth are
bounded, and nothing is ever handed to `eval`. The same formula can be evaluated on
scalars, keeping the trace that explains the number, or on columns.
"""

from __future__ import annotations

import ast
import math
import operator
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from msgspec import Struct

from ariac_score.errors import FormulaError, did_you_mean

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = [
    "APPLIED",
    "COMPARISONS",
    "FUNCTIONS",
    "Environment",
    "Expression",
    "HasTexts",
    "Number",
    "Traced",
    "add_up",
    "arity_of",
    "known_value",
    "text_of",
]

Number = int | float
"""What a formula works with; comparisons give 1 or 0."""

_A_TEXT = "a text as a number"
_TEXTS = 'score sheets compare texts with facts that are texts, by == and != alone: object.kind == "bolt"'
_LANGUAGE = "formulas have numbers, names, + - * / **, comparisons, and/or/not, a if c else b, functions"

MAX_LENGTH = 2000
MAX_NODES = 300
MAX_DEPTH = 40
_BLOCK_ROWS = 16_384
"""Long columns are evaluated in blocks whose intermediate results stay in the cache."""

LARGEST_INTEGER = 2**53
"""Beyond this an integer would not survive JSON and float64 unchanged."""


class Traced(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """A number and how it came about.

    Attributes:
        label: The formula, or the name, that gave it.
        value: The number.
        kind: `number`, `fact`, `parameter`, `term`, `op`, `check`, `finding` or `each`.
        op: For `op` and `each` the operator, for `check` the function.
        children: The numbers it was made of, in order.
        subject: Scope or subject it belongs to; empty for the trial.
        findings: Ids of the findings it rests on directly.
        checks: For `check` the checks it is a function of, whether or not they have a share in it.
        unit: For `check` the unit of the number, where one is declared.
    """

    label: str
    value: Number
    kind: str
    op: str = ""
    children: tuple[Traced, ...] = ()
    subject: str = ""
    findings: tuple[str, ...] = ()
    checks: tuple[str, ...] = ()
    unit: str = ""


class Environment(Protocol):
    """What the names and the check functions of a formula mean."""

    def name(self, dotted: str) -> Traced:
        """The value of a name such as `order.weight`."""
        ...

    def call(
        self, function: str, arguments: Sequence[Expression], options: Mapping[str, Number]
    ) -> Traced | None:
        """The value of a function on checks or scopes; `None` when it is neither."""
        ...


class HasTexts(Environment, Protocol):
    """An environment in which some names stand for texts."""

    def text_named(self, dotted: str) -> str | None:
        """The text that a name stands for; `None` when it stands for a number."""
        ...


_BINARY: Mapping[type[ast.operator], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Add: ("+", operator.add),
    ast.Sub: ("-", operator.sub),
    ast.Mult: ("*", operator.mul),
    ast.Div: ("/", operator.truediv),
    ast.Pow: ("**", operator.pow),
}
_COMPARE: Mapping[type[ast.cmpop], tuple[str, Callable[[Any, Any], Any]]] = {
    ast.Lt: ("<", operator.lt),
    ast.LtE: ("<=", operator.le),
    ast.Gt: (">", operator.gt),
    ast.GtE: (">=", operator.ge),
    ast.Eq: ("==", operator.eq),
    ast.NotEq: ("!=", operator.ne),
}


def add_up(values: Iterable[Any]) -> Any:
    """The sum from left to right; `sum` itself rounds differently from Python 3.12 on.

    >>> add_up([0.1] * 10)
    0.9999999999999999
    """
    return reduce(operator.add, values, 0)


def _clip(value: Any, low: Any, high: Any) -> Any:
    # With low > high, high wins, as in `np.clip`.
    return min(max(value, low), high)


def _ramp(best: Any, worst: Any, hi: Any, lo: Any, x: Any) -> Any:
    # x >= hi first: with hi = lo the worst end wins, as in the ramps of official scorers.
    if x >= hi:
        return worst
    return best if x <= lo else worst + (hi - x) / (hi - lo) * (best - worst)


def _ramp_of_columns(best: Any, worst: Any, hi: Any, lo: Any, x: Any) -> Any:
    between = worst + (hi - x) / (hi - lo) * (best - worst)
    return np.where(x >= hi, worst, np.where(x <= lo, best, between))


_SCALAR_FUNCTIONS: Mapping[str, tuple[int | None, Callable[..., Any]]] = {
    "min": (None, lambda *v: min(v)),
    "max": (None, lambda *v: max(v)),
    "abs": (1, abs),
    "clip": (3, _clip),
    "ramp": (5, _ramp),
    "floor": (1, math.floor),
    "sum": (None, lambda *v: add_up(v)),
    "mean": (None, lambda *v: add_up(v) / len(v)),
    "any": (None, lambda *v: int(any(v))),
    "all": (None, lambda *v: int(all(v))),
}
COMPARISONS = _COMPARE
"""How comparisons are written and decided."""
APPLIED: Mapping[str, Callable[..., Any]] = {name: apply for name, (_, apply) in _SCALAR_FUNCTIONS.items()}
"""The functions of numbers."""
_COLUMN_FUNCTIONS: Mapping[str, tuple[int | None, Callable[..., Any]]] = {
    "min": (None, lambda *v: np.minimum.reduce(np.broadcast_arrays(*v))),
    "max": (None, lambda *v: np.maximum.reduce(np.broadcast_arrays(*v))),
    "abs": (1, abs),
    "clip": (3, np.clip),
    "ramp": (5, _ramp_of_columns),
    "floor": (1, np.floor),
    "sum": (None, lambda *v: add_up(v)),
    "mean": (None, lambda *v: add_up(v) / len(v)),
    "any": (None, lambda *v: np.logical_or.reduce(np.broadcast_arrays(*v)).astype(float)),
    "all": (None, lambda *v: np.logical_and.reduce(np.broadcast_arrays(*v)).astype(float)),
}
FUNCTIONS: Mapping[str, str] = {
    "min": "the least",
    "max": "the greatest",
    "abs": "without its sign",
    "clip": "clip(x, low, high): x within two limits",
    "ramp": "ramp(best, worst, hi, lo, x): worst from x = hi on, best up to lo, in between a straight line",
    "floor": "the greatest whole number that is not above",
    "sum": "the sum",
    "mean": "the arithmetic mean",
    "any": "1 when one is not 0, else 0",
    "all": "1 when none is 0, else 0",
}
"""The functions of numbers alone, in words."""


def arity_of(function: str) -> int | None:
    """How many numbers a function takes; `None` for one or more.

    >>> arity_of("clip"), arity_of("max")
    (3, None)
    """
    return _SCALAR_FUNCTIONS[function][0]


_STRUCTURE = (
    ast.BinOp,
    ast.UnaryOp,
    ast.BoolOp,
    ast.Compare,
    ast.IfExp,
    ast.Call,
    ast.Name,
    ast.Attribute,
    ast.Constant,
)


@dataclass(frozen=True)
class Expression:
    """A parsed formula.

    Attributes:
        source: The text, white space folded.
        where: What it belongs to, for error messages, such as `terms.order.weight`.
    """

    source: str
    where: str = ""
    _root: ast.expr = field(repr=False, compare=False, default_factory=lambda: ast.Constant(0))

    @classmethod
    def parse(cls, source: str | Number, *, where: str = "", texts: bool = False) -> Expression:
        """Parse and check a formula.

        Args:
            source: Its text.
            where: What it belongs to.
            texts: Whether texts may be compared with `==` and `!=`; in an environment that has some.

        Raises:
            FormulaError: Not a formula of this language, too long, or too deep.

        >>> Expression.parse("1 + max(a, 2)").source
        '1 + max(a, 2)'
        """
        # First, because `str` raises ValueError for an integer of more than 4300 digits.
        if isinstance(source, int) and abs(source) > LARGEST_INTEGER:
            raise FormulaError("so large a number is not allowed in a formula", place=where, hint=_LANGUAGE)
        text = _in_one_line(str(source))
        if len(text) > MAX_LENGTH:
            raise FormulaError(
                f"a formula of {len(text)} characters is longer than {MAX_LENGTH}",
                place=where,
                hint="split it into named terms",
            )
        try:
            with warnings.catch_warnings():
                # About `1if a else 2`, which all read alike, some Pythons write a line to stderr.
                warnings.simplefilter("ignore")
                root = ast.parse(text, mode="eval").body
        # The parser of CPython raises MemoryError, too, where brackets are nested too deeply.
        except (SyntaxError, ValueError, MemoryError, RecursionError) as cause:
            column = getattr(cause, "offset", None)
            at = f" at column {column}" if column else ""
            reason = getattr(cause, "msg", "") or "it is nested too deeply"
            raise FormulaError(
                f"{text[:80]!r} is not a formula{at}: {reason}",
                place=where,
                hint=_LANGUAGE,
            ) from None
        _check(root, text, where, texts)
        parsed = cls(text, where, root)
        parsed.refuse_turned_ramps({})
        return parsed

    def walk(self) -> Iterator[ast.AST]:
        """Every node, for checks at load time."""
        return ast.walk(self._root)

    @property
    def root(self) -> ast.expr:
        """The syntax tree, already whitelisted."""
        return self._root

    def part(self, node: ast.expr) -> Expression:
        """A sub-formula as a formula of its own."""
        return Expression(text_of(node), self.where, node)

    def refuse_turned_ramps(self, known: Mapping[str, Number]) -> None:
        """Refuse a `ramp` whose two ends stand in the wrong order, as far as numbers say where they are.

        Args:
            known: Numbers by name.

        Raises:
            FormulaError: `hi` is below `lo`, so that there would be no line between them, only a step.
        """
        for call in self.walk():
            if isinstance(call, ast.Call) and text_of(call.func) == "ramp" and len(call.args) == 5:
                hi, lo = (known_value(self.part(end), known) for end in call.args[2:4])
                if hi is not None and lo is not None and hi < lo:
                    raise FormulaError(
                        f"{text_of(call)}: hi is {hi:g}, which is below lo, {lo:g}",
                        place=self.where,
                        hint=f"{FUNCTIONS['ramp']}; where more is better, exchange both pairs",
                    )

    @property
    def as_name(self) -> str:
        """The dotted name, when the formula is nothing but one; else empty."""
        return _dotted(self._root) if isinstance(self._root, ast.Name | ast.Attribute) else ""

    def evaluate(self, environment: Environment) -> Traced:
        """The number, with its trace.

        Raises:
            FormulaError: Division by zero, overflow, a number that is not finite, or
                a name that means nothing here.
        """
        return _Evaluator(self, environment).visit(self._root)

    def columns(self, values: Mapping[str, NDArray[Any] | Number], *, first: int = 0) -> NDArray[Any]:
        """The formula on columns of equal length, shape (n,) in, (n,) float64 out.

        Args:
            values: Columns and numbers, by name.
            first: What the first row is called in an error, where these are some of more.

        Raises:
            FormulaError: Division by zero or a result that is not finite, with the
                first row where it happens; or an unknown name.
        """
        shape = np.broadcast_shapes(*(np.shape(column) for column in values.values()))
        if len(shape) != 1 or shape[0] <= _BLOCK_ROWS:
            result = _ColumnEvaluator(self, values, first).visit(self._root)
            return np.array(np.broadcast_to(result, shape))
        found = np.empty(shape)
        for at in range(0, shape[0], _BLOCK_ROWS):  # elementwise, so blocks give the same bits
            rows = slice(at, at + _BLOCK_ROWS)
            here = {name: column[rows] if np.ndim(column) else column for name, column in values.items()}  # type: ignore[index]  # what has a dimension is an array
            found[rows] = _ColumnEvaluator(self, here, first + at).visit(self._root)
        return found


@dataclass(frozen=True)
class _Numbers:
    """An environment of named numbers alone."""

    known: Mapping[str, Number]

    def name(self, dotted: str) -> Traced:
        if dotted not in self.known:
            raise FormulaError(f"{dotted!r} is no known number")
        return Traced(dotted, self.known[dotted], "number")

    def call(self, *_: object) -> None:
        return None


def known_value(formula: Expression, known: Mapping[str, Number]) -> Number | None:
    """What a formula is where it names nothing but these numbers; else `None`."""
    try:
        return formula.evaluate(_Numbers(known)).value
    except FormulaError:
        return None


_TEXT_OR_SPACE = re.compile(r"""("(?:[^"\\\n]|\\.)*"|'(?:[^'\\\n]|\\.)*')|\s+""")


def _in_one_line(source: str) -> str:
    """A formula with its white space folded, but for that within texts.

    YAML may break a formula into lines; `ast` takes one.
    """
    return _TEXT_OR_SPACE.sub(lambda found: found[1] or " ", source).strip()


def text_of(node: ast.AST) -> str:
    """The text of a node, written once: a formula is evaluated more often than it is read."""
    text: str | None = getattr(node, "text_once_written", None)
    if text is None:
        text = ast.unparse(node)
        vars(node)["text_once_written"] = text
    return text


def _dotted(node: ast.expr) -> str:
    if isinstance(node, ast.Attribute):
        return f"{_dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else "?"


def _check(root: ast.expr, text: str, where: str, texts: bool) -> None:
    """Let nothing through that the evaluators do not know."""
    _check_size(root, where)  # first, because showing a problem walks all of it
    compared = {id(operand) for operand in _compared_texts(root)} if texts else set()
    stack: list[ast.expr] = [root]
    while stack:
        node = stack.pop()
        if isinstance(node, ast.Constant) and id(node) in compared:
            continue
        problem = _problem(node)
        if problem:
            raise FormulaError(
                f"{problem} is not allowed in a formula: {ast.unparse(node)[:60]!r} in {text[:80]!r}",
                place=where,
                hint=_TEXTS if problem == _A_TEXT else _LANGUAGE,
            )
        stack += [child for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr)]
        if isinstance(node, ast.Call):
            stack += [keyword.value for keyword in node.keywords]


def _compared_texts(root: ast.expr) -> Iterator[ast.Constant]:
    """The texts that stand where a text may: beside `==` or `!=`."""
    for node in ast.walk(root):
        if isinstance(node, ast.Compare) and all(isinstance(op, ast.Eq | ast.NotEq) for op in node.ops):
            for operand in (node.left, *node.comparators):
                if isinstance(operand, ast.Constant) and isinstance(operand.value, str):
                    yield operand


def _check_size(root: ast.expr, where: str) -> None:
    stack: list[tuple[ast.AST, int]] = [(root, 1)]
    count = 0
    while stack:
        node, depth = stack.pop()
        deeper = int(isinstance(node, ast.expr))
        count += deeper
        if count > MAX_NODES or depth > MAX_DEPTH:
            raise FormulaError(
                f"a formula may have {MAX_NODES} parts, {MAX_DEPTH} deep",
                place=where,
                hint="split it into named terms",
            )
        stack += [(child, depth + deeper) for child in ast.iter_child_nodes(node)]


def _problem(node: ast.expr) -> str:
    if not isinstance(node, _STRUCTURE):
        return f"a {type(node).__name__}"
    if isinstance(node, ast.Constant):
        value: object = node.value
        if not isinstance(value, int | float):
            return _A_TEXT if isinstance(value, str) else f"a {type(value).__name__}"
        return "" if -LARGEST_INTEGER <= value <= LARGEST_INTEGER else "so large a number"
    if isinstance(node, ast.BinOp) and type(node.op) not in _BINARY:
        return f"operator {type(node.op).__name__}"
    if isinstance(node, ast.UnaryOp) and not isinstance(node.op, ast.USub | ast.UAdd | ast.Not):
        return f"operator {type(node.op).__name__}"
    if isinstance(node, ast.Compare) and any(type(op) not in _COMPARE for op in node.ops):
        return "this comparison"
    if isinstance(node, ast.Attribute) and not isinstance(node.value, ast.Name | ast.Attribute):
        return "an attribute of anything but a name"
    # Names such as `__class__` are the usual way out of a sandbox; no evaluator shall ever see one.
    if isinstance(node, ast.Attribute | ast.Name) and _dotted(node).startswith("_"):
        return "a name with a leading underscore"
    if isinstance(node, ast.Attribute) and node.attr.startswith("_"):
        return "a name with a leading underscore"
    if isinstance(node, ast.Call) and not isinstance(node.func, ast.Name):
        return "calling anything but a function"
    if isinstance(node, ast.Call) and any(keyword.arg is None for keyword in node.keywords):
        return "**"
    return ""


class _Evaluator:
    """Evaluates on scalars and keeps the trace."""

    def __init__(self, expression: Expression, environment: Environment) -> None:
        self.expression, self.environment = expression, environment
        self.names_of_texts: Callable[[str], str | None] | None = getattr(environment, "text_named", None)

    def error(self, cause: str, node: ast.expr, hint: str = "") -> FormulaError:
        text, whole = text_of(node), self.expression.source
        inside = f" in {whole!r}" if text != whole else ""
        return FormulaError(f"{cause}: {text!r}{inside}", place=self.expression.where, hint=hint)

    def visit(self, node: ast.expr) -> Traced:
        visitor: Callable[[Any], Traced] = getattr(self, f"visit_{type(node).__name__.lower()}")
        return visitor(node)

    def visit_constant(self, node: ast.Constant) -> Traced:
        value = node.value
        assert isinstance(value, int | float)  # _problem let nothing else through
        return Traced(text_of(node), self._checked(value, node), "number")

    def visit_name(self, node: ast.Name) -> Traced:
        return self._sound(self.environment.name(node.id), node)

    def visit_attribute(self, node: ast.Attribute) -> Traced:
        return self._sound(self.environment.name(_dotted(node)), node)

    def visit_binop(self, node: ast.BinOp) -> Traced:
        symbol, apply = _BINARY[type(node.op)]
        left, right = self.visit(node.left), self.visit(node.right)
        if symbol == "/" and right.value == 0:
            raise self.error("division by zero", node, f"guard it: … if {right.label} else 0")
        if symbol == "**":
            return self._op(symbol, node, self._power(left.value, right.value, node), left, right)
        return self._op(symbol, node, apply(left.value, right.value), left, right)

    def _power(self, base: Number, exponent: Number, node: ast.expr) -> Number:
        # As floats: whole numbers would be computed exactly, and 10**10**9 fills the memory.
        try:
            power = float(base) ** float(exponent)
        except OverflowError:
            raise self.error("overflow", node) from None
        except ZeroDivisionError:
            raise self.error("division by zero", node) from None
        if isinstance(power, complex):  # how Python answers (-8) ** 0.5
            raise self.error("root of a negative number", node)
        whole = isinstance(base, int) and isinstance(exponent, int) and power.is_integer()
        return int(power) if whole and abs(power) < LARGEST_INTEGER else power

    def visit_unaryop(self, node: ast.UnaryOp) -> Traced:
        operand = self.visit(node.operand)
        if isinstance(node.op, ast.Not):
            return self._op("not", node, int(not operand.value), operand)
        if isinstance(node.op, ast.UAdd):
            return operand
        return self._op("neg", node, -operand.value, operand)

    def visit_boolop(self, node: ast.BoolOp) -> Traced:
        stop = isinstance(node.op, ast.Or)
        # As in Python, the rest is not evaluated: `count(x) and 1 / count(x)` guards its division.
        seen: list[Traced] = []
        for operand in node.values:
            seen.append(self.visit(operand))
            if bool(seen[-1].value) is stop:
                break
        return self._op("or" if stop else "and", node, int(bool(seen[-1].value)), *seen)

    def visit_compare(self, node: ast.Compare) -> Traced:
        texts = [self._text(operand) for operand in (node.left, *node.comparators)]
        if any(text is not None for text in texts):
            return self._compare_texts(node, texts)
        operands = [self.visit(operand) for operand in (node.left, *node.comparators)]
        holds = all(
            _COMPARE[type(op)][1](a.value, b.value)
            for op, a, b in zip(node.ops, operands, operands[1:], strict=False)
        )
        return self._op(" ".join(_COMPARE[type(op)][0] for op in node.ops), node, int(holds), *operands)

    def _text(self, node: ast.expr) -> str | None:
        """The text of an operand; `None` where it is a number."""
        if isinstance(node, ast.Constant):
            return node.value if isinstance(node.value, str) else None
        names = self.names_of_texts if isinstance(node, ast.Name | ast.Attribute) else None
        return names(_dotted(node)) if names else None

    def _compare_texts(self, node: ast.Compare, texts: Sequence[str | None]) -> Traced:
        if None in texts or not all(isinstance(op, ast.Eq | ast.NotEq) for op in node.ops):
            raise self.error("a text can only be == or != to a text", node)
        holds = all(_COMPARE[type(op)][1](a, b) for op, a, b in zip(node.ops, texts, texts[1:], strict=False))
        named = [
            f"{text_of(operand)} is {text!r}"
            for operand, text in zip((node.left, *node.comparators), texts, strict=True)
            if not isinstance(operand, ast.Constant)
        ]
        # One number without operands, for a trace is made of numbers; its label says what the texts were.
        return Traced(f"{text_of(node)} ({', '.join(named)})", int(holds), "fact")

    def visit_ifexp(self, node: ast.IfExp) -> Traced:
        test = self.visit(node.test)
        chosen = self.visit(node.body if test.value else node.orelse)
        return self._op("if", node, chosen.value, test, chosen)

    def visit_call(self, node: ast.Call) -> Traced:
        assert isinstance(node.func, ast.Name)  # _problem let nothing else through
        function = node.func.id
        options = {str(k.arg): self.visit(k.value).value for k in node.keywords}
        # The environment first: `count(check)` and `sum(order.x)` share names with plain functions.
        traced = self.environment.call(function, [self.expression.part(a) for a in node.args], options)
        if traced is not None:
            return self._sound(traced, node)
        if function not in _SCALAR_FUNCTIONS:
            raise self.error(f"unknown function {function!r}", node, did_you_mean(function, FUNCTIONS))
        arity, apply = _SCALAR_FUNCTIONS[function]
        arguments = [self.visit(argument) for argument in node.args]
        if options or not arguments or (arity is not None and len(arguments) != arity):
            raise self.error(f"{function!r} takes {arity or 'one or more'} values", node)
        return self._op(function, node, apply(*(a.value for a in arguments)), *arguments)

    def _op(self, symbol: str, node: ast.expr, value: Number, *children: Traced) -> Traced:
        return Traced(text_of(node), self._checked(value, node), "op", symbol, children)

    def _sound(self, traced: Traced, node: ast.expr) -> Traced:
        self._checked(traced.value, node)
        return traced

    def _checked(self, value: Number, node: ast.expr) -> Number:
        if (isinstance(value, int) and abs(value) > LARGEST_INTEGER) or not math.isfinite(value):
            raise self.error("the result is too large to be a score", node)
        return int(value) if isinstance(value, bool) else value  # JSON would store `true`


class _ColumnEvaluator:
    """Evaluates on columns; no trace, for there would be one for each row.

    Everything is float64, as numpy adds booleans otherwise than Python does. Where a
    condition or an `and` leaves a branch out, its rows may hold anything.
    """

    def __init__(
        self, expression: Expression, values: Mapping[str, NDArray[Any] | Number], first: int = 0
    ) -> None:
        self.expression, self.values, self.first = expression, values, first
        self.rows: Any = np.True_

    def visit(self, node: ast.expr) -> Any:
        visitor: Callable[[Any], Any] = getattr(self, f"visit_{type(node).__name__.lower()}")
        return visitor(node)

    def error(self, cause: str, node: ast.expr, hint: str = "") -> FormulaError:
        return FormulaError(f"{cause}: {ast.unparse(node)!r}", place=self.expression.where, hint=hint)

    def only(self, rows: Any, node: ast.expr) -> Any:
        """A branch that counts in these rows alone."""
        outer, self.rows = self.rows, self.rows & rows
        try:
            return self.visit(node)
        finally:
            self.rows = outer

    def refuse(self, cause: str, bad: Any, node: ast.expr) -> None:
        """Raise for the first row that counts and is bad."""
        rows = np.flatnonzero(bad & self.rows)
        if len(rows):
            raise self.error(f"{cause} in row {self.first + int(rows[0])}", node)

    def finite(self, result: Any, node: ast.expr) -> Any:
        finite = np.isfinite(result)
        if not finite.all():
            self.refuse("not finite", ~finite, node)
        return result

    def visit_constant(self, node: ast.Constant) -> Any:
        assert isinstance(node.value, int | float)  # _problem let nothing else through
        return np.float64(node.value)

    def visit_name(self, node: ast.Name | ast.Attribute) -> Any:
        name = _dotted(node)
        if name not in self.values:
            raise self.error(f"unknown name {name!r}", node, did_you_mean(name, self.values))
        return self.finite(np.asarray(self.values[name], dtype=np.float64), node)

    visit_attribute = visit_name

    def visit_binop(self, node: ast.BinOp) -> Any:
        symbol, apply = _BINARY[type(node.op)]
        left, right = self.visit(node.left), self.visit(node.right)
        if symbol == "/":
            # Named before dividing: the quotient alone shows infinity, or NaN for 0 / 0.
            self.refuse("division by zero", right == 0, node)
        with np.errstate(all="ignore"):  # what goes wrong shows as a number that is not finite
            return self.finite(apply(left, right), node)

    def visit_unaryop(self, node: ast.UnaryOp) -> Any:
        operand = self.visit(node.operand)
        if isinstance(node.op, ast.Not):
            return _number(operand == 0)
        return np.negative(operand) if isinstance(node.op, ast.USub) else operand

    def visit_boolop(self, node: ast.BoolOp) -> Any:
        either = isinstance(node.op, ast.Or)
        holds = self.visit(node.values[0]) != 0
        for operand in node.values[1:]:
            further = self.only(~holds if either else holds, operand) != 0
            holds = holds | further if either else holds & further
        return _number(holds)

    def visit_compare(self, node: ast.Compare) -> Any:
        operands = [self.visit(operand) for operand in (node.left, *node.comparators)]
        holds: Any = np.True_
        for op, a, b in zip(node.ops, operands, operands[1:], strict=False):
            holds = holds & _COMPARE[type(op)][1](a, b)
        return _number(holds)

    def visit_ifexp(self, node: ast.IfExp) -> Any:
        # Both branches are computed for all rows; `only` lets each fail where it counts alone.
        test = self.visit(node.test) != 0
        return np.where(test, self.only(test, node.body), self.only(~test, node.orelse))

    def visit_call(self, node: ast.Call) -> Any:
        assert isinstance(node.func, ast.Name)  # _problem let nothing else through
        function = node.func.id
        if function not in _COLUMN_FUNCTIONS:
            raise self.error(
                f"unknown function {function!r}", node, did_you_mean(function, _COLUMN_FUNCTIONS)
            )
        arity, apply = _COLUMN_FUNCTIONS[function]
        if node.keywords or not node.args or (arity is not None and len(node.args) != arity):
            raise self.error(f"{function!r} takes {arity or 'one or more'} values", node)
        arguments = [self.visit(argument) for argument in node.args]
        with np.errstate(all="ignore"):
            return self.finite(apply(*arguments), node)


def _number(holds: Any) -> Any:
    """Truth as a formula has it: 1 or 0."""
    return np.asarray(holds, dtype=np.float64)
