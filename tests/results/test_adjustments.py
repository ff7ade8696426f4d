"""Decisions of stewards: on top of an untouched automatic result, shown with author, reason and time."""

from __future__ import annotations

import json
from decimal import Decimal
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Result, as_json, load_result, score_trial
from ariac_score.cli import main
from ariac_score.documents.schema import schema_errors
from ariac_score.errors import DataFileError, ResultError
from ariac_score.report.text import explain_text, score_text
from ariac_score.results.adjustments import adjust, adjustments_template, load_adjustments
from ariac_score.results.result_file import check_follows, measured_sha256
from ariac_score.scoring.ledger import reconcile
from ariac_score.scoring.policy import ideal
from ariac_score.scoring.pricing import Priced
from ariac_score.scoring.steward import Adjustment, adjusted_ledger
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score.testing.stored import rewritten
from ariac_score_ariac.testing import kitting_trial

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "tests/data/as_published/kitting_near_miss.result.json"
SCORE = Decimal("19.761677")
TASK = Decimal(28)
"""What the example is worth by hand (tests/test_same_bytes.py), with and without its one breach."""


@cache
def near_miss() -> Result:
    return load_result(EXAMPLE)


def decision(name: str = "d1", *, effect: Any, finding: str = "", **target: Any) -> dict[str, Any]:
    about = {"trial": "kitting_near_miss", "measured": measured_sha256(near_miss()), **target}
    if finding:
        about["finding"] = finding
    return {
        "id": name,
        "author": "A. Steward",
        "reason": "the camera was knocked over",
        "time": "2024-05-12T14:30:00Z",
        "target": about,
        "effect": effect,
    }


def written(folder: Path, *decisions: Any) -> Path:
    file = folder / "adjustments.yaml"
    file.write_text(yaml.safe_dump({"adjustments": list(decisions)}, sort_keys=False), encoding="utf-8")
    return file


def adjusted(folder: Path, *decisions: Any, result: Result | None = None) -> Result:
    result = result or near_miss()
    found, _ = adjust(result, load_adjustments(written(folder, *decisions)), measured=measured_sha256(result))
    return found


@pytest.fixture
def undecided(tmp_path: Path) -> Result:
    log = tmp_path / "kitting_near_miss.jsonl"
    kept = [name for name in SNAPSHOT_SIGNALS if "human" not in name]
    rules = tmp_path / "withholding.yaml"
    rules.write_text(
        "{id: withholding, title: paper2020.published, source: test, extends: paper2020.published, "
        "log_map: ariac2020, open: withhold}",
        encoding="utf-8",
    )
    return score_trial(write_trial_log(log, kitting_trial(), signals=kept), rules)


# What decisions do ---------------------------------------------------------------------


def test_a_finding_that_is_set_aside_gives_back_what_it_cost(tmp_path: Path) -> None:
    found = adjusted(tmp_path, decision(effect={"verdict": "satisfied"}, finding="separation#1"))

    # Without the one breach the demerits are 0, so the score is the task score.
    assert found.adjusted is not None
    assert found.adjusted.score == found.final == TASK
    assert found.score == SCORE
    ledger = found.adjusted.ledger
    assert ledger is not None
    assert [line.amount for line in ledger.children] == [SCORE, TASK - SCORE]


@pytest.mark.parametrize(
    ("effect", "score"),
    [
        ({"points": -2.5}, SCORE - Decimal("2.5")),
        ({"points": 3}, SCORE + 3),
        ({"score": 5}, Decimal(5)),
        ({"score": 0}, Decimal(0)),
        ({"disqualified": True}, Decimal(0)),
    ],
)
def test_a_decision_about_the_trial_moves_its_score(
    effect: dict[str, Any], score: Decimal, tmp_path: Path
) -> None:
    assert adjusted(tmp_path, decision(effect=effect)).final == score


@pytest.mark.parametrize("finding", ["", "separation#1"])
def test_a_complaint_that_is_dismissed_is_on_record_and_moves_nothing(finding: str, tmp_path: Path) -> None:
    turned_down = decision("p", effect={"dismissed": True}, finding=finding) | {
        "complaint": "Team X: too slow"
    }

    alone = adjusted(tmp_path, turned_down)
    assert (alone.final, alone.adjusted and alone.adjusted.score) == (SCORE, SCORE)
    assert "complaint: Team X: too slow; ruling: " in score_text(alone)
    check_follows(alone)

    both = adjusted(tmp_path, turned_down, decision("q", effect={"points": -2}))
    assert both.final == SCORE - 2
    with pytest.raises(DataFileError, match="no complaint is dismissed"):
        adjusted(tmp_path, decision("p", effect={"dismissed": True}, finding=finding))


