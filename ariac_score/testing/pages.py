"""The page of a plugin: its docstring, parameters, needs, quantities, and an example of its findings."""

from __future__ import annotations

import inspect
import math
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

from ariac_score.checks.contracts import GROUPS, Monitor, Rule
from ariac_score.checks.findings import Finding
from ariac_score.checks.measures import measures_of
from ariac_score.checks.parameters import MEANINGS, parameter_meanings
from ariac_score.checks.registry import Parameter, Plugin, Registry, parameters_of
from ariac_score.engine.ask import ask
from ariac_score.engine.signal_needs import needs_of, with_derived
from ariac_score.errors import ScoreError
from ariac_score.scoring.ruleset import installed_rule_sets
from ariac_score.testing.made import made_trial_for
from ariac_score.trial.model import Trial
from ariac_score.trial.vocabulary import QUANTITIES

__all__ = ["example_parameters", "plugin_page", "summary", "write_pages"]

EXAMPLES = 4
"""The most findings that a page shows."""


def summary(kind: Any) -> str:
    """The first sentence of a plugin's docstring."""
    return inspect.cleandoc(kind.__doc__ or "").partition("\n")[0]


def plugin_page(plugin: Plugin) -> str:
    """The page of one installed plugin, as Markdown.

    Raises:
        PluginError: It cannot be imported.
    """
    kind = plugin.load()
    parts = [f"# `{plugin.name}`", *_docstring(kind), *_parameters(kind), *_needs(plugin)]
    parts += [*_measures(plugin), *_example(plugin)]
    return "\n\n".join(part for part in parts if part) + "\n"


# Docstring --------------------------------------------------------------------------------

_SECTION = re.compile(r"^([A-Z][A-Za-z ]*):\n((?:(?:[ ]{4}.*)?\n)+)", re.MULTILINE)


def _docstring(kind: Any) -> list[str]:
    text = inspect.cleandoc(kind.__doc__ or "It does not say what it is for.") + "\n"

    def as_heading(match: re.Match[str]) -> str:
        if match[1] == MEANINGS:  # they stand in the table of parameters
            return ""
        return f"## {match[1]}\n\n{inspect.cleandoc(match[2])}\n\n"

    return [re.sub(r"\n{3,}", "\n\n", _SECTION.sub(as_heading, text)).strip()]


# Parameters ----------------------------------------------------------------------------


def _parameters(kind: Any) -> list[str]:
    """A table with the columns that hold something."""
    try:
        parameters = parameters_of(kind)
    except (NameError, TypeError, AttributeError):
        return []  # an annotation that cannot be resolved; the doctor names it
    if not parameters:
        return []
    meanings = parameter_meanings(kind)
    rows = [_row(name, parameter, meanings.get(name, "")) for name, parameter in parameters.items()]
    return ["## Parameters", _table(rows)]


def _row(name: str, parameter: Parameter, meaning: str) -> dict[str, str]:
    facts = parameter.facts
    return {
        "parameter": f"`{name}`",
        "meaning": meaning,
        "type": _type(parameter.type),
        "default": _value(parameter.default),
        "unit": facts.unit,
        "range": _range(facts.above, facts.at_least, facts.at_most),
        "status": facts.status,
        "source": facts.source,
    }


