"""The parse result as nested lists, in the form that conformance cases are written in."""

from __future__ import annotations

from typing import Any

from ariac_score_rml.syntax import (
    All,
    Anything,
    Arg,
    Chain,
    Const,
    Empty,
    Event,
    EventType,
    Exp,
    If,
    Let,
    ListPattern,
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

__all__ = ["tree"]


def tree(spec: Spec) -> dict[str, Any]:
    """Each equation as nested lists.

    >>> from ariac_score_rml.parser import parse
    >>> tree(parse("Main = a b* \\\\/ c;"))
    {'Main': ['or', ['cat', ['event', 'a'], ['star', ['event', 'b']]], ['event', 'c']]}
    """
    found: dict[str, Any] = {}
    for equation in spec.equations:
        body = _exp(equation.body)
        found[equation.name] = ["generic", list(equation.params), body] if equation.params else body
    return found


def _exp(exp: Exp) -> list[Any]:
    if isinstance(exp, Empty):
        return ["empty"]
    if isinstance(exp, All):
        return ["all"]
    if isinstance(exp, Event):
        return ["event", *_type(exp.type)]
    if isinstance(exp, Ref):
        reference = ["ref", exp.name]
        return reference if exp.args is None else ["apply", reference, [_arg(a) for a in exp.args]]
    if isinstance(exp, Chain):
        return _chain(exp)
    if isinstance(exp, Post):
        return [exp.op, _exp(exp.body), *([exp.count] if exp.op == "times" else [])]
    if isinstance(exp, Let):
        body = _exp(exp.body)
        for name in reversed(exp.names):
            body = ["let", name, body]
        return body
    if isinstance(exp, If):
        return ["if", _arg(exp.condition), _exp(exp.then), _exp(exp.other)]
    return [
        "filter",
        _type(exp.type),
        _exp(exp.inside),
        ["all"] if exp.outside is None else _exp(exp.outside),
    ]


def _chain(exp: Chain) -> list[Any]:
    """Two and two: sequences from the right, everything else from the left."""
    parts = [_exp(part) for part in exp.parts]
    if exp.op == "cat":
        joined = parts.pop()
        while parts:
            joined = [exp.op, parts.pop(), joined]
        return joined
    joined = parts[0]
    for part in parts[1:]:
        joined = [exp.op, joined, part]
    return joined


def _type(kind: EventType) -> list[Any]:
    return [kind.name, *(_arg(arg) for arg in kind.args)]


def _arg(arg: Arg) -> Any:
    if isinstance(arg, Num | Const):
        return arg.value
    if isinstance(arg, Var | Name):
        return ["var", arg.name]
    if isinstance(arg, Op):
        return ["op", arg.op, *(_arg(a) for a in arg.args)]
    if isinstance(arg, Anything):
        return ["any"]
    if isinstance(arg, Literal_):
        return ["literal", arg.value]
    if isinstance(arg, RecordPattern):
        return ["record", {key: _arg(pattern) for key, pattern in arg.fields}]
    if isinstance(arg, ListPattern):
        return ["list", [_arg(item) for item in arg.items], arg.rest]
    assert isinstance(arg, OrPattern)
    return ["choice", [_arg(option) for option in arg.options]]
