"""`ariac-score annotate LOG RESULT -o out.mcap`: a recording to open together with the log."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.cli.notes import note
from ariac_score.cli.stored import result_given
from ariac_score.engine.prepared import prepare
from ariac_score.review.annotate import messages_of, without_margins
from ariac_score.review.annotation_messages import recorded
from ariac_score.review.margins import read_again, tracks
from ariac_score.scoring.ruleset import load_rule_set, rule_set_from_text
from ariac_score.terminal.output import refuse_inputs, write_copy


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "annotate",
        description="Write a ROS 2 recording (MCAP) to open with the log in Foxglove, PlotJuggler or "
        "RViz: state and margin of every monitor, violations as markers, and messages, on the log's clock.",
    )
    parser.add_argument("path", type=Path, metavar="LOG", help="the log or bundle the result was made from")
    parser.add_argument("result", type=Path, metavar="RESULT", help="JSON written by 'score -o FILE.json'")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="the .mcap to write")
    parser.add_argument(
        "--rules", default="", metavar="NAME", help="rule set instead of the one in the result"
    )
    parser.add_argument("--log-map", default="", metavar="NAME", help="log map instead of the rule set's own")
    add_local_plugins(parser)
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Read the log again, run the monitors, write."""
    for source in (arguments.path, arguments.result):
        refuse_inputs(arguments.output, source)
    result = result_given(arguments.result, "annotate LOG")
    rule_set = (
        load_rule_set(arguments.rules)
        if arguments.rules
        else rule_set_from_text(result.rules, file="the rules in the result")
    )
    prepared = prepare(rule_set, log_map=arguments.log_map, registry=registry_of(arguments))
    trial = read_again(result, arguments.path, prepared)
    found = tracks(result, trial, prepared)
    with recorded(messages_of(result, trial, found, frame=prepared.log_map.root_frame)) as recording:
        write_copy(recording, arguments.output)
    bare = without_margins(found)
    if bare:
        words = "notice: these monitors have a margin only where findings begin and end"
        note(arguments, f"{words}: {', '.join(bare)}")
    return 0
