"""The trial so far, scored at a cost that does not grow with it.

What monitors have found is kept once it can change no more, and only the last stretch of motion is judged
anew: from before the first episode that is still going on. Orders, submissions and events are few, and all of
them are judged again, so that a formula may take what it likes of them.
"""

from __future__ import annotations

import copy
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ariac_score.checks.contracts import LogDescription, Margined, Reader, Wanted
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.open_findings import Cause, Worlds
from ariac_score.engine.prepared import Prepared, PreparedCheck
from ariac_score.engine.price import price_trial
from ariac_score.engine.score import score_parts
from ariac_score.errors import CutOffError, LogError, NothingToScoreError
from ariac_score.live.recent import Recent
from ariac_score.logs.bundle import Bundle
from ariac_score.logs.containers.items import Connection, Message
from ariac_score.logs.rosbag import RecordingIntake
from ariac_score.results.result import Result
from ariac_score.results.safety import safety_checks
from ariac_score.trial.cut import LARGEST_DISORDER_S, MARGIN_S
from ariac_score.trial.events import COMPETITION_STARTED, Event
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.spans import Span

__all__ = ["MONITORS", "SoFar"]

MONITORS = "ariac_score.monitors"

_SLACK_S = 2.0
"""Between what is settled and an episode that goes on: within it two may still become one."""

_BEFORE_S = 1.0
"""So much more motion is kept than is judged: speeds follow from the samples on both sides."""


class SoFar:
    """The score of a trial while it goes on.

    Args:
        prepared: The rules.
        wanted: What the log map and the checks need.
        bundle: The parts of the trial.
        readers: By name.
        log: Name of the reader of the log.
        file: The recording.
    """

    def __init__(
        self,
        prepared: Prepared,
        wanted: Wanted,
        bundle: Bundle,
        readers: Mapping[str, Reader],
        log: str,
        file: Path,
    ) -> None:
        self._rules, self._wanted, self._bundle, self._file = prepared.rule_set, wanted, bundle, file
        self._readers, self._log = readers, log
        self._incoming: deque[Connection | Message] = deque()
        self._recent = Recent(wanted)
        self._bodies: dict[str, Body] = {}
        moving = {name: each for name, each in prepared.checks.items() if each.needs}
        flat = all(isinstance(each.check, Margined) and _is_monitor(each) for each in moving.values())
        # A check of motion that does not judge each sample needs all there were, and so do the others then.
        self._carried: dict[str, _Lengths] = {name: _Lengths() for name in moving} if flat else {}
        checks = {
            name: replace(each, check=_carrying(each.check, self._carried[name]))
            if name in self._carried
            else each
            for name, each in prepared.checks.items()
        }
        self._prepared = replace(prepared, checks=checks)

    @property
    def is_flat(self) -> bool:
        """Whether its cost stays as it is, however old the trial."""
        return bool(self._carried) or not any(each.needs for each in self._prepared.checks.values())

    def take(self, item: Connection | Message) -> None:
        """Take one item; any thread may."""
        self._incoming.append(item)

    def judge(self) -> Result:
        """Score the trial so far as one that is cut off here; of one thread at a time.

        Raises:
            ScoreError: It cannot be scored yet.
        """
        while self._incoming:
            self._recent.take(self._incoming.popleft())
        for one in self._each():
            one.found, one.until_s = {}, None
        reader = _SoFarReader(
            self._readers[self._log], self._recent.intake(self._wanted, self._file), self._bodies
        )
        readers = {**self._readers, self._log: reader}
        result = score_parts(
            self._file, self._bundle, readers, self._prepared, jobs=1, partial=True, growing=True
        )
        if reader.trial is not None:
            self._settle(reader.trial)
        return _of_known_work(result, self._prepared)

    def settled(self, result: Result) -> Result:
        """The result as if nothing more came: no further violation, and nothing handed in any more."""
        cut = result.measured.cut
        if cut is None:
            return result
        kept = frozenset(safety_checks(self._rules, result.measured))
        findings = {
            key: replace(one, verdict=Verdict.SATISFIED)
            if one.verdict is Verdict.INCONCLUSIVE and one.check in kept
            else one
            for key, one in result.measured.findings.items()
        }
        cut = replace(cut, work_open="", open_end=False)
        measured = replace(result.measured, findings=findings, open=(), cut=cut)
        return price_trial(measured, self._rules, result.provenance)

    def _each(self) -> list[_Carried]:
        return [one for lengths in self._carried.values() for one in lengths.by_start_s.values()]

    def _settle(self, trial: Trial) -> None:
        """Keep what can change no more, and let go of the motion that it came of."""
        for lengths in self._carried.values():
            lengths.drop_unasked()
        ends_s = [one.until_s for one in self._each() if one.until_s is not None]
        if not all(one.by_start_s for one in self._carried.values()) or not ends_s or trial.recorded is None:
            return
        until_s = min(ends_s) - _SLACK_S
        spans = sorted((span for one in self._each() for span in one.spanned()), key=lambda span: -span.end_s)
        for span in spans:
            if span.end_s + _SLACK_S > until_s > span.start_s - _SLACK_S:
                until_s = span.start_s - _SLACK_S
        since_s = max((one.since_s for one in self._each()), default=0.0)
        if until_s <= since_s or until_s <= trial.recorded.start_s:
            return
        for one in self._each():
            one.settle(until_s)
        began_ns, latest_ns = self._recent.began_ns or 0, self._recent.latest_ns
        # Trial time may be that of a simulation, which is as fast as it likes.
        pace_ns = (latest_ns - began_ns) / max(trial.recorded.duration_s, 1e-9)
        back_s = trial.recorded.end_s - until_s + _SLACK_S + _BEFORE_S
        self._recent.forget(latest_ns - round(back_s * pace_ns))


