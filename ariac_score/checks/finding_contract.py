"""The contract of findings: what each must be, whoever made it, before it has a price.

The engine holds the findings of every plugin to it (`breach_of`), and `verify` those of a stored
result, as far as that says what they rest on. docs/write-a-monitor.md states it for authors.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Container, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np

from ariac_score.checks.findings import Finding, Verdict, canonical
from ariac_score.checks.measures import Measure
from ariac_score.checks.units import NEVER_NEGATIVE, UNITS, is_unit
from ariac_score.trial.chart import Chart
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Sample
from ariac_score.trial.spans import Span
from ariac_score.trial.vocabulary import QUANTITIES, quantity_of, subject_of
from ariac_score.trial.work import WorkItem, announced_s

__all__ = [
    "Breach",
    "Grounds",
    "Subjects",
    "breach_of",
    "margin_breach",
    "shown",
    "stored_breaches",
    "watched_in",
]


@dataclass(frozen=True)
class Breach:
    """What is wrong with one finding.

    Attributes:
        field: Such as `span` or `quantities.travel_m`.
        words: A predicate, such as `is -5 s, and a time is never negative`.
    """

    field: str
    words: str

    def __str__(self) -> str:
        return f"its {self.field} {self.words}"


@dataclass(frozen=True)
class Grounds:
    """What the findings of one check are held against; `None`: nobody knows, and it is not held against it.

    Attributes:
        measures: The quantities that the check declares.
        watched: The time it was given to watch.
        subjects: What a finding may be about.
        signals: The unit of each signal it was given, by name.
        units: Of declared quantities, besides those of the table.
        needed: The quantities of signals that it reads.
        forgives: Whether it counts a limit as kept that was broken too briefly; then, and only then, may
            something kept have a margin below 0.
    """

    measures: Mapping[str, Measure] | None = None
    watched: Span | None = None
    subjects: Container[str] | None = None
    signals: Mapping[str, str] | None = None
    units: Collection[str] = ()
    needed: Collection[str] = field(default=())
    forgives: bool = True


def shown(finding: Finding) -> str:
    """A finding in a few words, for messages that name it."""
    message = str(finding.message)
    short = message if len(message) <= 60 else f"{message[:59]}…"
    return f"{finding.verdict.value} {finding.subject!r} ({short})"


def breach_of(finding: Finding, grounds: Grounds) -> Breach | None:
    """The first thing that is wrong with a finding; `None` where it keeps the contract."""
    return next(_breaches(finding, grounds), None)


def stored_breaches(
    findings: Mapping[str, Finding], measures: Mapping[str, Mapping[str, Measure]], watched: Span | None
) -> Iterator[tuple[str, Breach]]:
    """The first thing that is wrong with each stored finding, by its key, as far as a result shows it."""
    for key, finding in findings.items():
        # Which bodies and signals there were, a result does not say.
        if breach := breach_of(finding, Grounds(measures.get(finding.check), watched)):
            yield key, breach


def _breaches(finding: Finding, grounds: Grounds) -> Iterator[Breach]:
    yield from _of_kind(finding)
    yield from _of_subject(finding, grounds)
    yield from _of_span(finding, grounds)
    yield from _of_margin(finding, grounds)
    yield from _of_quantities(finding, grounds)
    yield from _of_evidence(finding, grounds)


# Each field is what its type says ------------------------------------------------------


def _of_kind(finding: Finding) -> Iterator[Breach]:
    """Python does not hold a dataclass to its annotations, and a result is written from them."""
    critical: Any = finding.critical
    labels: Mapping[Any, Any] = finding.labels
    for name in ("message", "unit", "clause"):
        value = getattr(finding, name)
        if not isinstance(value, str):
            yield Breach(name, f"is {value!r}, which is no text")
    if not finding.message:
        yield Breach("message", "is empty, and nobody could read what was found")
    if not isinstance(critical, bool):
        yield Breach("critical", f"is {critical!r}, neither True nor False")
    for name, word in labels.items():
        if not (isinstance(name, str) and isinstance(word, str)):
            yield Breach(f"labels.{name}", f"is {word!r}, which is no text")


def _number(value: Any) -> float | None:
    """A finite number; `None` for anything else, truth values included."""
    if isinstance(value, bool) or not isinstance(value, Real):
        return None
    try:
        number = float(value)
    except OverflowError:  # an integer beyond all floats
        return None
    return number if math.isfinite(number) else None


def _no_number(value: Any) -> str:
    """Why a value is no finite number, in words."""
    if isinstance(value, Decimal):
        return "a Decimal where a float belongs: float(…) makes one"
    return "which is no finite number"


# What it is about, and when ------------------------------------------------------------


def _of_subject(finding: Finding, grounds: Grounds) -> Iterator[Breach]:
    if not finding.subject:
        yield Breach("subject", "is empty")
    # What is not decided may be about something that is looked for in vain, such as a body.
    decided = finding.verdict in (Verdict.SATISFIED, Verdict.VIOLATED)
    if decided and grounds.subjects is not None and finding.subject not in grounds.subjects:
        yield Breach(
            "subject",
            f"is {finding.subject!r}: no body or pair of bodies, item of work or signal of this trial, "
            "nor a word that the check declares in 'also_about'",
        )


def _of_span(finding: Finding, grounds: Grounds) -> Iterator[Breach]:
    span: Any = finding.span
    if span is None:
        return
    if not isinstance(span, Span):
        yield Breach("span", f"is {span!r}, which is no Span")
        return
    ends = [_number(span.start_s), _number(span.end_s)]
    start_s, end_s = ends
    if start_s is None or end_s is None:
        yield Breach("span", f"goes from {span.start_s!r} to {span.end_s!r}, which are no times")
        return
    if start_s > end_s:
        yield Breach("span", f"ends at {end_s:g} s, before it starts at {start_s:g} s")
    yield from _outside("span", (start_s, end_s), grounds)


def _outside(name: str, times_s: Sequence[float], grounds: Grounds) -> Iterator[Breach]:
    watched = grounds.watched
    if watched is None:
        return
    for t_s in times_s:
        # Stamps are rounded where they are shifted, added up or stored.
        tolerance_s = 1e-9 + 1e-11 * abs(t_s)
        if not watched.start_s - tolerance_s <= t_s <= watched.end_s + tolerance_s:
            yield Breach(
                name,
                f"gives the time {t_s:g} s, outside what was watched, "
                f"from {watched.start_s:g} s to {watched.end_s:g} s",
            )


# Its margin ----------------------------------------------------------------------------


def _of_margin(finding: Finding, grounds: Grounds) -> Iterator[Breach]:
    if finding.robustness is None:
        return
    margin = _number(finding.robustness)
    if margin is None:
        yield Breach("robustness", f"is {finding.robustness!r}, {_no_number(finding.robustness)}")
        return
    if not finding.unit:
        yield Breach("unit", f"is empty, but it has a margin of {margin:+g}")
    elif not is_unit(finding.unit, grounds.units):
        yield _unknown("unit", finding.unit, grounds)
    verdict = finding.verdict
    if verdict is Verdict.VIOLATED and margin > 0:
        yield Breach("robustness", f"is {margin:+g}, but a violation has none above 0")
    if verdict is Verdict.SATISFIED and margin < 0 and not grounds.forgives:
        yield Breach(
            "robustness",
            f"is {margin:+g}, but what is satisfied has none below 0, unless the check has a 't_on_s' "
            "above 0: how long a limit must be broken to count",
        )
    if verdict is Verdict.NOT_APPLICABLE:
        yield Breach("robustness", f"is {margin:+g}, but where nothing was judged there is no margin")


def _unknown(name: str, unit: str, grounds: Grounds) -> Breach:
    known = ", ".join(sorted({*UNITS, *grounds.units}))
    return Breach(name, f"is {unit!r}, which is no known unit; products of these are: {known}")


# Its quantities ------------------------------------------------------------------------


def _of_quantities(finding: Finding, grounds: Grounds) -> Iterator[Breach]:
    quantities: Mapping[Any, Any] = finding.quantities
    for name, value in quantities.items():
        place = f"quantities.{name}"
        number = _number(value)
        if not isinstance(name, str):
            yield Breach("quantities", f"have the name {name!r}, which is no text")
            continue
        if number is None:
            yield Breach(place, f"is {value!r}, {_no_number(value)}")
            continue
        measure = None if grounds.measures is None else grounds.measures.get(name)
        if grounds.measures is not None and measure is None:
            yield Breach(place, f"is not declared; {_declared(grounds.measures)}")
        unit = finding.units.get(name, "" if measure is None else measure.unit)
        if measure is not None and unit != measure.unit:
            yield Breach(f"units.{name}", f"is {unit!r}, but the check declares {measure.unit!r}")
        elif unit and not is_unit(unit, grounds.units):
            yield _unknown(f"units.{name}", unit, grounds)
        if number < 0 and _is_unsigned(unit, measure):
            yield Breach(
                place,
                f"is {number:g}{'' if unit in ('', '1') else ' ' + unit}, and it is never negative, "
                "unless its declaration says that it is signed",
            )


def _declared(measures: Mapping[str, Measure]) -> str:
    return (
        f"the check declares {', '.join(sorted(measures))}"
        if measures
        else "the check declares no 'measures'"
    )


def _is_unsigned(unit: str, measure: Measure | None) -> bool:
    if measure is not None and measure.signed is not None:
        return not measure.signed
    return unit in NEVER_NEGATIVE


# Its evidence --------------------------------------------------------------------------


def _of_evidence(finding: Finding, grounds: Grounds) -> Iterator[Breach]:
    evidence: Sequence[Any] = finding.evidence
    for number, sample in enumerate(evidence, start=1):
        place = f"evidence {number}"
        if not isinstance(sample, Sample):
            yield Breach(place, f"is {sample!r}, which is no Sample")
            continue
        t_s = _number(sample.t_s)
        if t_s is None:
            yield Breach(place, f"is of the time {sample.t_s!r}, which is none")
            continue
        yield from _outside(place, (t_s,), grounds)
        yield from _of_sample(place, sample, grounds)


def _of_sample(place: str, sample: Sample, grounds: Grounds) -> Iterator[Breach]:
    if not sample.unit:
        yield Breach(place, f"gives {sample.signal!r} without a unit; 1 is one too")
        return
    if grounds.signals is None:
        return
    recorded = grounds.signals.get(sample.signal)
    quantity = quantity_of(sample.signal)
    if recorded is not None and recorded != sample.unit:
        yield Breach(place, f"gives {sample.signal!r} in {sample.unit!r}, recorded in {recorded!r}")
    # Any other name is a number that the check computed itself, such as a limit.
    if recorded is None and (quantity in QUANTITIES or quantity in grounds.needed):
        yield Breach(place, f"is of {sample.signal!r}, a signal that this trial does not have")
    if recorded is None and not is_unit(sample.unit, grounds.units):
        yield _unknown(place, sample.unit, grounds)


# What a trial offers -------------------------------------------------------------------


def watched_in(trial: Trial) -> Span | None:
    """From the first to the last time that a trial tells of; `None` where it tells of none.

    More than the window in which behaviour counts: work may be announced before the start, logs begin
    earlier and end later, and what a configuration or an official record brings has times of its own.
    """
    spans = [span for span in (trial.recorded, trial.window) if span is not None]
    if trial.recorded is None:  # as in a trial made by hand; else no signal reaches beyond it
        spans += [one.span for one in trial.sampled if one.span is not None]
    times_s = [end for span in spans for end in (span.start_s, span.end_s)]
    times_s += [event.t_s for event in trial.events]
    times_s += [submission.submitted_s for submission in trial.submissions]
    times_s += [t_s for item in trial.work if (t_s := announced_s(item)) is not None]
    return Span(min(times_s), max(times_s)) if times_s else None


_PLACES = frozenset({"trial", "team", "environment"})
_JOINT = re.compile("::.*")


class Subjects(Container[str]):
    """What a finding about a trial may be about.

    The trial, the team; a body (or a link of one) and several of them, `robot/human`; an item of work, by
    its path; a signal; what an event names; a word that the check declares in `also_about`.
    """

    def __init__(self, trial: Trial, own: Collection[str] = ()) -> None:
        self._trial, self._own = trial, own
        self._known: frozenset[str] | None = None

    def __contains__(self, subject: object) -> bool:
        if not isinstance(subject, str) or not subject:
            return False
        known = self._all()
        return subject in known or all(_JOINT.sub("", part) in known for part in subject.split("/"))

    def _all(self) -> frozenset[str]:
        if self._known is None:
            trial = self._trial
            sampled = {one.name for one in trial.sampled}
            names = {*_PLACES, *self._own, *sampled, *(body.id for body in trial.bodies)}
            for signal in sampled:  # bodies that a reader knows by their signals alone
                names |= {_JOINT.sub("", part) for part in subject_of(signal).split("/")}
            for event in trial.events:
                names |= {event.subject, event.detail}
            names |= set(_paths(trial.work, ""))
            self._known = frozenset(names - {""})
        return self._known


def _paths(items: Sequence[WorkItem], within: str) -> Iterator[str]:
    """The path of every item of work."""
    for item in items:
        path = f"{within}{item.id}"
        yield path
        yield from _paths(item.items, f"{path}/")


# Margins at every sample ---------------------------------------------------------------


def margin_breach(
    trial: Trial, needed: Collection[str], findings: Sequence[Finding], charts: Sequence[Chart]
) -> str:
    """Where the margins of a monitor contradict its findings, in words; empty when they fit.

    Args:
        trial: With what the monitor needs.
        needed: The quantities it needs.
        findings: What it found, with the digits of a result.
        charts: Its margins.
    """
    times = [one.t for one in trial.sampled if quantity_of(one.name) in needed]
    recorded = np.unique(np.concatenate(times)) if times else np.zeros(0)
    for chart in charts:
        strange = np.setdiff1d(chart.t, recorded)
        window = trial.window
        if trial.between is not None and window is not None:
            # What is kept at worst in a gap is known there, too, without a sample.
            strange = strange[(strange < window.start_s) | (strange > window.end_s)]
        if len(strange):
            return f"gives a margin of {chart.subject!r} at {strange[0]:g} s, where there is no sample"
    for finding in findings:
        own = [chart for chart in charts if chart.subject == finding.subject]
        if not own or finding.robustness is None or not (finding.span or finding.evidence):
            continue
        # Equal, not close: both come from one judgement, and both have the digits of a result.
        if not any(_least(chart, finding) == finding.robustness for chart in own):
            where = f"{finding.verdict.value} {finding.subject!r} by {finding.robustness:g} {finding.unit}"
            least = ", ".join(f"{_least(chart, finding)} {chart.unit}" for chart in own)
            return f"found {where}, but the least margin it gives there is {least}"
    return ""


def _least(chart: Chart, finding: Finding) -> float | None:
    """The least margin within the span of a finding, or of all; `None` where there is none in its unit."""
    inside = np.isfinite(chart.margin)
    if finding.span is not None:
        inside &= (chart.t >= finding.span.start_s) & (chart.t <= finding.span.end_s)
    if chart.unit != finding.unit or not inside.any():
        return None
    return canonical(float(chart.margin[inside].min()))
