"""`ariac-score plugins list|show|check|doctor`: installed plugins, and whether they work."""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from contextlib import suppress
from pathlib import Path
from typing import Any

from ariac_score.checks.contracts import GROUPS
from ariac_score.checks.local import LocalFiles
from ariac_score.checks.registry import Plugin, Registry, is_local
from ariac_score.cli.actions import add_action
from ariac_score.cli.apart import is_apart, run_apart
from ariac_score.cli.notes import counted
from ariac_score.engine.read import find_trial, read_trial
from ariac_score.errors import PluginError, ScoreError, UsageError
from ariac_score.installed.points import unreadable_distributions
from ariac_score.logs.logmap import load_log_map
from ariac_score.terminal.style import plain, style_for
from ariac_score.testing.contract import BUDGET_S, contract_checks
from ariac_score.testing.doctor import ailments
from ariac_score.testing.inventory import Brought, brought, brought_named, page_of
from ariac_score.testing.made import made_trial_for
from ariac_score.testing.pages import example_parameters
from ariac_score.trial.channels import LogMap
from ariac_score.trial.vocabulary import QUANTITIES

EXIT_BROKEN = 1
CALL_LIMIT_S = 120.0
"""How long one call of a plugin may last while it is checked, s; its processor time has a budget besides."""
EXIT_PLUGIN = 3


def register(commands: Any) -> None:
    """Add the command and its actions."""
    parser = commands.add_parser("plugins", description="List, show and check installed plugins.")
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = add_action(actions, "list", "list every plugin with its distribution and version")
    listing.add_argument("--hash", action="store_true", help="also show the SHA-256 of its package's code")
    listing.add_argument("--output-format", choices=("text", "json"), default="text")
    listing.set_defaults(run=run_list)
    show = add_action(actions, "show", "show the documentation of a plugin")
    show.add_argument("name", metavar="NAME", help="a name, or a class in a file: ./ours.py:NearMiss")
    _take_local_plugins(show)
    show.set_defaults(run=run_show)
    check = actions.add_parser(
        "check",
        help="check whether a plugin keeps its contract",
        description="Try the contract of a plugin on a trial. Exit codes: 0 kept, 1 broken.",
    )
    check.add_argument("name", metavar="NAME", help="a name, or a class in a file: ./ours.py:NearMiss")
    check.add_argument(
        "--trial",
        type=Path,
        metavar="LOG",
        help="a log of yours, which a reader needs; default: an example trial",
    )
    check.add_argument("--log-map", default="", metavar="NAME", help="log map to read it with")
    check.add_argument(
        "--budget", type=float, default=None, metavar="S", help="most processor time for a million samples, s"
    )
    check.add_argument(
        "--time-limit-s",
        type=float,
        default=CALL_LIMIT_S,
        metavar="S",
        help=f"longest that one call of the plugin may last, s; default: {CALL_LIMIT_S:g}",
    )
    _take_local_plugins(check)
    check.set_defaults(run=run_check)
    doctor = add_action(actions, "doctor", "find everything that is wrong with installed plugins")
    doctor.set_defaults(run=run_doctor)


def _take_local_plugins(parser: argparse.ArgumentParser) -> None:
    """Take the option that other commands need for files, which changes nothing here."""
    parser.add_argument(
        "--local-plugins",
        action="store_true",
        help="not needed: who names a class in a file allows that it runs",
    )


# list ----------------------------------------------------------------------------------


def run_list(arguments: argparse.Namespace) -> int:
    """Print everything that is installed, by kind, with the reason for what cannot be used."""
    rows = [_row(one) for one in brought(Registry())]
    if arguments.output_format == "json":
        print(json.dumps(rows, indent=1, ensure_ascii=False))
    for row in rows if arguments.output_format == "text" else ():
        code = f" {row['sha256'][:16]}" if arguments.hash else ""
        print(plain(f"{_line(row)}{code} {row['problem'] or row['summary']}"))
    unreadable = unreadable_distributions()
    for one in unreadable:  # not among the rows: nobody knows which plugins it has
        print(plain(f"{one.origin}: {one.reason}"), file=sys.stderr)
    problems = [row["name"] for row in rows if row["problem"]]
    if problems:
        those = "plugin cannot" if len(problems) == 1 else "plugins cannot"
        print(f"error: {len(problems)} {those} be used: {', '.join(problems)}", file=sys.stderr)
        print(
            "hint: 'ariac-score plugins doctor' says what is wrong with each, and what to do", file=sys.stderr
        )
    return EXIT_PLUGIN if unreadable or problems else 0


def _row(one: Brought) -> dict[str, str]:
    """A plugin as `list` shows it; `problem` is why it cannot be used."""
    row = {
        "kind": one.kind,
        "name": one.name,
        "distribution": one.plugin.distribution,
        "version": one.plugin.version,
        "target": one.plugin.target,
        "sha256": "",
        "summary": one.summary,
        "problem": "",
    }
    if one.problem:
        row["problem"] = f"{'CANNOT BE USED' if one.conflict else 'BROKEN'}: {one.problem}"
    with suppress(PluginError):
        row["sha256"] = _sha256(one)
    return row


def _sha256(one: Brought) -> str:
    """The hash of a file, or of the code of the package that brings a plugin."""
    if one.file is not None:
        return hashlib.sha256(one.file.path.read_bytes()).hexdigest()
    return one.plugin.code_sha256()


def _line(row: dict[str, str]) -> str:
    return f"{row['kind']:<16} {row['name']:<30} {row['distribution']} {row['version']:<8}"


# show ----------------------------------------------------------------------------------


