"""Mutations that know a format: its pieces move or change, while lengths, packings and checksums stay right.

A change of bytes alone is refused at the first length or checksum that it breaks, so what lies behind is
seldom reached. Each way here takes an input apart as far as it is whole, changes one piece, and puts it
together again. An input of which nothing can be taken apart gives none.
"""

from __future__ import annotations

import base64
import bz2
import io
import json
import random
import re
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeAlias

import yaml

from ariac_score.logs.containers.inflating import inflate
from ariac_score.testing.repacked import McapForm, repacked

__all__ = ["WAYS", "Way", "mcap_records", "ros1_records", "structured"]

Way: TypeAlias = Callable[[bytes, random.Random], bytes]
"""Another input in the form of one; raises what its parts raise where that one has no form."""

_MAGIC = b"\x89MCAP0\r\n"
_LONGEST = 1 << 16
_NUMBERS: tuple[float | int, ...] = (
    0,
    -1,
    1,
    2,
    0.1 + 0.2,
    -0.0,
    1e308,
    5e-324,
    1 << 63,
    -(1 << 63),
    1 << 64,
    10**30,
)


def structured(name: str, raw: bytes, chance: random.Random) -> bytes | None:
    """One mutation of an input of a target in its format; nothing where it has none."""
    way = WAYS.get(name)
    if way is None:
        return None
    try:
        for _ in range(chance.choice((1, 1, 2, 4))):
            raw = way(raw, chance)[:_LONGEST]
    except Exception:  # whatever the libraries here say of what is damaged
        return None
    return raw


def _shuffled(pieces: list[Any], chance: random.Random) -> None:
    """Drop, double, swap or move a piece."""
    at, to = chance.randrange(len(pieces)), chance.randrange(len(pieces))
    match chance.randrange(4):
        case 0:
            del pieces[at]
        case 1:
            pieces.insert(to, pieces[at])
        case 2:
            pieces[at], pieces[to] = pieces[to], pieces[at]
        case _:
            pieces.insert(to, pieces.pop(at))


