"""A score that the log leaves open, on every page and in every export: its ends, and what would help."""

from __future__ import annotations

import json
import re
import runpy
from csv import DictReader
from dataclasses import replace
from decimal import Decimal
from html import unescape
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree.ElementTree import fromstring

import pytest

from ariac_score import Result, as_json, score_trial
from ariac_score.checks.findings import Verdict
from ariac_score.checks.open_findings import OpenFindings
from ariac_score.report.exports import exported
from ariac_score.report.html.trial import trial_page
from ariac_score.report.often import told_once
from ariac_score.report.openness import undecided_text
from ariac_score.report.text import score_text
from ariac_score.results.result import Setting, Settings
from ariac_score.scoring.interval import Narrowing, ScoreInterval
from ariac_score.scoring.policy import Assumption

EXAMPLES = Path(__file__).parents[2] / "examples"
PAGES = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "pages.py")))
GAPS = "12 gaps of 51 to 97 ms on /snapshot"
NARROWING = (
    Narrowing(GAPS, ("separation",), ("separation#1",), Decimal("6.238323")),
    Narrowing("the pose of <b>a part</b>", ("part_pose",), (), Decimal("2")),
    Narrowing("contents unknown", ("part_type",)),
)


@pytest.fixture(scope="module")
def closed() -> Result:
    """The example: 19.761677 of 36, of which 8.238323 were lost to the one violation of safety."""
    example: Result = PAGES.example()
    return example


def opened(closed: Result, counts: str = "worst", **more: Any) -> Result:
    """The example with everything that happened to its violation unknown: 19.761677 to 28."""
    interval = ScoreInterval(
        Decimal("19.761677"),
        Decimal("28.000000"),
        more.pop("tight", True),
        counts,
        more.pop("narrowing", NARROWING),
    )
    if counts == "withhold":
        more |= {"status": "incomplete", "score": None, "ledger": None}
    return replace(closed, interval=interval, **more)


