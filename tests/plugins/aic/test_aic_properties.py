"""Random recordings: the fast way through whole columns says what a slow, literal one says."""

from __future__ import annotations

import random
from dataclasses import dataclass

import numpy as np
import pytest

from ariac_score_aic.chains import (
    Feed,
    at_every_stamp,
    final_buffer,
    poses_while_reading,
    replayed,
    stamps_asked,
    taken,
    with_link,
)
from ariac_score_aic.checks import ForceTime
from ariac_score_aic.jerk import jerk_of_velocities
from ariac_score_aic.messages import SCORING_STATIC, SCORING_TF, TF, TF_STATIC, Transforms
from ariac_score_aic.strict import ForceBounds

from .tf2_reference import Sample, Tf2

TARGET, SOURCE = "aic_world", "gripper/tcp"
TOPICS = (TF, TF_STATIC, SCORING_TF, SCORING_STATIC)
STEP_NS = 20_000_000
SEEDS = range(24)


@dataclass
class Message:
    topic: str
    stamp: int
    parent: str
    child: str
    at: tuple[float, ...]
    turn: tuple[float, ...]


def recording(seed: int) -> list[Message]:
    """A tree of a few frames, whose messages come late, twice, backwards, unsound or from another parent."""
    rng = random.Random(seed)  # noqa: S311  # made recordings
    links = [("world", "base_link"), ("base_link", "wrist"), ("wrist", SOURCE), (TARGET, "task_board/port")]
    if rng.random() < 0.7:
        links.append(("world", TARGET) if rng.random() < 0.5 else (TARGET, "world"))
    unruly = seed % 3 == 0
    static = {child: rng.random() < 0.35 for _, child in links}
    found: list[tuple[float, Message]] = []
    for parent, child in links:
        rate = rng.choice([1, 2, 3])
        for step in range(0, 1 if static[child] else 40, rate):
            stamp = (100 + step) * STEP_NS
            arrives = step + rng.random() * rng.choice([0.5, 2.0])
            if unruly and rng.random() < 0.1:
                stamp -= rng.randrange(5) * STEP_NS
            turn = [rng.gauss(0, 1) for _ in range(4)]
            norm = sum(q * q for q in turn) ** 0.5 * (rng.choice([1, 1, 1.004, 1.2]) if unruly else 1)
            up = (
                rng.choice(["world", parent])
                if unruly and child == "wrist" and rng.random() < 0.1
                else parent
            )
            topic = TF_STATIC if static[child] else rng.choice([TF, SCORING_TF]) if unruly else TF
            at = tuple(rng.uniform(-1, 1) for _ in range(3))
            message = Message(topic, stamp, up, child, at, tuple(q / norm for q in turn))
            found.append((arrives, message))
            if unruly and rng.random() < 0.1:
                found.append((arrives + rng.random(), message))
    return [message for _, message in sorted(found, key=lambda pair: pair[0])]


def columns(messages: list[Message]) -> Transforms:
    names = sorted({name for m in messages for name in (m.parent, m.child)})
    return Transforms(
        np.arange(1, len(messages) + 1),
        np.array([TOPICS.index(m.topic) for m in messages]),
        np.array([m.stamp for m in messages]),
        np.array([names.index(m.parent) for m in messages]),
        np.array([names.index(m.child) for m in messages]),
        np.array([(*m.at, *m.turn) for m in messages]),
        TOPICS,
        tuple(names),
    )


def feed_of(seed: int) -> Feed:
    return Feed(10**12 if seed % 4 else 15 * STEP_NS)


def slowly(messages: list[Message], feed: Feed) -> tuple[Tf2, list[tuple[int, np.ndarray]]]:
    """What a literal scorer appends while it reads, and what it knows then."""
    buffer, poses = Tf2(feed.buffer_ns), list[tuple[int, np.ndarray]]()
    for m in messages:
        static = m.topic == TF_STATIC or "task_board" in m.child
        buffer.insert(m.child, Sample(m.stamp, m.parent, m.at, m.turn), static=static)
        found = None if m.topic == TF_STATIC else buffer.lookup(TARGET, SOURCE, 0)
        if found is not None and (not poses or poses[-1][0] != found[0]):
            poses.append(found)
    return buffer, poses


@pytest.mark.parametrize("seed", SEEDS)
def test_poses_while_reading_are_those_of_a_literal_buffer(seed: int) -> None:
    messages, feed = recording(seed), feed_of(seed)
    transforms = columns(messages)
    _, expected = slowly(messages, feed)

    by_columns = poses_while_reading(transforms, taken(transforms, feed), feed, TARGET, SOURCE)
    one_by_one = replayed(transforms, feed, TARGET, SOURCE)

    for found in (by_columns, one_by_one):
        assert found.stamp_ns.tolist() == [stamp for stamp, _ in expected]
        if expected:
            np.testing.assert_allclose(found.position_m, [at for _, at in expected], atol=1e-9)


