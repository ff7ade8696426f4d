"""Calls of services, as ROS 2 records them: with contents or without, read from the service's definition."""

from __future__ import annotations

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.writer import Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ariac_score import open_trial, read_messages
from ariac_score.logs.columnar.service_events import event_definition

SERVICE = "string order_id\n---\nbool success\nstring message\n"
SEPARATOR = "=" * 80 + "\n"
TOPIC, TYPE = "/ariac/submit_order/_service_event", "ariac_msgs/srv/SubmitOrder_Event"
MADE = {
    "ariac_msgs/msg/Asked": "string order_id",
    "ariac_msgs/msg/Answered": "bool success\nstring message",
    "ariac_msgs/msg/Made": (
        "service_msgs/ServiceEventInfo info\nariac_msgs/Asked[<=1] request\nariac_msgs/Answered[<=1] response"
    ),
    "ariac_msgs/msg/CompetitionState": "uint8 competition_state",
}


class Recording:
    """A recording, message by message."""

    def __init__(self) -> None:
        self.store = get_typestore(Stores.ROS2_JAZZY)
        for name, text in MADE.items():
            self.store.register(get_types_from_msg(text, name))
        self.channels: dict[str, int] = {}

    def declare(self, topic: str, name: str, text: str, encoding: str) -> int:
        raise NotImplementedError

    def write(self, channel: int, t_ns: int, payload: bytes) -> None:
        raise NotImplementedError

    def add(
        self, t_s: float, topic: str, name: str, text: str, made: str, encoding: str, *values: Any
    ) -> None:
        if topic not in self.channels:
            self.channels[topic] = self.declare(topic, name, text, encoding)
        payload = bytes(self.store.serialize_cdr(self.store.types[made](*values), made))
        self.write(self.channels[topic], round(t_s * 1e9), payload)

    def state(self, t_s: float, value: int) -> None:
        kind = "ariac_msgs/msg/CompetitionState"
        self.add(t_s, "/ariac/competition_state", kind, MADE[kind], kind, "ros2msg", value)

    def call(
        self,
        t_s: float,
        order: str,
        *,
        kind: int,
        number: int,
        success: bool = True,
        told: bool = True,
        text: str = SERVICE,
        encoding: str = "ros2msg",
    ) -> None:
        types = self.store.types
        stamp = types["builtin_interfaces/msg/Time"](int(t_s), 0)
        info = types["service_msgs/msg/ServiceEventInfo"](kind, stamp, np.arange(16, dtype=np.uint8), number)
        asked = [types["ariac_msgs/msg/Asked"](order)] if told and kind < 2 else []
        answered = [types["ariac_msgs/msg/Answered"](success, "")] if told and kind > 1 else []
        self.add(t_s, TOPIC, TYPE, text, "ariac_msgs/msg/Made", encoding, info, asked, answered)


class Mcap(Recording):
    """An MCAP file, by another writer than ours."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.file = path.open("wb")
        self.writer = Writer(self.file)
        self.writer.start(profile="ros2", library="test")

    def declare(self, topic: str, name: str, text: str, encoding: str) -> int:
        schema = self.writer.register_schema(name, encoding, text.encode())
        return int(self.writer.register_channel(topic, "cdr", schema))

    def write(self, channel: int, t_ns: int, payload: bytes) -> None:
        self.writer.add_message(channel, t_ns, payload, t_ns)

    def close(self) -> None:
        self.writer.finish()
        self.file.close()


class Sqlite(Recording):
    """A SQLite file with the tables of rosbag2 since Iron, where a service's definition has its own name.

    Source: rosbag2_storage_sqlite3, `sqlite_storage.cpp`; rosbag2_cpp, `sequential_writer.cpp`.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.base = sqlite3.connect(path)
        self.base.executescript(
            "CREATE TABLE schema(schema_version INTEGER PRIMARY KEY, ros_distro TEXT NOT NULL);"
            "INSERT INTO schema VALUES (4, 'jazzy');"
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL,"
            " serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL,"
            " type_description_hash TEXT NOT NULL);"
            "CREATE TABLE message_definitions(id INTEGER PRIMARY KEY, topic_type TEXT NOT NULL,"
            " encoding TEXT NOT NULL, encoded_message_definition TEXT NOT NULL,"
            " type_description_hash TEXT NOT NULL);"
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL,"
            " timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
            "CREATE INDEX timestamp_idx ON messages (timestamp ASC);"
        )

    def declare(self, topic: str, name: str, text: str, encoding: str) -> int:
        number = len(self.channels) + 1
        self.base.execute("INSERT INTO topics VALUES (?, ?, ?, 'cdr', '', '')", (number, topic, name))
        of = (number, name.removesuffix("_Event"), encoding, text)
        self.base.execute("INSERT INTO message_definitions VALUES (?, ?, ?, ?, '')", of)
        return number

    def write(self, channel: int, t_ns: int, payload: bytes) -> None:
        row = (channel, t_ns, payload)
        self.base.execute("INSERT INTO messages (topic_id, timestamp, data) VALUES (?, ?, ?)", row)

    def close(self) -> None:
        self.base.commit()
        self.base.close()


