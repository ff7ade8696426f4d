"""The tutorial is done as it is written: every command run, every file taken, every output compared."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/write-a-monitor.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "examples/third_party_monitor"

BLOCK = re.compile(r"(?P<before>[^\n]*)\n\n```(?P<language>\w+)\n(?P<text>.*?)```", re.DOTALL)
FILE = re.compile(r"[Pp]ut this into `([^`]+)`:$")
LEFT_OUT = "…"


def steps() -> list[tuple[str, str, str]]:
    """Language, file (where it is one) and text of every block of the page."""
    found = []
    for block in BLOCK.finditer(PAGE):
        file = FILE.search(block["before"])
        found.append((block["language"], file[1] if file else "", block["text"]))
    return found


def shown_in(output: list[str], shown: list[str]) -> str:
    """The first line of a page that the output does not have in its turn; lines may be left out at `…`."""
    at, loose = 0, False
    for line in shown:
        if line == LEFT_OUT:
            loose = True
            continue
        where = next((k for k in range(at, len(output)) if output[k].rstrip() == line.rstrip()), None)
        if where is None or not (loose or where == at):
            return line
        at, loose = where + 1, False
    return ""


@pytest.mark.slow
def test_the_tutorial_leads_from_an_empty_folder_to_a_monitor_that_costs_points(
    environment: Any, tmp_path: Path
) -> None:
    here, output = tmp_path, [""]
    for language, file, text in steps():
        if file:
            assert (here / file).is_file()  # `new` made it
            (here / file).write_text(text, encoding="utf-8")
        elif language == "sh":
            output = []
            for command in text.splitlines():
                done = environment.run(command, here)
                assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"
                output += done.stdout.splitlines()
                if command.startswith("cd "):
                    here = here / command.removeprefix("cd ")
        elif language == "yaml":
            assert "local_plugins" in text  # what an organiser writes; tried in tests/checks/test_local.py
        elif language == "text":
            assert shown_in(output, text.splitlines()) == "", "\n".join(output)
        else:
            pytest.fail(f"nobody knows what to do with this block:\n{text}")

    made = {p.relative_to(here): p for p in sorted(here.rglob("*")) if p.is_file() and _written(p)}
    kept = {p.relative_to(EXAMPLE): p for p in sorted(EXAMPLE.rglob("*")) if p.is_file() and _written(p)}
    assert [*made] == [*kept]
    for name, path in made.items():
        assert path.read_text(encoding="utf-8") == kept[name].read_text(encoding="utf-8"), name


def _written(path: Path) -> bool:
    """Whether somebody wrote it, and no tool."""
    return not any(part.startswith((".", "__pycache__")) or part.endswith(".egg-info") for part in path.parts)


def test_the_page_has_every_step() -> None:
    languages = [language for language, _, _ in steps()]

    assert languages.count("sh") >= 8
    # A quarter of an hour: a minute for the commands together, five for the words, the rest to look.
    assert sum(len(text.splitlines()) for language, _, text in steps() if language == "sh") <= 20
    assert languages.count("text") >= 4
    assert [file for _, file, _ in steps() if file] == [
        "workshop_calm_robot.py",
        "test_workshop_calm_robot.py",
        "workshop_calm_robot.yaml",
    ]


@pytest.mark.parametrize(
    ("output", "shown", "missed"),
    [
        ("a b c", "a b c", ""),
        ("a b c", "a b", ""),
        ("a b c", "b c", "b"),
        ("a b c", "… c", ""),
        ("a b c", "a … c", ""),
        ("a b c", "a c", "c"),
        ("a b c", "c … a", "c"),
        ("a", "b", "b"),
    ],
)
def test_what_a_page_shows_must_be_in_the_output(output: str, shown: str, missed: str) -> None:
    assert shown_in(output.split(), shown.split()) == missed


@pytest.mark.slow
def test_a_strangers_monitor_installed_as_a_package_takes_part_in_a_score(
    environment: Any, tmp_path: Path
) -> None:
    """Not editable, from a copy: what a competition would do with it."""
    copy = tmp_path / "copy"
    for path in EXAMPLE.rglob("*"):
        if path.is_file() and _written(path.relative_to(EXAMPLE)):
            (copy / path.relative_to(EXAMPLE)).parent.mkdir(parents=True, exist_ok=True)
            (copy / path.relative_to(EXAMPLE)).write_bytes(path.read_bytes())
    installed = environment.run(f"pip install -q --force-reinstall --no-deps {copy}", tmp_path)
    assert installed.returncode == 0, installed.stderr

    rules, log = (
        EXAMPLE / "workshop_calm_robot/workshop_calm_robot.yaml",
        ROOT / "examples/kitting_near_miss.mcap",
    )
    done = environment.run(f"ariac-score score {log} --rules {rules} --output-format json", tmp_path)

    assert done.returncode == 0, done.stderr
    assert '"score": 26' in done.stdout
    assert '"workshop-calm-robot"' in done.stdout
