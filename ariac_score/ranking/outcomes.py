"""How runs, trials and teams come out: what a ranking consists of."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from typing import Annotated

from msgspec import Meta

from ariac_score.ranking.competition import RunKey
from ariac_score.ranking.open_scores import Ends, OpenStanding
from ariac_score.results.codec import leave_out_empty
from ariac_score.results.cohort_file import Cohort
from ariac_score.results.result import Pinned, Result
from ariac_score.scoring.expression import Number
from ariac_score.scoring.steward import Adjustment

__all__ = [
    "AS_ZERO",
    "OUTCOMES",
    "WITH_SCORE",
    "Cell",
    "Outcome",
    "Ranking",
    "RunOutcome",
    "Stewarded",
    "TeamRank",
    "counting_worst",
    "final_ranking",
]

OUTCOMES: Mapping[str, str] = {
    "scored": "it has a score",
    "crashed": "the simulator died and wrote no score: 0",
    "cancelled": "the run was cancelled and has no score: 0",
    "aborted": "the run ended before all work was done; its score stands",
    "unofficial": "its log is cut off; the score of what is there stands, as was asked for: unofficial",
    "disqualified": "the stewards disqualified it: 0",
    "undecided": "something the score depends on is undecided: not counted",
    "unreadable": "the log cannot be read as one trial: not counted",
    "no_value": "the rules have no value for it, such as a division by 0: not counted",
    "refused": "another run has the same number: neither counts",
    "no_run": "there is no run",
}
"""How a run, or a team's trial, can end."""
Outcome = Annotated[str, Meta(pattern=f"^({'|'.join(OUTCOMES)})$")]
# Without "aborted": such a run has a score, and that stands.
AS_ZERO = ("crashed", "cancelled", "disqualified")
"""These have no score of their own, and count 0 or the worst of their trial."""
WITH_SCORE = ("scored", "aborted", "unofficial")
"""These have a score of their own."""


@dataclass(frozen=True)
class RunOutcome:
    """One run: how it ended, its score, whether it counts.

    Attributes:
        team: Team.
        trial: Trial.
        number: Number of the run.
        outcome: One of `OUTCOMES`.
        cause: Why it ended so, in words, where that is out of the ordinary.
        task: Task score, where the rules have one.
        score: Score; `None` when there is none. Where the rules compare teams, only runs kept have one.
        kept: Whether it counts for the trial.
        terms: The terms of the trial that runs are compared by.
        worst: The worst score of the trial, where that counts for this run instead of 0.
        decisions: Ids of the stewards' decisions that changed it.
        result: The result, where there is one.
        open: Between which ends its score lies, where its log leaves that open.
    """

    team: str
    trial: str
    number: int
    outcome: Outcome
    cause: str = ""
    task: Decimal | None = None
    score: Decimal | None = None
    kept: bool = False
    terms: Mapping[str, float] = field(default_factory=dict)
    worst: Decimal | None = None
    decisions: tuple[str, ...] = ()
    result: Result | None = field(default=None, repr=False, compare=False)
    open: Ends | None = None

    @property
    def key(self) -> RunKey:
        """Team, trial, number."""
        return self.team, self.trial, self.number

    @property
    def reason(self) -> str:
        """The cause, and what the run counts where that is not 0."""
        return self.cause if self.worst is None else counting_worst(self.cause, self.worst)


@dataclass(frozen=True)
class Cell:
    """The score of one team in one trial.

    Attributes:
        score: Mean of the runs kept; without any, 0 or the worst score of the trial.
        outcome: `scored`, or why it is 0: one of `OUTCOMES`.
        reason: In words.
        runs: Numbers of the runs that count.
        made: Number of runs, counting or not.
        open: Between which ends the score lies, where logs leave that open.
    """

    score: Decimal
    outcome: Outcome
    reason: str
    runs: tuple[int, ...]
    made: int
    open: Ends | None = None

    def __post_init__(self) -> None:
        leave_out_empty(self, "open")


@dataclass(frozen=True)
class TeamRank:
    """One team in the ranking.

    Attributes:
        rank: 1 for the best; teams that nothing separates share it. `None` when the team
            has no value, as without the judges' marks.
        team: Id.
        name: As shown.
        value: What teams are ranked by.
        execution: Sum over the trials, or what the rules take instead.
        judges: Sum or mean of the judges' marks; `None` when there are none.
        ties: The values that separate teams of equal value, by name.
        trials: Its score in each trial.
        remarks: What a reader of the ranking must know about this team.
        places: In how many trials it came first, second, and so on.
        separated_by: What puts it behind the team before it: `value`, or one of the ties;
            empty for the first team, for a shared rank, and for a team without a rank.
        disqualified: Why it has no rank, where it was disqualified.
        open: Between which ends its execution and its rank lie, where logs of any team leave that open.
    """

    rank: int | None
    team: str
    name: str
    value: Number | None
    execution: Decimal
    judges: Decimal | None
    ties: Mapping[str, int | float | None]
    trials: Mapping[str, Cell]
    remarks: tuple[str, ...] = ()
    places: tuple[int, ...] = ()
    separated_by: str = ""
    disqualified: str = ""
    open: OpenStanding | None = None

    def __post_init__(self) -> None:
        leave_out_empty(self, "open")


@dataclass(frozen=True)
class Ranking:
    """A ranked competition.

    Attributes:
        competition: Id.
        title: One line for people.
        rule_set: By which its runs were scored.
        trials: Their ids in order.
        standings: Best first.
        runs: Every run, sorted by team, trial and number.
        cohort: The values across teams; `None` when the rules compare none.
        strangers: Files and folders among the runs that belong to no team or trial.
        worst: By trial what counts where there is no score: 0, or the score of the worst run kept.
        stewarded: The ranking after the decisions of stewards; all else is the automatic one.
    """

    competition: str
    title: str
    rule_set: Pinned
    trials: tuple[str, ...]
    standings: tuple[TeamRank, ...]
    runs: tuple[RunOutcome, ...]
    cohort: Cohort | None
    strangers: tuple[str, ...] = ()
    worst: Mapping[str, Decimal] = field(default_factory=dict)
    stewarded: Stewarded | None = None


@dataclass(frozen=True)
class Stewarded:
    """A ranking after the decisions of stewards.

    Attributes:
        ranking: The adjusted ranking.
        adjustments: The decisions, in the order of their file.
        sha256: Of the file.
    """

    ranking: Ranking
    adjustments: tuple[Adjustment, ...]
    sha256: str


def final_ranking(ranking: Ranking) -> Ranking:
    """The ranking that counts: the adjusted one, where stewards decided something."""
    return ranking.stewarded.ranking if ranking.stewarded else ranking


def counting_worst(cause: str, worst: Decimal) -> str:
    """A cause, and what counts instead of a score."""
    return f"{cause}; it counts {worst:f}, the worst of the trial"
