"""Log maps drafted from recordings: who is who by names, frames and motion; what is equal stays open."""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score import load_log_map, open_trial
from ariac_score.cli import main
from ariac_score.testing import write_bag
from ariac_score.testing.bags import Recorded
from ariac_score_ariac.testing import kitting_trial
from ariac_score_ariac.testing.recordings import recorded_messages

ORIGIN_NS = 1_700_000_000_000_000_000
SHARED = Path(__file__).parents[2].parent / "shared"
Place = tuple[float, float, float]
Course = Callable[[float], Place]


def walking(t_s: float) -> Place:
    return -6 + 0.5 * t_s, 2.0, 1.0


def swinging(t_s: float) -> Place:
    return 1.5 * math.sin(0.4 * t_s), 0.0, 1.0


def still(_t_s: float) -> Place:
    return 3.0, 3.0, 0.0


def stamps() -> Iterator[tuple[float, int]]:
    for number in range(200):
        yield number / 20, ORIGIN_NS + number * 50_000_000


def header(t_ns: int, frame: str = "world") -> dict[str, Any]:
    return {"stamp": {"sec": t_ns // 10**9, "nanosec": t_ns % 10**9}, "frame_id": frame}


def xyz(place: Place) -> dict[str, float]:
    return dict(zip("xyz", place, strict=True))


def frames(**courses: Course) -> list[Recorded]:
    """Transforms at 20 Hz; `child__parent` is a frame below another one than `world`."""
    messages = []
    for t_s, t_ns in stamps():
        transforms = [
            {
                "header": header(t_ns, name.partition("__")[2] or "world"),
                "child_frame_id": name.partition("__")[0],
                "transform": {"translation": xyz(course(t_s)), "rotation": {"w": 1.0}},
            }
            for name, course in courses.items()
        ]
        messages.append(Recorded("/tf", "tf2_msgs/msg/TFMessage", t_ns, {"transforms": transforms}))
    return messages


def poses(topic: str, course: Course, frame: str = "world") -> list[Recorded]:
    return [
        Recorded(
            topic,
            "geometry_msgs/msg/PoseStamped",
            t_ns,
            {
                "header": header(t_ns, frame),
                "pose": {"position": xyz(course(t_s)), "orientation": {"w": 1.0}},
            },
        )
        for t_s, t_ns in stamps()
    ]


class Drafted:
    """What `map` made of a recording."""

    def __init__(self, folder: Path, messages: list[Recorded], *options: str) -> None:
        self.log = write_bag(
            folder / "lab.mcap", sorted(messages, key=lambda message: message.t_ns), storage="mcap"
        )
        self.file = folder / "ours.yaml"
        self.file.unlink(missing_ok=True)
        self.code = main(["map", str(self.log), "-o", str(self.file), *options])
        self.text = self.file.read_text(encoding="utf-8") if self.file.exists() else ""

    @property
    def bodies(self) -> dict[str, str]:
        """Kind by body, as the recording is read by the draft."""
        trial = open_trial(self.log, log_map=self.file)
        return {body.id: body.kind for body in trial.bodies if f"position/{body.id}" in trial.signals}


def test_names_and_motion_say_who_is_who(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drafted = Drafted(tmp_path, frames(torso_base=swinging, human_base=walking, camera=still))

    assert drafted.code == 0
    assert drafted.bodies == {"human": "human", "robot": "robot"}
    out = capsys.readouterr().out
    assert "human is at most 0.50 m/s fast" in out
    assert "position/human: 20.0 Hz from 0.000 s to 9.950 s, longest gap 0.050 s" in out
    assert "--rules safety" in out
    assert main(["score", str(drafted.log), "--rules", "safety", "--log-map", str(drafted.file)]) == 0


def test_whoever_has_no_log_map_is_told_how_to_get_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_bag(tmp_path / "lab.mcap", frames(arm=swinging), storage="mcap")

    assert main(["info", str(log)]) == 0
    assert "'ariac-score map LOG' drafts a log map" in capsys.readouterr().out
    assert main(["check", str(log), "--rules", "safety"]) == 6
    assert "log map 'safety' names no topic: 'ariac-score map LOG" in capsys.readouterr().out


def test_between_equals_nothing_is_chosen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    two = frames(person_1=walking, person_2=still, person_3=lambda t_s: (t_s, 5.0, 0.0), gantry=swinging)
    drafted = Drafted(tmp_path, two)

    assert drafted.code == 6
    assert drafted.bodies == {"robot": "robot"}
    assert "human: OPEN" in drafted.text
    assert "# - {match: person_1, kind: human, body: human}" in drafted.text
    assert "open: Who is the human? --human NAME, one of: person_1, person_3" in capsys.readouterr().err

    both = Drafted(tmp_path, two, "--human", "person_1", "--human", "person_3")
    assert both.code == 0
    assert both.bodies == {"person_1": "human", "person_3": "human", "robot": "robot"}


def test_what_moves_without_a_name_that_says_something_may_be_either(tmp_path: Path) -> None:
    assert Drafted(tmp_path, frames(box=walking)).code == 6
    assert Drafted(tmp_path, frames(box=walking, crate=swinging)).code == 6
    beside_a_named_one = Drafted(tmp_path, frames(box=walking, human=swinging))
    assert (beside_a_named_one.code, beside_a_named_one.bodies) == (0, {"human": "human", "robot": "robot"})
    assert "match: box, kind: robot" in beside_a_named_one.text
    nobody = Drafted(tmp_path, frames(arm=swinging, shelf=still), "--human", "none")
    assert (nobody.code, nobody.bodies) == (0, {"robot": "robot"})


def test_a_robot_is_the_frames_that_move_with_it(tmp_path: Path) -> None:
    arm = frames(base_link=still, shoulder__base_link=still, tool0__shoulder=swinging, lamp__base_link=still)
    drafted = Drafted(tmp_path, [*arm, *frames(visitor=walking)])

    assert drafted.code == 0
    (robot,) = (m for m in load_log_map(drafted.file).frames if m.kind == "robot")
    assert (robot.match, robot.links) == ("base_link", ("tool0",))


def test_one_motion_in_two_places_is_one_body_and_two_motions_of_one_name_are_a_question(
    tmp_path: Path,
) -> None:
    cell = frames(human_base=walking, arm=swinging)
    same = Drafted(tmp_path, [*cell, *poses("/lab/human", walking)])
    other = Drafted(tmp_path, [*cell, *poses("/lab/human", lambda t_s: (walking(t_s)[0], 2.0, 0.0))])

    assert (same.code, other.code) == (0, 6)
    assert "left out: the same motion as frame human_base" in same.text


def test_of_one_motion_on_two_topics_the_one_with_stamps_of_its_own_is_taken(tmp_path: Path) -> None:
    fast = [
        Recorded(
            "/a/human",
            "geometry_msgs/msg/Pose",
            t_ns,
            {"position": xyz(walking(t_s)), "orientation": {"w": 1.0}},
        )
        for t_s, t_ns in stamps()
    ]
    drafted = Drafted(tmp_path, [*fast, *poses("/b/human", walking), *poses("/arm", swinging)])

    taken = {channel["topic"] for channel in yaml.safe_load(drafted.text)["channels"]}
    assert taken == {"/b/human", "/arm"}
    assert "stamped when it arrived; left out: the same motion as topic /b/human" in drafted.text


def test_positions_of_another_frame_are_shown_and_never_taken(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = [*frames(arm=swinging), *poses("/lab/human", walking, frame="camera")]

    drafted = Drafted(tmp_path, messages)
    assert (drafted.code, drafted.bodies) == (6, {"robot": "robot"})
    assert "topic /lab/human: in frame camera" in drafted.text
    capsys.readouterr()
    named = Drafted(tmp_path, messages, "--human", "/lab/human")
    assert (named.code, named.text) == (4, "")
    err = capsys.readouterr().err
    assert "/lab/human: in frame camera" in err
    assert "hint: record" in err


def test_speeds_and_distance_serve_where_nobody_has_a_position(tmp_path: Path) -> None:
    fields = {"human_operator_speed": 0.5, "robot_speed": 0.1, "distance_robot_human_operator": 6.0}
    snapshots = [Recorded("/snap", "nist_gear/msg/Snapshot", t_ns, fields) for _, t_ns in stamps()]
    drafted = Drafted(tmp_path, snapshots)

    assert drafted.code == 0
    assert open_trial(drafted.log, log_map=drafted.file).signals.keys() == {
        "speed/human",
        "speed/robot",
        "centre_distance/robot/human",
    }
    beside = Drafted(tmp_path, [*snapshots, *frames(arm=swinging, human=walking)])
    assert "# - {topic: /snap, signals: {speed/human" in beside.text  # positions give the same


@pytest.mark.slow
def test_the_log_map_that_reads_the_orders_is_extended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    messages = [m for m in recorded_messages(kitting_trial()) if m.topic != "/tf"]
    extended = Drafted(tmp_path, messages)
    assert extended.code == 0
    assert "extends: ariac2020\n" in extended.text
    assert "orders: order_0" in capsys.readouterr().out
    assert (
        main(["score", str(extended.log), "--rules", "paper2020.published", "--log-map", str(extended.file)])
        == 0
    )

    without_motion = [m for m in messages if m.topic != "/snapshot"]
    equal = Drafted(tmp_path, without_motion, "--human", "none", "--robot", "none")
    assert equal.code == 6
    assert "OPEN" in equal.text
    assert "extends" not in yaml.safe_load(equal.text)
    nobody = ("--human", "none", "--robot", "none")
    by_rules = Drafted(tmp_path, without_motion, "--rules", "paper2020.published", *nobody)
    assert (by_rules.code, yaml.safe_load(by_rules.text)["extends"]) == (0, "paper2020")


def test_a_state_of_the_competition_under_another_name_is_a_row_to_take(tmp_path: Path) -> None:
    messages = [
        Recorded("/comp/state", m.type, m.t_ns, m.fields) if m.topic == "/ariac/competition_state" else m
        for m in recorded_messages(kitting_trial())
        if m.topic != "/tf"
    ]
    drafted = Drafted(tmp_path, messages, "--extends", "ariac2020")
    lines = drafted.text.splitlines()
    where = lines.index("# if /comp/state is what /ariac/competition_state is elsewhere, under 'channels:':")
    assert open_trial(drafted.log, log_map=drafted.file).started_s is None  # nothing is decided silently

    drafted.file.write_text(f"{drafted.text}channels:\n{lines[where + 1].removeprefix('# ')}\n", "utf-8")
    assert open_trial(drafted.log, log_map=drafted.file).started_s == pytest.approx(0.5)


def test_people_who_are_chosen_take_the_place_of_those_of_the_extended_log_map(tmp_path: Path) -> None:
    """Its one human is not recorded, and would leave all that is asked of humans open."""
    motion = frames(torso_base=swinging, ann=walking, bob=walking)
    given = [m for m in recorded_messages(kitting_trial()) if m.topic not in ("/tf", "/snapshot")]
    drafted = Drafted(
        tmp_path, [*given, *motion], "--extends", "ariac2020", "--human", "ann", "--human", "bob"
    )

    assert drafted.code == 0
    assert yaml.safe_load(drafted.text)["bodies"] == {"human": None}
    trial = open_trial(drafted.log, log_map=drafted.file)
    assert sorted(body.id for body in trial.bodies_of("human")) == ["ann", "bob"]


@pytest.mark.parametrize(("role", "other"), [("human", "robot"), ("robot", "human")])
def test_none_is_an_answer_that_leaves_out_those_of_the_extended_log_map(
    role: str, other: str, tmp_path: Path
) -> None:
    drafted = Drafted(
        tmp_path, recorded_messages(kitting_trial()), "--extends", "ariac2020", f"--{role}", "none"
    )

    assert drafted.code == 0
    assert f"# {role}: none, as you say" in drafted.text
    trial = open_trial(drafted.log, log_map=drafted.file)
    assert [one.id for one in trial.bodies_of(role)] == []
    assert [one.id for one in trial.bodies_of(other)] == [other]


def test_whoever_is_named_by_a_topic_takes_the_place_of_the_frame_of_the_extended_log_map(
    tmp_path: Path,
) -> None:
    given = recorded_messages(kitting_trial())
    first_ns = min(one.t_ns for one in given)
    walked = [replace(one, t_ns=one.t_ns - ORIGIN_NS + first_ns) for one in poses("/lab/pose", walking)]
    drafted = Drafted(tmp_path, [*given, *walked], "--extends", "ariac2020", "--human", "/lab/pose")

    assert drafted.code == 0
    trial = open_trial(drafted.log, log_map=drafted.file)
    assert [one.id for one in trial.bodies_of("human")] == ["lab_pose"]
    assert [one.id for one in trial.bodies_of("robot")] == ["robot"]


def test_whom_the_extended_log_map_reads_in_the_recording_stays(tmp_path: Path) -> None:
    """Snapshots tell of its human, and two frames are chosen beside them."""
    motion = frames(torso_base=swinging, ann=walking, bob=walking)
    given = [m for m in recorded_messages(kitting_trial()) if m.topic != "/tf"]
    drafted = Drafted(
        tmp_path, [*given, *motion], "--extends", "ariac2020", "--human", "ann", "--human", "bob"
    )

    assert "bodies" not in yaml.safe_load(drafted.text)
    trial = open_trial(drafted.log, log_map=drafted.file)
    assert sorted(body.id for body in trial.bodies_of("human")) == ["ann", "bob", "human"]


def test_a_frame_that_is_taken_for_another_body_leaves_nothing_of_the_one_it_was(tmp_path: Path) -> None:
    motion = frames(torso_base=swinging, human_base=walking, human_2=still)
    given = [m for m in recorded_messages(kitting_trial()) if m.topic not in ("/tf", "/snapshot")]
    both = ("--human", "human_base", "--human", "human_2")
    drafted = Drafted(tmp_path, [*given, *motion], "--extends", "ariac2020", *both)

    assert yaml.safe_load(drafted.text)["bodies"] == {"human": None}
    trial = open_trial(drafted.log, log_map=drafted.file)
    assert sorted(body.id for body in trial.bodies_of("human")) == ["human_2", "human_base"]


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"human_2": walking}, "human: not frame human_2: moves 4.97 m"),
        ({"human_pelvis__human_base": walking}, "follow what moves below it: human_pelvis"),
        ({"left_gripper__torso_base": walking}, "follow what moves below it: left_gripper"),
    ],
)
def test_who_moves_beside_those_that_the_extended_log_map_knows_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], more: dict[str, Course], said: str
) -> None:
    motion = frames(torso_base=swinging, human_base=still, **more)
    given = [m for m in recorded_messages(kitting_trial()) if m.topic not in ("/tf", "/snapshot")]
    Drafted(tmp_path, [*given, *motion], "--extends", "ariac2020")

    assert said in capsys.readouterr().out


