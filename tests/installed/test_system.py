"""What differs between operating systems is asked in one place, and what one of them lacks is said."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from ariac_score.cli import main
from ariac_score.installed import system

ROOT = Path(__file__).parents[2]
LOG = ROOT / "examples/kitting_near_miss.mcap"

Run = Callable[..., subprocess.CompletedProcess[str]]

LACKED_BY_SOME = {"fcntl", "resource", "msvcrt", "termios", "pwd", "grp", "pty", "_posixsubprocess"}
"""Modules that the documentation of Python calls available on some systems only."""

LACKING = """
import multiprocessing, os, signal, sys
for name in ("fcntl", "resource", "termios", "pwd", "grp", "pty"):
    sys.modules[name] = None
for module, names in ((os, ("killpg", "pread", "preadv", "pwrite", "sched_getaffinity", "memfd_create")),
                      (signal, ("SIGALRM", "SIGHUP", "setitimer"))):
    for name in names:
        if hasattr(module, name):
            delattr(module, name)
multiprocessing.get_all_start_methods = lambda: ["spawn"]
"""
"""What Windows has not, taken away when Python starts, in every process that is started later as well."""


START = "import sys; from ariac_score.cli import main; sys.exit(main(sys.argv[1:]))"


@pytest.fixture
def as_on_windows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run a command in a Python that lacks it."""
    (tmp_path / "site").mkdir()
    (tmp_path / "site/sitecustomize.py").write_text(LACKING, encoding="ascii")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "site"))

    def run(*command: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [
                sys.executable,
                "-c",
                "import sys; from ariac_score.cli import main; sys.exit(main(sys.argv[1:]))",
                *command,
            ],
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    return run


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["ariac_score", "plugins"])
def test_no_other_module_imports_what_some_systems_lack(folder: str) -> None:
    found = [
        f"{file.relative_to(ROOT)}: {name}"
        for file in sorted((ROOT / folder).rglob("*.py"))
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        for name in imported(node)
        if name in LACKED_BY_SOME
    ]
    assert found == []


def imported(node: ast.AST) -> list[str]:
    if isinstance(node, ast.Import):
        return [alias.name.partition(".")[0] for alias in node.names]
    if isinstance(node, ast.ImportFrom):
        return [(node.module or "").partition(".")[0]]
    return []


@pytest.mark.slow
def test_a_log_is_scored_alike_without_them(as_on_windows: Run, capsys: pytest.CaptureFixture[str]) -> None:
    scored = as_on_windows("score", str(LOG), "--rules", "paper2020.published")

    assert main(["score", str(LOG), "--rules", "paper2020.published"]) == scored.returncode == 0
    assert scored.stdout == capsys.readouterr().out


@pytest.mark.slow  # processes that import everything
def test_a_batch_is_scored_without_them_and_says_what_it_cannot_keep(
    as_on_windows: Run, tmp_path: Path
) -> None:
    logs = tmp_path / "logs"
    logs.mkdir()
    for name in ("one", "two"):
        (logs / f"{name}.mcap").write_bytes(LOG.read_bytes())

    done = as_on_windows("batch", str(logs), "--rules", "paper2020.published", "-o", str(tmp_path / "out"))

    assert done.returncode == 0, done.stderr
    assert "2 runs: 2 scored" in done.stdout
    assert "--memory-mb is not kept" in done.stderr


def test_a_file_is_read_alike_from_anywhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "ten"
    file.write_bytes(b"0123456789")
    monkeypatch.delattr(os, "preadv", raising=False)

    with file.open("rb") as opened:
        opened.read(3)
        room = bytearray(4)
        assert system.read_at(opened, memoryview(room), 8) == 2  # as the file ends there
        assert system.read_at(opened, memoryview(room), 2) == 4
        assert bytes(room) == b"2345"
        assert opened.read(1) == b"3"  # who reads on is not disturbed


def test_one_process_at_a_time_has_a_lock(tmp_path: Path) -> None:
    place = tmp_path / "lock"
    with place.open("w") as first, place.open("w") as second:
        assert system.lock(first)
        assert not system.lock(second)
    with place.open("w") as third:
        assert system.lock(third)


LEAVES_CHILDREN = """
import os, sys, time
from ariac_score.installed.system import adopt_orphans, end_children
adopt_orphans()
begun, begins = os.pipe()
kept = os.fork()
if kept == 0:
    time.sleep(600)
ended = os.fork()
if ended == 0:
    os.setsid()
    if os.fork() == 0:
        os.setsid()
        if os.fork() == 0:
            os.setsid()
            os.write(begins, b'.')
        time.sleep(600)
    os._exit(0)
os.waitpid(ended, 0)
os.read(begun, 1)
end_children(os.getpid(), ended, [kept], 10.0)
os.kill(kept, 0)
os.kill(kept, 9)
os.waitpid(kept, 0)
codes = []
try:
    while True:
        codes.append(os.waitpid(-1, 0)[1])
except ChildProcessError:
    print(codes)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux finds what left its session")
def test_what_a_process_leaves_behind_ends_though_it_left_its_session_and_what_goes_on_stays() -> None:
    command = [sys.executable, "-c", LEAVES_CHILDREN]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)

    assert ended.stdout == "[9, 9]\n", ended.stderr
