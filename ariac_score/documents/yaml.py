"""YAML that strangers may have written, read within limits, with the line of each value."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike
from pathlib import Path
from typing import Any

import yaml

from ariac_score.documents.given import path_of
from ariac_score.documents.plain_file import read_plain
from ariac_score.errors import DataFileError

__all__ = ["Place", "RepeatedKey", "YamlDocument", "is_there", "load_yaml", "parse_yaml", "read_text"]


MAX_BYTES = 4_000_000
MAX_DEPTH = 64
MAX_NODES = 200_000
"""Nodes after aliases are expanded, so that a few lines cannot stand for billions."""
LARGEST_INTEGER = 2**64
"""No time stamp is larger, and Python refuses to print a number of thousands of digits."""

# The loader in C is absent where PyYAML was installed without libyaml.
_Loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_TAG_MAP, _TAG_SEQ = "tag:yaml.org,2002:map", "tag:yaml.org,2002:seq"


Place = tuple["str | int", ...]


def _never(_path: Place) -> bool:
    return False


@dataclass(frozen=True)
class RepeatedKey:
    """A key that comes twice in one map; the later value was taken.

    Attributes:
        path: From the root.
        line: Of the later one, from 1.
        first_line: Of the earlier one.
    """

    path: Place
    line: int
    first_line: int


@dataclass(frozen=True)
class YamlDocument:
    """One YAML file, loaded safely.

    Attributes:
        data: Plain Python values.
        file: The file as the user named it.
        sha256: Hash of its bytes.
        lines: Line (from 1) of each value, by its path from the root.
        repeats: Keys given twice, where the caller allows that.
        files: The file of a key at the top that stands in another file than the rest.
    """

    data: Any
    file: str
    sha256: str
    lines: Mapping[Place, int]
    repeats: tuple[RepeatedKey, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)

    def place(self, path: Sequence[str | int]) -> str:
        """A path for an error message: the line and a JSON path, such as `line 7, $.terms.order`."""
        where = "$" + "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in path)
        known = tuple(path)
        while known and known not in self.lines:
            known = known[:-1]
        line = self.lines.get(known)
        return f"line {line}, {where}" if line else where


def read_text(path: Path, *, error: type[DataFileError] = DataFileError, max_bytes: int = MAX_BYTES) -> bytes:
    """The bytes of a text file, refused when it is missing, unreadable or too large."""
    try:
        size = path.stat().st_size
        if size > max_bytes:
            raise error(
                f"the file has {size:,} bytes, more than the {max_bytes:,} allowed",
                file=path,
                hint="a configuration of this kind is a few pages long; is this the right file?",
            )
        return read_plain(path, max_bytes)
    except FileNotFoundError:
        raise error("no such file", file=path, hint="check the path") from None
    except OSError as cause:
        raise error(f"cannot be read: {cause.strerror}", file=path, hint="check the permissions") from cause
    except ValueError as cause:  # a name no file can have, such as one with a null byte
        raise error(f"cannot be read: {cause}", file=path, hint="check the path") from cause


def is_there(path: Path) -> bool:
    """Whether a path exists; it does not where the system refuses the name."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def load_yaml(
    path: str | PathLike[str],
    *,
    error: type[DataFileError] = DataFileError,
    max_bytes: int = MAX_BYTES,
    may_repeat: Callable[[Place], bool] = _never,
) -> YamlDocument:
    """Load a YAML file that a stranger may have written.

    Args:
        path: The file.
        error: What to raise.
        max_bytes: Largest file that is read.
        may_repeat: Whether the key at a path may be given twice: the last value is
            taken, as most YAML loaders do, and the key is among the `repeats`.

    Raises:
        DataFileError: (or `error`) missing, too large, not UTF-8, malformed, two
            documents, a duplicate key, or nested or aliased beyond the limits.
    """
    path = path_of(path)
    raw = read_text(path, error=error, max_bytes=max_bytes)
    return parse_yaml(raw, file=str(path), error=error, may_repeat=may_repeat)


def parse_yaml(
    raw: bytes,
    *,
    file: str,
    error: type[DataFileError] = DataFileError,
    may_repeat: Callable[[Place], bool] = _never,
) -> YamlDocument:
    """Load YAML from bytes; see `load_yaml`."""
    try:
        text = raw.decode("utf-8-sig")  # editors on Windows put a mark before the text
    except UnicodeDecodeError as cause:
        raise error(
            "not UTF-8 text", file=file, place=f"byte {cause.start}", hint="save it as UTF-8"
        ) from None
    try:
        _check_depth(text, file, error)
        root = yaml.compose(text, Loader=_Loader)
    except yaml.MarkedYAMLError as cause:
        mark = cause.problem_mark or cause.context_mark
        if mark and "nesting depth" in (cause.problem or ""):  # libyaml, which looks ahead
            raise _too_deep(f"line {mark.line + 1}", file, error) from None
        place = f"line {mark.line + 1}, column {mark.column + 1}" if mark else ""
        problem = " ".join(text for text in (cause.context, cause.problem) if text)
        raise error(
            f"malformed YAML: {problem}", file=file, place=place, hint="check indentation, quotes and colons"
        ) from None
    except yaml.YAMLError as cause:
        raise error(
            f"malformed YAML: {cause}", file=file, hint="check the file for control characters"
        ) from None
    builder = _Builder(file, error, may_repeat)
    data = None
    if root is not None:
        _check_nodes(root, file, error)
        builder.lines[()] = _line_number(root)
        data = builder.value(root)
    return YamlDocument(data, file, hashlib.sha256(raw).hexdigest(), builder.lines, tuple(builder.repeats))


