"""Archives of strangers, unpacked within limits: no way out of the folder, no links, no bombs."""

from __future__ import annotations

import errno
import io
import lzma
import stat
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import IO

from ariac_score.errors import LogError

__all__ = ["PACKED_STAMP", "SMALL", "ArchiveLimits", "is_archive", "unpack", "zipped"]

PACKED_STAMP = (2020, 1, 1, 0, 0, 0)
"""The time of all members of the zips we write: the same files give the same bytes."""

_BLOCK = 1 << 20
SMALL = 1 << 20
"""What any archive may unpack to, whatever its ratio."""

_DAMAGE = (
    zipfile.BadZipFile,
    tarfile.TarError,
    zlib.error,
    lzma.LZMAError,
    struct.error,
    EOFError,
    OSError,
    OverflowError,
    RuntimeError,
    TypeError,
    ValueError,
)
"""What the libraries raise for damage: also TypeError for a gzip head that ends in its name, RuntimeError for
a password or an unknown method (NotImplementedError), ValueError for a name that is no UTF-8
(UnicodeDecodeError), a date or an offset."""


@dataclass(frozen=True)
class ArchiveLimits:
    """What an archive may hold.

    Attributes:
        members: Files and folders.
        bytes: All files together, unpacked.
        ratio: Unpacked size over the size of the archive.
        name_bytes: Length of one name.
        depth: Folders inside one another.
    """

    members: int = 10_000
    bytes: int = 64 << 30
    ratio: int = 200
    name_bytes: int = 512
    depth: int = 16


@dataclass(frozen=True)
class _Member:
    name: str
    size: int
    folder: bool
    plain: bool
    stream: IO[bytes] | None


def is_archive(path: Path) -> bool:
    """Whether a file is an archive that `unpack` opens, by its content."""
    try:
        if zipfile.is_zipfile(path):
            return True
        with tarfile.open(path, "r|*", tarinfo=_Head):
            return True
    except _DAMAGE:
        return False


def unpack(archive: Path, into: Path, limits: ArchiveLimits | None = None) -> tuple[Path, ...]:
    """Unpack a zip or tar archive into a folder, which must be empty or not there.

    Args:
        archive: The file.
        into: Where its files go.
        limits: What it may hold.

    Returns:
        The files, sorted.

    Raises:
        LogError: It is damaged or encrypted, a name leads out of the folder or comes twice, a
            member is a link or a device, or lies within another, or a limit is exceeded; what came out
            before stays in the folder.
        OSError: The disk is full, which is no fault of the archive.
    """
    limits = limits or ArchiveLimits()
    into.mkdir(parents=True, exist_ok=True)
    try:
        return tuple(sorted(_unpacked(archive, into, limits)))
    except _DAMAGE as cause:
        if isinstance(cause, OSError) and cause.errno in (errno.ENOSPC, errno.EDQUOT):
            raise
        raise _refused(archive, "", f"it cannot be read: {cause}", "send the archive again") from cause


def _unpacked(archive: Path, into: Path, limits: ArchiveLimits) -> Iterator[Path]:
    seen: dict[str, str] = {}
    total, most = 0, max(archive.stat().st_size * limits.ratio, SMALL)
    for count, member in enumerate(_members(archive, most), start=1):
        if count > limits.members:
            raise _refused(archive, "", f"it has more than {limits.members} members", _SMALLER)
        parts = _parts(archive, member, limits)
        if not parts:
            continue
        # Where capitals do not matter, as on macOS, the second of two such names replaces the first.
        folded = "/".join(parts).casefold()
        if folded in seen and not (member.folder and seen[folded] == "folder"):
            raise _refused(archive, member.name, "the name comes twice", "keep one of the two")
        seen[folded] = "folder" if member.folder else "file"
        target = into.joinpath(*parts)
        if member.folder:
            target.mkdir(parents=True, exist_ok=True)
            continue
        target.parent.mkdir(parents=True, exist_ok=True)
        assert member.stream is not None
        with closing(member.stream) as source, target.open("xb") as out:
            while block := source.read(_BLOCK):  # counted, for the sizes in the headers may lie
                total += len(block)
                if total > limits.bytes:
                    raise _refused(archive, member.name, f"it holds more than {limits.bytes} bytes", _SMALLER)
                if total > most:
                    cause = f"it unpacks to more than {limits.ratio} times its size"
                    raise _refused(archive, member.name, cause, "no archive of logs does; pack it again")
                out.write(block)
        yield target


_SMALLER = "send the trials in several submissions"


