"""The page of a trial in a real browser."""

from __future__ import annotations

import json
import runpy
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ariac_score import Result, as_json

pytestmark = pytest.mark.slow  # a browser

PAGES = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "pages.py")))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("pages")


@pytest.fixture(scope="module")
def result(folder: Path) -> Result:
    return PAGES.with_routes(folder)


@pytest.fixture(scope="module")
def file(folder: Path, result: Result) -> Path:
    return PAGES.write_page(folder, result)


@pytest.fixture(scope="module")
def hostile_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("hostile")
    return PAGES.write_page(place, PAGES.hostile())


def test_it_loads_without_a_complaint_and_asks_the_network_for_nothing(open_page: Any, file: Path) -> None:
    opened = open_page(file)

    assert opened.complaints == []
    assert opened.elsewhere == []


def test_the_steps_add_up_to_the_score(open_page: Any, file: Path, result: Result) -> None:
    page = open_page(file).page

    amounts = page.eval_on_selector_all("#steps tr[data-amount]", "rows => rows.map(r => r.dataset.amount)")

    assert sum(map(Decimal, amounts), Decimal(0)) == result.score
    assert page.inner_text("#score") == "19.76"  # 19.761677, to the digits that mean something
    assert page.get_attribute("#score data", "title") == "exactly 19.761677"


def test_the_bars_meet_end_to_end_and_end_at_the_score(open_page: Any, file: Path) -> None:
    page = open_page(file).page

    bars = page.eval_on_selector_all(
        "#steps tr:not([hidden]) .bar",
        "bars => bars.map(b => { const r = b.getBoundingClientRect();"
        " return [r.left, r.right, b.classList.contains('loss')]; })",
    )

    *steps, total = bars
    at = total[0]
    for left, right, loss in steps:
        assert (right if loss else left) == pytest.approx(at, abs=3)
        at = left if loss else right
    assert at == pytest.approx(total[1], abs=3)


def test_every_link_leads_to_a_place_on_the_page(open_page: Any, file: Path) -> None:
    page = open_page(file).page

    lost = page.eval_on_selector_all(
        "a[href^='#']", "links => links.map(a => a.hash.slice(1)).filter(id => !document.getElementById(id))"
    )

    assert lost == []


def test_a_bar_leads_to_its_finding(open_page: Any, file: Path) -> None:
    page = open_page(file).page
    losses = page.locator("#steps tr", has=page.locator(".bar.loss"))

    losses.filter(has_text="too close").locator(".bar").click()

    assert page.evaluate("location.hash") == "#f-separation.1"
    row = page.locator(":target")
    assert "too close for 2.40 s" in row.inner_text()
    assert 0 <= row.bounding_box()["y"] < 900


def test_a_violation_in_its_lane_leads_to_its_finding(open_page: Any, file: Path) -> None:
    page = open_page(file).page

    page.locator(".lane .block.violated[href]").first.click()

    assert page.evaluate("location.hash") == "#f-separation.1"


def _shown(page: Any) -> tuple[float, float]:
    box = page.evaluate(
        "(() => { const b = document.querySelector('.plot svg').viewBox.baseVal; return [b.x, b.width]; })()"
    )
    return float(box[0]), float(box[1])


def test_buttons_and_keys_zoom_and_show_all_again(open_page: Any, file: Path) -> None:
    opened = open_page(file)
    page = opened.page
    start = _shown(page)

    page.click("button[data-act=in]")
    assert _shown(page)[1] == pytest.approx(start[1] / 2)

    page.focus(".plot")
    page.keyboard.press("+")
    assert _shown(page)[1] == pytest.approx(start[1] / 4)
    before = _shown(page)[0]
    page.keyboard.press("ArrowRight")
    assert _shown(page)[0] > before

    page.keyboard.press("0")
    assert _shown(page) == start
    assert opened.complaints == []


