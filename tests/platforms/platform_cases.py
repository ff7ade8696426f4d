"""A trial whose orders only the organiser's configuration says, for every platform."""

from __future__ import annotations

import json

__all__ = ["ORGANISERS", "SCORE", "trial_config", "without_orders"]


def trial_config(second_part: str) -> str:
    """A configuration of 2020: one kit of three parts, the second of them as given."""
    parts = (
        ("gear_part_red", [0.1, 0.15, 0], "0"),
        (second_part, [-0.1, 0.15, 0], "'pi/4'"),
        ("piston_rod_part_green", [0, -0.15, 0], "0"),
    )
    products = "".join(
        f"      part_{number}: {{type: {name}, pose: {{xyz: {xyz}, rpy: [0, 0, {yaw}]}}}}\n"
        for number, (name, xyz, yaw) in enumerate(parts)
    )
    return f"""\
orders:
  order_0:
    announcement_condition: time
    announcement_condition_value: 0.5
    priority: 1
    shipment_count: 1
    destinations: [agv1]
    products:
{products}"""


def without_orders(log: str) -> str:
    """A log of the made kitting trial that keeps what order_0 was answered with, and no order."""
    records = [json.loads(line) for line in log.splitlines()]
    kept = [
        {"record": "event", "t_s": record["t_s"], "kind": "order_announced", "subject": "order_0"}
        if record["record"] == "order"
        else record
        for record in records[:-1]
        if record.get("id") != "order_1" and record.get("task_id") != "order_1_shipment_0"
    ]
    kept.append({"record": "end", "records": len(kept) + 1})
    return "".join(json.dumps(record) + "\n" for record in kept)


ORGANISERS = trial_config("gear_part_blue")
SCORE = 3 + 2 + 2
"""Under ARIAC 2020 as coded: types, colours and poses. The gear that lies there is green, so no bonus."""
