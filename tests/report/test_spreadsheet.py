"""Text in cells: what a spreadsheet would run is shown as text, all else stays as it is."""

from __future__ import annotations

import pytest

from ariac_score.report.spreadsheet import text_cell


@pytest.mark.parametrize(
    "text",
    ["=1+1", "+1", "-1", "@sum", "|calc", "%0", "\t=1", "\r=1", "\n=1", " =1", "\u00a0=1", "\ufeff=1"],
)
def test_what_begins_like_a_formula_or_command_gets_an_apostrophe(text: str) -> None:
    assert text_cell(text) == f"'{text}"


@pytest.mark.parametrize("sign", ["\uff1d", "\uff0b", "\uff0d", "\uff20"])
def test_full_width_signs_begin_a_formula_too(sign: str) -> None:
    assert text_cell(f"{sign}1") == f"'{sign}1"


@pytest.mark.parametrize("text", ["", " ", "alpha", "1=1", "a-b", "'=1", "10 %", "team@home"])
def test_other_text_stays_as_it_is(text: str) -> None:
    assert text_cell(text) == text
