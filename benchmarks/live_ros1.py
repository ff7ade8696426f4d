"""A cell of a real ROS 1 that is watched: pictures of its screen, and whether everybody says the same of it.

    python benchmarks/live_ros1.py FOLDER    # needs ROS 1 (Debian's), Chromium, and `pip install '.[dev]'`

A master, the recorder that is shipped, a robot and a person as a node of rospy (`tests/ros/cell`). One trial
is watched directly (`ros1://`) and through a server of the Foxglove SDK that is fed from the master
(`foxglove://`), and asked about by the monitor node that is shipped, with an oracle. A second one is shown on
a wall of four: by these two sources, by the bag as it grows, and beside them the first trial, replayed.
Printed are tables of what each comes to, and of how late it is.
"""

from __future__ import annotations

import json
import shutil
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from urllib.request import urlopen

import numpy as np
from playwright.sync_api import Page, sync_playwright

from ariac_score import Verdict, as_json, score_trial
from ariac_score.live.replay import source_items
from ariac_score.live.source import Announced, Received, source_at
from ariac_score.logs.containers.detect import open_scan

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "ros"), str(ROOT / "tests" / "live")]

from robot_os import HERE, RobotOs, generate_messages, robot_os  # noqa: E402
from test_foxglove import bridge  # noqa: E402

RULES = "paper2020.published"
STATE = "/ariac/competition_state"
SHIPMENT, CALLED = "order_0_shipment_0", "/scoring/ariac/agv1"
WATCHED = {
    "/tf": "tf2_msgs/TFMessage",
    STATE: "std_msgs/String",
    "/ariac/orders": "nist_gear/Order",
    "/ariac_score/submissions": "ariac_score_msgs/Submission",
}
PROGRAM = Path(sys.executable).with_name("ariac-score")
APPROACHING_S = 7.0
"""Of the trial: then the person is on the way, and still far."""
SERVED = ("--serve", "127.0.0.1:0")
LIMIT_S = 120.0
SUBSCRIBED_S = 2.0
"""Time to subscribe to what a bridge offers."""


def main(folder: Path) -> None:
    """Both trials."""
    folder.mkdir(parents=True)
    generate_messages(folder / "messages")
    with robot_os(folder, folder / "messages") as ros, relayed(f"ros1://127.0.0.1:{ros.port}") as over_bridge:
        ros.environment["PYTHONPATH"] += f":{ROOT / 'ros/ariac_score_monitor/src'}"
        sources = {"direct": f"ros1://127.0.0.1:{ros.port}", "bridge": over_bridge}
        told = one_trial(ros, folder, sources)
        print("| by | score | too close | by, m | its log, scored |\n|---|---|---|---|---|")
        for name in sources:
            print(row(name, folder / f"{name}.mcap", folder / f"{name}.json"))
        log = folder / "oracle" / "monitor.jsonl"
        print(row("oracle", log, log.with_suffix(".result.json")))
        print(row("rosbag", folder / "trial.bag"))
        print("\n| by | stamp to arrival, ms (p50, p99) | arrival to screen |\n|---|---|---|")
        for name in sources:
            late = delays(folder / f"{name}.mcap", told[name])
            print(f"| {name} | {late[0]:.1f}, {late[1]:.1f} | {late[2]:.0f}, {late[3]:.0f} |", flush=True)
        wall(ros, folder, sources)


