"""`ariac-score verify RESULT`: check a stored result, alone or against its log."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ariac_score.cli.notes import counted
from ariac_score.cli.prove import verify_certificate
from ariac_score.cli.stored import not_a_log
from ariac_score.cli.trial_config import add_trial_config
from ariac_score.errors import UsageError
from ariac_score.review.proofs.certificate import certificate_in
from ariac_score.review.steps import FAILED, OPEN, Verification
from ariac_score.review.verify import is_ranking, verify_result
from ariac_score.review.verify_ranking import verify_ranking
from ariac_score.terminal.style import Style, plain, style_for

EXIT_DIFFERS = 1
EXIT_UNPROVEN = 8
_LOOKS = {"ok": "green", "failed": "red", "note": "yellow", "open": "yellow"}


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "verify",
        description="Check schema, sums, hashes and versions of a stored result or ranking; with --log, also "
        "compute everything again and compare to the byte. Exit code 0: it holds; 1: something does not; "
        "8: it is consistent in itself, but was not compared with its log, or its rules, decisions or values "
        "across teams are known from the file alone.",
    )
    parser.add_argument(
        "result",
        type=Path,
        metavar="RESULT|RANKING",
        help="JSON written by 'score', 'adjust' or 'rank' with -o FILE.json, or a certificate",
    )
    parser.add_argument(
        "--log",
        type=Path,
        metavar="PATH",
        help="what it was scored from: a log, a bundle, or the competition it is a run of",
    )
    parser.add_argument("--rules", default="", metavar="NAME", help="rule set that it should be scored by")
    parser.add_argument("--log-map", default="", metavar="NAME", help="log map instead of the rule set's own")
    add_trial_config(parser)
    parser.add_argument(
        "--cohort", type=Path, metavar="FILE", help="cohort.json of the organisers, where --log is one run"
    )
    parser.add_argument(
        "--adjustments",
        type=Path,
        metavar="FILE",
        help="adjustments.yaml that an adjusted result should follow",
    )
    parser.add_argument(
        "--signature",
        nargs="?",
        type=Path,
        const=True,
        metavar="FILE",
        help="check its signature; default: RESULT.minisig",
    )
    parser.add_argument(
        "--public-key",
        default="",
        metavar="KEY",
        help="who must have signed it: the file of a public key, or the key itself",
    )
    parser.add_argument(
        "--local-plugins",
        action="store_true",
        help="run the files of code beside the rule set (--rules), if they are those that the result states",
    )
    parser.add_argument(
        "--wheel",
        action="append",
        default=[],
        type=Path,
        metavar="FILE",
        help="a wheel that must have the code that the result names; again for those of plugins",
    )
    parser.add_argument("--output-format", choices=("text", "json"), default="text", help="default: text")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Verify and show every step; the exit code says whether it holds, does not, or is not proven."""
    if arguments.local_plugins and not (arguments.rules and arguments.log):
        raise UsageError(
            "--local-plugins needs the rule set and the log",
            hint="add --rules FILE, beside which the code lies, and --log PATH",
        )
    certificate = certificate_in(arguments.result)
    if certificate is not None:
        return verify_certificate(certificate, arguments)
    if arguments.signature is not None and not arguments.public_key:
        raise UsageError("a signature is checked with a key", hint="name the key with --public-key")
    with not_a_log(arguments.result, "verify"):
        if is_ranking(arguments.result):
            return _shown(_ranking(arguments), arguments)
        found = verify_result(
            arguments.result,
            log=arguments.log,
            rules=arguments.rules,
            log_map=arguments.log_map,
            also=arguments.trial_config,
            cohort=arguments.cohort,
            adjustments=arguments.adjustments,
            public_key=str(arguments.public_key),
            signature=arguments.signature if isinstance(arguments.signature, Path) else None,
            local_plugins=arguments.local_plugins,
            wheels=arguments.wheel,
        )
    return _shown(found, arguments)


def _ranking(arguments: argparse.Namespace) -> Verification:
    for name in ("log_map", "trial_config", "cohort", "local_plugins", "wheel"):
        if getattr(arguments, name):
            option = f"--{name.replace('_', '-')}"
            raise UsageError(f"{option} is for a result, and this is a ranking", hint=f"leave out {option}")
    return verify_ranking(
        arguments.result,
        log=arguments.log,
        rules=arguments.rules,
        adjustments=arguments.adjustments,
        public_key=str(arguments.public_key),
        signature=arguments.signature if isinstance(arguments.signature, Path) else None,
    )


def _shown(found: Verification, arguments: argparse.Namespace) -> int:
    if arguments.output_format == "json":
        print(json.dumps(_data(found), indent=1, sort_keys=True))
    else:
        for line in _lines(found, arguments.result.name, style_for(sys.stdout)):
            print(line)
    return 0 if found.holds else EXIT_UNPROVEN if found.consistent else EXIT_DIFFERS


def _lines(found: Verification, name: str, style: Style) -> Iterator[str]:
    yield f"{style(plain(name), 'bold')}: {plain(_kind(found))}"
    for step in found.steps:
        first, *more = step.words.split("\n")
        yield f"  {style(f'{step.outcome:<7}', _LOOKS[step.outcome])}{step.name:<12} {plain(first)}"
        yield from (f"{' ' * 22}{plain(line)}" for line in more)
    words, colour = _summary(found)
    yield style(words, colour)


def _summary(found: Verification) -> tuple[str, str]:
    """What all steps come to, in a line, and its colour."""
    if failed := found.steps_that_are(FAILED):
        return f"does not hold: {', '.join(failed)}", "red"
    if found.holds:
        return "it holds", "green"
    others = [name for name in found.steps_that_are(OPEN) if name != "log"]
    known = f"; known from the file alone: {', '.join(others)}" if others else ""
    # Nothing but its log says whether what was measured is true, however well all of it fits together.
    compared = "" if found.computed_again else "; not compared with a log"
    return f"consistent in itself{compared}{known}", "yellow"


def _kind(found: Verification) -> str:
    """Whether it is an automatic or an adjusted result, with its scores."""
    result = found.result
    if result is None:
        return found.about or "no whole result"
    automatic = "withheld" if result.score is None else f"{result.score:f}"
    under = f"under {result.provenance.rule_set.id}"
    if result.adjusted is None:
        return f"automatic result, score {automatic}, {under}"
    final = "none" if result.adjusted.score is None else f"{result.adjusted.score:f}"
    count = len(result.adjusted.adjustments)
    decisions = counted(count, "decision")
    return f"adjusted result, score {final} by {decisions} of stewards, automatic score {automatic}, {under}"


def _data(found: Verification) -> dict[str, Any]:
    result = found.result
    return {
        "holds": found.holds,
        "consistent": found.consistent,
        "kind": (found.about.partition(" of ")[0] or None)
        if result is None
        else "automatic"
        if result.adjusted is None
        else "adjusted",
        "automatic_score": None if result is None or result.score is None else float(result.score),
        "score": None if result is None or result.final is None else float(result.final),
        "steps": [{"name": s.name, "outcome": s.outcome, "words": s.words} for s in found.steps],
    }
