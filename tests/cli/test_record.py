"""`record`: the commands that record a trial, what they leave out, and the plan of the recorder."""

from __future__ import annotations

import json
import os
import re
import sys
from pathlib import Path

import pytest

from ariac_score.cli import main
from ariac_score.documents.yaml import load_yaml
from ariac_score.logs.logmap import load_log_map
from ariac_score.logs.recording import OWN_TOPICS, load_recording, recording_names
from ariac_score.scoring.ruleset import rule_set_names

sys.path.insert(0, str(Path(__file__).parents[2] / "ros/ariac_score_recorder/src"))
from ariac_score_recorder.plan import Plan

Capture = pytest.CaptureFixture[str]


def said(capsys: Capture, *words: str, code: int = 0) -> str:
    assert main(["record", *words]) == code
    out, error = capsys.readouterr()
    return out if code == 0 else error


def bag_line(text: str) -> list[str]:
    return next(line for line in text.splitlines() if re.match(r"rosbag|ros2 bag", line)).split()


def test_contents_are_left_out_in_competition_mode_and_the_reason_is_said(
    subtests: pytest.Subtests, capsys: Capture
) -> None:
    """Recording.md, section 0: a foreign subscriber switches these off for good."""
    for rules, topics in (
        ("ariac2017.as_coded", ["/ariac/trays"]),
        ("ariac2018.as_coded", ["/ariac/shipping_boxes"]),
        ("ariac2019.as_coded", ["/ariac/trays"]),
        ("paper2020.published", ["/ariac/trays"]),
        ("ariac2021.finals_as_coded", ["/ariac/trays", "/ariac/briefcases"]),
        ("ariac2022.as_coded", ["/ariac/trays", "/ariac/briefcases"]),
    ):
        with subtests.test(rules):
            text = said(capsys, "--rules", rules)
            for topic in topics:
                assert topic not in bag_line(text)
                assert f"# left out: {topic}: in competition mode a subscriber other than /gazebo" in text
            assert "/gazebo/model_states" not in bag_line(text)  # not published then
            line = bag_line(said(capsys, "--rules", rules, "--mode", "development"))
            assert {*topics, "/gazebo/model_states"} <= set(line)


def test_what_decides_a_score_is_in_every_command(subtests: pytest.Subtests, capsys: Capture) -> None:
    state = {"ariac2025": "/competition_status", "aic2026": "/scoring/insertion_event"}
    for name in recording_names():
        with subtests.test(name):
            recording = load_recording(None, [name])
            wanted = {"/clock", "/rosout", "/tf", state.get(name, "/ariac/competition_state")}
            assert wanted <= set(recording.topics)
            assert not set(recording.topics) & set(recording.left_out)
            # The recorder takes the plan as it is.
            plan = Plan(recording.plan(forward=True))
            assert bool(plan.forwards) == (name not in ("ariac2017", "ariac2018", "aic2026"))
            assert set(plan.left_out) == set(recording.left_out)
    line = bag_line(said(capsys, "--rules", "paper2020.published"))
    assert {"/snapshot", "/tf_static", "/ariac/orders", *OWN_TOPICS} <= set(line)


def test_each_release_of_ros_gets_options_that_it_has(capsys: Capture) -> None:
    """Recording.md, sections 0.12 and 6.2."""
    galactic = bag_line(said(capsys, "--rules", "ariac2023.as_coded"))
    iron = bag_line(said(capsys, "--rules", "ariac2024.release_3"))
    jazzy = bag_line(said(capsys, "--rules", "ariac2025.as_coded"))
    assert not {"--use-sim-time", "-s", "--topics", "--services"} & set(galactic)
    assert {"--use-sim-time", "mcap", "zstd_fast", "--include-hidden-topics"} <= set(iron) & set(jazzy)
    assert iron[-1] == "/ariac/submit_order/_service_event"  # Iron has no --services
    assert "--topics" not in iron
    assert len(set(iron)) == len(iron)
    assert jazzy[jazzy.index("--services") + 1 :][0] == "/submit_kitting_order"
    assert jazzy.index("--topics") < jazzy.index("/competition_status") < jazzy.index("--services")