def _table(rows: list[dict[str, str]]) -> str:
    names = [name for name in rows[0] if any(row[name] for row in rows)]
    lines = [
        names,
        ["---"] * len(names),
        *([row[name].replace("|", "\\|") for name in names] for row in rows),
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _type(wanted: Any) -> str:
    """A type in words.

    >>> _type(float | None), _type(tuple[str, ...]), _type(Literal["a", "b"])
    ('float or none', 'list of str', '`a` or `b`')
    """
    origin, arguments = get_origin(wanted), get_args(wanted)
    if origin is Literal:
        return " or ".join(f"`{choice}`" for choice in arguments)
    if origin in (Union, UnionType):
        return " or ".join("none" if a is type(None) else _type(a) for a in arguments)
    if origin is tuple:
        return f"list of {_type(arguments[0])}"
    if origin is not None and len(arguments) == 2:
        return f"map of names to {_type(arguments[1])}"
    return str(getattr(wanted, "__name__", wanted))


def _value(value: Any) -> str:
    """A value as a rule set writes it."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, tuple | list):
        return "[" + ", ".join(_value(item) for item in value) + "]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_value(item)}" for key, item in value.items()) + "}"
    return str(value) if value != "" else '""'


def _range(above: float, at_least: float, at_most: float) -> str:
    """The values that are allowed.

    >>> _range(0.0, -math.inf, 60.0), _range(-math.inf, 0.0, math.inf)
    ('above 0, at most 60', 'at least 0')
    """
    limits = (("above", above), ("at least", at_least), ("at most", at_most))
    return ", ".join(f"{words} {limit:g}" for words, limit in limits if math.isfinite(limit))


# Needs and findings --------------------------------------------------------------------


def _built(plugin: Plugin) -> Any | None:
    """The plugin as its example has it; `None` when it cannot be built."""
    try:
        return plugin.build(example_parameters(plugin))
    except ScoreError:
        return None


def _needs(plugin: Plugin) -> list[str]:
    check = _built(plugin)
    needs = needs_of(plugin, "example", check) if isinstance(check, Monitor) else []
    if not needs:
        return []
    rows = [
        {
            "quantity": f"`{need.quantity}`",
            "needed": "optional" if need.optional else "yes",
            "unit": need.unit,
            "longest gap": f"{need.max_gap_s:g} s",
            "meaning": QUANTITIES[need.quantity].meaning if need.quantity in QUANTITIES else "",
        }
        for need in needs
    ]
    if all(row["needed"] == "yes" for row in rows):
        rows = [{name: cell for name, cell in row.items() if name != "needed"} for row in rows]
    return ["## Needs", _table(rows)]


def _measures(plugin: Plugin) -> list[str]:
    """The quantities of its findings, which a rule set may price."""
    check = _built(plugin)
    if not isinstance(check, Rule | Monitor):
        return []
    rows = [
        {
            "quantity": f"`{name}`",
            "unit": measure.unit,
            "role": "" if measure.role == "measure" else measure.role,
            "meaning": measure.meaning,
        }
        for name, measure in measures_of(check).items()
    ]
    return ["## Quantities", _table(rows)] if rows else []


def example_parameters(plugin: Plugin) -> dict[str, Any]:
    """Parameters that show what a plugin does.

    Those that its class names as `example`; else those of the first shipped rule set
    that uses it; else its defaults.
    """
    declared = getattr(plugin.load(), "example", None)
    if isinstance(declared, Mapping):
        return dict(declared)
    return dict(_shipped_uses().get(plugin.name, {}))


@cache
def _shipped_uses() -> dict[str, Mapping[str, Any]]:
    """Parameters by plugin, from the first shipped rule set that gives it any."""
    uses: dict[str, Mapping[str, Any]] = {}
    for rule_set in installed_rule_sets():
        for check in rule_set.checks.values():
            if check.parameters:
                uses.setdefault(check.use, check.parameters)
    return uses


def _example(plugin: Plugin) -> list[str]:
    check = _built(plugin)
    if not isinstance(check, Rule | Monitor):
        return []
    parameters = example_parameters(plugin)
    given = f"with `{_value(parameters)}`" if parameters else "with its defaults"
    lines = [_line(finding) for finding in _chosen(_findings(plugin, check))]
    return ["## Example", f"About the made trial, {given}:", "```text\n" + "\n".join(lines) + "\n```"]


@cache
def _made(plugin: Plugin) -> Trial:
    return made_trial_for(plugin, Registry())


def _findings(plugin: Plugin, check: Any) -> list[Finding]:
    # As the engine does, so that the example is what a score would show.
    needs = needs_of(plugin, "example", check)
    return ask(plugin, "example", check, with_derived(_made(plugin), needs, Registry()))


def _chosen(findings: list[Finding]) -> list[Finding]:
    """A few findings, each verdict once before any twice, in their order."""
    first = {finding.verdict: k for k, finding in reversed([*enumerate(findings)])}
    chosen = sorted(first.values())
    chosen += [k for k in range(len(findings)) if k not in chosen]
    return [findings[k] for k in sorted(chosen[:EXAMPLES])]


def _line(finding: Finding) -> str:
    verdict = finding.verdict.value.replace("_", " ")
    span = f"{finding.span.start_s:.2f} s to {finding.span.end_s:.2f} s: " if finding.span else ""
    return f"{verdict:<15} {finding.subject}: {span}{finding.message}"


# All of them ---------------------------------------------------------------------------


def pages(distribution: str) -> Iterator[tuple[str, str]]:
    """Path and text of the page of every plugin of a distribution, and of their index."""
    registry = Registry()
    index = ["# Plugins", f"What `{distribution}` brings. Made by `python -m ariac_score.testing.docs`."]
    for group in GROUPS:
        kind = group.rpartition(".")[2]
        ours = [plugin for plugin in registry.all(group) if plugin.distribution == distribution]
        index.append(f"## {kind.capitalize()}")
        index.append("\n".join(f"- [`{p.name}`]({kind}/{p.name}.md): {summary(p.load())}" for p in ours))
        for plugin in ours:
            yield f"{kind}/{plugin.name}.md", plugin_page(plugin)
    yield "README.md", "\n\n".join(part for part in index if part) + "\n"


def write_pages(folder: Path, distribution: str = "ariac-score") -> None:
    """Write the pages into a folder, and remove those of plugins that no longer exist."""
    written = dict(pages(distribution))
    for name, text in written.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        # The same bytes on every system: the pages are kept in the repository and compared.
        (folder / name).write_text(text, encoding="utf-8", newline="\n")
    for group in GROUPS:
        for page in (folder / group.rpartition(".")[2]).glob("*.md"):
            if page.relative_to(folder).as_posix() not in written:
                page.unlink()
