"""`batch.json`: what a batch scores, and by which rules and code."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
from msgspec import Struct

from ariac_score.documents.plain_file import read_plain
from ariac_score.errors import UsageError
from ariac_score.results.codec import plain
from ariac_score.results.result import Code, Pinned

__all__ = [
    "DESCRIPTION",
    "RULES",
    "BatchDescription",
    "Shard",
    "load_description",
    "refuse_other_version",
]

_LARGEST_BYTES = 1 << 24

DESCRIPTION = "batch.json"
RULES = "rules.yaml"
_SCHEMA = "ariac-score/batch/1"
_AGAIN = "call 'batch' again with this folder: it writes it anew"


class Shard(Struct, frozen=True, forbid_unknown_fields=True):
    """The part of a batch that one folder holds.

    Attributes:
        number: From 1.
        of: How many parts there are.
    """

    number: int
    of: int


class BatchDescription(
    Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True, tag_field="schema", tag=_SCHEMA
):
    """What a batch scores, and by which rules and code.

    Attributes:
        batch: Name of the competition or folder.
        rule_set: By which the runs are scored.
        code: All code that a measurement may depend on.
        read: `parts` where only the wanted parts of remote recordings are fetched; empty otherwise.
        shard: Which part of the batch this is; `None` for the whole.
    """

    batch: str
    rule_set: Pinned
    code: tuple[Code, ...]
    read: str = ""
    shard: Shard | None = None

    def text(self) -> str:
        """The description as JSON.

        Not `codec.as_text`: its layout is another one, and a second call may not change a byte of a
        folder that has nothing new.
        """
        return json.dumps(plain(self), sort_keys=True, indent=1, ensure_ascii=True) + "\n"


def load_description(folder: Path, *, hint: str) -> BatchDescription:
    """Read the description of a batch.

    Args:
        folder: Of the batch.
        hint: What to do where the folder has no description.

    Raises:
        UsageError: There is none, it is damaged, or another version wrote it.
    """
    refuse_other_version(folder)
    file = folder / DESCRIPTION
    try:
        document = json.loads(read_plain(file, _LARGEST_BYTES))
    except OSError as cause:
        raise UsageError("this is no folder of a batch", file=folder, hint=hint) from cause
    except (ValueError, RecursionError) as cause:
        raise UsageError(f"it is damaged: {cause}", file=file, hint=_AGAIN) from cause
    # Not decoded by msgspec at once: the name of a folder may hold half a surrogate pair.
    try:
        return msgspec.convert(document, BatchDescription)
    except msgspec.ValidationError as cause:
        raise UsageError(f"it is damaged: {cause}", file=file, hint=_AGAIN) from cause


def refuse_other_version(folder: Path) -> None:
    """Refuse a batch that another version of the format describes; one that is damaged may be written anew.

    Raises:
        UsageError: It is of another version.
    """
    try:
        document = json.loads(read_plain(folder / DESCRIPTION, _LARGEST_BYTES))
    except (OSError, ValueError, RecursionError):
        return
    schema = document.get("schema") if isinstance(document, dict) else None
    if isinstance(schema, str) and schema != _SCHEMA:
        raise UsageError(
            f"it was made as {schema}, and this version reads {_SCHEMA}",
            file=folder,
            hint="use the version that made it, or a folder of its own",
        )
