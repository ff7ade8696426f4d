"""Every check of a rule set run on a trial."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from ariac_score.checks.contracts import SignalNeed
from ariac_score.checks.finding_contract import watched_in
from ariac_score.checks.findings import Finding, Verdict, canonical
from ariac_score.checks.measures import measures_of
from ariac_score.checks.open_findings import OpenFindings
from ariac_score.documents.given import refuse_other
from ariac_score.engine.ask import ask_worlds, charts_of
from ariac_score.engine.open_window import ended_at_cut, opened_by_cut, opened_by_window
from ariac_score.engine.prepared import Prepared, PreparedCheck, Rules, prepare
from ariac_score.engine.window_ends import open_throughout, opened_by_ends
from ariac_score.errors import LogError
from ariac_score.monitors.broken_bounds import broken_bounds
from ariac_score.results.result import Coverage, Measured, Result
from ariac_score.results.sketch import Sketch, sketch_of
from ariac_score.scoring.levels import TRIAL
from ariac_score.scoring.ruleset import Check, RuleSet
from ariac_score.scoring.scope import Scope
from ariac_score.trial.events import ORDER_ANNOUNCED
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Series, Signal
from ariac_score.trial.spans import Span, distinct, longest_silence_s
from ariac_score.trial.vocabulary import quantity_of
from ariac_score.trial.window import lasted_of
from ariac_score.trial.work import Fact, WorkItem, announced_s

_RULES = "ariac_score.rules"

__all__ = ["decidable", "measure_trial", "needs_alike", "sketch_trial", "stored_findings", "stored_name"]


def measure_trial(trial: Trial, rules: Rules, *, known: Result | None = None) -> Measured:
    """Run every check on a trial.

    Args:
        trial: With the derived signals, as `open_trial` gives it.
        rules: A rule set, its name or path; or prepared already (`prepare`).
        known: A result whose findings hold for this trial; checks that it has are not run.

    Raises:
        PluginError: A plugin raised, or yielded nothing or something else.
        LogError: A signal is recorded in another unit than a check reads it in.
        RuleSetError: The trial has work of a level that the rule set does not declare, or a check asks
            for a quantity that nobody knows.
    """
    refuse_other(trial, Trial, "a trial", "open_trial(path, rules) reads one")
    prepared = prepare(rules)
    findings: dict[str, Finding] = {}
    opened: list[OpenFindings] = []
    trial = replace(trial, between=prepared.between_of(trial))
    _refuse_broken_bounds(trial, prepared)
    # A misspelt quantity is not one that the log happens to lack.
    prepared.refuse_unknown_quantities({quantity_of(signal.name) for signal in trial.sampled})
    for name, each in prepared.checks.items():
        _refuse_recorded_units(trial, name, each.needs)
        wanted = prepared.rule_set.checks[name]
        before = stored_name(known, wanted) if known else None
        if known and before is not None:
            found, worlds = stored_findings(known, before, wanted), _stored_worlds(known, before, wanted)
        else:
            found, worlds = _asked(name, each, trial, prepared)
        opened += worlds
        for number, finding in enumerate(found, start=1):
            findings[f"{name}#{number}"] = finding
    return Measured(
        trial=trial.id,
        findings=findings,
        scopes=_scopes(trial, prepared.rule_set),
        window=trial.window,
        lasted=lasted_of(trial),
        orders={item.id: announced_s(item) for item in trial.work},
        coverage=tuple(_coverage(signal, trial.window) for signal in trial.sampled),
        log_defects=trial.log_defects,
        unrecorded=trial.unrecorded,
        witnessed=tuple(sorted(trial.witnessed)),
        clock=trial.clock,
        official=trial.official,
        team=trial.team.name if trial.team else "",
        watched=watched_in(trial),
        statements=trial.statements,
        cut=trial.cut,
        unofficial=unofficial_of(trial),
        measures={
            name: dict(own) for name, each in prepared.checks.items() if (own := measures_of(each.check))
        },
        open=tuple(opened),
    )


def _asked(
    name: str, each: PreparedCheck, trial: Trial, prepared: Prepared
) -> tuple[list[Finding], list[OpenFindings]]:
    """What a check finds, and what it leaves open, with what hangs on a start or end that nobody knows."""
    seen = ended_at_cut(trial, prepared) if prepared.rule_set.checks[name].group != _RULES else trial
    found, worlds = ask_worlds(each.plugin, name, each.check, seen, words=prepared.words)
    worlds = opened_by_ends((found, worlds), each, seen, prepared)
    found = open_throughout(found, seen)
    if trial.cut is None or not trial.cut.open_end or trial.started_s is None:
        found, by_window = opened_by_window(found, each, seen, prepared)
        hang_on_window = {one.subject for one in by_window}
        worlds = [*(one for one in worlds if one.subject not in hang_on_window), *by_window]
    return opened_by_cut(found, worlds, each, trial, prepared)


def unofficial_of(trial: Trial) -> tuple[str, ...]:
    """Why nothing official can follow from what is measured of a trial, in words."""
    return () if trial.cut is None else (trial.cut.words,)


def _refuse_broken_bounds(trial: Trial, prepared: Prepared) -> None:
    """Refuse a log in which a body is faster than the organiser says that it can be.

    Raises:
        LogError: Naming the body, the time and the bound.
    """
    broken = broken_bounds(trial, prepared.between)
    if broken is None:
        return
    of = prepared.rule_set.file if broken.stated == "rule_set" else prepared.log_map.file
    what = "max_speed_m_s" if broken.unit == "m/s" else "max_acceleration_m_s2"
    raise LogError(
        f"{broken.bodies!r} would need {broken.needed:.3g} {broken.unit} at {broken.t_s:.3f} s, and "
        f"'bounds:' of {of} states at most {broken.bound:g} {broken.unit} ({what})",
        file=trial.id,
        place=broken.signal,
        hint="correct 'bounds:'; where the recording is at fault, state its 'time_error_s' or "
        "'distance_error_m' there, or find out what moved the body",
    )


def stored_name(known: Result, check: Check) -> str | None:
    """The name of a check in a stored result; `None` when it did not run there.

    It is the same check when plugin and parameters are: names are only labels of a rule set.
    """
    for name, stored in known.checks.items():
        if stored["use"] == check.use and stored["with"] == dict(check.parameters):
            return name
    return None


def stored_findings(known: Result, name: str, check: Check) -> list[Finding]:
    """What a check of a stored result found, as findings of this one."""
    found = known.measured.of(name).values()
    return [f if f.check == check.name else replace(f, check=check.name) for f in found]


def _stored_worlds(known: Result, name: str, check: Check) -> list[OpenFindings]:
    """What is open of a check of a stored result, under the name that it has here."""
    found = [one for one in known.measured.open if one.check == name]
    return [one if name == check.name else one.renamed(check.name) for one in found]


def needs_alike(first: Prepared, second: Prepared) -> bool:
    """Whether two rule sets read the same trial from the same files, so that findings hold for both."""
    return (
        _named(first.rule_set.competition) == _named(second.rule_set.competition)
        and first.rule_set.authority == second.rule_set.authority
        and first.log_map.sha256 == second.log_map.sha256
        and list(dict.fromkeys(first.needs)) == list(dict.fromkeys(second.needs))
    )


def _named(competition: Check | None) -> tuple[str, Mapping[str, Any]] | None:
    return None if competition is None else (competition.use, competition.parameters)


def _refuse_recorded_units(trial: Trial, name: str, needs: Iterable[SignalNeed]) -> None:
    """Refuse a log of which a check would take numbers in one unit for numbers in another."""
    units = {need.quantity: need.unit for need in needs}
    for signal in trial.sampled:
        unit = units.get(quantity_of(signal.name), signal.unit)
        if unit != signal.unit:
            raise LogError(
                f"signal {signal.name!r} is in {signal.unit!r}, but check {name!r} reads it in {unit!r}",
                file=trial.id,
                hint="name the unit of the log in the rule set, or record the signal in that of the check",
            )


def sketch_trial(trial: Trial, prepared: Prepared, measured: Measured) -> Sketch:
    """What a page draws of a trial, finest where something was found.

    Args:
        trial: With the derived signals.
        prepared: The rule set, with its checks.
        measured: What they found.

    Raises:
        PluginError: A monitor failed to draw its charts.
    """
    charts = {name: charts_of(each.plugin, name, each.check, trial) for name, each in prepared.checks.items()}
    # The worst first: only the first few of a chart are drawn finer.
    found = sorted(
        (f for f in measured.findings.values() if f.robustness is not None and (f.span or f.evidence)),
        key=lambda f: f.robustness or 0.0,
    )
    moments: dict[tuple[str, str], list[Span]] = {}
    instants_s: dict[str, list[float]] = {}
    for finding in found:
        at_s = finding.evidence[0].t_s if finding.evidence else 0.0
        span = finding.span or Span(at_s, at_s)
        moments.setdefault((finding.check, finding.subject), []).append(span)
        if finding.verdict is Verdict.VIOLATED:
            worst_s = at_s if finding.evidence else span.start_s
            instants_s.setdefault(finding.subject, []).extend((worst_s, span.start_s, span.end_s))
    return sketch_of(trial, charts, moments, prepared.words.spoken, instants_s)


def _scopes(trial: Trial, rule_set: RuleSet) -> Scope:
    """The work of a trial as its rule set prices it.

    Raises:
        RuleSetError: The rule set prices work, and does not declare a level that the trial has, or in
            another order.
    """
    index = _announced_as(trial)
    outermost = tuple(_scope(item, "", {"index": index[item.id]}) for item in trial.work)
    whole: dict[str, Fact] = {"orders": len(outermost), "duration_s": canonical(trial.duration_s)}
    # Of the trial only what formulas may name: a record may state a hundred numbers.
    declared = rule_set.sheet.facts_of(TRIAL).keys() - whole.keys()
    whole |= {name: trial.facts[name] for name in sorted(declared & trial.facts.keys())}
    scopes = Scope(TRIAL, "", whole, outermost)
    if rule_set.sheet.levels != (TRIAL,):
        _refuse_other_levels(scopes, rule_set)
    return scopes


def _scope(item: WorkItem, inside: str, facts: Mapping[str, Fact] = MappingProxyType({})) -> Scope:
    """The scope of an item, with those of the items inside it."""
    path = f"{inside}/{item.id}" if inside else item.id
    facts = {**facts, **item.facts}
    for name, value in facts.items():
        known = value is None or isinstance(value, (int, float, str))
        if not known or (isinstance(value, float) and not math.isfinite(value)):
            raise LogError(
                f"fact {name!r} of {path!r} is {value!r}, which is no number, no text and not absent",
                hint="correct the log, or the reader or competition that states it",
            )
    return Scope(item.level, path, facts, tuple(_scope(inner, path) for inner in item.items))


def _refuse_other_levels(scope: Scope, rule_set: RuleSet) -> None:
    """Refuse work that no formula could reach: sums over it would be 0, as if there were none."""
    levels = rule_set.sheet.levels
    for inner in scope.inner:
        if inner.level not in levels[: levels.index(scope.level)]:
            known = inner.level in levels
            raise LogError(
                f"{inner.path!r} of level {inner.level!r} lies inside one of level {scope.level!r}"
                if known
                else f"the trial has {inner.path!r} of level {inner.level!r}, which is not declared",
                hint=f"correct the log, or 'levels:' of {rule_set.file or rule_set.id}; levels from the "
                f"inside out, as declared: {', '.join(levels)}",
            )
        _refuse_other_levels(inner, rule_set)


def _announced_as(trial: Trial) -> dict[str, int]:
    """The place of each outermost item by first announcement, by id: 0 for the first one.

    Those that were never announced come after the others. Where no times are known, and
    among equals, the order of the log or the configuration counts.
    """
    # The event counts before `announced_s`, which an update of the item may have moved.
    first_s: dict[str, float] = {}
    for event in trial.events_of(ORDER_ANNOUNCED):
        first_s.setdefault(event.subject, event.t_s)
    times = {item.id: first_s.get(item.id, announced_s(item)) for item in trial.work}
    announced = sorted((time_s, place) for place, time_s in enumerate(times.values()) if time_s is not None)
    never = [place for place, time_s in enumerate(times.values()) if time_s is None]
    names = list(times)
    return {names[place]: i for i, place in enumerate([*(place for _, place in announced), *never])}


def _coverage(signal: Signal | Series, window: Span | None) -> Coverage:
    span = signal.span
    rate = (len(signal) - 1) / span.duration_s if span and span.duration_s > 0 else 0.0
    largest_gap_s = longest_silence_s(distinct(signal.t), window) if window else 0.0
    known = Coverage(signal.name, len(signal), rate, largest_gap_s, signal.source)
    if not isinstance(signal, Signal):
        return known
    return replace(known, stamp_jitter_s=signal.stamp_jitter_s, stated_rate_hz=signal.stated_rate_hz)


def decidable(trial: Trial, prepared: Prepared) -> list[tuple[str, str]]:
    """For each check of a rule set whether this trial can decide it, and if not, why.

    Args:
        trial: As read, with every quantity the log has.
        prepared: The rule set, with its checks.
    """
    measured = measure_trial(prepared.derived(trial), prepared)
    answers = []
    for name in prepared.checks:
        found = measured.of(name).values()
        undecided = [f for f in found if f.verdict is Verdict.INCONCLUSIVE]
        idle = [f for f in found if f.verdict is Verdict.NOT_APPLICABLE]
        if undecided:
            answers.append((name, f"undecided: {undecided[0].message}"))
        elif len(idle) == len(found):
            answers.append((name, f"not applicable: {idle[0].message}"))
        else:
            answers.append((name, "has what it needs"))
    return answers
