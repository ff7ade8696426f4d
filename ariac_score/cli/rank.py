"""`ariac-score rank COMPETITION`: rank the teams of a competition."""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ariac_score.batch.bucket import fetched_batch
from ariac_score.batch.results import results_of_batch
from ariac_score.cli.notes import is_quiet, note
from ariac_score.cli.outcome import FORMAT_HELP, MOST_NAMED
from ariac_score.cli.partial import add_partial
from ariac_score.engine.prepared import log_map_of
from ariac_score.errors import ScoreError, UsageError
from ariac_score.ranking.adjusting import adjusted_ranking
from ariac_score.ranking.compare import differences
from ariac_score.ranking.competition import Competition, RunKey, load_competition, signed_for, signers_of
from ariac_score.ranking.design import designs
from ariac_score.ranking.evaluation import Evaluation, evaluation_program, strict_evaluation
from ariac_score.ranking.outcomes import Ranking
from ariac_score.ranking.publication import StoredResult, ranking_json
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.resampling import sampled
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import Spec, ranking_spec
from ariac_score.ranking.statistics import Statistics, rank_statistics
from ariac_score.ranking.stored import write_results
from ariac_score.report.ranking import design_text, ranking_csv, ranking_text, strict_text
from ariac_score.results.adjustments import load_adjustments
from ariac_score.results.cohort_file import cohort_text
from ariac_score.results.signing import keys_asked_for, refuse_unsigned
from ariac_score.scoring.ruleset import RuleSet, load_rule_set
from ariac_score.terminal.output import counting_bar, refuse_inputs, write
from ariac_score.terminal.style import Style, plain, style_for

EXIT_UNDECIDED = 6
_UNSETTLED = ("undecided", "unreadable", "refused", "no_value")


