"""When heartbeats were sent, and whether the times of the log agree with that."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ariac_score.logs.attested.chain import Beats
from ariac_score.logs.attested.recorded import UnfitError

__all__ = ["LATE_NS", "late_by_ns", "refuse_moved_heartbeats", "refuse_other_clock", "refuse_other_pace"]

LATE_NS = 10**9
"""A message reaches recorder and log at most so far apart; what lies further off was moved."""
LATE_BESIDE_PAUSES_NS = 250_000_000
"""The same, where the recorder's own clock shows its pauses: so much besides the longest of them. On a loaded
machine of two cores, messages of a real `rosbag record` came up to 90 ms late."""
_CLOCKS = ("wall_ns", "ros_ns")


def _sent_ns(beat: Mapping[str, Any], clock: str) -> int | None:
    """When a heartbeat was sent, by a clock; `None` where it does not tell.

    Raises:
        UnfitError: It tells a time beyond the year 2262.
    """
    sent = beat.get(clock)
    if not isinstance(sent, int):
        return None
    if not 0 <= sent < 1 << 63:
        raise UnfitError(f"heartbeat {beat.get('sequence')} was sent at no time, by its {clock!r}")
    return sent


def _by_its_clock(beats: Beats) -> tuple[int, list[int]]:
    """Of the two clocks of the heartbeats the one that the log goes by: how unequally late the log has them
    by it, and when they were sent, ns; 0 and nothing where they tell no time."""
    found = []
    for clock in _CLOCKS:
        told = [(stamp_ns, sent) for stamp_ns, beat in beats if (sent := _sent_ns(beat, clock)) is not None]
        if told:
            late = [stamp_ns - sent for stamp_ns, sent in told]
            found.append((max(late) - min(late), [sent for _, sent in told]))
    return min(found, default=(0, []))


def late_by_ns(beats: Beats) -> int:
    """How far apart a message reaches recorder and log at most, from the times at which heartbeats were sent.

    Those are part of the chain. The log's own times are not, and who moves messages moves these, too.
    """
    _, sent = _by_its_clock(beats)
    if len(sent) < 2:
        return LATE_NS
    return min(LATE_NS, LATE_BESIDE_PAUSES_NS + max(after - before for before, after in pairwise(sent)))


def refuse_moved_heartbeats(beats: Beats, late_ns: int) -> None:
    """Refuse heartbeats that the log has at other times than they were sent at, by the clock it goes by."""
    spread, _ = _by_its_clock(beats)
    if spread > late_ns:
        raise UnfitError(f"its heartbeats were moved, by up to {spread / 1e9:.1f} s")


def refuse_other_pace(beats: Beats) -> None:
    """Refuse a log by the wall clock of a simulation at another pace, which only `/clock` would show."""
    late = [stamp_ns - sent for stamp_ns, beat in beats if (sent := _sent_ns(beat, "ros_ns")) is not None]
    apart_ns = max(late, default=0) - min(late, default=0)
    if apart_ns > LATE_NS:
        raise UnfitError(
            f"its times are not those of the simulation, from which they go {apart_ns / 1e9:.1f} s apart "
            "between its heartbeats"
        )


def refuse_other_clock(clock: Sequence[tuple[int, int]], beats: Beats, late_ns: int) -> None:
    """Refuse a `/clock` that says otherwise than the heartbeats; it comes too often to be listed itself."""
    if not clock:
        return
    at, ticks = (np.array(column, dtype=np.int64) for column in zip(*sorted(clock), strict=True))
    told = [(stamp_ns, sent) for stamp_ns, beat in beats if (sent := _sent_ns(beat, "ros_ns")) is not None]
    if not told:
        raise UnfitError("nothing in its heartbeats shows that its '/clock' is that of the simulation")
    stamps, sent_ns = (np.array(column, dtype=np.int64) for column in zip(*told, strict=True))
    before = np.searchsorted(at, stamps, side="right") - 1
    there = (before >= 0) & (stamps - at[np.maximum(before, 0)] <= late_ns)
    apart_ns = np.abs(ticks[np.maximum(before, 0)] - sent_ns)[there]
    if not there.any() or apart_ns.max() > late_ns:
        worst = f", by up to {apart_ns.max() / 1e9:.1f} s" if there.any() else ""
        raise UnfitError(f"its '/clock' says otherwise than its heartbeats{worst}")
