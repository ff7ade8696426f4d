"""`ariac-score audit PATH`: the official score compared with the log, and with itself."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from ariac_score.checks.registry import Registry
from ariac_score.cli.notes import is_quiet
from ariac_score.cli.outcome import FORMAT_HELP
from ariac_score.errors import UsageError
from ariac_score.logs.rosmonitoring import RosMonitoringReader
from ariac_score.oracle.judges import RulesBench
from ariac_score.oracle.replay import replay, replay_text
from ariac_score.report.audit_text import audit_text
from ariac_score.review.audit import AUDIT, audit
from ariac_score.scoring.ruleset import load_rule_set
from ariac_score.terminal.output import progress_bar, refuse_inputs, write
from ariac_score.terminal.style import Style, plain, style_for

EXIT_DIFFERS = 1


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "audit",
        description="Compute every number that the official scorer printed again from the log, and check "
        "that its numbers add up. Exit code 1: something differs or does not add up.",
    )
    parser.add_argument(
        "path", type=Path, metavar="PATH", help="bundle folder or log with the official scorer's text"
    )
    parser.add_argument(
        "--rules", default="", metavar="NAME", help="rule set; default: the one of the text's layout"
    )
    parser.add_argument(
        "--against",
        default="",
        metavar="NAME",
        help="list the differences to this rule set, too; default: those that declare how they differ",
    )
    parser.add_argument("--output-format", choices=("text", "json"), help=FORMAT_HELP)
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write to FILE instead of stdout")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Audit and show; the exit code is 0 if everything that can be judged agrees."""
    refuse_inputs(arguments.output, arguments.path)
    if RosMonitoringReader().can_read(arguments.path):
        return _verdicts(arguments)
    with progress_bar(arguments.path, quiet=is_quiet(arguments)) as progress:
        audited = audit(arguments.path, arguments.rules, against=arguments.against, progress=progress)
    if arguments.output_format == "json":
        write(AUDIT.text(audited), arguments.output)
    else:
        style = Style() if arguments.output else style_for(sys.stdout)
        write(audit_text(audited, style), arguments.output)
    return EXIT_DIFFERS if audited.differs else 0


def _verdicts(arguments: argparse.Namespace) -> int:
    """Compare the verdicts in a log of ROSMonitoring with ours."""
    if not arguments.rules or arguments.against or arguments.output_format != "text":
        raise UsageError(
            "the verdicts of monitors are compared as text, under one rule set",
            file=arguments.path,
            hint="give --rules NAME; --against and JSON are for official texts",
        )
    found = replay(arguments.path, RulesBench(load_rule_set(arguments.rules), Registry()))
    text = replay_text(found)
    write(text if arguments.output else "\n".join(map(plain, text.splitlines())) + "\n", arguments.output)
    return EXIT_DIFFERS if found.differences else 0
