"""A score that lies between two numbers is carried as both of them: no export makes one number of it."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Mapping, Sequence
from decimal import Decimal
from pathlib import Path
from typing import Any

import pytest

from ariac_score import Result, as_json, score_trial
from ariac_score.cli import main
from ariac_score.report.exports import export_names, exported
from ariac_score.report.html.trial import trial_page
from ariac_score.report.text import score_text
from ariac_score.results.adjustments import Adjustments, adjust
from ariac_score.results.result_file import measured_sha256
from ariac_score.scoring.steward import Adjustment
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


# The score that stewards leave, and its ends --------------------------------------------

BOTH = ("separation#1", "human_contact#1")
DECIDED: dict[str, tuple[list[Mapping[str, Any]], float, tuple[float, float] | None]] = {
    # Nobody saw the human: 0 to 28. Without contact only the separation is open; with neither nothing is.
    "one of two": ([{"finding": BOTH[0], "verdict": "satisfied"}], 0, (0, 28)),
    "both": ([{"finding": key, "verdict": "satisfied"} for key in BOTH], 28, None),
    "points": ([{"points": Decimal(3)}], 3, (3, 31)),
    "points and one": ([{"points": Decimal(3)}, {"finding": BOTH[0], "verdict": "satisfied"}], 3, (3, 31)),
    "a score": ([{"score": Decimal(40)}], 40, None),
}


def decided(result: Result, effects: Sequence[Mapping[str, Any]]) -> Result:
    measured = measured_sha256(result)
    decisions = tuple(
        Adjustment(
            id=f"d{n}",
            author="a",
            reason="r",
            time="2024-05-12T14:30:00Z",
            measured=measured,
            trial=result.measured.trial,
            **effect,
        )
        for n, effect in enumerate(effects)
    )
    return adjust(result, Adjustments("a.yaml", "0" * 64, decisions), measured=measured)[0]


def numbers_of(text: str, name: str) -> Mapping[str, Any]:
    """What an export says of score, least and most."""
    if name == "csv":
        return next(csv.DictReader(io.StringIO(text)))
    if name == "jsonl":
        return dict(json.loads(text.splitlines()[0]))
    if name == "sarif":
        return dict(json.loads(text)["runs"][0]["properties"])
    return dict(re.findall(r'<property name="(\w+)" value="([^"]*)"', text))


@pytest.mark.parametrize("case", DECIDED)
@pytest.mark.parametrize("name", ["csv", "jsonl", "sarif", "junit"])
def test_an_adjusted_score_lies_between_the_ends_beside_it(name: str, case: str, left_open: Result) -> None:
    effects, score, between = DECIDED[case]

    found = numbers_of(exported(decided(left_open, effects), name), name)

    assert float(found["score"]) == score
    ends = [found.get(f"score_{end}") for end in ("least", "most")]
    # A column is never empty: where nothing is open both ends are the score.
    alone = [score, score] if name in ("csv", "jsonl") else [None, None]
    assert [end if end is None else float(end) for end in ends] == (alone if between is None else [*between])


@pytest.mark.parametrize("name", ["github", "markdown"])
def test_a_headline_gives_each_score_its_own_ends(name: str, left_open: Result) -> None:
    text = exported(decided(left_open, DECIDED["points"][0]), name).splitlines()[0]

    assert (
        "adjusted score 3, open between 3 and 31 (the lower end counts) (automatic 0, open between 0 and 28"
        in (text.replace("\\", ""))
    )


def test_texts_and_pages_show_the_ends_of_the_adjusted_score(left_open: Result) -> None:
    found = decided(left_open, DECIDED["points"][0])

    assert "the adjusted score lies somewhere between 3 and 31" in score_text(found)
    assert "3 to 31</a>" in trial_page(found, stored=as_json(found))


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
