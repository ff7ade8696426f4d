"""The page of a trial, without a browser: what it says, what is inside, how small it is."""

from __future__ import annotations

import re
import runpy
from collections.abc import Iterator
from dataclasses import replace
from decimal import Decimal
from html.parser import HTMLParser
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from ariac_score import (
    Body,
    Finding,
    Limit,
    OfficialOrder,
    OfficialResult,
    Result,
    Span,
    Trial,
    as_json,
    score_trial,
)
from ariac_score.cli import main
from ariac_score.report.html.charts import HEIGHT, chart_of
from ariac_score.report.html.page import embedded_json
from ariac_score.report.html.plan import plan_of
from ariac_score.report.html.scale import Scale, ticks
from ariac_score.report.html.timeline import timeline_of
from ariac_score.report.html.trial import embedded_result, trial_page
from ariac_score.report.html.waterfall import waterfall_of
from ariac_score.report.html.work import grouped
from ariac_score.results.adjustments import adjust, load_adjustments
from ariac_score.results.result_file import measured_sha256
from ariac_score.results.sketch import DrawnChart, DrawnPath, Sketch, sketch_of
from ariac_score.scoring.ledger import Line
from ariac_score.testing import write_trial_log
from ariac_score_ariac.testing import kitting_trial

PAGES = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "pages.py")))
RESULT = PAGES.EXAMPLE
KITTING_1 = Path(__file__).parents[2] / "examples/competition/2024/logs/aurora/kitting_1"


