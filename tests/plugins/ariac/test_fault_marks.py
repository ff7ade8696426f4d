"""Which products of a kit are faulty: by the list of 2017 to 2022, by the challenges of 2023 and 2024."""

from __future__ import annotations

import pytest

from ariac_score import Pose, Trial
from ariac_score_ariac.fault_marks import by_challenges, by_list
from ariac_score_ariac.work import FaultyProducts, Order, Product, Task, WantedProduct

GEAR = Product("gear_part_red", Pose((0.1, 0.0, 0.0)), name="bin1|gear_part_red_7")
SOUND = Product("pump_red", Pose((0.1, -0.1, 0.0)), name="pump_red_2")
RENAMED = Product("pump_red", Pose((0.1, 0.1, 0.0)), name="pump_red_3_faulty")


def kit(*, challenged: bool | None, kind: str = "kitting") -> Task:
    return Task("ABCD", kind, (WantedProduct("part_0", "pump_red", None, 2, challenged=challenged),), "agv1")


def trial(task: Task, listed: frozenset[str] | None = None) -> Trial:
    records = () if listed is None else (FaultyProducts(listed),)
    return Trial("t", work=(Order("ABCD", (task,), 1.0),), records=records)


def faulty(marked: tuple[Product, ...] | None) -> list[bool] | None:
    return None if marked is None else [product.faulty for product in marked]


@pytest.mark.parametrize(
    ("listed", "found"),
    [
        ({"gear_part_red_7"}, True),
        ({"gear_part_red_77", "gear_part_red"}, False),
        ({"bin1|gear_part_red_7"}, False),
        (set(), False),
    ],
)
def test_the_list_names_individuals_without_where_they_came_from(listed: set[str], found: bool) -> None:
    task = kit(challenged=None)

    assert faulty(by_list((GEAR,), trial(task, frozenset(listed)), task)) == [found]


def test_without_a_list_nothing_is_known_of_products_and_an_empty_tray_holds_none() -> None:
    task = kit(challenged=None)

    assert by_list((GEAR,), trial(task), task) is None
    assert by_list((), trial(task), task) == ()


@pytest.mark.parametrize("challenged", [True, False])
def test_a_quality_check_renames_faulty_parts(challenged: bool) -> None:
    task = kit(challenged=challenged)

    assert faulty(by_challenges((SOUND, RENAMED), trial(task), task)) == [False, True]


def test_a_name_tells_nothing_as_long_as_the_challenges_are_unknown() -> None:
    task = kit(challenged=None)

    assert by_challenges((RENAMED,), trial(task), task) is None
    assert by_challenges((SOUND,), trial(task), None) is None
    assert by_challenges((), trial(task), task) == ()


@pytest.mark.parametrize("kind", ["assembly", "combined"])
def test_parts_of_an_assembly_are_never_faulty(kind: str) -> None:
    task = kit(challenged=None, kind=kind)

    assert faulty(by_challenges((RENAMED,), trial(task), task)) == [False]
