"""Messages about motion as points in between others: every change is a mix of what was recorded.

So nothing here has to know what a field means: between two recorded states of robot and human lies a state
that they could have been in.
"""

from __future__ import annotations

import dataclasses
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from math import cos, pi
from types import MappingProxyType
from typing import Any

import numpy as np

from ariac_score.logs.containers.items import Message
from ariac_score.testing.copies import Copy, changed, fields_of

__all__ = ["Follows", "Motion", "bump", "later", "mixed", "names_in", "set_value", "value_at"]

Follows = tuple[Sequence[str], Sequence[str]]
"""Dotted paths of the components of a position, and of those of its velocity."""

Weight = Callable[[float], float]
"""How far a message goes towards another one, 0 to 1, by its time in s."""


def mixed(one: Any, other: Any, share: float) -> Any:
    """What lies between two messages of one type: numbers in between, all else as in the first.

    >>> mixed(1.0, 3.0, 0.25), mixed("a", "b", 0.25), mixed([0.0, 2.0], [1.0, 2.0], 0.5)
    (1.5, 'a', [0.5, 2.0])
    """
    if isinstance(one, float) and isinstance(other, float):
        return other if share == 1 else one + (other - one) * share  # to the last bit
    if isinstance(one, np.ndarray) and isinstance(other, np.ndarray):
        if one.dtype.kind != "f" or one.shape != other.shape:
            return one
        return other if share == 1 else (one + (other - one) * share).astype(one.dtype)
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        return [mixed(a, b, share) for a, b in zip(one, other, strict=True)]
    if dataclasses.is_dataclass(one) and type(one) is type(other):
        return _mixed_fields(one, other, share)
    return one


def _mixed_fields(one: Any, other: Any, share: float) -> Any:
    names = [f.name for f in dataclasses.fields(one) if f.name not in ("header", "stamp")]
    if sorted(names) == ["w", "x", "y", "z"]:
        return _turned(one, other, share)
    names = [name for name in names if not name.startswith("__")]
    return dataclasses.replace(
        one, **{name: mixed(getattr(one, name), getattr(other, name), share) for name in names}
    )


def _turned(one: Any, other: Any, share: float) -> Any:
    """An orientation between two: the shorter way, of length 1 again."""
    if share == 1:
        return other
    a, b = (np.array([q.x, q.y, q.z, q.w]) for q in (one, other))
    between = a + ((b if float(a @ b) >= 0 else -b) - a) * share
    length = float(np.sqrt(between @ between))
    if length == 0:
        return one
    x, y, z, w = (between / length).tolist()
    return dataclasses.replace(one, x=x, y=y, z=z, w=w)


def names_in(fields: Any) -> tuple[str, ...]:
    """The texts in a message, such as names of frames: messages of one topic with the same are one series."""
    return tuple(_names(fields))


def _names(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, list):
        for one in value:
            yield from _names(one)
    elif dataclasses.is_dataclass(value):
        for field in dataclasses.fields(value):
            if not field.name.startswith("_"):  # the name of its type
                yield from _names(getattr(value, field.name, None))


def later(message: Message, by_ns: int) -> Message:
    """The message at another time: that of recording, and its own stamps where it has any."""
    fields = fields_of(message)
    stamps = list(_stamps(fields))
    for stamp in stamps:
        t_ns = max(stamp.sec * 10**9 + stamp.nanosec + by_ns, 0)
        stamp.sec, stamp.nanosec = divmod(t_ns, 10**9)
    moved = message._replace(stamp_ns=max(message.stamp_ns + by_ns, 0))
    return changed(moved, fields) if stamps else moved


def _stamps(fields: Any) -> Iterator[Any]:
    """The stamps of headers that somebody set."""
    headers = [getattr(fields, "header", None)]
    headers += [getattr(one, "header", None) for one in getattr(fields, "transforms", ())]
    for header in headers:
        stamp = getattr(header, "stamp", None)
        if stamp is not None and (stamp.sec or stamp.nanosec):
            yield stamp


def bump(first_s: float, last_s: float, ramp_s: float) -> Weight:
    """From 0 to 1 over `ramp_s` before a stretch, 1 within, and back to 0 behind it, without a kink.

    >>> [round(bump(2.0, 3.0, 1.0)(t), 3) for t in (1.0, 1.5, 2.0, 3.0, 3.5, 4.0)]
    [0.0, 0.5, 1.0, 1.0, 0.5, 0.0]
    """

    def weight(t_s: float) -> float:
        outside_s = max(first_s - t_s, t_s - last_s, 0.0)
        if outside_s >= ramp_s:
            return 0.0
        return (1 + cos(pi * outside_s / ramp_s)) / 2 if outside_s else 1.0

    return weight


