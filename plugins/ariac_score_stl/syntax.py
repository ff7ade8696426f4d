"""The formulas of signal temporal logic: their text, their tree, and what is wrong with them.

    formula   := implies ("<->" implies)*
    implies   := or ["->" implies]
    or        := xor ("or" xor)*          xor := and ("xor" and)*          and := timed ("and" timed)*
    timed     := unary [("until" | "since") [bounds] unary]
    unary     := ("not" | "next" | "rise" | "fall") unary
               | ("always" | "eventually" | "once" | "historically") [bounds] unary
               | "(" formula ")" | "true" | "false" | predicate
    predicate := arithmetic (("<" | "<=" | ">" | ">=" | "==" | "!=") arithmetic)+
    bounds    := "[" seconds "," seconds "]"

Arithmetic is that of the expression language: numbers, names, `+ - * / **`, `min`,
`max`, `abs`, `clip`, `sum`, `mean`.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import inf
from typing import NoReturn

from ariac_score import Expression, FormulaError, did_you_mean

__all__ = [
    "FUNCTIONS",
    "FUTURE",
    "PAST",
    "STEPS",
    "Bounds",
    "Node",
    "Operator",
    "StlError",
    "is_word",
    "parse",
    "reach_s",
    "unbounded_ahead",
]

MAX_LENGTH = 4000
MAX_DEPTH = 40
MAX_NODES = 300
LONGEST_BOUND_S = 1e6
"""Longer than any trial; a bound beyond it is a slip of the pen."""

FUTURE = ("always", "eventually", "until")
PAST = ("historically", "once", "since")
STEPS = ("next", "rise", "fall")
_PREFIX = ("not", "always", "eventually", "historically", "once", *STEPS)
_WORDS = frozenset({*_PREFIX, "and", "or", "xor", "until", "since", "true", "false"})
_COMPARISONS = ("<=", ">=", "==", "!=", "<", ">")
_CONNECTIVES = ("and", "or", "xor", "->", "<->", "until", "since")
_FOREIGN: Mapping[str, str] = {
    "&": "write 'and'",
    "|": "write 'or'",
    "!": "write 'not'",
    "=": "write '=='",
    ":": "bounds are written [from,to], in seconds",
    "G": "write 'always'",
    "F": "write 'eventually'",
    "U": "write 'until'",
    "implies": "write '->'",
    "iff": "write '<->'",
    "if": "write 'a -> b'",
}
_TOKEN = re.compile(
    r"(?P<space>[ \t\r\n]+)|(?P<number>(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][-+]?[0-9]+)?)"
    r"|(?P<word>[A-Za-z_][A-Za-z0-9_]*)|(?P<sign><->|->|<=|>=|==|!=|\*\*|[-+*/()<>,\[\]])"
)


class StlError(ValueError):
    """A formula is wrong; the message says where and what to do."""


@dataclass(frozen=True)
class Bounds:
    """How far an operator looks, in s from the moment that is judged.

    Attributes:
        start_s: Nearest moment, s away.
        end_s: Farthest moment, s away.
    """

    start_s: float
    end_s: float


Operator = str
"""`predicate`, `true`, `false`, a connective or a temporal operator by its word."""


@dataclass(frozen=True, eq=False)
class Node:
    """A sub-formula.

    Attributes:
        operator: What it does.
        text: How it is written, white space folded.
        column: Where it starts in the formula, counted from 1.
        parts: Its own sub-formulas, in order.
        bounds: How far it looks; `None` without limit.
        comparison: Of a predicate: how the margin decides, `<`, `<=`, `>`, `>=`, `==` or `!=`.
        margin: Of a predicate: the difference of its two sides, positive where it holds.
        sides: Of a predicate: both sides.
    """

    operator: Operator
    text: str
    column: int
    parts: tuple[Node, ...] = ()
    bounds: Bounds | None = None
    comparison: str = ""
    margin: Expression | None = field(default=None, repr=False)
    sides: tuple[Expression, ...] = field(default=(), repr=False)

    def walk(self) -> Iterator[Node]:
        """This and every sub-formula, outermost first."""
        yield self
        for part in self.parts:
            yield from part.walk()

    @cached_property
    def names(self) -> frozenset[str]:
        """The signals and constants it uses."""
        return frozenset(inner.id for node in self.walk() for side in node.sides for inner in _names(side))


def reach_s(node: Node, *, back: bool = False, step_s: float = 0.0, unbounded_s: float = inf) -> float:
    """How far a formula looks ahead, or back, at most, in s.

    Args:
        node: The formula.
        back: Whether back in time.
        step_s: What the next or the last sample counts as.
        unbounded_s: What an operator without bounds counts as.
    """
    own = 0.0
    if node.operator in (("rise", "fall") if back else ("next",)):
        own = step_s
    elif node.operator in (PAST if back else FUTURE):
        own = unbounded_s if node.bounds is None else node.bounds.end_s
    parts = (reach_s(part, back=back, step_s=step_s, unbounded_s=unbounded_s) for part in node.parts)
    return own + max(parts, default=0.0)


def unbounded_ahead(tree: Node) -> Node | None:
    """The first sub-formula that looks ahead without a bound; `None` where none does."""
    return next((node for node in tree.walk() if node.operator in FUTURE and node.bounds is None), None)


def _names(side: Expression) -> Iterator[ast.Name]:
    called = {id(node.func) for node in side.walk() if isinstance(node, ast.Call)}
    for node in side.walk():
        if isinstance(node, ast.Name) and id(node) not in called:
            yield node


def parse(text: str, names: Collection[str] = (), *, constants: Mapping[str, float] | None = None) -> Node:
    """Read a formula.

    Args:
        text: The formula.
        names: The signals it may use.
        constants: Numbers by name, which may also stand in bounds.

    Raises:
        StlError: It is not a formula, or uses an unknown name.

    >>> parse("always[0, 2] (d > 1 -> eventually[0,0.5] v < 0.1)", ["d", "v"]).parts[0].operator
    '->'
    """
    return _Parser(text, names, constants or {}).whole()


@dataclass(frozen=True)
class _Token:
    kind: str
    text: str
    start: int
    end: int


def _tokens(text: str) -> list[_Token]:
    tokens: list[_Token] = []
    at = 0
    while at < len(text):
        match = _TOKEN.match(text, at)
        if match is None:
            character = text[at]
            raise StlError(
                f"column {at + 1}: {character!a} (U+{ord(character):04X}) means nothing in a formula; "
                + _FOREIGN.get(character, "names have letters, digits and _ of ASCII")
            )
        kind = str(match.lastgroup)
        if kind != "space":
            tokens.append(_Token(kind, match.group(), at, match.end()))
        at = match.end()
    tokens.append(_Token("end", "", len(text), len(text)))
    return tokens


class _Parser:
    """Recursive descent over the tokens.

    `(d + v) > 1` and `(d > 1)` begin alike. Instead of trying one reading and then the other, which
    takes twice as long with every bracket, the parser looks for a comparison inside the bracket first.
    """

    def __init__(self, text: str, names: Collection[str], constants: Mapping[str, float]) -> None:
        if len(text) > MAX_LENGTH:
            raise StlError(f"a formula of {len(text)} characters is longer than {MAX_LENGTH}; split it")
        self.text, self.names, self.constants = text, names, constants
        self.tokens = _tokens(text)
        self.at = self.depth = self.count = 0
        self.closing = self._closing()

    def _closing(self) -> dict[int, int]:
        """For each opening bracket the token that closes it."""
        open_: list[int] = []
        closing: dict[int, int] = {}
        for index, token in enumerate(self.tokens):
            if token.text == "(":
                open_.append(index)
            elif token.text == ")":
                if not open_:
                    self.fail("')' without '('", token)
                closing[open_.pop()] = index
        if open_:
            self.fail("'(' is never closed", self.tokens[open_[-1]])
        return closing

    def fail(self, cause: str, token: _Token | None = None, hint: str = "") -> NoReturn:
        token = token or self.token
        raise StlError(f"column {token.start + 1}: {cause}" + (f"; {hint}" if hint else ""))

    @property
    def token(self) -> _Token:
        return self.tokens[self.at]

    def take(self, *texts: str) -> _Token | None:
        """The next token, if it is one of these."""
        token = self.token
        if token.text not in texts:
            return None
        self.at += 1
        return token

    def node(self, operator: str, start: int, *parts: Node, **more: object) -> Node:
        self.count += 1
        if self.count > MAX_NODES:
            raise StlError(f"a formula may have {MAX_NODES} parts; split it")
        text = " ".join(self.text[start : self.tokens[self.at - 1].end].split())
        return Node(operator, text, start + 1, parts, **more)  # type: ignore[arg-type]

    def whole(self) -> Node:
        if self.token.kind == "end":
            raise StlError("the formula is empty")
        node = self.formula()
        if self.token.kind != "end":
            self.unexpected("an operator such as 'and', '->' or the end")
        return node

    def unexpected(self, wanted: str) -> NoReturn:
        token = self.token
        if token.kind == "end":
            self.fail(f"the formula ends where {wanted} is wanted")
        self.fail(f"{token.text!r} stands where {wanted} is wanted", token, _FOREIGN.get(token.text, ""))

    # Connectives, the loosest first ------------------------------------------------------

    def formula(self) -> Node:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            self.fail(f"a formula may be {MAX_DEPTH} deep")
        node = self.chain("<->", self.implication, single=True)
        self.depth -= 1
        return node

    def implication(self) -> Node:
        start = self.token.start
        node = self.chain("or", self.exclusive)
        if self.take("->"):
            self.depth += 1
            if self.depth > MAX_DEPTH:
                self.fail(f"a formula may be {MAX_DEPTH} deep")
            node = self.node("->", start, node, self.implication())
            self.depth -= 1
        return node

    def exclusive(self) -> Node:
        # `a xor b xor c` could mean one of the three or an odd number of them: brackets have to say.
        return self.chain("xor", lambda: self.chain("and", self.timed), single=True)

    def chain(self, word: str, tighter: Callable[[], Node], *, single: bool = False) -> Node:
        """One operator any number of times; where it could be read in two ways, once."""
        start = self.token.start
        parts = [tighter()]
        while token := self.take(word):
            if single and len(parts) > 1:
                self.fail(f"two {word!r} in a row", token, "use brackets")
            parts.append(tighter())
        return self.node(word, start, *parts) if len(parts) > 1 else parts[0]

    def timed(self) -> Node:
        start = self.token.start
        node = self.unary()
        word = self.take("until", "since")
        if word:
            bounds = self.bounds()
            node = self.node(word.text, start, node, self.unary(), bounds=bounds)
        if self.token.text in ("until", "since"):
            self.fail("two of 'until' and 'since' in a row", hint="use brackets")
        return node

    def unary(self) -> Node:
        start = self.token.start
        word = self.take(*_PREFIX)
        if word:
            self.depth += 1
            if self.depth > MAX_DEPTH:
                self.fail(f"a formula may be {MAX_DEPTH} deep", word)
            looks_at = None if word.text in ("not", *STEPS) else self.bounds()
            if self.token.text == "[":
                self.fail(f"{word.text!r} takes no bounds")
            node = self.node(word.text, start, self.unary(), bounds=looks_at)
            self.depth -= 1
            return node
        if word := self.take("true", "false"):
            return self.node(word.text, start)
        if self.token.text == "(" and self.is_formula(self.at):
            self.at += 1
            node = self.formula()
            if not self.take(")"):
                self.unexpected("')'")
            return node
        return self.predicate()

    def is_formula(self, opening: int) -> bool:
        """Whether a bracket holds a formula; arithmetic holds no comparison and no operator of ours."""
        inside = self.tokens[opening + 1 : self.closing[opening]]
        return any(t.text in _WORDS or t.text in _COMPARISONS or t.text in _CONNECTIVES for t in inside)

    # Bounds ------------------------------------------------------------------------------

    def bounds(self) -> Bounds | None:
        opening = self.take("[")
        if opening is None:
            return None
        start_s = self.seconds()
        if not self.take(","):
            self.unexpected("','")
        end_s = self.seconds()
        if not self.take("]"):
            self.unexpected("']' (bounds are two numbers, in seconds)")
        if end_s < start_s:
            self.fail(f"bounds [{start_s:g},{end_s:g}] are reversed", opening, "the smaller comes first")
        return Bounds(start_s, end_s)

    def seconds(self) -> float:
        token = self.token
        if token.text == "-":
            word = "bounds cannot be negative"
            self.fail(word, token, "'once', 'historically' and 'since' look back")
        if token.kind == "word" and token.text not in self.constants:
            self.fail(
                f"{token.text!r} is no bound",
                token,
                did_you_mean(token.text, self.constants, what="constants")
                if self.constants
                else "bounds are numbers; leave them out to mean the rest of the trial",
            )
        if token.kind not in ("number", "word"):
            self.unexpected("a number of seconds")
        value = self.constants[token.text] if token.kind == "word" else float(token.text)
        if not 0 <= value <= LONGEST_BOUND_S:
            self.fail(f"a bound of {value:g} s is not between 0 and {LONGEST_BOUND_S:g}", token)
        self.at += 1
        return value

    # Predicates --------------------------------------------------------------------------

    def predicate(self) -> Node:
        start = self.token.start
        sides = [self.arithmetic()]
        found: list[Node] = []
        while comparison := self.take(*_COMPARISONS):
            sides.append(self.arithmetic())
            left, right = sides[-2:]
            # Positive where the predicate holds, whichever way it is written: signs then decide verdicts.
            larger, smaller = (right, left) if comparison.text.startswith("<") else (left, right)
            margin = self.parsed(f"({larger.source}) - ({smaller.source})", comparison)
            node = self.node(
                "predicate", start, comparison=comparison.text, margin=margin, sides=(left, right)
            )
            found.append(node)
        if not found:
            self.unexpected("a comparison such as '<'")
        return self.node("and", start, *found) if len(found) > 1 else found[0]

    def arithmetic(self) -> Expression:
        """Everything up to what cannot be arithmetic, handed to the expression language."""
        first = self.token
        while not self.ends_arithmetic():
            last = self.closing.get(self.at, self.at)
            if last > self.at and self.is_formula(self.at):
                self.fail("a formula stands inside arithmetic")
            while self.at <= last:
                self.check_word()
                self.at += 1
        if self.token is first:
            self.unexpected("a predicate such as 'd > 1'")
        source = self.text[first.start : self.tokens[self.at - 1].end]
        expression = self.parsed(source, first)
        for node in expression.walk():
            if isinstance(node, ast.Call):
                self.check_call(node, first)
        return expression

    def ends_arithmetic(self) -> bool:
        token = self.token
        return (
            token.kind == "end"
            or token.text in (")", ",", "[", "]")
            or token.text in _WORDS
            or token.text in _COMPARISONS
            or token.text in _CONNECTIVES
        )

    def check_word(self) -> None:
        token, following = self.token, self.tokens[self.at + 1]
        known = token.text in self.names or token.text in self.constants
        if token.kind != "word" or known or (following.text == "(" and token.text not in _FOREIGN):
            return
        every = [*self.names, *self.constants]
        hint = _FOREIGN.get(token.text) or did_you_mean(token.text, every, what="signals")
        self.fail(f"unknown signal {token.text!r}", token, hint)

    def parsed(self, source: str, first: _Token) -> Expression:
        try:
            return Expression.parse(source)
        except FormulaError as error:
            self.fail(error.cause, first)

    def check_call(self, node: ast.Call, first: _Token) -> None:
        name = node.func.id if isinstance(node.func, ast.Name) else "?"
        if name not in FUNCTIONS:
            self.fail(f"unknown function {name!r}", first, did_you_mean(name, FUNCTIONS, what="functions"))
        arity = FUNCTIONS[name]
        if node.keywords or not node.args or (arity and len(node.args) != arity):
            self.fail(f"{name!r} takes {arity or 'one or more'} values", first)


FUNCTIONS: Mapping[str, int] = {"abs": 1, "clip": 3, "max": 0, "mean": 0, "min": 0, "sum": 0}
"""The functions of arithmetic and how many values each takes; 0: any number."""


def is_word(name: str) -> bool:
    """Whether a name means something in a formula already."""
    return name in _WORDS or name in _FOREIGN
