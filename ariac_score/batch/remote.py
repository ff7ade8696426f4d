"""Files that are named by a URI: what their storage states about them, and fetching them.

A storage is not trusted: names stay inside the folder they are put in, a file that is longer than
announced is not fetched to its end, and error messages hold neither credentials nor the signature of
an address.
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
"""The most files below a folder."""
MAX_DEPTH = 8
"""The deepest folder of a web server that is listed: pages may link to each other without end."""
ATTEMPTS = 3
PAUSE_S = 0.5
"""Before the second attempt; twice as long before the third."""
_AT_A_TIME = 16
"""Requests at a time."""
ANSWER_S = 300.0
"""How long a storage may take for one answer, such as a page of a listing or the status of a file."""
LISTING_S = 1800.0
"""How long the listing of a whole folder may take."""

# Under which keys the libraries of storages state what changes with the content of a file: a checksum or
# version, else its times.
_CONTENT = ("ETag", "etag", "md5Hash", "crc32c", "Content-MD5", "content_md5", "Digest", "generation")
_TIMES = ("mtime", "created", "ino", "LastModified", "Last-Modified", "last_modified", "updated")
_SECRET = re.compile(r"[?#].*\Z", re.DOTALL)
_QUERY = re.compile(r"\?[^\s'\")]+")
_OWNER = re.compile(r"(\w+://)[^/@\s]*@")
_URI = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*(::[A-Za-z][A-Za-z0-9+.-]*)*://.*", re.DOTALL)
_TRANSIENT = frozenset({408, 425, 429, 500, 502, 503, 504})
"""HTTP status codes after which another attempt may succeed."""
_Value = TypeVar("_Value")


class UnreachableError(BatchError):
    """A storage does not serve a file or listing; another time it may."""


class _SilentError(OSError):
    """Nothing came in time."""


class _GrownError(OSError):
    """More came than the storage had announced."""


@dataclass(frozen=True)
class Stored:
    """A file as its storage names it.

    Attributes:
        path: As the storage's library wants it.
        name: Below the folder that was listed, with `/`.
        size: In bytes; -1 when unknown.
        identity: What changes when the content does, such as an ETag; empty when unknown.
    """

    path: str
    name: str
    size: int
    identity: str


def is_uri(text: str) -> bool:
    """Whether a name is a URI rather than a path of this machine.

    >>> is_uri("s3://bucket/season"), is_uri("season")
    (True, False)
    """
    return _URI.fullmatch(text) is not None


def shown(uri: str) -> str:
    """A URI without the parts that may be secret.

    >>> shown("https://me:secret@host/a.mcap?X-Amz-Signature=0abc")
    'https://host/a.mcap'
    """
    plain = _SECRET.sub("", uri) if uri.startswith(("http://", "https://")) else uri
    return _OWNER.sub(r"\1", plain)


def name_of(uri: str) -> str:
    """The last part of a URI, under which its file is stored here.

    >>> name_of("https://host/run%201/?list=1"), name_of("s3://bucket/a.mcap")
    ('run 1', 'a.mcap')
    """
    plain = shown(uri).rstrip("/")
    name = PurePosixPath(plain.partition("://")[2]).name
    return unquote(name) if plain.startswith("http") else name


def signature_of_stored(files: Iterable[Stored], *about: str) -> str:
    """Hash of what a storage states about some files; empty where nothing of that would change with them."""
    stated = sorted((shown(file.path), file.size, file.identity) for file in files)
    if not stated or any(not identity for _, _, identity in stated):
        return ""
    text = json.dumps([*about, *stated], ensure_ascii=True)
    return hashlib.sha256(text.encode("ascii")).hexdigest()


class Storage:
    """The folder or file that a URI names.

    Args:
        uri: Of a folder or file.

    Raises:
        UsageError: A library is missing, or none reads such URIs.
    """

    def __init__(self, uri: str) -> None:
        self.uri = uri
        self._system, self.path = _opened(uri)
        self._web = urlsplit(uri).scheme in ("http", "https")
        self.path = self.path.rstrip("/") if not self._web else self.path

    def child(self, name: str, *, folder: bool = False) -> str:
        """The URI of a file or folder below this one."""
        quoted = quote(name) if self._web else name  # `#` and `?` belong to names elsewhere
        return f"{self.uri.rstrip('/')}/{quoted}{'/' if folder else ''}"

    def file(self) -> Stored:
        """The file itself.

        Raises:
            NothingToScoreError: There is none.
            UnreachableError: The storage does not answer.
            UsageError: It wants other credentials.
        """
        return _stored(self._info(self.path), self.path, name_of(self.uri))

    def is_folder(self) -> bool:
        """Whether it is a folder; on the web, whether its name ends with `/`."""
        if self._web:
            return urlsplit(self.uri).path.endswith("/")
        return bool(self._info(self.path)["type"] == "directory")

    def files(self) -> list[Stored]:
        """All files below the folder, by name.

        Raises:
            NothingToScoreError: There is no such folder.
            UnreachableError: The storage does not answer, or has more than `MOST_FILES`.
            UsageError: It wants other credentials.
        """
        if self._web:
            until = time.monotonic() + LISTING_S
            found = list(islice(self._walked(self.path, 0, until), MOST_FILES + 1))
        else:
            found = self._ask(self._found, within_s=LISTING_S)
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
            return file  # the worker reports why

    def _info(self, path: str) -> Any:
        return self._ask(lambda: self._system.info(path), within_s=ANSWER_S)

    def _found(self) -> list[tuple[str, Mapping[str, Any]]]:
        if self._system.info(self.path)["type"] != "directory":
            raise NotADirectoryError("it is a file")
        base = self.path.rstrip("/") + "/"
        found = self._system.find(self.path, detail=True)
        return [(path.removeprefix(base), info) for path, info in found.items() if not path.endswith("/")]

    def _walked(
        self, url: str, depth: int, until: float, below: str = ""
    ) -> Iterator[tuple[str, Mapping[str, Any]]]:
        """The files that the pages of a web server list, page by page.

        Raises:
            UnreachableError: The time is up; a server may make up pages for ever.
        """
        base = url.rstrip("/") + "/"
        if time.monotonic() > until:
            raise UnreachableError(
                f"the folder is not listed to its end after {LISTING_S:g} s",
                file=shown(self.uri),
                hint="name a folder of runs, or list the runs in a .txt file",
            )
        count = 0
        page = self._ask(lambda: self._system.ls(base, detail=True), base, within_s=ANSWER_S)
        for info in sorted(page, key=lambda info: str(info["name"])):
            own = info["name"].removeprefix(base)
            if own == info["name"] or not own or "?" in own or "#" in own or "/" in own.rstrip("/"):
                continue  # a link to another folder, or to this page in another order
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
            most_bytes: Where the storage does not state its size.
            within_s: Time limit, for callers other than the process of a run, which has its own.

        Returns:
            Its size.

        Raises:
            OSError: The disk is full.
            NothingToScoreError: There is no such file.
            UnreachableError: It cannot be fetched, or is another one than was announced.
            UsageError: The storage wants other credentials.
        """
        into.parent.mkdir(parents=True, exist_ok=True)
        most = file.size if file.size >= 0 else most_bytes
        self._ask(
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

    def named(self, name: str) -> Stored | None:
        """A file below the folder, if there is one.

        Raises:
            UnreachableError: The storage does not answer.
            UsageError: It wants other credentials.
        """
        path = self._below(name)
        try:
            return _stored(self._info(path), path, name)
        except NothingToScoreError:
            return None

    def get(self, files: Mapping[str, Path]) -> None:
        """Fetch files below the folder, some at a time; one that is not there is left out.

        Raises:
            OSError: The disk is full.
            UnreachableError: The storage does not answer.
            UsageError: It wants other credentials.
        """

        def one(name: str, into: Path) -> None:
            file = self.named(name)
            if file is not None:
                self.fetch(file, into, within_s=LISTING_S)

        with ThreadPoolExecutor(_AT_A_TIME) as pool:
            list(pool.map(one, files.keys(), files.values()))

    def put(self, files: Mapping[str, Path]) -> None:
        """Write files below the folder, some at a time, each complete or not at all.

        Raises:
            OSError: One cannot be read.
            UnreachableError: The storage does not answer.
            UsageError: It wants other credentials.
        """
        with ThreadPoolExecutor(_AT_A_TIME) as pool:
            list(pool.map(self._put, files.keys(), files.values()))

    def put_unless_changed(self, name: str, file: Path, before: Stored | None) -> bool:
        """Write a file unless another one lies there than was seen before; whether it was written.

        Storages of the kind of S3 make sure of that; of others the look and the write are two steps.
        """
        condition: dict[str, str] = {}
        if "s3" in _protocols(self._system):
            tag = "" if before is None else before.identity.removeprefix("ETag=")
            condition = {"IfMatch": tag} if tag else {"IfNoneMatch": "*"}
        elif self.named(name) != before:
            return False
        return self._put(name, file, condition)

    def _put(self, name: str, file: Path, condition: Mapping[str, str] | None = None) -> bool:
        path, content = self._below(name), file.read_bytes()

        def request() -> bool:
            try:
                if "file" in _protocols(self._system):
                    self._system.makedirs(path.rpartition("/")[0], exist_ok=True)
                self._system.pipe_file(path, content, **(condition or {}))
            except Exception as cause:
                if condition and _status(cause) in (409, 412):
                    return False
                raise
            return True

        try:
            return self._ask(request, path, within_s=LISTING_S)
        except UsageError as error:
            raise UsageError(
                error.cause.replace("may not be read", "may not be written"),
                file=shown(path),
                hint="give this machine credentials that may write there",
            ) from None

    def remove(self, name: str) -> None:
        """Remove a file, if there is one."""
        if self.named(name) is not None:
            self._ask(lambda: self._system.rm_file(self._below(name)), within_s=ANSWER_S)

    def _below(self, name: str) -> str:
        check_inside(name, self.uri)
        return f"{self.path.rstrip('/')}/{name}"

    def ranges(self, file: Stored, into: Path) -> RangedFile | None:
        """A file of which parts are fetched when they are read; `None` where only the whole is served.

        Raises:
            OSError: It cannot be written here.
        """
        if file.size < 0 or not file.identity or not self._serves_parts(file):
            return None
        into.parent.mkdir(parents=True, exist_ok=True)
        return RangedFile(into, file.size, partial(self._parts, file), file.identity)

    def _serves_parts(self, file: Stored) -> bool:
        """Whether parts can be requested: a web server may ignore that and send the whole file."""
        if not self._web:
            return True

        def request() -> bool:
            with self._system.open(file.path, "rb", size=file.size, cache_type="none") as parts:
                parts.seek(1)  # the first byte would come from any server
                return len(parts.read(1)) == 1

        try:
            return self._ask(request, file.path, within_s=ANSWER_S)
        except ScoreError:
            return False

    def _parts(self, file: Stored, ranges: Sequence[Range]) -> Sequence[bytes]:
        starts, ends = [start for start, _ in ranges], [end for _, end in ranges]

        def request() -> Any:
            paths = [file.path] * len(ranges)
            parts = self._system.cat_ranges(paths, starts, ends, on_error="raise", batch_size=_AT_A_TIME)
            for (start, end), part in zip(ranges, parts, strict=True):
                if len(part) > end - start:
                    raise _GrownError("the server sends whole files where parts are requested")
                if len(part) < end - start:
                    raise OSError(f"{len(part)} bytes came instead of {end - start}")
            return parts

        parts: Sequence[bytes] = self._ask(request, file.path)
        return parts

    def _ask(self, request: Callable[[], _Value], path: str = "", *, within_s: float | None = None) -> _Value:
        """The answer of a storage, with further attempts where it fails for a moment.

        Args:
            request: Makes the request.
            path: What it is about, where that is not `uri`.
            within_s: Time limit, for callers other than the process of a run, which has its own.

        Raises:
            ScoreError: It failed; the message holds nothing secret.
        """
        about = shown(path or self.uri)
        for attempt in range(1, ATTEMPTS + 1):
            try:
                return request() if within_s is None else _answered(request, within_s)
            except ScoreError:
                raise
            except Exception as cause:  # noqa: BLE001  # every protocol has errors of its own
                error = _as_score_error(cause, about)
                if not isinstance(error, UnreachableError) or attempt == ATTEMPTS or _final(cause):
                    raise error from None  # the cause may quote a secret address
                time.sleep(PAUSE_S * 2 ** (attempt - 1))
        raise AssertionError("the last attempt returns or raises")


def _answered(request: Callable[[], _Value], within_s: float) -> _Value:
    """The answer to a request, if it comes in time.

    Not every library has time limits. The thread of a request that hangs is left behind; as a daemon it
    does not keep the process alive, as a thread of a pool would.

    Raises:
        _SilentError: Nothing came.
        Exception: What the library raised.
    """
    answers: SimpleQueue[tuple[bool, Any]] = SimpleQueue()

    def run() -> None:
        try:
            answers.put((True, request()))
        except BaseException as error:  # noqa: BLE001  # raised again by the thread that waits
            answers.put((False, error))

    Thread(target=run, daemon=True).start()
    try:
        good, value = answers.get(timeout=within_s)
    except Empty:
        raise _SilentError(f"no answer within {within_s:g} s") from None
    if good:
        answer: _Value = value
        return answer
    raise value


_AGAIN = "it changed while it was read, or the connection broke: call again"


def load_library(scheme: str) -> None:
    """Import the library for a kind of URI, where it is installed, without connecting to anything."""
    with suppress(ImportError, ValueError):
        _fsspec().get_filesystem_class(scheme.rpartition("::")[2])


def _fsspec() -> Any:
    """The library of storages, with that of gs:// set to use HTTP alone.

    By default gcsfs first requests the kind of each bucket, over gRPC. Only zonal buckets need that, and
    where nobody answers it takes a minute, in the process of every run.
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
        # A cached listing would hide changes between planning, fetching and the comparison afterwards.
        system, path = fsspec.core.url_to_fs(uri, use_listings_cache=False)
    except ImportError as cause:
        raise UsageError(
            f"reading such a URI needs another library: {cause}",
            file=shown(uri),
            hint="pip install 'ariac-score[remote]' brings those of s3://, gs:// and https://",
        ) from cause
    except Exception as cause:  # noqa: BLE001  # every protocol has errors of its own
        error = _as_score_error(cause, shown(uri))
        if isinstance(error, UsageError) or isinstance(cause, OSError):
            raise error from None  # no credentials, or the server that checks them cannot be reached
        raise UsageError(
            f"no storage can be reached by such a URI: {_plain(cause)}",
            file=shown(uri),
            hint="write s3://BUCKET/FOLDER, gs://BUCKET/FOLDER or https://HOST/FOLDER/",
        ) from None
    return system, path


def _protocols(system: Any) -> tuple[str, ...]:
    stated = system.protocol
    return (stated,) if isinstance(stated, str) else tuple(stated)


def _stored(info: Mapping[str, Any], path: str, name: str) -> Stored:
    size = info.get("size")
    content = [f"{key}={info[key]}" for key in _CONTENT if info.get(key)][:1]
    times = [f"{key}={info[key]}" for key in _TIMES if info.get(key)]
    identity = ",".join(content or times)
    return Stored(path, name, size if isinstance(size, int) and size >= 0 else -1, identity)


def check_inside(name: str, uri: str) -> None:
    """Refuse a name that would lead out of the folder it is put in.

    Raises:
        UsageError: It would.
    """
    parts = name.split("/")
    if any(part in ("", ".", "..") for part in parts) or "\0" in name or "\\" in name:
        raise UsageError(
            f"it lists {name[:80]!r}, which cannot be the name of a file",
            file=shown(uri),
            hint="rename or remove it",
        )


def _bounded(most: int) -> Any:
    """A callback that ends a download once more than a number of bytes has come."""
    from fsspec.callbacks import Callback  # noqa: PLC0415  # an extra

    class Bounded(Callback):  # type: ignore[misc]  # of a library without types
        def call(self, *_: Any, **__: Any) -> None:
            if self.value > most:
                raise _GrownError(f"more than the announced {most} bytes came")

    return Bounded()


def _status(cause: BaseException) -> int:
    """The HTTP status of an error, or of one that caused it; 0 without one."""
    for error in _chain(cause):
        if isinstance(error, OSError) and str(error).startswith("Forbidden"):
            return 403  # an error of gcsfs has the word and not the number
        response = getattr(error, "response", None)
        answer = response.get("ResponseMetadata", {}) if isinstance(response, Mapping) else {}
        # `vars`, because gcsfs sets `code` on the error, and reading that of aiohttp's class is deprecated.
        codes = (getattr(error, "status", 0), vars(error).get("code", 0), answer.get("HTTPStatusCode", 0))
        for stated in codes:
            code = int(stated) if isinstance(stated, str) and stated.isdecimal() else stated
            if isinstance(code, int) and 400 <= code < 600:
                return code
    return 0


def _chain(cause: BaseException) -> Iterator[BaseException]:
    """An error and those that caused it."""
    error: BaseException | None = cause
    while error is not None:
        yield error
        error = error.__cause__ or error.__context__


def _final(cause: BaseException) -> bool:
    """Whether another attempt would fail in the same way."""
    status = _status(cause)
    final = isinstance(cause, _GrownError | _SilentError | NotADirectoryError)
    return final or (bool(status) and status not in _TRANSIENT)


def _as_score_error(cause: BaseException, about: str) -> ScoreError:
    """The error to raise for one of a library; its message holds nothing secret."""
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
    """Whether a file is missing: fsspec reports a host that cannot be reached as a missing file, too."""
    below = cause.__cause__ or cause.__context__
    return below is None or isinstance(below, FileNotFoundError) or "Client" not in type(below).__name__


def _plain(cause: BaseException) -> str:
    """The message of an error without addresses, which may be secret."""
    below = cause.__cause__ if isinstance(cause, FileNotFoundError) and cause.__cause__ else cause
    message = re.sub(r"\w+://\S+", lambda found: shown(found[0].rstrip("')\"")), str(below)).strip()
    message = _QUERY.sub("", message)  # of addresses without their host
    return f"{type(below).__name__}: {message}"[:300] if message else type(below).__name__
