"""Times of what a sender stamped and of what it did not, on one clock or on two, in every container."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score.checks.contracts import Decoder, Wanted
from ariac_score.errors import LogError
from ariac_score.logs.rosbag import RosbagReader
from ariac_score.testing.bags import Recorded, Storage, write_bag
from ariac_score.trial.channels import BodyMatch, Channel, FieldMap, LogMap
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.model import Body, Trial
from ariac_score_ariac.messages import NistGear2020

S = 10**9
WALL_NS = 1_700_000_000 * S
SPEED_M_S = 0.5
DELAYS_NS = (1_000_000, 60_000_000, 3_000_000, 88_000_000, 2_000_000, 41_000_000)
"""From sender to recorder, as on a busy machine; two messages of a run may change places."""

TF, STATE, CLOCK = "tf2_msgs/msg/TFMessage", "std_msgs/msg/String", "rosgraph_msgs/msg/Clock"
POINT = "geometry_msgs/msg/PointStamped"
FRAMES = BodyMatch("human_base", "human", "human")
STATES = Channel("/state", decoder="gear")
PLACE = Channel("/place", POINT, signals=(FieldMap("speed/human", "m/s", ("point.x",)),))

stores = pytest.mark.parametrize(
    ("storage", "name"), [("ros1", "t.bag"), ("sqlite3", "t.db3"), ("mcap", "t.mcap")]
)


def header(stamp_ns: int) -> dict[str, Any]:
    return {"stamp": {"sec": stamp_ns // S, "nanosec": stamp_ns % S}, "frame_id": "world"}


def walking(stamp_ns: int, log_ns: int, *, x: float, topic: str = "/tf") -> Recorded:
    transform = {"translation": {"x": x}, "rotation": {"w": 1.0}}
    stamped = {"header": header(stamp_ns), "child_frame_id": "human_base", "transform": transform}
    return Recorded(topic, TF, log_ns, {"transforms": [stamped]})


def walk(own_ns: int, log_ns: int, *, rate: float = 1.0, seconds: float = 4.0) -> Iterator[Recorded]:
    """A human who walks at 0.5 m/s by a clock that runs `rate` times as fast as the recorder's."""
    for i in range(int(seconds * 50)):
        since_ns = i * 20_000_000
        delay_ns = DELAYS_NS[i % len(DELAYS_NS)]
        yield walking(
            own_ns + since_ns, log_ns + round(since_ns / rate) + delay_ns, x=SPEED_M_S * since_ns / S
        )


def state(word: str, log_ns: int) -> Recorded:
    return Recorded("/state", STATE, log_ns, {"data": word})


