"""Scoring one run in a process of its own, within limits."""

from __future__ import annotations

import contextlib
import errno
import gc
import hashlib
import json
import os
import resource
import signal
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

from ariac_score.batch.address import (
    RunTooLargeError,
    basis_of,
    contents_of,
    measuring_address,
    refuse_excess,
    signature_of,
)
from ariac_score.batch.fetched import Near, bring, still_the_same
from ariac_score.batch.outcomes import outcome_document, outcome_of, told_within
from ariac_score.batch.store import Store
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.engine.price import reprice
from ariac_score.engine.read import topics_read
from ariac_score.engine.score import score_trial
from ariac_score.errors import PluginError, ScoreError
from ariac_score.logs.containers.ranged import reading
from ariac_score.results.result import Result
from ariac_score.results.result_file import as_json, load_result, read_result
from ariac_score.scoring.ruleset import RuleSet, expanded_yaml

__all__ = [
    "NO_ROOM",
    "Done",
    "installed",
    "kept_apart",
    "limit_threads",
    "noted",
    "parse_report",
    "perform",
    "perform_into",
    "prepared",
    "report_of",
]

_ORPHANED_S = 60.0
"""How long beyond its time a process lives when nobody is left who would end it."""

NO_ROOM = 74
"""With which the process of a run ends when the disk is too full for its report: no fault of the run."""
_NOTE = ".contents"
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT})

_BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Done:
    """What came of a task.

    Attributes:
        task: The task.
        address: Of what was measured; empty when nobody got so far.
        contents: Hash of the files of the run; empty likewise.
        signature: What the file system said of them at that time.
        document: The result or outcome; `None` when it is stored already.
        cpu_s: What its process took of the processor, s; 0 when nobody knows.
        put_off: Its process was killed by others, as often as it was tried; where many machines are at
            work, it is worth another try when nothing else is under way.
    """

    task: RunTask
    address: str
    contents: str
    signature: str
    document: bytes | None
    cpu_s: float = 0.0
    put_off: bool = False


Hashed = Callable[[str, str], None]
"""Called with the hash of the files of a run and with their signature, once both are known."""


def _nobody(_contents: str, _signature: str) -> None:
    """Remember nothing: nobody is left to ask when this process dies."""


def perform(task: RunTask, setting: BatchSetting, out: Path | None = None, hashed: Hashed = _nobody) -> Done:
    """Score one run, or find that it is scored already.

    Args:
        task: The run.
        setting: Rules and limits.
        out: Folder of the batch, where this worker can see it: a stored measurement is priced
            again instead of measured.
        hashed: For whoever wants to know what was read even when this process does not end well.
    """
    if task.remote:
        with tempfile.TemporaryDirectory(prefix="ariac-score-") as folder:
            return _perform_elsewhere(task, setting, out, Path(folder), lambda _near: None)
    return _perform_here(task, setting, out, hashed, changing=False)


def _perform_here(
    task: RunTask, setting: BatchSetting, out: Path | None, hashed: Hashed, *, changing: bool
) -> Done:
    """Score a run whose files are here; those with holes change while they are read."""
    before = signature_of(task)
    try:
        refuse_excess(task, setting.limits.input_bytes)
    except RunTooLargeError as error:
        return _beyond_size(task, error)
    contents = contents_of(task)
    hashed(contents, before)
    try:
        rules, basis = prepared(setting)
    except ScoreError as error:  # this machine has not what the one has where the batch began
        words = told_within(error, Path(setting.rules_file).parent)
        return Done(task, "", contents, before, _because(task, "failed", words))
    address = measuring_address(task, contents, basis)
    store = Store(out) if out is not None else None
    if store is not None and _is_result(store.place(address, setting.rules_sha256)):
        return Done(task, address, contents, before, None)
    document = _priced_again(store, address, rules.rule_set) if store is not None else None
    if document is None:
        known = _known(task, contents, setting, store) if store is not None else None
        document = _scored(task, rules, known)
    if not changing and signature_of(task) != before:
        document = _because(task, "changing", "its files changed while they were read; call again when done")
        return Done(task, "", "", "", document)
    if len(document) > setting.limits.output_bytes:
        size, most = len(document), setting.limits.output_bytes
        document = _because(task, "too_large", f"its result has {size} bytes; at most {most} are kept")
    return Done(task, address, contents, before, document)


