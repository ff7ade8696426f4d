"""Finding plugins through entry points, and building them with checked parameters.

First-party plugins come in by the same door as anyone's. Entry points load one by
one: a plugin that is broken, unknown or provided twice stops only what uses it,
and is always named with its distribution.
"""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType, SimpleNamespace, UnionType
from typing import Any, Literal, Protocol, Union, get_args, get_origin, get_type_hints

from ariac_score.checks.parameters import ParameterFacts, facts_of
from ariac_score.errors import (
    LocalPluginError,
    PluginConflictError,
    PluginError,
    PluginNotFoundError,
    RuleSetError,
    did_you_mean,
)
from ariac_score.installed.captured_output import fault_of, quiet
from ariac_score.installed.points import Point, installed_points, unreadable_hint

__all__ = [
    "FILE_GROUPS",
    "LOCAL_DISTRIBUTION",
    "DataFile",
    "LocalFinder",
    "Plugin",
    "Registry",
    "is_local",
    "package_sha256",
]

LOCAL_DISTRIBUTION = "local file"
"""What a result states as the distribution of a file beside a rule set; none can have a space in its name."""

FILE_GROUPS: Mapping[str, str] = {
    "ariac_score.rule_sets": "ruleset",
    "ariac_score.log_maps": "log_map",
    "ariac_score.penalties": "penalty",
    "ariac_score.recordings": "recording",
}
"""Entry-point groups of YAML files, and the stem of the file that has the name of its folder alone."""

_AUDIT = ".audit"
"""What a rule set says to auditors lies beside it, in a file of its own, and is none."""

_CLASSES = "classes"
"""Weights that all penalties share; it lies among them and is none."""


def is_local(use: str) -> bool:
    """Whether a rule set names code that no distribution installs: a file, or a class of a notebook.

    >>> is_local("./ours.py:NearMiss"), is_local("iso_ts_15066.ssm_separation")
    (True, False)
    """
    return ":" in use


class Plugin(Point):
    """One plugin as installed, not yet imported: an entry point of one of our groups."""

    def code_sha256(self) -> str:
        """Hash of its code.

        Raises:
            PluginError: The code cannot be found on disk.
        """
        return package_sha256(self.package)

    def build(self, parameters: Mapping[str, Any], *, place: Callable[[str], str] = str) -> Any:
        """Make the plugin with its parameters.

        Args:
            parameters: The `with:` block of the rule set.
            place: Words for where a parameter stands, for error messages.

        Raises:
            RuleSetError: Unknown parameter, wrong type, or a value the plugin refuses.
            PluginError: The plugin does not keep its contract.
        """
        kind = self.load()
        values = self._typed(kind, parameters, place)
        self._refuse_by_position(kind)  # first: it names the argument, as the TypeError of the call does not
        try:
            with quiet(self.origin, deep=True):
                plugin = kind(**values)
        except PluginError:
            raise
        except ValueError as cause:  # what `__post_init__` raises for a number that makes no sense
            raise RuleSetError(
                f"{self.name} refuses its parameters: {cause}", place=place(""), hint="change the parameter"
            ) from None
        except Exception as cause:
            raise PluginError(
                f"cannot be built: {fault_of(cause)}",
                origin=self.origin,
                hint="parameters must be keyword arguments with a default or a value in the rule set",
            ) from cause
        self._refuse_other_contract(plugin)
        return plugin

    def _refuse_other_contract(self, plugin: Any) -> None:
        from ariac_score.checks.contracts import GROUPS  # noqa: PLC0415  # numpy, which --help does without

        if not isinstance(plugin, GROUPS[self.group]):
            raise PluginError(
                f"does not keep the contract of a {GROUPS[self.group].__name__}",
                origin=self.origin,
                hint="see ariac_score.checks.contracts for the methods it must have",
            )

    def value(self) -> Any:
        """What an entry point of a group of values names, such as a `Quantity`.

        Raises:
            PluginError: It cannot be imported, or is something else.
        """
        from ariac_score.checks.contracts import VALUE_GROUPS  # noqa: PLC0415  # as in `build`

        value, wanted = self.load(), VALUE_GROUPS[self.group]
        if not isinstance(value, wanted):
            raise PluginError(
                f"is a {type(value).__name__}, not a {wanted.__name__}",
                origin=self.origin,
                hint=f"let the entry point name a value: NAME = {wanted.__name__}(...)",
            )
        return value

    def _typed(self, kind: Any, parameters: Mapping[str, Any], place: Callable[[str], str]) -> dict[str, Any]:
        """The parameters with the types that the plugin declares."""
        try:
            fields = parameters_of(kind)
        except (NameError, TypeError, AttributeError) as cause:
            raise PluginError(
                f"has a parameter whose type cannot be resolved: {cause}",
                origin=self.origin,
                hint="annotate parameters with types that exist when the plugin runs",
            ) from cause
        values: dict[str, Any] = {}
        for name, value in parameters.items():
            if name not in fields:
                raise RuleSetError(
                    f"{self.name} has no parameter {name!r}",
                    place=place(name),
                    hint=did_you_mean(name, fields, what="parameters"),
                )
            try:
                values[name] = _as_type(value, fields[name].type)
            except ValueError as cause:
                raise RuleSetError(
                    f"parameter {name!r} of {self.name}: {cause}",
                    place=place(name),
                    hint=_remedy(value, fields[name]),
                ) from None
        return values

    def _refuse_by_position(self, kind: Any) -> None:
        problem = not_by_name(kind)
        if problem:
            raise PluginError(
                f"cannot be built: its constructor {problem}",
                origin=self.origin,
                hint="parameters must be keyword arguments with a default or a value in the rule set",
            )