def _edge(width: int, chance: random.Random) -> bytes:
    top = 1 << 8 * width
    picked = (0, 1, 2, top - 1, top // 2, top // 2 - 1, chance.randrange(top), chance.randrange(300) % top)
    return chance.choice(picked).to_bytes(width, "little")


def _with_number(body: bytes, places: Sequence[tuple[int, int]], chance: random.Random) -> bytes:
    """A number of a known place and width, or of any, at an edge or near what it was."""
    at, width = (
        chance.choice(places)
        if places
        else (chance.randrange(max(1, len(body))), chance.choice((1, 2, 4, 8)))
    )
    if at + width > len(body) or chance.random() < 0.15:
        at, width = chance.randrange(max(1, len(body))), 1
    if chance.random() < 0.4:
        near = int.from_bytes(body[at : at + width], "little") + chance.choice((-2, -1, 1, 2, 8))
        return body[:at] + (near % (1 << 8 * width)).to_bytes(width, "little") + body[at + width :]
    return body[:at] + _edge(width, chance) + body[at + width :]


# MCAP

_MCAP_PLACES: Mapping[int, tuple[tuple[int, int], ...]] = {
    1: ((0, 4),),
    2: ((0, 8), (8, 8), (16, 4)),
    3: ((0, 2), (2, 4)),
    4: ((0, 2), (2, 2), (4, 4)),
    5: ((0, 2), (2, 4), (6, 8), (14, 8)),
    6: ((0, 8), (8, 8), (16, 8), (24, 4), (28, 4)),
    7: ((0, 2), (2, 4), (6, 8), (14, 8)),
    8: ((0, 8), (8, 8), (16, 8), (24, 8), (32, 4), (36, 2), (38, 8)),
    11: ((0, 8), (8, 2), (10, 4), (14, 4), (18, 4), (22, 4), (26, 8), (34, 8), (42, 4)),
    14: ((0, 1), (1, 8), (9, 8)),
    15: ((0, 4),),
}
_FORMS = ("", "lz4", "zstd")


def _mcap(raw: bytes, chance: random.Random) -> bytes:
    if chance.random() < 0.15:
        form = McapForm(
            chance.choice(_FORMS),
            chunk_bytes=chance.choice((0, 100, 1000)),
            indexed=chance.random() < 0.7,
            chunk_checksums=chance.random() < 0.7,
            data_checksum=chance.random() < 0.3,
        )
        return repacked(raw, form)
    found = mcap_records(raw[len(_MAGIC) :])
    _change_mcap(found, chance)
    return _MAGIC + _mcap_joined(found) + (_MAGIC if chance.random() < 0.95 else b"")


def mcap_records(raw: bytes) -> list[tuple[int, bytes]]:
    """Kind and content of each record, as far as they are whole."""
    found, at = [], 0
    while at + 9 <= len(raw):
        op, length = struct.unpack_from("<BQ", raw, at)
        if at + 9 + length > len(raw):
            break
        found.append((op, raw[at + 9 : at + 9 + length]))
        at += 9 + length
    return found


def _mcap_joined(found: Sequence[tuple[int, bytes]]) -> bytes:
    return b"".join(struct.pack("<BQ", op, len(body)) + body for op, body in found)


def _change_mcap(found: list[tuple[int, bytes]], chance: random.Random) -> None:
    at = chance.randrange(len(found))
    op, body = found[at]
    kind = chance.random()
    if kind < 0.25:
        _shuffled(found, chance)
    elif op == 6 and kind < 0.8:
        found[at] = op, _changed_chunk(body, chance)
    elif kind < 0.85:
        found[at] = op, _with_number(body, _MCAP_PLACES.get(op, ()), chance)
    elif kind < 0.9:
        found[at] = chance.choice((1, 2, 3, 4, 5, 6, 7, 8, 11, 14, 15, 0, 0x80, 255)), body
    elif kind < 0.95:
        found[at] = op, body + b"\x01\xff\xff"
    else:
        found[at] = op, body[: chance.randrange(len(body) + 1)]


def _changed_chunk(body: bytes, chance: random.Random) -> bytes:
    """A chunk, one of whose records is changed, with the size and the checksum of what it holds."""
    size, _, named = struct.unpack_from("<QII", body, 16)
    how = body[32 : 32 + named].decode()
    packed = body[40 + named :]
    inner = mcap_records(bytes(inflate(packed, how, size=size)) if how else packed)
    _change_mcap(inner, chance)
    plain = _mcap_joined(inner)
    checksum = chance.choice((zlib.crc32(plain), zlib.crc32(plain), 0))
    head = body[:16] + struct.pack("<QIIQ", len(plain), checksum, 0, len(plain))
    return head + plain


# ROS 1

_ROS1 = b"#ROSBAG V2.0\n"
_Ros1: TypeAlias = "tuple[list[tuple[bytes, bytes]], bytes]"


def _ros1(raw: bytes, chance: random.Random) -> bytes:
    found = ros1_records(raw[len(_ROS1) :])
    _change_ros1(found, chance)
    return _ROS1 + _ros1_joined(found)


def ros1_records(raw: bytes) -> list[_Ros1]:
    """Fields and content of each record, as far as they are whole."""
    found: list[_Ros1] = []
    at = 0
    while at + 4 <= len(raw):
        head_end = at + 4 + int.from_bytes(raw[at : at + 4], "little")
        end = head_end + 4 + int.from_bytes(raw[head_end : head_end + 4], "little")
        if end > len(raw):
            break
        head, fields, place = raw[at + 4 : head_end], [], 0
        while place < len(head):
            length = int.from_bytes(head[place : place + 4], "little")
            name, _, value = head[place + 4 : place + 4 + length].partition(b"=")
            fields.append((name, value))
            place += 4 + length
        found.append((fields, raw[head_end + 4 : end]))
        at = end
    return found


def _ros1_joined(found: Sequence[_Ros1]) -> bytes:
    def sized(raw: bytes) -> bytes:
        return struct.pack("<I", len(raw)) + raw

    return b"".join(
        sized(b"".join(sized(name + b"=" + value) for name, value in fields)) + sized(body)
        for fields, body in found
    )


def _change_ros1(found: list[_Ros1], chance: random.Random) -> None:
    at = chance.randrange(len(found))
    fields, body = found[at]
    named = dict(fields)
    kind = chance.random()
    if kind < 0.2:
        _shuffled(found, chance)
    elif named.get(b"op") == b"\x05" and kind < 0.75:
        found[at] = _changed_ros1_chunk(fields, body, chance)
    elif kind < 0.5 and fields:
        one = chance.randrange(len(fields))
        name, value = fields[one]
        changed = _with_number(value, ((0, len(value)),) if len(value) in (1, 4, 8) else (), chance)
        found[at] = [*fields[:one], (name, changed), *fields[one + 1 :]], body
    elif kind < 0.6 and fields:
        fields = list(fields)
        _shuffled(fields, chance)
        found[at] = fields, body
    else:
        found[at] = (
            fields,
            _with_number(body, tuple((place, 4) for place in range(0, len(body) - 3, 4)), chance),
        )


def _changed_ros1_chunk(fields: list[tuple[bytes, bytes]], body: bytes, chance: random.Random) -> _Ros1:
    named = dict(fields)
    how, size = named[b"compression"].decode(), int.from_bytes(named[b"size"], "little")
    inner = ros1_records(body if how == "none" else bytes(inflate(body, how, size=size)))
    _change_ros1(inner, chance)
    plain = _ros1_joined(inner)
    told = {b"compression": b"none", b"size": struct.pack("<I", len(plain))}
    if chance.random() < 0.3:
        told[b"compression"], packed = b"bz2", bz2.compress(plain)
        return [(name, told.get(name, value)) for name, value in fields], packed
    return [(name, told.get(name, value)) for name, value in fields], plain


# SQLite

_TABLE_PAGES = (0x0D, 0x05, 0x0A, 0x02)


def _sqlite(raw: bytes, chance: random.Random) -> bytes:
    size = int.from_bytes(raw[16:18], "big")
    pages = [bytearray(raw[at : at + size]) for at in range(0, len(raw), size)]
    number = chance.randrange(len(pages))
    page = pages[number]
    start = 100 if number == 0 else 0
    kind = chance.randrange(8)
    if kind == 0:
        one, other = chance.randrange(len(pages)), chance.randrange(len(pages))
        pages[one], pages[other] = pages[other], pages[one]
    elif kind == 1:
        pages.append(bytearray(page))
    elif kind == 2:
        at, width = chance.choice(
            ((16, 2), (18, 1), (20, 1), (28, 4), (32, 4), (36, 4), (52, 4), (56, 4), (92, 4))
        )
        pages[0][at : at + width] = _edge(width, chance)
    elif kind == 3:
        at, width = chance.choice(((0, 1), (1, 2), (3, 2), (5, 2), (7, 1), (8, 4)))
        page[start + at : start + at + width] = _edge(width, chance)[::-1]
    elif kind == 4:
        page[start] = chance.choice(_TABLE_PAGES)
    else:
        _change_cell(page, start, len(pages), kind, chance)
    return b"".join(pages)


def _change_cell(page: bytearray, start: int, pages: int, kind: int, chance: random.Random) -> None:
    """The pointer to a cell, one of its first bytes (lengths, key, types), or the page it goes on at."""
    first = start + (12 if page[start] in (0x05, 0x02) else 8)
    cells = int.from_bytes(page[start + 3 : start + 5], "big")
    place = first + 2 * chance.randrange(max(1, cells))
    if kind == 5:
        near = int.from_bytes(page[place : place + 2], "big") + chance.choice((-4, -1, 1, 2, 100))
        page[place : place + 2] = (near % len(page)).to_bytes(2, "big")
        return
    cell = int.from_bytes(page[place : place + 2], "big")
    if kind == 6:
        at = min(cell + chance.randrange(10), len(page) - 1)
        page[at] = chance.choice((0, 1, 7, 0x0C, 0x0D, 0x7F, 0x80, 0x81, 0xFF, chance.randrange(256)))
    else:
        at = min(cell + chance.choice((0, 0, chance.randrange(200))), len(page) - 4)
        page[at : at + 4] = chance.randrange(pages + 2).to_bytes(4, "big")


# Texts

_CHUNK = re.compile(rb"<chunk encoding='(\w+)'>\s*<!\[CDATA\[(.*?)\]\]>\s*</chunk>\s*", re.S)
_XML = re.compile(rb"<[^>]*>|[^<]+")
_NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
_WORD = re.compile(r"\w+|\s+|[^\w\s]")


def _gazebo(raw: bytes, chance: random.Random) -> bytes:
    """Frames of Gazebo, opened, changed and packed again in any of the three ways."""
    chunks = list(_CHUNK.finditer(raw))
    if not chunks or chance.random() < 0.1:
        return _elements(raw, chance)
    if chance.random() < 0.15:
        pieces = [chunk.group() for chunk in chunks]
        _shuffled(pieces, chance)
        return raw[: chunks[0].start()] + b"".join(pieces) + raw[chunks[-1].end() :]
    chunk = chance.choice(chunks)
    how, inside = chunk.groups()
    if how != b"txt":
        inside = (zlib.decompress if how == b"zlib" else bz2.decompress)(base64.b64decode(inside))
    inside = _elements(inside, chance)
    how = chance.choice((b"txt", b"zlib", b"bz2"))
    if how != b"txt":
        inside = base64.b64encode((zlib if how == b"zlib" else bz2).compress(inside))
    made = b"<chunk encoding='%s'>\n<![CDATA[%s]]>\n</chunk>\n" % (how, inside)
    return raw[: chunk.start()] + made + raw[chunk.end() :]


def _elements(raw: bytes, chance: random.Random) -> bytes:
    if chance.random() < 0.5:
        return _other_number(raw, chance)
    pieces = _XML.findall(raw)
    _shuffled(pieces, chance)
    return b"".join(pieces)


def _other_number(raw: bytes, chance: random.Random) -> bytes:
    found = chance.choice(list(_NUMBER.finditer(raw)))
    words = (
        b"nan",
        b"inf",
        b"-inf",
        b"",
        b"0x1p3",
        b"1_0",
        b"+1",
        b"1e400",
        b"1.",
        b".5",
        "\u0661".encode(),
        b"--1",
    )
    new = chance.choice((*words, *(str(number).encode() for number in _NUMBERS)))
    return raw[: found.start()] + new + raw[found.end() :]


def _lines(raw: bytes, chance: random.Random) -> bytes:
    if chance.random() < 0.5:
        lines = raw.splitlines(keepends=True)
        _shuffled(lines, chance)
        return b"".join(lines)
    return _other_number(raw, chance) if chance.random() < 0.5 else _words(raw, chance)


def _words(raw: bytes, chance: random.Random) -> bytes:
    """Words of a language: one dropped, doubled, moved, put in brackets, or in the place of another."""
    words = _WORD.findall(raw.decode("utf-8", "replace"))
    one, other = sorted((chance.randrange(len(words)), chance.randrange(len(words))))
    match chance.randrange(5):
        case 0:
            words[one] = words[other]
        case 1:
            left, right = chance.choice(("()", "[]", "{}", "<>"))
            words[one:other] = [left, *words[one:other], right]
        case 2:
            words[one:one] = words[one:other] * chance.choice((1, 2, 20))
        case 3:
            words[one] = chance.choice(
                ("nan", "", "-", "not", "1e999", "9" * 30, "\u00e4", "\0", *map(str, _NUMBERS))
            )
        case _:
            _shuffled(words, chance)
    return "".join(words).encode("utf-8", "surrogatepass")


# Trees

_Node: TypeAlias = Any
_OTHERS: tuple[Any, ...] = (
    *(None, True, False, "", " ", "x", [], {}),
    *([[[[]]]], {"": {}}, 0, -1, 1e999, "9" * 40),
)


def _tree(node: _Node, chance: random.Random) -> _Node:
    """The same tree with another value, key or branch at some place."""
    if isinstance(node, dict) and node and chance.random() < 0.85:
        return _in_mapping(node, chance)
    if isinstance(node, list) and node and chance.random() < 0.85:
        some = list(node)
        at = chance.randrange(len(some))
        if chance.random() < 0.2:
            _shuffled(some, chance)
        else:
            some[at] = _tree(some[at], chance)
        return some
    if isinstance(node, (int, float)) and not isinstance(node, bool) and chance.random() < 0.6:
        return chance.choice((*_NUMBERS, -node, node + 1, node * 1e-9, str(node), float("nan"), float("inf")))
    if isinstance(node, str) and node and chance.random() < 0.5:
        at = chance.randrange(len(node))
        return chance.choice(
            (node[:at], node + node, node[:at] + "\0" + node[at:], "../" + node, node.upper(), node[1:])
        )
    return chance.choice(
        (None, True, False, "", " ", "x", [], {}, [[[[]]]], {"": {}}, 0, -1, 1e999, "9" * 40, [node, node])
    )


def _in_mapping(node: dict[Any, Any], chance: random.Random) -> dict[Any, Any]:
    keys = list(node)
    key, other = chance.choice(keys), chance.choice(keys)
    some = dict(node)
    match chance.randrange(12):
        case 0:
            del some[key]
        case 1:
            some[chance.choice(("", "x", f"{key} ", str(key).upper(), "__class__"))] = some.pop(key)
        case 2:
            some[key], some[other] = some[other], some[key]
        case 3:
            some[key] = node
        case _:
            some[key] = _tree(some[key], chance)
    return some


def _json(raw: bytes, chance: random.Random) -> bytes:
    made = json.dumps(_tree(json.loads(raw), chance))
    return (made if chance.random() < 0.9 else _twice_a_key(made, chance)).encode()


def _twice_a_key(made: str, chance: random.Random) -> str:
    at = chance.choice([place for place, letter in enumerate(made) if letter == "{"])
    return made[: at + 1] + chance.choice(('"record": 1, ', '"id": "x", ', '"": null, ')) + made[at + 1 :]


def _json_lines(raw: bytes, chance: random.Random) -> bytes:
    lines = raw.splitlines(keepends=True)
    if chance.random() < 0.3:
        _shuffled(lines, chance)
    else:
        at = chance.randrange(len(lines))
        lines[at] = _json(lines[at], chance) + b"\n"
    return b"".join(lines)


def _yaml(raw: bytes, chance: random.Random) -> bytes:
    if chance.random() < 0.2:
        return _lines(raw, chance)
    if chance.random() < 0.1:
        return _with_anchor(raw, chance)
    tree = yaml.load(raw, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader))  # noqa: S506  # either is safe
    flow = chance.choice((None, None, True))
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    made = yaml.dump(_tree(tree, chance), Dumper=dumper, sort_keys=False, default_flow_style=flow)
    return bytes(made.encode("utf-8", "surrogatepass"))


