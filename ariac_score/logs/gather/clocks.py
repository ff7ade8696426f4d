"""Which clock the stamps of a recording are from, and how two clocks are brought together.

A message that its sender stamped belongs at that time, however long it took to the recorder. A message
without a stamp belongs at the time of recording. In a recording of a simulation the former may be simulated
time and the latter wall time; `/clock`, where it is recorded, relates the two.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ariac_score.errors import LogError
from ariac_score.logs.containers.items import IntArray
from ariac_score.trial.build import LARGEST_STEP_BACK_S, TrialBuilder
from ariac_score.trial.clock import LOG_TIME, SIMULATED_TIME, Clock
from ariac_score.trial.spans import FloatArray, Span

__all__ = ["CLOCK_TOPIC", "CLOCK_TYPE", "LARGEST_CLOCK_DIFFERENCE_S", "Clocks", "TrialClock"]

CLOCK_TOPIC, CLOCK_TYPE = "/clock", "rosgraph_msgs/msg/Clock"

LARGEST_CLOCK_DIFFERENCE_S = 60.0
"""Header and log stamps that differ by more than this come from two clocks."""

LARGEST_DELAY_S = 1.0
"""No message takes longer on one machine: where all messages of a topic do, some clock may not be set."""

_FEWEST = 8
"""Fewer messages may have been stamped long before: one that is latched, or lines of a console."""

LARGEST_DRIFT_S = 1.0
"""Stamps that drift away from times of recording by more than this are of a clock of another rate."""

LARGEST_SILENCE_S = 1.0
"""Between clock messages with a longer pause than this the simulated time is unknown."""

_UNSET_BEYOND_NS = 10**9
"""A stamp of zero is no stamp, except in the first second of a simulation."""

_LATEST_NS = 2**63 - 1

_UNCONFIRMED = "of recording: no message carries its own, so a slower or faster simulation would not show"

_REMEDY = (
    "let the recorder stamp with simulated time (`rosbag record` with /use_sim_time, `ros2 bag record "
    "--use-sim-time`) or record /clock too; in a log map, `stamp: log` reads a topic by times of recording"
)


@dataclass(frozen=True)
class TrialClock:
    """The clock that trial times are from.

    Attributes:
        clock: As trials keep it.
        origin_ns: Trial time 0 on it, ns.
        recorded: The recording's first to last message, trial time.
    """

    clock: Clock
    origin_ns: int
    recorded: Span


@dataclass(frozen=True)
class _Stamped:
    """A message by its number in the recording: its own stamp and the recorder's, ns."""

    number: int
    stamp_ns: int
    log_ns: int

    @property
    def difference_s(self) -> float:
        return (self.stamp_ns - self.log_ns) / 1e9


@dataclass
class _Topic:
    """The header stamps of one topic, classified.

    Attributes:
        near: How many are on the recorder's clock.
        unset: How many are zero.
        plain: How many messages have no header.
        far: The first stamp on another clock; `None` without any.
        last_far: The last such stamp.
        least_delay_s: The smallest difference between the recorder's clock and a stamp near it.
        delays: The smallest one of some messages in a row, each with when one of them was recorded, ns.
        first: Its first stamp on the recorder's clock.
        declared: Whether the log map says that times of recording count.
    """

    near: int = 0
    unset: int = 0
    plain: int = 0
    far: _Stamped | None = None
    last_far: _Stamped | None = None
    least_delay_s: float = np.inf
    delays: list[tuple[int, float]] = field(default_factory=list)
    first: _Stamped | None = None
    declared: bool = False

    @property
    def drift_s(self) -> float:
        """By how much the smallest delay grew from the first quarter of its messages to the last, s."""
        delays = [delay_s for _, delay_s in sorted(self.delays)]
        quarter = len(delays) // 4
        return min(delays[-quarter:]) - min(delays[:quarter]) if quarter else 0.0

    @property
    def drifts(self) -> bool:
        return abs(self.drift_s) > LARGEST_DRIFT_S

    @property
    def is_offset(self) -> bool:
        """Whether all of its stamps, and not only a few, are as if some clock was not set."""
        return self.near >= _FEWEST and abs(self.least_delay_s) > LARGEST_DELAY_S

    @property
    def side(self) -> str:
        """On which side of the times of recording its stamps are."""
        return "before" if self.least_delay_s > 0 else "after"

    @property
    def mixed(self) -> bool:
        return self.far is not None and self.near + self.unset + self.plain > 0


