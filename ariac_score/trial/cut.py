"""How far a log goes that is cut off."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ariac_score.errors import CutOffError, LogError

__all__ = ["LARGEST_DISORDER_S", "MARGIN_S", "Cut", "cut_at"]

MARGIN_S = 1.0
"""Of the end of what can be read nothing is judged for so long: messages come late and out of order, and
speeds follow from the samples on both sides."""

LARGEST_DISORDER_S = 5.0
"""Recorders write messages out of order by seconds at most; files sorted by topic step back by trials."""


@dataclass(frozen=True)
class Cut:
    """How far a log goes that was cut off.

    Attributes:
        file: Its name.
        cause: Where it breaks off, in words.
        until_s: Everything before is there, s of trial time; `None` where its times are not those of the
            trial.
        ended: Whether it shows that the competition had ended by then, so that it lacks nothing of it.
        open_end: Whether nothing shows when the competition ended, so that nobody knows for how long things
            went on.
        work_open: Why more may have been asked for than is known, in words; empty where that is stated
            elsewhere, or nothing hangs on it.
        official: Whether an official record of the trial is whole, in a file of its own, or none was lost.
    """

    file: str
    cause: str
    until_s: float | None
    ended: bool = False
    open_end: bool = False
    work_open: str = ""
    official: bool = False

    @property
    def words(self) -> str:
        """That it is cut off, and what that means."""
        at = "" if self.until_s is None else f", and scored up to {self.until_s:.3f} s"
        then = ", after the end of the competition" if self.ended else ""
        return f"{self.file} is cut off{at}{then}"

    def shifted(self, by_s: float) -> Cut:
        """The same with its time later by a number of seconds."""
        return self if self.until_s is None else replace(self, until_s=self.until_s + by_s)


def cut_at(error: CutOffError, file: str, end_s: float | None, *, largest_step_back_s: float) -> Cut:
    """How far a log goes that is cut off.

    Args:
        error: Why it cannot be read on.
        file: Its name.
        end_s: The last time in it, s of trial time; `None`: it has none.
        largest_step_back_s: The most by which something in it is earlier than what stands before it.

    Raises:
        LogError: It does not stand in order of time, so that nobody knows what was lost.
    """
    if largest_step_back_s > LARGEST_DISORDER_S:
        raise LogError(
            "it is cut off, and does not stand in order of time, so nobody knows when what is lost was",
            file=error.file,
            place=error.place,
            hint="score the log as its recorder wrote it, not sorted anew",
        )
    # Messages of several topics reach a recorder in an order that is not quite that of their stamps.
    margin_s = max(MARGIN_S, 2 * largest_step_back_s)
    return Cut(file, error.cause, None if end_s is None else end_s - margin_s)
