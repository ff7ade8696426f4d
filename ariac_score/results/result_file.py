"""Results as canonical JSON, and back.

Same log, same rule set, same versions: same bytes. Keys are sorted, numbers are
rounded as declared, and there is no wall clock in a result.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import replace
from decimal import Decimal
from pathlib import Path
from typing import Any

from ariac_score.checks.findings import POINTS, Finding, Verdict
from ariac_score.documents.schema import schema_errors, strict_json
from ariac_score.errors import ResultError, ScoreError
from ariac_score.results.adjustments import apply, check_targets
from ariac_score.results.plain_json import canonical_text
from ariac_score.results.result import (
    SIGNIFICANT_DIGITS,
    Coverage,
    Measured,
    Provenance,
    Result,
    Setting,
    Settings,
    Source,
    canonical,
)
from ariac_score.results.sketch import Sketch
from ariac_score.results.sketch_json import sketch_data, sketch_from
from ariac_score.scoring.cohort import CohortValues
from ariac_score.scoring.expression import Traced
from ariac_score.scoring.ledger import Line, reconcile
from ariac_score.scoring.policy import Assumption
from ariac_score.scoring.pricing import price
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.steward import Adjusted, Adjustment
from ariac_score.trial.model import LogDefect, OfficialOrder, OfficialResult
from ariac_score.trial.signals import Sample
from ariac_score.trial.spans import Span

__all__ = [
    "adjustment_data",
    "adjustment_from",
    "as_json",
    "check_follows",
    "findings_json",
    "load_result",
    "measured_sha256",
    "newer_schema",
    "read_result",
    "result_in",
]

SCHEMA = "ariac-score/result/1"
MAX_BYTES = 64 << 20
"""A larger file is no result; those of whole trials have some ten KB."""


def as_json(result: Result) -> str:
    """A result as its canonical text, with a newline at its end.

    Raises:
        ResultError: The ledger does not add up to the score.
    """
    if result.ledger is not None and result.score is not None:
        reconcile(result.ledger, result.score, digits=result.digits)
    text = _canonical_text(_result_data(result))
    if result.measured.settings is not None:
        text = _on_one_line(text, "settings", _settings_data(result.measured.settings))
    if result.measured.sketch is not None:
        text = _on_one_line(text, "sketch", sketch_data(result.measured.sketch))
    return text


def _on_one_line(text: str, key: str, data: Any) -> str:
    """The text with a value of many small parts in the place that was kept for it."""
    place = f'\n "{key}": '  # no other line of the text can begin like this one
    return text.replace(f"{place}null", place + _encodable(json.dumps(data, **_COMPACT)), 1)


def findings_json(measured: Measured) -> str:
    """What was measured alone, by finding: the text of `measured.findings` of a result."""
    return _canonical_text({key: _finding_data(f) for key, f in measured.findings.items()})


def measured_sha256(result: Result) -> str:
    """SHA-256 of what was measured, and from which files: what a steward's decision is made for.

    Prices, values across teams and versions of the code leave it as it is.
    """
    data = {
        "inputs": _provenance_data(result.provenance)["inputs"],
        "measured": _measured_data(result.measured),
    }
    return hashlib.sha256(_canonical_text(data).encode("utf-8")).hexdigest()


_COMPACT: Mapping[str, Any] = {
    "sort_keys": True,
    "separators": (",", ":"),
    "ensure_ascii": False,
    "allow_nan": False,
}


def _canonical_text(data: Any) -> str:
    return _encodable(canonical_text(data)) + "\n"


def _encodable(text: str) -> str:
    """Half a surrogate pair, which a log may hold in a name, has no place in UTF-8 but has one in JSON."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")


def _number(value: float | int) -> float | int:
    return value if isinstance(value, int) else canonical(value)


def _amount(value: Decimal | None) -> float | None:
    return None if value is None else float(value)


def _span(span: Span | None) -> list[float] | None:
    return None if span is None else [canonical(span.start_s), canonical(span.end_s)]


