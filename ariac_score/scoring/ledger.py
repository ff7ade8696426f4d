"""The ledger: the score taken apart into amounts that add up to it, exactly.

The trace of a score says how the number came about; the ledger says how much each
piece brought. A sum is taken apart into its summands. A product or quotient becomes
the factor that carries the points, followed by what each other factor changed:
`9 points, weight 3: +18`. Amounts are decimal numbers, so that they add up to the
score exactly; what rounding moves is a line of its own, and small by construction.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Annotated, Any

from msgspec import Meta, Struct
from msgspec.structs import force_setattr, replace

from ariac_score.checks.findings import COUNT, POINTS, canonical
from ariac_score.errors import FormulaError, ResultError
from ariac_score.scoring.expression import LARGEST_INTEGER, Number, Traced
from ariac_score.trial.frames import frame

__all__ = ["Ledger", "Line", "make_ledger", "reconcile", "rounded"]

_OF_FINDINGS = frozenset({"points", "count", "measure"})
"""The functions whose value is the sum of a number for each finding."""
_CARRY = frozenset({POINTS, COUNT})
"""The units that points are made of; times, lengths, costs and factors act on them."""
_ROUNDING = "rounding"


class Line(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """One amount of the ledger, itself the sum of the lines below it.

    Attributes:
        path: Where it stands, such as `score/task/order_0/completion`.
        label: The term or formula it comes from, or what happened.
        kind: `sum` (children add up to it), `amount`, `factor` (what a factor did)
            or `rounding`.
        amount: What it brings to the score, in points.
        value: The number the term or formula gave, before any factor around it.
        children: The lines it is the sum of; for others, none.
        trace: For `amount` and `factor`: how the number came about.
        findings: Ids of the findings it rests on directly.
        subject: Scope or subject it belongs to; empty for the trial.
    """

    path: str
    label: str
    kind: Annotated[str, Meta(pattern="^(sum|amount|factor|rounding)$")]
    amount: Decimal
    value: Number
    children: tuple[Line, ...] = ()
    trace: Traced | None = None
    findings: tuple[str, ...] = ()
    subject: str = ""

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
            "findings": [" ".join(line.findings) for line in lines],
        }
        return frame(columns, index="path", units={"amount": POINTS})

    @property
    def leaves(self) -> Iterator[Line]:
        """The lines that are not sums of others."""
        return (line for line in self.walk() if not line.children)


Ledger = Line
"""The root line; its amount is the score."""


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


def make_ledger(score: Traced, *, digits: int, root: str = "score") -> Ledger:
    """Take a traced score apart.

    Args:
        score: What `ScoreSheet.evaluate` returned.
        digits: Decimal digits of the score and of every amount.
        root: Path of the root line.
    """
    return _Maker(digits).line(score, root, score.value)


class _Maker:
    def __init__(self, digits: int) -> None:
        self.digits = digits

    def line(self, traced: Traced, path: str, value: Number) -> Line:
        """The line of a traced number that stands in the ledger with its own value."""
        inner = self._content(traced)
        parts = self._parts(inner, path)
        plain = Line(path, traced.label, "amount", rounded(value, self.digits), value, subject=traced.subject)
        if parts is None:
            return replace(plain, trace=_kept(inner), findings=inner.findings or ())
        difference = plain.amount - sum((part.amount for part in parts), Decimal(0))
        if difference:
            parts = [*parts, Line(f"{path}/{_ROUNDING}", _ROUNDING, _ROUNDING, difference, float(difference))]
        return replace(plain, kind="sum", children=tuple(parts), findings=inner.findings or ())

    def _content(self, traced: Traced) -> Traced:
        """The number behind a named term or a chosen branch, so that the ledger has no empty levels."""
        while True:
            if traced.kind == "term" or (traced.kind == "each" and traced.op == "value"):
                traced = traced.children[0]
            elif traced.kind == "op" and traced.op == "if" and _carries(traced.children[1]):
                traced = traced.children[1]
            else:
                return traced

    def _parts(self, traced: Traced, path: str) -> list[Line] | None:
        """The lines a number is the sum of; `None` when it is one amount."""
        if traced.kind == "check" and traced.op in _OF_FINDINGS:
            return self._numbered(traced.children, path)
        if traced.kind == "each" and traced.op in ("sum", "mean"):
            lines = self._numbered(traced.children, path)
            return [*lines, *self._adjusted(lines, traced, path)] if traced.op == "mean" else lines
        if traced.kind != "op":
            return None
        if traced.op in ("+", "sum"):
            return self._numbered(self._summands(traced), path)
        if traced.op == "-" and _carries(traced.children[0]):
            left, right = traced.children
            first = self._numbered([left], path)
            taken = Line(
                f"{path}/less_{_slug(right)}",
                f"less {right.label}",
                "factor",
                -rounded(right.value, self.digits),
                right.value,
                trace=_kept(right),
                findings=_findings(right) or (),
            )
            return [*first, taken]
        return self._factored(traced, path)

    def _summands(self, traced: Traced) -> Sequence[Traced]:
        """What a sum is the sum of; anything else is its own only summand."""
        if traced.op == "sum" and traced.kind in ("op", "each"):
            return traced.children
        if traced.kind == "op" and traced.op == "+":
            return [*self._summands(traced.children[0]), traced.children[1]]
        return [traced]

    def _factored(self, traced: Traced, path: str) -> list[Line] | None:
        """`points * factors / divisors` as the points, then what each factor did to them."""
        chain = _chain(traced)
        carriers = [i for i, (symbol, part) in enumerate(chain) if symbol == "*" and _carries(part)]
        if len(carriers) > 1:  # what is added up over orders or parts is the points, the rest are factors
            carriers = [i for i in carriers if _adds_up(chain[i][1])]
        if len(carriers) != 1 or len(chain) == 1:  # one link is no product, and taking it apart would not end
            return None
        _, base = chain.pop(carriers[0])
        lines = self._numbered(self._summands(base), path)
        running: Number = base.value
        for symbol, part in chain:
            after = running * part.value if symbol == "*" else running / part.value
            words = "times" if symbol == "*" else "divided by"
            lines.append(
                Line(
                    f"{path}/{_slug(part)}",
                    f"{words} {part.label} = {part.value:.6g}",
                    "factor",
                    rounded(after, self.digits) - rounded(running, self.digits),
                    part.value,
                    trace=_kept(part),
                    findings=_findings(part) or (),
                )
            )
            running = after
        return lines

    def _numbered(self, parts: Sequence[Traced], path: str) -> list[Line]:
        """A line for each part, with paths that differ."""
        lines: list[Line] = []
        taken: set[str] = set()
        for part in parts:
            slug = _slug(part)
            name, number = slug, 2
            while name in taken:
                name, number = f"{slug}_{number}", number + 1
            taken.add(name)
            lines.append(self.line(part, f"{path}/{name}", part.value))
        return lines

    def _adjusted(self, lines: Sequence[Line], traced: Traced, path: str) -> list[Line]:
        """The line that makes a mean of a sum."""
        total = sum((line.amount for line in lines), Decimal(0))
        amount = rounded(traced.value, self.digits) - total
        label = f"mean of {len(lines)}"
        return [Line(f"{path}/mean", label, "factor", amount, len(lines), trace=_kept(traced))]


def _kept(traced: Traced) -> Traced:
    """A trace as it will be stored: numbers with their digits, and only what explains them.

    Which checks and units decided how the ledger is cut is not kept: results of before had neither, and
    pricing again must give the same lines.
    """
    value = traced.value if isinstance(traced.value, int) else canonical(traced.value)
    # `or ()`: a default is found by identity, and before Python 3.11 empty tuples are not all the same.
    children = tuple(_kept(child) for child in traced.children) or ()
    return replace(traced, value=value, children=children, findings=traced.findings or (), checks=(), unit="")


def _chain(traced: Traced) -> list[tuple[str, Traced]]:
    """The factors and divisors of a chain of products, left to right."""
    if traced.kind == "op" and traced.op in ("*", "/"):
        left, right = traced.children
        # A divisor stays one link: a / (b * c) is one division, as it is written.
        return [*_chain(left), (traced.op, right)] if traced.op == "/" else [*_chain(left), *_chain(right)]
    return [("*", traced)]


def _adds_up(traced: Traced) -> bool:
    """Whether a number is, or contains, something added up over scopes."""
    return (traced.kind == "each" and traced.op in ("sum", "mean")) or any(map(_adds_up, traced.children))


def _carries(traced: Traced) -> bool:
    """Whether points, rather than factors and gates, make up this number."""
    if traced.kind == "check":
        return traced.unit in _CARRY
    if traced.kind == "each" and traced.op in ("sum", "mean"):
        return True
    if traced.kind == "op" and traced.op in (
        "if",
        "+",
        "-",
        "*",
        "/",
        "neg",
        "sum",
        "mean",
        "max",
        "min",
        "clip",
    ):
        # The condition of an `if` chooses; whatever is counted in it, it brings no points.
        return any(
            _carries(child) for child in (traced.children[1:] if traced.op == "if" else traced.children)
        )
    return traced.kind in ("term", "each") and any(_carries(child) for child in traced.children)


def _findings(traced: Traced) -> tuple[str, ...]:
    """Every finding a number rests on, once, in order of appearance."""
    found = [*traced.findings, *(key for child in traced.children for key in _findings(child))]
    return tuple(dict.fromkeys(found))


def _slug(traced: Traced) -> str:
    """A short name for a line: the scope's last id, the check, or the formula."""
    if traced.kind in ("each", "finding") and traced.subject:
        return traced.subject.rpartition("/")[2]
    kept = "".join(c if c.isalnum() or c in "_.-" else " " for c in traced.label)
    return "_".join(kept.split())[:60] or "value"


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
        # A line is off by half a unit at most; a factor, being a difference, by a whole one.
        rounding = sum((abs(c.amount) for c in line.children if c.kind == _ROUNDING), Decimal(0))
        if rounding > unit * (len(line.children) + 1):
            raise ResultError(f"rounding cannot move {rounding}", place=line.path, hint=_FORGED)


_FORGED = "the result was edited or damaged: score the trial again"
