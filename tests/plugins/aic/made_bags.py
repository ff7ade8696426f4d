"""Recordings of the engine, made from messages as cases give them: rosbag2 folders with MCAP inside."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml
from rosbags.rosbag2 import StoragePlugin, Writer

from ariac_score.logs.columnar.types import bundled_typestore

STORE = bundled_typestore(2)
BAG = "bag_{trial}_20260520_101112_345"
TYPES = {
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/scoring/tf": "tf2_msgs/msg/TFMessage",
    "/scoring/tf_static": "tf2_msgs/msg/TFMessage",
    "/aic_controller/controller_state": "aic_control_interfaces/msg/ControllerState",
    "/fts_broadcaster/wrench": "geometry_msgs/msg/WrenchStamped",
    "/axia80_m20/wrench": "geometry_msgs/msg/WrenchStamped",
    "/aic/gazebo/contacts/off_limit": "ros_gz_interfaces/msg/Contacts",
    "/scoring/insertion_event": "std_msgs/msg/String",
    "/scoring/cable_activated": "std_msgs/msg/String",
    "/rosout": "rcl_interfaces/msg/Log",
    "/aic_controller/pose_commands": "std_msgs/msg/Header",
    "/aic_controller/joint_commands": "std_msgs/msg/Header",
}


def _new(type_: str, /, **fields: Any) -> Any:
    return STORE.types[type_](**fields)


def _time(ns: int) -> Any:
    return _new("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)


def _header(ns: int, frame: str = "") -> Any:
    return _new("std_msgs/msg/Header", stamp=_time(ns), frame_id=frame)


def _vector(values: Sequence[float]) -> Any:
    return _new("geometry_msgs/msg/Vector3", **dict(zip("xyz", map(float, values), strict=True)))


def _turn(values: Sequence[float] = (0, 0, 0, 1)) -> Any:
    return _new("geometry_msgs/msg/Quaternion", **dict(zip("xyzw", map(float, values), strict=True)))


def _pose() -> Any:
    point = _new("geometry_msgs/msg/Point", x=0.0, y=0.0, z=0.0)
    return _new("geometry_msgs/msg/Pose", position=point, orientation=_turn())


def _wrench(ns: int, force: Sequence[float]) -> Any:
    both = _new("geometry_msgs/msg/Wrench", force=_vector(force), torque=_vector((0, 0, 0)))
    return _new("geometry_msgs/msg/WrenchStamped", header=_header(ns), wrench=both)


def _transforms(listed: Sequence[Mapping[str, Any]]) -> Any:
    found = [
        _new(
            "geometry_msgs/msg/TransformStamped",
            header=_header(t["stamp_ns"], t["parent"]),
            child_frame_id=t["child"],
            transform=_new(
                "geometry_msgs/msg/Transform",
                translation=_vector(t["translation"]),
                rotation=_turn(t["rotation_xyzw"]),
            ),
        )
        for t in listed
    ]
    return _new("tf2_msgs/msg/TFMessage", transforms=found)


def _controller(message: Mapping[str, Any]) -> Any:
    import numpy as np  # noqa: PLC0415  # with the message that alone needs it

    none = np.empty(0)
    moving = _new(
        "trajectory_msgs/msg/JointTrajectoryPoint",
        positions=none,
        velocities=none,
        accelerations=none,
        effort=none,
        time_from_start=_new("builtin_interfaces/msg/Duration", sec=0, nanosec=0),
    )
    twist = _new(
        "geometry_msgs/msg/Twist",
        linear=_vector(message["tcp_velocity_linear"]),
        angular=_vector((0, 0, 0)),
    )
    return _new(
        "aic_control_interfaces/msg/ControllerState",
        header=_header(message["stamp_ns"]),
        tcp_pose=_pose(),
        tcp_velocity=twist,
        reference_tcp_pose=_pose(),
        tcp_error=np.zeros(6),
        reference_joint_state=moving,
        target_mode=_new("aic_control_interfaces/msg/TargetMode", mode=1),
        fts_tare_offset=_wrench(message["stamp_ns"], message["fts_tare_offset_force"]),
    )


def _contacts(pairs: Sequence[Sequence[str]]) -> Any:
    def entity(name: str) -> Any:
        return _new("ros_gz_interfaces/msg/Entity", id=0, name=name, type=5)

    import numpy as np  # noqa: PLC0415

    found = [
        _new(
            "ros_gz_interfaces/msg/Contact",
            collision1=entity(first),
            collision2=entity(second),
            positions=[],
            normals=[],
            depths=np.empty(0),
            wrenches=[],
        )
        for first, second in pairs
    ]
    return _new("ros_gz_interfaces/msg/Contacts", header=_header(0), contacts=found)


def message_of(message: Mapping[str, Any]) -> tuple[str, Any]:
    """The type and the message that a case describes; a field that nobody knows is an error."""
    topic = message["topic"]
    known = {"topic", "log_time_ns"}
    if "transforms" in message:
        known, made = known | {"transforms"}, _transforms(message["transforms"])
    elif "tcp_velocity_linear" in message:
        known |= {"stamp_ns", "tcp_velocity_linear", "fts_tare_offset_force"}
        made = _controller(message)
    elif "force" in message:
        known, made = known | {"stamp_ns", "force"}, _wrench(message["stamp_ns"], message["force"])
    elif "contacts" in message:
        known, made = known | {"contacts"}, _contacts(message["contacts"])
    elif "msg" in message:
        known |= {"stamp_ns", "msg"}
        made = _new(
            "rcl_interfaces/msg/Log",
            stamp=_time(message["stamp_ns"]),
            level=20,
            name="engine",
            msg=message["msg"],
            file="",
            function="",
            line=0,
        )
    elif "data" in message and isinstance(message["data"], bool):
        known, made = known | {"data"}, _new("std_msgs/msg/Bool", data=message["data"])
    elif "data" in message:
        known, made = known | {"data"}, _new("std_msgs/msg/String", data=message["data"])
    elif "log_time_ns" in message:
        made = _header(message.get("stamp_ns", message["log_time_ns"]))
        known |= {"stamp_ns"}
    else:
        raise AssertionError(f"a case describes a message on {topic} by {sorted(message)}")
    assert not set(message) - known, f"{topic}: nobody knows {sorted(set(message) - known)}"
    return made.__msgtype__, made


def write_bag(folder: Path, messages: Sequence[Mapping[str, Any]], *, topics: Sequence[str] = ()) -> Path:
    """Write a rosbag2 folder in which messages stand in the given order.

    Each is recorded when it was stamped, or right after the one before.

    Args:
        folder: What it shall be called.
        messages: As cases describe them; those with a `log_time_ns` are recorded at that time.
        topics: Topics that are recorded without a message.
    """
    at_ns = 10**9
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections: dict[tuple[str, str], Any] = {}

        def connection(topic: str, type_: str) -> Any:
            if (topic, type_) not in connections:
                connections[topic, type_] = writer.add_connection(topic, type_, typestore=STORE)
            return connections[topic, type_]

        for topic in topics:
            connection(topic, TYPES[topic])
        for message in messages:
            type_, made = message_of(message)
            at_ns = message.get("log_time_ns", max([at_ns + 1000, *_stamps([message])]))
            writer.write(connection(message["topic"], type_), at_ns, STORE.serialize_cdr(made, type_))
    return folder


def _stamps(messages: Sequence[Mapping[str, Any]]) -> list[int]:
    found = [m["stamp_ns"] for m in messages if "stamp_ns" in m]
    found += [m["log_time_ns"] for m in messages if "log_time_ns" in m]
    return found + [t["stamp_ns"] for m in messages for t in m.get("transforms", ())]


def configuration(
    connections: Sequence[Mapping[str, str]], *, time_limit_s: float, trial: str = "trial_1"
) -> str:
    """An engine configuration with one trial, a task for each connection."""
    tasks = {
        f"task_{number}": {
            "cable_type": "sfp_sc_cable",
            "cable_name": one.get("cable_name", "cable_0"),
            "plug_type": "sfp",
            "plug_name": one["plug_name"],
            "port_type": "sfp",
            "port_name": one["port_name"],
            "target_module_name": one["target_module_name"],
            "time_limit": time_limit_s,
        }
        for number, one in enumerate(connections, 1)
    }
    return yaml.safe_dump({"trials": {trial: {"tasks": tasks}}}, sort_keys=False)


def write_run(
    folder: Path,
    messages: Sequence[Mapping[str, Any]],
    *,
    connections: Sequence[Mapping[str, str]],
    times: Mapping[str, int | None] | None,
    buffer_s: float = 185.0,
    topics: Sequence[str] = (),
    trial: str = "trial_1",
) -> Path:
    """A run's folder with one recording, its configuration and its times; returns the recording."""
    folder.mkdir(parents=True, exist_ok=True)
    if connections:
        text = configuration(connections, time_limit_s=buffer_s - 5, trial=trial)
        (folder / "engine_config.yaml").write_text(text, encoding="utf-8")
    if times is not None:
        stated = {"trials": {trial: dict(times)}}
        text = "format: aic-task-times/1\n" + yaml.safe_dump(stated, sort_keys=False)
        (folder / "task_times.yaml").write_text(text, encoding="utf-8")
    return write_bag(folder / BAG.format(trial=trial), messages, topics=topics)
