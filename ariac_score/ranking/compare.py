"""Where the organisers' own evaluation and this ranking differ, and why."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ariac_score.ranking.evaluation import Evaluation
from ariac_score.ranking.outcomes import Ranking

__all__ = ["RankingDifference", "differences"]

RELATIVE = 1e-9
ABSOLUTE = 1.1e-6
"""One unit of the sixth decimal, to which scores are rounded by default, with room for its float."""


@dataclass(frozen=True)
class RankingDifference:
    """One number that differs between the organisers' evaluation and this ranking.

    Attributes:
        team: Team.
        what: A trial, `sum` or `rank`.
        strict: By the organisers' program; `None` when it has none.
        robust: By this ranking; `None` when it has none.
        because: Why, in words.
    """

    team: str
    what: str
    strict: float | None
    robust: float | None
    because: str


def differences(strict: Evaluation, ranking: Ranking) -> tuple[RankingDifference, ...]:
    """Every trial score, sum and rank that differs, in the order of the ranking.

    Numbers are equal within 1e-9 of themselves, or within the rounding of a score.
    """
    sums = dict(strict.leaderboard)
    places = {team: _place(strict, team) for team in sums}
    found = []
    for standing in ranking.standings:
        team = standing.team
        for trial, cell in standing.trials.items():
            entry = strict.trials.get(trial, {}).get(team)
            theirs = None if entry is None else float(entry.score)
            if not _same(theirs, float(cell.score)):
                found.append(
                    RankingDifference(
                        team, trial, theirs, float(cell.score), _why(strict, ranking, team, trial)
                    )
                )
        if not _same(sums.get(team), float(standing.execution)):
            found.append(
                RankingDifference(team, "sum", sums.get(team), float(standing.execution), "its trials differ")
            )
        if places.get(team) != standing.rank:
            ours = None if standing.rank is None else float(standing.rank)
            theirs = places.get(team)
            found.append(
                RankingDifference(
                    team, "rank", None if theirs is None else float(theirs), ours, "sums differ"
                )
            )
    return tuple(found)


def _same(first: float | None, second: float | None) -> bool:
    if first is None or second is None:
        return first is second
    return math.isclose(first, second, rel_tol=RELATIVE, abs_tol=ABSOLUTE)


def _place(strict: Evaluation, team: str) -> int:
    scores = dict(strict.leaderboard)
    return 1 + sum(1 for score in scores.values() if score > scores[team])


def _why(strict: Evaluation, ranking: Ranking, team: str, trial: str) -> str:
    stops = [s for s in strict.stops if s.trial == trial]
    own = [f"{s.exception} at {s.run or team}: {s.cause}" for s in stops if s.team == team]
    entry = strict.trials.get(trial, {}).get(team)
    own += list(entry.remarks) if entry else []
    cell = next(s.trials[trial] for s in ranking.standings if s.team == team)
    if cell.outcome != "scored":
        own.append(f"here {cell.outcome}: {cell.reason}")
    if own:
        return "; ".join(own)
    if stops:
        return f"the means over all teams differ, because of {', '.join(sorted({s.team for s in stops}))}"
    return "the means over all teams differ"
