"""Joining the parts of a batch that were scored apart."""

from __future__ import annotations

import json
import sqlite3
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ariac_score.batch.index import RUNS, Row, Rows, check_index, checked_rows, read_rows, write_tables
from ariac_score.batch.store import Store
from ariac_score.batch.supervise import DESCRIPTION, Report, described, unwritable
from ariac_score.errors import BatchError, UsageError

__all__ = ["merge_batches"]


def merge_batches(parts: Sequence[Path], store: Store, work: Path, *, mixed_code: bool = False) -> Report:
    """Join batches, or shards of one, into one folder; the parts stay as they are.

    Args:
        parts: Folders of finished batches.
        store: The folder to join them in; what it holds already stays.
        work: Folder for unfinished work, from `Store.working`.
        mixed_code: Join results that were made by different code.

    Raises:
        UsageError: A part is no finished batch, or was made by other rules or other code.
        BatchError: Two parts have different results for one run, a document is missing or
            damaged, or the folder cannot be written.
    """
    described = [(part, _description(part)) for part in parts]
    told = _told_alike(described, mixed_code=mixed_code)
    _refuse_gaps([description for _, description in described])
    outcomes = Counter[str]()
    rows = None
    try:
        rows = Rows(work)
        for part in parts:
            for row, document in checked_rows(part):
                _take(row, document, part, store, rows)
            check_index(part, (row for row, _ in read_rows(part / RUNS)))
        for line in rows.lines():
            outcomes[Row.from_line(line).outcome] += 1
        store.put(store.root / DESCRIPTION, (json.dumps(told, sort_keys=True, indent=1) + "\n").encode())
        store.put(store.root / "rules.yaml", (parts[0] / "rules.yaml").read_bytes())
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
    elif place.read_bytes() != document:
        raise BatchError(
            "differs from the result of the same name in another part",
            file=part / row.object,
            hint="one of the two was edited or damaged; score that run again",
        )


def _description(part: Path) -> Mapping[str, Any]:
    told = described(part)
    if not told:
        raise UsageError(
            "this is no folder of a batch", file=part, hint=f"it needs {DESCRIPTION}, which 'batch' writes"
        )
    if not (part / RUNS).is_file():
        raise UsageError(
            "this batch has not finished", file=part, hint="call 'batch' again with this folder, then merge"
        )
    return told


def _told_alike(
    described: Sequence[tuple[Path, Mapping[str, Any]]], *, mixed_code: bool
) -> Mapping[str, Any]:
    """What the parts say of themselves, the shard left out; they must say the same."""
    first_path, first = described[0]
    for path, told in described[1:]:
        for key, what in (
            ("batch", "competition"),
            ("rule_set", "rule set"),
            ("read", "way of reading"),
            ("code", "code"),
        ):
            if told.get(key) == first.get(key) or (key == "code" and mixed_code):
                continue
            raise UsageError(
                f"it was made by {_worded(told, key)}, and {first_path} by {_worded(first, key)}: "
                f"another {what}",
                file=path,
                hint="--mixed-code joins them all the same; a ranking should rest on one code"
                if key == "code"
                else "join only parts of one batch",
            )
    return {key: value for key, value in first.items() if key != "shard"}


def _refuse_gaps(described: Sequence[Mapping[str, Any]]) -> None:
    """Refuse to join shards of which one is missing: its runs would be dropped in silence."""
    shards = [told["shard"] for told in described if "shard" in told]
    for count in {shard["of"] for shard in shards}:
        numbers = {shard["number"] for shard in shards if shard["of"] == count}
        missing = sorted(set(range(1, count + 1)) - numbers)
        if missing:
            named = ", ".join(f"{number}/{count}" for number in missing[:5])
            raise UsageError(
                f"{len(missing)} of {count} shards are missing: {named}{', …' if missing[5:] else ''}",
                hint="name the folders of all shards",
            )


def _worded(told: Mapping[str, Any], key: str) -> str:
    value = told.get(key)
    if key == "read":
        return "reading parts" if value == "parts" else "reading everything"
    if key == "rule_set" and isinstance(value, Mapping):
        return f"{value.get('id')} ({str(value.get('sha256'))[:12]}…)"
    if key == "code" and isinstance(value, list):
        return ", ".join(f"{c['package']} {c['version']} ({c['sha256'][:12]}…)" for c in value)
    return repr(value)
