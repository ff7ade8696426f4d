"""How fast recordings are read, against others: medians of ratios of alternated runs in fresh processes.

Prints for each way the seconds it took, the seconds of processor time (of all threads), what the
latter are as a multiple of ours, and the peak of memory. Imports count. On a machine that others
use, only processor time can be compared.

    python benchmarks/read.py [--rounds 5] [--seconds 600] [--folder DIR] [--only PART]

Writes the recordings it needs (seeded), once. `ours` brings the wanted fields of five topics
into arrays, all checksums verified; `rosbags` deserialises the same messages; `floor` reads
and inflates the file on one thread and looks at nothing.
"""

from __future__ import annotations

import argparse
import importlib.util
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

FIELDS = {
    "/tf": ["transforms.header.stamp", "transforms.header.frame_id", "transforms.child_frame_id"],
    "/joint_states": ["header.stamp", "name", "position", "velocity"],
    "/human/state": ["header.stamp", "pose.pose.position", "twist.twist.linear"],
    "/clock": ["clock"],
    "/gripper/wrench": ["header.stamp", "wrench.force"],
}
FIELDS["/tf"].append("transforms.transform")

CASES = [
    ("mcap", "", False),
    ("mcap", "lz4", False),
    ("mcap", "zstd", False),
    ("bag", "", False),
    ("bag", "lz4", False),
    ("db3", "", False),
    ("mcap", "", True),
    ("mcap", "lz4", True),
]


def ours(path: Path) -> int:
    from ariac_score.logs.tables import read_tables  # noqa: PLC0415

    return sum(len(t.stamps_ns) for t in read_tables(path, FIELDS))


def ours_all(path: Path) -> int:
    from ariac_score.logs.tables import read_tables  # noqa: PLC0415

    return sum(len(t.stamps_ns) for t in read_tables(path, dict.fromkeys(FIELDS)))


def rosbags(path: Path) -> int:
    from rosbags.highlevel import AnyReader  # noqa: PLC0415

    from ariac_score.logs.types import bundled_typestore  # noqa: PLC0415

    count = 0
    with AnyReader([path], default_typestore=bundled_typestore(2)) as reader:
        wanted = [c for c in reader.connections if c.topic in FIELDS]
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
    from ariac_score.logs.salvage import inflate  # noqa: PLC0415

    if path.suffix != ".mcap":
        with path.open("rb", buffering=0) as file:
            return sum(len(block) for block in iter(lambda: file.read(1 << 20), b""))
    import struct  # noqa: PLC0415

    total = 0
    with path.open("rb") as file:
        file.read(8)
        while len(head := file.read(9)) == 9:
            op, length = struct.unpack("<BQ", head)
            body = file.read(length)
            if op == 6:
                (size,) = struct.unpack_from("<Q", body, 16)
                (name,) = struct.unpack_from("<I", body, 28)
                kind = body[32 : 32 + name].decode()
                total += len(inflate(memoryview(body)[40 + name :], kind, size=size))
    return total


WAYS: dict[str, Callable[[Path], int]] = {
    "ours": ours,
    "ours_all": ours_all,
    "rosbags": rosbags,
    "mcap_ros2": mcap_ros2,
    "pybag": pybag,
    "floor": floor,
}


def one(way: str, path: Path) -> None:
    start = time.perf_counter()
    count = WAYS[way](path)
    peak_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(time.perf_counter() - start, time.process_time(), peak_mb, count)


def measured(way: str, path: Path) -> tuple[float, float, float, int]:
    """Seconds, processor seconds, peak memory in MB, and messages, of a fresh process."""
    command = [sys.executable, __file__, "--one", way, str(path)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    seconds, processor, memory, count = done.stdout.split()
    return float(seconds), float(processor), float(memory), int(count)


def compared(path: Path, ways: list[str], rounds: int) -> None:
    runs: dict[str, list[tuple[float, float, float, int]]] = {way: [] for way in ways}
    for _ in range(rounds):
        for way in ways:
            runs[way].append(measured(way, path))
    for way in ways:
        seconds, processor, memory, counts = zip(*runs[way], strict=True)
        ratio = median(r[1] / o[1] for r, o in zip(runs[way], runs["ours"], strict=True))
        print(
            f"{path.name:24} {way:10} {median(seconds):8.2f} s {median(processor):8.2f} s cpu"
            f" {ratio:7.2f} x ours {max(memory):7.0f} MB {counts[0]:>10}",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=600)
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir(), "ariac-score-benchmark"))
    parser.add_argument("--only", default="", help="only recordings whose name contains this")
    parser.add_argument("--peers", action="store_true", help="also mcap-ros2-support and pybag-sdk")
    parser.add_argument("--one", nargs=2, metavar=("WAY", "PATH"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.one:
        one(given.one[0], Path(given.one[1]))
        return
    from recordings import write  # noqa: PLC0415  # the measured processes need none of it

    given.folder.mkdir(parents=True, exist_ok=True)
    for suffix, compression, camera in CASES:
        name = f"{compression or 'none'}{'_camera' if camera else ''}_{given.seconds:g}s.{suffix}"
        if given.only not in name:
            continue
        path = given.folder / name
        if not path.exists():
            write(path, compression, seconds=given.seconds, camera=camera)
        ways = ["ours", "rosbags", "floor"]
        if suffix == "mcap" and not compression and not camera:
            ways.append("ours_all")
        if given.peers and suffix == "mcap":
            ways += [w for w in ("mcap_ros2", "pybag") if importlib.util.find_spec(w.replace("_ros2", ""))]
        compared(path, ways, given.rounds)


if __name__ == "__main__":
    main()
