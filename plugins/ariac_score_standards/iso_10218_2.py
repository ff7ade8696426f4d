"""Robots beside people, after ISO 10218-2:2025 (Annexes L and M) and ISO/TS 15066:2016.

Contact within limits of force and pressure, speed that keeps a contact within them,
standing still while a person is in the workspace, hand guiding.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, Literal

import numpy as np

from ariac_score import (
    Episodes,
    Event,
    Finding,
    Sample,
    SignalNeed,
    Span,
    Total,
    Trial,
    Verdict,
    check_parameters,
    parameter,
)
from ariac_score_standards.body_regions import UNKNOWN_REGION, BodyLimits, body_limits, limits_at
from ariac_score_standards.geometry import check_polygon, inside
from ariac_score_standards.iso_13854 import PART_OF_REGION, clamps, closes
from ariac_score_standards.iso_ts_15066 import RunStarts
from ariac_score_standards.severity import (
    MEETING,
    SPEED,
    STANDSTILL_SPEED_M_S,
    Blame,
    Bound,
    Exposure,
    Gathered,
    Judged,
    Judging,
    Marks,
    Meeting,
    Moment,
    Rules,
    Said,
    Sampled,
    Seen,
    Several,
    Told,
    broken,
    exposure_of,
    findings_of,
    kept,
    meeting_needs,
    no_severities,
    ways_m,
)
from ariac_score_standards.watching import (
    BoolArray,
    FloatArray,
    State,
    Subject,
    Watched,
    Watching,
    bodies_of,
    pairs_of,
    state_over,
    watch_subjects,
)

CONTACT = "contact"
"""Event kind: robot and human (subject `robot/human`) touch; the detail names the body region."""

_TIME: Any = {"unit": "s", "at_least": 0, "at_most": 60}
_GAP: Any = {"unit": "s", "above": 0, "at_most": 60, "source": "catalogue, 1.4"}
_SPEED: Any = {"unit": "m/s", "at_least": 0, "at_most": 20}
_LENGTH: Any = {"unit": "m", "at_least": 0, "at_most": 100}
_TOLERANCE_S = 1e-9
"""Times are sums of decimals in float64; a time that is up is up in spite of the last bit."""


# Power and force limiting: formulas -----------------------------------------------------------


def effective_robot_mass_kg(moving_mass_kg: float, load_kg: float) -> float:
    """m_R = M / 2 + m_L of an arm: half of its moving parts, and tool with workpiece, kg."""
    return moving_mass_kg / 2.0 + load_kg


def reduced_mass_kg(body_mass_kg: float, robot_mass_kg: float) -> float:
    """mu = 1 / (1 / m_H + 1 / m_R), kg."""
    return 1.0 / (1.0 / body_mass_kg + 1.0 / robot_mass_kg)


def contact_energy_j(reduced_kg: float, relative_m_s: float) -> float:
    """E = mu v^2 / 2, J."""
    return 0.5 * reduced_kg * relative_m_s * relative_m_s


def energy_limit_j(force_n: float, stiffness_n_m: float) -> float:
    """E = F^2 / 2k, J.

    >>> energy_limit_j(280.0, 25000.0)
    1.568
    """
    return force_n * force_n / (2.0 * stiffness_n_m)


def impact_force_n(relative_m_s: float, reduced_kg: float, stiffness_n_m: float) -> float:
    """F = v sqrt(mu k) of a free impact, N."""
    return float(relative_m_s * np.sqrt(reduced_kg * stiffness_n_m))


def permitted_speed_m_s(force_n: float, reduced_kg: float, stiffness_n_m: float) -> float:
    """v = F / sqrt(mu k), with k in N/m (1000 times the number in N/mm), m/s."""
    return float(force_n / np.sqrt(reduced_kg * stiffness_n_m))


@dataclass(frozen=True)
class Permitted:
    """What a contact of robot and body region may be.

    Attributes:
        reduced_kg: mu, kg.
        force_n: The smaller of the limits of force and of pressure on the area, N.
        speed_m_s: Largest relative speed, m/s.
        energy_j: Largest energy, J.
    """

    reduced_kg: float
    force_n: float
    speed_m_s: float
    energy_j: float


def permitted_contact(
    limits: BodyLimits, robot_mass_kg: float, *, factor: float, contact_area_m2: float | None
) -> Permitted:
    """The limits for one region and one robot.

    Args:
        limits: Of the region.
        robot_mass_kg: m_R.
        factor: 1 for quasi-static contact, the transient factor for a short one.
        contact_area_m2: The smaller of robot's and body's; `None` leaves the pressure out.
    """
    region = limits.region
    reduced = reduced_mass_kg(region.mass_kg, robot_mass_kg)
    force = factor * region.force_n
    if contact_area_m2 is not None:
        force = min(force, factor * limits.pressure_pa * contact_area_m2)
    speed = permitted_speed_m_s(force, reduced, region.stiffness_n_m)
    return Permitted(reduced, force, speed, energy_limit_j(force, region.stiffness_n_m))


# Contact --------------------------------------------------------------------------------------

_FORCE = "contact_force/{robot}/{human}"
_CONTACT_QUANTITIES = (
    "contacts",
    "force_max_N",
    "force_ratio_max",
    "pressure_ratio_max",
    "ratio_max",
    "contact_s",
    "impulse_N_s",
    "time_in_violation_s",
    "impulse_above_limit_N_s",
    "relative_depth_max",
    "relative_depth_integral_s",
)
"""What is measured of every contact; all 0 where there is none."""
_HELD_SAMPLES = 4096
"""A contact no longer than this is gone through once."""
_GAP_CLOSING = "crush_gap/{robot}/{human}"
_HEIGHT = "contact_height/{robot}/{human}"
_HELPFUL = {
    "contact_pressure/{robot}/{human}": "Pa",
    "contact_area/{robot}/{human}": "m2",
    _HEIGHT: "m",
    _GAP_CLOSING: "m",
    **MEETING,
}


@dataclass(frozen=True)
class PflContact(Sampled):
    """Contact between robot and human stays within what the body region bears.

    Measures:
        For every contact the force (and, where the log has pressure or area, the
        pressure) against the limit of the body region, sample by sample. For
        `transient_window_s` from the beginning of a contact the transient limit
        holds (`transient_factor` times the other), then, or while the body part is
        clamped (`clamped`, or a closing `crush_gap` too small for it), the quasi-static
        one. Touches less than `t_off_s` apart are one contact. The region comes from the
        parameter `region`, else from the event `contact` of the pair; else the weakest
        region at the height of the contact, or of all, lends its limits. Where the log
        has the speeds it is told whether the robot moved (`robot_moving`) and who closed
        in (`closing_by`), else they are unknown; where it has the distance, `exposure_s`.
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
    transient_window_s: float = parameter(0.5, status="from memory", source="DGUV FB HM-080", **_TIME)
    transient_factor: float = parameter(
        2.0, unit="1", at_least=1, at_most=10, status="verified", source="public sources on Table A.2"
    )
    clamped: bool = parameter(False, source="whether the quasi-static limit holds from the beginning")
    max_gap_s: float = parameter(0.05, **_GAP)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **_TIME)

    _clause = "derived from ISO/TS 15066:2016, Annex A"

    def __post_init__(self) -> None:
        check_parameters(self)
        if self.region:
            body_limits(self.region)

    def transient(self, since_contact_s: FloatArray, clamped: BoolArray | bool = False) -> BoolArray:
        """Whether the transient limit holds at a time since the contact began."""
        short = since_contact_s <= self.transient_window_s + _TOLERANCE_S
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

    def needs(self) -> Iterator[SignalNeed]:
        """The force; what else helps is used where it is there."""
        yield SignalNeed("contact_force", "N", self.max_gap_s)
        for template, unit in {**_HELPFUL, "clamped/": "1"}.items():
            yield SignalNeed(template.partition("/")[0], unit, self.max_gap_s, optional=True)

    def _say(self, trial: Trial) -> Iterator[Said]:
        """For every pair each contact, or that there was none."""
        subjects = pairs_of(trial)
        forceless = [s for s in subjects if s.fill(_FORCE) not in trial.signals]
        for subject in forceless:
            yield self._without_force(trial, subject)
        measured = [s for s in subjects if s not in forceless]
        if measured or not subjects:
            yield from watch_subjects(
                trial,
                measured,
                {_FORCE: "N"},
                max_gap_s=self.max_gap_s,
                clause=self._clause,
                judge=lambda subject, watched: self._judge(trial, subject, watched),
                optional=_HELPFUL,
                kinds=("robot", "human"),
            )

    def _without_force(self, trial: Trial, subject: Subject) -> Finding:
        touched = _contacts(trial, subject)
        name = subject.fill(_FORCE)
        if touched:
            message = f"contact at {touched[0].t_s:.3f} s without a force: signal {name!r} is not in the log"
            return Finding.inconclusive(subject.name, message, span=trial.window, clause=self._clause)
        if CONTACT in trial.witnessed:
            return Finding.satisfied(subject.name, "the log records no contact", clause=self._clause)
        message = f"signal {name!r} is not in the log"
        return Finding.inconclusive(subject.name, message, span=trial.window, clause=self._clause)

    def _judge(self, trial: Trial, subject: Subject, watched: Watching) -> Iterator[Said]:
        touching, exposed = Episodes(t_off_s=self.t_off_s, longest_s=watched.max_gap_s), Exposure()
        strongest: Moment | None = None
        for window in watched:
            bound = self._touch(window)
            touching.take(window.t, bound.actual > self.contact_on_n)
            row = int(np.argmax(bound.actual))
            if strongest is None or bound.actual[row] > strongest.actual:
                strongest = Moment.of(window, bound, row, subject.name)
            exposed.take(window)
        contacts = [
            self._contact(trial, subject, watched, one.span, one.samples, one.last_s)
            for one in touching.end()
        ]
        part = partial(self._part_of_limit, trial, subject, contacts) if contacts else self._touch
        yield Seen(subject.name, watched, partial(_same, part))
        exposure = exposed.of(watched)
        for contact in contacts:
            yield self._said(trial, subject, watched, contact, exposure)
        if strongest is not None and not contacts and not watched.gaps:
            yield Finding(
                subject.name,
                Verdict.SATISFIED,
                f"no contact: never more than {strongest.actual:.3f} N",
                robustness=strongest.margin,
                unit="N",
                quantities={**dict.fromkeys(_CONTACT_QUANTITIES, 0.0), **exposure},
                evidence=strongest.evidence,
                clause=self._clause,
            )

    def _touch(self, window: Watched) -> Bound:
        """The force against that above which it is a contact."""
        force = window[_FORCE]
        return Bound("contact force", force, np.full_like(force, self.contact_on_n), "N", True)

    def _part_of_limit(
        self, trial: Trial, subject: Subject, contacts: Sequence[_Contact], window: Watched
    ) -> Bound:
        """Which part of its limit each contact reaches."""
        ratio = np.zeros(len(window.t))
        for contact in contacts:
            if contact.limits is not None and contact.overlaps(window):
                pressed = self._pressed(trial, subject, window, contact, contact.limits)
                ratio[pressed.rows] = pressed.ratio
        what = "part of the limit of contact"
        return Bound(what, ratio, np.ones_like(ratio), "1", True, ratio > 0)

    def _contact(
        self, trial: Trial, subject: Subject, watched: Watching, span: Span, samples: int, last_s: float
    ) -> _Contact:
        """A contact, and the limits of the region it is on, if they can be told."""
        try:
            limits, known = self._limits(trial, subject, watched, span, last_s)
        except ValueError as unknown:
            return _Contact(span, samples, last_s, None, unknown=str(unknown))
        return _Contact(span, samples, last_s, limits, known=known)

    def _limits(
        self, trial: Trial, subject: Subject, watched: Watching, span: Span, last_s: float
    ) -> tuple[BodyLimits, bool]:
        """The limits of a contact, and whether its region is known."""
        if self.region:
            return body_limits(self.region), True
        start_s, end_s = span.start_s - self.t_off_s, last_s + watched.max_gap_s
        events = _contacts(trial, subject)
        named = [e.detail for e in events if start_s <= e.t_s <= end_s and e.detail]
        if named:
            return min((body_limits(name) for name in named), key=lambda limits: limits.force_n), True
        return self._by_height(watched, span, last_s) or body_limits(UNKNOWN_REGION), False

    def _by_height(self, watched: Watching, span: Span, last_s: float) -> BodyLimits | None:
        """The weakest limits at the heights of a contact, where the log tells all of them."""
        weakest: BodyLimits | None = None
        for window in watched.between(span.start_s, last_s) if watched.has(_HEIGHT) else ():
            rows = self._rows(window, span)
            heights = window.extra[_HEIGHT][rows]
            if not np.isfinite(heights).all():
                return None
            here = [limits_at(float(height)) for height in heights]
            weakest = min(here if weakest is None else [weakest, *here], key=lambda limits: limits.force_n)
        return weakest

    def _rows(self, window: Watched, span: Span) -> Any:
        """The rows of a contact in a window."""
        part = slice(
            int(window.t.searchsorted(span.start_s)), int(window.t.searchsorted(span.end_s, side="right"))
        )
        return part.start + np.flatnonzero(window[_FORCE][part] > self.contact_on_n)

    def _pressed(
        self, trial: Trial, subject: Subject, window: Watched, contact: _Contact, limits: BodyLimits
    ) -> _Pressed:
        """What a contact bears down with in a window, against its limits."""
        rows = self._rows(window, contact.span)
        clamped = self._clamped(trial, subject, window, rows, limits)
        transient = self.transient(window.t[rows] - contact.span.start_s, clamped)
        force, limit = window[_FORCE][rows], self.limit_n(limits, transient)
        pressure = _pressure(window, rows)
        of_pressure, of_force = np.zeros(len(rows)), force / limit
        if not np.isnan(pressure).all():
            of_pressure = np.nan_to_num(pressure, nan=0.0) / self.limit_pa(limits, transient)
        ratio = np.maximum(of_force, of_pressure)
        measured = bool(np.isfinite(pressure).any())
        return _Pressed(rows, force, of_force, of_pressure, ratio, transient, measured)

    def _said(
        self,
        trial: Trial,
        subject: Subject,
        watched: Watching,
        contact: _Contact,
        exposure: Mapping[str, float],
    ) -> Finding:
        """The finding about one contact."""
        limits, known, span = contact.limits, contact.known, contact.span
        if limits is None:
            message = f"contact at {span.start_s:.3f} s: {contact.unknown}"
            return Finding.inconclusive(subject.name, message, span=span, clause=self._clause)

        def windows() -> Iterator[tuple[Watched, _Pressed]]:
            for window in watched.between(span.start_s, contact.last_s):
                yield window, self._pressed(trial, subject, window, contact, limits)

        rows = watched.rows_before(contact.last_s) - watched.rows_before(span.start_s)
        short = list(windows()) if rows <= _HELD_SAMPLES else None
        felt = _Felt(contact.samples)
        for window, pressed in short or windows():
            felt.take(window, pressed)
        beyond = _Beyond(felt.above)
        for window, pressed in (short or windows()) if felt.above else ():
            beyond.take(window, pressed)
        forbidden = known and not limits.region.contact_permitted
        violated = felt.above > 0 or forbidden
        where = limits.region.title.lower() if known else f"a region unknown, taken for {limits.name}"
        phase = "transient" if felt.transient else "quasi-static"
        message = f"contact with {where}: {felt.force_n:.1f} N, {felt.ratio:.3f} of the {phase} limit"
        labels = {"region": limits.name, "region_known": "yes" if known else "no", "phase": phase}
        return Finding(
            subject.name,
            Verdict.VIOLATED if violated else Verdict.SATISFIED,
            f"{message}; contact there is not permissible" if forbidden else message,
            span=span,
            robustness=None if forbidden else 1.0 - felt.ratio,
            unit="" if forbidden else "1",
            quantities={**exposure, **felt.quantities(beyond)},
            labels={**labels, **felt.blame.told().labels},
            evidence=felt.evidence,
            clause=self._clause,
            critical=violated,
        )

    def _clamped(
        self, trial: Trial, subject: Subject, window: Watched, rows: Any, limits: BodyLimits
    ) -> BoolArray:
        """Where the body part cannot get away: as given, as recorded, or by the gap it is in."""
        clamped: BoolArray = np.full(len(rows), self.clamped)
        held = state_over(trial, "clamped", subject.name, window.t[rows], max_age_s=window.max_gap_s)
        if held is not None:
            clamped |= held.on
        gap = window.extra.get(_GAP_CLOSING)
        if gap is not None:
            closing = closes(_with_neighbours(window, gap))[window.previous is not None :][rows]
            clamped |= clamps(PART_OF_REGION[limits.region.name], gap[rows], closing)
        return clamped


