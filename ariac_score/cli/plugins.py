"""`ariac-score plugins list|show|check|doctor`: installed plugins, and whether they work."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from ariac_score.checks.contracts import GROUPS
from ariac_score.checks.registry import Registry, package_sha256
from ariac_score.cli.actions import add_action
from ariac_score.engine.read import find_trial, read_trial
from ariac_score.errors import PluginError, PluginNotFoundError, ScoreError, UsageError, did_you_mean
from ariac_score.installed.points import unreadable_distributions, unreadable_hint
from ariac_score.logs.logmap import load_log_map
from ariac_score.terminal.style import plain, style_for
from ariac_score.testing.contract import BUDGET_S, contract_checks
from ariac_score.testing.doctor import ailments
from ariac_score.testing.made import made_trial
from ariac_score.testing.pages import example_parameters, plugin_page
from ariac_score.trial.channels import LogMap
from ariac_score.trial.vocabulary import QUANTITIES

EXIT_BROKEN = 1
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
    show.add_argument("name", metavar="NAME")
    show.set_defaults(run=run_show)
    check = actions.add_parser(
        "check",
        help="check whether a plugin keeps its contract",
        description="Try the contract of a plugin on a trial. Exit codes: 0 kept, 1 broken.",
    )
    check.add_argument("name", metavar="NAME")
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
    check.set_defaults(run=run_check)
    doctor = add_action(actions, "doctor", "find everything that is wrong with installed plugins")
    doctor.set_defaults(run=run_doctor)


# list ----------------------------------------------------------------------------------


def run_list(arguments: argparse.Namespace) -> int:
    """Print each plugin, with the reason for one that cannot be used."""
    registry = Registry()
    rows = [_row(registry, plugin) for group in GROUPS for plugin in registry.all(group)]
    if arguments.output_format == "json":
        print(json.dumps(rows, indent=1, ensure_ascii=False))
    for row in rows if arguments.output_format == "text" else ():
        code = f" {row['sha256'][:16]}" if arguments.hash else ""
        about = row["problem"] or row["summary"]
        print(f"{row['kind']:<9} {row['name']:<30} {row['distribution']} {row['version']:<8}{code} {about}")
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


def _row(registry: Any, plugin: Any) -> dict[str, str]:
    """A plugin as `list` shows it; `problem` is why it cannot be used."""
    row = {
        "kind": plugin.group.rpartition(".")[2],
        "name": plugin.name,
        "distribution": plugin.distribution,
        "version": plugin.version,
        "target": plugin.target,
        "sha256": "",
        "summary": "",
        "problem": "",
    }
    try:
        row["summary"] = _summary(plugin.load())
        row["sha256"] = package_sha256(plugin.package)
    except PluginError as error:
        row["problem"] = f"BROKEN: {error.cause}"
    try:
        registry.find(plugin.group, plugin.name)
    except PluginError as error:
        row["problem"] = f"CANNOT BE USED: {error.cause}"
    return row


def _summary(kind: Any) -> str:
    """The first line of what a class says about itself."""
    words = (kind.__doc__ or "").strip().partition("\n")[0]
    # A dataclass without a docstring is given its signature for one: `Bad(limit_m: float = 1.0)`.
    return "(no description)" if not words or words.startswith(f"{kind.__name__}(") else words


# show ----------------------------------------------------------------------------------


def run_show(arguments: argparse.Namespace) -> int:
    """Print the distribution of a plugin, then its documentation."""
    for plugin in _named(arguments.name):
        kind = plugin.group.rpartition(".")[2].removesuffix("s")
        page = plugin_page(plugin)
        print(f"{kind} of {plugin.distribution} {plugin.version}, {plugin.target}")
        print(f"code {package_sha256(plugin.package)}\n")
        sys.stdout.write("".join(f"{plain(line)}\n" for line in page.splitlines()))
    return 0


def _named(name: str) -> list[Any]:
    """The plugins of that name, whatever their kind.

    Raises:
        PluginNotFoundError: Nobody provides it.
        PluginConflictError: Two distributions do.
    """
    registry = Registry()
    groups = [group for group in GROUPS if name in registry.names(group)]
    if not groups:
        known = [known for group in GROUPS for known in registry.names(group)]
        raise PluginNotFoundError(
            f"no installed distribution provides {name!r}",
            hint=did_you_mean(name, known, what="installed") + unreadable_hint(),
        )
    return [registry.find(group, name) for group in groups]


# check ---------------------------------------------------------------------------------


def run_check(arguments: argparse.Namespace) -> int:
    """Try every check of a plugin's contract and print the outcome of each."""
    budget_s = BUDGET_S if arguments.budget is None else arguments.budget
    if not budget_s > 0:
        raise UsageError(f"a budget of {budget_s:g} s is none", hint="give a positive number of seconds")
    code = 0
    for plugin in _named(arguments.name):
        subject = _subject(plugin, arguments)
        try:
            built = plugin.build(example_parameters(plugin))
            checks = contract_checks(built, subject, budget_s=budget_s, log_map=arguments.log_map)
        except ScoreError as error:
            _outcome("built", error)
            return EXIT_BROKEN
        what = arguments.trial.name if arguments.trial else "the made trial"
        print(f"{plugin.origin}: {len(checks)} checks on {what}")
        for check in checks:
            try:
                unseen = check.run()
            except ScoreError as error:
                _outcome(check.name, error)
                code = EXIT_BROKEN
            else:
                print(f"  kept    {check.name:<24} {f'but {plain(unseen)}' if unseen else check.about}")
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
    return made_trial() if arguments.trial is None else _read(arguments, orders=kind == "rules")


def _read(arguments: argparse.Namespace, *, orders: bool) -> Any:
    """The trial of a log, with every quantity it has."""
    registry = Registry()
    mapping = load_log_map(arguments.log_map) if arguments.log_map else LogMap("none")
    bundle, readers = find_trial(arguments.trial, registry)
    wanted = [*QUANTITIES, *mapping.quantities]
    return read_trial(bundle, readers, mapping, registry, quantities=wanted, orders=orders)


# doctor --------------------------------------------------------------------------------


def run_doctor(_arguments: argparse.Namespace) -> int:
    """Print every problem with its remedy."""
    found = ailments()
    for ailment in found:
        print(f"{plain(ailment.origin)}: {plain(ailment.problem)}\n  hint: {plain(ailment.hint)}")
    if not found:
        print("every installed plugin can be used")
    return EXIT_BROKEN if found else 0
