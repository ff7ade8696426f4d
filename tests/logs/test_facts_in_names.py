"""Names in a log map that hang on the trial: `{cable}/{plug}_link`, filled from its configuration."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from ariac_score import LogMap, ReaderFacts, Trial, Wanted, load_log_map
from ariac_score.checks.registry import Registry
from ariac_score.engine.read import read_trial
from ariac_score.errors import LogMapError
from ariac_score.logs.bundle import Bundle, Part
from ariac_score.logs.gazebo import GazeboStateReader
from ariac_score.logs.rosbag import RosbagReader
from ariac_score.testing.bags import Recorded, write_bag
from ariac_score.trial.channels import BodyMatch, Channel, FieldMap

MAP = """\
id: cables
title: Cables
source: this test
bodies: {arm: {kind: robot}}
frames:
  - {match: "{cable}/{plug}_link", kind: plug, body: plug}
channels:
  - {topic: /tf, poses: frames}
  - {topic: "/{cable}/force", signals: {tcp_speed/arm: data}, as_consumed: true}
"""
FACTS = {"cable": "cable_1", "plug": "sfp", "time_limit_s": 180}
FOUND = {"position/plug", "tcp_speed/arm"}


@dataclass
class Configuration:
    """States facts, as the reader of a competition's configuration does."""

    stated: dict[str, Any]
    facts = ReaderFacts(role="trial_config")

    def read(self, path: Path, _wanted: Wanted) -> Trial:
        return Trial(path.name, facts=self.stated)


def recording(folder: Path) -> Path:
    messages = []
    # The second message is recorded later and stamped earlier than the first: as consumed, it comes second.
    for at, (x, speed) in enumerate([(0.0, 0.5), (0.1, 0.25), (0.2, 0.25)]):
        stamp = {"sec": 100, "nanosec": at * 100_000_000}
        for frame in ("cable_1/sfp_link", "cable_2/sfp_link"):
            transform = {
                "header": {"stamp": stamp, "frame_id": "world"},
                "child_frame_id": frame,
                "transform": {
                    "translation": {"x": x, "y": 0.0, "z": 0.0},
                    "rotation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
                },
            }
            t_ns = 100 * 10**9 + at * 100_000_000
            messages.append(Recorded("/tf", "tf2_msgs/msg/TFMessage", t_ns, {"transforms": [transform]}))
        messages.append(Recorded("/cable_1/force", "std_msgs/msg/Float64", t_ns, {"data": speed}))
    return write_bag(folder / "run.mcap", messages, storage="mcap")


def read(folder: Path, stated: dict[str, Any] | None, text: str = MAP) -> Trial:
    (folder / "cables.yaml").write_text(text, encoding="utf-8")
    # The recording stands first, and is read last.
    parts = [Part(recording(folder), "rosbag")]
    readers: dict[str, Any] = {"rosbag": RosbagReader()}
    if stated is not None:
        readers["config"] = Configuration(stated)
        parts.append(Part(folder / "trial.yaml", "config", Configuration.facts))
    return read_trial(
        Bundle("run", folder, tuple(parts)),
        readers,
        load_log_map(folder / "cables.yaml"),
        Registry(),
        quantities=["position", "tcp_speed"],
        work=False,
    )


def test_names_of_frames_and_topics_are_filled_from_the_facts_beside_the_recording(tmp_path: Path) -> None:
    trial = read(tmp_path, FACTS)

    assert {one.name for one in trial.sampled} == FOUND
    assert trial.signals["position/plug"].values[:, 0].tolist() == [0.0, 0.1, 0.2]
    assert trial.as_consumed["tcp_speed/arm"].values.tolist() == [0.5, 0.25, 0.25]
    assert dict(trial.facts) == FACTS


@pytest.mark.parametrize(
    ("stated", "place", "cause"),
    [
        (None, "$.frames[0].match", "names the fact 'cable', which no file of the trial states"),
        ({"cable": "cable_1"}, "$.frames[0].match", "names the fact 'plug', which no file"),
        ({"cable": 3, "plug": "sfp"}, "$.frames[0].match", "names the fact 'cable', which is 3 and no text"),
        ({"cable": "c", "plug": None}, "$.frames[0].match", "'plug', which is known to be absent"),
    ],
)
def test_a_fact_that_is_missing_is_named_with_log_map_and_key(
    tmp_path: Path, stated: dict[str, Any] | None, place: str, cause: str
) -> None:
    with pytest.raises(LogMapError, match=cause) as refused:
        read(tmp_path, stated)

    assert refused.value.file == str(tmp_path / "cables.yaml")
    assert refused.value.place == place
    assert refused.value.hint


def test_every_kind_of_name_is_filled_and_nothing_else() -> None:
    log_map = LogMap(
        "m",
        channels=(Channel("/{a}", signals=(FieldMap("speed/x", "m/s", ("{a}.v", "w")),)),),
        models=(BodyMatch("{a}_*", "robot", body="{a}", links=("{a}::*",)),),
        root_frame="{a}/world",
    )
    filled = log_map.filled({"a": "ur5"})

    assert filled.channels[0].topic == "/ur5"
    assert filled.channels[0].signals[0].fields == ("ur5.v", "w")
    assert (filled.models[0].match, filled.models[0].links) == ("ur5_*", ("ur5::*",))
    assert filled.models[0].body == "{a}"  # a name of ours: checks and rule sets go by it
    assert filled.root_frame == "ur5/world"
    filled.refuse_unfilled()


def test_a_fact_in_a_pattern_stands_for_its_own_characters() -> None:
    (frame,) = LogMap("m", frames=(BodyMatch("{a}_link", "robot"),)).filled({"a": "[b]*"}).frames

    assert frame.body_for("[b]*_link") is not None
    assert frame.body_for("bb_link") is None


def test_a_gazebo_log_is_not_read_for_models_of_an_unknown_name(tmp_path: Path) -> None:
    log_map = LogMap("m", models=(BodyMatch("{robot}", "robot"),))

    with pytest.raises(LogMapError, match=r"'\{robot\}' names the fact 'robot', which no file"):
        GazeboStateReader().read(tmp_path / "state.log", Wanted(log_map, frozenset({"position"})))


def test_a_map_that_names_no_fact_is_the_same_map() -> None:
    log_map = LogMap("m", channels=(Channel("/a"),))

    assert log_map.filled({"a": 3.0}) is log_map
    log_map.refuse_unfilled()


@pytest.mark.parametrize("wrong", ["{Cable}_link", "{cable_link", "cable}_link", "{}_link", "{a.b}"])
def test_braces_that_hold_no_name_of_a_fact_are_refused(tmp_path: Path, wrong: str) -> None:
    with pytest.raises(LogMapError, match="hold no name of a fact"):
        read(tmp_path, FACTS, MAP.replace("{cable}/{plug}_link", wrong))
