"""`ariac-score batch PATH -o OUT`: score many trials, each in a process of its own."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from ariac_score.batch.bucket import Bucket, brought, mirror_of
from ariac_score.batch.description import Shard
from ariac_score.batch.executors import make_executor
from ariac_score.batch.remote import LISTING_S, UnreachableError, is_uri, shown
from ariac_score.batch.remote_plans import LIST_ENDING, plan_elsewhere, plan_list
from ariac_score.batch.state import STORAGE_UNREACHABLE
from ariac_score.batch.store import Store
from ariac_score.batch.supervise import Report, run_batch
from ariac_score.batch.tasks import BatchPlan, BatchSetting, Limits, of_shard, plan_batch, shard
from ariac_score.cli.batch_progress import outcomes_text, progress_of
from ariac_score.cli.notes import counted, note
from ariac_score.cli.partial import add_partial
from ariac_score.errors import UsageError
from ariac_score.installed.system import shortfalls
from ariac_score.ranking.competition import signers_of
from ariac_score.results.signing import keys_asked_for
from ariac_score.scoring.ruleset import RuleSet, load_rule_set
from ariac_score.terminal.style import plain

EXIT_UNSETTLED = 6


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "batch",
        description="Score every run of a competition, or every entry of a folder. Each run is scored in a "
        "process of its own, so that a damaged or hostile log costs that run alone. When a batch is "
        "interrupted, the same command goes on where it stopped.",
    )
    parser.add_argument(
        "path",
        metavar="PATH",
        help="competition.yaml, its folder, a folder of trials, or a .txt that lists them; "
        "also by URI: s3://, gs://, https://",
    )
    parser.add_argument("--rules", default="", metavar="NAME", help="rule set; a competition names its own")
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="OUT",
        help="folder of the batch; also by URI of an object storage: s3://, gs://",
    )
    parser.add_argument(
        "-j", "--jobs", type=int, default=0, metavar="N", help="runs at a time; default: one for each core"
    )
    parser.add_argument(
        "--shard", default="", metavar="i/n", help="score only the i-th of n parts; 'merge' joins them"
    )
    parser.add_argument(
        "--time-limit-s", type=float, default=600.0, metavar="S", help="per run; default: 600"
    )
    parser.add_argument(
        "--memory-mb",
        type=int,
        default=8192,
        metavar="MIB",
        help="address space per run; default: 8192; 0: no limit",
    )
    parser.add_argument(
        "--output-mb", type=int, default=64, metavar="MIB", help="size of one result; default: 64"
    )
    parser.add_argument(
        "--input-gb", type=int, default=128, metavar="GIB", help="size of the files of one run; default: 128"
    )
    parser.add_argument(
        "--again",
        action="store_true",
        help="also score runs again that were late, too large, out of memory, killed or met a fault",
    )
    parser.add_argument(
        "--executor", default="local", metavar="NAME", help="where runs are scored; default: local"
    )
    parser.add_argument(
        "--ranges",
        action="store_true",
        help="of remote recordings fetch only the parts that the rules need; results show how much was read",
    )
    add_partial(parser, "score logs that are cut off as far as they go, as intervals; unofficial")
    parser.add_argument(
        "--public-key",
        default="",
        metavar="KEY",
        help="who must have signed the tables of an earlier call (sign OUT); otherwise all is scored again; "
        "default: whom the competition or its rules name (authority: signed_by), if anybody",
    )
    parser.add_argument("--scheduler", default="", metavar="ADDRESS", help="of the executor's cluster")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Find the runs, score what is missing, write the tables, print the outcomes."""
    sizes = (arguments.memory_mb, arguments.output_mb, arguments.input_gb)
    if arguments.jobs < 0 or arguments.time_limit_s <= 0 or min(sizes) < 0:
        raise UsageError(
            "--jobs and the limits may not be negative, and the time limit not 0",
            hint="leave them out for the defaults",
        )
    for shortfall in shortfalls():
        note(arguments, f"this system has {shortfall}")
    part = shard(arguments.shard) if arguments.shard else (1, 1)
    arguments.bucket = arguments.output if is_uri(arguments.output) else ""
    arguments.output = mirror_of(arguments.bucket) if arguments.bucket else Path(arguments.output)
    limits = Limits(
        arguments.time_limit_s,
        arguments.memory_mb << 20,
        arguments.output_mb << 20,
        arguments.input_gb << 30,
    )
    with TemporaryDirectory(prefix="ariac-score-") as laid_out:
        plan = _planned(arguments, Path(laid_out), part)
        rule_set = load_rule_set(plan.rules)
        setting = BatchSetting.of(rule_set, limits, ranges=arguments.ranges)
        schemes = {task.path.partition("://")[0] for task in plan.tasks if task.remote}
        allowed = tuple(sorted(plan.competition.local_plugins.items())) if plan.competition else ()
        setting = replace(
            setting,
            storages=",".join(sorted(schemes)),
            local_plugins=allowed,
            partial=bool(arguments.partial),
        )
        return _run(arguments, plan, rule_set, setting, part)


