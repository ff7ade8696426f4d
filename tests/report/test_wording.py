"""Text and numbers on a page: hostile text stays text, file names differ, numbers line up."""

from __future__ import annotations

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.report.html.page import embedded_json, page, policy_of
from ariac_score.report.html.wording import amount, brief, file_name, number, seconds, untrusted

SAFE = set("abcdefghijklmnopqrstuvwxyz0123456789_-")


@given(st.text())
def test_a_file_name_is_safe_on_every_system(text: str) -> None:
    name = file_name(text)

    assert set(name) <= SAFE
    assert 0 < len(name) <= 64
    assert name.partition("-")[0] not in {"con", "nul", "prn", "aux"} or "-" in name


@given(st.text(), st.text())
def test_two_texts_never_share_a_file(one: str, other: str) -> None:
    assert (file_name(one) == file_name(other)) == (one == other)


@pytest.mark.parametrize(
    ("one", "other"),
    [("Aurora", "aurora"), ("a/b", "a-b"), ("a" * 90, "a" * 91), ("é", "è"), ("..", "."), ("", "x")],
)
def test_texts_that_look_alike_get_names_of_their_own(one: str, other: str) -> None:
    assert file_name(one).lower() != file_name(other).lower()


def test_nobody_can_choose_the_name_that_is_made_for_another() -> None:
    assert file_name(file_name("Aurora")) != file_name("Aurora")


@pytest.mark.parametrize("name", ["con", "nul", "com1", "lpt9"])
def test_names_that_windows_keeps_for_itself_are_not_used(name: str) -> None:
    assert file_name(name) != name


@given(st.text())
def test_untrusted_text_holds_no_tag_and_steers_no_direction(text: str) -> None:
    shown = str(untrusted(text))

    inside = shown.removeprefix("<bdi>").removesuffix("</bdi>")
    if len(text) <= 20:
        assert "<" not in inside
        assert '"' not in inside
    assert not set("\u202a\u202b\u202d\u202e\u2066\u2067\u2068\u200f\x00\n") & set(shown)


def test_long_text_is_folded_and_still_whole() -> None:
    shown = str(untrusted("x" * 10_000))

    assert shown.startswith("<details")
    assert "x" * 10_000 in shown
    assert "10\u202f000 characters" in shown


def test_a_label_is_one_short_line() -> None:
    assert brief("a" * 100, 10) == "a" * 9 + "\u2026"
    assert brief("one\ntwo") == "one\\ntwo"


def test_numbers_have_a_true_minus_and_a_dash_for_nothing() -> None:
    assert number(-2) == "\u22122"
    assert number(None) == number(float("nan")) == seconds(None) == amount(None) == "\u2013"
    assert (number(9_999), number(60_001)) == ("9999", "60\u202f001")
    assert number(1234567.0) == "1\u202f234\u202f567"
    assert amount(Decimal("-3.500")) == "\u22123.5"
    assert seconds(83.4) == "83.40\u202fs"


def test_embedded_json_cannot_end_its_element() -> None:
    assert "<" not in embedded_json('{"name": "</script><!--<script>"}')
    with pytest.raises(ValueError, match="Expecting value"):
        embedded_json("</script>")


def test_the_policy_names_our_script_alone() -> None:
    assert "script-src 'none'" in policy_of()
    # printf 'alert(1)' | openssl dgst -sha256 -binary | base64
    assert "'sha256-bhHHL3z2vDgxUt0W3dWQOrprscmda2Y5pLsLg4GF+pI='" in policy_of("alert(1)")


def test_a_template_that_asks_for_what_nobody_gave_is_an_error() -> None:
    from jinja2 import UndefinedError  # noqa: PLC0415  # only this test names it

    with pytest.raises(UndefinedError):
        page("trial.html.j2")
