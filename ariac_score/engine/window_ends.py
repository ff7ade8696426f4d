"""What is open about a competition of which the log states only at a rate when it started and ended."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.open_findings import Cause, OpenFindings
from ariac_score.engine.ask import ask_worlds
from ariac_score.engine.prepared import Prepared, PreparedCheck
from ariac_score.monitors.worlds import alike
from ariac_score.trial.model import Trial
from ariac_score.trial.spans import Span
from ariac_score.trial.sums import exact_sum
from ariac_score.trial.window import WindowEnds, ends_of, lasting, surely_of

__all__ = ["open_throughout", "opened_by_ends"]

Asked = tuple[list[Finding], list[OpenFindings]]
"""What a check finds in one competition, and what it leaves open."""

_RULES = "ariac_score.rules"


def opened_by_ends(asked: Asked, each: PreparedCheck, trial: Trial, prepared: Prepared) -> list[OpenFindings]:
    """What a check leaves open, with what it would find were the competition as short or as long as can be.

    A longer competition has all that a shorter one has. So the best world is that of the shortest one, and
    the worst that of the longest; of a check of which the opposite is true, they are taken the other way
    round. Rules judge what was handed in, which was in the competition however long it was.

    Args:
        asked: What the check found, and leaves open, in the competition that the log states.
        each: The check.
        trial: The trial.
        prepared: The rule set.
    """
    if prepared.rule_set.checks[each.name].group == _RULES:
        return asked[1]

    def of(competition: Trial) -> Asked:
        given = each.plugin, each.name, each.check, competition
        return ask_worlds(*given, notice=_said_before, words=prepared.words)

    ends = ends_of(trial)
    if ends is None and not trial.window_open:
        return asked[1]
    if ends is None:
        sure = surely_of(trial)
        known = replace(trial, window_open="")
        certain = {} if sure is None else _by_subject(of(lasting(known, sure)))
        return _not_certain(each.name, _by_subject(asked), certain, trial)
    shortest, longest = (of(ends.of(trial, longest=is_longest)) for is_longest in (False, True))
    lengths = [_by_subject(one) for one in (shortest, asked, longest)]
    subjects = sorted({subject for found in lengths for subject in found})
    opened = {
        subject: _opened([found.get(subject, _NOTHING) for found in lengths], ends, trial.window)
        for subject in subjects
    }
    return _numbered(each.name, {subject: both for subject, both in opened.items() if both is not None})


def open_throughout(found: Sequence[Finding], trial: Trial) -> list[Finding]:
    """What is undecided in all of the competition is so in the longest that it may have been."""
    ends, window = ends_of(trial), trial.window
    if ends is None:
        return list(found)
    longest = ends.of(trial, longest=True).window
    return [
        replace(one, span=longest) if one.verdict is Verdict.INCONCLUSIVE and one.span == window else one
        for one in found
    ]


def _not_certain(
    check: str, asked: Mapping[str, _Both], certain: Mapping[str, _Both], trial: Trial
) -> list[OpenFindings]:
    """What is open where nobody knows when the competition started or ended: what may have been outside it.

    A monitor that says so itself has said it; the others know of no competition but the one they are shown.
    """
    opened: dict[str, _Both | None] = {}
    for subject, both in asked.items():
        within = _settled(certain.get(subject, _NOTHING).best, Verdict.SATISFIED)
        if _badness(within) < _badness(both.best):
            nothing = Finding.satisfied(subject, "what is broken may have been outside of the competition")
            best = within or (replace(nothing, check=check),)
            cause = Cause(trial.window_open, spans=() if trial.window is None else (trial.window,))
            opened[subject] = _Both(best, both.worst, (*both.causes, cause), tight=False, is_open=True)
        else:
            opened[subject] = both if both.is_open else None
    return _numbered(check, {subject: both for subject, both in opened.items() if both is not None})


def _said_before(origin: str, text: str) -> None:
    """A plugin that prints says the same of each length."""


@dataclass(frozen=True)
class _Both:
    """What is found about a subject in both worlds of one competition.

    Attributes:
        best, worst: The findings.
        causes: Why they differ; empty where nothing is open.
        tight: Whether both may have been.
        is_open: Whether the check itself says that they differ.
    """

    best: tuple[Finding, ...] = ()
    worst: tuple[Finding, ...] = ()
    causes: tuple[Cause, ...] = ()
    tight: bool = True
    is_open: bool = False


_NOTHING = _Both()


def _by_subject(asked: Asked) -> dict[str, _Both]:
    found: dict[str, list[Finding]] = {}
    for finding in asked[0]:
        found.setdefault(finding.subject, []).append(finding)
    both = {subject: _Both(tuple(own), tuple(own)) for subject, own in found.items()}
    for one in asked[1]:
        best, worst = tuple(one.best.values()), tuple(one.worst.values())
        both[one.subject] = _Both(best, worst, one.causes, one.tight, is_open=True)
    return both


def _opened(lengths: Sequence[_Both], ends: WindowEnds, window: Span | None) -> _Both | None:
    """Both worlds of a subject over all lengths, the shortest first; `None` where nothing is open."""
    stated = lengths[1]
    # A shorter competition is the better one, and a longer one the worse, unless the check says otherwise.
    # What applied, and was kept, may earn points, which what never applied does not.
    kinder = min(lengths, key=lambda one: (_badness(one.best), _never_applied(one.best)))
    never = [replace(one, worst=one.best) for one in lengths if _never_applied(one.best)]
    harsher = max(
        [*never, *reversed(lengths)], key=lambda one: (_badness(one.worst), _never_applied(one.worst))
    )
    if alike(kinder.best, stated.best) and alike(harsher.worst, stated.worst):
        return stated if stated.is_open else None
    if not stated.is_open and _undecided(stated.best) and _undecided(harsher.worst):
        return None  # it is open as a whole, and is priced so
    cause = Cause(ends.words, spans=tuple(span for span in (ends.start, ends.end) if span.duration_s > 0.0))
    # Where all of the competition is open anyway, to know its ends would narrow nothing.
    is_whole = any(window in one.spans for one in stated.causes)
    causes = stated.causes if is_whole else tuple(dict.fromkeys((*stated.causes, cause)))
    best, worst = _settled(kinder.best, Verdict.SATISFIED), _settled(harsher.worst, Verdict.VIOLATED)
    return _Both(best, worst, causes, kinder.tight and harsher.tight, is_open=True)


def _badness(findings: Iterable[Finding]) -> tuple[int, int, float, float]:
    broken = [one for one in findings if one.verdict is not Verdict.SATISFIED]
    broken = [one for one in broken if one.verdict is not Verdict.NOT_APPLICABLE]
    time_s, depth_s = (
        exact_sum(one.quantities.get(name, 0.0) for one in broken)
        for name in ("time_in_violation_s", "relative_depth_integral_s")
    )
    return sum(one.critical for one in broken), len(broken), time_s, depth_s


def _never_applied(findings: Sequence[Finding]) -> bool:
    return bool(findings) and all(one.verdict is Verdict.NOT_APPLICABLE for one in findings)


def _undecided(findings: Sequence[Finding]) -> bool:
    return bool(findings) and all(one.verdict is Verdict.INCONCLUSIVE for one in findings)


def _settled(findings: Iterable[Finding], verdict: Verdict) -> tuple[Finding, ...]:
    return tuple(
        replace(one, verdict=verdict) if one.verdict is Verdict.INCONCLUSIVE else one for one in findings
    )


def _numbered(check: str, opened: Mapping[str, _Both]) -> list[OpenFindings]:
    """What is open of each subject, with ids of which no two of a check are the same."""
    found: list[OpenFindings] = []
    for subject, both in opened.items():
        before = sum(len(one.best) + len(one.worst) for one in found)
        best, worst = (
            {f"{check}#{world}{before + number}": one for number, one in enumerate(findings, start=1)}
            for world, findings in (("best", both.best), ("worst", both.worst))
        )
        found.append(OpenFindings(check, subject, best, worst, both.causes, both.tight))
    return found
