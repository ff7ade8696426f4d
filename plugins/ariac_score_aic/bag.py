"""Reads the recordings of the engine, and of the finals, in the order in which the scorer takes them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ariac_score import (
    Clock,
    FloatArray,
    LogDefect,
    LogDescription,
    LogError,
    MessageColumns,
    ReaderFacts,
    RecordedColumns,
    RosbagReader,
    Span,
    Trial,
    Wanted,
    read_columns,
)
from ariac_score_aic.chains import refused_rows
from ariac_score_aic.messages import (
    ACTIVATED,
    COMMANDS,
    CONTACTS,
    CONTROLLER,
    EVENT,
    LOG,
    SCORING_STATIC,
    SCORING_TF,
    TF,
    TF_STATIC,
    WRENCHES,
    AicMessages,
    Controller,
    IntArray,
    Texts,
    Transforms,
    Wrenches,
)

__all__ = ["AicBagReader"]

_STAMP = ("header.stamp.sec", "header.stamp.nanosec")
_AXES = ("x", "y", "z")
_VELOCITY = tuple(f"tcp_velocity.linear.{axis}" for axis in _AXES)
_OFFSET = tuple(f"fts_tare_offset.wrench.force.{axis}" for axis in _AXES)
_FORCE = tuple(f"wrench.force.{axis}" for axis in _AXES)
_PAIR = ("contacts.collision1.name", "contacts.collision2.name")
_TF_TOPICS = (TF, TF_STATIC, SCORING_TF, SCORING_STATIC)
_FIELDS: Mapping[str, tuple[str, ...]] = {
    **dict.fromkeys(_TF_TOPICS, ("transforms",)),
    CONTROLLER: (*_STAMP, *_VELOCITY, *_OFFSET),
    **dict.fromkeys(WRENCHES, (*_STAMP, *_FORCE)),
    CONTACTS: _PAIR,
    EVENT: ("data",),
    ACTIVATED: ("data",),
    LOG: ("stamp", "msg"),
    **dict.fromkeys(COMMANDS, ()),
}
_MARKS = (
    b"aic_control_interfaces/",
    b"/scoring/tf",
    EVENT.encode(),
    CONTACTS.encode(),
    b"/aic_controller/",
    WRENCHES[0].encode(),
)
"""A recording that has one of these is one of the engine or of the finals."""
_SNIFFED_BYTES = 1 << 18
_SHOWN = 3
"""So many frames are named."""


class AicBagReader:
    """Reads recordings of the AI for Industry Challenge.

    Reads:
        Transforms, states of the controller, forces, contacts, insertion events and what else a score rests
        on, in order of their log times, as the scorer takes them. Repeated and disordered stamps stay.
    Refuses:
        A recording that breaks off or fails a checksum, messages of transforms, forces or states that do not
        fit their definition.
    Source:
        `aic_engine.cpp` and `ScoringTier2.cc` of intrinsic-dev/aic.
    """

    facts = ReaderFacts(
        a_file="a recording of the challenge",
        formats="bags of AIC 2026",
        folders=True,
        beside=("*.yaml", "*.yml"),
    )

    def can_read(self, path: Path) -> bool:
        """Whether it is a ROS recording with topics of the challenge, or named as the engine does it."""
        if not RosbagReader().can_read(path):
            return False
        if path.is_dir() and path.name.startswith("bag_"):
            return True
        files = [path] if path.is_file() else sorted(path.iterdir())
        return any(map(_is_marked, files))

    def describe(self, path: Path) -> LogDescription:
        """The topics, as of any recording."""
        return RosbagReader().describe(path)

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The messages that a score can rest on, and the signals that the log map makes of others.

        Raises:
            LogError: The recording is damaged, or a message that counts cannot be decoded.
            NothingToScoreError: It is no recording.
        """
        found = read_columns(path, _FIELDS, jobs=wanted.jobs)
        messages = messages_of(_name_of(path), found, path)
        wanted.progress(1.0)
        trial = self._others(path, wanted)
        return Trial(
            id=messages.name,
            signals={} if trial is None else trial.signals,
            bodies=() if trial is None else trial.bodies,
            events=() if trial is None else trial.events,
            witnessed=frozenset() if trial is None else trial.witnessed,
            records=(messages,),
            clocks=(Clock("log time", None if found.recorded_ns is None else found.recorded_ns[0]),)
            if trial is None
            else trial.clocks,
            recorded=_span_of(found) if trial is None else trial.recorded,
            log_defects=tuple(_defects(messages)),
            attestation=None if trial is None else trial.attestation,
        )

    def _others(self, path: Path, wanted: Wanted) -> Trial | None:
        """What the log map makes of the recording, where the rules want more than the scorer's messages."""
        if not wanted.log_map.channels_for(wanted.quantities):
            return None
        return RosbagReader().read(path, wanted)


