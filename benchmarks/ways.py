"""What `read.py` measures, each in a process that loads nothing else: python ways.py WAY PATH.

Prints seconds of processor time, the peak of memory in MB, and how much was counted.
"""

from __future__ import annotations

import importlib.util
import resource
import sys
import time
from collections.abc import Callable, Collection
from functools import cache
from pathlib import Path

FIELDS = {
    "/tf": ["transforms.header.stamp", "transforms.header.frame_id", "transforms.child_frame_id"],
    "/joint_states": ["header.stamp", "name", "position", "velocity"],
    "/human/state": ["header.stamp", "pose.pose.position", "twist.twist.linear"],
    "/clock": ["clock"],
    "/gripper/wrench": ["header.stamp", "wrench.force"],
}
FIELDS["/tf"].append("transforms.transform")

SCORED = ("/tf", "/human/state")
"""The topics that the log map below leads anywhere."""


def ours(path: Path) -> int:
    from ariac_score.logs.gather.wanted_fields import read_tables  # noqa: PLC0415

    return sum(len(t.stamps_ns) for t in read_tables(path, FIELDS))


def ours_all(path: Path) -> int:
    from ariac_score.logs.gather.wanted_fields import read_tables  # noqa: PLC0415

    return sum(len(t.stamps_ns) for t in read_tables(path, dict.fromkeys(FIELDS)))


def rosbags(path: Path, topics: Collection[str] = FIELDS.keys()) -> int:
    from rosbags.highlevel import AnyReader  # noqa: PLC0415

    from ariac_score.logs.columnar.types import bundled_typestore  # noqa: PLC0415

    count = 0
    with AnyReader([path], default_typestore=bundled_typestore(2)) as reader:
        wanted = [c for c in reader.connections if c.topic in topics]
        for connection, _, raw in reader.messages(connections=wanted):
            reader.deserialize(raw, connection.msgtype)
            count += 1
    return count


def mcap_ros2(path: Path) -> int:
    from mcap.reader import make_reader  # noqa: PLC0415
    from mcap_ros2.decoder import DecoderFactory  # noqa: PLC0415

    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return sum(1 for _ in reader.iter_decoded_messages(topics=list(FIELDS)))


def pybag(path: Path) -> int:
    from pybag.mcap_reader import McapFileReader  # noqa: PLC0415

    with McapFileReader.from_file(path) as reader:
        return sum(1 for topic in FIELDS for _ in reader.messages(topic))


def floor(path: Path) -> int:
    """The file read and inflated on one thread, by the quickest module that is installed."""
    if path.suffix != ".mcap":
        with path.open("rb", buffering=0) as file:
            return sum(len(block) for block in iter(lambda: file.read(1 << 20), b""))
    import struct  # noqa: PLC0415

    total, room = 0, bytearray(16 << 20)
    with path.open("rb") as file:
        file.read(8)
        while len(head := file.read(9)) == 9:
            op, length = struct.unpack("<BQ", head)
            body = file.read(length)
            if op == 6:
                (size,) = struct.unpack_from("<Q", body, 16)
                (name,) = struct.unpack_from("<I", body, 28)
                kind, packed = body[32 : 32 + name].decode(), memoryview(body)[40 + name :]
                if kind:
                    inflater(kind)(packed, memoryview(room)[:size])
                total += size
    return total


@cache
def inflater(kind: str) -> Callable[[memoryview, memoryview], object]:
    if importlib.util.find_spec("cramjam"):
        import cramjam  # noqa: PLC0415

        return getattr(cramjam, kind).decompress_into
    if kind == "lz4":
        from lz4.frame import LZ4FrameDecompressor as Inflater  # noqa: PLC0415
    else:
        from backports.zstd import ZstdDecompressor as Inflater  # noqa: PLC0415
    return lambda packed, room: Inflater().decompress(bytes(packed), max_length=len(room))


def state_log(path: Path) -> int:
    from ariac_score.logs.gazebo_states import read_states  # noqa: PLC0415

    return sum(len(frames) for frames, _ in read_states(path).poses.values())


def state_log_lxml(path: Path) -> int:
    """The same poses by `lxml` iterparse, chunk by chunk."""
    import base64  # noqa: PLC0415
    import io  # noqa: PLC0415
    import re  # noqa: PLC0415
    import zlib  # noqa: PLC0415
    from collections import defaultdict  # noqa: PLC0415

    from lxml import etree  # noqa: PLC0415

    found: dict[tuple[str, str], list[list[float]]] = defaultdict(list)
    for chunk in re.finditer(rb"CDATA\[(.*?)\]\]>", path.read_bytes(), re.DOTALL):
        text = zlib.decompress(base64.b64decode(chunk[1]))
        for _, state in etree.iterparse(io.BytesIO(b"<r>" + text + b"</r>"), tag="state"):
            for model in state.iterfind("model"):
                name = model.get("name")
                found[name, ""].append([float(n) for n in model.findtext("pose").split()])
                for link in model.iterfind("link"):
                    found[name, link.get("name")].append([float(n) for n in link.findtext("pose").split()])
            state.clear()
    return sum(map(len, found.values()))


def score(path: Path) -> int:
    """The whole command, from the start of Python on."""
    import contextlib  # noqa: PLC0415
    import io  # noqa: PLC0415

    from ariac_score.cli import main as command  # noqa: PLC0415

    folder = path.parent / "scored"
    with contextlib.redirect_stdout(io.StringIO()) as said:
        code = command(["score", str(folder), "--rules", str(path.parent / "benchmark_rules.yaml")])
    assert code in (0, 6), said.getvalue()
    return len(said.getvalue())


def rosbags_scored(path: Path) -> int:
    """The topics that the command decodes, deserialised."""
    return rosbags(path, SCORED)


WAYS: dict[str, Callable[[Path], int]] = {
    "ours": ours,
    "ours_all": ours_all,
    "rosbags": rosbags,
    "mcap_ros2": mcap_ros2,
    "pybag": pybag,
    "floor": floor,
    "state_log": state_log,
    "lxml": state_log_lxml,
    "score": score,
    "rosbags_scored": rosbags_scored,
}


def one(way: str, path: Path) -> None:
    count = WAYS[way](path)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(time.process_time(), peak_mb, count)


if __name__ == "__main__":
    one(sys.argv[1], Path(sys.argv[2]))