def run_show(arguments: argparse.Namespace) -> int:
    """Print the distribution of a plugin, then its documentation."""
    for one in _shown(arguments.name):
        plugin = one.plugin
        kind = f"{one.kind[:-3]}y" if one.kind.endswith("ies") else one.kind.removesuffix("s")
        if one.problem:
            raise PluginError(one.problem, origin=plugin.origin, hint=one.hint)
        page = page_of(one)
        print(f"{kind} of {plugin.distribution} {plugin.version}, {plugin.target}")
        print(f"{'file' if one.file else 'code'} {_sha256(one)}\n")
        sys.stdout.write("".join(f"{plain(line)}\n" for line in page.splitlines()))
    return 0


def _shown(name: str) -> list[Brought]:
    if not is_local(name):
        return brought_named(name, Registry())
    plugin = _in_file(name)
    return [Brought(plugin.group.rpartition(".")[2], plugin.name, plugin)]


def _named(name: str) -> list[Any]:
    """The plugins with a contract of that name, or the class in a file, whose naming allows it.

    Raises:
        PluginNotFoundError: Nobody provides it.
        PluginConflictError: Two distributions do.
        LocalPluginError: The file is not there, or no such class is in it.
        UsageError: It is of a kind that is data or a function.
    """
    if is_local(name):
        return [_in_file(name)]
    registry = Registry()
    groups = [group for group in GROUPS if name in registry.names(group)]
    if not groups:
        others = brought_named(name, registry)
        raise UsageError(
            f"{name!r} is one of {others[0].kind}, which have no contract to try",
            hint="'ariac-score plugins doctor' loads it and says what is wrong with it",
        )
    return [registry.find(group, name) for group in groups]


def _in_file(name: str) -> Plugin:
    """The monitor or rule in a file, such as `ours/near_miss.py:NearMiss`."""
    file, _, cls = name.rpartition(":")
    path = Path(file)
    use = f"./{path.name}:{cls}"
    found = LocalFiles().find("ariac_score.monitors", use, path.parent)
    judges = hasattr(found.load(), "judge")
    return LocalFiles().find("ariac_score.rules", use, path.parent) if judges else found


# check ---------------------------------------------------------------------------------


def run_check(arguments: argparse.Namespace) -> int:
    """Try every check of a plugin's contract and print the outcome of each."""
    budget_s = BUDGET_S if arguments.budget is None else arguments.budget
    if not budget_s > 0:
        raise UsageError(f"a budget of {budget_s:g} s is none", hint="give a positive number of seconds")
    if not arguments.time_limit_s > 0:
        raise UsageError(f"a limit of {arguments.time_limit_s:g} s is none", hint="give a positive number")
    named = _named(arguments.name)
    if not is_apart():
        try:
            return run_apart(arguments.given, limit_s=arguments.time_limit_s)
        except PluginError as error:
            _outcome("ends", error)
            return EXIT_BROKEN
    code = 0
    for plugin in named:
        subject = _subject(plugin, arguments)
        try:
            built = plugin.build(example_parameters(plugin))
            checks = contract_checks(built, subject, budget_s=budget_s, log_map=arguments.log_map)
        except ScoreError as error:
            _outcome("built", error)
            return EXIT_BROKEN
        what = arguments.trial.name if arguments.trial else "the made trial"
        print(f"{plugin.origin}: {counted(len(checks), 'check')} on {what}", flush=True)
        for check in checks:
            try:
                unseen = check.run()
            except ScoreError as error:
                _outcome(check.name, error)
                code = EXIT_BROKEN
            else:
                print(
                    f"  kept    {check.name:<24} {f'but {plain(unseen)}' if unseen else check.about}",
                    flush=True,
                )
    return code


def _outcome(name: str, error: Any) -> None:
    print(f"  {style_for(sys.stdout)('BROKEN', 'red')}  {name:<24} {plain(str(error))}")


def _subject(plugin: Any, arguments: argparse.Namespace) -> Any:
    """What a plugin is checked with: a log for a reader, a trial for all others."""
    kind = plugin.group.rpartition(".")[2]
    if kind == "decoders":
        raise UsageError("a decoder is checked with the reader that uses it", hint="check the reader")
    if kind == "readers":
        if arguments.trial is None:
            raise UsageError("a reader is checked with a log that it reads", hint="give one with --trial")
        return arguments.trial
    return (
        made_trial_for(plugin, Registry())
        if arguments.trial is None
        else _read(arguments, work=kind == "rules")
    )


def _read(arguments: argparse.Namespace, *, work: bool) -> Any:
    """The trial of a log, with every quantity it has."""
    registry = Registry()
    mapping = load_log_map(arguments.log_map) if arguments.log_map else LogMap("none")
    bundle, readers = find_trial(arguments.trial, registry)
    wanted = [*QUANTITIES, *mapping.quantities]
    return read_trial(bundle, readers, mapping, registry, quantities=wanted, work=work)


# doctor --------------------------------------------------------------------------------


def run_doctor(_arguments: argparse.Namespace) -> int:
    """Print everything that is installed and whether it can be used, then every problem with its remedy."""
    installed = [*brought(Registry())]
    found = ailments(installed)
    broken = {ailment.plugin for ailment in found}
    colour = style_for(sys.stdout)
    for one in installed:
        # Of several files that one entry point brings, only some may be broken.
        bad = one.problem if one.file else one.plugin in broken
        print(f"{plain(_line(_row(one)))} {colour('BROKEN', 'red') if bad else 'ok'}")
    print()  # the problems last, where a terminal shows them
    for ailment in found:
        print(f"{plain(ailment.origin)}: {plain(ailment.problem)}\n  hint: {plain(ailment.hint)}")
    if not found:
        print("every installed plugin can be used")
    return EXIT_BROKEN if found else 0
