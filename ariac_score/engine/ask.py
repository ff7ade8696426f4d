"""Running one check on a trial: its findings, its failures named and never swallowed."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

from ariac_score.checks.contracts import Charting, Margined, Monitor, Rule
from ariac_score.checks.finding_contract import Grounds, Subjects, breach_of, shown, watched_in
from ariac_score.checks.findings import Finding, settled
from ariac_score.checks.guarded import broken
from ariac_score.checks.measures import Measure
from ariac_score.checks.open_findings import OpenFindings, Worlds
from ariac_score.checks.registry import Plugin
from ariac_score.checks.units import is_unit
from ariac_score.engine.signal_needs import needs_of
from ariac_score.errors import LogError, MissingSignalError, OtherUnitError, PluginError
from ariac_score.installed.captured_output import fault_of, quiet
from ariac_score.scoring.scope import is_inside
from ariac_score.trial.chart import Chart
from ariac_score.trial.model import Trial
from ariac_score.trial.vocabulary import QUANTITIES
from ariac_score.trial.words import Words
from ariac_score.trial.work import WorkItem, paths_at

__all__ = [
    "BUDGET_S",
    "ONLY_OFFICIAL",
    "SMALLEST_LOG_SAMPLES",
    "ask",
    "ask_worlds",
    "budget_of",
    "charts_of",
    "margins_of",
]

Notice = Callable[[str, str], None]

BUDGET_S = 30.0
"""Processor time a plugin may take for a million samples, s. Generous: a vectorised monitor takes 0.1 s."""

SMALLEST_LOG_SAMPLES = 100_000
"""A shorter log is allowed the time of one of this length, for calls and imports cost time too."""


ONLY_OFFICIAL = "what it asked for is not recorded, only its official score"
"""Why nothing about an item is decided that is known from an official text alone."""

MOST_FINDINGS = 250_000
"""A check that gives more is taken for one that never ends; a result of so many could not be read again."""


def budget_of(trial: Trial, budget_s: float = BUDGET_S) -> float:
    """Processor time a plugin may take for a trial, s.

    Args:
        trial: Whose samples count.
        budget_s: Allowed for a million samples.
    """
    samples = sum(map(len, trial.sampled))
    return budget_s * max(samples, SMALLEST_LOG_SAMPLES) / 1e6


def ask(
    plugin: Plugin,
    name: str,
    check: Rule | Monitor,
    trial: Trial,
    *,
    notice: Notice | None = None,
    words: Words | None = None,
) -> list[Finding]:
    """All findings of one check about a trial, in order, with the numbers as they will be stored.

    Arguments and errors are those of `ask_worlds`.
    """
    return ask_worlds(plugin, name, check, trial, notice=notice, words=words)[0]


def ask_worlds(
    plugin: Plugin,
    name: str,
    check: Rule | Monitor,
    trial: Trial,
    *,
    notice: Notice | None = None,
    words: Words | None = None,
) -> tuple[list[Finding], list[OpenFindings]]:
    """All findings of one check about a trial, and those of both worlds where the log leaves it open.

    Args:
        plugin: Named when something goes wrong.
        name: Name of the check.
        check: The built plugin.
        trial: With the derived signals.
        notice: Takes the origin of a plugin that prints, and what it printed; by default a notice
            goes to standard error.
        words: Of the competition, for what the engine itself finds.

    Raises:
        LogError: A number of an event is in another unit than the check asks for.
        PluginError: The plugin raised, yielded nothing or something else, gave a finding that breaks the
            contract (see `checks.finding_contract`), or changed the trial.
    """
    grounds = _grounds(plugin, name, check, trial)
    trial = replace(trial)  # its own, so that nothing it sets reaches another check
    before = _marks(trial)
    began_s = time.process_time()  # not the clock on the wall: other processes are not the plugin's fault
    findings, worlds = _heard(plugin, name, check, trial, notice, words or Words())
    _note_time(plugin, name, time.process_time() - began_s, budget_of(trial))
    if _marks(trial) != before:
        raise broken(plugin, "changed the trial it was given", of=name)
    if not findings:
        raise broken(plugin, "says nothing, and silence is not a verdict", of=name)
    stored = [_stored(plugin, name, each, number, grounds) for number, each in enumerate(findings, start=1)]
    # Sorted here, because ids of findings are numbers in this order and decisions of stewards name them.
    opened: list[OpenFindings] = []
    for one in sorted(worlds, key=lambda one: one.subject):
        opened.append(_open(plugin, name, one, grounds, sum(len(o.best) + len(o.worst) for o in opened)))
    return sorted(stored, key=_order_of_findings), opened


def _heard(
    plugin: Plugin, name: str, check: Any, trial: Trial, notice: Notice | None, words: Words
) -> tuple[list[Finding], list[Worlds]]:
    """What a check answers, as it gives it; what it raises is named."""
    findings: list[Finding] = []
    worlds: list[Worlds] = []
    heard = (
        quiet(plugin.origin, notice, deep=True, of=name)
        if notice
        else quiet(plugin.origin, deep=True, of=name)
    )
    try:
        with heard:
            for finding in _answers(plugin, name, check, trial, words):
                if isinstance(finding, Worlds):
                    worlds.append(finding)
                    continue
                if not isinstance(finding, Finding):
                    raise broken(plugin, f"yields a {type(finding).__name__} instead of a Finding", of=name)
                findings.append(finding)
                if len(findings) > MOST_FINDINGS:
                    raise broken(plugin, f"gives more than {MOST_FINDINGS:,} findings", of=name)
    except MissingSignalError as missing:
        findings.append(Finding.inconclusive(missing.name, fault_of(missing).text, span=trial.window))
    except OtherUnitError as other:  # what the log states is not the plugin's fault
        raise LogError(
            f"check {name!r}: {other.cause}", file=trial.id, place=other.place, hint=other.hint
        ) from other
    except PluginError:
        raise
    except Exception as cause:
        raise broken(plugin, f"raised {fault_of(cause)}", of=name) from cause
    return findings, worlds


def _note_time(plugin: Plugin, name: str, taken_s: float, allowed_s: float) -> None:
    """Say that a check took too long; the score stands, for it may not depend on how fast a machine is."""
    if taken_s > allowed_s:
        sys.stderr.write(
            f"notice: plugin {plugin.origin} took {taken_s:.1f} s of processor time for check {name!r}, "
            f"longer than its budget of {allowed_s:g} s\n"
        )


def _open(plugin: Plugin, name: str, worlds: Worlds, grounds: Grounds, before: int) -> OpenFindings:
    """Both worlds of a subject, each finding held to the contract and named.

    Ids go on after the `before` findings of other subjects: of one check no two may have the same.
    """

    def named(which: str, findings: Sequence[Finding]) -> dict[str, Finding]:
        stored = [_stored(plugin, name, one, number, grounds) for number, one in enumerate(findings, start=1)]
        ordered = sorted(stored, key=_order_of_findings)
        return {f"{name}#{which}{number}": one for number, one in enumerate(ordered, start=before + 1)}

    best, worst = named("best", worlds.best), named("worst", worlds.worst)
    return OpenFindings(name, worlds.subject, best, worst, worlds.causes, worlds.tight)


def charts_of(plugin: Plugin, name: str, check: Any, trial: Trial) -> list[Chart]:
    """The charts of a monitor; none for a check that is not `Charting`.

    Raises:
        PluginError: It raised, or shows something that is no `Chart`.
    """
    return _charts(plugin, name, check.charts, trial) if isinstance(check, Charting) else []


def margins_of(plugin: Plugin, name: str, check: Any, trial: Trial) -> list[Chart]:
    """The margins of a monitor at every sample; none for a check that is not `Margined`.

    Raises:
        PluginError: It raised, or gives something that is no `Chart`.
    """
    return _charts(plugin, name, check.margins, trial) if isinstance(check, Margined) else []


def _charts(plugin: Plugin, name: str, show: Callable[[Trial], Iterable[Chart]], trial: Trial) -> list[Chart]:
    trial = replace(trial)  # its own, as in `ask`
    before = _marks(trial)
    try:
        with quiet(plugin.origin, of=name):
            charts = list(show(trial))
    except MissingSignalError:  # its finding says so already
        return []
    except Exception as cause:
        raise broken(
            plugin, f"raised {fault_of(cause).name} when it gave its charts: {fault_of(cause).text}", of=name
        ) from cause
    if _marks(trial) != before:
        raise broken(plugin, "changed the trial it was given", of=name)
    for chart in charts:
        if not isinstance(chart, Chart):
            raise broken(plugin, f"shows a {type(chart).__name__} instead of a Chart", of=name)
    return charts


def _grounds(plugin: Plugin, name: str, check: Any, trial: Trial) -> Grounds:
    """What the findings of a check are held against."""
    needs = needs_of(plugin, name, check)
    needed = {need.quantity for need in needs}
    signals = {recorded.name: recorded.unit for recorded in trial.sampled}
    units = {*signals.values(), *(need.unit for need in needs), *(one.unit for one in QUANTITIES.values())}
    try:
        measures = getattr(check, "measures", {})
        subjects = frozenset(getattr(check, "also_about", ()))
        forgives = getattr(check, "t_on_s", 0.0) != 0.0  # None: as its profile says
    except Exception as cause:
        raise broken(
            plugin, f"raised {fault_of(cause).name} about what it measures: {fault_of(cause).text}", of=name
        ) from cause
    _refuse_measures(plugin, name, measures, units)
    return Grounds(measures, watched_in(trial), Subjects(trial, subjects), signals, units, needed, forgives)


def _refuse_measures(plugin: Plugin, name: str, measures: Any, units: Collection[str]) -> None:
    """Refuse a declaration of quantities that is none."""
    if not isinstance(measures, Mapping):
        raise broken(plugin, f"has 'measures' that are a {type(measures).__name__}, no mapping", of=name)
    for quantity, measure in measures.items():
        if not isinstance(measure, Measure):
            raise broken(plugin, f"declares {quantity!r} by {measure!r}, which is no Measure", of=name)
        if not is_unit(measure.unit, units):
            raise broken(
                plugin, f"declares {quantity!r} in {measure.unit!r}, which is no known unit", of=name
            )


def _stored(plugin: Plugin, name: str, finding: Finding, number: int, grounds: Grounds) -> Finding:
    """A finding that keeps the contract, with the units that its check declares, as it is stored."""

    def keeps(given: Finding) -> None:
        if breach := breach_of(given, grounds):
            raise broken(
                plugin, f"gives finding {number}, {shown(given)}, which cannot be: {breach}", of=name
            )

    keeps(finding)
    declared = grounds.measures or {}
    units = {quantity: declared[quantity].unit for quantity in finding.quantities}
    try:
        stored = settled(replace(finding, check=name, units=units))
    except Exception as cause:  # numbers of a class of the plugin's own may raise anything
        words = f"gives finding {number}, whose numbers cannot be stored: {fault_of(cause).name}"
        raise broken(plugin, words, of=name) from cause
    # Once more: a number of a class of its own may turn into another one when it is stored.
    keeps(stored)
    return stored


def _order_of_findings(finding: Finding) -> tuple[str, float, str]:
    return finding.subject, finding.span.start_s if finding.span else -1.0, finding.message


def _marks(trial: Trial) -> tuple[object, ...]:
    """Values that differ once a trial was changed; its arrays are read-only, so their identity is enough."""
    small = (trial.work, trial.submissions, trial.events, trial.bodies, trial.witnessed, trial.recorded)
    same = (trial.signals, trial.as_consumed, trial.facts, trial.team, trial.official, trial.records)
    arrays = [(s.name, id(s), s.identity, s.unit) for s in trial.sampled]
    try:
        small_mark = hash(small)
    except TypeError:  # a reader put a list where a tuple belongs
        small_mark = hash(repr(small))
    return small_mark, *map(id, same), trial.id, trial.clock, trial.unrecorded, trial.log_defects, *arrays


def _not_none(answer: Any) -> Any:
    """What a plugin returned; a method without `return` or `yield` is refused with the remedy."""
    if answer is None:
        raise TypeError("None was returned; yield each, or return a list of them")
    return answer


def _answers(plugin: Plugin, name: str, check: Any, trial: Trial, words: Words) -> Iterator[Finding | Worlds]:
    """The findings of a rule about each item of work, or of a monitor about the trial."""
    if plugin.group != "ariac_score.rules":
        watch = getattr(check, "watch_worlds", check.watch) if trial.between is not None else check.watch
        yield from _not_none(watch(trial))
        return
    level = getattr(check, "level", "")
    items = list(paths_at(trial.work, level))
    if not items:
        yield Finding.not_applicable("trial", words.none_announced(level))
    for path, item in items:
        if getattr(item, "outline", False) and not getattr(check, "reads_official", False):
            yield Finding.inconclusive(path, ONLY_OFFICIAL)
            continue
        spoken = False
        # A rule that knows between what its quantities lie says so beside its findings.
        judge = getattr(check, "judge_worlds", check.judge)
        for finding in _not_none(judge(trial, item)):
            spoken = True
            yield _inside(finding, path, item)
        if not spoken and not item.items and not level:
            yield Finding.not_applicable(path, f"the {words.one(item.level)} asks for nothing")
        elif not spoken:
            raise broken(plugin, f"says nothing about {path}, and silence is not a verdict", of=name)


def _inside(finding: Any, path: str, item: WorkItem) -> Any:
    """A finding about an item by its own id, as one about the path of the item."""
    # A rule is given the item alone, which does not say what it is inside.
    if (
        path == item.id
        or not isinstance(finding, Finding | Worlds)
        or not is_inside(finding.subject, item.id)
    ):
        return finding
    moved = replace(finding, subject=path + finding.subject[len(item.id) :])
    if isinstance(moved, Finding):
        return moved
    best, worst = (tuple(_inside(one, path, item) for one in world) for world in (moved.best, moved.worst))
    return replace(moved, best=best, worst=worst)