def _with_anchor(raw: bytes, chance: random.Random) -> bytes:
    """A value named, and said again by its name in another place."""
    found = list(re.finditer(rb": ", raw))
    one, other = sorted((chance.choice(found).end(), chance.choice(found).end()))
    return raw[:one] + b"&a " + raw[one:other] + b"*a #" + raw[other:]


# Archives

_HOSTILE = (
    "../x",
    "/etc/x",
    "C:\\x",
    "a\\..\\..\\x",
    "a/../../x",
    ".",
    "..",
    "a//b",
    "CON",
    "\u202egpj",
    "x" * 300,
    "a/",
    "",
)
_KINDS = (
    tarfile.SYMTYPE,
    tarfile.LNKTYPE,
    tarfile.CHRTYPE,
    tarfile.BLKTYPE,
    tarfile.FIFOTYPE,
    tarfile.DIRTYPE,
    b"S",
    b"x",
)


def _archive(raw: bytes, chance: random.Random) -> bytes:
    return (_zip if raw[:2] == b"PK" else _tar)(raw, chance)


def _zip(raw: bytes, chance: random.Random) -> bytes:
    """The members written again: named, sized, packed or placed otherwise."""
    with zipfile.ZipFile(io.BytesIO(raw)) as old:
        members = [(info, old.read(info)) for info in old.infolist()]
    at = chance.randrange(len(members))
    info, body = members[at]
    kind = chance.randrange(7)
    if kind == 0:
        _shuffled(members, chance)
    elif kind == 1:
        info.filename = chance.choice(_HOSTILE)
    elif kind == 2:
        info.external_attr = chance.choice((0o120777, 0o020644, 0o060644, 0o010644, 0o040755, 0o100000)) << 16
    elif kind == 3:
        members[at] = info, chance.choice((bytes(1 << 14), raw, body * 3, b"", b"/etc/passwd"))
    elif kind == 4:
        info.compress_type = chance.choice((0, 8, 12, 14))
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as new:
        for info, body in members:
            new.writestr(info, body, compress_type=info.compress_type)
    made = bytearray(out.getvalue())
    if kind >= 5:
        _lie_in_directory(made, chance)
    return bytes(made)


