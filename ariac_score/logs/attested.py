"""Holding a recording against what its recorder attests: its heartbeats and manifest."""

from __future__ import annotations

import base64
import hashlib
import math
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from ariac_score.documents.schema import strict_json
from ariac_score.errors import LogError
from ariac_score.logs.columnar.types import (
    Decode,
    UnknownTypeError,
    decoder_for,
    is_defined,
    refuse_undecodable,
    type_hash_of,
)
from ariac_score.logs.containers.detect import open_scan
from ariac_score.logs.containers.items import Batch, Connection, Message, normalised_type, with_slash
from ariac_score.logs.gather.clocks import CLOCK_TOPIC, CLOCK_TYPE
from ariac_score.trial.attestation import Attestation, Lacking, Unheard
from ariac_score.trial.spans import Span

__all__ = ["HEARTBEAT", "MANIFEST", "attestation_of", "digest_of"]

HEARTBEAT, MANIFEST = "/ariac_score/heartbeat", "/ariac_score/manifest"
FORMAT = "ariac-score-manifest/1"
_DIGEST_CHARS = 16
_DIGEST_BYTES = 12
LATE_NS = 10**9
"""A message reaches recorder and log at most so far apart; what lies further off was moved."""
LATE_BESIDE_PAUSES_NS = 250_000_000
"""The same, where the recorder's own clock shows its pauses: so much besides the longest of them. On a loaded
machine of two cores, messages of a real `rosbag record` came up to 90 ms late."""
CONNECTING_NS = 5 * 10**9
"""So much sooner may the one hear a publisher than the other: on a loaded machine it was up to 1.4 s."""
_CLOCKS = ("wall_ns", "ros_ns")


class _UnfitError(Exception):
    """What the recorder says does not fit together; the text says where."""


class _Beat(NamedTuple):
    """A heartbeat as it was recorded."""

    sequence: int
    recording: str
    body: str
    chain: str


class _Manifest(NamedTuple):
    """A manifest as it was recorded."""

    closed: bool
    recording: str
    body: str
    signature: str


@dataclass
class _Found:
    """What a recording holds: heartbeats and manifests in recorded order, digests of all other messages.

    Attributes:
        unfit: What its recorder published and nobody can read, in words; empty where all can be read.
        encodings: How the messages of the recorder are encoded.
        clock: Log time and time of each message of `/clock`, ns.
        declared: The connections of each topic.
    """

    heartbeats: list[tuple[int, _Beat]] = field(default_factory=list)
    manifests: list[_Manifest] = field(default_factory=list)
    unfit: str = ""
    encodings: set[str] = field(default_factory=set)
    clock: list[tuple[int, int]] = field(default_factory=list)
    declared: dict[str, dict[Connection, None]] = field(default_factory=lambda: defaultdict(dict))
    digests: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    logged: dict[str, list[_Logged]] = field(default_factory=lambda: defaultdict(list))


class _Logged(NamedTuple):
    """A message of the log: when, what, through whose connection, and from whom, where the log says it.

    A printed line names its node itself; a connection's name for it can be changed without the bytes.
    """

    t_ns: int
    digest: str
    publisher: str
    node: str


@dataclass
class _Matched:
    """Which messages of one topic are in the list of the recorder and in the log; which in one of them alone.

    Attributes:
        both: In the log and listed.
        extra: In the log alone.
        gone: Listed alone, with the heartbeats between which each arrived.
    """

    both: list[_Logged] = field(default_factory=list)
    extra: list[_Logged] = field(default_factory=list)
    gone: list[tuple[Span, str]] = field(default_factory=list)

    def moved(self) -> Counter[str]:
        """The messages that lie elsewhere in the log than where they were received."""
        return Counter(one.digest for one in self.extra) & Counter(digest for _, digest in self.gone)

    def early(self) -> list[_Logged]:
        """What the log heard of a publisher before the recorder did: two subscribers never begin at once."""
        first_ns: dict[str, int] = {}
        for one in self.both:
            first_ns[one.publisher] = min(one.t_ns, first_ns.get(one.publisher, one.t_ns))
        return [
            one
            for one in self.extra
            if one.publisher in first_ns and 0 < first_ns[one.publisher] - one.t_ns <= CONNECTING_NS
        ]

    def late(self, origin_ns: int) -> list[tuple[Span, str]]:
        """What the recorder heard of a topic before the log did, and the log has later, in the same bytes."""
        if not self.both:
            return []
        first_s = (min(one.t_ns for one in self.both) - origin_ns) / 1e9
        known = {one.digest for one in self.both}
        return [
            (span, digest)
            for span, digest in self.gone
            if digest in known and first_s - CONNECTING_NS / 1e9 <= span.start_s <= first_s
        ]


