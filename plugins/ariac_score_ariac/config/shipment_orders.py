"""The orders of trial configurations of 2017 to 2022: shipments of products in poses.

Source: `nist_gear/script/gear.py`; ARIAC notes on log formats, sections 7.1 and 7.2.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from ariac_score import Pose, did_you_mean
from ariac_score_ariac.config.config_values import MAX_COUNT, ConfigPath, ConfigValues, shown
from ariac_score_ariac.work import Order, Task, Tray, WantedProduct

__all__ = ["PRODUCT_TYPES", "shipment_orders"]

_UPDATE = re.compile(r"^(?P<order>.+)_update_\d+$")
_HIGH_PRIORITY = 3
_COLORS = ("red", "green", "blue")
_PARTS = ("piston_rod_part", "gear_part", "pulley_part", "gasket_part", "disk_part")
_ASSEMBLY = ("assembly_battery", "assembly_pump", "assembly_regulator", "assembly_sensor")
PRODUCT_TYPES = (
    *_PARTS,
    *(f"{part}_{color}" for part in (*_PARTS, *_ASSEMBLY) for color in _COLORS),
)
"""Product types of 2017 and 2018 (without colour), 2019 and 2020, 2021 and 2022."""
_CONDITIONS = (
    "time",
    "wanted_products",
    "unwanted_products",
    "wanted_parts",
    "unwanted_parts",
    "agv_station_reached",
    "kitting_submission",
    "assembly_submission",
)
"""What an announcement waits for: `..._parts` in 2017, the last three from 2021 on."""


def shipment_orders(values: ConfigValues, root: Mapping[Any, Any]) -> tuple[Order, ...]:
    """The orders of a trial configuration of 2017 to 2022; updates are orders that name another."""
    aliases = _aliases(values, root)
    orders = values.mapping(root.get("orders"), ("orders",))
    if not orders:
        values.refuse(("orders",), "no order is given", "give at least one, such as order_0")
    if len(orders) > MAX_COUNT:
        values.refuse(("orders",), f"{len(orders)} orders cannot be announced", f"give 1 to {MAX_COUNT}")
    taken: list[Order] = []
    for order_id, value in orders.items():
        path = ("orders", str(order_id))
        if str(order_id) in (order.id for order in taken):
            values.refuse(path, f"order {str(order_id)!r} is given twice", "give each order its own name")
        taken.append(_order(values, str(order_id), value, path, aliases, first=not taken))
        count = sum(len(order.tasks) for order in taken)
        if count > MAX_COUNT:
            values.refuse(path, f"{count} shipments cannot be ordered", f"give up to {MAX_COUNT} in a trial")
    known = {order.id for order in taken}
    for order in taken:
        if order.updates and order.updates not in known:
            values.refuse(
                ("orders", order.id),
                f"it updates {order.updates!r}, which is not ordered",
                "an update is named after its order",
            )
    return tuple(taken)


def _aliases(values: ConfigValues, root: Mapping[Any, Any]) -> Mapping[str, str]:
    """Names that stand for product types, so that one order serves several trials."""
    options = root.get("options") or {}
    path: ConfigPath = ("options", "model_type_aliases")
    named = values.mapping(options, ("options",)).get("model_type_aliases") or {}
    return {
        str(alias): values.text(kind, (*path, str(alias)))
        for alias, kind in values.mapping(named, path).items()
    }


def _order(
    values: ConfigValues,
    order_id: str,
    value: Any,
    path: ConfigPath,
    aliases: Mapping[str, str],
    *,
    first: bool,
) -> Order:
    parts = values.mapping(value, path)
    _check_announcement(values, parts, path)
    if "kitting" in parts or "assembly" in parts:
        tasks = [
            *_tasks_of(values, order_id, "kitting", parts, path, aliases),
            *_tasks_of(values, order_id, "assembly", parts, path, aliases),
        ]
        regular = 1
    else:
        tasks = _flat_tasks(values, order_id, parts, path, aliases)
        # Rulebooks 2019 and 2020, as coded: every order after the first has high priority.
        regular = 1 if first else _HIGH_PRIORITY
    priority = parts.get("priority", regular)
    if type(priority) is not int or priority < 1:
        values.refuse((*path, "priority"), f"{priority!r} is not a priority", "give 1 (regular) or 3 (high)")
    update = _UPDATE.match(order_id)
    return Order(order_id, tuple(tasks), None, priority, update["order"] if update else "")


def _check_announcement(values: ConfigValues, order: Mapping[Any, Any], path: ConfigPath) -> None:
    """Check what the announcement of an order waits for; when that came is only in a log."""
    condition = order.get("announcement_condition", "time")
    place = (*path, "announcement_condition_value")
    limit = order.get("announcement_condition_value", 0)
    if condition not in _CONDITIONS:
        values.note(
            "configuration_mistake",
            (*path, "announcement_condition"),
            f"{shown(condition)} is no announcement condition",
            f"{did_you_mean(str(condition), _CONDITIONS)}; only a log tells when it was announced",
        )
    if condition == "time":
        values.seconds(limit, place)
    elif isinstance(limit, (int, float)) and not limit >= 0:
        values.refuse(place, f"{limit!r} products cannot be waited for", "give 0 or more")


def _flat_tasks(
    values: ConfigValues,
    order_id: str,
    parts: Mapping[Any, Any],
    path: ConfigPath,
    aliases: Mapping[str, str],
) -> list[Task]:
    """The shipments of 2017 to 2020; in 2017 they are kits of parts."""
    # Their types have another noun, too: `order_0_kit_0` in 2017, `order_0_shipment_0` later.
    kits = "kit_count" in parts or "parts" in parts
    noun, count_key, products_key = (
        ("kit", "kit_count", "parts") if kits else ("shipment", "shipment_count", "products")
    )
    count = values.count(parts.get(count_key, 1), (*path, count_key))
    agvs = values.names(parts, "destinations", count, path)
    products = _products(values, parts, products_key, path, aliases)
    return [
        Task(f"{order_id}_{noun}_{k}", "kitting", products, agvs[k] if agvs else "any") for k in range(count)
    ]


def _tasks_of(
    values: ConfigValues,
    order_id: str,
    kind: str,
    parts: Mapping[Any, Any],
    path: ConfigPath,
    aliases: Mapping[str, str],
) -> list[Task]:
    """The kitting or assembly shipments of 2021 and 2022."""
    if kind not in parts:
        return []
    path = (*path, kind)
    block = values.mapping(parts[kind], path)
    count = values.count(values.given(block, "shipment_count", path), (*path, "shipment_count"))
    agvs = values.names(block, "agvs", count, path)
    stations = values.names(block, "stations" if kind == "assembly" else "destinations", count, path)
    trays = values.names(block, "trays", count, path)
    products = _products(values, block, "products", path, aliases)
    return [
        Task(
            id=f"{order_id}_{kind}_shipment_{k}",
            kind=kind,
            products=products,
            agv=agvs[k] if agvs else "any",
            station=stations[k] if stations else "",
            # Rulebook 2022: the ordered tray pose is the identity at the AGV's tray centre.
            tray=Tray(trays[k], Pose((0.0, 0.0, 0.0))) if trays else None,
        )
        for k in range(count)
    ]


def _products(
    values: ConfigValues, parts: Mapping[Any, Any], key: str, path: ConfigPath, aliases: Mapping[str, str]
) -> tuple[WantedProduct, ...]:
    given = values.given(parts, key, path)
    path = (*path, key)
    slots = values.mapping(given, path)
    if len(slots) > MAX_COUNT:
        values.refuse(path, f"{len(slots)} products cannot be wanted", f"give up to {MAX_COUNT}")
    products: list[WantedProduct] = []
    for slot, value in slots.items():
        place = (*path, str(slot))
        product = values.mapping(value, place)
        if str(slot) in (known.slot for known in products):
            values.refuse(place, f"slot {str(slot)!r} is given twice", "give each product its own name")
        kind = values.text(values.given(product, "type", place), (*place, "type"))
        pose = values.pose(product["pose"], (*place, "pose")) if "pose" in product else None
        if aliases.get(kind, kind) not in PRODUCT_TYPES:
            _note_unknown(values, kind, aliases, (*place, "type"))
        products.append(WantedProduct(str(slot), aliases.get(kind, kind), pose))
    return tuple(products)


def _note_unknown(values: ConfigValues, kind: str, aliases: Mapping[str, str], place: ConfigPath) -> None:
    """Name a type that no edition has: the order can still be read, but no part of an edition fulfils it."""
    stands_for = f", which {kind!r} stands for," if kind in aliases else ""
    known = [*PRODUCT_TYPES, *(alias for alias in aliases if alias != kind)]
    wanted = aliases.get(kind, kind)
    values.note(
        "unknown_product_type",
        place,
        f"{shown(wanted)}{stands_for} is no product type of 2017 to 2022",
        did_you_mean(wanted, known),
    )
