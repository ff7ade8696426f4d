"""`adjustments.yaml`: decisions of stewards, loaded, checked against results, applied on top of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime, timezone
from decimal import Decimal
from pathlib import Path
from typing import Any

from msgspec import structs

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.documents.schema import validate
from ariac_score.documents.yaml import YamlDocument, load_yaml
from ariac_score.errors import DataFileError, did_you_mean
from ariac_score.results.doubt import as_scored
from ariac_score.results.result import Result
from ariac_score.results.still_open import as_counted, still_open
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.interval import ScoreInterval
from ariac_score.scoring.left_open import LeftOpen
from ariac_score.scoring.pricing import CountedWorld, Priced, counted_world, ends_of_term, price
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text
from ariac_score.scoring.steward import (
    Adjusted,
    Adjustment,
    FiledAdjustment,
    adjusted_ledger,
    check_effects,
    with_verdicts,
)

__all__ = [
    "Adjustments",
    "adjust",
    "adjustments_template",
    "apply",
    "check_targets",
    "counted_as_decided",
    "ends_as_decided",
    "interval_that_counts",
    "load_adjustments",
    "priced_with",
]


@dataclass(frozen=True)
class Adjustments:
    """One file of decisions.

    Attributes:
        file: As the user named it.
        sha256: Of its bytes.
        decisions: In the order of the file.
    """

    file: str
    sha256: str
    decisions: tuple[Adjustment, ...]


def load_adjustments(path: Path) -> Adjustments:
    """Read an `adjustments.yaml`.

    Raises:
        DataFileError: Missing, malformed, two decisions of one name, a time without a zone,
            or an effect that does not go with its target.
    """
    document = load_yaml(path)
    if document.data is None:
        raise DataFileError("the file is empty", file=path, hint="it needs a list 'adjustments:'")
    document = replace(document, data=_with_times(document))
    validate(document, "adjustments")
    decisions = tuple(_decision(document, i, entry) for i, entry in enumerate(document.data["adjustments"]))
    seen: set[str] = set()
    for decision in decisions:
        if decision.id in seen:
            raise decision.refuse("the name is given twice", "give each decision a name of its own")
        seen.add(decision.id)
    return Adjustments(document.file, document.sha256, decisions)


def _with_times(document: YamlDocument) -> Any:
    """The data with every time as text in UTC; YAML reads an unquoted time as one of its own."""
    data = document.data
    entries = data.get("adjustments") if isinstance(data, dict) else None
    if not isinstance(entries, list):
        return data
    return {
        **data,
        "adjustments": [
            {**entry, "time": _time(document, i, entry["time"])}
            if isinstance(entry, dict) and "time" in entry
            else entry
            for i, entry in enumerate(entries)
        ],
    }


def _time(document: YamlDocument, number: int, value: Any) -> Any:
    """A time as text in UTC; anything that is no time as it is, for the schema to refuse."""
    if isinstance(value, str):
        try:
            value = datetime.fromisoformat(value.replace("Z", "+00:00"))  # Python 3.10 takes no Z
        except ValueError:
            return value  # the schema says what is wrong with it
    if isinstance(value, datetime) and value.tzinfo is not None:
        try:
            return value.astimezone(timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
        except OverflowError:  # at the edge of the calendar, and beyond it in UTC
            raise DataFileError(
                f"{str(value)!r} is no time in UTC",
                file=document.file,
                place=document.place(["adjustments", number, "time"]),
                hint="write when it was decided, such as 2026-05-12T14:30:00Z",
            ) from None
    if isinstance(value, date):
        raise DataFileError(
            f"{str(value)!r} is no point in time: it lacks "
            + ("its time zone" if isinstance(value, datetime) else "the time of day"),
            file=document.file,
            place=document.place(["adjustments", number, "time"]),
            hint="write such as 2024-05-12T14:30:00Z, or with an offset: 2024-05-12T16:30:00+02:00",
        )
    return value


def _decision(document: YamlDocument, number: int, entry: Mapping[str, Any]) -> Adjustment:
    target, effect = entry["target"], entry["effect"]
    decision = FiledAdjustment(
        id=entry["id"],
        author=entry["author"],
        reason=entry["reason"],
        time=entry["time"],
        measured=target["measured"],
        team=target.get("team", ""),
        trial=target["trial"],
        run=target.get("run"),
        finding=target.get("finding", ""),
        verdict=effect.get("verdict", ""),
        points=_amount(effect.get("points")),
        score=_amount(effect.get("score")),
        disqualified=effect.get("disqualified", False),
        complaint=entry.get("complaint", ""),
        dismissed=effect.get("dismissed", False),
        file=document.file,
        place=document.place(["adjustments", number]),
    )
    if decision.dismissed:
        if not decision.complaint:
            raise decision.refuse(
                "no complaint is dismissed", "say with 'complaint:' who protested, and against what"
            )
        return decision
    if decision.finding and not decision.verdict:
        raise decision.refuse(
            f"a finding has a verdict and no {next(iter(effect))}",
            "give 'verdict:', or leave 'finding:' out to decide on the trial",
        )
    if decision.verdict and not decision.finding:
        raise decision.refuse("a verdict needs a finding", "name one with 'finding:' in the target")
    return decision


def _amount(value: float | int | None) -> Decimal | None:
    # `repr`, so that 0.1 in the file is the decimal 0.1 and not the binary number nearest to it.
    return None if value is None else Decimal(repr(value))


# Applying ------------------------------------------------------------------------------


def adjust(result: Result, adjustments: Adjustments, *, measured: str) -> tuple[Result, int]:
    """A result with the decisions that are about it applied on top.

    Args:
        result: An automatic result.
        adjustments: The file, which may hold decisions about other results as well.
        measured: SHA-256 of what was measured (`result_json.measured_sha256`).

    Returns:
        The result, its automatic part untouched, and how many decisions are about others.

    Raises:
        DataFileError: No decision is about this result, or one cannot be applied to it.
    """
    if result.adjusted is not None:
        raise DataFileError(
            "the result is adjusted already",
            file=adjustments.file,
            hint="put all decisions into one file, and apply it to the automatic result",
        )
    # The hash decides: names of trials and findings stay the same when a log is scored again.
    own = [decision for decision in adjustments.decisions if decision.measured == measured]
    if not own:
        first = adjustments.decisions[0]
        raise first.refuse(
            f"it was made for another result: {first.measured[:16]}…, and this one is {measured[:16]}…",
            "the log or the engine has changed since, or this is another run: "
            "look at the new result and decide again",
        )
    rule_set = rule_set_from_text(result.rules, file="the rules in the result")
    check_targets(own, result, rule_set)
    adjusted = apply(result, own, rule_set, sha256=adjustments.sha256)
    return replace(result, adjusted=adjusted), len(adjustments.decisions) - len(own)


def check_targets(own: Sequence[Adjustment], result: Result, rule_set: RuleSet) -> None:
    """Refuse decisions whose target is not in a result, or whose effect makes no sense there.

    Raises:
        DataFileError: Naming the decision.
    """
    for decision in own:
        for what, named, actual in (
            ("trial", decision.trial, result.measured.trial),
            ("team", decision.team, result.measured.team),
        ):
            if named and named != actual:
                raise decision.refuse(
                    f"the result it was made for is of {what} {actual!r}, not {named!r}", f"correct '{what}:'"
                )
        if decision.finding and decision.finding not in result.measured.findings:
            raise decision.refuse(
                f"the result has no finding {decision.finding!r}",
                did_you_mean(decision.finding, result.measured.findings, what="its findings"),
            )
    check_effects(own, result.measured.findings, rule_set.sheet.priced, rule_set.digits)


def apply(result: Result, own: Sequence[Adjustment], rule_set: RuleSet, *, sha256: str) -> Adjusted:
    """The score of a result after decisions, priced by a rule set.

    Args:
        result: An automatic result.
        own: The decisions about it, checked.
        rule_set: That of the result.
        sha256: Of the file they come from.

    Raises:
        DataFileError: One of them needs a score, and there is none.
    """

    return adjusted_ledger(
        result.score,
        result.measured.findings,
        own,
        lambda findings: priced_with(result, findings, rule_set),
        digits=rule_set.digits,
        sha256=sha256,
        lacking=result.missing,
    )


def priced_with(result: Result, findings: Mapping[str, Finding], rule_set: RuleSet) -> Priced:
    """What a result is worth with findings that stewards decided, and the interval that is left.

    Args:
        result: An automatic result.
        findings: Its findings, with the verdicts that were decided.
        rule_set: That of the result.

    Raises:
        FormulaError: The rules have no value for them.
    """
    return price(
        as_counted(result, findings, rule_set),
        result.measured.scopes,
        rule_set.sheet,
        rule_set.policies,
        digits=rule_set.digits,
        cohort=result.cohort,
        measures=result.measured.measures,
        left_open=still_open(result, findings, rule_set),
    )


def counted_as_decided(result: Result, rule_set: RuleSet) -> CountedWorld:
    """The world whose score counts after the verdicts about a result.

    Raises:
        FormulaError: The score has no value.
    """
    findings, left_open = _decided(result, rule_set)
    return counted_world(
        findings,
        result.measured.scopes,
        rule_set.sheet,
        rule_set.policies,
        cohort=result.cohort,
        measures=result.measured.measures,
        left_open=left_open,
    )


def ends_as_decided(name: str, result: Result, rule_set: RuleSet) -> tuple[float, float]:
    """Between what a term of the trial lies after verdicts about a result; infinite where nothing bounds it.

    Raises:
        FormulaError: It has no value.
    """
    findings, left_open = _decided(result, rule_set)
    return ends_of_term(
        name,
        findings,
        result.measured.scopes,
        rule_set.sheet,
        rule_set.policies,
        measures=result.measured.measures,
        left_open=left_open,
    )


def _decided(result: Result, rule_set: RuleSet) -> tuple[Mapping[str, Finding], LeftOpen]:
    """The findings of a result, and what it leaves open, after the verdicts about it."""
    decisions = () if result.adjusted is None else result.adjusted.adjustments
    if not any(decision.verdict for decision in decisions):
        return result.measured.findings, as_scored(result, rule_set)
    findings = with_verdicts(result.measured.findings, decisions)
    return as_counted(result, findings, rule_set), still_open(result, findings, rule_set)


@in_own_decimals
def interval_that_counts(result: Result) -> ScoreInterval | None:
    """Between which ends the score lies that counts, which is the adjusted one where there is one.

    Verdicts leave other ends, and points move both. `None`: nothing is open, or stewards set the score.
    """
    if result.adjusted is None:
        return result.interval
    decisions = result.adjusted.adjustments
    if any(decision.settles for decision in decisions):
        return None
    left = result.interval
    if any(decision.verdict for decision in decisions):
        rule_set = rule_set_from_text(result.rules, file="the rules in the result")
        # It was priced for its score, so it has a value.
        left = priced_with(result, with_verdicts(result.measured.findings, decisions), rule_set).interval
    by = sum((decision.points for decision in decisions if decision.points is not None), Decimal(0))
    return None if left is None else structs.replace(left, least=left.least + by, most=left.most + by)


_DECIDABLE = (Verdict.VIOLATED, Verdict.INCONCLUSIVE)


def adjustments_template(result: Result, *, measured: str) -> str:
    """A first `adjustments.yaml`: the target filled in, the findings that can be decided as comments."""
    team = f"team: {_quoted(result.measured.team)}, " if result.measured.team else ""
    lines = [
        "adjustments:",
        "  - id: decision_1",
        '    author: ""                        # who decides',
        '    reason: ""                        # why, for everyone to read',
        '    # complaint: ""                   # who protested, and against what, where somebody did',
        '    time: ""                          # when it was decided, such as 2024-05-12T14:30:00Z',
        "    target:",
        f"      {{{team}trial: {_quoted(result.measured.trial)},",
        f"       measured: {_quoted(measured)}}}",
        "      # in a ranking also the number of the 'run:'; 'finding:' where one finding is meant",
        "    effect: {points: -1}    # or score: 20, disqualified: true, dismissed: true; verdict: satisfied",
        "",
        "# Findings that could be decided (verdict: satisfied, violated, not_applicable):",
    ]
    for key, finding in result.measured.findings.items():
        if finding.verdict in _DECIDABLE and result.checks[finding.check]["priced"]:
            lines.append(f"#   {key}: {finding.verdict.value}: {_one_line(finding.message)}")
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """Text as a YAML string that nothing in it can break out of."""
    plain = text.encode("utf-8", "backslashreplace").decode("utf-8")
    escaped = "".join(c if c.isprintable() and c not in '"\\' else _escape(c) for c in plain)
    return f'"{escaped}"'


def _escape(character: str) -> str:
    return f"\\{character}" if character in '"\\' else f"\\U{ord(character):08x}"


def _one_line(text: str) -> str:
    # A line break in a message would end the comment and become YAML.
    return "".join(c if c.isprintable() else " " for c in text)[:200]
