"""What a strict reading measures: forces, contacts, way and place, and what of them was not seen."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import acos, inf, sqrt
from typing import ClassVar, Literal

import numpy as np

from ariac_score import (
    Cause,
    Chart,
    Finding,
    FloatArray,
    Measure,
    Trial,
    Verdict,
    WorkItem,
    Worlds,
    check_parameters,
    exact_sum,
    parameter,
)
from ariac_score.monitors import longest_held_s
from ariac_score_aic import charts
from ariac_score_aic.chains import Poses, lengths_m
from ariac_score_aic.checks import NO_RECORDING, Contacts, ForceTime, PathLength, PolynomialJerk
from ariac_score_aic.consumption import Consumed, Plug, consumed_of
from ariac_score_aic.insertion import Insertion
from ariac_score_aic.messages import CONTACTS, CONTACTS_HZ, CONTROLLER, FORCES_HZ, IntArray
from ariac_score_aic.run_config import Connection

__all__ = ["ForceBounds", "InsertionInPort", "SeenJerk", "TaskPath", "WatchedContacts"]

_GAP = "our choice: five messages at the rate of the engine"
_RATE = "configuration of the simulator, intrinsic-dev/aic"


def _unseen_ns(stamp_ns: IntArray, span_ns: tuple[int, int], rate_hz: float, max_gap_s: float) -> IntArray:
    """From when to when samples are missing, shape (k, 2), ns.

    Otherwise whoever leaves out the samples that show something leaves nothing open.

    Args:
        stamp_ns: Of the samples, in time order and once each, shape (n,), ns.
        span_ns: From when to when they are looked for.
        rate_hz: How often there is one, as stated; 0: as often as they came.
        max_gap_s: The longest time between two that is accepted, s.
    """
    begin_ns, end_ns = span_ns
    if not len(stamp_ns):
        return np.array([[begin_ns, max(begin_ns, end_ns)]])
    steps_ns, usual_s = np.diff(stamp_ns), 1.0 / rate_hz if rate_hz else inf
    if len(steps_ns):
        usual_s = min(usual_s, float(np.median(steps_ns)) / 1e9)
    longest_s = np.full(len(steps_ns) + 2, longest_held_s(usual_s, max_gap_s))
    # A whole interval at an end: there one more would have been.
    longest_s[[0, -1]] = np.nextafter(min(usual_s, max_gap_s), 0.0)
    edges_ns = np.concatenate(([min(begin_ns, stamp_ns[0])], stamp_ns, [max(end_ns, stamp_ns[-1])]))
    missing = np.diff(edges_ns) / 1e9 > longest_s
    return np.stack((edges_ns[:-1], edges_ns[1:]), axis=1)[missing]


def _merged_ns(spans_ns: Iterable[IntArray]) -> IntArray:
    """Spans that overlap as one, shape (k, 2), ns."""
    begins, ends = np.concatenate([np.empty((0, 2), dtype=np.int64), *spans_ns]).T
    order = np.argsort(begins, kind="stable")
    begins, ends = begins[order], np.maximum.accumulate(ends[order])
    first = np.concatenate((np.ones(min(len(begins), 1), dtype=bool), begins[1:] > ends[:-1]))
    return np.stack((begins[first], ends[np.roll(first, -1)]), axis=1)


def _lasting_ns(spans_ns: IntArray) -> int:
    """How long some spans last together, shape (k, 2), ns."""
    return int((spans_ns[:, 1] - spans_ns[:, 0]).sum())


@dataclass(frozen=True)
class ForceBounds:
    """The tool does not push hard for long, and all of the time is looked at.

    Measures:
        The time for which the force at the wrist, in all three axes and without the offset that the
        controller states, is above `threshold_n`: at least that between samples that are both above it, at
        most also that to a sample that is not, and all stretches in which a sample is missing.
    Violated when:
        That time is longer than `limit_s` at least; undecided where it is so at most.
    Attributes:
        threshold_n: Force above which time counts.
        limit_s: The longest time that costs nothing.
        max_gap_s: A longer stretch without a sample is not seen; nor is one of more than 1.5 usual intervals.
        rate_hz: How often the force is published; 0: as often as it came.
    Source:
        The strict reading is our own; thresholds are those of `ScoringTier2.cc`.
    """

    part_of: ClassVar[str] = "safety"
    mistake: ClassVar[tuple[str, str]] = ForceTime.mistake
    level: ClassVar[str] = "task"
    measures: ClassVar[Mapping[str, Measure]] = ForceTime.measures

    threshold_n: float = parameter(20.0, unit="N", above=0, at_most=1e4, source="ScoringTier2.cc")
    limit_s: float = parameter(1.0, unit="s", at_least=0, at_most=1e4, source="ScoringTier2.cc")
    max_gap_s: float = parameter(0.1, unit="s", above=0, at_most=60, source=_GAP)
    rate_hz: float = parameter(FORCES_HZ, unit="Hz", at_least=0, at_most=1e5, source=_RATE)

    def __post_init__(self) -> None:
        check_parameters(self)

    def charts(self, trial: Trial) -> Iterator[Chart]:
        """The force at the wrist with its threshold."""
        return charts.of_force(trial, self.threshold_n)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the task."""
        yield from (one for one in self.judge_worlds(trial, item) if isinstance(one, Finding))

    def judge_worlds(self, trial: Trial, item: WorkItem) -> Iterator[Finding | Worlds]:
        """The same, and of an undecided one the least and the most time above the threshold."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        stamps, force = consumed.forces
        force_n = np.sqrt((force**2).sum(axis=1))
        span_ns = consumed.with_task(consumed.span_ns)
        least_s, most_s, unseen_s = self.time_above_s(stamps, force_n, span_ns)
        seen = force_n[np.isfinite(force_n)]
        peak_n = float(seen.max()) if len(seen) else 0.0
        words = f"above {self.threshold_n:g} N for {least_s:.3f} s to {most_s:.3f} s, at most {peak_n:.2f} N"
        best, worst = (self._found(item, words, time_s, peak_n) for time_s in (least_s, most_s))
        if best.verdict is worst.verdict:
            yield best
            return
        why = f"{words}; forces were not seen for {unseen_s:.3f} s"
        yield Finding.inconclusive(item.id, why)
        yield Worlds(item.id, (best,), (worst,), (Cause(why, consumed.how.wrench_topic),))

    def _found(self, item: WorkItem, words: str, time_s: float, peak_n: float) -> Finding:
        return Finding(
            item.id,
            Verdict.VIOLATED if time_s > self.limit_s else Verdict.SATISFIED,
            words,
            robustness=self.limit_s - time_s,
            unit="s",
            quantities={"time_above_s": time_s, "peak_force_n": peak_n},
        )

    def time_above_s(
        self, stamp_ns: IntArray, force_n: FloatArray, span_ns: tuple[int, int]
    ) -> tuple[float, float, float]:
        """The least and the most time above the threshold in a span, and that without a sample, s."""
        # By stamp and once each: time neither repeats nor runs back.
        stamps, first = np.unique(stamp_ns, return_index=True)
        finite = np.isfinite(force_n[first])
        stamps, above = stamps[finite], force_n[first][finite] > self.threshold_n
        # In whole nanoseconds: a time of exactly the limit is not above it, however many steps make it up.
        unseen_ns = _unseen_ns(stamps, span_ns, self.rate_hz, self.max_gap_s)
        seen_ns = np.where(np.isin(stamps[:-1], unseen_ns[:, 0]), 0, np.diff(stamps))
        least_ns = int(seen_ns[above[1:] & above[:-1]].sum())
        either_ns = int(seen_ns[above[1:] | above[:-1]].sum())
        open_ns = _lasting_ns(unseen_ns)
        return least_ns / 1e9, (either_ns + open_ns) / 1e9, open_ns / 1e9


@dataclass(frozen=True)
class WatchedContacts:
    """Nothing touches what is off limits, and somebody watched.

    Measures:
        The messages of the simulator that name a contact, and the time without any message on their topic.
    Violated when:
        There is one; undecided where there is none and a message is missing.
    Attributes:
        max_gap_s: A longer stretch without a message, also an empty one, is not watched; nor is one of more
            than 1.5 usual intervals.
        rate_hz: How often there is a message; 0: as often as they came.
    Source:
        The strict reading is our own; the simulator publishes at 5 Hz whether there is a contact or not.
    """

    part_of: ClassVar[str] = "safety"
    mistake: ClassVar[tuple[str, str]] = Contacts.mistake
    level: ClassVar[str] = "task"
    measures: ClassVar[Mapping[str, Measure]] = Contacts.measures

    max_gap_s: float = parameter(1.0, unit="s", above=0, at_most=600, source=_GAP)
    rate_hz: float = parameter(CONTACTS_HZ, unit="Hz", at_least=0, at_most=1e5, source=_RATE)

    def __post_init__(self) -> None:
        check_parameters(self)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the task."""
        consumed = consumed_of(trial)
        for finding in Contacts(unseen="open").judge(trial, item):
            if consumed is None or finding.verdict is not Verdict.SATISFIED:
                yield finding
                continue
            times, recorded = consumed.messages.contact_ns, consumed.messages.recorded_ns or (0, 0)
            whole_ns = consumed.with_task(recorded)
            unseen_ns = _unseen_ns(np.unique(times), whole_ns, self.rate_hz, self.max_gap_s)
            silent_s = _lasting_ns(unseen_ns) / 1e9
            if silent_s > 0:
                why = f"no contact was reported, and {CONTACTS} was silent for {silent_s:.3f} s"
                yield Finding.inconclusive(item.id, why)
            else:
                yield finding


