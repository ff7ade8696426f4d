"""A recording beside the log: read back with the reader of the format's authors and with rosbags."""

from __future__ import annotations

import io
import json
import math
import re
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ariac_score import (
    Finding,
    LogError,
    Result,
    Sample,
    Span,
    Trial,
    Verdict,
    as_json,
    load_result,
    load_rule_set,
    score_trial,
)
from ariac_score.cli import main
from ariac_score.engine.prepared import prepare
from ariac_score.review.annotate import messages_of, origin_ns
from ariac_score.review.annotation_messages import mcap_bytes
from ariac_score.review.margins import MarginSeries, Moment, read_again, tracks
from ariac_score.scoring.ruleset import Check
from ariac_score.testing import SNAPSHOT_SIGNALS, write_bag, write_trial_log
from ariac_score.trial.clock import Clock
from ariac_score_ariac.testing import kitting_trial, made_trial
from ariac_score_ariac.testing.recordings import recorded_messages

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples/kitting_near_miss.mcap"
ORIGIN_NS = 1_700_000_000_000_000_000
SEPARATION = "/ariac_score/separation/robot/human"
VIOLATIONS = "/ariac_score/violations"
LOG = "/ariac_score/log"


class Read(NamedTuple):
    """One message as an independent reader gives it."""

    topic: str
    type: str
    t_ns: int
    message: Any


def read(content: bytes) -> list[Read]:
    """With the library of the authors of MCAP, which checks every checksum."""
    reader = pytest.importorskip("mcap.reader", reason="the MCAP library of Foxglove is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    opened = reader.make_reader(
        io.BytesIO(content), validate_crcs=True, decoder_factories=[decoder.DecoderFactory()]
    )
    return [
        Read(channel.topic, schema.name, message.log_time, decoded)
        for schema, channel, message, decoded in opened.iter_decoded_messages()
    ]


@cache
def scored(path: Path) -> Result:
    return score_trial(path, "paper2020.published")


def annotated(path: Path, result: Result | None = None, named: str = "paper2020.published") -> list[Read]:
    result = result or scored(path)
    rules = prepare(named)
    trial = read_again(result, path, rules)
    return read(mcap_bytes(messages_of(result, trial, tracks(result, trial, rules), frame="world")))


@cache
def example() -> tuple[Read, ...]:
    return tuple(annotated(EXAMPLE))


def on(topic: str, messages: tuple[Read, ...] | list[Read] | None = None) -> list[Read]:
    return [m for m in (example() if messages is None else messages) if m.topic == topic]


# What it holds -------------------------------------------------------------------------


def test_every_monitor_has_a_topic() -> None:
    topics = {m.topic for m in example() if m.type == "ariac_score_msgs/msg/MonitorState"}

    assert topics == {
        SEPARATION,
        "/ariac_score/human_contact/robot/human",
        "/ariac_score/no_arm_collision/trial",
    }


def test_stamps_are_those_of_the_log() -> None:
    from rosbags.highlevel import AnyReader  # noqa: PLC0415  # slow

    with AnyReader([EXAMPLE]) as bag:
        (snapshots,) = [c for c in bag.connections if c.topic == "/snapshot"]
        recorded = {t_ns for _, t_ns, _ in bag.messages(connections=[snapshots])}
    stamps = [m.t_ns for m in on(SEPARATION)]

    assert set(stamps) <= recorded
    # The competition goes from 0.5 s to 38 s at 100 Hz, both ends counted.
    assert len(stamps) == 3751
    for m in on(SEPARATION):
        assert m.message.header.stamp.sec * 10**9 + m.message.header.stamp.nanosec == m.t_ns


def test_margins_are_the_distance_above_what_is_required() -> None:
    # By hand: 0.956 m too near at 20 s, the worst; 0.8 m/s * 5 ms at the first sample.
    margins = {m.t_ns - ORIGIN_NS: m.message.margin for m in on(SEPARATION)}

    assert min(margins.values()) == pytest.approx(-0.956)
    assert min(margins, key=margins.__getitem__) == 20_000_000_000
    assert margins[18_810_000_000] == pytest.approx(-0.004)
    assert margins[18_800_000_000] == pytest.approx(0.004)


def test_the_state_changes_where_the_finding_begins_and_ends() -> None:
    violated = [m.t_ns - ORIGIN_NS for m in on(SEPARATION) if m.message.state == 1]

    assert (violated[0], violated[-1]) == (18_810_000_000, 21_200_000_000)
    assert {m.message.state for m in on(SEPARATION)} == {0, 1}
    words = [m.message.message for m in on(SEPARATION) if m.message.message]
    assert len(words) == 3  # at the start, when it becomes too close, when it no longer is


