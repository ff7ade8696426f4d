"""What is proven is never refuted: laws of formulas made by chance, tried on trials made by chance."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from random import Random

import pytest

from ariac_score.checks.registry import Registry
from ariac_score.errors import ScoreError
from ariac_score.review.proofs.proving import PROVEN, pointed_search, prove, random_search
from ariac_score.review.proofs.solver import find_solver
from ariac_score.review.proofs.subject import Subject, subject_of

REGISTRY = Registry()
RULES = """\
id: made
title: Made
source: a test
log_map: ariac2020
competition: {use: ariac}
rules:
  part_color: {use: kitting.presence, with: {compare: type_and_color}}
  none_missing: {use: kitting.none_missing}
monitors:
  separation: {use: iso_ts_15066.ssm_separation, with: {profile: seed}}
  dropped: {use: ariac.no_event, with: {kind: part_dropped}}
terms:
  submission: {kit: KIT}
  trial: {earned: sum(submission.kit), x: COST}
score: SCORE
ranking: {ties: [{lowest: x}]}
"""
KITS = (
    "points(part_color)",
    "1 + points(part_color)",
    "points(part_color) - 1",
    "3 * holds(part_color)",
    "points(part_color) if holds(none_missing) else 0",
)
COSTS = (
    "count(dropped)",
    "count(separation)",
    "seconds(separation)",
    "demerits(separation, tau_s=5)",
    "charged(separation=1, dropped=0.5)",
    "charged(separation=0.4, severity=2)",
    "charged(dropped=0.3, separation=2, again_after_s=1)",
    "occurrences(separation, every_s=5)",
    "violated(separation)",
    "1 - gate(separation)",
    "measure(separation, relative_depth_integral_s)",
    "count(dropped) * seconds(separation)",
)
LEAVES = (
    "earned",
    "x",
    "x",
    "x",
    "holds(dropped)",
    "gate(separation)",
    "product(dropped, p=0.5)",
    "1 / (1 + x)",
)
NUMBERS = ("0.5", "1", "2", "3", "10")
SCORES = ("earned * ({0})", "earned / (1 + ({0}))", "earned - ({0})", "{0}", "max(0, earned - ({0}))")


def formula(rng: Random, depth: int = 0) -> str:
    if depth > 2 or rng.random() < 0.25:
        return rng.choice((*LEAVES, rng.choice(NUMBERS)))
    one, other, third = (formula(rng, depth + 1) for _ in range(3))
    number = rng.choice(NUMBERS)
    forms = (
        f"({one} + {other})",
        f"({one} - {other})",
        f"({one}) * ({other})",
        f"({one}) / (1 + {other})",
        f"min({one}, {other})",
        f"max({one}, {other})",
        f"clip({one}, 0, {number})",
        f"ramp({number}, 0, 5, 1, {one})",
        f"({one} if {other} >= {number} else {third})",
        f"(0.5 ** ({one}))",
        f"(({one}) ** 2)",
        f"abs({one})",
        f"floor({one})",
    )
    return rng.choice(forms)


def made(rng: Random, file: Path, count: int) -> Iterator[tuple[str, Subject]]:
    """So many rule sets that can be read, each with its text."""
    while count:
        score = rng.choice(SCORES).format(formula(rng))
        text = RULES.replace("KIT", rng.choice(KITS)).replace("COST", rng.choice(COSTS))
        text = text.replace("SCORE", score)
        file.write_text(text, encoding="utf-8")
        try:
            yield text, subject_of(str(file), REGISTRY)
        except ScoreError:  # such as a divisor that may be 0
            continue
        count -= 1


@pytest.mark.slow  # every proven law is tried on trials by chance
@pytest.mark.timeout(300)
@pytest.mark.parametrize("seed", range(4))
def test_what_is_proven_of_any_formula_is_refuted_by_no_trial(seed: int, tmp_path: Path) -> None:
    rng, proven = Random(seed), 0  # noqa: S311  # no secrets are made of it
    for number, (text, subject) in enumerate(made(rng, tmp_path / "made.yaml", 10)):
        for one in prove(subject, cases=0, solver=find_solver()):
            if one.verdict != PROVEN:
                continue
            proven += 1
            for search in (random_search, pointed_search):
                found = search(cases=8, seed=number, steps=0).look(subject, one.law)
                assert found is None or found.broken is None, (one.law.name, one.by, text, found)

    assert proven > 30
