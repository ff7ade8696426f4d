"""Scoring one run in a process of its own, within limits."""

from __future__ import annotations

import contextlib
import errno
import gc
import hashlib
import json
import os
import re
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import msgspec

from ariac_score.batch.address import (
    RunTooLargeError,
    basis_of,
    contents_of,
    measuring_address,
    refuse_excess,
    signature_of,
)
from ariac_score.batch.fetched import Fetched, fetch_run, is_unchanged
from ariac_score.batch.outcomes import error_text, outcome_document, outcome_of
from ariac_score.batch.store import Store
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask, TaskKey
from ariac_score.checks.registry import Registry
from ariac_score.documents.plain_file import read_plain
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.engine.price import reprice
from ariac_score.engine.read import topics_read
from ariac_score.engine.score import score_trial
from ariac_score.errors import PluginError, ResultError, ScoreError
from ariac_score.installed.running import listen_for_interrupts, note_in
from ariac_score.installed.system import OPEN_FILES, end_after, limit_this_process, own_session
from ariac_score.logs.containers.ranged import reading
from ariac_score.results.result import Result
from ariac_score.results.result_file import as_json, check_follows, check_rules, result_in
from ariac_score.scoring.ruleset import RuleSet, expanded_yaml
from ariac_score.trial.statements import ORGANISER

__all__ = [
    "LARGEST_HEAD_BYTES",
    "NO_ROOM",
    "Done",
    "fetched_folder",
    "installed",
    "limit_threads",
    "note_file",
    "noted",
    "parse_report",
    "perform",
    "perform_into",
    "prepared",
    "report_of",
    "running_file",
]

_ORPHANED_S = 60.0
"""How long a process may go on beyond its time when its supervisor is gone."""

LARGEST_HEAD_BYTES = 1 << 20
"""What a report may have more than its document."""

NO_ROOM = 74
"""Exit code of the process of a run when the disk is too full for its report: no fault of the run."""
_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT})

_HASH = re.compile(r"[0-9a-f]{64}")

