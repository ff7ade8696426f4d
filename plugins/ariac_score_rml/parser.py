"""From text to syntax: a recursive descent that names the exact place where a text goes wrong.

What the reference parser repairs silently (a missing semicolon, a sign in a pattern)
is an error here: a referee does not guess what a rule was meant to be.

Why no parser generator? `lark` was tried. A name may be an event type or a pattern, and `(` may begin
arguments or a sequence, which no LALR(1) grammar can distinguish. Its Earley parser reads all reference
texts, but takes 40 times as long (4.1 s for 130 short texts instead of 0.09 s, half a minute for a
sequence of a thousand events), and its errors list the twenty terminals that would have been possible.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal, TypeVar

from ariac_score_rml.faults import RmlError
from ariac_score_rml.syntax import (
    All,
    Anything,
    Arg,
    Chain,
    Const,
    Data,
    Declaration,
    Empty,
    Equation,
    Event,
    EventType,
    Exp,
    Filter,
    If,
    Let,
    ListPattern,
    Literal_,
    Name,
    Num,
    Op,
    OrPattern,
    Pattern,
    Place,
    Post,
    RecordPattern,
    Ref,
    Spec,
    Var,
)
from ariac_score_rml.tokens import FUNCTIONS, Dialect, Token, tokenize

__all__ = ["LARGEST_INT", "MAX_DEPTH", "parse", "reads_as_arguments"]

MAX_DEPTH = 100
"""How deep parentheses, filters, patterns and operators may be nested."""

LARGEST_INT = 2**31 - 1
"""The reference compiler refuses larger integers."""

_TIGHTNESS = {
    op: i for i, op in enumerate(["||", "&&", "!=", "==", ">=", ">", "<=", "<", "-", "+", "/", "*"])
}
"""Loosest first. `*` binds tighter than `/`, `+` tighter than `-`: not the usual table."""

_POSTFIX: dict[str, Literal["star", "plus", "opt", "closure"]] = {
    "*": "star",
    "+": "plus",
    "?": "opt",
    "!": "closure",
}
_JOINS: dict[str, tuple[int, Literal["shuffle", "or", "and"]]] = {
    "|": (0, "shuffle"),
    "\\/": (1, "or"),
    "/\\": (2, "and"),
}
"""How tight each operator between expressions is, and its name."""
_BEGINS_PRIMARY = frozenset({"lower", "upper", "empty", "all", "(", "if"})

_T = TypeVar("_T")


def parse(text: str, *, dialect: Dialect = "2024", file: object = None) -> Spec:
    """Read a specification.

    Args:
        text: The specification.
        dialect: `rosmonitoring` also takes `min` and `max` as names.
        file: What to call it in messages.

    Raises:
        RmlError: With line, column and what was expected there.

    >>> parse("a matches {x:1}; Main = a*").equations
    Traceback (most recent call last):
    ...
    ariac_score_rml.faults.RmlError: line 1, column 27: ';' was expected, not the end of the text
    """
    try:
        tokens, comments = tokenize(text, dialect)
        return _Parser(tokens, comments).spec()
    except RmlError as error:
        if file is None or error.file is not None:
            raise
        raise RmlError(
            error.cause, kind=error.kind, line=error.line, column=error.column, file=file, hint=error.hint
        ) from None


def reads_as_arguments(text: str) -> bool:
    """Whether a text beginning with `(` would be taken for the arguments of the name before it."""
    tokens, _ = tokenize(text)
    parser = _Parser(tokens, [])
    return parser.attempt(parser.arguments) is not None


class _Parser:
    def __init__(self, tokens: list[Token], comments: list[Token]) -> None:
        self.tokens, self.comments, self.at = tokens, comments, 0
        self.depth = 0
        self.depths: dict[int, int] = {}
        self.kept: list[object] = []  # their ids are keys of `depths`
        self.furthest: RmlError | None = None
        self.furthest_at = -1

    # Words ---------------------------------------------------------------------------

    @property
    def next(self) -> Token:
        return self.tokens[self.at]

    def peek(self, ahead: int = 1) -> str:
        return self.tokens[min(self.at + ahead, len(self.tokens) - 1)].kind

    def take(self, kind: str, what: str = "") -> Token:
        if self.next.kind != kind:
            raise self.expected(what or repr(kind))
        self.at += 1
        return self.tokens[self.at - 1]

    def taken(self, kind: str) -> bool:
        if self.next.kind != kind:
            return False
        self.at += 1
        return True

    def expected(self, what: str) -> RmlError:
        place = self.next.place
        error = RmlError(
            f"{what} was expected, not {self.next}",
            line=place.line,
            column=place.column,
            hint=self._hint(what),
        )
        # The attempt that got furthest knows best what was wrong: an error of a shorter one is about a
        # reading that nobody meant.
        if self.at > self.furthest_at:
            self.furthest, self.furthest_at = error, self.at
        return error

    def _hint(self, what: str) -> str:
        if self.next.kind == "string" and what == "a value":
            return "guards compare numbers alone; a text is compared by the pattern, as in {name: 'abc'}"
        if self.next.kind == ">=":
            return "'>=' is one token: put a space before '='"
        if self.next.kind in ("min", "max"):
            return "a function's name; the older dialect of ROSMonitoring allows it as a name"
        if self.next.kind == "upper":
            return "keys and event types begin with a small letter; other keys stand in quotes"
        return ""

    def attempt(self, rule: Callable[[], _T]) -> _T | None:
        """What a rule reads, or `None` and nothing read; only nesting that is too deep is final."""
        at, depth = self.at, self.depth
        try:
            return rule()
        except RmlError as error:
            if error.kind == "too_deep":
                raise
            self.at, self.depth = at, depth
            return None

    def refuse(self, kind: str, cause: str, place: Place, hint: str = "") -> RmlError:
        return RmlError(cause, kind=kind, line=place.line, column=place.column, hint=hint)

    # Nesting -------------------------------------------------------------------------

    def enter(self) -> None:
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self._too_deep(self.next.place)

    def leave(self, node: _T) -> _T:
        self.depth -= 1
        return node

    def built(self, node: _T, *children: object) -> _T:
        """Note how deep a node is: a chain of operators nests without any parenthesis."""
        depth = 1 + max((self.depths.get(id(child), 0) for child in children), default=0)
        if depth > MAX_DEPTH:
            raise self._too_deep(self.next.place)
        self.depths[id(node)] = depth
        self.kept.append(node)
        return node

    def _too_deep(self, place: Place) -> RmlError:
        return self.refuse(
            "too_deep",
            f"nested deeper than {MAX_DEPTH} levels",
            place,
            "name the inner part in an equation or event type of its own",
        )

    # Statements ----------------------------------------------------------------------

    def spec(self) -> Spec:
        declarations: list[Declaration] = []
        equations: list[Equation] = []
        while self.next.kind == "lower":
            comments = self._comments_before()
            declaration = self.declaration()
            declarations.append(
                replace(declaration, comments=(*comments, *self._inside()), note=self._note())
            )
        while self.next.kind == "upper" or not equations:
            comments = self._comments_before()
            equation = self.equation()
            equations.append(replace(equation, comments=(*comments, *self._inside()), note=self._note()))
        if self.next.kind == "lower":
            raise self.expected("an equation (type declarations come before all equations)")
        if self.next.kind != "end":
            raise self.expected("an equation")
        return Spec(tuple(declarations), tuple(equations), tuple(c.text for c in self.comments))

    def _comments_before(self) -> tuple[str, ...]:
        return self._take_comments(self.next.place)

    def _inside(self) -> tuple[str, ...]:
        """Comments within the statement just read."""
        return self._take_comments(self.tokens[self.at - 1].place)

    def _take_comments(self, before: Place) -> tuple[str, ...]:
        count = 0
        while count < len(self.comments) and _key(self.comments[count].place) < _key(before):
            count += 1
        taken, self.comments = self.comments[:count], self.comments[count:]
        return tuple(comment.text for comment in taken)

    def _note(self) -> str:
        """The comment that ends the line of the statement just read."""
        if not self.comments or self.comments[0].place.line != self.tokens[self.at - 1].place.line:
            return ""
        if _key(self.next.place) < _key(self.comments[0].place):
            return ""
        return self.comments.pop(0).text

    def declaration(self) -> Declaration:
        name = self.take("lower", "an event type")
        args = self.arguments() if self.next.kind == "(" else ()
        declared = EventType(name.text, args, name.place)
        for arg in declared.args:
            if not isinstance(arg, Var):
                raise self.refuse(
                    "declared_parameter_not_a_name",
                    f"the parameters of event type {declared.name!r} must be names where it is declared",
                    declared.place,
                )
        negated = self.taken("not")
        self.take("matches", "'matches'")
        parents = self.attempt(self._parents)
        pattern = None if parents else self.pattern()
        if parents is None:
            parents = ()
        for parent in parents:
            if any(isinstance(arg, OrPattern) for arg in parent.args):
                raise self.refuse(
                    "or_pattern_as_argument",
                    f"an argument of {parent.name!r} is a pattern with '|'",
                    parent.place,
                    "declare an event type for each alternative",
                )
        guard = self.data() if self.taken("with") else None
        self.take(";")
        return Declaration(declared, negated, parents, pattern, guard)

    def _parents(self) -> tuple[EventType, ...]:
        parents = [self.event_type()]
        while self.taken("|"):
            parents.append(self.event_type())
        if self.next.kind not in ("with", ";"):
            raise self.expected("'with' or ';'")
        return tuple(parents)

    def equation(self) -> Equation:
        name = self.take("upper", "an equation")
        params: list[str] = []
        if self.taken("<"):
            params.append(self.take("lower", "a parameter").text)
            while self.taken(","):
                params.append(self.take("lower", "a parameter").text)
            self.take(">")
        self.take("=")
        body = self.exp()
        if self.next.kind != ";" and self.furthest is not None and self.furthest_at > self.at:
            raise self.furthest
        self.take(";", "';'")
        return Equation(name.text, tuple(params), body, name.place)

    # Event types and patterns --------------------------------------------------------

    def event_type(self) -> EventType:
        name = self.take("lower", "an event type")
        # `pick (place)` is one event type with an argument, `pick (place stop)` a sequence: arguments first.
        args = self.attempt(self.arguments) if self.next.kind == "(" else ()
        if args is None:
            args = ()
        return EventType(name.text, args, name.place)

    def arguments(self) -> tuple[Arg, ...]:
        self.take("(")
        args = [self.argument()]
        while self.taken(","):
            args.append(self.argument())
        self.take(")")
        return tuple(args)

    def argument(self) -> Arg:
        def ended(rule: Callable[[], _T]) -> Callable[[], _T]:
            def read() -> _T:
                found = rule()
                if self.next.kind not in (",", ")"):
                    raise self.expected("',' or ')'")
                return found

            return read

        data = self.attempt(ended(self.data))
        return ended(self.pattern)() if data is None else data

    def pattern(self) -> Pattern:
        self.enter()
        options = [self._single_pattern()]
        while self.taken("|"):
            options.append(self._single_pattern())
        return self.leave(options[0] if len(options) == 1 else OrPattern(tuple(options)))

    def _single_pattern(self) -> Pattern:
        token = self.next
        if token.kind == "(":
            self.at += 1
            inner = self.pattern()
            self.take(")")
            return inner
        if token.kind == "{":
            return self._record()
        if token.kind == "[":
            return self._list()
        if token.kind in ("int", "float"):
            number = self._number()
            return Literal_(number.value, number.text)
        if token.kind not in ("string", "true", "false", "null", "lower", "_"):
            raise self.expected("a pattern")
        self.at += 1
        if token.kind == "string":
            return Literal_(token.text)
        if token.kind == "lower":
            return Name(token.text)
        return Anything() if token.kind == "_" else Literal_(_CONSTANTS[token.kind])

    def _record(self) -> Pattern:
        self.take("{")
        fields: list[tuple[str, Pattern]] = []
        if not self.taken("}"):
            fields.append(self._field())
            while self.taken(","):
                fields.append(self._field())
            self.take("}", "',' or '}'")
        return RecordPattern(tuple(fields))

    def _field(self) -> tuple[str, Pattern]:
        if self.next.kind not in ("lower", "string"):
            raise self.expected("a key")
        key = self.next.text
        self.at += 1
        self.take(":")
        return key, self.pattern()

    def _list(self) -> Pattern:
        self.take("[")
        items: list[Pattern] = []
        rest = False
        if self.taken("]"):
            return ListPattern((), rest=False)
        if self.taken("..."):
            self.take("]")
            return ListPattern((), rest=True)
        items.append(self.pattern())
        while self.taken(","):
            if self.taken("..."):
                rest = True
                break
            items.append(self.pattern())
        self.take("]", "',' or ']'")
        return ListPattern(tuple(items), rest)

    # Trace expressions ---------------------------------------------------------------

    def exp(self) -> Exp:
        self.enter()
        return self.leave(self._joined(0))

    def _joined(self, loosest: int) -> Exp:
        left = self._sequence()
        while self.next.kind in _JOINS and _JOINS[self.next.kind][0] >= loosest:
            symbol = self.next.kind
            tightness, op = _JOINS[symbol]
            parts = [left]
            while self.taken(symbol):
                parts.append(self._joined(tightness + 1))
            left = self.built(Chain(op, tuple(parts)), *parts)
        return left

    def _sequence(self) -> Exp:
        parts = [self._postfixed()]
        while self.next.kind in _BEGINS_PRIMARY or (self.next.kind == "{" and self.peek() == "let"):
            parts.append(self._postfixed())
        return parts[0] if len(parts) == 1 else self.built(Chain("cat", tuple(parts)), *parts)

    def _postfixed(self) -> Exp:
        body = self._primary()
        while True:
            if self.next.kind in _POSTFIX:
                op = _POSTFIX[self.next.kind]
                self.at += 1
                body = self.built(Post(op, body), body)
            elif self.next.kind == "{" and self.peek() != "let":
                body = self.built(Post("times", body, self._count()), body)
            else:
                return body

    def _count(self) -> int:
        brace = self.take("{")
        count = self.data()
        self.take("}")
        if not isinstance(count, Num) or not isinstance(count.value, int) or count.value < 0:
            raise self.refuse(
                "repetition_count_not_int_literal",
                "the count of a repetition must be a whole number, written out",
                brace.place,
            )
        return count.value

    def _primary(self) -> Exp:
        token = self.next
        if token.kind == "lower":
            return self._event()
        if token.kind == "upper":
            return self._reference()
        if token.kind == "if":
            return self._if()
        if token.kind == "{" and self.peek() == "let":
            return self._let()
        if token.kind not in ("(", "empty", "all"):
            raise self.expected("an expression")
        self.at += 1
        if token.kind == "empty":
            return Empty()
        if token.kind == "all":
            return All()
        inner = self.exp()
        if self.next.kind != ")" and self.furthest is not None and self.furthest_at > self.at:
            raise self.furthest
        self.take(")", "an operator or ')'")
        return inner

    def _event(self) -> Exp:
        kind = self.event_type()
        if not self.taken(">>"):
            return Event(kind)
        inside = self.exp()
        outside = self.exp() if self.taken(":") else None
        return self.built(Filter(kind, inside, outside), inside, outside)

    def _reference(self) -> Exp:
        name = self.take("upper")
        if not self.taken("<"):
            return Ref(name.text, None, name.place)
        args = [self.data(closing=True)]
        while self.taken(","):
            args.append(self.data(closing=True))
        self.take(">", "an operator, ',' or '>'")
        return Ref(name.text, tuple(args), name.place)

    def _if(self) -> Exp:
        self.take("if")
        self.take("(")
        condition = self.data()
        self.take(")", "an operator or ')'")
        then = self.exp()
        self.take("else", "an operator or 'else'")
        other = self.exp()
        return self.built(If(condition, then, other), then, other)

    def _let(self) -> Exp:
        self.take("{")
        self.take("let")
        names = [self.take("lower", "a name").text]
        while self.taken(","):
            names.append(self.take("lower", "a name").text)
        self.take(";", "',' or ';'")
        body = self.exp()
        self.take("}", "an operator or '}'")
        # Each name is a level of its own.
        for _ in names[1:]:
            self.built(body, body)
        return self.built(Let(tuple(names), body), body)

    # Data expressions ----------------------------------------------------------------

    def data(self, *, closing: bool = False) -> Data:
        """An expression over values; `closing`: within `<…>`, where `>` may be the end."""
        return self._binary(0, closing)

    def _binary(self, loosest: int, closing: bool) -> Data:
        self.enter()
        left = self._power()
        while _TIGHTNESS.get(self.next.kind, -1) >= loosest:
            operator, at = self.next, self.at
            tighter = _TIGHTNESS[operator.kind] + 1
            self.at += 1
            if operator.kind == ">" and closing:
                right = self.attempt(partial(self._before_closing, tighter))
                if right is None:
                    self.at = at
                    break
            else:
                right = self._binary(tighter, closing)
            left = self.built(Op(operator.kind, (left, right), operator.place), left, right)
        return self.leave(left)

    def _before_closing(self, level: int) -> Data:
        right = self._binary(level, True)
        if self.next.kind not in (">", ","):
            raise self.expected("',' or '>'")
        return right

    def _power(self) -> Data:
        left = self._signed()
        while self.next.kind == "^":
            place = self.take("^").place
            right = self._signed()
            left = self.built(Op("^", (left, right), place), left, right)
        return left

    def _signed(self) -> Data:
        """An operand of `^`; a sign takes what is tighter than itself, so `-v^2` is -(v^2)."""
        if self.next.kind != "-":
            return self._operand()
        place = self.take("-").place
        self.enter()
        value = self.leave(self._power())
        if isinstance(value, Num) and value.text[:1] != "-":
            return Num(-value.value, f"-{value.text}")
        return self.built(Op("-", (value,), place), value)

    def _operand(self) -> Data:
        token = self.next
        if token.kind in ("int", "float"):
            return self._number()
        if token.kind in _CONSTANTS:
            self.at += 1
            return Const(_CONSTANTS[token.kind])
        if token.kind == "(":
            self.at += 1
            inner = self.data()
            self.take(")", "an operator or ')'")
            return self.built(replace(inner, grouped=True), inner) if isinstance(inner, Op) else inner
        if token.text in FUNCTIONS and token.kind != "string" and self.peek() == "(":
            return self._call()
        if token.kind == "lower":
            self.at += 1
            return Var(token.text, token.place)
        raise self.expected("a value")

    def _call(self) -> Data:
        token = self.next
        self.at += 2
        args = [self.data()]
        for _ in range(FUNCTIONS[token.text] - 1):
            self.take(",")
            args.append(self.data())
        self.take(")", "an operator or ')'")
        return self.built(Op(token.text, tuple(args), token.place), *args)

    def _number(self) -> Num:
        token = self.next
        self.at += 1
        if token.kind == "float":
            return Num(float(token.text), token.text)
        if len(token.text.lstrip("0")) > 10 or int(token.text) > LARGEST_INT:
            raise self.refuse(
                "number_out_of_range",
                f"the number {token.text[:20]} is larger than {LARGEST_INT}",
                token.place,
                "write it with a decimal point",
            )
        return Num(int(token.text), token.text)


_CONSTANTS: dict[str, bool | None] = {"true": True, "false": False, "null": None}


def _key(place: Place) -> tuple[int, int]:
    return place.line, place.column
