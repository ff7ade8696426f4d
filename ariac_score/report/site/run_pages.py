"""The pages of single runs, made in parallel."""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

from ariac_score.ranking.competition import RunKey
from ariac_score.ranking.outcomes import RunOutcome
from ariac_score.ranking.publication import Publication, StoredResult
from ariac_score.ranking.stored import read_stored
from ariac_score.ranking.violations import Clause, verdicts_of
from ariac_score.report.html.trial import trial_page
from ariac_score.report.html.wording import file_name
from ariac_score.report.statements import is_unattested
from ariac_score.report.words import which_run
from ariac_score.results.adjustments import apply
from ariac_score.results.result import Pinned, Result
from ariac_score.results.result_file import as_json, measured_sha256
from ariac_score.review.conduct import RunConduct, conduct_of_run
from ariac_score.scoring.ruleset import rule_set_from_text
from ariac_score.scoring.steward import Adjustment, with_verdicts

__all__ = ["RunPage", "make_pages", "page_name"]

HOME = "../../index.html"
"""The page of the competition, relative to that of a run."""
_FEW = 24
"""Fewer pages than these take less time than processes take to start."""
_MOST_PROCESSES = 8
_PAGES_AT_A_TIME = 8

Write = Callable[[str, Path], None]


@dataclass(frozen=True)
class RunPage:
    """The page of one run.

    Attributes:
        key: Of the run.
        page: Its path in the site.
        verdicts: How many findings of each verdict it has, by clause.
        conduct: How it went.
        unattested: Whether nobody attests its logs as complete, and its rules do not say whether that counts.
    """

    key: RunKey
    page: str
    verdicts: Mapping[Clause, Mapping[str, int]]
    conduct: RunConduct
    unattested: bool


@dataclass(frozen=True)
class _Task:
    run: RunOutcome
    stored: StoredResult
    folder: Path
    rule_set: Pinned
    decisions: tuple[Adjustment, ...]
    decided_in: str
    out: Path
    write: Write
    which: str
    """Which run of its trial it is, in words."""


def page_name(key: RunKey) -> str:
    """The path of the page of a run in the site; no name of a team or trial leads out of it."""
    team, trial, number = key
    return f"trials/{file_name(team)}/{file_name(trial)}-{number}.html"


def make_pages(
    publication: Publication,
    folder: Path,
    out: Path,
    write: Write,
    *,
    processes: int | None = None,
    progress: Callable[[int, str], None] = lambda _done, _now: None,
) -> list[RunPage]:
    """Make the page of every run that has a result, and copy the result into the site.

    Args:
        publication: The ranking.
        folder: Of its results.
        out: Of the site.
        write: Writes a text to a file; sent to other processes.
        processes: How many; by default one for each core.
        progress: Called after each page with how many are done.

    Raises:
        DataFileError: A result is not the one that was ranked.
        ResultError: A result is incomplete, or of other rules.
    """
    runs = {run.key: run for run in publication.ranking.runs}
    numbers: dict[tuple[str, str], list[int]] = defaultdict(list)
    for team, trial, number in runs:
        numbers[team, trial].append(number)
    rules = publication.ranking.rule_set
    stewarded = publication.ranking.stewarded
    decisions = stewarded.adjustments if stewarded else ()
    decided_in = stewarded.sha256 if stewarded else ""
    tasks = [
        _Task(
            runs[key],
            stored,
            folder,
            rules,
            tuple(decision for decision in decisions if decision.trial == key[1]),
            decided_in,
            out,
            write,
            which_run(key[2], numbers[key[:2]]),
        )
        for key, stored in publication.results.items()
    ]
    # Made before the processes start: two of them that make the same folder at once could fail.
    for parent in sorted({(out / page_name(task.run.key)).parent for task in tasks}):
        parent.mkdir(parents=True, exist_ok=True)
    for parent in sorted({(out / "results" / task.stored.file).parent for task in tasks}):
        parent.mkdir(parents=True, exist_ok=True)
    found = []
    for page in _made(tasks, processes):
        found.append(page)
        progress(len(found), "/".join(map(str, page.key)))
    return found


def _made(tasks: Sequence[_Task], processes: int | None) -> Iterator[RunPage]:
    count = min(processes or _cores(), _MOST_PROCESSES)
    if count < 2 or len(tasks) < _FEW:
        yield from map(_make, tasks)
        return
    # Not forked: the progress bar has a thread of its own, and its locks would be copied held.
    with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
        yield from pool.map(_make, tasks, chunksize=_PAGES_AT_A_TIME)


def _cores() -> int:
    try:
        return len(os.sched_getaffinity(0))  # in a container fewer than the machine has
    except AttributeError:  # not on every system
        return os.cpu_count() or 1


def _make(task: _Task) -> RunPage:
    result, text = read_stored(task.stored, task.folder, task.run, task.rule_set)
    page = page_name(task.run.key)
    shown = _adjusted(result, task)
    stored = text if shown is result else as_json(shown)
    task.write(trial_page(shown, stored, HOME, run=task.which), task.out / page)
    copy = task.out / "results" / task.stored.file
    # A site may be made in the folder that holds the results.
    if copy.resolve() != (task.folder / task.stored.file).resolve():
        task.write(text, copy)
    uses = {name: str(check["use"]) for name, check in result.checks.items()}
    findings = with_verdicts(result.measured.findings, shown.adjusted.adjustments) if shown.adjusted else {}
    measured = replace(result.measured, findings=findings or result.measured.findings)
    return RunPage(
        task.run.key, page, verdicts_of(measured, uses), conduct_of_run(shown), is_unattested(result)
    )


def _adjusted(result: Result, task: _Task) -> Result:
    """The result with the decisions of stewards about it; unchanged where there are none."""
    if not task.decisions:
        return result
    measured = measured_sha256(result)
    team, trial, number = task.run.key
    own = [
        decision
        for decision in task.decisions
        if decision.measured == measured
        and (decision.team, decision.trial) in ((team, trial), ("", trial))
        and decision.run in (None, number)
    ]
    if not own:
        return result
    # By the rules inside the result: those installed may be newer.
    rule_set = rule_set_from_text(result.rules, file="the rules in the result")
    return replace(result, adjusted=apply(result, own, rule_set, sha256=task.decided_in))
