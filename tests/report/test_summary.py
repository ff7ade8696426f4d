"""What a page and a text say first: a trial in two or three sentences, in the words of its competition."""

from __future__ import annotations

import runpy
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from msgspec import structs

from ariac_score import Finding, Measure, Result, Span, Verdict, score_trial
from ariac_score.report import summary
from ariac_score.report.figures import count_in_words, rounded_points, said
from ariac_score.report.html.parts import parts_of
from ariac_score.report.places import Places
from ariac_score.report.summary import sentences_of, summary_of
from ariac_score.report.text import score_text
from ariac_score.results.safety import safety_checks
from ariac_score.results.sketch import DrawnPath
from ariac_score.review.task_and_safety import TaskAndSafety, task_and_safety
from ariac_score.scoring.ruleset import rule_set_from_text
from ariac_score.scoring.scope import Scope
from ariac_score.testing import write_trial_log
from ariac_score_ariac.testing import kitting_trial

PAGES = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "pages.py")))

NEAR_MISS = "The robot came 0.96 m too near to the human for 2.4 s at 18.8 s; that cost 8.2 of 28 points."


@pytest.fixture(scope="module")
def example() -> Result:
    return PAGES.example()


def with_measured(result: Result, **changes: Any) -> Result:
    return replace(result, measured=replace(result.measured, **changes))


def with_finding(result: Result, key: str, **changes: Any) -> Result:
    findings = dict(result.measured.findings)
    findings[key] = replace(findings[key], **changes)
    return with_measured(result, findings=findings)


# Sentences -----------------------------------------------------------------------------


def test_a_trial_is_told_in_two_sentences(example: Result) -> None:
    work, safety = sentences_of(example)

    assert work == "Two shipments delivered, one wrong colour and one wrong pose."
    assert safety == NEAR_MISS
    # The official score of the example is 28; see examples/README.md. 28 - 19.761677 = 8.238323.


def test_the_text_begins_with_the_same_sentences(example: Result) -> None:
    assert score_text(example).splitlines()[1] == summary_of(example)


def test_a_trial_without_a_fault_says_that(tmp_path: Path) -> None:
    rules = tmp_path / "rules.yaml"
    rules.write_text(
        "id: perfect\ntitle: t\ncompetition: {use: ariac, with: {edition: 2020}}\nsource: s\n"
        "log_map: ariac2020\nrules:\n  right_agv: {use: kitting.destination, with: {compare: agv}}\n"
        "monitors:\n  contact: {use: ariac.no_event, with: {kind: arm_collision}}\n"
        "terms:\n  submission:\n    worth: points(right_agv)\n"
        "score: holds(contact) * sum(submission.worth)\n",
        encoding="utf-8",
    )

    result = score_trial(write_trial_log(tmp_path / "a.jsonl", kitting_trial()), rules)

    assert summary_of(result) == "Two shipments delivered, nothing wrong. No violation of safety."


def test_an_item_with_several_mistakes_counts_once_by_the_first_of_them(example: Result) -> None:
    # Part 2 of the first order has the wrong colour, and so no right pose; its kit misses a part, and has
    # one that is not wanted: one mistake, said of the part.
    wrong = [key for key, f in example.findings.items() if f.verdict is Verdict.VIOLATED]

    assert sorted(wrong) == [
        "none_missing#1",
        "none_unwanted#1",
        "part_color#2",
        "part_pose#2",
        "part_pose#5",
        "separation#1",
    ]
    assert summary_of(example).startswith("Two shipments delivered, one wrong colour and one wrong pose.")


def test_what_was_never_delivered_is_said_and_has_no_mistakes(example: Result) -> None:
    sketch = example.measured.sketch
    assert sketch is not None
    one = with_measured(example, sketch=replace(sketch, brought=sketch.brought[1:]))
    none = with_measured(example, sketch=replace(sketch, brought=()))
    unseen = with_measured(none, witnessed=())

    assert sentences_of(one)[0] == "One of two shipments delivered, one wrong pose."
    assert sentences_of(none)[0] == "Nothing delivered of two shipments."
    assert sentences_of(unseen)[0] == "Two shipments, no delivery recorded."


def test_a_trial_without_work_says_so_in_the_words_of_its_competition(example: Result) -> None:
    empty = with_measured(example, scopes=Scope("trial", "", {"orders": 0, "duration_s": 1.0}))

    assert sentences_of(empty)[0] == "No order was announced."