def test_verdicts_come_before_points_and_what_settles_comes_last(tmp_path: Path) -> None:
    found = adjusted(
        tmp_path,
        decision("a", effect={"points": -1}),
        decision("b", effect={"points": -1}),
        decision("c", effect={"verdict": "not_applicable"}, finding="separation#1"),
    )

    assert found.adjusted is not None
    assert [a.id for a in found.adjusted.adjustments] == ["c", "a", "b"]
    assert found.final == TASK - 2


def test_the_automatic_result_stays_as_it_is_to_the_byte(tmp_path: Path) -> None:
    found = adjusted(tmp_path, decision(effect={"points": -2}))
    data = json.loads(as_json(found))

    assert schema_errors(data, "result") == []
    data["adjusted"] = None
    assert rewritten(data) == as_json(near_miss()) == as_json(found.automatic)


def test_the_ledger_names_who_decided_and_why(tmp_path: Path) -> None:
    found = adjusted(tmp_path, decision(effect={"points": -2}))

    assert found.adjusted is not None
    assert found.adjusted.ledger is not None
    assert [line.label for line in found.adjusted.ledger.children] == [
        "automatic score",
        "adjusted by A. Steward: -2 points: the camera was knocked over",
    ]


def test_text_and_explanation_show_both_scores(tmp_path: Path) -> None:
    found = adjusted(tmp_path, decision(effect={"points": -2}))
    text = score_text(found)

    assert text.startswith(
        "17.761677 as adjusted by the stewards\nautomatic score 19.761677 of 36 possible\n"
    )
    assert "A. Steward, 2024-05-12T14:30:00Z: the camera was knocked over" in text
    assert explain_text(found, "").startswith("adjusted score")


def test_a_decision_can_be_explained_by_its_line_and_by_its_finding(tmp_path: Path) -> None:
    found = adjusted(tmp_path, decision(effect={"verdict": "satisfied"}, finding="separation#1"))

    for path in ("adjusted_1", "separation"):
        assert "adjusted by A. Steward: separation#1 counts as satisfied" in explain_text(found, path)
    assert "adjusted by" not in explain_text(found, "part_color")


def test_a_stored_adjusted_result_comes_back_as_it_was(tmp_path: Path) -> None:
    found = adjusted(
        tmp_path,
        decision("a", effect={"points": -2.25}, run=3),
        decision("b", effect={"verdict": "satisfied"}, finding="separation#1"),
    )
    (tmp_path / "r.json").write_text(as_json(found), encoding="utf-8")

    assert as_json(load_result(tmp_path / "r.json")) == as_json(found)


def test_a_decision_can_settle_what_was_undecided(undecided: Result, tmp_path: Path) -> None:
    own = {"measured": measured_sha256(undecided)}
    open_ones = [a.finding for a in undecided.assumptions]
    assert undecided.score is None
    decisions = [
        decision(f"d{i}", effect={"verdict": "satisfied"}, finding=key, **own)
        for i, key in enumerate(open_ones)
    ]

    found = adjusted(tmp_path, *decisions, result=undecided)
    assert found.score is None
    assert found.final == TASK
    assert adjusted(tmp_path, decisions[0], result=undecided).final is None


def test_a_score_can_be_set_where_there_was_none(undecided: Result, tmp_path: Path) -> None:
    own = {"measured": measured_sha256(undecided)}

    assert adjusted(tmp_path, decision(effect={"score": 12}, **own), result=undecided).final == 12
    with pytest.raises(DataFileError, match="no score to add points to"):
        adjusted(tmp_path, decision(effect={"points": 1}, **own), result=undecided)


def test_a_worst_case_that_stewards_confirm_costs_what_it_cost_before(tmp_path: Path) -> None:
    """Rules that count an unseen contact as a critical one close the gate, and so does the ruling."""
    rules = tmp_path / "strict.yaml"
    rules.write_text(
        "{id: strict, title: Strict, source: test, extends: paper2020.published, log_map: ariac2020, "
        "score: gate(human_contact) * task, monitors: {human_contact: {on_inconclusive: worst_case}}}",
        encoding="utf-8",
    )
    unseen = [name for name in SNAPSHOT_SIGNALS if "human" not in name]
    log = write_trial_log(tmp_path / "kitting_near_miss.jsonl", kitting_trial(), signals=unseen)
    result = score_trial(log, rules)
    ruled = decision(
        effect={"verdict": "violated"}, finding="human_contact#1", measured=measured_sha256(result)
    )

    assert result.score == adjusted(tmp_path, ruled, result=result).final == 0


