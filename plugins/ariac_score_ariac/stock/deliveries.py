"""What the simulators of 2017 to 2022 print when a kit leaves, and when an order is complete.

2017 and 2018 name the kit or shipment. Later editions name the AGV alone: which shipment it was follows
from what else is printed, or stays open. An assembly is handed in without a line of its own.

Source: AGV and drone plug-ins and task managers of 2017 to 2022; ARIAC notes on recording, section 1.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ariac_score_ariac.stock.console import Said, lines_said

__all__ = ["Completion", "Delivery", "arm_contacts_said", "completions_said", "deliveries_said"]

_TRIGGERED = re.compile(
    r"(?:\[INFO\] )?(?:AGV '(?P<agv>agv\d)' delivery triggered(?: for kit: (?P<kit>\S+))?"
    r"|Drone collection triggered for shipment: (?P<shipment>\S+))"
)
_LEFT = re.compile(r"(?:\[INFO\] )?(?:AGV|drone) successfully triggered\.", re.IGNORECASE)
_TO_STATION_2021 = re.compile(
    r"\[(?P<agv>agv\d) ?-> ?(?P<station>as\d)\] SUCCESS: AGV successfully triggered\."
)
_TO_STATION_2022 = re.compile(r"\[SUCCESS\] \[(?P<agv>agv\d): ?ks\d ?-> ?(?P<station>as\d) triggered\]")
_COMPLETE = re.compile(
    r"(?:\[INFO\] )?(?:Order complete"
    r"|All (?P<kinds>kitting|assembly|kitting and assembly) shipments submitted for order): (?P<order>\S+)"
)
_OUT_OF_TIME = re.compile(r"(?:\[INFO\] )?Order timed out: (?P<order>\S+)")
_CONTACT = re.compile(r"arm/arm contact detected: (?P<names>.+)")

_LONGEST_WAIT_S = 2.0
"""The tray is handed in 0.75 s after the call, the box one step after it."""


@dataclass(frozen=True)
class Delivery:
    """A kit that left.

    Attributes:
        t_s: When it was handed in, s of trial time.
        agv: On which AGV; empty for the drone.
        shipment: As what it was handed in; empty where the simulator does not print it.
        station: Where it was sent; empty where it goes to no station. An AGV that goes to a station without
            handing in anything prints the same.
    """

    t_s: float
    agv: str = ""
    shipment: str = ""
    station: str = ""


@dataclass(frozen=True)
class Completion:
    """The last shipment of an order was handed in, or the order is out of time.

    Attributes:
        t_s: When, s of trial time.
        order: Its id.
        kinds: Which kinds of shipments it has; none of an order that is out of time.
    """

    t_s: float
    order: str
    kinds: tuple[str, ...] = ("kitting",)


def deliveries_said(said: Sequence[Said]) -> list[Delivery]:
    """The kits that left, by the lines of the console, in order of time."""
    waiting: list[Delivery] = []
    left: list[Delivery] = []
    for t_s, line in lines_said(said):
        text = line.strip()
        if triggered := _TRIGGERED.match(text):
            name = triggered["kit"] or triggered["shipment"] or ""
            delivery = Delivery(t_s, triggered["agv"] or "", name)
            # From 2019 on the task manager hands in the kit itself, at the call.
            (waiting if name else left).append(delivery)
        elif _LEFT.fullmatch(text):
            waiting = [d for d in waiting if t_s - d.t_s <= _LONGEST_WAIT_S]
            if waiting:
                first = waiting.pop(0)
                left.append(Delivery(t_s, first.agv, first.shipment))
        elif moved := _TO_STATION_2021.match(text) or _TO_STATION_2022.match(text):
            left.append(Delivery(t_s, moved["agv"], station=moved["station"]))
    return left


def completions_said(said: Sequence[Said]) -> list[Completion]:
    """The orders that were complete or out of time, by the lines of the console, in order of time."""
    found: list[Completion] = []
    for t_s, line in lines_said(said):
        text = line.strip()
        if complete := _COMPLETE.match(text):
            kinds = tuple((complete["kinds"] or "kitting").split(" and "))
            found.append(Completion(t_s, complete["order"], kinds))
        elif late := _OUT_OF_TIME.match(text):
            found.append(Completion(t_s, late["order"], ()))
    return found


def arm_contacts_said(said: Sequence[Said]) -> Iterator[tuple[float, str]]:
    """When arms touched each other, and the names printed of what touched."""
    for t_s, line in lines_said(said):
        if contact := _CONTACT.search(line):
            yield t_s, contact["names"].strip()
