"""Tasks that a rule set about kits does not judge, as findings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from ariac_score import Finding, Trial
from ariac_score_ariac.work import Order

_PLURAL = {"kitting": "kits", "assembly": "assemblies"}


@dataclass(frozen=True)
class OnlyKitting:
    """The order asks for kits, or for other kinds of task the rule set names, and nothing else.

    Measures:
        The kind of every task of the order.
    Violated when:
        Never: a task of another kind is inconclusive, because the rule set that uses
        this check has no rules for it, and a score that left it out would be wrong.
    Source:
        Our own; guards rule sets that price some kinds of task only.
    Attributes:
        kinds: Kinds of task that the rules know.
    """

    when_cut: ClassVar[str] = "kept"
    mistake: ClassVar[tuple[str, str]] = (
        "order of another kind",
        "orders of other kinds",
    )

    kinds: tuple[str, ...] = ("kitting",)

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:  # noqa: ARG002  # part of the contract
        """One finding for the order."""
        others = sorted({task.kind for task in order.tasks if task.kind not in self.kinds})
        if others:
            yield Finding.inconclusive(order.id, f"this rule set has no rules for {' and '.join(others)}")
        else:
            known = " and ".join(_PLURAL.get(kind, kind) for kind in self.kinds)
            yield Finding.satisfied(order.id, f"the order asks for {known} only")
