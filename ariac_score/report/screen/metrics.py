"""What is shown of cells, as Prometheus reads it (text format 0.0.4)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

__all__ = ["metrics_of"]

_METRICS = {
    "ariac_score_least": "Worst score that is still possible.",
    "ariac_score_most": "Best score that is still possible.",
    "ariac_score_so_far": "Score if nothing more came.",
    "ariac_score_task": "Task score, where the score compares teams.",
    "ariac_score_margin": "Distance of a check from its limit at this moment; negative: violated.",
    "ariac_score_connected": "Whether the source is there.",
    "ariac_score_messages_total": "Messages that have come.",
    "ariac_score_elapsed_seconds": "From the first message to the latest.",
}


def metrics_of(states: Iterable[Mapping[str, Any]]) -> str:
    """The metrics of cells.

    Args:
        states: What is shown of each.
    """
    rows: dict[str, list[str]] = {name: [] for name in _METRICS}
    for state in states:
        for name, labels, value in _rows(state):
            rows[name].append(f"{name}{{{_labels({'cell': state['name'], **labels})}}} {value}")
    lines: list[str] = []
    for name, said in _METRICS.items():
        if rows[name]:
            kind = "counter" if name.endswith("_total") else "gauge"
            lines += [f"# HELP {name} {said}", f"# TYPE {name} {kind}", *rows[name]]
    return "\n".join([*lines, ""])


def _rows(state: Mapping[str, Any]) -> Iterator[tuple[str, dict[str, str], object]]:
    for key in ("least", "most", "so_far", "task"):
        if key in state["score"]:
            yield f"ariac_score_{key}", {}, state["score"][key]
    for one in state["now"]:
        labels = {name: str(one[name]) for name in ("check", "subject", "unit")}
        yield "ariac_score_margin", labels, one["margin"]
    yield "ariac_score_connected", {}, int(state["connected"] and not state["ended"])
    yield "ariac_score_messages_total", {}, state["messages"]
    yield "ariac_score_elapsed_seconds", {}, state["t"]


def _labels(labels: Mapping[str, str]) -> str:
    return ",".join(f'{name}="{_escaped(value)}"' for name, value in labels.items())


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
