"""The well-known signals: what each quantity means, its unit and its shape.

A signal is named `quantity/subject`. The subject is a body (`gantry`), a link of
one (`gantry::torso`), or a robot and a human (`gantry/person_1`). A few quantities
belong to any two bodies (`agv1/person_1`, `gantry/kitting`), or to one body and
`environment`. Flags are 1 or 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

__all__ = ["QUANTITIES", "Quantity", "quantity_of", "subject_of"]


@dataclass(frozen=True)
class Quantity:
    """What a signal of this name measures.

    Attributes:
        unit: SI unit.
        components: Columns of its values; 1 means shape (n,).
        of: Whether it belongs to one body or to a (robot, human) pair.
        meaning: One sentence.
        at_least: The least value it can have; a smaller one is a fault of the recorder.
        any_bodies: Whether its pairs may be any two bodies, not only a robot and a human.
    """

    unit: str
    components: int
    of: Literal["body", "pair"]
    meaning: str
    at_least: float = -math.inf
    any_bodies: bool = False


QUANTITIES = {
    "position": Quantity("m", 3, "body", "place of the body's (or link's) origin in the world frame"),
    # `at_least` only where less is impossible: `settle` drops what is below as a fault of the recorder.
    "velocity": Quantity("m/s", 3, "body", "velocity of that origin in the world frame"),
    "speed": Quantity("m/s", 1, "body", "scalar speed; of the fastest link where links are followed", 0.0),
    "centre_distance": Quantity(
        "m", 1, "pair", "distance between the origins, or the nearest two links where links are followed", 0.0
    ),
    "centre_distance_2d": Quantity("m", 1, "pair", "the same in the floor plane", 0.0),
    "separation": Quantity("m", 1, "pair", "smallest surface-to-surface distance over all links", 0.0),
    "approach_speed_robot": Quantity(
        "m/s", 1, "pair", "speed of the robot's nearest point towards the human; negative: away"
    ),
    "approach_speed_human": Quantity(
        "m/s", 1, "pair", "speed of the human's nearest point towards the robot; negative: away"
    ),
    "relative_speed": Quantity("m/s", 1, "pair", "speed of the nearest points against each other", 0.0),
    "contact_force": Quantity("N", 1, "pair", "force between the two; 0 without contact", 0.0, True),
    "contact_pressure": Quantity("Pa", 1, "pair", "largest pressure between the two", 0.0, True),
    "contact_area": Quantity("m2", 1, "pair", "area on which the two touch", 0.0, True),
    "contact_height": Quantity("m", 1, "pair", "height of the contact above the floor"),
    "clamped": Quantity("1", 1, "pair", "1 while the human's body part cannot get away, else 0", 0.0),
    "crush_gap": Quantity(
        "m", 1, "pair", "gap between the robot and a fixed surface, the human's body part between them", 0.0
    ),
    "in_contact": Quantity("1", 1, "pair", "1 while two bodies touch, else 0", 0.0, True),
    "body_separation": Quantity(
        "m", 1, "pair", "smallest surface-to-surface distance of two bodies of any kind", 0.0, True
    ),
    "heading": Quantity("rad", 1, "body", "rotation of the body (or link) about the vertical"),
    "tcp_speed": Quantity("m/s", 1, "body", "speed of the tool centre point: link `tcp` or `tool0`", 0.0),
    "joint_speed": Quantity("rad/s", 1, "body", "speed of the fastest joint", 0.0),
    "joint_position": Quantity("rad", 1, "body", "angle of one joint, named like a link"),
    "clearance": Quantity("m", 1, "body", "free space around a vehicle to the nearest obstacle", 0.0),
    "drive_enabled": Quantity("1", 1, "body", "1 while the drives have power, else 0", 0.0),
    "enabling_device": Quantity("1", 1, "body", "1 while the enabling device is held, else 0", 0.0),
    "manual_mode": Quantity("1", 1, "body", "1 in manual (reduced-speed, teaching) mode, else 0", 0.0),
    "personnel_detection": Quantity(
        "1", 1, "body", "1 while a vehicle's detection of persons covers its direction of travel, else 0", 0.0
    ),
}


def quantity_of(signal: str) -> str:
    """The quantity in a signal's name.

    >>> quantity_of("centre_distance/gantry/person_1")
    'centre_distance'
    """
    return signal.partition("/")[0]


def subject_of(signal: str) -> str:
    """The subject in a signal's name.

    >>> subject_of("centre_distance/gantry/person_1")
    'gantry/person_1'
    """
    return signal.partition("/")[2]
