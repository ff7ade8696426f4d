"""A competition of 2024 made to order: the official texts of several teams and runs.

Scores are worked out here from the flaws of each part, by the rules of the
rulebook's coded section of 2024, and not by the scoring code of this project.
"""

from __future__ import annotations

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

__all__ = [
    "TEAMS_2024",
    "TRIALS_2024",
    "Outcome",
    "PlannedOrder",
    "write_text_competition",
]

CRASHED = "Gazebo Crashed score not recorded\n"
CANCELLED = "Process cancelled by user"
"""What the evaluation script writes into `trial_log.txt`, the second without a line end; section 5.2."""

PRICES = {
    "break_beam": 100,
    "proximity": 100,
    "laser_profiler": 200,
    "lidar": 300,
    "rgb_camera": 300,
    "rgbd_camera": 500,
    "basic_logical_camera": 500,
    "advanced_logical_camera": 0,
    "robot_rgb_camera": 800,
    "robot_rgbd_camera": 1000,
}
"""Dollars for each sensor; notes on log formats, section 6."""

_ROW = "=" * 40
_POINTS = {"kitting": 3, "assembly": 3, "combined": 5}
_FLAWS = {"kitting": ("color", "flipped", "faulty", "type"), "assembly": ("color", "pose", "none")}


@dataclass(frozen=True)
class PlannedOrder:
    """An order of a trial: what is wanted, as (type, colour) for each part."""

    id: str
    kind: str
    priority: bool
    parts: tuple[tuple[str, str], ...]

    @property
    def most(self) -> int:
        """The most it can score."""
        n = len(self.parts)
        # Kitting 1 + 3n + n, assembly 3n + n, combined 5n + n: rulebook, section 8.
        return _POINTS[self.kind] * n + n + (1 if self.kind == "kitting" else 0)


@dataclass(frozen=True)
class Outcome:
    """How an order went in one run: a flaw (or empty) for each part, and when it was handed in."""

    flaws: tuple[str, ...]
    duration_s: float | None
    right_tray: bool = True

    def points(self, order: PlannedOrder, i: int) -> int:
        """The points of one part."""
        # A wrong colour costs a point; flipped, faulty, misplaced or of another type a part earns nothing.
        if self.flaws[i] in ("", "color"):
            return _POINTS[order.kind] - (self.flaws[i] == "color")
        return 0

    def bonus(self, order: PlannedOrder) -> int:
        """The bonus: one point for each part when nothing is wrong with any."""
        return 0 if any(self.flaws) else len(order.parts)

    def score(self, order: PlannedOrder) -> int:
        """The task score, without any factor for priority."""
        if self.duration_s is None:
            return 0
        tray = 1 if order.kind == "kitting" and self.right_tray else 0
        parts = sum(self.points(order, i) for i in range(len(self.flaws)))
        return tray + parts + self.bonus(order)


TEAMS_2024: Mapping[str, Mapping[str, int]] = {
    "aurora": {"break_beam": 2, "basic_logical_camera": 3, "robot_rgbd_camera": 1},
    "borealis": {"rgbd_camera": 2, "lidar": 1, "robot_rgb_camera": 1},
    "cygnus": {"basic_logical_camera": 4, "rgb_camera": 2, "proximity": 2},
}
"""The sensors of each team."""

TRIALS_2024: Mapping[str, tuple[PlannedOrder, ...]] = {
    "assembly": (
        PlannedOrder(
            "ASMB0001", "assembly", False, (("battery", "red"), ("pump", "green"), ("sensor", "blue"))
        ),
        PlannedOrder("ASMB0002", "assembly", True, (("regulator", "orange"), ("pump", "purple"))),
    ),
    "kitting": (
        PlannedOrder(
            "KITT0001", "kitting", False, (("battery", "blue"), ("pump", "red"), ("sensor", "green"))
        ),
        PlannedOrder("KITT0002", "kitting", True, (("regulator", "red"), ("battery", "orange"))),
    ),
    "mixed_tasks": (
        PlannedOrder("MIXD0001", "kitting", False, (("sensor", "purple"), ("pump", "blue"))),
        PlannedOrder("MIXD0002", "combined", False, (("battery", "green"), ("regulator", "blue"))),
        PlannedOrder("MIXD0003", "assembly", True, (("pump", "orange"),)),
    ),
}
"""The orders of each trial, in the order of the trial file."""

