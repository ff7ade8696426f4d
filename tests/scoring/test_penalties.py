"""Penalties: what each makes of points and violations, by hand; what may be overridden; what is refused."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pytest

from ariac_score import as_json, load_result, load_rule_set, score_trial
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.cli import main
from ariac_score.engine.price import reprice
from ariac_score.errors import FormulaError, RuleSetError
from ariac_score.review.laws.reference import reference_rules
from ariac_score.scoring.penalties import load_penalty, penalty_names
from ariac_score.scoring.pricing import value_of
from ariac_score.scoring.ruleset import RuleSet, expanded_yaml, rule_set_from_text, rule_set_names
from ariac_score.scoring.scope import Scope
from ariac_score.trial.spans import Span

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/kitting_near_miss.mcap"
HEAD = "id: mine\ntitle: Mine\nsource: a test\nextends: paper2020.published\nscore: task\n"
SAFETY = "safety:\n  separation: {class: separation}\n  human_contact: {class: contact}\n"
INCLUDE = "include: [penalty.gated_hyperbolic]\n"
PEAK, AREA_S = 0.175139841739, 0.211047173309
"""Of the only breach of the example, as its finding has them: greatest relative depth, and its integral."""


def charge(again_after_s: float = 5) -> float:
    """One rise and fall costs its peak, and its integral over the time that is charged after it."""
    return PEAK + AREA_S / again_after_s


def _file(folder: Path, text: str, name: str = "mine.yaml") -> str:
    (folder / name).write_text(text)
    return str(folder / name)


# The score of a made trial: 10 parts of which `right` are right, and something unwanted or not;
# one breach of separation of 4 s, and 20 s later `contacts` touches of 0.5 s, 10 s apart.
PARTS = 10


def priced(
    rule_set: RuleSet, *, right: int = 10, unwanted: bool = False, contacts: int = 1, critical: bool = False
) -> float:
    path = "order_0/task_0"
    findings = [
        Finding(
            f"{path}/part_{i}", Verdict.SATISFIED if i < right else Verdict.VIOLATED, "m", check="part_color"
        )
        for i in range(PARTS)
    ]
    findings += [
        Finding(path, Verdict.VIOLATED if unwanted else Verdict.SATISFIED, "m", check="none_unwanted"),
        Finding("trial", Verdict.SATISFIED, "m", check="arm_collision"),
        Finding(
            "robot/human",
            Verdict.VIOLATED,
            "m",
            span=Span(10, 14),
            quantities={"time_in_violation_s": 4.0, "relative_depth_integral_s": 1.0},
            check="separation",
        ),
    ]
    for number in range(contacts):
        span = Span(34 + 10 * number, 34.5 + 10 * number)
        findings.append(
            Finding("robot/human", Verdict.VIOLATED, "m", span=span, critical=critical, check="human_contact")
        )
    if not contacts:
        findings.append(Finding("robot/human", Verdict.SATISFIED, "m", check="human_contact"))
    numbered = {f"{finding.check}#{n}": finding for n, finding in enumerate(findings)}
    parts = tuple(Scope("part", f"{path}/part_{i}") for i in range(PARTS))
    order = Scope("order", "order_0", {"index": 0}, (Scope("task", path, {"parts": PARTS}, parts),))
    trial = Scope("trial", "", {"duration_s": 100.0, "orders": 1}, (order,))
    value = value_of(numbered, trial, rule_set.sheet, rule_set.policies)
    assert value is not None
    return value


GATED = 1 / (1 + 0.4 * (1 + 4 / 5) + 1.0 * (1 + 0.5 / 5))  # demerits 0.72 and 1.1


@pytest.mark.parametrize(
    ("name", "case", "expected"),
    [
        ("gated_hyperbolic", {}, 10 * GATED),
        ("gated_hyperbolic", {"contacts": 0}, 10 / 1.72),
        ("gated_hyperbolic", {"critical": True}, 0),
        ("gated_hyperbolic", {"right": 0, "unwanted": True}, -2 * (2 - GATED)),  # mirrored
        ("gated_hyperbolic", {"right": 0, "unwanted": True, "critical": True}, -4),
        ("gated_hyperbolic", {"right": 2, "unwanted": True}, 0),
        ("gate", {}, 0),
        ("hyperbolic", {}, 10 / (1 + 0.4 + 1.0)),
        ("hyperbolic", {"contacts": 3}, 10 / (1 + 0.4 + 3.0)),
        ("product", {}, 10 / 1.4 / 2),
        ("product", {"contacts": 3}, 10 / 1.4 / 8),
        ("subtractive", {}, 10 - 10 * 1.4),
        ("occurrences_per_5_s", {}, 10 - 10 * 1.4),  # both shorter than 5 s
        (
            "multiplier_times_weighted_mean",
            {},
            10 * (1 + 0.4 * 0.96 + 1.0 * 0.995 + 0.7) / (1 + 0.4 + 1.0 + 0.7),
        ),
        ("multiplier_times_weighted_mean", {"critical": True}, 0),
        ("lexicographic", {}, 10 - 1000 * (0.72 + 1.1)),
    ],
)
def test_a_penalty_gives_what_it_gives_by_hand(name: str, case: dict[str, int], expected: float) -> None:
    assert priced(reference_rules(f"penalty.{name}"), **case) == pytest.approx(expected)  # type: ignore[arg-type]


def test_every_shipped_penalty_is_priced_by_hand_above_and_is_no_rule_set() -> None:
    assert {name.removeprefix("penalty.") for name in penalty_names()} == {
        "gate",
        "gated_hyperbolic",
        "hyperbolic",
        "lexicographic",
        "multiplier_times_weighted_mean",
        "occurrences_per_5_s",
        "product",
        "subtractive",
    }
    assert not set(penalty_names()) & set(rule_set_names())
    for name in penalty_names():
        assert load_penalty(name, folder=ROOT).id == name


# On a real log -------------------------------------------------------------------------


def test_the_example_under_the_default_penalty_is_worth_28_through_1_087(tmp_path: Path) -> None:
    # One breach from 18.81 s to 21.21 s: demerits 0.4 * (0.1751 + 0.2110 / 5) = 0.0869
    result = score_trial(EXAMPLE, _file(tmp_path, HEAD + INCLUDE + SAFETY))

    assert result.score == Decimal("25.760398")
    assert result.ledger is not None
    # 30 earned with the bonus of a kit that lacks a part; of these 25.760398 are left.
    (taken,) = [line for line in result.ledger.walk() if line.path == "score/taken"]
    assert taken.amount == Decimal("25.760398") - 30


def test_a_rule_set_without_a_penalty_is_not_touched() -> None:
    assert score_trial(EXAMPLE, "paper2020.published").score == Decimal("19.761677")


def test_a_result_with_a_penalty_can_be_read_back_and_priced_by_it_again(tmp_path: Path) -> None:
    mine = load_rule_set(_file(tmp_path, HEAD + INCLUDE + SAFETY))
    (tmp_path / "result.json").write_text(
        as_json(score_trial(EXAMPLE, "paper2020.published")), encoding="utf-8"
    )

    again = reprice(load_result(tmp_path / "result.json"), mine)
    (tmp_path / "again.json").write_text(as_json(again), encoding="utf-8")

    assert load_result(tmp_path / "again.json").score == Decimal("25.760398")


def test_the_expanded_rule_set_stands_alone_in_plain_terms(tmp_path: Path) -> None:
    mine = load_rule_set(_file(tmp_path, HEAD + INCLUDE + SAFETY))

    alone = rule_set_from_text(expanded_yaml(mine), file="alone")

    assert "include" not in alone.expanded
    assert "safety" not in alone.expanded
    assert alone.expanded["terms"]["trial"]["earned"] == "task"
    assert alone.parameters["weight_of_separation"].value == 0.4
    assert (
        alone.sheet.priced
        == {"separation", "human_contact"} | load_rule_set("paper2020.published").sheet.priced
    )


def test_the_hash_covers_the_penalty(tmp_path: Path) -> None:
    text = (ROOT / "rules/penalty/gate.yaml").read_text()
    _file(tmp_path, text, "ours.yaml")
    mine = _file(tmp_path, HEAD + "include: [ours.yaml]\n" + SAFETY)
    before = load_rule_set(mine).sha256
    _file(tmp_path, text.replace("holds(CHECK)", "holds(CHECK) * 1"), "ours.yaml")

    assert load_rule_set(mine).sha256 != before


@pytest.mark.parametrize("name", penalty_names())
def test_every_number_of_a_shipped_penalty_says_what_it_means(name: str) -> None:
    parameters = reference_rules(name).parameters

    assert [one for one, stated in parameters.items() if not stated.meaning] == []


def test_a_number_of_a_penalty_has_the_unit_its_file_states() -> None:
    parameters = reference_rules("penalty.lexicographic").parameters

    assert parameters["safety_again_after_s"][:2] == (5, "s")
    assert parameters["points_per_demerit"][:2] == (1000, "points")


def test_a_weight_says_what_its_class_is(tmp_path: Path) -> None:
    safety = "safety: {separation: {class: ours, weight: 0.3}, human_contact: {class: contact, weight: 2}}\n"

    parameters = load_rule_set(_file(tmp_path, HEAD + INCLUDE + safety)).parameters

    assert (
        parameters["weight_of_separation"].meaning == "what a violation of separation weighs, of class ours"
    )
    assert parameters["weight_of_human_contact"].value == 2
    assert parameters["weight_of_human_contact"].meaning.endswith("of class contact (a human was touched)")


# Overriding ----------------------------------------------------------------------------


def test_a_plain_number_keeps_unit_and_meaning_of_the_penalty_s_own(tmp_path: Path) -> None:
    text = HEAD + INCLUDE + SAFETY
    before = load_rule_set(_file(tmp_path, text)).parameters["safety_again_after_s"]
    plain = load_rule_set(_file(tmp_path, text + "parameters: {safety_again_after_s: 10}\n"))
    mapped = load_rule_set(
        _file(tmp_path, text + "parameters: {safety_again_after_s: {value: 9, meaning: Ours}}\n")
    )

    assert plain.parameters["safety_again_after_s"] == before._replace(value=10)
    assert mapped.parameters["safety_again_after_s"] == (9, "s", "Ours")


def test_a_parameter_of_a_penalty_cannot_be_taken_away(tmp_path: Path) -> None:
    with pytest.raises(RuleSetError, match="no parameter 'safety_again_after_s' to take away"):
        load_rule_set(_file(tmp_path, HEAD + INCLUDE + SAFETY + "parameters: {safety_again_after_s: null}\n"))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("terms: {trial: {safety_multiplier: 1 / (1 + 2 * safety_demerits)}}\n", 28 / (1 + 0.8 * charge())),
        ("parameters: {safety_again_after_s: 10}\n", 28 / (1 + 0.4 * charge(10))),
        ("terms: {trial: {safety_gate: 0}}\n", 0),
    ],
)
def test_a_term_or_parameter_of_the_rule_set_itself_wins(tmp_path: Path, text: str, expected: float) -> None:
    result = score_trial(EXAMPLE, _file(tmp_path, HEAD + INCLUDE + SAFETY + text))

    assert float(result.score or 0) == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("safety", "expected"),
    [
        (
            "{separation: {class: separation, weight: 1}, human_contact: {class: contact}}",
            28 / (1 + charge()),
        ),
        ("{separation: {class: separation}, scale: 2}", 28 / (1 + 0.8 * charge())),
        ("{separation: {class: separation}, scale: 0}", 28),
        ("{separation: {class: informational}}", 28),
        ("{separation: {class: ours, weight: 0.4}}", 28 / (1 + 0.4 * charge())),
    ],
)
def test_weight_and_scale_are_the_organisers(tmp_path: Path, safety: str, expected: float) -> None:
    result = score_trial(EXAMPLE, _file(tmp_path, HEAD + INCLUDE + f"safety: {safety}\n"))

    assert float(result.score or 0) == pytest.approx(expected, abs=1e-6)


def test_another_rule_set_may_change_weights_or_the_penalty_of_the_one_it_extends(tmp_path: Path) -> None:
    _file(tmp_path, HEAD + INCLUDE + SAFETY, "base.yaml")
    head = "id: other\ntitle: Other\nsource: a test\nextends: ./base.yaml\n"
    heavier = _file(tmp_path, head + "safety: {separation: {class: separation, weight: 1}}\n")
    gate = _file(tmp_path, head + "include: [penalty.gate]\n", "gate.yaml")

    assert float(score_trial(EXAMPLE, heavier).score or 0) == pytest.approx(28 / (1 + charge()), abs=1e-6)
    assert score_trial(EXAMPLE, gate).score == 0


def test_a_check_that_is_not_critical_leaves_the_gate_open(tmp_path: Path) -> None:
    safety = "safety: {separation: {class: separation, critical: false}, human_contact: {class: contact}}\n"
    sheet = load_rule_set(_file(tmp_path, HEAD + INCLUDE + safety)).expanded["terms"]["trial"]

    assert sheet["safety_gate"] == "gate(human_contact)"


@pytest.mark.parametrize(
    ("join", "score"),
    [
        (" + ", 28.0),  # a sum over no checks is 0
        (" * ", 27.0),  # a product over no checks is 1
        (", ", 28.0),  # and a function of no checks charges nothing
    ],
)
def test_where_no_check_is_left_a_sum_takes_nothing(tmp_path: Path, join: str, score: float) -> None:
    each = "WEIGHT * count(CHECK)" if join != ", " else "CHECK=WEIGHT"
    _file(
        tmp_path,
        "id: penalty.ours\ntitle: Ours\nsource: a test\nin_words: less what violations weigh\nterms:\n"
        f'  ours: {{each: {each}, join: "{join}", of: weighty}}\n'
        "  penalised_score: earned - ours\n",
        "ours.yaml",
    )
    safety = "safety: {separation: {class: informational}}\n"

    result = score_trial(EXAMPLE, _file(tmp_path, HEAD + "include: [ours.yaml]\n" + safety))
    assert float(result.score or 0) == pytest.approx(score)


# Refused -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "cause", "hint"),
    [
        ("include: [penalty.gated]\n" + SAFETY, "no penalty 'penalty.gated'", "penalty.gate"),
        (
            "include: [paper2020.published]\n" + SAFETY,
            "no penalty 'paper2020.published'",
            "installed penalties",
        ),
        ("include: [./nowhere.yaml]\n" + SAFETY, "no such file", "check the path"),
        ("include: []\n" + SAFETY, "should be non-empty", ""),
        ("include: [penalty.gate, penalty.product]\n" + SAFETY, "too long", ""),
        (INCLUDE, "'include' needs 'safety' as well", "include one penalty"),
        (INCLUDE + "safety: {scale: 2}\n", "'include' needs 'safety' as well", "checks it charges"),
        (SAFETY, "'safety' needs 'include' as well", "include one penalty"),
        (
            INCLUDE + "safety: {seperation: {class: separation}}\n",
            "'seperation', which is no check",
            "'separation'?",
        ),
        (INCLUDE + "safety: {separation: {class: near}}\n", "class 'near' has no weight", "needs 'weight:'"),
        (INCLUDE + "safety: {separation: {weight: 1}}\n", "key 'class' is missing", "add 'class'"),
        (
            INCLUDE + "safety: {separation: {class: contact, weight: -1}}\n",
            "less than the minimum",
            "Demerits",
        ),
        (
            INCLUDE + "safety: {separation: {class: contact}, scale: -1}\n",
            "less than the minimum",
            "multiplied",
        ),
        (
            INCLUDE + "safety: {separation: {class: contact, wieght: 1}}\n",
            "unknown key 'wieght'",
            "'weight'?",
        ),
        (
            INCLUDE + SAFETY + "terms: {trial: {earned: 1}}\n",
            "'earned' is the penalty's name",
            "rename yours",
        ),
        (
            INCLUDE + SAFETY + "parameters: {weight_of_separation: 1}\n",
            "set by 'safety' as well",
            "rename yours",
        ),
        (INCLUDE + SAFETY + "parameters: {safety_gate: 1}\n", "also a term of penalty.gated", "rename yours"),
        ("ranges: {separation_weight: [1, 0.1]}\n", "goes from 1 to 0.1", "the lower value first"),
        ("ranges: {separation_weight: [1, 1]}\n", "goes from 1 to 1", "the lower value first"),
        ("ranges: {seperation_weight: [0.1, 1]}\n", "no such parameter", "'separation_weight'?"),
        ("ranges: {seperation.delta_m: [0.1, 1]}\n", "no such check", "'separation'?"),
    ],
)
def test_a_mistaken_penalty_is_refused_with_its_place(
    tmp_path: Path, text: str, cause: str, hint: str
) -> None:
    with pytest.raises(RuleSetError) as refused:
        load_rule_set(_file(tmp_path, HEAD + text))

    assert cause in str(refused.value)
    assert hint in refused.value.hint
    assert ".yaml" in str(refused.value)


@pytest.mark.parametrize(
    "terms",
    ["{}", "{penalised_score: earned * gaet}", "{penalised_score: {each: count(CHECK)}}", "{x: 1}"],
)
def test_a_mistaken_file_of_a_penalty_is_refused(tmp_path: Path, terms: str) -> None:
    _file(tmp_path, f"id: ours\ntitle: T\nsource: s\nin_words: w\nterms: {terms}\n", "ours.yaml")

    with pytest.raises((RuleSetError, FormulaError)):
        load_rule_set(_file(tmp_path, HEAD + "include: [ours.yaml]\n" + SAFETY))


def test_what_a_result_holds_as_rules_may_include_nothing() -> None:
    text = "id: a\ntitle: T\nsource: s\nlog_map: ariac2020\nscore: 1\n" + INCLUDE

    with pytest.raises(RuleSetError, match="stand alone"):
        rule_set_from_text(text, file="a result")


def test_a_mistaken_weight_on_the_command_line_is_a_usage_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = main(
        ["rules", "validate", _file(tmp_path, HEAD + INCLUDE + "safety: {separation: {class: near}}\n")]
    )

    assert code == 4
    assert "class 'near' has no weight" in capsys.readouterr().err
