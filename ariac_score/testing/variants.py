"""Trials changed in one respect each: what the contract checks try a plugin with."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.model import Trial
from ariac_score.trial.shift import shifted
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vocabulary import quantity_of

__all__ = ["SIGNAL_VARIANTS", "bare", "only", "reordered", "shifted", "without"]


def reordered(trial: Trial) -> Trial:
    """The same signals and bodies, listed the other way round."""
    return replace(
        trial,
        signals=dict(reversed([*trial.signals.items()])),
        as_consumed=dict(reversed([*trial.as_consumed.items()])),
        bodies=tuple(reversed(trial.bodies)),
    )


def without(trial: Trial, quantities: Iterable[str]) -> Trial:
    """The trial without the signals of some quantities."""
    gone = frozenset(quantities)
    return replace(
        trial,
        signals={n: s for n, s in trial.signals.items() if quantity_of(n) not in gone},
        as_consumed={n: s for n, s in trial.as_consumed.items() if quantity_of(n) not in gone},
    )


def only(trial: Trial, quantities: Iterable[str]) -> Trial:
    """The trial with the signals of some quantities alone."""
    kept = frozenset(quantities)
    return without(trial, {quantity_of(one.name) for one in trial.sampled} - kept)


def bare(trial: Trial) -> Trial:
    """A trial of which only the time of the recording is known."""
    return Trial(trial.id, recorded=trial.recorded, clocks=trial.clocks)


# What recorders do to signals ----------------------------------------------------------

_Samples = tuple[FloatArray, FloatArray]


def _recorded(trial: Trial, change: Callable[[FloatArray, FloatArray], _Samples]) -> Trial:
    """The trial as it would be read had its signals been recorded with a fault."""
    # By the builder of the readers, so that repeated stamps and NaN are settled as in a real log.
    builder = TrialBuilder(trial.id, file=trial.id, clock=next(iter(trial.clocks), None))
    for name, signal in trial.signals.items():
        builder.add_signal(name, signal.unit, *change(signal.t, signal.values))
    return replace(trial, signals=builder.signals)


def _with_nan(t: FloatArray, values: FloatArray) -> _Samples:
    """Every third sample is NaN, and a second of them infinite."""
    changed = values.copy()
    changed[::3] = np.nan
    if len(t):
        changed[(t > t[0] + 5.0) & (t < t[0] + 6.0)] = np.inf
    return t, changed


def _with_gaps(t: FloatArray, values: FloatArray) -> _Samples:
    """Two holes of two seconds."""
    since = t - t[0] if len(t) else t
    kept = ((since < 3.0) | (since > 5.0)) & ((since < 19.0) | (since > 21.0))
    return t[kept], values[kept]


def _hollow(t: FloatArray, values: FloatArray) -> _Samples:
    """The first and the last sample alone."""
    return (t, values) if len(t) < 2 else (t[[0, -1]], values[[0, -1]])


def _single(t: FloatArray, values: FloatArray) -> _Samples:
    return t[:1], values[:1]


def _with_repeats(t: FloatArray, values: FloatArray) -> _Samples:
    """Every stamp twice, every tenth time with another value."""
    doubled = np.repeat(values, 2, axis=0)
    doubled[1::20] += 0.5
    return np.repeat(t, 2), doubled


def _empty(trial: Trial) -> Trial:
    """Signals without samples. Made by hand: the builder leaves such signals out."""
    empty = {
        name: Signal(name, signal.unit, signal.t[:0], signal.values[:0])
        for name, signal in trial.signals.items()
    }
    return replace(trial, signals=empty)


SIGNAL_VARIANTS: Mapping[str, Callable[[Trial], Trial]] = {
    "nan": lambda trial: _recorded(trial, _with_nan),
    "gaps": lambda trial: _recorded(trial, _with_gaps),
    "first_and_last_sample": lambda trial: _recorded(trial, _hollow),
    "single_sample": lambda trial: _recorded(trial, _single),
    "empty_signal": _empty,
    "repeated_stamps": lambda trial: _recorded(trial, _with_repeats),
}
"""Faults of recorders by name."""

HOLLOW = frozenset({"first_and_last_sample", "single_sample", "empty_signal"})
"""Faults that leave too few samples to decide anything by."""
