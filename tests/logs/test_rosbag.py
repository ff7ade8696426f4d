"""The reader of ROS recordings: what it brings, and what it refuses."""

from __future__ import annotations

import json
import re
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score.checks.contracts import Decoder, LogDescription, Reader, Wanted
from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.logs.rosbag import RosbagReader
from ariac_score.testing.bags import Recorded, write_bag
from ariac_score.trial.channels import BodyMatch, Channel, FieldMap, LogMap
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.spans import Span
from ariac_score_ariac.messages import AriacMsgs2023, NistGear2020
from ariac_score_ariac.recorder_messages import AriacScoreRecords

READER = RosbagReader()
BAGS = Path(__file__).parents[2].parent / "shared" / "bags"
ORIGIN_NS = 1_585_866_235_112_411_371
SNAPSHOT = "nist_gear/msg/Snapshot"
SUBMISSION = "ariac_score_msgs/msg/Submission"
FORMATS = [
    ("ros1", "t.bag", ""),
    ("ros1", "t.bag", "bz2"),
    ("ros1", "t.bag", "lz4"),
    ("sqlite3", "t.db3", ""),
]
FORMATS += [("sqlite3", "t", ""), ("mcap", "t.mcap", ""), ("mcap", "t", "zstd"), ("mcap", "t", "")]

SPEED = FieldMap("speed/human", "m/s", ("human_operator_speed",))
DISTANCE = FieldMap("centre_distance/gantry/human", "m", ("distance_robot_human_operator",))
SNAPSHOTS = Channel("/snapshot", SNAPSHOT, signals=(SPEED, DISTANCE))


def snapshot(after_ns: int, speed: float = 0.5, distance: float = 2.0) -> Recorded:
    fields = {"human_operator_speed": speed, "distance_robot_human_operator": distance}
    return Recorded("/snapshot", SNAPSHOT, ORIGIN_NS + after_ns, fields)


def words(topic: str, text: str, after_ns: int = 0) -> Recorded:
    return Recorded(topic, "std_msgs/msg/String", ORIGIN_NS + after_ns, {"data": text})


def order(name: str, after_ns: int, x: float = 0.1) -> Recorded:
    pose = {"position": {"x": x, "y": -0.2}, "orientation": {"w": 1.0}}
    shipment = {"shipment_type": f"{name}_shipment_0", "agv_id": "agv2"}
    shipment["products"] = [{"type": "gear_part_red", "pose": pose}]  # type: ignore[assignment]
    fields = {"order_id": name, "shipments": [shipment]}
    return Recorded("/ariac/orders", "nist_gear/msg/Order", ORIGIN_NS + after_ns, fields)


def wanted(
    *channels: Channel, quantities: tuple[str, ...] = ("speed", "centre_distance"), **more: Any
) -> Wanted:
    bodies = (Body("gantry", "robot", 0.3), Body("human", "human", 0.3), Body("absent", "agv"))
    log_map = LogMap("test", channels, bodies=bodies, **more)
    decoders: dict[str, Decoder] = {
        "gear": NistGear2020(),
        "msgs": AriacMsgs2023(),
        "records": AriacScoreRecords(),
    }
    return Wanted(log_map, frozenset(quantities), decoders)


def read_mcap(folder: Path, messages: list[Recorded], want: Wanted) -> Trial:
    return READER.read(write_bag(folder / "t.mcap", messages, storage="mcap"), want)


def test_is_a_reader() -> None:
    assert isinstance(READER, Reader)


@pytest.mark.parametrize(("storage", "name", "compression"), FORMATS)
def test_brings_the_same_trial_to_the_bit_whatever_the_container(
    tmp_path: Path, storage: Any, name: str, compression: str
) -> None:
    messages = [words("/other", "x"), snapshot(33_333_333, 0.25, 3.5), snapshot(66_666_667, 0.5, 3.0)]
    path = write_bag(tmp_path / name, messages, storage=storage, compression=compression)

    trial = READER.read(path, wanted(SNAPSHOTS))

    assert READER.can_read(path)
    assert (trial.id, trial.clock.split(" (")[0]) == ("t", "log time, origin 1585866235112411371 ns")
    assert trial.recorded == Span(0.0, 66_666_667 / 1e9)
    assert trial.signals["speed/human"].t.tolist() == [33_333_333 / 1e9, 66_666_667 / 1e9]
    assert trial.signals["speed/human"].values.tolist() == [0.25, 0.5]
    assert trial.signals["centre_distance/gantry/human"].values.tolist() == [3.5, 3.0]
    assert [body.id for body in trial.bodies] == ["gantry", "human"]
    assert (trial.unrecorded, trial.log_defects) == ((), ())


