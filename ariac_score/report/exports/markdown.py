"""Markdown: a summary for a pull request, an issue or the summary of a CI job.

Source: CommonMark 0.31 (a backslash before punctuation makes it plain), GitHub's tables.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator

from ariac_score.checks.findings import Verdict
from ariac_score.report.exports.facts import (
    checks,
    cost,
    cut,
    final_findings,
    headline,
    remarks,
    told,
    told_findings,
    unrecorded,
    when,
    why_unofficial,
)
from ariac_score.report.openness import would_narrow
from ariac_score.report.summary import summary_of
from ariac_score.report.text import amount_text
from ariac_score.report.words import capital, words_of
from ariac_score.results.result import Result
from ariac_score.scoring.ledger import Line

__all__ = ["markdown_text"]

# `@`, `#` and `:` are no Markdown of CommonMark, but on GitHub mention people, issues and emojis.
_SPECIAL = frozenset("\\`*_[]<>|&~@:#!$")
_MOST = 100
"""Rows of a table; GitHub refuses a summary of more than 1 MiB."""


def markdown_text(result: Result) -> str:
    """A result as Markdown, with a newline at its end."""
    measured = result.measured
    who = f"{escaped(measured.team)}, " if measured.team else ""
    trial = escaped(capital(words_of(result).one("trial")))
    sections = [
        [f"## {escaped(headline(result))}"],
        [
            f"{trial} {who}{escaped(measured.trial)} under {escaped(result.provenance.rule_set.id)}: "
            f"{escaped(result.rule_set_title)}"
        ],
        [f"**{escaped(text)}**" for text in why_unofficial(result)],
        [escaped(summary_of(result))],
        list(_narrowing(result)),
        list(_adjustments(result)),
        list(_ledger(result)),
        list(_found(result, Verdict.VIOLATED, "What was violated")),
        list(_found(result, Verdict.INCONCLUSIVE, "What could not be judged")),
        list(_checks(result)),
        list(_origin(result)),
    ]
    return "\n\n".join("\n".join(lines) for lines in sections if lines) + "\n"


def escaped(text: str) -> str:
    """Text that is shown as it is: no markup, no links, no mentions, no cells of its own.

    >>> escaped("a|b <i> *c*")
    'a\\\\|b \\\\<i\\\\> \\\\*c\\\\*'
    """
    shown = "".join(f"\\{c}" if c in _SPECIAL else c for c in cut(text))
    return shown.replace("www.", "www\\.")  # GitHub makes links of bare addresses


def _table(head: Iterable[str], rows: Iterable[Iterable[str]]) -> Iterator[str]:
    names = list(head)
    yield f"| {' | '.join(names)} |"
    yield f"|{' --- |' * len(names)}"
    for row in rows:
        yield f"| {' | '.join(row)} |"


def _adjustments(result: Result) -> Iterator[str]:
    if result.adjusted is not None:
        yield "### Adjusted by the stewards"
        yield ""
        yield from (f"- {escaped(text)}" for text in remarks(result))


def _narrowing(result: Result) -> Iterator[str]:
    lines = would_narrow(result, cut)
    if lines:
        yield "### What would narrow the score"
        yield ""
        yield from (f"- {escaped(text)}" for text in lines[:_MOST])


def _ledger(result: Result) -> Iterator[str]:
    ledger = result.ledger or result.task
    if ledger is None:
        return
    yield "### Why" if result.ledger else "### Why the task score"
    yield ""
    yield from _table(
        ("", "points"),
        (
            *(
                (_name(line), amount_text(line.amount, sign=line.kind in ("factor", "taken")))
                for line in told(result)
            ),
            ("automatic score" if result.adjusted else "score", f"**{amount_text(ledger.amount)}**"),
        ),
    )


def _name(line: Line) -> str:
    key = f"{escaped(line.findings[0])}: " if line.kind == "taken" and len(line.findings) == 1 else ""
    own = line.subject.rpartition("/")[2]
    return key + escaped(own if own and line.path.endswith(f"/{own}") and not key else line.label)


def _found(result: Result, verdict: Verdict, title: str) -> Iterator[str]:
    found = [(key, finding) for key, finding in told_findings(result).items() if finding.verdict is verdict]
    if not found:
        return
    yield f"### {title}"
    yield ""
    rows = (
        (
            escaped(key),
            escaped(finding.subject),
            when(finding),
            "" if finding.robustness is None else f"{finding.robustness:.6g} {escaped(finding.unit)}",
            "" if (took := cost(key, result)) is None else amount_text(took, sign=True),
            escaped(finding.message),
            escaped(finding.clause),
        )
        for key, finding in found[:_MOST]
    )
    yield from _table(("finding", "about", "when", "margin", "points", "what", "clause"), rows)
    if len(found) > _MOST:
        yield ""
        yield f"… and {len(found) - _MOST} more"


def _checks(result: Result) -> Iterator[str]:
    yield "### Checks"
    yield ""
    counts: dict[str, Counter[Verdict]] = {check: Counter() for check in checks(result)}
    for finding in final_findings(result).values():
        counts[finding.check][finding.verdict] += 1
    yield from _table(
        ("check", "plugin", *(v.value.replace("_", " ") for v in Verdict), "priced"),
        (
            (
                escaped(check),
                escaped(used["use"]),
                *(str(counts[check][verdict] or "") for verdict in Verdict),
                "yes" if used["priced"] else "no",
            )
            for check, used in checks(result).items()
        ),
    )


def _origin(result: Result) -> Iterator[str]:
    for source in result.provenance.inputs:
        parts = "" if source.read_bytes is None else f" of the {source.read_bytes} bytes that were read"
        yield f"- {escaped(source.role)} {escaped(source.name)}, sha256 `{source.sha256}`{parts}"
    yield f"- rule set {escaped(result.provenance.rule_set.id)}, sha256 `{result.provenance.rule_set.sha256}`"
    yield from (f"- {escaped(text)}" for text in unrecorded(result))
    for code in result.provenance.code:
        made_by = f"{escaped(code.distribution)} {escaped(code.version)}, {escaped(code.package)}"
        yield f"- {made_by} sha256 `{code.sha256[:16]}…`"
