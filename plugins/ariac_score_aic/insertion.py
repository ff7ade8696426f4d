"""Whether the plug is in its port, partly in it, near it, or in another one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf
from typing import ClassVar, Literal

from ariac_score import (
    Cause,
    Chart,
    Finding,
    Measure,
    Trial,
    Verdict,
    WorkItem,
    Worlds,
    check_parameters,
    parameter,
)
from ariac_score_aic import charts
from ariac_score_aic.checks import NO_RECORDING
from ariac_score_aic.consumption import Consumed, Plug, consumed_of
from ariac_score_aic.messages import EVENT
from ariac_score_aic.run_config import Connection

__all__ = ["Insertion", "StartDistance", "port_named"]

_SOURCE = "aic_scoring/src/ScoringTier2.cc of intrinsic-dev/aic, db40abcf"
_NO_CONFIG = "no configuration says which plug belongs into which port: give it with --trial-config"


def port_named(event: bytes) -> tuple[bytes, bytes] | None:
    """Module and port of an insertion event; `None` of a text that names no two.

    Parts that are empty are dropped before each slash; the last part stays whatever it is, further ones do
    not count.

    >>> port_named(b"//card/port"), port_named(b"card/"), port_named(b"/card")
    ((b'card', b'port'), (b'card', b''), None)
    """
    *before, last = event.split(b"/")
    parts = [part for part in before if part] + [last]
    return (parts[0], parts[1]) if len(parts) >= 2 else None


def connection_of(consumed: Consumed, item: WorkItem) -> Connection | None:
    """What an item says is to be connected."""
    facts = item.facts
    return next((c for c in consumed.connections if all(facts.get(k) == v for k, v in vars(c).items())), None)


@dataclass(frozen=True)
class StartDistance:
    """The plug begins at some distance from its port.

    Measures:
        The distance from plug to port when the task starts, in m; 0 where it is not had.
    Violated when:
        Never.
    Source:
        `ScoringTier2.cc`, line 722; the start of the task since PR 307.
    """

    part_of: ClassVar[str] = "task"
    level: ClassVar[str] = "connection"
    measures: ClassVar[Mapping[str, Measure]] = {
        "start_distance_m": Measure(
            "m", best=0.0, worst=0.0, signed=False, meaning="from plug to port at the start"
        )
    }

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the connection."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        connection = connection_of(consumed, item)
        if connection is None:
            if consumed.times.not_completed:
                yield Finding(item.id, Verdict.SATISFIED, _NO_CONFIG, quantities={"start_distance_m": 0.0})
            else:
                yield Finding.inconclusive(item.id, _NO_CONFIG)
            return
        found = start_distance_m(consumed, connection)
        if found is None:
            yield Finding.inconclusive(item.id, "no file says when the task started")
            return
        distance_m, words = found
        yield Finding(item.id, Verdict.SATISFIED, words, quantities={"start_distance_m": distance_m})

    def judge_worlds(self, trial: Trial, item: WorkItem) -> Iterator[Finding | Worlds]:
        """The same, and of an undecided one the longest and the shortest distance that it can have been."""
        consumed = consumed_of(trial)
        for finding in self.judge(trial, item):
            yield finding
            connection = connection_of(consumed, item) if consumed else None
            if consumed is None or connection is None or finding.verdict is not Verdict.INCONCLUSIVE:
                continue
            distances_m = _start_distances_m(consumed, connection)
            if distances_m:
                # The longer, the better: less of the way counts.
                least, most = (
                    Finding(
                        item.id, Verdict.SATISFIED, f"{word} {m:.4f} m", quantities={"start_distance_m": m}
                    )
                    for word, m in (("no less than", min(distances_m)), ("no more than", max(distances_m)))
                )
                yield Worlds(item.id, (most,), (least,), (Cause(finding.message),))


def _start_distances_m(consumed: Consumed, connection: Connection) -> list[float]:
    """The distances that can have been the first one, as far as the recording shows when the task began."""
    known = start_distance_m(consumed, connection)
    if known is not None:
        return [known[0]]
    between = consumed.bounds.start_ns
    if between is None:
        return []
    found = (consumed.plug_at(connection, ns).distance_m for ns in consumed.stamps_between(between))
    return [0.0 if distance is None else distance for distance in found]


def start_distance_m(consumed: Consumed, connection: Connection) -> tuple[float, str] | None:
    """The distance that counts as the first one, with words; `None` where nobody knows the start."""
    if consumed.how.start_distance == "none":
        return 0.0, "not looked at"
    if consumed.how.start_distance == "first":
        distance = consumed.first_distance_m(connection)
    else:
        times = consumed.times
        if times.start_ns is None:
            return (0.0, "the task had no start") if times.start_known else None
        distance = consumed.plug_at(connection, times.start_ns).distance_m
    if distance is None:
        return 0.0, "the distance was not had when the task started, and counts as 0 m"
    return distance, f"{distance:.4f} m from plug to port at the start"


@dataclass(frozen=True)
class Insertion:
    """The plug is in its port.

    Measures:
        What the last insertion event says; without one where the plug is when the task ends: its height above
        the port, the distance, and how far within reach that is. A plug is partly inserted below the entrance
        and less than `below_m` under the port, within `aside_m` in x and y of the world.
    Violated when:
        No event says that it is in its port.
    Attributes:
        aside_m: How far the plug may be aside of the port, in x and in y, to be partly in it.
        below_m: How far it may be below the port to be partly in it.
        radius_share: The share of the start distance over which nearness counts.
        fixed_radius_m: The distance over which it counts, whatever the start distance; 0 takes the share.
        event: Which insertion events count: those that name the port, any, or those that name an end of a
            cable as well.
        place_always: Whether the place of the plug counts besides an event.
        unseen: What no topic of insertion events means: that there was none (none), or that it is undecided
            (open).
    Source:
        `ScoringTier2.cc`, lines 700 to 830. Axes are those of the world, and orientation does not matter.
    """

    part_of: ClassVar[str] = "task"
    mistake: ClassVar[tuple[str, str]] = ("plug not in its port", "plugs not in their ports")
    level: ClassVar[str] = "connection"
    measures: ClassVar[Mapping[str, Measure]] = {
        "right_port": Measure(
            "count", best=1.0, worst=0.0, meaning="1 where an event says that the plug is in its port"
        ),
        "wrong_port": Measure(
            "count", best=0.0, worst=1.0, meaning="1 where an event says that the plug is in another port"
        ),
        "partial": Measure("count", best=1.0, worst=0.0, meaning="1 where the plug is partly in its port"),
        "placed": Measure(
            "count", best=1.0, worst=0.0, meaning="1 where the places of all are known at the end"
        ),
        "plug_height_m": Measure("m", best=0.0, worst=1.0, signed=True, meaning="of the plug above the port"),
        "entrance_height_m": Measure(
            "m", best=1.0, worst=1.0, signed=True, meaning="of the entrance above the port"
        ),
        "distance_m": Measure("m", best=0.0, worst=1e6, signed=False, meaning="from plug to port"),
        "radius_m": Measure(
            "m", best=1.0, worst=1.0, signed=True, meaning="over which nearness counts, beyond the depth"
        ),
        "within_reach_m": Measure(
            "m", best=1.0, worst=-1.0, signed=True, meaning="how far within that it is"
        ),
    }

    aside_m: float = parameter(0.005, unit="m", above=0, at_most=1, status="verified", source=_SOURCE)
    below_m: float = parameter(0.01, unit="m", at_least=0, at_most=1, status="verified", source=_SOURCE)
    radius_share: float = parameter(0.5, unit="1", at_least=0, at_most=10, status="verified", source=_SOURCE)
    fixed_radius_m: float = parameter(
        0.0, unit="m", at_least=0, at_most=10, source="0: a share of the start distance"
    )
    event: Literal["port", "any", "ends"] = parameter("port", source="what an event says; PR 245, PR 552")
    place_always: bool = parameter(False, source="until PR 307 the place counted besides what an event says")
    unseen: Literal["none", "open"] = parameter(
        "none", source="the scorer looks at places where it heard no event"
    )

    def __post_init__(self) -> None:
        check_parameters(self)

    def charts(self, trial: Trial) -> Iterator[Chart]:
        """How high the plug is above its port."""
        return charts.of_height(trial)

    def judge(self, trial: Trial, item: WorkItem) -> Iterator[Finding]:
        """One finding about the connection."""
        consumed = consumed_of(trial)
        if consumed is None:
            yield Finding.inconclusive(item.id, NO_RECORDING)
            return
        times, connection = consumed.times, connection_of(consumed, item)
        if times.not_completed:
            yield self._without_end(consumed, connection, item)
        elif connection is None:
            yield Finding.inconclusive(item.id, _NO_CONFIG)
        elif times.completed is None:
            yield Finding.inconclusive(item.id, "no file says whether and when the task was completed")
        else:
            found = self._completed(consumed, connection, item)
            if self._misses_events(consumed) and found.verdict is not Verdict.INCONCLUSIVE:
                found = Finding.inconclusive(item.id, f"{EVENT} was not recorded; {found.message}")
            yield found

    def _misses_events(self, consumed: Consumed) -> bool:
        """Whether an event may have said more than the place does."""
        return self.unseen == "open" and EVENT not in consumed.messages.topics

    def judge_worlds(self, trial: Trial, item: WorkItem) -> Iterator[Finding | Worlds]:
        """The same, and of an undecided one the best and the worst that can have been when the task ended."""
        consumed = consumed_of(trial)
        for finding in self.judge(trial, item):
            yield finding
            connection = connection_of(consumed, item) if consumed else None
            if consumed is None or connection is None or finding.verdict is not Verdict.INCONCLUSIVE:
                continue
            found = sorted(self._possible(consumed, connection, item), key=_worth)
            if found:
                yield Worlds(item.id, (found[-1],), (found[0],), (Cause(finding.message),))

    def _possible(self, consumed: Consumed, connection: Connection, item: WorkItem) -> Iterator[Finding]:
        """What could be found if it were known when the task began and ended, and what events said."""
        if self._misses_events(consumed):
            yield _found(item, "an insertion that was not recorded", right_port=1.0)
            yield _found(item, "an insertion into a wrong port that was not recorded", wrong_port=1.0)
        if not consumed.times.completed:
            yield self._without_end(consumed, connection, item)
        said = self._event(consumed, connection, item)
        if said is not None and not self.place_always:
            yield said
            return
        ends = [0]
        if consumed.how.ends_at_end:
            between = consumed.bounds.end_ns
            ends = [] if between is None else consumed.stamps_between(between)
        distances_m = (
            [0.0] if self.fixed_radius_m or self.place_always else _start_distances_m(consumed, connection)
        )
        radii_m = {self.fixed_radius_m or self.radius_share * one for one in distances_m}
        for end_ns in ends:
            plug = self.plug_at(consumed, connection, end_ns)
            for radius_m in {min(radii_m), max(radii_m)} if radii_m else ():
                yield self._by_place(item, plug, radius_m, said)

    def plug_at(self, consumed: Consumed, connection: Connection, stamp_ns: int) -> Plug:
        """Where the plug, its port and the entrance are at a time, 0 for the latest: in axes of the world."""
        return consumed.plug_at(connection, stamp_ns)

    def is_straight(self, plug: Plug) -> bool:  # noqa: ARG002  # a stricter reading looks at it
        """Whether the plug is turned so that it can be in its port: as coded however it is."""
        return True

    def _without_end(self, consumed: Consumed, connection: Connection | None, item: WorkItem) -> Finding:
        said = self._event(consumed, connection, item) if self.place_always and connection else None
        return said or _found(item, "the task was not completed, so that nothing counts")

    def _completed(self, consumed: Consumed, connection: Connection, item: WorkItem) -> Finding:
        said = self._event(consumed, connection, item)
        if said is not None and not self.place_always:
            return said
        times = consumed.times
        if consumed.how.ends_at_end and times.end_ns is None:
            return Finding.inconclusive(item.id, "no insertion event, and no file says when the task ended")
        plug = self.plug_at(consumed, connection, (times.end_ns or 0) if consumed.how.ends_at_end else 0)
        if self.place_always:
            if not (consumed.asks_for_latest or len(consumed.asked_ns)):
                plug = Plug(None, None, None)  # nothing that moves was heard of
            return self._by_place(item, plug, 0.0, said)
        start = start_distance_m(consumed, connection)
        if start is None and not self.fixed_radius_m:
            return Finding.inconclusive(item.id, "no insertion event, and no file says when the task started")
        if times.start_known and times.start_ns is None:
            return _found(item, "no insertion event, and the task had no start")
        return self._by_place(
            item, plug, self.fixed_radius_m or self.radius_share * (start[0] if start else 0.0), None
        )

    def _event(self, consumed: Consumed, connection: Connection, item: WorkItem) -> Finding | None:
        """What the events say; `None` where they say nothing."""
        texts = consumed.messages.events.texts
        if self.event == "any":
            reported = bool(texts and texts[-1])
            return _found(item, "an insertion was reported", right_port=1.0) if reported else None
        if self.event == "ends":
            number = consumed.connections.index(connection)
            texts = tuple(_of_end(text, consumed.cable.encode(), number) for text in texts)
            texts = tuple(text for text in texts if text)
        if not texts or not texts[-1]:
            return None
        shown = texts[-1].decode("utf-8", "backslashreplace")
        port = port_named(texts[-1])
        if port is None:
            return _found(item, f"the insertion event {shown!r} names no module and port")
        if port == (connection.target_module_name.encode(), connection.port_name.encode()):
            return _found(item, f"inserted into {shown!r}", right_port=1.0)
        return _found(item, f"inserted into {shown!r}, which is the wrong port", wrong_port=1.0)

    def _by_place(self, item: WorkItem, plug: Plug, radius_m: float, said: Finding | None) -> Finding:
        stated = said.quantities if said else {}
        flags = {name: stated[name] for name in ("right_port", "wrong_port") if name in stated}
        before = f"{said.message}; " if said else "no insertion event; "
        distance_m = plug.distance_m
        if plug.plug_m is None or plug.port_m is None or distance_m is None:
            return _found(item, f"{before}plug or port had no place when the task ended", **flags)
        if plug.entrance_m is None and not self.place_always:
            return _found(item, f"{before}the entrance had no place when the task ended", **flags)
        entrance_m = plug.entrance_m or plug.port_m
        depth_m = abs(entrance_m[2] - plug.port_m[2])
        reach_m = depth_m + radius_m
        height_m = plug.plug_m[2] - plug.port_m[2]
        aside = [abs(plug.plug_m[axis] - plug.port_m[axis]) for axis in (0, 1)]
        beneath = plug.plug_m[2] < entrance_m[2] and height_m > -self.below_m
        partial = max(aside) < self.aside_m and beneath and self.is_straight(plug)
        near = f"the plug is {distance_m:.4f} m from its port"
        return _found(
            item,
            before + (f"partly inserted, {height_m:.4f} m above the port" if partial else near),
            **flags,
            partial=float(partial),
            placed=1.0,
            plug_height_m=height_m,
            entrance_height_m=entrance_m[2] - plug.port_m[2],
            distance_m=distance_m,
            radius_m=reach_m - depth_m,
            within_reach_m=reach_m - distance_m,
        )


def _of_end(event: bytes, cable: bytes, number: int) -> bytes:
    """What an event says of one end of a cable; empty of another one, and of a text that is no such event.

    Parts that are empty are dropped before each mark, as of module and port.

    >>> _of_end(b"cable_1#0#/card/port", b"cable_1", 0), _of_end(b"cable_1#0#/card", b"cable_1", 0)
    (b'/card/port', b'')
    """
    *before, last = event.split(b"#")
    parts = [part for part in before if part] + [last]
    if not cable or parts[:-1] != [cable, str(number).encode()] or port_named(last) is None:
        return b""
    return last


def _worth(finding: Finding) -> tuple[float, float, float]:
    """The better of two findings about one plug is the larger."""
    known = finding.quantities
    inserted = known["right_port"] - known["wrong_port"]
    depth_m = known["entrance_height_m"] - known["plug_height_m"]
    if not known["placed"]:
        return inserted, 0.0, -inf
    return inserted, known["partial"], depth_m if known["partial"] else known["within_reach_m"]


def _found(item: WorkItem, message: str, **known: float) -> Finding:
    quantities = {name: known.get(name, 0.0) for name in Insertion.measures}
    satisfied = quantities["right_port"] > 0
    return Finding(
        item.id, Verdict.SATISFIED if satisfied else Verdict.VIOLATED, message, quantities=quantities
    )
