"""ariac-score: task rules and safety monitors over a trial log, and one explained score.

Everything public is importable from here; plugins import nothing else, but what helps
authors of monitors (`ariac_score.monitors`) and of tests (`ariac_score.testing`). Names are
loaded when first used, so that importing the package costs next to nothing.

>>> import ariac_score
>>> ariac_score.Span(1.0, 3.5).duration_s
2.5
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ariac_score.checks.contracts import (
        Charting,
        Competition,
        Decoder,
        EventMonitor,
        EventWatch,
        FactSchemas,
        InstantVerdict,
        Likeness,
        LogDescription,
        Margined,
        Monitor,
        OnlineMonitor,
        OnlineWatch,
        Reader,
        ReaderFacts,
        RecordKind,
        ReportPanel,
        Resolving,
        Rule,
        SignalNeed,
        TopicDescription,
        TrackReader,
        Wanted,
    )
    from ariac_score.checks.findings import Finding, Limit, Verdict
    from ariac_score.checks.measures import Measure
    from ariac_score.checks.open_findings import Cause, Worlds
    from ariac_score.checks.parameters import (
        ParameterFacts,
        Status,
        check_parameters,
        parameter,
        parameter_facts,
    )
    from ariac_score.documents.yaml import YamlDocument, load_yaml
    from ariac_score.engine.measure import measure_trial
    from ariac_score.engine.price import price_trial, reprice
    from ariac_score.engine.score import open_trial, score_trial
    from ariac_score.errors import (
        ContradictionError,
        DataFileError,
        FormulaError,
        LogError,
        MissingSignalError,
        NothingToScoreError,
        ScoreError,
        UsageError,
        did_you_mean,
    )
    from ariac_score.logs.logmap import load_log_map
    from ariac_score.logs.message_columns import MessageColumns, RecordedColumns, RefusedMessage, read_columns
    from ariac_score.logs.messages import RecordedMessage, read_messages
    from ariac_score.logs.rosbag import RosbagReader
    from ariac_score.ranking.evaluation import Entry, Evaluation, PlannedItem, Stop
    from ariac_score.results.cohort_file import Cohort, load_cohort
    from ariac_score.results.result import Code, Measured, Pinned, Provenance, Result
    from ariac_score.results.result_file import as_json, load_result
    from ariac_score.scoring.directions import directions
    from ariac_score.scoring.expression import Expression, add_up
    from ariac_score.scoring.ruleset import RuleSet, load_rule_set
    from ariac_score.terminal.output import write_output
    from ariac_score.terminal.style import plain
    from ariac_score.trial.arrivals import Alignment, Arrivals
    from ariac_score.trial.build import LARGEST_STEP_BACK_S, TrialBuilder, first_announced, only
    from ariac_score.trial.channels import LogMap
    from ariac_score.trial.chart import Chart
    from ariac_score.trial.clock import Clock
    from ariac_score.trial.derive import DerivedSignal
    from ariac_score.trial.events import (
        ARM_COLLISION,
        COMPETITION_ENDED,
        COMPETITION_STARTED,
        ORDER_ANNOUNCED,
        PART_DROPPED,
        Event,
        EventNumber,
    )
    from ariac_score.trial.frozen import FrozenMap
    from ariac_score.trial.model import (
        Body,
        LogDefect,
        OfficialOrder,
        OfficialResult,
        Pose,
        TeamSetup,
        Trial,
    )
    from ariac_score.trial.signals import Sample, Series, Signal, align
    from ariac_score.trial.spans import (
        FloatArray,
        Span,
        episodes_where,
        sample_durations,
        uncovered_spans,
    )
    from ariac_score.trial.sums import exact_sum
    from ariac_score.trial.tracks import ModelTrack
    from ariac_score.trial.vocabulary import QUANTITIES, Quantity
    from ariac_score.trial.work import Fact, Item, Record, Submission, WorkItem, announced_s, number_of_fact

_MODULE_OF = {
    "announced_s": "ariac_score.trial.work",
    "Competition": "ariac_score.checks.contracts",
    "RecordKind": "ariac_score.checks.contracts",
    "TrackReader": "ariac_score.checks.contracts",
    "only": "ariac_score.trial.build",
    "first_announced": "ariac_score.trial.build",
    "FrozenMap": "ariac_score.trial.frozen",
    "EventNumber": "ariac_score.trial.events",
    "ModelTrack": "ariac_score.trial.tracks",
    "Record": "ariac_score.trial.work",
    "Submission": "ariac_score.trial.work",
    "number_of_fact": "ariac_score.trial.work",
    "WorkItem": "ariac_score.trial.work",
    "Item": "ariac_score.trial.work",
    "Fact": "ariac_score.trial.work",
    "ARM_COLLISION": "ariac_score.trial.events",
    "Alignment": "ariac_score.trial.arrivals",
    "Arrivals": "ariac_score.trial.arrivals",
    "Body": "ariac_score.trial.model",
    "Clock": "ariac_score.trial.clock",
    "COMPETITION_ENDED": "ariac_score.trial.events",
    "COMPETITION_STARTED": "ariac_score.trial.events",
    "Charting": "ariac_score.checks.contracts",
    "Code": "ariac_score.results.result",
    "Cohort": "ariac_score.results.cohort_file",
    "Chart": "ariac_score.trial.chart",
    "ContradictionError": "ariac_score.errors",
    "DataFileError": "ariac_score.errors",
    "Decoder": "ariac_score.checks.contracts",
    "DerivedSignal": "ariac_score.trial.derive",
    "FactSchemas": "ariac_score.checks.contracts",
    "Entry": "ariac_score.ranking.evaluation",
    "Evaluation": "ariac_score.ranking.evaluation",
    "Event": "ariac_score.trial.events",
    "EventMonitor": "ariac_score.checks.contracts",
    "EventWatch": "ariac_score.checks.contracts",
    "Expression": "ariac_score.scoring.expression",
    "Finding": "ariac_score.checks.findings",
    "FloatArray": "ariac_score.trial.spans",
    "FormulaError": "ariac_score.errors",
    "LARGEST_STEP_BACK_S": "ariac_score.trial.build",
    "Likeness": "ariac_score.checks.contracts",
    "Limit": "ariac_score.checks.findings",
    "LogDefect": "ariac_score.trial.model",
    "LogDescription": "ariac_score.checks.contracts",
    "LogError": "ariac_score.errors",
    "LogMap": "ariac_score.trial.channels",
    "Margined": "ariac_score.checks.contracts",
    "Measure": "ariac_score.checks.measures",
    "Measured": "ariac_score.results.result",
    "MissingSignalError": "ariac_score.errors",
    "Monitor": "ariac_score.checks.contracts",
    "NothingToScoreError": "ariac_score.errors",
    "ORDER_ANNOUNCED": "ariac_score.trial.events",
    "OfficialOrder": "ariac_score.trial.model",
    "OfficialResult": "ariac_score.trial.model",
    "OnlineMonitor": "ariac_score.checks.contracts",
    "OnlineWatch": "ariac_score.checks.contracts",
    "PlannedItem": "ariac_score.ranking.evaluation",
    "PART_DROPPED": "ariac_score.trial.events",
    "ParameterFacts": "ariac_score.checks.parameters",
    "Pinned": "ariac_score.results.result",
    "Pose": "ariac_score.trial.model",
    "Provenance": "ariac_score.results.result",
    "QUANTITIES": "ariac_score.trial.vocabulary",
    "Quantity": "ariac_score.trial.vocabulary",
    "Reader": "ariac_score.checks.contracts",
    "ReportPanel": "ariac_score.checks.contracts",
    "ReaderFacts": "ariac_score.checks.contracts",
    "MessageColumns": "ariac_score.logs.message_columns",
    "RecordedColumns": "ariac_score.logs.message_columns",
    "RecordedMessage": "ariac_score.logs.messages",
    "RefusedMessage": "ariac_score.logs.message_columns",
    "RosbagReader": "ariac_score.logs.rosbag",
    "read_columns": "ariac_score.logs.message_columns",
    "Resolving": "ariac_score.checks.contracts",
    "Result": "ariac_score.results.result",
    "Rule": "ariac_score.checks.contracts",
    "RuleSet": "ariac_score.scoring.ruleset",
    "Sample": "ariac_score.trial.signals",
    "ScoreError": "ariac_score.errors",
    "Series": "ariac_score.trial.signals",
    "Signal": "ariac_score.trial.signals",
    "SignalNeed": "ariac_score.checks.contracts",
    "Span": "ariac_score.trial.spans",
    "InstantVerdict": "ariac_score.checks.contracts",
    "Status": "ariac_score.checks.parameters",
    "Stop": "ariac_score.ranking.evaluation",
    "TeamSetup": "ariac_score.trial.model",
    "TopicDescription": "ariac_score.checks.contracts",
    "Trial": "ariac_score.trial.model",
    "TrialBuilder": "ariac_score.trial.build",
    "UsageError": "ariac_score.errors",
    "Verdict": "ariac_score.checks.findings",
    "Wanted": "ariac_score.checks.contracts",
    "YamlDocument": "ariac_score.documents.yaml",
    "add_up": "ariac_score.scoring.expression",
    "align": "ariac_score.trial.signals",
    "as_json": "ariac_score.results.result_file",
    "check_parameters": "ariac_score.checks.parameters",
    "did_you_mean": "ariac_score.errors",
    "directions": "ariac_score.scoring.directions",
    "Cause": "ariac_score.checks.open_findings",
    "Worlds": "ariac_score.checks.open_findings",
    "episodes_where": "ariac_score.trial.spans",
    "exact_sum": "ariac_score.trial.sums",
    "load_cohort": "ariac_score.results.cohort_file",
    "load_log_map": "ariac_score.logs.logmap",
    "load_result": "ariac_score.results.result_file",
    "load_rule_set": "ariac_score.scoring.ruleset",
    "load_yaml": "ariac_score.documents.yaml",
    "measure_trial": "ariac_score.engine.measure",
    "open_trial": "ariac_score.engine.score",
    "parameter": "ariac_score.checks.parameters",
    "parameter_facts": "ariac_score.checks.parameters",
    "plain": "ariac_score.terminal.style",
    "price_trial": "ariac_score.engine.price",
    "read_messages": "ariac_score.logs.messages",
    "reprice": "ariac_score.engine.price",
    "sample_durations": "ariac_score.trial.spans",
    "score_trial": "ariac_score.engine.score",
    "uncovered_spans": "ariac_score.trial.spans",
    "write_output": "ariac_score.terminal.output",
}

__all__ = [
    "ARM_COLLISION",
    "COMPETITION_ENDED",
    "COMPETITION_STARTED",
    "LARGEST_STEP_BACK_S",
    "ORDER_ANNOUNCED",
    "PART_DROPPED",
    "QUANTITIES",
    "Alignment",
    "Arrivals",
    "Body",
    "Cause",
    "Chart",
    "Charting",
    "Clock",
    "Code",
    "Cohort",
    "Competition",
    "ContradictionError",
    "DataFileError",
    "Decoder",
    "DerivedSignal",
    "Entry",
    "Evaluation",
    "Event",
    "EventMonitor",
    "EventNumber",
    "EventWatch",
    "Expression",
    "Fact",
    "FactSchemas",
    "Finding",
    "FloatArray",
    "FormulaError",
    "FrozenMap",
    "InstantVerdict",
    "Item",
    "Likeness",
    "Limit",
    "LogDefect",
    "LogDescription",
    "LogError",
    "LogMap",
    "Margined",
    "Measure",
    "Measured",
    "MessageColumns",
    "MissingSignalError",
    "ModelTrack",
    "Monitor",
    "NothingToScoreError",
    "OfficialOrder",
    "OfficialResult",
    "OnlineMonitor",
    "OnlineWatch",
    "ParameterFacts",
    "Pinned",
    "PlannedItem",
    "Pose",
    "Provenance",
    "Quantity",
    "Reader",
    "ReaderFacts",
    "Record",
    "RecordKind",
    "RecordedColumns",
    "RecordedMessage",
    "RefusedMessage",
    "ReportPanel",
    "Resolving",
    "Result",
    "RosbagReader",
    "Rule",
    "RuleSet",
    "Sample",
    "ScoreError",
    "Series",
    "Signal",
    "SignalNeed",
    "Span",
    "Status",
    "Stop",
    "Submission",
    "TeamSetup",
    "TopicDescription",
    "TrackReader",
    "Trial",
    "TrialBuilder",
    "UsageError",
    "Verdict",
    "Wanted",
    "WorkItem",
    "Worlds",
    "YamlDocument",
    "add_up",
    "align",
    "announced_s",
    "as_json",
    "check_parameters",
    "did_you_mean",
    "directions",
    "episodes_where",
    "exact_sum",
    "first_announced",
    "load_cohort",
    "load_log_map",
    "load_result",
    "load_rule_set",
    "load_yaml",
    "measure_trial",
    "number_of_fact",
    "only",
    "open_trial",
    "parameter",
    "parameter_facts",
    "plain",
    "price_trial",
    "read_columns",
    "read_messages",
    "reprice",
    "sample_durations",
    "score_trial",
    "uncovered_spans",
    "write_output",
]


def __getattr__(name: str) -> object:
    """Load a public name when it is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
