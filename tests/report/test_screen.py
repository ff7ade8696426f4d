"""The screen of running cells: who may see it, what it says, and that no viewer slows it down."""

from __future__ import annotations

import asyncio
import json
import socket
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from ariac_score.engine.score import score_trial
from ariac_score.errors import UsageError
from ariac_score.live.running import Instant, Note, Running
from ariac_score.report.screen import server as server_module
from ariac_score.report.screen.metrics import metrics_of
from ariac_score.report.screen.publish import Publisher
from ariac_score.report.screen.server import Screen, screen_page
from ariac_score.report.screen.state import Showing
from ariac_score.serving.guard import Guard, listening

EXAMPLE = Path(__file__).parents[2] / "examples" / "kitting_near_miss.mcap"
TOKEN = "a-token-of-nobody-else"  # noqa: S105  # of these tests


def _instant(at_s: float, actual: float, limit: float) -> Instant:
    return Instant("separation", "robot/human", "distance", at_s, actual, limit, "m")


def _state(**values: Any) -> dict[str, Any]:
    return Showing("north", "replay:x").of(Running("replay:x", **values))


def test_what_is_violated_now_is_said_before_anything_is_judged() -> None:
    state = _state(now=(_instant(3.0, 0.5, 0.8),), elapsed_s=3.0)

    assert state["verdict"]["kind"] == "bad"
    assert state["verdict"]["text"] == "Violated now: robot and human by 0.30 m (separation)."
    assert "least" not in state["score"]


def test_what_was_violated_a_moment_ago_is_not_called_kept() -> None:
    showing = Showing("north", "replay:x")
    showing.note(Running("replay:x", now=(_instant(3.0, 0.5, 0.8),)))
    later = Running("replay:x", now=(_instant(4.0, 1.5, 0.8),), elapsed_s=4.0)
    showing.note(later)

    assert showing.of(later)["verdict"]["kind"] == "bad"


def test_a_source_that_is_gone_and_what_was_lost_are_in_plain_sight() -> None:
    notes = (Note(61.0, "lost", "5 messages of /tf were lost: a full queue dropped them"),)
    state = _state(connected=False, elapsed_s=75.0, notes=notes, sees_losses=False)

    assert state["verdict"]["kind"] == "open"
    assert "nothing is known since 1:15" in state["verdict"]["text"]
    assert "1:01 5 messages of /tf were lost: a full queue dropped them" in state["unseen"]
    assert any("silence is no evidence" in text for text in state["unseen"])


def test_what_was_not_seen_is_never_called_kept() -> None:
    notes = (Note(2.0, "lost", "5 messages of /tf were lost: a full queue dropped them"),)
    now = (_instant(3.0, 1.5, 0.8),)

    assert _state(now=now, elapsed_s=3.0)["verdict"]["kind"] == "good"
    missed = _state(now=now, elapsed_s=3.0, notes=notes)["verdict"]
    assert missed["kind"] == "open"
    assert "not everything" in missed["text"]


def test_the_strip_keeps_the_least_margin_of_each_tenth_of_a_second_for_a_minute() -> None:
    showing = Showing("north", "replay:x")
    for i in range(10_000):
        at_s = i / 100
        nearest = 0.1 if i == 9_004 else 1.0
        showing.note(Running("replay:x", now=(_instant(at_s, nearest, 0.5),), elapsed_s=at_s))
    rows = showing.of(Running("replay:x"))["strip"]["rows"]

    assert 600 <= len(rows) <= 602
    assert rows[0][0] >= 99.99 - 60.1
    assert [row for row in rows if row[1] < 1.0] == [(90.04, 0.1, 0.5)]


def test_the_strip_forgets_a_pair_that_nobody_has_seen_for_a_minute() -> None:
    showing = Showing("north", "replay:x")
    left = Instant("separation", "robot/visitor", "distance", 0.0, 0.1, 0.5, "m")
    showing.note(Running("replay:x", now=(left,), elapsed_s=0.0))
    for at_s in range(1, 62):
        showing.note(Running("replay:x", now=(_instant(at_s, 2.0, 0.5),), elapsed_s=at_s))
        strip = showing.of(Running("replay:x"))["strip"]
        assert strip["subject"] == ("robot/visitor" if at_s <= 60 else "robot/human")


