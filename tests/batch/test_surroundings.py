"""What lies around a batch: other sources in the working directory, names that are no text, edited tables."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ariac_score.batch.index import Row
from ariac_score.batch.tasks import plan_batch
from ariac_score.cli import main
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

RULES = "ariac2020.as_coded"
COMMAND = "import sys; sys.path.pop(0); from ariac_score.cli import main; sys.exit(main())"
"""As the installed command is started: without the working directory on the path."""


@pytest.fixture
def trials(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "trials"
    folder.mkdir()
    write_trial_log(folder / "a.jsonl", kitting_trial(duration_s=40.0), signals=SNAPSHOT_SIGNALS)
    return folder


def batch(trials: Path, out: Path) -> int:
    return main(["batch", str(trials), "--rules", RULES, "-o", str(out), "-j", "1"])


def outcomes(out: Path) -> dict[str, str]:
    rows = [json.loads(line) for line in (out / "runs.jsonl").read_text(encoding="ascii").splitlines()]
    return {row["trial"]: row["outcome"] for row in rows}


def in_folder(folder: Path, trials: Path, out: Path) -> subprocess.CompletedProcess[str]:
    """Call `batch` as a user does whose working directory is that folder."""
    arguments = ["batch", str(trials), "--rules", RULES, "-o", str(out), "-j", "1"]
    return subprocess.run(
        [sys.executable, "-c", COMMAND, *arguments], cwd=folder, capture_output=True, text=True, check=False
    )


# The working directory -----------------------------------------------------------------


@pytest.mark.slow
def test_sources_in_the_working_directory_that_are_not_installed_are_not_used(
    trials: Path, tmp_path: Path
) -> None:
    checkout = tmp_path / "checkout"
    (checkout / "ariac_score").mkdir(parents=True)
    (checkout / "ariac_score/__init__.py").write_text("raise RuntimeError('not this one')\n")
    if sys.version_info >= (3, 11):  # before, Python itself cannot be kept from such a file
        (checkout / "yaml.py").write_text("raise RuntimeError('nor this one')\n")

    done = in_folder(checkout, trials, tmp_path / "out")

    assert (done.returncode, done.stderr) == (0, done.stderr)
    assert "RuntimeError" not in done.stderr
    assert outcomes(tmp_path / "out") == {"a.jsonl": "scored"}


@pytest.mark.slow
def test_a_worker_of_a_cluster_does_not_use_them_either(trials: Path, tmp_path: Path) -> None:
    (tmp_path / "ariac_score").mkdir()
    (tmp_path / "ariac_score/__init__.py").write_text("raise RuntimeError('not this one')\n")
    code = (
        "import sys; sys.path.pop(0); from ariac_score import load_rule_set;"
        " from ariac_score.batch.isolated import measure_isolated;"
        " from ariac_score.batch.tasks import BatchSetting, Limits, RunTask;"
        f" setting = BatchSetting.of(load_rule_set({RULES!r}), Limits(memory_bytes=0));"
        f" done = measure_isolated(RunTask('', 'a', 1, {str(trials / 'a.jsonl')!r}), setting);"
        " print(b'task' in done.document)"
    )

    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )

    assert done.stdout == "True\n", done.stderr


@pytest.mark.slow
def test_programs_that_a_plugin_starts_have_the_environment_of_the_user(tmp_path: Path) -> None:
    code = (
        "import os; os.environ['PYTHONSAFEPATH'] = local.SAFE_PATH[1];"
        " import ariac_score.batch.preload; print(os.environ.get('PYTHONSAFEPATH'))"
    )
    code = f"from ariac_score.batch import local; {code}"

    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )

    assert done.stdout == "None\n"


@pytest.mark.slow
def test_message_packages_that_cannot_be_read_stop_no_batch(trials: Path, tmp_path: Path) -> None:
    folder = tmp_path / "odd" / "odd_msgs-1.0.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: odd-msgs\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text("[ariac_score.messages]\nariac_msgs = json\n")
    path = os.pathsep.join(filter(None, [str(folder.parent), os.environ.get("PYTHONPATH", "")]))
    arguments = ["batch", str(trials), "--rules", RULES, "-o", str(tmp_path / "out"), "-j", "1"]

    done = subprocess.run(
        [sys.executable, "-c", COMMAND, *arguments],
        env={**os.environ, "PYTHONPATH": path},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )

    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert outcomes(tmp_path / "out") == {"a.jsonl": "scored"}


# Names ---------------------------------------------------------------------------------


@pytest.fixture
def no_text() -> bytes:
    """A name that is no UTF-8, where the file system takes it."""
    if sys.platform != "linux":
        pytest.skip("this file system takes only names that are text")
    return b"\xff.jsonl"


def test_a_name_that_is_no_utf_8_costs_its_run_alone(
    trials: Path, tmp_path: Path, no_text: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    Path(os.fsdecode(os.fsencode(trials) + b"/" + no_text)).write_bytes((trials / "a.jsonl").read_bytes())

    assert batch(trials, tmp_path / "out") == 6

    assert outcomes(tmp_path / "out") == {"a.jsonl": "scored", "\\udcff.jsonl": "refused"}
    assert "its name is no UTF-8; rename it" in capsys.readouterr().err
    assert batch(trials, tmp_path / "out") == 6  # and the next call reads its own tables


def test_a_team_whose_folder_is_no_utf_8_costs_its_runs_alone(tmp_path: Path, no_text: bytes) -> None:
    for team in (b"a", no_text):
        folder = Path(os.fsdecode(os.fsencode(tmp_path) + b"/logs/" + team))
        folder.mkdir(parents=True)
        write_trial_log(folder / "kitting_1", kitting_trial())

    tasks = plan_batch(tmp_path, RULES).tasks

    assert {task.team: task.refused for task in tasks} == {
        "a": "",
        "\\udcff.jsonl": "its name is no UTF-8; rename it",
    }


def test_a_file_within_a_run_may_have_any_name(trials: Path, tmp_path: Path, no_text: bytes) -> None:
    run = trials / "b"
    run.mkdir()
    (trials / "a.jsonl").rename(run / "a.jsonl")
    Path(os.fsdecode(os.fsencode(run) + b"/" + b"\xff.txt")).write_text("notes")

    assert batch(trials, tmp_path / "out") == 0
    assert outcomes(tmp_path / "out") == {"b": "scored"}


# Edited tables -------------------------------------------------------------------------


def _row(**fields: object) -> Callable[[str], str]:
    return lambda line: json.dumps({**json.loads(line), **fields}) + "\n"


EDITED: dict[str, Callable[[str], str]] = {
    "a number beyond 64 bits": _row(run=10**30),
    "a negative number beyond them": _row(run=-(10**30)),
    "half a surrogate pair": _row(team="\ud800"),
    "one in the name of the object": _row(object="objects/aa/bb/\ud800"),
    "one in the reason": _row(reason="\ud800"),
    "a deep nest": lambda _line: "[" * 200_000 + "\n",
    "no ASCII": lambda _line: "\u00ff\n",
}


@pytest.mark.parametrize("edit", EDITED.values(), ids=EDITED)
def test_a_row_that_nobody_wrote_is_made_again(
    trials: Path, tmp_path: Path, edit: Callable[[str], str]
) -> None:
    out = tmp_path / "out"
    assert batch(trials, out) == 0
    whole = (out / "runs.jsonl").read_text(encoding="ascii")
    (out / "runs.jsonl").write_text(edit(whole), encoding="utf-8")

    assert batch(trials, out) == 0
    assert (out / "runs.jsonl").read_text(encoding="ascii") == whole


@pytest.mark.parametrize("line", [edit('{"run": 1}') for edit in EDITED.values()], ids=EDITED)
def test_a_line_that_is_no_row_is_a_value_error(line: str) -> None:
    with pytest.raises(ValueError, match=r"."):
        Row.from_line(line)


@pytest.mark.parametrize("name", ["batch.json", "rules.yaml", "runs.jsonl", "index.sqlite"])
def test_a_file_of_the_folder_that_is_no_text_is_made_again(trials: Path, tmp_path: Path, name: str) -> None:
    out = tmp_path / "out"
    assert batch(trials, out) == 0
    whole = (out / name).read_bytes()
    (out / name).write_bytes(b"\xff\xfe")

    assert batch(trials, out) == 0
    assert (out / name).read_bytes() == whole
