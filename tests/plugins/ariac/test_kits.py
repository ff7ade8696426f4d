"""Contents joined to submissions: by place and time, never older than allowed, never assumed sound."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ariac_score.errors import ContradictionError
from ariac_score.trial.build import TrialBuilder, merge_trials
from ariac_score.trial.clock import Clock
from ariac_score.trial.events import COMPETITION_STARTED, Event
from ariac_score.trial.model import Pose, Trial
from ariac_score.trial.signals import Signal
from ariac_score_ariac.competition import Ariac
from ariac_score_ariac.joining import with_irregularities
from ariac_score_ariac.kits import RecordedKits, with_contents
from ariac_score_ariac.work import Kit, KitSubmission, Order, Product, Task, Tray, WantedProduct

GEAR = Product("gear_part_red", Pose((0.1, 0.0, 0.0)), name="bin1|gear_part_red_7")
ROD = Product("piston_rod_part_blue", Pose((0.0, 0.1, 0.0)))
KIT = Task("order_0_shipment_0", "kitting", (WantedProduct("part_0", "gear_part_red"),), "agv1")
SUBMITTED = KitSubmission("order_0_shipment_0", 10.0, agv="agv1")


def trial(*kits: Kit, task: Task = KIT, submission: KitSubmission = SUBMITTED) -> Trial:
    return Trial(
        "t",
        work=(Order("order_0", (task,), 1.0),),
        submissions=(submission,),
        records=(RecordedKits(kits),),
    )


def contents(of: Trial, *, max_age_s: float = 1.0) -> tuple[Product, ...] | None:
    (submission,) = with_contents(of, max_age_s=max_age_s).submissions
    return submission.contents


def test_a_submission_takes_the_last_contents_recorded_of_its_agv() -> None:
    kits = [Kit("agv1", 9.9, (GEAR,)), Kit("agv1", 9.8, ()), Kit("agv2", 10.0, (ROD,))]

    assert contents(trial(*kits)) == (GEAR,)


def test_contents_recorded_after_the_submission_do_not_count() -> None:
    later = float(np.nextafter(10.0, math.inf))

    assert contents(trial(Kit("agv1", 9.5, (GEAR,)), Kit("agv1", later, (GEAR, ROD)))) == (GEAR,)
    assert contents(trial(Kit("agv1", 9.5, (GEAR,)), Kit("agv1", 10.0, (GEAR, ROD)))) == (GEAR, ROD)
    assert contents(trial(Kit("agv1", later, (GEAR,)))) is None


def test_contents_are_at_most_as_old_as_allowed() -> None:
    assert contents(trial(Kit("agv1", 9.0, (GEAR,)))) == (GEAR,)
    assert contents(trial(Kit("agv1", float(np.nextafter(9.0, 0.0)), (GEAR,)))) is None
    assert contents(trial(Kit("agv1", 8.0, (GEAR,))), max_age_s=2.0) == (GEAR,)


def test_an_empty_tray_is_known_to_be_empty() -> None:
    assert contents(trial(Kit("agv1", 10.0, ()))) == ()


def test_contents_of_another_agv_say_nothing() -> None:
    assert contents(trial(Kit("agv2", 10.0, (GEAR,)))) is None


def test_a_submission_from_nowhere_stays_unknown() -> None:
    assert contents(trial(Kit("agv1", 10.0, (GEAR,)), submission=replace(SUBMITTED, agv=""))) is None


def test_a_submission_that_brings_its_contents_keeps_them() -> None:
    brought = replace(SUBMITTED, contents=(ROD,))

    assert contents(trial(Kit("agv1", 10.0, (GEAR,)), submission=brought)) == (ROD,)


def test_an_assembly_is_looked_for_at_its_station() -> None:
    submission = replace(SUBMITTED, agv="agv1", station="as2")
    kits = [Kit("agv1", 10.0, (ROD,)), Kit("as2", 10.0, (GEAR,))]

    assert contents(trial(*kits, task=replace(KIT, kind="assembly"), submission=submission)) == (GEAR,)


def test_the_tray_comes_with_the_contents_unless_the_submission_named_one() -> None:
    kit = Kit("agv1", 10.0, (GEAR,), Tray("movable_tray_dark_wood"))
    (joined,) = with_contents(trial(kit), max_age_s=1.0).submissions
    named = replace(SUBMITTED, tray=Tray("movable_tray_light_wood"))
    (kept,) = with_contents(trial(kit, submission=named), max_age_s=1.0).submissions

    assert joined.tray == Tray("movable_tray_dark_wood")
    assert kept.tray == Tray("movable_tray_light_wood")


def test_that_contents_were_joined_is_a_remark() -> None:
    (defect,) = with_contents(trial(Kit("agv1", 10.0, (GEAR,))), max_age_s=1.0).log_defects

    assert (defect.kind, defect.count) == ("joined_contents", 1)
    assert not with_contents(trial(), max_age_s=1.0).log_defects


# Faults


def never_known(_contents: tuple[Product, ...], _trial: Trial, _task: Task | None) -> None:
    """A competition whose trial does not say which products are faulty."""


def by_task(contents: tuple[Product, ...], trial: Trial, task: Task | None) -> tuple[Product, ...]:
    """A competition that marks what lies on the first order's tray."""
    faulty = task is not None and task in trial.work[0].tasks
    return tuple(replace(product, faulty=faulty) for product in contents)


