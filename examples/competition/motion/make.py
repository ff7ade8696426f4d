"""Make the recordings of this competition: `python examples/competition/motion/make.py [FOLDER]`.

A robot carries parts from two bins to two vehicles while a person walks about. How fast it drives, and from
which distance it waits for the person, is all that tells the teams apart; run by run the person starts at
another moment. Every number follows from names and numbers of runs, so the same files come out everywhere.
"""

from __future__ import annotations

import argparse
import math
import random
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ariac_score import ORDER_ANNOUNCED, Body, Event, Pose, Trial
from ariac_score.testing import write_bag
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.clock import LOG_TIME, Clock
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score_ariac.testing.recordings import recorded_messages
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, WantedProduct

STEP_S = 0.05
DURATION_S = 60.0
STARTS_S, ENDS_S = 0.5, 59.0

Place = tuple[float, float]
BINS: tuple[Place, Place] = ((-1.5, 1.5), (1.5, 1.5))
VEHICLES: tuple[Place, Place] = ((-3.0, -1.5), (3.0, -1.5))
TAKES_S = 0.8
"""For gripping or laying down a part."""


@dataclass(frozen=True)
class Team:
    """How a team drives.

    Attributes:
        speed_m_s: Of its robot.
        yields_m: Before it comes nearer to the person than this, it backs away.
        sloppy_m: How far from their places parts come to lie, at most.
        wrong: Share of parts of the wrong colour.
    """

    speed_m_s: float
    yields_m: float
    sloppy_m: float
    wrong: float


TEAMS = {
    "hare": Team(1.3, 0.0, 0.036, 0.1),
    "fox": Team(1.1, 0.95, 0.028, 0.1),
    "owl": Team(0.9, 1.6, 0.031, 0.05),
    "tortoise": Team(0.7, 2.0, 0.02, 0.0),
}
WALKS: dict[str, tuple[Place, ...]] = {
    "aisle": ((-4.5, 2.9), (4.5, 2.9)),
    "crossing": ((0.2, 4.0), (0.2, -3.5)),
    "beside": ((4.0, 3.5), (2.2, 2.6), (0.4, 3.0), (2.2, 2.6)),
}
"""Where the person walks in each trial, there and back again."""
PACE_M_S = {"aisle": 1.2, "crossing": 0.9, "beside": 0.6}
RUNS = (1, 2, 3)

KITS = (
    (("gear_part_red", 0), ("gear_part_blue", 1), ("piston_rod_part_green", 0)),
    (("pulley_part_red", 1), ("disk_part_blue", 0)),
)
"""For each order its parts, and the bin each lies in."""


def made_run(team: str, trial: str, number: int) -> Trial:
    """One run: the paths of robot and person, and what was handed in."""
    luck = random.Random(f"{team} {trial} {number}")  # noqa: S311  # no secret hangs on a made run
    t = np.arange(round(DURATION_S / STEP_S) + 1) * STEP_S
    human = [_along(WALKS[trial], PACE_M_S[trial], t_s + 7.0 * number) for t_s in t.tolist()]
    robot, done_s = _driven(TEAMS[team], human)
    builder = TrialBuilder(f"{trial}_{number}", file="made", clock=Clock(LOG_TIME, 1_700_000_000_000_000_000))
    builder.witnessed |= {"submissions"}
    for event in _events():
        builder.add(event)
    for name, path in (("robot", robot), ("human", human)):
        builder.add_body(Body(name, name))
        builder.add_signal(f"position/{name}", "m", t, np.array([(x, y, 0.0) for x, y in path]))
    orders = tuple(_orders())
    builder.work = orders
    builder.submissions = list(_handed_in(orders, done_s, TEAMS[team], luck))
    return builder.build()


def _along(places: tuple[Place, ...], pace_m_s: float, t_s: float) -> Place:
    """Where somebody is who walks from place to place and back, again and again."""
    loop = [*places, *reversed(places[1:-1]), places[0]]
    lengths = [math.dist(a, b) for a, b in pairwise(loop)]
    way = (pace_m_s * t_s) % sum(lengths)
    for (a, b), length in zip(pairwise(loop), lengths, strict=True):
        if way <= length:
            return _towards(a, b, way / length)
        way -= length
    return loop[-1]


