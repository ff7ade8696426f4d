"""The score sheet of a run as CSV, as referees sign it: a row for each thing that was seen."""

from __future__ import annotations

import csv
import io

from ariac_score import Result, Verdict

__all__ = ["score_sheet"]


def score_sheet(result: Result) -> str:
    """One row for each finding that counts: what, about what, whether it was kept, and in words."""
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["check", "about", "verdict", "seen"])
    for finding in result.measured.findings.values():
        if finding.verdict is not Verdict.NOT_APPLICABLE:
            rows.writerow([finding.check, finding.subject, finding.verdict.value, finding.message])
    rows.writerow(["score", "", "", "withheld" if result.score is None else str(result.score)])
    return text.getvalue()
