"""Imported by the fork server, so that the process of each run starts with everything loaded."""

from __future__ import annotations

import json
import os
import tempfile
import warnings
from contextlib import suppress
from importlib import import_module
from pathlib import Path

import msgspec

from ariac_score.batch import worker
from ariac_score.batch.local import SAFE_PATH, SETTING_VARIABLE
from ariac_score.batch.remote import load_library
from ariac_score.batch.tasks import BatchSetting, RunTask
from ariac_score.checks.contracts import GROUPS
from ariac_score.errors import ScoreError
from ariac_score.installed.system import adopt_orphans
from ariac_score.logs.columnar.types import bundled_typestore

__all__ = ["worker"]

_LATE = ("concurrent.futures.thread", "lz4.frame", "numpy.ma")
"""Modules that libraries import only when a log needs them."""


def _load_everything() -> None:
    """Import every plugin; one that cannot be imported is reported where it is used."""
    for name in _LATE:
        with suppress(ImportError):
            import_module(name)
    bundled_typestore(1)
    bundled_typestore(2)
    registry = worker.installed()
    for group in GROUPS:
        for plugin in registry.all(group):
            try:
                plugin.load()
            except ScoreError:
                continue


def _prepare(file: str) -> None:
    """Build the rule set, and score an empty folder once, which fills caches that each fork inherits."""
    setting = msgspec.convert(json.loads(Path(file).read_text(encoding="ascii")), BatchSetting)
    for scheme in filter(None, setting.storages.split(",")):
        load_library(scheme)
    with tempfile.TemporaryDirectory(prefix="ariac-score-") as nothing:
        worker.perform(RunTask("", "nothing", 1, nothing), setting)


adopt_orphans()
# Python says this of orphans that the server collects, as if it were a fault.
warnings.filterwarnings("ignore", message="forkserver: waitpid returned unexpected pid")
if os.environ.get(SAFE_PATH[0]) == SAFE_PATH[1]:
    del os.environ[SAFE_PATH[0]]
# Whatever a stranger's package does here: a server that dies of it could score no run at all.
with suppress(Exception):
    _load_everything()
if os.environ.get(SETTING_VARIABLE):
    with suppress(OSError, ValueError, ScoreError):  # each run prepares itself, and reports what is wrong
        _prepare(os.environ[SETTING_VARIABLE])
