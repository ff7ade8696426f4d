"""Where the parts lie on the tray, and the tray on its AGV."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

from ariac_score import Finding, Limit, Measure, Pose, Trial, parameter
from ariac_score_ariac.parts import spoken
from ariac_score_ariac.tasks.claims import (
    EMPTY_KIT,
    NOT_SUBMITTED,
    CountsFrom,
    claimed,
    kitting_tasks,
    not_kits,
    undecidable,
    unseen,
)
from ariac_score_ariac.tasks.contents import sound
from ariac_score_ariac.tasks.names import TypeNames, base_type, delivered_type
from ariac_score_ariac.work import Order, Product, Task, Tray, WantedProduct


@dataclass(frozen=True)
class PoseError:
    """How far a delivered pose is from the wanted one.

    Attributes:
        distance_m: In the plane of the tray; height does not count.
        quaternion_dot: Absolute dot product of the two quaternions as recorded.
        heading_error_rad: Difference of the yaw angles, not negative.
        rotation_rad: Angle of the whole rotation from one to the other, 0 to pi.
    """

    distance_m: float
    quaternion_dot: float
    heading_error_rad: float
    rotation_rad: float

    @classmethod
    def between(cls, wanted: Pose, delivered: Pose) -> PoseError:
        """The error of a delivered pose.

        Source: rulebooks, sections 0.3 and 0.4: nothing is normalised before the dot
        product, yaw is read from a normalised copy.
        """
        dx, dy = (d - w for w, d in zip(wanted.position_m[:2], delivered.position_m[:2], strict=True))
        return cls(
            math.sqrt(dx * dx + dy * dy),
            wanted.quaternion_dot(delivered),
            abs(delivered.yaw_rad - wanted.yaw_rad),
            wanted.rotation_to(delivered),
        )


POSE_MEASURES: Mapping[str, Measure] = {
    "distance_m": Measure("m", best=0.0, signed=False, meaning="how far from its place"),
    "quaternion_dot_1": Measure(
        "1", best=1.0, worst=0.0, meaning="absolute dot product of the two orientations"
    ),
    "heading_error_rad": Measure(
        "rad",
        best=0.0,
        worst=2 * math.pi,
        signed=False,
        meaning="error of the yaw, by the coded test up to a whole turn",
    ),
    "rotation_rad": Measure(
        "rad", best=0.0, worst=math.pi, signed=False, meaning="angle of the whole rotation"
    ),
}
"""What is measured of a pose against the ordered one, as far as there is a limit for it."""


@dataclass(frozen=True)
class PoseTest:
    """Whether a part lies where it is wanted.

    Attributes:
        max_distance_m: Largest distance in the plane; equality passes.
        min_quaternion_dot: Least absolute dot product; equality passes. `None`: no test.
        max_heading_error_rad: Bound of the yaw error, equality failing unless
            `heading_limit_passes`; the long way round equality passes. `None`: no test.
        heading_limit_passes: Whether a yaw error at the bound passes.
        normalise_delivered: Whether the delivered quaternion gets norm 1 first.
        max_rotation_rad: Largest angle of the whole rotation, whatever its axis; equality
            passes. `None`: no test.

    Source:
        Rulebooks, sections 0.3 and 0.4; the whole rotation: "the orientation must be
        within 0.1 radians", scoring pages of 2017 to 2021.
    """

    max_distance_m: float
    min_quaternion_dot: float | None
    max_heading_error_rad: float | None
    heading_limit_passes: bool = False
    normalise_delivered: bool = False
    max_rotation_rad: float | None = None

    def error(self, wanted: Pose, delivered: Pose) -> PoseError:
        """The error of a delivered pose as this test sees it."""
        # The ordered one is never normalised, in no edition.
        return PoseError.between(wanted, delivered.normalised() if self.normalise_delivered else delivered)

    def limits(self, error: PoseError) -> tuple[Limit, ...]:
        """The errors against their limits."""
        limits = [Limit("distance", error.distance_m, "m", at_most=self.max_distance_m)]
        if self.min_quaternion_dot is not None:
            limits.append(
                Limit("quaternion dot", error.quaternion_dot, "1", at_least=self.min_quaternion_dot)
            )
        if self.max_rotation_rad is not None:
            limits.append(Limit("rotation", error.rotation_rad, "rad", at_most=self.max_rotation_rad))
        if self.max_heading_error_rad is not None:
            # The coded test: |d| < bound, or ||d| - 2 pi| <= bound. The bound itself passes the second alone.
            heading = min(error.heading_error_rad, abs(error.heading_error_rad - 2 * math.pi))
            strict = heading == error.heading_error_rad and not self.heading_limit_passes
            limits.append(
                Limit("heading error", heading, "rad", at_most=self.max_heading_error_rad, strict=strict)
            )
        return tuple(limits)

    def passes(self, wanted: Pose | None, delivered: Pose | None) -> bool:
        """Whether both poses are known and the delivered one keeps every limit."""
        if wanted is None or delivered is None:
            return False
        return all(limit.kept for limit in self.limits(self.error(wanted, delivered)))


@dataclass(frozen=True)
class KitPose:
    """Each part lies where the order wants it.

    Measures:
        Distance in the tray's plane, absolute dot product of the quaternions (part
        facing), yaw error, and angle of the whole rotation of each part, as far as they
        have a limit. Parts of one exact type (`compare: type`: of one type, whatever
        their colour) are assigned to their slots so that as many as possible pass
        (`best_assignment`), or in order of delivery each to the first free slot where
        it passes (`greedy`).
    Violated when:
        No delivered part of the right type and colour (`compare: type`: of the right
        type) passes at the slot: distance above its limit, dot product below its limit,
        rotation above its limit (limits themselves pass), or yaw error at or above its
        limit (`heading_limit_passes`: above it), a full turn allowed for.
    Source:
        ARIAC 2019-2022 as coded: pose test P(0.03 m, 0.1 rad), best assignment. 2017
        and 2018 as coded: greedy, the delivered quaternion normalised, a yaw error at
        the limit passing. 2017 to 2022 as documented: within 3 cm and 0.1 rad, from
        2020 on whatever the colour.
    Attributes:
        heading_limit_passes: Whether a heading error at its limit passes.
        normalise_delivered: Whether the delivered orientation is normalised first.
        matching: How parts are assigned to places.
        counts_from: The version of the order since which submissions count.
        compare: What of a part must be right.
        type_names: Which part of a name is the type.
    """

    when_cut: ClassVar[str] = "witnessed"
    mistake: ClassVar[tuple[str, str]] = ("wrong pose", "wrong poses")

    measures: ClassVar[Mapping[str, Measure]] = POSE_MEASURES

    max_distance_m: float = parameter(0.03, unit="m", status="")
    min_quaternion_dot: float | None = 0.95
    max_heading_error_rad: float | None = parameter(0.1, unit="rad", status="")
    max_rotation_rad: float | None = parameter(None, unit="rad", status="")
    compare: Literal["type_and_color", "type"] = "type_and_color"
    heading_limit_passes: bool = False
    normalise_delivered: bool = False
    matching: Literal["best_assignment", "greedy"] = "best_assignment"
    type_names: TypeNames = "whole"
    counts_from: CountsFrom = "update"

    @property
    def test(self) -> PoseTest:
        """The test of one part at one slot."""
        return PoseTest(
            self.max_distance_m,
            self.min_quaternion_dot,
            self.max_heading_error_rad,
            self.heading_limit_passes,
            self.normalise_delivered,
            self.max_rotation_rad,
        )

    def _kind(self, product_type: str) -> str:
        """What products must have in common to compete for a slot."""
        return base_type(product_type) if self.compare == "type" else product_type

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each wanted product of each kitting task."""
        clause = "ARIAC scoring, product pose"
        yield from not_kits(order)
        for subject, task in kitting_tasks(order):
            submission = claimed(trial, order, task, self.counts_from)
            if not task.products:
                yield Finding.not_applicable(subject, EMPTY_KIT, clause=clause)
                continue
            unknown = undecidable(trial, submission, subject, clause, task, order=order)
            for wanted in task.products:
                slot = f"{subject}/{wanted.slot}"
                if unknown:
                    yield replace(unknown, subject=slot)
                elif submission is None:
                    yield Finding.violated(slot, f"{spoken(wanted.type)}: {NOT_SUBMITTED}", clause=clause)
            if submission is not None and not unknown:
                yield from self._placed(subject, task, submission.contents or (), clause)

    def _placed(
        self, subject: str, task: Task, contents: tuple[Product, ...], clause: str
    ) -> Iterator[Finding]:
        # As coded each exact type is a search of its own.
        findings: dict[str, Finding] = {}
        for kind in sorted({self._kind(wanted.type) for wanted in task.products}):
            slots = [wanted for wanted in task.products if self._kind(wanted.type) == kind]
            parts = [
                part
                for part in sound(contents)
                if self._kind(delivered_type(part.type, self.type_names)) == kind
            ]
            findings |= self._assigned(subject, slots, parts, clause)
        yield from (findings[wanted.slot] for wanted in task.products)

    def _assigned(
        self, subject: str, slots: Sequence[WantedProduct], parts: Sequence[Product], clause: str
    ) -> dict[str, Finding]:
        """The finding of each slot of products that compete."""
        passing = [[j for j, p in enumerate(parts) if self.test.passes(slot.pose, p.pose)] for slot in slots]
        match = (
            best_assignment(passing)
            if self.matching == "best_assignment"
            else greedy_assignment(passing, len(parts))
        )
        unseen = any(part.pose is None for part in parts)
        return {
            slot.slot: self._finding(f"{subject}/{slot.slot}", slot, parts, match[i], unseen, clause)
            for i, slot in enumerate(slots)
        }

    def _finding(
        self,
        subject: str,
        slot: WantedProduct,
        parts: Sequence[Product],
        matched: int | None,
        unseen: bool,
        clause: str,
    ) -> Finding:
        if slot.pose is None:
            return Finding.inconclusive(subject, "the order gives no pose that can be used", clause=clause)
        if matched is None and unseen:
            return Finding.inconclusive(
                subject, f"the pose of a {spoken(slot.type)} is not usable", clause=clause
            )
        errors = [self.test.error(slot.pose, p.pose) for p in parts if p.pose is not None]
        if matched is not None:
            pose = parts[matched].pose
            assert pose is not None  # only a part with a pose passes
            nearest = self.test.error(slot.pose, pose)
        elif errors:
            # Which part was meant is unknown; the nearest shows the least that is wrong.
            nearest = min(errors, key=lambda error: error.distance_m)
        else:
            return Finding.violated(subject, f"no {spoken(slot.type)} on the tray", clause=clause)
        limits = self.test.limits(nearest)
        # It passes here too, but there were more slots than parts.
        if matched is None and all(limit.kept for limit in limits):
            return Finding.violated(
                subject, f"the {spoken(slot.type)} near it counts for another slot", clause=clause
            )
        return Finding.from_limits(subject, *limits, clause=clause)