@pytest.mark.parametrize(("storage", "name", "compression"), FORMATS)
def test_writes_the_same_bytes_twice(tmp_path: Path, storage: Any, name: str, compression: str) -> None:
    written = []
    for folder in (tmp_path / "once", tmp_path / "again"):
        folder.mkdir()
        path = write_bag(folder / name, [snapshot(0)], storage=storage, compression=compression)
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        written.append([(file.name, file.read_bytes()) for file in files])

    assert written[0] == written[1]


def test_a_field_that_does_not_exist_cannot_be_written(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="has no field 'dat'"):
        write_bag(
            tmp_path / "t.bag", [Recorded("/x", "std_msgs/msg/String", 1, {"dat": "x"})], storage="ros1"
        )


def test_several_fields_make_the_columns_of_one_signal(tmp_path: Path) -> None:
    fields = {"human_position": {"x": 1.0, "y": 2.0, "z": 3.0}}
    state = Recorded("/human", "ariac_msgs/msg/HumanState", ORIGIN_NS, fields)
    paths = tuple(f"human_position.{axis}" for axis in "xyz")
    channel = Channel("human", "ariac_msgs/HumanState", signals=(FieldMap("position/human", "m", paths),))

    trial = read_mcap(tmp_path, [state], wanted(channel, quantities=("position",)))

    assert trial.signals["position/human"].values.tolist() == [[1.0, 2.0, 3.0]]


def test_what_is_not_wanted_is_not_brought(tmp_path: Path) -> None:
    trial = read_mcap(tmp_path, [snapshot(0)], wanted(SNAPSHOTS, quantities=("speed",)))

    assert list(trial.signals) == ["speed/human"]


def test_orders_events_and_submissions_come_through_their_decoders(tmp_path: Path) -> None:
    submission = Recorded(
        "/sub", SUBMISSION, ORIGIN_NS + 3, {"shipment_type": "order_0_shipment_0", "agv": "agv1"}
    )
    messages = [words("/state", "init"), words("/state", "go", 1), order("order_0", 2), submission]
    channels = [Channel("/state", decoder="gear"), Channel("/ariac/orders", decoder="gear")]
    channels.append(Channel("/sub", decoder="records", witnesses=("submissions",)))

    trial = read_mcap(tmp_path, messages, wanted(*channels))

    assert trial.started_s == 1e-9
    assert [(o.id, o.announced_s) for o in trial.work] == [("order_0", 2e-9)]
    assert [(s.agv, s.submitted_s) for s in trial.submissions] == [("agv1", 3e-9)]
    assert trial.witnessed == {"submissions"}


def test_gazebo_models_give_positions_velocities_and_followed_links(tmp_path: Path) -> None:
    def state(type_: str, *names: str) -> Recorded:
        poses = [{"position": {"x": float(i)}} for i in range(len(names))]
        twists = [{"linear": {"y": 0.5 * i}} for i in range(len(names))]
        return Recorded(
            f"/{type_}",
            f"gazebo_msgs/msg/{type_}",
            ORIGIN_NS,
            {"name": list(names), "pose": poses, "twist": twists},
        )

    messages = [
        state("ModelStates", "ground", "person_1"),
        state("LinkStates", "ground::link", "person_1::head", "person_1::toe"),
    ]
    channels = [Channel("/ModelStates", poses="models"), Channel("/LinkStates", poses="models")]
    models = (BodyMatch("person_*", "human", links=("head",)), BodyMatch("gantry", "robot"))

    trial = read_mcap(tmp_path, messages, wanted(*channels, quantities=("position",), models=models))

    assert trial.signals["position/person_1"].values.tolist() == [[1.0, 0.0, 0.0]]
    assert trial.signals["velocity/person_1"].values.tolist() == [[0.0, 0.5, 0.0]]
    assert trial.signals["position/person_1::head"].values.tolist() == [[1.0, 0.0, 0.0]]
    assert "position/person_1::toe" not in trial.signals
    assert trial.bodies == (Body("person_1", "human", links=("head",)),)
    assert trial.unrecorded == ("model gantry: no recorded model matches; recorded models: ground, person_1",)


