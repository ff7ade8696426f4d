"""A formula of temporal logic in the best and in the worst world that the gaps of a log allow."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, FloatArray, Signal, Span, Trial, Verdict, Worlds
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score_stl.formula import StlFormula

APART, SPEED = "separation/arm/ann", "speed/arm"
NAMES = {"d": "separation in m", "v": "speed of robot in m/s"}
STATED = {
    "human": {"max_speed_m_s": 0.6, "source": "walks"},
    "robot": {"max_speed_m_s": 0.4, "max_acceleration_m_s2": 2.0, "source": "its rail"},
}
"""Together 1 m/s."""

FORMULAS = (
    "always d > 0.5",
    "always (d < 0.6 -> v < 0.2)",
    "always (d < 0.6 -> eventually[0,0.3] v < 0.1)",
    "always (v > 0.2 -> (always[0.1,0.4] d > 0.3))",
    "always ((d > 0.5) or (once[0,0.2] v < 0.15))",
    "always (d > 0.4 until[0,0.5] v < 0.2)",
    "always (historically[0,0.3] d > 0.35)",
    "always[0.5,2.5] not (d < 0.4 and v > 0.1)",
)


def trial(t: FloatArray, columns: Mapping[str, FloatArray], **between: Any) -> Trial:
    """A robot and a human, of whom the distance and the speed of the robot were sampled."""
    units = {APART: "m", SPEED: "m/s"}
    end_s = 3.0
    return Trial(
        "t",
        bodies=(Body("arm", "robot", 0.0), Body("ann", "human", 0.0)),
        signals={name: Signal(name, units[name], t, column, "/scanner") for name, column in columns.items()},
        events=(Event(0.0, COMPETITION_STARTED), Event(end_s, COMPETITION_ENDED)),
        recorded=Span(0.0, end_s),
        between=between_samples({}, STATED, **between),
    )


def formula(text: str, **given: Any) -> StlFormula:
    used = {name: source for name, source in NAMES.items() if name in text.replace("eventually", "")}
    return StlFormula(formula=text, signals=used, beyond="cut", **given)


def broken_s(findings: Any) -> float:
    """How long it did not hold."""
    return sum(
        one.quantities.get("time_in_violation_s", one.span.duration_s if one.span else 0.0)
        for one in findings
        if one.verdict is Verdict.VIOLATED
    )


def wandering(random: np.random.Generator, steps: int, rate: float, top: float) -> FloatArray:
    """A number between 0 and `top` that changes no faster than a rate, every millisecond."""
    slope = np.repeat(random.choice([-1.0, 0.0, 1.0, 0.5], size=steps // 50 + 1), 50)[:steps]
    found, here = np.empty(steps), top * random.random()
    for step in range(steps):
        here = min(max(here + 0.001 * rate * slope[step], 0.0), top)
        found[step] = here
    return found


@pytest.mark.parametrize("time", ["discrete", "dense"])
def test_no_walk_through_the_samples_breaks_a_formula_longer_than_the_worst_world_or_shorter_than_the_best(
    time: str, subtests: pytest.Subtests
) -> None:
    t = np.arange(3001) * 0.001
    for seed, text in enumerate(FORMULAS * 3):
        random = np.random.default_rng(seed)
        truth = {APART: wandering(random, len(t), 1.0, 1.0), SPEED: wandering(random, len(t), 2.0, 0.4)}
        kept = random.random(len(t)) < (0.004, 0.02, 0.1)[seed % 3]
        kept[[0, -1]] = True
        monitor = formula(text, time=time)
        true_s = broken_s(monitor.watch(trial(t, truth)))
        log = trial(t[kept], {name: column[kept] for name, column in truth.items()}, every=True)
        everything = list(monitor.watch_worlds(log))
        opened = [one for one in everything if isinstance(one, Worlds)]
        findings = [one for one in everything if isinstance(one, Finding)]
        with subtests.test(f"{text}, {seed}"):
            best, worst = (opened[0].best, opened[0].worst) if opened else (findings, findings)
            assert broken_s(best) <= true_s + 2e-3
            assert true_s <= broken_s(worst) + 2e-3
            assert not any(one.verdict is Verdict.INCONCLUSIVE for one in (*best, *worst))


def test_a_gap_far_from_the_limit_leaves_a_formula_decided() -> None:
    """60 ms without samples, 0.06 m at 1 m/s: nothing at 3 m, anything at 0.52 m."""
    t = np.array([0.01 * k for k in range(301) if not 100 < k < 106])
    far, near = (
        list(formula("always d > 0.5").watch_worlds(trial(t, {APART: np.full(len(t), d)})))
        for d in (3.0, 0.52)
    )

    assert [getattr(one, "verdict", None) for one in far] == [Verdict.SATISFIED]
    assert far[0].evidence == ()
    undecided, worlds = near
    assert undecided.verdict is Verdict.INCONCLUSIVE
    assert isinstance(worlds, Worlds)
    # The extreme paths are under 0.5 m for 20 ms: 60 ms less twice the way of 0.02 m. The last sample of that
    # time, had it been recorded, would have stood for up to 15 ms.
    assert broken_s(worlds.best) == 0.0
    assert broken_s(worlds.worst) == pytest.approx(0.02 + 0.015, abs=0.005)
    assert not worlds.tight


def test_what_nothing_bounds_is_open_in_all_of_the_gap() -> None:
    """`rise` looks at single samples, and a sign that changes both ways has no worse end."""
    t = np.array([0.01 * k for k in range(301) if not 100 < k < 120])
    for text in ("always not rise (d < 0.5)", "always (d > 0.5 <-> v < 0.1)"):
        monitor = formula(text)
        columns = {APART: np.full(len(t), 3.0), SPEED: np.zeros(len(t))}
        used = {name: columns[name] for name in ((APART, SPEED) if "v" in monitor.signals else (APART,))}
        *_, worlds = monitor.watch_worlds(trial(t, used))

        assert monitor.in_gaps == "blunt"
        assert isinstance(worlds, Worlds)
        assert broken_s(worlds.best) == 0.0
        assert broken_s(worlds.worst) == pytest.approx(0.2)