def test_violations_are_markers_for_as_long_as_they_last() -> None:
    shown, gone = on(VIOLATIONS)

    assert (shown.t_ns - ORIGIN_NS, gone.t_ns - ORIGIN_NS) == (18_810_000_000, 21_210_000_000)
    (words,) = shown.message.markers  # the snapshot knows no places
    assert words.text.startswith("separation#1: robot/human: too close for 2.40 s")
    assert words.lifetime.sec * 10**9 + words.lifetime.nanosec == 2_400_000_000
    assert [(m.ns, m.id, m.action) for m in gone.message.markers] == [(words.ns, words.id, 2)]


@pytest.mark.slow
def test_markers_stand_where_the_bodies_were(tmp_path: Path) -> None:
    path = write_bag(
        tmp_path / "trial.mcap", recorded_messages(kitting_trial(), motion="frames"), storage="mcap"
    )
    messages = annotated(path)
    shown = on(VIOLATIONS, messages)[0].message.markers
    result = scored(path)
    trial = read_again(result, path, prepare("paper2020.published"))

    spheres = [m for m in shown if m.type == 2]
    worst_s = result.measured.findings["separation#1"].evidence[0].t_s
    assert len(spheres) == 2
    assert worst_s == pytest.approx(20.0, abs=0.05)
    for sphere, body in zip(spheres, ("robot", "human"), strict=True):
        signal = trial.signals[f"position/{body}"]
        worst = int(np.argmin(np.abs(signal.t - worst_s)))
        place = sphere.pose.position
        assert (place.x, place.y, place.z) == tuple(signal.values[worst])
        assert sphere.header.frame_id == "world"


def test_the_log_has_every_violation_and_the_score() -> None:
    lines = [(m.message.level, m.message.function, m.t_ns - ORIGIN_NS) for m in on(LOG)]

    assert (40, "separation#1", 18_810_000_000) in lines
    assert lines[-1] == (20, "score", 38_000_000_000)
    violated = [k for k, f in scored(EXAMPLE).measured.findings.items() if f.verdict is Verdict.VIOLATED]
    assert sorted(f for level, f, _ in lines if level == 40) == sorted(violated)


def test_rosbags_reads_the_same(tmp_path: Path) -> None:
    from rosbags.highlevel import AnyReader  # noqa: PLC0415  # slow

    assert (
        main(
            [
                "score",
                str(EXAMPLE),
                "--rules",
                "paper2020.published",
                "--output-format",
                "json",
                "-o",
                str(tmp_path / "r"),
            ]
        )
        == 0
    )
    assert main(["annotate", str(EXAMPLE), str(tmp_path / "r"), "-o", str(tmp_path / "out.mcap")]) == 0
    with AnyReader([tmp_path / "out.mcap"]) as bag:
        found = [
            (connection.topic, t_ns, bag.deserialize(raw, connection.msgtype).margin)  # type: ignore[attr-defined]
            for connection, t_ns, raw in bag.messages()
            if connection.topic == SEPARATION
        ]

    assert found == [(SEPARATION, m.t_ns, m.message.margin) for m in on(SEPARATION)]


def test_the_same_result_and_log_give_the_same_bytes(tmp_path: Path) -> None:
    (tmp_path / "r.json").write_text(as_json(scored(EXAMPLE)), encoding="utf-8")
    for name in ("a.mcap", "b.mcap"):
        assert main(["annotate", str(EXAMPLE), str(tmp_path / "r.json"), "-o", str(tmp_path / name)]) == 0

    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


def test_in_a_gap_nothing_is_said_but_that_it_is_undecided(tmp_path: Path) -> None:
    messages = [
        m
        for m in recorded_messages(kitting_trial())
        if m.topic != "/snapshot" or not 25.0 < (m.t_ns - ORIGIN_NS) / 1e9 < 30.0
    ]
    path = write_bag(tmp_path / "trial.mcap", messages, storage="mcap")
    found = annotated(path)

    states = [(m.t_ns - ORIGIN_NS, m.message.state, m.message.margin) for m in on(SEPARATION, found)]
    (undecided,) = [each for each in states if 25_000_000_000 < each[0] < 30_000_000_000]
    assert undecided[:2] == (25_000_000_001, 2)
    assert math.isnan(undecided[2])
    around = {t_ns: state for t_ns, state, _ in states}
    assert (around[25_000_000_000], around[30_000_000_000]) == (0, 0)
    assert [m for m in on(LOG, found) if m.message.level == 30 and m.message.name == "separation"]


