"""A score that lies between two numbers is carried as both of them: no export makes one number of it."""

from __future__ import annotations

import csv
import io
import json
import re
from pathlib import Path

import pytest

from ariac_score import Result, score_trial
from ariac_score.cli import main
from ariac_score.report.exports import export_names, exported
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

ENDS = (
    "0.000000",
    "28.000000",
)  # nobody saw the human: at worst the gate is closed, at best nothing was cost


@pytest.fixture(scope="module")
def cup(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two teams with one run each; the log of the first leaves its score open."""
    root = tmp_path_factory.mktemp("cup")
    for team, human in (("a", False), ("b", True)):
        (root / team).mkdir()
        write_trial_log(root / team / "kit_1.jsonl", kitting_trial(human=human), signals=SNAPSHOT_SIGNALS)
    text = "{id: cup, rules: paper2020, runs: '{team}/{trial}_{run}.jsonl'}"
    (root / "competition.yaml").write_text(text, encoding="utf-8")
    return root


@pytest.fixture(scope="module")
def left_open(cup: Path) -> Result:
    return score_trial(cup / "a/kit_1.jsonl", "paper2020")


@pytest.mark.parametrize("name", export_names())
def test_both_ends_stand_in_every_export_of_a_result(name: str, left_open: Result) -> None:
    assert left_open.interval is not None
    assert (f"{left_open.interval.least:f}", f"{left_open.interval.most:f}") == ENDS
    text = exported(left_open, name)

    for end in (0, 28):
        assert re.search(rf"(?<![\d.]){end}(\.0+)?(?![\d.])", text), end


def row_of(text: str, team: str, run: str = "") -> dict[str, str]:
    rows = csv.DictReader(io.StringIO(text))
    return next(row for row in rows if row["team"] == team and run in ("", row.get("run")))


@pytest.mark.slow
def test_both_ends_stand_in_every_table_of_a_ranking(
    cup: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def shown(*words: str) -> str:
        # A batch fills a table, in which open rows are no failure; in a ranking they are.
        assert main(["-q", *words]) == (0 if words[0] in ("batch", "export") else 6)
        return capsys.readouterr().out

    least, most = ENDS
    assert "a: score 0 to 28, rank 1 to 2 (1 open run)" in shown("rank", str(cup))
    row = row_of(shown("rank", str(cup), "--output-format", "csv"), "a")
    assert (row["execution least"], row["execution most"]) == ENDS
    assert (row["kit least"], row["kit most"]) == ENDS

    ranking = json.loads(shown("rank", str(cup), "--output-format", "json"))
    standings = {one["team"]: one for one in ranking["standings"]}
    ends = {"least": float(least), "most": float(most)}
    assert standings["a"]["open"]["execution"] == ends
    assert standings["a"]["trials"]["kit"]["open"] == ends
    assert "open" not in standings["b"]["trials"]["kit"]
    assert next(run for run in ranking["runs"] if run["team"] == "a")["open"] == ends

    site = tmp_path / "site"
    shown("report", str(cup), "-o", str(site))
    for table in ("leaderboard", "trials", "runs"):
        row = row_of((site / f"data/{table}.csv").read_text(encoding="utf-8"), "a")
        assert (row["open_least"], row["open_most"]) == ENDS, table

    shown("batch", str(cup), "-j", "1", "-o", str(tmp_path / "out"))
    row = row_of(shown("export", str(tmp_path / "out")), "a")
    assert (float(row["score_least"]), float(row["score_most"])) == (0, 28)
