"""The records of ARIAC in JSON-lines logs: orders, and what was submitted for them."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from ariac_score import Pose
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, Tray, WantedProduct

__all__ = ["OrderRecord", "SubmissionRecord", "order_record", "submission_record"]

Note = Callable[[str], None]
"""Takes the reason why a pose is left out."""


class OrderRecord:
    """Reads `order` records: an order with its tasks, and when it was announced."""

    @property
    def schema(self) -> Mapping[str, Any]:
        """JSON schema of the record."""
        return _schema("order_record")

    def read(self, record: Mapping[str, Any], note: Note) -> Order:
        """The order; a pose that is not usable is left out, and noted."""
        return _order(record, note)

    def record_of(self, thing: object) -> dict[str, Any] | None:
        """The record of an order; `None` for anything else."""
        return order_record(thing) if isinstance(thing, Order) else None


class SubmissionRecord:
    """Reads `submission` records: a kit or an assembly as it was submitted."""

    @property
    def schema(self) -> Mapping[str, Any]:
        """JSON schema of the record."""
        return _schema("submission_record")

    def read(self, record: Mapping[str, Any], note: Note) -> KitSubmission:
        """The submission; a pose that is not usable is left out, and noted."""
        return _submission(record, note)

    def record_of(self, thing: object) -> dict[str, Any] | None:
        """The record of a submission; `None` for anything else."""
        return submission_record(thing) if isinstance(thing, KitSubmission) else None


@cache
def _schema(name: str) -> Mapping[str, Any]:
    text = files("ariac_score_ariac").joinpath("log_records.schema.json").read_text(encoding="utf-8")
    # A definition may refer to others, so the part needs all of them.
    return {"$ref": f"#/$defs/{name}", "$defs": json.loads(text)["$defs"]}


def order_record(order: Order) -> dict[str, Any]:
    """The record of an order."""
    tasks = []
    for task in order.tasks:
        fields: dict[str, Any] = {"id": task.id, "kind": task.kind, "agv": task.agv, "station": task.station}
        tasks.append({**fields, **_tray_field(task.tray), "products": [*map(_wanted_record, task.products)]})
    fields = {"id": order.id, "priority": order.priority, "tasks": tasks}
    updates = {"updates": order.updates} if order.updates else {}
    return {"record": "order", "t_s": order.announced_s, **fields, **updates}


def submission_record(submission: KitSubmission) -> dict[str, Any]:
    """The record of a submission."""
    record: dict[str, Any] = {
        "record": "submission",
        "t_s": submission.submitted_s,
        "task_id": submission.item_id,
        "agv": submission.agv,
        "station": submission.station,
        **_tray_field(submission.tray),
    }
    if submission.contents is not None:
        record["contents"] = [
            {"type": p.type, "name": p.name, "faulty": p.faulty, **_pose_field(p.pose)}
            for p in submission.contents
        ]
    return record


def _wanted_record(wanted: WantedProduct) -> dict[str, Any]:
    product: dict[str, Any] = {"slot": wanted.slot, "type": wanted.type, **_pose_field(wanted.pose)}
    if wanted.quadrant:
        product["quadrant"] = wanted.quadrant
    if wanted.challenged is not None:
        product["challenged"] = wanted.challenged
    return product


def _tray_field(tray: Tray | None) -> dict[str, Any]:
    return {} if tray is None else {"tray": {"type": tray.type, **_pose_field(tray.pose)}}


def _pose_field(pose: Pose | None) -> dict[str, Any]:
    if pose is None:
        return {}
    return {"pose": {"position_m": [*pose.position_m], "orientation_wxyz": [*pose.orientation_wxyz]}}


def _pose(data: Mapping[str, Any] | None, note: Note) -> Pose | None:
    """A pose; `None` when there is none, or one that is not usable, which is noted."""
    if data is None:
        return None
    x, y, z = map(float, data["position_m"])
    qw, qx, qy, qz = map(float, data["orientation_wxyz"])
    try:
        return Pose((x, y, z), (qw, qx, qy, qz))
    except ValueError as cause:
        note(str(cause))
        return None


def _tray(data: Mapping[str, Any] | None, note: Note) -> Tray | None:
    return None if data is None else Tray(data["type"], _pose(data.get("pose"), note))


def _order(record: Mapping[str, Any], note: Note) -> Order:
    tasks = tuple(
        Task(
            id=task["id"],
            kind=task.get("kind", "kitting"),
            products=tuple(
                WantedProduct(
                    p["slot"],
                    p["type"],
                    _pose(p.get("pose"), note),
                    p.get("quadrant", 0),
                    p.get("challenged"),
                )
                for p in task["products"]
            ),
            agv=task.get("agv", "any"),
            station=task.get("station", ""),
            tray=_tray(task.get("tray"), note),
        )
        for task in record["tasks"]
    )
    t_s = record["t_s"]
    announced_s = None if t_s is None else float(t_s)
    return Order(record["id"], tasks, announced_s, record.get("priority", 1), record.get("updates", ""))


def _submission(record: Mapping[str, Any], note: Note) -> KitSubmission:
    contents = record.get("contents")
    products = None
    if contents is not None:
        products = tuple(
            Product(p["type"], _pose(p.get("pose"), note), p.get("faulty", False), p.get("name", ""))
            for p in contents
        )
    return KitSubmission(
        item_id=record["task_id"],
        submitted_s=float(record["t_s"]),
        contents=products,
        agv=record.get("agv", ""),
        station=record.get("station", ""),
        tray=_tray(record.get("tray"), note),
    )
