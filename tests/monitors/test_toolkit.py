"""What the author of a monitor states, and what the toolkit makes of it, worked out by hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import (
    Body,
    Event,
    Finding,
    FloatArray,
    InstantVerdict,
    Measure,
    Sample,
    Series,
    Signal,
    Span,
    Trial,
    Verdict,
    check_parameters,
    parameter,
)
from ariac_score.checks.registry import Registry
from ariac_score.engine.signal_needs import with_derived
from ariac_score.monitors import (
    Bound,
    Encounter,
    Episode,
    JudgedLimit,
    LimitMonitor,
    MarginMonitor,
    Reach,
    Signals,
    SubjectMonitor,
    UndecidedError,
    Watched,
    bodies,
    nobody,
    pairs,
)
from ariac_score.testing import contract_checks

ROOT = Path(__file__).parents[2]
CARS = (Body("car", "vehicle"), Body("bus", "vehicle"), Body("ann", "pedestrian"))


@dataclass(frozen=True)
class Clear(MarginMonitor):
    """A vehicle keeps clear of pedestrians.

    Measures:
        Distance less `least_m` and less a second of driving.
    Violated when:
        It is negative.
    Source:
        This test.
    """

    least_m: float = parameter(1.0, unit="m", at_least=0, at_most=100)
    max_gap_s: float = parameter(0.15, unit="s", above=0, at_most=60)
    t_off_s: float = parameter(0.2, unit="s", at_least=0, at_most=60)

    subjects = pairs("vehicle", "pedestrian")
    wanted: ClassVar = {"distance/{vehicle}/{pedestrian}": "m", "velocity/{vehicle}": "m/s"}
    what, unit = "distance", "m"

    def margin(self, signals: Signals) -> Bound:
        velocity = signals["velocity/{vehicle}"]
        speed = np.sqrt(velocity[..., 0] ** 2 + velocity[..., 1] ** 2)
        return self.at_least(
            signals["distance/{vehicle}/{pedestrian}"], self.least_m + 1.0 * speed, named="needed"
        )


def drive(distance_m: Sequence[float], speed_m_s: Sequence[float], *, step_s: float = 0.1) -> Trial:
    """One vehicle and one pedestrian, ten times a second."""
    t = np.arange(len(distance_m)) * step_s
    velocity = np.zeros((len(t), 3))
    velocity[:, 0] = speed_m_s
    signals = (
        Signal("distance/car/ann", "m", t, np.array(distance_m)),
        Signal("velocity/car", "m/s", t, velocity),
    )
    both = (Body("car", "vehicle"), Body("ann", "pedestrian"))
    return Trial("t", bodies=both, signals={s.name: s for s in signals}, recorded=Span(0.0, float(t[-1])))


# From a margin to findings ---------------------------------------------------------------


def test_one_statement_gives_episodes_worst_samples_severities_and_evidence() -> None:
    # Needed at 1 m/s: 2 m. Violated from 0.1 s to 0.3 s, by 0.5 m for 0.1 s and by 1 m for 0.1 s.
    (finding,) = Clear().watch(drive([3.0, 1.5, 1.0, 2.0, 3.0, 3.0], [1.0] * 6))

    assert finding.verdict is Verdict.VIOLATED
    assert finding.subject == "car/ann"
    assert finding.span is not None
    assert (finding.span.start_s, finding.span.end_s) == pytest.approx((0.1, 0.3))
    assert finding.robustness == -1.0
    assert finding.quantities == pytest.approx(
        {
            "time_in_violation_s": 0.2,
            "depth_max_m": 1.0,
            "depth_integral_m_s": 0.5 * 0.1 + 1.0 * 0.1,
            "relative_depth_max": 0.5,
            "relative_depth_integral_s": 0.25 * 0.1 + 0.5 * 0.1,
        }
    )
    assert [(one.signal, one.value) for one in finding.evidence] == [
        ("distance/car/ann", 1.0),
        ("velocity/car", (1.0, 0.0, 0.0)),
        ("needed/car/ann", 2.0),
    ]


def test_who_keeps_the_limit_is_told_the_closest_moment_and_measures_nothing_but_zeros() -> None:
    (finding,) = Clear().watch(drive([3.0, 2.0, 2.5], [1.0] * 3))  # equality keeps it

    assert finding.verdict is Verdict.SATISFIED
    assert finding.robustness == 0.0
    assert set(finding.quantities.values()) == {0.0}
    assert finding.quantities.keys() == Clear().measures.keys()


def test_a_gap_is_undecided_and_nothing_else_is_said_to_be_kept() -> None:
    whole = drive([3.0] * 6, [0.0] * 6)
    distance = whole.signals["distance/car/ann"]
    holed = replace(distance, t=distance.t[[0, 1, 4, 5]], values=distance.values[[0, 1, 4, 5]])

    (finding,) = Clear().watch(replace(whole, signals={**whole.signals, holed.name: holed}))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert finding.span == Span(0.1, 0.4)


def test_a_signal_that_is_missing_leaves_its_own_pair_open_and_no_other() -> None:
    trial = drive([3.0] * 3, [0.0] * 3)
    found = {f.subject: f.verdict for f in Clear().watch(replace(trial, bodies=CARS))}

    assert found == {"bus/ann": Verdict.INCONCLUSIVE, "car/ann": Verdict.SATISFIED}


@pytest.mark.parametrize(("seen", "verdict"), [(True, "not_applicable"), (False, "inconclusive")])
def test_without_anybody_there_is_nothing_to_judge_if_the_log_would_show_them(
    seen: bool, verdict: str
) -> None:
    witnessed = frozenset({"bodies"} if seen else ())
    (finding,) = Clear().watch(Trial("t", bodies=CARS[:2], witnessed=witnessed, recorded=Span(0.0, 1.0)))

    assert finding.verdict.value == verdict
    assert "no pedestrian" in finding.message
    assert "mean" not in finding.message


@pytest.mark.parametrize("seen", [True, False])
@pytest.mark.parametrize("kind", ["pedestrain", "Pedestrian", "PEDESTRIAN", "pedestrians", "pedestrin"])
def test_a_kind_that_may_be_misspelt_is_never_taken_for_nobody_being_there(seen: bool, kind: str) -> None:
    known = (*CARS[:2], Body("ann", kind), Body("tree", "plant"))
    witnessed = frozenset({"bodies"} if seen else ())
    (finding,) = Clear().watch(Trial("t", bodies=known, witnessed=witnessed, recorded=Span(0.0, 1.0)))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert finding.message == f"the log shows no pedestrian; did you mean {kind!r}?"


def test_both_kinds_may_be_misspelt() -> None:
    known = (Body("car", "vehicel"), Body("ann", "pedestrain"))
    (finding,) = Clear().watch(Trial("t", bodies=known, recorded=Span(0.0, 1.0)))

    assert finding.message == (
        "the log shows no vehicle and no pedestrian; did you mean 'vehicel' and 'pedestrain'?"
    )


@pytest.mark.parametrize(
    ("kinds", "others"),
    [
        (("human",), ("humanoid", "robot")),  # a robot that looks like one is none
        (("pedestrian",), ("vehicle", "cyclist")),
        (("car", "cart"), ("cart",)),  # who knows of carts does not mean them when it says car
        (("drone", "drone"), ("drone",)),
        (("pedestrian",), ()),
    ],
)
def test_a_kind_of_another_name_is_no_misspelt_one(kinds: tuple[str, ...], others: tuple[str, ...]) -> None:
    known = tuple(Body(f"{kind}_1", kind) for kind in others)
    finding = nobody(Trial("t", bodies=known, witnessed=frozenset({"bodies"})), kinds)

    assert finding.verdict is Verdict.NOT_APPLICABLE
    assert "mean" not in finding.message


def test_the_second_of_one_kind_may_be_misspelt() -> None:
    known = (Body("d1", "drone"), Body("d2", "dron"))
    finding = nobody(Trial("t", bodies=known, witnessed=frozenset({"bodies"})), ("drone", "drone"))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert finding.message == "the log shows no second drone; did you mean 'dron'?"


# A margin alone --------------------------------------------------------------------------


@dataclass(frozen=True)
class Cool(MarginMonitor):
    """No drone gets hot while it flies.

    Measures:
        80 K less its temperature above the air, while it is off the ground.
    Violated when:
        It is negative.
    Source:
        This test.
    """

    subjects = bodies("drone")
    wanted: ClassVar = {"heat/{drone}": "K", "height/{drone}": "m"}
    what, unit, idle = "reserve", "K", "it never flew"

    def margin(self, signals: Signals) -> FloatArray:
        reserve: FloatArray = np.where(signals["height/{drone}"] > 0, 80.0 - signals["heat/{drone}"], np.nan)
        return reserve


def flight(heat_k: Sequence[float], height_m: Sequence[float]) -> Trial:
    t = np.arange(len(heat_k)) * 0.05
    signals = (
        Signal("heat/d", "K", t, np.array(heat_k)),
        Signal("height/d", "m", t, np.array(height_m)),
    )
    return Trial(
        "t",
        bodies=(Body("d", "drone"),),
        signals={s.name: s for s in signals},
        recorded=Span(0.0, float(t[-1])),
    )


def test_a_margin_without_a_limit_is_judged_where_it_is_a_number() -> None:
    (hot,) = Cool().watch(flight([99.0, 70.0, 85.0, 99.0], [0.0, 1.0, 1.0, 0.0]))
    (cool,) = Cool().watch(flight([99.0, 70.0, 75.0, 99.0], [0.0, 1.0, 1.0, 0.0]))
    (grounded,) = Cool().watch(flight([99.0, 99.0], [0.0, 0.0]))

    assert (hot.verdict, hot.robustness, hot.unit) == (Verdict.VIOLATED, -5.0, "K")
    assert hot.quantities["depth_integral"] == pytest.approx(5.0 * 0.05)
    assert Cool().measures["depth_integral"].unit == "K s"
    assert (cool.verdict, cool.robustness) == (Verdict.SATISFIED, 5.0)
    assert (grounded.verdict, grounded.message) == (Verdict.NOT_APPLICABLE, "it never flew")


# Online equals offline -------------------------------------------------------------------


def stepped(monitor: Any, trial: Trial, known: Sequence[Body]) -> tuple[list[InstantVerdict], list[Finding]]:
    watch = monitor.begin(known)
    samples = sorted(
        (signal.sample(i) for signal in trial.signals.values() for i in range(len(signal))),
        key=lambda sample: sample.t_s,
    )
    verdicts = [one for sample in samples for one in watch.step([sample])]
    return verdicts, list(watch.end(replace(trial, signals={})))


@settings(max_examples=30, deadline=None, derandomize=True)
@given(
    st.lists(st.tuples(st.floats(0, 5), st.floats(0, 2)), min_size=2, max_size=12),
    st.booleans(),
)
def test_online_each_instant_has_the_margin_of_the_whole_log_to_the_bit(
    rows: list[tuple[float, float]], known: bool
) -> None:
    trial = drive(*zip(*rows, strict=True))  # type: ignore[arg-type]
    verdicts, found = stepped(Clear(), trial, trial.bodies if known else ())
    (chart,) = Clear().margins(trial)

    assert [(one.t_s, one.robustness) for one in verdicts] == list(
        zip(chart.t.tolist(), chart.margin.tolist(), strict=True)
    )
    assert found == list(Clear().watch(trial))


def test_a_pair_shows_by_a_signal_that_names_both_but_a_single_body_does_not() -> None:
    assert not getattr(Clear().begin(), "undecided", "")
    assert "not known" in getattr(Cool().begin(), "undecided", "")
    assert not getattr(Cool().begin([Body("d", "drone")]), "undecided", "")


def test_a_body_known_to_be_of_another_kind_is_not_taken_for_one_of_the_pair() -> None:
    verdicts, _ = stepped(Clear(), drive([3.0] * 3, [0.0] * 3), [Body("car", "robot")])

    assert verdicts == []


@pytest.mark.parametrize("check", contract_checks(Clear(), drive([3.0, 1.0, 3.0] * 9, [1.0] * 27)))
def test_the_monitor_of_this_test_keeps_its_contract(check: Any) -> None:
    check()


# What the log leaves open, and equality ---------------------------------------------------


@dataclass(frozen=True)
class Guarded(LimitMonitor):
    """Nobody comes nearer than allowed while the guard is on."""

    strict: bool = parameter(False)
    max_flag_age_s: float = parameter(0.2, unit="s", above=0, at_most=60)

    subjects = pairs("drone", "drone")
    wanted: ClassVar = {"distance/{drone}/{other}": "m"}
    what, unit, critical = "distance", "m", True
    reach = Reach("run")

    def margin(self, signals: Watched) -> Bound:
        state = signals.state("guard", self.max_flag_age_s)
        if state is None:
            raise UndecidedError("nobody knows whether the guard is on")
        return self.at_least(
            signals["distance/{drone}/{other}"], 1.0, where=state.on & state.known, strict=self.strict
        )

    def severity(self, _limit: JudgedLimit, episode: Episode | None) -> dict[str, float]:
        return {"samples": 0.0 if episode is None else float(len(episode.rows))}

    severities: ClassVar = {"samples": Measure("count", best=0.0)}


def hover(*distance_m: float, on_s: float | None = 0.0) -> Trial:
    t = np.arange(len(distance_m)) * 0.05
    signal = Signal("distance/a/b", "m", t, np.array(distance_m))
    events = () if on_s is None else (Event(on_s, "guard", "a/b", "on"),)
    return Trial(
        "t",
        bodies=(Body("b", "drone"), Body("a", "drone")),
        signals={signal.name: signal},
        events=events,
        recorded=Span(0.0, float(t[-1])),
    )


def test_what_a_monitor_cannot_know_is_inconclusive_for_that_subject() -> None:
    (finding,) = Guarded().watch(hover(0.5, 0.5, on_s=None))

    assert finding.verdict is Verdict.INCONCLUSIVE
    assert finding.message == "nobody knows whether the guard is on"
    assert list(Guarded().margins(hover(0.5, 0.5, on_s=None))) == []


def test_two_bodies_of_one_kind_are_one_pair_whichever_comes_first() -> None:
    (finding,) = Guarded().watch(hover(2.0, 0.25, 0.5, 2.0))

    assert finding.subject == "a/b"
    assert finding.critical
    assert finding.quantities["samples"] == 2.0
    assert Guarded().measures["samples"].unit == "count"


@pytest.mark.parametrize(("strict", "verdict"), [(False, Verdict.SATISFIED), (True, Verdict.VIOLATED)])
def test_equality_breaks_a_strict_limit_and_no_other(strict: bool, verdict: Verdict) -> None:
    (finding,) = Guarded(strict=strict).watch(hover(2.0, 1.0, 2.0))

    assert finding.verdict is verdict
    assert finding.robustness == 0.0
    assert finding.quantities["depth_max_m"] == (np.nextafter(1.0, 2.0) - 1.0 if strict else 0.0)


def test_the_guard_counts_from_when_it_is_on() -> None:
    (kept,) = Guarded().watch(hover(0.5, 0.5, 2.0, 2.0, on_s=0.1))

    assert kept.verdict is Verdict.SATISFIED
    assert not kept.critical  # whatever a violation would be


@dataclass(frozen=True)
class Held(MarginMonitor):
    """A drone flies above the ground, and whoever asks for the impossible is told."""

    subjects = bodies("drone")
    wanted: ClassVar = {"height/{drone}": "m"}
    optional: ClassVar = {"height/{drone}::arm": "m"}
    what, unit = "height", "m"

    def margin(self, signals: Signals) -> Bound:
        if np.any(signals["height/{drone}"] > 100):
            raise UndecidedError("above 100 m nobody knows")
        return self.at_least(signals["height/{drone}"], 0.0, strict=True)


def test_a_signal_that_only_helps_is_not_passed_over_where_it_is_as_consumed() -> None:
    trial = replace(flight([0.0] * 3, [1.0, 2.0, 3.0]), bodies=(Body("d", "drone", links=("arm",)),))
    arm = Series("height/d::arm", "m", np.zeros(2), np.zeros(2))

    assert [one.verdict for one in Held().watch(trial)] == [Verdict.SATISFIED]
    (finding,) = Held().watch(replace(trial, as_consumed={arm.name: arm}))
    assert finding.verdict is Verdict.INCONCLUSIVE
    assert "'height/d::arm' is there as consumed only" in finding.message


def test_online_equality_breaks_a_strict_limit_and_what_is_unknown_is_inconclusive() -> None:
    trial = flight([0.0] * 3, [1.0, 0.0, 200.0])
    watch = Held().begin(trial.bodies)
    height = trial.signals["height/d"]
    verdicts = [one for i in range(3) for one in watch.step([height.sample(i)])]

    assert [one.verdict for one in verdicts] == [
        Verdict.SATISFIED,
        Verdict.VIOLATED,
        Verdict.INCONCLUSIVE,
    ]
    assert [one.message for one in verdicts] == [
        "height 1.000 m (at least 0.000)",
        "height 0.000 m (at least 0.000)",
        "above 100 m nobody knows",
    ]
    (finding,) = Held().watch(trial)
    assert finding.message == "above 100 m nobody knows"


def test_a_quantity_that_is_needed_is_not_optional_too() -> None:
    assert [(need.quantity, need.optional) for need in Held().needs()] == [("height", False)]


def test_a_chart_of_a_margin_alone_shows_where_nothing_is_asked_for() -> None:
    (chart,) = Cool().charts(flight([99.0, 70.0, 85.0], [0.0, 1.0, 1.0]))

    assert np.isnan(chart.margin[0])
    assert chart.margin[1:].tolist() == [10.0, -5.0]


@dataclass(frozen=True)
class Enabled(LimitMonitor):
    """A drone is still unless it is enabled."""

    subjects = bodies("drone")
    wanted: ClassVar = {"height/{drone}": "m"}
    flags = ("enabled",)
    unit = "m"

    def margin(self, signals: Watched) -> Bound:
        return self.at_most(
            signals["height/{drone}"], 0.0, where=~signals.flag("enabled", self.max_flag_age_s)
        )


@pytest.mark.parametrize(
    ("on_at_s", "verdict", "words"),
    [
        ([0.0], "satisfied", "keeps its limit"),
        ([0.05], "inconclusive", "'enabled' is not known at 0.000 s"),
        ([], "inconclusive", "neither a signal 'enabled/d' nor 'enabled' events"),
    ],
)
def test_a_flag_that_is_not_known_throughout_leaves_its_subject_open(
    on_at_s: list[float], verdict: str, words: str
) -> None:
    trial = flight([0.0] * 3, [1.0, 1.0, 0.0])
    t = np.array([*on_at_s, 0.1])
    flag = Signal("enabled/d", "1", t, np.array([*(1.0 for _ in on_at_s), 0.0]))
    signals = {**trial.signals, flag.name: flag} if on_at_s else dict(trial.signals)
    (finding,) = Enabled().watch(replace(trial, signals=signals))

    assert finding.verdict.value == verdict
    assert words in finding.message
    assert [need.quantity for need in Enabled().needs()] == ["height", "enabled"]


# Encounters ------------------------------------------------------------------------------


@dataclass(frozen=True)
class Apart(LimitMonitor):
    """A vehicle keeps a metre."""

    subjects = pairs("vehicle", "pedestrian")
    wanted: ClassVar = {"distance/{vehicle}/{pedestrian}": "m"}
    unit = "m"
    encounter = Encounter(
        "distance/{vehicle}/{pedestrian}",
        "speed/{vehicle}",
        "towards/{vehicle}/{pedestrian}",
        "from/{pedestrian}/{vehicle}",
        within_m=2.0,
    )

    def margin(self, signals: Watched) -> Bound:
        return self.at_least(signals["distance/{vehicle}/{pedestrian}"], 1.0)


def test_an_encounter_of_any_kinds_tells_who_closed_in_and_who_was_exposed() -> None:
    trial = drive([3.0, 1.5, 0.5, 0.5], [1.0] * 4, step_s=0.05)
    t = trial.signals["distance/car/ann"].t
    speed = Signal("speed/car", "m/s", t, np.array([1.0, 1.0, 1.0, 0.0]))
    towards = Signal("towards/car/ann", "m/s", t, np.array([1.0, 1.0, 1.0, 0.0]))
    back = Signal("from/ann/car", "m/s", t, np.zeros(4))

    (told,) = Apart().watch(
        replace(trial, signals={s.name: s for s in (*trial.signals.values(), speed, towards, back)})
    )
    (untold,) = Apart().watch(trial)

    assert told.labels == {"robot_moving": "yes", "closing_by": "robot"}
    assert told.quantities["exposure_s"] == pytest.approx(0.1)  # within 2 m of the moving car
    assert untold.labels == {"robot_moving": "unknown", "closing_by": "unknown"}
    assert "exposure_s" not in untold.quantities
    assert [(need.quantity, need.optional) for need in Apart().needs()] == [
        ("distance", False),
        ("speed", True),
        ("towards", True),
        ("from", True),
    ]


# A monitor that has no margin -------------------------------------------------------------


@dataclass(frozen=True)
class Arrives(SubjectMonitor):
    """Every vehicle stands at its end."""

    goal: str = parameter("")

    subjects = bodies("vehicle")
    wanted: ClassVar = {"speed/{vehicle}": "m/s"}

    @property
    def lacks(self) -> str:
        return "" if self.goal else "no goal is given"

    def about(self, signals: Watched) -> Iterator[Finding]:
        stands = signals["speed/{vehicle}"][-1] == 0
        yield Finding(signals.subject.name, Verdict.of(0 if stands else -1), f"at {self.goal}")


def test_a_monitor_may_judge_its_subjects_without_a_margin() -> None:
    t = np.arange(3) * 0.05
    signals = {
        f"speed/{name}": Signal(f"speed/{name}", "m/s", t, np.full(3, speed))
        for name, speed in (("car", 0.0), ("bus", 1.0))
    }
    trial = Trial("t", bodies=CARS, signals=signals, recorded=Span(0.0, 0.1))

    assert [(f.subject, f.verdict) for f in Arrives("A").watch(trial)] == [
        ("bus", Verdict.VIOLATED),
        ("car", Verdict.SATISFIED),
    ]
    assert [(f.subject, f.message) for f in Arrives().watch(trial)] == [("trial", "no goal is given")]
    assert not hasattr(Arrives(), "margins")


# What authors get wrong --------------------------------------------------------------------


@dataclass(frozen=True)
class Wrong(LimitMonitor):
    """Takes the least of all, or names a body that it is not about."""

    name: str = parameter("height/{drone}")

    subjects = bodies("drone")

    @property
    def wanted(self) -> dict[str, str]:
        return {self.name: "m"}

    def margin(self, signals: Watched) -> FloatArray:
        least: FloatArray = signals[self.name].min()
        return least


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("height/{drone}", r"shape \(\), but one number for each of 2 samples is due"),
        ("gap/{drone}/{human}", r"names \{human\}, but its subjects are \{drone\}"),
        ("gap/{}", r"names .*, but its subjects are \{drone\}"),
    ],
)
def test_mistakes_of_an_author_are_named(name: str, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        list(Wrong(name).watch(flight([0.0] * 2, [1.0] * 2)))


def test_a_signal_that_is_read_must_be_wanted() -> None:
    @dataclass(frozen=True)
    class Forgetful(Wrong):
        """Reads what it does not want."""

        def margin(self, signals: Watched) -> FloatArray:
            return signals["heat/{drone}"]

    with pytest.raises(LookupError, match=r"'heat/{drone}' is read, .* wanted: 'height/{drone}'"):
        list(Forgetful().watch(flight([0.0] * 2, [1.0] * 2)))


# Parameters, and the promise of the tutorial ----------------------------------------------


def test_parameters_outside_their_range_are_refused_without_a_word_of_the_author() -> None:
    with pytest.raises(ValueError, match="least_m is -1 but cannot be negative"):
        Clear(least_m=-1.0)
    check_parameters(Clear())


def test_the_monitor_of_the_tutorial_has_forty_lines_and_one_file() -> None:
    text = (ROOT / "examples/third_party_monitor/workshop_calm_robot/__init__.py").read_text(encoding="utf-8")

    assert len(text.splitlines()) <= 40


def test_samples_are_refused_that_run_back() -> None:
    watch = Clear().begin()
    sample = Sample("distance/car/ann", 1.0, 2.0, "m")
    list(watch.step([sample]))

    with pytest.raises(ValueError, match="do not increase"):
        list(watch.step([sample]))


# What is stated, and what is not a margin ------------------------------------------------------


@dataclass(frozen=True)
class Cold(MarginMonitor):
    """As `Cool`, with the pause that is bridged as a parameter."""

    t_off_s: float = 1.0

    subjects = bodies("drone")
    wanted: ClassVar = {"speed/{drone}": "m/s"}
    what, unit = "speed", "m/s"

    def margin(self, signals: Signals) -> Bound:
        return self.at_most(signals["speed/{drone}"], 1.0)


@dataclass(frozen=True)
class Bare(MarginMonitor):
    """As `Cold`, without the parameter."""

    subjects, wanted, what, unit = Cold.subjects, Cold.wanted, Cold.what, Cold.unit
    margin = Cold.margin


def flown(speeds_m_s: list[float]) -> Trial:
    t = np.arange(len(speeds_m_s)) * 0.05
    speed = Signal("speed/d", "m/s", t, np.array(speeds_m_s))
    recorded = Span(0.0, float(t[-1]))
    return Trial("t", bodies=(Body("d", "drone"),), signals={speed.name: speed}, recorded=recorded)


def test_a_pause_is_bridged_only_where_a_parameter_says_so() -> None:
    twice = flown([2.0, 0.5, 0.5, 2.0, 0.5])

    assert len([*Cold().watch(twice)]) == 1
    assert len([*Cold(t_off_s=0.1).watch(twice)]) == 2  # the pause lasts as long
    assert len([*Bare().watch(twice)]) == 2


@pytest.mark.parametrize(
    ("margin", "message"),
    [
        (lambda _m, _v: None, "the margin is None, not a number for each sample"),
        (lambda _m, v: v <= 1.0, "the margin is true or false, not a number"),
        (lambda m, v: m.at_most(v < 1.0, 1.0), "what is measured is true or false"),
        (lambda m, v: m.at_most(v, None), "its limit is None"),
        (lambda m, v: m.at_most(v, math.nan), "the margin is NaN at 0.000 s, where the limit applies"),
        (lambda m, v: m.at_most(np.where(v > 1, np.nan, v), 1.0), "the margin is NaN at 0.050 s"),
        (lambda m, v: m.at_most(v, 1.0, where=3), "'where' is of type int"),
        (lambda m, v: m.at_most(v, 1.0, where=(v > 0)[:1]), r"margin has the shape \(1,\)"),
    ],
)
def test_what_is_no_margin_is_refused_and_never_kept(margin: Callable[..., Any], message: str) -> None:
    class Odd(Cold):
        def margin(self, signals: Any) -> Any:
            return margin(self, signals["speed/{drone}"])

    with pytest.raises((TypeError, ValueError), match=message):
        list(Odd().watch(flown([0.5, 2.0, 0.5])))


def test_a_limit_that_is_nan_where_it_does_not_apply_is_none() -> None:
    class Partly(Cold):
        def margin(self, signals: Any) -> Bound:
            speed = signals["speed/{drone}"]
            return self.at_most(speed, np.where(speed > 1.5, 1.0, np.nan), where=speed > 1.5)

    (finding,) = Partly().watch(flown([0.5, 2.0, 0.5]))

    assert finding.verdict is Verdict.VIOLATED


# Bodies of unknown size ------------------------------------------------------------------------


@dataclass(frozen=True)
class Surfaces(MarginMonitor):
    """Not nearer than 1 m, from surface to surface."""

    subjects = pairs("vehicle", "pedestrian")
    wanted: ClassVar = {"separation/{vehicle}/{pedestrian}": "m"}
    what, unit = "distance", "m"

    def margin(self, signals: Signals) -> Bound:
        return self.at_least(signals["separation/{vehicle}/{pedestrian}"], 1.0)


@pytest.mark.parametrize(
    ("car_m", "ann_m", "verdict"),
    [
        (0.5, 0.4, Verdict.SATISFIED),
        (0.5, 0.6, Verdict.VIOLATED),
        (0.0, 0.0, Verdict.SATISFIED),
        (None, 0.4, Verdict.INCONCLUSIVE),
        (0.5, None, Verdict.INCONCLUSIVE),
    ],
)
def test_how_far_surfaces_are_apart_is_not_known_without_a_radius(
    car_m: float | None, ann_m: float | None, verdict: Verdict
) -> None:
    t = np.arange(5) * 0.05
    places = {"car": [0.0, 0, 0], "ann": [2.0, 0, 0]}
    signals = {
        f"position/{one}": Signal(f"position/{one}", "m", t, np.tile(np.array(place), (5, 1)))
        for one, place in places.items()
    }
    known = (Body("car", "vehicle", car_m), Body("ann", "pedestrian", ann_m))
    trial = Trial("t", bodies=known, signals=signals, recorded=Span(0.0, 0.2))

    (finding,) = Surfaces().watch(with_derived(trial, list(Surfaces().needs()), Registry()))

    assert finding.verdict is verdict
