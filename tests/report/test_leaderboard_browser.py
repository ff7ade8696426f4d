"""The leaderboard with motion in a real browser: sorting, filtering, sliders; and without scripts."""

from __future__ import annotations

import runpy
import shutil
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ariac_score.cli import main

pytestmark = pytest.mark.slow  # a browser

EXAMPLE = Path(__file__).parents[2] / "examples/competition/motion"
BOARDS = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "test_leaderboard.py")))
PHONE = {"width": 390, "height": 844}
hostile, recorded = BOARDS.hostile, BOARDS.recorded


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The whole example: four teams, three trials, three runs."""
    folder = tmp_path_factory.mktemp("cell")
    BOARDS.MADE.make(folder)
    for name in ("competition.yaml", "rules.yaml"):
        shutil.copy(EXAMPLE / name, folder)
    assert main(["report", str(folder), "-o", str(folder / "site")]) == 0
    return folder / "site"


def pages_of(site: Path) -> list[Path]:
    """The page of the competition, that of a team and those of the violations."""
    return [site / "index.html", next((site / "teams").iterdir()), *(site / "violations").iterdir()]


def teams(page: Any, table: str) -> list[str]:
    found: list[str] = page.eval_on_selector_all(
        f"{table} tbody tr:not([hidden]) th", "all => all.map(each => each.innerText.trim())"
    )
    return found


def test_every_page_loads_without_a_complaint_and_asks_the_network_for_nothing(
    open_page: Any, site: Path
) -> None:
    for file in pages_of(site):
        opened = open_page(file)
        assert (opened.complaints, opened.elsewhere) == ([], [])


def test_a_click_on_a_head_sorts_and_another_turns_it_round(open_page: Any, site: Path) -> None:
    page = open_page(site / "index.html").page
    assert teams(page, "#board-table") == ["Owl", "Hare", "Fox", "Tortoise"]

    page.get_by_role("button", name="Task", exact=True).click()
    assert teams(page, "#board-table") == ["Fox", "Hare", "Owl", "Tortoise"]
    page.get_by_role("button", name="Task", exact=True).press("Enter")
    assert teams(page, "#board-table") == ["Tortoise", "Owl", "Hare", "Fox"]
    heads = page.locator("#board-table thead th[aria-sort]")
    assert [head.get_attribute("aria-sort") for head in heads.all()] == ["ascending"]


def test_teams_are_found_by_name_and_by_being_calm(open_page: Any, site: Path) -> None:
    page = open_page(site / "index.html").page

    page.get_by_label("Find a team").fill("ow")
    assert teams(page, "#board-table") == ["Owl"]
    assert page.inner_text("#board-count") == "1 of 4 teams"
    page.get_by_label("Find a team").fill("")
    page.get_by_label("only without a violation").check()
    assert teams(page, "#board-table") == ["Tortoise"]


def test_a_slider_ranks_anew_and_one_button_goes_back(open_page: Any, site: Path) -> None:
    page = open_page(site / "index.html").page
    slider = page.get_by_role("slider", name="each approach nearer than the robot may come")

    assert slider.get_attribute("aria-valuetext") == "4\u202fpoints"
    slider.press("Home")
    assert slider.get_attribute("aria-valuetext") == "0\u202fpoints"
    assert teams(page, "#what-if-table") == ["Fox", "Hare", "Owl", "Tortoise"]
    assert page.inner_text("#what-if-said") == "2 of 4 teams have another rank"
    slider.press("End")
    # At 12 points an approach the team that made none is second.
    assert teams(page, "#what-if-table")[:2] == ["Owl", "Tortoise"]
    page.get_by_role("button", name="As in the rules").click()
    assert teams(page, "#what-if-table") == ["Owl", "Hare", "Fox", "Tortoise"]
    assert page.inner_text("#what-if-said") == "Ranks are as in the rules"


def test_on_paper_the_ranking_says_under_which_numbers_it_is(open_page: Any, site: Path) -> None:
    page = open_page(site / "index.html").page
    page.get_by_role("slider", name="each approach nearer than the robot may come").press("Home")
    page.emulate_media(media="print")

    assert page.inner_text("#lever-0-now") == "0\u202fpoints"
    assert page.inner_text("#what-if-said") == "2 of 4 teams have another rank"
    assert page.get_by_role("slider").count() == 0


def test_marks_show_between_which_steps_ranks_flip(open_page: Any, site: Path) -> None:
    page = open_page(site / "index.html").page
    marks = page.eval_on_selector_all(
        ".lever:first-child .ticks i", "all => all.map(each => each.className === 'flip')"
    )

    # As the table says: between 2 and 4, 4 and 6, 6 and 8 points.
    assert marks == [False, True, True, True, False]


def test_without_scripts_it_is_a_table_by_rank_and_nothing_that_does_not_work_shows(
    open_page: Any, site: Path
) -> None:
    page = open_page(site / "index.html", java_script_enabled=False).page

    assert page.locator("#board-table tbody tr").count() == 4
    assert not page.get_by_label("Find a team").is_visible()
    assert page.get_by_role("slider").count() == 0
    assert "between" in page.inner_text("table.flips")


def test_a_team_leads_to_its_page_and_that_to_its_runs_and_back(open_page: Any, site: Path) -> None:
    page = open_page(site / "index.html").page

    page.locator("#board-table").get_by_role("link", name="Fox").click()
    assert page.url.endswith("/teams/fox.html")
    assert "safety cost 10.00" in page.inner_text("header")
    page.get_by_role("link", name="ISO/TS 15066:2016, 5.5.4 (derived)").first.click()
    assert "/violations/" in page.url
    page.get_by_role("link", name="crossing 3").first.click()
    assert "/trials/" in page.url


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [PHONE, {"width": 1280, "height": 900}])
def test_nothing_sticks_out_in_any_width(
    open_page: Any, site: Path, hostile: Path, size: Any, scheme: str
) -> None:
    for folder in (site, hostile):
        for file in (
            folder / "index.html",
            *(folder / "teams").iterdir(),
            *(folder / "violations").iterdir(),
        ):
            page = open_page(file, viewport=size, color_scheme=scheme).page
            assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), file.name


def test_hostile_names_run_nothing(open_page: Any, hostile: Path) -> None:
    for file in pages_of(hostile):
        opened = open_page(file)
        assert (opened.complaints, opened.elsewhere) == ([], [])
        assert opened.page.locator("img").count() == 0


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_there_is_no_serious_fault_of_accessibility(
    open_page: Any, faults_of: Any, site: Path, hostile: Path, scheme: str
) -> None:
    for folder in (site, hostile):
        for file in (
            folder / "index.html",
            next((folder / "teams").iterdir()),
            *(folder / "violations").iterdir(),
        ):
            assert faults_of(open_page(file, color_scheme=scheme)) == [], file.name
