"""A result as a notebook shows it: a few lines of HTML, everything escaped, no scripts, no styles of ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from decimal import Decimal
from html import escape

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.scoring.interval import ScoreInterval
from ariac_score.scoring.ledger import Ledger

__all__ = ["result_html"]

_MOST_ROWS = 12
_MOST_LETTERS = 200


def result_html(
    title: str,
    score: Decimal | None,
    possible: Decimal | None,
    ledger: Ledger | None,
    findings: Mapping[str, Finding],
    interval: ScoreInterval | None = None,
    unofficial: Sequence[str] = (),
) -> str:
    """HTML of a result.

    Args:
        title: Which trial, under which rules.
        score: That counts; `None` when there is none.
        possible: What could have been earned.
        ledger: The score taken apart.
        findings: By id.
        interval: Between which scores the trial lies, where its log leaves any open.
        unofficial: Why nothing official follows from it.
    """
    of = "" if possible is None else f" of {_number(possible)}"
    head = "no score" if score is None else f"{_number(score)}{of}"
    if interval is not None:
        head += f" (open: {_number(interval.least)} to {_number(interval.most)})"
    head = f"unofficial: {head}" if unofficial else head
    causes = [
        (one.cause, "not known" if one.at_most is None else _number(one.at_most))
        for one in (interval.narrowing if interval is not None else ())
    ]
    lines = ledger.children if ledger is not None else ()
    amounts = []
    for line in lines:
        amounts.append((line.label, _number(line.amount)))
        amounts += [(f"· {one.label}", _number(one.amount)) for one in line.children if one.amount]
    violated = [
        (key, finding.subject, finding.message)
        for key, finding in findings.items()
        if finding.verdict is Verdict.VIOLATED
    ]
    open_ones = [
        (key, finding.subject, finding.message)
        for key, finding in findings.items()
        if finding.verdict is Verdict.INCONCLUSIVE
    ]
    return (
        f"<div><p><b>{_text(head)}</b> · {_text(title)}</p>"
        + _table(("what would narrow it", "points, at most"), causes)
        + _table(("line", "points"), amounts)
        + _table(("violated", "subject", "what"), violated)
        + _table(("undecided", "subject", "why"), open_ones)
        + "</div>"
    )


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """A table; nothing without rows, and a last line where there are more than it shows."""
    if not rows:
        return ""
    shown = "".join(
        f"<tr>{''.join(f'<td>{_text(cell)}</td>' for cell in row)}</tr>" for row in rows[:_MOST_ROWS]
    )
    more = len(rows) - _MOST_ROWS
    rest = f'<tr><td colspan="{len(head)}">and {more} more</td></tr>' if more > 0 else ""
    names = "".join(f"<th>{name}</th>" for name in head)
    return f"<table><thead><tr>{names}</tr></thead><tbody>{shown}{rest}</tbody></table>"


def _text(words: str) -> str:
    return escape(words if len(words) <= _MOST_LETTERS else f"{words[:_MOST_LETTERS]}…")


def _number(amount: Decimal) -> str:
    text = f"{amount:f}"
    return text.rstrip("0").rstrip(".") if "." in text else text
