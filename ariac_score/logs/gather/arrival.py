"""How late times of recording are: what the messages of a topic that nobody stamped show of it themselves."""

from __future__ import annotations

import numpy as np

from ariac_score.trial.spans import FloatArray

__all__ = ["arrival_delays_s", "arrival_jitter_s"]

_WINDOW = 64
"""Within so many messages a late one is made up for; beyond, the period may just be another one."""

_FEWEST = 8


def arrival_jitter_s(t: FloatArray) -> float:
    """By how much messages of a regular publisher arrived late, s; a delay that all have shows nowhere.

    A message that comes late is followed by others that come early against it. A pause that nothing makes up
    for is no delay: there, messages were not sent, or are missing.

    Args:
        t: Times of recording, increasing, shape (n,), s.

    Returns:
        The most that was made up for; 0 where there are too few messages to say.

    >>> on_time = np.arange(40) / 100
    >>> late = on_time.copy()
    >>> late[20:23] = 0.2365
    >>> round(arrival_jitter_s(late), 6), arrival_jitter_s(on_time) < 1e-9
    (0.0365, True)
    """
    made_up = float(arrival_delays_s(t).max(initial=0.0))
    # Made up from message to message: what is less than a microsecond is rounding of stamps.
    return made_up if made_up > 1e-6 else 0.0


def arrival_delays_s(t: FloatArray) -> FloatArray:
    """By how much each message of a regular publisher arrived late, shape (n,), s.

    Args:
        t: Times of recording, increasing, shape (n,), s.

    Returns:
        What later messages made up for; 0 everywhere where there are too few messages to say.
    """
    if len(t) < _FEWEST:
        return np.zeros(len(t))
    steps = np.diff(t)
    behind = np.concatenate(([0.0], np.cumsum(steps - np.median(steps))))
    padded = np.concatenate((behind, np.full(_WINDOW, np.inf)))
    least = np.lib.stride_tricks.sliding_window_view(padded, _WINDOW + 1).min(axis=1)
    delays_s: FloatArray = behind - least
    return delays_s
