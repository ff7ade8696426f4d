"""Every message of a recording, as values of JSON."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.errors import LogError
from ariac_score.logs.messages import read_messages
from ariac_score.testing.bags import Recorded, Storage, write_bag

S = 10**9


@pytest.mark.parametrize(("suffix", "storage"), [(".mcap", "mcap"), (".bag", "ros1")])
def test_publishers_of_one_topic_may_use_different_types(
    tmp_path: Path, suffix: str, storage: Storage
) -> None:
    messages = [
        Recorded("/x", "std_msgs/msg/Float64", 1 * S, {"data": 0.5}),
        Recorded("/x", "std_msgs/msg/String", 2 * S, {"data": "half"}),
        Recorded("/x", "std_msgs/msg/Float64", 3 * S, {"data": 1.0}),
    ]
    path = write_bag(tmp_path / f"log{suffix}", messages, storage=storage)

    found = [(m.topic, m.stamp_ns, m.fields) for m in read_messages(path)]

    assert found == [
        ("/x", 1 * S, {"data": 0.5}),
        ("/x", 2 * S, {"data": "half"}),
        ("/x", 3 * S, {"data": 1.0}),
    ]


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot be read"):
        list(read_messages(tmp_path / "none.mcap"))
