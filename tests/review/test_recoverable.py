"""What would have earned more: the score again, one thing at a time as it should have been."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pytest

from ariac_score import Result, Trial, score_trial
from ariac_score.review.lost_points import recoverable_losses
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial


def _scored(folder: Path, trial: Trial) -> Result:
    return score_trial(
        write_trial_log(folder / "trial.jsonl", trial, signals=SNAPSHOT_SIGNALS), "paper2020.published"
    )


def test_the_example_loses_what_a_hand_calculation_gives(tmp_path: Path) -> None:
    result = _scored(tmp_path, kitting_trial())

    losses = {one.what: one for one in recoverable_losses(result)}

    # Task 28 points, of which the demerits leave the score: without the breach all 28 stay.
    assert losses["separation"].gain == Decimal(28) - (result.score or 0)
    share = float(result.score or 0) / 28
    # order_0 (factor 1): colour and pose of part_1 are 2 points; with them all products are right: bonus 3.
    assert float(losses["order_0/order_0_shipment_0/part_1"].gain) == pytest.approx(2 * share, abs=2e-6)
    assert float(losses["order_0/order_0_shipment_0"].gain) == pytest.approx(5 * share, abs=2e-6)
    # order_1 (factor 3): one pose, 1 point.
    assert float(losses["order_1/order_1_shipment_0/part_1"].gain) == pytest.approx(3 * share, abs=2e-6)


def test_the_largest_loss_comes_first(tmp_path: Path) -> None:
    gains = [one.gain for one in recoverable_losses(_scored(tmp_path, kitting_trial()))]

    assert gains == sorted(gains, reverse=True)
    assert all(gain > 0 for gain in gains)


def test_nobody_gains_more_than_was_possible(tmp_path: Path) -> None:
    result = _scored(tmp_path, kitting_trial())

    assert result.possible is not None
    assert result.score is not None
    assert max(one.gain for one in recoverable_losses(result)) <= result.possible - result.score


def test_a_withheld_score_has_nothing_to_compare_with(tmp_path: Path) -> None:
    log = write_trial_log(tmp_path / "a.jsonl", kitting_trial(human=False), signals=("speed/robot",))
    rules = tmp_path / "strict.yaml"
    extended = "extends: paper2020.published, log_map: ariac2020, open: withhold"
    rules.write_text(
        f"{{id: strict, title: paper2020.published, source: test, {extended}}}", encoding="utf-8"
    )
    result = score_trial(log, rules)

    assert result.score is None
    assert recoverable_losses(result) == ()


def test_what_costs_nothing_is_not_told(tmp_path: Path) -> None:
    names = {key for one in recoverable_losses(_scored(tmp_path, kitting_trial())) for key in one.findings}

    assert not any(name.startswith("order_time") for name in names)  # it is not priced