def _with_neighbours(window: Watched, gap: FloatArray) -> FloatArray:
    """A gap in a window, with the sample before and that after, where there are any."""
    before = [] if window.previous is None else [window.previous.extra[_GAP_CLOSING][-1:]]
    after = [] if window.following is None else [window.following.extra[_GAP_CLOSING][:1]]
    return np.concatenate([*before, gap, *after]) if before or after else gap


@dataclass(frozen=True)
class _Contact:
    """A contact.

    Attributes:
        span: From its first sample to the end of its last one.
        samples: How many there are.
        last_s: Time of the last one, s.
        limits: What the region bears; `None`: it cannot be told.
        known: Whether the region is known.
        unknown: Why there are no limits.
    """

    span: Span
    samples: int
    last_s: float
    limits: BodyLimits | None
    known: bool = False
    unknown: str = ""

    def overlaps(self, window: Watched) -> bool:
        """Whether it has a sample in a window, or goes on past it."""
        return bool(self.span.start_s <= window.t[-1] and self.last_s >= window.t[0])


@dataclass(frozen=True, eq=False)
class _Pressed:
    """A contact in a window, sample by sample.

    Attributes:
        rows: Its rows in the window, shape (n,).
        force_n: N.
        of_force: Part of the limit of force.
        of_pressure: Part of the limit of pressure; 0 where it is not known.
        ratio: The larger of both.
        transient: Whether the transient limits hold.
        measured: Whether a pressure is known at any sample.
    """

    rows: Any
    force_n: FloatArray
    of_force: FloatArray
    of_pressure: FloatArray
    ratio: FloatArray
    transient: BoolArray
    measured: bool


