"""The adversary on an honest trial of every shipped rule set: python benchmarks/redteam.py [--only NAME …].

Writes the table of `docs/redteam.md`, between its two marks. The trials are made: each edition's own orders
and states, submissions and events in our recorder's messages, what moves as that edition shows it. Rules that
take a record, such as an official text, get the record beside the recording, and the recording is doctored.
"""

from __future__ import annotations

import argparse
import json
import sqlite3
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import get_args

import numpy as np

from ariac_score import (
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    ORDER_ANNOUNCED,
    Pose,
    Trial,
    load_rule_set,
    score_trial,
)
from ariac_score.errors import ScoreError
from ariac_score.redteam.honest import Honest, honest_log
from ariac_score.redteam.search import Standing, search
from ariac_score.results.cohort_file import cohort_text, contributed, make_cohort
from ariac_score.scoring.ruleset import rule_set_names
from ariac_score.testing import Recorded, write_bag
from ariac_score.testing.recordings import stamp_ns
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.official_database import TABLES_2025
from ariac_score_ariac.testing.official_texts import Outcome, PlannedOrder, trial_log_text
from ariac_score_ariac.testing.recordings import recorded_messages
from ariac_score_ariac.work import KitSubmission, Product, Tray

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs/redteam.md"
BEGIN, END = "<!-- written by benchmarks/redteam.py -->\n", "<!-- end of the table -->\n"
BUDGET = 60

WATCHED = [
    "agv_collision",
    "arm_collision",
    "cell_in_conveyor_bin",
    "cell_in_inspection_bin",
    "human_collision",
    "object_on_invalid_surface",
    "obstacle_collision",
    "part_dropped",
    "robot_collision",
    "self_collision",
    "submissions",
]
"""Kinds of events that the recorder looks out for."""


@dataclass(frozen=True)
class Tried:
    """One row.

    Attributes:
        rules: The rule set.
        log: What was doctored, in words.
        tries: How often.
        exploits: What worked, by standing.
        why_not: Why nothing was tried.
    """

    rules: str
    log: str = ""
    tries: int = 0
    exploits: tuple[tuple[str, str, str], ...] = ()
    why_not: str = ""


# Honest trials --------------------------------------------------------------------------------


def made_trial(*submissions: KitSubmission) -> Trial:
    """Forty seconds with one near miss; everything that can happen is watched for."""
    trial = kitting_trial()
    return replace(
        trial,
        submissions=submissions or trial.submissions,
        witnessed=trial.witnessed | set(WATCHED),
    )


def nearer(trial: Trial, by_m: float) -> Trial:
    """The trial in which the human walks so much nearer to where the robot is then."""
    human, robot = trial.signals["position/human"], trial.signals["position/robot"]
    apart = robot.values - human.values
    nearest = int(np.argmin(np.linalg.norm(apart, axis=1)))
    step = by_m * apart[nearest] / np.linalg.norm(apart[nearest])
    return replace(
        trial, signals={**trial.signals, "position/human": replace(human, values=human.values + step)}
    )


def without_orders(trial: Trial, *, motion: str = "snapshot") -> list[Recorded]:
    """The messages of a trial whose orders come otherwise."""
    return recorded_messages(replace(trial, work=()), motion=motion)  # type: ignore[arg-type]


def told(t_s: float, kind: str, subject: str = "") -> Recorded:
    """An event as our recorder publishes it."""
    fields = {"kind": kind, "subject": subject, "detail": ""}
    return Recorded("/ariac_score/events", "ariac_score_msgs/msg/TrialEvent", stamp_ns(t_s), fields)


def bag(folder: Path, messages: list[Recorded], *, ros1: bool) -> Path:
    folder.mkdir(parents=True)
    in_order = sorted(messages, key=lambda message: message.t_ns)
    write_bag(folder / ("run.bag" if ros1 else "run.mcap"), in_order, storage="ros1" if ros1 else "mcap")
    return folder