def _is_marked(file: Path) -> bool:
    try:
        if not file.is_file():
            return False
        with file.open("rb") as stream:
            start = stream.read(_SNIFFED_BYTES)
            stream.seek(max(0, file.stat().st_size - _SNIFFED_BYTES))
            both = start + stream.read(_SNIFFED_BYTES)
    except OSError:
        return False
    return any(mark in both for mark in _MARKS)


def _name_of(path: Path) -> str:
    """The name that the engine gave to the recording: of its folder, also where a file in it is given."""
    resolved = path.resolve()
    if resolved.is_dir():
        return resolved.name
    folder = resolved.parent.name
    return folder if folder.startswith("bag_") else resolved.stem


def _span_of(found: RecordedColumns) -> Span | None:
    if found.recorded_ns is None:
        return None
    first_ns, last_ns = found.recorded_ns
    return Span(0.0, (last_ns - first_ns) / 1e9)


def messages_of(name: str, found: RecordedColumns, file: Path) -> AicMessages:
    """The messages of a recording in order of consumption.

    Raises:
        LogError: A message that counts cannot be decoded.
    """
    _refuse_undecodable(found, file)
    place = _Places(found)
    return AicMessages(
        name,
        found.recorded_ns,
        dict(sorted(found.counts.items())),
        _transforms(found, place),
        _controller(found, place),
        {topic: _wrenches(found, place, topic) for topic in WRENCHES if topic in found.topics},
        _contacts(found, place),
        _texts(found, place, EVENT),
        _texts(found, place, ACTIVATED),
        _log(found, place),
        {topic: _log_times(found, topic) for topic in COMMANDS if topic in found.topics},
        _repeats(found),
        _log_times(found, CONTACTS),
    )


def _refuse_undecodable(found: RecordedColumns, file: Path) -> None:
    """An insertion event of foreign bytes is one all the same; of everything else nothing may be left out."""
    for topic, cause in found.unreadable.items():
        if topic not in (EVENT, LOG, *COMMANDS):
            raise LogError(
                f"topic {topic} cannot be decoded: {cause}", file=file, hint="record with message definitions"
            )
    for message in found.refused:
        if message.topic not in (EVENT, ACTIVATED, LOG, *COMMANDS):
            raise LogError(
                f"message {message.number} on {message.topic} does not fit its type: {message.cause}",
                file=file,
                hint="record the trial again, or take another copy of the file",
            )


class _Places:
    """The place of each message in order of consumption: by time of recording, then as recorded."""

    def __init__(self, found: RecordedColumns) -> None:
        log_ns = [part.log_ns for part in found.parts] + [
            np.array([m.log_ns for m in found.refused], dtype=np.int64)
        ]
        numbers = [part.numbers for part in found.parts] + [
            np.array([m.number for m in found.refused], dtype=np.int64)
        ]
        self._all_ns, self._all = np.concatenate(log_ns), np.concatenate(numbers)
        by_number = np.argsort(self._all)
        self._sorted = self._all[by_number]
        order = np.lexsort((self._all, self._all_ns))
        rank = np.empty(len(order), dtype=np.int64)
        rank[order] = np.arange(1, len(order) + 1)
        self._rank = rank[by_number]

    def of(self, numbers: IntArray) -> IntArray:
        """The places of messages, given by their numbers in the file."""
        found: IntArray = self._rank[np.searchsorted(self._sorted, numbers)]
        return found


