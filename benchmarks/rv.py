"""How fast properties are judged, beside SWI-Prolog, rtamt and reelay: one run, alternating rounds, medians.

    python benchmarks/rv.py [--snapshots 1000000] [--rounds 3] [--only text,columns,windows,oracle]

- *text*: a trace of JSON, a line for each snapshot at 100 Hz; whole commands in fresh processes,
  start and reading included. The peer is SWI-Prolog (`swipl`) with the rules of RML: those of the
  reference where `--rml-monitor DIR` (or ARIAC_SCORE_RML_MONITOR) names a checkout of
  github.com/RMLatDIBRIS/monitor, else those in `benchmarks/prolog`, which are ours and do less.
  No snapshot breaks the property, for there the peer would stop.
- *columns*: the same property on signals in memory. Ours covers everything from a trial's signals to
  findings: alignment, gaps, margins, episodes, worst samples, evidence. rtamt's clock covers
  `evaluate` on lists that are ready; reelay's the calls of `update` with dictionaries that are
  ready, of a margin that is computed beforehand, for it has no arithmetic between signals.
- *windows*: `always[0,60]`, and a robot that stops within 0.5 s of coming too near.
- *oracle*: `benchmarks/oracle.py`.

rtamt and reelay run in a Python of their own, which ARIAC_SCORE_RTAMT_PYTHON and
ARIAC_SCORE_REELAY_PYTHON name (`pip install rtamt`, `pip install reelay`). What is not installed
is skipped with a note. On a machine that others use, compare ratios of processor time.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ariac_score import Body, Monitor, Signal, Span, Trial
from ariac_score.checks.registry import Registry

HERE = Path(__file__).parent
FloatArray = NDArray[np.float64]
Columns = Mapping[str, FloatArray]

SPEC = """\
safe matches {topic: 'snapshot', human_operator_speed: h, robot_speed: r, distance_robot_human_operator: d}
  with d >= h * (1.0 + 1.5) + r * 1.0 + 0.0 + 2.6;
Main = safe*;
"""
COMPILED = """\
:- module('spec', [trace_expression/2, match/2]).
:- use_module(monitor('deep_subdict')).
:- use_module(library('clpr')).
match(_event, safe) :- deep_subdict(_{topic:"snapshot", human_operator_speed:H, robot_speed:R, \
distance_robot_human_operator:D}, _event), {(D>=((((H*(1.0+1.5))+(R*1.0))+0.0)+2.6))}.
trace_expression('Main', Main) :- Main=star(safe).
"""
DRIVER = """\
:- use_module(library(http/json)).
:- use_module(monitor(trace_expressions_semantics)).
:- initialization(main, main).
main :-
    current_prolog_flag(argv, [Spec, Trace|_]), use_module(Spec), trace_expression(_, State),
    open(Trace, read, Stream, [encoding(utf8)]), run(Stream, State, 0).
run(Stream, State, Count) :-
    json_read_dict(Stream, Event, [end_of_file(end)]),
    (   Event == end -> ( may_halt(State) -> format("~w accepted~n", [Count]) ; halt(1) )
    ;   next(State, Event, Next) -> Count1 is Count + 1, run(Stream, Next, Count1)
    ;   format("~w rejected~n", [Count]), halt(1)
    ).
"""
RTAMT = """
import json, sys, time, rtamt
columns = json.loads(sys.stdin.readline())
for line in sys.stdin:
    specification = rtamt.StlDiscreteTimeSpecification()
    for name in ("h", "r", "d", "out"):
        specification.declare_var(name, "float")
    specification.set_sampling_period(10, "ms", 0.1)
    specification.spec = "out = " + json.loads(line)
    specification.parse()
    wall, processor = time.perf_counter(), time.process_time()
    specification.evaluate(columns)
    print(time.perf_counter() - wall, time.process_time() - processor, flush=True)
