"""A cell of ROS 1 that is watched directly: Debian's master and rospy, our recorder, a walk past a robot."""

from __future__ import annotations

import json
import signal
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from ariac_score import Verdict, as_json, score_trial
from ariac_score.engine.prepared import prepare
from ariac_score.errors import LiveError, ScoreError, UsageError
from ariac_score.live.source import (
    Announced,
    Disconnected,
    LiveItem,
    LiveSource,
    Lost,
    Received,
    Reconnected,
    source_at,
)
from ariac_score.live.watch import Settings, Watch
from ariac_score.testing import source_checks

sys.path.insert(0, str(Path(__file__).parents[1] / "ros"))
sys.path.insert(0, str(Path(__file__).parent))
from live_servers import announced, heard, is_message, payloads, until
from robot_os import HERE, RobotOs, generate_messages, need_ros1, robot_os, send

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

TALKER = Path(__file__).parent / "talker"
STATE = "/ariac/competition_state"


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    need_ros1()
    folder = tmp_path_factory.mktemp("messages")
    generate_messages(folder)
    return folder


@pytest.fixture
def ros(tmp_path: Path, messages: Path) -> Iterator[RobotOs]:
    with robot_os(tmp_path, messages) as running:
        yield running


@pytest.fixture
def source(ros: RobotOs) -> Iterator[LiveSource]:
    one = source_at(f"ros1://127.0.0.1:{ros.port}")
    yield one
    one.close()


def _of(kind: type) -> object:
    return lambda item: isinstance(item, kind)


def _watching(source: LiveSource, record: Path) -> tuple[Watch, threading.Thread, list[str]]:
    """A watch on a thread of its own, and what it comes to.

    It judges here, and not in a copy of this process: one that is made while another thread starts a program
    holds the pipe on which that thread waits.
    """
    watch = Watch(
        source,
        prepare("paper2020.published"),
        record,
        settings=Settings(period_s=1e9, tail_period_s=1e9, apart=False),
    )
    said: list[str] = []

    def run() -> None:
        try:
            said.append(as_json(watch.run()))
        except ScoreError as error:
            said.append(str(error.cause))

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return watch, thread, said


def _scored(record: Path) -> str:
    try:
        return as_json(score_trial(record, "paper2020.published"))
    except ScoreError as error:
        return str(error.cause)


def test_a_latched_message_reaches_who_comes_late(ros: RobotOs, source: LiveSource) -> None:
    talker = ros.python(TALKER, "early", "latched")
    ros.until(talker, "ready")

    source.open(frozenset({"/words"}))
    items = heard(source, is_message)

    (connection,) = announced(items)
    assert (connection.type, connection.encoding, connection.definition_format, connection.publisher) == (
        "std_msgs/msg/String",
        "ros1",
        "ros1msg",
        "/early",
    )
    assert "string data" in connection.definition
    assert [item.latched for item in items if isinstance(item, Announced)] == [True]
    assert payloads(items, "/words") == [b"\4\0\0\0kept"]


def test_one_that_leaves_in_order_is_no_loss_and_one_that_is_killed_is(
    ros: RobotOs, source: LiveSource
) -> None:
    source.open(frozenset({"/words", "/points"}))
    first = ros.python(TALKER, "first", "text")
    items = heard(source, is_message, 3)
    assert ros.wait(first, 20) == 0
    assert source.next(1.5) is None

    steady = ros.python(TALKER, "steady", "steady")
    items = heard(source, is_message, 20)
    (connection,) = announced(items)
    send(steady, signal.SIGKILL)
    lost = heard(source, _of(Lost))[-1]  # type: ignore[arg-type]
    assert isinstance(lost, Lost)
    assert (lost.topic, "/steady" in lost.cause) == ("/points", True)

    ros.until(ros.python(TALKER, "steady", "steady"), "ready", 60.0)
    again = heard(source, is_message, 20)
    assert announced(again) == []  # it is the same publisher, and goes on where it was
    assert {i.message.connection for i in again if isinstance(i, Received)} == {connection}


def test_two_referees_of_one_cell_do_not_hinder_each_other(ros: RobotOs, source: LiveSource) -> None:
    """A publisher hangs up on whom it knows by a name when one more of that name comes."""
    other = source_at(f"ros1://127.0.0.1:{ros.port}")
    try:
        for one in (source, other):
            one.open(frozenset({"/points"}))
        ros.python(TALKER, "steady", "steady")
        for one in (source, other) * 3:
            items = heard(one, is_message, 40)
            assert [item for item in items if isinstance(item, Lost)] == []
            assert len(announced(items)) <= 1
    finally:
        other.close()


def test_a_topic_that_changes_its_type_is_two_connections(ros: RobotOs, source: LiveSource) -> None:
    source.open(None)
    for mode in ("text", "number"):
        assert ros.wait(ros.python(TALKER, "one", mode), 20) == 0
    items = heard(source, lambda i: isinstance(i, Received) and i.message.connection.topic == "/words", 6)
    of_words = [one.type for one in announced(items) if one.topic == "/words"]
    assert of_words == ["std_msgs/msg/String", "std_msgs/msg/Int32"]


