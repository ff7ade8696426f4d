"""The manifests in `examples/clusters`, carried out by stand-ins: each job as its scheduler starts it."""

from __future__ import annotations

import filecmp
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score.cli import main
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

CLUSTERS = Path(__file__).parents[2] / "examples/clusters"
RULES = "ariac2020.as_coded"
RUNS, SHARDS = 5, 3


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Some runs, the last of them no log: a batch with it ends with 6."""
    folder = tmp_path_factory.mktemp("made") / "logs"
    folder.mkdir()
    write_trial_log(folder / "run_1.jsonl", kitting_trial(duration_s=33.0), signals=SNAPSHOT_SIGNALS)
    for number in range(2, RUNS):
        shutil.copy(folder / "run_1.jsonl", folder / f"run_{number}.jsonl")
    (folder / f"run_{RUNS}.jsonl").write_text("{", encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def alone(logs: Path) -> Path:
    """The same in one call."""
    season = logs.parent / "alone"
    assert main(["-q", "batch", str(logs), "--rules", RULES, "-o", str(season)]) == 6
    return season


def started(command: list[str], environment: dict[str, str], folder: Path) -> int:
    """A job, with the command line of this environment in its path and little else."""
    programs = folder / "programs"
    if not programs.is_dir():
        programs.mkdir()
        (programs / "ariac-score").write_text(f'#!/bin/sh\nexec {sys.executable} -m ariac_score "$@"\n')
        (programs / "ariac-score").chmod(0o755)
    own = {"PATH": f"{programs}:{os.environ['PATH']}", "HOME": str(folder), **environment}
    return subprocess.run(
        command, cwd=folder, env=own, capture_output=True, timeout=200, check=False
    ).returncode


def assert_same(one: Path, other: Path) -> None:
    files = [{p.relative_to(folder) for p in folder.rglob("*") if p.is_file()} for folder in (one, other)]
    assert files[0] == files[1]
    for name in files[0]:
        assert filecmp.cmp(one / name, other / name, shallow=False), name


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_an_array_of_slurm_leaves_what_one_call_does(logs: Path, alone: Path, tmp_path: Path) -> None:
    command = ["bash", str(CLUSTERS / "slurm.sh"), str(logs), RULES, f"{tmp_path / 'season'}/"]
    for task in (3, 1, 2, 1):  # in any order, one of them requeued
        array = {"SLURM_ARRAY_TASK_ID": str(task), "SLURM_ARRAY_TASK_COUNT": str(SHARDS)}
        assert started(command, array, tmp_path) == 0
    assert started(command, {}, tmp_path) == 0  # the job after the array

    assert_same(tmp_path / "season", alone)


@pytest.mark.slow
@pytest.mark.timeout(120)
def test_a_job_of_an_array_that_cannot_work_fails(tmp_path: Path) -> None:
    command = ["bash", str(CLUSTERS / "slurm.sh"), str(tmp_path / "nothing"), RULES, str(tmp_path / "season")]
    array = {"SLURM_ARRAY_TASK_ID": "1", "SLURM_ARRAY_TASK_COUNT": "1"}
    assert started(command, array, tmp_path) == 5


def jobs() -> dict[str, Any]:
    documents = yaml.safe_load_all((CLUSTERS / "kubernetes.yaml").read_text(encoding="utf-8"))
    return {job["metadata"]["labels"]["step"]: job["spec"] for job in documents}


def pod(job: Any) -> Any:
    (container,) = job["template"]["spec"]["containers"]
    return container


def test_the_job_is_one_that_kubernetes_takes() -> None:
    score, merge = jobs()["score"], jobs()["merge"]
    environment = {one["name"]: one["value"] for one in pod(score)["env"]}

    assert score["completionMode"] == "Indexed"
    assert environment["SHARDS"] == str(score["completions"])
    assert all(isinstance(value, str) for value in environment.values())
    assert score["template"]["spec"]["restartPolicy"] == "Never"  # which podFailurePolicy asks for
    assert "backoffLimit" not in score  # not beside backoffLimitPerIndex, which asks for Indexed
    for job in (score, merge):
        spec = job["template"]["spec"]
        assert spec["securityContext"]["runAsNonRoot"]
        assert {one["name"] for one in pod(job)["volumeMounts"]} == {one["name"] for one in spec["volumes"]}
        assert "@sha256:" in pod(job)["image"]
    assert pod(score)["image"] == pod(merge)["image"]


def carried_out(job: Any, folder: Path, **more: str) -> int:
    """The command of a pod, with its volume at another place."""
    container = pod(job)
    named = {one["name"]: one["value"] for one in container.get("env", [])} | more
    words = [
        word.replace("/competition", str(folder)) for word in (*container["command"], *container["args"])
    ]
    return started(words, named, folder)


@pytest.mark.slow
@pytest.mark.timeout(400)
def test_an_indexed_job_leaves_what_one_call_does(logs: Path, alone: Path, tmp_path: Path) -> None:
    shutil.copytree(logs, tmp_path / "logs")
    for index in (2, 0, 1):
        told = {"JOB_COMPLETION_INDEX": str(index), "SHARDS": str(SHARDS), "RULES": RULES}
        assert carried_out(jobs()["score"], tmp_path, **told) == 0
    assert carried_out(jobs()["merge"], tmp_path) == 0

    assert_same(tmp_path / "season", alone)
