"""The entry points of the installed distributions: read one by one, imported only when they are used.

What is broken, unknown or brought twice stops only what uses it, and is always named with its
distribution.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.metadata import Distribution, EntryPoint, distributions, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ariac_score.errors import PluginError
from ariac_score.installed.captured_output import fault_of, quiet

__all__ = [
    "OURS",
    "Point",
    "UnreadableDistribution",
    "installed_points",
    "origin_of",
    "unreadable_distributions",
    "unreadable_hint",
]

OURS = "ariac_score."
"""Prefix of every entry-point group of this project."""


@dataclass(frozen=True)
class Point:
    """One entry point as installed, not yet imported.

    Attributes:
        name: Its name, such as `kitting.pose`.
        group: Its group, such as `ariac_score.rules`.
        target: `module:attribute`.
        distribution: Name of the distribution that brings it.
        version: Version of that distribution.
    """

    name: str
    group: str
    target: str
    distribution: str
    version: str

    @property
    def package(self) -> str:
        """Top-level import package of its code."""
        return self.target.partition(":")[0].partition(".")[0]

    @property
    def origin(self) -> str:
        """Words for messages: name, distribution, version."""
        return f"{self.name} ({self.distribution} {self.version})"

    @property
    def repair(self) -> str:
        """What its user can do, where it cannot be imported."""
        return f"repair or reinstall {self.distribution}"

    @property
    def complaint(self) -> str:
        """What its user can do, where it breaks its contract."""
        return f"report it to the authors of {self.distribution}"

    def load(self) -> Any:
        """Import what it names.

        Raises:
            PluginError: The import fails, for whatever reason.
        """
        try:
            with quiet(self.origin, deep=True):
                return self._object()
        except PluginError:
            raise
        except Exception as cause:  # a stranger's module may raise anything at import
            raise PluginError(
                f"cannot be imported: {fault_of(cause)}",
                origin=self.origin,
                hint=self.repair,
            ) from cause

    def _object(self) -> Any:
        return EntryPoint(self.name, self.target, self.group).load()

    def path(self) -> Path:
        """The file or folder that it names, for entry points of data.

        `package:name` is `name.yaml` in the folder of that package, or the folder `name` there; dots lead
        further down.

        Raises:
            PluginError: There is neither.
        """
        module, _, inner = (part.strip() for part in self.target.partition(":"))
        try:
            with quiet(self.origin, deep=True):
                spec = find_spec(module)
        except PluginError:
            raise
        except Exception as cause:  # a stranger's package may raise anything at import
            raise PluginError(
                f"cannot be found: {fault_of(cause)}",
                origin=self.origin,
                hint=f"repair or reinstall {self.distribution}",
            ) from cause
        for folder in (spec.submodule_search_locations or ()) if spec else ():
            place = Path(folder).joinpath(*filter(None, inner.split(".")))
            for found in (place.with_name(f"{place.name}.yaml") if inner else place, place):
                if found.exists():
                    return found
        raise PluginError(
            f"names {self.target!r}, where no file lies",
            origin=self.origin,
            hint="name a package, or PACKAGE:NAME for NAME.yaml or the folder NAME in it",
        )


@dataclass(frozen=True)
class UnreadableDistribution:
    """An installed distribution whose entry points cannot be read, so that none of them is used.

    Attributes:
        distribution: Its name.
        version: Its version.
        reason: What is wrong with its entry points.
    """

    distribution: str
    version: str
    reason: str

    @property
    def origin(self) -> str:
        """Words for messages: name, version."""
        return f"{self.distribution} {self.version}"


def installed_points() -> list[Point]:
    """Every entry point of our groups, sorted, so that the order of `sys.path` has no influence."""
    return list(_points(_surroundings()))


def unreadable_distributions() -> list[UnreadableDistribution]:
    """The installed distributions whose entry points cannot be read, sorted."""
    return list(_unreadable(_surroundings()))


def _surroundings() -> tuple[tuple[str, int], ...]:
    """Where distributions are looked for, and since when each folder is as it is.

    Reading the metadata of everything installed takes a hundred times as long as asking for these, and
    `importlib.metadata` itself trusts them where it looks for distributions by name.
    """
    found = []
    for folder in sys.path:
        try:
            changed_ns = Path(folder).stat().st_mtime_ns
        except (OSError, ValueError):
            changed_ns = -1
        found.append((folder or str(Path.cwd()), changed_ns))
    return tuple(found)


@lru_cache(maxsize=4)
def _points(_: tuple[tuple[str, int], ...]) -> tuple[Point, ...]:
    try:
        everything = entry_points()
        points = [
            p for group in everything.groups if group.startswith(OURS) for p in everything.select(group=group)
        ]
    except Exception:  # noqa: BLE001  # one malformed entry_points.txt, of anybody, stops importlib
        points = [p for _, found, _ in _each_distribution() for p in found if p.group.startswith(OURS)]
    origins = cache(origin_of)  # one distribution has many entry points, and reading its metadata takes time
    found: dict[tuple[str, ...], Point] = {}
    for p in points:
        point = Point(p.name, p.group, p.value, *origins(p.dist))
        # An editable install found next to its own sources shows one distribution twice.
        found.setdefault((point.group, point.name, point.target, point.distribution), point)
    return tuple(found[key] for key in sorted(found))


@lru_cache(maxsize=4)
def _unreadable(_: tuple[tuple[str, int], ...]) -> tuple[UnreadableDistribution, ...]:
    found = [
        UnreadableDistribution(*origin_of(one), f"its entry points cannot be read: {problem}")
        for one, _, problem in _each_distribution()
        if problem
    ]
    return tuple(sorted(found, key=lambda one: (one.distribution, one.version)))


def unreadable_hint() -> str:
    """The end of a hint about a missing name: it may be in a distribution that cannot be read."""
    words = "; ".join(f"{one.origin}: {one.reason}" for one in unreadable_distributions())
    return f"; {words}" if words else ""


def _each_distribution() -> Iterator[tuple[Distribution, Sequence[EntryPoint], str]]:
    """Each installed distribution with its entry points, or with the reason why they cannot be read."""
    seen = set()
    for one in distributions():
        name, _ = origin_of(one)
        if name in seen and name != "?":  # as for imports, the first one on `sys.path` counts
            continue
        seen.add(name)
        try:
            yield one, tuple(one.entry_points), ""
        except Exception as cause:  # noqa: BLE001  # a stranger's text may break the parser in any way
            yield one, (), f"{fault_of(cause)}"


def origin_of(distribution: Distribution | None) -> tuple[str, str]:
    """Normalised name and version of a distribution; `?` where its metadata lack them."""
    try:
        metadata = distribution.metadata if distribution else None
    # What Python makes of missing metadata depends on its version; a ValueError: they are not UTF-8.
    except (TypeError, FileNotFoundError, ValueError):
        metadata = None
    if metadata is None:
        return "?", "?"
    stated = {key: metadata[key] for key in ("Name", "Version") if key in metadata}
    name, version = stated.get("Name", "?"), stated.get("Version", "?")
    # PEP 503: `Ariac_Score` and `ariac-score` are one distribution, and results compare names.
    return re.sub(r"[-_.]+", "-", name).lower(), version
