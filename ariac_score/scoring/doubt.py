"""Which undecided findings a value really depends on.

A formula may use something undecided and still be certain: what went to the wrong
place is worth 0, however it was done.
"""

from __future__ import annotations

from collections.abc import Container, Mapping

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.scoring.expression import Traced
from ariac_score.scoring.scope import is_inside

__all__ = ["doubts"]


def doubts(traced: Traced, findings: Mapping[str, Finding], open_: Container[str]) -> list[str]:
    """The undecided findings that could change a value.

    Args:
        traced: The value, with what it was made of.
        findings: All findings by id.
        open_: Ids of those that are not certain.

    Returns:
        Their ids, in the order in which the formula uses them.
    """
    return list(dict.fromkeys(_doubts(traced, findings, open_)))


def _doubts(node: Traced, findings: Mapping[str, Finding], open_: Container[str]) -> list[str]:
    if node.kind == "check":
        return _of_check(node, findings, open_)
    if node.kind == "each" and not node.children:
        # Nothing inside may mean that nobody knows what is inside.
        return [key for key, f in findings.items() if key in open_ and is_inside(f.subject, node.subject)]
    # What a certain 0 is multiplied with, or a certain yes is or-ed with, changes nothing.
    inner = [_doubts(child, findings, open_) for child in node.children]
    certain = [
        child.value for child, open_inside in zip(node.children, inner, strict=True) if not open_inside
    ]
    if node.op in ("*", "and") and any(not value for value in certain):
        return []
    if node.op == "or" and any(certain):
        return []
    return [key for open_inside in inner for key in open_inside]


def _of_check(node: Traced, findings: Mapping[str, Finding], open_: Container[str]) -> list[str]:
    used = {
        key: f for key, f in findings.items() if f.check in node.checks and is_inside(f.subject, node.subject)
    }
    certain = [f for key, f in used.items() if key not in open_ and f.verdict is Verdict.VIOLATED]
    if node.op in ("holds", "violated") and certain:
        return []  # one violation decides, whatever the others would say
    return [key for key in used if key in open_]
