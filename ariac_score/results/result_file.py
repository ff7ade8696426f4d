"""Stored results: written, read and checked, also those that an older version wrote."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import replace
from decimal import Decimal
from os import PathLike
from pathlib import Path
from typing import Annotated, Any

from msgspec import UNSET, Meta, Struct, UnsetType

from ariac_score.checks.finding_contract import stored_breaches
from ariac_score.checks.findings import POINTS
from ariac_score.documents.given import path_of, refuse_other
from ariac_score.errors import ResultError, ScoreError
from ariac_score.results.adjustments import apply, check_targets
from ariac_score.results.codec import Format, as_text, encodable, plain
from ariac_score.results.doubt import as_scored
from ariac_score.results.result import SEQUENCE, Measured, Result
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.ledger import Ledger, reconcile
from ariac_score.scoring.pricing import price
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text
from ariac_score.scoring.steward import Adjusted

__all__ = [
    "RESULT",
    "Decision1",
    "as_json",
    "check_follows",
    "check_rules",
    "decision_from_1",
    "findings_json",
    "load_result",
    "measured_sha256",
    "read_result",
    "refuse_impossible",
    "result_in",
]


def as_json(result: Result) -> str:
    """A result as its canonical text, with a newline at its end.

    Raises:
        ResultError: The ledger does not add up to the score.
    """
    refuse_other(result, Result, "a result", "score_trial and load_result give one")
    if result.ledger is not None and result.score is not None:
        reconcile(result.ledger, result.score, digits=result.digits)
    return RESULT.text(result)


def findings_json(measured: Measured) -> str:
    """Only the findings, by id: `measured.findings` of a result."""
    return as_text(measured.findings)


# What decisions are made for -----------------------------------------------------------

# By name: a field that `Measured` or `Finding` gets later must not change hashes that decisions hold.
_HASHED = (
    *("trial", "team", "clock", "scopes", "coverage"),
    *("log_defects", "unrecorded", "witnessed", "official"),
)
_HASHED_OF_FINDING = (
    "check",
    "subject",
    "verdict",
    "message",
    "robustness",
    "unit",
    "quantities",
    "labels",
    "evidence",
    "clause",
    "critical",
)


def measured_sha256(result: Result) -> str:
    """SHA-256 of what was measured, and from which files: a steward's decision names it.

    Prices, values across teams and versions of the code do not change it. Neither does the format: the
    hash is of the text that `result/1` had, because files of decisions hold it and outlive formats.
    """
    measured = plain(replace(result.measured, sketch=None, settings=None))
    stated = {
        **{name: measured[name] for name in _HASHED},
        "window_s": _ends(measured["window"]),
        "orders_announced_s": measured["orders"],
        "findings": {
            key: {**{name: finding[name] for name in _HASHED_OF_FINDING}, "span_s": _ends(finding["span"])}
            for key, finding in measured["findings"].items()
        },
    }
    for name in ("open", "lasted"):  # not where nothing is: files of decisions hold hashes from before
        if name in measured:
            stated[name] = measured[name]
    data = encodable({"inputs": plain(result.provenance.inputs), "measured": stated})
    text = json.dumps(data, sort_keys=True, indent=1, ensure_ascii=False) + "\n"
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def _ends(span: Mapping[str, float] | None) -> list[float] | None:
    return None if span is None else [span["start_s"], span["end_s"]]


# The versions before -------------------------------------------------------------------
#
# What it may hold is stated here as far as keys are renamed, moved or dropped: what comes under the new
# name, or in the new place, would be replaced unseen. A key that is missing is named by `_from_1`.


class _Rounding1(Struct, frozen=True, forbid_unknown_fields=True):
    score_decimals: Annotated[int, Meta(ge=0, le=12)] | UnsetType = UNSET
    measured_significant_digits: int | UnsetType = UNSET


class _Finding1(Struct, frozen=True, forbid_unknown_fields=True):
    check: str | UnsetType = UNSET
    span_s: tuple[float, float] | UnsetType | None = UNSET
    quantities: dict[str, float] | UnsetType = UNSET
    subject: Any = UNSET
    verdict: Any = UNSET
    message: Any = UNSET
    robustness: Any = UNSET
    unit: Any = UNSET
    labels: Any = UNSET
    evidence: Any = UNSET
    clause: Any = UNSET
    critical: Any = UNSET


class _Measured1(Struct, frozen=True, forbid_unknown_fields=True):
    window_s: tuple[float, float] | UnsetType | None = UNSET
    orders_announced_s: Any = UNSET
    findings: dict[str, _Finding1] | UnsetType = UNSET
    coverage: tuple[dict[str, Any], ...] | UnsetType = UNSET
    trial: Any = UNSET
    scopes: Any = UNSET
    log_defects: Any = UNSET
    unrecorded: Any = UNSET
    witnessed: Any = UNSET
    clock: Any = UNSET
    official: Any = UNSET
    team: Any = UNSET


class _Target1(Struct, frozen=True, forbid_unknown_fields=True):
    measured: Any = UNSET
    trial: Any = UNSET
    team: Any = UNSET
    run: Any = UNSET
    finding: Any = UNSET


class _Effect1(Struct, frozen=True, forbid_unknown_fields=True):
    verdict: Any = UNSET
    points: Any = UNSET
    score: Any = UNSET
    disqualified: Any = UNSET


class Decision1(Struct, frozen=True, forbid_unknown_fields=True):
    """A decision of a steward as `result/1` and `ranking/2` stored it."""

    id: Any = UNSET
    author: Any = UNSET
    reason: Any = UNSET
    time: Any = UNSET
    target: _Target1 | UnsetType = UNSET
    effect: _Effect1 | UnsetType = UNSET


class _Line1(Struct, frozen=True):
    children: tuple[_Line1, ...] = ()


class _Adjusted1(Struct, frozen=True):
    adjustments: tuple[Decision1, ...] | UnsetType = UNSET
    ledger: _Line1 | None = None


class _Settings1(Struct, frozen=True):
    parameters: tuple[dict[str, Any], ...] | UnsetType = UNSET


class _Result1(Struct, frozen=True, forbid_unknown_fields=True):
    rounding: _Rounding1 | UnsetType = UNSET
    measured: _Measured1 | UnsetType = UNSET
    units: dict[str, dict[str, str]] | None = None
    settings: dict[str, _Settings1] | None = None
    adjusted: _Adjusted1 | None = None
    ledger: _Line1 | None = None
    task: _Line1 | None = None
    sketch: Any = UNSET
    assumptions: Any = UNSET
    checks: Any = UNSET
    cohort: Any = UNSET
    missing: Any = UNSET
    notes: Any = UNSET
    possible: Any = UNSET
    provenance: Any = UNSET
    rule_set_title: Any = UNSET
    rules: Any = UNSET
    score: Any = UNSET
    status: Any = UNSET


def _from_1(data: dict[str, Any]) -> dict[str, Any]:
    """`result/1` as `result/2`: spans by name, decisions flat, sketch and settings among the measured."""
    data = dict(data)
    digits = data.pop("rounding")["score_decimals"]
    measured = dict(data["measured"])
    measured["window"] = _span(measured.pop("window_s"))
    measured["orders"] = measured.pop("orders_announced_s")
    findings = {key: dict(finding) for key, finding in measured["findings"].items()}
    declared = data.pop("units", None)
    for finding in findings.values():
        finding["span"] = _span(finding.pop("span_s"))
        finding["units"] = _units(finding, declared)
    measured |= {
        "findings": findings,
        "sketch": data.pop("sketch", None),
        "settings": _settings(data.pop("settings", None)),
    }
    # `result/1` kept no source of a signal.
    measured["coverage"] = [{"source": ""} | dict(one) for one in measured["coverage"]]
    if data.get("adjusted") is not None:
        adjustments = [decision_from_1(one) for one in data["adjusted"]["adjustments"]]
        data["adjusted"] = _priced({**data["adjusted"], "adjustments": adjustments}, digits)
    return _priced({**data, "digits": digits, "measured": measured, "adjusted": data.get("adjusted")}, digits)


_NO_POINTS = ("_s", "_m", "_m_s", "_rad", "_hz", "_n", "_factor", "dollars")
"""Before units were declared, quantities were taken for points unless their name ended so."""


def _units(finding: Mapping[str, Any], declared: Mapping[str, Mapping[str, str]] | None) -> dict[str, str]:
    """Declared units; for a result without any, points by the names of quantities, as its version had it."""
    names = finding["quantities"]
    if declared is None:
        return {name: POINTS for name in names if not name.endswith(_NO_POINTS)}
    own = declared.get(finding["check"], {})
    return {name: own[name] for name in names if name in own}


def _settings(data: Mapping[str, Any] | None) -> dict[str, Any] | None:
    return (
        None
        if data is None
        else {
            check: {**one, "parameters": [{"unit": ""} | setting for setting in one["parameters"]]}
            for check, one in data.items()
        }
    )


def _span(ends: list[float] | None) -> dict[str, float] | None:
    if ends is None:
        return None
    start_s, end_s = ends
    return {"start_s": start_s, "end_s": end_s}


def decision_from_1(data: Mapping[str, Any]) -> dict[str, Any]:
    """A decision of a steward; `result/1` and `ranking/2` stored target and effect as objects."""
    own = {key: value for key, value in data.items() if key not in ("target", "effect")}
    return {**own, **data["target"], **data["effect"]}


def _priced(data: dict[str, Any], digits: int) -> dict[str, Any]:
    """A part of a result with its amounts padded to the declared digits, which `result/1` did not store."""
    unit = Decimal(1).scaleb(-digits)
    for name in ("score", "possible", "amount"):
        if isinstance(data.get(name), int | float):
            number = Decimal(repr(data[name]))
            padded = number.quantize(unit)
            data[name] = padded if padded == number else number
    for name in ("ledger", "task"):
        if data.get(name) is not None:
            data[name] = _priced(dict(data[name]), digits)
    if "children" in data:
        data["children"] = [_priced(dict(child), digits) for child in data["children"]]
    return data


def _from_2(data: dict[str, Any]) -> dict[str, Any]:
    """`result/2` as `result/3`: its ledger stays as the former method took it apart."""
    if "ledger_method" in data or data["measured"].keys() & {"measures", "watched"}:
        raise ValueError("keys that `result/2` did not have")
    measured = dict(data["measured"])
    measured["sketch"] = _sketch_from_2(measured.get("sketch"))
    return {**data, "ledger_method": SEQUENCE, "measured": measured}


def _sketch_from_2(sketch: Any) -> Any:
    """The sketch with work of any levels: until then there were orders, tasks and parts."""
    if not isinstance(sketch, Mapping) or not ({"asked", "brought"} & set(sketch)):
        return sketch
    asked: list[dict[str, Any]] = []
    for task in sketch.get("asked", ()):
        order, path = task["order"], f"{task['order']}/{task['task']}"
        if not asked or all(known["path"] != order for known in asked):
            asked.append({"path": order, "level": "order", "words": ""})
        asked.append({"path": path, "level": "submission", "words": _other_words(task)})
        asked += [
            {"path": f"{path}/{part['slot']}", "level": "part", "words": part["type"]}
            for part in task["parts"]
        ]
    brought = [
        {
            "item": one["task"],
            "submitted_s": one["submitted_s"],
            "words": _other_words(one),
            "contents": one["parts"],
        }
        for one in sketch.get("brought", ())
    ]
    return {**sketch, "asked": asked, "brought": brought}


def _other_words(former: Mapping[str, Any]) -> str:
    """What was kept beside the names: the kind first, then places."""
    kept = sorted(former.items(), key=lambda item: item[0] != "kind")
    told = (v for key, v in kept if key not in ("order", "task") and isinstance(v, str))
    return ", ".join(words for words in told if words not in ("", "any"))


RESULT = Format(
    "result",
    3,
    Result,
    before={1: _from_1, 2: _from_2},
    shapes={1: _Result1},
    error=ResultError,
    made_by="'score -o FILE.json'",
)
"""How a result is stored."""


# Reading -------------------------------------------------------------------------------


@in_own_decimals
def load_result(path: str | PathLike[str], *, known: bool = False) -> Result:
    """Read a stored result and check that it is whole.

    Args:
        path: The file.
        known: Whether its hash is that of a result that was read before, so that its keys need
            not be checked again.

    Raises:
        ResultError: Missing, not JSON, no result, its ledger does not add
            up to its score, or the score does not follow from its findings.
    """
    path = path_of(path, "the path of a stored result")
    result = read_result(path, known=known)
    try:
        check_rules(result)
        check_follows(result)
    except ResultError as error:
        error.file = str(path)
        raise
    return result


def refuse_impossible(result: Result, file: Path) -> None:
    """Refuse to price a stored result with a finding that breaks the contract of findings.

    Args:
        result: As it is stored.
        file: Where, for the message.

    Raises:
        ResultError: One does; the message names it and its field.
    """
    measured = result.measured
    for key, breach in stored_breaches(measured.findings, measured.measures, measured.watched):
        raise ResultError(
            f"the finding {key} cannot be: {breach}",
            file=file,
            hint="score the log again; 'ariac-score verify' shows every such finding",
        )


def read_result(path: Path, *, known: bool = False) -> Result:
    """Read a stored result whose sums are right, without pricing its findings again.

    Args:
        path: The file.
        known: As in `load_result`.

    Raises:
        ResultError: Missing, not JSON, no result, or its ledger does not add up to its score.
    """
    return RESULT.read(path, known=known)


@in_own_decimals
def result_in(document: bytes, path: Path, *, known: bool = False) -> Result:
    """The result in the bytes of a file, as `read_result` reads it.

    Args:
        document: What the file holds.
        path: The file, for error messages.
        known: As in `load_result`.

    Raises:
        ResultError: Not JSON, no result, or its ledger does not add up to its score.
    """
    return RESULT.decoded(document, path, known=known)


def check_rules(result: Result) -> None:
    """Compare the rules that a result holds with the hash and the name that it states for them.

    Results of before `result/3` state the hash of the files that their rules were written in.

    Raises:
        ResultError: They are others.
    """
    stated = result.provenance.rule_set
    found = hashlib.sha256(result.rules.encode("utf-8")).hexdigest()
    if found != stated.sha256 and not result.is_former:
        raise ResultError(
            f"the rules in it have SHA-256 {found[:12]}…, and it says that it is by {stated.id}, "
            f"SHA-256 {stated.sha256[:12]}…",
            place="$.rules",
            hint="they were edited: score the trial again under the published rule set",
        )


def check_follows(result: Result, rule_set: RuleSet | None = None) -> None:
    """Price the findings again by the rules in the result, and compare every line.

    Decisions of stewards are applied again as well. Of a ledger that the former method took apart only
    the sum is compared.

    Args:
        result: As it was read.
        rule_set: The rules in it, where they are loaded already.

    Raises:
        ResultError: Score or ledger do not follow from the findings, or the adjusted
            score not from the decisions.
    """
    hint = "the result was edited or damaged, or made by another version: score the trial again"
    try:
        rule_set = rule_set or rule_set_from_text(result.rules, file="the rules in the result")
        priced = price(
            result.measured.findings,
            result.measured.scopes,
            rule_set.sheet,
            rule_set.policies,
            digits=rule_set.digits,
            cohort=result.cohort,
            measures=result.measured.measures,
            left_open=as_scored(result, rule_set),
        )
        if result.is_former:
            priced = replace(priced, interval=None)
    except ScoreError as error:
        raise ResultError(f"its findings cannot be priced by its rules: {error}", hint=hint) from error
    again, stored = (
        (
            *((_amount(e.ledger), _amount(e.task)) if result.is_former else (e.ledger, e.task)),
            *(e.status, e.missing, e.possible, e.assumptions, e.interval),
        )
        for e in (priced, result)
    )
    if (again, rule_set.digits) != (stored, result.digits):
        raise ResultError("its score does not follow from its findings", hint=hint)
    if result.adjusted is not None:
        _check_adjusted(result, result.adjusted, rule_set)


def _amount(ledger: Ledger | None) -> Decimal | None:
    return None if ledger is None else ledger.amount


def _check_adjusted(result: Result, stored: Adjusted, rule_set: RuleSet) -> None:
    """Apply the decisions in a result to its automatic part again.

    Raises:
        ResultError: They were made for another result, or give another score.
    """
    hint = "apply the adjustments to the automatic result again: ariac-score adjust"
    automatic = result.automatic
    measured = measured_sha256(automatic)
    for decision in stored.adjustments:
        if decision.measured != measured:
            raise ResultError(f"adjustment {decision.id!r} was made for another result", hint=hint)
    try:
        check_targets(stored.adjustments, automatic, rule_set)
        again = apply(automatic, stored.adjustments, rule_set, sha256=stored.sha256)
    except ScoreError as error:
        raise ResultError(f"its adjustments cannot be applied to it: {error.cause}", hint=hint) from error
    if again != stored:
        raise ResultError("its adjusted score does not follow from its adjustments", hint=hint)
