"""A season that goes wrong in every way, and comes out as if nothing had happened.

    python benchmarks/season.py [--trials 500] [--kills 200] [--supervisor-kills 3]

One run in ten is broken. The batch is scored once undisturbed. Then again, while processes of runs are
killed at random and the supervisor itself is killed with -9; each time the same command is called again.
In the end `diff -r` compares both folders: nothing may be lost, counted twice, or differ in a byte.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

from ariac_score.batch.index import Row
from ariac_score.testing import SNAPSHOT_SIGNALS, kitting_trial, write_trial_log
from ariac_score.testing.competitions import CRASHED

RULES = "paper2020"
LOG = "log.jsonl"
EVERY = 5  # samples of the made trial that are kept: it is still decided


@cache
def _records() -> list[dict[str, Any]]:
    with tempfile.TemporaryDirectory() as folder:
        log = write_trial_log(Path(folder, LOG), kitting_trial(), signals=SNAPSHOT_SIGNALS)
        records = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    samples = [record for record in records if record["record"] == "sample"]
    left_out = {id(sample) for i, sample in enumerate(samples) if i % EVERY}
    return [record for record in records if id(record) not in left_out]


def _text(number: int) -> str:
    head, *rest, end = _records()
    records = [{**head, "id": f"t_{number}"}, *rest, {**end, "records": len(rest) + 2}]
    return "".join(json.dumps(record) + "\n" for record in records)


def _replaced(content: bytes) -> Callable[[Path], None]:
    return lambda run: (run / LOG).write_bytes(content) and None


def _cut(run: Path) -> None:
    whole = (run / LOG).read_bytes()
    (run / LOG).write_bytes(whole[: len(whole) // 2])


def _without_log(run: Path) -> None:
    (run / LOG).unlink()


def _dangling(run: Path) -> None:
    (run / LOG).unlink()
    (run / LOG).symlink_to("/nowhere/at/all")


def _locked(run: Path) -> None:
    (run / LOG).chmod(0)  # root may read it all the same; it is then scored, in both batches


def _twice(run: Path) -> None:
    (run / LOG).write_text(_text(1) + _text(2), encoding="utf-8")


BROKEN: dict[str, Callable[[Path], None]] = {
    "cut off": _cut,
    "empty": _replaced(b""),
    "no log": _replaced(b"hello\n"),
    "bytes": _replaced(bytes(range(256)) * 40),
    "crashed": _replaced(CRASHED.encode()),
    "gone": _without_log,
    "a link to nothing": _dangling,
    "nobody may read it": _locked,
    "two trials in one file": _twice,
    "a time beyond numbers": lambda run: (
        (run / LOG).write_text(_text(1).replace('"t_s": 1', '"t_s": 9e999', 1), encoding="utf-8") and None
    ),
    "a line without end": _replaced(b'{"record": "trial", "id": "' + b"x" * 11_000_000),
    "aliases without end": lambda run: (
        (run / "trial.yaml").write_text(
            "a: &a [x, x]\n"
            + "".join(f"{b}: &{b} [*{a}, *{a}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True))
        )
        and None
    ),
}


def make_season(folder: Path, count: int) -> Counter[str]:
    """So many runs, of which every tenth is broken, in each way in turn."""
    ways = list(BROKEN)
    broken: Counter[str] = Counter()
    for number in range(count):
        run = folder / f"t_{number:05d}"
        run.mkdir(parents=True)
        (run / LOG).write_text(_text(number), encoding="utf-8")
        if number % 10 == 3:
            way = ways[number // 10 % len(ways)]
            BROKEN[way](run)
            broken[way] += 1
    return broken


def command(season: Path, out: Path, jobs: int, executor: str = "local", scheduler: str = "") -> list[str]:
    """The call that an organiser makes, again and again."""
    score = [sys.executable, "-m", "ariac_score.cli", "batch", str(season), "--rules", RULES]
    where = ["--executor", executor, "--scheduler", scheduler] if scheduler else ["-j", str(jobs)]
    return [*score, "-o", str(out), *where]


def on_a_cluster(season: Path, out: Path, jobs: int, executor: str) -> int:
    """Score on a cluster of this machine; returns the exit code."""
    with _dask(jobs) if executor == "dask" else _ray(jobs) as scheduler:
        call = command(season, out, jobs, executor, scheduler)
        return subprocess.run(call, capture_output=True, check=False).returncode


@contextmanager
def _dask(jobs: int) -> Iterator[str]:
    import distributed  # noqa: PLC0415  # an extra

    with distributed.LocalCluster(
        n_workers=jobs, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        yield cluster.scheduler_address


@contextmanager
def _ray(jobs: int) -> Iterator[str]:
    os.environ["RAY_AUTH_MODE"] = (
        "disabled"  # nobody else is let in, and none of our tokens is of this cluster
    )
    import ray  # noqa: PLC0415  # an extra

    ray.init("local", num_cpus=jobs, include_dashboard=False, log_to_driver=False)
    try:
        yield ray.get_runtime_context().gcs_address
    finally:
        ray.shutdown()


def _children(parents: set[int]) -> set[int]:
    """The processes that some processes of ours began."""
    found = set()
    for status in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError, ValueError):
            after_name = status.read_text().rpartition(")")[2].split()
            if int(after_name[1]) in parents:
                found.add(int(status.parent.name))
    return found


def _kill(process: int) -> bool:
    with suppress(ProcessLookupError):
        os.kill(process, signal.SIGKILL)
        return True
    return False


def _size(file: Path) -> int:
    try:
        return file.stat().st_size
    except OSError:
        return 0


def disturbed(
    season: Path, out: Path, jobs: int, kills: int, supervisor_kills: int, seed: int
) -> tuple[int, int]:
    """Score while processes are killed; returns how many were, and how many calls it took."""
    chance, killed, calls = random.Random(seed), 0, 0  # noqa: S311  # whom it hits need not be a secret
    known, hurry = -1, min(1.0, len(list(season.iterdir())) / 50)
    while True:
        calls += 1
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        with subprocess.Popen(command(season, out, jobs), **quiet) as supervisor:  # type: ignore[call-overload]
            patience = time.monotonic() + chance.uniform(6.0, 12.0) * hurry
            while supervisor.poll() is None:
                time.sleep(chance.uniform(0.02, 0.15))
                workers = sorted(_children(_children({supervisor.pid})))
                progress = _size(out / ".rows.jsonl")
                if killed < kills and workers and progress != known:  # one finished: spread out
                    killed += _kill(chance.choice(workers))
                    known = progress
                if calls <= supervisor_kills and time.monotonic() > patience:
                    supervisor.kill()
            if supervisor.returncode != -signal.SIGKILL:
                return killed, calls


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--kills", type=int, default=200, help="processes of runs that are killed at random")
    parser.add_argument("--supervisor-kills", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-j", "--jobs", type=int, default=2)
    parser.add_argument(
        "--executor",
        choices=("local", "dask", "ray"),
        default="local",
        help="dask, ray: score on a cluster of this machine instead of disturbing",
    )
    told = parser.parse_args(argv)
    work = Path(tempfile.mkdtemp(prefix="season-"))
    try:
        broken = make_season(work / "season", told.trials)
        print(f"{told.trials} runs, {sum(broken.values())} of them broken in {len(broken)} ways", flush=True)
        begun = time.perf_counter()
        subprocess.run(
            command(work / "season", work / "undisturbed", told.jobs), capture_output=True, check=False
        )
        print(f"undisturbed: {time.perf_counter() - begun:.0f} s", flush=True)
        begun = time.perf_counter()
        if told.executor != "local":
            code = on_a_cluster(work / "season", work / "out", told.jobs, told.executor)
            taken_s = time.perf_counter() - begun
            print(f"on {told.executor} with {told.jobs} workers: {taken_s:.0f} s, exit code {code}")
        else:
            killed, calls = disturbed(
                work / "season", work / "out", told.jobs, told.kills, told.supervisor_kills, told.seed
            )
            taken_s = time.perf_counter() - begun
            print(f"disturbed: {taken_s:.0f} s, {killed} processes of runs killed, {calls} calls")
        lines = (work / "out/runs.jsonl").read_text(encoding="ascii").splitlines()
        rows = [Row.from_line(line) for line in lines]
        for outcome, count in sorted(Counter(row.summary.outcome for row in rows).items()):
            print(f"  {outcome:20} {count}")
        once = len({row.key for row in rows}) == len(rows) == told.trials
        print(f"every run is there once: {'yes' if once else 'NO'}")
        diff = shutil.which("diff") or "diff"
        differs = subprocess.run(
            [diff, "-r", str(work / "undisturbed"), str(work / "out")],
            capture_output=True,
            text=True,
            check=False,
        )
        print(f"diff -r: {'no difference' if not differs.returncode else differs.stdout[:2000]}")
        return 0 if once and not differs.returncode else 1
    finally:
        shutil.rmtree(work, ignore_errors=True)


if __name__ == "__main__":
    sys.exit(main())
