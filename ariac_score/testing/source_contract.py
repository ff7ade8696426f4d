"""The contract of live sources as checks, against a system that sends while they run."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

from ariac_score.engine.prepared import prepare
from ariac_score.engine.score import score_trial
from ariac_score.errors import LiveError, ScoreError
from ariac_score.live.source import (
    Announced,
    Disconnected,
    Ended,
    LiveItem,
    LiveSource,
    Received,
    Reconnected,
)
from ariac_score.live.watch import Settings, Watch
from ariac_score.logs.containers.items import Connection
from ariac_score.results.result_file import as_json
from ariac_score.testing.contract_check import ContractCheck, ContractError, origin_of

__all__ = ["source_checks"]

_HINT = "the contract is in the docstrings of ariac_score.live.source"
_CLOSES_S = 2.0
_CLOCK_S = 60.0


def source_checks(
    make: Callable[[], LiveSource], rules: str = "paper2020", *, limit_s: float = 30.0, silent_s: float = 1.0
) -> list[ContractCheck]:
    """Everything the contract of a live source requires.

    Args:
        make: Gives a new source each time it is called, not connected, of a system that sends a trial from
            when on the source subscribes; the contract needs some messages that the rules read.
        rules: A rule set that reads what is sent.
        limit_s: Each check ends after so many seconds at the latest.
        silent_s: A system that has sent something, and then nothing for so long, has sent everything.

    Example:
        >>> from ariac_score.live.source import source_at
        >>> checks = source_checks(lambda: source_at("replay:examples/kitting_near_miss.mcap?speed=0"))
        >>> [check.name for check in checks]
        ['address', 'items', 'closes', 'watch_is_score']
    """
    checked = _CheckedSource(make, rules, limit_s, silent_s)
    return [
        ContractCheck("address", "its address shows no password", checked.address),
        ContractCheck("items", "channels come before their messages, with stamps and bytes", checked.items),
        ContractCheck("closes", "it closes within 2 s, twice, and has ended then", checked.closes),
        ContractCheck("watch_is_score", "'watch' says what 'score' says", checked.watch_is_score),
    ]


class _CheckedSource:
    def __init__(self, make: Callable[[], LiveSource], rules: str, limit_s: float, silent_s: float) -> None:
        self._make, self._rules = make, rules
        self._limit_s, self._silent_s = limit_s, silent_s

    def address(self) -> None:
        if "@" in (shown := self._make().address):
            raise self._broken(f"shows a user name or a password in its address {shown!r}")

    def items(self) -> None:
        source, announced = self._make(), set[Connection]()
        source.open(None)
        try:
            gone = False
            for item in self._heard(source):
                if isinstance(item, Announced):
                    if item.connection in announced:
                        raise self._broken(f"announces one connection of {item.connection.topic} twice")
                    announced.add(item.connection)
                elif isinstance(item, Received):
                    self._check_message(item, announced, by_arrival=source.stamps == "arrival")
                elif isinstance(item, Reconnected | Disconnected):
                    if isinstance(item, Reconnected) and not gone:
                        raise self._broken("is back and was never gone")
                    gone = isinstance(item, Disconnected)
        finally:
            source.close()

    def closes(self) -> None:
        source = self._make()
        source.open(None)
        source.next(0.1)
        for _ in range(2):
            start_s = time.monotonic()
            source.close()
            if (took_s := time.monotonic() - start_s) > _CLOSES_S:
                raise self._broken(f"took {took_s:.1f} s to close")

    def watch_is_score(self) -> None:
        with TemporaryDirectory() as folder:
            record = Path(folder, "seen.mcap")
            stopping = _Stopping(self._make(), self._limit_s, self._silent_s)
            settings = Settings(period_s=1e9, tail_period_s=1e9)
            watch = Watch(stopping, prepare(self._rules), record, settings=settings)
            watched = _said(lambda: as_json(watch.run()))
            scored = _said(lambda: as_json(score_trial(record, self._rules)))
        if watched != scored:
            raise self._broken("gives another result when it is watched than its recording when it is scored")

    def _heard(self, source: LiveSource) -> list[LiveItem]:
        stopping, items = _Stopping(source, self._limit_s, self._silent_s), list[LiveItem]()
        while not isinstance(item := stopping.next(0.05), Ended):
            if item is not None:
                items.append(item)
        if not any(isinstance(one, Received) for one in items):
            raise self._broken(f"gave no message within {self._limit_s:g} s")
        return items

    def _check_message(self, item: Received, announced: set[Connection], *, by_arrival: bool) -> None:
        message = item.message
        topic = message.connection.topic
        if message.connection not in announced:
            raise self._broken(f"gives a message of {topic} whose connection it never announced")
        if not isinstance(message.payload, bytes):
            raise self._broken(f"gives a message of {topic} that is {type(message.payload).__name__}")
        if by_arrival and abs(time.time_ns() - message.stamp_ns) > (_CLOCK_S + self._limit_s) * 1e9:
            raise self._broken(f"stamps a message of {topic} by another clock than the referee's")

    def _broken(self, what: str) -> ContractError:
        return ContractError(what, origin=origin_of(self._make()).origin, hint=_HINT)


class _Stopping:
    """A source that ends when nothing comes any more."""

    def __init__(self, source: LiveSource, limit_s: float, silent_s: float) -> None:
        self._source, self._silent_s = source, silent_s
        self.address, self.sees_losses, self.stamps = source.address, source.sees_losses, source.stamps
        self._until_s = time.monotonic() + limit_s
        self._quiet_s = self._until_s

    def open(self, topics: frozenset[str] | None) -> None:
        self._source.open(topics)

    def next(self, timeout_s: float) -> LiveItem | None:
        item, now_s = self._source.next(timeout_s), time.monotonic()
        if isinstance(item, Received):
            self._quiet_s = now_s + self._silent_s
        if item is None and now_s >= min(self._quiet_s, self._until_s):
            return Ended("nothing comes any more")
        return Ended("it was heard for long enough") if now_s >= self._until_s else item

    def close(self) -> None:
        self._source.close()


def _said(question: Callable[[], str]) -> str:
    try:
        return question()
    except LiveError:
        raise
    except ScoreError as error:
        return str(error.cause)
