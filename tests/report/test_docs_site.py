"""The pages as a site: built strictly, nothing fetched, searched from a file without a server."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]


def _build(root: Path, out: Path) -> subprocess.CompletedProcess[str]:
    # Not quietly, for then MkDocs counts no warnings either.
    command = ["build", "--strict", "-f", str(root / "docs/site/mkdocs.yml"), "-d", str(out)]
    return subprocess.run(
        [sys.executable, "-m", "mkdocs", *command],
        env={"NO_MKDOCS_2_WARNING": "1", "PATH": ""},
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("material", reason="needs the extra 'docs'")
    out = tmp_path_factory.mktemp("site")
    done = _build(ROOT, out)
    assert done.returncode == 0, done.stdout + done.stderr
    return out


def test_no_page_fetches_anything_from_the_network(site: Path) -> None:
    pages = sorted(site.rglob("*.html"))

    assert len(pages) > 90
    for page in pages:
        html = page.read_text(encoding="utf-8")
        fetched = re.findall(r"<(?:script|img|iframe)[^>]*src=\"?(https?:[^\s\">]+)", html)
        fetched += re.findall(r"<link[^>]*rel=\"?(?:styles|precon)[^>]*href=\"?(https?:[^\s\">]+)", html)
        assert fetched == [], page
    for style in site.rglob("*.css"):
        assert "url(http" not in style.read_text(encoding="utf-8")


def test_the_references_are_made_of_the_code(site: Path) -> None:
    commands = (site / "reference/commands.html").read_text(encoding="utf-8")
    assert "ariac-score platform codabench dry-run" in commands
    assert "<code>--fail-on WHAT</code>" in commands
    assert "measured" in (site / "reference/schemas.html").read_text(encoding="utf-8")
    assert "score_trial" in (site / "reference/python.html").read_text(encoding="utf-8")
    assert (site / "plugins/monitors/iso_ts_15066.ssm_separation.html").is_file()
    assert (site / "schemas/result.schema.json").read_bytes() == (
        ROOT / "schemas/result.schema.json"
    ).read_bytes()


def test_every_link_that_leads_nowhere_is_named_and_fails_the_build(tmp_path: Path) -> None:
    pytest.importorskip("material", reason="needs the extra 'docs'")
    for folder in ("docs", "schemas", "examples"):
        shutil.copytree(ROOT / folder, tmp_path / folder)
    with (tmp_path / "docs/tutorials/team.md").open("a", encoding="utf-8") as page:
        page.write("\n[page](no_such_page.md) [heading](team.md#no-such-heading)\n")
        page.write("[file](../../schemas/no_such.schema.json)\n")

    done = _build(tmp_path, tmp_path / "out")

    assert done.returncode != 0
    for said in ("no_such_page.md", "no-such-heading", "no_such.schema.json"):
        assert said in done.stdout + done.stderr


def test_the_search_finds_pages_without_a_server(site: Path, browser: Any) -> None:
    page = browser.new_page()
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on("request", lambda r: None if r.url.startswith(("file:", "data:")) else faults.append(r.url))
    page.goto((site / "tutorials/author.html").as_uri())

    page.keyboard.press("f")
    page.wait_for_selector("input[name=query]:focus")
    page.keyboard.type("protective separation")
    page.wait_for_selector(".md-search-result__item", state="attached")

    assert page.locator(".md-search-result__item").count() > 3
    assert faults == []
