"""Facts of a result that every export states, in the same words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from typing import Any

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.report.openness import between, which_counts, would_narrow
from ariac_score.report.text import amount_text
from ariac_score.results.adjustments import interval_that_counts
from ariac_score.results.doubt import why_withheld
from ariac_score.results.result import Result
from ariac_score.scoring.ledger import Line, taken_by
from ariac_score.scoring.steward import with_verdicts
from ariac_score.terminal.style import plain

__all__ = [
    "checks",
    "cost",
    "cut",
    "ends",
    "ends_in_words",
    "final_findings",
    "headline",
    "name",
    "narrowing",
    "remarks",
    "told",
    "told_findings",
    "unofficial",
    "unrecorded",
    "when",
    "why_none",
    "why_unofficial",
]

LONGEST = 2000
"""Most characters of an untrusted text; a program that reads the export may refuse more."""


def cut(text: str, longest: int = LONGEST) -> str:
    """Text on one line, with control characters made visible, and cut where long."""
    # Cut before it is escaped: the text may be as long as a log.
    shown = plain(text[: longest + 1])
    return shown if len(shown) <= longest else shown[: longest - 1] + "…"


def final_findings(result: Result) -> Mapping[str, Finding]:
    """The findings with the verdicts that count: those of stewards, else those of the checks.

    In the order of their ids: a stored result has its keys sorted, so no other order survives it.
    """
    decisions = () if result.adjusted is None else result.adjusted.adjustments
    findings = with_verdicts(result.measured.findings, decisions)
    return {key: findings[key] for key in sorted(findings, key=_by_number)}


def told_findings(result: Result) -> Mapping[str, Finding]:
    """The same, and those of the world that counts that took something, which nobody saw wholly."""
    found = dict(final_findings(result))
    for key in taken_by(result.ledger):
        if key not in found and key in result.measured.in_all_worlds:
            charged = result.measured.in_all_worlds[key]
            found[key] = replace(charged, message=f"counted at its worst: {charged.message}")
    return {key: found[key] for key in sorted(found, key=_by_number)}


def _by_number(key: str) -> tuple[str, int, str]:
    check, _, number = key.rpartition("#")  # as text, `separation#10` would come before `separation#9`
    return check, int(number) if number.isascii() and number.isdigit() else 0, key


def checks(result: Result) -> Mapping[str, Mapping[str, Any]]:
    """The checks in the order of their names, for the same reason."""
    return dict(sorted(result.checks.items()))


def name(result: Result) -> str:
    """Team and trial, or the trial where the team is not known."""
    measured = result.measured
    return cut(f"{measured.team}/{measured.trial}" if measured.team else measured.trial, 200)


def headline(result: Result) -> str:
    """The score that counts, and how it came about."""
    return f"unofficial: {_headline(result)}" if result.measured.unofficial else _headline(result)


def _headline(result: Result) -> str:
    if result.final is None:
        return f"no score{ends_in_words(result)}: {why_none(result)}"
    if result.adjusted is None:
        possible = "" if result.possible is None else f" of {amount_text(result.possible)} possible"
        return f"score {amount_text(result.final)}{possible}{ends_in_words(result)}"
    automatic = "withheld" if result.score is None else amount_text(result.score)
    word = "disqualified: score" if result.adjusted.disqualified else "adjusted score"
    ends_of = ends_in_words(result.automatic)
    return f"{word} {amount_text(result.final)}{ends_in_words(result)} (automatic {automatic}{ends_of})"


def ends_in_words(result: Result) -> str:
    """Between which ends the score that counts lies, after it; empty where nothing is open."""
    interval = interval_that_counts(result)
    return "" if interval is None else f", open {between(interval)} ({which_counts(interval)})"


def ends(result: Result) -> Mapping[str, Decimal]:
    """Both ends of the score that counts by the name that exports give them; nothing where none is open."""
    interval = interval_that_counts(result)
    return {} if interval is None else {"score_least": interval.least, "score_most": interval.most}


def unofficial(result: Result) -> str:
    """Why nothing official follows from it; empty where something can."""
    return "; ".join(cut(why) for why in result.measured.unofficial)


def why_unofficial(result: Result) -> list[str]:
    """The same, a line each."""
    return [f"unofficial: {cut(why)}" for why in result.measured.unofficial]


def narrowing(result: Result) -> list[str]:
    """What would narrow the score that counts, a line each."""
    return [f"would narrow the score: {one}" for one in would_narrow(result, cut)]


def why_none(result: Result) -> str:
    """Why there is no score."""
    why = why_withheld(result)
    return cut(why if why in (result.missing, result.status) else f"undecided: {why}")


def when(finding: Finding) -> str:
    """The time span, in s of trial time; empty for a finding without one."""
    if finding.span is None:
        return ""
    return f"{finding.span.start_s:.3f} s to {finding.span.end_s:.3f} s"


def cost(key: str, result: Result) -> Decimal | None:
    """What a finding took from the automatic score, negative; `None` where the ledger has no line of it."""
    line = taken_by(result.ledger).get(key)
    return None if line is None else line.amount


def told(result: Result) -> list[Line]:
    """The lines of the ledger that a table shows: what was earned, and each that took something."""
    ledger = result.ledger or result.task
    if ledger is None:
        return []
    lines: list[Line] = []
    for line in ledger.children or (ledger,):
        opened = line.children if line.path.endswith(("/earned", "/taken")) else (line,)
        lines += opened or (line,)
    silent = ("factor", "neutral", "cap")
    return [
        line
        for line in lines
        if (line.amount or line.kind not in silent) and not line.path.endswith("/neutral")
    ]


def unrecorded(result: Result) -> list[str]:
    """What the log lacks, a line each; empty where everything could be decided."""
    undecided = any(f.verdict is Verdict.INCONCLUSIVE for f in result.measured.findings.values())
    return [f"not recorded: {cut(what)}" for what in result.measured.unrecorded if undecided]


def remarks(result: Result) -> list[str]:
    """The decisions of stewards, a line each."""
    if result.adjusted is None:
        return []
    return [
        f"adjusted by {cut(a.author, 200)}, {a.time}: {cut(a.effect)}: {cut(a.words)}"
        for a in result.adjusted.adjustments
    ]
