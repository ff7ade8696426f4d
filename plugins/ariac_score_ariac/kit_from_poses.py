"""What lay on a tray, worked out from the poses of models: for logs that show motion and nothing else.

A product is a model whose name is that of a product and whose origin lies in a box
above the tray. The simulators decide by contact (2017 to 2022) or by the view of a
sensor (2023 on); the box of the log map stands for both.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass, replace
from fnmatch import fnmatchcase
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ariac_score import LARGEST_STEP_BACK_S, FloatArray, ModelTrack, Pose, check_parameters, parameter
from ariac_score_ariac import fault_marks
from ariac_score_ariac.parts import part_of
from ariac_score_ariac.work import FaultMarks, Kit, KitRecord, Product, Tray

__all__ = ["KitPoses", "KitsOfModels", "LooseTray", "TrayMatch", "part_type", "product_type"]

_FAULTS: Mapping[str, FaultMarks] = {
    "instance": fault_marks.by_list,
    "part": fault_marks.by_challenges,
}
"""By how the log map reads the names of models, which changed with the same edition."""

IntArray = NDArray[np.int64]


def product_type(name: str) -> str:
    """The type in the name of an individual.

    Source: rulebooks 2017 to 2022, model name to product type.

    >>> product_type("bin2|assembly_pump_red_3"), product_type("gear_part_clone_0"), product_type("g_1")
    ('assembly_pump_red', 'gear_part', 'g_1')
    """
    name = name.rpartition("|")[2]
    stem = name.rstrip("0123456789")
    if stem.endswith("_") and len(stem) - 1 > 1:
        name = stem[:-1]
    before, clone, _ = name.rpartition("_clone")
    return before if clone else name


def part_type(name: str) -> str:
    """Type and colour that the name of a part contains; empty for the name of anything else.

    >>> part_type("battery_blue_3_faulty"), part_type("kit_tray_03")
    ('battery_blue', '')
    """
    part = part_of(name)
    return "" if part is None else "_".join(part)


@dataclass(frozen=True)
class LooseTray:
    """A model or link, and the box, in its frame, in which the origin of a thing on it lies; sides included.

    Attributes:
        match: Shell pattern over scoped names: `model` or `model::link`, with the models it is nested in
            before it.
        half_length_m: Along x to either side, m.
        half_width_m: Along y to either side, m.
        height_m: Above the origin of the tray, m.
        depth_m: Below it, m.
    """

    match: str
    half_length_m: float = parameter(MISSING, unit="m", above=0)
    half_width_m: float = parameter(MISSING, unit="m", above=0)
    height_m: float = parameter(MISSING, unit="m", above=0)
    depth_m: float = parameter(0.02, unit="m", at_least=0)

    def __post_init__(self) -> None:
        check_parameters(self)

    def holds(self, position_m: tuple[float, float, float]) -> bool:
        """Whether a point lies in the box."""
        x, y, z = position_m
        return (
            abs(x) <= self.half_length_m
            and abs(y) <= self.half_width_m
            and -self.depth_m <= z <= self.height_m
        )


@dataclass(frozen=True)
class TrayMatch(LooseTray):
    """Which model or link is the tray of an AGV or the insert of a station.

    In `match`, `{place}` stands for such as `agv1`, `{n}` for its number.

    Attributes:
        at: `agv` or `station`.
        loose: The loose trays that kits are built on; `None` where there are none.
    """

    at: Literal["agv", "station"] = "agv"
    loose: LooseTray | None = None

    def pattern_for(self, place: str) -> str:
        """The pattern for one place.

        >>> TrayMatch("{place}::kit_tray_{n}::*", 1.0, 1.0, 1.0).pattern_for("agv2")
        'agv2::kit_tray_2::*'
        """
        # `{n}`: models of trays are numbered like their AGV, but not named after it.
        number = place[len(place.rstrip("0123456789")) :]
        return self.match.replace("{place}", place).replace("{n}", number)


@dataclass(frozen=True)
class KitsOfModels:
    """Finds the kits of ARIAC in the poses of Gazebo's models.

    Reads:
        The names and poses of products, trays, AGVs and stations.

    Attributes:
        names: How the name of a model gives its type: `instance` (the type and a number)
            or `part` (a name that contains a type and a colour).
        products: Shell patterns over the types that are products; any where there are none.
        trays: Where kits lie among the models.

    Source:
        ARIAC notes on log formats, sections 4.2 and 4.3; rulebooks 2017 to 2024, model names.
    """

    names: Literal["instance", "part"] = "instance"
    products: tuple[str, ...] = ()
    trays: tuple[TrayMatch, ...] = ()

    def follows(self, name: str) -> bool:
        """Whether the poses of a model or link, by its scoped name, are needed to find kits."""
        if self.type_of(name.partition("::")[0]):
            return True
        patterns = [tray.match.replace("{place}", "*").replace("{n}", "*") for tray in self.trays]
        patterns += [tray.loose.match for tray in self.trays if tray.loose]
        return any(fnmatchcase(name, pattern) for pattern in patterns)

    def type_of(self, model: str) -> str:
        """The type of the product that a model is; empty when it is none."""
        kind = part_type(model) if self.names == "part" else product_type(model)
        return kind if not self.products or any(fnmatchcase(kind, p) for p in self.products) else ""

    def record(
        self, t_s: FloatArray, tracks: Iterable[ModelTrack], pauses: bool, until_s: float
    ) -> KitRecord:
        """The contents of kits that the poses show; see `KitPoses`."""
        return KitPoses(t_s, tracks, self, pauses=pauses, until_s=until_s)


class KitPoses(KitRecord):
    """The contents of kits that the poses of one log show.

    Args:
        t_s: Time of each frame, shape (n,), s of trial time, as recorded.
        tracks: The models and links that it follows.
        kits: Where kits lie.
        pauses: Whether the log leaves out what does not change, so that its last frame
            holds until the next one, however late that is.
        until_s: After this nothing is known, s.
    """

    def __init__(
        self,
        t_s: FloatArray,
        tracks: Iterable[ModelTrack],
        kits: KitsOfModels,
        *,
        pauses: bool,
        until_s: float = math.inf,
    ) -> None:
        self._t_s, self._kits, self._pauses, self._until_s = t_s, kits, pauses, until_s
        # Two runs in one log would be mixed up.
        self._usable = len(t_s) > 0 and float(np.diff(t_s).min(initial=0.0)) >= -LARGEST_STEP_BACK_S
        self._tracks = sorted(tracks, key=lambda track: track.name)
        self._products = _best_of_each_model(t for t in self._tracks if kits.type_of(t.model))

    def seen(self, place: str, t_s: float, *, max_age_s: float) -> Kit | None:
        """What lay at a place at a time; `None` when the log does not show it.

        Unknown is a place without a tray in the log, a time before its first frame, two
        loose trays on one AGV, a product whose pose is not usable, and one that lies there
        before and after, but is not in the log in between.
        """
        frame = self._frame_at(t_s, max_age_s)
        if frame is None:
            return None
        try:
            for tray in self._kits.trays:
                kit = self._on(tray, place, frame)
                if kit is not None:
                    return kit
        except ValueError:
            return None  # a pose that lacks, or is not usable: whether the thing lay on the tray is unknown
        return None

    def _frame_at(self, t_s: float, max_age_s: float) -> int | None:
        """The last frame at or before a time, of those at one time the last."""
        if not self._usable or t_s > self._until_s:
            return None
        # Stamps may step back a little, so the latest time is looked for, and not the last frame.
        before = np.flatnonzero(self._t_s <= t_s)
        if not len(before):
            return None
        latest = float(self._t_s[before].max())
        if not self._pauses and t_s - latest > max_age_s:
            return None
        return int(before[self._t_s[before] == latest][-1])

    def _on(self, tray: TrayMatch, place: str, frame: int) -> Kit | None:
        # Places have the names of the simulators: `agv1` to `agv4`, `as1` to `as4`.
        if not place.startswith("agv" if tray.at == "agv" else "as"):
            return None
        pattern = tray.pattern_for(place)
        bases = [t for t in self._tracks if fnmatchcase(t.name, pattern) and t.exists(frame)]
        if not bases:
            return None
        # Tracks are sorted by name: of several that match, always the same one.
        base, found = bases[0].pose(frame), None
        on: LooseTray = tray
        t_s, faults = float(self._t_s[frame]), _FAULTS[self._kits.names]
        # From 2022 on products are seen on a movable tray alone.
        if tray.loose:
            standing = self._loose(tray, tray.loose, base, frame)
            if not standing:
                return Kit(place, t_s, (), Tray(""), faults)
            if len(standing) > 1:
                return None  # the simulator takes one of them, and nothing says which
            name, base, found_pose = standing[0]
            on, found = tray.loose, Tray(name, found_pose)
        lying = []
        for product in self._products:
            if product.exists(frame):
                pose = product.pose(frame).seen_from(base)
                if on.holds(pose.position_m):
                    lying.append(Product(self._kits.type_of(product.model), pose, name=product.model))
            else:
                _refuse_between(product, frame, on, base)
        return Kit(
            place, t_s, _in_known_order(lying) if self._kits.names == "part" else tuple(lying), found, faults
        )

    def _loose(
        self, tray: TrayMatch, loose: LooseTray, base: Pose, frame: int
    ) -> list[tuple[str, Pose, Pose]]:
        """The loose trays that stand on a base: type, pose in the world, and on the base."""
        found = []
        for track in self._tracks:
            if fnmatchcase(track.name, loose.match) and track.exists(frame):
                pose = track.pose(frame)
                on_base = pose.seen_from(base)
                if tray.holds(on_base.position_m):
                    name = track.model if self._kits.names == "part" else product_type(track.model)
                    found.append((name, pose, on_base))
            elif fnmatchcase(track.name, loose.match):
                _refuse_between(track, frame, tray, base)
        return found


def _refuse_between(track: ModelTrack, frame: int, on: LooseTray, base: Pose) -> None:
    """Refuse to say what lies on something where what lay there before, or does after, is not listed.

    Raises:
        ValueError: It may have lain there.
    """
    around = track.around(frame)
    if around is not None and any(on.holds(pose.seen_from(base).position_m) for pose in around):
        raise ValueError(f"{track.name!r} is not listed, and is before and after")


def _best_of_each_model(tracks: Iterable[ModelTrack]) -> list[ModelTrack]:
    """For each product its link where it has one alone, for links are recorded with more digits."""
    of_model: dict[str, list[ModelTrack]] = {}
    for track in tracks:
        of_model.setdefault(track.model, []).append(track)
    best = []
    for name, found in of_model.items():
        links = [track for track in found if track.name != name]
        own = [track for track in found if track.name == name]
        best += links if len(links) == 1 else own
    return best


def _in_known_order(products: Sequence[Product]) -> tuple[Product, ...]:
    """Products by name; those that the order of a sensor's list would decide between lose their pose.

    In 2023 and later the last part listed in a quadrant counts, and poses do not say
    which that is. They stand first, where a part with a pose is found before them.
    """
    quadrants = [_quadrant(product) for product in products]
    rivals = [
        replace(p, pose=None) for p, q in zip(products, quadrants, strict=True) if quadrants.count(q) > 1
    ]
    alone = [p for p, q in zip(products, quadrants, strict=True) if quadrants.count(q) == 1]
    return (*rivals, *alone)


def _quadrant(product: Product) -> tuple[bool, bool]:
    assert product.pose is not None  # it was found by its place
    x, y, _ = product.pose.position_m
    return x >= 0, y >= 0
