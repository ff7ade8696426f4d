"""A monitor is tried where it decides: trials are made that force it to, also of its own quantities."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from ariac_score import (
    Body,
    Finding,
    MissingSignalError,
    Signal,
    SignalNeed,
    Span,
    Trial,
    Verdict,
    parameter,
)
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
    for trial in trials[2:]:
        battery = trial.signals["battery/robot"]
        assert (battery.unit, np.isfinite(battery.values).all()) == ("%", True)
    without_gap = trials[2].signals["battery/robot"]
    assert np.diff(without_gap.t).max() <= 0.1


@dataclass(frozen=True)
class Parked:
    """A link of a cart is where it is wanted when it was asked for: all of it stands in its parameters."""

    kind: str = "cart"
    link: str = "hook"
    asked: str = "please_park"
    place_m: tuple[float, ...] = parameter((3.0, -7.0), unit="m")
    bay_m: tuple[tuple[float, ...], ...] = parameter((), unit="m")

    def needs(self) -> Iterator[SignalNeed]:
        yield SignalNeed("position", "m", 0.1)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        found = False
        for cart in trial.bodies_of(self.kind):
            name = f"position/{cart.id}::{self.link}"
            for event in trial.events_of(self.asked):
                if name in trial.signals and len(trial.signals[name]) > 2:
                    found = True
                    place_m = trial.signals[name].at(np.array([event.t_s]))[0, :2]
                    left_m = 0.02 - float(np.abs(place_m - self._wanted_m()).max())
                    yield Finding(cart.id, Verdict.of(left_m), "how near", robustness=left_m, unit="m")
        if not found:
            yield Finding.inconclusive("trial", "no cart was asked")

    def _wanted_m(self) -> np.ndarray:
        return np.mean(self.bay_m, axis=0) if self.bay_m else np.array(self.place_m)


@pytest.mark.parametrize("bay", [(), ((10.0, 0.0), (12.0, 0.0), (12.0, 4.0))])
def test_kinds_links_events_and_places_that_parameters_name_are_tried(bay: Any) -> None:
    assert check_named(Parked(bay_m=bay)).run() == ""


@dataclass(frozen=True)
class Quiet:
    """Something never happens: no signal, one kind of event."""

    kind: str = "alarm_bell"

    def needs(self) -> Iterator[SignalNeed]:
        return iter(())

    def watch(self, trial: Trial) -> Iterator[Finding]:
        if self.kind not in trial.witnessed:
            yield Finding.inconclusive("trial", "nobody listened")
        elif trial.events_of(self.kind):
            yield Finding.violated("trial", "it rang")
        else:
            yield Finding.satisfied("trial", "it never rang")


def test_an_event_that_a_parameter_names_happens_in_one_trial_and_not_in_another() -> None:
    assert check_named(Quiet()).run() == ""


@dataclass(frozen=True)
class Limited(Battery):
    """Without a limit it decides nothing, and says so."""

    example: ClassVar[Any] = {"least": 30.0}
    least: float = parameter(-1.0, unit="%")

    def _judged(self, robot: str, margin: float) -> Finding:
        if self.least < 0:
            return Finding.inconclusive(robot, "no limit is given")
        return super()._judged(robot, margin)


def test_what_decides_nothing_without_its_limits_is_tried_as_its_example_and_it_is_said() -> None:
    assert check_named(Limited()).run() == (
        "as it is built it decides nothing; as its 'example' it decides both ways"
    )


def test_what_decides_nothing_as_its_example_either_is_refused() -> None:
    class Never(Limited):
        example: ClassVar[Any] = {"least": -2.0}

    with pytest.raises(PluginError, match="was neither satisfied nor violated"):
        check_named(Never())()


class Secretive(Battery):
    """It decides only about a robot whose name stands in its code."""

    def watch(self, trial: Trial) -> Iterator[Finding]:
        if any(body.id == "r2d2" for body in trial.bodies):
            level = trial.signals["battery/r2d2"].values.min()
            yield self._judged("r2d2", float(level) - self.least)
        else:
            yield Finding.inconclusive("trial", "not here")


class Open(Secretive):
    """The same, and it brings the trials in which it decides."""

    def example_trials(self, made: Trial) -> Iterator[Trial]:
        t = np.arange(0.0, 5.0, 0.1)
        for level in (10.0, 30.0):
            battery = Signal("battery/r2d2", "%", t, np.full(len(t), level))
            yield replace(made, bodies=(Body("r2d2", "robot"),), signals={battery.name: battery})


def test_what_only_its_code_knows_a_plugin_brings_itself() -> None:
    with pytest.raises(PluginError, match="bring trials in which it does, as 'example_trials'"):
        check_named(Secretive())()

    assert check_named(Open()).run() == ""


@pytest.mark.parametrize(
    ("brings", "words"),
    [
        (lambda _self, made: [made.signals], "brings a FrozenMap as an example instead of a Trial"),
        (lambda _self, _made: 1 / 0, "raised ZeroDivisionError in 'example_trials'"),
        (lambda _self, _made: None, "raised TypeError in 'example_trials'"),
    ],
)
def test_a_fault_in_the_trials_that_it_brings_is_named(brings: Any, words: str) -> None:
    broken = type("Broken", (Secretive,), {"example_trials": brings})

    with pytest.raises(PluginError, match=words):
        check_named(broken())()


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
