"""Ways in which the files of a run are broken, besides those of `season.py`: what strangers can put there.

Each way is a function of the folder of a run, which holds a whole `log.jsonl`, with the outcome that must be
recorded and what its reason must say.
"""

from __future__ import annotations

import json
import os
import socket
import sqlite3
import struct
import zipfile
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path

LOG = "log.jsonl"
Breaks = Callable[[Path, int], object]


def _log_of(content: bytes) -> Breaks:
    return lambda run, _number: (run / LOG).write_bytes(content)


def _instead(name: str, content: Callable[[], bytes]) -> Breaks:
    """Another recording instead of the log."""

    def breaks(run: Path, _number: int) -> None:
        (run / LOG).unlink()
        (run / name).write_bytes(content())

    return breaks


def _beside(name: str | bytes, content: bytes = b"") -> Breaks:
    """A file more."""

    def breaks(run: Path, _number: int) -> None:
        with open(os.path.join(os.fsencode(run), os.fsencode(name)), "wb") as out:  # noqa: PTH118, PTH123
            out.write(content)

    return breaks


def _sparse(name: str, size: int) -> Breaks:
    def breaks(run: Path, _number: int) -> None:
        with (run / name).open("ab") as out:
            out.truncate(size)

    return breaks


def _pipe(name: str) -> Breaks:
    def breaks(run: Path, _number: int) -> None:
        (run / name).unlink(missing_ok=True)
        os.mkfifo(run / name)

    return breaks


def _link(name: str, to: str) -> Breaks:
    def breaks(run: Path, _number: int) -> None:
        (run / name).unlink(missing_ok=True)
        (run / name).symlink_to(to)

    return breaks


def _socket(run: Path, _number: int) -> None:
    here = Path.cwd()
    os.chdir(run)  # the name of a socket may have 107 bytes
    try:
        with socket.socket(socket.AF_UNIX) as one:
            one.bind("s.mcap")
    finally:
        os.chdir(here)


def _deep(run: Path, _number: int) -> None:
    for _ in range(400):  # as deep as `rmtree` can remove
        run /= "d"
        run.mkdir()


def _many(run: Path, _number: int) -> None:
    (run / "many").mkdir()
    for number in range(100_001):
        os.close(os.open(f"{run}/many/{number}", os.O_CREAT))


def _records(run: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (run / LOG).read_text(encoding="utf-8").splitlines()]


def _rewritten(change: Callable[[list[dict[str, object]]], list[dict[str, object]]]) -> Breaks:
    """Records changed, so that the last one counts them right."""

    def breaks(run: Path, _number: int) -> None:
        *records, end = change(_records(run))
        records.append({**end, "records": len(records) + 1} if "records" in end else end)
        (run / LOG).write_text("".join(json.dumps(record) + "\n" for record in records), encoding="utf-8")

    return breaks


def _at(t_s: float) -> Callable[[list[dict[str, object]]], list[dict[str, object]]]:
    return lambda records: [{**r, "t_s": t_s} if r["record"] == "sample" else r for r in records]


def _order_of(records: list[dict[str, object]]) -> dict[str, object]:
    return next(record for record in records if record["record"] == "order")


def _orders_without_end(run: Path, _number: int) -> None:
    records = _records(run)
    before, after = json.dumps({**_order_of(records), "id": "@@"}).split("@@")
    with (run / LOG).open("w", encoding="utf-8") as out:
        out.write(json.dumps(records[0]) + "\n")
        out.writelines(f"{before}o{n}{after}\n" for n in range(_MILLION))


def _stamped_alike(run: Path, _number: int) -> None:
    """Very many samples of one time."""
    *records, end = _records(run)
    of_one_time = json.dumps({"record": "sample", "t_s": 1.0, "values": {"speed/robot": 0.5}}) + "\n"
    rest = [record for record in records if record["record"] != "sample"]
    with (run / LOG).open("w", encoding="utf-8") as out:
        out.writelines(json.dumps(record) + "\n" for record in rest)
        out.write(of_one_time * _MANY)
        out.write(json.dumps({**end, "records": len(rest) + _MANY + 1}) + "\n")


