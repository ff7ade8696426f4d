"""What is stored of a scored trial: findings, price, and where everything came from."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from decimal import Decimal
from typing import Annotated, Any, TypedDict

from msgspec import Meta, Struct

from ariac_score.checks.findings import SIGNIFICANT_DIGITS, Finding, canonical, canonical_span, settled
from ariac_score.checks.measures import Measure
from ariac_score.checks.open_findings import OpenFindings, settled_open
from ariac_score.errors import ResultError
from ariac_score.results.codec import leave_out_empty
from ariac_score.results.notebook import result_html
from ariac_score.results.sketch import Sketch
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.interval import ScoreInterval
from ariac_score.scoring.ledger import Ledger, reconcile
from ariac_score.scoring.policy import Assumption, Policy
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.steward import Adjusted
from ariac_score.trial.computed import DERIVED
from ariac_score.trial.cut import Cut
from ariac_score.trial.frames import frame
from ariac_score.trial.model import LogDefect, OfficialResult
from ariac_score.trial.spans import Span
from ariac_score.trial.statements import Statement
from ariac_score.trial.window import Lasted

__all__ = [
    "SEQUENCE",
    "SIGNIFICANT_DIGITS",
    "CheckUse",
    "Code",
    "Coverage",
    "Measured",
    "Pinned",
    "Provenance",
    "Result",
    "Setting",
    "Settings",
    "Sha256",
    "Source",
    "canonical",
    "settled",
]

SEQUENCE, SLOPES = "sequence", "slopes"
"""How a ledger was taken apart: products in written order, as up to `result/2`, or as docs/ledger.md says."""

Sha256 = Annotated[str, Meta(pattern="^[0-9a-f]{64}$")]


class Pinned(Struct, frozen=True, forbid_unknown_fields=True):
    """A rule set or log map, and which state of it.

    Attributes:
        id: Its name.
        sha256: Of its file.
    """

    id: str
    sha256: str


class Code(Struct, frozen=True, order=True, forbid_unknown_fields=True):
    """A package that took part.

    Attributes:
        distribution: That installs it; `local file` or `notebook class` for what none installs.
        version: Of the distribution; where there is none, the first digits of the hash, or `unverifiable`.
        package: Its name; of a local file its name beside the rule set, of a notebook that of the class.
        sha256: Of its files; empty for a class whose text Python does not have.
    """

    distribution: str
    version: str
    package: str
    sha256: Annotated[str, Meta(pattern="^([0-9a-f]{64})?$")]


@dataclass(frozen=True)
class Coverage:
    """How much of the competition one signal covers.

    Attributes:
        signal: Its name.
        samples: Number of samples.
        rate_hz: Mean rate, Hz; 0 with fewer than two samples.
        largest_gap_s: Longest stretch without a sample, the ends included, s.
        source: Where it was recorded, such as the topic, or `derived`; empty when nobody says.
        stamp_jitter_s: By how much its stamps are late against each other, s; left out where it is 0, as if
            senders stamped it. Bounds of what was not seen are wider by it.
        stated_rate_hz: How often it is published, Hz, as its organiser states; left out where nobody does.
    """

    signal: str
    samples: Annotated[int, Meta(ge=0)]
    rate_hz: float
    largest_gap_s: float
    source: str = ""
    stamp_jitter_s: float = 0.0
    stated_rate_hz: float = 0.0

    def __post_init__(self) -> None:
        leave_out_empty(self, "stamp_jitter_s", "stated_rate_hz")


class Setting(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """One parameter as it was in force.

    Attributes:
        name: Its name.
        value: Number, text, list or mapping; `None` where there is none.
        unit: SI unit; empty where the plugin declares none.
        origin: `rule_set`, `log_map`, `default` of the plugin (of a bound: ours), or `derived` from other
            parameters, as by a profile.
        status: How sure the default is, where the plugin declares it.
        source: Where the default comes from, where the plugin declares it.
    """

    name: str
    value: Any
    unit: str
    origin: Annotated[str, Meta(pattern="^(rule_set|log_map|default|derived)$")]
    status: str = ""
    source: str = ""


class Settings(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
    """The settings of a check.

    Attributes:
        source: The standard or document its plugin rests on, in the plugin's words.
        parameters: Every parameter, in the order the plugin has them.
        mistake: What people call a violation of it, one and several, in the plugin's words; empty where
            it does not say.
        part_of: `task` or `safety`, where the plugin says so; else a monitor is about safety, and a rule
            about the task unless all its quantities are penalties and factors.
    """

    source: str
    parameters: tuple[Setting, ...]
    mistake: tuple[str, ...] = ()
    part_of: Annotated[str, Meta(pattern="^(task|safety)?$")] = ""


def _settled_scope(scope: Scope) -> Scope:
    facts = {k: canonical(v) if isinstance(v, float) else v for k, v in scope.facts.items()}
    return replace(scope, facts=facts, inner=tuple(_settled_scope(inner) for inner in scope.inner))


def _settled_length(lasted: Lasted | None) -> Lasted | None:
    if lasted is None:
        return None
    most_s = None if lasted.most_s is None else canonical(lasted.most_s)
    return replace(lasted, least_s=canonical(lasted.least_s), most_s=most_s)


@dataclass(frozen=True)
class Measured:
    """Everything the checks found about a trial; enough to price it without its log.

    Attributes:
        trial: Name of the trial.
        findings: By id, such as `separation#1`.
        scopes: Orders, submissions and parts, for the score sheet.
        window: Start and end of the competition, s of trial time.
        orders: For each order when it was announced, s; `None` when unknown.
        coverage: Of each signal.
        log_defects: What was wrong with the logs.
        unrecorded: What was looked for and is not in the logs.
        witnessed: What the logs would have shown, had it happened.
        clock: Which clock the times come from.
        official: The official scorer's result, when the bundle holds it.
        team: Name of the team; empty when unknown.
        sketch: What a page draws of the trial; `None` where none was made. It has no influence on prices.
        settings: The settings of every check, by its name; `None` where none were kept. They have no
            influence on prices.
        measures: Unit, role and best value of each quantity by check, as its plugin declares them: what a
            ledger compares with. Empty in results of versions that kept none.
        watched: From the first to the last time that the logs tell of, s of trial time: no finding lies
            outside. `None` where they tell of none, and in results of versions that did not keep it.
        open: For each check and subject whose findings depend on what the logs do not show, those of the
            best and of the worst world; where a world is priced, they replace those in `findings`.
        unofficial: In words, why nothing official can follow from this; such as that the log is cut off,
            and was scored as far as it can be read.
        cut: How far a log goes that is cut off, and was scored all the same; `None`: all were whole.
        statements: Whose statement work, window, set-up and completeness rest on. Empty in results of
            versions that did not say.
        lasted: For how long the competition may have lasted, where the logs do not state both of its ends
            exactly: then the `duration_s` of the trial is open in formulas.
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
    measures: Mapping[str, Mapping[str, Measure]] = field(default_factory=dict)
    watched: Span | None = None
    open: tuple[OpenFindings, ...] = ()
    unofficial: tuple[str, ...] = ()
    cut: Cut | None = None
    statements: tuple[Statement, ...] = ()
    lasted: Lasted | None = None

    def __post_init__(self) -> None:
        # Rounded here and not while writing: what is priced now is what a reader will price.
        kept = {
            "findings": {key: settled(finding) for key, finding in self.findings.items()},
            "scopes": _settled_scope(self.scopes),
            "window": None if self.window is None else canonical_span(self.window),
            "watched": None if self.watched is None else canonical_span(self.watched),
            "orders": {key: None if t_s is None else canonical(t_s) for key, t_s in self.orders.items()},
            "coverage": tuple(
                replace(
                    c,
                    rate_hz=canonical(c.rate_hz),
                    largest_gap_s=canonical(c.largest_gap_s),
                    stamp_jitter_s=canonical(c.stamp_jitter_s),
                    stated_rate_hz=canonical(c.stated_rate_hz),
                )
                for c in self.coverage
            ),
            "measures": {
                check: {
                    name: replace(
                        one,
                        best=None if one.best is None else canonical(one.best),
                        worst=None if one.worst is None else canonical(one.worst),
                    )
                    for name, one in own.items()
                }
                for check, own in self.measures.items()
            },
            "open": tuple(map(settled_open, self.open)),
            "lasted": _settled_length(self.lasted),
        }
        for name, value in kept.items():
            object.__setattr__(self, name, value)
        leave_out_empty(self, "open", "unofficial", "cut", "statements", "lasted")

    def to_frame(self) -> Any:
        """The findings as a `pandas.DataFrame`, a row for each, its quantities in columns of their own.

        The units of quantities are in `attrs["units"]`; where a finding lacks one, there is NaN.

        Raises:
            UsageError: pandas is not installed.
        """
        found = list(self.findings.values())
        names = dict.fromkeys(name for finding in found for name in finding.quantities)
        units = {name: unit for finding in found for name, unit in finding.units.items()}
        columns = {
            "id": list(self.findings),
            "check": [finding.check for finding in found],
            "subject": [finding.subject for finding in found],
            "verdict": [finding.verdict.value for finding in found],
            "start_s": [finding.span.start_s if finding.span else math.nan for finding in found],
            "end_s": [finding.span.end_s if finding.span else math.nan for finding in found],
            "robustness": [math.nan if f.robustness is None else f.robustness for f in found],
            "unit": [finding.unit for finding in found],
            "message": [finding.message for finding in found],
            **{
                f"quantities.{name}": [finding.quantities.get(name, math.nan) for finding in found]
                for name in names
            },
        }
        return frame(columns, index="id", units={f"quantities.{name}": u for name, u in units.items()})

    @property
    def unrated(self) -> tuple[str, ...]:
        """Sources of samples of which nobody states a rate: what is left out of them evenly shows nowhere."""
        recorded = (c for c in self.coverage if c.rate_hz and c.source != DERIVED)
        return tuple(sorted({c.source for c in recorded if not c.stated_rate_hz}))

    @property
    def in_all_worlds(self) -> dict[str, Finding]:
        """The findings by id, with those of the worlds that the logs leave open, which ledgers name."""
        worlds = (world for one in self.open for world in (one.best, one.worst))
        return {**self.findings, **{key: finding for world in worlds for key, finding in world.items()}}

    def of(self, check: str) -> dict[str, Finding]:
        """The findings of one check, by id."""
        return {key: finding for key, finding in self.findings.items() if finding.check == check}


