"""A ranking with the decisions of stewards and the automatic one."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from ariac_score import Signal, Span, Trial, load_result, load_rule_set
from ariac_score.cli import main
from ariac_score.documents.schema import schema_errors
from ariac_score.ranking.adjusting import adjusted_ranking
from ariac_score.ranking.competition import load_competition
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import ranking_spec
from ariac_score.results.adjustments import Adjustments
from ariac_score.results.result_file import measured_sha256
from ariac_score.scoring.steward import Adjustment
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

ROOT = Path(__file__).parents[2]
COMPETITION = ROOT / "examples/competition/2024"

Rank = Callable[..., str]


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("results")
    assert main(["rank", str(COMPETITION), "--results", str(folder), "-o", str(folder / "ranking.txt")]) == 0
    # From here on the stored results of one trial are ranked, which takes no logs.
    text = (COMPETITION / "competition.yaml").read_text(encoding="utf-8")
    text = text.replace("logs/{team}/{trial}_{run}", "'{team}/{trial}_{run}.json'")
    text = text.replace("trial_configs: trials/{trial}.yaml\n", "")
    text = text.replace("[{id: assembly}, {id: kitting}, {id: mixed_tasks}]", "[{id: kitting}]")
    (folder / "competition.yaml").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture
def rank(results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Rank:
    def ranked(*decisions: Any, output: str = "json", code: int = 0) -> str:
        file = tmp_path / "adjustments.yaml"
        file.write_text(yaml.safe_dump({"adjustments": list(decisions)}))
        command = ["rank", str(results), "--adjustments", str(file), "--output-format", output]
        assert main(command) == code
        out, err = capsys.readouterr()
        return out if code == 0 else err

    return ranked


def decision(results: Path, team: str, trial: str, run: int, effect: Any, **more: Any) -> dict[str, Any]:
    measured = measured_sha256(load_result(results / team / f"{trial}_{run}.json"))
    return {
        "id": f"{team}_{trial}_{run}",
        "author": "The jury",
        "reason": "see protocol 3",
        "time": "2024-05-12T14:30:00Z",
        "target": {"team": team, "trial": trial, "run": run, "measured": measured, **more},
        "effect": effect,
    }


def executions(ranking: dict[str, Any]) -> dict[str, float]:
    return {s["team"]: s["execution"] for s in ranking["standings"]}


@pytest.mark.slow
def test_both_rankings_are_there_and_the_automatic_one_is_untouched(
    results: Path, rank: Rank, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rank", str(results), "--output-format", "json"]) == 0
    automatic = json.loads(capsys.readouterr().out)

    data = json.loads(rank(decision(results, "aurora", "kitting", 1, {"points": 100})))
    assert schema_errors(data, "ranking") == []
    adjusted, data["adjusted"] = data["adjusted"], None
    assert data == automatic
    # The run is the best one of the trial, so the whole amount arrives, and only there.
    before, after = executions(automatic), executions(adjusted)
    assert after["aurora"] - before["aurora"] == pytest.approx(100)
    assert {t: after[t] for t in after if t != "aurora"} == {t: before[t] for t in before if t != "aurora"}
    assert [s["team"] for s in adjusted["standings"]] == ["aurora", "borealis", "cygnus"]
    assert [s["team"] for s in automatic["standings"]] == ["borealis", "aurora", "cygnus"]


def test_without_its_best_run_a_team_falls_back_on_the_next_best(results: Path, rank: Rank) -> None:
    data = json.loads(rank(decision(results, "borealis", "kitting", 1, {"disqualified": True})))
    runs = {(r["team"], r["trial"], r["run"]): r for r in data["adjusted"]["runs"]}
    cell = next(s for s in data["adjusted"]["standings"] if s["team"] == "borealis")["trials"]["kitting"]

    assert runs["borealis", "kitting", 1]["outcome"] == "disqualified"
    assert runs["borealis", "kitting", 1]["score"] == 0
    # Run 4 has the task score 18, the most after run 1 with 22.
    assert cell["runs"] == [4]
    assert cell["score"] == runs["borealis", "kitting", 4]["score"]


def test_points_of_a_decision_count_when_the_best_run_is_chosen(results: Path, rank: Rank) -> None:
    # Run 4 had 18 against 22: five more points make it the better one.
    data = json.loads(rank(decision(results, "borealis", "kitting", 4, {"points": 5})))
    cell = next(s for s in data["adjusted"]["standings"] if s["team"] == "borealis")["trials"]["kitting"]

    assert cell["runs"] == [4]


def test_the_text_has_both_tables_every_decision_and_what_moved(results: Path, rank: Rank) -> None:
    text = rank(decision(results, "aurora", "kitting", 1, {"points": 100}), output="text")

    assert text.index("As adjusted by the stewards") < text.index("Decisions") < text.index("Automatic")
    assert "Team Aurora: 38.053934511 -> 138.053934511, rank 2 -> 1" in text
    assert "The jury, 2024-05-12T14:30:00Z: see protocol 3" in text


def test_the_table_has_the_automatic_rank_as_well(results: Path, rank: Rank) -> None:
    lines = rank(decision(results, "aurora", "kitting", 1, {"points": 100}), output="csv").splitlines()

    assert ",automatic rank,automatic value," in lines[0]
    assert lines[1].startswith("1,aurora,")
    assert ",2,38.053934511," in lines[1]


def test_a_competition_can_name_its_decisions(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "cup"
    for name in ("aurora", "cygnus"):
        (root / "runs" / name).mkdir(parents=True)
        for number in (1, 2):
            stored = results / name / f"kitting_{number}.json"
            (root / "runs" / name / stored.name).write_bytes(stored.read_bytes())
    (root / "competition.yaml").write_text(
        "id: cup\nrules: ariac2024.official\nruns: runs/{team}/{trial}_{run}.json\n"
        "adjustments: decided.yaml\n"
    )
    own = decision(results, "cygnus", "kitting", 2, {"disqualified": True})
    (root / "decided.yaml").write_text(yaml.safe_dump({"adjustments": [own]}))

    assert main(["rank", str(root)]) == 0
    assert "cygnus, kitting, run 2" in capsys.readouterr().out


def test_a_stored_result_that_is_adjusted_already_is_not_ranked_as_if_automatic(
    results: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "a.yaml"
    own = decision(results, "aurora", "kitting", 1, {"points": 100})
    file.write_text(yaml.safe_dump({"adjustments": [own]}))
    target = tmp_path / "runs/aurora/kitting_1.json"
    target.parent.mkdir(parents=True)
    stored = str(results / "aurora/kitting_1.json")
    assert main(["adjust", stored, str(file), "--output-format", "json", "-o", str(target)]) == 0
    (tmp_path / "competition.yaml").write_text(
        "id: cup\nrules: ariac2024.official\nruns: runs/{team}/{trial}_{run}.json\n"
    )

    assert main(["rank", str(tmp_path)]) == 6
    assert "adjusted by stewards already" in capsys.readouterr().out


# An undecided run ------------------------------------------------------------------------

_DISTANCE = "centre_distance/robot/human"
_COMPARED = """\
task: task
cohort:
  mean_task: {of: trial, mean: task}