@cache
def not_by_name(kind: Any) -> str:
    """Which argument of a class cannot be given by name, as rule sets give them; empty when all can.

    >>> class Odd:
    ...     def __init__(self, limit, /): ...
    >>> not_by_name(Odd)
    "takes 'limit' by position alone, and a rule set gives parameters by name"
    """
    try:
        parameters = inspect.signature(kind).parameters.values()
    except (TypeError, ValueError):  # classes written in C often have no signature
        return ""
    for parameter in parameters:
        if parameter.kind is parameter.POSITIONAL_ONLY:
            return f"takes {parameter.name!r} by position alone, and a rule set gives parameters by name"
    return ""


@dataclass(frozen=True)
class Parameter:
    """One parameter of a plugin.

    Attributes:
        type: Its type, resolved.
        default: Its default; the word `none` when it has none.
        facts: Its unit, range, status and source, as far as the plugin declares them.
    """

    type: Any
    default: Any
    facts: ParameterFacts = field(default_factory=ParameterFacts)


def _remedy(value: Any, wanted: Parameter) -> str:
    if value not in get_args(wanted.type) and str(value) in get_args(wanted.type):
        return f"it is text, not a number: write '{value}' in quotes"
    numeric = {int, float} & {wanted.type, *get_args(wanted.type)}
    if numeric and wanted.facts.unit and isinstance(value, str):  # `100 ms`
        unit = "" if wanted.facts.unit == "1" else f" in {wanted.facts.unit}"
        hint = f"give a number{unit}, such as {0.1 if wanted.default in (None, 'none') else wanted.default!r}"
    else:
        hint = f"its default is {wanted.default!r}"
    if isinstance(value, str) and _NUMBER.fullmatch(value):
        hint += "; YAML takes a number with an exponent for text unless it has a point and a sign: 3.0e-2"
    return hint


def parameters_of(kind: Any) -> dict[str, Parameter]:
    """The parameters a rule set may give to a plugin class, by name."""
    if not dataclasses.is_dataclass(kind):
        return {}
    hints = _hints_of_fields(kind)
    return {
        f.name: Parameter(hints[f.name], _default_of(f), facts_of(f))
        for f in dataclasses.fields(kind)
        if f.init
    }


