"""The monitor `barn.navigation`: whether the robot reached its goal, and how long it took."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ariac_score import (
    Body,
    Event,
    Finding,
    FloatArray,
    Measure,
    MissingSignalError,
    Sample,
    Signal,
    SignalNeed,
    Span,
    Trial,
    Verdict,
    check_parameters,
    parameter,
)
from barn_challenge.readers import COLLISION, GOAL_M, ROBOT, START_M

__all__ = ["Navigation"]

_SOURCE = "run.py of the BARN Challenge, section 2"


@dataclass(frozen=True)
class Navigation:
    """The robot reaches its goal without touching anything, in time.

    Measures:
        The time from the first turn at which the robot is `start_m` away from its start to the
        first one at which it is within `goal_m` of its goal, has collided, or was on its way for
        `limit_s`.
    Violated when:
        It has collided, or the time is `limit_s` or more. A stretch on the way without any position
        for longer than `max_gap_s` is inconclusive.
    Source:
        `run.py` of the BARN Challenge, section 2.
    """

    part_of: ClassVar[str] = "task"

    also_about: ClassVar[tuple[str, ...]] = (ROBOT,)
    measures: ClassVar[Mapping[str, Measure]] = {
        "actual_time_s": Measure(
            "s", best=0.0, meaning="from the first move to the goal, the collision or the limit"
        ),
    }

    start_m: float = parameter(0.1, unit="m", above=0, at_most=10, status="verified", source=_SOURCE)
    goal_m: float = parameter(1.0, unit="m", above=0, at_most=10, status="verified", source=_SOURCE)
    limit_s: float = parameter(100.0, unit="s", above=0, at_most=10_000, status="verified", source=_SOURCE)
    max_gap_s: float = parameter(1.0, unit="s", above=0, at_most=60, source="ten turns of run.py")

    def __post_init__(self) -> None:
        check_parameters(self)

    def needs(self) -> Iterator[SignalNeed]:
        """Where the robot is, about every 0.1 s."""
        yield SignalNeed("position", "m", self.max_gap_s)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """One finding about the robot."""
        try:
            position = trial.signal(f"position/{ROBOT}", unit="m")
        except MissingSignalError as missing:
            yield Finding.inconclusive(ROBOT, str(missing), span=trial.window)
            return
        if COLLISION not in trial.witnessed:
            yield Finding.inconclusive(ROBOT, "no log would have shown a collision", span=trial.window)
            return
        yield self._judge(trial, position)

    def example_trials(self, made: Trial) -> Iterator[Trial]:
        """A run that reaches its goal, and one that collides: where both are is known to this code alone."""
        t = np.arange(0.0, 20.0, 0.1)
        y_m = np.clip(START_M[1] + 0.6 * t, START_M[1], GOAL_M[1])
        place = Signal(
            f"position/{ROBOT}", "m", t, np.column_stack([np.full(len(t), START_M[0]), y_m, 0.0 * t])
        )
        run = replace(
            made,
            bodies=(Body(ROBOT, "robot"),),
            signals={place.name: place},
            witnessed=made.witnessed | {COLLISION},
        )
        yield run
        yield replace(run, events=tuple(sorted((*run.events, Event(8.0, COLLISION, ROBOT)))))

    def _judge(self, trial: Trial, position: Signal) -> Finding:
        t, place_m = position.t, position.values[:, :2]
        moved = np.flatnonzero(_distance_m(place_m, START_M) >= self.start_m)
        if not len(moved):
            return Finding.inconclusive(ROBOT, "the trace ends before the robot moved", span=trial.window)
        begin = int(moved[0])
        left_m = _distance_m(place_m, GOAL_M)
        collided_s = min((e.t_s for e in trial.events if e.kind == COLLISION), default=np.inf)
        over = (left_m <= self.goal_m) | (t >= collided_s) | (t - t[begin] >= self.limit_s)
        ends = np.flatnonzero(over[begin:])
        if not len(ends):
            return Finding.inconclusive(
                ROBOT, "the trace ends on the way", span=Span(float(t[begin]), float(t[-1]))
            )
        end = begin + int(ends[0])
        # From the turn before the first move: it began somewhere in between.
        gap_s = float(np.diff(t[max(begin - 1, 0) : end + 1]).max(initial=0.0))
        if gap_s > self.max_gap_s:
            span = Span(float(t[max(begin - 1, 0)]), float(t[end]))
            return Finding.inconclusive(ROBOT, f"no position for {gap_s:.3f} s on the way", span=span)
        # run.py counts the turns, so that a collision between two of them is seen at the later one.
        time_s = float(t[end] - t[begin])
        failed = "collided" if t[end] >= collided_s else "ran out of time" if time_s >= self.limit_s else ""
        return Finding(
            ROBOT,
            Verdict.VIOLATED if failed else Verdict.SATISFIED,
            f"{failed or 'reached the goal'} after {time_s:.4f} s, {left_m[end]:.3f} m from it",
            span=Span(float(t[begin]), float(t[end])),
            quantities={"actual_time_s": time_s},
            evidence=(Sample(position.name, float(t[end]), tuple(map(float, position.values[end])), "m"),),
            clause=_SOURCE,
        )


def _distance_m(place_m: FloatArray, other_m: tuple[float, float]) -> FloatArray:
    return np.hypot(place_m[:, 0] - other_m[0], place_m[:, 1] - other_m[1])