_BLAS_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Done:
    """The outcome of a task.

    Attributes:
        task: The task.
        address: Of the measurement; empty when it did not get so far.
        contents: Hash of the files of the run; empty likewise.
        signature: Hash of their status before they were read.
        document: The result or outcome; `None` when it is stored already.
        cpu_s: Processor time of its process, s; 0 when unknown.
        put_off: Its process was killed from outside in each attempt; on a cluster it is worth another
            attempt when no other run is under way.
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


def _forget(_contents: str, _signature: str) -> None:
    """Remember nothing: when this process dies, nobody is left to ask."""


def perform(task: RunTask, setting: BatchSetting, out: Path | None = None, hashed: Hashed = _forget) -> Done:
    """Score one run, or find that it is scored already.

    Args:
        task: The run.
        setting: Rules and limits.
        out: Folder of the batch, where this worker can see it: a stored measurement is priced
            again instead of measured.
        hashed: Called as soon as the files are hashed, in case this process does not end well.
    """
    if task.remote:
        with tempfile.TemporaryDirectory(prefix="ariac-score-") as folder:
            return _perform_remote(task, setting, out, Path(folder), lambda _fetched: None)
    return _perform_local(task, setting, out, hashed, changing=False)


def _perform_local(
    task: RunTask, setting: BatchSetting, out: Path | None, hashed: Hashed, *, changing: bool
) -> Done:
    """Score a run whose files are on this machine.

    Args:
        task: The run.
        setting: Rules and limits.
        out: As in `perform`.
        hashed: As in `perform`.
        changing: Its files change while they are read, because only parts were fetched so far.
    """
    before = signature_of(task)  # before anything is read: a change at any time from here on is noticed
    try:
        refuse_excess(task, setting.limits.input_bytes)
    except RunTooLargeError as error:
        return _beyond_size(task, error)
    contents = contents_of(task)
    hashed(contents, before)
    try:
        rules, basis = prepared(setting)
    except ScoreError as error:  # this worker lacks a plugin that the machine of the supervisor has
        reason = error_text(error, Path(setting.rules_file).parent)
        return Done(task, "", contents, before, _because(task, "failed", reason))
    address = measuring_address(task, contents, basis)
    store = Store(out) if out is not None else None
    earlier = _recorded(task, store, address) if store is not None else None
    if earlier is not None and earlier.provenance.rule_set.sha256 == setting.rules_sha256:
        if _follows(earlier, rules.rule_set):
            return Done(task, address, contents, before, None)
        earlier = None  # its row was rewritten with it: only the log is left to ask
    document = _priced_again(earlier, rules.rule_set) if earlier is not None else None
    if document is None:
        known = _measured_before(task, contents, setting, store) if store is not None else None
        document = _scored(task, rules, known, partial=setting.partial)
    if not changing and signature_of(task) != before:
        document = _because(task, "changing", "its files changed while they were read; call again when done")
        return Done(task, "", "", "", document)
    if len(document) > setting.limits.output_bytes:
        size, most = len(document), setting.limits.output_bytes
        document = _because(task, "too_large", f"its result has {size} bytes; at most {most} are kept")
    return Done(task, address, contents, before, document)


def _perform_remote(
    task: RunTask,
    setting: BatchSetting,
    out: Path | None,
    folder: Path,
    on_fetched: Callable[[Fetched], None],
) -> Done:
    """Fetch a run, score it, and check that it did not change meanwhile."""
    rules, _ = prepared(setting)
    topics = topics_read(rules) if setting.ranges else None
    try:
        fetched = fetch_run(task, folder, topics, most_bytes=setting.limits.input_bytes)
    except RunTooLargeError as error:
        return _beyond_size(task, error)
    except (ScoreError, OSError) as error:
        return _unreachable(task, error)
    on_fetched(fetched)
    with reading(fetched.parts):
        done = _perform_local(fetched.task, setting, out, _forget, changing=bool(fetched.parts))
        done = replace(done, task=task, signature=fetched.signature)
    # To a reader, a part that cannot be fetched is a damaged file; the reason is in `failure`.
    failures = [file.failure for file in fetched.parts if file.failure is not None]
    if failures:
        return _unreachable(task, failures[0])
    try:
        same = is_unchanged(task, fetched, ranges=setting.ranges)
    except ScoreError as error:
        return _unreachable(task, error)
    if same:
        return done
    return Done(task, "", "", "", _because(task, "changing", "it changed while it was fetched; call again"))


def _beyond_size(task: RunTask, error: RunTooLargeError) -> Done:
    """A run with too many or too large files; they were not hashed, so the next call looks again."""
    return Done(task, "", "", "", _because(task, "too_large", f"{error}; {error.hint}"))


def _unreachable(task: RunTask, error: Exception) -> Done:
    """A run whose files could not be fetched; nothing of it is kept, so that the next call tries again."""
    hint = getattr(error, "hint", "")
    return Done(task, "", "", "", _because(task, "unreachable", f"{error}; {hint}" if hint else str(error)))


def _recorded(task: RunTask, store: Store, address: str) -> Result | None:
    """The result at an address that the tables recorded for this run; any other may be somebody else's."""
    place = store.root / task.earlier
    if not task.earlier or place.parent.name != address:
        return None
    try:
        document = store.read(task.earlier)
        if hashlib.sha256(document).hexdigest() != task.earlier_sha256:
            return None
        return result_in(document, place, known=True)
    except (OSError, ScoreError):
        return None  # an outcome, which is found out again, or a damaged file


def _follows(earlier: Result, rule_set: RuleSet | None = None) -> bool:
    """Whether a stored result is what its rules (`rule_set`, where they are loaded) make of its findings."""
    try:
        check_rules(earlier)
        check_follows(earlier, rule_set)
    except ResultError:
        return False
    return True


def _priced_again(earlier: Result, rule_set: RuleSet) -> bytes | None:
    """The stored measurement under other prices; `None` where that is not to be had."""
    try:
        return as_json(reprice(earlier, rule_set)).encode("utf-8")
    except ScoreError:
        return None  # a formula without a value, say: measure, and say what is wrong


def _measured_before(task: RunTask, contents: str, setting: BatchSetting, store: Store) -> Result | None:
    """The result of the same files, by the same code, under rules that share some checks.

    The address says so: it is that of the earlier rules and the code of now only when neither the
    files nor any code has changed since.
    """
    if not task.earlier or not setting.earlier_basis:
        return None
    found = _recorded(task, store, measuring_address(task, contents, setting.earlier_basis))
    return found if found is not None and _follows(found) else None


