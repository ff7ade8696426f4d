"""A competition as a folder of pages and tables for any web server."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from msgspec import structs

from ariac_score.errors import UsageError
from ariac_score.ranking.changes import Changes, changes_between
from ariac_score.ranking.competition import RunKey
from ariac_score.ranking.publication import PUBLICATION, Publication
from ariac_score.ranking.violations import Tally, tallied
from ariac_score.report.html.page import page, shipped
from ariac_score.report.site.run_pages import RunPage, make_pages
from ariac_score.report.site.tables import Table, table_csv, table_json, tables_of
from ariac_score.report.site.view import View, clause_page, clause_views, team_view, view_of
from ariac_score.report.site.what_if import step_text
from ariac_score.report.statements import unattested
from ariac_score.review.sensitivity import RankSensitivity
from ariac_score.review.what_if import WhatIf

__all__ = ["Site", "competition_page", "write_site"]

DATA = "data"
RANKING = f"{DATA}/ranking.json"
FILES = f"{DATA}/files.json"
"""Lists the files of the site, so that the next one can remove those that are no longer part of it."""

_FOLDERS = ("trials/", "results/", "teams/", "violations/")

Write = Callable[[str, Path], None]


@dataclass(frozen=True)
class Site:
    """The contents of a site.

    Attributes:
        publication: The ranking.
        folder: The results of its runs; without it there are no pages of runs.
        previous: The publication before.
        sensitivity: How the ranks depend on each number.
        what_if: The ranking under other numbers.
    """

    publication: Publication
    folder: Path | None = None
    previous: Publication | None = None
    sensitivity: Sequence[RankSensitivity] | None = None
    what_if: WhatIf | None = None


def competition_page(
    site: Site,
    pages: Sequence[RunPage] = (),
    *,
    tables: Sequence[Table] | None = None,
) -> str:
    """The page of a competition.

    Args:
        site: Its contents.
        pages: Those of its runs.
        tables: Those that it offers for download; by default all.
    """
    if tables is None:
        tables = _tables(site, pages)
    return _index(_view(site, pages), tables)


def _index(view: View, tables: Sequence[Table]) -> str:
    return page(
        "site.html.j2",
        view=view,
        tables=tables,
        script=shipped("board.js"),
        clause_page=clause_page,
        step_text=step_text,
    )


def _view(site: Site, pages: Sequence[RunPage]) -> View:
    links: Mapping[RunKey, str] = {made.key: made.page for made in pages}
    return view_of(
        site.publication,
        links,
        _tallies(site, pages),
        site.sensitivity,
        _changes(site),
        {made.key: made.conduct for made in pages},
        site.what_if,
        unattested([made.unattested for made in pages]),
    )


def _tables(site: Site, pages: Sequence[RunPage]) -> tuple[Table, ...]:
    return tables_of(
        site.publication,
        _tallies(site, pages),
        site.sensitivity,
        _changes(site),
        {made.key: made.conduct for made in pages},
        site.what_if,
    )


def _further(view: View) -> Iterator[tuple[str, str]]:
    """The pages of teams and of clauses: path and text."""
    clauses = {clause_page(each.tally.clause): each for each in clause_views(view)}
    for path, each in clauses.items():
        yield path, page("clause.html.j2", clause=each, view=view)
    for row in view.rows:
        if row.page:
            yield row.page, page("team.html.j2", team=team_view(view, row, clauses), view=view)


def _tallies(site: Site, pages: Sequence[RunPage]) -> tuple[Tally, ...] | None:
    return tallied((made.key, made.verdicts) for made in pages) if site.folder is not None else None


def _changes(site: Site) -> Changes | None:
    return None if site.previous is None else changes_between(site.previous, site.publication)


def write_site(
    site: Site,
    out: Path,
    write: Write,
    *,
    processes: int | None = None,
    progress: Callable[[int, str], None] = lambda _done, _now: None,
) -> int:
    """Write the folder.

    Files of an earlier site that are no longer part of it are removed, and nothing else.

    Args:
        site: Its contents.
        out: The folder: new, empty, or of an earlier site.
        write: Writes a text to a file.
        processes: How many make pages of runs; by default one for each core.
        progress: Called after each page of a run.

    Returns:
        How many files there are.

    Raises:
        UsageError: The folder holds something else.
        DataFileError: A result is not the one that was ranked.
        ResultError: A result is incomplete, or of other rules.
    """
    before = _files_of(out)
    (out / DATA).mkdir(parents=True, exist_ok=True)
    pages: list[RunPage] = []
    written = [FILES]
    if site.folder is not None:
        pages = make_pages(site.publication, site.folder, out, write, processes=processes, progress=progress)
        written += [made.page for made in pages]
        written += [f"results/{site.publication.results[made.key].file}" for made in pages]
    tables, view = _tables(site, pages), _view(site, pages)
    texts = {f"{DATA}/{table.name}.csv": table_csv(table) for table in tables}
    texts |= {f"{DATA}/{table.name}.json": table_json(table) for table in tables if table.in_json}
    texts[RANKING] = _pointing_here(site.publication, pages=bool(pages))
    texts["index.html"] = _index(view, tables)
    texts |= _further(view)
    written += texts
    # First the list of old and new files: if writing breaks off, the next site still knows which are ours.
    write(_listed(sorted({*before, *written})), out / FILES)
    for folder in {(out / name).parent for name in texts}:
        folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        write(text, out / name)
    for stale in sorted(before - set(written)):
        (out / stale).unlink(missing_ok=True)
    write(_listed(sorted(written)), out / FILES)
    return len(written)


def _listed(names: Sequence[str]) -> str:
    return json.dumps({"files": list(names)}, indent=1, ensure_ascii=False) + "\n"


def _files_of(out: Path) -> set[str]:
    """The files of an earlier site in the folder.

    Raises:
        UsageError: The folder holds something, but no site.
    """
    if not out.exists():
        return set()
    if not out.is_dir():
        raise UsageError("is no folder", file=out, hint="name a folder for the site")
    try:
        names = json.loads((out / FILES).read_text(encoding="utf-8"))["files"]
        return {name for name in names if _is_ours(out, str(name))}
    except (OSError, ValueError, KeyError, TypeError):
        if any(not entry.name.startswith(".") for entry in out.iterdir()):
            raise UsageError(
                "the folder holds something that is no site of a competition",
                file=out,
                hint="name a new folder, or an empty one",
            ) from None
        return set()


def _is_ours(out: Path, name: str) -> bool:
    """Whether a site could have written a listed file."""
    # The list may have been edited, and what is listed may be deleted: it must lie in this folder.
    known = name == "index.html" or name.startswith((f"{DATA}/", *_FOLDERS))
    return known and ".." not in name.split("/") and (out / name).resolve().is_relative_to(out.resolve())


def _pointing_here(publication: Publication, *, pages: bool) -> str:
    """The ranking with the path of its results in the site."""
    runs = publication.runs if pages else tuple(structs.replace(r, result=None) for r in publication.runs)
    return PUBLICATION.text(replace(publication, folder="../results" if pages else "", runs=runs))
