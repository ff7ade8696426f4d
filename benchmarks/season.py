"""A season that goes wrong in every way, and comes out as if nothing had happened.

    python benchmarks/season.py [--trials 500] [--kills 200] [--supervisor-kills 3] [--executor local dask]

One run in ten is broken: by its files, or by a plugin that hangs, devours memory, crashes or talks without
end when it meets it (`trouble.py`, which is installed for this alone). The batch is scored once undisturbed.
Then again, while whatever takes part is killed at random: processes of runs, the servers they come from,
the workers of a cluster; and the supervisor itself with -9, each time followed by the same command. In the
end every broken run must have the outcome and the reason of its kind, and `diff -r` compares both folders:
nothing may be lost, counted twice, or differ in a byte.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import re
import runpy
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from ariac_score.batch.index import Row
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.official_texts import CANCELLED, CRASHED

BASE = "paper2020"
LOG = "log.jsonl"
EVERY = 5  # samples of the made trial that are kept: it is still decided
TROUBLE = Path(__file__).with_name("trouble.py")
FILES = Path(__file__).with_name("broken_files.py")
MEMORY_MB = 1024
OUTPUT_MB = 1


@cache
def _records() -> list[dict[str, Any]]:
    with tempfile.TemporaryDirectory() as folder:
        log = write_trial_log(Path(folder, LOG), kitting_trial(), signals=SNAPSHOT_SIGNALS)
        records = [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]
    samples = [record for record in records if record["record"] == "sample"]
    left_out = {id(sample) for i, sample in enumerate(samples) if i % EVERY}
    return [record for record in records if id(record) not in left_out]


def _text(number: int, fault: str = "") -> str:
    head, *rest, end = _records()
    records = [{**head, "id": f"t_{number}{fault}"}, *rest, {**end, "records": len(rest) + 2}]
    return "".join(json.dumps(record) + "\n" for record in records)


@dataclass(frozen=True)
class Way:
    """A way in which a run is broken.

    Attributes:
        breaks: What makes a whole run such a one; it is told its number.
        outcome: What must be recorded.
        reason: What its reason must say.
    """

    breaks: Callable[[Path, int], object]
    outcome: str
    reason: str


def _replaced(content: bytes) -> Callable[[Path, int], object]:
    return lambda run, _number: (run / LOG).write_bytes(content)


def _cut(run: Path, _number: int) -> None:
    whole = (run / LOG).read_bytes()
    (run / LOG).write_bytes(whole[: len(whole) // 2])


def _without_log(run: Path, _number: int) -> None:
    (run / LOG).unlink()


def _dangling(run: Path, _number: int) -> None:
    (run / LOG).unlink()
    (run / LOG).symlink_to("/nowhere/at/all")


def _locked(run: Path, _number: int) -> None:
    (run / LOG).chmod(0)


def _twice(run: Path, number: int) -> None:
    (run / LOG).write_text(_text(number) + _text(number + 1), encoding="utf-8")


def _beyond_numbers(run: Path, number: int) -> None:
    (run / LOG).write_text(
        re.sub(r'"t_s": 1[0-9.]*', '"t_s": 9e999', _text(number), count=1), encoding="utf-8"
    )


def _aliases(run: Path, _number: int) -> None:
    pairs = zip("abcde", "bcdef", strict=True)
    lines = ["a: &a [x, x, x, x, x, x, x, x, x, x]"]
    lines += [f"{b}: &{b} [{', '.join([f'*{a}'] * 10)}]" for a, b in pairs]
    (run / "trial.yaml").write_text("\n".join([*lines, "orders: *f\n"]), encoding="utf-8")


def _ended(words: str) -> Callable[[Path, int], None]:
    """As the evaluation script leaves a run that the simulator or its user ended."""

    def breaks(run: Path, _number: int) -> None:
        (run / LOG).unlink()
        (run / "trial_log.txt").write_text(words, encoding="utf-8")

    return breaks


def _asking_for(fault: str) -> Callable[[Path, int], object]:
    return lambda run, number: (run / LOG).write_text(_text(number, f".{fault}"), encoding="utf-8")


def _died(how: str, times: int = 2) -> tuple[str, str]:
    return "killed", f"the process that scored it ended {how}, {times} times in {times} times"


_CHANGING = ("changing", "its files changed while they were read")
_MAY_READ_ALL = os.geteuid() == 0
_LATE = ("timed_out", "raise --time-limit-s")
_UNKNOWN = ("nothing_to_score", f"not recognised: {LOG}")
_SHORT = ("out_of_memory", f"it needed more than {MEMORY_MB} MiB")

BROKEN: Mapping[str, Way] = {
    "cut off": Way(_cut, "unreadable", "not a JSON record"),
    "empty": Way(_replaced(b""), "nothing_to_score", "the file is empty"),
    "no log": Way(_replaced(b"hello\n"), *_UNKNOWN),
    "bytes": Way(_replaced(bytes(range(256)) * 40), *_UNKNOWN),
    "crashed": Way(_ended(CRASHED), "crashed", "the simulator died during this run"),
    "cancelled": Way(_ended(CANCELLED), "cancelled", "cancelled"),
    "gone": Way(_without_log, "nothing_to_score", "it holds no files"),
    "a link to nothing": Way(_dangling, "nothing_to_score", "a link to somewhere else"),
    "nobody may read it": Way(
        _locked, *(("scored", "") if _MAY_READ_ALL else ("unreadable", "cannot be read"))
    ),
    "two trials in one file": Way(_twice, "unreadable", "one trial a file"),
    "a time beyond numbers": Way(_beyond_numbers, "unreadable", "t_s is inf"),
    "a line without end": Way(_replaced(b'{"record": "trial", "id": "' + b"x" * 11_000_000), *_UNKNOWN),
    "aliases without end": Way(_aliases, "unreadable", "once aliases are expanded"),
    "hangs": Way(_asking_for("hangs"), *_LATE),
    "spins": Way(_asking_for("spins"), *_LATE),
    "stops itself": Way(_asking_for("stops"), *_LATE),
    "asks for all memory at once": Way(_asking_for("gorges"), *_SHORT),
    "takes more and more memory": Way(_asking_for("nibbles"), *_SHORT),
    "prints without end": Way(_asking_for("prints"), *_SHORT),
    "says more than is kept": Way(_asking_for("rambles"), "too_large", f"at most {OUTPUT_MB << 20} are kept"),
    "aborts": Way(_asking_for("aborts"), *_died("by signal 6 (SIGABRT)")),
    "segfaults": Way(_asking_for("segfaults"), *_died("by signal 11 (SIGSEGV)")),
    "kills its own process": Way(_asking_for("kills"), *_died("by signal 9 (SIGKILL)", 12)),
    "leaves without a word": Way(_asking_for("leaves"), *_died("with exit code 0")),
    "raises": Way(_asking_for("raises"), "plugin_failed", "season.trouble"),
    "forks": Way(_asking_for("forks"), "scored", ""),
    "leaves children": Way(_asking_for("begets"), "scored", ""),
    "leaves children and hangs": Way(_asking_for("begets-and-hangs"), *_LATE),
    "writes over memory": Way(_asking_for("overwrites"), *_died("by signal 11 (SIGSEGV)")),
    "opens files without end": Way(_asking_for("opens"), "plugin_failed", "Too many open files"),
    "starts threads without end": Way(
        _asking_for("starts-threads"), "plugin_failed", "can't start new thread"
    ),
    "exits": Way(_asking_for("exits"), "plugin_failed", "SystemExit"),
    "interrupts": Way(_asking_for("interrupts"), "plugin_failed", "KeyboardInterrupt"),
    "recurses": Way(_asking_for("recurses"), "plugin_failed", "RecursionError"),
    "closes all files": Way(_asking_for("closes"), "plugin_failed", "Bad file descriptor"),
    "changes the folder": Way(_asking_for("moves"), "plugin_failed", ""),
    "writes without end": Way(_asking_for("fills"), "plugin_failed", ""),
    "leaves threads": Way(_asking_for("threads"), "scored", ""),
    "grows while it is scored": Way(_asking_for("grows"), *_CHANGING),
    "shrinks while it is scored": Way(_asking_for("shrinks"), *_CHANGING),
    "vanishes while it is scored": Way(_asking_for("vanishes"), *_CHANGING),
    "changes while it is scored": Way(_asking_for("swaps"), *_CHANGING),
    **{name: Way(*way) for name, way in runpy.run_path(str(FILES))["BROKEN_FILES"].items()},
}


@dataclass(frozen=True)
class Season:
    """Runs on disk, and how they are scored.

    Attributes:
        runs: Their folder.
        rules: By which they are scored.
        plugins: Where the distribution that makes trouble lies.
        broken: The way in which each broken run is broken.
        time_limit_s: For a run.
    """

    runs: Path
    rules: Path
    plugins: Path
    broken: Mapping[str, str]
    time_limit_s: float

    def command(self, out: Path, jobs: int, executor: str = "local", scheduler: str = "") -> list[str]:
        """The call that an organiser makes, again and again."""
        score = [sys.executable, "-m", "ariac_score.cli", "batch", str(self.runs), "--rules", str(self.rules)]
        limits = ["--time-limit-s", str(self.time_limit_s)]
        limits += ["--memory-mb", str(MEMORY_MB), "--output-mb", str(OUTPUT_MB)]
        where = ["--executor", executor, "--scheduler", scheduler] if scheduler else ["-j", str(jobs)]
        return [*score, *limits, "-o", str(out), *where]


def make_season(folder: Path, count: int, every: int, ways: Sequence[str], time_limit_s: float) -> Season:
    """So many runs, of which every so-manieth is broken, in each way in turn."""
    broken = {}
    for number in range(count):
        run = folder / "season" / f"t_{number:05d}"
        run.mkdir(parents=True)
        (run / LOG).write_text(_text(number), encoding="utf-8")
        if number % every == min(3, every - 1):
            broken[run.name] = ways[number // every % len(ways)]
            BROKEN[broken[run.name]].breaks(run, number)
    plugins, rules = folder / "plugins", folder / "rules.yaml"
    about = plugins / "season_trouble-1.0.dist-info"
    about.mkdir(parents=True)
    shutil.copyfile(TROUBLE, plugins / "season_trouble.py")
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: season-trouble\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[ariac_score.monitors]\nseason.trouble = season_trouble:Trouble\n"
    )
    rules.write_text(
        f"id: season\nextends: {BASE}\ntitle: A season that goes wrong\nsource: this benchmark\n"
        "monitors:\n  trouble: {use: season.trouble}\n"
    )
    return Season(folder / "season", rules, plugins, broken, time_limit_s)


@contextmanager
def surroundings(work: Path, season: Season) -> Iterator[None]:
    """Every process finds the plugin; what killed ones leave behind lies where it is cleared away."""
    before = dict(os.environ)
    path = os.pathsep.join(filter(None, [str(season.plugins), before.get("PYTHONPATH", "")]))
    os.environ.update(
        PYTHONPATH=path,
        TMPDIR=str(work / "tmp"),
        XDG_CACHE_HOME=str(work / "cache"),
        SEASON_RUNS=str(season.runs),
    )
    (work / "tmp").mkdir()
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)


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


@dataclass(frozen=True)
class _Prey:
    """The processes that may be killed, by what they are.

    Attributes:
        runs: Each scores one run.
        servers: Runs come out of them.
        keepers: Each keeps such a server for a worker of a cluster.
        workers: Of a cluster.
    """

    runs: Sequence[int] = ()
    servers: Sequence[int] = ()
    keepers: Sequence[int] = ()
    workers: Sequence[int] = ()

    @classmethod
    def below(cls, supervisors: set[int], *, keepers: bool = False, workers: Sequence[int] = ()) -> _Prey:
        """Those that belong to the supervisors, or to the keepers of a cluster."""
        servers = {child for child in _children(supervisors) if _children({child})}
        kept = sorted(supervisors) if keepers else ()
        return cls(sorted(_children(servers)), sorted(servers), kept, workers)

    def one(self, chance: random.Random) -> tuple[str, int] | None:
        """One of them: mostly a run, of which there are many."""
        kinds = [("runs", self.runs, 14), ("servers", self.servers, 2)]
        kinds += [("keepers", self.keepers, 2), ("workers", self.workers, 2)]
        there = [(name, found, weight) for name, found, weight in kinds if found]
        if not self.runs:
            return None
        name, found, _ = chance.choices(there, [weight for *_, weight in there])[0]
        return name, chance.choice(found)


Hunt = Callable[[int], _Prey]
"""Whom there is to kill, by the number of the supervisor's process."""


