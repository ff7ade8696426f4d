"""A specification in one form: one statement a line, parentheses only where they mean something."""

from __future__ import annotations

import re

from ariac_score_rml.parser import reads_as_arguments
from ariac_score_rml.syntax import (
    All,
    Anything,
    Arg,
    Chain,
    Const,
    Declaration,
    Empty,
    Equation,
    Event,
    EventType,
    Exp,
    Filter,
    If,
    Let,
    Literal_,
    Name,
    Num,
    Op,
    OrPattern,
    Post,
    RecordPattern,
    Ref,
    Spec,
    Var,
)
from ariac_score_rml.tokens import FUNCTIONS

__all__ = ["format_rml"]

_JOIN = {"shuffle": (0, " | "), "or": (1, " \\/ "), "and": (2, " /\\ "), "cat": (3, " ")}
_POSTFIX = {"star": "*", "plus": "+", "opt": "?", "closure": "!"}
_TIGHTNESS = {
    op: i
    for i, op in enumerate(["||", "&&", "!=", "==", ">=", ">", "<=", "<", "-", "+", "/", "*", "sign", "^"])
}
_ESCAPED = {"\\": "\\\\", "'": "\\'", "\t": "\\t", "\r": "\\r", "\n": "\\n"}
_WIDTH = 100


def format_rml(spec: Spec) -> str:
    """The text of a specification; comments stay with the statement they stand before or end.

    >>> from ariac_score_rml.parser import parse
    >>> format_rml(parse("a matches{x:1,y:_}with 1>(0);Main=((a)*)\\\\/(a a);"))
    'a matches {x: 1, y: _} with 1 > 0;\\n\\nMain = a* \\\\/ a a;\\n'
    """
    lines: list[str] = []
    for declaration in spec.declarations:
        lines += [*declaration.comments, _noted(_declaration(declaration), declaration.note)]
    if spec.declarations:
        lines.append("")
    for equation in spec.equations:
        lines += [*equation.comments, _noted(_equation(equation), equation.note)]
    return "\n".join([*lines, *spec.comments_at_end]) + "\n"


def _noted(statement: str, note: str) -> str:
    return f"{statement} {note}" if note else statement


def _declaration(declaration: Declaration) -> str:
    verb = "not matches" if declaration.negated else "matches"
    if declaration.pattern is None:
        matched = " | ".join(_type(parent) for parent in declaration.parents)
    else:
        matched = _arg(declaration.pattern)
        if isinstance(declaration.pattern, Name):
            matched = f"({matched})"  # without parentheses it would be an event type
        elif isinstance(declaration.pattern, OrPattern) and _only_names(declaration.pattern):
            matched = f"({matched})"
    guard = "" if declaration.guard is None else f" with {_data(declaration.guard)}"
    return f"{_type(declaration.type)} {verb} {matched}{guard};"


def _only_names(pattern: OrPattern) -> bool:
    return all(isinstance(option, Name) for option in pattern.options)


def _equation(equation: Equation) -> str:
    params = f"<{', '.join(equation.params)}>" if equation.params else ""
    head = f"{equation.name}{params} ="
    whole = f"{head} {_exp(equation.body)};"
    if len(whole) <= _WIDTH or not isinstance(equation.body, Chain) or equation.body.op == "cat":
        return whole
    tightness, join = _JOIN[equation.body.op]
    parts = [_exp(part, tightness + 1) for part in equation.body.parts]
    return f"{head}\n    " + f"\n    {join.strip()} ".join(parts) + ";"


# Trace expressions -----------------------------------------------------------------------


def _exp(exp: Exp, loosest: int = 0) -> str:
    """The text of an expression, in parentheses where it binds looser than its place allows."""
    if isinstance(exp, Filter | If):
        # These reach as far right as they can, so anything may only stand around them in parentheses.
        return f"({_greedy(exp)})" if loosest else _greedy(exp)
    if isinstance(exp, Chain):
        tightness, join = _JOIN[exp.op]
        text = (
            _sequence(exp) if exp.op == "cat" else join.join(_exp(part, tightness + 1) for part in exp.parts)
        )
        return f"({text})" if tightness < loosest else text
    if isinstance(exp, Post):
        body = _exp(exp.body, 4)
        return f"{body}{{{exp.count}}}" if exp.op == "times" else body + _POSTFIX[exp.op]
    return _simple(exp)


