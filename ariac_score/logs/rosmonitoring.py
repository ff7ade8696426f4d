"""Logs of ROSMonitoring: one JSON object for each event its monitors saw, of every generation.

Events carry no message type: a topic has the type that the log map gives it. A service
named `x` is read as the topics `/x/request` and `/x/response`.

Source: ROSMonitoring 3.0.0 and its older branches, event and status logs as their nodes write them.
"""

from __future__ import annotations

import json
import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from keyword import iskeyword
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from ariac_score.checks.contracts import LogDescription, ReaderFacts, TopicDescription, Wanted
from ariac_score.documents.json_pairs import without_repeats
from ariac_score.errors import CutOffError, LogError, NothingToScoreError
from ariac_score.logs.containers.items import Batch, Connection, Message, normalised_type
from ariac_score.logs.gather.clocks import LARGEST_CLOCK_DIFFERENCE_S
from ariac_score.logs.gather.collected_columns import by_header, clock_key
from ariac_score.logs.gather.collector import Collector
from ariac_score.logs.gather.intake import MessageRoute
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import Channel, LogMap
from ariac_score.trial.clock import SIMULATED_TIME, WALL_CLOCK_TIME, Clock
from ariac_score.trial.cut import cut_at
from ariac_score.trial.events import TIMED_EVENTS
from ariac_score.trial.model import LogDefect, Trial
from ariac_score.trial.spans import Span
from ariac_score.trial.work import at_times

__all__ = [
    "MAX_LINE_BYTES",
    "UNSEEN",
    "RosMonitoringReader",
    "Row",
    "channel_of",
    "clock_of",
    "fields_of",
    "parse_object",
    "rows",
    "stamp_s",
]

MAX_LINE_BYTES = 10_000_000
MAX_DEPTH = 50
"""Messages are not nested deeper; a deeper value stays a plain dictionary, which fits no field."""
LATEST_S = 9.0e9
"""Numbers beyond this (the year 2255) are not taken as stamps."""
FIRST_UNIX_S = 1e9
"""Stamps from here on (September 2001) count from 1970; no simulation runs for thirty years."""

UNTIMED = "no time"

UNSEEN = "/ariac_score/unseen"
"""Topic of an event that says what nobody saw: nothing is known between its `since` and its `time`.

Our oracle writes it where a conversation was interrupted, and our monitor node where it had to drop messages.
"""

_CUT = "record the trial again, or cut the log after its last whole line knowingly"
_PEEK_BYTES = 1 << 16
_PROGRESS_EVERY = 4096


# Lines of a log -------------------------------------------------------------------------


@dataclass(frozen=True)
class Row:
    """One event of a log.

    Attributes:
        line: Its line, from 1.
        event: The event as recorded.
        verdict: The verdict of that run's oracle; `None` where the log has none.
    """

    line: int
    event: dict[str, Any]
    verdict: object = None


# Python's decoder takes NaN and Infinity, which JSON lacks: the monitors write them.
_DECODER = json.JSONDecoder(object_pairs_hook=without_repeats)


def parse_object(text: str) -> dict[str, Any]:
    """The one JSON object of a text, with `NaN` and `Infinity` as the monitors write them.

    Raises:
        ValueError: It is not JSON, is nested too deeply, names a key twice, or is no object.
    """
    try:
        found = _DECODER.decode(text)
    except RecursionError:
        raise ValueError("nested too deeply") from None
    if not isinstance(found, dict):
        raise ValueError(f"a {type(found).__name__}, not an object")
    return found


def rows(path: Path) -> Iterator[Row]:
    """The events of an event log, a status log or an oracle's log, in recorded order.

    Raises:
        LogError: A line is no JSON, holds something other than objects, is longer than
            `MAX_LINE_BYTES`, or is cut off; two monitors of a status log saw the same interface.
        NothingToScoreError: The file is empty.
    """
    monitors: dict[str, str] = {}
    for line, found in _objects(path):
        if _is_reply(found):
            yield Row(line, found["event"], found["verdict"])
        elif not _is_status(found):
            yield Row(line, found, found.get("verdict"))
        elif found["status"] == "event" and isinstance(found.get("event"), dict):
            interface, monitor = str(found.get("interface")), str(found["monitor"])
            if monitors.setdefault(interface, monitor) != monitor:
                raise _fault(
                    path,
                    line,
                    f"two monitors ({monitors[interface]!r} and {monitor!r}) saw {interface}",
                    "read the event log of one of them; in this status log each message stands twice",
                )
            yield Row(line, found["event"], found.get("verdict_raw", found.get("verdict")))


