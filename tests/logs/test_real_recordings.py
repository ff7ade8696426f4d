"""Recordings that a real recorder made of a node whose clock and motion are known.

The README beside them says what is true: with t in s since the node's start, the human walks at 0.5 m/s
and the competition's state is published each second.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Set
from decimal import Decimal
from itertools import pairwise
from pathlib import Path
from random import Random

import numpy as np
import pytest
from rosbags.rosbag1 import Reader, Writer

from ariac_score import LogError, Result, Trial, Verdict, load_log_map, load_rule_set, score_trial
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import prepare
from ariac_score.engine.read import find_trial, read_trial
from ariac_score.logs.gather.arrival import arrival_delays_s, late_in_the_competition
from ariac_score.report.summary import summary_of
from ariac_score.results.adjustments import Adjustments, adjust, interval_that_counts, load_adjustments
from ariac_score.results.result_file import measured_sha256
from ariac_score.review.readiness import check_log
from ariac_score.scoring.interval import ScoreInterval
from ariac_score.trial.derive import Derivation, derive_signals

REAL = Path(__file__).parents[2].parent / "shared" / "real"

pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason=f"the real recordings are not at {REAL}")


def read(name: str, *quantities: str) -> Trial:
    registry = Registry()
    bundle, readers = find_trial(REAL / name, registry)
    return read_trial(bundle, readers, load_log_map("ariac2020"), registry, quantities=quantities)


def score(name: str) -> Result:
    return score_trial(REAL / name, "paper2020.published")


def test_a_competition_that_ends_with_done_is_found() -> None:
    trial = read("walk_done.bag")

    assert trial.started_s == pytest.approx(3.8992, abs=5e-5)
    assert trial.ended_s == pytest.approx(30.8989, abs=5e-5)


def test_a_gap_behind_the_end_of_the_competition_leaves_nothing_open() -> None:
    trial, result = read("walk_done.bag", "speed", "centre_distance"), score("walk_done.bag")

    signal = trial.signals["centre_distance/robot/human"]
    assert signal.span is not None
    (gap,) = signal.gaps(signal.span, max_gap_s=0.05)
    assert gap.duration_s == pytest.approx(0.057, abs=5e-4)
    assert trial.ended_s is not None
    assert gap.start_s > trial.ended_s
    assert result.status == "scored"
    assert Verdict.INCONCLUSIVE not in {finding.verdict for finding in result.measured.findings.values()}


def test_motion_is_timed_by_the_stamps_of_the_node_not_by_the_recorder() -> None:
    wanted = [Derivation(quantity, 0.2) for quantity in ("speed", "centre_distance")]
    signals = derive_signals(read("walk_tf_only.bag", "position"), wanted).signals
    human, robot = signals["speed/human"], signals["speed/robot"]

    assert len(human) == 1482
    np.testing.assert_allclose(human.values, 0.5, atol=1e-6)
    # x = 1.5 sin(0.4 t): at most 0.6 m/s, so d_min is at most 0.5 (1.0 + 1.5) + 0.6 * 1.0 + 2.6 = 4.45 m
    assert float(robot.values.max()) == pytest.approx(0.6, abs=1e-3)


@pytest.mark.slow
def test_snapshots_and_frames_of_one_motion_agree() -> None:
    """The recordings differ, but tell of one walk: what was nearest to the limit is the same in both."""
    of_frames, of_snapshots = (score(name) for name in ("walk_tf_only.bag", "walk_jitter.bag"))
    worst = [
        min(f.robustness for f in result.measured.of("separation").values() if f.robustness is not None)
        for result in (of_frames, of_snapshots)
    ]

    assert worst[0] == pytest.approx(worst[1], abs=2e-3)


def test_twelve_gaps_leave_the_score_between_two_numbers_and_hide_no_contact() -> None:
    result = score("walk_jitter.bag")
    found = check_log(REAL / "walk_jitter.bag", load_rule_set("paper2020.published"))

    assert (result.status, found.ready) == ("scored", False)
    assert result.interval is not None
    assert result.score == result.interval.least < result.interval.most
    assert all("on /snapshot" in one.cause for one in result.interval.narrowing)
    (lack,) = found.lacks  # a contact was impossible in all of them
    assert (lack.what, lack.effect) == ("separation", "opens")
    assert "the longest 0.064 s" in lack.cause
    assert "without gaps longer than 0.05 s" in lack.remedy


@pytest.mark.parametrize(("name", "longest_gap_s"), [("walk_done.bag", 0.029), ("walk_jitter.bag", 0.097)])
def test_an_honest_recording_lacks_nothing_and_says_how_late_what_nobody_stamped_arrived(
    name: str, longest_gap_s: float
) -> None:
    trial = late_in_the_competition(read(name, "centre_distance", "position"))

    # No message is later than the gap before it is long; those with stamps are not late at all. The longest
    # one of walk_done.bag, 57 ms, is behind the end of the competition, where anybody can cut it off.
    late_s = trial.signals["centre_distance/robot/human"].stamp_jitter_s
    assert late_s == pytest.approx(longest_gap_s, abs=0.001)
    assert trial.signals["position/human"].stamp_jitter_s == 0.0
    assert [signal.holes for signal in trial.signals.values()] == [()] * len(trial.signals)
    assert trial.log_defects == ()


def test_a_bag_that_was_cut_off_is_refused_with_what_is_left_and_the_remedy() -> None:
    left = r"cut off.*readable up to byte 700000: 9 topics, 5450 messages"
    with pytest.raises(LogError, match=left) as error:
        score("walk_killed.bag")
    # It is the beginning of walk_jitter.bag, which was closed: the header says where the index was.
    assert "had an index, at byte" in error.value.hint
    assert "another copy" in error.value.hint


WALK = """\
extends: paper2020.published
id: walk
title: With bounds
source: README there
bounds:
  human: {max_speed_m_s: 0.6, max_acceleration_m_s2: 2.0, source: its walk}
  robot: {max_speed_m_s: 0.7, max_acceleration_m_s2: 2.0, source: its rail}
