"""What every monitor of a result says over time: its margin and its state, instant by instant.

A monitor that tells its margin at every sample is taken at its word; one that can watch online
is asked about every instant. Of any other only what its findings say is known: where they begin
and end, and the samples they rest on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ariac_score.checks.captured_output import quiet
from ariac_score.checks.contracts import OnlineMonitor, Standing
from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.guarded import broken
from ariac_score.checks.registry import Plugin
from ariac_score.engine.ask import margins_of
from ariac_score.engine.prepared import Prepared
from ariac_score.engine.provenance import file_hashes
from ariac_score.engine.read import find_trial, read_needed
from ariac_score.engine.signal_needs import needs_of
from ariac_score.errors import ResultError
from ariac_score.results.result import Result
from ariac_score.trial.course import Course
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Sample, Signal
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.vocabulary import quantity_of
from ariac_score.trial.windows import cuts_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

__all__ = ["SAID", "Moment", "Part", "Track", "read_again", "tracks"]

SAID: tuple[Verdict | None, ...] = (
    Verdict.SATISFIED,
    Verdict.VIOLATED,
    Verdict.INCONCLUSIVE,
    Verdict.NOT_APPLICABLE,
    None,
)
"""What a monitor can say of an instant, by number; `None`: nothing."""

JUST_AFTER_S = 1e-9
"""What lacks samples is undecided from the last one on, which itself was judged."""


@dataclass(frozen=True, slots=True)
class Moment:
    """What a monitor says of one instant.

    Attributes:
        t_s: The instant, s of trial time.
        verdict: What holds from here on; `None`: nothing is said.
        margin: Signed distance to the limit, negative when violated; `None` without one.
        message: One sentence for people; empty where nothing is new.
    """

    t_s: float
    verdict: Verdict | None
    margin: float | None
    message: str = ""


@dataclass(frozen=True, eq=False)
class Part:
    """Moments of a track, one after the other.

    Attributes:
        t_s: As of a moment, shape (n,).
        said: The verdict of each, as its number in `SAID`, shape (n,).
        margin: Likewise; NaN without one.
        messages: By row, where there is one.
    """

    t_s: FloatArray
    said: NDArray[np.uint8]
    margin: FloatArray
    messages: Mapping[int, str]

    @classmethod
    def of(cls, moments: Sequence[Moment]) -> Part:
        """Some moments as columns."""
        return cls(
            np.array([moment.t_s for moment in moments], dtype=np.float64),
            np.array([SAID.index(moment.verdict) for moment in moments], dtype=np.uint8),
            np.array([math.nan if m.margin is None else m.margin for m in moments], dtype=np.float64),
            {row: moment.message for row, moment in enumerate(moments) if moment.message},
        )

    def moments(self) -> Iterator[Moment]:
        """The same one by one."""
        columns = self.t_s.tolist(), self.said.tolist(), self.margin.tolist()
        for row, (t_s, said, margin) in enumerate(zip(*columns, strict=True)):
            known = None if math.isnan(margin) else margin
            yield Moment(t_s, SAID[said], known, self.messages.get(row, ""))


@dataclass(frozen=True)
class Track:
    """What one monitor says about one subject, in order of time.

    Attributes:
        check: Name of the check.
        subject: Whom it is about.
        unit: Unit of the margins.
        moments: Strictly increasing in time.
        what: What its margin is of, where a subject has several; empty for the first.
        sampled: Whether its margin is known at every sample, not only where findings rest.
    """

    check: str
    subject: str
    unit: str
    moments: tuple[Moment, ...]
    what: str = ""
    sampled: bool = False

    def parts(self) -> Iterator[Part]:
        """The moments in parts, one after the other; each has some."""
        if self.moments:
            yield Part.of(self.moments)


class _Sampled(Track):
    """A track that is made part by part whenever it is looked at, and never held as a whole."""

    _made: Callable[[], Iterator[Part]]

    def __init__(
        self, check: str, subject: str, unit: str, what: str, made: Callable[[], Iterator[Part]]
    ) -> None:
        known = {"check": check, "subject": subject, "unit": unit, "what": what, "sampled": True}
        for name, value in {**known, "_made": made}.items():
            object.__setattr__(self, name, value)

    def parts(self) -> Iterator[Part]:
        """The moments in parts, made anew."""
        return self._made()

    @property
    def moments(self) -> tuple[Moment, ...]:
        """All moments."""
        return tuple(moment for part in self._made() for moment in part.moments())


def read_again(result: Result, path: Path, prepared: Prepared) -> Trial:
    """The trial of a result, read from its log with every signal its monitors need.

    Raises:
        ResultError: The log is not one the result was made from.
        ScoreError: The log cannot be read.
    """
    bundle, readers = find_trial(path, prepared.registry)
    known = {source.sha256 for source in result.provenance.inputs}
    for source in file_hashes(bundle):
        if source.role == "log" and source.sha256 not in known:
            raise ResultError(
                f"the result was not made from {source.name}: its sha256 is {source.sha256[:16]}…",
                file=path,
                hint="give the log the result is of; 'ariac-score verify' says what differs",
            )
    return prepared.derived(read_needed(bundle, readers, prepared))


def tracks(result: Result, trial: Trial, prepared: Prepared) -> list[Track]:
    """What every monitor says over time, in the order of the rule set.

    Args:
        result: The result.
        trial: Its trial, with the derived signals.
        prepared: The rules by which it was scored.

    Raises:
        PluginError: A monitor raised.
    """
    found: list[Track] = []
    for name, each in prepared.checks.items():
        plugin, check = each.plugin, each.check
        if plugin.group != "ariac_score.monitors":
            continue
        findings = list(result.measured.of(name).values())
        own = _sampled(name, margins_of(plugin, name, check, trial), findings)
        if not own and isinstance(check, OnlineMonitor):
            own = _watched(plugin, name, check, trial)
        own = [_with_undecided(track, findings) for track in own]
        known = {track.subject for track in own}
        found += [*own, *_told(name, [f for f in findings if f.subject not in known], result)]
    return found


def _with_undecided(track: Track, findings: Sequence[Finding]) -> Track:
    """A track that says between its samples, where they lack, what is undecided."""
    undecided = [
        Moment(f.span.start_s, f.verdict, None, f.message)
        for f in findings
        if f.subject == track.subject and f.verdict is Verdict.INCONCLUSIVE and f.span is not None
    ]
    if not undecided:
        return track
    made = partial(_among, track.parts, undecided)
    return _Sampled(track.check, track.subject, track.unit, track.what, made)


def _among(parts: Callable[[], Iterator[Part]], undecided: Sequence[Moment]) -> Iterator[Part]:
    """Parts with what is undecided among them: just after the sample where it begins at one."""
    waiting = sorted(enumerate(undecided), key=lambda one: (one[1].t_s, one[0]))
    more: dict[float, tuple[int, Moment]] = {}
    for part in parts():
        last_s = float(part.t_s[-1])
        while waiting and waiting[0][1].t_s <= last_s:
            number, moment = waiting.pop(0)
            begins_s = moment.t_s
            row = int(part.t_s.searchsorted(begins_s))
            _put(more, number, moment, begins_s + JUST_AFTER_S if part.t_s[row] == begins_s else begins_s)
        ready = sorted(t_s for t_s in more if t_s < last_s)
        yield _inserted(part, [more.pop(t_s)[1] for t_s in ready])
    for number, moment in waiting:
        _put(more, number, moment, moment.t_s)
    if more:
        yield Part.of([more[t_s][1] for t_s in sorted(more)])


def _put(more: dict[float, tuple[int, Moment]], number: int, moment: Moment, t_s: float) -> None:
    """Say something of an instant, unless something that comes later is said of it."""
    if t_s not in more or more[t_s][0] < number:
        more[t_s] = number, replace(moment, t_s=t_s)


def _inserted(part: Part, moments: Sequence[Moment]) -> Part:
    """A part with more moments, after those of the same time."""
    if not moments:
        return part
    new = Part.of(moments)
    rows = part.t_s.searchsorted(new.t_s, side="right")
    told = {row + int(np.searchsorted(rows, row, side="right")): m for row, m in part.messages.items()}
    told |= {int(rows[k]) + k: moments[k].message for k in range(len(moments)) if moments[k].message}
    return Part(
        np.insert(part.t_s, rows, new.t_s),
        np.insert(part.said, rows, new.said),
        np.insert(part.margin, rows, new.margin),
        told,
    )


# Monitors that tell their margins ------------------------------------------------------


def _sampled(name: str, courses: Sequence[Course], findings: Sequence[Finding]) -> list[Track]:
    """The margins of a monitor with the state at each; in the order of its subjects."""
    found: list[Track] = []
    for course in courses:
        if not any(len(t) for t in course.times()):
            continue
        several = any(track.subject == course.subject for track in found)
        violations = [
            f.span
            for f in findings
            if f.span is not None and f.subject == course.subject and f.verdict is Verdict.VIOLATED
        ]
        what = course.what if several else ""
        made = partial(_states, course, violations)
        found.append(_Sampled(name, course.subject, course.unit, what, made))
    return found


def _states(course: Course, violations: Sequence[Span]) -> Iterator[Part]:
    """What holds at each sample, in words where that changes."""
    before = -1
    for part in course.parts():
        if len(part.t):
            margin, said = part.margin, _said(part, violations)
            changed = np.flatnonzero(np.diff(said, prepend=np.array([before], dtype=np.int8)))
            before = int(said[-1])
            messages = {row: _words(part, row, margin) for row in changed.tolist()}
            yield Part(part.t, said.astype(np.uint8), margin, messages)


_SATISFIED, _VIOLATED, _IDLE = (
    SAID.index(verdict) for verdict in (Verdict.SATISFIED, Verdict.VIOLATED, Verdict.NOT_APPLICABLE)
)


def _said(course: Course, violations: Sequence[Span]) -> NDArray[np.int8]:
    """What holds at each sample; a margin of exactly 0 is broken where it counted so."""
    t, margin = course.t, course.margin
    broken, unsure = margin < 0, margin == 0
    for span in violations if unsure.any() else ():
        broken |= unsure & (t >= span.start_s) & (t <= span.end_s)
    said = np.where(broken, _VIOLATED, _SATISFIED)
    return np.where(np.isnan(margin), _IDLE, said).astype(np.int8)


def _words(course: Course, row: int, margin: FloatArray) -> str:
    """What was, beside what may be."""
    if math.isnan(margin[row]):
        return "the limit does not apply"
    actual, limit = float(course.actual[row]), float(course.limit[row])
    relation = "at most" if course.at_most else "at least"
    return f"{course.what} {actual:.3f} {course.unit} ({relation} {limit:.3f})"


# Monitors that watch online ------------------------------------------------------------


def _watched(plugin: Plugin, name: str, monitor: OnlineMonitor, trial: Trial) -> list[Track]:
    """The standing of an online monitor at every instant of the competition, by subject."""
    wanted = {need.quantity for need in needs_of(plugin, name, monitor)}
    signals = [s for key, s in sorted(trial.signals.items()) if quantity_of(key) in wanted]
    window = trial.window
    heard: dict[str, _Heard] = {}
    try:
        with quiet(plugin.origin):
            watch = monitor.begin()
            for samples in _steps(signals):
                for standing in watch.step(samples):
                    if window is not None and window.start_s <= standing.t_s <= window.end_s:
                        heard.setdefault(standing.subject, _Heard()).take(standing)
    except Exception as cause:
        raise broken(plugin, f"raised {type(cause).__name__}: {cause}", of=name) from cause
    return [_Sampled(name, subject, one.unit, "", one.parts) for subject, one in heard.items()]


class _Heard:
    """What was said of one subject, kept as columns; in words only where the state changes."""

    def __init__(self) -> None:
        self.unit = ""
        self._parts: list[Part] = []
        self._moments: list[Moment] = []
        self._before: Verdict | None = None

    def take(self, standing: Standing) -> None:
        """Keep what was just said."""
        words = standing.message if standing.verdict is not self._before else ""
        self._moments.append(Moment(standing.t_s, standing.verdict, standing.robustness, words))
        self.unit, self._before = standing.unit, standing.verdict
        if len(self._moments) == _PART_MOMENTS:
            self._parts, self._moments = [*self.parts()], []

    def parts(self) -> Iterator[Part]:
        """All of it, in parts."""
        yield from self._parts
        if self._moments:
            yield Part.of(self._moments)


_PART_MOMENTS = 4096


def _steps(signals: Sequence[Signal]) -> Iterator[list[Sample]]:
    """All samples, those of one instant together."""
    cuts = cuts_of(signals).tolist()
    for low_s, high_s in zip([-math.inf, *cuts], [*cuts, math.inf], strict=True):
        parts = [signal.stretch(signal.row(low_s), signal.row(high_s)) for signal in signals]
        times = np.concatenate([np.zeros(0), *(t for t, _ in parts)])
        which = np.repeat(np.arange(len(parts)), [len(t) for t, _ in parts])
        index = np.concatenate([np.zeros(0, dtype=np.intp), *(np.arange(len(t)) for t, _ in parts)])
        order = np.lexsort((which, times))
        groups = np.split(order, np.flatnonzero(np.diff(times[order])) + 1)
        for group in groups if len(order) else ():
            places = zip(which[group].tolist(), index[group].tolist(), strict=True)
            yield [_sample(signals[number], parts[number], row) for number, row in places]


def _sample(signal: Signal, part: tuple[FloatArray, FloatArray], row: int) -> Sample:
    t, values = part
    value = float(values[row]) if values.ndim == 1 else tuple(values[row].tolist())
    return Sample(signal.name, float(t[row]), value, signal.unit)


# Monitors of which only the findings are known ------------------------------------------


def _told(name: str, findings: Sequence[Finding], result: Result) -> Iterator[Track]:
    """A track for each subject, made of its findings."""
    subjects: dict[str, list[Finding]] = {}
    for finding in findings:
        subjects.setdefault(finding.subject, []).append(finding)
    for subject, own in subjects.items():
        moments: dict[float, Moment] = {}
        for finding in own:
            moments |= {m.t_s: m for m in _moments(finding, result) if _says_more(m, moments.get(m.t_s))}
        ordered = tuple(moments[t_s] for t_s in sorted(moments))
        unit = next((finding.unit for finding in own if finding.unit), "")
        if ordered:
            yield Track(name, subject, unit, ordered)


def _says_more(moment: Moment, known: Moment | None) -> bool:
    """Whether a moment is worth more than another at the same time: worse news first."""
    if known is None or known.verdict is None:
        return True
    return moment.verdict is not None and _rank(moment) < _rank(known)


def _rank(moment: Moment) -> tuple[int, float]:
    order = [Verdict.VIOLATED, Verdict.INCONCLUSIVE, Verdict.SATISFIED, Verdict.NOT_APPLICABLE, None]
    return order.index(moment.verdict), math.inf if moment.margin is None else moment.margin


def _moments(finding: Finding, result: Result) -> Iterator[Moment]:
    """Where a finding begins, its samples, and where it ends."""
    window = result.measured.window
    at = [sample.t_s for sample in finding.evidence]
    margin = finding.robustness
    if finding.span is None:
        start_s = min(at) if at else window.start_s if window else None
        if start_s is not None:
            yield Moment(start_s, finding.verdict, margin, finding.message)
        return
    span = finding.span
    yield Moment(span.start_s, finding.verdict, margin if span.start_s in at else None, finding.message)
    inside = {t_s for t_s in at if span.start_s < t_s <= span.end_s}
    for t_s in sorted(inside):
        yield Moment(t_s, finding.verdict, margin)
    if span.end_s > span.start_s and span.end_s not in inside:
        yield Moment(span.end_s, None, None)
