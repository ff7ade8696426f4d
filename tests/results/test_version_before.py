"""What the version before wrote is read, verified and taken up: files made by it, in `tests/data/before`."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from decimal import Decimal
from pathlib import Path

import pytest

from ariac_score import as_json, load_result, load_rule_set, score_trial
from ariac_score.batch.index import checked_rows
from ariac_score.cli import main
from ariac_score.documents.schema import schema_errors
from ariac_score.errors import DataFileError, ResultError
from ariac_score.ranking.publication import PUBLICATION, load_publication
from ariac_score.report.html.trial import trial_page
from ariac_score.results.cohort_file import load_cohort
from ariac_score.results.result_file import measured_sha256
from ariac_score.review.verify import verify_result
from ariac_score.scoring.ruleset import rule_set_from_text

BEFORE = Path(__file__).parents[1] / "data/before"


NOT_COMPARED = {"code", "cohort", "adjustments", "log"}
"""Open where only the file is given. `rules` differ: theirs are of an earlier edition."""


def outcomes(path: Path, **more: Path) -> dict[str, str]:
    return {step.name: step.outcome for step in verify_result(path, **more).steps}


def test_a_result_is_read_verified_and_written_as_it_is_today(tmp_path: Path) -> None:
    stored = json.loads((BEFORE / "result.json").read_text(encoding="utf-8"))
    result = load_result(BEFORE / "result.json")

    assert (stored["schema"], stored["score"]) == ("ariac-score/result/1", 6.25)
    assert (str(result.score), result.digits) == ("6.250000000", 9)
    assert list(result.measured.findings) == list(stored["measured"]["findings"])
    assert result.measured.orders == stored["measured"]["orders_announced_s"]
    assert result.cohort.values == stored["cohort"]["values"]
    steps = outcomes(BEFORE / "result.json")
    assert {name for name, one in steps.items() if one not in ("ok", "note")} <= {"rules", *NOT_COMPARED}
    assert steps["bytes"] == "note"

    (tmp_path / "r.json").write_text(as_json(result), encoding="utf-8")
    assert load_result(tmp_path / "r.json") == result
    assert outcomes(tmp_path / "r.json")["bytes"] == "ok"


@pytest.mark.parametrize("name", ["example_2.json", "result_2.json", "adjusted_2.json"])
def test_a_ledger_of_the_former_method_is_kept_and_only_its_sum_compared(name: str, tmp_path: Path) -> None:
    stored = json.loads((BEFORE / name).read_text(encoding="utf-8"))
    result = load_result(BEFORE / name)

    assert stored["schema"] == "ariac-score/result/2"
    assert result.ledger is not None
    assert [line.path for line in result.ledger.children] == [
        line["path"] for line in stored["ledger"]["children"]
    ]
    steps = outcomes(BEFORE / name)
    assert {name for name, one in steps.items() if one not in ("ok", "note")} <= {"rules", *NOT_COMPARED}
    assert steps["ledger"] == "note"

    (tmp_path / "r.json").write_text(as_json(result), encoding="utf-8")
    assert load_result(tmp_path / "r.json") == result
    again = outcomes(tmp_path / "r.json")
    assert (again["bytes"], again["ledger"]) == ("ok", "note")


@pytest.mark.parametrize("name", ["sketch_1.json", "sketch_2.json"])
def test_what_was_asked_for_and_handed_in_is_drawn_as_of_the_same_log_today(
    name: str, tmp_path: Path
) -> None:
    former = load_result(BEFORE / name)
    rules = rule_set_from_text(former.rules, file=name)
    today = score_trial(BEFORE / "sketch.jsonl", rules)
    then, now = former.measured.sketch, today.measured.sketch

    assert then is not None
    assert now is not None
    assert former.score == today.score == 10
    assert [(one.path, one.level) for one in then.asked] == [(one.path, one.level) for one in now.asked]
    assert [one.words for one in then.asked] == [
        *("", "kitting, agv2", "pump_red", "sensor_blue"),  # an order, its kit, the parts of that
        *("", "assembly, as3", "battery_green"),
    ]
    assert [(one.item, one.submitted_s, one.contents) for one in then.brought] == [
        ("kit_1", 5.0, ("pump_red", "sensor_red")),
        ("asm_1", 8.0, None),
    ]
    assert [(one.item, one.submitted_s, one.contents) for one in now.brought] == [
        ("kit_1", 5.0, ("red pump", "red sensor")),  # by now in words
        ("asm_1", 8.0, None),
    ]
    page = trial_page(former, as_json(former))
    assert all(word in page for word in ("sensor_blue", "sensor_red", "battery_green", "as3"))
    (tmp_path / name).write_text(as_json(former), encoding="utf-8")
    assert load_result(tmp_path / name) == former


@pytest.mark.parametrize(
    ("damage", "cause"),
    [
        ({"asked": [{"order": "AAAA0001"}]}, "task"),
        ({"asked": 5}, "breaks the format ariac-score/result/2"),
        ({"brought": [{"task": "kit_1", "submitted_s": "noon", "parts": None}]}, "submitted_s"),
    ],
)
def test_a_damaged_sketch_of_the_version_before_is_refused(
    damage: dict[str, object], cause: str, tmp_path: Path
) -> None:
    stored = json.loads((BEFORE / "sketch_2.json").read_text(encoding="utf-8"))
    stored["measured"]["sketch"].update(damage)
    (tmp_path / "r.json").write_text(json.dumps(stored), encoding="utf-8")

    with pytest.raises(ResultError, match=cause):
        load_result(tmp_path / "r.json")


@pytest.mark.parametrize(
    ("before", "now", "step", "cause"),
    [
        ('"possible": 36.000000', '"possible": 37.000000', "automatic", "does not follow from its findings"),
        (
            '"status": "scored"',
            '"ledger_method": "slopes", "status": "scored"',
            "schema",
            "breaks the format",
        ),
    ],
)
def test_an_edited_result_of_the_former_method_is_found(
    before: str, now: str, step: str, cause: str, tmp_path: Path
) -> None:
    text = (BEFORE / "example_2.json").read_text(encoding="utf-8")
    assert before in text
    (tmp_path / "r.json").write_text(text.replace(before, now), encoding="utf-8")

    found = {s.name: s for s in verify_result(tmp_path / "r.json").steps}
    assert (found[step].outcome, cause in found[step].words) == ("failed", True)


def test_its_signature_still_verifies_and_an_edited_byte_is_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("minisign")
    for name in ("result.json", "result.json.minisig"):
        shutil.copy(BEFORE / name, tmp_path / name)
    command = ["verify", str(tmp_path / "result.json"), "--public-key", str(BEFORE / "key.pub")]
    assert main(command) == 1
    assert capsys.readouterr().out.endswith("does not hold: rules\n")  # of an earlier edition than installed

    text = (tmp_path / "result.json").read_text(encoding="utf-8")
    (tmp_path / "result.json").write_text(text.replace("AAAA0001", "AAAA0002"), encoding="utf-8")
    assert main(command) == 1
    assert "the signature is not of these bytes" in capsys.readouterr().out


def test_decisions_of_stewards_stay_those_of_their_result() -> None:
    adjusted = load_result(BEFORE / "adjusted.json")

    assert adjusted.adjusted is not None
    (decision,) = adjusted.adjusted.adjustments
    assert decision.measured == measured_sha256(adjusted)
    assert adjusted.adjusted.score == Decimal("3.677884615") + Decimal("2.5")
    steps = outcomes(BEFORE / "adjusted.json", adjustments=BEFORE / "adjustments.yaml")
    assert (steps["adjusted"], steps["adjustments"]) == ("ok", "ok")


@pytest.mark.parametrize(
    ("name", "before", "now", "cause"),
    [
        ("result.json", '"score": 6.25', '"score": 6.5', "the ledger adds up to 6.250000000"),
        ("result.json", '"witnessed"', '"witness"', "unknown key 'witness'"),
        ("result.json", '"span_s"', '"span"', "official_total#1: unknown key 'span'"),
        ("result.json", '"clock"', '"colour": 1, "clock"', "unknown key 'colour'"),
        ("adjusted.json", '"points": 2.5', '"points": 3.5', "does not follow from its adjustments"),
        ("adjusted.json", '"target"', '"at"', r"adjustments\[0\]: unknown key 'at'"),
    ],
)
def test_an_edited_one_is_refused(name: str, before: str, now: str, cause: str, tmp_path: Path) -> None:
    text = (BEFORE / name).read_text(encoding="utf-8")
    assert before in text
    (tmp_path / name).write_text(text.replace(before, now), encoding="utf-8")

    with pytest.raises(ResultError, match=cause):
        load_result(tmp_path / name)


@pytest.mark.parametrize(
    ("steps", "value", "cause"),
    [
        (("rounding", "score_decimals"), "9", r"\$\.rounding\.score_decimals: expected 'int', got 'str'"),
        (("rounding", "score_decimals"), -1, r"\$\.rounding\.score_decimals: expected 'int' >= 0"),
        (("rounding", "mode"), "up", r"\$\.rounding: unknown key 'mode'"),
        (("digits",), 3, r"\$: unknown key 'digits'"),
        (("measured",), [], r"\$\.measured: expected 'object', got 'array'"),
        (("measured", "sketch"), None, r"\$\.measured: unknown key 'sketch'"),
        (("measured", "settings"), None, r"\$\.measured: unknown key 'settings'"),
        (("measured", "window"), None, r"\$\.measured: unknown key 'window'"),
        (("measured", "window_s"), [1, 2, 3], r"\$\.measured\.window_s: expected 'array' of length 2"),
        (("measured", "coverage"), [1], r"\$\.measured\.coverage\[0\]: expected 'object', got 'int'"),
        (("measured", "findings", "order_score#1", "span"), None, r"order_score#1: unknown key 'span'"),
        (("measured", "findings", "order_score#1", "units"), {}, r"order_score#1: unknown key 'units'"),
        (("measured", "findings", "order_score#1", "quantities"), [], r"quantities: expected 'object'"),
        (("ledger", "children"), 1, r"\$\.ledger\.children: expected 'array', got 'int'"),
        (("score",), 1e300, "breaks the format ariac-score/result/1"),
        (("adjusted", "adjustments", 0, "target", "id"), "x", r"target: unknown key 'id'"),
        (("adjusted", "adjustments", 0, "effect", "reason"), "x", r"effect: unknown key 'reason'"),
        (("adjusted", "adjustments", 0, "points"), 9, r"adjustments\[0\]: unknown key 'points'"),
        (("adjusted", "adjustments", 0, "target"), "x", r"target: expected 'object', got 'str'"),
    ],
)
def test_an_edited_one_is_refused_with_the_place_and_no_words_of_the_language_it_is_read_in(
    steps: tuple[str | int, ...], value: object, cause: str, tmp_path: Path
) -> None:
    stored = json.loads((BEFORE / "adjusted.json").read_text(encoding="utf-8"))
    inner = stored
    for step in steps[:-1]:
        inner = inner[step]
    inner[steps[-1]] = value
    (tmp_path / "r.json").write_text(json.dumps(stored), encoding="utf-8")

    with pytest.raises(ResultError, match=cause) as refused:
        load_result(tmp_path / "r.json")
    assert refused.value.place.startswith("$")


def test_a_published_ranking_is_read_and_written_as_it_is_today(tmp_path: Path) -> None:
    stored = json.loads((BEFORE / "ranking.json").read_text(encoding="utf-8"))
    found = load_publication(BEFORE / "ranking.json")

    assert stored["schema"] == "ariac-score/ranking/2"
    assert [(s.rank, s.team, float(s.execution)) for s in found.ranking.standings] == [
        (s["rank"], s["team"], s["execution"]) for s in stored["standings"]
    ]
    assert [(s.rank, s.team, float(s.execution)) for s in found.final.standings] == [
        (s["rank"], s["team"], s["execution"]) for s in stored["adjusted"]["standings"]
    ]
    # They told equal teams apart where trials were few, and nothing that is stored mends that.
    assert (found.statistics, found.final_statistics) == (None, None)
    assert found.how.keep == stored["ranking"]["keep"]

    (tmp_path / "ranking.json").write_text(PUBLICATION.text(found), encoding="utf-8")
    assert load_publication(tmp_path / "ranking.json") == found


def test_the_organisers_ranking_of_a_published_one_is_brought_to_todays_form(tmp_path: Path) -> None:
    stored = json.loads((BEFORE / "ranking_strict.json").read_text(encoding="utf-8"))["strict"]
    found = load_publication(BEFORE / "ranking_strict.json")

    strict = found.strict
    assert strict is not None
    assert stored["leaderboard"][0] == {"team": "beta", "score": 30.318181818181817}
    assert strict.leaderboard == (
        ("beta", 30.318181818181817),
        ("alpha", 27.791666666666668),
        ("gamma", 0.0),
    )
    assert strict.orders is None  # that version did not keep which orders had priority

    text = PUBLICATION.text(found)
    now = json.loads(text)
    assert schema_errors(now, "ranking") == []
    assert {key: now["strict"][key] for key in ("trials", "stops", "differences")} == {
        key: stored[key] for key in ("trials", "stops", "differences")
    }
    (tmp_path / "ranking.json").write_text(text, encoding="utf-8")
    assert load_publication(tmp_path / "ranking.json") == found


def test_each_published_decision_is_linked_to_the_run_it_changed() -> None:
    # protest_1 names its run by what was measured alone, and its reason is the beginning of the other's.
    stored = json.loads((BEFORE / "ranking_strict.json").read_text(encoding="utf-8"))["adjusted"]
    assert [(d["id"], d["reason"], sorted(d["target"])) for d in stored["adjustments"]] == [
        ("protest_1", "see protocol", ["measured", "trial"]),
        ("protest_2", "see protocol 3", ["measured", "run", "team", "trial"]),
    ]

    found = load_publication(BEFORE / "ranking_strict.json")

    assert {run.key: run.decisions for run in found.final.runs if run.decisions} == {
        ("alpha", "kit", 2): ("protest_2",),
        ("beta", "kit", 1): ("protest_1",),
    }


@pytest.mark.parametrize(
    ("damage", "cause"),
    [
        ({"leaderboard": [{"team": "beta"}]}, "breaks the format ariac-score/ranking/2 at 'score'"),
        ({"trials": []}, "expected 'object', got 'array'"),
        ({"stop": []}, "unknown key 'stop'"),
        ({"leaderboard": [{"team": "beta", "score": "9"}]}, r"leaderboard\[0\]\.score: expected 'float'"),
        ({"leaderboard": 5}, r"\$\.strict\.leaderboard: expected 'array', got 'int'"),
    ],
)
def test_a_damaged_ranking_of_the_organisers_is_refused(
    damage: dict[str, object], cause: str, tmp_path: Path
) -> None:
    stored = json.loads((BEFORE / "ranking_strict.json").read_text(encoding="utf-8"))
    stored["strict"].update(damage)
    (tmp_path / "ranking.json").write_text(json.dumps(stored), encoding="utf-8")

    with pytest.raises(DataFileError, match=cause):
        load_publication(tmp_path / "ranking.json")


def test_a_published_cohort_still_prices() -> None:
    published = json.loads((BEFORE / "cohort.json").read_text(encoding="utf-8"))
    rules = replace(load_rule_set("ariac2024.official"))
    rules.__dict__["sha256"] = published["rule_set"]["sha256"]  # as it was called then

    cohort = load_cohort(BEFORE / "cohort.json", rules)

    assert cohort.of_trial("kit").sha256 == load_result(BEFORE / "result.json").cohort.sha256


@pytest.mark.slow
def test_a_finished_batch_is_read_ranked_and_taken_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("cup", "batch"):
        shutil.copytree(BEFORE / name, tmp_path / name)
    cup, batch = str(tmp_path / "cup"), tmp_path / "batch"
    ((row, document),) = checked_rows(batch)
    assert (row.key, row.outcome, row.task) == (("alpha", "kit", 1), "needs_cohort", 5.0)
    assert b"ariac-score/result/1" in document
    # The file of the rule set has another text since, if no other meaning.
    assert main(["rank", cup, "--batch", str(batch), "--output-format", "json"]) == 4
    assert "put the new prices on it first: ariac-score batch" in capsys.readouterr().err

    assert main(["batch", cup, "-o", str(batch), "-j", "1"]) == 0
    ((row, document),) = checked_rows(batch)
    assert (row.key, row.outcome, row.task) == (("alpha", "kit", 1), "needs_cohort", 5.0)
    assert b"ariac-score/result/3" in document
    capsys.readouterr()
    assert main(["rank", cup, "--batch", str(batch), "--output-format", "json"]) == 0
    (standing,) = json.loads(capsys.readouterr().out)["standings"]
    assert (standing["team"], standing["rank"], standing["value"]) == ("alpha", 1, 5.0)