"""


def test_with_bounds_stated_twelve_gaps_leave_four_hundredths_of_a_point(tmp_path: Path) -> None:
    """By the clock of the node that moved them it is 2.205 points; open is when the approach began."""
    rules = tmp_path / "walk.yaml"
    rules.write_text(WALK, encoding="utf-8")
    found = score_trial(REAL / "walk_jitter.bag", rules).interval

    assert found is not None
    assert float(found.least) < 2.205 < float(found.most)
    assert float(found.most - found.least) < 0.04
    assert not found.tight  # stamps of arrival, and three signals that need not have their worst together
    (narrowing,) = found.narrowing
    assert narrowing.cause.endswith("ms on /snapshot, stamped on arrival up to 97 ms late")
    assert narrowing.at_most == found.most - found.least


@pytest.mark.slow
def test_the_sparser_a_recording_is_the_wider_is_its_interval_around_the_truth(tmp_path: Path) -> None:
    """At 10 Hz no interval is short enough for a speed to be seen; the bounds of the bodies still hold."""
    rules = tmp_path / "walk.yaml"
    rules.write_text(WALK, encoding="utf-8")
    intervals = []
    for number, rate_hz in enumerate((100.0, 20.0, 10.0, 5.0, 1.0)):
        sparser = tmp_path / f"sparser_{number}.bag"
        with Reader(REAL / "walk_tf_only.bag") as reader, Writer(sparser) as writer:
            to = {
                one.id: writer.add_connection(
                    one.topic,
                    one.msgtype,
                    msgdef=one.msgdef.data,
                    md5sum=one.digest,
                    callerid=one.ext.callerid,
                )
                for one in reader.connections
            }
            due_ns = 0.0
            for connection, stamp, raw in reader.messages():
                if connection.topic == "/tf":
                    if stamp < due_ns:
                        continue
                    due_ns = stamp + 1e9 / rate_hz - 2e6
                writer.write(to[connection.id], stamp, raw)
        result = score_trial(sparser, rules)
        found = result.interval
        assert found is not None
        intervals.append((float(found.least), float(found.most)))
        if rate_hz in (10.0, 5.0):  # no sample shows a violation, and every world has one
            assert "It was not safe, how much so is open" in summary_of(result)

    assert all(least < 2.205 < most for least, most in intervals)
    assert intervals == sorted(intervals, key=lambda ends: ends[1] - ends[0])
    for (least, most), (fewer_least, fewer_most) in pairwise(intervals):
        assert fewer_least <= least < most <= fewer_most
    widths = [most - least for least, most in intervals]
    assert widths[0] < 0.1  # frames that stand for snapshots may be 1 cm off, and speeds change between them
    assert widths[2] < 0.6  # at most 8 points are possible


def test_one_gap_of_two_topics_is_one_line_of_what_would_narrow_a_score(tmp_path: Path) -> None:
    """Separation and contact are open in it, for a robot seen in frames and a human on a topic of her own."""
    ours = tmp_path / "ours.yaml"
    ours.write_text(
        "id: ours\ntitle: Two sources\nsource: by hand\nbodies: {human: {kind: human}}\n"
        "frames: [{match: torso_base, kind: robot, body: robot}]\n"
        "channels:\n  - {topic: /tf, poses: frames}\n"
        "  - topic: /lab/human_pose\n"
        "    signals: {position/human: [pose.position.x, pose.position.y, pose.position.z]}\n",
        encoding="utf-8",
    )
    found = score_trial(REAL / "walk_done.bag", prepare("safety", log_map=str(ours))).interval

    assert found is not None
    (narrowing,) = found.narrowing
    assert narrowing.cause == (
        "2 gaps of 68 to 2896 ms on /lab/human_pose and on tf frames, one before its first message"
    )
    assert set(narrowing.checks) == {"human_contact", "separation"}
    assert narrowing.at_most == found.most - found.least


# Two sources of one motion -------------------------------------------------------------

BY_THE_CLOCK_OF_THE_NODE = {"paper2020": 2.441343, "paper2020.published": 2.205222}
"""What the walk of walk_done.bag is worth, from its formulas at 1 kHz."""

SLACK = 1e-5
"""A violation that is seen begins and ends with a sample."""


def rewritten(name: str, folder: Path, keeps: Callable[[str, int], bool]) -> Path:
    """A recording without some of its messages, by their topics and times of recording, ns."""
    source, out = REAL / name, folder / name
    folder.mkdir(exist_ok=True)
    out.unlink(missing_ok=True)
    with Reader(source) as reader, Writer(out) as writer:
        to = {
            one.id: writer.add_connection(
                one.topic,
                one.msgtype,
                msgdef=one.msgdef.data,
                md5sum=one.digest,
                callerid=getattr(one.ext, "callerid", None),
            )
            for one in reader.connections
        }
        for connection, stamp, raw in reader.messages():
            if keeps(connection.topic, stamp):
                writer.write(to[connection.id], stamp, raw)
    return out


def without(
    topic: str, *, from_s: float = 0.0, to_s: float = 1e9, every: int = 1
) -> Callable[[str, int], bool]:
    """Keeps what is not on a topic, and of that in a time of recording all but every so-manieth message."""
    seen = Counter[str]()
    first_ns: list[int] = []

    def keeps(name: str, stamp: int) -> bool:
        first_ns.append(stamp) if not first_ns else None
        if name != topic or not from_s <= (stamp - first_ns[0]) / 1e9 <= to_s:
            return True
        seen[name] += 1
        return seen[name] % every != 0

    return keeps


def ends(log: Path, rules: str | Path) -> tuple[float, float]:
    result = score_trial(log, rules)
    assert result.score is not None
    most = result.score if result.interval is None else result.interval.most
    return float(result.score), float(most)


@pytest.mark.parametrize("rules", sorted(BY_THE_CLOCK_OF_THE_NODE))
def test_what_late_snapshots_leave_open_the_stamped_frames_of_the_same_walk_show(
    rules: str, tmp_path: Path
) -> None:
    truth = BY_THE_CLOCK_OF_THE_NODE[rules]
    least, most = ends(REAL / "walk_done.bag", rules)
    of_snapshots, _ = ends(rewritten("walk_done.bag", tmp_path, without("/tf")), rules)

    assert least <= truth <= most + SLACK
    assert most - least < 0.02
    assert of_snapshots < least - 0.9


@pytest.mark.slow
@pytest.mark.parametrize("rules", [*sorted(BY_THE_CLOCK_OF_THE_NODE), "bounded"])
@pytest.mark.parametrize("log", ["walk_done.bag", "walk_jitter.bag"])
def test_whatever_is_left_out_of_either_source_raises_no_end_that_counts(
    log: str, rules: str, tmp_path: Path
) -> None:
    asked: str | Path = rules
    if rules == "bounded":
        asked = tmp_path / "bounded.yaml"
        asked.write_text(f"id: b\ntitle: B\nsource: a test\nextends: paper2020.published\n{SPEEDS_BOUNDED}")
    honest, _ = ends(REAL / log, asked)
    for left_out in (
        without("/snapshot"),
        without("/tf"),
        without("/snapshot", every=2),
        without("/snapshot", from_s=1.0),
        without("/snapshot", from_s=6.0, to_s=20.0),
        without("/tf", from_s=6.0, to_s=20.0),
    ):
        counts, most = ends(rewritten(log, tmp_path, left_out), asked)
        assert counts <= honest
        assert most >= BY_THE_CLOCK_OF_THE_NODE.get(rules, 2.205222) - SLACK


@pytest.mark.slow
def test_a_result_says_what_stands_for_a_topic_that_is_not_there() -> None:
    found = score("walk_tf_only.bag").interval

    assert found is not None
    assert float(found.least) < BY_THE_CLOCK_OF_THE_NODE["paper2020.published"] < float(found.most)
    (narrowing,) = found.narrowing
    assert narrowing.cause.endswith("on tf frames in place of /snapshot")


@pytest.mark.slow
def test_frames_stand_for_nothing_where_the_log_map_asks_for_no_snapshots() -> None:
    alone = score_trial(REAL / "walk_tf_only.bag", prepare("paper2020.published", log_map="ariac2020"))

    assert alone.interval is not None
    assert float(alone.interval.least) > ends(REAL / "walk_tf_only.bag", "paper2020.published")[0]
    assert "in place of" not in " ".join(one.cause for one in alone.interval.narrowing)


@pytest.mark.slow
def test_leaving_out_messages_that_came_late_does_not_raise_what_counts(tmp_path: Path) -> None:
    """190 of 2963 snapshots were more than 5 ms late: without them all look on time, but their gaps stay."""
    with Reader(REAL / "walk_jitter.bag") as reader:
        times_ns = [stamp for connection, stamp, _ in reader.messages() if connection.topic == "/snapshot"]
    delays_s = arrival_delays_s((np.array(times_ns) - times_ns[0]) / 1e9)
    late = {stamp for stamp, delay_s in zip(times_ns, delays_s, strict=True) if delay_s > 0.005}
    assert len(late) == 190

    def worth(topics: Set[str], left_out: Set[int], rules: str) -> float:
        def keeps(topic: str, stamp: int) -> bool:
            return topic not in topics and (topic != "/snapshot" or stamp not in left_out)

        return ends(rewritten("walk_jitter.bag", tmp_path, keeps), rules)[0]

    for rules in BY_THE_CLOCK_OF_THE_NODE:
        for topics in (set[str](), {"/tf"}):
            assert worth(topics, late, rules) <= worth(topics, set(), rules)


# Stewards ------------------------------------------------------------------------------

SPEEDS_BOUNDED = """\
between_samples: bounded
bounds:
  human: {max_speed_m_s: 1.6, source: a test}
  robot: {max_speed_m_s: 1.0, source: a test}
