"""Rule sets that are known to be bad: none of their laws is proven, and each is refuted with its exploit.

What both sides of an exploit score is worked by hand from the formula, for one part that earns one point.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

import pytest

from ariac_score.checks.registry import Registry
from ariac_score.review.proofs.by_types import BY_TYPES
from ariac_score.review.proofs.proving import law_named, pointed_search, random_search
from ariac_score.review.proofs.solver import BY_SOLVER, OutsideError, find_solver
from ariac_score.review.proofs.subject import Subject, subject_of

FOLDER = Path(__file__).parent / "bad_rules"
REGISTRY = Registry()
EXPLOITS = {
    # After a critical contact everything is 0, and stays 0.
    "free_after_gate": ("nothing_left", 0, 0),
    # One dropped part: 1 / (1 + 1). Another: the same.
    "only_the_first": ("always_costs", 1 / 2, 1 / 2),
    "any_or_none": ("always_costs", 1 / 2, 1 / 2),
    # Five dropped parts take half, 1 - 5 / 10; a sixth nothing.
    "floor_at_half": ("always_costs", 1 / 2, 1 / 2),
    "floor_at_zero": ("nothing_left", 0, 0),
    # One order for 1 / (1 + 1); after the second, which brings nothing, 1 / (1 + 2).
    "best_order": ("stopping_early", 1 / 2, 1 / 3),
    # 0.1 s of 60 s, or of 60.1 s.
    "idling": ("waiting", 1 - 0.1 / 60, 1 - 0.1 / 60.1),
    "negative_price": ("more_violations", 1, 2),
    # 1 / (1 + 0.1 s); unseen, nothing is taken off.
    "left_out": ("unknown", 1 / 1.1, 1),
    # Nothing earned, and 0.1 s: -0.1. Unseen: 0.
    "unknown_is_zero": ("unknown", -0.1, 0),
    "cliff_10_s": ("no_cliff", 1, 0),
    "cliff_55_s": ("no_cliff", 1 - 54.9 / 1000, 0.1),
    # Of 0.1 s a tenth deep: 1 / (1 + 0.2 - 0.01); fully deep: 1 / (1 + 0.2 - 0.1).
    "depth_earns": ("severity", 1 / 1.19, 1 / 1.1),
    "waiting_earns": ("waiting", 1.06, 1.0601),
    "counting_earns": ("more_violations", 1, 1.1),
    # A contact more than parts dropped: 0. Two contacts that are joined are one, as many: 1.
    "one_against_another": ("more_violations", 0, 1),
    # Two violations of 0.2 s together; with one of 0.1 s more, in the pause that is bridged, they are one.
    "merged": ("more_violations", 1 / (1 + 0.4 * (2 + 0.2 / 5)), 1 / (1 + 0.4 * (1 + 0.3 / 5))),
    "whole_steps": ("more_violations", 1 / 3, 1 / 2),
    # One dropped part in one run; the same again, and two count.
    "no_points_left": ("doing_nothing", 1 - 10, 0),
    # One order for 0.4; two for 2 * 0.4 ** 2.
    "steeper_than_work": ("stopping_early", 0.4, 2 * 0.4**2),
}
"""By rule set: the law, and what is scored before and after."""


def subject(name: str) -> Subject:
    return subject_of(str(FOLDER / f"{name}.yaml"), REGISTRY)


def test_every_bad_rule_set_is_tried() -> None:
    assert {file.stem for file in FOLDER.glob("*.yaml")} == set(EXPLOITS)


@pytest.mark.parametrize("name", EXPLOITS)
def test_its_law_is_not_proven(name: str) -> None:
    law, _, _ = EXPLOITS[name]
    bad = subject(name)

    assert not BY_TYPES[law](bad).proves
    solver = find_solver()
    if solver and law in BY_SOLVER:
        with suppress(OutsideError):
            assert not BY_SOLVER[law](solver, bad).proves


@pytest.mark.slow  # an exploit is found among random trials, and reduced step by step
@pytest.mark.parametrize("name", EXPLOITS)
def test_its_exploit_is_found_and_priced(name: str) -> None:
    law, before, after = EXPLOITS[name]

    found = random_search(cases=400, seed=0).look(subject(name), law_named(law))

    assert found is not None
    assert found.broken is not None
    assert (found.broken.first_score, found.broken.second_score) == pytest.approx((before, after))


EDGES = {
    # What takes more than 25 dropped parts is beyond every trial that is drawn by chance.
    "pardoned": ("more_violations", "max(earned, 40 * violated(dropped)) if count(dropped) > 25 else 0"),
    "worn_out": ("always_costs", "earned / (1 + min(count(dropped), 31))"),
    "jackpot": ("waiting", "earned * (2 if trial.duration_s == 47.3 else 1)"),
}
"""By name: the law, and a score that breaks it only at a number that it states."""


@pytest.mark.slow
@pytest.mark.parametrize("name", EDGES)
def test_what_happens_at_a_stated_number_alone_is_found_there(name: str, tmp_path: Path) -> None:
    law, score = EDGES[name]
    text = (FOLDER / "steeper_than_work.yaml").read_text(encoding="utf-8")
    file = tmp_path / "rules.yaml"
    file.write_text(re.sub("(?m)^score: .*$", f"score: {score}", text), encoding="utf-8")
    rules = subject_of(str(file), REGISTRY)
    by_chance, at_numbers = (
        search(cases=400, seed=0).look(rules, law_named(law)) for search in (random_search, pointed_search)
    )

    assert by_chance is not None
    assert by_chance.broken is None
    assert at_numbers is not None
    assert at_numbers.broken is not None
