"""`ariac-score platform codabench|evalai …`: host a competition where others run the server."""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ariac_score.batch.tasks import BatchSetting, Limits
from ariac_score.cli.actions import add_action
from ariac_score.cli.notes import counted
from ariac_score.errors import UsageError
from ariac_score.platforms.codabench import (
    Bundle,
    check_bundle,
    dry_run,
    pack,
    refuse_unattested,
    score,
    write_bundle,
)
from ariac_score.platforms.evalai import (
    Api,
    ApiError,
    Challenge,
    Worker,
    challenge_config,
    challenge_files,
    check_challenge,
)
from ariac_score.platforms.problems import Problem
from ariac_score.platforms.submission import load_phase
from ariac_score.scoring.ruleset import load_rule_set
from ariac_score.terminal.output import write
from ariac_score.terminal.style import plain

EXIT_PROBLEMS = 1
_IDLE_S = 60.0


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "platform",
        description="Write the files that a platform needs, check them before the upload, and try them as "
        "the platform would.",
    )
    platforms = parser.add_subparsers(dest="platform", metavar="PLATFORM", required=True)
    _codabench(platforms.add_parser("codabench", help="bundle, check, dry-run, pack, score"))
    _evalai(platforms.add_parser("evalai", help="config, check, worker"))


def _codabench(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    one = add_action(actions, "bundle", "write a complete competition bundle")
    one.add_argument("--rules", required=True, metavar="NAME", help="rule set of the phase")
    one.add_argument("--title", required=True, help="of the competition")
    one.add_argument(
        "--image", required=True, metavar="NAME@sha256:…", help="container image with ariac-score"
    )
    one.add_argument("--start", required=True, metavar="DATE", help="first day, such as 2026-09-01")
    one.add_argument("--end", required=True, metavar="DATE", help="last day")
    one.add_argument(
        "--trial",
        action="append",
        default=[],
        metavar="ID[=CONFIG]",
        help="a trial, with its configuration; repeatable",
    )
    one.add_argument(
        "--unattested",
        action="store_true",
        help="let recordings count whose completeness no recorder attests, where the rules do not say so",
    )
    one.add_argument(
        "--time-limit-s", type=int, default=600, metavar="S", help="for one submission; default: 600"
    )
    one.add_argument("-o", "--output", type=Path, required=True, metavar="ZIP", help="file to write")
    one.set_defaults(run=_bundle)
    one = add_action(actions, "check", "find what the platform would reject late or get wrong in silence")
    one.add_argument("bundle", type=Path, metavar="ZIP", help="the competition bundle")
    one.set_defaults(run=_check_bundle)
    one = add_action(actions, "dry-run", "score a submission as the platform's worker does")
    one.add_argument("bundle", type=Path, metavar="ZIP", help="the competition bundle")
    one.add_argument("submission", type=Path, metavar="SUBMISSION", help="the zip of a team")
    one.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="new folder to work in")
    one.set_defaults(run=_dry_run)
    one = add_action(actions, "pack", "pack a submission that the platform does not take for a program")
    one.add_argument("trials", type=Path, nargs="+", metavar="TRIAL", help="log, or folder of a trial")
    one.add_argument("-o", "--output", type=Path, required=True, metavar="ZIP", help="file to write")
    one.set_defaults(run=_pack)
    one = add_action(actions, "score", "score a submission; for the scoring program in its container")
    one.add_argument("input", type=Path, metavar="INPUT", help="folder with ref and res")
    one.add_argument("output", type=Path, metavar="OUTPUT", help="folder for scores and page")
    one.set_defaults(run=_score)


