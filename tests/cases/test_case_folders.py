"""The options that name a folder of cases, given a folder outside the repository."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

CASES = {
    "--official-cases": (
        "tests/cases/test_official_cases.py",
        "made.json",
        {"id": "of-ours", "kind": "observed"},
    ),
    "--official-vectors": ("tests/cases/test_official_vectors.py", "of-ours.jsonl", {}),
    "--rml-cases": ("tests/cases/test_rml_cases.py", "made.json", {"name": "of-ours", "spec": "made.rml"}),
    "--bag-cases": ("tests/logs/test_bag_cases.py", "of-ours.bag.expected.json", {}),
}
"""Of each option where its tests are, and a file in which they find a case."""


@pytest.mark.slow
def test_each_option_takes_a_folder_outside_the_repository(tmp_path: Path) -> None:
    """As documented: with the tests to run, for pytest takes a lone folder as that of the tests."""
    arguments = []
    for option, (tests, name, document) in CASES.items():
        folder = tmp_path / option.strip("-")
        folder.mkdir()
        (folder / name).write_text(json.dumps(document), encoding="utf-8")
        arguments += [tests, option, str(folder)]
    collect = [sys.executable, "-m", "pytest", "--collect-only", "-q", "-n", "0", "-p", "no:cacheprovider"]

    done = subprocess.run(  # our own tests
        [*collect, *arguments], cwd=ROOT, capture_output=True, text=True, check=False
    )

    assert done.returncode == 0, done.stdout + done.stderr
    for tests, _, _ in CASES.values():
        ours = [line for line in done.stdout.splitlines() if line.startswith(tests) and "[of-ours" in line]
        assert ours, f"no test of the folder in {tests}"
