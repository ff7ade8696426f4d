"""Scoring every run of a competition; a run that cannot be scored is an outcome and stops no other."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from ariac_score.checks.registry import Registry, package_sha256
from ariac_score.engine.price import reprice
from ariac_score.engine.score import score_trial
from ariac_score.errors import PluginError, ResultError, ScoreError
from ariac_score.ranking.competition import Competition, Run, RunKey, registry_for, signed_for, work_by_of
from ariac_score.results.result import Code, Pinned, Result
from ariac_score.results.result_file import (
    check_follows,
    check_rules,
    read_result,
    refuse_impossible,
)
from ariac_score.results.signing import refuse_unsigned
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["score_runs", "without_sketch"]

Progress = Callable[[int, Run], None]


def _silent(_done: int, _run: Run) -> None:
    """Show nothing."""


def _ignored(_words: str) -> None:
    """Say nothing."""


def score_runs(
    competition: Competition,
    rule_set: RuleSet,
    *,
    registry: Registry | None = None,
    progress: Progress = _silent,
    sketches: bool = False,
    partial: bool = False,
    signed_by: Sequence[str] = (),
    remark: Callable[[str], None] = _ignored,
) -> dict[RunKey, Result | ScoreError]:
    """Each run's result, or why there is none.

    A run that is a stored result is priced again and needs no log.

    Args:
        competition: Its runs and configurations.
        rule_set: By which they are scored.
        registry: The installed plugins; by default with the files of code that the competition allows.
        progress: Called before each run with how many are done.
        sketches: Keep the series that pages draw. They price nothing, and are most of the memory
            that a season takes.
        partial: Whether logs that are cut off are scored as far as they go, unofficially.
        signed_by: Keys one of which must have signed a run that is a stored result.
        remark: Called with what a reader must know of stored results: they are of other rules or code.

    Raises:
        ResultError: Stored results were made under different rule sets: one may have judged
            what another did not.
    """
    registry = registry or registry_for(competition)
    if not all(map(_is_stored, competition.runs)):  # once, for it is no fault of any run
        rule_set.refuse_local(registry)
    configs = {("team", team.id): team.config for team in competition.teams} | {
        ("trial", trial.id): trial.config for trial in competition.trials
    }
    work_by = work_by_of(competition, rule_set.authority)
    results: dict[RunKey, Result | ScoreError] = {}
    made_under: dict[Pinned, Run] = {}
    made_by: set[Code] = set()
    for done, run in enumerate(competition.runs):
        progress(done, run)
        also = [c for c in (configs.get(("trial", run.trial)), configs.get(("team", run.team))) if c]
        try:
            if _is_stored(run):
                refuse_unsigned(run.path, signed_by, competition=signed_for(competition))
                stored = _stored(run)
                if signed_by and not stored.measured.team:  # its signature would fit in any team's folder
                    raise ResultError(
                        "it is signed, and names no team", file=run.path, hint="score it as a run of a team"
                    )
                made_under.setdefault(stored.provenance.rule_set, run)
                made_by.update(stored.provenance.code)
                result = _priced(stored, rule_set, run.path)
            else:
                made_under.setdefault(Pinned(rule_set.id, rule_set.sha256), run)
                result = score_trial(
                    run.path,
                    rule_set,
                    registry=registry,
                    also=also,
                    work_by=work_by,
                    root=competition.root,
                    trial_id=run.trial,
                    team=run.team,
                    partial=partial,
                )
            results[run.key] = result if sketches else without_sketch(result)
        except ScoreError as error:
            results[run.key] = _within(error, competition.root)
        # After each run and outside the try: this is a fault of the competition, not of one run.
        _refuse_different_rules(made_under)
    for words in (*_other_rules(made_under, rule_set), *_other_code(made_by)):
        remark(words)
    return results


def _other_rules(made_under: Mapping[Pinned, Run], rule_set: RuleSet) -> Iterator[str]:
    for stated in made_under:
        if stated.id == rule_set.id and stated.sha256 != rule_set.sha256:
            yield (
                f"stored results state another {stated.id}, SHA-256 {stated.sha256[:12]}…, than they are "
                f"priced by here, {rule_set.sha256[:12]}…"
            )


def _other_code(made_by: Collection[Code]) -> Iterator[str]:
    """The packages that made stored results and are not those that are installed here."""
    others = []
    for code in sorted(made_by, key=lambda code: (code.distribution, code.package, code.sha256)):
        try:
            here = package_sha256(code.package)
        # ValueError and ImportError: names that are no importable package here.
        except (PluginError, ValueError, ImportError):
            here = ""
        if here != code.sha256:
            others.append(f"{code.package} of {code.distribution} {code.version}, {code.sha256[:12]}…")
    if others:
        yield (
            f"stored results were made by other code than is installed here: {'; '.join(others[:3])}"
            f"{f' and {len(others) - 3} more' if len(others) > 3 else ''}"
        )


def _within(error: ScoreError, root: Path) -> ScoreError:
    """The error with its file relative to the competition: the same text wherever that lies."""
    file = Path(error.file) if error.file else None
    if file is not None and file.is_relative_to(root):
        error.file = file.relative_to(root).as_posix()
    return error


def without_sketch(result: Result) -> Result:
    """A result without what pages draw."""
    return replace(result, measured=replace(result.measured, sketch=None))


def _is_stored(run: Run) -> bool:
    return run.path.suffix == ".json" and run.path.is_file()


def _stored(run: Run) -> Result:
    stored = read_result(run.path)
    refuse_impossible(stored, run.path)
    if stored.adjusted is not None:
        raise ResultError(
            "it is adjusted by stewards already",
            file=run.path,
            hint="rank the automatic results, and give the decisions with --adjustments",
        )
    if stored.measured.trial != run.trial or stored.measured.team not in ("", run.team):
        raise ResultError(
            f"it is of {stored.measured.team or 'no team'}, trial {stored.measured.trial}",
            file=run.path,
            hint="name stored results as the runs they are of",
        )
    return stored


_OF_A_PRICE = ("score", "ledger", "task", "status", "missing", "possible", "assumptions", "interval")


def _priced(stored: Result, rule_set: RuleSet, file: Path) -> Result:
    """A stored result priced by a rule set, once where it says the same; one that was edited is refused.

    Raises:
        ResultError: Its score does not follow from its findings, or it holds other rules than it states.
        ScoreError: It cannot be priced by these rules.
    """
    try:
        check_rules(stored)
        again = reprice(stored, rule_set)
        if any(getattr(again, name) != getattr(stored, name) for name in _OF_A_PRICE):
            check_follows(stored)  # by its own rules, or with values across teams
    except ResultError as error:
        error.file = error.file or str(file)
        raise
    return again


def _refuse_different_rules(made_under: Mapping[Pinned, Run]) -> None:
    """Results of different rule sets are never ranked together."""
    if len(made_under) < 2:
        return
    (first, run), (other, stranger) = list(made_under.items())[:2]
    raise ResultError(
        f"it was made under {_identity(other)}, and {run.path.name} of {run.team} under {_identity(first)}",
        file=stranger.path,
        hint="results of different rule sets are not ranked together: score all runs under one",
    )


def _identity(rules: Pinned) -> str:
    return f"{rules.id} (SHA-256 {rules.sha256[:12]}…)"
