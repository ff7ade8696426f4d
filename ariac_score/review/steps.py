"""The steps of verifying a stored result, and what they come to."""

from __future__ import annotations

from dataclasses import dataclass

from ariac_score.results.result import Result

__all__ = ["FAILED", "NOTE", "OK", "OPEN", "Step", "Verification"]

OK, FAILED, NOTE, OPEN = "ok", "failed", "note", "open"


@dataclass(frozen=True)
class Step:
    """One step of the verification.

    Attributes:
        name: Such as `schema` or `recomputed`.
        outcome: `ok`; `failed`; `note` for what says nothing against the result; `open` for what nobody but
            the result itself says, as long as it is not compared with something else.
        words: What was found; several lines for several differences.
    """

    name: str
    outcome: str
    words: str


@dataclass(frozen=True)
class Verification:
    """The outcome of verifying a stored result.

    Attributes:
        steps: In the order in which they were taken.
        result: The result; `None` when it cannot be built from the file, or it is another document.
        about: What other document it is, in words; empty for a result.
    """

    steps: tuple[Step, ...]
    result: Result | None
    about: str = ""

    def steps_that_are(self, outcome: str) -> tuple[str, ...]:
        """The names of the steps with that outcome."""
        return tuple(step.name for step in self.steps if step.outcome == outcome)

    @property
    def consistent(self) -> bool:
        """Whether nothing failed."""
        return not self.steps_that_are(FAILED)

    @property
    def holds(self) -> bool:
        """Whether nothing failed and nothing is open: it was computed again, by rules that are known here."""
        return self.consistent and not self.steps_that_are(OPEN)

    @property
    def computed_again(self) -> bool:
        """Whether all was computed again from the log."""
        return any(step.name == "recomputed" for step in self.steps)
