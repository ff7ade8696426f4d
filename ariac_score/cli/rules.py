"""`ariac-score rules list|show|validate`: the rule sets, and whether one is sound."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any


def register(commands: Any) -> None:
    """Add the command and its actions."""
    parser = commands.add_parser("rules", help="list, show and validate rule sets")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="the shipped rule sets")
    listing.set_defaults(run=run_list)
    show = actions.add_parser("show", help="the text of a rule set")
    show.add_argument("name", metavar="NAME")
    show.set_defaults(run=run_show)
    validate = actions.add_parser("validate", help="check a rule set and the plugins it names")
    validate.add_argument("names", metavar="NAME", nargs="+", help="names or .yaml files")
    validate.set_defaults(run=run_validate)


def run_list(_arguments: argparse.Namespace) -> int:
    """Print name and title of each shipped rule set."""
    from ariac_score.ruleset import load_rule_set, rule_set_names  # noqa: PLC0415  # keeps --help quick

    for name in rule_set_names():
        print(f"{name:<24} {load_rule_set(name).title}")
    return 0


def run_show(arguments: argparse.Namespace) -> int:
    """Print the rule set as it stands, comments included."""
    from ariac_score.ruleset import load_rule_set  # noqa: PLC0415  # keeps --help quick

    rule_set = load_rule_set(arguments.name)
    sys.stdout.write(Path(rule_set.file).read_text(encoding="utf-8"))
    return 0


def run_validate(arguments: argparse.Namespace) -> int:
    """Load each rule set, build its checks and load its log map."""
    from ariac_score.logmap import load_log_map  # noqa: PLC0415  # keeps --help quick
    from ariac_score.registry import Registry  # noqa: PLC0415
    from ariac_score.ruleset import load_rule_set  # noqa: PLC0415

    registry = Registry()
    for name in arguments.names:
        rule_set = load_rule_set(name)
        rule_set.build(registry)
        load_log_map(rule_set.log_map, beside=Path(rule_set.file).parent)
        unpriced = sorted(set(rule_set.checks) - rule_set.sheet.priced)
        remark = f"; not priced: {', '.join(unpriced)}" if unpriced else ""
        print(f"{rule_set.id}: sound, {len(rule_set.checks)} checks{remark}")
    return 0
