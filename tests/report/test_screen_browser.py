"""The screen in a real browser: what comes is drawn, nobody else is asked, keys walk a wall."""

from __future__ import annotations

import asyncio
import json
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from ariac_score.live.running import Instant, Place, Running
from ariac_score.report.screen.server import Screen
from ariac_score.report.screen.state import Showing
from ariac_score.serving.guard import Guard, listening

pytestmark = pytest.mark.slow  # a browser

Show = Callable[..., None]


@pytest.fixture
def served() -> Iterator[tuple[int, Show]]:
    """Two cells on a screen: its port, and what shows a state of one of them."""
    listener = listening("127.0.0.1", 0)
    port = int(listener.getsockname()[1])
    begun, held = threading.Event(), list[tuple[asyncio.AbstractEventLoop, asyncio.Event, Screen]]()

    async def serve() -> None:
        screen, over = Screen(("north", "south"), Guard(), port), asyncio.Event()
        server = await screen.serve(listener)
        held.append((asyncio.get_running_loop(), over, screen))
        begun.set()
        await over.wait()
        server.close()
        screen.close()

    thread = threading.Thread(target=lambda: asyncio.run(serve()), daemon=True)
    thread.start()
    assert begun.wait(10)
    ((loop, over, screen),) = held
    showings = {name: Showing(name, "made:") for name in ("north", "south")}

    def show(name: str, **values: Any) -> None:
        running = Running("made:", **values)
        showings[name].note(running)
        state = json.dumps(showings[name].of(running)).encode()
        loop.call_soon_threadsafe(screen.show, state)

    yield port, show
    loop.call_soon_threadsafe(over.set)
    thread.join(10)


def test_a_wall_shows_what_comes_and_is_walked_by_keyboard(browser: Any, served: tuple[int, Show]) -> None:
    port, show = served
    asked: list[str] = []
    complaints: list[str] = []
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: complaints.append(message.text))
    page.on("pageerror", lambda error: complaints.append(str(error)))
    try:
        page.goto(f"http://127.0.0.1:{port}/")
        places = (Place("robot", "robot", 1.0, 2.0), Place("<b>human", "human", 1.0, 4.0))
        near = Instant("separation", "robot/<b>human", "distance", 5.0, 2.0, 2.5, "m")
        show("north", elapsed_s=5.0, now=(near,), places=places)
        page.wait_for_selector("[data-cell=north] .said.bad", timeout=20_000)
        assert "by 0.50\u00a0m" in page.inner_text("[data-cell=north] .said")
        assert "waiting" in str(page.get_attribute("[data-cell=south]", "class"))

        page.keyboard.press("1")
        page.wait_for_selector("[data-cell=north].full", timeout=5_000)
        assert not page.is_visible("[data-cell=south]")
        # The ring of 2.5 m reaches the human, who is 2 m away.
        assert float(page.get_attribute("circle.zone.broken", "r")) == pytest.approx(250.0)
        assert page.locator("[data-cell=north] .floor text").all_text_contents() == ["robot", "<b>human"]
        page.keyboard.press("Escape")
        page.wait_for_selector("[data-cell=south]", state="visible", timeout=5_000)

        show("north", elapsed_s=6.0, connected=False)
        page.wait_for_selector("[data-cell=north] .said.open", timeout=20_000)
        assert page.inner_text("[data-cell=north] .link") == "source gone"
        assert "nothing is seen" in page.inner_text("[data-cell=north] .not-seen")
        wide = page.evaluate("document.documentElement.scrollWidth - innerWidth")
        assert wide <= 0
    finally:
        page.close()

    assert complaints == []
    assert {url.split("/")[2] for url in asked if not url.startswith("data:")} == {f"127.0.0.1:{port}"}