"""
BOUNDED = """\
between_samples: bounded
bounds:
  human: {max_speed_m_s: 1.6, max_acceleration_m_s2: 5.0, source: a test}
  robot: {max_speed_m_s: 1.0, max_acceleration_m_s2: 5.0, source: a test}
"""


def scored(log: str, rules: str, folder: Path, more: str = "") -> Result:
    own = folder / "own.yaml"
    own.write_text(f"id: own\ntitle: Own\nsource: a test\nextends: {rules}\n{more}", encoding="utf-8")
    # Its snapshots alone, for with frames beside them hardly anything is open.
    return score_trial(rewritten(f"{log}.bag", folder, without("/tf")), own)


def ruled(result: Result, verdicts: Mapping[str, str], folder: Path) -> tuple[Decimal, ScoreInterval | None]:
    """What a result is worth after verdicts, and what they leave open."""
    if not verdicts:
        assert result.score is not None
        return result.score, result.interval
    adjustments = decisions(result, verdicts, folder)
    found, _ = adjust(result, adjustments, measured=measured_sha256(result))
    assert found.final is not None
    return found.final, interval_that_counts(found)


def of_separation(result: Result, verdict: Verdict) -> list[str]:
    return [key for key, one in result.measured.of("separation").items() if one.verdict is verdict]


@pytest.mark.slow
@pytest.mark.parametrize("rules", ["paper2020", "paper2020.published"])
def test_stewards_lower_no_score_by_finding_that_nothing_happened_in_a_gap(
    rules: str, tmp_path: Path
) -> None:
    result = scored("walk_jitter", rules, tmp_path)
    assert result.score is not None
    gaps = of_separation(result, Verdict.INCONCLUSIVE)
    (seen,) = of_separation(result, Verdict.VIOLATED)
    assert len(gaps) == 12

    def decided(*keys: str) -> Decimal:
        return ruled(result, dict.fromkeys(keys, "satisfied"), tmp_path)[0]

    assert result.score <= decided(gaps[0]) < decided(*gaps)
    # 86 gaps are too short for a finding: nobody decided that nothing was in them.
    assert result.score < decided(seen) < decided(seen, gaps[0]) < decided(seen, *gaps) < 4


@pytest.mark.parametrize(("more", "rules"), [("", "paper2020"), (BOUNDED, "paper2020.published")])
def test_a_verdict_about_what_was_seen_leaves_open_what_lies_beside_it(
    more: str, rules: str, tmp_path: Path
) -> None:
    """By the recording's 4 points of the task: nothing was violated at best, at worst what lies beside."""
    result = scored("walk_done", rules, tmp_path, more)
    assert result.score is not None
    (seen,) = of_separation(result, Verdict.VIOLATED)

    score, left = ruled(result, {seen: "satisfied"}, tmp_path)

    assert left is not None
    assert result.score < score == left.least < left.most == 4


