"""The parts of 2023 and 2024: types, colours, and what the name of a model says of both."""

from __future__ import annotations

__all__ = ["COLORS", "FAULTY_ENDING", "TYPES", "part_of"]

TYPES = ("battery", "pump", "sensor", "regulator")
"""In the order of the constants of `ariac_msgs/msg/Part`, 10 to 13."""

COLORS = ("red", "green", "blue", "orange", "purple")
"""In the order of the constants of `ariac_msgs/msg/Part`, 0 to 4."""

FAULTY_ENDING = "_faulty"
"""What the quality check appends to the name of a part in a challenged quadrant."""


def part_of(name: str) -> tuple[str, str] | None:
    """The type and colour that a model's name contains; `None` when it is no part.

    Source: task manager of 2023 and 2024: a model is a part when its name contains a
    known type and a known colour; anything else on the tray is not seen.

    >>> part_of("battery_blue"), part_of("assembly_pump_red_4"), part_of("kit_tray_03")
    (('battery', 'blue'), ('pump', 'red'), None)
    """
    kind = next((kind for kind in TYPES if kind in name), None)
    color = next((color for color in COLORS if color in name), None)
    return None if kind is None or color is None else (kind, color)