@dataclass(frozen=True)
class TaskPath:
    """The gripper takes a short way while the task goes on.

    Measures:
        The length of the polyline through the poses of the gripper from start to end of the task, in m,
        asked for when all of the recording is read; at most the way that a tool of `max_speed_m_s` can take
        in stretches in which a pose is missing.
    Violated when:
        Never: what is long enough to cost points is for the rules to say.
    Attributes:
        max_gap_s: A longer stretch without a pose is not seen; nor is one of more than 1.5 usual intervals.
        rate_hz: How often there is a pose; 0: as often as they came, so that whoever leaves out poses evenly
            makes the way shorter.
        max_speed_m_s: No tool is faster.
    Source:
        The strict reading is our own.
    """

    part_of: ClassVar[str] = "task"
    level: ClassVar[str] = "task"
    measures: ClassVar[Mapping[str, Measure]] = PathLength.measures

    max_gap_s: float = parameter(0.1, unit="s", above=0, at_most=60, source=_GAP)
    rate_hz: float = parameter(0.0, unit="Hz", at_least=0, at_most=1e5, source="not public")
    max_speed_m_s: float = parameter(
        1.0, unit="m/s", above=0, at_most=20, source="our choice: about what a UR5e is made for"
    )

    def __post_init__(self) -> None:
        check_parameters(self)

    def charts(self, trial: Trial) -> Iterator[Chart]:
        """The speed of the tool."""
        return charts.of_speed(trial)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the task."""
        yield from (one for one in self.judge_worlds(trial, item) if isinstance(one, Finding))

    def judge_worlds(self, trial: Trial, item: WorkItem) -> Iterator[Finding | Worlds]:
        """The same, and of an undecided one the shortest and the longest way."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        poses, bounds, span = consumed.poses_after, consumed.bounds, consumed.span_ns
        if not len(poses):
            how = consumed.how
            why = f"no pose of {how.gripper_frame} in {how.reference_frame} was recorded"
            yield Finding.inconclusive(item.id, why)
            return
        start, end = bounds.start_ns or (span[0], span[0]), bounds.end_ns or (span[1], span[1])
        least_m = _length_m(poses, (start[1], end[0]))
        longest_m = _length_m(poses, (start[0], end[1])) + self.unseen_m(consumed, poses, (start[0], end[1]))
        count = float(len(poses))
        best, worst = (
            Finding(
                item.id,
                Verdict.SATISFIED,
                f"{word}{length_m:.3f} m from start to end of the task",
                quantities={"path_length_m": length_m, "poses": count},
            )
            for word, length_m in (("", least_m), ("no more than ", longest_m))
        )
        if worst.quantities["path_length_m"] - least_m <= _SAME_M:
            yield best
            return
        why = f"the way in the task is {least_m:.3f} m to {longest_m:.3f} m"
        yield Finding.inconclusive(item.id, why)
        yield Worlds(item.id, (best,), (worst,), (Cause(why),))

    def unseen_m(self, consumed: Consumed, poses: Poses, within_ns: tuple[int, int]) -> float:
        """By how much the way in a stretch can have been longer where something that moves was not seen, m.

        A pose between two transforms of a frame is filled, not seen.
        """
        frames = consumed.how.gripper_frame, consumed.how.reference_frame
        moving = [np.array(one.stamps_ns) for name in frames for one in consumed.buffer.moving(name)]
        spans_ns = _merged_ns(
            _unseen_ns(
                one[(one >= within_ns[0]) & (one <= within_ns[1])], within_ns, self.rate_hz, self.max_gap_s
            )
            for one in moving
        )
        return exact_sum(
            max(self.max_speed_m_s * (end_ns - begin_ns) / 1e9 - _length_m(poses, (begin_ns, end_ns)), 0.0)
            for begin_ns, end_ns in spans_ns.tolist()
        )


