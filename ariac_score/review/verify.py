"""Checking a stored result: in itself, against the installed versions, and against its log.

Without its log a result can only be checked for whether its score follows from its findings.
With the log everything is computed again and compared to the byte.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from ariac_score.checks.finding_contract import stored_breaches
from ariac_score.checks.findings import canonical
from ariac_score.checks.local import GIVEN_DISTRIBUTION, LocalFiles
from ariac_score.checks.registry import LOCAL_DISTRIBUTION, Registry, package_sha256
from ariac_score.documents.plain_file import read_plain
from ariac_score.documents.schema import strict_json
from ariac_score.engine.price import check_uses
from ariac_score.engine.settings import plain_value
from ariac_score.errors import (
    LocalPluginError,
    NoResultError,
    NothingToScoreError,
    PluginError,
    ResultError,
    ScoreError,
)
from ariac_score.ranking.competition import Competition, registry_for, signed_for
from ariac_score.results.adjustments import adjust, load_adjustments
from ariac_score.results.codec import MAX_BYTES
from ariac_score.results.cohort_file import load_cohort
from ariac_score.results.result import Code, Measured, Result
from ariac_score.results.result_file import (
    RESULT,
    as_json,
    check_follows,
    check_rules,
    measured_sha256,
    read_result,
)
from ariac_score.results.signing import check_signature, keys_asked_for
from ariac_score.review.computed_again import compared_with_log, competition_at, installed_rules
from ariac_score.review.differences import SHOWN, differences, listed
from ariac_score.review.steps import FAILED, NOTE, OK, OPEN, Step, Verification
from ariac_score.review.wheels import check_wheels
from ariac_score.scoring.policy import OPEN as OPEN_POLICY
from ariac_score.scoring.ruleset import RuleSet, load_rule_set, rule_set_from_text

__all__ = ["is_ranking", "verify_result"]


def verify_result(
    path: Path,
    *,
    log: Path | None = None,
    rules: str = "",
    log_map: str = "",
    also: Sequence[Path] = (),
    cohort: Path | None = None,
    adjustments: Path | None = None,
    public_key: str = "",
    signature: Path | None = None,
    registry: Registry | None = None,
    local_plugins: bool = False,
    wheels: Sequence[Path] = (),
) -> Verification:
    """Check a stored result.

    Args:
        path: The result.
        log: Its log, bundle, or the competition it is a run of; then everything is computed again.
        rules: The rule set it must be scored by; without it, that of the competition, or the installed one
            of the same name.
        log_map: Log map, where the rule set names one that lies elsewhere.
        also: Configurations that it was scored with, where they lie elsewhere than the log.
        cohort: The published values across teams, where `log` is no competition to compute them from.
        adjustments: The stewards' file, where the result is adjusted; without it, that of the competition.
        public_key: Whose signature it must have; empty for the key of the competition, or of the rules that
            are given or installed (`authority: {signed_by: …}`), or for nobody's.
        signature: The file of that; by default next to the result.
        registry: The installed plugins.
        local_plugins: Whether files of code beside the rule set may run, where they are those that the
            result states; it counts where no `registry` is given.
        wheels: Files of wheels that must have the code that the result names.

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
        signed = _signed(path, keys_asked_for((), public_key), signature)
        return Verification((*_unread(error, data), *signed), None)
    competition = None if log is None else competition_at(log, result.provenance.rule_set.id)
    root = _root_of(rules, competition, result)
    keys = keys_asked_for(_organiser(competition, root), public_key)
    bound = "" if competition is None else signed_for(competition)
    signed = _signed(path, keys, signature, bound)
    steps = [*_by_itself(result, text, data["schema"]), _rules(result, root)]
    steps.append(_code(result, files_run=local_plugins and log is not None, with_log=log is not None))
    decided = adjustments or (competition.adjustments if competition is not None else None)
    if wheels:
        steps += check_wheels(result.provenance.code, wheels)
    if result.adjusted is not None or adjustments is not None:
        steps.append(_adjustments(result, decided))
        if decided is not None and result.adjusted is not None and keys:
            holds, reason = check_signature(decided, keys, competition=bound)
            steps.append(Step("decisions", OK if holds else FAILED, reason))
    if result.cohort.is_given and competition is None:
        steps.append(_cohort(result, cohort))
    steps += signed
    if log is None:
        return Verification((*steps, Step("log", OPEN, _NO_LOG)), result)
    rule_set = _rule_set_for(result, root)
    if local_plugins and registry is None:
        registry = Registry(LocalFiles(_stated_files(result)))
        changed = list(_changed_files(rule_set, registry))
        if changed:  # another text says nothing about this result, and may do anything
            return Verification((*steps, *changed), result)
        if files := ", ".join(sorted(_stated_files(result))):
            steps.append(Step("local", OK, f"{files} beside the rule set made it"))
    if registry is None:
        registry = Registry() if competition is None else registry_for(competition)
    # The automatic result: decisions of stewards are applied to it, not measured.
    steps += compared_with_log(
        result.automatic,
        log if competition is None else competition,
        rule_set,
        log_map=log_map,
        registry=registry,
        also=also,
        path=path,
    )
    return Verification(tuple(steps), result)


