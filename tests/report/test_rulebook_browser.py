"""The page of a rulebook in a real browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from ariac_score.cli import main

pytestmark = pytest.mark.slow  # a browser

PHONE = {"width": 390, "height": 844}


@pytest.fixture(scope="module")
def book(tmp_path_factory: pytest.TempPathFactory) -> Path:
    page = tmp_path_factory.mktemp("rulebook") / "paper2020.published.html"
    assert main(["rules", "show", "paper2020.published", "--as", "rulebook", "-o", str(page)]) == 0
    return page


def test_it_loads_without_a_complaint_and_asks_the_network_for_nothing(open_page: Any, book: Path) -> None:
    opened = open_page(book)

    assert opened.complaints == []
    assert opened.elsewhere == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("viewport", [PHONE, {"width": 1280, "height": 900}], ids=["phone", "desk"])
def test_nobody_is_shut_out(
    open_page: Any, faults_of: Any, book: Path, scheme: str, viewport: dict[str, int]
) -> None:
    assert faults_of(open_page(book, color_scheme=scheme, viewport=viewport)) == []


def test_a_phone_shows_every_heading_whole_and_does_not_scroll_sideways(open_page: Any, book: Path) -> None:
    page = open_page(book, viewport=PHONE).page

    cut = page.eval_on_selector_all(
        "h1, h2, caption, figcaption",
        "all => all.filter(e => e.getBoundingClientRect().right > innerWidth).length",
    )
    assert cut == 0
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_paper_loses_no_column_and_no_section(open_page: Any, book: Path) -> None:
    a4_less_margins = {"width": 680, "height": 1000}
    page = open_page(book, viewport=a4_less_margins).page
    page.emulate_media(media="print")

    wider = page.eval_on_selector_all(
        "table", "all => all.filter(e => e.getBoundingClientRect().right > innerWidth).length"
    )
    assert wider == 0
    assert page.locator("nav").is_hidden()
    assert page.locator("section:visible").count() == page.locator("nav li").count()
