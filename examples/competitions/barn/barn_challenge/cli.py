"""`ariac-score barn report`: what `out.txt` says of many runs, as the organisers report it."""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ariac_score import NothingToScoreError
from barn_challenge.readers import Outcome, outcomes

__all__ = ["register"]


def register(commands: Any) -> None:
    """Add the command to those of `ariac-score`."""
    parser = commands.add_parser("barn", description="Report the runs that run.py wrote to out.txt.")
    inner = parser.add_subparsers(required=True)
    report = inner.add_parser("report", description="Means over worlds, as report_test.py prints them.")
    report.add_argument("file", type=Path, metavar="OUT.TXT")
    report.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print the means; the mean time is that of successful runs."""
    if not arguments.file.is_file():
        raise NothingToScoreError("there is no such file", file=arguments.file, hint="run.py --out writes it")
    print(report(list(outcomes(arguments.file))))
    return 0


def report(runs: Sequence[Outcome]) -> str:
    """The means over worlds of the means over their runs, so that each world counts as much.

    >>> report([Outcome(0, True, False, False, 10.0, 0.5), Outcome(0, False, True, False, 4.0, 0.0)])
    'Avg Time: 10.0000, Avg Metric: 0.2500, Avg Success: 0.5000, Avg Collision: 0.5000, Avg Timeout: 0.0000'
    """
    worlds: dict[int, list[Outcome]] = defaultdict(list)
    for each in runs:
        worlds[each.world].append(each)
    times = [_mean(r.time_s for r in of if r.success) for of in worlds.values() if any(r.success for r in of)]
    values = {
        "Time": _mean(times) if times else float("nan"),
        "Metric": _mean(_mean(r.nav_metric for r in of) for of in worlds.values()),
        "Success": _mean(_mean(r.success for r in of) for of in worlds.values()),
        "Collision": _mean(_mean(r.collided for r in of) for of in worlds.values()),
        "Timeout": _mean(_mean(r.timeout for r in of) for of in worlds.values()),
    }
    return ", ".join(f"Avg {name}: {value:.4f}" for name, value in values.items())


def _mean(values: Iterable[float]) -> float:
    all_values = list(values)
    return sum(all_values) / len(all_values)
