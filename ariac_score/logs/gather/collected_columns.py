"""From columns of many messages to stamps, signals and poses as the log map defines them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ariac_score.logs.columnar import Column, ColumnDecoder
from ariac_score.logs.columnar.message_buffer import Waiting
from ariac_score.logs.columnar.types import column_decoder_for
from ariac_score.logs.containers.items import Connection, IntArray
from ariac_score.logs.gather.clocks import Clocks
from ariac_score.logs.gather.model_frames import ModelFrames
from ariac_score.logs.gather.model_states import ModelPoses
from ariac_score.logs.gather.transforms import TransformTree
from ariac_score.trial.channels import Channel
from ariac_score.trial.spans import FloatArray

__all__ = [
    "SEQUENCE",
    "Decoded",
    "Needs",
    "PoseBatch",
    "by_header",
    "clock_key",
    "columns_for",
]

_STAMP = ("header.stamp.sec", "header.stamp.nanosec")
FRAME_ID = "header.frame_id"
SEQUENCE = "header.seq"
"""What a ROS 1 publisher numbers its stamped messages by."""
_AT = tuple(f"transforms.transform.translation.{axis}" for axis in "xyz")
_TURN = tuple(f"transforms.transform.rotation.{axis}" for axis in "xyzw")
_PARENT, _CHILD = "transforms.header.frame_id", "transforms.child_frame_id"
_POSITION = tuple(f"pose.position.{axis}" for axis in "xyz")
_ORIENTATION = tuple(f"pose.orientation.{axis}" for axis in "wxyz")
_VELOCITY = tuple(f"twist.linear.{axis}" for axis in "xyz")


_Wanted = tuple[str, tuple[str, ...]]
"""The kind a field must be of (number, text, stamp), and the sequences it must lie in."""


@dataclass(frozen=True)
class Needs:
    """The fields a channel needs of a message: those of its signals, and those its poses need."""

    channel: Channel
    signals: tuple[str, ...]
    places: bool = False

    def fields(self) -> dict[str, _Wanted]:
        """The paths it needs, each with the kind of field and the sequences it must lie in."""
        poses, found = self.channel.poses, dict[str, _Wanted]()
        if poses == "frames":
            inside = ("transforms",)
            found |= dict.fromkeys((*_AT, *_TURN), ("number", inside))
            found |= dict.fromkeys((_PARENT, _CHILD), ("text", inside))
            return found
        if poses == "models":
            found |= {"name": ("text", ("name",))}
            found |= dict.fromkeys(_VELOCITY, ("number", ("twist",)))
            found |= dict.fromkeys((*_POSITION, *_ORIENTATION), ("number", ("pose",)))
        else:
            found |= dict.fromkeys(self.signals, ("number", ()))
        return found

    def stamps(self) -> dict[str, _Wanted]:
        """The paths of its stamp, likewise; none where the time of recording counts."""
        if not by_header(self.channel):
            return {}
        prefix, inside = ("transforms.", ("transforms",)) if self.channel.poses == "frames" else ("", ())
        return {f"{prefix}{path}": ("stamp", inside) for path in _STAMP}


def columns_for(connection: Connection, needs: Sequence[Needs]) -> ColumnDecoder | None:
    """A decoder of the fields some channels need of a connection; `None` when they need whole messages.

    Decoder plugins take whole messages; and where a field is not what the log map expects,
    a whole message is needed to report what it is instead.

    Raises:
        PlanError: Its messages can be decoded one by one only.
        UnknownTypeError: They cannot be decoded at all.
    """
    if any(need.channel.whole for need in needs):
        return None
    fields = {path: what for need in needs for path, what in need.fields().items()}
    stamps = {path: what for need in needs for path, what in need.stamps().items()}
    must = any(need.channel.stamp == "header" and need.stamps() for need in needs)
    # A type without a header is no error: unless the log map insists, times of recording count for it.
    sequences = dict[str, _Wanted]()
    if connection.encoding == "ros1" and any(by_header(n.channel) and not n.channel.poses for n in needs):
        sequences = {SEQUENCE: ("stamp", ())}
    named = {FRAME_ID: ("text", ())} if any(need.places for need in needs) else {}
    decoder = column_decoder_for(connection, fields | stamps | sequences | named)
    if not _has(decoder, sequences) or not _has(decoder, named):
        kept = {path: what for path, what in (sequences | named).items() if _has(decoder, {path: what})}
        decoder = column_decoder_for(connection, fields | stamps | kept)
    if not _has(decoder, stamps):
        if must:
            return None
        decoder = column_decoder_for(connection, fields)
    return decoder if _has(decoder, fields) else None


def by_header(channel: Channel) -> bool:
    """Whether messages of a channel are placed in time by their own stamps, where they have any."""
    if channel.poses == "frames" and channel.topic.endswith("tf_static"):
        return False  # a static transform holds at all times
    # Gazebo's model states have no header.
    return channel.stamp == "header" or (not channel.stamp and channel.poses != "models")


def clock_key(channel: Channel) -> str:
    """Names what must be on one clock: a topic, or all frames together, which positions are composed of."""
    if channel.poses == "frames":
        return "/tf_static" if channel.topic.endswith("tf_static") else "/tf"
    return channel.topic if by_header(channel) else f"{channel.topic} by times of recording"


def _has(decoder: ColumnDecoder, fields: Mapping[str, _Wanted]) -> bool:
    """Whether fields exist and are of the kinds they must be."""
    shapes = ((decoder.shape(path), wanted) for path, wanted in fields.items())
    return all(s is not None and s[1] == levels and _is(what, s[0]) for s, (what, levels) in shapes)


def _is(what: str, kind: str) -> bool:
    if what == "stamp":
        return kind in ("int32", "uint32")
    return (kind == "string") == (what == "text")


@dataclass(frozen=True, eq=False)
class Decoded:
    """Messages of a connection, decoded; those that do not fit their definition are left out.

    Attributes:
        sequence_numbers: Their places in the recording, shape (n,).
        log_ns: Their log times, shape (n,).
        columns: Their fields.
        refused: Why the others do not fit, by sequence number.
    """

    sequence_numbers: IntArray
    log_ns: IntArray
    columns: Mapping[str, Column]
    refused: dict[int, str]

    @classmethod
    def of(cls, decoder: ColumnDecoder, messages: Waiting) -> Decoded:
        """Decode some messages."""
        found = decoder.decode(messages.payloads)
        refused = {int(messages.numbers[defect.index]): defect.cause for defect in found.defects}
        return cls(messages.numbers[found.rows], messages.stamps_ns[found.rows], found.columns, refused)

    def values_of(self, paths: Sequence[str]) -> FloatArray:
        """The values of some fields, shape (n, k), or (n,) of one field."""
        if len(paths) == 1:
            return self.columns[paths[0]].values.astype(np.float64)
        return _side_by_side(self.columns, paths)

    @property
    def sequences(self) -> IntArray | None:
        """What their publisher numbered them, shape (n,); `None` where it did not."""
        column = self.columns.get(SEQUENCE)
        return None if column is None else column.values.astype(np.int64)

    @property
    def frame_ids(self) -> set[str]:
        """The frames that the headers of messages name, where these are wanted."""
        column = self.columns.get(FRAME_ID)
        if column is None or column.texts is None or not len(column.values):
            return set()
        return {column.texts[code] for code in np.flatnonzero(np.bincount(column.values)).tolist()}

    def first_of_each(self, stamps_ns: IntArray) -> tuple[IntArray, IntArray]:
        """Of the stamps of transforms the first of each message: the messages' numbers, these stamps."""
        counts = self.columns[_CHILD].per_message()
        some = counts > 0
        return self.sequence_numbers[some], stamps_ns[(np.cumsum(counts) - counts)[some]]

    @property
    def frames(self) -> tuple[Column, Column]:
        """The names of parents and children of transforms."""
        return self.columns[_PARENT], self.columns[_CHILD]

    @property
    def transforms(self) -> FloatArray:
        """x, y, z in m and the quaternion x, y, z, w of transforms, shape (n, 7)."""
        return _side_by_side(self.columns, (*_AT, *_TURN))

    def stamps_ns(self, channel: Channel, clocks: Clocks) -> IntArray:
        """The stamps that count for a channel: one for each message, or for each transform."""
        frames = channel.poses == "frames"
        log_ns, numbers = self.log_ns, self.sequence_numbers
        if frames:
            counts = self.columns[_CHILD].per_message()
            log_ns, numbers = np.repeat(log_ns, counts), np.repeat(numbers, counts)
        paths = [f"transforms.{path}" if frames else path for path in _STAMP]
        if not by_header(channel) or not all(path in self.columns for path in paths):
            clocks.without_header(clock_key(channel), len(log_ns), declared=channel.stamp == "log")
            return log_ns
        # 64 bits first: nanoseconds overflow the 32 bits of `sec` after two seconds.
        sec, nanosec = (self.columns[path].values.astype(np.int64) for path in paths)
        return clocks.stamps_ns(clock_key(channel), numbers, sec * 10**9 + nanosec, log_ns)


