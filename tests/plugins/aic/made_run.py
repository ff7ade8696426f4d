"""The run of `examples/aic`: an insertion made from the definitions, without ground truth as officially.

`python -m tests.plugins.aic.made_run examples/aic` writes it again.
"""

from __future__ import annotations

import math
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ariac_score.testing.repacked import McapForm, repacked
from ariac_score_aic.scoring_file import OfficialRun, OfficialTrial, Tier, sum_in_order, written

from .made_bags import write_run

START_S, END_S, LAST_S = 103.0, 131.5, 131.7
"""Of the task, of the recording: simulated time."""
STEP_S = 0.02
PORT_M = (0.45, 0.10, 1.02)
DEPTH_M = 0.0458
CONNECTION = {
    "cable_name": "cable_0",
    "plug_name": "sfp_tip",
    "target_module_name": "nic_card_mount_0",
    "port_name": "sfp_port_0",
}
IDENTITY = [0.0, 0.0, 0.0, 1.0]
BASE_M = (0.0, 0.2, 0.9)

PUSH_S = (124.0, 124.9)
"""While the plug stands on the edge of the entrance and is pushed: 0.9 s above 20 N, where 1 s costs."""

DURATION = 12 * (60 - (END_S - START_S)) / 55
"""The points for it, by the formula of the scorer."""


def exactly(value: float) -> float:
    """A number with few binary digits, so that the recording stays small."""
    return round(value * 2**20) / 2**20


def plug_m(t_s: float) -> tuple[float, float, float]:
    """Where the plug is: it waits, comes over the port in an arc, stands on its edge, and sinks in."""
    share = min(max((t_s - 104.0) / 16.0, 0.0), 1.0)
    smooth = share * share * (3 - 2 * share)
    x, y = 0.25 + (PORT_M[0] - 0.25) * smooth, 0.30 + (PORT_M[1] - 0.30) * smooth
    height = 0.20 + (DEPTH_M + 0.005 - 0.20) * smooth + 0.06 * math.sin(math.pi * share)
    y += 0.04 * math.sin(math.pi * share) + 0.002 * math.sin(9.0 * t_s) * (0 < share < 1)
    down = min(max((t_s - 121.0) / 3.0, 0.0), 1.0)
    sink = min(max((t_s - 126.0) / 4.0, 0.0), 1.0)
    height -= 0.006 * down + (DEPTH_M - 0.002) * sink * sink * (3 - 2 * sink)
    return exactly(x), exactly(y), exactly(PORT_M[2] + height)


def speed_m_s(t_s: float) -> list[float]:
    """The tool's velocity, by differences of where it is."""
    before, after = plug_m(t_s - 0.02), plug_m(t_s + 0.02)
    return [exactly((b - a) / 0.04) for a, b in zip(before, after, strict=True)]


def force_n(t_s: float) -> list[float]:
    """What the wrist feels, with the weight of the gripper in it."""
    push = 24.0 if PUSH_S[0] <= t_s < PUSH_S[1] else 6.0 if t_s > 121.0 else 0.5
    return [exactly(0.3 * math.sin(3.0 * t_s)), 0.0, exactly(12.0 + push)]


def still(parent: str, child: str, at_m: tuple[float, float, float], stamp_ns: int) -> dict[str, Any]:
    return {
        "parent": parent,
        "child": child,
        "stamp_ns": stamp_ns,
        "translation": list(at_m),
        "rotation_xyzw": IDENTITY,
    }


def board(stamp_ns: int) -> dict[str, Any]:
    port = "task_board/nic_card_mount_0/sfp_port_0_link"
    listed = [
        still("aic_world", "task_board", (0.4, 0.1, 1.0), stamp_ns),
        still("task_board", port, (0.05, 0.0, 0.02), stamp_ns),
        still("task_board", f"{port}_entrance", (0.05, 0.0, 0.02 + DEPTH_M), stamp_ns),
    ]
    return {"topic": "/scoring/tf", "transforms": listed}


