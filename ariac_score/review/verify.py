"""Checking a stored result: in itself, against the installed versions, and against its log.

Without its log a result can only be checked for whether its score follows from its findings.
With the log everything is computed again and compared to the byte.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from ariac_score.checks.finding_contract import stored_breaches
from ariac_score.checks.local import GIVEN_DISTRIBUTION, LocalFiles
from ariac_score.checks.registry import LOCAL_DISTRIBUTION, Registry, package_sha256
from ariac_score.documents.schema import strict_json
from ariac_score.engine.price import check_uses, reprice
from ariac_score.engine.score import score_trial
from ariac_score.engine.settings import plain_value
from ariac_score.errors import (
    LocalPluginError,
    NoResultError,
    NothingToScoreError,
    PluginError,
    ResultError,
    ScoreError,
    UsageError,
)
from ariac_score.ranking.competition import FILE, Competition, Run, load_competition, work_by_of
from ariac_score.results.adjustments import adjust, load_adjustments
from ariac_score.results.result import Code, Measured, Provenance, Result
from ariac_score.results.result_file import (
    RESULT,
    as_json,
    check_follows,
    measured_sha256,
    read_result,
    result_in,
)
from ariac_score.scoring.policy import OPEN
from ariac_score.scoring.ruleset import RuleSet, expanded_yaml, load_rule_set, rule_set_from_text

__all__ = ["Step", "Verification", "verify_result"]

SHOWN = 5
"""Differences that are named; one edit changes few places, another log changes many."""

OK, FAILED, NOTE = "ok", "failed", "note"


@dataclass(frozen=True)
class Step:
    """One step of the verification.

    Attributes:
        name: Such as `schema` or `recomputed`.
        outcome: `ok`, `failed`, or `note` for a difference that need not be a fault.
        words: What was found; several lines for several differences.
    """

    name: str
    outcome: str
    words: str


@dataclass(frozen=True)
class Verification:
    """The outcome of verifying a stored result.

    Attributes:
        steps: In the order in which they were taken.
        result: The result; `None` when it cannot be built from the file.
    """

    steps: tuple[Step, ...]
    result: Result | None

    @property
    def holds(self) -> bool:
        """Whether nothing failed."""
        return all(step.outcome != FAILED for step in self.steps)

    @property
    def computed_again(self) -> bool:
        """Whether all was computed again from the log."""
        return any(step.name == "recomputed" for step in self.steps)


def verify_result(
    path: Path,
    *,
    log: Path | None = None,
    rules: str = "",
    log_map: str = "",
    also: Sequence[Path] = (),
    adjustments: Path | None = None,
    registry: Registry | None = None,
    local_plugins: bool = False,
) -> Verification:
    """Check a stored result.

    Args:
        path: The result.
        log: Its log, bundle, or the competition it is a run of; then everything is computed again.
        rules: The rule set it must be scored by; without it, the installed one of the same name.
        log_map: Log map, where the rule set names one that lies elsewhere.
        also: Configurations that it was scored with, where they lie elsewhere than the log.
        adjustments: The stewards' file, where the result is adjusted.
        registry: The installed plugins.
        local_plugins: Whether files of code beside the rule set may run, where they are those that the
            result states; it counts where no `registry` is given.

    Raises:
        ResultError: The file is no JSON at all, or another kind of document.
        NothingToScoreError: It is a folder.
        ScoreError: The log, the rules or the adjustments cannot be read.
    """
    text, data = _read(path)
    _refuse_other_document(data, path)
    try:
        result = read_result(path)
    except ResultError as error:
        return Verification(_unread(error, data), None)
    steps = [Step("schema", OK, data["schema"])]
    steps.append(Step("sums", OK, f"every line of the ledger adds up to {_amount(result)}"))
    steps += _follows(result)
    if result.is_former:
        steps.append(Step("ledger", NOTE, _FORMER))
    steps.append(_possible(result.measured))
    steps.append(_canonical(text, data["schema"], result))
    given = load_rule_set(rules) if rules else _installed(result)
    steps.append(_rules(result, given, required=bool(rules)))
    steps.append(_code(result, files_run=local_plugins and log is not None))
    if adjustments is not None:
        steps.append(_adjustments(result, adjustments))
    if log is not None:
        rule_set = _rule_set_for(result, given, required=bool(rules))
        if local_plugins and registry is None:
            registry = Registry(LocalFiles(_stated_files(result)))
            changed = list(_changed_files(rule_set, registry))
            if changed:  # another text says nothing about this result, and may do anything
                return Verification((*steps, *changed), result)
            if files := ", ".join(sorted(_stated_files(result))):
                steps.append(Step("local", OK, f"{files} beside the rule set made it"))
        # The automatic result: decisions of stewards are applied to it, not measured.
        again = _again(result.automatic, log, rule_set, log_map, registry or Registry(), also)
        again = result_in(as_json(again).encode("utf-8"), path)  # texts as a file can hold them
        again, parts = _as_it_was_read(result.automatic, again)
        steps += [*parts, _inputs(result, again), _recomputed(result.automatic, again)]
    return Verification(tuple(steps), result)


_FORMER = (
    "taken apart by the former method, factor by factor; score, task score, what was possible and "
    "assumptions were compared exactly, its lines only with their sums"
)

# The result alone ----------------------------------------------------------------------


_CHECKED_BY: Mapping[str, str] = {
    "audit": "'ariac-score audit PATH' computes it again",
    "cohort": "'ariac-score rank COMPETITION --cohort-output FILE' computes it again",
    "outcome": "it says why a run has no result; 'ariac-score batch PATH -o OUT' tries the run again",
    "ranking": "'ariac-score report RANKING -o FOLDER' checks it against the results it names, "
    "'ariac-score rank COMPETITION' computes it again; verify its results one by one",
}
"""What checks the other kinds of documents, by the name of their format."""


def _refuse_other_document(data: Any, path: Path) -> None:
    """Refuse a document of ours that is no result: it is sound perhaps, but not for this command to say.

    Raises:
        ResultError: It is one.
    """
    tag = data.get("schema") if isinstance(data, dict) else None
    kind = tag.removeprefix("ariac-score/").partition("/")[0] if isinstance(tag, str) else ""
    if kind in _CHECKED_BY:
        article = "an" if kind[0] in "ao" else "a"
        raise ResultError(
            f"it is the JSON of {article} {kind}, not of a result", file=path, hint=_CHECKED_BY[kind]
        )


def _read(path: Path) -> tuple[str, Any]:
    if path.is_dir():
        raise NothingToScoreError(
            "it is a folder, not a result",
            file=path,
            hint="name the JSON file that 'score -o FILE.json' wrote",
        )
    try:
        text = path.read_text(encoding="utf-8")
        return text, strict_json(text)
    except FileNotFoundError:
        hint = "check the path; it is relative to the current folder"
        raise NoResultError("no such file", file=path, hint=hint) from None
    except OSError as cause:
        raise ResultError(f"cannot be read: {cause.strerror}", file=path, hint="check the path") from None
    except (ValueError, RecursionError) as cause:
        raise ResultError(
            f"not a result: {cause}", file=path, hint="give the JSON that 'score -o FILE.json' wrote"
        ) from None


def _fault(error: ScoreError) -> str:
    return f"{error.place}: {error.cause}" if error.place else error.cause


def _amount(result: Result) -> str:
    return "nothing, for there is no score" if result.score is None else f"{result.score:f}"


def _unread(error: ResultError, data: Any) -> tuple[Step, ...]:
    """What is wrong with a file that no result can be built from: its form, or its sums."""
    # `$` is a place in a document; the ledger's own lines have paths such as `score/rounding`.
    if error.place.startswith("$"):
        update = f"; {error.hint}" if RESULT.newer(data) else ""
        return (Step("schema", FAILED, _fault(error) + update),)
    return (Step("schema", OK, str(data["schema"])), Step("sums", FAILED, _fault(error)))


def _follows(result: Result) -> Iterator[Step]:
    """Whether the automatic score follows from the findings, and the adjusted one from the decisions."""
    try:
        check_follows(result.automatic)
        yield Step(
            "automatic", OK, f"{_amount(result)} follows from the findings, by the rules in the result"
        )
    except ResultError as error:
        yield Step("automatic", FAILED, _fault(error))
        return
    adjusted = result.adjusted
    if adjusted is None:
        return
    try:
        check_follows(result)
        final = "no score" if adjusted.score is None else f"{adjusted.score:f}"
        names = ", ".join(decision.id for decision in adjusted.adjustments)
        yield Step("adjusted", OK, f"{final} follows from the automatic score and the decisions: {names}")
    except ResultError as error:
        yield Step("adjusted", FAILED, _fault(error))


def _possible(measured: Measured) -> Step:
    """Whether its findings keep the contract that the engine holds every finding to."""
    found = stored_breaches(measured.findings, measured.measures, measured.watched)
    wrong = [f"{key}: {breach}" for key, breach in found]
    if wrong:
        more = [f"and {len(wrong) - SHOWN} more"] if len(wrong) > SHOWN else []
        return Step("findings", FAILED, "\n".join([*wrong[:SHOWN], *more]))
    return Step("findings", OK, f"{len(measured.findings)}, each with times, units and numbers that can be")


def _canonical(text: str, tag: str, result: Result) -> Step:
    """Whether the file has the bytes we write for such a result, which editors seldom keep."""
    if tag != RESULT.tag:
        return Step("bytes", NOTE, f"{tag} is read, but no longer written; its values were compared")
    if text == as_json(result):
        return Step("bytes", OK, "as they are written")
    found = _differences(json.loads(text), json.loads(as_json(result)))
    words = (
        "the same values, written in another way" if not found else _listed(found, "in the file", "as read")
    )
    return Step("bytes", FAILED, words)


def _as_before(policy: str) -> str:
    return "withhold" if policy == OPEN else policy


def _installed(result: Result) -> RuleSet | None:
    """The rule set of that name, where one is installed."""
    try:
        name = result.provenance.rule_set.id
        return None if name.endswith((".yaml", ".yml")) or "/" in name else load_rule_set(name)
    except ScoreError:
        return None


def _rules(result: Result, given: RuleSet | None, *, required: bool) -> Step:
    """Whether the rules in the result are those it names, and those that are given or installed."""
    name, sha256 = result.provenance.rule_set.id, result.provenance.rule_set.sha256
    own = rule_set_from_text(result.rules, file="the rules in the result")
    worse = FAILED if required else NOTE  # another edition of the package may have newer rules
    if own.id != name:
        return Step(
            "rules", FAILED, f"the rules in the result are {own.id!r}, it says that it is by {name!r}"
        )
    uses = check_uses(own)
    if result.is_former:  # until then what nobody said anything about withheld the score
        uses = {n: {**u, "on_inconclusive": _as_before(u["on_inconclusive"])} for n, u in uses.items()}
    if (own.title, own.notes, uses) != (result.rule_set_title, result.notes, result.checks):
        return Step("rules", FAILED, "title, notes or checks are not those of the rules in the result")
    for check, parameter in _given_otherwise(result):
        words = f"settings of {check!r} give {parameter!r} another value than the rules in the result"
        return Step("rules", FAILED, words)
    if given is None:
        return Step("rules", NOTE, f"{name} is not installed here; the rules in the result were used")
    if expanded_yaml(given) != expanded_yaml(own):
        found = _differences(own.expanded, given.expanded)
        whose = "given" if required else "installed"
        words = _listed(found, "in the result", f"in {given.id} as {whose}")
        return Step("rules", worse, f"{name} is another rule set than {given.id} as {whose}: {words}")
    if given.sha256 != sha256:
        return Step(
            "rules", worse, f"{name} says the same, but from a file with another hash: {given.sha256[:16]}…"
        )
    return Step("rules", OK, f"{name}, sha256 {sha256[:16]}…")


def _given_otherwise(result: Result) -> Iterator[tuple[str, str]]:
    """Parameters that the settings ascribe to the rule set with another value than it gives."""
    for name, kept in (result.measured.settings or {}).items():
        given = dict(result.checks[name]["with"] if name in result.checks else {})
        stated = {one.name: one for one in kept.parameters}
        for parameter in sorted(given.keys() - stated.keys()):
            yield name, parameter
        for parameter, one in stated.items():
            if one.origin == "rule_set" and (
                parameter not in given or _text(one.value) != _text(plain_value(given[parameter]))
            ):
                yield name, parameter


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True)


def _code(result: Result, *, files_run: bool) -> Step:
    """Which recorded versions are not those installed here."""
    if not result.provenance.code:
        return Step("code", NOTE, "the result does not say which code made it")
    # Files beside the rule set that run are compared before they do, in a step of their own.
    files = [one for one in result.provenance.code if one.distribution == LOCAL_DISTRIBUTION]
    compared = [one for one in result.provenance.code if not (files_run and one in files)]
    others = [words for each in compared if (words := _other(each))]
    if others:
        return Step("code", NOTE, "\n".join(others))
    here = (f"{code.package} ({code.distribution} {code.version})" for code in compared)
    return Step("code", OK, ", ".join(here))


def _stated_files(result: Result) -> dict[str, str]:
    """The files of code that a result says it was made by, with their hashes."""
    return {c.package: c.sha256 for c in result.provenance.code if c.distribution == LOCAL_DISTRIBUTION}


def _changed_files(rule_set: RuleSet, registry: Registry) -> Iterator[Step]:
    """The files of code that are not those of the result."""
    try:
        rule_set.refuse_local(registry)
    except LocalPluginError as error:
        yield Step("local", FAILED, f"{_fault(error)}; {error.hint}")


def _other(code: Code) -> str:
    """How the installed code differs from the recorded; empty when it does not."""
    distribution, recorded, package = code.distribution, code.version, code.package
    if distribution == LOCAL_DISTRIBUTION:
        return (
            f"{package} beside the rule set made it, sha256 {code.sha256[:16]}…; --local-plugins compares it"
        )
    if distribution == GIVEN_DISTRIBUTION:
        known = f"sha256 of its text {code.sha256[:16]}…" if code.sha256 else "of which nothing is known"
        return f"the class {package}, given in Python, made it, {known}; nothing here can compare it"
    try:
        here = version(distribution)
        own = package_sha256(package)
    # ValueError and ImportError: `find_spec` raises them for names that are no importable package here.
    except (PackageNotFoundError, PluginError, ValueError, ImportError):
        return f"{distribution} {recorded} with {package} made it, and is not installed here"
    if here != recorded:
        return f"{distribution} {recorded} with {package} made it, here it is {here}"
    if own != code.sha256:
        return f"{package} of {distribution} {recorded} made it, sha256 {code.sha256[:16]}…, here {own[:16]}…"
    return ""


def _adjustments(result: Result, file: Path) -> Step:
    """Whether the stewards' file gives the adjusted score of the result."""
    if result.adjusted is None:
        return Step("adjustments", FAILED, "the result is automatic; nobody has adjusted it")
    loaded = load_adjustments(file)
    try:
        again, _ = adjust(result.automatic, loaded, measured=measured_sha256(result.automatic))
    except ScoreError as error:
        return Step("adjustments", FAILED, error.cause)
    if as_json(again) == as_json(result):
        return Step(
            "adjustments", OK, f"the decisions are those of {file.name}, sha256 {loaded.sha256[:16]}…"
        )
    found = _differences(json.loads(as_json(result)), json.loads(as_json(again)))
    return Step("adjustments", FAILED, _listed(found, "in the result", f"by {file.name}"))


