"""The ledger as steps from 0 to the score: each step is a bar, and together they add up exactly."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.report.figures import rounded_points
from ariac_score.report.words import label_of, priced_check
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.expression import Traced
from ariac_score.scoring.ledger import Ledger, Line
from ariac_score.trial.spans import Span

__all__ = ["Step", "Waterfall", "waterfall_of"]

MOST_STEPS = 24
"""The ledger is opened level by level until it would have more steps than this."""

_SILENT = ("factor", "rounding", "cap", "neutral")
"""Lines that no bar shows where their amount is 0."""
_WORST_FIRST = (Verdict.VIOLATED, Verdict.INCONCLUSIVE, Verdict.SATISFIED, Verdict.NOT_APPLICABLE)


@dataclass(frozen=True)
class Step:
    """One bar.

    Attributes:
        label: Its name.
        where: The item of work it belongs to; empty for the trial.
        path: Its line in the ledger.
        amount: The points that it adds, or takes when negative.
        before: The sum of all steps before it.
        left: Where its bar begins, percent of the width.
        width: How long its bar is, percent of the width.
        findings: Ids of the findings it rests on, the worst first.
        outermost: The outermost item it belongs to; empty for the trial.
        item: The path of the item of work whose sum it is; empty where it is none.
        span: When the worst of its findings was; `None` where that has no time, or nothing was violated.
        is_invisible: Whether it is rounding too small for the digits that are shown.
        is_kept: Whether nothing that it rests on was violated, such as a run that took its time.
    """

    label: str
    where: str
    path: str
    amount: Decimal
    before: Decimal
    left: float
    width: float
    findings: tuple[str, ...]
    outermost: str = ""
    item: str = ""
    span: Span | None = None
    is_invisible: bool = False
    is_kept: bool = False

    @property
    def words(self) -> str:
        """Its label; of the points of a check, at any price, the check alone."""
        return priced_check(self.label)

    @property
    def after(self) -> Decimal:
        """The sum of all steps up to this one."""
        return self.before + self.amount


@dataclass(frozen=True)
class Waterfall:
    """The steps of a ledger; their amounts add up to it exactly.

    Attributes:
        steps: From nothing to the score.
        zero: Where zero lies, percent of the width.
        left: Where the bar of the sum begins, percent of the width.
        width: How long it is, percent of the width.
        decimals: How many digits after the point are shown, of the amounts as of their sum.
    """

    steps: tuple[Step, ...]
    zero: float
    left: float
    width: float
    decimals: int


@in_own_decimals
def waterfall_of(ledger: Ledger, findings: Mapping[str, Finding]) -> Waterfall:
    """The steps of a ledger.

    Args:
        ledger: Of the score, or of the task score.
        findings: By id; a step links only to these.
    """
    lines, decimals = _opened(ledger), _shown_decimals(ledger)
    owners = {line.path: line.subject for line in ledger.walk() if _is_of(line)}
    running = [Decimal(0)]
    for line in lines:
        running.append(running[-1] + line.amount)
    low, high = min(running), max(running)
    room = float(high - low) or 1.0
    steps = []
    for line, before in zip(lines, running, strict=False):
        start, where = min(before, before + line.amount), _where(line, owners)
        steps.append(
            Step(
                _label(line),
                where,
                line.path,
                line.amount,
                before,
                100 * float(start - low) / room,
                100 * abs(float(line.amount)) / room,
                _worst_first(line, findings),
                (line.subject or where).partition("/")[0],
                line.subject if _is_of(line) else "",
                _violated_at(line, findings),
                line.kind == "rounding" and not round(line.amount, decimals),
                _is_kept(line, findings),
            )
        )
    start = min(Decimal(0), ledger.amount)  # a negative score is a bar to the left of zero
    return Waterfall(
        tuple(steps),
        100 * float(-low) / room,
        100 * float(start - low) / room,
        100 * abs(float(ledger.amount)) / room,
        min(decimals, max(_decimals(amount) for line in lines for amount in (line.amount, *running))),
    )


def _violated_at(line: Line, findings: Mapping[str, Finding]) -> Span | None:
    spans = [findings[key].span for key in _worst_first(line, findings) if _is_violated(findings[key])]
    return spans[0] if spans else None


def _is_kept(line: Line, findings: Mapping[str, Finding]) -> bool:
    """Whether it rests on findings that violate nothing, such as a run that took longer than the best."""
    found = [findings[key] for key in _worst_first(line, findings)]
    return bool(found) and all(one.verdict is Verdict.SATISFIED for one in found)


def _is_violated(finding: Finding) -> bool:
    return finding.verdict is Verdict.VIOLATED and finding.span is not None


def _shown_decimals(ledger: Ledger) -> int:
    exponent = rounded_points(ledger.amount, digits=9).as_tuple().exponent
    return -exponent if isinstance(exponent, int) else 0


def _decimals(amount: Decimal) -> int:
    """Digits after the point, without trailing zeros."""
    return len(f"{amount:f}".partition(".")[2].rstrip("0"))


def _opened(ledger: Ledger) -> list[Line]:
    """The lines of the deepest level that has few enough of them."""
    lines: list[Line] = [ledger]
    while True:
        deeper = [child for line in lines for child in _telling(line)]
        if len(deeper) > MOST_STEPS and len(lines) > 1:
            return lines
        if deeper == lines:
            return lines
        lines = deeper


def _telling(line: Line) -> Sequence[Line]:
    """The parts of a line, without factors that change nothing; the line itself where these are findings."""
    # Single findings are links behind a step: as steps of their own they would hide what they add up to.
    # What violations took is the exception, for there each of them is the step.
    parts = [child for child in line.children if child.amount or child.kind not in _SILENT]
    if line.path.endswith("/neutral"):
        return []
    if not parts or (
        (line.kind != "sum" or not line.path.endswith("/taken"))
        and all(child.findings and not child.children for child in parts)
    ):
        return [line]
    return parts


def _label(line: Line) -> str:
    """The name of the item of work whose sum it is, else the line's own label."""
    return _own(line) if _is_of(line) else label_of(line)


def _own(line: Line) -> str:
    return line.subject.rpartition("/")[2]


def _is_of(line: Line) -> bool:
    return bool(line.subject) and line.path.endswith(f"/{_own(line)}")


def _where(line: Line, owners: Mapping[str, str]) -> str:
    """The item of work a step belongs to; a line without a subject belongs to the nearest item above it."""
    if _is_of(line):
        return line.subject.rpartition("/")[0]
    if line.subject or line.kind == "amount":
        return line.subject
    path = line.path
    while path and path not in owners:
        path = path.rpartition("/")[0]
    return owners.get(path, "")


def _worst_first(line: Line, findings: Mapping[str, Finding]) -> tuple[str, ...]:
    keys: dict[str, None] = {}
    for one in line.walk():
        keys |= dict.fromkeys(one.findings)
        keys |= dict.fromkeys(_traced(one.trace)) if one.trace else {}
    known = [key for key in keys if key in findings]
    return tuple(sorted(known, key=lambda key: _WORST_FIRST.index(findings[key].verdict)))


def _traced(traced: Traced) -> list[str]:
    return [*traced.findings, *(key for child in traced.children for key in _traced(child))]
