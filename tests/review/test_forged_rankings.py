"""Forged rankings, each by a forger who keeps all sums right; none of them reads as holding."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from msgspec import convert

from ariac_score import load_result
from ariac_score.cli import main
from ariac_score.results.cohort_file import Cohort, CohortMean
from ariac_score.results.result import Pinned
from ariac_score.results.result_file import measured_sha256
from ariac_score.review.verify_ranking import verify_ranking
from ariac_score.testing.stored import rewritten
from ariac_score_ariac.testing.official_texts import (
    Outcome,
    PlannedOrder,
    sensor_cost_text,
    trial_log_text,
)

DOCS = (Path(__file__).parents[2] / "docs/fairness.md").read_text(encoding="utf-8")
KIT = (PlannedOrder("AAAA0001", "kitting", False, (("pump", "red"),)),)
FLAWS = {"owl": ("", ""), "fox": ("", "faulty"), "hen": ("faulty", "faulty")}

Ranking = dict[str, Any]

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def cup(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A competition of three teams, two trials, one run each; the owl is best, then the fox."""
    root = tmp_path_factory.mktemp("cup")
    for team, flaws in FLAWS.items():
        for trial, flaw in zip(("kit", "set"), flaws, strict=True):
            folder = root / "logs" / team / f"{trial}_1"
            folder.mkdir(parents=True)
            text = trial_log_text(trial, KIT, [Outcome((flaw,), 50.0)])
            (folder / "trial_log.txt").write_text(text, encoding="utf-8")
            cost = sensor_cost_text({"basic_logical_camera": 2})
            (folder / "sensor_cost.txt").write_text(cost, encoding="utf-8")
    text = "id: cup\nrules: ariac2024.official\nruns: 'logs/{team}/{trial}_{run}'\nranking: {keep: 1}\n"
    (root / "competition.yaml").write_text(text, encoding="utf-8")
    return root


