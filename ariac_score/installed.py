"""What installed distributions bring: their entry points, read as installers write them.

`importlib.metadata` finds the same, and loading it takes longer than many a command. It is asked where
distributions may be found in another way than as folders on the path.

Source: PyPA specifications, "Recording installed projects" and "Entry points".
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Container, Iterator
from functools import reduce
from importlib import import_module
from importlib.machinery import PathFinder
from typing import Any, NamedTuple

__all__ = ["Point", "attribute_of", "brought_by", "points_in", "version_of"]


class Point(NamedTuple):
    """One entry point.

    Attributes:
        group: Its group.
        name: Its name in the group.
        target: `module:attribute`.
        distribution: Normalised name of the distribution that brings it; `?` where its metadata do not say.
        version: Version of that distribution, or `?`.
    """

    group: str
    name: str
    target: str
    distribution: str
    version: str


_KINDS = ("dist-info", "egg-info")
_TARGET = re.compile(r"(?P<module>[\w.]+)\s*(:\s*(?P<attribute>[\w.]+)\s*)?(\[.*\]\s*)?$")


def attribute_of(target: str) -> Any:
    """What an entry point leads to, imported.

    Raises:
        ValueError: It is no `module:attribute`.
    """
    parts = _TARGET.match(target)
    if parts is None:
        raise ValueError(f"{target!r} is not of the form 'module:attribute'")
    names = filter(None, (parts["attribute"] or "").split("."))
    return reduce(getattr, names, import_module(parts["module"]))


def points_in(groups: Container[str]) -> list[Point]:
    """The entry points of all installed distributions in some groups, sorted."""
    try:
        found = list(_on_path(groups))
    except _UnusualError:
        found = list(_by_importlib(groups))
    return sorted(found)


class _UnusualError(Exception):
    """Something is left to `importlib.metadata`."""


def _on_path(groups: Container[str]) -> Iterator[Point]:
    """Those of distributions that are folders on the path.

    Raises:
        _UnusualError: There may be others, or one is written unusually.
    """
    if any(f is not PathFinder and hasattr(f, "find_distributions") for f in sys.meta_path):
        raise _UnusualError
    seen = set[str]()
    for place in sys.path:
        for name in _names_in(place):
            stem, dot, kind = name.rpartition(".")
            if kind.lower() not in _KINDS or not dot:
                continue
            if kind != kind.lower():
                raise _UnusualError
            known = _normalised(stem.partition("-")[0])
            if known in seen:
                continue  # the first on the path hides the others
            seen.add(known)
            yield from _points_of(f"{place or '.'}{os.sep}{name}", groups)


def _names_in(place: str) -> list[str]:
    if place.lower().rstrip("/\\").endswith(".egg"):
        raise _UnusualError
    try:
        return os.listdir(place or ".")  # noqa: PTH208  # what stands on the path need not be a path
    except FileNotFoundError:
        return []
    except OSError as error:  # an archive, perhaps
        raise _UnusualError from error


def _points_of(folder: str, groups: Container[str]) -> Iterator[Point]:
    """The entry points of one distribution."""
    group, brought = "", None
    for line in map(str.strip, _text(f"{folder}{os.sep}entry_points.txt").splitlines()):
        if line.startswith("[") and line.endswith("]"):
            group = line.strip("[]")
        elif line and not line.startswith("#") and group in groups:
            name, sign, target = line.partition("=")
            if not sign:
                raise _UnusualError
            brought = brought or _brought_by(folder)
            yield Point(group, name.strip(), target.strip(), *brought)


def _brought_by(folder: str) -> tuple[str, str]:
    """Name and version of a distribution, from the head of its metadata."""
    for file in ("METADATA", "PKG-INFO"):
        found: dict[str, str] = {}
        for line in _text(f"{folder}{os.sep}{file}").splitlines():
            key, sign, value = line.partition(":")
            if not sign:
                break
            found.setdefault(key.lower(), value.strip())
        if found.get("name") and found.get("version"):
            return _normalised(found["name"]), found["version"]
    raise _UnusualError


def version_of(distribution: str) -> str:
    """The version of a distribution that is installed.

    Raises:
        PackageNotFoundError: It is not (of `importlib.metadata`).
    """
    wanted = _normalised(distribution)
    try:
        for place in sys.path:
            for name in _names_in(place):
                stem, _, kind = name.rpartition(".")
                if kind in _KINDS and _normalised(stem.partition("-")[0]) == wanted:
                    return _brought_by(f"{place or '.'}{os.sep}{name}")[1]
    except _UnusualError:
        pass
    from importlib.metadata import version  # noqa: PLC0415  # see above

    return version(distribution)


def _text(file: str) -> str:
    try:
        with open(file, encoding="utf-8") as opened:  # noqa: PTH123  # as above
            return opened.read()
    except (FileNotFoundError, NotADirectoryError):
        return ""
    except (OSError, UnicodeDecodeError) as error:
        raise _UnusualError from error


def _by_importlib(groups: Container[str]) -> Iterator[Point]:
    from importlib.metadata import EntryPoint, entry_points  # noqa: PLC0415  # see above

    known: dict[int, tuple[str, str]] = {}  # a distribution tells of itself once, however much it brings
    everything = entry_points()
    points: list[EntryPoint] = [p for group in everything.groups for p in everything.select(group=group)]
    for point in points:
        if point.group in groups:
            if id(point.dist) not in known:
                known[id(point.dist)] = brought_by(point)
            yield Point(point.group, point.name, point.value, *known[id(point.dist)])


def brought_by(point: Any) -> tuple[str, str]:
    """Name and version of the distribution an entry point is of; `?` where its metadata do not say."""
    try:
        metadata = point.dist.metadata if point.dist else None
    except (TypeError, FileNotFoundError):  # what Python makes of missing metadata depends on its version
        metadata = None
    if metadata is None:
        return "?", "?"
    known = [key if key in metadata else "" for key in ("Name", "Version")]
    name, version = (metadata[key] if key else "?" for key in known)
    return _normalised(name), version


def _normalised(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()