def attestation_of(path: Path, origin_ns: int) -> Attestation:
    """What the recorder of a recording attests.

    Args:
        path: The recording.
        origin_ns: Log time at trial time 0.

    Raises:
        LogError: It cannot be read.
    """
    found = _scanned(path)
    closed = [manifest for manifest in found.manifests if manifest.closed]
    manifest = closed[-1] if closed else None
    try:
        if found.unfit:
            raise _UnfitError(found.unfit)
        if manifest is None:
            raise _UnfitError(
                "its recorder did not close its manifest: it, or the bag before it, was stopped"
            )
        return _held_against(found, manifest, origin_ns)
    except _UnfitError as unfit:
        return Attestation(
            str(unfit),
            body="" if manifest is None else manifest.body,
            signature="" if manifest is None else manifest.signature,
        )


def _scanned(path: Path) -> _Found:
    found = _Found()
    decoders: dict[Connection, Decode] = {}
    for message in _messages(path):
        connection, topic = message.connection, with_slash(message.connection.topic)
        if topic in (HEARTBEAT, MANIFEST):
            decode = decoders.get(connection) or decoders.setdefault(connection, _decoder(connection, path))
            found.encodings.add(connection.encoding)
            try:
                decoded = decode(message.payload)
                if topic == HEARTBEAT:
                    found.heartbeats.append((message.stamp_ns, _told(_Beat, decoded)))
                else:
                    found.manifests.append(_told(_Manifest, decoded))
            except (UnknownTypeError, _UnfitError) as cause:
                what = "heartbeat" if topic == HEARTBEAT else "manifest"
                found.unfit = found.unfit or f"a {what} of its recorder cannot be read: {cause}"
            continue
        found.declared[topic][connection] = None
        if topic == CLOCK_TOPIC and connection.type == CLOCK_TYPE:
            # One that cannot be read is read by nobody else either, and is no reason to refuse the log.
            with suppress(UnknownTypeError, AttributeError, TypeError, ValueError):
                decode = decoders.get(connection) or decoders.setdefault(connection, decoder_for(connection))
                clock = decode(message.payload).clock  # type: ignore[attr-defined]  # rosbags makes the class
                found.clock.append((message.stamp_ns, int(clock.sec) * 10**9 + int(clock.nanosec)))
        digest, node = digest_of(message.payload), connection.publisher
        if node and connection.type == _PRINTED:
            decode = decoders.get(connection) or decoders.setdefault(connection, _decoder(connection, path))
            with suppress(UnknownTypeError):
                node = str(getattr(decode(message.payload), "name", node))
        found.digests[topic][digest] += 1
        found.logged[topic].append(_Logged(message.stamp_ns, digest, connection.publisher, node))
    return found


_PRINTED = "rosgraph_msgs/msg/Log"
_Told = TypeVar("_Told", _Beat, _Manifest)


def _told(kind: type[_Told], message: object) -> _Told:
    """The fields of a message of the recorder.

    Raises:
        _UnfitError: One is missing, or of another type.
    """
    fields = {}
    for name, wanted in {"sequence": int, "closed": bool}.items():
        if name in kind._fields:
            fields[name] = getattr(message, name, None)
            if not isinstance(fields[name], wanted):
                raise _UnfitError(f"its {name!r} is missing, or is no {wanted.__name__}")
    for name in kind._fields:
        if name not in fields:
            fields[name] = getattr(message, name, None)
            if not isinstance(fields[name], str):
                raise _UnfitError(f"its {name!r} is missing, or is no text")
    return kind(**fields)  # type: ignore[arg-type]  # each was looked at


