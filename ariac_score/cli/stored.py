"""Stored results that commands are given; a log in the place of one is told apart."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ariac_score.checks.registry import Registry
from ariac_score.engine.read import find_trial
from ariac_score.errors import LogError, ResultError, ScoreError
from ariac_score.results.result import Result
from ariac_score.results.result_file import load_result

__all__ = ["is_log", "not_a_log", "result_given"]


def result_given(path: Path, command: str) -> Result:
    """The stored result that a command is given.

    Raises:
        ResultError: It is none; of a log, what to do with it instead.
    """
    with not_a_log(path, command):
        return load_result(path)


@contextmanager
def not_a_log(path: Path, command: str) -> Iterator[None]:
    """Say what to do where a command that takes results fails because it is given a log.

    Raises:
        ResultError: It was.
    """
    try:
        yield
    except ResultError:
        if not is_log(path):
            raise
        stored = f"{path.name.partition('.')[0] or 'trial'}.json"
        raise ResultError(
            f"this is a log, and '{command}' takes a result",
            file=path,
            hint=f"score it first: ariac-score score {path} --rules NAME -o {stored}; "
            f"then: ariac-score {command} {stored}",
        ) from None


def is_log(path: Path) -> bool:
    """Whether a path is that of a log, or of a folder with the parts of one trial."""
    if path.suffix == ".json":
        return False
    try:
        find_trial(path, Registry())
    except LogError as error:
        return error.exit_code == LogError.exit_code  # a log, if not one whole trial
    except ScoreError:
        return False
    return True
