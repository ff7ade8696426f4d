"""How many events a second does the oracle answer to one client on loopback?

The client is the library that the generated monitors use, with one event outstanding, as
they have it; the oracle judges separation and keeps its log. Beside it a bare echo by the
same WebSocket library, which judges nothing and keeps nothing: what no oracle here can
do much better than. Servers have a process of their own, the rounds alternate, the median counts.

    python benchmarks/oracle.py [--events 20000] [--rounds 5]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import platform
import statistics
import tempfile
import time
from multiprocessing.connection import Connection
from pathlib import Path

import websocket
from websockets.sync.server import ServerConnection, serve

from ariac_score import load_rule_set
from ariac_score.checks.registry import Registry
from ariac_score.oracle.judges import RulesBench
from ariac_score.oracle.server import Limits, Oracle

WANTED_PER_S = 5000


def events(count: int) -> list[str]:
    """Snapshots at 100 Hz of a robot that a human comes near now and then."""
    return [
        json.dumps(
            {
                "topic": "snapshot",
                "human_operator_speed": 0.5,
                "robot_speed": 0.25,
                "distance_robot_human_operator": 3.0 + (i % 400) / 100,
                "time": i / 100,
            }
        )
        for i in range(count)
    ]


def judging(told: Connection) -> None:
    """The oracle, as `ariac-score oracle --rules paper2020` makes it."""
    with tempfile.TemporaryDirectory() as folder:
        bench = RulesBench(load_rule_set("paper2020"), Registry())
        oracle = Oracle(bench, Path(folder) / "results", limits=Limits(events_per_s=0))
        told.send(oracle.url)
        oracle.serve()


def echoing(told: Connection) -> None:
    """A server that gives back what it gets."""

    def echo(ws: ServerConnection) -> None:
        for frame in ws:
            ws.send(frame)

    server = serve(echo, "127.0.0.1", 0, compression=None, ping_interval=None)
    told.send(f"ws://127.0.0.1:{server.socket.getsockname()[1]}")
    server.serve_forever()


def answers_per_s(url: str, frames: list[str], outstanding: int = 1) -> float:
    """One client that sends so many events before it reads their replies; monitors send one."""
    client = websocket.create_connection(url, timeout=10)
    started = time.perf_counter()
    for first in range(0, len(frames), outstanding):
        some = frames[first : first + outstanding]
        for frame in some:
            client.send(frame)
        for _ in some:
            client.recv()
    per_s = len(frames) / (time.perf_counter() - started)
    client.close()
    return per_s


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--events", type=int, default=20_000)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    frames, urls, servers = events(arguments.events), [], []
    spawn = multiprocessing.get_context("spawn")
    for target in (judging, echoing):
        ours, theirs = spawn.Pipe()
        server = spawn.Process(target=target, args=(theirs,), daemon=True)
        server.start()
        servers.append(server)
        urls.append(ours.recv())
    rates: tuple[list[float], list[float]] = ([], [])
    busy_us: list[float] = []
    for k in range(arguments.rounds):
        for url, server, found in zip(urls, servers, rates, strict=True):
            before = cpu_s(server.pid), time.process_time()
            found.append(answers_per_s(url, frames))
            if k == 0:
                after = cpu_s(server.pid), time.process_time()
                busy_us += [(b - a) / len(frames) * 1e6 for a, b in zip(before, after, strict=True)]
    at_once = answers_per_s(urls[0], frames, outstanding=100)
    for server in servers:
        server.terminate()
    told(arguments, rates, busy_us, at_once)


def told(
    arguments: argparse.Namespace, rates: tuple[list[float], ...], busy_us: list[float], at_once: float
) -> None:
    """Print what was measured."""
    share = statistics.median(a / b for a, b in zip(*rates, strict=True))
    print(f"{platform.python_implementation()} {platform.python_version()}, {platform.machine()}")
    print(f"{arguments.events} events to one client on loopback, {arguments.rounds} rounds")
    for name, found, server_us, client_us in (
        ("oracle, with verdicts and log", rates[0], *busy_us[:2]),
        ("bare echo", rates[1], *busy_us[2:]),
    ):
        print(
            f"{name:30} {statistics.median(found):8.0f} events/s, best {max(found):6.0f}; "
            f"of processor time {server_us:.0f} us/event here, {client_us:.0f} us/event in the client"
        )
    print(f"{'oracle, 100 outstanding':30} {at_once:8.0f} events/s")
    print(f"{'oracle / bare echo':30} {share:8.2f}")
    met = "met" if max(rates[0]) >= WANTED_PER_S else "missed; is the machine busy?"
    print(f"{'wanted':30} {WANTED_PER_S:8} events/s: {met}")


def cpu_s(pid: int | None) -> float:
    """Processor time that a process has taken, s; 0 where the system does not tell."""
    stat = Path(f"/proc/{pid}/stat")
    if not stat.is_file():
        return 0.0
    fields = stat.read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    main()
