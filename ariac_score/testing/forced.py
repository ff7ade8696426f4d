"""Trials made so that a monitor has to decide: its own quantities low, high, sweeping, noisy, with a gap.

A monitor that is only ever tried where it cannot decide has not been tried at all. What it needs, and what
its parameters name, is all that is known of it: their numbers are levels, their points and polygons are
places, their words may be kinds of bodies, links or events. What stands in its code alone it brings
itself, by `example_trials`.
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
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vocabulary import ENVIRONMENT, QUANTITIES, Quantity, quantity_of
from ariac_score.trial.work import WorkItem

__all__ = ["MOST_TRIALS", "forced_trials"]

MOST_TRIALS = 120
"""How many trials are made before a monitor is taken for one that never decides so."""

_SHORTEST_S, _LONGEST_S = 35.0, 120.0
_FINEST_S, _COARSEST_S = 0.005, 0.1
_COMBINED = 4
"""So many quantities are low and high in every combination; more of them only all alike."""
_MOST_PLACES, _MOST_WORDS = 6, 4
_AXES, _PASSES_M = 3, 10.0
_BOUNDS = (COMPETITION_STARTED, COMPETITION_ENDED)
"""Events that say when a trial begins and ends: those of another trial would move its window."""

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
        check: Whose parameters say which numbers, places and words are interesting.
        needs: Its signals; those that no vocabulary knows are made for every body, link and pair.
        given: Whose bodies, events and work they have, unless it has no bodies, is very short or very long.
    """
    return islice(_forced(check, needs, given), MOST_TRIALS)


def _forced(check: Any, needs: Sequence[SignalNeed], given: Trial) -> Iterator[Trial]:
    span = given.recorded
    whole = given.bodies and span is not None and _SHORTEST_S <= span.duration_s <= _LONGEST_S
    words = _words(check)
    base = _peopled(given if whole else made_trial(), words)
    yield base
    yield replace(base, events=tuple(event for event in base.events if event.kind not in words))
    if not needs:
        return
    numbers = _parameters(check)
    units = dict.fromkeys(need.unit for need in needs)
    for stage in range(3):
        levels = {unit: _levels(numbers.get(unit, ()), stage) for unit in units}
        for shapes in _shapes(len(needs)):
            yield _made(base, needs, shapes, levels)
        yield _made(base, needs, [_sweeping] * len(needs), levels, gap=True)
        if stage == 0:
            for place in _places(check):
                for shapes in ([_low], [_high], [_sweeping]):
                    for passing in (False, True):
                        yield _made(base, needs, shapes * len(needs), levels, place=place, passing=passing)


def _shapes(number: int) -> Iterator[Sequence[Shape]]:
    """What so many quantities do: low and high in every combination, if they are few; then all alike."""
    combined = number if number <= _COMBINED else 1
    for extremes in product((_low, _high), repeat=combined):
        yield extremes if combined == number else extremes * number
    yield [_sweeping] * number
    yield [_noisy] * number


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


def _places(check: Any) -> list[tuple[float, ...]]:
    """The points among the parameters of a check, the middle of each polygon, and the middle of them all."""
    found: list[tuple[float, ...]] = []
    for name in parameters_of(type(check)):
        _collect_places(getattr(check, name, None), found)
    places = list(dict.fromkeys(found))[:_MOST_PLACES]
    return [*places, _middle(places)] if len(places) > 1 else places


def _collect_places(value: Any, found: list[tuple[float, ...]]) -> None:
    """Add the places a parameter names: a point, a list of points by its middle, or several such lists."""
    if not isinstance(value, tuple) or not value:
        return
    if _is_point(value):
        found.append(tuple(float(number) for number in value))
    elif all(_is_point(corner) for corner in value):
        found.append(_middle(value))
    else:
        for inner in value:
            _collect_places(inner, found)


def _is_point(value: Any) -> bool:
    return (
        isinstance(value, tuple)
        and len(value) in (2, 3)
        and all(
            isinstance(number, int | float) and not isinstance(number, bool) and math.isfinite(number)
            for number in value
        )
    )


def _middle(points: Sequence[Sequence[float]]) -> tuple[float, ...]:
    return tuple(sum(axis) / len(axis) for axis in zip(*points, strict=False))


def _words(check: Any) -> list[str]:
    """The texts among the parameters of a check: any may name an event, a kind of body or a link."""
    values = (getattr(check, name, None) for name in parameters_of(type(check)))
    words = (word for value in values for word in (value if isinstance(value, tuple) else (value,)))
    return sorted({word for word in words if isinstance(word, str) and word})[:_MOST_WORDS]


