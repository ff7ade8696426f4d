"""What every monitor of a (robot, human) pair does: find its signals, its gaps, its episodes."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ariac_score import (
    Finding,
    MissingSignalError,
    Sample,
    Signal,
    Span,
    Trial,
    align,
    episodes_where,
    sample_durations,
    uncovered_spans,
)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Watched:
    """Signals of one pair on one time base, cut to the competition.

    Attributes:
        t: Sample times, shape (n,), s.
        columns: Values by signal name, each shape (n,).
        gaps: Stretches of the competition without samples.
        max_gap_s: A sample stands for no longer than this, s.
        units: Unit by signal name.
    """

    t: FloatArray
    columns: Mapping[str, FloatArray]
    gaps: Sequence[Span]
    max_gap_s: float
    units: Mapping[str, str]

    def samples(self, row: int) -> tuple[Sample, ...]:
        """What was measured in one row, as evidence."""
        return tuple(
            Sample(name, float(self.t[row]), float(column[row]), self.units[name])
            for name, column in self.columns.items()
        )


def watch_pairs(
    trial: Trial,
    wanted: Mapping[str, str],
    *,
    max_gap_s: float,
    clause: str,
    judge: Callable[[str, Watched], Iterator[Finding]],
) -> Iterator[Finding]:
    """Judge every (robot, human) pair; what cannot be judged is said for each pair.

    Args:
        trial: The trial.
        wanted: Unit by signal name, with `{robot}` and `{human}` to be filled in.
        max_gap_s: Longest stretch without a sample that is accepted, s.
        clause: Clause for the findings about what is missing.
        judge: Findings about one pair, given its subject and its signals.
    """
    pairs = list(trial.pairs())
    if not pairs:
        yield _nobody(trial, clause)
    for robot, human in pairs:
        subject = f"{robot.id}/{human.id}"
        names = {n.format(robot=robot.id, human=human.id): unit for n, unit in wanted.items()}
        try:
            signals = [trial.signal(name, unit=unit) for name, unit in names.items()]
        except MissingSignalError as missing:
            yield Finding.inconclusive(
                subject, f"{missing}{_looked_for(trial)}", span=trial.window, clause=clause
            )
            continue
        watched = _watched(trial, signals, max_gap_s)
        if (trial.started_s is None) != (trial.ended_s is None):
            missing_end = "end" if trial.ended_s is None else "start"
            message = (
                f"the log does not show the {missing_end} of the competition, so part of it may be missing"
            )
            yield Finding.inconclusive(subject, message, span=trial.window, clause=clause)
        for gap in watched.gaps:
            message = f"no samples for {gap.duration_s:.3f} s, from {gap.start_s:.3f} s"
            yield Finding.inconclusive(subject, message, span=gap, clause=clause)
        if len(watched.t):
            yield from judge(subject, watched)


def _nobody(trial: Trial, clause: str) -> Finding:
    """The finding when there is no robot or no human to watch."""
    missing = " and no ".join(kind for kind in ("robot", "human") if not trial.bodies_of(kind))
    if "bodies" in trial.witnessed:
        return Finding.not_applicable(
            "trial", f"the log records every body, and there is no {missing} among them", clause=clause
        )
    return Finding.inconclusive(
        "trial", f"the log shows no {missing}{_looked_for(trial)}", span=trial.window, clause=clause
    )


def _looked_for(trial: Trial) -> str:
    return f"; not in the log: {', '.join(trial.unrecorded)}" if trial.unrecorded else ""


def _watched(trial: Trial, signals: Sequence[Signal], max_gap_s: float) -> Watched:
    t, columns = align(signals, max_gap_s=max_gap_s)
    window = trial.window
    gaps: list[Span] = []
    if window is not None:
        inside = (t >= window.start_s) & (t <= window.end_s)
        t, columns = t[inside], [column[inside] for column in columns]
        gaps = uncovered_spans(t, window, max_gap_s=max_gap_s)
    names = [signal.name for signal in signals]
    units = {signal.name: signal.unit for signal in signals}
    return Watched(t, dict(zip(names, columns, strict=True)), gaps, max_gap_s, units)


@dataclass(frozen=True)
class Episode:
    """One violation over time, with the severities of the monitor catalogue, section 1.3.

    Attributes:
        span: From its first to the end of its last violating sample.
        rows: Indices of its violating samples.
        worst: Row with the least margin.
        quantities: `time_in_violation_s`, `depth_max_m`, `depth_integral_m_s`,
            `relative_depth_integral_s`, `relative_depth_max`.
    """

    span: Span
    rows: NDArray[np.intp]
    worst: int
    quantities: Mapping[str, float]


def episodes_below(
    watched: Watched, margin_m: FloatArray, required_m: FloatArray, *, t_on_s: float, t_off_s: float
) -> list[Episode]:
    """The episodes in which a distance falls short of what is required.

    Args:
        watched: The time base.
        margin_m: Distance less required distance, shape (n,), m; negative violates.
        required_m: Required distance, shape (n,), m.
        t_on_s: Shortest violation that counts, s.
        t_off_s: Pauses shorter than this are bridged, s.
    """
    holds = margin_m < 0
    weights_s = sample_durations(watched.t, longest_s=watched.max_gap_s)
    depth_m = np.maximum(-margin_m, 0.0)
    relative = np.clip(
        np.divide(depth_m, required_m, out=np.ones_like(depth_m), where=required_m > 0), 0.0, 1.0
    )
    found = []
    for span in episodes_where(watched.t, holds, t_on_s=t_on_s, t_off_s=t_off_s, longest_s=watched.max_gap_s):
        rows = np.flatnonzero(holds & (watched.t >= span.start_s) & (watched.t <= span.end_s))
        weight_s = weights_s[rows]
        found.append(
            Episode(
                span,
                rows,
                int(rows[np.argmin(margin_m[rows])]),
                {
                    "time_in_violation_s": float(weight_s.sum()),
                    "depth_max_m": float(depth_m[rows].max()),
                    "depth_integral_m_s": float((depth_m[rows] * weight_s).sum()),
                    "relative_depth_max": float(relative[rows].max()),
                    "relative_depth_integral_s": float((relative[rows] * weight_s).sum()),
                },
            )
        )
    return found
