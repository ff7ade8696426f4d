"""What a recording itself shows to be missing or contested is unknown, however short the time between."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ariac_score.checks.contracts import Decoder, Wanted
from ariac_score.checks.findings import Verdict
from ariac_score.checks.open_findings import Worlds
from ariac_score.errors import LogError
from ariac_score.logs.rosbag import RosbagReader
from ariac_score.monitors.monitor import SubjectMonitor
from ariac_score.testing.bags import Recorded, Storage, write_bag
from ariac_score.trial.believed import believed
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import BodyMatch, Channel, FieldMap, LogMap
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.events import ARM_COLLISION, COMPETITION_ENDED, COMPETITION_STARTED, WATCHING, Event
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import Span
from ariac_score_ariac.messages import NistGear2020
from ariac_score_standards import Always, ReducedSpeed
from ariac_score_standards.signal_coverage import SignalCoverage
from ariac_score_stl.formula import StlFormula

START_NS = 1_700_000_000 * 10**9
STEP_NS = 10_000_000
POINT, SCALAR, TF = "geometry_msgs/msg/PointStamped", "std_msgs/msg/Float64", "tf2_msgs/msg/TFMessage"
PLACE = Channel(
    "/place", POINT, signals=(FieldMap("position/human", "m", ("point.x", "point.y", "point.z")),)
)
DISTANCE = Channel("/distance", SCALAR, signals=(FieldMap("centre_distance/robot/human", "m", ("data",)),))
FRAMES = Channel("/tf", TF, poses="frames")
STATES = Channel("/state", "std_msgs/msg/String", decoder="gear")
BODIES = (Body("robot", "robot"), Body("human", "human"))


def stamp(stamp_ns: int) -> dict[str, int]:
    return {"sec": stamp_ns // 10**9, "nanosec": stamp_ns % 10**9}


def places(count: int = 100, *, since_ns: int = 0, y: float = 0.0, publisher: str = "") -> Iterator[Recorded]:
    """A human who walks at 0.5 m/s, seen at 100 Hz by a node that numbers what it sends."""
    for i in range(count):
        t_ns = START_NS + since_ns + i * STEP_NS
        header = {"stamp": stamp(t_ns), "frame_id": "world", "seq": 41 + i}
        point = {"x": 0.005 * i, "y": y, "z": 0.0}
        yield Recorded("/place", POINT, t_ns, {"header": header, "point": point}, publisher, 41 + i)


def for_ros2(message: Recorded) -> Recorded:
    header = {key: value for key, value in message.fields["header"].items() if key != "seq"}
    return replace(message, fields={**message.fields, "header": header})


def distances(values: Sequence[float]) -> Iterator[Recorded]:
    for i, value in enumerate(values):
        yield Recorded("/distance", SCALAR, START_NS + i * STEP_NS, {"data": value})


def moved(frame: str, parent: str, x: float, t_ns: int, publisher: str = "") -> Recorded:
    transform = {"translation": {"x": x}, "rotation": {"w": 1.0}}
    stamped = {"header": {"stamp": stamp(t_ns), "frame_id": parent}, "child_frame_id": frame}
    return Recorded("/tf", TF, t_ns, {"transforms": [{**stamped, "transform": transform}]}, publisher)


def read(path: Path, messages: Sequence[Recorded], *channels: Channel, storage: Storage = "ros1") -> Trial:
    frames = (BodyMatch("person", "human", "human"), BodyMatch("cart", "robot", "robot"))
    log_map = LogMap("t", channels, BODIES, frames=frames)
    if storage != "ros1":
        messages = [for_ros2(m) if "header" in m.fields else m for m in messages]
    write_bag(path, sorted(messages, key=lambda m: m.t_ns), storage=storage)
    quantities = frozenset({"position", "centre_distance", "separation", "speed"})
    decoders: dict[str, Decoder] = {"gear": NistGear2020()}
    return RosbagReader().read(path, Wanted(log_map, quantities, decoders))


def defects(trial: Trial) -> dict[str, int]:
    return {defect.kind: defect.count for defect in trial.log_defects}


@pytest.mark.parametrize(("storage", "name"), [("ros1", "t.bag"), ("mcap", "t.mcap")])
def test_three_messages_cut_out_are_a_gap_although_40_ms_are_short(
    tmp_path: Path, storage: Storage, name: str
) -> None:
    whole = list(places())
    honest = read(tmp_path / f"whole_{name}", whole, PLACE, storage=storage)
    cut = read(tmp_path / name, whole[:50] + whole[53:], PLACE, storage=storage)

    (there, missing) = (trial.signals["position/human"] for trial in (honest, cut))
    assert there.gaps(Span(0.0, 0.99), max_gap_s=0.05) == []
    assert missing.gaps(Span(0.0, 0.99), max_gap_s=0.05) == [Span(0.49, 0.53)]
    assert defects(honest) == {}
    assert defects(cut) == {"missing_messages": 3}
    assert "1 place(s), the first behind 0.490 s" in cut.log_defects[0].message


def test_what_follows_from_a_signal_is_unknown_where_it_is(tmp_path: Path) -> None:
    whole = list(places())
    trial = read(tmp_path / "t.bag", whole[:50] + whole[53:], PLACE)

    speed = derive_signals(trial, [Derivation("speed", 0.5)]).signals["speed/human"]

    assert speed.holes == (Span(0.49, 0.53),)
    # No difference runs across the hole: with 100 Hz and 0.5 m/s all of them are 0.5.
    assert speed.values == pytest.approx(0.5)


def test_half_of_all_messages_left_out_is_as_many_gaps(tmp_path: Path) -> None:
    trial = read(tmp_path / "t.bag", [m for i, m in enumerate(places(80)) if i < 41 or i % 2], PLACE)

    assert defects(trial) == {"missing_messages": 19}  # 42, 44, ... 78


@pytest.mark.parametrize(
    ("case", "numbers"),
    [
        ("not numbered", lambda _: 0),
        ("a field of their own", lambda i: 7 * i),
        ("begun anew by a restart", lambda i: i % 50),
        ("beyond 2^32", lambda i: (2**32 - 50 + i) % 2**32),
    ],
)
def test_numbers_that_leave_nothing_out_are_no_gap(tmp_path: Path, case: str, numbers: object) -> None:
    assert callable(numbers)
    messages = [
        replace(m, fields={**m.fields, "header": {**m.fields["header"], "seq": numbers(i)}})
        for i, m in enumerate(places())
    ]

    trial = read(tmp_path / "t.bag", messages, PLACE)

    assert (trial.signals["position/human"].holes, defects(trial)) == ((), {}), case


def test_a_recorder_that_counts_all_messages_says_nothing_of_a_topic(tmp_path: Path) -> None:
    others = (Recorded("/other", SCALAR, START_NS + i * 33_000_000, {"data": 0.0}) for i in range(30))
    messages = sorted([*places(), *others], key=lambda m: m.t_ns)
    counted = [replace(m, sequence=i + 1) for i, m in enumerate(messages)]

    trial = read(tmp_path / "t.mcap", counted, PLACE, Channel("/other", SCALAR), storage="mcap")

    assert (trial.signals["position/human"].holes, defects(trial)) == ((), {})


def test_two_publishers_of_one_topic_leave_the_time_unknown_in_which_both_send(tmp_path: Path) -> None:
    # The other one says for 0.2 s, five metres away, that all is well.
    other = places(20, since_ns=405_000_000, y=5.0, publisher="/ghost")

    trial = read(tmp_path / "t.bag", [*places(publisher="/tracker"), *other], PLACE)
    signal = trial.signals["position/human"]

    # Who has the last word is chance: what is right beside the stretch is contested as well.
    assert signal.gaps(Span(0.0, 0.99), max_gap_s=0.3) == [Span(0.38, 0.62)]
    assert (signal.values[:, 1] == 0.0).all()
    assert defects(trial)["two_publishers"] == 20
    (said,) = (d.message for d in trial.log_defects if d.kind == "two_publishers")
    assert "/ghost (20) and /tracker (100), from 0.405 to 0.595 s" in said


@pytest.mark.parametrize("after", [0, 1, 2])
def test_of_two_who_contest_each_other_to_the_end_nobody_has_the_last_word(
    tmp_path: Path, after: int
) -> None:
    """The second one is five metres away; which message of whom was recorded last is chance."""
    tracker = list(places(publisher="/tracker"))
    other = list(places(50, since_ns=505_000_000, y=5.0, publisher="/ghost"))

    trial = read(tmp_path / "t.bag", [*(tracker[:-after] if after else tracker), *other], PLACE)

    signal = trial.signals["position/human"]
    assert (signal.values[:, 1] == 0.0).all()
    assert signal.t.max() == pytest.approx(0.48)


def test_a_publisher_that_is_started_again_is_no_second_one(tmp_path: Path) -> None:
    first, again = list(places(100))[:50], list(places(101))[51:]
    given = [
        replace(message, publisher=name)
        for name, messages in (("/tracker_1", first), ("/tracker_2", again))
        for message in messages
    ]

    trial = read(tmp_path / "t.bag", given, PLACE)

    assert (len(trial.signals["position/human"]), defects(trial)) == (100, {})


TWO_METRES = Always(
    holds="d >= 2",
    signals={"d": "centre_distance/{robot}/{human}"},
    unit="m",
    max_gap_s=0.05,
    t_off_s=0.0,
)


@pytest.mark.parametrize("apart_m", [0.0, 5.0, 300.0])
def test_who_contests_another_before_and_after_him_bounds_nothing_in_between(
    apart_m: float, tmp_path: Path
) -> None:
    """The human is 1 m from the robot from 0.2 s to 0.8 s; a ghost says otherwise, for longer."""
    honest = [m for m in places(publisher="/tracker", y=1.0) if 20 <= (m.t_ns - START_NS) // STEP_NS <= 80]
    ghost = places(publisher="/ghost", since_ns=3_000_000, y=1.0 + apart_m)
    still = [replace(m, topic="/robot", fields={**m.fields, "point": {"x": 0.0}}) for m in places()]
    robot = Channel(
        "/robot", POINT, signals=(FieldMap("position/robot", "m", ("point.x", "point.y", "point.z")),)
    )
    trial = read(tmp_path / "t.bag", [*honest, *ghost, *still], PLACE, robot)
    trial = replace(
        trial,
        events=(Event(0.0, COMPETITION_STARTED), Event(0.98, COMPETITION_ENDED)),
        between=between_samples({}, {}),
    )

    best_s, worst_s = times_in_violation_s(trial, TWO_METRES, "centre_distance")
    assert best_s <= (0.98 if apart_m == 0.0 else 0.4)
    assert worst_s >= 0.6


def times_in_violation_s(trial: Trial, monitor: SubjectMonitor, quantity: str) -> tuple[float, float]:
    """In the best and in the worst world."""
    derived = derive_signals(trial, [Derivation(quantity, 0.05)])
    (worlds,) = [one for one in monitor.watch_worlds(derived) if isinstance(one, Worlds)]
    best_s, worst_s = (
        sum(f.quantities["time_in_violation_s"] for f in world if f.verdict is Verdict.VIOLATED)
        for world in (worlds.best, worlds.worst)
    )
    return best_s, worst_s


def told(topic: str, publisher: str, times_s: Sequence[float], value: float) -> Iterator[Recorded]:
    for t_s in times_s:
        yield Recorded(topic, SCALAR, START_NS + round(t_s * 1e9), {"data": value}, publisher)


ALWAYS_S = [0.01 * i for i in range(401)]
NEAR = Always(
    holds="d >= 1",
    signals={"d": "separation/{robot}/{human}"},
    unit="m",
    max_gap_s=0.05,
    t_off_s=0.0,
)


@pytest.mark.parametrize("apart_m", [0.8, 3.8, 300.0])
def test_a_ghost_does_not_bound_a_distance_that_another_measures_rarely(
    apart_m: float, tmp_path: Path
) -> None:
    """At 2 Hz, with 1 m/s, 1.2 m may have been 0.95 m in between: what the ghost says changes none of it."""
    channel = Channel("/d", SCALAR, signals=(FieldMap("separation/robot/human", "m", ("data",)),))
    honest = told("/d", "/tracker", [1.0005 + 0.5 * i for i in range(5)], 1.2)
    trial = read(tmp_path / "t.bag", [*honest, *told("/d", "/ghost", ALWAYS_S, 1.2 + apart_m)], channel)
    trial = replace(
        trial,
        events=(Event(0.0, COMPETITION_STARTED), Event(4.0, COMPETITION_ENDED)),
        between=between_samples({}, {"human": SLOW, "robot": SLOW}),
    )

    assert times_in_violation_s(trial, NEAR, "separation") == pytest.approx((0.0, 2.01), abs=0.08)


SLOW = {"max_speed_m_s": 0.5, "source": "a test"}


@pytest.mark.parametrize(
    ("ghost_m_s", "honest_m_s", "every_s", "late_s", "expected_s"),
    [
        (0.39, 0.0, 0.01, 0.0, (1.99, 4.0)),  # both speak in the same instants
        (
            0.39,
            0.0,
            0.01,
            0.003,
            (1.99, 4.0),
        ),  # it may have stood still for as long as the honest one says so
        (0.0, 0.24, 0.5, 0.003, (0.0, 1.5)),  # between two samples it may have been faster than 0.25 m/s
    ],
)
def test_a_ghost_does_not_bound_a_speed_by_how_fast_that_can_change(
    ghost_m_s: float,
    honest_m_s: float,
    every_s: float,
    late_s: float,
    expected_s: tuple[float, float],
    tmp_path: Path,
) -> None:
    channel = Channel("/v", SCALAR, signals=(FieldMap("speed/robot", "m/s", ("data",)),))
    times_s = [1.0 + late_s + every_s * i for i in range(round(2.0 / every_s))]
    ghost = told("/v", "/ghost", ALWAYS_S, ghost_m_s)
    trial = read(tmp_path / "t.bag", [*told("/v", "/tracker", times_s, honest_m_s), *ghost], channel)
    trial = replace(
        trial,
        events=(Event(0.0, COMPETITION_STARTED), Event(4.0, COMPETITION_ENDED)),
        between=between_samples(
            {}, {"robot": {"max_speed_m_s": 0.4, "max_acceleration_m_s2": 0.1, "source": "a test"}}
        ),
    )

    assert times_in_violation_s(trial, ReducedSpeed(), "speed") == pytest.approx(expected_s, abs=0.09)


def test_silence_after_two_who_contest_each_other_is_bounded_by_neither(tmp_path: Path) -> None:
    """The ghost says 5 m to 3 s, the tracker 0.5 m from 1 to 3 s, and nobody speaks to 4 s."""
    tracked = places(300, publisher="/tracker", since_ns=3_000_000, y=0.5)
    honest = [m for m in tracked if m.t_ns - START_NS >= 10**9]
    ghost = places(301, publisher="/ghost", y=5.0)
    still = [
        replace(m, topic="/robot", publisher="/robot", fields={**m.fields, "point": {"x": 0.0}})
        for m in places(401)
    ]
    given = [
        replace(m, fields={**m.fields, "point": {"x": 0.0, "y": m.fields["point"]["y"]}})
        for m in (*honest, *ghost)
    ]
    robot = Channel(
        "/robot", POINT, signals=(FieldMap("position/robot", "m", ("point.x", "point.y", "point.z")),)
    )
    trial = read(tmp_path / "t.bag", [*given, *still], PLACE, robot)
    trial = replace(
        trial,
        events=(Event(0.0, COMPETITION_STARTED), Event(4.0, COMPETITION_ENDED)),
        between=between_samples({}, {"human": SLOW, "robot": SLOW}),
    )

    assert times_in_violation_s(trial, TWO_METRES, "centre_distance")[1] == pytest.approx(3.0, abs=0.03)


def test_two_publishers_of_one_transform_contradict_each_other(tmp_path: Path) -> None:
    cart = [moved("cart", "world", 3.0, START_NS + i * STEP_NS, "/robot") for i in range(100)]
    person = [moved("person", "world", 0.005 * i, START_NS + i * STEP_NS, "/tracker") for i in range(100)]
    ghost = [
        moved("person", "world", 9.0, START_NS + 5_000_000 + i * STEP_NS, "/ghost") for i in range(30, 40)
    ]

    trial = read(tmp_path / "t.bag", [*cart, *person, *ghost], FRAMES)

    assert trial.signals["position/human"].gaps(Span(0.0, 0.99), max_gap_s=0.5) == [Span(0.28, 0.42)]
    # Other transforms of the topic are the word of one.
    assert trial.signals["position/robot"].gaps(Span(0.0, 0.99), max_gap_s=0.05) == []
    assert [(d.kind, d.where) for d in trial.log_defects] == [("two_publishers", "frame person")]


def test_a_slow_person_under_a_fast_frame_is_seen_as_rarely_as_it_is(tmp_path: Path) -> None:
    """2 Hz under a constant frame of 100 Hz: what happens within 0.5 s nobody saw."""
    fast = [moved("room", "world", 0.0, START_NS + i * STEP_NS) for i in range(400)]
    slow = [moved("person", "room", 1.0, START_NS + i * 500_000_000) for i in range(8)]

    trial = read(tmp_path / "t.bag", [*fast, *slow], FRAMES)

    gaps = trial.signals["position/human"].gaps(Span(0.0, 3.5), max_gap_s=0.05)
    assert gaps == [Span(0.5 * i, 0.5 * (i + 1)) for i in range(7)]


@pytest.mark.parametrize(
    ("glitch_m", "noise_m", "dropped"),
    [
        (52.0, 0.0, 3),
        (2.5, 0.0, 3),  # 50 m/s, of a signal without noise
        (2.19, 0.0, 0),  # 10 m/s that two bodies can have together, and 0.09 m that may be steps of a scale
        (52.0, 0.1, 3),
        (2.4, 0.1, 0),  # noise
    ],
)
def test_a_distance_that_jumps_50_m_in_10_ms_is_unknown_there(
    tmp_path: Path, glitch_m: float, noise_m: float, dropped: int
) -> None:
    noise = np.random.default_rng(1).uniform(-noise_m, noise_m, 100)
    values = [2.0 + float(each) for each in noise]
    values[40:43] = [glitch_m] * 3

    trial = read(tmp_path / "t.bag", list(distances(values)), DISTANCE)
    signal = trial.signals["centre_distance/robot/human"]

    assert len(signal) == 100 - dropped
    assert signal.gaps(Span(0.0, 0.99), max_gap_s=0.2) == ([Span(0.39, 0.43)] if dropped else [])
    assert defects(trial) == ({"implausible_jump": 3} if dropped else {})


@pytest.mark.parametrize(("away_m", "dropped"), [(50.0, 20), (0.45, 14), (0.14, 0)])
def test_a_body_is_not_believed_to_be_50_m_away_within_10_ms(
    tmp_path: Path, away_m: float, dropped: int
) -> None:
    """It stays there for 0.2 s, in which it could have come 1 m far; without noise 0.1 m are for a scale.

    0.45 m away it could have been after 0.08 s, and back after as long, so what it says then is believed.
    """
    walk = list(places())
    there = [
        replace(m, fields={**m.fields, "point": {**m.fields["point"], "y": away_m}}) if 40 <= i < 60 else m
        for i, m in enumerate(walk)
    ]

    trial = read(tmp_path / "t.bag", there, PLACE)

    signal = trial.signals["position/human"]
    unknown = {20: [Span(0.39, 0.6)], 14: [Span(0.39, 0.47), Span(0.59, 0.67)], 0: []}[dropped]
    assert signal.gaps(Span(0.0, 0.99), max_gap_s=0.25) == unknown
    assert defects(trial) == ({"implausible_jump": dropped} if dropped else {})


@pytest.mark.parametrize(("start_s", "is_there"), [(0.45, True), (0.25, False)])
def test_who_was_put_somewhere_else_before_the_start_is_there_from_the_start_on(
    tmp_path: Path, start_s: float, is_there: bool
) -> None:
    """At 0.4 s a frame is calibrated anew, or a person is spawned; a recording could begin there."""
    walk = [
        replace(m, fields={**m.fields, "point": {**m.fields["point"], "y": 50.0 * (i >= 40)}})
        for i, m in enumerate(places())
    ]
    said = [
        Recorded("/state", "std_msgs/msg/String", START_NS + round(t_s * 1e9), {"data": word})
        for t_s, word in ((start_s - 0.01, "init"), (start_s, "go"), (0.99, "done"))
    ]

    trial = read(tmp_path / "t.bag", [*walk, *said], PLACE, STATES)

    gaps = trial.signals["position/human"].gaps(Span(start_s - 0.01, 0.6), max_gap_s=0.05)
    assert gaps == ([] if is_there else [Span(0.39, 0.6)])


def test_who_was_put_somewhere_else_before_the_start_did_not_travel_there() -> None:
    """A person stands, says so, and is 46 m further away at 3 s: whoever says so of 6 m/s would deny it."""
    t = np.arange(1000) / 100
    place = np.column_stack([np.where(t < 3.0, 0.0, 46.0), 0.0 * t, 0.0 * t])
    signals = {
        "position/human": Signal("position/human", "m", t, place),
        "speed/human": Signal("speed/human", "m/s", t, 0.0 * t),
    }

    found, _ = believed(signals, (Body("human", "human"),), start_s=5.0)
    unstated, _ = believed(signals, (Body("human", "human"),))

    for name, signal in found.items():
        assert signal.gaps(Span(5.0, 9.99), max_gap_s=0.05) == [], name
    assert unstated["position/human"].gaps(Span(5.0, 9.99), max_gap_s=0.05)


def test_a_stretch_that_comes_back_to_the_last_bit_is_unknown(tmp_path: Path) -> None:
    walk = [2.0 + 0.0005 * i + 0.001 * (i * i % 97) for i in range(400)]
    # 1.5 s are played over what happened from 2.2 s on.
    played = [*walk[:220], *walk[50:200], *walk[370:]]

    honest = read(tmp_path / "honest.bag", list(distances(walk)), DISTANCE)
    trial = read(tmp_path / "t.bag", list(distances(played)), DISTANCE)

    assert defects(honest) == {}
    assert trial.signals["centre_distance/robot/human"].holes == (Span(0.49, 2.0), Span(2.19, 3.70))
    assert defects(trial) == {"replayed_stretch": 300}  # nothing says which of the two was there first
    assert "from 2.200 s on repeat those from 0.500 s on" in trial.log_defects[0].message


def test_a_robot_that_works_in_cycles_while_somebody_walks_by_is_no_replay() -> None:
    def built(human: Callable[[int], float]) -> Trial:
        t, still = np.arange(400) / 100, np.zeros(400)
        cycle = 0.3 * np.sin(np.arange(400) % 200 * 0.0314)
        walked = np.array([human(k) for k in range(400)])
        made = TrialBuilder("cycles", file="cycles", clock=None)
        made.add_body(BODIES[0])
        made.add_body(BODIES[1])
        for name, x in (("position/robot", cycle), ("position/human", walked)):
            made.add_signal(name, "m", t, np.stack((x, still, still), axis=1))
        return made.build()

    assert defects(built(lambda k: 2.0 + 0.001 * k)) == {}
    assert defects(built(lambda k: 2.0 + 0 * k)) == {}  # nor while he stands still
    again = built(lambda k: 2.0 + 0.1 * math.sin(k % 200 * 0.0314))
    assert defects(again) == {"replayed_stretch": 400}


def test_what_stands_still_or_comes_back_for_a_moment_is_no_replay(tmp_path: Path) -> None:
    still = [2.0] * 300
    again = [2.0 + 0.001 * (i * i % 97) + 0.01 * (i // 90) for i in range(300)]

    for number, values in enumerate((still, again)):
        assert defects(read(tmp_path / f"{number}.bag", list(distances(values)), DISTANCE)) == {}


# What happened before anybody looked ----------------------------------------------------------


def states(*words: str) -> Iterator[Recorded]:
    for i, word in enumerate(words):
        yield Recorded("/state", "std_msgs/msg/String", START_NS + i * 10 * STEP_NS, {"data": word})


@pytest.mark.parametrize(
    ("words", "started_s"),
    [
        (("go", "go", "go", "go", "done"), None),
        (("go", "go", "done"), None),  # said twice: so it was before, and all but a few words may be left out
        (("go", "done", "done"), None),
        (("init", "go", "go", "go", "done"), 0.1),
        (("go", "done"), 0.0),  # stated once: nothing says that it was stated before
    ],
)
def test_a_recording_that_begins_while_the_competition_runs_does_not_know_its_start(
    tmp_path: Path, words: tuple[str, ...], started_s: float | None
) -> None:
    trial = read(tmp_path / "t.bag", list(states(*words)), STATES)

    assert trial.started_s == started_s
    assert defects(trial) == ({"late_recording": 1} if started_s is None else {})


@pytest.mark.parametrize(("rate_hz", "started_s"), [(0.0, 0.0), (10.0, None)])
def test_of_a_topic_with_a_rate_one_word_that_it_runs_does_not_tell_since_when(
    tmp_path: Path, rate_hz: float, started_s: float | None
) -> None:
    trial = read(tmp_path / "t.bag", list(states("go", "done")), replace(STATES, rate_hz=rate_hz))

    assert trial.started_s == started_s


@pytest.mark.parametrize("words", [("init", "go", "done"), ("", "go", "done")])
@pytest.mark.parametrize(("silent_s", "is_known"), [(10.0, True), (10.01, False)])
def test_a_start_behind_a_long_silence_is_not_known(
    tmp_path: Path, words: tuple[str, ...], silent_s: float, is_known: bool
) -> None:
    """Whoever leaves out what was said between moves the start behind what happened in that time."""
    at_s = (0.0, silent_s, silent_s + 1.0)
    said = [
        Recorded("/state", "std_msgs/msg/String", START_NS + round(t_s * 1e9), {"data": word})
        for t_s, word in zip(at_s, words, strict=True)
        if word
    ]

    trial = read(tmp_path / "t.bag", [*places(1), *said], PLACE, STATES)

    assert trial.started_s == (silent_s if is_known else None)
    assert defects(trial) == ({} if is_known else {"late_recording": 1})
    assert trial.ended_s == pytest.approx(silent_s + 1.0)


@pytest.mark.parametrize(
    ("words", "noted"),
    [(("init", "go", "go", "done"), {}), (("init", "go", "init", "go", "done"), {"runs_again": 1})],
)
def test_a_competition_that_is_interrupted_and_runs_again_is_noted(
    tmp_path: Path, words: Sequence[str], noted: dict[str, int]
) -> None:
    trial = read(tmp_path / "t.bag", list(states(*words)), STATES)

    assert defects(trial) == noted


@pytest.mark.parametrize(
    ("words", "silent_s"),
    [(("go", "go", "init", "go", "done"), 0.0), (("init", "go", "init", "go", "done"), 11.0)],
)
def test_a_start_that_nobody_knows_is_not_the_one_after_an_interruption(
    tmp_path: Path, words: Sequence[str], silent_s: float
) -> None:
    """Its first word already says that it runs, or says so after a long silence; then it is reset."""
    first, *others = states(*words)
    said = [first, *(replace(one, t_ns=one.t_ns + round(silent_s * 1e9)) for one in others)]

    trial = read(tmp_path / "t.bag", said, STATES)

    assert trial.started_s is None
    assert defects(trial)["late_recording"] == 1


def test_a_competition_that_runs_again_after_its_end_is_refused(tmp_path: Path) -> None:
    with pytest.raises(
        LogError, match=r"/state says at 0\.300 s that the competition runs.* 0\.200 s .* over"
    ):
        read(tmp_path / "t.bag", list(states("init", "go", "done", "go")), STATES)


@pytest.mark.parametrize(("watches_s", "vouches"), [(0.0, True), (2.1, True), (2.2, False)])
def test_who_watches_vouches_for_no_time_before_he_came(watches_s: float, vouches: bool) -> None:
    found = TrialBuilder("t", file="t", clock=None)
    found.add(Event(2.0, COMPETITION_STARTED))
    found.add(Event(watches_s, WATCHING, ARM_COLLISION))

    trial = found.build()

    assert (ARM_COLLISION in trial.witnessed) is vouches
    assert defects(trial) == ({} if vouches else {"late_watcher": 1})


def test_a_link_whose_name_the_pattern_of_its_body_fits_as_well_does_not_vanish(tmp_path: Path) -> None:
    path, person = (
        tmp_path / "t.bag",
        [moved("person", "world", 1.0, START_NS + i * STEP_NS) for i in range(9)],
    )
    frames = (BodyMatch("person*", "human", links=("person_hand",)),)
    write_bag(path, person, storage="ros1")

    trial = RosbagReader().read(path, Wanted(LogMap("t", (FRAMES,), frames=frames), frozenset({"position"})))

    (human,) = trial.bodies
    assert human.links == ("person_hand",)
    assert [line.partition(":")[0] for line in trial.unrecorded] == ["link person_hand of person"]


# Transforms that never move --------------------------------------------------------------------


def fixed(x: float, at_s: float, publisher: str, w: float = 1.0) -> Recorded:
    message = moved("room", "world", x, START_NS + round(at_s * 1e9), publisher)
    message.fields["transforms"][0]["transform"]["rotation"]["w"] = w
    return replace(message, topic="/tf_static")


FIXED = Channel("/tf_static", TF, poses="frames")


@pytest.mark.parametrize(
    ("told", "noted"),
    [
        (
            (fixed(0.0, 0.0, "/cal"), fixed(0.05, 0.2, "/urdf")),
            {"two_publishers": 1, "restated_transform": 1},
        ),
        (
            (fixed(0.05, 0.0, "/urdf"), fixed(0.0, 0.2, "/cal")),
            {"two_publishers": 1, "restated_transform": 1},
        ),
        # Again and again, at a time.
        (
            (fixed(0.0, 0.0, "/cal"), fixed(0.05, 1.5, "/urdf"), fixed(0.0, 3.0, "/cal")),
            {"two_publishers": 1, "restated_transform": 2},
        ),
        # One after the other by more than recorders need to meet them; the same of one publisher.
        ((fixed(0.0, 0.0, "/cal"), fixed(0.05, 1.5, "/cal_2")), {"restated_transform": 1}),
        ((fixed(0.0, 0.0, "/cal"), fixed(0.05, 0.2, "/cal")), {"restated_transform": 1}),
        # The one says the same as the other, and something else as well.
        (
            (fixed(0.0, 0.0, "/cal"), fixed(0.0, 0.1, "/urdf"), fixed(3.0, 0.2, "/urdf")),
            {"two_publishers": 1, "restated_transform": 1},
        ),
        # Both say the same, one by the other of the two quaternions, or rounded.
        ((fixed(0.05, 0.0, "/cal"), fixed(0.05, 0.2, "/urdf", -1.0)), {}),
        ((fixed(0.05, 0.0, "/cal"), fixed(0.0500005, 0.2, "/urdf")), {"restated_transform": 1}),
    ],
    ids=["at once", "the other way round", "at a time", "later", "by one", "and more", "alike", "rounded"],
)
@pytest.mark.parametrize("others", [0, 2000])
def test_who_places_a_frame_for_good_is_not_decided_by_the_order_of_arrival(
    tmp_path: Path, told: Sequence[Recorded], noted: dict[str, int], others: int
) -> None:
    """Few messages are read one by one, many of them in columns."""
    moving = [moved("person", "room", 1.0, START_NS + i * STEP_NS) for i in range(400)]
    more = [replace(fixed(7.0, i * 0.002, "/urdf"), t_ns=START_NS + i * 2_000_000) for i in range(others)]
    for one in more:
        one.fields["transforms"][0]["child_frame_id"] = "elsewhere"

    trial = read(tmp_path / "t.bag", [*told, *more, *moving], FRAMES, FIXED)

    position = trial.signals.get("position/human")
    assert defects(trial) == noted
    assert (position is None or not len(position)) is ("two_publishers" in noted)


def test_a_frame_that_is_said_to_move_and_not_to_move_moves_and_that_is_noted(tmp_path: Path) -> None:
    moving = [moved("person", "world", 1.0, START_NS + i * STEP_NS) for i in range(9)]
    told = moved("person", "world", 5.0, START_NS)

    trial = read(tmp_path / "t.bag", [replace(told, topic="/tf_static"), *moving], FRAMES, FIXED)

    assert defects(trial) == {"static_and_moving": 1}
    assert trial.signals["position/human"].values[:, 0] == pytest.approx(1.0)


# Who is watched at all, and where --------------------------------------------------------------


def test_a_person_whom_the_log_map_names_and_no_frame_is_does_not_vanish(tmp_path: Path) -> None:
    path, person = (
        tmp_path / "t.bag",
        [moved("person", "world", 1.0, START_NS + i * STEP_NS) for i in range(9)],
    )
    frames = (
        BodyMatch("person", "human"),
        BodyMatch("visitor", "human"),
        BodyMatch("guest_*", "human"),
        BodyMatch("arm", "robot"),
    )
    write_bag(path, person, storage="ros1")

    trial = RosbagReader().read(path, Wanted(LogMap("t", (FRAMES,), frames=frames), frozenset({"position"})))

    # Nobody can know how many guests there should be; that no robot is there, every monitor says itself.
    assert [body.id for body in trial.bodies] == ["person", "visitor"]
    assert [line.partition(":")[0] for line in trial.unrecorded] == [
        "frame arm",
        "frame guest_*",
        "frame visitor",
    ]


@pytest.mark.parametrize(
    ("pattern", "links", "said"),
    [
        ("hand", ("hand",), []),
        ("ha*", ("hand",), []),
        (
            "hnad",
            ("hnad",),
            [
                "link hnad of robot: no recorded link matches; did you mean 'hand'? recorded links: "
                "base, hand, person, world"
            ],
        ),
        ("foot_*", (), ["link foot_* of robot: no recorded link matches"]),
    ],
)
def test_a_link_that_the_log_map_names_and_no_frame_is_does_not_vanish(
    tmp_path: Path, pattern: str, links: tuple[str, ...], said: Sequence[str]
) -> None:
    """The hand is 0.3 m from somebody who is 3 m from the base of its robot."""
    frames = (
        BodyMatch("base", "robot", "robot", links=(pattern,)),
        BodyMatch("person", "human", "human"),
    )
    places_m = (("base", "world", 0.0), ("hand", "base", 2.7), ("person", "world", 3.0))
    given = [
        moved(name, parent, x_m, START_NS + i * STEP_NS) for i in range(9) for name, parent, x_m in places_m
    ]
    path = write_bag(tmp_path / "t.bag", given, storage="ros1")

    trial = RosbagReader().read(path, Wanted(LogMap("t", (FRAMES,), frames=frames), frozenset({"position"})))

    (robot,) = trial.bodies_of("robot")
    assert robot.links == links
    assert [line.partition("; recorded")[0] for line in trial.unrecorded] == said
    derived = derive_signals(trial, [Derivation("centre_distance", 0.05)])
    distance = derived.signals.get("centre_distance/robot/human")
    expected_m = None if links == ("hnad",) else 3.0 if not links else pytest.approx(0.3)
    assert (None if distance is None else float(distance.values[0])) == expected_m


@pytest.mark.parametrize(
    "frames",
    [
        (BodyMatch("base", "robot", "robot", links=("base", "hand")),),  # its own frame among its links
        (  # two names that its base may have, and one of them is there
            BodyMatch("base", "robot", "robot", links=("hand",)),
            BodyMatch("base_link", "robot", "robot", links=("tool0",)),
        ),
        (BodyMatch("b?se", "robot", "", links=("hand", "base")),),
    ],
    ids=["its own frame", "another name of it", "a pattern"],
)
def test_a_link_that_was_recorded_or_is_of_nobody_who_was_leaves_nothing_open(
    tmp_path: Path, frames: tuple[BodyMatch, ...]
) -> None:
    places_m = (("base", "world", 0.0), ("hand", "base", 2.7))
    given = [
        moved(name, parent, x_m, START_NS + i * STEP_NS) for i in range(9) for name, parent, x_m in places_m
    ]
    path = write_bag(tmp_path / "t.bag", given, storage="ros1")

    trial = RosbagReader().read(path, Wanted(LogMap("t", (FRAMES,), frames=frames), frozenset({"position"})))

    (robot,) = trial.bodies_of("robot")
    assert robot.links == ("hand",)
    assert not [line for line in trial.unrecorded if line.startswith("link")]


def test_each_robot_of_a_pattern_has_its_own_links(tmp_path: Path) -> None:
    frames = (BodyMatch("ur?_base", "robot", links=("ur1_tool", "ur2_tool")),)
    given = [
        moved(name, parent, 1.0, START_NS + i * STEP_NS)
        for i in range(9)
        for k in (1, 2)
        for name, parent in ((f"ur{k}_base", "world"), (f"ur{k}_tool", f"ur{k}_base"))
    ]
    path = write_bag(tmp_path / "t.bag", given, storage="ros1")

    trial = RosbagReader().read(path, Wanted(LogMap("t", (FRAMES,), frames=frames), frozenset({"position"})))

    assert [body.links for body in trial.bodies] == [("ur1_tool",), ("ur2_tool",)]
    assert not trial.unrecorded


@pytest.mark.parametrize(("frame", "refused"), [("camera", True), ("world", False), ("/world", False)])
def test_positions_in_two_frames_are_never_subtracted(tmp_path: Path, frame: str, refused: bool) -> None:
    robot = [moved("cart", "world", 3.0, START_NS + i * STEP_NS) for i in range(100)]
    human = [
        replace(m, fields={**m.fields, "header": {**m.fields["header"], "frame_id": frame}}) for m in places()
    ]

    if refused:
        with pytest.raises(LogError, match="topic /place in 'camera', tf in 'world'"):
            read(tmp_path / "t.bag", [*robot, *human], PLACE, FRAMES)
    else:
        assert set(read(tmp_path / "t.bag", [*robot, *human], PLACE, FRAMES).signals) == {
            "position/human",
            "position/robot",
        }


def test_a_misspelt_root_frame_is_answered_with_the_frames_that_there_are(tmp_path: Path) -> None:
    robot = [moved("cart", "world", 3.0, START_NS + i * STEP_NS) for i in range(100)]
    log_map = LogMap(
        "t", (PLACE, FRAMES), BODIES, root_frame="wrld", frames=(BodyMatch("cart", "robot", "robot"),)
    )
    write_bag(tmp_path / "t.bag", sorted([*robot, *places()], key=lambda m: m.t_ns), storage="ros1")

    with pytest.raises(LogError, match="'root_frame: wrld' of the log map is no recorded frame") as refused:
        RosbagReader().read(tmp_path / "t.bag", Wanted(log_map, frozenset({"position"})))
    assert refused.value.file == str(tmp_path / "t.bag")
    assert refused.value.hint == "did you mean 'world'? recorded frames: cart, world"


def in_frame(frame: str, messages: Iterator[Recorded]) -> list[Recorded]:
    return [
        replace(m, fields={**m.fields, "header": {**m.fields["header"], "frame_id": frame}}) for m in messages
    ]


def quarter_turn(t_ns: int) -> Recorded:
    """The camera stands at x = 10 m and looks along y, so its x is the world's y."""
    message = moved("camera", "world", 10.0, t_ns)
    (sent,) = message.fields["transforms"]
    turned = {**sent["transform"], "rotation": {"z": math.sqrt(0.5), "w": math.sqrt(0.5)}}
    return replace(message, fields={"transforms": [{**sent, "transform": turned}]})


