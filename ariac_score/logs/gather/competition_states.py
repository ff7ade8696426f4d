"""When a competition started and ended, by a topic that states it again and again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

from ariac_score.errors import LogError
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.window import stated_late, stated_on

__all__ = ["STATES", "changes"]

STATES = frozenset({COMPETITION_STARTED, COMPETITION_ENDED})
"""Simulators publish the state ten times a second, and several states mean that the competition runs or is
over. Of consecutive messages with the same meaning only the first is an event."""

_OVER_AND_OVER = 3
"""A topic with so many messages of one meaning in a row states it over and over."""

_AGAIN = 2
"""One that says anything twice does not speak only of changes: so it said what it says first before, too."""

SILENT_S = 10.0
"""Where a topic is silent for longer than this, and then says that it runs, nobody knows since when.
Whoever leaves out the words between moves the start behind what happened in that time."""


def changes(
    topic: str,
    items: Sequence[Any],
    builder: TrialBuilder,
    times_s: Sequence[float] = (),
    *,
    delays_s: Sequence[float] | FloatArray = (),
    at_a_rate: bool = False,
) -> Iterator[Any]:
    """What the messages of a topic say, each state once, where it begins.

    A topic that repeats itself, and says in its first message that the competition runs, was recorded too
    late: when the competition started is not in the log. The same holds where it was silent for long before.

    Such a topic says at its rate what has changed since its last message, so a start or an end that it states
    was at any moment between both. One that speaks only when something changes says it at once; but its start
    was at any moment of the silence before, too, for words that were left out make any topic look like it.

    Args:
        topic: Its name.
        items: What each message says, in recorded order; `None`: nothing.
        builder: Takes the defects, and says when the recording begins.
        times_s: When each message came, s of trial time.
        delays_s: By how much later than it was sent each message came, s; empty: none was late.
        at_a_rate: Whether the log map says that it is published at a rate.

    Raises:
        LogError: The competition runs again after it was over.
    """
    late = _begins_running(items) and (at_a_rate or _repeats(items, _AGAIN))
    first = next((i for i, item in enumerate(items) if _state(item) == COMPETITION_STARTED), None)
    silent_s = _silent_s(first, times_s, builder)
    repeats = bool(times_s) and (at_a_rate or _repeats(items, _OVER_AND_OVER))
    before: str | None = None
    ended: Event | None = None
    unknown = False
    for place, item in enumerate(items):
        state = _state(item)
        if state == COMPETITION_STARTED and ended is not None:
            raise LogError(
                f"topic {topic} says at {item.t_s:.3f} s that the competition runs, after it said at "
                f"{ended.t_s:.3f} s that it was over",
                file=builder.file,
                hint="two publishers contradict each other, or it holds two trials: score them one by one",
            )
        if state == COMPETITION_STARTED and before is None and first is not None and place > first:
            message = (
                f"it says at {item.t_s:.3f} s once more that the competition runs, after a word that means "
                "neither that nor its end: the simulation may have been reset; what was before counts as well"
            )
            builder.defect("runs_again", topic, 1, message)
        if late and place == 0:
            unknown = True
            message = (
                "its first message already says that the competition runs: it started before the recording, "
                "and nobody knows when"
            )
            builder.defect("late_recording", topic, 1, message)
        elif place == first and silent_s > SILENT_S:
            unknown = True
            message = (
                f"it says nothing for {silent_s:.3f} s, and then that the competition runs, so nobody knows "
                "since when"
            )
            builder.defect("late_recording", topic, 1, message)
        elif unknown and state == COMPETITION_STARTED:
            pass  # it runs again, or still: no start, for it ran before
        elif state is not None and state != before and (repeats or place == first):
            since_s = _silent_s(place, times_s, builder)
            since_s += float(delays_s[place - 1]) if place and len(delays_s) else 0.0
            stated = stated_late(item, since_s) if since_s > 0.0 else item
            runs_s = _runs_s(place, items, times_s, delays_s) if state == COMPETITION_STARTED else 0.0
            yield stated_on(stated, runs_s) if runs_s > 0.0 else stated
        elif item is not None and (state is None or state != before):
            yield item
        if state == COMPETITION_ENDED and ended is None:
            ended = item
        before = state


def _silent_s(place: int | None, times_s: Sequence[float], builder: TrialBuilder) -> float:
    """How long a topic was silent before one of its messages, s; 0 where nobody knows."""
    if place is None or not times_s:
        return 0.0
    if place:
        return times_s[place] - times_s[place - 1]
    return 0.0 if builder.recorded is None else times_s[place] - builder.recorded.start_s


def _runs_s(
    place: int, items: Sequence[Any], times_s: Sequence[float], delays_s: Sequence[float] | FloatArray
) -> float:
    """For how long a topic says, from one of its messages on, that the competition runs, s."""
    if not times_s:
        return 0.0
    last = place
    while last + 1 < len(items) and _state(items[last + 1]) == COMPETITION_STARTED:
        last += 1
    sent_s = times_s[last] - (float(delays_s[last]) if len(delays_s) else 0.0)
    return max(0.0, sent_s - times_s[place])


def _begins_running(items: Sequence[Any]) -> bool:
    return bool(items) and _state(items[0]) == COMPETITION_STARTED


def _repeats(items: Sequence[Any], times: int) -> bool:
    """Whether a topic says so many times in a row what it has said already."""
    states = (_state(item) for item in items)
    return any(state is not None and len(list(same)) >= times for state, same in groupby(states))


def _state(item: Any) -> str | None:
    return item.kind if isinstance(item, Event) and item.kind in STATES else None
