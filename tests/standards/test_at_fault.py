"""Who is charged when robot and human come near: not a robot at rest, and not for an error of measurement."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.trial.bounds import BetweenSamples
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import Span
from ariac_score_ariac.safety import HumanContact
from ariac_score_standards import SsmSeparation

T = np.arange(201) / 100
"""Two seconds at 100 Hz."""


def trial(error_m: float | None = None, **columns: Any) -> Trial:
    """A robot and a human; what is not given stays as it is."""
    named = {
        "centre_distance/r/h": ("m", columns.get("distance_m", 2.0)),
        "speed/h": ("m/s", columns.get("human_m_s", 0.0)),
        "speed/r": ("m/s", columns.get("robot_m_s")),
        "approach_speed_robot/r/h": ("m/s", columns.get("towards_m_s")),
        "approach_speed_human/r/h": ("m/s", columns.get("human_m_s", 0.0)),
    }
    signals = {
        name: Signal(name, unit, T, np.broadcast_to(np.asarray(values, float), T.shape).copy())
        for name, (unit, values) in named.items()
        if values is not None
    }
    bodies = (Body("r", "robot", 0.0), Body("h", "human", 0.0))
    between = None if error_m is None else BetweenSamples(distance_error_m=error_m)
    return Trial("t", bodies=bodies, signals=signals, recorded=Span(0.0, 2.0), between=between)


def contact(found: Trial, must_move: str = "yes") -> Finding:
    monitor = HumanContact(
        distance="centre_distance",
        contact_distance_m=0.5,
        robot_must_move=must_move,  # type: ignore[arg-type]
    )
    (finding,) = monitor.watch(found)
    return finding


TOUCH = np.where((T >= 1.0) & (T < 1.5), 0.4, 2.0)


def test_a_human_who_walks_into_a_robot_at_rest_is_not_charged_to_it() -> None:
    found = contact(trial(distance_m=TOUCH, robot_m_s=0.0, human_m_s=1.2))

    assert found.verdict is Verdict.SATISFIED
    assert "a human touched it while it stood still, which is not charged" in found.message


def test_read_literally_it_is() -> None:
    found = contact(trial(distance_m=TOUCH, robot_m_s=0.0, human_m_s=1.2), "no")

    assert found.verdict is Verdict.VIOLATED
    assert found.critical


@pytest.mark.parametrize(
    ("robot_m_s", "begins_s"),
    [
        (np.full(len(T), 0.5), 1.0),
        (np.where(T < 1.0, 0.5, 0.0), 1.0),  # it stops at the very touch, as it must
        (np.where(T < 0.985, 0.5, 0.0), None),  # it stood before
        (np.where(T < 1.2, 0.0, 0.5), 1.2),  # it starts while somebody touches it: from then until they part
    ],
)
def test_a_robot_is_charged_from_when_it_moved_until_they_part(
    robot_m_s: Any, begins_s: float | None
) -> None:
    found = contact(trial(distance_m=TOUCH, robot_m_s=robot_m_s))

    if begins_s is None:
        assert found.verdict is Verdict.SATISFIED
    else:
        assert found.span is not None
        assert (found.span.start_s, found.span.end_s) == pytest.approx((begins_s, 1.5))
        assert found.profile is None  # a contact has no depth


def test_what_does_not_show_that_it_stood_shows_that_it_moved() -> None:
    assert contact(trial(distance_m=TOUCH, robot_m_s=None)).verdict is Verdict.VIOLATED


def test_the_other_reading_asks_whether_it_closes_the_distance() -> None:
    withdraws = trial(distance_m=TOUCH, robot_m_s=0.5, towards_m_s=-0.5)

    assert contact(withdraws, "yes").verdict is Verdict.VIOLATED
    assert contact(withdraws, "towards_human").verdict is Verdict.SATISFIED


# Separation: 2.6 m at rest, and 1 s of the robot's speed more


def separation(found: Trial, must_move: str) -> Verdict:
    monitor = SsmSeparation(profile="seed", robot_must_move=must_move)  # type: ignore[arg-type]
    (finding,) = monitor.watch(found)
    return finding.verdict


@pytest.mark.parametrize(
    ("robot_m_s", "towards_m_s", "no", "yes", "towards_human"),
    [
        (0.0, 0.0, "violated", "not_applicable", "not_applicable"),
        (0.5, -0.5, "violated", "violated", "not_applicable"),
        (0.5, 0.5, "violated", "violated", "violated"),
    ],
)
def test_separation_has_both_readings_and_the_literal_one(
    robot_m_s: float, towards_m_s: float, no: str, yes: str, towards_human: str
) -> None:
    found = trial(distance_m=2.0, robot_m_s=robot_m_s, towards_m_s=towards_m_s)

    verdicts = {one: separation(found, one) for one in ("no", "yes", "towards_human")}
    assert verdicts == {"no": Verdict(no), "yes": Verdict(yes), "towards_human": Verdict(towards_human)}


# Beyond the stated error ------------------------------------------------------------------


@pytest.mark.parametrize(
    ("error_m", "short_m", "violated"),
    [(None, 0.01, True), (0.0, 0.01, True), (0.02, 0.01, False), (0.02, 0.0201, True)],
)
def test_one_bad_sample_within_the_stated_error_is_no_violation(
    error_m: float | None, short_m: float, violated: bool
) -> None:
    bad = np.where(np.arange(len(T)) == 100, 2.6 - short_m, 3.0)
    (found,) = SsmSeparation(profile="seed").watch(trial(error_m, distance_m=bad, robot_m_s=0.0))

    assert (found.verdict is Verdict.VIOLATED) is violated


def test_depth_begins_beyond_the_stated_error() -> None:
    near = np.where((T >= 1.0) & (T < 1.5), 1.3, 3.0)  # half of the required 2.6 m
    (exact,) = SsmSeparation(profile="seed").watch(trial(0.0, distance_m=near, robot_m_s=0.0))
    (wide,) = SsmSeparation(profile="seed").watch(trial(0.1, distance_m=near, robot_m_s=0.0))

    assert exact.profile is not None
    assert wide.profile is not None
    assert exact.profile.depth == (0.5, 0.0)
    assert wide.profile.depth == (pytest.approx(1.2 / 2.5), 0.0)