@pytest.mark.parametrize("seed", SEEDS)
def test_places_after_reading_are_those_of_a_literal_buffer(seed: int) -> None:
    # The link that is added turns a recorded one the other way round into a loop: not looked at.
    messages, feed = [m for m in recording(seed) if m.child != "world"], feed_of(seed)
    transforms = columns(messages)
    buffer, _ = slowly(messages, feed)
    buffer.insert(TARGET, Sample(0, "world", (0, 0, 0), (0, 0, 0, 1)), static=True)
    expected = {}
    for stamp in sorted({m.stamp for m in messages if m.topic != TF_STATIC}):
        if (one := buffer.lookup(TARGET, SOURCE, stamp)) is not None:
            expected[stamp] = one[1]

    linked = with_link(taken(transforms, feed), "world", TARGET)
    known = final_buffer(linked, feed, (TARGET, SOURCE))
    found = at_every_stamp(stamps_asked(transforms, feed), linked, known, feed, TARGET, SOURCE)

    assert found.stamp_ns.tolist() == list(expected)
    if expected:
        np.testing.assert_allclose(found.position_m, list(expected.values()), atol=1e-9)


def test_most_random_recordings_have_poses_and_some_have_none() -> None:
    # Otherwise the two tests above compare nothing with nothing.
    counts = [len(slowly(recording(seed), feed_of(seed))[1]) for seed in SEEDS]

    assert sum(count > 5 for count in counts) > len(SEEDS) // 3
    assert 0 in counts


# Formulas ------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(8))
def test_jerk_is_that_of_a_fit_of_each_window(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(10, 60))
    steps = rng.choice([0.0, 0.002, 0.002, 0.004, -0.002], count)
    t_s = 100 + np.cumsum(steps if seed % 2 else rng.uniform(0.001, 0.01, count))
    velocity = np.cumsum(rng.normal(0, 0.01, (count, 3)), axis=0)
    total, weights = 0.0, 0.0
    for i in range(7, count - 7):
        window = slice(i - 7, i + 8)
        if np.linalg.norm(velocity[i]) > 0.01 and len(set((t_s[window] - t_s[i]).tolist())) >= 3:
            scale = np.abs(t_s[window] - t_s[i]).max()
            fit = np.polynomial.polynomial.polyfit((t_s[window] - t_s[i]) / scale, velocity[window], 2)
            weight = (t_s[i + 7] - t_s[i - 7]) / 15
            total += weight * float(np.linalg.norm(2 * fit[2] / scale**2))
            weights += weight

    found = jerk_of_velocities(t_s, velocity)
    if abs(weights) < 1e-6:
        assert found.value_m_s3 is None
    else:
        assert found.value_m_s3 == pytest.approx(total / weights, rel=1e-6)


@pytest.mark.parametrize("seed", range(8))
def test_time_above_a_threshold_is_that_of_a_plain_loop_and_within_its_bounds(seed: int) -> None:
    rng = random.Random(seed)  # noqa: S311  # made recordings
    stamps = [10**9]
    for _ in range(80):
        stamps.append(stamps[-1] + rng.choice([20_000_000, 20_000_000, 20_000_000, 300_000_000]))
    force = [rng.choice([19.0, 20.0, 21.0, 30.0]) for _ in stamps]
    coded = sum((b - a) / 1e9 for a, b, f in zip(stamps, stamps[1:], force[1:], strict=False) if f > 20)

    found_s, peak_n, _ = ForceTime().time_above_s(np.array(stamps) / 1e9, np.array(force))
    least_s, most_s, _ = ForceBounds().time_above_s(
        np.array(stamps), np.array(force), (stamps[0], stamps[-1])
    )

    assert found_s == pytest.approx(coded, abs=1e-9)
    assert peak_n == max(force[1:])
    assert least_s <= coded + 1e-9
    assert coded <= most_s + 1e-9


@pytest.mark.parametrize("seed", range(40))
def test_whoever_leaves_out_forces_bounds_the_time_above_the_threshold_no_closer(seed: int) -> None:
    rng = random.Random(seed)  # noqa: S311  # made recordings
    stamps = np.arange(100, dtype=np.int64) * 20_000_000 + 10**9 + rng.randrange(20_000_000)
    force = np.array([rng.choice([10.0, 30.0]) for _ in stamps])
    kept = np.array([rng.random() > rng.choice([0.02, 0.5, 0.9]) for _ in stamps])
    if rng.random() < 0.3:
        kept &= force < 20.0
    span = int(stamps[0]) - 5_000_000, int(stamps[-1]) + 5_000_000

    least_s, most_s, unseen_s = ForceBounds().time_above_s(stamps, force, span)
    fewest_s, longest_s, more_unseen_s = ForceBounds().time_above_s(stamps[kept], force[kept], span)

    assert unseen_s == 0.0
    assert (more_unseen_s > 0.0) == (not kept.all())
    assert fewest_s <= least_s + 1e-9
    assert most_s <= longest_s + 1e-9
