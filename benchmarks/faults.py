"""What happens to the folder of a batch between and during calls, and whether the next call makes it whole.

    python benchmarks/faults.py [--runs 24] [--times 40]

A small season is scored undisturbed. Then, for each kind of fault and as often as is asked: a folder in
which something happens (a file is damaged, the disk is full or becomes read-only at some moment, a log
changes between calls, two calls write at once, parts are joined in any order), followed by the same call.
Either `diff -r` finds no difference to the undisturbed season, or the fault was refused by name and the call
after its end makes the season whole. A row for each kind of fault goes to standard output.
"""

from __future__ import annotations

import argparse
import filecmp
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path

from ariac_score.batch.local import LocalExecutor
from ariac_score.batch.store import Store
from ariac_score.cli import main as ariac_score
from ariac_score_ariac.testing.official_texts import Outcome, PlannedOrder, sensor_cost_text, trial_log_text

RULES = "ariac2024.official"
KIT = (PlannedOrder("AAAA0001", "kitting", False, (("pump", "red"), ("battery", "blue"))),)
FINISHED = frozenset({0, 6})
NAMED = frozenset({4, 7})


@dataclass
class Season:
    """A season, and its batch that nobody disturbed.

    Attributes:
        runs: Folder of its runs.
        whole: The undisturbed batch.
        work: For everything else.
        chance: Decides what happens when.
    """

    runs: Path
    whole: Path
    work: Path
    chance: random.Random
    serial: int = field(default=0)

    def folder(self) -> Path:
        """One that is not there yet."""
        self.serial += 1
        return self.work / f"out_{self.serial}"

    def copy(self) -> Path:
        """A finished batch."""
        return Path(shutil.copytree(self.whole, self.folder(), symlinks=True))


def make_season(work: Path, count: int, seed: int) -> Season:
    """Runs of which every sixth cannot be read."""
    runs = work / "runs"
    for number in range(count):
        run = runs / f"t_{number:05d}"
        run.mkdir(parents=True)
        text = trial_log_text("kitting", KIT, [Outcome(("", ""), 50.0 + number / 1000)])
        (run / "trial_log.txt").write_text("hello\n" if number % 6 == 5 else text, encoding="utf-8")
        (run / "sensor_cost.txt").write_text(sensor_cost_text({"basic_logical_camera": 2}), encoding="utf-8")
    season = Season(runs, work / "whole", work, random.Random(seed))  # noqa: S311  # no secret
    code, said = call(season, season.whole)
    assert code in FINISHED, said
    return season


def call(season: Season, out: Path, *more: str) -> tuple[int, str]:
    """The call that an organiser makes; its exit code and what it said."""
    said = StringIO()
    with redirect_stdout(said), redirect_stderr(said):
        try:
            code = ariac_score(
                ["batch", str(season.runs), "--rules", RULES, "-o", str(out), "-j", "1", "-q", *more]
            )
        except SystemExit as ended:
            code = int(ended.code or 0)
    return code, said.getvalue()


def differences(first: Path, second: Path) -> list[str]:
    """Files that are not the same in both folders."""
    found = []
    names = {
        p.relative_to(root).as_posix() for root in (first, second) for p in root.rglob("*") if not p.is_dir()
    }
    for name in sorted(names):
        one, other = first / name, second / name
        if not (one.is_file() and other.is_file() and filecmp.cmp(one, other, shallow=False)):
            found.append(name)
    return found


@dataclass(frozen=True)
class Ended:
    """How one fault ended.

    Attributes:
        refused: What was said when the fault was refused; empty when it was not.
        differs: Files that differ from the undisturbed season in the end.
    """

    refused: str
    differs: Sequence[str]


def _again(season: Season, out: Path, refused: str = "", whole: Path | None = None) -> Ended:
    """The same call; where it refuses too, what it names is removed, as it says."""
    code, said = call(season, out)
    if code in NAMED:
        refused = refused or said
    elif code not in FINISHED:
        return Ended("", [f"exit code {code}: {said[:300]}"])
    return Ended(refused, differences(whole or season.whole, out))


# Between calls -------------------------------------------------------------------------


def _damage(season: Season, file: Path) -> None:
    content = bytearray(file.read_bytes())
    way = season.chance.randrange(7)
    if way == 0 and content:
        content[season.chance.randrange(len(content))] ^= 1 << season.chance.randrange(8)
    elif way == 1:
        del content[season.chance.randrange(len(content) + 1) :]
    elif way == 2:
        content += bytes(season.chance.randrange(256) for _ in range(50))
    elif way == 3:
        content = bytearray(season.chance.randrange(256) for _ in range(200))
    file.unlink()
    if way == 4:
        return
    if way == 5:
        os.mkfifo(file)
    elif way == 6:
        file.symlink_to("/dev/zero")
    else:
        file.write_bytes(content)