def _simple(exp: Empty | All | Event | Ref | Let) -> str:
    if isinstance(exp, Event):
        return _type(exp.type)
    if isinstance(exp, Let):
        return f"{{let {', '.join(exp.names)}; {_exp(exp.body)}}}"
    if isinstance(exp, Ref):
        return exp.name if exp.args is None else f"{exp.name}<{', '.join(_in_angles(a) for a in exp.args)}>"
    return "empty" if isinstance(exp, Empty) else "all"


def _sequence(exp: Chain) -> str:
    parts = [_exp(part, 4) for part in exp.parts]
    # From the end: a part that gets parentheses here may read as the arguments of the one before it.
    for i in reversed(range(len(parts) - 1)):
        part = exp.parts[i]
        bare = isinstance(part, Event) and not part.type.args
        # What follows a bare event type in parentheses may read as its arguments.
        if bare and parts[i + 1].startswith("(") and reads_as_arguments(parts[i + 1]):
            parts[i] = f"({parts[i]})"
    return " ".join(parts)


def _greedy(exp: Filter | If) -> str:
    if isinstance(exp, If):
        return f"if ({_data(exp.condition)}) {_exp(exp.then)} else {_exp(exp.other)}"
    inside = _exp(exp.inside)
    if exp.outside is None:
        return f"{_type(exp.type)} >> {inside}"
    if _ends_open(exp.inside):
        inside = f"({inside})"
    return f"{_type(exp.type)} >> {inside} : {_exp(exp.outside)}"


def _ends_open(exp: Exp) -> bool:
    """Whether a `:` after it would belong to a filter in it."""
    while True:
        if isinstance(exp, Filter):
            if exp.outside is None:
                return True
            exp = exp.outside
        elif isinstance(exp, If):
            exp = exp.other
        else:
            return False  # inner filters of everything else stand in parentheses


def _in_angles(data: Arg) -> str:
    text = _arg(data)
    return f"({text})" if isinstance(data, Op) and data.op in _TIGHTNESS and _TIGHTNESS[data.op] < 8 else text


# Event types, patterns, values -----------------------------------------------------------


def _type(kind: EventType) -> str:
    return f"{kind.name}({', '.join(_arg(arg) for arg in kind.args)})" if kind.args else kind.name


def _arg(arg: Arg) -> str:
    if isinstance(arg, Num | Const | Var | Op):
        return _data(arg)
    if isinstance(arg, Anything):
        return "_"
    if isinstance(arg, Name):
        return arg.name
    if isinstance(arg, Literal_):
        return _literal(arg)
    if isinstance(arg, RecordPattern):
        return "{" + ", ".join(f"{_key(key)}: {_arg(inner)}" for key, inner in arg.fields) + "}"
    if isinstance(arg, OrPattern):
        options = (f"({_arg(o)})" if isinstance(o, OrPattern) else _arg(o) for o in arg.options)
        return " | ".join(options)
    items = [_arg(item) for item in arg.items]
    return "[" + ", ".join([*items, "..."] if arg.rest else items) + "]"


def _literal(literal: Literal_) -> str:
    if isinstance(literal.value, str):
        return _quoted(literal.value)
    return literal.text or {True: "true", False: "false", None: "null"}[literal.value]  # type: ignore[index]


def _quoted(text: str) -> str:
    return "'" + "".join(_ESCAPED.get(character, character) for character in text) + "'"


def _key(key: str) -> str:
    return key if _NAME.fullmatch(key) and key not in _RESERVED else _quoted(key)


_NAME = re.compile("[a-z][A-Za-z0-9_]*")
_RESERVED = frozenset(
    ["not", "matches", "with", "empty", "all", "let", "var", "if", "else", "true", "false", "null"]
) | set(FUNCTIONS)


def _data(data: Arg, loosest: int = 0) -> str:
    if isinstance(data, Num):
        # A sign takes what is tighter: a negative number before ^ needs parentheses.
        text = data.text or repr(data.value)
        return f"({text})" if text.startswith("-") and loosest > _TIGHTNESS["sign"] else text
    if isinstance(data, Const):
        return {True: "true", False: "false", None: "null"}[data.value]
    if isinstance(data, Var):
        return data.name
    assert isinstance(data, Op)
    if data.op in FUNCTIONS:
        return f"{data.op}({', '.join(_data(arg) for arg in data.args)})"
    if len(data.args) == 1:
        text, tightness = "-" + _data(data.args[0], _TIGHTNESS["^"]), _TIGHTNESS["sign"]
    else:
        tightness = _TIGHTNESS[data.op]
        text = f"{_data(data.args[0], tightness)} {data.op} {_data(data.args[1], tightness + 1)}"
    return f"({text})" if tightness < loosest else text