def test_a_verdict_that_leaves_no_score_where_there_was_one_is_refused_with_its_cause() -> None:
    missing = "nothing bounds seconds(separation): a gap of 3 s"
    ruling = Adjustment(
        id="d1", author="a", reason="r", time="", measured="0" * 64, trial="kit",
        finding="separation#1", verdict="violated",
    )  # fmt: skip

    def price(_: object) -> Priced:
        return Priced("incomplete", None, None, None, (), missing)

    with pytest.raises(DataFileError) as refused:
        adjusted_ledger(Decimal(5), near_miss().measured.findings, [ruling], price, digits=6, sha256="0" * 64)

    assert f"with separation#1 violated there is no score: {missing}" in str(refused.value)
    assert refused.value.hint == "decide on points of the trial instead, or set the score"


VIOLATED = sorted(k for k, f in near_miss().measured.findings.items() if f.verdict.value == "violated")


@pytest.mark.slow
@settings(max_examples=25)
@given(
    settled=st.sets(st.sampled_from(VIOLATED)),
    points=st.lists(st.integers(-50, 50).filter(bool), max_size=4),
    order=st.randoms(use_true_random=False),
)
def test_amounts_always_add_up_and_the_order_in_the_file_does_not_matter(
    settled: set[str], points: list[int], order: Any, tmp_path_factory: pytest.TempPathFactory
) -> None:
    decisions = [
        *(
            decision(f"v{i}", effect={"verdict": "satisfied"}, finding=k)
            for i, k in enumerate(sorted(settled))
        ),
        *(decision(f"p{i}", effect={"points": p}) for i, p in enumerate(points)),
    ]
    if not decisions:
        return
    folder = tmp_path_factory.mktemp("case")
    found = adjusted(folder, *decisions).adjusted
    assert found is not None
    assert found.ledger is not None
    assert found.score is not None
    reconcile(found.ledger, found.score, digits=6)
    order.shuffle(decisions)
    assert adjusted(folder, *decisions).final == found.score


def test_with_everything_set_aside_the_score_is_what_was_possible(tmp_path: Path) -> None:
    decisions = [
        decision(f"d{i}", effect={"verdict": "satisfied"}, finding=key) for i, key in enumerate(VIOLATED)
    ]

    assert set(VIOLATED) <= set(ideal(near_miss().measured.findings))
    assert adjusted(tmp_path, *decisions).final == near_miss().possible == 36


