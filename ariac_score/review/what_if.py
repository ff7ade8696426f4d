"""A competition under other numbers: its ranking at every point of a declared grid.

An organiser declares which numbers may be another, and which values they may have. Prices need only what was
measured; a number that a monitor measures with needs the logs. Nothing lies between the points: whoever shows
them shows what was computed, with the ranking's own rules, and no formula of his own.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal
from itertools import pairwise, product
from math import prod

from ariac_score.checks.findings import Finding
from ariac_score.checks.registry import Registry
from ariac_score.engine.price import reprice
from ariac_score.errors import FormulaError, PluginError, RuleSetError, ScoreError, did_you_mean
from ariac_score.ranking.competition import Competition, RunKey
from ariac_score.ranking.outcomes import Ranking, RunOutcome
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.spec import Spec, ranking_spec
from ariac_score.results.result import CheckUse, Result
from ariac_score.review.conduct import Weighing, parts_of_team
from ariac_score.review.sensitivity import NEEDS_LOG, UNUSED, Knob, knobs_of, logs_of
from ariac_score.review.task_and_safety import TaskAndSafety, task_points
from ariac_score.scoring.ledger import Line, rounded
from ariac_score.scoring.pricing import value_of
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["MOST_POINTS", "Flip", "Lever", "Place", "Point", "WhatIf", "check_grid", "explore", "flips_of"]

MOST_POINTS = 400
"""At each of them the whole competition is priced and ranked."""

Grid = Mapping[str, Sequence[float]]
Findings = Mapping[str, Finding]


@dataclass(frozen=True)
class Lever:
    """A number that may be another.

    Attributes:
        name: A parameter of the formulas, or `check.parameter`.
        steps: The values it may have, increasing; the one of the rules is among them.
        base: Which of them is that of the rules.
        unit: Its unit, where one is declared.
        meaning: In words, where the rules say it.
    """

    name: str
    steps: tuple[float, ...]
    base: int
    unit: str = ""
    meaning: str = ""


@dataclass(frozen=True)
class Place:
    """One team at one point.

    Attributes:
        rank: `None` for a team without one.
        score: Its sum over the trials.
        task: What that would be with every safety check kept; `None` where it cannot be said.
    """

    rank: int | None
    score: Decimal
    task: Decimal | None


Point = Mapping[str, Place]
"""The place of every team."""


@dataclass(frozen=True)
class WhatIf:
    """A competition under other numbers.

    Attributes:
        levers: The numbers that were varied.
        skipped: Those that were not, and why.
        points: For each choice of a step of each lever the places of all teams; `None` where the rules do
            not allow these values.
    """

    levers: tuple[Lever, ...]
    skipped: Mapping[str, str] = field(default_factory=dict)
    points: Mapping[tuple[int, ...], Point | None] = field(default_factory=dict)

    @property
    def base(self) -> tuple[int, ...]:
        """The point of the rules as they are."""
        return tuple(lever.base for lever in self.levers)


@dataclass(frozen=True)
class Flip:
    """Two neighbouring steps of a lever between which ranks change, with all others as in the rules.

    Attributes:
        lever: Which.
        below: The lower value.
        above: The higher one.
        moved: Rank below and above of each team that moves.
    """

    lever: Lever
    below: float
    above: float
    moved: Mapping[str, tuple[int | None, int | None]]


def flips_of(found: WhatIf) -> Iterator[Flip]:
    """Where ranks change along each lever, with all others as in the rules."""
    for number, lever in enumerate(found.levers):
        along = [
            found.points[(*found.base[:number], step, *found.base[number + 1 :])]
            for step in range(len(lever.steps))
        ]
        for (below, before), (above, after) in pairwise(zip(lever.steps, along, strict=True)):
            if before is None or after is None:
                continue
            moved = {
                team: (place.rank, after[team].rank)
                for team, place in before.items()
                if place.rank != after[team].rank
            }
            if moved:
                yield Flip(lever, below, above, moved)


# Computing it --------------------------------------------------------------------------


def explore(
    competition: Competition,
    rule_set: RuleSet,
    results: Mapping[RunKey, Result | ScoreError],
    grid: Grid,
    *,
    registry: Registry,
    progress: Callable[[int, int], None] = lambda _done, _all: None,
) -> WhatIf:
    """Rank a competition at every point of a grid.

    Args:
        competition: Its teams, trials and runs.
        rule_set: By which it is ranked.
        results: Each run's result under that rule set, or why there is none.
        grid: For each number the values it may have.
        registry: The installed plugins.
        progress: Called before each point with how many are done, and of how many.

    Raises:
        RuleSetError: The rule set has no such number, or the grid has too many points.
    """
    levers, skipped = _levers(competition, rule_set, grid, registry)
    points = list(product(*(range(len(lever.steps)) for lever in levers))) if levers else []
    rules = {point: _rules_at(rule_set, levers, point) for point in points}
    measured = _measured(competition, rule_set, results, rules.values(), registry)
    found: dict[tuple[int, ...], Point | None] = {}
    for done, point in enumerate(points):
        progress(done, len(points))
        at = rules[point]
        found[point] = None if at is None else _ranked(competition, rule_set, at, results, measured)
    return WhatIf(tuple(levers), skipped, found)


def check_grid(competition: Competition, rule_set: RuleSet, grid: Grid, registry: Registry) -> None:
    """Refuse a grid that cannot be computed, before any run is scored.

    Raises:
        RuleSetError: The rule set has no such number, or the grid has too many points.
    """
    _levers(competition, rule_set, grid, registry)


def _levers(
    competition: Competition, rule_set: RuleSet, grid: Grid, registry: Registry
) -> tuple[list[Lever], dict[str, str]]:
    knobs = {knob.name: knob for knob in knobs_of(rule_set, registry)}
    stored = all(run.path.suffix == ".json" for run in competition.runs)
    levers: list[Lever] = []
    skipped: dict[str, str] = {}
    for name, values in grid.items():
        knob = knobs.get(name) or _given_nowhere(competition, name, knobs)
        steps = tuple(sorted({float(value) for value in values} | {knob.base}))
        stated = rule_set.parameters.get(name)
        unit, meaning = ("" if stated.unit == "1" else stated.unit, stated.meaning) if stated else ("", "")
        lever = Lever(name, steps, steps.index(knob.base), unit, meaning)
        if not knob.used:
            skipped[name] = UNUSED
        elif stored and knob.measured:
            skipped[name] = NEEDS_LOG
        else:
            levers.append(lever)
    count = prod(len(lever.steps) for lever in levers)
    if count > MOST_POINTS:
        raise RuleSetError(
            f"{count} points, each value with each, are more than {MOST_POINTS}",
            file=str(competition.file),
            place="$.what_if",
            hint="name fewer numbers, or fewer values of each",
        )
    return levers, skipped


def _given_nowhere(competition: Competition, name: str, knobs: Mapping[str, Knob]) -> Knob:
    raise RuleSetError(
        f"the rule set has no number {name!r} to vary",
        file=str(competition.file),
        place="$.what_if",
        hint=did_you_mean(name, list(knobs), what="it has"),
    )


def _rules_at(rule_set: RuleSet, levers: Sequence[Lever], point: tuple[int, ...]) -> RuleSet | None:
    """The rules at a point; `None` where they cannot be."""
    values = {
        lever.name: lever.steps[step] for lever, step in zip(levers, point, strict=True) if step != lever.base
    }
    try:
        return rule_set.with_parameters(values) if values else rule_set
    except (RuleSetError, FormulaError):
        return None


def _changed(before: RuleSet, after: RuleSet) -> list[str]:
    """The checks that measure with other numbers."""
    return [
        name
        for name, check in after.checks.items()
        if dict(check.parameters) != dict(before.checks[name].parameters)
    ]


_Variant = tuple[str, str]
"""A check, and its parameters as text."""


def _variant(rules: RuleSet, check: str) -> _Variant:
    return check, json.dumps(dict(rules.checks[check].parameters), sort_keys=True, default=str)


def _measured(
    competition: Competition,
    rule_set: RuleSet,
    results: Mapping[RunKey, Result | ScoreError],
    rules: Iterable[RuleSet | None],
    registry: Registry,
) -> dict[tuple[RunKey, _Variant], Findings | None]:
    """What checks with other numbers find in each run that has a log; `None` where they refuse the number."""
    variants = {_variant(at, check): at for at in rules if at is not None for check in _changed(rule_set, at)}
    found: dict[tuple[RunKey, _Variant], Findings | None] = {}
    if not variants:
        return found
    for key, log in logs_of(competition, rule_set, results, registry):  # one at a time: logs are large
        for variant, at in variants.items():
            try:
                found[key, variant] = log.measure(at, [variant[0]]).findings
            except (PluginError, RuleSetError):
                found[key, variant] = None
    return found


def _ranked(
    competition: Competition,
    rule_set: RuleSet,
    rules: RuleSet,
    results: Mapping[RunKey, Result | ScoreError],
    measured: Mapping[tuple[RunKey, _Variant], Findings | None],
) -> Point | None:
    variants = [_variant(rules, check) for check in _changed(rule_set, rules)]
    if any(measured.get((key, variant), ()) is None for key in results for variant in variants):
        return None
    spec = ranking_spec(rules, competition.ranking, file=str(competition.file))
    priced = {
        key: _priced(result, rules, {v[0]: measured[key, v] for v in variants if (key, v) in measured})
        for key, result in results.items()
    }
    return _places(rank_results(competition, spec, rules, priced), rules, spec)


def _priced(
    result: Result | ScoreError, rules: RuleSet, again: Mapping[str, Findings | None]
) -> Result | ScoreError:
    if isinstance(result, ScoreError):
        return result
    if again:
        # `reprice` looks for each check with the parameters of the new rules.
        checks: dict[str, CheckUse] = {
            name: {**use, "with": dict(rules.checks[name].parameters)} if name in again else use
            for name, use in result.checks.items()
        }
        kept = {key: f for key, f in result.measured.findings.items() if f.check not in again}
        new = {key: f for findings in again.values() for key, f in (findings or {}).items()}
        open_ = tuple(one for one in result.measured.open if one.check not in again)
        result = replace(
            result, checks=checks, measured=replace(result.measured, findings={**kept, **new}, open=open_)
        )
    sheet = rules.sheet
    try:
        if (
            sheet.needs_cohort
            or sheet.pooled
            or sheet.task is not None
            or result.status != "scored"
            or result.is_open
        ):
            return reprice(result, rules)
        value = value_of(result.measured.findings, result.measured.scopes, sheet, rules.policies)
    except FormulaError as error:
        return error
    if value is None:
        return reprice(result, rules)
    # The number alone: a ledger takes ten times as long, and nobody sees it.
    score = rounded(value, rules.digits)
    return replace(result, score=score, ledger=Line("score", "score", "amount", score, float(score)))


def _places(ranking: Ranking, rules: RuleSet, spec: Spec) -> Point:
    weighing = Weighing(spec.keep, spec.fill, spec.total.name)
    own: dict[str, list[RunOutcome]] = {standing.team: [] for standing in ranking.standings}
    parts: dict[RunKey, TaskAndSafety | None] = {}
    for run in ranking.runs:
        own[run.team].append(run)
        if run.kept and run.result is not None and run.score is not None:
            task = task_points(run.result.measured, rules, run.result.cohort)
            parts[run.key] = None if task is None else TaskAndSafety(task, run.score - task)
    return {
        standing.team: Place(
            standing.rank,
            standing.execution,
            parts_of_team(standing, own[standing.team], parts, weighing)[1].task,
        )
        for standing in ranking.standings
    }
