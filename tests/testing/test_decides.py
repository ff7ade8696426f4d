"""A monitor is tried where it decides: trials are made that force it to, also of its own quantities."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from ariac_score import Finding, MissingSignalError, SignalNeed, Span, Trial, Verdict, parameter
from ariac_score.errors import PluginError
from ariac_score.monitors import Bound, MarginMonitor, Signals, Subjects, bodies, pairs
from ariac_score.testing import contract_checks
from ariac_score.testing.contract import ContractCheck
from ariac_score.testing.forced import MOST_TRIALS, forced_trials
from ariac_score.testing.made import inhabited
from ariac_score_ariac.testing import made_trial


@dataclass(frozen=True)
class Battery:
    """The battery of a robot is never nearly empty; its level is a quantity that no vocabulary knows."""

    least: float = parameter(20.0, unit="%")

    def needs(self) -> Iterator[SignalNeed]:
        yield SignalNeed("battery", "%", 0.1)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        for robot in trial.bodies_of("robot"):
            try:
                level = trial.signal(f"battery/{robot.id}", unit="%")
            except MissingSignalError as missing:
                yield Finding.inconclusive(robot.id, str(missing))
                continue
            if len(level) < 3:
                yield Finding.inconclusive(robot.id, "too few samples")
                continue
            yield self._judged(robot.id, float(level.values.min()) - self.least)
        if not trial.bodies_of("robot"):
            yield Finding.inconclusive("trial", "there is no robot")

    def _judged(self, robot: str, margin: float) -> Finding:
        return Finding(robot, Verdict.of(margin), "its least level", robustness=margin, unit="%")


class Guessing(Battery):
    """Its margin is another one each time, but only where it decides."""

    def _judged(self, robot: str, margin: float) -> Finding:
        return super()._judged(robot, margin * random.random())  # noqa: S311


class Lenient(Battery):
    """It finds nothing wrong, ever."""

    def _judged(self, robot: str, margin: float) -> Finding:
        return super()._judged(robot, abs(margin))


class Undecided(Battery):
    """It never says anything."""

    def _judged(self, robot: str, _margin: float) -> Finding:
        return Finding.inconclusive(robot, "who knows")


class Impossible(Battery):
    """It contradicts itself where its limit is broken, and nowhere else."""

    def _judged(self, robot: str, margin: float) -> Finding:
        return Finding(robot, Verdict.of(margin), "its least level", robustness=abs(margin), unit="%")


def check_named(check: object, name: str = "decides") -> ContractCheck:
    return next(each for each in contract_checks(check, made_trial()) if each.name == name)


def test_both_verdicts_are_reached_for_a_quantity_of_its_own() -> None:
    assert not any(f.verdict is not Verdict.INCONCLUSIVE for f in Battery().watch(made_trial()))

    assert check_named(Battery()).run() == ""


@pytest.mark.parametrize("least", [1e-3, 20.0, 1e6])
def test_they_are_reached_wherever_its_limit_lies(least: float) -> None:
    assert check_named(Battery(least)).run() == ""


def test_margins_by_chance_are_found_out_where_it_decides_although_they_are_kept_where_it_does_not() -> None:
    check_named(Guessing(), "same_trial_same_findings")()

    with pytest.raises(PluginError, match=r"gives other findings the second time.*in a trial in which it is"):
        check_named(Guessing())()


def test_a_contradiction_in_one_branch_is_found_out() -> None:
    check_named(Impossible(), "possible_findings")()

    with pytest.raises(PluginError, match="a violation has none above 0"):
        check_named(Impossible())()


def test_one_that_never_decides_is_refused() -> None:
    with pytest.raises(PluginError, match=r"was neither satisfied nor violated in \d+ trials"):
        check_named(Undecided())()


def test_one_that_never_finds_anything_is_kept_and_said_so() -> None:
    unseen = check_named(Lenient()).run()

    assert unseen is not None
    assert unseen.startswith("it was never violated in ")


def test_the_trials_have_an_end_and_what_is_needed_at_the_rate_that_is_needed() -> None:
    trials = list(forced_trials(Battery(), [*Battery().needs()], made_trial()))

    assert 5 < len(trials) <= MOST_TRIALS
    for trial in trials[1:]:
        battery = trial.signals["battery/robot"]
        assert (battery.unit, np.isfinite(battery.values).all()) == ("%", True)
    without_gap = trials[1].signals["battery/robot"]
    assert np.diff(without_gap.t).max() <= 0.1


def test_they_are_the_same_every_time() -> None:
    first, again = (list(forced_trials(Battery(), [*Battery().needs()], made_trial())) for _ in range(2))

    for one, other in zip(first, again, strict=True):
        assert [*one.signals] == [*other.signals]
        for name, signal in one.signals.items():
            np.testing.assert_array_equal(signal.values, other.signals[name].values)


@pytest.mark.parametrize(
    "subjects", [pairs("vehicle", "pedestrian"), pairs("drone", "drone"), bodies("boat")]
)
def test_a_monitor_of_any_kinds_is_tried_with_bodies_of_these_kinds(subjects: Subjects) -> None:
    template = {"boat": "speed/{boat}", "drone": "separation/{drone}/{other}"}.get(
        subjects.kinds[0], "separation/{vehicle}/{pedestrian}"
    )

    @dataclass(frozen=True)
    class Little(MarginMonitor):
        """It never has more than one.

        Measures:
            How much there is.
        Violated when:
            It is more than one.
        Source:
            This test.
        """

        wanted: ClassVar = {template: "m/s" if "speed" in template else "m"}

        def margin(self, signals: Signals) -> Bound:
            return self.at_most(signals[template], 1.0)

    Little.subjects = subjects  # type: ignore[assignment,method-assign]

    assert check_named(Little()).run() in (None, "")
    assert not subjects.of(made_trial().bodies)


def test_a_trial_that_has_somebody_to_watch_stays_as_it_is() -> None:
    trial = made_trial()

    assert inhabited(trial, pairs("robot", "human")) is trial
    assert inhabited(trial, Subjects()) is trial


def test_one_body_of_a_kind_gets_a_second_where_two_are_watched_and_nothing_else_is_touched() -> None:
    trial = made_trial()
    lone = replace(trial, bodies=tuple(body for body in trial.bodies if body.kind != "robot")[:1])
    kind = lone.bodies[0].kind

    (subject,) = pairs(kind, kind).of(inhabited(lone, pairs(kind, kind)).bodies)

    assert subject.name == f"{lone.bodies[0].id}/{kind}_made_1"
    again = inhabited(lone, pairs(kind, kind)).signals
    assert all(again[name] is signal for name, signal in lone.signals.items())


def test_a_recording_too_long_to_fill_stays_as_it_is() -> None:
    trial = replace(made_trial(), recorded=Span(0.0, 121.0))

    assert inhabited(trial, pairs("vehicle", "pedestrian")) is trial
