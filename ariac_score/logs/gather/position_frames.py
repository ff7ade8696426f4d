"""In which frames positions are given: those of different frames cannot be compared."""

from __future__ import annotations

from pathlib import Path

from ariac_score.errors import LogError

__all__ = ["PositionFrames"]


class PositionFrames:
    """Takes the frames of all sources of positions.

    Args:
        file: The recording, for error messages.
    """

    def __init__(self, file: Path) -> None:
        self._file = file
        self._sources: dict[str, str] = {}

    def take(self, frame: str, source: str) -> None:
        """Take note that a source gives positions in a frame; an empty name says nothing."""
        if name := frame.lstrip("/"):
            self._sources.setdefault(name, source)

    def refuse_several(self) -> None:
        """Refuse positions in different frames.

        Raises:
            LogError: With the frames and who uses them.
        """
        if len(self._sources) > 1:
            (one, first), (other, second), *_ = sorted(self._sources.items())
            raise LogError(
                f"positions are in different frames: {first} in {one!r}, {second} in {other!r}; "
                "their distances mean nothing",
                file=self._file,
                hint="record them in one frame, or let the log map take them from tf (`frames:`), which "
                "transforms them into its root_frame",
            )
