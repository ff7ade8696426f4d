"""`python -m ariac_score.testing FILE`: write the example trial in the format of the file's suffix."""

from __future__ import annotations

import argparse
from pathlib import Path

from ariac_score.testing.bags import Storage, write_bag
from ariac_score.testing.rosmonitoring import write_event_log
from ariac_score.testing.trials import SNAPSHOT_SIGNALS, kitting_trial, recorded_messages, write_trial_log

_STORAGE: dict[str, Storage] = {".bag": "ros1", ".mcap": "mcap", ".db3": "sqlite3"}


def main() -> None:
    """Write one file, or a rosbag2 folder with `--storage`."""
    parser = argparse.ArgumentParser(prog="python -m ariac_score.testing", description=__doc__)
    parser.add_argument("path", type=Path, help="x.mcap, x.bag, x.db3, x.jsonl; or a folder, with --storage")
    parser.add_argument(
        "--storage", choices=("mcap", "sqlite3"), help="write a rosbag2 folder of this storage"
    )
    parser.add_argument("--motion", choices=("snapshot", "human_state", "frames"), default="snapshot")
    parser.add_argument(
        "--events", action="store_true", help="with x.jsonl: an event log of ROSMonitoring, not a trial log"
    )
    parser.add_argument("--seed", type=int, default=2020)
    arguments = parser.parse_args()
    path, trial = arguments.path, kitting_trial(seed=arguments.seed)
    if path.suffix == ".jsonl" and arguments.events:
        write_event_log(path, recorded_messages(trial, motion=arguments.motion))
        return
    if path.suffix == ".jsonl":
        write_trial_log(path, trial, signals=SNAPSHOT_SIGNALS)
        return
    storage: Storage | None = arguments.storage or _STORAGE.get(path.suffix)
    if storage is None:
        parser.error(f"no format goes with the suffix {path.suffix!r}; give --storage for a rosbag2 folder")
    write_bag(path, recorded_messages(trial, motion=arguments.motion), storage=storage)


if __name__ == "__main__":
    main()