def _by_itself(result: Result, text: str, schema: str) -> Iterator[Step]:
    """Whether a result agrees with itself."""
    yield Step("schema", OK, schema)
    yield Step("sums", OK, f"every line of the ledger adds up to {_amount(result)}")
    yield from _follows(result)
    if result.is_former:
        yield Step("ledger", NOTE, _FORMER)
    yield _possible(result.measured)
    yield _canonical(text, schema, result)


_NO_LOG = (
    "not compared with a log, so what was measured is the word of the file alone; --log PATH compares it"
)


@dataclass(frozen=True)
class _Root:
    """The rule set that a result must be scored by, and who says so: `given`, `installed`, …"""

    rule_set: RuleSet
    whose: str


def _root_of(rules: str, competition: Competition | None, result: Result) -> _Root | None:
    """The rules that are trusted; `None` where nobody but the result says what they are."""
    if rules:
        return _Root(load_rule_set(rules), "as given")
    if competition is not None and competition.rules != result.provenance.rule_set.id:
        return _Root(load_rule_set(competition.rules), f"of {competition.id}")
    installed = installed_rules(result.provenance.rule_set.id)
    return None if installed is None else _Root(installed, "as installed")


def _organiser(competition: Competition | None, root: _Root | None) -> tuple[str, ...]:
    """Whose signature is asked for: never what the result itself says, which a forger would write as well."""
    own = () if root is None else root.rule_set.authority.signed_by
    return own if competition is None else competition.signed_by or own


def _signed(path: Path, keys: Sequence[str], signature: Path | None, competition: str = "") -> list[Step]:
    if not keys:
        return []
    holds, reason = check_signature(path, keys, signature, competition=competition)
    return [Step("signature", OK if holds else FAILED, reason)]


_FORMER = (
    "taken apart by the former method, factor by factor; score, task score, what was possible and "
    "assumptions were compared exactly, its lines only with their sums"
)

# The result alone ----------------------------------------------------------------------


_CHECKED_BY: Mapping[str, str] = {
    "audit": "'ariac-score audit PATH' computes it again",
    "cohort": "'ariac-score rank COMPETITION --cohort-output FILE' computes it again",
    "outcome": "it says why a run has no result; 'ariac-score batch PATH -o OUT' tries the run again",
}
"""What checks the other kinds of documents, by the name of their format."""


def _refuse_other_document(data: Any, path: Path) -> None:
    """Refuse a document of ours that is no result: it is sound perhaps, but not for this command to say.

    Raises:
        ResultError: It is one.
    """
    kind = _kind_of(data)
    if kind in _CHECKED_BY:
        article = "an" if kind[0] in "ao" else "a"
        raise ResultError(
            f"it is the JSON of {article} {kind}, not of a result", file=path, hint=_CHECKED_BY[kind]
        )


def is_ranking(path: Path) -> bool:
    """Whether a file calls itself a ranking; `verify_ranking` is for those."""
    _, data = _read(path)
    return _kind_of(data) == "ranking"


def _kind_of(data: Any) -> str:
    """The name of the format that a document states; empty where it states none."""
    tag = data.get("schema") if isinstance(data, dict) else None
    return tag.removeprefix("ariac-score/").partition("/")[0] if isinstance(tag, str) else ""


def _read(path: Path) -> tuple[str, Any]:
    if path.is_dir():
        raise NothingToScoreError(
            "it is a folder, not a result",
            file=path,
            hint="name the JSON file that 'score -o FILE.json' wrote",
        )
    try:
        text = read_plain(path, MAX_BYTES).decode("utf-8")
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
    found = differences(json.loads(text), json.loads(as_json(result)))
    words = (
        "the same values, written in another way" if not found else listed(found, "in the file", "as read")
    )
    return Step("bytes", FAILED, words)


def _as_before(policy: str) -> str:
    return "withhold" if policy == OPEN_POLICY else policy


def _rules(result: Result, root: _Root | None) -> Step:
    """Whether the rules in the result have the hash it states, and are those that are trusted."""
    name = result.provenance.rule_set.id
    own = rule_set_from_text(result.rules, file="the rules in the result")
    try:
        check_rules(result)
    except ResultError as error:
        return Step("rules", FAILED, error.cause)
    if own.id != name:
        return Step(
            "rules", FAILED, f"the rules in the result are {own.id!r}, it says that it is by {name!r}"
        )
    uses = check_uses(own)
    if result.is_former:  # until then what nobody said anything about withheld the score
        uses = {n: {**u, "on_inconclusive": _as_before(u["on_inconclusive"])} for n, u in uses.items()}
    if (own.title, own.notes, uses) != (result.rule_set_title, result.notes, result.checks):
        return Step("rules", FAILED, "title, notes or checks are not those of the rules in the result")
    for check, parameter in _given_otherwise(result, own):
        words = f"settings of {check!r} give {parameter!r} another value than the rules in the result"
        return Step("rules", FAILED, words)
    if root is None:
        words = f"{name} is not installed here, so its rules are the word of the file alone; --rules NAME"
        return Step("rules", OPEN, words)
    if root.rule_set.text != own.text:
        found = differences(own.expanded, root.rule_set.expanded)
        words = listed(found, "in the result", f"in {root.rule_set.id} {root.whose}")
        words = f"{name} is another rule set than {root.rule_set.id} {root.whose}: {words}"
        return Step("rules", FAILED, words if root.whose == "as given" else f"{words}\n{_OTHER_VERSION}")
    return Step("rules", OK, f"{name} {root.whose}, sha256 {root.rule_set.sha256[:16]}…")


