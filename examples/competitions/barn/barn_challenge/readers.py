"""The files of a run: the trace of its robot, the path through its world, what `run.py` wrote of it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ariac_score import (
    Body,
    Clock,
    Event,
    FloatArray,
    LogDescription,
    LogError,
    NothingToScoreError,
    OfficialResult,
    ReaderFacts,
    Span,
    TopicDescription,
    Trial,
    TrialBuilder,
    Wanted,
)

__all__ = [
    "COLLISION",
    "GOAL_M",
    "ROBOT",
    "START_M",
    "Outcome",
    "OutcomeReader",
    "TraceReader",
    "WorldReader",
    "outcomes",
]

ROBOT = "jackal"
COLLISION = "collision"
START_M = (-2.0, 3.0)
"""`INIT_POSITION` of run.py, without the heading."""
GOAL_M = (-2.0, 13.0)
"""`INIT_POSITION` plus `GOAL_POSITION`."""
OPTIMAL_SPEED_M_S = 2.0
"""run.py: `optimal_time = path_length / 2`."""

_HEAD = "# time x y collided"
_MAX_LINES = 200_000
_MAX_PATH_BYTES = 1_000_000
_OUTCOME = "outcome of the BARN Challenge"
_OUTCOME_NAMES = "world_idx success collided timeout time nav_metric"
_TRACE = "write it again with the loop of run.py; a score must not rest on part of a run"


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Number and text of each line that is not empty."""
    try:
        with path.open(encoding="ascii") as stream:
            for number, line in enumerate(stream, 1):
                if number > _MAX_LINES:
                    raise LogError(
                        f"more than {_MAX_LINES:,} lines", file=path, hint="give the files of one run"
                    )
                if line.strip():
                    yield number, line
    except UnicodeDecodeError as cause:
        raise LogError("it is not plain text", file=path, hint=_TRACE) from cause


def _numbers(path: Path, number: int, line: str, names: str) -> list[float]:
    """The numbers of one line, as many as there are names."""
    words = line.split()
    wanted = len(names.split())
    try:
        values = [float(word) for word in words]
    except ValueError:
        values = []
    if len(values) != wanted or not all(map(math.isfinite, values)):
        raise LogError(
            f"{line.strip()[:60]!r} is not {wanted} numbers",
            file=path,
            place=f"line {number}",
            hint=f"a line is '{names}'; " + _TRACE,
        )
    return values


def _starts(path: Path, text: bytes) -> bool:
    try:
        with path.open("rb") as stream:
            return stream.read(len(text)) == text
    except OSError:
        return False


