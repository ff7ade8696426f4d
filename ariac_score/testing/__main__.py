"""`python -m ariac_score.testing FILE`: write the example trial in the format of the file's suffix.

Recordings and event logs hold the messages of a competition, where its plugin offers them.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from ariac_score.checks.registry import Registry
from ariac_score.errors import PluginError
from ariac_score.testing.bags import Recorded, Storage, write_bag
from ariac_score.testing.recordings import RecordsTrials, recorded_messages
from ariac_score.testing.rosmonitoring import write_event_log
from ariac_score.testing.trial_log import write_trial_log
from ariac_score.testing.trials import SNAPSHOT_SIGNALS, near_miss_trial
from ariac_score.trial.model import Trial

_STORAGE: dict[str, Storage] = {".bag": "ros1", ".mcap": "mcap", ".db3": "sqlite3"}
_NONE = "none"


def main() -> None:
    """Write one file, or a rosbag2 folder with `--storage`."""
    recorders = _recorders()
    parser = _parser(recorders)
    arguments = parser.parse_args()
    path = arguments.path
    recorder = recorders.get(arguments.competition or "")
    example = getattr(recorder, "example_trial", None)
    trial = example(seed=arguments.seed) if example else near_miss_trial()
    if path.suffix == ".jsonl" and not arguments.events:
        write_trial_log(path, trial, signals=SNAPSHOT_SIGNALS)
        return
    try:
        messages = _messages(trial, recorders, arguments.competition, arguments.motion)
    except ValueError as refusal:
        parser.error(str(refusal))
    if path.suffix == ".jsonl":
        write_event_log(path, messages)
        return
    storage: Storage | None = arguments.storage or _STORAGE.get(path.suffix)
    if storage is None:
        parser.error(f"no format goes with the suffix {path.suffix!r}; give --storage for a rosbag2 folder")
    write_bag(path, messages, storage=storage)


def _parser(recorders: Mapping[str, RecordsTrials]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m ariac_score.testing", description=__doc__)
    parser.add_argument("path", type=Path, help="x.mcap, x.bag, x.db3, x.jsonl; or a folder, with --storage")
    parser.add_argument(
        "--storage", choices=("mcap", "sqlite3"), help="write a rosbag2 folder of this storage"
    )
    parser.add_argument(
        "--competition",
        choices=(*recorders, _NONE),
        # With several, whichever came first would depend on what else is installed.
        default=next(iter(recorders), _NONE) if len(recorders) < 2 else None,
        help=f"whose messages to record; {_NONE}: only those that belong to no competition",
    )
    motions = [f"{name}: {', '.join(recorder.motions)}" for name, recorder in recorders.items()]
    parser.add_argument(
        "--motion", help="how to record what moves" + (f" ({'; '.join(motions)})" if motions else "")
    )
    parser.add_argument(
        "--events", action="store_true", help="with x.jsonl: an event log of ROSMonitoring, not a trial log"
    )
    parser.add_argument("--seed", type=int, default=2020)
    return parser


def _recorders() -> dict[str, RecordsTrials]:
    """The installed competitions that offer recordings, by name."""
    registry, built = Registry(), {}
    for name in registry.names("ariac_score.competitions"):
        with suppress(PluginError):  # 'plugins doctor' names it
            built[name] = registry.find("ariac_score.competitions", name).build({})
    return {name: one for name, one in built.items() if isinstance(one, RecordsTrials)}


def _messages(
    trial: Trial, recorders: Mapping[str, RecordsTrials], competition: str | None, motion: str | None
) -> list[Recorded]:
    """The messages to record.

    Raises:
        ValueError: There is no such way to record what moves, or no competition is chosen among several.
    """
    if competition is None:
        raise ValueError(f"several competitions offer recordings; give --competition {'|'.join(recorders)}")
    if competition == _NONE:
        if motion is not None:
            raise ValueError("--motion is of the messages of a competition; leave it out, or name one")
        return recorded_messages(trial)
    recorder = recorders[competition]
    motion = motion or recorder.motions[0]
    if motion not in recorder.motions:
        raise ValueError(f"{competition} has no motion {motion!r}; it has {', '.join(recorder.motions)}")
    return recorder.recorded_messages(trial, motion=motion)


if __name__ == "__main__":
    main()
