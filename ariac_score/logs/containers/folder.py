"""Scanning rosbag2 folders: `metadata.yaml` and the storage files it names.

Source: rosbag2_storage, bag metadata versions 1 to 9.
"""

from __future__ import annotations

import re
from collections.abc import Container, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory

from ariac_score.documents.yaml import is_there, load_yaml
from ariac_score.errors import CutOffError, DataFileError, LogError
from ariac_score.logs.containers.inflating import EndsEarlyError, inflate, inflate_file
from ariac_score.logs.containers.items import METADATA, METADATA_KEY, Batch, Connection, Message, Scan
from ariac_score.logs.containers.mcap import McapScan
from ariac_score.logs.containers.sqlite import SqliteScan

__all__ = ["FolderScan", "packed_storage", "split_files"]

_ZSTD = "zstd"
_PACKED_SUFFIXES = (".zstd", ".zst")
_REINDEX = "`ros2 bag reindex FOLDER` writes it anew from the storage files; or name one of these instead"


@dataclass(frozen=True)
class _Metadata:
    storage: str
    files: tuple[Path, ...]
    messages: int | None
    packed: str
    cut: str = ""
    """Why its end is missing, in words; empty where it is not known to be."""


class FolderScan:
    """One rosbag2 folder, or one compressed file of such; see `ariac_score.logs.containers.items.Scan`."""

    def __init__(
        self, path: Path, *, jobs: int = 0, topics: Container[str] | None = None, partial: bool = False
    ) -> None:
        self.path = path
        self._metadata = _read_metadata(path, partial=partial)
        self._jobs, self._topics, self._partial = jobs, topics, partial
        self.format = (McapScan if self._metadata.storage == "mcap" else SqliteScan).format
        self._scan: Scan | None = None
        self._current = self._contradictions = 0

    @property
    def readable(self) -> str:
        """How far reading got: the file, and how far in it."""
        if not self._metadata.files:
            return METADATA
        return (
            f"{self._metadata.files[self._current].name}, {self._scan.readable if self._scan else 'byte 0'}"
        )

    @property
    def index_contradictions(self) -> int:
        """How often an index contradicted the records."""
        return self._contradictions + (self._scan.index_contradictions if self._scan else 0)

    @property
    def share(self) -> float:
        """The share read, 0 to 1, every file counting the same."""
        if not self._metadata.files:
            return 0.0
        return (self._current + (self._scan.share if self._scan else 0.0)) / len(self._metadata.files)

    def __iter__(self) -> Iterator[Connection | Message | Batch]:
        """Every declared connection and message, file by file, in recorded order.

        Raises:
            LogError: A file is not whole, or the files do not add up to what the metadata says.
        """
        # Counted over all files: a lost or exchanged file of a split recording would pass for a short one.
        found = 0
        for number, file in enumerate(self._metadata.files):
            self._contradictions, self._scan, self._current = self.index_contradictions, None, number
            for item in self._items(file):
                if isinstance(item, Connection):
                    yield item
                    continue
                found += len(item) if isinstance(item, Batch) else 1
                # With compression by message, containers hold zstd frames in place of CDR payloads.
                if self._metadata.packed == "message":
                    yield from map(self._unpacked, item.messages() if isinstance(item, Batch) else (item,))
                else:
                    yield item
        if self._metadata.cut:
            raise CutOffError(self._metadata.cut, file=self.path, hint=_REINDEX)
        if self._metadata.messages not in (None, found):
            raise LogError(
                f"{METADATA} announces {self._metadata.messages} messages, the files hold {found}",
                file=self.path,
                place=METADATA,
                hint="a storage file was exchanged or lost its end; take another copy of the recording",
            )

    def _items(self, file: Path) -> Iterator[Connection | Message | Batch]:
        """The items of one storage file, which is inflated into a temporary folder where it is compressed."""
        if self._metadata.packed != "file" or file.suffix not in _PACKED_SUFFIXES:
            self._scan = self._scan_of(file)
            yield from self._scan
            return
        with TemporaryDirectory(prefix="ariac-score-") as folder:
            unpacked, hint = Path(folder, file.stem), "take another copy of the recording"
            cut: CutOffError | None = None
            try:
                inflate_file(file, unpacked)
            except EndsEarlyError as error:
                cut = CutOffError(f"it cannot be inflated: {error}", file=file, hint=hint)
                if not self._partial:
                    raise cut from error
            except ValueError as error:
                raise LogError(f"it cannot be inflated: {error}", file=file, hint=hint) from error
            self._scan = self._scan_of(unpacked)
            try:
                yield from self._scan
            except LogError as error:
                if error.file != str(unpacked):
                    raise
                # The user knows the compressed file, not our temporary one.
                kind = CutOffError if isinstance(error, CutOffError) else LogError
                raise kind(error.cause, file=file, place=error.place, hint=error.hint) from error
            if cut is not None:
                raise cut

    def _scan_of(self, file: Path) -> Scan:
        if self._metadata.storage == "mcap":
            return McapScan(file, jobs=self._jobs, topics=self._topics)
        return SqliteScan(file, topics=self._topics, partial=self._partial)

    def _unpacked(self, message: Message) -> Message:
        if self._topics is not None and message.connection.topic not in self._topics:
            return message._replace(payload=b"")
        try:
            return message._replace(payload=inflate(message.payload, "zstd"))
        except ValueError as error:
            raise LogError(
                f"a message on {message.connection.topic} cannot be inflated: {error}",
                file=self._metadata.files[self._current],
                place=f"after {self.readable}",
                hint="take another copy of the recording",
            ) from error


