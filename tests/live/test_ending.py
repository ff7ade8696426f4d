"""Ctrl-C ends what is watched within two seconds, whoever looks on."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from live_servers import until

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="counts processor time as Linux does"),
]

EXAMPLE = Path(__file__).parents[2] / "examples" / "kitting_near_miss.mcap"
TIMEOUT_S = 60.0
WAITS_S = 0.5
"""For what is asked five times a second, in two processes, and for the last state that is shown."""


def with_children(pid: int) -> list[int]:
    found = [pid]
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        for child in task.read_text().split():
            found += with_children(int(child))
    return found


def processor_s(pid: int) -> float:
    """What a process has used, and what has ended below it, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def is_there(pid: int) -> bool:
    """Whether a process runs: of one that has ended, and that nobody has asked about, little is left."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0] not in "ZX"
    return False


def looks_on(port: int, number: int) -> socket.socket:
    """A viewer that asks for all that happens, and takes only the first word of it."""
    viewer = socket.socket()
    viewer.settimeout(TIMEOUT_S)
    viewer.bind((f"127.0.0.{1 + number // 100}", 0))  # one address may hold no more than half of the places
    viewer.connect(("127.0.0.1", port))
    viewer.sendall(f"GET /events HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
    assert viewer.recv(12) == b"HTTP/1.1 200"
    return viewer


@pytest.mark.parametrize("viewers", [1, 250])
def test_an_interrupt_ends_a_watch_within_two_seconds_however_many_look_on(viewers: int) -> None:
    command = [sys.executable, "-m", "ariac_score.cli", "watch", f"replay:{EXAMPLE}?speed=1"]
    command += ["--rules", "paper2020", "--serve", "127.0.0.1:0"]
    with (
        subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process,
        ExitStack() as end,
    ):
        end.callback(process.kill)
        assert process.stderr is not None
        address = next(filter(None, (re.search(r"http://127.0.0.1:(\d+)/", line) for line in process.stderr)))
        for number in range(viewers):
            end.enter_context(looks_on(int(address[1]), number))
        first = end.enter_context(looks_on(int(address[1]), viewers))
        with first.makefile("rb") as lines:
            assert any(b'"least"' in line for line in lines)  # a score: the order is there
        late = end.enter_context(socket.create_connection(("127.0.0.1", int(address[1]))))
        late.sendall(b"GET / HTTP/1.1\r\n")  # and never the rest
        before_s, began_s = sum(map(processor_s, with_children(process.pid))), time.monotonic()
        killer = threading.Timer(TIMEOUT_S, process.kill)
        killer.start()
        os.kill(process.pid, signal.SIGINT)
        said = process.stderr.read()
        _, status, used = os.wait4(process.pid, 0)
        took_s = time.monotonic() - began_s
        killer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)

    assert "ended: it was interrupted" in said
    assert process.returncode == 6  # of a trial that was cut off
    # On a machine that has other things to do: what it works, and what it waits for.
    assert min(took_s, used.ru_utime + used.ru_stime - before_s + WAITS_S) < 2.0


def test_who_watches_ends_when_whoever_shows_it_is_killed_though_nothing_comes() -> None:
    command = [sys.executable, "-m", "ariac_score.cli", "watch", f"replay:{EXAMPLE}?speed=0.000001"]
    command += ["--rules", "paper2020", "--serve", "127.0.0.1:0"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        assert any("0:00" in line for line in process.stderr)  # who watches has begun
        watching = with_children(process.pid)[1:]
        assert watching
        process.kill()
        process.wait(TIMEOUT_S)
        until(lambda: not any(map(is_there, watching)), "all that it started have ended")
