"""Checks that no distribution installs: a class in a file beside a rule set, or one given in Python.

A file of code is used only where the caller allows files (`LocalFiles`): a rule set may come from
anybody, and a result or a submission must never bring code along. What runs is the very text whose
hash the result states. A local plugin is one file: of what it would import from beside it, nobody
knew the hash.
"""

from __future__ import annotations

import ast
import hashlib
import inspect
import linecache
import os
import re
import sys
import textwrap
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

from ariac_score.checks.registry import LOCAL_DISTRIBUTION, Plugin
from ariac_score.errors import LocalPluginError, PluginError, did_you_mean

__all__ = [
    "GIVEN_DISTRIBUTION",
    "MAX_CODE_BYTES",
    "GivenPlugin",
    "LocalFiles",
    "LocalPlugin",
    "allowing",
    "given_use",
]

MAX_CODE_BYTES = 1_000_000
_USE = re.compile(r"\./(?P<stem>[A-Za-z_][A-Za-z0-9_]*)\.py:(?P<cls>[A-Za-z_][A-Za-z0-9_]*)")
_SHORT = 12
"""Digits of a hash that stand for the version of a plugin that has none."""

GIVEN_DISTRIBUTION = "notebook class"
"""What a result states as the distribution of a class given in Python; no distribution can have a space."""

UNVERIFIABLE = "unverifiable"


@dataclass(frozen=True)
class _File:
    """A file of code: its name, its text when it was read, and what is in it."""

    path: Path
    text: bytes
    sha256: str

    def module(self) -> ModuleType:
        """The module that the text makes, executed once in a process."""
        place = hashlib.sha256(f"{self.path}\0{self.sha256}".encode()).hexdigest()[:16]
        name = f"_ariac_score_local_{self.path.stem}_{place}"
        if name in sys.modules:
            return sys.modules[name]
        module = ModuleType(name)
        module.__file__ = str(self.path)
        code = compile(self.text, str(self.path), "exec", dont_inherit=True)
        sys.modules[name] = module  # before it runs: dataclasses look up their own module
        try:
            exec(code, module.__dict__)  # noqa: S102  # what the caller allowed, by the text that was hashed
        except BaseException:
            del sys.modules[name]
            raise
        return module


@dataclass(frozen=True)
class LocalPlugin(Plugin):
    """A class in a file beside a rule set.

    Attributes:
        source: The file, as it was when it was read.
        cls: Name of the class.
    """

    source: _File = field(kw_only=True, repr=False)
    cls: str = field(kw_only=True)

    @property
    def package(self) -> str:
        """The file, as a rule set names it."""
        return self.name.partition(":")[0]

    @property
    def repair(self) -> str:
        """What its user can do."""
        return f"correct the class {self.cls!r} in {self.package}"

    complaint = repair

    def code_sha256(self) -> str:
        """Hash of the text that runs."""
        return self.source.sha256

    def _object(self) -> Any:
        for name in _imports(self.source):
            _refuse_neighbour(name, self)
        module = self.source.module()
        found = vars(module).get(self.cls)
        own = [n for n, v in vars(module).items() if isinstance(v, type) and v.__module__ == module.__name__]
        if self.cls not in own:
            what = "has no class of that name" if found is None else "does not define that class itself"
            raise PluginError(what, origin=self.origin, hint=did_you_mean(self.cls, own, what="its classes"))
        return found


