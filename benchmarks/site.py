"""How long do the site of a competition and the statistics of its ranking take?

Makes a few trials of ten minutes, scores them, varies what was found in them (seeded) into
the results of a whole competition, ranks it, and builds its site in a fresh process. Beside
it: the same pages with one process, so that the machine can be told from the work. Then the
bootstrap of a ranking with many teams, alone.

    python benchmarks/site.py [--teams 20] [--trials 15] [--runs 5] [--rounds 2] [--keep FOLDER]
    python benchmarks/site.py --bootstrap [--teams 50] [--draws 10000]
"""

from __future__ import annotations

import argparse
import os
import platform
import random
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import numpy as np

from ariac_score import Finding, Verdict, load_rule_set, score_trial
from ariac_score.engine.price import reprice
from ariac_score.ranking.outcomes import Cell, Ranking, RunOutcome, TeamRank
from ariac_score.ranking.spec import Intervals, Spec
from ariac_score.ranking.statistics import rank_statistics
from ariac_score.results.result import Result
from ariac_score.results.result_file import as_json
from ariac_score.testing import write_trial_log
from ariac_score_ariac.testing import kitting_trial

RULES = "paper2020"
WANTED_SITE_S = 30.0
WANTED_BOOTSTRAP_S = 2.0
TRIAL_S = 600.0


def base_results(folder: Path, count: int = 4) -> list[Result]:
    """Scored trials of ten minutes."""
    rules = load_rule_set(RULES)
    found = []
    for seed in range(count):
        trial = kitting_trial(seed=seed, duration_s=TRIAL_S)
        log = write_trial_log(folder / f"trial_{seed}.jsonl", trial)
        found.append(score_trial(log, rules))
    return found


def varied(base: Result, team: str, trial: str, chance: random.Random, flaw_rate: float) -> Result:
    """The same trial by a team that makes more or fewer mistakes."""

    def changed(finding: Finding) -> Finding:
        if finding.check.startswith("part_") and chance.random() < flaw_rate:
            return replace(finding, verdict=Verdict.VIOLATED, message="so it was made for this measurement")
        return finding

    findings = {key: changed(finding) for key, finding in base.measured.findings.items()}
    measured = replace(base.measured, team=team, trial=trial, findings=findings)
    return reprice(replace(base, measured=measured), load_rule_set(RULES))


def write_competition(folder: Path, teams: int, trials: int, runs: int) -> None:
    """A competition whose runs are stored results."""
    chance = random.Random(7)  # noqa: S311  # a measurement, not a secret
    bases = base_results(folder)
    for t in range(teams):
        team = f"team_{t + 1:02}"
        (folder / "stored" / team).mkdir(parents=True)
        for j in range(trials):
            trial = f"trial_{j + 1:02}"
            for run in range(1, runs + 1):
                base = bases[int(chance.random() * len(bases))]
                result = varied(base, team, trial, chance, 0.05 + 0.02 * t)
                (folder / "stored" / team / f"{trial}_{run}.json").write_text(
                    as_json(result), encoding="utf-8", newline="\n"
                )
    (folder / "competition.yaml").write_text(
        f"id: measured\nrules: {RULES}\nruns: stored/{{team}}/{{trial}}_{{run}}.json\n", encoding="utf-8"
    )


def command(*arguments: str | Path) -> tuple[float, float]:
    """Seconds, and seconds of processor time of all its processes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    started = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "ariac_score.cli", *map(str, arguments)], check=True, capture_output=True
    )
    took = time.perf_counter() - started
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return took, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def one_core(*arguments: str | Path) -> tuple[float, float]:
    """The same, on one core."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        return command(*arguments)
    finally:
        os.sched_setaffinity(0, cores)


