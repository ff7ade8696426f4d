"""Briefcases of 2021 and 2022: which ordered product the simulator finds in its place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import permutations
from typing import ClassVar, Literal

from ariac_score import Finding, Measure, Trial, parameter
from ariac_score_ariac.parts import spoken
from ariac_score_ariac.tasks.claims import (
    NOT_SUBMITTED,
    claimed,
    each_delivered,
    kitting_tasks,
    not_kits,
    undecidable,
)
from ariac_score_ariac.tasks.contents import sound
from ariac_score_ariac.tasks.names import base_type, delivered_type
from ariac_score_ariac.tasks.poses import PoseTest, best_total
from ariac_score_ariac.work import Order, Product, Task, WantedProduct

_CLAUSE = "ARIAC 2021 and 2022 scoring, assembly"
_PREFIX = len("assembly_")

MAX_PERMUTED = 9
"""The most products of one type whose orders are all tried: 9! of them. A briefcase holds four."""

_IN_PLACE, _IN_COLOR = 2, 3
"""Points of a product in its place, and in its place in its colour, as the rulebooks have them."""

Matching = Literal["by_type_then_permutations", "first_in_place", "best_assignment"]


@dataclass(frozen=True)
class Record:
    """What the simulator notes about one delivered product, under its name.

    Attributes:
        slot: The ordered product it was noted for.
        in_place: Whether it got its pose flag.
        color_right: Whether it got its colour flag.
    """

    slot: str
    in_place: bool
    color_right: bool


@dataclass(frozen=True)
class Briefcase:
    """What the comparison of an ordered with a delivered briefcase leaves.

    Attributes:
        records: By delivered name, as given. The first product of a name is kept, so
            that two alike leave one record.
        collapsed: Names of records by the slots whose product fell into one that was there.
        types_alike: How often a type comparison succeeded.
        colors_alike: How often a colour comparison succeeded.
        poses_alike: How often the simulator counted a pose as right.
        undecided: Why there is no answer, in words; empty when there is one.
    """

    records: Mapping[str, Record] = field(default_factory=dict)
    collapsed: Mapping[str, str] = field(default_factory=dict)
    types_alike: int = 0
    colors_alike: int = 0
    poses_alike: int = 0
    undecided: str = ""


class _AbortError(Exception):
    """The simulator's text handling would have run out of range."""


class _Walk:
    """Walks over the ordered products, taking each from what is left of the delivered ones."""

    def __init__(self, task: Task, contents: Sequence[Product], test: PoseTest) -> None:
        self.task, self.test = task, test
        self.delivered = sound(contents)
        self.left = list(self.delivered)
        self.records: dict[str, Record] = {}
        self.collapsed: dict[str, str] = {}
        self.types_alike = self.colors_alike = self.poses_alike = 0

    def result(self) -> Briefcase:
        return Briefcase(self.records, self.collapsed, self.types_alike, self.colors_alike, self.poses_alike)

    def take(self, i: int, wanted: WantedProduct, *, in_place: bool, color_right: bool) -> None:
        """Note the delivered product of index `i` and take it out, unless its name is noted already."""
        # The notes are a `std::map` by raw name, and inserting into one does not overwrite.
        name = self.left.pop(i).type
        if name in self.records:
            self.collapsed[wanted.slot] = name
        else:
            self.records[name] = Record(wanted.slot, in_place, color_right)

    # First by type, then poses of exact types

    def by_type_then_permutations(self) -> Briefcase:
        for wanted in self.task.products:
            self._take_type(wanted)
        for kind in sorted({wanted.type for wanted in self.task.products}):
            slots = [wanted for wanted in self.task.products if wanted.type == kind]
            parts = [product for product in self.delivered if product.type == kind]
            improved = _improvements(slots, parts, self.test)
            # Exact types against raw names: a delivered name with a prefix, as in `agv1::…`, gets no flag.
            if kind in self.records and improved:
                self.records[kind] = replace(self.records[kind], in_place=True)
                self.poses_alike += improved
        return self.result()

    def _take_type(self, wanted: WantedProduct) -> None:
        kind = _without_color(wanted.type)
        color_at = wanted.type.rfind("_") + 1
        for i, product in enumerate(self.left):
            name = delivered_type(product.type, "after_colon")
            if len(name) < color_at:
                raise _AbortError(f"{product.type!r} ends before the colour of {wanted.type!r} begins")
            # The slice starts where the ordered name's colour does, not its own.
            color_right = name[color_at:] == wanted.type[color_at:]
            # Counted before types are compared: the printed counter is of comparisons, not of products.
            self.colors_alike += color_right
            if _without_color(name) == kind:
                self.types_alike += 1
                self.take(i, wanted, in_place=False, color_right=color_right)
                return

    # The first of the type in place

    def first_in_place(self) -> Briefcase:
        for wanted in self.task.products:
            self._take_in_place(wanted)
        return self.result()

    def _take_in_place(self, wanted: WantedProduct) -> None:
        for i, product in enumerate(self.left):
            if _sliced_type(wanted.type) != _sliced_type(product.type):
                continue
            self.types_alike += 1
            color_right = _color(wanted.type) == _color(product.type)
            self.colors_alike += color_right
            if self.test.passes(wanted.pose, product.pose):
                self.poses_alike += 1
                self.take(i, wanted, in_place=True, color_right=color_right)
                return

    # As documented: each product in its place, in the team's favour where two compete

    def best_assignment(self) -> Briefcase:
        worth = [
            [self._worth(wanted, product) for product in self.delivered] for wanted in self.task.products
        ]
        for wanted, row, i in zip(self.task.products, worth, best_total(worth), strict=True):
            if i is not None:
                product = self.delivered[i]
                color_right = row[i] == _IN_COLOR
                self.types_alike += 1
                self.poses_alike += 1
                self.colors_alike += color_right
                # Numbered, so that two alike are two records: as documented both earn their points.
                name = f"{product.name or spoken(product.type)} ({i + 1} of {len(self.delivered)})"
                self.records[name] = Record(wanted.slot, True, color_right)
        return self.result()

    def _worth(self, wanted: WantedProduct, product: Product) -> int | None:
        kind = delivered_type(product.type, "after_colon")
        if base_type(kind) != base_type(wanted.type) or not self.test.passes(wanted.pose, product.pose):
            return None
        return _IN_COLOR if kind == wanted.type else _IN_PLACE


