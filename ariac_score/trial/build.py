"""Building a trial from what readers find, and merging the trials of several logs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import replace
from types import MappingProxyType
from typing import Protocol, TypeVar

import numpy as np

from ariac_score.errors import ContradictionError, LogError
from ariac_score.trial.agreement import counting_parts, refuse_other_work, statements_of
from ariac_score.trial.attestation import Attestation
from ariac_score.trial.believed import believed, without_contested
from ariac_score.trial.clock import Clock
from ariac_score.trial.cut import Cut
from ariac_score.trial.cut_off import joined_cut, lacks_work, with_open_work
from ariac_score.trial.events import COMPETITION_STARTED, ORDER_ANNOUNCED, TIMED_EVENTS, WATCHING, Event
from ariac_score.trial.model import Body, Due, LogDefect, OfficialResult, TeamSetup, Trial
from ariac_score.trial.shift import shifted
from ariac_score.trial.signals import Series, Signal, settle
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of, subject_of
from ariac_score.trial.window import earliest_start_s
from ariac_score.trial.work import (
    Fact,
    Record,
    Submission,
    WorkItem,
    all_items,
    announced_s,
    at_times,
    dated_at,
)

__all__ = [
    "LARGEST_STEP_BACK_S",
    "Joining",
    "TrialBuilder",
    "first_announced",
    "merge_trials",
    "only",
    "settle_work",
]

LARGEST_STEP_BACK_S = 1.0
"""Stamps further back than this mean two recordings in one file, which sorting would interleave."""


LATEST_START_S = 0.1
"""States are published ten times a second: by so much a start may be earlier than its message."""

LATEST_WATCHER_S = 1.0
"""Where the start is not in the log, who watches so soon after its beginning watched all of it."""


_T = TypeVar("_T")

_SETTLED_DEFECTS = MappingProxyType(
    {
        "disordered_stamps": "stamps ran backwards; samples were sorted by time",
        "repeated_stamps": "stamps were repeated; of samples that agree one was kept",
        "contradicting_stamps": "samples with one stamp contradict each other; they were left out, as gaps",
        "impossible_values": "values that are NaN, infinite or impossible were left out, as gaps",
    }
)
"""What `settle` counts, in the order of its counts."""


class TrialBuilder:
    """Collects what a reader finds and settles it into a `Trial` once.

    Args:
        trial_id: Name of the trial.
        file: The log, for error messages.
        clock: Which clock the times come from; `None` when the log does not say.
    """

    def __init__(self, trial_id: str, *, file: object, clock: Clock | None) -> None:
        self.trial_id, self.file, self.clock = trial_id, file, clock
        self.work: list[WorkItem] = []
        self.submissions: list[Submission] = []
        self.events: list[Event] = []
        self.bodies: dict[str, Body] = {}
        self.signals: dict[str, Signal] = {}
        self.as_consumed: dict[str, Series] = {}
        self.team: TeamSetup | None = None
        self.official: OfficialResult | None = None
        self.witnessed: set[str] = set()
        self.unrecorded: list[str] = []
        self.due: dict[str, Due] = {}
        self.published_kinds: frozenset[str] = frozenset()
        self.recorded: Span | None = None
        self.facts: dict[str, Fact] = {}
        self.records: list[Record] = []
        self.attestation: Attestation | None = None
        self.cut: Cut | None = None
        self.unseen_losses = ""
        self._defects: dict[tuple[str, str], LogDefect] = {}
        self._watching: dict[str, float] = {}
        self._doubted: dict[str, str] = {}

    def add(self, item: WorkItem | Submission | Event | Record) -> None:
        """Take one decoded item; a work item with a time also makes its announcement an event."""
        if isinstance(item, Submission):
            self.submissions.append(item)
        elif isinstance(item, Record):
            self.records.append(item)
        elif isinstance(item, Event):
            if item.kind == WATCHING:  # nothing happened: the recorder declares what it would have recorded
                known_s = self._watching.get(item.subject, np.inf)
                self._watching[item.subject] = min(item.t_s, known_s)
            else:
                self.events.append(item)
        else:
            self._add_work(item)

    def _add_work(self, item: WorkItem) -> None:
        _refuse_repeated_ids(item, self.file)
        self.work.append(item)
        t_s = announced_s(item)
        if t_s is not None:
            self.events.append(Event(t_s, ORDER_ANNOUNCED, item.id))

    def add_body(self, body: Body) -> None:
        """Take a body; links of one that is already known are added to it."""
        known = self.bodies.get(body.id)
        self.bodies[body.id] = _joined(known, body, self.file)

    def defect(self, kind: str, where: str, count: int, message: str) -> None:
        """Count a fault of the log that reading survived; a count of 0 leaves no trace."""
        if count:
            known = self._defects.get((kind, where))
            total = count + (known.count if known else 0)
            self._defects[kind, where] = LogDefect(kind, where, total, message)

    def add_signal(
        self,
        name: str,
        unit: str,
        t: FloatArray,
        values: FloatArray,
        *,
        source: str = "",
        holes: Sequence[Span] = (),
        contested: Sequence[Span] = (),
        constant: bool = False,
        stamp_jitter_s: float = 0.0,
        stated_rate_hz: float = 0.0,
    ) -> None:
        """Take the samples of one signal in recorded order and settle them; see `Signal` for the rest.

        Raises:
            LogError: Time runs back so far that the file must hold two recordings,
                or the signal was there already.
        """
        self._refuse_recorded(name)
        known = QUANTITIES.get(quantity_of(name))  # a log may declare quantities of its own
        settled = settle(
            np.asarray(t, dtype=np.float64),
            np.asarray(values, dtype=np.float64),
            at_least=known.at_least if known else -np.inf,
        )
        if settled.largest_step_back_s > LARGEST_STEP_BACK_S:
            raise LogError(
                f"time runs backwards by {settled.largest_step_back_s:.3f} s in signal {name!r}",
                file=self.file,
                hint="the file seems to hold two recordings (or a reset simulation): score them one by one",
            )
        counts = settled.disordered, settled.repeated, settled.contradicting, settled.not_finite
        for (kind, message), count in zip(_SETTLED_DEFECTS.items(), counts, strict=True):
            self.defect(kind, name, count, message)
        if len(settled.t):
            t, values, left_out = without_contested(settled.t, settled.values, contested)
            unknown = tuple(sorted({*holes, *(one.span for one in left_out)}))
            self.signals[name] = Signal(
                name,
                unit,
                t,
                values,
                source,
                unknown,
                constant,
                stamp_jitter_s,
                stated_rate_hz=stated_rate_hz,
                disbelieved=left_out,
            )

    def add_series(
        self, name: str, unit: str, t: FloatArray, values: FloatArray, *, source: str = ""
    ) -> None:
        """Take a series as consumed: as it is, in this order, whatever its stamps are.

        Raises:
            LogError: A number is not finite, for leaving one out would change what follows; or
                something of that name was there already.
        """
        self._refuse_recorded(name)
        try:
            series = Series(name, unit, t, values, source)
        except ValueError as cause:
            raise LogError(
                str(cause), file=self.file, hint="nothing is left out of a series as consumed"
            ) from None
        if len(series):
            self.as_consumed[name] = series

    def _refuse_recorded(self, name: str) -> None:
        if name in self.signals or name in self.as_consumed:
            raise LogError(
                f"signal {name!r} is recorded twice",
                file=self.file,
                hint="the log map leads two topics, frames or models to one signal: map one of them, or, "
                "where they are parts of one body, name them as its links",
            )

    def build(self) -> Trial:
        """The trial, in order of time; what repeats in its work is settled by `merge_trials`."""
        self._believe_watchers()
        self.witnessed = {*_without_published(self.witnessed, self.published_kinds)}
        if self.unseen_losses:
            self.witnessed.clear()
            self.defect("unseen_losses", str(self.trial_id), 1, self.unseen_losses)
        bodies = tuple(self.bodies.values())
        start_s = earliest_start_s(Trial(self.trial_id, events=tuple(sorted(set(self.events)))))
        self.signals, noted = believed(self.signals, bodies, start_s=-np.inf if start_s is None else start_s)
        for defect in noted:
            self.defect(defect.kind, defect.where, defect.count, defect.message)
        return Trial(
            id=self.trial_id,
            work=tuple(self.work),
            submissions=tuple(sorted(self.submissions, key=lambda s: s.submitted_s)),
            events=tuple(sorted(set(self.events))),
            bodies=_present([self.bodies[k] for k in sorted(self.bodies)], self.signals, self.witnessed),
            signals={k: self.signals[k] for k in sorted(self.signals)},
            team=self.team,
            official=self.official,
            witnessed=frozenset(self.witnessed),
            unrecorded=tuple(sorted(self.unrecorded)),
            log_defects=tuple(self._defects[k] for k in sorted(self._defects)),
            clocks=() if self.clock is None else (self.clock,),
            recorded=self.recorded or _span_of(self._sampled, self.events, self.submissions),
            facts={name: self.facts[name] for name in sorted(self.facts)},
            records=tuple(self.records),
            attestation=self.attestation,
            cut=self.cut,
            as_consumed={k: self.as_consumed[k] for k in sorted(self.as_consumed)},
            stand_ins=_not_in({**self.signals, **self.as_consumed}, self.due),
            published_kinds=self.published_kinds,
        )

    def doubt(self, watched: Iterable[str], where: str) -> None:
        """Believe nobody that some kinds of events did not happen: messages that may have told so were lost.

        Args:
            watched: The kinds that were told there.
            where: The topic.
        """
        self._doubted.update(dict.fromkeys(watched, where))

    def _told_in_time_s(self) -> tuple[float, float | None]:
        """Until when something is told from the beginning: of the recording, and of the competition, s."""
        starts = [event.t_s for event in self.events if event.kind == COMPETITION_STARTED]
        begin_s = self.recorded.start_s + LATEST_WATCHER_S if self.recorded else np.inf
        return begin_s, min(starts) + LATEST_START_S if starts else None

    def holds_from_s(self, told_s: float) -> float:
        """From when on what is told once, and never changes, holds, s: from the beginning, or since then."""
        begin_s, start_s = self._told_in_time_s()
        in_time_s = begin_s if start_s is None else max(begin_s, start_s)
        return told_s if told_s > in_time_s else -np.inf

    def _believe_watchers(self) -> None:
        """Take the word of those who watched from the start on; none vouches for the time before."""
        begin_s, start_s = self._told_in_time_s()
        start_s = begin_s if start_s is None else start_s
        for kind, t_s in sorted(self._watching.items()):
            if t_s <= start_s:
                self.witnessed.add(kind)
            elif kind not in self.witnessed:
                message = f"watched for from {t_s:.3f} s on only: nobody knows what happened before"
                self.defect("late_watcher", kind, 1, message)
        for kind in sorted(self.witnessed & self._doubted.keys()):
            message = f"told on {self._doubted[kind]}, of which messages are lost or cannot be read"
            self.defect("doubted_watcher", kind, 1, message)
            self.witnessed.remove(kind)

    @property
    def _sampled(self) -> tuple[Signal | Series, ...]:
        return (*self.signals.values(), *self.as_consumed.values())


def _refuse_repeated_ids(item: WorkItem, file: object) -> None:
    """Refuse an item in which two things have one name: findings could not distinguish them."""
    # Counted once: a stranger's item may have as many inside as fit into a line of a log.
    twice = sorted(name for name, count in Counter(inner.id for inner in item.items).items() if count > 1)
    if twice:
        raise LogError(
            f"{item.level} {item.id!r} holds two items named {twice[0]!r}",
            file=file,
            hint="give each its own name",
        )
    for inner in item.items:
        _refuse_repeated_ids(inner, file)


def _span_of(
    sampled: Iterable[Signal | Series], events: Iterable[Event], submissions: Iterable[Submission]
) -> Span | None:
    times = [t_s for s in sampled if s.span for t_s in (s.span.start_s, s.span.end_s)]
    times += [e.t_s for e in events] + [s.submitted_s for s in submissions]
    return Span(min(times), max(times)) if times else None


def _not_in(recorded: Iterable[str], due: Mapping[str, Due]) -> dict[str, Due]:
    """The signals that were due on a topic and nobody recorded."""
    return {name: due[name] for name in sorted(due.keys() - set(recorded))}


def _present(bodies: Iterable[Body], recorded: Iterable[str], witnessed: Set[str]) -> tuple[Body, ...]:
    """The bodies but for those of a kind of which the log says that there was none, if nothing shows them."""
    shown = {part.partition("::")[0] for name in recorded for part in subject_of(name).split("/")}
    return tuple(one for one in bodies if one.id in shown or f"{one.kind} bodies" not in witnessed)


def _without_published(witnessed: Iterable[str], kinds: Set[str]) -> frozenset[str]:
    """What was witnessed, but for that there are no bodies of kinds that are published all the same."""
    return frozenset(witnessed) - {f"{kind} bodies" for kind in kinds}


def _joined(known: Body | None, body: Body, file: object) -> Body:
    """A body with its new and its known links."""
    if known is not None and known.kind != body.kind:
        raise LogError(
            f"body {body.id!r} is both of kind {known.kind!r} and of kind {body.kind!r}",
            file=file,
            hint="look at 'kind:' in the log map, and in the one that it extends",
        )
    if known is not None and known.radius_m != body.radius_m:
        raise LogError(f"body {body.id!r} is described twice, with different radii", file=file)
    return replace(body, links=tuple(sorted({*(known.links if known else ()), *body.links})))


class Joining(Protocol):
    """A competition that says itself what the logs of one trial together say of its work."""

    def join(self, merged: Trial, parts: Sequence[Trial], file: object, /) -> Trial:
        """The merged trial with its work and submissions.

        Args:
            merged: Everything but work and submissions, which are empty.
            parts: What each log shows, on one clock.
            file: The bundle, for error messages.

        Raises:
            LogError: Two logs contradict each other.
        """
        ...


def merge_trials(trial_id: str, parts: Sequence[Trial], *, file: object, competition: object = None) -> Trial:
    """One trial from the several logs of a bundle.

    Each kind of thing may come from one log only, except events, bodies, records, defects
    and `witnessed`, which add up. Work takes its time from the event of its announcement. A
    competition that has `join` decides itself what work and submissions are; see `Joining`.
    Facts of the trial that two files state must agree, and a file that lies with the run must agree
    with the one of its role that the caller gave. Logs that count from another
    zero of one clock are shifted; logs on another clock than the log that records the
    motion keep what needs no time (see `_without_times`).

    Raises:
        LogError: Two logs contradict each other.
    """
    parts = counting_parts(parts, file)
    parts = _on_one_clock(parts)  # first, for everything below compares times
    spans = [p.recorded for p in parts if p.recorded]
    published = frozenset(kind for p in parts for kind in p.published_kinds)
    _columns([columns for p in parts for columns in (p.signals, p.as_consumed)], file)  # no name is both
    merged = Trial(
        id=trial_id,
        events=tuple(sorted({e for p in parts for e in p.events})),
        bodies=_bodies(parts, file),
        signals=_columns([part.signals for part in parts], file),
        as_consumed=_columns([part.as_consumed for part in parts], file),
        team=_team([p.team for p in parts if p.team], file),
        official=only("an official result", [p.official for p in parts if p.official], file),
        witnessed=_without_published((w for p in parts for w in p.witnessed), published),
        unrecorded=tuple(sorted({u for p in parts for u in p.unrecorded})),
        log_defects=tuple(sorted(d for p in parts for d in p.log_defects)),
        clocks=_clocks(parts),
        recorded=Span(min(s.start_s for s in spans), max(s.end_s for s in spans)) if spans else None,
        facts=_facts(parts, file),
        records=_records(parts),
        stand_ins=_not_in(
            (name for p in parts for name in (*p.signals, *p.as_consumed)),
            {name: due for p in parts for name, due in p.stand_ins.items()},
        ),
        read_with=frozenset(point for p in parts for point in p.read_with),
        published_kinds=published,
        statements=statements_of(parts),
        cut=joined_cut(parts),
        attestations=tuple(
            (p.origin.file, p.attestation) for p in parts if p.origin and p.origin.role == "log"
        ),
    )
    merged = replace(merged, bodies=_present(merged.bodies, merged.signals, merged.witnessed))
    join = getattr(competition, "join", None)
    merged = _joined_plainly(merged, parts, file) if join is None else join(merged, parts, file)
    return _within_competition(with_open_work(merged, parts))


def _joined_plainly(merged: Trial, parts: Sequence[Trial], file: object) -> Trial:
    """The trial with the work and the submissions of the log that has any."""
    stating = [replace(part, work=settle_work(part.work, file)) for part in parts if part.work]
    missed: tuple[WorkItem, ...] = ()
    for part in stating[1:]:
        missed += _not_yet(stating[0], part, file)
    # What a log announces has its time, which no configuration can know.
    dated = [p.work for p in stating if any(announced_s(item) is not None for item in p.work)]
    work = only("work", dated or [part.work for part in stating], file) or ()
    submissions = only("submissions", [p.submissions for p in parts if p.submissions], file) or ()
    announced = first_announced(merged)
    known = {item.id for item in work}
    work = (*work, *(item for item in missed if item.id not in known))
    items = tuple(
        item if announced_s(item) is not None else dated_at(item, announced.get(item.id)) for item in work
    )
    asked = {item.id for item in all_items(items)}
    unknown = sum(1 for s in submissions if s.item_id not in asked)
    noted = LogDefect("unknown_item", merged.id, unknown, "submissions answer nothing that was asked for")
    defects = (*merged.log_defects, *([noted] if unknown else []))
    return replace(merged, work=items, submissions=submissions, log_defects=tuple(sorted(defects)))


def _not_yet(first: Trial, second: Trial, file: object) -> tuple[WorkItem, ...]:
    """What one of two parts has of the work that both state, and the other lost with its end.

    Raises:
        ContradictionError: They differ in something else.
    """
    one, other = {item.id for item in first.work}, {item.id for item in second.work}
    missed = {*(other - one if lacks_work(first) else ()), *(one - other if lacks_work(second) else ())}
    kept = [replace(part, work=tuple(i for i in part.work if i.id not in missed)) for part in (first, second)]
    refuse_other_work(kept[0], kept[1], file)
    return tuple(item for item in (*first.work, *second.work) if item.id in missed)


def settle_work(announced: Sequence[WorkItem], file: object = None) -> tuple[WorkItem, ...]:
    """The items, each once: a log may repeat an announcement, with the same contents.

    Raises:
        LogError: An item is announced again with other contents.
    """
    first: dict[str, WorkItem] = {}
    for item in announced:
        known = first.setdefault(item.id, item)
        if (known.level, known.facts, tuple(known.items)) != (item.level, item.facts, tuple(item.items)):
            raise LogError(
                f"{item.level} {item.id!r} is announced twice, with different contents",
                file=file,
                hint="give each its own id",
            )
    return tuple(first.values())


def first_announced(trial: Trial) -> dict[str, float]:
    """When each thing was first announced, by its id, s of trial time."""
    found: dict[str, float] = {}
    for event in sorted(trial.events):
        if event.kind == ORDER_ANNOUNCED:
            found.setdefault(event.subject, event.t_s)
    return found


def _records(parts: Sequence[Trial]) -> tuple[Record, ...]:
    """The records; those with times only where no submissions have lost theirs, for they cannot be joined."""
    untimed = any(part.submissions and part.recorded is None for part in parts)
    return tuple(r for part in parts for r in part.records if not (untimed and r.timed))


def _team(setups: Sequence[TeamSetup], file: object) -> TeamSetup | None:
    if not setups:
        return None
    what = "a team set-up"
    sensors = only(what, [dict(team.sensors) for team in setups if team.sensors is not None], file)
    return TeamSetup(only(what, [team.name for team in setups if team.name], file) or "", sensors)


def _within_competition(trial: Trial) -> Trial:
    """The trial with the submissions that can count; irregularities are noted as defects.

    No competition accepts a submission before the start or after the end. Submissions that
    are left out are counted, so that none vanishes silently.
    """
    low_s, high_s, no_window = _competition_limits(trial)
    counted = tuple(s for s in trial.submissions if low_s <= s.submitted_s <= high_s)
    noted = {
        "no_window": (bool(no_window), no_window),
        "outside_competition": (
            len(trial.submissions) - len(counted),
            "submissions before the start or after the end were refused",
        ),
    }
    defects = (LogDefect(kind, trial.id, int(n), message) for kind, (n, message) in noted.items() if n)
    return replace(trial, submissions=counted, log_defects=tuple(sorted([*trial.log_defects, *defects])))


def _competition_limits(trial: Trial) -> tuple[float, float, str]:
    """Between which times submissions count, s, and why there are no limits, where there are none."""
    start_s, end_s = trial.started_s, trial.ended_s
    if start_s is None and end_s is None:
        return -np.inf, np.inf, "start and end of the competition are not in the log; all of it was watched"
    earliest_s = earliest_start_s(trial)  # it was taken, so the competition had started
    low_s = -np.inf if earliest_s is None else earliest_s
    high_s = np.inf if end_s is None else end_s
    if start_s is not None and start_s >= high_s:
        times = f"it ends ({high_s:.3f} s) before it starts ({start_s:.3f} s)"
        return -np.inf, np.inf, f"{times}; all of it was watched"
    return low_s, high_s, ""


def _clocks(parts: Sequence[Trial]) -> tuple[Clock, ...]:
    """The clocks of the parts, the one with most detail of each; that of the times stands first."""
    # Times of one kind of clock are taken as comparable even where one log does not give its origin.
    ranked = sorted(parts, key=lambda part: (part.recorded is None, _times_clock(part).origin_ns is None))
    found: dict[tuple[str, int | None], Clock] = {}
    for clock in (clock for part in ranked for clock in part.clocks):
        key = clock.kind, clock.origin_ns
        found[key] = max(found.get(key, clock), clock, key=lambda c: len(c.detail))
    return tuple(found.values())


def _times_clock(part: Trial) -> Clock:
    return part.clocks[0] if part.clocks else Clock("")


def _on_one_clock(parts: Sequence[Trial]) -> list[Trial]:
    """The parts with times on the clock of the part that records the motion, or else the contents."""
    timed = [part for part in parts if part.recorded is not None]
    if not timed:
        return list(parts)
    main = max(timed, key=_timed_contents)
    return [part if part.recorded is None else _on_clock_of(main, part) for part in parts]


def _on_clock_of(main: Trial, part: Trial) -> Trial:
    """A part with its times counted from where those of another begin, or without them."""
    clock, own = _times_clock(main), _times_clock(part)
    if own.kind != clock.kind:
        return _without_times(part, main)
    if own.origin_ns is None or clock.origin_ns is None or own.origin_ns == clock.origin_ns:
        return part
    # Each recording counts from its own first stamp.
    later_ns = own.origin_ns - clock.origin_ns
    return replace(shifted(part, later_ns / 1e9), clocks=(replace(own, origin_ns=clock.origin_ns),))


def _timed_contents(part: Trial) -> tuple[int, int]:
    """How much of a part is worth nothing on another clock: signals first, then contents."""
    return len(part.sampled), sum(1 for s in part.submissions if s.detailed)


def _without_times(part: Trial, main: Trial) -> Trial:
    """What remains of a log on another clock: what happened, but not when.

    Start, end and announcements mean nothing without their time and are left out.
    """
    assert main.recorded is not None  # chosen for having one
    # Collisions and drops count whenever they happened, so they are put where the competition ends.
    end_s = main.recorded.end_s if main.ended_s is None else main.ended_s
    kept = tuple(replace(e, t_s=end_s) for e in part.events if e.kind not in TIMED_EVENTS)
    left_out = len(part.events) - len(kept)
    own, others = _times_clock(part).kind, _times_clock(main).kind
    message = f"its times are {own}, the motion is in {others}; they were not used"
    defect = LogDefect("other_clock", part.id, left_out + len(kept) + len(part.submissions), message)
    return replace(
        part,
        events=kept,
        submissions=tuple(replace(s, submitted_s=end_s) for s in part.submissions),
        work=at_times(part.work, lambda _t_s: None),
        signals={},
        as_consumed={},
        recorded=None,
        records=tuple(record for record in part.records if not record.timed),
        clocks=(),
        cut=None if part.cut is None else replace(part.cut, until_s=None),
        log_defects=(*part.log_defects, defect),
    )


def _facts(parts: Sequence[Trial], file: object) -> dict[str, Fact]:
    """The facts that the files state of the trial, which must not contradict each other."""
    stated: dict[str, tuple[Fact, str]] = {}
    for part in parts:
        source = str(part.origin) if part.origin else repr(part.official.source if part.official else part.id)
        for name, value in sorted(part.facts.items()):
            known, first = stated.setdefault(name, (value, source))
            if known != value:
                raise ContradictionError(name, (first, _said(known)), (source, _said(value)), file=file)
    return {name: stated[name][0] for name in sorted(stated)}


def _said(value: Fact) -> str:
    return "absent" if value is None else repr(value) if isinstance(value, str) else f"{value:g}"


def _bodies(parts: Sequence[Trial], file: object) -> tuple[Body, ...]:
    bodies: dict[str, Body] = {}
    for body in (body for part in parts for body in part.bodies):
        bodies[body.id] = _joined(bodies.get(body.id), body, file)
    return tuple(bodies[name] for name in sorted(bodies))


_Column = TypeVar("_Column", bound="Signal | Series")


def _columns(found: Sequence[Mapping[str, _Column]], file: object) -> dict[str, _Column]:
    columns: dict[str, _Column] = {}
    for name, column in (item for each in found for item in each.items()):
        if name in columns:
            raise LogError(f"two logs record the signal {name!r}", file=file, hint="a bundle is one trial")
        columns[name] = column
    return {name: columns[name] for name in sorted(columns)}


def only(what: str, found: Sequence[_T], file: object) -> _T | None:
    """The one thing that several logs say; `None` when none says anything.

    Raises:
        LogError: They differ.
    """
    # Equal copies are no contradiction: a configuration and a record may state the same.
    if len(found) > 1 and any(item != found[0] for item in found[1:]):
        raise LogError(
            f"{len(found)} logs hold {what}, and they differ",
            file=file,
            hint="a bundle is one trial: keep one, or name the parts in bundle.yaml",
        )
    return found[0] if found else None
