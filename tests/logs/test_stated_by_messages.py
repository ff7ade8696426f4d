"""Events with numbers, and facts of the trial, that a log map reads from plain messages."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score import Event, EventNumber, Trial, load_log_map
from ariac_score.checks.registry import Registry
from ariac_score.engine.read import read_trial
from ariac_score.errors import LogError, LogMapError
from ariac_score.logs.bundle import Bundle, Part
from ariac_score.logs.rosbag import RosbagReader
from ariac_score.testing.bags import Recorded, write_bag

MAP = """\
id: plain
title: Plain messages
source: this test
facts: {scene: workshop, end_s: null}
channels:
  - topic: /contact
    event: {kind: contact, subject: arm}
    numbers:
      force: {field: vector.z, unit: N}
      push: {field: vector.x, unit: N}
    witnesses: [contact]
  - topic: /ariac_score/events
    type: ariac_score_msgs/msg/TrialEvent
    decoder: ariac_score.events
  - {topic: /limit, facts: {time_limit_s: data}}
  - {topic: /cable, facts: {cable: data}}
"""
AT_NS = 100 * 10**9
VECTOR, NUMBER, TEXT = "geometry_msgs/msg/Vector3Stamped", "std_msgs/msg/Float64", "std_msgs/msg/String"


def contact(t_s: float, x: float, z: float) -> Recorded:
    t_ns = AT_NS + round(t_s * 1e9)
    stamp = {"sec": t_ns // 10**9, "nanosec": t_ns % 10**9}
    fields = {"header": {"stamp": stamp, "frame_id": ""}, "vector": {"x": x, "y": 0.0, "z": z}}
    return Recorded("/contact", VECTOR, t_ns, fields)


def touch(t_s: float, *, push_n: float, force_n: float) -> Event:
    numbers = (EventNumber("force", force_n, "N"), EventNumber("push", push_n, "N"))
    return Event(t_s, "contact", "arm", numbers=numbers)


def limit(value_s: float) -> Recorded:
    return Recorded("/limit", NUMBER, AT_NS, {"data": value_s})


def read(folder: Path, *messages: Recorded, text: str = MAP) -> Trial:
    (folder / "map.yaml").write_text(text, encoding="utf-8")
    bag = write_bag(folder / "run.mcap", messages, storage="mcap")
    return read_trial(
        Bundle("run", folder, (Part(bag, "rosbag"),)),
        {"rosbag": RosbagReader()},
        load_log_map(folder / "map.yaml"),
        Registry(),
        quantities=(),
        work=False,
    )


def test_every_message_of_a_channel_is_an_event_with_its_numbers(tmp_path: Path) -> None:
    trial = read(tmp_path, contact(0.0, 1.0, 81.5), contact(0.5, 2.0, 12.0))

    assert trial.events_of("contact") == (
        touch(0.0, push_n=1.0, force_n=81.5),
        touch(0.5, push_n=2.0, force_n=12.0),
    )
    assert trial.events[0].number("force", unit="N") == 81.5
    assert "contact" in trial.witnessed


def test_a_message_whose_number_is_none_is_counted_and_silence_shows_nothing(tmp_path: Path) -> None:
    trial = read(tmp_path, contact(0.0, 1.0, float("nan")), contact(0.5, 2.0, 12.0))

    assert [event.t_s for event in trial.events_of("contact")] == [0.5]
    (unusable,) = (defect for defect in trial.log_defects if defect.kind == "unusable_messages")
    assert (unusable.where, unusable.count) == ("/contact", 1)
    assert "its field 'vector.z' is no finite number" in unusable.message
    assert "contact" not in trial.witnessed


def test_a_field_that_is_not_there_is_said(tmp_path: Path) -> None:
    trial = read(tmp_path, contact(0.0, 1.0, 2.0), text=MAP.replace("vector.z", "vector.w"))

    assert not trial.events_of("contact")
    assert any("it has no field 'vector.w'" in words for words in trial.unrecorded)


def test_facts_come_from_constants_and_from_messages(tmp_path: Path) -> None:
    cable = Recorded("/cable", TEXT, AT_NS, {"data": "cable_1"})
    trial = read(tmp_path, limit(180.0), limit(180.0), cable)

    stated = {"cable": "cable_1", "end_s": None, "scene": "workshop", "time_limit_s": 180.0}
    assert dict(trial.facts) == stated
    assert "time_limit_s" not in read(tmp_path, cable).facts


def test_two_messages_may_not_contradict_each_other(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"topic /limit says that time_limit_s is 240\.0, after 180\.0"):
        read(tmp_path, limit(180.0), limit(240.0))


def test_a_message_and_a_constant_may_not_contradict_each_other(tmp_path: Path) -> None:
    text = MAP.replace("scene: workshop", "time_limit_s: 300")
    assert read(tmp_path, limit(300.0), text=text).facts["time_limit_s"] == 300.0
    with pytest.raises(LogError, match=r"'log map plain' \(organiser\) says 300"):
        read(tmp_path, limit(180.0), text=text)


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        ("    event: {kind: contact, subject: arm}\n", "", "no event has its 'numbers'"),
        ("kind: contact, subject: arm}", "kind: contact}\n    decoder: x", "both 'event' and 'decoder'"),
        ("unit: N}\n      push", "}\n      push", "key 'unit' is missing"),
        ("kind: contact, ", "", "key 'kind' is missing"),
        ("limit, facts", "limit, as_consumed: true, facts", "has nothing as consumed"),
        ("limit, facts", "limit, poses: frames, facts", "a channel of poses has no 'facts'"),
    ],
)
def test_what_cannot_be_read_is_refused_when_the_map_is_loaded(
    tmp_path: Path, old: str, new: str, cause: str
) -> None:
    assert MAP.count(old) == 1
    with pytest.raises(LogMapError, match=cause):
        read(tmp_path, limit(1.0), text=MAP.replace(old, new))


def test_events_of_a_decoder_carry_the_numbers_of_its_channel(tmp_path: Path) -> None:
    fields = {"kind": "hit", "subject": "7", "detail": ""}
    hit = Recorded("/ariac_score/events", "ariac_score_msgs/msg/TrialEvent", AT_NS, fields)
    # No field of this message is a number, which is said of it.
    decoder = "decoder: ariac_score.events"
    text = MAP.replace(decoder, f"{decoder}\n    numbers: {{n: {{field: subject, unit: m}}}}")

    assert [event.kind for event in read(tmp_path, hit).events] == ["hit"]
    trial = read(tmp_path, hit, text=text)
    assert not trial.events
    assert any("its field 'subject' is no finite number" in words for words in trial.unrecorded)
