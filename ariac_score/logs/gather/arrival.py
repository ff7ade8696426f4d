"""How late times of recording are: what the messages of a topic that nobody stamped show of it themselves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray, Span, within_spans
from ariac_score.trial.window import ends_of

__all__ = ["LONGEST_DELAY_S", "arrival_delays_s", "arrival_jitter_s", "late_in_the_competition"]

_WINDOW = 64
"""Within so many messages a late one is made up for; beyond, the period may just be another one."""

_FEWEST = 8

LONGEST_DELAY_S = 0.25
"""Of a longer pause nobody assumes that it was a delay, unless others made up for it, s.

Our choice: twice the 0.12 s that a recorder on a loaded machine was seen to stand still.
"""


def arrival_jitter_s(t: FloatArray) -> float:
    """By how much messages of a regular publisher may have come late, s; a delay of all shows nowhere.

    A message that comes late is followed by others that come early against it: so late it was. One that comes
    after a pause may have been on its way for all of it, whether or not the next make up for that, for those
    that would show it can be left out of a recording. So what is left out makes nothing look less late, as
    long as no message was later than the longest interval, which takes a stall or a burst, not a drift.

    Args:
        t: Times of recording, increasing, shape (n,), s.

    Returns:
        The most that was made up for, or the longest interval up to `LONGEST_DELAY_S` where that is more; 0
        where there is no interval.

    >>> on_time = np.arange(40) / 100
    >>> late = on_time.copy()
    >>> late[20:23] = 0.2365
    >>> round(arrival_jitter_s(late), 6), round(arrival_jitter_s(on_time), 6)
    (0.0465, 0.01)
    """
    longest_s = float(np.diff(t).max(initial=0.0))
    return max(float(arrival_delays_s(t).max(initial=0.0)), min(longest_s, LONGEST_DELAY_S))


def late_in_the_competition(trial: Trial) -> Trial:
    """The trial with the lateness of stamps that its messages show within the competition.

    What came before or after it can be cut off a recording, and would be where it shows a delay. The silence
    from the start to the first message, and from the last one to the end, is an interval as any other.
    """
    ends, window = ends_of(trial), trial.window
    if ends is not None:
        window = Span(ends.start.start_s, ends.end.end_s)
    if window is None:
        return trial
    within = window
    return replace(trial, signals={name: _late_in(one, within) for name, one in trial.signals.items()})


def _late_in(signal: Signal, window: Span) -> Signal:
    if not signal.stamp_jitter_s:
        return signal  # senders stamped it
    t = signal.t[(signal.t >= window.start_s) & (signal.t <= window.end_s)]
    edges = np.concatenate(([window.start_s], t, [window.end_s]))
    # What is not believed came all the same: where it was left out, nothing was silent.
    left_out = [hole for hole in signal.holes if hole.duration_s > LONGEST_DELAY_S]
    left_out += [one.span for one in signal.disbelieved]
    came = ~within_spans((edges[1:] + edges[:-1]) / 2, left_out)
    silence_s = np.diff(edges)[came]
    made_up_for_s = float(arrival_delays_s(t).max(initial=0.0))
    return replace(
        signal, stamp_jitter_s=max(made_up_for_s, min(float(silence_s.max(initial=0.0)), LONGEST_DELAY_S))
    )


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
