"""What is open about a trial of which nobody knows when the competition started, or what came at its end."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.open_findings import Cause, OpenFindings
from ariac_score.checks.when_cut import when_cut_of
from ariac_score.engine.ask import ask
from ariac_score.engine.prepared import Prepared, PreparedCheck
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Trial
from ariac_score.trial.window import lacks_start

__all__ = ["ended_at_cut", "opened_by_cut", "opened_by_window"]

_RULES = "ariac_score.rules"
_NO_START = "the log does not show the start of the competition"


def opened_by_window(
    found: list[Finding], each: PreparedCheck, trial: Trial, prepared: Prepared
) -> tuple[list[Finding], list[OpenFindings]]:
    """The findings of a check, with those undecided that hang on a start or an end which nobody knows.

    What a monitor has not seen may have happened before the recording or after it. Whether a submission
    counts, nobody knows; and where the end is not known, what was not handed in may have been later.

    Args:
        found: What the check found, as if the recording were the competition.
        each: The check.
        trial: The trial.
        prepared: The rule set.

    Returns:
        The findings, and for each subject whose submission may count or not, what was found in either case.
    """
    if not trial.window_open:
        return found, []
    if prepared.rule_set.checks[each.name].group == _RULES:
        return _of_rule(found, each, trial, prepared)
    said = any(f.verdict is Verdict.INCONCLUSIVE and trial.window_open in f.message for f in found)
    undecided = all(f.verdict is Verdict.NOT_APPLICABLE for f in found)
    if said or undecided:  # who watches nobody misses nothing
        return found, []
    message = f"{trial.window_open}, so part of it may be missing"
    more = replace(Finding.inconclusive("trial", message, span=trial.window), check=each.name)
    return [*found, more], []


def ended_at_cut(trial: Trial, prepared: Prepared) -> Trial:
    """A trial whose log is cut off, as if the competition had ended there; as it is where the log is whole.

    So a monitor says what was seen, no more and no less; what may have come later is added to it.

    Args:
        trial: The trial.
        prepared: The rule set, which says what the competition was where the log shows neither end.
    """
    if trial.cut is None or not trial.cut.open_end or trial.recorded is None:
        return trial
    events = [*trial.events, Event(trial.recorded.end_s, COMPETITION_ENDED)]
    if trial.started_s is None and not lacks_start(trial, prepared.rule_set.authority.window):
        events.append(Event(trial.recorded.start_s, COMPETITION_STARTED))
    found = replace(trial, events=tuple(sorted(events)), window_open="")
    is_open = found.started_s is None
    return replace(found, window_open=_NO_START) if is_open else found


def opened_by_cut(
    found: list[Finding], worlds: list[OpenFindings], each: PreparedCheck, trial: Trial, prepared: Prepared
) -> tuple[list[Finding], list[OpenFindings]]:
    """The findings of a check, with what is open because the log is cut off and the trial went on.

    Args:
        found: What it found: a monitor as if the competition had ended there.
        worlds: What it leaves open.
        each: The check.
        trial: The trial.
        prepared: The rule set.
    """
    says = when_cut_of(each.check)
    if trial.cut is None or not trial.cut.open_end or says == "kept" or _is_whole(says, trial):
        return found, worlds
    is_rule = prepared.rule_set.checks[each.name].group == _RULES
    if is_rule and says == "witnessed":
        return [_opened(f, trial.window_open) if _may_come(f, trial) else f for f in found], worlds
    if is_rule:
        return [_opened(finding, trial.window_open) for finding in found], []
    if says == "adds" and _nobody_ever(found, trial):
        return found, worlds
    message = f"{trial.window_open}, and nobody knows what came after"
    later = replace(Finding.inconclusive("trial", message), check=each.name)
    if says != "adds":
        return [later], []
    said = [f for f in found if f.verdict is Verdict.INCONCLUSIVE and f.subject == "trial" and f.span is None]
    return [*(f for f in found if f not in said), later], worlds


def _is_whole(says: str, trial: Trial) -> bool:
    """Whether a check rests on an official record that is no part of the log that is cut off."""
    return says == "official" and trial.cut is not None and trial.cut.official


def _may_come(finding: Finding, trial: Trial) -> bool:
    """Whether something may have been handed in later that a rule misses."""
    path, submitted = set(finding.subject.split("/")), {one.item_id for one in trial.submissions}
    return finding.verdict is Verdict.VIOLATED and not path & submitted


def _nobody_ever(found: Sequence[Finding], trial: Trial) -> bool:
    """Whether a monitor found nobody to watch, and a configuration says that nobody comes."""
    nobody = all(f.verdict is Verdict.NOT_APPLICABLE and f.subject == "trial" for f in found)
    return nobody and any(kind.endswith(" bodies") for kind in trial.witnessed)


def _of_rule(
    found: list[Finding], each: PreparedCheck, trial: Trial, prepared: Prepared
) -> tuple[list[Finding], list[OpenFindings]]:
    submitted = {one.item_id for one in trial.submissions}
    without = (
        ask(each.plugin, each.name, each.check, replace(trial, submissions=()), words=prepared.words)
        if submitted
        else found
    )
    seen, unseen = _by_subject(found), _by_subject(without)
    items = {item.id for item in trial.work}
    ends = trial.ended_s is not None
    open_ = [_hangs_on_window(finding, seen, unseen, submitted, items, ends=ends) for finding in found]
    worlds: list[OpenFindings] = []
    for subject in dict.fromkeys(f.subject for f, is_open in zip(found, open_, strict=True) if is_open):
        if seen[subject] != unseen.get(subject, Counter()):
            number = sum(len(one.best) + len(one.worst) for one in worlds)
            worlds.append(_either(subject, found, without, trial, number))
    findings = [
        _opened(finding, trial.window_open) if is_open else finding
        for finding, is_open in zip(found, open_, strict=True)
    ]
    return findings, worlds


def _either(
    subject: str, seen: Sequence[Finding], unseen: Sequence[Finding], trial: Trial, number: int
) -> OpenFindings:
    """What is found about a subject if its submission counts, and if it does not."""
    both = [[f for f in found if f.subject == subject] for found in (seen, unseen)]
    both.sort(key=lambda found: [f.verdict for f in found].count(Verdict.VIOLATED))
    check = both[0][0].check if both[0] else both[1][0].check
    spans = () if trial.window is None else (trial.window,)
    best, worst = (
        {f"{check}#{world}{number + i}": f for i, f in enumerate(found, start=1)}
        for world, found in zip(("best", "worst"), both, strict=True)
    )
    cause = Cause(f"{trial.window_open}, so whether what was handed in counts is open", spans=spans)
    return OpenFindings(check, subject, best, worst, (cause,))


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


def _opened(finding: Finding, why: str) -> Finding:
    message = f"{why}, so whether this counts is open: {finding.message}"
    return replace(
        finding, verdict=Verdict.INCONCLUSIVE, message=message, robustness=None, quantities={}, units={}
    )
