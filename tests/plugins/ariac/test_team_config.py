"""The readers of team configurations: sensors of every year, graded ones of 2025, and names."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.checks.contracts import Reader, Wanted
from ariac_score.errors import DataFileError
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import TeamSetup, Trial
from ariac_score_ariac.config.ariac_config import TrialConfigReader
from ariac_score_ariac.config.team_config import TeamConfigReader, TeamNameReader

ARIAC = Path(__file__).parents[3].parent / "shared" / "ariac" / "data"
TRIALS, TEAMS, ENTRIES = TrialConfigReader(), TeamConfigReader(), TeamNameReader()
WANTED = Wanted(LogMap("test"))


def read(folder: Path, text: str) -> Trial:
    path = folder / "team.yaml"
    path.write_text(text, encoding="utf-8")
    return TEAMS.read(path, WANTED)


def sensors_of(folder: Path, text: str) -> dict[str, str]:
    team = read(folder, text).team
    assert team is not None
    assert team.sensors is not None
    return dict(team.sensors)


def refusal(folder: Path, text: str) -> DataFileError:
    with pytest.raises(DataFileError) as caught:
        read(folder, text)
    assert str(folder) in str(caught.value)
    assert caught.value.hint
    assert TEAMS.describe(folder / "team.yaml").damage == str(caught.value)
    return caught.value


def test_both_are_readers() -> None:
    assert isinstance(TEAMS, Reader)
    assert isinstance(ENTRIES, Reader)


@pytest.mark.skipif(not ARIAC.is_dir(), reason="the official files are not here")
def test_the_official_team_of_2022_has_seven_logical_cameras() -> None:
    path = ARIAC / "nist_team_2022/config/team_config.yaml"

    assert TEAMS.describe(path).facts == {"sensors": 7, "logical_camera": 7}


@pytest.mark.parametrize(
    ("text", "trial", "team", "entry"),
    [
        ("orders: {}\n", True, False, False),
        ("# note\n'sensors' : {}\n", False, True, False),
        ("orders: {}\nsensors: {}\n", True, False, False),
        ("other:\n  orders: {}\n", False, False, False),
        ("", False, False, False),
        ("orders: {broken\n", True, False, False),
        ("robot_cameras: {}\n", False, True, False),
        ("COMPETITOR_NAME: a\n", False, True, False),
        ("SENSORS: []\n", False, True, False),
        ("SEED: 1\nNUM_KITS: 1\nNUM_MODULES: 1\n", True, False, False),
        ("SEED: 1\n", False, False, False),
        ("team_name: a\ngithub: {}\n", False, False, True),
        ("team_name: a\n", False, False, False),
    ],
)
def test_files_are_distinguished_by_their_top_level_keys(
    tmp_path: Path, text: str, trial: bool, team: bool, entry: bool
) -> None:
    path, other = tmp_path / "a.yml", tmp_path / "a.txt"
    for file in (path, other):
        file.write_text(text, encoding="utf-8")

    assert tuple(reader.can_read(path) for reader in (TRIALS, TEAMS, ENTRIES)) == (trial, team, entry)
    assert not any(reader.can_read(file) for reader in (TRIALS, TEAMS, ENTRIES) for file in (other, tmp_path))


# 2017 to 2024


def test_sensors_are_known_by_name_and_type(tmp_path: Path) -> None:
    text = "sensors: {b: {type: break_beam, pose: {}}, a: {type: logical_camera}}"

    assert sensors_of(tmp_path, text) == {"a": "logical_camera", "b": "break_beam"}


@pytest.mark.parametrize("text", ["sensors:\n", "sensors: {}\n", "static_sensors: {}\nrobot_cameras: {}\n"])
def test_a_team_may_do_without_sensors_which_is_known_then(tmp_path: Path, text: str) -> None:
    assert sensors_of(tmp_path, text) == {}


def test_only_a_robot_camera_that_is_switched_on_is_a_sensor(tmp_path: Path) -> None:
    text = "sensors: {}\ngantry_bin_camera: {enable: true}\ngantry_tray_camera: {enable: false}\n"

    assert sensors_of(tmp_path, text) == {"gantry_bin_camera": "gantry_bin_camera"}


def test_the_sensors_of_2024_are_static_ones_and_active_robot_cameras(tmp_path: Path) -> None:
    text = (
        "robot_cameras:\n  floor_robot_camera: {active: true, type: rgb}\n"
        "  ceiling_robot_camera: {active: false, type: rgbd}\nstatic_sensors: {beam: {type: break_beam}}\n"
    )

    assert sensors_of(tmp_path, text) == {"beam": "break_beam", "floor_robot_camera": "robot_rgb_camera"}


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("sensors: [a]", "is not a map"),
        ("sensors: {a: }", "nothing is given here"),
        ("sensors: {a: {pose: {}}}", "key 'type' is missing"),
        ("sensors: {a: {tpye: lidar}}", "key 'type' is missing"),
        ("sensors: {a: {type: 3}}", "3 is not text"),
        ("sensors: {a: {type: lidar}, a: {type: lidar}}", "key 'a' is given twice"),
        ("sensors: {a: {type: lidar, type: camera}}", "key 'type' is given twice"),
        ("sensors: {a: {type: lidar}}\nstatic_sensors: {a: {type: lidar}}", "sensor 'a' is given twice"),
        ("robot_cameras: {a: {active: 1, type: rgb}}", "1 is not true or false"),
        ("robot_cameras: {a: {active: true, type: rbg}}", "'rbg' is no type"),
        ("sensors: {}\ngantry_bin_camera: {enable: 'yes'}", "'yes' is not true or false"),
        ("sensors: {" + ", ".join(f"s{n}: {{type: lidar}}" for n in range(1001)) + "}", "1001 sensors"),
        ("[]", "[] is not a map"),
        ("", "the file is empty"),
        ("orders: {}\nsensors: {}", "a trial configuration of 2018 to 2020, not like a team"),
        ("SEED: 1\nNUM_KITS: 1\n", "a trial configuration of 2025, not like a team"),
        ("camera_names: {}", "a YAML file with the keys camera_names, not like a team"),
    ],
)
def test_what_is_no_team_configuration_is_refused(tmp_path: Path, text: str, cause: str) -> None:
    assert cause in refusal(tmp_path, text).cause


def test_an_unknown_sensor_type_is_kept_and_named(tmp_path: Path) -> None:
    trial = read(tmp_path, "sensors: {a: {type: logical_camra}}")
    (mistake,) = trial.log_defects

    assert trial.team is not None
    assert dict(trial.team.sensors or {}) == {"a": "logical_camra"}
    assert mistake.kind == "unknown_sensor_type"
    assert mistake.message.endswith("did you mean 'logical_camera'?")


def test_a_mistake_in_the_place_of_a_sensor_is_named_and_costs_nothing(tmp_path: Path) -> None:
    trial = read(tmp_path, "sensors: {a: {type: lidar, pose: {rpy: [0, 0, 'p1'], xyz: [], xyz: []}}}")

    assert trial.team is not None
    assert dict(trial.team.sensors or {}) == {"a": "lidar"}
    assert sorted(defect.kind for defect in trial.log_defects) == ["configuration_mistake", "repeated_key"]


# 2025

TEAM_2025 = """\
COMPETITOR_NAME: blue_team
CONVEYOR_SPEED: 0.1
CELL_FEED_RATE: 0.2
SENSORS:
  - {NAME: s, POSE: {XYZ: [0, 0, 1], RPY: [0, 0, pi/2]}, TYPE: break_beam, UPDATE_RATE: 30}