def test_without_words_for_a_mistake_the_check_is_named(example: Result) -> None:
    settings = {name: structs.replace(one, mistake=()) for name, one in example.measured.settings.items()}  # type: ignore[union-attr]

    (work, _) = sentences_of(with_measured(example, settings=settings))

    assert work == "Two shipments delivered, one mistake in part colour and one mistake in part pose."


def test_undecided_safety_is_never_said_to_be_kept(example: Result) -> None:
    open_ = with_finding(example, "separation#1", verdict=Verdict.INCONCLUSIVE)

    assert sentences_of(open_)[1] == (
        "Whether it was safe is undecided; with what was not seen that cost 8.2 of 28 points."
    )


def withholding(folder: Path) -> Path:
    """The paper's rules with no score while anything is open."""
    rules = folder / "withholding.yaml"
    extended = "extends: paper2020.published, log_map: ariac2020, open: withhold"
    rules.write_text(
        f"{{id: withholding, title: paper2020.published, source: test, {extended}}}", encoding="utf-8"
    )
    return rules


def test_a_score_that_is_withheld_says_why(tmp_path: Path) -> None:
    log = write_trial_log(tmp_path / "a.jsonl", kitting_trial(human=False), signals=("speed/robot",))

    told = summary_of(score_trial(log, withholding(tmp_path)))

    assert "neither counts until that is decided" in told
    assert "undecided" in told


@pytest.mark.parametrize(
    ("finding", "words"),
    [
        (
            Finding.violated("robot/human", "contact at 3.0 s"),
            "Robot and human: contact at 3.0 s; that cost 8.2 of 28 points.",
        ),
        (
            Finding("trial", Verdict.VIOLATED, "a gate was open", Span(3.0, 4.0)),
            "A gate was open, at 3 s; that cost 8.2 of 28 points.",
        ),
    ],
)
def test_a_violation_without_a_margin_is_told_in_the_words_of_its_check(
    example: Result, finding: Finding, words: str
) -> None:
    findings = {**example.findings, "separation#1": replace(finding, check="separation")}

    told = told_with(example, findings)

    assert told.endswith(words)


def told_with(result: Result, findings: Any) -> str:
    """The sentences of a result with other findings, priced as before: only what is said is tried."""
    split = task_and_safety(result)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(summary, "task_and_safety", lambda *_: split)
        return summary_of(with_measured(result, findings=findings))


def test_sentences_show_nothing_that_steers_a_terminal_or_the_direction_of_writing() -> None:
    told = summary_of(PAGES.hostile())

    assert told.isprintable()
    assert len(told) < 1000


# Task and safety -----------------------------------------------------------------------


def test_task_is_the_score_with_every_check_of_safety_kept(example: Result) -> None:
    assert task_and_safety(example) == TaskAndSafety(Decimal("28.000000"), Decimal("-8.238323"))


def test_monitors_are_about_safety_and_rules_about_the_task_unless_they_say_otherwise(
    example: Result,
) -> None:
    rules = rule_set_from_text(example.rules, file="rules")
    settings = dict(example.measured.settings or {})
    settings["human_contact"] = structs.replace(settings["human_contact"], part_of="task")
    settings["right_agv"] = structs.replace(settings["right_agv"], part_of="safety")

    assert safety_checks(rules, example.measured) == ("no_arm_collision", "separation", "human_contact")
    assert safety_checks(rules, with_measured(example, settings=settings).measured) == (
        "right_agv",
        "no_arm_collision",
        "separation",
    )


def test_without_a_score_there_are_no_parts(tmp_path: Path) -> None:
    log = write_trial_log(tmp_path / "a.jsonl", kitting_trial(human=False), signals=("speed/robot",))

    assert task_and_safety(score_trial(log, withholding(tmp_path))) is None


def test_the_bars_share_one_scale_and_safety_ends_where_the_score_does(example: Result) -> None:
    split = task_and_safety(example)
    assert split is not None

    task, safety, score = parts_of(example, split).bars

    # Of 36 possible points: 28 is 77.778 %, 19.761677 is 54.894 %.
    assert (task.left, task.width) == (0.0, 77.778)
    assert (safety.left, safety.left + safety.width) == (54.894, pytest.approx(77.778))
    assert (score.left, score.width) == (0.0, 54.894)


def test_a_negative_score_is_a_bar_to_the_left_of_zero(example: Result) -> None:
    parts = parts_of(replace(example, possible=Decimal(10)), TaskAndSafety(Decimal(5), Decimal(-15)))

    task, safety, score = parts.bars
    assert parts.zero == 50.0
    assert (task.left, task.width) == (50.0, 25.0)
    assert (safety.left, safety.width) == (0.0, 75.0)
    assert (score.left, score.width) == (0.0, 50.0)