# What makes no sense -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("decisions", "cause"),
    [
        ([decision(effect={"points": 1}, measured="0" * 64)], "made for another result"),
        ([decision(effect={"points": 1}, trial="other")], "is of trial 'kitting_near_miss', not 'other'"),
        ([decision(effect={"points": 1}, team="other")], "is of team '', not 'other'"),
        ([decision(effect={"verdict": "satisfied"}, finding="separation#9")], "no finding 'separation#9'"),
        ([decision(effect={"verdict": "violated"}, finding="separation#1")], "is violated already"),
        (
            [decision(effect={"verdict": "violated"}, finding="order_time#1")],
            "does not depend on 'order_time'",
        ),
        ([decision(effect={"points": 1}, finding="separation#1")], "a finding has a verdict and no points"),
        ([decision(effect={"verdict": "satisfied"})], "a verdict needs a finding"),
        ([decision(effect={"points": 0})], "0 points change nothing"),
        ([decision(effect={"points": 0.1234567})], "more than 6 decimals"),
        ([decision(effect={"points": 1e300})], "is no score"),
        ([decision(effect={"score": float("inf")})], "inf is not a finite number"),
        ([decision(effect={"points": 1}), decision(effect={"points": 2})], "name is given twice"),
        (
            [
                decision("a", effect={"verdict": "satisfied"}, finding="separation#1"),
                decision("b", effect={"verdict": "not_applicable"}, finding="separation#1"),
            ],
            "finding 'separation#1' was decided already, by 'a'",
        ),
        (
            [decision("a", effect={"disqualified": True}), decision("b", effect={"score": 3})],
            "the score of this trial was decided already, by 'a'",
        ),
        (
            [decision("a", effect={"disqualified": True}), decision("b", effect={"points": 3})],
            "points make no difference where 'a' says: disqualified",
        ),
        ([decision(effect={})], "effect"),
        ([decision(effect={"points": 1, "score": 3})], "effect"),
        ([decision(effect={"disqualified": False})], "True was expected"),
        ([decision(effect={"verdict": "inconclusive"}, finding="separation#1")], "is not allowed here"),
        ([{**decision(effect={"points": 1}), "reason": ""}], "reason"),
        ([{**decision(effect={"points": 1}), "author": ""}], "author"),
        ([{**decision(effect={"points": 1}), "time": "yesterday"}], "yesterday"),
        ([{**decision(effect={"points": 1}), "time": "0001-01-01T00:00:00+23:59"}], "is no time in UTC"),
        ([{**decision(effect={"points": 1}), "time": "9999-12-31T23:59:59-23:59"}], "is no time in UTC"),
        ([{**decision(effect={"points": 1}), "time": "2024-05-12T14:30:00"}], "lacks its time zone"),
        ([{**decision(effect={"points": 1}), "id": "../x"}], "does not match"),
        ([{**decision(effect={"points": 1}), "by": "me"}], "unknown key 'by'"),
        ([], "non-empty"),
    ],
)
def test_a_decision_that_makes_no_sense_is_refused_and_named(
    decisions: list[Any], cause: str, tmp_path: Path
) -> None:
    with pytest.raises(DataFileError) as refused:
        adjusted(tmp_path, *decisions)

    told = f"{refused.value} {refused.value.place}"
    assert cause in told or (cause == "non-empty" and "adjustments" in told)
    assert refused.value.hint
    assert str(tmp_path) in str(refused.value)


@pytest.mark.parametrize(
    "text", ["", "adjustments: 3\n", "- 1\n", "adjustments: [1]\n", "adjustments:\n  - {id: 1}\n"]
)
def test_a_file_that_is_none_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(text)

    with pytest.raises(DataFileError):
        load_adjustments(tmp_path / "a.yaml")


@pytest.mark.parametrize(
    ("told", "read"),
    [
        ("2024-05-12T14:30:00Z", "2024-05-12T14:30:00Z"),
        ("2024-05-12 16:30:00+02:00", "2024-05-12T14:30:00Z"),
        ("'2024-05-12T16:30:00+02:00'", "2024-05-12T14:30:00Z"),
    ],
)
def test_times_are_read_with_their_zone(told: str, read: str, tmp_path: Path) -> None:
    file = written(tmp_path, decision(effect={"points": 1}))
    file.write_text(file.read_text().replace("'2024-05-12T14:30:00Z'", told))

    assert load_adjustments(file).decisions[0].time == read


def test_a_date_alone_is_no_time(tmp_path: Path) -> None:
    file = written(tmp_path, decision(effect={"points": 1}))
    file.write_text(file.read_text().replace("'2024-05-12T14:30:00Z'", "2024-05-12"))

    with pytest.raises(DataFileError, match="lacks the time of day"):
        load_adjustments(file)


def test_an_adjusted_result_is_not_adjusted_again(tmp_path: Path) -> None:
    once = adjusted(tmp_path, decision(effect={"points": -2}))

    with pytest.raises(DataFileError, match="adjusted already"):
        adjusted(tmp_path, decision(effect={"points": -2}), result=once)


def test_decisions_about_other_results_are_passed_over_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(
        tmp_path,
        decision("a", effect={"points": -2}),
        decision("b", effect={"points": -2}, trial="other", measured="1" * 64),
    )

    assert main(["adjust", str(EXAMPLE), str(file)]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("17.761677 as adjusted by the stewards\n")
    assert "1 adjustment of the file is about other results" in err


# A result that was edited afterwards ----------------------------------------------------


def _edit(data: dict[str, Any], path: str, value: Any) -> None:
    *way, last = path.split("/")
    at: Any = data["adjusted"]
    for step in way:
        at = at[int(step)] if step.isdigit() else at[step]
    at[int(last) if last.isdigit() else last] = value


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("score", 18.0),
        ("score", None),
        ("ledger/amount", 18.0),
        ("ledger/children/0/amount", 20.0),
        ("ledger/children/1/amount", -1.0),
        ("ledger/children/1/label", "adjusted by nobody"),
        ("adjustments/0/points", -1.0),
        ("adjustments/0/author", "somebody else"),
        ("adjustments/0/reason", "another reason"),
        ("adjustments/0/measured", "0" * 64),
        ("adjustments/0/finding", "separation#1"),
        ("adjustments", []),
    ],
)
def test_an_edited_decision_is_found_out(path: str, value: Any, tmp_path: Path) -> None:
    data = json.loads(as_json(adjusted(tmp_path, decision(effect={"points": -2}))))
    _edit(data, path, value)
    (tmp_path / "r.json").write_text(json.dumps(data), encoding="utf-8")

    with pytest.raises(ResultError):
        load_result(tmp_path / "r.json")