def one_trial(ros: RobotOs, folder: Path, sources: dict[str, str]) -> dict[str, list[tuple[float, float]]]:
    """Watch a trial in three ways, and take pictures; what each screen was told, and when."""
    with ExitStack() as end:
        port = free_port()
        oracle = end.enter_context(
            command("oracle", "--rules", RULES, "--port", str(port), "-o", folder / "oracle")
        )
        said(oracle, "listening on")
        plan = {
            "name": "monitor",
            "oracle": f"ws://127.0.0.1:{port}",
            "without_oracle": "closed",
            "topics": [{"name": name, "type": kind} for name, kind in WATCHED.items()],
        }
        (folder / "monitor.json").write_text(json.dumps(plan), encoding="utf-8")
        monitor = ROOT / "ros/ariac_score_monitor/scripts/monitor"
        node = ros.python(monitor, "--plan", folder / "monitor.json", "--out", folder)
        ros.until(node, "watching", LIMIT_S)
        told: dict[str, list[tuple[float, float]]] = {}
        watches, screens = {}, {}
        for name, source in sources.items():
            kept = ["--record", folder / f"{name}.mcap", "-o", folder / f"{name}.json"]
            watches[name] = end.enter_context(command("watch", source, "--rules", RULES, *kept, *SERVED))
            screens[name], told[name] = said(watches[name], "screen: ").rpartition(" ")[2], []
            threading.Thread(target=states_of, args=(screens[name], told[name]), daemon=True).start()
        page = end.enter_context(browser_page(screens["direct"]))
        recorder, cell = recording(ros, folder / "trial"), ros.python(HERE / "cell", "long")
        until(
            lambda: bool(told["direct"]) and told["direct"][-1][0] > APPROACHING_S, "the person comes nearer"
        )
        picture(page, folder / "1-approaching.png")
        seen(page, "Violated now")
        time.sleep(1.5)
        picture(page, folder / "2-violated.png")
        ros.run("/usr/bin/rosservice", "call", CALLED, SHIPMENT)
        assert ros.wait(cell, LIMIT_S) == 0, ros.said(cell)
        assert ros.wait(recorder, LIMIT_S) == 0, ros.said(recorder)
        for watch in watches.values():
            said(watch, "the screen stays")
        time.sleep(0.5)
        picture(page, folder / "3-over.png")
        for process in (*watches.values(), node, oracle):
            process.send_signal(signal.SIGINT)
            process.wait(LIMIT_S)
    return told


def picture(page: Page, file: Path) -> None:
    """What is on a page now."""
    page.screenshot(path=file)


def row(name: str, log: Path, said_then: Path | None = None) -> str:
    """A line of the table: what a log is worth, and whether that was said when it was written."""
    result = score_trial(log, RULES)
    found = [f for f in result.measured.findings.values() if f.check == "separation"]
    violated = [f for f in found if f.verdict is Verdict.VIOLATED]
    worst_m = min((f.robustness for f in violated if f.robustness is not None), default=float("nan"))
    too_close_s = sum(f.span.duration_s for f in violated if f.span)
    same = ""
    if said_then is not None:
        equal = said_then.read_text(encoding="utf-8") == as_json(result)
        same = "the same bytes" if equal else "**other bytes**"
    return f"| {name} | {result.score} | {too_close_s:.3f} s | {-worst_m:.6f} | {same} |"


def delays(record: Path, told: Sequence[tuple[float, float]]) -> list[float]:
    """From the stamp of a transform to its arrival, and from there to the screen: p50 and p99 of each, ms."""
    received = [one for one in source_items(open_scan(record, jobs=1)) if isinstance(one, Received)]
    arrived_s = np.array([one.message.stamp_ns for one in received]) / 1e9
    # A message of transforms begins with their number and the header of the first: its number, its stamp.
    heads = {
        i: struct.unpack_from("<4I", one.message.payload)
        for i, one in enumerate(received)
        if one.message.connection.topic == "/tf"
    }
    on_the_way_s = [arrived_s[i] - head[2] - head[3] / 1e9 for i, head in heads.items()]
    elapsed_s, at_s = np.array(told).T
    held_by = np.searchsorted(elapsed_s, arrived_s - arrived_s[0])
    shown_s = (at_s[held_by[held_by < len(at_s)]]) - arrived_s[held_by < len(at_s)]
    return [float(p) for found in (on_the_way_s, shown_s) for p in np.percentile(found, [50, 99]) * 1e3]


