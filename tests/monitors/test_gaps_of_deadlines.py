"""Deadlines that a gap hides: every world that fits the samples lies between both ends.

The worlds are all that there are: each way in which the missing samples can have been, judged by the same
monitor on the whole recording.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.checks.open_findings import Worlds
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score.trial.spans import FloatArray
from ariac_score_standards import Within
from ariac_score_standards.deadlines import asked_at_worst, late_at_worst

STEP_S = 0.01
NAMES = ("speed/arm", "speed/lift")
BODIES = (Body("arm", "robot", 0.0), Body("lift", "robot", 0.0))


def asks(within_s: float, t_on_s: float, t_off_s: float) -> Within:
    return Within(
        trigger="a > 0.5",
        response="b > 0.5",
        within_s=within_s,
        signals={"a": "speed/arm", "b": "speed/lift"},
        max_gap_s=0.05,
        t_on_s=t_on_s,
        t_off_s=t_off_s,
    )


def recorded(columns: Sequence[FloatArray], rows: Sequence[int], *, every: bool = False) -> Trial:
    """Two signals at 100 Hz, of which only some samples are there."""
    kept, ends_s = np.array(rows), (len(columns[0]) - 1) * STEP_S
    signals = [
        Signal(name, "m/s", kept * STEP_S, column[kept], "/cell", stated_rate_hz=100.0)
        for name, column in zip(NAMES, columns, strict=True)
    ]
    return Trial(
        "t",
        bodies=BODIES,
        signals={one.name: one for one in signals},
        events=(Event(0.0, COMPETITION_STARTED), Event(ends_s, COMPETITION_ENDED)),
        recorded=Span(0.0, ends_s),
        between=between_samples({}, {}, every=every),
    )


def in_both_worlds(monitor: Within, given: Trial) -> list[tuple[int, float]]:
    """How many responses were late, and by how long together, s: at best and at worst."""
    everything = list(monitor.watch_worlds(given))
    (opened,) = [one for one in everything if isinstance(one, Worlds)] or [None]
    seen = [one for one in everything if isinstance(one, Finding)]
    return [counted(seen if opened is None else each(opened)) for each in (_best, _worst)]


def _best(opened: Worlds) -> Sequence[Finding]:
    return opened.best


def _worst(opened: Worlds) -> Sequence[Finding]:
    return opened.worst


def counted(findings: Sequence[Finding]) -> tuple[int, float]:
    late = [one for one in findings if one.verdict is Verdict.VIOLATED]
    return len(late), math.fsum(one.quantities["time_in_violation_s"] for one in late)


def fillings(columns: Sequence[FloatArray], missing: Sequence[int]) -> Iterator[list[FloatArray]]:
    """Every way in which the missing samples can have been."""
    for values in product((0.0, 1.0), repeat=2 * len(missing)):
        filled = [column.copy() for column in columns]
        for column, own in zip(filled, (values[: len(missing)], values[len(missing) :]), strict=True):
            column[list(missing)] = own
        yield filled


def random_columns(rng: np.random.Generator, n: int) -> list[FloatArray]:
    """Two signals of 0 and 1 that stay for some samples each."""
    changes = rng.random((2, n)) < np.array([[0.25], [0.15]])
    return [np.cumsum(one) % 2.0 for one in changes]


@pytest.mark.parametrize("seed", range(12))
def test_every_way_in_which_a_gap_may_have_been_lies_between_both_worlds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    columns, first = random_columns(rng, 30), int(rng.integers(3, 22))
    missing = range(first, first + 4)
    monitor = asks(float(rng.choice([0.03, 0.05])), float(rng.choice([0.0, 0.02])), 0.02)
    shown = recorded(columns, [row for row in range(30) if row not in missing])
    (fewest, least_s), (most, longest_s) = in_both_worlds(monitor, shown)

    worlds = [
        counted(list(monitor.watch(recorded(filled, range(30))))) for filled in fillings(columns, missing)
    ]

    numbers, times_s = zip(*worlds, strict=True)
    assert fewest <= min(numbers)
    assert max(numbers) <= most
    assert least_s <= min(times_s) + 1e-9
    assert max(times_s) <= longest_s + 1e-9


@pytest.mark.parametrize("every", [False, True])
def test_whoever_leaves_out_more_has_no_fewer_late_responses_at_worst(every: bool) -> None:
    for seed in range(40):
        rng = np.random.default_rng((seed, every))
        columns, monitor = random_columns(rng, 120), asks(0.05, float(rng.choice([0.0, 0.02])), 0.02)
        rows, known = list(range(120)), (0, 0.0)
        for _ in range(4):
            at_worst = in_both_worlds(monitor, recorded(columns, rows, every=every))[1]
            assert at_worst[0] >= known[0], seed
            assert at_worst[1] >= known[1] - 1e-9, seed
            known, first = at_worst, int(rng.integers(1, len(rows) - 8))
            rows = rows[:first] + rows[first + int(rng.integers(1, 7)) :]


def test_a_gap_that_is_answered_in_time_hides_no_violation() -> None:
    """30 ms without samples, and the response holds at the next one; nobody knows whether any was due."""
    columns = np.zeros(60), np.where(np.arange(60) % 4 == 0, 1.0, 0.0)
    shown = recorded(columns, [row for row in range(60) if row not in (21, 22, 23)])

    (opened,) = [one for one in asks(0.05, 0.0, 0.02).watch_worlds(shown) if isinstance(one, Worlds)]

    assert [one.verdict for one in opened.best] == [Verdict.SATISFIED]
    assert [one.verdict for one in opened.worst] == [Verdict.NOT_APPLICABLE]


@pytest.mark.parametrize(("ends_s", "verdict"), [(1.19, Verdict.NOT_APPLICABLE), (1.2, Verdict.VIOLATED)])
def test_no_response_is_due_after_the_competition(ends_s: float, verdict: Verdict) -> None:
    """It is asked for at 1 s, and never comes: late after 0.19 s, where the competition goes on so long."""
    number = round(ends_s / STEP_S) + 1
    columns = np.where(np.arange(number) >= 100, 1.0, 0.0), np.zeros(number)

    (found,) = asks(0.195, 0.0, 0.02).watch(recorded(columns, range(number)))

    assert found.verdict is verdict
    if verdict is Verdict.VIOLATED:
        assert found.quantities["time_in_violation_s"] == pytest.approx(0.005)


@pytest.mark.parametrize(
    ("hidden", "answered", "late"),
    [
        # Asked for from 1 s on, every 0.5 s, answered at 2.2 s, at the latest 0.4 s later: at 1.0 and 1.5 s.
        ([Span(1.0, 2.2)], [2.2], [(1.0, 0.8), (1.5, 0.3)]),
        # Where an answer leaves no room for the first of the next, one counts for both.
        ([Span(1.0, 2.2)], [1.5, 2.2], [(1.0, 0.1), (1.5, 0.3)]),
        ([Span(1.3, 2.2)], [1.76, 2.2], [(1.3, 0.06 + 0.04)]),
        ([Span(1.0, 1.05), Span(1.3, 1.31)], [1.5, 1.8], [(1.0, 0.1)]),
        ([Span(1.0, 1.05), Span(1.4, 1.41)], [1.405, 1.9], [(1.405, 0.1)]),
        # What begins so late that its time is not up at the end is not late.
        ([Span(4.7, 5.0)], [], []),
        ([Span(4.5, 5.0)], [], [(4.5, 0.1)]),
    ],
)
def test_late_responses_by_hand(
    hidden: list[Span], answered: list[float], late: list[tuple[float, float]]
) -> None:
    asked = asked_at_worst([], hidden, np.array(answered), 5.0)

    found = [(span.start_s, late_s) for span, late_s in late_at_worst(asked, 0.4, 0.5)]

    assert found == [(pytest.approx(began_s), pytest.approx(late_s)) for began_s, late_s in late]