def _side_by_side(columns: Mapping[str, Column], paths: Sequence[str]) -> FloatArray:
    rows: FloatArray = np.empty((len(columns[paths[0]].values), len(paths)))
    for i, path in enumerate(paths):
        rows[:, i] = columns[path].values
    return rows


class _Names:
    """One numbering of names for the text columns of several connections, whose codes differ."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self._numbers: dict[str, int] = {}

    def numbered(self, column: Column) -> IntArray:
        assert column.texts is not None
        # Only the codes in use: a decoder remembers the texts of all messages before.
        used = np.flatnonzero(np.bincount(column.values, minlength=1))
        table = np.zeros(len(column.texts), dtype=np.int64)
        for code in used.tolist():
            name = column.texts[code]
            if name not in self._numbers:
                self._numbers[name] = len(self.names)
                self.names.append(name)
            table[code] = self._numbers[name]
        numbers: IntArray = table[column.values]
        return numbers


_Part = tuple[NDArray[Any], ...]


@dataclass
class PoseBatch:
    """Poses from several connections, which are handed over in recorded order."""

    _names: _Names = field(default_factory=_Names)
    _frames: list[_Part] = field(default_factory=list)
    _models: list[_Part] = field(default_factory=list)

    def add_frames(self, decoded: Decoded, stamps_ns: IntArray, *, static: bool) -> None:
        """Take the transforms of tf messages."""
        columns = decoded.columns
        fields = [columns[path].values for path in (*_AT, *_TURN)]
        numbers = np.repeat(decoded.sequence_numbers, columns[_CHILD].per_message())
        parents, children = (self._names.numbered(columns[path]) for path in (_PARENT, _CHILD))
        moving = np.full(len(parents), not static)
        self._frames.append((numbers, parents, children, stamps_ns, moving, *fields))

    def add_models(self, decoded: Decoded, stamps_ns: IntArray, *, links: bool) -> dict[int, str]:
        """Take the poses of model or link states; returns why some messages are refused, by number."""
        columns = decoded.columns
        names, poses, twists = (columns[path] for path in ("name", _POSITION[0], _VELOCITY[0]))
        counts = names.per_message()
        # Three lists of one length, by convention only: a message may break it.
        fits = (poses.per_message() == counts) & (twists.per_message() == counts)
        of_name, of_pose, of_twist = (np.repeat(fits, c.per_message()) for c in (names, poses, twists))
        pose = _side_by_side(columns, (*_POSITION, *_ORIENTATION))[of_pose]
        velocity = _side_by_side(columns, _VELOCITY)[of_twist]
        found = self._names.numbered(names)[of_name]
        numbers, counts = decoded.sequence_numbers, counts[fits]
        of_links = np.full(len(counts), links)
        self._models.append((numbers[fits], counts, stamps_ns[fits], of_links, found, pose, velocity))
        return dict.fromkeys(numbers[~fits].tolist(), "name, pose and twist differ in length")

    def hand_over(
        self, tree: TransformTree, models: ModelPoses, frames: Mapping[bool, ModelFrames], *, share: float
    ) -> None:
        """Hand everything over in recorded order.

        Args:
            tree: Takes transforms.
            models: Takes the states of models and links.
            frames: Takes them as well, of links and of models.
            share: The share of the recording that was read, as far as is known, 0 to 1.
        """
        if self._frames:
            parts = list(self._frames[0])
            if len(self._frames) > 1:
                parts = [np.concatenate(part) for part in zip(*self._frames, strict=True)]
                order = np.argsort(parts[0], kind="stable")  # transforms of one message keep their order
                parts = [part[order] for part in parts]
            _, parents, children, stamps_ns, moving, *fields = parts
            tree.add_many(self._names.names, parents, children, fields, stamps_ns, moving, share=share)
        if self._models:
            self._hand_over_models(models, frames)

    def _hand_over_models(self, models: ModelPoses, frames: Mapping[bool, ModelFrames]) -> None:
        parts = [np.concatenate(part) for part in zip(*self._models, strict=True)]
        if len(self._models) > 1:
            numbers, counts = parts[:2]
            order = np.argsort(numbers, kind="stable")
            states = np.argsort(np.repeat(numbers, counts), kind="stable")
            parts = [part[order] for part in parts[:4]] + [part[states] for part in parts[4:]]
        _, counts, stamps_ns, links, found, pose, velocity = parts
        names, rows = self._names.names, np.concatenate((pose[:, :3], velocity), axis=1)
        of_links = np.repeat(links, counts)
        models.add_many(names, found, rows, np.repeat(stamps_ns, counts), of_links)
        for kind, kept in frames.items():
            own, states = links == kind, of_links == kind
            kept.add_many(names, found[states], pose[states], counts[own], stamps_ns[own])
