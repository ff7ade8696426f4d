"""Text in the cells of spreadsheets."""

from __future__ import annotations

__all__ = ["text_cell"]

# Names of teams come from strangers, and a spreadsheet that opens a CSV file runs what begins like this:
# formulas, in Japanese editions with full-width signs too, and `|` and `%` as commands.
_STARTS = tuple("=+-@|%\t\r\n\uff1d\uff0b\uff0d\uff20")
_BLANKS = " \u00a0\ufeff"


def text_cell(text: str) -> str:
    """Text that every spreadsheet shows as text: where it could be run, an apostrophe stands before it.

    >>> text_cell("=cmd()"), text_cell("alpha")
    ("'=cmd()", 'alpha')
    """
    return f"'{text}" if text.lstrip(_BLANKS).startswith(_STARTS) else text
