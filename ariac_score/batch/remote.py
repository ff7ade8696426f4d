"""Files that are named by a URI: what a storage says of them, and fetching them.

Everything a storage says is a stranger's word: names stay inside the folder they are put in, a file
that is longer than it was said to be is not fetched to its end, and what is told of a failure holds
neither credentials nor the signature of an address.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path, PurePosixPath
from queue import Empty, SimpleQueue
from threading import Thread
from typing import Any, TypeVar
from urllib.parse import quote, unquote, urlsplit

from ariac_score.errors import BatchError, NothingToScoreError, ScoreError, UsageError
from ariac_score.logs.containers.inflating import LARGEST_FILE_BYTES
from ariac_score.logs.containers.ranged import Range, RangedFile

__all__ = [
    "Storage",
    "Stored",
    "UnreachableError",
    "check_inside",
    "is_uri",
    "load_library",
    "name_of",
    "shown",
    "signature_of_stored",
]

MOST_FILES = 200_000
"""Files below a folder that are looked at."""
MAX_DEPTH = 8
ATTEMPTS = 3
PAUSE_S = 0.5
"""Before a request is made again; twice as long before the next."""
_AT_A_TIME = 16
ANSWER_S = 300.0
"""How long a storage may take to say one thing, such as what is in a page or about a file."""
LISTING_S = 1800.0
"""How long the listing of a whole folder may take."""

_CONTENT = ("ETag", "etag", "md5Hash", "crc32c", "Content-MD5", "content_md5", "Digest", "generation")
_TIMES = ("mtime", "created", "ino", "LastModified", "Last-Modified", "last_modified", "updated")
_SECRET = re.compile(r"[?#].*\Z", re.DOTALL)
_QUERY = re.compile(r"\?[^\s'\")]+")
_OWNER = re.compile(r"(\w+://)[^/@\s]*@")
_URI = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*(::[A-Za-z][A-Za-z0-9+.-]*)*://.*", re.DOTALL)
_LATER = frozenset({408, 425, 429, 500, 502, 503, 504})
_Value = TypeVar("_Value")


class UnreachableError(BatchError):
    """A storage does not give what is asked of it; another time it may."""


class _SilentError(OSError):
    """Nothing came in time."""


class _GrownError(OSError):
    """More came than the storage had said there was."""


@dataclass(frozen=True)
class Stored:
    """A file as its storage names it.

    Attributes:
        path: As the storage's library wants it.
        name: Below the folder that was listed, with `/`.
        size: Bytes; -1 when nobody says.
        identity: What changes when the content does, such as an ETag; empty when nobody says.
    """

    path: str
    name: str
    size: int
    identity: str


def is_uri(text: str) -> bool:
    """Whether a name is one of a storage rather than a path of this machine.

    >>> is_uri("s3://bucket/season"), is_uri("season")
    (True, False)
    """
    return _URI.fullmatch(text) is not None


def shown(uri: str) -> str:
    """A URI without what may be secret in it.

    >>> shown("https://me:secret@host/a.mcap?X-Amz-Signature=0abc")
    'https://host/a.mcap'
    """
    plain = _SECRET.sub("", uri) if uri.startswith(("http://", "https://")) else uri
    return _OWNER.sub(r"\1", plain)


def name_of(uri: str) -> str:
    """The last part of a URI, as a file is called that is fetched.

    >>> name_of("https://host/run%201/?list=1"), name_of("s3://bucket/a.mcap")
    ('run 1', 'a.mcap')
    """
    plain = shown(uri).rstrip("/")
    name = PurePosixPath(plain.partition("://")[2]).name
    return unquote(name) if plain.startswith("http") else name


def signature_of_stored(files: Iterable[Stored], *about: str) -> str:
    """Hash of what a storage says of some files; empty where it says nothing that would change with them."""
    told = sorted((shown(file.path), file.size, file.identity) for file in files)
    if not told or any(not identity for _, _, identity in told):
        return ""
    text = json.dumps([*about, *told], ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


class Storage:
    """What a URI leads to.

    Args:
        uri: Of a folder or file.

    Raises:
        UsageError: A library is missing, or nobody knows such URIs.
    """

    def __init__(self, uri: str) -> None:
        self.uri = uri
        self._system, self.path = _opened(uri)
        self._web = urlsplit(uri).scheme in ("http", "https")
        self.path = self.path.rstrip("/") if not self._web else self.path

    def child(self, name: str, *, folder: bool = False) -> str:
        """The URI of what has a name below this one."""
        told = quote(name) if self._web else name
        return f"{self.uri.rstrip('/')}/{told}{'/' if folder else ''}"

    def file(self) -> Stored:
        """What is said of the file.

        Raises:
            NothingToScoreError: There is none.
            UnreachableError: The storage does not answer.
            UsageError: It wants other credentials.
        """
        return _stored(self._info(self.path), self.path, name_of(self.uri))

    def is_folder(self) -> bool:
        """Whether it is a folder; on the web, whether its name ends as that of one."""
        if self._web:
            return urlsplit(self.uri).path.endswith("/")
        return bool(self._info(self.path)["type"] == "directory")

    def files(self) -> list[Stored]:
        """All files below the folder, by name.

        Raises:
            NothingToScoreError: There is no such folder.
            UnreachableError: The storage does not answer, or has more than can be runs.
            UsageError: It wants other credentials.
        """
        if self._web:
            until = time.monotonic() + LISTING_S
            found = list(islice(self._walked(self.path, 0, until), MOST_FILES + 1))
        else:
            found = self._told(self._found, within_s=LISTING_S)
        if len(found) > MOST_FILES:
            raise UnreachableError(
                f"more than {MOST_FILES} files: this does not look like a folder of runs",
                file=shown(self.uri),
            )
        stored = sorted((_stored(info, info["name"], name) for name, info in found), key=lambda s: s.name)
        for file in stored:
            check_inside(file.name, self.uri)
        if self._web:
            return self.looked_up(stored)
        return stored

    def looked_up(self, files: Sequence[Stored]) -> list[Stored]:
        """The same files with size and identity, where a listing does not have them."""
        until = time.monotonic() + LISTING_S
        with ThreadPoolExecutor(_AT_A_TIME) as pool:
            return list(pool.map(lambda file: self._looked_up(file, until), files))

    def _looked_up(self, file: Stored, until: float) -> Stored:
        if time.monotonic() > until:
            return file
        try:
            return _stored(self._info(file.path), file.path, file.name)
        except ScoreError:
            return file  # the worker says why

    def _info(self, path: str) -> Any:
        return self._told(lambda: self._system.info(path), within_s=ANSWER_S)

    def _found(self) -> list[tuple[str, Mapping[str, Any]]]:
        if self._system.info(self.path)["type"] != "directory":
            raise NotADirectoryError("it is a file")
        base = self.path.rstrip("/") + "/"
        found = self._system.find(self.path, detail=True)
        return [(path.removeprefix(base), info) for path, info in found.items() if not path.endswith("/")]

    def _walked(
        self, url: str, depth: int, until: float, below: str = ""
    ) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """What the pages of a web server list, page by page.

        Raises:
            UnreachableError: They are not at their end when the time is; a server may make up pages for ever.
        """
        base = url.rstrip("/") + "/"
        if time.monotonic() > until:
            raise UnreachableError(
                f"the folder is not listed to its end after {LISTING_S:g} s",
                file=shown(self.uri),
                hint="name a folder of runs, or list the runs in a .txt",
            )
        count = 0
        page = self._told(lambda: self._system.ls(base, detail=True), base, within_s=ANSWER_S)
        for info in sorted(page, key=lambda info: str(info["name"])):
            own = info["name"].removeprefix(base)
            if own == info["name"] or not own or "?" in own or "#" in own or "/" in own.rstrip("/"):
                continue  # links to elsewhere, or to the same page sorted otherwise
            name = below + unquote(own)
            count += 1
            if info["type"] != "directory":
                yield name, info
            elif depth < MAX_DEPTH:
                yield from self._walked(info["name"], depth + 1, until, name)
            if count > MOST_FILES:
                return

    def fetch(
        self, file: Stored, into: Path, *, most_bytes: int = LARGEST_FILE_BYTES, within_s: float | None = None
    ) -> int:
        """Fetch a whole file.

        Args:
            file: Which.
            into: Where it is put.
            most_bytes: Where the storage does not say how large it is.
            within_s: For whoever is not ended in time, as the process of a run is.

        Returns:
            Its size.

        Raises:
            OSError: The disk is full.
            NothingToScoreError: There is no such file.
            UnreachableError: It does not come, or another one than was announced.
            UsageError: The storage wants other credentials.
        """
        into.parent.mkdir(parents=True, exist_ok=True)
        most = file.size if file.size >= 0 else most_bytes
        self._told(
            lambda: self._system.get_file(file.path, str(into), callback=_bounded(most)),
            file.path,
            within_s=within_s,
        )
        size = into.stat().st_size
        if file.size >= 0 and size != file.size:
            raise UnreachableError(
                f"{size} bytes came instead of {file.size}", file=shown(file.path), hint=_AGAIN
            )
        return size

    def ranges(self, file: Stored, into: Path) -> RangedFile | None:
        """A file of which parts are fetched when they are read; `None` where it can only be had whole.

        Raises:
            OSError: It cannot be made here.
        """
        if file.size < 0 or not file.identity or not self._gives_parts(file):
            return None
        into.parent.mkdir(parents=True, exist_ok=True)
        return RangedFile(into, file.size, partial(self._parts, file), file.identity)

    def _gives_parts(self, file: Stored) -> bool:
        """Whether parts can be asked for: a web server may give the whole file all the same."""
        if not self._web:
            return True

        def ask() -> bool:
            with self._system.open(file.path, "rb", size=file.size, cache_type="none") as parts:
                parts.seek(1)
                return len(parts.read(1)) == 1

        try:
            return self._told(ask, file.path, within_s=ANSWER_S)
        except ScoreError:
            return False

    def _parts(self, file: Stored, ranges: Sequence[Range]) -> Sequence[bytes]:
        starts, ends = [start for start, _ in ranges], [end for _, end in ranges]

        def ask() -> Any:
            paths = [file.path] * len(ranges)
            parts = self._system.cat_ranges(paths, starts, ends, on_error="raise", batch_size=_AT_A_TIME)
            for (start, end), part in zip(ranges, parts, strict=True):
                if len(part) > end - start:
                    raise _GrownError("the server gives whole files where parts are asked for")
                if len(part) < end - start:
                    raise OSError(f"{len(part)} bytes came instead of {end - start}")
            return parts

        parts: Sequence[bytes] = self._told(ask, file.path)
        return parts

    def _told(self, ask: Callable[[], _Value], path: str = "", *, within_s: float | None = None) -> _Value:
        """What a storage answers; where it fails for a moment it is asked again.

        Args:
            ask: Asks it.
            path: What about, where that is not all of it.
            within_s: For whoever is not ended in time, as the process of a run is.

        Raises:
            ScoreError: What is wrong, in words.
        """
        about = shown(path or self.uri)
        for attempt in range(1, ATTEMPTS + 1):
            try:
                return ask() if within_s is None else _answered(ask, within_s)
            except ScoreError:
                raise
            except Exception as cause:  # noqa: BLE001  # every protocol has errors of its own
                error = _worded(cause, about)
                if not isinstance(error, UnreachableError) or attempt == ATTEMPTS or _final(cause):
                    raise error from None  # the cause may quote a secret address
                time.sleep(PAUSE_S * 2 ** (attempt - 1))
        raise AssertionError("the last attempt returns or raises")


def _answered(ask: Callable[[], _Value], within_s: float) -> _Value:
    """What comes of asking, if it comes in time.

    Not every library ends its requests by itself. The thread that hangs is left behind, and as a daemon it
    does not keep the process: those of a pool would.

    Raises:
        _SilentError: Nothing came.
        Exception: What the library raised.
    """
    came: SimpleQueue[tuple[bool, Any]] = SimpleQueue()

    def asking() -> None:
        try:
            came.put((True, ask()))
        except BaseException as error:  # noqa: BLE001  # handed over to whoever waits
            came.put((False, error))

    Thread(target=asking, daemon=True).start()
    try:
        good, value = came.get(timeout=within_s)
    except Empty:
        raise _SilentError(f"no answer within {within_s:g} s") from None
    if good:
        answer: _Value = value
        return answer
    raise value


_AGAIN = "it changed while it was read, or the connection broke: call again"


def load_library(scheme: str) -> None:
    """Import what reads such URIs, where it is installed; nothing is connected."""
    with suppress(ImportError, ValueError):
        _fsspec().get_filesystem_class(scheme.rpartition("::")[2])


def _fsspec() -> Any:
    """The library of storages, with that of gs:// told to ask over HTTP alone.

    Of each bucket gcsfs would first ask its kind, over gRPC. Only zonal buckets need that, and where
    nobody answers it takes a minute, in the process of every run.
    """
    import fsspec  # noqa: PLC0415  # an extra

    os.environ.setdefault("GCSFS_EXPERIMENTAL_ZB_HNS_SUPPORT", "false")
    return fsspec


def _opened(uri: str) -> tuple[Any, str]:
    try:
        fsspec = _fsspec()
    except ImportError as cause:
        raise UsageError(
            "reading a URI needs fsspec", file=shown(uri), hint="pip install 'ariac-score[remote]'"
        ) from cause
    try:
        system, path = fsspec.core.url_to_fs(uri, use_listings_cache=False)
    except ImportError as cause:
        raise UsageError(
            f"reading such a URI needs another library: {cause}",
            file=shown(uri),
            hint="pip install 'ariac-score[remote]' brings those of s3://, gs:// and https://",
        ) from cause
    except Exception as cause:  # noqa: BLE001  # every protocol has errors of its own
        error = _worded(cause, shown(uri))
        if isinstance(error, UsageError) or isinstance(cause, OSError):
            raise error from None  # credentials, or whoever says what they are worth
        raise UsageError(
            f"no storage can be reached by such a URI: {_plain(cause)}",
            file=shown(uri),
            hint="write s3://BUCKET/FOLDER, gs://BUCKET/FOLDER or https://HOST/FOLDER/",
        ) from None
    return system, path


def _stored(info: Mapping[str, Any], path: str, name: str) -> Stored:
    size = info.get("size")
    content = [f"{key}={info[key]}" for key in _CONTENT if info.get(key)][:1]
    times = [f"{key}={info[key]}" for key in _TIMES if info.get(key)]
    identity = ",".join(content or times)
    return Stored(path, name, size if isinstance(size, int) and size >= 0 else -1, identity)


def check_inside(name: str, uri: str) -> None:
    """Refuse names that would lead out of the folder they are put in.

    Raises:
        UsageError: One does.
    """
    parts = name.split("/")
    if any(part in ("", ".", "..") for part in parts) or "\0" in name or "\\" in name:
        raise UsageError(
            f"it lists {name[:80]!r}, which is no name of a file", file=shown(uri), hint="rename or remove it"
        )


def _bounded(most: int) -> Any:
    """Watches a file come, and ends it where more comes than there is said to be."""
    from fsspec.callbacks import Callback  # noqa: PLC0415  # an extra

    class Bounded(Callback):  # type: ignore[misc]  # of a library without types
        def call(self, *_: Any, **__: Any) -> None:
            if self.value > most:
                raise _GrownError(f"more than the announced {most} bytes come")

    return Bounded()


def _status(cause: BaseException) -> int:
    """The status of HTTP that an error, or one it comes from, is about; 0 without one."""
    for error in _chain(cause):
        if isinstance(error, OSError) and str(error).startswith("Forbidden"):
            return 403  # so gcsfs says it
        response = getattr(error, "response", None)
        answer = response.get("ResponseMetadata", {}) if isinstance(response, Mapping) else {}
        # Of its own a `code` is gcsfs's; asked for that of its class, the library of the web complains.
        codes = (getattr(error, "status", 0), vars(error).get("code", 0), answer.get("HTTPStatusCode", 0))
        for told in codes:
            code = int(told) if isinstance(told, str) and told.isdecimal() else told
            if isinstance(code, int) and 400 <= code < 600:
                return code
    return 0


def _chain(cause: BaseException) -> Iterator[BaseException]:
    """An error and those it comes from."""
    error: BaseException | None = cause
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _final(cause: BaseException) -> bool:
    """Whether it would be the same another time."""
    status = _status(cause)
    final = isinstance(cause, _GrownError | _SilentError | NotADirectoryError)
    return final or (bool(status) and status not in _LATER)


def _worded(cause: BaseException, about: str) -> ScoreError:
    """What went wrong, in words that hold nothing secret."""
    status = _status(cause)
    denied = isinstance(cause, PermissionError) or status in (401, 403, 407)
    if denied or "Credential" in type(cause).__name__ or type(cause).__name__ == "RefreshError":
        what = f"HTTP {status}" if status else type(cause).__name__
        return UsageError(
            f"it may not be read: {what}",
            file=about,
            hint="give the machine that reads it credentials (AWS_PROFILE, GOOGLE_APPLICATION_CREDENTIALS, "
            "or the configuration of fsspec), or let anybody read it",
        )
    if status in (404, 410) or (isinstance(cause, FileNotFoundError) and not status and _is_missing(cause)):
        return NothingToScoreError("no such file or folder", file=about, hint="check the address")
    what = f"HTTP {status}" if status else _plain(cause)
    return UnreachableError(
        f"cannot be fetched: {what}", file=about, hint="call again when it can be reached"
    )


def _is_missing(cause: BaseException) -> bool:
    """Whether a missing file is meant: to fsspec a host that is not there is a missing file too."""
    below = cause.__cause__ or cause.__context__
    return below is None or isinstance(below, FileNotFoundError) or "Client" not in type(below).__name__


def _plain(cause: BaseException) -> str:
    """The words of an error without addresses, which may be secret."""
    below = cause.__cause__ if isinstance(cause, FileNotFoundError) and cause.__cause__ else cause
    words = re.sub(r"\w+://\S+", lambda found: shown(found[0].rstrip("')\"")), str(below)).strip()
    words = _QUERY.sub("", words)  # of addresses that are told without their host
    return f"{type(below).__name__}: {words}"[:300] if words else type(below).__name__