"""
REELAY = """
import json, sys, time, reelay
columns = json.loads(sys.stdin.readline())
margins = zip(columns["d"], columns["h"], columns["r"])
events = [{"margin": d - (h * 2.5 + r + 2.6)} for d, h, r in margins]
for line in sys.stdin:
    monitor = reelay.discrete_timed_monitor(pattern="{margin >= 0}", semantics=json.loads(line))
    wall, processor = time.perf_counter(), time.process_time()
    for event in events:
        monitor.update(event)
    print(time.perf_counter() - wall, time.process_time() - processor, flush=True)
"""
D_MIN = "d >= h * (1.0 + 1.5) + r * 1.0 + 0.0 + 2.6"
SIGNALS = {"d": "centre_distance in m", "r": "speed of robot in m/s", "h": "speed of human in m/s"}
WINDOWS = [
    ("always[0,60]", "always (always[0,60] d > 0.5)", "always[0:60](d > 0.5)"),
    (
        "stop within 0.5 s",
        "always (d < 3 -> eventually[0,0.5] r < 0.1)",
        "always((d < 3) implies (eventually[0:0.5](r < 0.1)))",
    ),
]
Timed = tuple[float, float]
"""Wall-clock and processor time, s."""


# What is judged --------------------------------------------------------------------------


def columns(count: int, *, least_margin_m: float) -> dict[str, FloatArray]:
    """A robot and a human that come near each other about every 22 s, at 100 Hz."""
    noise = np.random.default_rng(2020).normal(0, 0.01, (3, count))
    t = np.arange(count) / 100
    h = np.abs(np.sin(t / 3)) * 1.6 + noise[0] ** 2
    r = np.abs(np.cos(t / 5)) + noise[1] ** 2
    d = h * 2.5 + r + 2.6 + least_margin_m + np.abs(np.sin(t / 7)) * 3 + noise[2]
    return {"t": t, "h": h, "r": r, "d": d}


def trial(found: Columns) -> Trial:
    """The columns as a trial."""
    t = found["t"]
    signals = [
        Signal("centre_distance/robot/human", "m", t, found["d"]),
        Signal("speed/robot", "m/s", t, found["r"]),
        Signal("speed/human", "m/s", t, found["h"]),
    ]
    bodies = (Body("human", "human"), Body("robot", "robot"))
    recorded = Span(float(t[0]), float(t[-1]))
    return Trial("benchmark", bodies=bodies, signals={s.name: s for s in signals}, recorded=recorded)


def write_trace(path: Path, found: Columns) -> None:
    """A line for each snapshot, numbers as Python writes them."""
    names = ("human_operator_speed", "robot_speed", "distance_robot_human_operator", "time")
    with path.open("w", encoding="utf-8") as file:
        for row in zip(*(found[name].tolist() for name in ("h", "r", "d", "t")), strict=True):
            fields = ", ".join(f'"{name}": {value!r}' for name, value in zip(names, row, strict=True))
            file.write(f'{{"topic": "snapshot", {fields}}}\n')


def monitors() -> Iterator[tuple[str, Monitor]]:
    """The property in three of our ways to say it."""
    registry = Registry()

    def build(name: str, parameters: Mapping[str, Any]) -> Monitor:
        monitor: Monitor = registry.find("ariac_score.monitors", name).build(parameters)
        return monitor

    fields = {
        "human_operator_speed": "speed/{human}",
        "robot_speed": "speed/{robot}",
        "distance_robot_human_operator": "centre_distance/{robot}/{human}",
    }
    yield "rml.spec", build("rml.spec", {"spec": SPEC, "events": {"snapshot": fields}})
    formula = {"formula": f"always {D_MIN}", "signals": SIGNALS, "t_off_s": 1.0}
    yield "stl.formula", build("stl.formula", formula)
    yield "ssm_separation", build("iso_ts_15066.ssm_separation", {"profile": "seed"})


# Clocks ----------------------------------------------------------------------------------


def watched(monitor: Monitor, of: Trial) -> tuple[Timed, int]:
    """How long a monitor takes, and how many findings it makes."""
    wall, processor = time.perf_counter(), time.process_time()
    count = sum(1 for _ in monitor.watch(of))
    return (time.perf_counter() - wall, time.process_time() - processor), count


def often_watched(monitor: Monitor, of: Trial) -> tuple[Timed, int]:
    """The medians of three times."""
    tries = [watched(monitor, of) for _ in range(3)]
    return (median(wall for (wall, _), _ in tries), median(own for (_, own), _ in tries)), tries[0][1]


def ran(command: list[str]) -> Timed:
    """How long a command takes that has to accept the trace."""
    before, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
    after, wall = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - wall
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


class Peer:
    """A library in a Python of its own, kept alive between rounds."""

    def __init__(self, python: str, program: str, found: Columns) -> None:
        command = [python, "-c", program]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        lists = {name: column.tolist() for name, column in found.items()}
        self._send({**lists, "time": lists["t"]})

    def _send(self, value: object) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(json.dumps(value) + "\n")
        self.process.stdin.flush()

    def judge(self, formula: str) -> Timed:
        """How long one formula takes."""
        self._send(formula)
        assert self.process.stdout is not None
        wall, processor = self.process.stdout.readline().split()
        return float(wall), float(processor)

    def close(self) -> None:
        """End it."""
        self.process.communicate()


def peer_python(library: str, variable: str) -> str | None:
    """A Python that has a library: the one that is named, or this one."""
    named = os.environ.get(variable)
    if named or importlib.util.find_spec(library):
        return named or sys.executable
    print(f"{library} is not installed and {variable} names no Python that has it: skipped")
    return None


# Tables ----------------------------------------------------------------------------------


def show(what: str, ours: list[Timed], theirs: list[Timed], count: int, asked: int, remark: str = "") -> None:
    """One line: both sides for each event, and their ratios."""
    own, other = (median(wall for wall, _ in side) for side in (ours, theirs))
    wall, processor = (
        median(b[i] / a[i] for a, b in zip(ours, theirs, strict=True) if a[i] > 0) for i in (0, 1)
    )
    met = "met" if processor >= asked else "missed"
    figures = f"{own / count * 1e6:9.3f}{other / count * 1e6:9.3f}{wall:8.1f}{processor:11.1f}"
    print(f"{what:38}{figures}{asked:7} {met}{remark}", flush=True)


def head(title: str) -> None:
    print(f"\n{title}")
    print(f"{'':38}{'ours us':>9}{'peer us':>9}{'ratio':>8}{'processor':>11}{'asked':>7}")


def texts(arguments: argparse.Namespace, folder: Path) -> None:
    """A trace of JSON."""
    swipl = shutil.which("swipl")
    if swipl is None:
        print("\nswipl is not installed (Debian: swi-prolog): the trace of JSON is skipped")
        return
    monitor = Path(arguments.rml_monitor or HERE / "prolog")
    paths = {name: folder / name for name in ("spec.rml", "spec.pl", "driver.pl", "trace.jsonl")}
    for name, text in (("spec.rml", SPEC), ("spec.pl", COMPILED), ("driver.pl", DRIVER)):
        paths[name].write_text(text, encoding="utf-8")
    write_trace(paths["trace.jsonl"], columns(arguments.snapshots, least_margin_m=0.4))
    trace = str(paths["trace.jsonl"])
    own = [sys.executable, "-m", "ariac_score.cli", "rml", "run", str(paths["spec.rml"]), trace]
    prolog = [swipl, "-O", "-p", f"monitor={monitor}", str(paths["driver.pl"]), "--"]
    version = subprocess.run([swipl, "--version"], check=True, capture_output=True, text=True).stdout.strip()
    rules = f"the rules of {monitor}" if arguments.rml_monitor else "rules of ours, not the reference"
    head(f"Trace of JSON, {paths['trace.jsonl'].stat().st_size / 1e6:.0f} MB; {version}, {rules}")
    ours, theirs = [], []
    for _ in range(arguments.rounds):
        theirs.append(ran([*prolog, str(paths["spec.pl"]), trace]))
        ours.append(ran(own))
    show("rml run, whole command", ours, theirs, arguments.snapshots, 12)


def in_memory(arguments: argparse.Namespace, rtamt: str | None, reelay: str | None) -> None:
    """The property on columns."""
    found = columns(arguments.snapshots, least_margin_m=-0.5)
    sides: list[tuple[str, Peer, str, int]] = []
    if rtamt:
        sides.append(("rtamt", Peer(rtamt, RTAMT, found), f"always({D_MIN})", 30))
    if reelay:
        sides.append(("reelay", Peer(reelay, REELAY, found), "boolean", 10))
    of = trial(found)
    rounds: dict[str, list[Timed]] = {}
    counts = {}
    for _ in range(arguments.rounds):
        for name, peer, formula, _asked in sides:
            rounds.setdefault(name, []).append(peer.judge(formula))
        for name, monitor in monitors():
            tries = [watched(monitor, of) for _ in range(3)]
            rounds.setdefault(name, []).append(
                (median(t[0] for t, _ in tries), median(t[1] for t, _ in tries))
            )
            counts[name] = tries[0][1]
    head("Columns in memory, with intervals and evidence")
    for peer_name, peer, _, asked in sides:
        for name, findings in counts.items():
            remark = f"  {findings} findings"
            show(f"{name} : {peer_name}", rounds[name], rounds[peer_name], arguments.snapshots, asked, remark)
        peer.close()


def windows(arguments: argparse.Namespace, rtamt: str) -> None:
    """Formulas that look ahead."""
    found = columns(arguments.window_snapshots, least_margin_m=-0.5)
    peer, of = Peer(rtamt, RTAMT, found), trial(found)
    find = Registry().find("ariac_score.monitors", "stl.formula").build
    head(f"Windows, {arguments.window_snapshots} snapshots : rtamt")
    for name, formula, theirs in WINDOWS:
        used = {key: text for key, text in SIGNALS.items() if f"{key} " in formula.replace("(", " ")}
        monitor = find({"formula": formula, "signals": used, "t_off_s": 1.0})
        ours, peers, count = [], [], 0
        for _ in range(arguments.rounds):
            peers.append(peer.judge(theirs))
            timed, count = often_watched(monitor, of)
            ours.append(timed)
        show(f"stl.formula, {name}", ours, peers, arguments.window_snapshots, 100, f"  {count} findings")
    peer.close()


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parts = ("text", "columns", "windows", "oracle")
    parser.add_argument("--snapshots", type=int, default=1_000_000)
    parser.add_argument("--window-snapshots", type=int, default=60_000)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--only", default=",".join(parts), help=f"some of {','.join(parts)}")
    parser.add_argument("--rml-monitor", default=os.environ.get("ARIAC_SCORE_RML_MONITOR"), metavar="DIR")
    arguments = parser.parse_args()
    only = arguments.only.split(",")
    print(f"Python {platform.python_version()}, numpy {np.__version__}, {platform.machine()}")
    print(f"{arguments.snapshots} snapshots at 100 Hz, {arguments.rounds} alternating rounds, medians;")
    print("microseconds for each snapshot, ratios of wall-clock and of processor time")
    if "text" in only:
        with tempfile.TemporaryDirectory() as folder:
            texts(arguments, Path(folder))
    rtamt = None
    if "columns" in only or "windows" in only:
        rtamt = peer_python("rtamt", "ARIAC_SCORE_RTAMT_PYTHON")
    if "columns" in only:
        in_memory(arguments, rtamt, peer_python("reelay", "ARIAC_SCORE_REELAY_PYTHON"))
    if "windows" in only and rtamt:
        windows(arguments, rtamt)
    if "oracle" in only:
        print("\nOracle", flush=True)
        command = [sys.executable, str(HERE / "oracle.py"), "--rounds", str(arguments.rounds)]
        subprocess.run(command, check=False)


if __name__ == "__main__":
    main()
