"""Trial configurations of 2025; ranges: notes on log formats, section 7.4, and the official example."""

from __future__ import annotations

from pathlib import Path

import pytest

from ariac_score.checks.contracts import Wanted
from ariac_score.errors import DataFileError
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import Trial
from ariac_score_ariac.config.ariac_config import TrialConfigReader

READER = TrialConfigReader()

OFFICIAL_EXAMPLE = """\
ID: "LHAF9835"
SEED: 12345
DEFECT_RATE: 0.15
TIME_LIMIT: 900
NUM_KITS: 3
NUM_MODULES: 2
POSSIBLE_DEFECTS: [1, 2, 3, 4, 5]
CHALLENGES:
  CONVEYOR_MALFUNCTIONS:
    - START_TIME: 120
      DURATION: 30
  VOLTAGE_TESTER_MALFUNCTIONS:
    - {START_TIME: 180, DURATION: 45, TESTER: 1}
    - {START_TIME: 300, DURATION: 25, TESTER: 2}
  VACUUM_TOOL_MALFUNCTIONS:
    - {TOOL: 1, GRASP_OCCURRENCE: 3}
  HIGH_PRIORITY_ORDERS:
    - {START_TIME: 240, ID: K7R3M8}
    - {START_TIME: 420, ID: N2F9X5}
"""
"""The example of the official documentation, shortened."""


def read(folder: Path, text: str) -> Trial:
    path = folder / "trial.yaml"
    path.write_text(text, encoding="utf-8")
    assert READER.can_read(path)
    return READER.read(path, Wanted(LogMap("test")))


def test_the_official_example_states_its_numbers_and_names_no_order(tmp_path: Path) -> None:
    trial = read(tmp_path, OFFICIAL_EXAMPLE)
    facts = {"num_high_priority": 2.0, "num_kits": 3.0, "num_modules": 2.0, "time_limit_s": 900.0}

    assert dict(trial.facts) == facts
    assert (trial.work, trial.log_defects) == ((), ())
    assert READER.describe(tmp_path / "trial.yaml").facts == facts


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("SEED: 12345", "SEED: 0"),
        ("RATE: 0.15", "RATE: 0"),
        ("RATE: 0.15", "RATE: 1.0"),
        ("LIMIT: 900", "LIMIT: 100"),
        ("KITS: 3", "KITS: 0"),
        ("KITS: 3", "KITS: 12"),
        ("MODULES: 2", "MODULES: 16"),
        ("START_TIME: 120", "START_TIME: 0"),
        ("POSSIBLE_DEFECTS: [1, 2, 3, 4, 5]\n", ""),
    ],
)
def test_the_ends_of_the_ranges_are_within(tmp_path: Path, old: str, new: str) -> None:
    assert old in OFFICIAL_EXAMPLE
    assert read(tmp_path, OFFICIAL_EXAMPLE.replace(old, new, 1)).log_defects == ()


def test_a_trial_without_challenges_has_no_high_priority_orders(tmp_path: Path) -> None:
    for ending in ("", "CHALLENGES:\n", "CHALLENGES: {}\n"):
        text = OFFICIAL_EXAMPLE.partition("CHALLENGES")[0] + ending
        assert read(tmp_path, text).facts["num_high_priority"] == 0


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        ('"LHAF9835"', '"LHAF983"', "'LHAF983' is no trial id"),
        ('"LHAF9835"', '"lhaf9835"', "'lhaf9835' is no trial id"),
        ('"LHAF9835"', "12345678", "12345678 is no trial id"),
        ("SEED: 12345", "SEED: -1", "-1 is no seed"),
        ("SEED: 12345", "SEED: 1.5", "1.5 is not a whole number"),
        ("RATE: 0.15", "RATE: 1.0000000000000002", "is no rate"),
        ("RATE: 0.15", "RATE: -0.01", "-0.01 is no rate"),
        ("RATE: 0.15", "RATE: .nan", "nan is not a finite number"),
        ("LIMIT: 900", "LIMIT: 99", "99 s is no time limit"),
        ("LIMIT: 900", "LIMIT: -1", "-1 s is no time limit"),
        ("LIMIT: 900", "LIMIT: 900.5", "900.5 is not a whole number"),
        ("KITS: 3", "KITS: -1", "-1 kits cannot be ordered"),
        ("KITS: 3", "KITS: 1000000", "1000000 kits cannot be ordered"),
        ("MODULES: 2", "MODULES: true", "True is not a whole number"),
        ("NUM_KITS: 3\n", "", "key 'NUM_KITS' is missing"),
        ("NUM_KITS: 3", "NUM_KIT: 3", "unknown key 'NUM_KIT'"),
        ("NUM_KITS: 3", "NUM_KITS: 3\nNUM_KITS: 4", "key 'NUM_KITS' is given twice"),
        ("CHALLENGES:", "CHALLENGE:", "unknown key 'CHALLENGE'"),
        ("HIGH_PRIORITY_ORDERS:", "HIGH_PRIORITY_ORDER:", "unknown key 'HIGH_PRIORITY_ORDER'"),
        ("[1, 2, 3, 4, 5]", "[0]", "0 is no type of defect"),
        ("[1, 2, 3, 4, 5]", "3", "3 is not a list"),
        ("START_TIME: 120", "START_TIME: -120", "-120 is no START_TIME"),
        ("DURATION: 30", "DURATION: 0", "0 is no DURATION"),
        ("TESTER: 2", "TESTER: 3", "3 is no TESTER"),
        ("TOOL: 1", "TOOL: 0", "0 is no TOOL"),
        (", GRASP_OCCURRENCE: 3", "", "key 'GRASP_OCCURRENCE' is missing"),
        ("START_TIME: 420", "START: 420", "unknown key 'START'"),
        ("ID: N2F9X5", "ID: 3", "3 is not text"),
    ],
)
def test_a_mistake_in_a_trial_of_2025_is_refused(tmp_path: Path, old: str, new: str, cause: str) -> None:
    assert old in OFFICIAL_EXAMPLE
    with pytest.raises(DataFileError) as caught:
        read(tmp_path, OFFICIAL_EXAMPLE.replace(old, new, 1))

    assert cause in caught.value.cause
    assert "line " in caught.value.place or "$" in caught.value.place
    assert caught.value.hint


@pytest.mark.parametrize(
    ("old", "new", "cause"),
    [
        ("KITS: 3", "KITS: 13", "13 kits are more than the simulator accepts"),
        ("MODULES: 2", "MODULES: 17", "17 modules are more than the simulator accepts"),
        ("ID: N2F9X5", "ID: K7R3M8", "high-priority order 'K7R3M8' is given twice"),
    ],
)
def test_what_the_simulator_would_not_take_is_named(tmp_path: Path, old: str, new: str, cause: str) -> None:
    (mistake,) = read(tmp_path, OFFICIAL_EXAMPLE.replace(old, new, 1)).log_defects

    assert mistake.message.startswith(cause)