def _ordered(
    parts: Iterable[MessageColumns], place: _Places, paths: Iterable[str]
) -> tuple[IntArray, dict[str, Any]]:
    """The places of the messages of a topic and columns of one value each, in order of consumption."""
    found = list(parts)
    wanted = list(paths)
    if not found:
        return np.empty(0, dtype=np.int64), {path: np.empty(0) for path in wanted}
    places = np.concatenate([place.of(part.numbers) for part in found])
    order = np.argsort(places, kind="stable")
    columns = {}
    for path in wanted:
        if all(path in part.columns for part in found):
            columns[path] = np.concatenate([part.columns[path].values for part in found])[order]
    return places[order], columns


def _stamps(columns: Mapping[str, Any], prefix: str = "header.stamp.") -> IntArray:
    seconds = columns[f"{prefix}sec"].astype(np.int64)
    nanoseconds: IntArray = seconds * 10**9 + columns[f"{prefix}nanosec"].astype(np.int64)
    return nanoseconds


def _vectors(columns: Mapping[str, Any], paths: tuple[str, ...]) -> FloatArray:
    """Columns side by side; zeros where an older definition has no such field."""
    count = len(next(iter(columns.values()))) if columns else 0
    return np.column_stack(
        [np.asarray(columns.get(path, np.zeros(count)), dtype=np.float64) for path in paths]
    ).reshape(count, len(paths))


def _controller(found: RecordedColumns, place: _Places) -> Controller:
    order, columns = _ordered(found.of(CONTROLLER), place, _FIELDS[CONTROLLER])
    return Controller(order, _stamps(columns), _vectors(columns, _VELOCITY), _vectors(columns, _OFFSET))


def _wrenches(found: RecordedColumns, place: _Places, topic: str) -> Wrenches:
    order, columns = _ordered(found.of(topic), place, _FIELDS[topic])
    return Wrenches(order, _stamps(columns), _vectors(columns, _FORCE))


def _log_times(found: RecordedColumns, topic: str) -> IntArray:
    parts = [part.log_ns for part in found.of(topic)]
    times = np.concatenate(parts) if parts else np.empty(0, dtype=np.int64)
    late = [m.log_ns for m in found.refused if m.topic == topic]
    return np.sort(np.concatenate([times, np.array(late, dtype=np.int64)]))


def _transforms(found: RecordedColumns, place: _Places) -> Transforms:
    numbering: dict[str, int] = {}
    columns: list[tuple[Any, ...]] = []
    for index, name in enumerate(_TF_TOPICS):
        for part in found.of(name):
            counts = part.columns["transforms.child_frame_id"].per_message()
            order = np.repeat(place.of(part.numbers), counts)
            values = {path.removeprefix("transforms."): c.values for path, c in part.columns.items()}
            names = [
                _numbered(part.columns[f"transforms.{key}"], numbering)
                for key in ("header.frame_id", "child_frame_id")
            ]
            at = [values[f"transform.translation.{axis}"] for axis in _AXES]
            turn = [values[f"transform.rotation.{axis}"] for axis in ("x", "y", "z", "w")]
            rows = np.column_stack([*at, *turn]).astype(np.float64)
            columns.append((order, np.full(len(order), index), _stamps(values), *names, rows))
    if not columns:
        return Transforms(topics=_TF_TOPICS)
    joined = [np.concatenate(parts) for parts in zip(*columns, strict=True)]
    by_place = np.argsort(joined[0], kind="stable")  # transforms of one message keep their order
    order, topic, stamps, parents, children, rows = (part[by_place] for part in joined)
    return Transforms(order, topic, stamps, parents, children, rows, _TF_TOPICS, tuple(numbering))


def _numbered(column: Any, numbering: dict[str, int]) -> IntArray:
    """The codes of a column of names, in one numbering for all; a leading slash is dropped as tf2 does it."""
    used = np.flatnonzero(np.bincount(column.values, minlength=len(column.texts)))
    table = np.zeros(max(len(column.texts), 1), dtype=np.int64)
    for code in used.tolist():
        table[code] = numbering.setdefault(column.texts[code].removeprefix("/"), len(numbering))
    codes: IntArray = table[column.values]
    return codes