def _is_monitor(each: PreparedCheck) -> bool:
    return each.plugin.group == MONITORS


@dataclass(frozen=True)
class _Found:
    """What was found about a subject: what was seen, and what holds in the best and in the worst world."""

    seen: tuple[Finding, ...] = ()
    best: tuple[Finding, ...] = ()
    worst: tuple[Finding, ...] = ()
    causes: tuple[Cause, ...] = ()

    def __add__(self, other: _Found) -> _Found:
        causes = tuple(dict.fromkeys((*self.causes, *other.causes)))
        return _Found(
            _joined((*self.seen, *other.seen)),
            _joined((*self.best, *other.best)),
            _joined((*self.worst, *other.worst)),
            causes,
        )

    def before(self, until_s: float) -> _Found:
        """What can change no more when everything up to a time is settled."""
        sides = (
            tuple(f for f in side if _is_over(f, until_s)) for side in (self.seen, self.best, self.worst)
        )
        seen, best, worst = sides
        return _Found(seen, best, worst, self.causes if best != worst else ())

    @property
    def statements(self) -> Iterator[Finding | Worlds]:
        yield from self.seen
        if self.best != self.worst:
            subject = (*self.best, *self.worst)[0].subject
            yield Worlds(subject, self.best, self.worst, self.causes)


@dataclass
class _Carried:
    """What one monitor found: what is settled of it, and what it finds now.

    Attributes:
        since_s: From when on it judges, s of trial time; minus infinity: from the start.
        until_s: Up to when it did last; `None`: it did not.
        settled: By subject, what can change no more.
        found: By subject, what it finds from `since_s` on.
    """

    since_s: float = float("-inf")
    until_s: float | None = None
    settled: dict[str, _Found] = field(default_factory=dict)
    found: dict[str, _Found] = field(default_factory=dict)

    def judge(self, statements: Iterable[Finding | Worlds]) -> Iterator[Finding | Worlds]:
        """What it finds now, joined to what is settled."""
        worlds: dict[str, Worlds] = {}
        seen: dict[str, list[Finding]] = {}
        for one in statements:
            if isinstance(one, Worlds):
                worlds[one.subject] = one
            else:
                seen.setdefault(one.subject, []).append(one)
        self.found = {}
        for subject in {**seen, **worlds}:
            own = tuple(seen.get(subject, ()))
            both = worlds.get(subject, Worlds(subject, own, own))
            self.found[subject] = _Found(own, both.best, both.worst, both.causes)
        for subject in {**self.settled, **self.found}:
            joined = self.settled.get(subject, _Found()) + self.found.get(subject, _Found())
            yield from joined.statements

    def spanned(self) -> Iterator[Span]:
        """The stretches of what it finds now, whether seen or possible, other than what was kept."""
        for one in self.found.values():
            for finding in (*one.seen, *one.best, *one.worst):
                if finding.span is not None and finding.verdict is not Verdict.SATISFIED:
                    yield finding.span

    def settle(self, until_s: float) -> None:
        """What was found before a time is settled, and what comes after is judged anew."""
        for subject, now in self.found.items():
            self.settled[subject] = self.settled.get(subject, _Found()) + now.before(until_s)
        self.since_s = until_s


