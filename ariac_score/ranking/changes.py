"""What changed from one publication of a ranking to the next."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal

from ariac_score.ranking.competition import RunKey
from ariac_score.ranking.outcomes import RunOutcome, TeamRank
from ariac_score.ranking.publication import Publication
from ariac_score.results.codec import plain
from ariac_score.results.result import Pinned

__all__ = ["Changes", "RunChange", "TeamChange", "changes_between"]


@dataclass(frozen=True)
class TeamChange:
    """One team before and now.

    Attributes:
        team: Id.
        name: As shown now, or before where it is gone.
        rank_before: Rank before; `None` for a team without a rank, or that did not take part.
        rank: Rank now; `None` likewise.
        execution_before: Sum over its trials before; `None` where it did not take part.
        execution: The sum now; `None` where it is gone.
        note: `new`, `gone`, or empty.
    """

    team: str
    name: str
    rank_before: int | None
    rank: int | None
    execution_before: Decimal | None
    execution: Decimal | None
    note: str = ""

    @property
    def moved(self) -> bool:
        """Whether anything about it differs."""
        return (self.rank_before, self.execution_before) != (self.rank, self.execution)


@dataclass(frozen=True)
class RunChange:
    """One run that differs between two publications.

    Attributes:
        key: Team, trial, number.
        what: `new`, `gone`, `changed`, or `scored from other files`.
        before: Its score, or its outcome in words; empty where there was none.
        now: The same now.
    """

    key: RunKey
    what: str
    before: str
    now: str


@dataclass(frozen=True)
class Changes:
    """What changed.

    Attributes:
        rules: The rule sets before and now, where they differ.
        how: Keys of the ranking's declaration that differ.
        new_trials: Trials that the previous publication did not have.
        gone_trials: Trials that only the previous publication had.
        teams: Every team of either, in the order of the ranking now.
        runs: Every run that differs.
    """

    rules: tuple[Pinned, Pinned] | None
    how: tuple[str, ...]
    new_trials: tuple[str, ...]
    gone_trials: tuple[str, ...]
    teams: tuple[TeamChange, ...]
    runs: tuple[RunChange, ...]

    @property
    def any(self) -> bool:
        """Whether anything changed."""
        trials = self.new_trials or self.gone_trials
        return bool(self.rules or self.how or trials or self.runs or any(team.moved for team in self.teams))


def changes_between(before: Publication, now: Publication) -> Changes:
    """What changed from one publication to the next."""
    old, new = before.final, now.final
    was, is_now = plain(before.how), plain(now.how)
    return Changes(
        rules=None if old.rule_set == new.rule_set else (old.rule_set, new.rule_set),
        how=tuple(key for key in sorted(is_now) if was[key] != is_now[key]),
        new_trials=tuple(trial for trial in new.trials if trial not in old.trials),
        gone_trials=tuple(trial for trial in old.trials if trial not in new.trials),
        teams=tuple(_teams(before, now)),
        runs=tuple(_runs(before, now)),
    )


def _teams(before: Publication, now: Publication) -> Iterator[TeamChange]:
    old: dict[str, TeamRank] = {standing.team: standing for standing in before.final.standings}
    for standing in now.final.standings:
        was = old.pop(standing.team, None)
        yield TeamChange(
            standing.team,
            standing.name,
            was.rank if was else None,
            standing.rank,
            was.execution if was else None,
            standing.execution,
            "" if was else "new",
        )
    for gone in old.values():
        yield TeamChange(gone.team, gone.name, gone.rank, None, gone.execution, None, "gone")


def _runs(before: Publication, now: Publication) -> Iterator[RunChange]:
    old = {run.key: run for run in before.final.runs}
    new = {run.key: run for run in now.final.runs}
    for key in sorted(old.keys() | new.keys()):
        was, is_now = old.get(key), new.get(key)
        if was is None or is_now is None:
            yield RunChange(key, "gone" if is_now is None else "new", _worth(was), _worth(is_now))
        elif (was.score, was.outcome, was.kept) != (is_now.score, is_now.outcome, is_now.kept):
            yield RunChange(key, "changed", _worth(was), _worth(is_now))
        # The same score from another log is worth knowing too: somebody replaced a recording.
        elif before.inputs.get(key) != now.inputs.get(key):
            yield RunChange(key, "scored from other files", _worth(was), _worth(is_now))


def _worth(run: RunOutcome | None) -> str:
    if run is None:
        return ""
    score = run.outcome if run.score is None else f"{run.score:f}"
    return f"{score}, counts" if run.kept else score