def disturbed(
    command: Sequence[str], out: Path, prey: Hunt, told: argparse.Namespace
) -> tuple[Counter[str], int]:
    """Score while processes are killed; returns how many of what were, and how many calls it took."""
    chance, killed, calls = random.Random(told.seed), Counter[str](), 0  # noqa: S311  # no secret
    known, life_s = -1, told.supervisor_lives_s * min(1.0, told.trials / 50)
    while True:
        calls += 1
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        with subprocess.Popen(command, **quiet) as supervisor:  # type: ignore[call-overload]
            patience = time.monotonic() + chance.uniform(0.5, 1.5) * life_s
            while supervisor.poll() is None:
                time.sleep(chance.uniform(0.02, 0.15))
                progress = _size(out / ".rows.jsonl")
                if killed.total() < told.kills and progress != known:  # one finished: spread out
                    hit = prey(supervisor.pid).one(chance)
                    if hit is not None and _kill(hit[1]):
                        killed[hit[0]] += 1
                        known = progress
                if calls <= told.supervisor_kills and time.monotonic() > patience:
                    supervisor.kill()
            if supervisor.returncode != -signal.SIGKILL:
                return killed, calls


@contextmanager
def _cluster(jobs: int) -> Iterator[tuple[str, Hunt]]:
    """A Dask cluster of this machine: the address of its scheduler, and whom there is to kill."""
    import distributed  # noqa: PLC0415  # an extra

    with distributed.LocalCluster(
        n_workers=jobs,
        threads_per_worker=1,
        processes=True,
        dashboard_address=":0",
        host="127.0.0.1",
        silence_logs=50,
    ) as cluster:
        # A nanny whose worker is killed before it is up gives up; who runs a cluster begins another.
        cluster.adapt(minimum=jobs, maximum=jobs, interval="2s")

        def prey(_supervisor: int) -> _Prey:
            up = set(cluster.scheduler.workers)
            nannies = [nanny for nanny in cluster.workers.values() if nanny.worker_address in up]
            workers = [nanny.pid for nanny in nannies if nanny.pid is not None]
            return _Prey.below(_children(set(workers)), keepers=True, workers=workers)

        yield cluster.scheduler_address, prey


