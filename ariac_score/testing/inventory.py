"""Everything that installed distributions bring, of every kind: who brings it, and whether it can be used."""

from __future__ import annotations

import hashlib
import inspect
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import yaml

from ariac_score.checks.contracts import GROUPS, OTHER_GROUPS, VALUE_GROUPS, FactSchemas, ReportPanel
from ariac_score.checks.registry import FILE_GROUPS, DataFile, Plugin, Registry, package_sha256
from ariac_score.documents.yaml import load_yaml
from ariac_score.engine.signal_needs import DERIVED, deriver_of
from ariac_score.errors import PluginConflictError, PluginError, PluginNotFoundError, ScoreError, did_you_mean
from ariac_score.installed.points import unreadable_hint
from ariac_score.logs.logmap import load_log_map
from ariac_score.logs.recording import load_recording
from ariac_score.scoring.penalties import load_penalty
from ariac_score.scoring.ruleset import load_rule_set
from ariac_score.testing.pages import plugin_page, summary
from ariac_score.trial.derive import DerivedSignal
from ariac_score.trial.vocabulary import OUR_QUANTITIES, Quantity, contradiction

__all__ = ["ALL_GROUPS", "Brought", "brought", "brought_named", "page_of"]

ALL_GROUPS = (*GROUPS, *FILE_GROUPS, *VALUE_GROUPS, *OTHER_GROUPS)
"""Every entry-point group, in the order in which they are shown."""

UNLOADED = "ariac_score.executors"
"""A cluster's library is loaded when a batch runs there, not to look at what there is."""


@dataclass(frozen=True)
class Brought:
    """One thing that a distribution brings.

    Attributes:
        kind: Its group without the prefix, such as `log_maps`.
        name: By which it is called.
        plugin: The entry point.
        file: The file, of the kinds that are files.
        summary: What it says about itself, in a line; empty where it cannot be used.
        problem: Why it cannot be used; empty where it can.
        hint: What to do about that.
        conflict: Whether that is another distribution, which brings the same.
    """

    kind: str
    name: str
    plugin: Plugin
    file: DataFile | None = None
    summary: str = ""
    problem: str = ""
    hint: str = ""
    conflict: bool = False


def brought(registry: Registry) -> Iterator[Brought]:
    """Everything that is installed, by kind and name."""
    for group in ALL_GROUPS:
        for plugin in registry.all(group):
            yield from _of_point(registry, plugin)


def brought_named(name: str, registry: Registry) -> list[Brought]:
    """What is installed under a name, of whatever kind.

    Raises:
        PluginNotFoundError: Nobody brings it.
        PluginError: It cannot be used, such as because two distributions bring it.
    """
    points = [p for group in ALL_GROUPS for p in registry.all(group) if f"{name}.".startswith(f"{p.name}.")]
    found = [one for point in points for one in _of_point(registry, point) if one.name == name]
    if not found:
        known = {p.name for group in ALL_GROUPS for p in registry.all(group)}
        known |= {file.name for group in FILE_GROUPS for file in registry.files(group)}
        raise PluginNotFoundError(
            f"no installed distribution provides {name!r}",
            hint=did_you_mean(name, known, what="installed") + unreadable_hint(),
        )
    for one in found:
        if one.file is None:
            _usable(registry, one.plugin)
        else:
            registry.file(one.plugin.group, name)
    return found


def _of_point(registry: Registry, plugin: Plugin) -> Iterator[Brought]:
    kind = plugin.group.rpartition(".")[2]
    try:
        if plugin.group in FILE_GROUPS:
            plugin.path()
        else:
            yield Brought(kind, plugin.name, plugin, summary=_usable(registry, plugin))
            return
    except PluginError as error:
        rival = isinstance(error, PluginConflictError)
        yield Brought(kind, plugin.name, plugin, None, "", error.cause, error.hint, rival)
        return
    files = [file for file in registry.files(plugin.group) if file.plugin == plugin]
    for file in files:
        yield _of_file(registry, kind, file)
    if not files:
        hint = "put .yaml files there, or name another folder"
        yield Brought(kind, plugin.name, plugin, problem="names a folder without any such file", hint=hint)


def _of_file(registry: Registry, kind: str, file: DataFile) -> Brought:
    try:
        registry.file(file.plugin.group, file.name)
        own_id, about = _LOADERS[file.plugin.group](file, registry)
    except ScoreError as error:
        rival = isinstance(error, PluginConflictError)
        return Brought(kind, file.name, file.plugin, file, "", error.cause, error.hint, rival)
    if own_id != file.name:
        words = f"has the id {own_id!r}, and is called {file.name!r}"
        hint = "results name rules and log maps by their id; let both be the same"
        return Brought(kind, file.name, file.plugin, file, problem=words, hint=hint)
    return Brought(kind, file.name, file.plugin, file, about)