def _texts(found: RecordedColumns, place: _Places, topic: str) -> Texts:
    rows: list[tuple[int, int, bytes]] = []
    for part in found.of(topic):
        places = place.of(part.numbers).tolist()
        column = part.columns["data"]
        said = [t.encode() for t in column.text()] if column.texts is not None else _truths(column.values)
        rows += list(zip(places, part.log_ns.tolist(), said, strict=True))
    for message in found.refused:
        if message.topic == topic:
            number = np.array([message.number], dtype=np.int64)
            rows.append((int(place.of(number)[0]), message.log_ns, _bytes_of_text(message.payload)))
    return _of_rows(sorted(rows))


def _truths(values: Any) -> list[bytes]:
    """The events of a topic of truths, as before February 12: true for any insertion."""
    return [b"true" if value else b"" for value in values]


def _bytes_of_text(payload: bytes) -> bytes:
    """The bytes of a `std_msgs/String` that is no UTF-8."""
    little = payload[1:2] != b"\0"
    length = int.from_bytes(payload[4:8], "little" if little else "big")
    return payload[8 : 8 + max(length - 1, 0)]


def _of_rows(rows: list[tuple[int, int, bytes]]) -> Texts:
    places, log_ns, texts = ([row[i] for row in rows] for i in range(3))
    times = np.array(log_ns, dtype=np.int64)
    return Texts(np.array(places, dtype=np.int64), times, times, tuple(texts))  # type: ignore[arg-type]  # by column


def _contacts(found: RecordedColumns, place: _Places) -> Texts:
    """The messages that hold a contact, each with its first pair of names."""
    rows: list[tuple[int, int, bytes]] = []
    for part in found.of(CONTACTS):
        first, second = (part.columns[path] for path in _PAIR)
        counts = first.per_message()
        begins = np.cumsum(counts) - counts
        places = place.of(part.numbers)
        for i in np.flatnonzero(counts).tolist():
            at = int(begins[i])
            pair = [c.texts[c.values[at]].encode() for c in (first, second) if c.texts is not None]
            rows.append((int(places[i]), int(part.log_ns[i]), b"\0".join(pair)))
    return _of_rows(sorted(rows))


def _log(found: RecordedColumns, place: _Places) -> Texts:
    rows: list[tuple[int, int, int, bytes]] = []
    for part in found.of(LOG):
        stamps = _stamps({path: column.values for path, column in part.columns.items()}, "stamp.")
        places, texts = place.of(part.numbers).tolist(), [t.encode() for t in part.columns["msg"].text()]
        rows += list(zip(places, part.log_ns.tolist(), stamps.tolist(), texts, strict=True))
    rows.sort()
    order, log_ns, stamps = (np.array([row[i] for row in rows], dtype=np.int64) for i in range(3))
    return Texts(order, log_ns, stamps, tuple(row[3] for row in rows))


def _repeats(found: RecordedColumns) -> int:
    """How often each state of the controller is recorded: n times in the n-th trial of a run."""
    stamps = [_stamps({p: c.values for p, c in part.columns.items()}) for part in found.of(CONTROLLER)]
    stamps = [s for s in stamps if len(s)]
    if not stamps:
        return 1
    _, counts = np.unique(np.concatenate(stamps), return_counts=True)
    return int(np.median(counts))


def _defects(messages: AicMessages) -> Iterable[LogDefect]:
    if messages.repeats > 1:
        yield LogDefect(
            "repeated_messages",
            messages.name,
            messages.repeats,
            f"each message is recorded {messages.repeats} times, as in those of later trials of a run; "
            "they count as the scorer counts them",
        )
    refused = refused_rows(messages.transforms)
    if refused.any():
        frames = sorted(
            {messages.transforms.names[code] for code in messages.transforms.child[refused].tolist()}
        )
        shown = ", ".join(name or "(no name)" for name in frames[:_SHOWN])
        more = f" and {len(frames) - _SHOWN} more" if len(frames) > _SHOWN else ""
        yield LogDefect(
            "refused_transforms",
            messages.name,
            int(refused.sum()),
            f"tf2 refuses transforms of {shown}{more}: a quaternion whose norm is not 1, a number that is "
            "none, or a frame without a name or below itself; they do not count",
        )
    if CONTROLLER not in messages.topics:
        yield LogDefect(
            "no_controller_state", CONTROLLER, 1, "without states of the controller no force counts as coded"
        )
    if not messages.witnesses_contacts:
        yield LogDefect("no_contacts", CONTACTS, 1, "contacts were not recorded; as coded, none is none")
