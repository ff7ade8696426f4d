"""A stored result held against itself, the installed versions and its log; edits are found and named."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score import as_json, load_result, score_trial
from ariac_score.cli import main
from ariac_score.errors import NothingToScoreError, ResultError
from ariac_score.results.result_file import measured_sha256
from ariac_score.review.computed_again import _is_record
from ariac_score.review.steps import Verification
from ariac_score.review.verify import verify_result
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score.testing.stored import rewritten
from ariac_score_ariac.testing import kitting_trial

ROOT = Path(__file__).parents[2]
LOG = ROOT / "examples/kitting_near_miss.mcap"
COMPETITION = ROOT / "examples/competition/2024"

Edit = Callable[[dict[str, Any]], None]


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example, scored by the code as it is."""
    file = tmp_path_factory.mktemp("stored") / "result.json"
    file.write_text(as_json(score_trial(LOG, "paper2020.published")), encoding="utf-8")
    return file


@pytest.fixture
def adjusted(stored: Path, tmp_path: Path) -> tuple[Path, Path]:
    """The same with a decision, and the file of it."""
    file, result = tmp_path / "adjustments.yaml", tmp_path / "adjusted.json"
    decision = {
        "id": "d1",
        "author": "A. Steward",
        "reason": "late",
        "time": "2024-05-12T14:30:00Z",
        "target": {"trial": "kitting_near_miss", "measured": measured_sha256(load_result(stored))},
        "effect": {"points": -2},
    }
    file.write_text(yaml.safe_dump({"adjustments": [decision]}))
    assert main(["adjust", str(stored), str(file), "--output-format", "json", "-o", str(result)]) == 0
    return result, file


def edited(stored: Path, folder: Path, edit: Edit) -> Path:
    data = json.loads(stored.read_text(encoding="utf-8"))
    edit(data)
    file = folder / "edited.json"
    file.write_text(rewritten(data), encoding="utf-8")
    return file


def failed(found: Verification) -> list[str]:
    return [step.name for step in found.steps if step.outcome == "failed"]


def words(found: Verification, name: str) -> str:
    return next(step.words for step in found.steps if step.name == name)


# What holds ----------------------------------------------------------------------------


def test_a_result_holds_alone_and_with_its_log(stored: Path) -> None:
    alone, whole = verify_result(stored), verify_result(stored, log=LOG, rules="paper2020.published")

    assert [s.name for s in alone.steps] == [
        *("schema", "sums", "automatic", "findings", "bytes", "rules", "code", "log")
    ]
    assert (alone.holds, alone.consistent, whole.holds) == (False, True, True)
    assert [s.name for s in whole.steps][7:] == ["log", "recomputed"]
    assert {s.outcome for s in whole.steps} == {"ok"}
    assert words(whole, "recomputed") == "the same to the byte"


