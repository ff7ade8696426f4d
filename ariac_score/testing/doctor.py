"""What is wrong with the installed plugins: each problem with the plugin that has it."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, distribution, version
from typing import Any

from ariac_score.checks.contracts import GROUPS
from ariac_score.checks.registry import Plugin, Registry, package_sha256
from ariac_score.errors import PluginError, ScoreError, did_you_mean
from ariac_score.installed.points import unreadable_distributions
from ariac_score.testing.contract_check import built_by_name, undocumented
from ariac_score.testing.inventory import ALL_GROUPS, Brought, brought
from ariac_score.testing.pages import example_parameters

__all__ = ["Ailment", "ailments"]

_ARGUMENTS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "ariac_score.rules": {"judge": ("trial", "item")},
    "ariac_score.monitors": {"needs": (), "watch": ("trial",)},
    "ariac_score.readers": {"can_read": ("path",), "describe": ("path",), "read": ("path", "wanted")},
    "ariac_score.decoders": {"decode": ("msgtype", "message", "t_s")},
    "ariac_score.tracks": {"follows": ("name",), "record": ("t_s", "tracks", "pauses", "until_s")},
    "ariac_score.record_kinds": {"read": ("record", "note")},
    "ariac_score.competitions": {},
}
_NAME = re.compile(r"[a-z0-9_]+(\.[a-z0-9_]+)+")
"""As `use` in `schemas/ruleset.schema.json`: any other name cannot be written in a rule set."""


@dataclass(frozen=True)
class Ailment:
    """Something wrong with one plugin.

    Attributes:
        origin: The plugin, with distribution and version.
        problem: What is wrong.
        hint: What to do.
        plugin: The entry point; `None` where a distribution cannot be read.
    """

    origin: str
    problem: str
    hint: str
    plugin: Plugin | None = None


def ailments(known: Sequence[Brought] | None = None) -> list[Ailment]:
    """Everything that is wrong with what is installed.

    Args:
        known: What is installed (`brought`), where the caller has it already.
    """
    registry = Registry()
    found = [
        Ailment(one.origin, one.reason, "none of its plugins is used; repair or reinstall it")
        for one in unreadable_distributions()
    ]
    found += _unknown_groups(registry)
    for group in GROUPS:
        for plugin in registry.all(group):
            found += (Ailment(plugin.origin, *problem, plugin) for problem in _problems(registry, plugin))
    for one in brought(registry) if known is None else known:
        if one.plugin.group not in GROUPS and one.problem:
            found.append(Ailment(one.plugin.origin, _of(one), one.hint, one.plugin))
    return found


def _of(one: Brought) -> str:
    """The problem, with the name of the file where one entry point brings several."""
    return one.problem if one.name == one.plugin.name else f"{one.name}: {one.problem}"


def _unknown_groups(registry: Registry) -> Iterator[Ailment]:
    """Plugins that nothing uses: their group is misspelt, or of another version."""
    known = ALL_GROUPS
    for group in registry.groups():
        for plugin in registry.all(group) if group not in known else ():
            yield Ailment(
                plugin.origin, f"is in the group {group!r}, which does not exist", did_you_mean(group, known)
            )


def _conflicts(registry: Registry, plugin: Plugin) -> Iterator[tuple[str, str]]:
    try:
        registry.find(plugin.group, plugin.name)
    except PluginError as conflict:
        yield conflict.cause, conflict.hint


def _problems(registry: Registry, plugin: Plugin) -> Iterator[tuple[str, str]]:
    if plugin.distribution == "?" or plugin.version == "?":
        yield (
            "comes from a distribution without metadata",
            "install it with pip: a result names who measured",
        )
    yield from _conflicts(registry, plugin)
    if plugin.group in ("ariac_score.rules", "ariac_score.monitors") and not _NAME.fullmatch(plugin.name):
        yield "has a name that no rule set can use", "name it like family.check, in small letters"
    yield from _requirement(plugin)
    try:
        kind = plugin.load()
    except PluginError as error:
        yield error.fault, error.hint
        return
    yield from _of_class(plugin, kind)


def _of_class(plugin: Plugin, kind: Any) -> Iterator[tuple[str, str]]:
    if not isinstance(kind, type):
        yield f"is a {type(kind).__name__}, not a class", "let the entry point name a class"
        return
    missing = undocumented(plugin, kind)
    if missing:
        words = ", ".join(map(repr, missing))
        yield f"has no section {words} in its docstring", "the docstring is the page a referee reads"
    unnamed = built_by_name(kind)
    if unnamed:
        yield unnamed, "give every parameter a name"
    other = [*_other_arguments(plugin, kind)]
    yield from other
    # With a required parameter nothing can be built here; the rule set that gives it is checked when loaded.
    if not (unnamed or other or _required(kind)):
        try:
            plugin.build(example_parameters(plugin))
        except PluginError as error:
            yield error.fault, error.hint
        except ScoreError as error:
            yield error.cause, error.hint
    try:
        package_sha256(plugin.package)  # of a zip, or of a module without a file, there is none
    except PluginError as error:
        yield error.cause, "a result names the hash of the code that measured; install it as files"


def _other_arguments(plugin: Plugin, kind: type) -> Iterator[tuple[str, str]]:
    """Methods that are missing, or that cannot be called as this version calls them."""
    for name, arguments in _ARGUMENTS[plugin.group].items():
        method = getattr(kind, name, None)
        wanted = f"{name}({', '.join(arguments)})"
        hint = f"it is called as {wanted}; see ariac_score.checks.contracts"
        if method is None:
            yield f"has no {wanted}", hint
            continue
        try:
            # By position, as they are called: names of arguments are the author's own. None stands for self.
            inspect.signature(method).bind(None, *arguments)
        except TypeError:
            yield f"has {name}{inspect.signature(method)} where the contract has {wanted}", hint


def _required(kind: type) -> list[str]:
    """Parameters that a rule set must give."""
    parameters = inspect.signature(kind).parameters.values()
    return [p.name for p in parameters if p.default is p.empty and p.kind is not p.VAR_KEYWORD]


# Versions ------------------------------------------------------------------------------

# Not with `packaging`, which would be a dependency of this one check. Pre-releases and `~=` are let pass.
_OURS = re.compile(r"ariac[-_.]score(?![-_.a-z0-9])\s*(?:\[[^\]]*\])?\s*\(?([^;)]*)")
_CLAUSE = re.compile(r"(>=|<=|==|!=|<|>)\s*(\d+(?:\.\d+)*)")


def _requirement(plugin: Plugin) -> Iterator[tuple[str, str]]:
    """Whether its distribution requires another version of ours."""
    try:
        required = distribution(plugin.distribution).requires or []
    except (PackageNotFoundError, ValueError):
        return
    ours = version("ariac-score")
    for line in required:
        requirement = _OURS.match(line.lower())
        if requirement and not all(_kept(ours, *clause) for clause in _CLAUSE.findall(requirement[1])):
            yield (
                f"requires ariac-score {requirement[1].strip()}, and {ours} is installed",
                "install one that fits",
            )


def _kept(ours: str, relation: str, theirs: str) -> bool:
    """Whether a version keeps one clause of a requirement.

    >>> _kept("0.10.0", ">=", "0.9"), _kept("0.1", "<", "0.1.0"), _kept("0.1", "==", "0.1.0")
    (True, False, True)
    """
    numbers = [[int(n) for n in re.findall(r"\d+", text.partition("+")[0])[:3]] for text in (ours, theirs)]
    a, b = ([*n, 0, 0, 0][:3] for n in numbers)
    return {
        ">=": a >= b, "<=": a <= b, "==": a == b, "!=": a != b, "<": a < b, ">": a > b,
    }[relation]  # fmt: skip
