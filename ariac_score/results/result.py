"""What is stored: the measured trial, its price, and where everything came from."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Any

from ariac_score.checks.findings import Finding
from ariac_score.errors import ResultError
from ariac_score.results.sketch import Sketch
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.ledger import Ledger, reconcile
from ariac_score.scoring.policy import Assumption
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.steward import Adjusted
from ariac_score.trial.model import LogDefect, OfficialResult
from ariac_score.trial.spans import Span

__all__ = [
    "SIGNIFICANT_DIGITS",
    "Coverage",
    "Measured",
    "Provenance",
    "Result",
    "Setting",
    "Settings",
    "Source",
    "canonical",
    "declared_units",
    "settled",
]

SIGNIFICANT_DIGITS = 12
"""Measured numbers keep so many digits: fewer than float64 has, so that the last bits,
in which two machines may differ, never reach a result; more than any sensor means."""


def canonical(value: float) -> float:
    """A measured number with the declared digits; never a negative zero.

    >>> canonical(0.1 + 0.2)
    0.3
    """
    if not math.isfinite(value):
        raise ValueError(f"{value!r} cannot stand in a result")
    return float(f"{value:.{SIGNIFICANT_DIGITS}g}") + 0.0


def declared_units(findings: Iterable[Finding]) -> dict[str, dict[str, str]]:
    """The declared units of quantities, by check."""
    units: dict[str, dict[str, str]] = {}
    for finding in findings:
        if finding.units:
            units.setdefault(finding.check, {}).update(finding.units)
    return units


def settled(finding: Finding) -> Finding:
    """A finding with its numbers as they will be stored, so that pricing now and later agree."""
    return replace(
        finding,
        robustness=None if finding.robustness is None else canonical(finding.robustness),
        quantities={name: canonical(value) for name, value in finding.quantities.items()},
    )


@dataclass(frozen=True)
class Coverage:
    """How much of the competition one signal covers.

    Attributes:
        signal: Its name.
        samples: Number of samples.
        rate_hz: Mean rate, Hz; 0 with fewer than two samples.
        largest_gap_s: Longest stretch without a sample, the ends included, s.
        source: Where it was recorded, such as the topic, or `derived`; empty when nobody says.
    """

    signal: str
    samples: int
    rate_hz: float
    largest_gap_s: float
    source: str = ""


@dataclass(frozen=True)
class Setting:
    """One parameter as it was in force.

    Attributes:
        name: Its name.
        value: Number, text, list or mapping; `None` where there is none.
        unit: SI unit; empty where the plugin tells none.
        origin: `rule_set`, `default` of the plugin, or `derived` from other parameters, as by a profile.
        status: How sure the default is, where the plugin says so.
        source: Where the default comes from, where the plugin says so.
    """

    name: str
    value: Any
    unit: str
    origin: str
    status: str = ""
    source: str = ""


@dataclass(frozen=True)
class Settings:
    """What a check was set to.

    Attributes:
        source: What its plugin says that it rests on.
        parameters: Every parameter, in the order the plugin has them.
    """

    source: str
    parameters: tuple[Setting, ...]


@dataclass(frozen=True)
class Measured:
    """Everything the checks said about a trial; enough to price it without its log.

    Attributes:
        trial: Name of the trial.
        findings: By id, such as `separation#1`.
        scopes: Orders, submissions and parts, for the score sheet.
        window: Start and end of the competition, s of trial time.
        orders: For each order when it was announced, s; `None` when unknown.
        coverage: Of each signal.
        log_defects: What was wrong with the logs.
        unrecorded: What was looked for and is not in the logs.
        witnessed: What the logs would have shown.
        clock: Which clock the times come from.
        official: The official scorer's result, when the bundle holds it.
        team: Name of the team; empty when unknown.
        sketch: What a page draws beside this; `None` where none was made. Nothing is priced by it.
        settings: What every check was set to, by its name; `None` where it was not kept. Prices nothing.
        units: By check the declared units of its quantities; `None` where they were not kept.
    """

    trial: str
    findings: Mapping[str, Finding]
    scopes: Scope
    window: Span | None = None
    orders: Mapping[str, float | None] = field(default_factory=dict)
    coverage: tuple[Coverage, ...] = ()
    log_defects: tuple[LogDefect, ...] = ()
    unrecorded: tuple[str, ...] = ()
    witnessed: tuple[str, ...] = ()
    clock: str = ""
    official: OfficialResult | None = None
    team: str = ""
    sketch: Sketch | None = None
    settings: Mapping[str, Settings] | None = None
    units: Mapping[str, Mapping[str, str]] | None = None

    def of(self, check: str) -> dict[str, Finding]:
        """The findings of one check, by id."""
        return {key: finding for key, finding in self.findings.items() if finding.check == check}


@dataclass(frozen=True)
class Source:
    """One file that was read: its role, its name within the bundle, its hash.

    Attributes:
        role: Such as `log`.
        name: Within the bundle.
        bytes: Its size.
        sha256: Of its content; where only parts were read, of these with their places.
        read_bytes: How much was read where that is not everything; `None` otherwise.
    """

    role: str
    name: str
    bytes: int
    sha256: str
    read_bytes: int | None = None


@dataclass(frozen=True)
class Provenance:
    """Where a result came from.

    Attributes:
        inputs: Every file of the trial, sorted by role and name.
        ignored: Files of the bundle that no reader took, sorted.
        rule_set: Id and SHA-256.
        log_map: Id and SHA-256.
        code: For each distribution package that was used: distribution, version, SHA-256.
    """

    inputs: tuple[Source, ...]
    ignored: tuple[str, ...]
    rule_set: tuple[str, str]
    log_map: tuple[str, str]
    code: tuple[tuple[str, str, str, str], ...]


@dataclass(frozen=True)
class Result:
    """A scored trial.

    Attributes:
        measured: What was found.
        rule_set_title: One line about the rules.
        checks: Which plugin each check is, with its parameters.
        notes: What the rule set wants a referee to know.
        rules: The whole rule set as YAML, so that a result can be checked on its own.
        status: `scored`; `incomplete` when something needed was undecided; `needs_cohort`
            when the score asks for values across teams that were not given.
        score: The final score; `None` unless scored.
        possible: What the trial could have earned with every finding satisfied; `None`
            when that has no value.
        ledger: The score taken apart; `None` unless scored.
        assumptions: What was made of undecided findings.
        digits: Decimal digits of score and ledger.
        provenance: Where it came from.
        task: The task score taken apart, before any value across teams enters; `None`
            when the rule set has none, or it is withheld.
        cohort: The values across teams it was priced with.
        missing: What the score needs from all teams, or what no record states, in words.
        adjusted: What stewards made of it; all the rest is the automatic result, untouched.
    """

    measured: Measured
    rule_set_title: str
    checks: Mapping[str, Mapping[str, Any]]
    notes: tuple[str, ...]
    rules: str
    status: str
    score: Decimal | None
    possible: Decimal | None
    ledger: Ledger | None
    assumptions: tuple[Assumption, ...]
    digits: int
    provenance: Provenance
    task: Ledger | None = None
    cohort: CohortValues = field(default_factory=CohortValues)
    missing: str = ""
    adjusted: Adjusted | None = None

    @property
    def automatic(self) -> Result:
        """The result without what stewards made of it."""
        return replace(self, adjusted=None)

    @property
    def final(self) -> Decimal | None:
        """The score that counts: the adjusted one, where there is one."""
        return self.score if self.adjusted is None else self.adjusted.score

    def __post_init__(self) -> None:
        if (self.score is None) != (self.status != "scored") or (self.ledger is None) != (self.score is None):
            raise ResultError(
                f"status {self.status!r} does not go with score {self.score}, or the ledger is missing",
                hint="the result was edited or damaged: score the trial again",
            )
        if self.ledger is not None and self.score is not None:
            reconcile(self.ledger, self.score, digits=self.digits)
        if self.task is not None:
            reconcile(self.task, self.task.amount, digits=self.digits)
        adjusted = self.adjusted
        if adjusted is not None and adjusted.ledger is not None and adjusted.score is not None:
            reconcile(adjusted.ledger, adjusted.score, digits=self.digits)