def _rule_set(file: DataFile, registry: Registry) -> tuple[str, str]:
    rule_set = load_rule_set(file.name, registry)
    rule_set.build(registry)
    return rule_set.id, rule_set.title


def _log_map(file: DataFile, registry: Registry) -> tuple[str, str]:
    return load_log_map(file.name, registry=registry).id, str(load_yaml(file.path).data["title"])


def _penalty(file: DataFile, _registry: Registry) -> tuple[str, str]:
    penalty = load_penalty(file.name, folder=file.path.parent)
    return penalty.id, penalty.title


def _recording(file: DataFile, registry: Registry) -> tuple[str, str]:
    load_recording(None, [file.name], registry=registry)
    data = load_yaml(file.path).data
    return str(data["id"]), str(data["title"])


_LOADERS: Mapping[str, Callable[[DataFile, Registry], tuple[str, str]]] = {
    "ariac_score.rule_sets": _rule_set,
    "ariac_score.log_maps": _log_map,
    "ariac_score.penalties": _penalty,
    "ariac_score.recordings": _recording,
}
"""Loads a file of each group as scoring does, and gives its id and title."""


def _usable(registry: Registry, plugin: Plugin) -> str:
    """What an entry point says about itself in a line.

    Raises:
        PluginError: It cannot be used.
    """
    if plugin.group == UNLOADED:
        registry.find(plugin.group, plugin.name)
        return "where batches run"
    if plugin.group not in VALUE_GROUPS:
        loaded = plugin.load()
        package_sha256(plugin.package)  # of a zip, or of a module without a file, there is none
        registry.find(plugin.group, plugin.name)
        return _words(loaded)
    value = plugin.value()
    if isinstance(value, Quantity):  # two may declare the same quantity, and nothing else
        words = contradiction(plugin.name, value)
        if words and value != OUR_QUANTITIES.get(plugin.name):
            raise PluginError(words, hint="declare a quantity under another name")
        return f"{value.unit}, of {value.of}: {value.meaning}"
    registry.find(plugin.group, plugin.name)
    if plugin.group == DERIVED:
        deriver_of(plugin.name, registry)
    return _words(value)


def _words(value: Any) -> str:
    """The first line about a class, a function, a module or a value."""
    if isinstance(value, DerivedSignal):
        return f"from {', '.join(value.needs.values())}"
    if isinstance(value, ReportPanel):
        return value.title
    if isinstance(value, FactSchemas):
        return f"facts of {', '.join(value.levels)}"
    words = summary(value)
    # A dataclass without a docstring is given its signature for one: `Bad(limit_m: float = 1.0)`.
    return "(no description)" if not words or words.startswith(f"{_name(value)}(") else words


def _name(value: Any) -> str:
    return str(getattr(value, "__name__", type(value).__name__))


# Pages ---------------------------------------------------------------------------------


def page_of(one: Brought) -> str:
    """The page of a thing that can be used, as Markdown; of a file its text.

    Raises:
        PluginError: It cannot be imported.
    """
    if one.plugin.group in GROUPS:
        return plugin_page(one.plugin)
    if one.file is not None:
        text = one.file.path.read_text(encoding="utf-8")
        digest = hashlib.sha256(one.file.path.read_bytes()).hexdigest()
        return f"# `{one.name}`\n\n{one.summary}\n\n{one.file.path}, sha256 {digest}\n\n```yaml\n{text}```\n"
    about = [f"# `{one.name}`", one.summary]
    if one.plugin.group != UNLOADED:
        about += _details(one.plugin.load())
    return "\n\n".join(part for part in about if part) + "\n"


def _details(value: Any) -> list[str]:
    if isinstance(value, Quantity):
        shape = "(n,)" if value.components == 1 else f"(n, {value.components})"
        return [f"Values of shape {shape}, in {value.unit}, at least {value.at_least:g}."]
    if isinstance(value, DerivedSignal):
        needs = "\n".join(f"- `{name}`: `{template}`" for name, template in value.needs.items())
        return ["Computed from:", needs, *_documentation(value.compute)]
    if isinstance(value, ReportPanel):
        return [*_documentation(value.data), f"```jinja\n{value.template}\n```"]
    if isinstance(value, FactSchemas):
        plain = {level: dict(schema) for level, schema in value.levels.items()}
        return [f"```yaml\n{yaml.safe_dump(plain, sort_keys=False)}```"]
    return _documentation(value)


def _documentation(value: Any) -> list[str]:
    """What follows the first line of a docstring."""
    return [inspect.cleandoc(value.__doc__ or "").partition("\n")[2].strip()]
