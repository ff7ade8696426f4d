"""What a log map itself makes of whole messages: events with numbers, and facts of the trial."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from ariac_score.checks.contracts import Decoder
from ariac_score.logs.gather.message_fields import nearest, number_paths, value_at
from ariac_score.trial.channels import Channel
from ariac_score.trial.events import WATCHING, Event, EventNumber
from ariac_score.trial.work import Fact

__all__ = ["ChannelDecoder", "facts_of"]


@dataclass(frozen=True)
class ChannelDecoder:
    """Decodes the messages of one channel: by its plugin, or as the event it names; with its numbers.

    Attributes:
        channel: Of the log map.
        decoder: The plugin that it names, where it names one.
    """

    channel: Channel
    decoder: Decoder | None = None

    def decode(self, msgtype: str, message: object, t_s: float) -> Any:
        """What a message says; `None` where it says nothing.

        Raises:
            ValueError: The message is unusable, as where a field is no number.
        """
        item = self.decoder.decode(msgtype, message, t_s) if self.decoder else self._event(t_s)
        if not isinstance(item, Event) or item.kind == WATCHING or not self.channel.numbers:
            return item
        numbers = (
            EventNumber(number.name, _number(message, number.field), number.unit)
            for number in self.channel.numbers
        )
        return replace(item, numbers=(*item.numbers, *numbers))

    def _event(self, t_s: float) -> Event | None:
        named = self.channel.event
        return None if named is None else Event(t_s, named.kind, named.subject)


def facts_of(channel: Channel, message: object) -> Iterator[tuple[str, Fact]]:
    """The facts of the trial that a message of a channel states.

    Raises:
        ValueError: A field is there, but is neither a number nor a text; or it is not there.
    """
    for name, path in channel.facts:
        value = _field(message, path)
        yield name, value if isinstance(value, str) else _number(message, path)


def _number(message: object, path: str) -> float:
    value = _field(message, path)
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if isinstance(value, str) or not math.isfinite(number):
        raise ValueError(f"its field {path!r} is no finite number")
    return number


def _field(message: object, path: str) -> Any:
    try:
        return value_at(message, path)
    except AttributeError:
        there = nearest(path, number_paths(message), what="fields")
        raise ValueError(f"it has no field {path!r}; {there}") from None