def measure_site(arguments: argparse.Namespace) -> None:
    folder = Path(arguments.keep or tempfile.mkdtemp())
    folder.mkdir(parents=True, exist_ok=True)
    try:
        write_competition(folder, arguments.teams, arguments.trials, arguments.runs)
        ranking, site = folder / "ranking.json", folder / "site"
        ranked_s, _ = command(
            "rank", folder, "--output-format", "json", "-o", ranking, "--results", folder / "results"
        )
        rounds: list[tuple[tuple[float, float], tuple[float, float]]] = []
        for _ in range(arguments.rounds):
            shutil.rmtree(site, ignore_errors=True)
            both = command("report", ranking, "-o", site)
            shutil.rmtree(site)
            rounds.append((both, one_core("report", ranking, "-o", site)))
        pages = sum(1 for _ in site.rglob("*.html"))
        size = sum(file.stat().st_size for file in site.rglob("*") if file.is_file())
    finally:
        if not arguments.keep:
            shutil.rmtree(folder, ignore_errors=True)
    count = arguments.teams * arguments.trials * arguments.runs
    print(f"{arguments.teams} teams, {arguments.trials} trials, {arguments.runs} runs: {count} results of")
    print(f"ten-minute trials; {pages} pages, {size / 1e6:.0f} MB; median of {arguments.rounds} rounds")
    all_cores = statistics.median(both[0] for both, _ in rounds)
    work = statistics.median(both[1] for both, _ in rounds)
    single = statistics.median(one[0] for _, one in rounds)
    ratio = statistics.median(one[0] / both[0] for both, one in rounds)
    print(f"rank, from stored results     {ranked_s:7.1f} s")
    cores = len(os.sched_getaffinity(0))
    print(f"site, {cores} cores                 {all_cores:7.1f} s, processor {work:.1f} s")
    print(f"site, 1 core                  {single:7.1f} s, {ratio:.2f} times as long")
    share = work / cores
    met = "met" if all_cores <= WANTED_SITE_S else f"missed; its processor time on idle cores: {share:.1f} s"
    print(f"wanted                        {WANTED_SITE_S:7.1f} s: {met}")


def made_ranking(teams: int, trials: int, runs: int, draws: int) -> tuple[Ranking, Spec]:
    """A ranking of made scores."""
    chance = np.random.default_rng(3)
    spec = Spec(intervals=Intervals(draws=draws))
    outcomes: list[RunOutcome] = []
    standings = []
    names = tuple(f"trial_{j}" for j in range(trials))
    for t in range(teams):
        cells = {}
        for name in names:
            scores = sorted((Decimal(f"{x:.3f}") for x in 50 + t + chance.normal(0, 5, runs)), reverse=True)
            outcomes += [
                RunOutcome(f"team_{t}", name, k, "scored", score=score, kept=k == 1)
                for k, score in enumerate(scores, start=1)
            ]
            cells[name] = Cell(scores[0], "scored", "", (1,), runs)
        total = sum((cell.score for cell in cells.values()), Decimal(0))
        standings.append(TeamRank(None, f"team_{t}", "", float(total), total, None, {}, cells))
    standings.sort(key=lambda standing: -standing.execution)
    return Ranking("made", "", (RULES, ""), names, tuple(standings), tuple(outcomes), None), spec


def floor(teams: int, trials: int, runs: int, draws: int) -> float:
    """Processor time of as many random words alone: no bootstrap that draws them can be faster."""
    started = time.process_time()
    source = np.random.PCG64(1)
    for _ in range(trials):
        source.random_raw(teams * runs * draws // 2)
    return time.process_time() - started


def measure_bootstrap(arguments: argparse.Namespace) -> None:
    teams = arguments.teams
    ranking, spec = made_ranking(teams, arguments.trials, arguments.runs, arguments.draws)
    rounds: list[tuple[float, float]] = []
    for _ in range(max(arguments.rounds, 3)):
        started = time.process_time()
        rank_statistics(ranking, spec, 3)
        took = time.process_time() - started
        rounds.append((took, floor(teams, arguments.trials, arguments.runs, arguments.draws)))
    ours, words = (statistics.median(column) for column in zip(*rounds, strict=True))
    print(f"{arguments.draws} draws of {teams} teams, {arguments.trials} trials, {arguments.runs} runs")
    print("one core, processor time")
    ratio = statistics.median(a / b for a, b in rounds)
    print(f"all statistics of the ranking {ours:7.2f} s, {ratio:.1f} times the random words")
    print(f"random words alone            {words:7.2f} s")
    met = "met" if ours <= WANTED_BOOTSTRAP_S else "missed"
    print(f"wanted                        {WANTED_BOOTSTRAP_S:7.2f} s: {met}")


def lines() -> Iterator[str]:
    """On what it was measured."""
    yield f"{platform.python_implementation()} {platform.python_version()}, numpy {np.__version__}, "
    yield f"{platform.machine()}, {len(os.sched_getaffinity(0))} cores"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--bootstrap", action="store_true")
    parser.add_argument("--teams", type=int)
    parser.add_argument("--trials", type=int, default=15)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--draws", type=int, default=10_000)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--keep", metavar="FOLDER", help="leave everything there")
    arguments = parser.parse_args()
    arguments.teams = arguments.teams or (50 if arguments.bootstrap else 20)
    print("".join(lines()))
    if arguments.bootstrap:
        measure_bootstrap(arguments)
    else:
        measure_site(arguments)


if __name__ == "__main__":
    main()
