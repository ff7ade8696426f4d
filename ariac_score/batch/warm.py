"""Imported by the server of processes, so that each run starts with everything loaded."""

from __future__ import annotations

from ariac_score.batch import worker
from ariac_score.contracts import GROUPS
from ariac_score.datafiles import schema_errors
from ariac_score.errors import ScoreError

__all__ = ["worker"]


def _load_everything() -> None:
    """Import every plugin; one that cannot be is named where it is asked for."""
    registry = worker.installed()
    for group in GROUPS:
        for plugin in registry.all(group):
            try:
                plugin.load()
            except ScoreError:
                continue
    schema_errors({}, "ruleset")
    schema_errors({}, "log_map")


_load_everything()
