"""The replay in a real browser: what stands where at which time; by keyboard, without motion or scripts."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from ariac_score import Result

pytestmark = pytest.mark.slow  # a browser

PAGES = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "pages.py")))


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return PAGES.with_routes(tmp_path_factory.mktemp("routes"))


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, result: Result) -> Path:
    return PAGES.write_page(tmp_path_factory.mktemp("replay"), result)


def seek(page: Any, t_s: float) -> None:
    page.eval_on_selector(
        ".scrub input", "(e, t) => { e.value = t; e.dispatchEvent(new Event('input')); }", t_s
    )


def told(page: Any) -> str:
    return str(page.inner_text(".replay output"))


def place_m(page: Any, route: int) -> tuple[float, float]:
    """Where a body stands on the plan, in m."""
    found = page.evaluate(
        """(route) => {
        const box = document.querySelector('.plan .box').dataset;
        const style = document.querySelector(`[data-route="${route}"]`).style;
        return [Number(box.left) + parseFloat(style.left) / 100 * Number(box.width),
                Number(box.top) - parseFloat(style.top) / 100 * Number(box.height)]; }""",
        route,
    )
    return float(found[0]), float(found[1])


def test_bodies_stand_where_the_recording_has_them(open_page: Any, file: Path) -> None:
    page = open_page(file).page

    # The robot drives back from x = 3 m with 0.5 m/s from 12 s on; the human comes nearer from 16 s to 20 s.
    for t_s, x_m in ((12.0, 3.0), (16.0, 1.0), (18.3, -0.15), (20.0, -1.0)):
        seek(page, t_s)
        assert place_m(page, 1)[0] == pytest.approx(x_m, abs=0.03)
    assert place_m(page, 0)[1] == pytest.approx(4.502, abs=0.01)


def test_it_opens_at_the_worst_moment_and_says_what_was_required(open_page: Any, file: Path) -> None:
    page = open_page(file).page

    assert told(page).startswith("20.00 s")
    assert "too near: robot and human 4.50 m apart, 5.46 m required" in told(page)
    assert "here" in (page.get_attribute(".moments > .violated", "class") or "")
    assert page.locator("#steps tr.here").count() == 1  # the amount of the ledger that it cost
    assert page.inner_text("#steps tr.here td.loss-amount").strip() == "\u22128.55"


def test_the_ring_reaches_the_human_just_where_the_violation_begins(open_page: Any, file: Path) -> None:
    page = open_page(file).page

    def ring() -> tuple[float, str]:
        found = page.evaluate(
            """() => { const ring = document.querySelector('circle.zone');
            const human = document.querySelector('[data-route="0"]').style;
            const box = document.querySelector('.plan .box').dataset;
            const x = parseFloat(human.left) / 100 * Number(box.width);
            const y = parseFloat(human.top) / 100 * Number(box.height);
            return [Math.hypot(x - ring.cx.baseVal.value, y - ring.cy.baseVal.value) - ring.r.baseVal.value,
                    ring.getAttribute('class')]; }"""
        )
        return float(found[0]), str(found[1])

    seek(page, 18.0)
    outside, look = ring()
    assert (outside > 0.1, look) == (True, "zone")
    seek(page, 18.805)  # the violation begins at 18.81 s
    assert ring()[0] == pytest.approx(0, abs=0.02)
    seek(page, 20.0)
    inside, look = ring()
    assert inside == pytest.approx(-0.956, abs=0.01)
    assert look == "zone broken"


def test_the_ring_counts_from_the_surfaces_where_the_check_does(
    open_page: Any, result: Result, tmp_path: Path
) -> None:
    # The same trial, judged between surfaces that are 0.8 m nearer than the centres.
    sketch = result.measured.sketch
    assert sketch is not None
    curves = tuple(
        replace(
            curve,
            actual=tuple(value - 0.8 for value in curve.actual),
            limit=tuple(None if value is None else value - 0.8 for value in curve.limit),
        )
        for curve in sketch.curves
    )
    measured = replace(result.measured, sketch=replace(sketch, curves=curves))
    page = open_page(PAGES.write_page(tmp_path, replace(result, measured=measured))).page

    seek(page, 18.805)  # the violation begins at 18.81 s
    radius = page.evaluate("document.querySelector('circle.zone').r.baseVal.value")
    apart = page.evaluate(
        """() => { const at = (i) => document.querySelector(`[data-route="${i}"]`).style;
        const box = document.querySelector('.plan .box').dataset;
        return Math.hypot((parseFloat(at(0).left) - parseFloat(at(1).left)) / 100 * Number(box.width),
                          (parseFloat(at(0).top) - parseFloat(at(1).top)) / 100 * Number(box.height)); }"""
    )
    assert radius == pytest.approx(apart, abs=0.02)


def test_orders_are_announced_and_delivered_as_time_goes_on(open_page: Any, file: Path) -> None:
    page = open_page(file).page

    def states() -> list[str]:
        return [str(text) for text in page.locator(".states > li").all_inner_texts()]

    seek(page, 0.6)
    assert states() == ["order 1 not announced yet", "order 2 not announced yet"]
    seek(page, 13.9)
    assert states() == ["order 1 open", "order 2 open"]
    seek(page, 14.1)
    assert states() == ["order 1 delivered", "order 2 open"]


def test_the_cursor_of_every_drawing_is_at_the_same_time(open_page: Any, file: Path) -> None:
    page = open_page(file).page
    seek(page, 30.0)

    shares = page.eval_on_selector_all(
        ".now",
        "all => all.map(e => { const p = e.parentElement.getBoundingClientRect();"
        " return (e.getBoundingClientRect().left - p.left) / p.width; })",
    )

    assert len(shares) == 2 + 5  # charts; lanes of two orders and three monitors
    for share in shares:
        assert share == pytest.approx((30.0 - 0.5) / 37.5, abs=0.01)


def test_a_click_into_a_drawing_shows_that_time(open_page: Any, file: Path) -> None:
    page = open_page(file).page
    plot = page.locator(".plot").first
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()

    page.mouse.click(box["x"] + box["width"] * 0.5, box["y"] + 20)

    assert float(told(page).split(" ")[0]) == pytest.approx(0.5 + 37.5 / 2, abs=0.2)


def test_keys_step_to_violations_and_move_in_time(open_page: Any, file: Path) -> None:
    opened = open_page(file)
    page = opened.page
    seek(page, 5.0)

    page.focus(".scrub input")
    page.keyboard.press("n")
    assert told(page).startswith("20.00 s")
    page.keyboard.press("n")  # there is no other
    assert told(page).startswith("20.00 s")
    seek(page, 30.0)
    page.keyboard.press("p")
    assert told(page).startswith("20.00 s")
    page.keyboard.press("ArrowRight")
    assert float(told(page).split(" ")[0]) > 20.0
    page.keyboard.press("Home")
    assert told(page).startswith("0.50 s")
    assert opened.complaints == []


def test_the_time_of_a_moment_is_a_button(open_page: Any, file: Path) -> None:
    page = open_page(file).page

    page.get_by_role("button", name="Show 14.00").click()

    assert told(page).startswith("14.00 s")


def test_it_plays_and_pauses_and_starts_at_the_beginning(open_page: Any, file: Path) -> None:
    page = open_page(file, reduced_motion="no-preference").page

    page.click("button[data-act=play]")
    assert page.inner_text("button[data-act=play]") == "Pause"
    page.wait_for_function(
        "parseFloat(document.querySelector('.replay output').textContent) > 0.6", timeout=10_000
    )
    page.click("button[data-act=play]")
    at = told(page)

    assert page.inner_text("button[data-act=play]") == "Play"
    assert 0.6 < float(at.split(" ")[0]) < 20.0
    page.evaluate("() => new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")
    assert told(page) == at


def test_who_wants_no_motion_gets_a_still_picture_each_second(open_page: Any, file: Path) -> None:
    page = open_page(file, reduced_motion="reduce").page
    page.clock.install(time=0)
    page.reload()
    page.clock.pause_at(1000)  # from here on time passes only as told

    page.click("button[data-act=play]")
    page.clock.run_for(900)
    assert told(page).startswith("0.50 s")
    page.clock.run_for(200)
    assert told(page).startswith("1.50 s")


def test_from_the_side_bodies_stand_as_high_as_recorded_at_the_same_time(
    open_page: Any, result: Result, tmp_path: Path
) -> None:
    sketch = result.measured.sketch
    assert sketch is not None
    human, robot = sketch.routes
    # The human, whose way along y is the longest, climbs a decimetre each second.
    climbing = replace(human, z_m=tuple(t / 10 for t in human.t_s))
    higher = replace(sketch, routes=(climbing, replace(robot, z_m=(0.0,) * len(robot.t_s))))
    file = PAGES.write_page(tmp_path, replace(result, measured=replace(result.measured, sketch=higher)))
    opened = open_page(file)

    for t_s in (12.0, 18.3):
        seek(opened.page, t_s)
        above_y_m, side_y_m, height_m = opened.page.evaluate(
            """() => [...document.querySelectorAll('[data-route="0"]')].flatMap((marker, view) => {
            const box = marker.closest('.box').dataset, style = marker.style;
            const x = Number(box.left) + parseFloat(style.left) / 100 * Number(box.width);
            const y = Number(box.top) - parseFloat(style.top) / 100 * Number(box.height);
            return view ? [x, y] : [y]; })"""
        )
        assert side_y_m == pytest.approx(above_y_m, abs=1e-3)
        assert height_m == pytest.approx(t_s / 10, abs=0.01)
    assert opened.complaints == []
    still = open_page(file, java_script_enabled=False).page
    assert still.locator(".plan .way").count() == 4


def test_without_scripts_there_is_a_still_picture(open_page: Any, file: Path) -> None:
    page = open_page(file, java_script_enabled=False).page

    assert page.locator(".plan .way").count() == 2
    assert page.locator(".pin").is_visible()
    assert page.locator(".scrub path.actual").count() == 1
    assert page.locator(".scrub input").is_hidden()
    assert page.locator(".controls").is_hidden()
    assert page.locator(".body").first.is_hidden()
    assert page.locator(".moments > li").count() == 3


def test_printed_it_is_a_still_picture_of_the_whole(open_page: Any, file: Path) -> None:
    page = open_page(file).page
    page.emulate_media(media="print")

    assert page.locator(".controls").is_hidden()
    assert page.locator(".body").first.is_hidden()
    assert page.locator(".plan .label").first.is_visible()


def test_a_body_that_nobody_saw_is_not_shown(open_page: Any, result: Result, tmp_path: Path) -> None:
    sketch = result.measured.sketch
    assert sketch is not None
    human, robot = sketch.routes
    holes = tuple(t for t in human.t_s if 15 < t < 17)[:1]
    later = replace(sketch, routes=(replace(human, holes_s=holes), robot))
    page = open_page(
        PAGES.write_page(tmp_path, replace(result, measured=replace(result.measured, sketch=later)))
    ).page

    assert holes
    seek(page, holes[0] + 0.5)
    assert page.locator("[data-route='0'] i").is_hidden()
    assert page.locator("[data-route='1'] i").is_visible()


def test_a_trial_without_positions_has_a_strip(open_page: Any, tmp_path: Path, faults_of: Any) -> None:
    opened = open_page(PAGES.write_page(tmp_path, PAGES.example()))
    page = opened.page

    required = page.locator(".strip .required").bounding_box()
    human = page.locator(".strip .second").bounding_box()
    assert human["x"] < required["x"] + required["width"]  # too near
    seek(page, 10.0)
    human = page.locator(".strip .second").bounding_box()
    assert human["x"] > page.locator(".strip .required").bounding_box()["width"] + required["x"]
    assert faults_of(opened) == []
    assert opened.complaints == []


def test_a_page_without_a_result_inside_is_quiet(open_page: Any, result: Result, tmp_path: Path) -> None:
    from ariac_score.report.html.trial import trial_page  # noqa: PLC0415  # only here

    (tmp_path / "bare.html").write_text(trial_page(result, "{}"), encoding="utf-8")
    opened = open_page(tmp_path / "bare.html")

    assert opened.complaints == []
    assert opened.page.locator(".controls").is_hidden()


def test_inside_the_page_of_a_submission_it_plays_as_well(
    open_page: Any, result: Result, tmp_path: Path
) -> None:
    from ariac_score.report.html.page import page as made  # noqa: PLC0415  # only here
    from ariac_score.report.html.page import part  # noqa: PLC0415
    from ariac_score.report.html.trial import SCRIPT  # noqa: PLC0415

    inner = PAGES.write_page(tmp_path, result).read_text(encoding="utf-8")
    run = {"title": "cell, run 1: counts", "page": inner, "open": True, "text": ""}
    outcome = part(
        "outcome.html.j2",
        status="scored",
        message="",
        columns=[],
        runs=[run, {**run, "open": False}],
        sha256="",
    )
    file = tmp_path / "submission.html"
    file.write_text(
        made("submission.html.j2", heading="h", outcome=outcome, lines=(), allowed=SCRIPT), encoding="utf-8"
    )
    opened = open_page(file)

    frame = opened.page.frame_locator("iframe").first
    assert frame.locator(".replay output").inner_text().startswith("20.00 s")
    frame.get_by_role("button", name="Show 14.00").click()
    assert frame.locator(".replay output").inner_text().startswith("14.00 s")
    assert opened.complaints == []
    assert opened.elsewhere == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("t_s", [0.6, 10.0, 38.0])
def test_no_time_of_the_replay_has_a_fault_of_accessibility(
    open_page: Any, file: Path, faults_of: Any, t_s: float, scheme: str
) -> None:
    opened = open_page(file, color_scheme=scheme)
    seek(opened.page, t_s)

    assert faults_of(opened) == []


def test_showing_another_time_leaves_the_page_where_it_is(open_page: Any, file: Path) -> None:
    page = open_page(file, viewport={"width": 390, "height": 500}).page
    plot = page.locator(".plot").first
    plot.scroll_into_view_if_needed()
    before = page.evaluate("scrollY")
    box = plot.bounding_box()

    page.mouse.click(box["x"] + box["width"] * 0.52, box["y"] + box["height"] / 2)

    assert told(page).startswith("20.")
    assert page.evaluate("scrollY") == before
    current = page.locator(".moments > .here").bounding_box()
    shown = page.locator(".moments").bounding_box()
    assert shown["y"] - 1 <= current["y"] <= shown["y"] + shown["height"]
