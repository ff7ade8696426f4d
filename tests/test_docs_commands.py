"""Every command line on a page is one that the program takes; those that can be are run."""

from __future__ import annotations

import io
import re
import shlex
import shutil
import subprocess
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest
import yaml

from ariac_score.cli import _parser, main
from ariac_score.cli.parser import command_in

ROOT = Path(__file__).parents[1]
EXAMPLE = "examples/kitting_near_miss.mcap"
PAGES = [
    ROOT / "README.md",
    *sorted((ROOT / "docs").rglob("*.md")),
    *sorted(
        file
        for file in (ROOT / "examples").rglob("README.md")
        if not any(part == "build" or part.endswith(".egg-info") for part in file.parts)
    ),
]
ELSEWHERE = {
    "docs/ci.md": "tests/test_docs_of_outputs.py",
    "docs/outputs.md": "tests/test_docs_of_outputs.py",
    "docs/stewards.md": "tests/test_docs_of_outputs.py",
    "docs/protests.md": "tests/test_protests.py",
    "docs/write-a-monitor.md": "tests/testing/test_tutorial.py",
    "docs/write-a-competition.md": "tests/test_docs.py, from Python",
    "docs/recording.md": "tests/testing/test_online_page.py",
    "docs/gaps.md": "tests/logs/test_real_recordings.py",
    "docs/guests.md": "tests/guests, with the guests installed",
    "docs/platforms.md": "tests/platforms, with an image and a server that are made",
    "docs/conformance.md": "tests/logs/test_conformance.py, of the suite that is here",
    "docs/reliability.md": "tests/batch, in small",
    "docs/scale.md": "tests/batch, with storages and clusters that are made",
    "docs/laws.md": "tests/review/test_proofs.py",
    "docs/mutants.md": "tests/test_mutants.py: it plants faults into a checkout",
    "docs/python.md": "tests/test_python_page.py",
    "docs/tutorials/": "tests/test_tutorials.py",
    "examples/competitions/": "tests/guests, with the guests installed",
    "examples/third_party_monitor/": "tests/testing, where it is installed",
}
"""Pages whose commands other tests run."""
RUN = [
    "README.md",
    "docs/aic.md",
    "docs/competitions.md",
    "docs/fairness.md",
    "docs/log_maps.md",
    "docs/ranking.md",
    "docs/redteam.md",
    "docs/report.md",
    "docs/rml.md",
    "docs/live.md",
    "docs/rosmonitoring.md",
    "docs/security.md",
    "docs/settings.md",
    "examples/README.md",
]
NOT_HERE = {
    "python3 -m venv": "the two commands of the README: .ci/run runs them to the letter",
    "pip install": "needs the network",
    "ariac-score watch trial.bag.active": "a bag that is being written: tests/live/test_files.py",
    "ariac-score watch foxglove:": "a cell on a network: tests/live/test_networks_by_command.py",
    "ariac-score watch --cell north=foxglove:": "cells on a network: tests/report/test_screen_browser.py",
    "ariac-score oracle": "serves until it is interrupted: tests/oracle",
    "python examples/live/monitor.py": "talks to a server: tests/oracle/test_live.py",
    "kill %1": "ends it",
    "ariac-score audit rosmonitoring-status.jsonl": "a log of a running system: tests/oracle",
    "eval ": "for a shell: tests/cli/test_completion.py",
    "minisign": "another program: tests/results/test_signing.py",
}
"""Commands that are not run here, and why."""


