"""What ARIAC knows of its editions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ariac_score import LogDefect, Order, Trial
from ariac_score_ariac.config.product_types import unknown_products

if TYPE_CHECKING:
    from ariac_score.testing import Recorded
    from ariac_score_ariac.testing.recordings import Motion

__all__ = ["Ariac"]


@dataclass(frozen=True)
class Ariac:
    """What ARIAC knows of its editions.

    Attributes:
        edition: Its year; configurations that look like those of another year are then refused.

    Source:
        Rulebooks 2017 to 2024, orders.
    """

    edition: int | None = None

    levels: ClassVar = ("part", "submission", "order", "trial")
    facts: ClassVar = {
        "submission": {"parts": {"type": "number", "meaning": "number of wanted products"}},
        "order": {
            "index": {"type": "number", "meaning": "0 for the first order announced, 1 for the second, …"},
            "priority": {"type": "number", "meaning": "as the order gives it"},
            "parts": {"type": "number", "meaning": "number of wanted products"},
        },
        "trial": {"orders": {"type": "number", "meaning": "number of orders"}},
    }
    motions: ClassVar = ("snapshot", "human_state", "frames")

    def unknown_products(self, orders: Sequence[Order], edition: int) -> list[LogDefect]:
        """A defect for each product that is ordered although that edition has none of its type."""
        return unknown_products(orders, edition)

    def recorded_messages(self, trial: Trial, *, motion: Motion) -> list[Recorded]:
        """The messages of ARIAC in which a trial would have been recorded."""
        # Writers of recordings, which scoring does without.
        from ariac_score_ariac.testing.recordings import recorded_messages  # noqa: PLC0415

        return recorded_messages(trial, motion=motion)