def _is_status(found: Mapping[str, Any]) -> bool:
    """Whether an object is a row of a status log."""
    return "status" in found and "monitor" in found and not channel_of(found)


def _is_reply(found: Mapping[str, Any]) -> bool:
    """Whether an object is a row of an oracle's own log: the event and the answer."""
    return found.keys() == {"event", "verdict"} and isinstance(found["event"], dict)


def _objects(path: Path) -> Iterator[tuple[int, dict[str, Any]]]:
    """Every object with its line; a line may hold several."""
    number = 0
    try:
        with path.open("rb") as stream:
            # One byte beyond the limit shows that a line is too long, without reading all of it.
            while line := stream.readline(MAX_LINE_BYTES + 1):
                number += 1
                if len(line) > MAX_LINE_BYTES:
                    cause = f"the line is longer than {MAX_LINE_BYTES:,} bytes"
                    raise _fault(path, number, cause, "one event on each line")
                for found in _in_line(path, number, line):
                    yield number, found
    except OSError as cause:
        raise LogError(
            f"cannot be read: {cause.strerror}", file=path, hint="check the permissions"
        ) from cause
    if not number:
        raise NothingToScoreError("the file is empty", file=path, hint="was the monitor running?")


def _in_line(path: Path, number: int, line: bytes) -> Iterator[dict[str, Any]]:
    # The monitors themselves replace bytes that are not UTF-8.
    text = line.decode("utf-8", errors="replace").strip().removeprefix("\ufeff")
    at = 0
    while at < len(text):
        try:
            found, at = _DECODER.raw_decode(text, at)
        except (ValueError, RecursionError) as cause:
            whole = line.endswith(b"\n")
            if whole:
                raise _fault(path, number, f"not JSON: {cause}", _CUT) from None
            words = f"the log is cut off: {cause}"
            raise CutOffError(words, file=path, place=f"line {number}", hint=_CUT) from None
        if not isinstance(found, dict):
            raise _fault(path, number, f"a {type(found).__name__}, not an event", "events are JSON objects")
        yield found
        # Some versions write events next to each other, or separated by commas.
        while at < len(text) and text[at] in " \t\r,":
            at += 1


def _fault(path: Path, number: int, cause: str, hint: str) -> LogError:
    return LogError(cause, file=path, place=f"line {number}", hint=hint)


def channel_of(event: Mapping[str, Any]) -> str:
    """The topic of an event, with leading slash; of a service with `/request` or `/response`; else empty.

    >>> channel_of({"topic": "chatter"}), channel_of({"service": "/add", "request": {}})
    ('/chatter', '/add/request')
    """
    topic, service = event.get("topic"), event.get("service")
    if isinstance(topic, str) and topic.strip("/"):
        return "/" + topic.strip("/")
    if isinstance(service, str) and service.strip("/"):
        for direction in ("request", "response"):
            if direction in event:
                return f"/{service.strip('/')}/{direction}"
    return ""


def stamp_s(event: Mapping[str, Any]) -> float | None:
    """The time of an event as recorded, s; `None` where it has none, or one that is no time."""
    time = event.get("time")
    if isinstance(time, bool) or not isinstance(time, int | float) or not 0 <= time < LATEST_S:
        return None
    return float(time)


def clock_of(time_s: float | None) -> str:
    """The kind of clock of a stamp: simulated seconds for messages with a header, else seconds since 1970."""
    if time_s is None:
        return UNTIMED
    return WALL_CLOCK_TIME if time_s >= FIRST_UNIX_S else SIMULATED_TIME


# Messages --------------------------------------------------------------------------------

_ARRAY = re.compile(r"array\('([bBhHiIlLqQfd])'(?:, \[(.*)\])?\)", re.DOTALL)
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|[-+]?(?:nan|inf)")
_WORDS: Mapping[str, bool] = {"True": True, "False": False}


