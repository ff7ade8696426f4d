"""The AI for Industry Challenge against its own scorer: worked cases, category by category, and real results.

A case states messages, a configuration, the times of the task, and what the organisers' scorer, compiled from
one state of its history, says of them. Each is written as a recording and scored as a user would score it.
`--aic-cases DIR` runs those of another folder: `*.json.gz` (or `.json`) of format `aic-cases/1`, and results
that the engine wrote, `*.yaml`; a folder that is given and holds none is a failure.
"""

from __future__ import annotations

import gzip
import json
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from ariac_score import NothingToScoreError, Result, RuleSet, load_rule_set, open_trial, score_trial
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.extending import rule_set_names
from ariac_score_aic.consumption import consumed_of
from ariac_score_aic.finals import FinalsForce, insertions_of
from ariac_score_aic.scoring_file import OfficialTrial, read_official, sum_in_order, times_from, written

from .made_bags import write_bag, write_run

DEFAULT_FOLDER = Path(__file__).parents[4] / "shared/aic"
FORMAT = "aic-cases/1"
RELATIVE = 1e-9
TERMS = {
    "contacts": "contacts_points",
    "duration": "duration_points",
    "insertion force": "force_points",
    "trajectory efficiency": "efficiency_points",
    "trajectory smoothness": "smoothness_points",
    "trajectory jerk": "smoothness_points",
}
PHASES = {"phase1_pr594": "aic2026.phase1", "phase2_offline_force": "aic2026.finals_force"}
QUICK = (
    "ev_exact",
    "ev_one_token",
    "p_half",
    "d_mid",
    "f_tare",
    "j_15",
    "e_mid",
    "c_one",
    "ph1_both",
    "ph2_both",
)


def folder_of(config: pytest.Config) -> Path:
    given = config.getoption("--aic-cases")
    return Path(given) if given else DEFAULT_FOLDER


