"""What commands do with a result: show it, and return the exit code for it."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from decimal import Decimal
from pathlib import Path

from ariac_score.checks.findings import Verdict
from ariac_score.engine.ask import ONLY_OFFICIAL
from ariac_score.errors import UsageError, did_you_mean
from ariac_score.report.exports import export_names, exported
from ariac_score.report.openness import adjusted_sentence, narrowing_text, open_sentence, undecided_text
from ariac_score.report.text import score_text
from ariac_score.results.adjustments import interval_that_counts
from ariac_score.results.result import Result
from ariac_score.results.result_file import as_json
from ariac_score.review.readiness import taking_the_official_text
from ariac_score.scoring.steward import with_verdicts
from ariac_score.terminal.output import write
from ariac_score.terminal.style import Style, plain, style_for

__all__ = ["FORMAT_HELP", "add_output", "exit_code_of", "failed_criteria", "show"]

EXIT_CRITERION = 1
EXIT_UNDECIDED = 6
MOST_NAMED = 4
"""More findings that one cause leaves undecided share a line."""
FORMAT_HELP = "default: text; json for -o FILE.json"
"""Which of both is the default says `ariac_score.cli.main`."""
OWN_FORMATS = ("text", "json")
_CRITERION = re.compile(
    r"(?P<what>violation|unknown)(:(?P<check>\w+))?|score<(?P<limit>-?\d+(\.\d+)?)", re.ASCII
)


def add_output(parser: argparse.ArgumentParser) -> None:
    """Add the options for how a result is shown, and when it fails."""
    parser.add_argument(
        "--output-format",
        choices=(*OWN_FORMATS, *export_names()),
        help=FORMAT_HELP,
    )
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write to FILE instead of stdout")
    parser.add_argument(
        "--fail-on",
        action="append",
        type=_criterion,
        default=[],
        metavar="WHAT",
        help="exit with 1 on 'violation', 'unknown', 'violation:CHECK', 'unknown:CHECK' or 'score<X'; "
        "repeatable",
    )


def _criterion(text: str) -> str:
    if _CRITERION.fullmatch(text) is None:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not violation, unknown, violation:CHECK, unknown:CHECK or 'score<X'"
        )
    return text


def show(result: Result, arguments: argparse.Namespace) -> int:
    """Print or write a result, and on stderr what its log leaves open and which criteria fail."""
    failed = failed_criteria(result, arguments.fail_on)  # first: one that is misspelt prints nothing else
    write(_shown(result, arguments), arguments.output)
    in_text = arguments.output_format == "text" and arguments.output is None
    # On a terminal both would stand below each other.
    return exit_code_of(result, failed, told=in_text and sys.stdout.isatty() and sys.stderr.isatty())


def exit_code_of(result: Result, failed: Sequence[str], *, told: bool = False) -> int:
    """Say on stderr what the log of a result leaves open and which criteria failed; the exit code for it.

    Args:
        result: The result.
        failed: The criteria.
        told: Whether the reader sees what is open already.
    """
    for criterion in failed:
        print(f"failed: {criterion}", file=sys.stderr)
    if _is_open(result):
        _print_what_is_open(result, told=told)
        return EXIT_UNDECIDED
    return EXIT_CRITERION if failed else 0


def _is_open(result: Result) -> bool:
    """Whether the score that counts is not one number."""
    return result.final is None or (
        result.is_open if result.adjusted is None else interval_that_counts(result) is not None
    )


def _shown(result: Result, arguments: argparse.Namespace) -> str:
    if arguments.output_format == "json":
        return as_json(result)
    if arguments.output_format == "text":
        return score_text(result, Style() if arguments.output else style_for(sys.stdout))
    return exported(result, arguments.output_format)


def _print_what_is_open(result: Result, *, told: bool) -> None:
    interval = interval_that_counts(result)
    narrowing = () if interval is None else interval.narrowing
    withheld: dict[str, list[str]] = {}
    for assumption in result.assumptions:
        if assumption.policy == "withhold":
            withheld.setdefault(undecided_text(result, assumption), []).append(assumption.finding)
    for message, found in withheld.items() if not narrowing and not told else ():  # that names them together
        for named in found if len(found) <= MOST_NAMED else [_and_more(found)]:
            print(f"undecided: {named}: {plain(message)}", file=sys.stderr)
    if ONLY_OFFICIAL in withheld:
        others = taking_the_official_text(result)
        if others:
            names = " or ".join(others)
            print(f"hint: {names} takes what the official text prints: --rules {others[0]}", file=sys.stderr)
    if interval is not None and (narrowing or not withheld) and not told:
        print(f"undecided: {adjusted_sentence(result) or open_sentence(result)}", file=sys.stderr)
        for cause in narrowing[:MOST_NAMED]:
            print(f"undecided: {plain(narrowing_text(cause))}", file=sys.stderr)
    for what in result.measured.unrecorded if _is_open(result) and not told else ():
        print(f"not recorded: {plain(what)}", file=sys.stderr)
    if result.missing:
        print(f"{result.status}: {plain(result.missing)}", file=sys.stderr)
    if result.status == "needs_cohort":
        print("hint: give the organisers' cohort with --cohort, or rank all teams", file=sys.stderr)


def _and_more(found: list[str]) -> str:
    return f"{', '.join(found[: MOST_NAMED - 1])} and {len(found) - MOST_NAMED + 1} more"


def failed_criteria(result: Result, criteria: list[str]) -> list[str]:
    """The criteria that a result fails, each with the reason; decisions of stewards count.

    Raises:
        UsageError: A criterion names a check that the rules do not have.
    """
    failed = []
    for text in dict.fromkeys(criteria):
        match = _CRITERION.fullmatch(text)
        assert match is not None  # the option takes nothing else
        if match["limit"] is not None:
            if result.final is not None and result.final < Decimal(match["limit"]):
                failed.append(f"{text}: it is {result.final:f}")
            continue
        if match["check"] and match["check"] not in result.checks:
            raise UsageError(
                f"--fail-on {text}: the rules have no check {match['check']!r}",
                hint=did_you_mean(match["check"], result.checks),
            )
        verdict = Verdict.VIOLATED if match["what"] == "violation" else Verdict.INCONCLUSIVE
        found = _found(result, verdict, match["check"] or "")
        if found:
            more = f" and {len(found) - 3} more" if len(found) > 3 else ""
            failed.append(f"{text}: {', '.join(found[:3])}{more}")
    return failed


def _found(result: Result, verdict: Verdict, check: str) -> list[str]:
    """The findings with a verdict, after the decisions of stewards."""
    findings = result.measured.findings
    if result.adjusted is not None:
        findings = with_verdicts(findings, result.adjusted.adjustments)
    return [key for key, f in findings.items() if f.verdict is verdict and check in ("", f.check)]