# With its log --------------------------------------------------------------------------


def _rule_set_for(result: Result, given: RuleSet | None, *, required: bool) -> RuleSet:
    """The rules to compute by: the required ones, else those in the result."""
    own = rule_set_from_text(result.rules, file="the rules in the result")
    # An installed rule set of the same text may lie in a folder with files that its log map names.
    if given is not None and (required or expanded_yaml(given) == expanded_yaml(own)):
        return given
    return replace(own, sha256=result.provenance.rule_set.sha256)


def _again(
    stored: Result,
    log: Path,
    rule_set: RuleSet,
    log_map: str,
    registry: Registry,
    also: Sequence[Path],
) -> Result:
    """The result computed again, with the values across teams it was priced with."""
    competition = _competition(log, rule_set)
    if competition is None:
        result = score_trial(log, rule_set, log_map=log_map, registry=registry, also=also)
    else:
        run = _run_of(stored, competition)
        configs = [t.config for t in competition.trials if t.id == run.trial]
        configs += [t.config for t in competition.teams if t.id == run.team]
        result = score_trial(
            run.path,
            rule_set,
            log_map=log_map,
            registry=registry,
            also=[config for config in configs if config is not None],
            work_by=work_by_of(competition, rule_set.authority),
            root=competition.root,
            trial_id=run.trial,
            team=run.team,
        )
    return reprice(result, rule_set, stored.cohort) if stored.cohort.values else result


