"""The parts of the editions: types, colours, what a model's name says of both, what people call them."""

from __future__ import annotations

__all__ = ["COLORS", "FAULTY_ENDING", "TYPES", "part_of", "spoken"]

TYPES = ("battery", "pump", "sensor", "regulator")
"""In the order of the constants of `ariac_msgs/msg/Part`, 10 to 13."""

COLORS = ("red", "green", "blue", "orange", "purple")
"""In the order of the constants of `ariac_msgs/msg/Part`, 0 to 4."""

_NOUNS = {
    **{f"{noun.replace(' ', '_')}_part": noun for noun in ("gear", "piston rod", "disk", "gasket", "pulley")},
    **{f"assembly_{noun}": f"assembly {noun}" for noun in TYPES},
    **{noun: noun for noun in TYPES},
}
"""What people call the product types of 2017 to 2022, and of 2023 and 2024, without their colours."""

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


def spoken(product_type: str, count: int = 1) -> str:
    """What people call a product type; a name that no edition has stays as it is, so that a slip is seen.

    No two types are called the same.

    Args:
        product_type: Such as `gear_part_blue`, with or without its colour.
        count: Of how many it is said.

    >>> spoken("gear_part_blue"), spoken("battery_red", 2), spoken("piston_rod_part"), spoken("gear_prat")
    ('blue gear', 'red batteries', 'piston rod', 'gear_prat')
    """
    kind, _, color = product_type.rpartition("_")
    if product_type in _NOUNS:
        words = _NOUNS[product_type]
    elif kind in _NOUNS and color in COLORS:
        words = f"{color} {_NOUNS[kind]}"
    else:
        return product_type
    return words if count == 1 else f"{words[:-1]}ies" if words.endswith("ry") else f"{words}s"