def _perform_elsewhere(
    task: RunTask, setting: BatchSetting, out: Path | None, folder: Path, brought: Callable[[Near], None]
) -> Done:
    """Fetch a run, score what came, and see that nothing changed meanwhile."""
    rules, _ = prepared(setting)
    topics = topics_read(rules) if setting.ranges else None
    try:
        near = bring(task, folder, topics, most_bytes=setting.limits.input_bytes)
    except RunTooLargeError as error:
        return _beyond_size(task, error)
    except (ScoreError, OSError) as error:
        return _unreachable(task, error)
    brought(near)
    with reading(near.parts):
        done = _perform_here(near.task, setting, out, _nobody, changing=bool(near.parts))
        done = replace(done, task=task, signature=near.signature)
    failures = [file.failure for file in near.parts if file.failure is not None]
    if failures:
        return _unreachable(task, failures[0])
    try:
        same = still_the_same(task, near, ranges=setting.ranges)
    except ScoreError as error:
        return _unreachable(task, error)
    if same:
        return done
    return Done(task, "", "", "", _because(task, "changing", "it changed while it was fetched; call again"))


def _beyond_size(task: RunTask, error: RunTooLargeError) -> Done:
    """A run with more or larger files than may be; nobody hashed them, so the next call looks again."""
    return Done(task, "", "", "", _because(task, "too_large", f"{error}; {error.hint}"))


def _unreachable(task: RunTask, error: Exception) -> Done:
    """A run whose files could not be had; nothing of it is kept, so that the next call asks again."""
    hint = getattr(error, "hint", "")
    return Done(task, "", "", "", _because(task, "unreachable", f"{error}; {hint}" if hint else str(error)))


def _is_result(place: Path) -> bool:
    """Whether a whole result lies there, which follows from itself; an outcome is found out again."""
    try:
        load_result(place)
    except ScoreError:
        return False
    return True


def _priced_again(store: Store, address: str, rule_set: RuleSet) -> bytes | None:
    """The stored measurement under other prices; `None` when there is none to be used."""
    other = store.priced_otherwise(address)
    if other is None:
        return None
    try:
        return as_json(reprice(load_result(other), rule_set)).encode("utf-8")
    except ScoreError:
        return None  # an outcome, a damaged file, a formula without a value: measure, and say what is wrong


def _known(task: RunTask, contents: str, setting: BatchSetting, store: Store) -> Result | None:
    """What was measured of the same files, by the same code, under rules that share some checks.

    The address says so: it is that of the earlier rules and the code of now only when neither the
    files nor any code has changed since.
    """
    if not task.earlier or not setting.earlier_basis:
        return None
    place = store.root / task.earlier
    if place.parent.name != measuring_address(task, contents, setting.earlier_basis):
        return None
    try:
        if hashlib.sha256(place.read_bytes()).hexdigest() != task.earlier_sha256:
            return None
        return read_result(place, known=True)
    except (OSError, ScoreError):
        return None  # an outcome, or a damaged file: ask every check


def _scored(task: RunTask, rules: Prepared, known: Result | None) -> bytes:
    root = Path(task.root) if task.root else Path(task.path).parent
    try:
        result = score_trial(
            Path(task.path),
            rules,
            also=[Path(name) for name in task.also],
            binding=task.binding,
            root=Path(task.root) if task.root else None,
            trial_id=task.trial if task.root else "",
            team=task.team,
            known=known,
        )
        return as_json(result).encode("utf-8")
    except ScoreError as error:
        if isinstance(error, PluginError) and isinstance(error.__cause__, (MemoryError, OSError)):
            _blame_the_machine(error.__cause__)
        return _because(task, outcome_of(error), told_within(error, root))
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001  # a fault of ours may cost one run, never the others
        return _because(task, "failed", f"{type(error).__name__}: {error}".replace(f"{root}/", ""))


def _blame_the_machine(cause: MemoryError | OSError) -> None:
    """Raise what is no plugin's fault: somebody had to be the one that asked for the last of it."""
    if isinstance(cause, MemoryError):
        raise MemoryError from None
    if cause.errno in _NO_ROOM:
        raise OSError(cause.errno, os.strerror(cause.errno)) from None


def _because(task: RunTask, outcome: str, reason: str) -> bytes:
    return outcome_document(outcome, reason, team=task.team, trial=task.trial)


@cache
def installed() -> Registry:
    """The installed plugins, found once in a process and in those that come out of it."""
    return Registry()


@cache
def prepared(setting: BatchSetting) -> tuple[Prepared, str]:
    """The rules and the basis of a setting, made once in a process and in those that come out of it."""
    rules = prepare(setting.rule_set(), registry=installed())
    expanded_yaml(rules.rule_set)  # it keeps its text
    return rules, basis_of(rules)


# In a process of its own ---------------------------------------------------------------


