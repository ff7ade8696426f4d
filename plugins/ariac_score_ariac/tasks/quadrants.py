"""Kits of 2023 and later: one part for each quadrant of the tray, as the AGV's tray sensor saw them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from ariac_score import Finding, Limit, Measure, Pose, Trial, parameter
from ariac_score_ariac.parts import FAULTY_ENDING, part_of, spoken
from ariac_score_ariac.tasks.claims import EMPTY_KIT, NOT_SUBMITTED, claimed, unseen
from ariac_score_ariac.work import KitSubmission, Order, Product, Task, WantedProduct

QUALITY_CHECK = "quality_check"
"""Kind of the event that an order's kit was inspected; its subject is the order's id."""

CLAUSE = "ARIAC 2023 and 2024, kitting as coded"


def quadrant_of(pose: Pose) -> int:
    """The quadrant of the tray that a part lies in; the axes belong to the side of positive numbers.

    >>> [quadrant_of(Pose((x, y, 0.0))) for x, y in ((-1, 0), (0, 0), (-1, -1), (0, -1))]
    [1, 2, 3, 4]
    """
    x, y, _ = pose.position_m
    return (1 if x < 0 else 2) if y >= 0 else (3 if x < 0 else 4)


def angle_to_vertical(vector: tuple[float, float, float]) -> float:
    """The angle between a vector and the vertical, in rad; that of no vector at all is the largest.

    >>> angle_to_vertical((0.0, 0.0, 2.0)), round(angle_to_vertical((0.0, 0.0, -1.0)), 6)
    (0.0, 3.141593)
    """
    x, y, z = vector
    length = math.sqrt(x * x + y * y + z * z)
    # As coded 0/0, which is below no limit.
    return math.acos(min(1.0, max(-1.0, z / length))) if length > 0 else math.pi


@dataclass(frozen=True)
class Sight:
    """What the simulator's own sensor saw of a task when its order was handed in.

    Attributes:
        submission: The one that counts; `None` without one.
        parts: The parts seen, in the order of the sensor's list.
        nothing: Why no part was seen, in words; empty where the sensor could see.
        unknown: Why the log does not say what was seen, in words; empty where it does.
    """

    submission: KitSubmission | None = None
    parts: tuple[Product, ...] = ()
    nothing: str = ""
    unknown: str = ""


def sight(trial: Trial, order: Order, task: Task) -> Sight:
    """What was seen of a task: the parts at the ordered place, and nothing of any other place.

    Source: task manager of 2023 and 2024: a kit is looked for on the ordered AGV, an
    assembly at the ordered station; without tray or insert no part is seen; nothing is
    accepted after the end of the competition.
    """
    submission = claimed(trial, order, task)
    if submission is None:
        why = unseen(trial, submission, task)
        return Sight(unknown=why) if why else Sight(nothing=NOT_SUBMITTED)
    if trial.ended_s is not None and submission.submitted_s > trial.ended_s:
        return Sight(nothing="it was handed in after the end of the competition, which is refused")
    what, wanted, got, base = (
        ("AGV", task.agv, submission.agv, "tray")
        if task.kind == "kitting"
        else ("station", task.station, submission.station, "insert")
    )
    if wanted not in ("", "any") and not got:
        return Sight(submission, unknown=f"the log does not show the {what} it was handed in from")
    if wanted not in ("", "any", got):
        return Sight(submission, nothing=f"it was at {what} {got}; only {wanted} is looked at")
    # An empty type says that there was none; a missing tray, that no log shows it.
    if submission.tray is not None and not submission.tray.type:
        return Sight(submission, nothing=f"no {base} was seen, so no part")
    if submission.contents is None:
        return Sight(submission, unknown=f"it was submitted, but the log does not show what the {base} held")
    return Sight(submission, tuple(part for part in submission.contents if part_of(part.type)))


def not_judged(order: Order, kinds: Sequence[str]) -> Iterator[Finding]:
    """A finding, "not applicable", for each slot of each task of another kind.

    Without one a formula about that slot or task would have no answer.
    """
    for task in order.tasks:
        subject = f"{order.id}/{task.id}"
        if task.kind not in kinds:
            message = f"a task of kind {task.kind} is none of {', '.join(kinds)}"
            for slot in [f"{subject}/{wanted.slot}" for wanted in task.products] or [subject]:
                yield Finding.not_applicable(slot, message)


def tasks_of(order: Order, kinds: Sequence[str]) -> Iterator[tuple[str, Task]]:
    """The tasks of some kinds with the subject of findings about each."""
    for task in order.tasks:
        if task.kind in kinds:
            yield f"{order.id}/{task.id}", task


@dataclass(frozen=True)
class TaskKind:
    """The task is of one kind: a fact for formulas that price kinds differently.

    Measures:
        The kind of each task of the order.
    Violated when:
        Never: a task of another kind is not applicable, and so has no points.
    Source:
        ARIAC 2023 and 2024: kitting, assembly and combined tasks have their own prices.
    Attributes:
        kind: Kind of task that it is about.
    """

    when_cut: ClassVar[str] = "kept"

    kind: Literal["kitting", "assembly", "combined"] = "kitting"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:  # noqa: ARG002  # part of the contract
        """One finding for each task."""
        for task in order.tasks:
            make = Finding.satisfied if task.kind == self.kind else Finding.not_applicable
            yield make(f"{order.id}/{task.id}", f"a task of kind {task.kind}")


@dataclass(frozen=True)
class OrderSubmitted:
    """The order was handed in, whatever its kind.

    Measures:
        Whether a submission of the order came after its announcement and not after
        the end of the competition. The first one counts; an order is accepted once.
    Violated when:
        None did, in a log that shows submissions.
    Source:
        ARIAC 2024, order list: once, and not after the end.
    """

    when_cut: ClassVar[str] = "witnessed"
    mistake: ClassVar[tuple[str, str]] = ("order not submitted", "orders not submitted")

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each task."""
        for task in order.tasks:
            subject, seen = f"{order.id}/{task.id}", sight(trial, order, task)
            if seen.submission is not None:
                yield Finding.satisfied(subject, f"submitted at {seen.submission.submitted_s:.3f} s")
            elif seen.unknown:
                yield Finding.inconclusive(subject, seen.unknown)
            else:
                yield Finding.violated(subject, seen.nothing)


