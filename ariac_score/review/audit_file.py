"""An audit as canonical JSON: sorted keys, measured numbers with the declared digits, no clock."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from ariac_score.results.result import canonical
from ariac_score.review.audit import AGREE, CANNOT_BE_JUDGED, DIFFER, Audit
from ariac_score.review.comparison import Comparison
from ariac_score.scoring.expression import Number

__all__ = ["SCHEMA", "audit_json"]

SCHEMA = "ariac-score/audit/1"


def audit_json(audit: Audit) -> str:
    """An audit as text, with a newline at its end; same audit, same bytes."""
    text = json.dumps(_data(audit), sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False)
    # Half a surrogate pair, which a log may hold in a name, has no place in UTF-8 but has one in JSON.
    return text.encode("utf-8", "backslashreplace").decode("utf-8") + "\n"


def _data(audit: Audit) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "trial": audit.trial,
        "source": audit.source,
        "layout": audit.layout,
        "outcome": audit.outcome,
        "rule_set": {"id": audit.rule_set[0], "sha256": audit.rule_set[1]},
        "counts": {verdict: audit.count(verdict) for verdict in (AGREE, DIFFER, CANNOT_BE_JUDGED)},
        "items": [{**asdict(item), "ours": _number(item.ours)} for item in audit.items],
        "sums": [{**asdict(one), "expected": _number(one.expected)} for one in audit.sums],
        "comparisons": [_comparison_data(comparison) for comparison in audit.comparisons],
    }


def _comparison_data(comparison: Comparison) -> dict[str, Any]:
    return {
        "first": comparison.first,
        "second": comparison.second,
        "changes": [
            {
                **asdict(change),
                "before": _number(change.before),
                "after": _number(change.after),
                "reasons": [
                    {name: getattr(reason, name) for name in ("name", "coded", "documented", "source")}
                    for reason in change.reasons
                ],
            }
            for change in comparison.changes
        ],
        "undecided": [
            {"level": level, "path": path, "term": term, "reason": reason}
            for level, path, term, reason in comparison.undecided
        ],
    }


def _number(value: Number | None) -> Number | None:
    return value if value is None or isinstance(value, int) else canonical(value)
