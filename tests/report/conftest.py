"""A real browser for the pages, one for all tests; absent, the tests that need it say so."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

REQUIRED = bool(os.environ.get("ARIAC_SCORE_REQUIRE_BROWSER"))
"""Where the tests run before a change lands, a missing browser is a failure."""

_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


def _absent(reason: str) -> None:
    if REQUIRED:
        pytest.fail(f"{reason}, and ARIAC_SCORE_REQUIRE_BROWSER is set")
    pytest.skip(reason)


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    """A headless Chromium, driven by Playwright."""
    try:
        from playwright.sync_api import sync_playwright  # noqa: PLC0415  # optional
    except ImportError:
        _absent("playwright is not installed (pip install '.[browser]')")
    program = os.environ.get("ARIAC_SCORE_CHROMIUM") or next(filter(None, map(shutil.which, _NAMES)), None)
    if program is None:
        _absent("no Chromium is installed (apt-get install chromium, or set ARIAC_SCORE_CHROMIUM)")
    with sync_playwright() as playwright:
        started = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield started
        started.close()


@pytest.fixture(scope="session")
def axe() -> str:
    """The text of axe-core, which finds faults of accessibility."""
    path = os.environ.get("ARIAC_SCORE_AXE", "")
    if not path:
        _absent("axe-core is not here (npm pack axe-core, and set ARIAC_SCORE_AXE to its axe.min.js)")
    return Path(path).read_text(encoding="utf-8")


class Watched:
    """A page, and everything it did that it should not."""

    def __init__(self, browser: Any, file: Path, **options: Any) -> None:
        self.page = browser.new_page(
            **{"viewport": {"width": 1280, "height": 900}, "reduced_motion": "reduce", **options}
        )
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: self.complaints.append(message.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("dialog", lambda dialog: (self.complaints.append(dialog.message), dialog.dismiss()))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(file.as_uri())

    @property
    def elsewhere(self) -> list[str]:
        """What it requested besides files that lie here and what it holds itself."""
        return [url for url in self.requests if not url.startswith(("file:", "data:"))]


@pytest.fixture
def open_page(browser: Any) -> Iterator[Any]:
    """Open a file in the browser; closed when the test is done."""
    opened: list[Watched] = []

    def open_(file: Path, **options: Any) -> Watched:
        opened.append(Watched(browser, file, **options))
        return opened[-1]

    yield open_
    for watched in opened:
        watched.page.close()


@pytest.fixture
def faults_of(axe: str) -> Any:
    """The serious faults of accessibility that axe-core finds on a page, in words."""

    def faults(watched: Watched) -> list[str]:
        watched.page.evaluate(axe)
        found = watched.page.evaluate("async () => (await axe.run()).violations")
        return [
            f"{one['id']}: {node['html'][:200]} ({node['failureSummary']})"
            for one in found
            if one["impact"] in ("serious", "critical")
            for node in one["nodes"][:3]
        ]

    return faults
