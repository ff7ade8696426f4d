"""Where single models and links were over time, for a competition that sees more in it than motion."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ariac_score.trial.model import Pose
from ariac_score.trial.spans import FloatArray

__all__ = ["ModelTrack"]


@dataclass(frozen=True, eq=False)
class ModelTrack:
    """Where one model or link was.

    Attributes:
        name: Scoped: `model` or `model::link`, with the models it is nested in before it.
        frames: The frames that list it, shape (m,), increasing.
        poses: Its pose in each, in the world frame: x, y, z in m, then roll, pitch, yaw in
            rad, shape (m, 6), or the quaternion w, x, y, z, shape (m, 7).
        deleted: The frames that say it is gone, shape (k,), increasing.
    """

    name: str
    frames: NDArray[np.int64]
    poses: FloatArray
    deleted: NDArray[np.int64]

    @property
    def model(self) -> str:
        """The top-level model."""
        return self.name.partition("::")[0]

    def exists(self, frame: int) -> bool:
        """Whether it was there in a frame: listed by then, and not deleted since."""
        row = int(np.searchsorted(self.frames, frame, side="right")) - 1
        # A model that is listed again after its deletion was put there anew.
        gone = int(np.searchsorted(self.deleted, frame, side="right")) - 1
        return row >= 0 and (gone < 0 or bool(self.deleted[gone] <= self.frames[row]))

    def around(self, frame: int) -> tuple[Pose, Pose] | None:
        """Its poses before and after a frame that lacks it alone; `None` where it is there, or gone for good.

        Raises:
            ValueError: The log gives none that is usable.
        """
        after = int(np.searchsorted(self.frames, frame, side="right"))
        if self.exists(frame) or not 0 < after < len(self.frames):
            return None
        return self._pose(after - 1), self._pose(after)

    def pose(self, frame: int) -> Pose:
        """Its last known pose in a frame in which it exists.

        Raises:
            ValueError: The log gives none that is usable.
        """
        return self._pose(int(np.searchsorted(self.frames, frame, side="right")) - 1)

    def _pose(self, number: int) -> Pose:
        row = self.poses[number].tolist()
        at, turn = (row[0], row[1], row[2]), row[3:]
        if len(turn) == 3:
            if not all(map(math.isfinite, turn)):
                raise ValueError("a pose must be finite")
            return Pose.from_rpy(at, (turn[0], turn[1], turn[2]))
        return Pose(at, (turn[0], turn[1], turn[2], turn[3]))