def _scored(task: RunTask, rules: Prepared, known: Result | None, *, partial: bool) -> bytes:
    root = Path(task.root) if task.root else Path(task.path).parent
    try:
        result = score_trial(
            Path(task.path),
            rules,
            also=[Path(name) for name in task.also],
            work_by=task.work_by or rules.rule_set.authority.work or (ORGANISER if task.root else ""),
            root=Path(task.root) if task.root else None,
            trial_id=task.trial if task.root else "",
            team=task.team,
            known=known,
            partial=partial,
        )
        return as_json(result).encode("utf-8")
    except ScoreError as error:
        if isinstance(error, PluginError) and isinstance(error.__cause__, (MemoryError, OSError)):
            _blame_the_machine(error.__cause__)
        return _because(task, outcome_of(error), error_text(error, root))
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001  # a fault of ours may cost one run, never the others
        return _because(task, "failed", f"{type(error).__name__}: {error}".replace(f"{root}/", ""))


def _blame_the_machine(cause: MemoryError | OSError) -> None:
    """Raise what is no plugin's fault: any code could have been the one to need the last memory or disk."""
    if isinstance(cause, MemoryError):
        raise MemoryError from None
    if cause.errno in _NO_ROOM:
        raise OSError(cause.errno, os.strerror(cause.errno)) from None


def _because(task: RunTask, outcome: str, reason: str) -> bytes:
    return outcome_document(outcome, reason, team=task.team, trial=task.trial)


@cache
def installed() -> Registry:
    """The installed plugins, found once in a process and in those forked from it."""
    return Registry()


@cache
def prepared(setting: BatchSetting) -> tuple[Prepared, str]:
    """The rules and the basis of a setting, made once in a process and in those forked from it."""
    rules = prepare(setting.rule_set(), registry=setting.registry(installed()))
    expanded_yaml(rules.rule_set)  # cached, and every result holds it
    return rules, basis_of(rules, partial=setting.partial)


# In a process of its own ---------------------------------------------------------------