def _without_color(name: str) -> str:
    if "_" not in name:
        raise _AbortError(f"{name!r} has no colour")
    return base_type(name)


def _color(name: str) -> str:
    return name.rpartition("_")[2]


def _sliced_type(name: str) -> str:
    """The type as read from the ninth character to the next underscore."""
    if len(name) < _PREFIX:
        raise _AbortError(f"{name!r} is shorter than 'assembly_'")
    return name[_PREFIX:].partition("_")[0]


def _improvements(slots: Sequence[WantedProduct], parts: Sequence[Product], test: PoseTest) -> int:
    """How often a later order of the parts beats the best so far, in the order of a sorted search."""
    if not parts:
        return 0
    passing = [[test.passes(slot.pose, part.pose) for part in parts] for slot in slots]
    best = improved = 0
    # In lexicographic order, as `std::next_permutation` goes through them from a sorted start.
    for order in permutations(range(max(len(slots), len(parts)))):
        found = sum(passing[i][j] for i, j in enumerate(order[: len(slots)]) if j < len(parts))
        if found > best:
            best, improved = found, improved + 1
            if best == min(len(slots), len(parts)):
                break  # nothing later can beat it
    return improved


@dataclass(frozen=True)
class _Briefcases:
    """What the rules about briefcases have in common."""

    when_cut: ClassVar[str] = "witnessed"

    matching: Matching = "by_type_then_permutations"
    max_distance_m: float = parameter(0.02, unit="m", status="")
    min_quaternion_dot: float | None = 0.95
    max_heading_error_rad: float | None = parameter(0.1, unit="rad", status="")
    max_rotation_rad: float | None = parameter(None, unit="rad", status="")

    def compared(self, task: Task, contents: Sequence[Product]) -> Briefcase:
        """What the simulator makes of a delivered briefcase."""
        if any(p.pose is None for p in sound(contents)) or any(w.pose is None for w in task.products):
            return Briefcase(undecided="a pose in the briefcase or in the order is not usable")
        # As coded only products of one exact type are permuted.
        counts = [sum(1 for p in contents if p.type == wanted.type) for wanted in task.products]
        if self.matching == "best_assignment":
            counts = [len(sound(contents))]
        if max([len(task.products), *counts]) > MAX_PERMUTED:
            return Briefcase(undecided=f"more than {MAX_PERMUTED} products: no briefcase holds that many")
        test = PoseTest(
            self.max_distance_m,
            self.min_quaternion_dot,
            self.max_heading_error_rad,
            max_rotation_rad=self.max_rotation_rad,
        )
        walk = _Walk(task, contents, test)
        try:
            if self.matching == "best_assignment":
                return walk.best_assignment()
            if self.matching == "first_in_place":
                return walk.first_in_place()
            return walk.by_type_then_permutations()
        except _AbortError as abort:
            return Briefcase(undecided=f"the simulator would have aborted: {abort}")