RUNS = 5
_STYLE = {"aurora": (0.10, 70.0), "borealis": (0.22, 52.0), "cygnus": (0.32, 60.0)}
"""For each team how often a part has a flaw, and how long an order takes, s."""
_SPECIAL = {("cygnus", "mixed_tasks", 4): CRASHED, ("borealis", "kitting", 5): CANCELLED}


def write_text_competition(folder: Path, *, seed: int = 2024) -> None:
    """Write `trials/` and `logs/<team>/<trial>_<n>/` with the official texts of 2024.

    Three teams, three trials, five runs each; one run crashed and one was cancelled.

    Args:
        folder: Created where missing.
        seed: For the flaws and times.
    """
    for trial, orders in TRIALS_2024.items():
        _write(folder / "trials" / f"{trial}.yaml", _trial_yaml(orders))
    chance = random.Random(seed)  # noqa: S311  # an example, not a secret
    for team, sensors in TEAMS_2024.items():
        for trial, orders in TRIALS_2024.items():
            for run in range(1, RUNS + 1):
                outcomes = [_outcome(order, chance, *_STYLE[team]) for order in orders]
                text = _SPECIAL.get((team, trial, run)) or trial_log_text(trial, orders, outcomes)
                place = folder / "logs" / team / f"{trial}_{run}"
                _write(place / "trial_log.txt", text)
                _write(place / "sensor_cost.txt", sensor_cost_text(sensors))


