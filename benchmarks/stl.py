"""`stl.formula` beside rtamt's discrete offline monitor: one run, alternating rounds, medians and ratios.

    python benchmarks/stl.py [--rtamt PYTHON] [--samples 60000] [--rounds 3]

rtamt pins an old antlr, so it runs in a Python of its own (`pip install rtamt`), kept
alive between rounds. Its clock covers `evaluate` on lists that are ready; ours covers
everything from the trial's columns to findings: aligned signals, gaps, margins of every
sub-formula, both bounds, episodes, worst samples, reasons and evidence.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import time
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
"""Name, our formula, rtamt's, the least ratio asked for."""

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


def _trial(t: np.ndarray, d: np.ndarray, v: np.ndarray) -> Trial:
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


def _ours(formula: str, trial: Trial) -> tuple[float, int]:
    names = {"d": "centre_distance in m", "v": "speed of robot in m/s"}
    used = {n: s for n, s in names.items() if f"{n} " in formula}
    monitor = StlFormula(formula=formula, signals=used)
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


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rtamt", default=os.environ.get("ARIAC_SCORE_RTAMT_PYTHON", sys.executable))
    parser.add_argument("--samples", type=int, default=60_000)
    parser.add_argument("--rounds", type=int, default=3)
    arguments = parser.parse_args()
    t = np.arange(arguments.samples) / 100
    noise = np.random.default_rng(2020).normal(0, 0.01, (2, len(t)))
    d = np.abs(2 * np.sin(t / 7)) + 0.6 + noise[0]
    v = np.clip(d - 0.9 + noise[1], 0, 1)
    trial = _trial(t, d, v)
    peer = subprocess.Popen(
        [arguments.rtamt, "-c", _PEER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    with peer:
        assert peer.stdin
        peer.stdin.write(json.dumps({"time": t.tolist(), "d": d.tolist(), "v": v.tolist()}) + "\n")
        print(f"{arguments.samples} samples at 100 Hz, {arguments.rounds} alternating rounds, medians")
        print(f"Python {platform.python_version()}, numpy {np.__version__}")
        print(f"{'formula':16}{'rtamt ms':>10}{'ours ms':>10}{'ratio':>8}{'asked':>7}{'findings':>10}")
        for name, formula, theirs, asked in CASES:
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
                f"{name:16}{their_s * 1e3:10.1f}{our_s * 1e3:10.2f}{their_s / our_s:8.0f}{asked:7}{count:10}"
            )
        peer.stdin.close()


if __name__ == "__main__":
    main()
