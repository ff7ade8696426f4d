"""What a channel of a log map takes from messages: samples, events, facts and items of work."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from keyword import iskeyword
from operator import attrgetter
from typing import Any

import numpy as np

from ariac_score.checks.contracts import Wanted
from ariac_score.errors import LogError
from ariac_score.logs.columnar import ColumnDecoder
from ariac_score.logs.columnar.types import Decode
from ariac_score.logs.containers.items import Connection, IntArray, normalised_type
from ariac_score.logs.gather.arrival import arrival_delays_s, arrival_jitter_s
from ariac_score.logs.gather.clocks import CLOCK_TOPIC, CLOCK_TYPE, Clocks
from ariac_score.logs.gather.collected_columns import Decoded, Needs
from ariac_score.logs.gather.competition_states import changes
from ariac_score.logs.gather.message_fields import NUMBER, nearest, number_paths, value_at
from ariac_score.logs.gather.numbering import TopicNumbering, Unknown
from ariac_score.logs.gather.stated import ChannelDecoder, facts_of
from ariac_score.logs.gather.transforms import Placed, TransformTree, times_s
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import Channel, FieldMap, LogMap
from ariac_score.trial.events import WATCHING, Event
from ariac_score.trial.model import Due
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vocabulary import quantity_of

__all__ = ["Intake", "MessageRoute", "Ticks"]

_LIKE = 0.85
"""How alike the name of a recorded topic must be to one that is not recorded to be taken for it."""

_POSE_TYPES = {
    "frames": ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"),
    "models": ("gazebo_msgs/msg/ModelStates", "gazebo_msgs/msg/LinkStates"),
}


@dataclass(frozen=True)
class MessageRoute:
    """Where the messages of a connection go, and how they are decoded.

    Attributes:
        intakes: The channels that take them.
        decode: Decodes one.
        columns: Decodes many at once; `None` when they must be decoded one by one.
        topic: Of the connection.
        alone: Why columns cannot be decoded although the channels need no whole messages.
    """

    intakes: Sequence[Intake]
    decode: Decode
    columns: ColumnDecoder | None
    topic: str = ""
    alone: str = ""

    @property
    def slow(self) -> str:
        """Why its messages were decoded one by one; empty where whole messages are needed anyway."""
        return self.alone or (self.columns.fallback if self.columns else "")

    def targets(self) -> set[object]:
        """Where their contents go: intakes by identity; all poses go to one place."""
        return {"poses" if intake.channel.poses else intake for intake in self.intakes}


@dataclass(eq=False)
class _Column:
    """The values of one signal so far."""

    field_map: FieldMap
    getters: tuple[Callable[[object], object], ...]
    stamps_ns: array[int] = field(default_factory=lambda: array("q"))
    values: array[float] = field(default_factory=lambda: array("d"))
    waiting: list[tuple[IntArray, IntArray, FloatArray]] = field(default_factory=list)

    def settle(self) -> None:
        """Append what is waiting, in recorded order whichever connection it came by."""
        if not self.waiting:
            return
        numbers, stamps_ns, rows = (np.concatenate(parts) for parts in zip(*self.waiting, strict=True))
        if len(self.waiting) > 1:
            order = np.argsort(numbers, kind="stable")
            stamps_ns, rows = stamps_ns[order], rows[order]
        self.stamps_ns.frombytes(stamps_ns.tobytes())
        self.values.frombytes(rows.tobytes())
        self.waiting.clear()


class Intake:
    """What one channel of the log map receives."""

    def __init__(self, channel: Channel, wanted: Wanted) -> None:
        self.channel = channel
        self.received = 0
        self.by_arrival = False
        self.frame_ids: set[str] = set()
        self.elsewhere = ""  # the frame of its positions, where they are to be transformed
        self.sent, self.unknown = TopicNumbering(), Unknown()
        self.untyped: dict[str, str] = {}
        self.foreign: dict[str, None] = {}  # types on the topic that no channel takes
        self.undecodable: list[str] = []
        self.refused: dict[int, str] = {}
        self._type = normalised_type(channel.type)
        self._other_types: set[str] = set()
        self._types: set[str] = set()
        self._lacking: dict[str, str] = {}
        self._columns = [
            _Column(f, tuple(_getter(path) for path in f.fields))
            for f in channel.signals
            if quantity_of(f.signal) in wanted.quantities
        ]
        self._items: list[tuple[str, object, int]] = []
        self._watched: set[str] = set()
        self._retimed: Callable[[IntArray], IntArray] = np.asarray
        decoder = wanted.decoders.get(channel.decoder)
        self.only_changes = not channel.facts and bool(getattr(decoder, "only_changes", False))

    def is_on(self, connection: Connection) -> bool:
        """Whether a connection is of the channel's topic, of whatever type."""
        # Recorders write topics with or without leading slash.
        return connection.topic.lstrip("/") == self.channel.topic.lstrip("/")

    def accepts(self, connection: Connection) -> bool:
        """Whether the messages of a connection are for this channel."""
        channel = self.channel
        if not self.is_on(connection):
            return False
        # `tf/tfMessage` is the type of tf before tf2, with the same fields.
        allowed = (self._type,) if self._type else _POSE_TYPES.get(channel.poses, ())
        if allowed and connection.type not in allowed:
            self._other_types.add(connection.type)
            return False
        self._types.add(connection.type)
        return True

    @property
    def places(self) -> bool:
        """Whether it gives positions."""
        return any(quantity_of(column.field_map.signal) == "position" for column in self._columns)

    @property
    def needs(self) -> Needs:
        """The fields it needs of a message."""
        paths = tuple(path for column in self._columns for path in column.field_map.fields)
        return Needs(self.channel, paths, self.places)

    def retime(self, retimed: Callable[[IntArray], IntArray]) -> None:
        """Put its stamps on another clock."""
        self._retimed = retimed
        for column in self._columns:
            column.stamps_ns = array("q", retimed(np.array(column.stamps_ns, dtype=np.int64)).tobytes())
        kept_ns = np.array([stamp_ns for _, _, stamp_ns in self._items], dtype=np.int64)
        self._items = [
            (type_, message, stamp_ns)
            for (type_, message, _), stamp_ns in zip(self._items, retimed(kept_ns).tolist(), strict=True)
        ]

    def take_columns(self, decoded: Decoded, stamps_ns: IntArray) -> None:
        """Keep the wanted fields of many messages."""
        for column in self._columns:
            rows = decoded.values_of(column.field_map.fields)
            column.waiting.append((decoded.sequence_numbers, stamps_ns, rows))

    def settle_columns(self) -> None:
        """Append what is waiting, in recorded order."""
        for column in self._columns:
            column.settle()
        self.undecodable += [self.refused[number] for number in sorted(self.refused)]
        self.refused.clear()

    def take(self, message: object, type_: str, stamp_ns: int) -> None:
        """Keep the wanted fields of a message, and for a decoder plugin the whole message."""
        if self.channel.whole:
            self._items.append((type_, message, stamp_ns))
        for column in self._columns:
            try:
                row = [_number(getter(message)) for getter in column.getters]
            except (AttributeError, TypeError):
                signal = column.field_map.signal
                if signal not in self._lacking:
                    self._lacking[signal] = _lack(message, column.field_map, type_)
                continue
            column.stamps_ns.append(stamp_ns)
            column.values.extend(row)

    def settle(self, builder: TrialBuilder, origin_ns: int, wanted: Wanted, *, numbered: bool) -> None:
        """Hand everything but poses to the builder; `numbered`: publishers numbered the messages."""
        topic = self.channel.topic

        def to_trial_s(stamps_ns: IntArray) -> FloatArray:
            return times_s(self._retimed(stamps_ns), origin_ns)

        if self.channel.poses == "frames":
            self.unknown = self.sent.unknown(builder, topic, to_trial_s, numbered=numbered, shared=True)
        else:
            self.unknown = self.sent.unknown(builder, topic, to_trial_s, numbered=numbered)
        if self.undecodable:
            builder.defect(
                "undecodable_messages",
                topic,
                len(self.undecodable),
                f"messages do not fit their definition; the first: {self.undecodable[0]}",
            )
        strange = [*self.untyped, *self.foreign]
        if strange and self.received:  # where nothing was, the topic is told to be missing
            words = f"messages of {', '.join(repr(one) for one in strange[:3])} cannot be read"
            builder.defect("unreadable_messages", topic, len(strange), words)
        self._settle_signals(builder, origin_ns)
        lost = (
            self.unknown.lost
            + len(self.undecodable)
            + len(strange)
            + self._settle_items(builder, origin_ns, wanted)
        )
        # With a lost message, silence of the topic no longer means that nothing happened.
        if self._types and not lost:
            builder.witnessed.update(self.channel.witnesses)
        elif lost:
            builder.doubt(self._events_told, topic)

    @property
    def _events_told(self) -> set[str]:
        """The kinds of events that it tells: what it witnesses, what it is, what was watched for on it."""
        named = () if self.channel.event is None else (self.channel.event.kind,)
        return {*self._watched, *named, *self.channel.witnesses} - {"submissions", "bodies"}

    @property
    def recorded(self) -> bool:
        """Whether the recording has the topic, with messages of the channel's type."""
        return bool(self._types)

    def unrecorded(self, others: Iterable[str]) -> Iterator[str]:
        """What the channel should have delivered and did not, in words.

        Args:
            others: The recorded topics that no channel takes, one of which may have been meant.
        """
        topic = f"topic {self.channel.topic}"
        if not self._types:
            if self.channel.optional:
                return
            if self._other_types:
                found = ", ".join(sorted(self._other_types))
                yield f"{topic} ({self._type or self.channel.poses}): it is recorded as {found or 'no type'}"
            else:
                near = get_close_matches(self.channel.topic, sorted(others), n=1, cutoff=_LIKE)
                meant = f": did you mean {near[0]!r}?" if near else ""
                yield (f"{topic} ({self._type})" if self._type else topic) + meant
        for type_, reason in self.untyped.items():
            yield f"{topic} ({type_}): {reason}"
        if self.undecodable and not self.received:
            types = ", ".join(sorted(self._types))
            yield f"{topic} ({types}): none of its {len(self.undecodable)} messages can be decoded"
        # Silence is what a topic of events may well have; a signal without samples is missing.
        silent = self._types and not (self.received or self.undecodable or self.untyped)
        if silent and (self._columns or self.channel.poses) and not self.channel.optional:
            yield f"{topic} ({', '.join(sorted(self._types))}): it has no messages"
        for lack in self._lacking.values():
            yield f"{topic}: {lack}"

    def due(self) -> dict[str, Due]:
        """The signals that it would record at a rate that is stated, and where."""
        if self.channel.optional or not self.channel.rate_hz:
            return {}
        due = Due(self.channel.topic, self.channel.rate_hz)
        return {one.signal: due for one in self.channel.signals}

    def settle_transformed(self, builder: TrialBuilder, origin_ns: int, tree: TransformTree) -> None:
        """Hand the positions that are in another frame to the builder, in the root frame."""
        for column in self._columns:
            name = column.field_map.signal
            if not len(column.stamps_ns) or quantity_of(name) != "position":
                continue
            stamps_ns = np.array(column.stamps_ns, dtype=np.int64)
            positions = np.array(column.values, dtype=np.float64).reshape(-1, 3)
            placed = Placed(name, self.elsewhere, stamps_ns, positions)
            t, values, holes, contested = tree.transformed(builder, origin_ns, placed)
            if not len(t):
                why = f"it and the transforms of its frame {self.elsewhere!r} never overlap in time"
                builder.unrecorded.append(f"topic {self.channel.topic}: {why}")
            builder.add_signal(
                name,
                column.field_map.unit,
                t,
                values,
                source=self.channel.topic,
                holes=sorted({*self.unknown.holes, *holes}),
                contested=[*self.unknown.contested, *contested],
                stamp_jitter_s=arrival_jitter_s(np.sort(t)) if self.by_arrival and len(t) else 0.0,
                stated_rate_hz=self.channel.rate_hz,
            )

    def _settle_signals(self, builder: TrialBuilder, origin_ns: int) -> None:
        for column in self._columns:
            if self.elsewhere and quantity_of(column.field_map.signal) == "position":
                continue  # transforms are settled first
            if len(column.stamps_ns):
                values: FloatArray = np.frombuffer(column.values, dtype=np.float64)
                if len(column.getters) > 1:
                    values = values.reshape(-1, len(column.getters))
                t = times_s(column.stamps_ns, origin_ns)
                signal, unit = column.field_map.signal, column.field_map.unit
                if self.channel.as_consumed:
                    builder.add_series(signal, unit, t, values, source=self.channel.topic)
                    continue
                builder.add_signal(
                    signal,
                    unit,
                    t,
                    values,
                    source=self.channel.topic,
                    holes=self.unknown.holes,
                    contested=self.unknown.contested,
                    stamp_jitter_s=arrival_jitter_s(np.sort(t)) if self.by_arrival else 0.0,
                    stated_rate_hz=self.channel.rate_hz,
                )

    def _settle_items(self, builder: TrialBuilder, origin_ns: int, wanted: Wanted) -> int:
        """Decode the messages kept for the decoder plugin; returns how many were lost."""
        if not self._items:
            return 0
        plugin = wanted.decoders.get(self.channel.decoder)
        if plugin is None and self.channel.decoder:
            builder.unrecorded.append(
                f"topic {self.channel.topic}: no decoder {self.channel.decoder!r} was given"
            )
            return len(self._items)
        decoder = ChannelDecoder(self.channel, plugin)
        reasons: list[str] = []
        said: list[Any] = []
        times_s: list[float] = []
        for type_, message, stamp_ns in self._items:
            try:
                item = decoder.decode(type_, message, (stamp_ns - origin_ns) / 1e9)
                self._state_facts(builder, message)
            except (ValueError, AttributeError) as error:  # contents, or fields, the plugin cannot use
                reasons.append(str(error))
                continue
            said.append(item)
            times_s.append((stamp_ns - origin_ns) / 1e9)
        late_s = arrival_delays_s(np.sort(np.array(times_s))) if self.by_arrival else ()
        rate = self.channel.rate_hz > 0.0
        for item in changes(self.channel.topic, said, builder, times_s, delays_s=late_s, at_a_rate=rate):
            builder.add(item)
            if isinstance(item, Event) and item.kind == WATCHING:
                self._watched.add(item.subject)
        if len(reasons) == len(self._items):
            builder.unrecorded.append(
                f"topic {self.channel.topic}: none of its messages can be used: {reasons[0]}"
            )
        if reasons:
            builder.defect(
                "unusable_messages",
                self.channel.topic,
                len(reasons),
                f"{self._by} cannot use messages; the first: {reasons[0]}",
            )
        return len(reasons)

    @property
    def _by(self) -> str:
        return f"decoder {self.channel.decoder!r}" if self.channel.decoder else "the log map"

    def _state_facts(self, builder: TrialBuilder, message: object) -> None:
        for name, value in facts_of(self.channel, message):
            if (known := builder.facts.setdefault(name, value)) != value:
                raise LogError(
                    f"topic {self.channel.topic} says that {name} is {value!r}, after {known!r}",
                    file=builder.file,
                    hint="a fact of a trial is one; what changes is a signal or an event",
                )


