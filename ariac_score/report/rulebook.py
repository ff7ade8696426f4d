"""A rulebook as Markdown, which is also what a terminal shows."""

from __future__ import annotations

from collections.abc import Iterator

from ariac_score.review.rulebook import Grid, Rulebook, Section
from ariac_score.terminal.style import plain

__all__ = ["rulebook_markdown"]


def rulebook_markdown(book: Rulebook) -> str:
    """A rulebook as Markdown."""
    lines = [f"# {_text(book.title)}", "", f"`{plain(book.id)}`. {_text(book.source)}", ""]
    for section in book.sections:
        lines += [*_section(section), ""]
    return "\n".join(lines).rstrip() + "\n"


def _section(section: Section) -> Iterator[str]:
    yield f"## {_text(section.title)}"
    for text in section.text:
        yield from ("", _text(text))
    for grid in section.grids:
        yield from ("", *_grid(grid))


def _grid(grid: Grid) -> Iterator[str]:
    if grid.caption:
        yield from (f"**{_text(grid.caption)}**", "")
    for row in (grid.head, ("---",) * len(grid.head), *grid.rows):
        yield f"| {' | '.join(_text(cell) for cell in row)} |"


def _text(text: str) -> str:
    return plain(text).replace("|", "\\|").replace("<", "&lt;")