def test_positions_in_a_frame_whose_transforms_are_recorded_are_brought_to_the_root(tmp_path: Path) -> None:
    cart = [moved("cart", "world", 3.0, START_NS + i * STEP_NS) for i in range(100)]
    camera = [quarter_turn(START_NS + i * STEP_NS) for i in range(100)]

    trial = read(tmp_path / "t.bag", [*cart, *camera, *in_frame("/camera", places())], PLACE, FRAMES)
    human = trial.signals["position/human"]

    # A turn by hand: (0.005 i, 0, 0) in the camera is (10, 0.005 i, 0) in the world.
    i = np.arange(100)
    expected = np.stack([np.full(100, 10.0), 0.005 * i, np.zeros(100)], axis=1)
    assert human.t == pytest.approx(i / 100)
    assert human.values == pytest.approx(expected)
    assert human.source == "/place"
    distance = derive_signals(trial, [Derivation("centre_distance", 0.5)]).signals[
        "centre_distance/robot/human"
    ]
    assert distance.values[60] == pytest.approx(math.hypot(10.0 - 3.0, 0.3))


def test_a_position_is_seen_as_rarely_as_the_transform_of_its_frame(tmp_path: Path) -> None:
    """A place at 100 Hz in a frame at 4 Hz: where the frame is in between, nobody saw."""
    cart = [moved("cart", "world", 3.0, START_NS + i * STEP_NS) for i in range(100)]
    camera = [quarter_turn(START_NS + i * 250_000_000) for i in range(4)]

    trial = read(tmp_path / "t.bag", [*cart, *camera, *in_frame("camera", places())], PLACE, FRAMES)

    gaps = trial.signals["position/human"].gaps(Span(0.0, 0.75), max_gap_s=0.05)
    assert gaps == [Span(0.25 * i, 0.25 * (i + 1)) for i in range(3)]


