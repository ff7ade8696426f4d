"""A batch from plan to tables."""

from __future__ import annotations

import errno
import json
import sqlite3
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from hashlib import sha256
from itertools import chain
from pathlib import Path
from sys import intern
from typing import IO, Any, Protocol

from ariac_score.batch.address import basis_of, measuring_address, signature_of
from ariac_score.batch.hash_cache import HashCache
from ariac_score.batch.index import RUNS, Row, Rows, Written, read_rows, tables_sha256, write_tables
from ariac_score.batch.outcomes import UNSETTLED, outcome_document, summary_of
from ariac_score.batch.pricing import Measurement, Priced, Pricing
from ariac_score.batch.store import Store
from ariac_score.batch.tasks import BatchSetting, RunTask, TaskKey
from ariac_score.batch.worker import Done
from ariac_score.engine.measure import needs_alike
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.engine.provenance import code_of
from ariac_score.errors import BatchError, ResultError, ScoreError, UsageError
from ariac_score.results.result_file import load_result
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text

__all__ = ["DESCRIPTION", "SCHEMA", "Executor", "Report", "described", "run_batch", "unwritable"]

SCHEMA = "ariac-score/batch/1"
DESCRIPTION = "batch.json"
RULES = "rules.yaml"
_BEFORE = ".rules-before.yaml"
"""The rules of the last batch that ended, until this one does: its measurements are still of use."""
_KEEP_EVERY, _KEEP_AFTER_S = 64, 1.0
"""So many runs, or those of so long, a cluster may have to score again when the supervisor is killed."""


class Executor(Protocol):
    """Where runs are scored: on this machine, or on many.

    Found through the entry-point group `ariac_score.executors`.
    """

    def run(self, tasks: Iterable[RunTask], setting: BatchSetting) -> Iterator[Done]:
        """Score tasks and give what came of each exactly once, in any order."""
        ...


@dataclass(frozen=True)
class Report:
    """What a call did.

    Attributes:
        outcomes: How many runs have which outcome, those of earlier calls included.
        scored_now: How many were looked at in this call.
        cpu_s: What their processes took of the processor, s.
        contradictions: Rows of the tables that said something else than their documents, and were
            made again; an index that did so counts as one.
    """

    outcomes: Mapping[str, int]
    scored_now: int
    cpu_s: float = 0.0
    contradictions: int = 0

    @property
    def runs(self) -> int:
        """All runs."""
        return sum(self.outcomes.values())

    @property
    def unsettled(self) -> int:
        """Runs that somebody should look at."""
        return sum(number for outcome, number in self.outcomes.items() if outcome in UNSETTLED)


OnOutcome = Callable[[TaskKey, str, str], None]
"""Called for each run with its key, outcome and reason."""


def run_batch(
    tasks: Iterable[RunTask],
    rule_set: RuleSet,
    setting: BatchSetting,
    store: Store,
    work: Path,
    executor: Executor,
    *,
    about: Mapping[str, object],
    again: bool = False,
    told: OnOutcome = lambda _key, _outcome, _reason: None,
) -> Report:
    """Score what is not scored yet, and write the tables.

    Args:
        tasks: All runs.
        rule_set: By which they are scored.
        setting: The same for the workers, with the limits.
        store: The folder of the batch.
        work: Folder for unfinished work, from `Store.working`.
        executor: Where runs are scored.
        about: What the description of the batch says beside rules and code.
        again: Try those again that ended without being read to the end: late, out of memory, killed.
        told: Called for each run.

    Raises:
        BatchError: The folder cannot be written, as when the disk is full; what was found is kept.
        UsageError: A newer version made the folder.
        ScoreError: A check of the rules cannot be built.
    """
    described(store.root)
    prepared = prepare(rule_set)  # what is wrong with it is said once, not for every run
    basis = basis_of(prepared)
    setting = replace(setting, earlier_basis=_earlier_basis(store, prepared, setting))
    seen, rows = HashCache(store.root), _remembering(store, work)
    pricing = Pricing(setting, store, work)
    settled, kept_s = _Settled(rows, told), time.monotonic()
    now, cpu_s, contradictions, trusted = 0, 0.0, 0, _as_written(store, seen)

    def missing() -> Iterator[RunTask]:
        nonlocal contradictions
        for task in tasks:
            found = _stored(task, basis, setting, store, seen, rows, again=again, trusted=trusted)
            if isinstance(found, Written):
                contradictions += _contradicted(rows.earlier(task.key), found)
                settled.add(task.key, found, known=True)
            elif found is not None:
                yield from settled.add_priced(pricing.take(found))
            else:
                yield _with_earlier(task, rows)
        yield from settled.add_priced(pricing.rest())

    def look(still: Iterable[RunTask]) -> None:
        nonlocal now, cpu_s, kept_s
        for done in executor.run(_told_apart(still, settled), setting):
            known = _addressed(done, basis)
            settled.add(known.task.key, Written.of(_kept(known, setting, store)))
            seen.note(known.signature, known.contents)
            now += 1
            cpu_s += done.cpu_s
            if now % _KEEP_EVERY == 0 or time.monotonic() - kept_s > _KEEP_AFTER_S:
                seen.keep()
                kept_s = time.monotonic()

    try:
        settled.journal = store.journal.open("a", encoding="ascii", newline="\n")
        _describe(store, prepared, setting, about)
        look(missing())
        contradictions += write_tables(store, rows, work, trusted=trusted)
        _finished(store, seen)
    except (OSError, sqlite3.OperationalError) as cause:
        raise unwritable(cause, store) from cause
    finally:
        pricing.close()
        _let_go(settled.journal, seen, rows)
    return Report(dict(settled.outcomes), now, cpu_s, contradictions)


