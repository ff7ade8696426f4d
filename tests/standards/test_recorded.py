"""d_min on what was really recorded: the declarative formula, the seed profile, and a count by hand.

No public recording has a human in it. Two have bodies that move beside each other, to whom a log map
gives the parts: a turtle that follows another (tf of turtlesim), and the robots of the NIST team in
ARIAC 2022, the gantry as the robot and the kitting robot in the place of a human.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score import Finding, Verdict, score_trial
from ariac_score.checks.registry import Registry
from ariac_score.engine.read import find_trial, read_trial
from ariac_score.logs.logmap import load_log_map
from ariac_score.results.result import Result
from ariac_score.scoring.expression import Expression, add_up
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import align
from ariac_score_standards import SsmSeparation
from ariac_score_standards.formula import judge_columns

SHARED = Path(__file__).parents[2].parent / "shared"
VIOLATED, INCONCLUSIVE = Verdict.VIOLATED, Verdict.INCONCLUSIVE

TURTLES = """
channels: [{topic: /tf, poses: frames}]
frames:
  - {match: turtle2, kind: robot, body: robot}
  - {match: turtle1, kind: human, body: human}
"""
ROBOTS = """
models:
  - {match: gantry, kind: robot, links: ["torso_base", "gantry_arm_*"]}
  - {match: kitting, kind: human, links: ["kitting_arm_*"]}
"""


@dataclass(frozen=True)
class Recording:
    """A real recording, and who plays which part in it."""

    file: str
    roles: str

    def scored(self, folder: Path, *, profile: str = "seed", **numbers: float) -> Result:
        """Under both monitors, with the same numbers."""
        log = SHARED / self.file
        if not log.is_file():
            pytest.skip("the folder of official material (../shared) is not here")
        given = {"t1": 1.0, "t2": 1.5, "B": 0.0, "delta": 2.6, **numbers}
        (folder / "map.yaml").write_text(
            f"id: real\ntitle: a real recording\nsource: a test\nbodies: {{}}\n{self.roles}", encoding="utf-8"
        )
        (folder / "rules.yaml").write_text(
            RULES.format(profile=profile, **given, text=FORMULA), encoding="utf-8"
        )
        return score_trial(log, str(folder / "rules.yaml"))

    def trial(self, folder: Path) -> Trial:
        """With the signals of the seed profile."""
        registry, log_map = Registry(), load_log_map("map.yaml", beside=folder)
        bundle, readers = find_trial(SHARED / self.file, registry)
        read = read_trial(bundle, readers, log_map, registry, quantities=["position"], work=False)
        wanted = [Derivation(need.quantity, need.max_gap_s) for need in SsmSeparation().needs()]
        return derive_signals(read, wanted, speed_window_s=log_map.speed_window_s)


FORMULA = "distance >= k_H * (t1 + t2) + k_R * t1 + B + delta"
RULES = """
id: real
title: d_min on a real recording
source: Ferrando et al.
log_map: map.yaml
window: recording
monitors:
  separation:
    use: iso_ts_15066.ssm_separation
    with: {{profile: {profile}, t1_s: {t1}, t2_s: {t2}, stopping_distance_m: {B}, delta_m: {delta}}}
  formula:
    use: formula.always
    with:
      holds: {text}
      signals:
        {{distance: "centre_distance/{{robot}}/{{human}}", k_H: "speed/{{human}}", k_R: "speed/{{robot}}"}}
      parameters: {{t1: {t1}, t2: {t2}, B: {B}, delta: {delta}}}
      unit: m
