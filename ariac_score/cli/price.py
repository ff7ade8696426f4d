"""`ariac-score price RESULT --rules NAME`: price a stored result again, without its log."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ariac_score.cli.notes import note
from ariac_score.cli.outcome import add_output, show
from ariac_score.cli.score import add_cohort, load_cohort_of, values_of
from ariac_score.cli.stored import result_given
from ariac_score.engine.price import reprice
from ariac_score.results.result_file import refuse_impossible
from ariac_score.scoring.ruleset import load_rule_set
from ariac_score.terminal.output import refuse_inputs


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "price",
        description="Price a stored result under other rules. Only prices may differ: every check of the "
        "rule set must have been measured with the same parameters.",
    )
    parser.add_argument("result", type=Path, metavar="RESULT", help="JSON written by 'score -o FILE.json'")
    parser.add_argument("--rules", required=True, metavar="NAME", help="rule set: a name or a .yaml file")
    add_cohort(parser)
    add_output(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Load, price, show; the same output and exit codes as `score`."""
    refuse_inputs(arguments.output, arguments.result)
    stored = result_given(arguments.result, "price")
    refuse_impossible(stored, arguments.result)
    rule_set = load_rule_set(arguments.rules)
    cohort = load_cohort_of(arguments, rule_set)
    values = None if cohort is None else values_of(cohort, arguments, stored)
    again = reprice(stored, rule_set, values)
    if stored.adjusted is not None:
        words = "decisions of stewards do not carry over to other prices: apply them again with 'adjust'"
        note(arguments, words)
    if arguments.output_format == "text" and stored.score is not None and again.score is not None:
        note(arguments, f"before, under {stored.provenance.rule_set.id}: {stored.score:f}")
    return show(again, arguments)
