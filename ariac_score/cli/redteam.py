"""`ariac-score redteam LOG --rules NAME`: search what scores more than the honest log."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.cli.notes import is_quiet, note
from ariac_score.cli.trial_config import add_trial_config
from ariac_score.errors import UsageError
from ariac_score.redteam.honest import Honest, honest_log
from ariac_score.redteam.search import DEFAULT_BUDGET, Exploit, Found, search
from ariac_score.redteam.tactics import TACTICS
from ariac_score.report.redteam import redteam_text
from ariac_score.scoring.ruleset import load_rule_set
from ariac_score.terminal.output import counting_bar, refuse_inputs

EXIT_EXPLOIT = 1
MOST_TRIES = 1_000_000


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "redteam",
        description="Be the adversary: doctor an honest log, or do worse, stop, or run again, and score each "
        "try like any log. Prints the cheapest that brings more than honesty, or what was tried. Exit code 1 "
        "where something works that the rules do not declare.",
    )
    parser.add_argument(
        "path", type=Path, metavar="LOG", help="a recording, or a folder with one and its configuration"
    )
    parser.add_argument(
        "--rules", required=True, metavar="NAME", help="rule set: a name ('rules list') or a .yaml file"
    )
    parser.add_argument("--log-map", default="", metavar="NAME", help="log map instead of the rule set's own")
    add_trial_config(parser)
    parser.add_argument(
        "--cohort",
        type=Path,
        metavar="FILE",
        help="cohort.json of the organisers, for rules that compare teams",
    )
    add_local_plugins(parser)
    parser.add_argument(
        "--budget",
        type=_number,
        default=DEFAULT_BUDGET,
        metavar="N",
        help=f"how often to try, each time a whole log; default: {DEFAULT_BUDGET}",
    )
    parser.add_argument(
        "--seed", type=_number, default=0, metavar="N", help="of what is tried by chance; default: 0"
    )
    parser.add_argument(
        "--tactic",
        action="append",
        default=[],
        choices=[tactic.name for tactic in TACTICS],
        metavar="NAME",
        help="try this alone, such as 'messages left out'; repeatable; the table names them",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE", help="write the doctored log of the first exploit"
    )
    parser.set_defaults(run=run)


def _number(text: str) -> int:
    if not text.isascii() or not text.isdigit() or int(text) > MOST_TRIES:
        raise argparse.ArgumentTypeError(f"{text!r} is no number from 0 to {MOST_TRIES}")
    return int(text)


def run(arguments: argparse.Namespace) -> int:
    """Search, show, and write the doctored log; 1 where something undeclared works."""
    refuse_inputs(arguments.output, arguments.path)
    rule_set = load_rule_set(arguments.rules)
    honest = honest_log(
        arguments.path,
        rule_set,
        log_map=arguments.log_map,
        also=arguments.trial_config,
        cohort=arguments.cohort,
        registry=registry_of(arguments),
    )
    _refuse_other_format(honest, arguments.output)
    with counting_bar("trying", arguments.budget, quiet=is_quiet(arguments)) as step:
        found = search(
            honest, budget=arguments.budget, seed=arguments.seed, tactics=arguments.tactic, progress=step
        )
    if arguments.output is not None:
        _write(found, arguments)
    print(redteam_text(found), end="")
    sys.stdout.flush()
    return EXIT_EXPLOIT if found.undeclared else 0


def _refuse_other_format(honest: Honest, output: Path | None) -> None:
    if output is not None and output.suffix != honest.copy.suffix:
        raise UsageError(
            f"the doctored log is of the format of the honest one, {honest.copy.suffix}",
            file=output,
            hint=f"give -o a name that ends in {honest.copy.suffix}",
        )


def _write(found: Found, arguments: argparse.Namespace) -> None:
    """Write what the first exploit hands in."""
    worth_writing = [one for one in found.exploits if _doctored(found, one)]
    if not worth_writing:
        note(arguments, "no doctored log is written: there is none that brings more")
        return
    log = _doctored(found, worth_writing[0])[0]
    log.write(arguments.output.with_suffix(""))
    note(arguments, f"wrote {arguments.output}: {worth_writing[0].says}")


def _doctored(found: Found, exploit: Exploit) -> list[Any]:
    return [log for log in exploit.logs if log is not found.honest.copy]
