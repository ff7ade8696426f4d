"""What a log leaves open for a score, as variables: each lies between its best and its worst world."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from math import ceil, inf

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.checks.open_findings import Cause, OpenFindings
from ariac_score.scoring.cohort import CohortValues
from ariac_score.trial.spans import Span
from ariac_score.trial.window import Lasted

__all__ = ["DURATION", "NOT_SEEN", "OF_RUNS", "TIMES", "LeftOpen", "Variable", "variables_of"]

DURATION = "trial.duration_s"
"""The one fact that a log can leave open, as formulas name it."""
OF_RUNS = "runs."
"""How the names begin of what all runs of a team did."""

TIME, DEPTH = "time_in_violation_s", "relative_depth_integral_s"
TIMES = (TIME, DEPTH)
"""Quantities that are at most the time itself: a relative depth is at most 1."""
NOT_SEEN = {"worst": "not seen, counted at its worst", "best": "not seen, counted at its best"}
SEEN_IN_PART = "seen in part, counted at its worst"


@dataclass(frozen=True)
class LeftOpen:
    """What pricing knows of what a log leaves open.

    Attributes:
        findings: What checks find in the best and the worst world, by check and subject.
        counts: Which end of the interval is the score: `worst`, `best`, or `withhold` for none.
        monitors: The checks of which one undecided finding may stand for any number of violations; of all
            others it stands for one verdict.
        uncritical: Those of which no violation is critical.
        pauses_s: By check how long a pause must be for two violations to be two.
        watched: The time in which violations may have been.
        endless: Whether nobody knows when the competition started or ended: then nothing says how much more
            of it there was than was recorded, and who stops a recording early gains nothing.
        open_end_s: Up to when the log goes, where nobody knows for how long the trial went on; else `None`.
            Of a monitor what is undecided from then on has no bound.
        work_open: Why more may have been asked for than the trial has, so that no number is its score; empty
            where that is known.
        lasted: For how long the competition may have lasted; `None` where that is known.
        ruled: Ids of findings that nobody saw and stewards call violated: at its best each is one violation.
    """

    findings: tuple[OpenFindings, ...] = ()
    counts: str = "worst"
    monitors: frozenset[str] = frozenset()
    uncritical: frozenset[str] = frozenset()
    pauses_s: Mapping[str, float] = field(default_factory=dict)
    watched: Span | None = None
    endless: bool = False
    open_end_s: float | None = None
    work_open: str = ""
    lasted: Lasted | None = None
    ruled: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Variable:
    """One thing that is open: the findings of a check about a subject, one undecided finding, or a duration.

    Attributes:
        key: Its name among the inputs of a formula.
        check: Whose findings; `DURATION`, which has none: the duration of the trial is its one limit; or a
            `runs.…`, what other runs of the team did, likewise.
        subject: Whom they are about.
        best: The findings in its best world, by id.
        worst: Those in its worst world.
        seen: Ids of the findings that these replace.
        causes: Why it is open.
        is_verdict: Whether it is one verdict, so that there is no world between both.
        tight: Whether both worlds may have been.
        fewest: No world has fewer violations.
        most: No world has more.
        limits: Of quantities that are not measured, the value in the best and the worst world; `None` for
            either where nothing bounds it. Those of `best` and `worst` where it is `None`.
        endless: Whether there may have been more of it than in the worst world, for any time.
        turns: Whether it is kept or broken and nothing between, whatever its numbers are.
    """

    key: str
    check: str
    subject: str
    best: Mapping[str, Finding]
    worst: Mapping[str, Finding]
    seen: tuple[str, ...]
    causes: tuple[Cause, ...]
    is_verdict: bool
    tight: bool
    fewest: float
    most: float
    limits: Mapping[str, tuple[float, float]] | None = None
    endless: bool = False
    turns: bool = False

    @property
    def is_input(self) -> bool:
        """Whether it is a number itself, and nothing that a check found."""
        return self.check == DURATION or self.check.startswith(OF_RUNS)

    def world(self, *, worst: bool) -> Mapping[str, Finding]:
        """Its findings in one of its two worlds."""
        return self.worst if worst else self.best


def variables_of(
    findings: Mapping[str, Finding],
    left_open: LeftOpen,
    open_checks: Iterable[str],
    measures: Mapping[str, Mapping[str, Measure]],
    cohort: CohortValues | None = None,
) -> list[Variable]:
    """What is open among the findings of some checks.

    Args:
        findings: As the checks saw them, by id.
        left_open: What the log leaves open.
        open_checks: The checks whose undecided findings have no policy of their own, and `DURATION` and
            those `runs.…` that are to be priced.
        measures: What checks declare of their quantities, by check and quantity.
        cohort: With what other runs of the team did.
    """
    among = frozenset(open_checks)
    found: list[Variable] = []
    covered: set[str] = set()
    for one in left_open.findings:
        if one.check not in among:
            continue
        seen = tuple(k for k, f in findings.items() if (f.check, f.subject) == (one.check, one.subject))
        covered.update(seen)
        watched = one.check in left_open.monitors
        found.append(_between(one, seen, endless=left_open.endless and watched, watched=watched))
    for key in sorted(findings):
        finding = findings[key]
        if finding.check not in among or key in covered:
            continue
        if key in left_open.ruled:
            found += _ruled(_unwatched(key, finding, left_open, measures.get(finding.check, {})))
        elif finding.verdict is Verdict.INCONCLUSIVE:
            if finding.check in left_open.monitors:
                found.append(_unwatched(key, finding, left_open, measures.get(finding.check, {})))
            else:
                found.append(_undecided(key, finding, measures.get(finding.check, {})))
    if left_open.lasted is not None and DURATION in among:
        found.append(_duration(left_open.lasted))
    open_runs = {} if cohort is None else cohort.open_runs
    return found + [_of_others(name, *ends) for name, ends in open_runs.items() if name in among]


def _duration(lasted: Lasted) -> Variable:
    """How long the competition lasted: at its worst, as a limit, it was the longest."""
    longest_s = inf if lasted.most_s is None else lasted.most_s
    return _number(DURATION, lasted.least_s, longest_s, lasted.why, tight=True)


def _number(name: str, least: float, most: float, why: str, *, tight: bool) -> Variable:
    """Something that is a number itself, by its name in formulas."""
    return Variable(
        key=name,
        check=name,
        subject="",
        best={},
        worst={},
        seen=(),
        causes=(Cause(why),),
        is_verdict=False,
        tight=tight,
        fewest=0,
        most=0,
        limits={name: (least, most)},
    )


def _of_others(name: str, least: float, most: float) -> Variable:
    """What other runs of the team did."""
    why = "another run of the team, which is open itself, and the rules count what all runs did"
    return _number(name, least, most, why, tight=False)


def _between(one: OpenFindings, seen: tuple[str, ...], *, endless: bool, watched: bool) -> Variable:
    in_best, in_worst = _violations(one.best.values()), _violations(one.worst.values())
    return Variable(
        key=f"{one.check} of {one.subject}",
        check=one.check,
        subject=one.subject,
        best=one.best,
        worst={key: _as_at_worst(f, one.best.values()) for key, f in one.worst.items()},
        seen=seen,
        causes=one.causes or (Cause(f"{one.check} of {one.subject} was not seen"),),
        is_verdict=False,
        tight=one.tight,
        fewest=min(in_best, in_worst),
        most=inf if endless else max(in_best, in_worst),
        endless=endless,
        # A monitor may have found less of a violation than its worst world has.
        turns=not watched and len(one.best) == len(one.worst) == 1,
    )


def _as_at_worst(finding: Finding, best: Iterable[Finding]) -> Finding:
    """A finding of the worst world; of a violation it says whether all of it may not have been."""
    if finding.verdict is not Verdict.VIOLATED:
        return finding
    certain = any(
        one.verdict is Verdict.VIOLATED and one.span and finding.span and one.span.overlaps(finding.span)
        for one in best
    )
    return replace(finding, message=f"{SEEN_IN_PART if certain else NOT_SEEN['worst']}: {finding.message}")


def _violations(findings: Iterable[Finding]) -> int:
    return sum(1 for finding in findings if finding.verdict is Verdict.VIOLATED)


def _new_ones(span: Span | None, pause_s: float) -> float:
    """How many violations can begin in a stretch, with pauses of at least so long between them."""
    if pause_s <= 0 or span is None:
        return inf
    return max(1, ceil(span.duration_s / pause_s - 1e-9))


def _unwatched(key: str, finding: Finding, left_open: LeftOpen, declared: Mapping[str, Measure]) -> Variable:
    """An undecided stretch of a monitor that says nothing of it: never violated, or all the time."""
    end_s = left_open.open_end_s
    if end_s is not None and (finding.span is None or finding.span.end_s >= end_s - 1e-9):
        return _without_end(_undecided(key, finding, declared), declared)
    span = finding.span or left_open.watched
    if span is None:  # the log tells of no time at all
        return _without_end(_undecided(key, finding, declared), declared)
    quantities = {**finding.quantities, **dict.fromkeys(TIMES, span.duration_s)}
    worst = replace(
        _not_seen(finding, "worst"),
        verdict=Verdict.VIOLATED,
        span=span,
        quantities=quantities,
        critical=finding.check not in left_open.uncritical,
    )
    return Variable(
        key=key,
        check=finding.check,
        subject=finding.subject,
        best={key: _satisfied(finding, dict.fromkeys(quantities, 0.0))},
        worst={key: worst},
        seen=(key,),
        causes=(Cause(finding.message),),
        is_verdict=False,
        tight=False,
        fewest=0,
        most=inf if left_open.endless else _new_ones(span, left_open.pauses_s.get(finding.check, 0.0)),
        endless=left_open.endless,
    )


def _ruled(one: Variable) -> list[Variable]:
    """A stretch that stewards call violated: at least once, at most as before; none where it has no end."""
    if one.endless:
        return []
    best = {key: replace(finding, verdict=Verdict.VIOLATED) for key, finding in one.best.items()}
    # Where nothing says how many there may have been, it is the one that they ruled about.
    return [replace(one, best=best, fewest=1, most=1 if one.most == inf else one.most)]


def _without_end(one: Variable, declared: Mapping[str, Measure]) -> Variable:
    """An undecided stretch that nobody knows the end of: any number of violations, however long they were."""
    (key,) = one.seen
    # What is never negative grows with what is seen; of anything else nobody knows which way it goes.
    limits = {name: (0.0 if each.is_never_negative else -inf, inf) for name, each in declared.items()}
    worst = {key: replace(one.worst[key], critical=True, span=None)}
    return replace(one, worst=worst, is_verdict=False, tight=False, most=inf, limits=limits, endless=True)


def _undecided(key: str, finding: Finding, declared: Mapping[str, Measure]) -> Variable:
    """One verdict that is open, with the quantities that go with it."""
    limits = {
        name: (finding.quantities[name],) * 2 if name in finding.quantities else _limits(one)
        for name, one in declared.items()
    }
    at_best = {name: _finite(best, worst) for name, (best, worst) in limits.items()}
    at_worst = {name: _finite(worst, best) for name, (best, worst) in limits.items()}
    return Variable(
        key=key,
        check=finding.check,
        subject=finding.subject,
        best={key: _satisfied(finding, {**finding.quantities, **at_best})},
        worst={
            key: replace(
                _not_seen(finding, "worst"),
                verdict=Verdict.VIOLATED,
                quantities={**finding.quantities, **at_worst},
                units=_units(finding, at_worst, declared),
            )
        },
        seen=(key,),
        causes=(Cause(finding.message),),
        is_verdict=True,
        tight=True,
        fewest=0,
        most=1,
        limits={**{name: (value, value) for name, value in finding.quantities.items()}, **limits},
    )


def _finite(one: float, other: float) -> float:
    """A number that can stand in a finding, where the bound on that side is none."""
    return next((number for number in (one, other) if abs(number) != inf), 0.0)


def _limits(one: Measure) -> tuple[float, float]:
    """The value of a quantity in the best and the worst world, as far as its check declares them.

    Only a number that a check calls the best or the worst is an end: nothing earned is the reference of a
    ledger for points, and not the best.
    """
    bottom = 0.0 if one.is_never_negative else -inf
    best = one.best if one.best is not None else {"penalty": 0.0, "factor": 1.0, "points": inf}.get(one.role)
    worst = one.worst if one.worst is not None else {"penalty": inf, "points": bottom}.get(one.role)
    if best is None:
        return (bottom, inf) if worst is None else (bottom if worst > bottom else inf, worst)
    if worst is not None:
        return best, worst
    # On which side of the best the worst lies, nobody says.
    return (best, inf) if best == bottom else (bottom, inf)


def _units(finding: Finding, names: Iterable[str], declared: Mapping[str, Measure]) -> dict[str, str]:
    return {**finding.units, **{name: declared[name].unit for name in names}}


def _satisfied(finding: Finding, quantities: Mapping[str, float]) -> Finding:
    return replace(_not_seen(finding, "best"), verdict=Verdict.SATISFIED, quantities=quantities)


def _not_seen(finding: Finding, world: str) -> Finding:
    return replace(finding, message=f"{NOT_SEEN[world]}: {finding.message}")
