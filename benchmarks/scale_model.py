"""What a season costs at any size: a discrete simulation, fitted to small seasons, held against a larger one.

    python benchmarks/scale_model.py                           # fit, predict, and 10^6 trials of 1 GB
    python benchmarks/scale_model.py --measure 100 300 1000    # measure here, and fit that
    python benchmarks/scale_model.py --measure 100 300 1000 --workers 8    # on a Dask cluster of this machine

The simulation is of what docs/scale.md describes. A supervisor plans and hands out runs, one after the
other; workers fetch a run, score it in a process of its own and send the result; the supervisor stores it,
and in the end writes the tables. Workers die now and then, and their run is tried again. Each of these takes
a time that is fitted, or a rate that is stated below.
"""

from __future__ import annotations

import argparse
import heapq
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

HERE = Path(__file__).resolve().parent
FIGURES = HERE / "scale_figures.json"


@dataclass(frozen=True)
class Machine:
    """What a season runs on, and what its parts cost.

    Attributes:
        workers: Runs at a time.
        start_s: Until the first run begins, and from the last one to the end, without the tables.
        run_s: Of a worker for one run, without fetching it.
        supervise_s: Of the supervisor for one run: hand it out, take and store its result.
        table_s: Of the supervisor for one run when the tables are written.
        run_bytes: Of one run, to be fetched.
        fetch_bytes_per_s: Of one worker.
        storage_bytes_per_s: Of the storage, for all workers together.
        deaths_per_hour: Of one worker.
        restart_s: Until a dead worker is back.
        spread: Standard deviation of the logarithm of `run_s`.
    """

    workers: int
    start_s: float
    run_s: float
    supervise_s: float
    table_s: float
    run_bytes: float = 0.0
    fetch_bytes_per_s: float = float("inf")
    storage_bytes_per_s: float = float("inf")
    deaths_per_hour: float = 0.0
    restart_s: float = 60.0
    spread: float = 0.0


@dataclass(frozen=True)
class Outcome:
    """What a simulated season took.

    Attributes:
        wall_s: On the clock.
        busy: Share of the time in which workers scored or fetched.
        supervisor: Share of the time in which the supervisor worked.
        lost_runs: Tries that a dead worker took with it.
        moved_bytes: Fetched, with the tries that were lost.
    """

    wall_s: float
    busy: float
    supervisor: float
    lost_runs: int
    moved_bytes: float


def simulate(machine: Machine, trials: int, *, seed: int = 1) -> Outcome:
    """Run a season event by event: who is free next takes the next run, in turn with the supervisor."""
    dice = random.Random(seed)  # noqa: S311  # made to be repeated
    free = [(machine.start_s, number) for number in range(machine.workers)]
    heapq.heapify(free)
    supervisor_s, worked_s, lost, moved, left = machine.start_s, 0.0, 0, 0.0, trials
    # All workers fetch at once, for almost all of the time: each has its share of the storage.
    rate = min(machine.fetch_bytes_per_s, machine.storage_bytes_per_s / machine.workers)
    fetch_s = machine.run_bytes / rate
    death_s = 3600.0 / machine.deaths_per_hour if machine.deaths_per_hour else 0.0
    end_s = machine.start_s
    while left:
        now, worker = heapq.heappop(free)
        supervisor_s = max(supervisor_s, now) + machine.supervise_s
        takes = fetch_s + machine.run_s * dice.lognormvariate(0.0, machine.spread)
        dies_after = dice.expovariate(1.0 / death_s) if death_s else float("inf")
        if dies_after < takes:
            worked_s += dies_after
            lost += 1
            moved += machine.run_bytes * min(1.0, dies_after / fetch_s if fetch_s else 1.0)
            heapq.heappush(free, (supervisor_s + dies_after + machine.restart_s, worker))
            continue
        worked_s += takes
        moved += machine.run_bytes
        left -= 1
        end_s = max(end_s, supervisor_s + takes)
        heapq.heappush(free, (supervisor_s + takes, worker))
    wall_s = max(end_s, supervisor_s) + machine.table_s * trials
    share = machine.supervise_s * (trials + lost) + machine.table_s * trials
    return Outcome(wall_s, worked_s / (wall_s * machine.workers), share / wall_s, lost, moved)