def _sample_data(sample: Sample) -> dict[str, Any]:
    value = sample.value
    plain = [canonical(v) for v in value] if isinstance(value, tuple) else canonical(value)
    return {"signal": sample.signal, "t_s": canonical(sample.t_s), "value": plain, "unit": sample.unit}


def _finding_data(finding: Finding) -> dict[str, Any]:
    return {
        "check": finding.check,
        "subject": finding.subject,
        "verdict": finding.verdict.value,
        "message": finding.message,
        "span_s": _span(finding.span),
        "robustness": None if finding.robustness is None else canonical(finding.robustness),
        "unit": finding.unit,
        "quantities": {k: canonical(v) for k, v in finding.quantities.items()},
        "labels": dict(finding.labels),
        "evidence": [_sample_data(sample) for sample in finding.evidence],
        "clause": finding.clause,
        "critical": finding.critical,
    }


def _traced_data(traced: Traced) -> dict[str, Any]:
    data: dict[str, Any] = {"label": traced.label, "value": _number(traced.value), "kind": traced.kind}
    if traced.op:
        data["op"] = traced.op
    if traced.subject:
        data["subject"] = traced.subject
    if traced.findings:
        data["findings"] = list(traced.findings)
    if traced.children:
        data["children"] = [_traced_data(child) for child in traced.children]
    return data


def _line_data(line: Line) -> dict[str, Any]:
    data: dict[str, Any] = {
        "path": line.path,
        "label": line.label,
        "kind": line.kind,
        "amount": _amount(line.amount),
        "value": _number(line.value),
    }
    if line.subject:
        data["subject"] = line.subject
    if line.findings:
        data["findings"] = list(line.findings)
    if line.trace is not None:
        data["trace"] = _traced_data(line.trace)
    if line.children:
        data["children"] = [_line_data(child) for child in line.children]
    return data


def _scope_data(scope: Scope) -> dict[str, Any]:
    return {
        "level": scope.level,
        "path": scope.path,
        "facts": {k: _number(v) for k, v in scope.facts.items()},
        "inner": [_scope_data(inner) for inner in scope.inner],
    }


def _official_data(official: OfficialResult | None) -> dict[str, Any] | None:
    if official is None:
        return None
    return {
        "source": official.source,
        "total": official.total,
        "process_time_s": official.process_time_s,
        "orders": dict(official.orders),
        "outcome": official.outcome,
        "items": dict(official.items),
        "summaries": [_official_order_data(order) for order in official.summaries],
    }


def _official_order_data(order: OfficialOrder) -> dict[str, Any]:
    return {
        "id": order.id,
        "kind": order.kind,
        "submitted": order.submitted,
        "priority": order.priority,
        "score": order.score,
        "max_score": order.max_score,
        "announced_s": order.announced_s,
        "submitted_s": order.submitted_s,
        "items": dict(order.items),
    }


def _measured_data(measured: Measured) -> dict[str, Any]:
    return {
        "trial": measured.trial,
        "team": measured.team,
        "window_s": _span(measured.window),
        "clock": measured.clock,
        "orders_announced_s": {k: None if v is None else canonical(v) for k, v in measured.orders.items()},
        "findings": {key: _finding_data(f) for key, f in measured.findings.items()},
        "scopes": _scope_data(measured.scopes),
        "coverage": [
            {
                "signal": c.signal,
                "samples": c.samples,
                "rate_hz": canonical(c.rate_hz),
                "largest_gap_s": canonical(c.largest_gap_s),
                "source": c.source,
            }
            for c in measured.coverage
        ],
        "log_defects": [
            {"kind": d.kind, "where": d.where, "count": d.count, "message": d.message}
            for d in measured.log_defects
        ],
        "unrecorded": list(measured.unrecorded),
        "witnessed": list(measured.witnessed),
        "official": _official_data(measured.official),
    }


def _provenance_data(provenance: Provenance) -> dict[str, Any]:
    return {
        "inputs": [
            {"role": s.role, "name": s.name, "bytes": s.bytes, "sha256": s.sha256}
            | ({} if s.read_bytes is None else {"read_bytes": s.read_bytes})
            for s in provenance.inputs
        ],
        "ignored": list(provenance.ignored),
        "rule_set": {"id": provenance.rule_set[0], "sha256": provenance.rule_set[1]},
        "log_map": {"id": provenance.log_map[0], "sha256": provenance.log_map[1]},
        "code": [
            {"distribution": d, "version": v, "package": p, "sha256": h} for d, v, p, h in provenance.code
        ],
    }