def _competition(log: Path, rule_set: RuleSet) -> Competition | None:
    """The competition at a path, where there is one."""
    # Cheap signs first: loading lists every run, and most logs are no competition.
    if log.name != FILE and not (log / FILE).is_file() and not (log / "logs").is_dir():
        return None
    try:
        return load_competition(log, rule_set.id)
    except (NothingToScoreError, UsageError):
        return None


def _run_of(stored: Result, competition: Competition) -> Run:
    """The run of a competition that a result is of, by the names of its files."""
    names = [source.name for source in stored.provenance.inputs]
    for run in competition.runs:
        own = run.path.relative_to(competition.root).as_posix()
        if any(name == own or name.startswith(f"{own}/") for name in names):
            return run
    raise NothingToScoreError(
        f"the competition has no run with {', '.join(names[:3]) or 'its files'}",
        file=competition.file,
        hint="give the log of the run itself as --log",
    )


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
    return replace(again, provenance=replace(again.provenance, inputs=inputs)), steps


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
    found = _differences(json.loads(before), json.loads(after))
    values = [each for each in found if not _is_record(each[0], stored)]
    words = (
        _listed(values, "in the result", "computed again")
        if values
        else f"the same score, {'task score' if stored.is_former else 'ledger'} and findings"
        + ("; the result does not keep its settings" if stored.measured.settings is None else "")
    )
    versions = list(_versions(stored.provenance, again.provenance))
    if stored.is_former and not values and not versions:
        return Step("recomputed", NOTE, words)
    return Step("recomputed", FAILED, "\n".join([words, *versions]))