"""


def lidar(horizontal: int, vertical: int, rate_hz: float = 10) -> str:
    return (
        f"TYPE: lidar, UPDATE_RATE: {rate_hz}, "
        f"HORIZONTAL: {{SAMPLES: {horizontal}, MIN_ANGLE: -1, MAX_ANGLE: 1}}, "
        f"VERTICAL: {{SAMPLES: {vertical}, MIN_ANGLE: 0, MAX_ANGLE: 0.5}}"
    )


BEAM = "TYPE: break_beam, UPDATE_RATE: 30"


@pytest.mark.parametrize(
    ("sensor", "graded"),
    [
        (BEAM, "break_beam_30hz"),
        ("TYPE: break_beam, UPDATE_RATE: 10", "break_beam_10hz"),
        ("TYPE: distance, UPDATE_RATE: 30.0", "distance_30hz"),
        ("TYPE: distance, UPDATE_RATE: 10", "distance_10hz"),
        ("TYPE: camera, UPDATE_RATE: 30, RESOLUTION: 1080p", "camera_1080p_30hz"),
        ("TYPE: camera, UPDATE_RATE: 30, RESOLUTION: 720p", "camera_720p_30hz"),
        ("TYPE: camera, UPDATE_RATE: 30", "camera_720p_30hz"),
        (lidar(50, 8, 20), "lidar_20hz"),
        (lidar(1, 1, 20), "lidar_20hz"),
        (lidar(50, 8), "lidar_10hz_400_samples"),
        (lidar(67, 3), "lidar_10hz_400_samples"),  # 201
        (lidar(50, 4), "lidar_10hz_200_samples"),  # 200
        (lidar(1, 1), "lidar_10hz_200_samples"),
    ],
)
def test_a_sensor_of_2025_has_the_grade_that_decides_its_price(
    tmp_path: Path, sensor: str, graded: str
) -> None:
    trial = read(tmp_path, TEAM_2025.replace(BEAM, sensor))

    assert trial.team == TeamSetup("blue_team", {"s": graded})
    assert trial.log_defects == ()


def test_a_camera_of_another_rate_counts_by_its_resolution_and_is_named(tmp_path: Path) -> None:
    sensor = "TYPE: camera, UPDATE_RATE: 15, RESOLUTION: 1080p"
    trial = read(tmp_path, TEAM_2025.replace(BEAM, sensor))

    assert trial.team == TeamSetup("blue_team", {"s": "camera_1080p_30hz"})
    assert "no grade for a camera of 15 Hz" in trial.log_defects[0].message


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        (BEAM, lidar(401, 1), "401 samples are not allowed"),
        (BEAM, lidar(201, 2), "a lidar of 402 samples is not allowed"),
        (BEAM, lidar(201, 2, 20), "a lidar of 402 samples is not allowed"),
        (BEAM, lidar(0, 2), "0 samples are not allowed"),
        (BEAM, lidar(10, 2, 15), "there is no lidar of 15 Hz"),
        (BEAM, "TYPE: lidar, UPDATE_RATE: 20", "key 'HORIZONTAL' is missing"),
        (BEAM, "TYPE: break_beam, UPDATE_RATE: 20", "there is no break_beam of 20 Hz"),
        (BEAM, "TYPE: distance, UPDATE_RATE: .nan", "nan is not a finite number"),
        (BEAM, "TYPE: distance", "key 'UPDATE_RATE' is missing"),
        (BEAM, "TYPE: camera, UPDATE_RATE: 31", "there is no camera of 31 Hz"),
        (BEAM, "TYPE: camera, UPDATE_RATE: 30, RESOLUTION: 4k", "'4k' is no RESOLUTION"),
        (BEAM, "TYPE: camra, UPDATE_RATE: 30", "'camra' is no TYPE"),
        ("NAME: s, ", "", "key 'NAME' is missing"),
        ("SENSORS:\n", f"SENSORS:\n  - {{NAME: s, {BEAM}}}\n", "sensor 's' is given twice"),
        ("SENSORS:", "SENSOR:", "unknown key 'SENSOR'"),
        ("COMPETITOR_NAME: blue_team\n", "", "key 'COMPETITOR_NAME' is missing"),
        ("blue_team", "''", "an empty name"),
        ("SPEED: 0.1", "SPEED: 0.11", "0.11 m/s is no speed"),
        ("SPEED: 0.1", "SPEED: 0", "0 m/s is no speed"),
        ("RATE: 0.2", "RATE: 0.21", "0.21 is no feed rate"),
        ("RATE: 0.2", "RATE: -0.1", "-0.1 is no feed rate"),
    ],
)
def test_a_mistake_in_a_team_of_2025_is_refused(tmp_path: Path, old: str, new: str, cause: str) -> None:
    assert old in TEAM_2025
    assert cause in refusal(tmp_path, TEAM_2025.replace(old, new, 1)).cause


def test_a_team_of_2025_may_have_no_sensors(tmp_path: Path) -> None:
    text = TEAM_2025.partition("SENSORS:")[0] + "SENSORS: []\n"

    assert read(tmp_path, text).team == TeamSetup("blue_team", {})
    assert TEAMS.describe(tmp_path / "team.yaml").facts == {"sensors": 0, "team": "blue_team"}


# Entries of 2023 and 2024

TOKEN = "ghp_secret0123456789"  # noqa: S105  # made up
ENTRY = f"team_name: blue\ngithub:\n  repository: a\n  personal_access_token: {TOKEN}\n"


def entry(folder: Path, text: str) -> Path:
    path = folder / "blue.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_name_of_an_entry_is_read_and_nothing_about_sensors(tmp_path: Path) -> None:
    path = entry(tmp_path, ENTRY)
    trial = ENTRIES.read(path, WANTED)

    assert trial.team == TeamSetup("blue", None)
    assert ENTRIES.describe(path).facts == {"team": "blue"}
    assert TOKEN not in repr(trial) + repr(ENTRIES.describe(path))


@pytest.mark.parametrize(
    "text",
    [
        ENTRY.replace("team_name: blue", "team_name: 3"),
        ENTRY.replace("team_name: blue", "team_name:"),
        ENTRY.replace("  repository", " repository"),
        ENTRY.replace(TOKEN, f"!!python/name:{TOKEN}"),
        ENTRY.replace(TOKEN, f"!!int {TOKEN}"),
        ENTRY + f"{TOKEN}: 1\n{TOKEN}: 2\n",
        f"[team_name, {TOKEN}",
        f"- {TOKEN}\n",
        TOKEN,
    ],
)
def test_no_refusal_of_an_entry_quotes_its_token(tmp_path: Path, text: str) -> None:
    path = entry(tmp_path, text)
    with pytest.raises(DataFileError) as caught:
        ENTRIES.read(path, WANTED)

    assert caught.value.hint
    assert TOKEN not in str(caught.value) + caught.value.hint + repr(caught.value.args)
    assert TOKEN not in ENTRIES.describe(path).damage
    assert caught.value.__cause__ is None
