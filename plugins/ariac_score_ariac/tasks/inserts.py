"""Assemblies of 2023 and later: parts in the insert, as the assembly station's sensors saw them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from ariac_score import Finding, Limit, Measure, Pose, Trial, parameter
from ariac_score_ariac.parts import part_of, spoken
from ariac_score_ariac.tasks.poses import POSE_MEASURES, best_total
from ariac_score_ariac.tasks.quadrants import Sight, not_judged, sight, tasks_of
from ariac_score_ariac.work import Order, Product, Task, WantedProduct

KINDS = ("assembly", "combined")
"""Both are built in an insert; they differ in their points and in where the parts come from."""
CLAUSE = "ARIAC 2023 and 2024, assembly as coded"

_INSERT = "assembly_insert"
_INSERT_NUMBER = 16
"""The simulator takes this one character of the name for the number, so inserts end at 9."""


def insert_number(model: str) -> int | None:
    """The number in the name of an assembly insert; `None` when the name is of another form.

    >>> insert_number("assembly_insert_2"), insert_number("briefcase")
    (2, None)
    """
    digit = model[_INSERT_NUMBER : _INSERT_NUMBER + 1]
    return int(digit) if model.startswith(_INSERT) and digit.isascii() and digit.isdigit() else None


def station_number(station: str) -> int | None:
    """The number in the name of an assembly station; `None` when the name is of another form.

    >>> station_number("as4"), station_number("ks1")
    (4, None)
    """
    digits = station.removeprefix("as")
    return int(digits) if digits != station and digits.isascii() and digits.isdigit() else None


@dataclass(frozen=True)
class InsertSeen:
    """The insert was seen at the ordered station.

    Measures:
        The station of the submission, and the number in the insert's name where the
        log has it, against the ordered station.
    Violated when:
        They differ, no insert was seen, or the order was never handed in.
    Source:
        ARIAC 2023 and 2024 as coded: the station factor.
    """

    when_cut: ClassVar[str] = "witnessed"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each assembly or combined task."""
        for task in order.tasks:
            if task.kind not in KINDS:
                yield Finding.not_applicable(
                    f"{order.id}/{task.id}", f"a task of kind {task.kind} has no insert", clause=CLAUSE
                )
        for subject, task in tasks_of(order, KINDS):
            yield self._insert(subject, task, sight(trial, order, task))

    def _insert(self, subject: str, task: Task, seen: Sight) -> Finding:
        wanted = station_number(task.station)
        if wanted is None:
            return Finding.inconclusive(subject, "the order names no assembly station", clause=CLAUSE)
        if seen.nothing:
            return Finding.violated(subject, seen.nothing, clause=CLAUSE)
        if seen.submission is None or seen.unknown:
            return Finding.inconclusive(subject, seen.unknown, clause=CLAUSE)
        insert = seen.submission.tray
        # Parts are seen at the ordered station alone. So an insert whose name no log has was the right one.
        got = wanted if insert is None else insert_number(insert.type)
        if insert is not None and got is None:
            message = f"{insert.type!r} names no insert such as assembly_insert_2"
            return Finding.inconclusive(subject, message, clause=CLAUSE)
        make = Finding.satisfied if got == wanted else Finding.violated
        return make(
            subject, f"insert {got} at {seen.submission.station}, ordered {task.station}", clause=CLAUSE
        )


