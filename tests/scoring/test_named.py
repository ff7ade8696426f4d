"""Named parameters with units, and extensions that change one number of a check."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score import as_json, load_result, load_rule_set, score_trial
from ariac_score.checks.registry import Registry
from ariac_score.engine.price import reprice
from ariac_score.errors import FormulaError, RuleSetError
from ariac_score.review.sensitivity import knobs_of, with_value
from ariac_score.scoring.named import NamedParameter
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text

EXAMPLE = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"
RULES = """\
id: cup
title: A cup
source: a test
log_map: ariac2020
competition: {use: ariac, with: {edition: 2020}}
parameters:
  points: {unit: points, meaning: what a part earns, right_type: 2, right_color: 0.5 credits}
  near: {value: 0.03, unit: m, meaning: how far a part may lie off}
  turn: 0.1 rad
  price: 0.4
rules:
  part_type: {use: kitting.presence, with: {compare: type}}
  part_color: {use: kitting.presence, with: {compare: type_and_color}}
  part_pose:
    use: kitting.pose
    with:
      max_distance_m: {parameter: near}
      min_quaternion_dot: null
      max_heading_error_rad: {parameter: turn}
terms:
  submission:
    kit: points.right_type * points(part_type) + points.right_color * points(part_color) + points(part_pose)
  order:
    total: sum(submission.kit)
score: sum(order.total) * price
"""
HEAD = "id: mine\ntitle: Mine\nsource: a test\nextends: ./cup.yaml\n"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "cup.yaml").write_text(RULES)
    return tmp_path


def mine(folder: Path, text: str) -> RuleSet:
    (folder / "mine.yaml").write_text(HEAD + text)
    return load_rule_set(str(folder / "mine.yaml"))


def changed(folder: Path, old: str, new: str) -> RuleSet:
    assert old in RULES
    (folder / "cup.yaml").write_text(RULES.replace(old, new))
    return load_rule_set(str(folder / "cup.yaml"))


# Reading them --------------------------------------------------------------------------


def test_each_parameter_has_its_value_unit_and_meaning_under_the_name_formulas_use(folder: Path) -> None:
    assert dict(load_rule_set(folder / "cup.yaml").parameters) == {
        "points.right_type": (2, "points", "what a part earns"),
        "points.right_color": (0.5, "credits", "what a part earns"),
        "near": (0.03, "m", "how far a part may lie off"),
        "turn": (0.1, "rad", ""),
        "price": (0.4, "1", ""),
    }


def test_a_score_is_what_the_same_numbers_written_into_the_formulas_give(folder: Path) -> None:
    plain = RULES.replace("points.right_type", "2").replace("points.right_color", "0.5")
    plain = plain.replace("* price", "* 0.4").replace("{parameter: near}", "0.03")
    plain = plain.replace("{parameter: turn}", "0.1")
    start, end = plain.index("parameters:"), plain.index("rules:\n")
    (folder / "plain.yaml").write_text(plain[:start] + plain[end:])

    named, written = (score_trial(EXAMPLE, str(folder / f"{name}.yaml")) for name in ("cup", "plain"))

    assert named.score is not None
    assert named.score > 0
    assert named.score == written.score
    assert named.checks["part_pose"]["with"] == written.checks["part_pose"]["with"]


def test_a_group_given_to_a_check_is_a_map_of_its_numbers(folder: Path) -> None:
    text = """\
