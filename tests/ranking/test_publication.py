"""A ranking as it is published: who is never ahead, what separates, what is refused when it is read back."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest
from msgspec import structs

from ariac_score import load_rule_set
from ariac_score.cli import main
from ariac_score.documents.schema import schema_errors
from ariac_score.errors import DataFileError, ResultError
from ariac_score.ranking.adjusting import adjusted_ranking
from ariac_score.ranking.changes import changes_between
from ariac_score.ranking.competition import Competition, load_competition
from ariac_score.ranking.outcomes import Ranking
from ariac_score.ranking.publication import load_publication, ranking_json
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import Spec, ranking_spec
from ariac_score.ranking.stored import write_results
from ariac_score.results.adjustments import Adjustments
from ariac_score.results.result_file import measured_sha256
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.scoring.steward import Adjustment
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.official_texts import (
    Outcome,
    PlannedOrder,
    sensor_cost_text,
    trial_log_text,
)

EXAMPLE = Path(__file__).parents[2] / "examples/competition/2024"
KIT = (PlannedOrder("AAAA0001", "kitting", False, (("pump", "red"),)),)
SENSORS = {"basic_logical_camera": 2}
CRASHED = "Gazebo Crashed score not recorded\n"
NEGATIVE = """\
id: negative
title: Points below 0
source: a test
extends: ariac2024.official
task: 0 - measure(official_total, total)
score: 0 - measure(official_total, total)
"""


def run(root: Path, team: str, trial: str, number: int, *, flaw: str = "", text: str | None = None) -> None:
    """A run of 5 points, of 3 with a wrong colour, of 1 with a wrong type."""
    folder = root / "logs" / team / f"{trial}_{number}"
    folder.mkdir(parents=True)
    plain = trial_log_text(trial, KIT, [Outcome((flaw,), 50.0)])
    (folder / "trial_log.txt").write_text(text or plain, encoding="utf-8")
    (folder / "sensor_cost.txt").write_text(sensor_cost_text(SENSORS), encoding="utf-8")


def ranked(root: Path, rules: str = "ariac2024.official", extra: str = "") -> Ranking:
    return ranked_with(root, rules, extra)[0]


def ranked_with(root: Path, rules: str, extra: str) -> tuple[Ranking, Competition, Spec, RuleSet]:
    (root / "competition.yaml").write_text(
        f"id: test\nrules: {rules}\nruns: logs/{{team}}/{{trial}}_{{run}}\n{extra}", encoding="utf-8"
    )
    competition = load_competition(root)
    rule_set = load_rule_set(competition.rules)
    spec = ranking_spec(rule_set, competition.ranking, file="competition.yaml")
    found = rank_results(competition, spec, rule_set, score_runs(competition, rule_set))
    return found, competition, spec, rule_set


def set_score(found: Ranking, team: str, score: str) -> Adjustment:
    """A decision that sets the score of the team's only run."""
    result = next(run.result for run in found.runs if run.team == team)
    assert result is not None
    return Adjustment(
        id=team,
        author="The jury",
        reason="see protocol 3",
        time="2024-05-12T14:30:00Z",
        measured=measured_sha256(result),
        trial="kit",
        team=team,
        score=Decimal(score),
    )


# Missing runs --------------------------------------------------------------------------


@pytest.fixture
def below_zero(tmp_path: Path) -> Path:
    (tmp_path / "negative.yaml").write_text(NEGATIVE, encoding="utf-8")
    run(tmp_path, "drove", "kit", 1)  # -5
    run(tmp_path, "wrong", "kit", 1, flaw="color")  # -3
    run(tmp_path, "crashed", "kit", 1, text=CRASHED)
    return tmp_path


TEAMS = "teams: [{id: absent}, {id: crashed}, {id: drove}, {id: wrong}]\n"


def test_who_did_not_run_or_crashed_is_not_ahead_of_one_that_lost_points(below_zero: Path) -> None:
    found = ranked(below_zero, "negative.yaml", TEAMS)

    # What has no score counts the worst of the trial, -5, and not 0.
    assert {(s.team, s.rank, float(s.execution)) for s in found.standings} == {
        ("wrong", 1, -3),
        ("drove", 2, -5),
        ("crashed", 2, -5),
        ("absent", 2, -5),
    }
    cells = {s.team: s.trials["kit"] for s in found.standings}
    assert cells["absent"].reason == "there is no run; it counts -5.000000000, the worst of the trial"
    assert "the worst of the trial" in cells["crashed"].reason


