"""The site of a competition: what it holds, what it says, what it refuses."""

from __future__ import annotations

import csv
import io
import json
import re
import runpy
import shutil
from collections.abc import Callable
from dataclasses import replace
from decimal import Decimal
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ariac_score import load_result, load_rule_set
from ariac_score.cli import main
from ariac_score.ranking.publication import load_publication
from ariac_score.report.site.run_pages import page_name
from ariac_score.report.site.site import Site, competition_page
from ariac_score.report.site.tables import Table, cell_text, table_csv, table_json
from ariac_score.report.site.view import view_of
from ariac_score.results.result_file import measured_sha256
from ariac_score.review.sensitivity import Knob, RankSensitivity, RankShift
from ariac_score.review.sensitivity_file import sensitivity_json
from ariac_score_ariac.testing.official_texts import Outcome, PlannedOrder, sensor_cost_text, trial_log_text

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/competition/2024"
PAGES = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "pages.py")))
HOSTILE: tuple[str, ...] = PAGES.HOSTILE


class Links(HTMLParser):
    """Where a page leads, and which ids it has."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.to: list[str] = []
        self.ids: list[str] = []
        self.tags: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name == "href" and value is not None:
                self.to.append(value)
            if name == "id" and value is not None:
                self.ids.append(value)


def seen(text: str) -> str:
    """What is read on a page, white space folded."""
    body = re.sub(r"(?s)<style>.*?</style>|<script.*?</script>|<[^>]+>", "", text)
    return re.sub(r"\s+", " ", body)


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    assert main(["report", str(EXAMPLE), "-o", str(folder / "site")]) == 0
    return folder / "site"


@pytest.fixture
def ranking(site: Path, tmp_path: Path) -> Path:
    """A copy of the ranking in the folder of its results, to be edited."""
    shutil.copytree(site / "results", tmp_path / "results")
    (tmp_path / "data").mkdir()
    return Path(shutil.copy(site / "data/ranking.json", tmp_path / "data/ranking.json"))


def edited(file: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    data = json.loads(file.read_text(encoding="utf-8"))
    change(data)
    file.write_text(json.dumps(data), encoding="utf-8")
    return file


def page_of(file: Path, **given: Any) -> str:
    return competition_page(Site(load_publication(file), **given))


# What it holds -------------------------------------------------------------------------


@pytest.mark.slow
def test_one_command_makes_pages_tables_and_the_ranking(site: Path) -> None:
    names = {file.relative_to(site).as_posix() for file in site.rglob("*") if file.is_file()}

    assert {"index.html", "data/ranking.json", "data/leaderboard.csv", "data/pairs.json"} <= names
    assert len([name for name in names if name.startswith("trials/")]) == 45
    assert set(json.loads((site / "data/files.json").read_text())["files"]) == names


@pytest.mark.slow
def test_every_link_leads_somewhere(site: Path) -> None:
    for file in (site / "index.html", site / "trials/aurora/kitting-1.html"):
        links = Links(file.read_text(encoding="utf-8"))
        for link in links.to:
            if link.startswith("#"):
                assert link[1:] in links.ids, link
            elif not link.startswith("data:"):
                assert (file.parent / link).resolve().is_file(), link


def test_the_page_of_a_run_says_which_run_of_which_trial_and_team_it_is(site: Path) -> None:
    page = (site / "trials/borealis/kitting-2.html").read_text(encoding="utf-8")

    assert "Competition · Trial report · team borealis · run 2 of 5 kitting" in seen(page)
    assert re.search(r"<title>borealis, kitting, run 2 of 5: [\d.]+</title>", page)


def test_no_page_holds_an_id_twice(site: Path) -> None:
    ids = Links((site / "index.html").read_text(encoding="utf-8")).ids

    assert len(ids) == len(set(ids))


def test_the_page_shows_what_the_ranking_says(site: Path) -> None:
    page = (site / "index.html").read_text(encoding="utf-8")
    text = seen(page)

    for team in ("Team Borealis", "Team Aurora", "Team Cygnus"):
        assert team in text
    assert 'title="151.59789795">151.60<' in page
    assert "no number of points could tell 3 teams apart" in text
    assert "The rules price no check of safety, so these scores say nothing about it." in text
    assert "Violations by standard and clause" in text
    assert "No previous publication was given" in text
    assert "Not examined: this publication does not say whether" in text
    assert "The best of each team and trial, by highest task, then lowest completion_time_s" in text


def test_the_trials_of_the_table_add_up_to_the_leaderboard(site: Path) -> None:
    board = list(csv.DictReader(io.StringIO((site / "data/leaderboard.csv").read_text())))
    trials = list(csv.DictReader(io.StringIO((site / "data/trials.csv").read_text())))

    for row in board:
        own = [Decimal(t["score"]) for t in trials if t["team"] == row["team"]]
        assert sum(own, Decimal(0)) == Decimal(row["execution"])


def test_csv_and_json_of_a_table_say_the_same(site: Path) -> None:
    for file in sorted((site / "data").glob("*.csv")):
        rows = list(csv.DictReader(io.StringIO(file.read_text(encoding="utf-8"))))
        table = json.loads(file.with_suffix(".json").read_text(encoding="utf-8"))
        assert len(rows) == len(table["rows"])
        for row, entry in zip(rows, table["rows"], strict=True):
            assert list(row) == list(entry)
            for column, value in entry.items():
                if isinstance(value, bool) or value is None or isinstance(value, str):
                    assert row[column] == {True: "yes", False: "no", None: ""}.get(value, value)
                else:
                    assert float(row[column]) == pytest.approx(value)


def test_the_same_ranking_makes_the_same_bytes_with_any_number_of_processes(
    site: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ariac_score.report.site.run_pages._FEW", 10_000)
    assert main(["report", str(site / "data/ranking.json"), "-o", str(tmp_path / "again")]) == 0

    for file in sorted(site.rglob("*")):
        if file.is_file():
            assert (tmp_path / "again" / file.relative_to(site)).read_bytes() == file.read_bytes(), file


@pytest.mark.slow
def test_a_site_is_made_of_its_own_ranking_in_place(site: Path, tmp_path: Path) -> None:
    shutil.copytree(site, tmp_path / "site")
    before = {f: f.read_bytes() for f in (tmp_path / "site").rglob("*") if f.is_file()}

    assert main(["report", str(tmp_path / "site/data/ranking.json"), "-o", str(tmp_path / "site")]) == 0

    assert {f: f.read_bytes() for f in (tmp_path / "site").rglob("*") if f.is_file()} == before


def test_what_is_no_longer_part_of_it_is_removed_and_nothing_else(site: Path, tmp_path: Path) -> None:
    out = tmp_path / "site"
    shutil.copytree(site, out)
    (out / "CNAME").write_text("example.org\n")
    fewer = tmp_path / "fewer.json"
    shutil.copy(site / "data/ranking.json", fewer)
    edited(fewer, lambda d: d.update(folder="") or [run.update(result=None) for run in d["runs"]])

    assert main(["report", str(fewer), "-o", str(out)]) == 0

    assert not list(out.glob("trials/*/*.html"))
    assert (out / "CNAME").is_file()
    assert "No results were given with this ranking" in (out / "index.html").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_list_of_files_that_leads_out_of_the_site_removes_nothing_there(site: Path, tmp_path: Path) -> None:
    out, precious = tmp_path / "site", tmp_path / "precious.txt"
    shutil.copytree(site, out)
    precious.write_text("keep")
    (out / "own.txt").write_text("keep")
    listed = ["../precious.txt", "data/../../precious.txt", "own.txt"]
    edited(out / "data/files.json", lambda d: d["files"].extend(listed))

    assert main(["report", str(site / "data/ranking.json"), "-o", str(out)]) == 0

    assert precious.is_file()
    assert (out / "own.txt").is_file()


# What is given with it -----------------------------------------------------------------


@pytest.mark.slow
def test_what_changed_is_shown(site: Path, ranking: Path) -> None:
    def older(data: dict[str, Any]) -> None:
        data["standings"][1]["rank"], data["standings"][2]["rank"] = 3, 2
        data["runs"].pop()

    now = load_publication(site / "data/ranking.json")
    before = load_publication(edited(ranking, older))
    page = competition_page(Site(now, previous=before))

    text = seen(page)
    assert "▲ up 1" in text
    assert "▼ down 1" in text
    assert "1 run new, gone or changed." in text
    assert "Nothing changed" in seen(page_of(ranking, previous=load_publication(ranking)))


def test_new_and_gone_trials_are_named_as_they_are(ranking: Path) -> None:
    now = load_publication(ranking)
    new, *both = now.trials
    before = replace(now, trials=(*both, "-mixed"))

    text = seen(competition_page(Site(now, previous=before)))

    assert f"New trials: {new}" in text
    assert "Trials no longer held: -mixed" in text


@pytest.mark.slow
def test_the_previous_publication_may_be_the_folder_of_a_site(site: Path, tmp_path: Path) -> None:
    arguments = ["report", str(site / "data/ranking.json"), "-o", str(tmp_path / "new")]

    assert main([*arguments, "--previous", str(site)]) == 0

    assert "Nothing changed" in (tmp_path / "new/index.html").read_text(encoding="utf-8")
    assert (tmp_path / "new/data/team_changes.csv").is_file()


SHIFTS = [
    RankSensitivity(
        Knob("separation.t1_s", 1.0, 0.5, 2.0, declared=True, check="separation"),
        (
            RankShift(
                1.25, {"aurora": 2, "cygnus": 3, "borealis": 1}, {"aurora": 3, "cygnus": 2, "borealis": 1}
            ),
        ),
    ),
    RankSensitivity(Knob("cost_weight", 1.0, 0.5, 2.0, declared=False)),
    RankSensitivity(Knob("=cmd()", 1.0, 0.5, 2.0, declared=False), skipped="needs the log, to measure again"),
]


@pytest.mark.slow
def test_sensitivity_is_shown_where_it_is_given(site: Path, tmp_path: Path) -> None:
    rules = load_rule_set("ariac2024.official")
    file = tmp_path / "sensitivity.json"
    file.write_text(sensitivity_json(SHIFTS, rules, "example2024"), encoding="utf-8")
    arguments = ["report", str(site / "data/ranking.json"), "-o", str(tmp_path / "site")]

    assert main([*arguments, "--sensitivity", str(file)]) == 0

    text = seen((tmp_path / "site/index.html").read_text(encoding="utf-8"))
    assert "at 1.25: Team Aurora 2 → 3, Team Cygnus 3 → 2" in text
    assert "do not change in this range" in text
    assert "not varied: needs the log, to measure again" in text
    assert "'=cmd()" in (tmp_path / "site/data/sensitivity.csv").read_text(encoding="utf-8")


OTHER = (
    '{"format": "ariac-score sensitivity", "version": 1, "of": "x", "rule_set": {"id": "r", "sha256": "0"}}'
)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("{}", "not the sensitivity of a ranking"),
        ("[1]", "not the sensitivity of a ranking"),
        ("{", "not a sensitivity"),
        (OTHER.replace('"version": 1', '"version": 2'), "not a sensitivity of this version"),
        (OTHER, "it is of 'x' under r"),
    ],
)
def test_the_sensitivity_of_something_else_is_refused(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, cause: str
) -> None:
    (tmp_path / "s.json").write_text(text)
    arguments = ["report", str(site / "data/ranking.json"), "-o", str(tmp_path / "out")]

    assert main([*arguments, "--sensitivity", str(tmp_path / "s.json")]) == 4

    assert cause in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


# What is refused -----------------------------------------------------------------------


@pytest.mark.slow
def test_a_result_that_was_changed_since_is_refused(
    ranking: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = tmp_path / "results/aurora/kitting_1.json"
    result.write_text(result.read_text().replace("kitting", "Kitting"))

    assert main(["report", str(ranking), "-o", str(tmp_path / "out")]) == 4

    err = capsys.readouterr().err
    assert "kitting_1.json" in err
    assert "the ranking was made of" in err


@pytest.mark.slow
def test_a_result_of_other_rules_is_refused(
    ranking: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    edited(ranking, lambda d: d["rule_set"].update(id="ours", sha256="1" * 64))

    assert main(["report", str(ranking), "-o", str(tmp_path / "out")]) != 0

    assert "results of different rule sets are not ranked together" in capsys.readouterr().err


@pytest.mark.slow
def test_a_result_of_another_run_is_refused(
    ranking: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def swapped(data: dict[str, Any]) -> None:
        data["runs"][0]["result"], data["runs"][1]["result"] = (
            data["runs"][1]["result"],
            data["runs"][0]["result"],
        )

    edited(ranking, swapped)

    assert main(["report", str(ranking), "-o", str(tmp_path / "out")]) != 0
    assert "the ranking says" in capsys.readouterr().err


def test_a_folder_with_something_else_in_it_is_left_alone(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "thesis.tex").write_text("precious")

    assert main(["report", str(site / "data/ranking.json"), "-o", str(tmp_path)]) == 4

    assert "no site of a competition" in capsys.readouterr().err
    assert [entry.name for entry in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        ([], "the site of a competition needs a folder"),
        (["-o", "OUT", "--sensitivity", "now"], "no runs to vary parameters of"),
        (["-o", "OUT", "--rules", "paper2020.published"], "--rules does not apply to a stored ranking"),
        (["-o", "OUT", "--results", "nowhere"], "the results of this ranking are not here"),
        (["-o", "OUT", "--previous", "nowhere.json"], "no such file"),
    ],
)
def test_what_cannot_be_done_is_refused(
    site: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], cause: str
) -> None:
    given = [str(tmp_path / "out") if a == "OUT" else a for a in arguments]

    assert main(["report", str(site / "data/ranking.json"), *given]) == 4

    err = capsys.readouterr().err
    assert cause in err
    assert "hint:" in err


# Little, and hostile ----------------------------------------------------------------------


def competition(folder: Path, extra: str) -> Path:
    folder.mkdir(exist_ok=True)
    (folder / "competition.yaml").write_text(
        f"id: little\nrules: ariac2024.official\nruns: logs/{{team}}/{{trial}}_{{run}}\n{extra}",
        encoding="utf-8",
    )
    return folder


def made(folder: Path, tmp_path: Path) -> str:
    main(["report", str(folder), "-o", str(tmp_path / "out")])
    return seen((tmp_path / "out/index.html").read_text(encoding="utf-8"))


def test_an_empty_competition_has_a_page(tmp_path: Path) -> None:
    folder = competition(tmp_path / "c", "")
    (folder / "logs").mkdir()

    assert "No team takes part yet." in made(folder, tmp_path)


def test_a_competition_before_its_first_run_has_no_ranks(tmp_path: Path) -> None:
    folder = competition(tmp_path / "c", "teams: [{id: alpha}]\ntrials: [{id: kit}]\n")
    (folder / "logs/alpha").mkdir(parents=True)

    text = made(folder, tmp_path)
    assert "No run has been made yet, so there are no ranks." in text
    assert "\u2013 alpha" in text


@pytest.mark.slow
def test_one_team_has_nobody_to_be_compared_with(tmp_path: Path) -> None:
    folder = competition(tmp_path / "c", "")
    shutil.copytree(EXAMPLE / "logs/aurora", folder / "logs/aurora")

    text = made(folder, tmp_path)
    assert "There is only one team, so there is nobody to compare it with." in text


def test_teams_all_tied_share_the_first_rank(tmp_path: Path) -> None:
    folder = competition(tmp_path / "c", "")
    for team in ("alpha", "beta"):
        shutil.copytree(EXAMPLE / "logs/aurora/kitting_1", folder / f"logs/{team}/kitting_1")
        shutil.copytree(EXAMPLE / "logs/aurora/kitting_2", folder / f"logs/{team}/kitting_2")

    text = made(folder, tmp_path)
    assert text.count("1=") == 2
    assert "= shared rank" in text


def test_all_disqualified_is_shown_first(tmp_path: Path) -> None:
    folder = competition(tmp_path / "c", "teams: [{id: aurora, disqualified: 'a <b>second</b> robot'}]\n")
    shutil.copytree(EXAMPLE / "logs/aurora/kitting_1", folder / "logs/aurora/kitting_1")

    main(["report", str(folder), "-o", str(tmp_path / "out")])
    page = (tmp_path / "out/index.html").read_text(encoding="utf-8")
    assert "Every team is disqualified." in page
    assert "a &lt;b&gt;second&lt;/b&gt; robot" in page


def hostile_ranking(ranking: Path) -> Path:
    """Every text of a ranking replaced by a hostile one, without results."""
    names = {"aurora": HOSTILE[0], "borealis": HOSTILE[1], "cygnus": HOSTILE[2]}
    trials = {"assembly": HOSTILE[3], "kitting": HOSTILE[4], "mixed_tasks": HOSTILE[5]}

    def swapped(value: Any) -> Any:
        if isinstance(value, dict):
            return {trials.get(key, key): swapped(inner) for key, inner in value.items()}
        if isinstance(value, list):
            return [swapped(inner) for inner in value]
        return {**names, **trials}.get(value, value) if isinstance(value, str) else value

    data = swapped(json.loads(ranking.read_text(encoding="utf-8")))
    data.update(title=HOSTILE[6], strangers=list(HOSTILE), folder="", cohort=None)
    for i, run in enumerate(data["runs"]):
        run.update(result=None, reason=HOSTILE[i % len(HOSTILE)], outcome="aborted")
    for i, standing in enumerate(data["standings"]):
        standing.update(name=HOSTILE[i], remarks=list(HOSTILE))
    data["statistics"]["notes"] = list(HOSTILE)
    data["rule_set"]["id"] = HOSTILE[1]
    ranking.write_text(json.dumps(data), encoding="utf-8")
    return ranking


@pytest.mark.slow
def test_five_hundred_teams_have_a_page_that_a_browser_can_load(tmp_path: Path) -> None:
    """All their 124 750 pairs are in a CSV; as JSON they took 26 MB more."""
    kit = (PlannedOrder("AAAA0001", "kitting", False, (("pump", "red"),)),)
    for number in range(500):
        folder = tmp_path / "c/logs" / f"team_{number:03}" / "kit_1"
        folder.mkdir(parents=True)
        text = trial_log_text("kit", kit, [Outcome(("",), 50.0 + number)])
        (folder / "trial_log.txt").write_text(text, encoding="utf-8")
        (folder / "sensor_cost.txt").write_text(sensor_cost_text({"lidar": 2}), encoding="utf-8")
    (tmp_path / "c/competition.yaml").write_text(
        "id: many\nrules: ariac2024.official\nruns: logs/{team}/{trial}_{run}\n", encoding="utf-8"
    )
    ranking = tmp_path / "ranking.json"

    assert main(["rank", str(tmp_path / "c"), "-o", str(ranking)]) == 0
    assert main(["report", str(ranking), "-o", str(tmp_path / "site")]) == 0

    page = (tmp_path / "site/index.html").read_text(encoding="utf-8")
    assert page.count("team_499") >= 1
    assert len(page) < 1 << 20
    assert len(Links(page).tags) < 500 * 50  # elements: the page grows with the teams, not with their pairs
    sizes = {file.name: file.stat().st_size for file in (tmp_path / "site/data").iterdir()}
    assert "pairs.json" not in sizes
    assert sizes["pairs.csv"] < 8 << 20
    assert sum(sizes.values()) < 40 << 20
    assert all(name in sizes for name in re.findall(r'href="data/([^"]+)"', page))


@pytest.mark.slow
def test_hostile_names_are_text(ranking: Path, tmp_path: Path) -> None:
    assert main(["report", str(hostile_ranking(ranking)), "-o", str(tmp_path / "out")]) == 0

    page = (tmp_path / "out/index.html").read_text(encoding="utf-8")
    assert Links(page).tags.count("script") == 1  # ours
    assert "img" not in Links(page).tags
    assert "\u202e" not in page
    assert "&lt;script&gt;" in page
    for file in (tmp_path / "out/data").glob("*.csv"):
        for row in csv.reader(io.StringIO(file.read_text(encoding="utf-8"))):
            assert not [cell for cell in row if cell[:1] in ("=", "+", "@", "\t") and not cell[1:2].isdigit()]
        assert table_json(Table("t", "", ("a",), ((HOSTILE[2],),)))


def test_no_name_of_a_stranger_leads_out_of_the_site() -> None:
    names = {page_name((team, trial, 1)) for team in HOSTILE for trial in ("..", "a/b", "x" * 999, "CON")}

    assert len(names) == len(HOSTILE) * 4
    for name in names:
        assert re.fullmatch(r"trials/[a-z0-9_-]{1,64}/[a-z0-9_-]{1,64}-1\.html", name), name


@pytest.mark.parametrize(
    "text", ["=cmd()", "+1", "-1+2", "@sum", "\t=1", "\r=1", " =1", "\u00a0=1", "\uff1d1"]
)
def test_text_that_a_spreadsheet_would_calculate_stays_text(text: str) -> None:
    assert cell_text(text) == f"'{text}"


@pytest.mark.parametrize("text", ["plain", "1=1", "a-b", "", "'=1"])
def test_other_text_stays_as_it_is(text: str) -> None:
    assert cell_text(text) == text


def test_numbers_of_a_table_stay_numbers() -> None:
    table = Table("t", "", ("a", "b", "c"), ((-1.5, Decimal("-2.50"), None),))

    assert table_csv(table) == "a,b,c\n-1.5,-2.50,\n"


def calm_competition(folder: Path, *, bodies_witnessed: bool) -> Path:
    """Two teams, two runs each, and nobody in the cell in any; alpha fills all orders, beta half."""
    from ariac_score.testing import write_trial_log  # noqa: PLC0415  # only here
    from ariac_score_ariac.testing import kitting_trial  # noqa: PLC0415

    for team in ("alpha", "beta"):
        (folder / team).mkdir(parents=True)
        for run in (1, 2):
            trial = replace(kitting_trial(human=False), id="cell")
            if bodies_witnessed:
                trial = replace(trial, witnessed=trial.witnessed | {"bodies"})
            if team == "beta":
                trial = replace(trial, submissions=trial.submissions[:1])
            write_trial_log(folder / team / f"cell_{run}", trial)
    (folder / "competition.yaml").write_text(
        "id: calm\nrules: paper2020.published\nruns: '{team}/{trial}_{run}'\n", encoding="utf-8"
    )
    return folder


def says_no_nonsense(site: Path) -> None:
    """No table without a row, no number that is none, no escape shown as text, on any page."""
    for file in site.rglob("*.html"):
        text = file.read_text(encoding="utf-8")
        words = seen(text)
        assert not re.search(r"\b(NaN|nan|Infinity|inf|undefined)\b", words), file
        assert not re.search(r">\s*None\s*<", text), file
        assert "\\u" not in words, file
        for table in re.findall(r"(?s)<table.*?</table>", text):
            assert len(re.findall(r"<tr", table)) > 1, file
        for body in re.findall(r"(?s)<tbody>(.*?)</tbody>", text):
            assert "<tr" in body, file
    for file in site.rglob("*.json"):
        assert not re.search(r"\b(NaN|Infinity)\b", file.read_text(encoding="utf-8")), file


@pytest.mark.slow
def test_without_a_human_in_any_trial_everything_but_separation_is_there(tmp_path: Path) -> None:
    text = made(calm_competition(tmp_path / "c", bodies_witnessed=True), tmp_path)
    words = seen(text)
    site = tmp_path / "out"
    says_no_nonsense(site)

    # The ranking is there: alpha earns 7 and 3 times 7 points, beta hands in the first order alone.
    rows = {row["team"]: row for row in json.loads((site / "data/leaderboard.json").read_text())["rows"]}
    assert (rows["alpha"]["rank"], rows["beta"]["rank"]) == (1, 2)
    assert (Decimal(str(rows["alpha"]["value"])), Decimal(str(rows["beta"]["value"]))) == (28, 7)
    assert "2 teams, 1 trial, 4 runs, 2 of them count" in words
    # What is about humans never applied: it is named as such, and no row of the table counts it.
    assert (
        "Not applicable in any run, for example because no human was in the cell: "
        "ARIAC 2022 scoring robot-human collision; ISO/TS 15066:2016 5.5.4 (derived)." in words
    )
    tallied = {
        (row["standard"], row["clause"])
        for row in json.loads((site / "data/violations.json").read_text())["rows"]
        if row["violations"] or row["undecided"]
    }
    assert not {standard for standard, _ in tallied} & {"ISO/TS 15066:2016", "ARIAC 2022 scoring"}

    page = (site / "trials/alpha/cell-1.html").read_text(encoding="utf-8")
    text = seen(page)
    assert "28 points of 36 possible" in text
    assert "2 not applicable" in text
    part = seen(page[page.index('id="separation"') : page.index('id="work"')])
    assert "Nothing that a monitor compares with a limit over time was recorded or could be derived" in part
    assert "<figure" not in page[page.index('id="separation"') : page.index('id="work"')]
    coverage = seen(page[page.index('id="coverage"') : page.index('id="basis"')])
    assert (
        "separation, human contact: the log records every body, and there is no human among them" in coverage
    )
    signals = page[page.index('id="coverage"') : page.index('id="idle"')]
    assert "position/robot" in signals
    assert "human" not in signals
    plan = seen(page[page.index('id="plan"') : page.index('id="why"')])
    assert "robot (robot)" in plan
    assert "human" not in plan


@pytest.mark.slow
def test_where_nobody_knows_whether_a_human_was_there_runs_count_at_their_worst(tmp_path: Path) -> None:
    """Not recorded is not absent: nothing is satisfied, and nothing applies to nobody."""
    text = made(calm_competition(tmp_path / "c", bodies_witnessed=False), tmp_path)
    words = seen(text)
    site = tmp_path / "out"
    says_no_nonsense(site)

    assert "Not applicable in any run" not in words
    page = seen((site / "trials/alpha/cell-1.html").read_text(encoding="utf-8"))
    assert re.search(r"no less than 0 ?, and no more than 28 points; the lower end counts", page)
    assert "Monitors that had nothing to judge" not in page
    assert "human contact 1, separation 1, counted at its worst: the log shows no human" in page


# From a competition --------------------------------------------------------------------


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Two teams with two runs of one trial each."""
    folder = competition(tmp_path / "small", "")
    for team in ("aurora", "cygnus"):
        for run in ("kitting_1", "kitting_2"):
            shutil.copytree(EXAMPLE / f"logs/{team}/{run}", folder / f"logs/{team}/{run}")
    return folder


