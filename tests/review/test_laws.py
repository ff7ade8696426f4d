"""The laws of penalties: that each finds what breaks it, and that the default penalty keeps them all."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.checks.registry import Registry
from ariac_score.cli import main
from ariac_score.documents.schema import schema
from ariac_score.review.laws.cases import Case, Violation, World
from ariac_score.review.laws.laws import LAWS
from ariac_score.review.laws.prices import ALL_LAWS
from ariac_score.review.laws.proving import (
    Outcome,
    about_humans,
    check_laws,
    event_checks,
    paid_quantities,
    ungraded_checks,
)
from ariac_score.review.laws.reference import DEFAULT, REFERENCE_EVENTS, reference_rules
from ariac_score.review.proofs.penalties_page import penalties_page
from ariac_score.review.proofs.proving import Judged
from ariac_score.review.proofs.words import judged_lines
from ariac_score.scoring.penalties import penalty_names
from ariac_score.scoring.ruleset import RuleSet, draft_rule_set, load_rule_set, rule_set_names

ROOT = Path(__file__).parents[2]
REGISTRY = Registry()
MADE = """\
id: made
title: Made
source: a test
log_map: ariac2020
competition: {use: ariac}
rules:
  part_color: {use: kitting.presence, with: {compare: type_and_color}}
monitors:
  separation: {use: iso_ts_15066.ssm_separation, with: {profile: seed}, on_inconclusive: POLICY}
  dropped: {use: ariac.no_event, with: {kind: part_dropped}}
terms:
  submission: {kit: points(part_color)}
  trial: {earned: sum(submission.kit)}
