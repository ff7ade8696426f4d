"""The contract of live sources, and how one is found by its address.

A source gives the items that a scan of a recording gives (`ariac_score.logs.containers.items`), one by one
as they arrive, and what only happens live: that messages were lost, that the connection broke, came back, or
is over. Its items go through the same decoders and log maps as those of a recording.

A distribution brings a source by an entry point of the group `ariac_score.sources`, whose name is the scheme
of its addresses: a function (or class) of the address that gives a `LiveSource` and connects to nothing yet.
Its module imports a library that not everybody has only in `open`, so that a list of what is installed needs
none of them.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

from ariac_score.checks.guarded import broken
from ariac_score.checks.registry import Registry
from ariac_score.errors import PluginError, ScoreError, UsageError, did_you_mean
from ariac_score.installed.captured_output import fault_of
from ariac_score.installed.points import unreadable_hint
from ariac_score.logs.containers.items import Connection, Message

__all__ = [
    "GROUP",
    "Announced",
    "Disconnected",
    "Ended",
    "LiveItem",
    "LiveSource",
    "Lost",
    "Received",
    "Reconnected",
    "source_at",
]

GROUP = "ariac_score.sources"

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+._-]+):(?!\\)")
"""At least two characters: `C:\\trial.mcap` is a path."""


@dataclass(frozen=True, eq=False)
class Announced:
    """A channel that messages may come by; before its first message, and anew after a reconnection.

    Two types, or two publishers that the source tells apart, on one topic are two connections.

    Attributes:
        connection: Topic, type, encoding (`cdr` or `ros1`), definition and its format (`ros2msg`, `ros2idl`,
            `ros1msg`), publisher; all but the topic may be empty where the source does not know.
        latched: Whether it gives its last message again to who comes later.
    """

    connection: Connection
    latched: bool = False


class Received(NamedTuple):
    """One message.

    Attributes:
        message: Its connection as announced (the same object), its bytes, its number by its publisher (0: it
            has none), and as `stamp_ns` the time of recording in ns since 1970: of a network source the
            referee's own clock when the bytes arrived (`time.time_ns()`), of a recording that is replayed or
            grows its log time. A message without a stamp in its header is judged by it, and so is recorded.
        sent_ns: What the source says of when it was sent, ns; `None` where it says nothing. It is recorded,
            and nothing is judged by it: clocks of other machines are not the referee's.
    """

    message: Message
    sent_ns: int | None = None


@dataclass(frozen=True)
class Lost:
    """Messages that were sent and did not come, as soon as the source sees it.

    Attributes:
        topic: Of which; empty where they may be of any.
        since_ns: From when on nothing is known of it, in the clock of `Message.stamp_ns`.
        until_ns: Up to when.
        cause: In words, such as `numbers 41 to 43 are missing`.
        count: How many; `None` where nobody knows.
    """

    topic: str
    since_ns: int
    until_ns: int
    cause: str
    count: int | None = None


@dataclass(frozen=True)
class Disconnected:
    """The source is gone; it tries to come back until it is closed.

    Attributes:
        since_ns: When, ns since 1970.
        cause: In words.
    """

    since_ns: int
    cause: str


@dataclass(frozen=True)
class Reconnected:
    """The source is back; its channels are announced anew.

    Attributes:
        since_ns: When it was last heard before, ns since 1970.
        until_ns: When it came back.
        same: Whether it is the same server as before, not one that was started again; `None`: nobody knows.
    """

    since_ns: int
    until_ns: int
    same: bool | None = None


@dataclass(frozen=True)
class Ended:
    """Nothing will come any more.

    Attributes:
        cause: In words, such as `the recording is over`.
    """

    cause: str


LiveItem = Announced | Received | Lost | Disconnected | Reconnected | Ended


class LiveSource(Protocol):
    """What messages come from while they are sent.

    `open`, `next` and `close` are called from one thread. A source that listens in threads of its own takes
    the time of a message there, as soon as its bytes are read, and keeps it in a bounded queue: what it drops
    it gives as `Lost`.

    Attributes:
        address: As given, without user names and passwords: it is shown and recorded.
        sees_losses: Whether a message that is lost on the way shows, by numbers or otherwise. Where it does
            not, silence of a topic is no evidence that nothing was sent.
        stamps: Whose clock `Message.stamp_ns` is: `arrival`, the referee's own, or `recorder`, that of a
            recording.
    """

    @property
    def address(self) -> str: ...  # noqa: D102

    @property
    def sees_losses(self) -> bool: ...  # noqa: D102

    @property
    def stamps(self) -> Literal["arrival", "recorder"]: ...  # noqa: D102

    def open(self, topics: frozenset[str] | None) -> None:
        """Connect, and ask for topics.

        Args:
            topics: Names with and without leading slash; `None`: all there are. Others may come and count for
                nothing. One that appears later is subscribed then.

        Raises:
            UsageError: The address makes no sense, or a library is not installed.
            LiveError: Nothing answers there, or what answers is something else.
        """
        ...

    def next(self, timeout_s: float) -> LiveItem | None:
        """The next item; `None` where none came in so many seconds. After `Ended` always `Ended`.

        Raises:
            ScoreError: The source says what nothing can be made of.
        """
        ...

    def close(self) -> None:
        """End within 2 s, also while the other side hangs; a second call does nothing."""
        ...


def source_at(address: str, registry: Registry | None = None) -> LiveSource:
    """The source for an address; it is not connected yet.

    Args:
        address: `SCHEME:…`, such as `foxglove://cell:8765` or `replay:trial.mcap?speed=2`, or the path of a
            recording that grows.
        registry: The installed plugins.

    Raises:
        UsageError: No installed source has this scheme, or the address makes no sense to it.
        PluginError: The source is broken.

    >>> source_at("replay:examples/kitting_near_miss.mcap?speed=0").stamps
    'recorder'
    """
    registry = registry or Registry()
    found = _SCHEME.match(address)
    scheme = found[1].lower() if found and not Path(address).exists() else "file"
    names = registry.names(GROUP)
    if scheme not in names:
        raise UsageError(
            f"there is no source {scheme!r}",
            hint=did_you_mean(scheme, names, what="installed") + unreadable_hint(),
        )
    plugin = registry.find(GROUP, scheme)
    try:
        make = plugin.load()
    except PluginError as error:
        if isinstance(error.__cause__, ImportError):
            error.hint = f"pip install 'ariac-score[{scheme}]'"
        raise
    try:
        source: LiveSource = make(address)
    except ScoreError:
        raise
    except Exception as cause:  # a stranger's code may raise anything
        raise broken(plugin, f"raised {fault_of(cause)}") from cause
    return source