score: "1"
"""
TURTLE_BAG = Recording("bags/ros1/rosbagjs_example.bag", TURTLES)
NIST_LOG = Recording("bags/gazebo/ariac2022_kitting_state.log", ROBOTS)

both = pytest.mark.parametrize("recording", [TURTLE_BAG, NIST_LOG], ids=["turtles", "nist_2022"])


def facts_of(result: Result, check: str) -> list[tuple[Any, ...]]:
    """What a check says of a recording, without its words."""
    found = result.measured.of(check).values()
    facts = [
        (f.subject, f.span, f.verdict, f.robustness, f.unit, dict(f.quantities), _evidence(f)) for f in found
    ]
    return sorted(facts, key=lambda each: (each[0], each[1].start_s, each[2].value))


def _evidence(finding: Finding) -> list[tuple[float, Any, str]]:
    return [(sample.t_s, sample.value, sample.unit) for sample in finding.evidence]


@pytest.mark.slow
@both
@pytest.mark.parametrize(
    "numbers",
    [
        {},
        {"t1": 0.1, "t2": 0.3, "delta": 0.35},
        {"t1": 0.25, "t2": 0.5, "B": 0.125, "delta": 1.0},
        {"t1": 0.5, "t2": 0.5, "delta": 5.0},
    ],
    ids=str,
)
def test_the_formula_finds_what_the_seed_profile_finds(
    recording: Recording, numbers: dict[str, Any], tmp_path: Path
) -> None:
    result = recording.scored(tmp_path, **numbers)

    assert facts_of(result, "formula") == facts_of(result, "separation")
    if recording is TURTLE_BAG or numbers.get("delta") == 5.0:  # the gantry stays 4 m from the other robot
        assert VIOLATED in [verdict for _, _, verdict, *_ in facts_of(result, "formula")]


@both
def test_both_agree_with_the_papers_formula_on_every_sample(recording: Recording, tmp_path: Path) -> None:
    recording.scored(tmp_path)
    trial = recording.trial(tmp_path)
    (robot,), (human,) = trial.bodies_of("robot"), trial.bodies_of("human")
    names = [f"centre_distance/{robot.id}/{human.id}", f"speed/{human.id}", f"speed/{robot.id}"]
    t, (distance, k_h, k_r) = align([trial.signals[name] for name in names], max_gap_s=0.05)
    numbers = {"t1": 1.0, "t2": 1.5, "B": 0.0, "delta": 2.6}

    judged = judge_columns(
        Expression.parse(FORMULA), {"distance": distance, "k_H": k_h, "k_R": k_r, **numbers}, len(t)
    )
    required = SsmSeparation().d_min_m(k_h, k_r)

    assert len(t) > 1000
    assert float(np.ptp(k_r)) > 0.1  # something really moves
    for i, (d, h, r) in enumerate(zip(distance.tolist(), k_h.tolist(), k_r.tolist(), strict=True)):
        by_hand = d - (h * (1.0 + 1.5) + r * 1.0 + 0.0 + 2.6)
        assert judged.margin[i] == by_hand == distance[i] - required[i]
        assert bool(judged.true[i]) is (by_hand >= 0)


# The turtles, counted by hand from the poses and speeds that the simulator itself published ---------


def _poses() -> dict[str, list[tuple[float, float, float, float]]]:
    """Time, x, y and speed of each turtle, read by rosbags alone."""
    from rosbags.highlevel import AnyReader  # noqa: PLC0415

    found: dict[str, list[tuple[float, float, float, float]]] = {"/turtle1/pose": [], "/turtle2/pose": []}
    with AnyReader([SHARED / TURTLE_BAG.file]) as bag:
        for connection, time_ns, raw in bag.messages():
            if connection.topic in found:
                pose: Any = bag.deserialize(raw, connection.msgtype)
                t = (time_ns - bag.start_time) / 1e9
                found[connection.topic].append((t, pose.x, pose.y, abs(pose.linear_velocity)))
    return found


@pytest.mark.parametrize(("t1", "t2", "delta"), [(1.0, 1.5, 2.6), (0.1, 0.3, 0.35), (0.25, 0.5, 1.0)])
def test_the_turtles_are_too_close_for_as_long_as_their_own_speeds_say(
    t1: float, t2: float, delta: float, tmp_path: Path
) -> None:
    result = TURTLE_BAG.scored(tmp_path, t1=t1, t2=t2, delta=delta)
    poses = _poses()
    human, robot = poses["/turtle1/pose"], poses["/turtle2/pose"]
    bad_s, worst_m = [], math.inf
    for i in range(len(robot) - 1):
        margin = math.dist(robot[i][1:3], human[i][1:3]) - (
            human[i][3] * (t1 + t2) + robot[i][3] * t1 + delta
        )
        worst_m = min(worst_m, margin)
        if margin < 0:
            bad_s.append(robot[i + 1][0] - robot[i][0])

    violations = [f for f in result.measured.of("separation").values() if f.verdict is VIOLATED]
    assert violations
    # Speeds from poses answer to a change of speed within two samples of 16 ms on each side.
    seconds = add_up(f.quantities["time_in_violation_s"] for f in violations)
    assert seconds == pytest.approx(add_up(bad_s), abs=0.2)
    assert min(f.robustness for f in violations if f.robustness is not None) == pytest.approx(
        worst_m, abs=0.1
    )


def test_the_turtle_that_follows_closes_in(tmp_path: Path) -> None:
    # The other one runs away or stands still: at the onset of each violation its own pose says so.
    result = TURTLE_BAG.scored(tmp_path, profile="ariac2023", delta=1.0)
    poses = _poses()
    human, robot = poses["/turtle1/pose"], poses["/turtle2/pose"]

    violations = [f for f in result.measured.of("separation").values() if f.verdict is VIOLATED]
    assert violations
    for finding in violations:
        assert finding.span is not None
        at = min(range(len(robot)), key=lambda i: abs(robot[i][0] - finding.span.start_s))  # type: ignore[union-attr]
        before, after = at - 2, at + 2
        apart = [human[at][k] - robot[at][k] for k in (1, 2)]
        of_robot = [robot[after][k] - robot[before][k] for k in (1, 2)]
        of_human = [human[after][k] - human[before][k] for k in (1, 2)]
        gains = add_up(a * b for a, b in zip(of_robot, apart, strict=True)) > 0
        comes = add_up(a * b for a, b in zip(of_human, apart, strict=True)) < 0
        words = {(True, True): "both", (True, False): "robot", (False, True): "human"}
        assert finding.labels["closing_by"] == words[gains, comes]
        assert finding.labels["robot_moving"] == "yes"
    exposed = add_up(
        b[0] - a[0]
        for a, b, h in zip(robot, robot[1:], human, strict=False)
        if math.dist(a[1:3], h[1:3]) <= 5.0 and a[3] > 0.01
    )
    assert violations[0].quantities["exposure_s"] == pytest.approx(exposed, abs=0.2)


def test_what_was_not_recorded_is_undecided_in_both(tmp_path: Path) -> None:
    # The first tf comes 0.211 s after the first message of the bag.
    result = TURTLE_BAG.scored(tmp_path)

    for check in ("separation", "formula"):
        (undecided,) = [f for f in result.measured.of(check).values() if f.verdict is INCONCLUSIVE]
        assert undecided.span is not None
        assert undecided.span.start_s == 0.0
        assert undecided.span.end_s == pytest.approx(0.2115, abs=1e-3)
