"""How long to make arrays that grow while a recording is read.

Why not double them, as lists do? Every doubling copies what is there. The share of the recording that
was read foretells the final length, and memory that is reserved but never written to costs nothing.
"""

from __future__ import annotations

__all__ = ["GrowthForecast"]

_MOST_TIMES = 64
"""Room is made for at most this many times the elements so far: a memory limit counts reserved room."""
_AGAIN = 8
"""The forecast is renewed once there are this many times as many elements: it is better then, and copying
the few elements so far is cheap."""


class GrowthForecast:
    """Forecasts the length of one array from the share of the recording that was read.

    Args:
        most: The longest forecast, in elements.
    """

    def __init__(self, most: int) -> None:
        self._most, self._again_at = most, 0

    def length(self, needed: int, have: int, share: float) -> int:
        """How long an array of length `have` should be that `needed` elements must fit into.

        Args:
            needed: Elements so far.
            have: Its length, which is kept while it suffices.
            share: The share of the recording that was read, 0 to 1; 0 when not known.
        """
        if needed <= min(have, self._again_at):
            return have
        self._again_at = _AGAIN * needed
        if share <= 0:  # a reader that cannot tell how far it is: double
            return have if needed <= have else max(needed, 2 * have)
        guess = min(int(needed / max(share, 1 / _MOST_TIMES)), self._most)
        if max(guess, needed) <= have:
            return have
        # A tenth more than the forecast: messages come more densely in some parts of a recording.
        return max(guess * 11 // 10, needed * 5 // 4)
