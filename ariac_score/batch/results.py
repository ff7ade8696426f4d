"""The results of a batch, for those who rank it."""

from __future__ import annotations

from pathlib import Path

from ariac_score.batch.description import load_description
from ariac_score.batch.index import RUNS, Row, read_rows
from ariac_score.errors import FormulaError, LogError, RunEndedError, ScoreError, UsageError
from ariac_score.ranking.competition import Competition, RunKey
from ariac_score.ranking.runs import without_sketch
from ariac_score.results.result import Pinned, Result
from ariac_score.results.result_file import load_result
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["results_of_batch"]


def results_of_batch(
    folder: Path, competition: Competition, rule_set: RuleSet, *, sketches: bool = False
) -> dict[RunKey, Result | ScoreError]:
    """Each run's stored result, or why there is none.

    Args:
        folder: Of the batch.
        competition: Whose runs they are.
        rule_set: By which it is ranked; the batch must have been scored by it.
        sketches: Keep what pages draw; of a season that is most of the memory.

    Raises:
        UsageError: The folder holds no finished batch of this competition under these rules.
    """
    again = f"ariac-score batch {competition.file} -o {folder}"
    scored_under = load_description(folder, hint=again).rule_set
    if scored_under != Pinned(rule_set.id, rule_set.sha256):
        raise UsageError(
            f"it was scored under {scored_under.id} ({scored_under.sha256[:12]}…), not under {rule_set.id} "
            f"({rule_set.sha256[:12]}…)",
            file=folder,
            hint=f"put the new prices on it first: {again}",
        )
    rows = {row.key: row for row, _ in read_rows(folder / RUNS)}
    missing = [run.key for run in competition.runs if run.key not in rows]
    if missing:
        named = ", ".join("/".join(map(str, key)) for key in missing[:3])
        runs = "run is" if len(missing) == 1 else "runs are"
        raise UsageError(f"{len(missing)} {runs} not in it: {named}", file=folder, hint=again)
    return {run.key: _result(rows[run.key], folder, sketches=sketches) for run in competition.runs}


def _result(row: Row, folder: Path, *, sketches: bool) -> Result | ScoreError:
    summary = row.summary
    if row.object:
        try:
            result = load_result(folder / row.object)
            return result if sketches else without_sketch(result)
        except ScoreError:
            if not summary.reason:
                raise
    if summary.outcome in ("crashed", "cancelled"):
        return RunEndedError(summary.reason, outcome=summary.outcome)
    if summary.outcome == "no_value":
        return FormulaError(summary.reason)
    return LogError(f"{summary.outcome.replace('_', ' ')}: {summary.reason}")