_MILLION, _MANY = 1_000_000, 100_000
_TABLES = """
create table topics(
    id integer primary key, name text, type text, serialization_format text, offered_qos_profiles text
);
create table messages(id integer primary key, topic_id integer, timestamp integer, data blob);
"""


def _database(rows: str, count: int) -> Breaks:
    def breaks(run: Path, _number: int) -> None:
        (run / LOG).unlink()
        made = sqlite3.connect(run / "log.db3")
        made.executescript(_TABLES)
        numbers = "with recursive n(i) as (select 1 union all select i + 1 from n where i < ?) "
        made.execute(numbers + rows, [count])
        made.execute("insert or ignore into topics values (1, '/tf', 'tf2_msgs/msg/TFMessage', 'cdr', '')")
        made.execute("insert or ignore into messages values (1, 1, 1, x'0001000000000000')")
        made.commit()
        made.close()

    return breaks


def _mcap_of_topics() -> bytes:
    """As many topics as the numbers of MCAP allow, and messages at one time."""

    def text(of: str) -> bytes:
        return struct.pack("<I", len(of)) + of.encode()

    def record(op: int, content: bytes) -> bytes:
        return bytes([op]) + struct.pack("<Q", len(content)) + content

    schema = struct.pack("<H", 1) + text("std_msgs/msg/String") + text("ros2msg") + text("string data\n")
    channels = [
        record(4, struct.pack("<HH", n, 1) + text(f"/t{n}") + text("cdr") + bytes(4)) for n in range(1 << 16)
    ]
    message = record(5, struct.pack("<HIQQ", 0, 0, 1, 1) + bytes.fromhex("00010000020000006100"))
    magic, head = b"\x89MCAP0\r\n", record(1, text("ros2") + text("")) + record(3, schema)
    return (
        magic
        + head
        + b"".join(channels)
        + message * 1000
        + record(15, bytes(4))
        + record(2, bytes(20))
        + magic
    )


def _text_changed(old: str, new: str) -> Breaks:
    def breaks(run: Path, _number: int) -> None:
        text = (run / LOG).read_text(encoding="utf-8")
        (run / LOG).write_text(text.replace(old, new, 1), encoding="utf-8")

    return breaks


@cache
def _chunk_bomb() -> bytes:
    """An MCAP of a few hundred bytes whose one chunk announces more than any chunk may have."""
    magic = b"\x89MCAP0\r\n"
    chunk = struct.pack("<QQQI", 0, 0, 1 << 40, 0) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", 4)
    chunk += b"\x28\xb5\x2f\xfd"
    header = struct.pack("<I", 0) * 2
    records = [(1, header), (6, chunk), (15, bytes(4)), (2, bytes(20))]
    return magic + b"".join(bytes([op]) + struct.pack("<Q", len(c)) + c for op, c in records) + magic


@cache
def _zip_bomb() -> bytes:
    from io import BytesIO  # noqa: PLC0415

    out = BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("log.jsonl", bytes(64 << 20))
    return out.getvalue()


def _ros1_of_lengths() -> bytes:
    return b"#ROSBAG V2.0\n" + struct.pack("<I", 0xFFFF_FFF0) + bytes(200)


def _sqlite_of_nothing() -> bytes:
    return b"SQLite format 3\x00" + bytes(range(256)) * 64


def _yaml(text: str) -> Breaks:
    return lambda run, _number: (run / "trial.yaml").write_text(text, encoding="utf-8")


_TOO_LARGE = ("too_large", "all files of a run may have")