def _lie_in_directory(made: bytearray, chance: random.Random) -> None:
    """The directory places, sizes or counts a member otherwise: it overlaps another, or nothing is there."""
    heads = [found.start() for found in re.finditer(b"PK\x01\x02", made)]
    head, other = chance.choice(heads), chance.choice(heads)
    match chance.randrange(4):
        case 0:
            made[head + 42 : head + 46] = made[other + 42 : other + 46]
        case 1:
            place = head + chance.choice((16, 20, 24, 42))
            made[place : place + 4] = _edge(4, chance)
        case 2:
            place = head + chance.choice((6, 8, 10, 28, 30, 32, 34))
            made[place : place + 2] = _edge(2, chance)
        case _:
            end = made.rindex(b"PK\x05\x06")
            place = end + chance.choice((8, 10, 12, 16, 20))
            made[place : place + 2] = _edge(2, chance)


def _tar(raw: bytes, chance: random.Random) -> bytes:
    with tarfile.open(fileobj=io.BytesIO(raw)) as old:
        members = [
            (info, file.read() if (file := old.extractfile(info)) else b"") for info in old.getmembers()
        ]
    at = chance.randrange(len(members))
    info, body = members[at]
    match chance.randrange(5):
        case 0:
            _shuffled(members, chance)
        case 1:
            info.name = chance.choice(_HOSTILE)
        case 2:
            info.type, info.linkname = chance.choice(_KINDS), chance.choice((*_HOSTILE, "kit_1/log.jsonl"))
        case 3:
            info.pax_headers = {
                chance.choice(("path", "size", "linkpath", "GNU.sparse.realsize")): str(
                    chance.choice(_NUMBERS)
                )
            }
        case _:
            members[at] = info, chance.choice((bytes(1 << 14), body * 3, raw))
    out = io.BytesIO()
    how = chance.choice(("w", "w:gz", "w:bz2", "w:xz"))
    with tarfile.open(fileobj=out, mode=how, format=chance.choice((0, 1, 2))) as new:  # type: ignore[call-overload]  # of four constants
        for info, body in members:
            info.size = len(body) if info.isreg() else info.size
            new.addfile(info, io.BytesIO(body))
    return out.getvalue()


WAYS: Mapping[str, Way] = {
    "adjustments": _yaml,
    "archive": _archive,
    "ariac_database": _sqlite,
    "batch_rows": _json_lines,
    "bundle": _yaml,
    "cohort": _json,
    "competition": _yaml,
    "definition": _lines,
    "evalai_challenge": _yaml,
    "expression": _words,
    "jsonl": _json_lines,
    "log_map": _yaml,
    "mcap": _mcap,
    "mcap_peer": _mcap,
    "mcap_scan": _mcap,
    "oracle": _json_lines,
    "performance_log": _lines,
    "phase": _json,
    "result": _json,
    "rml": _words,
    "rml_events": _json_lines,
    "ros1_bag": _ros1,
    "ros1_peer": _ros1,
    "ros1_scan": _ros1,
    "ros_monitoring": _json_lines,
    "rule_set": _yaml,
    "sensor_cost": _lines,
    "signature": _lines,
    "sqlite_bag": _sqlite,
    "sqlite_scan": _sqlite,
    "state_log": _gazebo,
    "stl": _words,
    "team_config": _yaml,
    "trial_config": _yaml,
    "trial_log": _lines,
}
"""For each target the way its format is changed; programs (`columnar`, `wide_text`) are whole in any form."""