score: gate(human_contact) * task / (1 + demerits) + cohort.mean_task
"""


def far_away(*, unseen: Span | None = None) -> Trial:
    """The made trial of 28 points, the human 5 m further away; for a while nobody sees how far."""
    trial = kitting_trial()
    distance = trial.signals[_DISTANCE]
    seen = np.ones(len(distance.t), dtype=bool)
    if unseen is not None:
        seen = (distance.t < unseen.start_s) | (distance.t > unseen.end_s)
    signal = Signal(_DISTANCE, "m", distance.t[seen], distance.values[seen] + 5.0)
    return replace(trial, signals={**trial.signals, _DISTANCE: signal})


@pytest.mark.parametrize(("rules", "score"), [("", 28), (_COMPARED, 28 + 28)], ids=["alone", "compared"])
def test_a_withheld_run_that_is_decided_gets_the_score_that_a_complete_log_has(
    rules: str, score: int, tmp_path: Path
) -> None:
    for team, trial in (("whole", far_away()), ("hidden", far_away(unseen=Span(20.0, 30.0)))):
        (tmp_path / team).mkdir()
        write_trial_log(tmp_path / team / "kit_1.jsonl", trial, signals=SNAPSHOT_SIGNALS)
    own = f"id: mine\ntitle: Mine\nsource: a test\nextends: paper2020.published\nopen: withhold\n{rules}"
    (tmp_path / "mine.yaml").write_text(own, encoding="utf-8")
    (tmp_path / "competition.yaml").write_text(
        "id: test\nrules: ./mine.yaml\nruns: '{team}/{trial}_{run}.jsonl'\n", encoding="utf-8"
    )
    competition = load_competition(tmp_path)
    rule_set = load_rule_set(competition.rules)
    spec = ranking_spec(rule_set, competition.ranking, file="competition.yaml")
    found = rank_results(competition, spec, rule_set, score_runs(competition, rule_set))
    hidden = next(run.result for run in found.runs if run.team == "hidden")
    assert hidden is not None
    measured = measured_sha256(hidden)
    decisions = [
        Adjustment(
            id=check,
            author="The jury",
            reason="the video shows it",
            time="2024-05-12T14:30:00Z",
            measured=measured,
            trial="kit",
            team="hidden",
            run=1,
            finding=f"{check}#1",
            verdict="satisfied",
        )
        for check in ("separation", "human_contact")
    ]

    after = adjusted_ranking(
        competition, spec, rule_set, found, Adjustments("a.yaml", "0" * 64, tuple(decisions))
    )

    assert after.stewarded is not None
    automatic, adjusted = (
        {run.team: (run.outcome, run.score) for run in ranking.runs}
        for ranking in (after, after.stewarded.ranking)
    )
    assert automatic == {"whole": ("scored", score), "hidden": ("undecided", None)}
    assert adjusted == {"whole": ("scored", score), "hidden": ("scored", score)}


@pytest.mark.parametrize(
    ("changed", "cause"),
    [
        ({"team": "aurroa"}, "no run of aurroa, kitting, run 1"),
        ({"trial": "kiting"}, "no run of aurora, kiting, run 1"),
        ({"run": 9}, "no run of aurora, kitting, run 9"),
        ({"run": 2}, "made for another result"),
        ({"measured": "0" * 64}, "made for another result"),
        ({"finding": "nothing#1"}, "a finding has a verdict"),
    ],
)
def test_a_decision_about_no_run_of_the_competition_is_refused(
    changed: dict[str, Any], cause: str, results: Path, rank: Rank
) -> None:
    own = decision(results, "aurora", "kitting", 1, {"points": 1})
    own["target"].update(changed)

    assert cause in rank(own, code=4)


def test_the_organisers_own_program_knows_no_stewards(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["rank", str(COMPETITION), "--policy", "strict", "--adjustments", str(tmp_path / "a.yaml")]

    assert main(command) == 4
    assert "knows no stewards" in capsys.readouterr().err


@pytest.fixture(scope="module")
def beside_a_lost_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A competition of one trial: one team with a run, one whose only log is lost."""
    root = tmp_path_factory.mktemp("lost")
    for team in ("whole", "lost"):
        (root / team).mkdir()
    write_trial_log(root / "whole/kit_1.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)
    (root / "lost/kit_1.jsonl").write_text("not a log\n", encoding="utf-8")
    (root / "competition.yaml").write_text(
        "id: cup\nrules: paper2020\nruns: '{team}/{trial}_{run}.jsonl'\nadjustments: adjustments.yaml\n",
        encoding="utf-8",
    )
    return root


def about_the_lost(root: Path, effect: Any, **target: Any) -> None:
    whose = {"team": "lost", "trial": "kit", "run": 1, "measured": "lost", **target}
    own = {"id": "lost_1", "author": "The jury", "reason": "our disk failed; protocol 4"}
    own = {**own, "time": "2024-05-12T14:30:00Z", "target": whose, "effect": effect}
    (root / "adjustments.yaml").write_text(yaml.safe_dump({"adjustments": [own]}), encoding="utf-8")


def test_stewards_give_a_run_a_score_whose_log_the_organiser_lost_and_it_is_a_line_of_its_own(
    beside_a_lost_log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    about_the_lost(beside_a_lost_log, {"score": 20})
    assert main(["rank", str(beside_a_lost_log), "-o", str(tmp_path / "ranking.json")]) == 0
    published = json.loads((tmp_path / "ranking.json").read_text(encoding="utf-8"))
    assert main(["rank", str(beside_a_lost_log)]) == 0
    text = capsys.readouterr().out

    assert schema_errors(published, "ranking") == []
    assert executions(published)["lost"] == 0
    assert executions(published["adjusted"])["lost"] == 20
    assert "lost, kit, run 1: none -> 20" in text
    assert "The jury, 2024-05-12T14:30:00Z: our disk failed; protocol 4" in text
    # What the file says is computed again, with the lost log as it lies there.
    assert main(["verify", str(tmp_path / "ranking.json"), "--log", str(beside_a_lost_log)]) == 0


@pytest.mark.parametrize(
    ("effect", "target", "cause"),
    [
        ({"points": 3}, {}, "nothing was measured of this run"),
        ({"score": 20}, {"team": "whole"}, "made for another result"),
        ({"score": 20}, {"measured": "0" * 64}, "made for another result"),
        ({"score": 0.12345678}, {}, "has more than 6 decimals"),
    ],
)
def test_nothing_but_a_score_is_decided_of_a_lost_log(
    effect: Any,
    target: dict[str, Any],
    cause: str,
    beside_a_lost_log: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    about_the_lost(beside_a_lost_log, effect, **target)

    assert main(["rank", str(beside_a_lost_log)]) == 4
    assert cause in capsys.readouterr().err
