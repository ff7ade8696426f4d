"""How fast recordings are read, against others: medians of ratios of alternated runs in fresh processes.

Prints for each way the seconds it took, the seconds of processor time (of all threads), what the
latter are as a multiple of ours, and the peak of memory. Imports count. On a machine that others
use, only processor time can be compared.

    python benchmarks/read.py [--rounds 5] [--seconds 600] [--folder DIR] [--only PART]
    python benchmarks/read.py --profile PART [--way ours]

Writes the recordings it needs (seeded), once. `ours` brings the wanted fields of five topics
into arrays, all checksums verified; `rosbags` deserialises the same messages; `floor` reads
and inflates the file on one thread and looks at nothing. Before each run, of whatever way, the file
is read and memory is touched, so that none pays for what a virtual machine had given back to its
host; `--cold` leaves that out.

`--profile` reads one recording within this process and prints in which functions the time goes. Of other
threads, which inflate and verify, it sees nothing; and small functions look slower in it than they are.
"""

from __future__ import annotations

import argparse
import cProfile
import importlib.util
import os
import pstats
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

from recordings import write, write_state_log
from ways import WAYS

COLD = False

LOG_MAP = """
id: benchmark_map
title: The made trial of the benchmark
source: made
bodies: {human: {kind: human}}
channels:
  - topic: /human/state
    type: nav_msgs/msg/Odometry
    signals:
      position/human: [pose.pose.position.x, pose.pose.position.y, pose.pose.position.z]
      velocity/human: [twist.twist.linear.x, twist.twist.linear.y, twist.twist.linear.z]
  - {topic: /tf, type: tf2_msgs/msg/TFMessage, poses: frames}
frames: [{match: wrist_3, kind: robot, body: robot}]
"""

RULES = """
id: benchmark_rules
title: One monitor over the made trial of the benchmark
source: made
log_map: benchmark_map.yaml
monitors:
  human_contact:
    use: ariac.human_contact
    with: {distance: centre_distance, contact_distance_m: 0.01, max_gap_s: 0.15}
score: 1
"""

TRIAL = """
options: {gazebo_state_logging: true, current_gripper_type: gripper_part}
time_limit: -1
orders:
  order_0:
    priority: 1
    kitting_robot_health: 1
    assembly_robot_health: 1
    announcement_condition: time
    announcement_condition_value: 0.0
    kitting:
      shipment_count: 1
      trays: [movable_tray_dark_wood]
      agvs: [agv2]
      destinations: [as2]
      products:
        part_0:
          type: assembly_battery_blue
          pose: {xyz: [0.1, 0.1, 0.0], rpy: [0.0, 0.0, 0.0]}
"""

CASES = [
    ("mcap", "", False),
    ("mcap", "lz4", False),
    ("mcap", "zstd", False),
    ("bag", "", False),
    ("bag", "lz4", False),
    ("db3", "", False),
    ("mcap", "", True),
    ("mcap", "lz4", True),
]


def bundled(path: Path) -> None:
    """Put a recording into a folder with the trial's configuration, for the whole command."""
    folder = path.parent / "scored"
    folder.mkdir(exist_ok=True)
    for name, text in (("benchmark_rules.yaml", RULES), ("benchmark_map.yaml", LOG_MAP)):
        (path.parent / name).write_text(text, encoding="utf-8")
    (folder / "trial.yaml").write_text(TRIAL, encoding="utf-8")
    (folder / "bundle.yaml").write_text("logs: [made.mcap]\ntrial_config: trial.yaml\n", encoding="utf-8")
    (folder / "made.mcap").unlink(missing_ok=True)
    (folder / "made.mcap").hardlink_to(path.resolve())


WARM_UP = """
import sys, numpy as np
with open(sys.argv[1], "rb", buffering=0) as file:
    room = bytearray(1 << 20)
    while file.readinto(room):
        pass
large = [np.ones(1 << 22) for _ in range(16)]
del large
small = [np.ones(1 << 14) for _ in range(1 << 11)]
"""


def warm_up(path: Path) -> None:
    """Read the file and touch half a gigabyte.

    A virtual machine hands memory that nobody used for seconds back to its host, and so it does
    with cached files. To get it again takes longer than what is measured, and whoever comes first
    would pay for it.
    """
    subprocess.run([sys.executable, "-c", WARM_UP, str(path)], check=True)


def measured(way: str, path: Path) -> tuple[float, float, float, int]:
    """Seconds, processor seconds, peak memory in MB, and messages, of a fresh process."""
    command = [sys.executable, str(Path(__file__).with_name("ways.py")), way, str(path)]
    # An installation has its bytecode compiled, so a checkout is measured with its own compiled too.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(Path(tempfile.gettempdir(), "ariac-score-benchmark-bytecode"))
    if not COLD:
        warm_up(path)
    start = time.perf_counter()
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    seconds = time.perf_counter() - start
    processor, memory, count = done.stdout.split()
    return seconds, float(processor), float(memory), int(count)