@dataclasses.dataclass(frozen=True)
class _Series:
    """Messages of one topic about the same things, in order of time."""

    t_s: tuple[float, ...]
    messages: tuple[Message, ...]
    fields: tuple[Any, ...]

    @property
    def step_s(self) -> float:
        """The mean time between two messages, s."""
        return (self.t_s[-1] - self.t_s[0]) / max(len(self.t_s) - 1, 1)

    def at(self, t_s: float) -> Any:
        """The fields of the last message up to a time, or of the first."""
        return self.fields[max(bisect_right(self.t_s, t_s) - 1, 0)]

    def from_(self, t_s: float) -> Any:
        """The fields of the first message from a time on, or of the last."""
        return self.fields[min(bisect_left(self.t_s, t_s), len(self.fields) - 1)]


class Motion:
    """The messages of a copy that show how things move, by series.

    Args:
        copy: The recording.
        topics: Those about motion.
        time_of: The time of a message, s of trial time.
        follows: By topic which fields are the velocities of which positions: a velocity that contradicts its
            position would show.
    """

    def __init__(
        self,
        copy: Copy,
        topics: Sequence[str],
        time_of: Callable[[Message], float],
        follows: Mapping[str, Sequence[Follows]] = MappingProxyType({}),
    ) -> None:
        found: dict[tuple[str, ...], list[tuple[float, Message, Any]]] = {}
        wanted = frozenset(topics)
        for message in copy.messages:
            if message.connection.topic in wanted:
                fields = fields_of(message)
                key = (message.connection.topic, message.connection.publisher, *names_in(fields))
                found.setdefault(key, []).append((time_of(message), message, fields))
        self._copy, self._follows = copy, follows
        self.series = {key: _Series(*zip(*rows, strict=True)) for key, rows in found.items()}

    def towards(self, t_s: float, weight: Weight) -> Copy:
        """The recording in which things go towards where they were at a time, as far as the weight says."""
        table = {}
        for series in self.series.values():
            goal = series.at(t_s)
            for at_s, message, fields in zip(series.t_s, series.messages, series.fields, strict=True):
                if share := weight(at_s):
                    table[id(message)] = changed(message, mixed(fields, goal, share))
        return self.replaced(table)

    def straight(self, first_s: float, last_s: float) -> Copy:
        """The recording in which things go straight from where they were at one time to another."""
        table = {}
        for series in self.series.values():
            begin, end = series.at(first_s), series.from_(last_s)
            for at_s, message, fields in zip(series.t_s, series.messages, series.fields, strict=True):
                if first_s < at_s < last_s:
                    share = (at_s - first_s) / (last_s - first_s)
                    table[id(message)] = changed(message, mixed(mixed(fields, begin, 1.0), end, share))
        return self.replaced(table)

    def played(self, first_s: float, last_s: float, lag_s: float) -> Copy:
        """The recording in which a stretch shows what was so long before it."""
        table = {}
        for series in self.series.values():
            for at_s, message, fields in zip(series.t_s, series.messages, series.fields, strict=True):
                if first_s <= at_s <= last_s:
                    table[id(message)] = changed(message, mixed(fields, series.at(at_s - lag_s + 1e-6), 1.0))
        return self.replaced(table)

    def replaced(self, table: dict[int, Message]) -> Copy:
        """The recording with other messages in the places of some, by `id`; velocities follow positions."""
        for (topic, *_), series in self.series.items():
            for follows in self._follows.get(topic, ()):
                self._follow(series, follows, table)
        return self._copy.with_changed(lambda message: table.get(id(message), message))

    def _follow(self, series: _Series, follows: Follows, table: dict[int, Message]) -> None:
        """Set the velocities of changed messages to what the positions around them give."""
        positions, velocities = follows
        fields = [
            fields_of(table[id(message)]) if id(message) in table else known
            for message, known in zip(series.messages, series.fields, strict=True)
        ]
        for here, message in enumerate(series.messages):
            if id(message) not in table or len(fields) < 2:
                continue
            before, behind = max(here - 1, 0), min(here + 1, len(fields) - 1)
            step_s = series.t_s[behind] - series.t_s[before]
            for at, speed in zip(positions, velocities, strict=True) if step_s > 0 else ():
                way = value_at(fields[behind], at) - value_at(fields[before], at)
                set_value(fields[here], speed, way / step_s)
            table[id(message)] = changed(message, fields[here])


def value_at(fields: Any, path: str) -> float:
    """The number at a dotted path of a message."""
    return float(reduce(getattr, path.split("."), fields))


def set_value(fields: Any, path: str, value: float) -> None:
    """Set the number at a dotted path of a message."""
    *inner, last = path.split(".")
    setattr(reduce(getattr, inner, fields), last, value)
