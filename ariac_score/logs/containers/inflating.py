"""Inflating compressed bytes within limits.

A few bytes can announce, or become, terabytes. So announced sizes are checked before memory is reserved,
and no decompressor may produce more than announced.
"""

from __future__ import annotations

import os
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from ariac_score.errors import LogError
from ariac_score.logs.containers.source import BLOCK_BYTES

__all__ = [
    "LARGEST_FILE_BYTES",
    "LARGEST_INFLATED_BYTES",
    "MOST_INFLATION",
    "EndsEarlyError",
    "check_announced",
    "inflate",
    "inflate_file",
    "inflate_into",
    "inflate_start",
]


def _limit(name: str, default: int) -> int:
    """A limit that the environment may set."""
    text = os.environ.get(name, "")
    if text and not (text.isascii() and text.isdigit()):
        raise LogError(f"the environment variable {name} is {text!r}", hint="give a whole number")
    return int(text) if text else default


LARGEST_INFLATED_BYTES = _limit("ARIAC_SCORE_LARGEST_CHUNK_BYTES", 1 << 30)
"""A chunk or message that announces more is refused: recorders write some MB."""


LARGEST_FILE_BYTES = _limit("ARIAC_SCORE_LARGEST_FILE_BYTES", 1 << 37)
"""A compressed file that inflates to more is refused."""


MOST_INFLATION = _limit("ARIAC_SCORE_MOST_INFLATION", 1000)
"""The largest ratio of inflated to packed bytes, for anything above `_ALWAYS_ALLOWED_BYTES`."""


_ALWAYS_ALLOWED_BYTES = 1 << 26
"""Up to this size the ratio does not matter: uniform data compresses better than it allows."""


_INFLATERS = {
    "bz2": ("bz2", "BZ2Decompressor"),
    "lz4": ("lz4.frame", "LZ4FrameDecompressor"),
    "zstd": ("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd", "ZstdDecompressor"),
}


def inflate(packed: bytes | memoryview, compression: str, *, size: int | None = None) -> bytes | memoryview:
    """Inflate some bytes without ever producing more than announced.

    Args:
        packed: One compressed frame.
        compression: `bz2`, `lz4`, `zstd`, or empty or `none`.
        size: The announced size, bytes; `None` when nothing announces it.

    Raises:
        ValueError: It cannot be inflated to that size; the message says why.
    """
    if size is not None:
        check_announced(size, len(packed))
    if compression in ("", "none"):
        inflated: bytes | memoryview = packed
    elif compression in _INFLATERS:
        inflated = _inflate(packed, compression, LARGEST_INFLATED_BYTES if size is None else size)
    else:
        raise ValueError(f"compression {compression!r} is not one of {', '.join(sorted(_INFLATERS))}")
    if size is not None and len(inflated) != size:
        raise ValueError(f"it holds {len(inflated)} bytes instead of the announced {size}")
    return inflated


def check_announced(size: int, packed: int | None = None) -> None:
    """Make sure that an announced size, and its ratio to the packed bytes, is within the limits.

    Raises:
        ValueError: It is not.
    """
    if size > LARGEST_INFLATED_BYTES:
        raise ValueError(f"it announces {size} bytes, more than the {LARGEST_INFLATED_BYTES} allowed")
    if packed is not None and size > max(_ALWAYS_ALLOWED_BYTES, packed * MOST_INFLATION):
        raise ValueError(
            f"it announces {size} bytes in {packed}, more than {MOST_INFLATION} times as many are not allowed"
        )


def inflate_start(packed: bytes | memoryview, compression: str) -> bytes | memoryview:
    """What can be inflated of compressed bytes whose end is missing; nothing where that is not possible."""
    if compression in ("", "none"):
        return packed
    try:
        engine, failures = _decompressor(compression)
    except (ValueError, KeyError):
        return b""
    most = min(LARGEST_INFLATED_BYTES, max(_ALWAYS_ALLOWED_BYTES, len(packed) * MOST_INFLATION))
    try:
        found: bytes = engine.decompress(bytes(packed), max_length=most)
    except failures:
        return b""
    return found


class EndsEarlyError(ValueError):
    """Compressed data end before their end; what was before is inflated."""


def inflate_file(packed: Path, into: Path) -> None:
    """Inflate a file compressed by zstd, piece by piece.

    Raises:
        EndsEarlyError: It is cut off; what is there was inflated.
        ValueError: It cannot be inflated, or inflates to more than is allowed.
    """
    module = import_module(_INFLATERS["zstd"][0])
    engine, total = module.ZstdDecompressor(), 0
    most = min(LARGEST_FILE_BYTES, max(_ALWAYS_ALLOWED_BYTES, packed.stat().st_size * MOST_INFLATION))
    with packed.open("rb") as source, into.open("wb") as target:
        while not engine.eof:
            feed = source.read(BLOCK_BYTES) if engine.needs_input else b""
            if engine.needs_input and not feed:
                raise EndsEarlyError("its zstd data ends early")
            try:
                part = engine.decompress(feed, max_length=BLOCK_BYTES)
            except module.ZstdError as error:
                raise ValueError(f"its zstd data is broken: {error}") from error
            total += len(part)
            if total > most:
                raise ValueError(f"its zstd data inflates to more than {most} bytes")
            target.write(part)
        if engine.unused_data or source.read(1):
            raise ValueError("bytes follow its zstd data")