def seen(page: str) -> str:
    without = re.sub(r"<(script|style).*?</\1>", " ", page, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", " ", without)).split())


def test_the_page_says_both_ends_which_counts_and_what_would_narrow_them(closed: Result) -> None:
    result = opened(closed)
    page = trial_page(result, as_json(result))
    words = seen(page)

    assert (
        f"The score lies between 19.761677 and 28; the lower end counts (open because of {GAPS} and two other"
        in words
    )
    assert "open: 19.761677 to 28 , the lower end counts" in words
    # 19.761677 and 28 of a scale from 0 to the 36 that were possible.
    left, width = re.search(r'<span class="open" style="left:([\d.]+)%;width:([\d.]+)%"', page).groups()  # type: ignore[union-attr]
    assert float(left) == pytest.approx(100 * 19.761677 / 36, abs=1e-3)
    assert float(width) == pytest.approx(100 * (28 - 19.761677) / 36, abs=2e-3)
    causes = words[words.index("What would narrow it") :]
    assert causes.index(GAPS) < causes.index("the pose of <b>a part</b>") < causes.index("contents unknown")
    assert "6.24" in causes
    assert "not known" in causes
    assert "<b>a part</b>" not in page.partition("<script")[0]


@pytest.mark.parametrize(
    ("counts", "tight", "said"),
    [
        ("best", True, "between 19.761677 and 28; the upper end counts"),
        ("withhold", True, "between 19.761677 and 28; neither counts until that is decided"),
        ("worst", False, "somewhere between 19.761677 and 28; the lower end counts"),
    ],
)
def test_the_text_says_which_end_counts_and_whether_a_world_reaches_it(
    closed: Result, counts: str, tight: bool, said: str
) -> None:
    assert f"the score lies {said}\n" in score_text(opened(closed, counts, tight=tight))


def test_a_withheld_score_shows_its_ends_instead_of_a_number(closed: Result) -> None:
    result = opened(closed, "withhold")
    page = trial_page(result, as_json(result))

    assert "19.761677 to 28 points; withheld until what is open is decided" in seen(page)


def test_what_samples_alone_would_decide_is_told_as_that(closed: Result) -> None:
    """Under `open: withhold`: "undecided: never nearer than 4.502 m" would read as decided."""
    (key,) = (k for k, f in closed.measured.findings.items() if f.message.startswith("never nearer than"))
    seen_only = Assumption(key, "human_contact", "withhold", closed.measured.findings[key].message)
    result = opened(closed, "withhold", assumptions=(seen_only,))

    said = "the log does not show everything; by its samples never nearer than 4.502 m, at 20.000 s"
    assert undecided_text(result, seen_only) == said
    # Why there is no score says first what would narrow it most.
    assert f'message="undecided: {GAPS}, and 2 more"' in exported(result, "junit")
    nothing = replace(result, interval=None)
    assert f"undecided: robot/human: {said}" in exported(nothing, "junit")
    # Of what is undecided by its samples as well, its own words say why.
    undecided = replace(closed.measured.findings[key], verdict=Verdict.INCONCLUSIVE)
    findings = {**closed.measured.findings, key: undecided}
    result = replace(result, measured=replace(closed.measured, findings=findings))
    assert undecided_text(result, seen_only) == "never nearer than 4.502 m, at 20.000 s"


@pytest.mark.parametrize(
    ("of_robot", "said"),
    [
        (
            (Setting("bounds.robot.max_speed_m_s", 5.0, "m/s", "default", source="our choice"),),
            "a human at most 1.6 m/s (walks), a robot at most 5 m/s, by our defaults, "
            "whatever the acceleration; state what is so under 'bounds:' of the log map or the rule set",
        ),
        (
            (Setting("bounds.robot.max_speed_m_s", 0.25, "m/s", "log_map", source="its rail"),),
            "a human at most 1.6 m/s (walks), a robot at most 0.25 m/s (its rail), "
            "whatever the acceleration; state what is so under 'bounds:' of the log map or the rule set",
        ),
        (
            (
                Setting("bounds.robot.max_speed_m_s", 0.25, "m/s", "log_map", source="its rail"),
                Setting("bounds.robot.max_acceleration_m_s2", 1.0, "m/s2", "log_map", source="its rail"),
            ),
            "a human at most 1.6 m/s (walks), a robot at most 0.25 m/s (its rail)",
        ),
    ],
)
def test_how_fast_bodies_are_taken_to_be_stands_below_what_would_narrow_a_score(
    closed: Result, of_robot: tuple[Setting, ...], said: str
) -> None:
    of_human = Setting("bounds.human.max_speed_m_s", 1.6, "m/s", "rule_set", source="walks")
    hand = Setting("bounds.human.max_acceleration_m_s2", 3.0, "m/s2", "rule_set", source="walks")
    settings = {"separation": Settings("ISO", (of_human, hand)), "contact": Settings("ISO", of_robot)}
    filled = (OpenFindings("separation", "robot/human"), OpenFindings("contact", "robot/human"))
    measured = replace(closed.measured, settings=settings, open=filled)

    assert f"\n  between samples: {said}\n" in score_text(opened(replace(closed, measured=measured)))
    nothing_filled = replace(closed, measured=replace(measured, open=()))
    assert "between samples" not in score_text(opened(nothing_filled))


def test_violations_that_differ_in_their_moment_alone_are_told_once_with_what_they_cost_in_all(
    tmp_path: Path,
) -> None:
    """A pause lasts a second: in the 7.84 s in which a violation may have been, seven more have room."""
    own = tmp_path / "own.yaml"
    own.write_text(
        "extends: paper2020.published\nid: own\ntitle: Own\nsource: a test\nbetween_samples: bounded\n"
        "bounds:\n"
        "  human: {max_speed_m_s: 1.6, source: a test}\n"
        "  robot: {max_speed_m_s: 1.0, source: a test}\n",
        encoding="utf-8",
    )
    result = score_trial(EXAMPLES / "kitting_near_miss.mcap", own)
    text = score_text(result)

    assert len([key for key in result.measured.in_all_worlds if key.startswith("separation#worst")]) == 8
    assert text.count("may have ended and begun again") == 1
    (row,) = re.findall(r"^ +separation 7 times: .* (-[\d.]+)$", text, re.MULTILINE)
    (each,) = re.findall(
        r"^  separation 7 times +.* 16.08 s to 22.08 s: .* \((-[\d.]+) each\)$", text, re.MULTILINE
    )
    assert Decimal(row) == 7 * Decimal(each)


def test_two_violations_that_say_the_same_are_told_one_by_one() -> None:
    assert told_once(["a1", "b1", "a2"], lambda row: row[0]) == [["a1"], ["b1"], ["a2"]]
    assert told_once(["a1", "b1", "a2", "a3"], lambda row: row[0]) == [["a1", "a2", "a3"], ["b1"]]


def test_every_export_has_both_ends_beside_the_one_that_counts(closed: Result) -> None:
    result = opened(closed)
    ends = {"score": 19.761677, "score_least": 19.761677, "score_most": 28.0}

    first = json.loads(exported(result, "jsonl").splitlines()[0])
    assert {name: first[name] for name in ends} == ends
    assert first["narrowing"][0] == f"would narrow the score: {GAPS}: at most 6.238323 points"
    row = next(DictReader(exported(result, "csv").splitlines()))
    assert {name: float(row[name]) for name in ends} == ends
    junit = {
        one.get("name"): one.get("value")
        for one in fromstring(exported(result, "junit")).iter("property")  # noqa: S314  # our own
    }
    assert {name: float(junit[name] or "") for name in ends} == ends
    sarif = json.loads(exported(result, "sarif"))["runs"][0]
    assert {name: sarif["properties"][name] for name in ends} == ends
    for name in ("markdown", "github"):
        text = exported(result, name).replace("\\", "")
        assert "score 19.761677 of 36 possible, open between 19.761677 and 28 (the lower end counts)" in text
        assert GAPS in text
    assert "(open: 19.761677 to 28)" in result._repr_html_()


def test_a_score_with_nothing_open_says_nothing_of_ends(closed: Result) -> None:
    page = trial_page(closed, as_json(closed))

    assert 'id="open"' not in page
    assert 'class="open"' not in page
    assert "lies between" not in score_text(closed)
    for name in ("junit", "sarif", "markdown", "github"):
        assert "score_least" not in exported(closed, name)
        assert " open between " not in exported(closed, name)