SENSORS = {
    "ariac2023": "sensors:\n  sensor_1: {type: rgb_camera, visualize_fov: false, pose: POSE}\n",
    "ariac2024": "static_sensors:\n  sensor_1: {type: rgb_camera, visualize_fov: false, pose: POSE}\n",
    "ariac2025": "",  # the database says what they cost
}
TEAM = "sensors:\n  sensor_1: {type: logical_camera, pose: POSE}\n"
"""Of 2017 to 2022."""


def kits_of_2020(folder: Path, *, motion: str = "snapshot", shipments: str = "nist_gear/msg/Order") -> Path:
    """Two kits, one part of the wrong colour, one out of its place; 2017 to 2020."""
    messages = recorded_messages(made_trial(), motion=motion)  # type: ignore[arg-type]
    if shipments != "nist_gear/msg/Order":  # the boxes of 2018 go to no AGV
        messages = [_boxed(m, shipments) if m.topic == "/ariac/orders" else m for m in messages]
    return bag(folder, messages, ros1=motion != "human_state")


def _boxed(message: Recorded, type_: str) -> Recorded:
    boxes = [{k: v for k, v in s.items() if k != "agv_id"} for s in message.fields["shipments"]]
    return replace(message, type=type_, fields={**message.fields, "shipments": boxes})


KIT_AND_ASSEMBLY = """\
options: {gazebo_state_logging: true}
time_limit: -1
orders:
  order_0:
    priority: 1
    announcement_condition: time
    announcement_condition_value: 0.5
    kitting:
      shipment_count: 1
      TRAYSagvs: [agv2]
      destinations: [as2]
      products:
        part_0: {type: assembly_battery_blue, pose: {xyz: [0.1, 0.1, 0.0], rpy: [0.0, 0.0, 0.0]}}
        part_1: {type: assembly_pump_red, pose: {xyz: [-0.1, 0.1, 0.0], rpy: [0.0, 0.0, 0.0]}}
  order_1:
    priority: 3
    announcement_condition: time
    announcement_condition_value: 7.5
    assembly:
      shipment_count: 1
      stations: [as2]
      products:
        part_0: {type: assembly_sensor_green, pose: {xyz: [0.1, 0.1, 0.0], rpy: [0.0, 0.0, 0.0]}}
"""
"""Times are since the start of the competition, 0.5 s."""


def gear(folder: Path, *, trays: bool) -> Path:
    """A kit with a part of the wrong colour, and an assembly; 2021, and on movable trays 2022."""
    oak = Tray("movable_tray_dark_wood", Pose((0.0, 0.0, 0.0))) if trays else None
    kit = (
        Product("assembly_battery_blue", Pose((0.1, 0.1, 0.0))),
        Product("assembly_pump_blue", Pose((-0.1, 0.1, 0.0))),
    )
    inserted = (Product("assembly_sensor_green", Pose((0.1, 0.1, 0.0))),)
    # Announced by the recorder: the orders themselves are the organiser's.
    announced = [told(1.0, ORDER_ANNOUNCED, "order_0"), told(8.0, ORDER_ANNOUNCED, "order_1")]
    trial = made_trial(
        KitSubmission("order_0_kitting_shipment_0", 14.0, kit, "agv2", "as2", oak),
        KitSubmission("order_1_assembly_shipment_0", 31.0, inserted, station="as2"),
    )
    made = bag(folder, [*without_orders(trial), *announced], ros1=True)
    text = KIT_AND_ASSEMBLY.replace("TRAYS", "trays: [movable_tray_dark_wood]\n      " if trays else "")
    (made / "trial.yaml").write_text(text, encoding="utf-8")
    return made


PLACES = {1: (-0.1, 0.1), 2: (0.1, 0.1), 3: (-0.1, -0.1), 4: (0.1, -0.1)}
BATTERY, PUMP, SENSOR, RED, GREEN, BLUE = 10, 11, 12, 0, 1, 2


