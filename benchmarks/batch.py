"""What a season costs: isolation, going on, other prices, memory of the supervisor.

    python benchmarks/batch.py [--trials 1000] [--many 10000]

Isolation is measured on small recordings (the example trial, 40 s), the rest on smaller trials yet
(an official text of 2024 each). The peak memory of the supervisor is that of the first call, with
100 of them, 1000 and all; that of the others is told as well. The ideal is the sum of the processor
time that the processes of the trials took, spread over all cores; the figure is that ideal over the
time on the clock. What a process of its own costs is told beside it: the processor time of one trial
there and in a warm one.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ariac_score import load_rule_set
from ariac_score.batch.local import usable_cores
from ariac_score.batch.tasks import BatchSetting, Limits, plan_batch
from ariac_score.batch.worker import perform
from ariac_score_ariac.testing.official_texts import Outcome, PlannedOrder, sensor_cost_text, trial_log_text

RULES = "ariac2024.official"
EXAMPLE = Path(__file__).parents[1] / "examples" / "kitting_near_miss.mcap"
EXAMPLE_RULES = "paper2020"
KIT = (PlannedOrder("AAAA0001", "kitting", False, (("pump", "red"), ("battery", "blue"))),)
MEASURED = 40
FEWER = (100, 1000)
"""With so many trials the memory of the supervisor is measured, beside all."""


def make_trials(folder: Path, count: int) -> None:
    """So many runs, no two alike."""
    for number in range(count):
        run = folder / f"t_{number:05d}"
        run.mkdir(parents=True)
        text = trial_log_text("kitting", KIT, [Outcome(("", ""), 50.0 + number / 1000)])
        (run / "trial_log.txt").write_text(text, encoding="utf-8")
        (run / "sensor_cost.txt").write_text(sensor_cost_text({"basic_logical_camera": 2}), encoding="utf-8")


def make_recordings(folder: Path, count: int) -> None:
    """So many runs, each the example trial."""
    folder.mkdir(parents=True)
    for number in range(count):
        shutil.copyfile(EXAMPLE, folder / f"t_{number:05d}.mcap")


def single_cpu_s(trials: Path, rules: str) -> float:
    """CPU time of one trial in a warm process, s: the median of some."""
    setting = BatchSetting.of(load_rule_set(rules), Limits())
    tasks = plan_batch(trials, rules).tasks[: MEASURED + 5]
    times = []
    for task in tasks:
        begun = time.process_time()
        perform(task, setting)
        times.append(time.process_time() - begun)
    return sorted(times[5:])[len(times[5:]) // 2]


def command_s(*arguments: str) -> tuple[float, float, float]:
    """Time on the clock of a command, s, its own peak memory, MiB, and what its trials took, s.

    What the command itself took of the processor is printed: that hardly depends on what else a
    machine does.
    """
    script = (
        "import resource, sys; from ariac_score.cli import main; code = main(sys.argv[1:]);"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024); sys.exit(code)"
    )
    before, begun = os.times(), time.perf_counter()
    ended = subprocess.run(
        [sys.executable, "-c", script, *arguments], capture_output=True, text=True, check=True
    )
    taken, after = time.perf_counter() - begun, os.times()
    used = sum(after[2:4]) - sum(before[2:4])
    print(f"  {used:.2f} s of processor without its trials:", end=" ")
    told = re.search(r"([\d.]+) s of processor time", ended.stdout)
    return taken, float(ended.stdout.splitlines()[-1]), float(told[1]) if told else 0.0


def peak_mib(folder: Path, count: int, rules: str) -> float:
    """Peak memory of the supervisor of so many small trials, MiB."""
    trials = folder / f"trials_{count}"
    make_trials(trials, count)
    wall_s, mib, _ = command_s("batch", str(trials), "--rules", rules, "-o", str(folder / f"out_{count}"))
    print(f"{count} small trials: {wall_s:.1f} s")
    return mib


def other_prices(folder: Path, rules: str) -> str:
    """The rules with another price."""
    file = folder / "other.yaml"
    file.write_text(
        f"id: other\nextends: {rules}\ntitle: other prices\nsource: this benchmark\n"
        "parameters: {time_weight: 2}\n"
    )
    return str(file)


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=1000)
    parser.add_argument("--many", type=int, default=10_000)
    parser.add_argument("--rules", default=RULES)
    arguments = parser.parse_args()
    cores = usable_cores()
    folder = Path(tempfile.mkdtemp(prefix="batch-benchmark-"))
    os.environ["XDG_CACHE_HOME"] = str(folder / "cache")
    try:
        few, many = folder / "few", folder / "many"
        make_recordings(few, arguments.trials)
        single_s = single_cpu_s(few, EXAMPLE_RULES)
        to_few = ("--rules", EXAMPLE_RULES, "-o", str(folder / "out_few"))
        to_many = ("-o", str(folder / "out_many"))
        wall_s, _, cpu_s = command_s("batch", str(few), *to_few)
        own_ms = 1000 * cpu_s / arguments.trials
        print(f"{cores} cores; one trial {1000 * single_s:.1f} ms of processor, {own_ms:.1f} ms isolated")
        ideal_s = cpu_s / cores
        print(
            f"{arguments.trials} trials: {wall_s:.1f} s, ideal {ideal_s:.1f} s: "
            f"{100 * ideal_s / wall_s:.0f} %"
        )
        again_s, _, _ = command_s("batch", str(few), *to_few)
        print(f"once more, nothing to do: {again_s:.2f} s")
        peaks_mib = {count: peak_mib(folder, count, arguments.rules) for count in FEWER}
        make_trials(many, arguments.many)
        wall_s, peaks_mib[arguments.many], _ = command_s(
            "batch", str(many), "--rules", arguments.rules, *to_many
        )
        print(f"{arguments.many} trials: {wall_s:.1f} s")
        again_s, again_mib, _ = command_s("batch", str(many), "--rules", arguments.rules, *to_many)
        print(f"once more, nothing to do: {again_s:.2f} s, {again_mib:.1f} MiB")
        priced_s, priced_mib, _ = command_s(
            "batch", str(many), "--rules", other_prices(folder, arguments.rules), *to_many
        )
        print(f"other prices: {priced_s:.1f} s, {priced_mib:.1f} MiB")
        told = ", ".join(f"{count} trials {mib:.1f} MiB" for count, mib in peaks_mib.items())
        ratio = peaks_mib[arguments.many] / peaks_mib[FEWER[0]]
        print(f"peak memory of the supervisor: {told}; the last over the first {ratio:.2f}")
    finally:
        shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main()
