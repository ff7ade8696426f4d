"""When a competition started and ended, by a topic that states it again and again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ariac_score.errors import LogError
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event

__all__ = ["STATES", "changes"]

STATES = frozenset({COMPETITION_STARTED, COMPETITION_ENDED})
"""Simulators publish the state ten times a second, and several states mean that the competition runs or is
over. Of consecutive messages with the same meaning only the first is an event."""

_OVER_AND_OVER = 3
"""A topic that begins with so many messages of one meaning states it over and over, so it did before, too."""


SILENT_S = 10.0
"""Where a topic is silent for longer than this, and then says that it runs, nobody knows since when.
Whoever leaves out the words between moves the start behind what happened in that time."""


def changes(
    topic: str, items: Sequence[Any], builder: TrialBuilder, times_s: Sequence[float] = ()
) -> Iterator[Any]:
    """What the messages of a topic say, each state once, where it begins.

    A topic that states over and over that the competition runs, from its first message on, was recorded too
    late: when the competition started is not in the log. The same holds where it was silent for long before.

    Args:
        topic: Its name.
        items: What each message says, in recorded order; `None`: nothing.
        builder: Takes the defects, and says when the recording begins.
        times_s: When each message came, s of trial time.

    Raises:
        LogError: The competition runs again after it was over.
    """
    late = [_state(item) for item in items[:_OVER_AND_OVER]] == [COMPETITION_STARTED] * _OVER_AND_OVER
    first = next((i for i, item in enumerate(items) if _state(item) == COMPETITION_STARTED), None)
    silent_s = _silent_s(first, times_s, builder)
    before: str | None = None
    ended: Event | None = None
    for place, item in enumerate(items):
        state = _state(item)
        if state == COMPETITION_STARTED and ended is not None:
            raise LogError(
                f"topic {topic} says at {item.t_s:.3f} s that the competition runs, after it said at "
                f"{ended.t_s:.3f} s that it was over",
                file=builder.file,
                hint="two publishers contradict each other, or it holds two trials: score them one by one",
            )
        if late and place == 0:
            message = (
                "its first message already says that the competition runs: it started before the recording, "
                "and nobody knows when"
            )
            builder.defect("late_recording", topic, 1, message)
        elif place == first and silent_s > SILENT_S:
            message = (
                f"it says nothing for {silent_s:.3f} s, and then that the competition runs, so nobody knows "
                "since when"
            )
            builder.defect("late_recording", topic, 1, message)
        elif item is not None and (state is None or state != before):
            yield item
        if state == COMPETITION_ENDED and ended is None:
            ended = item
        before = state


def _silent_s(first: int | None, times_s: Sequence[float], builder: TrialBuilder) -> float:
    """How long a topic was silent before it first said that the competition runs, s; 0 where nobody knows."""
    if first is None or not times_s:
        return 0.0
    if first:
        return times_s[first] - times_s[first - 1]
    return 0.0 if builder.recorded is None else times_s[first] - builder.recorded.start_s


def _state(item: Any) -> str | None:
    return item.kind if isinstance(item, Event) and item.kind in STATES else None