def fields_of(event: Mapping[str, Any]) -> Any:
    """The message of an event, with its fields as attributes, like the messages of a bag.

    Arrays that were written as text become lists again; an abbreviated one (`...`) stays text.
    """
    channel = channel_of(event)
    body: Any = event
    for direction in ("request", "response"):
        if "topic" not in event and channel.endswith(f"/{direction}"):
            body = event[direction]
    return _as_message(body)


def _as_message(value: Any, deepest: int = MAX_DEPTH) -> Any:
    if isinstance(value, dict) and deepest:
        named = {f"{k}_" if iskeyword(k) else k: _as_message(v, deepest - 1) for k, v in value.items()}
        return SimpleNamespace(**named)
    if isinstance(value, list) and deepest:
        return [_as_message(item, deepest - 1) for item in value]
    if isinstance(value, str) and value[:1] in ("[", "a"):
        return _list_in(value)
    return value


def _list_in(text: str) -> Any:
    """The list that a text represents; any other text unchanged.

    >>> _list_in("array('d', [1.0, 2.0])"), _list_in("[1.5 2. ]"), _list_in("[0. ... 9.]")
    ([1.0, 2.0], [1.5, 2.0], '[0. ... 9.]')
    """
    typed = _ARRAY.fullmatch(text)
    if typed:
        words = [word.strip() for word in typed[2].split(",")] if typed[2] else []
        whole = typed[1] not in "fd"
    elif text.startswith("[") and text.endswith("]"):
        words = text[1:-1].split()
        whole = bool(words) and all(re.fullmatch(r"[-+]?\d+", word) for word in words)
    else:
        return text
    if all(word in _WORDS for word in words):
        return [_WORDS[word] for word in words]
    if not all(len(word) < 400 and _NUMBER.fullmatch(word) for word in words):
        return text
    try:
        return [int(word) if whole else float(word) for word in words]
    except ValueError:
        return text


# The reader ------------------------------------------------------------------------------