class _Felt:
    """What a contact was like, as its windows come."""

    def __init__(self, samples: int) -> None:
        self.above, self.blame = 0, Blame(Meeting.of, before=True)
        self.ratio, self.force_n, self.transient = -np.inf, 0.0, False
        self.evidence: tuple[Sample, ...] = ()
        self._largest = {"force_max_N": -np.inf, "force_ratio_max": -np.inf, "pressure_ratio_max": -np.inf}
        self._relative, self._measured = 0.0, False
        self._lasted_s, self._impulse_n_s, self._relative_s = Total(samples), Total(samples), Total(samples)

    def take(self, window: Watched, pressed: _Pressed) -> None:
        """The next window of it."""
        if not len(pressed.rows):
            return
        self.blame.look(window, pressed.rows)
        weight_s, ratio = window.durations_s[pressed.rows], pressed.ratio
        relative = np.clip(np.maximum(ratio - 1.0, 0.0), 0.0, 1.0)
        self._lasted_s.take(weight_s)
        self._impulse_n_s.take(pressed.force_n * weight_s)
        self._relative_s.take(relative * weight_s)
        self._relative = max(self._relative, float(relative.max()))
        self._measured = self._measured or pressed.measured
        self.above += int(np.count_nonzero(ratio > 1.0))
        columns = pressed.force_n, pressed.of_force, pressed.of_pressure
        for name, column in zip(self._largest, columns, strict=True):
            self._largest[name] = max(self._largest[name], float(column.max()))
        worst = int(np.argmax(ratio))
        if ratio[worst] > self.ratio:
            self.ratio, self.force_n = float(ratio[worst]), float(pressed.force_n[worst])
            self.transient = bool(pressed.transient[worst])
            self.evidence = window.samples(int(pressed.rows[worst]))

    def quantities(self, beyond: _Beyond) -> dict[str, float]:
        """What is told of it."""
        largest = dict(self._largest)
        of_pressure = {"pressure_ratio_max": largest.pop("pressure_ratio_max")}
        return {
            "contacts": 1.0,
            **largest,
            "ratio_max": self.ratio,
            "contact_s": self._lasted_s.value,
            "impulse_N_s": self._impulse_n_s.value,
            "time_in_violation_s": beyond.lasted_s.value,
            "impulse_above_limit_N_s": beyond.impulse_n_s.value,
            "relative_depth_max": self._relative,
            "relative_depth_integral_s": self._relative_s.value,
            **(of_pressure if self._measured else {}),
        }


