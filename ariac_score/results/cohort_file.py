"""Cohorts: the values across teams of a competition, as a file organisers can publish.

With it a team can price its own trial against the official cohort, on its own machine.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ariac_score.documents.schema import schema_errors, strict_json
from ariac_score.documents.yaml import read_text
from ariac_score.errors import DataFileError, UsageError, did_you_mean
from ariac_score.results.result import Measured
from ariac_score.scoring.cohort import CohortTerm, CohortValues
from ariac_score.scoring.expression import add_up
from ariac_score.scoring.pricing import Contributed, contribute
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["Cohort", "CohortMean", "cohort_text", "contributed", "load_cohort", "make_cohort"]

SCHEMA = "ariac-score/cohort/1"


@dataclass(frozen=True)
class CohortMean:
    """One mean across teams.

    Attributes:
        value: The mean, or the declared value for no team; `None` when there is neither.
        teams: How many teams it is the mean of.
        left_out: How many teams have a run but do not count.
    """

    value: float | None
    teams: int
    left_out: int


@dataclass(frozen=True)
class Cohort:
    """The values across teams of a competition.

    Attributes:
        rule_set: Id and SHA-256 of the rule set they were measured under.
        trials: For each trial, value name and path (of an order, or empty) the mean.
    """

    rule_set: tuple[str, str]
    trials: Mapping[str, Mapping[str, Mapping[str, CohortMean]]]

    @property
    def sha256(self) -> str:
        """Hash of the content; the file repeats it, so that an edit shows."""
        return hashlib.sha256(json.dumps(_content(self), sort_keys=True).encode("utf-8")).hexdigest()

    def of_trial(self, trial: str, measured: Measured | None = None) -> CohortValues:
        """The values one trial is priced with.

        Args:
            trial: Its name in the competition. Where the cohort has no such trial, the one
                trial with the same orders is taken.
            measured: The trial to price, for its orders.

        Raises:
            UsageError: The cohort has no such trial.
        """
        name = trial
        if name not in self.trials and measured is not None:
            orders = {scope.path for scope in measured.scopes.inner}
            alike = [other for other, values in self.trials.items() if _orders(values) == orders]
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


def _orders(values: Mapping[str, Mapping[str, CohortMean]]) -> set[str]:
    return {path for means in values.values() for path in means if path}


def contributed(measured: Measured, rule_set: RuleSet) -> Contributed:
    """What a measured trial brings to the values across teams.

    Raises:
        FormulaError: A formula of the cohort has no value here.
    """
    return contribute(measured.findings, measured.scopes, rule_set.sheet, rule_set.policies)


def make_cohort(rule_set: RuleSet, trials: Mapping[str, Sequence[Contributed]]) -> Cohort:
    """The means across teams.

    Args:
        rule_set: Which values there are, and what each is when no team counts.
        trials: For each trial what each team with a run brings, in the order of the teams;
            the means are added up in that order.
    """
    return Cohort(
        (rule_set.id, rule_set.sha256),
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


def cohort_text(cohort: Cohort) -> str:
    """A cohort as canonical JSON, with its own hash."""
    data = {**_content(cohort), "sha256": cohort.sha256}
    return json.dumps(data, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def _content(cohort: Cohort) -> dict[str, Any]:
    return {
        "schema": SCHEMA,
        "rule_set": {"id": cohort.rule_set[0], "sha256": cohort.rule_set[1]},
        "trials": {
            trial: {
                name: {
                    path: {"value": mean.value, "teams": mean.teams, "left_out": mean.left_out}
                    for path, mean in means.items()
                }
                for name, means in values.items()
            }
            for trial, values in cohort.trials.items()
        },
    }


def load_cohort(path: Path, rule_set: RuleSet) -> Cohort:
    """Read a published cohort for pricing under a rule set.

    Raises:
        DataFileError: Missing, not a cohort, edited, or made under other rules.
    """
    try:
        data = strict_json(read_text(path).decode("utf-8"))
    except (ValueError, RecursionError) as cause:
        raise DataFileError(
            f"not a cohort: {cause}", file=path, hint="give the cohort.json that 'rank --cohort-output' wrote"
        ) from None
    faults = schema_errors(data, "cohort")
    if faults:
        where = "$" + "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in faults[0][0])
        raise DataFileError(
            faults[0][1], file=path, place=where, hint="ask the organisers for the file again"
        )
    cohort = Cohort(
        (data["rule_set"]["id"], data["rule_set"]["sha256"]),
        {
            trial: {
                name: {at: CohortMean(m["value"], m["teams"], m["left_out"]) for at, m in means.items()}
                for name, means in values.items()
            }
            for trial, values in data["trials"].items()
        },
    )
    if cohort.sha256 != data["sha256"]:
        raise DataFileError(
            "its content does not match its hash: it was edited or damaged",
            file=path,
            place="$.sha256",
            hint="ask the organisers for the file again",
        )
    if cohort.rule_set != (rule_set.id, rule_set.sha256):
        raise DataFileError(
            f"it was made under {cohort.rule_set[0]} (SHA-256 {cohort.rule_set[1][:12]}…), not under "
            f"{rule_set.id} ({rule_set.sha256[:12]}…)",
            file=path,
            place="$.rule_set",
            hint="price with the rule set the organisers used",
        )
    return cohort
