"""Files that people name, read only where they are plain files within a limit."""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import BinaryIO

__all__ = ["open_plain", "read_plain"]

_BLOCK = 1 << 20


def read_plain(file: str | Path, most_bytes: int) -> bytes:
    """The bytes of a plain file.

    A pipe would be waited for, a device may have no end, and a file need not fit into memory.

    Args:
        file: Its path.
        most_bytes: That it may have.

    Raises:
        OSError: It is not there, cannot be read, is a pipe, a device or a folder, or is larger.
        ValueError: The path can be that of no file, as with a null byte.
    """
    with open_plain(file) as stream:
        size = os.fstat(stream.fileno()).st_size
        if size > most_bytes:
            raise _too_large(most_bytes, f"it has {size:,} bytes")
        found = bytearray()
        while block := stream.read(_BLOCK):  # files of the system state no size
            found += block
            if len(found) > most_bytes:
                raise _too_large(most_bytes, "it goes on")
    return bytes(found)


def open_plain(file: str | Path) -> BinaryIO:
    """A plain file, open for reading, without a buffer; it may be larger than memory.

    Raises:
        OSError: It is not there, cannot be read, or is a pipe, a device or a folder.
        ValueError: The path can be that of no file, as with a null byte.
    """
    # Without `O_NONBLOCK` a pipe would be waited for before anybody could see that it is one.
    handle = os.open(file, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
    mode = os.fstat(handle).st_mode
    if stat.S_ISREG(mode):
        return os.fdopen(handle, "rb", buffering=0)
    os.close(handle)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    raise OSError(errno.EINVAL, "it is no plain file")


def _too_large(most_bytes: int, words: str) -> OSError:
    return OSError(errno.EFBIG, f"{words}, and such a file has at most {most_bytes:,}")