@cache  # several tests ask, and the file is large
def cases_in(folder: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = []
    files = (file for ending in ("*.json.gz", "*.json") for file in sorted(folder.rglob(ending)))
    for file in files:
        raw = gzip.decompress(file.read_bytes()) if file.suffix == ".gz" else file.read_bytes()
        document = json.loads(raw)
        if isinstance(document, dict) and document.get("format") == FORMAT:
            found += document["cases"]
    return found


@pytest.fixture
def folder(request: pytest.FixtureRequest) -> Path:
    folder = folder_of(request.config)
    given = request.config.getoption("--aic-cases")
    if not cases_in(folder) and not given:
        pytest.skip(f"no cases of the challenge in {folder}")
    assert cases_in(folder) or list(folder.rglob("*.yaml")), f"{folder} holds no case"
    return folder


@cache
def rules_of(profile: str) -> RuleSet:
    """The rule set of a state of the scorer, by the name that cases give to it, such as `p307`."""
    if profile == "main":
        return load_rule_set("aic2026.qualification")
    if profile in PHASES:
        return load_rule_set(PHASES[profile])
    (name,) = [n for n in rule_set_names() if n.endswith(f"_pr{profile.removeprefix('p')}")]
    return load_rule_set(name)


def expectations(case: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """The states of the scorer that a case is for, with what each says."""
    if "expected_by_profile" in case:
        yield from case["expected_by_profile"].items()
    else:
        yield case["profile"], case["expected"]


def run_of(case: Mapping[str, Any], folder: Path) -> Path:
    """The recording of a case, with its configuration and its times beside it."""
    config = case["config"]
    unknown = set(config) - {"gripper_frame", "tf_buffer_s", "connection", "connections"}
    assert not unknown, f"nobody knows what {unknown} configures"
    assert config["gripper_frame"] == "gripper/tcp"
    listed = config.get("connections") or [config.get("connection")]
    return write_run(
        folder,
        case["messages"],
        connections=[one for one in listed if one],
        times=case["task"],
        buffer_s=config["tf_buffer_s"],
    )


def term(result: Result, rules: RuleSet, name: str) -> float:
    """What a term of the tasks comes to, as it is priced."""
    formula = Expression.parse(f"sum(task.{name})")
    values = rules.sheet.evaluate_in(formula, result.measured.scopes, result.measured.findings, level="trial")
    return float(next(iter(values.values())).value)


def differences(case: Mapping[str, Any], folder: Path) -> list[str]:
    """Where our numbers are others than those of the case; each with both."""
    if case["profile"] == "phase2_offline_force":
        return finals_differences(case, folder)
    bag, found = run_of(case, folder), []
    for profile, expected in expectations(case):
        rules = rules_of(profile)
        result = score_trial(bag, rules)
        categories = expected["tier_2"]["categories"]
        wanted = {name: one["score"] for name, one in categories.items()}
        ours = {name: term(result, rules, TERMS[name]) for name in wanted}
        wanted["tier_3"], ours["tier_3"] = expected["tier_3"]["score"], term(result, rules, "tier_3")
        if "ends" in expected["tier_3"]:
            ends = [f"end_{i}" for i in range(len(expected["tier_3"]["ends"]))]
            formula = Expression.parse("tier_3")
            each = rules.sheet.evaluate_in(
                formula, result.measured.scopes, result.measured.findings, level="connection"
            )
            for end, points in zip(ends, expected["tier_3"]["ends"], strict=True):
                path = next(path for path in each if path.endswith(end))
                wanted[end], ours[end] = points, float(each[path].value)
        if "score" in expected["tier_2"]:
            wanted["tier_2"], ours["tier_2"] = expected["tier_2"]["score"], term(result, rules, "tier_2")
            total = 1 + expected["tier_2"]["score"] + expected["tier_3"]["score"]
            if f"{float(result.score or 0):.12g}" != f"{total:.12g}":
                found.append(f"{profile}: the score is {result.score}, expected {total!r}")
        for name, points in wanted.items():
            if abs(ours[name] - points) > RELATIVE * max(abs(points), abs(ours[name])):
                found.append(f"{profile}: {name} is {ours[name]!r}, expected {points!r}")
        found += [f"{profile}: {words}" for words in miscounted(bag, rules, expected.get("debug", {}))]
    return found


def miscounted(bag: Path, rules: RuleSet, expected: Mapping[str, int]) -> Iterator[str]:
    """Series of other lengths than the scorer's own."""
    consumed = consumed_of(open_trial(bag, rules))
    assert consumed is not None
    ours = {
        "ee_poses": len(consumed.poses),
        "velocities": len(consumed.velocities[0]),
        "wrenches": len(consumed.forces[0]),
    }
    for name, count in expected.items():
        if ours[name] != count:
            yield f"{ours[name]} {name}, expected {count}"


def finals_differences(case: Mapping[str, Any], folder: Path) -> list[str]:
    """The same for the force rule of the finals, whose recordings lie in folders of teams."""
    run = folder / "team/final_eval/trial_1/run_1"
    run.mkdir(parents=True)
    write_bag(run / "rosbag", case["messages"])
    rules, expected = rules_of(case["profile"]), case["expected"]["cables"]
    try:
        result = score_trial(run, rules)
    except NothingToScoreError:
        return [] if not expected else [f"no cable was found, expected {expected}"]
    consumed = consumed_of(open_trial(run, rules))
    assert consumed is not None
    ours = [
        cable_of(FinalsForce(), consumed, number) for number in range(insertions_of(consumed.messages).cables)
    ]
    found = [] if same(ours, expected) else [f"{ours}, expected {expected}"]
    total = sum(cable["penalty"] for cable in expected)
    return found + ([] if float(result.score or 0) == total else [f"{result.score} points, expected {total}"])


def cable_of(rule: FinalsForce, consumed: Any, number: int) -> dict[str, Any]:
    """What cases say of a cable."""
    ends = {}
    for which, name in enumerate(("sfp", "sc")):
        end = rule.end_force(consumed, 2 * number + which)
        ends[name] = end and {
            "avg": end.mean_n,
            "peak": end.peak_n,
            "violations": [list(one) for one in end.violations],
            "first": end.violations[0][0] if end.violations else None,
        }
    begun = sorted((end["first"], name.upper()) for name, end in ends.items() if end and end["violations"])
    return {
        "penalty": -12.0 if begun else 0.0,
        "triggered_by": begun[0][1] if begun else "N/A",
        "switch_found": insertions_of(consumed.messages).by_switch,
        **ends,
    }


def same(ours: Any, expected: Any) -> bool:
    """Whether two documents are the same, numbers within the tolerance."""
    if isinstance(expected, dict):
        return (
            ours is not None
            and expected.keys() == ours.keys()
            and all(same(ours[k], v) for k, v in expected.items())
        )
    if isinstance(expected, list):
        return len(ours) == len(expected) and all(map(same, ours, expected))
    if isinstance(expected, float) and isinstance(ours, int | float):
        return abs(ours - expected) <= RELATIVE * max(1.0, abs(expected))
    return bool(ours == expected)


@pytest.mark.slow
def test_some_cases_are_as_the_official_scorer_has_them(
    folder: Path, tmp_path: Path, subtests: pytest.Subtests, request: pytest.FixtureRequest
) -> None:
    given = request.config.getoption("--aic-cases")
    for case in cases_in(folder):
        if given or case["id"] in QUICK:  # whoever names a folder means all of it
            with subtests.test(case["id"], note=case.get("note", "")):
                assert differences(case, tmp_path / case["id"]) == []


@pytest.mark.slow
def test_all_cases_are_as_the_official_scorer_has_them(
    folder: Path, tmp_path: Path, subtests: pytest.Subtests
) -> None:
    for case in cases_in(folder):
        with subtests.test(case["id"], note=case.get("note", "")):
            assert differences(case, tmp_path / case["id"]) == []


def test_real_results_add_up_in_the_order_of_the_engine(folder: Path, subtests: pytest.Subtests) -> None:
    for file in real_results(folder):
        run = read_official(file)
        with subtests.test(file.name):
            assert run.summed == run.total  # to the bit
        for trial in run.trials:
            second = trial.tiers[1]
            with subtests.test(file.name, trial=trial.id):
                assert sum_in_order(one.score for _, one in second.categories) == second.score


def test_a_real_result_is_written_as_it_was_read(folder: Path, subtests: pytest.Subtests) -> None:
    for file in real_results(folder):
        text = file.read_text(encoding="utf-8")
        with subtests.test(file.name):
            assert written(read_official(file)).rstrip("\n") == text.rstrip("\n")


def test_points_and_words_of_real_results_say_the_same(folder: Path, subtests: pytest.Subtests) -> None:
    for file in real_results(folder):
        for trial in read_official(file).trials:
            with subtests.test(file.name, trial=trial.id):
                assert list(contradictions(trial)) == []


def real_results(folder: Path) -> list[Path]:
    found = [file for file in sorted(folder.rglob("*.yaml")) if file.read_bytes().startswith(b"total:")]
    if not found:
        pytest.skip(f"no result of the engine in {folder}")
    return found


def contradictions(trial: OfficialTrial) -> Iterator[str]:
    """Numbers that a message prints and that do not follow from its points."""
    categories = dict(trial.tiers[1].categories)
    times = times_from(trial, "")
    if times.duration_s is not None:
        if f"Task duration: {times.duration_s:.2f} seconds." != categories["duration"].message:
            yield f"{times.duration_s} s against {categories['duration'].message}"
        if times.exact and round(times.duration_s * 1000) % 2:
            yield f"{times.duration_s} s is no multiple of 2 ms"
    smoothness = categories.get("trajectory smoothness")
    if smoothness and 0 < smoothness.score < 6:
        jerk_m_s3 = 50 - 50 * smoothness.score / 6
        if f"{jerk_m_s3:.2f} m/s^3" not in smoothness.message:
            yield f"{jerk_m_s3} m/s^3 against {smoothness.message}"
    efficiency = categories.get("trajectory efficiency")
    if efficiency and 0 < efficiency.score < 6:
        path_m, start_m = map(float, re.findall(r"([0-9.]+) m", efficiency.message))
        if abs(path_m - start_m - (1 - efficiency.score / 6)) > 0.01:
            yield f"{efficiency.score} points against {efficiency.message}"