def _messages(path: Path) -> Iterator[Message]:
    for item in open_scan(path, jobs=1):
        if isinstance(item, Message):
            yield item
        elif isinstance(item, Batch):
            yield from item.messages()


def _decoder(connection: Connection, path: Path) -> Decode:
    try:
        return decoder_for(connection)
    except UnknownTypeError as error:
        raise LogError(
            f"a message on {connection.topic!r} cannot be decoded: {error}",
            file=path,
            hint="record it with its message definitions",
        ) from error


def digest_of(payload: bytes | memoryview) -> str:
    """What the recorder lists of a message: 12 bytes of SHA-256, in base64."""
    return base64.b64encode(hashlib.sha256(payload).digest()[:_DIGEST_BYTES]).decode("ascii")


def _held_against(found: _Found, manifest: Any, origin_ns: int) -> Attestation:
    stated = _content(manifest.body, "the manifest")
    _refuse_other_recording(found, manifest, stated)
    beats = _chained(found, manifest.recording, stated)
    listed, spans = _listed(beats, stated, origin_ns)
    _refuse_other_counts(listed, stated)
    late_ns = _late_ns(beats)
    _refuse_moved_heartbeats(beats, late_ns)
    _refuse_other_pace(beats)
    if CLOCK_TOPIC not in listed:
        _refuse_other_clock(found.clock, beats, late_ns)
    meaning = _refuse_other_meaning(found, stated)
    matched = _matched(found, spans, origin_ns, late_ns)
    began_ns = beats[0][0] if beats else 0
    early = {topic: [m for m in one.early() if m.t_ns >= began_ns] for topic, one in matched.items()}
    lacking, unheard = [], []
    for topic, digests in sorted(listed.items()):
        missing = digests - found.digests.get(topic, Counter())
        late = [one for one in matched[topic].late(origin_ns) if missing[one[1]]] if topic in matched else []
        late = _at_most(late, missing)
        unheard += [Lacking(topic, len(late), _around([span for span, _ in late]))] if late else []
        if missing := missing - Counter(digest for _, digest in late):
            span = _around([span for digest in missing for span in spans[topic, digest]])
            logged = found.logged.get(topic, ())
            logged_s = min(((one.t_ns - origin_ns) / 1e9 for one in logged), default=math.inf)
            arrived = (sorted(spans[topic, digest])[:n] for digest, n in missing.items())
            lacking.append(
                Lacking(
                    topic,
                    missing.total(),
                    span,
                    all=topic not in found.digests,
                    publishers=_less_from(matched.get(topic), stated["topics"][topic]),
                    within=sum(one.start_s >= logged_s for every in arrived for one in every),
                )
            )
    lost, unlisted = _lost(stated), dict(_unlisted(found, listed, beats, early))
    for topic in sorted(matched.keys() & listed.keys()):
        _refuse_joined_publishers(topic, found.logged[topic], listed[topic], stated["topics"][topic])
    if beats:  # what neither the recorder nor the log has was sent all the same
        whole = _around([span for every in spans.values() for span in every] or [Span(0.0, 0.0)])
        gone = {topic: n - unlisted.get(topic, 0) - len(early.get(topic, ())) for topic, n in lost.items()}
        lacking += [Lacking(topic, n, whole, within=n) for topic, n in sorted(gone.items()) if n > 0]
    return Attestation(
        lacking=tuple(lacking),
        late=tuple(unheard),
        early=frozenset(Unheard(topic, *one[:3]) for topic in early for one in early[topic]),
        unlisted=tuple(unlisted.items()),
        put_in=tuple(_unlisted(found, listed, beats, early, lost)),
        moved=tuple((topic, n) for topic, one in matched.items() if (n := one.moved().total())),
        moved_by_s=late_ns / 1e9,
        unattested=tuple(sorted(found.digests.keys() - listed.keys())),
        body=manifest.body,
        signature=manifest.signature,
        undefined=meaning.undefined,
        uncompared=meaning.uncompared,
        listened=_listened(beats, origin_ns),
        notes=_notes(stated),
        trial=_name(stated, "trial"),
        team=_name(stated, "team"),
    )


