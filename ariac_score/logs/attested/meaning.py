"""What the bytes of messages mean: whether the log defines them as who published them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from ariac_score.logs.attested.recorded import Found, UnfitError
from ariac_score.logs.columnar.types import UnknownTypeError, is_defined, refuse_undecodable, type_hash_of
from ariac_score.logs.containers.items import Connection, normalised_type

__all__ = ["Meaning", "refuse_other_meaning"]

_TEXT = "sha256:"
"""Of the text of a definition, as a publisher of ROS 1 sends it. The MD5 sum of ROS 1 will not do: it leaves
out that an array of messages is one, so that a list, one message and none have the same."""
_EVENT = "_Event"
"""Of a service; what such a type consists of is not in the definitions of ROS."""


class Meaning(NamedTuple):
    """Of which topics the meaning of the bytes is open.

    Attributes:
        undefined: The recorder could not say how their messages are defined; the first ones never did.
        uncompared: It said so, and the definition in the log has no hash; with the reason.
    """

    undefined: tuple[str, ...]
    uncompared: tuple[tuple[str, str], ...]


def refuse_other_meaning(found: Found, stated: Mapping[str, Any]) -> Meaning:
    """Refuse definitions of messages that are not those of their publishers: they decide what bytes mean."""
    undefined: list[str] = []
    uncompared: list[tuple[str, str]] = []
    for topic, connections in sorted(found.declared.items()):
        block = stated["topics"].get(topic)
        if block is None:
            continue
        received, known = block.get("type") or "", block.get("definitions") or []
        texts = isinstance(received, str) and isinstance(known, list)
        if not texts or not all(isinstance(one, str) for one in known):
            raise UnfitError(f"its manifest does not say of what type the messages on {topic!r} are")
        types = {connection.type for connection in connections}
        if received and (others := sorted(types - {normalised_type(received)})):
            raise UnfitError(f"on {topic!r} it has messages of {others[0]!r}, and its recorder {received!r}")
        if len({connection.encoding for connection in connections}) > 1:
            raise UnfitError(f"it encodes the messages on {topic!r} in two ways")
        by_text = bool(known) and all(one.startswith(_TEXT) for one in known)
        defined = _Defined.by(connections, by_text=by_text)
        other = next((one.encoding for one in connections if one.encoding not in found.encodings), None)
        lacking = defined.unreadable
        if other is not None:
            lacking = f"its messages are {other or 'not'} encoded, and those of the recorder otherwise"
        if not known or any(one.endswith(_EVENT) for one in types):
            undefined += [topic] if "definitions" in block else []
            if len(defined.hashes) > 1:
                raise UnfitError(f"it defines the messages on {topic!r} in two ways")
        elif not (lacking := lacking or defined.uncompared) and not defined.hashes <= {*known}:
            raise UnfitError(f"it defines the messages on {topic!r} otherwise than who published them")
        uncompared += [(topic, lacking)] if lacking else []
    return Meaning(tuple(undefined), tuple(uncompared))


class _Defined(NamedTuple):
    """How a log defines the messages of a topic.

    Attributes:
        hashes: Of its definitions; of their texts where they have none.
        unreadable: Why some cannot be decoded: who makes a topic unreadable has left it out.
        uncompared: Why one cannot be held against what a recorder says of it.
    """

    hashes: set[str]
    unreadable: str
    uncompared: str

    @classmethod
    def by(cls, connections: Iterable[Connection], *, by_text: bool) -> _Defined:
        """What connections define, by the texts or by the type hashes of their definitions."""
        hashes, unreadable, uncompared = set(), "", ""
        for one in connections:
            text = f"{_TEXT}{hashlib.sha256(one.definition.encode('utf-8')).hexdigest()}"
            try:
                refuse_undecodable(one)
            except UnknownTypeError as cause:
                hashes.add(text)
                unreadable = str(cause)
                continue
            try:
                hashes.add(text if by_text else type_hash_of(one))
                uncompared = uncompared or _unlike_its_publisher(one, by_text=by_text)
            except UnknownTypeError as cause:
                hashes.add(text)
                uncompared = str(cause)
        return cls(hashes, unreadable, uncompared)


def _unlike_its_publisher(connection: Connection, *, by_text: bool) -> str:
    """Why a definition cannot be that of a publisher, whatever its hash is; empty where it can."""
    if not is_defined(connection):
        return "the recording has no definition of it"
    if by_text and (connection.encoding, connection.definition_format) != ("ros1", "ros1msg"):
        return "its definition is one of ROS 1, and its messages are not read so"
    if by_text and "\ufffd" in connection.definition:
        return "its definition is no text in UTF-8"
    return ""