def test_the_end_of_a_trial_shows_its_score_its_orders_and_its_ledger() -> None:
    result = score_trial(EXAMPLE, "paper2020.published")
    state = _state(result=result, so_far=result, open="", ended="over", monitors=frozenset({"separation"}))

    # 30 points earned, of which the law of the paper takes 10.24.
    assert (state["score"]["least"], state["score"]["most"]) == ("19.76", "19.76")
    assert [one["earned"] for one in state["orders"]] == ["9.00", "21.00"]
    assert [one["handed"][0]["t"] for one in state["orders"]] == [14.0, 31.0]
    amounts = sorted(one["amount"] for one in state["ledger"])
    assert amounts == ["+21.00", "+9.00", "\u22120.85", "\u22120.85", "\u22128.55"]
    assert [one["t"] for one in state["ledger"]] == sorted(one["t"] for one in state["ledger"])
    assert state["verdict"]["kind"] == "bad"


def test_metrics_are_text_that_prometheus_reads() -> None:
    state = _state(now=(_instant(3.0, 0.5, 0.8),), elapsed_s=3.0, messages=7) | {"name": 'a"b\\c'}
    lines = metrics_of([state]).splitlines()

    assert "# TYPE ariac_score_messages_total counter" in lines
    assert 'ariac_score_messages_total{cell="a\\"b\\\\c"} 7' in lines
    margin = 'ariac_score_margin{cell="a\\"b\\\\c",check="separation",subject="robot/human",unit="m"} -0.3'
    assert margin in lines
    assert not any(line.startswith("ariac_score_least") for line in lines)  # nobody knows it


def test_names_of_cells_are_escaped_and_the_page_asks_nobody_else() -> None:
    text = screen_page(("<b>north", "south"))

    assert "<b>north" not in text
    assert "connect-src &#39;self&#39;; base-uri" in text
    assert "http:" not in text.replace("http://www.w3.org/2000/svg", "")
    assert "https:" not in text


# Served ----------------------------------------------------------------------------------------


def _served(
    serve: Callable[[Screen, int], Coroutine[Any, Any, None]],
    *,
    token: str = "",
    notes: list[str] | None = None,
) -> None:
    async def run() -> None:
        listener = listening("127.0.0.1", 0)
        port = int(listener.getsockname()[1])
        said = notes if notes is not None else []
        screen = Screen(("north",), Guard(token), port, note=said.append)
        server = await screen.serve(listener)
        try:
            await asyncio.wait_for(serve(screen, port), 60)
        finally:
            server.close()
            screen.close()

    # In a thread of its own: a browser that other tests of this process drive keeps a loop running here.
    with ThreadPoolExecutor(1) as pool:
        pool.submit(asyncio.run, run()).result()


async def _asked(port: int, target: str = "/", method: str = "GET", **fields: str) -> str:
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    headers = {"Host": f"127.0.0.1:{port}", **fields}
    lines = [f"{method} {target} HTTP/1.1", *(f"{key}: {value}" for key, value in headers.items()), "", ""]
    writer.write("\r\n".join(lines).encode())
    answer = await asyncio.wait_for(reader.read(1 << 20), 10)
    writer.close()
    return answer.decode()


@pytest.mark.slow
def test_strangers_pages_names_and_guesses_are_refused() -> None:
    async def serve(_: Screen, port: int) -> None:
        assert (await _asked(port)).startswith("HTTP/1.1 401")
        assert (await _asked(port, "/?token=another-token-altogether")).startswith("HTTP/1.1 401")
        assert (await _asked(port, f"/?token={TOKEN}", Host="evil.example")).startswith("HTTP/1.1 403")
        evil = {"Origin": "https://evil.example"}
        assert (await _asked(port, f"/events?token={TOKEN}", **evil)).startswith("HTTP/1.1 403")
        page = await _asked(port, f"/?token={TOKEN}")
        assert page.startswith("HTTP/1.1 200")
        (cookie,) = (line for line in page.splitlines() if line.startswith("Set-Cookie"))
        value = cookie.partition(": ")[2].partition(";")[0]
        assert (await _asked(port, "/metrics", Cookie=value)).startswith("HTTP/1.1 200")
        assert (await _asked(port, "/metrics", "POST", Cookie=value)).startswith("HTTP/1.1 405")
        assert (await _asked(port, "/etc/passwd", Cookie=value)).startswith("HTTP/1.1 404")

    _served(serve, token=TOKEN)


