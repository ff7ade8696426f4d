"""The rulebook of a rule set: what a referee reads, from every shipped set and from hostile ones."""

from __future__ import annotations

import html
import json
import re
from pathlib import Path

import pytest

from ariac_score.cli import main
from ariac_score.report.html.rulebook import drawing_of, rulebook_page
from ariac_score.report.rulebook import rulebook_markdown, rulebook_text
from ariac_score.report.rulebooks import names_of, rulebooks
from ariac_score.review.rulebook.blocks import Curve, Grid, Rulebook, Section
from ariac_score.review.rulebook.book import rulebook
from ariac_score.scoring.ruleset import rule_set_from_text

DOCS = Path(__file__).parents[2] / "docs/rulebooks"
HOSTILE = "</title><script>alert(1)</script>|`<img src=x onerror=alert(1)>` [x](javascript:1) \x1b[31m"


def book_of(text: str) -> Rulebook:
    return rulebook(rule_set_from_text(text, file="rules.yaml"))


def section(book: Rulebook, title: str) -> Section:
    return next(each for each in book.sections if each.title == title)


def grid(book: Rulebook, title: str, caption: str = "") -> Grid:
    blocks = section(book, title).blocks
    return next(block for block in blocks if isinstance(block, Grid) and caption in block.caption)


@pytest.fixture(scope="module")
def paper() -> Rulebook:
    return rulebook("paper2020.published")


@pytest.fixture(scope="module")
def edition() -> Rulebook:
    return rulebook("ariac2024.as_documented")


@pytest.mark.slow
def test_a_page_of_the_documentation_is_current(paper: Rulebook) -> None:
    """When this fails: python -m ariac_score.report.rulebooks docs/rulebooks."""
    assert (DOCS / "paper2020.published.md").read_text(encoding="utf-8") == rulebook_markdown(paper)


@pytest.mark.slow
def test_all_pages_of_the_documentation_are_current(subtests: pytest.Subtests) -> None:
    """When this fails: python -m ariac_score.report.rulebooks docs/rulebooks."""
    for name, text in rulebooks("ariac-score"):
        with subtests.test(name):
            assert (DOCS / name).read_text(encoding="utf-8") == text


def test_there_is_a_page_for_each_rule_set() -> None:
    assert {page.stem for page in DOCS.glob("*.md")} == {*names_of("ariac-score"), "README"}


@pytest.mark.slow
def test_the_table_of_an_edition_has_the_points_of_its_official_page(edition: Rulebook) -> None:
    # ARIAC_docs 2024, scoring page: 3 for a part as ordered, 2 in the wrong colour; 5 and 4 when combined.
    rows = {row[0]: row[2:] for row in grid(edition, "What earns points", "In quadrant").rows}
    slots = {row[0]: row[2:] for row in grid(edition, "What earns points", "Slot").rows}

    assert rows == {
        "another type, flipped, or faulty": ("0",),
        "as ordered": ("3",),
        "the wrong colour": ("2",),
    }
    assert slots["as ordered"] == ("3", "5")
    assert slots["the wrong colour and not in its pose"] == ("1", "3")


def test_numbers_are_told_apart_by_what_more_of_them_does_to_a_score(edition: Rulebook) -> None:
    earned = {(row[0], row[3]) for row in grid(edition, "What earns points", "What it is worth").rows}
    costs = {(row[0], row[3]) for row in grid(edition, "What costs points", "Prices of mistakes").rows}

    assert {("Bonus", "kitting"), ("Right tray", "kitting"), ("Priority factor", "")} <= earned
    assert {("Wrong tray", "kitting"), ("Extra part", "kitting"), ("Wrong pose", "combined")} <= costs
    assert not earned & costs


def test_a_price_that_no_made_trial_meets_is_not_lost() -> None:
    book = rulebook("ariac2025.as_coded")

    met = [row[0] for row in grid(book, "What earns points", "What it is worth").rows]
    unmet = [row[:2] for row in grid(book, "What earns points", "no made trial meets").rows]
    assert "Kits weight" in met
    assert ("Time weight", "1000 points") in unmet


