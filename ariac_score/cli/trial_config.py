"""The option `--trial-config`: what the organiser states of a trial, whatever lies with the run."""

from __future__ import annotations

import argparse
from pathlib import Path

__all__ = ["add_trial_config"]


def add_trial_config(parser: argparse.ArgumentParser) -> None:
    """Add the option, which may be repeated."""
    parser.add_argument(
        "--trial-config",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="the organiser's configuration of the trial, which counts; a file of the run, or a log, that "
        "says something else is refused; repeatable, also for the set-up of the team",
    )
