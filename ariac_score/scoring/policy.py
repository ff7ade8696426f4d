"""What an undecided finding counts as where a rule set says it for the check that made it."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

from msgspec import Meta

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure

__all__ = ["MADE", "OPEN", "POLICIES", "Assumed", "Assumption", "Policy", "assume", "ideal"]

OPEN = "open"
"""The policy of a check for which the rule set says nothing else."""

POLICIES = {
    OPEN: "the score lies between those of the best and the worst that it can be",
    "withhold": "no score until it is decided",
    "zero": "the trial scores 0",
    "worst_case": "counted as a critical violation, at full depth for all of the time",
    "exclude": "left out, as if the check had not run",
}
Policy = Annotated[str, Meta(pattern=f"^({'|'.join(POLICIES)})$")]
MADE = {
    **{name: words for name, words in POLICIES.items() if name != OPEN},
    "worst": "counted at its worst",
    "best": "counted at its best",
}
"""What can have been made of an undecided finding."""
Made = Annotated[str, Meta(pattern=f"^({'|'.join(MADE)})$")]


@dataclass(frozen=True)
class Assumption:
    """One undecided finding and what was made of it.

    Attributes:
        finding: Its id.
        check: The check that made it.
        policy: What it counts as, one of `MADE`.
        message: Why it is undecided.
    """

    finding: str
    check: str
    policy: Made
    message: str


@dataclass(frozen=True)
class Assumed:
    """Findings ready for pricing.

    Attributes:
        findings: By id, undecided ones replaced as their policy says.
        assumptions: What was assumed, in order of finding id.
    """

    findings: Mapping[str, Finding]
    assumptions: tuple[Assumption, ...]

    @property
    def withheld(self) -> tuple[Assumption, ...]:
        """The undecided findings that leave no score."""
        return tuple(a for a in self.assumptions if a.policy == "withhold")

    @property
    def zeroed(self) -> tuple[Assumption, ...]:
        """The undecided findings that make the score 0."""
        return tuple(a for a in self.assumptions if a.policy == "zero")


def assume(findings: Mapping[str, Finding], policies: Mapping[str, str], *, priced: Iterable[str]) -> Assumed:
    """Replace undecided findings by what the rule set says they count as.

    Args:
        findings: By id.
        policies: Policy by check.
        priced: The checks the score depends on; undecided findings of others
            change nothing and are reported elsewhere.
    """
    relevant = frozenset(priced)
    kept: dict[str, Finding] = {}
    assumptions: list[Assumption] = []
    for key in sorted(findings):
        finding = findings[key]
        if finding.verdict is not Verdict.INCONCLUSIVE or finding.check not in relevant:
            kept[key] = finding
            continue
        policy = policies.get(finding.check, OPEN)
        if policy == OPEN:  # priced in the worlds that it leaves possible
            kept[key] = finding
            continue
        assumptions.append(Assumption(key, finding.check, policy, finding.message))
        if policy == "worst_case":
            kept[key] = _worst(finding)
        elif policy == "exclude":
            kept[key] = replace(finding, verdict=Verdict.NOT_APPLICABLE)
        else:
            kept[key] = finding
    return Assumed(kept, tuple(assumptions))


def _worst(finding: Finding) -> Finding:
    quantities = dict(finding.quantities)
    if finding.span:  # else nobody knows how long, and a formula that prices the time refuses
        # A relative depth is at most 1, so its integral over a stretch is at most the stretch's length.
        for name in ("time_in_violation_s", "relative_depth_integral_s"):
            quantities[name] = finding.span.duration_s
    return replace(finding, verdict=Verdict.VIOLATED, quantities=quantities, critical=True)


def ideal(
    findings: Mapping[str, Finding], measures: Mapping[str, Mapping[str, Measure]] | None = None
) -> dict[str, Finding]:
    """The same findings, had everything gone right: what the trial could have earned.

    Args:
        findings: By id.
        measures: What checks declare of their quantities, by check and quantity. What has a best value is
            at it; what has none, as most times, stays as it was measured. Without it all do.
    """
    return {
        key: _ideal(finding, (measures or {}).get(finding.check, {})) for key, finding in findings.items()
    }


def _ideal(finding: Finding, declared: Mapping[str, Measure]) -> Finding:
    if finding.verdict is Verdict.NOT_APPLICABLE:
        return finding
    # Points are what was earned: the reference of a ledger is 0 there, and no best.
    best = {name: one.reference for name, one in declared.items() if one.role != "points"}
    # What nobody could judge has no quantities, and would count as a factor of 0.
    unknown = finding.verdict is Verdict.INCONCLUSIVE and not finding.quantities
    found = {n: by for n, by in best.items() if by is not None and (unknown or n in finding.quantities)}
    if finding.verdict is Verdict.SATISFIED and not found:
        return finding
    return replace(finding, verdict=Verdict.SATISFIED, quantities={**finding.quantities, **found})
