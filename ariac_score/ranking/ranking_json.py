"""A ranking as canonical JSON: every number that entered it, by team, trial and run."""

from __future__ import annotations

import json
from collections.abc import Mapping
from decimal import Decimal
from typing import Any

from ariac_score.cohort import cohort_text
from ariac_score.ranking.compare import Difference
from ariac_score.ranking.nist_text import Evaluation
from ariac_score.ranking.rank import Cell, Ranking, RunOutcome, Standing, Stewarded
from ariac_score.result_json import adjustment_data

__all__ = ["ranking_json"]

SCHEMA = "ariac-score/ranking/1"


def ranking_json(
    ranking: Ranking, strict: Evaluation | None = None, differences: tuple[Difference, ...] = ()
) -> str:
    """A ranking as its canonical text, with a newline at its end.

    Args:
        ranking: The ranking.
        strict: The organisers' own evaluation beside it, where it was reproduced.
        differences: Between both.
    """
    data = {
        "schema": SCHEMA,
        "competition": ranking.competition,
        "title": ranking.title,
        "rule_set": {"id": ranking.rule_set[0], "sha256": ranking.rule_set[1]},
        "trials": list(ranking.trials),
        "standings": [_standing(standing) for standing in ranking.standings],
        "runs": [_run(run) for run in ranking.runs],
        "cohort": None if ranking.cohort is None else json.loads(cohort_text(ranking.cohort)),
        "strangers": list(ranking.strangers),
        "strict": None if strict is None else _strict(strict, differences),
    }
    if ranking.stewarded is not None:
        data["adjusted"] = _stewarded(ranking.stewarded)
    text = json.dumps(data, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False)
    # Half a surrogate pair, which a file name may hold, has no place in UTF-8 but has one in JSON.
    return text.encode("utf-8", "backslashreplace").decode("utf-8") + "\n"


def _stewarded(stewarded: Stewarded) -> dict[str, Any]:
    """What the stewards made of it: what remains when this key is taken away is the automatic ranking."""
    return {
        "sha256": stewarded.sha256,
        "adjustments": [adjustment_data(decision) for decision in stewarded.adjustments],
        "standings": [_standing(standing) for standing in stewarded.ranking.standings],
        "runs": [_run(run) for run in stewarded.ranking.runs],
    }


def _amount(value: Decimal | None) -> float | None:
    return None if value is None else float(value)


def _standing(standing: Standing) -> dict[str, Any]:
    return {
        "rank": standing.rank,
        "team": standing.team,
        "name": standing.name,
        "value": standing.value,
        "execution": _amount(standing.execution),
        "judges": _amount(standing.judges),
        "ties": dict(standing.ties),
        "trials": {trial: _cell(cell) for trial, cell in standing.cells.items()},
        "remarks": list(standing.remarks),
    }


def _cell(cell: Cell) -> dict[str, Any]:
    return {
        "score": _amount(cell.score),
        "outcome": cell.outcome,
        "reason": cell.reason,
        "runs": list(cell.runs),
        "made": cell.made,
    }


def _run(run: RunOutcome) -> dict[str, Any]:
    inputs = run.result.provenance.inputs if run.result else ()
    return {
        "team": run.team,
        "trial": run.trial,
        "run": run.number,
        "outcome": run.outcome,
        "reason": run.reason,
        "task": _amount(run.task),
        "score": _amount(run.score),
        "kept": run.kept,
        "terms": dict(run.terms),
        "inputs": [{"role": s.role, "name": s.name, "sha256": s.sha256} for s in inputs],
    }


def _strict(strict: Evaluation, differences: tuple[Difference, ...]) -> dict[str, Any]:
    trials: Mapping[str, Any] = {
        trial: {
            team: {
                "run": entry.run,
                "raw": entry.raw,
                "cost": entry.cost,
                "scores": dict(entry.scores),
                "durations_s": dict(entry.durations_s),
                "score": entry.score,
                "remarks": list(entry.remarks),
            }
            for team, entry in entries.items()
        }
        for trial, entries in strict.trials.items()
    }
    return {
        "leaderboard": [{"team": team, "score": score} for team, score in strict.leaderboard],
        "trials": trials,
        "stops": [
            {"trial": s.trial, "team": s.team, "run": s.run, "exception": s.exception, "cause": s.cause}
            for s in strict.stops
        ],
        "differences": [
            {"team": d.team, "what": d.what, "strict": d.strict, "robust": d.robust, "because": d.because}
            for d in differences
        ],
    }