class RosMonitoringReader:
    """Reads event logs and status logs of ROSMonitoring (`.jsonl`), of every generation.

    Reads:
        Any order of keys, blank lines, several events on a line, `NaN` and `Infinity`, arrays
        written as text, events without time, and the `verdict` and `spec` of older logs.
        Stamps below 1e9 s are simulation time, which is kept; others are wall-clock time,
        counted from the first. Where both occur, the clock of the motion counts, and events
        on the other keep what needs no time. A transform has its own stamp, where that is
        within a minute of its event's.
    Refuses:
        A line that is cut off or no JSON object, and a status log in which two monitors saw
        the same interface.
    Source:
        ROSMonitoring 3.0.0 and its branches `ros1_legacy`, `ros2`, `with_verdict`, `ros_services_1and2`.
    """

    facts = ReaderFacts(formats="ROSMonitoring logs")

    def can_read(self, path: Path) -> bool:
        """Whether its first object is an event or a row of a status log; cheap, and never an error."""
        try:
            if not path.is_file():
                return False
            with path.open("rb") as stream:
                head = stream.read(_PEEK_BYTES)
        except OSError:
            return False
        text = head.decode("utf-8", errors="replace").removeprefix("\ufeff").lstrip()
        if not text.startswith("{"):
            return False
        try:
            found, _ = _DECODER.raw_decode(text)
        except (ValueError, RecursionError):
            # Cut off, or longer than the bytes read here: `read` then reports what is wrong.
            return path.suffix == ".jsonl" and '"record"' not in text and _names_a_channel(text)
        return isinstance(found, dict) and (
            bool(channel_of(found))
            or _is_status(found)
            or (_is_reply(found) and bool(channel_of(found["event"])))
        )

    def describe(self, path: Path) -> LogDescription:
        """Topics with counts, clocks and recorded verdicts; of a damaged log those before the damage."""
        topics = _Topics()
        damage = ""
        try:
            for row in rows(path):
                topics.count(row)
        except LogError as error:
            damage = str(error)
        return topics.described(damage)

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The part of a trial that the events show.

        Raises:
            LogError: A line is damaged, or a signal contradicts itself.
            NothingToScoreError: The log holds no event.
        """
        intake = _Intake(path, wanted)
        size = max(path.stat().st_size, 1) if path.exists() else 1
        cut: CutOffError | None = None
        try:
            for done, row in enumerate(rows(path)):
                intake.take(row.event)
                if done % _PROGRESS_EVERY == 0:
                    wanted.progress(min(0.95, done * 120 / size))
        except CutOffError as error:
            if not wanted.partial:
                raise
            cut = error
        wanted.progress(1.0)
        if not intake.clocks:
            raise NothingToScoreError(
                "the log holds no event", file=path, hint="was the monitor connected to its topics?"
            )
        return intake.trial(cut)


def _names_a_channel(text: str) -> bool:
    return any(f'"{name}"' in text for name in ("topic", "service", "time", "monitor"))


class _EventCollector(Collector):
    """Takes events, whose messages are decoded already."""

    def take(self, item: Connection | Message | Batch) -> None:
        """Take one item, in recorded order, at once: there are no bytes to be decoded together."""
        if not isinstance(item, Message):
            super().take(item)
            return
        self._number += 1
        if item.connection in self._routes:
            self._decode(item, self._number, self._routes[item.connection])

    def _connect(self, connection: Connection) -> None:
        intakes = [intake for intake in self._intakes if intake.accepts(connection)]
        if intakes:
            self._routes[connection] = MessageRoute(intakes, _unchanged, None)

    def _stamped(self, channel: Channel) -> Channel:
        return channel if channel.poses == "frames" else super()._stamped(channel)

    def _stamp_ns(self, item: Message, number: int, message: object, channel: Channel) -> int:
        """The time of the event, but of a transform its own, where that is on the same clock.

        An event has the time of its message's header. A message of transforms has none: each has its own.
        """
        own_ns = _own_stamp_ns(message) if by_header(channel) else None
        if own_ns is not None and abs(own_ns - item.stamp_ns) <= LARGEST_CLOCK_DIFFERENCE_S * 1e9:
            return self._clocks.stamp_ns(clock_key(channel), number, own_ns, item.stamp_ns)
        self._clocks.without_header(clock_key(channel), 1, declared=channel.stamp == "log")
        return item.stamp_ns


def _own_stamp_ns(message: object) -> int | None:
    """The stamp in the header of a message, of ROS 1 or ROS 2, ns; `None` where there is none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    whole = getattr(stamp, "secs", getattr(stamp, "sec", None))
    part = getattr(stamp, "nsecs", getattr(stamp, "nanosec", None))
    return whole * 10**9 + part if isinstance(whole, int) and isinstance(part, int) else None


def _unchanged(payload: Any) -> Any:
    return payload


@dataclass
class _Clock:
    """The events stamped by one clock."""

    collector: _EventCollector
    connections: dict[str, Connection] = field(default_factory=dict)
    first_ns: int | None = None
    last_ns: int = 0
    back_ns: int = 0
    motion: int = 0
    events: int = 0


