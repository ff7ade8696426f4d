"""What an oracle writes when it stops: findings and scores of its logs, and a report of its connections."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType

from ariac_score.checks.registry import Registry
from ariac_score.engine.measure import measure_trial
from ariac_score.engine.prepared import prepare
from ariac_score.engine.read import find_trial, read_needed
from ariac_score.engine.score import score_trial
from ariac_score.errors import NothingToScoreError, ScoreError
from ariac_score.oracle.conversation import Conversation
from ariac_score.results.codec import Format
from ariac_score.results.result import Measured
from ariac_score.results.result_file import as_json, findings_json
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["Connection", "OracleReport", "measured_log", "rehearse", "report_json", "write_results"]

REPORT = "oracle.json"
LEFT = "left for later, so that the oracle could end: score it with 'ariac-score score'"


@dataclass(frozen=True)
class Connection:
    """How one connection went.

    Attributes:
        log: Name of its event log.
        events: Events in the log.
        verdicts: How often each verdict was given.
        bad_frames: Frames that were no JSON object.
        unjudged_events: Events that could not be judged.
        gaps: Events before which something was not seen for longer than its monitor accepts.
        interruptions: How often it was interrupted, and something not seen at all.
        log_parts: Names of the files that were set aside because they were full, the oldest first.
        dropped_parts: How many of those were deleted for new ones.
        first_fault: What was wrong with the first of either; empty when there was none.
        ended: How it ended.
        not_scored: Why its log has no findings; empty when it has.
    """

    log: str
    events: int
    verdicts: Mapping[str, int]
    bad_frames: int
    unjudged_events: int
    gaps: int
    interruptions: int
    log_parts: tuple[str, ...]
    dropped_parts: int
    first_fault: str
    ended: str
    not_scored: str


@dataclass(frozen=True)
class OracleReport:
    """How the connections of an oracle went.

    It has no clock, so that the same conversations give the same bytes.

    Attributes:
        judged_by: The rule set's or specification's name.
        refused_connections: How many were refused, or had to go.
        refusals: The same by reason.
        connections: In the order in which they came.
    """

    judged_by: str
    refused_connections: int
    refusals: Mapping[str, int]
    connections: tuple[Connection, ...]


REPORT_FORMAT = Format("oracle", 1, OracleReport, made_by="'oracle'")
"""How a report is stored."""


def write_results(
    folder: Path,
    conversations: Sequence[Conversation],
    *,
    judged_by: str,
    rule_set: RuleSet | None = None,
    log_map: str = "",
    refusals: Mapping[str, int] = MappingProxyType({}),
    until_s: float = float("inf"),
) -> list[Path]:
    """Write the report and, under a rule set, findings and score of every event log.

    The logs are scored as `score` would, so both give the same. A log without work has no score, but
    its monitors have their findings.

    Args:
        folder: Where the event logs are.
        conversations: Ended.
        judged_by: The rule set's or specification's name.
        rule_set: Under which the logs are scored; `None` for a specification.
        log_map: Log map instead of the rule set's own.
        refusals: Connections that were refused, by reason.
        until_s: But for the first, no log is begun that may take longer, on the clock `time.monotonic`; an
            interrupt (Ctrl-C) ends it at once. Logs that are left can be scored at any time.

    Returns:
        The files, in order of the connections; the report last.
    """
    written: list[Path] = []
    faults: dict[Path, str] = {}
    registry = Registry()
    longest_s = 0.0
    for conversation in conversations if rule_set is not None else ():
        assert rule_set is not None  # without one, the loop is empty
        if why_not := _unfit(conversation):
            faults[conversation.log] = why_not
            continue
        begun_s = time.monotonic()
        if written and begun_s + longest_s >= until_s:
            faults[conversation.log] = LEFT
            continue
        try:
            written += _scored(conversation.log, rule_set, log_map, registry)
            longest_s = max(longest_s, time.monotonic() - begun_s)
        except ScoreError as error:
            faults[conversation.log] = str(error.cause)
        except KeyboardInterrupt:
            faults[conversation.log], until_s = LEFT, 0.0
            written = written or [folder / REPORT]
    report = folder / REPORT
    written = [file for file in written if file != report]
    _write(report, report_json(conversations, judged_by=judged_by, refusals=refusals, faults=faults))
    return [*written, report]


def rehearse(rule_set: RuleSet, log_map: str = "") -> None:
    """Score a log of nothing, so that all code is loaded: the end has no time for it."""
    with TemporaryDirectory(prefix="ariac-score-") as folder:
        log = Path(folder) / "rehearsal.jsonl"
        _write(log, '{"topic": "/rehearsal", "time": 0.0}\n')
        with suppress(ScoreError):  # whatever is wrong is said where it counts
            _scored(log, rule_set, log_map, Registry())


def _unfit(conversation: Conversation) -> str:
    """Why the log of a conversation cannot be scored as it is; empty where it can."""
    if not conversation.events:
        return "the log is empty: no event came"
    parts = len(conversation.kept.parts)
    if conversation.kept.dropped:
        return "its beginning was deleted: the log grew beyond its limits"
    if parts:
        return f"{parts} part(s) of the log were set aside: join them in order, the log last, and score that"
    return ""


def _scored(log: Path, rule_set: RuleSet, log_map: str, registry: Registry) -> list[Path]:
    findings = log.with_suffix(".findings.json")
    try:
        result = score_trial(log, rule_set, log_map=log_map, registry=registry)
    except NothingToScoreError:
        _write(findings, findings_json(measured_log(log, rule_set, log_map, registry)))
        return [findings]
    score = log.with_suffix(".result.json")
    _write(findings, findings_json(result.measured))
    _write(score, as_json(result))
    return [findings, score]


def measured_log(log: Path, rule_set: RuleSet, log_map: str, registry: Registry) -> Measured:
    """The findings in a log that has no work, and so is no trial.

    Raises:
        ScoreError: The log is empty, or a plugin fails.
    """
    prepared = prepare(rule_set, log_map=log_map, registry=registry)
    bundle, readers = find_trial(log, registry)
    trial = read_needed(bundle, readers, prepared, work=False)
    return measure_trial(prepared.derived(trial), prepared)


def report_json(
    conversations: Sequence[Conversation],
    *,
    judged_by: str,
    refusals: Mapping[str, int] = MappingProxyType({}),
    faults: dict[Path, str] | None = None,
) -> str:
    """The report on some conversations, as JSON."""
    not_scored = faults or {}
    connections = tuple(
        Connection(
            conversation.log.name,
            conversation.events,
            dict(conversation.verdicts),
            conversation.bad_frames,
            conversation.unjudged,
            conversation.gaps,
            conversation.interruptions,
            tuple(part.name for part in conversation.kept.parts),
            conversation.kept.dropped,
            conversation.first_fault,
            conversation.ended,
            not_scored.get(conversation.log, ""),
        )
        for conversation in conversations
    )
    return REPORT_FORMAT.text(
        OracleReport(
            judged_by,
            sum(refusals.values()),
            {why: n for why, n in sorted(refusals.items()) if n},
            connections,
        )
    )


def _write(file: Path, text: str) -> None:
    file.write_text(text, encoding="utf-8", newline="\n")
