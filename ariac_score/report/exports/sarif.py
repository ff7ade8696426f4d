"""SARIF 2.1.0: violations and undecided findings as results, with message, time and margin.

Source: OASIS, Static Analysis Results Interchange Format (SARIF) Version 2.1.0 Plus Errata 01.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any
from urllib.parse import quote

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.report.exports.facts import (
    checks,
    cost,
    cut,
    ends,
    headline,
    name,
    narrowing,
    remarks,
    told_findings,
    unofficial,
    unrecorded,
    when,
    why_unofficial,
)
from ariac_score.results.result import Result, canonical

__all__ = ["sarif_text"]

_SCHEMA = "https://docs.oasis-open.org/sarif/sarif/v2.1.0/errata01/os/schemas/sarif-schema-2.1.0.json"


def sarif_text(result: Result) -> str:
    """A result as a SARIF log, with a newline at its end."""
    log = {"$schema": _SCHEMA, "version": "2.1.0", "runs": [_run(result)]}
    return json.dumps(log, indent=1, sort_keys=True, allow_nan=False) + "\n"


def _run(result: Result) -> dict[str, Any]:
    names = list(checks(result))
    reported = [
        (key, finding)
        for key, finding in told_findings(result).items()
        if finding.verdict in (Verdict.VIOLATED, Verdict.INCONCLUSIVE)
    ]
    return {
        "tool": {"driver": _driver(result)},
        "automationDetails": {"id": f"{result.provenance.rule_set.id}/{quote(name(result), safe='/')}/"},
        "columnKind": "unicodeCodePoints",
        "artifacts": [
            {
                "location": {"uri": _uri(source.name)},
                "length": source.bytes,
                "hashes": {"sha-256": source.sha256},
                "roles": ["analysisTarget"],
            }
            for source in result.provenance.inputs
        ],
        "invocations": [{"executionSuccessful": True, "toolExecutionNotifications": _notifications(result)}],
        "results": [_result(key, finding, names, result) for key, finding in reported],
        "properties": _properties(result),
    }


def _driver(result: Result) -> dict[str, Any]:
    version = next((c.version for c in result.provenance.code if c.distribution == "ariac-score"), "")
    return {
        "name": "ariac-score",
        **({"version": version} if version else {}),
        "rules": [
            {
                "id": check,
                "shortDescription": {"text": f"{check} ({used['use']})"},
                "properties": {"priced": used["priced"], "on_inconclusive": used["on_inconclusive"]},
            }
            for check, used in checks(result).items()
        ],
    }


def _notifications(result: Result) -> list[dict[str, Any]]:
    """The score, decisions of stewards, defects of the log, and what it does not contain."""
    notes = [headline(result), *why_unofficial(result), *remarks(result), *narrowing(result)]
    notes += [f"{cut(d.where, 200)}: {cut(d.message)} ({d.count})" for d in result.measured.log_defects]
    notes += unrecorded(result)
    return [{"level": "note", "message": {"text": text}} for text in notes]


def _properties(result: Result) -> dict[str, Any]:
    amounts = {"score": result.final, "automatic_score": result.score, "possible": result.possible}
    return {
        "rule_set": result.provenance.rule_set.id,
        "rule_set_sha256": result.provenance.rule_set.sha256,
        "status": result.status,
        "adjusted": result.adjusted is not None,
        **({"unofficial": unofficial(result)} if result.measured.unofficial else {}),
        **{key: None if value is None else float(value) for key, value in amounts.items()},
        **{key: float(value) for key, value in ends(result).items()},
    }


def _result(key: str, finding: Finding, names: list[str], result: Result) -> dict[str, Any]:
    violated, took = finding.verdict is Verdict.VIOLATED, cost(key, result)
    time = f" ({when(finding)})" if finding.span else ""
    location: dict[str, Any] = {"logicalLocations": [{"fullyQualifiedName": cut(finding.subject, 200)}]}
    if result.provenance.inputs:
        # Code hosts show no result without a line. A recording has none, so line 1 stands for the file.
        location["physicalLocation"] = {
            "artifactLocation": {"uri": _uri(_log(result)[0]), "index": _log(result)[1]},
            "region": {"startLine": 1},
        }
    return {
        "ruleId": finding.check,
        "ruleIndex": names.index(finding.check),
        "kind": "fail" if violated else "open",
        # SARIF 2.1.0, 3.27.10: a result whose kind is not "fail" has the level "none".
        "level": _level(finding, result) if violated else "none",
        "message": {"text": f"{cut(finding.subject, 200)}{time}: {cut(finding.message)}"},
        "locations": [location],
        "partialFingerprints": {"ariacScoreFinding/v1": _fingerprint(key, finding, result)},
        "properties": {**_measures(key, finding), **({} if took is None else {"points": float(took)})},
    }


def _level(finding: Finding, result: Result) -> str:
    return "error" if finding.critical or result.checks[finding.check]["priced"] else "warning"


def _log(result: Result) -> tuple[str, int]:
    """Name and index of the file that the findings are about: the log, else the first."""
    inputs = result.provenance.inputs
    return next(((s.name, i) for i, s in enumerate(inputs) if s.role == "log"), (inputs[0].name, 0))


def _uri(file: str) -> str:
    """A relative reference to a file."""
    # `quote` also escapes a colon, which in the first segment would begin a scheme.
    return quote(file.encode("utf-8", "surrogatepass"), safe="/")


def _fingerprint(key: str, finding: Finding, result: Result) -> str:
    """Identifies the same finding of the same check in a later run of this trial."""
    parts = (result.provenance.rule_set.id, name(result), key, cut(finding.subject))
    return hashlib.sha256("\0".join(parts).encode("utf-8")).hexdigest()[:32]


def _measures(key: str, finding: Finding) -> Mapping[str, Any]:
    span = finding.span
    numbers = {} if span is None else {"start_s": canonical(span.start_s), "end_s": canonical(span.end_s)}
    if finding.robustness is not None:
        numbers |= {"margin": finding.robustness}
    return {
        "finding": key,
        **numbers,
        **({"unit": finding.unit} if finding.unit else {}),
        **({"clause": finding.clause} if finding.clause else {}),
        "critical": finding.critical,
        "quantities": dict(finding.quantities),
    }
