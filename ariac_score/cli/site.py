"""`ariac-score report COMPETITION -o site/`: a competition as a folder of pages."""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

from ariac_score.cli.notes import counted, is_quiet, note
from ariac_score.cli.partial import add_partial
from ariac_score.cli.rank import (
    adjusted_by_stewards,
    evaluation_of,
    exit_code,
    refuse_unsigned_decisions,
    said_beforehand,
)
from ariac_score.errors import RuleSetError, ScoreError, UsageError
from ariac_score.ranking.compare import differences
from ariac_score.ranking.competition import Competition, RunKey, load_competition, registry_for, signers_of
from ariac_score.ranking.outcomes import Ranking
from ariac_score.ranking.publication import Publication, load_publication, ranking_json
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import ranking_spec
from ariac_score.ranking.statistics import rank_statistics
from ariac_score.ranking.stored import results_folder, write_results
from ariac_score.report.site.site import Site, write_site
from ariac_score.results.result import Result
from ariac_score.review.sensitivity import RankSensitivity, rank_sensitivity
from ariac_score.review.sensitivity_file import load_rank_sensitivity
from ariac_score.review.what_if import MOST_POINTS, WhatIf, check_grid, explore
from ariac_score.scoring.ruleset import RuleSet, load_rule_set
from ariac_score.terminal.output import counting_bar, write

__all__ = ["is_competition", "refuse_site_arguments", "site_of_competition", "site_of_ranking"]

