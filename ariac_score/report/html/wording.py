"""Text and numbers on a page: untrusted text shown as text, folded where long; numbers that line up."""

from __future__ import annotations

import hashlib
import math
import re
from decimal import Decimal

from markupsafe import Markup

from ariac_score.report.figures import rounded_points
from ariac_score.report.text import amount_text
from ariac_score.terminal.style import plain
from ariac_score.trial.words import spelled

__all__ = ["amount", "brief", "file_name", "number", "points", "round_to", "seconds", "spoken", "untrusted"]

SHOWN_AT_ONCE = 240
"""Longer text is folded: its start is shown, and the whole on demand."""

LONGEST_LABEL = 60
MINUS = "\u2212"
NOTHING = "\u2013"
# As wide as a digit, and as wide as a point, in fonts with tabular figures.
FIGURE_SPACE, POINT_SPACE = "\u2007", "\u2008"
_LONGEST_NAME = 48
_SUFFIX = re.compile(r"-[0-9a-f]{12}$")
# Windows opens a device under these names, with any ending.
_RESERVED = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\.|$)")


def untrusted(text: object) -> Markup:
    """Text from logs, teams or plugins for the flow of a page: escaped, isolated, folded where long.

    `<bdi>` keeps right-to-left letters from moving their neighbours. Marks that steer
    direction, and all other characters that do not print, are shown as escapes.

    >>> print(untrusted("<b>"))
    <bdi>&lt;b&gt;</bdi>
    """
    shown = plain(str(text))
    if len(shown) <= SHOWN_AT_ONCE:
        return Markup("<bdi>{}</bdi>").format(shown)
    return Markup(
        '<details class="fold"><summary><bdi>{}\u2026</bdi> <small>{} characters</small></summary>'
        "<bdi>{}</bdi></details>"
    ).format(shown[:LONGEST_LABEL], _grouped(len(shown)), shown)


def brief(text: object, longest: int = LONGEST_LABEL) -> str:
    """Untrusted text for a heading, a link or a label: one line, cut where long.

    >>> brief("line\\nbreak")
    'line\\\\nbreak'
    """
    shown = plain(str(text))
    return shown if len(shown) <= longest else f"{shown[: longest - 1]}\u2026"


def spoken(name: str) -> str:
    """The name of a check as people write it; of a finding that of its check and which one it is.

    >>> spoken("none_missing"), spoken("part_pose#2"), spoken("separation#1")
    ('none missing', 'part pose 2', 'separation 1')
    """
    check, _, number = name.partition("#")
    return f"{spelled(check.replace('_', ' '))} {number}".strip()


def _grouped(count: int) -> str:
    # A narrow no-break space, as in SI: a comma or a point is a decimal mark for some reader.
    return f"{count:,}".replace(",", "\u202f")


def number(value: float | int | None, digits: int = 4) -> str:
    """A measured number with that many significant digits and a true minus sign; a dash for none.

    >>> number(0.123456), number(2)
    ('0.1235', '2')
    """
    if value is None or not math.isfinite(value):
        return NOTHING
    if isinstance(value, int):
        text = _grouped(value) if abs(value) >= 10_000 else str(value)
    elif abs(value) >= 10**digits and abs(value) < 1e12:
        text = _grouped(round(value))  # `g` would write 1.235e+05
    else:
        text = f"{value:.{digits}g}"
    return text.replace("-", MINUS)


def seconds(value: float | None, digits: int = 2) -> str:
    """A time in s with its unit."""
    return NOTHING if value is None else f"{value:.{digits}f}\u202fs".replace("-", MINUS)


def amount(value: Decimal | float | None, sign: bool = False, decimals: int = 0) -> str:
    """Points without trailing zeros; blanks of the same width replace them, so that a column lines up.

    Args:
        value: The points; a dash stands for none.
        sign: Whether what is more than 0 has a plus.
        decimals: Room for that many digits after the point.

    >>> amount(Decimal("3.500")), amount(Decimal("28.0"), sign=True)
    ('3.5', '+28')
    """
    if value is None:
        return NOTHING
    points = value if isinstance(value, Decimal) else Decimal(repr(value))
    text = amount_text(points, sign=sign).replace("-", MINUS)
    _, point, fraction = text.partition(".")
    room = decimals - len(fraction)
    return text + ("" if point or room <= 0 else POINT_SPACE) + FIGURE_SPACE * max(room, 0)


def round_to(value: Decimal | None, digits: int) -> str:
    """Points with so many decimals; a dash for none.

    >>> round_to(Decimal("-8.238323"), 2), round_to(Decimal("-0.001"), 2)
    ('\u22128.24', '0.00')
    """
    if value is None:
        return NOTHING
    # + 0 makes a zero positive that rounding left negative.
    return f"{value.quantize(Decimal(1).scaleb(-digits)) + 0:f}".replace("-", MINUS)


def points(value: Decimal, digits: int = 9, sign: bool = False, decimals: int | None = None) -> Markup:
    """Points to the digits that mean something, the exact number behind them as a title.

    Args:
        value: Exact.
        digits: Most decimals, as the rule set rounds.
        sign: Whether what is more than 0 has a plus.
        decimals: So many, with room for them all, so that a column lines up; by default what means something.

    >>> print(points(Decimal("19.761677"))), print(points(Decimal("28.000000")))
    <data value="19.761677" title="exactly 19.761677">19.76</data>
    28
    (None, None)
    """
    rounded = rounded_points(value, digits) if decimals is None else round(value, decimals) + Decimal(0)
    exact, shown = amount_text(value), amount(rounded, sign, decimals or 0)
    if amount_text(rounded) == exact:
        return Markup("{}").format(shown)
    return Markup('<data value="{}" title="exactly {}">{}</data>').format(
        exact, exact.replace("-", MINUS), shown
    )


def file_name(text: str) -> str:
    """A name for a file or folder that is safe on every system and differs where the texts differ.

    Plain lower-case names stay as they are. All others get the start of their hash, and so do
    names that already end like one, so that no two texts share a file, not even where a file
    system takes `A` and `a` for one name.

    >>> file_name("aurora"), file_name("../Aurora")
    ('aurora', 'aurora-bf3fb6a6f254')
    """
    slug = re.sub(r"[^a-z0-9_]+", "-", text.lower()).strip("-")[:_LONGEST_NAME].rstrip("-")
    if slug == text and slug and not _RESERVED.match(slug) and not _SUFFIX.search(slug):
        return slug
    digest = hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()[:12]
    return f"{slug or 'x'}-{digest}"
