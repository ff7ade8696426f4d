"""What ARIAC knows of its editions."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

from ariac_score import Likeness, LogDefect, Trial, check_parameters, parameter
from ariac_score_ariac.config.product_types import unknown_products
from ariac_score_ariac.joining import joined, with_irregularities
from ariac_score_ariac.kits import with_contents
from ariac_score_ariac.official.places import place_of
from ariac_score_ariac.work import Order, orders_of

if TYPE_CHECKING:
    from ariac_score.testing import Recorded
    from ariac_score_ariac.testing.recordings import Motion

__all__ = ["Ariac"]


@dataclass(frozen=True)
class Ariac:
    """What ARIAC knows of its editions.

    Attributes:
        edition: Its year; configurations that look like those of another year are then refused.
        max_age_s: How old contents may be at the submission, s.

    Source:
        Rulebooks 2017 to 2024, orders.
    """

    edition: int | None = None
    max_age_s: float = parameter(1.0, unit="s", at_least=0)

    levels: ClassVar = ("part", "submission", "order", "trial")
    facts: ClassVar = {
        "submission": {"parts": {"type": "number", "meaning": "number of wanted products", "least": 0}},
        "order": {
            "index": {
                "type": "number",
                "meaning": "0 for the first order announced, 1 for the second, …",
                "least": 0,
            },
            "priority": {"type": "number", "meaning": "as the order gives it"},
            "parts": {"type": "number", "meaning": "number of wanted products", "least": 0},
        },
        "trial": {"orders": {"type": "number", "meaning": "number of orders", "least": 0}},
    }
    words: ClassVar[Mapping[str, tuple[str, str]]] = {
        "trial": ("trial", "trials"),
        "order": ("order", "orders"),
        "submission": ("shipment", "shipments"),
        "part": ("part", "parts"),
    }
    motions: ClassVar = ("snapshot", "human_state", "frames")

    def __post_init__(self) -> None:
        check_parameters(self)

    def join(self, merged: Trial, parts: Sequence[Trial], file: object) -> Trial:
        """The merged trial with its orders, submissions and sensors; see `joined`."""
        return joined(merged, parts, file)

    def complete(self, trial: Trial) -> Trial:
        """The trial with contents for submissions that came without, and what is irregular about them."""
        return with_contents(with_irregularities(trial), max_age_s=self.max_age_s)

    def defects(self, trial: Trial) -> list[LogDefect]:
        """A defect for each product that is ordered although its edition has none of its type."""
        return [] if self.edition is None else unknown_products(orders_of(trial), self.edition)

    def unlikely(self, likeness: Likeness) -> str:
        """Its edition, where a file looks like one of other editions only; empty where it may be its own."""
        if self.edition is None or not likeness.used_by or str(self.edition) in likeness.used_by:
            return ""
        return str(self.edition)

    def printed_level(self, name: str) -> str:
        """The level of a block of an official text that stands inside an order."""
        return "submission" if name.startswith("shipment_") else "part"

    def place(self, order: Order, level: str, name: str) -> tuple[str, str]:
        """The path of what an official text calls by a name within an order, and why there is none."""
        return place_of(order, level, name)

    def example_trial(self, *, seed: int) -> Trial:
        """Two kits with flaws that can be checked by hand."""
        from ariac_score_ariac.testing.trials import kitting_trial  # noqa: PLC0415

        return kitting_trial(seed=seed)

    def made_trial(self) -> Trial:
        """A trial with every kind of order, for trying rules of ARIAC."""
        from ariac_score_ariac.testing.trials import made_trial  # noqa: PLC0415

        return made_trial()

    def recorded_messages(self, trial: Trial, *, motion: Motion) -> list[Recorded]:
        """The messages of ARIAC in which a trial would have been recorded."""
        # Writers of recordings, which scoring does without.
        from ariac_score_ariac.testing.recordings import recorded_messages  # noqa: PLC0415

        return recorded_messages(trial, motion=motion)
