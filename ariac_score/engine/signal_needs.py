"""What a check needs of a log, and how plugins compute what a log lacks."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ariac_score.checks.contracts import Monitor, SignalNeed
from ariac_score.checks.guarded import broken
from ariac_score.checks.registry import Plugin, Registry
from ariac_score.errors import PluginConflictError, PluginError
from ariac_score.installed.captured_output import fault_of, quiet
from ariac_score.trial.derive import SOURCES, Derivation, DerivedSignal, derive_signals
from ariac_score.trial.model import Trial
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vocabulary import QUANTITIES

__all__ = ["DERIVED", "Deriver", "deriver_of", "derivers_of", "needs_of", "with_derived"]

DERIVED = "ariac_score.derived_signals"


def needs_of(plugin: Plugin, name: str, check: Any) -> list[SignalNeed]:
    """The signals a monitor needs; none for a rule.

    Raises:
        PluginError: It raised, or yields something that is no `SignalNeed`.
    """
    if not isinstance(check, Monitor):
        return []
    try:
        with quiet(plugin.origin, of=name):
            stated = check.needs()
            if stated is None:
                raise TypeError("None was returned; yield each, or return a list of them")
            needs = list(stated)
    except Exception as cause:
        raise broken(
            plugin, f"raised {fault_of(cause).name} when it stated its needs: {fault_of(cause).text}", of=name
        ) from cause
    for need in needs:
        if not isinstance(need, SignalNeed):
            raise broken(plugin, f"needs a {type(need).__name__} instead of a SignalNeed", of=name)
    return needs


@dataclass(frozen=True)
class Deriver:
    """How a plugin computes a quantity.

    Attributes:
        plugin: Who brings it.
        signal: What it needs and how it computes; a failure names the plugin.
    """

    plugin: Plugin
    signal: DerivedSignal


def derivers_of(wanted: Iterable[str], registry: Registry) -> dict[str, Deriver]:
    """How plugins compute the wanted quantities and what these follow from, by quantity.

    Raises:
        PluginError: One of them is broken, or derives what nobody declares.
        PluginConflictError: Two distributions derive one quantity, or one derives what we derive.
    """
    found: dict[str, Deriver] = {}
    installed, todo = registry.names(DERIVED), list(wanted)
    while installed and todo:
        quantity = todo.pop()
        if quantity in found or quantity not in installed:
            todo += SOURCES.get(quantity, ()) if quantity not in found else ()
            continue
        found[quantity] = deriver_of(quantity, registry)
        todo += found[quantity].signal.quantities
    return found


def with_derived(trial: Trial, needs: Sequence[SignalNeed], registry: Registry) -> Trial:
    """The trial with what a check needs, as the engine would hand it over.

    Raises:
        PluginError: See `derivers_of`.
    """
    derivers = derivers_of([need.quantity for need in needs], registry)
    wanted = [Derivation(need.quantity, need.max_gap_s, need.pair) for need in needs]
    return derive_signals(trial, wanted, brought={name: one.signal for name, one in derivers.items()})


def deriver_of(quantity: str, registry: Registry) -> Deriver:
    """How a plugin computes a quantity.

    Raises:
        PluginError: See `derivers_of`.
    """
    plugin = registry.find(DERIVED, quantity)
    if quantity in SOURCES:
        raise PluginConflictError(
            f"derives {quantity!r}, which ariac-score derives itself",
            origin=plugin.origin,
            hint="declare a quantity of your own, or let the log record this one",
        )
    signal, known = plugin.value(), QUANTITIES.get(quantity)
    if known is None:
        raise PluginError(
            f"derives {quantity!r}, which nobody declares",
            origin=plugin.origin,
            hint="declare it too, with its unit: entry-point group ariac_score.quantities",
        )
    allowed = {"body": {"body"}, "pair": {"first", "second"}}.get(known.of, set())
    if signal.placeholders - allowed:
        (name, *_) = sorted(signal.placeholders - allowed)
        raise PluginError(
            f"needs {{{name}}} for {quantity!r}, a quantity of {known.of}",
            origin=plugin.origin,
            hint="{body} stands for a body, {first} and {second} for a pair",
        )
    return Deriver(plugin, replace(signal, compute=_guarded(plugin, signal.compute, known.components)))


def _guarded(plugin: Plugin, compute: Callable[..., Any], components: int) -> Callable[..., FloatArray]:
    def guarded(t: FloatArray, **columns: FloatArray) -> FloatArray:
        try:
            with quiet(plugin.origin, deep=True):
                values = np.array(compute(t, **columns), dtype=np.float64)
        except PluginError:
            raise
        except Exception as cause:  # a stranger's code may raise anything
            raise broken(plugin, f"raised {fault_of(cause)}") from cause
        wanted = (len(t),) if components == 1 else (len(t), components)
        if values.shape != wanted:
            raise broken(plugin, f"gives values of shape {values.shape} where {wanted} is wanted")
        return values

    return guarded