class _Tags(HTMLParser):
    """Every tag of a page with its attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attrs)))

    def all(self, attribute: str) -> list[str]:
        return [value for _, attrs in self.tags if (value := attrs.get(attribute)) is not None]


def _exact(page: str) -> str:
    """A page with every number as exact as its title says it."""
    return re.sub(r'<data value="[^"]*" title="exactly ([^"]*)">[^<]*</data>', r"\1", page)


def _page(result: Result) -> str:
    return trial_page(result, as_json(result))


@pytest.fixture(scope="module")
def example() -> Result:
    return PAGES.example()


# The whole page ------------------------------------------------------------------------


def test_no_two_places_have_one_name_and_every_link_has_one(example: Result) -> None:
    for result in (example, PAGES.hostile()):
        tags = _Tags(_page(result))
        places = tags.all("id")
        assert len(places) == len(set(places))
        assert {link[1:] for link in tags.all("href") if link.startswith("#")} <= set(places)


def test_nothing_on_it_is_loaded_from_anywhere(example: Result) -> None:
    tags = _Tags(_page(example))

    assert [link for link in tags.all("href") if not link.startswith("#")] == ["data:,"]
    assert tags.all("src") == tags.all("srcset") == tags.all("action") == []
    assert not [value for tag, attrs in tags.tags for name, value in attrs.items() if name.startswith("on")]


def test_the_same_result_gives_the_same_page(example: Result) -> None:
    assert _page(example) == _page(example)


def test_it_says_score_rules_hashes_margins_and_clauses(example: Result) -> None:
    text = _page(example)

    for word in (
        "19.761677",
        "paper2020.published",
        example.provenance.rule_set.sha256,
        example.provenance.inputs[0].sha256,
        "derived from ISO/TS 15066:2016, 5.5.4",
        "\u22120.956 m",
        "18.81\u202fs \u2013 21.21\u202fs",
        "required_distance/robot/human",
        "blue gear",
        "distance 0.031 m (at most 0.03)",
        "delta_m",
        "100 Hz",
        "/snapshot",
    ):
        assert word in text, word


@pytest.mark.slow
def test_a_ten_minute_trial_with_noise_everywhere_stays_below_two_megabytes(example: Result) -> None:
    draw = np.random.default_rng(5)
    t = np.arange(60_000) / 100.0
    bodies = (Body("gantry", "robot"), *(Body(f"person_{i}", "human") for i in range(4)))
    charts = PAGES.noisy_charts(draw, t, 4)
    moments = {
        ("separation", f"gantry/person_{i}"): [Span(60.0 * k, 60.0 * k + 3) for k in range(9)]
        for i in range(4)
    }
    sketch = sketch_of(Trial("long", bodies=bodies), {"separation": charts}, moments)
    routes = tuple(
        DrawnPath(
            body.id, body.kind, tuple(range(1200)), *(tuple(draw.normal(0, 9, 1200).round(4)) for _ in "xy")
        )
        for body in bodies
    )
    result = replace(example, measured=replace(example.measured, sketch=replace(sketch, routes=routes)))

    assert len(_page(result).encode()) < 2_000_000


def test_a_withheld_score_is_shown_as_what_it_could_be(tmp_path: Path) -> None:
    log = write_trial_log(tmp_path / "a.jsonl", kitting_trial(human=False), signals=("speed/robot",))
    rules = "id: mine\ntitle: Mine\nsource: a test\nextends: paper2020.published\nopen: withhold\n"
    (tmp_path / "mine.yaml").write_text(rules, encoding="utf-8")

    text = _page(score_trial(log, tmp_path / "mine.yaml"))

    assert "points; withheld until what is open is decided" in text
    assert "There is no score to explain" in text
    assert "undecided" in text


def test_without_a_human_there_is_no_chart_and_it_says_so(tmp_path: Path) -> None:
    log = write_trial_log(tmp_path / "a.jsonl", kitting_trial(human=False), signals=("speed/robot",))

    text = _page(score_trial(log, "paper2020.published"))

    assert "Nothing that a monitor compares with a limit over time was recorded" in text


def test_a_trial_without_orders_or_findings_has_a_page(example: Result) -> None:
    measured = example.measured
    bare = replace(measured, findings={}, scopes=replace(measured.scopes, inner=()), orders={}, coverage=())
    result = replace(example, measured=replace(bare, window=None, sketch=Sketch()))

    text = trial_page(result, "{}")

    assert "No order was announced" in text
    assert 'id="timeline"' not in text  # nothing there has a time
    timed = replace(result, measured=replace(result.measured, coverage=measured.coverage))
    assert "so there is no timeline" in trial_page(timed, "{}")


def _adjusted(folder: Path, result: Result, **decision: Any) -> Result:
    about = {"trial": result.measured.trial, "measured": measured_sha256(result)}
    about |= {"finding": decision.pop("finding")} if "finding" in decision else {}
    entry = {
        "id": "protest_3",
        "author": "<b>A. Steward</b>",
        "reason": "a marshal had \u202eknocked over the camera",
        "time": "2024-05-12T14:30:00Z",
        "target": about,
        "effect": decision,
    }
    (folder / "adjustments.yaml").write_text(yaml.safe_dump({"adjustments": [entry]}), encoding="utf-8")
    decided, _ = adjust(
        result, load_adjustments(folder / "adjustments.yaml"), measured=measured_sha256(result)
    )
    return decided


def test_a_decision_of_a_steward_stands_on_top_and_the_automatic_score_beside_it(
    tmp_path: Path, example: Result
) -> None:
    text = _page(_adjusted(tmp_path, example, finding="separation#1", verdict="satisfied"))

    # Without its one breach the example is worth its 28 task points.
    assert '<span class="score" id="score">28</span>' in text
    assert "automatic score 19.761677 of 36 possible" in _exact(text)
    assert "8.238323" in _exact(text)
    assert "How the automatic score came about" in text
    assert "&lt;b&gt;A. Steward&lt;/b&gt;" in text
    assert "a marshal had \\u202eknocked over the camera" in text
    assert "2024-05-12T14:30:00Z" in text
    assert '<a href="#decisions">stewards</a>' in text


def test_a_disqualified_trial_says_so_first(tmp_path: Path, example: Result) -> None:
    text = _page(_adjusted(tmp_path, example, disqualified=True))

    assert ">Disqualified<" in text
    assert "automatic score 19.761677" in _exact(text)


def test_a_trial_nobody_decided_about_has_no_decisions(example: Result) -> None:
    assert "stewards" not in _page(example).partition('id="ariac-score-result"')[0]


def test_a_page_among_others_leads_back(example: Result) -> None:
    text = trial_page(example, as_json(example), home="../index.html")

    assert '<a href="../index.html">Competition</a>' in text
    assert "index.html" not in _page(example)
    # One page alone does not know of other runs.
    assert " run " not in _page(example).partition("</h1>")[0].partition("</style>")[2]


# The command ---------------------------------------------------------------------------


def test_the_command_writes_a_page_and_gives_the_result_back_to_the_byte(tmp_path: Path) -> None:
    page, again = tmp_path / "trial.html", tmp_path / "again.json"

    assert main(["report", str(RESULT), "-o", str(page)]) == 0
    assert main(["report", "--extract", str(page), "-o", str(again)]) == 0

    assert again.read_bytes() == RESULT.read_bytes()


def test_a_hostile_result_comes_back_to_the_byte(example: Result) -> None:
    words = ("\\u003c", "\\\\u003c<", "</script>", "<!--", "\\")
    result = replace(example, measured=replace(example.measured, unrecorded=words))

    assert embedded_result(_page(result)) == as_json(result)


@given(st.text(alphabet="\\u03c<>/ab\n\"'", max_size=30))
def test_any_text_survives_being_embedded(text: str) -> None:
    import json  # noqa: PLC0415  # only this test

    stored = json.dumps({"text": text}, ensure_ascii=False)
    block = f'<script type="application/json" id="ariac-score-result">\n{embedded_json(stored)}</script>'

    assert embedded_result(block) == stored


def test_a_page_goes_to_stdout_where_that_is_asked_for(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", str(RESULT), "-o", "-"]) == 0
    assert capsys.readouterr().out.startswith("<!DOCTYPE html>")


def test_a_page_that_nobody_names_has_the_name_of_its_result_and_takes_no_other_files_place(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)

    assert main(["report", str(RESULT)]) == 0
    assert capsys.readouterr() == ("", "open kitting_near_miss.html\n")
    assert main(["report", "-q", str(RESULT)]) == 0  # its own page may be made again
    assert capsys.readouterr() == ("", "")
    Path("kitting_near_miss.html").write_text("<p>notes of mine</p>")
    assert main(["report", str(RESULT)]) == 4
    assert "no page of a trial" in capsys.readouterr().err
    assert Path("kitting_near_miss.html").read_text() == "<p>notes of mine</p>"


@pytest.mark.parametrize(
    "text", ["", "{}", "[]", "no json", '{"schema": 3}', '{"schema": "ariac-score/oracle/1"}']
)
def test_what_is_no_result_is_refused_with_a_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    (tmp_path / "a.json").write_text(text, encoding="utf-8")

    assert main(["report", str(tmp_path / "a.json"), "-o", str(tmp_path / "a.html")]) == 6
    assert "a.json" in capsys.readouterr().err
    assert not (tmp_path / "a.html").exists()


def test_a_missing_file_and_a_page_without_result_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.html").write_text("<p>", encoding="utf-8")

    assert main(["report", str(tmp_path / "none.json")]) == 5
    assert main(["report", "--extract", str(tmp_path / "none.html")]) == 5
    assert main(["report", "--extract", str(tmp_path / "a.html")]) == 6
    assert "there is no result in it" in capsys.readouterr().err


def test_the_result_is_not_overwritten_by_its_page(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_bytes(RESULT.read_bytes())

    assert main(["report", str(tmp_path / "a.json"), "-o", str(tmp_path / "a.json")]) == 4
    assert (tmp_path / "a.json").read_bytes() == RESULT.read_bytes()


def test_an_edited_result_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = RESULT.read_text(encoding="utf-8").replace('"score": 19.761677', '"score": 29.761677')
    (tmp_path / "a.json").write_text(text, encoding="utf-8")

    assert main(["report", str(tmp_path / "a.json")]) == 6
    assert "the ledger adds up to" in capsys.readouterr().err


# Steps ---------------------------------------------------------------------------------


def _lines() -> st.SearchStrategy[Line]:
    amount = st.integers(-10_000, 10_000).map(lambda n: Decimal(n).scaleb(-2))
    leaf = st.builds(
        lambda a, k: Line("", "leaf", k, a, float(a)), amount, st.sampled_from(["amount", "factor"])
    )

    def summed(parts: list[Line]) -> Line:
        total = sum((part.amount for part in parts), Decimal(0))
        return Line("", "sum", "sum", total, float(total), children=tuple(parts))

    return st.recursive(
        leaf, lambda inner: st.lists(inner, min_size=1, max_size=7).map(summed), max_leaves=80
    )


def _named(line: Line, path: str) -> Line:
    children = tuple(_named(child, f"{path}/{i}") for i, child in enumerate(line.children))
    return structs.replace(line, path=path, children=children)


@pytest.mark.slow
@settings(max_examples=60)
@given(_lines())
def test_the_steps_of_any_ledger_add_up_to_it(line: Line) -> None:
    falls = waterfall_of(_named(line, "score"), {})

    assert sum((step.amount for step in falls.steps), Decimal(0)) == line.amount
    assert falls.steps[-1].after == line.amount
    for step in falls.steps:
        assert -1e-6 <= step.left <= step.left + step.width <= 100 + 1e-6
    assert 0 <= falls.zero <= 100


def test_the_steps_of_the_example_are_those_of_its_ledger(example: Result) -> None:
    assert example.ledger is not None

    falls = waterfall_of(example.ledger, example.measured.findings)

    steps = [(step.label, step.outermost, step.amount) for step in falls.steps]
    assert steps[0] == ("type", "order_0", Decimal(3))
    assert ("bonus", "order_1", Decimal(6)) in steps
    assert [(step.amount, step.findings) for step in falls.steps[-4:]] == [
        (Decimal("-0.846049"), ("none_missing#1",)),
        (Decimal("-0.846049"), ("none_unwanted#1",)),
        (Decimal("-8.546224"), ("separation#1",)),
        (Decimal("-0.000001"), ()),  # rounding
    ]
    assert falls.steps[1].findings[0] == "part_color#2"  # the violated one before those that were kept


def test_a_step_says_whose_it_is_below_a_sum_that_is_a_formula_and_names_its_check() -> None:
    def total(path: str, label: str, subject: str, inner: Line) -> Line:
        return Line(path, label, "sum", Decimal(4), 4.0, (inner,), subject=subject)

    found = Line(
        "", "right", "amount", Decimal(4), 4.0, findings=("right#1",), subject="order_0/kit_0/part_0"
    )
    price = total("score/gate_contact_kits/kit_0/right", "right_part * points(right_color)", "", found)
    kit = total("score/gate_contact_kits/kit_0", "kit_0", "order_0/kit_0", price)
    whole = total("score", "score", "", total("score/gate_contact_kits", "gate(contact) * kits", "", kit))

    (step,) = waterfall_of(whole, {}).steps

    assert (step.words, step.where) == ("right colour", "order_0/kit_0")
    assert step.label == "right_part * points(right_color)"  # shown on pointing at it


# Charts and plan -----------------------------------------------------------------------


def _curve(actual: list[float], limit: list[float | None], **more: Any) -> DrawnChart:
    t = tuple(float(i) for i in range(len(actual)))
    return DrawnChart(
        "separation", "a/b", "distance", "m", False, len(t), t, tuple(actual), tuple(limit), **more
    )


def _shapes(chart: Any) -> list[list[tuple[float, float]]]:
    """The shaded shapes, in s from the start and in units below the upper edge."""
    shapes = []
    for shape in filter(None, chart.beyond.split("z")):
        x = y = 0
        points = []
        for act, right, down in re.findall(r"([Ml])(-?\d+) (-?\d+)", shape):
            x, y = (int(right), int(down)) if act == "M" else (x + int(right), y + int(down))
            points.append((x / 1000, y * chart.height / HEIGHT))
        shapes.append(points)
    return shapes


def _area(points: list[tuple[float, float]]) -> float:
    pairs: Iterator[Any] = zip(points, [*points[1:], points[0]], strict=True)
    return abs(sum(x1 * y2 - x2 * y1 for (x1, y1), (x2, y2) in pairs)) / 2


def test_the_shade_is_the_shortfall_from_crossing_to_crossing() -> None:
    # Distance 3, 1, 3 against 2: below from t = 0.5 to 1.5, a triangle of height 1.
    chart = chart_of(_curve([3.0, 1.0, 3.0], [2.0, 2.0, 2.0]), {})

    assert chart is not None
    (shape,) = _shapes(chart)
    assert _area(shape) == pytest.approx(0.5, abs=1e-4)
    assert (min(x for x, _ in shape), max(x for x, _ in shape)) == (0.5, 1.5)


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), min_size=2, max_size=40).map(
        lambda rows: [(a / 10, b / 10) for a, b in rows]
    )
)
def test_the_shade_has_the_area_of_the_shortfall(rows: list[tuple[float, float]]) -> None:
    chart = chart_of(_curve([a for a, _ in rows], [b for _, b in rows]), {})

    # The integral of max(required - distance, 0), straight lines between samples.
    grid = np.linspace(0, len(rows) - 1, (len(rows) - 1) * 200 + 1)
    t = np.arange(len(rows))
    depth = np.maximum(np.interp(grid, t, [b - a for a, b in rows]), 0)
    wanted = float(((depth[1:] + depth[:-1]) / 2 * np.diff(grid)).sum())
    assert chart is not None
    assert sum(map(_area, _shapes(chart))) == pytest.approx(wanted, abs=0.02 * len(rows))


@pytest.mark.parametrize(("at_most", "word"), [(False, "shortfall"), (True, "excess")])
def test_the_key_names_which_side_of_the_limit_is_shaded(example: Result, at_most: bool, word: str) -> None:
    sketch = example.measured.sketch
    assert sketch is not None
    chart = next(chart for chart in sketch.curves if chart.check == "separation")
    shown = replace(sketch, curves=(replace(chart, at_most=at_most),))

    text = _page(replace(example, measured=replace(example.measured, sketch=shown)))

    assert [name for name in ("shortfall", "excess") if f"</i>{name}<" in text] == [word]


def test_there_is_no_shade_at_the_limit_itself_nor_where_none_applies() -> None:
    assert chart_of(_curve([2.0, 2.0, 2.0], [2.0, 2.0, 2.0]), {}).beyond == ""  # type: ignore[union-attr]
    assert chart_of(_curve([1.0, 1.0, 1.0], [None, None, None]), {}).beyond == ""  # type: ignore[union-attr]


def test_a_line_is_lifted_over_a_hole() -> None:
    chart = chart_of(_curve([3.0, 3.0, 3.0, 3.0], [2.0, 2.0, 2.0, 2.0], holes_s=(1.0,)), {})

    assert chart is not None
    assert chart.actual.count("M") == chart.limit.count("M") == 2


def test_the_closest_approach_and_the_worst_margin_are_marked() -> None:
    chart = chart_of(_curve([5.0, 2.0, 3.0, 5.0], [1.0, 1.0, 4.0, 1.0]), {})

    assert chart is not None
    assert [(mark.kind, mark.t_s, mark.value) for mark in chart.marks] == [
        ("closest", 1.0, 2.0),
        ("worst", 2.0, 3.0),
    ]


def test_the_plan_pins_a_violation_between_both_bodies(tmp_path: Path) -> None:
    result = PAGES.with_routes(tmp_path)

    plan = plan_of(result.measured.sketch, result.measured.findings)

    assert plan is not None
    (pin,) = plan.pins
    # At 20.00 s the robot is at x = 1.0 - 0.5 * (20 - 12) = -1.0 m (3 m, then back for 8 s), the human beside
    # it at 4.502 m: the pin is half way, 2.251 m up.
    left = min(x for route in result.measured.sketch.routes for x in route.x_m)
    right = max(x for route in result.measured.sketch.routes for x in route.x_m)
    middle = (left + right) / 2
    assert pin.left == pytest.approx(50 + 100 * (-1.0 - middle) / plan.width, abs=0.3)
    assert pin.finding == "separation#1"


def test_without_routes_there_is_no_plan() -> None:
    assert plan_of(Sketch(), {}) is None


# Timeline and scales -------------------------------------------------------------------


def test_the_timeline_has_a_lane_for_each_monitor_and_order(example: Result) -> None:
    timeline = timeline_of(example, ["no_arm_collision", "separation", "human_contact"])

    assert timeline is not None
    assert [lane.name for lane in timeline.work] == ["order_0", "order_1"]
    assert [lane.ground for lane in timeline.monitors] == ["satisfied"] * 3
    (block,) = timeline.monitors[1].blocks
    # 18.81 s to 21.21 s of 0.5 s to 38 s.
    assert (block.left, block.width) == (
        pytest.approx(100 * 18.31 / 37.5, abs=1e-3),
        pytest.approx(100 * 2.4 / 37.5, abs=1e-3),
    )
    submitted = [block.left for block in timeline.work[0].blocks if block.state == "submitted"]
    assert submitted == [pytest.approx(100 * 13.5 / 37.5, abs=1e-3)]


def _words(result: Result) -> str:
    timeline = timeline_of(result, [])
    assert timeline is not None
    return timeline.work[0].blocks[0].title


def test_submissions_of_an_official_record_are_shown_as_its_statement(example: Result) -> None:
    assert _words(example).endswith("last shipment at 14.00\u202fs")
    measured = replace(example.measured, sketch=Sketch())

    def with_record(summary: OfficialOrder) -> Result:
        official = OfficialResult("trial_log.txt", 1.0, None, summaries=(summary,))
        return replace(example, measured=replace(measured, official=official))

    result = with_record(OfficialOrder("order_0", submitted=True, submitted_s=12.5))
    assert _words(result).endswith("submitted at 12.50\u202fs by the official record")
    assert _words(with_record(OfficialOrder("order_0", submitted=False))).endswith(
        "not submitted by the official record"
    )
    assert _words(with_record(OfficialOrder("order_7"))).endswith("never submitted")


def test_an_order_ends_on_the_timeline_when_the_official_text_says_that_it_was_handed_in() -> None:
    """Example run of 2024: announced at 2 s, handed in at 210.662 s and 125.886 s, over at 211.162 s."""
    timeline = timeline_of(score_trial(KITTING_1, "ariac2024.official"), [])

    assert timeline is not None
    ends_s = [2.11162 * (lane.blocks[0].left + lane.blocks[0].width) for lane in timeline.work]
    assert ends_s == [pytest.approx(210.662, abs=1e-3), pytest.approx(125.886, abs=1e-3)]


def test_an_official_text_of_another_clock_dates_by_how_long_an_order_took(example: Result) -> None:
    measured = replace(example.measured, sketch=Sketch())

    def end_of(announced_s: float | None, submitted_s: float) -> float:
        summary = OfficialOrder("order_0", submitted=True, announced_s=announced_s, submitted_s=submitted_s)
        official = OfficialResult("trial_log.txt", 1.0, None, summaries=(summary,))
        result = replace(example, measured=replace(measured, official=official))
        timeline = timeline_of(result, [])
        assert timeline is not None
        block = timeline.work[0].blocks[0]
        return 0.5 + 0.375 * (block.left + block.width)  # the trial runs from 0.5 s to 38 s

    # The log announces order_0 at 1 s; whatever the text's zero is, the order took 11.5 s.
    assert end_of(100.0, 111.5) == pytest.approx(12.5, abs=1e-3)
    assert end_of(None, 12.5) == pytest.approx(38.0)
    assert end_of(100.0, 500.0) == pytest.approx(38.0)  # no time of this trial


def test_where_the_score_waits_for_others_the_task_score_stands_on_top() -> None:
    page = _page(score_trial(KITTING_1, "ariac2024.official"))

    assert '<span class="score" id="score">22</span>' in page
    assert "No score" not in page


def test_a_log_that_cannot_show_submissions_does_not_claim_that_there_were_none(example: Result) -> None:
    measured = replace(example.measured, sketch=Sketch(), witnessed=())

    assert _words(replace(example, measured=measured)).endswith("no submission is recorded")


def test_findings_with_the_same_message_are_shown_together() -> None:
    found = (
        ("a#1", Finding.satisfied("order_0", "fine")),
        ("b#1", Finding.inconclusive("order_0", "not recorded")),
        ("c#1", Finding.violated("order_0", "wrong")),
        ("d#1", Finding.inconclusive("order_0", "not recorded")),
        ("e#1", Finding.satisfied("order_0", "also fine")),
        ("f#1", Finding.from_limits("order_0", Limit("distance", 0.1, "m", at_most=0.2))),
    )

    groups = [(verdict.value, words, [key for key, _ in alike]) for verdict, words, alike in grouped(found)]

    assert groups == [
        ("violated", "wrong", ["c#1"]),
        ("inconclusive", "not recorded", ["b#1", "d#1"]),
        ("satisfied", "distance 0.1 m (at most 0.2)", ["f#1"]),
        ("satisfied", "", ["a#1", "e#1"]),
    ]


@given(st.floats(-1000, 1000), st.floats(0.001, 10_000), st.integers(2, 12))
def test_ticks_are_round_and_lie_within(low: float, length: float, most: int) -> None:
    found = ticks(low, low + length, most)

    assert len(found) <= most + 1
    assert all(low - 1e-6 <= tick <= low + length + 1e-6 for tick in found)


@given(st.floats(-1e6, 1e6))
def test_a_place_is_always_on_the_drawing(value: float) -> None:
    assert 0 <= Scale(0.5, 38.0).at(value) <= 100


def test_distances_are_headed_by_the_kinds_of_the_bodies_they_are_between() -> None:
    result = PAGES.example()
    sketch = result.measured.sketch
    curve = sketch.curves[0]
    routes = tuple(
        DrawnPath(body, kind, (0.0,), (0.0,), (0.0,)) for body, kind in (("quad", "drone"), ("ann", "walker"))
    )

    def heading(*subjects: str) -> str:
        curves = tuple(replace(curve, subject=subject) for subject in subjects)
        drawn = replace(sketch, curves=curves, routes=routes)
        shown = replace(result, measured=replace(result.measured, sketch=drawn))
        page = trial_page(shown, as_json(shown))
        return re.findall(r'<h2 id="separation-h"><bdi>(.*?)</bdi>', page)[0]

    assert heading("quad/ann") == "Separation of drone and walker"
    assert heading("quad/bob") == "Separation of drone and bob"  # the plan does not show him
    assert heading("quad/ann", "quad/quad") == "Separation"
