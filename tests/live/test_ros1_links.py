"""Which publishers of a ROS 1 cell are heard, as the master names them from one question to the next."""

from __future__ import annotations

import pytest

from ariac_score.live import ros1
from ariac_score.live.ros1 import Ros1Source

KEY = ("/points", "/steady")


class Link:
    """A connection that lives as long as the test says."""

    made: list[Link]

    def __init__(self, *_: object) -> None:
        self.is_alive, self.leaves = False, False
        self.made.append(self)

    def start(self) -> None:
        self.is_alive = True


@pytest.fixture
def links(monkeypatch: pytest.MonkeyPatch) -> list[Link]:
    Link.made = []
    monkeypatch.setattr(ros1, "_Link", Link)
    return Link.made


def test_a_node_that_is_started_again_between_two_questions_is_heard_again(links: list[Link]) -> None:
    source, session = Ros1Source("ros1://127.0.0.1:1"), ros1._Graph()
    source._follow(session, {KEY})
    source._follow(session, set())  # the master drops it while it registers anew
    assert links[0].leaves
    links[0].is_alive = False  # so it ended, in order
    source._follow(session, {KEY})

    assert [one.is_alive for one in links] == [False, True]


def test_a_link_that_still_tries_goes_on_when_its_publisher_is_back(links: list[Link]) -> None:
    source, session = Ros1Source("ros1://127.0.0.1:1"), ros1._Graph()
    for here in ({KEY}, set(), {KEY}):
        source._follow(session, here)

    assert [(one.is_alive, one.leaves) for one in links] == [(True, False)]
