"""One trial from what readers find, and one from several logs; updates as in the rulebook of 2019."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ariac_score.errors import ContradictionError, LogError
from ariac_score.trial.build import LARGEST_STEP_BACK_S, TrialBuilder, merge_trials
from ariac_score.trial.clock import Clock
from ariac_score.trial.events import (
    ARM_COLLISION,
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    ORDER_ANNOUNCED,
    WATCHING,
    Event,
)
from ariac_score.trial.model import Body, LogDefect, OfficialResult, TeamSetup, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import Span
from ariac_score_ariac.competition import Ariac
from ariac_score_ariac.joining import settle_orders
from ariac_score_ariac.work import KitSubmission, Order, Product, SensorBill, Task, WantedProduct, sensor_cost

FIRST, SECOND, THIRD = Task("first"), Task("second"), Task("third")


def builder() -> TrialBuilder:
    return TrialBuilder("t", file="t.bag", clock=Clock("log time"))


def signal(name: str = "speed/human", t: tuple[float, ...] = (0.0, 1.0)) -> Signal:
    return Signal(name, "m/s", np.array(t), np.zeros(len(t)))


def merged(*parts: Trial) -> Trial:
    competition = Ariac()
    return competition.complete(merge_trials("whole", parts, file="bundle", competition=competition))


# Orders --------------------------------------------------------------------------------


def test_an_update_brings_its_tasks_and_start_and_leaves_id_and_priority() -> None:
    old = Order("order_0", (FIRST,), announced_s=1.0, priority=3)
    update = Order("order_0_update_0", (SECOND,), announced_s=9.0, priority=1, updates="order_0")

    assert settle_orders([old, update]) == (Order("order_0", (SECOND,), announced_s=9.0, priority=3),)


def test_the_last_update_wins() -> None:
    orders = [
        Order("a", (FIRST,), announced_s=1.0),
        Order("a_update_0", (SECOND,), announced_s=2.0, updates="a"),
        Order("a_update_1", (THIRD,), announced_s=3.0, updates="a"),
    ]

    assert settle_orders(orders) == (Order("a", (THIRD,), announced_s=3.0),)


def test_an_update_announced_again_with_other_tasks_is_the_last_update() -> None:
    # Rulebook, 3 Code: only the id of an announced *order* makes an update void.
    orders = [
        Order("a", (FIRST,), announced_s=1.0),
        Order("a_update", (SECOND,), announced_s=2.0, updates="a"),
        Order("a_update", (THIRD,), announced_s=3.0, updates="a"),
    ]

    assert settle_orders(orders) == (Order("a", (THIRD,), announced_s=3.0),)


def test_an_update_with_the_id_of_an_announced_order_is_ignored() -> None:
    orders = (Order("a", (FIRST,), announced_s=1.0), Order("b", (SECOND,), announced_s=2.0))
    void = Order("b", (THIRD,), announced_s=3.0, updates="a")

    assert settle_orders([*orders, void]) == orders


@pytest.mark.parametrize("named", ["b", "a_update"])
def test_an_update_that_names_no_announced_order_is_ignored(named: str) -> None:
    order = Order("a", (FIRST,), announced_s=1.0)

    assert settle_orders([order, Order("u", (SECOND,), updates=named)]) == (order,)


def test_an_order_announced_twice_counts_as_announced_first() -> None:
    first, again = Order("a", (FIRST,), announced_s=1.0), Order("a", (FIRST,), announced_s=5.0)

    assert settle_orders([first, again]) == (first,)


def test_an_order_announced_again_with_other_contents_is_refused() -> None:
    with pytest.raises(LogError, match="'a' is announced twice, with different contents"):
        settle_orders([Order("a", (FIRST,), announced_s=1.0), Order("a", (SECOND,), announced_s=5.0)])


def test_an_order_announced_again_with_another_priority_is_refused_where_both_are_said() -> None:
    once = Order("a", (FIRST,), announced_s=1.0)

    with pytest.raises(LogError, match="'a' is announced twice, with different priorities"):
        settle_orders([once, Order("a", (FIRST,), announced_s=5.0, priority=3)])
    unsaid = Order("a", (FIRST,), announced_s=5.0, priority=3, priority_said=False)
    assert settle_orders([once, unsaid]) == (once,)


@pytest.mark.parametrize(
    ("order", "what"),
    [
        (Order("a", (Task("a_0"), Task("a_0"))), "order 'a' holds two items named 'a_0'"),
        (
            Order("a", (Task("a_0", products=(WantedProduct("p", "x"),) * 2),)),
            "submission 'a_0' holds two items named 'p'",
        ),
    ],
)
def test_an_order_in_which_two_things_have_one_name_is_refused(order: Order, what: str) -> None:
    with pytest.raises(LogError, match=what):
        builder().add(order)


def _course(*times: float | None, submitted: tuple[float, ...] = (5.0,)) -> Trial:
    start, end = times
    events = [] if start is None else [Event(start, COMPETITION_STARTED)]
    events += [] if end is None else [Event(end, COMPETITION_ENDED)]
    orders = (Order("a", (Task("a_0"),), announced_s=1.0),)
    submissions = tuple(KitSubmission("a_0", t_s) for t_s in submitted)
    return Trial("t", work=orders, submissions=submissions, events=tuple(events), recorded=Span(0.0, 20.0))


@pytest.mark.parametrize(
    ("start", "end", "kept"),
    [(2.0, 10.0, [5.0]), (5.0, 10.0, [5.0]), (2.0, 5.0, [5.0]), (6.0, 10.0, []), (2.0, 4.0, [])],
)
def test_submissions_outside_the_competition_are_refused_and_counted(
    start: float, end: float, kept: list[float]
) -> None:
    whole = merged(_course(start, end))

    assert [s.submitted_s for s in whole.submissions] == kept
    assert ("outside_competition" in {d.kind for d in whole.log_defects}) is (not kept)


@pytest.mark.parametrize(("start", "end"), [(None, None), (9.0, 9.0), (9.0, 3.0)])
def test_a_competition_without_a_window_is_watched_whole_and_said_to_be(
    start: float | None, end: float | None
) -> None:
    whole = merged(_course(start, end))

    assert whole.window == Span(0.0, 20.0)
    assert "no_window" in {d.kind for d in whole.log_defects}
    assert len(whole.submissions) == 1


def test_submissions_that_repeat_or_answer_nothing_are_counted() -> None:
    course = _course(2.0, 10.0, submitted=(5.0, 6.0))
    stray = replace(course, submissions=(*course.submissions, KitSubmission("nobodys", 7.0)))

    defects = {d.kind: d.count for d in merged(stray).log_defects}
    assert defects == {"repeated_submission": 1, "unknown_shipment": 1}


def test_an_updated_order_keeps_its_place_among_the_orders() -> None:
    orders = [Order("a"), Order("b"), Order("a_update", (FIRST,), updates="a")]

    assert [order.id for order in settle_orders(orders)] == ["a", "b"]


# Building ------------------------------------------------------------------------------


def test_an_announced_order_makes_an_event_and_one_without_a_time_does_not() -> None:
    found = builder()
    found.add(Order("order_0", announced_s=4.0))
    found.add(Order("order_1"))

    assert found.build().events == (Event(4.0, ORDER_ANNOUNCED, "order_0"),)


def test_what_the_recorder_watches_for_is_witnessed_and_no_event() -> None:
    found = builder()
    found.add(Event(0.0, WATCHING, ARM_COLLISION))

    assert found.build().witnessed == {ARM_COLLISION}
    assert found.build().events == ()


def test_everything_comes_in_order_of_time_and_events_once() -> None:
    found = builder()
    for t_s in (5.0, 1.0, 5.0):
        found.add(Event(t_s, ARM_COLLISION))
        found.add(KitSubmission("task", t_s))

    trial = found.build()
    assert [event.t_s for event in trial.events] == [1.0, 5.0]
    assert [submission.submitted_s for submission in trial.submissions] == [1.0, 5.0, 5.0]


def test_the_recording_spans_everything_with_a_time_unless_the_reader_knows_better() -> None:
    found = builder()
    found.add_signal("speed/human", "m/s", np.array([2.0, 3.0]), np.zeros(2))
    found.add(Event(1.0, ARM_COLLISION))
    found.add(KitSubmission("task", 7.0))
    assert found.build().recorded == Span(1.0, 7.0)

    found.recorded = Span(0.0, 9.0)
    assert found.build().recorded == Span(0.0, 9.0)
    assert builder().build().recorded is None


def test_samples_that_had_to_be_settled_are_counted_as_defects_of_their_signal() -> None:
    found = builder()
    t = np.array([0.0, 0.2, 0.1, 0.3, 0.3, 0.4])
    found.add_signal("speed/human", "m/s", t, np.array([0.0, 1.0, 2.0, 3.0, 4.0, np.nan]))

    trial = found.build()
    # The two samples of 0.3 s contradict each other, so neither counts.
    assert trial.signals["speed/human"].t.tolist() == [0.0, 0.1, 0.2]
    assert trial.signals["speed/human"].values.tolist() == [0.0, 2.0, 1.0]
    assert [(d.kind, d.where, d.count) for d in trial.log_defects] == [
        ("contradicting_stamps", "speed/human", 1),
        ("disordered_stamps", "speed/human", 1),
        ("impossible_values", "speed/human", 1),
        ("repeated_stamps", "speed/human", 1),
    ]


@pytest.mark.parametrize("name", ["speed/human", "centre_distance/robot/human", "separation/robot/human"])
def test_a_negative_speed_or_distance_is_a_gap_and_no_measurement(name: str) -> None:
    found = builder()
    found.add_signal(name, "m", np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, -1e-9, -5.0, 2e9]))

    trial = found.build()
    assert trial.signals[name].values.tolist() == [0.0]
    assert [(d.kind, d.count) for d in trial.log_defects] == [("impossible_values", 3)]


def test_a_sound_signal_has_no_defects() -> None:
    found = builder()
    found.add_signal("speed/human", "m/s", np.array([0.0, 1.0]), np.zeros(2))

    assert found.build().log_defects == ()


def test_defects_of_one_kind_and_place_add_up() -> None:
    found = builder()
    for count in (2, 0, 3):
        found.defect("cut", "/tf", count, "words")

    assert found.build().log_defects == (LogDefect("cut", "/tf", 5, "words"),)


def test_a_signal_without_a_usable_sample_is_absent() -> None:
    found = builder()
    found.add_signal("speed/human", "m/s", np.array([0.0, 1.0]), np.array([np.nan, np.inf]))
    found.add_signal("speed/robot", "m/s", np.zeros(0), np.zeros(0))

    assert dict(found.build().signals) == {}
    assert [d.count for d in found.build().log_defects] == [2]


def test_time_may_run_back_a_little_and_no_further() -> None:
    back = LARGEST_STEP_BACK_S
    builder().add_signal("s", "m", np.array([back, 0.0]), np.zeros(2))

    with pytest.raises(LogError, match=r"time runs backwards by 1\.000 s in signal 's'") as refused:
        builder().add_signal("s", "m", np.array([np.nextafter(back, 2.0), 0.0]), np.zeros(2))
    assert refused.value.file == "t.bag"
    assert "two recordings" in refused.value.hint


def test_a_signal_recorded_twice_is_refused() -> None:
    found = builder()
    found.add_signal("s", "m", np.zeros(1), np.zeros(1))

    with pytest.raises(LogError, match="'s' is recorded twice") as refused:
        found.add_signal("s", "m", np.ones(1), np.ones(1))
    assert "log map" in refused.value.hint


def test_the_links_of_a_body_seen_twice_are_joined() -> None:
    found = builder()
    found.add_body(Body("gantry", "robot", 0.3, ("torso",)))
    found.add_body(Body("gantry", "robot", 0.3, ("hand", "torso")))

    assert found.build().bodies == (Body("gantry", "robot", 0.3, ("hand", "torso")),)


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (Body("gantry", "agv", 0.3), "'gantry' is both of kind 'robot' and of kind 'agv'"),
        (Body("gantry", "robot", 0.4), "'gantry' is described twice, with different radii"),
    ],
)
def test_a_body_described_twice_differently_is_refused(other: Body, told: str) -> None:
    known = Body("gantry", "robot", 0.3)
    found = builder()
    found.add_body(known)

    with pytest.raises(LogError, match=told):
        found.add_body(other)
    with pytest.raises(LogError, match=told) as refused:
        merged(Trial("a", bodies=(known,)), Trial("b", bodies=(other,)))
    assert refused.value.file == "bundle"


# Merging -------------------------------------------------------------------------------


def test_events_bodies_defects_and_witnesses_of_several_logs_add_up() -> None:
    a = Trial(
        "a",
        events=(Event(2.0, ARM_COLLISION),),
        bodies=(Body("r", "robot", links=("torso",)),),
        witnessed=frozenset({"submissions"}),
        log_defects=(LogDefect("cut", "b", 1, ""),),
        recorded=Span(0.0, 5.0),
    )
    b = Trial(
        "b",
        events=(Event(1.0, COMPETITION_STARTED), Event(2.0, ARM_COLLISION)),
        bodies=(Body("h", "human"), Body("r", "robot", links=("hand",))),
        witnessed=frozenset({ARM_COLLISION}),
        log_defects=(LogDefect("cut", "a", 1, ""),),
        recorded=Span(1.0, 9.0),
    )

    whole = merged(a, b)

    assert whole.id == "whole"
    assert [event.t_s for event in whole.events] == [1.0, 2.0]
    assert whole.bodies == (Body("h", "human"), Body("r", "robot", links=("hand", "torso")))
    assert whole.witnessed == {"submissions", ARM_COLLISION}
    assert [defect.where for defect in whole.log_defects] == ["a", "b"]
    assert whole.recorded == Span(0.0, 9.0)


ORDERS = (Order("a", (FIRST,), announced_s=1.0),)
SUBMITTED = (KitSubmission("task", 1.0, (Product("gear"),)),)


@pytest.mark.parametrize(
    ("one", "other", "what"),
    [
        (
            Trial("a", work=ORDERS),
            Trial("b", work=(Order("a", (SECOND,), announced_s=1.0),)),
            "orders",
        ),
        (
            Trial("a", submissions=SUBMITTED),
            Trial("b", submissions=(KitSubmission("task", 2.0, (Product("gear"),)),)),
            "submissions",
        ),
        (Trial("a", team=TeamSetup("x")), Trial("b", team=TeamSetup("y")), "a team set-up"),
        (
            Trial("a", official=OfficialResult("a", 1.0, None)),
            Trial("b", official=OfficialResult("a", 2.0, None)),
            "an official result",
        ),
    ],
)
def test_two_logs_that_tell_one_thing_differently_are_refused(one: Trial, other: Trial, what: str) -> None:
    with pytest.raises(LogError, match=f"2 logs hold {what}, and they differ") as refused:
        merged(one, other)
    assert refused.value.file == "bundle"
    assert "one trial" in refused.value.hint


def test_two_logs_that_tell_the_same_agree() -> None:
    one = Trial("a", work=ORDERS, submissions=SUBMITTED, team=TeamSetup("x"))
    other = Trial("b", work=ORDERS, submissions=SUBMITTED, team=TeamSetup("x"))

    whole = merged(one, other)

    assert (whole.work, whole.submissions, whole.team) == (ORDERS, SUBMITTED, TeamSetup("x"))


def test_two_logs_with_one_signal_are_refused_even_if_they_agree() -> None:
    parts = [Trial(name, signals={"speed/human": signal()}) for name in "ab"]

    with pytest.raises(LogError, match="two logs record the signal 'speed/human'"):
        merged(*parts)


def test_an_order_without_a_time_takes_it_from_its_first_announcement() -> None:
    configured = Trial("a", work=(Order("a", (FIRST,)), Order("b", (SECOND,))))
    log = Trial("b", events=(Event(7.0, ORDER_ANNOUNCED, "a"), Event(3.0, ORDER_ANNOUNCED, "a")))

    assert [(o.id, o.announced_s) for o in merged(configured, log).work] == [("a", 3.0), ("b", None)]


def test_a_configured_update_counts_only_if_it_was_announced() -> None:
    configured = Trial("a", work=(Order("a", (FIRST,)), Order("a_update", (SECOND,), updates="a")))
    announced = Event(1.0, ORDER_ANNOUNCED, "a"), Event(6.0, ORDER_ANNOUNCED, "a_update")

    (quiet,) = merged(configured, Trial("b", events=announced[:1])).work
    (updated,) = merged(configured, Trial("b", events=announced)).work

    assert (quiet.tasks, quiet.announced_s) == ((FIRST,), 1.0)
    assert (updated.tasks, updated.announced_s) == ((SECOND,), 6.0)


def test_orders_that_are_announced_otherwise_than_configured_are_refused_with_both_files() -> None:
    configured = Trial("a", work=(Order("a", (SECOND,)), Order("b", (THIRD,))))

    with pytest.raises(ContradictionError) as refused:
        merged(configured, Trial("b", work=ORDERS))
    assert refused.value.cause == (
        "shipment 'second' of order 'a': 'a' says it has one, 'b' says it has none of that name"
    )


def test_submissions_with_contents_stand_before_those_without() -> None:
    text = Trial("a", submissions=(KitSubmission("task", 30.0),))

    assert merged(text, Trial("b", submissions=SUBMITTED)).submissions == SUBMITTED


def test_a_log_on_another_clock_keeps_what_needs_no_time() -> None:
    motion = Trial(
        "bag", signals={"speed/human": signal()}, recorded=Span(0.0, 50.0), clocks=(Clock("log time", 7),)
    )
    text = Trial(
        "text",
        events=(Event(900.0, ARM_COLLISION), Event(800.0, COMPETITION_STARTED)),
        submissions=(KitSubmission("task", 950.0),),
        recorded=Span(800.0, 950.0),
        clocks=(Clock("simulated time"),),
    )

    whole = merged(motion, text)

    assert whole.events == (Event(50.0, ARM_COLLISION),)
    assert [s.submitted_s for s in whole.submissions] == [50.0]
    assert whole.started_s is None
    assert whole.recorded == Span(0.0, 50.0)
    assert ("other_clock", "text", 3) in [(d.kind, d.where, d.count) for d in whole.log_defects]


@pytest.mark.slow
def test_an_order_of_very_many_products_is_taken_at_once() -> None:
    """Looking for each slot among all others would take hours."""
    products = tuple(WantedProduct(f"part_{number}", "gear") for number in range(300_000))
    taken = builder()

    taken.add(Order("order_0", (Task("shipment", products=products),)))
    with pytest.raises(LogError, match="two items named 'part_299999'"):
        taken.add(Order("order_1", (Task("shipment", products=(*products, products[-1])),)))

    assert [order.id for order in taken.work] == ["order_0"]


def test_logs_that_count_from_their_own_first_stamp_are_counted_from_that_of_the_motion() -> None:
    s_in_ns = 10**9
    motion = Trial(
        "motion",
        signals={"speed/human": signal()},
        recorded=Span(0.0, 50.0),
        clocks=(Clock("log time", 1_700_000_000 * s_in_ns),),
    )
    task = Trial(
        "task",
        work=(replace(ORDERS[0], announced_s=1.0),),
        submissions=(KitSubmission("task", 30.0),),
        events=(Event(2.0, COMPETITION_STARTED),),
        recorded=Span(0.0, 40.0),
        clocks=(Clock("log time", 1_700_000_003 * s_in_ns),),
    )

    whole = merged(motion, task)

    assert (whole.started_s, whole.work[0].announced_s) == (5.0, 4.0)
    assert [s.submitted_s for s in whole.submissions] == [33.0]
    assert whole.recorded == Span(0.0, 50.0)
    assert whole.clock == "log time, origin 1700000000000000000 ns"


def test_one_clock_is_named_once_with_the_most_that_is_known_of_it() -> None:
    plain = Trial("a", recorded=Span(0.0, 50.0), clocks=(Clock("simulated time"),))
    text = Trial("b", recorded=Span(0.0, 9.0), clocks=(Clock("simulated time", detail="by whole seconds"),))

    assert merged(plain, text).clock == "simulated time (by whole seconds)"
    assert merged(text, plain).clock == "simulated time (by whole seconds)"


def test_the_clock_of_the_times_stands_before_one_of_a_log_without_times() -> None:
    untimed = Trial("a", clocks=(Clock("competition time"),))
    timed = Trial("b", recorded=Span(0.0, 50.0), clocks=(Clock("log time", 7),))

    whole = merged(untimed, timed)

    assert whole.clocks[0] == Clock("log time", 7)
    assert whole.clock == "competition time; log time, origin 7 ns"


def test_a_known_origin_counts_for_a_log_that_gives_none() -> None:
    given = Trial("a", recorded=Span(0.0, 50.0), clocks=(Clock("log time", 7),))
    without = Trial("b", recorded=Span(0.0, 50.0), clocks=(Clock("log time"),))

    assert merged(without, given).clocks[0] == merged(given, without).clocks[0] == Clock("log time", 7)


@pytest.mark.parametrize(
    "text",
    [
        "simulated time",
        "log time, origin 0 ns",
        "log time, origin 1700000000000000000 ns (as recorded)",
        "log time, origin 007 ns",
        "by hand, roughly",
        "a (b",
        "a ()",
        ", origin 5 ns",
        " (x)",
        "two\nlines (and\nmore)",
    ],
)
def test_a_clock_that_a_file_names_keeps_its_words(text: str) -> None:
    assert str(Clock.parse(text)) == text


def test_without_any_motion_the_times_of_the_log_with_the_contents_count() -> None:
    text = Trial(
        "a",
        events=(Event(800.0, COMPETITION_STARTED),),
        recorded=Span(800.0, 950.0),
        clocks=(Clock("simulated time"),),
    )
    log = Trial(
        "b",
        events=(Event(1.0, COMPETITION_STARTED),),
        submissions=SUBMITTED,
        recorded=Span(0.0, 50.0),
        clocks=(Clock("log time", 7),),
    )

    assert merged(text, log).started_s == 1.0
    assert merged(log, text).started_s == 1.0


def test_one_log_merges_to_itself() -> None:
    alone = Trial("a", work=ORDERS, signals={"speed/human": signal()}, recorded=Span(0.0, 1.0))

    whole = merged(alone)

    assert (whole.work, dict(whole.signals), whole.recorded) == (
        alone.work,
        dict(alone.signals),
        alone.recorded,
    )


def test_sensors_of_a_configuration_and_their_cost_of_a_record_make_one_team() -> None:
    configured = Trial("a", team=TeamSetup(sensors={"camera": "rgb_camera"}))
    recorded = Trial("b", records=(SensorBill(300.0),))

    whole = merged(configured, recorded)

    assert whole.team == TeamSetup(sensors={"camera": "rgb_camera"})
    assert sensor_cost(whole) == 300.0


def test_two_records_of_different_cost_are_refused() -> None:
    with pytest.raises(LogError, match="a sensor cost"):
        merged(Trial("a", records=(SensorBill(1.0),)), Trial("b", records=(SensorBill(2.0),)))


def test_numbers_of_several_files_are_united() -> None:
    configured = Trial("trial", facts={"time_limit_s": 600.0, "num_kits": 2.0})
    recorded = Trial("run", facts={"time_limit_s": 600.0, "duration_s": 512.25})

    whole = merged(configured, recorded)

    assert list(whole.facts.items()) == [("duration_s", 512.25), ("num_kits", 2.0), ("time_limit_s", 600.0)]


def test_numbers_that_contradict_each_other_are_refused_with_both_files() -> None:
    configured = Trial("trial_1", facts={"time_limit_s": 600.0})
    recorded = Trial(
        "LHAF9835", facts={"time_limit_s": 601.0}, official=OfficialResult("results.db", None, None)
    )

    with pytest.raises(LogError) as caught:
        merged(configured, recorded)

    assert caught.value.cause == "time_limit_s: 'trial_1' says 600, 'results.db' says 601"
    assert caught.value.file == "bundle"
    assert caught.value.hint


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_fact_that_is_no_number_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="must be finite"):
        Trial("a", facts={"time_limit_s": value})


def test_no_sensors_is_not_the_same_as_none_known() -> None:
    unknown, placed_none = Trial("a", team=TeamSetup("x")), Trial("b", team=TeamSetup(sensors={}))

    assert merged(unknown).team == TeamSetup("x")
    assert merged(unknown, placed_none).team == TeamSetup("x", {})


def test_sensors_are_named_as_configured_when_a_record_counts_the_same() -> None:
    configured = Trial("a", team=TeamSetup(sensors={"front": "lidar", "back": "rgb_camera"}))
    recorded = Trial("b", records=(SensorBill(600.0, {"lidar_1": "lidar", "rgb_camera_1": "rgb_camera"}),))

    whole = merged(configured, recorded)

    assert (whole.team, sensor_cost(whole)) == (
        TeamSetup("", {"front": "lidar", "back": "rgb_camera"}),
        600.0,
    )
    assert not [d for d in whole.log_defects if d.kind == "other_sensors"]


def test_a_record_that_counts_other_sensors_than_configured_is_named() -> None:
    configured = Trial("a", team=TeamSetup(sensors={"front": "lidar"}))
    recorded = Trial("b", records=(SensorBill(300.0, {"rgb_camera_1": "rgb_camera"}),))

    whole = merged(configured, recorded)

    assert (whole.team, sensor_cost(whole)) == (TeamSetup("", {"front": "lidar"}), 300.0)
    assert [d.where for d in whole.log_defects if d.kind == "other_sensors"] == ["team"]


def test_two_configurations_with_other_sensors_are_refused() -> None:
    with pytest.raises(LogError, match="a team set-up"):
        merged(Trial("a", team=TeamSetup(sensors={})), Trial("b", team=TeamSetup(sensors={"a": "lidar"})))