@dataclass(frozen=True)
class InsertedPart:
    """Parts in the insert are as ordered, in one respect.

    Measures:
        Each ordered product against each part of its type in the insert, so that two
        parts of one type are two findings for each product of that type (`counting:
        each_pair`); or against one part of its type, assigned so that colours and poses
        agree the most (`one_per_slot`). `type` says that there is a part; `color`
        compares colours; `pose` the distance in space, the absolute dot product of the
        quaternions as recorded, and the angle of the whole rotation, as far as they have
        a limit, in the frame of the insert; `color_and_pose` both. Whether a part is
        faulty, or was ever inserted, does not matter.
    Violated when:
        No part of the type is there; its colour differs; the distance or the rotation
        exceeds its limit or the dot product is below its limit (the limits themselves
        pass).
    Source:
        ARIAC 2023 and 2024 as coded: 0.02 m and |dot| 0.95, every pair of one type. As
        documented: 15 degrees, one part for each slot.
    Attributes:
        compare: What of a part must be right.
        max_distance_m: How far it may be from its place.
        counting: Whether every part of the type is compared, or one for each place.
    """

    when_cut: ClassVar[str] = "witnessed"
    measures: ClassVar[Mapping[str, Measure]] = POSE_MEASURES

    compare: Literal["type", "color", "pose", "color_and_pose"] = "type"
    max_distance_m: float = parameter(0.02, unit="m", status="")
    min_quaternion_dot: float | None = 0.95
    max_rotation_rad: float | None = parameter(None, unit="rad", status="")
    counting: Literal["each_pair", "one_per_slot"] = "each_pair"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each pair of a wanted product and a part of its type, or that there is none."""
        yield from not_judged(order, KINDS)
        for subject, task in tasks_of(order, KINDS):
            seen = sight(trial, order, task)
            if not task.products:
                yield Finding.not_applicable(subject, "no product is ordered", clause=CLAUSE)
            of_slot = self._assigned(task.products, seen.parts) if self.counting == "one_per_slot" else None
            for wanted in task.products:
                yield from self._pairs(f"{subject}/{wanted.slot}", wanted, seen, of_slot)

    def _assigned(
        self, ordered: Sequence[WantedProduct], parts: Sequence[Product]
    ) -> Mapping[str, Product | None] | None:
        """One part or none for each slot; `None` where a pose that decides about it is not usable."""
        alike = [[part for part in parts if _type(part.type) == _type(wanted.type)] for wanted in ordered]
        for wanted, rivals in zip(ordered, alike, strict=True):
            if len(rivals) > 1 and (wanted.pose is None or any(part.pose is None for part in rivals)):
                return None
        # As documented one part fills one slot; of several ways that which is worth the most.
        worth = [[self._worth(wanted, part) for part in parts] for wanted in ordered]
        return {
            wanted.slot: None if i is None else parts[i]
            for wanted, i in zip(ordered, best_total(worth), strict=True)
        }

    def _worth(self, wanted: WantedProduct, part: Product) -> int | None:
        """How well a part fits a slot; `None` where its type is another."""
        if _type(part.type) != _type(wanted.type):
            return None
        known = wanted.pose is not None and part.pose is not None
        placed = known and all(limit.kept for limit in self.limits(wanted.pose, part.pose))  # type: ignore[arg-type]
        return 1 + (part_of(part.type) == part_of(wanted.type)) + placed

    def _pairs(
        self, subject: str, wanted: WantedProduct, seen: Sight, of_slot: Mapping[str, Product | None] | None
    ) -> Iterator[Finding]:
        ordered = part_of(wanted.type)
        if seen.unknown or ordered is None:
            why = seen.unknown or f"{wanted.type!r} is no part of 2023 or later"
            yield Finding.inconclusive(subject, why, clause=CLAUSE)
            return
        alike = [part for part in seen.parts if (part_of(part.type) or ("", ""))[0] == ordered[0]]
        if self.counting == "one_per_slot" and alike:
            if of_slot is None:
                why = f"a pose that decides which {ordered[0]} counts is not usable"
                yield Finding.inconclusive(subject, why, clause=CLAUSE)
                return
            chosen = of_slot[wanted.slot]
            alike = [] if chosen is None else [chosen]
        if not alike:
            words = seen.nothing or f"no {ordered[0]} in the insert for it"
            yield Finding.violated(subject, words, clause=CLAUSE)
        # As coded the points of all pairs add up, so that two parts of a type count twice for each slot.
        for number, part in enumerate(alike, start=1):
            name = f"{part.name or spoken(part.type)}" + (
                f" ({number} of {len(alike)})" if len(alike) > 1 else ""
            )
            yield self._pair(subject, wanted, part, name)

    def _pair(self, subject: str, wanted: WantedProduct, part: Product, name: str) -> Finding:
        right_color = part_of(part.type) == part_of(wanted.type)
        if self.compare == "type" or (self.compare == "color" and right_color):
            return Finding.satisfied(subject, f"{name} is in the insert", clause=CLAUSE)
        if self.compare in ("color", "color_and_pose") and not right_color:
            return Finding.violated(subject, f"{name}, ordered {spoken(wanted.type)}", clause=CLAUSE)
        if wanted.pose is None or part.pose is None:
            why = (
                "the order gives no pose that can be used"
                if wanted.pose is None
                else f"the pose of {name} is not usable"
            )
            return Finding.inconclusive(subject, why, clause=CLAUSE)
        limits = self.limits(wanted.pose, part.pose)
        message = "; ".join(map(str, [limit for limit in limits if not limit.kept] or limits))
        return Finding.from_limits(subject, *limits, clause=CLAUSE, message=f"{name}: {message}")

    def limits(self, wanted: Pose, found: Pose) -> tuple[Limit, ...]:
        """Distance in space, dot product of the quaternions as recorded, rotation, against their limits."""
        # With the height, unlike the tests of 2017 to 2022.
        (wx, wy, wz), (fx, fy, fz) = wanted.position_m, found.position_m
        dx, dy, dz = fx - wx, fy - wy, fz - wz
        distance_m = math.sqrt(dx * dx + dy * dy + dz * dz)
        limits = [Limit("distance", distance_m, "m", at_most=self.max_distance_m)]
        # As coded 0.95, some 36 degrees; the constant for the documented 15 degrees is never used.
        if self.min_quaternion_dot is not None:
            dot = wanted.quaternion_dot(found)
            limits.append(Limit("quaternion dot", dot, "1", at_least=self.min_quaternion_dot))
        if self.max_rotation_rad is not None:
            rotation_rad = wanted.rotation_to(found)
            limits.append(Limit("rotation", rotation_rad, "rad", at_most=self.max_rotation_rad))
        return tuple(limits)


def _type(product_type: str) -> str:
    """The bare type that a model's name contains; empty when it is no part."""
    part = part_of(product_type)
    return part[0] if part else ""