def _hints_of_fields(kind: Any) -> dict[str, Any]:
    """The resolved types of its fields alone: Python 3.10 refuses a bare `ClassVar` beside them."""
    names = {f.name for f in dataclasses.fields(kind)}
    hints: dict[str, Any] = {}
    for base in reversed(kind.__mro__):
        declared = {name: of for name, of in vars(base).get("__annotations__", {}).items() if name in names}
        known = vars(sys.modules[base.__module__]) if base.__module__ in sys.modules else {}
        hints |= get_type_hints(SimpleNamespace(__annotations__=declared), {**vars(base), **known})
    return hints


def _default_of(declared: dataclasses.Field[Any]) -> Any:
    if declared.default is not dataclasses.MISSING:
        return declared.default
    return "none" if declared.default_factory is dataclasses.MISSING else declared.default_factory()


def _as_type(value: Any, wanted: Any) -> Any:
    """A YAML value as the type a field declares; strict about booleans and text.

    Raises:
        ValueError: It is not of that type.
    """
    origin = get_origin(wanted)
    if origin is Literal:
        if isinstance(value, bool) and {"yes", "no"} <= set(get_args(wanted)):
            return "yes" if value else "no"  # YAML 1.1 reads an unquoted yes as true
        if value not in get_args(wanted):
            raise ValueError(f"{value!r} is not one of {', '.join(map(str, get_args(wanted)))}")
        return value
    if origin in (Union, UnionType):
        return (
            None
            if value is None
            else _as_type(value, next(a for a in get_args(wanted) if a is not type(None)))
        )
    if origin is tuple:
        if not isinstance(value, list):
            raise ValueError(f"{value!r} is not a list")
        return tuple(_as_type(item, get_args(wanted)[0]) for item in value)
    if origin is Mapping:
        if not isinstance(value, dict):
            raise ValueError(f"{value!r} is not a mapping of names to values")
        return MappingProxyType(
            {_as_type(key, get_args(wanted)[0]): _as_type(v, get_args(wanted)[1]) for key, v in value.items()}
        )
    if dataclasses.is_dataclass(wanted) and isinstance(wanted, type):
        return _as_dataclass(value, wanted)
    # YAML writes 1 for 1.0; `true` is an int to Python, but no number to a person.
    if wanted is float and isinstance(value, int | float) and not isinstance(value, bool):
        if not -_LARGEST <= value <= _LARGEST:  # NaN keeps neither
            raise ValueError(f"{value!r} is not finite")
        return float(value)
    if (
        isinstance(wanted, type)
        and isinstance(value, wanted)
        and (wanted is bool or not isinstance(value, bool))
    ):
        return value
    name = str(getattr(wanted, "__name__", wanted))
    raise ValueError(f"{value!r} is not {'an' if name[0] in 'aeiou' else 'a'} {name}")


_NUMBER = re.compile(r"[-+]?[0-9.]+[eE][-+]?[0-9]+")
_LARGEST = sys.float_info.max


class LocalFinder(Protocol):
    """Finds plugins that no distribution installs; see `ariac_score.checks.local.LocalFiles`."""

    def find(self, group: str, use: str, beside: Path | None) -> Plugin:
        """The plugin that a rule set in a folder names."""
        ...


