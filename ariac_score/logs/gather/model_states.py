"""Positions and velocities of bodies, from messages that list all models or links of Gazebo."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ariac_score.logs.containers.items import IntArray
from ariac_score.logs.gather.arrival import arrival_jitter_s
from ariac_score.logs.gather.message_fields import nearest
from ariac_score.logs.gather.numbering import Unknown
from ariac_score.logs.gather.transforms import Retimed, times_s
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import OF_FRAMES, OF_MODELS, BodyMatch
from ariac_score.trial.model import Body
from ariac_score.trial.spans import FloatArray

__all__ = ["ModelPoses"]


@dataclass
class _Track:
    """Samples of one model or link: x, y, z in m, then its velocity in m/s."""

    body: Body
    rate_hz: float
    stamps_ns: array[int] = field(default_factory=lambda: array("q"))
    rows: array[float] = field(default_factory=lambda: array("d"))


class ModelPoses:
    """Collects `gazebo_msgs/ModelStates` and `LinkStates`: positions and velocities of bodies.

    Args:
        matches: Which model names are bodies.
    """

    def __init__(self, matches: Sequence[BodyMatch]) -> None:
        self._matches = matches
        self._tracks: dict[str, _Track | None] = {}
        self._matched: set[str] = set()
        self._received = False

    def add(self, message: Any, stamp_ns: int, *, links: bool) -> None:
        """Take one message.

        Args:
            message: With `name`, `pose` and `twist`, of one length.
            stamp_ns: Its time, ns.
            links: Whether its names are `model::link`.

        Raises:
            TypeError: The lengths differ.
        """
        if not len(message.name) == len(message.pose) == len(message.twist):
            raise TypeError("name, pose and twist differ in length")
        self._received = True
        for name, pose, twist in zip(message.name, message.pose, message.twist, strict=True):
            track = self._track(name, links=links)
            if track is not None:
                at, speed = pose.position, twist.linear
                track.stamps_ns.append(stamp_ns)
                track.rows.extend((at.x, at.y, at.z, speed.x, speed.y, speed.z))

    def add_many(
        self,
        names: Sequence[str],
        found: IntArray,
        rows: FloatArray,
        stamps_ns: IntArray,
        links: NDArray[np.bool_],
    ) -> None:
        """Take many states, in recorded order.

        Args:
            names: Names of models or links.
            found: Of each state, which name it has, shape (n,).
            rows: Position x, y, z in m and velocity x, y, z in m/s, shape (n, 6).
            stamps_ns: Its time, ns, shape (n,).
            links: Whether its name is `model::link`, shape (n,).
        """
        self._received = True
        for code, first in zip(*(a.tolist() for a in np.unique(found, return_index=True)), strict=True):
            track = self._track(names[code], links=bool(links[first]))
            if track is not None:
                own = found == code
                track.stamps_ns.frombytes(stamps_ns[own].tobytes())
                track.rows.frombytes(rows[own].tobytes())

    def _track(self, name: str, *, links: bool) -> _Track | None:
        # `None` for names that do not matter: patterns are matched once for each name.
        if name not in self._tracks:
            self._tracks[name] = self._new_track(name, links=links)
        return self._tracks[name]

    def _new_track(self, name: str, *, links: bool) -> _Track | None:
        model, _, link = name.partition("::") if links else (name, "", "")
        for match in self._matches:
            body = match.body_for(model)
            if body is not None and (not links or match.follows_link(link)):
                self._matched.add(match.match)  # the first match wins, as in the order of the log map
                return _Track(replace(body, links=(link.replace("/", "_"),)) if link else body, match.rate_hz)
        return None

    @property
    def places_any(self) -> bool:
        """Whether a recorded model is a body."""
        return any(track is not None for track in self._tracks.values())

    def link_names(self) -> set[str]:
        """The names of all recorded links, without those of their models."""
        return {name.partition("::")[2] for name in self._tracks if "::" in name}

    @property
    def matched(self) -> list[BodyMatch]:
        """The patterns that a recorded model matches."""
        return [match for match in self._matches if match.match in self._matched]

    @property
    def unmatched(self) -> list[BodyMatch]:
        """The patterns that no recorded model matches."""
        return [m for m in self._matches if m.match not in self._matched] if self._received else []

    def retime(self, retimed: Retimed) -> None:
        """Put all stamps on another clock."""
        for track in self._tracks.values():
            if track is not None:
                stamps_ns = retimed(np.array(track.stamps_ns, dtype=np.int64))
                track.stamps_ns = array("q", stamps_ns.tobytes())

    def settle(self, builder: TrialBuilder, origin_ns: int, unknown: Iterable[Unknown] = ()) -> None:
        """Hand positions, velocities and bodies to the builder, with what is unknown of their topics."""
        holes, contested = [], []
        for one in unknown:
            holes += one.holes
            contested += one.contested
        if unmatched := [match.match for match in self.unmatched]:
            there = sorted({name.partition("::")[0] for name in self._tracks})
            for pattern in unmatched:
                meant = nearest(pattern, there, what="recorded models")
                builder.unrecorded.append(f"model {pattern}: no recorded model matches; {meant}")
        given: dict[str, Any] = {"source": OF_MODELS, "holes": holes, "contested": contested}
        for name in sorted(self._tracks):
            track = self._tracks[name]
            if track is not None:
                builder.add_body(track.body)
                subject = "::".join((track.body.id, *track.body.links))
                known = builder.signals.get(f"position/{subject}")
                if known is not None and known.source == OF_FRAMES:
                    message = (
                        "its places are those of a frame, which is stamped; those of the model were left out"
                    )
                    builder.defect("frame_and_model", f"model {name}", len(track.stamps_ns), message)
                    continue
                t = times_s(track.stamps_ns, origin_ns)
                given["stamp_jitter_s"] = arrival_jitter_s(np.sort(t))
                given["stated_rate_hz"] = track.rate_hz
                rows = np.frombuffer(track.rows, dtype=np.float64).reshape(-1, 6)
                builder.add_signal(f"position/{subject}", "m", t, rows[:, :3], **given)
                builder.add_signal(f"velocity/{subject}", "m/s", t, rows[:, 3:], **given)
