"""Logs of ROSMonitoring: every generation, and what a score may not rest on."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Body, LogError, LogMap, NothingToScoreError, Trial, Wanted, score_trial
from ariac_score.cli import main
from ariac_score.logs.rosmonitoring import (
    RosMonitoringReader,
    channel_of,
    clock_of,
    fields_of,
    parse_object,
    rows,
    stamp_s,
)
from ariac_score.testing import write_bag, write_event_log
from ariac_score.trial.channels import BodyMatch, Channel, FieldMap
from ariac_score_ariac.messages import NistGear2020
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

READER = RosMonitoringReader()
ORIGIN_NS = 1_700_000_000_000_000_000
SNAPSHOT = {"human_operator_speed": 0.5, "robot_speed": 0.25, "distance_robot_human_operator": 4.0}
MAP = LogMap(
    "paper",
    channels=(
        Channel(
            "/snapshot",
            "nist_gear/msg/Snapshot",
            signals=(
                FieldMap("speed/human", "m/s", ("human_operator_speed",)),
                FieldMap("speed/robot", "m/s", ("robot_speed",)),
                FieldMap("centre_distance/robot/human", "m", ("distance_robot_human_operator",)),
            ),
        ),
        Channel("/ariac/orders", "nist_gear/msg/Order", decoder="orders", witnesses=("order_announced",)),
        Channel("/ariac/competition_state", "std_msgs/msg/String", decoder="orders"),
    ),
    bodies=(Body("robot", "robot"), Body("human", "human")),
)
WANTED = Wanted(MAP, frozenset({"speed", "centre_distance"}), {"orders": NistGear2020()})
POSES = LogMap(
    "poses",
    channels=(
        *(
            Channel(
                f"/pose_{name}",
                "geometry_msgs/msg/PoseStamped",
                stamp="header",
                signals=(
                    FieldMap(f"position/{name}", "m", tuple(f"pose.position.{axis}" for axis in "xyz")),
                ),
            )
            for name in "ab"
        ),
        Channel("/plain", signals=(FieldMap("speed/a", "m/s", ("data",)),)),
    ),
    bodies=(Body("a", "robot"), Body("b", "human")),
)


def _log(path: Path, *events: Any, text: str = "") -> Path:
    lines = text or "".join(json.dumps(event) + "\n" for event in events)
    path.write_text(lines, encoding="utf-8")
    return path


def _snapshot(time: object, **changed: object) -> dict[str, Any]:
    return {"topic": "snapshot", **SNAPSHOT, "time": time, **changed}


def _read(path: Path) -> Trial:
    return READER.read(path, WANTED)


def _event_count(path: Path) -> int:
    return sum(1 for _ in rows(path))


# What a user gets ------------------------------------------------------------------------


def test_an_event_log_of_the_example_scores_as_its_bag_does(tmp_path: Path) -> None:
    messages = recorded_messages(kitting_trial())
    log = write_event_log(tmp_path / "events.jsonl", messages)
    bag = write_bag(tmp_path / "trial.mcap", messages, storage="mcap")

    from_log, from_bag = score_trial(log, "paper2020.published"), score_trial(bag, "paper2020.published")

    assert from_log.measured.findings == from_bag.measured.findings
    assert from_log.score == from_bag.score


def test_wall_clock_stamps_count_from_the_first(tmp_path: Path) -> None:
    log = write_event_log(tmp_path / "events.jsonl", recorded_messages(kitting_trial()), origin_ns=0)

    result = score_trial(log, "paper2020.published")

    assert str(result.score) == "19.761677"
    assert result.measured.clock == f"wall-clock time, origin {ORIGIN_NS} ns"


FRAMES = Wanted(
    LogMap(
        "frames",
        channels=(Channel("/tf", "tf2_msgs/msg/TFMessage", poses="frames"),),
        frames=(BodyMatch("a", "robot", body="a"),),
    ),
    frozenset({"position"}),
    {},
)


def _transform(time_s: float, stamp: dict[str, int], x_m: float) -> dict[str, Any]:
    placed = {
        "header": {"seq": 0, "stamp": stamp, "frame_id": "world"},
        "child_frame_id": "a",
        "transform": {
            "translation": {"x": x_m, "y": 0.0, "z": 0.0},
            "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
        },
    }
    return {"topic": "/tf", "transforms": [placed], "time": time_s}


@pytest.mark.parametrize(("whole", "part"), [("secs", "nsecs"), ("sec", "nanosec")])
def test_a_transform_was_there_when_it_says_and_not_when_it_came(
    tmp_path: Path, whole: str, part: str
) -> None:
    """Who takes a walk's steps for where they came would see a run: they come in bursts."""
    came_s = (1_700_000_000.0, 1_700_000_000.5, 1_700_000_000.5001)
    stamps = [{whole: 1_700_000_000, part: n * 250_000_000} for n in range(3)]
    events = [_transform(at_s, stamp, n) for n, (at_s, stamp) in enumerate(zip(came_s, stamps, strict=True))]

    trial = READER.read(_log(tmp_path / "x.jsonl", *events), FRAMES)

    assert trial.signals["position/a"].t.tolist() == [0.0, 0.25, 0.5]