score: SCORE
"""


def made(score: str, policy: str = "withhold") -> RuleSet:
    return draft_rule_set(MADE.replace("SCORE", score).replace("POLICY", policy), file="made.yaml")


def events(rule_set: RuleSet) -> frozenset[str]:
    return REFERENCE_EVENTS if rule_set.id == "reference" else event_checks(rule_set, REGISTRY)


def verdicts(rule_set: RuleSet, *, cases: int = 150, seed: int = 0) -> dict[str, str]:
    found = check_laws(rule_set, cases=cases, seed=seed, events=events(rule_set))
    return {o.law.name: o.verdict for o in found}


def outcome(rule_set: RuleSet, law: str, cases: int = 400) -> Outcome:
    found = {o.law.name: o for o in check_laws(rule_set, cases=cases, events=events(rule_set))}
    return found[law]


# The default ---------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_default_penalty_keeps_every_law(seed: int) -> None:
    assert verdicts(reference_rules(DEFAULT), seed=seed) == {law.name: "holds" for law in LAWS}


@pytest.mark.slow
@pytest.mark.parametrize("policy", ["withhold", "worst_case"])
def test_it_keeps_them_whatever_undecided_means_and_for_points_that_grow(policy: str) -> None:
    safety = "  separation: {class: separation}\n  dropped: {class: limit}"
    score = f"earned ** 2\ninclude: [{DEFAULT}]\nsafety:\n{safety}"
    text = MADE.replace("SCORE", score).replace("POLICY", policy).replace("trial: {earned:", "trial: {parts:")
    rule_set = draft_rule_set(text.replace("earned ** 2", "parts ** 2"), file="made.yaml")

    assert set(verdicts(rule_set).values()) == {"holds"}


@pytest.mark.slow
def test_no_other_shipped_penalty_keeps_them_all() -> None:
    for name in penalty_names():
        assert ("broken" in verdicts(reference_rules(name)).values()) == (name != DEFAULT), name


# Each law finds what breaks it ---------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("score", "policy", "broken"),
    [
        ("earned + count(separation)", "withhold", "more_violations"),
        ("earned / (1 + demerits(separation, tau_s=5))", "withhold", "more_violations"),
        ("0 - earned", "withhold", "more_points"),
        ("earned / trial.duration_s", "withhold", "waiting"),
        ("earned * max(0, 1 - seconds(separation) / trial.duration_s)", "withhold", "waiting"),
        ("earned - occurrences(separation, every_s=2)", "withhold", "log_rate"),
        ("earned - 3 * count(dropped)", "withhold", "doing_nothing"),
        ("earned * product(separation, p=0.5)", "withhold", "stopping_early"),
        ("earned * gate(separation) if count(separation) < 2 else 0", "withhold", "stopping_early"),
        # Three pieces with a violation each: 3 * (1 - 3 / 4) is less than 2 * (1 - 2 / 4).
        ("earned * (1 - clip(count(dropped), 0, 3) / 4)", "withhold", "stopping_early"),
        ("earned / (1 + charged(separation=0.4))", "exclude", "unknown"),
        ("earned / (1 + count(separation))", "worst_case", "unknown"),
        ("0 - charged(separation=0.4)", "zero", "unknown"),
        ("earned - 0.1 * seconds(separation)", "withhold", "short_pause"),
    ],
)
def test_a_rule_set_that_breaks_a_law_is_found_out(score: str, policy: str, broken: str) -> None:
    assert verdicts(made(score, policy))[broken] == "broken"


@pytest.mark.parametrize(
    ("score", "idle"),
    [
        (
            "earned",
            {"more_violations", "log_rate", "doing_nothing", "stopping_early", "short_pause"},
        ),
        ("earned - count(dropped)", {"log_rate", "short_pause"}),
        ("holds(separation)", {"more_points", "doing_nothing", "stopping_early"}),
    ],
)
def test_a_law_that_says_nothing_about_a_rule_set_says_why(score: str, idle: set[str]) -> None:
    found = check_laws(made(score), cases=20, events=events(made(score)))

    assert {o.law.name for o in found if o.verdict == "not_applicable"} == idle
    assert all(o.reason for o in found if o.verdict == "not_applicable")


def test_a_score_that_never_has_a_value_is_said_to_be_untried() -> None:
    found = outcome(made("earned / (1 - 1)"), "waiting", cases=10)

    assert (found.verdict, found.cases) == ("untried", 0)
    assert "division by zero" in found.reason


# Counter-examples ----------------------------------------------------------------------


@pytest.mark.slow
def test_the_counter_example_to_counting_episodes_is_the_smallest_there_is() -> None:
    found = outcome(load_rule_set("paper2020.published"), "more_violations")

    assert found.situation is not None
    assert found.broken is not None
    assert found.situation.case.orders == ((1,),)
    assert len(found.situation.case.violations) == 2
    assert found.situation.case.failed == frozenset()
    # A part is worth 4. Two breaches of 0.1 s: 0.4 * (2 + 0.2 / 5) demerits;
    # bridged, one of 0.3 s: 0.4 * (1 + 0.3 / 5).
    assert found.broken.first_score == pytest.approx(4 / (1 + 0.4 * 2.04))
    assert found.broken.second_score == pytest.approx(4 / (1 + 0.4 * 1.06))


@pytest.mark.slow
def test_a_counter_example_is_told_in_words() -> None:
    rules = made("earned + count(dropped)")
    found = outcome(rules, "more_violations")
    lines = list(judged_lines(Judged(found.law, "refuted", exploit=found), rules.sheet.levels))

    assert lines == [
        "BROKEN          more violations never help",
        "    1 part; all of the task satisfied; no violations",
        "               1  as it is",
        "               2  with one more violation, dropped of robot/human_1 at 0 s",
    ]


@pytest.mark.slow
def test_the_same_seed_gives_the_same_counter_example_and_another_need_not() -> None:
    rules = load_rule_set("paper2020.published")

    assert check_laws(rules, cases=60, seed=5) == check_laws(rules, cases=60, seed=5)


# Made findings -------------------------------------------------------------------------


def world() -> World:
    return World(made("earned - charged(separation=1) - count(dropped)"), frozenset({"dropped"}))


def test_the_findings_of_a_case_are_those_a_monitor_would_make() -> None:
    violations = (
        Violation("separation", 0, 10, 20, 0.5),
        Violation("separation", 0, 25, 30, 1.0, critical=True),  # 0.5 s later: bridged
        Violation("separation", 0, 40, 41),  # 1.0 s later: not bridged
    )
    found = [
        f for f in world().findings(Case(((1,),), violations=violations)).values() if f.check == "separation"
    ]

    assert [(f.span.start_s, f.span.end_s) for f in found if f.span] == [(1.0, 3.0), (4.0, 4.1)]
    assert [f.quantities["time_in_violation_s"] for f in found] == [pytest.approx(1.5), pytest.approx(0.1)]
    assert found[0].quantities["relative_depth_integral_s"] == pytest.approx(0.5 * 1.0 + 0.5)
    assert [f.critical for f in found] == [True, False]


def test_half_the_rate_sees_every_second_sample() -> None:
    case = Case(((1,),), violations=(Violation("separation", 0, 11, 30),), step=2)
    (found,) = [f for f in world().findings(case).values() if f.check == "separation"]

    assert found.span is not None
    assert (found.span.start_s, found.span.end_s) == (1.2, 3.0)


# Shipped -------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_page_on_penalties_is_up_to_date() -> None:
    """Written by `penalties_page()`."""
    assert (ROOT / "docs/penalties.md").read_text(encoding="utf-8") == penalties_page()


# The command ---------------------------------------------------------------------------


def test_the_command_says_which_laws_hold(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rules", "check", "ariac2019.as_coded", "--cases", "40"]) == 0
    out = capsys.readouterr().out
    # Points that cannot be below 0, times a gate; nothing counts where the gate has taken all.
    assert "  proven          more violations never help\n" in out
    told = "  BROKEN          where nothing is left, a further violation still counts\n"
    assert f"{told}      the rule set says so itself: a collision makes the score 0" in out


@pytest.mark.slow
def test_the_command_fails_for_a_broken_law_and_goes_on_to_the_next_rule_set(
    capsys: pytest.CaptureFixture[str],
) -> None:
    names = ["paper2020.published", "ariac2023.as_coded"]
    assert main(["rules", "check", *names, "--cases", "100", "--strict"]) == 1
    out = capsys.readouterr().out
    assert "BROKEN          more violations never help" in out
    assert "not applicable  more violations never help: the score asks about no violation" in out


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        (["penalty.gatd"], "there is no penalty 'penalty.gatd'"),
        (["papper2020"], "there is no rule set 'papper2020'"),
        (["nowhere.yaml"], "no such file"),
    ],
)
def test_an_unknown_name_is_a_usage_error(
    arguments: list[str], cause: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rules", "check", *arguments]) == 4
    assert cause in capsys.readouterr().err


@pytest.mark.parametrize("cases", ["0", "-1", "many", "1000001"])
def test_a_number_of_cases_that_is_none_is_a_usage_error(cases: str) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["rules", "check", DEFAULT, "--cases", cases])

    assert stopped.value.code == 4


# What shipped rule sets say of themselves ------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper2020", "ariac2020.as_documented"])
def test_a_well_known_rule_set_breaks_no_law_but_those_it_says_it_breaks(name: str) -> None:
    """A sample of the next test, which is slow."""
    rule_set = load_rule_set(name)

    found = check_laws(
        rule_set,
        cases=10,
        seed=1,
        events=events(rule_set),
        steps=0,
        ungraded=ungraded_checks(rule_set, REGISTRY),
        humans=about_humans(rule_set, REGISTRY),
        paid=paid_quantities(rule_set, REGISTRY),
    )

    assert {o.law.name for o in found if o.verdict == "broken"} <= set(rule_set.breaks)


@pytest.mark.slow
@pytest.mark.parametrize("name", rule_set_names())
def test_a_shipped_rule_set_breaks_the_laws_it_says_it_breaks_and_no_other(name: str) -> None:
    rule_set = load_rule_set(name)
    said = set(rule_set.breaks)
    of_checks = {
        "ungraded": ungraded_checks(rule_set, REGISTRY),
        "humans": about_humans(rule_set, REGISTRY),
        "paid": paid_quantities(rule_set, REGISTRY),
    }

    if said:
        # The rarest of them shows itself in one case of five hundred.
        found = check_laws(
            rule_set, cases=3000, seed=7, events=events(rule_set), only=said, steps=0, **of_checks
        )
        assert {o.law.name for o in found if o.verdict == "broken"} == said
    # Few cases, for there are many rule sets; `rules check` without a name tries 400.
    others = check_laws(rule_set, cases=25, seed=1, events=events(rule_set), steps=0, **of_checks)
    assert "untried" not in {o.verdict for o in others}
    assert {o.law.name for o in others if o.verdict == "broken"} <= said


@pytest.mark.slow
def test_what_is_broken_and_said_to_be_is_told_with_its_reason_and_fails_where_that_is_asked(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["rules", "check", "ariac2024.release_5", "--strict"]) == 1
    capsys.readouterr()
    assert main(["rules", "check", "ariac2024.release_5"]) == 0
    out = capsys.readouterr().out

    assert (
        "BROKEN          more task points never hurt\n      the rule set says so itself: the score of a"
        in out
    )
    assert "does not say" not in out


@pytest.mark.slow
def test_a_file_that_is_silent_about_what_it_breaks_is_told_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.yaml").write_text("id: mine\ntitle: M\nsource: a test\nextends: ariac2024.release_5\n")

    # `breaks` is not inherited: what a rule set changes may mend it.
    assert main(["rules", "check", str(tmp_path / "mine.yaml")]) == 1
    out = capsys.readouterr().out
    assert "its file does not say under 'breaks' that it breaks: more task points never hurt\n" in out


def test_a_law_that_is_said_to_be_broken_and_is_not_is_told_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = MADE.replace("SCORE", "earned").replace("POLICY", "withhold")
    (tmp_path / "made.yaml").write_text(text + "breaks: {waiting: a slip}\n")

    assert main(["rules", "check", str(tmp_path / "made.yaml"), "--cases", "20"]) == 0
    assert "the rule set says so itself: a slip; it is proven all the same" in capsys.readouterr().out


def test_a_law_that_does_not_exist_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = MADE.replace("SCORE", "earned").replace("POLICY", "withhold")
    (tmp_path / "made.yaml").write_text(text + "breaks: {gravity: it is strong}\n")

    assert main(["rules", "validate", str(tmp_path / "made.yaml")]) == 4
    assert "'gravity'" in capsys.readouterr().err


def test_the_schema_knows_every_law() -> None:
    pattern = next(
        iter(schema("ruleset")["$defs"]["for_auditors"]["properties"]["breaks"]["patternProperties"])
    )

    assert pattern == f"^({'|'.join(law.name for law in ALL_LAWS)})$"
