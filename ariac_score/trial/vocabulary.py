"""The well-known signals: what each quantity means, its unit and its shape.

A signal is named `quantity/subject`. The subject is a body (`gantry`), a link of
one (`gantry::torso`), or a robot and a human (`gantry/person_1`).
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
    """

    unit: str
    components: int
    of: Literal["body", "pair"]
    meaning: str
    at_least: float = -math.inf


QUANTITIES = {
    "position": Quantity("m", 3, "body", "place of the body's (or link's) origin in the world frame"),
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