def test_what_is_recorded_of_services_is_read(subtests: pytest.Subtests) -> None:
    """Events of a service, and what the forwarder makes of its calls, are channels of the log map."""
    for name in ("ariac2024", "ariac2025"):
        with subtests.test(name):
            recording = load_recording(None, [name])
            read = {channel.topic for channel in load_log_map(name).channels}
            assert {f"{service}/_service_event" for service in recording.services} <= read
            assert "/ariac_score/submissions" in read
            for forward in recording.recorder["forwards"]:
                assert forward["accepted"] == "success"
                assert forward["submission"]["shipment_type"] in ("{order_id}", "kit", "module", "{id}")


def test_the_plan_is_written_beside_the_recording(tmp_path: Path, capsys: Capture) -> None:
    output = tmp_path / "final_3"
    text = said(
        capsys,
        "--rules",
        "paper2020.published",
        "-o",
        str(output),
        "--team",
        "a",
        "--trial",
        "3",
        "--forward",
    )
    assert f"rosrun ariac_score_recorder recorder --plan {output}.plan.json --out {output}" in text
    plan = json.loads(Path(f"{output}.plan.json").read_text())
    assert (plan["team"], plan["trial"]) == ("a", "3")
    assert [f["service"] for f in plan["forwards"]] == ["/ariac/agv1", "/ariac/agv2"]
    assert list(plan["left_out"]) == ["/ariac/trays"]
    assert "/clock" not in plan["topics"]


def test_topics_that_are_sent_once_are_asked_for_as_their_publishers_offer_them(
    tmp_path: Path, capsys: Capture
) -> None:
    """Recording.md, section 6.2: who subscribes first asks for less, and misses what was sent."""
    said(capsys, "--rules", "ariac2024.release_3", "-o", str(tmp_path / "trial"))
    asked = load_yaml(tmp_path / "trial.qos.yaml").data
    latched = {"/ariac/trial_config", "/ariac/environment_ready", "/tf_static", "/rosout"}
    assert asked.keys() == {*latched, "/ariac_score/manifest"}
    assert {profile["durability"] for profile in asked.values()} == {"transient_local"}
    assert {profile["reliability"] for profile in asked.values()} == {"reliable"}


def test_every_shipped_rule_set_says_what_to_record_or_that_a_log_map_is_missing(
    subtests: pytest.Subtests, capsys: Capture
) -> None:
    """Of rules with several states of one competition, one of each is enough: they share a log map."""
    shared = {name.partition(".")[0]: name for name in rule_set_names() if name != "safety"}
    for name in shared.values():
        with subtests.test(name):
            assert len(bag_line(said(capsys, "--rules", name))) > 10
    assert "names no topic" in said(capsys, "--rules", "safety", "--ros", "1", code=4)


def test_a_log_map_of_ones_own_adds_its_topics(tmp_path: Path, capsys: Capture) -> None:
    log_map = tmp_path / "ours.yaml"
    log_map.write_text(
        "id: ours\ntitle: ours\nsource: us\nextends: ariac2020\nchannels:\n"
        "  - {topic: /lab/person, poses: frames}\n"
    )
    line = bag_line(said(capsys, "--rules", "paper2020.published", "--log-map", str(log_map)))
    assert {"/lab/person", "/snapshot"} <= set(line)


def test_a_simulator_of_the_one_ros_is_not_recorded_with_the_other(capsys: Capture) -> None:
    assert "is of ROS 2 (iron)" in said(capsys, "--rules", "ariac2024.safe", "--ros", "1", code=4)
    assert "is of ROS 1" in said(capsys, "--rules", "paper2020", "--ros", "jazzy", code=4)
    assert "rosbag record" in said(capsys, "--rules", "paper2020", "--ros", "1")


