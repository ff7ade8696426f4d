"""Speed and separation monitoring: the formula, its limit to the bit, episodes, gaps, laws.

Worked examples: monitor catalogue, M1 and section 3, and `worked_examples.json` beside it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from ariac_score import (
    Body,
    Event,
    Finding,
    Signal,
    Span,
    Trial,
    Verdict,
    load_rule_set,
    measure_trial,
)
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import prepare
from ariac_score.engine.price import price_trial
from ariac_score.errors import RuleSetError
from ariac_score.results.result import Pinned, Provenance
from ariac_score_standards import SsmSeparation
from ariac_score_standards.ssm_formula import PROFILES

SATISFIED, VIOLATED = Verdict.SATISFIED, Verdict.VIOLATED
INCONCLUSIVE, NOT_APPLICABLE = Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE

LAWS = settings(max_examples=100, derandomize=True, deadline=None)
SHARED = Path(__file__).parents[2].parent / "shared"
EXAMPLES_FILE = SHARED / "standards" / "worked_examples.json"

Times = Sequence[float]


def watched(
    t: Times,
    distance_m: Times | float,
    *,
    human: Times | float = 0.0,
    robot: Times | float = 0.0,
    window: Span | None = None,
    events: tuple[Event, ...] = (),
) -> Trial:
    """One robot and one human, with the three signals the seed profile reads."""
    columns = {
        "centre_distance/robot/human": ("m", distance_m),
        "speed/human": ("m/s", human),
        "speed/robot": ("m/s", robot),
    }
    n = len(t)
    signals = {
        name: Signal(name, unit, np.asarray(t, float), np.broadcast_to(np.asarray(values, float), n))
        for name, (unit, values) in columns.items()
    }
    bodies = (Body("human", "human"), Body("robot", "robot"))
    return Trial(
        "t", bodies=bodies, signals=signals, events=events, recorded=window or Span(float(t[0]), float(t[-1]))
    )


def only(monitor: SsmSeparation, trial: Trial) -> Finding:
    (finding,) = monitor.watch(trial)
    return finding


def of(verdict: Verdict, monitor: SsmSeparation, trial: Trial) -> list[Finding]:
    return [finding for finding in monitor.watch(trial) if finding.verdict is verdict]


def at_100_hz(duration_s: float) -> list[float]:
    return [k / 100 for k in range(round(duration_s * 100) + 1)]


# The formula ---------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("profile", "human_m_s", "robot_m_s", "d_min_m"),
    [
        ("seed", 1.0, 0.5, 5.6),  # W1.1: 1.0 * 2.5 + 0.5 * 1.0 + 0 + 2.6
        ("seed", 0.0, 0.0, 2.6),  # W1.2: all still
        ("ariac2023", 1.2, 0.8, 4.8),  # W1.3: 3.0 + 0.8 + 1.0
    ],
)
def test_the_worked_examples_of_the_catalogue(
    profile: Any, human_m_s: float, robot_m_s: float, d_min_m: float
) -> None:
    required_m = SsmSeparation(profile=profile).d_min_m(np.array([human_m_s]), np.array([robot_m_s]))

    assert required_m[0] == pytest.approx(d_min_m, abs=1e-12)


def test_a_human_covers_ground_while_the_robot_reacts_and_while_it_stops() -> None:
    # Catalogue, section 5, mistake 1: with the reaction time only it would be 0.83 m.
    monitor = SsmSeparation(t1_s=0.1, t2_s=0.3, stopping_distance_m=0.3, delta_m=0.27)

    assert monitor.d_min_m(np.array([1.6]), np.array([1.0]))[0] == pytest.approx(1.31)


SYMBOLS = {"t1_s": "t1", "t2_s": "t2", "stopping_distance_m": "B", "delta_m": "delta", "cap_m": "cap"}


def test_the_worked_examples_of_the_shared_file(subtests: pytest.Subtests) -> None:
    if not EXAMPLES_FILE.is_file():
        pytest.skip("the worked examples (../shared/standards) are not here")
    examples = json.loads(EXAMPLES_FILE.read_text(encoding="utf-8"))["examples"]
    of_the_seed = [example for example in examples if example["monitor"] == "M1.seed"]
    assert {example["id"] for example in of_the_seed} >= {"W1.1", "W1.2", "W1.3"}
    for example in of_the_seed:
        with subtests.test(example["id"]):
            inputs = example["inputs"]
            wanted = {name: inputs[key] for name, key in SYMBOLS.items() if inputs[key] is not None}
            fitting = [profile for profile, known in PROFILES.items() if known == wanted]
            if not fitting:
                pytest.skip(f"no profile has {wanted}")

            (profile,) = fitting
            required_m = SsmSeparation(profile=profile).d_min_m(
                np.array([inputs["k_H"]]), np.array([inputs["k_R"]])
            )  # type: ignore[arg-type]

            assert required_m[0] == pytest.approx(example["expected"]["d_min_m"], abs=example["tolerance"])


@st.composite
def moments(draw: st.DrawFn) -> tuple[float, float, float]:
    """Distance and both speeds, often within one number of the limit."""
    human, robot = draw(st.floats(0.0, 10.0)), draw(st.floats(0.0, 10.0))
    limit = human * (1.0 + 1.5) + robot * 1.0 + 0.0 + 2.6
    near = [limit, float(np.nextafter(limit, 0.0)), float(np.nextafter(limit, np.inf))]
    return draw(st.one_of(st.sampled_from(near), st.floats(0.0, 50.0))), human, robot


@given(moments())
@LAWS
def test_the_seed_verdict_is_the_papers_formula_to_the_bit(moment: tuple[float, float, float]) -> None:
    distance, human_speed, robot_speed = moment

    finding = only(SsmSeparation(), watched([0.0], [distance], human=human_speed, robot=robot_speed))

    kept = distance >= human_speed * (1.0 + 1.5) + robot_speed * 1.0 + 0.0 + 2.6
    assert finding.verdict is (SATISFIED if kept else VIOLATED)
    assert finding.robustness is not None
    assert (finding.robustness >= 0) == kept


@pytest.mark.parametrize(
    ("distance_m", "verdict"),
    [(2.6, SATISFIED), (float(np.nextafter(2.6, 0.0)), VIOLATED), (float(np.nextafter(2.6, 3.0)), SATISFIED)],
)
def test_standing_still_2_6_m_are_enough_and_the_number_below_is_not(
    distance_m: float, verdict: Verdict
) -> None:
    assert only(SsmSeparation(), watched([0.0], [distance_m])).verdict is verdict


def test_the_2023_profile_measures_in_the_plane() -> None:
    trial = watched([0.0], [0.5])
    flat = Signal("centre_distance_2d/robot/human", "m", np.array([0.0]), np.array([1.0]))
    trial = replace(trial, signals={**trial.signals, flat.name: flat})

    assert only(SsmSeparation(profile="ariac2023"), trial).verdict is SATISFIED  # 1.0 m are required
    assert only(SsmSeparation(profile="ariac2023", distance="centre_distance"), trial).verdict is VIOLATED
    assert only(SsmSeparation(), trial).verdict is VIOLATED


@pytest.mark.parametrize("profile", ["seed", "ariac2023"])
def test_it_needs_what_it_reads(profile: Any) -> None:
    needs = {(need.quantity, need.unit, need.max_gap_s) for need in SsmSeparation(profile=profile).needs()}

    distance = {"seed": "centre_distance", "ariac2023": "centre_distance_2d"}[profile]
    blame = {"approach_speed_robot", "approach_speed_human"} if profile == "ariac2023" else set()
    assert needs == {(distance, "m", 0.05), *((name, "m/s", 0.05) for name in {"speed"} | blame)}


# Episodes ------------------------------------------------------------------------------


def vee(t: Times) -> list[float]:
    """W1.7: 3.0 to 1.0 m in 4 s and back in 4 s."""
    return [3.0 - 0.5 * s if s <= 4 else 1.0 + 0.5 * (s - 4) for s in t]


TWO_METRES = SsmSeparation(delta_m=2.0)  # both still: exactly delta is required


def test_one_approach_is_one_episode_with_the_severities_of_the_catalogue() -> None:
    t = at_100_hz(8.0)

    episode = only(TWO_METRES, watched(t, vee(t)))

    # W1.7. Below 2.0 m strictly: samples 2.01 to 5.99 s, the last of which ends at 6.00 s: 3.99 s.
    # Depths are 1 - |k|/200 for k = -199..199: their sum is 1 + 2 (199 - 99.5) = 200, times 0.01 s.
    assert episode.verdict is VIOLATED
    assert episode.span == Span(2.01, 6.0)
    assert episode.quantities["time_in_violation_s"] == pytest.approx(3.99)
    assert episode.quantities["depth_max_m"] == pytest.approx(1.0)
    assert episode.quantities["depth_integral_m_s"] == pytest.approx(2.0)
    assert episode.quantities["relative_depth_integral_s"] == pytest.approx(1.0)
    assert episode.quantities["relative_depth_max"] == pytest.approx(0.5)
    assert episode.robustness == pytest.approx(-1.0)


def test_the_evidence_is_the_worst_moment() -> None:
    t = at_100_hz(8.0)

    evidence = {
        sample.signal: (sample.t_s, sample.value) for sample in only(TWO_METRES, watched(t, vee(t))).evidence
    }

    assert evidence == {
        "centre_distance/robot/human": (4.0, 1.0),
        "speed/human": (4.0, 0.0),
        "speed/robot": (4.0, 0.0),
        "required_distance/robot/human": (4.0, 2.0),
    }


def test_one_episode_of_4_s_costs_0_48_demerits(tmp_path: Path) -> None:
    # W3H.1: 0.4 (1 + 1.0 / 5) = 0.48. W3H.3: 1 / (1 + 0.48) = 0.675676
    file = tmp_path / "w3h.yaml"
    file.write_text(
        "{id: w3h, title: W3H.1, source: catalogue, log_map: ariac2020, monitors: {separation: "
        "{use: iso_ts_15066.ssm_separation, with: {delta_m: 2.0}}}, "
        "terms: {trial: {demerits: '0.4 * demerits(separation, tau_s=5)'}}, score: 1 / (1 + demerits)}",
        encoding="utf-8",
    )
    rule_set, registry, t = load_rule_set(str(file)), Registry(), at_100_hz(8.0)

    measured = measure_trial(watched(t, vee(t)), prepare(rule_set, registry=registry))
    result = price_trial(measured, rule_set, Provenance((), (), Pinned("", ""), Pinned("", ""), ()))

    assert result.score is not None
    assert float(result.score) == pytest.approx(0.675676, abs=1e-6)
    assert 1 / float(result.score) - 1 == pytest.approx(0.48, abs=1e-5)


@pytest.mark.parametrize(("pause_s", "episodes"), [(0.96, 1), (1.0, 2)])
def test_pauses_shorter_than_a_second_are_bridged(pause_s: float, episodes: int) -> None:
    # True on [1, 2) and again from 2 + pause; false for less than t_off = 1 s merges.
    t = at_100_hz(5.0)
    near = [1.0 if 1.0 <= s < 2.0 or 2.0 + pause_s - 1e-9 <= s < 3.5 else 9.0 for s in t]

    found = of(VIOLATED, SsmSeparation(), watched(t, near))

    assert len(found) == episodes
    assert (found[0].span, found[-1].span) == (
        (Span(1.0, 3.5), Span(1.0, 3.5)) if episodes == 1 else (Span(1.0, 2.0), Span(2.0 + pause_s, 3.5))
    )
    seconds = sum(finding.quantities["time_in_violation_s"] for finding in found)
    assert seconds == pytest.approx(1.0 + 3.5 - (2.0 + pause_s))  # true time only


@pytest.mark.parametrize(("t_on_s", "verdict"), [(0.0, VIOLATED), (0.03, VIOLATED), (0.04, SATISFIED)])
def test_violations_shorter_than_t_on_are_ignored(t_on_s: float, verdict: Verdict) -> None:
    t = at_100_hz(1.0)
    near = [1.0 if 50 <= k < 53 else 9.0 for k in range(len(t))]  # 0.03 s

    assert only(SsmSeparation(t_on_s=t_on_s), watched(t, near)).verdict is verdict


@pytest.mark.parametrize(("robot_m_s", "moving"), [(0.0, "no"), (0.01, "no"), (0.011, "yes")])
def test_a_violation_is_labelled_with_whether_the_robot_moved(robot_m_s: float, moving: str) -> None:
    violation = only(SsmSeparation(), watched([0.0, 0.01], [1.0, 1.0], robot=robot_m_s))

    assert violation.labels == {"robot_moving": moving}


TOWARDS_HUMAN, TOWARDS_ROBOT = "approach_speed_robot/robot/human", "approach_speed_human/robot/human"


def approaching(trial: Trial, robot_m_s: float | None, human_m_s: float | None) -> Trial:
    """The trial with the speeds of both towards each other, as far as they are known."""
    t = trial.signals["speed/robot"].t
    speeds = {TOWARDS_HUMAN: robot_m_s, TOWARDS_ROBOT: human_m_s}
    more = {name: Signal(name, "m/s", t, np.full(len(t), v)) for name, v in speeds.items() if v is not None}
    return replace(trial, signals={**trial.signals, **more})


@pytest.mark.parametrize("profile", ["ariac2023", "ariac2023_agent"])
@pytest.mark.parametrize(
    ("robot_m_s", "human_m_s", "by"),
    [
        (0.5, 0.01, "robot"),
        (0.01, 0.5, "human"),
        (float(np.nextafter(0.01, 1.0)), float(np.nextafter(0.01, 1.0)), "both"),
        (0.01, -1.0, "neither"),
        (0.5, None, "unknown"),
        (None, 0.5, "unknown"),
        (None, None, "unknown"),
    ],
)
def test_the_profiles_of_2023_say_who_closed_in_and_decide_without_it(
    profile: Any, robot_m_s: float | None, human_m_s: float | None, by: str
) -> None:
    trial = approaching(watched([0.0, 0.01], [0.9, 0.9], robot=0.5), robot_m_s, human_m_s)

    violation = only(SsmSeparation(profile=profile, distance="centre_distance"), trial)

    assert violation.verdict is VIOLATED
    assert dict(violation.labels) == {"robot_moving": "yes", "closing_by": by}


def test_the_seed_profile_reads_its_three_signals_alone_unless_blame_is_yes() -> None:
    trial = approaching(watched([0.0, 0.01], [0.9, 0.9], robot=0.5), 0.5, 0.0)
    with_blame = SsmSeparation(blame="yes")

    assert only(SsmSeparation(), trial).labels == {"robot_moving": "yes"}
    assert only(with_blame, trial).labels == {"robot_moving": "yes", "closing_by": "robot"}
    assert {need.quantity for need in SsmSeparation().needs()} == {"centre_distance", "speed"}
    assert {need.quantity for need in with_blame.needs()} >= {"approach_speed_robot", "approach_speed_human"}
    silent = SsmSeparation(profile="ariac2023", distance="centre_distance", blame="no")
    assert only(silent, trial).labels == {"robot_moving": "yes"}
    measured = [only(monitor, trial).quantities for monitor in (SsmSeparation(), with_blame, silent)]
    assert ["exposure_s" in quantities for quantities in measured] == [False, True, False]
    assert only(SsmSeparation(), watched([0.0], [9.0])).quantities == {}


def test_who_closes_in_is_not_known_where_the_poses_have_a_hole() -> None:
    t = at_100_hz(2.0)
    trial = approaching(watched(t, [9.0 if s < 1.0 else 0.5 for s in t], robot=0.5), 0.5, 0.0)
    signals = dict(trial.signals)
    held = np.array([s for s in t if not 0.95 < s < 1.05])
    signals[TOWARDS_HUMAN] = Signal(TOWARDS_HUMAN, "m/s", held, np.full(len(held), 0.5))
    monitor = SsmSeparation(profile="ariac2023", distance="centre_distance")

    assert only(monitor, trial).labels["closing_by"] == "robot"
    violation = only(monitor, replace(trial, signals=signals))
    assert (violation.verdict, violation.labels["closing_by"]) == (VIOLATED, "unknown")


@pytest.mark.parametrize("profile", ["seed", "ariac2023", "ariac2023_agent"])
@pytest.mark.parametrize(
    ("distance_m", "robot_m_s", "exposed_s"),
    [
        (5.0, 0.011, 1.0),  # catalogue, 1.3: within 5 m of a moving robot
        (float(np.nextafter(5.0, 9.0)), 0.011, 0.0),
        (5.0, 0.01, 0.0),
        (5.0, float(np.nextafter(0.01, 1.0)), 1.0),
    ],
)
def test_a_clean_trial_measures_for_how_long_the_human_was_exposed(
    profile: Any, distance_m: float, robot_m_s: float, exposed_s: float
) -> None:
    trial = watched(at_100_hz(1.0), distance_m, robot=robot_m_s)

    finding = only(SsmSeparation(profile=profile, distance="centre_distance", blame="yes"), trial)

    assert finding.verdict is SATISFIED
    assert finding.quantities["exposure_s"] == pytest.approx(exposed_s)
    assert {n: v for n, v in finding.quantities.items() if n != "exposure_s"} == {
        "time_in_violation_s": 0.0,
        "depth_max_m": 0.0,
        "depth_integral_m_s": 0.0,
        "relative_depth_max": 0.0,
        "relative_depth_integral_s": 0.0,
    }


def test_every_violation_of_a_pair_has_the_exposure_of_the_whole_trial() -> None:
    # Moving for 4 of 6 s; within 5 m all the time; too close on [1, 2) and [4, 5).
    t = at_100_hz(6.0)
    near = [1.0 if 1 <= s < 2 or 4 <= s < 5 else 4.9 for s in t]
    trial = watched(t, near, robot=[0.5 if s < 4 else 0.0 for s in t])

    found = of(VIOLATED, SsmSeparation(blame="yes"), trial)

    assert [f.quantities["exposure_s"] for f in found] == [pytest.approx(4.0)] * 2
    assert [f.labels["robot_moving"] for f in found] == ["yes", "no"]


def test_a_clean_trial_has_no_energy_of_closing_in_where_a_mass_is_given() -> None:
    # 0.5 * 2 kg * (0.5 + 0.5 m/s)^2 = 1 J
    heavy = SsmSeparation(reduced_mass_kg=2.0)

    assert only(heavy, watched([0.0], [9.0])).quantities["closing_energy_max_J"] == 0.0
    violation = only(heavy, watched([0.0, 0.01], [1.0, 1.0], human=0.5, robot=0.5))
    assert violation.quantities["closing_energy_max_J"] == pytest.approx(1.0)


def test_a_trial_without_violation_reports_its_closest_moment() -> None:
    finding = only(SsmSeparation(), watched([0.0, 0.01, 0.02], [4.0, 3.0, 5.0]))

    assert finding.verdict is SATISFIED
    assert finding.robustness == pytest.approx(0.4)
    assert [sample.t_s for sample in finding.evidence] == [0.01] * 4


def test_only_what_happens_during_the_competition_counts(subtests: pytest.Subtests) -> None:
    cases: list[tuple[float, float, int]] = [(2.0, 4.0, 0), (1.0, 4.0, 1), (2.0, 5.0, 1), (0.0, 6.0, 2)]
    for start_s, end_s, violations in cases:
        with subtests.test(start_s=start_s, end_s=end_s, violations=violations):
            # Too close on [0, 1] and on [5, 6], both ends included.
            t = at_100_hz(6.0)
            near = [1.0 if s <= 1.0 or s >= 5.0 else 9.0 for s in t]
            events = (Event(start_s, "competition_started"), Event(end_s, "competition_ended"))

            found = list(SsmSeparation().watch(watched(t, near, events=events)))

            assert [f.verdict for f in found] == ([VIOLATED] * violations or [SATISFIED])
            assert all(
                f.span and start_s <= f.span.start_s <= f.span.end_s <= end_s for f in found[:violations]
            )


# Several bodies ------------------------------------------------------------------------


def crowd(near: set[str], missing: frozenset[str] = frozenset()) -> Trial:
    """Two robots and two humans, all still; pairs in `near` are 1 m apart, the others 9 m."""
    t, robots, humans = np.array([0.0, 0.01]), ("gantry", "kitting"), ("person_1", "person_2")
    signals = {f"speed/{b}": Signal(f"speed/{b}", "m/s", t, np.zeros(2)) for b in (*robots, *humans)}
    for pair in (f"{r}/{h}" for r in robots for h in humans):
        name = f"centre_distance/{pair}"
        signals[name] = Signal(name, "m", t, np.full(2, 1.0 if pair in near else 9.0))
    bodies = (*(Body(r, "robot") for r in robots), *(Body(h, "human") for h in humans), Body("agv1", "agv"))
    kept = {name: signal for name, signal in signals.items() if name not in missing}
    return Trial("t", bodies=bodies, signals=kept, recorded=Span(0.0, 0.01))


def test_each_pair_of_robot_and_human_has_its_own_findings() -> None:
    found = {f.subject: f.verdict for f in SsmSeparation().watch(crowd({"kitting/person_1"}))}

    assert found == {
        "gantry/person_1": SATISFIED,
        "gantry/person_2": SATISFIED,
        "kitting/person_1": VIOLATED,
        "kitting/person_2": SATISFIED,
    }


def test_a_signal_missing_for_one_human_leaves_the_other_pairs_decided() -> None:
    trial = crowd({"gantry/person_1"}, frozenset({"speed/person_2"}))

    found = {f.subject: f.verdict for f in SsmSeparation().watch(trial)}

    assert found == {
        "gantry/person_1": VIOLATED,
        "gantry/person_2": INCONCLUSIVE,
        "kitting/person_1": SATISFIED,
        "kitting/person_2": INCONCLUSIVE,
    }


# What the log does not show ------------------------------------------------------------


@pytest.mark.parametrize("name", ["centre_distance/robot/human", "speed/human", "speed/robot"])
def test_a_missing_signal_is_undecided_for_the_whole_competition_and_named(name: str) -> None:
    trial = watched(at_100_hz(2.0), 9.0)
    trial = replace(trial, signals={n: s for n, s in trial.signals.items() if n != name})

    finding = only(SsmSeparation(), trial)

    assert finding.verdict is INCONCLUSIVE
    assert repr(name) in finding.message
    assert finding.span == Span(0.0, 2.0)


@pytest.mark.parametrize(
    ("witnessed", "verdict"), [(frozenset({"bodies"}), NOT_APPLICABLE), (frozenset(), INCONCLUSIVE)]
)
@pytest.mark.parametrize("present", ["robot", "human", "neither"])
def test_nobody_to_watch_is_an_answer_only_of_a_log_that_records_every_body(
    present: str, witnessed: frozenset[str], verdict: Verdict
) -> None:
    bodies = () if present == "neither" else (Body(present, present),)
    trial = Trial("t", bodies=bodies, witnessed=witnessed, recorded=Span(0.0, 1.0))

    finding = only(SsmSeparation(), trial)

    absent = {"robot", "human"} - {present}
    assert finding.verdict is verdict
    assert all(f"no {kind}" in finding.message for kind in absent)


def test_what_the_log_lacks_as_a_whole_is_not_repeated_where_nobody_is_watched() -> None:
    trial = Trial("t", unrecorded=("topic /snapshot",), recorded=Span(0.0, 1.0))

    assert only(SsmSeparation(), trial).message == "the log shows no robot and no human"


def without(t: Times, start_s: float, end_s: float) -> list[float]:
    """Times without those strictly between."""
    return [s for s in t if not start_s + 1e-9 < s < end_s - 1e-9]


@pytest.mark.parametrize(
    ("name", "hole"),
    [("inside", Span(1.0, 1.06)), ("at the start", Span(0.0, 0.06)), ("at the end", Span(1.94, 2.0))],
)
def test_a_hole_longer_than_allowed_is_undecided_for_that_stretch(name: str, hole: Span) -> None:
    t = without(at_100_hz(2.0), hole.start_s, hole.end_s)
    t = [
        s for s in t if not (name == "at the start" and s == 0.0) and not (name == "at the end" and s == 2.0)
    ]

    found = list(SsmSeparation().watch(watched(t, 9.0, window=Span(0.0, 2.0))))

    assert [(f.verdict, f.span) for f in found] == [(INCONCLUSIVE, hole)]


@pytest.mark.parametrize("start_s", [0.0, 1.0, 1.95])
def test_a_hole_just_as_long_as_allowed_is_fine(start_s: float) -> None:
    t = without(at_100_hz(2.0), start_s, start_s + 0.05)
    t = [s for s in t if not (start_s == 0.0 and s == 0.0) and not (start_s == 1.95 and s == 2.0)]

    assert only(SsmSeparation(), watched(t, 9.0, window=Span(0.0, 2.0))).verdict is SATISFIED


def test_a_hole_and_a_violation_are_both_reported() -> None:
    t = without(at_100_hz(4.0), 1.0, 2.0)
    near = [1.0 if 3.0 <= s < 3.5 else 9.0 for s in t]

    found = [(f.verdict, f.span) for f in SsmSeparation().watch(watched(t, near))]

    assert found == [(INCONCLUSIVE, Span(1.0, 2.0)), (VIOLATED, Span(3.0, 3.5))]


def test_a_sample_before_a_hole_stands_for_no_longer_than_a_hole_may_be() -> None:
    # Too close from 0.50 s to the hole at 1.00 s: 50 samples of 0.01 s, the last stands for 0.05 s.
    t = without(at_100_hz(4.0), 1.0, 3.0)
    near = [1.0 if 0.5 <= s <= 1.0 else 9.0 for s in t]

    (violation,) = of(VIOLATED, SsmSeparation(), watched(t, near))

    assert violation.span == Span(0.5, 1.05)
    assert violation.quantities["time_in_violation_s"] == pytest.approx(0.55)
    assert violation.quantities["depth_integral_m_s"] == pytest.approx(0.55 * (2.6 - 1.0))


def test_a_recording_that_ends_long_before_the_competition_never_satisfies() -> None:
    found = list(SsmSeparation().watch(watched([0.0, 0.01], 9.0, window=Span(0.0, 60.0))))

    assert [(f.verdict, f.span) for f in found] == [(INCONCLUSIVE, Span(0.01, 60.0))]


def test_samples_outside_the_competition_only_decide_nothing() -> None:
    found = list(SsmSeparation().watch(watched([0.0, 0.01], 9.0, window=Span(5.0, 6.0))))

    assert [(f.verdict, f.span) for f in found] == [(INCONCLUSIVE, Span(5.0, 6.0))]


def test_a_hole_in_one_signal_is_a_hole_for_the_pair() -> None:
    trial = watched(at_100_hz(2.0), 9.0)
    t = np.array(without(at_100_hz(2.0), 1.0, 1.5))
    speed = Signal("speed/human", "m/s", t, np.zeros(len(t)))

    found = list(SsmSeparation().watch(replace(trial, signals={**trial.signals, speed.name: speed})))

    assert [(f.verdict, f.span) for f in found] == [(INCONCLUSIVE, Span(1.0, 1.5))]


@given(start=st.integers(0, 190), length=st.integers(6, 60), near=st.booleans())
@LAWS
def test_taking_samples_away_never_satisfies_what_was_not_seen(start: int, length: int, near: bool) -> None:
    t = [k / 100 for k in range(201) if not start <= k < start + length]

    found = list(SsmSeparation().watch(watched(t, 1.0 if near else 9.0, window=Span(0.0, 2.0))))

    assert SATISFIED not in [f.verdict for f in found]
    assert INCONCLUSIVE in [f.verdict for f in found]


# Laws ----------------------------------------------------------------------------------


@st.composite
def approaches(draw: st.DrawFn) -> tuple[Times, list[float]]:
    """One approach and retreat inside 12 s at 100 Hz, both still: 2.6 m are required."""
    worst_s, half_s = draw(st.floats(4.0, 8.0)), draw(st.floats(0.05, 3.0))
    closest_m = draw(st.floats(0.0, 2.5))
    t = at_100_hz(12.0)
    return t, [closest_m + (2.6 - closest_m) * abs(s - worst_s) / half_s for s in t]


def seconds(found: Sequence[Finding]) -> float:
    return sum(f.quantities["time_in_violation_s"] for f in found)


@given(approaches())
@LAWS
def test_halving_the_log_rate_changes_no_duration_by_more_than_a_sample(
    approach: tuple[Times, list[float]],
) -> None:
    t, distance = approach
    fine = of(VIOLATED, SsmSeparation(), watched(t, distance))
    coarse = of(VIOLATED, SsmSeparation(), watched(t[::2], distance[::2]))

    assert len(fine) == len(coarse) == 1
    assert seconds(coarse) == pytest.approx(seconds(fine), abs=0.02 + 1e-9)
    spans = [f[0].span for f in (fine, coarse)]
    assert spans[0] is not None
    assert spans[1] is not None
    assert spans[1].start_s == pytest.approx(spans[0].start_s, abs=0.02 + 1e-9)
    assert spans[1].end_s == pytest.approx(spans[0].end_s, abs=0.02 + 1e-9)


TICK_S = 1 / 64  # sums of these are exact in float64


@dataclass(frozen=True)
class Chart:
    """A random chart of events on a grid of ticks, with the parameters to watch it by."""

    ticks: tuple[int, ...]
    distance_m: tuple[float, ...]
    human: tuple[float, ...]
    robot: tuple[float, ...]
    start: int
    end: int
    t_on: int
    t_off: int
    max_gap: int = 4
    profile: str = "seed"
    blame: str = "profile"
    towards: tuple[tuple[tuple[int, float], ...], ...] = ((), ())  # by tick: robot, human

    def trial(self, *, shift_s: float = 0.0) -> Trial:
        t = [k * TICK_S + shift_s for k in self.ticks]
        marks = ((self.start, "competition_started"), (self.end, "competition_ended"))
        events = tuple(Event(k * TICK_S + shift_s, kind) for k, kind in marks)
        trial = watched(t, self.distance_m, human=self.human, robot=self.robot, events=events)
        speeds = zip((TOWARDS_HUMAN, TOWARDS_ROBOT), self.towards, strict=True)
        more = {
            name: Signal(
                name, "m/s", np.array([k * TICK_S + shift_s for k, _ in rows]), np.array([v for _, v in rows])
            )
            for name, rows in speeds
            if rows
        }
        return replace(trial, signals={**trial.signals, **more})

    @property
    def monitor(self) -> SsmSeparation:
        limits = {"max_gap_s": self.max_gap, "t_on_s": self.t_on, "t_off_s": self.t_off}
        given: dict[str, Any] = {name: ticks * TICK_S for name, ticks in limits.items()}
        return SsmSeparation(
            profile=self.profile,  # type: ignore[arg-type]
            distance="centre_distance",
            exposure_distance_m=3.0,
            blame=self.blame,  # type: ignore[arg-type]
            **given,
        )

    @property
    def blames(self) -> bool:
        return self.blame == "yes" or (self.blame == "profile" and self.profile != "seed")

    def required_m(self, i: int) -> float:
        """Catalogue, M1: the table of profiles."""
        needed = self.human[i] * (1.0 + 1.5) + self.robot[i] * 1.0 + 0.0
        if self.profile == "ariac2023":
            return needed + 1.0
        return needed + 2.6 if self.profile == "seed" else min(needed + 1.2, 5.0)

    def towards_at(self, which: int, tick: int) -> float | None:
        """The directed speed at a tick, on a straight line between neighbours that are near enough."""
        before = [row for row in self.towards[which] if row[0] <= tick]
        after = [row for row in self.towards[which] if row[0] >= tick]
        if not before or not after:
            return None
        (a, low), (b, high) = before[-1], after[0]
        if b - a > self.max_gap:
            return None
        return low if a == b else low + (tick - a) / (b - a) * (high - low)


@st.composite
def charts(draw: st.DrawFn) -> Chart:
    steps = draw(st.lists(st.sampled_from([1, 1, 1, 2, 3, 4, 5, 9]), min_size=1, max_size=60))
    ticks = [0, *np.cumsum(steps).tolist()]
    n = len(ticks)
    near = draw(st.lists(st.booleans(), min_size=n, max_size=n))
    depth = draw(st.lists(st.integers(0, 20), min_size=n, max_size=n))
    human = draw(st.lists(st.sampled_from([0.0, 0.5, 1.25]), min_size=n, max_size=n))
    robot = draw(st.lists(st.sampled_from([0.0, 0.25]), min_size=n, max_size=n))
    # The catalogue does not say whether an episode outlives a hole: quiet on both sides of each.
    beside = {i + side for i, step in enumerate(steps) if step > 4 for side in (0, 1)}
    start, end = sorted(draw(st.tuples(*[st.integers(0, ticks[-1])] * 2)))
    chart = Chart(
        tuple(ticks),
        (),
        tuple(human),
        tuple(robot),
        start,
        end,
        t_on=draw(st.sampled_from([0, 1, 2, 5])),
        t_off=draw(st.sampled_from([0, 1, 3, 8])),
        profile=draw(st.sampled_from(["seed", "ariac2023", "ariac2023_agent"])),
        blame=draw(st.sampled_from(["profile", "yes", "no"])),
        towards=(draw(_towards(ticks)), draw(_towards(ticks))),
    )
    distance = [
        chart.required_m(i) + (-depth[i] / 8 if near[i] and i not in beside else depth[i] / 8)
        for i in range(n)
    ]
    return replace(chart, distance_m=tuple(max(d, 0.0) for d in distance))


@st.composite
def _towards(draw: st.DrawFn, ticks: Sequence[int]) -> tuple[tuple[int, float], ...]:
    """A directed speed at some of the ticks, or at none."""
    kept = draw(st.sampled_from(["all", "some", "none"]))
    chosen = [k for k in ticks if kept == "all" or (kept == "some" and draw(st.booleans()))]
    return tuple((k, draw(st.sampled_from([-0.5, 0.0, 0.25, 1.0]))) for k in chosen)


@dataclass
class Episode:
    rows: list[int] = field(default_factory=list)
    end: int = 0


def reference_episodes(
    ticks: Sequence[int], near: Sequence[bool], lasts: Sequence[int], chart: Chart
) -> list[Episode]:
    """Catalogue, section 1.2, sample by sample: open after t_on of truth, close after t_off of none."""
    closed: list[Episode] = []
    opened: Episode | None = None
    held: list[int] = []
    for i, tick in enumerate(ticks):
        if not near[i]:
            held = []
            continue
        # A hole in the samples ends a run: nothing is known to have held in it.
        first_of_run = i == 0 or not near[i - 1] or tick - ticks[i - 1] > chart.max_gap
        held = [] if first_of_run else held
        if opened is not None and first_of_run and tick - opened.end >= chart.t_off:
            closed.append(opened)
            opened = None
        if opened is not None:
            opened.rows.append(i)
            opened.end = tick + lasts[i]
            continue
        held.append(i)
        if tick + lasts[i] - ticks[held[0]] >= chart.t_on:
            opened, held = Episode(held, tick + lasts[i]), []
    return closed + ([opened] if opened is not None else [])


def reference_blame(chart: Chart, rows: Sequence[int], inside: Sequence[int]) -> dict[str, str]:
    """Catalogue, section 1.5."""
    labels = {"robot_moving": "yes" if any(chart.robot[inside[i]] > 0.01 for i in rows) else "no"}
    if not chart.blames:
        return labels
    speeds = [chart.towards_at(which, chart.ticks[inside[rows[0]]]) for which in (0, 1)]
    if None in speeds:
        return {**labels, "closing_by": "unknown"}
    closing = [v is not None and v > 0.01 for v in speeds]
    word = {(True, True): "both", (True, False): "robot", (False, True): "human", (False, False): "neither"}
    return {**labels, "closing_by": word[closing[0], closing[1]]}


SEVERITIES = (
    "time_in_violation_s",
    "depth_max_m",
    "depth_integral_m_s",
    "relative_depth_max",
    "relative_depth_integral_s",
)


def reference(chart: Chart) -> Iterator[tuple[Any, ...]]:
    """What the monitor has to say, by plain Python: verdict, start, end, numbers, words."""
    inside = [i for i, tick in enumerate(chart.ticks) if chart.start <= tick <= chart.end]
    ticks = [chart.ticks[i] for i in inside]
    marks = [chart.start, *ticks, chart.end]
    gaps = [(a, b) for a, b in pairwise(marks) if b - a > chart.max_gap]
    if not ticks:
        gaps = [(chart.start, chart.end)]
    for a, b in gaps:
        yield INCONCLUSIVE, a * TICK_S, b * TICK_S, {}, {}
    required = [chart.required_m(i) for i in inside]
    short = [r - chart.distance_m[i] for r, i in zip(required, inside, strict=True)]
    lasts = [min(b - a, chart.max_gap) for a, b in pairwise(ticks)] + [0]
    episodes = reference_episodes(ticks, [s > 0 for s in short], lasts, chart)
    exposed_s = 0.0
    for last, i in zip(lasts, inside, strict=False):
        if chart.distance_m[i] <= 3.0 and chart.robot[i] > 0.01:
            exposed_s += last * TICK_S
    for episode in episodes:
        seconds_of = {i: lasts[i] * TICK_S for i in episode.rows}
        relative = {i: min(short[i] / required[i], 1.0) for i in episode.rows}
        numbers = {
            "time_in_violation_s": sum(seconds_of.values()),
            "depth_max_m": max(short[i] for i in episode.rows),
            "depth_integral_m_s": sum(short[i] * seconds_of[i] for i in episode.rows),
            "relative_depth_max": max(relative.values()),
            "relative_depth_integral_s": sum(relative[i] * seconds_of[i] for i in episode.rows),
        }
        if chart.blames:
            numbers["exposure_s"] = exposed_s
        words = reference_blame(chart, episode.rows, inside)
        yield VIOLATED, ticks[episode.rows[0]] * TICK_S, episode.end * TICK_S, numbers, words
    if ticks and not episodes and not gaps:
        clean = {**dict.fromkeys(SEVERITIES, 0.0), "exposure_s": exposed_s}
        yield SATISFIED, None, None, clean if chart.blames else {}, {}


@pytest.mark.slow
@given(charts())
@LAWS
def test_a_slow_implementation_in_plain_python_agrees(chart: Chart) -> None:
    assume(chart.start < chart.end)  # an instant is no competition: then all of the log is watched
    found = list(chart.monitor.watch(chart.trial()))
    wanted = list(reference(chart))

    assert [(f.verdict, f.span and f.span.start_s, f.span and f.span.end_s) for f in found] == [
        row[:3] for row in wanted
    ]
    for finding, (verdict, *_, numbers, words) in zip(found, wanted, strict=True):
        assert dict(finding.quantities) == pytest.approx(numbers)
        assert dict(finding.labels) == words
        if verdict is VIOLATED:
            assert finding.robustness == pytest.approx(-numbers["depth_max_m"])


def moved(finding: Finding, shift_s: float) -> dict[str, Any]:
    """What must stay when all clocks are turned back by the shift; messages name times."""
    span = finding.span and Span(finding.span.start_s - shift_s, finding.span.end_s - shift_s)
    evidence = [replace(sample, t_s=sample.t_s - shift_s) for sample in finding.evidence]
    unshifted = {
        n: getattr(finding, n) for n in ("subject", "verdict", "robustness", "unit", "critical", "clause")
    }
    return {
        **unshifted,
        "span": span,
        "evidence": evidence,
        "labels": dict(finding.labels),
        "quantities": dict(finding.quantities),
    }


@given(charts(), st.integers(-640, 6400))
@LAWS
def test_a_shift_in_time_moves_the_spans_and_nothing_else(chart: Chart, shift: int) -> None:
    here = chart.monitor.watch(chart.trial())
    there = chart.monitor.watch(chart.trial(shift_s=shift * TICK_S))

    assert [moved(f, 0.0) for f in here] == [moved(f, shift * TICK_S) for f in there]


@pytest.mark.slow
@given(charts(), st.permutations(["centre_distance/robot/human", "speed/human", "speed/robot"]))
@LAWS
def test_the_order_of_signals_and_bodies_does_not_matter(chart: Chart, names: list[str]) -> None:
    trial = chart.trial()
    shuffled = replace(
        trial,
        signals={name: trial.signals[name] for name in names} | dict(trial.signals),
        bodies=trial.bodies[::-1],
    )

    assert list(chart.monitor.watch(shuffled)) == list(chart.monitor.watch(trial))


@pytest.mark.slow
@given(charts(), st.floats(0.0, 5.0))
@LAWS
def test_asking_for_more_distance_never_shortens_the_time_in_violation(chart: Chart, more_m: float) -> None:
    trial = chart.trial()
    stricter = replace(chart.monitor, delta_m=chart.monitor.allowance_m + more_m, t_on_s=0.0)

    assert seconds(of(VIOLATED, stricter, trial)) >= seconds(of(VIOLATED, chart.monitor, trial)) - 1e-9


# Parameters ----------------------------------------------------------------------------

TIMES_AND_LENGTHS = ["t1_s", "t2_s", "stopping_distance_m", "delta_m", "t_on_s", "t_off_s"]


def build(**parameters: Any) -> SsmSeparation:
    plugin = Registry().find("ariac_score.monitors", "iso_ts_15066.ssm_separation")
    built = plugin.build(parameters)
    assert isinstance(built, SsmSeparation)
    return built


@pytest.mark.parametrize("name", TIMES_AND_LENGTHS)
@pytest.mark.parametrize("value", [-0.001, -5e-324, float("nan")])
def test_a_negative_parameter_is_refused_and_named(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        SsmSeparation(**{name: value})


def test_a_parameter_may_be_zero(subtests: pytest.Subtests) -> None:
    cases = TIMES_AND_LENGTHS
    for name in cases:
        with subtests.test(name=name):
            assert getattr(build(**{name: 0}), name) == 0.0


@pytest.mark.parametrize(("written", "word"), [(True, "yes"), (False, "no"), ("yes", "yes"), ("no", "no")])
@pytest.mark.parametrize("name", ["blame", "robot_must_move"])
def test_yes_and_no_need_no_quotes_in_yaml(name: str, written: Any, word: str) -> None:
    assert getattr(build(**{name: written}), name) == word


def test_no_other_choice_takes_a_truth(subtests: pytest.Subtests) -> None:
    cases: list[tuple[str, Any]] = [("profile", True), ("blame", 1), ("speeds", False), ("blame", "y")]
    for name, written in cases:
        with subtests.test(name=name), pytest.raises(RuleSetError, match="is not one of"):
            build(**{name: written})


@pytest.mark.parametrize("value", [0.0, -0.05, float("nan")])
def test_a_gap_that_is_not_positive_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="max_gap_s"):
        SsmSeparation(max_gap_s=value)


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"profile": "iso"}, "'iso' is not one of seed, ariac2023"),
        ({"distance": "furlongs"}, "'furlongs' is not one of"),
        ({"t1_s": -1.0}, "t1_s is -1 but cannot be negative"),
        ({"max_gap_s": 0}, "max_gap_s is 0 but must be positive"),
        ({"max_gap_s": float("inf")}, "not finite"),
        ({"delta_m": "2.6 m"}, "'2.6 m' is not a float"),
        ({"delta_mm": 2600}, "no parameter 'delta_mm'"),
    ],
    ids=str,
)
def test_a_rule_set_with_a_wrong_parameter_is_refused(parameters: dict[str, Any], words: str) -> None:
    with pytest.raises(RuleSetError, match=words):
        build(**parameters)
