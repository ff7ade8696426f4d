"""Where the parts lie on the tray, and the tray on its AGV."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from ariac_score import Finding, Limit, Order, Pose, Product, Task, Trial, WantedProduct
from ariac_score_kitting.claims import EMPTY_KIT, NOT_SUBMITTED, claimed, kitting_tasks, not_kits, undecidable


@dataclass(frozen=True)
class PoseError:
    """How far a delivered pose is from the wanted one.

    Attributes:
        distance_m: In the plane of the tray; height does not count.
        quaternion_dot: Absolute dot product of the two quaternions as recorded.
        heading_error_rad: Difference of the yaw angles, not negative.
        facing_error_rad: Angle between the two vertical axes; pi is upside down.
    """

    distance_m: float
    quaternion_dot: float
    heading_error_rad: float
    facing_error_rad: float

    @classmethod
    def between(cls, wanted: Pose, delivered: Pose) -> PoseError:
        """The error of a delivered pose.

        Source: rulebooks, sections 0.3 and 0.4: nothing is normalised before the dot
        product, yaw is read from a normalised copy.
        """
        dx, dy = (d - w for w, d in zip(wanted.position_m[:2], delivered.position_m[:2], strict=True))
        dot = _dot(wanted.orientation_wxyz, delivered.orientation_wxyz)
        cosine = _dot(_up(wanted), _up(delivered))
        return cls(
            math.sqrt(dx * dx + dy * dy),
            abs(dot),
            abs(delivered.yaw_rad - wanted.yaw_rad),
            math.acos(min(1.0, max(-1.0, cosine))),
        )


def _dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Scalar product, added up left to right as the simulator does.

    Not by `sum`: from Python 3.12 on it rounds differently, which would decide at a limit.
    """
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total


def _up(pose: Pose) -> tuple[float, float, float]:
    """The part's own vertical axis in the tray frame."""
    norm = math.sqrt(_dot(pose.orientation_wxyz, pose.orientation_wxyz))
    w, x, y, z = (v / norm for v in pose.orientation_wxyz)
    return 2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z


