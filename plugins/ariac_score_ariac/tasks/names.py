"""What a product is called: instance names, colours, base types."""

from __future__ import annotations

from typing import Literal

TypeNames = Literal["whole", "after_colon"]
"""How much of a delivered name is its type: all of it, or what follows the last colon."""


def base_type(product_type: str) -> str:
    """The product type without its colour: the text before the last underscore.

    >>> base_type("gear_part_red")
    'gear_part'
    """
    # Without an underscore the simulator aborts; rules that need to say so test for it themselves.
    return product_type.rpartition("_")[0] or product_type


def delivered_type(name: str, names: TypeNames) -> str:
    """The product type of a delivered name.

    Source: rulebooks, sections 5 (2021: text after the last colon) and 6 (2022: no cutting).

    >>> delivered_type("agv2::tray_2::assembly_pump_red", "after_colon")
    'assembly_pump_red'
    """
    return name.rpartition(":")[2] if names == "after_colon" else name
