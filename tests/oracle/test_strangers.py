"""Those whom nobody invited: pages of strangers, crowds, clients that only wait, and broken ones."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import tracemalloc
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any, Protocol

import pytest

websocket = pytest.importorskip(
    "websocket", reason="websocket-client, the monitors' library, is not installed"
)
pytest.importorskip("websockets", reason="the extra `live` is not installed")

from ariac_score import load_rule_set  # noqa: E402  # after the libraries are there
from ariac_score.checks.registry import Registry  # noqa: E402
from ariac_score.cli import main  # noqa: E402
from ariac_score.errors import UsageError  # noqa: E402
from ariac_score.oracle.judges import RulesBench  # noqa: E402
from ariac_score.oracle.server import Limits, Oracle  # noqa: E402

pytestmark = pytest.mark.slow  # servers on this machine

BENCH = RulesBench(load_rule_set("paper2020"), Registry())
TIMEOUT_S = 20.0
"""Nothing waits this long unless something is wrong."""
TOKEN = "x7Kq2mN9pL4wRt8v"  # noqa: S105  # of no server


class Running(Protocol):
    def __call__(self, *, token: str = "", **limits: Any) -> Oracle: ...


@pytest.fixture
def running(tmp_path: Path) -> Iterator[Running]:
    """Oracles that answer in a thread of their own and stop with the test."""
    with ExitStack() as end:

        def start(*, token: str = "", **limits: Any) -> Oracle:
            oracle = Oracle(BENCH, tmp_path / "results", limits=Limits(**limits), token=token)
            thread = threading.Thread(target=oracle.serve, daemon=True)
            thread.start()
            end.callback(thread.join, TIMEOUT_S)
            end.callback(oracle.stop)
            return oracle

        yield start


def connect(oracle: Oracle, path: str = "", **options: Any) -> Any:
    return websocket.create_connection(oracle.url + path, timeout=TIMEOUT_S, **options)


def address(oracle: Oracle) -> tuple[str, int]:
    host, _, port = oracle.url.removeprefix("ws://").rpartition(":")
    return host, int(port)


def is_answered(client: Any, at_s: float = 1.0) -> bool:
    snapshot = {"human_operator_speed": 0.0, "robot_speed": 0.0, "distance_robot_human_operator": 9.0}
    client.send(json.dumps({"topic": "snapshot", **snapshot, "time": at_s}))
    return bool(json.loads(client.recv())["verdict"] == "currently_true")


# Pages of strangers ----------------------------------------------------------------------


def test_a_page_of_somebody_else_is_refused_and_a_monitor_is_not(running: Running) -> None:
    oracle = running()

    with pytest.raises(websocket.WebSocketBadStatusException, match="403"):
        connect(oracle, origin="https://evil.example")
    with pytest.raises(websocket.WebSocketBadStatusException, match="403"):
        connect(oracle, origin="null")

    for own in (connect(oracle), connect(oracle, suppress_origin=True)):
        assert is_answered(own)
        own.close()
    assert oracle.refusals["a page or a name of somebody else"] == 2


def test_a_name_that_was_made_to_lead_here_is_refused(running: Running) -> None:
    oracle = running()
    _, port = address(oracle)

    with pytest.raises(websocket.WebSocketBadStatusException, match="403"):
        connect(oracle, host=f"evil.example:{port}", origin=f"http://evil.example:{port}")
    own = connect(oracle, host=f"localhost:{port}", origin=f"http://localhost:{port}")
    assert is_answered(own)
    own.close()


def test_with_a_token_nobody_is_answered_without_it(running: Running) -> None:
    oracle = running(token=TOKEN)

    with pytest.raises(websocket.WebSocketBadStatusException, match="401"):
        connect(oracle)
    with pytest.raises(websocket.WebSocketBadStatusException, match="401"):
        connect(oracle, header=[f"Authorization: Bearer {TOKEN[:-1]}"])

    for own in (
        connect(oracle, header=[f"Authorization: Bearer {TOKEN}"]),
        connect(oracle, f"/?token={TOKEN}"),
    ):
        assert is_answered(own)
        own.close()


def test_beyond_this_machine_the_command_wants_a_token(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    everywhere = "0.0.0.0"  # noqa: S104  # what is refused
    command = ["oracle", "--rules", "paper2020", "--host", everywhere, "--port", "0"]

    assert main([*command, "-o", str(tmp_path / "out")]) == 4
    said = capsys.readouterr().err
    assert "can be reached from other machines, and there is no token" in said
    assert "--token-file" in said


@pytest.mark.parametrize("path", ["/../../etc/passwd", "/a/b", "/connection_001", "/%2e%2e", "/x.part0001"])
def test_a_path_that_is_no_name_of_a_connection_is_refused(
    running: Running, tmp_path: Path, path: str
) -> None:
    oracle = running()

    with pytest.raises(websocket.WebSocketBadStatusException, match="404"):
        connect(oracle, path)
    assert [*(tmp_path / "results").iterdir()] == []


# Crowds ----------------------------------------------------------------------------------


def test_sixteen_who_only_connect_keep_nobody_out(running: Running) -> None:
    oracle = running(connections=16, silent_s=0.5)
    with ExitStack() as end:
        monitor = connect(oracle)
        end.callback(monitor.shutdown)
        assert is_answered(monitor)
        for _ in range(16):  # one more than there are places
            end.callback(_until_let_in(oracle).shutdown)
        honest = [_until_let_in(oracle) for _ in range(5)]
        for client in honest:
            end.callback(client.shutdown)

        assert all(is_answered(client) for client in honest)
        assert is_answered(monitor, 1.01)  # whoever sent something keeps its place
        assert oracle.refusals["it was silent, and others needed its place"] == 6


def test_sixteen_who_send_nonsense_keep_nobody_out_either(running: Running) -> None:
    oracle = running(connections=16, silent_s=0.5)
    with ExitStack() as end:
        for nonsense in ("{}", "[]", "hello", '{"topic": 1}') * 4:
            client = connect(oracle)
            end.callback(client.shutdown)
            client.send(nonsense)
            assert json.loads(client.recv())["verdict"] == "unknown"
        honest = _until_let_in(oracle)
        end.callback(honest.shutdown)

        assert is_answered(honest)


def _until_let_in(oracle: Oracle) -> Any:
    """A client, tried again as our node does while there is no place."""
    until_s = time.monotonic() + TIMEOUT_S
    while True:
        try:
            return connect(oracle)
        except websocket.WebSocketBadStatusException:
            assert time.monotonic() < until_s
            time.sleep(0.05)


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"])
@pytest.mark.parametrize("many", [36, 400])
def test_so_many_half_open_sockets_leave_every_honest_handshake(
    running: Running, many: int, said: bytes
) -> None:
    oracle = running()
    with _half_open(address(oracle), many, said):
        answered = 0
        for _ in range(55):
            client = connect(oracle)
            answered += is_answered(client)
            client.close()

    assert answered == 55


@contextmanager
def _half_open(to: tuple[str, int], many: int, said: bytes) -> Iterator[None]:
    """Holds so many sockets that begin no conversation, and opens each again as soon as it is closed."""
    over = threading.Event()

    def hold() -> None:
        held: list[socket.socket] = []
        while not over.is_set():
            while len(held) < many and not over.is_set():
                held.append(socket.create_connection(to, timeout=TIMEOUT_S))
                held[-1].sendall(said)
                held[-1].settimeout(0.0)
            over.wait(0.01)
            held = [each for each in held if _is_open(each)]
        for each in held:
            each.close()

    thread = threading.Thread(target=hold, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(TIMEOUT_S)


def _is_open(client: socket.socket) -> bool:
    try:
        closed = client.recv(1) == b""
    except BlockingIOError:
        return True
    except OSError:
        closed = True
    if closed:
        client.close()
    return not closed


WAITS_S = 0.7
"""How long an oracle that ends waits for clients at most, s: to close, to be closed, and to look again."""


def _interrupted(out: Path, clients: int, *arguments: str, events: int = 1) -> tuple[float, float]:
    """How long the command takes to end by an interrupt while so many are connected; of a processor, s."""
    command = [sys.executable, "-m", "ariac_score.cli", "oracle", "--rules", "paper2020", "--port", "0"]
    with (
        subprocess.Popen(
            [*command, *arguments, "--max-connections", "400", "-o", str(out)],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process,
        ExitStack() as end,
    ):
        assert process.stderr is not None
        url = process.stderr.readline().removeprefix("listening on ").strip()
        for _ in range(clients):
            client = websocket.create_connection(url, timeout=TIMEOUT_S)
            end.callback(client.shutdown)
            assert all(is_answered(client) for _ in range(events))
        ticks = Path(f"/proc/{process.pid}/stat").read_text().rpartition(") ")[2].split()[11:13]
        began_s, before_s = time.monotonic(), sum(map(int, ticks)) / os.sysconf("SC_CLK_TCK")
        threading.Timer(60.0, process.kill).start()
        os.kill(process.pid, signal.SIGINT)
        _, status, used = os.wait4(process.pid, 0)
        took_s = time.monotonic() - began_s
        process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    return took_s, used.ru_utime + used.ru_stime - before_s


@pytest.mark.parametrize("events", [0, 1])
def test_an_interrupt_ends_it_within_two_seconds_whoever_is_connected(tmp_path: Path, events: int) -> None:
    out = tmp_path / "out"
    took_s, processor_s = _interrupted(out, 326, events=events)

    connections = json.loads((out / "oracle.json").read_text())["connections"]
    assert len(connections) == 326
    assert {one["ended"] for one in connections} == {"stopped by the oracle"}
    if events:  # what there was no time for is said, and can be done at any time
        left = [one for one in connections if one["not_scored"].startswith("left for later")]
        assert left
        assert len(left) + len([*out.glob("*.findings.json")]) == 326
    # On a machine that has other things to do: what it works, and what it waits for clients.
    assert min(took_s, processor_s + WAITS_S) < 2.0


def test_without_an_end_every_log_is_scored(tmp_path: Path) -> None:
    out = tmp_path / "out"

    _interrupted(out, 30, "--finish-within", "0")  # more than there is time for within two seconds

    assert len([*out.glob("*.findings.json")]) == 30


def test_honest_handshakes_come_through_thousands_of_connects(running: Running) -> None:
    oracle = running()
    over = threading.Event()

    def connects() -> None:
        held: list[socket.socket] = []
        while not over.is_set():
            with suppress(OSError):
                held.append(socket.create_connection(address(oracle), timeout=TIMEOUT_S))
            if len(held) > 300:
                held.pop(0).close()
        for each in held:
            each.close()

    threads = [threading.Thread(target=connects, daemon=True) for _ in range(3)]
    for thread in threads:
        thread.start()
    try:
        for _ in range(20):
            client = connect(oracle)
            assert is_answered(client)
            client.close()
    finally:
        over.set()
        for thread in threads:
            thread.join(TIMEOUT_S)
    assert threading.active_count() < 600  # of 256 handshakes, and those that are ending


# What is no honest frame -----------------------------------------------------------------


def test_a_message_in_pieces_without_end_is_ended_at_the_limit(running: Running) -> None:
    oracle = running(frame_bytes=10_000)
    abnf = websocket.ABNF
    client = connect(oracle)
    client.send_frame(abnf(0, 0, 0, 0, abnf.OPCODE_TEXT, 1, b"{"))
    with suppress(OSError, websocket.WebSocketException):
        for _ in range(1_000):
            client.send_frame(abnf(0, 0, 0, 0, abnf.OPCODE_CONT, 1, b" " * 1_000))
    with suppress(OSError, websocket.WebSocketException):
        while client.recv():  # until it has closed
            pass
    client.shutdown()
    oracle.stop()

    assert oracle.conversations[0].ended == "a frame was longer than 10,000 bytes"


def test_pieces_without_content_and_without_end_take_no_memory(running: Running) -> None:
    oracle = running(events_per_s=0)
    abnf = websocket.ABNF
    client = connect(oracle)
    client.send_frame(abnf(0, 0, 0, 0, abnf.OPCODE_TEXT, 1, b'{"topic": "x"'))
    tracemalloc.start()
    try:
        pieces = abnf(0, 0, 0, 0, abnf.OPCODE_CONT, 1, b"").format() * 1_000
        for _ in range(30):
            client.sock.sendall(pieces)
        client.send_frame(abnf(1, 0, 0, 0, abnf.OPCODE_CONT, 1, b"}"))
        assert json.loads(client.recv())["topic"] == "x"
        held, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    client.close()

    assert held < 1_000_000  # thirty thousand pieces, kept as objects, have more


@pytest.mark.parametrize("length", [1 << 20, 1 << 31, (1 << 63) - 1, 1 << 63, (1 << 64) - 1])
def test_a_frame_that_says_it_is_giant_is_refused_before_it_comes(running: Running, length: int) -> None:
    oracle = running()
    client = connect(oracle)
    client.sock.sendall(b"\x81\xff" + length.to_bytes(8, "big") + b"\x00" * 4)

    assert client.recv_data()[0] == websocket.ABNF.OPCODE_CLOSE
    client.shutdown()


def test_pings_that_nobody_reads_the_answers_of_hold_up_nobody(running: Running) -> None:
    oracle = running()
    flooder = connect(oracle)
    flooder.sock.settimeout(0.5)
    pings = websocket.ABNF.create_frame(b"x" * 125, websocket.ABNF.OPCODE_PING).format() * 1_000
    with suppress(OSError):
        for _ in range(1_000):
            flooder.sock.sendall(pings)

    client = connect(oracle)
    assert is_answered(client)
    client.close()
    flooder.shutdown()


def test_what_is_compressed_without_being_agreed_on_is_refused(running: Running) -> None:
    oracle = running()
    client = connect(oracle, header=["Sec-WebSocket-Extensions: permessage-deflate"])
    assert "sec-websocket-extensions" not in client.headers

    client.sock.sendall(b"\xc1\x84\x00\x00\x00\x00\xca\xfe\xba\xbe")  # RSV1: compressed

    assert client.recv_data()[0] == websocket.ABNF.OPCODE_CLOSE
    client.shutdown()


@pytest.mark.parametrize(
    "request_",
    [
        b"GET / HTTP/1.1\r\n\r\n",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 5\r\n\r\nhello",
        b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 100_000,
        b"GET /" + b"a" * 1_000_000,
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"\x00" * 500,  # TLS
        b"\xff" * 100_000,
    ],
)
def test_a_handshake_that_is_none_ends_alone(running: Running, request_: bytes) -> None:
    oracle = running()
    with (
        socket.create_connection(address(oracle), timeout=TIMEOUT_S) as stranger,
        suppress(ConnectionError),
    ):
        stranger.sendall(request_)
        while stranger.recv(65_536):
            pass
    client = connect(oracle)
    assert is_answered(client)
    client.close()
    assert len(oracle.conversations) == 1


# Connections with a name -----------------------------------------------------------------


def test_a_connection_that_comes_again_by_its_name_goes_on_where_it_was(running: Running) -> None:
    oracle = running()
    first = connect(oracle, "/cell")
    assert is_answered(first, 1.0)
    again = connect(oracle, "/cell")  # the first one has not been closed: its machine was switched off
    assert not is_answered(again, 1.01)  # nobody knows what was sent in between
    other = connect(oracle, "/other")
    assert is_answered(other, 1.0)
    for client in (again, other):
        client.close()
    first.shutdown()
    oracle.stop()

    assert [one.log.name for one in oracle.conversations] == ["cell.jsonl", "other.jsonl"]
    cell = oracle.conversations[0]
    assert (cell.interruptions, cell.ended) == (1, "closed by the client")
    rows = [json.loads(line) for line in cell.log.read_text().splitlines()]
    assert [row["topic"] for row in rows] == ["snapshot", "/ariac_score/unseen", "snapshot"]
    assert (rows[1]["since"], rows[1]["time"]) == (1.0, 1.01)


def test_another_oracle_goes_on_only_when_told_to(running: Running, tmp_path: Path) -> None:
    oracle = running()
    first = connect(oracle, "/cell")
    assert is_answered(first, 1.0)
    first.close()
    oracle.stop()

    with pytest.raises(UsageError, match="it is not empty") as refused:
        Oracle(BENCH, tmp_path / "results")
    assert "--resume" in refused.value.hint
    resumed = Oracle(BENCH, tmp_path / "results", resume=True)
    resumed.stop()
    (cell,) = resumed.conversations
    assert (cell.events, cell.ended) == (1, "stopped with an earlier oracle")