def test_an_edited_finding_of_an_adjusted_result_is_found_out(tmp_path: Path) -> None:
    data = json.loads(as_json(adjusted(tmp_path, decision(effect={"points": -2}))))
    data["measured"]["findings"]["separation#1"]["clause"] = "another clause"
    (tmp_path / "r.json").write_text(json.dumps(data), encoding="utf-8")

    with pytest.raises(ResultError, match="made for another result"):
        load_result(tmp_path / "r.json")


# The template --------------------------------------------------------------------------


def test_the_template_needs_only_who_why_and_when(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["adjust", str(EXAMPLE)]) == 0
    text = capsys.readouterr().out
    (tmp_path / "a.yaml").write_text(text)
    with pytest.raises(DataFileError):
        load_adjustments(tmp_path / "a.yaml")

    for empty, told in (("author", "Jury"), ("reason", "late"), ("time", "2024-05-12T14:30:00Z")):
        text = text.replace(f'{empty}: ""', f'{empty}: "{told}"')
    (tmp_path / "a.yaml").write_text(text)
    found, _ = adjust(
        near_miss(), load_adjustments(tmp_path / "a.yaml"), measured=measured_sha256(near_miss())
    )
    assert found.final == SCORE - 1
    assert "#   separation#1: violated: too close for 2.40 s" in text


@given(st.text(max_size=60))
def test_the_template_is_one_document_whatever_the_trial_is_called(name: str) -> None:
    from dataclasses import replace  # noqa: PLC0415

    result = near_miss()
    named = replace(result, measured=replace(result.measured, trial=name, team=name))

    data = yaml.safe_load(adjustments_template(named, measured="0" * 64))
    assert list(data) == ["adjustments"]
    assert data["adjustments"][0]["target"]["trial"] == name


# Other commands ------------------------------------------------------------------------


def test_other_prices_do_not_carry_decisions_over_and_say_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "r.json").write_text(
        as_json(adjusted(tmp_path, decision(effect={"points": -2}))), encoding="utf-8"
    )

    assert main(["price", str(tmp_path / "r.json"), "--rules", "paper2020.published"]) == 0
    out, err = capsys.readouterr()
    assert out.startswith("19.761677 of 36 possible")
    assert "do not carry over to other prices" in err


@pytest.mark.slow
def test_sensitivity_says_that_it_is_about_the_automatic_score(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "r.json").write_text(
        as_json(adjusted(tmp_path, decision(effect={"points": -2}))), encoding="utf-8"
    )

    assert main(["sensitivity", str(tmp_path / "r.json")]) == 0
    assert "this is the automatic score" in capsys.readouterr().err


def test_criteria_hold_for_the_adjusted_result(tmp_path: Path) -> None:
    found = adjusted(
        tmp_path,
        *(decision(f"d{i}", effect={"verdict": "satisfied"}, finding=k) for i, k in enumerate(VIOLATED)),
    )
    (tmp_path / "r.json").write_text(as_json(found), encoding="utf-8")

    assert main(["export", str(EXAMPLE), "--fail-on", "violation"]) == 1
    assert main(["export", str(tmp_path / "r.json"), "--fail-on", "violation", "--fail-on", "score<36"]) == 0


@pytest.mark.parametrize("name", ["text", "junit", "sarif", "github", "markdown", "csv", "jsonl"])
def test_every_output_shows_both_scores_who_decided_and_why(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, decision(effect={"points": -2}))

    assert main(["adjust", str(EXAMPLE), str(file), "--output-format", name]) == 0
    shown = capsys.readouterr().out.replace("\\", "")
    for words in ("17.761677", "19.761677", "A. Steward", "the camera was knocked over"):
        assert words in shown
