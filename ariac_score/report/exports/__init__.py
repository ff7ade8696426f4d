"""Results in formats of other programs: CI systems, code hosts, spreadsheets."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ariac_score.results.result import Result

__all__ = ["EXPORTS", "exported"]

EXPORTS = ("junit", "sarif", "github", "markdown", "csv", "jsonl")
"""The formats: for each a function `<name>_text(result)`, those of tables in one module."""


def exported(result: Result, name: str) -> str:
    """A result in one of the formats `EXPORTS`."""
    # Loaded by name, so that a command that offers the formats loads none of them.
    module = "tables" if name in ("csv", "jsonl") else name
    render = getattr(import_module(f"{__name__}.{module}"), f"{name}_text")
    text: str = render(result)
    return text