BROKEN_FILES: Mapping[str, tuple[Breaks, str, str]] = {
    "a sparse log of terabytes": (_sparse(LOG, 1 << 42), *_TOO_LARGE),
    "a sparse file beside the log": (_sparse("video.bin", 1 << 42), *_TOO_LARGE),
    "more files than a run has": (_many, "too_large", "more than 100000 files"),
    "folders in folders": (_deep, "scored", ""),
    "a pipe beside the log": (_pipe("camera.mcap"), "scored", ""),
    "the log is a pipe": (_pipe(LOG), "nothing_to_score", "it holds no files"),
    "a socket beside the log": (_socket, "scored", ""),
    "the log is a device": (_link(LOG, "/dev/zero"), "nothing_to_score", "a link to somewhere else"),
    "a device beside the log": (_link("x.mcap", "/dev/zero"), "scored", ""),
    "the log leads to itself": (_link(LOG, LOG), "nothing_to_score", "a link to somewhere else"),
    "a folder that leads to itself": (_link("again", "."), "scored", ""),
    "a link into another run": (_link("other.jsonl", "../t_00000/log.jsonl"), "scored", ""),
    "a name of 255 bytes": (_beside("n" * 255), "scored", ""),
    "a name that is no UTF-8": (_beside(b"\xff\xfe.bin"), "scored", ""),
    "a name from right to left": (_beside("\u202egpj.exe"), "scored", ""),
    "a name with a line feed": (_beside("a\nb.txt"), "scored", ""),
    "values in values": (
        _log_of(b'{"record": "trial", "id": ' + b"[" * 100_000 + b"\n"),
        "nothing_to_score",
        "not recognised: log.jsonl",
    ),
    "no number": (_text_changed('"t_s": 0', '"t_s": NaN, "x": 0'), "unreadable", "line 4"),
    "an integer without end": (
        _text_changed('"t_s": 0', '"t_s": 1' + "0" * 6000),
        "unreadable",
        "t_s is inf",
    ),
    "the same key twice": (
        _text_changed('"t_s"', '"t_s": 0, "t_s"'),
        "unreadable",
        "key 't_s' is given twice",
    ),
    "a null byte": (_text_changed("sample", "sam\x00ple"), "unreadable", "Invalid control character"),
    "in UTF-16": (
        _log_of(b"\xff\xfe" + '{"record": "trial"}\n'.encode("utf-16-le")),
        "nothing_to_score",
        "not recognised",
    ),
    "all samples at one time": (_rewritten(_at(1.0)), "scored", ""),
    "a clock at the end of time": (_rewritten(_at(1e300)), "unreadable", "t_s is 1e+300"),
    "a clock before its beginning": (_rewritten(_at(-1e12)), "unreadable", "t_s is -1000000000000.0"),
    "backwards": (_rewritten(lambda r: [r[0], *reversed(r[1:-1]), r[-1]]), "scored", ""),
    "fifty orders": (
        _rewritten(lambda r: [r[0]] + [{**_order_of(r), "id": f"o{n}"} for n in range(50)] + r[1:]),
        "scored",
        "",
    ),
    "a million orders": (_orders_without_end, "timed_out", "at last in plugin jsonl"),
    "a hundred thousand samples of one time": (_stamped_alike, "scored", ""),
    "a hundred thousand topics": (
        _database("insert into topics select i, '/t' || i, 'std_msgs/msg/String', 'cdr', '' from n", _MANY),
        "nothing_to_score",
        "no order was found",
    ),
    "a million messages of one time": (
        _database("insert into messages select i, 1, 1, x'0001000000000000' from n", _MILLION),
        "nothing_to_score",
        "no order was found",
    ),
    "all topics that there can be": (_instead("log.mcap", _mcap_of_topics), "nothing_to_score", "no order"),
    "a chunk bomb": (_instead("log.mcap", _chunk_bomb), "unreadable", "more than the 1073741824 allowed"),
    "an archive that is a bomb": (
        _instead("log.zip", _zip_bomb),
        "nothing_to_score",
        "not recognised: log.zip",
    ),
    "lengths beyond the file": (_instead("log.bag", _ros1_of_lengths), "unreadable", "the file is cut off"),
    "a database of nothing": (_instead("log.db3", _sqlite_of_nothing), "unreadable", "the file is cut off"),
    "a page that never ends": (
        _instead("state.log", lambda: b"<?xml version='1.0'?>\n<gazebo_log>" + b"<chunk " * 100_000),
        "unreadable",
        "not one whole frame",
    ),
    "lists in lists of a configuration": (
        _yaml("orders: " + "[" * 10_000),
        "unreadable",
        "nested deeper than 64 levels",
    ),
    "an object in a configuration": (
        _yaml("orders: !!python/object/apply:os.system [true]\n"),
        "unreadable",
        "is not allowed",
    ),
}
"""Each with the outcome that must be recorded and part of its reason."""