def test_a_crashed_run_counts_the_worst_that_stewards_leave_in_the_trial(below_zero: Path) -> None:
    found, *prepared = ranked_with(below_zero, "negative.yaml", TEAMS)
    crashed = next(run for run in found.runs if run.team == "crashed")
    assert crashed.score == -5
    assert crashed.reason.endswith("; it counts -5.000000000, the worst of the trial")

    # With drove at 3 and wrong at 4 nobody is below 0 any more.
    higher = [set_score(found, "drove", "3"), set_score(found, "wrong", "4")]
    after = adjusted_ranking(*prepared, found, Adjustments("a.yaml", "0" * 64, tuple(higher)))

    assert after.stewarded is not None
    adjusted = after.stewarded.ranking
    crashed = next(run for run in adjusted.runs if run.team == "crashed")
    assert crashed.score == 0
    assert "it counts" not in crashed.reason
    assert {s.team: float(s.execution) for s in adjusted.standings} == {
        "wrong": 4,
        "drove": 3,
        "crashed": 0,
        "absent": 0,
    }


@pytest.mark.parametrize(
    "effect",
    [
        {"dismissed": True, "complaint": "it was the cable"},
        {"finding": "separation#1", "verdict": "satisfied"},
    ],
    ids=["a complaint that is dismissed", "a verdict"],
)
def test_what_was_recorded_of_a_crashed_run_counts_for_nothing_whatever_is_decided_about_it(
    effect: dict[str, Any], tmp_path: Path
) -> None:
    found, prepared, crashed = crashed_with_a_recording(tmp_path)
    decided = structs.replace(crashed, score=None, **effect)
    after = adjusted_ranking(*prepared, found, Adjustments("a.yaml", "0" * 64, (decided,))).stewarded

    assert after is not None
    assert [(run.outcome, run.score) for run in after.ranking.runs] == [("crashed", 0)]
    assert [standing.execution for standing in after.ranking.standings] == [0]


def test_a_crashed_run_has_no_points_to_lose_and_can_be_given_a_score(tmp_path: Path) -> None:
    found, prepared, crashed = crashed_with_a_recording(tmp_path)
    less = structs.replace(crashed, score=None, points=Decimal(-1))

    with pytest.raises(DataFileError, match="no score to add points to: the run is crashed"):
        adjusted_ranking(*prepared, found, Adjustments("a.yaml", "0" * 64, (less,)))
    after = adjusted_ranking(*prepared, found, Adjustments("a.yaml", "0" * 64, (crashed,))).stewarded
    assert after is not None
    assert [(run.outcome, run.score) for run in after.ranking.runs] == [("scored", 7)]


