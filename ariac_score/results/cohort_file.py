"""Cohorts: the values across teams of a competition, as a file organisers can publish.

With it a team can price its own trial against the official cohort, on its own machine.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import Annotated

from msgspec import Meta

from ariac_score.documents.given import path_of, refuse_other
from ariac_score.errors import DataFileError, UsageError, did_you_mean
from ariac_score.results.codec import Format, plain
from ariac_score.results.doubt import left_open
from ariac_score.results.result import Measured, Pinned, Sha256
from ariac_score.scoring.cohort import CohortTerm, CohortValues
from ariac_score.scoring.expression import add_up
from ariac_score.scoring.pricing import Contributed, contribute
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.scoring.scope import Scope

__all__ = ["COHORT", "Cohort", "CohortMean", "cohort_text", "contributed", "load_cohort", "make_cohort"]


@dataclass(frozen=True)
class CohortMean:
    """One mean across teams.

    Attributes:
        value: The mean, or the declared value for no team; `None` when there is neither.
        teams: How many teams it is the mean of.
        left_out: How many teams have a run but do not count.
    """

    value: float | None
    teams: Annotated[int, Meta(ge=0)]
    left_out: Annotated[int, Meta(ge=0)]


@dataclass(frozen=True)
class Cohort:
    """The values across teams of a competition.

    Attributes:
        rule_set: The rule set they were measured under.
        trials: For each trial, value name and path (of an order, or empty) the mean.
        sha256: Hash of everything else, as JSON with sorted keys; it shows an edit.

    Raises:
        ValueError: The hash is another one.
    """

    rule_set: Pinned
    trials: Mapping[str, Mapping[str, Mapping[str, CohortMean]]]
    sha256: Sha256

    def __post_init__(self) -> None:
        if self.sha256 != _sha256(self.rule_set, self.trials):
            raise ValueError("its content does not match its hash: it was edited or damaged")

    @classmethod
    def of(cls, rule_set: Pinned, trials: Mapping[str, Mapping[str, Mapping[str, CohortMean]]]) -> Cohort:
        """A cohort with its hash."""
        return cls(rule_set, trials, _sha256(rule_set, trials))

    def of_trial(self, trial: str, measured: Measured | None = None) -> CohortValues:
        """The values one trial is priced with.

        Args:
            trial: Its name in the competition. Where the cohort has no such trial, the one
                trial with the same work is taken.
            measured: The trial to price, whose work is compared.

        Raises:
            UsageError: The cohort has no such trial.
        """
        # A team that scores its own log need not know what the organisers call the trial.
        name = trial
        if name not in self.trials and measured is not None:
            alike = [other for other, values in self.trials.items() if _has_work(values, measured.scopes)]
            name = alike[0] if len(alike) == 1 else name
        if name not in self.trials:
            raise UsageError(
                f"the cohort has no trial {trial!r}",
                hint=did_you_mean(trial, self.trials, what="trials of the cohort")
                + "; name the one meant with --cohort-trial",
            )
        return CohortValues(
            self.sha256,
            {
                key: {path: mean.value for path, mean in means.items() if mean.value is not None}
                for key, means in self.trials[name].items()
            },
        )


def _sha256(rule_set: Pinned, trials: Mapping[str, Mapping[str, Mapping[str, CohortMean]]]) -> str:
    # Written out and not taken from COHORT: published hashes stay valid when the format moves on.
    content = {"schema": "ariac-score/cohort/1", "rule_set": plain(rule_set), "trials": plain(trials)}
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode("utf-8")).hexdigest()


COHORT = Format("cohort", 1, Cohort, made_by="'rank --cohort-output'")
"""How a cohort is stored."""


def _has_work(values: Mapping[str, Mapping[str, CohortMean]], trial: Scope) -> bool:
    """Whether a trial has the work of which there are values: that, and no more of its levels."""
    named = {path for means in values.values() for path in means if path}
    level_of = {scope.path: scope.level for scope in trial.walk()}
    levels = {level_of.get(path) for path in named}
    if not named:
        return not trial.inner
    return named == {path for path, level in level_of.items() if level in levels}


def contributed(measured: Measured, rule_set: RuleSet) -> Contributed:
    """What a measured trial brings to the values across teams.

    Raises:
        FormulaError: A formula of the cohort has no value here.
    """
    return contribute(
        measured.findings,
        measured.scopes,
        rule_set.sheet,
        rule_set.policies,
        left_open=left_open(measured, rule_set),
    )


def make_cohort(rule_set: RuleSet, trials: Mapping[str, Sequence[Contributed]]) -> Cohort:
    """The means across teams.

    Args:
        rule_set: Which values there are, and what each is when no team counts.
        trials: For each trial what each team with a run brings, in the order of the teams, in
            which the means are added up: another order could round differently.
    """
    return Cohort.of(
        Pinned(rule_set.id, rule_set.sha256),
        {
            trial: {term.name: _means(term, teams) for term in rule_set.sheet.cohort.values()}
            for trial, teams in trials.items()
        },
    )


def _means(term: CohortTerm, teams: Sequence[Contributed]) -> dict[str, CohortMean]:
    brought = [value for team in teams for value in team.values if value.name == term.name]
    paths = dict.fromkeys([value.path for value in brought] + ([""] if term.level == "trial" else []))
    means = {}
    for path in paths:
        counted = [value.value for value in brought if value.path == path and value.counted]
        value = add_up(counted) / len(counted) if counted else term.empty
        means[path] = CohortMean(
            None if value is None else float(value), len(counted), len(teams) - len(counted)
        )
    return means


# The file ------------------------------------------------------------------------------


def load_cohort(path: str | PathLike[str], rule_set: RuleSet) -> Cohort:
    """Read a published cohort for pricing under a rule set.

    Raises:
        DataFileError: Missing, not a cohort, edited, or made under other rules.
    """
    path = path_of(path, "the path of a cohort")
    refuse_other(rule_set, RuleSet, "a rule set", "load_rule_set(name) gives one")
    cohort = COHORT.read(path)
    if cohort.rule_set != Pinned(rule_set.id, rule_set.sha256):
        raise DataFileError(
            f"it was made under {cohort.rule_set.id} (SHA-256 {cohort.rule_set.sha256[:12]}…), not under "
            f"{rule_set.id} ({rule_set.sha256[:12]}…)",
            file=path,
            place="$.rule_set",
            hint="price with the rule set the organisers used",
        )
    return cohort


def cohort_text(cohort: Cohort) -> str:
    """A cohort as canonical JSON, with its own hash."""
    return COHORT.text(cohort)