def test_a_signal_that_is_missing_is_undecided_and_nothing_else(tmp_path: Path) -> None:
    kept = [name for name in SNAPSHOT_SIGNALS if "human" not in name]
    path = write_trial_log(tmp_path / "trial.jsonl", kitting_trial(), signals=kept)
    states = {m.message.state for m in on(SEPARATION, annotated(path))}

    assert 0 not in states
    assert 2 in states


# Monitors of every kind ----------------------------------------------------------------


@pytest.fixture(scope="module")
def everything(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A trial that has everything, and its result under every shipped monitor."""
    folder = tmp_path_factory.mktemp("everything")
    made = made_trial()
    # Its speeds are made up; 10 m/s higher, none is less than its positions show, which nobody would believe.
    fast = {
        name: replace(signal, values=10.0 + signal.values)
        if name.startswith(("speed/", "velocity/"))
        else signal
        for name, signal in made.signals.items()
    }
    log = write_trial_log(folder / "made.jsonl", replace(made, signals=fast))
    result = score_trial(log, str(ROOT / "examples/all_monitors.yaml"))
    file = folder / "result.json"
    file.write_text(as_json(result), encoding="utf-8")
    return log, file


@pytest.mark.slow
def test_every_monitor_has_a_margin_at_every_sample_or_is_named(
    everything: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, file = everything
    out = tmp_path / "out.mcap"
    assert main(["annotate", str(log), str(file), "-o", str(out)]) == 0
    notice = capsys.readouterr().err
    messages = read(out.read_bytes())

    states: dict[str, list[Any]] = {}
    for m in messages:
        if m.type == "ariac_score_msgs/msg/MonitorState":
            states.setdefault(m.topic.split("/")[2], []).append(m.message)
    rules = load_rule_set(str(ROOT / "examples/all_monitors.yaml"))
    monitors = [n for n, c in rules.checks.items() if c.group == "ariac_score.monitors"]
    assert set(states) == set(monitors)
    bare = {"stops", "collisions", "pose", "coverage", "no_arm_collision"}
    assert notice == (
        "notice: these monitors have a margin only where findings begin and end: "
        f"{', '.join(name for name in rules.checks if name in bare)}\n"
    )
    told = {m.message.name for m in on(LOG, messages) if m.message.function == "margins"}
    assert told == bare
    for name in set(monitors) - bare:
        # The made trial has 100 samples a second for 40 s, of which the competition has 37.5 s.
        assert len(states[name]) >= 3751, name


@pytest.mark.slow
def test_the_least_margin_beside_the_log_is_that_of_the_finding(everything: tuple[Path, Path]) -> None:
    log, file = everything
    result = json.loads(file.read_text())
    messages = [
        m
        for m in annotated(log, load_result(file), str(ROOT / "examples/all_monitors.yaml"))
        if m.type == "ariac_score_msgs/msg/MonitorState"
    ]

    checked = set()
    for finding in result["measured"]["findings"].values():
        if finding["verdict"] != "violated" or not finding["span"] or finding["robustness"] is None:
            continue
        start_s, end_s = finding["span"]["start_s"], finding["span"]["end_s"]
        own = [
            m.message.margin
            for m in messages
            if (m.message.check, m.message.subject, m.message.unit)
            == (finding["check"], finding["subject"], finding["unit"])
            and start_s - 1e-9 <= (m.t_ns - ORIGIN_NS) / 1e9 <= end_s + 1e-9
            and not math.isnan(m.message.margin)
        ]
        if finding["check"] not in ("stops", "pose", "coverage", "collisions"):
            assert min(own) == pytest.approx(finding["robustness"], abs=1e-9), finding["check"]
            checked.add(finding["check"])
    assert len(checked) >= 8, checked


@pytest.mark.slow
def test_several_limits_of_one_subject_have_a_topic_each(everything: tuple[Path, Path]) -> None:
    log, file = everything
    topics = {m.topic for m in annotated(log, load_result(file), str(ROOT / "examples/all_monitors.yaml"))}

    assert {t for t in topics if t.startswith("/ariac_score/standstill/robot/human")} == {
        "/ariac_score/standstill/robot/human",
        "/ariac_score/standstill/robot/human/drift_while_standing_still",
        "/ariac_score/standstill/robot/human/joint_speed_in_the_workspace",
    }


# Pieces --------------------------------------------------------------------------------


def test_a_monitor_of_which_only_findings_are_known_says_where_they_begin_and_end() -> None:
    finding = Finding(
        "robot",
        Verdict.VIOLATED,
        "too fast",
        span=Span(2.0, 5.0),
        robustness=-0.5,
        unit="m/s",
        evidence=(Sample("speed/robot", 3.0, 1.5, "m/s"),),
        check="comfort",
    )
    result = scored(EXAMPLE)
    others = {k: f for k, f in result.measured.findings.items() if f.check != "comfort"}
    changed = replace(result, measured=replace(result.measured, findings={**others, "comfort#1": finding}))
    base = load_rule_set("paper2020.published")
    unheard = Check("comfort", "proxemics.proximity_comfort", "ariac_score.monitors")
    rules = replace(base, checks={**base.checks, "comfort": unheard})
    trial = read_again(result, EXAMPLE, prepare(rules))
    (track,) = [t for t in tracks(changed, trial, prepare(rules)) if t.check == "comfort"]

    assert [(m.t_s, m.verdict, m.margin) for m in track.moments] == [
        (2.0, Verdict.VIOLATED, None),
        (3.0, Verdict.VIOLATED, -0.5),
        (5.0, None, None),
    ]


HOSTILE = ["../../etc", "a b", "1st", "<script>", "\u202eabc", "x" * 5000, "", "//", "a::b", "\ud800", "\x00"]


@pytest.mark.parametrize("subject", HOSTILE)
def test_any_subject_makes_a_topic_that_ros_allows(subject: str) -> None:
    result = scored(EXAMPLE)
    found = [
        MarginSeries.of("separation", text, "m", (Moment(1.0, Verdict.SATISFIED, 1.0, text),))
        for text in (subject, f"{subject}'", f'{subject}"')
    ]
    messages = read(mcap_bytes(messages_of(result, Trial("t"), found, frame="world")))
    topics = [m.topic for m in messages if m.type.endswith("MonitorState")]

    assert len(set(topics)) == 3
    for topic in topics:
        assert re.fullmatch(r"(/[A-Za-z_][A-Za-z0-9_]*)+", topic), topic


def test_a_margin_that_is_none_is_not_a_number() -> None:
    track = MarginSeries.of("c", "s", "", (Moment(1.0, Verdict.INCONCLUSIVE, None, "unknown"),))
    messages = read(mcap_bytes(messages_of(scored(EXAMPLE), Trial("t"), [track], frame="")))

    assert math.isnan(next(m for m in messages if m.topic == "/ariac_score/c/s").message.margin)


@given(st.integers(0, 2_000_000_000 * 10**9), st.integers(0, 86_400 * 10**9))
def test_a_stamp_of_the_log_comes_back_to_the_nanosecond(origin: int, since_ns: int) -> None:
    track = MarginSeries.of("c", "s", "", (Moment(since_ns / 1e9, Verdict.SATISFIED, 0.0),))
    trial = Trial("t", clocks=(Clock("log time", origin),))
    (state, *_) = [
        m for m in messages_of(_empty(), trial, [track], frame="") if m.topic == "/ariac_score/c/s"
    ]

    assert state.t_ns == origin + since_ns
    assert origin_ns(trial.clocks) == origin


def _empty() -> Result:
    result = scored(EXAMPLE)
    return replace(result, measured=replace(result.measured, findings={}))


def test_decisions_of_stewards_are_in_the_log(tmp_path: Path) -> None:
    (tmp_path / "r.json").write_text(as_json(scored(EXAMPLE)), encoding="utf-8")
    assert main(["adjust", str(tmp_path / "r.json"), "-o", str(tmp_path / "a.yaml")]) == 0
    text = (tmp_path / "a.yaml").read_text()
    for empty, told in (("author", "Jury"), ("reason", "late"), ("time", "2024-05-12T14:30:00Z")):
        text = text.replace(f'{empty}: ""', f'{empty}: "{told}"')
    (tmp_path / "a.yaml").write_text(text)
    command = ["adjust", str(tmp_path / "r.json"), str(tmp_path / "a.yaml"), "--output-format", "json"]
    assert main([*command, "-o", str(tmp_path / "adjusted.json")]) == 0
    assert (
        main(["annotate", str(EXAMPLE), str(tmp_path / "adjusted.json"), "-o", str(tmp_path / "o.mcap")]) == 0
    )

    words = [m.message.msg for m in on(LOG, read((tmp_path / "o.mcap").read_bytes()))]
    assert words[-3:] == [
        "automatic score 19.761677",
        "adjusted by Jury, 2024-05-12T14:30:00Z: -1 points: late",
        "adjusted score 18.761677",
    ]


# Bad input -----------------------------------------------------------------------------


def test_the_log_of_another_result_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "r.json").write_text(as_json(scored(EXAMPLE)), encoding="utf-8")
    other = write_bag(tmp_path / "other.mcap", recorded_messages(kitting_trial())[:-1], storage="mcap")

    assert main(["annotate", str(other), str(tmp_path / "r.json"), "-o", str(tmp_path / "out.mcap")]) == 6
    assert "the result was not made from other.mcap" in capsys.readouterr().err
    assert not (tmp_path / "out.mcap").exists()


@pytest.mark.parametrize("name", ["r.json", "log.mcap"])
def test_nothing_is_written_over_what_it_is_made_from(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "r.json").write_text(as_json(scored(EXAMPLE)), encoding="utf-8")
    (tmp_path / "log.mcap").write_bytes(EXAMPLE.read_bytes())
    before = (tmp_path / name).read_bytes()

    command = ["annotate", str(tmp_path / "log.mcap"), str(tmp_path / "r.json"), "-o", str(tmp_path / name)]
    assert main(command) == 4
    assert (tmp_path / name).read_bytes() == before
    assert "would overwrite" in capsys.readouterr().err


@pytest.mark.slow
def test_where_nothing_can_be_written_that_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "r.json").write_text(as_json(scored(EXAMPLE)), encoding="utf-8")

    command = ["annotate", str(EXAMPLE), str(tmp_path / "r.json"), "-o", str(tmp_path / "missing/o.mcap")]
    assert main(command) == 4
    assert "cannot be written" in capsys.readouterr().err


def test_a_link_keeps_pointing_where_it_did_and_nothing_else_is_left(tmp_path: Path) -> None:
    (tmp_path / "r.json").write_text(as_json(scored(EXAMPLE)), encoding="utf-8")
    (tmp_path / "out.mcap").symlink_to(tmp_path / "really.mcap")
    (tmp_path / "really.mcap").write_bytes(b"what was there before")

    assert main(["annotate", str(EXAMPLE), str(tmp_path / "r.json"), "-o", str(tmp_path / "out.mcap")]) == 0

    assert (tmp_path / "out.mcap").is_symlink()
    assert [m.t_ns for m in read((tmp_path / "really.mcap").read_bytes())] == [m.t_ns for m in example()]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["out.mcap", "r.json", "really.mcap"]


def test_an_edited_result_is_refused(tmp_path: Path) -> None:
    data = json.loads(as_json(scored(EXAMPLE)))
    data["score"] = 30.0
    (tmp_path / "r.json").write_text(json.dumps(data), encoding="utf-8")

    assert main(["annotate", str(EXAMPLE), str(tmp_path / "r.json"), "-o", str(tmp_path / "o.mcap")]) == 6


def test_a_time_before_the_clocks_zero_is_refused() -> None:
    track = MarginSeries.of("c", "s", "", (Moment(-1.0, Verdict.SATISFIED, 0.0),))

    with pytest.raises(Exception, match="before the zero of the log's clock"):
        messages_of(_empty(), Trial("t"), [track], frame="")


def test_a_time_that_ros_cannot_count_is_refused() -> None:
    # sec of builtin_interfaces/Time is an int32: 2038-01-19, 03:14:07 UTC is the last one.
    def stamps(t_s: float) -> list[int]:
        track = MarginSeries.of("c", "s", "", (Moment(t_s, Verdict.SATISFIED, 0.0),))
        messages = messages_of(_empty(), Trial("t"), [track], frame="")
        return [m.t_ns for m in messages if m.topic == "/ariac_score/c/s"]

    assert stamps(2**31 - 1.0) == [(2**31 - 1) * 10**9]
    with pytest.raises(LogError, match="after the year 2038"):
        stamps(2.0**31)


def test_a_gap_in_which_the_limit_was_kept_at_worst_has_a_margin(tmp_path: Path) -> None:
    """60 ms are missing while both are metres apart: what is known there, no sample shows."""
    trial = kitting_trial()
    left = {}
    for name, signal in trial.signals.items():
        stays = abs(signal.t - 5.0) > 0.025
        left[name] = replace(signal, t=signal.t[stays], values=signal.values[stays])
    log, result = tmp_path / "gap.jsonl", tmp_path / "r.json"
    write_trial_log(log, replace(trial, signals=left), signals=SNAPSHOT_SIGNALS)
    rules = tmp_path / "ours.yaml"
    rules.write_text(
        "id: ours\ntitle: Ours\nsource: a test\nextends: paper2020.published\nbounds:\n"
        "  human: {max_speed_m_s: 1.0, source: a test}\n  robot: {max_speed_m_s: 0.6, source: a test}\n"
    )
    assert main(["score", str(log), "--rules", str(rules), "-o", str(result)]) == 0
    assert load_result(result).interval is None

    assert main(["annotate", str(log), str(result), "-o", str(tmp_path / "out.mcap")]) == 0
