"""How often do the intervals of a ranking hold? Simulated competitions with known truth.

Six teams, two and two and two of equal ability. A score is the ability of the team, the
difficulty of the trial, how well the team copes with that trial, and the luck of the run.
For each row: how often the interval of a pair holds, how often all of a competition hold
together, in how many competitions two teams are wrongly told apart, and the mean number of
ranks an interval spans beyond one.

    python benchmarks/coverage.py [--rounds 300] [--draws 400]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

from ariac_score.ranking.rank import Cell, Ranking, RunOutcome, TeamRank
from ariac_score.ranking.spec import Intervals, Key, Spec
from ariac_score.ranking.statistics import rank_statistics
from ariac_score.scoring.expression import Expression

ABILITY = (0.0, 0.0, 3.0, 3.0, 8.0, 8.0)
MARKS = (3.0, 1.0, 2.0, 2.0, 1.0, 3.0)
MIXED = "0.8 * rank(execution) + 0.2 * rank(judges)"
DIGIT = Decimal("0.0001")


@dataclass(frozen=True)
class Row:
    """One kind of competition.

    Attributes:
        trials: How many.
        keep: How many of five runs count.
        between: Standard deviation of how a team copes with a trial.
        within: Standard deviation of the luck of a run.
        resample: What is drawn.
        mixed: Whether ranks are mixed as in 2025.
    """

    trials: int
    keep: int
    between: float
    within: float
    resample: str
    mixed: bool = False

    @property
    def spec(self) -> Spec:
        """How its runs become ranks."""
        value = Expression.parse(MIXED if self.mixed else "execution")
        by = (Key("score", highest=True),)
        return Spec(self.keep, by, fill=True, judges="sum", value=value, highest=not self.mixed, ties=())


ROWS = [
    Row(trials, keep, *spread, resample)
    for trials in (3, 6, 15)
    for keep in (1, 5)
    for spread in ((1.0, 3.0), (3.0, 1.0))
    for resample in ("trials_and_runs", "trials")
]
ROWS += [Row(6, keep, 0.0, 3.0, "runs") for keep in (5, 1)]
ROWS += [Row(trials, 2, 2.0, 2.0, "trials_and_runs", mixed=True) for trials in (3, 6, 15)]


def competition(row: Row, spec: Spec, chance: np.random.Generator) -> Ranking:
    """One competition as it might have been held."""
    names = [f"t{j}" for j in range(row.trials)]
    hard = chance.normal(0, 3, row.trials)
    outcomes, teams = [], []
    for i, ability in enumerate(ABILITY):
        cells = {}
        for name, difficulty in zip(names, hard, strict=True):
            copes = 100 + ability + difficulty + chance.normal(0, row.between)
            scores = np.sort(copes + chance.normal(0, row.within, 5))[::-1]
            runs = [Decimal(str(x)).quantize(DIGIT) for x in scores]
            outcomes += [
                RunOutcome(f"team{i}", name, k, "scored", score=x, kept=k <= row.keep)
                for k, x in enumerate(runs, start=1)
            ]
            mean = sum(runs[: row.keep], Decimal(0)) / row.keep
            cells[name] = Cell(mean.quantize(Decimal("1e-9")), "scored", "", (1,), 5)
        teams.append((f"team{i}", cells, sum((c.score for c in cells.values()), Decimal(0))))
    marks = [Decimal(str(mark)) for mark in MARKS]
    values = spec.values([{"execution": t[2], "judges": m} for t, m in zip(teams, marks, strict=True)])
    standings = [
        TeamRank(None, team, team, value, total, mark, {}, cells)
        for (team, cells, total), value, mark in zip(teams, values, marks, strict=True)
    ]
    standings.sort(key=lambda s: (s.value or 0.0) * (-1 if spec.highest else 1))
    return Ranking("made", "", ("", ""), tuple(names), tuple(standings), tuple(outcomes), None)


def held(row: Row, rounds: int, draws: int) -> Iterator[tuple[float, bool, bool, float]]:
    """For each competition: pairs that hold, whether all do, whether a claim is wrong, ranks spanned."""
    chance = np.random.default_rng(5)
    for number in range(rounds):
        spec = Spec(**{**vars(row.spec), "intervals": Intervals(row.resample, draws, number)})
        found = rank_statistics(competition(row, spec, chance), spec, 4)
        means = [
            {"execution": Decimal(str(ability * row.trials)), "judges": Decimal(str(mark))}
            for ability, mark in zip(ABILITY, MARKS, strict=True)
        ]
        sign = 1 if spec.highest else -1
        truth = {f"team{i}": sign * (v or 0.0) for i, v in enumerate(spec.values(means))}
        gaps = [(p, truth[p.first] - truth[p.second]) for p in found.pairs]
        slack = 1e-6
        yield (
            float(np.mean([p.low - slack <= gap <= p.high + slack for p, gap in gaps])),
            all(p.joint_low - slack <= gap <= p.joint_high + slack for p, gap in gaps),
            any(p.distinguished and gap * p.joint_low <= slack for p, gap in gaps),
            float(np.mean([odds.high - odds.low for odds in found.teams])),
        )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=300)
    parser.add_argument("--draws", type=int, default=400)
    arguments = parser.parse_args()
    print("trials keep between within resample         value     pair  together  wrong  ranks")
    for row in ROWS:
        pair, together, wrong, ranks = np.mean(list(held(row, arguments.rounds, arguments.draws)), axis=0)
        value = "ranks" if row.mixed else "points"
        print(
            f"{row.trials:6} {row.keep:4} {row.between:7g} {row.within:6g} {row.resample:16} {value:7}"
            f" {pair:6.3f} {together:9.3f} {wrong:6.3f} {ranks:6.2f}"
        )


if __name__ == "__main__":
    main()
