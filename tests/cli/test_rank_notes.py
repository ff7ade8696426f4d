"""What `rank` says of the runs before it ranks them."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ariac_score.cli import main
from ariac_score.cli.rank import said_beforehand
from ariac_score.ranking.competition import load_competition
from ariac_score.scoring.ruleset import load_rule_set
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score.testing.stored import rewritten
from ariac_score_ariac.testing import kitting_trial


@pytest.mark.parametrize(
    ("more", "runs", "said"),
    [
        ("", {"a": 3, "b": 1}, ["kit: a made 3 runs and b 1, and nothing declares how many count"]),
        ("ranking: {keep: 1}", {"a": 3, "b": 1}, []),
        ("ranking: {missing_run: zero}", {"a": 3, "b": 1}, []),
        ("", {"a": 2, "b": 2}, []),
    ],
)
def test_unequal_numbers_of_runs_without_a_declared_policy_are_said(
    more: str, runs: dict[str, int], said: list[str], tmp_path: Path
) -> None:
    for team, number in runs.items():
        for run in range(1, number + 1):
            (tmp_path / team / f"kit_{run}").mkdir(parents=True)
    text = f"id: cup\nrules: paper2020.published\nruns: '{{team}}/{{trial}}_{{run}}'\n{more}\n"
    (tmp_path / "competition.yaml").write_text(text, encoding="utf-8")

    found = list(said_beforehand(load_competition(tmp_path), load_rule_set("paper2020.published")))

    assert [words[: len(begin)] for words, begin in zip(found, said, strict=True)] == said


@pytest.mark.slow
def test_twelve_of_twelve_undecided_runs_give_no_ranks(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = [name for name in SNAPSHOT_SIGNALS if "human" not in name]
    for place in (f"{team}/k{trial}_1.jsonl" for team in "ab" for trial in range(6)):
        (tmp_path / place).parent.mkdir(exist_ok=True)
        write_trial_log(tmp_path / place, kitting_trial(), signals=kept)
    rules = (
        "{id: w, title: W, source: a test, extends: paper2020.published, log_map: ariac2020, open: withhold}"
    )
    (tmp_path / "w.yaml").write_text(rules, encoding="utf-8")
    text = "{id: cup, rules: w.yaml, runs: '{team}/{trial}_{run}.jsonl'}"
    (tmp_path / "competition.yaml").write_text(text, encoding="utf-8")

    assert main(["rank", str(tmp_path), "--output-format", "json"]) == 6

    ranking = json.loads(capsys.readouterr().out)
    assert [team["rank"] for team in ranking["standings"]] == [None, None]
    assert len(ranking["runs"]) == 12


def test_stored_results_are_said_not_to_be_compared_with_their_logs(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "a/kit_1.json").write_text("{}", encoding="utf-8")
    text = "{id: cup, rules: paper2020.published, runs: '{team}/{trial}_{run}.json'}"
    (tmp_path / "competition.yaml").write_text(text, encoding="utf-8")

    (words,) = said_beforehand(load_competition(tmp_path), load_rule_set("paper2020.published"))

    assert words.startswith("1 of 1 runs are stored results")


def test_stored_results_of_other_rules_or_other_code_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """They are priced by the rules that are installed; what measured them is their own word."""
    example = Path(__file__).parents[2] / "tests/data/as_published/kitting_near_miss.result.json"
    result = json.loads(example.read_text(encoding="utf-8"))
    code = {"distribution": "ariac-score", "version": "0.0.9", "package": "ariac_score", "sha256": "1" * 64}
    result["provenance"]["code"] = [code]
    result["rules"] += "# with a word more\n"
    own = hashlib.sha256(result["rules"].encode("utf-8")).hexdigest()
    result["provenance"]["rule_set"]["sha256"] = own
    (tmp_path / "a").mkdir()
    (tmp_path / "a/kitting_near_miss_1.json").write_text(rewritten(result), encoding="utf-8")
    text = "{id: cup, rules: paper2020.published, runs: '{team}/{trial}_{run}.json', ranking: {keep: 1}}"
    (tmp_path / "competition.yaml").write_text(text, encoding="utf-8")

    assert main(["rank", str(tmp_path)]) == 0

    said = capsys.readouterr().err
    assert f"stored results state another paper2020.published, SHA-256 {own[:12]}…, than" in said
    assert (
        "made by other code than is installed here: ariac_score of ariac-score 0.0.9, 111111111111…" in said
    )


def test_recordings_that_two_runs_share_are_named_at_both_teams(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for place in ("a/kit_1.jsonl", "b/kit_1.jsonl", "c/kit_1.jsonl"):
        (tmp_path / place).parent.mkdir()
    log = write_trial_log(tmp_path / "a/kit_1.jsonl", kitting_trial(), signals=SNAPSHOT_SIGNALS)
    (tmp_path / "b/kit_1.jsonl").write_bytes(log.read_bytes())
    write_trial_log(tmp_path / "c/kit_1.jsonl", kitting_trial(seed=7), signals=SNAPSHOT_SIGNALS)
    text = "{id: cup, rules: paper2020.published, runs: '{team}/{trial}_{run}.jsonl', ranking: {keep: 1}}"
    (tmp_path / "competition.yaml").write_text(text, encoding="utf-8")

    assert main(["rank", str(tmp_path)]) == 0

    out = capsys.readouterr().out
    assert "  a: kit, run 1: its recording is, byte for byte, also that of b, kit, run 1\n" in out
    assert "  b: kit, run 1: its recording is, byte for byte, also that of a, kit, run 1\n" in out
    assert "  c: kit" not in out


def _scored_season(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, dict[str, Any]]:
    """The table of a batch of one run, in the folder `season` of the working directory, and its row."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.chdir(folder)
    Path("a").mkdir()
    write_trial_log(Path("a/kit_1.jsonl"), kitting_trial(), signals=SNAPSHOT_SIGNALS)
    text = "{id: cup, rules: paper2020.published, runs: '{team}/{trial}_{run}.jsonl', ranking: {keep: 1}}"
    Path("competition.yaml").write_text(text, encoding="utf-8")
    assert main(["batch", ".", "-o", "season", "-j", "1"]) == 0
    table = Path("season/runs.jsonl")
    return table, json.loads(table.read_text(encoding="utf-8"))