def adjustment_data(adjustment: Adjustment) -> dict[str, Any]:
    """A decision of a steward as plain values, as its file has it."""
    target: dict[str, Any] = {"measured": adjustment.measured, "trial": adjustment.trial}
    if adjustment.team:
        target["team"] = adjustment.team
    if adjustment.run is not None:
        target["run"] = adjustment.run
    if adjustment.finding:
        target["finding"] = adjustment.finding
    effects: dict[str, Any] = {
        "verdict": adjustment.verdict or None,
        "points": _amount(adjustment.points),
        "score": _amount(adjustment.score),
        "disqualified": adjustment.disqualified or None,
    }
    return {
        "id": adjustment.id,
        "author": adjustment.author,
        "reason": adjustment.reason,
        "time": adjustment.time,
        "target": target,
        "effect": {name: value for name, value in effects.items() if value is not None},
    }


def _settings_data(settings: Mapping[str, Settings]) -> dict[str, Any]:
    return {
        check: {"source": one.source, "parameters": [_setting_data(each) for each in one.parameters]}
        for check, one in settings.items()
    }


def _setting_data(setting: Setting) -> dict[str, Any]:
    told = {"unit": setting.unit, "status": setting.status, "source": setting.source}
    said = {key: text for key, text in told.items() if text}
    return {"name": setting.name, "value": setting.value, "origin": setting.origin, **said}


def _adjusted_data(adjusted: Adjusted) -> dict[str, Any]:
    return {
        "score": _amount(adjusted.score),
        "ledger": None if adjusted.ledger is None else _line_data(adjusted.ledger),
        "sha256": adjusted.sha256,
        "adjustments": [adjustment_data(adjustment) for adjustment in adjusted.adjustments],
    }


def _result_data(result: Result) -> dict[str, Any]:
    # These keys are there only where they hold something: other results have the bytes they always had.
    adjusted = {} if result.adjusted is None else {"adjusted": _adjusted_data(result.adjusted)}
    settings = {} if result.measured.settings is None else {"settings": None}
    units = result.measured.units
    declared = {} if units is None else {"units": {check: dict(own) for check, own in units.items()}}
    return {
        **adjusted,
        **settings,
        **declared,
        "schema": SCHEMA,
        "sketch": None,
        "rule_set_title": result.rule_set_title,
        "checks": {name: dict(check) for name, check in result.checks.items()},
        "notes": list(result.notes),
        "rules": result.rules,
        "status": result.status,
        "score": _amount(result.score),
        "possible": _amount(result.possible),
        "ledger": None if result.ledger is None else _line_data(result.ledger),
        "task": None if result.task is None else _line_data(result.task),
        "cohort": {
            "sha256": result.cohort.sha256,
            "values": {name: dict(values) for name, values in result.cohort.values.items()},
        },
        "missing": result.missing,
        "assumptions": [
            {"finding": a.finding, "check": a.check, "policy": a.policy, "message": a.message}
            for a in result.assumptions
        ],
        "rounding": {"score_decimals": result.digits, "measured_significant_digits": SIGNIFICANT_DIGITS},
        "measured": _measured_data(result.measured),
        "provenance": _provenance_data(result.provenance),
    }


# From JSON to values -------------------------------------------------------------------


def load_result(path: Path, *, known: bool = False) -> Result:
    """Read a stored result and check that it is whole.

    Args:
        path: The file.
        known: Whether it has the hash of one that was read before, so that its schema
            need not be looked at again; that takes longer than all else.

    Raises:
        ResultError: Missing, not JSON, breaks its schema, its ledger does not add
            up to its score, or the score does not follow from its findings.
    """
    result = read_result(path, known=known)
    try:
        check_follows(result)
    except ResultError as error:
        error.file = str(path)
        raise
    return result


