"""Log maps: the shipped ones are sound, and each kind of mistake is reported with place, cause and remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.checks.registry import Registry
from ariac_score.errors import LogMapError
from ariac_score.logs.logmap import load_log_map, log_map_names
from ariac_score.trial.channels import BodyMatch, Channel, FieldMap, PluginUse
from ariac_score.trial.model import Body
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of

SOUND = """\
id: example
title: Example
source: by hand
bodies:
  robot: {kind: robot, radius_m: 0.3}
  human: {kind: human}
channels:
  - topic: snapshot
    type: a/msg/B
    stamp: header
    signals:
      speed/human: v
      position/robot: [p.x, p.y, p.z]
      centre_distance/robot/human: d
  - topic: /events
    decoder: ariac_score.records
    witnesses: [submissions]
models:
  - {match: "person_*", kind: human, links: ["*hand*"]}
tracks:
  use: ariac.models
  with: {names: part}
competition: {use: ariac}
"""


@pytest.fixture
def written(tmp_path: Path) -> Path:
    return tmp_path / "map.yaml"


def refusal(path: Path, old: str, new: str) -> LogMapError:
    assert SOUND.count(old) == 1
    path.write_text(SOUND.replace(old, new), encoding="utf-8")
    with pytest.raises(LogMapError) as refused:
        load_log_map(str(path))
    assert refused.value.file == str(path)
    assert refused.value.exit_code == 4
    return refused.value


def test_a_quantity_of_pairs_may_be_of_any_two_declared_bodies(written: Path) -> None:
    bodies = "  truck: {kind: vehicle}\n  bus: {kind: vehicle}\n  ann: {kind: pedestrian}\n"
    signals = "{separation/truck/ann: d, separation/truck/bus: e, separation/human/robot: f}"
    channels = f"channels:\n  - {{topic: a, signals: {signals}}}\n"
    written.write_text(SOUND.replace("channels:\n", bodies + channels), encoding="utf-8")

    read = load_log_map(str(written)).channels[0].signals

    assert [one.signal for one in read] == [
        "separation/truck/ann",
        "separation/truck/bus",
        "separation/human/robot",
    ]


@pytest.mark.parametrize("name", log_map_names())
def test_every_shipped_log_map_loads_and_goes_by_its_own_name(name: str) -> None:
    assert load_log_map(name).id == name


@pytest.mark.parametrize("name", log_map_names())
def test_every_shipped_log_map_names_installed_decoders_and_known_quantities_only(name: str) -> None:
    log_map = load_log_map(name)

    decoders = {channel.decoder for channel in log_map.channels if channel.decoder}
    assert decoders <= set(Registry().names("ariac_score.decoders"))
    fields = [field for channel in log_map.channels for field in channel.signals]
    assert all(field.unit == QUANTITIES[quantity_of(field.signal)].unit for field in fields)


def test_there_are_log_maps() -> None:
    assert {f"ariac{year}" for year in range(2018, 2025)} <= set(log_map_names())


def test_a_sound_log_map_is_read_as_written(written: Path) -> None:
    written.write_text(SOUND, encoding="utf-8")

    log_map = load_log_map(str(written))

    assert log_map.bodies == (Body("robot", "robot", 0.3), Body("human", "human"))
    assert log_map.channels[0] == Channel(
        topic="/snapshot",  # a leading slash is supplied
        type="a/msg/B",
        stamp="header",
        signals=(
            FieldMap("speed/human", "m/s", ("v",)),
            FieldMap("position/robot", "m", ("p.x", "p.y", "p.z")),
            FieldMap("centre_distance/robot/human", "m", ("d",)),
        ),
    )
    assert log_map.channels[1] == Channel(
        "/events", decoder="ariac_score.records", witnesses=("submissions",)
    )
    assert log_map.models == (BodyMatch("person_*", "human", links=("*hand*",)),)
    assert log_map.tracks == PluginUse("ariac.models", {"names": "part"})
    assert log_map.competition == PluginUse("ariac")
    assert (log_map.root_frame, log_map.speed_window_s) == ("world", 0.0)


def test_a_relative_path_is_looked_up_beside_the_rule_set(written: Path) -> None:
    written.write_text(SOUND, encoding="utf-8")

    assert load_log_map("map.yaml", beside=written.parent).id == "example"
    with pytest.raises(LogMapError, match="no such file"):
        load_log_map("map.yaml", beside=written.parent / "elsewhere")


def test_an_absolute_path_is_taken_as_it_is(written: Path) -> None:
    written.write_text(SOUND, encoding="utf-8")

    assert load_log_map(str(written), beside=Path("/nowhere")).id == "example"


@pytest.mark.parametrize(
    ("old", "new", "place", "cause", "hint"),
    [
        ("title:", "tilte:", "line 2, $.tilte", "unknown key 'tilte' (and 1 more)", "did you mean 'title'?"),
        ("title: Example\n", "", "line 1, $", "key 'title' is missing", "add 'title'"),
        (
            "    stamp:",
            "    stmap:",
            "line 10, $.channels[0].stmap",
            "unknown key 'stmap'",
            "did you mean 'stamp'?",
        ),
        (
            "stamp: header",
            "stamp: heder",
            "line 10, $.channels[0].stamp",
            "'heder' is not allowed",
            "'header'",
        ),
        (
            "kind: robot,",
            "kind: Robot,",
            "line 5, $.bodies.robot.kind",
            "'Robot' does not match",
            "Such as robot",
        ),
        (
            "radius_m: 0.3",
            "radius_m: -0.3",
            "$.bodies.robot.radius_m",
            "-0.3 is less than the minimum",
            "Radius",
        ),
        (
            "radius_m: 0.3",
            "radius_m: true",
            "$.bodies.robot.radius_m",
            "True is not of type 'number'",
            "give",
        ),
        # No minimum is above NaN, and no maximum below it.
        *(
            (
                "source: by hand",
                f"source: by hand\n{text}",
                place,
                f"{said} is not a finite number",
                "give a number",
            )
            for text, place, said in (
                ("bounds: {time_error_s: .nan}", "$.bounds.time_error_s", "nan"),
                ("bounds: {distance_error_m: .inf}", "$.bounds.distance_error_m", "inf"),
                ("bounds: {human: {max_speed_m_s: .nan, source: x}}", "$.bounds.human.max_speed_m_s", "nan"),
                ("speed_window_s: .nan", "$.speed_window_s", "nan"),
            )
        ),
        (
            "    type: a/msg/B\n",
            "    rate_hz: .inf\n",
            "$.channels[0].rate_hz",
            "inf is not a finite number",
            "give",
        ),
        (
            "    decoder: ariac_score.records\n    witnesses: [submissions]\n",
            "    witnesses: [submissions]\n    rate_hz: 10\n",
            "$.channels[1].rate_hz",
            "a channel without signals or a decoder has no rate",
            "each entry of 'frames:' and 'models:' has a rate of its own",
        ),
        (
            "speed/human",
            "sped/human",
            "line 12, $.channels[0].signals.sped/human",
            "unknown quantity 'sped'",
            "did you mean 'speed'?",
        ),
        (
            "[p.x, p.y, p.z]",
            "[p.x, p.y]",
            "line 13, $.channels[0].signals.position/robot",
            "position has 3 component(s), 2 field(s) are given",
            "one field for each component",
        ),
        (
            "human: v",
            "human: [v, w]",
            "line 12",
            "speed has 1 component(s), 2 field(s) are given",
            "one field",
        ),
        ("[p.x, p.y, p.z]", "p", "line 13", "position has 3 component(s), 1 field(s) are given", "one field"),
        (
            "speed/human",
            "speed/humn",
            "line 12",
            "'speed/humn' does not name one body",
            "did you mean 'human'?",
        ),
        ("speed/human", "speed/robot/human", "line 12", "does not name one body", "bodies"),
        (
            "centre_distance/robot/human",
            "centre_distance/human",
            "line 14",
            "'centre_distance/human' does not name two bodies",
            "bodies",
        ),
        (
            "centre_distance/robot/human",
            "centre_distance/robot/persn",
            "line 14",
            "does not name two bodies",
            "bodies of this log map",
        ),
        # Nothing is at a distance from itself.
        (
            "distance/robot/human",
            "distance/robot/robot",
            "line 14",
            "does not name two bodies",
            "bodies",
        ),
        (
            "    decoder: ariac_score.records\n    witnesses: [submissions]\n",
            "    type: a/msg/B\n",
            "line 15, $.channels[1]",
            "a channel must map signals, poses, an event, facts or a decoder, or witness something",
            "add 'signals:'",
        ),
        (
            "    decoder: ariac_score.records\n    witnesses: [submissions]\n",
            "    signals: {}\n",
            "line 15, $.channels[1]",
            "a channel must map signals",
            "add 'signals:'",
        ),
        (
            "    type: a/msg/B\n",
            "    poses: all\n",
            "$.channels[0].poses",
            "'all' is not allowed here",
            "allowed",
        ),
        (
            "  - topic: snapshot\n    type",
            "  - type",
            "line 8, $.channels[0]",
            "key 'topic' is missing",
            "add",
        ),
        (
            "source: by hand",
            "source: by hand\nspeed_window_s: -1",
            "$.speed_window_s",
            "-1 is less than",
            "Half",
        ),
        ("  human: {", "  robot: {", "line 6", "key 'robot' is given twice", "keep one"),
        (
            "witnesses: [submissions]",
            "optional: 1",
            "$.channels[1].optional",
            "1 is not of type 'boolean'",
            "",
        ),
        ("with: {names", "wiht: {names", "$.tracks.wiht", "unknown key 'wiht'", "did you mean 'with'?"),
        ("tracks:\n  use: ariac.models\n", "tracks:\n", "$.tracks", "key 'use' is missing", "add"),
        ("id: example", "id: Example 1", "line 1, $.id", "'Example 1' does not match", ""),
    ],
)
def test_a_mistake_is_told_with_its_place_its_cause_and_a_remedy(
    written: Path, old: str, new: str, place: str, cause: str, hint: str
) -> None:
    error = refusal(written, old, new)

    assert place in error.place
    assert cause in error.cause
    assert hint in error.hint


def extending(folder: Path, own: str) -> Path:
    (folder / "base.yaml").write_text(SOUND, encoding="utf-8")
    path = folder / "own.yaml"
    path.write_text(f"extends: ./base.yaml\nid: own\ntitle: Own\nsource: a test\n{own}", encoding="utf-8")
    return path


def test_a_body_of_the_extended_log_map_is_left_out_with_all_that_speaks_of_it(tmp_path: Path) -> None:
    whole = load_log_map(extending(tmp_path, ""))
    found = load_log_map(extending(tmp_path, "bodies: {human: null, person: {kind: human}}\n"))
    alone = load_log_map(extending(tmp_path, "bodies: {human: null, robot: null}\n"))

    assert [body.id for body in whole.bodies] == ["robot", "human"]
    assert [body.id for body in found.bodies] == ["robot", "person"]
    assert [s.signal for c in found.channels for s in c.signals] == ["position/robot"]
    assert [c.topic for c in alone.channels] == ["/events"]  # nothing is left of the other one
    assert found.models == whole.models


@pytest.mark.parametrize(
    ("own", "cause", "hint"),
    [
        (
            "bodies: {humn: null}\n",
            "'humn' is null, and the extended log map has no body",
            "did you mean 'human'?",
        ),
        (
            "bodies: {human: null}\nframes: [{match: ann, kind: human, body: human}]\n",
            "'human' is null, and a frame or model of this log map is that body",
            "give the body another name",
        ),
    ],
)
def test_a_body_that_cannot_be_left_out_is_named(tmp_path: Path, own: str, cause: str, hint: str) -> None:
    with pytest.raises(LogMapError) as refused:
        load_log_map(extending(tmp_path, own))
    assert cause in refused.value.cause
    assert hint in refused.value.hint
    assert refused.value.place.startswith("line 5, $.bodies.")


def test_without_an_extended_log_map_there_is_nothing_to_leave_out(written: Path) -> None:
    error = refusal(written, "  human: {kind: human}", "  human: null")
    assert error.cause == "'human' is null, and there is no extended log map that it could be left out of"


def test_an_unknown_log_map_is_answered_with_the_nearest_one() -> None:
    with pytest.raises(LogMapError, match="there is no log map 'ariac202'") as refused:
        load_log_map("ariac202")
    assert "did you mean 'ariac202" in refused.value.hint


def test_a_missing_file_is_said_to_be_missing(written: Path) -> None:
    with pytest.raises(LogMapError, match="no such file"):
        load_log_map(str(written))


def test_a_rule_set_is_no_log_map() -> None:
    with pytest.raises(LogMapError, match=r"there is no log map 'ariac2020\.as_coded'"):
        load_log_map("ariac2020.as_coded")