class _Beyond:
    """What of a contact was beyond its limit: how long, and which impulse."""

    def __init__(self, samples: int) -> None:
        self.lasted_s, self.impulse_n_s = Total(samples), Total(samples)

    def take(self, window: Watched, pressed: _Pressed) -> None:
        """The next window of the contact."""
        above = pressed.ratio > 1.0
        weight_s = window.durations_s[pressed.rows]
        self.lasted_s.take(weight_s[above])
        self.impulse_n_s.take((pressed.force_n * weight_s)[above])


def _contacts(trial: Trial, subject: Subject) -> Sequence[Event]:
    return [event for event in trial.events_of(CONTACT) if event.subject == subject.name]


def _pressure(watched: Watched, rows: Any) -> FloatArray:
    """Pressure as recorded, else force over area; NaN where neither is known."""
    recorded = watched.extra.get("contact_pressure/{robot}/{human}")
    area = watched.extra.get("contact_area/{robot}/{human}")
    pressure = np.full(len(rows), np.nan)
    if recorded is not None:
        pressure = recorded[rows].copy()
    if area is not None:
        of_area = np.full(len(rows), np.nan)
        np.divide(watched[_FORCE][rows], area[rows], out=of_area, where=area[rows] > 0)
        pressure = np.where(np.isfinite(pressure), pressure, of_area)
    return pressure