class _Intake:
    """Takes the events of one log and makes a trial of them."""

    def __init__(self, path: Path, wanted: Wanted) -> None:
        self.clocks: dict[str, _Clock] = {}
        self._path, self._wanted = path, wanted
        self._types = _types(wanted.log_map)
        self._motion = frozenset(
            channel.topic
            for channel in wanted.log_map.channels_for(wanted.quantities)
            if channel.signals or channel.poses
        )
        self._nameless = 0
        self._unseen: list[tuple[float | None, float | None]] = []

    def take(self, event: Mapping[str, Any]) -> None:
        """Take one event."""
        topic = channel_of(event)
        if not topic:
            self._nameless += 1
        time_s = stamp_s(event)
        if topic == UNSEEN:
            self._unseen.append((stamp_s({"time": event.get("since")}), time_s))
            return
        name = clock_of(time_s)
        clock = self.clocks.get(name)
        if clock is None:
            clock = self.clocks[name] = _Clock(
                _EventCollector(self._wanted, self._path, stamped_by_reader=True)
            )
        clock.events += 1
        stamp_ns = 0 if time_s is None else round(time_s * 1e9)
        if time_s is not None:
            clock.first_ns = stamp_ns if clock.first_ns is None else min(clock.first_ns, stamp_ns)
            clock.back_ns = max(clock.back_ns, clock.last_ns - stamp_ns)
            clock.last_ns = max(clock.last_ns, stamp_ns)
        if topic not in self._types:
            return
        clock.motion += topic in self._motion
        connection = clock.connections.get(topic)
        if connection is None:
            connection = Connection(topic, self._types[topic], "ros_monitoring")
            clock.connections[topic] = connection
            clock.collector.take(connection)
        clock.collector.take(Message(connection, stamp_ns, fields_of(event)))

    def trial(self, cut: CutOffError | None = None) -> Trial:
        """The trial that the events show, on the clock of the motion.

        Args:
            cut: Why the log ends before its end, where it does.
        """
        main = max(self.clocks, key=lambda name: (self._weight(name), name))
        chosen = self.clocks[main]
        origin_ns = chosen.first_ns if main == WALL_CLOCK_TIME and chosen.first_ns is not None else 0
        clock = Clock(main, origin_ns or None)
        builder = TrialBuilder(self._path.stem, file=self._path, clock=clock)
        chosen.collector.settle(builder, origin_ns)
        if chosen.first_ns is not None:
            builder.recorded = Span((chosen.first_ns - origin_ns) / 1e9, (chosen.last_ns - origin_ns) / 1e9)
        for name in sorted(self.clocks.keys() - {main}):
            self._without_times(builder, name, main)
        builder.defect("no_channel", "events", self._nameless, "events name no topic or service")
        if cut is not None:
            end_s = None if builder.recorded is None else builder.recorded.end_s
            builder.cut = cut_at(cut, self._path.name, end_s, largest_step_back_s=chosen.back_ns / 1e9)
        trial = builder.build()
        if self._unseen:
            trial = _with_unseen(trial, [_stretch(trial, one, main, origin_ns) for one in self._unseen])
        return trial if main != UNTIMED else _timeless(trial)

    def _weight(self, name: str) -> tuple[bool, int, int]:
        """How much depends on a clock: motion first; events without time weigh least."""
        clock = self.clocks[name]
        return name != UNTIMED, clock.motion, clock.events

    def _without_times(self, builder: TrialBuilder, name: str, main: str) -> None:
        """Keep events of another clock without their times.

        As in `merge_trials`: start, end and announcements mean nothing without their time;
        collisions and drops are put at the end. Motion means nothing without its times.
        """
        clock = self.clocks[name]
        other = TrialBuilder(self._path.stem, file=self._path, clock=Clock(name))
        clock.collector.settle(other, 0)
        end_s = 0.0 if builder.recorded is None else builder.recorded.end_s
        untimed = other.build()
        for item in at_times(untimed.work, lambda _t_s: None):
            builder.add(item)
        for submission in untimed.submissions:
            builder.add(replace(submission, submitted_s=end_s))
        for event in untimed.events:
            if event.kind not in TIMED_EVENTS:
                builder.add(replace(event, t_s=end_s))
        builder.witnessed |= untimed.witnessed
        for body in untimed.bodies:
            builder.add_body(body)
        for defect in untimed.log_defects:
            builder.defect(defect.kind, defect.where, defect.count, defect.message)
        # A topic is recorded if events of either clock are, except motion, which needs its times.
        builder.unrecorded = sorted({*builder.unrecorded} & {*untimed.unrecorded})
        builder.unrecorded += [
            f"signal {s}: stamped in {name}, the motion in {main}"
            for s in (*untimed.signals, *untimed.as_consumed)
        ]
        builder.defect("other_clock", name, clock.events, _other_clock(name, main))


def _stretch(
    trial: Trial, unseen: tuple[float | None, float | None], clock: str, origin_ns: int
) -> Span | None:
    """When nothing was seen; all the time, where that is not known on the clock of the trial."""
    since_s, until_s = unseen
    if since_s is None or until_s is None or not clock_of(since_s) == clock_of(until_s) == clock:
        return trial.recorded
    start_s, end_s = ((round(t_s * 1e9) - origin_ns) / 1e9 for t_s in unseen if t_s is not None)
    return Span(start_s, end_s) if start_s < end_s else None


