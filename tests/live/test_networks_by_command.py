"""`ariac-score watch` of each network source, ended in each way, says what `score` says of its recording."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent))
from live_servers import recorded, sending
from test_dds import cell as dds_cell
from test_foxglove import bridge
from test_rosbridge import stand_in
from test_zenoh import _key, cell

pytestmark = [pytest.mark.slow, pytest.mark.timeout(120)]

PROGRAM = Path(sys.executable).with_name("ariac-score")


def _foxglove(servers: ExitStack) -> Any:
    one = servers.enter_context(bridge())
    for message in recorded():
        one.offer(message.connection)
    return one


def _zenoh(servers: ExitStack) -> Any:
    one = servers.enter_context(cell())
    for message in recorded():
        one.offer(_key(message))
    return one


def _dds(servers: ExitStack) -> Any:
    one = servers.enter_context(dds_cell())
    one.offer_all(recorded())
    return one


def _rosbridge(servers: ExitStack) -> Any:
    return servers.enter_context(stand_in())


@pytest.mark.parametrize("end", ["Ctrl-C", "the source is gone"])
@pytest.mark.parametrize(
    "serve", [_foxglove, _rosbridge, _zenoh, _dds], ids=["foxglove", "rosbridge", "zenoh", "dds"]
)
def test_watch_ends_with_what_score_says(serve: Callable[[ExitStack], Any], end: str, tmp_path: Path) -> None:
    seen, watched, scored = (tmp_path / name for name in ("seen.mcap", "watched.json", "scored.json"))
    rules = ("--rules", "paper2020")
    messages = recorded()
    sent = messages[: len(messages) // 2]
    with ExitStack() as servers:
        server = serve(servers)
        servers.enter_context(sending(server.subscribed, server.send, sent))
        program = [PROGRAM, "watch", server.address, *rules, "--record", seen, "-o", watched]
        process = subprocess.Popen(
            [*map(str, program), "--patience-s", "1"], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL
        )
        try:
            _until_silent(seen)
            if end == "Ctrl-C":
                process.send_signal(signal.SIGINT)
            if end == "the source is gone":
                servers.close()
            _, said = process.communicate(timeout=60)
        finally:
            process.kill()
    assert (b"interrupted" if end == "Ctrl-C" else b"the source was gone for 1 s") in said
    assert process.returncode in (0, 1, 6), said
    again = subprocess.run(
        [str(PROGRAM), "score", str(seen), *rules, "-o", str(scored)],
        capture_output=True,
        check=False,
        timeout=60,
    )
    assert again.returncode == process.returncode
    assert watched.read_bytes() == scored.read_bytes()


def _until_silent(seen: Path) -> None:
    """Wait until the recording has grown, and then does not for a while."""
    size, since_s, end_s = 0, time.monotonic(), time.monotonic() + 40
    while time.monotonic() < end_s:
        now = seen.stat().st_size if seen.exists() else 0
        if now != size:
            size, since_s = now, time.monotonic()
        if size > 50_000 and time.monotonic() - since_s > 2.5:
            return
        time.sleep(0.05)
    pytest.fail(f"{seen} did not come to rest")
