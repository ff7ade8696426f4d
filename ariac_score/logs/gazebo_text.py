"""The text of a state.log: inflating its chunks and finding the frames in it."""

from __future__ import annotations

import binascii
import bz2
import re
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

from ariac_score.errors import LogError

__all__ = ["MAX_CHUNK_BYTES", "CorruptError", "Tape", "frames", "text", "without_cdata"]


MAX_CHUNK_BYTES = 512 * 1024 * 1024
"""Most text one chunk may inflate to. Gazebo writes chunks of about 1000 frames, some 15 MB."""


MAX_FRAME_BYTES = 64 * 1024 * 1024
"""Most text one frame (or the world) may have; real ones have 16 KB (and 230 KB)."""


_PIECE_BYTES = 1 << 20


_COMMON_END = b"tions>"
"""Both rare tags, insertions and deletions, end in this: one search shows that a piece has neither."""


class CorruptError(Exception):
    """A chunk is corrupt; the text gives the cause without the place, which the caller knows."""


class Tape:
    """A file read forwards, piece by piece."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._file, self._path = file, path
        self._held = bytearray()
        self.offset = 0

    def take_past(self, marker: bytes) -> bytes | None:
        """The bytes up to and including a marker; `None`, taking nothing, when the file ends before it."""
        start = 0
        while True:
            at = self._held.find(marker, start)
            if at >= 0:
                return self._take(at + len(marker))
            # The marker may lie across two pieces.
            start = max(0, len(self._held) - len(marker) + 1)
            piece = self._file.read(_PIECE_BYTES)
            if not piece:
                return None
            self._held += piece
            if len(self._held) > MAX_CHUNK_BYTES:
                raise LogError(
                    f"more than {MAX_CHUNK_BYTES:,} bytes without {marker.decode()!r}",
                    file=self._path,
                    place=f"byte {self.offset}",
                    hint="Gazebo writes chunks of a few hundred KB; the file looks broken or hostile",
                )

    def rest(self) -> bytes:
        """All remaining bytes, once the end of the file was reached."""
        return self._take(len(self._held))

    def _take(self, count: int) -> bytes:
        taken = bytes(self._held[:count])
        del self._held[:count]
        self.offset += count
        return taken


def without_cdata(body: bytes) -> bytes:
    """The content of a chunk, whose end may be cut off anywhere."""
    body = body.strip()
    opening = b"<![CDATA["
    if opening.startswith(body):
        return b""
    return body.removeprefix(opening).removesuffix(b"]]>")


def text(body: bytes, encoding: str, *, whole: bool) -> Iterator[bytes]:
    """The text of a chunk in pieces."""
    if encoding == "txt":
        yield body
    elif encoding == "zlib":
        yield from _inflate(zlib.decompressobj(), _from_base64(body, whole=whole), whole=whole)
    elif encoding == "bz2":
        yield from _inflate(bz2.BZ2Decompressor(), _from_base64(body, whole=whole), whole=whole)
    elif whole or encoding:
        raise CorruptError(f"encoding {encoding!r} is not txt, zlib or bz2")


_NOT_BASE64 = re.compile(rb"[^A-Za-z0-9+/=]")


def _from_base64(body: bytes, *, whole: bool) -> bytes:
    body = body.translate(None, b" \t\r\n")
    if not whole:
        # Cut off in the closing brackets, or in a group of four characters.
        body = body.rstrip(b"]")
        body = body[: len(body) // 4 * 4]
    strange = _NOT_BASE64.search(body)
    if strange:
        raise CorruptError(f"{strange[0]!r} is not base64")
    try:
        return binascii.a2b_base64(body)
    except binascii.Error as cause:
        raise CorruptError(f"not base64: {cause}") from cause


def _inflate(decompressor: Any, packed: bytes, *, whole: bool) -> Iterator[bytes]:
    """Decompress in pieces, refusing bombs before they are unpacked."""
    total, feed = 0, packed
    while not decompressor.eof:
        try:
            piece: bytes = decompressor.decompress(feed, _PIECE_BYTES)
        except (zlib.error, OSError, EOFError) as cause:
            raise CorruptError(f"cannot be decompressed: {cause}") from cause
        # zlib returns the input it did not use, bz2 keeps it.
        feed = getattr(decompressor, "unconsumed_tail", b"")
        total += len(piece)
        if total > MAX_CHUNK_BYTES:
            raise CorruptError(f"it inflates to more than {MAX_CHUNK_BYTES:,} bytes")
        if not piece:
            break
        yield piece
    if whole and not decompressor.eof:
        raise CorruptError("its compressed data ends early")
    if decompressor.unused_data:
        raise CorruptError("bytes follow its compressed data")


def frames(pieces: Iterator[bytes]) -> Iterator[tuple[bytes, bool]]:
    """The content of each whole `<state>`, without insertions, and whether it surely has no deletions.

    A `<world>` may hold a `<state>` of its own, and an insertion whole models, so both are
    skipped before anything in them is looked at.
    """
    held = b""
    for piece in pieces:
        held += piece
        start, plain = 0, _COMMON_END not in held
        while True:
            frame, past = _next_frame(held, start, plain=plain)
            if past == start:
                break
            start = past
            if frame is not None:
                yield frame, plain
        held = held[start:]
        if len(held) > MAX_FRAME_BYTES:
            raise CorruptError(f"more than {MAX_FRAME_BYTES:,} bytes without the end of a frame")


_OPENING = re.compile(rb"<(world|state)[\s>]")


_LONGEST_OPENING = 7


def _next_frame(text: bytes, start: int, *, plain: bool) -> tuple[bytes | None, int]:
    """The first whole frame from `start` on, and the offset up to which the text is processed.

    Args:
        text: Frames, with anything between them.
        start: Where to begin.
        plain: Whether it is known to have no insertions.
    """
    opening = _OPENING.search(text, start)
    if opening is None:
        return None, max(start, len(text) - _LONGEST_OPENING)
    if opening[1] == b"world":
        end = text.find(b"</world>", opening.end())
        return None, start if end < 0 else end + len(b"</world>")
    kept: list[bytes] = []
    at = opening.end()
    while True:
        end = text.find(b"</state>", at)
        inserted = -1 if plain else text.find(b"<insertions>", at, end if end >= 0 else len(text))
        if inserted < 0:
            if end < 0:
                return None, start
            kept.append(text[at:end])
            return b"".join(kept), end + len(b"</state>")
        kept.append(text[at:inserted])
        closing = text.find(b"</insertions>", inserted)
        if closing < 0:
            return None, start
        at = closing + len(b"</insertions>")
