"""Which samples of a signal can be believed: what contradicts itself is unknown, never fine.

Samples that cannot be believed are left out, and the stretch between the believed ones around them becomes
a hole of the signal, however short it is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import dist

import numpy as np

from ariac_score.trial.denied import denied
from ariac_score.trial.model import Body, LogDefect
from ariac_score.trial.signals import Disbelieved, Signal
from ariac_score.trial.spans import BoolArray, FloatArray, Span, merged
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of, subject_of

__all__ = [
    "FASTEST_CLOSING_M_S",
    "Replay",
    "believed",
    "holes_around",
    "jumps",
    "replays",
    "without_contested",
]

FASTEST_CLOSING_M_S = 10.0
"""The distance of a robot and a person changes no faster: twice the speed above which a step is a jump."""

FASTEST_OF_ANY_M_S = 100.0
"""The same of two bodies of any kind."""

_LEAST_NOISE_M, _MOST_NOISE_M = 0.1, 0.5
"""A step may be longer by so much than anything moves, for a camera has noise, and a scale has steps, m."""

_NOISE_OF_CURVATURE = 2.0
"""White noise changes a step by less than this times what it changes nineteen of twenty steps by."""

_SPEED_STEP_M_S, _GREATEST_ACCELERATION_M_S2 = 5.0, 100.0
"""A speed that steps by more than the first, and faster than the second, is none of a robot or a person."""

_KNOWN_KINDS = frozenset({"robot", "human"})

REPLAYED_SAMPLES, REPLAYED_S = 50, 1.0
"""So many samples over so long a time do not come back to the last bit, unless they were copied."""

_SAME_LAG_S = 0.1
"""Topics are sampled at instants of their own."""

_LEAST_CHANGES = REPLAYED_SAMPLES // 2
"""What mostly stands still says nothing by being as it was."""

_ODD = 0x9E3779B97F4A7C15
"""2^64 divided by the golden ratio, a usual multiplier of hashes: odd, so that it has an inverse."""

_TABLE_BITS = 20


def without_contested(
    t: FloatArray, values: FloatArray, contested: Sequence[Span]
) -> tuple[FloatArray, FloatArray, tuple[Disbelieved, ...]]:
    """The samples outside stretches that are contested, ends included, and what was left out for that.

    Each publisher may be right there, so neither what one of them says before nor after bounds it. Which of
    them has the first and the last word is chance, so the samples right beside are contested as well.
    """
    contested = [_with_neighbours(t, span) for span in contested]
    dropped = np.zeros(len(t), dtype=bool)
    for span in contested:
        dropped |= (t >= span.start_s) & (t <= span.end_s)
    kept, left_out = t[~dropped], []
    for span in merged(contested):
        # Also where none is left to drop: samples of one instant that differ have dropped each other.
        rows = (t >= span.start_s) & (t <= span.end_s)
        before, after = np.searchsorted(kept, span.start_s), np.searchsorted(kept, span.end_s, side="right")
        start_s = float(kept[before - 1]) if before else span.start_s
        end_s = float(kept[after]) if after < len(kept) else span.end_s
        at_s = float(t[np.argmax(rows)]) if rows.any() else span.start_s
        ends = _ends_of(values[rows]) if rows.any() else (np.inf, -np.inf)
        left_out.append(Disbelieved(Span(start_s, end_s), at_s, 0.0, *ends, contested=True))
    return kept, values[~dropped], tuple(left_out)


def _with_neighbours(t: FloatArray, span: Span) -> Span:
    """A stretch with the samples right beside it, about as near as its own are to each other."""
    inside = t[(t >= span.start_s) & (t <= span.end_s)]
    near_s = _NEAR * float(np.diff(inside).max()) if len(inside) > 1 else 0.0
    beside = t[(t >= span.start_s - near_s) & (t <= span.end_s + near_s)]
    return Span(min([span.start_s, *beside[:1].tolist()]), max([span.end_s, *beside[-1:].tolist()]))


_NEAR = 3.5
"""Right beside a stretch is what is no further from it than so many of its longest intervals."""


def _ends_of(values: FloatArray) -> tuple[float, float]:
    """The least and the most of scalars; of positions nothing."""
    return (float(values.min()), float(values.max())) if values.ndim == 1 else (-np.inf, np.inf)


def holes_around(t: FloatArray, dropped: BoolArray) -> tuple[Span, ...]:
    """The stretches between the samples that are kept around each run of dropped ones.

    >>> holes_around(np.array([0.0, 1.0, 2.0, 3.0]), np.array([False, True, False, False]))
    (Span(start_s=0.0, end_s=2.0),)
    """
    edges = np.diff(np.concatenate(([False], dropped, [False])).astype(np.int8))
    firsts, behind = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return tuple(
        Span(float(t[max(first - 1, 0)]), float(t[min(end, len(t) - 1)]))
        for first, end in zip(firsts.tolist(), behind.tolist(), strict=True)
    )


def believed(
    signals: Mapping[str, Signal], bodies: Sequence[Body], *, start_s: float = -np.inf
) -> tuple[dict[str, Signal], list[LogDefect]]:
    """The signals of a log without implausible jumps and replayed stretches, and what was wrong with them.

    Args:
        signals: Of the log.
        bodies: Of the trial.
        start_s: When the competition started at the earliest, s.
    """
    defects: list[LogDefect] = []
    found: dict[str, Signal] = {}
    copied = _replayed(signals)
    jumping = {name: jumps(signal, bodies, anew_s=start_s) for name, signal in signals.items()}
    steady = {name: _without(signal, jumping[name]) for name, signal in signals.items()}
    for name, signal in signals.items():
        jumped = jumping[name]
        if jumped.any():
            at_s = float(signal.t[np.argmax(jumped)])
            message = (
                f"samples jump faster than anything moves, first at {at_s:.3f} s; they were left out, and "
                "nothing is known there"
            )
            defects.append(LogDefect("implausible_jump", signal.name, int(jumped.sum()), message))
        place = f"position/{subject_of(name)}"
        # Who was put somewhere else before the start did not travel there.
        put = place in signals and bool(jumping[place][signals[place].t < start_s].any())
        position = steady.get(place)
        slow = (
            _denied(signal, position, start_s) if put and position is not None else denied(signal, position)
        )
        if slow.any():
            at_s = float(signal.t[np.argmax(slow)])
            message = (
                f"it says from {at_s:.3f} s on that it is less than two thirds as fast as its positions "
                "show; how fast it was is unknown there"
            )
            defects.append(LogDefect("denied_motion", signal.name, int(slow.sum()), message))
        again = np.zeros(len(signal), dtype=bool)
        for copy in copied.get(name, ()):
            again[copy.first : copy.behind] = True
            # Nothing says which of the two was there first: what is yet to come can be played before.
            again[copy.original : copy.original + copy.behind - copy.first] = True
        if again.any():
            one = copied[name][0]
            message = (
                f"samples from {signal.t[one.first]:.3f} s on repeat those from "
                f"{signal.t[one.original]:.3f} s on to the last bit, as if they were replayed; both were "
                "left out, and nothing is known there"
            )
            defects.append(LogDefect("replayed_stretch", signal.name, int(again.sum()), message))
        more = _disbelieved(signal, jumped) if jumped.any() else ()
        left_out = replace(signal, disbelieved=(*signal.disbelieved, *more)) if more else signal
        found[name] = _without(left_out, jumped | again | slow)
    return found, defects


def _denied(signal: Signal, position: Signal, anew_s: float) -> BoolArray:
    """Which samples of a speed are denied, before a moment and from the last sample before it on."""
    before = int(signal.t.searchsorted(anew_s, side="right"))
    anew_s = float(signal.t[before - 1]) if before else anew_s
    ends = (-np.inf, anew_s), (anew_s, np.inf)
    return np.concatenate([denied(_between(signal, *one), _between(position, *one)) for one in ends])


def _between(signal: Signal, start_s: float, end_s: float) -> Signal:
    rows = slice(*signal.t.searchsorted((start_s, end_s)))
    return replace(signal, t=signal.t[rows], values=signal.values[rows])


def _disbelieved(signal: Signal, jumped: BoolArray) -> tuple[Disbelieved, ...]:
    found = []
    for span in holes_around(signal.t, jumped):
        rows = np.flatnonzero(jumped & (signal.t >= span.start_s) & (signal.t <= span.end_s))
        first = int(rows[0])
        step = dist(np.atleast_1d(signal.values[first]), np.atleast_1d(signal.values[first - 1]))
        needed = float(step / (signal.t[first] - signal.t[first - 1]))
        found.append(Disbelieved(span, float(signal.t[first]), needed, *_ends_of(signal.values[rows])))
    return tuple(found)


def _without(signal: Signal, dropped: BoolArray) -> Signal:
    if not dropped.any():
        return signal
    holes = tuple(sorted({*signal.holes, *holes_around(signal.t, dropped)}))
    return replace(signal, t=signal.t[~dropped], values=signal.values[~dropped], holes=holes)


def _replayed(signals: Mapping[str, Signal]) -> dict[str, list[Replay]]:
    """The stretches in which all that moves repeats itself.

    One robot that does the same work again, beside a person who stands still, is no replay: two bodies at
    least have to come back, or how far two are apart.
    """
    copies = {name: found for name, one in signals.items() if (found := replays(one.t, one.values))}
    return {
        name: kept
        for name, own in copies.items()
        if (kept := [one for one in own if _all_come_back(signals, copies, name, one)])
    }


def _all_come_back(
    signals: Mapping[str, Signal], copies: Mapping[str, Sequence[Replay]], name: str, copy: Replay
) -> bool:
    t = signals[name].t
    start_s, end_s = float(t[copy.first]), float(t[copy.behind - 1])
    lag_s = start_s - float(t[copy.original])
    bodies: set[str] = set()
    for other, signal in signals.items():
        inside = slice(*np.searchsorted(signal.t, (start_s, end_s)))
        values = signal.values[inside]
        if len(values) < 2 or not (values[1:] != values[:-1]).any():
            continue  # it stands still, which says nothing
        if not any(
            abs(float(signal.t[one.first] - signal.t[one.original]) - lag_s) < _SAME_LAG_S
            and signal.t[one.first] <= end_s
            and signal.t[one.behind - 1] >= start_s
            for one in copies.get(other, ())
        ):
            return False
        bodies.update(subject_of(other).split("/"))
    return len(bodies) > 1


# Jumps -----------------------------------------------------------------------------------------


def jumps(signal: Signal, bodies: Sequence[Body], *, anew_s: float = -np.inf) -> BoolArray:
    """Which samples cannot be reached from the last one that is believed, shape (n,).

    A distance of two bodies changes no faster than both can move, a position no faster than a body can, a
    speed not faster than something heavy is stopped. Other quantities may step, as a force does.

    Args:
        signal: Of the log.
        bodies: Of the trial.
        anew_s: What was put somewhere else before that, s, is where it is from then on: as if the recording
            began there.
    """
    none = np.zeros(len(signal), dtype=bool)
    limits = _limits(signal, bodies)
    if limits is None or len(signal) < 2:
        return none
    rate, allowed = limits
    rows = signal.values.reshape(len(signal), -1)
    if allowed is None:
        allowed = _noise_m(rows)
    allowed += rate * signal.stamp_jitter_s
    steps = np.sqrt(np.square(np.diff(rows, axis=0)).sum(axis=1))
    suspicious = np.flatnonzero(steps > rate * np.diff(signal.t) + allowed)
    if not len(suspicious):
        return none
    t, values = signal.t.tolist(), rows.tolist()
    last, begins = int(suspicious[0]), int(signal.t.searchsorted(anew_s, side="right")) - 1
    for here in range(last + 1, len(t)):
        if (
            not (here == begins and none[here - 1])
            and dist(values[here], values[last]) > rate * (t[here] - t[last]) + allowed
        ):
            none[here] = True
        else:
            last = here
    return none


def _noise_m(rows: FloatArray) -> float:
    """How much of a step may be noise, by how much steps differ from the ones before them, m.

    A signal without noise has little room for a sample that was moved, one with much noise has more of it.
    """
    bends = np.sqrt(np.square(np.diff(rows, 2, axis=0)).sum(axis=1))
    usual = float(np.quantile(bends, 0.95)) if len(bends) else 0.0
    return min(max(_NOISE_OF_CURVATURE * usual, _LEAST_NOISE_M), _MOST_NOISE_M)


def _limits(signal: Signal, bodies: Sequence[Body]) -> tuple[float, float | None] | None:
    """How fast a signal changes at most, and what a step may be longer; `None`: by the noise that it has."""
    quantity = QUANTITIES.get(quantity_of(signal.name))
    subjects = {subject.partition("::")[0] for subject in subject_of(signal.name).split("/")}
    kinds = {body.kind for body in bodies if body.id in subjects}
    if quantity is None:
        return None
    if quantity_of(signal.name) == "position" and kinds and kinds <= _KNOWN_KINDS:
        return FASTEST_CLOSING_M_S / 2, None
    if quantity.of == "pair" and quantity.unit == "m":
        return (FASTEST_CLOSING_M_S if kinds and kinds <= _KNOWN_KINDS else FASTEST_OF_ANY_M_S), None
    if quantity_of(signal.name) in ("speed", "tcp_speed") and kinds and kinds <= _KNOWN_KINDS:
        return _GREATEST_ACCELERATION_M_S2, _SPEED_STEP_M_S
    return None


# Replays ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Replay:
    """Samples that were there before.

    Attributes:
        original: The place of the first of them when they came first.
        first: Its place when it came again.
        behind: The place behind the last one.
    """

    original: int
    first: int
    behind: int


def replays(t: FloatArray, values: FloatArray) -> list[Replay]:
    """The stretches of samples that repeat earlier ones to the last bit, in time order.

    >>> walk = np.random.default_rng(1).random(100)
    >>> replays(np.arange(300) / 100, np.concatenate((walk, walk + 1.0, walk)))
    [Replay(original=0, first=200, behind=300)]
    """
    length = REPLAYED_SAMPLES
    if len(t) < 2 * length or t[-1] - t[0] < REPLAYED_S - 1.0 / length:  # too short to hold any
        return []
    rows = np.ascontiguousarray(values + 0.0, dtype=np.float64).reshape(len(t), -1)
    hashes = _of_windows(rows.view(np.uint64), length)
    changes = np.concatenate(([0], np.cumsum((rows[1:] != rows[:-1]).any(axis=1))))
    lively = changes[length - 1 :] - changes[: len(hashes)] >= _LEAST_CHANGES
    # Of the windows only every so many-th is looked for: any copy that is long enough holds one of them.
    anchors = np.flatnonzero(lively[:: length // 2]) * (length // 2)
    table = np.zeros(1 << _TABLE_BITS, dtype=np.int64)
    short = (hashes >> np.uint64(64 - _TABLE_BITS)).astype(np.int64)
    table[short[anchors][::-1]] = anchors[::-1] + 1  # the first of those that are alike
    known = table[short] - 1
    places = np.arange(len(hashes))
    copies = np.flatnonzero((known >= 0) & (places >= known + length) & lively)
    found: list[Replay] = []
    for here in copies[hashes[copies] == hashes[known[copies]]].tolist():
        if not found or here >= found[-1].behind:
            copy = _extended(rows, int(known[here]), here, found[-1].behind if found else 0)
            if t[copy.behind - 1] - t[copy.first] >= REPLAYED_S - 1.0 / length:
                found.append(copy)
    return found


def _extended(rows: FloatArray, original: int, here: int, least: int) -> Replay:
    """A copy with all that is alike before and behind."""
    first = original
    while first > 0 and here > least and here - 1 > original and (rows[first - 1] == rows[here - 1]).all():
        first, here = first - 1, here - 1
    count = len(rows) - here
    differs = (rows[first : first + count] != rows[here:]).any(axis=1)
    same = int(np.argmax(differs)) if differs.any() else count
    return Replay(first, here, here + same)


def _of_windows(words: np.ndarray[tuple[int, ...], np.dtype[np.uint64]], length: int):  # type: ignore[no-untyped-def]
    """A hash of each window of so many rows, from sums that begin anew at each by a division modulo 2^64."""
    odd = np.uint64(_ODD)
    with np.errstate(over="ignore"):
        row = np.zeros(len(words), dtype=np.uint64)
        for column in words.T:
            row = (row ^ (column ^ (column >> np.uint64(29)))) * odd
            row ^= row >> np.uint64(32)
        powers = np.cumprod(np.full(len(row), odd, dtype=np.uint64))
        inverse = np.cumprod(np.full(len(row), np.uint64(pow(_ODD, -1, 1 << 64)), dtype=np.uint64))
        sums = np.concatenate((np.zeros(1, dtype=np.uint64), np.cumsum(row * powers)))
        return (sums[length:] - sums[:-length]) * inverse[: len(sums) - length]