@dataclass(frozen=True)
class KitPose:
    """Each part lies where the order wants it.

    Measures:
        Distance in the tray's plane, absolute dot product of the quaternions (part
        facing) and yaw error of each part. Parts of one exact type are assigned to
        their slots so that as many as possible pass.
    Violated when:
        No delivered part of the right type and colour passes at the slot: distance
        above its limit, dot product below its limit (limits themselves pass), or yaw
        error at or above its limit, a full turn allowed for.
    Source:
        ARIAC 2019-2022 as coded: pose test P(0.03 m, 0.1 rad), best assignment.
    """

    max_distance_m: float = 0.03
    min_quaternion_dot: float = 0.95
    max_heading_error_rad: float = 0.1

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each wanted product of each kitting task."""
        clause = "ARIAC scoring, product pose"
        yield from not_kits(order)
        for subject, task in kitting_tasks(order):
            submission = claimed(trial, order, task)
            if not task.products:
                yield Finding.not_applicable(subject, EMPTY_KIT, clause=clause)
                continue
            for wanted in task.products:
                slot = f"{subject}/{wanted.slot}"
                unknown = undecidable(trial, submission, slot, clause)
                if unknown:
                    yield unknown
                elif submission is None:
                    yield Finding.violated(slot, f"{wanted.type}: {NOT_SUBMITTED}", clause=clause)
            if submission is not None and submission.contents is not None:
                yield from self._placed(subject, task, submission.contents, clause)

    def _placed(
        self, subject: str, task: Task, contents: tuple[Product, ...], clause: str
    ) -> Iterator[Finding]:
        findings: dict[str, Finding] = {}
        for kind in sorted({wanted.type for wanted in task.products}):
            slots = [wanted for wanted in task.products if wanted.type == kind]
            parts = [product for product in contents if product.type == kind and not product.faulty]
            findings |= self._assigned(subject, slots, parts, clause)
        yield from (findings[wanted.slot] for wanted in task.products)

    def _assigned(
        self, subject: str, slots: Sequence[WantedProduct], parts: Sequence[Product], clause: str
    ) -> dict[str, Finding]:
        """The finding of each slot of one exact product type."""
        passing = [[j for j, part in enumerate(parts) if self._passes(slot, part)] for slot in slots]
        match = best_assignment(passing)
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
            return Finding.inconclusive(subject, "the order gives no pose", clause=clause)
        if matched is None and unseen:
            return Finding.inconclusive(subject, f"the pose of a {slot.type} is not usable", clause=clause)
        errors = [PoseError.between(slot.pose, p.pose) for p in parts if p.pose is not None]
        if matched is not None:
            pose = parts[matched].pose
            assert pose is not None  # only a part with a pose passes
            nearest = PoseError.between(slot.pose, pose)
        elif errors:
            nearest = min(errors, key=lambda error: error.distance_m)
        else:
            return Finding.violated(subject, f"no {slot.type} on the tray", clause=clause)
        finding = Finding.from_limits(subject, *self._limits(nearest), clause=clause)
        if matched is None and not any(not limit.kept for limit in self._limits(nearest)):
            return Finding.violated(
                subject, f"the {slot.type} near it counts for another slot", clause=clause
            )
        return finding

    def _limits(self, error: PoseError) -> tuple[Limit, ...]:
        heading = min(error.heading_error_rad, abs(error.heading_error_rad - 2 * math.pi))
        over_a_turn = heading != error.heading_error_rad
        return (
            Limit("distance", error.distance_m, "m", at_most=self.max_distance_m),
            Limit("quaternion dot", error.quaternion_dot, "1", at_least=self.min_quaternion_dot),
            Limit(
                "heading error", heading, "rad", at_most=self.max_heading_error_rad, strict=not over_a_turn
            ),
        )

    def _passes(self, slot: WantedProduct, part: Product) -> bool:
        if slot.pose is None or part.pose is None:
            return False
        return all(limit.kept for limit in self._limits(PoseError.between(slot.pose, part.pose)))


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


@dataclass(frozen=True)
class TrayRight:
    """The kit is built on the ordered movable tray, which lies where it should.

    Measures:
        The tray's type, or its pose against the middle of the AGV.
    Violated when:
        The type differs; or the distance in the plane exceeds its limit or the dot
        product is below its limit (the limits themselves pass).
    Source:
        ARIAC 2022 as coded: 0.10 m and |dot| 0.95 (documented: 0.02 m and 0.1 rad).
    """

    compare: Literal["type", "pose"] = "type"
    max_distance_m: float = 0.10
    min_quaternion_dot: float = 0.95

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task."""
        clause = "ARIAC 2022 scoring, movable tray"
        yield from not_kits(order)
        for subject, task in kitting_tasks(order):
            submission = claimed(trial, order, task)
            if task.tray is None:
                yield Finding.not_applicable(subject, "no movable tray is ordered", clause=clause)
            elif submission is None and "submissions" not in trial.witnessed:
                yield Finding.inconclusive(subject, "the log does not show submissions", clause=clause)
            elif submission is None:
                yield Finding.not_applicable(subject, NOT_SUBMITTED, clause=clause)
            elif submission.tray is None:
                yield Finding.inconclusive(subject, "the log does not show the tray", clause=clause)
            elif self.compare == "type":
                got, wanted = submission.tray.type, task.tray.type
                make = Finding.satisfied if got == wanted else Finding.violated
                yield make(subject, f"tray {got}, ordered {wanted}", clause=clause)
            elif submission.tray.pose is None:
                yield Finding.inconclusive(subject, "the log does not show the tray's pose", clause=clause)
            else:
                error = PoseError.between(task.tray.pose or Pose((0.0, 0.0, 0.0)), submission.tray.pose)
                yield Finding.from_limits(
                    subject,
                    Limit("distance", error.distance_m, "m", at_most=self.max_distance_m),
                    Limit("quaternion dot", error.quaternion_dot, "1", at_least=self.min_quaternion_dot),
                    clause=clause,
                )