NOW = "now"
"""`--sensitivity now`: compute it while making the site."""
_RANKING = Path("data/ranking.json")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options that only a competition has."""
    parser.add_argument(
        "--rules", default="", metavar="NAME", help="competition: rule set instead of its own"
    )
    parser.add_argument(
        "--adjustments",
        type=Path,
        metavar="FILE",
        help="competition: adjustments.yaml of the stewards, instead of the competition's own",
    )
    parser.add_argument(
        "--results", type=Path, metavar="DIR", help="ranking: folder of its results, if they were moved"
    )
    parser.add_argument(
        "--previous",
        type=Path,
        metavar="OLD",
        help="competition or ranking: show what changed since this ranking.json, or folder of a site",
    )
    parser.add_argument(
        "--sensitivity",
        metavar="FILE|now",
        help="competition or ranking: show this output of 'sensitivity -o FILE.json'; "
        "'now' computes it, which may take minutes",
    )
    parser.add_argument(
        "--what-if",
        action="append",
        metavar="NAME=A,B,C",
        help="competition: show the ranking with these values of a number of the rules, each with each "
        "where given more than once; instead of 'what_if:' in competition.yaml",
    )
    add_partial(parser, "competition: also rank runs whose logs are cut off; the ranking is unofficial")


def refuse_site_arguments(arguments: argparse.Namespace) -> None:
    """Refuse options that only a competition has.

    Raises:
        UsageError: One of these options is given.
    """
    for name in ("rules", "adjustments", "results", "previous", "sensitivity", "what_if", "partial"):
        if getattr(arguments, name):
            option = f"--{name.replace('_', '-')}"
            raise UsageError(
                f"{option} is for the site of a competition, and this is one trial",
                file=arguments.result,
                hint=f"drop {option}",
            )


def is_competition(path: Path) -> bool:
    """Whether a path is that of a competition, and not of a result or ranking."""
    return path.is_dir() or path.suffix in (".yaml", ".yml")


def site_of_competition(arguments: argparse.Namespace) -> int:
    """Score every run, rank, and make the site."""
    out = _out(arguments)
    competition = load_competition(arguments.result, arguments.rules, may_be_empty=True)
    rule_set = load_rule_set(competition.rules)
    spec = ranking_spec(rule_set, competition.ranking, file=str(competition.file))
    if not competition.runs and not competition.refused:
        words = "no run was found, so the site has no ranks yet: 'rank' says where runs are looked for"
        note(arguments, words)
    for words in said_beforehand(competition, rule_set):
        note(arguments, words)
    keys = signers_of(competition, rule_set.authority)
    refuse_unsigned_decisions(arguments.adjustments, competition, keys)
    previous = _previous(arguments)
    grid = _grid(arguments, competition, rule_set)
    with counting_bar("scoring", len(competition.runs), quiet=is_quiet(arguments)) as step:
        results = score_runs(
            competition,
            rule_set,
            progress=lambda done, run: step(done, f"{run.team}/{run.trial}_{run.number}"),
            sketches=True,
            partial=bool(arguments.partial),
            signed_by=keys,
            remark=lambda words: note(arguments, words),
        )
    ranked = rank_results(competition, spec, rule_set, results, partial=bool(arguments.partial))
    ranking = adjusted_by_stewards(arguments.adjustments, competition, spec, rule_set, ranked)
    strict = evaluation_of(competition, rule_set, spec) if competition.runs else None
    found = differences(strict, ranking) if strict else ()
    sensitivity = _sensitivity(arguments, ranking, competition, rule_set, results)
    what_if = _what_if(grid, competition, rule_set, results)
    after = ranking.stewarded
    # The site is made of stored files alone, so that one of a stored ranking is the same.
    with TemporaryDirectory() as folder:
        stored = write_results(ranking, Path(folder), write)
        text = ranking_json(
            ranking,
            spec,
            rank_statistics(ranking, spec, rule_set.digits),
            rank_statistics(after.ranking, spec, rule_set.digits) if after else None,
            strict,
            found,
            folder="results" if stored else "",
            results=stored,
        )
        file = Path(folder) / "ranking.json"
        write(text, file)
        _make(arguments, file, Path(folder), out, previous, sensitivity, what_if)
    return exit_code(ranking, listed=False)


def site_of_ranking(arguments: argparse.Namespace) -> int:
    """Make the site of a stored ranking, without any log."""
    out = _out(arguments)
    publication = load_publication(arguments.result)
    if arguments.sensitivity == NOW:
        raise UsageError(
            "a stored ranking has no runs to vary parameters of",
            hint="give the output of 'sensitivity COMPETITION -o FILE.json'",
        )
    for name in ("rules", "adjustments", "what_if", "partial"):
        if getattr(arguments, name):
            given = f"--{name.replace('_', '-')}"
            raise UsageError(
                f"{given} does not apply to a stored ranking", hint="drop it, or give the competition"
            )
    previous = _previous(arguments)
    sensitivity = _sensitivity(arguments, publication.ranking)
    folder = arguments.results or results_folder(publication, arguments.result)
    if folder is not None and not folder.is_dir():
        raise UsageError(
            "the results of this ranking are not here",
            file=folder,
            hint="give their folder with --results, or rank again with --results DIR",
        )
    _make(arguments, arguments.result, folder, out, previous, sensitivity)
    return exit_code(publication.ranking, listed=False)


def _out(arguments: argparse.Namespace) -> Path:
    out: Path | None = arguments.output
    if out is None:
        raise UsageError("the site of a competition needs a folder", hint="give one with -o FOLDER")
    source = arguments.result.resolve()
    if source.is_dir() and out.resolve() in (source, *source.parents):
        raise UsageError(
            "the site would be written into the competition itself", file=out, hint="name another folder"
        )
    return out


def _previous(arguments: argparse.Namespace) -> Publication | None:
    path: Path | None = arguments.previous
    if path is None:
        return None
    return load_publication(path / _RANKING if path.is_dir() else path)


def _sensitivity(
    arguments: argparse.Namespace,
    ranking: Ranking,
    competition: Competition | None = None,
    rule_set: RuleSet | None = None,
    results: dict[RunKey, Result | ScoreError] | None = None,
) -> Sequence[RankSensitivity] | None:
    if arguments.sensitivity is None:
        return None
    if arguments.sensitivity == NOW and competition is not None:
        assert rule_set is not None  # given together
        assert results is not None
        return rank_sensitivity(competition, rule_set, results, registry=registry_for(competition))
    return load_rank_sensitivity(Path(arguments.sensitivity), ranking.competition, ranking.rule_set)


def _grid(
    arguments: argparse.Namespace, competition: Competition, rule_set: RuleSet
) -> Mapping[str, Sequence[float]]:
    """The numbers to vary and their values: those of the command line, or else of the competition.

    Raises:
        RuleSetError: They cannot be computed; named by the option where it is at fault.
    """
    given = dict(map(_values, arguments.what_if or ()))
    grid = given or competition.what_if
    try:
        check_grid(competition, rule_set, grid, registry_for(competition))
    except RuleSetError as error:
        if given:
            error.file, error.place = "--what-if", ""
        raise
    return grid


def _what_if(
    grid: Mapping[str, Sequence[float]],
    competition: Competition,
    rule_set: RuleSet,
    results: dict[RunKey, Result | ScoreError],
) -> WhatIf | None:
    """The ranking under other numbers; `None` where none are named."""
    if not grid or not results:
        return None
    with counting_bar("what if", MOST_POINTS) as step:
        return explore(
            competition,
            rule_set,
            results,
            grid,
            registry=registry_for(competition),
            progress=lambda done, all_: step(done, f"of {all_}"),
        )


def _values(text: str) -> tuple[str, tuple[float, ...]]:
    """A number of the rules and the values it may have.

    Raises:
        UsageError: The text is something else.
    """
    name, sign, values = text.partition("=")
    try:
        numbers = tuple(float(value) for value in values.split(","))
    except ValueError:
        numbers = ()
    if not name or not sign or not numbers or not all(map(math.isfinite, numbers)):
        raise UsageError(
            f"--what-if {text!r} is no name with numbers", hint="write --what-if separation_weight=0.2,0.4"
        )
    return name, numbers


def _make(
    arguments: argparse.Namespace,
    file: Path,
    folder: Path | None,
    out: Path,
    previous: Publication | None,
    sensitivity: Sequence[RankSensitivity] | None,
    what_if: WhatIf | None = None,
) -> None:
    publication = load_publication(file)
    site = Site(publication, folder, previous, sensitivity, what_if)
    with counting_bar("drawing", len(publication.results), quiet=is_quiet(arguments)) as step:
        count = write_site(site, out, write, progress=step)
    note(arguments, f"{counted(count, 'file')} in {out}; open {out / 'index.html'}")