@pytest.mark.slow
def test_fifty_viewers_see_every_cell_and_one_that_stops_reading_is_dropped_by_name(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(server_module, "_READ_S", 1.0)
    state = _state(now=(_instant(3.0, 0.5, 0.8),), elapsed_s=3.0)
    state["strip"] = {"rows": [[i / 10, 1.0, 0.5] for i in range(600)], "check": "", "subject": ""}
    notes: list[str] = []

    async def serve(screen: Screen, port: int) -> None:
        async def opened() -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
            reader, writer = await asyncio.open_connection("127.0.0.1", port, limit=1 << 20)
            writer.write(f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
            return reader, writer

        viewers = [await opened() for _ in range(50)]
        deaf = socket.create_connection(("127.0.0.1", port))
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        deaf.sendall(f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
        name = "{}:{}".format(*deaf.getsockname())

        async def seen(reader: asyncio.StreamReader) -> int:
            latest = 0
            while latest < 400:
                line = await reader.readline()
                if line.startswith(b"data: "):
                    latest = json.loads(line[6:])["messages"]
            return latest

        watching = [asyncio.create_task(seen(reader)) for reader, _ in viewers]
        for number in range(1, 401):
            screen.show(json.dumps(state | {"messages": number}).encode())
            await asyncio.sleep(0.02)
        assert await asyncio.gather(*watching) == [400] * 50
        while not screen.dropped:
            screen.show(json.dumps(state).encode())
            await asyncio.sleep(0.02)
        assert screen.dropped == [name]
        assert notes == [f"viewer {name} stopped reading, and was dropped"]
        deaf.close()
        for _, writer in viewers:
            writer.close()

    _served(serve, notes=notes)


@pytest.mark.slow
def test_beyond_this_machine_only_with_a_token(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    from ariac_score.cli import main  # noqa: PLC0415

    command = ["watch", f"replay:{EXAMPLE}?speed=0", "--rules", "paper2020"]
    assert main([*command, "--serve", "0.0.0.0:0"]) == 4
    assert "there is no token" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="4"):
        main([*command, "--serve", "anywhere"])
    assert main([*command, "--cell", "a=replay:x"]) == 4
    assert "give either SOURCE or --cell" in capsys.readouterr().err
    assert main(["watch", "--cell", "a=replay:x", "--cell", "a=replay:y", "--rules", "paper2020"]) == 4
    assert (
        main([*command[:1], "--cell", "a=replay:x", "--rules", "paper2020", "-o", str(tmp_path / "r")]) == 4
    )


@pytest.mark.slow
def test_margins_and_verdicts_are_topics_on_this_machine_alone() -> None:
    pytest.importorskip("foxglove", reason="foxglove-sdk is not installed")
    client = pytest.importorskip("websockets.sync.client", reason="websockets is not installed")
    with pytest.raises(UsageError, match="knows no token"):
        Publisher("0.0.0.0", 0)  # noqa: S104  # refused
    publisher = Publisher("127.0.0.1", 0)
    try:
        state = _state(now=(_instant(3.0, 0.5, 0.8),), elapsed_s=3.0)
        publisher.show(state)
        address = f"ws://127.0.0.1:{publisher.port}"
        with client.connect(address, subprotocols=["foxglove.sdk.v1"], open_timeout=10) as viewer:
            topics: dict[str, int] = {}
            while len(topics) < 2:
                text = viewer.recv(timeout=10)
                said = json.loads(text) if isinstance(text, str) else {}
                topics |= {one["topic"]: one["id"] for one in said.get("channels", ())}
            wanted = [{"id": 1, "channelId": topics["/north/margin/separation/robot/human"]}]
            viewer.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
            values = None
            for _ in range(100):  # what is published before it has subscribed does not come
                publisher.show(state)
                try:
                    data = viewer.recv(timeout=0.2)
                except TimeoutError:
                    continue
                if isinstance(data, bytes) and data[0] == 1:  # a message: its subscription, a time, its bytes
                    values = json.loads(data[13:])
                    break
    finally:
        publisher.close()

    assert topics.keys() == {"/north/margin/separation/robot/human", "/north/verdict"}
    assert values == {"margin": -0.3, "actual": 0.5, "limit": 0.8, "unit": "m"}