def tick(simulated_ns: int, log_ns: int) -> Recorded:
    return Recorded(
        "/clock", CLOCK, log_ns, {"clock": {"sec": simulated_ns // S, "nanosec": simulated_ns % S}}
    )


def read(
    path: Path, messages: Sequence[Recorded], storage: Storage = "mcap", *channels: Channel, stamp: str = ""
) -> Trial:
    chosen = channels or (Channel("/tf", TF, poses="frames", stamp=stamp), STATES)
    log_map = LogMap("t", chosen, frames=(FRAMES,) if not channels else ())
    decoders: dict[str, Decoder] = {"gear": NistGear2020()}
    write_bag(path, sorted(messages, key=lambda m: m.t_ns), storage=storage)
    return RosbagReader().read(path, Wanted(log_map, frozenset({"position", "speed"}), decoders))


def speeds_m_s(trial: Trial) -> Any:
    return derive_signals(trial, [Derivation("speed", 0.2)]).signals["speed/human"].values


@stores
def test_a_stamped_message_is_where_its_header_says_however_late_it_came(
    tmp_path: Path, storage: Storage, name: str
) -> None:
    trial = read(tmp_path / name, [*walk(WALL_NS, WALL_NS), state("go", WALL_NS + S)], storage)

    np.testing.assert_allclose(speeds_m_s(trial), SPEED_M_S, atol=1e-6)
    # The first message was recorded a millisecond after it was stamped.
    assert trial.clock == f"log time, origin {WALL_NS + 1_000_000} ns"
    assert trial.signals["position/human"].t[0] == pytest.approx(-0.001)
    assert trial.started_s == pytest.approx(0.999)
    assert [d.kind for d in trial.log_defects] == ["disordered_stamps"]  # the order in which they came


def test_a_log_map_may_choose_the_times_of_recording(tmp_path: Path) -> None:
    trial = read(tmp_path / "t.mcap", list(walk(WALL_NS, WALL_NS)), stamp="log")

    assert np.ptp(speeds_m_s(trial)) > 0.1  # the delays have become motion


@stores
def test_what_is_recorded_in_simulated_time_needs_no_clock_messages(
    tmp_path: Path, storage: Storage, name: str
) -> None:
    messages = [*walk(7 * S, 7 * S), state("go", 8 * S), tick(7 * S, 7 * S)]
    trial = read(tmp_path / name, messages, storage)

    np.testing.assert_allclose(speeds_m_s(trial), SPEED_M_S, atol=1e-6)
    assert (trial.clock, trial.started_s) == ("log time, origin 7000000000 ns", 1.0)


@stores
@pytest.mark.parametrize("rate", [0.5, 1.0, 2.0])
def test_clock_messages_bring_wall_time_to_simulated_time(
    tmp_path: Path, storage: Storage, name: str, rate: float
) -> None:
    ticks = [tick(5 * S + i * S // 10, WALL_NS + round(i * S / 10 / rate)) for i in range(80)]
    states = [state("go", WALL_NS + round(2.05 * S / rate)), state("done", WALL_NS + round(3.5 * S / rate))]
    trial = read(tmp_path / name, [*walk(5 * S, WALL_NS, rate=rate), *ticks, *states], storage)

    np.testing.assert_allclose(speeds_m_s(trial), SPEED_M_S, atol=1e-6)
    assert trial.clock == "simulated time"
    assert trial.recorded is not None
    assert trial.recorded.start_s == 5.0  # of the simulator's own zero, as in its other logs
    assert (trial.started_s, trial.ended_s) == (pytest.approx(7.05), pytest.approx(8.5))


def test_signals_without_a_stamp_come_to_simulated_time_too(tmp_path: Path) -> None:
    ticks = [tick(5 * S + i * S // 10, WALL_NS + i * S // 5) for i in range(80)]
    vector = "geometry_msgs/msg/Vector3"
    plain = [Recorded("/speed", vector, WALL_NS + i * S // 10, {"x": 0.1 * i}) for i in range(5)]
    channels = (PLACE, Channel("/speed", vector, signals=(FieldMap("speed/robot", "m/s", ("x",)),)))
    stamped = [Recorded("/place", POINT, WALL_NS + i * S, {"header": header(6 * S + i)}) for i in range(3)]

    trial = read(tmp_path / "t.mcap", [*ticks, *plain, *stamped], "mcap", *channels)

    assert trial.signals["speed/robot"].t.tolist() == pytest.approx([5.0, 5.05, 5.1, 5.15, 5.2])


def test_two_clocks_that_nothing_relates_are_refused_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(
        LogError, match="two clocks are mixed: on topic /tf the header says 5000000000 ns"
    ) as e:
        read(tmp_path / "t.mcap", [*walk(5 * S, WALL_NS), state("go", WALL_NS + S)])
    assert "/clock" in e.value.hint
    assert "stamp: log" in e.value.hint


def test_a_third_clock_is_refused(tmp_path: Path) -> None:
    ticks = [tick(5 * S + i * S // 10, WALL_NS + i * S // 10) for i in range(50)]
    with pytest.raises(LogError, match="two clocks are mixed"):
        read(tmp_path / "t.mcap", [*walk(500 * S, WALL_NS), *ticks])


def test_one_message_on_another_clock_than_the_rest_of_its_topic_is_refused(tmp_path: Path) -> None:
    messages = [*walk(WALL_NS, WALL_NS), walking(5 * S, WALL_NS + 2 * S, x=1.0)]
    with pytest.raises(LogError, match=r"two clocks are mixed.*; 200 messages of that topic"):
        read(tmp_path / "t.mcap", messages)


@pytest.mark.parametrize(("silent_s", "refused"), [(0.9, False), (2.5, True)])
def test_a_time_at_which_the_clock_was_not_heard_is_refused(
    tmp_path: Path, silent_s: float, refused: bool
) -> None:
    heard = [i for i in range(80) if not 2.0 < i / 10 < 2.0 + silent_s]
    ticks = [tick(50 * S + i * S // 10, WALL_NS + i * S // 10) for i in heard]
    messages = [*walk(50 * S, WALL_NS), *ticks, state("go", WALL_NS + round((2.0 + silent_s / 2) * S))]

    if not refused:
        assert read(tmp_path / "t.mcap", messages).started_s == pytest.approx(52.45)
        return
    with pytest.raises(LogError, match="nobody knows the simulated time of a message on topic /state"):
        read(tmp_path / "t.mcap", messages)


@pytest.mark.parametrize(("late_s", "refused"), [(0.9, False), (1.1, True)])
def test_behind_the_last_clock_message_time_is_known_for_a_second(
    tmp_path: Path, late_s: float, refused: bool
) -> None:
    ticks = [tick(50 * S + i * S // 10, WALL_NS + i * S // 10) for i in range(41)]
    messages = [*walk(50 * S, WALL_NS), *ticks, state("done", WALL_NS + round((4.0 + late_s) * S))]

    if refused:
        with pytest.raises(LogError, match="nobody knows the simulated time"):
            read(tmp_path / "t.mcap", messages)
    else:
        assert read(tmp_path / "t.mcap", messages).ended_s == 54.0


def test_while_a_simulation_pauses_its_time_is_known(tmp_path: Path) -> None:
    before = [tick(50 * S + i * S // 10, WALL_NS + i * S // 10) for i in range(41)]
    after = [tick(54 * S + i * S // 10, WALL_NS + 600 * S + i * S // 10) for i in range(1, 9)]
    messages = [*walk(50 * S, WALL_NS), *before, *after, state("go", WALL_NS + 300 * S)]

    assert read(tmp_path / "t.mcap", messages).started_s == pytest.approx(54.0, abs=0.1)


def test_before_the_first_clock_message_a_simulation_that_just_started_had_no_time(tmp_path: Path) -> None:
    ticks = [tick(i * S // 10, WALL_NS + i * S // 10) for i in range(1, 60)]
    messages = [*walk(S // 10, WALL_NS + S // 10), *ticks, state("init", WALL_NS - 30 * S)]

    assert read(tmp_path / "t.mcap", messages).recorded is not None


def test_a_simulation_that_was_reset_is_refused(tmp_path: Path) -> None:
    ticks = [tick(50 * S + (i % 40) * S // 10, WALL_NS + i * S // 10) for i in range(60)]
    with pytest.raises(LogError, match=r"simulated time runs backwards by 3\.900 s"):
        read(tmp_path / "t.mcap", [*walk(50 * S, WALL_NS), *ticks])


def test_a_header_that_nobody_stamped_leaves_the_time_of_recording_and_is_counted(tmp_path: Path) -> None:
    messages = [
        Recorded("/place", POINT, WALL_NS + i * S, {"header": header(0), "point": {"x": 0.5}})
        for i in range(3)
    ]
    trial = read(tmp_path / "t.mcap", messages, "mcap", PLACE)

    assert trial.signals["speed/human"].t.tolist() == [0.0, 1.0, 2.0]
    assert [(d.kind, d.where, d.count) for d in trial.log_defects] == [("unset_stamps", "/place", 3)]


@pytest.mark.parametrize(("off_ns", "noted"), [(-S, False), (-S - 1, True), (S, False), (S + 1, True)])
def test_a_topic_whose_stamps_are_all_far_off_is_noted(tmp_path: Path, off_ns: int, noted: bool) -> None:
    messages = [
        Recorded("/place", POINT, WALL_NS + i * S, {"header": header(WALL_NS + i * S + off_ns)})
        for i in range(3)
    ]
    trial = read(tmp_path / "t.mcap", messages, "mcap", PLACE)

    assert [d.kind for d in trial.log_defects] == (["clock_offset"] if noted else [])


def test_a_decoder_gets_the_time_of_the_header(tmp_path: Path) -> None:
    class Points:
        def decode(self, _msgtype: str, _message: Any, t_s: float) -> None:
            times.append(t_s)

    times: list[float] = []
    messages = [Recorded("/place", POINT, WALL_NS + i * S, {"header": header(WALL_NS + i)}) for i in range(3)]
    path = write_bag(tmp_path / "t.mcap", messages, storage="mcap")
    log_map = LogMap("t", (Channel("/place", POINT, decoder="points"),))
    RosbagReader().read(path, Wanted(log_map, frozenset(), {"points": Points()}))

    assert times == [0.0, 1e-9, 2e-9]


SNAPSHOT = Channel(
    "/snapshot", "std_msgs/msg/Float64", signals=(FieldMap("centre_distance/a/b", "m", ("data",)),)
)
BODIES_AB = (Body("a", "robot"), Body("b", "human"))


def slow(rate: float, *others: Recorded) -> list[Recorded]:
    """30 s of a simulation that runs `rate` times as fast as the wall clock, by which it is recorded."""
    plain = [
        Recorded("/snapshot", "std_msgs/msg/Float64", WALL_NS + round(i * S / 50 / rate), {"data": 1.0})
        for i in range(1501)
    ]
    words = [state("go", WALL_NS), state("done", WALL_NS + round(30 * S / rate))]
    return [*plain, *words, *others]


def of_snapshots(path: Path, messages: Sequence[Recorded], storage: Storage, stamp: str = "") -> Trial:
    decoders: dict[str, Decoder] = {"gear": NistGear2020()}
    channels = (replace(SNAPSHOT, stamp=stamp), replace(STATES, stamp=stamp))
    write_bag(path, sorted(messages, key=lambda m: m.t_ns), storage=storage)
    wanted = Wanted(LogMap("t", channels, BODIES_AB), frozenset({"centre_distance"}), decoders)
    return RosbagReader().read(path, wanted)


def joints(stamp_ns: int, log_ns: int) -> Recorded:
    return Recorded("/joint_states", "sensor_msgs/msg/JointState", log_ns, {"header": header(stamp_ns)})


@stores
def test_a_slow_simulation_recorded_by_the_wall_clock_is_timed_by_its_own(
    tmp_path: Path, storage: Storage, name: str
) -> None:
    """Nothing that is read has a stamp: 30 s of the simulation took 35.3 s of the recorder's."""
    ticks = [tick(i * S // 10, WALL_NS + round(i * S / 10 / 0.85)) for i in range(302)]

    trial = of_snapshots(tmp_path / name, slow(0.85, *ticks), storage)

    assert trial.clock == "simulated time"
    assert (trial.started_s, trial.ended_s) == (pytest.approx(0.0), pytest.approx(30.0, abs=1e-6))
    assert trial.signals["centre_distance/a/b"].t[-1] == pytest.approx(30.0, abs=1e-6)


@stores
@pytest.mark.parametrize("witness", ["/joint_states", "/tf"])
def test_without_the_clock_other_topics_show_that_wall_time_is_not_that_of_the_nodes(
    tmp_path: Path, storage: Storage, name: str, witness: str
) -> None:
    def seen(i: int) -> Recorded:
        ends = 5 * S + i * S, WALL_NS + round(i * S / 0.85)
        return joints(*ends) if witness == "/joint_states" else walking(*ends, x=0.0)

    with pytest.raises(LogError, match=rf"on topic {witness} its headers say 5000000000 ns.*/snapshot") as e:
        of_snapshots(tmp_path / name, slow(0.85, *map(seen, range(30))), storage)
    assert "/clock" in e.value.hint


@pytest.mark.parametrize(("rate", "refused"), [(0.97, False), (0.9, True), (1.1, True)])
def test_headers_that_drift_away_from_the_recorder_are_of_another_clock(
    tmp_path: Path, rate: float, refused: bool
) -> None:
    """The simulation began with the wall clock's time: nothing is 60 s apart, but 30 s are 33 s."""
    messages = slow(
        rate, *(joints(WALL_NS + i * S // 10, WALL_NS + round(i * S / 10 / rate)) for i in range(300))
    )

    if refused:
        with pytest.raises(LogError, match=r"on topic /joint_states its headers and the recorder drift"):
            of_snapshots(tmp_path / "t.mcap", messages, "mcap")
    else:
        assert of_snapshots(tmp_path / "t.mcap", messages, "mcap").ended_s == pytest.approx(30 / rate)


@pytest.mark.parametrize(("off_s", "said"), [(1.2, "before"), (-5.3, "after"), (0.9, ""), (-0.9, "")])
def test_headers_of_a_machine_whose_clock_is_not_set_are_not_mixed_with_times_of_recording(
    tmp_path: Path, off_s: float, said: str
) -> None:
    """The motion would be seconds apart from the start of the competition, which nobody stamped."""
    moved = [
        walking(WALL_NS + i * S // 10 - round(off_s * S), WALL_NS + i * S // 10, x=0.1) for i in range(20)
    ]
    messages = [*moved, state("go", WALL_NS + S)]

    if said:
        with pytest.raises(
            LogError, match=rf"/tf its headers are {abs(off_s):.3f} s or more {said} them.*/state"
        ):
            read(tmp_path / "t.mcap", messages)
    else:
        assert read(tmp_path / "t.mcap", messages).started_s == 1.0
    # Where all that is read has stamps, nothing is mixed.
    assert len(read(tmp_path / "u.mcap", moved).signals["position/human"]) == 20


UNCONFIRMED = "of recording: no message carries its own, so a slower or faster simulation would not show"


@pytest.mark.parametrize(
    ("others", "stamp", "said"),
    [
        ([], "", f"log time ({UNCONFIRMED})"),
        ([], "log", "log time"),
        ([joints(WALL_NS + i * S, WALL_NS + i * S) for i in range(30)], "", "log time"),
        ([tick(WALL_NS + i * S, WALL_NS + i * S) for i in range(30)], "", "log time"),
    ],
    ids=["nothing", "declared by the log map", "headers", "clock messages"],
)
def test_where_nothing_shows_which_clock_its_nodes_were_on_a_recording_says_so(
    tmp_path: Path, others: list[Recorded], stamp: str, said: str
) -> None:
    """A slow simulation and a fast one look alike there, and what took 27 s counts 31.8."""
    trial = of_snapshots(tmp_path / "t.mcap", slow(1.0, *others), "mcap", stamp=stamp)

    (clock,) = trial.clocks
    assert str(replace(clock, origin_ns=None)) == said


def test_whoever_declares_the_clock_of_every_topic_is_believed(tmp_path: Path) -> None:
    messages = slow(0.85, *(joints(5 * S + i * S, WALL_NS + round(i * S / 0.85)) for i in range(30)))

    trial = of_snapshots(tmp_path / "t.mcap", messages, "mcap", stamp="log")

    assert trial.ended_s == pytest.approx(30 / 0.85)


def test_a_recorder_on_simulated_time_that_lags_at_times_is_on_that_clock(tmp_path: Path) -> None:
    ticks = [tick(7 * S + i * S // 10, 7 * S + i * S // 10 + (i % 20 == 0) * 3 * S // 2) for i in range(40)]
    messages = [*walk(7 * S, 7 * S), state("go", 8 * S), *ticks]

    assert read(tmp_path / "t.mcap", messages).clock.startswith("log time")
