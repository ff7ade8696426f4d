"""The orders of trial configurations of 2023 and 2024: a list, one task each.

Source: ARIAC notes on log formats, section 7.3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ariac_score import did_you_mean
from ariac_score_ariac.config.config_values import MAX_COUNT, ConfigPath, ConfigValues
from ariac_score_ariac.parts import COLORS, TYPES
from ariac_score_ariac.work import Order, Task, Tray, WantedProduct

__all__ = ["PRODUCT_TYPES", "listed_orders"]

_HIGH_PRIORITY = 3
_KINDS = ("kitting", "assembly", "combined")
PRODUCT_TYPES = tuple(f"{kind}_{color}" for kind in TYPES for color in COLORS)
"""Product types of 2023 and 2024."""
_DESTINATIONS = ("kitting", "assembly_front", "assembly_back", "warehouse")
_STATIONS = ("as1", "as2", "as3", "as4")
_CONDITIONS = ("time_condition", "part_place_condition", "submission_condition")
_CHALLENGES = ("faulty_part", "dropped_part", "robot_malfunction", "sensor_blackout", "human")
_NUMBERS = (1, 2, 3, 4)
"""AGVs and quadrants alike."""


def listed_orders(values: ConfigValues, root: Mapping[Any, Any]) -> tuple[Order, ...]:
    """The orders of a trial configuration of 2023 or 2024.

    Each has one task, which is handed in under the order's id.
    """
    orders = values.sequence(root.get("orders"), ("orders",))
    if not 0 < len(orders) <= MAX_COUNT:
        cause = f"{len(orders)} orders cannot be announced" if orders else "no order is given"
        values.refuse(("orders",), cause, f"give 1 to {MAX_COUNT}")
    ids: list[str] = []
    for number, value in enumerate(orders):
        path: ConfigPath = ("orders", number)
        order_id = values.text(values.given(values.mapping(value, path), "id", path), (*path, "id"))
        # A slash parts the levels of a finding's subject.
        if "/" in order_id or order_id.split() != [order_id]:
            values.refuse(
                (*path, "id"), f"{order_id!r} is no order id", "ids are 8 letters and digits, without spaces"
            )
        if order_id in ids:
            values.refuse((*path, "id"), f"order {order_id!r} is given twice", "give each order its own id")
        ids.append(order_id)
    challenged = _challenged(values, root, ids)
    return tuple(
        _listed_order(values, order_id, orders[number], ("orders", number), ids, challenged)
        for number, order_id in enumerate(ids)
    )


def _challenged(
    values: ConfigValues, root: Mapping[Any, Any], ids: Sequence[str]
) -> frozenset[tuple[str, int]]:
    """The quadrants of orders that a faulty-part challenge is set on."""
    found: set[tuple[str, int]] = set()
    for number, value in enumerate(values.sequence(root.get("challenges") or [], ("challenges",))):
        path: ConfigPath = ("challenges", number)
        for kind, challenge in values.mapping(value, path).items():
            if kind not in _CHALLENGES:
                values.refuse(path, f"{kind!r} is no challenge", did_you_mean(str(kind), _CHALLENGES))
            if kind == "faulty_part":
                place = (*path, "faulty_part")
                parts = values.mapping(challenge, place)
                order_id = values.one_of(parts, "order_id", ids, place)
                found |= {(order_id, q) for q in _NUMBERS if values.truth(parts, f"quadrant{q}", place)}
    return frozenset(found)


def _listed_order(
    values: ConfigValues,
    order_id: str,
    value: Any,
    path: ConfigPath,
    ids: Sequence[str],
    challenged: frozenset[tuple[str, int]],
) -> Order:
    parts = values.mapping(value, path)
    _check_announcement(values, parts, path, ids)
    kind = values.one_of(parts, "type", _KINDS, path)
    key = f"{kind}_task"
    block = values.mapping(values.given(parts, key, path), (*path, key))
    path = (*path, key)
    priority = _HIGH_PRIORITY if values.truth(parts, "priority", path[:-1]) else 1
    if kind == "kitting":
        tray_id = values.given(block, "tray_id", path)
        # Two digits of the model's name are read as the number, though trays end at 9.
        if type(tray_id) is not int or not 0 <= tray_id <= 99:
            values.refuse(
                (*path, "tray_id"), f"{tray_id!r} is no tray id", "give the number of a tray, 0 to 9"
            )
        task = Task(
            id=order_id,
            kind=kind,
            products=_listed_products(
                values, block, path, {q for order, q in challenged if order == order_id}
            ),
            agv=f"agv{values.one_of(block, 'agv_number', _NUMBERS, path)}",
            station=values.one_of(block, "destination", _DESTINATIONS, path),
            tray=Tray(f"kit_tray_{tray_id:02d}"),
        )
    else:
        # `agv_number` says which AGVs bring the parts, and no score depends on it.
        products = _listed_products(values, block, path, None)
        task = Task(order_id, kind, products, station=values.one_of(block, "station", _STATIONS, path))
    return Order(order_id, (task,), None, priority)


def _check_announcement(
    values: ConfigValues, order: Mapping[Any, Any], path: ConfigPath, ids: Sequence[str]
) -> None:
    """Check that an order has a condition for its announcement; the time itself is only in a log."""
    place = (*path, "announcement")
    condition = values.mapping(values.given(order, "announcement", path), place)
    for kind, value in condition.items():
        if kind not in _CONDITIONS:
            values.refuse(place, f"{kind!r} is no condition", did_you_mean(str(kind), _CONDITIONS))
        if kind == "submission_condition":
            values.one_of(values.mapping(value, (*place, kind)), "order_id", ids, (*place, kind))
        if kind == "time_condition":
            values.seconds(value, (*place, kind))


def _listed_products(
    values: ConfigValues, block: Mapping[Any, Any], path: ConfigPath, challenged: set[int] | None
) -> tuple[WantedProduct, ...]:
    """The products of a task; those of a kit (`challenged` is given) have a quadrant, others a pose."""
    path = (*path, "products")
    products: list[WantedProduct] = []
    for number, value in enumerate(values.sequence(values.given(block, "products", path[:-1]), path)):
        place = (*path, number)
        product = values.mapping(value, place)
        kind = values.one_of(product, "type", TYPES, place)
        name = f"{kind}_{values.one_of(product, 'color', COLORS, place)}"
        if challenged is None:
            pose = values.pose(values.given(product, "assembled_pose", place), (*place, "assembled_pose"))
            products.append(WantedProduct(f"part_{number}", name, pose))
        else:
            quadrant = values.one_of(product, "quadrant", _NUMBERS, place)
            products.append(
                WantedProduct(f"part_{number}", name, None, quadrant, challenged=quadrant in challenged)
            )
    return tuple(products)
