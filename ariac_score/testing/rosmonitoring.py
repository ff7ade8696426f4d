"""Writing event logs as ROSMonitoring writes them."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ariac_score.testing.bags import Recorded

__all__ = ["monitored_events", "write_event_log"]


def monitored_events(messages: Sequence[Recorded], *, origin_ns: int) -> Iterator[dict[str, Any]]:
    """The events a monitor would see: the fields of a message, its topic and its time.

    Args:
        messages: Such as `recorded_messages(trial)`.
        origin_ns: Subtracted from the stamps, ns: `ORIGIN_NS` of the trial gives simulation
            seconds, 0 wall-clock time.
    """
    for message in messages:
        time_s = (message.t_ns - origin_ns) / 1e9
        yield {**_plain(message.fields), "topic": message.topic.strip("/"), "time": time_s}


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return value


def write_event_log(path: Path, messages: Sequence[Recorded], *, origin_ns: int | None = None) -> Path:
    """Write an event log as ROSMonitoring 3 does: sorted keys, one event a line.

    Args:
        path: The file.
        messages: Such as `recorded_messages(trial)`.
        origin_ns: As in `monitored_events`; by default the first stamp.

    Returns:
        The path.
    """
    if origin_ns is None:
        origin_ns = min((message.t_ns for message in messages), default=0)
    events = monitored_events(messages, origin_ns=origin_ns)
    text = "".join(json.dumps(event, sort_keys=True) + "\n" for event in events)
    path.write_text(text, encoding="utf-8")
    return path