def test_progress_ends_at_one(tmp_path: Path) -> None:
    shares: list[float] = []
    path = write_bag(tmp_path / "t.mcap", [snapshot(i) for i in range(5000)], storage="mcap")

    READER.read(path, Wanted(LogMap("none"), progress=shares.append))

    assert len(shares) >= 2
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


# A missing or irregular topic is reported, and costs nothing else.


def test_a_topic_that_was_not_recorded_is_named(tmp_path: Path) -> None:
    trial = read_mcap(tmp_path, [words("/other", "x")], wanted(SNAPSHOTS))

    assert trial.unrecorded == ("topic /snapshot (nist_gear/msg/Snapshot)",)
    assert trial.bodies == ()


def test_a_topic_of_another_type_is_named_with_both_types(tmp_path: Path) -> None:
    trial = read_mcap(tmp_path, [words("/snapshot", "x")], wanted(SNAPSHOTS))

    assert trial.unrecorded == (
        "topic /snapshot (nist_gear/msg/Snapshot): it is recorded as std_msgs/msg/String",
    )


def test_the_types_that_a_topic_has_instead_are_named_in_alphabetical_order(tmp_path: Path) -> None:
    others = [Recorded("/snapshot", f"std_msgs/msg/{name}", ORIGIN_NS, {}) for name in ("String", "Bool")]
    others += [
        Recorded("/snapshot", f"geometry_msgs/msg/{name}", ORIGIN_NS, {}) for name in ("Pose", "Accel")
    ]
    trial = read_mcap(tmp_path, others, wanted(SNAPSHOTS))

    assert trial.unrecorded == (
        "topic /snapshot (nist_gear/msg/Snapshot): it is recorded as "
        "geometry_msgs/msg/Accel, geometry_msgs/msg/Pose, std_msgs/msg/Bool, std_msgs/msg/String",
    )


def speed_of(human: str, *, optional: bool = False, topic: str = "") -> Channel:
    field = FieldMap(f"speed/{human}", "m/s", ("human_operator_speed",))
    return Channel(topic or f"/{human}", SNAPSHOT, signals=(field,), optional=optional)


def speed_message(topic: str, after_ns: int = 0) -> Recorded:
    return Recorded(topic, SNAPSHOT, ORIGIN_NS + after_ns, {"human_operator_speed": 0.5})


def wanted_of_humans(*channels: Channel) -> Wanted:
    bodies = (Body("human_1", "human"), Body("human_2", "human"), Body("gantry", "robot"))
    return Wanted(LogMap("test", channels, bodies=bodies), frozenset({"speed"}))


def test_a_body_that_was_not_recorded_beside_another_of_its_kind_is_in_the_trial(tmp_path: Path) -> None:
    want = wanted_of_humans(speed_of("human_1"), speed_of("human_2"), speed_of("gantry"))

    trial = read_mcap(tmp_path, [speed_message("/human_1")], want)

    # No robot was recorded at all, which monitors report in their own words.
    assert [body.id for body in trial.bodies] == ["human_1", "human_2"]
    assert list(trial.signals) == ["speed/human_1"]


def test_a_body_whose_topic_has_another_type_is_in_the_trial_beside_another(tmp_path: Path) -> None:
    want = wanted_of_humans(speed_of("human_1"), speed_of("human_2"))

    trial = read_mcap(tmp_path, [speed_message("/human_1"), words("/human_2", "x")], want)

    assert [body.id for body in trial.bodies] == ["human_1", "human_2"]


def test_a_body_that_only_optional_topics_are_about_need_not_be_there(tmp_path: Path) -> None:
    want = wanted_of_humans(speed_of("human_1"), speed_of("human_2", optional=True))

    trial = read_mcap(tmp_path, [speed_message("/human_1")], want)

    assert [body.id for body in trial.bodies] == ["human_1"]


