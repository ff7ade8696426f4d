"""Hashes of the files of runs, remembered so that a finished batch is not read again.

A cache of this machine and no part of the batch: losing it costs time and nothing else.
"""

from __future__ import annotations

import hashlib
import os
import sqlite3
from pathlib import Path

__all__ = ["HashCache"]


class HashCache:
    """Hashes of contents by the signature of the files, see `address.signature_of`.

    Args:
        out: Folder of the batch.
    """

    def __init__(self, out: Path) -> None:
        self._connection = _open(
            _folder() / f"{hashlib.sha256(str(out.resolve()).encode()).hexdigest()}.sqlite"
        )

    def contents(self, signature: str) -> str:
        """The hash of contents that goes with a signature; empty when it was never seen."""
        try:
            found = self._connection.execute(
                "SELECT contents FROM seen WHERE signature = ?", (signature,)
            ).fetchone()
        except sqlite3.Error:
            return ""
        return found[0] if found else ""

    def note(self, signature: str, contents: str) -> None:
        """Remember a pair, unless the cache cannot be written."""
        if signature and contents:
            try:
                self._connection.execute("INSERT OR REPLACE INTO seen VALUES (?, ?)", (signature, contents))
            except sqlite3.Error:
                return

    def keep(self) -> None:
        """Put on disk what was noted."""
        try:
            self._connection.commit()
        except sqlite3.Error:
            return

    def close(self) -> None:
        """Keep what was noted, and close the file."""
        self.keep()
        self._connection.close()


def _folder() -> Path:
    base = os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(base).expanduser() / "ariac-score" / "batch"


def _open(file: Path) -> sqlite3.Connection:
    table = "CREATE TABLE IF NOT EXISTS seen (signature TEXT PRIMARY KEY, contents TEXT) WITHOUT ROWID"
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        connection = sqlite3.connect(file, timeout=1.0)
        connection.execute("PRAGMA cache_size = -512")  # KiB: what is noted between two calls of `keep`
        # Without a lock for each statement: `Store.working` keeps other batches out of the folder.
        connection.execute("PRAGMA locking_mode = EXCLUSIVE")
        connection.execute(table)
        return connection
    except (OSError, sqlite3.Error):  # a home that nobody may write in: the batch goes on without
        connection = sqlite3.connect(":memory:")
        connection.execute(table)
        return connection
