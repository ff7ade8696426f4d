"""The oracle on a loopback port, with the client library that the generated monitors use."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Protocol

import pytest

websocket = pytest.importorskip(
    "websocket", reason="websocket-client, the monitors' library, is not installed"
)
pytest.importorskip("websockets", reason="the extra `live` is not installed")

from ariac_score import load_rule_set, score_trial  # noqa: E402  # after the libraries are there
from ariac_score.checks.registry import Registry  # noqa: E402
from ariac_score.cli import main  # noqa: E402
from ariac_score.errors import UsageError  # noqa: E402
from ariac_score.oracle.judges import RulesBench  # noqa: E402
from ariac_score.oracle.results import report_json, write_results  # noqa: E402
from ariac_score.oracle.server import Limits, Oracle, Pace  # noqa: E402
from ariac_score.results.result_file import findings_json  # noqa: E402
from ariac_score.testing import monitored_events, write_event_log  # noqa: E402
from ariac_score_ariac.testing import kitting_trial  # noqa: E402
from ariac_score_ariac.testing.recordings import recorded_messages  # noqa: E402

pytestmark = pytest.mark.slow  # servers on this machine

PAPER = load_rule_set("paper2020.published")
BENCH = RulesBench(PAPER, Registry())
TIMEOUT_S = 20.0
"""Nothing waits this long unless something is wrong."""

Event = dict[str, Any]


def snapshot(time: float, distance_m: float = 9.0) -> Event:
    fields = {"human_operator_speed": 0.0, "robot_speed": 0.0, "distance_robot_human_operator": distance_m}
    return {"topic": "snapshot", **fields, "time": time}


class Running(Protocol):
    def __call__(self, **limits: Any) -> Oracle: ...


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    """Oracles that answer in a thread of their own and stop with the test."""
    with ExitStack() as end:

        def start(**limits: Any) -> Oracle:
            oracle = Oracle(BENCH, tmp_path / "results", limits=Limits(**{"closing_s": 0.5, **limits}))
            thread = threading.Thread(target=oracle.serve, daemon=True)
            thread.start()
            end.callback(thread.join, TIMEOUT_S)
            end.callback(oracle.stop)
            return oracle

        yield start


def connect(oracle: Oracle) -> Any:
    return websocket.create_connection(oracle.url, timeout=TIMEOUT_S)


def exchange(client: Any, events: Sequence[Event]) -> list[Event]:
    """As a monitor does: one event outstanding, then its reply."""
    replies = []
    for event in events:
        client.send(json.dumps(event))
        replies.append(json.loads(client.recv()))
    return replies


# Both generations of nodes ---------------------------------------------------------------


def as_a_node_of_version_3_reads(reply: str) -> tuple[str, bool]:
    """The verdict in lower case, and whether it is negative."""
    found = json.loads(reply)
    verdict = str(found.get("verdict", found.get("ok", True))).lower()
    return verdict, verdict in ("false", "currently_false", "violation", "violated")


def as_an_older_node_reads(reply: str, pending: dict[float, Event]) -> tuple[str, bool]:
    """Found by its time, and rebuilt as a message from what is left: any other key makes it fail."""
    found = json.loads(reply)
    event = pending.pop(found["time"])
    assert found["topic"] == event["topic"]
    negative = found["verdict"] not in ("true", "currently_true", "unknown")
    if negative:
        assert found["spec"]
        del found["spec"]
    verdict = found.pop("verdict")
    assert found == event
    return verdict, negative


def test_nodes_of_both_generations_understand_every_reply(running: Running) -> None:
    events = [snapshot(t / 100, 9.0 if t % 3 else 1.0) for t in range(1, 30)]
    events.insert(4, {"topic": "chatter", "data": "hello", "time": 1782458598.685226})
    client = connect(running())
    for event in events:
        client.send(json.dumps(event))
        reply = client.recv()
        new = as_a_node_of_version_3_reads(reply)
        assert new == as_an_older_node_reads(reply, {event["time"]: event})
        if event["topic"] == "snapshot":
            assert new[1] is (event["distance_robot_human_operator"] == 1.0)
    client.close()


def test_services_are_answered_to_both_generations(running: Running) -> None:
    request = {"service": "add_two_ints", "request": {"a": 2, "b": 3}, "time": 1782458599.13}
    response = {"service": "add_two_ints", "response": {"sum": 5}, "time": 1782458599.14}
    client = connect(running())

    for event in (request, response):
        client.send(json.dumps(event))
        reply = client.recv()
        assert as_a_node_of_version_3_reads(reply) == ("unknown", False)
        found = json.loads(reply)
        # An older node makes the event of the response from the reply to the request.
        left = {name: value for name, value in found.items() if name not in ("request", "verdict")}
        assert left == {name: value for name, value in event.items() if name != "request"}
    client.close()


# What is left ----------------------------------------------------------------------------


def test_the_results_are_those_of_scoring_the_log_afterwards(running: Running, tmp_path: Path) -> None:
    messages = recorded_messages(kitting_trial())
    events = list(monitored_events(messages, origin_ns=messages[0].t_ns))
    oracle = running(events_per_s=0)
    client = connect(oracle)

    replies = exchange(client, events)
    client.close()
    oracle.stop()
    files = write_results(
        tmp_path / "results", oracle.conversations, judged_by="paper2020.published", rule_set=PAPER
    )

    assert [file.name for file in files] == [
        "connection_001.findings.json",
        "connection_001.result.json",
        "oracle.json",
    ]
    afterwards = score_trial(write_event_log(tmp_path / "own.jsonl", messages), "paper2020.published")
    assert files[0].read_text() == findings_json(afterwards.measured)
    stored = json.loads(files[1].read_text())
    assert stored["score"] == 19.761677
    assert stored["measured"]["findings"] == json.loads(files[0].read_text())
    # And what was said at once is what was found in the end.
    (violation,) = (f for f in afterwards.measured.of("separation").values() if f.span)
    negative = [r["time"] for r in replies if r["verdict"] == "currently_false" and r["topic"] == "snapshot"]
    assert negative[0] == violation.span.start_s


def test_a_log_without_orders_has_findings_and_one_without_events_says_so(
    running: Running, tmp_path: Path
) -> None:
    oracle = running()
    exchange(busy := connect(oracle), [snapshot(t / 100, 2.5) for t in range(3)])
    idle = connect(oracle)
    idle.send("no event")
    idle.recv()
    for client in (busy, idle):
        client.close()
    oracle.stop()

    files = write_results(
        tmp_path / "results", oracle.conversations, judged_by="paper2020.published", rule_set=PAPER
    )

    assert [file.name for file in files] == ["connection_001.findings.json", "oracle.json"]
    # No state of the competition was sent either, so what may be missing is open beside what was seen.
    findings = json.loads(files[0].read_text()).values()
    of_separation = [(f["verdict"], f["span"]) for f in findings if f["check"] == "separation"]
    seen = {"start_s": 0.0, "end_s": 0.02}
    assert of_separation == [("inconclusive", seen), ("violated", seen)]
    connections = json.loads(files[1].read_text())["connections"]
    assert [c["events"] for c in connections] == [3, 0]
    assert connections[1]["bad_frames"] == 1
    assert connections[1]["not_scored"]


def test_the_same_conversations_give_the_same_report(running: Running) -> None:
    oracle = running()
    client = connect(oracle)
    exchange(client, [snapshot(1.0), snapshot(1.01, 1.0)])
    client.close()
    oracle.stop()

    report = json.loads(report_json(oracle.conversations, judged_by="paper2020.published"))

    (connection,) = report["connections"]
    assert connection["verdicts"] == {"currently_true": 1, "currently_false": 1}
    assert connection["ended"] == "closed by the client"


# Several at once -------------------------------------------------------------------------


def test_several_clients_at_once_have_a_state_each(running: Running) -> None:
    oracle = running()
    clients = [connect(oracle) for _ in range(5)]
    seen: dict[int, list[str]] = {}

    def talk(number: int) -> None:
        far = 9.0 if number % 2 else 1.0
        replies = exchange(clients[number], [snapshot(t / 100, far) for t in range(1, 101)])
        assert [reply["time"] for reply in replies] == [t / 100 for t in range(1, 101)]
        seen[number] = [reply["verdict"] for reply in replies]

    threads = [threading.Thread(target=talk, args=(number,)) for number in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(TIMEOUT_S)
    for client in clients:
        client.close()

    assert seen == {n: ["currently_true" if n % 2 else "currently_false"] * 100 for n in range(5)}


def test_a_client_beyond_the_limit_is_refused_at_the_handshake(running: Running) -> None:
    oracle = running(connections=1)
    first = connect(oracle)
    exchange(first, [snapshot(1.0)])

    with pytest.raises(websocket.WebSocketBadStatusException, match="503"):
        connect(oracle)

    assert exchange(first, [snapshot(1.01)])[0]["verdict"] == "currently_true"
    assert oracle.refused == 1
    first.close()


def test_a_client_whose_log_cannot_be_made_is_refused(running: Running) -> None:
    oracle = running()
    (oracle._folder / "connection_001.jsonl").mkdir()

    with pytest.raises(websocket.WebSocketBadStatusException, match="503"):
        connect(oracle)

    assert oracle.refused == 1
    assert oracle.conversations == []


# Bad clients -----------------------------------------------------------------------------


def test_a_client_stays_in_step_through_bad_frames(running: Running) -> None:
    client = connect(running())
    for frame in ("hello", "[]", "{", "\u00e9"):
        client.send(frame)
        assert client.recv() == '{"verdict": "unknown"}'
        assert exchange(client, [event := {"topic": "x", "n": frame}]) == [{**event, "verdict": "unknown"}]
    client.close()


def test_binary_frames_fragments_and_broken_text_are_answered(running: Running) -> None:
    client = connect(running())
    event = snapshot(1.0)
    client.send_binary(json.dumps(event).encode())
    assert json.loads(client.recv()) == {**event, "verdict": "currently_true"}

    text = json.dumps(snapshot(1.01))
    abnf = websocket.ABNF
    client.send_frame(abnf(0, 0, 0, 0, abnf.OPCODE_TEXT, 1, text[:10].encode()))
    client.ping("still there?")
    client.send_frame(abnf(1, 0, 0, 0, abnf.OPCODE_CONT, 1, text[10:].encode()))
    assert json.loads(client.recv())["time"] == 1.01

    client.send_frame(abnf(1, 0, 0, 0, abnf.OPCODE_TEXT, 1, b"\xff{}"))
    assert client.recv() == '{"verdict": "unknown"}'
    client.close()


def test_a_client_that_floods_gets_every_reply_in_order(running: Running) -> None:
    oracle = running(events_per_s=0)
    client = connect(oracle)
    times = [t / 100 for t in range(1, 801)]

    for time in times:
        client.send(json.dumps(snapshot(time)))

    assert [json.loads(client.recv())["time"] for _ in times] == times
    client.close()


def test_a_frame_beyond_the_limit_ends_its_connection_and_no_other(running: Running) -> None:
    oracle = running(frame_bytes=1000)
    good, bad = connect(oracle), connect(oracle)
    exchange(good, [snapshot(1.0)])

    bad.send(json.dumps(snapshot(1.0) | {"x": "x" * 1000}))
    opcode, _ = bad.recv_data()

    assert opcode == websocket.ABNF.OPCODE_CLOSE
    assert exchange(good, [snapshot(1.01)])[0]["verdict"] == "currently_true"
    bad.shutdown()
    good.close()
    oracle.stop()
    assert [c.ended for c in oracle.conversations] == [
        "closed by the client",
        "a frame was longer than 1,000 bytes",
    ]


def test_a_client_that_goes_half_way_through_a_frame_leaves_its_events(running: Running) -> None:
    oracle = running()
    client = connect(oracle)
    exchange(client, [snapshot(1.0), snapshot(1.01)])

    client.sock.sendall(b"\x81\xfe\x10\x00half")  # a text frame of 4096 bytes, of which these are the first
    client.sock.shutdown(socket.SHUT_RDWR)
    client.sock.close()
    other = connect(oracle)
    assert exchange(other, [snapshot(1.0)])[0]["verdict"] == "currently_true"
    other.close()
    oracle.stop()

    assert [c.ended for c in oracle.conversations] == ["lost", "closed by the client"]
    assert len(oracle.conversations[0].log.read_text().splitlines()) == 2


def test_a_client_that_stalls_within_a_frame_disturbs_nobody_and_can_go_on(running: Running) -> None:
    oracle = running()
    stalled, other = connect(oracle), connect(oracle)
    frame = websocket.ABNF.create_frame(json.dumps(snapshot(1.0)), websocket.ABNF.OPCODE_TEXT).format()
    stalled.sock.sendall(frame[:20])

    assert exchange(other, [snapshot(1.0), snapshot(1.01)])[-1]["verdict"] == "currently_true"
    stalled.sock.sendall(frame[20:])
    assert json.loads(stalled.recv())["time"] == 1.0
    for client in (stalled, other):
        client.close()


def test_one_who_stalls_for_ever_within_a_frame_ends_with_the_oracle(running: Running) -> None:
    oracle = running(closing_s=0.2)
    client = connect(oracle)
    exchange(client, [snapshot(1.0)])
    client.sock.sendall(b"\x81\xfe\x10\x00half")

    oracle.stop()

    (conversation,) = oracle.conversations
    assert conversation.ended == "stopped by the oracle"
    assert len(conversation.log.read_text().splitlines()) == 1
    client.shutdown()


def test_one_who_sends_too_fast_is_answered_more_slowly_and_in_order(running: Running) -> None:
    client = connect(running(events_per_s=400.0))
    times = [t / 100 for t in range(1, 451)]  # more than a burst of one second

    for time in times:
        client.send(json.dumps(snapshot(time)))

    assert [json.loads(client.recv())["time"] for _ in times] == times
    client.close()


def test_what_is_no_frame_ends_its_connection_and_is_said(running: Running) -> None:
    oracle = running()
    client = connect(oracle)
    exchange(client, [snapshot(1.0)])

    client.sock.sendall(b"\x81\x02{}")  # a client has to mask what it sends

    assert client.recv_data()[0] == websocket.ABNF.OPCODE_CLOSE
    client.shutdown()
    oracle.stop()
    assert oracle.conversations[0].ended.startswith("the client broke the protocol")


def test_pings_are_answered_between_events(running: Running) -> None:
    client = connect(running())
    client.ping("there?")

    assert client.recv_data(control_frame=True) == (websocket.ABNF.OPCODE_PONG, b"there?")
    assert exchange(client, [snapshot(1.0)])[0]["verdict"] == "currently_true"
    client.close()


def test_so_many_who_only_connect_do_not_keep_a_monitor_out_for_ever(running: Running) -> None:
    oracle = running(connections=1)
    host, port = oracle.url.removeprefix("ws://").split(":")
    with ExitStack() as strangers:
        for _ in range(40):
            strangers.enter_context(socket.create_connection((host, int(port)), timeout=TIMEOUT_S))
    client = next(filter(None, (_tried(oracle) for _ in range(5_000))))

    assert exchange(client, [snapshot(1.0)])[0]["verdict"] == "currently_true"
    client.close()


def _tried(oracle: Oracle) -> Any:
    """A client, unless there are too many just now."""
    try:
        return connect(oracle)
    except (OSError, websocket.WebSocketException):
        return None


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\n", b"\x00" * 2000])
def test_one_who_is_no_client_disturbs_nobody(running: Running, said: bytes) -> None:
    oracle = running()
    address = oracle.url.removeprefix("ws://").split(":")
    with socket.create_connection((address[0], int(address[1])), timeout=TIMEOUT_S) as stranger:
        stranger.sendall(said)
        client = connect(oracle)
        assert exchange(client, [snapshot(1.0)])[0]["verdict"] == "currently_true"
        client.close()


def test_a_client_that_says_nothing_any_more_does_not_keep_the_oracle_from_ending(running: Running) -> None:
    oracle = running(closing_s=0.2)
    stalled = connect(oracle)
    exchange(stalled, [snapshot(1.0)])

    oracle.stop()

    assert [c.ended for c in oracle.conversations] == ["stopped by the oracle"]
    assert stalled.recv_data()[0] == websocket.ABNF.OPCODE_CLOSE
    stalled.shutdown()


def test_a_client_that_sends_and_never_reads_does_not_keep_it_either(running: Running) -> None:
    oracle = running(closing_s=0.2)
    client = connect(oracle)
    exchange(client, [snapshot(1.0)])
    frame = json.dumps({"topic": "x", "data": "x" * 100_000})

    def flood() -> None:
        try:
            while True:
                client.send(frame)
        except (OSError, websocket.WebSocketException):
            pass

    flooding = threading.Thread(target=flood, daemon=True)
    flooding.start()
    oracle.stop()
    flooding.join(TIMEOUT_S)

    client.shutdown()

    assert not flooding.is_alive()
    (conversation,) = oracle.conversations
    assert conversation.ended == "stopped by the oracle"
    assert all(json.loads(line) for line in conversation.log.read_text().splitlines())


def test_who_sends_too_much_is_made_to_wait() -> None:
    now, waits = [0.0], list[float]()

    def wait(seconds: float) -> None:
        waits.append(seconds)
        now[0] += seconds

    pace = Pace(10.0, wait, lambda: now[0])
    for _ in range(10):
        pace.step()
    assert waits == []
    for _ in range(5):
        pace.step()
    assert len(waits) == 5
    assert now[0] == pytest.approx(0.5)  # five events beyond the burst, a tenth of a second each
    now[0] += 100.0
    before = len(waits)
    for _ in range(10):
        pace.step()
    assert len(waits) == before  # rested


# Beginning -------------------------------------------------------------------------------


def test_it_listens_on_this_machine_only_unless_told_otherwise(running: Running) -> None:
    assert running().url.startswith("ws://127.0.0.1:")


def test_a_port_that_is_taken_is_said_to_be(running: Running, tmp_path: Path) -> None:
    port = int(running().url.rpartition(":")[2])

    with pytest.raises(UsageError, match=f"cannot listen on 127.0.0.1:{port}"):
        Oracle(BENCH, tmp_path / "other", port=port)
    with pytest.raises(UsageError, match="cannot listen"):
        Oracle(BENCH, tmp_path / "other", port=99_999)


def test_results_are_never_written_over(tmp_path: Path) -> None:
    (tmp_path / "results.json").write_text("{}")

    with pytest.raises(UsageError, match="it is not empty"):
        Oracle(BENCH, tmp_path)
    with pytest.raises(UsageError, match="cannot be used"):
        Oracle(BENCH, tmp_path / "results.json")


def test_without_its_library_it_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "websockets.server", None)

    with pytest.raises(UsageError, match="not installed") as refused:
        Oracle(BENCH, tmp_path / "results")
    assert "ariac-score[live]" in refused.value.hint


@pytest.mark.parametrize(
    "wrong", [{"frame_bytes": 0}, {"frame_bytes": 10**9}, {"connections": 0}, {"closing_s": 0}]
)
def test_limits_that_are_none_are_refused(wrong: dict[str, int]) -> None:
    with pytest.raises(ValueError, match=r"bytes|needed"):
        Limits(**wrong)


# The command -----------------------------------------------------------------------------


@pytest.mark.parametrize("goodbye", [signal.SIGINT, signal.SIGTERM])
def test_the_command_serves_until_interrupted_and_writes_its_results(tmp_path: Path, goodbye: int) -> None:
    out = tmp_path / "out"
    command = [
        sys.executable,
        "-m",
        "ariac_score.cli",
        "oracle",
        "--rules",
        "paper2020.published",
        "--port",
        "0",
    ]
    with subprocess.Popen(
        [*command, "-o", str(out)], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr is not None
        url = process.stderr.readline().removeprefix("listening on ").strip()
        client = websocket.create_connection(url, timeout=TIMEOUT_S)
        assert exchange(client, [snapshot(1.0, 1.0)])[0]["verdict"] == "currently_false"
        os.kill(process.pid, goodbye)
        printed, _ = process.communicate(timeout=TIMEOUT_S)
        client.shutdown()

    assert process.returncode == 0
    assert printed.split() == [str(out / name) for name in ("connection_001.findings.json", "oracle.json")]
    assert json.loads((out / "oracle.json").read_text())["connections"][0]["ended"] == "stopped by the oracle"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--rules", "papre2020"], "did you mean"),
        (["--spec", "nowhere.rml"], "rml"),
        (["--rules", "paper2020.published", "--max-connections", "0"], "connection"),
        (["--rules", "paper2020.published", "--port", "-1"], "cannot listen"),
    ],
)
def test_the_command_refuses_in_words(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert main(["oracle", *arguments, "-o", str(tmp_path / "out")]) == 4

    out, err = capsys.readouterr()
    assert out == ""
    assert words in err


def test_by_rules_or_by_a_specification_one_of_them(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments in (["oracle"], ["oracle", "--rules", "a", "--spec", "b"]):
        with pytest.raises(SystemExit) as left:
            main(arguments)
        assert left.value.code == 4