PART_ASSEMBLED = "part_assembled"
"""Kind of the event that an insert reports a part as assembled: subject its station, detail the bare type."""


@dataclass(frozen=True)
class PartAssembled:
    """The part of each slot was reported as assembled.

    Measures:
        Events `part_assembled` up to the submission, as the insert at the ordered
        station reports them: the station is the event's subject, the bare type of the
        part (such as `battery`) its detail.
    Violated when:
        A part of the type is seen in the insert, but no such event came, in a log that
        shows them; in one that does not it is inconclusive. Not applicable where no
        part of the type is seen.
    Source:
        ARIAC 2023 and 2024 as documented: isAssembled, the part in the slot is reported
        as assembled (topic assembly_insert_n_assembly_state).
    """

    when_cut: ClassVar[str] = "witnessed"
    mistake: ClassVar[tuple[str, str]] = ("part not assembled", "parts not assembled")

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each wanted product of each assembly or combined task."""
        yield from not_judged(order, KINDS)
        for subject, task in tasks_of(order, KINDS):
            seen = sight(trial, order, task)
            if not task.products:
                yield Finding.not_applicable(subject, "no product is ordered", clause=CLAUSE)
            for wanted in task.products:
                yield self._slot(f"{subject}/{wanted.slot}", trial, task, wanted, seen)

    def _slot(self, subject: str, trial: Trial, task: Task, wanted: WantedProduct, seen: Sight) -> Finding:
        kind = _type(wanted.type)
        if seen.unknown or not kind:
            why = seen.unknown or f"{wanted.type!r} is no part of 2023 or later"
            return Finding.inconclusive(subject, why, clause=CLAUSE)
        if seen.submission is None or not any(_type(part.type) == kind for part in seen.parts):
            return Finding.not_applicable(subject, seen.nothing or f"no {kind} in the insert", clause=CLAUSE)
        reported = any(
            event.subject == task.station
            and event.detail == kind
            and event.t_s <= seen.submission.submitted_s
            for event in trial.events_of(PART_ASSEMBLED)
        )
        if reported:
            return Finding.satisfied(subject, f"the {kind} was reported as assembled", clause=CLAUSE)
        if PART_ASSEMBLED not in trial.witnessed:
            why = f"the log does not show whether the {kind} was assembled"
            return Finding.inconclusive(subject, why, clause=CLAUSE)
        return Finding.violated(subject, f"the {kind} was never reported as assembled", clause=CLAUSE)
