"""Every monitor in one rule set, over a log as a recorder writes it, by the command."""

from __future__ import annotations

from decimal import Decimal
from importlib.metadata import entry_points
from pathlib import Path

import numpy as np
import pytest

from ariac_score import Body, Event, Signal, Span, Trial, load_result
from ariac_score.cli import main
from ariac_score.testing import write_trial_log
from ariac_score_ariac.work import Order, Task

T = np.arange(1001) / 100
BODIES = (
    Body("agv1", "agv", 0.4),
    Body("gantry", "robot", 0.3),
    Body("kitting", "robot", 0.3),
    Body("person_1", "human", 0.3),
)
MONITORS = {
    "separation": "{use: iso_ts_15066.ssm_separation, with: {profile: standard}}",
    "speed_cap": "{use: iso_ts_15066.ssm_speed_cap, with: {profile: standard}}",
    "response": "{use: iso_ts_15066.ssm_response, with: {profile: standard}}",
    "contact": "{use: iso_10218_2.pfl_contact, with: {region: hand}}",
    "contact_speed": "{use: iso_10218_2.pfl_speed, with: {region: chest, when: near}}",
    "standstill": "{use: iso_10218_2.monitored_standstill, with: {workspace: [[0, 0], [2, 0], [2, 2]]}}",
    "guiding": "{use: iso_10218_2.hand_guiding, with: {applies: manual_mode}}",
    "reduced": "{use: iso_10218_1.reduced_speed, with: {applies: manual_mode}}",
    "space": "{use: iso_10218_1.space_limit, with: {box_low_m: [-9, -9], box_high_m: [9, 9]}}",
    "stops": "{use: iec_60204_1.stop_performance}",
    "restart": "{use: iso_13850.estop_restart}",
    "safeguard": (
        "{use: iso_13855.safeguard_distance, with: {line: [[-3, -9], [-3, 9]], "
        "hazard: [[-1, -1], [1, -1], [1, 1], [-1, 1]]}}"
    ),
    "truck_speed": "{use: iso_3691_4.agv_speed_clearance}",
    "truck_field": "{use: iso_3691_4.agv_protective_field}",
    "crush": "{use: iso_13854.crush_gap}",
    "collisions": "{use: ariac.collision_episodes}",
    "pose": "{use: iso_9283.pose_performance, with: {commanded_m: [0, 0, 0]}}",
    "comfort": "{use: proxemics.proximity_comfort}",
    "coverage": "{use: log.signal_coverage, with: {quantities: [position, speed]}}",
    "formula": "{use: formula.always, with: {holds: v <= 9, signals: {v: 'speed/{robot}'}, unit: m/s}}",
}


def moving_trial() -> Trial:
    """The gantry oscillates by its place, the person passes at 3 m, nothing else moves."""
    zero = 0 * T
    gantry = np.stack([0.2 * np.sin(T), zero, zero], axis=1)
    person = np.stack([-5 + T, zero - 3.0, zero], axis=1)
    columns = {
        "position/gantry": ("m", gantry),
        "position/kitting": ("m", np.stack([zero, zero + 5, zero], axis=1)),
        "position/person_1": ("m", person),
        "position/agv1": ("m", np.stack([zero + 6, zero + 6, zero], axis=1)),
        "clearance/agv1": ("m", zero + 1.0),
    }
    for robot in ("gantry", "kitting"):
        columns[f"contact_force/{robot}/person_1"] = ("N", zero)
        columns[f"crush_gap/{robot}/person_1"] = ("m", zero + 1.0)
        columns[f"enabling_device/{robot}"] = ("1", zero)
    events = [
        Event(0.0, "competition_started"),
        Event(5.0, "pose_attained", "gantry"),
        Event(6.0, "pose_attained", "kitting"),
        Event(7.0, "manual_mode", "gantry", "on"),
        Event(7.5, "manual_mode", "gantry", "off"),
        Event(10.0, "competition_ended"),
    ]
    return Trial(
        "t",
        work=(Order("order_0", (Task("order_0_shipment_0"),), 0.0),),
        bodies=BODIES,
        signals={name: Signal(name, unit, T, values) for name, (unit, values) in columns.items()},
        events=tuple(events),
        witnessed=frozenset(
            {"bodies", "submissions", "emergency_stop", "protective_stop", "manual_mode", "in_contact"}
        ),
        recorded=Span(0.0, 10.0),
    )


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    lines = ["id: all", "title: every monitor", "source: a test", "log_map: ariac2020", "monitors:"]
    lines += [f"  {name}: {text}" for name, text in MONITORS.items()]
    lines += ["score: count(separation) + measure(collisions, occurrences)", ""]
    file = tmp_path / "all.yaml"
    file.write_text("\n".join(lines), encoding="utf-8")
    return file


def scored(tmp_path: Path, rules: Path, trial: Trial) -> dict[str, dict[str, str]]:
    """Verdict by check and subject of what the command says."""
    log, result = write_trial_log(tmp_path / "trial.jsonl", trial), tmp_path / "result.json"
    command = ["score", str(log), "--rules", str(rules), "--output-format", "json", "-o", str(result)]
    assert main(command) in (0, 1, 6)
    found: dict[str, dict[str, str]] = {}
    for name, finding in load_result(result).measured.findings.items():
        found.setdefault(name.partition("#")[0], {})[finding.subject] = finding.verdict.value
    return found


def test_every_monitor_decides_a_log_that_has_everything(tmp_path: Path, rules: Path) -> None:
    found = scored(tmp_path, rules, moving_trial())

    assert set(found) == set(MONITORS)
    undecided = {n: who for n, who in found.items() if "inconclusive" in who.values()}
    assert undecided == {}
    assert found["separation"]["gantry/person_1"] in ("satisfied", "violated")
    pairs = ("gantry/agv1", "gantry/kitting", "kitting/agv1")
    assert found["collisions"] == dict.fromkeys(pairs, "satisfied")
    assert found["truck_field"] == {"agv1/person_1": "not_applicable"}
    assert found["reduced"]["kitting"] == "not_applicable"


def test_without_positions_nothing_that_needs_them_is_satisfied(tmp_path: Path, rules: Path) -> None:
    trial = moving_trial()
    kept = {n: s for n, s in trial.signals.items() if not n.startswith("position/")}
    found = scored(tmp_path, rules, Trial(**{**vars(trial), "signals": kept}))

    for name in ("separation", "speed_cap", "response", "contact_speed", "standstill", "space", "comfort"):
        assert set(found[name].values()) == {"inconclusive"}, name


@pytest.mark.slow
def test_the_example_is_scored_with_every_monitor_and_its_score_stays(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    examples = Path(__file__).parents[2] / "examples"
    stored = tmp_path / "result.json"
    rules = str(examples / "all_monitors.yaml")

    assert main(["score", str(examples / "kitting_near_miss.mcap"), "--rules", rules, "-o", str(stored)]) == 0
    assert load_result(stored).score == Decimal("19.761677")
    measured = load_result(stored).measured
    ours, yaml = (next(iter(measured.of(name).values())) for name in ("separation", "d_min_in_yaml"))
    assert (ours.span, ours.robustness) == (yaml.span, yaml.robustness)
    used = {check["use"] for check in load_result(stored).checks.values()}
    assert {use for use in SHIPPED_MONITORS if use not in used} == set()


SHIPPED_MONITORS = {
    point.name
    for point in entry_points(group="ariac_score.monitors")
    if point.value.startswith("ariac_score_standards")
    and point.name not in ("formula.never", "formula.within")
}