def test_a_violation_that_may_have_been_beside_the_one_ruled_about_costs_what_it_cost(tmp_path: Path) -> None:
    """Demerits of `paper2020.published` by hand: 0.4 for each violation, and 0.4 times its depth in 5 s."""
    result = scored("walk_done", "paper2020.published", tmp_path)
    (seen,) = of_separation(result, Verdict.VIOLATED)
    span = result.measured.findings[seen].span
    (worlds,) = (one for one in result.measured.open if one.check == "separation")
    beside = [one for one in worlds.worst.values() if span and one.span and not one.span.overlaps(span)]
    assert len(beside) == 4  # one more begins in what was seen, and lasts 0.6 s longer
    depth = sum(one.quantities["relative_depth_integral_s"] for one in beside)

    score, _ = ruled(result, {seen: "satisfied"}, tmp_path)

    at_most, at_least = (4 / (1 + 0.4 * (n + depth_s / 5)) for n, depth_s in ((4, depth), (5, depth + 0.61)))
    assert at_least <= float(score) <= at_most


@pytest.mark.parametrize("more", ["", BOUNDED], ids=["as published", "bounded"])
def test_gaps_that_stewards_call_violated_cost_what_their_worst_was_and_close_no_others(
    more: str, tmp_path: Path
) -> None:
    result = scored("walk_jitter", "paper2020.published", tmp_path, more)
    assert result.interval is not None
    gaps = of_separation(result, Verdict.INCONCLUSIVE)

    for keys in (gaps[:1], gaps):
        score, left = ruled(result, dict.fromkeys(keys, "violated"), tmp_path)
        assert left is not None
        assert score == left.least == result.score  # which counts all gaps at their worst
        assert left.most < result.interval.most

    (seen,) = of_separation(result, Verdict.VIOLATED)
    cleared, _ = ruled(result, {seen: "satisfied"}, tmp_path)
    both, left = ruled(result, {seen: "satisfied", gaps[0]: "violated"}, tmp_path)
    assert left is not None
    assert left.least == both <= cleared
    assert left.most < 4


