"""The pages on outputs, CI and stewards: what they say is tried."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from ariac_score.cli import main
from ariac_score.cli.outcome import OWN_FORMATS
from ariac_score.report.exports import export_names
from ariac_score.results.adjustments import load_adjustments
from ariac_score.testing import SNAPSHOT_SIGNALS, write_trial_log
from ariac_score_ariac.testing import kitting_trial

ROOT = Path(__file__).parents[1]
OURS = ("Install", "Simulate")
"""Steps of the example that a team replaces by its own."""


def _page(name: str) -> str:
    return (ROOT / "docs" / name).read_text(encoding="utf-8")


def _blocks(name: str, language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", _page(name), re.DOTALL)


def _steps() -> list[dict[str, Any]]:
    (text,) = _blocks("ci.md", "yaml")
    steps: list[dict[str, Any]] = yaml.safe_load(text)["jobs"]["score"]["steps"]
    return steps


def _run_job(folder: Path) -> dict[str, int]:
    """Run the steps as the runner does: after one has failed only those that always run."""
    program = folder / "bin/ariac-score"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec {sys.executable} -m ariac_score.cli "$@"\n')
    program.chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{program.parent}:{os.environ['PATH']}",
        "GITHUB_STEP_SUMMARY": str(folder / "summary.md"),
    }
    codes: dict[str, int] = {}
    for step in _steps():
        if "run" not in step or step["name"] in OURS:
            continue
        if any(codes.values()) and step.get("if") != "always()":
            continue
        done = subprocess.run(
            ["/bin/sh", "-e", "-c", step["run"]],
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert "Traceback" not in done.stderr, done.stderr
        codes[step["name"]] = done.returncode
    return codes


@pytest.mark.slow
def test_the_action_of_its_page_is_green_for_a_good_trial(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    shutil.copy(ROOT / "examples/kitting_near_miss.mcap", tmp_path / "logs/trial.mcap")

    codes = _run_job(tmp_path)

    assert set(codes.values()) == {0}
    assert list(codes) == [s["name"] for s in _steps() if "run" in s and s["name"] not in OURS]
    assert (tmp_path / "summary.md").read_text().startswith("## score 25.760398 of 36 possible")
    assert json.loads((tmp_path / "result.sarif").read_text())["version"] == "2.1.0"
    for name in ("junit.xml", "annotations.mcap"):
        assert (tmp_path / name).stat().st_size > 0


@pytest.mark.slow
def test_the_action_of_its_page_is_red_for_a_log_that_lacks_the_human(tmp_path: Path) -> None:
    (tmp_path / "logs").mkdir()
    kept = [name for name in SNAPSHOT_SIGNALS if "human" not in name]
    log = write_trial_log(tmp_path / "trial.jsonl", kitting_trial(), signals=kept)
    log.rename(tmp_path / "logs/trial.mcap")  # the contents say what it is

    assert _run_job(tmp_path)["Can it be scored?"] in (5, 6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ci.md", "outputs.md", "stewards.md"])
def test_every_command_of_the_pages_runs(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    monkeypatch.chdir(tmp_path)
    score = ["score", "examples/kitting_near_miss.mcap", "--rules", "paper2020", "--output-format", "json"]
    assert main([*score, "-o", "result.json"]) == 0
    measured = _measured(capsys)
    if name == "stewards.md":
        (text,) = _blocks(name, "yaml")
        Path("adjustments.yaml").write_text(text.replace("MEASURED", measured))

    for line in "".join(_blocks(name, "sh")).splitlines():
        program, *arguments = _words(line)
        assert program == "ariac-score"
        code = main(arguments)
        told = capsys.readouterr()
        if arguments[0] == "rank" and "--adjustments" in arguments:
            # The example's decisions are about the trial of the page and no run of this competition.
            assert code == 4
            assert "the competition has no run of kitting_near_miss" in told.err
        else:
            assert code == (8 if "# exit code 8" in line else 0), (line, told.err)


def _words(line: str) -> list[str]:
    return line.partition("  #")[0].split()


def _measured(capsys: pytest.CaptureFixture[str]) -> str:
    assert main(["adjust", "result.json"]) == 0
    found = re.search(r"[0-9a-f]{64}", capsys.readouterr().out)
    assert found is not None
    return found[0]


def test_the_decisions_of_their_page_do_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    score = ["score", str(ROOT / "examples/kitting_near_miss.mcap"), "--rules", "paper2020"]
    assert main([*score, "--output-format", "json", "-o", "result.json"]) == 0
    (text,) = _blocks("stewards.md", "yaml")
    Path("adjustments.yaml").write_text(text.replace("MEASURED", _measured(capsys)))

    assert [d.time for d in load_adjustments(Path("adjustments.yaml")).decisions] == [
        "2024-05-12T14:30:00Z",
        "2024-05-12T13:10:00Z",
    ]
    assert main(["adjust", "result.json", "adjustments.yaml"]) == 0
    # Without the breach the task score of 28 counts; two points are taken.
    assert capsys.readouterr().out.startswith("26 as adjusted by the stewards\n")


def test_the_page_lists_every_format() -> None:
    page = _page("outputs.md")

    for name in (*OWN_FORMATS, *export_names()):
        assert re.search(rf"^\| `{name}` \|", page, re.MULTILINE)


def test_the_page_lists_every_step_of_verifying() -> None:
    source = (ROOT / "ariac_score/review/verify.py").read_text(encoding="utf-8")

    for name in set(re.findall(r'Step\(\s*"(\w+)"', source)):
        assert re.search(rf"^\| `{name}` \|", _page("stewards.md"), re.MULTILINE), name

    source = (ROOT / "ariac_score/review/verify_ranking.py").read_text(encoding="utf-8")
    (of_rankings,) = re.findall(r"^Of a ranking .*?(?=^#|\Z)", _page("stewards.md"), re.MULTILINE | re.DOTALL)
    for name in set(re.findall(r'Step\(\s*"(\w+)"', source)):
        assert f"`{name}`" in of_rankings, name
