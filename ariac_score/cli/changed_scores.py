"""Whose score and rank two rule sets change: of stored results, or of logs that are scored under both."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ariac_score.checks.registry import Registry
from ariac_score.cli.notes import counted
from ariac_score.cli.stored import is_log
from ariac_score.engine.measure import stored_name
from ariac_score.engine.price import reprice
from ariac_score.engine.score import score_trial
from ariac_score.errors import ScoreError, UsageError
from ariac_score.ranking.competition import Competition, load_competition, stored_results
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import ranking_spec
from ariac_score.report.ranking import changes_text
from ariac_score.report.text import amount_text
from ariac_score.results.result import Result
from ariac_score.results.result_file import load_result
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.terminal.output import counting_bar
from ariac_score.terminal.style import plain

__all__ = ["changed_by_logs", "changed_by_results"]

Pair = tuple[RuleSet, RuleSet]
REMEDY = "score them under both: --logs PATH instead of --results"


def changed_by_results(path: Path, rules: Pair) -> Iterator[str]:
    """What changes of a stored result or a folder of them; where a log would be needed again, what for.

    Raises:
        UsageError: There is no result.
    """
    files = sorted(path.glob("*.json")) if path.is_dir() else [path] if path.is_file() else []
    competition = stored_results(path) if path.is_dir() else None
    if competition is not None and competition.runs:
        lacks = [_lacks(load_result(run.path), rules) for run in competition.runs]
        if not any(lacks):
            yield from _changed_ranks(competition, rules)
            return
        runs = f"{sum(map(bool, lacks))} of {counted(len(lacks), 'run')} would have to be measured again"
        yield f"{runs}: {'; '.join(sorted({each for lack in lacks for each in lack}))}"
        yield REMEDY
        return
    if not files:
        raise UsageError(
            "there is no stored result here",
            file=path,
            hint="give a result that 'score -o FILE.json' wrote, or a folder of them from 'rank --results'",
        )
    needed = False
    for file in files:
        try:
            result = load_result(file)
            lacks_here = _lacks(result, rules)
            needed |= bool(lacks_here)
            if lacks_here:
                yield f"{plain(file.name)}: needs its log: {'; '.join(lacks_here)}"
            else:
                yield _change(file.name, *(reprice(result, rule_set) for rule_set in rules))
        except ScoreError as error:
            yield f"{plain(file.name)}: cannot be priced: {plain(error.cause)}"
    if needed:
        yield REMEDY


def _lacks(result: Result, rules: Pair) -> list[str]:
    """The checks that a result does not have as the rule sets want them."""
    names = {stored["use"] for stored in result.checks.values()}
    lacks = []
    for rule_set in rules:
        for check in rule_set.checks.values():
            if stored_name(result, check) is None:
                why = "other parameters" if check.use in names else "not among its checks"
                lacks.append(f"{check.name} of {rule_set.id} ({why})")
    return lacks


def changed_by_logs(path: Path, rules: Pair) -> Iterator[str]:
    """What changes of a competition, of one log, or of every log in a folder.

    Raises:
        UsageError: There is no log.
    """
    if path.is_file() and path.suffix in (".yaml", ".yml") and path.name != "bundle.yaml":
        yield from _changed_ranks(load_competition(path, rules[0].file), rules)
        return
    if path.is_dir() and ((path / "competition.yaml").is_file() or (path / "logs").is_dir()):
        yield from _changed_ranks(load_competition(path, rules[0].file), rules)
        return
    within = sorted(each for each in path.iterdir() if is_log(each)) if path.is_dir() else []
    logs = [path] if not within or is_log(path) else within
    with counting_bar("scoring", 2 * len(logs)) as step:
        for number, log in enumerate(logs):
            step(2 * number, log.name)
            try:
                results = [score_trial(log, rule_set, registry=Registry()) for rule_set in rules]
            except ScoreError as error:
                if len(logs) == 1:
                    raise
                yield f"{plain(log.name)}: cannot be scored: {plain(error.cause)}"
                continue
            yield _change(log.name, *results)


def _change(name: str, before: Result, after: Result) -> str:
    first, second = ("no score" if r.score is None else amount_text(r.score) for r in (before, after))
    return f"{plain(name)}: {first}" + (f" -> {second}" if first != second else " (unchanged)")


def _changed_ranks(competition: Competition, rules: Pair) -> Iterator[str]:
    """The runs and teams of a competition under both rule sets."""
    before, after = (
        rank_results(
            competition,
            ranking_spec(each, competition.ranking, file=str(competition.file)),
            each,
            score_runs(competition, each),
        )
        for each in rules
    )
    yield from changes_text(before, after)