def greedy_assignment(passing: Sequence[Sequence[int]], parts: int) -> list[int | None]:
    """Assign each part in turn to the first free slot where it passes.

    Fewer slots may be filled than by the best assignment.

    Args:
        passing: For each slot the parts that pass there.
        parts: How many parts there are.

    Returns:
        For each slot its part, or `None`.

    Source:
        Rulebooks, section 1, code: pose.

    >>> greedy_assignment([[0, 1], [0]], 2)
    [0, None]
    """
    # Parts outside, slots inside: the order of delivery decides, as coded.
    part_of: list[int | None] = [None] * len(passing)
    for part in range(parts):
        for slot, fitting in enumerate(passing):
            if part_of[slot] is None and part in fitting:
                part_of[slot] = part
                break
    return part_of


def best_assignment(passing: Sequence[Sequence[int]]) -> list[int | None]:
    """Assign parts to slots so that as many slots as possible get a part that passes.

    A maximum bipartite matching by augmenting paths; the number of pairs is that of
    the official search over all permutations.

    Args:
        passing: For each slot the parts that pass there.

    Returns:
        For each slot its part, or `None`.

    >>> best_assignment([[0, 1], [0], []])
    [1, 0, None]
    """
    slot_of: dict[int, int] = {}

    def augment(slot: int, seen: set[int]) -> bool:
        for part in passing[slot]:
            if part not in seen:
                seen.add(part)
                if part not in slot_of or augment(slot_of[part], seen):
                    slot_of[part] = slot
                    return True
        return False

    for slot in range(len(passing)):
        augment(slot, set())
    part_of = {slot: part for part, slot in slot_of.items()}
    return [part_of.get(slot) for slot in range(len(passing))]


