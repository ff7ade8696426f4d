"""The wanted fields of a recording as arrays: the same from every container."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ariac_score.errors import LogError
from ariac_score.logs.tables import read_tables
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
    monkeypatch.setattr("ariac_score.logs.pending.SLAB_BYTES", 100)

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