@dataclass
class _Lengths:
    """What one monitor found in each competition that it is asked about, by when that started, s.

    Where the log tells only roughly when the competition started it is judged from the first such moment,
    the last, and the stated one; what the longest shows before the others began is none of theirs.
    """

    by_start_s: dict[float, _Carried] = field(default_factory=dict)

    def of(self, start_s: float) -> _Carried:
        """Where it started then; of a new start, what is settled of the nearest one."""
        if start_s not in self.by_start_s:
            earlier = [known for known in self.by_start_s if known <= start_s]
            near = max(earlier) if earlier else min(self.by_start_s, default=None)
            # The motion that it came of may be let go already.
            before = _Carried() if near is None else self.by_start_s[near]
            self.by_start_s[start_s] = _Carried(before.since_s, settled=dict(before.settled))
        return self.by_start_s[start_s]

    def drop_unasked(self) -> None:
        """Forget starts that are none any more, as when more is known of it."""
        self.by_start_s = {
            start_s: one for start_s, one in self.by_start_s.items() if one.until_s is not None
        }


def _is_over(finding: Finding, until_s: float) -> bool:
    """Whether a finding stands when all before a time is settled; a least margin does in any case."""
    if finding.verdict is Verdict.SATISFIED:
        return True
    return finding.span is not None and finding.span.end_s < until_s


def _joined(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Findings of several stretches about one subject: all that broke a limit, the least that kept it."""
    kept: dict[tuple[str, str], Finding] = {}
    others: list[Finding] = []
    for one in findings:
        if one.verdict is Verdict.SATISFIED:
            key = one.clause, one.unit
            before = kept.get(key)
            if before is None or _margin(one) < _margin(before):
                kept[key] = one
        else:
            others.append(one)
    broken = {one.clause for one in others if one.verdict is Verdict.VIOLATED}
    joined = [*others, *(one for (clause, _), one in kept.items() if clause not in broken)]
    decided = [one for one in joined if one.verdict is not Verdict.NOT_APPLICABLE]
    return tuple(decided or joined[:1])


def _margin(finding: Finding) -> float:
    return float("inf") if finding.robustness is None else finding.robustness


def _carrying(check: Any, lengths: _Lengths) -> Any:
    """The same monitor, which judges from where everything before is settled."""
    own = type(check)
    watch = getattr(own, "watch_worlds", own.watch)

    def watch_from(self: Any, trial: Trial) -> Iterator[Finding | Worlds]:
        window = trial.window
        carried = lengths.of(float("-inf") if window is None else window.start_s)
        carried.until_s = None if window is None else window.end_s
        yield from carried.judge(watch(self, _from(trial, carried.since_s)))

    kind = type(own.__name__, (own,), {"watch": watch_from, "watch_worlds": watch_from})
    kind.__module__, kind.__qualname__ = own.__module__, own.__qualname__
    carrying = copy.copy(check)
    object.__setattr__(carrying, "__class__", kind)
    return carrying


def _from(trial: Trial, since_s: float) -> Trial:
    """A trial as if its competition had started at a time."""
    if trial.window is None or since_s <= trial.window.start_s:
        return trial
    events = [event for event in trial.events if event.kind != COMPETITION_STARTED]
    events.append(Event(since_s, COMPETITION_STARTED))
    return replace(trial, events=tuple(sorted(events)), work=())  # work that is announced would start it


def _of_known_work(result: Result, prepared: Prepared) -> Result:
    """The result priced for the work that is known, where more may be asked for: that is said beside it."""
    cut = result.measured.cut
    if cut is None or not cut.work_open:
        return result
    measured = replace(result.measured, cut=replace(cut, work_open=""))
    return price_trial(measured, prepared.rule_set, result.provenance)


@dataclass
class _SoFarReader:
    """Reads what has come so far, with every body that was ever seen."""

    own: Reader
    kept: RecordingIntake
    bodies: dict[str, Body]
    trial: Trial | None = None

    @property
    def facts(self) -> object:
        """Those of the reader of recordings."""
        return getattr(self.own, "facts", None)

    def can_read(self, path: Path) -> bool:
        """Whether the reader of recordings can."""
        return self.own.can_read(path)

    def describe(self, path: Path) -> LogDescription:
        """What the reader of recordings says."""
        return self.own.describe(path)

    def read(self, path: Path, wanted: Wanted) -> Trial:  # noqa: ARG002  # they were taken in by the same
        """The trial so far, cut off here.

        Raises:
            NothingToScoreError: It is too young to be judged.
            LogError: Its times run back too far to know what is over.
        """
        seen = self.kept.statistics
        if seen.messages and seen.duration_s <= MARGIN_S:
            raise NothingToScoreError("less than a second was seen", file=path, hint="it goes on")
        if (back_s := seen.largest_step_back_s) > LARGEST_DISORDER_S:
            words = f"times of recording run back by {back_s:.1f} s, so it is scored when it ends"
            raise LogError(words, file=path, hint="set no clock during a trial")
        trial = self.kept.trial(CutOffError("the trial goes on", file=path), as_it_came=True)
        self.bodies.update({body.id: body for body in trial.bodies})
        self.trial = replace(trial, bodies=tuple(self.bodies[name] for name in sorted(self.bodies)))
        return self.trial
