"""How long arrays get that grow while a recording is read."""

from __future__ import annotations

__all__ = ["Foreseen"]

_MOST_TIMES = 64
"""So many times what came so far is room made for at most: where memory is limited, room counts."""
_AGAIN = 8
"""Once so many times what there was has come, more is known, and little would have to be moved."""


class Foreseen:
    """Guesses a length from the share of the recording that was read.

    Memory that nothing is written to costs nothing, and moving what was written does.

    Args:
        most: No more elements are foreseen than so many.
    """

    def __init__(self, most: int) -> None:
        self._most, self._again_at = most, 0

    def length(self, needed: int, have: int, share: float) -> int:
        """How long an array of length `have` should be that `needed` elements must fit into.

        Args:
            needed: Elements so far.
            have: Its length; it stays what it is while that is enough.
            share: The share of the recording that they came from, 0 to 1; 0: not known.
        """
        if needed <= min(have, self._again_at):
            return have
        self._again_at = _AGAIN * needed
        if share <= 0:
            return have if needed <= have else max(needed, 2 * have)
        guess = min(int(needed / max(share, 1 / _MOST_TIMES)), self._most)
        if max(guess, needed) <= have:
            return have
        return max(guess * 11 // 10, needed * 5 // 4)
