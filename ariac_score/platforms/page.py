"""The page that a participant sees: that of a trial, and above it the outcome of the submission."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ariac_score.platforms.neutral import COLUMNS
from ariac_score.platforms.submission import Scored
from ariac_score.report.html.page import page, part
from ariac_score.report.html.trial import SCRIPT, trial_page
from ariac_score.report.text import score_text
from ariac_score.report.words import which_run
from ariac_score.results.result import Result
from ariac_score.results.result_file import as_json

__all__ = ["progress_page", "result_page"]

_LONGEST = 400_000
"""Characters of one run's explanation; a page has to stay small."""
_LARGEST = 2_500_000
"""Characters of all pages of runs together; further runs are explained as text."""


def progress_page(lines: Sequence[str]) -> str:
    """The lines about the runs that are scored so far."""
    runs = f"{len(lines)} run{'' if len(lines) == 1 else 's'} so far"
    return page("submission.html.j2", heading=f"Scoring: {runs}", outcome="", lines=lines)


def result_page(scored: Scored) -> str:
    """The outcome, the numbers of the leaderboard, each run; those that count with the page of a trial."""
    export = scored.export
    runs = list(_runs(scored))
    counting = [run for run in runs if run["result"] is not None and run["counts"]]
    if len(counting) == 1:
        result: Result = counting[0]["result"]
        beside = [run for run in runs if run is not counting[0]]
        return trial_page(result, as_json(result), above=_outcome(scored, beside), run=counting[0]["which"])
    room = _LARGEST
    for run in counting:
        text = trial_page(run["result"], as_json(run["result"]), run=run["which"])
        if len(text) <= room:
            run["page"], run["open"] = text, room == _LARGEST
            room -= len(text)
    heading = f"{export.phase}: {export.status.replace('_', ' ')}"
    # A document inside takes over the policy of the one around it, which therefore allows its script.
    return page(
        "submission.html.j2", heading=heading, outcome=_outcome(scored, runs), lines=(), allowed=SCRIPT
    )


def _outcome(scored: Scored, runs: Sequence[Mapping[str, Any]]) -> Any:
    export = scored.export
    numbers = export.metrics.by_column()
    columns = [
        {"title": column.title, "value": f"{numbers[column.key]:.10g}", "meaning": column.meaning}
        for column in COLUMNS
    ]
    return part(
        "outcome.html.j2",
        status=export.status.replace("_", " ").capitalize(),
        message=export.message,
        columns=columns,
        runs=runs,
        sha256=export.result_sha256,
    )


def _runs(scored: Scored) -> Iterator[dict[str, Any]]:
    every = scored.ranking.runs if scored.ranking else ()
    for run in every:
        result = scored.results.get((run.trial, run.number))
        text = run.reason if result is None else score_text(result)
        if len(text) > _LONGEST:
            text = f"{text[:_LONGEST]}\n… shortened; the stored result has everything"
        counts = "counts" if run.kept else run.outcome.replace("_", " ")
        title = f"{run.trial}, run {run.number}: {counts}"
        yield {
            "title": title,
            "text": text,
            "page": "",
            "open": False,
            "counts": run.kept,
            "result": result,
            "which": which_run(run.number, [one.number for one in every if one.trial == run.trial]),
        }
