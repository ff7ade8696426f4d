"""Every plugin of the guests keeps its contract, and each guest works from where an installer puts it."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ariac_score.cli import main
from ariac_score.cli.notes import APART

ON_THEIR_RECORDING = [
    # A world of its own: on any other trial its robot goes nowhere.
    ("barn.navigation", "barn/recording/world_42"),
    ("barn.trace", "barn/recording/world_42/trace.txt"),
    ("barn.world", "barn/recording/world_42/path_42.npy"),
    ("barn.outcome", "barn/recording/world_42/out.txt"),
    ("robocup_work.task", "robocup_work/recording/bmt_1/task.yaml"),
    ("robocup_work.referee", "robocup_work/recording/bmt_1/referee.csv"),
    ("carla.results", "carla/recording/results_2_0.json"),
]
CHECKS = [
    "barn.navigation",
    "robocup_work.manipulation",
    "robocup_work.mishap",
    "robocup_work.reached",
    "robocup_work.incidents",
    "carla.completion",
    "carla.infractions",
    "carla.off_road",
    "carla.slow",
    "carla.slow_factor",
]


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """The guests behave: no plugin needs a process of its own, which takes longer than its checks."""
    monkeypatch.setenv(APART, "1")


@pytest.mark.usefixtures("in_this_process")
@pytest.mark.parametrize(("plugin", "file"), ON_THEIR_RECORDING)
def test_a_plugin_of_a_guest_keeps_its_contract_on_its_recording(
    plugin: str, file: str, guests: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["plugins", "check", plugin, "--trial", str(guests / file)]) == 0, capsys.readouterr().out


@pytest.mark.usefixtures("guests", "in_this_process")
@pytest.mark.parametrize("check", CHECKS)
def test_a_check_of_a_guest_keeps_its_contract(check: str, capsys: pytest.CaptureFixture[str]) -> None:
    code = main(["plugins", "check", check])

    said = capsys.readouterr().out
    assert code == 0, said
    assert "it was seen to decide, and to decide alike" in said


@pytest.mark.slow
@pytest.mark.usefixtures("guests")
def test_the_doctor_finds_nothing_wrong_with_them(capsys: pytest.CaptureFixture[str]) -> None:
    main(["plugins", "doctor"])

    said = capsys.readouterr()
    assert [line for line in (said.out + said.err).splitlines() if "-score 0.1.0):" in line] == []


@pytest.mark.slow
@pytest.mark.usefixtures("guests")
def test_their_rule_sets_have_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rules", "list"]) == 0

    listed = {line.split()[0] for line in capsys.readouterr().out.splitlines() if "-score 0.1.0" in line}
    assert listed == {"barn", "barn.2022", "carla.2_0", "carla.2_1", "robocup_work.bmt_2024"}


@pytest.mark.slow  # pip
@pytest.mark.parametrize(
    ("guest", "recording", "rules", "score"),
    [
        ("barn", "world_42", "barn", "0.312508"),
        ("robocup_work", "bmt_1", "robocup_work.bmt_2024", "577.8"),
        ("carla", "results_2_1.json", "carla.2_1", "65.178571"),
    ],
)
def test_a_guest_scores_from_where_pip_installs_it(
    guest: str, recording: str, rules: str, score: str, tmp_path: Path
) -> None:
    here = Path(__file__).parents[2] / "examples/competitions" / guest
    # A copy, for building leaves folders behind.
    source = shutil.copytree(
        here, tmp_path / "source", ignore=shutil.ignore_patterns("recording", "__pycache__")
    )
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*pip, "--target", str(tmp_path / "site"), str(source)], check=True, timeout=300)

    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "ariac_score.cli",
            "score",
            str(here / "recording" / recording),
            "--rules",
            rules,
        ],
        env={**os.environ, "PYTHONPATH": str(tmp_path / "site")},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )

    assert done.stdout.startswith(f"{score} of"), done.stderr
