"""The rulebooks of the guests, in their words."""

from __future__ import annotations

import re

import pytest

from ariac_score.report.rulebook import rulebook_text
from ariac_score.review.rulebook.book import rulebook


@pytest.mark.usefixtures("guests")
@pytest.mark.parametrize("name", ["barn", "carla.2_1", "robocup_work.bmt_2024"])
def test_the_rulebook_of_a_guest_has_none_of_our_words(name: str) -> None:
    text = rulebook_text(rulebook(name))

    assert not re.search(r"\b(ARIAC|kit|kits|shipment|order|tray)\b", text)
    assert "How the score is made" in text
