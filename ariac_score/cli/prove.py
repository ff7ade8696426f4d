"""`ariac-score rules prove NAME`: which laws hold, proven; `verify` proves a certificate again."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from textwrap import wrap
from typing import Any

from ariac_score.checks.registry import Registry
from ariac_score.cli.example import example_log
from ariac_score.cli.local import add_local_plugins, registry_of
from ariac_score.cli.notes import counted
from ariac_score.errors import ScoreError, UsageError
from ariac_score.redteam.honest import honest_log
from ariac_score.redteam.proving import DEFAULT_TRIES, adversary, sha256_of
from ariac_score.review.laws.words import numbers_apart
from ariac_score.review.proofs.certificate import (
    MOST_TRIES,
    Adversary,
    Certificate,
    Law,
    TriedLog,
    certificate,
    certificate_json,
    compare,
)
from ariac_score.review.proofs.proving import DEFAULT_CASES
from ariac_score.review.proofs.solver import find_solver
from ariac_score.review.proofs.subject import Subject, subject_of
from ariac_score.scoring.extending import path_of_rule_set
from ariac_score.terminal.output import refuse_inputs, write
from ariac_score.terminal.style import Style, plain, style_for

__all__ = ["add_prove", "run_prove", "verify_certificate"]

EXIT_REFUTED, EXIT_OPEN = 1, 6
_WORDS = {"proven": "PROVEN", "refuted": "REFUTED", "open": "OPEN", "not_applicable": "no matter"}
_LOOKS = {"proven": "green", "refuted": "red", "open": "yellow", "not_applicable": "dim"}
_WIDTH = 100
_SHOWN = 3
"""Steps that are shown; the certificate has them all."""


def add_prove(actions: Any) -> None:
    """Add the action to those of `rules`."""
    parser = actions.add_parser(
        "prove",
        help="prove laws, such as that violations never help, or refute them with an exploit",
        description="Prove each law for every trial there can be, from the types of the formulas; what types "
        "do not prove is searched for an exploit, and is open where none is found. Exit code 0: every law is "
        "proven, or the rule set says under 'breaks' that it does not keep it; 1: a law is refuted and "
        "it does not say so, or --strict is given; 6: a law is open.",
    )
    parser.add_argument("name", metavar="NAME", help="a rule set, a .yaml file, or a penalty")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE.json", help="write the certificate")
    parser.add_argument(
        "--cases",
        type=_cases,
        default=DEFAULT_CASES,
        metavar="N",
        help="random trials to search for each law that is not proven (default: %(default)s)",
    )
    parser.add_argument(
        "--seed", type=int, default=0, metavar="S", help="the same seed tries the same trials"
    )
    parser.add_argument(
        "--log",
        type=Path,
        metavar="LOG",
        help="an honest recording that an adversary doctors for each law that is open (default: the example "
        "of the rule set's log map, where there is one)",
    )
    parser.add_argument(
        "--tries",
        type=_tries,
        default=DEFAULT_TRIES,
        metavar="N",
        help="how many doctored copies to score for each law that is open (default: %(default)s)",
    )
    parser.add_argument("--strict", action="store_true", help="a law that is not kept counts though declared")
    add_local_plugins(parser)
    parser.set_defaults(run=run_prove)


def _cases(text: str) -> int:
    return _upto(10_000, text)


def _tries(text: str) -> int:
    return _upto(MOST_TRIES, text)


def _upto(most: int, text: str) -> int:
    count = int(text)
    if not 0 <= count <= most:
        raise argparse.ArgumentTypeError(f"give a number from 0 to {most}")
    return count


def run_prove(arguments: argparse.Namespace) -> int:
    """Prove the laws of one rule set, print the table, write the certificate."""
    registry = registry_of(arguments)
    subject = subject_of(arguments.name, registry)
    if arguments.output is not None and not subject.is_penalty:
        refuse_inputs(arguments.output, path_of_rule_set(arguments.name, Path(), registry))
        if arguments.log is not None:
            refuse_inputs(arguments.output, arguments.log)
    against = _adversary(arguments, subject, registry)
    made = certificate(
        subject, cases=arguments.cases, seed=arguments.seed, solver=find_solver(), adversary=against
    )
    if arguments.output is not None:
        write(certificate_json(made), arguments.output)
    for line in _lines(made, style_for(sys.stdout)):
        print(line)
    return _exit_code(made, strict=arguments.strict)


def _adversary(arguments: argparse.Namespace, subject: Subject, registry: Registry) -> Adversary | None:
    """Who searches the log that is given, or the example that the rules can score.

    Raises:
        UsageError: A log is given for a penalty, which scores none, or it has no score.
        ScoreError: It cannot be scored.
    """
    given = arguments.log
    if subject.is_penalty and given is not None:
        raise UsageError("a penalty alone scores no log", hint="name a rule set that uses it")
    path = given or (None if subject.is_penalty else example_log(subject.rule_set.log_map))
    if path is None or not arguments.tries:
        return None
    try:
        return _searching(path, subject, registry, tries=arguments.tries, seed=arguments.seed)
    except ScoreError:
        if given is not None:
            raise
        return None  # these rules ask for more than the example has


def _searching(path: Path, subject: Subject, registry: Registry, *, tries: int, seed: int) -> Adversary:
    honest = honest_log(path, subject.rule_set, registry=registry)
    log = TriedLog(path.name, sha256_of(path), tries)
    return Adversary(log, adversary(honest, tries=tries, seed=seed))


def _exit_code(made: Certificate, *, strict: bool = False) -> int:
    counted = [law.verdict for law in made.laws if strict or not law.declared]
    if "refuted" in counted:
        return EXIT_REFUTED
    return EXIT_OPEN if "open" in counted else 0


def _lines(made: Certificate, style: Style) -> Iterator[str]:
    found = [law.verdict for law in made.laws]
    tally = ", ".join(f"{found.count(one)} {one}" for one in ("proven", "refuted", "open"))
    yield f"{style(plain(made.name), 'bold')}: {counted(len(found), 'law')}, {tally}"
    for law in made.laws:
        by = f" (by {law.by})" if law.verdict == "proven" else ""
        yield f"  {style(f'{_WORDS[law.verdict]:<10}', _LOOKS[law.verdict])}{law.says}{by}"
        for line in _reasons(law):
            yield f"            {plain(line)}"
    for border in made.borders:
        yield f"  border    {plain(border)}"


def _reasons(law: Law) -> Iterator[str]:
    """What proves a law, how it is exploited, or what is not known."""
    if law.declared:
        yield from wrap(f"the rule set says so itself: {law.declared}", _WIDTH)
    if law.exploit is not None:
        exploit = law.exploit
        first, second = numbers_apart(exploit.first_score, exploit.second_score)
        yield from wrap(exploit.trial, _WIDTH)
        yield f"{first}  {exploit.first}"
        yield f"{second}  {exploit.second}"
        return
    more = len(law.because) - _SHOWN
    said = "; ".join([*law.because[:_SHOWN], *([f"and {more} more of the kind"] if more > 0 else [])])
    yield from wrap(f"not known: {said}" if law.verdict == "open" else said, _WIDTH)
    if law.searched:
        yield from wrap(f"searched: {', '.join(law.searched)}: nothing", _WIDTH)


def verify_certificate(found: Certificate, arguments: argparse.Namespace) -> int:
    """Prove everything that a certificate says again, and print in what it differs."""
    if arguments.adjustments is not None or (arguments.log is not None and found.log is None):
        raise UsageError(
            "this certificate is about a rule set, not about a log", hint="leave out --log and --adjustments"
        )
    registry = registry_of(arguments)
    subject = subject_of(arguments.rules or found.name, registry)
    against = _same_adversary(found, arguments.log, subject, registry)
    style = style_for(sys.stdout)
    faults = unchecked = False
    print(f"{style(plain(arguments.result.name), 'bold')}: certificate of {plain(found.name)}")
    for one in compare(found, subject, against):
        faults |= one.is_fault
        unchecked |= one.is_unchecked
        look = "red" if one.is_fault else "yellow"
        outcome = f"{'failed' if one.is_fault else 'note':<7}"
        print(f"  {style(outcome, look)}{one.what:<16} {plain(one.words)}")
    if faults:
        print(style("does not hold", "red"))
        return EXIT_REFUTED
    if unchecked:
        print(style("nothing speaks against it; what is named above was not checked", "yellow"))
        return EXIT_OPEN
    print(style("it holds: everything was proven again", "green"))
    return 0


def _same_adversary(
    found: Certificate, given: Path | None, subject: Subject, registry: Registry
) -> Adversary | None:
    """Who searches the log of a certificate again, as given or as the example that it is; `None`: not here.

    Raises:
        ScoreError: It is no log, or cannot be scored.
    """
    if found.log is None or subject.rule_set.sha256 != found.sha256:
        return None  # another rule set is refused before anything is searched
    path = given or example_log(subject.rule_set.log_map)
    if path is None or (given is None and sha256_of(path) != found.log.sha256):
        return None
    return _searching(path, subject, registry, tries=found.log.tries, seed=found.seed)
