"""Reading ROS recordings: ROS 1 bags and ROS 2 bags in SQLite or MCAP, without ROS."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Set
from pathlib import Path

from ariac_score.checks.contracts import LogDescription, ReaderFacts, Wanted
from ariac_score.errors import CutOffError, LogError, NothingToScoreError
from ariac_score.logs.attested import HEARTBEAT, MANIFEST, attestation_of, digest_of
from ariac_score.logs.containers.detect import SUFFIXES, cannot_be_read, looks_like_recording, open_scan
from ariac_score.logs.containers.folder import packed_storage
from ariac_score.logs.containers.items import Batch, Connection, Message, Scan, with_slash
from ariac_score.logs.gather.collector import Collector
from ariac_score.logs.gather.topic_statistics import TopicStatistics
from ariac_score.trial.attestation import Attestation, Unheard
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.clock import LOG_TIME, Clock
from ariac_score.trial.cut import cut_at
from ariac_score.trial.model import LogDefect, Trial

__all__ = ["RecordingIntake", "RosbagReader"]

_PROGRESS_EVERY = 4096
_UNSEEN = (
    "it was recorded through a source that may lose messages and says nothing of it: that a topic is silent "
    "does not show that nothing happened"
)
_CONTRADICTING = "chunks whose index contradicts their records were read without it"


class RosbagReader:
    """Reads ROS 1 bags (`.bag`) and ROS 2 bags (`.db3`, `.mcap`, or a rosbag2 folder).

    A message belongs at the stamp of its header, or at its time of recording if it has none; the log map
    may choose the latter for all. Trial time 0 is the earliest log time of any message, so that the same
    messages give the same trial in every format, to the bit; or the simulator's own zero, where headers are
    on simulated time and log times are not. Then `/clock` relates the two.

    Reads:
        The topics that the log map turns into signals, orders, submissions or events.
    Refuses:
        A recording that breaks off or fails a checksum, a message that its type does not
        fit, and stamps that run back by more than a second.
    Source:
        ROS bag format 2.0, rosbag2, the MCAP specification; messages as the log map says.
    """

    facts = ReaderFacts(formats="ROS bags", folders=True)

    def can_read(self, path: Path) -> bool:
        """Whether this looks like a ROS recording, whole or not; never an error."""
        try:
            return looks_like_recording(path)
        except OSError:
            # A file that cannot be opened is ours by its name: `read` then reports why.
            return path.suffix in SUFFIXES

    def describe(self, path: Path) -> LogDescription:
        """The contents of the recording; of a damaged one, the readable part.

        Raises:
            NothingToScoreError: The file is empty, or not a recording at all.
        """
        try:
            scan = open_scan(path)
        except NothingToScoreError:
            raise
        except LogError as error:
            return LogDescription("ROS recording", damage=str(error))
        statistics, damage = TopicStatistics(), ""
        try:
            for _ in _counted(scan, statistics, path):
                pass
        except LogError as error:
            damage = str(error)
        return LogDescription(
            format=scan.format,
            topics=statistics.topics(),
            clock=str(Clock(LOG_TIME, statistics.first_ns)),
            facts={"messages": statistics.messages},
            defects=(*_contradicting(scan, path), *_disordered(statistics)),
            damage=damage,
            duration_s=statistics.duration_s,
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The part of a trial that the recording shows.

        Raises:
            LogError: The recording is damaged, its clocks are mixed, or what it
                says contradicts itself.
            NothingToScoreError: It holds no message.
        """
        trial = self._read(path, wanted)
        if trial.attestation is not None and trial.attestation.early:
            # Nobody attests these, and they may not count; few recordings have any.
            trial = self._read(path, wanted, trial.attestation.early)
        return trial

    def _read(self, path: Path, wanted: Wanted, left_out: Set[Unheard] = frozenset()) -> Trial:
        intake, progress_at = RecordingIntake(wanted, path), _PROGRESS_EVERY
        statistics, collector = intake.statistics, intake.collector
        scan = open_scan(path, jobs=wanted.jobs, topics=collector.topics, partial=wanted.partial)
        cut: CutOffError | None = None
        try:
            items = _counted(scan, statistics, path)
            for item in _without(items, left_out) if left_out else items:
                collector.share = scan.share
                collector.take(item)
                if statistics.messages >= progress_at:
                    progress_at = statistics.messages + _PROGRESS_EVERY
                    wanted.progress(scan.share)
        except LogError as error:
            collector.flush()  # faults of messages before the damage are reported first
            if not isinstance(error, CutOffError) or not wanted.partial:
                raise
            cut = error
        wanted.progress(1.0)
        return intake.trial(cut, defects=_contradicting(scan, path))


LONGEST_S = 3 * 86400.0
"""A recording of a trial is no longer, s."""


