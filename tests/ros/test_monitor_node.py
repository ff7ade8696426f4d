"""The monitor node at work: an oracle that is killed and started again, and a real ROS 1."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("websockets", reason="the extra `live` is not installed")

HERE = Path(__file__).parent
REPOSITORY = HERE.parents[1]
sys.path.insert(0, str(HERE))
sys.path.insert(0, str(REPOSITORY / "ros/ariac_score_monitor/src"))

from ariac_score_monitor.node import Node  # noqa: E402
from ariac_score_monitor.plan import Plan  # noqa: E402
from robot_os import generate_messages, need_ros1, robot_os  # noqa: E402
from websockets.exceptions import ConnectionClosed  # noqa: E402
from websockets.sync.server import ServerConnection, serve  # noqa: E402

from ariac_score.logs.rosmonitoring import UNSEEN  # noqa: E402

pytestmark = pytest.mark.slow

TIMEOUT_S = 30.0
TOKEN = "x7Kq2mN9pL4wRt8v"  # noqa: S105  # of no server
SPEC = """
low matches {topic: '/level', data: n} with n < 100;
Main = low*;
"""
"""Levels stay below 100."""


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@contextmanager
def oracle(port: int, out: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """The command, running; killed at the end, unless it has ended."""
    command = [sys.executable, "-m", "ariac_score.cli", "oracle", "--port", str(port), "-o", str(out)]
    with subprocess.Popen([*command, *arguments], stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            assert "listening" in process.stderr.readline()
            yield process
        finally:
            process.kill()


def until(holds: Callable[[], bool], what: str) -> None:
    end_s = time.monotonic() + TIMEOUT_S
    while not holds():
        assert time.monotonic() < end_s, what
        time.sleep(0.02)


def rows(file: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []


def plan(port: int, **changed: Any) -> dict[str, Any]:
    return {
        "name": "cell",
        "oracle": f"ws://127.0.0.1:{port}",
        "topics": [{"name": "/snapshot", "type": "std_msgs/String"}],
        "without_oracle": "closed",
        "retry_s": 0.05,
        **changed,
    }


def snapshot(time_s: float, distance_m: float = 9.0) -> dict[str, Any]:
    fields = {"human_operator_speed": 0.0, "robot_speed": 0.3, "distance_robot_human_operator": distance_m}
    return {"topic": "/snapshot", **fields, "time": time_s}


def test_an_oracle_that_was_killed_is_asked_again_and_the_hole_is_recorded(tmp_path: Path) -> None:
    port, out = free_port(), tmp_path / "results"
    rules = ("--rules", "paper2020")
    node = None
    passed: list[float] = []

    def sends(first: int, last: int, distance_m: float = 9.0) -> None:
        assert node is not None
        for n in range(first, last):
            node.put(snapshot(1 + n / 100, distance_m), lambda n=n: passed.append(n))

    with oracle(port, out, *rules) as first:
        node = Node(Plan(plan(port)), str(tmp_path))
        sends(0, 50)
        until(lambda: len(passed) == 50, "verdicts before")
        os.kill(first.pid, signal.SIGKILL)
        first.wait(TIMEOUT_S)
    before = node._monitor.counts["answered"]
    sends(50, 100)  # closed: none of them passes
    until(lambda: node._monitor.counts["unseen"] == 50, "counted without an oracle")
    assert len(passed) == 50
    with oracle(port, out, *rules, "--resume") as second:
        until(lambda: node._link.is_there, "found again")
        sends(100, 150)
        until(lambda: node._monitor.counts["answered"] == before + 50, "verdicts after")
        sends(150, 151, distance_m=1.0)
        until(lambda: node.verdict == "currently_false", "a violation after")
        node.end()
        second.send_signal(signal.SIGINT)
        second.wait(TIMEOUT_S)

    log = rows(out / "cell.jsonl")
    hole = {
        "topic": UNSEEN,
        "events": 50,
        "since": 1.49,
        "time": 2.0,
        "why": "it closed the connection",
    }
    marks = [row for row in log if row["topic"] == UNSEEN]
    assert len(marks) == 1
    assert {**marks[0], "why": hole["why"]} == hole  # how the connection broke depends on the moment
    assert [row["time"] for row in log if row["topic"] != UNSEEN] == [
        1 + n / 100 for n in (*range(50), *range(100, 151))
    ]
    assert len(rows(tmp_path / "cell.jsonl")) == 151  # its own log has them all
    status = [row["status"] for row in rows(tmp_path / "cell.status.jsonl")]
    assert [one for one in status if one in ("connected", "lost", "unseen", "stopped")] == [
        "connected",
        "lost",
        "connected",
        "unseen",
        "stopped",
    ]
    (connection,) = json.loads((out / "oracle.json").read_text())["connections"]
    assert connection["interruptions"] == 1
    assert connection["events"] == len(log)
    assert connection["verdicts"]["currently_false"] == 1


@pytest.mark.parametrize("declared", ["open", "closed"])
def test_an_answer_that_comes_too_late_is_none_and_is_not_taken_for_the_next(
    tmp_path: Path, declared: str
) -> None:
    may_answer, asked = threading.Event(), []

    def answers(client: ServerConnection) -> None:
        for text in client:
            event = json.loads(text)
            asked.append((event["topic"], event["time"]))
            if event["time"] == 2.0 and event["topic"] == "/snapshot":
                assert may_answer.wait(TIMEOUT_S)
                verdict = "currently_true"  # for whoever still listens
            else:
                verdict = "currently_false" if event["time"] == 3.0 else "currently_true"
            try:
                client.send(json.dumps({**event, "verdict": verdict}))
            except ConnectionClosed:
                return

    passed: list[float] = []
    with serve(answers, "127.0.0.1", 0) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        port = server.socket.getsockname()[1]
        node = Node(Plan(plan(port, without_oracle=declared, timeout_s=0.5)), str(tmp_path))
        for time_s in (1.0, 2.0):
            node.put(snapshot(time_s), lambda time_s=time_s: passed.append(time_s))
        until(lambda: sum(node._monitor.counts[key] for key in ("answered", "unseen")) == 2, "both are over")
        may_answer.set()
        until(lambda: node._link.is_there, "connected again")
        node.put(snapshot(3.0), lambda: passed.append(3.0))
        until(lambda: node.verdict == "currently_false", "its own answer")
        node.end()

    assert passed == ([1.0, 2.0] if declared == "open" else [1.0])
    assert asked == [("/snapshot", 1.0), ("/snapshot", 2.0), (UNSEEN, 3.0), ("/snapshot", 3.0)]
    status = rows(tmp_path / "cell.status.jsonl")
    (hole,) = (row for row in status if row["status"] == "unseen")
    assert (hole["events"], hole["why"]) == (1, "no answer within 0.5 s")
    assert (status[-1]["answered"], status[-1]["unseen"]) == (2, 1)


def test_with_a_token_the_node_brings_it(tmp_path: Path) -> None:
    port, token = free_port(), tmp_path / "token"
    token.write_text(TOKEN)
    token.chmod(0o600)
    with oracle(port, tmp_path / "out", "--rules", "paper2020", "--token-file", str(token)):
        for name, given in (("without", ""), ("with", str(token))):
            node = Node(Plan(plan(port, name=name, token_file=given, timeout_s=1.0)), str(tmp_path))
            node.put(snapshot(1.0))
            node.end()

    told = {name: rows(tmp_path / f"{name}.status.jsonl") for name in ("with", "without")}
    assert told["with"][-1]["answered"] == 1
    assert told["without"][-1]["unseen"] == 1
    assert "401" in told["without"][0]["why"]


# ROS 1 -----------------------------------------------------------------------------------

SENDER = """
import rospy
from std_msgs.msg import Int32, String

