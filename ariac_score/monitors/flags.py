"""What stays as it is until it changes: flags and modes, and what is published and not in a log."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ariac_score.monitors.cells import TOLERANCE_S, shown_within_s, usual_interval_s
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import BoolArray, FloatArray, Span
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of

__all__ = [
    "OFF",
    "ON",
    "State",
    "flag_times",
    "found_or_due",
    "lacking_signal",
    "shown_times",
    "stands_s",
    "state_over",
    "unknown_spans",
]


def found_or_due(trial: Trial, name: str) -> Signal | None:
    """A signal; without samples where its organiser says that it is published, and it is not there.

    `None`: nobody says so.
    """
    found, due = trial.signals.get(name), trial.stand_ins.get(name)
    if found is not None and len(found):
        return found
    if due is None or trial.between is None:
        return None
    return replace(lacking_signal(name), source=due.topic, stated_rate_hz=due.rate_hz)


def lacking_signal(name: str, unit: str = "") -> Signal:
    """A signal without samples."""
    quantity = QUANTITIES.get(quantity_of(name))
    components = 1 if quantity is None else quantity.components
    values = np.empty((0, components) if components > 1 else 0)
    return Signal(name, unit or (quantity.unit if quantity else ""), np.empty(0), values)


@dataclass(frozen=True)
class State:
    """Whether something is on, at each of some times.

    Attributes:
        on: Whether it is on, shape (n,); off where it is not known.
        known: Whether the log shows it, shape (n,).
    """

    on: BoolArray
    known: BoolArray


ON, OFF = "on", "off"


def state_over(trial: Trial, name: str, body: str, t: FloatArray, *, max_age_s: float) -> State | None:
    """A flag over time: from the signal `name/body`, else from events of that kind.

    A signal's value holds until its next sample, for `max_age_s` at most. Between two that are much further
    apart than usual it is unknown, for who left out what was between would choose it. An event
    has the detail `on` or `off` and holds until the next; before the first event the
    state was the opposite one. An event with neither detail leaves the state unknown. A
    log that records such events but has none shows a flag that was never on.

    Args:
        trial: The trial.
        name: Quantity and event kind, such as `drive_enabled`.
        body: Id of the body; events without a subject concern every body.
        t: The times, shape (n,), s.
        max_age_s: How long a sample of the signal holds at most, s.

    Returns:
        The state, or `None` when the log has neither.

    Raises:
        MissingSignalError: The flag is there as consumed only.
    """
    signal = trial.find_signal(f"{name}/{body}")
    if signal is not None and len(signal):
        # A flag stamped at the same instant counts, though both stamps may differ in their last bits.
        before = np.searchsorted(signal.t, t + TOLERANCE_S, side="right") - 1
        held = before.clip(0)
        # The next one, or itself at its own instant; the last one stands for as long as others.
        behind = np.append(signal.t, np.inf)[np.searchsorted(signal.t, t - TOLERANCE_S, side="left")]
        within_s = stands_s(trial, signal, max_age_s) + TOLERANCE_S
        lasts_s = np.where(np.isinf(behind), t, behind) - signal.t[held]
        known = (before >= 0) & (lasts_s <= within_s)
        return State(known & (signal.values[held] >= 0.5), known)
    if found_or_due(trial, f"{name}/{body}") is not None:
        return State(np.zeros(len(t), dtype=bool), np.zeros(len(t), dtype=bool))
    events = [e for e in trial.events_of(name) if e.subject in ("", body)]
    if not events and name not in trial.witnessed:
        return None
    if not events:
        return State(np.zeros(len(t), dtype=bool), np.ones(len(t), dtype=bool))
    times = np.array([e.t_s for e in events])
    earlier = OFF if events[0].detail == ON else ON if events[0].detail == OFF else ""
    words = np.array([earlier, *(event.detail for event in events)])
    word = words[np.searchsorted(times, t, side="right")]
    return State(word == ON, (word == ON) | (word == OFF))


def shown_times(signal: Signal, max_gap_s: float) -> FloatArray:
    """When a signal that helps shows something, and just behind each sample from which on it does not, s."""
    far = np.diff(signal.t) > shown_within_s(signal, max_gap_s) + TOLERANCE_S
    return np.concatenate([signal.t, signal.t[:-1][far] + 2.0 * TOLERANCE_S])


def flag_times(trial: Trial, flag: str, body: str) -> FloatArray:
    """When the log shows a flag, in time order, s: at its samples, or where it has none at events."""
    signal = trial.find_signal(f"{flag}/{body}")
    if signal is not None and len(signal):
        return signal.t
    return np.array([event.t_s for event in trial.events_of(flag) if event.subject in ("", body)])


def stands_s(trial: Trial, signal: Signal, max_age_s: float) -> float:
    """How long a sample of a flag stands at most, s.

    Where every interval is bounded, and nobody states how often it is published, a sample shows its own
    instant alone: who leaves out samples evenly would choose what is usual.
    """
    every = trial.between is not None and trial.between.every
    return 0.0 if every and not signal.stated_rate_hz else shown_within_s(signal, max_age_s)


def unknown_spans(signal: Signal, window: Span, stands_s: float) -> list[Span]:
    """Where in a competition the signal of a flag does not show it, as `state_over` has it."""
    if not len(signal):
        return [window]
    edges = np.concatenate(([-np.inf], signal.t, [np.inf]))
    starts, ends = np.maximum(edges[:-1], window.start_s), np.minimum(edges[1:], window.end_s)
    longest_s = np.full(len(starts), stands_s)
    longest_s[0] = 0.0  # nothing stands for what was before the first
    whole = np.diff(edges)
    whole[-1] = window.end_s - edges[-2]
    # A whole interval before the end a sample lacks.
    longest_s[-1] = min(longest_s[-1], usual_interval_s(signal) - 2 * TOLERANCE_S)
    rows = np.flatnonzero((ends - starts > TOLERANCE_S) & (whole > longest_s + TOLERANCE_S))
    return [Span(float(starts[row]), float(ends[row])) for row in rows]