class TraceReader:
    """Reads `trace.txt`: what the loop of `run.py` sees at each of its turns.

    Reads:
        Simulated time in s, x and y of the robot in m, and whether it had collided.
    Refuses:
        A line that is not four numbers, and a file whose last line is not `# end`.
    Source:
        `run.py` of the BARN Challenge, section 2, whose four values it writes down.
    """

    facts = ReaderFacts(a_file="a trace of the robot", formats="traces of the BARN Challenge")

    def can_read(self, path: Path) -> bool:
        """Whether the first line is the head of a trace."""
        return path.is_file() and _starts(path, _HEAD.encode())

    def describe(self, path: Path) -> LogDescription:
        """How many positions there are, over which time."""
        try:
            rows = _trace(path)
        except LogError as error:
            return LogDescription("trace of the BARN Challenge", damage=str(error))
        first, last = float(rows[0, 0]), float(rows[-1, 0])
        gap = float(np.diff(rows[:, 0]).max()) if len(rows) > 1 else None
        topic = TopicDescription("position", "x, y, collided", len(rows), first, last, gap)
        return LogDescription(
            "trace of the BARN Challenge", (topic,), clock="simulated time", duration_s=last - first
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The position of the robot, and the collision at which the run ended."""
        rows = _trace(path)
        builder = TrialBuilder(path.parent.name, file=path, clock=Clock("simulated time"))
        builder.witnessed |= {"bodies", COLLISION}
        builder.add_body(Body(ROBOT, "robot"))
        position_m = np.column_stack([rows[:, 1], rows[:, 2], np.zeros(len(rows))])
        builder.add_signal(f"position/{ROBOT}", "m", rows[:, 0], position_m)
        for t_s in rows[rows[:, 3] != 0, 0][:1]:
            builder.add(Event(float(t_s), COLLISION, ROBOT))
        builder.recorded = Span(float(rows[0, 0]), float(rows[-1, 0]))
        return builder.build()


def _trace(path: Path) -> FloatArray:
    """Time, x, y and collided in each row, shape (n, 4)."""
    rows: list[list[float]] = []
    ended = False
    for number, line in _lines(path):
        if ended:
            raise LogError("there are lines after '# end'", file=path, place=f"line {number}", hint=_TRACE)
        ended = line.strip() == "# end"
        if not ended and number > 1:
            rows.append(_numbers(path, number, line, "time x y collided"))
    if not ended:
        raise LogError("the trace is cut off: its last line is not '# end'", file=path, hint=_TRACE)
    if not rows:
        raise NothingToScoreError("the trace holds no position", file=path, hint="did the robot start?")
    return np.array(rows)


@dataclass(frozen=True)
class _Path:
    world: int
    length_m: float


class WorldReader:
    """Reads `path_<world>.npy`: the shortest path through a world, from which its optimal time follows.

    Reads:
        Cells of the path, as pairs of column and row.
    Refuses:
        A file that is cut off, or holds anything but pairs of numbers.
    Source:
        `run.py` of the BARN Challenge: `path_coord_to_gazebo_coord`, and section 3.
    """

    facts = ReaderFacts("world", "a path through a world", "paths of the BARN dataset (path_<world>.npy)")

    def can_read(self, path: Path) -> bool:
        """Whether it is named like a path of the dataset."""
        return path.is_file() and _PATH_NAME.fullmatch(path.name) is not None

    def describe(self, path: Path) -> LogDescription:
        """The world and the length of its path."""
        try:
            found = _path(path)
        except LogError as error:
            return LogDescription("path of the BARN dataset", damage=str(error))
        return LogDescription(
            "path of the BARN dataset", facts={"world": found.world, "length_m": found.length_m}
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The facts `world` and `optimal_time_s`."""
        found = _path(path)
        builder = TrialBuilder(path.parent.name, file=path, clock=None)
        builder.facts = {"world": found.world, "optimal_time_s": found.length_m / OPTIMAL_SPEED_M_S}
        return builder.build()


_PATH_NAME = re.compile(r"path_([0-9]{1,4})\.npy")


def _path(path: Path) -> _Path:
    """The path from start to goal through the centres of the cells."""
    named = _PATH_NAME.fullmatch(path.name)
    assert named is not None  # `can_read` saw it
    x, y = _cells(path).T
    # A cell is 0.15 m wide; the grid of 30 columns lies left of x = 0, its first row begins at y = 5 m.
    x_m = np.concatenate([[START_M[0]], x * 0.15 - 0.075 - 4.5, [GOAL_M[0]]])
    y_m = np.concatenate([[START_M[1]], y * 0.15 + 0.075 + 5.0, [GOAL_M[1]]])
    return _Path(int(named[1]), float(np.hypot(np.diff(x_m), np.diff(y_m)).sum()))


def _cells(path: Path) -> FloatArray:
    """Column and row of each cell, shape (n, 2)."""
    hint = "copy the file from jackal_helper/worlds/BARN/path_files again"
    if path.stat().st_size > _MAX_PATH_BYTES:
        raise LogError("it is too large for a path through a world", file=path, hint=hint)
    try:
        # Mapped, not loaded: a header may claim more than the file holds, and loading would reserve that.
        cells = np.array(np.load(path, mmap_mode="r", allow_pickle=False), dtype=np.float64)
    except (ValueError, OSError, EOFError, TypeError) as cause:
        raise LogError(f"it cannot be read as an array: {cause}", file=path, hint=hint) from cause
    if cells.ndim != 2 or cells.shape[1] != 2 or not len(cells) or not np.isfinite(cells).all():
        raise LogError(f"it holds no pairs of numbers, but {cells.shape}", file=path, hint=hint)
    return cells


class OutcomeReader:
    """Reads `out.txt`: the line that `run.py` wrote of the run.

    Reads:
        World, success, collision, timeout, time in s, navigation metric.
    Refuses:
        A file of several runs, and a line that is not six numbers.
    Source:
        `run.py` of the BARN Challenge, section 3.
    """

    facts = ReaderFacts("official", "the outcome of a run", "outcomes of the BARN Challenge (out.txt)")

    def can_read(self, path: Path) -> bool:
        """Whether it is called `out.txt`."""
        return path.is_file() and path.name == "out.txt"

    def describe(self, path: Path) -> LogDescription:
        """How many runs there are, and the metric that `run.py` computed of the first."""
        try:
            runs = list(outcomes(path))
        except LogError as error:
            return LogDescription(_OUTCOME, damage=str(error))
        return LogDescription(
            _OUTCOME, facts={"layout": "run.py", "runs": len(runs), "nav_metric": runs[0].nav_metric}
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The official result, and which world it is of."""
        runs = list(outcomes(path))
        if len(runs) != 1:
            raise LogError(
                f"it holds {len(runs)} runs",
                file=path,
                hint="keep the line of this run alone; 'ariac-score barn report' reads all of them",
            )
        (outcome,) = runs
        builder = TrialBuilder(path.parent.name, file=path, clock=None)
        builder.facts = {"world": outcome.world}
        builder.official = OfficialResult(
            path.name,
            outcome.nav_metric,
            None,  # the time on the way, which is not that of the recording
            items={"final_score": f"{outcome.nav_metric:.4f}", "time": f"{outcome.time_s:.4f}"},
        )
        return builder.build()


@dataclass(frozen=True)
class Outcome:
    """One line of `out.txt`.

    Attributes:
        world: Index of the world.
        success: Whether the goal was reached.
        collided: Whether the robot touched something.
        timeout: Whether the time ran out.
        time_s: Time on the way, s.
        nav_metric: The navigation metric.
    """

    world: int
    success: bool
    collided: bool
    timeout: bool
    time_s: float
    nav_metric: float


def outcomes(path: Path) -> Iterator[Outcome]:
    """The runs of an `out.txt`, in order.

    Raises:
        NothingToScoreError: There is none.
        LogError: A line is not six numbers, or does not say how the run ended.
    """
    number = 0
    for number, line in _lines(path):
        world, success, collided, timeout, time_s, metric = _numbers(path, number, line, _OUTCOME_NAMES)
        flags = (success, collided, timeout)
        # run.py lets a collision at the time limit count as both.
        if not set(flags) <= {0.0, 1.0} or success == max(collided, timeout) or world != int(world):
            raise LogError(
                f"{line.strip()!r} does not say how the run ended",
                file=path,
                place=f"line {number}",
                hint="success, collided and timeout are 1 or 0, and a run succeeded or it did not",
            )
        yield Outcome(int(world), success == 1, collided == 1, timeout == 1, time_s, metric)
    if not number:
        raise NothingToScoreError("the file is empty", file=path, hint="let run.py finish the run")
