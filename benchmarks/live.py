"""What watching costs: taking a message in, the margins of the moment, and judging the trial so far.

    python benchmarks/live.py [AGE_S …]
    python benchmarks/live.py latency [SECONDS]    # from a message to its margin, at 100 Hz and 1 kHz
    python benchmarks/live.py links [SECONDS]      # the same of a robot of 30 links and 3 people at 500 Hz

A message is taken in (recorded and collected) at a cost that does not depend on the age of the trial; so do
the margins of the moment, which come from the last moments alone, and the trial so far, of which only what is
not settled is judged again. `Settings.share` and `tail_share` bound the part of a processor that they take.
"""

from __future__ import annotations

import os
import sys
import time
from contextlib import suppress
from dataclasses import replace
from multiprocessing import active_children
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

import numpy as np

from ariac_score.engine.prepared import prepare
from ariac_score.live.judging import Apart, Judged
from ariac_score.live.replay import source_items
from ariac_score.live.running import Running
from ariac_score.live.so_far import SoFar
from ariac_score.live.source import Announced, Ended, LiveItem, Received
from ariac_score.live.watch import Settings, Watch
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.results.result import Result
from ariac_score.testing import write_bag
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

RULES = "paper2020"


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


class Paced(Timed):
    """Gives items, or those of a recording, when they are due, as a cell would, and notes when that was."""

    def __init__(self, log: Path | list[LiveItem]) -> None:
        if isinstance(log, Path):
            super().__init__(log)
        else:
            self._items, self._at = log, 0
        self.due_s: list[float] = []
        self._origin: tuple[float, int] | None = None

    def next(self, timeout_s: float) -> LiveItem | None:
        if self._at >= len(self._items):
            return Ended("it is over")
        item = self._items[self._at]
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
        self._at += 1
        return item


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
    print("rate | messages | to its margin, ms (p50, p99) | processor, %")
    with TemporaryDirectory() as parent:
        for times in (1, 10):
            log = Path(parent, f"{times}.mcap")
            messages = [
                replace(one, t_ns=one.t_ns + i * 10**7 // times)
                for one in recorded_messages(kitting_trial(duration_s=seconds))
                for i in range(times if one.topic == "/snapshot" else 1)
            ]
            write_bag(log, messages, storage="mcap")
            source = Paced(log)
            late = Late(source)
            Watch(source, prepare(RULES), Path(parent, f"{times}_seen.mcap"), told=late.told).run()
            p50, p99 = np.percentile(late.late_s, [50, 99]) * 1e3
            print(
                f"{100 * times} Hz | {len(late.late_s)} | {p50:.0f}, {p99:.0f} | {100 * late.share:.0f}",
                flush=True,
            )


LINKS, HUMANS, RATE_HZ = 30, 3, 500
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


def states(seconds: float) -> list[LiveItem]:
    """A robot that swings its links and people who walk past it, as Gazebo publishes them in ROS 1."""
    t_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    drawn = np.random.default_rng(1)
    names = {"link": [f"robot::link_{i}" for i in range(LINKS)]}
    names["model"] = ["robot", *(f"person_{i}" for i in range(HUMANS))]
    origin_ns = time.time_ns()
    items: list[LiveItem] = []
    makers = []
    for kind, bodies in names.items():
        type_ = f"gazebo_msgs/msg/{kind.capitalize()}States"
        connection = Connection(f"/gazebo/{kind}_states", type_, "ros1", _STATES, "ros1msg")
        items.append(Announced(connection))
        turn, phase = drawn.uniform(0.3, 0.6, (2, len(bodies))), drawn.uniform(0, 6, len(bodies))
        reach = np.linspace(0.1, 1.2, len(bodies)) if kind == "link" else np.array([0.0, 20.0, 22.0, 24.0])
        slow = 3 if kind == "link" else 20
        poses = np.zeros((len(t_s), len(bodies), 7))
        poses[..., 6] = 1.0
        poses[..., 0] = reach * np.cos(np.outer(t_s, turn[0] / slow) + phase)
        poses[..., 1] = reach * np.sin(np.outer(t_s, turn[1] / slow) + phase)
        count = len(bodies).to_bytes(4, "little")
        head = count + b"".join(len(name).to_bytes(4, "little") + name.encode() for name in bodies) + count
        twists = np.zeros((len(t_s), len(bodies), 6))
        twists[..., :3] = np.gradient(poses[..., :3], 1 / RATE_HZ, axis=0)
        makers.append((connection, head, poses, count, twists))
    for i, at_s in enumerate(t_s):
        for connection, head, poses, count, twists in makers:
            payload = head + poses[i].tobytes() + count + twists[i].tobytes()
            items.append(Received(Message(connection, origin_ns + round(at_s * 1e9), payload, 0)))
    return items


def links(seconds: float) -> None:
    """What a robot of many links and several people cost, and how late their margins are."""
    print(f"{LINKS} links, {HUMANS} people, {RATE_HZ} Hz")
    print("messages | to its margin, ms (p50, p99) | processor, % | trial so far judged, ms (first, last)")
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
        Watch(source, prepared, Path(parent, "seen.mcap"), told=late.told).run()
        Apart.answer = answer  # type: ignore[method-assign]
        p50, p99 = np.percentile(late.late_s, [50, 99]) * 1e3
        print(
            f"{len(late.late_s)} | {p50:.0f}, {p99:.0f} | {100 * late.share:.0f}"
            f" | {1e3 * costs_s[0]:.0f}, {1e3 * costs_s[-1]:.0f} ({len(costs_s)} times)"
        )


def cpu_s() -> float:
    """Processor time of this process and of those that it started and that run, s; of Linux."""
    ticks = 0
    for child in active_children():
        with suppress(OSError):
            fields = Path(f"/proc/{child.pid}/stat").read_text().rpartition(") ")[2].split()
            ticks += int(fields[11]) + int(fields[12])
    return time.process_time() + ticks / os.sysconf("SC_CLK_TCK")


def told_after_s(log: Path, record: Path, settings: Settings) -> float:
    """How long it takes from the last message to the state that it leads to, s."""
    source, longest_s, begun_s = Timed(log), [0.0], [0.0]
    before_last = len(source._items) - 1

    def now_s() -> float:
        """A clock by which the time to look again comes with the last message."""
        begun_s[0] = begun_s[0] if source._at > before_last and begun_s[0] else time.perf_counter()
        return NEVER_S / 2 if source._at > before_last else 0.0

    def told(_state: object) -> None:
        if source._at == before_last + 1:
            longest_s[0] = longest_s[0] or time.perf_counter() - begun_s[0]

    Watch(source, prepare(RULES), record, settings=settings, told=told, now_s=now_s).run()
    return longest_s[0]


if __name__ == "__main__":
    if sys.argv[1:2] == ["latency"]:
        latency(float(sys.argv[2]) if sys.argv[2:] else 60.0)
    elif sys.argv[1:2] == ["links"]:
        links(float(sys.argv[2]) if sys.argv[2:] else 60.0)
    else:
        main([float(text) for text in sys.argv[1:]] or [30.0, 120.0, 480.0])
