"""What depth over time costs: cases by hand and of the methods, and the laws of the sliding maximum."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score.checks.depth import FILLED_S, DepthProfile, depth_profile, joined_profiles
from ariac_score.checks.findings import Finding, Verdict, settled
from ariac_score.errors import FormulaError
from ariac_score.results.codec import as_text
from ariac_score.scoring.charge import charge
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.trial.spans import Span

SHARED = Path(__file__).parents[3] / "shared/methods/cases.json"
T_S = 5.0
Steps = list[tuple[float, float, float]]
"""Beginning, end and depth of each step, apart or touching."""


def violation(steps: Steps, check: str = "near", subject: str = "robot/human") -> Finding:
    """A violation whose depth is in steps, as it is, with no valley filled."""
    t_s, depth = [], []
    for (begins_s, ends_s, value), following in zip(steps, [*steps[1:], None], strict=True):
        t_s.append(begins_s)
        depth.append(value)
        if following is None or following[0] > ends_s:
            t_s.append(ends_s)
            depth.append(0.0)
    profile = DepthProfile(tuple(t_s), tuple(depth))
    return Finding(subject, Verdict.VIOLATED, "m", Span(t_s[0], t_s[-1]), check=check, profile=profile)


def cost(*findings: Finding, again_after_s: float = T_S, severity: float = 1, **weights: float) -> float:
    numbered = {f"{one.check}#{number}": one for number, one in enumerate(findings)}
    shares = charge(numbered, {"near": 1.0, **weights}, again_after_s=again_after_s, severity=severity)
    return sum(share for _, share in shares)


def sampled(value: Callable[[float], float], ends_s: float, step_s: float = 1e-3) -> Steps:
    """A curve as steps of the middle of each, which integrates a polygon exactly."""
    t = np.arange(0, ends_s - step_s / 2, step_s)
    return [(float(a), float(a + step_s), depth) for a in t if (depth := float(value(a + step_s / 2))) > 0]


def touch(at_s: float, depth: float = 0.4) -> Steps:
    return [(at_s, at_s, depth)]


def triangle(up_s: float, down_s: float, peak: float, start_s: float = 0.0) -> Steps:
    def depth(t: float) -> float:
        return peak * t / up_s if t <= up_s else peak * (up_s + down_s - t) / down_s

    return [(start_s + a, start_s + b, value) for a, b, value in sampled(depth, up_s + down_s)]


CASES: dict[str, list[Steps]] = {
    "P1": [touch(0)],
    "P2": [[(0, 10, 0.04)]],
    "P3": [[(0, 10, 0.4)]],
    "P4": [touch(0), touch(12)],
    "P5": [touch(0), touch(2)],
    "P6": [[(0, 1, 0.3)], [(5, 6, 0.3)]],
    "P7": [[(0, 1, 0.3)], [(6, 7, 0.3)]],
    "P8": [[(0, 1, 0.3)], [(7, 8, 0.3)]],
    "P9": [[(0, 1, 0.8)], [(3, 4, 0.2)]],
    "P10": [[(0, 1, 0.2)], [(3, 4, 0.8)]],
    "P11": [[(0, 1, 0.8)], [(0.2, 0.8, 0.2)]],
    "P12": [sampled(lambda t: t / 4, 4)],
    "P13": [triangle(2, 6, 0.5)],
    "P14": [sampled(lambda t: 0.6 * np.sin(np.pi * t / 5), 5)],
    "P15": [triangle(1, 1, 1.0), triangle(1, 1, 1.0, 3.0)],
    "P16": [[(0, 0.4, 0.4)], [(1.6, 2.0, 0.4)]],
    "P17": [[(0, 0.4, 0.4), (0.4, 1.6, 0.04), (1.6, 2.0, 0.4)]],
    "P18": [[(0, 2.5, 0.5)], [(3.5, 6, 0.5)]],
    "P19": [[(0, 2, 0.5), (2, 3, 0.9), (3, 6, 0.5)]],
}
"""The situations of cases P1 to P19 of the methods, written as steps."""

BY_HAND = {
    "P1": 0.4,  # the least price of a touch
    "P2": 0.04 * 3,  # 1 + 10 / 5 times the depth
    "P3": 0.4 * 3,
    "P4": 0.8,
    "P5": 0.4 * 7 / 5,  # two touches 2 s apart are charged for 7 s
    "P6": 0.3 * 11 / 5,  # from 0 to 11 s
    "P7": 0.3 * 12 / 5,  # 5 s apart and more: as each alone
    "P8": 0.3 * 12 / 5,
    "P9": (0.8 * 6 + 0.2 * 3) / 5,
    "P10": (0.2 * 3 + 0.8 * 6) / 5,
    "P11": 0.8 * 6 / 5,  # what is in the shadow is free
    "P12": 1 + 2 / 5,  # peak and integral / 5
    "P13": 0.5 + 2 / 5,
    "P14": 0.6 + 0.6 * 2 * 5 / np.pi / 5,
    "P15": 1.8,
    "P16": 0.4 * 7 / 5,
    "P17": 0.4 * 7 / 5,
    "P18": 0.5 * 11 / 5,
    "P19": (2 * 0.5 + 6 * 0.9 + 3 * 0.5) / 5,
}


@pytest.mark.parametrize("name", sorted(CASES))
def test_a_case_costs_what_it_does_by_hand(name: str) -> None:
    assert cost(*map(violation, CASES[name])) == pytest.approx(BY_HAND[name], abs=1e-3)


@pytest.mark.parametrize("name", sorted(CASES))
def test_a_case_costs_what_the_methods_say(name: str) -> None:
    if not SHARED.is_file():
        pytest.skip("the methods are not here: ../shared/methods")
    cases = {one["id"]: one for one in json.loads(SHARED.read_text("utf-8"))["penalties"]["cases"]}

    assert cases[name]["T"] == T_S
    assert cost(*map(violation, CASES[name])) == pytest.approx(cases[name]["charge"], abs=1e-3)


def test_a_contact_has_no_depth_and_is_as_deep_as_can_be() -> None:
    contact = Finding("robot/human", Verdict.VIOLATED, "m", Span(0, 5), check="near")

    assert cost(contact) == pytest.approx(2.0)


@pytest.mark.parametrize(("severity", "expected"), [(0, 3.0), (0.5, 1.5), (1, 0.75), (2, 0.1875)])
def test_severity_is_the_power_of_depth(severity: float, expected: float) -> None:
    assert cost(violation([(0, 10, 0.25)]), severity=severity) == pytest.approx(expected)


def test_what_is_a_thousandth_too_near_costs_a_thousandth_of_what_is_as_near_as_can_be() -> None:
    assert cost(violation([(0, 10, 0.001)])) == pytest.approx(cost(violation([(0, 10, 1.0)])) / 1000)


def test_shares_are_the_time_each_is_the_heaviest_and_add_up() -> None:
    deep, shallow = violation([(0, 1, 0.8)]), violation([(3, 4, 0.2)])
    shares = dict(charge({"near#1": deep, "near#2": shallow}, {"near": 1.0}, again_after_s=5))

    assert shares == {"near#1": pytest.approx(0.8 * 6 / 5), "near#2": pytest.approx(0.2 * 3 / 5)}


# Laws ----------------------------------------------------------------------------------

depths = st.integers(0, 10).map(lambda tenths: tenths / 10)
tenths = st.lists(depths, min_size=1, max_size=80)


def of(values: list[float], step_s: float = 0.25) -> list[Finding]:
    """One violation of these depths, a quarter of a second each; none where all are 0."""
    steps = [(i * step_s, (i + 1) * step_s, d) for i, d in enumerate(values) if d > 0]
    return [violation(steps)] if steps else []


@given(tenths, tenths)
def test_deeper_or_longer_never_costs_less(one: list[float], other: list[float]) -> None:
    more = [max(pair) for pair in zip(one, other, strict=False)] + one[len(other) :]

    assert cost(*of(more)) >= cost(*of(one)) - 1e-9


@given(tenths, tenths)
def test_two_together_cost_at_most_what_each_costs(one: list[float], other: list[float]) -> None:
    assert cost(*of(one), *of(other)) <= cost(*of(one)) + cost(*of(other)) + 1e-9


@given(tenths, tenths, st.integers(0, 20))
def test_so_long_apart_they_cost_exactly_that(one: list[float], other: list[float], more: int) -> None:
    pause = [0.0] * (20 + more)

    assert cost(*of([*one, *pause, *other])) == pytest.approx(cost(*of(one)) + cost(*of(other)))


@given(tenths, st.data())
def test_violating_in_a_pause_never_pays(values: list[float], data: st.DataObject) -> None:
    at = data.draw(st.integers(0, len(values) - 1))
    joined = [*values[:at], max(values), *values[at + 1 :]]

    assert cost(*of(joined)) >= cost(*of(values)) - 1e-9


@pytest.mark.slow
@given(depths.filter(bool), depths.filter(bool), st.lists(depths, max_size=19))
def test_what_lies_between_two_at_least_as_deep_changes_nothing(
    left: float, right: float, between: list[float]
) -> None:
    """The theorem by which profiles are stored: a valley up to the time charged can be cut out or filled."""
    side = min(left, right)
    valley = [min(depth, side) for depth in between]

    empty = cost(*of([left, *(0.0 for _ in valley), right]))
    assert cost(*of([left, *valley, right])) == pytest.approx(empty)
    assert cost(*of([left, *(side for _ in valley), right])) == pytest.approx(empty)


def literally(pairs: Mapping[str, list[list[float]]], step_s: float = 0.25) -> float:
    """The definition, cell by cell: the integral over the most of the last T, divided by T, of each pair."""
    back = round(T_S / step_s)
    cost = 0.0
    for profiles in pairs.values():
        length = max(map(len, profiles))
        pressing = [max((p[i] for p in profiles if i < len(p)), default=0.0) for i in range(length)]
        pressing += [0.0] * back
        cost += sum(max(pressing[max(0, i - back) : i + 1]) for i in range(len(pressing))) * step_s / T_S
    return cost


@given(st.lists(tenths, min_size=1, max_size=4), st.lists(tenths, max_size=2), st.sampled_from([0, 1, 2]))
def test_it_is_what_the_definition_says_taken_literally(
    of_one: list[list[float]], of_other: list[list[float]], severity: int
) -> None:
    """Several checks about one pair of bodies are one event; other bodies are another."""
    weight = {"near": 1.0, "touched": 0.5}
    checks = ["near", "touched", "near", "touched"]
    findings = []
    pressing: dict[str, list[list[float]]] = {}
    for subject, violations in (("robot/human", of_one), ("robot/human_2", of_other)):
        for check, values in zip(checks, violations, strict=False):
            findings += [replace(one, check=check, subject=subject) for one in of(values)]
            weighed = [weight[check] * depth**severity if depth else 0.0 for depth in values]
            pressing.setdefault(subject, []).append(weighed)

    assert cost(*findings, severity=severity, **weight) == pytest.approx(literally(pressing))


def test_a_stricter_form_that_charges_the_sum_besides_can_be_written() -> None:
    """Case P20 of the methods: of what is in the shadow a tenth of its integral is charged as well."""
    formula = Expression.parse(
        "charged(near=1, touched=1) + 0.1 / 5 * "
        "(measure(near, relative_depth_integral_s) + measure(touched, relative_depth_integral_s))",
        where="$.score",
    )
    deep = replace(violation([(0, 1, 0.8)]), quantities={"relative_depth_integral_s": 0.8})
    shallow = violation([(0.2, 0.8, 0.2)], check="touched")
    shallow = replace(shallow, quantities={"relative_depth_integral_s": 0.12})
    found = {"near#1": deep, "touched#1": shallow}

    sheet = ScoreSheet({}, formula, frozenset({"near", "touched"}))
    scored = sheet.evaluate(Scope("trial", "", {"duration_s": 60.0, "orders": 0}), found)
    assert scored.value == pytest.approx(0.9784)


@given(tenths)
def test_one_rise_and_fall_costs_its_peak_and_its_integral(values: list[float]) -> None:
    top = values.index(max(values))
    hill = sorted(values[: top + 1]) + sorted(values[top + 1 :], reverse=True)

    expected = max(hill) + sum(hill) * 0.25 / T_S if max(hill) else 0.0
    assert cost(*of(hill)) == pytest.approx(expected)


@given(tenths, st.floats(0, 0.01))
def test_a_little_deeper_costs_little_more(values: list[float], by: float) -> None:
    deeper = [min(1.0, depth + by) if depth else 0.0 for depth in values]
    charged_s = len(values) * 0.25 + T_S

    assert abs(cost(*of(deeper)) - cost(*of(values))) <= by * charged_s / T_S + 1e-9


@given(tenths, st.floats(FILLED_S, 20.0))
def test_a_stored_profile_costs_what_the_samples_cost(values: list[float], again_after_s: float) -> None:
    t = np.array([i * 0.25 for i, depth in enumerate(values) if depth > 0])
    if not len(t):
        return
    profile = depth_profile(t, np.full(len(t), 0.25), np.array([depth for depth in values if depth > 0]))
    stored = replace(violation([(0, 1, 1.0)]), profile=profile)

    found = cost(stored, again_after_s=again_after_s)
    assert found == pytest.approx(cost(*of(values), again_after_s=again_after_s), abs=1e-7)
    assert len(profile.t_s) <= 2 * len(values) + 1


# Profiles ------------------------------------------------------------------------------


def test_a_valley_of_a_second_is_filled_and_a_longer_one_is_not() -> None:
    def profile(pause_s: float) -> DepthProfile:
        t = np.array([0.0, 1.0 + pause_s])
        return depth_profile(t, np.array([1.0, 1.0]), np.array([0.5, 0.3]))

    assert profile(1.0) == DepthProfile((0.0, 1.0, 3.0), (0.5, 0.3, 0.0))
    assert profile(1.01).depth == (0.5, 0.0, 0.3, 0.0)


def test_no_violation_is_rounded_to_none() -> None:
    profile = depth_profile(np.array([0.0]), np.array([0.0]), np.array([1e-15]))

    assert profile == DepthProfile((0.0, 0.0), (1e-9, 0.0))


@pytest.mark.parametrize(
    ("t_s", "depth"),
    [
        ((0.0,), (0.0,)),
        ((0.0, 1.0), (0.5,)),
        ((1.0, 0.0), (0.5, 0.0)),
        ((0.0, 1.0), (1.5, 0.0)),
        ((0.0, 1.0), (-0.5, 0.0)),
        ((0.0, 1.0), (0.5, 0.5)),
        ((0.0, float("nan")), (0.5, 0.0)),
        ((0.0, 1.0), (float("nan"), 0.0)),
    ],
)
def test_what_is_no_profile_is_refused(t_s: tuple[float, ...], depth: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="profile"):
        DepthProfile(t_s, depth)


def test_profiles_of_parts_are_one_with_the_pause_between() -> None:
    one, other = DepthProfile((0.0, 1.0), (0.5, 0.0)), DepthProfile((3.0, 4.0), (0.25, 0.0))

    assert joined_profiles([other, one]) == DepthProfile((0.0, 1.0, 3.0, 4.0), (0.5, 0.0, 0.25, 0.0))


def test_a_finding_without_a_profile_is_stored_as_it_was() -> None:
    finding = Finding("robot/human", Verdict.VIOLATED, "m", Span(0, 5), check="near")

    assert "profile" not in as_text(settled(finding))


def test_times_of_a_profile_are_stored_with_the_declared_digits() -> None:
    finding = violation([(0.1 + 0.2, 1.0, 0.5)])

    assert settled(finding).profile == DepthProfile((0.3, 1.0), (0.5, 0.0))


@pytest.mark.parametrize(
    ("options", "cause"),
    [("again_after_s=0.5", "at least 1 s"), ("severity=0 - 1", "severity must not be negative")],
)
def test_a_charge_that_stored_profiles_cannot_give_is_refused(options: str, cause: str) -> None:
    formula = Expression.parse(f"charged(near=1, {options})", where="$.score")
    sheet = ScoreSheet({}, formula, frozenset({"near"}))

    with pytest.raises(FormulaError, match=cause):
        sheet.evaluate(Scope("trial", "", {"duration_s": 60.0, "orders": 0}), {"near#1": violation(touch(1))})


def test_steps_are_in_time_order() -> None:
    for name, violations in CASES.items():
        for steps in violations:
            assert all(a[1] <= b[0] + 1e-9 for a, b in pairwise(steps)), name
