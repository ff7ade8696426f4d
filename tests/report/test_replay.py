"""What a page replays: moments, margin, distances to be kept, one axis of time; and when it cannot."""

from __future__ import annotations

import re
import runpy
from dataclasses import replace
from decimal import Decimal
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Finding, Result, Signal, Span, Trial, Verdict, as_json
from ariac_score.report.html.plan import plan_of, side_of
from ariac_score.report.html.replay import MOST_MOMENTS, Replay, replay_of
from ariac_score.report.html.scale import Scale
from ariac_score.report.html.timeline import axis_of
from ariac_score.report.html.trial import trial_page
from ariac_score.results.sketch import DrawnPath, Sketch, sketch_of

PAGES = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "pages.py")))


class _Tags(HTMLParser):
    """Every tag of a text, with the names of its attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, list[str]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, [name for name, _ in attrs]))


@pytest.fixture(scope="module")
def example() -> Result:
    return PAGES.example()


@pytest.fixture(scope="module")
def routes(tmp_path_factory: pytest.TempPathFactory) -> Result:
    return PAGES.with_routes(tmp_path_factory.mktemp("routes"))


def with_measured(result: Result, **changes: Any) -> Result:
    return replace(result, measured=replace(result.measured, **changes))


def page(result: Result) -> str:
    return trial_page(result, as_json(result))


# Moments -------------------------------------------------------------------------------


@pytest.mark.slow
def test_violations_and_what_was_handed_in_are_its_moments_with_what_they_cost_or_brought(
    routes: Result,
) -> None:
    replay = replay_of(routes, axis_of(routes))

    assert replay is not None
    assert [(m.kind, m.start_s, m.subject, str(m.amount)) for m in replay.moments] == [
        ("handed_in", 14.0, "order_0/order_0_shipment_0", "9.000000"),
        ("violated", 18.81, "robot/human", "-8.546224"),
        ("handed_in", 31.0, "order_1/order_1_shipment_0", "21.000000"),
    ]
    (violated,) = [m for m in replay.moments if m.is_worst]
    assert violated.t_s == 20.0  # of its worst sample, as the message says
    assert [(w.path, w.announced_s, w.handed_in_s) for w in replay.work] == [
        ("order_0", 1.0, (14.0,)),
        ("order_1", 8.0, (31.0,)),
    ]


def test_where_its_amounts_are_not_the_whole_score_the_page_says_what_else_there_is(routes: Result) -> None:
    text = page(routes)

    # 9 - 8.55 + 21 is not 19.76, and the bar says 19.76 - 28 = -8.24.
    (found,) = re.findall(r"<p [^>]*>These amounts are .*?</p>", text)
    note = re.sub(r"<[^>]+>", "", found)
    assert "what happened at no known time is only among those" in note
    assert "the safety bar, \u22128.24, is what violations took of what the mistakes had left" in note


def test_where_its_amounts_are_the_whole_score_there_is_nothing_to_explain(
    routes: Result, monkeypatch: pytest.MonkeyPatch
) -> None:
    replay = replay_of(routes, axis_of(routes))
    assert replay is not None
    assert replay.listed == Decimal("21.453776")  # 9 - 8.546224 + 21

    monkeypatch.setattr(Replay, "listed", property(lambda _: routes.score))
    assert "These amounts are" not in page(routes)


def test_of_very_many_violations_those_that_cost_most_are_its_moments(routes: Result) -> None:
    one = routes.findings["separation#1"]
    many = {
        f"x#{i}": replace(one, check="x", span=Span(float(i) / 10, float(i) / 10 + 0.01)) for i in range(100)
    }
    replay = replay_of(with_measured(routes, findings={**many, "separation#1": one}), axis_of(routes))

    assert replay is not None
    violated = [m for m in replay.moments if m.kind == "violated"]
    assert len(violated) == MOST_MOMENTS
    assert "separation#1" in {m.finding for m in violated}  # the only one that the ledger prices
    assert replay.omitted == 101 - MOST_MOMENTS


def test_the_margin_of_the_worst_curve_is_what_is_dragged_along(routes: Result) -> None:
    replay = replay_of(routes, axis_of(routes))

    assert replay is not None
    assert replay.margin is not None
    assert (replay.margin.curve.check, replay.margin.least_s) == ("separation", 20.0)
    # The message says 0.956 m nearer than required.
    assert replay.margin.least == pytest.approx(-0.956, abs=5e-4)
    points = [(int(x), int(y)) for x, y in re.findall(r"[ML](\d+) (\d+)", replay.margin.line)]
    lowest = max(points, key=lambda point: point[1])
    assert lowest == (round((20.0 - 0.5) * 1000), 1000)


def test_each_pair_has_one_distance_to_keep_its_worst(routes: Result) -> None:
    replay = replay_of(routes, axis_of(routes))
    sketch = routes.measured.sketch

    assert replay is not None
    assert sketch is not None
    assert [sketch.curves[place].check for place in replay.zones] == ["separation"]


def test_without_positions_the_distance_is_replayed(example: Result) -> None:
    replay = replay_of(example, axis_of(example))

    assert replay is not None
    assert replay.strip is not None
    assert (replay.strip.first, replay.strip.second, replay.strip.t_s) == ("robot", "human", 20.0)
    assert replay.strip.distance - replay.strip.required == pytest.approx(-0.956, abs=5e-4)
    assert "The log records no positions, but the distance" in page(example)


def test_without_any_motion_there_is_no_replay_and_the_page_says_why(example: Result) -> None:
    still = with_measured(example, sketch=Sketch())

    assert replay_of(still, axis_of(still)) is None
    text = page(still)
    assert "so there is nothing to replay" in text
    assert 'type="range"' not in text
    assert "This result has no series, so there is nothing to replay" in page(
        with_measured(example, sketch=None)
    )


def test_a_long_trial_is_played_in_less_than_a_minute(routes: Result) -> None:
    for end_s, speed in ((38.0, 1), (600.0, 30), (10_800.0, 300)):
        replay = replay_of(routes, Scale(0.5, end_s))
        assert replay is not None
        assert replay.speed == speed
        assert {1, speed} <= set(replay.speeds)


# One axis ------------------------------------------------------------------------------


def test_all_drawings_over_time_have_the_same_ends(routes: Result) -> None:
    text = page(routes)

    ends = set(re.findall(r'data-start="([^"]*)" data-end="([^"]*)"', text))
    assert ends == {("0.5", "38.0")}
    assert len(re.findall(r'class="chart"', text)) == 2


def test_the_axis_takes_in_what_is_drawn_beyond_the_trial(example: Result) -> None:
    route = DrawnPath("robot", "robot", (-3.0, 50.0), (0.0, 1.0), (0.0, 1.0))
    sketch = replace(example.measured.sketch, routes=(route,))  # type: ignore[type-var]

    assert axis_of(with_measured(example, sketch=sketch)) == Scale(-3.0, 50.0)
    assert axis_of(with_measured(example, sketch=None, window=None)) is None


# The plan ------------------------------------------------------------------------------


def test_a_name_is_not_written_over_a_route() -> None:
    # The route passes its own end to both sides, and another one comes from above: below is room.
    route = DrawnPath("arm", "robot", (0.0, 1.0, 2.0, 3.0), (-4.0, 4.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    up = DrawnPath("ann", "human", (0.0, 1.0), (0.0, 0.0), (2.0, 0.0))

    aside = DrawnPath("bob", "human", (0.0, 1.0), (-4.0, -3.9), (-2.0, -2.0))

    plan = plan_of(Sketch(routes=(route, up, aside)), {})

    assert plan is not None
    assert plan.ways[0].label == "below"


def test_a_name_stays_inside_the_plan() -> None:
    route = DrawnPath("arm", "robot", (0.0, 1.0), (0.0, 4.0), (0.0, 0.0))

    plan = plan_of(Sketch(routes=(route,)), {})

    assert plan is not None
    assert plan.ways[0].label == "before"  # everywhere else it would stick out


def test_from_the_side_the_longer_way_is_drawn_against_the_height() -> None:
    hook = DrawnPath("hook", "robot", (0.0, 9.0), (0.0, 1.0), (2.0, 6.0), (), (3.0, 1.0))
    post = DrawnPath("post", "thing", (0.0, 9.0), (0.5, 0.5), (6.0, 6.0), (), (0.0, 0.0))
    touched = Finding("hook/post", Verdict.VIOLATED, "touched", Span(9.0, 9.0))

    side = side_of(Sketch(routes=(hook, post)), {"touch#1": touched})  # 4 by 3 m, and a tenth

    assert side is not None
    assert (side.across, side.up) == ("y_m", "z_m")
    assert (side.left, side.top) == (
        pytest.approx(4 - 2.2),
        pytest.approx(1.5 + 1.65),
    )
    assert [way.path for way in side.ways] == ["M0.2 0.15L4.2 2.15", "M4.2 3.15L4.2 3.15"]
    assert [(pin.number, pin.finding, pin.top) for pin in side.pins] == [
        (1, "touch#1", pytest.approx(100 * (3.15 - 0.5) / 3.3, abs=0.01))  # half way between them
    ]


def test_without_heights_there_is_no_view_from_the_side(routes: Result) -> None:
    sketch = routes.measured.sketch

    assert sketch is not None
    assert side_of(sketch, routes.findings) is None
    assert "From the side" not in page(routes)


# Size and hostile names ----------------------------------------------------------------


@pytest.mark.slow
def test_a_trial_of_three_hours_stays_below_two_megabytes(example: Result) -> None:
    draw = np.random.default_rng(7)
    t = np.arange(108_000) / 10
    bodies = (Body("gantry", "robot"), *(Body(f"person_{i}", "human") for i in range(8)))
    signals = {
        f"position/{b.id}": Signal(f"position/{b.id}", "m", t, draw.normal(0, 9, (len(t), 3))) for b in bodies
    }
    charts = PAGES.noisy_charts(draw, t, 8)
    findings = {
        f"separation#{i}": Finding(
            f"gantry/person_{i % 8}",
            Verdict.VIOLATED,
            "too close",
            Span(50.0 * i, 50.0 * i + 3),
            robustness=-0.5,
            unit="m",
            check="separation",
        )
        for i in range(1, 200)
    }
    trial = Trial("long", bodies=bodies, signals=signals, recorded=Span(0.0, 10_800.0))
    sketch = sketch_of(trial, {"separation": charts}, {})
    result = with_measured(example, sketch=sketch, findings=findings, window=Span(0.0, 10_800.0))

    assert (
        len(
            trial_page(
                replace(result, ledger=None, score=None, status="incomplete"), as_json(result)
            ).encode()
        )
        < 2_000_000
    )


def test_hostile_names_stand_as_text_in_the_replay() -> None:
    hostile = PAGES.hostile()
    text = page(hostile)
    replayed = text[text.index('<section id="plan"') : text.index('<section id="why"')]

    assert 'class="replay"' in replayed
    tags = _Tags(replayed).tags
    assert not {"script", "img", "base", "form"} & {tag for tag, _ in tags}
    assert not [name for _, names in tags for name in names if name.startswith("on") or name == "src"]
    assert not set("\u202e\u202c\x1b") & set(replayed)
    assert "rob&lt;b&gt;ot and hum" in replayed


def test_the_margin_of_an_upper_limit_is_what_is_left_below_it(routes: Result) -> None:
    sketch = routes.measured.sketch
    assert sketch is not None
    curve = replace(sketch.curves[0], at_most=True, t_s=(1.0, 2.0), actual=(3.0, 5.0), limit=(4.0, 4.0))
    replay = replay_of(with_measured(routes, sketch=replace(sketch, curves=(curve,))), axis_of(routes))

    assert replay is not None
    assert replay.margin is not None
    assert (replay.margin.least, replay.margin.least_s) == (-1.0, 2.0)
    assert replay.zones == ()  # an upper limit is no distance to keep