def _with_unseen(trial: Trial, stretches: Sequence[Span | None]) -> Trial:
    """A trial of which it is known that events are missing: signals have holes, and silence says nothing."""
    holes = {stretch for stretch in stretches if stretch is not None}
    signals = {
        name: signal if signal.constant else replace(signal, holes=tuple(sorted({*signal.holes, *holes})))
        for name, signal in trial.signals.items()
    }
    words = "stretch(es) in which nobody saw what happened, as when an oracle was ended and started again"
    defect = LogDefect("unseen", UNSEEN, len(stretches), words)
    return replace(
        trial,
        signals=signals,
        witnessed=frozenset(),
        log_defects=tuple(sorted((*trial.log_defects, defect))),
    )


def _other_clock(name: str, main: str) -> str:
    stamped = "events have no time" if name == UNTIMED else f"events are stamped in {name}"
    return f"{stamped}, the others in {main}; what needs a time was not taken from them"


def _timeless(trial: Trial) -> Trial:
    """A log without any time: orders and submissions, but nothing that happened in between."""
    return replace(
        trial,
        work=at_times(trial.work, lambda _t_s: None),
        events=tuple(event for event in trial.events if event.kind not in TIMED_EVENTS),
        signals={},
        as_consumed={},
        recorded=None,
        unrecorded=(*trial.unrecorded, *(f"signal {one.name}: it has no times" for one in trial.sampled)),
        clocks=(),
    )


def _types(log_map: LogMap) -> dict[str, str]:
    """The message type of each topic of a log map: the first that it names, for events carry none."""
    found: dict[str, str] = {}
    for channel in log_map.channels:
        known = found.get(channel.topic)
        if not known:
            found[channel.topic] = normalised_type(channel.type) or _POSE_TYPES.get(_poses(channel), "")
    return found


def _poses(channel: Channel) -> str:
    return "links" if channel.poses == "models" and channel.topic.endswith("link_states") else channel.poses


_POSE_TYPES: Mapping[str, str] = {
    "frames": "tf2_msgs/msg/TFMessage",
    "models": "gazebo_msgs/msg/ModelStates",
    "links": "gazebo_msgs/msg/LinkStates",
}


# Describing ------------------------------------------------------------------------------


class _Topics:
    """Counts the contents of a log."""

    def __init__(self) -> None:
        self._stamps: dict[str, list[float]] = defaultdict(list)
        self._counts: Counter[str] = Counter()
        self._clocks: Counter[str] = Counter()
        self._verdicts: Counter[str] = Counter()

    def count(self, row: Row) -> None:
        """Count one event."""
        topic, time_s = channel_of(row.event), stamp_s(row.event)
        self._counts[topic] += 1
        self._clocks[clock_of(time_s)] += 1
        if time_s is not None:
            self._stamps[topic].append(time_s)
        if row.verdict is not None:
            self._verdicts[str(row.verdict).lower()] += 1

    def described(self, damage: str) -> LogDescription:
        """The description; times are as recorded."""
        steps = [(t, sum(b < a for a, b in pairwise(s))) for t, s in sorted(self._stamps.items())]
        spans = [
            max(own) - min(own)
            for clock in (SIMULATED_TIME, WALL_CLOCK_TIME)
            if (own := [t for s in self._stamps.values() for t in s if clock_of(t) == clock])
        ]
        return LogDescription(
            format="ROSMonitoring log",
            topics=tuple(self._topic(name) for name in sorted(self._counts)),
            clock=" and ".join(sorted(self._clocks)),
            facts={
                "events": sum(self._counts.values()),
                **{f"verdict {name}": self._verdicts[name] for name in sorted(self._verdicts)},
            },
            defects=tuple(
                LogDefect("disordered_stamps", topic, count, "stamps run backwards")
                for topic, count in steps
                if count
            ),
            damage=damage,
            duration_s=max(spans, default=0.0),
        )

    def _topic(self, name: str) -> TopicDescription:
        stamps = np.sort(np.array(self._stamps.get(name, []), dtype=np.float64))
        if not len(stamps):
            return TopicDescription(name or "(no topic)", "event", self._counts[name])
        gap_s = float(np.diff(stamps).max()) if len(stamps) > 1 else None
        return TopicDescription(
            name or "(no topic)", "event", self._counts[name], float(stamps[0]), float(stamps[-1]), gap_s
        )
