"""Trials of which a log is cut off: what of them is known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ariac_score.errors import LogError
from ariac_score.trial.cut import Cut
from ariac_score.trial.model import Trial
from ariac_score.trial.spans import Span
from ariac_score.trial.statements import NOBODY, Statement

__all__ = ["joined_cut", "known_part", "lacks_work", "with_cut", "with_open_work"]


def known_part(part: Trial) -> Trial:
    """A part of a trial without what lies behind the time up to which its log is known to be whole.

    What a log did not show up to a cut, it may have shown later: it witnesses nothing but what it has.
    Where it shows that the competition had ended before, nothing is missing.

    Raises:
        LogError: So little can be read that nothing is known.
    """
    cut, recorded = part.cut, part.recorded
    if cut is None:
        return part
    if cut.until_s is None or recorded is None:
        return replace(part, witnessed=frozenset())
    until_s = cut.until_s
    if until_s <= recorded.start_s:
        raise LogError(
            f"it is cut off, and too little of it can be read: {recorded.duration_s:.3f} s, of whose end "
            f"{recorded.end_s - until_s:.3f} s do not count",
            file=cut.file,
            hint="there is nothing to be scored in it",
        )
    start_s, end_s = part.started_s, part.ended_s
    if end_s is not None and end_s <= until_s and (start_s is None or start_s < end_s):
        return replace(part, cut=replace(cut, ended=True))
    return replace(
        part,
        events=tuple(event for event in part.events if event.t_s <= until_s),
        submissions=tuple(one for one in part.submissions if one.submitted_s <= until_s),
        recorded=Span(recorded.start_s, until_s),
        witnessed=frozenset(),
    )


def joined_cut(parts: Sequence[Trial]) -> Cut | None:
    """Of several logs that are cut off, how far the one goes that lacks most; `None`: all are whole."""
    cuts = [part.cut for part in parts if part.cut is not None]
    return min(cuts, key=lambda cut: (cut.ended, cut.until_s is not None, cut.until_s or 0.0), default=None)


def lacks_work(part: Trial) -> bool:
    """Whether a log may have shown more work than can be read of it."""
    return part.cut is not None and not part.cut.ended


def with_open_work(trial: Trial, parts: Sequence[Trial]) -> Trial:
    """A trial with whether all is known that was asked for, where a log of it is cut off.

    Args:
        trial: Made of all its logs.
        parts: Each of them, and every other file.
    """
    cut = trial.cut
    if cut is None or cut.ended or not any(lacks_work(part) for part in parts):
        return trial
    stated = {item.id for part in parts if part.origin and part.origin.role != "log" for item in part.work}
    why = ""
    if not stated:
        why = (
            "what was asked for is known from the log alone, and more may have followed (give "
            "the configuration that says it: --trial-config)"
        )
    elif changed := sorted(stated - {item.id for item in trial.work}):
        why = f"nobody knows whether {changed[0]!r} came, which changes what was asked for"
    official = cut.official or any(part.official is not None and not lacks_work(part) for part in parts)
    return replace(trial, cut=replace(cut, work_open=why, official=official))


def with_cut(trial: Trial, *, about_work: bool) -> Trial:
    """The trial with what nobody knows because a log of it is cut off.

    Args:
        trial: As read, with what states its window.
        about_work: Whether anything is asked about work.
    """
    cut = trial.cut
    if cut is None or cut.ended:
        return trial
    cut = replace(cut, work_open=cut.work_open if about_work else "")
    if trial.ended_s is not None or trial.recorded is None:  # another log shows the end
        return replace(trial, cut=cut)
    why = f"the log is cut off at {trial.recorded.end_s:.3f} s"
    if trial.started_s is None and trial.window_open:
        why += ", and does not show the start of the competition"
    others = tuple(statement for statement in trial.statements if statement.fact != "window")
    statements = tuple(sorted((*others, Statement("window", NOBODY, detail=why))))
    return replace(trial, window_open=why, statements=statements, cut=replace(cut, open_end=True))
