"""Whether a rule or monitor keeps what it says of a log that is cut off (`when_cut`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.trial.computed import Computed
from ariac_score.trial.cut import MARGIN_S, Cut
from ariac_score.trial.cut_off import known_part, with_cut
from ariac_score.trial.events import COMPETITION_ENDED, Event
from ariac_score.trial.model import Trial
from ariac_score.trial.spans import Span

__all__ = ["SHARES", "cut_off", "does_not_stay"]

SHARES = (0.25, 0.5, 0.75)
"""After which shares of its recording a trial is cut off."""

_SAME_S = 1e-6
_SEEN = (Verdict.SATISFIED, Verdict.VIOLATED)


def cut_off(trial: Trial, share: float, *, ended: bool) -> Trial | None:
    """A trial of whose log only the first part is there; `None`: nothing of it has a time.

    Args:
        trial: All of it.
        share: How much of its recording is known to be whole.
        ended: Whether the competition is taken to have ended there, as for a monitor.
    """
    whole = trial.recorded
    if whole is None or not whole.duration_s:
        return None
    until_s = whole.start_s + share * whole.duration_s
    # What can be read goes on for a moment in which nothing is judged, so that speeds are as they were.
    kept = {
        name: replace(one, t=one.t[there], values=one.values[there])
        for name, one in trial.signals.items()
        if not isinstance(one, Computed)
        for there in (one.t <= until_s + MARGIN_S,)
    }
    events = tuple(event for event in trial.events if event.kind != COMPETITION_ENDED)
    cut = Cut("made", "cut off", until_s)
    part = with_cut(known_part(replace(trial, signals=kept, events=events, cut=cut)), about_work=True)
    if not ended:
        return part
    # Every monitor is told so; see `engine.open_window`.
    return replace(part, events=(*part.events, Event(until_s, COMPETITION_ENDED)), window_open="")


def does_not_stay(
    says: str,
    whole: Sequence[Finding],
    trial: Trial,
    is_rule: bool,
    ask: Callable[[Trial], Sequence[Finding]],
) -> str:
    """What it finds of the first part of a trial that does not stay although it says so; empty: all does.

    Args:
        says: As `when_cut`.
        whole: What it finds of the whole trial.
        trial: The trial.
        is_rule: Whether it is asked about what was handed in.
        ask: Its findings on a trial that was read anew.
    """
    for share in SHARES:
        part = cut_off(trial, share, ended=not is_rule)
        if part is None or part.recorded is None:
            return ""
        found = list(ask(part))
        submitted = {one.item_id for one in part.submissions}
        if lost := _lost(says, whole, found, part.recorded.end_s, submitted):
            return lost
    return ""


def _lost(
    says: str, whole: Sequence[Finding], part: Sequence[Finding], until_s: float, submitted: set[str]
) -> str:
    if says in ("kept", "official"):
        if _counted(whole) != _counted(part):
            return f"it finds something else of a log that is cut off at {until_s:g} s"
        return ""
    for one in part:
        if says == "adds" and one.verdict is Verdict.VIOLATED and not any(_covers(w, one) for w in whole):
            return f"{one.subject!r} is violated up to a cut at {until_s:g} s alone"
        # Not handed in by then: the engine leaves that open itself.
        comes = one.verdict is Verdict.VIOLATED and not set(one.subject.split("/")) & submitted
        if (
            says == "witnessed"
            and one.verdict in _SEEN
            and not comes
            and not _counted([one]) <= _counted(whole)
        ):
            return f"{one.subject!r} is {one.verdict.value} up to a cut at {until_s:g} s alone"
    return ""


def _counted(findings: Sequence[Finding]) -> Counter[object]:
    """Verdicts by subject, with how many there are; in the last digits numbers may differ."""
    numbers = ((f, tuple((k, round(v, 6)) for k, v in sorted(f.quantities.items()))) for f in findings)
    return Counter((f.subject, f.verdict, f.critical, of) for f, of in numbers)


def _covers(finding: Finding, part: Finding) -> bool:
    if finding.verdict is not part.verdict or finding.subject != part.subject:
        return False
    if finding.span is None or part.span is None:
        return True
    wider = Span(finding.span.start_s - _SAME_S, finding.span.end_s + _SAME_S)
    return wider.start_s <= part.span.start_s and part.span.end_s <= wider.end_s
