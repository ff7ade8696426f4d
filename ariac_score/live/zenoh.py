"""A cell of ROS 2 over Zenoh (rmw_zenoh): `zenoh://ROUTER:PORT?domain=0`.

Source: the design document and the code of rmw_zenoh_cpp: keys, liveliness tokens, attachments.
"""

from __future__ import annotations

import json
import struct
import threading
import time
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple
from urllib.parse import parse_qs, unquote, urlsplit

from ariac_score.errors import LiveError, UsageError
from ariac_score.live.dialled import DialledSource, GoneError, host_and_port
from ariac_score.live.source import Lost
from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.logs.containers.items import Connection

if TYPE_CHECKING:
    import zenoh as library

__all__ = ["Attachment", "Key", "ZenohSource", "attachment_of", "key_of"]

_PORT = 7447
_LOOK_S = 0.2
_CLOSE_S = 10.0
_END_S = 15.0
"""A thread that is inside the library when Python ends aborts the program, so it is waited for: the library
gives up an attempt to connect, and one to close, within 10 s."""
_MOST_DOMAIN = 232
_USAGE = "give zenoh://HOST:PORT of the router (7447 by default), with ?domain=N for another ROS_DOMAIN_ID"
_DDS = "::dds_::"
_TRANSIENT_LOCAL = "1"
_UNTYPED = "TypeHashNotSupported"
"""What Humble sends instead of a hash."""
_SHORT = struct.Struct("<qqB16s")


class Key(NamedTuple):
    """What the key of a message says: topic, `package/msg/Name`, and the hash of the definition."""

    topic: str
    type: str
    hash: str


class Attachment(NamedTuple):
    """What a publisher attaches: its number of the message, its time of sending, its identity."""

    sequence: int
    sent_ns: int
    gid: str


@dataclass
class _Session:
    """One connection to a router."""

    session: library.Session
    subscribers: list[Any] = field(default_factory=list)
    latched: set[str] = field(default_factory=set)


class ZenohSource(DialledSource):
    """Subscribes at a Zenoh router, through which the nodes of rmw_zenoh find each other.

    Publishers number their messages, so what is lost between two of them shows. Definitions are not sent:
    those of this program are used, where their hash is the publisher's.
    """

    sees_losses = True
    end_s = _END_S

    def __init__(self, address: str) -> None:
        super().__init__(address)
        self._host, self._port = host_and_port(address, _PORT, _USAGE)
        parts = urlsplit(address)
        self._login = unquote(parts.username or ""), unquote(parts.password or "")
        (text,) = parse_qs(parts.query).get("domain", ["0"])[-1:]
        if not text.isdecimal() or int(text) > _MOST_DOMAIN:
            raise UsageError(f"{text!r} is no domain", hint=_USAGE)
        self._domain = int(text)
        self._lock = threading.Lock()
        self._known: dict[tuple[Key, str], Connection] = {}
        self._last: dict[tuple[str, str], tuple[int, int]] = {}

    def dial(self) -> _Session:
        """Connect to the router, and subscribe."""
        try:
            import zenoh  # noqa: PLC0415  # not everybody has it
            import zenoh.ext  # noqa: PLC0415
        except ImportError as missing:
            hint = "pip install 'ariac-score[zenoh]'"
            raise UsageError("the library 'eclipse-zenoh' is not installed", hint=hint) from missing
        try:
            opened = zenoh.open(self._config(zenoh.Config()))
        except zenoh.ZError:
            raise LiveError(
                f"{self._host}:{self._port}: no Zenoh router lets this program in",
                hint="is one (rmw_zenohd) running there, and are user and password right?",
            ) from None
        session = _Session(opened)
        self.server = str(next(iter(opened.info.routers_zid()), ""))
        tokens = opened.liveliness().declare_subscriber(
            f"@ros2_lv/{self._domain}/**", lambda sample: self._token(session, sample), history=True
        )
        session.subscribers.append(tokens)
        plain = {"**"} if self.topics is None else {f"{t.strip('/')}/*/*" for t in self.topics if t}
        for topic in sorted(plain):
            session.subscribers.append(
                zenoh.ext.declare_advanced_subscriber(
                    opened,
                    f"{self._domain}/{topic}",
                    lambda sample: self._sample(session, sample),
                    history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
                )
            )
        return session

    def listen(self, session: _Session) -> None:
        """Wait until the router is gone; messages come on threads of the library."""
        while not self.closing.wait(_LOOK_S):
            if not session.session.info.routers_zid():
                raise GoneError("the router does not answer")

    def hang_up(self, session: _Session) -> None:
        """Close the session; where its router is gone, the library may take its time over it."""
        closing = threading.Thread(target=session.session.close, daemon=True)
        closing.start()
        closing.join(_CLOSE_S)

    def _config(self, config: library.Config) -> library.Config:
        name = f"[{self._host}]" if ":" in self._host else self._host
        for key, value in {
            "mode": "client",
            "connect/endpoints": [f"tcp/{name}:{self._port}"],
            "connect/timeout_ms": 3000,
            "scouting/multicast/enabled": False,
        }.items():
            config.insert_json5(key, json.dumps(value))
        if self._login[0]:
            for key, text in zip(("user", "password"), self._login, strict=True):
                config.insert_json5(f"transport/auth/usrpwd/{key}", json.dumps(text))
        return config

    def _token(self, session: _Session, sample: library.Sample) -> None:
        """Learn from a publisher's token whether it keeps its last messages for those who come late."""
        chunks = str(sample.key_expr).split("/")
        if len(chunks) == 13 and chunks[5] == "MP" and chunks[12].split(":")[1:2] == [_TRANSIENT_LOCAL]:
            session.latched.add(chunks[9].replace("%", "/"))

    def _sample(self, session: _Session, sample: library.Sample) -> None:
        stamp_ns = time.time_ns()
        key = key_of(str(sample.key_expr))
        if key is None or not self.wants(key.topic):
            return
        raw = sample.attachment
        told = attachment_of(b"" if raw is None else raw.to_bytes())
        payload = sample.payload.to_bytes()
        with self._lock:  # each subscriber may have a thread of its own
            self._heard_ns = stamp_ns
            connection = self._connection(session, key, told)
            if told is None:
                self.received(connection, payload, stamp_ns, None)
                return
            last, since_ns = self._last.get((key.topic, told.gid), (told.sequence - 1, stamp_ns))
            if told.sequence <= last:
                return  # it was kept for those who come late, and is here already
            if (count := told.sequence - last - 1) > 0:
                words = f"numbers {last + 1} to {told.sequence - 1} of its publisher are missing"
                self.put(Lost(key.topic, since_ns, stamp_ns, words, count))
            self._last[key.topic, told.gid] = told.sequence, stamp_ns
            self.received(connection, payload, stamp_ns, told.sent_ns, told.sequence)

    def _connection(self, session: _Session, key: Key, told: Attachment | None) -> Connection:
        gid = "" if told is None else told.gid
        if (key, gid) not in self._known:
            self.channels.forget()
            encoding, definition = _definition(key.type, key.hash)
            self._known[key, gid] = self.channels.announce(
                key.topic,
                key.type,
                encoding,
                definition,
                "ros2msg",
                publisher=gid,
                latched=key.topic in session.latched,
                sees_losses=told is not None,
            )
        return self._known[key, gid]


