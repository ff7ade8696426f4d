"""A cell over DDS, as a process of its own: publishes what it is told to, line by line.

The types are written by hand after rosidl's mapping of ROS to IDL, not made by what they are to test; only
raw bytes of other types come by a type of their definition. No node of ROS 2 was at hand.
"""
# No postponed annotations here: the library cannot resolve them.

import base64
import json
import os
import sys
from dataclasses import dataclass
from typing import Any

from cyclonedds._clayer import ddspy_write
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import float64, int32, sequence, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.topic import Topic

from ariac_score.live.dds import struct_of

CONFIG = """
<CycloneDDS><Domain><General><Interfaces><NetworkInterface address="127.0.0.1"/></Interfaces>
<AllowMulticast>false</AllowMulticast></General>
<Discovery><ParticipantIndex>auto</ParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>
<Internal><Test><XmitLossiness>%d</XmitLossiness></Test></Internal></Domain></CycloneDDS>"""


@dataclass
class Word(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32
    nanosec: uint32


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str


@dataclass
class Vector(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    x: float64
    y: float64
    z: float64


@dataclass
class Turn(IdlStruct, typename="geometry_msgs::msg::dds_::Quaternion_"):
    x: float64
    y: float64
    z: float64
    w: float64


@dataclass
class Transform(IdlStruct, typename="geometry_msgs::msg::dds_::Transform_"):
    translation: Vector
    rotation: Turn


@dataclass
class Stamped(IdlStruct, typename="geometry_msgs::msg::dds_::TransformStamped_"):
    header: Header
    child_frame_id: str
    transform: Transform


@dataclass
class Frames(IdlStruct, typename="tf2_msgs::msg::dds_::TFMessage_"):
    transforms: sequence[Stamped]


@dataclass
class Odd(IdlStruct, typename="ours::msg::dds_::Odd_"):
    data: str


OWN = {"std_msgs/msg/String": Word, "tf2_msgs/msg/TFMessage": Frames, "ours/msg/Odd": Odd}


def run() -> None:
    """Obey until the input ends."""
    domain, lost_per_mille = map(int, sys.argv[1:])
    os.environ["CYCLONEDDS_URI"] = CONFIG % lost_per_mille
    participant = DomainParticipant(domain)
    writers: dict[str, Any] = {}
    _answer("ready")
    for line in sys.stdin:
        said = json.loads(line)
        topic = said.get("topic", "")
        if said["do"] == "offer":
            policies = [
                Policy.Reliability.Reliable(10**11) if said["reliable"] else Policy.Reliability.BestEffort,
                Policy.Durability.TransientLocal if said["latched"] else Policy.Durability.Volatile,
                Policy.History.KeepLast(said["keeps"]),
            ]
            if said["hash"]:
                policies.append(Policy.Userdata(f"typehash={said['hash']};".encode()))
            kind = OWN.get(said["type"]) or struct_of(said["type"])
            about = Topic(participant, f"rt/{topic.strip('/')}", kind)
            writers[topic] = DataWriter(participant, about, qos=Qos(*policies))
        elif said["do"] == "say":
            writers[topic].write(Word(said["word"]) if "word" in said else frames(said["frames"]))
        elif said["do"] == "bytes":
            write_bytes(writers[topic], base64.b64decode(said["raw"]))
            continue  # many of them come, and nobody waits for an answer
        elif said["do"] == "leave":
            del writers[topic]
        matched = {name: len(writer.get_matched_subscriptions()) for name, writer in writers.items()}
        _answer(json.dumps(matched))


def _answer(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def frames(x_m: float) -> Frames:
    """One transform."""
    turn = Turn(0.0, 0.0, 0.0, 1.0)
    return Frames([Stamped(Header(Time(5, 7), "world"), "tool", Transform(Vector(x_m, 2.0, 3.0), turn))])


def write_bytes(writer: Any, raw: bytes) -> None:
    """Write a message that is CDR already."""
    assert ddspy_write(writer._ref, raw.ljust(-(-len(raw) // 4) * 4, b"\0")) >= 0


if __name__ == "__main__":
    run()
