"""The well-known signals: what each quantity means, its unit and its shape.

A signal is named `quantity/subject`. The subject is a body (`gantry`), a link of
one (`arm::torso`), or two bodies (`arm/person_1`, `truck/ann`), of which those who ask name
the kinds; where they do not, a robot and a human are meant. A few quantities may be of one body and
`environment`; one of the `environment` is about no body, such as `friction/environment`.
Flags are 1 or 0.

Distributions declare further quantities by entry point, each a `Quantity` under its name in the group
`ariac_score.quantities`.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal

from ariac_score.errors import PluginConflictError, PluginError
from ariac_score.installed.points import Point, installed_points

__all__ = [
    "DISTANCES",
    "ENVIRONMENT",
    "GROUP",
    "OUR_QUANTITIES",
    "QUANTITIES",
    "SPEEDS",
    "Quantity",
    "contradiction",
    "quantity_of",
    "quantity_points",
    "signal_in_words",
    "subject_of",
    "subject_shape",
]

GROUP = "ariac_score.quantities"

DISTANCES = ("centre_distance", "centre_distance_2d", "separation", "body_separation")
"""Of two bodies, m."""
SPEEDS = ("speed", "tcp_speed")
"""Of one body, m/s."""

ENVIRONMENT = "environment"
"""The subject of signals that are about no body."""


@dataclass(frozen=True)
class Quantity:
    """What a signal of this name measures.

    Attributes:
        unit: SI unit.
        components: Columns of its values; 1 means shape (n,).
        of: Whether it belongs to one body, to a pair of bodies, or to the environment.
        meaning: One sentence.
        at_least: The least value it can have; a smaller one is a fault of the recorder.
        any_bodies: Whether who asks for it without kinds means every two bodies, not a robot and a human.
    """

    unit: str
    components: int
    of: Literal["body", "pair", "environment"]
    meaning: str
    at_least: float = -math.inf
    any_bodies: bool = False


OUR_QUANTITIES = {
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


class _Vocabulary(Mapping[str, Quantity]):
    """The quantities by name: ours, then those that distributions declare, imported when they are named."""

    def __getitem__(self, name: str) -> Quantity:
        """The quantity of that name.

        Raises:
            KeyError: Nobody declares it.
            PluginError: What declares it cannot be imported, or is no `Quantity`.
            PluginConflictError: Two distributions declare it differently.
        """
        ours = OUR_QUANTITIES.get(name)
        return ours if ours is not None else _declared(name, tuple(sys.path))

    def __iter__(self) -> Iterator[str]:
        yield from OUR_QUANTITIES
        yield from sorted({point.name for point in _points(tuple(sys.path))} - OUR_QUANTITIES.keys())

    def __len__(self) -> int:
        return sum(1 for _ in self)


QUANTITIES: Mapping[str, Quantity] = _Vocabulary()
"""Every well-known quantity by name; what distributions declare is imported when it is asked for."""


# By `sys.path`: what is installed does not change while that stays the same.
@lru_cache(maxsize=4)
def _points(_path: tuple[str, ...]) -> tuple[Point, ...]:
    return tuple(point for point in installed_points() if point.group == GROUP)


def quantity_points(name: str) -> tuple[Point, ...]:
    """Who declares a quantity: none for one of ours, several where distributions agree or contradict."""
    return tuple(point for point in _points(tuple(sys.path)) if point.name == name)


@lru_cache(maxsize=256)
def _declared(name: str, _path: tuple[str, ...]) -> Quantity:
    declared = {point: _quantity(point) for point in quantity_points(name)}
    if not declared:
        raise KeyError(name)
    # The same numbers under the same name are no conflict, whoever else declares them.
    if len({(q.unit, q.components, q.of) for q in declared.values()}) > 1:
        both = " and ".join(
            f"{point.distribution} {point.version} in {q.unit!r} ({q.components} of {q.of})"
            for point, q in declared.items()
        )
        raise PluginConflictError(
            f"the quantity {name!r} is declared by {both}",
            hint="uninstall one: a number cannot be read in two units",
        )
    return next(iter(declared.values()))


def _quantity(point: Point) -> Quantity:
    found = point.load()
    if not isinstance(found, Quantity):
        raise PluginError(
            f"is a {type(found).__name__}, not a Quantity",
            origin=point.origin,
            hint="let the entry point name a value: NAME = Quantity(unit, components, of, meaning)",
        )
    return found


def contradiction(name: str, own: Quantity) -> str:
    """Why a log or log map cannot declare a quantity of its own as it does; empty where it can.

    >>> contradiction("speed", Quantity("m/s", 1, "body", "the same"))
    "quantity 'speed' has its meaning already"
    """
    known = QUANTITIES.get(name)
    if name in OUR_QUANTITIES:
        return f"quantity {name!r} has its meaning already"
    if known is None or (known.unit, known.components, known.of) == (own.unit, own.components, own.of):
        return ""
    (first, *_) = quantity_points(name)
    whose = f"{first.distribution} {first.version} declares it in {known.unit!r}"
    return f"quantity {name!r} has its meaning already: {whose} ({known.components} of {known.of})"


def subject_shape(quantity: Quantity) -> str:
    """How the subject of its signals is written, in words.

    >>> subject_shape(QUANTITIES["separation"]), subject_shape(Quantity("K", 1, "environment", "heat"))
    ('body/other', 'environment')
    """
    return {"pair": "body/other", "body": "body", "environment": ENVIRONMENT}[quantity.of]


def quantity_of(signal: str) -> str:
    """The quantity in a signal's name.

    >>> quantity_of("centre_distance/gantry/person_1")
    'centre_distance'
    """
    return signal.partition("/")[0]


_SPOKEN = {
    "centre_distance": "distance",
    "centre_distance_2d": "distance in the floor plane",
    "body_separation": "separation",
    "approach_speed_robot": "approach by the robot",
    "approach_speed_human": "approach by the human",
}
_BY_KIND = ("robot", "human")


def signal_in_words(signal: str) -> str:
    """What people call a signal.

    >>> signal_in_words("centre_distance/robot/human"), signal_in_words("speed/human")
    ('distance of robot and human', 'speed of the human')
    >>> signal_in_words("tcp_speed/arm::wrist"), signal_in_words("friction/environment")
    ('tcp speed of arm::wrist', 'friction')
    """
    quantity, _, subject = signal.partition("/")
    words = _SPOKEN.get(quantity, quantity.replace("_", " "))
    if subject in ("", ENVIRONMENT):
        return words
    whose = f"the {subject}" if subject in _BY_KIND else " and ".join(subject.split("/"))
    return f"{words} of {whose}"


def subject_of(signal: str) -> str:
    """The subject in a signal's name.

    >>> subject_of("centre_distance/gantry/person_1")
    'gantry/person_1'
    """
    return signal.partition("/")[2]
