"""What nothing bounds in a gap: the fewest and the most violations, and how long they lasted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.checks.open_findings import Worlds
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score.trial.spans import BoolArray, FloatArray
from ariac_score_standards import SpaceLimit

STEP_S = 0.01
BOX = SpaceLimit(box_low_m=(-1.0, -1.0, -1.0), box_high_m=(1.0, 1.0, 1.0), max_gap_s=0.05, t_on_s=0.0)


@dataclass(frozen=True)
class Found:
    """Of one world: how many violations, for how long, and their depth over time."""

    number: int
    lasts_s: float
    deep_s: float


def in_worlds(outside: str, monitor: SpaceLimit = BOX, *, every: bool = False) -> tuple[Found, Found]:
    """The best and the worst world of an arm at 100 Hz.

    Args:
        outside: For each sample `V` where the arm was 1 m outside of its box, `.` where it was inside, and
            a space where the sample is missing.
        monitor: With which pauses.
        every: Whether intervals between samples are bounded, too.
    """
    rows = np.array([k for k, one in enumerate(outside) if one != " "])
    at_m = np.array([2.0 if outside[k] == "V" else 0.0 for k in rows])
    ends_s = (len(outside) - 1) * STEP_S
    signal = Signal(
        "position/arm", "m", rows * STEP_S, np.stack([at_m, 0 * at_m, 0 * at_m], axis=1), stated_rate_hz=100.0
    )
    given = Trial(
        "t",
        bodies=(Body("arm", "robot", 0.0),),
        signals={signal.name: signal},
        events=(Event(0.0, COMPETITION_STARTED), Event(ends_s, COMPETITION_ENDED)),
        recorded=Span(0.0, ends_s),
        between=between_samples({}, {}, every=every),
    )
    everything = list(monitor.watch_worlds(given))
    opened = [one for one in everything if isinstance(one, Worlds)]
    findings = tuple(one for one in everything if isinstance(one, Finding))
    best, worst = (opened[0].best, opened[0].worst) if opened else (findings, findings)
    return counted(best), counted(worst)


def counted(findings: tuple[Finding, ...]) -> Found:
    violations = [one for one in findings if one.verdict is Verdict.VIOLATED]
    lasts_s, deep_s = (
        sum(one.quantities[name] for one in violations)
        for name in ("time_in_violation_s", "relative_depth_integral_s")
    )
    return Found(len(violations), lasts_s, deep_s)


def about(number: int, lasts_s: float) -> Found:
    """What was 1 m outside has all of its depth."""
    return Found(number, pytest.approx(lasts_s), pytest.approx(lasts_s))


# By hand, of samples that stand for 10 ms, 15 ms where the next is missing; pauses of 50 ms part violations.
@pytest.mark.parametrize(
    ("outside", "fewest", "most"),
    [
        ("....VV..........", about(1, 0.02), about(1, 0.02)),
        # What is hidden beside a violation that was seen is the same one, and no second.
        ("....VV   ........", about(1, 0.01), about(1, 0.05)),
        ("........   VV....", about(1, 0.02), about(1, 0.06)),
        # Hidden on both sides of what was inside for 20 ms: a pause of 50 ms needs a part of what is hidden.
        ("VV   ...   ......", about(1, 0.01), about(2, 0.09)),
        ("VV . ......", about(1, 0.01), about(1, 0.05)),
        # Inside for 60 ms in between: hidden twice, two at most.
        ("....   ......   ...........", about(0, 0.0), about(2, 0.08)),
        # The pause between two that were seen may be shorter than it looks, and then they are one.
        ("....VV....   VV......", about(1, 0.04), about(2, 0.08)),
        ("....VV.......   VV......", about(2, 0.04), about(2, 0.08)),
        ("....VV......VV......", about(2, 0.04), about(2, 0.04)),
        # Three that were seen, hidden in between: all of them may be one, or a pause next to the middle one.
        ("...V   V   V......", about(1, 0.01), about(2, 0.09)),
        # Nothing is seen for 120 ms: two pauses fit, and so three violations.
        ("...           ........", about(0, 0.0), about(3, 0.12)),
        # One that was seen in the midst of it is one of those.
        ("...     V     ........", about(1, 0.0), about(3, 0.12)),
    ],
)
def test_what_is_hidden_and_what_was_seen_are_as_many_violations_as_pauses_part(
    outside: str, fewest: Found, most: Found
) -> None:
    assert in_worlds(outside, replace(BOX, t_off_s=0.05)) == (fewest, most)


def test_what_was_seen_too_briefly_to_count_counts_with_what_is_hidden_beside_it() -> None:
    """Outside for 20 ms, and 40 ms count: with 40 ms that nobody saw it may be one, or none."""
    monitor = replace(BOX, t_on_s=0.04, t_off_s=0.05)

    assert in_worlds("....VV......", monitor) == (about(0, 0.0), about(0, 0.0))
    assert in_worlds("....VV   ...", monitor) == (about(0, 0.0), about(1, 0.05))


def test_where_every_interval_is_open_one_that_was_seen_is_among_those_that_fit() -> None:
    """1 s, pauses of 0.25 s: violations at 0, 0.25, 0.5, 0.75 and 1 s, and at the seen one no more."""
    monitor = replace(BOX, t_off_s=0.25)

    assert in_worlds("." * 101, monitor, every=True) == (about(0, 0.0), about(5, 1.0))
    assert in_worlds("." * 50 + "V" + "." * 50, monitor, every=True) == (about(1, 0.0), about(5, 1.0))


# Laws, of recordings by chance -----------------------------------------------------------------


def by_chance(random: np.random.Generator) -> FloatArray:
    """Where the arm was outside, at most five times."""
    outside = np.zeros(120, dtype=bool)
    for _ in range(random.integers(1, 6)):
        first = random.integers(0, 119)
        outside[first : first + random.integers(1, 8)] = True
    outside[-1] = False
    return outside


def left_out(random: np.random.Generator, outside: BoolArray) -> BoolArray:
    """Samples that somebody leaves out: anywhere, of what was outside, or several in a row."""
    how = random.integers(3)
    missing = random.random(len(outside)) < random.uniform(0.0, 0.4)
    if how == 1:
        missing = outside & (random.random(len(outside)) < 0.7)
    elif how == 2:
        missing[:] = False
        for _ in range(random.integers(1, 4)):
            first = random.integers(1, 118)
            missing[first : first + random.integers(1, 9)] = True
    missing[[0, -1]] = False
    return missing


def drawn(outside: BoolArray, missing: BoolArray) -> str:
    return "".join(" " if gone else "V" if out else "." for out, gone in zip(outside, missing, strict=True))


@pytest.mark.parametrize("every", [False, True])
@pytest.mark.parametrize("t_on_s", [0.0, 0.02, 0.05])
def test_the_truth_lies_between_both_worlds_and_fewer_samples_never_make_the_worst_better(
    t_on_s: float, every: bool
) -> None:
    random = np.random.default_rng(7)
    for _ in range(60):
        monitor = replace(BOX, t_on_s=t_on_s, t_off_s=random.choice([0.02, 0.05, 0.1, 0.3]))
        outside = by_chance(random)
        missing = left_out(random, outside)
        more, fewer = drawn(outside, missing), drawn(outside, missing | left_out(random, outside))
        (true, _), of_more, of_fewer = (
            in_worlds(drawn(outside, np.zeros_like(outside)), monitor),
            in_worlds(more, monitor, every=every),
            in_worlds(fewer, monitor, every=every),
        )

        for name in ("number", "lasts_s", "deep_s"):
            least, most, fewer_least, fewer_most = (getattr(one, name) for one in (*of_more, *of_fewer))
            assert max(least, fewer_least) <= getattr(true, name) + 1e-9, (name, more, fewer)
            assert getattr(true, name) - 1e-9 <= most <= fewer_most + 1e-9, (name, more, fewer)