def _damaged(pattern: str) -> Callable[[Season], Ended]:
    def inject(season: Season) -> Ended:
        out = season.copy()
        _damage(season, season.chance.choice(sorted(p for p in out.glob(pattern) if p.is_file())))
        return _again(season, out)

    return inject


def _journal_left(season: Season) -> Ended:
    """A journal as a killed call leaves it, cut off anywhere, with half-written files beside it."""
    out = season.copy()
    lines = (out / "runs.jsonl").read_bytes()
    (out / ".rows.jsonl").write_bytes(lines[: season.chance.randrange(len(lines))])
    for name in ("runs.jsonl", "index.sqlite"):
        if season.chance.random() < 0.5:
            (out / name).unlink()
    (out / "objects" / ".part-abc").write_bytes(b"half")
    (out / ".work-old").mkdir()
    return _again(season, out)


def _log_changed(season: Season) -> Ended:
    """A log changes between calls, sometimes with its times as before, and changes back."""
    out = season.copy()
    log = season.chance.choice(sorted(season.runs.glob("*/trial_log.txt")))
    before, status = log.read_bytes(), log.stat()
    log.write_bytes(before[: len(before) // 2])
    if season.chance.random() < 0.5:
        os.utime(log, ns=(status.st_atime_ns, status.st_mtime_ns))  # a clock that was set back
    code, said = call(season, out)
    row = next(
        json.loads(line)
        for line in (out / "runs.jsonl").read_text().splitlines()
        if json.loads(line)["trial"] == log.parent.name
    )
    log.write_bytes(before)
    if code not in FINISHED or (row["outcome"] == "scored"):
        return Ended("", [f"a log that changed kept its score: {row} {said[:200]}"])
    ended = _again(season, out)
    # The result of the other content stays, under an address of its own.
    return Ended(ended.refused, [name for name in ended.differs if not name.startswith("objects/")])


# During a call -------------------------------------------------------------------------


class _Writes:
    """Fails at the n-th write into the folder of a batch."""

    def __init__(self, at: int, number: int) -> None:
        self.at, self.number, self.count = at, number, 0

    def step(self) -> None:
        self.count += 1
        if self.count >= self.at:
            raise OSError(self.number, os.strerror(self.number))


def _failing_writes(number: int) -> Callable[[Season], Ended]:
    """From the n-th document on nothing can be written, until somebody sees to it."""

    def inject(season: Season) -> Ended:
        out, put = season.folder(), Store.put
        writes = _Writes(season.chance.randrange(1, 2 + len(list(season.runs.iterdir()))), number)

        def put_or_fail(self: Store, place: Path, document: bytes) -> None:
            writes.step()
            put(self, place, document)

        Store.put = put_or_fail  # type: ignore[method-assign]
        try:
            code, said = call(season, out)
        finally:
            Store.put = put  # type: ignore[method-assign]
        refused = said if code in NAMED else ""
        if writes.count >= writes.at and not refused:
            return Ended("", [f"a failed write was not named: {code} {said[:200]}"])
        return _again(season, out, refused)

    return inject


def _small_disk(season: Season) -> Ended:
    """A disk of its own that is full at some moment, and then has room."""
    out = season.folder()
    out.mkdir()
    size = season.chance.randrange(1, 60) * 4
    mount, unmount = shutil.which("mount") or "mount", shutil.which("umount") or "umount"
    subprocess.run(
        [mount, "-t", "tmpfs", "-o", f"size={size}k", "tmpfs", str(out)], check=True, capture_output=True
    )
    try:
        code, said = call(season, out)
        refused = said if code in NAMED else ""
        if code not in NAMED | FINISHED:
            return Ended("", [f"exit code {code} with {size} KiB: {said[:300]}"])
        subprocess.run([mount, "-o", "remount,size=64m", str(out)], check=True, capture_output=True)
        return _again(season, out, refused)
    finally:
        subprocess.run([unmount, "-l", str(out)], check=False, capture_output=True)


def _read_only(season: Season) -> Ended:
    """The file system becomes read-only while runs are scored."""
    out = season.folder()
    out.mkdir()
    mount, unmount = shutil.which("mount") or "mount", shutil.which("umount") or "umount"
    subprocess.run([mount, "-t", "tmpfs", "tmpfs", str(out)], check=True, capture_output=True)
    after, settle, seen = season.chance.randrange(0, 20), LocalExecutor._settle, [0]

    def settle_and_lock(self: LocalExecutor, *arguments: object) -> object:
        done = settle(self, *arguments)  # type: ignore[arg-type]
        seen[0] += 1
        if seen[0] == after:
            # Forced: files are open for writing, as when a file system finds a fault in itself.
            subprocess.run([mount, "-o", "remount,ro", str(out)], check=False, capture_output=True)
        return done

    try:
        store_put = Store.put

        def put_read_only(self: Store, place: Path, document: bytes) -> None:
            if after and seen[0] >= after:
                raise OSError(30, os.strerror(30))
            store_put(self, place, document)

        Store.put, LocalExecutor._settle = put_read_only, settle_and_lock  # type: ignore[method-assign,assignment]
        try:
            code, said = call(season, out)
        finally:
            Store.put, LocalExecutor._settle = store_put, settle  # type: ignore[method-assign]
        subprocess.run([mount, "-o", "remount,rw", str(out)], check=True, capture_output=True)
        return _again(season, out, said if code in NAMED else "")
    finally:
        subprocess.run([unmount, "-l", str(out)], check=False, capture_output=True)


def _two_at_once(season: Season) -> Ended:
    """Two calls on one folder: one writes, the other is refused or comes after it."""
    out = season.folder()
    command = [sys.executable, "-m", "ariac_score", "batch", str(season.runs), "--rules", RULES]
    both = [
        subprocess.Popen(
            [*command, "-o", str(out), "-j", "1", "-q"],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        for _ in range(2)
    ]
    ends = [(one.communicate()[1], one.returncode) for one in both]
    refused = next((said for said, code in ends if code in NAMED), "")
    if refused and "another batch is writing here" not in refused:
        return Ended("", [refused])
    if not any(code in FINISHED for _, code in ends):
        return Ended("", [f"nobody finished: {ends}"])
    return Ended(refused, differences(season.whole, out))


def _shards(season: Season) -> Ended:
    """Parts are made and joined in any order."""
    count = season.chance.randrange(2, 6)
    parts = [season.folder() for _ in range(count)]
    for number in season.chance.sample(range(count), count):
        call(season, parts[number], "--shard", f"{number + 1}/{count}")
    season.chance.shuffle(parts)
    out = season.folder()
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        code = ariac_score(["merge", str(out), *map(str, parts), "-q"])
    return Ended("", [] if code in FINISHED and not differences(season.whole, out) else [f"code {code}"])


def _shards_in_conflict(season: Season) -> Ended:
    """One shard twice, in two contents: refused, whatever the order."""
    parts = [season.folder() for _ in range(3)]
    for part, number in zip(parts, (1, 2, 1), strict=True):
        call(season, part, "--shard", f"{number}/2")
    documents = sorted(parts[2].glob("objects/*/*/*.json"))
    season.chance.choice(documents).write_bytes(b'{"schema": "ariac-score/outcome/1"}')
    season.chance.shuffle(parts)
    said, out = StringIO(), season.folder()
    with redirect_stdout(said), redirect_stderr(said):
        code = ariac_score(["merge", str(out), *map(str, parts), "-q"])
    return Ended(said.getvalue(), [] if code not in FINISHED and said.getvalue() else ["it was joined"])


FAULTS: dict[str, Callable[[Season], Ended]] = {
    "a stored document damaged between calls": _damaged("objects/*/*/*.json"),
    "`runs.jsonl` damaged": _damaged("runs.jsonl"),
    "`index.sqlite` damaged": _damaged("index.sqlite"),
    "`batch.json` damaged": _damaged("batch.json"),
    "`rules.yaml` damaged": _damaged("rules.yaml"),
    "the journal of a killed call, cut off": _journal_left,
    "a log changed between calls, and back": _log_changed,
    "no room from the n-th document on": _failing_writes(28),
    "no permission from the n-th document on": _failing_writes(13),
    "a disk error from the n-th document on": _failing_writes(5),
    "a disk of 4 to 236 KiB (tmpfs)": _small_disk,
    "read-only from the n-th run on": _read_only,
    "two calls at once": _two_at_once,
    "shards joined in any order": _shards,
    "shards in conflict": _shards_in_conflict,
}


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--runs", type=int, default=24)
    parser.add_argument("--times", type=int, default=40, help="each kind of fault is injected")
    parser.add_argument("--faults", nargs="+", choices=FAULTS, default=list(FAULTS), metavar="FAULT")
    parser.add_argument("--seed", type=int, default=1)
    told = parser.parse_args(argv)
    work, failed = Path(tempfile.mkdtemp(prefix="faults-")), 0
    os.environ["XDG_CACHE_HOME"] = str(work / "cache")
    try:
        season = make_season(work, told.runs, told.seed)
        print(
            f"{told.runs} runs\n\n| fault | injected | refused by name | not whole in the end |",
            "|---|---|---|---|",
            sep="\n",
        )
        for name in told.faults:
            ends = [FAULTS[name](season) for _ in range(told.times)]
            broken = [end for end in ends if end.differs]
            failed += len(broken)
            print(
                f"| {name} | {len(ends)} | {sum(bool(e.refused) for e in ends)} | {len(broken)} |", flush=True
            )
            for end in broken[:3]:
                print(f"    {list(end.differs)[:5]} {end.refused[:300]}", file=sys.stderr, flush=True)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