@pytest.mark.slow
def test_sensitivity_can_be_found_out_on_the_spot(small: Path, tmp_path: Path) -> None:
    assert main(["report", str(small), "-o", str(tmp_path / "out"), "--sensitivity", "now"]) == 0

    rows = list(csv.DictReader(io.StringIO((tmp_path / "out/data/sensitivity.csv").read_text())))
    assert {row["parameter"] for row in rows} == {"cost_weight", "time_weight"}


def test_decisions_of_stewards_are_shown_with_what_was_automatic(small: Path, tmp_path: Path) -> None:
    assert main(["report", str(small), "-o", str(tmp_path / "before")]) == 0
    board = json.loads((tmp_path / "before/data/leaderboard.json").read_text(encoding="utf-8"))["rows"]
    last = board[-1]["team"]
    kept = next(
        row
        for row in json.loads((tmp_path / "before/data/runs.json").read_text(encoding="utf-8"))["rows"]
        if row["team"] == last and row["counts"]
    )
    result = load_result(tmp_path / f"before/results/{last}/kitting_{kept['run']}.json")
    (tmp_path / "adjustments.yaml").write_text(
        f"adjustments:\n  - id: protest\n    author: Jo <b>\n    reason: {SCRIPT_REASON}\n"
        f"    time: 2024-05-12T14:30:00Z\n"
        f"    target: {{measured: {measured_sha256(result)},\n"
        f"      team: {last}, trial: kitting, run: {kept['run']}}}\n"
        f"    effect: {{points: 1000}}\n",
        encoding="utf-8",
    )
    decided = ["--adjustments", str(tmp_path / "adjustments.yaml"), "--previous", str(tmp_path / "before")]

    assert main(["report", str(small), "-o", str(tmp_path / "after"), *decided]) == 0

    rows = json.loads((tmp_path / "after/data/leaderboard.json").read_text(encoding="utf-8"))["rows"]
    assert (rows[0]["team"], rows[0]["rank"], rows[0]["automatic_rank"]) == (last, 1, 2)
    assert rows[0]["execution"] == pytest.approx(rows[0]["automatic_execution"] + 1000)
    page = (tmp_path / "after/index.html").read_text(encoding="utf-8")
    assert "Adjusted by the stewards." in page
    assert "Jo &lt;b&gt;" in page
    assert "&lt;script&gt;" in page
    assert f"trials/{last}/kitting-{kept['run']}.html" in page
    run = (tmp_path / f"after/trials/{last}/kitting-{kept['run']}.html").read_text(encoding="utf-8")
    assert "as adjusted by the stewards" in run
    # The result that is kept is the automatic one; the decision stands in the ranking.
    stored = f"results/{last}/kitting_{kept['run']}.json"
    assert (tmp_path / "after" / stored).read_bytes() == (tmp_path / "before" / stored).read_bytes()
    again = ["report", str(tmp_path / "after/data/ranking.json"), "-o", str(tmp_path / "again")]
    assert main([*again, "--previous", str(tmp_path / "before")]) == 0
    assert (tmp_path / "again/index.html").read_bytes() == (tmp_path / "after/index.html").read_bytes()


