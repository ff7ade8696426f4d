"""How a score goes with the number of equal pieces of work, each with the same violations.

The elasticity of a value is how many percent it moves when the number of pieces moves by one percent: 1 for
what is added up over pieces, 0 for what is not, added in products, between the least and the greatest in
sums of what is not negative. A value that is not negative and whose elasticity is never below 0 does not fall
with the number of pieces: so x * 1 / (1 + x) keeps the law, and x * p ** x does not.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf

from ariac_score.review.proofs.grades import Grades
from ariac_score.review.proofs.quantities import DURATION, FACT, VIOLATIONS, Quantity
from ariac_score.review.proofs.tree import Each, Known, Node, Op, Taken, Term, bare, inputs_of, parts_of, text
from ariac_score.scoring.signs import Typed

__all__ = ["adds_up", "going_on_pays", "works", "worth_undone"]


@dataclass(frozen=True)
class _Scaling:
    """Elasticity between two numbers, of a value within a range; what is worth something is at least 0."""

    least: float
    most: float
    typed: Typed


class _NotKnownError(Exception):
    """What is not known, in words."""


def going_on_pays(tree: Term, undone: Mapping[str, float]) -> tuple[bool, tuple[str, ...]]:
    """Whether one more piece, equal to those before it, never lowers the score; and why, or why not.

    Args:
        tree: The score.
        undone: What the quantities of the task are where nothing is done.
    """
    earning = set(works(tree))
    if len(earning) > 1 and any(Grades().of(work).typed.least < 0 for work in earning):
        return False, ("work earns in several places, of which one may be below 0",)
    for work in earning:
        if (most := worth_undone(work, undone)) != 0:
            return False, (f"what is not done may be worth {most:g}, which violations then cost as well",)
    try:
        found = _of(tree)
    except _NotKnownError as missing:
        return False, (str(missing),)
    if found.typed.least < 0:
        return False, ("the score may fall below the 0 of no work",)
    if found.least < 0:
        return False, ("one more piece may cost more than it brings",)
    if (
        any(q.switch and q.of == VIOLATIONS for q in inputs_of(tree))
        and _without_work(tree, undone) > found.typed.least
    ):
        return False, ("what the first piece violates may cost more than it brings",)
    return True, (
        "what pieces earn and what their violations cost adds up; with their number the score grows "
        f"with an elasticity from {found.least:g} to {found.most:g}, so it never falls",
    )


def _is_work(node: Node) -> bool:
    """Whether it is what pieces of work earn, whatever is violated."""
    of = [q.of for q in inputs_of(node)]
    earns = isinstance(node, Each | Term | Op) and VIOLATIONS not in of and DURATION not in of
    return earns and bool(of) and adds_up(node)


def works(node: Node) -> Iterator[Node]:
    """What pieces of work earn, wherever a tree has it."""
    if _is_work(node):
        yield bare(node)
    else:
        for part in parts_of(node):
            yield from works(part)


def worth_undone(work: Node, undone: Mapping[str, float]) -> float:
    """What work is worth where none of it is done: farthest from 0."""
    typed = Grades(pins=undone).of(work).typed
    return max(typed.least, typed.most, key=abs)


def _without_work(tree: Term, undone: Mapping[str, float]) -> float:
    """What no work and no violations give at most."""
    none = {q.name: 0.0 for q in inputs_of(tree) if q.of == VIOLATIONS}
    return Grades(pins={**none, **undone}).of(tree).typed.most


def _of(node: Node) -> _Scaling:
    if _is_work(node):
        # The law speaks of pieces that are worth something each: what they earn adds up and is above 0.
        return _Scaling(1, 1, Typed(0, inf))
    if isinstance(node, Known):
        return _Scaling(0, 0, Typed(node.value, node.value))
    if isinstance(node, Taken):
        quantity = node.quantity
        if quantity.of == DURATION:
            return _Scaling(1, 1, Typed(0, inf))
        # Less than one more each time where pieces share a part, such as the time after a violation.
        share = 1.0 if quantity.adds and quantity.of == VIOLATIONS else 0.0
        return _Scaling(0, share, Typed(quantity.least, quantity.most))
    if isinstance(node, Term):
        return _of(node.of)
    if isinstance(node, Op):
        return _op(node)
    raise _NotKnownError(f"nothing is known of {text(node)!r} over pieces")


def adds_up(node: Node) -> bool:
    """Whether it is a sum over the outermost pieces of work, times what is the same for all of them."""
    node = node.of if isinstance(node, Term) else node
    if isinstance(node, Term):
        return adds_up(node)
    if isinstance(node, Each):
        return node.name == "sum"
    if isinstance(node, Op) and node.name == "+":
        return all(adds_up(part) for part in node.of)
    if isinstance(node, Op) and node.name in ("*", "/"):
        summed = [part for part in node.of if adds_up(part)]
        others = [part for part in node.of if part not in summed]
        kept = all(not any(q.adds for q in inputs_of(part)) for part in others)
        return len(summed) == 1 and kept and (node.name == "*" or summed[0] == node.of[0])
    return isinstance(node, Taken) and node.quantity.adds


def _op(node: Op) -> _Scaling:
    if node.name == "if":
        return _if(node)
    if node.name == "runs":
        return _of(node.of[0])
    parts = [_of(part) for part in node.of]
    typed = Grades().of(Op(node.name, tuple(_standing(one, i) for i, one in enumerate(parts)))).typed
    if all(part.least == part.most == 0 for part in parts):
        return _Scaling(0, 0, typed)
    if node.name == "+" or node.name in ("min", "max"):
        if (
            node.name == "+"
            and any(part.typed.least < 0 for part in parts)
            and any(part.typed.most > 0 for part in parts)
        ):
            raise _NotKnownError(f"{text(node)!r} takes something off, which one more piece may not bring")
        return _Scaling(min(p.least for p in parts), max(p.most for p in parts), typed)
    if node.name == "*":
        return _Scaling(sum(p.least for p in parts), sum(p.most for p in parts), typed)
    if node.name == "/":
        one, other = parts
        return _Scaling(one.least - other.most, one.most - other.least, typed)
    if node.name == "**" and parts[1].typed.is_known:
        power = parts[1].typed.least
        ends = (parts[0].least * power, parts[0].most * power)
        return _Scaling(min(ends), max(ends), typed)
    raise _NotKnownError(f"with the number of pieces {text(node)!r} may fall faster than work brings points")


def _if(node: Op) -> _Scaling:
    test = node.of[0]
    if isinstance(test, Op) and test.name in ("<", "<="):
        low, high = (_of(part) for part in test.of)
        if low.typed.most <= high.typed.least:  # such as earned >= 0
            return _of(node.of[1])
    found = _of(test)
    if found.least != 0 or found.most != 0:
        raise _NotKnownError(f"{text(test)!r} may turn with one more piece")
    body, other = _of(node.of[1]), _of(node.of[2])
    typed = Typed(min(body.typed.least, other.typed.least), max(body.typed.most, other.typed.most))
    return _Scaling(min(body.least, other.least), max(body.most, other.most), typed)


def _standing(one: _Scaling, index: int) -> Node:
    """A quantity of the range of a part, to take its range through an operation."""
    return Taken(Quantity(f"part {index}", FACT, one.typed.least, one.typed.most))
