"""Checking a published ranking: in itself, with its results, and against the logs of its competition."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from ariac_score.documents.plain_file import read_plain
from ariac_score.engine.prepared import log_map_of
from ariac_score.errors import CutOffError, ScoreError
from ariac_score.ranking.adjusting import adjusted_ranking
from ariac_score.ranking.compare import differences as from_organisers
from ariac_score.ranking.competition import Competition, RunKey, load_competition, signed_for, signers_of
from ariac_score.ranking.evaluation import Evaluation, strict_evaluation
from ariac_score.ranking.outcomes import TeamRank
from ariac_score.ranking.publication import PUBLICATION, Publication, load_publication, ranking_json
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import Spec, ranking_spec
from ariac_score.ranking.statistics import rank_statistics
from ariac_score.ranking.stored import read_stored, results_folder, write_results
from ariac_score.results.adjustments import Adjustments, load_adjustments
from ariac_score.results.codec import MAX_BYTES
from ariac_score.results.result import Result
from ariac_score.results.result_file import load_result
from ariac_score.results.signing import check_signature, keys_asked_for
from ariac_score.review.computed_again import installed_rules, other_versions
from ariac_score.review.differences import SHOWN, differences, listed
from ariac_score.review.steps import FAILED, NOTE, OK, OPEN, Step, Verification
from ariac_score.scoring.ruleset import RuleSet, load_rule_set

__all__ = ["verify_ranking"]

_NO_LOGS = (
    "not compared with its logs, so what its runs scored is the word of the file and its results alone; "
    "--log COMPETITION computes all of it again"
)


def verify_ranking(
    path: Path,
    *,
    log: Path | None = None,
    rules: str = "",
    adjustments: Path | None = None,
    public_key: str = "",
    signature: Path | None = None,
) -> Verification:
    """Check a published ranking.

    Args:
        path: What `rank -o FILE.json` wrote.
        log: The competition; then every run is scored again from its log, and all of them are ranked again.
        rules: The rule set it must be by; without it, that of the competition, or the installed one.
        adjustments: The stewards' file, where the ranking is adjusted; without it, that of the competition.
        public_key: Whose signature it must have; empty for whom the competition or the rules name.
        signature: The file of that; by default next to the ranking.

    Raises:
        ScoreError: The competition, the rules or the decisions cannot be read.
    """
    competition = None if log is None else load_competition(log, rules)
    try:
        publication = load_publication(path)
    except ScoreError as error:
        place = f"{error.place}: " if error.place else ""
        return Verification((Step("sums", FAILED, f"{place}{error.cause}"),), None, "a ranking")
    about = f"ranking of {publication.competition} by {publication.rule_set.id}"
    steps = [Step("sums", OK, f"{len(publication.runs)} runs of {len(publication.standings)} teams")]
    steps += _written(path, publication)
    steps.append(_ranks(publication))
    rule_set, step = _rules(publication, rules, competition)
    steps.append(step)
    named = () if rule_set is None else rule_set.authority.signed_by
    if competition is not None and rule_set is not None:
        named = signers_of(competition, rule_set.authority)
    keys = keys_asked_for(named, public_key)
    if keys:
        holds, reason = check_signature(path, keys, signature)
        steps.append(Step("signature", OK if holds else FAILED, reason))
    steps += _results(publication, path)
    decided = adjustments or (None if competition is None else competition.adjustments)
    decisions = None if decided is None else load_adjustments(decided)
    steps += _decided(publication, decisions)
    if decided is not None and keys:
        holds, reason = check_signature(
            decided, keys, competition="" if competition is None else signed_for(competition)
        )
        steps.append(Step("decisions", OK if holds else FAILED, reason))
    if competition is None or rule_set is None:
        words = _NO_LOGS if competition is None else "without its rules nothing can be computed again"
        return Verification((*steps, Step("log", OPEN, words)), None, about)
    steps += _again(publication, path, competition, rule_set, decisions, keys)
    return Verification(tuple(steps), None, about)


def _written(path: Path, publication: Publication) -> Iterator[Step]:
    text = read_plain(path, MAX_BYTES).decode("utf-8")
    if PUBLICATION.text(publication) == text:
        yield Step("bytes", OK, "as they are written")
    elif _tag(text) != PUBLICATION.tag:
        yield Step("bytes", NOTE, f"{_tag(text)} is read, but no longer written; its values were compared")
    else:
        yield Step("bytes", FAILED, "written in another way")


def _tag(text: str) -> str:
    """The format that the file of a ranking states; it was read, so it states one."""
    return str(json.loads(text)["schema"])


def _ranks(publication: Publication) -> Step:
    """Whether ranks go with values: better ones first, and only equal ones share a rank."""
    highest = publication.how.best == "highest"
    for ranking in (publication.ranking, publication.final):
        before: TeamRank | None = None
        for position, team in enumerate(ranking.standings, start=1):
            if team.rank is None or team.value is None:
                continue
            place = f"{team.team} has rank {team.rank}"
            if team.rank != position and (before is None or team.rank != before.rank):
                return Step("ranks", FAILED, f"{place} and stands at place {position}")
            if before is not None and before.value is not None and before.value != team.value:
                better = (team.value > before.value) is highest
                if better or team.rank == before.rank:
                    words = f"{place} with {team.value}, and {before.team} {before.rank} with {before.value}"
                    return Step("ranks", FAILED, words)
            before = team
    return Step("ranks", OK, "they go with the values")


def _rules(
    publication: Publication, rules: str, competition: Competition | None
) -> tuple[RuleSet | None, Step]:
    """The rules that are trusted, and whether the ranking is by them."""
    stated = publication.rule_set
    named = rules or (competition.rules if competition is not None else "")
    rule_set = load_rule_set(named) if named else installed_rules(stated.id)
    if rule_set is None:
        words = (
            f"{stated.id} is not installed here, so its rules are the word of the file alone; --rules NAME"
        )
        return None, Step("rules", OPEN, words)
    if (rule_set.id, rule_set.sha256) != (stated.id, stated.sha256):
        here = f"{rule_set.id}, sha256 {rule_set.sha256[:16]}…"
        words = f"it is by {stated.id}, sha256 {stated.sha256[:16]}…; here {here}"
        return rule_set, Step("rules", FAILED, words)
    return rule_set, Step("rules", OK, f"{stated.id}, sha256 {stated.sha256[:16]}…")


def _results(publication: Publication, path: Path) -> Iterator[Step]:
    """Whether the results that it names are there, and those that were ranked."""
    folder = results_folder(publication, path)
    if folder is None:
        return
    faults = []
    runs = {run.key: run for run in publication.ranking.runs}
    for key, stored in publication.results.items():
        try:
            read_stored(stored, folder, runs[key], publication.rule_set)
        except ScoreError as error:
            faults.append(f"{'/'.join(map(str, key))}: {error.cause}")
    if faults:
        more = [f"and {len(faults) - SHOWN} more"] if len(faults) > SHOWN else []
        yield Step("results", FAILED, "\n".join([*faults[:SHOWN], *more]))
    else:
        yield Step(
            "results", OK, f"{len(publication.results)}, each with its hash, its score and these rules"
        )


def _decided(publication: Publication, decisions: Adjustments | None) -> Iterator[Step]:
    adjusted = publication.adjusted
    if adjusted is None:
        if decisions is not None:
            yield Step("adjustments", FAILED, "the ranking is automatic, and there are decisions of stewards")
    elif decisions is None:
        words = "the decisions are the word of the file alone; --adjustments FILE compares them"
        yield Step("adjustments", OPEN, words)
    elif decisions.sha256 != adjusted.sha256:
        yield Step("adjustments", FAILED, f"sha256 {adjusted.sha256[:16]}…, here {decisions.sha256[:16]}…")
    else:
        yield Step("adjustments", OK, f"sha256 {decisions.sha256[:16]}…")


# Against the logs ----------------------------------------------------------------------


def _again(
    publication: Publication,
    path: Path,
    competition: Competition,
    rule_set: RuleSet,
    decisions: Adjustments | None,
    keys: Sequence[str],
) -> Iterator[Step]:
    stored = sum(run.path.suffix == ".json" for run in competition.runs)
    if stored:
        words = (
            f"{stored} runs of the competition are stored results: 'verify RESULT --log LOG' compares each"
        )
        yield Step("log", OPEN, words)
    text = read_plain(path, MAX_BYTES).decode("utf-8")
    again = _computed(publication, competition, rule_set, decisions, keys, partial=False)
    if again.text != text and again.is_cut:
        partial = _computed(publication, competition, rule_set, decisions, keys, partial=True)
        again = partial if partial.text == text else again
    if again.text == text:
        yield Step("recomputed", OK, "the same to the byte")
        return
    before, after = json.loads(text), json.loads(again.text)
    if _tag(text) != PUBLICATION.tag:
        before = json.loads(PUBLICATION.text(publication))
        after["statistics"] = None
        if after["adjusted"] is not None:
            after["adjusted"]["statistics"] = None
        words = f"how sure {_tag(text)} says it is, nothing here computes any more; 'rank' says it anew"
        yield Step("statistics", OPEN, words)
    if before.get("strangers") != after["strangers"]:
        yield Step("strangers", NOTE, "other files lie among the runs than did then")
        before = {**before, "strangers": after["strangers"]}
    found = differences(before, after)
    if not found:
        yield Step("recomputed", OK, "the same in every value")
        return
    # Where values differ, so do the files of results, which say nothing more.
    values = [each for each in found if each[0][:1] + each[0][2:] != ("runs", "result", "sha256")]
    words = (
        listed(values, "in the ranking", "computed again")
        if values
        else "the same scores and ranks, in results that are other files"
    )
    yield Step("recomputed", FAILED, "\n".join([words, *_other_code(publication, path, again.results)]))


def _other_code(
    publication: Publication, path: Path, again: Mapping[RunKey, Result | ScoreError]
) -> Iterator[str]:
    """Where the first result that is kept with the ranking was made by other code than this."""
    folder = results_folder(publication, path)
    if folder is None:
        return
    for key, stored in publication.results.items():
        now = again.get(key)
        try:
            then = load_result(folder / stored.file)
        except ScoreError:
            continue  # a step of its own names it
        if isinstance(now, Result):
            yield from other_versions(then.provenance, now.provenance)
            return


@dataclass(frozen=True)
class _Computed:
    """A ranking computed again: its text, whether a log is cut off, what each run gave."""

    text: str
    is_cut: bool
    results: Mapping[RunKey, Result | ScoreError]


def _computed(
    publication: Publication,
    competition: Competition,
    rule_set: RuleSet,
    decisions: Adjustments | None,
    keys: Sequence[str],
    *,
    partial: bool,
) -> _Computed:
    spec = ranking_spec(rule_set, competition.ranking, file=str(competition.file))
    results = score_runs(
        competition, rule_set, sketches=bool(publication.folder), partial=partial, signed_by=keys
    )
    ranking = rank_results(competition, spec, rule_set, results, partial=partial)
    if decisions is not None and publication.adjusted is not None:
        ranking = adjusted_ranking(competition, spec, rule_set, ranking, decisions)
    strict = _strict(competition, rule_set, spec)
    after = ranking.stewarded
    with TemporaryDirectory() as folder:
        stored = write_results(ranking, Path(folder), _nowhere) if publication.folder else {}
    text = ranking_json(
        ranking,
        spec,
        rank_statistics(ranking, spec, rule_set.digits),
        rank_statistics(after.ranking, spec, rule_set.digits) if after else None,
        strict,
        from_organisers(strict, ranking) if strict else (),
        folder=publication.folder,
        results=stored,
    )
    if decisions is None and publication.adjusted is not None:
        # Nobody says what was decided, so that part is left as it is; a step of its own says so.
        computed = PUBLICATION.decoded(text.encode("utf-8"), Path())
        text = PUBLICATION.text(replace(computed, adjusted=publication.adjusted))
    is_cut = any(isinstance(one, CutOffError) for one in results.values())
    return _Computed(text, is_cut, results)


def _strict(competition: Competition, rule_set: RuleSet, spec: Spec) -> Evaluation | None:
    if not spec.strict:
        return None
    try:
        return strict_evaluation(competition, spec.strict, log_map_of(rule_set))
    except ScoreError:
        return None


def _nowhere(_text: str, _file: Path) -> None:
    """Only the hashes of the results are of interest."""
