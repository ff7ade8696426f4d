"""What the team brought, and what it costs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import ClassVar, Literal

from ariac_score import Finding, Measure, SignalNeed, TeamSetup, Trial, Verdict
from ariac_score_ariac.work import sensor_cost

_SUBJECT = "team"
_MEASURES: Mapping[str, Measure] = {
    "dollars": Measure("dollars", signed=False, meaning="what the sensors cost"),
    "sensors": Measure("count", meaning="how many sensors the team placed"),
}


@dataclass(frozen=True)
class _Bill:
    """What the configured sensors cost, or why that is not known."""

    dollars: float | None
    words: str


@dataclass(frozen=True)
class SensorCost:
    """What the team's sensors cost by the price list of the edition.

    Measures:
        The dollars an official record states (2024: `sensor_cost.txt`, 2025: the
        database), or those of the configured sensors: for each its price. `take` says
        which counts; `recorded_first` takes the configuration where there is no record.
    Violated when:
        Never: a cost is no fault. It is inconclusive when no file says which sensors
        there were, or a sensor is of a type that has no price or is not for teams.
    Source:
        Rulebooks 2017 to 2025, sensor prices; `free` types are placed without pay,
        `excluded` ones are not for teams, such as `quality_control` in 2017 to 2020.
    Attributes:
        excluded: Types that are not for teams.
        take: Whether recorded or configured costs count.
        free: Types that are placed without pay.
    """

    when_cut: ClassVar[str] = "kept"
    part_of: ClassVar[str] = "task"

    in_gaps: ClassVar[str] = "unsampled"
    measures: ClassVar[Mapping[str, Measure]] = _MEASURES

    prices: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    take: Literal["recorded_first", "recorded", "configured"] = "recorded_first"
    free: tuple[str, ...] = ()
    excluded: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for kind, dollars in self.prices.items():
            if not 0 <= dollars < math.inf:
                raise ValueError(f"the price of {kind!r} is {dollars:g} but cannot be negative")
        listed = [*self.prices, *self.free, *self.excluded]
        twice = sorted({kind for kind in listed if listed.count(kind) > 1})
        if twice:
            raise ValueError(f"{twice[0]!r} can be only one of priced, free and excluded, and only once")

    def needs(self) -> Iterator[SignalNeed]:
        """No signal: costs are in configurations and records."""
        return iter(())

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """One finding about the team."""
        team = trial.team or TeamSetup()
        # What the simulator counted stands; a configuration then only explains it, or differs in the message.
        recorded = None if self.take == "configured" else sensor_cost(trial)
        if recorded is not None:
            yield self._recorded(team, recorded)
        elif self.take == "recorded":
            yield Finding.inconclusive(_SUBJECT, "no official record says what the sensors cost")
        else:
            yield self._configured(team)

    def _recorded(self, team: TeamSetup, dollars: float) -> Finding:
        message = f"{_amount(dollars)} by the official record"
        if team.sensors is not None and self.take == "recorded_first":
            bill = self._bill(team.sensors)
            if bill.dollars is None:
                message += f"; by the configuration not known: {bill.words}"
            elif bill.dollars != dollars:
                message += f"; by the configuration {_amount(bill.dollars)}: {bill.words}"
            else:
                message += f": {bill.words}"
        return _costs(message, dollars, team)

    def _configured(self, team: TeamSetup) -> Finding:
        if team.sensors is None:
            return Finding.inconclusive(
                _SUBJECT, "no team configuration and no official record says which sensors there were"
            )
        bill = self._bill(team.sensors)
        if bill.dollars is None:
            return Finding.inconclusive(_SUBJECT, bill.words)
        return _costs(f"{_amount(bill.dollars)}: {bill.words}", bill.dollars, team)

    def _bill(self, sensors: Mapping[str, str]) -> _Bill:
        types = sorted(sensors.values())
        counts = {kind: types.count(kind) for kind in types}
        # One sensor without a price makes the sum unknown: leaving it out would favour the team.
        for kind in counts:
            if kind in self.excluded:
                return _Bill(None, f"sensors of type {kind!r} are not for teams in this edition")
            if kind not in self.prices and kind not in self.free:
                return _Bill(None, f"sensors of type {kind!r} have no price in this edition")
        dollars = 0.0
        for kind, count in counts.items():
            dollars += count * self.prices.get(kind, 0.0)
        listed = ", ".join(
            f"{count} x {kind}{' (free)' if kind in self.free else ''}" for kind, count in counts.items()
        )
        return _Bill(dollars, listed or "no sensors placed")


def _costs(message: str, dollars: float, team: TeamSetup) -> Finding:
    quantities = {"dollars": dollars}
    if team.sensors is not None:
        quantities["sensors"] = float(len(team.sensors))
    return Finding(_SUBJECT, Verdict.SATISFIED, message, quantities=quantities)


def _amount(dollars: float) -> str:
    return f"${dollars:,.0f}" if dollars == int(dollars) else f"${dollars:,.2f}"