_OTHER_VERSION = "if it was scored by another version of these rules, give that one: --rules FILE"


def _given_otherwise(result: Result, rules: RuleSet) -> Iterator[tuple[str, str]]:
    """Parameters that the settings ascribe to the rule set with another value than it gives."""
    between = _between_samples(rules)
    for name, kept in (result.measured.settings or {}).items():
        given = dict(result.checks[name]["with"] if name in result.checks else {})
        stated = {one.name: one for one in kept.parameters}
        for parameter in sorted(given.keys() - stated.keys()):
            yield name, parameter
        known = {**between, **given}
        for parameter, one in stated.items():
            if one.origin == "rule_set" and (
                parameter not in known or _text(one.value) != _text(plain_value(known[parameter]))
            ):
                yield name, parameter


def _between_samples(rules: RuleSet) -> dict[str, Any]:
    """What a rule set says of the time between two samples, by the names that settings have for it."""
    found: dict[str, Any] = {"between_samples": rules.between_samples}
    for name, own in rules.bounds.items():
        numbers = own if isinstance(own, Mapping) else {"": own}
        for inner, number in numbers.items():
            if inner != "source":
                found[".".join(filter(None, ("bounds", name, inner)))] = canonical(float(number))
    return found


def _text(value: Any) -> str:
    return json.dumps(value, sort_keys=True)


def _code(result: Result, *, files_run: bool, with_log: bool) -> Step:
    """Which recorded versions are not those installed here; with the log, `recomputed` judges them."""
    otherwise = NOTE if with_log else OPEN
    if not result.provenance.code:
        return Step("code", otherwise, "the result does not say which code made it")
    # Files beside the rule set that run are compared before they do, in a step of their own.
    files = [one for one in result.provenance.code if one.distribution == LOCAL_DISTRIBUTION]
    compared = [one for one in result.provenance.code if not (files_run and one in files)]
    others = [words for each in compared if (words := _other(each))]
    if others:
        return Step("code", otherwise, "\n".join(others))
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


def _adjustments(result: Result, file: Path | None) -> Step:
    """Whether the stewards' file gives the adjusted score of the result."""
    if result.adjusted is None:
        return Step("adjustments", FAILED, "the result is automatic; nobody has adjusted it")
    if file is None:
        words = "the decisions are the word of the file alone; --adjustments FILE compares them"
        return Step("adjustments", OPEN, words)
    loaded = load_adjustments(file)
    try:
        again, _ = adjust(result.automatic, loaded, measured=measured_sha256(result.automatic))
    except ScoreError as error:
        return Step("adjustments", FAILED, error.cause)
    if as_json(again) == as_json(result):
        return Step(
            "adjustments", OK, f"the decisions are those of {file.name}, sha256 {loaded.sha256[:16]}…"
        )
    found = differences(json.loads(as_json(result)), json.loads(as_json(again)))
    return Step("adjustments", FAILED, listed(found, "in the result", f"by {file.name}"))


def _cohort(result: Result, file: Path | None) -> Step:
    """Whether the values across teams that it was priced with are the published ones."""
    if file is None:
        words = (
            "values across teams are the word of the file alone; --cohort FILE compares them, "
            "--log COMPETITION computes them again"
        )
        return Step("cohort", OPEN, words)
    own = rule_set_from_text(result.rules, file="the rules in the result")
    values = load_cohort(file, own).of_trial(result.measured.trial, result.measured)
    stated = {name: found for name, found in result.cohort.values.items() if name in own.sheet.cohort}
    if (values.values, values.sha256) != (stated, result.cohort.sha256):
        found = differences({**stated}, {**values.values})
        words = listed(found, "in the result", f"in {file.name}") or "its hash is another one"
        return Step("cohort", FAILED, words)
    if len(stated) < len(result.cohort.values) or result.cohort.beyond:
        return Step("cohort", OPEN, "what other runs of the team did: --log COMPETITION computes it again")
    return Step("cohort", OK, f"the values across teams are those of {file.name}")


# With its log --------------------------------------------------------------------------


def _rule_set_for(result: Result, root: _Root | None) -> RuleSet:
    """The rules to compute by: those that are given, else those in the result."""
    own = rule_set_from_text(result.rules, file="the rules in the result")
    # An installed rule set of the same text may lie in a folder with files that its log map names.
    if root is not None and (root.whose != "as installed" or root.rule_set.text == own.text):
        return root.rule_set
    return own
