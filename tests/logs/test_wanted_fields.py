"""The wanted fields of a recording as arrays: the same from every container."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_typestore

from ariac_score.errors import LogError
from ariac_score.logs.columnar import Payloads
from ariac_score.logs.columnar.message_buffer import Waiting
from ariac_score.logs.columnar.types import column_decoder_for
from ariac_score.logs.containers.items import Connection
from ariac_score.logs.gather import wanted_fields as tables
from ariac_score.logs.gather.wanted_fields import read_tables
from ariac_score.testing.bags import Recorded, write_bag

STRING, VECTOR = "std_msgs/msg/String", "geometry_msgs/msg/Vector3"
MESSAGES = [
    Recorded("/speed", VECTOR, 10**18 + i, {"x": i / 8, "y": -float(i)})
    if i % 3
    else Recorded("/word", STRING, 10**18 + i, {"data": "ab"[i % 2]})
    for i in range(90)
]
FORMATS = [("mcap", "t.mcap", "zstd"), ("mcap", "t", ""), ("ros1", "t.bag", "bz2"), ("sqlite3", "t.db3", "")]


@pytest.mark.parametrize(("storage", "name", "compression"), FORMATS)
def test_wanted_fields_of_wanted_topics(tmp_path: Path, storage: Any, name: str, compression: str) -> None:
    path = write_bag(tmp_path / name, MESSAGES, storage=storage, compression=compression)

    speed, word = sorted(read_tables(path, {"/speed": ["x"], "/word": None}), key=lambda t: t.topic)

    assert (speed.topic, speed.type, speed.defects, speed.unreadable) == ("/speed", VECTOR, 0, "")
    assert list(speed.columns) == ["x"]
    assert speed.columns["x"].values.tolist() == [i / 8 for i in range(90) if i % 3]
    assert speed.stamps_ns.tolist() == [10**18 + i for i in range(90) if i % 3]
    assert word.columns["data"].text() == ["ab"[i % 2] for i in range(90) if not i % 3]


def test_slabs_are_joined(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_bag(tmp_path / "t.mcap", MESSAGES, storage="mcap")
    whole = read_tables(path, {"/speed": None})[0]
    monkeypatch.setattr("ariac_score.logs.columnar.message_buffer.SLAB_BYTES", 100)

    parts = read_tables(path, {"/speed": None})[0]

    assert parts.stamps_ns.tolist() == whole.stamps_ns.tolist()
    assert parts.columns["y"].values.tolist() == whole.columns["y"].values.tolist()


def test_a_topic_that_is_not_there_has_no_table(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.bag", MESSAGES, storage="ros1")

    assert read_tables(path, {"/other": None}) == []


def test_a_cut_off_recording_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.mcap", MESSAGES, storage="mcap")
    path.write_bytes(path.read_bytes()[:-20])

    with pytest.raises(LogError):
        read_tables(path, {"/speed": None})


NAMES = st.sampled_from([(), ("a",), ("b",), ("a", "b"), ("elbow", "wrist", "a")])


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(NAMES, st.integers(0, 5)), max_size=80), st.data())
def test_however_the_slabs_are_cut_the_columns_are_those_of_one(
    sent: list[tuple[tuple[str, ...], int]], data: st.DataObject
) -> None:
    """Whether numbers are decoded where they stay or moved there, with good and bad guesses of how many."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    state, header = (store.types[name] for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header"))
    stamp = store.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)
    values = np.random.default_rng(len(sent)).normal(size=(len(sent), 3))
    packed, expected, lengths = [], list[float](), list[tuple[int, int]]()
    for (names, short), row in zip(sent, values, strict=True):
        position = row[: len(names)]
        message = state(header(stamp, ""), list(names), position, position[short:] * 2, position[:0])
        raw = bytes(store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
        sound = not (names and short == 5)
        packed.append(raw if sound else raw[:-9])
        expected += position.tolist() if sound else []
        lengths += [(len(names), len(position))] if sound else []
    cuts = sorted(data.draw(st.lists(st.integers(0, len(sent)), max_size=6)))
    connection = Connection("/joints", "sensor_msgs/msg/JointState", "cdr")
    growing = tables._Growing(column_decoder_for(connection, None))
    for first, last in pairwise([0, *cuts, len(sent)]):
        numbers = np.arange(first, last)
        share = data.draw(st.sampled_from([0.0, 1e-9, 0.3, 1.0]))
        growing.take(Waiting(numbers, numbers, Payloads.joined(packed[first:last])), share)

    table = growing.table(connection)

    assert table.defects == sum(1 for names, short in sent if names and short == 5)
    assert table.columns["position"].values.tolist() == expected
    for path, place in (("name", 0), ("position", 1)):
        column = table.columns[path]
        found = np.diff(column.offsets[0]).tolist() if sent else []
        assert found == [both[place] for both in lengths]
        assert not sent or (column.offsets[0][0], column.offsets[0][-1]) == (0, len(column.values))
    assert [table.columns["name"].texts[code] for code in table.columns["name"].values] == [  # type: ignore[index]
        name for names, short in sent if short != 5 for name in names
    ]


def test_a_guess_from_very_little_does_not_take_all_memory() -> None:
    """Of a file that is nearly all zeros, or whose start holds what its rest does not."""
    grown = tables._Grown(np.dtype(np.float64))
    room = grown.room(np.dtype(np.float64), 1000, 1e-12)

    assert room.base is not None
    assert room.base.nbytes <= 8 * 1000 * 71
