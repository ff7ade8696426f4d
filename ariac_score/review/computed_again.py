"""A stored result computed again, from its log or from the whole competition, and compared to the byte."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from ariac_score.checks.registry import Registry
from ariac_score.engine.price import reprice
from ariac_score.engine.provenance import file_sha256
from ariac_score.engine.score import score_trial
from ariac_score.errors import NothingToScoreError, ScoreError, UsageError
from ariac_score.ranking.competition import FILE, Competition, Run, load_competition, signers_of, work_by_of
from ariac_score.ranking.rank import rank_results
from ariac_score.ranking.runs import score_runs
from ariac_score.ranking.spec import ranking_spec
from ariac_score.results.result import Provenance, Result
from ariac_score.results.result_file import as_json, result_in
from ariac_score.review.differences import SHOWN, Place, differences, listed
from ariac_score.review.steps import FAILED, NOTE, OK, OPEN, Step
from ariac_score.scoring.ruleset import RuleSet, load_rule_set

__all__ = ["compared_with_log", "competition_at", "installed_rules", "other_versions"]


def compared_with_log(
    stored: Result,
    log: Path | Competition,
    rule_set: RuleSet,
    *,
    log_map: str,
    registry: Registry,
    also: Sequence[Path],
    path: Path,
) -> list[Step]:
    """The steps that compute an automatic result again and compare it.

    Args:
        stored: The result.
        log: Its log, or the competition that it is a run of.
        rule_set: The rules to compute by.
        log_map: Instead of that of the rules; empty for theirs.
        registry: The plugins.
        also: Configurations that it was scored with, where they lie elsewhere than the log.
        path: Of the result, for messages.

    Raises:
        ScoreError: The log cannot be read, or the competition has no such run.
    """
    if isinstance(log, Competition):
        again = _in_competition(stored, log, rule_set, log_map, registry)
    else:
        again = score_trial(
            log, rule_set, log_map=log_map, registry=registry, also=also, partial=_is_partial(stored)
        )
        again = reprice(again, rule_set, stored.cohort) if stored.cohort.is_given else again
    again = result_in(as_json(again).encode("utf-8"), path)  # texts as a file can hold them
    again, names = _as_it_was_named(stored, again)
    again, parts = _as_it_was_read(stored, again)
    return [*parts, _inputs(stored, again), *names, _recomputed(stored, again)]


def _as_it_was_named(stored: Result, again: Result) -> tuple[Result, list[Step]]:
    """The new result under the names of the stored one where its log names no team; then a step says so.

    Whose run it is, and of which trial, comes of the place of a log in its competition.
    """
    then, now = stored.measured, again.measured
    if not then.team or now.team:
        return again, []
    words = (
        f"that it is {then.trial} of {then.team} is the word of the file alone, for the log names no team; "
        "--log COMPETITION says whose run it is, and takes the organiser's configurations"
    )
    named = replace(now, team=then.team, trial=then.trial)
    return replace(again, measured=named), [Step("run", OPEN, words)]


def installed_rules(name: str) -> RuleSet | None:
    """The installed rule set of a name that a document states, where there is one.

    Never a file: what a document names may lie beside it, and then vouches for itself.
    """
    if name.endswith((".yaml", ".yml")) or "/" in name or "\\" in name:
        return None
    try:
        return load_rule_set(name)
    except ScoreError:
        return None


def competition_at(log: Path, rules: str) -> Competition | None:
    """The competition at a path, where there is one.

    Args:
        log: The path.
        rules: Where it names none itself.
    """
    # Cheap signs first: loading lists every run, and most logs are no competition.
    if log.name != FILE and not (log / FILE).is_file() and not (log / "logs").is_dir():
        return None
    for named in ("", rules):
        try:
            return load_competition(log, named)
        except NothingToScoreError:
            return None
        except UsageError:
            continue
    return None


def _in_competition(
    stored: Result, competition: Competition, rule_set: RuleSet, log_map: str, registry: Registry
) -> Result:
    run = _run_of(stored, competition)
    if stored.cohort.is_given:
        # Its price hangs on the runs of all teams, and what the result says of these is its own word.
        spec = ranking_spec(rule_set, competition.ranking, file=str(competition.file))
        partial = _is_partial(stored)
        results = score_runs(
            competition,
            rule_set,
            registry=registry,
            sketches=True,
            partial=partial,
            signed_by=signers_of(competition, rule_set.authority),
        )
        if isinstance(error := results[run.key], ScoreError):
            raise error
        ranked = rank_results(competition, spec, rule_set, results, partial=partial)
        return next(one.result for one in ranked.runs if one.key == run.key and one.result is not None)
    configs = [t.config for t in competition.trials if t.id == run.trial]
    configs += [t.config for t in competition.teams if t.id == run.team]
    return score_trial(
        run.path,
        rule_set,
        log_map=log_map,
        registry=registry,
        also=[config for config in configs if config is not None],
        work_by=work_by_of(competition, rule_set.authority),
        root=competition.root,
        trial_id=run.trial,
        team=run.team,
        partial=_is_partial(stored),
    )


def _is_partial(stored: Result) -> bool:
    """Whether the result is of a log that is cut off, and was scored as far as it goes."""
    return stored.measured.cut is not None


def _run_of(stored: Result, competition: Competition) -> Run:
    """The run of a competition that a result is of, by the names of its files, or else by their hashes."""
    names = [source.name for source in stored.provenance.inputs]
    own = [(run, run.path.relative_to(competition.root).as_posix()) for run in competition.runs]
    for run, place in own:
        if any(name == place or name.startswith(f"{place}/") for name in names):
            return run
    # Without configurations of the organiser, names are relative to the run itself.
    alike = [
        run
        for run in competition.runs
        if run.trial == stored.measured.trial and run.team == stored.measured.team
        if any(name == run.path.name or (run.path / name).is_file() for name in names)
    ]
    if len(alike) > 1:
        alike = [run for run in alike if _has_its_files(run, stored)] or alike[:1]
    if alike:
        return alike[0]
    raise NothingToScoreError(
        f"the competition has no run with {', '.join(names[:3]) or 'its files'}",
        file=competition.file,
        hint="give the log of the run itself as --log",
    )


def _has_its_files(run: Run, stored: Result) -> bool:
    """Whether a run has a file of a result, by size and hash."""
    for source in stored.provenance.inputs:
        file = run.path if run.path.is_file() else run.path / source.name
        if file.is_file() and file.stat().st_size == source.bytes and file_sha256(file) == source.sha256:
            return True
    return False


def _as_it_was_read(stored: Result, again: Result) -> tuple[Result, list[Step]]:
    """The new result with the sources of the stored one where that read only parts of files, and a note."""
    parts = {(s.role, s.name, s.bytes): s for s in stored.provenance.inputs if s.read_bytes is not None}
    inputs = tuple(parts.get((s.role, s.name, s.bytes), s) for s in again.provenance.inputs)
    words = [
        f"{name}: {source.read_bytes} of {size} bytes were read; that they are those of this file shows only"
        " what was found in them"
        for (_, name, size), source in parts.items()
    ]
    steps = [Step("parts", NOTE, "\n".join(words))] if words else []
    # Results of the former method state the hash of other bytes of their rules, whose text was compared.
    pinned = stored.provenance.rule_set if stored.is_former else again.provenance.rule_set
    return replace(again, provenance=replace(again.provenance, inputs=inputs, rule_set=pinned)), steps


def _inputs(result: Result, again: Result) -> Step:
    """Whether the files are those the result was made from."""
    then, now = ({(s.role, s.name): s.sha256 for s in each.provenance.inputs} for each in (result, again))
    words = [
        f"{role} {name}: {why}"
        for (role, name) in dict.fromkeys([*then, *now])
        if (why := _file_difference(then.get((role, name)), now.get((role, name))))
    ]
    if words:
        return Step("log", FAILED, "\n".join(words[:SHOWN]))
    return Step("log", OK, ", ".join(f"{name}, sha256 {sha[:16]}…" for (_, name), sha in then.items()))


def _file_difference(then: str | None, now: str | None) -> str:
    if then == now:
        return ""
    if then is None:
        return "was not there when the result was made"
    return "is not there" if now is None else f"another file: sha256 {then[:16]}…, here {now[:16]}…"


def _recomputed(stored: Result, again: Result) -> Step:
    recorded = bool(stored.provenance.code)
    if not recorded:  # then it claims nothing of the code that could be wrong
        again = replace(again, provenance=replace(again.provenance, code=()))
    before, after = as_json(stored), as_json(again)
    if before == after and recorded:
        return Step("recomputed", OK, "the same to the byte")
    if before == after:
        return Step("recomputed", NOTE, "the same to the byte; the code that made it is not recorded")
    found = differences(json.loads(before), json.loads(after))
    values = [each for each in found if not _is_record(each[0], stored)]
    values.sort(key=lambda each: each[0][0] != "measured")  # whence all other differences come
    words = (
        listed(values, "in the result", "computed again")
        if values
        else f"the same score, {'task score' if stored.is_former else 'ledger'} and findings"
        + ("; the result does not keep its settings" if stored.measured.settings is None else "")
    )
    versions = list(other_versions(stored.provenance, again.provenance))
    if stored.is_former and not recorded and not values and not versions:
        return Step("recomputed", OPEN, f"{words}; the lines of its ledger are the word of the file alone")
    if stored.is_former and not versions:
        versions = ["its ledger is taken apart by a method that the code it names does not use"]
    return Step("recomputed", FAILED, "\n".join([words, *versions]))


def _is_record(place: Place, stored: Result) -> bool:
    """Whether a difference is about how a result came about, and not about what was found."""
    # Without settings a result is of a version before they were kept, or they were removed from it.
    if place[:2] == ("measured", "settings"):
        return stored.measured.settings is None
    if place[:2] == ("measured", "statements"):  # nor was it said whose statements it rests on
        return not stored.measured.statements
    if stored.is_former and _is_of_method(place):
        return True
    # Units of quantities were not kept before `result/2`; the ledger, which rests on them, is compared.
    is_unit = place[:2] == ("measured", "findings") and place[3:4] == ("units",)
    return place[:1] == ("provenance",) or is_unit


def _is_of_method(place: Place) -> bool:
    """Whether a difference is about how the ledger is taken apart, and not about what it adds up to."""
    inside = place[:1] in (("ledger",), ("task",)) and place[1:2] not in ((), ("amount",))
    return (
        inside
        or place == ("ledger_method",)
        or place[:2] in (("measured", "measures"), ("measured", "watched"))
    )


def other_versions(stored: Provenance, again: Provenance) -> Iterator[str]:
    """The rules and packages that differ between a result and its computation now."""
    for what, one, other in (
        ("rule set", stored.rule_set, again.rule_set),
        ("log map", stored.log_map, again.log_map),
    ):
        if one != other:
            found = f"{one.id}, sha256 {one.sha256[:16]}…; here {other.id}, sha256 {other.sha256[:16]}…"
            yield f"another {what}: {found}"
    then, here = (
        {(c.distribution, c.package): (c.version, c.sha256) for c in each.code} for each in (stored, again)
    )
    for distribution, package in dict.fromkeys([*then, *here]):
        before, after = then.get((distribution, package)), here.get((distribution, package))
        if before != after:
            words = [
                "nothing" if each is None else f"version {each[0]}, sha256 {each[1][:16]}…"
                for each in (before, after)
            ]
            yield f"another {package} of {distribution}: {words[0]}; here {words[1]}"
    if stored.ignored != again.ignored:
        yield "other files were passed over"