def test_dragging_shows_what_was_dragged_over(open_page: Any, file: Path) -> None:
    page = open_page(file).page
    page.locator(".plot").first.scroll_into_view_if_needed()
    box = page.locator(".plot").first.bounding_box()
    start = _shown(page)

    page.mouse.move(box["x"] + box["width"] * 0.25, box["y"] + 50)
    page.mouse.down()
    page.mouse.move(box["x"] + box["width"] * 0.75, box["y"] + 60)
    page.mouse.up()

    assert _shown(page)[1] == pytest.approx(start[1] / 2, rel=0.02)
    assert _shown(page)[0] == pytest.approx(start[1] / 4, rel=0.02)


def test_all_drawings_over_time_zoom_together_onto_the_worst_moment(open_page: Any, file: Path) -> None:
    page = open_page(file).page
    first, second = page.locator(".chart").all()

    page.locator("button[data-act=worst]").first.click()

    def left(chart: Any) -> float:
        return float(chart.locator(".mark").last.evaluate("m => parseFloat(m.style.left)"))

    assert left(first) == left(second) == pytest.approx(50, abs=1)
    # 3 s on each side: the violation from 18.81 s to 21.21 s is from 30.2 % to 70.2 % of what is shown.
    lane = page.locator(".lanes .lane:has(.block.violated)").bounding_box()
    block = page.locator(".lanes .block.violated[href]").bounding_box()
    assert (block["x"] - lane["x"]) / lane["width"] == pytest.approx(0.302, abs=0.005)
    assert block["width"] / lane["width"] == pytest.approx(0.4, abs=0.005)


def test_without_scripts_everything_but_zooming_is_there(open_page: Any, file: Path) -> None:
    page = open_page(file, java_script_enabled=False).page

    assert page.locator(".plot svg path.actual").count() == 2  # separation and contact
    assert page.locator(".tools").first.is_hidden()
    assert page.locator("#findings table").count() > 5


@pytest.mark.parametrize("width", [360, 768, 1280])
def test_nothing_sticks_out_sideways(open_page: Any, hostile_file: Path, file: Path, width: int) -> None:
    for one in (file, hostile_file):
        page = open_page(one, viewport={"width": width, "height": 800}).page
        assert page.evaluate("document.documentElement.scrollWidth") <= width


def test_on_a_phone_no_finding_has_to_be_scrolled_sideways(
    open_page: Any, hostile_file: Path, file: Path
) -> None:
    for one in (file, hostile_file):
        page = open_page(one, viewport={"width": 390, "height": 800}).page
        tables = page.locator(".scroll:has(> table.findings)")
        assert tables.count() > 5
        widths = "all => all.map(one => [one.scrollWidth - one.clientWidth, one.clientWidth])"
        assert {beyond for beyond, wide in tables.evaluate_all(widths) if wide} == {0}
        ends = "all => Math.max(...all.map(one => one.getBoundingClientRect().right))"
        assert page.locator("table.findings td").evaluate_all(ends) <= 390


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_serious_fault_of_accessibility(
    open_page: Any, faults_of: Any, file: Path, hostile_file: Path, scheme: str
) -> None:
    for one in (file, hostile_file):
        assert faults_of(open_page(one, color_scheme=scheme)) == []


def test_a_fault_of_accessibility_would_be_found(open_page: Any, faults_of: Any, tmp_path: Path) -> None:
    (tmp_path / "bad.html").write_text("<title>t</title><img src='data:,'>", encoding="utf-8")

    assert any(fault.startswith("image-alt") for fault in faults_of(open_page(tmp_path / "bad.html")))


def test_no_serious_fault_on_a_phone(open_page: Any, faults_of: Any, file: Path) -> None:
    assert faults_of(open_page(file, viewport={"width": 360, "height": 800})) == []


