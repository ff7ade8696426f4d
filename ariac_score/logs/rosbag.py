"""Reading ROS recordings: ROS 1 bags and ROS 2 bags in SQLite or MCAP, without ROS."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ariac_score.checks.contracts import LogDescription, ReaderFacts, Wanted
from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.logs.containers.detect import SUFFIXES, cannot_be_read, looks_like_recording, open_scan
from ariac_score.logs.containers.items import Batch, Connection, Message, Scan
from ariac_score.logs.gather.collector import Gathering
from ariac_score.logs.gather.topic_statistics import Survey
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.clock import LOG_TIME, Clock
from ariac_score.trial.model import LogDefect, Trial

__all__ = ["RosbagReader"]

_PROGRESS_EVERY = 4096
_CONTRADICTING = "chunks whose index contradicts their records were read without it"


class RosbagReader:
    """Reads ROS 1 bags (`.bag`) and ROS 2 bags (`.db3`, `.mcap`, or a rosbag2 folder).

    A message is where its header's stamp says, and one without a header where it was recorded; the log map
    may choose the latter for all. Trial time 0 is the earliest log time of any message, so that the same
    messages give the same trial in every format, to the bit; or the simulator's own zero, where headers are
    on simulated time and log times are not. Then `/clock` says which simulated time it was when.

    Reads:
        The topics that the log map leads to signals, orders, submissions or events.
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
            # What cannot even be looked at is ours if it is called so: `read` then says why.
            return path.suffix in SUFFIXES

    def describe(self, path: Path) -> LogDescription:
        """What the recording holds; of a damaged one, what is readable.

        Raises:
            NothingToScoreError: The file is empty, or not a recording at all.
        """
        try:
            scan = open_scan(path)
        except NothingToScoreError:
            raise
        except LogError as error:
            return LogDescription("ROS recording", damage=str(error))
        survey, damage = Survey(), ""
        try:
            for _ in _surveyed(scan, survey, path):
                pass
        except LogError as error:
            damage = str(error)
        return LogDescription(
            format=scan.format,
            topics=survey.topics(),
            clock=str(Clock(LOG_TIME, survey.first_ns)),
            facts={"messages": survey.messages},
            defects=(*_contradicting(scan, path), *_disordered(survey)),
            damage=damage,
            duration_s=survey.duration_s,
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The part of a trial that the recording shows.

        Raises:
            LogError: The recording is damaged, its clocks are mixed, or what it
                says contradicts itself.
            NothingToScoreError: It holds no message.
        """
        survey, gathering, progress_at = Survey(), Gathering(wanted, path), _PROGRESS_EVERY
        scan = open_scan(path, jobs=wanted.jobs, topics=gathering.topics)
        try:
            for item in _surveyed(scan, survey, path):
                gathering.share = scan.share
                gathering.take(item)
                if survey.messages >= progress_at:
                    progress_at = survey.messages + _PROGRESS_EVERY
                    wanted.progress(scan.share)
        except LogError:
            gathering.flush()  # what is wrong with the messages before the damage is told first
            raise
        wanted.progress(1.0)
        first_ns, last_ns = survey.first_ns, survey.last_ns
        if first_ns is None or last_ns is None:
            raise NothingToScoreError(
                "the recording holds no message",
                file=path,
                hint="was the simulation running, and did the recorder see its topics?",
            )
        clock = gathering.clock(first_ns, last_ns)
        builder = TrialBuilder(_trial_id(path), file=path, clock=clock.clock)
        builder.recorded = clock.recorded
        gathering.settle(builder, clock.origin_ns)
        for defect in _contradicting(scan, path):
            builder.defect(defect.kind, defect.where, defect.count, defect.message)
        return builder.build()


def _surveyed(scan: Scan, survey: Survey, path: Path) -> Iterator[Connection | Message | Batch]:
    """The items of a scan, counted; where it breaks off, the error says what was readable."""
    try:
        for item in scan:
            if isinstance(item, Batch):
                survey.count_many(item)
            elif isinstance(item, Message):
                survey.count(item)
            else:
                survey.declare(item)
            yield item
    except LogError as error:
        raise LogError(
            f"{error.cause}; readable up to {scan.readable}: {survey.words()}",
            file=error.file,
            place=error.place,
            hint=error.hint,
        ) from error
    except (OSError, MemoryError) as error:
        raise cannot_be_read(error, path) from error


def _contradicting(scan: Scan, path: Path) -> Iterator[LogDefect]:
    if scan.index_contradictions:
        yield LogDefect("contradicting_index", path.name, scan.index_contradictions, _CONTRADICTING)


def _disordered(survey: Survey) -> Iterator[LogDefect]:
    for topic, count in survey.steps_back():
        yield LogDefect("disordered_stamps", topic, count, "stamps run backwards")


def _trial_id(path: Path) -> str:
    # Not from the metadata: the same recording must have one name in every container.
    resolved = path.resolve()
    return resolved.stem if resolved.suffix in SUFFIXES else resolved.name