def quadrants(folder: Path, *, motion: str) -> Path:
    """A kit with a part of the wrong colour and an assembly, announced as in 2023 and 2024."""
    tray = Tray("kit_tray_03", Pose((0.0, 0.0, 0.0)))
    kit = tuple(
        Product(kind, Pose((*PLACES[quadrant], 0.0)))
        for kind, quadrant in (("battery_red", 1), ("pump_red", 3))
    )
    inserted = (Product("battery_red", Pose((0.1, 0.0, 0.0))),)
    trial = made_trial(
        KitSubmission("HIGH0001", 14.0, kit, "agv2", "warehouse", tray),
        KitSubmission("ASMB0001", 31.0, inserted, station="as2", tray=Tray("assembly_insert_2")),
    )
    messages = without_orders(nearer(trial, NEARER_M), motion=motion)
    messages = [m for m in messages if m.topic != "/ariac/competition_state"]
    still = [*_far_away("floor_base_link")] if motion == "frames" else []
    return bag(folder, [*messages, *still, *_announced(), *_numbered_states()], ros1=False)


NEARER_M = 1.3
"""From 2023 on less distance is asked for."""


def _far_away(frame: str) -> Iterator[Recorded]:
    """A robot that stands 20 m away, at 100 Hz."""
    turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    for tick in range(4001):
        t_ns = stamp_ns(tick / 100)
        stamp = {"sec": t_ns // 10**9, "nanosec": t_ns % 10**9}
        transform = {
            "header": {"stamp": stamp, "frame_id": "world"},
            "child_frame_id": frame,
            "transform": {"translation": {"x": 20.0, "y": 0.0, "z": 0.0}, "rotation": turn},
        }
        yield Recorded("/tf", "tf2_msgs/msg/TFMessage", t_ns, {"transforms": [transform]})


def _announced() -> Iterator[Recorded]:
    parts = [
        {"part": {"type": BATTERY, "color": RED}, "quadrant": 1},
        {"part": {"type": PUMP, "color": GREEN}, "quadrant": 3},
    ]
    kit = {"agv_number": 2, "tray_id": 3, "destination": 3, "parts": parts}
    turn = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}
    placed = {"pose": {"position": {"x": 0.1, "y": 0.0, "z": 0.0}, "orientation": turn}}
    assembly = {"station": 2, "parts": [{"part": {"type": BATTERY, "color": RED}, "assembled_pose": placed}]}
    for t_s, id_, kind, task in ((1.0, "HIGH0001", 0, kit), (8.0, "ASMB0001", 1, assembly)):
        name = ("kitting_task", "assembly_task")[kind]
        fields = {"id": id_, "type": kind, "priority": id_.startswith("HIGH"), name: task}
        yield Recorded("/ariac/orders", "ariac_msgs/msg/Order", stamp_ns(t_s), fields)


def _numbered_states() -> Iterator[Recorded]:
    for t_s, state in ((0.0, 1), (0.5, 3), (38.0, 4)):
        type_ = "ariac_msgs/msg/CompetitionState"
        yield Recorded("/ariac/competition_state", type_, stamp_ns(t_s), {"competition_state": state})


def run_of_2025(folder: Path) -> Path:
    """The organiser's database of one run with a collision, and a recording of what moved."""
    trial = nearer(made_trial(), NEARER_M)
    messages = [
        *without_orders(trial, motion="frames"),
        told(0.5, COMPETITION_STARTED),
        told(38.0, COMPETITION_ENDED),
    ]
    unknown = ("/ariac/competition_state", "/ariac_score/submissions")
    made = bag(folder, [m for m in messages if m.topic not in unknown], ros1=False)
    database = sqlite3.connect(made / "results.db")
    database.executescript(TABLES_2025)
    database.execute("INSERT INTO Competitor VALUES (1, 'ours')")
    database.execute("INSERT INTO Trial VALUES (1, 'TRIAL001', '0', 1, 900.0, 2, 1, 1)")
    database.execute("INSERT INTO Run VALUES (1, 1, 1, 1, 0, 7400.0, 36.0, 40, 3, 2.5, 40, 39, 2)")
    for number, (done_s, announced_s, kind) in enumerate(
        ((10.0, 0.0, 1), (20.0, 0.0, 1), (30.0, 0.0, 2), (34.0, 12.0, 3)), 1
    ):
        database.execute(
            "INSERT INTO OrderSubmission VALUES (?, 1, ?, ?, 900.0, ?)", (number, done_s, announced_s, kind)
        )
    database.execute("INSERT INTO Penalty VALUES (1, 1, 4, 'robot collision', 19.5)")
    database.commit()
    database.close()
    return made