class Registry:
    """The plugins installed here, by group and name.

    Args:
        local: Finds the files of code that the caller allows rule sets to name; by default none is allowed.
    """

    def __init__(self, local: LocalFinder | None = None) -> None:
        self.local = local
        self._providers: dict[tuple[str, str], list[Plugin]] = {}
        self._files: dict[Plugin, list[DataFile]] = {}
        for point in installed_points():
            plugin = Plugin(point.name, point.group, point.target, point.distribution, point.version)
            self._providers.setdefault((point.group, point.name), []).append(plugin)

    def groups(self) -> list[str]:
        """Every group of ours that something is installed in, sorted."""
        return sorted({group for group, _ in self._providers})

    def names(self, group: str) -> list[str]:
        """The names in a group, sorted."""
        return sorted(name for g, name in self._providers if g == group)

    def all(self, group: str) -> list[Plugin]:
        """Every plugin of a group, sorted by name; those provided twice come twice."""
        return [p for name in self.names(group) for p in self._providers[group, name]]

    def providers(self, group: str, name: str) -> list[Plugin]:
        """Everything installed under a name: none, one, or several that contradict each other."""
        return list(self._providers.get((group, name), []))

    def find(self, group: str, name: str, *, beside: Path | None = None) -> Plugin:
        """The plugin of that name.

        Args:
            group: Entry-point group.
            name: As installed; or a class in a file, where the registry allows files.
            beside: Folder of the rule set that names it, which is where such a file lies.

        Raises:
            PluginNotFoundError: No installed distribution provides it.
            PluginConflictError: Two do, so neither may be used.
            LocalPluginError: It is in a file that is not allowed here.
        """
        if is_local(name):
            return self._find_local(group, name, beside)
        providers = self._providers.get((group, name), [])
        if not providers:
            elsewhere = [g for g, n in self._providers if n == name]
            hint = did_you_mean(name, self.names(group), what="installed")
            if elsewhere:
                hint = f"it is a plugin of {elsewhere[0]}, not of {group}"
            hint += unreadable_hint()
            raise PluginNotFoundError(
                f"no installed distribution provides {name!r} ({group})",
                hint=f"{hint}; otherwise install the distribution that brings it",
            )
        if len(providers) > 1:
            raise _conflict(name, providers)
        return providers[0]

    def _find_local(self, group: str, name: str, beside: Path | None) -> Plugin:
        if name.startswith("notebook:"):
            raise LocalPluginError(
                f"{name!r} was a class in somebody's Python, and no file has it",
                hint="give it again with RuleSet.with_monitor, or write it into a file: './ours.py:Class'",
            )
        if self.local is None and beside is None:
            raise LocalPluginError(
                f"{name!r} is code in a file, and the caller does not allow that",
                hint="give the rule set itself and allow its files, --rules FILE --local-plugins, where a "
                "command has them: a result brings its rules, never their code",
            )
        if self.local is None:
            raise LocalPluginError(
                f"{name!r} is code in a file, and the caller does not allow that",
                hint="--local-plugins allows files beside your own rule set, where a command has it, "
                "local_plugins=True in Python; a "
                "competition names file and SHA-256 under 'local_plugins:' in competition.yaml; all others "
                "install plugins",
            )
        return self.local.find(group, name, beside)

    def files(self, group: str) -> list[DataFile]:
        """Every file of a group, sorted by name; those of an entry point that leads nowhere are missing.

        Args:
            group: One of `FILE_GROUPS`.
        """
        found: list[DataFile] = []
        for plugin in self.all(group):
            with suppress(PluginError):  # the doctor names it
                found += self._files_of(plugin)
        return sorted(found, key=lambda file: (file.name, file.plugin.distribution))

    def file(self, group: str, name: str) -> DataFile:
        """The file of that name.

        Raises:
            PluginNotFoundError: No installed distribution provides it.
            PluginConflictError: Two do, so neither may be used.
            PluginError: The entry point that would provide it leads nowhere.
        """
        # An entry point of a folder brings names that begin with its own.
        may = [p for p in self.all(group) if f"{name}.".startswith(f"{p.name}.")]
        found = [file for plugin in may for file in self._files_of(plugin) if file.name == name]
        if not found:
            names = [file.name for file in self.files(group)]
            raise PluginNotFoundError(
                f"no installed distribution provides {name!r} ({group})",
                hint=did_you_mean(name, names, what="installed") + unreadable_hint(),
            )
        if len(found) > 1:
            raise _conflict(name, [file.plugin for file in found])
        return found[0]

    def _files_of(self, plugin: Plugin) -> list[DataFile]:
        if plugin not in self._files:  # a folder is looked through once
            self._files[plugin] = _files_of(plugin)
        return self._files[plugin]