@pytest.fixture(scope="module")
def honest(cup: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What `rank` published: ranking.json and the results beside it."""
    out = tmp_path_factory.mktemp("published")
    assert (
        main(["-q", "rank", str(cup), "-o", str(out / "ranking.json"), "--results", str(out / "results")])
        == 0
    )
    return out


@pytest.fixture
def published(honest: Path, tmp_path: Path) -> Path:
    """The same, for a forger to work on."""
    for file in honest.rglob("*.json"):
        place = tmp_path / file.relative_to(honest)
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(file.read_bytes())
    return tmp_path


def of(ranking: Ranking, team: str) -> Any:
    return next(one for one in ranking["standings"] if one["team"] == team)


def a_rank(ranking: Ranking) -> None:
    of(ranking, "fox")["rank"] = 1


def two_teams_swapped(ranking: Ranking) -> None:
    first, second, *rest = ranking["standings"]
    first["rank"], second["rank"] = 2, 1
    ranking["standings"] = [second, first, *rest]


def a_score_with_its_sums(ranking: Ranking) -> None:
    run = next(run for run in ranking["runs"] if (run["team"], run["trial"]) == ("hen", "set"))
    hen = of(ranking, "hen")
    run["score"] += 1
    hen["trials"]["set"]["score"] += 1
    for key in ("execution", "value"):
        hen[key] = round(hen[key] + 1, 9)


def a_score_without_results(ranking: Ranking) -> None:
    a_score_with_its_sums(ranking)
    no_results(ranking)


def no_results(ranking: Ranking) -> None:
    ranking["folder"] = ""
    for run in ranking["runs"]:
        run["result"] = None


def a_team_less(ranking: Ranking) -> None:
    ranking["standings"] = [one for one in ranking["standings"] if one["team"] != "hen"]
    ranking["runs"] = [one for one in ranking["runs"] if one["team"] != "hen"]
    sure = ranking["statistics"]
    sure["teams"] = [one for one in sure["teams"] if one["team"] != "hen"]


def a_run_less(ranking: Ranking) -> None:
    run = next(run for run in ranking["runs"] if run["team"] == "fox" and run["trial"] == "set")
    run |= {"outcome": "cancelled", "reason": "no run", "score": None, "kept": False, "result": None}


def cohort_values(ranking: Ranking) -> None:
    means = json.dumps(ranking["cohort"]["trials"])
    ranking["cohort"]["trials"] = json.loads(means, parse_float=lambda text: float(text) + 1)


def cohort_values_with_their_hash(ranking: Ranking) -> None:
    cohort_values(ranking)
    cohort = ranking["cohort"]
    trials = convert(cohort["trials"], dict[str, dict[str, dict[str, CohortMean]]])
    cohort["sha256"] = Cohort.of(convert(cohort["rule_set"], Pinned), trials).sha256


def how_many_runs_count(ranking: Ranking) -> None:
    ranking["how"]["keep"] = 2


def how_sure_it_is(ranking: Ranking) -> None:
    pair = ranking["statistics"]["pairs"][0]
    pair["told"] = pair["first"]


def no_statistics(ranking: Ranking) -> None:
    ranking["statistics"] = None


def the_rules(ranking: Ranking) -> None:
    ranking["rule_set"]["sha256"] = "0" * 64


@dataclass(frozen=True)
class Forgery:
    """One kind of forgery.

    Attributes:
        name: As docs/fairness.md lists it.
        edit: What the forger changes.
        step: The step that fails, of those with the logs.
        alone: Whether it fails without the logs as well.
    """

    name: str
    edit: Callable[[Ranking], None]
    step: str
    alone: bool


FORGERIES = (
    Forgery("a rank", a_rank, "ranks", True),
    Forgery("two teams swapped", two_teams_swapped, "ranks", True),
    Forgery("the score of a run, with all sums", a_score_with_its_sums, "results", True),
    Forgery("the same, without results", a_score_without_results, "recomputed", False),
    Forgery("a team left out", a_team_less, "recomputed", False),
    Forgery("a run said not to have been made", a_run_less, "recomputed", False),
    Forgery("the values across teams in a ranking", cohort_values, "sums", True),
    Forgery("the same, with their hash", cohort_values_with_their_hash, "recomputed", False),
    Forgery("how many runs count", how_many_runs_count, "recomputed", False),
    Forgery("how sure a ranking is", how_sure_it_is, "recomputed", False),
    Forgery("how sure a ranking is, left out", no_statistics, "recomputed", False),
    Forgery("the hash of a ranking's rules", the_rules, "rules", True),
)


def write(file: Path, ranking: Ranking) -> None:
    """As the program writes it, so that the bytes tell nothing."""
    text = json.dumps(ranking, indent=1, sort_keys=True, ensure_ascii=False)
    file.write_text(f"{text}\n", encoding="utf-8")


def test_what_was_published_holds_with_its_logs_and_is_consistent_without(
    cup: Path, published: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = published / "ranking.json"

    assert main(["verify", str(file), "--log", str(cup)]) == 0
    assert capsys.readouterr().out.endswith("it holds\n")
    assert main(["verify", str(file)]) == 8
    out = capsys.readouterr().out
    assert out.endswith("consistent in itself; not compared with a log\n")
    assert "it holds" not in out


@pytest.mark.parametrize("forgery", FORGERIES, ids=lambda one: one.name)
def test_a_forged_ranking_is_refused_by_name(forgery: Forgery, cup: Path, published: Path) -> None:
    file = published / "ranking.json"
    ranking = json.loads(file.read_text(encoding="utf-8"))
    forgery.edit(ranking)
    write(file, ranking)

    alone, found = verify_ranking(file), verify_ranking(file, log=cup)

    assert not alone.holds
    assert bool(set(alone.steps_that_are("failed")) - {"bytes"}) is forgery.alone
    assert forgery.step in found.steps_that_are("failed")


def test_a_result_that_is_not_the_one_that_was_ranked_is_refused(cup: Path, published: Path) -> None:
    place = published / "results/hen/kit_1.json"
    place.write_bytes((published / "results/owl/kit_1.json").read_bytes())

    found = verify_ranking(published / "ranking.json")

    assert found.steps_that_are("failed") == ("results",)
    assert "hen/kit/1: its SHA-256 is" in next(s.words for s in found.steps if s.name == "results")


def test_results_forged_with_their_hashes_are_found_out_by_the_logs_alone(cup: Path, published: Path) -> None:
    """The forger names another team in a copy of the best result, and its hash in the ranking."""
    file, place = published / "ranking.json", published / "results/hen/kit_1.json"
    text = place.read_text(encoding="utf-8").replace('"faulty_part', '"no_faulty_part')
    place.write_text(text + " ", encoding="utf-8")
    ranking = json.loads(file.read_text(encoding="utf-8"))
    run = next(run for run in ranking["runs"] if (run["team"], run["trial"]) == ("hen", "kit"))
    run["result"]["sha256"] = hashlib.sha256(place.read_bytes()).hexdigest()
    write(file, ranking)

    assert not verify_ranking(file).holds
    assert "recomputed" in verify_ranking(file, log=cup).steps_that_are("failed")


def test_decisions_that_are_left_out_or_put_in_are_found_out(cup: Path, published: Path) -> None:
    result = load_result(published / "results/hen/kit_1.json")
    decision = f"""adjustments:
  - {{id: d, author: Steward, reason: so, time: 2024-05-12T14:30:00Z, effect: {{points: POINTS}},
     target: {{team: hen, trial: kit, run: 1, measured: {measured_sha256(result)}}}}}
"""
    stewards, forger = published / "adjustments.yaml", published / "forger.yaml"
    stewards.write_text(decision.replace("POINTS", "1"), encoding="utf-8")
    forger.write_text(decision.replace("POINTS", "9"), encoding="utf-8")
    for name, file in (("amended", stewards), ("forged", forger)):
        out = str(published / f"{name}.json")
        assert main(["-q", "rank", str(cup), "--adjustments", str(file), "-o", out]) == 0

    assert verify_ranking(published / "amended.json", log=cup, adjustments=stewards).holds
    alone = verify_ranking(published / "amended.json", log=cup)
    assert (alone.consistent, alone.steps_that_are("open")) == (True, ("adjustments",))
    for name in ("forged", "ranking"):
        found = verify_ranking(published / f"{name}.json", log=cup, adjustments=stewards)
        assert "adjustments" in found.steps_that_are("failed")


def test_a_ranking_of_stored_results_never_holds_for_nothing_compared_them_with_logs(
    published: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (
        "{id: cup, rules: ariac2024.official, ranking: {keep: 1}, runs: 'results/{team}/{trial}_{run}.json'}"
    )
    (published / "competition.yaml").write_text(text, encoding="utf-8")
    second = published / "second.json"
    assert main(["-q", "rank", str(published), "-o", str(second)]) == 0

    assert main(["verify", str(second), "--log", str(published)]) == 8
    assert "6 runs of the competition are stored results" in capsys.readouterr().out


def test_a_ranking_that_calls_itself_older_is_not_proven_to_be_as_sure_as_it_says(
    cup: Path, published: Path
) -> None:
    """Nothing computes the statistics of older versions any more, so a forger may claim to be one."""
    file = published / "ranking.json"
    ranking = json.loads(file.read_text(encoding="utf-8"))
    how_sure_it_is(ranking)
    write(file, {**ranking, "schema": "ariac-score/ranking/3"})

    found = verify_ranking(file, log=cup)

    assert (found.consistent, found.holds) == (True, False)
    assert found.steps_that_are("open") == ("statistics",)


def test_rules_beside_a_ranking_do_not_vouch_for_it(
    cup: Path, published: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A forger names a rule set as a file is named, and sends that file along."""
    monkeypatch.chdir(published)
    text = "id: own.yaml\ntitle: Ours\nsource: a forger\nextends: ariac2024.official\n"
    Path("own.yaml").write_text(text, encoding="utf-8")
    assert main(["-q", "rank", str(cup), "--rules", "./own.yaml", "-o", "own.json"]) == 0

    assert "rules" in verify_ranking(Path("own.json")).steps_that_are("open")


def test_other_code_is_named_where_only_the_files_of_results_differ(cup: Path, published: Path) -> None:
    file, folder = published / "ranking.json", published / "results"
    ranking = json.loads(file.read_text(encoding="utf-8"))
    for run in ranking["runs"]:
        place = folder / run["result"]["file"]
        result = json.loads(place.read_text(encoding="utf-8"))
        result["provenance"]["code"][0] |= {"version": "0.0.9", "sha256": "1" * 64}
        place.write_text(rewritten(result), encoding="utf-8")
        run["result"]["sha256"] = hashlib.sha256(place.read_bytes()).hexdigest()
    write(file, ranking)

    (words,) = [s.words for s in verify_ranking(file, log=cup).steps if s.name == "recomputed"]

    assert words.startswith("the same scores and ranks, in results that are other files\n")
    assert "another ariac_score of ariac-score: version 0.0.9" in words


def test_a_signature_that_is_asked_for_covers_the_ranking(cup: Path, published: Path) -> None:
    pytest.importorskip("minisign")
    file, key = published / "ranking.json", published / "key"
    assert main(["sign", "--new-key", str(key)]) == 0
    call = ["verify", str(file), "--log", str(cup), "--public-key", f"{key}.pub"]
    assert main(call) == 1
    assert main(["sign", str(file), "--key", str(key)]) == 0
    assert main(call) == 0


def test_options_for_a_result_are_refused_for_a_ranking(
    published: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["verify", str(published / "ranking.json"), "--cohort", "cohort.json"]) == 4
    assert "--cohort is for a result, and this is a ranking" in capsys.readouterr().err


def test_the_page_lists_every_forgery() -> None:
    for one in FORGERIES:
        assert f"| {one.name} | `{one.step}` |" in DOCS, one.name
