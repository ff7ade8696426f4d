"""Joining the parts of a batch, such as its shards, in one folder."""

from __future__ import annotations

import hashlib
import sqlite3
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from msgspec import structs

from ariac_score.batch.description import DESCRIPTION, RULES, BatchDescription, load_description
from ariac_score.batch.index import (
    AGAIN,
    RUNS,
    Row,
    Rows,
    check_index,
    checked_rows,
    read_rows,
    refuse_other_rules,
    write_tables,
)
from ariac_score.batch.results import refuse_forged
from ariac_score.batch.store import Store, read_document
from ariac_score.batch.supervise import Report, unwritable
from ariac_score.errors import BatchError, UsageError
from ariac_score.results.signing import keys_asked_for, refuse_unsigned
from ariac_score.scoring.ruleset import rule_set_from_text

__all__ = ["merge_batches"]


def merge_batches(
    parts: Sequence[Path], store: Store, work: Path, *, mixed_code: bool = False, public_key: str = ""
) -> Report:
    """Join batches, or shards of one, into one folder; the parts stay as they are.

    Args:
        parts: Folders of finished batches.
        store: The folder to join them in; what it holds already stays.
        work: Folder for unfinished work, from `Store.working`.
        mixed_code: Join results that were made by different code.
        public_key: Who must have signed the table of each part; empty for whom their rules name, if anybody.

    Raises:
        UsageError: A part is no finished batch, or was made by other rules or other code.
        BatchError: Two parts have different results for one run, a document is missing, damaged or not
            what its rules make of its findings, or the folder cannot be written.
    """
    descriptions = [_description(part) for part in parts]
    for part, description in zip(parts[1:], descriptions[1:], strict=True):
        _refuse_difference(part, description, parts[0], descriptions[0], mixed_code=mixed_code)
        _refuse_edited_rules(part, description)
    _refuse_edited_rules(parts[0], descriptions[0])
    _refuse_gaps(descriptions)
    rules = parts[0] / RULES
    rule_set = rule_set_from_text(read_document(rules).decode("utf-8"), file=str(rules))
    keys = keys_asked_for(rule_set.authority.signed_by, public_key)
    for part in parts:
        refuse_unsigned(part / RUNS, keys)
    joined = structs.replace(descriptions[0], shard=None)
    outcomes = Counter[str]()
    rows = None
    try:
        rows = Rows(work)
        for part in parts:
            for row, document in checked_rows(part):
                refuse_other_rules(row, joined.rule_set, part)
                if row.object and not keys:  # tables that are signed name every result with its hash
                    refuse_forged(document, part / row.object, rule_set)
                _take(row, document, part, store, rows)
            check_index(part, (row for row, _ in read_rows(part / RUNS)))
        for line in rows.lines():
            outcomes[Row.from_line(line).outcome] += 1
        store.put(store.root / DESCRIPTION, joined.text().encode("utf-8"))
        store.put(store.root / RULES, read_document(parts[0] / RULES))
        write_tables(store, rows, work)
    except (OSError, sqlite3.OperationalError) as cause:
        raise unwritable(cause, store) from cause
    finally:
        if rows is not None:
            rows.close()
    return Report(dict(outcomes), sum(outcomes.values()))


def _take(row: Row, document: bytes, part: Path, store: Store, rows: Rows) -> None:
    name = "/".join(map(str, row.key)).lstrip("/")
    taken = rows.get(row.key)
    if taken is not None and taken.as_line() != row.as_line():
        raise BatchError(
            f"run {name} has two results: {taken.object or taken.outcome} and {row.object or row.outcome}",
            file=part,
            hint="its log differed between the parts; score that run again in one of them",
        )
    rows.add(row.key, row.as_line())
    if not row.object:
        return
    place = store.root / row.object
    if not place.is_file():
        store.put(place, document)
    elif read_document(place) != document:
        raise BatchError(
            "differs from the result of the same name in another part",
            file=part / row.object,
            hint="one of the two was edited or damaged; score that run again",
        )


def _description(part: Path) -> BatchDescription:
    description = load_description(part, hint=f"it needs {DESCRIPTION}, which 'batch' writes")
    if not (part / RUNS).is_file():
        raise UsageError(
            "this batch has not finished", file=part, hint="call 'batch' again with this folder, then merge"
        )
    return description


_DIFFERENCES = {
    "batch": "another competition",
    "rule_set": "another rule set",
    "read": "another way of reading",
    "code": "another code",
}
"""What it means when two descriptions differ in a field; each shard differs in `shard`."""


def _refuse_difference(
    part: Path, description: BatchDescription, first_part: Path, first: BatchDescription, *, mixed_code: bool
) -> None:
    """Refuse to join a part of another batch than the first.

    Raises:
        UsageError: It was made by other rules or other code, or of other runs.
    """
    for key, meaning in _DIFFERENCES.items():
        if getattr(description, key) == getattr(first, key) or (key == "code" and mixed_code):
            continue
        raise UsageError(
            f"it was made by {_field_text(description, key)}, and {first_part} by "
            f"{_field_text(first, key)}: {meaning}",
            file=part,
            hint="--mixed-code joins them all the same; a ranking should rest on one code"
            if key == "code"
            else "join only parts of one batch",
        )


def _refuse_edited_rules(part: Path, description: BatchDescription) -> None:
    """Refuse a part whose rules have another hash than it states.

    Raises:
        UsageError: They have.
    """
    try:
        found = hashlib.sha256(read_document(part / RULES)).hexdigest()
    except OSError as cause:
        raise BatchError(f"cannot be read: {cause.strerror}", file=part / RULES, hint=AGAIN) from cause
    if found != description.rule_set.sha256:
        raise UsageError(
            f"it has SHA-256 {found[:12]}…, and the part states {description.rule_set.sha256[:12]}…",
            file=part / RULES,
            hint="get the part again, or score it again",
        )


def _refuse_gaps(descriptions: Sequence[BatchDescription]) -> None:
    """Refuse to join shards of which one is missing: its runs would be dropped in silence."""
    shards = [description.shard for description in descriptions if description.shard is not None]
    for count in {shard.of for shard in shards}:
        numbers = {shard.number for shard in shards if shard.of == count}
        missing = sorted(set(range(1, count + 1)) - numbers)
        if missing:
            named = ", ".join(f"{number}/{count}" for number in missing[:5])
            are = "is" if len(missing) == 1 else "are"
            raise UsageError(
                f"{len(missing)} of {count} shards {are} missing: {named}{', …' if missing[5:] else ''}",
                hint="name the folders of all shards",
            )


def _field_text(description: BatchDescription, key: str) -> str:
    """A field of a description, for an error message."""
    if key == "read":
        return "reading parts" if description.read == "parts" else "reading everything"
    if key == "rule_set":
        return f"{description.rule_set.id} ({description.rule_set.sha256[:12]}…)"
    if key == "code":
        return ", ".join(f"{code.package} {code.version} ({code.sha256[:12]}…)" for code in description.code)
    return repr(description.batch)