def register(commands: Any) -> None:
    """Add the command."""
    parser = commands.add_parser(
        "rank",
        description="Rank a competition: a competition.yaml, or a folder with the official layout "
        "logs/<team>/<trial>_<n>. A run that cannot be scored is named and does not stop the others.",
    )
    parser.add_argument("path", type=Path, metavar="COMPETITION", help="competition.yaml, or its folder")
    parser.add_argument(
        "--rules", default="", metavar="NAME", help="rule set instead of the competition's own"
    )
    parser.add_argument(
        "--policy",
        choices=("robust", "strict"),
        default="robust",
        help="robust: a run without a score is named and counts 0; strict: as in the organisers' program",
    )
    parser.add_argument("--output-format", choices=("text", "csv", "json"), help=FORMAT_HELP)
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help="write to FILE instead of stdout")
    parser.add_argument(
        "--cohort-output",
        type=Path,
        metavar="FILE",
        help="also write the values across teams, for 'score --cohort'",
    )
    parser.add_argument(
        "--adjustments",
        type=Path,
        metavar="FILE",
        help="adjustments.yaml of the stewards, instead of the competition's own; both rankings are shown",
    )
    parser.add_argument(
        "--results",
        type=Path,
        metavar="DIR",
        help="also write every run's result as DIR/<team>/<trial>_<n>.json",
    )
    parser.add_argument(
        "--batch",
        metavar="DIR",
        help="take the results from this folder, which 'batch' wrote, instead of scoring; also by URI",
    )
    parser.add_argument(
        "--mixed-code",
        action="store_true",
        help="with --batch: take results that other code than the installed made",
    )
    parser.add_argument(
        "--public-key",
        default="",
        metavar="KEY",
        help="who must have signed stored results, tables and decisions; default: whom the competition or "
        "its rules name (authority: signed_by), if anybody",
    )
    parser.add_argument(
        "--design",
        type=float,
        metavar="POINTS",
        help="say instead how many trials and runs would tell teams apart that differ by POINTS a trial",
    )
    add_partial(parser, "also rank runs whose logs are cut off, by what is there; the ranking is unofficial")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Score every run, rank, show."""
    for output in (arguments.output, arguments.cohort_output):
        refuse_inputs(output, arguments.path)
    competition = load_competition(arguments.path, arguments.rules)
    rule_set = load_rule_set(competition.rules)
    spec = ranking_spec(rule_set, competition.ranking, file=str(competition.file))
    if arguments.policy == "strict":
        return _strict(arguments, competition, rule_set, spec)
    for words in said_beforehand(competition, rule_set):
        note(arguments, words)
    keys = keys_asked_for(signers_of(competition, rule_set.authority), str(arguments.public_key))
    refuse_unsigned_decisions(arguments.adjustments, competition, keys)
    if arguments.batch is not None:
        with fetched_batch(arguments.batch) as folder:
            results = results_of_batch(
                folder,
                competition,
                rule_set,
                sketches=arguments.results is not None,
                mixed_code=arguments.mixed_code,
                signed_by=keys,
            )
    else:
        with counting_bar("scoring", len(competition.runs), quiet=is_quiet(arguments)) as step:
            results = score_runs(
                competition,
                rule_set,
                progress=lambda done, run: step(done, f"{run.team}/{run.trial}_{run.number}"),
                sketches=arguments.results is not None,
                partial=bool(arguments.partial),
                signed_by=keys,
                remark=lambda words: note(arguments, words),
            )
    ranked = rank_results(competition, spec, rule_set, results, partial=bool(arguments.partial))
    ranking = adjusted_by_stewards(arguments.adjustments, competition, spec, rule_set, ranked)
    if arguments.design is not None:
        sizes = designs(sampled(ranking, spec, rule_set.digits), spec, arguments.design)
        write(design_text(sizes, arguments.design, len(ranking.standings)), arguments.output)
        return 0
    statistics = rank_statistics(ranking, spec, rule_set.digits)
    after = rank_statistics(ranking.stewarded.ranking, spec, rule_set.digits) if ranking.stewarded else None
    stored = _write_more(arguments, ranking)
    _show(
        arguments,
        _Shown(ranking, spec, statistics, after),
        evaluation_of(competition, rule_set, spec),
        stored,
    )
    return exit_code(ranking, listed=arguments.output_format == "text")


def said_beforehand(competition: Competition, rule_set: RuleSet) -> Iterator[str]:
    """What a reader of the ranking should know of its runs."""
    stored = sum(run.path.suffix == ".json" for run in competition.runs)
    if stored:
        yield (
            f"{stored} of {len(competition.runs)} runs are stored results: they are priced again, and "
            "not compared with their logs, which 'verify RESULT --log LOG' does"
        )
    if {"keep", "missing_run"} & {*rule_set.ranking, *competition.ranking}:
        return
    for trial in competition.trials:
        made = {
            team.id: sum(key[:2] == (team.id, trial.id) for key in _keys(competition))
            for team in competition.teams
        }
        if len({number for number in made.values() if number}) > 1:
            most, fewest = max(made, key=lambda t: made[t]), min(made, key=lambda t: made[t] or math.inf)
            yield (
                f"{trial.id}: {most} made {made[most]} runs and {fewest} {made[fewest]}, and nothing "
                "declares how many count, so the best of each counts: write 'ranking: {keep: 1}' if that "
                "is meant, or 'missing_run:'"
            )
            return


def _keys(competition: Competition) -> Iterator[RunKey]:
    yield from (run.key for run in competition.runs)
    yield from competition.refused


def exit_code(ranking: Ranking, *, listed: bool) -> int:
    """6 when a run is unsettled or open, or a team that is not disqualified has no rank; else 0.

    Args:
        ranking: Of all teams.
        listed: Whether its unusual runs were shown; otherwise those that do not count are named here.
    """
    final = ranking.stewarded.ranking if ranking.stewarded else ranking
    out = {standing.team for standing in final.standings if standing.disqualified}
    unsettled = [run for run in final.runs if run.outcome in _UNSETTLED and run.team not in out]
    if unsettled:
        for run in () if listed else unsettled:
            print(plain(f"{run.team}/{run.trial}_{run.number}: {run.reason}"), file=sys.stderr)
        print(
            f"{len(unsettled)} of {len(ranking.runs)} runs have no score of their own; each is named above",
            file=sys.stderr,
        )
    # A run that is open, and whose team has one score whatever it is worth, leaves nothing open.
    ends = {standing.team: standing.open.execution for standing in final.standings if standing.open}
    decided = out | {team for team, of in ends.items() if of.least == of.most}
    open_ = dict.fromkeys(run.team for run in final.runs if run.open is not None and run.team not in decided)
    if open_ and not listed:
        teams = ", ".join(list(open_)[:MOST_NAMED]) + (", …" if len(open_) > MOST_NAMED else "")
        print(plain(f"logs leave open what {teams} scored"), file=sys.stderr)
    placeless = any(s.rank is None and not s.disqualified for s in final.standings)
    return EXIT_UNDECIDED if unsettled or open_ or placeless else 0


@dataclass(frozen=True)
class _Shown:
    """A ranking with its statistics."""

    ranking: Ranking
    spec: Spec
    statistics: Statistics
    adjusted: Statistics | None

    @property
    def final(self) -> Statistics:
        """That of the ranking that counts."""
        return self.adjusted or self.statistics


def refuse_unsigned_decisions(file: Path | None, competition: Competition, keys: Sequence[str]) -> None:
    """Refuse decisions of stewards that nobody vouches for whose key is asked for.

    Raises:
        ResultError: Nobody does.
    """
    file = file or competition.adjustments
    if file is not None:
        refuse_unsigned(file, keys, competition=signed_for(competition))


def adjusted_by_stewards(
    file: Path | None, competition: Competition, spec: Spec, rule_set: RuleSet, ranking: Ranking
) -> Ranking:
    """The ranking with the decisions of the stewards, where there are any."""
    file = file or competition.adjustments
    if file is None:
        return ranking
    return adjusted_ranking(competition, spec, rule_set, ranking, load_adjustments(file))


def evaluation_of(competition: Competition, rule_set: RuleSet, spec: Spec) -> Evaluation | None:
    """The organisers' own evaluation, where the rules name one and the runs have its input."""
    if not spec.strict:
        return None
    try:
        return _evaluated(competition, rule_set, spec)
    except ScoreError as error:
        print(f"not compared with the organisers' own program: {plain(str(error))}", file=sys.stderr)
        return None


