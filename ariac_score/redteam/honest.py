"""The honest log, its score, and what an adversary knows of both."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import Prepared, Rules, prepare
from ariac_score.engine.price import reprice
from ariac_score.engine.score import score_trial
from ariac_score.errors import NothingToScoreError, UsageError
from ariac_score.logs.containers.detect import looks_like_recording
from ariac_score.logs.containers.items import Message
from ariac_score.redteam.motion import Follows, Motion
from ariac_score.results.cohort_file import Cohort, load_cohort
from ariac_score.results.result import Result
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.testing.copies import Copy, fields_of
from ariac_score.trial.clock import Clock
from ariac_score.trial.spans import Span

__all__ = ["Harm", "Honest", "harm_of", "honest_log", "is_covered"]

Harm = Mapping[tuple[str, str, str], float]
"""How much was violated, by check, subject and quantity."""

_HARMS = ("time_in_violation_s", "relative_depth_integral_s", "relative_depth_max")
_MANY = 100
"""Messages of a topic about what moves, where nobody says what a topic is about; of the others are fewer."""

_SAME = 1e-9
"""Relative: smaller differences are of rounding."""

_WITHIN_S = 5.0
"""Messages lie where the trial does, give or take this, or their times of recording are of another clock."""


@dataclass(frozen=True)
class Honest:
    """An honest log.

    Attributes:
        path: The log, or a folder with it and what lies beside it.
        recording: The recording in it, which is doctored.
        copy: Its messages.
        prepared: The rules.
        result: What it scores.
        also: Configurations that the organiser gives.
        cohort: Values of all teams, for rules that compare them; a doctored log changes none of the others'.
    """

    path: Path
    recording: Path
    copy: Copy
    prepared: Prepared
    result: Result
    also: tuple[Path, ...] = ()
    cohort: Cohort | None = None

    @property
    def rule_set(self) -> RuleSet:
        """The rules."""
        return self.prepared.rule_set

    @property
    def counts(self) -> Decimal:
        """The score that counts."""
        assert self.result.score is not None  # refused by `honest_log`
        return self.result.score

    def score(self, copy: Copy) -> Result:
        """What a doctored copy scores in the place of the log, all else being as it is.

        Raises:
            ScoreError: It is refused.
        """
        with TemporaryDirectory() as folder:
            # Under its own name: trial and files are called after it.
            place = Path(folder, self.path.name)
            if self.recording == self.path:
                path = copy.write(place.with_name(self.recording.stem))
            else:
                shutil.copytree(self.path, place, ignore=lambda *_: [self.recording.name])
                copy.write(place / self.recording.relative_to(self.path).with_suffix(""))
                path = place
            registry = self.prepared.registry
            root = Path(folder) if self.also else None
            found = score_trial(path, self.prepared, also=self.also, root=root, jobs=1, registry=registry)
            return _with_cohort(found, self.prepared, self.cohort)

    # What is known of the log -----------------------------------------------------------

    @cached_property
    def motion(self) -> tuple[str, ...]:
        """Topics that show how things move and that the rules read; of no log map, all frequent ones."""
        if not self.prepared.log_map.channels:
            return self._of_many(True)
        channels = self.prepared.log_map.channels_for(self.prepared.sources)
        named = {channel.topic for channel in channels if channel.signals or channel.poses}
        return tuple(topic for topic in self.copy.topics if topic in named)

    @cached_property
    def telling(self) -> tuple[str, ...]:
        """Topics that say what happened, or what was to be done; the others, where no log map says."""
        if not self.prepared.log_map.channels:
            return self._of_many(False)
        named = {channel.topic for channel in self.prepared.log_map.channels if channel.whole}
        return tuple(topic for topic in self.copy.topics if topic in named - set(self.motion))

    def _of_many(self, many: bool) -> tuple[str, ...]:
        """The topics that have many messages, or those that have few: a competition may read them itself."""
        counts = Counter(message.connection.topic for message in self.copy.messages)
        return tuple(topic for topic in self.copy.topics if (counts[topic] >= _MANY) is many)

    @cached_property
    def has_rates(self) -> bool:
        """Whether thinned samples show: the log map states each rate, or the rules bound every interval."""
        return not self.result.measured.unrated or self.rule_set.between_samples == "bounded"

    @cached_property
    def has_positions(self) -> bool:
        """Whether a body that says that it is slower than it is shows it by where it is."""
        channels = [c for c in self.prepared.log_map.channels if c.topic in self.motion]
        named = {one.signal for channel in channels for one in channel.signals}
        bodies = {signal.partition("/")[2] for signal in named if signal.startswith(("speed/", "velocity/"))}
        return all(f"position/{body}" in named for body in bodies)

    @cached_property
    def moving(self) -> Motion:
        """The messages about motion, by series."""
        return Motion(self.copy, self.motion, self.t_s, self.follows)

    @cached_property
    def follows(self) -> Mapping[str, Sequence[Follows]]:
        """By topic, which fields are the velocities of which positions."""
        found: dict[str, list[Follows]] = {}
        for channel in self.prepared.log_map.channels:
            paths = {one.signal: one.fields for one in channel.signals}
            for signal, fields in paths.items():
                velocity = paths.get(signal.replace("position/", "velocity/", 1), ())
                if signal.startswith("position/") and len(velocity) == len(fields):
                    found.setdefault(channel.topic, []).append((fields, velocity))
        return found

    @cached_property
    def window(self) -> Span:
        """From start to end of what counts, s."""
        found = self.result.measured.window or self.result.measured.watched
        return found or Span(0.0, 0.0)

    @cached_property
    def violations(self) -> tuple[tuple[Span, float], ...]:
        """Each stretch of a violation, with the time at which it is worst, s; in order of time."""
        violated = _violated(self.result, self.rule_set.monitors)
        found = {(f.span, _worst_s(f)) for f in violated if f.span is not None}
        return tuple(sorted(found, key=lambda one: (one[0].start_s, one[0].end_s, one[1])))

    def is_clear(self, t_s: float, margin_s: float = 0.0) -> bool:
        """Whether nothing is violated at a time, nor so near to it."""
        return not any(s.start_s - margin_s <= t_s <= s.end_s + margin_s for s, _ in self.violations)

    def t_s(self, message: Message) -> float:
        """When a message is of, s of trial time."""
        known = self._times.get(id(message))
        return self._time_of(message) if known is None else known

    @cached_property
    def _times(self) -> dict[int, float]:
        """By `id`, of the messages of the honest log alone: these live as long as this."""
        return {id(message): self._time_of(message) for message in self.copy.messages}

    def _time_of(self, message: Message) -> float:
        return (self._own_ns(message) - self._origin_ns) / 1e9

    @cached_property
    def _origin_ns(self) -> int:
        return Clock.parse(self.result.measured.clock).origin_ns or 0

    @cached_property
    def _is_stamped(self) -> bool:
        """Whether trial time is of the messages' own stamps, and the recorder's clock is another one."""
        watched = self.result.measured.watched
        first_s = (self.copy.messages[0].stamp_ns - self._origin_ns) / 1e9
        return watched is not None and abs(first_s - watched.start_s) > _WITHIN_S

    def _own_ns(self, message: Message) -> int:
        if self._is_stamped:
            fields = fields_of(message)
            first = next(iter(getattr(fields, "transforms", ())), fields)
            stamp = getattr(getattr(first, "header", None), "stamp", None)
            if stamp is not None and (stamp.sec or stamp.nanosec):
                return int(stamp.sec * 10**9 + stamp.nanosec)
        return message.stamp_ns


def honest_log(
    path: Path,
    rules: Rules,
    *,
    log_map: str = "",
    also: Sequence[Path] = (),
    cohort: Path | None = None,
    registry: Registry | None = None,
) -> Honest:
    """The log at a path, read and scored.

    Args:
        path: A recording, or a folder with one and its configuration.
        rules: By which it is scored.
        log_map: Log map to use instead of the rule set's own.
        also: Configurations that the organiser gives.
        cohort: Values of all teams (`rank --cohort-output`), for rules that compare them.
        registry: The installed plugins.

    Raises:
        NothingToScoreError: It is no recording, nor a folder with one.
        UsageError: It has no score that another one could exceed.
        ScoreError: It cannot be scored.
    """
    recording = _recording(path)
    copy = Copy.of(recording)
    prepared = prepare(rules, log_map=log_map, registry=registry)
    root = path.parent if also else None
    values = None if cohort is None else load_cohort(cohort, prepared.rule_set)
    alone = score_trial(path, prepared, also=also, root=root, jobs=1, registry=prepared.registry)
    result = _with_cohort(alone, prepared, values)
    if result.score is None:
        raise UsageError(
            f"it has no score under {prepared.rule_set.id}, so nothing can be more",
            file=path,
            hint="'ariac-score score' says why; take a log and rules with a score",
        )
    return Honest(path, recording, copy, prepared, result, tuple(also), values)


def _with_cohort(result: Result, prepared: Prepared, cohort: Cohort | None) -> Result:
    if cohort is None:
        return result
    return reprice(result, prepared.rule_set, cohort.of_trial(result.measured.trial, result.measured))


def _recording(path: Path) -> Path:
    if not path.is_dir() or looks_like_recording(path):
        return path
    found = sorted(entry for entry in path.rglob("*") if entry.is_file() and looks_like_recording(entry))
    if len(found) != 1:
        raise NothingToScoreError(
            f"there are {len(found)} recordings in it, and one is doctored",
            file=path,
            hint="give a recording, or a folder with one and its configuration",
        )
    return found[0]


def harm_of(result: Result, monitors: Collection[str]) -> Harm:
    """How much was violated: for how long, how deep; of what has neither, how often.

    Args:
        result: Of a log.
        monitors: The checks whose violations are harm.
    """
    harm: dict[tuple[str, str, str], float] = {}
    for finding in _violated(result, monitors):
        subject = (finding.check, finding.subject)
        measured = [name for name in _HARMS if name in finding.quantities]
        for name in measured:
            key, value = (*subject, name), finding.quantities[name]
            harm[key] = (
                max(harm.get(key, 0.0), value) if name.endswith("_max") else harm.get(key, 0.0) + value
            )
        if not measured:
            harm[(*subject, "times")] = harm.get((*subject, "times"), 0.0) + 1
    return harm


def is_covered(result: Result, by: Result, monitors: Collection[str]) -> bool:
    """Whether each violation of a result is there in another one: for as long, and at its worst as deep.

    What is more in all may be less in one place: a higher peak that becomes a long plateau is not worse.
    """
    others = _violated(by, monitors)
    for one in _violated(result, monitors):
        same = [o for o in others if (o.check, o.subject) == (one.check, one.subject) and _meet(o, one)]
        for name in _HARMS:
            if name in one.quantities:
                pick = max if name.endswith("_max") else sum
                much = pick([o.quantities.get(name, 0.0) for o in same] or [0.0])
                if much < one.quantities[name] * (1 - _SAME):
                    return False
    return True


def _meet(one: Finding, other: Finding) -> bool:
    if one.span is None or other.span is None:
        return True
    return one.span.start_s <= other.span.end_s and other.span.start_s <= one.span.end_s


def _violated(result: Result, monitors: Collection[str]) -> list[Finding]:
    findings = result.measured.findings.values()
    return [one for one in findings if one.verdict is Verdict.VIOLATED and one.check in monitors]


def _worst_s(finding: Finding) -> float:
    """When a violation is worst, as its evidence says; else its middle, s."""
    assert finding.span is not None
    if finding.evidence:
        return finding.evidence[0].t_s
    return (finding.span.start_s + finding.span.end_s) / 2
