"""The ledger: the score taken apart into amounts that add up to it, exactly.

First what was earned, along the sums of the formulas; then what was taken, by violation; then what changed
nothing, and why. Amounts come from the slopes of `attribution`. They are decimal numbers, rounded once, so
that they add up to the score exactly; what rounding moves is a line of its own, and small by construction.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import ROUND_HALF_EVEN, Decimal
from fractions import Fraction
from math import prod
from typing import Annotated, Any, NamedTuple

from msgspec import Meta, Struct
from msgspec.structs import force_setattr, replace

from ariac_score.checks.findings import POINTS, Finding, Verdict, canonical
from ariac_score.errors import FormulaError, ResultError
from ariac_score.scoring.attribution import (
    Choice,
    Extreme,
    Function,
    Given,
    Leaf,
    Named,
    Node,
    Product,
    Sum,
    flow,
    priced,
)
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.expression import LARGEST_INTEGER, Number, Traced
from ariac_score.scoring.shares import Exact, exactly
from ariac_score.scoring.worlds import EARNED, KEPT, NOTHING, TAKEN
from ariac_score.trial.frames import frame

__all__ = ["Ledger", "Line", "make_ledger", "reconcile", "rounded", "taken_by"]

_ROUNDING = "rounding"
_LOST = "digits that the formula lost"
"""Amounts are exact and the score is computed in float64, which of a small difference knows few digits."""
_MOST_LINES = 20_000
"""Beyond so many lines what is left is told in one line each: terms that name each other may be endless."""


class Line(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """One amount of the ledger, itself the sum of the lines below it.

    Attributes:
        path: Where it stands, such as `score/task/order_0/completion`.
        label: The term or formula it comes from, or what happened.
        kind: `sum` (children add up to it), `amount`, `taken` (by a violation), `factor` (what comparing
            with other teams did; in ledgers of the former method any factor), `cap` (a cap or floor, in
            the rule's price alone), `neutral` (findings that changed nothing) or `rounding`.
        amount: What it brings to the score, in points.
        value: The number the term or formula gave, before any factor around it.
        children: The lines it is the sum of; for others, none.
        trace: For `amount` and `factor`: how the number came about.
        findings: Ids of the findings it rests on directly.
        subject: Scope or subject it belongs to; empty for the trial.
        nominal: The rule's price, as if no cap or floor held, where that is another amount.
        reason: Why the amount is 0, where it could have been another.
    """

    path: str
    label: str
    kind: Annotated[str, Meta(pattern="^(sum|amount|taken|factor|cap|neutral|rounding)$")]
    amount: Decimal
    value: Number
    children: tuple[Line, ...] = ()
    trace: Traced | None = None
    findings: tuple[str, ...] = ()
    subject: str = ""
    nominal: Decimal | None = None
    reason: str = ""

    def __post_init__(self) -> None:
        if isinstance(self.value, float):
            force_setattr(self, "value", canonical(self.value))

    def walk(self) -> Iterator[Line]:
        """This line and all below it, top down."""
        yield self
        for child in self.children:
            yield from child.walk()

    def to_frame(self) -> Any:
        """The lines as a `pandas.DataFrame`, top down; amounts as floats, sums and what they are of alike.

        Raises:
            UsageError: pandas is not installed.
        """
        lines = list(self.walk())
        columns = {
            "path": [line.path for line in lines],
            "label": [line.label for line in lines],
            "kind": [line.kind for line in lines],
            "amount": [float(line.amount) for line in lines],
            "subject": [line.subject for line in lines],
            "nominal": [float(line.amount if line.nominal is None else line.nominal) for line in lines],
            "reason": [line.reason for line in lines],
            "findings": [" ".join(line.findings) for line in lines],
        }
        return frame(columns, index="path", units={"amount": POINTS, "nominal": POINTS})

    @property
    def leaves(self) -> Iterator[Line]:
        """The lines that are not sums of others."""
        return (line for line in self.walk() if not line.children)


Ledger = Line
"""The root line; its amount is the score."""


def taken_by(ledger: Ledger | None) -> dict[str, Line]:
    """The line of each finding that took something; a ledger of the former method has none."""
    lines = ledger.walk() if ledger is not None else ()
    return {line.findings[0]: line for line in lines if line.kind == "taken" and len(line.findings) == 1}


@in_own_decimals
def rounded(value: Number, digits: int) -> Decimal:
    """The nearest decimal number with so many digits, halves to even; never a negative zero.

    >>> rounded(2.0000005, 6), rounded(-0.0, 2)
    (Decimal('2.000000'), Decimal('0.00'))

    Raises:
        FormulaError: So large that float64 no longer knows its whole points.
    """
    if abs(value) > LARGEST_INTEGER:
        raise FormulaError("the result is too large to be a score", hint="check the weights of the formulas")
    # `repr`, so that the decimal a person reads is rounded and not the binary number nearest to it.
    number = Decimal(repr(float(value))) if isinstance(value, float) else Decimal(value)
    # + 0 makes a zero positive that rounding left negative.
    return number.quantize(Decimal(1).scaleb(-digits), rounding=ROUND_HALF_EVEN) + Decimal(0)


@in_own_decimals
def make_ledger(
    tree: Node,
    score: Traced,
    findings: Mapping[str, Finding],
    *,
    digits: int,
    root: str = "score",
    undecided: Collection[str] = (),
) -> Ledger:
    """Take a score apart: what was earned, what was taken, and what changed nothing.

    Args:
        tree: The score in three worlds (`worlds.tree_of`).
        score: What `ScoreSheet.evaluate` returned.
        findings: By id, undecided ones settled.
        digits: Decimal digits of the score and of every amount.
        root: Path of the root line.
        undecided: Ids of the findings that were settled by a policy.
    """
    amount = rounded(score.value, digits)
    try:
        pieces = _Pieces(tree, findings, frozenset(undecided)).whole(score, digits)
        return _printed(pieces, root, amount, digits)
    except OverflowError:
        raise _too_large(score.label) from None


def _too_large(label: str) -> FormulaError:
    return FormulaError(
        f"what {label!r} brought or took is too large to be told: more than {LARGEST_INTEGER} points",
        hint="check the weights of the formulas, and what they divide by",
    )


@dataclass
class _Piece:
    """A line before it is rounded; what its children do not add up to is rounding."""

    label: str
    amount: Exact = 0
    nominal: Exact = 0
    kind: str = "amount"
    children: list[_Piece] = field(default_factory=list)
    findings: tuple[str, ...] = ()
    subject: str = ""
    value: Number = 0
    reason: str = ""
    trace: Traced | None = None
    slug: str = ""
    plain: bool = False
    """Whether it is nothing but the number of its line, which then needs no line below it."""


class _Rate(NamedTuple):
    """What a unit brings to the score: in effect, and by the rule's price, as if there were no caps."""

    effective: Exact
    nominal: Exact

    def times(self, by: Exact) -> _Rate:
        return _Rate(self.effective * by, self.nominal * by)


_NONE = _Rate(0, 0)


class _Pieces:
    """The lines of one tree."""

    def __init__(self, tree: Node, findings: Mapping[str, Finding], undecided: frozenset[str]) -> None:
        self.tree, self.findings, self.undecided = tree, findings, undecided
        self.room = _MOST_LINES
        self.caps: dict[Extreme, Exact] = {}
        self.told: set[str] = set()
        self.priced = priced(tree)

    def whole(self, score: Traced, digits: int) -> _Piece:
        """The root: what was earned, what was taken, which bounds held, what changed nothing."""
        earned = self._with_children("earned", "earned", self._content(self.tree, _Rate(1, 1), _Rate(1, 1)))
        taken = self._taken()
        children = [earned, *([taken] if taken.children else []), *self._bounds()]
        neutral = self._neutral()
        if neutral.children:
            children.append(neutral)
        amount = exactly(score.value)
        lost = amount - self.tree.exact[-1]
        if (
            2 * abs(Fraction(lost)) * 10**digits > 1
        ):  # where nearly equal numbers are subtracted, and divided by
            children.append(_Piece(_LOST, lost, lost, value=float(lost), slug="lost"))
        return _Piece(
            score.label, amount, amount, "sum", children, value=score.value, trace=_outline(score.children[0])
        )

    # What was earned -------------------------------------------------------------------

    def _content(self, node: Node, earning: _Rate, given: _Rate) -> list[_Piece]:
        """The lines that a node consists of.

        Args:
            node: Any.
            earning: What each unit of its change, from nothing to what was earned, brings.
            given: What each unit of its value brings with nothing done.
        """
        if isinstance(node, Named):
            return self._content(node.children[0], earning, given)
        if (
            isinstance(node, Sum)
            and not node.constant
            and not all(isinstance(n, Given) for n in node.children)
        ):
            made = (self._summand(by, n, earning.times(by), given.times(by)) for by, n in node.terms)
            return [piece for piece in made if piece is not None]
        if isinstance(node, Product):
            return self._product(node, earning, given)
        if isinstance(node, Choice):
            return self._choice(node, earning, given)
        if isinstance(node, Extreme):
            return self._extreme(node, earning, given)
        if isinstance(node, Leaf):
            return self._leaf(node, earning, given)
        return [*self._base(node, given), *self._moved(node, earning)]

    def _summand(self, by: Exact, node: Node, earning: _Rate, given: _Rate) -> _Piece | None:
        """The line of one summand; `None` where it neither is nor becomes anything."""
        if not node.moves[EARNED] and not (given.nominal and node.exact[NOTHING]):
            return None
        label = node.label
        subject = node.subject if isinstance(node, Named) else ""
        self.room -= 1
        if self.room < 0:
            amount = given.effective * node.exact[NOTHING] + earning.effective * node.change(EARNED)
            content = [_Piece(label, amount, amount, findings=tuple(_asked(node)), plain=True)]
        else:
            content = self._content(node, earning, given)
        slug = subject.rpartition("/")[2] if isinstance(node, Named) and node.scope else label
        piece = self._with_children(label, slug, content, subject=subject, value=node.numbers[-1])
        if by < 0:  # what a formula subtracts, for no violation, stands among what was earned
            piece.label = f"less {label}"
        if len(content) == 1 and content[0].plain:
            (only,) = content
            piece.children, piece.findings, piece.kind = only.children, only.findings, only.kind
            piece.subject, piece.reason = piece.subject or only.subject, only.reason
        elif not content:
            return None
        inner = _unnamed(node)
        if isinstance(inner, Product | Choice | Extreme | Function):
            piece.trace = _stated(node)
        return piece

    def _with_children(
        self, label: str, slug: str, children: list[_Piece], *, subject: str = "", value: Number = 0
    ) -> _Piece:
        amount = sum((piece.amount for piece in children), start=0)
        nominal = sum((piece.nominal for piece in children), start=0)
        return _Piece(label, amount, nominal, "sum", children, subject=subject, value=value, slug=slug)

    def _base(self, node: Node, given: _Rate, findings: tuple[str, ...] = ()) -> list[_Piece]:
        """What a node is with nothing done."""
        value = node.exact[NOTHING]
        if not given.nominal * value and not given.effective * value:
            return []
        amounts = given.times(value)
        self.told.update(findings)
        return [_Piece(node.label, *amounts, findings=findings, value=node.numbers[NOTHING], plain=True)]

    def _moved(self, node: Node, earning: _Rate) -> list[_Piece]:
        """What each part of a node brought to its change; nothing is told of it with nothing done."""
        pieces: list[_Piece] = []
        for child, by in node.slopes(EARNED):
            inner = self._content(child, earning.times(by), _NONE)
            pieces.append(self._with_children(child.label, "", inner, subject=_subject(child)))
            if len(inner) == 1:
                pieces[-1] = inner[0]
        return pieces

    def _product(self, node: Product, earning: _Rate, given: _Rate) -> list[_Piece]:
        moving = [n for n in node.factors if n.moves[EARNED]]
        slopes = dict(node.slopes(EARNED)) if moving else {}
        if len(moving) > 1:
            pieces = self._base(node, given)
            for factor in moving:
                inner = self._content(factor, earning.times(slopes[factor]), _NONE)
                named = node.named[factor]
                pieces.append(self._with_children(named.label, "", inner, subject=_subject(named)))
            return [*pieces, *self._against(node, earning)]
        carrier = moving[0] if moving else self._carrier(node)
        if carrier is None or node.factors[carrier] != 1:
            inner = (
                self._content(carrier, earning.times(slopes[carrier]), _NONE) if moving and carrier else []
            )
            return [*self._base(node, given), *inner]
        others = prod(node.factor(n, NOTHING) for n in node.factors if n is not carrier)
        inner = self._content(carrier, earning.times(slopes.get(carrier, 0)), given.times(others))
        return [*inner, *self._against(node, earning)]

    def _carrier(self, node: Product) -> Node | None:
        """The one factor that adds up things with names, such as orders, where nothing was earned."""
        sums = [n for n, power in node.factors.items() if power == 1 and isinstance(_unnamed(n), Sum)]
        named = [n for n in sums if any(isinstance(child, Named) for child in _unnamed(n).children)]
        return named[0] if len(named) == 1 else None

    def _against(self, node: Product, earning: _Rate) -> list[_Piece]:
        """What comparing with other teams brought."""
        if not node.measured_against:
            return []
        amounts = earning.times(node.against())
        names: dict[str, str] = {}
        for n in node.measured_against:
            name, power = node.named[n], node.factors[n]
            names[name.label] = " / " if name is n and power < 0 else " * "
        value = float(prod(node.factor(n, KEPT) for n in node.measured_against))
        findings = tuple(key for n in node.measured_against for key in _asked(n))
        self.told.update(findings)
        times = "".join(f"{by}{name}" for name, by in sorted(names.items(), key=lambda each: each[1]))
        times = times.removeprefix(" * ") if times.startswith(" * ") else f"1{times}"
        label = f"times {times} = {value:.6g}"
        slug = "_".join(names)
        return [_Piece(label, *amounts, "factor", findings=findings, value=value, slug=slug)]

    def _choice(self, node: Choice, earning: _Rate, given: _Rate) -> list[_Piece]:
        before, after = node.branch(NOTHING), node.branch(KEPT)
        if before is after:
            return self._content(after, earning, given)
        condition = node.children[0]
        turned = dict(node.slopes(EARNED)).get(condition, 0)
        pieces = self._base(before, given)
        if turned:
            pieces += self._content(condition, earning.times(turned), _NONE)
        return [*pieces, *self._content(after, earning, _NONE)]

    def _extreme(self, node: Extreme, earning: _Rate, given: _Rate) -> list[_Piece]:
        bounded, slopes = node.bounded, dict(node.slopes(EARNED))
        chosen = node.in_force(NOTHING)
        if bounded is None:
            pieces = self._content(chosen, earning.times(slopes.get(chosen, 0)), given)
            for other in (n for n in slopes if n is not chosen):
                inner = self._content(other, earning.times(slopes[other]), _NONE)
                pieces.append(self._with_children(other.label, "", inner, subject=_subject(other)))
            return pieces
        known = node in self.priced
        rate = earning.times(slopes.get(bounded, 0))
        own = given if chosen is bounded else _NONE
        if known:
            # By the rule's price the bound is not there; what it took back is a line of its own.
            back = given.nominal * (node.exact[NOTHING] - bounded.exact[NOTHING])
            back += earning.nominal * (node.change(EARNED) - bounded.change(EARNED))
            self.caps[node] = self.caps.get(node, 0) + back
            rate, own = _Rate(rate.effective, earning.nominal), _Rate(own.effective, given.nominal)
        pieces = self._content(bounded, rate, own)
        if chosen is not bounded:
            pieces += self._base(chosen, _Rate(given.effective, 0 if known else given.nominal))
        return pieces

    def _leaf(self, node: Leaf, earning: _Rate, given: _Rate) -> list[_Piece]:
        if not node.moves[EARNED]:
            measured = node.function == "measure" and not any(node.moves)
            return self._base(node, given, node.asked if measured else ())
        pieces = self._base(node, given)
        by = {part.key: part.by[EARNED] for part in node.parts}
        for key in node.asked or by:
            finding = self.findings.get(key)
            if finding is None:
                pieces.append(_Piece(node.label, *earning.times(by[key]), plain=True))
            elif key in by or (node.function == "points" and finding.verdict is Verdict.VIOLATED):
                self.told.add(key)
                pieces.append(self._of(key, finding, earning.times(by.get(key, 0)), "amount"))
                pieces[-1].slug = finding.subject.rpartition("/")[2]
                pieces[-1].reason = "" if key in by else _WHY[Verdict.VIOLATED]
        if len(pieces) == 1:
            pieces[0].plain = True
        return pieces

    def _of(self, key: str, finding: Finding, amounts: _Rate, kind: str) -> _Piece:
        label = f"{finding.message} (undecided)" if key in self.undecided else finding.message
        piece = _Piece(label, *amounts, kind, findings=(key,), subject=finding.subject, slug=key)
        piece.value = float(amounts.effective)
        return piece

    # What was taken --------------------------------------------------------------------

    def _taken(self) -> _Piece:
        effective = flow(self.tree, TAKEN)
        nominal = flow(self.tree, TAKEN, without=self.priced) if self.priced else effective
        self.hidden = effective.hidden
        for node, back in nominal.bounds.items():
            self.caps[node] = self.caps.get(node, 0) + back
        self.amounts: dict[str, _Rate] = {}
        labels: dict[str, str] = {}
        hidden: dict[str, str] = {}
        for leaf in (node for node in _nodes(self.tree) if isinstance(node, Leaf)):
            for part in leaf.parts:
                if by := part.by[TAKEN]:
                    before = self.amounts.get(part.key, _NONE)
                    self.amounts[part.key] = _Rate(
                        before.effective + effective.slopes.get(leaf, 0) * by,
                        before.nominal + nominal.slopes.get(leaf, 0) * by,
                    )
                    labels.setdefault(part.key, leaf.label)
                    if leaf in effective.hidden:
                        hidden.setdefault(part.key, effective.hidden[leaf])
        groups: dict[str, list[_Piece]] = {}
        for key, amounts in self.amounts.items():
            finding = self.findings.get(key)
            if finding is None:
                groups[key] = [_Piece(labels[key], *amounts, "taken", slug=key)]
            elif any(amounts):
                piece = self._of(key, finding, amounts, "taken")
                piece.reason = "" if amounts.effective else hidden.get(key, _CANCELLED)
                groups.setdefault(finding.check, []).append(piece)
                self.told.add(key)
        pieces = []
        for check, made in groups.items():
            if len(made) > 1:
                made.sort(key=lambda piece: _natural(piece.slug))
                group = self._with_children(check, check, made)
                group.kind = "taken"
                pieces.append(group)
            else:
                pieces += made
        return self._with_children("taken", "taken", pieces)

    def _bounds(self) -> list[_Piece]:
        return [
            _Piece(
                f"{'cap' if node.sign > 0 else 'floor'}: {node.label}",
                0,
                back,
                "cap",
                value=float(node.numbers[-1]),
                reason="in the rule's price",
                slug=node.label,
            )
            for node, back in self.caps.items()
            if back
        ]

    # What changed nothing --------------------------------------------------------------

    def _neutral(self) -> _Piece:
        """The findings that formulas asked about and that changed nothing, by check and reason."""
        groups: dict[tuple[str, str], list[str]] = {}
        leaves = [node for node in _nodes(self.tree) if isinstance(node, Leaf)]
        asked: dict[str, list[Leaf]] = {}
        for leaf in leaves:
            for key in leaf.asked:
                asked.setdefault(key, []).append(leaf)
        for key, of in asked.items():
            if key not in self.told:
                groups.setdefault((self.findings[key].check, self._reason(key, of)), []).append(key)
        pieces = []
        for (check, reason), keys in groups.items():
            keys.sort(key=_natural)
            hidden = sum((self.amounts.get(key, _NONE).nominal for key in keys), start=0)
            pieces.append(
                _Piece(check, 0, hidden, "neutral", findings=tuple(keys), reason=reason, slug=check)
            )
        return self._with_children("changed nothing", "neutral", pieces)

    def _reason(self, key: str, leaves: Sequence[Leaf]) -> str:
        changing = [leaf for leaf in leaves if any(p.key == key and any(p.by) for p in leaf.parts)]
        if changing:
            return next((why for leaf in changing if (why := self.hidden.get(leaf))), _CANCELLED)
        finding = self.findings[key]
        if key in self.undecided:
            return "undecided: left out"
        if finding.verdict is Verdict.VIOLATED and not all(leaf.function == "points" for leaf in leaves):
            functions = {leaf.function for leaf in leaves}
            return next((_NOTHING[name] for name in _NOTHING if name in functions), _UNMEASURED)
        if any(leaf.function == "measure" and not leaf.parts for leaf in leaves):
            return _UNMEASURED
        return _WHY[finding.verdict]


_WHY = {
    Verdict.SATISFIED: "kept",
    Verdict.VIOLATED: "it earned nothing",
    Verdict.INCONCLUSIVE: "undecided",
    Verdict.NOT_APPLICABLE: "not applicable",
}
_NOTHING = {"gate": "violated, but not critical", "charged": "a heavier violation covers it"}
_UNMEASURED = "measured: at its best, or its check declares no best value to compare it with"
_CANCELLED = "what it brought and what it took cancel out"


def _subject(node: Node) -> str:
    return node.subject if isinstance(node, Named) else ""


def _is_given(node: Node) -> bool:
    """Whether it is worked out of given numbers alone, such as the time that was left."""
    return all(isinstance(child, Given) for child in node.children)


def _unnamed(node: Node) -> Node:
    """The formula behind a name."""
    while isinstance(node, Named):
        node = node.children[0]
    return node


def _nodes(root: Node) -> list[Node]:
    """Every node once, in the order of the formulas."""
    seen: dict[Node, None] = {}
    stack = [root]
    while stack:
        node = stack.pop()
        if node not in seen:
            seen[node] = None
            stack += reversed(node.children)
    return list(seen)


def _asked(node: Node) -> list[str]:
    return list(dict.fromkeys(key for leaf in _nodes(node) if isinstance(leaf, Leaf) for key in leaf.asked))


def _natural(key: str) -> tuple[str, int]:
    """Findings in the order of their numbers: `x#2` before `x#10`."""
    name, _, number = key.rpartition("#")
    return name, int(number) if number.isdecimal() else 0


def _stated(node: Node) -> Traced | None:
    """The numbers that a line was made of, one level deep."""
    inner = _unnamed(node)
    children = []
    for child in inner.children:
        if not isinstance(child, Given) or child.of_trial or child.of_cohort:
            value = child.numbers[-1]
            if isinstance(value, int | float):
                children.append(Traced(child.label, _settled(value), "term"))
    value = node.numbers[-1]
    return Traced(inner.label, _settled(value), "op", children=tuple(children))


def _outline(traced: Traced) -> Traced:
    """How a number came about, down to the functions on checks and the sums over scopes."""
    stop = traced.kind in ("check", "each")
    children = () if stop else tuple(_outline(child) for child in traced.children)
    # `or ()`: a default is found by identity, and before Python 3.11 empty tuples are not all the same.
    return replace(
        traced,
        value=_settled(traced.value),
        children=children or (),
        findings=(),
        checks=(),
        unit="",
    )


def _settled(value: Number) -> Number:
    return value if isinstance(value, int) else canonical(value)


def _slug(text: str) -> str:
    kept = "".join(c if c.isalnum() or c in "_.-#" else " " for c in text)
    return "_".join(kept.split())[:60] or "value"


def _printed(piece: _Piece, path: str, amount: Decimal, digits: int) -> Line:
    """A line and those below it, each rounded once; what that leaves is a line of its own."""
    if abs(amount) > LARGEST_INTEGER:
        raise _too_large(piece.label)
    children: list[Line] = []
    taken: set[str] = set()
    for inner in piece.children:
        slug = name = _slug(inner.slug or inner.label)
        number = 2
        while name in taken:
            name, number = f"{slug}_{number}", number + 1
        taken.add(name)
        children.append(_printed(inner, f"{path}/{name}", _rounded(inner.amount, digits), digits))
    difference = amount - sum((child.amount for child in children), Decimal(0))
    if children and difference:
        children.append(Line(f"{path}/{_ROUNDING}", _ROUNDING, _ROUNDING, difference, float(difference)))
    nominal = _rounded(piece.nominal, digits)
    return Line(
        path,
        piece.label,
        "amount" if piece.kind == "sum" and not children else piece.kind,
        amount,
        piece.value,
        tuple(children) or (),
        piece.trace,
        piece.findings or (),
        piece.subject,
        None if nominal == amount else nominal,
        piece.reason,
    )


def _rounded(value: Exact, digits: int) -> Decimal:
    """An exact number with so many digits, halves to even."""
    return Decimal(round(value * 10**digits)).scaleb(-digits)


@in_own_decimals
def reconcile(ledger: Ledger, score: Decimal, *, digits: int) -> None:
    """Check that a ledger explains its score, exactly.

    Every sum is the sum of its lines, the root is the score, amounts have no more
    digits than declared, and no rounding line moves more than rounding can.

    Raises:
        ResultError: Naming the first line that does not add up.
    """
    unit = Decimal(1).scaleb(-digits)
    for line in ledger.walk():  # first, because numbers that are none cannot be added up
        if not line.amount.is_finite() or abs(line.amount) > LARGEST_INTEGER:
            raise ResultError(f"amount {line.amount} is no score", place=line.path, hint=_FORGED)
    if ledger.amount != score:
        raise ResultError(
            f"the ledger adds up to {ledger.amount}, the score is {score}", place=ledger.path, hint=_FORGED
        )
    for line in ledger.walk():
        if line.amount != line.amount.quantize(unit):
            raise ResultError(
                f"amount {line.amount} has more than {digits} decimals", place=line.path, hint=_FORGED
            )
        if line.children:
            total = sum((child.amount for child in line.children), Decimal(0))
            if total != line.amount:
                raise ResultError(
                    f"its lines add up to {total}, not {line.amount}", place=line.path, hint=_FORGED
                )
        # A line is off by half a unit at most, in ledgers of the former method by a whole one; and a score
        # is computed in float64, which of large numbers no longer knows so many digits.
        rounding = sum((abs(c.amount) for c in line.children if c.kind == _ROUNDING), Decimal(0))
        if rounding > unit * (len(line.children) + 1) + abs(line.amount) * _FLOAT64:
            raise ResultError(f"rounding cannot move {rounding}", place=line.path, hint=_FORGED)


_FLOAT64 = Decimal(2) ** -48
_FORGED = "the result was edited or damaged: score the trial again"