def _write(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8", newline="\n")


def _outcome(order: PlannedOrder, chance: random.Random, flaw_rate: float, usual_s: float) -> Outcome:
    known = _FLAWS["kitting" if order.kind == "kitting" else "assembly"]
    flaws = tuple(
        known[int(chance.random() * len(known))] if chance.random() < flaw_rate else "" for _ in order.parts
    )
    # Not `round`: its halves and float printing must not depend on the platform.
    duration_s = int((0.8 + 0.5 * chance.random()) * usual_s * len(order.parts) * 500) * 2 / 1000
    handed_in = chance.random() > flaw_rate / 3
    right_tray = chance.random() > flaw_rate / 2
    return Outcome(flaws, duration_s if handed_in else None, right_tray)


def trial_log_text(trial: str, orders: Sequence[PlannedOrder], outcomes: Sequence[Outcome]) -> str:
    """The text of `trial_log.txt`; notes on log formats, section 5.1."""
    handed_in = [outcome.duration_s for outcome in outcomes if outcome.duration_s is not None]
    head = [_ROW, "Trial Summary", _ROW, f"Trial file: {trial}.yaml", "Trial time limit: 600.000000"]
    head += ["Time limit reached: no", f"Completion time: {max(handed_in, default=0.0) + 2.5:.6f}"]
    head += [f"Total number of orders: {len(orders)}", f"Number of submitted orders: {len(handed_in)}", ""]
    pairs = list(zip(orders, outcomes, strict=True))
    summary = [line for order, outcome in pairs for line in _summary(order, outcome)]
    details = [line for order, outcome in pairs for line in _details(order, outcome)]
    lines = [*head, _ROW, "Order Summary", _ROW, *summary, "", _ROW, "Order Details", _ROW, *details]
    return "\n".join(lines) + "\n"


def _yes(value: bool) -> str:
    return "yes" if value else "no"


def _summary(order: PlannedOrder, outcome: Outcome) -> Iterator[str]:
    at_s = outcome.duration_s
    yield f"Order ID: {order.id}"
    yield f"\tOrder type: {order.kind}"
    yield f"\tOrder submitted: {_yes(at_s is not None)}"
    yield f"\tPriority: {_yes(order.priority)}"
    yield f"\tMax task score: {order.most}"
    yield f"\tActual task score: {outcome.score(order)}"
    yield f"\tSubmission time: {'N/A' if at_s is None else f'{at_s + 2:.6f}'}"
    yield f"\tSubmission duration: {'N/A' if at_s is None else f'{at_s:.6f}'}"


def _details(order: PlannedOrder, outcome: Outcome) -> Iterator[str]:
    yield f"Order ID: {order.id}"
    if outcome.duration_s is None:
        yield "\tNot Submitted"
        return
    yield f"\tType: {order.kind}"
    yield f"\tPriority: {_yes(order.priority)}"
    if order.kind == "kitting":
        yield from ("\tAGV: 1", f"\tCorrect tray: {_yes(outcome.right_tray)}", "\tCorrect destination: yes")
    else:
        yield "\tStation: 1"
    yield f"\tMax score: {order.most}"
    yield f"\tActual score: {outcome.score(order)}"
    yield f"\tBonus: {outcome.bonus(order)}"
    if order.kind == "kitting":
        yield from _quadrants(order, outcome)
    else:
        yield from ("\t" + "-" * 23, "\tParts Summary", "\t" + "-" * 23)
        yield from _parts(order, outcome)


def _quadrants(order: PlannedOrder, outcome: Outcome) -> Iterator[str]:
    for i, flaw in enumerate(outcome.flaws):
        yield f"\tQuadrant: {i + 1}"
        yield f"\t\tScore: {outcome.points(order, i)}"
        yield f"\t\tCorrect part type: {_yes(flaw != 'type')}"
        yield f"\t\tCorrect part color: {_yes(flaw not in ('color', 'type'))}"
        yield f"\t\tFaulty part: {_yes(flaw == 'faulty')}"
        yield f"\t\tFlipped part: {_yes(flaw == 'flipped')}"


def _parts(order: PlannedOrder, outcome: Outcome) -> Iterator[str]:
    # Battery, pump, regulator, sensor: the simulator has one record for each type, in this order.
    wanted = sorted(enumerate(order.parts), key=lambda item: item[1][0])
    for i, (kind, color) in wanted:
        flaw = outcome.flaws[i]
        if flaw == "none":
            continue  # no part, no record of it
        yield f"\tPart: {_other(color) if flaw == 'color' else color} {kind}"
        yield f"\t\tPart score: {outcome.points(order, i)}"
        yield "\t\tCorrect type: yes"
        yield f"\t\tCorrect color: {_yes(flaw != 'color')}"
        yield f"\t\tCorrect pose: {_yes(flaw != 'pose')}"
        yield f"\t\t\tPosition: {0.1 if flaw == 'pose' else 0.0:.6f}, 0.035000, 0.043000"
        yield "\t\t\tOrientation: 0.000000, 0.000000, 1.570796"


def _other(color: str) -> str:
    return "green" if color == "red" else "red"


def sensor_cost_text(sensors: Mapping[str, int]) -> str:
    """The text of `sensor_cost.txt`; notes on log formats, section 6."""
    row = "=" * 30
    total = sum(PRICES[kind] * number for kind, number in sensors.items())
    counts = [f"Number of {kind}'s used: {sensors.get(kind, 0)}" for kind in PRICES]
    return "\n".join(
        [row, "User Sensor Log", row, *counts, "", "", f"Total sensor cost is: ${total}", "-" * 30, ""]
    )


def _trial_yaml(orders: Sequence[PlannedOrder]) -> str:
    """A trial configuration of 2024; notes on log formats, section 7.3."""
    return yaml.safe_dump(
        {
            "time_limit": 600,
            "kitting_trays": {"tray_ids": [3], "slots": [1]},
            "orders": [_order(o) for o in orders],
        },
        sort_keys=False,
        width=110,
    )


def _order(order: PlannedOrder) -> dict[str, object]:
    if order.kind == "kitting":
        products: list[dict[str, object]] = [
            {"type": kind, "color": color, "quadrant": i + 1} for i, (kind, color) in enumerate(order.parts)
        ]
        task: dict[str, object] = {
            "agv_number": 1,
            "tray_id": 3,
            "destination": "warehouse",
            "products": products,
        }
    else:
        products = [
            {
                "type": kind,
                "color": color,
                "assembled_pose": {"xyz": [0.0, 0.035, 0.043], "rpy": [0, 0, "pi/2"]},
                "assembly_direction": [0, 0, -1],
            }
            for kind, color in order.parts
        ]
        task = {"station": "as1", "products": products}
        if order.kind == "assembly":
            task = {"agv_number": [1], **task}
    return {
        "id": order.id,
        "type": order.kind,
        "announcement": {"time_condition": 0},
        "priority": order.priority,
        f"{order.kind}_task": task,
    }
