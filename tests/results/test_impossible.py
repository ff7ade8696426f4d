"""A stored finding that cannot be has no price, whoever wrote it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ariac_score import Result, Verdict, as_json, score_trial
from ariac_score.cli import main
from ariac_score.errors import ResultError
from ariac_score.ranking.competition import load_competition
from ariac_score.ranking.runs import score_runs
from ariac_score.scoring.ruleset import load_rule_set

LOG = Path(__file__).parents[2] / "examples/kitting_near_miss.mcap"
RULES = "paper2020.published"


@pytest.fixture(scope="module")
def scored() -> Result:
    return score_trial(LOG, RULES)


def impossible(result: Result) -> tuple[str, Result]:
    """The result with a violation that has a margin above 0, which changes no price."""
    key, finding = next(
        (k, f)
        for k, f in result.measured.findings.items()
        if f.verdict is Verdict.VIOLATED and f.robustness is not None
    )
    findings = {**result.measured.findings, key: replace(finding, robustness=0.25)}
    return key, replace(result, measured=replace(result.measured, findings=findings))


def test_price_refuses_it_and_names_file_finding_and_field(
    scored: Result, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key, forged = impossible(scored)
    file = tmp_path / "forged.json"
    file.write_text(as_json(forged), encoding="utf-8")

    assert main(["price", str(file), "--rules", RULES]) == 6

    out, err = capsys.readouterr()
    assert out == ""
    assert f"forged.json: the finding {key} cannot be: its robustness is +0.25" in err
    file.write_text(as_json(scored), encoding="utf-8")
    assert main(["price", str(file), "--rules", RULES]) == 0


def test_rank_gives_such_a_run_no_result(scored: Result, tmp_path: Path) -> None:
    key, forged = impossible(scored)
    (tmp_path / "competition.yaml").write_text(
        "{id: cup, rules: paper2020.published, runs: 'results/{team}/{trial}_{run}.json', "
        "teams: [{id: honest}, {id: forger}], trials: [{id: kitting_near_miss}]}",
        encoding="utf-8",
    )
    for team, result in (("honest", scored), ("forger", forged)):
        folder = tmp_path / "results" / team
        folder.mkdir(parents=True)
        (folder / "kitting_near_miss_1.json").write_text(as_json(result), encoding="utf-8")

    results = score_runs(load_competition(tmp_path, RULES), load_rule_set(RULES))

    refused = [one for one in results.values() if isinstance(one, ResultError)]
    assert len(refused) == 1
    assert f"the finding {key} cannot be" in str(refused[0])
