"""The recorder's node of ROS 2 on a stand-in of rclpy: its code is run, real ROS 2 is not.

What it published is recorded by the stand-in as `ros2 bag` would, and held to the same: by our reader.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from ariac_score import score_trial
from ariac_score.results.signing import make_keys

pytestmark = pytest.mark.slow

STAND_IN = Path(__file__).parent / "ros2_stand_in.py"
STATE = "/ariac/competition_state"


def run(folder: Path, scenario: str) -> subprocess.CompletedProcess[str]:
    """Run the node beside a scenario of the stand-in."""
    state = {"topic": STATE, "field": "data"}
    submission = {"shipment_type": "{order_id}", "agv": "agv1", "contents_unknown": True}
    forward = {
        "offered": "/scoring/submit",
        "service": "/submit",
        "accepted": "success",
        "submission": submission,
    }
    plan = {
        "format": "ariac-score-recording-plan/1",
        "topics": [STATE, "/once", "/lossy", "/unknown"],
        "trial": "final_3",
        "starts": {**state, "values": ["init"]},
        "ends": {**state, "values": ["done"]},
        "watches": [{**state, "text": "^go$", "event": {"kind": "running"}}],
        "watching": ["arm_collision"],
        "forwards": [forward],
        "linger_s": 0.3,
    }
    (folder / "plan.json").write_text(json.dumps(plan))
    command = [sys.executable, str(STAND_IN), str(folder), scenario]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)


def manifest(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / "trial.manifest.json").read_text())
    return found


def test_the_node_attests_what_it_heard_and_our_reader_finds_all_of_it(tmp_path: Path) -> None:
    minisign = pytest.importorskip("minisign")
    _, public = make_keys(tmp_path / "organiser")

    done = run(tmp_path, "whole")

    assert done.returncode == 0, done.stderr
    assert "closed: /ariac/competition_state: done" in done.stdout
    stated = manifest(tmp_path)
    counts = {name: about["count"] for name, about in stated["topics"].items()}
    # Each is heard as its publisher offers it: what was sent once before, and what may be lost.
    assert (counts[STATE], counts["/once"], counts["/lossy"]) == (3, 1, 2)
    assert (counts["/unknown"], counts["/ariac_score/submissions"]) == (0, 1)
    assert [note for note in stated["notes"] if "/unknown: missing_msgs/msg/Odd is not installed" in note]
    string = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert stated["topics"][STATE]["definitions"] == [string]
    signature = minisign.Signature.from_bytes((tmp_path / "trial.manifest.json.minisig").read_bytes())
    minisign.PublicKey.from_bytes(public.read_bytes()).verify(
        (tmp_path / "trial.manifest.json").read_bytes(), signature
    )
    rules = tmp_path / "rules.yaml"
    rules.write_text(
        "id: attested\ntitle: Attested\nsource: this test\nlog_map: ariac2020\nlevels: [trial]\nscore: 1\n"
        "monitors: {clean: {use: ariac.no_event}}\ncompleteness: attested\n"
        f"authority: {{recorder_keys: ['{public.read_text().splitlines()[1]}']}}\n"
    )
    (completeness,) = (
        s for s in score_trial(tmp_path / "trial.mcap", rules).measured.statements if s.fact == "completeness"
    )
    assert completeness.by == "recorder"
    assert completeness.detail.endswith("recorded as trial 'final_3'")


def test_a_second_recorder_does_not_begin(tmp_path: Path) -> None:
    done = run(tmp_path, "other")

    assert done.returncode == 5
    assert f"another recorder is running here: {'ab' * 16}" in done.stderr
    assert not (tmp_path / "trial.manifest.json").exists()


def test_a_signal_closes_the_manifest(tmp_path: Path) -> None:
    done = run(tmp_path, "ended")

    assert done.returncode == 0, done.stderr
    assert manifest(tmp_path)["reason"] == "signal 15"
    assert manifest(tmp_path)["closed"] is True
