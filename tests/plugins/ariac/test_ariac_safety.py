"""ARIAC's own safety rules: contact with a human, and events that must not happen."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.checks.registry import Registry
from ariac_score.errors import RuleSetError
from ariac_score_ariac.safety import HumanContact, NoEvent

SATISFIED, VIOLATED = Verdict.SATISFIED, Verdict.VIOLATED
INCONCLUSIVE, NOT_APPLICABLE = Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE

LAWS = settings(max_examples=100, derandomize=True, deadline=None)
BODIES = (Body("human", "human"), Body("robot", "robot"))


def apart(*distance_m: float, quantity: str = "separation", step_s: float = 0.01, **more: Any) -> Trial:
    t = np.array([k * step_s for k in range(len(distance_m))])
    signal = Signal(f"{quantity}/robot/human", "m", t, np.array(distance_m))
    return Trial("t", bodies=BODIES, signals={signal.name: signal}, recorded=Span(0.0, float(t[-1])), **more)


def only(monitor: HumanContact | NoEvent, trial: Trial) -> Finding:
    (finding,) = monitor.watch(trial)
    return finding


# Contact -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("robot_m_s", "moving", "exposed_s"),
    [(0.01, "no", 0.0), (float(np.nextafter(0.01, 1.0)), "yes", 0.03), (0.5, "yes", 0.03)],
)
def test_a_contact_says_whether_the_robot_moved_and_for_how_long_somebody_was_exposed(
    robot_m_s: float, moving: str, exposed_s: float
) -> None:
    trial = apart(5.0, 0.0, 4.0, 9.0, 9.0)  # each stands for 0.01 s; within 5 m for three of them
    speed = Signal("speed/robot", "m/s", trial.signals["separation/robot/human"].t, np.full(5, robot_m_s))
    trial = replace(trial, signals={**trial.signals, speed.name: speed})

    finding = only(HumanContact(), trial)

    assert dict(finding.labels) == {"robot_moving": moving}
    assert finding.quantities["exposure_s"] == pytest.approx(exposed_s)


def test_without_the_speed_of_the_robot_a_contact_is_one_and_what_moved_is_unknown() -> None:
    finding = only(HumanContact(), apart(5.0, 0.0, 4.0))

    assert (finding.verdict, finding.critical) == (VIOLATED, True)
    assert dict(finding.labels) == {"robot_moving": "unknown"}
    assert "exposure_s" not in finding.quantities
    clean = only(HumanContact(), apart(5.0, 4.0))
    assert clean.quantities["time_in_violation_s"] == 0.0
    assert "exposure_s" not in clean.quantities


@pytest.mark.parametrize(
    ("limit_m", "distance_m", "verdict"),
    [
        (0.0, 0.0, VIOLATED),
        (0.0, float(np.nextafter(0.0, 1.0)), SATISFIED),
        (0.5, 0.5, VIOLATED),
        (0.5, float(np.nextafter(0.5, 0.0)), VIOLATED),
        (0.5, float(np.nextafter(0.5, 1.0)), SATISFIED),
    ],
)
def test_contact_is_at_the_limit_and_below_it(limit_m: float, distance_m: float, verdict: Verdict) -> None:
    finding = only(HumanContact(contact_distance_m=limit_m), apart(9.0, distance_m, 9.0))

    assert finding.verdict is verdict
    assert finding.robustness == pytest.approx(distance_m - limit_m)


@given(limit=st.floats(0.0, 2.0), distance=st.floats(0.0, 4.0))
@LAWS
def test_the_verdict_is_the_comparison_to_the_bit(limit: float, distance: float) -> None:
    finding = only(HumanContact(contact_distance_m=limit), apart(distance))

    assert finding.verdict is (VIOLATED if distance <= limit else SATISFIED)


def test_every_contact_is_critical_and_no_other_finding_is() -> None:
    contact, clear = only(HumanContact(), apart(0.0)), only(HumanContact(), apart(1.0))
    (unknown,) = HumanContact().watch(Trial("t", bodies=BODIES, recorded=Span(0.0, 1.0)))

    assert (contact.verdict, contact.critical) == (VIOLATED, True)
    assert (clear.verdict, clear.critical) == (SATISFIED, False)
    assert (unknown.verdict, unknown.critical) == (INCONCLUSIVE, False)


@pytest.mark.parametrize(("gap_s", "episodes"), [(0.3, 1), (2.0, 3)])
def test_touches_that_follow_each_other_closely_are_one_contact(gap_s: float, episodes: int) -> None:
    # W16.3: three touches of 0.2 s; 0.3 s apart they are one episode of 1.2 s with 0.6 s of contact,
    # 2 s apart three of 0.2 s. In samples of 0.01 s each touch is 20 samples.
    touch, pause = [0.0] * 20, [1.0] * round(gap_s * 100)
    trial = apart(1.0, *touch, *pause, *touch, *pause, *touch, 1.0)

    found = list(HumanContact().watch(trial))

    assert len(found) == episodes
    lengths_s = [finding.span.duration_s for finding in found if finding.span]
    assert lengths_s == pytest.approx([1.2] if episodes == 1 else [0.2] * 3)
    assert sum(f.quantities["time_in_violation_s"] for f in found) == pytest.approx(0.6)


def test_the_finding_tells_the_nearest_moment() -> None:
    finding = only(HumanContact(contact_distance_m=0.5), apart(0.4, 0.2, 0.3))

    assert [(s.signal, s.t_s, s.value) for s in finding.evidence] == [("separation/robot/human", 0.01, 0.2)]
    assert finding.quantities["depth_max_m"] == pytest.approx(0.3)


@pytest.mark.parametrize("quantity", ["centre_distance", "centre_distance_2d", "separation"])
def test_it_reads_the_distance_it_is_given_and_no_other(quantity: Any) -> None:
    monitor = HumanContact(distance=quantity)
    other = "separation" if quantity != "separation" else "centre_distance"

    assert only(monitor, apart(0.0, quantity=quantity)).verdict is VIOLATED
    assert only(monitor, apart(0.0, quantity=other)).verdict is INCONCLUSIVE
    assert [need.quantity for need in monitor.needs()] == [quantity, "speed"]


def test_a_hole_in_the_record_is_undecided_and_not_free_of_contact() -> None:
    found = list(HumanContact().watch(apart(9.0, 9.0, step_s=0.051)))

    assert [(f.verdict, f.span) for f in found] == [(INCONCLUSIVE, Span(0.0, 0.051))]


@pytest.mark.parametrize(
    ("witnessed", "verdict"), [(frozenset({"bodies"}), NOT_APPLICABLE), (frozenset(), INCONCLUSIVE)]
)
def test_where_nobody_is_recorded_nobody_was_touched_only_if_every_body_is(
    witnessed: frozenset[str], verdict: Verdict
) -> None:
    trial = Trial("t", bodies=BODIES[1:], witnessed=witnessed, recorded=Span(0.0, 1.0))

    assert only(HumanContact(), trial).verdict is verdict


@pytest.mark.parametrize("name", ["contact_distance_m", "t_off_s"])
def test_a_negative_parameter_is_refused_and_named(name: str) -> None:
    plugin = Registry().find("ariac_score.monitors", "ariac.human_contact")

    with pytest.raises(RuleSetError, match=name):
        plugin.build({name: -0.1})


@pytest.mark.parametrize("max_gap_s", [0.0, -1.0, float("nan")])
def test_a_gap_that_is_not_positive_is_refused(max_gap_s: float) -> None:
    with pytest.raises(ValueError, match="max_gap_s"):
        HumanContact(max_gap_s=max_gap_s)


# Events --------------------------------------------------------------------------------


def happened(*events: Event, witnessed: tuple[str, ...] = ("arm_collision",)) -> Trial:
    return Trial("t", events=events, witnessed=frozenset(witnessed))


def test_a_log_that_would_have_recorded_a_collision_and_has_none_is_clean() -> None:
    assert only(NoEvent(), happened()).verdict is SATISFIED


@pytest.mark.parametrize("witnessed", [(), ("part_dropped",), ("submissions", "bodies")])
def test_a_log_that_would_not_have_recorded_a_collision_is_undecided(witnessed: tuple[str, ...]) -> None:
    assert only(NoEvent(), happened(witnessed=witnessed)).verdict is INCONCLUSIVE


def test_a_recorded_collision_counts_even_if_nobody_promised_to_record_it() -> None:
    assert only(NoEvent(), happened(Event(3.0, "arm_collision"), witnessed=())).verdict is VIOLATED


def test_each_event_is_one_violation_at_its_time() -> None:
    trial = happened(Event(3.0, "arm_collision", "gantry", "with the tray"), Event(1.0, "arm_collision"))

    found = list(NoEvent().watch(trial))

    assert [(f.verdict, f.span, f.subject) for f in found] == [
        (VIOLATED, Span(1.0, 1.0), "trial"),
        (VIOLATED, Span(3.0, 3.0), "gantry"),
    ]
    assert found[1].message == "arm collision at 3.000 s: with the tray"


def test_events_of_another_kind_are_not_its_business() -> None:
    trial = happened(Event(3.0, "part_dropped"))

    assert only(NoEvent(), trial).verdict is SATISFIED
    assert only(NoEvent(kind="part_dropped"), trial).verdict is VIOLATED


@pytest.mark.parametrize("critical", [False, True])
def test_a_rule_set_says_whether_the_event_is_critical(critical: bool) -> None:
    assert only(NoEvent(critical=critical), happened(Event(3.0, "arm_collision"))).critical is critical
    assert only(NoEvent(critical=critical), happened()).critical is False


@pytest.mark.parametrize(("kind", "clause"), [("part_dropped", "ARIAC scoring"), ("spill", "")])
@pytest.mark.parametrize("witnessed", [(), ("part_dropped", "spill")])
def test_only_what_ariac_asks_for_is_a_clause_of_its_rules(
    kind: str, clause: str, witnessed: tuple[str, ...]
) -> None:
    assert only(NoEvent(kind=kind), happened(witnessed=witnessed)).clause == clause
    assert only(NoEvent(kind=kind), happened(Event(3.0, kind), witnessed=witnessed)).clause == clause


def test_it_needs_no_signal() -> None:
    assert list(NoEvent().needs()) == []
