"""Recordings that a real recorder made of a node whose clock and motion are known.

The README beside them says what is true: with t in s since the node's start, the human walks at 0.5 m/s
and the competition's state is published each second.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score import Result, Trial, Verdict, load_log_map, score_trial
from ariac_score.engine import find_trial, read_trial
from ariac_score.registry import Registry

REAL = Path(__file__).parents[2].parent / "shared" / "real"

pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason=f"the real recordings are not at {REAL}")


def read(name: str, *quantities: str) -> Trial:
    registry = Registry()
    bundle, readers = find_trial(REAL / name, registry)
    return read_trial(bundle, readers, load_log_map("ariac2020"), registry, quantities=quantities)


def score(name: str) -> Result:
    return score_trial(REAL / name, "paper2020")


def test_a_competition_that_ends_with_done_is_found() -> None:
    trial = read("walk_done.bag")

    assert trial.started_s == pytest.approx(3.8992, abs=5e-5)
    assert trial.ended_s == pytest.approx(30.8989, abs=5e-5)


def test_a_gap_behind_the_end_of_the_competition_leaves_nothing_open() -> None:
    trial, result = read("walk_done.bag", "speed", "centre_distance"), score("walk_done.bag")

    signal = trial.signals["centre_distance/robot/human"]
    assert signal.span is not None
    (gap,) = signal.gaps(signal.span, max_gap_s=0.05)
    assert gap.duration_s == pytest.approx(0.057, abs=5e-4)
    assert trial.ended_s is not None
    assert gap.start_s > trial.ended_s
    assert result.status == "scored"
    assert Verdict.INCONCLUSIVE not in {finding.verdict for finding in result.measured.findings.values()}