@contextmanager
def _ray_cluster(jobs: int) -> Iterator[tuple[str, Hunt]]:
    """A Ray cluster of this machine, likewise."""
    os.environ["RAY_AUTH_MODE"] = "disabled"  # nobody else is let in
    import ray  # noqa: PLC0415  # an extra

    ray.init("local", num_cpus=jobs, include_dashboard=False, log_to_driver=False)

    def prey(_supervisor: int) -> _Prey:
        below = _children(_children({os.getpid()}))
        workers = [process for process in below if _called(process).startswith(b"ray::")]
        return _Prey.below(_children(set(workers)), keepers=True, workers=workers)

    try:
        yield ray.get_runtime_context().gcs_address, prey
    finally:
        ray.shutdown()


def _called(process: int) -> bytes:
    with suppress(OSError):
        return Path(f"/proc/{process}/cmdline").read_bytes()
    return b""


@contextmanager
def _here(_jobs: int) -> Iterator[tuple[str, Hunt]]:
    yield "", lambda supervisor: _Prey.below({supervisor})


PLACES = {"local": _here, "dask": _cluster, "ray": _ray_cluster}


def _rows(out: Path) -> list[Row]:
    lines = (out / "runs.jsonl").read_text(encoding="ascii").splitlines()
    return [Row.from_line(line) for line in lines]