def test_a_mistake_costs_what_the_official_page_says(edition: Rulebook) -> None:
    # Three parts: 9, tray 1, bonus 3. A wrong colour: one point and the bonus. The wrong tray: two points.
    rows = grid(edition, "What costs points", "“kitting”").rows
    cost = {row[0].split("”")[0].strip("“"): row[1:] for row in rows}

    assert cost["quadrant colour"] == ("9", "\u22124")
    assert cost["right tray"] == ("11", "\u22122")
    assert cost["submitted"] == ("0", "\u221213")


def test_a_violation_costs_what_the_formula_of_the_paper_gives(paper: Rulebook) -> None:
    # 12 / (1 + 0.4 (1 + t / 5)) for one violation of t s at full depth.
    (curve,) = (
        b
        for b in section(paper, "What costs points").blocks
        if isinstance(b, Curve) and not b.steps and "separation" in b.title
    )

    expected = [12 / (1 + 0.4 * (1 + t / 5)) for t in curve.x[1:]]
    assert curve.score == pytest.approx([12, *expected])


def test_a_violation_that_its_monitor_calls_critical_is_priced_as_one(paper: Rulebook) -> None:
    rows = {row[0]: row[1] for row in grid(paper, "What costs points", "What violations take").rows}

    assert rows["“human contact”"] == "\u221212"


def test_the_last_line_of_a_worked_example_follows_from_those_above(paper: Rulebook) -> None:
    # One of three parts not in its place: 3 + 3 + 2 and the bonus 3; one breach of 3 s: 0.4 (1 + 3 / 5).
    *_, demerits, score = grid(paper, "Worked examples").rows

    assert demerits[2:] == ("0.4 \N{MULTIPLICATION SIGN} 1.6", "0.64")
    assert score[3] == f"{11 / 1.64:.6g}"


def test_formulas_are_said_in_words(paper: Rulebook) -> None:
    said = {(row[0], row[1]): row[2] for row in grid(paper, "How the score is made").rows}

    assert said["Colour", "each shipment"] == (
        "1 point [right colour] \N{MULTIPLICATION SIGN} the number of times that “part colour” is kept"
    )
    assert said["Weight", "each order"] == "1 if “index” of the order is 0; otherwise 3 [later order factor]"


def test_an_example_has_as_much_work_as_its_competition_and_nothing_wrong_that_is_counted() -> None:
    """By the scoring page of the AI for Industry Challenge: one connection."""
    text = (DOCS / "aic2026.qualification.md").read_text(encoding="utf-8")

    worth = 1 + 75 + 12 * (60 - 30) / (60 - 5) + 6 + 6 * (1 - 1 / 50)
    assert f"One mistake in a made task with 1 connection that is worth {worth:.6g} when all is right" in text
    assert "right port 1, within reach 1 m, wrong port 0" in text
    # A flag is asked for as people say it.
    assert "if an event says that the plug is in its port; \N{MINUS SIGN}12 points" in text
    assert "measures is not 0" not in text


def test_a_law_that_the_file_owns_up_to_is_never_said_to_hold(paper: Rulebook) -> None:
    laws = {row[0]: row[1:] for row in grid(paper, "Laws").rows}

    assert laws["More task points never hurt"][0] == "proven"
    verdict, because = laws["Splitting a violation by a gap shorter than t_off changes nothing"]
    assert verdict in ("does not hold", "does not always hold")
    assert "leaves out a pause" in because


@pytest.mark.slow
def test_differences_to_the_official_text_are_its_own_section() -> None:
    book = rulebook("ariac2024.release_5")

    assert any(
        "the wrong tray costs nothing" in str(block).lower()
        for block in section(book, "Where it differs from the official text").blocks
    )
    assert "DIFF" not in rulebook_text(book)


HOSTILE_RULES = f"""
id: hostile
title: {json.dumps(HOSTILE)}
source: {json.dumps(HOSTILE)}
notes: [{json.dumps(HOSTILE)}]
parameters:
  price: {{value: 2, unit: "<b>", meaning: {json.dumps(HOSTILE)}}}
log_map: ariac2020
monitors:
  bump: {{use: ariac.no_event, with: {{kind: "<i>bump"}}}}
score: 10 - price * count(bump)
"""