def _name(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


def _lines(page: Path) -> list[str]:
    """The command lines of a page, without comments other than those on an exit code."""
    text = page.read_text(encoding="utf-8")
    blocks = re.findall(r"^```([^\n]*)\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    shell = [block for language, block in blocks if language in ("sh", "")]
    lines = [line for block in shell for line in block.replace("\\\n", " ").splitlines()]
    bare = [re.sub(r"\s+# (?!exit code).*$", "", line).strip() for line in lines]
    wanted = ("ariac-score ", "python", "pip ", "eval ", "kill ", "minisign ")
    return [line for line in bare if line.startswith(wanted)]


def _words(line: str) -> list[str]:
    return shlex.split(line.partition(" # ")[0])


@pytest.mark.parametrize("page", [page for page in PAGES if page.parent.name != "tutorials"], ids=_name)
def test_the_program_takes_every_command_line_of_a_page(page: Path) -> None:
    for line in _lines(page):
        program, *words = _words(line)
        if program != "ariac-score" or "[" in line:  # an overview says what may be left out
            continue
        words = [word for word in words if word != "&"]
        said = io.StringIO()
        with redirect_stderr(said):
            taken = _taken(words)
        assert taken, (line, said.getvalue())


def _taken(words: list[str]) -> bool:
    try:
        _parser(command_in(words)).parse_args(words)
    except SystemExit as left:
        return left.code == 0
    return True


def test_every_page_with_commands_is_run_by_some_test() -> None:
    with_commands = {_name(page) for page in PAGES if _lines(page)}

    left = {
        name
        for name in with_commands.difference(RUN)
        if not any(name.startswith(known) for known in ELSEWHERE)
    }
    assert left <= {"docs/audit.md"}  # one line that says what may be given
    for where in ELSEWHERE.values():
        assert (ROOT / re.split(r"[:,]", where)[0]).exists(), where


def _prepare(page: str, folder: Path) -> None:
    """What a page takes for granted."""
    # A copy: some commands write beside the examples, and other tests read there at the same time.
    shutil.copytree(ROOT / "examples", folder / "examples")
    if page == "docs/competitions.md":
        (folder / "ours.yaml").write_text(
            "id: ours\ntitle: Ours\nsource: a test\nextends: ariac2024.official\n", encoding="utf-8"
        )
        assert main(["report", "examples/competition/2024", "-o", "old/site"]) == 0
        Path("out").mkdir()
    if page == "docs/aic.md":
        text = (ROOT / page).read_text(encoding="utf-8")
        (rules,) = re.findall(r"^```yaml\n(id: next_week\n.*?)^```", text, re.DOTALL | re.MULTILINE)
        (folder / "next_week.yaml").write_text(rules, encoding="utf-8")
        for policy in ("calm", "quick"):
            for number in range(1, 4):
                shutil.copytree(ROOT / "examples/aic/run", folder / f"results/{policy}/{number}")
    if page in ("docs/security.md", "docs/fairness.md"):
        assert (
            main(["score", "examples/kitting_near_miss.mcap", "--rules", "paper2020", "-o", "result.json"])
            == 0
        )


@pytest.mark.slow
@pytest.mark.parametrize("page", RUN)
def test_every_command_of_a_page_runs(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    _prepare(page, tmp_path)

    for line in _lines(ROOT / page):
        if line.startswith(tuple(NOT_HERE)):
            continue
        program, *words = _words(line)
        if program == "python":
            subprocess.run([sys.executable, *words], check=True)
            continue
        out = io.StringIO()
        with redirect_stdout(out), redirect_stderr(out):
            code = main(words)
        announced = re.search(r"# exit code (\d)", line)
        wanted = int(announced[1]) if announced else 0
        assert (program, code) == ("ariac-score", wanted), (line, out.getvalue())


def test_every_page_is_in_the_navigation_of_the_site() -> None:
    config = yaml.safe_load((ROOT / "docs/site/mkdocs.yml").read_text(encoding="utf-8"))
    named = set(re.findall(r"[\w./-]+\.md", yaml.safe_dump(config["nav"])))
    pages = {file.relative_to(ROOT / "docs").as_posix() for file in (ROOT / "docs").rglob("*.md")}

    # Pages of these folders are added by docs/site/hooks.py, and those of `reference` are made by it.
    written = {page for page in pages if not page.startswith(("plugins/", "rulebooks/"))}
    assert {page for page in named if not page.startswith("reference/")} == written