# Fitting


@dataclass(frozen=True)
class Line:
    """Seconds of a season of `n` trials: `start_s + each_s * n`."""

    start_s: float
    each_s: float

    def at(self, trials: int) -> float:
        """Of so many trials."""
        return self.start_s + self.each_s * trials


def fitted(seconds: Mapping[int, float]) -> Line:
    """The line through the measured seconds by size that is off by the least share of them."""
    # Weighted by 1 / seconds^2: a second counts more where there are few.
    w = {n: 1 / s**2 for n, s in seconds.items()}
    total = sum(w.values())
    mean_n, mean_s = (
        sum(w[n] * v for n, v in pairs) / total for pairs in ([(n, n) for n in w], seconds.items())
    )
    each = sum(w[n] * (n - mean_n) * (s - mean_s) for n, s in seconds.items())
    each /= sum(w[n] * (n - mean_n) ** 2 for n in w)
    return Line(mean_s - each * mean_n, each)


def local(processor: Line, supervisor: Line, cores: int, share: float) -> Machine:
    """A machine of so many cores, of which the season has a share; the supervisor works on them, too."""
    return Machine(
        workers=cores,
        start_s=processor.start_s / share,
        run_s=processor.each_s / share,
        supervise_s=supervisor.each_s / share,
        table_s=0.0,  # part of what the supervisor takes for each
    )


def held(figures: Mapping[str, Sequence[Mapping[str, float]]]) -> list[tuple[int, float, float]]:
    """Of each set of figures the largest season, what the others predict of it, and what was measured."""
    found = []
    for rows in figures.values():
        by_size = {int(row["trials"]): row for row in rows}
        *smaller, largest = sorted(by_size)
        processor = fitted({n: by_size[n]["processor_s"] for n in smaller})
        supervisor = fitted({n: by_size[n]["supervisor_s"] for n in smaller})
        # What the season had of the cores beside other work, as the smaller ones say.
        share = (
            sum(by_size[n]["processor_s"] for n in smaller) / sum(by_size[n]["wall_s"] for n in smaller) / 2
        )
        told = simulate(local(processor, supervisor, 2, share), largest)
        predicted = (told.wall_s - processor.start_s / share) * 2 * share + processor.start_s
        found.append((largest, predicted, by_size[largest]["processor_s"]))
    return found


# A million trials

MILLION = Machine(
    workers=1000,
    start_s=120.0,
    run_s=6.0,  # a recording of 1 GB at 170 MB/s with its monitors, see docs/performance.md
    supervise_s=0.0024,  # fitted: what the supervisor takes for one run
    table_s=0.0004,
    run_bytes=1e9,
    fetch_bytes_per_s=125e6,  # 1 Gbit/s for each worker
    storage_bytes_per_s=1e11,
    deaths_per_hour=0.05,  # of machines that may be taken away
    spread=0.3,
)
STORED_BYTES, ROW_BYTES, INDEX_BYTES = 18_500, 870, 480
"""Of one run, measured: its document, its line in runs.jsonl, its rows in index.sqlite."""
PART_BYTES = 8 << 20
DOLLARS_PER_CORE_HOUR, DOLLARS_PER_THOUSAND_GETS = 0.04, 0.0004
"""List prices of a large cloud for machines that may be taken away, and for reading within a region."""


@contextmanager
def here(_workers: int) -> Iterator[tuple[list[str], Callable[[], float]]]:
    """No cluster: how `batch` is told of it, and what it has taken of the processor, s."""
    yield [], time.process_time


@contextmanager
def cluster(workers: int) -> Iterator[tuple[list[str], Callable[[], float]]]:
    """A Dask cluster of this machine, likewise."""
    import distributed  # noqa: PLC0415  # an extra
    import psutil  # noqa: PLC0415  # comes with it

    options = {"threads_per_worker": 1, "dashboard_address": ":0", "host": "127.0.0.1", "silence_logs": 50}
    with distributed.LocalCluster(n_workers=workers, processes=True, **options) as made:
        processes = [psutil.Process(nanny.pid) for nanny in made.workers.values()]

        def taken_s() -> float:
            return time.process_time() + sum(sum(each.cpu_times()[:2]) for each in processes)

        yield ["--executor", "dask", "--scheduler", made.scheduler_address], taken_s