@pytest.mark.parametrize(
    "stamp", [{"secs": 0, "nsecs": 0}, {"secs": 12, "nsecs": 5}, {"secs": 1_700_000_061, "nsecs": 0}, {}]
)
def test_a_transform_of_another_clock_has_the_time_of_its_event(
    tmp_path: Path, stamp: dict[str, int]
) -> None:
    events = [_transform(1_700_000_000.0 + n / 4, stamp, n) for n in range(3)]

    trial = READER.read(_log(tmp_path / "x.jsonl", *events), FRAMES)

    assert trial.signals["position/a"].t == pytest.approx([0.0, 0.25, 0.5], abs=1e-6)


@pytest.mark.parametrize(
    ("time_s", "clock"),
    [
        (None, "no time"),
        (0.0, "simulated time"),
        (999_999_999.9, "simulated time"),
        (1_000_000_000.0, "wall-clock time"),  # 2001-09-09 01:46:40 UTC
    ],
)
def test_a_stamp_of_this_century_is_wall_clock_time(time_s: float | None, clock: str) -> None:
    assert clock_of(time_s) == clock


def test_info_counts_what_a_log_holds(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = _log(tmp_path / "x.jsonl", _snapshot(1.0, verdict="currently_true"), _snapshot(2.0))

    assert main(["info", str(log)]) == 0

    out = capsys.readouterr().out
    assert "ROSMonitoring log" in out
    assert "verdict currently_true: 1" in out


# The samples -----------------------------------------------------------------------------


def test_every_sample_log_holds_what_was_counted_in_it(shared: Path) -> None:
    folder = shared / "rosmonitoring/data"
    expected = json.loads((folder / "expected.json").read_text())
    for name, facts in expected.items():
        path = folder / name
        events = [row.event for row in rows(path)]
        assert READER.can_read(path), name
        assert len(events) == facts.get("events", facts.get("rows")), name
        described = {topic.name: topic.count for topic in READER.describe(path).topics}
        for channel, count in facts.get("channels", {}).items():
            kind, _, rest = channel.partition(":")
            topic, _, direction = rest.partition(":")
            assert described["/" + topic.strip("/") + (f"/{direction}" if kind == "service" else "")] == count
        if "with_time" in facts:
            times = [t for event in events if (t := stamp_s(event)) is not None]
            assert (len(times), times[0], times[-1]) == (
                facts["with_time"],
                facts["first_time"],
                facts["last_time"],
            )


def test_verdicts_of_an_earlier_run_stand_in_status_log_and_oracle_log(shared: Path) -> None:
    folder = shared / "rosmonitoring/data/generated"
    wanted = ["currently_true", "currently_false", *["currently_true"] * 3, "currently_false"]

    for name in ("cell_guard_status.jsonl", "cell_guard_oracle.jsonl"):
        assert [row.verdict for row in rows(folder / name)][:6] == wanted
    assert [row.event for row in rows(folder / "cell_guard_status.jsonl")] == [
        row.event for row in rows(folder / "cell_guard.jsonl")
    ]


def test_simulated_time_beside_wall_clock_time_is_kept_apart(shared: Path) -> None:
    log = shared / "rosmonitoring/data/generated/ordered_cell_log.jsonl"

    trial = READER.read(log, Wanted(POSES, frozenset({"position", "speed"})))

    assert trial.clock == "simulated time"
    assert trial.signals["position/b"].t.tolist() == [19.9, 20.1, 20.39, 20.8]
    assert trial.signals["position/a"].values[:, 0].tolist() == [1.0, 1.1, 1.2]
    assert "speed/a" not in trial.signals
    assert "signal speed/a: stamped in wall-clock time, the motion in simulated time" in trial.unrecorded
    assert [d.kind for d in trial.log_defects] == ["other_clock"]


# Forms -----------------------------------------------------------------------------------


def test_key_order_blank_lines_several_objects_and_a_missing_end_of_line_are_fine(tmp_path: Path) -> None:
    first, second, third = (json.dumps(_snapshot(t), sort_keys=t > 1) for t in (1.0, 2.0, 3.0))
    log = _log(tmp_path / "x.jsonl", text=f"\ufeff\n{first} {second}\n\r\n{third}")

    assert _read(log).signals["speed/human"].t.tolist() == [1.0, 2.0, 3.0]


def test_topics_are_the_same_with_and_without_leading_slash(tmp_path: Path) -> None:
    log = _log(tmp_path / "x.jsonl", _snapshot(1.0), _snapshot(2.0, topic="/snapshot"))

    assert len(_read(log).signals["speed/robot"]) == 2


def test_the_verdict_of_an_older_log_is_no_part_of_the_event(tmp_path: Path) -> None:
    plain = _log(tmp_path / "a.jsonl", _snapshot(1.0), _snapshot(1.1))
    online = _log(
        tmp_path / "b.jsonl",
        _snapshot(1.0, verdict="currently_true"),
        _snapshot(1.1, verdict="currently_false", spec="d_min"),
    )

    assert [row.verdict for row in rows(online)] == ["currently_true", "currently_false"]
    for name, signal in _read(plain).signals.items():
        np.testing.assert_array_equal(signal.values, _read(online).signals[name].values)


@pytest.mark.parametrize(
    ("text", "items"),
    [
        ("array('d', [1.0, 2.0])", [1.0, 2.0]),
        ("array('d')", []),
        ("array('i', [1, -2])", [1, -2]),
        ("array('f', [nan, inf])", None),
        ("[1.5 2. ]", [1.5, 2.0]),
        ("[ 1 -2\n  3]", [1, -2, 3]),
        ("[1.e-05 2.5e+10]", [1e-05, 2.5e10]),
        ("[ True False]", [True, False]),
    ],
)
def test_arrays_written_as_text_are_lists_again(text: str, items: list[float] | None) -> None:
    message = fields_of({"topic": "x", "values": text})

    if items is None:
        assert np.isnan(message.values[0])
        assert np.isposinf(message.values[1])
    else:
        assert message.values == items
        assert [type(item) for item in message.values] == [type(item) for item in items]


@pytest.mark.parametrize(
    "text",
    [
        "[0. 1. ... 8. 9.]",
        "array('d', [1.0, ...])",
        "array('d', __import__('os'))",
        "[__import__('os').getpid()]",
        "array('Z', [1])",
        "[1, 2",
        "a plain word",
    ],
)
def test_what_is_no_array_stays_text_and_is_never_evaluated(text: str) -> None:
    assert fields_of({"topic": "x", "data": text}).data == text


def test_a_service_is_read_as_its_two_directions() -> None:
    request = {"service": "add", "request": {"a": 2}, "time": 1.0}

    assert channel_of(request) == "/add/request"
    assert fields_of(request).a == 2
    assert channel_of({"service": "/add", "response": {"sum": 5}}) == "/add/response"
    assert channel_of({"service": "add"}) == ""


# What must not be taken for data -----------------------------------------------------------


def test_nan_tokens_are_gaps_and_counted(tmp_path: Path) -> None:
    log = _log(
        tmp_path / "x.jsonl", *(_snapshot(t, robot_speed=v) for t, v in ((1, 0.1), (2, np.nan), (3, 0.2)))
    )
    assert "NaN" in log.read_text()

    trial = _read(log)

    assert trial.signals["speed/robot"].t.tolist() == [1.0, 3.0]
    assert trial.signals["speed/human"].t.tolist() == [1.0, 2.0, 3.0]
    assert [(d.kind, d.where, d.count) for d in trial.log_defects] == [
        ("impossible_values", "speed/robot", 1)
    ]


@pytest.mark.parametrize("time", [None, "1.0", True, float("nan"), -1.0, 1e300, 10**400, [1]])
def test_a_time_that_is_none_is_counted_and_its_motion_not_used(tmp_path: Path, time: object) -> None:
    log = _log(tmp_path / "x.jsonl", _snapshot(1.0), _snapshot(time), _snapshot(2.0))

    trial = _read(log)

    assert trial.signals["speed/robot"].t.tolist() == [1.0, 2.0]
    assert [(d.kind, d.where, d.count) for d in trial.log_defects] == [("other_clock", "no time", 1)]


def test_a_log_without_any_time_has_no_motion(tmp_path: Path) -> None:
    snapshot = _snapshot(1.0)
    del snapshot["time"]

    trial = _read(_log(tmp_path / "x.jsonl", snapshot, snapshot))

    assert not trial.signals
    assert trial.window is None
    assert "signal speed/robot: it has no times" in trial.unrecorded


def test_orders_on_another_clock_keep_what_needs_no_time(tmp_path: Path) -> None:
    order = {"topic": "ariac/orders", "order_id": "order_0", "shipments": [], "time": 1.7e9}
    state = {"topic": "/ariac/competition_state", "data": "go", "time": 1.7e9}
    log = _log(tmp_path / "x.jsonl", _snapshot(20.0), order, state, _snapshot(20.1))

    trial = _read(log)

    assert [(o.id, o.announced_s) for o in trial.work] == [("order_0", None)]
    assert trial.events == ()
    assert "order_announced" in trial.witnessed
    assert trial.signals["speed/human"].t.tolist() == [20.0, 20.1]


def test_a_missing_field_is_named_and_missing(tmp_path: Path) -> None:
    trial = _read(_log(tmp_path / "x.jsonl", {"topic": "snapshot", "robot_speed": 0.1, "time": 1.0}))

    assert list(trial.signals) == ["speed/robot"]
    assert any("no field 'human_operator_speed'" in words for words in trial.unrecorded)


def test_text_and_truth_are_no_numbers_of_a_signal(tmp_path: Path) -> None:
    trial = _read(_log(tmp_path / "x.jsonl", _snapshot(1.0, robot_speed="fast"), _snapshot(1.1)))

    assert trial.signals["speed/robot"].t.tolist() == [1.1]
    assert any("not speed/robot" in words or "for speed/robot" in words for words in trial.unrecorded)


@pytest.mark.parametrize("line", ["[]", "3", '"text"', "null", "NaN", "{", '{"a": 1} x', '{"a": 1, "a": 2}'])
def test_what_is_no_event_is_refused_with_its_line(tmp_path: Path, line: str) -> None:
    log = _log(tmp_path / "x.jsonl", text=f"{json.dumps(_snapshot(1.0))}\n{line}\n")

    with pytest.raises(LogError) as refused:
        _read(log)

    assert refused.value.place == "line 2"
    assert READER.describe(log).damage
    assert READER.describe(log).facts["events"] >= 1


def test_a_line_nested_without_end_is_refused(tmp_path: Path) -> None:
    log = _log(tmp_path / "x.jsonl", text='{"topic": "snapshot", "time": 1.0, "x": ' + "[" * 100_000 + "\n")

    with pytest.raises(LogError):
        _read(log)


def test_a_log_cut_off_anywhere_is_refused_or_read_to_its_last_whole_event(tmp_path: Path) -> None:
    whole = "".join(json.dumps(_snapshot(t, note="caf\u00e9 {")) + "\n" for t in (1.0, 1.01, 1.02)).encode()
    log = tmp_path / "x.jsonl"
    lengths = {0}
    for end in (i for i in range(1, len(whole) + 1) if whole[i - 1 : i] in (b"}", b"\n")):
        lengths |= {end}
    for length in range(1, len(whole) + 1):
        log.write_bytes(whole[:length])
        assert READER.can_read(log) or length < 9
        if length in lengths:
            assert len(_read(log).signals["speed/human"]) == whole[:length].count(b"}")
        else:
            with pytest.raises(LogError, match="cut off"):
                _read(log)


def test_an_empty_log_is_nothing_to_score(tmp_path: Path) -> None:
    for text in ("", "\n\n"):
        log = tmp_path / "x.jsonl"
        log.write_text(text)
        with pytest.raises(NothingToScoreError):
            _read(log)


def test_a_status_log_of_two_monitors_that_saw_one_interface_is_refused(tmp_path: Path) -> None:
    both = [
        {"status": "event", "monitor": name, "interface": "/snapshot", "event": _snapshot(1.0), "time": 1.7e9}
        for name in ("first", "second")
    ]

    assert _event_count(_log(tmp_path / "one.jsonl", both[0], {"status": "stopped", "monitor": "first"})) == 1
    with pytest.raises(LogError, match="two monitors"):
        _read(_log(tmp_path / "two.jsonl", *both))


@pytest.mark.parametrize(
    "text",
    ["", "hello", "{}", "[]", '{"record": "trial", "format": "x"}\n', '{"status": "event"}', "\x00\xff", "{"],
)
def test_other_files_are_not_taken_for_event_logs(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.json").write_text(text, encoding="latin-1")

    assert not READER.can_read(tmp_path / "x.json")
    assert not READER.can_read(tmp_path / "nowhere.jsonl")
    assert not READER.can_read(tmp_path)


_JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
    max_leaves=8,
)


@settings(max_examples=50)
@given(event=st.dictionaries(st.sampled_from([*SNAPSHOT, "topic", "time", "service", "request", "x"]), _JSON))
def test_any_event_is_read_or_refused_in_words(event: dict[str, Any]) -> None:
    event = parse_object(json.dumps(event))

    channel_of(event)
    stamp_s(event)
    if channel_of(event):
        fields_of(event)
