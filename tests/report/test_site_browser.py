"""The site of a competition in a real browser."""

from __future__ import annotations

import json
import runpy
import shutil
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ariac_score.cli import main

pytestmark = pytest.mark.slow  # a browser

EXAMPLE = Path(__file__).parents[2] / "examples/competition/2024"
HERE = Path(__file__).parent
SITES = SimpleNamespace(**runpy.run_path(str(HERE / "test_site.py")))
PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    assert main(["report", str(EXAMPLE), "-o", str(folder / "site")]) == 0
    return folder / "site"


@pytest.fixture(scope="module")
def hostile_site(site: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("hostile")
    ranking = SITES.hostile_ranking(Path(shutil.copy(site / "data/ranking.json", folder / "ranking.json")))
    assert main(["report", str(ranking), "-o", str(folder / "site")]) == 0
    return folder / "site"


def test_it_loads_without_a_complaint_and_asks_the_network_for_nothing(open_page: Any, site: Path) -> None:
    opened = open_page(site / "index.html")

    assert opened.complaints == []
    assert opened.elsewhere == []


def test_hostile_names_run_nothing_and_keep_to_their_place(open_page: Any, hostile_site: Path) -> None:
    opened = open_page(hostile_site / "index.html")

    assert opened.complaints == []
    assert opened.elsewhere == []
    assert opened.page.locator("img").count() == 0
    assert "<script>alert('script')</script>" in opened.page.inner_text("#board")
    assert opened.page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_a_score_leads_to_its_run_and_back(open_page: Any, site: Path) -> None:
    page = open_page(site / "index.html").page
    # borealis won the assembly trial with its fifth run.
    page.locator("table.matrix tbody tr").first.locator("td a").first.click()

    assert page.url.endswith("trials/borealis/assembly-5.html")
    shown = page.inner_text("#score")
    page.get_by_role("link", name="Competition").click()
    assert page.url.endswith("/index.html")
    assert shown == "55.84"  # 55.842633878, to the digits that mean something


def test_the_trials_of_a_line_add_up_to_its_sum(open_page: Any, site: Path) -> None:
    page = open_page(site / "index.html").page

    lines = page.eval_on_selector_all(
        "table.matrix tbody tr",
        "rows => rows.map(r => [...r.querySelectorAll('.value')].map(v => v.innerText))",
    )

    for *trials, total in filter(None, lines):
        assert sum(map(Decimal, trials), Decimal(0)) == Decimal(total)


def test_the_bars_of_rank_intervals_say_what_the_words_say(open_page: Any, site: Path) -> None:
    page = open_page(site / "index.html").page
    data = json.loads((site / "data/leaderboard.json").read_text(encoding="utf-8"))
    count = len(data["rows"])

    bars = page.eval_on_selector_all(
        ".span",
        "all => all.map(s => { const w = s.getBoundingClientRect(),"
        " i = s.children[0].getBoundingClientRect(),"
        " b = s.children[1].getBoundingClientRect(); return [(i.left - w.left) / w.width,"
        " (i.right - w.left) / w.width, ((b.left + b.right) / 2 - w.left) / w.width]; })",
    )

    for (left, right, dot), row in zip(bars, data["rows"], strict=True):
        assert left == pytest.approx((row["rank_low"] - 1) / count, abs=0.01)
        assert right == pytest.approx(row["rank_high"] / count, abs=0.01)
        assert dot == pytest.approx((row["rank"] - 0.5) / count, abs=0.01)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [PHONE, {"width": 1280, "height": 900}])
def test_nothing_sticks_out_in_any_width(open_page: Any, site: Path, size: Any, scheme: str) -> None:
    page = open_page(site / "index.html", viewport=size, color_scheme=scheme).page

    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    # Text and ground must differ, whatever the scheme.
    style = "getComputedStyle(document.body)"
    colors = page.evaluate(f"[{style}.color, {style}.backgroundColor]")
    assert colors[0] != colors[1]


def test_it_works_without_scripts(open_page: Any, site: Path) -> None:
    page = open_page(site / "index.html", java_script_enabled=False).page

    assert page.locator("table.board tbody tr").count() == 3
    page.get_by_role("link", name="Differences", exact=True).click()
    assert page.url.endswith("#pairs")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_there_is_no_serious_fault_of_accessibility(
    open_page: Any, faults_of: Any, site: Path, hostile_site: Path, scheme: str
) -> None:
    for folder in (site, hostile_site):
        assert faults_of(open_page(folder / "index.html", color_scheme=scheme)) == []


@pytest.mark.parametrize("witnessed", [True, False])
def test_a_competition_without_a_human_has_sensible_pages(
    open_page: Any, faults_of: Any, tmp_path: Path, witnessed: bool
) -> None:
    folder = SITES.calm_competition(tmp_path / "calm", bodies_witnessed=witnessed)
    main(["report", str(folder), "-o", str(tmp_path / "site")])

    for name in ("index.html", "trials/alpha/cell-1.html"):
        opened = open_page(tmp_path / "site" / name)
        page = opened.page
        assert (opened.complaints, opened.elsewhere) == ([], [])
        shown = page.inner_text("main")
        assert not [word for word in ("NaN", "Infinity", "undefined", "\\u") if word in shown]
        rows = page.eval_on_selector_all("table", "all => all.map(t => t.tBodies[0].rows.length)")
        assert rows
        assert min(rows) > 0
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
        assert faults_of(opened) == []

    page = open_page(tmp_path / "site/index.html").page
    board = page.eval_on_selector_all(
        "table.board tbody tr", "rows => rows.map(r => [...r.cells].slice(0, 3).map(c => c.innerText.trim()))"
    )
    ranked = [["1", "alpha", "28.00"], ["2", "beta", "7.00"]]
    tied = [["1=", "alpha", "0.00"], ["1=", "beta", "0.00"]]
    assert board == (ranked if witnessed else tied)
    trial = open_page(tmp_path / "site/trials/alpha/cell-1.html").page
    assert trial.locator("#separation svg").count() == 0
    assert "Nothing that a monitor compares with a limit" in trial.inner_text("#separation")
    assert trial.inner_text("#score") == ("28" if witnessed else "0")
    assert trial.locator("#idle").count() == (1 if witnessed else 0)
    if witnessed:
        trial.locator("#separation a").click()
        assert trial.url.endswith("#idle")
        assert "there is no human among them" in trial.inner_text("#coverage")
