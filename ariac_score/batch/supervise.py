"""A batch from plan to tables."""

from __future__ import annotations

import errno
import sqlite3
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field, replace
from hashlib import sha256
from pathlib import Path
from sys import intern
from typing import IO, Protocol

from ariac_score.batch.address import basis_of, measuring_address
from ariac_score.batch.description import DESCRIPTION, RULES, BatchDescription, Shard, refuse_other_version
from ariac_score.batch.hash_cache import HashCache
from ariac_score.batch.index import RUNS, Row, Rows, Written, read_rows, tables_sha256, write_tables
from ariac_score.batch.local import lost
from ariac_score.batch.looking import signatures
from ariac_score.batch.outcomes import UNSETTLED, outcome_document, summary_of
from ariac_score.batch.pricing import Measurement, Priced, Pricing
from ariac_score.batch.results import refuse_forged
from ariac_score.batch.state import OnState, unwatched
from ariac_score.batch.store import Store
from ariac_score.batch.tasks import BatchSetting, RunTask, TaskKey
from ariac_score.batch.worker import Done
from ariac_score.checks.registry import Registry
from ariac_score.engine.measure import needs_alike
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.engine.provenance import code_of
from ariac_score.errors import BatchError, ResultError, ScoreError
from ariac_score.results.result import Code, Pinned
from ariac_score.results.signing import refuse_unsigned
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text

__all__ = ["Executor", "OnOutcome", "Report", "run_batch", "unwritable"]

_BEFORE = ".rules-before.yaml"
"""The rules of the last batch that ended, until this one does: its measurements are still of use."""
_KEEP_EVERY, _KEEP_AFTER_S = 64, 1.0
"""So many runs, or those of so long, a cluster may have to score again when the supervisor is killed."""


class Executor(Protocol):
    """Where runs are scored: on this machine, or on many.

    Found through the entry-point group `ariac_score.executors`.
    """

    def run(self, tasks: Iterable[RunTask], setting: BatchSetting) -> Iterator[Done]:
        """Score tasks, and yield the outcome of each exactly once, in any order."""
        ...


