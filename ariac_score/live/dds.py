"""A cell of ROS 2 over DDS itself: `dds://HOST?domain=0`, for Fast DDS and Cyclone DDS.

Source: design.ros2.org (mapping of topics and types to DDS), OMG DDSI-RTPS 2.5, the manual of Cyclone DDS.
"""

from __future__ import annotations

import os
import threading
import time
from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Any
from urllib.parse import parse_qs, urlsplit

from ariac_score.errors import LiveError, UsageError
from ariac_score.live.dialled import DialledSource, GoneError, host_and_port
from ariac_score.live.source import Lost
from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.logs.containers.items import Connection

if TYPE_CHECKING:
    from cyclonedds.builtin import DcpsEndpoint
    from cyclonedds.sub import DataReader

__all__ = ["DdsSource", "struct_of"]

_MULTICAST = "239.255.0.1"
"""DDS's own group for finding each other: as a host it stands for the whole network."""
_MOST_DOMAIN = 232
_MOST_PARTICIPANTS = 32
"""Of one host that is asked directly, as ROS 2 has it."""
_FOUND_S = 10.0
"""How long nodes may take to be found, s."""
_LOOK_S = 0.1
_HELD = 10_000
"""So many messages of a topic wait at most; none is refused, or the cell's publishers would wait for us."""
_TAKEN = 256
_USAGE = f"give dds://HOST, or dds://{_MULTICAST} for all hosts, with ?domain=N for another ROS_DOMAIN_ID"
_DDS = "::dds_::"
_TOPIC = "rt/"
_ALIVE = 16
_NUMBERS = {"byte": "uint8", "char": "uint8", "octet": "uint8"}
"""What is an integer of 8 bits in CDR, whatever it is called."""

_Kind = tuple[str, str, bool, bool]
"""Topic of DDS, type of ROS, whether reliable, whether latched."""


@dataclass
class _Session:
    """A participant of its own in the cell's domain, and whom it hears."""

    domain: Any
    participant: Any
    waitset: Any
    found: Any
    """Reads which publishers there are."""
    readers: dict[_Kind, tuple[DataReader[Any], Any]] = field(default_factory=dict)
    writers: dict[Any, tuple[_Kind | None, Connection | None]] = field(default_factory=dict)
    """By identity, all that are there; without a connection those that are not heard."""
    of_handle: dict[tuple[int, int], Connection | None] = field(default_factory=dict)
    over: threading.Event = field(default_factory=threading.Event)

    def leave(self) -> None:
        """Take part no more; of the thread that listens."""
        # At once, with all that belongs to it: the library itself waits for the garbage collector.
        for entity in (self.participant, self.domain):
            if entity is not None:
                entity.__del__()
        self.readers.clear()


