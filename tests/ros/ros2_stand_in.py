"""Run the recorder's node of ROS 2 on a stand-in of rclpy, and write what was published as a recording.

No ROS 2 is needed: `rclpy` and the packages beside it are made here, as far as the node uses them. A graph in
this process carries messages as CDR bytes, gives a subscriber nothing that its profile does not fit, and
shows topics and services only once somebody offers them. Whether rclpy itself behaves so is not tried by it.

Usage: ros2_stand_in.py FOLDER SCENARIO, with FOLDER/plan.json; scenarios are the functions below.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.testing.bags import Recorded, _built, write_bag

STORE = bundled_typestore(2)
STRING_HASH = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
"""As `ros2 topic info --verbose` of Jazzy prints it for `std_msgs/msg/String`."""
BEGUN = time.monotonic()
VOLATILE, TRANSIENT_LOCAL, BEST_EFFORT, RELIABLE = "volatile", "transient_local", "best_effort", "reliable"


def now_ns() -> int:
    """Simulated time: it begins with the process, and runs as the wall clock does."""
    return round((time.monotonic() - BEGUN) * 1e9) + 1


@dataclass
class Profile:
    """What a publisher offers or a subscriber asks for."""

    depth: int = 10
    durability: str = VOLATILE
    reliability: str = RELIABLE

    def fits(self, offered: Profile) -> bool:
        """Whether a subscriber that asks for this gets messages of a publisher that offers that."""
        durable = self.durability == VOLATILE or offered.durability == TRANSIENT_LOCAL
        return durable and (self.reliability == BEST_EFFORT or offered.reliability == RELIABLE)


@dataclass
class Topic:
    """A topic that somebody publishes."""

    type: str
    offered: Profile
    kept: list[bytes] = field(default_factory=list)
    heard: list[tuple[Profile, Callable[[Any], None], bool]] = field(default_factory=list)


class Graph:
    """Who publishes, subscribes and offers what; and the bag, which records everything."""

    def __init__(self) -> None:
        self.topics: dict[str, Topic] = {}
        self.waiting: dict[str, list[tuple[Profile, Callable[[Any], None], bool]]] = {}
        self.services: dict[str, tuple[str, Callable[[Any], Any]]] = {}
        self.recorded: list[Recorded] = []
        self.lock = threading.RLock()

    def offer(self, topic: str, type_: str, profile: Profile) -> None:
        with self.lock:
            self.topics[topic] = Topic(type_, profile, heard=self.waiting.pop(topic, []))

    def publish(self, topic: str, fields: dict[str, Any]) -> None:
        with self.lock:
            about = self.topics[topic]
            self.recorded.append(Recorded(topic, about.type, now_ns(), fields))
            payload = encoded(about.type, fields)
            about.kept = [*about.kept, payload] if about.offered.durability == TRANSIENT_LOCAL else []
            heard = [(call, raw) for asked, call, raw in about.heard if asked.fits(about.offered)]
        for call, raw in heard:
            call(payload if raw else decoded(payload, about.type))

    def hear(self, topic: str, asked: Profile, call: Callable[[Any], None], *, raw: bool) -> None:
        with self.lock:
            about = self.topics.get(topic)
            if about is None:
                self.waiting.setdefault(topic, []).append((asked, call, raw))
                return
            about.heard.append((asked, call, raw))
            kept = (
                list(about.kept) if asked.durability == TRANSIENT_LOCAL and asked.fits(about.offered) else []
            )
        for payload in kept:
            call(payload if raw else decoded(payload, about.type))


GRAPH = Graph()


def encoded(type_: str, fields: dict[str, Any]) -> bytes:
    return bytes(STORE.serialize_cdr(_built(STORE, type_, fields), type_, little_endian=True))


def decoded(payload: bytes, type_: str) -> Any:
    return STORE.deserialize_cdr(payload, type_)


def message_class(type_: str) -> type:
    """A class as ROS 2 generates it: fields by keyword, and a header whose stamp can be set."""

    def make(self: Any, **fields: Any) -> None:
        known = {name for name, _ in STORE.fielddefs[type_][1]}
        if unknown := fields.keys() - known:
            raise AssertionError(f"{type_} has no fields {sorted(unknown)}")
        self.__dict__.update(fields)
        if "header" in known:
            self.header = SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0))

    return type(type_.rpartition("/")[2], (), {"__init__": make, "TYPE": type_})


def fields_of(message: Any) -> dict[str, Any]:
    fields = dict(vars(message))
    if "header" in fields:
        stamp = fields["header"].stamp
        fields["header"] = {"stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec}, "frame_id": ""}
    return fields


class Publisher:
    """A publisher of the node."""

    def __init__(self, made: Any, topic: str, profile: Any) -> None:
        self.topic = topic
        GRAPH.offer(topic, made.TYPE, profile if isinstance(profile, Profile) else Profile(profile))

    def publish(self, message: Any) -> None:
        GRAPH.publish(self.topic, fields_of(message))

    def get_subscription_count(self) -> int:
        """Those of the graph, and the bag."""
        return len(GRAPH.topics[self.topic].heard) + 1


class Node:
    """What the recorder asks of a node."""

    def create_publisher(self, made: Any, topic: str, profile: Any) -> Publisher:
        return Publisher(made, topic, profile)

    def create_subscription(
        self, made: Any, topic: str, call: Any, profile: Any, *, callback_group: Any, raw: bool = False
    ) -> None:
        assert callback_group is not None
        assert made.TYPE
        asked = profile if isinstance(profile, Profile) else Profile(profile)
        GRAPH.hear(topic, asked, call, raw=raw)

    def get_parameter(self, name: str) -> Any:
        assert name == "use_sim_time"
        return SimpleNamespace(value=True)

    def get_clock(self) -> Any:
        ns = now_ns()
        stamp = SimpleNamespace(sec=ns // 10**9, nanosec=ns % 10**9)
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=ns, to_msg=lambda: stamp))

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        return [(name, [about.type]) for name, about in GRAPH.topics.items()]

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        about = GRAPH.topics.get(topic)
        kinds = {"std_msgs/msg/String": STRING_HASH}  # a type hash is a class with this text; Humble has none
        hashes = {"topic_type_hash": kinds[about.type]} if about and about.type in kinds else {}
        return [SimpleNamespace(qos_profile=about.offered, **hashes)] if about else []

    def get_service_names_and_types(self) -> list[tuple[str, list[str]]]:
        return [(name, [kind]) for name, (kind, _) in GRAPH.services.items()]

    def create_client(self, kind: Any, service: str, *, callback_group: Any) -> Any:
        assert callback_group is not None
        assert kind == GRAPH.services[service][0]

        async def call_async(request: Any) -> Any:
            await asyncio.sleep(0.01)
            return GRAPH.services[service][1](request)

        return SimpleNamespace(call_async=call_async)

    def create_service(self, kind: Any, name: str, call: Any, *, callback_group: Any) -> Any:
        assert callback_group is not None
        GRAPH.services[name] = kind, lambda request: asyncio.run(call(request, SimpleNamespace()))
        return SimpleNamespace()


class Executor:
    """Spins until it is shut down; the graph calls back on the thread that publishes."""

    def __init__(self) -> None:
        self._done = threading.Event()

    def add_node(self, node: Node) -> None:
        assert isinstance(node, Node)

    def spin(self) -> None:
        self._done.wait()

    def shutdown(self, *, timeout_sec: float) -> None:
        assert timeout_sec > 0
        self._done.set()


def install() -> None:
    """Make the modules that the node imports."""

    def module(name: str, **names: Any) -> None:
        made = ModuleType(name)
        made.__dict__.update(names)
        sys.modules[name] = made

    def init(*, args: Iterable[str], signal_handler_options: str) -> None:
        assert signal_handler_options == "no"
        assert list(args)

    module("rclpy", init=init, create_node=lambda _name: Node(), try_shutdown=lambda: None)
    module("rclpy.callback_groups", ReentrantCallbackGroup=object)
    module("rclpy.executors", MultiThreadedExecutor=Executor)
    durabilities = SimpleNamespace(VOLATILE=VOLATILE, TRANSIENT_LOCAL=TRANSIENT_LOCAL)
    reliabilities = SimpleNamespace(BEST_EFFORT=BEST_EFFORT, RELIABLE=RELIABLE)
    module("rclpy.qos", DurabilityPolicy=durabilities, ReliabilityPolicy=reliabilities, QoSProfile=Profile)
    module("rclpy.serialization", deserialize_message=lambda payload, made: decoded(payload, made.TYPE))
    module("rclpy.signals", SignalHandlerOptions=SimpleNamespace(NO="no"))
    module("rclpy.utilities", remove_ros_args=lambda words: list(words[: words.index("--ros-args")]))
    names = ("Heartbeat", "Manifest", "Submission", "TrialEvent")
    module("ariac_score_msgs")
    module("ariac_score_msgs.msg", **{n: message_class(f"ariac_score_msgs/msg/{n}") for n in names})
    module("rosidl_runtime_py")

    def get_message(kind: str) -> type:
        if kind.startswith("missing_msgs/"):
            raise ModuleNotFoundError(f"No module named {kind.split('/', maxsplit=1)[0]!r}")
        return message_class(kind)

    module("rosidl_runtime_py.utilities", get_message=get_message, get_service=lambda kind: kind)


# Scenarios: what happens beside the recorder


def until(holds: Callable[[], Any]) -> None:
    while not holds():
        time.sleep(0.01)


def whole() -> None:
    """A trial of its own way: late publishers of all profiles, a call that is passed on, the last word."""
    GRAPH.offer("/ariac/competition_state", "std_msgs/msg/String", Profile())
    GRAPH.offer("/once", "std_msgs/msg/String", Profile(durability=TRANSIENT_LOCAL))
    GRAPH.publish("/once", {"data": "sent before anybody listened"})
    until(lambda: GRAPH.topics.get("/ariac_score/manifest") and GRAPH.topics["/ariac_score/manifest"].kept)
    GRAPH.offer("/lossy", "std_msgs/msg/String", Profile(reliability=BEST_EFFORT))
    GRAPH.offer("/unknown", "missing_msgs/msg/Odd", Profile())
    GRAPH.services["/submit"] = "cell_msgs/srv/Submit", lambda _: SimpleNamespace(success=True)
    until(lambda: GRAPH.topics["/lossy"].heard and "/scoring/submit" in GRAPH.services)
    for word in ("init", "go"):
        GRAPH.publish("/ariac/competition_state", {"data": word})
        GRAPH.publish("/lossy", {"data": word})
        time.sleep(0.2)

    class Request:
        @classmethod
        def get_fields_and_field_types(cls) -> dict[str, str]:
            return {"order_id": "string"}

        order_id = "order_0"

    GRAPH.services["/scoring/submit"][1](Request())
    GRAPH.publish("/ariac/competition_state", {"data": "done"})


def other() -> None:
    """Another recorder runs already."""
    until(lambda: "/ariac_score/heartbeat" in GRAPH.topics)
    GRAPH.publish(
        "/ariac_score/heartbeat", {"recording": "ab" * 16, "sequence": 1, "body": "{}", "chain": ""}
    )


def ended() -> None:
    """Whoever runs the recorder ends it."""
    GRAPH.offer("/ariac/competition_state", "std_msgs/msg/String", Profile())
    until(lambda: GRAPH.topics.get("/ariac_score/manifest") and GRAPH.topics["/ariac_score/manifest"].kept)
    os.kill(os.getpid(), signal.SIGTERM)


def main() -> int:
    """Run the node beside a scenario."""
    folder, scenario = Path(sys.argv[1]), {"whole": whole, "other": other, "ended": ended}[sys.argv[2]]
    install()
    sys.path.insert(0, str(Path(__file__).parents[2] / "ros/ariac_score_recorder/src"))
    from ariac_score_recorder.ros2 import main as recorder  # noqa: PLC0415  # imports what was made above

    beside = threading.Thread(target=scenario, daemon=True)
    beside.start()
    key = ["--key", str(folder / "organiser")] if (folder / "organiser").exists() else []
    words = ["recorder", "--plan", str(folder / "plan.json"), "--out", str(folder / "trial"), *key]
    code = int(recorder([*words, "--wait-s", "3", "--ros-args", "-p", "use_sim_time:=true"]))
    write_bag(
        folder / "trial.mcap", [m for m in GRAPH.recorded if "missing_msgs" not in m.type], storage="mcap"
    )
    return code


if __name__ == "__main__":
    sys.exit(main())
