"""The page that a participant sees: one file, no script, no network, all text of strangers escaped."""

from __future__ import annotations

import html
from collections.abc import Sequence

from ariac_score.platforms.neutral import COLUMNS
from ariac_score.platforms.submission import Scored
from ariac_score.report.text import score_text

__all__ = ["progress_page", "result_page"]

_LONGEST = 400_000
"""Characters of one run's explanation; a page has to stay small."""
_POLICY = "default-src 'none'; style-src 'unsafe-inline'"
_STYLE = """
:root { color-scheme: light dark; }
body { font: 16px/1.5 system-ui, sans-serif; max-width: 60rem; margin: 2rem auto; padding: 0 1rem; }
table { border-collapse: collapse; } th, td { padding: .25rem .75rem; text-align: left; }
td.number { text-align: right; font-variant-numeric: tabular-nums; }
pre { overflow-x: auto; white-space: pre-wrap; unicode-bidi: plaintext; }
summary { cursor: pointer; }
"""


def _page(title: str, body: str) -> str:
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>{body}</body></html>\n"
    )


def progress_page(lines: Sequence[str]) -> str:
    """The lines about the runs that are scored so far."""
    items = "".join(f"<li>{html.escape(line)}</li>" for line in lines)
    runs = f"{len(lines)} run{'' if len(lines) == 1 else 's'}"
    return _page("Scoring", f"<h1>Scoring</h1><p>{runs} so far.</p><ul>{items}</ul>")


def result_page(scored: Scored) -> str:
    """The outcome, the numbers of the leaderboard, and each run explained."""
    export = scored.export
    numbers = export.metrics.by_column()
    rows = "".join(
        f"<tr><th scope=row>{html.escape(column.title)}</th>"
        f"<td class=number>{html.escape(f'{numbers[column.key]:.10g}')}</td>"
        f"<td>{html.escape(column.meaning)}</td></tr>"
        for column in COLUMNS
    )
    parts = [
        f"<h1>{html.escape(export.status.replace('_', ' ').capitalize())}</h1>",
        f"<p>{html.escape(export.message)}</p><table>{rows}</table>",
    ]
    for run in scored.ranking.runs if scored.ranking else ():
        result = scored.results.get((run.trial, run.number))
        text = run.reason if result is None else score_text(result)
        counts = "counts" if run.kept else run.outcome.replace("_", " ")
        title = f"{run.trial}, run {run.number}: {counts}"
        if len(text) > _LONGEST:
            text = f"{text[:_LONGEST]}\n… shortened; the stored result has everything"
        parts.append(
            f"<details{' open' if run.kept else ''}><summary>{html.escape(title)}</summary>"
            f"<pre>{html.escape(text)}</pre></details>"
        )
    if export.result_sha256:
        parts.append(f"<p>The stored results have the SHA-256 <code>{export.result_sha256}</code>.</p>")
    return _page(f"{export.phase}: {export.status}", "".join(parts))