def _check_depth(text: str, file: str, error: type[DataFileError]) -> None:
    """Refuse deep nesting before anything recursive sees it: `yaml.compose` would exhaust the stack."""
    depth = 0
    events: Iterator[Any] = iter(yaml.parse(text, Loader=_Loader))
    for event in events:
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > MAX_DEPTH:
                raise _too_deep(_line(event), file, error)
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1


def _too_deep(place: str, file: str, error: type[DataFileError]) -> DataFileError:
    return error(
        f"nested deeper than {MAX_DEPTH} levels",
        file=file,
        place=place,
        hint="no configuration needs this; the file looks hostile or broken",
    )


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []


def _check_nodes(root: yaml.Node, file: str, error: type[DataFileError]) -> None:
    """Refuse alias bombs: count every node as often as it would be visited."""
    sizes: dict[int, tuple[int, int]] = {}
    busy: set[int] = set()

    def size(node: yaml.Node) -> tuple[int, int]:
        """Nodes and levels below and including this one."""
        key = id(node)
        if key in sizes:
            return sizes[key]
        if key in busy:
            raise error(
                "an alias refers to its own surroundings",
                file=file,
                place=_line(node),
                hint="remove the alias",
            )
        busy.add(key)
        inner = [size(child) for child in _children(node)]
        total = 1 + sum(nodes for nodes, _ in inner)
        depth = 1 + max((levels for _, levels in inner), default=0)
        busy.discard(key)
        if depth > MAX_DEPTH + 1:  # a value in the deepest list is a level of its own
            raise _too_deep(_line(node), file, error)
        if total > MAX_NODES:
            raise error(
                f"more than {MAX_NODES:,} values once aliases are expanded",
                file=file,
                place=_line(node),
                hint="write the values out instead of nesting aliases; the file looks hostile",
            )
        sizes[key] = total, depth
        return sizes[key]

    size(root)


def _line_number(node: yaml.Node | yaml.Event) -> int:
    return node.start_mark.line + 1 if node.start_mark else 1


def _line(node: yaml.Node | yaml.Event) -> str:
    return f"line {_line_number(node)}"


class _Builder:
    """Turns nodes into plain values, refusing what a configuration has no use for."""

    def __init__(self, file: str, error: type[DataFileError], may_repeat: Callable[[Place], bool]) -> None:
        self.file, self.error, self.may_repeat = file, error, may_repeat
        self.lines: dict[Place, int] = {}
        self.repeats: list[RepeatedKey] = []
        self._scalars = yaml.constructor.SafeConstructor()

    def value(self, node: yaml.Node, path: Place = ()) -> Any:
        """The plain value of a node at a path."""
        if isinstance(node, yaml.SequenceNode) and node.tag == _TAG_SEQ:
            for i, child in enumerate(node.value):
                self.lines[(*path, i)] = _line_number(child)
            return [self.value(child, (*path, i)) for i, child in enumerate(node.value)]
        if isinstance(node, yaml.MappingNode) and node.tag == _TAG_MAP:
            return dict(self._items(node, path))
        if isinstance(node, yaml.ScalarNode):
            return self._scalar(node)
        raise self._refusal(node, f"tag {node.tag!r} is not allowed", "use plain lists, maps and values")

    def _scalar(self, node: yaml.ScalarNode) -> Any:
        try:
            value = self._scalars.construct_object(node)
        except (yaml.YAMLError, ValueError) as cause:
            problem = str(cause).splitlines()[0]
            raise self._refusal(
                node, f"{node.value!r} is not a plain value: {problem}", "quote it if text is meant"
            ) from None
        if isinstance(value, int) and abs(value) > LARGEST_INTEGER:
            raise self._refusal(node, "so large a number is not allowed", "quote it if text is meant")
        return value

    def _items(self, node: yaml.MappingNode, path: Place) -> Iterator[tuple[Any, Any]]:
        seen: dict[Any, int] = {}
        for key_node, value_node in node.value:
            if not isinstance(key_node, yaml.ScalarNode):
                raise self._refusal(key_node, "a key must be a plain value", "quote the key")
            key = self._scalar(key_node)
            where = (*path, str(key))
            if key in seen and self.may_repeat(where):
                self.repeats.append(RepeatedKey(where, _line_number(key_node), seen[key]))
            elif key in seen:
                raise self._refusal(
                    key_node,
                    f"key {key!r} is given twice, first in line {seen[key]}",
                    "keep one of the two; YAML would silently take the last",
                )
            seen[key] = self.lines[where] = _line_number(key_node)
            yield key, self.value(value_node, where)

    def _refusal(self, node: yaml.Node, cause: str, hint: str) -> DataFileError:
        return self.error(cause, file=self.file, place=_line(node), hint=hint)
