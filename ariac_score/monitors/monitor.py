"""What the author of a monitor states, and what follows from it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, TypeVar

import numpy as np

from ariac_score.checks.contracts import InstantVerdict, OnlineWatch, SignalNeed
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.in_gaps import InGaps
from ariac_score.checks.measures import Measure
from ariac_score.checks.open_findings import Worlds
from ariac_score.checks.parameters import check_parameters
from ariac_score.checks.when_cut import WhenCut
from ariac_score.errors import MissingSignalError
from ariac_score.monitors.blunt import nothing_broken, whole_window
from ariac_score.monitors.encounter import Encounter
from ariac_score.monitors.flags import found_or_due, lacking_signal
from ariac_score.monitors.limits import (
    Bound,
    Details,
    Episode,
    FindingRules,
    JudgedLimit,
    Statement,
    limit_findings,
    severity_measures,
)
from ariac_score.monitors.online import SubjectsOnline
from ariac_score.monitors.subjects import Subject, Subjects, nobody
from ariac_score.monitors.watched import (
    Signals,
    UndecidedError,
    Watched,
    seen,
    watch_subjects,
    watched_signals,
)
from ariac_score.monitors.worlds import Opened, alike, open_worlds, undecided_worlds
from ariac_score.monitors.worsening import Worse, Worsening
from ariac_score.trial.chart import Chart
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.vocabulary import DISTANCES, SPEEDS, quantity_of
from ariac_score.trial.window import lasted_of, lasting, surely_of

__all__ = ["LimitMonitor", "MarginMonitor", "Reach", "SubjectMonitor"]

Value = TypeVar("Value")
Adds: TypeAlias = Callable[[JudgedLimit, Episode | None], Mapping[str, Value]]
"""What to add to a finding about an episode, or (`None`) about a subject without any."""


@dataclass(frozen=True)
class Reach:
    """Which samples the verdict on one sample rests on: what a live form must keep, and wait for.

    Attributes:
        back: `sample`: none before it; `neighbour`: the one before; `run`: all since a condition
            began to hold, of which a live form carries the beginning only; `start`: all since
            the trial began.
        ahead: How many samples after it.
        ahead_s: The samples of how much time after it, s; infinite: all.
    """

    back: Literal["sample", "neighbour", "run", "start"] = "sample"
    ahead: int = 0
    ahead_s: float = 0.0


class SubjectMonitor:
    """A monitor that judges each of its subjects on its signals.

    A subclass is a frozen dataclass whose fields are its parameters. It states whom it is about, which
    signals are wanted, and `about`; what is missing, and every gap, becomes a finding by itself.
    What is stated as a property here may be a class attribute there.

    Parameters of these names count where the class has them: `max_gap_s`, the longest stretch without a
    sample that is accepted (0.05 s), `max_flag_age_s`, how long a flag holds (1 s); else the value in
    brackets does.
    """

    max_gap_s: float = 0.05
    max_flag_age_s: float = 1.0

    def __post_init__(self) -> None:
        check_parameters(self)

    # What a monitor states ------------------------------------------------------------------------

    @property
    def subjects(self) -> Subjects:
        """Whom it is about; by default the trial as a whole."""
        return Subjects()

    @property
    def wanted(self) -> Mapping[str, str]:
        """The signals it cannot do without: unit by template, such as `speed/{robot}`."""
        return {}

    @property
    def optional(self) -> Mapping[str, str]:
        """The signals that help where the log has them: unit by template."""
        return {}

    @property
    def flags(self) -> Sequence[str]:
        """The flags it reads, such as `manual_mode`."""
        return ()

    @property
    def worse(self) -> Mapping[str, Worse]:
        """Which end of each wanted signal is the worse one, `low` or `high`, whatever the others are.

        Where it says so of all, the time without samples is judged as it can have been at worst and at
        best; where it does not, a limit counts as broken there at worst, and as kept at best.
        """
        return {}

    @property
    def in_gaps(self) -> InGaps:
        """What it leaves open where samples lack, as `worse` has it."""
        if not self.wanted or not self.worse.keys() >= self.wanted.keys():
            return "blunt"
        (name, *others) = self.wanted
        alone = quantity_of(name) in (*DISTANCES, *SPEEDS) and not (others or self.optional or self.flags)
        return "tight" if alone else "outer"

    @property
    def only_after(self) -> Sequence[str]:
        """Kinds of events without which nothing can be violated, whatever lacks; empty: there are none."""
        return ()

    @property
    def may_hide(self) -> Sequence[Mapping[str, float | tuple[float, ...]]]:
        """What signals may have been in a gap, by template, so that what follows is judged otherwise.

        Such as a rest after which nothing may move. Each is tried, where nothing bounds what was in a gap.
        """
        return ()

    @property
    def by_course(self) -> bool:
        """Whether its findings are of what takes its course, such as a contact, which was bad as a whole.

        Those of other limits are of the stretches in which they were broken.
        """
        return False

    @property
    def when_cut(self) -> WhenCut:
        """What its findings are worth where the log is cut off, as `open` where it does not say so."""
        return "open"

    @property
    def clause(self) -> str:
        """Where the standard or rulebook asks for it."""
        return ""

    @property
    def may_be_critical(self) -> bool:
        """Whether a violation may be a critical event, and so one that a gap hides; else as `critical`."""
        return bool(getattr(self, "critical", False))

    @property
    def lacks(self) -> str:
        """What its parameters leave out, so that nothing can be judged; empty: nothing."""
        return ""

    def about(self, signals: Watched) -> Iterator[Statement]:
        """Everything about one subject.

        Raises:
            UndecidedError: The log leaves open what is needed.
        """
        raise NotImplementedError

    def courses(self, signals: Watched) -> Sequence[Span]:
        """What it judges each by itself, such as a stop until the next start: each may be violated.

        Args:
            signals: As samples stand; none, where the log lacks one.
        """
        del signals
        return ()

    def limits(self, signals: Watched) -> int:
        """How many limits it judges, each of which may be broken at the same time as the others."""
        del signals
        return 1

    def at_worst(self, signals: Watched, hidden: Sequence[Span]) -> Sequence[Finding] | None:
        """What may have been at worst, given where nothing shows it: violations, or that there were none.

        `None`, unless a monitor says otherwise: its limit may have been broken in all of what is hidden, at
        full depth.

        Args:
            signals: As samples stand, without gaps; none, where the log lacks one.
            hidden: Where nothing shows what was, in time order.
        """
        del signals, hidden
        return None

    # What follows ---------------------------------------------------------------------------------

    @property
    def rules(self) -> FindingRules:
        """How samples become findings."""
        return FindingRules(self.clause)

    @property
    def _helpful(self) -> Mapping[str, str]:
        """The signals that help and are not wanted anyway."""
        return {name: unit for name, unit in self.optional.items() if name not in self.wanted}

    def needs(self) -> Iterator[SignalNeed]:
        """The signals it reads: those it cannot do without, its flags, and those that help."""
        wanted, helpful = self._signals_of(self.wanted), self._signals_of(self._helpful)
        for (quantity, pair), unit in wanted.items():
            yield SignalNeed(quantity, unit, self.max_gap_s, pair=pair)
        for flag in self.flags:
            yield SignalNeed(flag, "1", self.max_flag_age_s)
        for (quantity, pair), unit in helpful.items():
            if (quantity, pair) not in wanted:
                yield SignalNeed(quantity, unit, self.max_gap_s, optional=True, pair=pair)

    def _signals_of(self, templates: Mapping[str, str]) -> Mapping[tuple[str, str], str]:
        """The unit of each quantity, and of whom it is where it is of a pair."""
        whose = self.subjects.pair
        return {(quantity_of(template), whose(template)): unit for template, unit in templates.items()}

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """Findings about every subject, and what is not known."""
        return (one for one in self.statements(trial) if isinstance(one, Finding))

    def watch_worlds(self, trial: Trial) -> Iterator[Finding | Worlds]:
        """The same, and for what the log leaves open the findings of the best and of the worst world."""
        return (one for one in self.statements(trial) if isinstance(one, Finding | Worlds))

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """All findings about a trial, the limits they rest on, and what is open."""
        if self.lacks:
            yield Finding.inconclusive("trial", self.lacks, span=trial.window, clause=self.rules.clause)
            return
        yield from self.judged(trial, self.subjects.of(trial.bodies), self.wanted)

    def judged(
        self, trial: Trial, subjects: Sequence[Subject], wanted: Mapping[str, str]
    ) -> Iterator[Statement]:
        """Everything about some subjects on the signals that are wanted of them; or that there are none."""
        if not subjects:
            yield nobody(trial, self.subjects.kinds, self.rules.clause)
        yield from watch_subjects(
            trial,
            subjects,
            wanted,
            max_gap_s=self.max_gap_s,
            clause=self.rules.clause,
            judge=self.about,
            optional=self._helpful,
            turning=[*self.optional, *self.flags],
            unseen=_Unseen(self) if trial.between is not None else None,
        )


@dataclass(frozen=True)
class _Unseen:
    """What a monitor states of the time without samples."""

    monitor: SubjectMonitor

    @property
    def _says(self) -> Worsening:
        monitor = self.monitor
        reach = getattr(monitor, "reach", Reach())
        return Worsening(
            monitor.worse,
            getattr(monitor, "measures", {}),
            getattr(monitor, "t_off_s", 0.0),
            monitor.rules.clause,
            monitor.rules.t_on_s,
            monitor.flags,
            monitor.may_be_critical,
            max(reach.ahead, int(reach.back == "neighbour")),
            monitor.may_hide,
            monitor.courses,
            by_course=monitor.by_course,
            graded=monitor.rules.graded,
            limits=monitor.limits,
            at_worst=monitor.at_worst,
        )

    def nothing(self, trial: Trial, subject: Subject, why: str) -> Iterator[Statement]:
        """All of the competition is open."""
        monitor, window, hollow = self.monitor, trial.window, self._hollow(trial, subject)
        if window is None:
            return
        found = whole_window(
            trial,
            subject.name,
            self._says,
            why,
            courses=() if hollow is None else monitor.courses(hollow),
            limits=1 if hollow is None else monitor.limits(hollow),
            at_worst=None if hollow is None else monitor.at_worst(hollow, [window]),
        )
        if found is not None:
            yield found

    def _hollow(self, trial: Trial, subject: Subject) -> Watched | None:
        """Its signals where one of them lacks: no samples, but what they are, and what else there is."""
        monitor = self.monitor
        names = {template: subject.fill(template) for template in monitor.wanted}
        units = dict(zip(names.values(), monitor.wanted.values(), strict=True))
        signals = [trial.signals.get(name) or lacking_signal(name, unit) for name, unit in units.items()]
        helpful = ((one, found_or_due(trial, subject.fill(one))) for one in monitor.optional)
        optional = {one: signal for one, signal in helpful if signal is not None}
        if not signals:
            return None
        return watched_signals(signals, monitor.max_gap_s, trial, subject, names=names, optional=optional)

    def about(
        self, watched: Watched, judge: Callable[[Watched], Iterable[Statement]], why: str
    ) -> Iterator[Statement]:
        """What was seen, and both worlds where they differ."""
        clause = self.monitor.rules.clause
        if self.monitor.flags:
            watched = watched.where_known(self.monitor.flags, self.monitor.max_flag_age_s)
        idle = self._is_idle(watched)
        if idle and len(watched):
            watched = replace(watched, gaps=[])
        opened = None if idle else open_worlds(watched, judge, self._says)
        if opened is not None and watched.gaps and not opened.said:
            stated = _decided(watched, judge, opened)
        else:
            stated = list(seen(watched, judge, clause, None if opened is None else opened.said))
            if opened is not None and opened.agree and not alike(_findings(stated), opened.worlds.worst):
                # What stood through a gap that is short enough for the monitor, and turned in it.
                stated = list(opened.statements)
        yield from stated
        undecided = any(one.verdict is Verdict.INCONCLUSIVE for one in _findings(stated))
        if opened is None and undecided and len(watched) and not why:
            yield self._undecided(watched, stated)
        if opened is not None and not opened.agree:
            worlds: Worlds | None = opened.worlds
        elif why:
            found = tuple(_findings(stated))
            worlds = Worlds(watched.subject.name, found, found)
        else:
            return
        if why:
            certain = self._certain(watched, judge, worlds)
            name = watched.subject.name
            worlds = whole_window(watched.trial, name, self._says, why, seen=worlds, certain=certain)
        if worlds is not None:
            yield worlds

    def _undecided(self, watched: Watched, stated: Sequence[Statement]) -> Worlds:
        """Both worlds of what is undecided though nothing lacks that is wanted, such as a stop at the end."""
        worlds = undecided_worlds(watched, stated, self._says)
        worst = self.monitor.at_worst(watched, watched.gaps)
        if worst:
            best = [one for one in _findings(stated) if one.verdict is not Verdict.INCONCLUSIVE]
            best = best or [nothing_broken(watched.subject.name, self._says)]
            worlds = replace(worlds, best=tuple(best), worst=tuple(worst))
        return worlds

    def _is_idle(self, watched: Watched) -> bool:
        """Whether the log shows that there was nothing that a violation would have to come after."""
        kinds, trial = self.monitor.only_after, watched.trial
        events = (event for kind in kinds for event in trial.events_of(kind))
        concern = any(event.subject in ("", watched.subject.name) for event in events)
        return bool(kinds) and trial.witnessed >= {*kinds} and not concern

    def _certain(
        self, watched: Watched, judge: Callable[[Watched], Iterable[Statement]], worlds: Worlds | None
    ) -> tuple[Finding, ...]:
        """What is found in every competition that may have been: the best world of the shortest one."""
        if lasted_of(watched.trial) is None:  # made by hand, and all of it the competition
            return () if worlds is None else worlds.best
        sure = surely_of(watched.trial)
        if sure is None:
            return ()
        shortest = watched.within(lasting(watched.trial, sure))
        opened = open_worlds(shortest, judge, self._says)
        if opened is not None:
            return opened.worlds.best
        return tuple(_findings(seen(shortest, judge, self.monitor.rules.clause)))


def _findings(stated: Iterable[Statement]) -> list[Finding]:
    return [one for one in stated if isinstance(one, Finding)]


def _decided(
    watched: Watched, judge: Callable[[Watched], Iterable[Statement]], opened: Opened
) -> list[Statement]:
    """What the samples show, where no gap leaves a verdict open: what is kept at worst is kept."""
    try:
        shown = list(judge(replace(watched, gaps=[])))
    except (UndecidedError, MissingSignalError):
        return list(opened.statements)
    if not opened.agree:
        return shown
    found, bounded = _findings(shown), _findings(opened.statements)
    if len(found) == len(bounded):
        bounded = list(map(_with_both_margins, found, bounded))
    return [*(one for one in shown if not isinstance(one, Finding)), *bounded]


def _with_both_margins(shown: Finding, bounded: Finding) -> Finding:
    """What is known of a limit that was kept: the margin that counts; in words that of the samples, too."""
    kept = bounded.verdict is Verdict.SATISFIED and shown.verdict is Verdict.SATISFIED
    if not kept or bounded.message == shown.message:
        return bounded
    message = f"{shown.message}; between samples at worst: {bounded.message}"
    return replace(bounded, message=message)  # no evidence: no sample shows the margin that counts


class LimitMonitor(SubjectMonitor):
    """A monitor that holds a measured value against a limit at every sample.

    Besides what every `SubjectMonitor` states it states `margin`; findings, episodes, severities, margins
    over time and declared measures follow. Two more parameters count where the class has them: `t_on_s`,
    the shortest violation that counts, and `t_off_s`, below which a pause is bridged. Without them every
    violation counts and no pause is bridged: what no page and no result states does not happen.
    """

    t_on_s: float | None = 0.0
    t_off_s: float = 0.0

    # What a monitor states ------------------------------------------------------------------------

    @property
    def what(self) -> str:
        """Name of what is measured, such as `speed`."""
        return "margin"

    @property
    def unit(self) -> str:
        """Unit of what is measured, and so of the margin."""
        return "1"

    @property
    def idle(self) -> str:
        """The message about a subject to whom the limit never applied."""
        return "the limit never applied"

    @property
    def critical(self) -> bool:
        """Whether a violation is a critical event."""
        return False

    @property
    def graded(self) -> bool:
        """Whether the depth relative to the limit says how bad a violation is."""
        return True

    @property
    def encounter(self) -> Encounter | None:
        """Given where it is about a machine and a person: who closed in and was exposed is then told."""
        return None

    @property
    def severities(self) -> Mapping[str, Measure]:
        """The quantities that `severity` adds, by name."""
        return {}

    @property
    def reach(self) -> Reach:
        """Which samples the verdict on one rests on."""
        return Reach()

    @property
    def when_cut(self) -> WhenCut:
        """What was seen stays, unless the verdict on a sample rests on later ones."""
        return "open" if self.reach.ahead or self.reach.ahead_s else "adds"

    def margin(self, signals: Watched) -> FloatArray | Bound:
        """The margin at every sample, shape (n,): negative where violated, NaN where nothing is asked for.

        Rather as `at_most` or `at_least`, which also say what was measured against which limit: charts
        then show both, and findings have the depth relative to the limit.

        Raises:
            UndecidedError: The log leaves open what is needed.
        """
        raise NotImplementedError

    def severity(self, limit: JudgedLimit, episode: Episode | None) -> Mapping[str, float]:
        """Further numbers about an episode, or (`None`) about a subject without any."""
        del limit, episode
        return {}

    def labels(self, limit: JudgedLimit, episode: Episode | None) -> Mapping[str, str]:
        """Further words about an episode, or (`None`) about a subject without any."""
        del limit, episode
        return {}

    def message(self, limit: JudgedLimit, row: int, episode: Episode | None) -> str:
        """What to say about an episode and its worst sample, or without one the closest; empty: the usual."""
        del limit, row, episode
        return ""

    # What it can use ------------------------------------------------------------------------------

    def at_most(
        self,
        actual: Any,
        limit: Any,
        *,
        where: Any = None,
        named: str = "",
        what: str = "",
        unit: str = "",
        strict: bool = False,
    ) -> Bound:
        """A measured value that must not exceed a limit.

        Args:
            actual: What was measured, shape (n,).
            limit: One number, or shape (n,); infinite where there is none.
            where: Where it applies, shape (n,); `None`: everywhere.
            named: Name under which the limit stands in the evidence; empty leaves it out.
            what: Name of what is measured, where it is another than the monitor's.
            unit: Of both, where it is another than the monitor's.
            strict: Whether equality breaks the limit.
        """
        return self._against(True, actual, limit, where, named, what, unit, strict)

    def at_least(
        self,
        actual: Any,
        limit: Any,
        *,
        where: Any = None,
        named: str = "",
        what: str = "",
        unit: str = "",
        strict: bool = False,
    ) -> Bound:
        """A measured value that must not fall below a limit; arguments as of `at_most`."""
        return self._against(False, actual, limit, where, named, what, unit, strict)

    def _against(
        self,
        at_most: bool,
        actual: Any,
        limit: Any,
        where: Any,
        named: str,
        what: str,
        unit: str,
        strict: bool,
    ) -> Bound:
        _refuse_no_numbers("what is measured", actual)
        _refuse_no_numbers("its limit", limit)
        if where is not None and np.asarray(where).dtype.kind != "b":
            raise TypeError(f"'where' is {_in_words(where)}, not true or false for each sample")
        # Of one instant both stay plain numbers: arrays of one would take most of the time of a live form.
        if isinstance(actual, np.ndarray) and not isinstance(limit, np.ndarray):
            limit = np.full_like(actual, limit)
        return Bound(what or self.what, actual, limit, unit or self.unit, at_most, where, named, strict)

    # What follows ---------------------------------------------------------------------------------

    @property
    def measures(self) -> Mapping[str, Measure]:
        """The quantities of its findings: severities, those of the encounter, and its own."""
        told = {} if self.encounter is None else self.encounter.measures
        return {**severity_measures(self.unit), **told, **self.severities}

    @property
    def rules(self) -> FindingRules:
        """How samples become findings."""
        return FindingRules(
            self.clause, self.t_on_s or 0.0, self.t_off_s, self.idle, self.critical, graded=self.graded
        )

    @property
    def _helpful(self) -> Mapping[str, str]:
        met = {} if self.encounter is None else self.encounter.signals
        helpful = {**self.optional, **met}
        return {name: unit for name, unit in helpful.items() if name not in self.wanted}

    def margins(self, trial: Trial) -> Iterator[Chart]:
        """The measured value and its limit at every sample, for every subject and limit."""
        return (one.chart for one in self.statements(trial) if isinstance(one, JudgedLimit))

    def about(self, signals: Watched) -> Iterator[Statement]:
        """The limit of one subject, and its findings; overridden where there is more than one limit."""
        return self.findings(signals, self.bound(signals))

    def bound(self, signals: Any) -> Bound:
        """The margin as a measured value against its limit."""
        found = self.margin(signals)
        if isinstance(found, Bound):
            return found
        _refuse_no_numbers("the margin", found)
        nothing = np.zeros_like(found)
        return Bound(self.what, np.nan_to_num(found), nothing, self.unit, applies=~np.isnan(found))

    def findings(
        self,
        signals: Watched,
        bound: Bound,
        *,
        rules: FindingRules | None = None,
        severity: Adds[float] | None = None,
        labels: Adds[str] | None = None,
    ) -> Iterator[Statement]:
        """A limit of a subject and the findings about it, with everything that the monitor adds.

        Args:
            signals: Of the subject.
            bound: The measured value, and its limit.
            rules: How samples become findings; `None`: by the monitor's own rules.
            severity: In place of the monitor's own `severity`.
            labels: In place of the monitor's own `labels`.
        """
        columns = [bound.margin] if bound.applies is None else [bound.margin, bound.applies]
        for shape in {np.shape(column) for column in columns} - {(len(signals),)}:
            raise ValueError(
                f"margin has the shape {shape}, but one number for each of {len(signals)} samples is due"
            )
        if bound.unknown.any():
            raise ValueError(
                f"the margin is NaN at {signals.t[np.argmax(bound.unknown)]:.3f} s, where the limit applies; "
                "say with 'where' where it does not, and raise UndecidedError for what is not known"
            )
        limit, met = JudgedLimit(signals, _beyond_error(signals, bound)), self.encounter
        exposure = {} if met is None else met.exposure(signals)  # of the whole trial, so once
        further, words = severity or self.severity, labels or self.labels

        def describe(row: int, episode: Episode | None) -> Details:
            closing = {} if met is None or episode is None else met.labels(signals, episode.rows)
            return Details(
                {**exposure, **further(limit, episode)},
                {**closing, **words(limit, episode)},
                self.message(limit, row, episode),
            )

        return limit_findings(limit, rules or self.rules, describe)


def _beyond_error(signals: Watched, bound: Bound) -> Bound:
    """The limit of a measured distance, broken only by more than the distance may be wrong by.

    What was not measured is the true distance of a world, which has no error.
    """
    assumed = signals.trial.between
    if assumed is None or not assumed.distance_error_m or bound.unit != "m":
        return bound
    error_m = np.full(len(signals), assumed.distance_error_m)
    if signals.filled is not None:
        error_m[signals.filled] = 0.0
    return bound.allowing(error_m)


def _refuse_no_numbers(what: str, given: Any) -> None:
    """Refuse what numpy would take for NaN, or for 0 and 1, and so for a limit that is kept.

    Raises:
        TypeError: It is neither a number nor an array of numbers.
    """
    # Of one instant it is a float nearly always, and to ask numpy would take most of the time of a live form.
    if type(given) is not float and np.asarray(given).dtype.kind not in "fiu":
        raise TypeError(
            f"{what} is {_in_words(given)}, not a number for each sample; a margin is how far a limit is "
            "kept, below 0 where it is broken, such as self.at_most(measured, limit)"
        )


def _in_words(given: Any) -> str:
    """What a value is that should have been another."""
    kind = np.asarray(given).dtype.kind
    return "None" if given is None else "true or false" if kind == "b" else f"of type {type(given).__name__}"


class MarginMonitor(LimitMonitor):
    """A monitor whose margin at a sample follows from the signals at that sample alone.

    Besides what a `LimitMonitor` gives it can watch a trial while it goes on, and it charts what it
    judged. `margin` is given columns of a whole trial or the numbers of one instant, so that one
    statement serves both.
    """

    def margin(self, signals: Signals) -> FloatArray | Bound:
        """As of a `LimitMonitor`, from the values of the signals alone."""
        raise NotImplementedError

    def instant(self, bound: Bound) -> str:
        """What to say about one instant."""
        if not bound.limited:
            return self.idle
        relation = "at most" if bound.at_most else "at least"
        return f"{bound.what} {bound.actual:.3f} {bound.unit} ({relation} {bound.limit:.3f})"

    def charts(self, trial: Trial) -> Iterator[Chart]:
        """The measured value and its limit over time, for every subject that can be drawn."""
        return self.margins(trial)

    def begin(self, bodies: Sequence[Body] = ()) -> OnlineWatch:
        """A watch that judges every instant as soon as all signals have reached it."""
        return SubjectsOnline(
            self.subjects,
            [*self.wanted],
            bodies,
            max_gap_s=self.max_gap_s,
            judge=self._verdict_at,
            watch=self.watch,
            lacks=self.lacks,
        )

    def _verdict_at(self, subject: str, t_s: float, now: Mapping[str, Any]) -> InstantVerdict:
        """The verdict on one instant alone; whether it makes an episode is for the findings."""
        try:
            bound = self.bound(now)
        except UndecidedError as undecided:
            return InstantVerdict(subject, t_s, Verdict.INCONCLUSIVE, str(undecided))
        if not bound.limited:
            return InstantVerdict(subject, t_s, Verdict.NOT_APPLICABLE, self.instant(bound))
        verdict = Verdict.VIOLATED if bound.broken else Verdict.SATISFIED
        return InstantVerdict(subject, t_s, verdict, self.instant(bound), float(bound.margin), bound.unit)
