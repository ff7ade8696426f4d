"""The pages of plugins: kept current, and telling whatever a class says of itself."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from ariac_score.checks.contracts import GROUPS
from ariac_score.checks.registry import Registry
from ariac_score.errors import PluginError
from ariac_score.testing.pages import example_parameters, pages, plugin_page, write_pages

Install = Callable[..., str]

DOCS = Path(__file__).parents[2] / "docs/plugins"
REGISTRY = Registry()


@pytest.mark.slow
def test_the_pages_of_the_documentation_are_current() -> None:
    """When this fails: python -m ariac_score.testing.docs docs/plugins."""
    made = dict(pages("ariac-score"))

    assert {p.relative_to(DOCS).as_posix() for p in DOCS.rglob("*.md")} == set(made)
    for name, text in made.items():
        assert (DOCS / name).read_text(encoding="utf-8") == text, name


def test_every_link_of_the_list_leads_to_a_page() -> None:
    links = re.findall(r"\]\(([^)]+)\)", (DOCS / "README.md").read_text(encoding="utf-8"))

    assert len(links) == sum(len(REGISTRY.names(group)) for group in GROUPS)
    assert all((DOCS / link).is_file() for link in links)


@pytest.mark.slow
def test_a_page_that_nobody_brings_any_more_is_removed(tmp_path: Path) -> None:
    (tmp_path / "rules").mkdir()
    (tmp_path / "rules/kitting.gone.md").write_text("# gone")
    (tmp_path / "notes.md").write_text("mine")

    write_pages(tmp_path)

    assert not (tmp_path / "rules/kitting.gone.md").exists()
    assert (tmp_path / "notes.md").read_text() == "mine"
    assert (tmp_path / "rules/kitting.pose.md").is_file()


def test_a_page_has_what_was_declared_about_parameters() -> None:
    page = plugin_page(REGISTRY.find("ariac_score.monitors", "iso_ts_15066.ssm_separation"))

    assert "| parameter | meaning | type | default | unit | range | status | source |" in page
    declared = "float | 1.6 | m/s | at least 0, at most 20 | verified | "
    assert f"| `human_speed_m_s` | Assumed speed of the human | {declared}" in page
    assert "| `speed` | m/s | 0.05 s | scalar speed" in page
    # The near miss of the example, worked out in ariac_score.testing.trials.
    assert "18.81 s to 21.21 s: too close for 2.40 s" in page


def test_every_check_of_ours_shows_a_decided_finding() -> None:
    """An example in which nothing is decided says nothing about the plugin."""
    found = {
        page.stem: re.findall(r"^(satisfied|violated) ", page.read_text(encoding="utf-8"), re.MULTILINE)
        for folder in ("rules", "monitors")
        for page in sorted((DOCS / folder).glob("*.md"))
    }

    assert len(found) > 50
    assert [name for name, verdicts in found.items() if not verdicts] == []


def test_the_page_of_reported_parts_shows_one_that_was_reported_and_one_that_was_not() -> None:
    # Only the battery is reported in ariac_score.testing.made, at 31 s; the insert is submitted at 33 s.
    lines = (DOCS / "rules/assembly.reported.md").read_text(encoding="utf-8").splitlines()

    assert "satisfied       ABCD1235/ABCD1235/part_0: the battery was reported as assembled" in lines
    assert "violated        ABCD1235/ABCD1235/part_1: the pump was never reported as assembled" in lines


def test_a_page_tells_what_is_needed_from_what_only_helps() -> None:
    contact = plugin_page(REGISTRY.find("ariac_score.monitors", "iso_10218_2.pfl_contact"))
    stops = plugin_page(REGISTRY.find("ariac_score.monitors", "iso_ts_15066.ssm_separation"))

    assert "| `contact_force` | yes | N |" in contact
    assert "| `contact_area` | optional | m2 |" in contact
    assert "| needed |" not in stops


def test_a_page_leaves_out_columns_in_which_nothing_stands() -> None:
    page = plugin_page(REGISTRY.find("ariac_score.rules", "kitting.presence"))

    assert "| parameter | meaning | type | default |\n" in page
    assert "## Needs" not in page


ODD = """
class Plain:
    def judge(self, trial, order):
        yield from ()

class Required:
    '''Needs a limit.

    Measures:
        Nothing.

        In two paragraphs.
    '''

    def __init__(self, limit): ...
    def judge(self, trial, order): ...

class Shown:
    '''Shows itself.'''
    example = {}
    def needs(self): return ()
    def watch(self, trial):
        from ariac_score import Finding
        for k in range(9):
            yield Finding.satisfied("trial", f"number {k}")
        yield Finding.violated("trial", "the one | that tells")
"""


def test_a_class_that_says_nothing_has_a_page_that_says_so(install: Install) -> None:
    install("odd-rules", {"odd.required": "Required"}, source=ODD)
    plugin = Registry().find("ariac_score.rules", "odd.required")

    assert plugin_page(plugin) == (
        "# `odd.required`\n\nNeeds a limit.\n\n## Measures\n\nNothing.\n\nIn two paragraphs.\n"
    )


def test_a_plugin_that_cannot_be_built_is_named(install: Install) -> None:
    install("odd-rules", {"odd.plain": "Plain"}, source=ODD, version="6.6")

    with pytest.raises(PluginError, match=r"odd\.plain \(odd-rules 6\.6\) says nothing"):
        plugin_page(Registry().find("ariac_score.rules", "odd.plain"))


def test_every_verdict_is_shown_before_any_is_shown_twice(install: Install) -> None:
    install("odd-monitors", {"odd.shown": "Shown"}, source=ODD, group="ariac_score.monitors")
    page = plugin_page(Registry().find("ariac_score.monitors", "odd.shown"))

    lines = page.split("```")[1].splitlines()[1:]
    assert len(lines) == 4
    assert sum(line.startswith("violated") for line in lines) == 1


def test_the_example_of_a_class_stands_before_that_of_a_rule_set() -> None:
    def parameters(group: str, name: str) -> dict[str, object]:
        return example_parameters(REGISTRY.find(f"ariac_score.{group}", name))

    assert parameters("monitors", "formula.never")["holds"] == "v > 0.4"
    assert parameters("monitors", "iso_ts_15066.ssm_separation")["profile"] == "seed"
    assert parameters("rules", "run.order") == {}


@pytest.mark.parametrize("name", REGISTRY.names("ariac_score.monitors"))
def test_every_monitor_of_ours_shows_an_example_that_is_decided(name: str) -> None:
    page = (DOCS / f"monitors/{name}.md").read_text(encoding="utf-8")
    shown = page.partition("## Example")[2].split("```")[1]

    assert re.search(r"^(satisfied|violated) ", shown, re.MULTILINE), shown
