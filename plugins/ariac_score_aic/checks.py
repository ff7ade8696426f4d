"""What the scorer measures of a task: forces, contacts, the time, the path and the jerk of the tool."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from ariac_score import (
    Cause,
    Chart,
    Finding,
    FloatArray,
    Measure,
    Sample,
    Span,
    Trial,
    Verdict,
    WorkItem,
    Worlds,
    check_parameters,
    parameter,
)
from ariac_score_aic import charts
from ariac_score_aic.consumption import Consumed, consumed_of
from ariac_score_aic.jerk import MeanJerk, jerk_of_poses
from ariac_score_aic.messages import CONTACTS, IntArray, seconds_of

__all__ = ["Contacts", "ForceTime", "PathLength", "PolynomialJerk", "PoseJerk", "TaskTime"]

NO_RECORDING = "no recording of the engine is among the files of the trial"
_SOURCE = "aic_scoring/src/ScoringTier2.cc of intrinsic-dev/aic, db40abcf"


@dataclass(frozen=True)
class TaskTime:
    """The task is completed, in a time.

    Measures:
        From the acceptance of the goal to the result with success, in s; whether it was completed, and
        whether its start is known.
    Violated when:
        It is known that the task was not completed.
    Source:
        `ScoringTier2.cc`, lines 936 to 948; the times are those of `aic_engine.cpp`, lines 1377 and 1415.
    """

    part_of: ClassVar[str] = "task"
    mistake: ClassVar[tuple[str, str]] = ("task not completed", "tasks not completed")
    level: ClassVar[str] = "task"
    measures: ClassVar[Mapping[str, Measure]] = {
        "task_time_s": Measure(
            "s", best=0.0, worst=1e6, signed=True, meaning="from start to end of the task"
        ),
        "completed": Measure("count", best=1.0, worst=0.0, meaning="1 where the task was completed"),
        "timed": Measure("count", best=1.0, worst=0.0, meaning="1 where start and end are known"),
    }

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the task."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        times, source = consumed.times, f" ({consumed.times.source})" if consumed.times.source else ""
        if times.not_completed:
            gone = {"task_time_s": 0.0, "completed": 0.0, "timed": 0.0}
            yield Finding(item.id, Verdict.VIOLATED, f"the task was not completed{source}", quantities=gone)
        elif times.duration_s is not None:
            about = "" if times.exact else "about "
            yield Finding(
                item.id,
                Verdict.SATISFIED,
                f"completed in {about}{times.duration_s:.3f} s{source}",
                span=_span(consumed, times.start_ns, times.end_ns),
                quantities={"task_time_s": times.duration_s, "completed": 1.0, "timed": 1.0},
            )
        elif times.completed and times.start_known:
            known = {"task_time_s": 0.0, "completed": 1.0, "timed": 0.0}
            yield Finding(item.id, Verdict.SATISFIED, f"completed, without a start{source}", quantities=known)
        else:
            yield Finding(
                item.id,
                Verdict.INCONCLUSIVE,
                "no file says when the task started and ended: add task_times.yaml or scoring.yaml",
                quantities={"completed": 1.0} if times.completed else {},
            )

    def judge_worlds(self, trial: Trial, item: WorkItem) -> Iterator[Finding | Worlds]:
        """The same, and of an undecided one the shortest and the longest time that the recording allows."""
        consumed = consumed_of(trial)
        for finding in self.judge(trial, item):
            yield finding
            if consumed is None or finding.verdict is not Verdict.INCONCLUSIVE:
                continue
            bounds_s = consumed.bounds.duration_s or (0.0, consumed.longest_limit_s)
            found = [
                Finding(
                    item.id,
                    Verdict.SATISFIED,
                    f"completed in {word} {time_s:.3f} s",
                    quantities={"task_time_s": time_s, "completed": 1.0, "timed": 1.0},
                )
                for word, time_s in zip(("no less than", "no more than"), bounds_s, strict=True)
            ]
            if not consumed.times.completed:
                # With the longest time, for a task that was not completed took none and must not look quick.
                gone = {"task_time_s": bounds_s[1], "completed": 0.0, "timed": 0.0}
                found[1] = Finding(
                    item.id, Verdict.VIOLATED, "nothing shows that it was completed", quantities=gone
                )
            yield Worlds(item.id, (found[0],), (found[1],), (Cause(finding.message),))


def _span(consumed: Consumed, start_ns: int | None, end_ns: int | None) -> Span | None:
    if start_ns is None or end_ns is None or end_ns < start_ns:
        return None
    found = consumed.trial_s([start_ns, end_ns])
    return Span(found[0], found[1]) if found else None


@dataclass(frozen=True)
class ForceTime:
    """The tool does not push hard for long.

    Measures:
        The time for which the force at the wrist, without the offset that the controller states, is above
        `threshold_n`: the sum of the steps before each such sample, whatever their length, all over the
        recording.
    Violated when:
        That time is longer than `limit_s`.
    Attributes:
        threshold_n: Force above which time counts.
        limit_s: The longest time that costs nothing.
        unseen: What no force means: nothing (none), or that it is undecided (open).
    Source:
        `ScoringTier2.cc`, lines 860 to 905: both comparisons are strict, the first sample counts for nothing.
    """

    part_of: ClassVar[str] = "safety"
    mistake: ClassVar[tuple[str, str]] = ("excessive force", "times of excessive force")
    level: ClassVar[str] = "task"
    measures: ClassVar[Mapping[str, Measure]] = {
        "time_above_s": Measure("s", best=0.0, signed=True, meaning="time above the threshold"),
        "peak_force_n": Measure("N", best=0.0, meaning="the largest force but for the first sample"),
    }

    threshold_n: float = parameter(20.0, unit="N", above=0, at_most=1e4, status="verified", source=_SOURCE)
    limit_s: float = parameter(1.0, unit="s", at_least=0, at_most=1e4, status="verified", source=_SOURCE)
    unseen: Literal["none", "open"] = parameter(
        "open", source="the scorer counts no force where none was recorded"
    )

    def __post_init__(self) -> None:
        check_parameters(self)

    def charts(self, trial: Trial) -> Iterator[Chart]:
        """The force at the wrist with its threshold."""
        return charts.of_force(trial, self.threshold_n)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the task."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        stamps, force = consumed.forces
        if not len(stamps) and self.unseen == "open":
            yield Finding.inconclusive(item.id, _why_no_force(consumed))
            return
        time_s, peak_n, above = self.time_above_s(stamps / 1e9, np.sqrt((force**2).sum(axis=1)))
        yield Finding(
            item.id,
            Verdict.VIOLATED if time_s > self.limit_s else Verdict.SATISFIED,
            f"above {self.threshold_n:g} N for {time_s:.3f} s, at most {peak_n:.2f} N"
            if len(stamps)
            else f"no force counts: {_why_no_force(consumed)}",
            robustness=self.limit_s - time_s,
            unit="s",
            quantities={"time_above_s": time_s, "peak_force_n": peak_n},
            evidence=_evidence(consumed, stamps, force, above),
        )

    def time_above_s(self, t_s: FloatArray, force_n: FloatArray) -> tuple[float, float, IntArray]:
        """The time above the threshold in s, the peak in N, and at which samples it is above."""
        above = np.flatnonzero(force_n[1:] > self.threshold_n) + 1
        steps = t_s[above] - t_s[above - 1]
        # One after the other, as the scorer adds: the last bits of a second decide.
        total_s = float(np.cumsum(steps)[-1]) if len(steps) else 0.0
        peak_n = float(np.fmax.reduce(force_n[1:], initial=0.0))  # what is no number is never larger
        return total_s, peak_n, above


def _why_no_force(consumed: Consumed) -> str:
    topic, topics = consumed.how.wrench_topic, consumed.messages.topics
    if topic not in topics:
        return f"{topic} was not recorded"
    if not topics[topic]:
        return f"{topic} has no messages"
    return "no state of the controller came before any force"


def _evidence(consumed: Consumed, stamps: IntArray, force: FloatArray, above: IntArray) -> tuple[Sample, ...]:
    """The largest force above the threshold."""
    if not len(above):
        return ()
    worst = int(above[np.argmax((force[above] ** 2).sum(axis=1))])
    at = consumed.trial_s([int(stamps[worst])])
    value = tuple(float(v) for v in force[worst])
    return (Sample("force/tool", at[0], value, "N"),) if at else ()


@dataclass(frozen=True)
class Contacts:
    """Nothing touches what is off limits.

    Measures:
        The messages of the simulator that name a contact.
    Violated when:
        There is one; all of a trial are one violation.
    Attributes:
        unseen: What no topic of contacts means: nothing (none), or that it is undecided (open).
    Source:
        `ScoringTier2.cc`, lines 907 to 930.
    """

    part_of: ClassVar[str] = "safety"
    mistake: ClassVar[tuple[str, str]] = ("contact off limits", "contacts off limits")
    level: ClassVar[str] = "task"
    measures: ClassVar[Mapping[str, Measure]] = {
        "messages": Measure("count", best=0.0, meaning="messages that name a contact")
    }

    unseen: Literal["none", "open"] = parameter(
        "open", source="the scorer takes a topic without messages for none"
    )

    def __post_init__(self) -> None:
        check_parameters(self)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the task."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        found = consumed.messages.contacts
        if found.texts:
            pair = [name.decode("utf-8", "replace") for name in found.texts[0].split(b"\0")]
            times = consumed.trial_s(found.log_ns.tolist())
            yield Finding(
                item.id,
                Verdict.VIOLATED,
                f"{' touches '.join(pair)}; {len(found.texts)} messages name contacts",
                span=Span(min(times), max(times)) if times else None,
                quantities={"messages": float(len(found.texts))},
            )
            return
        recorded = consumed.messages.witnesses_contacts
        if not recorded and self.unseen == "open":
            yield Finding.inconclusive(item.id, f"{CONTACTS} was not recorded")
            return
        words = "no contact was reported" if recorded else f"{CONTACTS} was not recorded, so none counts"
        yield Finding(item.id, Verdict.SATISFIED, words, quantities={"messages": 0.0})


@dataclass(frozen=True)
class PathLength:
    """The gripper takes a short way.

    Measures:
        The length of the polyline through the poses of the gripper that the scorer appends, all over the
        recording, in m.
    Violated when:
        Never: what is long enough to cost points is for the rules to say.
    Attributes:
        unseen: What no pose of the gripper means: nothing (none), or that it is undecided (open).
    Source:
        `ScoringTier2.cc`, lines 640 to 690: after each message of a moving topic the latest pose, if its
        stamp is new.
    """

    part_of: ClassVar[str] = "task"
    level: ClassVar[str] = "task"
    measures: ClassVar[Mapping[str, Measure]] = {
        "path_length_m": Measure("m", best=0.0, worst=1e6, signed=False, meaning="way of the gripper"),
        "poses": Measure("count", meaning="poses that were appended", best=0.0, worst=0.0),
    }

    unseen: Literal["none", "open"] = parameter(
        "open", source="the scorer takes a path without poses for 0 m"
    )

    def __post_init__(self) -> None:
        check_parameters(self)

    def charts(self, trial: Trial) -> Iterator[Chart]:
        """The speed of the tool."""
        return charts.of_speed(trial)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the task."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        poses, how = consumed.poses, consumed.how
        why = ""
        if not len(poses):
            why = f"no pose of {how.gripper_frame} in {how.reference_frame} could be had while reading"
            if self.unseen == "open":
                yield Finding.inconclusive(item.id, why)
                return
        yield Finding(
            item.id,
            Verdict.SATISFIED,
            f"{why}: 0 m count" if why else f"{consumed.path_length_m:.3f} m through {len(poses)} poses",
            quantities={"path_length_m": consumed.path_length_m, "poses": float(len(poses))},
        )


@dataclass(frozen=True)
class PolynomialJerk:
    """The tool moves smoothly.

    Measures:
        The mean magnitude of the tool's jerk, from a quadratic fitted to its velocities over `window` samples
        around each sample that is faster than `gate_m_s`, weighted with the length of the window.
    Violated when:
        Never: how smooth is smooth enough is for the rules to say.
    Attributes:
        window: How many samples a fit takes.
        gate_m_s: Samples at this speed or below do not count.
        unseen: What no velocity means: nothing (none), or that it is undecided (open).
    Source:
        `ScoringTier2.cc`, lines 547 to 640.
    """

    part_of: ClassVar[str] = "task"
    level: ClassVar[str] = "task"
    measures: ClassVar[Mapping[str, Measure]] = {
        "mean_jerk_m_s3": Measure(
            "m/s^3", best=0.0, worst=1e12, signed=False, meaning="mean magnitude of jerk"
        ),
        "measured": Measure("count", best=1.0, worst=0.0, meaning="1 where there is such a mean"),
    }

    window: int = parameter(15, at_least=3, at_most=1001, status="verified", source=_SOURCE)
    gate_m_s: float = parameter(0.01, unit="m/s", at_least=0, at_most=10, status="verified", source=_SOURCE)
    unseen: Literal["none", "open"] = parameter(
        "open", source="the scorer gives no points without velocities"
    )

    def __post_init__(self) -> None:
        check_parameters(self)

    def charts(self, trial: Trial) -> Iterator[Chart]:
        """The jerk around each sample that counts."""
        consumed = consumed_of(trial)
        if consumed is not None and consumed.messages.recorded_ns is not None:
            found = consumed.jerk(self.window, self.gate_m_s)
            begin_s = consumed.messages.recorded_ns[0] / 1e9 - consumed.later_s
            yield from charts.of_jerk(found.at_s - begin_s, found.jerk_m_s3)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the task."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        found = consumed.jerk(self.window, self.gate_m_s)
        yield _of_jerk(item, found, undecided=self.unseen == "open" and not found.samples)


@dataclass(frozen=True)
class PoseJerk:
    """The tool moves smoothly, as it was measured until February 24.

    Measures:
        The mean jerk of the gripper, from third differences over four neighbouring poses.
    Violated when:
        Never: how smooth is smooth enough is for the rules to say.
    Attributes:
        average: Whether jerks are averaged as vectors or by their magnitudes.
        gate_m_s: With magnitudes, what is not faster than this does not count.
        unseen: What too few poses mean: no jerk to give points for (none), or a tool at rest (still).
    Source:
        `ScoringTier2.cc` at 15839f2e1 (mean of vectors) and e0a428b3a (mean of magnitudes).
    """

    part_of: ClassVar[str] = "task"
    level: ClassVar[str] = "task"
    measures: ClassVar[Mapping[str, Measure]] = PolynomialJerk.measures

    average: Literal["vectors", "magnitudes"] = parameter("magnitudes", source="PR 284")
    gate_m_s: float = parameter(0.01, unit="m/s", at_least=0, at_most=10, source="PR 284")
    unseen: Literal["none", "still"] = parameter(
        "none", source="until PR 334 the mean began at 0 and stayed there without four poses"
    )

    def __post_init__(self) -> None:
        check_parameters(self)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the task."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        poses = consumed.poses
        t_s, position_m = seconds_of(poses.stamp_ns), poses.position_m
        if not consumed.how.poses_while_reading and len(t_s):
            # What is not later than all before was left out.
            later = np.concatenate(([True], t_s[1:] > np.maximum.accumulate(t_s)[:-1]))
            t_s, position_m = t_s[later], position_m[later]
        found = jerk_of_poses(t_s, position_m, average=self.average, gate_m_s=self.gate_m_s)
        if found.value_m_s3 is None and self.unseen == "still":
            found = replace(found, value_m_s3=0.0)
        yield _of_jerk(item, found, undecided=False)


def _of_jerk(item: WorkItem, found: MeanJerk, *, undecided: bool) -> Finding:
    if undecided:
        return Finding.inconclusive(item.id, f"no jerk: {found.why_not}")
    measured = found.value_m_s3 is not None
    value = found.value_m_s3 or 0.0
    return Finding(
        item.id,
        Verdict.SATISFIED if measured else Verdict.NOT_APPLICABLE,
        f"mean jerk {value:.3f} m/s^3 at {found.counted} samples"
        if measured
        else f"no jerk: {found.why_not}",
        quantities={"mean_jerk_m_s3": value, "measured": 1.0} if measured else {},
    )
