"""Contact between robot and human within limits of force and pressure, after ISO/TS 15066:2016, Annex A."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ariac_score import (
    Event,
    Finding,
    FloatArray,
    Measure,
    SignalNeed,
    Span,
    Trial,
    Verdict,
    exact_sum,
    parameter,
)
from ariac_score.monitors import (
    TOLERANCE_S,
    BoolArray,
    Bound,
    Encounter,
    JudgedLimit,
    LimitMonitor,
    Reach,
    Rows,
    Statement,
    Subject,
    Watched,
    pairs,
    rows_of_episodes,
)
from ariac_score_standards.body_regions import UNKNOWN_REGION, BodyLimits, body_limits, limits_at
from ariac_score_standards.iso_13854 import PART_OF_REGION, clamps, closes
from ariac_score_standards.parameters import GAP, TIME

CONTACT = "contact"
"""Event kind: robot and human (subject `robot/human`) touch; the detail names the body region."""

_FORCE = "contact_force/{robot}/{human}"
_OF_CONTACT = {
    "contacts": Measure("count", best=0.0, meaning="contacts"),
    "force_max_N": Measure("N", best=0.0, meaning="largest force"),
    "force_ratio_max": Measure("1", best=0.0, meaning="largest force as a share of its limit"),
    "pressure_ratio_max": Measure("1", best=0.0, meaning="largest pressure as a share of its limit"),
    "ratio_max": Measure("1", best=0.0, meaning="the larger of both"),
    "contact_s": Measure("s", best=0.0, meaning="how long they touched"),
    "impulse_N_s": Measure("N s", best=0.0, meaning="force, summed over time"),
    "time_in_violation_s": Measure("s", best=0.0, meaning="how long a limit was exceeded"),
    "impulse_above_limit_N_s": Measure("N s", best=0.0, meaning="force, summed over that time"),
    "relative_depth_max": Measure("1", best=0.0, meaning="the most by which, as a share of it, up to 1"),
    "relative_depth_integral_s": Measure("s", best=0.0, meaning="that share, summed over time"),
}
"""What is measured of every contact; all 0 where there is none."""
_GAP_CLOSING = "crush_gap/{robot}/{human}"
_HEIGHT = "contact_height/{robot}/{human}"
_PRESSURE = "contact_pressure/{robot}/{human}"
_AREA = "contact_area/{robot}/{human}"


@dataclass(frozen=True)
class PflContact(LimitMonitor):
    """Contact between robot and human stays within what the body region bears.

    Measures:
        For every contact the force (and, where the log has pressure or area, the
        pressure) against the limit of the body region, sample by sample. For
        `transient_window_s` from the beginning of a contact the transient limit
        holds (`transient_factor` times the other), then, or while the body part is
        clamped (`clamped`, or a closing `crush_gap` too small for it), the quasi-static
        one. Touches less than `t_off_s` apart are one contact. The region comes from the
        parameter `region`, else from the event `contact` of the pair; else the weakest
        region at the height of the contact, or of all, lends its limits. Labels say whether
        the robot moved (`robot_moving`) and who closed in (`closing_by`), or `unknown` where
        the log has no speeds; where it has the distance, `exposure_s` is measured too.
    Violated when:
        Force or pressure exceeds its limit, or skull, forehead or face are known to be
        touched at all. Every violation is a critical event.
    Source:
        ISO/TS 15066:2016, Annex A (Table A.2); ISO 10218-2:2025, Annex M, as public
        sources give them. Not valid for children. The window of 0.5 s is from
        memory (DGUV FB HM-080), threshold and clamping rule are our choice.
    """

    region: str = parameter("", source="body region or area; empty: as the log tells")
    contact_on_n: float = parameter(5.0, unit="N", at_least=0, at_most=1000, source="catalogue, M4")
    transient_window_s: float = parameter(0.5, status="from memory", source="DGUV FB HM-080", **TIME)
    transient_factor: float = parameter(
        2.0, unit="1", at_least=1, at_most=10, status="verified", source="public sources on Table A.2"
    )
    clamped: bool = parameter(False, source="whether the quasi-static limit holds from the beginning")
    max_gap_s: float = parameter(0.05, **GAP)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **TIME)

    subjects = pairs("robot", "human")
    may_be_critical: ClassVar[bool] = True
    by_course: ClassVar[bool] = True
    wanted: ClassVar[Mapping[str, str]] = {_FORCE: "N"}
    optional: ClassVar[Mapping[str, str]] = {
        _PRESSURE: "Pa",
        _AREA: "m2",
        _HEIGHT: "m",
        _GAP_CLOSING: "m",
    }
    what = "part of the limit of contact"
    clause = "derived from ISO/TS 15066:2016, Annex A"
    encounter = Encounter(before=True)
    reach = Reach("run", ahead_s=math.inf)  # the region, and so the limits, may show only after the contact

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.region:
            body_limits(self.region)

    def transient(self, since_contact_s: FloatArray, clamped: BoolArray | bool = False) -> BoolArray:
        """Whether the transient limit holds at a time since the contact began."""
        # Who is clamped cannot recoil, so that no contact of theirs is short.
        short = since_contact_s <= self.transient_window_s + TOLERANCE_S
        result: BoolArray = short & ~np.asarray(clamped, dtype=bool)
        return result

    def limit_n(self, limits: BodyLimits, transient: BoolArray) -> FloatArray:
        """Limit of force in each phase, N."""
        factor = limits.region.transient_factor(self.transient_factor)
        return np.where(transient, factor * limits.force_n, limits.force_n)

    def limit_pa(self, limits: BodyLimits, transient: BoolArray) -> FloatArray:
        """Limit of pressure in each phase, Pa."""
        factor = limits.region.transient_factor(self.transient_factor)
        return np.where(transient, factor * limits.pressure_pa, limits.pressure_pa)

    @property
    def measures(self) -> Mapping[str, Measure]:
        """Those of contacts."""
        return {**_OF_CONTACT, **self.encounter.measures}

    @property
    def may_hide(self) -> tuple[dict[str, float]]:
        """A touch, with which two contacts are one."""
        return ({_FORCE: math.nextafter(self.contact_on_n, math.inf)},)

    def needs(self) -> Iterator[SignalNeed]:
        """The force; whatever else helps is optional."""
        yield from super().needs()
        yield SignalNeed("clamped", "1", self.max_gap_s, optional=True)

    def statements(self, trial: Trial) -> Iterator[Statement]:
        """For every pair each contact, or that there was none."""
        subjects = self.subjects.of(trial.bodies)
        forceless = [s for s in subjects if s.fill(_FORCE) not in {one.name for one in trial.sampled}]
        for subject in forceless:
            yield self._without_force(trial, subject)
        measured = [s for s in subjects if s not in forceless]
        if measured or not subjects:
            yield from self.judged(trial, measured, self.wanted)

    def _without_force(self, trial: Trial, subject: Subject) -> Finding:
        touched = _contact_events(trial, subject)
        name = subject.fill(_FORCE)
        if touched:
            message = f"contact at {touched[0].t_s:.3f} s without a force: signal {name!r} is not in the log"
            return Finding.inconclusive(subject.name, message, span=trial.window, clause=self.clause)
        if CONTACT in trial.witnessed and name not in trial.stand_ins:
            return Finding.satisfied(subject.name, "the log records no contact", clause=self.clause)
        message = f"signal {name!r} is not in the log"
        return Finding.inconclusive(subject.name, message, span=trial.window, clause=self.clause)

    def about(self, signals: Watched) -> Iterator[Statement]:
        """Each contact, or that there was none."""
        contacts, watched = self._contacts(signals), signals
        limit = JudgedLimit(watched, self._bound(watched, contacts))
        yield limit
        exposure = self.encounter.exposure(watched)
        for contact in contacts:
            finding = self._finding(watched, contact, exposure)
            yield finding
            if finding.verdict is Verdict.VIOLATED:
                yield from self._hidden_beside(watched, contact)
        if not contacts and not watched.gaps:
            strongest = int(np.argmax(limit.bound.actual))
            yield Finding(
                limit.subject,
                Verdict.SATISFIED,
                f"no contact: never more than {limit.bound.actual[strongest]:.3f} N",
                robustness=float(limit.bound.margin[strongest]),
                unit="N",
                quantities={**dict.fromkeys(_OF_CONTACT, 0.0), **exposure},
                evidence=watched.samples(strongest),
                clause=self.clause,
            )

    def _bound(self, watched: Watched, contacts: Sequence[_Contact]) -> Bound:
        """The share of its limit that each contact reaches; without any, the force against the threshold."""
        force = watched[_FORCE]
        if not contacts:
            return self.at_most(force, self.contact_on_n, what="contact force", unit="N")
        ratio = np.zeros(len(force))
        for contact in contacts:
            if contact.pressed is not None:
                # Where the pressure is hidden, only a force beyond its limit is known to decide.
                decided = ~contact.pressed.hidden | (contact.pressed.of_force > 1.0)
                ratio[contact.rows] = np.where(decided, contact.pressed.ratio, 0.0)
        return self.at_most(ratio, 1.0, where=ratio > 0)

    def _contacts(self, watched: Watched) -> list[_Contact]:
        """The contacts, each against the limits of its region, where the log names one that is known."""
        found = []
        touching = watched[_FORCE] > self.contact_on_n
        for span, rows in rows_of_episodes(watched, touching, t_off_s=self.t_off_s):
            try:
                limits, known, hardest = self._limits(watched, rows)
            except ValueError as unknown:
                found.append(_Contact(span, rows, None, unknown=str(unknown)))
                continue
            clamped, may_be = self._clamped(watched, rows, limits)
            pressed = self._pressed(watched, rows, limits, clamped)
            hidden = may_be & ~clamped | (hardest is not limits)
            at_worst = self._pressed(watched, rows, hardest, clamped | may_be) if hidden.any() else None
            found.append(_Contact(span, rows, pressed, known=known, at_worst=at_worst))
        return found

    def _limits(self, watched: Watched, rows: Rows) -> tuple[BodyLimits, bool, BodyLimits]:
        """The limits of a contact, whether its region is known, and the limits that it may have had."""
        if self.region:
            limits = body_limits(self.region)
            return limits, True, limits
        # The event may be stamped before the force passes its threshold.
        start_s, end_s = watched.t[rows[0]] - self.t_off_s, watched.t[rows[-1]] + self.max_gap_s
        events = _contact_events(watched.trial, watched.subject)
        named = [e.detail for e in events if start_s <= e.t_s <= end_s and e.detail]
        if named:  # of several, the weakest: which force met which region is not recorded
            limits = min((body_limits(name) for name in named), key=lambda limits: limits.force_n)
            return limits, True, limits
        heights = watched.get(_HEIGHT)
        shown = np.zeros(0) if heights is None else heights[rows][np.isfinite(heights[rows])]
        unknown = body_limits(UNKNOWN_REGION)
        if not len(shown):
            return unknown, False, unknown
        limits = min((limits_at(float(h)) for h in shown), key=lambda limits: limits.force_n)
        return limits, False, limits if len(shown) == len(rows) else unknown

    def _pressed(self, watched: Watched, rows: Rows, limits: BodyLimits, clamped: BoolArray) -> _Pressed:
        """Force and pressure of a contact against their limits."""
        transient = self.transient(watched.t[rows] - watched.t[rows[0]], clamped)
        force, pressure = watched[_FORCE][rows], _pressure(watched, rows)
        of_force = force / self.limit_n(limits, transient)
        of_pressure = np.nan_to_num(pressure, nan=0.0) / self.limit_pa(limits, transient)
        measured = bool(np.isfinite(pressure).any())
        hidden = _pressure_hidden(watched, rows, pressure)
        return _Pressed(limits, force, of_force, of_pressure, transient, measured, hidden)

    def _finding(self, watched: Watched, contact: _Contact, exposure: Mapping[str, float]) -> Finding:
        subject, pressed, span = watched.subject.name, contact.pressed, contact.span
        if pressed is None:
            message = f"contact at {span.start_s:.3f} s: {contact.unknown}"
            return Finding.inconclusive(subject, message, span=span, clause=self.clause)
        limits, worst, rows = pressed.limits, pressed.worst, contact.rows
        ratio = float(pressed.ratio[worst])
        # Only where the region is known: the face that stands in for an unknown one was not touched for sure.
        forbidden = contact.known and not limits.region.contact_permitted
        violated = ratio > 1.0 or forbidden
        where = limits.region.title.lower() if contact.known else f"a region unknown, taken for {limits.name}"
        phase = "transient" if pressed.transient[worst] else "quasi-static"
        message = f"contact with {where}: {pressed.force_n[worst]:.1f} N, {ratio:.3f} of the {phase} limit"
        if contact.at_worst is not None and contact.at_worst.ratio.max() > 1.0 and not violated:
            message += "; whether somebody was clamped, or where, is recorded, but not at every moment of it"
            return Finding.inconclusive(subject, message, span=span, clause=self.clause)
        if violated and not contact.known and _is_hidden_everywhere(watched, rows):
            message += "; heights of contacts are recorded, but none of this one"
            return Finding.inconclusive(subject, message, span=span, clause=self.clause)
        if pressed.hidden.any() and not violated:
            hidden_s = float(watched.t[rows[np.argmax(pressed.hidden)]])
            message += f"; the pressure is recorded, but not from {hidden_s:.3f} s on"
            return Finding.inconclusive(subject, message, span=span, clause=self.clause)
        labels = {"region": limits.name, "region_known": "yes" if contact.known else "no", "phase": phase}
        return Finding(
            subject,
            Verdict.VIOLATED if violated else Verdict.SATISFIED,
            f"{message}; contact there is not permissible" if forbidden else message,
            span=span,
            robustness=None if forbidden else 1.0 - ratio,
            unit="" if forbidden else "1",
            quantities={**exposure, **pressed.quantities(watched.durations_s[rows])},
            labels={**labels, **self.encounter.labels(watched, rows)},
            evidence=watched.samples(int(rows[worst])),
            clause=self.clause,
            critical=violated,
        )

    def _hidden_beside(self, watched: Watched, contact: _Contact) -> Iterator[Finding]:
        """Where a contact that is a violation may have been a worse one, by what the log does not show."""
        pressed, at_worst = contact.pressed, contact.at_worst
        if pressed is None:
            return
        worse = pressed.hidden & (pressed.depth < 1.0)
        if at_worst is not None:
            worse |= at_worst.depth > pressed.depth
        lacks = np.zeros(len(watched), dtype=bool)
        lacks[contact.rows[worse]] = True
        for span, _ in rows_of_episodes(watched, lacks, t_off_s=0.0):
            message = f"contact at {contact.span.start_s:.3f} s: what bears on its limit is recorded, "
            message += f"but not at {span.start_s:.3f} s"
            yield Finding.inconclusive(watched.subject.name, message, span=span, clause=self.clause)

    def _clamped(self, watched: Watched, rows: Rows, limits: BodyLimits) -> tuple[BoolArray, BoolArray]:
        """Where the body part cannot get away: by the parameter, the log's flag, or the gap it is in.

        Then where it may be so, because the log has the flag or the gap, and does not show it there.
        """
        clamped: BoolArray = np.full(len(rows), self.clamped)
        may_be = np.zeros(len(rows), dtype=bool)
        held = watched.state("clamped", self.max_gap_s)
        if held is not None:
            clamped |= held.on[rows]
            may_be |= ~held.known[rows]
        gap = watched.get(_GAP_CLOSING)
        if gap is not None:
            clamped |= clamps(PART_OF_REGION[limits.region.name], gap, closes(gap))[rows]
            lacks = watched.lacks(_GAP_CLOSING, np.ones(len(watched), dtype=bool))
            # Whether it closes shows at the samples before and after.
            beside = lacks.copy()
            beside[1:] |= lacks[:-1]
            beside[:-1] |= lacks[1:]
            may_be |= beside[rows]
        return clamped, may_be


@dataclass(frozen=True, eq=False)
class _Contact:
    """A contact.

    Attributes:
        span: From its first sample to the end of its last one.
        rows: Its samples.
        pressed: The contact against its limits; `None`: they are not known.
        known: Whether the region is known.
        unknown: Why there are no limits.
        at_worst: The same with what the log has and does not show then as bad as it may have been; `None`: it
            shows all.
    """

    span: Span
    rows: Rows
    pressed: _Pressed | None
    known: bool = False
    unknown: str = ""
    at_worst: _Pressed | None = None


@dataclass(frozen=True, eq=False)
class _Pressed:
    """A contact against its limits, sample by sample.

    Attributes:
        limits: What the region bears.
        force_n: Shape (n,), N.
        of_force: Force as a share of its limit.
        of_pressure: Pressure as a share of its limit; 0 where it is not known.
        transient: Whether the transient limits hold.
        measured: Whether a pressure is known at any sample.
        hidden: Where a gap hides the pressure, which the log has otherwise.
    """

    limits: BodyLimits
    force_n: FloatArray
    of_force: FloatArray
    of_pressure: FloatArray
    transient: BoolArray
    measured: bool
    hidden: BoolArray

    @property
    def ratio(self) -> FloatArray:
        """The larger share of both."""
        return np.maximum(self.of_force, self.of_pressure)

    @property
    def depth(self) -> FloatArray:
        """By how much the share is above 1, up to 1."""
        return np.clip(self.ratio - 1.0, 0.0, 1.0)

    @property
    def worst(self) -> int:
        """The sample that reaches the largest share of its limit."""
        return int(np.argmax(self.ratio))

    def quantities(self, weight_s: FloatArray) -> dict[str, float]:
        """The quantities of the contact, given how long each sample stands for."""
        ratio, impulse_n_s = self.ratio, self.force_n * weight_s
        above, relative = ratio > 1.0, self.depth
        of_pressure = {"pressure_ratio_max": float(self.of_pressure.max())}
        return {
            "contacts": 1.0,
            "force_max_N": float(self.force_n.max()),
            "force_ratio_max": float(self.of_force.max()),
            "ratio_max": float(ratio.max()),
            "contact_s": exact_sum(weight_s),
            "impulse_N_s": exact_sum(impulse_n_s),
            "time_in_violation_s": exact_sum(weight_s[above]),
            "impulse_above_limit_N_s": exact_sum(impulse_n_s[above]),
            "relative_depth_max": float(relative.max()),
            "relative_depth_integral_s": exact_sum(relative * weight_s),
            **(of_pressure if self.measured else {}),
        }


def _contact_events(trial: Trial, subject: Subject) -> Sequence[Event]:
    return [event for event in trial.events_of(CONTACT) if event.subject == subject.name]


def _is_hidden_everywhere(watched: Watched, rows: Rows) -> bool:
    """Whether the log has heights of contacts, and a gap hides those of one: it may have been any region."""
    heights = watched.get(_HEIGHT)
    due = np.zeros(len(watched), dtype=bool)
    due[rows] = True
    return (
        heights is not None
        and bool(np.isnan(heights[rows]).all())
        and bool(watched.lacks(_HEIGHT, due).any())
    )


def _pressure(watched: Watched, rows: Rows) -> FloatArray:
    """Pressure as recorded, else force over area; NaN where neither is known."""
    recorded, area = watched.get(_PRESSURE), watched.get(_AREA)
    pressure = np.full(len(rows), np.nan)
    if recorded is not None:
        pressure = recorded[rows].copy()
    if area is not None:
        of_area = np.full(len(rows), np.nan)
        np.divide(watched[_FORCE][rows], area[rows], out=of_area, where=area[rows] > 0)
        pressure = np.where(np.isfinite(pressure), pressure, of_area)
    return pressure


def _pressure_hidden(watched: Watched, rows: Rows, pressure: FloatArray) -> BoolArray:
    """Where gaps hide the pressure of a contact; nowhere, if the log has neither pressure nor area at all.

    Where the pressure is recorded, force over area is no more than its mean, and settles nothing.
    """
    t, hidden = watched.t[rows], np.zeros(len(rows), dtype=bool)
    # Of the contact alone: a sensor may well be silent until something touches it.
    touched = Span(float(t[0]), float(t[-1] + watched.durations_s[rows[-1]]))
    recorded = watched.get(_PRESSURE)
    unknown = {
        _PRESSURE: np.isnan(pressure if recorded is None else recorded[rows]),
        _AREA: np.isnan(pressure),
    }
    for template, lacks in unknown.items():
        due = np.zeros(len(watched), dtype=bool)
        due[rows[lacks]] = True
        for gap in watched.hidden_by_gaps(template, due, touched):
            hidden |= lacks & (t >= gap.start_s) & (t <= gap.end_s)
    return hidden
