"""What is left when an oracle stops: findings and scores as of the logs, and how the conversations went."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ariac_score.checks.registry import Registry
from ariac_score.engine.measure import measure_trial
from ariac_score.engine.prepared import prepare
from ariac_score.engine.read import find_trial, read_needed
from ariac_score.engine.score import score_trial
from ariac_score.errors import NothingToScoreError, ScoreError
from ariac_score.oracle.conversation import Conversation
from ariac_score.results.result import Measured
from ariac_score.results.result_file import as_json, findings_json
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["SCHEMA", "report_json", "write_results"]

SCHEMA = "ariac-score/oracle/1"
REPORT = "oracle.json"


def write_results(
    folder: Path,
    conversations: Sequence[Conversation],
    *,
    judged_by: str,
    rule_set: RuleSet | None = None,
    log_map: str = "",
    refused: int = 0,
) -> list[Path]:
    """Write the report and, under a rule set, findings and score of every event log.

    Scoring a log afterwards gives the same: it is what is done here. A log without
    orders has no score, but its monitors have their findings.

    Args:
        folder: Where the event logs are.
        conversations: Ended.
        judged_by: The rule set's or specification's name.
        rule_set: Under which the logs are scored; `None` for a specification.
        log_map: Log map instead of the rule set's own.
        refused: Connections that were refused.

    Returns:
        The files, in order of the connections; the report last.
    """
    written: list[Path] = []
    faults: dict[Path, str] = {}
    registry = Registry()
    for conversation in conversations if rule_set is not None else ():
        assert rule_set is not None  # or there is nothing to go through
        try:
            written += _scored(conversation.log, rule_set, log_map, registry)
        except ScoreError as error:
            faults[conversation.log] = str(error.cause)
    report = folder / REPORT
    _write(report, report_json(conversations, judged_by=judged_by, refused=refused, faults=faults))
    return [*written, report]


def _scored(log: Path, rule_set: RuleSet, log_map: str, registry: Registry) -> list[Path]:
    findings = log.with_suffix(".findings.json")
    try:
        result = score_trial(log, rule_set, log_map=log_map, registry=registry)
    except NothingToScoreError:
        _write(findings, findings_json(_measured(log, rule_set, log_map, registry)))
        return [findings]
    score = log.with_suffix(".result.json")
    _write(findings, findings_json(result.measured))
    _write(score, as_json(result))
    return [findings, score]


def _measured(log: Path, rule_set: RuleSet, log_map: str, registry: Registry) -> Measured:
    """The findings in a log that no order makes a trial of.

    Raises:
        ScoreError: The log holds nothing at all, or a plugin fails.
    """
    prepared = prepare(rule_set, log_map=log_map, registry=registry)
    bundle, readers = find_trial(log, registry)
    trial = read_needed(bundle, readers, prepared, orders=False)
    return measure_trial(prepared.derived(trial), prepared)


def report_json(
    conversations: Sequence[Conversation],
    *,
    judged_by: str,
    refused: int = 0,
    faults: dict[Path, str] | None = None,
) -> str:
    """How the conversations went, as text; it has no clock, so the same ones give the same bytes."""
    data = {
        "schema": SCHEMA,
        "judged_by": judged_by,
        "refused_connections": refused,
        "connections": [_data(conversation, faults or {}) for conversation in conversations],
    }
    return json.dumps(data, sort_keys=True, indent=1) + "\n"


def _data(conversation: Conversation, faults: dict[Path, str]) -> dict[str, Any]:
    return {
        "log": conversation.log.name,
        "events": conversation.events,
        "verdicts": dict(conversation.verdicts),
        "bad_frames": conversation.bad_frames,
        "unjudged_events": conversation.unjudged,
        "first_fault": conversation.first_fault,
        "ended": conversation.ended,
        "not_scored": faults.get(conversation.log, ""),
    }


def _write(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8", newline="\n")
