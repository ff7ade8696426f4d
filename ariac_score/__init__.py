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
        LogDescription,
        Margined,
        Monitor,
        OnlineMonitor,
        OnlineWatch,
        Reader,
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
    from ariac_score.engine.measure import measure_trial
    from ariac_score.engine.price import price_trial, reprice
    from ariac_score.engine.score import score_trial
    from ariac_score.errors import (
        FormulaError,
        LogError,
        MissingSignalError,
        NothingToScoreError,
        ScoreError,
        did_you_mean,
    )
    from ariac_score.results.cohort_file import Cohort, load_cohort
    from ariac_score.results.result import Measured, Provenance, Result
    from ariac_score.results.result_file import as_json, load_result
    from ariac_score.scoring.expression import Expression, add_up
    from ariac_score.scoring.ruleset import RuleSet, load_rule_set
    from ariac_score.trial.arrivals import Alignment, Arrivals
    from ariac_score.trial.build import TrialBuilder
    from ariac_score.trial.channels import LogMap
    from ariac_score.trial.course import Course
    from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
    from ariac_score.trial.kits import Kit
    from ariac_score.trial.logmap import load_log_map
    from ariac_score.trial.model import (
        Body,
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
        Episodes,
        Span,
        Stretch,
        episodes_where,
        gaps_between,
        sample_durations,
        uncovered_spans,
    )
    from ariac_score.trial.sums import Total, exact_sum
    from ariac_score.trial.vocabulary import QUANTITIES, Quantity
    from ariac_score.trial.windows import Aligned, TimeBase

_HOME = {
    "ariac_score.checks.contracts": (
        "Charting Decoder EventMonitor EventWatch LogDescription Margined Monitor OnlineMonitor OnlineWatch "
        "Reader Resolving Rule SignalNeed Standing TopicDescription Wanted"
    ),
    "ariac_score.results.cohort_file": "Cohort load_cohort",
    "ariac_score.engine.score": "measure_trial price_trial reprice score_trial",
    "ariac_score.errors": (
        "FormulaError LogError MissingSignalError NothingToScoreError ScoreError did_you_mean"
    ),
    "ariac_score.scoring.expression": "Expression add_up",
    "ariac_score.checks.findings": "Finding Limit Verdict",
    "ariac_score.trial.logmap": "load_log_map",
    "ariac_score.checks.parameters": "ParameterFacts Status check_parameters parameter parameter_facts",
    "ariac_score.results.result": "Measured Provenance Result",
    "ariac_score.results.result_file": "as_json load_result",
    "ariac_score.scoring.ruleset": "RuleSet load_rule_set",
    "ariac_score.trial.arrivals": "Alignment Arrivals",
    "ariac_score.trial.build": "TrialBuilder",
    "ariac_score.trial.channels": "LogMap",
    "ariac_score.trial.events": "COMPETITION_ENDED COMPETITION_STARTED Event",
    "ariac_score.trial.kits": "Kit",
    "ariac_score.trial.model": (
        "Body LogDefect OfficialOrder OfficialResult Order Pose Product Submission Task TeamSetup Tray "
        "Trial WantedProduct"
    ),
    "ariac_score.trial.signals": "Sample Signal align",
    "ariac_score.results.sketch": "Course",
    "ariac_score.trial.spans": (
        "Episodes Span Stretch episodes_where gaps_between sample_durations uncovered_spans"
    ),
    "ariac_score.trial.sums": "Total exact_sum",
    "ariac_score.trial.vocabulary": "QUANTITIES Quantity",
    "ariac_score.trial.windows": "Aligned TimeBase",
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names.split()}

__all__ = [
    "COMPETITION_ENDED",
    "COMPETITION_STARTED",
    "QUANTITIES",
    "Aligned",
    "Alignment",
    "Arrivals",
    "Body",
    "Charting",
    "Cohort",
    "Course",
    "Decoder",
    "Episodes",
    "Event",
    "EventMonitor",
    "EventWatch",
    "Expression",
    "Finding",
    "FormulaError",
    "Kit",
    "Limit",
    "LogDefect",
    "LogDescription",
    "LogError",
    "LogMap",
    "Margined",
    "Measured",
    "MissingSignalError",
    "Monitor",
    "NothingToScoreError",
    "OfficialOrder",
    "OfficialResult",
    "OnlineMonitor",
    "OnlineWatch",
    "Order",
    "ParameterFacts",
    "Pose",
    "Product",
    "Provenance",
    "Quantity",
    "Reader",
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
    "Stretch",
    "Submission",
    "Task",
    "TeamSetup",
    "TimeBase",
    "TopicDescription",
    "Total",
    "Tray",
    "Trial",
    "TrialBuilder",
    "Verdict",
    "Wanted",
    "WantedProduct",
    "add_up",
    "align",
    "as_json",
    "check_parameters",
    "did_you_mean",
    "episodes_where",
    "exact_sum",
    "gaps_between",
    "load_cohort",
    "load_log_map",
    "load_result",
    "load_rule_set",
    "measure_trial",
    "parameter",
    "parameter_facts",
    "price_trial",
    "reprice",
    "sample_durations",
    "score_trial",
    "uncovered_spans",
]


def __getattr__(name: str) -> object:
    """Load a public name when it is first used."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    """The public names."""
    return sorted(__all__)
