"""Columns of chosen fields: what they hold is what `read_messages` gives one by one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ariac_score import LogError, NothingToScoreError, read_columns, read_messages

LOG = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"


def test_columns_hold_what_the_messages_say_in_recorded_order() -> None:
    found = read_columns(LOG, {"/snapshot": ["robot_speed"]})
    one_by_one = [message for message in read_messages(LOG) if message.topic == "/snapshot"]

    speeds = np.concatenate([part.columns["robot_speed"].values for part in found.of("/snapshot")])
    log_ns = np.concatenate([part.log_ns for part in found.of("/snapshot")])
    assert speeds.tolist() == [message.fields["robot_speed"] for message in one_by_one]
    assert log_ns.tolist() == [message.stamp_ns for message in one_by_one]


def test_numbers_are_places_among_all_messages() -> None:
    found = read_columns(LOG, {"/ariac/orders": ["order_id"]})
    places = [n for n, message in enumerate(read_messages(LOG), 1) if message.topic == "/ariac/orders"]

    assert np.concatenate([part.numbers for part in found.of("/ariac/orders")]).tolist() == places


def test_a_topic_without_fields_gives_its_times_alone() -> None:
    found = read_columns(LOG, {"ariac/orders": []})

    (part,) = found.of("/ariac/orders")
    assert part.columns == {}
    assert len(part.log_ns) == found.counts["/ariac/orders"] == 2


def test_all_topics_are_counted_whatever_is_wanted() -> None:
    counts: dict[str, int] = {}
    for message in read_messages(LOG):
        counts[message.topic] = counts.get(message.topic, 0) + 1

    assert dict(read_columns(LOG, {}).counts) == counts


def test_a_recording_that_breaks_off_is_refused_with_how_far_it_can_be_read(tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(LOG.read_bytes()[:100_000])

    with pytest.raises(LogError, match="readable up to"):
        read_columns(cut, {"/snapshot": ["robot_speed"]})


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no recording", encoding="utf-8")

    with pytest.raises(NothingToScoreError, match="not a ROS recording"):
        read_columns(tmp_path / "notes.txt", {})
