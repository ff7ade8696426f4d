"""The settings of every check: each parameter in force with its value, its unit and its origin."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from ariac_score.checks.contracts import Resolving
from ariac_score.checks.findings import canonical
from ariac_score.checks.guarded import broken
from ariac_score.checks.parameters import ParameterFacts
from ariac_score.checks.registry import Plugin, parameters_of
from ariac_score.engine.prepared import Prepared, PreparedCheck
from ariac_score.installed.captured_output import fault_of, quiet
from ariac_score.monitors.monitor import SubjectMonitor
from ariac_score.results.result import Measured, Setting, Settings

__all__ = ["plain_value", "settings_of"]

_SOURCE = re.compile(r"^Source:\n((?:(?:[ ]{4}.*)?\n)+)", re.MULTILINE)


def settings_of(prepared: Prepared, measured: Measured | None = None) -> dict[str, Settings]:
    """Every parameter in force, by check.

    Args:
        prepared: The rule set, with its checks.
        measured: What they found; then with the bounds of bodies.

    Raises:
        PluginError: A plugin failed to resolve its parameters.
    """
    found = {}
    for name, each in prepared.checks.items():
        given = prepared.rule_set.checks[name].parameters
        found[name] = Settings(
            _source(each.check),
            (*_settings(each.plugin, name, each.check, given), *_bounds(prepared, each, measured)),
            _mistake(each.plugin, name, each.check),
            _part_of(each.plugin, name, each.check),
        )
    return found


def _bounds(prepared: Prepared, each: PreparedCheck, measured: Measured | None) -> Iterator[Setting]:
    """How fast bodies can move, for a check whose gaps are filled with it."""
    worse = getattr(each.check, "worse", {}) if isinstance(each.check, SubjectMonitor) else {}
    if measured is None or not worse:
        return
    between, kinds = prepared.between, each.check.subjects.kinds
    for kind in sorted(kinds & between.bounds.keys()):
        bound = between.bounds[kind]
        numbers = {"max_speed_m_s": bound.max_speed_m_s, "max_acceleration_m_s2": bound.max_acceleration_m_s2}
        for name, number in numbers.items():
            if math.isfinite(number):
                unit = "m/s" if name == "max_speed_m_s" else "m/s2"
                origin = bound.stated or "default"
                yield Setting(f"bounds.{kind}.{name}", canonical(number), unit, origin, source=bound.source)
    for name, unit in (("time_error_s", "s"), ("distance_error_m", "m")):
        if number := getattr(between, name):
            origin = "rule_set" if name in prepared.rule_set.bounds else "log_map"
            yield Setting(f"bounds.{name}", canonical(number), unit, origin)
    if between.every:
        yield Setting("between_samples", "bounded", "", "rule_set")


def _part_of(plugin: Plugin, name: str, check: Any) -> str:
    """`task` or `safety`; empty where its plugin does not say."""
    word = getattr(check, "part_of", "")
    if word in ("", "task", "safety"):
        return str(word)
    raise broken(plugin, f"has {word!r} as `part_of`, which is to be 'task' or 'safety'", of=name)


def _mistake(plugin: Plugin, name: str, check: Any) -> tuple[str, ...]:
    """What its plugin calls a violation, one and several; empty where it does not say."""
    words = getattr(check, "mistake", ())
    if not words:
        return ()
    if not (isinstance(words, tuple) and len(words) == 2 and all(isinstance(w, str) and w for w in words)):
        raise broken(
            plugin, f"has {words!r} as `mistake`, which is to be two words: one and several", of=name
        )
    return words


def _settings(plugin: Plugin, name: str, check: Any, given: Mapping[str, Any]) -> list[Setting]:
    resolved = _resolved(plugin, name, check)
    settings = []
    for parameter, declared in parameters_of(type(check)).items():
        facts, origin = declared.facts, "default"
        if parameter in given:
            # Status and source are those of the default, which is not in force here.
            value, facts, origin = given[parameter], ParameterFacts(facts.unit), "rule_set"
        else:
            value = getattr(check, parameter, declared.default)
        if parameter in resolved and resolved[parameter] != value:
            value, origin = resolved[parameter], "derived"
        plain = plain_value(value)
        unit = facts.unit if _has_numbers(plain) else ""
        settings.append(Setting(parameter, plain, unit, origin, facts.status, facts.source))
    return settings


def _resolved(plugin: Plugin, name: str, check: Any) -> dict[str, Any]:
    if not isinstance(check, Resolving):
        return {}
    try:
        with quiet(plugin.origin):
            resolved = dict(check.resolved())
    except Exception as cause:
        words = f"raised {fault_of(cause).name} when it resolved its parameters: {fault_of(cause).text}"
        raise broken(plugin, words, of=name) from cause
    strange = sorted(set(map(str, resolved)) - set(parameters_of(type(check))))
    if strange:
        raise broken(plugin, f"resolves {strange[0]!r}, which is no parameter of it", of=name)
    return resolved


def _source(check: Any) -> str:
    """The section `Source:` of the plugin's docstring, as one paragraph."""
    found = _SOURCE.search(inspect.cleandoc(type(check).__doc__ or "") + "\n")
    return "" if found is None else " ".join(found[1].split())


def plain_value(value: Any) -> Any:
    """A value as JSON can hold it; for anything else the name of its type.

    Never its `repr`, which may hold an address and so differ from run to run.
    """
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return canonical(value) if math.isfinite(value) else f"{value:g}"
    if isinstance(value, Mapping):
        return {str(key): plain_value(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(inner) for inner in value]
    return f"({type(value).__name__})"


def _has_numbers(value: Any) -> bool:
    """Whether a value has numbers, to which a unit can belong."""
    if isinstance(value, list):
        return any(_has_numbers(inner) for inner in value)
    return isinstance(value, int | float) and not isinstance(value, bool)