rospy.init_node("sender")
level = rospy.Publisher("/level", Int32, queue_size=100)
heard = []
rospy.Subscriber("/level_checked", Int32, lambda message: print("passed", message.data, flush=True))
rospy.Subscriber("/cell/monitor_verdict", String, lambda message: print("verdict", message.data, flush=True))
rospy.sleep(1.0)
n = 0
while not rospy.is_shutdown():
    n += 1
    level.publish(Int32(data=n % 50 if not rospy.get_param("/high", False) else 150))
    rospy.sleep(0.02)
"""


@pytest.mark.parametrize("declared", ["open", "closed"])
def test_on_a_real_ros_verdicts_go_on_after_the_oracle_was_killed(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, declared: str
) -> None:
    need_ros1()
    messages = tmp_path_factory.mktemp("messages")
    generate_messages(messages)
    spec, sender, out = tmp_path / "level.rml", tmp_path / "sender.py", tmp_path / "results"
    spec.write_text(SPEC)
    sender.write_text(SENDER)
    port = free_port()
    watched = {"name": "/level", "type": "std_msgs/Int32", "to": "/level_checked"}
    # An oracle that answers late is none, and `open` lets pass: a slow machine must not look like that.
    given = plan(port, topics=[watched], without_oracle=declared, timeout_s=TIMEOUT_S)
    (tmp_path / "plan.json").write_text(json.dumps(given))
    by = ("--spec", str(spec), "--after-violation", "resume")
    with robot_os(tmp_path, messages) as ros:
        ros.environment["PYTHONPATH"] += f":{REPOSITORY / 'ros/ariac_score_monitor/src'}"
        with oracle(port, out, *by) as first:
            script = REPOSITORY / "ros/ariac_score_monitor/scripts/monitor"
            node = ros.python(script, "--plan", tmp_path / "plan.json", "--out", tmp_path)
            ros.until(node, "watching 1 topic")
            cell = ros.python(sender)
            ros.until(cell, "verdict currently_true")
            ros.until(cell, "passed 20")
            os.kill(first.pid, signal.SIGKILL)
            first.wait(TIMEOUT_S)
        ros.until(cell, "verdict unknown")
        passed_at_death = ros.said(cell).count("passed")
        time.sleep(1.0)  # fifty messages without an oracle
        passed_without = ros.said(cell).count("passed") - passed_at_death
        with oracle(port, out, *by, "--resume") as second:
            until(
                lambda: any(row["status"] == "unseen" for row in rows(tmp_path / "cell.status.jsonl")),
                "the hole is told",
            )
            passed_again = ros.said(cell).count("passed")
            until(lambda: ros.said(cell).count("passed") > passed_again + 10, "messages pass again")
            ros.run("/usr/bin/rosparam", "set", "/high", "true")
            ros.until(cell, "verdict currently_false")
            node.send_signal(signal.SIGINT)
            assert ros.wait(node, 10.0) == 0, ros.said(node)
            second.send_signal(signal.SIGINT)
            second.wait(TIMEOUT_S)

    assert "passed 150" not in ros.said(cell)
    assert passed_without > 20 if declared == "open" else passed_without <= 1
    (hole,) = (row for row in rows(out / "cell.jsonl") if row["topic"] == UNSEEN)
    assert hole["events"] > 20
    assert hole["since"] < hole["time"]
    (connection,) = json.loads((out / "oracle.json").read_text())["connections"]
    assert connection["interruptions"] == 1
    assert connection["log"] == "cell.jsonl"