@dataclass(frozen=True)
class QuadrantPart:
    """The part in each ordered quadrant of the tray is as ordered, in one respect.

    Measures:
        The last part that the tray sensor lists in the quadrant; parts before it are
        overwritten. Where two products are ordered in one quadrant, it counts for the
        one ordered last. `judge: type` compares types, `color` colours. `upright`
        takes the angle between the vertical and the part's own vertical axis
        (`flip_vector: axis`), or that axis with the part's position on the tray added
        to it (`axis_and_position`). `sound` looks for faulty parts: by recorded marks
        where nothing is known of challenges; else only a challenged quadrant can have
        one. After an earlier quality check that is a part which the check has marked.
        Without one the part is faulty as soon as any part in the quadrant has type and
        colour of a product ordered there (`challenge_marks: quadrant`), or when it has
        those of its own product (`part`).
    Violated when:
        `type`: the quadrant is empty or its part of another type. `color`: another
        colour. `upright`: the angle is not below `max_tilt_rad`. `sound`: the part is
        faulty. All but `type` are not applicable where the type is wrong.
    Source:
        ARIAC 2023 and 2024 as coded; with the position an upright part further than
        tan(0.2) (1 + z) from the middle counts as flipped (issue 347), and the task
        manager keeps one fault flag for each quadrant, not for each part. As
        documented: the axis alone, and `challenge_marks: part`.
    Attributes:
        compare: What of a part must be right.
        max_tilt_rad: How far a part may be tilted.
        flip_vector: Which vector tells that a part lies upside down.
        challenge_marks: Whether a challenge makes one part faulty, or all of its quadrant.
    """

    when_cut: ClassVar[str] = "witnessed"
    measures: ClassVar[Mapping[str, Measure]] = {
        "tilt_rad": Measure("rad", worst=math.pi, meaning="between the part's axis and the vertical")
    }

    compare: Literal["type", "color", "upright", "sound"] = "type"
    flip_vector: Literal["axis", "axis_and_position"] = "axis"
    max_tilt_rad: float = parameter(0.2, unit="rad", status="")
    challenge_marks: Literal["quadrant", "part"] = "quadrant"

    @property
    def mistake(self) -> tuple[str, str]:
        """What people call a violation."""
        words = {"type": "wrong", "color": "wrongly colored", "upright": "flipped", "sound": "faulty"}
        return f"{words[self.compare]} part", f"{words[self.compare]} parts"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each wanted product of each kitting task."""
        yield from not_judged(order, ("kitting",))
        for subject, task in tasks_of(order, ("kitting",)):
            seen = sight(trial, order, task)
            if not task.products:
                yield Finding.not_applicable(subject, EMPTY_KIT, clause=CLAUSE)
            for wanted in task.products:
                yield self._slot(f"{subject}/{wanted.slot}", trial, order, task, wanted, seen)

    def _slot(
        self, subject: str, trial: Trial, order: Order, task: Task, wanted: WantedProduct, seen: Sight
    ) -> Finding:
        ordered = part_of(wanted.type)
        if seen.unknown or ordered is None or wanted.quadrant not in (1, 2, 3, 4):
            why = seen.unknown or (
                "the order names no quadrant" if ordered else f"{wanted.type!r} is no part of 2023 or later"
            )
            return Finding.inconclusive(subject, why, clause=CLAUSE)
        if seen.submission is None or seen.nothing:
            return self._absent(subject, seen.nothing)
        # As coded a quadrant has one set of points, which the product ordered last overwrites.
        rival = [other for other in task.products if other.quadrant == wanted.quadrant][-1]
        if rival is not wanted:
            return self._absent(subject, f"quadrant {wanted.quadrant} counts for {rival.slot}, ordered later")
        part, hidden = _last_in(wanted.quadrant, seen.parts)
        if hidden is not None:
            message = (
                f"the pose of {hidden.name or spoken(hidden.type)} is not usable, so its quadrant is unknown"
            )
            return Finding.inconclusive(subject, message, clause=CLAUSE)
        if part is None:
            return self._absent(subject, f"quadrant {wanted.quadrant} is empty")
        found = part_of(part.type)
        assert found is not None  # only parts are seen
        # A part of the wrong type earns nothing, so its colour, tilt and faults are not compared.
        if found[0] != ordered[0]:
            return self._absent(subject, f"a {' '.join(found[::-1])} lies in quadrant {wanted.quadrant}")
        if self.compare == "sound":
            return self._soundness(subject, trial, order, task, wanted, part, seen)
        return self._compared(subject, wanted, part)

    def _absent(self, subject: str, message: str) -> Finding:
        """The type is wrong or nothing is there, and then nothing else counts."""
        make = Finding.violated if self.compare == "type" else Finding.not_applicable
        return make(subject, message, clause=CLAUSE)

    def _compared(self, subject: str, wanted: WantedProduct, part: Product) -> Finding:
        """The finding about a part of the right type."""
        assert part.pose is not None  # it was found by its place
        if self.compare == "upright":
            # As coded: not flipped only below the limit.
            tilt = Limit("tilt", self.tilt_rad(part.pose), "rad", at_most=self.max_tilt_rad, strict=True)
            return Finding.from_limits(subject, tilt, clause=CLAUSE)
        right = self.compare == "type" or part_of(part.type) == part_of(wanted.type)
        make = Finding.satisfied if right else Finding.violated
        return make(
            subject,
            f"{spoken(part.type)} in quadrant {wanted.quadrant}, ordered {spoken(wanted.type)}",
            clause=CLAUSE,
        )

    def _soundness(
        self,
        subject: str,
        trial: Trial,
        order: Order,
        task: Task,
        wanted: WantedProduct,
        part: Product,
        seen: Sight,
    ) -> Finding:
        """The finding about whether a part of the right type is faulty."""
        if wanted.challenged is None:
            return _fault(subject, part, part.faulty, "as recorded")
        if not wanted.challenged:
            return _fault(subject, part, False, "its quadrant is not challenged")
        if _inspected(trial, order, seen):
            return _fault(subject, part, _marked(part), "as the quality check left it")
        faulty = self._uninspected(task, wanted, part, seen)
        if faulty is None:
            why = "a part as ordered has no usable pose; it might lie in the challenged quadrant"
            return Finding.inconclusive(subject, why, clause=CLAUSE)
        # Where both ways agree it does not matter whether there was an inspection.
        if faulty != _marked(part) and QUALITY_CHECK not in trial.witnessed:
            why = "the log does not show whether its challenged quadrant was inspected"
            return Finding.inconclusive(subject, why, clause=CLAUSE)
        return _fault(subject, part, faulty, "its challenged quadrant was not inspected")

    def _uninspected(self, task: Task, wanted: WantedProduct, part: Product, seen: Sight) -> bool | None:
        """Whether a challenge that meets a part at its submission makes it faulty; `None`: unknown."""
        if self.challenge_marks == "part":
            return part_of(part.type) == part_of(wanted.type)
        return _holds_right_part(wanted.quadrant, task, seen.parts)

    def tilt_rad(self, pose: Pose) -> float:
        """The angle that decides whether a part is flipped, in rad."""
        x, y, z = pose.up_axis
        # Until 2024.4.1 the tip of the axis was taken on the tray, and the part's position never subtracted.
        if self.flip_vector == "axis_and_position":
            px, py, pz = pose.position_m
            x, y, z = px + x, py + y, pz + z
        return angle_to_vertical((x, y, z))


def _last_in(quadrant: int, parts: Sequence[Product]) -> tuple[Product | None, Product | None]:
    """The last part in a quadrant, and a later one that may lie there, its pose being unknown."""
    # As coded each part in the list overwrites the points of its quadrant, so the last one counts.
    for part in reversed(parts):
        if part.pose is None:
            return None, part
        if quadrant_of(part.pose) == quadrant:
            return part, None
    return None, None


def _marked(part: Product) -> bool:
    """Whether a quality check has marked a part as faulty."""
    return part.faulty or part.name.endswith(FAULTY_ENDING)


def _inspected(trial: Trial, order: Order, seen: Sight) -> bool:
    """Whether the kit was inspected before it was handed in."""
    checks = [event for event in trial.events_of(QUALITY_CHECK) if event.subject == order.id]
    return seen.submission is not None and any(c.t_s <= seen.submission.submitted_s for c in checks)


def _fault(subject: str, part: Product, faulty: bool, why: str) -> Finding:
    make, state = (Finding.violated, "faulty") if faulty else (Finding.satisfied, "sound")
    return make(subject, f"{part.name or spoken(part.type)} is {state}, {why}", clause=CLAUSE)


def _holds_right_part(quadrant: int, task: Task, parts: Sequence[Product]) -> bool | None:
    """Whether a quadrant holds a part as ordered there; `None` where one of unknown place might be it.

    Any product ordered in the quadrant will do, and any part in it: neither needs to be
    the one that its points are given for.
    """
    ordered = {part_of(wanted.type) for wanted in task.products if wanted.quadrant == quadrant}
    alike = [part for part in parts if part_of(part.type) in ordered]
    if any(part.pose is not None and quadrant_of(part.pose) == quadrant for part in alike):
        return True
    return None if any(part.pose is None for part in alike) else False


@dataclass(frozen=True)
class ExtraParts:
    """No more parts lie on the tray than were ordered.

    Measures:
        The parts seen on the tray, wherever they lie and whatever they are, against
        the number ordered; one violation for each one more.
    Violated when:
        There are more.
    Source:
        ARIAC 2023 and 2024: extra = max(parts on the tray - n, 0).
    """

    when_cut: ClassVar[str] = "witnessed"
    mistake: ClassVar[tuple[str, str]] = ("kit with parts too many", "kits with parts too many")

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task; where parts are extra, one for each of them."""
        yield from _each_other_task(order)
        for subject, task in tasks_of(order, ("kitting",)):
            seen = sight(trial, order, task)
            if seen.unknown:
                yield Finding.inconclusive(subject, seen.unknown, clause=CLAUSE)
                continue
            found, ordered = len(seen.parts), len(task.products)
            counts = f"{found} parts on the tray, {ordered} ordered"
            for number in range(1, found - ordered + 1):
                yield Finding.violated(subject, f"{counts}: extra part {number}", clause=CLAUSE)
            if found <= ordered:
                yield Finding.satisfied(subject, seen.nothing or counts, clause=CLAUSE)