# Speed ----------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PflSpeed(Sampled):
    """The robot meets a human no faster than the body region bears.

    What to watch where a log has poses but no forces. A contact is modelled as a
    spring between the masses of the robot and of the body region.

    Measures:
        For every robot and human the speed of the nearest points against each other,
        against the permitted one: `when: contact` at the first sample of each contact
        (surface distance 0), `when: near` their closing speed within `near_m`.
    Violated when:
        The speed is above the permitted one. At a contact that is a critical event.
    Source:
        ISO/TS 15066:2016, A.3.4 to A.3.6: v = F / sqrt(mu k), and the same of the
        limit of pressure on `contact_area_m2`. M / 2 holds for arms; for a vehicle or
        an arm on a gantry give `robot_mass_kg` (our choice).
    """

    example: ClassVar[Mapping[str, Any]] = {"region": "chest", "when": "near", "near_m": 0.5}

    region: str = parameter("", source="body region or area; empty: the face, the weakest of all")
    moving_mass_kg: float = parameter(
        33.5, unit="kg", above=0, at_most=1e5, status="verified", source="UR10e, complete arm"
    )
    load_kg: float = parameter(0.0, unit="kg", at_least=0, at_most=1e5, source="tool and workpiece")
    robot_mass_kg: float | None = parameter(
        None, unit="kg", above=0, at_most=1e5, source="m_R where it is not M / 2 + m_L"
    )
    contact_area_m2: float | None = parameter(
        1e-4, unit="m2", above=0, at_most=1, status="verified", source="tables assume about 1 cm2"
    )
    phase: Literal["transient", "quasi_static"] = parameter("transient", source="a free impact is short")
    transient_factor: float = parameter(
        2.0, unit="1", at_least=1, at_most=10, status="verified", source="public sources on Table A.2"
    )
    when: Literal["contact", "near"] = parameter("contact", source="catalogue, M5")
    near_m: float = parameter(0.10, source="catalogue, M5", **_LENGTH)
    max_gap_s: float = parameter(0.05, **_GAP)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **_TIME)

    _clause = "derived from ISO/TS 15066:2016, A.3"

    def __post_init__(self) -> None:
        check_parameters(self)
        body_limits(self.region or UNKNOWN_REGION)

    def resolved(self) -> dict[str, object]:
        """The region where none is given, and m_R."""
        return {"region": self.region or UNKNOWN_REGION, "robot_mass_kg": self._robot_mass_kg}

    @property
    def _robot_mass_kg(self) -> float:
        return self.robot_mass_kg or effective_robot_mass_kg(self.moving_mass_kg, self.load_kg)

    def permitted(self) -> Permitted:
        """Largest speed, force and energy, and the mass they rest on."""
        limits = body_limits(self.region or UNKNOWN_REGION)
        short = self.phase == "transient"
        factor = limits.region.transient_factor(self.transient_factor) if short else 1.0
        return permitted_contact(
            limits, self._robot_mass_kg, factor=factor, contact_area_m2=self.contact_area_m2
        )

    @property
    def _wanted(self) -> dict[str, str]:
        if self.when == "contact":
            return {"separation/{robot}/{human}": "m", "relative_speed/{robot}/{human}": "m/s"}
        return {
            "separation/{robot}/{human}": "m",
            "approach_speed_robot/{robot}/{human}": "m/s",
            "approach_speed_human/{robot}/{human}": "m/s",
        }

    def needs(self) -> Iterator[SignalNeed]:
        """Distance and speeds of the nearest points."""
        wanted = {template.partition("/")[0]: unit for template, unit in self._wanted.items()}
        for quantity, unit in wanted.items():
            yield SignalNeed(quantity, unit, self.max_gap_s)
        yield from meeting_needs(self.max_gap_s, *wanted)

    def _say(self, trial: Trial) -> Iterator[Said]:
        """For every pair where it was too fast, or its closest moment."""
        return watch_subjects(
            trial,
            pairs_of(trial),
            self._wanted,
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=self._judge,
            optional={name: unit for name, unit in MEETING.items() if name not in self._wanted},
            kinds=("robot", "human"),
        )

    def _begin(self) -> Judging:
        starts, may = RunStarts(self.max_gap_s), self.permitted()

        def judge(window: Watched) -> Bound:
            distance = window["separation/{robot}/{human}"]
            if self.when == "contact":
                speed = window["relative_speed/{robot}/{human}"]
                touching = distance <= 0
                (started_s,) = starts.take(window.t, touching, window.t)
                applies = touching & (started_s == window.t)
            else:
                speed = window["approach_speed_robot/{robot}/{human}"]
                speed = speed + window["approach_speed_human/{robot}/{human}"]
                applies = distance < self.near_m
            limit = np.full_like(speed, may.speed_m_s)
            return Bound("relative speed", speed, limit, "m/s", True, applies, "permitted_speed")

        return judge

    def _judge(self, subject: Subject, watched: Watching) -> Iterator[Said]:
        seen = Seen(subject.name, watched, self._begin, apart=self.when != "contact")
        yield seen
        idle = "no contact" if self.when == "contact" else f"never nearer than {self.near_m:g} m"
        rules = Rules(self._clause, 0.0, self.t_off_s, idle, critical=self.when == "contact")
        may, exposure = self.permitted(), exposure_of(watched)
        judged = Judged(seen, rules, gathered=lambda: Blame(Meeting.of, before=self.when == "contact"))
        for one in judged.violations():
            v = one.worst.actual
            energy = contact_energy_j(may.reduced_kg, v)
            ratios = {"speed_ratio": v / may.speed_m_s, "energy_ratio": energy / may.energy_j}
            told = Told({**ratios, **exposure}, one.told.labels)
            yield broken(subject.name, one.worst, rules, one.span, one.quantities, told)
        if not judged.violated and not watched.gaps:
            told = Told({"speed_ratio": 0.0, "energy_ratio": 0.0, **exposure})
            yield kept(subject.name, judged.closest, rules, told)