def _length_m(poses: Poses, within_ns: tuple[int, int]) -> float:
    """The way through the poses of a stretch, m."""
    inside = (poses.stamp_ns >= within_ns[0]) & (poses.stamp_ns <= within_ns[1])
    return exact_sum(lengths_m(poses.position_m[inside]))


_SAME_M = 1e-9
"""Ways that differ by less are the same."""


@dataclass(frozen=True)
class SeenJerk(PolynomialJerk):
    """The tool moves smoothly, and all of its motion is looked at.

    Measures:
        The same mean; undecided where a velocity is missing, for nothing bounds the jerk there.
    Violated when:
        Never: how smooth is smooth enough is for the rules to say.
    Attributes:
        max_gap_s: A longer stretch without a velocity is not seen; nor is one of more than 1.5 usual ones.
        rate_hz: How often there is a velocity; 0: as often as they came.
    Source:
        The strict reading is our own; the mean is that of `ScoringTier2.cc`, lines 547 to 640.
    """

    max_gap_s: float = parameter(0.1, unit="s", above=0, at_most=60, source=_GAP)
    rate_hz: float = parameter(0.0, unit="Hz", at_least=0, at_most=1e5, source="not public")

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the task."""
        consumed = consumed_of(trial)
        for finding in super().judge(trial, item):
            if consumed is None or finding.verdict is not Verdict.SATISFIED:
                yield finding
                continue
            stamps = np.unique(consumed.messages.controller.stamp_ns)
            span_ns = consumed.with_task(consumed.span_ns)
            unseen_ns = _unseen_ns(stamps, span_ns, self.rate_hz, self.max_gap_s)
            unseen_s = _lasting_ns(unseen_ns) / 1e9
            if unseen_s > 0:
                why = f"{finding.message}, and {CONTROLLER} was silent for {unseen_s:.3f} s"
                yield Finding.inconclusive(item.id, why)
            else:
                yield finding


@dataclass(frozen=True)
class InsertionInPort(Insertion):
    """The plug is in its port, seen from the port.

    Measures:
        What the last insertion event says; without one where the plug is in the frame of its port when the
        task ends. A plug is partly inserted between the entrance and `below_m` under the port, no further
        than `aside_m` from the axis between the two, and turned by no more than `max_turn_rad`.
    Violated when:
        No event says that it is in its port. Undecided where events were not recorded, or where nobody saw
        where plug and port were when the task ended.
    Attributes:
        max_turn_rad: How far a plug may be turned against its port to be partly in it.
    Source:
        The strict reading is our own; distances are those of `ScoringTier2.cc`. Plug and port have the same
        orientation in a port, as the organisers' own example policy has them.
    """

    max_turn_rad: float = parameter(
        0.2,
        unit="rad",
        above=0,
        at_most=3.2,
        source="our choice: twice what a port of 46 mm leaves 5 mm aside",
    )

    unseen: Literal["none", "open"] = parameter("open", source="our choice")

    def _completed(self, consumed: Consumed, connection: Connection, item: WorkItem) -> Finding:
        found = super()._completed(consumed, connection, item)
        seen = found.verdict is Verdict.INCONCLUSIVE or consumed.times.end_ns is None
        seen = seen or any(found.quantities[name] for name in ("right_port", "placed", "wrong_port"))
        return found if seen else Finding.inconclusive(item.id, found.message)

    def plug_at(self, consumed: Consumed, connection: Connection, stamp_ns: int) -> Plug:
        """Where the plug is as seen from its port: aside of the axis to the entrance, and along it."""
        plug, port, entrance = consumed.frames_of(connection)
        inside = consumed.buffer.lookup(port, plug, stamp_ns)
        opening = consumed.buffer.lookup(port, entrance, stamp_ns)
        if inside is None or opening is None:
            return Plug(None, None, None)
        depth_m = sqrt(sum(v * v for v in opening.position_m))
        if not depth_m:
            return Plug(None, None, None)
        along_m = sum(p * o for p, o in zip(inside.position_m, opening.position_m, strict=True)) / depth_m
        aside_m = sqrt(max(sum(v * v for v in inside.position_m) - along_m * along_m, 0.0))
        turn_rad = 2 * acos(min(abs(inside.turn_xyzw[3]), 1.0))
        return Plug((aside_m, 0.0, along_m), (0.0, 0.0, 0.0), (0.0, 0.0, depth_m), turn_rad)

    def is_straight(self, plug: Plug) -> bool:
        """Whether plug and port have about the same orientation."""
        return plug.turn_rad <= self.max_turn_rad
