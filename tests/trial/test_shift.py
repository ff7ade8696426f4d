"""A trial with all of its times later by some seconds."""

from __future__ import annotations

import numpy as np

from ariac_score.trial.events import COMPETITION_STARTED, Event
from ariac_score.trial.model import Trial
from ariac_score.trial.shift import shifted
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import Span
from ariac_score_ariac.kits import RecordedKits
from ariac_score_ariac.work import Kit, KitSubmission, Order, Product

GEAR = Product("gear_part_red")
TRIAL = Trial(
    "t",
    work=(Order("announced", announced_s=1.0), Order("configured")),
    submissions=(KitSubmission("task", 9.0),),
    events=(Event(0.5, COMPETITION_STARTED),),
    signals={"speed/human": Signal("speed/human", "m/s", np.array([0.0, 2.0]), np.array([0.1, 0.2]))},
    recorded=Span(0.0, 10.0),
    records=(RecordedKits([Kit("agv1", 8.0, (GEAR,))]),),
)


def test_every_time_is_later_and_nothing_else_changes() -> None:
    later = shifted(TRIAL, 2.5)

    assert [order.announced_s for order in later.work] == [3.5, None]
    assert [submission.submitted_s for submission in later.submissions] == [11.5]
    assert later.events == (Event(3.0, COMPETITION_STARTED),)
    assert later.signals["speed/human"].t.tolist() == [2.5, 4.5]
    assert later.signals["speed/human"].values.tolist() == [0.1, 0.2]
    assert later.recorded == Span(2.5, 12.5)


def test_a_record_of_kits_shows_them_at_the_later_time() -> None:
    (record,) = shifted(TRIAL, 2.5).records

    assert record.seen("agv1", 10.4, max_age_s=1.0) is None
    assert record.seen("agv1", 10.5, max_age_s=1.0) == Kit("agv1", 10.5, (GEAR,))


def test_a_trial_without_any_time_stays_as_it_is() -> None:
    untimed = Trial("t", work=(Order("configured"),))

    assert shifted(untimed, 2.5).work == untimed.work
    assert shifted(untimed, 2.5).recorded is None