def _listened(beats: list[tuple[int, Mapping[str, Any]]], origin_ns: int) -> Span | None:
    at_s = [(stamp_ns - origin_ns) / 1e9 for stamp_ns, _ in beats]
    return Span(min(at_s), max(at_s)) if at_s else None


def _notes(stated: Mapping[str, Any]) -> tuple[str, ...]:
    notes = stated.get("notes", [])
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        raise _UnfitError("what its manifest notes is no list of texts")
    return tuple(notes)


def _name(stated: Mapping[str, Any], key: str) -> str:
    name = stated.get(key, "")
    if not isinstance(name, str):
        raise _UnfitError(f"what its manifest gives as {key!r} is no text")
    return name


def _content(body: str, what: str) -> Any:
    try:
        content = strict_json(body)
    except (ValueError, RecursionError) as cause:
        raise _UnfitError(f"{what} is no JSON: {cause}") from None
    if not isinstance(content, dict):
        raise _UnfitError(f"{what} is no mapping")
    return content


def _refuse_other_recording(found: _Found, manifest: Any, stated: Mapping[str, Any]) -> None:
    if stated.get("format") != FORMAT:
        raise _UnfitError(f"its manifest has the format {stated.get('format')!r}, not {FORMAT!r}")
    names = {beat.recording for _, beat in found.heartbeats} | {m.recording for m in found.manifests}
    if stated.get("recording") != manifest.recording or names != {manifest.recording}:
        others = sorted(names - {manifest.recording})
        words = f"recording {others[0]!r} is in it as well" if others else "it states another recording"
        raise _UnfitError(f"its manifest is of recording {manifest.recording!r}, and {words}")


def _chained(found: _Found, recording: str, stated: Mapping[str, Any]) -> list[tuple[int, Mapping[str, Any]]]:
    """The heartbeats in order, with their log times; each chain follows from the one before."""
    beats, chain = [], recording
    for number, (stamp_ns, beat) in enumerate(sorted(found.heartbeats, key=lambda b: b[1].sequence), start=1):
        if beat.sequence != number:
            raise _UnfitError(f"heartbeat {number} of its recorder is missing, or there twice")
        chain = hashlib.sha256((chain + beat.body).encode("utf-8")).hexdigest()
        content = _content(beat.body, f"heartbeat {number}")
        if (beat.chain, content.get("sequence"), content.get("recording")) != (chain, number, recording):
            raise _UnfitError(f"the chain of its recorder breaks at heartbeat {number}")
        beats.append((stamp_ns, content))
    last = stated.get("heartbeats")
    if not isinstance(last, dict) or (last.get("count"), last.get("chain")) != (len(beats), chain):
        raise _UnfitError("the chain of its heartbeats does not end as its manifest says")
    return beats


def _listed(
    beats: list[tuple[int, Mapping[str, Any]]], stated: Mapping[str, Any], origin_ns: int
) -> tuple[dict[str, Counter[str]], dict[tuple[str, str], list[Span]]]:
    """The digests of every topic that was listened to, and between which heartbeats each arrived."""
    topics = stated.get("topics")
    if not isinstance(topics, dict):
        raise _UnfitError("its manifest lists no topics")
    listed: dict[str, Counter[str]] = {topic: Counter() for topic in topics}
    spans: dict[tuple[str, str], list[Span]] = defaultdict(list)
    before_s = None
    for number, (stamp_ns, content) in enumerate(beats, start=1):
        at_s = (stamp_ns - origin_ns) / 1e9
        span = Span(at_s if before_s is None else min(at_s, before_s), at_s)
        arrived = content.get("topics")
        if not isinstance(arrived, dict):
            raise _UnfitError(f"heartbeat {number} of its recorder has no topics")
        for topic, block in arrived.items():
            if topic not in listed or not isinstance(block, dict):
                raise _UnfitError(f"heartbeat {number} lists {topic!r}, and its manifest does not")
            text, first = block.get("digests"), block.get("first")
            if not isinstance(text, str) or len(text) % _DIGEST_CHARS or first != listed[topic].total() + 1:
                raise _UnfitError(f"heartbeat {number} does not count on from the one before on {topic!r}")
            for start in range(0, len(text), _DIGEST_CHARS):
                digest = text[start : start + _DIGEST_CHARS]
                listed[topic][digest] += 1
                spans[topic, digest].append(span)
        before_s = at_s
    return listed, spans


