"""The monitor `workshop.calm_robot` keeps its contract, and says what it should."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import workshop_calm_robot
from workshop_calm_robot import CalmRobot

from ariac_score import Body, Signal, Span, Trial, Verdict, score_trial
from ariac_score.testing import (
    SNAPSHOT_SIGNALS,
    ContractCheck,
    contract_checks,
    example_trial,
    made_trial,
    write_trial_log,
)

RULES = Path(workshop_calm_robot.__file__).with_name("workshop_calm_robot.yaml")
BODIES = (Body("gantry", "robot"), Body("ann", "human"))


def meeting(distance_m: float, speed_m_s: float) -> Trial:
    """A robot that passes a human at one distance with one speed."""
    t = np.arange(101) * 0.01
    distance = Signal("centre_distance/gantry/ann", "m", t, np.full(101, distance_m))
    speed = Signal("speed/gantry", "m/s", t, np.full(101, speed_m_s))
    return Trial("t", bodies=BODIES, signals={s.name: s for s in (distance, speed)}, recorded=Span(0.0, 1.0))


@pytest.mark.parametrize("check", contract_checks(CalmRobot(), made_trial()))
def test_keeps_the_contract_of_a_monitor(check: ContractCheck) -> None:
    check()


@pytest.mark.parametrize(
    ("distance_m", "speed_m_s", "verdict"),
    [
        (1.0, 0.25, Verdict.SATISFIED),
        (1.0, float(np.nextafter(0.25, 1.0)), Verdict.VIOLATED),
        (5.0, 0.5, Verdict.NOT_APPLICABLE),
        (float(np.nextafter(5.0, 0.0)), 0.5, Verdict.VIOLATED),
    ],
)
def test_only_who_is_both_near_and_fast_breaks_the_rule(
    distance_m: float, speed_m_s: float, verdict: Verdict
) -> None:
    (finding,) = CalmRobot().watch(meeting(distance_m, speed_m_s))

    assert finding.verdict is verdict


def test_it_costs_two_points_of_the_example(tmp_path: Path) -> None:
    log = write_trial_log(tmp_path / "trial.jsonl", example_trial("paper2020"), signals=SNAPSHOT_SIGNALS)

    # Its task is worth 28, and the two come near once, at 0.5 m/s.
    assert score_trial(log, RULES, local_plugins=True).score == 26