def perform_into(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> None:
    """What the process of one run does: keep the limits, score, leave a report.

    The report is a line of JSON, then the document; it appears whole or not at all. The supervisor ends
    the process when it is late; after a `kill -9` of the supervisor, an alarm does.
    """
    own_session()
    end_after(setting.limits.wall_s + _ORPHANED_S)
    listen_for_interrupts()  # else one that a plugin raises is taken for that of a person
    with contextlib.suppress(OSError):  # without room for a note, nobody can be named
        note_in(running_file(report))
    # What is fetched may be larger than a result, so its size is limited only afterwards.
    _set_limits(setting.limits, 0 if task.remote else setting.limits.output_bytes)
    _silence()
    try:
        _write_report(_perform_within(task, setting, out, report), report)
    except MemoryError:
        short = True  # the traceback, which holds the memory, is released when this block is left
    except OSError as error:
        os._exit(NO_ROOM if error.errno in _NO_ROOM else 1)  # without a report, it is tried again
    except Exception as error:  # noqa: BLE001  # its traceback is discarded, so the cause goes into the report
        reason = f"{type(error).__name__}: {error}"
        _write_report(Done(task, "", *noted(report), _because(task, "failed", reason)), report)
        short = False
    else:
        short = False
    if short:
        gc.collect()
        limit = setting.limits.memory_bytes >> 20
        reason = f"it needed more than {limit} MiB; raise --memory-mb if the log is sound"
        _write_report(Done(task, "", *noted(report), _because(task, "out_of_memory", reason)), report)
    os._exit(0)  # nothing is left to tidy up, and a regular exit takes as long as a small trial


def _perform_within(task: RunTask, setting: BatchSetting, out: Path | None, report: Path) -> Done:
    """Score a run, noting its hash and tightening the limits once its files are fetched."""

    def hashed(contents: str, signature: str) -> None:
        note_file(report).write_text(f"{contents} {signature}", encoding="ascii")

    def on_fetched(fetched: Fetched) -> None:
        hashed(fetched.contents, task.signature)
        largest = max((file.size for file in fetched.parts), default=0)
        _set_limits(setting.limits, max(largest, setting.limits.output_bytes))

    if task.remote:
        return _perform_remote(task, setting, out, fetched_folder(report), on_fetched)
    return perform(task, setting, out, hashed)


def noted(report: Path) -> tuple[str, str]:
    """Hash and signature of the files of a run as its process noted them; empty when it did not."""
    try:
        note = read_plain(note_file(report), LARGEST_HEAD_BYTES).decode("ascii")
    except (OSError, ValueError):
        return "", ""
    contents, _, signature = note.partition(" ")
    return (contents, signature) if _HASH.fullmatch(contents) else ("", "")


def _write_report(done: Done, report: Path) -> None:
    part, contents = report.with_suffix(".part"), report_of(done)
    try:
        part.write_bytes(contents)
    except OSError as error:
        if error.errno != errno.EMFILE:
            raise
        os.closerange(3, OPEN_FILES)  # a plugin has left them open, and nothing follows that would read them
        part.write_bytes(contents)
    part.replace(report)


def note_file(report: Path) -> Path:
    """Where the process of a run notes the hash of its files; the supervisor removes it."""
    return report.with_suffix(".contents")


def running_file(report: Path) -> Path:
    """Where the process of a run notes which plugin runs; the supervisor removes it."""
    return report.with_suffix(".running")


def fetched_folder(report: Path) -> Path:
    """Where the process of a remote run puts its files; the supervisor removes it."""
    return report.with_suffix(".fetched")


@dataclass(frozen=True)
class _Head:
    """The first line of a report; what follows it is the document.

    Attributes:
        run: Team, trial and number.
        path: Of the run.
        address: As in `Done`.
        contents: As in `Done`.
        signature: As in `Done`.
        stored: The document is stored already, and does not follow.
        cpu_s: As in `Done`.
        put_off: As in `Done`.
    """

    run: TaskKey
    path: str
    address: str
    contents: str
    signature: str
    stored: bool
    cpu_s: float
    put_off: bool


def report_of(done: Done) -> bytes:
    """The outcome of a task, for `parse_report`."""
    head = _Head(
        done.task.key,
        done.task.path,
        done.address,
        done.contents,
        done.signature,
        done.document is None,
        done.cpu_s or time.process_time(),
        done.put_off,
    )
    # Not msgspec's encoder, which refuses the half surrogate pairs of names that are no UTF-8.
    return json.dumps(asdict(head)).encode("ascii") + b"\n" + (done.document or b"")


def parse_report(task: RunTask, report: bytes) -> Done:
    """The outcome of a task, as its process reported it.

    Raises:
        ValueError: The report is not whole, or of another run, whose score this one may not get.
    """
    line, _, document = report.partition(b"\n")
    try:
        head = msgspec.convert(json.loads(line), _Head)
    except RecursionError:
        raise ValueError("its head is nested without end") from None
    if (head.run, head.path) != (task.key, task.path):
        raise ValueError(f"it is a report of {head.path}")
    # An address becomes the name of a file.
    if not all(_HASH.fullmatch(text) for text in (head.address, head.contents) if text):
        raise ValueError("its address is none")
    stored = None if head.stored else document
    return Done(task, head.address, head.contents, head.signature, stored, head.cpu_s, head.put_off)


def _set_limits(limits: Limits, largest_bytes: int) -> None:
    """Bind this process to its limits, 0 for none yet; nothing it starts can lift them."""
    # A report has a line more than its document, which `_perform_local` holds to the limit.
    limit_this_process(limits.memory_bytes, largest_bytes + LARGEST_HEAD_BYTES if largest_bytes else 0)


def _silence() -> None:
    """Discard what this process prints: hundreds of runs may not write to one terminal."""
    sys.stdout.flush()
    sys.stderr.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    # The descriptors, not `sys.stdout`: libraries in C print, too.
    os.dup2(nowhere, 1)
    os.dup2(nowhere, 2)
    os.close(nowhere)


def limit_threads() -> None:
    """Keep numeric libraries from starting a thread for each core in every process."""
    for name in _BLAS_THREADS:
        os.environ.setdefault(name, "1")
