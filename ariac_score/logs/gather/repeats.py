"""Messages that say again what the one before said, of topics that are published at each step.

A state a thousand times a second costs more than all the rest of a recording, and only its changes matter.
"""

from __future__ import annotations

import numpy as np

from ariac_score.logs.columnar.message_buffer import Waiting
from ariac_score.logs.containers.items import IntArray

__all__ = ["EVERY_S", "changed"]

EVERY_S = 0.5
"""Of messages that repeat each other one is kept so often, so that a pause is seen as one."""

_LONGEST_BYTES = 64
"""Longer messages are no words of a state."""


def changed(messages: Waiting) -> IntArray:
    """The places of messages that say something new, of the last before each, and of one each half second.

    Args:
        messages: Of one connection, in recorded order.
    """
    starts, ends = messages.payloads.starts, messages.payloads.ends
    sizes = ends - starts
    width = int(sizes.max(initial=0))
    if len(sizes) < 2 or width > _LONGEST_BYTES:  # one alone repeats nothing
        return np.arange(len(sizes))
    places = starts[:, None] + np.arange(width)
    inside = places < ends[:, None]
    texts = np.where(inside, messages.payloads.buffer[np.where(inside, places, 0)], 0)
    new = (sizes[1:] != sizes[:-1]) | (texts[1:] != texts[:-1]).any(axis=1)
    parts = messages.stamps_ns // int(EVERY_S * 1e9)
    kept = np.ones(len(sizes), dtype=bool)  # the first and the last: nobody knows what is beside them
    kept[1:-1] = new[:-1] | new[1:] | (parts[1:-1] != parts[:-2])
    found: IntArray = np.flatnonzero(kept)
    return found
