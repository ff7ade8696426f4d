"""Writing a trial as a JSON Lines log."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ariac_score.logs.jsonl import FORMAT
from ariac_score.trial.events import ORDER_ANNOUNCED
from ariac_score.trial.model import Pose, Submission, Task, Trial, orders_of
from ariac_score.trial.signals import Signal

__all__ = ["write_trial_log"]


def write_trial_log(path: Path, trial: Trial, *, signals: Iterable[str] | None = None) -> Path:
    """Write a trial as a JSON Lines log in the format of `schemas/trial_log.schema.json`.

    Args:
        path: The file.
        trial: What to write.
        signals: Names of the signals to write; all of them by default.

    Returns:
        The path.
    """
    names = sorted(trial.signals if signals is None else signals)
    records = [*_head(trial), *_timed([trial.signals[name] for name in names], trial)]
    records.append({"record": "end", "records": len(records) + 1})
    path.write_text("".join(json.dumps(record) + "\n" for record in records), encoding="utf-8")
    return path


def _head(trial: Trial) -> Iterator[dict[str, Any]]:
    yield {
        "record": "trial",
        "format": FORMAT,
        "id": trial.id,
        "clock": trial.clock,
        "witnessed": sorted(trial.witnessed),
    }
    for body in trial.bodies:
        yield {
            "record": "body",
            "id": body.id,
            "kind": body.kind,
            "radius_m": body.radius_m,
            "links": [*body.links],
        }


def _timed(signals: list[Signal], trial: Trial) -> list[dict[str, Any]]:
    """Everything with a time, in order of it."""
    records: list[dict[str, Any]] = []
    for order in orders_of(trial):
        records.append(
            {
                "record": "order",
                "t_s": order.announced_s,
                "id": order.id,
                "priority": order.priority,
                "tasks": [_task_record(task) for task in order.tasks],
            }
        )
    for event in trial.events:
        if event.kind != ORDER_ANNOUNCED:  # the reader makes it of the order
            fields = {"kind": event.kind, "subject": event.subject, "detail": event.detail}
            records.append({"record": "event", "t_s": event.t_s, **fields})
    for submission in trial.submissions:
        records.append(_submission_record(submission))
    # One record for each time: signals of one clock share their rows.
    rows: dict[float, dict[str, Any]] = {}
    for signal in signals:
        for t_s, value in zip(signal.t.tolist(), signal.values.tolist(), strict=True):
            rows.setdefault(t_s, {})[signal.name] = value
    records += [{"record": "sample", "t_s": t_s, "values": values} for t_s, values in rows.items()]
    return sorted(records, key=lambda record: record["t_s"] or 0.0)


def _pose_record(pose: Pose) -> dict[str, Any]:
    return {"position_m": [*pose.position_m], "orientation_wxyz": [*pose.orientation_wxyz]}


def _task_record(task: Task) -> dict[str, Any]:
    products = []
    for wanted in task.products:
        product: dict[str, Any] = {"slot": wanted.slot, "type": wanted.type}
        if wanted.pose is not None:
            product["pose"] = _pose_record(wanted.pose)
        products.append(product)
    return {"id": task.id, "kind": task.kind, "agv": task.agv, "station": task.station, "products": products}


def _submission_record(submission: Submission) -> dict[str, Any]:
    record: dict[str, Any] = {
        "record": "submission",
        "t_s": submission.submitted_s,
        "task_id": submission.task_id,
        "agv": submission.agv,
        "station": submission.station,
    }
    if submission.contents is not None:
        contents = []
        for product in submission.contents:
            fields: dict[str, Any] = {"type": product.type, "name": product.name, "faulty": product.faulty}
            if product.pose is not None:
                fields["pose"] = _pose_record(product.pose)
            contents.append(fields)
        record["contents"] = contents
    return record
