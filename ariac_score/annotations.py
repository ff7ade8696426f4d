"""What a result says about its log, as a recording to be opened beside it.

A ROS 2 recording in MCAP: for each monitor a topic with state and margin, the violations as
markers, and a log with every violation and undecided finding. Stamps are those of the log's clock.

Source: visualization_msgs/MarkerArray and rcl_interfaces/Log of ROS 2; MCAP version 0.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from heapq import merge
from math import nan
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ariac_score.errors import LogError
from ariac_score.findings import Finding, Verdict
from ariac_score.logs.types import bundled_typestore
from ariac_score.margins import Track
from ariac_score.result import Result
from ariac_score.scoring.steward import with_verdicts
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal

__all__ = ["Annotation", "mcap_bytes", "messages_of", "origin_ns", "without_margins"]

ROOT = "/ariac_score"
_STATES = {
    Verdict.SATISFIED: 0,
    Verdict.VIOLATED: 1,
    Verdict.INCONCLUSIVE: 2,
    Verdict.NOT_APPLICABLE: 3,
    None: 4,
}
_INFO, _WARNING, _ERROR = 20, 30, 40
_SPHERE, _TEXT = 2, 9
_ADD, _DELETE = 0, 2
_LONGEST = 1000
"""Characters of a message; a label in a scene holds no more."""
_SHORTEST_S = 0.5
"""A marker that stood for less could not be seen."""


@dataclass(frozen=True)
class Annotation:
    """One message of the recording.

    Attributes:
        t_ns: Its stamp on the clock of the log, ns.
        topic: Name with leading slash.
        type: `package/msg/Name`.
        fields: Field values by name; what is left out is zero or empty.
    """

    t_ns: int
    topic: str
    type: str
    fields: Mapping[str, Any]


def origin_ns(clock: str) -> int:
    """Which time of the log's clock trial time 0 is.

    >>> origin_ns("log time, origin 1700000000000000000 ns"), origin_ns("simulated time")
    (1700000000000000000, 0)
    """
    told = re.search(r"origin (\d+) ns", clock)
    return int(told[1]) if told else 0


def messages_of(result: Result, trial: Trial, found: Sequence[Track], *, frame: str) -> Iterator[Annotation]:
    """Everything the recording holds, in order of time, one after the other: there can be a million.

    Args:
        result: The result.
        trial: Its trial, for the places of bodies and the clock.
        found: What the monitors say over time.
        frame: The tf frame positions are in.

    Raises:
        LogError: The log's clock is before its own zero.
    """
    clock = _Clock(origin_ns(trial.clock), frame)
    told = [*_markers(result, trial, clock), *_log(result, clock, without_margins(found))]
    first_ns = [clock.ns(track.moments[0].t_s) for track in found if track.moments]
    if min((*first_ns, *(message.t_ns for message in told)), default=0) < 0:
        raise LogError("times before the zero of the log's clock cannot be recorded", hint="check its stamps")
    states = [_states(track, topic, clock) for track, topic in zip(found, _topics(found), strict=True)]
    return merge(*states, sorted(told, key=_place_in_time), key=_place_in_time)


def _place_in_time(message: Annotation) -> tuple[int, str]:
    return message.t_ns, message.topic


@dataclass(frozen=True)
class _Clock:
    origin_ns: int
    frame: str

    def ns(self, t_s: float) -> int:
        return self.origin_ns + round(t_s * 1e9)

    def stamp(self, t_s: float) -> dict[str, int]:
        return _time(self.ns(t_s))

    def header(self, t_s: float) -> dict[str, Any]:
        return {"stamp": self.stamp(t_s), "frame_id": self.frame}


def _time(t_ns: int) -> dict[str, int]:
    return {"sec": t_ns // 10**9, "nanosec": t_ns % 10**9}


# Topics --------------------------------------------------------------------------------


def _topics(found: Iterable[Track]) -> list[str]:
    """A topic for each track, by check and subject; names that ROS allows, and no two the same."""
    names: list[str] = []
    taken: set[str] = set()
    for track in found:
        parts = [_part(part) for part in (track.check, *track.subject.split("/")[:5], track.what) if part]
        name = plain = f"{ROOT}/{'/'.join(parts)}"
        number = 2
        while name in taken:
            name, number = f"{plain}_{number}", number + 1
        names.append(name)
        taken.add(name)
    return names


def without_margins(found: Iterable[Track]) -> list[str]:
    """The checks of which only findings are known, in their order: their margins have no course."""
    tracks = list(found)
    sampled = {track.check for track in tracks if track.sampled}
    return list(dict.fromkeys(track.check for track in tracks if track.check not in sampled))


def _part(text: str) -> str:
    """One part of a topic name: ASCII letters, digits and underscores, not beginning with a digit."""
    kept = "".join(c if c.isascii() and c.isalnum() else "_" for c in text[:60])
    kept = re.sub(r"__+", "_", kept)
    return f"_{kept}" if kept[:1].isdigit() else kept


# What it holds -------------------------------------------------------------------------


def _states(track: Track, topic: str, clock: _Clock) -> Iterator[Annotation]:
    for moment in track.moments:
        yield Annotation(
            clock.ns(moment.t_s),
            topic,
            "ariac_score_msgs/msg/MonitorState",
            {
                "header": clock.header(moment.t_s),
                "check": track.check,
                "subject": _text(track.subject),
                "state": _STATES[moment.verdict],
                "margin": nan if moment.margin is None else moment.margin,
                "unit": track.unit,
                "message": _text(moment.message),
            },
        )


def _text(text: str) -> str:
    """Text that every reader takes: no end inside, no half characters, not endless."""
    return "".join(c if c.isprintable() else " " for c in text[:_LONGEST])


def _final(result: Result) -> Mapping[str, Finding]:
    decisions = () if result.adjusted is None else result.adjusted.adjustments
    return with_verdicts(result.measured.findings, decisions)


def _markers(result: Result, trial: Trial, clock: _Clock) -> Iterator[Annotation]:
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
        # Where no place is known the words stand above the origin, one over the other.
        above = places[0] if places else (0.0, 0.0, 0.3 * number)
        shown.append(_words(number, key, finding, above, clock.header(start_s)))
        for marker in shown:
            marker["lifetime"] = _time(round((end_s - start_s) * 1e9))
        gone = [
            {"header": clock.header(end_s), "ns": m["ns"], "id": m["id"], "action": _DELETE} for m in shown
        ]
        kind = "visualization_msgs/msg/MarkerArray"
        yield Annotation(clock.ns(start_s), f"{ROOT}/violations", kind, {"markers": shown})
        yield Annotation(clock.ns(end_s), f"{ROOT}/violations", kind, {"markers": gone})


_Place = tuple[float, float, float]


def _places(subject: str, trial: Trial, t_s: float) -> list[_Place]:
    """Where the bodies a finding is about were, as far as the log says."""
    places = []
    for name in subject.split("/"):
        signal = trial.signals.get(f"position/{name}")
        if signal is not None and signal.span is not None:
            places.append(_place(signal, t_s))
    return places


def _place(signal: Signal, t_s: float) -> _Place:
    """The recorded place nearest in time."""
    index = min(int(signal.t.searchsorted(t_s)), len(signal) - 1)
    if index > 0 and t_s - signal.t[index - 1] < signal.t[index] - t_s:
        index -= 1
    x, y, z = (float(value) for value in signal.values[index])
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


def _log(result: Result, clock: _Clock, without: Sequence[str]) -> Iterator[Annotation]:
    """Every violation and undecided finding at its start, then at the end the score and who changed it."""
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
    name = result.provenance.rule_set[0]
    yield _line(clock, end_s, _INFO, name, "score", f"automatic score {_amount(result.score)}")
    if result.adjusted is not None:
        for decision in result.adjusted.adjustments:
            words = f"adjusted by {decision.author}, {decision.time}: {decision.effect}: {decision.reason}"
            yield _line(clock, end_s, _WARNING, name, decision.id, words)
        yield _line(clock, end_s, _INFO, name, "score", f"adjusted score {_amount(result.adjusted.score)}")


def _amount(score: object) -> str:
    return "withheld" if score is None else f"{score:f}"


def _line(clock: _Clock, t_s: float, level: int, name: str, function: str, words: str) -> Annotation:
    fields = {
        "stamp": clock.stamp(t_s),
        "level": level,
        "name": name,
        "msg": _text(words),
        "function": function,
    }
    return Annotation(clock.ns(t_s), f"{ROOT}/log", "rcl_interfaces/msg/Log", fields)


# Writing -------------------------------------------------------------------------------


def mcap_bytes(messages: Iterable[Annotation]) -> bytes:
    """The recording as the bytes of one MCAP file, with its message definitions.

    Args:
        messages: In order of time.
    """
    # Imported here, as everywhere: rosbags is slow to load.
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer  # noqa: PLC0415

    store = bundled_typestore(2)
    with TemporaryDirectory() as parent:
        folder = Path(parent, "annotations")
        writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        with writer:
            connections: dict[str, Any] = {}
            for message in messages:
                if message.topic not in connections:
                    connections[message.topic] = writer.add_connection(
                        message.topic, message.type, typestore=store
                    )
                built = _built(store, message.type, message.fields)
                # Little-endian by name, so that the bytes do not depend on the machine.
                payload = store.serialize_cdr(built, message.type, little_endian=True)
                writer.write(connections[message.topic], message.t_ns, payload)
        (file,) = folder.glob("*.mcap")
        return file.read_bytes()


def _built(store: Any, type_: str, given: Mapping[str, Any]) -> Any:
    """A message object with the given fields, all others zero or empty."""
    fields = store.fielddefs[type_][1]
    return store.types[type_](*(_value(store, kind, given.get(name)) for name, kind in fields))


def _value(store: Any, description: Any, given: Any) -> Any:
    from rosbags.interfaces import Nodetype  # noqa: PLC0415  # see mcap_bytes

    kind, detail = description
    if kind == Nodetype.NAME:
        return _built(store, detail, given or {})
    if kind == Nodetype.BASE:
        if given is not None:
            return given
        return "" if detail[0] == "string" else False if detail[0] == "bool" else 0
    element, _ = detail
    if element[0] == Nodetype.BASE:
        import numpy as np  # noqa: PLC0415  # only for arrays of numbers, which stay empty

        return (
            [] if element[1][0] == "string" else np.zeros(0, dtype=_DTYPES.get(element[1][0], element[1][0]))
        )
    return [_value(store, element, each) for each in given or ()]


_DTYPES: Mapping[str, str] = {"byte": "uint8", "char": "uint8", "octet": "uint8"}
