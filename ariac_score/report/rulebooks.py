"""`python -m ariac_score.report.rulebooks FOLDER`: write the rulebook of every rule set of a distribution."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from ariac_score.checks.registry import Registry
from ariac_score.report.rulebook import rulebook_markdown
from ariac_score.review.rulebook.book import rulebook
from ariac_score.scoring.extending import GROUP

__all__ = ["names_of", "rulebooks", "write_rulebooks"]


def names_of(distribution: str) -> list[str]:
    """The rule sets that a distribution brings."""
    return [f.name for f in Registry().files(GROUP) if f.plugin.distribution == distribution]


def rulebooks(distribution: str) -> Iterator[tuple[str, str]]:
    """Name and text of each page, and of their index."""
    registry = Registry()
    index = ["# Rulebooks", "", f"One for each rule set that `{distribution}` brings.", ""]
    for name in names_of(distribution):
        book = rulebook(name, registry)
        index.append(f"- [{book.title}]({name}.md): `{name}`")
        yield f"{name}.md", rulebook_markdown(book)
    yield "README.md", "\n".join(index) + "\n"


def write_rulebooks(folder: Path, distribution: str = "ariac-score") -> None:
    """Write the pages into a folder, and remove those of rule sets that no longer exist."""
    folder.mkdir(parents=True, exist_ok=True)
    written = dict(rulebooks(distribution))
    for name, text in written.items():
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    for page in folder.glob("*.md"):
        if page.name not in written:
            page.unlink()


def main() -> None:
    """Write the pages."""
    parser = argparse.ArgumentParser(prog="python -m ariac_score.report.rulebooks", description=__doc__)
    parser.add_argument(
        "folder", type=Path, help="where the pages are written; pages of sets that are gone are removed"
    )
    parser.add_argument("--distribution", default="ariac-score", help="whose rule sets")
    arguments = parser.parse_args()
    write_rulebooks(arguments.folder, arguments.distribution)


if __name__ == "__main__":
    main()
