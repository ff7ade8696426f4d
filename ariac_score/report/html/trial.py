"""The page of one trial."""

from __future__ import annotations

from ariac_score.report.html.page import page
from ariac_score.result import Result

__all__ = ["trial_page"]


def trial_page(result: Result, stored: str) -> str:
    """The page of a trial: one file that needs nothing else.

    Args:
        result: The result.
        stored: The same as canonical JSON, to be taken along.
    """
    return page("trial.html.j2", result=result, stored=stored)
