"""Trials made so that a monitor has to decide: its own quantities low, high, sweeping, noisy, with a gap.

A monitor that is only ever tried where it cannot decide has not been tried at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import islice, product
from typing import Any

import numpy as np

from ariac_score.checks.contracts import SignalNeed
from ariac_score.checks.registry import parameters_of
from ariac_score.testing.made import made_trial
from ariac_score.trial.events import Event
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of

__all__ = ["MOST_TRIALS", "forced_trials"]

MOST_TRIALS = 64
"""How many trials are made before a monitor is taken for one that never decides so."""

_LONGEST_S = 120.0
_FINEST_S, _COARSEST_S = 0.005, 0.1
_COMBINED = 4
"""So many quantities are low and high in every combination; more of them only all alike."""

Shape = Callable[[FloatArray, float, float, int], FloatArray]


def _low(t: FloatArray, low: float, _high: float, _k: int) -> FloatArray:
    return np.full_like(t, low)


def _high(t: FloatArray, _low: float, high: float, _k: int) -> FloatArray:
    return np.full_like(t, high)


def _sweeping(t: FloatArray, low: float, high: float, k: int) -> FloatArray:
    phase = np.mod((t - t[0]) / (11.0 + k), 1.0)
    swept: FloatArray = low + (high - low) * (1.0 - np.abs(2.0 * phase - 1.0))
    return swept


def _noisy(t: FloatArray, low: float, high: float, k: int) -> FloatArray:
    return np.random.default_rng(k).uniform(low, high, len(t))


def forced_trials(check: Any, needs: Sequence[SignalNeed], given: Trial) -> Iterator[Trial]:
    """The trials, the plainest first; at most `MOST_TRIALS`.

    Args:
        check: Whose parameters say which numbers are interesting, and which events.
        needs: Its signals; those that no vocabulary knows are made for every body, link and pair.
        given: Whose bodies, events and work they have, unless it has no bodies or is very long.
    """
    return islice(_forced(check, needs, given), MOST_TRIALS)


def _forced(check: Any, needs: Sequence[SignalNeed], given: Trial) -> Iterator[Trial]:
    whole = given.bodies and given.recorded and given.recorded.duration_s <= _LONGEST_S
    base = _with_events(given if whole else made_trial(), check)
    yield base
    numbers = _parameters(check)
    units = dict.fromkeys(need.unit for need in needs)
    combined = len(needs) if len(needs) <= _COMBINED else 1
    for stage in range(3):
        levels = {unit: _levels(numbers.get(unit, ()), stage) for unit in units}
        for extremes in product((_low, _high), repeat=combined):
            shapes = extremes if combined == len(needs) else extremes * len(needs)
            yield _made(base, needs, shapes, levels)
        yield _made(base, needs, [_sweeping] * len(needs), levels)
        yield _made(base, needs, [_noisy] * len(needs), levels)
        yield _made(base, needs, [_sweeping] * len(needs), levels, gap=True)


def _parameters(check: Any) -> Mapping[str, list[float]]:
    """The numbers among the parameters of a check, by unit."""
    found: dict[str, list[float]] = {}
    for name, parameter in parameters_of(type(check)).items():
        value = getattr(check, name, None)
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, int | float) and not isinstance(number, bool) and math.isfinite(number):
                found.setdefault(parameter.facts.unit, []).append(float(number))
    return found


def _levels(numbers: Collection[float], stage: int) -> tuple[float, float]:
    """Two levels of a quantity: far from its limits, just beyond them, on both sides of nothing."""
    least, most = min(numbers, default=1.0), max(numbers, default=1.0)
    largest = max(abs(least), abs(most), 1e-3)
    far = (min(0.0, 2 * least), 10 * largest)
    near = (least - 0.1 * largest, most + 0.1 * largest)
    return (far, near, (-10 * largest, 1000 * largest))[stage]


def _with_events(trial: Trial, check: Any) -> Trial:
    """The trial with an event of every kind that a parameter of a check may name."""
    words = {
        word
        for name in parameters_of(type(check))
        for value in [getattr(check, name, None)]
        for word in (value if isinstance(value, tuple) else (value,))
        if isinstance(word, str) and word
    }
    events = (Event(20.0 + k / 100, word, "robot") for k, word in enumerate(sorted(words)))
    return replace(
        trial, events=tuple(sorted((*trial.events, *events))), witnessed=trial.witnessed | frozenset(words)
    )


def _made(
    base: Trial,
    needs: Sequence[SignalNeed],
    shapes: Sequence[Shape],
    levels: Mapping[str, tuple[float, float]],
    *,
    gap: bool = False,
) -> Trial:
    """The trial with signals of these shapes in place of its own."""
    assert base.recorded is not None
    step_s = min([_COARSEST_S, *(need.max_gap_s / 2 for need in needs if need.max_gap_s > 0)])
    t = np.arange(base.recorded.start_s, base.recorded.end_s, max(step_s, _FINEST_S))
    if gap:
        t = t[(t < t[0] + 10.0) | (t > t[0] + 12.0)]
    signals = {}
    for need, shape in zip(needs, shapes, strict=True):
        for k, name in enumerate(_names(base, need.quantity)):
            signals[name] = _signal(name, need, t, shape, levels[need.unit], k)
    return replace(base, signals=signals)


def _signal(
    name: str, need: SignalNeed, t: FloatArray, shape: Shape, levels: tuple[float, float], k: int
) -> Signal:
    known = QUANTITIES.get(need.quantity)
    low, high = levels if need.unit != "1" else (0.0, 1.0)
    least = -math.inf if known is None else known.at_least
    values = np.maximum(shape(t, low, high, k), least)
    if known is None or known.components == 1:
        return Signal(name, need.unit, t, values)
    # Bodies one behind the other: the same number for all of them would put them in one place.
    columns = [k * values, *([np.zeros(len(t))] * (known.components - 1))]
    return Signal(name, need.unit, t, np.stack(columns, axis=1))


def _names(trial: Trial, quantity: str) -> list[str]:
    """The signals of a quantity; of one that no vocabulary knows, one for whatever it may belong to."""
    known = [name for name in trial.signals if quantity_of(name) == quantity]
    if known:
        return known
    points = [point for body in trial.bodies for point in (body.id, *(f"{body.id}::{k}" for k in body.links))]
    pairs = [
        f"{first.id}/{second.id}" for first in trial.bodies for second in trial.bodies if first != second
    ]
    return [f"{quantity}/{subject}" for subject in (*points, *pairs)]
