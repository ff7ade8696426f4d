"""Watching one cell: what comes is recorded, taken in and judged, and in the end scored like any log.

The engine asks the reader of a log for its trial. Here that reader takes the items of a live source until
they end, and gives the trial that it has taken in: so nothing of the way to a result is stated twice, and who
scores the recording comes to the same.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from ariac_score.checks.contracts import LogDescription, Reader, Wanted
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import Prepared
from ariac_score.engine.read import find_run
from ariac_score.engine.score import score_parts
from ariac_score.errors import ScoreError
from ariac_score.live.judging import Judged, Judging, judging_of
from ariac_score.live.mcap_writer import McapWriter
from ariac_score.live.running import Note, Running
from ariac_score.live.so_far import MONITORS, SoFar
from ariac_score.live.source import (
    Announced,
    Disconnected,
    Ended,
    LiveItem,
    LiveSource,
    Lost,
    Received,
    Reconnected,
)
from ariac_score.live.tail import Tail
from ariac_score.logs.bundle import Bundle
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.logs.rosbag import RecordingIntake, RosbagReader
from ariac_score.results.result import Result
from ariac_score.trial.model import Trial

__all__ = ["Settings", "Watch"]

_SAID = frozenset({"missing_messages", "two_publishers", "undecodable_messages", "unusable_messages"})
"""Kinds of defects that are said when they are found; others may pass as more of the trial comes."""
_OTHERWISE_AFTER_S = (2.0, 5.0, 15.0)
_IN_ITS_OWN_WAY = "its competition reads recordings in its own way: the score comes in the end"
_WAIT_S = 0.05
_BACK_NS = 10**9
_FIRST_NUMBER = 1 << 20
"""Channels are numbered so far apart that nobody takes their numbers for one count of all messages."""


LOOK_EVERY_S = 0.1
"""How far apart looks at the margins are in a trial that comes all at once, as chunks of recordings do, s."""

CHEAP_LOOK_S = 0.01
"""A look at the margins that takes no more of a processor may follow the one before at once."""


@dataclass(frozen=True)
class Settings:
    """How a cell is watched.

    Attributes:
        patience_s: How long a source may be gone before the trial is over, s.
        period_s: The least time between two judgements of the trial so far, s.
        share: The part of a processor that judging while the trial goes on may take.
        tail_period_s: The least time between two looks at the margins of the moment, s.
        tail_share: The part of a processor that these may take where one takes no more than `CHEAP_LOOK_S`;
            dearer ones, as of a robot of many links, may take the less, the dearer they are.
        least_tail_share: The part that they may always take.
        grace_s: How long to go on listening when the competition has ended, s: messages come late.
        apart: Whether the trial so far is judged in a process of its own, so that margins do not wait for it.
    """

    patience_s: float = 30.0
    period_s: float = 0.5
    share: float = 0.08
    tail_period_s: float = 0.001
    tail_share: float = 0.75
    least_tail_share: float = 0.08
    grace_s: float = 2.0
    apart: bool = True

    def until_next_look_s(self, cost_s: float) -> float:
        """How long to wait after a look at the margins that took so much of a processor, s."""
        cheap = min(1.0, CHEAP_LOOK_S / cost_s) if cost_s > 0 else 1.0
        share = max(self.tail_share * cheap**3, min(self.least_tail_share, self.tail_share))
        return max(self.tail_period_s, cost_s * (1 / share - 1))


class Watch:
    """One cell that is watched.

    Args:
        source: Of its messages; it is opened and closed here.
        prepared: The rules.
        record: A new MCAP file for what comes.
        also: Configurations of trial or team, as for `score_trial`.
        settings: How.
        told: Called with the state whenever it changes, on the thread that watches.
        now_s: A clock, s.
    """

    def __init__(
        self,
        source: LiveSource,
        prepared: Prepared,
        record: Path,
        *,
        also: Sequence[Path] = (),
        settings: Settings = Settings(),  # a value
        told: Callable[[Running], None] = lambda _: None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._source, self._prepared, self._record, self._also = source, prepared, record, tuple(also)
        self._settings, self._told, self._now_s = settings, told, now_s
        self._stopped = ""
        watching = {name for name, each in prepared.checks.items() if each.plugin.group == MONITORS}
        self.state = Running(source.address, monitors=frozenset(watching), sees_losses=source.sees_losses)

    def stop(self, cause: str = "it was stopped") -> None:
        """End the trial; may be called from a signal handler or another thread."""
        self._stopped = self._stopped or cause

    @property
    def stopped(self) -> bool:
        """Whether the trial is over, or ending."""
        return bool(self._stopped)

    def run(self) -> Result:
        """Watch until the end; the result is that of the recording.

        Raises:
            LiveError: The source cannot be reached, or the recording cannot be written.
            ScoreError: What came cannot be scored; the recording is there.
        """
        writer = McapWriter(self._record)
        try:
            bundle, readers = self._found()
            (log,) = (part for part in bundle.parts if part.path == self._record)
            reader = _LiveReader(self, readers[log.reader], writer, bundle, readers, log.reader)
            result: Result | None = None
            try:
                result = score_parts(self._record, bundle, {**readers, log.reader: reader}, self._prepared)
            except ScoreError:
                if not reader.over or not self._is_read_otherwise(bundle, reader):
                    raise
            if result is None or self._is_read_otherwise(bundle, reader):
                result = score_parts(self._record, *self._found(), self._prepared)
            self._tell(replace(self.state, result=result, so_far=result, open=""))
            return result
        finally:
            writer.close()
            self._source.close()

    def _is_read_otherwise(self, bundle: Bundle, reader: _LiveReader) -> bool:
        """Whether the recording is read otherwise now that it holds something.

        A competition may read its own recordings in its own way, and know them by what is in them.
        """
        own = getattr(reader.own, "reader", reader.own)
        return not isinstance(own, RosbagReader) or self._found()[0] != bundle

    def _found(self) -> tuple[Bundle, Mapping[str, Reader]]:
        by = self._prepared.rule_set.authority.work
        registry: Registry = self._prepared.registry
        return find_run(self._record, registry, also=self._also, root=self._record, work_by=by)

    def _listen(self, intake: _Intake, asking: _Asking) -> None:
        """Take items until nothing comes any more."""
        settings, gone_s, over_s = self._settings, None, None
        shown, next_tail_s, next_of_trial_s = 0, 0.0, 0.0
        while not self._stopped:
            item = self._source.next(_WAIT_S)
            if isinstance(item, Ended):
                self.stop(item.cause)
                break
            if item is not None:
                for kind, text in intake.take(item):
                    self._note(intake.elapsed_s, kind, text)
                gone_s = self._gone_since_s(item, gone_s)
            now_s = self._now_s()
            if gone_s is not None and now_s - gone_s > settings.patience_s:
                self.stop(f"the source was gone for {settings.patience_s:g} s")
            if over_s is not None and now_s - over_s > settings.grace_s:
                self.stop("the competition has ended")
            due = now_s >= next_tail_s or intake.elapsed_s >= next_of_trial_s
            if due and intake.messages != shown:
                shown, began_s = intake.messages, time.thread_time()
                now, places = intake.tail.moment(intake.elapsed_s)
                said = replace(self.state, now=now, places=places, elapsed_s=intake.elapsed_s)
                self._tell(replace(said, messages=shown))
                wait_s = settings.until_next_look_s(time.thread_time() - began_s)
                next_tail_s = self._now_s() + wait_s
                next_of_trial_s = intake.elapsed_s + max(wait_s, LOOK_EVERY_S)
            result = asking.look(intake, now_s)
            if result is not None and result.measured.cut is not None and result.measured.cut.ended:
                over_s = now_s if over_s is None else over_s
        self._tell(replace(self.state, ended=self._stopped, messages=intake.messages))

    def _gone_since_s(self, item: LiveItem, gone_s: float | None) -> float | None:
        if isinstance(item, Disconnected):
            self._tell(replace(self.state, connected=False))
            return self._now_s() if gone_s is None else gone_s
        if gone_s is not None and isinstance(item, Reconnected | Received):
            self._tell(replace(self.state, connected=True))
            return None
        return gone_s

    def _note(self, at_s: float, kind: str, text: str) -> None:
        self._tell(replace(self.state, notes=(*self.state.notes, Note(at_s, kind, text))))

    def _tell(self, state: Running) -> None:
        self.state = state
        self._told(state)


class _Intake:
    """What has come: recorded, and taken in as who reads the recording would."""

    def __init__(self, wanted: Wanted, writer: McapWriter, prepared: Prepared, judging: Judging) -> None:
        self._writer = writer
        self.tail, self.judging = Tail(wanted, prepared, writer.path), judging
        self.kept = RecordingIntake(wanted, writer.path)
        self._read_as: dict[Connection, Connection] = {}
        self._numbers: dict[Connection, int] = {}
        self._types: dict[str, str] = {}
        self._first_ns = self._latest_ns = 0
        self.messages = 0

    @property
    def elapsed_s(self) -> float:
        """From the first to the latest message, s."""
        return (self._latest_ns - self._first_ns) / 1e9

    def take(self, item: LiveItem) -> list[tuple[str, str]]:
        """Take one item; what there is to be said of it: its kind, and words."""
        if isinstance(item, Received):
            return self._message(item)
        if isinstance(item, Announced):
            return self._announced(item)
        if isinstance(item, Lost):
            self._leave_out(item.topic, item.count or 1)
            of, count = item.topic or "any topic", "" if item.count is None else f"{item.count} "
            return [("lost", f"{count}messages of {of} were lost: {item.cause}")]
        if isinstance(item, Disconnected):
            self._leave_out("", 1)
            return [("disconnected", f"the source is gone: {item.cause}")]
        if isinstance(item, Reconnected):
            gone_s = (item.until_ns - item.since_ns) / 1e9
            return [("reconnected", f"the source is back; nothing is known of {gone_s:.1f} s")]
        return []

    def _announced(self, item: Announced) -> list[tuple[str, str]]:
        offered = item.connection
        read = self._writer.declare(offered, latched=item.latched)
        self._read_as[offered] = read
        # A publisher that comes back goes on being numbered where it was, so that its absence shows.
        self._numbers[read] = _FIRST_NUMBER * len(self._read_as)
        for taker in (self.kept, self.tail, self.judging):
            taker.take(read)
        before = self._types.setdefault(offered.topic, offered.type)
        if before != offered.type:
            self._types[offered.topic] = offered.type
            return [
                ("type", f"topic {offered.topic} is now {offered.type or 'of no type'}, and was {before}")
            ]
        return []

    def _message(self, item: Received) -> list[tuple[str, str]]:
        offered, notes = item.message, []
        read = self._read_as[offered.connection]
        sequence = offered.sequence
        if not sequence:
            sequence = self._numbers[read] = self._numbers[read] + 1
        message = Message(read, offered.stamp_ns, offered.payload, sequence)
        if not self.messages:
            self._first_ns = self._latest_ns = message.stamp_ns
        if message.stamp_ns < self._latest_ns - _BACK_NS:
            back_s = (self._latest_ns - message.stamp_ns) / 1e9
            notes.append(("clock", f"times of recording go back by {back_s:.1f} s on {read.topic}"))
        self._latest_ns = max(self._latest_ns, message.stamp_ns)
        self.messages += 1
        self._writer.write(message, item.sent_ns)
        for taker in (self.kept, self.tail, self.judging):
            taker.take(message)
        return notes

    def _leave_out(self, topic: str, count: int) -> None:
        """Leave out numbers, which is how a recording shows that messages are missing."""
        for connection in self._numbers:
            if topic.lstrip("/") in ("", connection.topic.lstrip("/")):
                self._numbers[connection] += count


@dataclass
class _LiveReader:
    """Reads a trial from what comes live, as the reader of its recording would."""

    watch: Watch
    own: Reader
    writer: McapWriter
    bundle: Bundle
    readers: Mapping[str, Reader]
    name: str
    over: bool = False
    """Whether everything has come, and is recorded."""

    @property
    def facts(self) -> object:
        """Those of the reader of recordings."""
        return getattr(self.own, "facts", None)

    def can_read(self, path: Path) -> bool:
        """Whether the reader of recordings can."""
        return self.own.can_read(path)

    def describe(self, path: Path) -> LogDescription:
        """What the reader of recordings says."""
        return self.own.describe(path)

    def read(self, path: Path, wanted: Wanted) -> Trial:  # noqa: ARG002  # it is that of the writer
        """Watch until the end; the trial that was seen."""
        watch = self.watch
        so_far = SoFar(watch._prepared, wanted, self.bundle, self.readers, self.name, self.writer.path)
        judging = judging_of(so_far, apart=watch._settings.apart)
        try:
            intake = _Intake(wanted, self.writer, watch._prepared, judging)
            watch._source.open(intake.kept.collector.topics)
            otherwise = partial(watch._is_read_otherwise, self.bundle, self)
            watch._listen(intake, _Asking(watch, judging, otherwise))
        finally:
            judging.close()
        self.writer.close()
        self.over = True
        return intake.kept.trial()


class _Asking:
    """Has the trial so far judged now and then, and tells what comes of it on the thread that listens.

    Args:
        watch: Whom to tell.
        judging: Who judges.
        otherwise: Whether the recording, now that it holds something, is read otherwise than here.
    """

    def __init__(self, watch: Watch, judging: Judging, otherwise: Callable[[], bool]) -> None:
        self._watch, self._judging, self._otherwise = watch, judging, otherwise
        self._checks_s, self._own_way = [*_OTHERWISE_AFTER_S], False
        self._asked: tuple[int, float] | None = None
        self._judged, self._next_s, self._said = 0, 0.0, set[str]()

    def look(self, intake: _Intake, now_s: float) -> Result | None:
        """Tell what is judged by now, and ask again when it is time; the result, where there is a new one."""
        if self._asked is None:
            if now_s < self._next_s or intake.messages == self._judged:
                return None
            self._asked = intake.messages, intake.elapsed_s
            self._judging.ask()
        judged = self._judging.answer()
        if judged is None:
            return None
        (self._judged, at_s), self._asked = self._asked, None
        settings = self._watch._settings
        wait_s = max(settings.period_s, judged.cost_s * (1 / settings.share - 1))
        self._next_s = self._watch._now_s() + wait_s  # judging here took time
        return self._tell(judged, at_s)

    def _is_read_otherwise(self, at_s: float) -> bool:
        """Whether it is known by now; looked for a few times, for that reads all that was recorded."""
        if not self._own_way and self._checks_s and at_s >= self._checks_s[0]:
            self._checks_s.pop(0)
            with suppress(ScoreError):
                self._own_way = self._otherwise()
        return self._own_way

    def _tell(self, judged: Judged, at_s: float) -> Result | None:
        watch, result = self._watch, judged.result
        if result is None:
            why = _IN_ITS_OWN_WAY if self._is_read_otherwise(at_s) else judged.open
            watch._tell(replace(watch.state, open=why))
            return None
        watch._tell(replace(watch.state, result=result, so_far=judged.so_far, judged_until_s=at_s, open=""))
        for defect in result.measured.log_defects:
            if defect.kind in _SAID and (key := f"{defect.kind} {defect.where}") not in self._said:
                self._said.add(key)
                watch._note(at_s, "log", f"{defect.where}: {defect.message}")
        return result