def _planned(arguments: argparse.Namespace, work: Path, part: tuple[int, int]) -> BatchPlan:
    """The runs of a path or URI.

    Raises:
        BatchError: A storage does not list its runs.
    """
    path = Path(arguments.path)
    try:
        if is_uri(arguments.path):
            note(arguments, f"listing {shown(arguments.path)}; given up after {LISTING_S:g} s")
            return plan_elsewhere(arguments.path, arguments.rules, work, ranges=arguments.ranges, part=part)
        if path.suffix == LIST_ENDING and path.is_file():
            return plan_list(path, arguments.rules, ranges=arguments.ranges, part=part)
    except UnreachableError as error:
        raise error.named(STORAGE_UNREACHABLE) from error.__cause__
    plan = plan_batch(path, arguments.rules)
    _refuse_inside(arguments.output, path)
    return plan


def _run(
    arguments: argparse.Namespace,
    plan: BatchPlan,
    rule_set: RuleSet,
    setting: BatchSetting,
    part: tuple[int, int],
) -> int:
    """Score what is missing, write the tables, print the outcomes."""
    named = rule_set.authority.signed_by
    if plan.competition is not None:
        named = signers_of(plan.competition, rule_set.authority)
    keys = keys_asked_for(named, str(arguments.public_key))
    store = Store(arguments.output)
    bucket = Bucket(arguments.bucket, store.root) if arguments.bucket else None
    tasks = list(of_shard(plan.tasks, *part))
    try:
        with store.working() as work, brought(bucket, work), progress_of(arguments, len(tasks)) as progress:
            executor = make_executor(
                arguments.executor,
                jobs=arguments.jobs,
                scheduler=arguments.scheduler,
                out=store.root,
                work=work,
            )
            report = run_batch(
                tasks,
                rule_set,
                setting,
                store,
                work,
                executor,
                name=plan.id,
                shard=None if part == (1, 1) else Shard(*part),
                again=arguments.again,
                on_outcome=progress.on_outcome,
                on_state=progress.on_state,
                signed_by=keys,
                on_unsigned=lambda reason: note(arguments, f"scored again, not taken from there: {reason}"),
            )
    except KeyboardInterrupt:
        where = " on this machine" if bucket else ""
        print(f"interrupted; what was scored is kept{where}, and the same command goes on", file=sys.stderr)
        return 2
    _show(report, plan, shown(arguments.bucket) or str(arguments.output))
    return EXIT_UNSETTLED if report.unsettled else 0


def _refuse_inside(output: Path, path: Path) -> None:
    """Refuse to write the batch among its own runs, where the next call would score it."""
    target, source = output.resolve(), path.resolve()
    logs = source if source.is_dir() else source.parent
    if target == logs or (logs in target.parents and target.parent == logs and not _is_competition(logs)):
        raise UsageError(
            "the batch would lie among the trials it scores",
            file=output,
            hint="name a folder outside of theirs",
        )


def _is_competition(folder: Path) -> bool:
    return (folder / "competition.yaml").is_file() or (folder / "logs").is_dir()


def _show(report: Report, plan: BatchPlan, out: str) -> None:
    print(f"{plain(plan.id)}: {counted(report.runs, 'run')}: {outcomes_text(report.outcomes)}")
    if report.cpu_s:
        print(f"{report.scored_now} scored now, in {report.cpu_s:.1f} s of processor time")
    if report.scored_now < report.runs:
        print(f"{report.runs - report.scored_now} scored before")
    if report.contradictions:
        rows = counted(report.contradictions, "row")
        verb = "was" if report.contradictions == 1 else "were"
        print(f"{rows} of the tables contradicted the stored results and {verb} made again")
    for stranger in plan.strangers:
        print(f"no run, skipped: {plain(stranger)}")
    print(f"results: {plain(out)} (runs.jsonl to read, index.sqlite to query)")