def packed_storage(file: Path) -> str:
    """How a storage file of rosbag2 is stored that was compressed as a whole; empty: it is no such file."""
    unpacked = PurePath(file.stem).suffix
    return _STORAGES.get(unpacked, "") if file.suffix in _PACKED_SUFFIXES else ""


_STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}


def split_files(folder: Path) -> tuple[Path, ...]:
    """The storage files of a folder that a recorder left without metadata, in their order; none: it is none.

    A recorder names them after the folder and numbers them from 0, and writes the metadata when it ends.
    """
    found: dict[tuple[str, str], dict[int, Path]] = {}
    for file in folder.iterdir():
        named = _STORAGE_FILE.fullmatch(file.name)
        if named and file.is_file():
            found.setdefault((named["name"], named["storage"]), {})[int(named["number"])] = file
    if len(found) != 1:
        return ()
    (files,) = found.values()
    numbers = sorted(files)
    return tuple(files[n] for n in numbers) if len(numbers) > 1 and numbers == [*range(len(numbers))] else ()


# Of a recording that is compressed file by file, the last one is not yet when its recorder is killed.
_STORAGE_FILE = re.compile(r"(?P<name>.+)_(?P<number>\d{1,6})\.(?P<storage>mcap|db3)(?:\.zstd)?")


def _without_metadata(path: Path, *, partial: bool) -> _Metadata:
    """What a folder holds whose recorder was killed before it wrote the metadata.

    Raises:
        CutOffError: It is not wanted in part.
        LogError: It is no such folder.
    """
    files, cause = split_files(path), f"the folder has no {METADATA}"
    if not files:
        raise LogError(f"{cause}, so it is not a rosbag2 recording", file=path, hint=_REINDEX)
    cause = f"{cause}: its recorder was killed before it wrote one"
    if not partial:
        raise CutOffError(cause, file=path, hint=_REINDEX)
    for file in files:
        _refuse_link_out(file, path)
    storage = "mcap" if ".mcap" in files[0].suffixes else "sqlite3"
    return _Metadata(storage, files, None, "file", cause)


def _read_metadata(path: Path, *, partial: bool = False) -> _Metadata:
    if packed := packed_storage(path):
        return _Metadata(packed, (path,), None, "file")
    file = path / METADATA
    if not file.is_file():
        return _without_metadata(path, partial=partial)
    _refuse_link_out(file, path)
    try:
        metadata = _parsed(path, load_yaml(file).data[METADATA_KEY])
    except DataFileError as error:
        raise LogError(
            f"it cannot be understood: {error.cause}", file=file, place=error.place, hint=_REINDEX
        ) from error
    except (LookupError, TypeError, AttributeError, ValueError) as error:
        cause = " ".join(str(error).split())
        raise LogError(
            f"it cannot be understood: {type(error).__name__}: {cause}", file=file, hint=_REINDEX
        ) from error
    for storage in metadata.files:
        _refuse_link_out(storage, path)
        if not is_there(storage) or not storage.is_file():
            raise LogError(
                f"it names {storage.name!r}, which is not in the folder",
                file=file,
                hint="copy the whole folder of the recording",
            )
    return metadata


def _refuse_link_out(file: Path, folder: Path) -> None:
    """Refuse a file that is elsewhere: a recording may come from a stranger, and nothing else of ours is his.

    Raises:
        LogError: It is a link out of the folder.
    """
    try:
        inside = file.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # a loop of links, or a name that no file can have
        inside = not is_there(file)  # named by the caller as one that is not there
    if not inside:
        raise LogError(
            f"{file.name!r} is a link that leads out of the folder of the recording",
            file=folder,
            hint="put the file itself into the folder",
        )


def _parsed(path: Path, facts: Mapping[str, object]) -> _Metadata:
    storage, names = facts["storage_identifier"], facts["relative_file_paths"]
    mode = str(facts.get("compression_mode") or "").lower()
    if storage not in ("mcap", "sqlite3"):
        raise ValueError(f"storage {storage!r} is neither 'mcap' nor 'sqlite3'")
    if mode not in ("", "none", "message", "file"):
        raise ValueError(f"compression mode {mode!r} is not one of none, message, file")
    if mode in ("message", "file") and facts.get("compression_format") != _ZSTD:
        raise ValueError(f"compression format {facts.get('compression_format')!r} is not {_ZSTD!r}")
    if not isinstance(names, list):
        raise ValueError("relative_file_paths is no list")
    count = facts.get("message_count")
    return _Metadata(
        storage=str(storage),
        # The name alone: old versions put the folder before it, and nothing outside the folder is ours.
        files=tuple(path / PurePath(str(name)).name for name in names),
        messages=count if isinstance(count, int) else None,
        packed=mode,
    )
