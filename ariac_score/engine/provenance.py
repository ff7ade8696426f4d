"""Where a result comes from: every input file, rule set and code package with its hash."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from functools import cache, partial
from importlib.metadata import version
from pathlib import Path
from threading import Event

from ariac_score.checks.registry import Plugin, package_sha256
from ariac_score.engine.prepared import Prepared
from ariac_score.engine.read import COMPETITIONS, TRACKS
from ariac_score.errors import LogError, PluginError
from ariac_score.logs.bundle import Bundle, Part, name_from
from ariac_score.logs.containers.ranged import ranged
from ariac_score.results.result import Code, Pinned, Provenance, Source
from ariac_score.trial.model import Trial

__all__ = [
    "code_of",
    "engine_code",
    "file_hashes",
    "file_sha256",
    "hashing_files",
    "provenance_of",
    "refuse_other_contents",
]

_WORTH_A_THREAD_BYTES = 1 << 23
"""Bundles smaller than this are hashed after reading, without a thread."""

_HASHED_BLOCK_BYTES = 1 << 18


@contextmanager
def hashing_files(bundle: Bundle, *, threaded: bool) -> Iterator[Callable[[], tuple[Source, ...]]]:
    """The hashes of a bundle's files, computed while the body reads them.

    Args:
        bundle: Whose files.
        threaded: Whether another thread may be used, which is done where they are large.
    """
    # Of ranged files only the bytes that were read are hashed, and which these are is known afterwards.
    files = [file for part in bundle.parts for file in _files(part)]
    size = sum(file.stat().st_size for file in files)
    if not threaded or size < _WORTH_A_THREAD_BYTES or any(ranged(file) for file in files):
        yield partial(file_hashes, bundle)
        return
    stopped = Event()
    with ThreadPoolExecutor(1) as pool:  # hashlib releases the GIL, so decoding goes on meanwhile
        try:
            yield pool.submit(file_hashes, bundle, stopped).result
        finally:  # where reading failed, nobody waits for the hash of a large log
            stopped.set()


def provenance_of(bundle: Bundle, inputs: tuple[Source, ...], prepared: Prepared, trial: Trial) -> Provenance:
    """What a result rests on: its inputs, its rules, and the packages of all plugins that took part.

    Args:
        bundle: What was read.
        inputs: Its files with their hashes.
        prepared: By what it was scored.
        trial: As it was read.
    """
    rule_set, log_map, registry = prepared.rule_set, prepared.log_map, prepared.registry
    plugins = [*prepared.plugins]
    plugins += [registry.find("ariac_score.readers", part.reader) for part in bundle.parts]
    plugins += [
        registry.find("ariac_score.decoders", channel.decoder)
        for channel in log_map.channels
        if channel.decoder
    ]
    plugins += [registry.find(group, name) for group, name in trial.read_with]
    named = {TRACKS: log_map.tracks, COMPETITIONS: log_map.competition}
    plugins += [registry.find(group, use.use) for group, use in named.items() if use]
    code = {Code(*_package(plugin), plugin.code_sha256()) for plugin in plugins}
    return Provenance(
        inputs=inputs,
        ignored=tuple(sorted(bundle.ignored)),
        rule_set=Pinned(rule_set.id, rule_set.sha256),
        log_map=Pinned(log_map.id, log_map.sha256),
        code=tuple(sorted({Code(*engine_code()), *code})),
    )


def code_of(prepared: Prepared) -> tuple[tuple[str, str, str, str], ...]:
    """All code a measurement may depend on: distribution, version, package, SHA-256.

    That is the engine, the plugins of the checks, and every reader, decoder, track reader, record kind and
    competition: which of them take part is known only when the log is read.
    """
    certain = {_package(plugin) for plugin in prepared.plugins}
    possible = {_package(p) for group in _PERHAPS for p in prepared.registry.all(group)} - certain
    found = {engine_code(), *((*_package(plugin), plugin.code_sha256()) for plugin in prepared.plugins)}
    for package in possible:
        # What cannot be imported takes no part; a run that needs it fails, and says why.
        with suppress(PluginError):
            found.add((*package, package_sha256(package[2])))
    return tuple(sorted(found))


_PERHAPS = (
    "ariac_score.readers",
    "ariac_score.decoders",
    "ariac_score.tracks",
    "ariac_score.record_kinds",
    "ariac_score.competitions",
)
"""Groups of plugins of which the log decides whether they take part."""


def _package(plugin: Plugin) -> tuple[str, str, str]:
    return plugin.distribution, plugin.version, plugin.package


def file_hashes(bundle: Bundle, stopped: Event | None = None) -> tuple[Source, ...]:
    """Every file of a bundle with its hash, sorted by role and name.

    Args:
        bundle: Whose files.
        stopped: Once it is set, hashing ends early and the hashes are worthless.
    """
    found = (s for part in bundle.parts for s in _sources(part, bundle.root, stopped))
    return tuple(sorted(found, key=_by_role))


def refuse_other_contents(bundle: Bundle, inputs: Sequence[Source]) -> None:
    """Compare what was read with the checksums that `bundle.yaml` states.

    Raises:
        LogError: A file has another checksum, or is no file of this trial.
    """
    files = {_source_name(bundle.root, part, file): file for part in bundle.parts for file in _files(part)}
    read = {files[source.name]: source for source in inputs}
    for path, stated in bundle.stated:
        source = read.get(path)
        if source is None:
            raise LogError(
                f"a checksum is stated of {path.name!r}, which is no file of this trial",
                file=bundle.file,
                hint="state those of logs, configurations and official results",
            )
        # A hash of the parts that were read cannot be compared with that of the whole.
        if source.read_bytes is None and source.sha256 != stated:
            raise LogError(
                f"its SHA-256 is {source.sha256}, and {stated} is stated",
                file=path,
                hint="send the file again, or correct bundle.yaml",
            )


@cache  # the code that is loaded does not change any more
def engine_code() -> tuple[str, str, str, str]:
    """The code that prices: distribution, version, package, SHA-256."""
    name, package = "ariac-score", "ariac_score"
    return name, version(name), package, package_sha256(package)


def _by_role(source: Source) -> tuple[str, str]:
    return source.role, source.name


def _sources(part: Part, root: Path, stopped: Event | None) -> list[Source]:
    """The files of a part, hashed."""
    return [
        Source(
            part.role,
            _source_name(root, part, file),
            file.stat().st_size,
            *_hashed(file, stopped),
        )
        for file in _files(part)
    ]


def _source_name(root: Path, part: Part, file: Path) -> str:
    """The name of a file in a result: relative to the bundle's folder, with the run that was read of it."""
    base = root if root.is_dir() else root.parent
    run = "" if part.run is None else f"#run={part.run}"
    return name_from(base, file) + run


def _files(part: Part) -> list[Path]:
    """The files of a part; a rosbag2 folder is several."""
    return sorted(p for p in part.path.rglob("*") if p.is_file()) if part.path.is_dir() else [part.path]


def _hashed(file: Path, stopped: Event | None) -> tuple[str, int | None]:
    """Hash of a file, and how much of it was read where that is not everything."""
    parts = ranged(file)
    if parts is None or parts.whole:
        return file_sha256(file, stopped), None
    return parts.sha256(), parts.read_bytes


def file_sha256(file: Path, stopped: Event | None = None) -> str:
    """The hash of a file, read in blocks; not all of it once `stopped` is set.

    Raises:
        LogError: It cannot be read.
    """
    digest, block = hashlib.sha256(), bytearray(_HASHED_BLOCK_BYTES)
    try:
        with file.open("rb", buffering=0) as stream:
            while (count := stream.readinto(block)) and not (stopped and stopped.is_set()):
                digest.update(memoryview(block)[:count])
    except OSError as cause:
        raise LogError(
            f"cannot be read: {cause.strerror}", file=file, hint="check the permissions"
        ) from cause
    return digest.hexdigest()