class Ticks(Intake):
    """Takes the messages of `/clock`."""

    def __init__(self, clocks: Clocks) -> None:
        signal = FieldMap("clock/simulation", "s", ("clock.sec", "clock.nanosec"))
        channel = Channel(CLOCK_TOPIC, CLOCK_TYPE, stamp="log", signals=(signal,))
        super().__init__(channel, Wanted(LogMap("clock"), frozenset({"clock"})))
        self._clocks = clocks

    def take_columns(self, decoded: Decoded, stamps_ns: IntArray) -> None:
        """Take the times of many messages."""
        sec, nanosec = (decoded.columns[path].values.astype(np.int64) for path in self.needs.signals)
        self._clocks.tick(stamps_ns, sec * 10**9 + nanosec)

    def take(self, message: object, type_: str, stamp_ns: int) -> None:
        """Take the time of one message."""
        super().take(message, type_, stamp_ns)
        (column,) = self._columns
        for sec, nanosec in np.frombuffer(column.values).reshape(-1, 2).astype(np.int64).tolist():
            self._clocks.tick(np.array([stamp_ns]), np.array([sec * 10**9 + nanosec]))
        column.stamps_ns, column.values = array("q"), array("d")


def _getter(path: str) -> Callable[[object], object]:
    # rosbags appends an underscore to fields named like Python keywords, such as `from`.
    return attrgetter(".".join(f"{name}_" if iskeyword(name) else name for name in path.split(".")))


def _number(value: object) -> float:
    if not isinstance(value, NUMBER):
        raise TypeError(f"{type(value).__name__} is no number")
    return float(value)


def _lack(message: object, field_map: FieldMap, type_: str) -> str:
    """Which field of a message is missing or not a number, and which there are."""
    for path in field_map.fields:
        try:
            found = value_at(message, path)
        except AttributeError:
            wrong = f"{type_} has no field {path!r} for {field_map.signal}"
        else:
            if isinstance(found, NUMBER):
                continue
            wrong = f"field {path!r} of {type_} is not a number, so it is not {field_map.signal}"
        return f"{wrong}; {nearest(path, number_paths(message), what='fields')}"
    return f"{type_} does not give {field_map.signal}"
