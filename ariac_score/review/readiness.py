"""Can a log be scored by a rule set, and if not, what is missing and which topic would bring it?

For teams before they submit: the same reading and the same checks as for the score itself.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ariac_score.checks.findings import Verdict
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.engine.read import Progress, find_trial
from ariac_score.engine.score import score_trial
from ariac_score.results.result import Result
from ariac_score.review.missing_topics import MissingTopics, gives, grouped, missing_topics, work_topics
from ariac_score.scoring.ruleset import RuleSet, installed_rule_sets, rule_set_from_text
from ariac_score.trial.bounds import USUAL_INTERVALS
from ariac_score.trial.derive import source_quantities
from ariac_score.trial.spans import Span
from ariac_score.trial.words import HANDED_IN

__all__ = ["Lack", "Readiness", "check_log", "taking_the_official_text"]


def _no_progress(_done: float) -> None:
    """Show nothing."""


@dataclass(frozen=True)
class Lack:
    """Something that a log does not decide.

    Attributes:
        what: The check, or `score` for what no record of the trial states.
        effect: `withholds` the score; `opens` it, so that it lies between two numbers; `costs` points or
            the whole score by the rules;
            `nothing`, because the score does not depend on it.
        cause: Why it is undecided.
        remedy: What it needs, and which recorded topics are for it; empty where nothing is known to help.
        topics: The topics that it needs and that are not in the log.
    """

    what: str
    effect: str
    cause: str
    remedy: str = ""
    topics: tuple[MissingTopics, ...] = ()


@dataclass(frozen=True)
class Readiness:
    """Whether a log can be scored, before it is handed in.

    Attributes:
        result: Its result as it is.
        lacks: What is undecided; what withholds the score comes first.
        decided: The checks that can be decided.
        notes: What needs no remedy but is worth knowing.
    """

    result: Result
    lacks: tuple[Lack, ...]
    decided: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def ready(self) -> bool:
        """Whether its score is one number; where scores compare teams, for whoever has all logs."""
        return all(lack.effect not in ("withholds", "opens") for lack in self.lacks)

    @property
    def missing(self) -> list[MissingTopics]:
        """The topics to record, each named once; where some would move the score, those alone."""
        moving = [lack for lack in self.lacks if lack.effect != "nothing"]
        return grouped(topics for lack in moving or self.lacks for topics in lack.topics)


def check_log(
    path: Path,
    rule_set: RuleSet,
    *,
    log_map: str = "",
    registry: Registry | None = None,
    progress: Progress = _no_progress,
    partial: bool = False,
) -> Readiness:
    """Check whether the log at a path can be scored.

    Args:
        path: A log, a rosbag2 folder, a bundle folder, or a `bundle.yaml`.
        rule_set: The rules.
        log_map: Log map to use instead of the rule set's own.
        registry: The installed plugins.
        progress: Called with the share done.
        partial: Whether a log that is cut off is scored as far as it goes, unofficially.

    Raises:
        ScoreError: It is damaged, no trial at all, or the rules cannot be used.
    """
    registry = registry or Registry()
    result = score_trial(
        path, rule_set, log_map=log_map, registry=registry, progress=progress, partial=partial
    )
    prepared = prepare(rule_set, log_map=log_map, registry=registry)
    recorded = _recorded(path, registry)
    lacks = list(_lacks(result, prepared, recorded))
    undecided = {lack.what for lack in lacks}
    return Readiness(
        result=result,
        lacks=tuple(sorted(lacks, key=lambda lack: _ORDER.index(lack.effect))),
        decided=tuple(name for name in rule_set.checks if name not in undecided),
        notes=(*_unmapped(prepared, recorded), *_notes(result)),
    )


def _unmapped(prepared: Prepared, recorded: frozenset[str]) -> Iterator[str]:
    """What to do where topics were recorded and the log map names none."""
    if recorded and not prepared.log_map.channels:
        yield (
            f"log map {prepared.log_map.id!r} names no topic: 'ariac-score map LOG -o ours.yaml' drafts one "
            "that does; give it with --log-map ours.yaml"
        )


_ORDER = ("withholds", "opens", "costs", "nothing")
_EFFECTS = {"withhold": "withholds", "worst": "opens", "best": "opens"}
"""By what was made of something undecided."""


def _lacks(result: Result, prepared: Prepared, recorded: frozenset[str]) -> Iterator[Lack]:
    policies = {assumption.check: assumption.policy for assumption in result.assumptions}
    narrowing = () if result.interval is None else result.interval.narrowing
    moving = {check for one in narrowing for check in one.checks}
    causes: dict[str, str] = {}
    spans: dict[str, list[Span]] = {}
    for finding in result.measured.findings.values():
        if finding.verdict is Verdict.INCONCLUSIVE:
            # The first cause stands for all of a check; most often the others repeat it.
            causes.setdefault(finding.check, f"{finding.subject}: {finding.message}")
            if finding.span is not None:
                spans.setdefault(finding.check, []).append(finding.span)
    said = False
    for check, cause in causes.items():
        policy = policies.get(check)
        effect = "nothing" if policy is None else _EFFECTS.get(policy, "costs")
        if effect == "opens" and check not in moving:
            effect = "nothing"  # it is the same score in every world
        said |= effect == "opens"
        words = cause + _and_others(spans.get(check, []))
        topics = tuple(missing_topics(check, prepared, recorded))
        yield Lack(check, effect, words, _remedy(check, prepared, recorded), topics)
    # Monitors that accept each gap may find more in what was not seen all the same.
    unsaid = () if said else narrowing
    for check in dict.fromkeys(check for one in unsaid for check in one.checks if check not in causes):
        cause = next(one.cause for one in narrowing if check in one.checks)
        topics = tuple(missing_topics(check, prepared, recorded))
        yield Lack(check, "opens", cause, _remedy(check, prepared, recorded), topics)
    if result.status == "incomplete" and result.missing:
        yield Lack("score", "withholds", result.missing, "add the trial configuration, or record the orders")


def _and_others(spans: Sequence[Span]) -> str:
    """How often and for how long a check is undecided, where that happens more than once."""
    if len(spans) < 2:
        return ""
    longest = max(spans, key=lambda span: span.duration_s)
    return (
        f"; undecided {len(spans)} times, {sum(span.duration_s for span in spans):.3f} s in all, "
        f"the longest {longest.duration_s:.3f} s from {longest.start_s:.3f} s"
    )


def _recorded(path: Path, registry: Registry) -> frozenset[str]:
    """The topics that are in the logs."""
    bundle, readers = find_trial(path, registry)
    return frozenset(
        topic.name for part in bundle.parts for topic in readers[part.reader].describe(part.path).topics
    )


def _remedy(check: str, prepared: Prepared, recorded: frozenset[str]) -> str:
    """What would have decided a check, in words, as far as its topics are recorded."""
    log_map = prepared.log_map
    needs = [need for need in prepared.checks[check].needs if not need.optional]
    if not needs:
        topics = [topic for topic in work_topics(log_map) if topic in recorded]
        words = prepared.words
        handed = f" and {words.many(HANDED_IN)}" if words.hands_in else ""
        said = f"its {words.many(words.outermost)}{handed} come from {', '.join(topics)}"
        return said if topics else ""
    wanted = source_quantities((need.quantity for need in needs), prepared.brought)
    giving = [channel.topic for channel in log_map.channels if gives(channel, wanted, log_map)]
    signals = ", ".join(sorted({need.quantity for need in needs}))
    consumed = [
        channel.topic
        for channel in log_map.channels
        if channel.as_consumed and gives(replace(channel, as_consumed=False), wanted, log_map)
    ]
    if consumed and not giving:  # to record it once more would help nobody
        only = " and ".join(consumed[:4])
        return f"it needs {signals} over time; {only} gives it as consumed: map it without 'as_consumed'"
    # The strictest need: a topic that meets it meets the others.
    gap_s = min(need.max_gap_s for need in needs)
    there = [topic for topic in dict.fromkeys(giving) if topic in recorded]
    from_there = f"; recorded for it: {', '.join(there)}" if there else ""
    gaps = f"gaps longer than {gap_s:g} s or {USUAL_INTERVALS:g} usual intervals"
    return f"it needs {signals} without {gaps}{from_there}"


def _notes(result: Result) -> Iterator[str]:
    yield from (f"unofficial: {why}" for why in result.measured.unofficial)
    if result.status == "needs_cohort":
        yield f"the score needs all teams: {result.missing}"
    for words in result.measured.unrecorded:
        if ": " in words:  # otherwise a topic is missing, which is said of the checks that need it
            yield words
    for defect in result.measured.log_defects:
        yield f"{defect.where}: {defect.message} ({defect.count})"
    if result.provenance.ignored:
        yield f"not read: {', '.join(result.provenance.ignored[:5])}"


def taking_the_official_text(result: Result, registry: Registry | None = None) -> tuple[str, ...]:
    """The installed rule sets of the same competition that need nothing but what its official text prints.

    Args:
        result: Made by rules that need more.
        registry: What is installed, where the caller has it already.
    """
    registry = registry or Registry()
    own = rule_set_from_text(result.rules, file="the rules in the result").competition
    return tuple(
        other.id
        for other in installed_rule_sets(registry)
        if own is not None and other.competition is not None
        if (other.competition.use, other.competition.parameters) == (own.use, own.parameters)
        if other.about_work and _takes_official_scores(other, registry)
    )


def _takes_official_scores(rules: RuleSet, registry: Registry) -> bool:
    judging = [name for name, check in rules.checks.items() if check.group == "ariac_score.rules"]
    return all(getattr(rules.plugin(name, registry).load(), "reads_official", False) for name in judging)