class Source(Struct, frozen=True, omit_defaults=True, forbid_unknown_fields=True):
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
    bytes: Annotated[int, Meta(ge=0)]
    sha256: Sha256
    read_bytes: Annotated[int, Meta(ge=0)] | None = None


@dataclass(frozen=True)
class Provenance:
    """Where a result came from.

    Attributes:
        inputs: Every file of the trial, sorted by role and name.
        ignored: Files of the bundle that no reader took, sorted.
        rule_set: By which it was scored.
        log_map: By which the log was read.
        code: Every package that was used, sorted.
    """

    inputs: tuple[Source, ...]
    ignored: tuple[str, ...]
    rule_set: Pinned
    log_map: Pinned
    code: tuple[Code, ...]


CheckUse = TypedDict(
    "CheckUse",
    {
        "use": Annotated[str, Meta(description="Its plugin.")],
        "with": Annotated[dict[str, Any], Meta(description="The parameters that the rule set gives.")],
        "on_inconclusive": Annotated[Policy, Meta(description="What it counts as while it is undecided.")],
        "priced": Annotated[bool, Meta(description="Whether the score depends on it.")],
    },
)
"""A check in a result; not a class, because one of its keys is a keyword of Python."""


@dataclass(frozen=True)
class Result:
    """A scored trial.

    Attributes:
        measured: What was found.
        rule_set_title: One line about the rules.
        checks: Which plugin each check is, with its parameters.
        notes: What a referee should know about the rule set.
        rules: The whole rule set as YAML, so that a result can be checked on its own.
        status: `scored`; `incomplete` when something needed was undecided; `needs_cohort`
            when the score asks for values across teams that were not given.
        score: The final score; `None` unless scored.
        possible: What the trial could have earned with every finding satisfied and every quantity at the
            best value that its check declares, if it declares one, with the facts of this trial; `None`
            when that has no value, or less than the score.
        ledger: The score taken apart; `None` unless scored.
        assumptions: What undecided findings counted as.
        digits: Decimal digits of score and ledger.
        provenance: Where it came from.
        task: The task score taken apart, before any value across teams enters; `None`
            when the rule set has none, or it is withheld.
        cohort: The values across teams it was priced with.
        missing: In words, what the score needs from all teams or what no record states.
        adjusted: The score after decisions of stewards; all the rest is the automatic result, untouched.
        ledger_method: `slopes`, as docs/ledger.md says; `sequence` where the version that wrote it took
            products apart factor by factor, in written order.
        interval: The scores that the log allows, where it leaves any open; `None` where all are the score.
    """

    measured: Measured
    rule_set_title: str
    checks: Mapping[str, CheckUse]
    notes: tuple[str, ...]
    rules: str
    status: Annotated[str, Meta(pattern="^(scored|incomplete|needs_cohort)$")]
    score: Decimal | None
    possible: Decimal | None
    ledger: Ledger | None
    assumptions: tuple[Assumption, ...]
    digits: Annotated[int, Meta(ge=0, le=12)]
    provenance: Provenance
    task: Ledger | None = None
    cohort: CohortValues = field(default_factory=CohortValues)
    missing: str = ""
    adjusted: Adjusted | None = None
    ledger_method: Annotated[str, Meta(pattern="^(sequence|slopes)$")] = SLOPES
    interval: ScoreInterval | None = None

    @property
    def is_open(self) -> bool:
        """Whether the log leaves the score open: there is none, or others are possible as well."""
        if self.interval is None and self.status != "incomplete":
            return False
        if self.adjusted is None:
            return True
        decisions = self.adjusted.adjustments
        if any(one.score is not None or one.disqualified for one in decisions):
            return False
        decided = {one.finding for one in decisions}
        return any(
            one.finding not in decided
            for one in self.assumptions
            if one.policy in ("worst", "best", "withhold")
        )

    @property
    def is_former(self) -> bool:
        """Whether the former method took its ledger apart."""
        return self.ledger_method == SEQUENCE

    @property
    def automatic(self) -> Result:
        """The result without the decisions of stewards."""
        return replace(self, adjusted=None)

    @property
    def findings(self) -> Mapping[str, Finding]:
        """What the checks found, by id such as `separation#1`."""
        return self.measured.findings

    def _repr_html_(self) -> str:
        """What a notebook shows: the score, the lines right below it, and what was violated."""
        kind = self.status if self.score is None else "scored"
        return result_html(
            f"{self.measured.trial} under {self.provenance.rule_set.id}: {kind}",
            self.final,
            self.possible,
            self.ledger,
            self.findings,
            self.interval,
            self.measured.unofficial,
        )

    @property
    def final(self) -> Decimal | None:
        """The score that counts: the adjusted one, where there is one."""
        return self.score if self.adjusted is None else self.adjusted.score

    def __post_init__(self) -> None:
        # Checked whenever a result is made, so also when one is read from a file that was edited.
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
        leave_out_empty(self, "interval")
        leave_out_empty(self.cohort, "lost", "withheld")