def test_a_violation_that_is_cleared_around_a_gap_that_is_not_becomes_no_two(tmp_path: Path) -> None:
    result = scored("walk_jitter", "paper2020.published", tmp_path, "score: task / (1 + count(separation))\n")
    (seen,) = of_separation(result, Verdict.VIOLATED)
    around = result.measured.findings[seen].span
    gaps = {key: result.measured.findings[key].span for key in of_separation(result, Verdict.INCONCLUSIVE)}
    within = next(key for key, span in gaps.items() if span and around and span.overlaps(around))

    against, _ = ruled(result, {within: "violated"}, tmp_path)
    both, left = ruled(result, {within: "violated", seen: "satisfied"}, tmp_path)

    assert both >= against
    assert left is not None
    assert left.most == 2  # 4 points of the task, and one violation that was ruled


def test_what_is_not_applicable_takes_no_points_of_what_is_satisfied(tmp_path: Path) -> None:
    result = scored("walk_jitter", "paper2020.published", tmp_path, "score: points(separation)\nopen: best\n")
    first, *_, last = of_separation(result, Verdict.INCONCLUSIVE)
    (seen,) = of_separation(result, Verdict.VIOLATED)
    cleared = {seen: "not_applicable", last: "satisfied"}

    alone, _ = ruled(result, cleared, tmp_path)
    with_another, _ = ruled(result, {**cleared, first: "not_applicable"}, tmp_path)

    assert with_another == alone == 1