class DdsSource(DialledSource):
    """Takes part in the DDS of ROS 2 as one more subscriber, and hears the bytes of messages as they are.

    The readers of a topic ask for what its publisher offers: of one that is reliable the network loses
    nothing. Of others, and of what a publisher's own history drops, the library says nothing: losses are not
    seen. Definitions are not sent: those of this program are used, and where a publisher states the hash of
    its own, it must be that of the known one.
    """

    sees_losses = False

    def __init__(self, address: str) -> None:
        super().__init__(address)
        self._host, port = host_and_port(address, 0, _USAGE)
        given = parse_qs(urlsplit(address).query)
        try:
            self._domain = int((given.pop("domain", None) or ["0"])[0])
        except ValueError:
            self._domain = -1
        if port or given or not 0 <= self._domain <= _MOST_DOMAIN:
            raise UsageError(f"{self.address!r} with a port, or with options other than domain", hint=_USAGE)

    def dial(self) -> _Session:
        """Take part in the domain, and wait until anybody is there."""
        session = self._joined()
        end_s = time.monotonic() + _FOUND_S
        while not session.writers:
            if time.monotonic() > end_s or self.closing.wait(_LOOK_S / 2):
                session.leave()
                raise LiveError(
                    f"{self.address}: nobody publishes a topic of ROS 2 in domain {self._domain}",
                    hint="is the cell running, does it let this host in (ROS_AUTOMATIC_DISCOVERY_RANGE), "
                    "and is the ROS_DOMAIN_ID right?",
                )
            self._follow(session)
        return session

    def listen(self, session: _Session) -> None:
        """Take messages until every publisher has gone."""
        from cyclonedds.util import duration  # noqa: PLC0415

        look_s = duration(seconds=_LOOK_S)
        try:
            while not self.closing.is_set() and not session.over.is_set():
                session.waitset.wait(look_s)
                stamp_ns = time.time_ns()
                self._follow(session)
                for reader, condition in list(session.readers.values()):
                    while samples := reader.take(_TAKEN, condition):
                        self._take(session, reader, samples, stamp_ns)
                        stamp_ns = time.time_ns()
                if not session.writers:
                    raise GoneError("every publisher is gone")
        finally:
            session.leave()

    def hang_up(self, session: _Session) -> None:
        """Have the thread that listens leave."""
        session.over.set()

    def _joined(self) -> _Session:
        try:
            from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication  # noqa: PLC0415
            from cyclonedds.core import (  # noqa: PLC0415  # not everybody has it
                DDSException,
                InstanceState,
                ReadCondition,
                SampleState,
                ViewState,
                WaitSet,
            )
            from cyclonedds.domain import Domain, DomainParticipant  # noqa: PLC0415
        except ImportError as missing:
            hint = "pip install 'ariac-score[dds]'"
            raise UsageError("the library 'cyclonedds' is not installed", hint=hint) from missing
        try:
            # Who has set the library's own configuration knows the network better than an address tells.
            own = "CYCLONEDDS_URI" not in os.environ
            domain = Domain(self._domain, _config(self._host)) if own else None
            participant = DomainParticipant(self._domain)
            found = BuiltinDataReader(participant, BuiltinTopicDcpsPublication)
            waitset = WaitSet(participant)
            waitset.attach(ReadCondition(found, SampleState.NotRead | ViewState.Any | InstanceState.Any))
        except DDSException as error:
            raise LiveError(f"{self.address}: {error}", hint=_USAGE) from None
        return _Session(domain, participant, waitset, found)

    def _follow(self, session: _Session) -> None:
        """Learn which publishers there are by now, and hear those of topics that were asked for."""
        for one in session.found.take(_TAKEN):
            if one.sample_info.instance_state != _ALIVE:
                session.writers.pop(one.key, None)
            elif one.key not in session.writers and one.topic_name.startswith(_TOPIC):
                session.writers[one.key] = self._heard_of(session, one)

    def _heard_of(self, session: _Session, writer: DcpsEndpoint) -> tuple[_Kind | None, Connection | None]:
        from cyclonedds.qos import Policy  # noqa: PLC0415

        topic = writer.topic_name[len(_TOPIC) - 1 :]
        if not self.wants(topic):
            return None, None
        package, dds, name = writer.type_name.partition(_DDS)
        type_ = f"{package.replace('::', '/')}/{name[:-1]}"
        store = bundled_typestore(2)
        why = ""
        if not dds or type_ not in store.fielddefs:
            why = f"nobody here knows the definition of {writer.type_name}"
        elif (stated := _hash_of(writer)) not in ("", store.hash_rihs01(type_)):
            why = f"its definition of {type_} ({stated[:19]}…) is not the one known here"
        else:
            try:
                _class_of(type_)
            except ValueError as error:
                why = str(error)
        if why:
            now_ns = time.time_ns()
            self.put(Lost(topic, now_ns, now_ns, f"a publisher is not heard: {why}"))
            return None, None
        durability, reliability = writer.qos[Policy.Durability], writer.qos[Policy.Reliability]
        latched = durability is not None and durability != Policy.Durability.Volatile
        reliable = isinstance(reliability, Policy.Reliability.Reliable)
        kind = writer.topic_name, type_, reliable, latched
        if kind not in session.readers:
            session.readers[kind] = self._reader(session, kind)
        definition = store.generate_msgdef(type_, ros_version=2)[0]
        # A publisher that was started again has another identity, and goes on where the one before was.
        connection = self.channels.announce(topic, type_, "cdr", definition, "ros2msg", latched=latched)
        return kind, connection

    def _reader(self, session: _Session, kind: _Kind) -> tuple[DataReader[Any], Any]:
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState  # noqa: PLC0415
        from cyclonedds.qos import Policy, Qos  # noqa: PLC0415
        from cyclonedds.sub import DataReader  # noqa: PLC0415
        from cyclonedds.topic import Topic  # noqa: PLC0415

        name, type_, reliable, latched = kind
        qos = Qos(
            Policy.Reliability.Reliable(0) if reliable else Policy.Reliability.BestEffort,
            Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
            Policy.History.KeepLast(_HELD),
        )
        reader = DataReader(session.participant, Topic(session.participant, name, _class_of(type_)), qos)
        condition = ReadCondition(reader, SampleState.Any | ViewState.Any | InstanceState.Any)
        session.waitset.attach(condition)
        return reader, condition

    def _take(self, session: _Session, reader: DataReader[Any], samples: list[Any], stamp_ns: int) -> None:
        for sample in samples:
            payload = getattr(sample, "payload", None)
            if payload is None:  # that a publisher has gone
                continue
            self._heard_ns = stamp_ns
            info = sample.sample_info
            key = id(reader), info.publication_handle
            if key not in session.of_handle:
                session.of_handle[key] = self._connection_of(session, reader, info.publication_handle)
            if (connection := session.of_handle[key]) is not None:
                self.received(connection, payload, stamp_ns, info.source_timestamp or None)

    def _connection_of(self, session: _Session, reader: DataReader[Any], handle: int) -> Connection | None:
        """Whose messages they are; `None` where another reader of the topic is the one that hears them."""
        writer = reader.get_matched_publication_data(handle)
        kind, connection = session.writers.get(writer.key, (None, None)) if writer else (None, None)
        mine = kind is not None and session.readers[kind][0] is reader
        return connection if mine else None