def test_automatic_and_adjusted_are_told_apart(
    stored: Path, adjusted: tuple[Path, Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", str(stored)]) == 8
    assert "automatic result, score 19.761677, under paper2020.published" in capsys.readouterr().out

    result, file = adjusted
    assert main(["verify", str(result), "--log", str(LOG), "--adjustments", str(file)]) == 0
    out = capsys.readouterr().out
    assert "adjusted result, score 17.761677 by 1 decision of stewards, automatic score 19.761677" in out
    assert out.endswith("it holds\n")


def test_a_run_of_a_competition_is_found_by_the_names_of_its_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "cup"
    for team in ("aurora", "cygnus"):
        shutil.copytree(COMPETITION / "logs" / team / "kitting_1", root / "logs" / team / "kitting_1")
    shutil.copytree(COMPETITION / "trials", root / "trials")
    assert main(["rank", str(root), "--rules", "ariac2024.official", "--results", str(tmp_path / "r")]) in (
        0,
        6,
    )
    capsys.readouterr()

    found = verify_result(tmp_path / "r/cygnus/kitting_1.json", log=root)
    assert failed(found) == []
    assert found.result is not None
    assert found.result.cohort.values
    # The log of another team is another log.
    (root / "logs/cygnus/kitting_1/trial_log.txt").write_bytes(
        (root / "logs/aurora/kitting_1/trial_log.txt").read_bytes()
    )
    again = verify_result(tmp_path / "r/cygnus/kitting_1.json", log=root)
    assert failed(again) == ["log", "recomputed"]
    assert "logs/cygnus/kitting_1/trial_log.txt: another file" in words(again, "log")


@pytest.mark.slow
@pytest.mark.parametrize("pattern", ["logs/{team}/{trial}_{run}.jsonl", "logs/{team}/{trial}_{run}"])
def test_ranked_runs_of_any_layout_verify_against_their_competition(
    pattern: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Files, or folders whose files all have one name: only their hashes tell the runs of a team apart."""
    root, results = tmp_path / "cup", tmp_path / "r"
    for team in ("ours", "theirs"):
        for run in (1, 2):
            place = root / pattern.format(team=team, trial="kit", run=run)
            log = place if place.suffix else place / "trial.jsonl"
            log.parent.mkdir(parents=True, exist_ok=True)
            kits = kitting_trial(human=False) if (team, run) == ("ours", 2) else kitting_trial()
            write_trial_log(log, kits, signals=SNAPSHOT_SIGNALS)
    (root / "competition.yaml").write_text(f"{{id: cup, rules: paper2020.published, runs: '{pattern}'}}")
    assert main(["rank", str(root), "--results", str(results)]) == 6
    capsys.readouterr()

    for run in (1, 2):
        assert main(["verify", str(results / f"ours/kit_{run}.json"), "--log", str(root)]) == 0
    (root / pattern.format(team="ours", trial="kit", run=2)).rename(tmp_path / "gone")
    # Where only folders have names of their own, the file of another run is another file.
    gone = 5 if pattern.endswith(".jsonl") else 1
    assert main(["verify", str(results / "ours/kit_2.json"), "--log", str(root)]) == gone


def test_rules_that_are_not_installed_are_taken_from_the_result(tmp_path: Path) -> None:
    text = (ROOT / "rules/paper2020/published.yaml").read_text(encoding="utf-8")
    ours = tmp_path / "ours.yaml"
    ours.write_text(text.replace("id: paper2020.published", "id: ours", 1), encoding="utf-8")
    (tmp_path / "r.json").write_text(as_json(score_trial(LOG, str(ours))), encoding="utf-8")

    found = verify_result(tmp_path / "r.json", log=LOG)
    assert failed(found) == []
    assert found.steps_that_are("open") == ("rules",)
    assert "ours is not installed here" in words(found, "rules")
    assert failed(verify_result(tmp_path / "r.json", log=LOG, rules=str(ours))) == []


@pytest.mark.slow
def test_bounds_of_the_rules_are_settings_that_hold_and_cannot_be_edited(tmp_path: Path) -> None:
    ours = tmp_path / "ours.yaml"
    ours.write_text(
        "id: ours\ntitle: Ours\nsource: a test\nextends: paper2020.published\nbetween_samples: bounded\n"
        "bounds:\n  human: {max_speed_m_s: 2, max_acceleration_m_s2: 50, source: a test}\n"
        "  time_error_s: 0.001\n"
    )
    stored = tmp_path / "r.json"
    stored.write_text(as_json(score_trial(LOG, str(ours))), encoding="utf-8")

    def faster(data: dict[str, Any]) -> None:
        for one in data["measured"]["settings"]["separation"]["parameters"]:
            one["value"] = 4.0 if one["name"] == "bounds.human.max_speed_m_s" else one["value"]

    assert failed(verify_result(stored, log=LOG, rules=str(ours))) == []
    found = verify_result(edited(stored, tmp_path, faster), rules=str(ours))
    assert "'bounds.human.max_speed_m_s' another value than the rules" in words(found, "rules")


def test_the_outcome_is_there_for_programs(stored: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(stored), "--log", str(LOG), "--output-format", "json"]) == 0

    data = json.loads(capsys.readouterr().out)
    assert (data["holds"], data["kind"], data["score"]) == (True, "automatic", 19.761677)
    assert [step["name"] for step in data["steps"]][:2] == ["schema", "sums"]


# What does not -------------------------------------------------------------------------


def _set(path: str, value: Any) -> Edit:
    def edit(data: dict[str, Any]) -> None:
        *way, last = path.split("/")
        at: Any = data
        for step in way:
            at = at[int(step)] if step.isdigit() else at[step]
        at[int(last) if last.isdigit() else last] = value

    return edit


def _score_and_ledger(data: dict[str, Any]) -> None:
    """A forger who knows that the ledger must add up."""
    data["score"] = data["ledger"]["amount"] = 20.761677
    taken = data["ledger"]["children"][1]
    for line in (taken, taken["children"][0]):
        line["amount"] = round(line["amount"] + 1.0, 6)


@pytest.mark.parametrize(
    ("edit", "step", "told"),
    [
        (_set("schema", "ariac-score/result/9"), "schema", "$.schema"),
        (_set("surplus", 1), "schema", "unknown key 'surplus'"),
        (_set("score", 20.0), "sums", "the score is 20"),
        (_set("status", "incomplete"), "sums", "status 'incomplete' does not go with score"),
        (_set("ledger/children/1/amount", -7.0), "sums", "its lines add up to"),
        (_score_and_ledger, "automatic", "does not follow from its findings"),
        (_set("possible", 37.0), "automatic", "does not follow from its findings"),
        (_set("measured/findings/separation#1/verdict", "satisfied"), "automatic", "does not follow"),
        (
            _set("measured/findings/separation#1/quantities/relative_depth_integral_s", 0.1),
            "automatic",
            "follow",
        ),
        (_set("checks/separation/with", {"t1_s": 9}), "rules", "are not those of the rules in the result"),
        (_set("rule_set_title", "something else"), "rules", "are not those of the rules in the result"),
        (
            _set("provenance/rule_set/id", "ariac2024.official"),
            "rules",
            "the rules in the result are 'paper2020.published'",
        ),
    ],
)
def test_an_edit_is_found_without_the_log(
    edit: Edit, step: str, told: str, stored: Path, tmp_path: Path
) -> None:
    found = verify_result(edited(stored, tmp_path, edit))

    assert step in failed(found)
    assert told in words(found, step)


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (_set("measured/findings/separation#1/clause", "nowhere"), "$.measured.findings.separation#1.clause"),
        (
            _set("measured/findings/separation#1/robustness", -0.5),
            "-0.5 in the result, -0.956 computed again",
        ),
        (
            _set("measured/findings/separation#1/span/start_s", 18.0),
            "$.measured.findings.separation#1.span.start_s",
        ),
        (_set("measured/trial", "another_trial"), "$.measured.trial"),
        (_set("measured/coverage/0/largest_gap_s", 0.5), "$.measured.coverage[0].largest_gap_s"),
        (_set("provenance/log_map/sha256", "0" * 64), "another log map: paper2020, sha256 0000"),
        (_set("provenance/code/0/sha256", "0" * 64), "another ariac_score of ariac-score: version"),
        (_set("provenance/code/0/version", "9.9"), "version 9.9, sha256"),
        (_set("provenance/code/2/package", "stranger"), "another stranger of ariac-score: version"),
        (_set("provenance/ignored", ["x"]), "other files were passed over"),
    ],
)
def test_an_edit_that_follows_from_itself_is_found_with_the_log(
    edit: Edit, told: str, stored: Path, tmp_path: Path
) -> None:
    file = edited(stored, tmp_path, edit)

    assert failed(verify_result(file)) == []
    found = verify_result(file, log=LOG)
    assert failed(found) == ["recomputed"]
    assert told in words(found, "recomputed")


def test_another_hash_or_size_of_the_log_is_found_with_the_log(stored: Path, tmp_path: Path) -> None:
    file = edited(stored, tmp_path, _set("provenance/inputs/0/sha256", "0" * 64))
    found = verify_result(file, log=LOG)

    assert failed(found) == ["log", "recomputed"]
    assert words(found, "log").startswith("log kitting_near_miss.mcap: another file: sha256 0000")


def test_another_log_is_not_its_log(stored: Path, tmp_path: Path) -> None:
    other = write_trial_log(tmp_path / "kitting_near_miss.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)
    found = verify_result(stored, log=other)

    assert failed(found) == ["log", "recomputed"]
    assert "kitting_near_miss.mcap: is not there" in words(found, "log")


def test_a_log_that_was_changed_is_named(stored: Path, tmp_path: Path) -> None:
    changed = tmp_path / LOG.name
    changed.write_bytes(LOG.read_bytes())
    with changed.open("r+b") as stream:
        stream.seek(-1, 2)
        stream.write(b"\0")

    # A recording whose end is damaged cannot be read at all: that is said, and nothing is guessed.
    assert main(["verify", str(stored), "--log", str(changed)]) in (1, 6)


def test_rules_asked_for_that_are_others_are_named_with_what_differs(stored: Path, tmp_path: Path) -> None:
    text = (ROOT / "rules/paper2020/published.yaml").read_text(encoding="utf-8")
    ours = tmp_path / "paper2020.yaml"
    ours.write_text(text.replace("round: 6", "round: 5") if "round: 6" in text else text + "round: 5\n")
    found = verify_result(stored, rules=str(ours))

    assert failed(found) == ["rules"]
    assert "$.round" in words(found, "rules")


def test_a_reformatted_file_is_not_what_was_written(stored: Path, tmp_path: Path) -> None:
    file = tmp_path / "r.json"
    file.write_text(json.dumps(json.loads(stored.read_text())), encoding="utf-8")
    found = verify_result(file)

    assert failed(found) == ["bytes"]
    assert words(found, "bytes") == "the same values, written in another way"


def test_other_code_alone_is_a_note_and_no_failure(stored: Path, tmp_path: Path) -> None:
    found = verify_result(edited(stored, tmp_path, _set("provenance/code/0/version", "0.0.1")))

    assert failed(found) == []
    assert "ariac-score 0.0.1 with ariac_score made it, here it is" in words(found, "code")


def _without_code(data: dict[str, Any]) -> None:
    data["provenance"]["code"] = []


def _of_another_team_without_code(data: dict[str, Any]) -> None:
    _without_code(data)
    data["measured"]["team"] = "another"


def test_a_result_that_does_not_record_its_code_holds_with_a_note(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = edited(stored, tmp_path, _without_code)

    found = {step.name: step for step in verify_result(file, log=LOG, rules="paper2020.published").steps}

    assert found["recomputed"].outcome == "note"
    assert "the code that made it is not recorded" in found["recomputed"].words
    shipped = ROOT / "examples/kitting_near_miss.result.json"
    assert main(["verify", str(shipped), "--log", str(LOG), "--rules", "paper2020"]) == 0
    assert "does not hold" not in capsys.readouterr().out


def test_a_result_that_does_not_record_its_code_is_compared_all_the_same(
    stored: Path, tmp_path: Path
) -> None:
    file = edited(stored, tmp_path, _of_another_team_without_code)

    assert not verify_result(file, log=LOG, rules="paper2020.published").holds


def test_code_that_is_not_installed_is_named(stored: Path, tmp_path: Path) -> None:
    stranger = {"distribution": "stranger", "version": "2", "package": "stranger", "sha256": "0" * 64}
    found = verify_result(edited(stored, tmp_path, _set("provenance/code/0", stranger)))

    assert "stranger 2 with stranger made it, and is not installed here" in words(found, "code")


# Findings that cannot be ----------------------------------------------------------------


def _finding(data: dict[str, Any], check: str) -> dict[str, Any]:
    found: dict[str, Any] = data["measured"]["findings"][f"{check}#1"]
    return found


def _negative_time(data: dict[str, Any]) -> None:
    _finding(data, "separation")["quantities"]["time_in_violation_s"] = -5.0


def _late(data: dict[str, Any]) -> None:
    _finding(data, "separation")["span"]["end_s"] = 41.0


def _kept_by_a_margin(data: dict[str, Any]) -> None:
    _finding(data, "separation")["robustness"] = 0.5


def _undeclared(data: dict[str, Any]) -> None:
    finding = _finding(data, "separation")
    finding["quantities"]["bonus"] = 1.0


def _in_another_unit(data: dict[str, Any]) -> None:
    _finding(data, "separation")["units"]["time_in_violation_s"] = "m"


def _evidence_of_tomorrow(data: dict[str, Any]) -> None:
    _finding(data, "separation")["evidence"][0]["t_s"] = 86400.0


@pytest.mark.parametrize(
    ("forge", "words_of_it"),
    [
        (_negative_time, "separation#1: its quantities.time_in_violation_s is -5 s"),
        (_late, "separation#1: its span gives the time 41 s, outside what was watched, from 0 s to 40 s"),
        (_kept_by_a_margin, "separation#1: its robustness is +0.5, but a violation has none above 0"),
        (_undeclared, "separation#1: its quantities.bonus is not declared"),
        (_in_another_unit, "separation#1: its units.time_in_violation_s is 'm', but the check declares 's'"),
        (_evidence_of_tomorrow, "separation#1: its evidence 1 gives the time 86400 s, outside"),
    ],
)
def test_a_finding_that_cannot_be_is_found_without_the_log_and_has_no_price(
    stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], forge: Edit, words_of_it: str
) -> None:
    forged = edited(stored, tmp_path, forge)

    found = verify_result(forged)

    assert not found.holds
    assert words_of_it in words(found, "findings")
    assert main(["verify", str(forged)]) == 1
    capsys.readouterr()
    assert main(["price", str(forged), "--rules", "paper2020.published"]) == 6
    assert words_of_it.partition(": its ")[2] in capsys.readouterr().err


def test_what_the_engine_measured_can_be(stored: Path) -> None:
    assert "each with times, units and numbers that can be" in words(verify_result(stored), "findings")


# Adjusted results ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("edit", "step"),
    [
        (_set("adjusted/score", 20.0), "sums"),
        (_set("adjusted/adjustments/0/points", -1.0), "adjusted"),
        (_set("adjusted/adjustments/0/reason", "another"), "adjusted"),
        (_set("adjusted/adjustments/0/measured", "0" * 64), "adjusted"),
        (_set("measured/findings/separation#1/clause", "nowhere"), "adjusted"),
    ],
)
def test_an_edited_decision_is_found(
    edit: Edit, step: str, adjusted: tuple[Path, Path], tmp_path: Path
) -> None:
    assert step in failed(verify_result(edited(adjusted[0], tmp_path, edit)))


@pytest.mark.parametrize(
    ("edit", "told"),
    [
        (_set("adjusted/adjustments/0/time", "2024-05-13T14:30:00Z"), "adjustments[0].time"),
        (_set("adjusted/sha256", "0" * 64), "$.adjusted.sha256"),
    ],
)
def test_what_only_the_stewards_file_can_tell_is_found_with_it(
    edit: Edit, told: str, adjusted: tuple[Path, Path], tmp_path: Path
) -> None:
    file = edited(adjusted[0], tmp_path, edit)
    found = verify_result(file, adjustments=adjusted[1])

    assert failed(verify_result(file)) == []
    assert failed(found) == ["adjustments"]
    assert told in words(found, "adjustments")


def test_a_dropped_decision_is_found_with_the_stewards_file(
    stored: Path, adjusted: tuple[Path, Path]
) -> None:
    found = verify_result(stored, adjustments=adjusted[1])

    assert failed(found) == ["adjustments"]
    assert "nobody has adjusted it" in words(found, "adjustments")


# Files that are none -------------------------------------------------------------------


@pytest.mark.parametrize("text", ["", "nothing", "\x00", "[" * 100_000])
def test_a_file_that_is_no_json_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "r.json").write_text(text)

    with pytest.raises(ResultError, match="not a result"):
        verify_result(tmp_path / "r.json")


@pytest.mark.parametrize("text", ["{}", "[]", "3", '{"schema": "x"}'])
def test_json_that_is_no_result_fails_its_schema(
    text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "r.json").write_text(text)

    assert main(["verify", str(tmp_path / "r.json")]) == 1
    assert "does not hold: schema" in capsys.readouterr().out


@pytest.mark.parametrize("number", ["4", "999", "9" * 5000])
def test_a_result_from_a_newer_version_is_named_as_one(
    number: str, stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    newer = tmp_path / "newer.json"
    text = stored.read_text(encoding="utf-8")
    newer.write_text(text.replace("ariac-score/result/3", f"ariac-score/result/{number}"), encoding="utf-8")

    assert main(["verify", str(newer)]) == 1
    assert "a newer version wrote it" in capsys.readouterr().out
    assert main(["report", str(newer), "-o", str(tmp_path / "page.html")]) == 6
    assert "update ariac-score" in capsys.readouterr().err


@pytest.mark.parametrize("schema", ["ariac-score/result/0", "ariac-score/result/x", "other/result/2", ""])
def test_what_no_newer_version_wrote_is_not_called_so(
    schema: str, stored: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = stored.read_text(encoding="utf-8").replace("ariac-score/result/3", schema)
    (tmp_path / "r.json").write_text(text, encoding="utf-8")

    assert main(["verify", str(tmp_path / "r.json")]) == 1
    assert "newer" not in capsys.readouterr().out


def test_a_log_that_is_not_there_is_named(stored: Path) -> None:
    with pytest.raises(NothingToScoreError):
        verify_result(stored, log=Path("nowhere.mcap"))
    assert main(["verify", str(stored), "--log", "nowhere.mcap"]) == 5
    assert main(["verify", "nowhere.json"]) == 5


@pytest.mark.parametrize(
    ("place", "record"),
    [
        (("provenance", "code", 0, "sha256"), True),
        (("measured", "findings", "near#1", "units", "depth_m"), True),
        (("measured", "findings", "near#1", "quantities", "units_kept"), False),
        (("measured", "findings", "near#1", "quantities", "a.units"), False),
        (("measured", "settings", "near"), False),  # the example keeps its settings
        (("score",), False),
    ],
)
def test_only_provenance_and_declared_units_may_differ_with_the_same_findings(
    stored: Path, place: tuple[str | int, ...], record: bool
) -> None:
    assert _is_record(place, load_result(stored)) is record


@pytest.mark.parametrize(
    ("document", "kind", "command"),
    [
        ({"schema": "ariac-score/cohort/1"}, "cohort", "rank COMPETITION"),
        ({"schema": "ariac-score/audit/2"}, "audit", "audit PATH"),
        ({"schema": "ariac-score/outcome/1"}, "outcome", "batch"),
    ],
)
def test_another_document_of_ours_is_named_with_the_command_that_checks_it(
    tmp_path: Path, document: dict[str, str], kind: str, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "document.json"
    file.write_text(json.dumps(document), encoding="utf-8")

    assert main(["verify", str(file)]) == 6

    said = capsys.readouterr().err
    assert f"it is the JSON of a{'n' if kind[0] in 'ao' else ''} {kind}, not of a result" in said
    assert f"ariac-score {command}" in said.split("hint: ")[1]


def test_a_folder_is_no_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(tmp_path)]) == 5

    said = capsys.readouterr().err
    assert "it is a folder, not a result" in said
    assert "name the JSON file" in said