def best_total(worth: Sequence[Sequence[int | None]]) -> list[int | None]:
    """Assign parts to slots so that they are worth the most together.

    Of equal totals the one that gives earlier slots earlier parts.

    Args:
        worth: For each slot what each part is worth there, more than 0, or `None` where it does not fit.
            A dozen parts at most: every set of parts taken is looked at.

    Returns:
        For each slot its part, or `None`.

    >>> best_total([[3, 2], [2, None]])
    [1, 0]
    """
    # By the set of parts taken, as bits: the most it brings, and how.
    reached: dict[int, tuple[int, list[int | None]]] = {0: (0, [])}
    for row in worth:
        further: dict[int, tuple[int, list[int | None]]] = {}
        for taken, (total, parts) in reached.items():
            fitting = [(j, value) for j, value in enumerate(row) if value is not None and not taken >> j & 1]
            options: list[tuple[int, int, int | None]] = [(taken | 1 << j, v, j) for j, v in fitting]
            for key, value, part in [*options, (taken, 0, None)]:
                if key not in further or further[key][0] < total + value:
                    further[key] = (total + value, [*parts, part])
        reached = further
    return max(reached.values(), key=lambda found: found[0])[1]


@dataclass(frozen=True)
class TrayRight:
    """The kit is built on the ordered movable tray, which lies where it should.

    Measures:
        The tray's type, its pose against the middle of the AGV, or whether there is one.
    Violated when:
        `type`: the type differs. `pose`: the distance in the plane exceeds its limit, the
        dot product is below its limit, or the whole rotation exceeds its limit (the
        limits themselves pass), or there is no tray. `present`: there is none.
    Source:
        ARIAC 2022 as coded: 0.10 m and |dot| 0.95. As documented: 0.02 m and 0.1 rad,
        and without a tray a kit is worth nothing.
    Attributes:
        compare: What of the tray must be right.
        max_distance_m: How far it may be from its place.
    """

    when_cut: ClassVar[str] = "witnessed"
    mistake: ClassVar[tuple[str, str]] = ("wrong tray", "wrong trays")

    measures: ClassVar[Mapping[str, Measure]] = POSE_MEASURES

    compare: Literal["type", "pose", "present"] = "type"
    max_distance_m: float = parameter(0.10, unit="m", status="")
    min_quaternion_dot: float | None = 0.95
    max_rotation_rad: float | None = parameter(None, unit="rad", status="")

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task."""
        clause = "ARIAC 2022 scoring, movable tray"
        yield from not_kits(order)
        for subject, task in kitting_tasks(order):
            submission = claimed(trial, order, task)
            if task.tray is None:
                yield Finding.not_applicable(subject, "no movable tray is ordered", clause=clause)
            elif why := unseen(trial, submission, task):
                yield Finding.inconclusive(subject, why, clause=clause)
            elif submission is None:
                yield Finding.not_applicable(subject, NOT_SUBMITTED, clause=clause)
            elif submission.tray is None:
                yield Finding.inconclusive(subject, "the log does not show the tray", clause=clause)
            else:
                yield self._tray(subject, task.tray, submission.tray, clause)

    def _tray(self, subject: str, wanted: Tray, got: Tray, clause: str) -> Finding:
        if not got.type:
            return Finding.violated(subject, "the kit was built without a tray", clause=clause)
        if self.compare != "pose":
            right = self.compare == "present" or got.type == wanted.type
            make = Finding.satisfied if right else Finding.violated
            return make(subject, f"tray {got.type}, ordered {wanted.type}", clause=clause)
        if got.pose is None:
            return Finding.inconclusive(subject, "the log does not show the tray's pose", clause=clause)
        # Without a limit of the yaw: the coded one, 0.35 rad, has no effect (rulebook, section 6).
        test = PoseTest(
            self.max_distance_m, self.min_quaternion_dot, None, max_rotation_rad=self.max_rotation_rad
        )
        # Rulebook 2022: the ordered pose is the identity at the middle of the AGV.
        error = test.error(wanted.pose or Pose((0.0, 0.0, 0.0)), got.pose)
        return Finding.from_limits(subject, *test.limits(error), clause=clause)
