"""A competition whose start and end a topic states at its rate: each lies between two of its messages.

The near miss of the example lasts from 18.805 s to 21.205 s; its orders come at 1 s and at 8 s, and what was
asked for is handed in at 14 s and at 31 s. What exact ends give is the measure of those that are not exact.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest

from ariac_score import (
    ARM_COLLISION,
    COMPETITION_ENDED,
    COMPETITION_STARTED,
    Event,
    Result,
    Trial,
    load_rule_set,
    measure_trial,
    price_trial,
)
from ariac_score.engine.prepared import prepare
from ariac_score.results.result import Pinned, Provenance
from ariac_score.trial.spans import Span
from ariac_score.trial.window import (
    RECORDING,
    ends_of,
    lasted_of,
    stated_late,
    stated_on,
    surely_of,
    with_window,
)
from ariac_score_ariac.testing import kitting_trial

PAPER = load_rule_set("paper2020.published")
PREPARED = prepare(PAPER)
TRIAL = kitting_trial()
PROVENANCE = Provenance((), (), Pinned(PAPER.id, PAPER.sha256), Pinned("ariac2020", "0" * 64), ())


def at(started_s: float, ended_s: float, *, late_s: tuple[float, float] = (0.0, 0.0)) -> Trial:
    """The example, without work, as a competition that is stated so much too late at most."""
    ends = (Event(started_s, COMPETITION_STARTED), Event(ended_s, COMPETITION_ENDED))
    stated = [stated_late(one, by_s) if by_s else one for one, by_s in zip(ends, late_s, strict=True)]
    return replace(TRIAL, work=(), submissions=(), events=tuple(stated))


def scored(trial: Trial) -> Result:
    return price_trial(measure_trial(trial, PREPARED), PAPER, PROVENANCE)


def time_in_violation_s(trial: Trial) -> float:
    found = measure_trial(trial, PREPARED).of("separation").values()
    return sum(finding.quantities["time_in_violation_s"] for finding in found)


def open_times_s(trial: Trial) -> tuple[float, float]:
    (one,) = (one for one in measure_trial(trial, PREPARED).open if one.check == "separation")
    best, worst = (
        sum(finding.quantities["time_in_violation_s"] for finding in world.values())
        for world in (one.best, one.worst)
    )
    return best, worst


@pytest.mark.parametrize(
    ("started_s", "ended_s", "late_s"),
    [(10.0, 20.0, (0.0, 0.4)), (20.0, 30.0, (0.4, 0.0)), (19.5, 20.5, (0.3, 0.2))],
)
def test_a_violation_at_an_uncertain_end_lasts_as_long_as_the_competition_may_have(
    started_s: float, ended_s: float, late_s: tuple[float, float]
) -> None:
    shortest, longest = at(started_s, ended_s - late_s[1]), at(started_s - late_s[0], ended_s)

    assert open_times_s(at(started_s, ended_s, late_s=late_s)) == pytest.approx(
        (time_in_violation_s(shortest), time_in_violation_s(longest)), abs=1e-9
    )
    assert time_in_violation_s(longest) - time_in_violation_s(shortest) == pytest.approx(
        sum(late_s), abs=0.02
    )


def test_the_score_lies_between_those_of_the_longest_and_the_shortest_competition() -> None:
    # The last submission is before the near miss: only the ends differ.
    trial = replace(TRIAL, submissions=TRIAL.submissions[:1])
    announced = [event for event in trial.events if event.kind == "order_announced"]

    def ended(*ends: Event) -> Trial:
        return replace(trial, events=(Event(0.5, COMPETITION_STARTED), *announced, *ends))

    exact = [scored(ended(Event(t_s, COMPETITION_ENDED))).score for t_s in (20.0, 19.6)]
    found = scored(ended(stated_late(Event(20.0, COMPETITION_ENDED), 0.4)))

    assert found.interval is not None
    assert [found.interval.least, found.interval.most] == exact
    assert found.score == found.interval.least < found.interval.most
    (narrows,) = found.interval.narrowing
    assert narrows.cause == "the log tells only roughly when the competition was: its end within 400 ms"


def test_ends_at_which_nothing_happens_cost_nothing() -> None:
    exact = [e for e in TRIAL.events if e.kind not in (COMPETITION_STARTED, COMPETITION_ENDED)]
    ends = (
        stated_late(Event(0.5, COMPETITION_STARTED), 0.1),
        stated_late(Event(38.0, COMPETITION_ENDED), 0.1),
    )
    trial = replace(TRIAL, events=(*exact, *ends))

    assert ends_of(trial) is not None
    assert scored(trial).interval is None
    assert scored(trial).score == scored(TRIAL).score


def test_stated_exactly_it_has_no_width() -> None:
    assert ends_of(TRIAL) is None


def test_what_was_announced_was_in_the_competition_and_a_team_may_call_at_any_time() -> None:
    trial = at(15.0, 32.0, late_s=(2.0, 3.0))
    (first, last) = TRIAL.submissions  # at 14 s and at 31 s
    handed_in = ends_of(replace(trial, submissions=(first, last)))
    announced = ends_of(replace(trial, work=TRIAL.work[:1]))  # at 1 s, which opens the competition

    assert handed_in is not None
    assert (handed_in.start.start_s, handed_in.start.end_s) == (13.0, 15.0)
    assert (handed_in.end.start_s, handed_in.end.end_s) == (29.0, 32.0)
    assert announced is not None
    assert announced.start.duration_s == 0.0


def test_one_log_that_states_an_end_exactly_is_enough() -> None:
    trial = at(1.0, 30.0, late_s=(0.0, 0.1))

    assert ends_of(replace(trial, events=(*trial.events, Event(30.0, COMPETITION_ENDED)))) is None


@pytest.mark.parametrize(
    ("hit_s", "worlds"),
    [(29.95, (0, 1)), (29.5, None), (30.05, None)],
    ids=["at the edge", "in it", "after it"],
)
def test_a_collision_counts_at_worst_where_the_competition_may_have_been_over(
    hit_s: float, worlds: Sequence[int] | None
) -> None:
    trial = at(1.0, 30.0, late_s=(0.0, 0.1))
    trial = replace(trial, events=(*trial.events, Event(hit_s, ARM_COLLISION)))

    found = [one for one in measure_trial(trial, PREPARED).open if one.check == "no_arm_collision"]
    violated = [
        tuple(sum(f.verdict.value == "violated" for f in world.values()) for world in (one.best, one.worst))
        for one in found
    ]
    assert violated == ([] if worlds is None else [tuple(worlds)])


START, END = Event(0.5, COMPETITION_STARTED), Event(38.0, COMPETITION_ENDED)


@pytest.mark.parametrize(
    ("ends", "lasts_s"),
    [
        ((START, END), None),  # stated exactly
        ((stated_late(START, 0.3), stated_late(END, 0.1)), (37.4, 37.8)),
        # Stated late by more than it was before the first order, at 1 s: it had started then.
        ((stated_late(Event(2.0, COMPETITION_STARTED), 1.5), END), (37.0, 37.5)),
        # Nobody says when it ended: work was announced at 1 s and 8 s; a team may call after the end.
        ((START,), (7.5, None)),
        ((END,), (37.0, None)),
        ((), (7.0, None)),
        ((Event(38.0, COMPETITION_STARTED), Event(0.5, COMPETITION_ENDED)), (0.0, None)),
    ],
    ids=["exact", "at a rate", "before the first order", "no end", "no start", "neither", "turned round"],
)
def test_how_long_it_lasted_is_known_as_far_as_its_ends_are(
    ends: Sequence[Event], lasts_s: tuple[float, float | None] | None
) -> None:
    trial = with_window(replace(TRIAL, events=tuple(sorted(ends)), window_open=""), "")

    found = lasted_of(trial)

    assert (None if found is None else (found.least_s, found.most_s)) == (
        None if lasts_s is None else pytest.approx(lasts_s)
    )


@pytest.mark.parametrize(
    ("ends", "sure_s"),
    [
        ((START,), (0.5, 8.0)),
        ((stated_on(START, 35.0),), (0.5, 35.5)),  # so long the log says that it runs
        ((Event(13.0, COMPETITION_STARTED),), (1.0, 13.0)),  # work that is announced before opens it
        ((END,), (1.0, 38.0)),
        ((stated_late(END, 5.0),), (1.0, 33.0)),  # at some moment since the word before
        ((stated_late(END, 9.0),), (1.0, 29.0)),  # whoever handed in at 31 s may have been late
        ((), (1.0, 8.0)),
        ((Event(38.0, COMPETITION_STARTED), Event(0.5, COMPETITION_ENDED)), None),
        ((Event(21.0, COMPETITION_STARTED), Event(0.2, COMPETITION_ENDED)), None),
    ],
    ids=[
        "no end",
        "it runs",
        "announced before",
        "no start",
        "an end that came late",
        "before a late call",
        "neither",
        "turned round",
        "a stale end",
    ],
)
def test_certainly_within_is_what_lies_between_what_is_known_to_have_been(
    ends: Sequence[Event], sure_s: tuple[float, float] | None
) -> None:
    trial = with_window(replace(TRIAL, events=tuple(sorted(ends)), window_open=""), "")

    assert surely_of(trial) == (None if sure_s is None else Span(*sure_s))


def scores_between(trial: Trial) -> tuple[float, float]:
    found = scored(with_window(replace(trial, window_open=""), ""))
    if found.interval is None:
        assert found.score is not None
        return float(found.score), float(found.score)
    return float(found.interval.least), float(found.interval.most)


@pytest.mark.parametrize("late_s", [(0.0, 0.0), (0.3, 0.2)])
def test_where_messages_are_missing_all_of_it_is_open_however_well_its_ends_are_known(
    late_s: tuple[float, float],
) -> None:
    """Too near from 18.805 s on; what was seen of it from 19 s to 20.5 s is certain all the same."""
    given = at(19.0, 20.5, late_s=late_s)
    whole = time_in_violation_s(given)
    best_s, worst_s = open_times_s(replace(given, window_open="the log is not what its recorder received"))

    assert best_s == pytest.approx(whole - sum(late_s[1:]), abs=0.011)
    assert worst_s >= 1.5


@pytest.mark.parametrize("collided_s", [7.9, 8.1, 30.9, 31.1, 36.0])
@pytest.mark.parametrize("start", [START, stated_on(START, 35.0)])
def test_an_event_after_an_end_that_nobody_states_is_held_against_nobody_for_certain(
    start: Event, collided_s: float
) -> None:
    """The last order is announced at 8 s; a collision takes all, unless the competition was over."""
    collided = Event(collided_s, ARM_COLLISION)
    without = replace(TRIAL, events=tuple(sorted([start, *_announced(), collided])))
    truths = [
        scores_between(replace(without, events=(*without.events, Event(ended_s, COMPETITION_ENDED))))
        for ended_s in (35.6, 36.5)
    ]
    least, most = scores_between(without)

    assert all(least <= low == high <= most for low, high in truths)
    ran_until_s = 35.5 if start.numbers else 8.0
    assert (most == 0.0) is (collided_s < ran_until_s)


def _announced() -> list[Event]:
    return [event for event in TRIAL.events if event.kind not in (COMPETITION_STARTED, COMPETITION_ENDED)]


def test_where_the_rules_take_the_recording_for_it_it_lasted_as_long() -> None:
    assert lasted_of(with_window(replace(TRIAL, events=(), window_open=""), RECORDING)) is None


def test_ids_of_what_is_open_are_different() -> None:
    open_ = measure_trial(at(19.5, 20.5, late_s=(0.3, 0.2)), PREPARED).open
    ids = [key for one in open_ for world in (one.best, one.worst) for key in world]

    assert len(ids) == len(set(ids))
