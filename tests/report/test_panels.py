"""Panels and formats of distributions: shown, escaped, refused; one that fails says so, and others stand."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import pytest

from ariac_score import Result, as_json, load_result
from ariac_score.checks.registry import Registry
from ariac_score.cli import main
from ariac_score.errors import PluginConflictError, PluginError
from ariac_score.report.exports import export_names, exported
from ariac_score.report.html.panels import panels_of
from ariac_score.report.html.trial import embedded_result, trial_page
from ariac_score.results.result import Code

Install = Callable[..., str]
EXAMPLE = Path(__file__).parents[2] / "tests/data/as_published/kitting_near_miss.result.json"
PANELS, EXPORTS = "ariac_score.report_panels", "ariac_score.exports"

SOURCE = """\
from ariac_score import ReportPanel

COURSE = ReportPanel(
    "The course",
    lambda result: {"team": result.measured.team, "laps": [1.5, 2.0]},
    "<p>Team <bdi>{{ data.team }}</bdi></p>"
    "<ul>{% for lap in data.laps %}<li>{{ lap|seconds }}</li>{% endfor %}</ul>",
)
"""


@cache
def example() -> Result:
    return load_result(EXAMPLE)


def by(*distributions: str, team: str = "") -> Result:
    """The example as if further distributions had taken part in it."""
    result = example()
    code = [Code(name, "1.0", "stranger", "0" * 64) for name in distributions]
    provenance = replace(result.provenance, code=tuple(sorted([*result.provenance.code, *code])))
    return replace(result, provenance=provenance, measured=replace(result.measured, team=team or "reds"))


def page(result: Result) -> str:
    return trial_page(result, as_json(result))


def section(text: str, name: str) -> str:
    found = re.search(rf'<section class="panel" id="p-{name}[^"]*".*?</section>', text, re.DOTALL)
    assert found is not None
    return found[0]


def panel(install: Install, body: str, distribution: str = "course-score") -> None:
    source = f"from ariac_score import ReportPanel\n{body}\n"
    install(distribution, {distribution.partition("-")[0]: "P"}, source=source, group=PANELS)


# Panels ---------------------------------------------------------------------------------


def test_a_panel_shows_its_data_under_its_heading(install: Install) -> None:
    install("course-score", {"course": "COURSE"}, source=SOURCE, group=PANELS)

    text = page(by("course-score"))

    shown = section(text, "course")
    assert "The course</bdi></h2>" in shown
    assert "<p>Team <bdi>reds</bdi></p>" in shown
    assert "<li>1.50\u202fs</li>" in shown
    assert re.search(r'<a href="#p-course[^"]*"><bdi>The course</bdi></a>', text)
    assert embedded_result(text) == as_json(by("course-score"))


def test_pages_of_results_that_its_distribution_took_no_part_in_stay_the_same_bytes(install: Install) -> None:
    before = page(example())
    install("course-score", {"course": "COURSE"}, source=SOURCE, group=PANELS)

    assert page(example()) == before


def test_a_panel_with_nothing_to_say_is_not_there(install: Install) -> None:
    panel(install, 'P = ReportPanel("The course", lambda result: None, "")')

    assert "The course" not in page(by("course-score"))


@pytest.mark.parametrize(
    "hostile", ["<script>alert(1)</script>", '"><b onclick=x>', "</section><p>", "{{ 7 * 7 }}"]
)
def test_what_a_log_can_name_is_escaped_in_a_panel(install: Install, hostile: str) -> None:
    install("course-score", {"course": "COURSE"}, source=SOURCE, group=PANELS)

    class Texts(HTMLParser):
        def __init__(self, text: str) -> None:
            super().__init__()
            self.texts: list[str] = []
            self.feed(text)

        def handle_data(self, data: str) -> None:
            self.texts.append(data)

    shown = section(page(by("course-score", team=hostile)), "course")
    assert hostile in Texts(shown).texts


def test_a_text_that_declares_itself_safe_is_escaped_all_the_same(install: Install) -> None:
    source = 'P = ReportPanel("C", lambda r: [Markup("<b>x</b>")], "{{ data[0] }}")'
    panel(install, f"from markupsafe import Markup\n{source}")

    assert "&lt;b&gt;x&lt;/b&gt;" in section(page(by("course-score")), "course")


def test_a_number_that_brings_html_of_its_own_is_the_plain_number(install: Install) -> None:
    body = "class I(int):\n    __html__ = lambda self: '<b>x</b>'\n"
    panel(install, body + 'P = ReportPanel("C", lambda r: [I(3)], "<p>{{ data[0] }}</p>")')

    assert "<p>3</p>" in section(page(by("course-score")), "course")


def test_a_panel_may_draw_and_lead_to_a_place_on_the_page(install: Install) -> None:
    drawn = '<svg viewBox="0 0 9 9"><path d="M0 0"/></svg><a href="#ledger">why</a>'
    panel(install, f"P = ReportPanel('C', lambda r: 1, '{drawn}')")

    assert drawn in section(page(by("course-score")), "course")


@pytest.mark.parametrize(
    ("body", "cause"),
    [
        ('P = ReportPanel("C", lambda r: 1 / 0, "")', "raised ZeroDivisionError"),
        ("import sys\nP = ReportPanel('C', lambda r: sys.exit(3), '')", "raised SystemExit"),
        ('P = ReportPanel("C", lambda r: {"a": object()}, "")', "its data hold a object"),
        ('P = ReportPanel("C", lambda r: {"a": 1}, "{{ data.b }}")', "UndefinedError"),
        ('P = ReportPanel("C", lambda r: {"a": 1}, "{% for %}")', "TemplateSyntaxError"),
        ('P = ReportPanel("C", lambda r: 1, "{{ data|safe }}")', "No filter named &#39;safe&#39;"),
        (
            "P = ReportPanel('C', lambda r: 1, '{% autoescape false %}{{ data }}{% endautoescape %}')",
            "autoescape",
        ),
        ("P = ReportPanel('C', lambda r: 1, '{% include \"base.html.j2\" %}')", "raised"),
        ('P = ReportPanel("C", lambda r: 1, "<script>1</script>")', "&lt;script&gt; may not stand"),
        ('P = ReportPanel("C", lambda r: 1, "<p onclick=x>1</p>")', "a panel has none of its own"),
        ('P = ReportPanel("C", lambda r: 1, "<iframe src=x></iframe>")', "&lt;iframe&gt; may not stand"),
        ("P = ReportPanel('C', lambda r: 1, '{{ range.__globals__ }}')", "SecurityError"),
        ("P = ReportPanel('C', lambda r: 'x', '{{ (data|e).__class__(\\'<b>\\') }}')", "SecurityError"),
        ("P = ReportPanel('C', lambda r: 1, '{{ lipsum() }}')", "&#39;lipsum&#39; is undefined"),
        ("P = ReportPanel('C', lambda r: 1, '{{ cycler }}')", "&#39;cycler&#39; is undefined"),
        ("P = ReportPanel('C', lambda r: 1, '{% for i in range(10**6) %}x{% endfor %}')", "Range too big"),
        ('P = ReportPanel("C", lambda r: 1, "<!--><img src=x>-->")', "no comments"),
        ('P = ReportPanel("C", lambda r: 1, "<plaintext></plaintext>")', "&lt;plaintext&gt; may not stand"),
        ('P = ReportPanel("C", lambda r: 1, "<noscript></noscript>")', "&lt;noscript&gt; may not stand"),
        ('P = ReportPanel("C", lambda r: 1, "<img src=http://x/y.png>")', "&lt;img&gt; may not stand"),
        ("P = ReportPanel('C', lambda r: 1, '<a href=javascript:alert(1)>x</a>')", "a place on the page"),
        ("P = ReportPanel('C', lambda r: 1, '<div style=position:fixed>x</div>')", "&#39;style&#39; may not"),
        ("P = ReportPanel('C', lambda r: 1, '<svg><path fill=url(http://x)></path></svg>')", "would load"),
        ('P = ReportPanel("C", lambda r: 1, "<div><p>1</p>")', "&lt;div&gt; is not closed"),
        ('P = ReportPanel("C", lambda r: 1, "</section>")', "closes nothing"),
        ('P = ReportPanel("C", lambda r: 1, "<p>1</p></div>")', "closes nothing"),
        ('P = ReportPanel("C", lambda r: 1, "x" * 500001)', "more than 500000"),
        ("P = 3", "is a int, not a ReportPanel"),
        ("raise RuntimeError('no licence')", "RuntimeError: no licence"),
    ],
)
def test_a_panel_that_fails_says_so_on_the_page_and_all_others_stand(
    install: Install, body: str, cause: str
) -> None:
    panel(install, body, "bad-score")
    install("course-score", {"course": "COURSE"}, source=SOURCE, group=PANELS)

    text = page(by("bad-score", "course-score"))

    failed = section(text, "bad")
    assert "This panel cannot be shown" in failed
    assert cause in failed
    assert "bad-score 1.0" in failed
    assert "<bdi>reds</bdi>" in section(text, "course")
    # The rest of the page is that of the result without the one that failed.
    assert text.replace(failed, "").count("<section") == text.count("<section") - 1
    assert text.count("<script") == page(by("course-score")).count("<script")


def test_two_distributions_with_one_panel_name_are_both_named_in_its_place(install: Install) -> None:
    for distribution in ("course-score", "foul-score"):
        install(distribution, {"course": "COURSE"}, source=SOURCE, group=PANELS)

    (shown,) = panels_of(by("course-score"))
    assert "course-score 1.0 and foul-score 1.0" in shown.fault


def test_what_a_panel_prints_is_held_back(install: Install, capfd: pytest.CaptureFixture[str]) -> None:
    panel(install, 'P = ReportPanel("C", lambda r: print("hello") or 1, "<p>{{ data }}</p>")')

    assert "<p>1</p>" in page(by("course-score"))
    assert capfd.readouterr().out == ""


def test_the_command_writes_the_panel_into_the_page(install: Install, tmp_path: Path) -> None:
    install("course-score", {"course": "COURSE"}, source=SOURCE, group=PANELS)
    (tmp_path / "r.json").write_text(as_json(by("course-score")), encoding="utf-8")

    assert main(["report", str(tmp_path / "r.json"), "-o", str(tmp_path / "page.html")]) == 0
    assert "The course" in (tmp_path / "page.html").read_text(encoding="utf-8")


# Exports --------------------------------------------------------------------------------


def test_a_format_of_a_distribution_is_a_choice_like_ours(
    install: Install, capsys: pytest.CaptureFixture[str]
) -> None:
    source = 'def latex(result): return f"\\\\score{{{result.score}}}\\n"'
    install("tex-score", {"latex": "latex"}, source=source, group=EXPORTS)

    assert main(["export", str(EXAMPLE), "--output-format", "latex"]) == 0
    assert capsys.readouterr().out == "\\score{19.761677}\n"
    assert {"junit", "sarif", "github", "markdown", "csv", "jsonl", "latex"} == set(export_names())


@pytest.mark.parametrize(
    ("source", "cause"),
    [
        ("def latex(result): return 1 / 0", "raised ZeroDivisionError"),
        ("def latex(result): return b''", "gives a bytes instead of a text"),
        ("latex = 3", "is a int, not a Callable"),
        ("raise RuntimeError('no licence')", "RuntimeError: no licence"),
    ],
)
def test_a_format_that_fails_is_named_and_gives_nothing(
    install: Install, capsys: pytest.CaptureFixture[str], source: str, cause: str
) -> None:
    install("tex-score", {"latex": "latex"}, source=source, group=EXPORTS)

    assert main(["export", str(EXAMPLE), "--output-format", "latex"]) == 3
    out, err = capsys.readouterr()
    assert out == ""
    assert cause in err
    assert "latex (tex-score 1.0)" in err
    with pytest.raises(PluginError):
        exported(example(), "latex", Registry())


def test_a_format_of_ours_that_another_distribution_brings_too_is_refused(install: Install) -> None:
    install("foul-score", {"csv": "f"}, source="def f(result): return ''", group=EXPORTS)

    with pytest.raises(PluginConflictError, match=r"'csv' is provided by ariac-score .* and foul-score"):
        exported(example(), "csv")
    assert exported(example(), "junit")
