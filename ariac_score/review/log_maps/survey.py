"""What a recording holds that a log map could name: topics with their fields, frames, models."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ariac_score.logs.columnar import Column
from ariac_score.logs.columnar.types import UnknownTypeError, decoder_for
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.items import Batch, Connection, Message
from ariac_score.logs.gather.message_fields import number_paths
from ariac_score.logs.gather.wanted_fields import Table, read_tables

__all__ = ["Edge", "Survey", "TopicFields", "survey_recording"]

FRAMES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
MODELS = ("gazebo_msgs/msg/ModelStates", "gazebo_msgs/msg/LinkStates")
CLOCK = "rosgraph_msgs/msg/Clock"
STILL_M = 0.05
"""What stays within it does not move: parts settle, and sensors of position are no better."""
_TURNED = 0.005
"""Of a component of a quaternion: about half a degree."""

_PARENT, _CHILD = "transforms.header.frame_id", "transforms.child_frame_id"
_PLACE = tuple(f"transforms.transform.translation.{axis}" for axis in "xyz")
_TURN = tuple(f"transforms.transform.rotation.{axis}" for axis in "xyzw")


@dataclass(frozen=True)
class TopicFields:
    """One topic, as its first message shows it.

    Attributes:
        name: With leading slash.
        type: `package/msg/Name`.
        count: Messages.
        numbers: Paths of the fields that are one number each.
        stamped: Whether its messages have times of their own.
        frame: The frame that its header names; empty where there is none.
        unreadable: Why its messages cannot be decoded; empty when they can.
    """

    name: str
    type: str
    count: int = 0
    numbers: tuple[str, ...] = ()
    stamped: bool = False
    frame: str = ""
    unreadable: str = ""


@dataclass(frozen=True)
class Edge:
    """A frame below another, as transforms state it.

    Attributes:
        parent: The upper one.
        child: The lower one.
        moves: Whether the lower one moves or turns against the upper one.
    """

    parent: str
    child: str
    moves: bool


@dataclass(frozen=True)
class Survey:
    """What a recording holds.

    Attributes:
        topics: In order of their names.
        edges: Of its frames, in order of the lower one.
        models: Names of models, sorted.
    """

    topics: tuple[TopicFields, ...] = ()
    edges: tuple[Edge, ...] = ()
    models: tuple[str, ...] = ()

    def of_type(self, types: Sequence[str]) -> list[TopicFields]:
        """The topics of some types that have messages."""
        return [topic for topic in self.topics if topic.type in types and topic.count]

    @property
    def parents(self) -> dict[str, str]:
        """The frame above each, of frames that have one only."""
        above: dict[str, list[str]] = {}
        for edge in self.edges:
            above.setdefault(edge.child, []).append(edge.parent)
        return {child: parents[0] for child, parents in above.items() if len(parents) == 1}

    @property
    def roots(self) -> list[str]:
        """The frames above which there is none, those with most that moves below them first."""
        children = {edge.child for edge in self.edges}
        tops = dict.fromkeys(edge.parent for edge in self.edges if edge.parent not in children)
        moving = dict.fromkeys(tops, 0)
        for edge in self.edges:
            top = self.chain(edge.child)[-1]
            moving[top] = moving.get(top, 0) + edge.moves
        known = ("world", "map", "odom")
        order = {name: place for place, name in enumerate(known)}
        return sorted(tops, key=lambda top: (-moving[top], order.get(top, len(known)), top))

    def chain(self, frame: str) -> list[str]:
        """A frame and those above it, up to its root; it ends before it repeats itself."""
        parents, chain = self.parents, [frame]
        while chain[-1] in parents and parents[chain[-1]] not in chain:
            chain.append(parents[chain[-1]])
        return chain


def survey_recording(path: Path) -> Survey:
    """What a ROS recording holds.

    Raises:
        LogError: It is damaged.
    """
    topics = _topics(path)
    survey = Survey(tuple(topics))
    frames = [topic.name for topic in survey.of_type(FRAMES)]
    models = [topic.name for topic in survey.of_type(MODELS)]
    tables = read_tables(path, dict.fromkeys(frames, (_PARENT, _CHILD, *_PLACE, *_TURN))) if frames else []
    named = read_tables(path, dict.fromkeys(models, ("name",))) if models else []
    names = {name.partition("::")[0] for table in named for name in _texts(table, "name")}
    return Survey(tuple(topics), tuple(_edges(tables)), tuple(sorted(names)))


def _texts(table: Table, path: str) -> Iterable[str]:
    column = table.columns.get(path)
    return () if column is None or column.texts is None else column.texts


def _topics(path: Path) -> list[TopicFields]:
    counts: dict[Connection, int] = {}
    firsts: dict[Connection, bytes] = {}
    for item in open_scan(path):
        if isinstance(item, Connection):
            counts.setdefault(item, 0)
        elif isinstance(item, Message):
            counts[item.connection] = counts.get(item.connection, 0) + 1
            firsts.setdefault(item.connection, bytes(item.payload))
        else:
            _count(item, counts, firsts)
    found: dict[str, TopicFields] = {}
    for connection, count in counts.items():
        known = found.get(connection.topic)
        if known is not None and known.numbers:
            found[connection.topic] = _with_more(known, count)
            continue
        before = known.count if known else 0
        found[connection.topic] = _with_more(_fields(connection, firsts.get(connection)), before + count)
    return [found[name] for name in sorted(found)]


def _count(batch: Batch, counts: dict[Connection, int], firsts: dict[Connection, bytes]) -> None:
    for place, connection in enumerate(batch.connections):
        own = np.flatnonzero(batch.sources == place)
        counts[connection] = counts.get(connection, 0) + len(own)
        if len(own) and connection not in firsts:
            firsts[connection] = batch.payloads.one(int(own[0]))


def _with_more(topic: TopicFields, count: int) -> TopicFields:
    return TopicFields(
        topic.name,
        topic.type,
        topic.count + count,
        topic.numbers,
        topic.stamped,
        topic.frame,
        topic.unreadable,
    )


def _fields(connection: Connection, first: bytes | None) -> TopicFields:
    if first is None:
        return TopicFields(connection.topic, connection.type)
    try:
        message = decoder_for(connection)(first)
    except UnknownTypeError as error:
        return TopicFields(connection.topic, connection.type, unreadable=str(error))
    header = getattr(message, "header", None)
    return TopicFields(
        connection.topic,
        connection.type,
        numbers=tuple(path for path in number_paths(message) if not path.startswith("header.")),
        stamped=hasattr(header, "stamp"),
        frame=str(getattr(header, "frame_id", "")).lstrip("/"),
    )


def _edges(tables: Iterable[Table]) -> Iterator[Edge]:
    """The edges of all transforms, sorted; whether they move is said of all publishers together."""
    lowest: dict[tuple[str, str], np.ndarray[tuple[int], np.dtype[np.float64]]] = {}
    highest = dict(lowest)
    for table in tables:
        if _CHILD not in table.columns:
            continue
        parents, children = table.columns[_PARENT], table.columns[_CHILD]
        rows = np.stack([_numbers(table.columns[path]) for path in (*_PLACE, *_TURN)])
        for pair, own in _pairs(parents, children):
            least, most = rows[:, own].min(axis=1), rows[:, own].max(axis=1)
            lowest[pair] = np.minimum(lowest.get(pair, least), least)
            highest[pair] = np.maximum(highest.get(pair, most), most)
    for parent, child in sorted(lowest, key=lambda pair: (pair[1], pair[0])):
        extent = highest[parent, child] - lowest[parent, child]
        moves = bool(np.hypot.reduce(extent[:3]) > STILL_M or extent[3:].max() > _TURNED)
        yield Edge(parent, child, moves)


def _numbers(column: Column) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.nan_to_num(column.values.astype(np.float64))


def _pairs(
    parents: Column, children: Column
) -> Iterator[tuple[tuple[str, str], np.ndarray[tuple[int], np.dtype[np.int64]]]]:
    """The frames of transforms, upper and lower one, each with the rows that are about them."""
    above, below = parents.texts or (), children.texts or ()
    codes = parents.values.astype(np.int64) * max(len(below), 1) + children.values
    for code in np.unique(codes).tolist():
        parent, child = above[code // len(below)], below[code % len(below)]
        yield (parent.lstrip("/"), child.lstrip("/")), np.flatnonzero(codes == code)