class Clocks:
    """Takes the stamps of a recording's messages and decides which clock the trial is on.

    Args:
        file: The recording, for error messages.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._topics: dict[str, _Topic] = {}
        self._witnesses: dict[str, _Topic] = {}
        self._ticks: list[tuple[IntArray, IntArray]] = []
        self._ticks_near = self._ticks_far = 0
        self._simulated: _SimulatedTime | None = None

    def stamps_ns(self, topic: str, numbers: IntArray, header_ns: IntArray, log_ns: IntArray) -> IntArray:
        """The stamps that count for some messages: their own, or the recorder's where those are zero.

        Args:
            topic: Its name; all of its stamps must be on one clock.
            numbers: The numbers of the messages in the recording, shape (n,).
            header_ns: What their headers say, ns, shape (n,).
            log_ns: When they were recorded, ns, shape (n,).
        """
        return self._taken(self._topics.setdefault(topic, _Topic()), numbers, header_ns, log_ns)

    def witness(self, topic: str, header_ns: IntArray, log_ns: IntArray) -> None:
        """Take stamps of a topic of which nothing else is read: they show which clock its nodes were on."""
        found = self._witnesses.setdefault(topic, _Topic())
        self._taken(found, np.zeros(len(log_ns), dtype=np.int64), header_ns, log_ns)

    @staticmethod
    def _taken(found: _Topic, numbers: IntArray, header_ns: IntArray, log_ns: IntArray) -> IntArray:
        delay_s = (log_ns - header_ns) / 1e9
        # rclcpp and roscpp leave a header stamp at zero unless the sender sets it.
        unset = (header_ns == 0) & (log_ns > _UNSET_BEYOND_NS)
        near = ~unset & (np.abs(delay_s) <= LARGEST_CLOCK_DIFFERENCE_S)
        found.unset += int(unset.sum())
        found.near += int(near.sum())
        if near.any():
            found.least_delay_s = min(found.least_delay_s, float(delay_s[near].min()))
            found.delays.extend(_least_in_a_row(log_ns[near], delay_s[near]))
            if found.first is None:
                i = int(np.argmax(near))
                found.first = _Stamped(int(numbers[i]), int(header_ns[i]), int(log_ns[i]))
        # Only the first and the last are kept; whether a clock explains them is known once `/clock` was read.
        far = np.flatnonzero(~unset & ~near)
        for i in far[[0, -1]].tolist() if len(far) else ():
            one = _Stamped(int(numbers[i]), int(header_ns[i]), int(log_ns[i]))
            if found.far is None or one.number < found.far.number:
                found.far = one
            if found.last_far is None or one.number >= found.last_far.number:
                found.last_far = one
        stamps_ns: IntArray = np.where(unset, log_ns, header_ns)
        return stamps_ns

    def stamp_ns(self, topic: str, number: int, header_ns: int, log_ns: int) -> int:
        """As `stamps_ns`, of one message.

        Raises:
            LogError: The stamp is beyond what 64 bits of nanoseconds can hold.
        """
        if not -_LATEST_NS <= header_ns <= _LATEST_NS:
            raise self._mixed(topic, _Stamped(number, header_ns, log_ns))
        one = (np.array([value], dtype=np.int64) for value in (number, header_ns, log_ns))
        return int(self.stamps_ns(topic, *one)[0])

    def without_header(self, topic: str, count: int, *, declared: bool = False) -> None:
        """Take note of messages of a topic whose time of recording counts.

        Args:
            topic: Its name.
            count: How many.
            declared: Whether somebody says that it does; otherwise their sender did not stamp them.
        """
        found = self._topics.setdefault(topic, _Topic())
        found.plain += count
        found.declared = declared

    def by_arrival(self, topic: str) -> bool:
        """Whether some messages of a topic are placed at their time of recording."""
        found = self._topics.get(topic, _Topic())
        return found.plain + found.unset > 0

    def tick(self, log_ns: IntArray, simulated_ns: IntArray) -> None:
        """Take messages of `/clock`: when they were recorded, and the simulated times they give, ns."""
        # A recorder on simulated time stamps them with the time they give: a thousand a second, all needless.
        differ = np.abs((log_ns - simulated_ns) / 1e9) > LARGEST_DELAY_S
        far = int(differ.sum())
        self._ticks_near += len(differ) - far
        self._ticks_far += far
        if differ.any():
            self._ticks.append((log_ns[differ], simulated_ns[differ]))

    def settle(self) -> None:
        """Decide which clock the trial is on, after the last message.

        Raises:
            LogError: The stamps of a topic are on two clocks, or on one that nothing relates to the
                recorder's; or the simulation was reset.
        """
        # Within one topic first: `/clock` cannot help where only some of its messages are on another clock.
        mixed = {name: t.far for name, t in self._topics.items() if t.far is not None and t.mixed}
        if mixed:
            raise self._first_of(mixed)
        others = {name: t.far for name, t in self._topics.items() if t.far is not None}
        # A few that came late, to a recorder that was on simulated time itself, make no other clock.
        ticking = bool(self._ticks) and (bool(others) or self._ticks_far > self._ticks_near)
        if not ticking:
            if others:
                raise self._first_of(others)
            self._refuse_other_rates()
            return
        simulated = _SimulatedTime.of_ticks(self._ticks, self._file)
        strange = {
            name: one
            for name, topic in self._topics.items()
            for one in (topic.last_far, topic.far)
            if one is not None and not simulated.agrees(one)
        }
        if strange:
            raise self._first_of(strange)
        self._simulated = simulated

    def _refuse_other_rates(self) -> None:
        """Refuse times of recording where the nodes were on another clock, which nothing relates to them.

        Start and end of the competition, which nobody stamps, would else be seconds apart from the motion.
        """
        plain = sorted(
            name
            for name, topic in self._topics.items()
            if topic.plain and not topic.declared and not name.endswith("tf_static")
        )
        if not plain:
            return  # every message is where its sender says
        for name, topic in sorted((self._topics | self._witnesses).items()):
            is_offset = name in self._topics and topic.is_offset and not name.endswith("tf_static")
            if topic.far is None and not topic.drifts and not is_offset:
                continue
            why = "the simulation was slow, or the recorder fell behind"
            if is_offset and not topic.drifts:
                shown = f"its headers are {abs(topic.least_delay_s):.3f} s or more {topic.side} them"
                why = "the clock of one machine is not set"
            elif topic.far is not None:
                shown = (
                    f"its headers say {topic.far.stamp_ns} ns where the recorder says {topic.far.log_ns} ns"
                )
            else:
                shown = f"its headers and the recorder drift {topic.drift_s:+.3f} s apart"
            raise LogError(
                f"times of recording are not those of the nodes: on topic {name} {shown}, and messages of "
                f"{plain[0]} have no stamp of their own",
                file=self._file,
                hint=f"{why}: {_REMEDY}",
            )

    @property
    def _unconfirmed(self) -> str:
        """That all times are those of the recorder, on which a slow simulation looks longer; else empty."""
        known = (*self._topics.values(), *self._witnesses.values())
        stamped = self._ticks_near or any(topic.near or topic.declared for topic in known)
        return "" if stamped or not known else _UNCONFIRMED

    def trial_clock(self, first_ns: int, last_ns: int) -> TrialClock:
        """The clock of a trial that was recorded from a first to a last log time.

        Simulated time has a zero of its own, which other logs of the run share; log time has none.
        """
        if self._simulated is None:
            clock, origin_ns = Clock(LOG_TIME, first_ns, self._unconfirmed), first_ns
        else:
            clock, origin_ns = Clock(SIMULATED_TIME), 0
        ends_ns = self.of_log(np.array([first_ns, last_ns], dtype=np.int64)).tolist()
        start_s, end_s = ((int(end_ns) - origin_ns) / 1e9 for end_ns in ends_ns)
        return TrialClock(clock, origin_ns, Span(start_s, end_s))

    @property
    def simulated(self) -> bool:
        """Whether the trial is on simulated time and log times are not."""
        return self._simulated is not None

    def on_trial_clock(self, topic: str, stamps_ns: IntArray) -> IntArray:
        """The kept stamps of a topic, on the clock of the trial.

        Raises:
            LogError: The simulated time at which a message was recorded is unknown.
        """
        if self._simulated is None or not len(stamps_ns):
            return stamps_ns
        known = self._topics.get(topic)
        if known is not None and self._is_simulated(known):
            return stamps_ns  # header stamps, which are simulated time already
        self._simulated.refuse_unknown(topic, stamps_ns)
        return self.of_log(stamps_ns)

    def _is_simulated(self, topic: _Topic) -> bool:
        """Whether the stamps of a topic are on the clock of the simulation."""
        if topic.far is not None or topic.first is None or self._simulated is None:
            return topic.far is not None
        # Near the recorder's clock: nearer to that of the simulation all the same, if that is near it, too.
        one = topic.first
        simulated_ns = int(self._simulated.at(np.array([one.log_ns], dtype=np.int64))[0])
        return topic.drifts or abs(one.stamp_ns - simulated_ns) < abs(one.stamp_ns - one.log_ns)

    def of_log(self, log_ns: IntArray) -> IntArray:
        """Log times on the clock of the trial."""
        return log_ns if self._simulated is None else self._simulated.at(log_ns)

    def note(self, builder: TrialBuilder) -> None:
        """Note the topics whose stamps are irregular as defects."""
        for name, topic in sorted(self._topics.items()):
            builder.defect(
                "unset_stamps", name, topic.unset, "headers without a stamp; the times of recording were used"
            )
            if topic.near and abs(topic.least_delay_s) > LARGEST_DELAY_S:
                message = (
                    f"its stamps are {abs(topic.least_delay_s):.3f} s or more {topic.side} the times of "
                    "recording, as if a clock was not set; they were used as they are"
                )
                builder.defect("clock_offset", name, topic.near, message)

    def _first_of(self, wrong: dict[str, _Stamped]) -> LogError:
        topic, one = min(wrong.items(), key=lambda item: item[1].number)
        return self._mixed(topic, one)

    def _mixed(self, topic: str, one: _Stamped) -> LogError:
        found = self._topics.get(topic, _Topic())
        others = found.near + found.unset + found.plain
        also = f"; {others} messages of that topic are on the recorder's clock or have no stamp"
        return LogError(
            f"two clocks are mixed: on topic {topic} the header says {one.stamp_ns} ns, "
            f"the recorder {one.log_ns} ns, {one.difference_s:.3f} s apart{also if others else ''}",
            file=self._file,
            hint=_REMEDY,
        )


_ROWS = 64
"""Of so many messages at most the one that was on its way for the shortest time is kept."""


def _least_in_a_row(log_ns: IntArray, delay_s: FloatArray) -> list[tuple[int, float]]:
    starts = np.arange(0, len(log_ns), min(_ROWS, max(1, len(log_ns) // 8)))
    least = np.minimum.reduceat(delay_s, starts)
    return list(zip(log_ns[starts].tolist(), least.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class _SimulatedTime:
    """The simulated time at each log time.

    Attributes:
        log_ns: When clock messages were recorded, increasing, shape (n,).
        ns: The simulated times they give, never decreasing, shape (n,).
    """

    log_ns: IntArray
    ns: IntArray
    file: Path = field(default_factory=Path)

    @classmethod
    def of_ticks(cls, ticks: list[tuple[IntArray, IntArray]], file: Path) -> _SimulatedTime:
        log_ns, ns = (np.concatenate(part) for part in zip(*ticks, strict=True))
        order = np.lexsort((ns, log_ns))  # several ticks may be recorded at one time
        log_ns, ns = log_ns[order], ns[order]
        # Messages may overtake each other on their way; only a real reset goes far back.
        latest_ns = np.maximum.accumulate(ns)
        back_s = float((latest_ns - ns).max()) / 1e9
        if back_s > LARGEST_STEP_BACK_S:
            raise LogError(
                f"simulated time runs backwards by {back_s:.3f} s on topic {CLOCK_TOPIC}",
                file=file,
                hint="the simulation was reset: record, and score, the runs one by one",
            )
        return cls(log_ns, latest_ns, file)

    def at(self, log_ns: IntArray) -> IntArray:
        """By straight lines between clock messages; constant before the first and after the last."""
        first_log_ns, first_ns = int(self.log_ns[0]), int(self.ns[0])
        # Relative to the first message: float64 does not hold every nanosecond since 1970.
        since_ns = np.interp(log_ns - first_log_ns, self.log_ns - first_log_ns, self.ns - first_ns)
        found: IntArray = np.rint(since_ns).astype(np.int64) + first_ns
        return found

    def agrees(self, one: _Stamped) -> bool:
        """Whether a stamp is on this clock."""
        now_ns = int(self.at(np.array([one.log_ns], dtype=np.int64))[0])
        return abs(one.stamp_ns - now_ns) / 1e9 <= LARGEST_CLOCK_DIFFERENCE_S

    def refuse_unknown(self, topic: str, log_ns: IntArray) -> None:
        """Refuse times at which no clock message is near.

        Between two clock messages the error is at most their distance in simulated time, and before the
        first one at most its distance from the zero of the simulation.
        """
        after = np.searchsorted(self.log_ns, log_ns, side="left")
        last = len(self.ns) - 1
        before_ns = np.where(after > 0, self.ns[np.maximum(after - 1, 0)], 0)
        # Behind the last message nothing limits the step, so only nearness in log time counts.
        step_ns = np.where(after <= last, self.ns[np.minimum(after, last)] - before_ns, _LATEST_NS)
        near_ns = np.minimum(
            np.abs(log_ns - self.log_ns[np.maximum(after - 1, 0)]),
            np.abs(log_ns - self.log_ns[np.minimum(after, last)]),
        )
        # A slow simulation ticks rarely in wall time but often in its own: either distance may be short.
        unknown = np.flatnonzero(np.minimum(step_ns, near_ns) / 1e9 > LARGEST_SILENCE_S)
        if len(unknown):
            i = int(unknown[0])
            raise LogError(
                f"nobody knows the simulated time of a message on topic {topic}: it was recorded at "
                f"{int(log_ns[i])} ns, {near_ns[i] / 1e9:.3f} s from the nearest message on {CLOCK_TOPIC}",
                file=self.file,
                hint=f"record {CLOCK_TOPIC} from before the trial to behind its end",
            )