def _is_record(place: _Place, stored: Result) -> bool:
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


def _is_of_method(place: _Place) -> bool:
    """Whether a difference is about how the ledger is taken apart, and not about what it adds up to."""
    inside = place[:1] in (("ledger",), ("task",)) and place[1:2] not in ((), ("amount",))
    return (
        inside
        or place == ("ledger_method",)
        or place[:2] in (("measured", "measures"), ("measured", "watched"))
    )


def _versions(stored: Provenance, again: Provenance) -> Iterator[str]:
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


_Place = tuple[str | int, ...]
"""Keys and indices from the root of a document."""


def _differences(first: Any, second: Any) -> list[tuple[_Place, Any, Any]]:
    """Where two documents differ: place, first value, second value; `None` where one has none."""
    return list(_different(first, second, ()))


def _different(first: Any, second: Any, place: _Place) -> Iterator[tuple[_Place, Any, Any]]:
    if isinstance(first, Mapping) and isinstance(second, Mapping):
        for key in dict.fromkeys([*first, *second]):
            yield from _different(first.get(key), second.get(key), (*place, key))
    elif isinstance(first, list) and isinstance(second, list) and len(first) == len(second):
        for i, (one, other) in enumerate(zip(first, second, strict=True)):
            yield from _different(one, other, (*place, i))
    elif first != second:
        yield place, first, second


def _place_text(place: _Place) -> str:
    return "$" + "".join(f"[{step}]" if isinstance(step, int) else f".{step}" for step in place)


def _listed(found: Sequence[tuple[_Place, Any, Any]], first: str, second: str) -> str:
    lines = [
        f"{_place_text(place)}: {_short(one)} {first}, {_short(other)} {second}"
        for place, one, other in found[:SHOWN]
    ]
    return "\n".join([*lines, *([f"and {len(found) - SHOWN} more"] if len(found) > SHOWN else [])])


def _short(value: Any) -> str:
    if value is None:
        return "nothing"
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:59]}…"
