"""Executors by name: found through the entry points `ariac_score.executors`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ariac_score.batch.local import LocalExecutor, usable_cores
from ariac_score.checks.registry import Registry
from ariac_score.errors import PluginError, UsageError, did_you_mean
from ariac_score.installed.points import unreadable_hint

__all__ = ["GROUP", "executor_names", "local_executor", "make_executor"]

GROUP = "ariac_score.executors"


def executor_names() -> list[str]:
    """The installed executors."""
    return Registry().names(GROUP)


def make_executor(name: str, *, jobs: int, scheduler: str, out: Path, work: Path) -> Any:
    """An executor by name.

    Args:
        name: Such as `local` or `dask`.
        jobs: Runs at a time; 0 for what the machine has.
        scheduler: Address of its scheduler; empty where it needs none.
        out: Folder of the batch.
        work: Folder for unfinished work.

    Raises:
        UsageError: There is none of that name, or a library it needs is not installed.
    """
    registry = Registry()
    if name not in registry.names(GROUP):
        raise UsageError(
            f"there is no executor {name!r}",
            hint=did_you_mean(name, registry.names(GROUP), what="installed") + unreadable_hint(),
        )
    try:
        make = registry.find(GROUP, name).load()
    except PluginError as error:
        if isinstance(error.__cause__, ImportError):
            error.hint = f"pip install 'ariac-score[{name}]'"
        raise
    return make(jobs=jobs, scheduler=scheduler, out=out, work=work)


def local_executor(*, jobs: int, scheduler: str, out: Path, work: Path) -> LocalExecutor:
    """This machine; it needs no scheduler."""
    if scheduler:
        raise UsageError(
            "the local executor has no scheduler", hint="drop --scheduler, or name --executor dask"
        )
    return LocalExecutor(jobs or usable_cores(), out, work)
