"""Results as what other programs read: CI systems, code hosts, spreadsheets."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ariac_score.results.result import Result

__all__ = ["EXPORTS", "exported"]

EXPORTS = ("junit", "sarif", "github", "markdown", "csv", "jsonl")
"""Each is a module here with a function `text(result)`."""


def exported(result: Result, name: str) -> str:
    """A result in one of the formats `EXPORTS`."""
    module = "tables" if name in ("csv", "jsonl") else name
    render = getattr(import_module(f"{__name__}.{module}"), f"{name}_text")
    text: str = render(result)
    return text
