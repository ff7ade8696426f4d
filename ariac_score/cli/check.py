"""`ariac-score check LOG --rules NAME`: can this log be scored, and what is missing?"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.cli.notes import is_quiet
from ariac_score.cli.partial import add_partial
from ariac_score.report.openness import open_sentence
from ariac_score.review.readiness import Readiness, check_log
from ariac_score.scoring.ruleset import load_rule_set
from ariac_score.terminal.output import progress_bar
from ariac_score.terminal.style import Style, plain, style_for

EXIT_UNDECIDED = 6
_LABELS = {
    "withholds": ("missing", "red"),
    "opens": ("open", "red"),
    "costs": ("costs", "yellow"),
    "nothing": ("same", "dim"),
}


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "check",
        description="Check whether a log can be scored, before it is submitted. Exit code 0: it can; 5: "
        "there is nothing to score; 6: it is damaged, or lacks something that the score depends on.",
    )
    parser.add_argument(
        "path", type=Path, metavar="LOG", help="log, bag folder, bundle folder or bundle.yaml"
    )
    parser.add_argument(
        "--rules", required=True, metavar="NAME", help="rule set: a name ('rules list') or a .yaml file"
    )
    parser.add_argument("--log-map", default="", metavar="NAME", help="log map instead of the rule set's own")
    add_partial(parser, "check a log that is cut off as far as it goes; its score would be unofficial")
    add_local_plugins(parser)
    parser.add_argument("--output-format", choices=("text", "json"), default="text", help="default: text")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Check and show; the exit code is 0 if it can be scored."""
    rule_set = load_rule_set(arguments.rules)
    with progress_bar(arguments.path, quiet=is_quiet(arguments)) as progress:
        found = check_log(
            arguments.path,
            rule_set,
            log_map=arguments.log_map,
            registry=registry_of(arguments),
            progress=progress,
            partial=bool(arguments.partial),
        )
    if arguments.output_format == "json":
        print(json.dumps(_data(found), indent=1, sort_keys=True))
    else:
        for line in _lines(found, arguments.path.name, style_for(sys.stdout)):
            print(line)
    return 0 if found.ready else EXIT_UNDECIDED


def _lines(found: Readiness, name: str, style: Style) -> Iterator[str]:
    under = f"under {found.result.provenance.rule_set.id}"
    if found.ready:
        yield style(plain(name), "bold") + style(f" can be scored {under}", "green")
    elif found.result.interval is not None and found.result.status == "scored":
        yield style(plain(name), "bold") + style(f" leaves its score open {under}", "red")
        yield f"  {'score':<9}{open_sentence(found.result).removeprefix('the score lies ')}"
    else:
        yield style(plain(name), "bold") + style(f" cannot be scored {under}", "red")
    for topics in found.missing:
        yield f"  {style('record   ', 'bold')}{plain(topics.words)}"
        yield f"           for {', '.join(topics.checks)}"
    # Checks that lack the same thing share a line.
    alike: dict[tuple[str, str, str], list[str]] = {}
    for lack in found.lacks:
        alike.setdefault((lack.effect, lack.cause, lack.remedy), []).append(lack.what)
    for (effect, cause, remedy), checks in alike.items():
        label, look = _LABELS[effect]
        yield f"  {style(f'{label:<9}', look)}{', '.join(checks)}: {plain(cause)}"
        if remedy:
            yield f"           {plain(remedy)}"
    yield f"  {style('decided  ', 'green')}{', '.join(found.decided) or 'nothing'}"
    for note in found.notes:
        yield f"  note     {plain(note)}"


def _data(found: Readiness) -> dict[str, Any]:
    return {
        "ready": found.ready,
        "rule_set": found.result.provenance.rule_set.id,
        "status": found.result.status,
        "unofficial": list(found.result.measured.unofficial),
        "lacks": [
            {"what": lack.what, "effect": lack.effect, "cause": lack.cause, "remedy": lack.remedy}
            for lack in found.lacks
        ],
        "missing_topics": [
            {"topics": list(one.topics), "need": "all" if one.all_of else "one", "checks": list(one.checks)}
            for one in found.missing
        ],
        "decided": list(found.decided),
        "notes": list(found.notes),
    }