def _refuse_other_counts(listed: Mapping[str, Counter[str]], stated: Mapping[str, Any]) -> None:
    for topic, block in stated["topics"].items():
        if not isinstance(block, dict) or block.get("count") != listed[topic].total():
            raise _UnfitError(f"its manifest and its heartbeats count other messages on {topic!r}")


def _sent_ns(beat: Mapping[str, Any], clock: str) -> int | None:
    """When a heartbeat was sent, by a clock; `None` where it does not tell.

    Raises:
        _UnfitError: It tells a time beyond the year 2262.
    """
    sent = beat.get(clock)
    if not isinstance(sent, int):
        return None
    if not 0 <= sent < 1 << 63:
        raise _UnfitError(f"heartbeat {beat.get('sequence')} was sent at no time, by its {clock!r}")
    return sent


def _by_its_clock(beats: list[tuple[int, Mapping[str, Any]]]) -> tuple[int, list[int]]:
    """Of the two clocks of the heartbeats the one that the log goes by: how unequally late the log has them
    by it, and when they were sent, ns; 0 and nothing where they tell no time."""
    found = []
    for clock in _CLOCKS:
        told = [(stamp_ns, sent) for stamp_ns, beat in beats if (sent := _sent_ns(beat, clock)) is not None]
        if told:
            late = [stamp_ns - sent for stamp_ns, sent in told]
            found.append((max(late) - min(late), [sent for _, sent in told]))
    return min(found, default=(0, []))


def _late_ns(beats: list[tuple[int, Mapping[str, Any]]]) -> int:
    """How far apart a message reaches recorder and log at most, from the times at which heartbeats were sent.

    Those are part of the chain. The log's own times are not, and who moves messages moves these, too.
    """
    _, sent = _by_its_clock(beats)
    if len(sent) < 2:
        return LATE_NS
    return min(LATE_NS, LATE_BESIDE_PAUSES_NS + max(after - before for before, after in pairwise(sent)))


def _refuse_moved_heartbeats(beats: list[tuple[int, Mapping[str, Any]]], late_ns: int) -> None:
    """Refuse heartbeats that the log has at other times than they were sent at, by the clock it goes by."""
    spread, _ = _by_its_clock(beats)
    if spread > late_ns:
        raise _UnfitError(f"its heartbeats were moved, by up to {spread / 1e9:.1f} s")


def _refuse_other_pace(beats: list[tuple[int, Mapping[str, Any]]]) -> None:
    """Refuse a log by the wall clock of a simulation at another pace, which only `/clock` would show."""
    late = [stamp_ns - sent for stamp_ns, beat in beats if (sent := _sent_ns(beat, "ros_ns")) is not None]
    apart_ns = max(late, default=0) - min(late, default=0)
    if apart_ns > LATE_NS:
        raise _UnfitError(
            f"its times are not those of the simulation, from which they go {apart_ns / 1e9:.1f} s apart "
            "between its heartbeats"
        )


def _refuse_other_clock(
    clock: Sequence[tuple[int, int]], beats: list[tuple[int, Mapping[str, Any]]], late_ns: int
) -> None:
    """Refuse a `/clock` that says otherwise than the heartbeats; it comes too often to be listed itself."""
    if not clock:
        return
    at, ticks = (np.array(column, dtype=np.int64) for column in zip(*sorted(clock), strict=True))
    told = [(stamp_ns, sent) for stamp_ns, beat in beats if (sent := _sent_ns(beat, "ros_ns")) is not None]
    if not told:
        raise _UnfitError("nothing in its heartbeats shows that its '/clock' is that of the simulation")
    stamps, sent_ns = (np.array(column, dtype=np.int64) for column in zip(*told, strict=True))
    before = np.searchsorted(at, stamps, side="right") - 1
    there = (before >= 0) & (stamps - at[np.maximum(before, 0)] <= late_ns)
    apart_ns = np.abs(ticks[np.maximum(before, 0)] - sent_ns)[there]
    if not there.any() or apart_ns.max() > late_ns:
        worst = f", by up to {apart_ns.max() / 1e9:.1f} s" if there.any() else ""
        raise _UnfitError(f"its '/clock' says otherwise than its heartbeats{worst}")


