"""How much a score or a ranking depends on the numbers an organiser chose.

Each parameter of the formulas, and each number given to a monitor, is varied over a
range while everything else stays. Formulas need only the findings; a monitor's own
numbers need the log, to measure again.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, Generic, TypeVar

from ariac_score.checks.contracts import Monitor
from ariac_score.checks.registry import Registry
from ariac_score.engine.measure import measure_trial
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.engine.price import reprice
from ariac_score.engine.read import find_run, read_needed
from ariac_score.errors import (
    FormulaError,
    PluginError,
    ResultError,
    RuleSetError,
    ScoreError,
)
from ariac_score.ranking.competition import Competition, RunKey, work_by_of
from ariac_score.ranking.outcomes import Ranking
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.spec import ranking_spec
from ariac_score.results.doubt import left_open
from ariac_score.results.result import Measured, Result
from ariac_score.scoring.expression import text_of
from ariac_score.scoring.ledger import rounded
from ariac_score.scoring.pricing import value_of
from ariac_score.scoring.ruleset import Check, RuleSet
from ariac_score.trial.derive import Derivation
from ariac_score.trial.model import Trial

__all__ = [
    "Knob",
    "RankSensitivity",
    "RankShift",
    "RunLog",
    "ScoreSensitivity",
    "knobs_of",
    "logs_of",
    "rank_sensitivity",
    "score_sensitivity",
]

NEEDS_LOG = "needs the log, to measure again"
UNUSED = "the score does not use it"
PRECISION = 1e-6
"""How exactly the value is found at which something changes, relative to the range."""

_GRID = 8
"""Steps over a range; changes that cancel each other between two of them are not found."""
_NUDGE = 1e-4
"""Relative step of the central difference, far above the rounding of float64."""
_MOST_SHIFTS = 20
_AROUND = (0.5, 2.0)

T = TypeVar("T")


@dataclass(frozen=True)
class Knob:
    """A number that an organiser chose.

    Attributes:
        name: A parameter, or `check.parameter` of a monitor.
        base: Its value in the rule set.
        low: Lowest value it is given.
        high: Highest value.
        declared: Whether the rule set says the range; else it is half to double.
        check: The monitor it belongs to; empty for a parameter of the formulas.
        used: Whether the score depends on it.
        measured: The checks that find something else when it changes, so that the log is needed.
    """

    name: str
    base: float
    low: float
    high: float
    declared: bool
    check: str = ""
    used: bool = True
    measured: tuple[str, ...] = ()

    @property
    def parameter(self) -> str:
        """Its name without the check."""
        return self.name.rpartition(".")[2]


@dataclass(frozen=True)
class ScoreSensitivity:
    """What one number does to a score.

    Attributes:
        knob: The number.
        low: Score at its lowest value; `None` where there is none.
        base: Score as it is.
        high: Score at its highest value.
        elasticity: By how many percent the score changes for one percent of the number,
            at its value; `None` where the score or the number is 0.
        changes_below: The nearest lower value at which the rounded score differs; `None` when
            it is the same down to the lowest.
        changes_above: The nearest higher one.
        skipped: Why it was not varied; empty when it was.
    """

    knob: Knob
    low: float | None = None
    base: float | None = None
    high: float | None = None
    elasticity: float | None = None
    changes_below: float | None = None
    changes_above: float | None = None
    skipped: str = ""


@dataclass(frozen=True)
class RankShift:
    """A value of a number at which ranks change.

    Attributes:
        value: The value.
        before: Rank by team below it; `None` for a team without one.
        after: Rank by team from there on.
    """

    value: float
    before: Mapping[str, int | None]
    after: Mapping[str, int | None]


@dataclass(frozen=True)
class RankSensitivity:
    """What one number does to a ranking: where ranks change, from the lowest value up."""

    knob: Knob
    shifts: tuple[RankShift, ...] = ()
    skipped: str = ""


# Numbers -------------------------------------------------------------------------------


def knobs_of(rule_set: RuleSet, registry: Registry) -> list[Knob]:
    """The numbers of a rule set: parameters of its formulas, then the numbers given to its monitors.

    Raises:
        RuleSetError: A range is given for something of a monitor that is no number.
    """
    named = {
        text_of(node)
        for each in rule_set.sheet.reached(rule_set.sheet.score)
        for node in each.walk()
        if isinstance(node, ast.Name | ast.Attribute)
    }
    taken = {name: _takers(rule_set, name) for name in rule_set.parameters}
    knobs = [
        _knob(
            rule_set,
            name,
            float(one.value),
            takers=taken[name],
            used=name in named or not rule_set.sheet.scored.isdisjoint(taken[name]),
        )
        for name, one in rule_set.parameters.items()
        # The numbers of a map, such as a list of prices, are not varied one by one.
        if taken[name] or name.partition(".")[0] not in _taken_whole(rule_set)
    ]
    built = rule_set.build(registry)
    for check in rule_set.checks.values():
        if not isinstance(built[check.name], Monitor):
            continue
        ranged = [n.partition(".")[2] for n in rule_set.ranges if n.startswith(f"{check.name}.")]
        own = [parameter for parameter in check.parameters if parameter not in check.named]
        for parameter in dict.fromkeys([*own, *ranged]):
            value = check.parameters.get(parameter, getattr(built[check.name], parameter, None))
            if isinstance(value, int | float) and not isinstance(value, bool):
                name = f"{check.name}.{parameter}"
                used = check.name in rule_set.sheet.scored
                knobs.append(_knob(rule_set, name, float(value), check=check.name, used=used))
            elif parameter in ranged:
                raise RuleSetError(
                    f"a range is given for '{check.name}.{parameter}', which has no number",
                    file=rule_set.file,
                    place="$.ranges",
                    hint="give the parameter a number under 'with:'",
                )
    return knobs


def _takers(rule_set: RuleSet, name: str) -> tuple[str, ...]:
    """The checks that take a named parameter."""
    return tuple(check.name for check in rule_set.checks.values() if name in check.named.values())


def _taken_whole(rule_set: RuleSet) -> set[str]:
    """The groups of parameters that a check takes as a map."""
    named = {one for check in rule_set.checks.values() for one in check.named.values()}
    return named - set(rule_set.parameters)


def _knob(
    rule_set: RuleSet, name: str, base: float, *, used: bool, check: str = "", takers: tuple[str, ...] = ()
) -> Knob:
    declared = rule_set.ranges.get(name)
    # Sorted, for of a negative number the double is the lower one; of 0 there is neither half nor double.
    low, high = declared or (sorted(base * factor for factor in _AROUND) if base else (0.0, 1.0))
    return Knob(
        name, base, low, high, declared is not None, check, used, takers or ((check,) if check else ())
    )


def with_value(rule_set: RuleSet, knob: Knob, value: float) -> RuleSet:
    """The rule set with another value of a number."""
    if not knob.check:
        parameters = {**rule_set.sheet.parameters, knob.name: value}
        checks = {
            **rule_set.checks,
            **{name: _taking(rule_set, name, knob.name, value) for name in knob.measured},
        }
        # Without `expanded`: as text it would still show the old value.
        return replace(
            rule_set, sheet=replace(rule_set.sheet, parameters=parameters), checks=checks, expanded={}
        )
    check = rule_set.checks[knob.check]
    changed = replace(check, parameters={**check.parameters, knob.parameter: value})
    return replace(rule_set, checks={**rule_set.checks, check.name: changed}, expanded={})


def _taking(rule_set: RuleSet, name: str, parameter: str, value: float) -> Check:
    """A check with another value of the named parameter that it takes."""
    check = rule_set.checks[name]
    changed = {own: value for own, named in check.named.items() if named == parameter}
    return replace(check, parameters={**check.parameters, **changed})


# One score -----------------------------------------------------------------------------


class RunLog:
    """A trial read once, and measured under as many rule sets as needed."""

    def __init__(
        self,
        path: Path,
        rule_set: RuleSet,
        registry: Registry,
        *,
        also: tuple[Path, ...] = (),
        work_by: str = "",
    ) -> None:
        self.registry = registry
        by = work_by or rule_set.authority.work
        bundle, readers = find_run(path, registry, also=also, root=path, work_by=by)
        self.trial = read_needed(bundle, readers, prepare(rule_set, registry=registry))
        self._last: tuple[tuple[Derivation, ...], Trial] | None = None

    def measure(self, rule_set: RuleSet, only: Sequence[str] = ()) -> Measured:
        """What the checks of a rule set find in it, or what only some of them find."""
        prepared = prepare(rule_set, registry=self.registry)
        # Derived signals depend on the needs of all checks, so they are those of all even for one check.
        trial = self._derived(prepared)
        return measure_trial(trial, prepared.only(only) if only else prepared)

    def measure_again(self, measured: Measured, rule_set: RuleSet, checks: Sequence[str]) -> Measured:
        """What was measured, with the new findings of some checks."""
        kept = {name: f for name, f in measured.findings.items() if f.check not in checks}
        open_ = tuple(one for one in measured.open if one.check not in checks)
        new = self.measure(rule_set, checks)
        return replace(measured, findings={**kept, **new.findings}, open=(*open_, *new.open))

    def _derived(self, prepared: Prepared) -> Trial:
        wanted = prepared.derivations
        if self._last is None or self._last[0] != wanted:
            self._last = wanted, prepared.derived(self.trial)
        return self._last[1]


def score_sensitivity(
    result: Result, rule_set: RuleSet, *, registry: Registry, log: Path | None = None
) -> list[ScoreSensitivity]:
    """What each number of a rule set does to the score of a result.

    Args:
        result: The result.
        rule_set: By which it is priced; its checks must be among those measured.
        registry: The installed plugins.
        log: The log it was made from, for the numbers of its monitors.

    Raises:
        ResultError: The result has no score, or the log is not its log.
        RuleSetError: A check of the rule set was not measured.
    """
    again = reprice(result, rule_set, result.cohort)
    if again.score is None:
        raise ResultError(
            f"it has no score: {again.status}", hint="only a score can be sensitive to anything"
        )
    read = None if log is None else RunLog(log, rule_set, registry)
    # Compared before anything is varied: numbers of another log would look like effects of a parameter.
    if read is not None and _score(read.measure(rule_set), rule_set, again) != _score(
        again.measured, rule_set, again
    ):
        raise ResultError(
            "the log does not give the score of the result", file=log, hint="give the log it was made from"
        )
    found = []
    for knob in knobs_of(rule_set, registry):
        if not knob.used or (knob.measured and read is None):
            found.append(ScoreSensitivity(knob, skipped=NEEDS_LOG if knob.used else UNUSED))
        else:
            found.append(_score_over(knob, _scorer(knob, rule_set, again, read), rule_set.digits))
    return found


def _scorer(
    knob: Knob, rule_set: RuleSet, result: Result, log: RunLog | None
) -> Callable[[float], float | None]:
    def score(value: float) -> float | None:
        rules = with_value(rule_set, knob, value)
        measured = result.measured
        if knob.measured and log is not None:
            measured = log.measure_again(measured, rules, knob.measured)
        return _score(measured, rules, result)

    return score


def _score(measured: Measured, rule_set: RuleSet, result: Result) -> float | None:
    """The score, not rounded; `None` where there is none, as where a number is out of its domain."""
    try:
        return value_of(
            measured.findings,
            measured.scopes,
            rule_set.sheet,
            rule_set.policies,
            cohort=result.cohort,
            measures=measured.measures,
            left_open=left_open(measured, rule_set),
        )
    except FormulaError:
        return None


def _score_over(knob: Knob, score: Callable[[float], float | None], digits: int) -> ScoreSensitivity:
    def shown(value: float) -> str:
        found = _or_none(score, value)
        return "none" if found is None else str(rounded(found, digits))

    # A change is one that people see: of the rounded score.
    known = _Remembered(shown)
    below = _first_change(known, knob.base, knob.low)
    above = _first_change(known, knob.base, knob.high)
    return ScoreSensitivity(
        knob,
        _or_none(score, knob.low),
        score(knob.base),
        _or_none(score, knob.high),
        _elasticity(knob, score),
        below,
        above,
    )


def _or_none(score: Callable[[float], float | None], value: float) -> float | None:
    """The score; `None` also for a value its plugin refuses."""
    try:
        return score(value)
    except (PluginError, RuleSetError):
        return None


def _elasticity(knob: Knob, score: Callable[[float], float | None]) -> float | None:
    base = score(knob.base)
    less = _or_none(score, knob.base * (1 - _NUDGE))
    more = _or_none(score, knob.base * (1 + _NUDGE))
    if not knob.base or not base or less is None or more is None:
        return None
    return (more - less) / (2 * _NUDGE * base)


class _Remembered(Generic[T]):
    """A function whose values are kept."""

    def __init__(self, function: Callable[[float], T]) -> None:
        self._function, self._known = function, dict[float, T]()

    def __call__(self, value: float) -> T:
        if value not in self._known:
            self._known[value] = self._function(value)
        return self._known[value]


def _first_change(of: Callable[[float], Any], base: float, end: float) -> float | None:
    """The value nearest to the base, on the way to an end, at which something is not as at the base."""
    previous = base
    for step in range(1, _GRID + 1):
        value = base + (end - base) * step / _GRID
        if of(value) != of(base):
            return _edge(of, previous, value, PRECISION * abs(end - base))
        previous = value
    return None


def _edge(of: Callable[[float], Any], same: float, other: float, precision: float) -> float:
    """Where, between two values, the outcome stops being that of the first; the far side of the edge."""
    at_first = of(same)
    while abs(other - same) > precision:
        middle = (same + other) / 2
        if middle in (same, other):  # neighbours in float64: nothing lies between them
            break
        if of(middle) == at_first:
            same = middle
        else:
            other = middle
    return other


# A ranking -----------------------------------------------------------------------------


def rank_sensitivity(
    competition: Competition,
    rule_set: RuleSet,
    results: Mapping[RunKey, Result | ScoreError],
    *,
    registry: Registry,
) -> list[RankSensitivity]:
    """The values of each number of a rule set at which ranks of a competition change.

    Args:
        competition: Its teams, trials and runs.
        rule_set: By which it is ranked.
        results: Each run's result, or why there is none.
        registry: The installed plugins.
    """
    stored = all(run.path.suffix == ".json" for run in competition.runs)
    logs: dict[RunKey, RunLog] = {}
    found = []
    for knob in knobs_of(rule_set, registry):
        if not knob.used or (knob.measured and stored):
            found.append(RankSensitivity(knob, skipped=NEEDS_LOG if knob.used else UNUSED))
            continue
        if knob.measured and not logs:
            logs = dict(logs_of(competition, rule_set, results, registry))
        ranks = _Remembered(_ranker(knob, competition, rule_set, results, logs))
        found.append(RankSensitivity(knob, tuple(_shifts(knob, ranks))))
    return found


def logs_of(
    competition: Competition,
    rule_set: RuleSet,
    results: Mapping[RunKey, Result | ScoreError],
    registry: Registry,
) -> Iterator[tuple[RunKey, RunLog]]:
    """The log of each run that has a result and was not stored, opened as it is asked for."""
    teams = {team.id: team.config for team in competition.teams}
    trials = {trial.id: trial.config for trial in competition.trials}
    by = work_by_of(competition, rule_set.authority)
    for run in competition.runs:
        if isinstance(results.get(run.key), Result) and run.path.suffix != ".json":
            also = tuple(c for c in (trials.get(run.trial), teams.get(run.team)) if c)
            yield run.key, RunLog(run.path, rule_set, registry, also=also, work_by=by)


Ranks = Mapping[str, int | None]


def _ranker(
    knob: Knob,
    competition: Competition,
    rule_set: RuleSet,
    results: Mapping[RunKey, Result | ScoreError],
    logs: Mapping[RunKey, RunLog],
) -> Callable[[float], Ranks | None]:
    def ranks(value: float) -> Ranks | None:
        rules = with_value(rule_set, knob, value)
        try:
            priced = {key: _under(rules, knob, result, logs.get(key)) for key, result in results.items()}
        except (PluginError, RuleSetError):  # a plugin refuses this value: nobody has a rank there
            return None
        ranking = rank_results(
            competition, ranking_spec(rules, competition.ranking, file=str(competition.file)), rules, priced
        )
        return _ranks(ranking)

    return ranks


def _under(
    rules: RuleSet, knob: Knob, result: Result | ScoreError, log: RunLog | None
) -> Result | ScoreError:
    """A run priced by other rules, and measured again where a monitor's number changed."""
    if isinstance(result, ScoreError):
        return result
    if knob.measured:
        # `reprice` looks for each check with the parameters of the new rules.
        checks = dict(result.checks)
        for check in set(knob.measured) & set(checks):
            checks[check] = {**checks[check], "with": dict(rules.checks[check].parameters)}
        # A stored run among logs cannot be measured again: its findings stay.
        measured = (
            result.measured if log is None else log.measure_again(result.measured, rules, knob.measured)
        )
        result = replace(result, measured=measured, checks=checks)
    try:
        return reprice(result, rules)
    except FormulaError as error:
        return error


def _ranks(ranking: Ranking) -> Ranks:
    return {standing.team: standing.rank for standing in sorted(ranking.standings, key=lambda s: s.team)}


def _shifts(knob: Knob, ranks: Callable[[float], Ranks | None]) -> Iterator[RankShift]:
    """Every value at which ranks change, from the lowest up, as far as a grid shows them."""
    precision = PRECISION * max(abs(knob.low), abs(knob.high))
    grid = sorted(
        {knob.low + (knob.high - knob.low) * step / _GRID for step in range(_GRID + 1)} | {knob.base}
    )
    grid = [value for value in grid if knob.low <= value <= knob.high]
    count = 0  # bounded: every edge takes some twenty rankings to find
    for left, right in pairwise(grid):
        at = left
        while ranks(at) != ranks(right) and count < _MOST_SHIFTS:
            value = _edge(ranks, at, right, precision)
            before, after = ranks(at), ranks(value)
            yield RankShift(value, before or {}, after or {})
            at, count = value, count + 1
