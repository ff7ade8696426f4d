"""Ten minutes of a made trial, as recorders write them: the same bytes for the same seed."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from heapq import merge
from pathlib import Path
from typing import Any

import numpy as np

from ariac_score.logs.columnar.types import bundled_typestore

ORIGIN_NS = 1_700_000_000_000_000_000
TF, JOINTS, CLOCK = "tf2_msgs/msg/TFMessage", "sensor_msgs/msg/JointState", "rosgraph_msgs/msg/Clock"
HUMAN, WRENCH, IMAGE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/WrenchStamped", "sensor_msgs/msg/Image"
TOPICS = {
    "/tf": (TF, 500),
    "/joint_states": (JOINTS, 500),
    "/human/state": (HUMAN, 100),
    "/clock": (CLOCK, 500),
    "/gripper/wrench": (WRENCH, 100),
    "/camera/image": (IMAGE, 10),
}
LINKS = ("base", "torso", "shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")

Item = tuple[int, str, bytes]


class Messages:
    """Serialised messages of every topic, in order of time; what moves does so smoothly."""

    def __init__(self, *, ros1: bool, seed: int, seconds: float, camera: bool) -> None:
        self.store = bundled_typestore(1 if ros1 else 2)
        self._ros1, self._seconds = ros1, seconds
        self._dice = np.random.default_rng(seed)
        self._swings: dict[str, Any] = {}
        self.topics = [topic for topic in TOPICS if camera or topic != "/camera/image"]

    def __iter__(self) -> Iterator[Item]:
        yield from merge(*(self._topic(topic, number) for number, topic in enumerate(self.topics)))

    def _topic(self, topic: str, number: int) -> Iterator[Item]:
        type_, rate_hz = TOPICS[topic]
        make = {TF: self._tf, JOINTS: self._joints, CLOCK: self._clock}
        make |= {HUMAN: self._human, WRENCH: self._wrench, IMAGE: self._image}
        pack = self.store.serialize_ros1 if self._ros1 else self.store.serialize_cdr
        for i in range(int(self._seconds * rate_hz)):
            stamp_ns = ORIGIN_NS + i * (10**9 // rate_hz) + number * 1000
            yield stamp_ns, topic, bytes(pack(make[type_](stamp_ns, i), type_))

    def _make(self, name: str, *values: Any) -> Any:
        return self.store.types[name](*values)

    def _stamp(self, stamp_ns: int) -> Any:
        return self._make("builtin_interfaces/msg/Time", *divmod(stamp_ns, 10**9))

    def _header(self, stamp_ns: int, i: int, frame: str) -> Any:
        return self._make("std_msgs/msg/Header", *([i] if self._ros1 else []), self._stamp(stamp_ns), frame)

    def _swinging(self, what: str, stamp_ns: int, count: int, reach: float = 0.4) -> Any:
        """Some numbers that swing, each in its own time of 6 s to a minute."""
        if what not in self._swings:
            self._swings[what] = self._dice.uniform((0.1, 0, 0.5), (1, 6.28, 1), size=(count, 3)).T
        rate, phase, size = self._swings[what]
        return reach * size * np.sin(rate * ((stamp_ns - ORIGIN_NS) / 1e9) + phase)

    def _place(self, name: str, what: str, stamp_ns: int, reach: float = 0.4) -> Any:
        return self._make(f"geometry_msgs/msg/{name}", *self._swinging(what, stamp_ns, 3, reach).tolist())

    def _turn(self, what: str, stamp_ns: int) -> Any:
        turn = self._swinging(f"turn of {what}", stamp_ns, 4) + np.array([0.0, 0.0, 0.0, 1.0])
        return self._make("geometry_msgs/msg/Quaternion", *(turn / np.linalg.norm(turn)).tolist())

    def _vector(self) -> Any:
        return self._make("geometry_msgs/msg/Vector3", *self._dice.normal(size=3).tolist())

    def _tf(self, stamp_ns: int, i: int) -> Any:
        transforms = []
        for parent, child in zip(("world", *LINKS), LINKS, strict=False):
            at, turn = self._place("Vector3", child, stamp_ns), self._turn(child, stamp_ns)
            transform = self._make("geometry_msgs/msg/Transform", at, turn)
            header = self._header(stamp_ns, i, parent)
            transforms.append(self._make("geometry_msgs/msg/TransformStamped", header, child, transform))
        return self._make(TF, transforms)

    def _joints(self, stamp_ns: int, i: int) -> Any:
        names = [f"{link}_joint" for link in LINKS]
        numbers = [
            self._swinging(what, stamp_ns, len(names), 1.0) for what in ("position", "velocity", "effort")
        ]
        return self._make(JOINTS, self._header(stamp_ns, i, ""), names, *numbers)

    def _clock(self, stamp_ns: int, _: int) -> Any:
        return self._make(CLOCK, self._stamp(stamp_ns))

    def _human(self, stamp_ns: int, i: int) -> Any:
        at, turn = self._place("Point", "human", stamp_ns, 1.5), self._turn("human", stamp_ns)
        pose = self._make("geometry_msgs/msg/Pose", at, turn)
        speeds = (
            self._place("Vector3", f"{what} speed of human", stamp_ns) for what in ("straight", "turning")
        )
        twist = self._make("geometry_msgs/msg/Twist", *speeds)
        known = self._make("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36))
        moving = self._make("geometry_msgs/msg/TwistWithCovariance", twist, np.zeros(36))
        return self._make(HUMAN, self._header(stamp_ns, i, "world"), "human", known, moving)

    def _wrench(self, stamp_ns: int, i: int) -> Any:
        wrench = self._make("geometry_msgs/msg/Wrench", self._vector(), self._vector())
        return self._make(WRENCH, self._header(stamp_ns, i, "gripper"), wrench)

    def _image(self, stamp_ns: int, i: int) -> Any:
        picture = np.tile(self._dice.integers(0, 256, 640 * 48, dtype=np.uint8), 30)
        header = self._header(stamp_ns, i, "camera")
        return self._make(IMAGE, header, 480, 640, "rgb8", 0, 1920, picture)


def write(path: Path, compression: str, *, seed: int = 1, seconds: float = 600, camera: bool = False) -> Path:
    """Write a recording, in the format of the suffix; `compression` is empty, `lz4`, `zstd` or `bz2`."""
    messages = Messages(ros1=path.suffix == ".bag", seed=seed, seconds=seconds, camera=camera)
    if path.suffix == ".bag":
        _write_ros1(path, messages, compression)
    elif path.suffix == ".mcap":
        _write_mcap(path, messages, compression)
    else:
        _write_sqlite(path, messages)
    return path


def _write_ros1(path: Path, messages: Messages, compression: str) -> None:
    from rosbags.rosbag1 import Writer  # noqa: PLC0415

    writer = Writer(path)
    if compression:
        writer.set_compression(Writer.CompressionFormat[compression.upper()])
    with writer:
        known = {t: writer.add_connection(t, TOPICS[t][0], typestore=messages.store) for t in messages.topics}
        for stamp_ns, topic, payload in messages:
            writer.write(known[topic], stamp_ns, payload)


def _write_mcap(path: Path, messages: Messages, compression: str) -> None:
    from mcap.writer import CompressionType, Writer  # noqa: PLC0415

    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType[(compression or "none").upper()])
        writer.start(profile="ros2", library="benchmark")
        channels = {}
        for topic in messages.topics:
            type_ = TOPICS[topic][0]
            definition, _ = messages.store.generate_msgdef(type_, ros_version=2)
            schema = writer.register_schema(type_, "ros2msg", definition.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for stamp_ns, topic, payload in messages:
            writer.add_message(channels[topic], stamp_ns, payload, stamp_ns)
        writer.finish()


def _write_sqlite(path: Path, messages: Messages) -> None:
    from tempfile import TemporaryDirectory  # noqa: PLC0415

    from rosbags.rosbag2 import StoragePlugin, Writer  # noqa: PLC0415

    with TemporaryDirectory(dir=path.parent) as parent:
        folder = Path(parent, "bag")
        with Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
            known = {
                t: writer.add_connection(t, TOPICS[t][0], typestore=messages.store) for t in messages.topics
            }
            for stamp_ns, topic, payload in messages:
                writer.write(known[topic], stamp_ns, payload)
        next(folder.glob("*.db3")).rename(path)


def write_state_log(path: Path, *, seconds: float = 600, seed: int = 1) -> Path:
    """Write a `state.log` as Gazebo does at 10 Hz: eighty models, of which five move.

    In a real log of 2022 seven poses in a hundred differ from the frame before.
    """
    import base64  # noqa: PLC0415
    import zlib  # noqa: PLC0415

    dice = np.random.default_rng(seed)
    still = dice.uniform(-5, 5, size=(80, 3, 6))
    with path.open("w", encoding="utf-8") as file:
        file.write(
            "<?xml version='1.0'?>\n<gazebo_log>\n<header>\n<log_version>1.0</log_version>\n</header>\n"
        )
        frames: list[str] = []
        for i in range(int(seconds * 10)):
            frames.append(_frame(i, still, dice))
            if len(frames) == 500 or i == int(seconds * 10) - 1:
                packed = base64.b64encode(zlib.compress("".join(frames).encode())).decode()
                file.write(f"<chunk encoding='zlib'>\n<![CDATA[{packed}]]>\n</chunk>\n")
                frames = []
        file.write("</gazebo_log>\n")
    return path


def _frame(i: int, still: Any, dice: np.random.Generator) -> str:
    models = []
    for number, poses in enumerate(still):
        now = poses + (0.01 * dice.normal(size=poses.shape) if number < 5 else 0)
        own, *links = (" ".join(f"{value:.4g}" for value in pose) for pose in now)
        inner = "".join(
            f"<link name='link_{j}'><pose>{pose}</pose><velocity>0 0 0 0 -0 0</velocity></link>"
            for j, pose in enumerate(links)
        )
        models.append(f"<model name='model_{number}'><pose>{own}</pose><scale>1 1 1</scale>{inner}</model>")
    time = f"<sim_time>{i // 10} {i % 10 * 10**8}</sim_time><wall_time>9 9</wall_time>"
    return f"<sdf version='1.6'><state world_name='w'>{time}{''.join(models)}</state></sdf>"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("path", type=Path)
    parser.add_argument("--compression", default="")
    parser.add_argument("--seconds", type=float, default=600)
    parser.add_argument("--camera", action="store_true")
    given = parser.parse_args()
    print(write(given.path, given.compression, seconds=given.seconds, camera=given.camera))