def test_hostile_names_are_shown_as_text_and_run_nothing(open_page: Any, hostile_file: Path) -> None:
    opened = open_page(hostile_file)
    page = opened.page
    text = page.inner_text("body")

    assert opened.complaints == []
    assert opened.elsewhere == []
    assert page.locator("script").count() == 2  # the zooming and the result
    assert page.locator("img").count() == 0
    for word in (PAGES.SCRIPT, PAGES.IMAGE, PAGES.FORMULA):
        assert word in text
    assert not set("\u202e\u202c\x1b") & set(text)
    assert "\\u202egnp.exe" in text


def test_a_long_name_is_folded_and_can_be_opened(open_page: Any, hostile_file: Path) -> None:
    page = open_page(hostile_file).page
    fold = page.locator("details.fold").first

    assert fold.bounding_box()["height"] < 60
    fold.locator("summary").click()
    assert "x" * 10_000 in fold.inner_text()


def test_the_skip_link_is_the_first_stop_of_the_keyboard(open_page: Any, file: Path) -> None:
    page = open_page(file).page

    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.textContent") == "Skip to the content"
    page.keyboard.press("Enter")
    assert page.evaluate("document.activeElement.id") == "main"


def test_the_embedded_result_is_the_result(open_page: Any, file: Path, result: Result) -> None:
    page = open_page(file).page

    held = page.evaluate("JSON.parse(document.getElementById('ariac-score-result').textContent)")

    assert held == json.loads(as_json(result))


def test_printed_it_has_no_buttons_and_a_light_ground(open_page: Any, file: Path) -> None:
    page = open_page(file, color_scheme="dark").page
    page.emulate_media(media="print", color_scheme="dark")

    assert page.locator(".tools").first.is_hidden()
    assert page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(255, 255, 255)"


def test_what_is_folded_away_is_on_paper(open_page: Any, file: Path) -> None:
    page = open_page(file).page
    folded = page.locator("table.parameters details.fold:not([open]) > bdi").first
    assert folded.bounding_box() is None or not folded.is_visible()

    page.emulate_media(media="print")
    assert folded.bounding_box()["height"] > 10
    assert page.locator("table.parameters details.fold > summary").first.is_hidden()
    assert page.locator("details.evidence:not([open]) > ul").first.bounding_box()["height"] > 10


def test_on_paper_the_replay_stands_still_at_its_worst_moment(open_page: Any, tmp_path: Path) -> None:
    page = open_page(PAGES.write_page(tmp_path, PAGES.example())).page
    page.get_by_role("button", name="Start").click()
    required = page.locator(".strip .required")
    at_start = required.bounding_box()["width"]

    page.emulate_media(media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")

    # 5.46 m are required at the worst moment, of 7.70 m that are drawn.
    assert required.bounding_box()["width"] != at_start
    assert required.evaluate("one => one.style.width")[:3] == "70."
    assert required.evaluate("one => getComputedStyle(one).backgroundColor") != "rgb(255, 255, 255)"
    assert page.locator(".scrub input").is_hidden()
    assert (
        page.locator(".states > li").first.inner_text()
        == "order 1 announced at 1.00\u202fs, delivered at 14.00\u202fs"
    )


def test_every_parameter_in_force_is_on_the_page(open_page: Any, file: Path, result: Result) -> None:
    page = open_page(file).page
    shown = page.eval_on_selector_all(
        "table.parameters tbody",
        "all => all.map(b => [b.querySelector('tr.check bdi').innerText, b.rows.length - 1])",
    )

    kept = result.measured.settings
    assert kept is not None
    assert shown == [[name, max(len(one.parameters), 1)] for name, one in kept.items()]
    assert page.locator("table.parameters", has_text="plugin's default").count() == 1


def test_a_result_without_series_says_so(open_page: Any, tmp_path: Path) -> None:
    result = PAGES.example()
    bare = replace(result, measured=replace(result.measured, sketch=None))
    page = open_page(PAGES.write_page(tmp_path, bare)).page

    assert "This result has no series" in page.inner_text("main")
    assert page.locator(".plot").count() == 0
