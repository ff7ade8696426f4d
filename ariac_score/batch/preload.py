"""Imported by the server of processes, so that each run starts with everything loaded."""

from __future__ import annotations

import json
import os
import tempfile
from contextlib import suppress
from importlib import import_module
from pathlib import Path

from ariac_score.batch import worker
from ariac_score.batch.remote import load_library
from ariac_score.batch.tasks import BatchSetting, Limits, RunTask
from ariac_score.checks.contracts import GROUPS
from ariac_score.errors import ScoreError
from ariac_score.logs.columnar.types import bundled_typestore

__all__ = ["SETTING", "worker"]

SETTING = "ARIAC_SCORE_BATCH_SETTING"
"""Environment variable with the file of the setting that most runs will have."""


_LATE = ("concurrent.futures.thread", "lz4.frame", "numpy.ma")
"""What libraries import only when a log asks for it."""


def _load_everything() -> None:
    """Import every plugin; one that cannot be is named where it is asked for."""
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
    """Build the rule set, and go through the motions once, with nothing to score."""
    told = json.loads(Path(file).read_text(encoding="ascii"))
    setting = BatchSetting(**{**told, "limits": Limits(**told["limits"])})
    for scheme in filter(None, setting.storages.split(",")):
        load_library(scheme)
    with tempfile.TemporaryDirectory(prefix="ariac-score-") as nothing:
        worker.perform(RunTask("", "nothing", 1, nothing), setting)


_load_everything()
if os.environ.get(SETTING):
    with suppress(OSError, ValueError, ScoreError):  # each run prepares itself, and says what is wrong
        _prepare(os.environ[SETTING])
