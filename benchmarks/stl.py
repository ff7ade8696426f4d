"""`stl.formula` and rtamt's discrete offline monitor: one run, alternating rounds, medians and ratios.

    python benchmarks/stl.py [--rtamt PYTHON] [--samples 60000] [--rounds 3]
    python benchmarks/stl.py --own

`--own` compares with nobody: ten minutes at 500 Hz, how long they take, how much memory at its peak,
and what one instant costs while the trial goes on.

rtamt pins an old antlr, so it runs in a Python of its own (`pip install rtamt`), kept
alive between rounds. Its clock covers `evaluate` on lists that are ready; ours covers
everything from the trial's columns to findings: aligned signals, gaps, margins of every
sub-formula, both bounds, episodes, worst samples, reasons and evidence.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import time
import tracemalloc
from typing import IO

import numpy as np

from ariac_score import Body, Signal, Span, Trial
from ariac_score_stl import StlFormula

CASES = [
    ("keep 0.5 m", "always d > 0.5", "always(d > 0.5)", 30),
    ("both limits", "always (d > 0.5 and v < 1)", "always((d > 0.5) and (v < 1))", 30),
    (
        "recently far",
        "always (v > 0.5 -> once[0,1] d > 1)",
        "always((v > 0.5) implies (once[0:1](d > 1)))",
        30,
    ),
    ("until, 0.1 s", "always (d > 0.5 until[0,0.1] v < 0.9)", "always((d > 0.5) until[0:0.1] (v < 0.9))", 30),
    (
        "stop in 0.5 s",
        "always (d < 1 -> eventually[0,0.5] v < 0.1)",
        "always((d < 1) implies (eventually[0:0.5](v < 0.1)))",
        100,
    ),
    ("always[0,60]", "always (always[0,60] d > 0.5)", "always[0:60](d > 0.5)", 100),
]
"""Name, our formula, rtamt's, the least ratio wanted."""

OWN_CASES = [
    ("since", "always (d > 0.5 since[0.1,0.5] v < 0.9)"),
    ("unbounded", "always (d < 1 -> eventually v < 0.1 or once d > 2)"),
]

_PEER = """
import json, sys, time, rtamt
columns = json.loads(sys.stdin.readline())
for line in sys.stdin:
    specification = rtamt.StlDiscreteTimeSpecification()
    for name in ("d", "v", "out"):
        specification.declare_var(name, "float")
    specification.set_sampling_period(10, "ms", 0.1)
    specification.spec = "out = " + json.loads(line)
    specification.parse()
    started = time.perf_counter()
    specification.evaluate(columns)
    print(time.perf_counter() - started, flush=True)
"""


def _columns(samples: int, rate_hz: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t = np.arange(samples) / rate_hz
    noise = np.random.default_rng(2020).normal(0, 0.01, (2, len(t)))
    d = np.abs(2 * np.sin(t / 7)) + 0.6 + noise[0]
    return t, d, np.clip(d - 0.9 + noise[1], 0, 1)


def _trial(samples: int, rate_hz: int) -> Trial:
    t, d, v = _columns(samples, rate_hz)
    signals = [
        Signal("centre_distance/robot/human", "m", t, d),
        Signal("speed/robot", "m/s", t, v),
    ]
    bodies = (Body("human", "human"), Body("robot", "robot"))
    return Trial(
        "benchmark",
        bodies=bodies,
        signals={s.name: s for s in signals},
        recorded=Span(float(t[0]), float(t[-1])),
    )


def _monitor(formula: str) -> StlFormula:
    names = {"d": "centre_distance in m", "v": "speed of robot in m/s"}
    return StlFormula(formula=formula, signals={n: s for n, s in names.items() if f"{n} " in formula})


def _ours(formula: str, trial: Trial) -> tuple[float, int]:
    monitor = _monitor(formula)
    started = time.perf_counter()
    findings = list(monitor.watch(trial))
    return time.perf_counter() - started, len(findings)


def _theirs(formula: str, peer: subprocess.Popen[str]) -> float:
    to: IO[str] | None = peer.stdin
    back: IO[str] | None = peer.stdout
    assert to
    assert back
    to.write(json.dumps(formula) + "\n")
    to.flush()
    return float(back.readline())


def _online_us(formula: str, trial: Trial) -> float:
    """What an instant costs while the trial goes on, microseconds; NaN where it is judged at the end."""
    watch = _monitor(formula).begin(trial.bodies)
    signals = list(trial.signals.values())
    instants = [[signal.sample(row) for signal in signals] for row in range(len(signals[0]))]
    started = time.process_time()
    judged = sum(1 for samples in instants for _ in watch.step(samples))
    took_s = time.process_time() - started
    return took_s / len(instants) * 1e6 if judged else math.nan


def _peak_bytes(formula: str, trial: Trial) -> int:
    tracemalloc.start()
    for _ in _monitor(formula).watch(trial):
        pass
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return peak


def own() -> None:
    """What formulas cost, in time and memory."""
    trial, short = _trial(300_000, 500), _trial(35_000, 500)  # as long as the longest window, and more
    print("| formula | whole trial | peak memory | for each sample | an instant while it goes on |")
    print("|---|---|---|---|---|")
    for _, formula, *_ in [*CASES, *OWN_CASES]:
        took_s = min(_ours(formula, trial)[0] for _ in range(5))
        peak, instant_us = _peak_bytes(formula, trial), _online_us(formula, short)
        instant = "at the end only" if math.isnan(instant_us) else f"{instant_us:.0f} µs"
        print(
            f"| `{formula}` | {took_s * 1e3:.0f} ms | {peak / 1e6:.0f} MB | {peak / 300_000:.0f} bytes "
            f"| {instant} |"
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rtamt", default=os.environ.get("ARIAC_SCORE_RTAMT_PYTHON", sys.executable))
    parser.add_argument("--samples", type=int, default=60_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--own", action="store_true", help="what formulas cost; without rtamt")
    arguments = parser.parse_args()
    if arguments.own:
        own()
        return
    t, d, v = _columns(arguments.samples, 100)
    trial = _trial(arguments.samples, 100)
    peer = subprocess.Popen(
        [arguments.rtamt, "-c", _PEER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with peer:
        assert peer.stdin
        peer.stdin.write(json.dumps({"time": t.tolist(), "d": d.tolist(), "v": v.tolist()}) + "\n")
        print(f"{arguments.samples} samples at 100 Hz, {arguments.rounds} alternating rounds, medians")
        print(f"Python {platform.python_version()}, numpy {np.__version__}")
        print(f"{'formula':16}{'rtamt ms':>10}{'ours ms':>10}{'ratio':>8}{'wanted':>7}{'findings':>10}")
        for name, formula, theirs, wanted in CASES:
            rounds: list[tuple[float, float]] = []
            count = 0
            for _ in range(arguments.rounds):
                their_s = _theirs(theirs, peer)
                tries = []
                for _ in range(5):
                    our_s, count = _ours(formula, trial)
                    tries.append(our_s)
                rounds.append((their_s, statistics.median(tries)))
            their_s, our_s = (statistics.median(side) for side in zip(*rounds, strict=True))
            print(
                f"{name:16}{their_s * 1e3:10.1f}{our_s * 1e3:10.2f}{their_s / our_s:8.0f}{wanted:7}{count:10}"
            )
        peer.stdin.close()


if __name__ == "__main__":
    main()
