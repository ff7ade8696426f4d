"""What a trial is held against: a formula that was read and checked, and how its verdicts are drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from ariac_score_stl.margins import Beyond
from ariac_score_stl.signals import Source
from ariac_score_stl.syntax import Node
from ariac_score_stl.units import unit_of

__all__ = ["Specification"]


@dataclass(frozen=True, eq=False)
class Specification:
    """A formula and the parameters of `stl.formula`, shared by all that judges or reports.

    Attributes:
        tree: The whole formula.
        sources: Where each of its signals has its values from, by name.
        constants: Its numbers, by name.
        time: Whether windows hold samples, or a sample stands until the next one.
        beyond: What lies beyond the trial.
        max_gap_s: A longer stretch without a sample is a hole, s.
        t_on_s: Shorter episodes are no violation, s.
        t_off_s: Shorter pauses between episodes are bridged, s.
        clause: What findings refer to.
        critical: Whether a violation is critical.
    """

    tree: Node
    sources: Mapping[str, Source]
    constants: Mapping[str, float]
    time: Literal["discrete", "dense"]
    beyond: Beyond
    max_gap_s: float
    t_on_s: float
    t_off_s: float
    clause: str
    critical: bool

    @property
    def is_rule(self) -> bool:
        """Whether the formula begins with `always`, so that what follows is judged at every moment."""
        return self.tree.operator == "always"

    @property
    def body(self) -> Node:
        """What is judged at a moment: what follows an outermost `always`, else all of the formula."""
        return self.tree.parts[0] if self.is_rule else self.tree

    @cached_property
    def margin_units(self) -> Mapping[Node, str]:
        """The unit of every predicate's margin."""
        units = {name: source.unit for name, source in self.sources.items()}
        predicates = [node for node in self.tree.walk() if node.operator == "predicate"]
        return {node: unit_of(node, units) for node in predicates}

    @property
    def shared_unit(self) -> str | None:
        """The unit of every margin; `None` where predicates differ in it."""
        units = set(self.margin_units.values())
        return units.pop() if len(units) == 1 else None