def compared(path: Path, ways: list[str], rounds: int) -> None:
    """Print the ways beside the first of them, which is ours."""
    runs: dict[str, list[tuple[float, float, float, int]]] = {way: [] for way in ways}
    for _ in range(rounds):
        for way in ways:
            runs[way].append(measured(way, path))
    ours = runs[ways[0]]
    for way in ways:
        seconds, processor, memory, counts = zip(*runs[way], strict=True)
        by_wall, by_processor = (
            median(r[i] / o[i] for r, o in zip(runs[way], ours, strict=True)) for i in (0, 1)
        )
        print(
            f"{path.name:24} {way:10} {median(seconds):8.2f} s {median(processor):8.2f} s cpu"
            f" {by_wall:7.2f} x ours, {by_processor:7.2f} x by cpu {max(memory):7.0f} MB {counts[0]:>10}",
            flush=True,
        )


def start_up(rounds: int) -> None:
    """Print how much longer than an idle Python our quickest commands take."""
    idle = [sys.executable, "-c", "pass"]
    commands = {
        "--version": [sys.executable, "-m", "ariac_score.cli", "--version"],
        "rules validate": [
            sys.executable,
            "-m",
            "ariac_score.cli",
            "rules",
            "validate",
            "ariac2020.official",
        ],
    }
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(Path(tempfile.gettempdir(), "ariac-score-benchmark-bytecode"))

    def spent(command: list[str]) -> tuple[float, float]:
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        # Elsewhere, so that what is installed is measured and not what lies here.
        subprocess.run(command, check=True, capture_output=True, env=environment, cwd=tempfile.gettempdir())
        seconds, after = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_CHILDREN)
        return seconds, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime

    for name, command in commands.items():
        spent(command)
        pairs = [(spent(idle), spent(command)) for _ in range(4 * rounds)]
        more = [median(c[i] - p[i] for p, c in pairs) * 1e3 for i in (0, 1)]
        print(f"{name:24} {more[0]:+6.0f} ms, {more[1]:+6.0f} ms cpu over python -c pass", flush=True)


def profiled(way: str, path: Path) -> None:
    """Print the functions in which most of the time goes: own seconds, calls, name."""
    warm_up(path)
    WAYS[way](path)  # whatever is loaded late
    # Of this thread the processor time, which is the same whatever else the machine does.
    profile = cProfile.Profile(time.thread_time)
    start = time.thread_time()
    profile.runcall(WAYS[way], path)
    seconds = time.thread_time() - start
    # Of one function its place, (calls, of them not recursive, own seconds, all seconds, callers).
    entries = pstats.Stats(profile).stats.items()  # type: ignore[attr-defined]
    print(f"{way} of {path.name}: {seconds:.2f} s of processor time under cProfile")
    for (file, line, name), (_, calls, own, _, _) in sorted(entries, key=lambda e: -e[1][2])[:14]:
        where = f"{Path(file).name}:{line} {name}" if line else name
        print(f"{own:8.3f} s {100 * own / seconds:4.0f} % {calls:>9}  {where}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=600)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir(), "ariac-score-benchmark"))
    parser.add_argument("--only", default="", help="only recordings whose name contains this")
    parser.add_argument("--peers", action="store_true", help="also mcap-ros2-support and pybag-sdk")
    parser.add_argument("--cold", action="store_true", help="do not touch file and memory before each run")
    parser.add_argument("--profile", metavar="PART", help="the first recording whose name contains this")
    parser.add_argument("--way", default="ours", choices=WAYS, help="what is profiled")
    given = parser.parse_args()
    global COLD  # noqa: PLW0603  # an option of the whole run
    COLD = given.cold
    given.folder.mkdir(parents=True, exist_ok=True)
    only = given.only if given.profile is None else given.profile
    for suffix, compression, camera in CASES:
        name = f"{compression or 'none'}{'_camera' if camera else ''}_{given.seconds:g}s.{suffix}"
        if only not in name or (camera and "camera" not in only and only):
            continue
        path = given.folder / name
        if not path.exists():
            write(path, compression, seconds=given.seconds, camera=camera)
        if given.profile is not None:
            profiled(given.way, path)
            return
        ways = ["ours", "rosbags", "floor"]
        if given.peers and suffix == "mcap" and not camera:
            ways += [w for w in ("mcap_ros2", "pybag") if importlib.util.find_spec(w)]
        compared(path, ways, given.rounds)
        if suffix == "mcap" and not compression and not camera:
            compared(path, ["ours_all", "rosbags"], given.rounds)
        if name.startswith("lz4") and suffix == "mcap" and not camera:
            bundled(path)
            compared(path, ["score", "rosbags_scored"], given.rounds)
    if given.only in "state.log":
        path = given.folder / f"{given.seconds:g}s_state.log"
        if not path.exists():
            write_state_log(path, seconds=given.seconds)
        compared(path, ["state_log", *(["lxml"] if importlib.util.find_spec("lxml") else [])], given.rounds)
    if given.only in "start-up":
        start_up(given.rounds)


if __name__ == "__main__":
    main()