def measure(sizes: Sequence[int], workers: int) -> list[dict[str, float]]:
    """Score seasons of these sizes, and each once more, when there is nothing to do.

    What they take of the processor depends little on what else a machine does; time on the clock does.

    Args:
        sizes: In trials.
        workers: Of a Dask cluster; 0: without one.
    """
    from batch import make_trials  # noqa: PLC0415  # beside this program

    found = []
    place = cluster if workers else here
    with tempfile.TemporaryDirectory() as work, place(workers) as (told, cluster_s):
        for number, size in enumerate([sizes[0], *sizes] if workers else sizes):
            trials = Path(work, str(number))
            make_trials(trials, size)
            command = [
                "-q",
                "batch",
                str(trials),
                "--rules",
                "ariac2024.official",
                "-o",
                f"{trials}.out",
                *told,
            ]
            before_s = cluster_s()
            said, own_s, mib, wall_s = _called(command)
            around_s = cluster_s() - before_s
            (scored_s,) = re.findall(r"([\d.]+) s of processor time", said)
            _, _, _, again_s = _called(command)
            row = {
                "trials": size,
                "processor_s": round(float(scored_s) + own_s + around_s, 3),
                "supervisor_s": round(own_s, 3),
                "wall_s": round(wall_s, 2),
                "again_s": round(again_s, 2),
                "supervisor_mib": round(mib, 1),
            }
            if number or not workers:  # the workers import everything in their first season
                found.append(row)
            print(json.dumps(row), flush=True)
            shutil.rmtree(trials)
            shutil.rmtree(f"{trials}.out")
    return found


def _called(arguments: Sequence[str]) -> tuple[str, float, float, float]:
    """What a command said, what it took without its trials, s, its peak memory, MiB, and s on the clock."""
    began = time.monotonic()
    with tempfile.TemporaryFile("w+", encoding="utf-8") as said:
        command = subprocess.Popen([sys.executable, "-m", "ariac_score", *arguments], stdout=said)
        _, status, used = os.wait4(command.pid, 0)
        command.returncode = os.waitstatus_to_exitcode(status)
        if command.returncode:
            raise subprocess.CalledProcessError(command.returncode, command.args)
        said.seek(0)
        return said.read(), used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, time.monotonic() - began


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--measure", type=int, nargs="+", metavar="TRIALS", help="at least three sizes")
    parser.add_argument("--workers", type=int, default=0, metavar="N", help="on a Dask cluster of so many")
    told = parser.parse_args()
    figures = json.loads(FIGURES.read_text(encoding="utf-8"))
    if told.measure:
        figures = {"here": measure(sorted(told.measure), told.workers)}
    for largest, predicted, measured in held(figures):
        off = predicted / measured - 1
        print(
            f"{largest} trials, processor: {predicted:.1f} s predicted, {measured:.1f} measured ({off:+.1%})"
        )
    trials = 10**6
    found = simulate(MILLION, trials)
    hours = found.wall_s / 3600
    print(f"10^6 trials of 1 GB on {MILLION.workers} workers: {hours:.1f} h, workers busy {found.busy:.0%}")
    print(f"  supervisor busy {found.supervisor:.0%}; {found.lost_runs} tries lost with their worker")
    gets = found.moved_bytes / PART_BYTES
    print(f"  moved {found.moved_bytes / 1e15:.3f} PB in {gets / 1e6:.0f} million requests")
    machines, asked = MILLION.workers * hours * DOLLARS_PER_CORE_HOUR, gets / 1000 * DOLLARS_PER_THOUSAND_GETS
    print(f"  {machines:.0f} $ for the workers, {asked:.0f} $ for the requests")
    sizes = (size * trials / 1e9 for size in (STORED_BYTES, ROW_BYTES, INDEX_BYTES))
    print("  documents {:.1f} GB, runs.jsonl {:.2f} GB, index.sqlite {:.2f} GB".format(*sizes))
    return 0


if __name__ == "__main__":
    sys.exit(main())
