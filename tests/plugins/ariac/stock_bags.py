"""Recordings of what an unmodified simulator publishes, in the definitions of its own edition."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

import ariac_score_ariac
from ariac_score.logs.columnar.service_events import event_definition
from ariac_score.testing import bags
from ariac_score.testing.bags import Recorded, write_bag

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

DEFINITIONS = Path(__file__).parents[3].parent / "shared" / "ros" / "definitions"
OURS = Path(ariac_score_ariac.__file__).parent / "msg" / "ariac_score_msgs"
FOLDERS = {"2021": "2021_finals"}
ROS_1 = ("2017", "2018", "2019", "2020", "2021", "2022")
S = 10**9
START_S = 10.0
"""Competitions start some seconds after the simulation does, for the service is not there before."""


@cache
def typestore(edition: str) -> Typestore:
    """The types of an edition, from the simulator's own definitions."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: PLC0415  # slow

    folder = DEFINITIONS / FOLDERS.get(edition, edition)
    if not folder.is_dir():
        pytest.skip("the definitions of the simulators (../shared/ros/definitions) are not here")
    ros_1 = edition in ROS_1
    store: Typestore = get_typestore(Stores.ROS1_NOETIC if ros_1 else Stores.ROS2_JAZZY)
    common = DEFINITIONS / ("ros1_common" if ros_1 else "ros2_common")
    types: dict[str, Any] = {}
    ours = [] if ros_1 else sorted(OURS.glob("*.msg"))
    for file in sorted([*folder.rglob("*.msg"), *common.rglob("*.msg"), *ours]):
        name = f"{file.parent.name if file in ours else file.parts[-3]}/msg/{file.stem}"
        if name not in store.fielddefs:
            types |= get_types_from_msg(file.read_text(encoding="utf-8"), name)
    services = [] if ros_1 else [*folder.rglob("Submit*Order.srv"), *folder.rglob("Trigger.srv")]
    for file in sorted(services):
        name = f"{file.parts[-3]}/srv/{file.stem}_Event"
        found = get_types_from_msg(event_definition(name, file.read_text(encoding="utf-8")), name)
        types |= {kind.replace("/srv/msg/", "/srv/"): fields for kind, fields in found.items()}
    store.register({name: fields for name, fields in types.items() if name not in store.fielddefs})
    return store


def stock_bag(
    path: Path, edition: str, messages: Iterable[Recorded], monkeypatch: pytest.MonkeyPatch
) -> Path:
    """A recording with the definitions of an edition: ROS 1 until 2022, MCAP from 2023 on."""
    store = typestore(edition)
    monkeypatch.setattr(bags, "bundled_typestore", lambda _ros: store)
    in_order = sorted(messages, key=lambda message: message.t_ns)
    storage = "ros1" if edition in ROS_1 else "mcap"
    return write_bag(path.with_suffix(".bag" if edition in ROS_1 else ".mcap"), in_order, storage=storage)  # type: ignore[arg-type]


def at(t_s: float, topic: str, type_: str, **fields: Any) -> Recorded:
    """A message at a time since the start of the competition; stamps are simulated time."""
    return Recorded(topic, type_, round((START_S + t_s) * S), fields)


def said(t_s: float, text: str, *, node: str = "/gazebo", level: int = 2) -> Recorded:
    """A line of the console of ROS 1, which has its stamp in the header."""
    stamp = {"sec": math.floor(START_S + t_s), "nanosec": round((START_S + t_s) % 1 * S)}
    header = {"stamp": stamp, "frame_id": ""}
    return at(t_s, "/rosout", "rosgraph_msgs/msg/Log", header=header, level=level, name=node, msg=text)


def logged(t_s: float, text: str, *, node: str = "task_manager") -> Recorded:
    """A line of the console of ROS 2, whose stamp is wall time."""
    wall = {"sec": 1_700_000_000 + math.floor(t_s * 1.7), "nanosec": 0}
    return at(t_s, "/rosout", "rcl_interfaces/msg/Log", stamp=wall, level=20, name=node, msg=text)


def words_of_state(*changes: tuple[float, str], until_s: float) -> list[Recorded]:
    """`/ariac/competition_state` of 2017 to 2022 at 10 Hz: a word holds until the next one."""
    found = []
    for tenth in range(round((until_s + 5) * 10)):
        t_s = tenth / 10 - 5
        word = [word for from_s, word in changes if from_s <= t_s][-1]
        found.append(at(t_s, "/ariac/competition_state", "std_msgs/msg/String", data=word))
    return found


def numbers_of_state(*changes: tuple[float, int], until_s: float) -> list[Recorded]:
    """`/ariac/competition_state` of 2023 and 2024 at 10 Hz."""
    found = []
    for tenth in range(round((until_s + 5) * 10)):
        t_s = tenth / 10 - 5
        number = [number for from_s, number in changes if from_s <= t_s][-1]
        type_ = "ariac_msgs/msg/CompetitionState"
        found.append(at(t_s, "/ariac/competition_state", type_, competition_state=number))
    return found


def pose(xyz: Sequence[float], rpy: Sequence[float] = (0, 0, 0)) -> dict[str, Any]:
    """A pose, of fixed-axis angles."""
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in rpy)
    turn = {
        "w": cr * cp * cy + sr * sp * sy,
        "x": sr * cp * cy - cr * sp * sy,
        "y": cr * sp * cy + sr * cp * sy,
        "z": cr * cp * sy - sr * sp * cy,
    }
    return {"position": dict(zip("xyz", map(float, xyz), strict=True)), "orientation": turn}


def given_pose(given: Mapping[str, Any]) -> dict[str, Any]:
    """A pose as official vectors write it."""
    turn = dict(zip("wxyz", given["orientation_wxyz"], strict=True))
    return {"position": dict(zip("xyz", given["position_m"], strict=True)), "orientation": turn}


def every_second(
    until_s: float, message: Callable[[float], Recorded], *, from_s: float = -3.0, period_s: float = 1.0
) -> list[Recorded]:
    """Contents of a tray as its contact sensor lets its plugin publish them: once a second."""
    count = math.floor((until_s - from_s) / period_s) + 1
    return [message(from_s + i * period_s) for i in range(count)]
