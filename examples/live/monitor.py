"""Stands in for a monitor that ROSMonitoring generates: sends a log to an oracle, event by event.

    python examples/live/monitor.py events.jsonl ws://127.0.0.1:8080

One event is outstanding at a time, as there; what was answered is counted and printed,
with the first event of each negative answer. Needs `websocket-client`, as the nodes do.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from pathlib import Path

try:
    import websocket
except ModuleNotFoundError:
    sys.exit("error: the library `websocket` is not installed\nhint: pip install websocket-client")

NEGATIVE = ("false", "currently_false", "violation", "violated")


def main(log: Path, url: str) -> None:
    client = websocket.create_connection(url, timeout=10.0)
    verdicts: Counter[str] = Counter()
    for line in log.read_text(encoding="utf-8").splitlines():
        client.send(line)
        reply = json.loads(client.recv())
        verdict = str(reply["verdict"])
        if verdict in NEGATIVE and verdict not in verdicts:
            print(f"{reply['topic']} at {reply['time']} s: {verdict}: {reply['spec']}")
        verdicts[verdict] += 1
    client.close()
    print(", ".join(f"{count} {verdict}" for verdict, count in sorted(verdicts.items())))


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