def _lost(stated: Mapping[str, Any]) -> dict[str, int]:
    """How many messages of each topic never reached the recorder, by their numbers."""
    found = {}
    for topic, block in stated["topics"].items():
        publishers = block.get("publishers") or {}
        lost = [one.get("lost") or 0 if isinstance(one, dict) else None for one in _values(publishers)]
        counts = [n for n in lost if isinstance(n, int) and 0 <= n < 1 << 63]
        if not isinstance(publishers, dict) or len(counts) < len(lost):
            raise _UnfitError(f"its manifest does not say how many messages were lost on {topic!r}")
        found[topic] = sum(counts)
    return found


def _values(mapping: object) -> list[Any]:
    return [*mapping.values()] if isinstance(mapping, dict) else []


# What the bytes mean ---------------------------------------------------------------------------


_TEXT = "sha256:"
"""Of the text of a definition, as a publisher of ROS 1 sends it. The MD5 sum of ROS 1 will not do: it leaves
out that an array of messages is one, so that a list, one message and none have the same."""
_EVENT = "_Event"
"""Of a service; what such a type consists of is not in the definitions of ROS."""


class _Meaning(NamedTuple):
    """Of which topics the meaning of the bytes is open.

    Attributes:
        undefined: The recorder could not say how their messages are defined; the first ones never did.
        uncompared: It said so, and the definition in the log has no hash; with the reason.
    """

    undefined: tuple[str, ...]
    uncompared: tuple[tuple[str, str], ...]


def _refuse_other_meaning(found: _Found, stated: Mapping[str, Any]) -> _Meaning:
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
            raise _UnfitError(f"its manifest does not say of what type the messages on {topic!r} are")
        types = {connection.type for connection in connections}
        if received and (others := sorted(types - {normalised_type(received)})):
            raise _UnfitError(f"on {topic!r} it has messages of {others[0]!r}, and its recorder {received!r}")
        if len({connection.encoding for connection in connections}) > 1:
            raise _UnfitError(f"it encodes the messages on {topic!r} in two ways")
        by_text = bool(known) and all(one.startswith(_TEXT) for one in known)
        defined = _Defined.by(connections, by_text=by_text)
        other = next((one.encoding for one in connections if one.encoding not in found.encodings), None)
        lacking = defined.unreadable
        if other is not None:
            lacking = f"its messages are {other or 'not'} encoded, and those of the recorder otherwise"
        if not known or any(one.endswith(_EVENT) for one in types):
            undefined += [topic] if "definitions" in block else []
            if len(defined.hashes) > 1:
                raise _UnfitError(f"it defines the messages on {topic!r} in two ways")
        elif not (lacking := lacking or defined.uncompared) and not defined.hashes <= {*known}:
            raise _UnfitError(f"it defines the messages on {topic!r} otherwise than who published them")
        uncompared += [(topic, lacking)] if lacking else []
    return _Meaning(tuple(undefined), tuple(uncompared))


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


def _matched(
    found: _Found, spans: Mapping[tuple[str, str], list[Span]], origin_ns: int, late_ns: int
) -> dict[str, _Matched]:
    """What log and recorder both have of each topic; messages of the same bytes are paired from the end on.

    So of equal ones that only one of them has, those count as missing, or as too many, that came first:
    neither subscriber hears a publisher from its first message on.
    """
    late_s = late_ns / 1e9
    first_s = min((span.start_s for every in spans.values() for span in every), default=0.0)
    listed: dict[str, dict[str, list[Span]]] = defaultdict(dict)
    for (topic, digest), every in spans.items():
        listed[topic][digest] = every
    matched: dict[str, _Matched] = {}
    for topic, messages in sorted(found.logged.items()):
        by_digest: dict[str, list[_Logged]] = defaultdict(list)
        for one in messages:
            by_digest[one.digest].append(one)
        into = matched[topic] = _Matched()
        for digest in sorted(by_digest.keys() | listed[topic].keys()):
            left = sorted(by_digest.get(digest, ()))
            for span in reversed(listed[topic].get(digest, [])):
                while left and (left[-1].t_ns - origin_ns) / 1e9 > span.end_s + late_s:
                    into.extra.append(left.pop())
                # Whatever came before the first heartbeat is in it.
                if left and (
                    span.start_s <= first_s or (left[-1].t_ns - origin_ns) / 1e9 >= span.start_s - late_s
                ):
                    into.both.append(left.pop())
                else:
                    into.gone.append((span, digest))
            into.extra += left
    return matched