@dataclass(frozen=True)
class AssemblyPart(_Briefcases):
    """Each wanted product is in the briefcase, in its place, in its colour.

    Measures:
        For each ordered product whether the simulator notes a delivered one for it
        (`compare: type`), whether that got its pose flag (`type_and_pose`), and its
        colour flag as well (`type_pose_and_color`). As coded notes are kept under the
        delivered name: of two products alike only the first is noted. With `matching:
        best_assignment` every product that lies in its place counts, in the colour or
        not, assigned so that they are worth the most.
    Violated when:
        It does not, or the briefcase was never submitted. Names that would have
        aborted the simulator are inconclusive.
    Source:
        ARIAC 2021 as coded (`by_type_then_permutations`): products are paired by type
        and order, the colour is cut at the ordered name's position, the pose flag goes
        by exact types, P(0.02 m, 0.1 rad). 2022 as coded (`first_in_place`): the first
        product of the type that lies right, whatever its colour; no yaw test. Both as
        documented (`best_assignment`): 2 points for type and pose, 1 for the colour too.
    Attributes:
        compare: What of a part must be right.
        matching: How parts are assigned to places.
    """

    compare: Literal["type", "type_and_pose", "type_pose_and_color"] = "type_and_pose"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each wanted product of each assembly task."""
        yield from not_kits(order, "assembly")
        for subject, task in kitting_tasks(order, "assembly"):
            if not task.products:
                yield Finding.not_applicable(subject, "no product is ordered", clause=_CLAUSE)
                continue
            submission = claimed(trial, order, task)
            unknown = undecidable(trial, submission, subject, _CLAUSE, task)
            compared = (
                Briefcase() if unknown else self.compared(task, (submission and submission.contents) or ())
            )
            for wanted in task.products:
                slot = f"{subject}/{wanted.slot}"
                if unknown:
                    yield replace(unknown, subject=slot)
                elif submission is None:
                    yield Finding.violated(slot, f"{spoken(wanted.type)}: {NOT_SUBMITTED}", clause=_CLAUSE)
                elif compared.undecided:
                    yield Finding.inconclusive(slot, compared.undecided, clause=_CLAUSE)
                else:
                    yield self._finding(slot, wanted, compared)

    def _finding(self, slot: str, wanted: WantedProduct, compared: Briefcase) -> Finding:
        noted = {record.slot: (name, record) for name, record in compared.records.items()}
        if wanted.slot in compared.collapsed:
            name = compared.collapsed[wanted.slot]
            return Finding.violated(slot, f"another {name} was noted before it", clause=_CLAUSE)
        if wanted.slot not in noted:
            return Finding.violated(slot, f"no {spoken(wanted.type)} is noted for it", clause=_CLAUSE)
        name, record = noted[wanted.slot]
        if self.compare != "type" and not record.in_place:
            return Finding.violated(slot, f"{name} is not in its place", clause=_CLAUSE)
        if self.compare == "type_pose_and_color" and not record.color_right:
            return Finding.violated(slot, f"{name} has the wrong colour", clause=_CLAUSE)
        return Finding.satisfied(slot, f"{name} is noted for it", clause=_CLAUSE)


@dataclass(frozen=True)
class AssemblyCounters(_Briefcases):
    """What the simulator prints about a briefcase in addition to its points.

    Measures:
        `types_alike`, `colors_alike`, `poses_alike`: how often each comparison
        succeeded, which is not how many products are right; `records`: products
        noted; `delivered`: products in the briefcase, faulty ones included.
    Violated when:
        Never; a briefcase that was not submitted has nothing to count.
    Source:
        ARIAC 2021 and 2022 as coded: correct_type, correct_color, correct_pose of the
        printed breakdown.
    """

    measures: ClassVar[Mapping[str, Measure]] = {
        "types_alike": Measure("count", meaning="how often the comparison of types succeeded"),
        "colors_alike": Measure("count", meaning="how often that of colours succeeded"),
        "poses_alike": Measure("count", meaning="how often that of poses succeeded"),
        "records": Measure("count", meaning="products noted"),
        "delivered": Measure("count", meaning="products in the briefcase, faulty ones included"),
    }

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each assembly task."""
        return each_delivered(trial, order, _CLAUSE, self._finding, kind="assembly")

    def _finding(self, subject: str, task: Task, contents: tuple[Product, ...]) -> Finding:
        compared = self.compared(task, contents)
        if compared.undecided:
            return Finding.inconclusive(subject, compared.undecided, clause=_CLAUSE)
        counted = {
            "types_alike": float(compared.types_alike),
            "colors_alike": float(compared.colors_alike),
            "poses_alike": float(compared.poses_alike),
            "records": float(len(compared.records)),
            "delivered": float(len(contents)),
        }
        listed = ", ".join(f"{name.replace('_', ' ')} {number:g}" for name, number in counted.items())
        satisfied = Finding.satisfied(subject, listed)
        return replace(satisfied, quantities=counted, clause=_CLAUSE)