class _Head(tarfile.TarInfo):
    """The head of a member of a tape; refuses what would be read into memory before anybody is asked."""

    @classmethod
    def frombuf(cls, buf: bytes | bytearray, encoding: str, errors: str) -> _Head:
        found = super().frombuf(buf, encoding, errors)
        if found.type in _DESCRIBING and found.size > _LONGEST_DESCRIPTION:
            raise tarfile.ReadError(f"it describes a member in {found.size} bytes")
        if found.type == tarfile.GNUTYPE_SPARSE:
            raise tarfile.ReadError(_SPARSE)
        return found

    def _proc_gnusparse_10(self, *_: object) -> None:
        raise tarfile.ReadError(_SPARSE)  # the third way to say so; its list of holes has no end


_DESCRIBING = (
    *(tarfile.GNUTYPE_LONGNAME, tarfile.GNUTYPE_LONGLINK),
    *(tarfile.XHDTYPE, tarfile.XGLTYPE, tarfile.SOLARIS_XHDTYPE),
)
_LONGEST_DESCRIPTION = 1 << 16
_SPARSE = "a member has holes; pack it without '--sparse'"


def _members(archive: Path, most: int) -> Iterator[_Member]:
    if zipfile.is_zipfile(archive):
        with zipfile.ZipFile(archive) as zipped:
            _check_apart(archive, zipped.infolist())
            for info in zipped.infolist():
                mode = info.external_attr >> 16  # as Unix has it; 0 where the archive was made elsewhere
                plain = not mode or stat.S_IFMT(mode) in (0, stat.S_IFREG, stat.S_IFDIR)
                if not info.filename:
                    raise _refused(archive, "", "a member has no name", _RENAME)
                if info.flag_bits & 1:
                    raise _refused(archive, info.filename, "it is encrypted", "send it without a password")
                stream = zipped.open(info) if plain and not info.is_dir() else None
                yield _Member(info.filename, info.file_size, info.is_dir(), plain, stream)
        return
    with tarfile.open(archive, "r|*", tarinfo=_Head) as taped:
        for entry in taped:
            # The library would read so much to reach the next one, past the end of the file as well.
            if taped.offset - entry.offset_data > most:
                raise _refused(archive, entry.name, f"it announces {entry.size} bytes", "pack it again")
            plain = entry.isreg() or entry.isdir()
            stream = taped.extractfile(entry) if entry.isreg() else None
            yield _Member(entry.name, entry.size, entry.isdir(), plain, stream)


def _check_apart(archive: Path, members: Sequence[zipfile.ZipInfo]) -> None:
    """Refuse members of which one lies within another: so a few bytes become many files.

    Raises:
        LogError: Two overlap.
    """
    placed = sorted(members, key=lambda info: info.header_offset)
    for before, behind in pairwise(placed):
        # The shortest that a head can be; its name and what else it has are not counted.
        if before.header_offset + _ZIP_HEAD_BYTES + before.compress_size > behind.header_offset:
            raise _refused(archive, behind.filename, f"it lies within {before.filename!r}", "pack it again")


_ZIP_HEAD_BYTES = 30


def _parts(archive: Path, member: _Member, limits: ArchiveLimits) -> tuple[str, ...]:
    name = member.name
    if not member.plain:
        raise _refused(archive, name, "it is a link or a device", "put the file itself in")
    if len(name.encode("utf-8", "surrogatepass")) > limits.name_bytes:
        raise _refused(
            archive, name[:40] + "…", f"its name is longer than {limits.name_bytes} bytes", _RENAME
        )
    path = PurePosixPath(name)
    strange = "\\" in name or "\0" in name or ":" in name or any(ord(letter) < 32 for letter in name)
    if path.is_absolute() or ".." in path.parts or strange:
        raise _refused(archive, name, "its name leads out of the archive", _RENAME)
    parts = tuple(part for part in path.parts if part != ".")
    if len(parts) > limits.depth:
        raise _refused(archive, name, f"it is more than {limits.depth} folders deep", _RENAME)
    return parts


_RENAME = "name it plainly and pack again"


def zipped(files: Mapping[str, bytes]) -> bytes:
    """A zip of files by name; the same files give the same bytes."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in files.items():
            info = zipfile.ZipInfo(name, PACKED_STAMP)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16  # by default only the owner could read it
            packed.writestr(info, content)
    return out.getvalue()


def _refused(archive: Path, member: str, cause: str, hint: str) -> LogError:
    return LogError(cause, file=archive, place=repr(member) if member else "", hint=hint)
