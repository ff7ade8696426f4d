"""`ariac-score score PATH --rules NAME`: score a trial."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from ariac_score.cli.apart import is_apart, run_apart
from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.cli.notes import is_quiet
from ariac_score.cli.outcome import add_output, show
from ariac_score.cli.partial import add_partial
from ariac_score.cli.trial_config import add_trial_config
from ariac_score.engine.price import reprice
from ariac_score.engine.score import score_trial
from ariac_score.results.cohort_file import Cohort, load_cohort
from ariac_score.results.result import Result
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.ruleset import RuleSet, load_rule_set
from ariac_score.terminal.output import progress_bar, refuse_inputs

MOST_JOBS = 64


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "score",
        description="Score a trial: a log, a rosbag2 folder, a folder with all its logs, or a bundle.yaml.",
    )
    parser.add_argument(
        "path", type=Path, metavar="PATH", help="log, bag folder, bundle folder or bundle.yaml"
    )
    parser.add_argument(
        "--rules", required=True, metavar="NAME", help="rule set: a name ('rules list') or a .yaml file"
    )
    parser.add_argument("--log-map", default="", metavar="NAME", help="log map instead of the rule set's own")
    add_trial_config(parser)
    add_partial(parser)
    add_local_plugins(parser)
    add_cohort(parser)
    parser.add_argument(
        "--jobs",
        type=_jobs,
        default=0,
        metavar="N",
        help="threads that read a recording; 0: one for each processor (default); the result is the same",
    )
    parser.add_argument(
        "--time-limit-s",
        type=_time_limit,
        default=0.0,
        metavar="S",
        help="score in a process of its own, in which no call of a plugin may last so long: "
        "what hangs or kills it is named",
    )
    add_output(parser)
    parser.set_defaults(run=run)


def _time_limit(text: str) -> float:
    try:
        limit_s = float(text)
    except ValueError:
        limit_s = 0.0
    if not 0 < limit_s < math.inf:
        raise argparse.ArgumentTypeError(f"{text!r} is no positive number of seconds")
    return limit_s


def _jobs(text: str) -> int:
    if not text.isascii() or not text.isdigit() or int(text) > MOST_JOBS:
        raise argparse.ArgumentTypeError(f"{text!r} is no number of threads from 0 to {MOST_JOBS}")
    return int(text)


def add_cohort(parser: argparse.ArgumentParser) -> None:
    """Add the options for the values across teams."""
    parser.add_argument(
        "--cohort",
        type=Path,
        metavar="FILE",
        help="cohort.json of the organisers, for rules that compare teams",
    )
    parser.add_argument(
        "--cohort-trial", default="", metavar="NAME", help="trial of the cohort, where it is not clear which"
    )


def run(arguments: argparse.Namespace) -> int:
    """Score and show; the exit code is 0 if there is a score."""
    for given in (arguments.path, *arguments.trial_config):
        refuse_inputs(arguments.output, given)
    if arguments.time_limit_s and not is_apart():
        return run_apart(arguments.given, limit_s=arguments.time_limit_s)
    rule_set = load_rule_set(arguments.rules)
    cohort = load_cohort_of(arguments, rule_set)
    with progress_bar(arguments.path, quiet=is_quiet(arguments)) as progress:
        result = score_trial(
            arguments.path,
            rule_set,
            log_map=arguments.log_map,
            also=arguments.trial_config,
            registry=registry_of(arguments),
            progress=progress,
            jobs=arguments.jobs,
            partial=bool(arguments.partial),
        )
    if cohort is not None:
        result = reprice(result, rule_set, values_of(cohort, arguments, result))
    return show(result, arguments)


def load_cohort_of(arguments: argparse.Namespace, rule_set: RuleSet) -> Cohort | None:
    """The cohort that the arguments name, if any."""
    return None if arguments.cohort is None else load_cohort(arguments.cohort, rule_set)


def values_of(cohort: Cohort, arguments: argparse.Namespace, result: Result) -> CohortValues:
    """The values for the trial that the arguments name, or for that of the result."""
    if arguments.cohort_trial:
        return cohort.of_trial(arguments.cohort_trial)
    return cohort.of_trial(result.measured.trial, result.measured)