def test_a_message_of_100_mb_arrives_and_so_does_the_next(ros: RobotOs, source: LiveSource) -> None:
    source.open(frozenset({"/words"}))
    ros.python(TALKER, "loud", "huge")
    items = heard(source, is_message, 2, 60)
    assert [len(one) for one in payloads(items, "/words")] == [100_000_004, 13]


def test_the_master_and_all_nodes_gone_and_back(tmp_path: Path, messages: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    with robot_os(tmp_path / "a", messages) as ros:
        source = source_at(f"ros1://127.0.0.1:{ros.port}")
        source.open(frozenset({"/points"}))
        ros.python(TALKER, "steady", "steady")
        heard(source, is_message, 5)
    gone: list[LiveItem] = heard(source, _of(Disconnected))  # type: ignore[arg-type]
    assert "the master" in str(gone[-1])
    again = RobotOs(tmp_path / "b", messages)
    try:
        again.environment["ROS_MASTER_URI"] = f"http://127.0.0.1:{ros.port}"
        again.until(again.start("/usr/bin/roscore", "-p", str(ros.port)), "started core service", 30.0)
        again.python(TALKER, "steady", "steady")
        items = heard(source, is_message)
    finally:
        again.end_all()
        source.close()
    (back,) = (item for item in items if isinstance(item, Reconnected))
    assert back.same is False
    assert back.until_ns > back.since_ns


def test_a_simulation_that_starts_anew_counts_as_in_its_recording(
    ros: RobotOs, source: LiveSource, tmp_path: Path
) -> None:
    record = tmp_path / "seen.mcap"
    watch, thread, said = _watching(source, record)
    assert ros.wait(ros.python(TALKER, "simulator", "reset"), 30) == 0
    until(lambda: watch.state.messages > 0, "messages")
    watch.stop()
    thread.join(30)
    assert said == [_scored(record)]


def test_it_keeps_the_contract(ros: RobotOs, subtests: pytest.Subtests) -> None:
    ros.python(TALKER, "cell", "states")
    for check in source_checks(lambda: source_at(f"ros1://127.0.0.1:{ros.port}"), limit_s=8.0):
        with subtests.test(check.name):
            check()


def test_a_walk_past_a_robot_is_watched_by_two_sources_at_once(
    ros: RobotOs, tmp_path: Path, subtests: pytest.Subtests
) -> None:
    """Directly, and through a bridge: a server of the Foxglove SDK that is fed from the master."""
    pytest.importorskip("foxglove", reason="the server of the Foxglove SDK is not installed")
    from test_foxglove import bridge  # noqa: PLC0415  # it needs that library

    plan = tmp_path / "trial.plan.json"
    word = {"topic": STATE, "field": "data"}
    topics = ["/tf", STATE, "/ariac/orders"]
    plan.write_text(
        json.dumps(
            {
                "format": "ariac-score-recording-plan/1",
                "topics": topics,
                "starts": {**word, "values": ["init"]},
                "ends": {**word, "values": ["done"]},
                "linger_s": 0.3,
            }
        )
    )
    address, over, ended = f"ros1://127.0.0.1:{ros.port}", threading.Event(), threading.Event()
    with bridge() as server:
        relay = source_at(address)
        relay.open(None)

        def pass_on() -> None:
            while not over.is_set():
                item = relay.next(0.02)
                if isinstance(item, Announced):
                    channel = server.offer(item.connection)
                    if item.connection.topic in topics:  # a bridge keeps nothing for those who come late
                        until(channel.has_sinks, f"a subscriber of {item.connection.topic}")
                elif isinstance(item, Received):
                    server.send(item.message)
                    if item.message.connection.topic == STATE and b"done" in bytes(item.message.payload):
                        ended.set()

        passing = threading.Thread(target=pass_on, daemon=True)
        passing.start()
        records = {name: tmp_path / f"{name}.mcap" for name in ("direct", "bridge")}
        watches = {
            "direct": _watching(source_at(address), records["direct"]),
            "bridge": _watching(source_at(server.address), records["bridge"]),
        }
        recorder = ros.recorder(plan, "--out", tmp_path / "trial")
        ros.until(recorder, "recording ")
        cell = ros.python(HERE / "cell")
        try:
            assert ros.wait(cell, 40.0) == 0, ros.said(cell)
            assert ros.wait(recorder, 20.0) == 0, ros.said(recorder)
            until(ended.is_set, "the end of the competition, through the bridge")
            for watch, thread, _ in watches.values():
                watch.stop()
                thread.join(30)
        finally:
            over.set()
            passing.join(10)
            relay.close()

    results = {}
    for name, (_, _, said) in watches.items():
        assert said == [_scored(records[name])], name
        results[name] = score_trial(records[name], "paper2020.published")
    assert results["direct"].score == results["bridge"].score is not None
    for result in results.values():
        found = [f for f in result.measured.findings.values() if f.check == "separation"]
        violated = [f for f in found if f.verdict is Verdict.VIOLATED]
        assert -min(f.robustness or 0.0 for f in violated) == pytest.approx(0.3, abs=0.02)


def test_what_is_no_master_is_refused_in_words() -> None:
    with socket.socket() as server:
        server.bind(("127.0.0.1", 0))
        port = server.getsockname()[1]
        with pytest.raises(LiveError, match="refused"):
            source_at(f"ros1://127.0.0.1:{port}").open(None)
    with pytest.raises(UsageError, match="names no host"):
        source_at("ros1://")
