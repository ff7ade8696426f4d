"""What watching costs: taking a message in, the margins of the moment, and judging the trial so far.

    python benchmarks/live.py [AGE_S …]
    python benchmarks/live.py latency [SECONDS]    # from a message to its margin, at 100 Hz and 1 kHz
    python benchmarks/live.py links [SECONDS]      # the same of a robot of 30 links and 3 people at 500 Hz
    python benchmarks/live.py viewers              # of a processor, judging takes with 0 and 50 viewers

A message is taken in (recorded and collected) at a cost that does not depend on the age of the trial; so do
the margins of the moment, which come from the last moments alone, and the trial so far, of which only what is
not settled is judged again. `Settings.share` and `tail_share` bound the part of a processor that they take.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from multiprocessing import active_children
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from ariac_score.engine.prepared import prepare
from ariac_score.live.judging import Apart, Judged
from ariac_score.live.replay import source_items
from ariac_score.live.running import Running
from ariac_score.live.so_far import SoFar
from ariac_score.live.source import Announced, Ended, LiveItem, Received
from ariac_score.live.tail import Tail
from ariac_score.live.watch import Settings, Watch
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.results.result import Result
from ariac_score.testing import write_bag
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

RULES = "paper2020"
EXAMPLE = Path(__file__).parents[1] / "examples" / "kitting_near_miss.mcap"


class Timed:
    """Gives the items of a recording at once, and notes when each was asked for."""

    address, sees_losses = "made:", True
    stamps: Literal["arrival", "recorder"] = "recorder"

    def __init__(self, log: Path) -> None:
        self._items = list(source_items(open_scan(log, jobs=1)))
        self._at = 0
        self.asked_s: list[float] = []

    def open(self, topics: frozenset[str] | None) -> None:
        pass

    def next(self, timeout_s: float) -> LiveItem | None:
        assert timeout_s > 0
        self.asked_s.append(time.perf_counter())
        self._at += 1
        return self._items[self._at - 1] if self._at <= len(self._items) else Ended("it is over")

    def close(self) -> None:
        pass


NEVER_S = 1e15


def main(ages_s: list[float]) -> None:
    print(
        "age | messages | taken in, us each (p50, p99) | margins of the moment, ms | trial so far judged, ms"
    )
    with TemporaryDirectory() as parent:
        folder = Path(parent)
        for age_s in ages_s:
            messages = recorded_messages(kitting_trial(duration_s=age_s))
            log = write_bag(folder / f"{age_s:g}.mcap", messages, storage="mcap")
            never = Settings(period_s=NEVER_S, tail_period_s=NEVER_S)
            source = Timed(log)
            Watch(source, prepare(RULES), folder / f"{age_s:g}_seen.mcap", settings=never).run()
            p50, p99 = np.percentile(np.diff(np.array(source.asked_s[20:])) * 1e6, [50, 99])
            margins_ms = 1e3 * told_after_s(log, folder / f"{age_s:g}_now.mcap", Settings(NEVER_S, NEVER_S))
            judged_ms = 1e3 * judged_s(log, folder / f"{age_s:g}_judged.mcap", len(messages))
            print(
                f"{age_s:g} s | {len(messages)} | {p50:.0f}, {p99:.0f} | {margins_ms:.0f} | {judged_ms:.0f}"
            )


def judged_s(log: Path, record: Path, messages: int) -> float:
    """Processor time that the last judgement of the trial so far takes, of one every 300 messages, s."""
    source, costs_s = Timed(log), [0.0]
    judge = SoFar.judge

    def timed(self: SoFar) -> Result:
        began_s = time.process_time()
        result = judge(self)
        costs_s.append(time.process_time() - began_s)
        return result

    SoFar.judge = timed  # type: ignore[method-assign]
    try:
        settings = Settings(period_s=300, share=1.0, tail_period_s=NEVER_S, apart=False)
        watch = Watch(
            source, prepare(RULES), record, settings=settings, now_s=lambda: float(min(source._at, messages))
        )
        watch.run()
    finally:
        SoFar.judge = judge  # type: ignore[method-assign]
    return costs_s[-1]


LOOK = "one look, ms of a processor (median of the first tenth, of the last; p99 of all)"


class Paced(Timed):
    """Gives items when they are due, as a cell would, and notes when that was."""

    def __init__(self, items: Iterable[LiveItem]) -> None:
        self._coming = iter(items)
        self._next: LiveItem | None = None
        self.due_s: list[float] = []
        self._origin: tuple[float, int] | None = None

    def next(self, timeout_s: float) -> LiveItem | None:
        item = self._next = self._next or next(self._coming, None)
        if item is None:
            raise OverError
        if isinstance(item, Received):
            stamp_ns = item.message.stamp_ns
            self._origin = self._origin or (time.perf_counter(), stamp_ns)
            due_s = self._origin[0] + (stamp_ns - self._origin[1]) / 1e9
            wait_s = due_s - time.perf_counter()
            if wait_s > 0:
                time.sleep(min(wait_s, timeout_s))
                if wait_s > timeout_s:
                    return None
            self.due_s.append(due_s)
        self._next = None
        return item


class OverError(Exception):
    """All has come: what it is worth in the end is not measured."""


class Looks:
    """Processor time of every look at the margins of the moment."""

    def __init__(self) -> None:
        self.costs_s: list[float] = []
        self._moment = Tail.moment

    def __enter__(self) -> Looks:
        real, costs_s = self._moment, self.costs_s

        def moment(self: Tail, elapsed_s: float) -> Any:
            began_s = time.thread_time()
            found = real(self, elapsed_s)
            costs_s.append(time.thread_time() - began_s)
            return found

        Tail.moment = moment  # type: ignore[method-assign]
        return self

    def __exit__(self, *_: object) -> None:
        Tail.moment = self._moment  # type: ignore[method-assign]

    @property
    def text(self) -> str:
        """The median in the first and in the last tenth, and the 99th percentile of all, ms."""
        tenth = max(1, len(self.costs_s) // 10)
        first, last = (1e3 * float(np.median(part)) for part in (self.costs_s[:tenth], self.costs_s[-tenth:]))
        return f"{first:.1f}, {last:.1f} ({1e3 * float(np.percentile(self.costs_s, 99)):.1f})"


class Late:
    """How late the state came that holds the margin of a message, and the processor time until then."""

    def __init__(self, source: Paced) -> None:
        self._source, self._seen = source, 0
        self.late_s: list[float] = []
        self.began = self.latest = time.perf_counter(), cpu_s()

    def told(self, state: Running) -> None:
        self.latest = time.perf_counter(), cpu_s()
        self.late_s += [self.latest[0] - due_s for due_s in self._source.due_s[self._seen : state.messages]]
        self._seen = max(self._seen, state.messages)

    @property
    def share(self) -> float:
        """Part of one processor."""
        return (self.latest[1] - self.began[1]) / (self.latest[0] - self.began[0])


def latency(seconds: float) -> None:
    """From the moment a message is due to its margin; what the machine does besides is in it."""
    print(f"rate | messages | to its margin, ms (p50, p99) | processor, % | {LOOK}")
    with TemporaryDirectory() as parent:
        for times in (1, 10):
            log = Path(parent, f"{times}.mcap")
            messages = [
                replace(one, t_ns=one.t_ns + i * 10**7 // times)
                for one in recorded_messages(kitting_trial(duration_s=seconds))
                for i in range(times if one.topic == "/snapshot" else 1)
            ]
            write_bag(log, messages, storage="mcap")
            source = Paced(source_items(open_scan(log, jobs=1)))
            late = Late(source)
            watch = Watch(source, prepare(RULES), Path(parent, f"{times}_seen.mcap"), told=late.told)
            with Looks() as looks, suppress(OverError):
                watch.run()
            p50, p99 = np.percentile(late.late_s, [50, 99]) * 1e3
            row = f"{100 * times} Hz | {len(late.late_s)} | {p50:.0f}, {p99:.0f} | {100 * late.share:.0f}"
            print(f"{row} | {looks.text}", flush=True)


LINKS, HUMANS, RATE_HZ = 30, 3, 500
_BLOCK = 5000
_STATES = """string[] name
geometry_msgs/Pose[] pose
geometry_msgs/Twist[] twist
""" + "".join(
    f"{'=' * 80}\nMSG: geometry_msgs/{name}\n{fields}\n"
    for name, fields in {
        "Pose": "Point position\nQuaternion orientation",
        "Twist": "Vector3 linear\nVector3 angular",
        "Point": "float64 x\nfloat64 y\nfloat64 z",
        "Vector3": "float64 x\nfloat64 y\nfloat64 z",
        "Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
    }.items()
)
_LOG_MAP = """id: links
title: A robot with its links and people, as Gazebo states them
source: made
models:
  - {match: robot, kind: robot, links: ["link_*"]}
  - {match: "person_*", kind: human}