# Monitored standstill -------------------------------------------------------------------------


@dataclass(frozen=True)
class MonitoredStandstill(Sampled):
    """The robot stands still while a person is in the collaborative workspace.

    Measures:
        For every robot and human, while the human is inside `workspace` and once
        `grace_s` has passed since it came in: the robot's speed (and that of its
        joints, where recorded), its drift from where it came to rest, and the way it
        covers until the human has left.
    Violated when:
        A speed exceeds its standstill limit, or the drift exceeds `drift_m`.
    Source:
        ISO 10218-2, monitored standstill (2011: safety-rated monitored stop; stop
        category 2: drives may stay on). Limits and grace are our choice (catalogue, M7).
    """

    example: ClassVar[Mapping[str, Any]] = {"workspace": [[-1.0, 4.0], [1.0, 4.0], [1.0, 6.0], [-1.0, 6.0]]}

    workspace: tuple[tuple[float, ...], ...] = parameter((), unit="m", source="corners [x, y]; required")
    standstill_speed_m_s: float = parameter(STANDSTILL_SPEED_M_S, source="catalogue, M7", **_SPEED)
    standstill_joint_speed_rad_s: float = parameter(
        0.01, unit="rad/s", at_least=0, at_most=100, source="catalogue, M7"
    )
    drift_m: float = parameter(0.005, source="catalogue, M7", **_LENGTH)
    grace_s: float = parameter(0.5, source="T_r + T_s; catalogue, M7", **_TIME)
    max_gap_s: float = parameter(0.05, **_GAP)
    t_on_s: float = parameter(0.03, source="catalogue, 1.2", **_TIME)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **_TIME)

    _clause = "derived from ISO 10218-2:2025, monitored standstill"

    def __post_init__(self) -> None:
        check_parameters(self)
        check_polygon("workspace", self.workspace)

    def needs(self) -> Iterator[SignalNeed]:
        """Where the human is, how fast the robot is, and where."""
        yield SignalNeed("position", "m", self.max_gap_s)
        yield SignalNeed("speed", "m/s", self.max_gap_s)
        yield SignalNeed("joint_speed", "rad/s", self.max_gap_s, optional=True)
        yield from meeting_needs(self.max_gap_s, "speed")

    def _say(self, trial: Trial) -> Iterator[Said]:
        """For every pair each movement, or that there was none."""
        if not self.workspace:
            message = "no workspace is given, so nobody can be inside"
            yield Finding.inconclusive("trial", message, span=trial.window, clause=self._clause)
            return
        yield from watch_subjects(
            trial,
            pairs_of(trial),
            {"position/{human}": "m", "speed/{robot}": "m/s"},
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=self._judge,
            optional={"position/{robot}": "m", "joint_speed/{robot}": "rad/s", **MEETING},
            kinds=("robot", "human"),
        )

    def held(self, t: FloatArray, within: BoolArray) -> BoolArray:
        """Whether the robot must be at rest: a person inside, and the grace over."""
        return self.holding()(t, within)

    def holding(self) -> Callable[[FloatArray, BoolArray], BoolArray]:
        """`held`, of samples that come in parts."""
        starts = RunStarts(self.max_gap_s)

        def held(t: FloatArray, within: BoolArray) -> BoolArray:
            if not len(t):
                return np.zeros(0, dtype=bool)
            (began_s,) = starts.take(t, within, t)
            over: BoolArray = within & (t - began_s >= self.grace_s - _TOLERANCE_S)
            return over

        return held

    def _judge(self, subject: Subject, watched: Watching) -> Iterator[Said]:
        standing, exposed = _Standing(self, watched), Exposure()
        rules = Rules(self._clause, self.t_on_s, self.t_off_s, "nobody was in the workspace for long enough")
        gathered: list[tuple[Judging, Callable[[], Gathered]]]
        gathered = [(standing.speed, lambda: Several(Blame(Meeting.of), _Resumed()))]
        if watched.has(_JOINTS):
            gathered.append((standing.joints, lambda: Blame(Meeting.of)))
        if watched.has(_PLACE):
            gathered.append((standing.drift, lambda: Blame(Meeting.of)))
        judged: list[tuple[Seen, Judged]] = []
        for judge, gather in gathered:
            seen = Seen(subject.name, watched, partial(_same, judge))
            first = not judged  # its silence tells that of the others
            judged.append((seen, Judged(seen, rules, gathered=gather, handed=True, approached=first)))
        for window in watched:
            standing.take(window)
            exposed.take(window)
            for _, one in judged:
                one.take(window)
        for _, one in judged:
            one.end()
        yield from self._findings(subject, watched, rules, judged, standing, exposed.of(watched))

    def _findings(
        self,
        subject: Subject,
        watched: Watching,
        rules: Rules,
        judged: Sequence[tuple[Seen, Judged]],
        standing: _Standing,
        exposure: Mapping[str, float],
    ) -> Iterator[Said]:
        """Movements, told with the way until the person left, or the next one; then what else was broken."""
        (seen, moved), *others = judged
        yield seen
        ways = ways_m(watched, SPEED, [standing.way(span, last_s) for span, last_s in moved.lasting])
        for one, way_m in zip(moved.violations(), ways, strict=True):
            told = Told({**exposure, "travel_m": way_m}) + one.told
            yield broken(subject.name, one.worst, rules, one.span, one.quantities, told)
        if not moved.violated and not watched.gaps:
            of_others = {**no_severities("rad/s"), **no_severities("m")}  # of joints, and of the drift
            told = Told({**exposure, **of_others, "travel_m": 0.0, "speed_max_m_s": 0.0})
            yield kept(subject.name, moved.closest, rules, told if moved.closest else Told())
        for seen, other in others:
            yield seen
            for one in other.violations():
                told = Told(exposure) + one.told
                yield broken(subject.name, one.worst, rules, one.span, one.quantities, told)


