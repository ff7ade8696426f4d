"""`ariac-score sign RESULT…`: sign results with a key; `--new-key` makes one."""

from __future__ import annotations

import argparse
import sys
from contextlib import ExitStack
from getpass import getpass
from pathlib import Path
from typing import Any

from ariac_score.batch.bucket import fetched_batch
from ariac_score.batch.description import load_description
from ariac_score.batch.index import RUNS, check_index, checked_rows, read_rows, refuse_other_rules
from ariac_score.batch.remote import is_uri, shown
from ariac_score.batch.store import JOURNAL
from ariac_score.errors import UsageError
from ariac_score.results.signing import make_keys, sign_file, sign_result, signature_file
from ariac_score.terminal.output import write
from ariac_score.terminal.style import plain


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "sign",
        description="Sign stored results in the format of minisign: writes RESULT.minisig for each. "
        "'verify --signature' checks it, and so does 'minisign -V'. Needs the extra 'sign'.",
    )
    parser.add_argument(
        "results",
        nargs="*",
        metavar="RESULT",
        help="JSON that 'score', 'adjust' or 'rank' wrote, adjustments.yaml, or the folder of a batch, "
        "also by URI: s3://, gs://",
    )
    parser.add_argument(
        "--key", type=Path, metavar="FILE", help="secret key; nobody else may be able to read it"
    )
    parser.add_argument(
        "--new-key", type=Path, metavar="FILE", help="make a secret key, and the public one as FILE.pub"
    )
    parser.add_argument(
        "--comment", default="", metavar="TEXT", help="comment to sign along; default: the file's name"
    )
    parser.add_argument(
        "--competition",
        default="",
        metavar="ID",
        help="sign for this competition alone, as the id in its competition.yaml: one that names your key "
        "there takes nothing that is signed for another, or for none",
    )
    parser.add_argument(
        "--password",
        action="store_true",
        help="ask for a password on the terminal, and encrypt the new key with it",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Make keys, or sign each result."""
    if arguments.new_key is not None:
        if arguments.results:
            raise UsageError("--new-key takes no results", hint="make the key first, then sign with --key")
        for file in make_keys(arguments.new_key, _password() if arguments.password else ""):
            print(plain(str(file)))
        return 0
    if arguments.key is None or not arguments.results:
        raise UsageError("nothing to sign, or no key", hint="ariac-score sign RESULT --key FILE")
    with ExitStack() as stack:
        signatures = [
            (signature_file(file), _signature(file, arguments), str(given))
            for given in arguments.results
            for file in _signed_files(stack.enter_context(fetched_batch(given, bring_back=True)))
        ]
        for (
            file,
            signature,
            _,
        ) in signatures:  # after all are made: a fault in the last one leaves none signed
            write(signature.decode("ascii"), file)
    for file, _, given in signatures:
        print(plain(f"{shown(given).rstrip('/')}/{file.name}" if is_uri(given) else str(file)))
    return 0


def _signed_files(path: Path) -> list[Path]:
    """What is signed of a path: of the folder of a batch its tables, which name every result by its hash."""
    tables = [path / name for name in (RUNS, JOURNAL) if (path / name).is_file()]
    return tables or [path]


def _signature(file: Path, arguments: argparse.Namespace) -> bytes:
    if file.name not in (RUNS, JOURNAL):
        return sign_result(file, arguments.key, **_words(arguments))
    rules = load_description(file.parent, hint="it needs batch.json, which 'batch' writes").rule_set
    for row, _ in checked_rows(file.parent, file.name):
        refuse_other_rules(row, rules, file.parent)
    if file.name == RUNS:
        check_index(file.parent, (row for row, _ in read_rows(file)))
    return sign_file(file, arguments.key, **_words(arguments))


def _words(arguments: argparse.Namespace) -> dict[str, Any]:
    return {"comment": arguments.comment, "competition": arguments.competition, "password": _password}


def _password() -> str:
    # `getpass` would read standard input instead, and show the password.
    if not sys.stdin.isatty():
        raise UsageError(
            "the key has a password, and there is no terminal to ask for it",
            hint="sign on a terminal, or use a key without a password that only this user can read",
        )
    return getpass("password of the key: ")