@dataclass
class _Settled:
    """The runs of which is known what becomes of them, kept and told as they come.

    Attributes:
        rows: Where their rows go.
        told: Who is told.
        journal: Where rows that are new stand until the tables are written.
        outcomes: How many runs have which outcome.
    """

    rows: Rows
    told: OnOutcome
    journal: IO[str] | None = None
    outcomes: Counter[str] = field(default_factory=Counter)

    def add(self, key: TaskKey, row: Written, *, known: bool = False) -> None:
        """Take the row of a run, which an earlier call has found out or this one."""
        self.rows.add(key, row.line)
        if self.journal is not None and not known:
            self.journal.write(row.line)
            self.journal.flush()
        self.outcomes[row.outcome] += 1
        self.told(key, row.outcome, row.reason)

    def add_priced(self, found: Iterable[Priced]) -> Iterator[RunTask]:
        """Take the rows of those that have their price; the tasks for which that cannot be done."""
        for one, row in found:
            if row is None:
                yield one.task
            else:
                self.add(one.task.key, row)


def _remembering(store: Store, work: Path) -> Rows:
    """Room for rows, with those of earlier calls."""
    try:
        rows = Rows(work)
        rows.remember(chain(read_rows(store.root / RUNS), read_rows(store.journal)))
    except sqlite3.OperationalError as cause:
        raise unwritable(cause, store) from cause
    return rows


def _earlier_basis(store: Store, prepared: Prepared, setting: BatchSetting) -> str:
    """The basis of the rules that scored here before, by the code of now; empty where it is of no use."""
    try:
        text = _earlier_rules(store, setting)
        if not text:
            return ""
        earlier = replace(rule_set_from_text(text, file=setting.rules_file), file=setting.rules_file)
        rules = prepare(earlier, registry=prepared.registry)
        return basis_of(rules) if needs_alike(rules, prepared) else ""
    except (OSError, ValueError, ScoreError):
        return ""  # the first call, or rules that cannot be read any more


def _earlier_rules(store: Store, setting: BatchSetting) -> str:
    """The rules by which most of what is stored was measured, where they are not those of now."""
    for name in (_BEFORE, RULES):
        place = store.root / name
        if place.is_file():
            text = place.read_text(encoding="utf-8")
            if text != setting.rules:
                return text
    return ""


def _with_earlier(task: RunTask, rows: Rows) -> RunTask:
    row = rows.earlier(task.key)
    return task if row is None else replace(task, earlier=row.object, earlier_sha256=row.sha256)


def _told_apart(tasks: Iterable[RunTask], settled: _Settled) -> Iterator[RunTask]:
    """The tasks that can be scored; the others are settled by name."""
    for task in tasks:
        if not task.refused:
            yield task
            continue
        document = outcome_document("refused", task.refused, team=task.team, trial=task.trial)
        settled.add(task.key, Written.of(Row.of(task.key, summary_of(document))))


def _stored(
    task: RunTask,
    basis: str,
    setting: BatchSetting,
    store: Store,
    seen: HashCache,
    rows: Rows,
    *,
    again: bool,
    trusted: bool,
) -> Written | Measurement | None:
    """The row of a run that is scored already, or what of it is measured under other prices.

    `None` when it is neither, or nobody can tell without reading its files.
    """
    if task.refused:
        return None
    signature = signature_of(task)
    contents = seen.contents(signature) if signature else ""
    if not contents:
        return None
    address = measuring_address(task, contents, basis)
    row = _row_at(task.key, store.name_of(address, setting.rules_sha256), store, rows, trusted=trusted)
    if row is not None:
        return None if again and row.outcome in _WORTH_ANOTHER_TRY else row
    earlier = rows.earlier(task.key)
    if earlier is not None and earlier.object.split("/")[-2:-1] == [address]:
        return Measurement(task, address, intern(earlier.object.rpartition("/")[2]), earlier.sha256)
    other = store.priced_otherwise(address)
    return None if other is None else Measurement(task, address, intern(other.name), "")