_JOINTS, _PLACE = "joint_speed/{robot}", "position/{robot}"


def _same(judge: Judging) -> Judging:
    return judge


class _Standing:
    """Where a robot must be at rest, and from where it drifts; asked about windows that were taken."""

    def __init__(self, monitor: MonitoredStandstill, watched: Watching) -> None:
        self._monitor, self._watched = monitor, watched
        self._holding = monitor.holding()
        self._held, self._ended = Marks(), Marks()
        self._before: dict[int, _Rest] = {}
        self._last = _Rest(False, True, np.zeros(3))

    def take(self, window: Watched) -> None:
        """Look at the next window."""
        within = inside(window["position/{human}"], self._monitor.workspace)
        held, moving = self._holding(window.t, within), self._moving(window)
        self._held.put(window, held)
        self._ended.put(window, ~within | moving)
        self._before[window.number] = self._last
        place, anchor = window.extra.get(_PLACE), self._last.anchor_m
        if place is not None:
            here = np.flatnonzero(self._anchored(window, held, moving))
            anchor = place[here[-1]].copy() if len(here) else anchor
        self._last = _Rest(bool(held[-1]), bool(moving[-1]), anchor)

    def way(self, span: Span, last_s: float) -> Span:
        """From the beginning of a movement until the person left, or until the next one."""
        for window in self._watched.between(last_s):
            after = int(window.t.searchsorted(last_s, side="right"))
            ended = self._ended.of(window)[after:]
            if ended.any():
                return Span(span.start_s, max(float(window.t[after + np.argmax(ended)]), span.end_s))
        return Span(span.start_s, max(self._watched.end_s, span.end_s))

    def speed(self, window: Watched) -> Bound:
        """The speed while it must be 0."""
        speed, held = window[SPEED], self._held.of(window)
        limit = np.full_like(speed, self._monitor.standstill_speed_m_s)
        rested = self._before[window.number].held
        return _Speed("speed in the workspace", speed, limit, "m/s", True, held, rested=rested)

    def joints(self, window: Watched) -> Bound:
        """The speed of the joints, where the robot itself keeps its limit."""
        joints, held = window.extra[_JOINTS], self._held.of(window)
        known = held & np.isfinite(joints) & ~self._moving(window)
        limit = np.full_like(joints, self._monitor.standstill_joint_speed_rad_s)
        return Bound("joint speed in the workspace", np.nan_to_num(joints), limit, "rad/s", True, known)

    def drift(self, window: Watched) -> Bound:
        """Creep below the standstill speed, from where the robot last came to rest."""
        held, place = self._held.of(window), window.extra[_PLACE]
        drift, limit = np.zeros(len(held)), np.full(len(held), self._monitor.drift_m)
        if held.any():
            moving = self._moving(window)
            here = self._anchored(window, held, moving)
            anchors = place[np.maximum.accumulate(np.where(here, np.arange(len(held)), 0))]
            if not here[0]:
                first = int(np.argmax(here)) if here.any() else len(here)
                anchors[:first] = self._before[window.number].anchor_m
            away = place - anchors
            drift = np.sqrt(away[:, 0] ** 2 + away[:, 1] ** 2 + away[:, 2] ** 2)
            held = held & ~moving & np.isfinite(drift)
        return Bound("drift while standing still", np.nan_to_num(drift), limit, "m", True, held)

    def _moving(self, window: Watched) -> BoolArray:
        moving: BoolArray = window[SPEED] > self._monitor.standstill_speed_m_s
        return moving

    def _anchored(self, window: Watched, held: BoolArray, moving: BoolArray) -> BoolArray:
        """Where drift begins at the place at hand: the robot comes to rest, moves, or need not rest."""
        before = self._before[window.number]
        rested = np.concatenate(([before.held and not before.moving], held[:-1] & ~moving[:-1]))
        here: BoolArray = moving | ~held | ~rested
        return here


@dataclass(frozen=True, eq=False)
class _Rest:
    """How things stood at the end of a window.

    Attributes:
        held: Whether the robot had to be at rest.
        moving: Whether it moved.
        anchor_m: Where it last came to rest, shape (3,), m.
    """

    held: bool
    moving: bool
    anchor_m: FloatArray


@dataclass(frozen=True, kw_only=True)
class _Speed(Bound):
    """A speed that must be 0.

    Attributes:
        rested: Whether it had to be 0 at the sample before the first of these.
    """

    rested: bool


class _Resumed(Gathered):
    """The largest speed of a movement, and whether the robot had to be at rest before it."""

    def __init__(self) -> None:
        self._largest_m_s, self._resumed = 0.0, ""

    def take(self, watched: Watched, bound: Bound, rows: Any) -> None:
        """Compare with those before."""
        del watched
        assert isinstance(bound, _Speed)  # nothing else is judged here
        self._largest_m_s = max(self._largest_m_s, float(bound.actual[rows].max()))
        if not self._resumed:
            assert bound.applies is not None  # it is where the robot is held
            first = int(rows[0])
            rested = bound.applies[first - 1] if first else bound.rested
            self._resumed = "yes" if rested else "no"

    def told(self) -> Told:
        """Both."""
        return Told({"speed_max_m_s": self._largest_m_s}, {"resumed": self._resumed})


