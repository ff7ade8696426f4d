"""What a page shows of a cable insertion over time: force, speed, jerk, and the height of the plug."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ariac_score import Chart, FloatArray, Signal, Trial
from ariac_score_aic.chains import first_of_each
from ariac_score_aic.signals import PLUG, PORT, TOOL

__all__ = ["of_force", "of_height", "of_jerk", "of_speed"]

_GAP_S = 0.5
"""A longer pause between samples is drawn as one; decides nothing."""


def of_force(trial: Trial, threshold_n: float) -> Iterator[Chart]:
    """The force at the wrist with its threshold."""
    yield from _of(trial.signals.get(f"wrist_force/{TOOL}"), "force at the wrist", threshold_n)


def of_speed(trial: Trial) -> Iterator[Chart]:
    """The speed of the tool."""
    yield from _of(trial.signals.get(f"tcp_speed/{TOOL}"), "speed of the tool")


def of_jerk(t_s: FloatArray, jerk_m_s3: FloatArray) -> Iterator[Chart]:
    """The jerk of the tool around each sample that counts, in the order of time."""
    times, first = first_of_each(t_s)
    kept = jerk_m_s3[first]
    finite = np.isfinite(kept)
    if finite.any():
        yield from _chart("jerk of the tool", "m/s^3", times[finite], kept[finite], None)


def of_height(trial: Trial) -> Iterator[Chart]:
    """How high the plug is above its port."""
    plug, port = (trial.signals.get(f"position/{name}") for name in (PLUG, PORT))
    if plug is None or port is None:
        return
    t_s = plug.t[(plug.t >= port.t[0]) & (plug.t <= port.t[-1])]
    if len(t_s):
        height_m = [np.interp(t_s, one.t, one.values[:, 2]) for one in (plug, port)]
        yield from _chart("height of the plug above its port", "m", t_s, height_m[0] - height_m[1], None)


def _of(signal: Signal | None, what: str, limit: float | None = None) -> Iterator[Chart]:
    if signal is not None:
        yield from _chart(what, signal.unit, signal.t, signal.values, limit)


def _chart(what: str, unit: str, t_s: FloatArray, values: FloatArray, limit: float | None) -> Iterator[Chart]:
    limits = np.full(len(t_s), np.nan if limit is None else limit)
    yield Chart(TOOL, what, unit, t_s, values, limits, at_most=True, max_gap_s=_GAP_S)
