"""CSV and JSON Lines: every finding as a row, for spreadsheets and for programs."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from decimal import Decimal
from typing import Any

from ariac_score.report.exports.facts import (
    cost,
    ends,
    narrowing,
    remarks,
    told_findings,
    unofficial,
)
from ariac_score.report.spreadsheet import text_cell
from ariac_score.results.result import Result, canonical
from ariac_score.terminal.style import plain

__all__ = ["csv_text", "jsonl_text"]

_COLUMNS = (
    "team", "trial", "rule_set", "status", "score", "automatic_score", "adjustments",
    "finding", "check", "plugin", "priced", "subject", "verdict", "automatic_verdict",
    "start_s", "end_s", "margin", "unit", "critical", "clause", "message",
    "score_least", "score_most",
)  # fmt: skip


def csv_text(result: Result) -> str:
    """A row for each finding, each with the score of the trial, under a row of names."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for row in _rows(result):
        writer.writerow([_cell(row[column]) for column in _COLUMNS])
    return out.getvalue()


def jsonl_text(result: Result) -> str:
    """A line for the result, then one for each amount of the ledger, each decision, each finding."""
    return "".join(json.dumps(line, sort_keys=True, allow_nan=False) + "\n" for line in _records(result))


def _cell(value: object) -> str:
    """A value as it stands in CSV; a number stays a number, also with a minus sign."""
    if value is None:
        return ""
    if isinstance(value, str):
        return plain(text_cell(value))
    return str(value).lower() if isinstance(value, bool) else repr(value)


def _amount(value: Decimal | None) -> float | None:
    return None if value is None else float(value)


def _head(result: Result) -> dict[str, Any]:
    between = ends(result)
    return {
        "team": result.measured.team,
        "trial": result.measured.trial,
        "rule_set": result.provenance.rule_set.id,
        "status": result.status,
        "score": _amount(result.final),
        "automatic_score": _amount(result.score),
        # Where nothing is open both ends are the score, so that a column can be used without a case.
        "score_least": _amount(between.get("score_least", result.final)),
        "score_most": _amount(between.get("score_most", result.final)),
        "unofficial": unofficial(result),
        "adjustments": "; ".join(remarks(result)),
    }


def _rows(result: Result) -> Iterator[dict[str, Any]]:
    head = _head(result)
    for key, finding in told_findings(result).items():
        used = result.checks[finding.check]
        yield {
            **head,
            "finding": key,
            "check": finding.check,
            "plugin": used["use"],
            "priced": used["priced"],
            "subject": finding.subject,
            "verdict": finding.verdict.value,
            "automatic_verdict": result.measured.in_all_worlds[key].verdict.value,
            "start_s": None if finding.span is None else canonical(finding.span.start_s),
            "end_s": None if finding.span is None else canonical(finding.span.end_s),
            "margin": finding.robustness,
            "unit": finding.unit,
            "critical": finding.critical,
            "clause": finding.clause,
            "points": _amount(cost(key, result)),
            "message": finding.message,
        }


def _records(result: Result) -> Iterator[dict[str, Any]]:
    head = _head(result)
    yield {
        "record": "result",
        **head,
        "adjustments": remarks(result),
        "possible": _amount(result.possible),
        "narrowing": narrowing(result),
        "rule_set_sha256": result.provenance.rule_set.sha256,
        "inputs": [{"name": s.name, "role": s.role, "sha256": s.sha256} for s in result.provenance.inputs],
    }
    ledgers = [result.ledger, result.adjusted.ledger if result.adjusted else None]
    for which, ledger in zip(("automatic", "adjusted"), ledgers, strict=True):
        for line in ledger.leaves if ledger is not None else ():
            yield {
                "record": "amount",
                "ledger": which,
                "path": line.path,
                "label": line.label,
                "amount": float(line.amount),
                "kind": line.kind,
                "nominal": float(line.amount if line.nominal is None else line.nominal),
                "reason": line.reason,
                "findings": list(line.findings),
            }
    findings = result.measured.findings
    for row in _rows(result):
        own = {key: value for key, value in row.items() if key not in head}
        quantities = dict(findings[row["finding"]].quantities)
        yield {"record": "finding", **own, "quantities": quantities}