def with_team(made: Path, edition: str) -> None:
    if text := SENSORS.get(edition, TEAM).replace("POSE", "{xyz: [0, 0, 1], rpy: [0, 0, 0]}"):
        (made / "team.yaml").write_text(text, encoding="utf-8")


HUMAN = """\
id: ours
title: With a human, which this edition has not
source: this benchmark
extends: EDITION
frames:
  - {match: torso_base, kind: robot, body: ceiling_robot}
  - {match: human_base, kind: human, body: human}
"""
WITH_HUMAN = ("ariac2024.safe", "ariac2025.safe")


def _text_of_2024() -> str:
    orders = (
        PlannedOrder("HIGH0001", "kitting", True, (("battery", "red"), ("pump", "green"))),
        PlannedOrder("ASMB0001", "assembly", False, (("battery", "red"),)),
    )
    return trial_log_text("run", orders, (Outcome(("", ""), 13.0, False), Outcome(("",), 23.0, True)))


def _text_of_2020() -> str:
    return (ROOT / "tests/data/performance_2020.log").read_text(encoding="utf-8")


TEXTS: Mapping[str, tuple[str, Callable[[], str]]] = {
    "ariac2019.official": ("performance.log", _text_of_2020),
    "ariac2020.official": ("performance.log", _text_of_2020),
    "ariac2024.official": ("trial_log.txt", _text_of_2024),
}
"""Official texts that stand beside the recording."""

_TEXT_ALONE = "the official text alone is priced, which the organiser has; nothing of a recording enters"
WHY_NOT = {
    **{f"ariac{year}.official": _TEXT_ALONE for year in (2017, 2018, 2021, 2022, 2023, 2025)},
    "aic2026.finals_force": "no recording of the finals is made here",
    "aic2026.finals_force_by_marks": "no recording of the finals is made here",
}


def example_of_aic(_: Path) -> Path:
    return ROOT / "examples/aic/run"


@dataclass(frozen=True)
class Kind:
    """An honest trial for some rule sets."""

    says: str
    make: Callable[[Path], Path]
    log_map: str = ""


TWO_KITS = "two kits"
KINDS: Mapping[str, Kind] = {
    "aic2026": Kind("the example, a cable that is inserted", example_of_aic),
    "ariac2017": Kind(TWO_KITS, kits_of_2020),
    "ariac2018": Kind(TWO_KITS, lambda folder: kits_of_2020(folder, shipments="osrf_gear/msg/Order")),
    "ariac2019": Kind(TWO_KITS, kits_of_2020),
    "ariac2020": Kind(TWO_KITS, kits_of_2020),
    "ariac2021": Kind("a kit and an assembly", lambda folder: gear(folder, trays=False)),
    "ariac2022": Kind("a kit and an assembly", lambda folder: gear(folder, trays=True)),
    "ariac2023": Kind(
        "a kit and an assembly, a person near", lambda folder: quadrants(folder, motion="human_state")
    ),
    "ariac2024": Kind("a kit and an assembly", lambda folder: quadrants(folder, motion="frames")),
    "ariac2025": Kind("the database of a run, and a recording", run_of_2025),
    "paper2020": Kind("two kits, a near miss", kits_of_2020),
    "paper2020.human_state": Kind(
        "two kits, a near miss", lambda folder: kits_of_2020(folder, motion="human_state")
    ),
    "safety": Kind("a near miss", kits_of_2020, log_map="ariac2020"),
}


def kind_of(rules: str) -> Kind:
    return KINDS.get(rules) or KINDS[rules.partition(".")[0]]