def test_what_cannot_be_recorded_is_refused(tmp_path: Path, capsys: Capture) -> None:
    refused = said(capsys, "--rules", "paper2020.published", "--mode", "dvelopment", code=4)
    assert "did you mean 'development'" in refused
    log_map = tmp_path / "ours.yaml"
    log_map.write_text("id: ours\ntitle: t\nsource: s\nchannels: [{topic: /a, poses: frames}]\n")
    rules = tmp_path / "rules.yaml"
    rules.write_text(
        f"id: ours\ntitle: t\nsource: s\nlog_map: {log_map}\nrules: {{}}\nmonitors: {{}}\nscore: 1\n"
    )
    assert "say --ros 1 or the release of ROS 2" in said(capsys, "--rules", str(rules), code=4)
    assert bag_line(said(capsys, "--rules", str(rules), "--ros", "humble"))[:3] == ["ros2", "bag", "record"]
    missing = str(tmp_path / "no_folder" / "trial")
    assert "cannot be written" in said(capsys, "--rules", "paper2020.published", "-o", missing, code=4)


def test_running_ends_the_bag_after_the_recorder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: Capture
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    bag, recorder = tmp_path / "rosbag", tmp_path / "rosrun"
    bag.write_text(
        "#!/bin/sh\ntrap 'echo closed >> $0.said; exit 0' INT\ntouch $0.up\nwhile :; do sleep 0.05; done\n"
    )
    recorder.write_text(
        f"#!/bin/sh\ntest -e {tmp_path}/trial.plan.json || exit 9\n"
        f"while [ ! -e {bag}.up ]; do :; done\necho ended >> {bag}.said\n"
    )
    for file in (bag, recorder):
        file.chmod(0o755)
    assert main(["record", "--rules", "paper2020.published", "-o", str(tmp_path / "trial"), "--run"]) == 0
    assert Path(f"{bag}.said").read_text().split() == ["ended", "closed"]
    # The program that starts it may end before the one that writes the bag, as `rosbag record` does.
    writes = tmp_path / "writes"
    writes.write_text(
        f"#!/bin/sh\ntrap 'sleep 0.3; echo late >> {bag}.said; exit 0' INT\n"
        f"touch {bag}.up\nwhile :; do sleep 0.05; done\n"
    )
    writes.chmod(0o755)
    Path(f"{bag}.up").unlink()
    # A shell would have what it starts in the background ignore the signal.
    bag.write_text(
        f"#!{sys.executable}\nimport subprocess, sys\nchild = subprocess.Popen(['{writes}'])\n"
        "try:\n    child.wait()\nexcept KeyboardInterrupt:\n    sys.exit(1)\n"
    )
    assert main(["record", "--rules", "paper2020", "-o", str(tmp_path / "trial"), "--run"]) == 0
    assert Path(f"{bag}.said").read_text().split() == ["ended", "closed", "ended", "late"]
    # A recorder that refuses, and a bag that ends too early, are said.
    recorder.write_text("#!/bin/sh\nexit 5\n")
    assert main(["record", "--rules", "paper2020.published", "-o", str(tmp_path / "trial"), "--run"]) == 4
    assert "the recorder ended with code 5" in capfd.readouterr().err
    # Not before its trap is set: a shell that is just starting may lose the signal.
    bag.write_text(f"#!/bin/sh\nwhile [ ! -e {recorder}.up ]; do sleep 0.01; done\nexit 1\n")
    recorder.write_text("#!/bin/sh\ntrap 'exit 0' INT\ntouch $0.up\nwhile :; do sleep 0.05; done\n")
    assert main(["record", "--rules", "paper2020.published", "-o", str(tmp_path / "trial"), "--run"]) == 4
    assert "the bag ended with code 1" in capfd.readouterr().err
