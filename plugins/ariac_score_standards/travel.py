"""Distances that bodies cover: speeds, integrated."""

from __future__ import annotations

import numpy as np

from ariac_score import FloatArray, Span, exact_sum


def travelled_m(t: FloatArray, speed_m_s: FloatArray, span: Span) -> float:
    """The way covered during a span, by straight lines between the samples of a speed, m.

    Speeds inside the span alone count: where samples do not reach its ends, those
    ends add nothing.

    >>> travelled_m(np.array([0.0, 1.0, 2.0]), np.array([1.0, 1.0, 0.0]), Span(0.5, 2.0))
    1.0
    """
    if not len(t):
        return 0.0
    start, end = np.clip([span.start_s, span.end_s], t[0], t[-1])
    inside = t[(t > start) & (t < end)]
    at = np.concatenate(([start], inside, [end]))
    speeds = np.interp(at, t, speed_m_s)
    return exact_sum(np.diff(at) * (speeds[1:] + speeds[:-1]) / 2.0)