def test_a_body_of_the_other_type_that_one_topic_may_have_need_not_be_there(tmp_path: Path) -> None:
    other = Channel("/human_1", "std_msgs/msg/Bool", signals=(FieldMap("speed/human_2", "m/s", ("data",)),))

    trial = read_mcap(tmp_path, [speed_message("/human_1")], wanted_of_humans(speed_of("human_1"), other))

    assert [body.id for body in trial.bodies] == ["human_1"]


@pytest.mark.parametrize("optional", [False, True])
def test_a_topic_of_signals_that_has_no_messages_is_named_unless_optional(
    tmp_path: Path, *, optional: bool
) -> None:
    path = write_bag(
        tmp_path / "t.db3", [speed_message("/human_1"), speed_message("/human_2", 1)], storage="sqlite3"
    )
    with closing(sqlite3.connect(path)) as database, database:
        database.execute(
            "DELETE FROM messages WHERE topic_id = (SELECT id FROM topics WHERE name = '/human_2')"
        )
    want = wanted_of_humans(speed_of("human_1"), speed_of("human_2", optional=optional))

    trial = READER.read(path, want)

    named = ("topic /human_2 (nist_gear/msg/Snapshot): it has no messages",)
    assert trial.unrecorded == (() if optional else named)
    assert len(trial.bodies) == (1 if optional else 2)


def test_a_field_that_the_message_lacks_is_named_with_those_it_has(tmp_path: Path) -> None:
    lacking = FieldMap("speed/gantry", "m/s", ("robot.speed",))

    trial = read_mcap(tmp_path, [snapshot(0)], wanted(Channel("/snapshot", signals=(lacking, SPEED))))

    (text,) = trial.unrecorded
    assert "/snapshot" in text
    assert "'robot.speed'" in text
    assert "human_operator_speed, robot_speed, distance_robot_human_operator" in text
    assert list(trial.signals) == ["speed/human"]


def test_a_field_that_is_no_number_is_no_signal(tmp_path: Path) -> None:
    channel = Channel("/words", signals=(FieldMap("speed/human", "m/s", ("data",)),))

    trial = read_mcap(tmp_path, [words("/words", "1.5")], wanted(channel))

    assert not trial.signals
    assert "'data' of std_msgs/msg/String is not a number" in trial.unrecorded[0]


def test_an_order_with_a_pose_that_is_not_finite_is_counted_and_no_witness(tmp_path: Path) -> None:
    channel = Channel("/ariac/orders", decoder="gear", witnesses=("orders",))

    trial = read_mcap(tmp_path, [order("order_0", 0, x=float("nan")), order("order_1", 1)], wanted(channel))

    assert [o.id for o in trial.work] == ["order_1"]
    (defect,) = trial.log_defects
    assert (defect.kind, defect.where, defect.count) == ("unusable_messages", "/ariac/orders", 1)
    assert "finite" in defect.message
    assert trial.witnessed == frozenset()