def _items(work: Sequence[WorkItem]) -> Iterator[str]:
    """The ids of every item of work."""
    for item in work:
        yield item.id
        yield from _items(item.items)


def _peopled(trial: Trial, words: Sequence[str]) -> Trial:
    """The trial with two bodies of every kind, each with every link, and with events of every kind."""
    assert trial.recorded is not None
    made = made_trial()
    links = {link for body in made.bodies for link in body.links} | set(words)
    bodies = list(trial.bodies)
    for kind in sorted({body.kind for body in (*bodies, *made.bodies)} | set(words)):
        lacking = 2 - len(trial.bodies_of(kind))
        bodies += [Body(f"{kind}_forced_{number + 1}", kind, radius_m=0.5) for number in range(lacking)]
    bodies = [replace(body, links=tuple(sorted({*body.links, *links}))) for body in bodies]
    known = {event.kind for event in trial.events}
    about = [next((body.id for body in bodies if body.kind == "robot"), bodies[0].id), *_items(trial.work)]
    events = [Event(20.0 + k / 100, *named) for k, named in enumerate(product(words, about))]
    events += [event for event in made.events if event.kind not in {*known, *_BOUNDS}]
    shifted = [replace(event, t_s=event.t_s + trial.recorded.start_s) for event in events]
    return replace(
        trial,
        bodies=tuple(sorted(bodies, key=lambda body: body.id)),
        events=tuple(sorted((*trial.events, *shifted))),
        witnessed=trial.witnessed | {event.kind for event in events},
    )


def _made(
    base: Trial,
    needs: Sequence[SignalNeed],
    shapes: Sequence[Shape],
    levels: Mapping[str, tuple[float, float]],
    *,
    place: tuple[float, ...] = (),
    passing: bool = False,
    gap: bool = False,
) -> Trial:
    """The trial with signals of these shapes in place of its own; everybody at a place, if one is given."""
    assert base.recorded is not None
    step_s = min([_COARSEST_S, *(need.max_gap_s / 2 for need in needs if need.max_gap_s > 0)])
    t = np.arange(base.recorded.start_s, base.recorded.end_s, max(step_s, _FINEST_S))
    if gap:
        t = t[(t < t[0] + 10.0) | (t > t[0] + 12.0)]
    signals = {}
    for need, shape in zip(needs, shapes, strict=True):
        known = QUANTITIES.get(need.quantity)
        for k, name in enumerate(_names(base, need.quantity)):
            if known is not None and known.components == _AXES and place and need.unit == "m":
                values = _at(place, t, passing=passing)
            else:
                values = _values(known, need, t, shape, levels[need.unit], k)
            signals[name] = Signal(name, need.unit, t, values)
    return replace(base, signals=signals)


def _values(
    known: Quantity | None,
    need: SignalNeed,
    t: FloatArray,
    shape: Shape,
    levels: tuple[float, float],
    k: int,
) -> FloatArray:
    """The values of the `k`-th signal of a quantity, shape (n,) or (n, components)."""
    low, high = levels if need.unit != "1" else (0.0, 1.0)
    least = -math.inf if known is None else known.at_least
    values: FloatArray = np.maximum(shape(t, low, high, k), least)
    if known is None or known.components == 1:
        return values
    # Bodies one behind the other: the same number for all of them would put them in one place.
    return np.stack([k * values, *([np.zeros(len(t))] * (known.components - 1))], axis=1)


def _at(place: tuple[float, ...], t: FloatArray, *, passing: bool) -> FloatArray:
    """A body that stays at a place, or walks through it from one side to the other, shape (n, 3), in m."""
    values = np.tile(np.array([*place, 0.0][:_AXES]), (len(t), 1))
    if passing:
        values[:, :2] += np.linspace(-_PASSES_M, _PASSES_M, len(t))[:, np.newaxis]
    return values


def _names(trial: Trial, quantity: str) -> list[str]:
    """The signals of a quantity: those of the trial, and one for whatever else it may belong to."""
    recorded = [name for name in trial.signals if quantity_of(name) == quantity]
    known = QUANTITIES.get(quantity)
    if known is not None and known.of == ENVIRONMENT:
        return list(dict.fromkeys([*recorded, f"{quantity}/{ENVIRONMENT}"]))
    subjects: list[str] = []
    if known is None or known.of == "body":
        subjects += [
            point for body in trial.bodies for point in (body.id, *(f"{body.id}::{k}" for k in body.links))
        ]
    if known is None or known.of == "pair":
        subjects += [
            f"{first.id}/{second.id}" for first in trial.bodies for second in trial.bodies if first != second
        ]
    return list(dict.fromkeys([*recorded, *(f"{quantity}/{subject}" for subject in subjects)]))
