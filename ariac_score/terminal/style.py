"""Colours on a terminal, and text of strangers made harmless there."""

from __future__ import annotations

import os
from dataclasses import dataclass
from typing import TextIO

__all__ = ["Style", "plain", "style_for"]

_CODES = {"bold": "1", "dim": "2", "red": "31", "green": "32", "yellow": "33", "cyan": "36"}


@dataclass(frozen=True)
class Style:
    """Colours, or none."""

    coloured: bool = False

    def __call__(self, text: str, *looks: str) -> str:
        """Text in these looks: bold, dim, red, green, yellow, cyan."""
        if not self.coloured or not looks:
            return text
        return f"\x1b[{';'.join(_CODES[look] for look in looks)}m{text}\x1b[0m"


def style_for(stream: TextIO) -> Style:
    """Colours on a terminal only, and never where `NO_COLOR` is set."""
    wanted = stream.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    return Style(wanted)


def plain(text: str) -> str:
    """Text from a log with control characters made visible, so that it cannot steer a terminal.

    >>> plain("a\\x1b[31mb")
    'a\\\\x1b[31mb'
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in text)