def _at_most(found: Sequence[tuple[Span, str]], counts: Mapping[str, int]) -> list[tuple[Span, str]]:
    """The first of them, of each digest as many as counted."""
    taken: Counter[str] = Counter()
    kept = []
    for span, digest in sorted(found):
        taken[digest] += 1
        if taken[digest] <= counts[digest]:
            kept.append((span, digest))
    return kept


def _around(spans: Sequence[Span]) -> Span:
    return Span(min(span.start_s for span in spans), max(span.end_s for span in spans))


def _refuse_joined_publishers(
    topic: str, logged: Sequence[_Logged], listed: Counter[str], about: Mapping[str, Any]
) -> None:
    """Refuse a topic on which the messages of several publishers stand as those of one.

    Two that tell two stories contest each other; one that changes his mind does not.
    """
    publishers = about.get("publishers")
    if not isinstance(publishers, dict) or "" in publishers:
        return
    counts = {name: n if isinstance(n := one.get("count"), int) else 0 for name, one in publishers.items()}
    of_log, here = Counter(one.publisher for one in logged), Counter(one.digest for one in logged)
    more, less = (here - listed).total(), (listed - here).total()
    if all(name.startswith("/") for name in of_log):
        for name, n in sorted(of_log.items()):
            if n > counts.get(name, 0) + more:
                raise _UnfitError(f"on {topic!r} it has messages of others as those of {name}")
        return
    # Another container names connections by numbers: of as many publishers, unless nothing is left of some.
    fewest = sorted(n for n in counts.values() if n > 0)[: max(0, len(counts) - len(of_log))]
    if sum(fewest) > less:
        raise _UnfitError(f"on {topic!r} it has the messages of {len(counts)} publishers as those of fewer")


def _less_from(matched: _Matched | None, about: Mapping[str, Any]) -> tuple[str, ...]:
    """The publishers of whom the log has less than the recorder received; empty where either names none."""
    publishers = about.get("publishers")
    if matched is None or not isinstance(publishers, dict):
        return ()
    # A line of another node is none of this one, whichever connection the log has it on.
    of_log = Counter(one.publisher for one in matched.both if one.publisher == one.node)
    if "" in publishers or any(not one.publisher for one in matched.both):
        return ()
    return tuple(
        sorted(
            name
            for name, one in publishers.items()
            if isinstance(one, dict) and isinstance(n := one.get("count"), int) and n > of_log[name]
        )
    )


def _unlisted(
    found: _Found,
    listed: Mapping[str, Counter[str]],
    beats: list[tuple[int, Mapping[str, Any]]],
    early: Mapping[str, Sequence[_Logged]],
    lost: Mapping[str, int] | None = None,
) -> Iterator[tuple[str, int]]:
    """How many messages between the first and the last heartbeat the recorder did not receive, by topic.

    With `lost`, only those that it did not lose either: not what came while it closed its books.
    """
    if not beats:
        return
    first_ns, last_ns = beats[0][0], beats[-1][0] - (LATE_NS if lost else 0)
    for topic, digests in sorted(listed.items()):
        inside = Counter(m.digest for m in found.logged.get(topic, ()) if first_ns <= m.t_ns <= last_ns)
        inside -= Counter(m.digest for m in early.get(topic, ()) if first_ns <= m.t_ns <= last_ns)
        if (more := (inside - digests).total() - (lost or {}).get(topic, 0)) > 0:
            yield topic, more
