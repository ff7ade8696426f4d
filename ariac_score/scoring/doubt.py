"""Which open findings a value really hangs on.

A formula may ask about something undecided and still be certain: a shipment that went
to the wrong place is worth 0, whatever lay on its tray.
"""

from __future__ import annotations

from collections.abc import Container, Mapping

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.scoring.expression import Traced

__all__ = ["doubts"]


def doubts(traced: Traced, findings: Mapping[str, Finding], open_: Container[str]) -> list[str]:
    """The open findings that could change a value.

    Args:
        traced: The value, with what it was made of.
        findings: All findings by id.
        open_: Ids of those that are not certain.

    Returns:
        Their ids, in the order in which the formula asks about them.
    """
    return list(dict.fromkeys(_doubts(traced, findings, open_)))


def _doubts(node: Traced, findings: Mapping[str, Finding], open_: Container[str]) -> list[str]:
    if node.kind == "check":
        return _of_check(node, findings, open_)
    if node.kind == "each" and not node.children:
        # Nothing inside may mean that nobody knows what is inside.
        return [key for key, f in findings.items() if key in open_ and _inside(f.subject, node.subject)]
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
    asked = {
        key: f for key, f in findings.items() if f.check in node.checks and _inside(f.subject, node.subject)
    }
    certain = [f for key, f in asked.items() if key not in open_ and f.verdict is Verdict.VIOLATED]
    if node.op in ("holds", "violated") and certain:
        return []  # one violation decides, whatever the others would say
    return [key for key in asked if key in open_]


def _inside(subject: str, path: str) -> bool:
    return not path or subject == path or subject.startswith(f"{path}/")
