"""Asking one check about a trial: what it says, with its failures named and never swallowed."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from ariac_score.checks.captured_output import quiet
from ariac_score.checks.contracts import Charting, Margined, Monitor, Rule
from ariac_score.checks.findings import Finding
from ariac_score.checks.guarded import broken
from ariac_score.checks.registry import Plugin
from ariac_score.errors import MissingSignalError, PluginError
from ariac_score.results.result import settled
from ariac_score.trial.chart import Chart
from ariac_score.trial.model import Trial

__all__ = ["BUDGET_S", "SMALLEST_LOG_SAMPLES", "ask", "budget_of", "charts_of", "margins_of"]

Heard = Callable[[str, str], None]
_Made = TypeVar("_Made")

BUDGET_S = 30.0
"""Processor time a plugin may take for a million samples, s. Generous: a vectorised monitor takes 0.1 s."""

SMALLEST_LOG_SAMPLES = 100_000
"""A shorter log is allowed the time of one of this length, for calls and imports cost time too."""


def budget_of(trial: Trial, budget_s: float = BUDGET_S) -> float:
    """Processor time a plugin may take for a trial, s.

    Args:
        trial: Whose samples count.
        budget_s: Allowed for a million samples.
    """
    samples = sum(len(signal) for signal in trial.signals.values())
    return budget_s * max(samples, SMALLEST_LOG_SAMPLES) / 1e6


def ask(
    plugin: Plugin, name: str, check: Rule | Monitor, trial: Trial, *, heard: Heard | None = None
) -> list[Finding]:
    """Everything one check says about a trial, in order, with the numbers as they will be stored.

    Args:
        plugin: Whose fault it is when something goes wrong.
        name: Name of the check.
        check: The built plugin.
        trial: With the derived signals.
        heard: Takes the origin of a plugin that prints, and what it printed; by default a notice goes
            to standard error.

    Raises:
        PluginError: The plugin raised, said nothing, yielded something else, or changed the trial.
    """
    trial = replace(trial)  # its own, so that nothing it sets reaches another check
    before = _marks(trial)
    said: list[Finding] = []
    began_s = time.process_time()
    with quiet(plugin.origin, heard, deep=True) if heard else quiet(plugin.origin, deep=True):
        try:
            for finding in _answers(plugin, name, check, trial):
                if not isinstance(finding, Finding):
                    raise broken(plugin, f"yields a {type(finding).__name__} instead of a Finding", of=name)
                said.append(finding)
        except MissingSignalError as missing:
            said.append(Finding.inconclusive(missing.name, str(missing), span=trial.window))
        except PluginError:
            raise
        except (Exception, SystemExit, GeneratorExit) as cause:
            raise broken(plugin, f"raised {type(cause).__name__}: {cause}", of=name) from cause
    taken_s, allowed_s = time.process_time() - began_s, budget_of(trial)
    if taken_s > allowed_s:  # the score stands: it may not depend on how fast a machine is
        sys.stderr.write(
            f"notice: plugin {plugin.origin} took {taken_s:.1f} s of processor time for check {name!r}, "
            f"longer than its budget of {allowed_s:g} s\n"
        )
    if _marks(trial) != before:
        raise broken(plugin, "changed the trial it was asked about", of=name)
    if not said:
        raise broken(plugin, "says nothing, and silence is not a verdict", of=name)
    units = _units(plugin, name, said)
    return sorted((_stored(plugin, name, finding, units) for finding in said), key=_order_of_findings)


def charts_of(plugin: Plugin, name: str, check: Any, trial: Trial) -> list[Chart]:
    """What a monitor has to show of a trial; nothing for a check that shows nothing.

    Raises:
        PluginError: It raised, or shows something that is no `Chart`.
    """
    return _charts(plugin, name, check.charts, trial) if isinstance(check, Charting) else []


def margins_of(plugin: Plugin, name: str, check: Any, trial: Trial) -> list[Chart]:
    """The margins of a monitor at every sample; nothing for a check that tells none.

    Raises:
        PluginError: It raised, or gives something that is no `Chart`.
    """
    return _charts(plugin, name, check.margins, trial) if isinstance(check, Margined) else []


def _charts(plugin: Plugin, name: str, show: Callable[[Trial], Iterable[Chart]], trial: Trial) -> list[Chart]:
    trial = replace(trial)
    before = _marks(trial)
    try:
        with quiet(plugin.origin):
            charts = list(show(trial))
    except MissingSignalError:
        return []
    except (Exception, SystemExit) as cause:
        raise broken(
            plugin, f"raised {type(cause).__name__} when asked what it saw: {cause}", of=name
        ) from cause
    if _marks(trial) != before:
        raise broken(plugin, "changed the trial it was asked about", of=name)
    for chart in charts:
        if not isinstance(chart, Chart):
            raise broken(plugin, f"shows a {type(chart).__name__} instead of a Chart", of=name)
    return charts


def _units(plugin: Plugin, name: str, said: Iterable[Finding]) -> dict[str, str]:
    """The unit of each quantity of a check, where one of its findings declares it."""
    units: dict[str, str] = {}
    for finding in said:
        for quantity, unit in finding.units.items():
            if units.setdefault(quantity, unit) != unit:
                words = f"gives the quantity {quantity!r} in {units[quantity]!r} and in {unit!r}"
                raise broken(plugin, words, of=name)
    return units


def _stored(plugin: Plugin, name: str, finding: Finding, units: Mapping[str, str]) -> Finding:
    own = {quantity: units[quantity] for quantity in finding.quantities if quantity in units}
    try:
        return settled(replace(finding, check=name, units=own))
    except (TypeError, ValueError) as cause:
        raise broken(plugin, f"yields a number that is none: {cause}", of=name) from cause


def _order_of_findings(finding: Finding) -> tuple[str, float, str]:
    return finding.subject, finding.span.start_s if finding.span else -1.0, finding.message


def _marks(trial: Trial) -> tuple[object, ...]:
    """What tells that a trial is still the same; its arrays cannot be written to at all."""
    small = (trial.orders, trial.submissions, trial.events, trial.bodies, trial.witnessed, trial.recorded)
    same = (trial.signals, trial.facts, trial.team, trial.official, trial.kits)
    arrays = [(name, id(s), s.identity, s.unit) for name, s in trial.signals.items()]
    try:
        small_mark = hash(small)
    except TypeError:  # a reader put a list where a tuple belongs
        small_mark = hash(repr(small))
    return small_mark, *map(id, same), trial.id, trial.clock, trial.unrecorded, trial.log_defects, *arrays


def _some(answer: Any) -> Any:
    """What a plugin gave back, where that is anything."""
    if answer is None:
        raise TypeError("None was returned; yield each, or return a list of them")
    return answer


def _answers(plugin: Plugin, name: str, check: Any, trial: Trial) -> Iterator[Finding]:
    """What a rule says about each order, or a monitor about the trial."""
    if plugin.group != "ariac_score.rules":
        yield from _some(check.watch(trial))
    elif not trial.orders:
        yield Finding.not_applicable("trial", "no order was announced")
    for order in trial.orders if plugin.group == "ariac_score.rules" else ():
        if order.outline and not getattr(check, "reads_official", False):
            yield Finding.inconclusive(order.id, "what it asked for is not recorded, only its official score")
            continue
        spoken = False
        for finding in _some(check.judge(trial, order)):
            spoken = True
            yield finding
        if not spoken and not order.tasks:
            yield Finding.not_applicable(order.id, "the order asks for nothing")
        elif not spoken:
            raise broken(plugin, f"says nothing about {order.id}, and silence is not a verdict", of=name)
