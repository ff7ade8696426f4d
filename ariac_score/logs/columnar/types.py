"""Message types: how the bytes of a connection become messages or columns.

The definition embedded in the recording decides. Only a recording without
definitions falls back on the stock types of rosbags and those in `msg/`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache, lru_cache
from importlib.resources import files
from typing import Any, Literal

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Typesdict
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from ariac_score.checks.registry import Registry
from ariac_score.errors import PluginError
from ariac_score.logs.columnar import ColumnDecoder
from ariac_score.logs.columnar.columns import UNDECODABLE
from ariac_score.logs.columnar.plan import PlanError
from ariac_score.logs.columnar.service_events import event_definition
from ariac_score.logs.columnar.wide_text import UNITS, WideDecoder, plain_definition, widened
from ariac_score.logs.containers.items import Connection

__all__ = [
    "Decode",
    "UnknownTypeError",
    "bundled_typestore",
    "column_decoder_for",
    "compiled_store_of",
    "decoder_for",
    "is_defined",
    "refuse_undecodable",
    "type_hash_of",
]


Decode = Callable[["bytes | memoryview"], object]


# ASCII, because rosbags turns names into those of Python classes.
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/(msg|srv|action))?/[A-Za-z]\w*", re.ASCII)


_LONGEST_SEQUENCE = 1 << 24
"""Elements in one array of a message: the size of a message does not bound elements that take no bytes."""


_MOST_LINES = 10_000
"""Lines of a definition. Large ones of real robots have some thousand, comments included. The time that
rosbags takes grows with the square of the fields: a hostile definition of a megabyte would take minutes."""


_MOST_UNROLLED = 10_000
"""Elements of arrays of a fixed length: for each text and message in one, rosbags writes lines of code."""


_WIDE = re.compile(r"^[ \t]*wstring\b|<[ \t]*wstring\b", re.MULTILINE)


_NO_DEFINITION = ("", "unknown")
"""How a recorder calls the form of a definition that it does not have; rosbag2 since Jazzy says `unknown`."""


_IDL_SEPARATOR = "=" * 80 + "\n"


GROUP = "ariac_score.messages"
"""Entry points that name a package, whose folder `msg/NAME` holds the message definitions of NAME."""


class UnknownTypeError(Exception):
    """The messages of a connection cannot be decoded; the text says why."""


def bundled_typestore(ros: Literal[1, 2]) -> Typestore:
    """The stock types of rosbags, those in `ariac_score/logs/msg`, and those that plugins bring.

    Do not register anything in it: it is shared.

    Args:
        ros: The ROS generation; the two differ in `Header`.
    """
    return _bundled(ros)[0]


@cache
def _bundled(ros: Literal[1, 2]) -> tuple[Typestore, Mapping[str, str]]:
    """The store of bundled types, and why the message packages of some plugins are not in it, by name."""
    store = get_typestore(Stores.ROS1_NOETIC if ros == 1 else Stores.ROS2_HUMBLE)
    for folder in files("ariac_score.logs").joinpath("msg").iterdir():
        store.register(_defined(folder))
    registry, unusable = Registry(), {}
    for name in registry.names(GROUP):
        try:
            plugin = registry.find(GROUP, name)
        except PluginError as conflict:
            unusable[name] = f"{conflict.cause}; {conflict.hint}"
            continue
        try:
            store.register(_defined(files(plugin.target).joinpath("msg", name)))
        except Exception as cause:  # noqa: BLE001  # a stranger's package may fail in any way
            why = " ".join(str(cause).split())[:200]
            unusable[name] = f"those of {plugin.origin} cannot be used: {type(cause).__name__}: {why}"
    return store, unusable


def _defined(folder: Any) -> Typesdict:
    """The types whose definitions lie in the folder of a message package, a `Traversable`."""
    types: Typesdict = {}
    for definition in sorted(folder.iterdir(), key=lambda file: file.name):
        name = f"{folder.name}/msg/{definition.name.removesuffix('.msg')}"
        types.update(get_types_from_msg(definition.read_text(encoding="utf-8"), name))
    return types


def decoder_for(connection: Connection) -> Decode:
    """A function from the payloads of a connection to messages.

    Messages have their fields as attributes. The function raises `UnknownTypeError`
    for a payload that does not fit the definition.

    Raises:
        UnknownTypeError: The encoding is not one of ROS, no definition of the type is
            known, or the recording's own definition cannot be understood.
    """
    store, name = compiled_store_of(connection), connection.type
    deserialise = store.deserialize_ros1 if connection.encoding == "ros1" else store.deserialize_cdr

    def decode(payload: bytes | memoryview) -> object:
        try:
            return deserialise(bytes(payload), name)
        except (SerdeError, *UNDECODABLE) as error:
            raise UnknownTypeError(str(error) or type(error).__name__) from error

    return decode


def column_decoder_for(connection: Connection, wanted: Iterable[str] | None = None) -> ColumnDecoder:
    """A decoder from the payloads of a connection to columns.

    Args:
        connection: Whose messages they are.
        wanted: Dotted paths of the wanted fields; `None`: all.

    Raises:
        UnknownTypeError: As of `decoder_for`.
        PlanError: Its messages can be decoded one by one only.
    """
    paths = None if wanted is None else tuple(wanted)
    cdr = connection.encoding == "cdr"
    if cdr and _WIDE.search(connection.definition):  # ROS 1 has no wide texts
        return _wide_decoder_for(connection, paths)
    try:
        return ColumnDecoder(_store_of(connection), connection.type, cdr=cdr, wanted=paths)
    except PlanError:
        compiled_store_of(connection)  # where a definition is at fault, rosbags says what it lacks
        raise


def _wide_decoder_for(connection: Connection, wanted: Iterable[str] | None) -> ColumnDecoder:
    stores = {unit: compiled_store_of(connection, unit) for unit in UNITS}
    return WideDecoder(stores, connection.type, wanted=wanted)


def type_hash_of(connection: Connection) -> str:
    """The type hash (`RIHS01_…`) of the messages of a connection, as they are decoded.

    ROS 2 tells definitions of a type apart by it; it takes fields alone, no comment and no constant.

    Source: REP 2011, type version hash.

    Raises:
        UnknownTypeError: No definition of the type is known, or it cannot be hashed.
    """
    if _WIDE.search(connection.definition):  # it is decoded by another text, without what belongs to it alone
        raise UnknownTypeError("the recording's definition of it names wide texts (wstring)")
    name, form, definition = connection.type, connection.definition_format, connection.definition
    if not definition and form in _NO_DEFINITION:
        store = _typestore_for(connection.encoding, name, "", "")
    else:
        _refuse_long(definition)
        with _refusing_definitions():
            store = get_typestore(Stores.EMPTY)
            store.register(_parsed(name, form, definition))
    with _refusing_definitions():
        return str(store.hash_rihs01(name))


def refuse_undecodable(connection: Connection) -> None:
    """Refuse a connection none of whose messages can be decoded, for their encoding or their definition.

    Raises:
        UnknownTypeError: As of `decoder_for`.
    """
    try:
        column_decoder_for(connection)
    except PlanError:
        compiled_store_of(connection)


def is_defined(connection: Connection) -> bool:
    """Whether a recording brings a definition of the messages of a connection."""
    return bool(connection.definition) or connection.definition_format not in _NO_DEFINITION


def compiled_store_of(connection: Connection, unit: str = "") -> Typestore:
    """The type store of a connection, once rosbags has generated its code for the type."""
    store = _store_of(connection, unit)
    with _refusing_definitions():
        store.get_msgdef(connection.type)
    return store


def _store_of(connection: Connection, unit: str = "") -> Typestore:
    if connection.encoding not in ("cdr", "ros1"):
        raise UnknownTypeError(f"its messages are {connection.encoding or 'not'} encoded, not as ROS does")
    return _typestore_for(
        connection.encoding, connection.type, connection.definition_format, connection.definition, unit
    )


@lru_cache(maxsize=128)  # parsing a definition takes longer than reading a small recording
def _typestore_for(
    encoding: str, name: str, definition_format: str, definition: str, unit: str = ""
) -> Typestore:
    """A store that knows a type and what it consists of.

    `Typestore.get_msgdef`, which generates code for eleven ways to pack a message, is not called:
    it takes four times as long as all else here, and columns are decoded without that code.
    """
    if not _TYPE_NAME.fullmatch(name):
        raise UnknownTypeError(f"{name!r} is not the name of a message type")
    if not definition:
        store = bundled_typestore(1 if encoding == "ros1" else 2)
        if name in store.fielddefs:
            return store
        if definition_format in _NO_DEFINITION:
            why = _bundled(1 if encoding == "ros1" else 2)[1].get(name.partition("/")[0], "")
            raise UnknownTypeError(
                "neither the recording nor ariac-score has a definition of this type"
                + (f"; {why}" if why else "")
            )
        # A recorder that names the format of an empty text means a message without fields.
    _refuse_long(definition)
    with _refusing_definitions():
        store = get_typestore(Stores.EMPTY)
        store.max_sequence_length = _LONGEST_SEQUENCE
        types = _types_of(name, definition_format, definition, unit)
        _refuse_long_arrays(types)
        store.register(types)
        return store


def _refuse_long(definition: str) -> None:
    """Refuse a definition that would take too long to parse.

    Raises:
        UnknownTypeError: It has too many lines.
    """
    # Each field ends a line, or in IDL a declaration.
    count = max(definition.count("\n"), definition.count(";"))
    if count > _MOST_LINES:
        raise UnknownTypeError(
            f"the recording's definition of it has {count} lines, {_MOST_LINES} are allowed"
        )


def _refuse_long_arrays(types: Typesdict) -> None:
    """Refuse arrays of a fixed length for which rosbags would write more code than a machine can hold.

    Raises:
        UnknownTypeError: They have too many elements, all types together.
    """
    elements = sum(_unrolled(field) for _, fields in types.values() for _, field in fields)
    if elements > _MOST_UNROLLED:
        raise UnknownTypeError(
            f"arrays of texts or messages in the recording's definition of it have {elements} elements,"
            f" {_MOST_UNROLLED} are allowed"
        )


def _unrolled(field: Any) -> int:
    """Elements of a field for each of which there is code."""
    kind, of = field
    if kind != Nodetype.ARRAY:
        return 0
    (element, name), length = of
    return 0 if element == Nodetype.BASE and name[0] != "string" else max(length, 0)


@contextmanager
def _refusing_definitions() -> Iterator[None]:
    """Refuse a definition that rosbags cannot use, in words."""
    try:
        yield
    except (SerdeError, TypesysError, *UNDECODABLE) as error:
        cause = f"it lacks {error}" if isinstance(error, KeyError) else " ".join(str(error).split())[:200]
        raise UnknownTypeError(f"the recording's definition of it cannot be used: {cause}") from error


def _types_of(name: str, definition_format: str, definition: str, unit: str) -> Typesdict:
    """The types of a definition; its wide texts, if any, as sequences of a type of numbers."""
    if not unit:
        if _WIDE.search(definition):
            raise UnknownTypeError("a wide text (wstring) in it needs all messages to be told how to read it")
        return _parsed(name, definition_format, definition)
    return widened(_parsed(name, definition_format, plain_definition(definition)), unit)


def _parsed(name: str, definition_format: str, definition: str) -> Typesdict:
    if definition_format != "ros2idl":
        # rosbags takes every definition for that of a message.
        of_message = name.replace("/srv/", "/msg/")
        types = get_types_from_msg(event_definition(name, definition), of_message)
        return types if of_message == name else {name: types.pop(of_message), **types}
    types = {}
    for section in definition.split(_IDL_SEPARATOR):
        # rosbag2 puts a line `IDL: package/msg/Name` before each type, which is no IDL.
        head, _, body = section.partition("\n")
        idl = body if head.startswith("IDL: ") else section
        if idl.strip():
            types.update(get_types_from_idl(idl))
    return types