# Hand guiding ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class HandGuiding(Sampled):
    """The robot moves by hand only while the enabling device is held, and slowly.

    Measures:
        For every robot its speed: against `max_speed_m_s` while the device is held
        and for `stop_within_s` after its release, then against the standstill speed.
        The device is the flag `enabling_device` (signal, or events `on` and `off`).
    Violated when:
        The speed exceeds the limit of the moment.
    Source:
        ISO 10218-2 and ISO/TS 15066:2016, 5.5.3. The speed limit is for the risk
        assessment to set; 0.25 m/s and 0.5 s are our choice.
    """

    max_speed_m_s: float = parameter(0.25, source="for the risk assessment to set", **_SPEED)
    stop_within_s: float = parameter(0.5, source="set per system", **_TIME)
    standstill_speed_m_s: float = parameter(STANDSTILL_SPEED_M_S, source="catalogue, M7", **_SPEED)
    applies: Literal["always", "manual_mode"] = parameter("always", source="while the robot is guided")
    max_flag_age_s: float = parameter(1.0, unit="s", above=0, at_most=60, source="how long a flag holds")
    max_gap_s: float = parameter(0.05, **_GAP)
    t_on_s: float = parameter(0.0, source="catalogue, 1.2", **_TIME)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **_TIME)

    _clause = "derived from ISO/TS 15066:2016, 5.5.3"

    def __post_init__(self) -> None:
        check_parameters(self)

    def needs(self) -> Iterator[SignalNeed]:
        """Speed and flags."""
        yield SignalNeed("speed", "m/s", self.max_gap_s)
        yield SignalNeed("enabling_device", "1", self.max_flag_age_s)
        if self.applies == "manual_mode":
            yield SignalNeed("manual_mode", "1", self.max_flag_age_s)

    def allowed_speed_m_s(self, t: FloatArray, pressed: BoolArray) -> FloatArray:
        """The limit of each moment, shape (n,), m/s."""
        return self._allowing()(t, pressed)

    def _allowing(self) -> Callable[[FloatArray, BoolArray], FloatArray]:
        """The limit of each moment, of samples that come in parts."""
        starts, began_s = RunStarts(np.inf), np.nan

        def allowed(t: FloatArray, pressed: BoolArray) -> FloatArray:
            nonlocal began_s
            if not len(t):
                return np.zeros(0)
            began_s = float(t[0]) if np.isnan(began_s) else began_s
            (released_s,) = starts.take(t, ~pressed, t)
            since_s = np.where(pressed, 0.0, t - released_s)
            # Before the first sample the device was as it is there: released means at rest.
            never = ~pressed & (released_s == began_s)
            stopping = (since_s < self.stop_within_s - _TOLERANCE_S) & ~never
            return np.where(pressed | stopping, self.max_speed_m_s, self.standstill_speed_m_s)

        return allowed

    def _say(self, trial: Trial) -> Iterator[Said]:
        """For every robot where it was too fast, or its closest moment."""
        return watch_subjects(
            trial,
            bodies_of(trial, "robot"),
            {"speed/{robot}": "m/s"},
            max_gap_s=self.max_gap_s,
            clause=self._clause,
            judge=lambda subject, watched: self._judge(trial, subject, watched),
        )

    def _judge(self, trial: Trial, subject: Subject, watched: Watching) -> Iterator[Said]:
        manual = self.applies == "manual_mode"
        for flag in ("enabling_device", *(("manual_mode",) if manual else ())):
            unknown = flag_unknown(trial, subject, flag, self.max_flag_age_s, watched, self._clause)
            if unknown is not None:
                yield unknown
                return

        def begin() -> Judging:
            allowed = self._allowing()

            def judge(window: Watched) -> Bound:
                pressed = flag_over(trial, subject, "enabling_device", self.max_flag_age_s, window)
                applies = (
                    flag_over(trial, subject, "manual_mode", self.max_flag_age_s, window) if manual else None
                )
                limit = allowed(window.t, pressed)
                speed = window["speed/{robot}"]
                return Bound("speed of the guided robot", speed, limit, "m/s", True, applies, "allowed_speed")

            return judge

        rules = Rules(self._clause, self.t_on_s, self.t_off_s, "the robot was never guided by hand")
        yield from findings_of(subject.name, watched, begin, rules, apart=False)


def flag_over(trial: Trial, subject: Subject, flag: str, max_age_s: float, window: Watched) -> BoolArray:
    """A flag that is known, in a window."""
    state = state_over(trial, flag, subject.name, window.t, max_age_s=max_age_s)
    assert state is not None  # `flag_unknown` was asked before
    return state.on


def flag_unknown(
    trial: Trial, subject: Subject, flag: str, max_age_s: float, watched: Watching, clause: str
) -> Finding | None:
    """The finding when a flag that decides is not known all the time; `None` when it is."""
    for window in watched:
        state = state_over(trial, flag, subject.name, window.t, max_age_s=max_age_s)
        if state is None or not state.known.all():
            return unknown_flag(trial, subject, flag, state, window, clause)
    return None


def unknown_flag(
    trial: Trial, subject: Subject, flag: str, state: State | None, watched: Watched, clause: str
) -> Finding:
    """The finding when a flag that decides is not in the log, or not all the time."""
    if state is None:
        message = f"the log has neither a signal '{flag}/{subject.name}' nor {flag!r} events"
        return Finding.inconclusive(subject.name, message, span=trial.window, clause=clause)
    at = float(watched.t[np.flatnonzero(~state.known)[0]])
    message = f"{flag!r} is not known at {at:.3f} s"
    return Finding.inconclusive(subject.name, message, span=trial.window, clause=clause)
