"""Power and force limiting by speed, after ISO 10218-2:2025 (Annex M) and ISO/TS 15066:2016 (A.3).

Contact itself is in `pfl_contact`, standing still while a person is in the workspace in
`standstill`, hand guiding in `hand_guiding`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from ariac_score import Measure, parameter
from ariac_score.monitors import (
    APART,
    TOWARDS_HUMAN,
    TOWARDS_ROBOT,
    Bound,
    Encounter,
    Episode,
    JudgedLimit,
    LimitMonitor,
    Reach,
    Watched,
    Worse,
    first_of_runs,
    pairs,
)
from ariac_score_standards.body_regions import UNKNOWN_REGION, BodyLimits, body_limits
from ariac_score_standards.parameters import GAP, LENGTH, TIME

# Power and force limiting: formulas -----------------------------------------------------------


# Stiffness is in N/m throughout. The tables print N/mm, and code that leaves the factor of 1000 out
# permits speeds 31.6 times too high: public code does.


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
    # Always from F and k: the energies of Table A.4 were computed before its forces were rounded.
    region = limits.region
    reduced = reduced_mass_kg(region.mass_kg, robot_mass_kg)
    force = factor * region.force_n
    if contact_area_m2 is not None:
        force = min(force, factor * limits.pressure_pa * contact_area_m2)
    speed = permitted_speed_m_s(force, reduced, region.stiffness_n_m)
    return Permitted(reduced, force, speed, energy_limit_j(force, region.stiffness_n_m))


# Speed ----------------------------------------------------------------------------------------


_RELATIVE = "relative_speed/{robot}/{human}"


@dataclass(frozen=True)
class PflSpeed(LimitMonitor):
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
    near_m: float = parameter(0.10, source="catalogue, M5", **LENGTH)
    max_gap_s: float = parameter(0.05, **GAP)
    t_off_s: float = parameter(1.0, source="catalogue, 1.2", **TIME)

    subjects = pairs("robot", "human")
    what, unit = "relative speed", "m/s"
    clause = "derived from ISO/TS 15066:2016, A.3"
    severities: ClassVar[Mapping[str, Measure]] = {
        "speed_ratio": Measure("1", best=0.0, meaning="speed as a share of the permitted one"),
        "energy_ratio": Measure("1", best=0.0, meaning="energy as a share of the permitted one"),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
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
    def wanted(self) -> dict[str, str]:
        """Distance and speeds of the nearest points."""
        if self._at_contact:
            return {APART: "m", _RELATIVE: "m/s"}
        return {APART: "m", TOWARDS_HUMAN: "m/s", TOWARDS_ROBOT: "m/s"}

    @property
    def worse(self) -> dict[str, Worse]:
        """Nearer and faster; how often bodies touch, no bound of their distance tells."""
        return {} if self._at_contact else {APART: "low", TOWARDS_HUMAN: "high", TOWARDS_ROBOT: "high"}

    @property
    def _at_contact(self) -> bool:
        return self.when == "contact"

    @property
    def may_hide(self) -> tuple[dict[str, float], ...]:
        """The beginning of a contact, slow enough."""
        return ({APART: 0.0, _RELATIVE: 0.0},) if self._at_contact else ()

    @property
    def encounter(self) -> Encounter:
        """At a contact, with who closed in before it."""
        return Encounter(before=self._at_contact)

    @property
    def critical(self) -> bool:
        """Whether bodies touched."""
        return self._at_contact

    @property
    def idle(self) -> str:
        """That they never met."""
        return "no contact" if self._at_contact else f"never nearer than {self.near_m:g} m"

    @property
    def reach(self) -> Reach:
        """A contact begins where there was none at the sample before."""
        return Reach("neighbour" if self._at_contact else "sample")

    def margin(self, signals: Watched) -> Bound:
        """Permitted speed - speed of the nearest points against each other, m/s."""
        distance = signals[APART]
        if self._at_contact:
            speed, touching = signals[_RELATIVE], distance <= 0
            first = first_of_runs(signals.t, touching, signals.max_gap_s)
            where = touching & (first == np.arange(len(first)))  # the sample that a contact begins with
        else:
            speed = signals[TOWARDS_HUMAN] + signals[TOWARDS_ROBOT]
            where = distance < self.near_m
        return self.at_most(speed, self.permitted().speed_m_s, where=where, named="permitted_speed")

    def severity(self, limit: JudgedLimit, episode: Episode | None) -> dict[str, float]:
        """Speed and energy as shares of the permitted."""
        if episode is None:
            return {"speed_ratio": 0.0, "energy_ratio": 0.0}
        permitted, v = self.permitted(), float(limit.bound.actual[episode.worst])
        energy = contact_energy_j(permitted.reduced_kg, v)
        return {"speed_ratio": v / permitted.speed_m_s, "energy_ratio": energy / permitted.energy_j}
