"""How much dearer than the bare distances is a verdict about them?

`ssm_separation` (episodes, speeds, gaps, evidence, pairs, formula) over 60 000 samples of a
robot with 30 links and 3 humans, against numpy computing nothing but the smallest distance of
each human to any link. Both in one process, alternately; the median of the ratios counts.

    python benchmarks/separation.py [--samples 60000] [--rounds 5]
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time

import numpy as np
from numpy.typing import NDArray

from ariac_score import Body, Signal, Trial, load_log_map
from ariac_score.checks.registry import Registry
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.nearest import nearest_distances
from ariac_score.trial.spans import Span

LINKS, HUMANS = 30, 3


def tracks(samples: int, seed: int) -> dict[str, NDArray[np.float64]]:
    """A robot that swings its links and humans that walk past it, at 100 Hz."""
    random = np.random.default_rng(seed)
    t = np.arange(samples) / 100
    found = {}
    for link in range(LINKS):
        phase, reach = random.uniform(0, 6), 0.1 * (link + 1)
        swing = np.stack([reach * np.cos(0.5 * t + phase), reach * np.sin(0.5 * t + phase)], axis=1)
        found[f"robot::link_{link}"] = np.column_stack([swing, np.full(samples, 0.05 * link)])
    for human in range(HUMANS):
        walk = np.stack([4 * np.cos(0.05 * t + 2 * human), 6 * np.sin(0.07 * t + human)], axis=1)
        found[f"human_{human}"] = np.column_stack([walk, np.full(samples, 0.9)])
    return found


def trial_of(positions: dict[str, NDArray[np.float64]], samples: int) -> Trial:
    """The tracks as a trial."""
    t = np.arange(samples) / 100
    bodies = (
        Body("robot", "robot", 0.1, tuple(f"link_{i}" for i in range(LINKS))),
        *(Body(f"human_{i}", "human", 0.3) for i in range(HUMANS)),
    )
    signals = {f"position/{name}": Signal(f"position/{name}", "m", t, xyz) for name, xyz in positions.items()}
    whole = Span(0.0, float(t[-1]))
    return Trial("benchmark", bodies=bodies, signals=signals, recorded=whole, witnessed=frozenset({"bodies"}))


def bare(positions: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """The smallest distance of each human to any link, and nothing else."""
    links = np.stack([positions[f"robot::link_{i}"] for i in range(LINKS)])
    humans = np.stack([positions[f"human_{i}"] for i in range(HUMANS)])
    nearest = np.empty((HUMANS, links.shape[1]))
    for i, human in enumerate(humans):
        nearest[i] = np.sqrt(((links - human) ** 2).sum(axis=2)).min(axis=0)
    return nearest


def broadcast(positions: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """The same in one broadcast."""
    links = np.stack([positions[f"robot::link_{i}"] for i in range(LINKS)])
    humans = np.stack([positions[f"human_{i}"] for i in range(HUMANS)])
    apart = ((links[None] - humans[:, None]) ** 2).sum(axis=3)
    nearest: NDArray[np.float64] = np.sqrt(apart).min(axis=1)
    return nearest


def ours(positions: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
    """The same as `derive_signals` does it, from the tracks as the log gives them."""
    links = [positions[f"robot::link_{i}"] for i in range(LINKS)]
    return nearest_distances(links, [[positions[f"human_{i}"]] for i in range(HUMANS)])


def compare_minimum(positions: dict[str, NDArray[np.float64]], rounds: int) -> None:
    """Print how the minimum distance alone compares with a broadcast."""
    walls, processors = [], []
    assert np.allclose(broadcast(positions), ours(positions), rtol=1e-15, atol=0)
    for _ in range(rounds):
        spent = []
        for way in (broadcast, ours):
            wall, processor = time.perf_counter(), time.process_time()
            way(positions)
            spent.append((time.perf_counter() - wall, time.process_time() - processor))
        walls.append(spent)
        processors.append(spent[0][1] / spent[1][1])
    theirs, mine = (statistics.median(spent[i][0] for spent in walls) for i in (0, 1))
    ratio = statistics.median(a[0] / b[0] for a, b in walls)
    print(
        f"minimum   broadcast {theirs * 1e3:.0f} ms, ours {mine * 1e3:.0f} ms, {ratio:.1f} times faster "
        f"({statistics.median(processors):.1f} by processor time)"
    )


def main() -> None:
    """Print the times and the ratio."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--samples", type=int, default=60_000)
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    positions = tracks(arguments.samples, seed=15066)
    trial = trial_of(positions, arguments.samples)
    plugin = Registry().find("ariac_score.monitors", "iso_ts_15066.ssm_separation")
    window_s = load_log_map("ariac2020").speed_window_s
    what = f"{arguments.samples} samples, {LINKS} links, {HUMANS} humans"
    print(f"{what}; Python {platform.python_version()}, numpy {np.__version__}")
    compare_minimum(positions, arguments.rounds)
    for profile in ("seed", "standard"):
        monitor = plugin.build({"profile": profile})
        wanted = [Derivation(need.quantity, need.max_gap_s) for need in monitor.needs()]
        times: dict[str, list[float]] = {"bare": [], "verdict": []}
        for _ in range(arguments.rounds):
            start = time.perf_counter()
            bare(positions)
            times["bare"].append(time.perf_counter() - start)
            start = time.perf_counter()
            findings = list(monitor.watch(derive_signals(trial, wanted, speed_window_s=window_s)))
            times["verdict"].append(time.perf_counter() - start)
        ratio = statistics.median(b / a for a, b in zip(times["bare"], times["verdict"], strict=True))
        print(
            f"{profile:9} bare {statistics.median(times['bare']):.3f} s, verdict "
            f"{statistics.median(times['verdict']):.3f} s, {ratio:.1f} times, {len(findings)} findings"
        )


if __name__ == "__main__":
    main()