def read_result(path: Path, *, known: bool = False) -> Result:
    """Read a stored result whose sums are right, without pricing its findings again.

    Args:
        path: The file.
        known: Whether it has the hash of one that was read before, as in `load_result`.

    Raises:
        ResultError: Missing, not JSON, breaks its schema, or its ledger does not add
            up to its score.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise _too_large(path)
        document = path.read_bytes()
    except OSError as cause:
        raise ResultError(f"cannot be read: {cause.strerror}", file=path, hint="check the path") from None
    except ValueError as cause:  # a name no file can have, such as one with a null byte
        raise ResultError(f"cannot be read: {cause}", file=path, hint="check the path") from None
    return result_in(document, path, known=known)


def result_in(document: bytes, path: Path, *, known: bool = False) -> Result:
    """The result in the bytes of a file, as `read_result` reads it.

    Args:
        document: What the file holds.
        path: The file, to be named.
        known: As in `load_result`.

    Raises:
        ResultError: Not JSON, breaks its schema, or its ledger does not add up to its score.
    """
    if len(document) > MAX_BYTES:
        raise _too_large(path)
    try:
        text = document.decode("utf-8")
        # What a batch of ours wrote was held against its schema then, and is read in its thousands.
        exact = (json.loads if known else strict_json)(text, parse_float=Decimal)
        told = None if known else strict_json(text)
        faults = [] if known else schema_errors(told, "result")
    except (ValueError, RecursionError) as cause:
        raise ResultError(
            f"not a result: {cause}", file=path, hint="give the JSON that 'score --output-format json' wrote"
        ) from None
    if faults and (newer := newer_schema(told)):
        raise ResultError(newer, file=path, place="$.schema", hint="update ariac-score")
    if faults:
        where = "$" + "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in faults[0][0])
        raise ResultError(
            faults[0][1], file=path, place=where, hint="score the trial again with this version"
        )
    try:
        return _result(exact)
    except ResultError as error:
        error.file = str(path)
        raise
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, ArithmeticError) as cause:
        raise ResultError(f"not a whole result: {cause}", file=path, hint="score the trial again") from None


def _too_large(path: Path) -> ResultError:
    return ResultError(f"larger than {MAX_BYTES:,} bytes", file=path, hint="is this a result?")


def newer_schema(data: Any) -> str:
    """What to tell of a result that a newer version wrote; empty for any other."""
    stated = data.get("schema") if isinstance(data, dict) else None
    name, _, number = str(stated).rpartition("/")
    read_name, _, read = SCHEMA.rpartition("/")
    if name != read_name or not number.isdecimal() or not int(read) < int(number[:9]):
        return ""
    return f"a newer version wrote it, as {name}/{number[:9]}; this one reads {SCHEMA}"


def check_follows(result: Result) -> None:
    """Price the findings again by the rules in the result, and compare every line.

    What stewards decided is applied again as well.

    Raises:
        ResultError: Score or ledger do not follow from the findings, or the adjusted
            score not from the decisions.
    """
    hint = "the result was edited or damaged, or made by another version: score the trial again"
    try:
        rule_set = rule_set_from_text(result.rules, file="the rules in the result")
        priced = price(
            result.measured.findings,
            result.measured.scopes,
            rule_set.sheet,
            rule_set.policies,
            digits=rule_set.digits,
            cohort=result.cohort,
        )
    except ScoreError as error:
        raise ResultError(f"its findings cannot be priced by its rules: {error}", hint=hint) from error
    again, stored = (
        [None if line is None else _line_data(line) for line in (of.ledger, of.task)]
        for of in (priced, result)
    )
    same = (again, priced.status, priced.missing, priced.possible, priced.assumptions, rule_set.digits) == (
        stored,
        result.status,
        result.missing,
        result.possible,
        result.assumptions,
        result.digits,
    )
    if not same:
        raise ResultError("its score does not follow from its findings", hint=hint)
    if result.adjusted is not None:
        _check_adjusted(result, result.adjusted, rule_set)


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
    if _adjusted_data(again) != _adjusted_data(stored):
        raise ResultError("its adjusted score does not follow from its adjustments", hint=hint)


def _plain(value: Any) -> Any:
    """A value of the file with floats for decimals, all the way down."""
    kind = type(value)
    if kind is str or kind is int:  # most are; results are read in their thousands
        return value
    if kind is dict:
        return {key: _plain(inner) for key, inner in value.items()}
    if kind is list:
        return [_plain(inner) for inner in value]
    return float(value) if kind is Decimal else value


def _result(data: Mapping[str, Any]) -> Result:
    digits = data["rounding"]["score_decimals"]
    unit = Decimal(1).scaleb(-digits)
    return Result(
        measured=replace(
            _measured(data["measured"], data.get("units")),
            sketch=_sketch(data.get("sketch")),
            settings=_settings(data.get("settings")),
        ),
        rule_set_title=data["rule_set_title"],
        checks=_plain(data["checks"]),
        notes=tuple(data["notes"]),
        rules=data["rules"],
        status=data["status"],
        score=_exact(data["score"], unit),
        possible=_exact(data["possible"], unit),
        ledger=None if data["ledger"] is None else _line(data["ledger"], unit),
        assumptions=tuple(Assumption(**a) for a in data["assumptions"]),
        digits=digits,
        provenance=_provenance(data["provenance"]),
        task=None if data["task"] is None else _line(data["task"], unit),
        cohort=CohortValues(data["cohort"]["sha256"], _plain(data["cohort"]["values"])),
        missing=data["missing"],
        adjusted=_adjusted(data["adjusted"], unit) if "adjusted" in data else None,
    )


def _adjusted(data: Mapping[str, Any], unit: Decimal) -> Adjusted:
    return Adjusted(
        score=_exact(data["score"], unit),
        ledger=None if data["ledger"] is None else _line(data["ledger"], unit),
        adjustments=tuple(adjustment_from(entry) for entry in data["adjustments"]),
        sha256=data["sha256"],
    )


def adjustment_from(data: Mapping[str, Any]) -> Adjustment:
    """A decision of a steward from plain values, as `adjustment_data` gives them."""
    target, effect = data["target"], data["effect"]
    points, score = effect.get("points"), effect.get("score")
    return Adjustment(
        id=data["id"],
        author=data["author"],
        reason=data["reason"],
        time=data["time"],
        measured=target["measured"],
        team=target.get("team", ""),
        trial=target["trial"],
        run=target.get("run"),
        finding=target.get("finding", ""),
        verdict=effect.get("verdict", ""),
        points=None if points is None else Decimal(points),
        score=None if score is None else Decimal(score),
        disqualified=effect.get("disqualified", False),
        file="the result",
    )


def _sketch(data: Mapping[str, Any] | None) -> Sketch | None:
    return None if data is None else sketch_from(data)


def _settings(data: Mapping[str, Any] | None) -> dict[str, Settings] | None:
    if data is None:
        return None
    return {
        check: Settings(one["source"], tuple(_setting(each) for each in one["parameters"]))
        for check, one in data.items()
    }


def _setting(data: Mapping[str, Any]) -> Setting:
    return Setting(
        data["name"],
        _plain(data["value"]),
        data.get("unit", ""),
        data["origin"],
        data.get("status", ""),
        data.get("source", ""),
    )


def _exact(value: Any, unit: Decimal) -> Decimal | None:
    """A decimal as written, padded to the declared digits but never rounded."""
    if value is None:
        return None
    number = Decimal(value)
    padded = number.quantize(unit)
    return padded if padded == number else number


def _line(data: Mapping[str, Any], unit: Decimal) -> Line:
    return Line(
        path=data["path"],
        label=data["label"],
        kind=data["kind"],
        amount=_exact(data["amount"], unit) or Decimal(0),
        value=_plain(data["value"]),
        children=tuple(_line(child, unit) for child in data.get("children", [])),
        trace=_traced(data["trace"]) if "trace" in data else None,
        findings=tuple(data.get("findings", [])),
        subject=data.get("subject", ""),
    )


def _traced(data: Mapping[str, Any]) -> Traced:
    return Traced(
        label=data["label"],
        value=_plain(data["value"]),
        kind=data["kind"],
        op=data.get("op", ""),
        children=tuple(_traced(child) for child in data.get("children", [])),
        subject=data.get("subject", ""),
        findings=tuple(data.get("findings", [])),
    )


def _span_of(value: Any) -> Span | None:
    return None if value is None else Span(float(value[0]), float(value[1]))


_NO_POINTS = ("_s", "_m", "_m_s", "_rad", "_hz", "_n", "_factor", "dollars")
"""How names of quantities ended that were no points before units were declared."""


def _units_of(
    check: str, quantities: Iterable[str], units: Mapping[str, Mapping[str, str]] | None
) -> dict[str, str]:
    """Declared units; in a result that does not keep them, points as its version took them by name."""
    if units is None:
        return {name: POINTS for name in quantities if not name.endswith(_NO_POINTS)}
    declared = units.get(check, {})
    return {name: declared[name] for name in quantities if name in declared}


def _finding(data: Mapping[str, Any], units: Mapping[str, Mapping[str, str]] | None) -> Finding:
    return Finding(
        subject=data["subject"],
        verdict=Verdict(data["verdict"]),
        message=data["message"],
        span=_span_of(data["span_s"]),
        robustness=None if data["robustness"] is None else float(data["robustness"]),
        unit=data["unit"],
        quantities={k: float(v) for k, v in data["quantities"].items()},
        labels=data["labels"],
        evidence=tuple(_sample(sample) for sample in data["evidence"]),
        clause=data["clause"],
        critical=data["critical"],
        check=data["check"],
        units=_units_of(data["check"], data["quantities"], units),
    )


def _sample(data: Mapping[str, Any]) -> Sample:
    value = data["value"]
    plain = tuple(float(v) for v in value) if isinstance(value, list) else float(value)
    return Sample(data["signal"], float(data["t_s"]), plain, data["unit"])


def _scope(data: Mapping[str, Any]) -> Scope:
    facts = {k: _plain(v) for k, v in data["facts"].items()}
    return Scope(data["level"], data["path"], facts, tuple(_scope(inner) for inner in data["inner"]))


def _measured(data: Mapping[str, Any], units: Mapping[str, Mapping[str, str]] | None) -> Measured:
    official = data["official"]
    return Measured(
        trial=data["trial"],
        findings={key: _finding(f, units) for key, f in data["findings"].items()},
        scopes=_scope(data["scopes"]),
        window=_span_of(data["window_s"]),
        orders={k: None if v is None else float(v) for k, v in data["orders_announced_s"].items()},
        coverage=tuple(
            Coverage(
                c["signal"],
                c["samples"],
                float(c["rate_hz"]),
                float(c["largest_gap_s"]),
                c.get("source", ""),
            )
            for c in data["coverage"]
        ),
        log_defects=tuple(
            LogDefect(d["kind"], d["where"], d["count"], d["message"]) for d in data["log_defects"]
        ),
        unrecorded=tuple(data["unrecorded"]),
        witnessed=tuple(data["witnessed"]),
        clock=data["clock"],
        official=None
        if official is None
        else OfficialResult(
            official["source"],
            _plain(official["total"]),
            _plain(official["process_time_s"]),
            _plain(official["orders"]),
            outcome=official["outcome"],
            summaries=tuple(
                OfficialOrder(**{**_plain(order), "items": order["items"]}) for order in official["summaries"]
            ),
            items=official["items"],
        ),
        team=data["team"],
        units=units,
    )


def _provenance(data: Mapping[str, Any]) -> Provenance:
    return Provenance(
        inputs=tuple(
            Source(s["role"], s["name"], s["bytes"], s["sha256"], s.get("read_bytes")) for s in data["inputs"]
        ),
        ignored=tuple(data["ignored"]),
        rule_set=(data["rule_set"]["id"], data["rule_set"]["sha256"]),
        log_map=(data["log_map"]["id"], data["log_map"]["sha256"]),
        code=tuple((c["distribution"], c["version"], c["package"], c["sha256"]) for c in data["code"]),
    )