def crashed_with_a_recording(root: Path) -> tuple[Ranking, tuple[Competition, Spec, RuleSet], Adjustment]:
    """A run whose simulator died, and whose recording alone would be worth points; and 7 points for it."""
    folder = root / "logs/team/kit_1"
    folder.mkdir(parents=True)
    write_trial_log(folder / "trial.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)
    (folder / "trial_log.txt").write_text(CRASHED, encoding="utf-8")
    found, *prepared = ranked_with(root, "paper2020", "")
    (run,) = found.runs
    assert run.result is not None
    assert (run.outcome, run.score, bool(run.result.score)) == ("crashed", 0, True)
    competition, spec, rule_set = prepared
    return found, (competition, spec, rule_set), set_score(found, "team", "7")


def test_a_crashed_run_is_not_kept_before_one_of_the_same_team_that_lost_points(below_zero: Path) -> None:
    run(below_zero, "drove", "kit", 2, text=CRASHED)

    found = ranked(below_zero, "negative.yaml", TEAMS)

    assert [(r.team, r.number) for r in found.runs if r.kept and r.team == "drove"] == [("drove", 1)]


def test_a_run_that_was_not_made_counts_the_worst_in_the_mean(below_zero: Path) -> None:
    found = ranked(below_zero, "negative.yaml", f"{TEAMS}ranking: {{keep: 2}}\n")

    # wrong: (-3 and one not made, -5) / 2
    assert {s.team: float(s.execution) for s in found.standings} == {
        "wrong": -4,
        "drove": -5,
        "crashed": -5,
        "absent": -5,
    }


def test_where_fewer_points_are_better_what_is_missing_counts_most(tmp_path: Path) -> None:
    run(tmp_path, "alpha", "kit", 1)
    run(tmp_path, "beta", "kit", 1, flaw="color")
    extra = "teams: [{id: absent}, {id: alpha}, {id: beta}]\nranking: {value: execution, best: lowest}\n"
    found = ranked(tmp_path, extra=extra)

    # All at the mean time and cost: alpha 5, beta 3.
    assert [(s.rank, s.team, float(s.execution)) for s in found.standings] == [
        (1, "beta", 3),
        (2, "absent", 5),
        (2, "alpha", 5),
    ]


# What separates ----------------------------------------------------------------------------


def test_count_back_compares_trials_won_then_second_places(tmp_path: Path) -> None:
    # alpha 5 + 3 + 1, beta 3 + 3 + 3.
    for trial, flaw in (("one", ""), ("two", "color"), ("three", "type")):
        run(tmp_path, "alpha", trial, 1, flaw=flaw)
        run(tmp_path, "beta", trial, 1, flaw="color")
    extra = "trials: [{id: one}, {id: two}, {id: three}]\n"

    shared = ranked(tmp_path, extra=extra)
    counted = ranked(tmp_path, extra=f"{extra}ranking: {{ties: [{{count_back: places}}]}}\n")

    assert [s.rank for s in shared.standings] == [1, 1]
    # alpha wins 'one', beta 'three', both share the first place of 'two'.
    assert [s.places for s in counted.standings] == [(2, 1), (2, 1)]
    assert [s.rank for s in counted.standings] == [1, 1]


def test_more_trials_won_come_first_and_the_tie_break_is_named(tmp_path: Path) -> None:
    # alpha 5 + 1, beta 3 + 3: each wins one and is second in the other.
    for team, flaws in (("alpha", ("", "type")), ("beta", ("color", "color"))):
        for trial, flaw in zip(("one", "two"), flaws, strict=True):
            run(tmp_path, team, trial, 1, flaw=flaw)
    extra = "ranking: {ties: [{count_back: places}]}\n"
    found = ranked(tmp_path, extra=extra)

    assert [(s.team, s.rank, s.places, s.separated_by) for s in found.standings] == [
        ("alpha", 1, (1, 1), ""),
        ("beta", 1, (1, 1), ""),
    ]
    run(tmp_path, "alpha", "three", 1, flaw="type")  # 5 + 1 + 1 = 7
    run(tmp_path, "beta", "three", 1, flaw="type")  # 3 + 3 + 1 = 7
    run(tmp_path, "gamma", "one", 1, flaw="color")
    run(tmp_path, "gamma", "two", 1, flaw="color")
    run(tmp_path, "gamma", "three", 1, flaw="type")
    found = ranked(tmp_path, extra=extra)

    # All 7. alpha: won one, last in two, shares the first of three: 2 firsts, 1 third.
    # beta and gamma: share the second of one, the first of two and of three: 2 firsts, 1 second.
    assert {s.team: s.places for s in found.standings} == {
        "alpha": (2, 0, 1),
        "beta": (2, 1, 0),
        "gamma": (2, 1, 0),
    }
    assert [(s.team, s.rank, s.separated_by) for s in found.standings] == [
        ("beta", 1, ""),
        ("gamma", 1, ""),
        ("alpha", 3, "count_back"),
    ]


def test_a_disqualified_team_has_no_rank_and_does_not_count_for_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(tmp_path, "alpha", "kit", 1)
    costly = sensor_cost_text({"basic_logical_camera": 9})
    (tmp_path / "logs/alpha/kit_1/sensor_cost.txt").write_text(costly, encoding="utf-8")
    run(tmp_path, "beta", "kit", 1, flaw="color")
    alone = ranked(tmp_path, extra="teams: [{id: beta}]\n")
    found = ranked(tmp_path, extra="teams: [{id: alpha, disqualified: a second robot}, {id: beta}]\n")

    assert [(s.rank, s.team) for s in found.standings] == [(1, "beta"), (None, "alpha")]
    assert found.standings[1].remarks == ("disqualified: a second robot",)
    assert found.cohort is not None
    assert alone.cohort is not None
    assert found.cohort.trials == alone.cohort.trials
    assert main(["rank", str(tmp_path)]) == 0  # nothing is left to look at
    assert "disqualified: a second robot" in capsys.readouterr().out


def test_all_disqualified_is_a_ranking_without_ranks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run(tmp_path, "alpha", "kit", 1)
    ranked(tmp_path, extra="teams: [{id: alpha, disqualified: gone}]\n")

    assert main(["rank", str(tmp_path)]) == 0
    out = capsys.readouterr().out
    assert "no run of a ranked team has a score" in out


@pytest.mark.parametrize(
    ("block", "cause"),
    [
        ("ties: [{count_back: scores}]", "'scores'"),
        ("ties: [{most: execution}]", "unknown key 'most'"),
        ("intervals: {draws: 5}", "5 is less than the minimum"),
        ("intervals: {level: 1}", "1 is greater than the maximum"),
        ("intervals: {resample: teams}", "'teams'"),
        ("intervals: {sead: 1}", "unknown key 'sead'"),
    ],
)
def test_what_cannot_be_declared_is_refused(tmp_path: Path, block: str, cause: str) -> None:
    run(tmp_path, "alpha", "kit", 1)

    with pytest.raises(DataFileError) as refused:
        ranked(tmp_path, extra=f"ranking: {{{block}}}\n")

    assert cause in str(refused.value)


# Published and read back -----------------------------------------------------------------


@pytest.fixture(scope="module")
def published(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("published")
    arguments = ["rank", str(EXAMPLE), "--output-format", "json", "-o", str(folder / "ranking.json")]
    assert main([*arguments, "--results", str(folder / "results")]) == 0
    return folder


@pytest.mark.slow
def test_a_ranking_reads_back_as_it_was(published: Path) -> None:
    data = json.loads((published / "ranking.json").read_text(encoding="utf-8"))
    found = load_publication(published / "ranking.json")

    assert schema_errors(data, "ranking") == []
    assert found.folder == "results"
    assert [(s.team, s.rank, f"{s.execution:f}") for s in found.ranking.standings] == [
        ("borealis", 1, "151.597897950"),
        ("aurora", 2, "94.530486838"),
        ("cygnus", 3, "90.249926201"),
    ]
    assert len(found.results) == 45
    assert found.statistics is not None
    teams = data["statistics"]["teams"]
    assert [one["rank_low"] for one in teams] == [odds.rank_low for odds in found.statistics.teams]
    for key, stored in found.results.items():
        assert stored.file == f"{key[0]}/{key[1]}_{key[2]}.json"


@pytest.mark.slow
def test_the_same_runs_give_the_same_bytes(published: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stored = published / "results"
    again = published / "again.yaml"
    again.write_text(
        "id: example2024\nrules: ariac2024.official\nruns: results/{team}/{trial}_{run}.json\n",
        encoding="utf-8",
    )
    assert stored.is_dir()
    texts = []
    for _ in range(2):
        assert main(["rank", str(again), "--output-format", "json"]) == 0
        texts.append(capsys.readouterr().out)

    assert texts[0] == texts[1]
    first = json.loads((published / "ranking.json").read_text(encoding="utf-8"))
    assert json.loads(texts[0])["statistics"] == first["statistics"]


def test_three_trials_of_the_example_tell_nobody_apart_on_trials_like_these(published: Path) -> None:
    found = load_publication(published / "ranking.json").statistics

    assert found is not None
    assert {(odds.rank_low, odds.rank_high, odds.chances) for odds in found.teams} == {(1, 3, ())}
    assert {pair.told for pair in found.pairs} == {""}
    assert min(pair.p for pair in found.pairs) >= 1 / 8  # three trials: no smaller chance than 2^-3
    assert "3 trials in which two teams differ" in found.notes[0]


def test_a_ranking_of_the_version_before_is_read_without_its_statistics(
    published: Path, tmp_path: Path
) -> None:
    # They told equal teams apart where trials were few.
    data = json.loads((published / "ranking.json").read_text(encoding="utf-8"))
    data |= {"schema": "ariac-score/ranking/3", "statistics": {"pairs": "of that version"}}
    (tmp_path / "ranking.json").write_text(json.dumps(data), encoding="utf-8")

    assert load_publication(tmp_path / "ranking.json").statistics is None


Edit = Callable[[dict[str, Any]], object]


@pytest.mark.parametrize(
    ("edit", "cause"),
    [
        (lambda d: d["standings"][0].update(execution=999), "its trials add up to 151.59789795"),
        (lambda d: d["standings"][0].update(rnak=1), "unknown key 'rnak'"),
        (lambda d: d["standings"][0]["trials"].pop("kitting"), "other trials than are listed"),
        (lambda d: d["standings"].append(d["standings"][0]), "stands in it twice"),
        (lambda d: d["runs"][0].update(team="nobody"), "is of nobody listed"),
        (lambda d: d["runs"][0]["result"].update(file="../secret.json"), "leads out of the folder"),
        (lambda d: d["runs"][0]["result"].update(file="a/../../b.json"), "leads out of the folder"),
        (lambda d: d["runs"][0]["result"].update(file="/etc/passwd"), "leads out of the folder"),
        (lambda d: d["statistics"]["teams"][0].update(team="nobody"), "statistics are of other teams"),
        (lambda d: d.update(schema="ariac-score/ranking/1"), "its schema is 'ariac-score/ranking/1'"),
    ],
)
def test_an_edited_ranking_is_refused(published: Path, tmp_path: Path, edit: Edit, cause: str) -> None:
    data = json.loads((published / "ranking.json").read_text(encoding="utf-8"))
    edit(data)
    (tmp_path / "ranking.json").write_text(json.dumps(data), encoding="utf-8")

    with pytest.raises(DataFileError, match=r"ranking\.json") as refused:
        load_publication(tmp_path / "ranking.json")

    assert cause in str(refused.value)


@pytest.mark.parametrize("text", ["", "[]", "{", '{"schema": "ariac-score/result/1"}', "null", "7"])
def test_what_is_no_ranking_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "ranking.json").write_text(text, encoding="utf-8")

    with pytest.raises(DataFileError):
        load_publication(tmp_path / "ranking.json")


def test_results_of_different_rules_are_not_ranked_together(published: Path, tmp_path: Path) -> None:
    ours = tmp_path / "ours.yaml"
    ours.write_text(
        "id: ours\ntitle: Ours\nsource: a test\nextends: ariac2024.official\nround: 3\n", encoding="utf-8"
    )
    other = published / "results/aurora/kitting_1.json"
    stored = tmp_path / "stored/aurora"
    stored.mkdir(parents=True)
    price = ["price", str(other), "--rules", str(ours), "--output-format", "json"]
    assert main([*price, "-o", str(stored / "kitting_1.json")]) in (0, 6)
    (stored / "kitting_2.json").write_bytes((published / "results/aurora/kitting_2.json").read_bytes())
    (tmp_path / "competition.yaml").write_text(
        "id: mixed\nrules: ariac2024.official\nruns: stored/{team}/{trial}_{run}.json\n", encoding="utf-8"
    )
    competition = load_competition(tmp_path)

    with pytest.raises(ResultError) as refused:
        score_runs(competition, load_rule_set("ariac2024.official"))

    assert "it was made under ariac2024.official" in str(refused.value)
    assert "under ours" in str(refused.value)
    assert "not ranked together" in refused.value.hint


def test_names_that_are_none_for_files_are_written_otherwise(tmp_path: Path) -> None:
    run(tmp_path, "alpha", "kit", 1)
    names = ["..", "a/b", "A", "a", "con ", "x" * 300, "\u202eevil", "=cmd()"]
    found = ranked(tmp_path)
    (made,) = found.runs

    many = replace(found, runs=tuple(replace(made, team=name) for name in names))
    stored = write_results(
        many, tmp_path / "out", lambda text, file: file.write_text(text, encoding="utf-8") and None
    )

    files = {key[0]: entry.file for key, entry in stored.items()}
    assert files["A"] == "A/kit_1.json"
    assert len({file.lower() for file in files.values()}) == len(names)
    written = list((tmp_path / "out").rglob("*.json"))
    assert len(written) == len(names)
    assert all(len(part) < 120 for file in written for part in file.parts[-2:])
    assert not (tmp_path / "kit_1.json").exists()


def test_what_changed_between_two_publications(published: Path, tmp_path: Path) -> None:
    now = load_publication(published / "ranking.json")
    assert not changes_between(now, now).any

    data = json.loads((published / "ranking.json").read_text(encoding="utf-8"))
    data["standings"][1], data["standings"][2] = data["standings"][2], data["standings"][1]
    for rank, standing in enumerate(data["standings"], start=1):
        standing["rank"] = rank
    gone = data["runs"].pop()
    data["runs"][0]["inputs"][0]["sha256"] = "0" * 64
    data["rule_set"]["sha256"] = "1" * 64
    data["how"]["keep"] = 2
    (tmp_path / "old.json").write_text(json.dumps(data), encoding="utf-8")

    changes = changes_between(load_publication(tmp_path / "old.json"), now)

    assert changes.any
    assert [(t.team, t.rank_before, t.rank) for t in changes.teams] == [
        ("borealis", 1, 1),
        ("aurora", 3, 2),
        ("cygnus", 2, 3),
    ]
    assert {(c.key, c.what) for c in changes.runs} == {
        ((gone["team"], gone["trial"], gone["run"]), "new"),
        (("aurora", "assembly", 1), "scored from other files"),
    }
    assert changes.rules is not None
    assert changes.how == ("keep",)


def test_a_ranking_without_results_names_none(tmp_path: Path) -> None:
    run(tmp_path, "alpha", "kit", 1)
    found = ranked(tmp_path)
    rules = load_rule_set("ariac2024.official")
    (tmp_path / "r.json").write_text(ranking_json(found, ranking_spec(rules, {}, file="")), encoding="utf-8")

    read = load_publication(tmp_path / "r.json")

    assert (read.folder, dict(read.results), read.statistics) == ("", {}, None)
    assert read.ranking.standings[0].execution == Decimal(5)