@dataclass(frozen=True)
class GivenPlugin(Plugin):
    """A class or an object that a caller gives in Python.

    Attributes:
        kind: The class.
        instance: The check itself, where its class cannot make it again from plain parameters.
    """

    kind: type = field(kw_only=True, repr=False)
    instance: Any = field(default=None, kw_only=True, repr=False)

    @classmethod
    def of(cls, kind: type, group: str, instance: Any = None) -> GivenPlugin:
        """The plugin that a class is.

        Args:
            kind: The class.
            group: Entry-point group of its checks.
            instance: The check itself, where parameters cannot make it again.
        """
        sha256 = "" if instance is not None else _source_sha256(kind)
        version = sha256[:_SHORT] or UNVERIFIABLE
        target = f"{kind.__module__}:{kind.__qualname__}"
        use = given_use(kind)
        return cls(use, group, target, GIVEN_DISTRIBUTION, version, kind=kind, instance=instance)

    @property
    def package(self) -> str:
        """Name of the class."""
        return self.kind.__name__

    @property
    def repair(self) -> str:
        """What its user can do."""
        return f"correct the class {self.kind.__name__!r}"

    complaint = repair

    def code_sha256(self) -> str:
        """Hash of the text of the class; empty where Python has none, or cannot vouch for the object."""
        return "" if self.instance is not None else _source_sha256(self.kind)

    def build(self, parameters: Mapping[str, Any], *, place: Any = str) -> Any:
        """The check, made or given; see `Plugin.build`."""
        if self.instance is None:
            return super().build(parameters, place=place)
        self._refuse_other_contract(self.instance)
        return self.instance

    def _object(self) -> Any:
        return self.kind


def given_use(kind: type) -> str:
    """How a rule set names a class that was given in Python."""
    return f"notebook:{kind.__name__}"


def allowing(local_plugins: bool | Mapping[str, str]) -> LocalFiles | None:
    """What a caller allows: no file, every file beside a rule set, or those with these hashes."""
    if isinstance(local_plugins, Mapping):
        return LocalFiles(local_plugins)
    return LocalFiles() if local_plugins else None


class LocalFiles:
    """Files of code that a caller allows rule sets to name.

    Args:
        pinned: The only files allowed, with their SHA-256: `{"./ours.py": "9f86d0…"}`. `None` allows every
            file beside a rule set, for people who score by rules of their own.
    """

    def __init__(self, pinned: Mapping[str, str] | None = None) -> None:
        self.pinned = None if pinned is None else MappingProxyType(dict(pinned))
        self._read: dict[Path, _File] = {}

    def find(self, group: str, use: str, beside: Path | None) -> Plugin:
        """The plugin that a rule set names.

        Args:
            group: Entry-point group of the check.
            use: As the rule set names it, such as `./ours.py:NearMiss`.
            beside: Folder of the rule set; `None` for rules that lie in no file, as those in a result.

        Raises:
            LocalPluginError: The name is none, the file is not there, not allowed, or another one.
        """
        match = _USE.fullmatch(use)
        if match is None:
            raise LocalPluginError(
                f"{use!r} names no class in a file beside the rule set",
                hint="write './FILE.py:CLASS': one file, in the folder of the rule set itself",
            )
        name = f"./{match['stem']}.py"
        if self.pinned is not None and name not in self.pinned:
            raise LocalPluginError(
                f"{name!r} is not among the files that are allowed here",
                hint=did_you_mean(name, self.pinned, what="allowed")
                + "; the organiser allows a file by its name and SHA-256 under 'local_plugins:'",
            )
        if beside is None:
            raise LocalPluginError(
                f"{use!r} lies beside a rule set, and these rules lie in no file",
                hint="give the rule set itself, --rules FILE --local-plugins: a result brings its rules, "
                "never their code",
            )
        source = self._file(beside, name)
        if self.pinned is not None and self.pinned[name] != source.sha256:
            raise LocalPluginError(
                f"{name!r} has SHA-256 {source.sha256}, and {self.pinned[name]} is allowed",
                hint="bring back the file that was meant, or have the organiser allow the new one",
            )
        return LocalPlugin(
            use,
            group,
            f"{match['stem']}:{match['cls']}",
            LOCAL_DISTRIBUTION,
            source.sha256[:_SHORT],
            source=source,
            cls=match["cls"],
        )

    def _file(self, beside: Path, name: str) -> _File:
        path = beside / name
        if path not in self._read:
            self._read[path] = _read(path, beside)
        return self._read[path]


