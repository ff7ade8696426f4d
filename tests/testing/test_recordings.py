"""Recordings of the made trial: in messages of no competition, and in those that a plugin offers."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from ariac_score import QUANTITIES, Wanted, load_log_map
from ariac_score.checks.registry import Registry
from ariac_score.logs.rosbag import RosbagReader
from ariac_score.testing import __main__ as command
from ariac_score.testing import recorded_messages, write_bag
from ariac_score.testing.recordings import RecordsTrials
from ariac_score_ariac.recorder_messages import AriacScoreRecords
from ariac_score_ariac.testing import kitting_trial

TESTING = Path(__file__).parents[2] / "ariac_score/testing"
LOG_MAP = """
id: nobodys
title: The made trial in messages of no competition
source: ariac_score.testing.recordings
bodies:
  robot: {kind: robot}
  human: {kind: human}
channels:
  - {topic: /speed/robot, type: std_msgs/msg/Float64, signals: {speed/robot: data}}
  - {topic: /ariac_score/submissions, type: ariac_score_msgs/msg/Submission, decoder: ariac_score.records,
     witnesses: [submissions]}
  - {topic: /ariac_score/events, type: ariac_score_msgs/msg/TrialEvent, decoder: ariac_score.records}
  - {topic: /tf, type: tf2_msgs/msg/TFMessage, poses: frames}
frames:
  - {match: robot, kind: robot, body: robot}
  - {match: human, kind: human, body: human}
"""


def test_a_recording_of_no_competition_gives_back_the_trial_but_for_its_work(tmp_path: Path) -> None:
    made = kitting_trial()
    log = write_bag(tmp_path / "trial.mcap", recorded_messages(made), storage="mcap")
    (tmp_path / "log_map.yaml").write_text(LOG_MAP, encoding="utf-8")
    wanted = Wanted(
        load_log_map(str(tmp_path / "log_map.yaml")),
        frozenset(QUANTITIES),
        {"ariac_score.records": AriacScoreRecords()},
    )

    read = RosbagReader().read(log, wanted)

    assert read.work == ()
    assert [event.kind for event in read.events] == ["competition_started", "competition_ended"]
    assert made.witnessed - {"submissions"} <= read.witnessed
    assert read.submissions == ()
    for name in ("position/robot", "position/human", "speed/robot"):
        assert np.allclose(read.signals[name].values, made.signals[name].values, atol=1e-9)
        assert np.allclose(read.signals[name].t, made.signals[name].t, atol=1e-9)


def test_testing_names_no_message_topic_or_edition_of_a_competition() -> None:
    words = (
        "nist_gear",
        "osrf_gear",
        "ariac_msgs/",
        "/ariac/",
        *(f"ariac{year}" for year in range(2017, 2026)),
    )
    naming = [
        f"{path.relative_to(TESTING)}: {word}"
        for path in sorted(TESTING.rglob("*"))
        if path.suffix in (".py", ".tmpl")
        for word in words
        if word in path.read_text(encoding="utf-8")
    ]

    assert naming == []


def written(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.setattr(sys, "argv", ["ariac_score.testing", *arguments])
    command.main()


def offering() -> list[RecordsTrials]:
    """The installed competitions that offer recordings; there may be others that offer none."""
    built = [plugin.build({}) for plugin in Registry().all("ariac_score.competitions")]
    return [one for one in built if isinstance(one, RecordsTrials)]


@pytest.mark.slow
def test_the_command_records_in_the_messages_of_the_one_competition_that_offers_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (recorder,) = offering()
    for motion in recorder.motions:
        expected = recorder.recorded_messages(kitting_trial(), motion=motion)
        write_bag(tmp_path / f"{motion}.bag", expected, storage="ros1")

        written(monkeypatch, str(tmp_path / f"made_{motion}.bag"), "--motion", motion)

    recorded = {path.stem: path.read_bytes() for path in tmp_path.iterdir()}
    assert [recorded[f"made_{m}"] for m in recorder.motions] == [recorded[m] for m in recorder.motions]
    written(monkeypatch, str(tmp_path / "made.bag"))
    assert (tmp_path / "made.bag").read_bytes() == recorded[recorder.motions[0]]


@pytest.mark.slow
def test_where_several_competitions_offer_messages_one_is_to_be_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (recorder,) = offering()
    monkeypatch.setattr(command, "_recorders", lambda: {"first": recorder, "second": recorder})

    with pytest.raises(SystemExit):
        written(monkeypatch, str(tmp_path / "made.bag"))
    assert "several competitions offer recordings; give --competition first|second" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []

    written(monkeypatch, str(tmp_path / "made.bag"), "--competition", "second")
    expected = recorder.recorded_messages(kitting_trial(), motion=recorder.motions[0])
    write_bag(tmp_path / "expected.bag", expected, storage="ros1")
    assert (tmp_path / "made.bag").read_bytes() == (tmp_path / "expected.bag").read_bytes()


@pytest.mark.slow
def test_the_command_records_without_a_competition_given_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = write_bag(tmp_path / "a.bag", recorded_messages(kitting_trial()), storage="ros1")

    written(monkeypatch, str(tmp_path / "b.bag"), "--competition", "none")

    assert (tmp_path / "b.bag").read_bytes() == expected.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ["x.mcap", "--motion", "smell"],
            "ariac has no motion 'smell'; it has snapshot, human_state, frames",
        ),
        (
            ["x.mcap", "--competition", "none", "--motion", "frames"],
            "--motion is of the messages of",
        ),
        (["x.mcap", "--competition", "nobody"], "invalid choice: 'nobody'"),
        (["x.odd"], "no format goes with the suffix '.odd'"),
    ],
)
def test_the_command_refuses_in_words(
    arguments: list[str],
    words: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)

    with pytest.raises(SystemExit):
        written(monkeypatch, *arguments)

    assert words in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
