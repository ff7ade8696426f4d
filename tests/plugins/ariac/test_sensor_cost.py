"""The reader of `sensor_cost.txt`; layout and prices: notes on log formats, section 6."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.checks.contracts import Reader, Wanted
from ariac_score.errors import LogError, NothingToScoreError
from ariac_score.trial.channels import LogMap
from ariac_score_ariac.official.sensor_cost import SensorCostReader
from ariac_score_ariac.work import SensorBill

READER = SensorCostReader()
WANTED = Wanted(LogMap("test"))

ROW = "=" * 30 + "\n"
# 2 * 100 + 300 + 3 * 500 + 1000 = 3000
COST = f"""\
{ROW}User Sensor Log
{ROW}Number of break_beam's used: 2
Number of proximity's used: 0
Number of laser_profiler's used: 0
Number of lidar's used: 0
Number of rgb_camera's used: 1
Number of rgbd_camera's used: 0
Number of basic_logical_camera's used: 3
Number of advanced_logical_camera's used: 0
Number of robot_rgb_camera's used: 0
Number of robot_rgbd_camera's used: 1


Total sensor cost is: $3000
{"-" * 30}
"""


def read(folder: Path, text: str) -> SensorBill:
    path = folder / "sensor_cost.txt"
    path.write_text(text, encoding="utf-8", newline="")
    (bill,) = READER.read(path, WANTED).records
    assert isinstance(bill, SensorBill)
    return bill


def test_is_a_reader() -> None:
    assert isinstance(READER, Reader)


def test_the_sensors_are_counted_through_and_the_total_is_taken_as_printed(tmp_path: Path) -> None:
    bill = read(tmp_path, COST)

    assert bill.cost == 3000.0
    assert dict(bill.sensors) == {
        "basic_logical_camera_1": "basic_logical_camera",
        "basic_logical_camera_2": "basic_logical_camera",
        "basic_logical_camera_3": "basic_logical_camera",
        "break_beam_1": "break_beam",
        "break_beam_2": "break_beam",
        "rgb_camera_1": "rgb_camera",
        "robot_rgbd_camera_1": "robot_rgbd_camera",
    }


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\n", "\r\n"),
        ("\n\n\nTotal", "\nTotal"),
        ("User Sensor Log", "User Sensor Log\nSeed: 3"),
        ("$3000", "$3000.0"),
    ],
)
def test_it_is_read_by_label(tmp_path: Path, old: str, new: str) -> None:
    assert read(tmp_path, COST.replace(old, new)).cost == 3000.0


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        (COST[: COST.index("Total")], "cut off"),
        (COST[: COST.index("00\n---")], "cut off"),  # the amount is now $30
        (COST.replace("$3000", "3000"), "'3000' is not an amount of dollars"),
        (COST.replace("$3000", "$-5"), "'$-5' is not an amount of dollars"),
        (COST.replace("$3000", "$many"), "is not an amount of dollars"),
        (
            COST.replace("beam's used: 2", "beam's used: two"),
            "'two' is not a number of sensors of type 'break_beam'",
        ),
        (COST.replace("beam's used: 2", "beam's used: 99999"), "'99999' is not a number of sensors"),
        ("=" * 1_000_001, "more than 1,000,000 bytes"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, text: str, cause: str) -> None:
    with pytest.raises(LogError) as caught:
        read(tmp_path, text)

    assert cause in caught.value.cause
    assert caught.value.hint
    assert READER.describe(tmp_path / "sensor_cost.txt").damage == str(caught.value)


def test_an_empty_or_missing_file_is_nothing_to_score(tmp_path: Path) -> None:
    with pytest.raises(NothingToScoreError, match="empty"):
        read(tmp_path, "")
    with pytest.raises(NothingToScoreError, match="no such file"):
        READER.read(tmp_path / "other.txt", WANTED)


@pytest.mark.parametrize(
    ("name", "text", "ours"),
    [
        ("sensor_cost.txt", COST, True),
        ("renamed.txt", COST, True),
        ("sensor_cost.txt", "", True),
        ("sensor_cost.yaml", COST, False),
        ("notes.txt", "sensors cost money\n", False),
    ],
)
def test_it_is_known_by_its_heading(tmp_path: Path, name: str, text: str, ours: bool) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")

    assert READER.can_read(tmp_path / name) is ours


def test_it_describes_itself(tmp_path: Path) -> None:
    read(tmp_path, COST)

    assert dict(READER.describe(tmp_path / "sensor_cost.txt").facts) == {
        "total": 3000.0,
        "sensors": 7,
        "break_beam": 2,
        "rgb_camera": 1,
        "basic_logical_camera": 3,
        "robot_rgbd_camera": 1,
    }