@dataclass(frozen=True)
class Report:
    """What a call did.

    Attributes:
        outcomes: How many runs have which outcome, those of earlier calls included.
        scored_now: How many were looked at in this call.
        cpu_s: What their processes took of the processor, s.
        contradictions: Rows of the tables that contradicted their documents, and were made again; an
            index that did so counts as one.
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
    name: str,
    shard: Shard | None = None,
    again: bool = False,
    on_outcome: OnOutcome = lambda _key, _outcome, _reason: None,
    on_state: OnState = unwatched,
    signed_by: Sequence[str] = (),
    on_unsigned: Callable[[str], None] = lambda _reason: None,
) -> Report:
    """Score what is not scored yet, and write the tables.

    Args:
        tasks: All runs.
        rule_set: By which they are scored.
        setting: The same for the workers, with the limits.
        store: The folder of the batch.
        work: Folder for unfinished work, from `Store.working`.
        executor: Where runs are scored.
        name: Of the competition or folder, for the description of the batch.
        shard: Which part of the batch the tasks are; `None` for all of it.
        again: Try those again that ended without being read to the end: late, out of memory, killed.
        on_outcome: Called for each run.
        on_state: Called again and again with what is done and waited for; the executor has to have
            an attribute of this name.
        signed_by: Keys one of which must have signed the tables of an earlier call; where none has, nothing
            that is stored is believed, and every run is scored again.
        on_unsigned: Called with the reason where that is so.

    Raises:
        BatchError: The folder cannot be written, as when the disk is full; what was found is kept.
        UsageError: A newer version made the folder.
        ScoreError: A check of the rules cannot be built.
    """
    refuse_other_version(store.root)
    if hasattr(executor, "on_state"):
        executor.on_state = on_state
    prepared = prepare(
        rule_set, registry=setting.registry(Registry())
    )  # what is wrong with it is reported once, not for every run
    setting = replace(setting, earlier_basis=_earlier_basis(store, prepared, setting))
    description = BatchDescription(
        name,
        Pinned(rule_set.id, rule_set.sha256),
        tuple(Code(*code) for code in code_of(prepared)),
        "parts" if setting.ranges else "",
        shard,
    )
    try:
        with ExitStack() as opened:
            rows = opened.enter_context(closing(Rows(work)))
            # The journal last: it is newer than the tables, and a later row replaces an earlier one.
            for table in (store.root / RUNS, store.journal):
                if table.is_file() and (reason := _not_signed(table, signed_by)):
                    on_unsigned(reason)
                else:
                    rows.remember(read_rows(table))
            hashes = opened.enter_context(closing(HashCache(store.root)))
            trusted = _unchanged(store, hashes)  # before the journal is made, whose presence is a sign
            if store.journal.exists() and not store.journal.is_file():
                store.journal.unlink()  # a pipe would be waited for
            journal = store.journal.open("a", encoding="ascii", newline="\n")
            opened.callback(_close, journal)
            pricing = opened.enter_context(closing(Pricing(setting, store, work)))
            settled = _Settled(rows, journal, on_outcome, hashes)
            basis = basis_of(prepared, partial=setting.partial)
            call = _Call(basis, rule_set, setting, store, rows, hashes, pricing, settled, trusted, again)
            _describe(store, description, setting)
            call.score(tasks, executor)
            call.contradictions += write_tables(store, rows, work, trusted=trusted)
            _finish(store, hashes)
    except (OSError, sqlite3.OperationalError) as cause:
        raise unwritable(cause, store) from cause
    return Report(dict(settled.outcomes), call.scored_now, call.cpu_s, call.contradictions)


def _not_signed(table: Path, keys: Sequence[str]) -> str:
    try:
        refuse_unsigned(table, keys)
    except ResultError as error:
        return str(error)
    return ""


def _close(journal: IO[str]) -> None:
    with suppress(OSError):  # each row was flushed when it was written, or that raised
        journal.close()


@dataclass
class _Settled:
    """The runs whose outcome is known, reported as they come.

    Attributes:
        rows: Where their rows go.
        journal: Where new rows stand until the tables are written.
        on_outcome: Called for each.
        hashes: Remembers what was stored here.
        outcomes: How many runs have which outcome.
    """

    rows: Rows
    journal: IO[str]
    on_outcome: OnOutcome
    hashes: HashCache
    outcomes: Counter[str] = field(default_factory=Counter)

    def add(self, key: TaskKey, row: Written, *, known: bool = False) -> None:
        """Take the row of a run; `known` when an earlier call found it out."""
        self.rows.add(key, row.line)
        if not known:
            self.hashes.note(_of_row(row.object), row.sha256)
            self.journal.write(row.line)
            # The supervisor may be killed at any moment, and the next call goes on from here.
            self.journal.flush()
        self.outcomes[row.outcome] += 1
        self.on_outcome(key, row.outcome, row.reason)

    def add_priced(self, found: Iterable[Priced]) -> Iterator[RunTask]:
        """Take the rows of those that have their price; the tasks for which that cannot be done."""
        for one, row in found:
            if row is None:
                yield one.task
            else:
                self.add(one.task.key, row)

    def add_refused(self, task: RunTask) -> None:
        """Take a run that cannot be distinguished from another one."""
        document = outcome_document("refused", task.refused, team=task.team, trial=task.trial)
        self.add(task.key, Written.of(Row.of(task.key, summary_of(document))))


@dataclass
class _Call:
    """One call of a batch: what it works with, and what it has done.

    Attributes:
        basis: Hash of the checks, the log map and the code.
        rule_set: By which runs are scored.
        setting: Rules and limits.
        store: The folder of the batch.
        rows: Of this call and of earlier ones.
        hashes: Of files that were hashed before.
        pricing: Puts the prices of now on measurements of earlier rules.
        settled: The runs whose outcome is known.
        trusted: The tables are as this machine wrote them.
        again: Try those again that ended without being read to the end.
    """

    basis: str
    rule_set: RuleSet
    setting: BatchSetting
    store: Store
    rows: Rows
    hashes: HashCache
    pricing: Pricing
    settled: _Settled
    trusted: bool
    again: bool
    scored_now: int = 0
    cpu_s: float = 0.0
    contradictions: int = 0

    def score(self, tasks: Iterable[RunTask], executor: Executor) -> None:
        """Score those that are missing.

        Raises:
            OSError: The folder cannot be written, as when the disk is full.
        """
        kept_s = time.monotonic()
        for done in executor.run(self._missing(tasks), self.setting):
            known = self._addressed(done)
            try:
                row = self._stored_row(known)
            except (ValueError, RecursionError):  # of no schema, or nested without end
                known = lost(known.task, "failed", "what its process left is no result")
                row = self._stored_row(known)
            self.settled.add(known.task.key, Written.of(row))
            self.hashes.note(known.signature, known.contents)
            self.scored_now += 1
            self.cpu_s += done.cpu_s
            if self.scored_now % _KEEP_EVERY == 0 or time.monotonic() - kept_s > _KEEP_AFTER_S:
                self.hashes.keep()
                kept_s = time.monotonic()

    def _missing(self, tasks: Iterable[RunTask]) -> Iterator[RunTask]:
        """The tasks that have to be scored; all others are settled on the way."""
        # Of a run that no earlier call knew, nothing is looked at here: its own process does that.
        for task, signature in signatures(tasks, lambda task: self.rows.earlier(task.key) is not None):
            if task.refused:
                self.settled.add_refused(task)
                continue
            found = self._stored(task, signature)
            if isinstance(found, Written):
                self.contradictions += _contradicted(self.rows.earlier(task.key), found)
                self.settled.add(task.key, found, known=True)
            elif found is not None:
                yield from self.settled.add_priced(self.pricing.take(found))
            else:
                yield self._with_earlier(task)
        yield from self.settled.add_priced(self.pricing.rest())

    def _stored(self, task: RunTask, signature: str) -> Written | Measurement | None:
        """The row of a run that is scored already, or what of it is measured under other prices.

        `None` when it is neither, or when only its files could tell.
        """
        contents = self.hashes.contents(signature) if signature else ""
        if not contents:
            return None
        address = measuring_address(task, contents, self.basis)
        name = self.store.name_of(address, self.setting.rules_sha256)
        row = self._row_at(task.key, name)
        if row is not None:
            return None if self.again and row.outcome in _WORTH_ANOTHER_TRY else row
        earlier = self.rows.earlier(task.key)
        if earlier is None or earlier.object == name or self._is_other(earlier):
            return None
        if earlier.object.split("/")[-2:-1] == [address]:
            return Measurement(task, address, intern(earlier.object.rpartition("/")[2]), earlier.sha256)
        return None

    def _with_earlier(self, task: RunTask) -> RunTask:
        """The run with what the tables recorded of it, for its worker."""
        row = self.rows.earlier(task.key)
        if row is None or self._is_other(row):
            return task
        return replace(task, earlier=row.object, earlier_sha256=row.sha256)

    def _is_other(self, row: Written) -> bool:
        """Whether this machine stored another document under the name that a row gives."""
        return self.hashes.contents(_of_row(row.object)) not in ("", row.sha256)

    def _row_at(self, key: TaskKey, name: str) -> Written | None:
        """The row of the document that the tables recorded; `None` when there is none, or another lies there.

        Tables that this machine did not write may have been rewritten with the document: of those it
        stored it knows the hash, and any other is priced again. What follows from itself and was never
        here may still be forged: then only a signature, or its log, shows what was measured.
        """
        row = self.rows.earlier(key)
        if row is None or row.object != name:
            return None
        try:
            document = self.store.read(name)
            if row.sha256 != sha256(document).hexdigest():
                return None
            if self.trusted:
                return row
            if self._is_other(row):
                return None
            if not self.hashes.contents(_of_row(name)):
                refuse_forged(document, self.store.root / name, self.rule_set)
                self.hashes.note(_of_row(name), row.sha256)
            return Written.of(Row.kept(key, document, name))
        except (OSError, ValueError, BatchError):
            return None

    def _addressed(self, done: Done) -> Done:
        """What an executor brought, with its address; empty where its process hashed nothing."""
        if done.address or done.document is None or not done.contents:
            return done
        return replace(done, address=measuring_address(done.task, done.contents, self.basis))

    def _stored_row(self, done: Done) -> Row:
        """Store the document of an outcome; its row."""
        key = done.task.key
        if not done.address and done.document is not None:
            return Row.of(key, summary_of(done.document))
        name = self.store.name_of(done.address, self.setting.rules_sha256)
        if done.document is None:
            return Row.kept(key, self.store.read(name), name)
        row = Row.kept(key, done.document, name)  # first: what is no result is not stored
        self.store.put(self.store.root / name, done.document)
        return row


# Another machine, or more time and memory, may do better; the other outcomes follow from the files.
_WORTH_ANOTHER_TRY = frozenset({"timed_out", "out_of_memory", "killed", "too_large", "failed"})


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
        return ""  # rules that this version, or without a plugin that is gone, cannot be read any more


def _earlier_rules(store: Store, setting: BatchSetting) -> str:
    """The rules by which most of what is stored was measured, where they are not those of now."""
    for name in (_BEFORE, RULES):
        place = store.root / name
        if place.is_file():
            text = place.read_text(encoding="utf-8")
            if text != setting.rules:
                return text
    return ""


_TABLES = "the tables"
"""Under which name `HashCache` keeps the hash of the tables that were written last."""


def _unchanged(store: Store, hashes: HashCache) -> bool:
    """Whether the tables are as this machine wrote them: then ten thousand documents need not be parsed."""
    return not store.journal.exists() and hashes.contents(_TABLES) == (tables_sha256(store.root) or "none")


def _finish(store: Store, hashes: HashCache) -> None:
    hashes.note(_TABLES, tables_sha256(store.root))
    (store.root / _BEFORE).unlink(missing_ok=True)
    store.journal.unlink()


def _of_row(name: str) -> str:
    """Under which name `HashCache` keeps the hash of a document that was stored here; empty for none."""
    return f"document {name}" if name else ""


def _contradicted(earlier: Written | None, found: Written) -> bool:
    """Whether a row of the tables contradicted its document."""
    return (
        earlier is not None
        and earlier is not found
        and earlier.object == found.object
        and Row.from_line(earlier.line).as_line() != found.line
    )


def _describe(store: Store, description: BatchDescription, setting: BatchSetting) -> None:
    """Write by which rules and code, and for what, before anything else."""
    rules, before = store.root / RULES, store.root / _BEFORE
    # Only once until a batch ends: most of what is stored was measured by the first of several rules.
    if rules.is_file() and not before.exists() and rules.read_bytes() != setting.rules.encode("utf-8"):
        store.put(before, rules.read_bytes())
    for name, text in ((DESCRIPTION, description.text()), (RULES, setting.rules)):
        place, content = store.root / name, text.encode("utf-8")
        if not place.is_file() or place.read_bytes() != content:
            store.put(place, content)


def unwritable(cause: OSError | sqlite3.Error, store: Store) -> BatchError:
    """The error to raise when the folder of a batch, or a table in it, cannot be written."""
    reason = getattr(cause, "strerror", None) or str(cause)
    full = getattr(cause, "errno", 0) in (errno.ENOSPC, errno.EDQUOT) or "disk is full" in reason
    return BatchError(
        "the disk is full" if full else f"cannot be written: {reason}",
        file=store.root,
        hint=("make room" if full else "check the permissions")
        + " and call again: what was scored is kept, and only the rest is done",
    )
