"""What a live form of a monitor has to hold and to wait for is what the monitor declares, and no less."""

from __future__ import annotations

import math
import runpy
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Signal, Span, Trial
from ariac_score.monitors import LimitMonitor, Reach
from ariac_score_standards import AgvProtectiveField, Always, PflSpeed

MADE = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "test_margins.py")))
JUDGED = {name: one for name, one in MADE.MARGINED.items() if isinstance(one, LimitMonitor)} | {
    "iso_10218_2.pfl_speed, contact": PflSpeed(region="chest", when="contact"),
    "iso_3691_4.agv_protective_field": AgvProtectiveField(
        reaction_s=0.02, width_m=4.0, deceleration_m_s2=0.2
    ),
}


def between(trial: Trial, start_s: float, end_s: float) -> Trial:
    """What the log would be of this time alone."""

    def cut(signal: Signal) -> Signal:
        inside = (signal.t >= start_s) & (signal.t <= end_s)
        return replace(signal, t=signal.t[inside], values=signal.values[inside])

    signals = {name: cut(signal) for name, signal in trial.signals.items()}
    return replace(trial, signals=signals, recorded=Span(start_s, end_s))


def margins_at(monitor: Any, trial: Trial, t_s: float) -> dict[tuple[str, str], float]:
    """The margin of every subject and limit at one time."""
    return {
        (chart.subject, chart.what): float(chart.margin[chart.t == t_s][0])
        for chart in monitor.margins(trial)
        if (chart.t == t_s).any()
    }


def differs(monitor: Any, reach: Reach, trial: Trial, row: int) -> bool:
    """Whether the margins at a sample are others where no more of the log is there than it reaches."""
    t = trial.signals["speed/r"].t
    first = {"sample": row, "neighbour": row - 1, "run": 0, "start": 0}[reach.back]
    end_s = max(t[min(row + reach.ahead, len(t) - 1)], t[row] + reach.ahead_s)
    part = between(trial, float(t[max(first, 0)]), float(min(end_s, t[-1])))
    whole, alone = (margins_at(monitor, one, float(t[row])) for one in (trial, part))
    assert whole
    return not all(
        alone[key] == margin or (math.isnan(alone[key]) and math.isnan(margin))
        for key, margin in whole.items()
    )


def wild(seed: int, *, hole: bool = False, step: float = 0.3) -> Trial:
    """Bodies that wander over their limits, and touch now and then."""
    trial = MADE.wild_trial(seed, hole=hole, step=step)
    apart = trial.signals["separation/r/h"]
    nearer = replace(apart, values=np.maximum(apart.values - 0.6, 0.0))
    return replace(trial, signals={**trial.signals, apart.name: nearer})


@pytest.mark.parametrize("name", JUDGED)
@settings(max_examples=10, derandomize=True, deadline=None)
@given(st.integers(0, 2**32 - 1), st.booleans(), st.lists(st.integers(0, 119), min_size=1, max_size=5))
def test_a_sample_is_judged_alike_without_what_lies_beyond_the_reach(
    name: str, seed: int, hole: bool, rows: list[int]
) -> None:
    monitor, trial = JUDGED[name], wild(seed, hole=hole)

    assert not [row for row in rows if differs(monitor, monitor.reach, trial, row)]


REMEMBERING = {name: one for name, one in JUDGED.items() if one.reach != Reach()}


@pytest.mark.parametrize("name", REMEMBERING)
def test_a_reach_that_is_too_short_is_found_out(name: str) -> None:
    monitor = REMEMBERING[name]

    assert any(
        differs(monitor, Reach(), trial, row)
        for trial in (wild(seed, step=step) for seed in range(10) for step in (0.05, 0.3))
        for row in range(0, 119, 7)
    )


def test_whoever_can_watch_online_judges_each_sample_alone() -> None:
    online = {name for name, monitor in JUDGED.items() if hasattr(monitor, "begin")}

    assert not online & REMEMBERING.keys()
    assert {type(JUDGED[name]).__name__ for name in online} >= {"SsmSeparation", Always.__name__}
