"""What each region of the body bears: limits of force and pressure, stiffness, mass.

After ISO/TS 15066:2016, Annex A (Tables A.2 to A.4), and ISO 10218-2:2025, Annex M, as
public secondary sources give them; the standards themselves were not read. Not valid
for children. Each value says how sure it is; the table is here to be replaced by a
better one.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass

from ariac_score import ParameterFacts, Status

VERIFIED: Status = "verified"
FROM_MEMORY: Status = "from memory"

_FORCE = ParameterFacts(
    "N", VERIFIED, "public ROS 2 UR safety controller and research notes that copy Table A.2"
)
_MODEL = ParameterFacts("N/m", VERIFIED, "public safety controllers and simulators that copy Table A.3")
_PRESSURE = ParameterFacts(
    "Pa", VERIFIED, "public ROS 2 UR safety controller and a research note that copy Table A.2"
)


@dataclass(frozen=True)
class Region:
    """One region of the body.

    Attributes:
        name: Such as `hand`.
        title: As the table calls it.
        stiffness_n_m: Of the contact, N/m.
        mass_kg: Effective mass of the region, kg.
        force_n: Quasi-static limit of force, N.
        contact_permitted: Whether contact is permissible at all.
        energy_a4_j: What Table A.4 prints, for information: it was computed before forces were rounded, J.
        energy_a4: Status of that number.
        height_m: Where it may be met on a person standing, sitting or bending, m; our choice.
        force: Status and source of the limit of force.
        model: Status and source of stiffness and mass.
    """

    name: str
    title: str
    stiffness_n_m: float
    mass_kg: float
    force_n: float
    contact_permitted: bool
    energy_a4_j: float
    energy_a4: Status
    height_m: tuple[float, float]
    force: ParameterFacts = _FORCE
    model: ParameterFacts = _MODEL

    def transient_factor(self, factor: float = 2.0) -> float:
        """How much more a short contact may do; 1 where contact is not permissible."""
        return factor if self.contact_permitted else 1.0


def _region(
    name: str,
    title: str,
    stiffness_n_mm: float,
    mass_kg: float,
    force_n: float,
    energy_j: float,
    height_m: tuple[float, float],
    *,
    contact: bool = True,
    energy: Status = FROM_MEMORY,
) -> Region:
    return Region(name, title, 1000.0 * stiffness_n_mm, mass_kg, force_n, contact, energy_j, energy, height_m)


REGIONS: Mapping[str, Region] = {
    region.name: region
    for region in (
        _region("skull_forehead", "Skull and forehead", 150, 4.4, 130, 0.23, (0.9, 2.1), contact=False),
        _region("face", "Face", 75, 4.4, 65, 0.11, (0.9, 2.0), contact=False),
        _region("neck", "Neck", 50, 1.2, 150, 0.84, (0.9, 1.8)),
        _region("back_shoulders", "Back and shoulders", 35, 40, 210, 2.5, (0.7, 1.7), energy=VERIFIED),
        _region("chest", "Chest", 25, 40, 140, 1.6, (0.7, 1.6)),
        _region("abdomen", "Abdomen", 10, 40, 110, 2.4, (0.6, 1.3)),
        _region("pelvis", "Pelvis", 25, 40, 180, 2.6, (0.4, 1.2)),
        _region("upper_arm", "Upper arms and elbow joints", 30, 3, 150, 1.5, (0.5, 2.1)),
        _region("lower_arm", "Lower arms and wrist joints", 40, 2, 160, 1.3, (0.2, 2.3)),
        _region("hand", "Hands and fingers", 75, 0.6, 140, 0.49, (0.0, 2.5), energy=VERIFIED),
        _region("thigh", "Thighs and knees", 50, 75, 220, 1.9, (0.2, 1.1)),
        _region("lower_leg", "Lower legs", 60, 75, 130, 0.52, (0.0, 0.6)),
    )
}


@dataclass(frozen=True)
class Area:
    """One specific body area: a limit of pressure.

    Attributes:
        number: Its number in the table.
        name: Such as `back_of_hand_dominant`.
        region: The region it belongs to.
        pressure_pa: Quasi-static limit, Pa.
        pressure: Status and source of that limit.
    """

    number: int
    name: str
    region: str
    pressure_pa: float
    pressure: ParameterFacts = _PRESSURE


_N_CM2 = 1e4
"""Pa for one N/cm2."""

_AREAS = (
    (1, "middle_of_forehead", "skull_forehead", 130),
    (2, "temple", "skull_forehead", 110),
    (3, "masticatory_muscle", "face", 110),
    (4, "neck_muscle", "neck", 140),
    (5, "seventh_neck_muscle", "neck", 210),
    (6, "shoulder_joint", "back_shoulders", 160),
    (7, "fifth_lumbar_vertebra", "back_shoulders", 210),
    (8, "sternum", "chest", 120),
    (9, "pectoral_muscle", "chest", 170),
    (10, "abdominal_muscle", "abdomen", 140),
    (11, "pelvic_bone", "pelvis", 210),
    (12, "deltoid_muscle", "upper_arm", 190),
    (13, "humerus", "upper_arm", 220),
    (14, "radial_bone", "lower_arm", 190),
    (15, "forearm_muscle", "lower_arm", 180),
    (16, "arm_nerve", "lower_arm", 180),
    (17, "forefinger_pad_dominant", "hand", 300),
    (18, "forefinger_pad_non_dominant", "hand", 270),
    (19, "forefinger_end_joint_dominant", "hand", 280),
    (20, "forefinger_end_joint_non_dominant", "hand", 220),
    (21, "thenar_eminence", "hand", 200),
    (22, "palm_dominant", "hand", 260),
    (23, "palm_non_dominant", "hand", 260),
    (24, "back_of_hand_dominant", "hand", 200),
    (25, "back_of_hand_non_dominant", "hand", 190),
    (26, "thigh_muscle", "thigh", 250),
    (27, "kneecap", "thigh", 220),
    (28, "middle_of_shin", "lower_leg", 220),
    (29, "calf_muscle", "lower_leg", 210),
)
_DOUBTFUL = {
    "palm_non_dominant": ParameterFacts(
        "Pa", FROM_MEMORY, "a research note gives the palm without a side; the side is from memory"
    ),
}

AREAS: Mapping[str, Area] = {
    name: Area(number, name, region, _N_CM2 * n_cm2, _DOUBTFUL.get(name, _PRESSURE))
    for number, name, region, n_cm2 in _AREAS
}

UNKNOWN_REGION = "face"
"""Its limits, the smallest of all, stand in where nothing shows which region was touched."""


@dataclass(frozen=True)
class BodyLimits:
    """The quasi-static limits for one place on the body.

    Attributes:
        name: The region or area, as in the tables.
        region: Its region.
        pressure_pa: Limit of pressure; of a region the smallest of its areas, Pa.
    """

    name: str
    region: Region
    pressure_pa: float

    @property
    def force_n(self) -> float:
        """Limit of force, N."""
        return self.region.force_n


def body_limits(name: str) -> BodyLimits:
    """The limits of a region or an area by name; blanks and hyphens count as underscores.

    Raises:
        ValueError: There is no such region or area; with the nearest names.

    >>> body_limits("lower leg").force_n
    130
    """
    plain = re.sub(r"[\s-]+", "_", name.strip().lower())
    if plain in AREAS:
        area = AREAS[plain]
        return BodyLimits(plain, REGIONS[area.region], area.pressure_pa)
    if plain in REGIONS:
        smallest = min(area.pressure_pa for area in AREAS.values() if area.region == plain)
        return BodyLimits(plain, REGIONS[plain], smallest)
    near = difflib.get_close_matches(plain, [*REGIONS, *AREAS], n=1)
    hint = f"did you mean {near[0]!r}?" if near else f"regions: {', '.join(REGIONS)}"
    raise ValueError(f"body region {name!r} is unknown; {hint}")


def regions_at(height_m: float) -> list[Region]:
    """The regions that may be met at a height above the floor; the face where there is none."""
    met = [r for r in REGIONS.values() if r.height_m[0] <= height_m <= r.height_m[1]]
    return met or [REGIONS[UNKNOWN_REGION]]


def limits_at(height_m: float) -> BodyLimits:
    """The smallest limits among the regions that may be met at a height."""
    weakest = min(regions_at(height_m), key=lambda region: region.force_n)
    return body_limits(weakest.name)
