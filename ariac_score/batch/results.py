"""The results of a batch, for those who rank it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ariac_score.batch.description import load_description
from ariac_score.batch.index import AGAIN, RUNS, Row, read_rows, recorded_document, refuse_other_rules
from ariac_score.batch.outcomes import is_outcome
from ariac_score.engine.prepared import prepare
from ariac_score.engine.provenance import code_of
from ariac_score.errors import (
    BatchError,
    FormulaError,
    LogError,
    ResultError,
    RunEndedError,
    ScoreError,
    UsageError,
)
from ariac_score.ranking.competition import Competition, RunKey, registry_for, signed_for
from ariac_score.ranking.runs import without_sketch
from ariac_score.results.result import Code, Pinned, Result
from ariac_score.results.result_file import check_follows, check_rules, result_in
from ariac_score.results.signing import refuse_unsigned
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["refuse_forged", "results_of_batch"]


def results_of_batch(
    folder: Path,
    competition: Competition,
    rule_set: RuleSet,
    *,
    sketches: bool = False,
    mixed_code: bool = False,
    signed_by: Sequence[str] = (),
) -> dict[RunKey, Result | ScoreError]:
    """Each run's stored result, or why there is none.

    Args:
        folder: Of the batch.
        competition: Whose runs they are.
        rule_set: By which it is ranked; the batch must have been scored by it.
        sketches: Keep what pages draw; of a season that is most of the memory.
        mixed_code: Take results that other code than the installed made.
        signed_by: Keys one of which must have signed the table, which names every result with its SHA-256.

    Raises:
        UsageError: The folder holds no finished batch of this competition under these rules.
        BatchError: A result is not the one that the tables recorded, or of other rules.
        ResultError: The table is not signed by an owner of the keys.
    """
    again = f"ariac-score batch {competition.file} -o {folder}"
    description = load_description(folder, hint=again)
    refuse_unsigned(folder / RUNS, signed_by, competition=signed_for(competition))
    scored_under = description.rule_set
    if scored_under != Pinned(rule_set.id, rule_set.sha256):
        raise UsageError(
            f"it was scored under {scored_under.id} ({scored_under.sha256[:12]}…), not under {rule_set.id} "
            f"({rule_set.sha256[:12]}…)",
            file=folder,
            hint=f"put the new prices on it first: {again}",
        )
    if not mixed_code and set(description.code) != _installed_code(competition, rule_set):
        raise UsageError(
            "other code than the installed made its results",
            file=folder,
            hint=f"score them again: {again}; or take them as they are: --mixed-code",
        )
    rows = {row.key: row for row, _ in read_rows(folder / RUNS)}
    for row in rows.values():
        refuse_other_rules(row, scored_under, folder)
    missing = [run.key for run in competition.runs if run.key not in rows]
    if missing:
        named = ", ".join("/".join(map(str, key)) for key in missing[:3])
        runs = "run is" if len(missing) == 1 else "runs are"
        raise UsageError(f"{len(missing)} {runs} not in it: {named}", file=folder, hint=again)
    # The tables that somebody vouches for name every result with its hash.
    own = None if signed_by else rule_set
    return {run.key: _result(rows[run.key], folder, own, sketches=sketches) for run in competition.runs}


def refuse_forged(document: bytes, place: Path, rule_set: RuleSet) -> None:
    """Refuse a stored result that is not what its rules make of its findings.

    Whether the findings are those of its log only the log shows. A document that says why there is no
    result has nothing to be priced.

    Args:
        document: As it is stored.
        place: Where.
        rule_set: By which it must be.

    Raises:
        BatchError: It is no result, by other rules, or its ledger does not follow from its findings.
    """
    try:
        if is_outcome(document):
            return
        result = result_in(document, place, known=True)
    except ResultError as error:
        raise BatchError(error.cause, file=place, hint=AGAIN) from error
    except (ValueError, RecursionError) as error:
        raise BatchError("it is no result", file=place, hint=AGAIN) from error
    _refuse_priced_otherwise(result, place, rule_set)


def _refuse_priced_otherwise(result: Result, place: Path, rule_set: RuleSet) -> None:
    try:
        check_rules(result)
        if result.provenance.rule_set.sha256 != rule_set.sha256:
            raise ResultError(f"it was not made by {rule_set.id}")
        check_follows(result, rule_set)
    except ResultError as error:
        raise BatchError(error.cause, file=place, hint=AGAIN) from error


def _installed_code(competition: Competition, rule_set: RuleSet) -> set[Code]:
    prepared = prepare(rule_set, registry=registry_for(competition))
    return {Code(*code) for code in code_of(prepared)}


def _result(row: Row, folder: Path, rule_set: RuleSet | None, *, sketches: bool) -> Result | ScoreError:
    """The result of a row; priced again where rules are given, for a table is rewritten as easily."""
    summary = row.summary
    if row.object:
        try:
            result = result_in(recorded_document(row, folder), folder / row.object, known=True)
            if summary.outcome == "scored" and result.final is not None and float(result.final) != row.score:
                raise BatchError(
                    f"its row says {row.score}, the result {result.final:f}",
                    file=folder / row.object,
                    hint=AGAIN,
                )
            if rule_set is not None:
                _refuse_priced_otherwise(result, folder / row.object, rule_set)
            return result if sketches else without_sketch(result)
        except ResultError as error:
            if not summary.reason:
                raise BatchError(error.cause, file=folder / row.object, hint=AGAIN) from error
    if summary.outcome in ("crashed", "cancelled"):
        return RunEndedError(summary.reason, outcome=summary.outcome)
    if summary.outcome == "no_value":
        return FormulaError(summary.reason)
    return LogError(f"{summary.outcome.replace('_', ' ')}: {summary.reason}")
