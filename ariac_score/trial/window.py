"""When the competition was: as the log shows its start and end, as the rules have it, or undecided."""

from __future__ import annotations

from dataclasses import replace

from ariac_score.trial.model import Trial
from ariac_score.trial.statements import BY_RULES, NOBODY, RECORDER, Statement

__all__ = ["RECORDING", "lacks_start", "with_window"]

RECORDING = "recording"
"""The rules take the whole recording for the competition where it shows neither start nor end."""


def lacks_start(trial: Trial, rule: str) -> bool:
    """Whether nothing states when the competition started, of a log that does not show its end.

    Args:
        trial: As read.
        rule: `window:` of the rule set.
    """
    return trial.started_s is None and rule != RECORDING and not _official_alone(trial)


def _official_alone(trial: Trial) -> bool:
    """Whether all that has a time is the official record, which is of the competition from its start on."""
    return trial.official is not None and not trial.sampled


def with_window(trial: Trial, rule: str) -> Trial:
    """The trial with what states its window, or with why that is undecided.

    Args:
        trial: As read.
        rule: `window:` of the rule set.
    """
    if trial.recorded is None:  # nothing has a time: there is nothing that a window could leave out
        return trial
    start_s, end_s = trial.started_s, trial.ended_s
    others = tuple(statement for statement in trial.statements if statement.fact != "window")
    if start_s is not None and end_s is not None and start_s < end_s:
        return trial
    if trial.official is not None and _official_alone(trial):
        stated = Statement("window", RECORDER, (trial.official.source,), "its times count from the start")
        return replace(trial, statements=tuple(sorted((*others, stated))))
    if start_s is None and end_s is None and rule == RECORDING:
        whole = Statement("window", BY_RULES, detail="the whole recording")
        return replace(trial, statements=tuple(sorted((*others, whole))))
    if start_s is not None and end_s is not None:
        why = "the log shows an end of the competition that is not after its start"
    else:
        missing = "the end" if end_s is None else "the start"
        missing = "start and end" if start_s is None and end_s is None else missing
        why = f"the log does not show {missing} of the competition"
    nobody = Statement("window", NOBODY, detail=why)
    return replace(trial, window_open=why, statements=tuple(sorted((*others, nobody))))