channels:
  - {topic: /gazebo/link_states, type: gazebo_msgs/msg/LinkStates, poses: models}
  - {topic: /gazebo/model_states, type: gazebo_msgs/msg/ModelStates, poses: models}
"""


def states(seconds: float) -> Iterator[LiveItem]:
    """A robot that swings its links and people who walk past it, as Gazebo publishes them in ROS 1."""
    drawn = np.random.default_rng(1)
    names = {"link": [f"robot::link_{i}" for i in range(LINKS)]}
    names["model"] = ["robot", *(f"person_{i}" for i in range(HUMANS))]
    origin_ns = time.time_ns()
    makers = []
    for kind, bodies in names.items():
        type_ = f"gazebo_msgs/msg/{kind.capitalize()}States"
        connection = Connection(f"/gazebo/{kind}_states", type_, "ros1", _STATES, "ros1msg")
        yield Announced(connection)
        turn, phase = drawn.uniform(0.3, 0.6, (2, len(bodies))), drawn.uniform(0, 6, len(bodies))
        reach = np.linspace(0.1, 1.2, len(bodies)) if kind == "link" else np.array([0.0, 20.0, 22.0, 24.0])
        turn_rad_s = turn[0] / (3 if kind == "link" else 20)
        count = len(bodies).to_bytes(4, "little")
        head = count + b"".join(len(name).to_bytes(4, "little") + name.encode() for name in bodies) + count
        makers.append((connection, head, count, reach, turn_rad_s, phase))
    steps = round(seconds * RATE_HZ)
    for first in range(0, steps, _BLOCK):
        t_s = np.arange(first, min(first + _BLOCK, steps)) / RATE_HZ
        made = []
        for connection, head, count, reach, turn_rad_s, phase in makers:
            angles = np.outer(t_s, turn_rad_s) + phase
            poses, twists = np.zeros((len(t_s), len(reach), 7)), np.zeros((len(t_s), len(reach), 6))
            poses[..., 6] = 1.0
            poses[..., 0], poses[..., 1] = reach * np.cos(angles), reach * np.sin(angles)
            twists[..., 0], twists[..., 1] = -turn_rad_s * poses[..., 1], turn_rad_s * poses[..., 0]
            made.append((connection, head, poses, count, twists))
        for i, at_s in enumerate(t_s):
            for connection, head, poses, count, twists in made:
                payload = head + poses[i].tobytes() + count + twists[i].tobytes()
                yield Received(Message(connection, origin_ns + round(at_s * 1e9), payload, 0))


def links(seconds: float) -> None:
    """What a robot of many links and several people cost, and how late their margins are."""
    print(f"{LINKS} links, {HUMANS} people, {RATE_HZ} Hz")
    judging = "trial so far judged, ms (median of the first tenth, of the last)"
    print(f"messages | to its margin, ms (p50, p99) | processor, % | {LOOK} | {judging}")
    with TemporaryDirectory() as parent:
        log_map = Path(parent, "links.log_map.yaml")
        log_map.write_text(_LOG_MAP, encoding="utf-8")
        source = Paced(states(seconds))
        late = Late(source)
        costs_s: list[float] = []
        answer = Apart.answer

        def answered(self: Apart) -> Judged | None:
            judged = answer(self)
            if judged is not None and judged.result is not None:
                costs_s.append(judged.cost_s)
            return judged

        Apart.answer = answered  # type: ignore[method-assign]
        prepared = prepare("safety", log_map=str(log_map))
        with Looks() as looks, suppress(OverError):
            Watch(source, prepared, Path(parent, "seen.mcap"), told=late.told).run()
        Apart.answer = answer  # type: ignore[method-assign]
        p50, p99 = np.percentile(late.late_s, [50, 99]) * 1e3
        tenth = max(1, len(costs_s) // 10)
        first, last = (1e3 * float(np.median(part)) for part in (costs_s[:tenth], costs_s[-tenth:]))
        print(
            f"{len(late.late_s)} | {p50:.0f}, {p99:.0f} | {100 * late.share:.0f} | {looks.text}"
            f" | {first:.0f}, {last:.0f} ({len(costs_s)} times)"
        )


def cpu_s() -> float:
    """Processor time of this process and of those that it started and that run, s; of Linux."""
    used_s = time.process_time()
    for child in active_children():
        with suppress(OSError):
            used_s += ticks_s(child.pid or 0)
    return used_s


def viewers() -> None:
    """Processor time of who watches and of who shows, with nobody looking on and with many."""
    print("viewers | who watches, % of a processor | who judges | who shows")
    for count in (0, 1, 50):
        source = f"replay:{EXAMPLE}?speed=1"
        command = [sys.executable, "-m", "ariac_score.cli", "watch", source, "--rules", RULES]
        with (
            subprocess.Popen(
                [*command, "--serve", "127.0.0.1:0"],
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                text=True,
            ) as process,
            ExitStack() as end,
        ):
            end.callback(process.kill)
            assert process.stderr is not None
            port = next(int(found[1]) for line in process.stderr if (found := re.search(r":([0-9]+)/", line)))
            for _ in range(count):
                one = end.enter_context(socket.create_connection(("127.0.0.1", port)))
                one.sendall(f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
                threading.Thread(target=swallow, args=(one,), daemon=True).start()
            time.sleep(3.0)  # until all is loaded
            shows, (watches,) = process.pid, children(process.pid)
            (judges,) = children(watches)
            before = [ticks_s(pid) for pid in (watches, judges, shows)]
            time.sleep(10.0)
            used = [ticks_s(pid) - had for pid, had in zip((watches, judges, shows), before, strict=True)]
            print(f"{count} | " + " | ".join(f"{100 * one / 10.0:.1f}" for one in used), flush=True)


def swallow(one: socket.socket) -> None:
    """Take everything that comes."""
    with suppress(OSError):
        while one.recv(1 << 16):
            pass


def children(pid: int) -> list[int]:
    """Who was started by a process; of Linux."""
    return [int(n) for file in Path(f"/proc/{pid}/task").glob("*/children") for n in file.read_text().split()]


def ticks_s(pid: int) -> float:
    """Processor time of a process, s; of Linux."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def told_after_s(log: Path, record: Path, settings: Settings) -> float:
    """Processor time from the last message to the state that it leads to, s."""
    source, longest_s, begun_s = Timed(log), [0.0], [0.0]
    before_last = len(source._items) - 1

    def now_s() -> float:
        """A clock by which the time to look again comes with the last message."""
        begun_s[0] = begun_s[0] if source._at > before_last and begun_s[0] else time.process_time()
        return NEVER_S / 2 if source._at > before_last else 0.0

    def told(_state: object) -> None:
        if source._at == before_last + 1:
            longest_s[0] = longest_s[0] or time.process_time() - begun_s[0]

    Watch(source, prepare(RULES), record, settings=settings, told=told, now_s=now_s).run()
    return longest_s[0]


if __name__ == "__main__":
    if sys.argv[1:2] == ["latency"]:
        latency(float(sys.argv[2]) if sys.argv[2:] else 60.0)
    elif sys.argv[1:2] == ["links"]:
        links(float(sys.argv[2]) if sys.argv[2:] else 60.0)
    elif sys.argv[1:2] == ["viewers"]:
        viewers()
    else:
        main([float(text) for text in sys.argv[1:]] or [30.0, 120.0, 480.0])