def misjudged(season: Season, rows: Sequence[Row]) -> list[str]:
    """Runs whose outcome or reason is not that of their kind."""
    wrong = []
    for row in rows:
        way = season.broken.get(row.key[1])
        expected = BROKEN[way] if way else Way(lambda *_: None, "scored", "")
        found = row.summary
        if found.outcome != expected.outcome or expected.reason not in found.reason:
            wrong.append(f"{row.key[1]} ({way or 'whole'}): {found.outcome}: {found.reason}")
    return wrong


def _differences(first: Path, second: Path) -> str:
    diff = shutil.which("diff") or "diff"
    told = [diff, "-r", str(first), str(second)]
    return subprocess.run(told, capture_output=True, text=True, check=False).stdout


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=500)
    parser.add_argument("--kills", type=int, default=200, help="processes that are killed at random")
    parser.add_argument("--supervisor-kills", type=int, default=3)
    parser.add_argument(
        "--supervisor-lives-s", type=float, default=9.0, help="on average, of those that are killed"
    )
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("-j", "--jobs", type=int, default=2)
    parser.add_argument("--executor", choices=PLACES, nargs="+", default=["local"])
    parser.add_argument("--broken-every", type=int, default=10, metavar="N", help="one run in N is broken")
    parser.add_argument("--ways", choices=BROKEN, nargs="+", default=list(BROKEN), metavar="WAY")
    parser.add_argument("--time-limit-s", type=float, default=60.0, help="no whole run may ever need it")
    told = parser.parse_args(argv)
    work = Path(tempfile.mkdtemp(prefix="season-"))
    season = make_season(work, told.trials, told.broken_every, told.ways, told.time_limit_s)
    ways = len(set(season.broken.values()))
    print(f"{told.trials} runs, {len(season.broken)} of them broken in {ways} ways", flush=True)
    try:
        with surroundings(work, season):
            failed = _undisturbed(season, work, told)
            return failed or max(_disturbed(season, work, told, place) for place in told.executor)
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _undisturbed(season: Season, work: Path, told: argparse.Namespace) -> int:
    begun = time.perf_counter()
    command = season.command(work / "undisturbed", told.jobs)
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    print(f"undisturbed: {time.perf_counter() - begun:.0f} s", flush=True)
    if ended.returncode not in (0, 6):
        print(ended.stderr)
        return 1
    rows = _rows(work / "undisturbed")
    for outcome, count in sorted(Counter(row.summary.outcome for row in rows).items()):
        print(f"  {outcome:20} {count}")
    wrong = misjudged(season, rows)
    print(
        f"every run has the outcome and the reason of its kind: {'NO' if wrong else 'yes'}",
        *wrong,
        sep="\n  ",
        flush=True,
    )
    return 1 if wrong else 0


def _disturbed(season: Season, work: Path, told: argparse.Namespace, place: str) -> int:
    begun, out = time.perf_counter(), work / f"disturbed_{place}"
    with PLACES[place](told.jobs) as (scheduler, prey):
        killed, calls = disturbed(
            season.command(out, told.jobs, place, scheduler),
            out,
            prey,
            told,
        )
    whom = ", ".join(f"{count} {kind}" for kind, count in sorted(killed.items()))
    taken_s = time.perf_counter() - begun
    print(f"{place}, disturbed: {taken_s:.0f} s, {killed.total()} killed ({whom}), {calls} calls")
    rows = _rows(out)
    once = len({row.key for row in rows}) == len(rows) == told.trials
    print(f"every run is there once: {'yes' if once else 'NO'}")
    for line in misjudged(season, rows):
        print(f"  {line}")
    differences = _differences(work / "undisturbed", out)
    print(f"diff -r: {differences[:2000] or 'no difference'}", flush=True)
    return 0 if once and not differences else 1


if __name__ == "__main__":
    sys.exit(main())
