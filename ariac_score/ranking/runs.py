"""Scoring every run of a competition; what cannot be scored is an outcome, never a stop."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from ariac_score.checks.contracts import Wanted
from ariac_score.checks.registry import Registry
from ariac_score.engine.price import reprice
from ariac_score.engine.score import score_trial
from ariac_score.errors import LogError, ResultError, ScoreError
from ariac_score.ranking.competition import Competition, Run, RunKey
from ariac_score.results.result import Result
from ariac_score.results.result_file import load_result
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.channels import LogMap
from ariac_score_ariac.config.ariac_config import TrialConfigReader
from ariac_score_ariac.evaluation.nist_text import Evaluation, OrderPlan, RunTexts, evaluate

__all__ = ["score_runs", "strict_evaluation", "without_sketch"]

MAX_TEXT_BYTES = 4_000_000
"""An official text is a few kilobytes."""

Progress = Callable[[int, Run], None]


def _silent(_done: int, _run: Run) -> None:
    """Show nothing."""


def score_runs(
    competition: Competition,
    rule_set: RuleSet,
    *,
    registry: Registry | None = None,
    progress: Progress = _silent,
    sketches: bool = False,
) -> dict[RunKey, Result | ScoreError]:
    """Each run's result, or why there is none.

    A run that is a stored result is priced again, without its log.

    Args:
        competition: Its runs and configurations.
        rule_set: By which they are scored.
        registry: The installed plugins.
        progress: Called before each run with how many are done.
        sketches: Keep what pages draw; of a season that is most of the memory, and nothing is
            priced by it.

    Raises:
        ResultError: Stored results were made under different rule sets: what one of them
            looked at, another may not have.
    """
    registry = registry or Registry()
    configs = {("team", team.id): team.config for team in competition.teams} | {
        ("trial", trial.id): trial.config for trial in competition.trials
    }
    results: dict[RunKey, Result | ScoreError] = {}
    made_under: dict[tuple[str, str], Run] = {}
    for done, run in enumerate(competition.runs):
        progress(done, run)
        also = [c for c in (configs.get(("trial", run.trial)), configs.get(("team", run.team))) if c]
        try:
            if _is_stored(run):
                stored = _stored(run)
                made_under.setdefault(stored.provenance.rule_set, run)
                result = reprice(stored, rule_set)
            else:
                made_under.setdefault((rule_set.id, rule_set.sha256), run)
                result = score_trial(
                    run.path,
                    rule_set,
                    registry=registry,
                    also=also,
                    root=competition.root,
                    trial_id=run.trial,
                    team=run.team,
                )
            results[run.key] = result if sketches else without_sketch(result)
        except ScoreError as error:
            results[run.key] = _within(error, competition.root)
        _refuse_different_rules(made_under)
    return results


def _within(error: ScoreError, root: Path) -> ScoreError:
    """The error with its file named from the competition's folder: the same bytes wherever that lies."""
    file = Path(error.file) if error.file else None
    if file is not None and file.is_relative_to(root):
        error.file = file.relative_to(root).as_posix()
    return error


def without_sketch(result: Result) -> Result:
    """A result without what pages draw."""
    return replace(result, measured=replace(result.measured, sketch=None))


def _is_stored(run: Run) -> bool:
    return run.path.suffix == ".json" and run.path.is_file()


def _stored(run: Run) -> Result:
    stored = load_result(run.path)
    if stored.adjusted is not None:
        raise ResultError(
            "it is adjusted by stewards already",
            file=run.path,
            hint="rank the automatic results, and give the decisions with --adjustments",
        )
    if stored.measured.trial != run.trial or stored.measured.team not in ("", run.team):
        raise ResultError(
            f"it is of {stored.measured.team or 'no team'}, trial {stored.measured.trial}",
            file=run.path,
            hint="name stored results as the runs they are of",
        )
    return stored


def _refuse_different_rules(made_under: Mapping[tuple[str, str], Run]) -> None:
    """Results of different rule sets are never ranked together."""
    if len(made_under) < 2:
        return
    (first, run), (other, stranger) = list(made_under.items())[:2]
    raise ResultError(
        f"it was made under {_rules_told(other)}, and {run.path.name} of {run.team} "
        f"under {_rules_told(first)}",
        file=stranger.path,
        hint="results of different rule sets are not ranked together: score all runs under one",
    )


def _rules_told(rules: tuple[str, str]) -> str:
    return f"{rules[0]} (SHA-256 {rules[1][:12]}…)"


def strict_evaluation(competition: Competition, log_map: LogMap) -> Evaluation:
    """The organisers' own evaluation of 2023 and 2024, from the official texts of the runs.

    Args:
        competition: Its runs and trial configurations.
        log_map: That of the rule set.

    Raises:
        LogError: The runs are no folders with official texts, or a trial has no configuration.
    """
    orders: dict[str, list[OrderPlan]] = {}
    for trial in competition.trials:
        if trial.config is None:
            raise LogError(
                f"trial {trial.id!r} has no configuration, which the organisers' program reads orders from",
                file=competition.file,
                hint="add trials/<trial>.yaml, or 'config:' to the trial",
            )
        planned = TrialConfigReader().read(trial.config, Wanted(log_map)).orders
        orders[trial.id] = [OrderPlan(order.id, order.priority > 1) for order in planned]
    if competition.logs is None:
        raise LogError(
            "the runs do not lie as <team>/<trial>_<n>, which is what the organisers' program reads",
            file=competition.file,
            hint="rank with --policy robust",
        )
    teams = {team.name: [_texts(run) for run in _folders(team)] for team in _folders(competition.logs)}
    # The program takes trials from the folders; of one without a configuration it knows no order.
    found = {run.trial for runs in teams.values() for run in runs}
    return evaluate(teams, {trial: orders.get(trial, []) for trial in found})


def _folders(folder: Path) -> list[Path]:
    return sorted(entry for entry in folder.iterdir() if entry.is_dir())


def _texts(folder: Path) -> RunTexts:
    return RunTexts(folder.name, _text(folder / "trial_log.txt"), _text(folder / "sensor_cost.txt"))


def _text(file: Path) -> str | None:
    try:
        if file.stat().st_size > MAX_TEXT_BYTES:
            return None
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None
