"""Writing a trial as a JSON Lines log."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ariac_score.checks.registry import Registry
from ariac_score.logs.jsonl import FORMAT
from ariac_score.trial.events import ORDER_ANNOUNCED
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.work import WorkItem, announced_s

__all__ = ["write_trial_log"]

_GROUP = "ariac_score.record_kinds"


def write_trial_log(path: Path, trial: Trial, *, signals: Iterable[str] | None = None) -> Path:
    """Write a trial as a JSON Lines log in the format of `schemas/trial_log.schema.json`.

    Args:
        path: The file.
        trial: What to write.
        signals: Names of the signals to write; all of them by default.

    Returns:
        The path.
    """
    names = sorted([*trial.signals, *trial.as_consumed] if signals is None else signals)
    records = [
        *_head(trial),
        *_timed([trial.signals[name] for name in names if name in trial.signals], trial),
    ]
    # Last, and not in order of time: the order of the lines is that of consumption.
    for series in (trial.as_consumed[name] for name in names if name in trial.as_consumed):
        for t_s, value in zip(series.t.tolist(), series.values.tolist(), strict=True):
            records.append({"record": "sample", "t_s": t_s, "values": {series.name: value}})
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
        **({"facts": dict(trial.facts)} if trial.facts else {}),
        **({"as_consumed": sorted(trial.as_consumed)} if trial.as_consumed else {}),
    }
    for body in trial.bodies:
        yield {
            "record": "body",
            "id": body.id,
            "kind": body.kind,
            **({} if body.radius_m is None else {"radius_m": body.radius_m}),
            "links": [*body.links],
        }


def _timed(signals: list[Signal], trial: Trial) -> list[dict[str, Any]]:
    """Everything with a time, in order of it."""
    records: list[dict[str, Any]] = []
    kinds = _writers()
    for item in trial.work:
        records.append(
            _brought(item, kinds) or {"record": "item", "t_s": announced_s(item), **_item_fields(item)}
        )
    for event in trial.events:
        if event.kind != ORDER_ANNOUNCED:  # the reader makes it of the item
            fields: dict[str, Any] = {"kind": event.kind, "subject": event.subject, "detail": event.detail}
            if event.numbers:
                fields["numbers"] = {n.name: {"value": n.value, "unit": n.unit} for n in event.numbers}
            records.append({"record": "event", "t_s": event.t_s, **fields})
    for submission in trial.submissions:
        fields = {"t_s": submission.submitted_s, "item_id": submission.item_id}
        records.append(_brought(submission, kinds) or {"record": "handed_in", **fields})
    # One record for each time: signals of one clock share their rows.
    rows: dict[float, dict[str, Any]] = {}
    for signal in signals:
        for t_s, value in zip(signal.t.tolist(), signal.values.tolist(), strict=True):
            rows.setdefault(t_s, {})[signal.name] = value
    records += [{"record": "sample", "t_s": t_s, "values": values} for t_s, values in rows.items()]
    return sorted(records, key=lambda record: record["t_s"] or 0.0)


def _item_fields(item: WorkItem) -> dict[str, Any]:
    fields: dict[str, Any] = {"id": item.id, "level": item.level, "facts": dict(item.facts)}
    return {**fields, "items": [*map(_item_fields, item.items)]} if item.items else fields


def _writers() -> list[Callable[[object], Mapping[str, Any] | None]]:
    """What writes records of competitions: the `record_of` of each kind that has one."""
    registry = Registry()
    kinds = [registry.find(_GROUP, name).build({}) for name in registry.names(_GROUP)]
    return [kind.record_of for kind in kinds if hasattr(kind, "record_of")]


def _brought(
    thing: object, writers: Sequence[Callable[[object], Mapping[str, Any] | None]]
) -> dict[str, Any]:
    """The record of a competition's own class; empty for a plain one."""
    found = (record for write in writers if (record := write(thing)) is not None)
    return dict(next(found, {}))
