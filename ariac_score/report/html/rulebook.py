"""The page of a rulebook: to be read, printed and handed to referees."""

from __future__ import annotations

from dataclasses import dataclass

from markupsafe import Markup

from ariac_score.report.html.page import page
from ariac_score.report.html.scale import Scale, ticks
from ariac_score.report.rulebook import as_pieces
from ariac_score.review.rulebook.blocks import Bullets, Curve, Grid, Rulebook, Text, figure

__all__ = ["Drawing", "drawing_of", "rulebook_page"]

_WIDTH, _HEIGHT = 640, 200
"""Of a drawing without its labels, in user units."""


def rulebook_page(book: Rulebook) -> str:
    """The page of a rulebook: one file that needs nothing else."""
    kinds = {Text: "text", Bullets: "bullets", Grid: "grid", Curve: "curve"}
    return page(
        "rulebook.html.j2",
        book=book,
        kind=lambda block: kinds[type(block)],
        inline=_inline,
        drawing_of=drawing_of,
        figure=figure,
    )


def _inline(text: str) -> Markup:
    """Text of a rule set or plugin: escaped, isolated, what stands in a file set apart."""
    return Markup("").join(
        Markup("<code>{}</code>").format(piece) if coded else Markup("<bdi>{}</bdi>").format(piece)
        for piece, coded in as_pieces(text)
    )


@dataclass(frozen=True)
class Drawing:
    """A curve in user units, y downwards.

    Attributes:
        width: Of the field.
        height: Of it.
        line: Path of the curve.
        area: Path of what lies below it.
        across: Places of labels on the horizontal axis, and their text.
        up: Likewise on the vertical axis.
        dots: Where a value was computed.
    """

    width: int
    height: int
    line: str
    area: str
    across: tuple[tuple[float, str], ...]
    up: tuple[tuple[float, str], ...]
    dots: tuple[tuple[float, float], ...]


def drawing_of(curve: Curve) -> Drawing:
    """The drawing of a curve; its vertical axis always holds zero, so that a small loss looks small."""
    low, high = min(0.0, *curve.score), max(0.0, *curve.score)
    levels = ticks(low, high, 5)
    across = Scale(0.0, curve.x[-1])
    up = Scale(min(low, levels[0]), max(high, levels[-1]))
    dots = tuple(
        (round(across.at(x) * _WIDTH / 100, 1), round(_HEIGHT - up.at(y) * _HEIGHT / 100, 1))
        for x, y in zip(curve.x, curve.score, strict=True)
    )
    line = f"M{dots[0][0]:g} {dots[0][1]:g}"
    for x, y in dots[1:]:
        line += f"H{x:g}V{y:g}" if curve.steps else f"L{x:g} {y:g}"
    zero = round(_HEIGHT - up.at(0.0) * _HEIGHT / 100, 1)
    return Drawing(
        _WIDTH,
        _HEIGHT,
        line,
        f"{line}V{zero:g}H{dots[0][0]:g}z",
        tuple((round(at * _WIDTH / 100, 1), figure(value)) for value, at in across.ticks),
        tuple((round(_HEIGHT - up.at(level) * _HEIGHT / 100, 1), figure(level)) for level in levels),
        dots,
    )
