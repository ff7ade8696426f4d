"""When the competition was: as the log shows its start and end, as the rules have it, or undecided."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event, EventNumber
from ariac_score.trial.model import Trial
from ariac_score.trial.spans import Span
from ariac_score.trial.statements import BY_RULES, NOBODY, RECORDER, Statement
from ariac_score.trial.work import announced_s

__all__ = [
    "RAN",
    "RECORDING",
    "Lasted",
    "WindowEnds",
    "earliest_start_s",
    "ends_of",
    "lacks_start",
    "lasted_of",
    "lasting",
    "stated_late",
    "stated_on",
    "surely_of",
    "with_window",
]

RECORDING = "recording"
"""The rules take the whole recording for the competition where it shows neither start nor end."""


LATE = "late_by_at_most"
"""The number of a start or an end that says by how much earlier it may have been, in s."""
RAN = "ran_for_at_least"
"""The number of a start that says how long the log goes on to say that the competition runs, in s."""

_SHORTEST_S = 1e-3


def stated_late(event: Event, by_s: float) -> Event:
    """A start or an end of the competition that was so much earlier at most.

    A topic that is published at a rate tells it that much too late.

    >>> stated_late(Event(5.0, COMPETITION_STARTED), 0.1).number("late_by_at_most", unit="s")
    0.1
    """
    return replace(event, numbers=(*event.numbers, EventNumber(LATE, by_s, "s")))


def stated_on(event: Event, for_s: float) -> Event:
    """A start of a competition that runs so long after it, at least.

    >>> stated_on(Event(5.0, COMPETITION_STARTED), 3.0).number("ran_for_at_least", unit="s")
    3.0
    """
    return replace(event, numbers=(*event.numbers, EventNumber(RAN, for_s, "s")))


@dataclass(frozen=True)
class WindowEnds:
    """Between which moments the competition started, and between which it ended.

    Attributes:
        start: When it may have started, s of trial time.
        end: When it may have ended.
    """

    start: Span
    end: Span

    def of(self, trial: Trial, *, longest: bool) -> Trial:
        """The trial as if the competition had been as long as it may have been, or as short."""
        start_s = self.start.start_s if longest else self.start.end_s
        end_s = self.end.end_s if longest else max(self.end.start_s, start_s + _SHORTEST_S)
        return lasting(trial, Span(start_s, end_s))

    @property
    def words(self) -> str:
        """How well either is known, in words."""
        both = (("start", self.start), ("end", self.end))
        known = [f"its {name} within {_length(span)}" for name, span in both if span.duration_s > 0.0]
        return f"the log tells only roughly when the competition was: {', '.join(known)}"


@dataclass(frozen=True)
class Lasted:
    """For how long a competition may have lasted of which the log does not state both ends exactly.

    Attributes:
        least_s: At least so long, s.
        most_s: At most so long, s; `None`: nobody knows.
        why: Why that is open, in words.
    """

    least_s: float
    most_s: float | None
    why: str


def lasting(trial: Trial, span: Span) -> Trial:
    """The trial as if the competition had been a stretch of it, exactly."""
    others = [e for e in trial.events if e.kind not in (COMPETITION_STARTED, COMPETITION_ENDED)]
    ends = (Event(span.start_s, COMPETITION_STARTED), Event(span.end_s, COMPETITION_ENDED))
    return replace(trial, events=tuple(sorted([*others, *ends])))


def lasted_of(trial: Trial) -> Lasted | None:
    """For how long the competition may have lasted; `None` where the log, or the rules, state it exactly."""
    ends = ends_of(trial)
    if ends is not None:
        least_s = max(0.0, ends.end.start_s - ends.start.end_s)
        return Lasted(least_s, ends.end.end_s - ends.start.start_s, ends.words)
    is_cut = trial.cut is not None and trial.cut.open_end
    if not trial.window_open and not is_cut:
        return None
    sure = surely_of(trial) if None in (trial.started_s, trial.ended_s) else None
    least_s = 0.0 if sure is None else sure.duration_s
    return Lasted(least_s, None, trial.window_open or "nobody knows when the competition ended")


def surely_of(trial: Trial) -> Span | None:
    """What was certainly within the competition, as far as its length is open; `None`: nobody knows of any.

    A recording that goes on may show what came after, and one that begins early what was before. Of what has
    a time only work is certain to have been within, and the time for which the log says that it runs.
    """
    ends, start_s, end_s = ends_of(trial), trial.started_s, trial.ended_s
    if ends is not None:
        in_order = ends.start.end_s < ends.end.start_s
        return Span(ends.start.end_s, ends.end.start_s) if in_order else None
    if start_s is not None and end_s is not None:  # stated, though other messages of it are missing
        return trial.window if start_s < end_s else None
    known = _of_work_s(trial)
    if start_s is not None:
        known.append(start_s)
        known += [e.t_s + (e.number(RAN, unit="s") or 0.0) for e in trial.events_of(COMPETITION_STARTED)]
    elif end_s is not None:  # stated late, it was at some moment since the word before
        known = [_earliest_s(trial, COMPETITION_ENDED, end_s), *(t_s for t_s in known if t_s <= end_s)]
    return Span(min(known), max(known)) if known and min(known) < max(known) else None


def _of_work_s(trial: Trial) -> list[float]:
    """When work was announced, s, as far as that is known.

    Not when it was handed in: a team may call after the end, and nobody may answer.
    """
    return [t_s for t_s in map(announced_s, trial.work) if t_s is not None]


def _length(span: Span) -> str:
    return f"{1000.0 * span.duration_s:.0f} ms"


def ends_of(trial: Trial) -> WindowEnds | None:
    """Between which moments the competition started and ended; `None` where the log states both exactly.

    Nothing is announced outside of a competition, so each announcement narrows it.
    """
    window, started_s, ended_s = trial.window, trial.started_s, trial.ended_s
    if window is None or started_s is None or ended_s is None or not started_s < ended_s:
        return None
    first_s = _earliest_s(trial, COMPETITION_STARTED, started_s)
    last_s = _earliest_s(trial, COMPETITION_ENDED, ended_s)
    if (first_s, last_s) == (started_s, ended_s):
        return None
    known = _of_work_s(trial)
    start_s = min([started_s, *(t_s for t_s in known if t_s >= first_s)])
    end_s = max([last_s, *(t_s for t_s in known if t_s <= ended_s)])
    opened_s = window.start_s  # by work that was announced early, however early the start was
    start = Span(opened_s, opened_s) if opened_s <= first_s else Span(first_s, start_s)
    return WindowEnds(start, Span(min(end_s, ended_s), ended_s))


def earliest_start_s(trial: Trial) -> float | None:
    """The first moment at which the competition may have started, s; `None` where the log does not say."""
    started_s = trial.started_s
    return None if started_s is None else _earliest_s(trial, COMPETITION_STARTED, started_s)


def _earliest_s(trial: Trial, kind: str, at_s: float) -> float:
    stated = [event for event in trial.events_of(kind) if event.t_s == at_s]
    late_s = [event.number(LATE, unit="s") or 0.0 for event in stated]
    return at_s - min(late_s, default=0.0)  # another log may state the same moment exactly


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