@pytest.mark.slow
@pytest.mark.parametrize("counts", ["worst", "best"])
@pytest.mark.parametrize(
    "more",
    [
        "",
        BOUNDED,
        "score: task / (1 + count(separation))\n",
        f"{BOUNDED}score: task - 0.01 * (seconds(separation) + measure(separation, depth_integral_m_s))\n",
    ],
    ids=["published", "bounded", "counted", "timed"],
)
def test_no_verdict_against_a_team_raises_its_score_and_none_for_it_lowers_it(
    more: str, counts: str, tmp_path: Path
) -> None:
    result = scored("walk_jitter", "paper2020.published", tmp_path, f"{more}open: {counts}\n")
    findings = result.measured.of("separation")
    random = Random(20)  # noqa: S311  # seeded, so that every run tries the same
    for _ in range(6):
        verdicts: dict[str, str] = {}
        before, _ = ruled(result, verdicts, tmp_path)
        for key in random.sample(sorted(findings), 3):
            others = {"satisfied", "violated", "not_applicable"} - {findings[key].verdict.value}
            verdicts[key] = random.choice(sorted(others))
            after, left = ruled(result, verdicts, tmp_path)
            assert after <= before if verdicts[key] == "violated" else after >= before, verdicts
            assert left is None or left.least <= after <= left.most, verdicts
            before = after


def decisions(result: Result, verdicts: Mapping[str, str], folder: Path) -> Adjustments:
    lines = ["adjustments:"]
    for key, verdict in verdicts.items():
        trial, measured = result.measured.trial, measured_sha256(result)
        about = f"{{trial: {trial}, measured: {measured!r}, finding: '{key}'}}"
        name, ruling = (
            key.replace("#", "_"),
            "author: a steward, reason: seen on film, time: 2024-05-12T14:30:00Z",
        )
        lines.append(f"  - {{id: {name}, {ruling}, target: {about}, effect: {{verdict: {verdict}}}}}")
    (folder / "adjustments.yaml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    return load_adjustments(folder / "adjustments.yaml")
