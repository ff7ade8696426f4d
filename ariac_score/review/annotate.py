"""Verdicts and margins of a result as a recording, to be opened together with its log.

A ROS 2 recording in MCAP: for each monitor a topic with state and margin, the violations as
markers, and a log with every violation and undecided finding. Stamps are those of the log's clock.

Source: visualization_msgs/MarkerArray and rcl_interfaces/Log of ROS 2; MCAP version 0.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise, repeat, starmap
from typing import TYPE_CHECKING, Any

import numpy as np

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.results.result import Result
from ariac_score.review.annotation_messages import MONITOR_STATE, Annotation, States, serialized, stamp
from ariac_score.review.margins import VERDICTS, MarginSeries
from ariac_score.scoring.steward import with_verdicts
from ariac_score.trial.clock import Clock
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray, distinct

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["messages_of", "origin_ns", "without_margins"]

ROOT = "/ariac_score"
_STATES = {
    Verdict.SATISFIED: 0,
    Verdict.VIOLATED: 1,
    Verdict.INCONCLUSIVE: 2,
    Verdict.NOT_APPLICABLE: 3,
    None: 4,
}
_NUMBERS = np.array([_STATES[verdict] for verdict in VERDICTS], dtype=np.uint8)
"""The numbers of the message type, by those of `VERDICTS`."""
_INFO, _WARNING, _ERROR = 20, 30, 40
_SPHERE, _TEXT = 2, 9
_ADD, _DELETE = 0, 2
_LONGEST = 1000
"""Characters of a message; a label in a scene holds no more."""
_SHORTEST_S = 0.5
"""A marker that is shown for less could not be seen."""
AT_ONCE = 50_000
"""About so many messages are serialized before the first of them is written."""

_FIRST_NS, _LAST_NS = -(2**62), 2**62
"""Before and after every stamp; whole numbers, because float64 does not resolve nanoseconds of an epoch."""


def origin_ns(clocks: Sequence[Clock]) -> int:
    """Which time of the log's clock trial time 0 is, by the clock of the times.

    >>> origin_ns([Clock("log time", 1_700_000_000_000_000_000)]), origin_ns([Clock("simulated time")])
    (1700000000000000000, 0)
    """
    return (clocks[0].origin_ns or 0) if clocks else 0


def messages_of(
    result: Result, trial: Trial, found: Sequence[MarginSeries], *, frame: str
) -> Iterator[Annotation]:
    """Everything the recording holds, in order of time, one by one: there can be a million.

    Messages of monitors are serialized when they are needed, some thousand at a time.

    Args:
        result: The result.
        trial: Its trial, for the places of bodies and the clock.
        found: Margins and verdicts of the monitors over time.
        frame: The tf frame positions are in.

    Raises:
        LogError: The log's clock is before its own zero, or beyond the range of a stamp.
    """
    clock = _Clock(origin_ns(trial.clocks), frame)
    others = [
        Annotation(t_ns, topic, kind, serialized(kind, fields))
        for t_ns, topic, kind, fields in (
            *_markers(result, trial, clock),
            *_log(result, clock, without_margins(found)),
        )
    ]
    series = [_StateMessages(track, topic, clock) for track, topic in zip(found, _topics(found), strict=True)]
    return _merged(series, sorted(others, key=_place_in_time))


def _place_in_time(message: Annotation) -> tuple[int, str]:
    return message.t_ns, message.topic


@dataclass(frozen=True)
class _Clock:
    origin_ns: int
    frame: str

    def ns(self, t_s: float) -> int:
        return self.origin_ns + round(t_s * 1e9)

    def all_ns(self, t_s: FloatArray) -> NDArray[np.int64]:
        """The same of increasing times, shape (n,).

        Raises:
            LogError: One of them is out of the range of a stamp.
        """
        # They increase, so the first and the last stand for all.
        for end_s in (*t_s[:1], *t_s[-1:]):
            stamp(self.ns(float(end_s)))
        return self.origin_ns + np.rint(t_s * 1e9).astype(np.int64)

    def stamp(self, t_s: float) -> dict[str, int]:
        return stamp(self.ns(t_s))

    def header(self, t_s: float) -> dict[str, Any]:
        return {"stamp": self.stamp(t_s), "frame_id": self.frame}


# Topics --------------------------------------------------------------------------------


def _topics(found: Iterable[MarginSeries]) -> list[str]:
    """A topic for each track, by check and subject; names that ROS allows, and no two the same."""
    names: list[str] = []
    taken: set[str] = set()
    for track in found:
        parts = [_part(part) for part in (track.check, *track.subject.split("/")[:5], track.what) if part]
        # Two subjects can come to the same name once ROS allows every character of it.
        name = plain = f"{ROOT}/{'/'.join(parts)}"
        number = 2
        while name in taken:
            name, number = f"{plain}_{number}", number + 1
        names.append(name)
        taken.add(name)
    return names


def without_margins(found: Iterable[MarginSeries]) -> list[str]:
    """The checks without a margin at every sample, in their order."""
    tracks = list(found)
    sampled = {track.check for track in tracks if track.sampled}
    return list(dict.fromkeys(track.check for track in tracks if track.check not in sampled))


def _part(text: str) -> str:
    """One part of a topic name: ASCII letters, digits and underscores, not beginning with a digit."""
    kept = "".join(c if c.isascii() and c.isalnum() else "_" for c in text[:60])
    kept = re.sub(r"__+", "_", kept)  # ROS 2 allows no two underscores in a row
    return f"_{kept}" if kept[:1].isdigit() else kept


# What it holds -------------------------------------------------------------------------


_Fields = tuple[int, str, str, Mapping[str, Any]]
"""Stamp in ns, topic, type, and field values by name; fields left out are zero or empty."""


def _text(text: str) -> str:
    """Text that every reader takes: without control characters or half surrogate pairs, and short."""
    return "".join(c if c.isprintable() else " " for c in text[:_LONGEST])


def _final(result: Result) -> Mapping[str, Finding]:
    decisions = () if result.adjusted is None else result.adjusted.adjustments
    return with_verdicts(result.measured.findings, decisions)


def _markers(result: Result, trial: Trial, clock: _Clock) -> Iterator[_Fields]:
    """For each violation with a time: a sphere where its bodies were, words above; gone when it ends."""
    number = 0
    for key, finding in _final(result).items():
        if finding.verdict is not Verdict.VIOLATED or finding.span is None:
            continue
        start_s, end_s = finding.span.start_s, max(finding.span.end_s, finding.span.start_s + _SHORTEST_S)
        worst_s = finding.evidence[0].t_s if finding.evidence else start_s
        places = _places(finding.subject, trial, worst_s)
        shown: list[dict[str, Any]] = []
        for place in places:
            number += 1
            shown.append(_sphere(number, finding, place, clock.header(start_s)))
        number += 1
        # Without a place the words are shown above the origin, one over the other.
        above = places[0] if places else (0.0, 0.0, 0.3 * number)
        shown.append(_words(number, key, finding, above, clock.header(start_s)))
        for marker in shown:
            marker["lifetime"] = stamp(round((end_s - start_s) * 1e9))
        gone = [
            {"header": clock.header(end_s), "ns": m["ns"], "id": m["id"], "action": _DELETE} for m in shown
        ]
        kind = "visualization_msgs/msg/MarkerArray"
        yield clock.ns(start_s), f"{ROOT}/violations", kind, {"markers": shown}
        yield clock.ns(end_s), f"{ROOT}/violations", kind, {"markers": gone}


_Place = tuple[float, float, float]


def _places(subject: str, trial: Trial, t_s: float) -> list[_Place]:
    """Where the bodies of a finding were, as far as the log shows."""
    places = []
    for name in subject.split("/"):
        signal = trial.signals.get(f"position/{name}")
        if signal is not None and signal.span is not None:
            places.append(_place(signal, t_s))
    return places


def _place(signal: Signal, t_s: float) -> _Place:
    """The recorded place nearest in time."""
    row = min(int(signal.t.searchsorted(t_s)), len(signal) - 1)
    before = max(row - 1, 0)
    nearest = before if t_s - signal.t[before] < signal.t[row] - t_s else row
    x, y, z = (float(value) for value in signal.values[nearest])
    return x, y, z


def _marker(number: int, finding: Finding, kind: int, place: _Place, header: Any) -> dict[str, Any]:
    x, y, z = place
    return {
        "header": header,
        "ns": finding.check,
        "id": number,
        "type": kind,
        "action": _ADD,
        "pose": {"position": {"x": x, "y": y, "z": z}, "orientation": {"w": 1.0}},
    }


def _sphere(number: int, finding: Finding, place: _Place, header: Any) -> dict[str, Any]:
    return {
        **_marker(number, finding, _SPHERE, place, header),
        "scale": {"x": 0.4, "y": 0.4, "z": 0.4},
        "color": {"r": 0.84, "g": 0.37, "b": 0.0, "a": 0.7},  # vermilion: seen by colour-blind readers too
    }


def _words(number: int, key: str, finding: Finding, place: _Place, header: Any) -> dict[str, Any]:
    x, y, z = place
    return {
        **_marker(number, finding, _TEXT, (x, y, z + 0.6), header),
        "scale": {"z": 0.2},
        "color": {"r": 0.84, "g": 0.37, "b": 0.0, "a": 1.0},
        "text": _text(f"{key}: {finding.subject}: {finding.message}"),
    }


def _log(result: Result, clock: _Clock, without: Sequence[str]) -> Iterator[_Fields]:
    """Every violation and undecided finding at its start; at the end the score and decisions about it."""
    window = result.measured.window
    end_s = window.end_s if window else 0.0
    for check in without:
        words = "no margin over time: shown is where its findings begin and end"
        yield _line(clock, window.start_s if window else 0.0, _INFO, check, "margins", words)
    levels = {Verdict.VIOLATED: _ERROR, Verdict.INCONCLUSIVE: _WARNING}
    for key, finding in _final(result).items():
        if finding.verdict in levels:
            t_s = finding.span.start_s if finding.span else end_s
            words = f"{finding.subject}: {finding.message}"
            yield _line(clock, t_s, levels[finding.verdict], finding.check, key, words)
    name = result.provenance.rule_set.id
    yield _line(clock, end_s, _INFO, name, "score", f"automatic score {_amount(result.score)}")
    if result.adjusted is not None:
        for decision in result.adjusted.adjustments:
            words = f"adjusted by {decision.author}, {decision.time}: {decision.effect}: {decision.reason}"
            yield _line(clock, end_s, _WARNING, name, decision.id, words)
        yield _line(clock, end_s, _INFO, name, "score", f"adjusted score {_amount(result.adjusted.score)}")


def _amount(score: object) -> str:
    return "withheld" if score is None else f"{score:f}"


def _line(clock: _Clock, t_s: float, level: int, name: str, function: str, words: str) -> _Fields:
    fields = {
        "stamp": clock.stamp(t_s),
        "level": level,
        "name": name,
        "msg": _text(words),
        "function": function,
    }
    return clock.ns(t_s), f"{ROOT}/log", "rcl_interfaces/msg/Log", fields


# Monitors over time --------------------------------------------------------------------


class _StateMessages:
    """The messages of one track.

    Attributes:
        topic: The topic of all of them.
        t_ns: Their stamps, shape (n,), in order.
    """

    def __init__(self, track: MarginSeries, topic: str, clock: _Clock) -> None:
        self.topic, self._track = topic, track
        same = {"check": track.check, "subject": _text(track.subject), "unit": track.unit}
        self._states = States(same, clock.frame)
        self.t_ns = clock.all_ns(track.t_s)

    def between(self, from_ns: int, before_ns: int) -> Iterator[Annotation]:
        """The messages from one time to before another."""
        first, last = self.t_ns.searchsorted([from_ns, before_ns]).tolist()
        track, rows = self._track, slice(first, last)
        texts = {row - first: _text(text) for row, text in track.messages.items() if first <= row < last}
        payloads = self._states.serialized(
            self.t_ns[rows], _NUMBERS[track.verdicts[rows]], track.margin[rows], texts
        )
        messages = zip(
            self.t_ns[rows].tolist(), repeat(self.topic), repeat(MONITOR_STATE), payloads, strict=False
        )
        return starmap(Annotation, messages)


def _merged(series: Sequence[_StateMessages], others: Sequence[Annotation]) -> Iterator[Annotation]:
    """All messages by time, then by topic.

    Args:
        series: The messages of each monitor and subject.
        others: All other messages, in order.
    """
    topics = [*(one.topic for one in series), *(message.topic for message in others)]
    ranks = {topic: rank for rank, topic in enumerate(sorted(set(topics)))}
    stamps = np.concatenate([np.zeros(0, dtype=np.int64), *(one.t_ns for one in series)])
    # Cut at stamps and not at counts: messages of one stamp stay together and are sorted by topic.
    cuts = distinct(np.sort(stamps)[AT_ONCE::AT_ONCE]).tolist()
    for from_ns, before_ns in pairwise([_FIRST_NS, *cuts, _LAST_NS]):
        first, last = (bisect_left(others, ns, key=lambda one: one.t_ns) for ns in (from_ns, before_ns))
        states = chain.from_iterable(one.between(from_ns, before_ns) for one in series)
        messages = [*states, *others[first:last]]
        place = np.array([(message.t_ns, ranks[message.topic]) for message in messages], dtype=np.int64)
        order = np.lexsort(place.reshape(len(messages), 2).T[::-1])
        yield from map(messages.__getitem__, order.tolist())
