"""Which files are the parts of one trial."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.checks.contracts import LogDescription, Reader, ReaderFacts, Wanted
from ariac_score.errors import DataFileError, LogError, NothingToScoreError, ScoreError
from ariac_score.logs import bundle
from ariac_score.logs.bundle import Bundle, find_parts
from ariac_score.logs.gazebo import GazeboStateReader
from ariac_score.trial.build import merge_trials
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import TeamSetup, Trial
from ariac_score_ariac.competition import Ariac
from ariac_score_ariac.config.ariac_config import TrialConfigReader
from ariac_score_ariac.config.team_config import TeamConfigReader, TeamNameReader
from ariac_score_ariac.official.ariac_database import AriacDatabaseReader
from ariac_score_ariac.official.ariac_text import PerformanceLogReader
from ariac_score_ariac.official.sensor_cost import SensorCostReader

REAL = Path(__file__).parents[2].parent / "shared" / "ariac" / "data" / "nist_team_2022"
needs_real_trial = pytest.mark.skipif(not REAL.is_dir(), reason="the real trial of 2022 is not here")


class BagReader:
    """Stands for the reader of ROS bags: knows them by their names."""

    facts = ReaderFacts(formats="bags", folders=True)

    def can_read(self, path: Path) -> bool:
        return (path / "metadata.yaml").is_file() if path.is_dir() else path.suffix == ".bag"

    def describe(self, path: Path) -> LogDescription:
        return LogDescription(format=str(path))

    def read(self, path: Path, wanted: Wanted) -> Trial:
        return Trial(id=wanted.log_map.id + path.stem)


READERS: dict[str, Reader] = {
    "rosbag": BagReader(),
    "gazebo": GazeboStateReader(),
    "gazebo_text": PerformanceLogReader(),
    "ariac_config": TrialConfigReader(),
    "ariac_team": TeamConfigReader(),
}

FILES = {
    "trial.yaml": "orders: {}\n",
    "team.yaml": "sensors: {}\n",
    "performance.log": "Gazebo multi-robot simulator, version 9\n",
    "state.log": "<?xml version='1.0'?>\n<gazebo_log>\n",
    "run.bag": "#ROSBAG V2.0\n",
    "notes.txt": "went well\n",
}


def put(folder: Path, *names: str) -> Path:
    """Write files, each with the content its last name stands for."""
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(FILES[path.name], encoding="utf-8")
    return folder


def roles(found: Bundle) -> dict[str, str]:
    return {part.path.relative_to(found.root).as_posix(): part.role for part in found.parts}


@needs_real_trial
def test_the_real_trial_has_four_parts_and_three_files_of_no_use() -> None:
    found = find_parts(REAL, READERS)

    assert found.id == "nist_team_2022"
    assert roles(found) == {
        "config/team_config.yaml": "team_config",
        "config/trial_kitting.yaml": "trial_config",
        "gazebo/state.log": "log",
        "performance.log": "official",
    }
    assert found.ignored == (
        "ros-competitor/ariac_moveit_example_175_1651447484488.log",
        "ros-competitor/rosservice_211_1651447512089.log",
        "ros/rosout.log",
    )


@needs_real_trial
def test_the_parts_of_the_real_trial_make_one_trial() -> None:
    found = find_parts(REAL, READERS)
    wanted = Wanted(LogMap("x"))

    trial = merge_trials(
        found.id, [READERS[p.reader].read(p.path, wanted) for p in found.parts], file=found.root
    )

    assert [order.id for order in trial.work] == ["order_0"]
    assert trial.work[0].announced_s == pytest.approx(10.86, abs=0.02)
    assert trial.team is not None
    assert trial.duration_s == pytest.approx(14.852, abs=0.02)


def test_a_file_is_a_bundle_of_one(tmp_path: Path) -> None:
    put(tmp_path, "run.bag", "trial.yaml")

    found = find_parts(tmp_path / "run.bag", READERS)

    assert (found.id, [(p.role, p.reader) for p in found.parts]) == ("run", [("log", "rosbag")])
    assert find_parts(tmp_path / "trial.yaml", READERS).parts[0].role == "trial_config"


def test_a_bag_folder_is_one_log_whatever_it_holds(tmp_path: Path) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").write_text("x: 1\n", encoding="utf-8")
    put(tmp_path, "trial.yaml", "bag/team.yaml")

    assert roles(find_parts(tmp_path, READERS)) == {"bag": "log", "trial.yaml": "trial_config"}
    assert [part.path.name for part in find_parts(tmp_path / "bag", READERS).parts] == ["bag"]


def test_logs_of_different_kinds_are_one_trial(tmp_path: Path) -> None:
    put(tmp_path, "run.bag", "gazebo/state.log", "notes.txt")

    found = find_parts(tmp_path, READERS)

    assert roles(found) == {"gazebo/state.log": "log", "run.bag": "log"}
    assert found.ignored == ("notes.txt",)


def test_the_files_do_not_depend_on_the_order_of_the_readers(tmp_path: Path) -> None:
    put(tmp_path, "run.bag", "a/state.log", "trial.yaml", "team.yaml", "performance.log")

    backwards = dict(reversed(READERS.items()))

    assert find_parts(tmp_path, READERS) == find_parts(tmp_path, backwards)


def test_folders_are_searched_four_deep(tmp_path: Path) -> None:
    put(tmp_path, "a/b/c/d/trial.yaml", "a/b/c/d/e/team.yaml")

    found = find_parts(tmp_path, READERS)

    assert roles(found) == {"a/b/c/d/trial.yaml": "trial_config"}
    assert found.ignored == ()


def test_links_out_of_the_folder_are_not_followed(tmp_path: Path) -> None:
    put(tmp_path, "outside/trial.yaml", "inside/team.yaml")
    (tmp_path / "inside" / "trial.yaml").symlink_to(tmp_path / "outside" / "trial.yaml")
    (tmp_path / "inside" / "more").symlink_to(tmp_path / "outside")
    (tmp_path / "inside" / "loop").symlink_to(tmp_path / "inside" / "loop")

    found = find_parts(tmp_path / "inside", READERS)

    assert roles(found) == {"team.yaml": "team_config"}
    assert {name for name in found.ignored if "a link to somewhere else" in name} == {
        "trial.yaml (a link to somewhere else)",
        "more (a link to somewhere else)",
        "loop (a link to somewhere else)",
    }


# bundle.yaml


def named(folder: Path, text: str) -> Bundle:
    (folder / "bundle.yaml").write_text(text, encoding="utf-8")
    by_folder, by_file = find_parts(folder, READERS), find_parts(folder / "bundle.yaml", READERS)
    assert by_folder == by_file
    return by_folder


def test_bundle_yaml_says_what_belongs_together(tmp_path: Path) -> None:
    put(tmp_path, "1/run.bag", "2/run.bag", "1/trial.yaml", "2/trial.yaml", "team.yaml", "performance.log")

    found = named(
        tmp_path,
        "id: final\nlogs: [1/run.bag, 2/run.bag]\ntrial_config: 1/trial.yaml\nteam_config: team.yaml\n"
        "official: performance.log\n",
    )

    assert found.id == "final"
    assert roles(found) == {
        "1/run.bag": "log",
        "2/run.bag": "log",
        "1/trial.yaml": "trial_config",
        "team.yaml": "team_config",
        "performance.log": "official",
    }


def test_a_bundle_without_an_id_is_called_like_its_folder(tmp_path: Path) -> None:
    put(tmp_path, "final_3/run.bag")

    assert named(tmp_path / "final_3", "logs: [run.bag]\n").id == "final_3"


@pytest.mark.parametrize(
    "name", ["../run.bag", "a/../../run.bag", "/etc/passwd", "link.bag", "linked/run.bag"]
)
def test_a_name_that_leads_out_of_the_folder_is_refused(tmp_path: Path, name: str) -> None:
    put(tmp_path, "run.bag", "inside/a/run.bag")
    (tmp_path / "inside" / "link.bag").symlink_to(tmp_path / "run.bag")
    (tmp_path / "inside" / "linked").symlink_to(tmp_path)

    with pytest.raises(LogError, match="leads out of the bundle's folder") as caught:
        named(tmp_path / "inside", f"logs: [{name}]\n")

    assert "$.logs[0]" in caught.value.place


def test_a_named_file_that_is_missing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"'gone\.yaml' does not exist"):
        named(tmp_path, "logs: []\ntrial_config: gone.yaml\n")


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("logs: [trial.yaml]\n", "'trial.yaml' is a trial configuration, not a log"),
        ("logs: []\nofficial: run.bag\n", "'run.bag' is a log, not an official result"),
        ("logs: [notes.txt]\n", "'notes.txt' is not recognised, not a log"),
        ("logs: ['.']\n", "is not recognised"),
    ],
)
def test_a_named_file_of_another_kind_is_refused(tmp_path: Path, text: str, cause: str) -> None:
    put(tmp_path, "trial.yaml", "run.bag", "notes.txt")

    with pytest.raises(LogError) as caught:
        named(tmp_path, text)

    assert cause in caught.value.cause


@pytest.mark.parametrize(
    "text",
    [
        "log: [run.bag]\n",
        "logs: run.bag\n",
        "logs: [run.bag]\nofficial: ''\n",
        "",
        "logs: [[run.bag]]\n",
        "{",
    ],
)
def test_a_malformed_bundle_yaml_is_refused(tmp_path: Path, text: str) -> None:
    put(tmp_path, "run.bag")

    with pytest.raises(DataFileError):
        named(tmp_path, text)


class TideReader(BagReader):
    """A reader of another competition, whose trials have a part of their own."""

    facts = ReaderFacts(role="tide_table", a_file="a tide table")

    def can_read(self, path: Path) -> bool:
        return path.suffix == ".tide"


def test_bundle_yaml_can_name_a_part_of_any_role_that_a_reader_states(tmp_path: Path) -> None:
    put(tmp_path, "run.bag")
    (tmp_path / "north.tide").write_text("", encoding="utf-8")
    (tmp_path / "bundle.yaml").write_text("logs: [run.bag]\ntide_table: north.tide\n", encoding="utf-8")

    found = find_parts(tmp_path, {**READERS, "tide": TideReader()})
    assert [(part.role, part.path.name) for part in found.parts] == [
        ("log", "run.bag"),
        ("tide_table", "north.tide"),
    ]


@pytest.mark.parametrize(
    ("text", "error", "words"),
    [
        ("logs: [run.bag]\ntide_tabel: run.bag\n", DataFileError, "unknown key 'tide_tabel'"),
        ("logs: [run.bag]\ntide_table: [run.bag]\n", DataFileError, "is not of type 'string'"),
        ("logs: [run.bag]\ntide_table: run.bag\n", LogError, "'run.bag' is a log, not a tide table"),
        ("logs: [run.bag]\ntide_table: ../a.tide\n", LogError, "leads out of the bundle's folder"),
    ],
)
def test_a_part_of_a_readers_own_role_is_checked_like_any_other(
    tmp_path: Path, text: str, error: type[ScoreError], words: str
) -> None:
    put(tmp_path, "run.bag")
    (tmp_path / "bundle.yaml").write_text(text, encoding="utf-8")

    with pytest.raises(error) as caught:
        find_parts(tmp_path, {**READERS, "tide": TideReader()})
    assert words in str(caught.value)


def test_without_the_reader_of_a_role_its_key_is_unknown(tmp_path: Path) -> None:
    put(tmp_path, "run.bag")
    (tmp_path / "bundle.yaml").write_text("logs: [run.bag]\ntide_table: a.tide\n", encoding="utf-8")

    with pytest.raises(DataFileError, match="unknown key 'tide_table'"):
        find_parts(tmp_path, READERS)


def test_a_bundle_that_names_nothing_is_nothing_to_score(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="names no part"):
        named(tmp_path, "logs: []\n")


# Refusals


@pytest.mark.parametrize("name", ["trial.yaml", "team.yaml", "performance.log", "state.log", "run.bag"])
def test_two_of_a_kind_are_two_trials(tmp_path: Path, name: str) -> None:
    put(tmp_path, f"1/{name}", f"2/{name}")

    with pytest.raises(LogError, match="two trials in one bundle") as caught:
        find_parts(tmp_path, READERS)

    assert f"1/{name}" in caught.value.cause
    assert f"2/{name}" in caught.value.cause
    assert "bundle.yaml" in caught.value.hint


def test_a_missing_path_is_nothing_to_score(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="no such file or folder") as caught:
        find_parts(tmp_path / "gone", READERS)

    assert caught.value.exit_code == 5
    assert caught.value.hint


def test_an_empty_folder_is_nothing_to_score(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="it holds no files"):
        find_parts(tmp_path, READERS)


def test_a_folder_of_strange_files_is_nothing_to_score_and_lists_them(tmp_path: Path) -> None:
    for i in range(7):
        (tmp_path / f"{i}.txt").write_text("x", encoding="utf-8")

    with pytest.raises(NothingToScoreError) as caught:
        find_parts(tmp_path, READERS)

    assert "not recognised: 0.txt, 1.txt, 2.txt, 3.txt, 4.txt and 2 more" in caught.value.cause
    assert "Gazebo state.log" in caught.value.hint


@pytest.mark.parametrize(("content", "cause"), [("", "the file is empty"), ("hello", "no reader recognises")])
def test_a_strange_file_is_nothing_to_score(tmp_path: Path, content: str, cause: str) -> None:
    path = tmp_path / "x.txt"
    path.write_text(content, encoding="utf-8")

    with pytest.raises(NothingToScoreError, match=cause):
        find_parts(path, READERS)


def test_a_folder_of_too_many_files_is_not_one_trial(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bundle, "MAX_FILES", 3)
    for i in range(4):
        (tmp_path / f"{i}.txt").write_text("x", encoding="utf-8")

    with pytest.raises(LogError, match="more than 3 files"):
        find_parts(tmp_path, READERS)


# Runs of a database --------------------------------------------------------------------

STORES: dict[str, Reader] = {
    **READERS,
    "ariac_database": AriacDatabaseReader(),
    "sensor_cost": SensorCostReader(),
}


def put_database(folder: Path) -> Path:
    """What the reader takes for a database at first sight."""
    path = folder / "results.db"
    path.write_bytes(b"SQLite format 3\0 Competitor OrderSubmission")
    return path


def test_a_run_of_a_database_is_named_after_its_path(tmp_path: Path) -> None:
    path = put_database(tmp_path)

    (part,) = find_parts(tmp_path / "results.db#run=3", STORES).parts
    assert (part.path, part.run, part.role) == (path, 3, "official")
    assert find_parts(path, STORES).parts[0].run is None


def test_a_file_that_really_has_such_a_name_is_itself(tmp_path: Path) -> None:
    path = put_database(tmp_path).rename(tmp_path / "results.db#run=3")

    (part,) = find_parts(path, STORES).parts
    assert (part.path, part.run) == (path, None)


@pytest.mark.parametrize("name", ["gone.db#run=3", "results.db#run=", "results.db#run=-1", "results.db#3"])
def test_a_run_of_nothing_is_nothing_to_score(tmp_path: Path, name: str) -> None:
    put_database(tmp_path)

    with pytest.raises(NothingToScoreError, match="no such file"):
        find_parts(tmp_path / name, STORES)


def test_a_log_of_one_run_has_none_to_choose(tmp_path: Path) -> None:
    put(tmp_path, "performance.log")

    with pytest.raises(LogError, match="of one run, so none can be chosen"):
        find_parts(tmp_path / "performance.log#run=1", STORES)


def test_bundle_yaml_says_which_run_is_meant(tmp_path: Path) -> None:
    put_database(tmp_path)
    (tmp_path / "sensor_cost.txt").write_text("User Sensor Log\n", encoding="utf-8")
    (tmp_path / "bundle.yaml").write_text(
        "logs: []\nofficial: results.db\nrun: 3\nsensor_cost: sensor_cost.txt\n", encoding="utf-8"
    )

    found = find_parts(tmp_path, STORES)
    assert [(part.role, part.run) for part in found.parts] == [("official", 3), ("sensor_cost", None)]


@pytest.mark.parametrize(
    "text", ["logs: []\nrun: 3\n", "logs: []\nofficial: results.db\nrun: -1\n", "logs: []\nrun: [3]\n"]
)
def test_a_run_of_no_database_is_refused(tmp_path: Path, text: str) -> None:
    put_database(tmp_path)
    (tmp_path / "bundle.yaml").write_text(text, encoding="utf-8")

    with pytest.raises(DataFileError):
        find_parts(tmp_path, STORES)


def test_bundle_yaml_cannot_choose_a_run_of_a_text(tmp_path: Path) -> None:
    put(tmp_path, "performance.log")
    (tmp_path / "bundle.yaml").write_text("logs: []\nofficial: performance.log\nrun: 1\n", encoding="utf-8")

    with pytest.raises(LogError, match="none can be chosen"):
        find_parts(tmp_path, STORES)


@pytest.mark.parametrize(
    ("text", "likeness"),
    [
        ("DEFECT_TYPES: {}", "the list of cell defects of 2025"),
        ("kitting_trays: {}", "a trial configuration without orders"),
        ("mine: {secret: 1}", "a YAML file with the keys mine"),
    ],
)
def test_a_yaml_file_that_is_no_part_is_called_by_what_it_looks_like(
    tmp_path: Path, text: str, likeness: str
) -> None:
    (tmp_path / "a.yaml").write_text(text, encoding="utf-8")

    with pytest.raises(NothingToScoreError) as caught:
        find_parts(tmp_path / "a.yaml", READERS)
    assert caught.value.cause == f"no reader recognises this file; it looks like {likeness}"


def test_the_files_of_a_team_of_2024_make_one_team(tmp_path: Path) -> None:
    """Its entry has the name, its sensors their types, the record of the run their cost."""
    files = {
        "blue.yaml": "team_name: blue\ngithub: {personal_access_token: x}\n",
        "sensors.yaml": "static_sensors: {front: {type: lidar}}\n",
        "sensor_cost.txt": "User Sensor Log\nNumber of lidar's used: 1\nTotal sensor cost is: $300\n",
    }
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    readers = {**READERS, "ariac_team_name": TeamNameReader(), "sensor_cost": SensorCostReader()}

    parts = find_parts(tmp_path, readers).parts
    trials = [readers[part.reader].read(part.path, Wanted(LogMap("test"))) for part in parts]

    assert [part.role for part in parts] == ["team_name", "sensor_cost", "team_config"]
    assert merge_trials("t", trials, file="f", competition=Ariac()).team == TeamSetup(
        "blue", {"front": "lidar"}
    )
