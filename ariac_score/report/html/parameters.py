"""The parameters of every check as rows: value, unit, who chose it, and what a default is based on."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ariac_score.report.html.wording import number
from ariac_score.results.result import Result, Setting

__all__ = ["CheckParameters", "ParameterRow", "parameters_shown"]

_ORIGINS: Mapping[str, str] = {
    "rule_set": "rule set",
    "default": "plugin's default",
    "derived": "other parameters",
}
_EXACT_DIGITS = 12  # with so many digits numbers are stored and priced


@dataclass(frozen=True)
class ParameterRow:
    """One parameter.

    Attributes:
        name: Its name.
        value: In words, with its unit.
        origin: Who chose it, in words.
        default_basis: How sure a default is and where it comes from; empty where the plugin does not say.
    """

    name: str
    value: str
    origin: str
    default_basis: str


@dataclass(frozen=True)
class CheckParameters:
    """The parameters of one check.

    Attributes:
        name: Of the check.
        check: Its entry in the result.
        source: The standard or rulebook that its plugin names.
        rows: Its parameters; only those given by the rule set where a result did not keep defaults.
        whole: Whether the defaults are among them.
    """

    name: str
    check: Mapping[str, Any]
    source: str
    rows: tuple[ParameterRow, ...]
    whole: bool


def parameters_shown(result: Result) -> list[CheckParameters]:
    """Every check with its parameters, in the order of the result."""
    known = result.measured.settings or {}
    shown = []
    for name, check in result.checks.items():
        kept = known.get(name)
        settings = (
            tuple(Setting(key, value, "", "rule_set") for key, value in check["with"].items())
            if kept is None
            else kept.parameters
        )
        source = "" if kept is None else kept.source
        shown.append(CheckParameters(name, check, source, tuple(map(_row, settings)), kept is not None))
    return shown


def _row(setting: Setting) -> ParameterRow:
    unit = "" if setting.unit in ("", "1") else f" {setting.unit}"
    return ParameterRow(
        setting.name,
        _value(setting.value) + (unit if setting.value is not None else ""),
        _ORIGINS[setting.origin],
        ": ".join(part for part in (setting.status, setting.source) if part),
    )


def _value(value: Any) -> str:
    if isinstance(value, bool):  # before numbers, for True is an int
        return "yes" if value else "no"
    if value is None or value in ("", [], {}):
        return "none"
    if isinstance(value, int | float):
        return number(float(value), _EXACT_DIGITS)
    if isinstance(value, str):
        return value
    return json.dumps(value, ensure_ascii=False)