def test_a_damaged_message_is_counted_and_the_others_stay(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.bag", [snapshot(0), snapshot(1), words("/state", "go", 2)], storage="ros1")
    # The text "go" with its length word, which then speaks of more bytes than the message has.
    _replace(path, b"\x02\0\0\0go", b"\x09\0\0\0go")

    trial = READER.read(path, wanted(SNAPSHOTS, Channel("/state", decoder="gear", witnesses=("orders",))))

    assert len(trial.signals["speed/human"]) == 2
    (defect,) = trial.log_defects
    assert (defect.kind, defect.where, defect.count) == ("undecodable_messages", "/state", 1)
    assert trial.witnessed == frozenset()


def test_a_definition_that_cannot_be_parsed_costs_its_own_topic_only(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.bag", [snapshot(0), words("/state", "go")], storage="ros1")
    _replace(path, b"string data", b"str]ng data")

    trial = READER.read(path, wanted(SNAPSHOTS, Channel("/state", decoder="gear")))

    assert len(trial.signals["speed/human"]) == 1
    (text,) = trial.unrecorded
    assert text.startswith(
        "topic /state (std_msgs/msg/String): the recording's definition of it cannot be used"
    )


def test_samples_that_are_not_finite_become_gaps_that_are_counted(tmp_path: Path) -> None:
    trial = read_mcap(
        tmp_path, [snapshot(0), snapshot(1, speed=float("inf")), snapshot(2)], wanted(SNAPSHOTS)
    )

    assert trial.signals["speed/human"].t.tolist() == [0.0, 2e-9]
    assert [(d.kind, d.where, d.count) for d in trial.log_defects] == [
        ("impossible_values", "speed/human", 1)
    ]


# Refusals.


def test_time_that_runs_backwards_by_a_lot_is_refused(tmp_path: Path) -> None:
    messages = [snapshot(0), snapshot(30 * 10**9), snapshot(5 * 10**9)]

    with pytest.raises(LogError, match=r"runs backwards by 25\.000 s"):
        read_mcap(tmp_path, messages, wanted(SNAPSHOTS))


@pytest.mark.parametrize(("apart_ns", "refused"), [(60 * 10**9, False), (60 * 10**9 + 1, True)])
def test_header_and_log_stamps_of_two_clocks_are_refused(
    tmp_path: Path, apart_ns: int, refused: bool
) -> None:
    stamp_ns = ORIGIN_NS - apart_ns
    header = {"stamp": {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}}
    message = Recorded("/point", "geometry_msgs/msg/PointStamped", ORIGIN_NS, {"header": header})
    channel = Channel("/point", stamp="header", signals=(FieldMap("speed/human", "m/s", ("point.x",)),))

    if not refused:
        assert read_mcap(tmp_path, [message], wanted(channel)).signals["speed/human"].t.tolist() == [-60.0]
        return
    with pytest.raises(LogError, match="two clocks are mixed: on topic /point") as refusal:
        read_mcap(tmp_path, [message], wanted(channel))
    assert "stamp: log" in refusal.value.hint


def test_a_bag_that_its_recorder_never_closed_says_so(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t.bag", [Recorded("/x", "std_msgs/msg/String", 1, {})], storage="ros1")
    whole = path.read_bytes()
    at = whole.index(b"index_pos=") + len(b"index_pos=")
    index = int.from_bytes(whole[at : at + 8], "little")
    path.write_bytes((whole[:at] + bytes(8) + whole[at + 8 :])[: index - 20])

    with pytest.raises(LogError) as refusal:
        READER.read(path, wanted())
    assert "recorder was killed" in refusal.value.hint
    assert "SIGINT" in refusal.value.hint


@pytest.mark.parametrize("name", ["t.bag", "t.db3", "t.mcap"])
def test_an_empty_file_is_nothing_to_score(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    path.touch()

    assert READER.can_read(path)
    for use in (READER.describe, lambda p: READER.read(p, wanted())):
        with pytest.raises(NothingToScoreError, match="empty"):
            use(path)


@pytest.mark.parametrize(("storage", "name"), [("ros1", "t.bag"), ("sqlite3", "t.db3"), ("mcap", "t.mcap")])
def test_a_recording_without_messages_is_nothing_to_score(tmp_path: Path, storage: Any, name: str) -> None:
    path = write_bag(tmp_path / name, [], storage=storage)

    assert READER.describe(path).damage == ""
    with pytest.raises(NothingToScoreError, match="no message"):
        READER.read(path, wanted(SNAPSHOTS))


@pytest.mark.parametrize(
    ("name", "content"), [("t.txt", b"hello"), ("t.mcap", b"hello, hello"), ("t.db", b"SQLite format 3\0")]
)
def test_what_is_no_recording_is_not_claimed(tmp_path: Path, name: str, content: bytes) -> None:
    path = tmp_path / name
    path.write_bytes(content)

    assert not READER.can_read(path)
    assert not READER.can_read(tmp_path)
    assert not READER.can_read(tmp_path / "absent")
    with pytest.raises(LogError):
        READER.read(path, wanted())


def test_a_folder_without_metadata_is_refused_with_the_remedy(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t", [snapshot(0)], storage="mcap")
    (path / "metadata.yaml").unlink()

    with pytest.raises(LogError, match=r"no metadata\.yaml") as refusal:
        READER.read(path, wanted())
    assert "ros2 bag reindex" in refusal.value.hint
    assert "metadata.yaml" in READER.describe(path).damage


def test_metadata_that_names_an_absent_file_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t", [snapshot(0)], storage="sqlite3")
    (path / "t.db3").rename(path / "u.db3")

    with pytest.raises(LogError, match=r"names 't\.db3', which is not in the folder"):
        READER.read(path, wanted())


def test_metadata_that_announces_other_messages_than_there_are_is_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "t", [snapshot(0)], storage="sqlite3")
    _replace(path / "metadata.yaml", b"  message_count: 1\n", b"  message_count: 2\n")

    with pytest.raises(LogError, match="announces 2 messages, the files hold 1"):
        READER.read(path, wanted())


@pytest.mark.parametrize(
    "text", ["", "[", "a: b", "rosbag2_bagfile_information: 3", "[" * 5000, "\0", "x: 2001-99-99"]
)
def test_metadata_that_cannot_be_understood_is_refused(tmp_path: Path, text: str) -> None:
    path = write_bag(tmp_path / "t", [snapshot(0)], storage="mcap")
    (path / "metadata.yaml").write_text(text)

    assert READER.can_read(path)
    with pytest.raises(LogError, match="cannot be understood"):
        READER.read(path, wanted())


def test_a_file_that_may_not_be_read_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_bag(tmp_path / "t.mcap", [snapshot(0)], storage="mcap")

    def deny(*_: object, **__: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "open", deny)

    assert READER.can_read(path)
    with pytest.raises(LogError, match="Permission denied"):
        READER.read(path, wanted())


def test_two_topics_for_one_signal_are_refused(tmp_path: Path) -> None:
    messages = [snapshot(0), Recorded("/second", SNAPSHOT, ORIGIN_NS, {})]

    with pytest.raises(LogError, match="recorded twice"):
        read_mcap(tmp_path, messages, wanted(SNAPSHOTS, Channel("/second", signals=(SPEED,))))


def _replace(path: Path, old: bytes, new: bytes) -> None:
    content = path.read_bytes()
    assert old in content
    path.write_bytes(content.replace(old, new))


# Recordings that others made; the expected figures are from other readers, see SOURCES.md there.


def _recordings() -> Iterator[Path]:
    for expected in sorted(BAGS.rglob("*.expected.json")):
        recording = expected.with_name(expected.name.removesuffix(".expected.json"))
        if recording.suffix in (".bag", ".db3", ".mcap"):
            yield recording


needs_recordings = pytest.mark.skipif(not BAGS.is_dir(), reason=f"the shared recordings are not at {BAGS}")


def _figures(description: LogDescription) -> dict[str, tuple[int, int | None, int | None]]:
    origin = re.search(r"origin (\d+) ns", description.clock)
    origin_ns = int(origin[1]) if origin else 0

    def ns(t_s: float | None) -> int | None:
        return None if t_s is None else origin_ns + round(t_s * 1e9)

    return {t.name: (t.count, ns(t.first_s), ns(t.last_s)) for t in description.topics}


@needs_recordings
@pytest.mark.parametrize("recording", list(_recordings()), ids=lambda path: str(path.relative_to(BAGS)))
def test_counts_foreign_recordings_as_other_readers_do(recording: Path) -> None:
    expected = json.loads(recording.with_name(f"{recording.name}.expected.json").read_text())
    description = READER.describe(recording)
    found = _figures(description)

    assert READER.can_read(recording)
    assert description.damage == ""
    for figures in (expected["first"], expected["second"]):
        for topic, of_topic in figures.get("topics", {}).items():
            assert found[topic][0] == of_topic["count"]
            if "first_ns" in of_topic:
                assert found[topic][1:] == (of_topic["first_ns"], of_topic["last_ns"])


@needs_recordings
@pytest.mark.parametrize("recording", list(_recordings()), ids=lambda path: str(path.relative_to(BAGS)))
def test_reads_the_numbers_of_foreign_recordings_as_other_readers_do(recording: Path) -> None:
    expected = json.loads(recording.with_name(f"{recording.name}.expected.json").read_text())["first"][
        "topics"
    ]
    sums = {
        f"speed/{i}/{j}": (topic, path, of_field)
        for i, (topic, of_topic) in enumerate(expected.items())
        for j, (path, of_field) in enumerate(of_topic.get("fields", {}).items())
        # A field of a sequence has another number of values than there are messages.
        if "fsum" in of_field and of_field["n"] == of_topic["count"] and "[]" not in path
    }
    # By times of recording: some of these were recorded years after their headers were stamped.
    channels = tuple(
        Channel(topic, stamp="log", signals=(FieldMap(name, "", (path,)),))
        for name, (topic, path, _) in sums.items()
    )

    trial = READER.read(recording, Wanted(LogMap("all", channels), frozenset({"speed"})))

    settled = {defect.where for defect in trial.log_defects}
    for name in trial.signals.keys() - settled:
        assert np.sum(trial.signals[name].values) == pytest.approx(sums[name][2]["fsum"], rel=1e-12, abs=1e-9)


@needs_recordings
def test_reads_the_whole_conformance_suite_of_mcap() -> None:
    expected = json.loads((BAGS / "mcap_conformance" / "expected.json").read_text())

    for name, of_file in expected.items():
        description = READER.describe(BAGS / "mcap_conformance" / name)

        messages = of_file["messages_topic_log_publish_seq_hex"]
        assert (description.damage, description.facts["messages"]) == ("", len(messages))
        assert [t.name for t in description.topics if t.count] == sorted({m[0] for m in messages})


def test_a_topic_that_is_optional_is_not_missed(tmp_path: Path) -> None:
    text = "std_msgs/msg/String"
    channels = Channel("/there", text, decoder="gear"), Channel("/may", text, decoder="gear", optional=True)
    path = write_bag(tmp_path / "x.mcap", [Recorded("/other", "std_msgs/msg/String", 1, {})], storage="mcap")

    assert RosbagReader().read(path, wanted(*channels)).unrecorded == ("topic /there (std_msgs/msg/String)",)


def test_of_two_channels_on_one_topic_the_other_type_is_not_missed(tmp_path: Path) -> None:
    types = ("std_msgs/msg/String", "std_msgs/msg/Bool")
    channels = [Channel("/state", t, decoder="gear") for t in types]
    path = write_bag(tmp_path / "x.mcap", [Recorded("/state", types[0], 1, {"data": "go"})], storage="mcap")

    trial = RosbagReader().read(path, wanted(*channels))

    assert trial.unrecorded == ()
    assert len(trial.events) == 1


@pytest.mark.parametrize(
    ("states", "ended_s"),
    [
        (["init", "go", "go", "end_game", "end_game", "done"], 3.0),
        (["init", "go", "go", "go", "done", "done"], 4.0),
        (["init", "go", "go", "go", "go", "go"], None),
    ],
)
def test_the_states_of_a_competition_count_where_they_change(
    tmp_path: Path, states: list[str], ended_s: float | None
) -> None:
    messages = [
        Recorded("/state", "std_msgs/msg/String", i * 10**9, {"data": s}) for i, s in enumerate(states)
    ]
    path = write_bag(tmp_path / "x.mcap", messages, storage="mcap")

    trial = RosbagReader().read(path, wanted(Channel("/state", decoder="gear")))

    assert (trial.started_s, trial.ended_s) == (1.0, ended_s)
    assert len(trial.events) == (1 if ended_s is None else 2)


@pytest.mark.parametrize("states", [(1, 2, 2, 3, 4, 4), (1, 3, 3, 3, 4, 4)])
def test_a_competition_of_2023_starts_once_whether_or_not_its_first_state_was_seen(
    tmp_path: Path, states: tuple[int, ...]
) -> None:
    type_ = "ariac_msgs/msg/CompetitionState"
    messages = [
        Recorded("/state", type_, i * 10**9, {"competition_state": state}) for i, state in enumerate(states)
    ]
    path = write_bag(tmp_path / "x.mcap", messages, storage="mcap")

    trial = RosbagReader().read(path, wanted(Channel("/state", decoder="msgs")))

    assert (trial.started_s, trial.ended_s) == (1.0, 4.0)
    assert len(trial.events) == 2


@pytest.mark.parametrize(
    ("states", "rate_hz", "late_s"),
    [
        # The last word before each change is 1 s before it.
        (["init", "go", "go", "go", "done"], 0.0, (1.0, 1.0)),
        (["ready", "", "", "go", "go", "go", "", "", "", "end_game"], 0.0, (3.0, 4.0)),  # words were lost
        # Who speaks only when something changes says at once that it ends, unless a rate is stated.
        # Words that were left out make anybody look like that, so a start may have been earlier.
        (["init", "ready", "go", "end_game", "done"], 0.0, (1.0, 0.0)),
        (["init", "ready", "go", "end_game", "done"], 1.0, (1.0, 1.0)),
        (["init", "", "go", "", "", "", "done"], 0.0, (2.0, 0.0)),
        (["", "", "", "go", "", "done"], 0.0, (0.0, 0.0)),  # nothing was recorded before it
        (["go", "", "", "", "done"], 0.0, (0.0, 0.0)),
    ],
)
def test_a_topic_that_repeats_its_state_states_a_change_at_its_rate(
    tmp_path: Path, states: list[str], rate_hz: float, late_s: tuple[float, float]
) -> None:
    messages = [
        Recorded("/state", "std_msgs/msg/String", i * 10**9, {"data": s}) for i, s in enumerate(states) if s
    ]
    path = write_bag(tmp_path / "x.mcap", messages, storage="mcap")

    trial = RosbagReader().read(path, wanted(Channel("/state", decoder="gear", rate_hz=rate_hz)))

    assert tuple(event.number("late_by_at_most", unit="s") or 0.0 for event in trial.events) == late_s


def test_a_last_word_that_came_late_was_said_earlier(tmp_path: Path) -> None:
    # `init` of 0.4 s came with a delay of 60 ms, which the next words make up for.
    times_s = [0.0, 0.1, 0.2, 0.3, 0.46, 0.5, *(0.6 + 0.1 * i for i in range(20))]
    messages = [
        Recorded("/state", "std_msgs/msg/String", round(t_s * 1e9), {"data": "init" if i < 5 else "go"})
        for i, t_s in enumerate(times_s)
    ]
    path = write_bag(tmp_path / "x.mcap", messages, storage="mcap")

    (started,) = RosbagReader().read(path, wanted(Channel("/state", decoder="gear"))).events

    assert started.t_s == 0.5
    assert started.number("late_by_at_most", unit="s") == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("states", "ran_for_s"),
    [
        (["init", "go", "go", "go", "go"], 3.0),
        (["init", "go", "go", "", "go", "done"], 3.0),
        (["init", "go", "go", "init", "go"], 1.0),  # what a word between them means nobody knows
        (["init", "go"], None),
    ],
)
def test_a_topic_that_repeats_its_state_says_for_how_long_the_competition_runs(
    tmp_path: Path, states: list[str], ran_for_s: float | None
) -> None:
    messages = [
        Recorded("/state", "std_msgs/msg/String", i * 10**9, {"data": s}) for i, s in enumerate(states) if s
    ]
    path = write_bag(tmp_path / "x.mcap", messages, storage="mcap")

    trial = RosbagReader().read(path, wanted(Channel("/state", decoder="gear")))

    started = next(one for one in trial.events if one.kind == "competition_started")
    assert started.number("ran_for_at_least", unit="s") == ran_for_s


@pytest.mark.slow
def test_what_no_plan_can_express_is_decoded_one_by_one_and_speed_message(tmp_path: Path) -> None:
    """More fields than a plan takes: rosbags reads each message, and the trial tells."""
    from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: PLC0415
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415

    name, store = "test_msgs/msg/Wide", get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("\n".join(f"float32 f{i}" for i in range(4100)), name))
    with Writer(tmp_path / "wide", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection("/wide", name, typestore=store)
        for i in range(3):
            message = store.types[name](*[0.5 * i] * 4100)
            writer.write(connection, 10**18 + i * 10**9, bytes(store.serialize_cdr(message, name)))
    channel = Channel("/wide", name, signals=(FieldMap("speed/human", "m/s", ("f4099",)),))

    trial = READER.read(tmp_path / "wide", wanted(channel))

    assert trial.signals["speed/human"].values.tolist() == [0.0, 0.5, 1.0]
    (defect,) = trial.log_defects
    assert (defect.kind, defect.where) == ("decoded_one_by_one", "/wide")
    assert "more than 4096 fields" in defect.message