class RecordingIntake:
    """What has been taken in of a recording, and the trial that it shows.

    Args:
        wanted: What the log map and the checks need.
        file: The recording.

    Attributes:
        statistics: Of every item.
        collector: What is wanted of them.
    """

    def __init__(self, wanted: Wanted, file: Path) -> None:
        self._file = file
        self.statistics, self.collector = TopicStatistics(), Collector(wanted, file)

    def take(self, item: Connection | Message) -> None:
        """Count and collect one item, in recorded order."""
        if isinstance(item, Message):
            self.statistics.count(item)
        else:
            self.statistics.declare(item)
        self.collector.take(item)

    def trial(
        self, cut: CutOffError | None = None, *, defects: Iterable[LogDefect] = (), as_it_came: bool = False
    ) -> Trial:
        """The part of a trial that was taken in; it can be asked for once.

        Args:
            cut: Where the recording breaks off, if it does.
            as_it_came: Whether it is known to be in the order in which it came: a file in which one topic
                alone has messages may have been sorted by topic.
            defects: Of the recording.

        Raises:
            LogError: Its clocks are mixed, or what it says contradicts itself.
            NothingToScoreError: It holds no message.
        """
        path, statistics, collector = self._file, self.statistics, self.collector
        first_ns, last_ns = statistics.first_ns, statistics.last_ns
        if first_ns is None or last_ns is None:
            if cut is not None:
                raise NothingToScoreError(
                    "the recording breaks off before its first message",
                    file=path,
                    hint="copy it again from where it was recorded",
                )
            raise NothingToScoreError(
                "the recording holds no message",
                file=path,
                hint="was the simulation running, and did the recorder see its topics?",
            )
        clock = collector.clock(first_ns, last_ns)
        if clock.recorded.duration_s > LONGEST_S:
            raise LogError(
                f"its messages were recorded from {first_ns / 1e9:.3f} s to {last_ns / 1e9:.3f} s, which is "
                f"{clock.recorded.duration_s / 86400:.0f} days: some by another clock than the others",
                file=path,
                hint="leave out those of the other clock, with 'rosbag filter' or 'mcap filter', and score "
                "what is left",
            )
        builder = TrialBuilder(_trial_id(path), file=path, clock=clock.clock)
        builder.recorded = clock.recorded
        collector.settle(builder, clock.origin_ns)
        if cut is not None:
            sorted_anew = statistics.silent_but_one and not as_it_came
            back_s = math.inf if sorted_anew else statistics.largest_step_back_s
            end_s = clock.recorded.end_s
            builder.cut = cut_at(cut, path.name, end_s, largest_step_back_s=back_s)
        elif statistics.has(MANIFEST) or statistics.has(HEARTBEAT):
            builder.attestation = attestation_of(path, clock.origin_ns)
        if collector.unseen_losses and not _shows_losses(builder.attestation):
            builder.unseen_losses = _UNSEEN
        for defect in defects:
            builder.defect(defect.kind, defect.where, defect.count, defect.message)
        return builder.build()


def _without(
    items: Iterable[Connection | Message | Batch], left_out: Set[Unheard]
) -> Iterator[Connection | Message | Batch]:
    """The items of a scan but some messages."""
    topics = {one.topic for one in left_out}
    for item in items:
        if isinstance(item, Connection) or not topics & {
            with_slash(c.topic) for c in (item.connections if isinstance(item, Batch) else [item.connection])
        }:
            yield item
            continue
        for message in item.messages() if isinstance(item, Batch) else [item]:
            topic, publisher = with_slash(message.connection.topic), message.connection.publisher
            if topic not in topics or (
                Unheard(topic, message.stamp_ns, digest_of(message.payload), publisher) not in left_out
            ):
                yield message


def _shows_losses(attestation: Attestation | None) -> bool:
    """Whether the messages are those that a recorder lists, so that one that was lost would show."""
    return attestation is not None and not attestation.problem and not attestation.lacking


def _counted(scan: Scan, statistics: TopicStatistics, path: Path) -> Iterator[Connection | Message | Batch]:
    """The items of a scan, counted; where it breaks off, the error describes the readable part."""
    try:
        for item in scan:
            if isinstance(item, Batch):
                statistics.count_many(item)
            elif isinstance(item, Message):
                statistics.count(item)
            else:
                statistics.declare(item)
            yield item
    except LogError as error:
        kind = CutOffError if isinstance(error, CutOffError) else LogError
        raise kind(
            f"{error.cause}; readable up to {scan.readable}: {statistics.words()}",
            file=error.file,
            place=error.place,
            hint=error.hint,
        ) from error
    except (OSError, MemoryError) as error:
        raise cannot_be_read(error, path) from error


def _contradicting(scan: Scan, path: Path) -> Iterator[LogDefect]:
    if scan.index_contradictions:
        yield LogDefect("contradicting_index", path.name, scan.index_contradictions, _CONTRADICTING)


def _disordered(statistics: TopicStatistics) -> Iterator[LogDefect]:
    for topic, count in statistics.steps_back():
        yield LogDefect("disordered_stamps", topic, count, "stamps run backwards")


def _trial_id(path: Path) -> str:
    # Not from the metadata: the same recording must have the same name in every container.
    resolved = path.resolve()
    if packed_storage(resolved) and resolved.is_file():
        resolved = resolved.with_suffix("")
    return resolved.stem if resolved.suffix in SUFFIXES else resolved.name