def test_a_decision_leads_to_the_one_run_it_changed() -> None:
    # The reason of one is the beginning of the reason of the other, and it names no team and no run.
    publication = load_publication(ROOT / "tests/data/before/ranking_strict.json")

    decisions = view_of(publication, {}, None, None, None).decisions

    assert [(d.adjustment.id, d.adjustment.team, d.run and d.run.run.key) for d in decisions] == [
        ("protest_1", "", ("beta", "kit", 1)),
        ("protest_2", "alpha", ("alpha", "kit", 2)),
    ]


SCRIPT_REASON = "'<script>alert(1)</script>'"


@pytest.mark.parametrize("option", ["--previous", "--sensitivity", "--results", "--rules", "--adjustments"])
def test_what_is_for_a_competition_is_refused_for_a_trial(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], option: str
) -> None:
    file = ROOT / "examples/kitting_near_miss.result.json"

    assert main(["report", str(file), "-o", str(tmp_path / "t.html"), option, "x"]) == 4

    assert f"{option} is for the site of a competition" in capsys.readouterr().err


@pytest.mark.slow
def test_runs_that_do_not_count_are_named_where_nothing_else_names_them(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(ROOT / "examples/competition/2024", tmp_path / "day")
    cut = next((tmp_path / "day/logs/aurora/kitting_1").iterdir())
    cut.write_text("half a line", encoding="utf-8")

    assert main(["report", str(tmp_path / "day"), "-o", str(tmp_path / "site")]) == 6

    said = capsys.readouterr().err
    assert "1 of 45 runs have no score of their own; each is named above" in said
    assert "aurora/kitting_1: " in said.split("1 of 45")[0]
