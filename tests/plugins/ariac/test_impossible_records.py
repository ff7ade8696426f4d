"""A record that states what cannot be is undecided: no price, and no fault of the plugin that read it."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ariac_score import Trial, Verdict
from ariac_score_ariac.tasks import OfficialOrderScore, OfficialTrialScore, RunOrder, RunRecord
from ariac_score_ariac.testing import made_trial

MADE = made_trial()


def with_times(announced_s: float, submitted_s: float) -> Trial:
    official = MADE.official
    assert official is not None
    first = replace(official.summaries[0], announced_s=announced_s, submitted_s=submitted_s, submitted=True)
    return replace(MADE, official=replace(official, summaries=(first,)))


@pytest.mark.parametrize(
    ("announced_s", "submitted_s", "verdict"),
    [(5.0, 5.0, Verdict.SATISFIED), (5.0, 4.9, Verdict.INCONCLUSIVE)],
)
def test_an_order_handed_in_before_it_was_announced_is_undecided(
    announced_s: float, submitted_s: float, verdict: Verdict
) -> None:
    trial = with_times(announced_s, submitted_s)

    (found,) = OfficialOrderScore().judge(trial, trial.work[0])

    assert found.verdict is verdict


@pytest.mark.parametrize(("announced_s", "verdict"), [(0.0, Verdict.SATISFIED), (-0.1, Verdict.INCONCLUSIVE)])
def test_an_order_announced_before_the_start_is_undecided(announced_s: float, verdict: Verdict) -> None:
    trial = with_times(announced_s, 5.0)

    (found,) = RunOrder().judge(trial, trial.work[0])

    assert found.verdict is verdict


@pytest.mark.parametrize(("name", "value"), [("num_correct_reports", -1.0), ("avg_report_time_s", -0.5)])
def test_a_run_with_less_than_nothing_is_undecided(name: str, value: float) -> None:
    (sound,) = RunRecord().watch(MADE)
    (found,) = RunRecord().watch(replace(MADE, facts={**MADE.facts, name: value}))

    assert sound.verdict is Verdict.SATISFIED
    assert found.verdict is Verdict.INCONCLUSIVE
    assert f"of {value:g}, which cannot be" in found.message


def test_a_text_with_less_than_no_time_is_undecided() -> None:
    official = MADE.official
    assert official is not None

    (found,) = OfficialTrialScore().watch(replace(MADE, official=replace(official, process_time_s=-3.0)))

    assert found.verdict is Verdict.INCONCLUSIVE
    assert "a process time of -3, which cannot be" in found.message