@pytest.mark.slow
def test_a_table_of_a_batch_that_says_another_score_than_its_result_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    table, row = _scored_season(tmp_path, monkeypatch)
    table.write_text(json.dumps({**row, "score": 99.0}) + "\n", encoding="utf-8")

    assert main(["rank", ".", "--batch", "season"]) == 7

    assert "its row says 99.0, the result" in capsys.readouterr().err


@pytest.mark.slow
def test_a_result_of_a_batch_that_was_rewritten_with_its_row_is_not_ranked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    table, row = _scored_season(tmp_path, monkeypatch)
    result = Path("season", row["object"])
    forged = result.read_text(encoding="utf-8").replace(f'"score": {row["score"]}', '"score": 99.0')
    result.write_text(forged, encoding="utf-8")
    sha256 = hashlib.sha256(forged.encode("utf-8")).hexdigest()
    table.write_text(json.dumps({**row, "score": 99.0, "sha256": sha256}) + "\n", encoding="utf-8")
    capsys.readouterr()

    assert main(["rank", ".", "--batch", "season"]) == 7

    said = capsys.readouterr()
    assert "99.0" in said.err
    assert str(result) in said.err
    assert said.out == ""


@pytest.mark.slow
@pytest.mark.parametrize(("more", "said"), [("", 1), ("completeness: believed", 0)])
def test_runs_whose_logs_nobody_attests_are_counted_once_where_the_rules_leave_it_open(
    more: str, said: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two recorded runs without a recorder's manifest, and one that was not read: 2 of 2 have a result."""
    for place in ("a/kit_1.jsonl", "b/kit_1.jsonl", "c/kit_1.jsonl"):
        (tmp_path / place).parent.mkdir()
    for seed, team in enumerate("ab"):
        write_trial_log(tmp_path / team / "kit_1.jsonl", kitting_trial(seed=seed), signals=SNAPSHOT_SIGNALS)
    (tmp_path / "c/kit_1.jsonl").write_text("no log", encoding="utf-8")
    rules = f"extends: paper2020.published\nid: ours\ntitle: Ours\nsource: a test\n{more}\n"
    (tmp_path / "ours.yaml").write_text(rules, encoding="utf-8")
    text = "{id: cup, rules: ours.yaml, runs: '{team}/{trial}_{run}.jsonl', ranking: {keep: 1}}"
    (tmp_path / "competition.yaml").write_text(text, encoding="utf-8")

    assert main(["rank", str(tmp_path)]) == 6

    shown = capsys.readouterr()
    assert shown.out.count("completeness not attested in 2 of 2 runs: ") == said
    assert (shown.out + shown.err).count("not attested") == said
    # So does the page of the competition, once.
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "site")]) in (0, 6)
    page = (tmp_path / "site/index.html").read_text(encoding="utf-8")
    assert page.count("ompleteness not attested in 2 of 2 runs: ") == page.count("not attested") == said


def a_season_with_a_gap(folder: Path, counts: str) -> Path:
    """Of one run that lacks 40 ms at the near miss; its log."""
    trial = kitting_trial()
    left = {}
    for name, signal in trial.signals.items():
        stays = abs(signal.t - 20.005) > 0.025
        left[name] = replace(signal, t=signal.t[stays], values=signal.values[stays])
    (folder / "a").mkdir()
    log = folder / "a/kit_1.jsonl"
    write_trial_log(log, replace(trial, signals=left), signals=SNAPSHOT_SIGNALS)
    rules = f"{{id: w, title: W, source: a test, extends: paper2020, open: {counts}}}"
    (folder / "w.yaml").write_text(rules, encoding="utf-8")
    text = "{id: cup, rules: w.yaml, runs: '{team}/{trial}_{run}.jsonl', ranking: {keep: 1}}"
    (folder / "competition.yaml").write_text(text, encoding="utf-8")
    return log


@pytest.mark.parametrize("counts", ["worst", "best"])
def test_a_ranked_run_that_is_open_has_the_ends_that_it_has_by_itself_and_the_exit_code_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], counts: str
) -> None:
    """Rules that count what all runs of a team did know of no other run here."""
    log = a_season_with_a_gap(tmp_path, counts)

    assert main(["score", str(log), "--rules", str(tmp_path / "w.yaml"), "--output-format", "json"]) == 6
    alone = json.loads(capsys.readouterr().out)["interval"]
    assert main(["rank", str(tmp_path), "--output-format", "json"]) == 6

    said = capsys.readouterr()
    (run,) = json.loads(said.out)["runs"]
    assert run["open"] == {"least": alone["least"], "most": alone["most"]}
    assert "logs leave open what a scored\n" in said.err


def test_under_withhold_a_run_says_what_leaves_its_score_open(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not what the first undecided check found: "never nearer than 4.502 m" would read as decided."""
    a_season_with_a_gap(tmp_path, "withhold")

    assert main(["rank", str(tmp_path), "--output-format", "json"]) == 6

    (run,) = json.loads(capsys.readouterr().out)["runs"]
    assert run["outcome"] == "undecided"
    assert "a gap of 60 ms in the distance of robot and human" in run["reason"]
