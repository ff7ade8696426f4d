"""The state of a specification in a stream of events, and what a rejected event does to it."""

from __future__ import annotations

from typing import Literal, TypeAlias

from ariac_score_rml.machine import Letter, Machine
from ariac_score_rml.terms import Term

__all__ = ["AfterViolation", "Progress"]

AfterViolation: TypeAlias = Literal["resume", "restart", "once"]
"""resume: the rejected event is passed over; restart: Main starts again; once: nothing more is judged."""


class Progress:
    """A specification, event after event.

    Attributes:
        state: The state before the next event.
        initial: Letter before any event.
        letter: Letter of the events so far.
        fresh: Whether nothing was accepted since the start or the last restart.
        over: Whether no further event is judged.

    Raises:
        RmlRunError: The empty trace cannot be judged.
    """

    def __init__(self, machine: Machine, after: AfterViolation, start: Term | None = None) -> None:
        self._machine, self._after, self._start = machine, after, start or machine.start
        self.state = self._start
        self.initial: Letter = machine.letter(self._start)
        self.letter: Letter = self.initial
        self.fresh, self.over = True, False

    def take(self, found: Term | None) -> bool:
        """Take an event, and return whether it is accepted.

        Args:
            found: The state that the event leads to; `None`: it is rejected.

        Raises:
            RmlRunError: The trace cannot be judged with it; nothing has changed.
        """
        if found is not None:
            self.letter = self._machine.letter(found)
            self.state, self.fresh = found, False
        elif self._after == "once":
            self.letter, self.over = "F", True
        elif self._after == "restart":
            self.state, self.letter, self.fresh = self._start, self.initial, True
        return found is not None
