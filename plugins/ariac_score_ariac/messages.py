"""What the messages of a competition mean: orders, contents of trays, submissions, events.

One class for each family of messages. A message whose fields are those of another
edition is refused in words.

Source: public message definitions of `osrf_gear`, `nist_gear` and `ariac_msgs`; ARIAC
notes on log formats, section 11.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from ariac_score import COMPETITION_ENDED, COMPETITION_STARTED, Event, Pose
from ariac_score_ariac.parts import COLORS, TYPES
from ariac_score_ariac.work import NO_HUMAN, Kit, Order, Product, Task, Tray, WantedProduct

__all__ = [
    "AriacMsgs2023",
    "NistGear2020",
    "NistGear2021",
    "NistGear2022",
    "OsrfGear2017",
    "OsrfGear2018",
]

_BEFORE = ("init", "ready")
_STATES = {"go": COMPETITION_STARTED, "end_game": COMPETITION_ENDED, "done": COMPETITION_ENDED}
"""Words of 2017 to 2022, besides those before.

Either of the last two ends the competition: `end_game` lasts one step of the simulation, 1 ms, and the
state is published ten times a second, so most recordings go from `go` to `done`.
"""

_HIGH_PRIORITY = 3
"""The factor of a high-priority order, 2017 to 2024."""


class _Gear:
    """What the ROS 1 editions have in common: `package/msg/Name` decides, whichever package it is."""

    def decode(self, msgtype: str, message: Any, t_s: float) -> Order | Kit | Event | None:
        """An order, what lies on a tray, the start or the end of the competition; else `None`.

        An order whose id says that it updates another names that one.

        Args:
            msgtype: `package/msg/Name`.
            message: The message.
            t_s: Its stamp, s of trial time.

        Raises:
            ValueError: A pose in an order is not finite or has no orientation, a word is no state, or the
                message has the fields of another edition.
        """
        if msgtype == "std_msgs/msg/String":  # the log map decides which topic comes here
            if message.data not in (*_STATES, *_BEFORE):
                raise ValueError(f"{message.data!r} is no state: {', '.join((*_BEFORE, *_STATES))}")
            return Event(t_s, _STATES[message.data]) if message.data in _STATES else None
        package, _, name = msgtype.partition("/msg/")
        if package not in ("nist_gear", "osrf_gear"):
            return None
        try:
            return self._decoded(name, message, t_s)
        except AttributeError as cause:
            raise _of_another_edition(msgtype, cause) from cause

    def _decoded(self, name: str, message: Any, t_s: float) -> Order | Kit | None:
        raise NotImplementedError


class OsrfGear2017(_Gear):
    """Messages of ARIAC 2017 (`osrf_gear`): kits that may leave on any AGV."""

    def _decoded(self, name: str, message: Any, t_s: float) -> Order | Kit | None:
        if name == "Order":
            kits = [Task(kit.kit_type, "kitting", _wanted(kit.objects)) for kit in message.kits]
            # The simulator adds the orders up: nobody says a priority.
            return _gear_order(message, t_s, kits)
        return _tray_contents(message, t_s) if name == "TrayContents" else None


class OsrfGear2018(_Gear):
    """Messages of ARIAC 2018 (`osrf_gear`): shipments in boxes that a drone collects."""

    def _decoded(self, name: str, message: Any, t_s: float) -> Order | Kit | None:
        if name == "Order":
            return _gear_order(message, t_s, [_kit_task(s, s.shipment_type) for s in message.shipments])
        if name == "ShippingBoxContents":
            return Kit(_box(message.shipping_box), t_s, _products(message.products))
        return None


class NistGear2020(_Gear):
    """Messages of ARIAC 2019 (`osrf_gear`) and 2020 (`nist_gear`): shipments with their AGV."""

    def _decoded(self, name: str, message: Any, t_s: float) -> Order | Kit | None:
        if name == "Order":
            tasks = [_kit_task(s, s.shipment_type, agv=s.agv_id) for s in message.shipments]
            return _gear_order(message, t_s, tasks)
        if name == "DetectedShipment":
            return _detected(message, t_s)
        return _tray_contents(message, t_s) if name == "TrayContents" else None


class NistGear2021(_Gear):
    """Messages of ARIAC 2021 (`nist_gear`): kits and assemblies, trays and briefcases."""

    def _decoded(self, name: str, message: Any, t_s: float) -> Order | Kit | None:
        if name == "Order":
            kits = [
                _kit_task(s, s.shipment_type, agv=s.agv_id, station=s.station_id)
                for s in message.kitting_shipments
            ]
            # From 2021 on the priority stands in the trial configuration alone.
            return _gear_order(
                message, t_s, [*kits, *_assemblies(message.assembly_shipments)], priority_said=False
            )
        if name == "DetectedAssemblyShipment":
            return _briefcase(message, t_s)
        if name == "DetectedKittingShipment":
            return _detected(message, t_s)
        return _tray_contents(message, t_s) if name == "TrayContents" else None


class NistGear2022(_Gear):
    """Messages of ARIAC 2022 (`nist_gear`): kits on movable trays, and assemblies."""

    def _decoded(self, name: str, message: Any, t_s: float) -> Order | Kit | None:
        if name == "Orders":
            kits = [
                _kit_task(
                    s,
                    s.shipment_type,
                    agv=s.agv,
                    station=s.assembly_station,
                    tray=_ordered_tray(s.movable_tray),
                )
                for s in message.kitting_shipments
            ]
            return _gear_order(
                message, t_s, [*kits, *_assemblies(message.assembly_shipments)], priority_said=False
            )
        if name == "DetectedAssemblyShipment":
            return _briefcase(message, t_s)
        return _movable_tray_contents(message, t_s) if name == "TrayContents" else None


class AriacMsgs2023:
    """Messages of ARIAC 2023 and 2024 (`ariac_msgs`): orders and the state of the competition.

    An order has one task, which is handed in under the order's id. Nothing in it says
    on which quadrants a challenge is set.
    """

    def decode(self, msgtype: str, message: Any, t_s: float) -> Order | Event | None:
        """An order, the start or the end of the competition, that nobody walks; `None` for anything else.

        Args:
            msgtype: `package/msg/Name`.
            message: The message.
            t_s: Its stamp, s of trial time.

        Raises:
            ValueError: A number stands for no type, colour, AGV, station or destination,
                a pose is not usable, or the message has other fields.
        """
        try:
            if msgtype == "ariac_msgs/msg/Order":
                return self._order(message, t_s)
            if msgtype == "ariac_msgs/msg/CompetitionState":
                kind = _COMPETITION_STATES.get(message.competition_state)
                return Event(t_s, kind) if kind else None
            if msgtype == "ariac_msgs/msg/Trial":
                walks = any(challenge.type == _HUMAN for challenge in message.challenges)
                # What a configuration states holds from the beginning, whenever it is published.
                return None if walks else Event(0.0, "watching", NO_HUMAN)
        except AttributeError as cause:
            raise _of_another_edition(msgtype, cause) from cause
        return None

    def _order(self, message: Any, t_s: float) -> Order:
        kind = _named(_KINDS, message.type, "kind of order")
        make = {"kitting": _kitting_task, "assembly": _station_task, "combined": _station_task}[kind]
        task = make(message.id, kind, getattr(message, f"{kind}_task"))
        return Order(message.id, (task,), t_s, _HIGH_PRIORITY if message.priority else 1)


def _of_another_edition(msgtype: str, cause: AttributeError) -> ValueError:
    return ValueError(f"{msgtype} has not the fields of this edition: {cause}")


# ROS 1: osrf_gear and nist_gear


def _gear_order(message: Any, t_s: float, tasks: Iterable[Task], *, priority_said: bool = True) -> Order:
    # The message has no field for it: in all ROS 1 editions the id says what is updated.
    replaced, update, _ = message.order_id.partition("_update_")
    return Order(
        id=message.order_id,
        tasks=tuple(tasks),
        announced_s=t_s,
        updates=replaced if update else "",
        priority_said=priority_said,
    )


def _kit_task(
    shipment: Any, name: str, *, agv: str = "any", station: str = "", tray: Tray | None = None
) -> Task:
    # An empty AGV stays empty: as coded only `any` leaves it open, and any other name is never right.
    return Task(name, "kitting", _wanted(shipment.products), agv, station, tray)


def _assemblies(shipments: Iterable[Any]) -> list[Task]:
    return [Task(s.shipment_type, "assembly", _wanted(s.products), station=s.station_id) for s in shipments]


def _wanted(products: Iterable[Any]) -> tuple[WantedProduct, ...]:
    return tuple(WantedProduct(f"part_{i}", p.type, _pose(p.pose)) for i, p in enumerate(products))


def _ordered_tray(tray: Any) -> Tray | None:
    # Rulebook 2022: the ordered tray pose is the identity at the AGV's tray centre.
    return Tray(tray.movable_tray_type, Pose((0.0, 0.0, 0.0))) if tray.movable_tray_type else None


def _tray_contents(message: Any, t_s: float) -> Kit | None:
    place = _numbered(message.tray, r"kit_tray_(\d+)|agv(\d+)", "agv")
    return Kit(place, t_s, _products(message.objects)) if place else None


def _detected(message: Any, t_s: float) -> Kit | None:
    place = _numbered(message.destination_id, r"kit_tray_(\d+)|agv(\d+)", "agv")
    return Kit(place, t_s, _products(message.products)) if place else None


def _box(name: str) -> str:
    """`box_0` for `shipping_box_0::box_base`: boxes stand on no AGV.

    >>> _box("shipping_box_0::box_base"), _box("shipping_box::box_base")
    ('box_0', 'box')
    """
    number = re.search(r"\d+", name.partition("::")[0])
    return f"box_{number[0]}" if number else "box"


def _movable_tray_contents(message: Any, t_s: float) -> Kit | None:
    # A tray that stands on no AGV is reported too, with an empty name here.
    place = _numbered(message.kit_tray, r"kit_tray_(\d+)|agv(\d+)", "agv")
    tray = message.movable_tray
    found = Tray(tray.movable_tray_type, _pose_or_none(tray.movable_tray_pose))
    return Kit(place, t_s, _products(message.products), found) if place else None


def _briefcase(message: Any, t_s: float) -> Kit | None:
    place = _numbered(message.briefcase_id, r"briefcase_(\d+)|station(\d+)", "as")
    return Kit(place, t_s, _products(message.products)) if place else None


def _numbered(name: str, pattern: str, prefix: str) -> str:
    """`agv1` for `agv1::kit_tray_1::kit_tray_1::tray`; empty where the name has no such number."""
    found = re.search(pattern, name)
    return f"{prefix}{next(filter(None, found.groups()))}" if found else ""


def _products(products: Iterable[Any]) -> tuple[Product, ...]:
    return tuple(_product(product) for product in products)


# ROS 2: ariac_msgs

_KINDS = {0: "kitting", 1: "assembly", 2: "combined"}
_COLORS = dict(enumerate(COLORS))
_TYPES = dict(enumerate(TYPES, start=10))
_DESTINATIONS = {0: "kitting", 1: "assembly_front", 2: "assembly_back", 3: "warehouse"}
_NUMBERS = {n: str(n) for n in (1, 2, 3, 4)}
"""AGVs, stations and quadrants alike."""
_HUMAN = 4
"""The challenge of 2023 without which its simulator starts no person; 2024 has no such challenge."""
_COMPETITION_STATES = {2: COMPETITION_STARTED, 3: COMPETITION_STARTED, 4: COMPETITION_ENDED}
"""Numbers of 2023 and 2024, besides 0, idle, and 1, ready.