def _each_other_task(order: Order) -> Iterator[Finding]:
    for task in order.tasks:
        if task.kind != "kitting":
            yield Finding.not_applicable(
                f"{order.id}/{task.id}", f"a task of kind {task.kind} is not a kit", clause=CLAUSE
            )


_TRAY = "kit_tray"
_TRAY_NUMBER = slice(9, 11)
"""The characters that the task manager reads as the number, whatever follows them."""


def tray_number(model: str) -> int | None:
    """The number in the name of a kitting tray; `None` when the name is of another form.

    >>> tray_number("kit_tray_03"), tray_number("movable_tray")
    (3, None)
    """
    digits = model[_TRAY_NUMBER]
    return int(digits) if model.startswith(_TRAY) and digits.isascii() and digits.isdigit() else None


@dataclass(frozen=True)
class TrayNumber:
    """The kit is built on the kitting tray with the ordered number.

    Measures:
        Characters 9 and 10 of the tray model's name, as in `kit_tray_03`.
    Violated when:
        The numbers differ, no tray was seen, or the order was never handed in.
    Source:
        ARIAC 2023 and 2024: 3 points, from 2024 on 1, for the right tray.
    """

    when_cut: ClassVar[str] = "witnessed"
    mistake: ClassVar[tuple[str, str]] = ("wrong tray", "wrong trays")

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task."""
        yield from _each_other_task(order)
        for subject, task in tasks_of(order, ("kitting",)):
            yield self._tray(subject, task, sight(trial, order, task))

    def _tray(self, subject: str, task: Task, seen: Sight) -> Finding:
        wanted = tray_number(task.tray.type) if task.tray else None
        if wanted is None:
            return Finding.inconclusive(subject, "the order names no kitting tray", clause=CLAUSE)
        if seen.nothing:
            return Finding.violated(subject, seen.nothing, clause=CLAUSE)
        if seen.submission is None or (seen.unknown and not seen.submission.agv):
            return Finding.inconclusive(subject, seen.unknown, clause=CLAUSE)
        if seen.submission.tray is None:
            return Finding.inconclusive(subject, "the log does not show the tray", clause=CLAUSE)
        got = tray_number(seen.submission.tray.type)
        if got is None:
            message = f"{seen.submission.tray.type!r} names no kitting tray such as kit_tray_03"
            return Finding.inconclusive(subject, message, clause=CLAUSE)
        make = Finding.satisfied if got == wanted else Finding.violated
        return make(subject, f"tray {got}, ordered {wanted}", clause=CLAUSE)
