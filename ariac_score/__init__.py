"""ariac-score: task rules and safety monitors over a trial log, and one explained score.

Everything public is importable from here; plugins import nothing else. Names are
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
        Decoder,
        EventMonitor,
        EventWatch,
        Likeness,
        LogDescription,
        Margined,
        Monitor,
        OnlineMonitor,
        OnlineWatch,
        Reader,
        ReaderFacts,
        Resolving,
        Rule,
        SignalNeed,
        Standing,
        TopicDescription,
        Wanted,
    )
    from ariac_score.checks.findings import Finding, Limit, Verdict
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
    from ariac_score.engine.score import score_trial
    from ariac_score.errors import (
        DataFileError,
        FormulaError,
        LogError,
        MissingSignalError,
        NothingToScoreError,
        ScoreError,
        UsageError,
        did_you_mean,
    )
    from ariac_score.logs.messages import RecordedMessage, read_messages
    from ariac_score.ranking.evaluation import Entry, Evaluation, OrderPlan, Stop
    from ariac_score.results.cohort_file import Cohort, load_cohort
    from ariac_score.results.result import Code, Measured, Pinned, Provenance, Result
    from ariac_score.results.result_file import as_json, load_result
    from ariac_score.scoring.expression import Expression, add_up
    from ariac_score.scoring.ruleset import RuleSet, load_rule_set
    from ariac_score.terminal.output import write_output
    from ariac_score.terminal.style import plain
    from ariac_score.trial.arrivals import Alignment, Arrivals
    from ariac_score.trial.build import LARGEST_STEP_BACK_S, TrialBuilder
    from ariac_score.trial.channels import KitMap, LogMap, TrayMatch
    from ariac_score.trial.course import Course
    from ariac_score.trial.events import (
        ARM_COLLISION,
        COMPETITION_ENDED,
        COMPETITION_STARTED,
        ORDER_ANNOUNCED,
        PART_DROPPED,
        Event,
    )
    from ariac_score.trial.kits import ModelTrack
    from ariac_score.trial.logmap import load_log_map
    from ariac_score.trial.model import (
        Body,
        FaultMarks,
        Kit,
        KitRecord,
        LogDefect,
        OfficialOrder,
        OfficialResult,
        Order,
        Pose,
        Product,
        Submission,
        Task,
        TeamSetup,
        Tray,
        Trial,
        WantedProduct,
    )
    from ariac_score.trial.signals import Sample, Signal, align
    from ariac_score.trial.spans import (
        FloatArray,
        Span,
        episodes_where,
        sample_durations,
        uncovered_spans,
    )
    from ariac_score.trial.sums import exact_sum
    from ariac_score.trial.vocabulary import QUANTITIES, Quantity

_HOME = {
    "ariac_score.checks.contracts": (
        "Charting Decoder EventMonitor EventWatch Likeness LogDescription Margined Monitor "
        "OnlineMonitor OnlineWatch Reader ReaderFacts Resolving Rule SignalNeed Standing "
        "TopicDescription Wanted"
    ),
    "ariac_score.checks.findings": "Finding Limit Verdict",
    "ariac_score.checks.parameters": "ParameterFacts Status check_parameters parameter parameter_facts",
    "ariac_score.documents.yaml": "YamlDocument load_yaml",
    "ariac_score.engine.measure": "measure_trial",
    "ariac_score.engine.price": "price_trial reprice",
    "ariac_score.engine.score": "score_trial",
    "ariac_score.errors": (
        "DataFileError FormulaError LogError MissingSignalError NothingToScoreError ScoreError "
        "UsageError did_you_mean"
    ),
    "ariac_score.logs.messages": "RecordedMessage read_messages",
    "ariac_score.ranking.evaluation": "Entry Evaluation OrderPlan Stop",
    "ariac_score.results.cohort_file": "Cohort load_cohort",
    "ariac_score.results.result": "Code Measured Pinned Provenance Result",
    "ariac_score.results.result_file": "as_json load_result",
    "ariac_score.scoring.expression": "Expression add_up",
    "ariac_score.scoring.ruleset": "RuleSet load_rule_set",
    "ariac_score.terminal.output": "write_output",
    "ariac_score.terminal.style": "plain",
    "ariac_score.trial.arrivals": "Alignment Arrivals",
    "ariac_score.trial.build": "LARGEST_STEP_BACK_S TrialBuilder",
    "ariac_score.trial.channels": "KitMap LogMap TrayMatch",
    "ariac_score.trial.course": "Course",
    "ariac_score.trial.events": (
        "ARM_COLLISION COMPETITION_ENDED COMPETITION_STARTED Event ORDER_ANNOUNCED PART_DROPPED"
    ),
    "ariac_score.trial.kits": "ModelTrack",
    "ariac_score.trial.logmap": "load_log_map",
    "ariac_score.trial.model": (
        "Body FaultMarks Kit KitRecord LogDefect OfficialOrder OfficialResult Order Pose Product "
        "Submission Task TeamSetup Tray Trial WantedProduct"
    ),
    "ariac_score.trial.signals": "Sample Signal align",
    "ariac_score.trial.spans": "FloatArray Span episodes_where sample_durations uncovered_spans",
    "ariac_score.trial.sums": "exact_sum",
    "ariac_score.trial.vocabulary": "QUANTITIES Quantity",
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names.split()}

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
    "Charting",
    "Code",
    "Cohort",
    "Course",
    "DataFileError",
    "Decoder",
    "Entry",
    "Evaluation",
    "Event",
    "EventMonitor",
    "EventWatch",
    "Expression",
    "FaultMarks",
    "Finding",
    "FloatArray",
    "FormulaError",
    "Kit",
    "KitMap",
    "KitRecord",
    "Likeness",
    "Limit",
    "LogDefect",
    "LogDescription",
    "LogError",
    "LogMap",
    "Margined",
    "Measured",
    "MissingSignalError",
    "ModelTrack",
    "Monitor",
    "NothingToScoreError",
    "OfficialOrder",
    "OfficialResult",
    "OnlineMonitor",
    "OnlineWatch",
    "Order",
    "OrderPlan",
    "ParameterFacts",
    "Pinned",
    "Pose",
    "Product",
    "Provenance",
    "Quantity",
    "Reader",
    "ReaderFacts",
    "RecordedMessage",
    "Resolving",
    "Result",
    "Rule",
    "RuleSet",
    "Sample",
    "ScoreError",
    "Signal",
    "SignalNeed",
    "Span",
    "Standing",
    "Status",
    "Stop",
    "Submission",
    "Task",
    "TeamSetup",
    "TopicDescription",
    "Tray",
    "TrayMatch",
    "Trial",
    "TrialBuilder",
    "UsageError",
    "Verdict",
    "Wanted",
    "WantedProduct",
    "YamlDocument",
    "add_up",
    "align",
    "as_json",
    "check_parameters",
    "did_you_mean",
    "episodes_where",
    "exact_sum",
    "load_cohort",
    "load_log_map",
    "load_result",
    "load_rule_set",
    "load_yaml",
    "measure_trial",
    "parameter",
    "parameter_facts",
    "plain",
    "price_trial",
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