def perform_into(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """What the process of one run does: keep the limits, score, leave a report.

    The report is a line of JSON, then the document; it appears whole or not at all. Whoever began the
    process ends it when it is late; should nobody be left to do so, as after `kill -9`, an alarm does.
    """
    signal.setitimer(signal.ITIMER_REAL, setting.limits.wall_s + _ORPHANED_S)
    _keep(setting.limits, 0 if task.remote else setting.limits.output_bytes)
    _hush()
    try:
        _leave(_wherever(task, setting, out, report), report)
    except MemoryError:
        short = True  # what holds the memory is let go when this block is left
    except OSError as error:
        os._exit(NO_ROOM if error.errno in _NO_ROOM else 1)
    else:
        short = False
    if short:
        gc.collect()
        limit = setting.limits.memory_bytes >> 20
        reason = f"it needed more than {limit} MiB; raise --memory-mb if the log is sound"
        _leave(Done(task, "", *noted(report), _because(task, "out_of_memory", reason)), report)
    os._exit(0)  # nothing is left to be tidied up, and taking modules apart takes as long as a small trial


def _wherever(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> Done:
    """Score a run that lies here, or fetch it first."""

    def hashed(contents: str, signature: str) -> None:
        kept_apart(report, _NOTE).write_text(f"{contents} {signature}", encoding="ascii")

    def brought(near: Near) -> None:
        hashed(near.contents, task.signature)
        largest = max((file.size for file in near.parts), default=0)
        _keep(setting.limits, max(largest, setting.limits.output_bytes))

    if task.remote:
        return _perform_elsewhere(task, setting, out, kept_apart(report, ".near"), brought)
    return perform(task, setting, out, hashed)


def noted(report: Path) -> tuple[str, str]:
    """Hash and signature of the files of a run, as its process noted them; empty when it got not so far."""
    try:
        contents, _, signature = kept_apart(report, _NOTE).read_text(encoding="ascii").partition(" ")
    except (OSError, ValueError):
        return "", ""
    whole = len(contents) == hashlib.sha256().digest_size * 2
    return (contents, signature) if whole else ("", "")


def _leave(done: Done, report: Path) -> None:
    part = report.with_suffix(".part")
    part.write_bytes(report_of(done))
    part.replace(report)


def kept_apart(report: Path, what: str) -> Path:
    """Where the process of a run keeps what others clear away when it has ended."""
    return report.with_suffix(what)


def report_of(done: Done) -> bytes:
    """What came of a task, for `parse_report`."""
    head = {"address": done.address, "contents": done.contents, "signature": done.signature}
    head["of"] = _told(done.task)
    head["stored"] = "yes" if done.document is None else ""
    head["put_off"] = "yes" if done.put_off else ""
    used = resource.getrusage(resource.RUSAGE_SELF)
    head["cpu_s"] = str(done.cpu_s or used.ru_utime + used.ru_stime)
    return json.dumps(head).encode("ascii") + b"\n" + (done.document or b"")


def _told(task: RunTask) -> str:
    return json.dumps([*task.key, task.path])


def parse_report(task: RunTask, report: bytes) -> Done:
    """What a process left behind.

    Raises:
        ValueError: It is not whole, or is about another run: nobody may get the score of a neighbour.
    """
    line, _, document = report.partition(b"\n")
    head = json.loads(line)
    if head["of"] != _told(task):
        raise ValueError(f"it is about {head['of']}")
    return Done(
        task,
        head["address"],
        head["contents"],
        head["signature"],
        None if head["stored"] else document,
        float(head["cpu_s"]),
        bool(head["put_off"]),
    )


def _keep(limits: Limits, largest_bytes: int) -> None:
    """Bind this process to its limits, 0 for none yet; nothing it starts can lift them."""
    bounds = {resource.RLIMIT_CORE: 0}
    if largest_bytes:
        bounds[resource.RLIMIT_FSIZE] = largest_bytes + (1 << 20)
    if limits.memory_bytes:
        bounds[resource.RLIMIT_AS] = limits.memory_bytes
    for kind, bound in bounds.items():
        _, hard = resource.getrlimit(kind)
        most = bound if hard == resource.RLIM_INFINITY else min(bound, hard)
        with contextlib.suppress(ValueError, OSError):
            resource.setrlimit(kind, (most, most))


def _hush() -> None:
    """Give what this process prints to nobody: hundreds of runs may not talk into one terminal."""
    sys.stdout.flush()
    sys.stderr.flush()
    words = os.open(os.devnull, os.O_WRONLY)
    os.dup2(words, 1)
    os.dup2(words, 2)
    os.close(words)


def limit_threads() -> None:
    """Keep numeric libraries from starting a thread for each core in every process."""
    for name in _BLAS_THREADS:
        os.environ.setdefault(name, "1")
