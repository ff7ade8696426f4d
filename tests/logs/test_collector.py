"""Messages decoded together against messages decoded one by one: the same trial, the same refusals."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.checks.contracts import Wanted
from ariac_score.errors import LogError
from ariac_score.logs.columnar.types import bundled_typestore
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.logs.gather import collector
from ariac_score.logs.gather.collector import Collector
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import BodyMatch, Channel, FieldMap, LogMap, PluginUse
from ariac_score.trial.clock import Clock
from ariac_score.trial.spans import Span
from ariac_score_ariac.kit_from_poses import KitsOfModels, TrayMatch

ORIGIN_NS = 1_585_866_235_112_411_371
TF, STATES, LINKS = "tf2_msgs/msg/TFMessage", "gazebo_msgs/msg/ModelStates", "gazebo_msgs/msg/LinkStates"
VECTOR, WRENCH, POSE = (
    "geometry_msgs/msg/Vector3",
    "geometry_msgs/msg/Wrench",
    "geometry_msgs/msg/PoseStamped",
)
NAMES = ["world", "base", "/torso", "arm", "hand", "human", "ghost"]
MODELS = ["human", "agv1", "gear_part_red_1", "table", "agv1::tray", "gear_part_red_1::link"]


class Recording:
    """Random messages on the topics of the log map, some of them damaged or odd."""

    def __init__(self, dice: random.Random, *, encoding: str) -> None:
        self.dice, self.ros1 = dice, encoding == "ros1"
        self.store = bundled_typestore(1 if self.ros1 else 2)
        topics = [("/tf", TF), ("/tf", TF), ("/tf_static", TF), ("/states", STATES), ("/states", STATES)]
        topics += [("/links", LINKS), ("/speed", VECTOR), ("/speed", VECTOR), ("/place", POSE)]
        topics += [("/odd", WRENCH), ("/other", VECTOR)]
        self.connections = [Connection(topic, type_, encoding) for topic, type_ in topics]
        self.clock_jumps = dice.random() < 0.15
        stamps = ORIGIN_NS + np.cumsum([dice.choice([0, 1, 10**6, 2 * 10**7]) for _ in range(200)])
        self.items: list[Connection | Message] = list(self.connections)
        for stamp_ns in stamps.tolist():
            connection = dice.choice(self.connections)
            payload = self._serialised(self._message(connection.type, stamp_ns), connection.type)
            if dice.random() < 0.05:
                payload = payload[: dice.randrange(len(payload))]
            self.items.append(Message(connection, stamp_ns, payload))

    def _serialised(self, message: Any, type_: str) -> bytes:
        if self.ros1:
            return bytes(self.store.serialize_ros1(message, type_))
        return bytes(self.store.serialize_cdr(message, type_, little_endian=self.dice.random() < 0.9))

    def _make(self, name: str, *values: Any) -> Any:
        return self.store.types[name](*values)

    def _number(self) -> float:
        dice = self.dice
        return dice.choice([0.0, 1.0, dice.uniform(-3, 3), dice.uniform(-3, 3), float("nan"), 1e300, -0.0])

    def _vector(self) -> Any:
        return self._make(VECTOR, self._number(), self._number(), self._number())

    def _rotation(self) -> Any:
        turns = [
            (0.0, 0.0, 0.0, 1.0),
            (0.6, 0.0, 0.0, 0.8),
            (0.0, 0.0, 1.01, 0.0),
            (0.0, 0.0, 1.0100001, 0.0),
        ]
        return self._make("geometry_msgs/msg/Quaternion", *self.dice.choice([*turns, turns[0], turns[1]]))

    def _pose(self) -> Any:
        at = self._make("geometry_msgs/msg/Point", *(self.dice.uniform(-1, 1) for _ in range(3)))
        return self._make("geometry_msgs/msg/Pose", at, self._rotation())

    def _header(self, stamp_ns: int, frame: str = "world") -> Any:
        late = (
            self.dice.choice([61 * 10**9, -61 * 10**9])
            if self.clock_jumps and self.dice.random() < 0.03
            else 0
        )
        sec, nanosec = divmod(stamp_ns + late - self.dice.choice([0, 0, 10**6]), 10**9)
        stamp = self._make("builtin_interfaces/msg/Time", sec, nanosec)
        seq = [7] if self.ros1 else []
        return self._make("std_msgs/msg/Header", *seq, stamp, frame)

    def _message(self, type_: str, stamp_ns: int) -> Any:
        dice = self.dice
        if type_ == TF:
            return self._make(TF, [self._transform(stamp_ns) for _ in range(dice.choice([0, 1, 1, 2, 3]))])
        if type_ in (STATES, LINKS):
            names = dice.sample(MODELS, dice.randrange(len(MODELS)))
            poses, twists = ([f() for _ in names] for f in (self._pose, self._twist))
            if dice.random() < 0.05:
                poses.append(self._pose())
            return self._make(type_, names, poses, twists)
        if type_ == VECTOR:
            return self._vector()
        if type_ == WRENCH:
            return self._make(WRENCH, self._vector(), self._vector())
        return self._make(POSE, self._header(stamp_ns), self._pose())

    def _twist(self) -> Any:
        return self._make("geometry_msgs/msg/Twist", self._vector(), self._vector())

    def _transform(self, stamp_ns: int) -> Any:
        parent, child = self.dice.choice([(0, 1), (1, 2), (2, 3), (3, 4), (0, 5), (0, 1), (1, 2)])
        transform = self._make("geometry_msgs/msg/Transform", self._vector(), self._rotation())
        header = self._header(stamp_ns, NAMES[parent])
        return self._make("geometry_msgs/msg/TransformStamped", header, NAMES[child], transform)


TRAY = TrayMatch("{place}::tray", 1.0, 1.0, 1.0)
LOG_MAP = LogMap(
    "test",
    (
        Channel("/tf", poses="frames", stamp="header"),
        Channel("/tf_static", poses="frames", stamp="header"),
        Channel("/states", poses="models"),
        Channel("/links", poses="models"),
        Channel("/speed", VECTOR, signals=(FieldMap("speed/human", "m/s", ("x",)),), witnesses=("w",)),
        Channel(
            "/place",
            POSE,
            stamp="header",
            signals=(
                FieldMap("position/agv2", "m", tuple(f"pose.position.{a}" for a in "xyz")),
                FieldMap("speed/agv2", "m/s", ("pose.position.x",)),
            ),
        ),
        Channel(
            "/odd",
            signals=(FieldMap("speed/odd", "m/s", ("force.q",)), FieldMap("speed/x", "m/s", ("force.x",))),
        ),
    ),
    models=(BodyMatch("human", "human"), BodyMatch("agv*", "agv", links=("tray",))),
    frames=(BodyMatch("torso", "robot", "gantry", links=("arm", "hand")), BodyMatch("ghost", "human")),
    root_frame="world",
    tracks=PluginUse("ariac.models"),
)


def gathered(items: list[Any], flush_every: int | None, *, together: bool) -> Any:
    """What is built of the items, or how they are refused."""
    with pytest.MonkeyPatch.context() as patch:
        if not together:
            patch.setattr(collector, "columns_for", lambda *_: None)
        quantities = frozenset({"speed", "position", "velocity"})
        taken = Collector(
            Wanted(LOG_MAP, quantities, tracks=KitsOfModels(products=("gear_part*",), trays=(TRAY,))),
            Path("t.bag"),
        )
        builder = TrialBuilder("t", file="t.bag", clock=Clock("log time"))
        builder.recorded = Span(0.0, 9.0)
        try:
            for number, item in enumerate(items):
                taken.take(item)
                if flush_every and number % flush_every == 0:
                    taken.flush()
            taken.settle(builder, ORIGIN_NS)
        except LogError as error:
            return str(error), error.hint
    signals = {
        name: (s.unit, s.t.tobytes(), s.values.shape, s.values.tobytes())
        for name, s in builder.signals.items()
    }
    kits = [
        [(t.name, t.frames.tolist(), t.poses.tobytes(), t.deleted.tolist()) for t in record._tracks]  # type: ignore[attr-defined]
        for record in builder.records
    ]
    defects = sorted(map(repr, builder._defects.values()))
    return signals, builder.bodies, builder.unrecorded, builder.witnessed, defects, kits


@pytest.mark.parametrize(("encoding", "flush_every"), [("cdr", None), ("ros1", 60)])
@pytest.mark.parametrize("seed", range(3))
def test_the_same_as_one_by_one_in_a_few_recordings(
    seed: int, encoding: str, flush_every: int | None
) -> None:
    assert_the_same_as_one_by_one(seed, encoding, flush_every)


@pytest.mark.slow
@settings(max_examples=80)
@given(st.integers(0, 2**32), st.sampled_from(["cdr", "ros1"]), st.sampled_from([None, 1, 7, 60]))
def test_the_same_as_one_by_one(seed: int, encoding: str, flush_every: int | None) -> None:
    assert_the_same_as_one_by_one(seed, encoding, flush_every)


def assert_the_same_as_one_by_one(seed: int, encoding: str, flush_every: int | None) -> None:
    items = Recording(random.Random(seed), encoding=encoding).items  # noqa: S311  # dice, not secrets

    assert gathered(items, flush_every, together=True) == gathered(items, None, together=False)


@pytest.mark.slow
def test_the_situations_above_do_occur() -> None:
    """Without damage to clocks there are signals of every kind, and with it there are refusals."""
    found: set[str] = set()
    refused = 0
    for seed in range(40):
        items = Recording(random.Random(seed), encoding="cdr").items  # noqa: S311  # dice, not secrets
        result = gathered(items, None, together=True)
        if isinstance(result[0], str):
            refused += 1
        else:
            found |= set(result[0])
            found |= {"defect" for _ in result[4]} | {"kit" for kit in result[5] if kit}
    assert refused
    assert {"position/gantry", "position/human", "speed/human", "speed/agv2", "defect", "kit"} <= found
