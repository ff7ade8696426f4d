"""What choosing the best of several runs does: a ranking beside that of single runs, and like with like.

The best of five runs is another quantity than the best of one, and more of it is luck: of two teams of equal
means the one whose runs differ more has the better best. So where runs are chosen, the score of each team
stands beside what a single run of it earns in the mean, and beside what it would have with as many runs as
the team that made fewest. Nothing is assumed of the spreads of teams, and nothing is said of more runs than
were made.

Source: the mean of the best over all ways of choosing some runs from those there are, an unbiased estimate
of the expected best of so many (Hoeffding, A Class of Statistics with Asymptotically Normal Distribution,
Annals of Mathematical Statistics 19, 1948).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from fractions import Fraction

from ariac_score.ranking.beside import merit
from ariac_score.ranking.claims import ends_of
from ariac_score.ranking.exact import expected_kept
from ariac_score.ranking.open_scores import MONOTONE_TOTALS, Ends
from ariac_score.ranking.outcomes import Ranking, RunOutcome, TeamRank
from ariac_score.ranking.rank import cell_digits
from ariac_score.ranking.spec import Spec

__all__ = ["WHAT_CHOOSING_DOES", "Selection", "selections"]

WHAT_CHOOSING_DOES = (
    "in the mean over all ways of choosing from the runs that were made; choosing rewards luck: of two teams "
    "with equal means the one whose runs differ more has the better best"
)


@dataclass(frozen=True)
class Selection:
    """The execution of a team, and what it would be without the choice of its best runs, in points.

    Attributes:
        team: Id.
        published: As it is ranked.
        alike: With as many runs of each trial as the team that made fewest there, the mean over all ways of
            choosing them; between which ends, where scores are open.
        single: With one run of each trial, likewise: the mean of its runs.
        alike_rank: The place by that, of its low end; teams that are equal share the best.
        single_rank: Likewise.
    """

    team: str
    published: Decimal
    alike: Ends
    single: Ends
    alike_rank: int
    single_rank: int


def selections(ranking: Ranking, spec: Spec, digits: int) -> tuple[Selection, ...]:
    """What choosing runs does to each ranked team; nothing where all runs count.

    Args:
        ranking: The ranking.
        spec: How its runs became it.
        digits: Decimal digits of a score.
    """
    standings = [standing for standing in ranking.standings if standing.value is not None]
    known: dict[tuple[str, str], list[RunOutcome]] = {}
    for run in ranking.runs:
        if ends_of(run) is not None:
            known.setdefault((run.team, run.trial), []).append(run)
    teams = {standing.team for standing in standings}
    made = {key: len(runs) for key, runs in known.items() if key[0] in teams}
    if spec.total.name not in MONOTONE_TOTALS or not any(count > spec.keep for count in made.values()):
        return ()
    fewest = {
        trial: min((count for (_, of), count in made.items() if of == trial), default=0)
        for trial in ranking.trials
    }
    alike = {s.team: _execution(s, known, spec, digits, fewest) for s in standings}
    single = {s.team: _execution(s, known, spec, digits, dict.fromkeys(fewest, 1)) for s in standings}
    by_alike, by_single = (_places(found, spec) for found in (alike, single))
    return tuple(
        Selection(s.team, s.execution, alike[s.team], single[s.team], by_alike[s.team], by_single[s.team])
        for s in standings
    )


def _execution(
    standing: TeamRank,
    known: Mapping[tuple[str, str], Sequence[RunOutcome]],
    spec: Spec,
    digits: int,
    runs: Mapping[str, int],
) -> Ends:
    """The execution with so many runs of each trial."""
    cells = []
    for trial, cell in standing.trials.items():
        own = known.get((standing.team, trial), ())
        # Where nothing is known a trial stays what the ranking makes of it: nothing is gained or lost.
        cells.append(_cell(own, spec, digits, runs[trial]) if own else Ends(cell.score, cell.score))
    least, most = (spec.total.execution([getattr(cell, end) for cell in cells]) for end in ("least", "most"))
    return Ends(least, most)


def _cell(own: Sequence[RunOutcome], spec: Spec, digits: int, runs: int) -> Ends:
    last = Decimal(1).scaleb(-cell_digits(spec, digits))
    found = []
    for end in (0, 1):
        scores = {run.key: both[end] for run in own if (both := ends_of(run)) is not None}
        # By their scores the best are those at this end; else the order of runs hangs on something else.
        by_score = spec.by[0].name == "score"
        ordered = (
            sorted(scores.values(), reverse=spec.by[0].highest)
            if by_score
            else [scores[run.key] for run in sorted(own, key=lambda run: merit(run, spec))]
        )
        mean = expected_kept([Fraction(score) for score in ordered], min(runs, len(ordered)), spec.keep)
        exact = Decimal(mean.numerator) / Decimal(mean.denominator)
        found.append(exact.quantize(last, rounding=ROUND_HALF_EVEN))
    return Ends(*found)


def _places(found: Mapping[str, Ends], spec: Spec) -> dict[str, int]:
    more = spec.more_is_better
    counts = {team: ends.least if more else -ends.most for team, ends in found.items()}
    return {team: 1 + sum(other > own for other in counts.values()) for team, own in counts.items()}