def _config(host: str) -> str:
    """How the library finds the cell: directly, or by multicast; this host alone where it is asked alone.

    Its own ports are open on every interface all the same: it has no setting for that.
    """
    alone = host in ("127.0.0.1", "localhost", "::1")
    interfaces = '<Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>' if alone else ""
    multicast = host == _MULTICAST
    peers = "" if multicast else f'<Peers><Peer address="{"127.0.0.1" if alone else host}"/></Peers>'
    return (
        f"<CycloneDDS><Domain><General>{interfaces}"
        f"<AllowMulticast>{'true' if multicast else 'false'}</AllowMulticast></General>"
        f"<Discovery><ParticipantIndex>auto</ParticipantIndex>{peers}"
        f"<MaxAutoParticipantIndex>{_MOST_PARTICIPANTS}</MaxAutoParticipantIndex></Discovery>"
        "</Domain></CycloneDDS>"
    )


def _hash_of(writer: DcpsEndpoint) -> str:
    """The hash of its definition that a publisher states; empty: none, as before ROS 2 Iron."""
    from cyclonedds.qos import Policy  # noqa: PLC0415

    policy = writer.qos[Policy.Userdata]
    stated = b"" if policy is None else policy.data
    for part in bytes(stated).split(b";"):
        name, _, value = part.partition(b"=")
        if name == b"typehash":
            return value.decode("ascii", errors="replace")
    return ""


@cache
def _class_of(type_: str) -> Any:
    """A type of ROS as the library wants it; its values keep the bytes they came as.

    Raises:
        ValueError: The library has no such type.
    """
    made = struct_of(type_)

    class Raw:
        """The bytes of a message, as they came."""

        __slots__ = ("payload", "sample_info")

        def __init__(self, payload: bytes) -> None:
            self.payload, self.sample_info = payload, None

    made.deserialize = classmethod(lambda _, data, *_args, **_options: Raw(bytes(data)))
    return made


@cache
def struct_of(type_: str) -> Any:
    """A type of ROS, such as `std_msgs/msg/String`, as the library has types.

    Raises:
        ValueError: The library has no such type.
    """
    from cyclonedds import idl  # noqa: PLC0415

    package, _, name = type_.rpartition("/")
    fields = {field: _field(*node) for field, node in bundled_typestore(2).fielddefs[type_][1]}
    return idl.make_idl_struct(f"{name}_", f"{package.replace('/', '::')}{_DDS}{name}_", fields)


def _field(kind: Any, about: Any) -> Any:
    from cyclonedds.idl import types  # noqa: PLC0415

    if kind.name == "NAME":
        return struct_of(about)
    if kind.name == "BASE":
        name, bound = about
        if name == "string":
            return types.bounded_str[bound] if bound else str
        if name == "bool":
            return bool
        if (found := getattr(types, _NUMBERS.get(name, name), None)) is None or name == "wstring":
            raise ValueError(f"a field of type {name} cannot be heard over DDS")
        return found
    element, size = about
    if kind.name == "ARRAY":
        return types.array[_field(*element), size]
    return types.sequence[_field(*element), size] if size else types.sequence[_field(*element)]