parameters: {sensor_prices: {unit: dollars, camera: 100, logical_camera: 500}}
monitors: {sensor_cost: {use: team.sensor_cost, with: {prices: {parameter: sensor_prices}}}}
"""

    rules = mine(folder, text)

    assert rules.checks["sensor_cost"].parameters == {"prices": {"camera": 100, "logical_camera": 500}}
    assert dict(rules.build(Registry())["sensor_cost"].prices) == {"camera": 100.0, "logical_camera": 500.0}


def test_a_result_holds_the_names_and_units_and_is_priced_again_from_them(folder: Path) -> None:
    result = score_trial(EXAMPLE, str(folder / "cup.yaml"))
    (folder / "result.json").write_text(as_json(result), encoding="utf-8")

    stored = load_result(folder / "result.json")
    kept = rule_set_from_text(stored.rules, file="result")

    assert kept.parameters["near"] == NamedParameter(0.03, "m", "how far a part may lie off")
    assert reprice(stored, kept.with_parameters({"price": 0.8})).score == 2 * result.score  # type: ignore[operator]  # it has a score


# Changing them -------------------------------------------------------------------------


def test_an_extension_changes_one_number_and_the_rest_stays(folder: Path) -> None:
    rules = mine(folder, "parameters: {points: {right_color: 3}, near: 0.05}\n")

    assert rules.parameters["points.right_color"] == (3, "credits", "what a part earns")
    assert rules.parameters["points.right_type"] == (2, "points", "what a part earns")
    assert rules.parameters["near"] == (0.05, "m", "how far a part may lie off")
    assert rules.checks["part_pose"].parameters["max_distance_m"] == 0.05


def test_an_extension_takes_a_parameter_away_with_null(folder: Path) -> None:
    text = "parameters: {price: null, points: {right_color: null}}\nscore: sum(order.total)\n"
    terms = "terms: {submission: {kit: points.right_type * points(part_type)}}\n"

    assert list(mine(folder, text + terms).parameters) == ["points.right_type", "near", "turn"]


def test_what_an_extension_no_longer_uses_is_gone_so_its_expanded_text_stands_alone(
    folder: Path,
) -> None:
    rules = mine(folder, "score: sum(order.total)\n")
    (folder / "alone.yaml").write_text(rules.text)

    assert "price" not in rules.parameters
    assert load_rule_set(folder / "alone.yaml").parameters == rules.parameters


def test_python_changes_a_named_number_wherever_it_is_used(folder: Path) -> None:
    rules = load_rule_set(folder / "cup.yaml").with_parameters({"near": 0.05, "points.right_type": 7})

    assert rules.checks["part_pose"].parameters["max_distance_m"] == 0.05
    assert rules.sheet.parameters["points.right_type"] == 7
    assert rules.parameters["near"].unit == "m"


def test_a_number_set_for_one_check_no_longer_follows_the_name(folder: Path) -> None:
    rules = load_rule_set(folder / "cup.yaml").with_parameters(
        {"part_pose.max_distance_m": 0.07, "turn": 0.2}
    )

    assert rules.checks["part_pose"].parameters["max_distance_m"] == 0.07
    assert rules.checks["part_pose"].named == {"max_heading_error_rad": "turn"}


def test_a_named_number_is_varied_in_formulas_and_in_the_checks_that_take_it(folder: Path) -> None:
    rules = load_rule_set(folder / "cup.yaml")

    knobs = {knob.name: knob for knob in knobs_of(rules, Registry())}

    assert [*knobs] == [*rules.parameters]
    assert all(knob.used for knob in knobs.values())
    assert {name for name, knob in knobs.items() if knob.measured} == {"near", "turn"}
    varied = with_value(rules, knobs["near"], 0.06)
    assert varied.checks["part_pose"].parameters["max_distance_m"] == 0.06


# Deep extends --------------------------------------------------------------------------


def test_one_number_of_a_check_changes_without_the_others_repeated(folder: Path) -> None:
    rules = mine(folder, "rules: {part_pose: {with: {max_distance_m: 0.07}, on_inconclusive: zero}}\n")

    pose = rules.checks["part_pose"]
    assert (pose.use, pose.on_inconclusive) == ("kitting.pose", "zero")
    assert pose.parameters == {
        "max_distance_m": 0.07,
        "min_quaternion_dot": None,
        "max_heading_error_rad": 0.1,
    }


def test_a_check_written_with_its_plugin_replaces_all_of_the_base(folder: Path) -> None:
    rules = mine(folder, "rules: {part_pose: {use: kitting.pose, with: {max_distance_m: 0.07}}}\n")

    assert rules.checks["part_pose"].parameters == {"max_distance_m": 0.07}


@pytest.mark.parametrize(
    ("text", "place", "cause", "hint"),
    [
        (
            "rules: {part_psoe: {with: {max_distance_m: 0.07}}}\n",
            "line 5, $.rules.part_psoe",
            "there is no check 'part_psoe' to change",
            "add 'use'",
        ),
        (
            "parameters: {pirce: 3}\n",
            "line 5, $.parameters.pirce",
            "no formula and no check uses the parameter 'pirce'",
            "did you mean 'price'?",
        ),
        (
            "parameters: {points: {right_tpye: 3}}\n",
            "line 5, $.parameters.points.right_tpye",
            "uses the parameter 'points.right_tpye'",
            "did you mean 'points.right_type'?",
        ),
        ("parameters: {pirce: null}\n", "line 5", "no parameter 'pirce' to take away", "null takes away"),
        (
            "parameters: {near: 3 cm}\n",
            "",
            "'max_distance_m' of kitting.pose is in m, the parameter 'near' in cm",
            "write its number in m",
        ),
    ],
)
def test_an_extension_that_misses_what_it_changes_is_refused(
    folder: Path, text: str, place: str, cause: str, hint: str
) -> None:
    with pytest.raises(RuleSetError) as refused:
        mine(folder, text).build(Registry())

    assert cause in refused.value.cause
    assert place in refused.value.place
    assert hint in refused.value.hint


# Mistakes ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("old", "new", "place", "cause", "hint"),
    [
        (
            "{parameter: near}",
            "{parameter: naer}",
            "line 17, $.rules.part_pose.with.max_distance_m",
            "no parameter 'naer'",
            "'near'",
        ),
        ("0.1 rad", "0.1", "line 19", "is in rad, the parameter 'turn' in 1", "'0.1 rad'"),
        ("0.1 rad", "ten rad", "line 9, $.parameters.turn", "'ten rad'", ""),
        ("0.1 rad", "[0.1]", "line 9, $.parameters.turn", "[0.1] is not of type 'number'", "give a number"),
        ("{value: 0.03, unit: m,", "{value: 0.03, uint: m,", "line 8", "unknown key 'uint'", "'unit'"),
        ("right_type: 2,", "right_type: {worth: 2},", "$.parameters.points.right_type", "", ""),
        (
            "  points: {",
            "  part_type: {",
            "$.parameters.part_type",
            "also the name of a check",
            "another one",
        ),
        (
            "  points: {",
            "  cohort: {",
            "$.parameters.cohort",
            "also the name of a kind of value",
            "another one",
        ),
        ("  price: 0.4", "  price: 0.4\n  spare: 1", "line 11", "uses the parameter 'spare'", "take it out"),
    ],
)
def test_a_mistake_in_a_parameter_is_told_with_its_place(
    folder: Path, old: str, new: str, place: str, cause: str, hint: str
) -> None:
    with pytest.raises(RuleSetError) as refused:
        changed(folder, old, new).build(Registry())

    assert cause in refused.value.cause
    assert place in refused.value.place
    assert hint in refused.value.hint


@pytest.mark.parametrize(
    ("old", "new", "cause", "hint"),
    [
        ("points.right_type *", "points.right_tpye *", "unknown name 'points.right_tpye'", "'right_type'"),
        ("points.right_type *", "points *", "unknown name 'points'", ""),
        ("  points: {", "  order: {", "level 'order' is also the name of a parameter", "one thing"),
        ("    total: sum", "    price: sum", "term 'price' is also the name of a parameter", "one thing"),
        ("    total: sum", "    points: sum", "term 'points' is also the name of a parameter", "one thing"),
    ],
)
def test_a_formula_that_names_no_parameter_is_told_so(
    folder: Path, old: str, new: str, cause: str, hint: str
) -> None:
    with pytest.raises(FormulaError) as refused:
        changed(folder, old, new)

    assert cause in refused.value.cause
    assert hint in refused.value.hint


def test_a_setting_of_several_constants_takes_a_number_for_each(tmp_path: Path) -> None:
    file = tmp_path / "near.yaml"
    file.write_text(
        "id: near\ntitle: Near\nsource: a test\nlog_map: ariac2020\nparameters: {a: 1, b: 2}\n"
        "monitors:\n  m:\n    use: formula.never\n    with:\n      formula: distance < q\n"
        "      constants: {q: {parameter: a}, r: {parameter: b}}\nscore: 1\n"
    )

    assert load_rule_set(file).checks["m"].parameters["constants"] == {"q": 1, "r": 2}