def _read(path: Path, beside: Path) -> _File:
    """A file of code, read once: what is hashed is what runs.

    Raises:
        LocalPluginError: It is not there, leads elsewhere, is no plain file, or too large.
    """
    name = f"./{path.name}"
    try:
        real = path.resolve(strict=True)
        if real.parent != beside.resolve():
            raise LocalPluginError(
                f"{name!r} is a link that leads out of the folder of the rule set",
                hint="put the file itself beside the rule set",
            )
        if not real.is_file():
            raise LocalPluginError(f"{name!r} is no file", hint="put a file of Python there")
        with real.open("rb") as stream:
            text = stream.read(MAX_CODE_BYTES + 1)
    except (OSError, RuntimeError) as cause:  # a RuntimeError: before Python 3.13, for links in a circle
        reason = getattr(cause, "strerror", None) or cause
        raise LocalPluginError(
            f"{name!r} cannot be read: {reason}",
            hint="a rule set names files in its own folder: './ours.py:NearMiss'",
        ) from cause
    if len(text) > MAX_CODE_BYTES:
        raise LocalPluginError(
            f"{name!r} has more than {MAX_CODE_BYTES:,} bytes", hint="is it the right file?"
        )
    # As for packages: a checkout on Windows may have other line ends.
    plain = text.replace(b"\r\n", b"\n")
    return _File(path, plain, hashlib.sha256(plain).hexdigest())


def _imports(source: _File) -> Iterator[str]:
    """The names of the modules that a text imports, anywhere in it; of relative ones with their points."""
    for node in ast.walk(ast.parse(source.text, str(source.path))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield "." * node.level + (node.module or "")


def _refuse_neighbour(name: str, plugin: LocalPlugin) -> None:
    """Refuse an import of what lies beside the file.

    Raises:
        PluginError: It is one.
    """
    top = name.partition(".")[0]
    folder = plugin.source.path.parent
    if top == "ariac_score":  # in a checkout it lies beside; it is hashed by itself
        return
    if top and not ((folder / f"{top}.py").exists() or (folder / top).is_dir()):
        return
    spec = find_spec(top) if top else None
    where = os.path.realpath(spec.origin or "") if spec else ""
    if spec is None or where.startswith(f"{folder.resolve()}{os.sep}"):
        raise PluginError(
            f"imports its neighbour {name!r}, and a local plugin is one file",
            origin=plugin.origin,
            hint=f"put what it needs into {plugin.package}, or grow it: ariac-score new distribution",
        )


def _text_around_methods(kind: type) -> str:
    """The text of a class by where its methods were written; empty where that is unknown."""
    for method in vars(kind).values():
        code = getattr(inspect.unwrap(method), "__code__", None) if callable(method) else None
        lines = linecache.getlines(code.co_filename) if code else []
        try:
            tree = ast.parse("".join(lines))
        except SyntaxError:  # a cell with commands of the notebook
            continue
        for node in ast.walk(tree):
            if not isinstance(node, ast.ClassDef) or node.name != kind.__name__ or code is None:
                continue
            if node.lineno <= code.co_firstlineno <= (node.end_lineno or 0):
                first = min([node.lineno, *(one.lineno for one in node.decorator_list)])
                return textwrap.dedent("".join(lines[first - 1 : node.end_lineno]))
    return ""


def _source_sha256(kind: type) -> str:
    """Hash of the text of a class; empty where Python has none."""
    # By its methods first: of a class in a cell `inspect` knows no file, and Python 3.13 then takes that of
    # the program that runs the cell.
    text = _text_around_methods(kind) or _text_of_file(kind)
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest() if text else ""


def _text_of_file(kind: type) -> str:
    if kind.__module__ == "__main__":
        return ""
    try:
        return textwrap.dedent(inspect.getsource(kind))
    except (OSError, TypeError):  # typed at a prompt, or made by a program
        return ""