def messages() -> Iterator[Mapping[str, Any]]:
    """The messages of the recording, in the order of their times."""
    begin_ns = round((START_S - 1) * 1e9)
    fixed = [
        still("world", "base_link", BASE_M, begin_ns),
        still("wrist_3_link", "gripper/tcp", (0.0, 0.0, -0.16), begin_ns),
    ]
    yield {"topic": "/tf_static", "transforms": fixed}
    steps = round((LAST_S - START_S + 1) / STEP_S)
    for step in range(steps + 1):
        t_s = START_S - 1 + step * STEP_S
        stamp_ns = round(t_s * 500) * 2_000_000
        at = plug_m(t_s)
        wrist = tuple(a - b - c for a, b, c in zip(at, BASE_M, (0.0, 0.0, -0.25), strict=True))
        tool = still("base_link", "wrist_3_link", wrist, stamp_ns)
        yield {"topic": "/tf", "transforms": [tool]}
        plug = still("aic_world", "cable_0/sfp_tip_link", at, stamp_ns)
        yield {"topic": "/scoring/tf", "transforms": [plug]}
        if step % 50 == 0:
            yield board(stamp_ns)
        yield {
            "topic": "/aic_controller/controller_state",
            "stamp_ns": stamp_ns,
            "tcp_velocity_linear": speed_m_s(t_s),
            "fts_tare_offset_force": [0.0, 0.0, 12.0],
        }
        yield {"topic": "/fts_broadcaster/wrench", "stamp_ns": stamp_ns, "force": force_n(t_s)}
        if step % 10 == 0:
            yield {"topic": "/aic/gazebo/contacts/off_limit", "contacts": []}
        if START_S + 0.4 <= t_s <= END_S and step % 50 == 0:
            yield {"topic": "/aic_controller/pose_commands", "log_time_ns": stamp_ns + 1_000_000}
        if abs(t_s - 131.2) < STEP_S / 2:
            yield {"topic": "/scoring/insertion_event", "data": "/nic_card_mount_0/sfp_port_0"}


def jerk_m_s3() -> float:
    """The mean jerk of the tool, window by window, with the fit of numpy."""
    states = [m for m in messages() if "tcp_velocity_linear" in m]
    t_s = np.array([m["stamp_ns"] // 10**9 + m["stamp_ns"] % 10**9 * 1e-9 for m in states])
    velocity = np.array([m["tcp_velocity_linear"] for m in states])
    weighted, weights = 0.0, 0.0
    for i in range(7, len(t_s) - 7):
        if np.linalg.norm(velocity[i]) > 0.01:
            window = slice(i - 7, i + 8)
            jerk = 2 * np.polyfit(t_s[window] - t_s[i], velocity[window], 2)[0]
            weight = (t_s[i + 7] - t_s[i - 7]) / 15
            weighted, weights = weighted + float(np.linalg.norm(jerk)) * weight, weights + weight
    return weighted / weights


def official() -> OfficialRun:
    """What the engine would write of the run: worked out here, by the formulas of its scorer."""
    lasts_s, jerk = END_S - START_S, jerk_m_s3()
    pushed = (
        "Insertion force above 20.00 N, detected for a time of 0.90 seconds. Max detected force: 24.00N. "
        "This is below the threshold of 1.00 seconds. Penalty not applied."
    )
    path = "Total end-effector path length: 0.00 m, initial plug-port distance: 0.35 m"
    moved = f"Average linear jerk magnitude of the end effector: {jerk:.2f} m/s^3"
    categories = (
        ("contacts", Tier(0.0, "No contact detected.")),
        ("duration", Tier(DURATION, f"Task duration: {lasts_s:.2f} seconds.")),
        ("insertion force", Tier(0.0, pushed)),
        ("trajectory efficiency", Tier(6.0, path)),
        ("trajectory smoothness", Tier(6 * (50 - jerk) / 50, moved)),
    )
    second = Tier(sum_in_order(one.score for _, one in categories), "Scoring succeeded.", categories)
    tiers = (Tier(1.0, "Model validation succeeded."), second, Tier(75.0, "Cable insertion successful."))
    total = sum_in_order(one.score for one in tiers)
    return OfficialRun("scoring.yaml", total, (OfficialTrial("trial_1", tiers),))


def write_example(folder: Path) -> Path:
    """Write the run; returns the recording."""
    times = {"start_ns": round(START_S * 1e9), "end_ns": round(END_S * 1e9)}
    run = folder / "run"
    shutil.rmtree(run, ignore_errors=True)
    bag = write_run(run, list(messages()), connections=[CONNECTION], times=times)
    for file in bag.glob("*.mcap"):
        file.write_bytes(repacked(file.read_bytes(), McapForm("zstd", chunk_bytes=1 << 20)))
    right = written(official())
    (run / "scoring.yaml").write_text(right, encoding="utf-8")
    wrong = right.replace(f"score: {DURATION}", "score: 7.8727272727272731")
    (folder / "disputed_scoring.yaml").write_text(wrong, encoding="utf-8")
    return bag


if __name__ == "__main__":
    write_example(Path(sys.argv[1]))