def _evaluated(competition: Competition, rule_set: RuleSet, spec: Spec) -> Evaluation:
    return strict_evaluation(competition, spec.strict, log_map_of(rule_set))


def _strict(arguments: argparse.Namespace, competition: Competition, rule_set: RuleSet, spec: Spec) -> int:
    """Show the output of the organisers' own program: its CSV, or its leaderboard."""
    if arguments.adjustments is not None:
        raise UsageError(
            "the organisers' own program knows no stewards", hint="drop --adjustments, or --policy strict"
        )
    if not spec.strict:
        raise UsageError(
            f"{rule_set.id} names no program of the organisers to reproduce",
            hint="rank with --policy robust, or by rules with 'ranking: {strict: …}'",
        )
    if arguments.output_format == "json":
        raise UsageError(
            "the strict policy writes text or csv",
            hint="--policy robust --output-format json holds the strict evaluation as well",
        )
    evaluation = _evaluated(competition, rule_set, spec)
    as_csv = arguments.output_format == "csv"
    text = evaluation_program(spec.strict).results_csv(evaluation) if as_csv else strict_text(evaluation)
    write(text, arguments.output)
    if evaluation.stops and arguments.output_format == "csv":
        print(strict_text(evaluation), file=sys.stderr, end="")
    return EXIT_UNDECIDED if evaluation.stops else 0


def _show(
    arguments: argparse.Namespace,
    shown: _Shown,
    strict: Evaluation | None,
    stored: Mapping[RunKey, StoredResult],
) -> None:
    ranking = shown.ranking
    found = differences(strict, ranking) if strict else ()
    if arguments.output_format == "json":
        text = ranking_json(
            ranking,
            shown.spec,
            shown.statistics,
            shown.adjusted,
            strict,
            found,
            folder=_relative(arguments.results, arguments.output) if stored else "",
            results=stored,
        )
    elif arguments.output_format == "csv":
        text = ranking_csv(ranking, shown.final)
    else:
        style = Style() if arguments.output else style_for(sys.stdout)
        text = ranking_text(ranking, strict, found, style, shown.final)
    write(text, arguments.output)


def _relative(results: Path, output: Path | None) -> str:
    """The folder of the results as the file of the ranking names it."""
    base = output.resolve().parent if output else Path.cwd()
    try:
        return Path(os.path.relpath(results.resolve(), base)).as_posix()
    except ValueError:  # another drive
        return results.resolve().as_posix()


def _write_more(arguments: argparse.Namespace, ranking: Ranking) -> dict[RunKey, StoredResult]:
    """Write the cohort and the single results, where the arguments name files for them."""
    if arguments.cohort_output is not None:
        if ranking.cohort is None:
            raise UsageError(
                "these rules compare no teams, so there is no cohort", hint="drop --cohort-output"
            )
        write(cohort_text(ranking.cohort), arguments.cohort_output)
    if arguments.results is None:
        return {}
    return write_results(ranking, arguments.results, write)