_WORTH_ANOTHER_TRY = frozenset({"timed_out", "out_of_memory", "killed", "too_large", "failed"})


_TABLES = "the tables"
"""Under which name `HashCache` keeps the hash of the tables that were written last."""


def _let_go(journal: IO[str] | None, seen: HashCache, rows: Rows) -> None:
    if journal is not None:
        with suppress(OSError):
            journal.close()
    seen.close()
    rows.close()


def _as_written(store: Store, seen: HashCache) -> bool:
    """Whether the tables are as this machine wrote them: then ten thousand documents need not be read."""
    return not store.journal.exists() and seen.contents(_TABLES) == (tables_sha256(store.root) or "none")


def _finished(store: Store, seen: HashCache) -> None:
    seen.note(_TABLES, tables_sha256(store.root))
    (store.root / _BEFORE).unlink(missing_ok=True)
    store.journal.unlink()


def _row_at(key: TaskKey, name: str, store: Store, rows: Rows, *, trusted: bool) -> Written | None:
    """The row of a stored document; `None` when there is none, or one that nobody should believe."""
    try:
        document = store.read(name)
        row = rows.earlier(key)
        if row is None or row.object != name or row.sha256 != sha256(document).hexdigest():
            # The table knows another document, or none: this one counts only if it follows from itself.
            load_result(store.root / name)
        elif trusted:
            return row
        return Written.of(Row.kept(key, document, name))
    except (OSError, ValueError, ResultError):
        return None


def _contradicted(earlier: Written | None, found: Written) -> bool:
    """Whether a table said of a document what it does not say."""
    return (
        earlier is not None
        and earlier is not found
        and earlier.object == found.object
        and Row.from_line(earlier.line).as_line() != found.line
    )


def _addressed(done: Done, basis: str) -> Done:
    """What an executor brought, with the address it belongs to; empty where its process hashed nothing."""
    if done.address or done.document is None or not done.contents:
        return done
    return replace(done, address=measuring_address(done.task, done.contents, basis))


def _kept(done: Done, setting: BatchSetting, store: Store) -> Row:
    """The row of what came of a task, its document stored."""
    task = done.task
    if not done.address and done.document is not None:
        return Row.of(task.key, summary_of(done.document))
    name = store.name_of(done.address, setting.rules_sha256)
    if done.document is None:
        return Row.kept(task.key, store.read(name), name)
    store.put(store.root / name, done.document)
    return Row.kept(task.key, done.document, name)


def _describe(store: Store, prepared: Prepared, setting: BatchSetting, about: Mapping[str, object]) -> None:
    """Write by which rules and code, and for what, before anything else."""
    names = ("distribution", "version", "package", "sha256")
    told = {
        "schema": SCHEMA,
        "rule_set": {"id": prepared.rule_set.id, "sha256": prepared.rule_set.sha256},
        "code": [dict(zip(names, code, strict=True)) for code in code_of(prepared)],
        **about,
    }
    text = json.dumps(told, sort_keys=True, indent=1, ensure_ascii=True) + "\n"
    rules, before = store.root / RULES, store.root / _BEFORE
    if rules.is_file() and not before.exists() and rules.read_bytes() != setting.rules.encode("utf-8"):
        store.put(before, rules.read_bytes())
    for name, content in ((DESCRIPTION, text), (RULES, setting.rules)):
        place = store.root / name
        if not place.is_file() or place.read_text(encoding="utf-8") != content:
            store.put(place, content.encode("utf-8"))


def described(folder: Path) -> Mapping[str, Any]:
    """What a batch says of itself; nothing where nobody can tell.

    Raises:
        UsageError: Another version made it, which this one cannot read.
    """
    try:
        told = json.loads((folder / DESCRIPTION).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    if not isinstance(told, dict) or not isinstance(told.get("schema"), str):
        return {}
    if told["schema"] != SCHEMA:
        raise UsageError(
            f"it was made as {told['schema']}, and this version reads {SCHEMA}",
            file=folder,
            hint="use the version that made it, or a folder of its own",
        )
    return told


def unwritable(cause: OSError | sqlite3.Error, store: Store) -> BatchError:
    """What to tell when the folder of a batch, or a table in it, cannot be written."""
    reason = getattr(cause, "strerror", None) or str(cause)
    full = getattr(cause, "errno", 0) in (errno.ENOSPC, errno.EDQUOT) or "disk is full" in reason
    return BatchError(
        "the disk is full" if full else f"cannot be written: {reason}",
        file=store.root,
        hint=("make room" if full else "check the permissions")
        + " and call again: what was scored is kept, and only the rest is done",
    )
