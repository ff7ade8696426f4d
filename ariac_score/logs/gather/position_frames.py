"""In which frames positions are given: those of different frames cannot be compared."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from ariac_score.errors import LogError
from ariac_score.logs.gather.message_fields import nearest

__all__ = ["PositionFrames", "refuse_unknown_root"]


def refuse_unknown_root(root: str, frames: Collection[str], *, file: Path) -> None:
    """Refuse a root frame that no transform names, as none then leads to it.

    Args:
        root: The frame of the log map.
        frames: Those of the recorded transforms.
        file: The recording, for the error message.

    Raises:
        LogError: With the frames that there are.
    """
    if root not in frames:
        raise LogError(
            f"'root_frame: {root}' of the log map is no recorded frame, so no transform leads to it",
            file=file,
            hint=nearest(root, sorted(frames), what="recorded frames"),
        )


class PositionFrames:
    """Takes the frames of all sources of positions.

    Args:
        file: The recording, for error messages.
        root: The frame of the log map, which transforms could lead to.
    """

    def __init__(self, file: Path, root: str) -> None:
        self._file, self._root = file, root
        self._sources: dict[str, str] = {}

    def take(self, frame: str, source: str) -> None:
        """Take note that a source gives positions in a frame; an empty name says nothing."""
        if name := frame.lstrip("/"):
            self._sources.setdefault(name, source)

    @property
    def several(self) -> bool:
        """Whether positions are in different frames."""
        return len(self._sources) > 1

    def refuse_several(self) -> None:
        """Refuse positions in different frames.

        Raises:
            LogError: With the frames and who uses them.
        """
        if self.several:
            (one, first), (other, second), *_ = sorted(self._sources.items())
            raise LogError(
                f"positions are in different frames: {first} in {one!r}, {second} in {other!r}; "
                f"their distances mean nothing, and no recorded transforms lead from both to {self._root!r}",
                file=self._file,
                hint="record /tf and /tf_static too, and let `root_frame:` of the log map name the frame "
                "that all hang under; or record positions in one frame",
            )
