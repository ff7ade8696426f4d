"""Positions out of tf trees; expected places worked out by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace as Fields

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ariac_score.errors import LogError
from ariac_score.logs.gather.transforms import MAX_GAP_S, TransformTree, _Edge, _turn
from ariac_score.trial.build import TrialBuilder
from ariac_score.trial.channels import BodyMatch
from ariac_score.trial.clock import Clock
from ariac_score.trial.events import COMPETITION_STARTED, Event
from ariac_score.trial.model import Body
from ariac_score.trial.spans import Span

NO_TURN = (0.0, 0.0, 0.0, 1.0)
QUARTER_TURN = (0.0, 0.0, math.sin(math.pi / 4), math.cos(math.pi / 4))  # about z
GANTRY = BodyMatch("torso", "robot", body="gantry", radius_m=0.3, links=("hand*",))

Place = tuple[float, float, float]
Turn = tuple[float, float, float, float]


def transform(parent: str, child: str, at: Place, turn: Turn = NO_TURN) -> Fields:
    rotation = Fields(**dict(zip("xyzw", turn, strict=True)))
    translation = Fields(**dict(zip("xyz", at, strict=True)))
    body = Fields(translation=translation, rotation=rotation)
    return Fields(header=Fields(frame_id=parent), child_frame_id=child, transform=body)


def tree_of(*samples: tuple[float | None, Fields]) -> TransformTree:
    tree = TransformTree("world", file=Path("t.bag"))
    for t_s, sample in samples:
        tree.add(sample, round((t_s or 0.0) * 1e9), static=t_s is None)
    return tree


def settled(tree: TransformTree, *matches: BodyMatch) -> TrialBuilder:
    builder = TrialBuilder("t", file="t.bag", clock=Clock("log time"))
    builder.recorded = Span(0.0, 9.0)
    tree.settle(builder, 0, matches or (GANTRY,))
    return builder


def test_a_frame_of_the_root_has_its_recorded_places() -> None:
    builder = settled(
        tree_of((0.0, transform("world", "torso", (1, 2, 3))), (0.1, transform("world", "torso", (4, 5, 6))))
    )

    signal = builder.signals["position/gantry"]
    assert signal.unit == "m"
    assert signal.t.tolist() == [0.0, 0.1]
    assert signal.values.tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    assert builder.bodies == {"gantry": Body("gantry", "robot", 0.3)}


def test_a_leading_slash_of_a_frame_is_ignored() -> None:
    assert "position/gantry" in settled(tree_of((0.0, transform("/world", "/torso", (1, 0, 0))))).signals


def test_one_frame_written_in_two_ways_keeps_every_sample_in_order() -> None:
    # 24 transforms come at a time, 12 of each spelling: first there is room for 64.
    names, count = ["world", "torso", "/torso"], 96
    x = np.arange(1.0, count + 1)
    columns = [x, *(np.zeros(count) for _ in range(5)), np.ones(count)]
    stamps_ns, children = np.arange(count) * 10_000_000, np.tile([1, 2], count // 2)
    tree = TransformTree("world", file=Path("t.bag"))
    for first in range(0, count, 24):
        some = slice(first, first + 24)
        tree.add_many(
            names,
            np.zeros(24, dtype=np.int64),
            children[some],
            [column[some] for column in columns],
            stamps_ns[some],
            np.ones(24, dtype=bool),
        )

    builder = settled(tree)

    assert builder.signals["position/gantry"].values[:, 0].tolist() == x.tolist()
    assert not builder._defects


def test_every_transform_of_a_tree_comes_to_another_clock() -> None:
    tree = tree_of(
        (5.0, transform("world", "rail", (1, 0, 0))),
        (5.0, transform("rail", "torso", (0, 2, 0))),
        (6.0, transform("rail", "torso", (0, 3, 0))),
    )

    tree.retime(lambda stamps_ns: stamps_ns - 4_000_000_000, lambda log_ns: log_ns)

    signal = settled(tree).signals["position/gantry"]
    assert (signal.t.tolist(), signal.values.tolist()) == ([1.0], [[1.0, 2.0, 0.0]])


@pytest.mark.parametrize("together", [False, True])
@pytest.mark.parametrize(
    ("told", "expected_m", "restated"),
    [
        ([(0.0, 1.0)], [1.0, 1.0, 1.0, 1.0, 1.0], 0),
        ([(1.0, 1.0)], [1.0, 1.0, 1.0, 1.0, 1.0], 0),  # a recorder takes a second to find who tells it
        ([(1.1, 1.0)], [1.0, 1.0, 1.0], 0),  # it may have been told otherwise before
        ([(2.5, 1.0), (3.5, 2.0)], [1.0, 2.0], 1),
        ([(0.0, 1.0), (2.0, 1.0), (3.0, 1.0)], [1.0, 1.0, 1.0, 1.0, 1.0], 0),
        ([(0.0, 1.0), (1.5, 1.1)], [1.0, 1.0, 1.1, 1.1, 1.1], 1),
        ([(0.0, 1.0), (2.0, 1.1), (3.5, 1.0)], [1.0, 1.0, 1.1, 1.1, 1.0], 2),
        ([(0.0, 1.0), (9.0, 7.0)], [1.0, 1.0, 1.0, 1.0, 1.0], 1),  # told after all else
        ([(0.0, 1.0), (3.5, 3.0), (1.5, 2.0)], [1.0, 1.0, 2.0, 2.0, 3.0], 2),  # written out of order
        ([(1.5, 2.0), (0.0, 1.0), (3.5, 2.0)], [1.0, 1.0, 2.0, 2.0, 2.0], 1),
        ([(0.0, 1.0), (3.5, 1.0), (3.6, 1.0), (1.5, 2.0)], [1.0, 1.0, 2.0, 2.0, 1.0], 2),
    ],
)
def test_a_static_transform_holds_until_another_one_replaces_it_and_not_before(
    told: list[tuple[float, float]], expected_m: list[float], restated: int, *, together: bool
) -> None:
    """As a listener of tf2 has it who was there all the time."""
    tree = tree_of(*((float(k), transform("cart", "torso", (0, 0, 0))) for k in range(5)))
    if together:
        none, ones = np.zeros(len(told)), np.ones(len(told))
        tree.add_many(
            ["world", "cart"],
            none.astype(int),
            ones.astype(int),
            [np.array([x for _, x in told]), none, none, none, none, none, ones],
            np.array([round(t_s * 1e9) for t_s, _ in told]),
            none.astype(bool),
        )
    else:
        for t_s, x in told:
            tree.add(transform("world", "cart", (x, 0, 0)), round(t_s * 1e9), static=True)

    builder = settled(tree)

    signal = builder.signals["position/gantry"]
    assert signal.values[:, 0].tolist() == expected_m
    assert sum(one.count for one in builder._defects.values() if one.kind == "restated_transform") == restated


@pytest.mark.parametrize("rate_hz", [0.0, 50.0])
def test_a_frame_that_is_told_never_to_move_lacks_what_is_published_at_a_rate(rate_hz: float) -> None:
    tree = tree_of(*((float(k), transform("world", "other", (0, 0, 0))) for k in range(5)))
    for t_s in (0.5, 3.0):
        tree.add(transform("world", "torso", (8, 0, 0)), round(t_s * 1e9), static=True)

    builder = settled(tree, replace(GANTRY, rate_hz=rate_hz))

    signal = builder.signals["position/gantry"]
    assert signal.constant is (rate_hz == 0.0)
    assert (signal.t.tolist() == [0.5, 3.0]) is (rate_hz == 50.0)
    assert bool(builder.unrecorded) is (rate_hz == 50.0)


def test_what_is_told_late_before_the_competition_was_there_before() -> None:
    tree = tree_of(*((float(k), transform("cart", "torso", (0, 0, 0))) for k in range(5)))
    tree.add(transform("world", "cart", (1, 0, 0)), 2_500_000_000, static=True)
    builder = TrialBuilder("t", file="t.bag", clock=Clock("log time"))
    builder.recorded = Span(0.0, 9.0)
    builder.events.append(Event(3.0, COMPETITION_STARTED))

    tree.settle(builder, 0, (GANTRY,))

    assert builder.signals["position/gantry"].t.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_why_a_frame_that_was_recorded_is_nowhere_is_said() -> None:
    unusable = tree_of(*((float(k), transform("world", "torso", (math.nan, 0, 0))) for k in range(3)))
    twice = tree_of(*((float(k), transform("world", "torso", (x, 0, 0))) for k in range(3) for x in (1, 2)))

    assert settled(unusable).unrecorded == [
        "frame torso: none of the 3 transforms of 'torso' can be used",
    ]
    assert settled(twice).unrecorded == [
        "frame torso: the transforms of 'torso' contradict each other at each of their stamps",
    ]


@pytest.mark.parametrize(
    ("again", "turn", "restated"), [(1.0, (0, 0, 0, 1), 0), (1.0, (0, 0, 0, -1), 0), (2.0, (0, 0, 0, 1), 1)]
)
def test_a_transform_that_is_told_anew_counts_once_and_as_one_where_it_differs(
    again: float, turn: Turn, restated: int
) -> None:
    """A rotation has two quaternions; and what is above several links is restated once."""
    tree = tree_of(*((float(k), transform("cart", "torso", (0, 0, 0))) for k in range(3)))
    for k in range(3):
        tree.add(transform("torso", "hand", (0, 1, 0)), k * 10**9)
    tree.add(transform("world", "cart", (1, 0, 0)), 0, static=True)
    tree.add(transform("world", "cart", (again, 0, 0), turn), 10**9, static=True)

    found = settled(tree, BodyMatch("torso", "robot", "gantry", links=("hand",)))

    assert [(one.kind, one.where, one.count) for one in found._defects.values()] == [
        ("restated_transform", "frame cart", 1)
    ][:restated]


def test_static_values_come_to_another_clock_by_when_they_were_recorded() -> None:
    tree = tree_of(*((float(k), transform("cart", "torso", (0, 0, 0))) for k in range(4)))
    for at_s, x in ((100.0, 1.0), (104.0, 2.0)):  # of a simulation at half the pace of the recorder's clock
        tree.add(transform("world", "cart", (x, 0, 0)), round(at_s * 1e9), static=True)

    tree.retime(lambda stamps_ns: stamps_ns, lambda log_ns: (log_ns - 100 * 10**9) // 2)

    assert settled(tree).signals["position/gantry"].values[:, 0].tolist() == [1.0, 1.0, 2.0, 2.0]


def test_a_parent_that_turns_carries_its_child_around() -> None:
    # A quarter turn about z takes the hand from 2 m ahead (x) to 2 m to the left (y) of the torso.
    tree = tree_of(
        (0.0, transform("world", "torso", (10, 0, 0), QUARTER_TURN)),
        (None, transform("torso", "hand", (2, 0, 1))),
    )

    builder = settled(tree)

    assert builder.signals["position/gantry::hand"].values == pytest.approx(np.array([[10.0, 2.0, 1.0]]))
    assert builder.bodies["gantry"].links == ("hand",)


def test_a_chain_is_seen_whenever_its_slowest_transform_is() -> None:
    # The rail moves 1 m/s along x, sampled at 0.0 and 0.4 s; nobody saw where it was at 0.1 s.
    tree = tree_of(
        (0.0, transform("world", "rail", (0, 0, 0))),
        (0.4, transform("world", "rail", (0.4, 0, 0))),
        *((t_s, transform("rail", "torso", (0, t_s, 0))) for t_s in (0.0, 0.1, 0.4)),
    )

    signal = settled(tree).signals["position/gantry"]

    assert signal.t.tolist() == [0.0, 0.4]
    assert signal.values == pytest.approx(np.array([[0, 0, 0], [0.4, 0.4, 0]]))


def test_the_slowest_transform_may_be_another_one_later() -> None:
    # By hand: at 0.0 both; the rail at 0.2, 0.4, the torso in between; from 0.4 on the torso at 0.6, 0.8.
    rail, torso = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8), (0.0, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8)
    tree = tree_of(
        *((t_s, transform("world", "rail", (0, 0, 0))) for t_s in rail),
        *((t_s, transform("rail", "torso", (0, 0, 0))) for t_s in torso),
    )

    assert settled(tree).signals["position/gantry"].t.tolist() == [0.0, 0.2, 0.4, 0.6, 0.8]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_half_way_between_two_rotations_lies_half_the_turn(sign: float) -> None:
    # q and -q are one rotation, so the sign must not matter; half of a quarter turn is 45 degrees. The hand,
    # seen once while the torso is seen twice, is the slower one.
    turned: Turn = tuple(sign * v for v in QUARTER_TURN)  # type: ignore[assignment]
    tree = tree_of(
        (0.0, transform("world", "torso", (0, 0, 0))),
        (0.4, transform("world", "torso", (0, 0, 0), turned)),
        *((t_s, transform("torso", "hand", (1, 0, 0))) for t_s in (0.2,)),
    )

    (middle,) = settled(tree).signals["position/gantry::hand"].values

    assert middle == pytest.approx([math.sqrt(0.5), math.sqrt(0.5), 0.0])


def test_nothing_is_invented_outside_the_samples_of_a_transform() -> None:
    tree = tree_of(
        (0.1, transform("world", "rail", (0, 0, 0))),
        (0.2, transform("world", "rail", (0, 0, 0))),
        *((t_s, transform("rail", "torso", (t_s, 0, 0))) for t_s in (0.0, 0.15, 0.3)),
    )

    assert settled(tree).signals["position/gantry"].t.tolist() == [0.1, 0.2]


@pytest.mark.parametrize(("gap_s", "bridged"), [(MAX_GAP_S, True), (MAX_GAP_S + 1e-6, False)])
def test_a_silence_longer_than_half_a_second_is_not_bridged(gap_s: float, bridged: bool) -> None:
    assert MAX_GAP_S == 0.5
    tree = tree_of(
        (0.0, transform("world", "rail", (0, 0, 0))),
        (gap_s, transform("world", "rail", (1, 0, 0))),
        *((t_s, transform("rail", "torso", (0, 0, 0))) for t_s in (0.25,)),
    )

    assert ("position/gantry" in settled(tree).signals) is bridged


def test_a_body_that_never_moves_covers_the_whole_recording() -> None:
    # 9 s were recorded, the other frame 1 s of them; nothing of the first is missing, for any gap accepted.
    tree = tree_of(
        (None, transform("world", "torso", (1, 0, 0))),
        *((t_s, transform("world", "other", (0, 0, 0))) for t_s in (1.0, 2.0)),
    )

    signal = settled(tree).signals["position/gantry"]

    assert signal.constant
    assert signal.gaps(Span(0.0, 9.0), max_gap_s=0.05) == []
    assert signal.covers(np.array([0.123, 8.9]), max_gap_s=0.05).all()
    assert (signal.values == [1.0, 0.0, 0.0]).all()
    assert len(signal.t) > 9 / 0.05  # a duration summed over its samples is that of the recording


def test_a_link_belongs_to_the_nearest_matching_frame_above_it() -> None:
    people = BodyMatch("person_*", "human", links=("*/hand",))
    tree = tree_of(
        *((0.0, transform("world", f"person_{i}", (i, 0, 0))) for i in (1, 2)),
        *((None, transform(f"person_{i}", f"p{i}/hand", (0, 1, 0))) for i in (1, 2)),
    )

    builder = settled(tree, people)

    assert sorted(builder.signals) == [
        "position/person_1",
        "position/person_1::p1_hand",
        "position/person_2",
        "position/person_2::p2_hand",
    ]
    assert builder.signals["position/person_2::p2_hand"].values.tolist() == [[2.0, 1.0, 0.0]]


# Missing and irregular transforms are reported.


def test_a_pattern_that_matches_no_frame_is_told() -> None:
    assert settled(tree_of((0.0, transform("world", "rail", (0, 0, 0))))).unrecorded == [
        "frame torso: no recorded frame matches; recorded frames: rail, world"
    ]


def test_a_frame_that_is_not_connected_to_the_root_is_told() -> None:
    builder = settled(tree_of((0.0, transform("map", "torso", (0, 0, 0)))))

    assert builder.unrecorded == ["frame torso: it is not connected to 'world', its tree ends at 'map'"]
    assert not builder.signals


def test_transforms_that_never_overlap_are_told() -> None:
    tree = tree_of((0.0, transform("world", "rail", (0, 0, 0))), (1.0, transform("rail", "torso", (0, 0, 0))))

    assert settled(tree).unrecorded == ["frame torso: the transforms up to 'world' never overlap in time"]


@pytest.mark.parametrize(
    ("at", "turn"),
    [
        ((math.nan, 0, 0), NO_TURN),
        ((0, math.inf, 0), NO_TURN),
        ((0, 0, 0), (0.0, 0.0, 0.0, 0.0)),
        ((0, 0, 0), (0.0, 0.0, 0.0, 1e-200)),
        ((0, 0, 0), (0.0, 0.0, 0.0, 1.02)),
        ((0, 0, 0), (math.nan, 0.0, 0.0, 1.0)),
    ],
)
def test_an_impossible_transform_is_left_out_and_counted(at: Place, turn: Turn) -> None:
    builder = settled(
        tree_of((0.0, transform("world", "torso", (1, 0, 0))), (0.1, transform("world", "torso", at, turn)))
    )

    assert builder.signals["position/gantry"].t.tolist() == [0.0]
    (defect,) = builder.build().log_defects
    assert (defect.kind, defect.where, defect.count) == ("unusable_transforms", "frame torso", 1)


def test_places_too_far_to_compute_with_are_left_out_and_counted() -> None:
    far = (1.7e308, 1.7e308, 1.7e308)
    tree = tree_of(
        (0.0, transform("world", "torso", far, QUARTER_TURN)), (None, transform("torso", "hand", far))
    )

    builder = settled(tree)

    assert "position/gantry::hand" not in builder.signals
    assert "impossible_values" in {defect.kind for defect in builder.build().log_defects}


def test_repeated_stamps_are_counted_and_go_when_they_contradict() -> None:
    same = settled(tree_of(*((0.0, transform("world", "torso", (x, 0, 0))) for x in (2, 2))))
    other = settled(tree_of(*((0.0, transform("world", "torso", (x, 0, 0))) for x in (1, 2))))

    assert same.signals["position/gantry"].values.tolist() == [[2.0, 0.0, 0.0]]
    assert [(d.kind, d.count) for d in same.build().log_defects] == [("repeated_stamps", 1)]
    assert "position/gantry" not in other.signals
    assert [(d.kind, d.count) for d in other.build().log_defects] == [
        ("contradicting_stamps", 1),
        ("repeated_stamps", 1),
    ]


# Refusals.


def test_a_frame_with_two_parents_is_refused() -> None:
    tree = tree_of(
        (0.0, transform("world", "torso", (0, 0, 0))), (0.1, transform("rail", "torso", (0, 0, 0)))
    )

    with pytest.raises(LogError, match="'torso' has 2 parents: 'rail', 'world'") as refusal:
        settled(tree)
    assert refusal.value.file == "t.bag"
    assert refusal.value.hint


def test_a_frame_that_is_its_own_ancestor_is_refused() -> None:
    tree = tree_of((0.0, transform("rail", "torso", (0, 0, 0))), (0.0, transform("torso", "rail", (0, 0, 0))))

    with pytest.raises(LogError, match="own ancestor"):
        settled(tree)


def test_contradictions_among_frames_nobody_asks_for_are_no_matter() -> None:
    tree = tree_of(
        (0.0, transform("world", "torso", (0, 0, 0))),
        (0.0, transform("camera_1", "part", (0, 0, 0))),
        (0.0, transform("camera_2", "part", (0, 0, 0))),
    )

    assert list(settled(tree).signals) == ["position/gantry"]


def test_two_frames_for_one_body_are_refused() -> None:
    tree = tree_of(*((0.0, transform("world", name, (0, 0, 0))) for name in ("torso_1", "torso_2")))

    with pytest.raises(LogError, match="recorded twice"):
        settled(tree, BodyMatch("torso_*", "robot", body="gantry"))


def test_transforms_whose_time_runs_backwards_by_a_lot_are_refused() -> None:
    tree = tree_of(*((t_s, transform("world", "torso", (0, 0, 0))) for t_s in (5.0, 3.0)))

    with pytest.raises(LogError, match=r"backwards by 2\.000 s in frame 'torso'"):
        settled(tree)


# Many at once.


def _samples(
    seed: int, count: int, *, jitter: bool, broken: bool = True
) -> list[tuple[int, str, str, list[float]]]:
    """Transforms of a chain of four frames as a recorder tells them; now and then one is broken."""
    dice = np.random.default_rng(seed)
    chain = [("world", "rail"), ("rail", "torso"), ("torso", "arm"), ("arm", "hand_tool")]
    found = []
    for i in range(count):
        for number, (parent, child) in enumerate(chain):
            at, turn = dice.normal(size=3), dice.normal(size=4)
            turn /= np.linalg.norm(turn)
            if broken and dice.random() < 0.02:
                turn *= dice.choice([0.0, 1.02, np.nan])
            late_ns = int(dice.integers(0, 3)) * number if jitter else 0
            found.append((i * 10_000_000 + late_ns, parent, child, [*at, *turn]))
    return found


def _reference(samples: list[tuple[int, str, str, list[float]]]) -> dict[int, list[float]]:
    """Where the hand is at the stamps that all four transforms have, by rotation matrices."""
    by_stamp: dict[int, dict[str, list[float]]] = {}
    for stamp_ns, _, child, row in samples:
        if abs(math.hypot(*row[3:]) - 1) <= 0.01:
            by_stamp.setdefault(stamp_ns, {})[child] = row
    places = {}
    for stamp_ns, rows in by_stamp.items():
        if len(rows) == 4:
            place = np.zeros(3)
            for child in ("hand_tool", "arm", "torso", "rail"):
                x, y, z, w = np.array(rows[child][3:]) / math.hypot(*rows[child][3:])
                turn = np.array(
                    [
                        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
                        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
                        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
                    ]
                )
                place = turn @ place + np.array(rows[child][:3])
            places[stamp_ns] = place.tolist()
    return places


def _handed_over(
    samples: list[tuple[int, str, str, list[float]]], pieces: int, share: float
) -> TransformTree:
    tree, names = TransformTree("world", file=Path("t.bag")), ["world", "rail", "torso", "arm", "hand_tool"]
    for piece in np.array_split(np.arange(len(samples)), pieces):
        some = [samples[i] for i in piece]
        if some:
            tree.add_many(
                names,
                np.array([names.index(parent) for _, parent, _, _ in some]),
                np.array([names.index(child) for _, _, child, _ in some]),
                list(np.array([row for *_, row in some]).T),
                np.array([stamp_ns for stamp_ns, *_ in some]),
                np.ones(len(some), dtype=bool),
                share=share,
            )
    return tree


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 10_000),
    count=st.integers(1, 60),
    pieces=st.integers(1, 5),
    share=st.sampled_from([0.0, 1e-9, 0.3, 1.0]),
    jitter=st.booleans(),
    broken=st.booleans(),
)
def test_transforms_that_come_together_lead_where_single_ones_do(
    seed: int, count: int, pieces: int, share: float, jitter: bool, broken: bool
) -> None:
    samples = _samples(seed, count, jitter=jitter, broken=broken)
    singly = TransformTree("world", file=Path("t.bag"))
    for stamp_ns, parent, child, row in samples:
        x, y, z, *turn = row
        singly.add(transform(parent, child, (x, y, z), (turn[0], turn[1], turn[2], turn[3])), stamp_ns)

    one, many = (settled(tree, GANTRY) for tree in (singly, _handed_over(samples, pieces, share)))

    assert one.unrecorded == many.unrecorded
    assert one.signals.keys() == many.signals.keys()
    for name, signal in one.signals.items():
        assert np.array_equal(signal.t, many.signals[name].t)
        assert np.array_equal(signal.values, many.signals[name].values)
    hand = many.signals.get("position/gantry::hand_tool")
    there = dict(zip((hand.t * 1e9).round().astype(int).tolist(), hand.values, strict=True)) if hand else {}
    for stamp_ns, place in _reference(samples).items():
        assert there[stamp_ns] == pytest.approx(place, abs=1e-12)


def test_more_transforms_than_are_composed_at_a_time_keep_their_hemisphere() -> None:
    # A slow turn about z, of which every other quaternion is published with the other sign.
    count = 20_001
    angle = np.linspace(0, 8 * math.pi, count)
    sign = np.where(np.arange(count) % 2, -1.0, 1.0)
    tree = TransformTree("world", file=Path("t.bag"))
    nothing = np.zeros(count)
    turn = [nothing, nothing, sign * np.sin(angle / 2), sign * np.cos(angle / 2)]
    stamps_ns, moving = np.arange(count) * 10_000_000, np.ones(count, dtype=bool)
    torso, world, hand = np.ones(count, int), np.zeros(count, int), np.full(count, 2)
    names = ["world", "torso", "hand"]
    tree.add_many(names, world, torso, [nothing, nothing, nothing, *turn], stamps_ns, moving)
    # The hand is published between two samples of the torso, whose quaternions must not cancel out.
    hand_at = [nothing + 2.0, nothing, nothing, nothing, nothing, nothing, nothing + 1.0]
    tree.add_many(names, torso, hand, hand_at, stamps_ns + 5_000_000, moving)

    found = settled(tree).signals["position/gantry::hand"]

    at = np.interp(found.t, stamps_ns / 1e9, angle)
    expected = np.stack([2 * np.cos(at), 2 * np.sin(at), np.zeros(len(at))], axis=1)
    assert found.values == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize(
    ("codes", "turn"),
    [
        ([7], 1),
        ([7, 7, 7], 1),
        ([3, 1, 2], 3),
        ([3, 1, 2, 3, 1, 2], 3),
        ([3, 1, 2, 3, 1], 0),  # the last turn is not whole
        ([3, 1, 2, 3, 2, 1], 0),  # in another order
        ([3, 1, 1, 3, 1, 1], 0),  # a frame comes twice in a turn: its samples are not evenly spaced
        ([3, 1, 2, 3, 1, 2, 3, 1, 4], 0),
        ([], 0),
        (list(range(1024)), 1024),
        (list(range(1025)), 0),
    ],
)
def test_frames_that_come_in_turn_are_noticed(codes: list[int], turn: int) -> None:
    assert _turn(np.array(codes, dtype=np.int64)) == turn


def test_a_guess_from_very_little_does_not_take_all_memory() -> None:
    """There may be thousands of frames."""
    edge, stamps_ns = _Edge(), np.arange(1000)
    edge.add_many(slice(0, 1000), stamps_ns, [stamps_ns.astype(np.float64)] * 7, 1e-12)

    assert edge.columns.base is not None
    assert edge.columns.base.nbytes <= 7 * 8 * 1000 * 71