@dataclass(frozen=True)
class DataFile:
    """A YAML file of an installed distribution.

    Attributes:
        name: By which people call it, such as `ariac2022.as_coded`.
        path: Where it lies.
        plugin: The entry point that brings it.
    """

    name: str
    path: Path
    plugin: Plugin


def _files_of(plugin: Plugin) -> list[DataFile]:
    """The file that an entry point names, or each file of the folder, in the order of their names."""
    place = plugin.path()
    if place.is_file():
        return [DataFile(plugin.name, place, plugin)]
    own = FILE_GROUPS[plugin.group]
    others = {*FILE_GROUPS.values(), _CLASSES} - {own}  # a folder may hold a log map beside its rule sets
    files = []
    for path in sorted(place.rglob("*.yaml")):
        *folders, stem = path.relative_to(place).with_suffix("").parts
        if stem not in others and not stem.endswith(_AUDIT):
            inner = folders if stem == own else [*folders, stem]
            files.append(DataFile(".".join([plugin.name, *inner]), path, plugin))
    return files


def _conflict(name: str, providers: Sequence[Plugin]) -> PluginConflictError:
    both = " and ".join(f"{p.distribution} {p.version}" for p in providers)
    return PluginConflictError(
        f"{name!r} is provided by {both}",
        hint="uninstall one: sys.path order must not choose a referee",
    )


_DATA_PACKAGES = frozenset({"examples", "rules", "schemas"})
"""Left out: what is used of them is hashed by itself, and only a wheel has them inside the package."""


@cache
def package_sha256(package: str) -> str:
    """Hash of every Python file of an import package, by relative name and content.

    It differs between two states of a plugin even when their version number does not.

    Raises:
        PluginError: The package cannot be found on disk.
    """
    try:
        spec = find_spec(package)
    except (ImportError, ValueError):  # for an empty name, and for a module that hides where it is from
        spec = None
    roots = list(spec.submodule_search_locations or ()) if spec else []
    if spec is not None and not roots and spec.origin:
        files = [Path(spec.origin)]
        root = files[0].parent
    elif roots:
        root = Path(roots[0])
        files = sorted(p for p in root.rglob("*.py") if is_code(p.relative_to(root).as_posix()))
    else:
        raise PluginError(f"package {package!r} is not on disk")
    return code_sha256((file.relative_to(root).as_posix(), file.read_bytes()) for file in files)


def code_sha256(files: Iterable[tuple[str, bytes]]) -> str:
    """Hash of the Python files of a package, wherever they lie.

    Args:
        files: Names within the package, with `/`, and contents; sorted by the parts of the names.
    """
    digest = hashlib.sha256()
    for name, raw in files:
        # A checkout on Windows may have other line ends than the wheel made from it.
        content = raw.replace(b"\r\n", b"\n")
        # With name and length, so that no two sets of files can run into the same bytes.
        digest.update(f"{name}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()


def is_code(name: str) -> bool:
    """Whether a file of a package, by its name within it, counts for the hash of its code."""
    return name.endswith(".py") and name.partition("/")[0] not in _DATA_PACKAGES


def _as_dataclass(value: Any, kind: type) -> Any:
    """A mapping as the class of a parameter that has parameters of its own.

    Raises:
        ValueError: A key is unknown or missing, or a value is not of its type.
    """
    fields = parameters_of(kind)
    if not isinstance(value, dict):
        raise ValueError(f"{value!r} is not a mapping with {', '.join(fields)}")
    for name in value:
        if name not in fields:
            raise ValueError(f"key {name!r} is unknown; {did_you_mean(str(name), fields, what='keys')}")
    missing = [name for name, wanted in fields.items() if name not in value and wanted.default == "none"]
    if missing:
        raise ValueError(f"key {missing[0]!r} is missing")
    values = {}
    for name, given in value.items():
        try:
            values[name] = _as_type(given, fields[name].type)
        except ValueError as cause:
            raise ValueError(f"{name}: {cause}") from None
    return kind(**values)
