"""What is open about a trial of which nobody knows when the competition started or ended."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.engine.ask import ask
from ariac_score.engine.prepared import Prepared, PreparedCheck
from ariac_score.trial.model import Trial

__all__ = ["opened_by_window"]

_RULES = "ariac_score.rules"


def opened_by_window(
    found: list[Finding], each: PreparedCheck, trial: Trial, prepared: Prepared
) -> list[Finding]:
    """The findings of a check, with those undecided that hang on a start or an end which nobody knows.

    What a monitor has not seen may have happened before the recording or after it. Whether a submission
    counts, nobody knows; and where the end is not known, what was not handed in may have been later.

    Args:
        found: What the check found, as if the recording were the competition.
        each: The check.
        trial: The trial.
        prepared: The rule set.
    """
    if not trial.window_open:
        return found
    if prepared.rule_set.checks[each.name].group == _RULES:
        return _of_rule(found, each, trial, prepared)
    said = any(f.verdict is Verdict.INCONCLUSIVE and "the competition" in f.message for f in found)
    undecided = all(f.verdict is Verdict.NOT_APPLICABLE for f in found)
    if said or undecided:  # who watches nobody misses nothing
        return found
    message = f"{trial.window_open}, so part of it may be missing"
    return [*found, replace(Finding.inconclusive("trial", message, span=trial.window), check=each.name)]


def _of_rule(
    found: list[Finding], each: PreparedCheck, trial: Trial, prepared: Prepared
) -> list[Finding]:
    if trial.official is not None:  # an official record has judged submissions itself
        return found
    submitted = {one.item_id for one in trial.submissions}
    without = (
        ask(each.plugin, each.name, each.check, replace(trial, submissions=()), words=prepared.words)
        if submitted
        else found
    )
    seen, unseen = _by_subject(found), _by_subject(without)
    items = {item.id for item in trial.work}
    return [
        _open(finding, trial.window_open)
        if _hangs_on_window(finding, seen, unseen, submitted, items, ends=trial.ended_s is not None)
        else finding
        for finding in found
    ]


def _hangs_on_window(
    finding: Finding,
    seen: dict[str, Counter[object]],
    unseen: dict[str, Counter[object]],
    submitted: Iterable[str],
    items: Iterable[str],
    *,
    ends: bool,
) -> bool:
    path = finding.subject.split("/")
    if path[0] not in items or finding.verdict in (Verdict.NOT_APPLICABLE, Verdict.INCONCLUSIVE):
        return False
    if seen[finding.subject] != unseen.get(finding.subject, Counter()):
        return True
    # Handed in, it was found wanting whether that counts or not; not handed in, it may have been later.
    return not ends and finding.verdict is Verdict.VIOLATED and not set(path) & set(submitted)


def _by_subject(findings: Sequence[Finding]) -> dict[str, Counter[object]]:
    by: dict[str, Counter[object]] = {}
    for f in findings:
        by.setdefault(f.subject, Counter())[f.verdict, f.critical, tuple(sorted(f.quantities.items()))] += 1
    return by


def _open(finding: Finding, why: str) -> Finding:
    message = f"{why}, so whether this counts is open: {finding.message}"
    return replace(
        finding, verdict=Verdict.INCONCLUSIVE, message=message, robustness=None, quantities={}, units={}
    )
