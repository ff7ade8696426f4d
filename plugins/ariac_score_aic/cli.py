"""`ariac-score aic competition`: list the recordings of engine runs, policy by policy, to be ranked."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ariac_score import NothingToScoreError, UsageError, write_output
from ariac_score_aic.bag import AicBagReader
from ariac_score_aic.competition import trial_in_name

_NAMES = "results/<policy>/<run>/bag_<trial>_<date>_<time>_<ms>"


def register(commands: Any) -> None:
    """Add the command and its action."""
    parser = commands.add_parser("aic", description="What the AI for Industry Challenge needs beside.")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listed = actions.add_parser(
        "competition",
        help="write a competition.yaml of the recordings below a folder",
        description="Of each folder directly below RESULTS a team (or policy) is made, of each recording in "
        f"it a run of its trial, in the order of their names, such as {_NAMES}; likewise of the "
        "recordings of the finals, <team>/final_eval/<trial>/<run>/*.mcap.",
    )
    listed.add_argument("results", type=Path, metavar="RESULTS")
    listed.add_argument(
        "--rules", default="aic2026.qualification", metavar="NAME", help="default: %(default)s"
    )
    listed.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="default: competition.yaml in RESULTS"
    )
    listed.add_argument(
        "--paired",
        action="store_true",
        help="runs in folders of the same name are of the same scene: each is a trial of its own, in which "
        "policies are compared; otherwise all runs of a trial are repetitions of it",
    )
    listed.set_defaults(run=run_competition)


def run_competition(args: argparse.Namespace) -> int:
    """Write the competition.

    Raises:
        UsageError: The folder is none, or the output lies outside of it.
        NothingToScoreError: No recording is below it.
    """
    root: Path = args.results
    if not root.is_dir():
        raise UsageError(f"{root} is no folder", hint=f"give the folder of all results: {_NAMES}")
    output: Path = args.output or root / "competition.yaml"
    if output.parent.resolve() != root.resolve():
        raise UsageError(f"{output} is not in {root}", hint="paths in a competition stay inside its folder")
    runs = list(_runs(root, paired=args.paired))
    if not runs:
        raise NothingToScoreError(
            "no recording lies in a folder of a folder", file=root, hint=f"such as {_NAMES}"
        )
    most = max(int(run["run"]) for run in runs)
    # JSON is YAML, and quotes whatever a folder is called.
    lines = [
        f"id: {json.dumps(''.join(c if c.isalnum() or c in '_.-' else '_' for c in root.resolve().name))}",
        f"rules: {json.dumps(args.rules)}",
        f"ranking: {{keep: {most}, missing_run: leave_out}} # the mean of all runs",
        "authority: {work: run} # our own runs: what was to be done says the configuration beside each",
        "runs:",
        *(f"  - {json.dumps(run)}" for run in runs),
    ]
    write_output("\n".join(lines) + "\n", output)
    return 0


def _runs(root: Path, *, paired: bool) -> Iterator[dict[str, str | int]]:
    reader, seen = AicBagReader(), Counter[tuple[str, str]]()
    for team in sorted(path for path in root.iterdir() if path.is_dir()):
        for bag in sorted(path for path in team.rglob("bag_*") if path.is_dir() and reader.can_read(path)):
            trial = trial_in_name(bag.name)
            if paired:
                between = bag.relative_to(team).parent.parts
                trial = ".".join((*between, trial))
            seen[team.name, trial] += 1
            path = bag.relative_to(root).as_posix()
            yield {"team": team.name, "trial": trial, "run": seen[team.name, trial], "path": path}
        # The finals: one recording for each cable, so each is a trial of its own.
        for file in sorted(team.glob("final_eval/*/*/*.mcap")):
            trial = ".".join((*file.relative_to(team / "final_eval").parent.parts, file.stem))
            yield {"team": team.name, "trial": trial, "run": 1, "path": file.relative_to(root).as_posix()}
