"""GitHub workflow commands: an annotation for each violation and each undecided finding.

Source: GitHub, "Workflow commands for GitHub Actions", and the escaping of its own toolkit
(`%`, carriage return and newline everywhere; colon and comma in properties as well).
"""

from __future__ import annotations

from collections.abc import Iterator

from ariac_score.checks.findings import Verdict
from ariac_score.report.exports.facts import (
    cost,
    cut,
    headline,
    name,
    narrowing,
    remarks,
    told_findings,
    unrecorded,
    when,
    why_unofficial,
)
from ariac_score.report.text import amount_text
from ariac_score.results.result import Result

__all__ = ["github_text"]

SHOWN = 10
"""GitHub shows only so many annotations of a kind for each step; the last one counts the rest."""


def github_text(result: Result) -> str:
    """A result as workflow commands, one a line: score, decisions, violations, undecided findings."""
    lines = [_command("notice" if result.final is not None else "error", name(result), headline(result))]
    lines += [_command("warning", name(result), text) for text in why_unofficial(result)]
    lines += [_command("warning", f"{name(result)}: stewards", text) for text in remarks(result)]
    lines += [_command("warning", name(result), text) for text in narrowing(result)[:3]]
    lines += _findings(result, Verdict.VIOLATED, "error")
    lines += _findings(result, Verdict.INCONCLUSIVE, "warning")
    lines += [_command("notice", name(result), text) for text in unrecorded(result)]
    return "".join(f"{line}\n" for line in lines)


def _findings(result: Result, verdict: Verdict, command: str) -> Iterator[str]:
    found = [(key, finding) for key, finding in told_findings(result).items() if finding.verdict is verdict]
    found.sort(key=lambda item: (not result.checks[item[1].check]["priced"], item[1].span is None, item[0]))
    # The score is an annotation as well, and so is the count of those that do not fit.
    shown = found if len(found) <= SHOWN - 2 else found[: SHOWN - 3]
    for key, finding in shown:
        time = f", {when(finding)}" if finding.span else ""
        took = cost(key, result)
        points = f", {amount_text(took, sign=True)} points" if took else ""
        message = f"{cut(finding.subject, 200)}{time}: {cut(finding.message)}"
        yield _command(command, f"{finding.check} {verdict.value} ({key}{points})", message)
    if len(found) > len(shown):
        yield _command(command, name(result), f"{len(found) - len(shown)} more are {verdict.value}")


def _command(command: str, title: str, message: str) -> str:
    return f"::{command} title={_escaped(title, ':,')}::{_escaped(message)}"


def _escaped(text: str, also: str = "") -> str:
    """Text that cannot end its command or begin another."""
    for character in "%\r\n" + also:  # the percent sign first: the escapes of the others contain it
        text = text.replace(character, f"%{ord(character):02X}")
    return text