def _towards(a: Place, b: Place, share: float) -> Place:
    return a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share


def _driven(team: Team, human: list[Place]) -> tuple[list[Place], list[float]]:
    """The path of the robot, and when each part lay on its vehicle."""
    stops = [
        place for k, kit in enumerate(KITS) for _, part_bin in kit for place in (BINS[part_bin], VEHICLES[k])
    ]
    at, rests_s, path, done_s = VEHICLES[0], 0.0, [], []
    for step, person in enumerate(human):
        path.append(at)
        t_s = step * STEP_S
        if rests_s > 0 or t_s < STARTS_S or not stops:
            rests_s -= STEP_S
            continue
        left, way = math.dist(at, stops[0]), team.speed_m_s * STEP_S
        after = _towards(at, stops[0], min(way / left, 1.0) if left else 1.0)
        near_m = math.dist(at, person)
        if math.dist(after, person) < min(team.yields_m, near_m):
            at = _towards(at, person, -way / near_m)
            continue
        if left > way:
            at = after
            continue
        at, rests_s = stops.pop(0), TAKES_S
        if len(stops) % 2 == 0 and t_s + TAKES_S < ENDS_S:
            done_s.append(t_s + TAKES_S)
    return path, done_s


def _events() -> Iterator[Event]:
    yield Event(STARTS_S, COMPETITION_STARTED)
    for k in range(len(KITS)):
        yield Event(1.0 + k, ORDER_ANNOUNCED, f"order_{k}")
    yield Event(ENDS_S, COMPETITION_ENDED)


def _orders() -> Iterator[Order]:
    for k, kit in enumerate(KITS):
        wanted = tuple(
            WantedProduct(f"part_{i}", kind, Pose((0.12 * (i - 1), 0.1, 0.0)))
            for i, (kind, _) in enumerate(kit)
        )
        yield Order(f"order_{k}", (Task(f"kit_{k}", products=wanted, agv=f"agv{k + 1}"),), 1.0 + k)


def _handed_in(
    orders: tuple[Order, ...], done_s: list[float], team: Team, luck: random.Random
) -> Iterator[KitSubmission]:
    """Each kit, with the parts that lay on it by then; one that is not finished leaves at the end."""
    first = 0
    for k, order in enumerate(orders):
        (task,) = order.tasks
        placed = done_s[first : first + len(task.products)]
        first += len(task.products)
        contents = tuple(_laid(wanted, team, luck) for wanted, _ in zip(task.products, placed, strict=False))
        whole = len(placed) == len(task.products)
        yield KitSubmission(task.id, placed[-1] if whole else ENDS_S - 0.5, contents, f"agv{k + 1}")


def _laid(wanted: WantedProduct, team: Team, luck: random.Random) -> Product:
    assert wanted.pose is not None
    x, y, z = wanted.pose.position_m
    kind, color = wanted.type.rsplit("_", 1)
    if luck.random() < team.wrong:
        color = "green" if color == "blue" else "blue"
    return Product(f"{kind}_{color}", Pose((x + team.sloppy_m * luck.random(), y, z)), name=wanted.slot)


def make(folder: Path, *, teams: tuple[str, ...] = tuple(TEAMS), runs: tuple[int, ...] = RUNS) -> list[Path]:
    """Write recordings as `logs/<team>/<trial>_<run>.mcap` below a folder."""
    written = []
    for team in teams:
        for trial in WALKS:
            for number in runs:
                file = folder / "logs" / team / f"{trial}_{number}.mcap"
                file.parent.mkdir(parents=True, exist_ok=True)
                file.unlink(missing_ok=True)
                messages = recorded_messages(made_run(team, trial, number), motion="frames")
                written.append(write_bag(file, messages, storage="mcap"))
    return written


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path(__file__).parent)
    files = make(parser.parse_args().folder)
    sys.stdout.write(f"{len(files)} recordings, {sum(file.stat().st_size for file in files) / 1e6:.1f} MB\n")
