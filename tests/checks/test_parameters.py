"""Parameters that say what they are: declared, checked, and read back through the registry."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score import ParameterFacts, check_parameters, parameter, parameter_facts
from ariac_score.checks.registry import Registry, _as_type, parameters_of


@dataclass(frozen=True)
class Made:
    time_s: float = parameter(0.5, unit="s", status="verified", source="a manual", above=0, at_most=60)
    limit_m: float | None = parameter(None, unit="m", at_least=0.1)
    strict: bool = parameter(False, at_least=5)
    word: str = "x"
    names: tuple[str, ...] = field(default_factory=tuple)

    def __post_init__(self) -> None:
        check_parameters(self)


def test_facts_are_what_was_declared() -> None:
    facts = parameter_facts(Made)

    assert facts["time_s"] == ParameterFacts("s", "verified", "a manual", above=0, at_most=60)
    assert facts["limit_m"].status == "our choice"
    assert facts["word"] == ParameterFacts()


def test_the_registry_has_defaults_and_facts() -> None:
    known = parameters_of(Made)

    assert (known["time_s"].default, known["time_s"].facts.unit) == (0.5, "s")
    assert known["names"].default == ()
    shown = parameters_of(Registry().find("ariac_score.monitors", "iso_10218_1.reduced_speed").load())
    assert shown["max_speed_m_s"].default == 0.25
    assert shown["max_speed_m_s"].facts.status == "verified"


@pytest.mark.parametrize(
    ("given_values", "message"),
    [
        ({"time_s": 0.0}, "time_s is 0 but must be positive"),
        ({"time_s": -1}, "time_s is -1 but must be positive"),
        ({"time_s": 500.0}, "time_s is 500 but must be at most 60 s"),
        ({"time_s": math.nan}, "time_s is nan but must be finite"),
        ({"time_s": math.inf}, "time_s is inf but must be finite"),
        ({"limit_m": 0.05}, "limit_m is 0.05 but must be at least 0.1 m"),
    ],
)
def test_a_number_outside_its_range_is_named(given_values: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Made(**given_values)


@pytest.mark.parametrize(
    "given_values", [{"time_s": 60.0}, {"limit_m": 0.1}, {"limit_m": None}, {"strict": True}]
)
def test_what_is_inside_its_range_or_no_number_is_taken(given_values: Any) -> None:
    assert Made(**given_values)


@given(st.floats(allow_nan=False, allow_infinity=False), st.floats(-10, 10), st.floats(0, 10))
def test_a_problem_is_told_exactly_outside_the_range(value: float, low: float, width: float) -> None:
    facts = ParameterFacts(unit="m", at_least=low, at_most=low + width)

    assert bool(facts.problem(value)) is not (low <= value <= low + width)


def test_a_mapping_keeps_the_types_of_its_names_and_values() -> None:
    assert _as_type({"a": 1}, Mapping[str, float]) == {"a": 1.0}


@pytest.mark.parametrize("value", [{"a": "b"}, {1: 2.0}, [("a", 1.0)], "a", {"a": True}])
def test_what_is_no_mapping_of_names_to_numbers_is_refused(value: object) -> None:
    with pytest.raises(ValueError, match=r"is not a|is not finite"):
        _as_type(value, Mapping[str, float])


def test_only_dataclasses_have_facts() -> None:
    with pytest.raises(TypeError):
        parameter_facts(SimpleNamespace())