def test_products_are_not_taken_as_sound_where_nothing_says_which_are_faulty() -> None:
    joined = with_contents(trial(Kit("agv1", 10.0, (GEAR,), faults=never_known)), max_age_s=1.0)

    assert joined.submissions[0].contents is None
    assert joined.unrecorded == (
        "which products of order_0_shipment_0 are faulty: its tray is seen, but no trial configuration tells",
    )
    assert not joined.log_defects


def test_the_competition_marks_products_by_the_trial_and_the_task() -> None:
    seen = Kit("agv1", 10.0, (GEAR,), faults=by_task)

    assert contents(trial(seen)) == (replace(GEAR, faulty=True),)
    assert contents(trial(seen, submission=replace(SUBMITTED, item_id="another"))) == (GEAR,)


# Several logs


def part(name: str, clock: str) -> TrialBuilder:
    builder = TrialBuilder(name, file=name, clock=Clock(clock))
    builder.events.append(Event(0.0, COMPETITION_STARTED))
    return builder


def joined(trial_id: str, parts: list[Trial], *, file: str) -> Trial:
    return with_irregularities(merge_trials(trial_id, parts, file=file, competition=Ariac()))


def logs(clock: str) -> list[Trial]:
    motion, task = part("motion", "simulated time"), part("task", clock)
    t = np.array([0.0, 20.0])
    motion.signals["position/gantry"] = Signal("position/gantry", "m", t, np.zeros((2, 3)))
    motion.add(Kit("agv1", 9.5, (GEAR,)))
    task.add(Order("order_0", (KIT,), 1.0))
    task.add(SUBMITTED)
    return [motion.build(), task.build()]


def test_contents_of_one_log_are_joined_to_submissions_of_another() -> None:
    assert contents(joined("t", logs("simulated time"), file="t")) == (GEAR,)


def test_nothing_is_joined_across_clocks() -> None:
    assert contents(joined("t", logs("log time"), file="t"), max_age_s=100.0) is None


def test_an_announced_order_takes_what_its_message_cannot_say_from_the_configuration() -> None:
    def of(challenged: bool | None, **order: int | float | bool) -> Trial:
        wanted = WantedProduct("part_0", "pump_red", None, 2, challenged=challenged)
        task = Task("A", "kitting", (wanted,), "agv1")
        return Trial("t", work=(Order("A", (task,), **order),))  # type: ignore[arg-type]

    parts = [of(None, announced_s=3.0, priority_said=False), of(True, priority=3)]
    (order,) = joined("t", parts, file="t").work

    assert (order.announced_s, order.priority) == (3.0, 3)
    assert order.tasks[0].products[0].challenged is True


def test_a_configured_order_of_other_contents_is_refused() -> None:
    announced = WantedProduct("part_0", "pump_red", None, 2)
    configured = WantedProduct("part_0", "pump_red", None, 3, challenged=True)
    parts = [
        Trial("t", work=(Order("A", (Task("A", products=(wanted,)),), announced_s),))
        for wanted, announced_s in ((announced, 3.0), (configured, None))
    ]

    with pytest.raises(
        ContradictionError, match="says pump_red in quadrant 3, 't' says pump_red in quadrant 2"
    ):
        joined("t", parts, file="t")


def test_a_priority_that_nothing_says_is_named() -> None:
    order = Order("order_0", (KIT,), 1.0, priority_said=False)
    (defect,) = (
        d for d in joined("t", [Trial("t", work=(order,))], file="t").log_defects if "prio" in d.kind
    )

    assert (defect.kind, defect.count) == ("priority_unknown", 1)
