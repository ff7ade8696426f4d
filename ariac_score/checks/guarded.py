"""Readers and decoders whose failures name the plugin instead of ending in a traceback."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from numbers import Real
from pathlib import Path
from types import SimpleNamespace
from typing import get_type_hints

from ariac_score.checks.contracts import (
    Decoded,
    Decoder,
    HoldsRuns,
    Likeness,
    Likening,
    LogDescription,
    Reader,
    ReaderFacts,
    Wanted,
    reader_facts,
)
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.errors import PluginError, ScoreError
from ariac_score.installed.captured_output import fault_of, quiet
from ariac_score.trial.events import Event
from ariac_score.trial.model import Trial
from ariac_score.trial.work import Record, Submission, WorkItem

__all__ = ["GuardedDecoder", "GuardedReader", "broken", "open_readers"]


def broken(plugin: Plugin, what: str, *, of: str = "") -> PluginError:
    """The error for a plugin that does not do what its contract says.

    Args:
        plugin: The plugin at fault.
        what: What it did, such as `raised KeyError: 'x'`.
        of: The check that uses it.
    """
    check = f"check {of!r}: " if of else ""
    return PluginError(
        f"{check}plugin {plugin.origin} {what}",
        hint=f"no score is given with a broken plugin; {plugin.complaint}",
    )


class GuardedReader:
    """A reader whose failures name it."""

    def __init__(self, plugin: Plugin, reader: Reader) -> None:
        self.plugin, self.reader = plugin, reader

    @property
    def facts(self) -> ReaderFacts:
        """What the reader states about its files."""
        return reader_facts(self.reader)

    def can_read(self, path: Path) -> bool:
        """Whether the reader recognises the file.

        Raises:
            PluginError: It raised, which `can_read` never may.
        """
        # Unlike in `read`, an error for users is a fault too: every reader gets every file to look at.
        try:
            with quiet(self.plugin.origin):
                return bool(self.reader.can_read(path))
        except Exception as cause:
            raise self._failed(cause, path) from cause

    def describe(self, path: Path) -> LogDescription:
        """What the log holds, by the reader.

        Raises:
            PluginError: It raised something other than an error for the user.
        """
        try:
            with quiet(self.plugin.origin, deep=True):
                return self.reader.describe(path)
        except ScoreError:
            raise
        except Exception as cause:
            raise self._failed(cause, path) from cause

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The trial that the reader reads.

        Raises:
            PluginError: It raised something other than an error for the user, or
                returned something other than a trial.
        """
        try:
            with quiet(self.plugin.origin, deep=True):
                trial = self.reader.read(path, wanted)
        except ScoreError:
            raise
        except Exception as cause:
            raise self._failed(cause, path) from cause
        if not isinstance(trial, Trial):
            raise broken(self.plugin, f"brings a {type(trial).__name__} instead of a Trial")
        return trial

    def likeness(self, path: Path) -> Likeness | None:
        """What the file looks like to the reader; `None` for a reader that recognises no forms.

        Raises:
            PluginError: It raised, which `likeness` never may.
        """
        if not isinstance(self.reader, Likening):
            return None
        try:
            with quiet(self.plugin.origin):
                return self.reader.likeness(path)
        except Exception as cause:
            raise self._failed(cause, path) from cause

    def runs(self, path: Path) -> list[tuple[int, str, str]]:
        """Number, team and trial of every run in a file; none for readers of single runs.

        Raises:
            PluginError: It raised something other than an error for the user.
        """
        if not isinstance(self.reader, HoldsRuns):
            return []
        try:
            with quiet(self.plugin.origin, deep=True):
                return list(self.reader.runs(path))
        except ScoreError:
            raise
        except Exception as cause:
            raise self._failed(cause, path) from cause

    def _failed(self, cause: BaseException, path: Path) -> PluginError:
        return broken(self.plugin, f"raised {fault_of(cause).name} on {path.name}: {fault_of(cause).text}")


class GuardedDecoder:
    """A decoder whose failures name it; a `ValueError` says that one message is unusable."""

    def __init__(self, plugin: Plugin, decoder: Decoder) -> None:
        self.plugin, self.decoder = plugin, decoder
        self.only_changes = bool(getattr(decoder, "only_changes", False))

    def decode(self, msgtype: str, message: object, t_s: float) -> Decoded | None:
        """What the decoder makes of a message.

        Raises:
            ValueError: The message is unusable.
            PluginError: It raised anything else, or made something else.
        """
        try:
            with quiet(self.plugin.origin):  # not deep: this runs once for each message
                decoded = self.decoder.decode(msgtype, message, t_s)
        except (ScoreError, ValueError):
            raise
        except Exception as cause:
            if _misfits(message, cause):
                raise ValueError(f"its fields are not those of a {msgtype}: {cause}") from cause
            raise broken(
                self.plugin, f"raised {fault_of(cause).name} on a {msgtype}: {fault_of(cause).text}"
            ) from cause
        if decoded is not None and not isinstance(decoded, WorkItem | Submission | Event | Record):
            raise broken(self.plugin, f"makes a {type(decoded).__name__} of a {msgtype}")
        if isinstance(message, SimpleNamespace) and _took_over_fields(decoded):
            raise ValueError(f"its fields are not those of a {msgtype}: one has parts, or is no text")
        return decoded


def _took_over_fields(made: object) -> bool:
    """Whether something of a message of text stands, at any depth, where another type belongs."""
    if isinstance(made, SimpleNamespace):
        return True
    if isinstance(made, tuple | list):
        return any(map(_took_over_fields, made))
    if isinstance(made, Mapping):
        return any(map(_took_over_fields, (*made.keys(), *made.values())))
    if not is_dataclass(made) or isinstance(made, type):
        return False
    told = ((getattr(made, name, None), kind) for name, kind in _plain_fields(type(made)))
    return any(not isinstance(value, kind) for value, kind in told) or any(
        _took_over_fields(getattr(made, one.name, None)) for one in fields(made)
    )


_PLAIN: Mapping[object, type] = {str: str, bool: bool, int: Real, float: Real}


@cache
def _plain_fields(kind: type) -> tuple[tuple[str, type], ...]:
    """The fields of a dataclass that hold one text or number, and what each must be."""
    try:
        hints = get_type_hints(kind)
    except Exception:  # noqa: BLE001  # a stranger's annotations may name what is not there
        return ()
    return tuple((name, _PLAIN[hint]) for name, hint in hints.items() if hint in (str, bool, int, float))


def _misfits(message: object, cause: BaseException) -> bool:
    """Whether the message is to blame: its sender chose its fields, and a decoder cannot know them all."""
    if isinstance(message, SimpleNamespace):  # it came as text, and anything may stand in any field
        return isinstance(cause, AttributeError | TypeError | LookupError | ArithmeticError)
    # A recording brings its own definitions, which may lack a field that the type of that name has.
    return isinstance(cause, AttributeError) and hasattr(type(cause.obj), "__msgtype__")


def open_readers(registry: Registry) -> tuple[dict[str, GuardedReader], tuple[PluginError, ...]]:
    """Every installed reader that can be used, by name, and why the others cannot.

    A broken reader stops only the logs that need it. Callers name the broken ones when no
    reader recognises a file, for one of them might have.
    """
    readers: dict[str, GuardedReader] = {}
    problems: list[PluginError] = []
    for name in registry.names("ariac_score.readers"):
        try:
            plugin = registry.find("ariac_score.readers", name)
            readers[name] = GuardedReader(plugin, plugin.build({}))
        except PluginError as problem:
            problems.append(problem)
    return readers, tuple(problems)
