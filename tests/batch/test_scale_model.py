"""The simulation of a season at any size, against what can be said without it."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))
from scale_model import Machine, fitted, simulate  # noqa: E402  # beside the tests


def test_workers_that_have_enough_to_do_share_the_work() -> None:
    found = simulate(Machine(workers=4, start_s=3.0, run_s=2.0, supervise_s=0.0, table_s=0.0), 100)

    assert found.wall_s == pytest.approx(3 + 100 * 2 / 4)
    assert (found.lost_runs, found.moved_bytes) == (0, 0)


def test_a_supervisor_that_is_too_slow_sets_the_pace() -> None:
    found = simulate(Machine(workers=1000, start_s=0.0, run_s=1.0, supervise_s=0.01, table_s=0.0), 5000)

    assert found.wall_s == pytest.approx(5000 * 0.01 + 1, rel=0.001)
    assert found.supervisor == pytest.approx(50 / 51, rel=0.001)


def test_a_storage_that_is_too_slow_sets_the_pace() -> None:
    slow = Machine(
        workers=10,
        start_s=0.0,
        run_s=0.0,
        supervise_s=0.0,
        table_s=0.0,
        run_bytes=1e9,
        storage_bytes_per_s=1e9,
    )

    found = simulate(slow, 100)

    assert found.wall_s == pytest.approx(100)
    assert found.moved_bytes == 100e9


def test_workers_that_die_cost_their_tries_and_no_run() -> None:
    mortal = Machine(
        workers=20, start_s=0.0, run_s=36.0, supervise_s=0.0, table_s=0.0, deaths_per_hour=10.0, restart_s=0.0
    )

    found = simulate(mortal, 4000)

    # A try of 36 s outlives a death in 360 s on average with probability e^-0.1.
    assert found.lost_runs / (4000 + found.lost_runs) == pytest.approx(1 - 2.718281828**-0.1, abs=0.01)
    assert found == simulate(mortal, 4000)


def test_a_line_goes_through_seconds_that_lie_on_one() -> None:
    line = fitted({100: 7.0, 300: 11.0, 1000: 25.0})

    assert (line.start_s, line.each_s) == (pytest.approx(5.0), pytest.approx(0.02))
    assert line.at(10_000) == pytest.approx(205.0)