def wall(ros: RobotOs, folder: Path, sources: dict[str, str]) -> None:
    """Show a second trial on a wall: by both sources, by the bag that grows, and the first one again."""
    bag = folder / "second.bag.active"
    recorder = recording(ros, folder / "second")
    until(bag.exists, "the bag is written")
    cells = [*(f"{name}={source}" for name, source in sources.items()), f"bag={bag}"]
    cells += [f"yesterday=replay:{folder / 'direct.mcap'}"]
    with ExitStack() as end:
        options = [part for cell_ in cells for part in ("--cell", cell_)]
        watch = end.enter_context(
            command(
                "watch", *options, "--rules", RULES, "--serve", "127.0.0.1:0", "--record", folder / "wall"
            )
        )
        page = end.enter_context(browser_page(said(watch, "screen: ").rpartition(" ")[2]))
        cell = ros.python(HERE / "cell", "long")
        seen(page, "Violated now")
        time.sleep(1.5)
        picture(page, folder / "4-wall.png")
        ros.run("/usr/bin/rosservice", "call", CALLED, SHIPMENT)
        assert ros.wait(cell, LIMIT_S) == 0, ros.said(cell)
        assert ros.wait(recorder, LIMIT_S) == 0, ros.said(recorder)
        said(watch, "the screen stays")
        picture(page, folder / "5-wall-over.png")
        watch.send_signal(signal.SIGINT)
        watch.wait(LIMIT_S)


# What runs ---------------------------------------------------------------------------------


def recording(ros: RobotOs, out: Path) -> subprocess.Popen[bytes]:
    """The recorder that is shipped, with `rosbag`."""
    record = [PROGRAM, "record", "--rules", RULES, "-o", out.name, "--key", "organiser", "--forward", "--run"]
    if not (ros.folder / "organiser").exists():
        new = [PROGRAM, "sign", "--new-key", ros.folder / "organiser"]
        subprocess.run(new, input=b"\n", check=True, capture_output=True, timeout=LIMIT_S)
    recorder = ros.start(*record)
    ros.until(recorder, "recording ", LIMIT_S)
    return recorder


@contextmanager
def command(*arguments: str | Path) -> Iterator[subprocess.Popen[str]]:
    """A command of ours while it runs."""
    with subprocess.Popen(
        [PROGRAM, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as one:
        try:
            yield one
        finally:
            one.kill()


def said(process: subprocess.Popen[str], words: str) -> str:
    """The line in which a process says something."""
    assert process.stderr is not None
    killer = threading.Timer(LIMIT_S, process.kill)
    killer.start()
    lines = []
    for line in process.stderr:
        lines.append(line)
        if words in line:
            killer.cancel()
            return line.strip()
    raise SystemExit(f"never said {words!r}:\n{''.join(lines)}")


@contextmanager
def relayed(address: str) -> Iterator[str]:
    """A server of the Foxglove SDK that offers what a cell publishes; its address."""
    relay, over = source_at(address), threading.Event()
    relay.open(None)
    with bridge() as server:

        def pass_on() -> None:
            while not over.is_set():
                item = relay.next(0.02)
                if isinstance(item, Announced):
                    channel, end_s = server.offer(item.connection), time.monotonic() + SUBSCRIBED_S
                    # A bridge keeps nothing for those who come late; topics that nobody wants have none.
                    while not channel.has_sinks() and time.monotonic() < end_s:
                        over.wait(0.01)
                elif isinstance(item, Received):
                    server.send(item.message)

        passing = threading.Thread(target=pass_on, daemon=True)
        passing.start()
        try:
            yield server.address
        finally:
            over.set()
            passing.join(LIMIT_S)
            relay.close()


def states_of(url: str, told: list[tuple[float, float]]) -> None:
    """Note of each state that a screen is told how old the trial is in it, and when it came."""
    with suppress(OSError), urlopen(f"{url}events", timeout=LIMIT_S) as stream:  # noqa: S310  # ours
        for line in stream:
            if line.startswith(b"data: "):
                told.append((json.loads(line[6:])["t"], time.time()))


@contextmanager
def browser_page(address: str) -> Iterator[Page]:
    """A page in Chromium."""
    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        page.goto(address)
        yield page
        browser.close()


def seen(page: Page, words: str) -> None:
    """Wait until a page says something."""
    page.get_by_text(words).first.wait_for(timeout=LIMIT_S * 1e3)


def until(holds: Callable[[], bool], what: str) -> None:
    """Wait until something holds."""
    end_s = time.monotonic() + LIMIT_S
    while not holds():
        if time.monotonic() > end_s:
            raise SystemExit(f"{what}: not within {LIMIT_S:g} s")
        time.sleep(0.02)


def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve())