def test_rules_without_safety_have_one_bar(example: Result) -> None:
    (bar,) = parts_of(example, TaskAndSafety(Decimal(18), Decimal(0), has_safety=False)).bars

    assert (bar.label, bar.width, bar.has_possible) == ("Task", 50.0, True)


# Places and figures --------------------------------------------------------------------


@pytest.mark.parametrize(
    ("subject", "words"),
    [
        ("order_0", "order 1"),
        ("order_0/order_0_shipment_0", "shipment 1 of order 1"),
        ("order_0/order_0_shipment_0/part_1", "part 2 of shipment 1, order 1"),
        ("order_0/order_0_shipment_0/part_1/screw", "screw of part 2, shipment 1, order 1"),
        ("robot/human", "robot and human"),
        ("trial", "the trial"),
        ("gantry", "gantry"),
    ],
)
def test_a_path_is_said_in_the_words_of_the_competition(example: Result, subject: str, words: str) -> None:
    assert Places(example).of(subject) == words


def test_an_id_may_say_what_kind_of_work_it_is(example: Result) -> None:
    kits = [Scope("submission", f"order_0/order_0_{kind}_shipment_0", {}) for kind in ("kitting", "assembly")]
    scopes = Scope("trial", "", {}, (Scope("order", "order_0", {}, tuple(kits)),))
    places = Places(replace(example, measured=replace(example.measured, scopes=scopes)))

    assert [places.own(kit.path) for kit in kits] == ["kitting shipment 1", "assembly shipment 2"]


def test_an_id_that_is_a_name_is_kept(example: Result) -> None:
    scopes = Scope("trial", "", {}, (Scope("order", "KITT0001", {}), Scope("order", "7", {})))

    places = Places(with_measured(example, scopes=scopes))

    assert (places.of("KITT0001"), places.of("7")) == ("order KITT0001", "order 2")


def test_a_long_or_hostile_id_is_cut_and_made_harmless(example: Result) -> None:
    name = "\u202e" + "x" * 500
    places = Places(with_measured(example, scopes=Scope("trial", "", {}, (Scope("order", name, {}),))))

    assert places.of(name) == "order \\u202e" + "x" * 33 + "\u2026"


def test_a_body_has_its_kind_before_its_name_where_the_log_shows_it(example: Result) -> None:
    finding = replace(example.findings["separation#1"], subject="gantry/ann")
    sketch = example.measured.sketch
    assert sketch is not None
    curves = tuple(replace(c, subject="gantry/ann") for c in sketch.curves)
    routes = tuple(
        DrawnPath(b, k, (0.0,), (0.0,), (0.0,)) for b, k in (("gantry", "robot"), ("ann", "human"))
    )

    told = told_with(
        with_measured(example, sketch=replace(sketch, curves=curves, routes=routes)),
        {**example.findings, "separation#1": finding},
    )

    assert "The robot gantry came 0.96 m too near to the human ann for" in told


@pytest.mark.parametrize(
    ("points", "digits", "shown"),
    [
        ("19.761677", 6, "19.76"),
        ("0.312508", 6, "0.313"),
        ("28.000000", 6, "28.00"),
        ("0.004216", 6, "0.00422"),
        ("577.8", 1, "577.8"),
        ("12", 0, "12"),
        ("-8.235", 6, "-8.24"),
    ],
)
def test_a_headline_has_the_digits_that_mean_something(points: str, digits: int, shown: str) -> None:
    assert str(rounded_points(Decimal(points), digits)) == shown


def test_small_numbers_are_words_and_large_ones_figures() -> None:
    assert [count_in_words(n) for n in (0, 1, 12, 13)] == ["no", "one", "twelve", "13"]
    assert said(18.81, 3) == "18.8"


def test_a_result_without_a_sketch_is_told_without_deliveries(example: Result) -> None:
    told = sentences_of(with_measured(example, sketch=None))

    assert told[0] == "Two orders, one wrong colour and one wrong pose."
    assert "too close for 2.40 s" in told[1]


def test_a_rule_whose_quantities_can_only_take_is_about_safety(example: Result) -> None:
    rules = rule_set_from_text(example.rules, file="rules")
    takes = {"right_agv": {"off_road": Measure("1", "penalty"), "slow": Measure("1", "factor")}}
    earns = {"right_agv": {"off_road": Measure("1", "penalty"), "driven": Measure("points", "points")}}

    assert "right_agv" in safety_checks(rules, with_measured(example, measures=takes).measured)
    assert "right_agv" not in safety_checks(rules, with_measured(example, measures=earns).measured)
