"""`ariac-score oracle --rules NAME`: a WebSocket oracle for the monitors of ROSMonitoring."""

from __future__ import annotations

import argparse
import math
import signal
import sys
from pathlib import Path
from typing import Any, NoReturn

from ariac_score.checks.registry import Registry
from ariac_score.cli.notes import note
from ariac_score.errors import UsageError
from ariac_score.oracle.judges import Bench, RulesBench, SpecBench
from ariac_score.oracle.results import rehearse, write_results
from ariac_score.oracle.server import Limits, Oracle
from ariac_score.scoring.ruleset import RuleSet, load_rule_set
from ariac_score.serving.guard import read_token

_LEAD_S = 0.8
"""What the report and the end of the program take after the last log, s."""


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "oracle",
        description="Serve a WebSocket oracle for ROSMonitoring: every event is answered with the verdict of "
        "its trace so far. Interrupt it (Ctrl-C) to end it; it then writes the findings of each connection.",
    )
    by = parser.add_mutually_exclusive_group(required=True)
    by.add_argument("--rules", metavar="NAME", help="rule set: a name ('rules list') or a .yaml file")
    by.add_argument("--spec", type=Path, metavar="FILE", help="specification of events, such as RML")
    parser.add_argument(
        "--after-violation",
        choices=("once", "resume", "restart"),
        default="once",
        help="with --spec: after a rejected event, the verdict is final (once, the default), the event is "
        "ignored (resume), or the specification starts anew (restart)",
    )
    parser.add_argument(
        "--dialect",
        choices=("2024", "rosmonitoring"),
        default="2024",
        help="with --spec: dialect of the language (default: 2024)",
    )
    parser.add_argument("--exact", action="store_true", help="with --spec: compare numbers without tolerance")
    parser.add_argument("--log-map", default="", metavar="NAME", help="log map instead of the rule set's own")
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        help="address to listen on (default: this machine only); others need --token-file",
    )
    parser.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="a token that every client has to bring, as 'Authorization: Bearer TOKEN' or '?token=TOKEN'",
    )
    parser.add_argument(
        "--allow-name",
        action="append",
        default=[],
        metavar="NAME",
        help="name by which clients may call this machine, besides its own",
    )
    parser.add_argument("--port", type=int, default=8080, help="port; 0: any free one (default: 8080)")
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("oracle_results"),
        metavar="DIR",
        help="new folder for event logs and results (default: oracle_results)",
    )
    parser.add_argument(
        "--resume",
        action="store_true",
        help="go on with the conversations in the folder, as after a crash",
    )
    parser.add_argument(
        "--finish-within",
        type=float,
        default=2.0,
        metavar="S",
        help="once interrupted, end after so many seconds, leaving further logs (default: 2); 0: score all",
    )
    parser.add_argument(
        "--max-connections", type=int, default=64, metavar="N", help="at a time (default: 64)"
    )
    parser.add_argument(
        "--max-per-address",
        type=int,
        default=32,
        metavar="N",
        help="at a time, of one address of another machine (default: 32)",
    )
    parser.add_argument(
        "--idle",
        type=float,
        default=600.0,
        metavar="S",
        help="when there is no room, a connection that sent nothing for so long gives way (default: 600)",
    )
    parser.add_argument(
        "--max-log-bytes",
        type=int,
        default=1_000_000_000,
        metavar="N",
        help="a larger event log is set aside (default: 1000000000)",
    )
    parser.add_argument(
        "--log-parts",
        type=int,
        default=9,
        metavar="N",
        help="logs set aside that are kept for each connection; the oldest is deleted (default: 9)",
    )
    parser.add_argument(
        "--max-frame-bytes", type=int, default=1_000_000, metavar="N", help="longest event (default: 1000000)"
    )
    parser.add_argument(
        "--max-rate",
        type=float,
        default=50_000.0,
        metavar="N",
        help="events/s of a connection (default: 50000); 0: any",
    )
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Serve until interrupted, then write findings and report."""
    rule_set = load_rule_set(arguments.rules) if arguments.rules else None
    if rule_set is not None:
        rehearse(rule_set, arguments.log_map)
    bench = _bench(arguments, rule_set)
    oracle = Oracle(
        bench,
        arguments.output,
        host=arguments.host,
        port=arguments.port,
        limits=_limits(arguments),
        token=read_token(arguments.token_file) if arguments.token_file else "",
        names=frozenset(name.lower() for name in arguments.allow_name),
        resume=arguments.resume,
    )
    _introduce(arguments, oracle, bench)
    _warn_of_once(arguments)
    _serve(oracle)
    written = write_results(
        arguments.output,
        oracle.conversations,
        judged_by=rule_set.id if rule_set else arguments.spec.name,
        rule_set=rule_set,
        log_map=arguments.log_map,
        refusals=oracle.refusals,
        until_s=oracle.stopped_at_s + (arguments.finish_within or math.inf) - _LEAD_S,
    )
    for file in written:
        print(file)
    return 0


def _bench(arguments: argparse.Namespace, rule_set: RuleSet | None) -> Bench:
    if rule_set is None:
        chosen = {name: getattr(arguments, name) for name in ("after_violation", "dialect", "exact")}
        return SpecBench(arguments.spec, Registry(), chosen)
    return RulesBench(rule_set, Registry(), log_map=arguments.log_map)


def _limits(arguments: argparse.Namespace) -> Limits:
    try:
        return Limits(
            arguments.max_frame_bytes,
            arguments.max_connections,
            arguments.max_rate,
            of_one_address=arguments.max_per_address,
            silent_s=min(Limits.silent_s, arguments.idle),
            idle_s=arguments.idle,
            log_bytes=arguments.max_log_bytes,
            log_parts=arguments.log_parts,
        )
    except ValueError as cause:
        raise UsageError(str(cause), hint="see 'ariac-score oracle --help'") from cause


def _introduce(arguments: argparse.Namespace, oracle: Oracle, bench: Bench) -> None:
    note(arguments, f"listening on {oracle.url}")
    if bench.live:
        note(arguments, f"judged event by event: {', '.join(bench.live)}")
    else:
        note(arguments, "no check can be judged event by event: every verdict will be 'unknown'")
    for name, reason in bench.later.items():
        note(arguments, f"judged at the end: {name} ({reason})")
    sys.stderr.flush()


def _warn_of_once(arguments: argparse.Namespace) -> None:
    if arguments.spec and arguments.after_violation == "once":
        note(
            arguments,
            "warning: a first violation is answered 'false', at which nodes of version 3 that only log end "
            "themselves; --after-violation resume keeps them",
        )
        sys.stderr.flush()


def _serve(oracle: Oracle) -> None:
    """Serve until SIGINT or SIGTERM; here both are the regular end."""

    def interrupt(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    # Containers and service managers end a program by SIGTERM, and the results are to be written.
    before = signal.signal(signal.SIGTERM, interrupt)
    try:
        oracle.serve()
    except KeyboardInterrupt:
        pass
    finally:
        signal.signal(signal.SIGTERM, before)
        oracle.stop()