def honest_of(rules: str, folder: Path) -> Honest:
    """The honest trial of a rule set, with a team's sensors, and a cohort of its own where one is asked for.

    Raises:
        ScoreError: There is no score that another could exceed.
    """
    kind = kind_of(rules)
    made = kind.make(folder / "run")
    if not rules.startswith("aic"):
        with_team(made, rules.partition(".")[0])
    if rules in TEXTS:
        (made / TEXTS[rules][0]).write_text(TEXTS[rules][1](), encoding="utf-8")
    log_map = kind.log_map
    if rules in WITH_HUMAN:
        log_map = str(folder / "human.yaml")
        text = HUMAN.replace("EDITION", rules.partition(".")[0])
        Path(log_map).write_text(text, encoding="utf-8")
    rule_set = load_rule_set(rules)
    cohort = None
    if rule_set.sheet.cohort:
        result = score_trial(made, rule_set, log_map=log_map)
        values = make_cohort(rule_set, {result.measured.trial: [contributed(result.measured, rule_set)]})
        cohort = folder / "cohort.json"
        cohort.write_text(cohort_text(values), encoding="utf-8")
    return honest_log(made, rule_set, log_map=log_map, cohort=cohort)


# The table ------------------------------------------------------------------------------------


def tried(rules: str, budget: int) -> Tried:
    """What the adversary finds under one rule set."""
    with TemporaryDirectory() as folder:
        try:
            honest = honest_of(rules, Path(folder))
        except ScoreError as error:
            return Tried(rules, why_not=WHY_NOT.get(rules, str(error).split(": ", 1)[-1]))
        found = search(honest, budget=budget)
        works = tuple((one.standing, one.tactic.name, one.says) for one in found.exploits)
        return Tried(rules, kind_of(rules).says, found.tried, works)


def table(rows: Sequence[Tried]) -> str:
    """The rows as Markdown; rule sets that fare alike share one."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for row in rows:
        alike.setdefault(_cells(row), []).append(f"`{row.rules}`")
    names = ("rule sets", "tried on", "tries each", "EXPLOIT", "DECLARED", "INHERENT", "BELIEVED")
    head = f"| {' | '.join(names)} |\n|---|---|---:|---|---|---|---|\n"
    lines = (f"| {', '.join(rules)} | {' | '.join(cells)} |\n" for cells, rules in alike.items())
    return head + "".join(lines)


def _cells(row: Tried) -> tuple[str, ...]:
    if row.why_not:
        return ("", "", *[""] * 3, f"not tried: {row.why_not}")
    by = {
        standing: sorted({tactic for one, tactic, _ in row.exploits if one == standing})
        for standing in get_args(Standing)
    }
    return (row.log, str(row.tries), *(", ".join(by[one]) for one in get_args(Standing)))


def main() -> None:
    """Walk the rule sets, say what is found, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="*", default=[], metavar="NAME", help="these alone")
    parser.add_argument("--budget", type=int, default=BUDGET, help="tries for each; default: %(default)s")
    parser.add_argument("--rows", type=Path, help="where rows are kept, so that it can go on; JSON")
    parser.add_argument("--table", action="store_true", help="write the table of all rows into the page")
    arguments = parser.parse_args()
    kept = Path(arguments.rows) if arguments.rows else None
    rows = _kept(kept)
    for rules in arguments.only or rule_set_names():
        if rules not in rows:
            begin = time.monotonic()
            row = rows[rules] = tried(rules, arguments.budget)
            print(f"{rules}: {row.tries} tries in {time.monotonic() - begin:.0f} s {row.why_not}", flush=True)
            for standing, tactic, says in row.exploits:
                print(f"    {standing:9} {tactic}: {says}", flush=True)
            if kept:
                kept.write_text(json.dumps([asdict(one) for one in rows.values()], indent=1), "utf-8")
    if arguments.table:
        before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
        _, _, after = rest.partition(END)
        PAGE.write_text(f"{before}{BEGIN}{table(sorted(rows.values(), key=_name))}{END}{after}", "utf-8")
    sys.exit(any(standing == "exploit" for row in rows.values() for standing, _, _ in row.exploits))


def _name(row: Tried) -> str:
    return row.rules


def _kept(file: Path | None) -> dict[str, Tried]:
    if file is None or not file.exists():
        return {}
    found = [Tried(**row) for row in json.loads(file.read_text(encoding="utf-8"))]
    return {row.rules: replace(row, exploits=tuple(tuple(one) for one in row.exploits)) for row in found}


if __name__ == "__main__":
    main()