def test_nobody_takes_the_place_of_someone_who_is_recorded_and_cannot_be_placed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The human of the extended log map hangs below another root than the robot and the visitor."""
    motion = frames(torso_base=swinging, human_2=walking, human_base__mocap=walking)
    given = [m for m in recorded_messages(kitting_trial()) if m.topic not in ("/tf", "/snapshot")]
    drafted = Drafted(tmp_path, [*given, *motion], "--extends", "ariac2020", "--root-frame", "world")

    assert "human_base is recorded, and has no positions that can be used" in capsys.readouterr().out
    trial = open_trial(drafted.log, log_map=drafted.file)
    assert sorted(body.id for body in trial.bodies_of("human")) == ["human", "human_2"]


def test_models_take_the_place_of_frames_that_are_not_recorded(tmp_path: Path) -> None:
    """The log map of 2020 knows robots and people as frames and as models; here they are models."""
    states = [
        Recorded(
            "/gazebo/model_states",
            "gazebo_msgs/msg/ModelStates",
            t_ns,
            {
                "name": ["gantry", "person_1"],
                "pose": [
                    {"position": xyz(course(t_s)), "orientation": {"w": 1.0}}
                    for course in (swinging, walking)
                ],
                "twist": [{}, {}],
            },
        )
        for t_s, t_ns in stamps()
    ]
    given = [m for m in recorded_messages(kitting_trial()) if m.topic not in ("/tf", "/snapshot")]
    drafted = Drafted(tmp_path, [*given, *states], "--extends", "ariac2020")

    assert yaml.safe_load(drafted.text)["bodies"] == {"human": None}
    trial = open_trial(drafted.log, log_map=drafted.file)
    assert [body.id for body in trial.bodies] == ["person_1", "robot"]


def test_a_log_map_in_a_file_is_extended_from_where_the_draft_lies(tmp_path: Path) -> None:
    (tmp_path / "base.yaml").write_text("{id: base, title: t, source: s}", encoding="utf-8")
    (tmp_path / "maps").mkdir()
    cell = frames(arm=swinging, human=walking)
    drafted = Drafted(tmp_path / "maps", cell, "--extends", str(tmp_path / "base.yaml"))

    assert drafted.code == 0
    assert yaml.safe_load(drafted.text)["extends"] == "../base.yaml"
    assert load_log_map(drafted.file).frames


def test_a_slip_is_answered_with_what_is_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drafted = Drafted(tmp_path, frames(arm=swinging, human_base=walking), "--human", "human_bas")

    assert (drafted.code, drafted.text) == (4, "")
    assert "did you mean 'human_base'?" in capsys.readouterr().err


def test_nothing_is_overwritten_and_what_is_damaged_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_bag(tmp_path / "lab.mcap", frames(arm=swinging), storage="mcap")
    ours = tmp_path / "ours.yaml"
    ours.write_text("mine", encoding="utf-8")
    assert main(["map", str(log), "-o", str(ours)]) == 4
    assert ours.read_text(encoding="utf-8") == "mine"

    (tmp_path / "cut.mcap").write_bytes(log.read_bytes()[:5000])
    assert main(["map", str(tmp_path / "cut.mcap")]) == 6
    assert main(["map", str(tmp_path / "nowhere.mcap")]) == 5
    assert capsys.readouterr().out == ""


def test_hostile_names_stay_names(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    evil = 'human"}\n- {match: "*", kind: robot'
    steering = "person\x1b[31m[x]*"
    drafted = Drafted(tmp_path, frames(**{evil: walking, "yes": swinging, steering: still}), "--robot", "yes")

    assert drafted.code == 0
    matches = load_log_map(drafted.file).frames
    assert [(m.body, m.kind) for m in matches] == [("human", "human"), ("robot", "robot")]
    assert all(match.body_for(name) for match, name in zip(matches, (evil, "yes"), strict=True))
    assert "\x1b" not in drafted.text + "".join(capsys.readouterr())


class Terminal(io.StringIO):
    """Somebody who types."""

    def isatty(self) -> bool:
        return True


@pytest.mark.slow
def test_on_a_terminal_every_role_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said = Terminal()
    monkeypatch.setattr("sys.stdin", Terminal("7\n2\n\n"))  # there is no seventh; Enter takes what is likely
    monkeypatch.setattr("sys.stderr", said)
    two = frames(person_1=walking, person_2=lambda t_s: (t_s, 5.0, 0.0), gantry=swinging)
    drafted = Drafted(tmp_path, two)

    assert drafted.code == 0
    assert "match: person_2, kind: human" in drafted.text
    assert drafted.bodies == {"human": "human", "robot": "robot"}
    assert "a number from 0 to 3 is wanted" in said.getvalue()
    assert "Who is the robot?" in said.getvalue()


@pytest.mark.slow
@pytest.mark.skipif(not (SHARED / "real").is_dir(), reason="needs the real recordings")
def test_recordings_of_a_real_recorder_are_mapped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The README beside them: the human walks at 0.500 m/s, the robot swings by 1.5 m at most 0.6 m/s."""
    ours = tmp_path / "ours.yaml"
    log = SHARED / "real/walk_tf_only.bag"
    assert main(["map", str(log), "--extends", "none", "-o", str(ours)]) == 0
    out = capsys.readouterr().out
    assert "human is at most 0.50 m/s fast" in out
    assert "robot is at most 0.60 m/s fast" in out
    assert "human_base: moves 15.00 m" in ours.read_text(encoding="utf-8")

    assert main(["map", str(log)]) == 0
    assert "\nextends: ariac2020\n" in capsys.readouterr().out
    assert main(["map", str(SHARED / "real/walk_killed.bag")]) == 6
    turtles = SHARED / "bags/ros1/rosbagjs_example.bag"
    assert main(["map", str(turtles)]) == 6  # two turtles move, and no name says what they are
    assert "--robot NAME, one of: turtle1, turtle2" in capsys.readouterr().err