def test_hostile_text_is_shown_as_text() -> None:
    book = book_of(HOSTILE_RULES)
    page, markdown, text = rulebook_page(book), rulebook_markdown(book), rulebook_text(book)

    assert "<script>alert" not in page
    assert "<img" not in page
    assert "default-src 'none'; script-src 'none'" in html.unescape(page)
    assert "\x1b" not in page + markdown + text
    outside = re.sub(r"`[^`]*`", "", markdown)
    assert not re.search(r"(?<!\\)<", outside)
    assert not re.search(r"(?<!\\)\]\(", outside)


def test_rules_that_only_watch_have_a_rulebook() -> None:
    book = book_of(
        "{id: watch, title: Watch, source: ours, log_map: ariac2020, round: 2, "
        "monitors: {bump: {use: ariac.no_event, with: {kind: bump}}}, score: 10 - 2 * count(bump)}"
    )

    (row,) = grid(book, "What costs points", "What violations take").rows
    assert row == ("“bump”", "\u22122", "\u22124", "")
    assert "What earns points" not in {each.title for each in book.sections}


def test_rules_without_safety_have_a_rulebook() -> None:
    titles = {each.title: each for each in rulebook("ariac2019.as_coded").sections}

    assert not any(
        isinstance(block, Curve)
        for block in titles["What costs points"].blocks
        if "collision" not in str(block)
    )


def test_a_curve_begins_and_ends_at_the_edges_of_its_field() -> None:
    drawing = drawing_of(Curve("x", "seconds", (0.0, 5.0, 10.0), (10.0, 5.0, 0.0)))

    assert drawing.line == "M0 0L320 100L640 200"
    assert drawing.up[0] == (200.0, "0")


def test_a_score_below_zero_lies_below_its_zero_line() -> None:
    drawing = drawing_of(Curve("x", "violations", (0.0, 1.0), (10.0, -10.0), steps=True))

    assert drawing.line == "M0 0H640V200"
    assert drawing.area.endswith("V100H0z")


@pytest.mark.slow
def test_the_command_writes_a_page_or_markdown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page, markdown = tmp_path / "book.html", tmp_path / "book.md"

    assert main(["rules", "show", "paper2020.published", "--as", "rulebook", "-o", str(page)]) == 0
    assert main(["rules", "show", "paper2020.published", "--as", "rulebook", "-o", str(markdown)]) == 0
    assert page.read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert markdown.read_text(encoding="utf-8") == (DOCS / "paper2020.published.md").read_text(
        encoding="utf-8"
    )
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("arguments", "cause"),
    [
        (["paper2020.published", "--as", "rulebook", "-o", "book.pdf"], "a page or Markdown"),
        (["paper2020.published", "-o", "book.html"], "add --as rulebook"),
        (["paper2021", "--as", "rulebook"], "there is no rule set 'paper2021'"),
    ],
)
def test_what_cannot_be_made_is_refused_in_words(
    arguments: list[str],
    cause: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)

    assert main(["rules", "show", *arguments]) == 4
    assert cause in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_code_beside_a_rule_set_runs_only_where_that_is_allowed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "ours.py").write_text("raise SystemExit('run')", encoding="utf-8")
    rules = tmp_path / "rules.yaml"
    rules.write_text(
        "{id: ours, title: Ours, source: us, log_map: ariac2020, "
        "monitors: {near: {use: './ours.py:Near'}}, score: 10 - count(near)}",
        encoding="utf-8",
    )

    assert main(["rules", "show", str(rules), "--as", "rulebook"]) == 4
    assert "the caller does not allow that" in capsys.readouterr().err


def test_every_setting_of_a_shipped_rulebook_has_a_meaning() -> None:
    for page in DOCS.glob("*.md"):  # which another test holds against what is made now
        _, _, table = page.read_text(encoding="utf-8").partition("**Settings of the checks**\n\n")
        for row in table.partition("\n\n")[0].splitlines()[2:]:
            _, setting, _, meaning, _ = (cell.strip() for cell in row.strip("|").split(" | "))
            assert meaning, (page.name, setting)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper2020.published", "ariac2024.as_documented", "ariac2022.as_coded"])
def test_every_line_of_a_worked_example_says_where_its_number_comes_from(name: str) -> None:
    examples = section(rulebook(name), "Worked examples").blocks
    rows = [row for block in examples if isinstance(block, Grid) for row in block.rows]

    assert rows
    assert [row for row in rows if not row[2]] == []