def _evalai(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    one = add_action(actions, "config", "write challenge_config.yaml")
    one.add_argument("--title", required=True, help="of the challenge")
    one.add_argument(
        "--phase", required=True, metavar="CODENAME", help="code name of the phase, such as finals"
    )
    where = one.add_mutually_exclusive_group()
    where.add_argument("-o", "--output", type=Path, metavar="FILE", help="the configuration alone")
    where.add_argument(
        "--folder",
        type=Path,
        metavar="DIR",
        help="the configuration with the files that the importer requires",
    )
    one.set_defaults(run=_config)
    one = add_action(actions, "check", "find what the platform would get wrong in silence")
    one.add_argument("config", type=Path, metavar="FILE", help="challenge_config.yaml")
    one.set_defaults(run=_check_config)
    one = actions.add_parser(
        "worker",
        help="score the submissions of a challenge",
        description="Score the submissions in the queue of a challenge. Takes AUTH_TOKEN, API_SERVER, "
        "QUEUE_NAME and CHALLENGE_PK from the environment, and AUTH_SCHEME: Bearer or Token; without it, "
        "both are tried.",
    )
    one.add_argument(
        "phase", type=Path, metavar="DIR", help="reference data: phase.json, ruleset.yaml, trials/"
    )
    one.add_argument(
        "--store", type=Path, required=True, metavar="DIR", help="folder for submissions and answers"
    )
    one.add_argument(
        "--phase-codename",
        default="",
        metavar="CODENAME",
        help="refuse submissions for any other phase; needed where a challenge has several",
    )
    one.add_argument("--once", action="store_true", help="stop when the queue is empty")
    one.set_defaults(run=_worker)


def _bundle(arguments: argparse.Namespace) -> int:
    rule_set = load_rule_set(arguments.rules)
    if not arguments.unattested:
        refuse_unattested(rule_set)
    limits = Limits(wall_s=max(1.0, arguments.time_limit_s / 2))
    trials = {
        trial: Path(config) if config else None
        for trial, _, config in (text.partition("=") for text in arguments.trial)
    }
    bundle = Bundle(arguments.title, arguments.image, arguments.start, arguments.end, arguments.time_limit_s)
    write_bundle(bundle, rule_set, BatchSetting.of(rule_set, limits), trials, arguments.output)
    print(f"wrote {plain(str(arguments.output))}; 'platform codabench dry-run' tries it with a submission")
    return _check_bundle(argparse.Namespace(bundle=arguments.output))


def _check_bundle(arguments: argparse.Namespace) -> int:
    return _show(check_bundle(arguments.bundle))


def _check_config(arguments: argparse.Namespace) -> int:
    return _show(check_challenge(arguments.config))


def _show(problems: Sequence[Problem]) -> int:
    for problem in problems:
        word = "problem" if problem.severe else "worth a look"
        print(plain(f"{word}: {problem.where}: {problem.what}"))
        print(plain(f"  hint: {problem.remedy}"))
    if not problems:
        print("no problem found")
    return EXIT_PROBLEMS if any(problem.severe for problem in problems) else 0


def _dry_run(arguments: argparse.Namespace) -> int:
    code = dry_run(arguments.bundle, arguments.submission, arguments.output)
    output = plain(str(arguments.output / "output"))
    if code == 0:
        print(f"the platform would show scores.json and detailed_results.html in {output}")
    else:
        print(f"the platform would show a failure, and keep only detailed_results.html in {output}")
    return code


def _pack(arguments: argparse.Namespace) -> int:
    count = pack(arguments.trials, arguments.output)
    size = arguments.output.stat().st_size
    print(f"wrote {plain(str(arguments.output))}: {count} file{'' if count == 1 else 's'}, {size} bytes")
    return 0


def _score(arguments: argparse.Namespace) -> int:
    return score(arguments.input, arguments.output)


def _config(arguments: argparse.Namespace) -> int:
    challenge = Challenge(arguments.title, arguments.phase)
    if arguments.folder is None:
        write(challenge_config(challenge), arguments.output)
        return 0
    files = challenge_files(challenge)
    for name, content in files.items():
        place = arguments.folder / name
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
    where = f"{counted(len(files), 'file')} in {plain(str(arguments.folder))}"
    print(f"wrote {where}; 'platform evalai check' checks them")
    return 0


def _worker(arguments: argparse.Namespace) -> int:
    names = ("API_SERVER", "AUTH_TOKEN", "QUEUE_NAME", "CHALLENGE_PK")
    missing = [name for name in names if not os.environ.get(name)]
    if missing or not os.environ.get("CHALLENGE_PK", "").isdecimal():
        raise UsageError(
            f"not set: {', '.join(missing) or 'CHALLENGE_PK as a number'}",
            hint="the platform shows them to the host of a challenge; set them in the environment",
        )
    server, token, queue, challenge = (os.environ[name] for name in names)
    api = Api(server, token, queue, int(challenge), os.environ.get("AUTH_SCHEME", ""))
    phase, codename = load_phase(arguments.phase), arguments.phase_codename
    worker = Worker(api, phase, arguments.store, time.sleep, _log, codename)
    while True:
        try:
            if worker.once():
                continue
        except ApiError as error:
            _log(f"the platform did not answer: {error}")
            if not error.transient or arguments.once:
                raise UsageError(str(error), hint="check server, token, queue and challenge") from error
        if arguments.once:
            return 0
        time.sleep(_IDLE_S)


def _log(line: str) -> None:
    print(plain(line), file=sys.stderr, flush=True)