WRITERS: dict[str, Any] = {"trial.mcap": Mcap, "trial.db3": Sqlite}


WRITTEN = {
    "as the sample of rosbag2": (SERVICE, "ros2msg"),
    "as Jazzy": (f"{SEPARATOR}SRV: ariac_msgs/srv/SubmitOrder\n{SERVICE}", "unknown"),
    "with another message after it": (f"{SERVICE}{SEPARATOR}MSG: std_msgs/Empty\n", "ros2msg"),
}


@pytest.mark.parametrize("how", WRITTEN)
def test_both_ways_of_writing_the_definition_are_read(how: str, tmp_path: Path) -> None:
    recording = Mcap(tmp_path / "calls.mcap")
    text, encoding = WRITTEN[how]
    recording.call(1.0, "A7", kind=0, number=4, text=text, encoding=encoding)
    recording.call(1.5, "A7", kind=3, number=4, text=text, encoding=encoding)
    recording.close()
    asked, answered = (each.fields for each in read_messages(tmp_path / "calls.mcap"))
    assert asked["request"] == [{"order_id": "A7"}]
    assert (asked["info"]["event_type"], asked["info"]["sequence_number"], asked["response"]) == (0, 4, [])
    assert answered["response"] == [{"success": True, "message": ""}]


def test_a_service_without_fields_sends_a_byte_for_each_side() -> None:
    text = event_definition("std_srvs/srv/Trigger_Event", "# nothing\n---\nbool success\nstring message\n")
    request = text.split("MSG: std_srvs/Trigger_Request\n")[1].splitlines()[0]
    assert request == "uint8 structure_needs_at_least_one_member"


def test_definitions_of_messages_stay_as_they_are() -> None:
    for name, text in (("a/msg/B", "int32 x\n---\n"), ("a/srv/B", SERVICE), ("a/srv/B_Event", "int32 x\n")):
        assert event_definition(name, text) == text


def trial_of(path: Path, *, told: bool = True) -> Any:
    """Three orders are handed in: accepted, refused, and one whose answer is not there."""
    recording = WRITERS[path.name](path)
    recording.state(1.0, 2)
    for number, (order, success) in enumerate((("A7", True), ("B8", False))):
        recording.call(10.0 + number, order, kind=0, number=number, told=told)
        recording.call(10.5 + number, order, kind=3, number=number, success=success, told=told)
    recording.call(13.0, "C9", kind=0, number=7, told=told)
    recording.state(20.0, 4)
    recording.close()
    return open_trial(path, log_map="ariac2024")


@pytest.mark.parametrize("name", WRITERS)
def test_an_accepted_call_is_a_submission_at_the_time_of_its_request(name: str, tmp_path: Path) -> None:
    trial = trial_of(tmp_path / name)
    # Trial time begins with the first message, at 1 s.
    assert [(s.item_id, s.submitted_s) for s in trial.submissions] == [("A7", 9.0)]
    # A team's clients show what they did; that they did no more is not shown.
    assert "submissions" not in trial.witnessed


@pytest.mark.parametrize("name", WRITERS)
def test_calls_without_content_are_said_and_are_no_submissions(name: str, tmp_path: Path) -> None:
    trial = trial_of(tmp_path / name, told=False)
    assert trial.submissions == ()
    (defect,) = [d for d in trial.log_defects if d.kind == "calls_without_content"]
    assert defect.count == 3
    assert "introspection is set to metadata" in defect.message
