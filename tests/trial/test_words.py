"""What people call the items of each level."""

from __future__ import annotations

from ariac_score.trial.words import Words

PARCELS = Words(
    {"trial": ("tour", "tours"), "box": ("box", "boxes"), "submission": ("delivery", "deliveries")},
    ("box", "stop", "trial"),
)


def test_a_level_without_words_is_called_by_its_name_and_an_unknown_one_item() -> None:
    assert PARCELS.many("box") == "boxes"
    assert PARCELS.many("stop") == "stops"
    assert Words().many("parking_lot") == "parking lots"
    assert Words().many(Words().outermost) == "items"


def test_the_outermost_level_is_that_of_work_and_never_the_trial() -> None:
    assert PARCELS.outermost == "stop"
    assert Words(levels=("trial",)).outermost == ""


def test_only_where_something_is_handed_in_is_work_announced() -> None:
    assert PARCELS.none_announced() == "no stop was announced"
    assert PARCELS.none_announced("box") == "no box was announced"
    assert Words({"leg": ("leg", "legs")}, ("leg", "trial")).none_announced() == "there was no leg"
    # Rules of before levels were declared have the level, and no words.
    assert Words(levels=("part", "submission", "order", "trial")).none_announced() == "no order was announced"


def test_what_begins_and_ends_is_called_as_a_trial_where_that_has_a_word_of_its_own() -> None:
    assert PARCELS.period == "tour"
    assert Words({"trial": ("trial", "trials")}).period == "competition"
    assert Words().period == "competition"
