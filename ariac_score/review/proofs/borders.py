"""Exact borders of laws that exclude each other: up to where one holds, and from where on the other.

No score can make every violation cost and going on never pay less, for pieces of work of any size. So a
piece pays from a certain size on, which is stated here; and no price is both above 0 for the slightest
violation and without a step, so the step is.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

from ariac_score.errors import FormulaError
from ariac_score.review.laws.cases import Case, Violation, World
from ariac_score.review.proofs.elasticity import works
from ariac_score.review.proofs.grades import Grades
from ariac_score.review.proofs.quantities import VIOLATIONS
from ariac_score.review.proofs.solver import Solver, score_with
from ariac_score.review.proofs.subject import Subject
from ariac_score.review.proofs.tree import Node, Op, Term, bare, inputs_of, parts_of
from ariac_score.scoring.signs import Sign

__all__ = ["borders"]


def borders(subject: Subject, solver: Solver | None) -> tuple[str, ...]:
    """What the slightest violation of each check costs, and which further piece of work pays."""
    return (*_least_prices(subject), *(_going_on(subject, solver) if solver else ()))


def _least_prices(subject: Subject) -> Iterator[str]:
    world = subject.world
    case = _earning_case(world)
    if case is None:
        return
    for check in world.safety:
        length = 0 if check in world.events else 1
        hardly = replace(case, violations=(Violation(check, 0, 0, length, 0.1),))
        clean, violated = world.score(case), world.score(hardly)
        if clean and violated is not None:
            share = 100 * (1 - violated / clean)
            yield f"one sample of {check}, hardly violated, takes {share:.3g} % of a piece"


def _earning_case(world: World) -> Case | None:
    """One piece of work that earns something: what rules measure is 1 in it, or else 0."""
    names = [f"{check}.{name}" for check, measured in world.measured.items() for name in measured]
    for value in (1.0, 0.0):
        case = Case(((1,),), numbers=dict.fromkeys(names, value))
        with suppress(FormulaError):  # it has no value for these numbers
            if (world.score(case) or 0) > 0:
                return case
    return None


def _going_on(subject: Subject, solver: Solver) -> Iterator[str]:
    """Which of two known borders the score has, proven both ways by the solver."""
    work, demerits = list(dict.fromkeys(works(subject.tree))), _demerits(subject.tree)
    if len(work) != 1 or demerits is None:
        return
    z3 = solver.z3
    e, earned, d, total = (z3.Real(name) for name in ("e", "E", "d", "D"))
    gates = {q.name: 0.0 for q in subject.quantities.values() if q.of == VIOLATIONS and q.switch}
    before = score_with(solver, subject, {work[0]: earned, demerits: total}, gates)
    after = score_with(solver, subject, {work[0]: earned + e, demerits: total + d}, gates)
    given = [earned > 0, e >= 0, d >= 0, total >= 0]
    price = Grades(pins=gates).of(subject.tree).steep
    candidates: list[tuple[str, Any]] = [("e/E >= d/(1+D)", e * (1 + total) >= earned * d)]
    candidates += [
        (f"e >= {k:g} * d" if k != 1 else "e >= d", e >= repr(k) * d)
        for k in sorted(set(price.values()))
        if 0 < k < 1e9
    ]
    for words, pays in candidates:
        if solver.ask([*given, (after >= before) != pays], words).proves:
            yield (
                f"going on pays iff {words}: a piece that brings e points and d demerits, after E points "
                "and D demerits (proven by the solver)"
            )
            return


def _demerits(node: Node) -> Node | None:
    """The outermost term that is what all violations cost, but for gates, and grows with each."""
    own = [q for q in inputs_of(node) if not (q.of == VIOLATIONS and q.switch)]
    if isinstance(node, Term) or (isinstance(node, Op) and node.name == "runs"):
        grade = Grades().of(node)
        costs = bool(own) and all(q.of == VIOLATIONS and grade.sign(q.name) is Sign.UP for q in own)
        if costs and grade.typed.least == 0:
            return bare(node)
    found = [one for part in parts_of(node) if (one := _demerits(part)) is not None]
    return found[0] if found and all(one == found[0] for one in found) else None