def test_a_frame_that_moved_twice_as_two_publishers_said_places_nobody(tmp_path: Path) -> None:
    cart = [moved("cart", "world", 3.0, START_NS + i * STEP_NS) for i in range(100)]
    camera = [replace(quarter_turn(START_NS + i * STEP_NS), publisher="/camera") for i in range(100)]
    ghost = [
        moved("camera", "world", 50.0, START_NS + 5_000_000 + i * STEP_NS, "/ghost") for i in range(30, 40)
    ]

    trial = read(tmp_path / "t.bag", [*cart, *camera, *ghost, *in_frame("camera", places())], PLACE, FRAMES)

    assert trial.signals["position/human"].gaps(Span(0.0, 0.99), max_gap_s=0.05) == [Span(0.26, 0.44)]


def test_formulas_and_shares_of_time_leave_open_what_a_signal_leaves_open() -> None:
    t = np.arange(100) / 100
    signal = Signal("speed/human", "m/s", t, np.full(100, 0.2), holes=(Span(0.49, 0.53),))
    trial = Trial("t", bodies=BODIES, signals={signal.name: signal}, recorded=Span(0.0, 0.99))
    formula = StlFormula(formula="always v < 1", signals={"v": "speed of human in m/s"}, max_gap_s=0.05)
    shares = SignalCoverage(quantities=("speed",), max_gap_s=0.05)

    (open_,) = formula.watch(trial)
    (share,) = (found for found in shares.watch(trial) if found.quantities)

    assert open_.verdict is Verdict.INCONCLUSIVE
    assert "0.490" in open_.message
    assert share.quantities["missing_s"] == pytest.approx(0.04)


def test_a_message_of_another_clock_is_named_and_not_waited_for(tmp_path: Path) -> None:
    """A transform recorded at time 0, among others of our days: half a century, in steps of 10 ms."""
    moving = [moved("person", "world", 1.0, START_NS + i * STEP_NS) for i in range(9)]
    told = replace(moved("room", "world", 5.0, 0), topic="/tf_static", t_ns=0)

    with pytest.raises(LogError, match="some by another clock") as refused:
        read(tmp_path / "t.bag", [told, *moving], FRAMES, FIXED)
    assert "leave out those of the other clock" in refused.value.hint