def key_of(text: str) -> Key | None:
    """What the key of a message says; `None` where it is not one of rmw_zenoh.

    >>> key_of("0/arm/state/std_msgs::msg::dds_::String_/RIHS01_df66")
    Key(topic='/arm/state', type='std_msgs/msg/String', hash='RIHS01_df66')
    """
    domain, *topic, type_, hash_ = text.split("/") if text.count("/") > 2 else ("", "", "")
    package, dds, name = type_.partition(_DDS)
    if not domain or not topic or not dds or not name.endswith("_"):
        return None
    return Key("/" + "/".join(topic), f"{package.replace('::', '/')}/{name[:-1]}", hash_)


def attachment_of(raw: bytes) -> Attachment | None:
    """What is attached to a message, in the layout of today or in the one before rmw_zenoh 0.2.4.

    >>> attachment_of(bytes(7)) is None
    True
    """
    if len(raw) == _SHORT.size:
        sequence, sent_ns, length, gid = _SHORT.unpack(raw)
        return Attachment(sequence, sent_ns, gid.hex()) if length == 16 else None
    found, at = dict[str, bytes](), 0
    for name, size in (("sequence_number", 8), ("source_timestamp", 8), ("source_gid", 17)):
        end = at + 1 + len(name)
        if raw[at + 1 : end] != name.encode() or len(raw) < end + size:
            return None
        found[name], at = raw[end : end + size], end + size
    sequence, sent_ns = (int.from_bytes(found[n], "little", signed=True) for n in list(found)[:2])
    return Attachment(sequence, sent_ns, found["source_gid"][1:].hex())


@lru_cache(maxsize=1024)
def _definition(type_: str, hash_: str) -> tuple[str, str]:
    """The encoding and the definition of a type, if the known one has this hash.

    Messages of another definition may decode to wrong numbers, so they are not decoded at all.
    """
    store = bundled_typestore(2)
    if type_ not in store.fielddefs:
        return "cdr", ""
    if hash_ not in (store.hash_rihs01(type_), _UNTYPED):
        return f"cdr of another definition ({hash_[:19]}…) than the known one", ""
    return "cdr", store.generate_msgdef(type_, ros_version=2)[0]
