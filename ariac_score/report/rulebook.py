"""A rulebook as Markdown, and as plain text for a terminal."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass

from ariac_score.review.rulebook.blocks import Block, Bullets, Curve, Grid, Rulebook, Text, figure
from ariac_score.terminal.style import Style, plain

__all__ = ["as_pieces", "rulebook_markdown", "rulebook_text"]

_CODE = re.compile(r"(`[^`]*`)")
_STEERING = re.compile(r"([\\`*_\[\]<>|#])")
_WIDTH, _WIDEST = 100, 34


def as_pieces(text: str) -> Iterator[tuple[str, bool]]:
    """The pieces of a text, each with whether it is as it stands in a file; nothing in it steers a terminal.

    >>> list(as_pieces("in `a.yaml`, line 3"))
    [('in ', False), ('a.yaml', True), (', line 3', False)]
    """
    for piece in _CODE.split(plain(" ".join(text.split()))):
        if piece:
            coded = len(piece) > 1 and piece[0] == piece[-1] == "`"
            yield piece.strip("`") if coded else piece, coded


def rulebook_markdown(book: Rulebook) -> str:
    """A rulebook as Markdown."""
    lines = [f"# {_inline(book.title)}", ""]
    lines += [
        f"The rulebook of `{_bare(book.id)}`, made from the rule set. Its source: {_inline(book.source)}",
        "",
    ]
    for section in book.sections:
        lines += [f"## {_inline(section.title)}", ""]
        for block in section.blocks:
            lines += [*_markdown(block), ""]
    return "\n".join(lines).rstrip() + "\n"


def _markdown(block: Block) -> Iterator[str]:
    if isinstance(block, Text):
        yield _inline(block.text)
    elif isinstance(block, Bullets):
        yield from (f"- {_inline(item)}" for item in block.items)
    else:
        yield from _table(_grid_of(block))


def _table(grid: Grid) -> Iterator[str]:
    if grid.caption:
        yield from (f"**{_inline(grid.caption)}**", "")
    rule = ("---:" if column in grid.numbers else "---" for column in range(len(grid.head)))
    yield f"| {' | '.join(map(_inline, grid.head))} |"
    yield f"| {' | '.join(rule)} |"
    for row in grid.rows:
        yield f"| {' | '.join(map(_inline, row))} |"


def _grid_of(block: Grid | Curve) -> Grid:
    """A curve as a table of its points."""
    if isinstance(block, Grid):
        return block
    head = (block.what, *(figure(x) for x in block.x))
    rows = (("score", *(figure(score, 4) for score in block.score)),)
    return Grid(f"The score with violations of {block.title}", head, rows, frozenset(range(1, len(head))))


def _inline(text: str) -> str:
    """Text for one line of Markdown: nothing in it is markup but what stands between backticks."""
    pieces = []
    for piece, coded in as_pieces(text):
        pieces.append(f"`{piece.replace('|', chr(92) + '|')}`" if coded else _STEERING.sub(r"\\\1", piece))
    return "".join(pieces)


def _bare(name: str) -> str:
    return plain(name).replace("`", "'")


# For a terminal ------------------------------------------------------------------------


def rulebook_text(book: Rulebook, style: Style | None = None) -> str:
    """A rulebook as lines for a terminal."""
    out = _Terminal(style or Style())
    lines = [*out.wrapped(book.title, look="bold"), *out.wrapped(f"{book.id}. {book.source}", look="dim")]
    for section in book.sections:
        lines += ["", *out.wrapped(section.title, look="bold")]
        for block in section.blocks:
            lines += ["", *out.block(block)]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class _Terminal:
    style: Style

    def wrapped(self, text: str, look: str = "", first: str = "", then: str = "") -> list[str]:
        """A text in lines that fit."""
        lines = textwrap.wrap(_said(text), _WIDTH, initial_indent=first, subsequent_indent=then)
        return [self.style(line, look) if look else line for line in lines]

    def block(self, block: Block) -> Iterator[str]:
        """The lines of a block."""
        if isinstance(block, Text):
            yield from self.wrapped(block.text)
        elif isinstance(block, Bullets):
            for item in block.items:
                yield from self.wrapped(item, first="- ", then="  ")
        else:
            yield from self._grid(_grid_of(block))

    def _grid(self, grid: Grid) -> Iterator[str]:
        """A table whose long cells go on below themselves."""
        if grid.caption:
            yield from self.wrapped(grid.caption, look="dim")
        rows = [[_said(cell) for cell in row] for row in (grid.head, *grid.rows)]
        widths = [min(max(map(len, column)), _WIDEST) for column in zip(*rows, strict=True)]
        for number, row in enumerate(rows):
            cells = [textwrap.wrap(cell, width or 1) or [""] for cell, width in zip(row, widths, strict=True)]
            for line in range(max(map(len, cells))):
                shown = "  ".join(
                    _aligned(cell[line] if line < len(cell) else "", width, column in grid.numbers)
                    for column, (cell, width) in enumerate(zip(cells, widths, strict=True))
                ).rstrip()
                yield self.style(f"  {shown}", "dim") if number == 0 else f"  {shown}"


def _aligned(cell: str, width: int, number: bool) -> str:
    return cell.rjust(width) if number else cell.ljust(width)


def _said(text: str) -> str:
    return "".join(piece for piece, _ in as_pieces(text))