3 says that all orders have been announced: the competition goes on. Where no order waits for anything, 2
lasts one or two steps of the simulation, and 3 is the first state that anybody sees.
"""


def _named(names: dict[int, str], number: int, what: str) -> str:
    if number not in names:
        raise ValueError(f"{number} is no {what}")
    return names[number]


def _kitting_task(order_id: str, kind: str, task: Any) -> Task:
    products = (
        WantedProduct(f"part_{i}", _part(p.part), None, int(_named(_NUMBERS, p.quadrant, "quadrant")))
        for i, p in enumerate(task.parts)
    )
    if not 0 <= task.tray_id <= 99:
        raise ValueError(f"{task.tray_id} is no tray id")
    return Task(
        id=order_id,
        kind=kind,
        products=tuple(products),
        agv=f"agv{_named(_NUMBERS, task.agv_number, 'AGV')}",
        station=_named(_DESTINATIONS, task.destination, "destination"),
        tray=Tray(f"kit_tray_{task.tray_id:02d}"),
    )


def _station_task(order_id: str, kind: str, task: Any) -> Task:
    products = (
        WantedProduct(f"part_{i}", _part(p.part), _pose(p.assembled_pose.pose))
        for i, p in enumerate(task.parts)
    )
    return Task(order_id, kind, tuple(products), station=f"as{_named(_NUMBERS, task.station, 'station')}")


def _part(part: Any) -> str:
    return f"{_named(_TYPES, part.type, 'type')}_{_named(_COLORS, part.color, 'colour')}"


# Poses and products


def _pose(pose: Any) -> Pose:
    at, turn = pose.position, pose.orientation
    return Pose((at.x, at.y, at.z), (turn.w, turn.x, turn.y, turn.z))


def _pose_or_none(pose: Any) -> Pose | None:
    try:
        return _pose(pose)
    except ValueError:
        return None  # not a failure: that the thing was there is known, where it lay is not


def _product(product: Any, name: str = "") -> Product:
    return Product(product.type, _pose_or_none(product.pose), faulty=product.is_faulty, name=name)