def inflate_into(room: memoryview, packed: bytes | memoryview, compression: str) -> None:
    """Inflate some bytes into a buffer of the announced size.

    Raises:
        ValueError: It cannot be inflated to that size; the message says why.
    """
    if compression in _ENDS and _inflate_fast(room, packed, compression):
        return
    room[:] = inflate(packed, compression, size=len(room))


def _inflate_fast(room: memoryview, packed: bytes | memoryview, compression: str) -> bool:
    """Inflate one whole frame in place, where cramjam is installed; whether that was done.

    Anything irregular is left to the slower way, whose errors say what is wrong. The end of the
    frame is found beforehand, because cramjam takes several frames as one.
    """
    cramjam = _cramjam()
    if cramjam is None or not room or _ENDS[compression](packed) != len(packed):
        return False
    try:
        count: int = getattr(cramjam, compression).decompress_into(packed, room)
    except cramjam.DecompressionError:
        return False
    return count == len(room)


@cache
def _cramjam() -> Any:
    try:
        return import_module("cramjam")
    except ImportError:
        return None


def _end_of_lz4(packed: bytes | memoryview) -> int:
    """Where an lz4 frame ends, by the lengths of its blocks; -1 when it is none.

    Source: LZ4 frame format description, version 1.6.
    """
    if len(packed) < 7 or packed[:4] != b"\x04\x22\x4d\x18":
        return -1
    flags = packed[4]
    if flags >> 6 != 1 or flags & 0b11:
        return -1  # of another version, or with a dictionary
    at = 7 + (8 if flags & 0b1000 else 0)
    behind_block, behind_frame = (4 if flags & bit else 0 for bit in (0b10000, 0b100))
    while at + 4 <= len(packed):
        # The highest bit marks a block that is not compressed.
        length = int.from_bytes(packed[at : at + 4], "little") & 0x7FFFFFFF
        at += 4
        if not length:
            return at + behind_frame
        at += length + behind_block
    return -1


def _end_of_zstd(packed: bytes | memoryview) -> int:
    """Where the zstd frame at the start of some bytes ends; -1 when there is no whole one.

    Source: RFC 8878, 3.1.1.
    """
    if len(packed) < 6 or bytes(packed[:4]) != b"\x28\xb5\x2f\xfd":
        return -1
    flags = packed[4]
    alone, size_flag = flags >> 5 & 1, flags >> 6
    size_bytes = (alone, 2, 4, 8)[size_flag]
    at = 5 + (1 - alone) + (0, 1, 2, 4)[flags & 3] + size_bytes
    while at + 3 <= len(packed):
        head = int.from_bytes(packed[at : at + 3], "little")
        # A repeated block holds one byte, whatever size it announces.
        at += 3 + (1 if head >> 1 & 3 == _ZSTD_REPEATED else head >> 3)
        if head & 1:
            return at + 4 * (flags >> 2 & 1)
    return -1


_ZSTD_REPEATED = 1


_ENDS = {"lz4": _end_of_lz4, "zstd": _end_of_zstd}


def _decompressor(compression: str) -> tuple[Any, tuple[type[Exception], ...]]:
    """What inflates a frame, and the errors that it raises.

    Raises:
        ValueError: Its module is not installed.
    """
    module_name, name = _INFLATERS[compression]
    try:
        module = import_module(module_name)
    except ImportError as error:
        raise ValueError(f"its {compression} data needs the Python module {module_name!r}") from error
    # Only the zstd module has an error of its own.
    failures = (OSError, EOFError, RuntimeError, ValueError, getattr(module, "ZstdError", OSError))
    return getattr(module, name)(), failures


def _inflate(packed: bytes | memoryview, compression: str, most: int) -> bytes:
    engine, failures = _decompressor(compression)
    parts: list[bytes] = []
    room = most + 1  # one byte too many shows that it inflates to more
    try:
        while room > 0 and not engine.eof:
            # The input is given once; further calls only fetch more output.
            part: bytes = engine.decompress(b"" if parts else bytes(packed), max_length=room)
            parts.append(part)
            room -= len(part)
            if not part and engine.needs_input:
                break
    except failures as error:
        raise ValueError(f"its {compression} data is broken: {error}") from error
    if room <= 0:
        raise ValueError(f"its {compression} data inflates to more than {most} bytes")
    if not engine.eof:
        raise ValueError(f"its {compression} data ends early")
    if engine.unused_data:
        raise ValueError(f"{len(engine.unused_data)} bytes follow its {compression} data")
    return b"".join(parts)
