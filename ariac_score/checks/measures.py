"""What a check measures: unit and role of each quantity in its findings, declared once by the plugin."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

__all__ = ["Measure", "Role", "measures_of"]

Role = Literal["points", "penalty", "factor", "measure"]
"""What a quantity is in a score.

`points`: what the work earned; where nothing was done it is 0. `penalty`: what violations cost; where
there is none it is 0. `factor`: what points are multiplied by; where nothing is wrong it is 1.
`measure`: a number such as a time or a length, which a formula turns into any of these.
"""

_BEST: Mapping[str, float] = {"points": 0.0, "penalty": 0.0, "factor": 1.0}


@dataclass(frozen=True)
class Measure:
    """One quantity of the findings of a check.

    Attributes:
        unit: Such as `s`, `m`, `points`, `count`; `1` for a number without a unit.
        role: What it is in a score.
        best: Its value in a trial that nothing can be said against, which a ledger compares with;
            `None`: what the role says, and for a `measure` that nobody can say.
        meaning: In words, for pages and `plugins show`; of what is 1 or 0 such as
            `1 where the task was completed`, and rulebooks ask whether the task was completed.
        signed: Whether it may be negative, as an offset in time may; `None`: unless it is a time or a
            count. The engine refuses findings in which it is, and may not be.
        worst: Its value where nothing speaks for the trial, which an undecided finding is priced with in the
            worst world; `None`: nobody can say.
    """

    unit: str
    role: Role = "measure"
    best: float | None = None
    meaning: str = ""
    signed: bool | None = None
    worst: float | None = None

    def __post_init__(self) -> None:
        # Left out of JSON where there is none, as in results of versions that did not know it.
        if self.worst is None:
            self.__dict__.pop("worst", None)

    @property
    def is_never_negative(self) -> bool:
        """Whether no finding may have it below 0."""
        return self.signed is False or (self.signed is None and self.unit in ("s", "count"))

    @property
    def condition(self) -> str:
        """What is so where it is not 0, in words; empty where its meaning does not say that.

        >>> Measure("count", meaning="1 where arms collided, else 0").condition
        'arms collided'
        """
        said = self.meaning.removesuffix(", else 0")
        return said.removeprefix("1 where ") if said.startswith("1 where ") else ""

    @property
    def reference(self) -> float | None:
        """The value a ledger compares with; `None` where nobody can say one."""
        return self.best if self.best is not None else _BEST.get(self.role)


def measures_of(check: object) -> Mapping[str, Measure]:
    """The quantities that a check (or its class) declares in `measures`, by name; none without it."""
    declared = getattr(check, "measures", None)
    return declared if isinstance(declared, Mapping) else {}
