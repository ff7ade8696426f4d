"""The interval of a recording contains the true score of a simulated trial, whatever recorder made it."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

FILE = Path(__file__).parents[2] / "benchmarks/truth.py"


@pytest.fixture(scope="module")
def truth() -> ModuleType:
    spec = importlib.util.spec_from_file_location("truth_of_simulated_trials", FILE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # its dataclasses look their module up by name
    spec.loader.exec_module(module)
    return module


def test_of_late_stamps_fewer_samples_never_bound_more(truth: ModuleType) -> None:
    """Seed 7792: the sample before the nearest bounded more, and counted only without the nearest."""
    random = np.random.default_rng(7792)
    log = truth.recorded(random, truth.world(random, 4.0), 50.0, "late")
    every_other = {
        name: replace(one, t=one.t[::2], values=one.values[::2]) for name, one in log.signals.items()
    }
    bounded = truth.rules("bounded", truth.LATE_S)
    honest, robbed = (truth.ends_of(trial, bounded)[0] for trial in (log, replace(log, signals=every_other)))
    assert robbed <= honest + 1e-9


def test_where_intervals_are_held_late_stamps_make_no_violation_that_leaving_out_takes_back(
    truth: ModuleType,
) -> None:
    """Seed 6495, 25 Hz: messages close together made a human faster than the rules say it can be."""
    found = truth.tried(6495, 4.0)
    assert found.gained_held == 0.0


@pytest.mark.parametrize("seed", [20027, 20386, 20927])
def test_where_rates_are_stated_leaving_out_every_other_sample_does_not_pay(
    truth: ModuleType, seed: int
) -> None:
    """Seeds with which it pays by 2 to 6 points where nobody states how often bodies are published."""
    found = truth.tried(seed, 4.0)

    assert found.adversary == "every other"
    assert found.gained_held == 0.0


@pytest.mark.parametrize("seed", [6525, 7787, 9425])
def test_a_sample_that_is_left_out_might_have_stood_for_as_long_as_others(
    truth: ModuleType, seed: int
) -> None:
    """Seeds with which it pays by 0.001 to 0.009 points where a gap ends with what bodies can have done."""
    assert truth.tried(seed, 4.0).gained_held == 0.0


@pytest.mark.slow
def test_the_true_score_lies_in_the_interval_of_every_recording_and_leaving_out_does_not_pay(
    truth: ModuleType, subtests: pytest.Subtests
) -> None:
    """At every rate, with every model of a recorder (seeds 0 to 35), and a few for each other adversary."""
    others = [36 * adversary + recorder for adversary in range(1, 5) for recorder in (5, 17, 27, 34)]
    for seed in (*range(36), *others):
        found = truth.tried(seed, seconds=4.0)
        with subtests.test(f"{found.rate_hz:g} Hz, {found.model}, {found.adversary}"):
            assert found.least <= found.true + 1e-6
            assert found.true <= found.most + 1e-6
            assert found.robbed <= found.true + 1e-6
            assert found.robbed <= found.least + truth.CUTS
            assert found.gained_held == 0.0
