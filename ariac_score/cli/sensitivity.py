"""`ariac-score sensitivity RESULT|COMPETITION`: how score and ranks depend on the chosen numbers."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.cli.notes import note
from ariac_score.cli.outcome import FORMAT_HELP
from ariac_score.cli.stored import is_log, result_given
from ariac_score.errors import UsageError
from ariac_score.ranking.competition import Competition, load_competition, registry_for, stored_results
from ariac_score.ranking.runs import score_runs
from ariac_score.report.sensitivity import ranks_text, scores_text
from ariac_score.results.result import Result
from ariac_score.results.result_file import load_result
from ariac_score.review.sensitivity import (
    RankSensitivity,
    ScoreSensitivity,
    rank_sensitivity,
    score_sensitivity,
)
from ariac_score.review.sensitivity_file import sensitivity_json
from ariac_score.scoring.ruleset import RuleSet, load_rule_set, rule_set_from_text
from ariac_score.terminal.output import refuse_inputs, write


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "sensitivity",
        description="Vary each parameter and weight over its range ('ranges:' in the rules; else half to "
        "double) and show how the score of a result changes, or at which values ranks change.",
    )
    parser.add_argument(
        "path",
        type=Path,
        metavar="RESULT|COMPETITION",
        help="a stored result; or competition.yaml, its folder, or a folder of 'rank --results'",
    )
    parser.add_argument("--rules", default="", metavar="NAME", help="rule set instead of its own")
    parser.add_argument(
        "--log", type=Path, metavar="PATH", help="the log of the result, to vary parameters of monitors too"
    )
    add_local_plugins(parser)
    parser.add_argument("--output-format", choices=("text", "json"), help=FORMAT_HELP)
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write to FILE instead of stdout")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Vary, compare, show."""
    refuse_inputs(arguments.output, arguments.path)
    if arguments.path.suffix == ".json" or (arguments.path.is_file() and is_log(arguments.path)):
        scores, rule_set, of = _of_result(arguments)
        text = scores_text(scores, rule_set, of)
        data = sensitivity_json(scores, rule_set, of)
    else:
        ranks, rule_set, of = _of_competition(arguments)
        text = ranks_text(ranks, rule_set, of)
        data = sensitivity_json(ranks, rule_set, of)
    write(data if arguments.output_format == "json" else text, arguments.output)
    return 0


def _of_result(arguments: argparse.Namespace) -> tuple[list[ScoreSensitivity], RuleSet, str]:
    result = result_given(arguments.path, "sensitivity")
    if result.adjusted is not None:
        note(arguments, "this is the automatic score: decisions of stewards are not varied")
    rule_set = _rules(arguments, result)
    found = score_sensitivity(result, rule_set, registry=registry_of(arguments), log=arguments.log)
    return found, rule_set, result.measured.trial


def _of_competition(arguments: argparse.Namespace) -> tuple[list[RankSensitivity], RuleSet, str]:
    if arguments.log is not None:
        raise UsageError("--log is for a result", hint="drop it: a competition names the logs of its runs")
    competition = _competition(arguments)
    rule_set = load_rule_set(competition.rules) if competition.rules else _rules_of_stored(competition)
    if arguments.local_plugins:
        raise UsageError(
            "--local-plugins is for a result",
            hint="a competition names the files it allows, with their SHA-256, under 'local_plugins:'",
        )
    registry = registry_for(competition)
    results = score_runs(competition, rule_set, registry=registry)
    return rank_sensitivity(competition, rule_set, results, registry=registry), rule_set, competition.id


def _competition(arguments: argparse.Namespace) -> Competition:
    path = arguments.path
    if path.is_dir() and not (path / "competition.yaml").is_file():
        stored = stored_results(path)
        if stored.runs:
            return replace(stored, rules=arguments.rules)
    return load_competition(path, arguments.rules)


def _rules_of_stored(competition: Competition) -> RuleSet:
    first = competition.runs[0].path
    return rule_set_from_text(load_result(first).rules, file=str(first))


def _rules(arguments: argparse.Namespace, result: Result) -> RuleSet:
    if arguments.rules:
        return load_rule_set(arguments.rules)
    return rule_set_from_text(result.rules, file=str(arguments.path))
