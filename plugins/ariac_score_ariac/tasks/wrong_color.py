"""Products of the wrong colour that lie where the right ones belong."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from ariac_score import Cause, Finding, Measure, Trial, Verdict, Worlds, parameter
from ariac_score_ariac.tasks.claims import contents_of, each_delivered, kitting_tasks
from ariac_score_ariac.tasks.contents import sound
from ariac_score_ariac.tasks.names import TypeNames, base_type, delivered_type
from ariac_score_ariac.tasks.poses import PoseTest
from ariac_score_ariac.work import Order, Product, Task, WantedProduct

_CLAUSE = "ARIAC 2021 finals and 2022, product pose of a wrong colour"


@dataclass(frozen=True)
class WrongColorPose:
    """No product of the wrong colour lies where one of the right colour belongs.

    Measures:
        `pairs`: ordered product and delivered product of a type nobody ordered, base
        types alike, pose test passed. `groups`: exact ordered types of which a sound
        product was delivered. `counted`: how often the simulator counts a pose: each
        pair once for every group (`each_delivered_type`), so not at all without one;
        or once for each ordered product with a pair (`once`).
    Violated when:
        There is such a pair, whatever it counts. With `without_color: aborts` a name
        without `_` among the wrong colours is inconclusive where the simulator
        compares them: it would have aborted.
    Source:
        ARIAC 2021 finals (a97e234 and later) and 2022 as coded: the loop over wrong
        colours stands inside the loop over exact types. Meant was `once`.
    Attributes:
        counting: How often such a pair counts.
        most_in_place: How many of the wrong colour are thought to lie in the place of one right product at
            most, where the log does not show the contents. Our choice: products do not overlap.
        without_color: What a name without a colour is.
        type_names: Which part of a name is the type.
    """

    when_cut: ClassVar[str] = "witnessed"
    measures: ClassVar[Mapping[str, Measure]] = {
        "pairs": Measure("count", best=0.0, meaning="products of wrong colour in the place of a right one"),
        "groups": Measure("count", meaning="exact ordered types of which a sound product was delivered"),
        "counted": Measure(
            "count", "points", worst=0.0, meaning="how often the simulator counts a pose for them"
        ),
    }

    max_distance_m: float = parameter(0.03, unit="m", status="")
    min_quaternion_dot: float = 0.95
    max_heading_error_rad: float = parameter(0.1, unit="rad", status="")
    counting: Literal["each_delivered_type", "once"] = "each_delivered_type"
    without_color: Literal["whole_name", "aborts"] = "whole_name"
    type_names: TypeNames = "whole"
    most_in_place: int = parameter(1, unit="1", at_least=1, at_most=100, status="", source="our choice")

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task."""
        return each_delivered(trial, order, _CLAUSE, self._counted)

    def judge_worlds(self, trial: Trial, order: Order) -> Iterator[Finding | Worlds]:
        """The same, and of an undecided one how often it may count: from never to in every place."""
        tasks = dict(kitting_tasks(order))
        for finding in self.judge(trial, order):
            yield finding
            task = tasks.get(finding.subject)
            if finding.verdict is Verdict.INCONCLUSIVE and task is not None:
                yield self._open(finding, task, contents_of(trial, order, task))

    def _open(self, finding: Finding, task: Task, contents: tuple[Product, ...] | None) -> Worlds:
        """What an undecided task counts at least and at most."""
        ordered = {wanted.type for wanted in task.products}
        if contents is None:
            least, most = [0] * len(task.products), [self.most_in_place] * len(task.products)
            groups = [0, len(ordered)]
        else:
            types = [delivered_type(product.type, self.type_names) for product in sound(contents)]
            wrong = [p for p, kind in zip(sound(contents), types, strict=True) if kind not in ordered]
            rivals = [[p for p in wrong if self._alike(wanted, p)] for wanted in task.products]
            least = self._pairs(task.products, rivals)
            unknown = [
                sum(wanted.pose is None or product.pose is None for product in near)
                for wanted, near in zip(task.products, rivals, strict=True)
            ]
            most = [sure + may for sure, may in zip(least, unknown, strict=True)]
            groups = [len(ordered & set(types))] * 2
        seldom, often = (
            self._finding(finding.subject, least, groups[0]),
            self._finding(finding.subject, most, groups[1]),
        )
        return Worlds(finding.subject, best=(often,), worst=(seldom,), causes=(Cause(finding.message),))

    def _counted(self, subject: str, task: Task, contents: tuple[Product, ...]) -> Finding:
        ordered = {wanted.type for wanted in task.products}
        types = [delivered_type(product.type, self.type_names) for product in sound(contents)]
        # Of a type that is ordered, too many are unwanted, and not of a wrong colour.
        wrong = [p for p, kind in zip(sound(contents), types, strict=True) if kind not in ordered]
        groups = len(ordered & set(types))
        nameless = [p.type for p in wrong if "_" not in delivered_type(p.type, self.type_names)]
        if groups and nameless and self.without_color == "aborts":
            return Finding.inconclusive(
                subject,
                f"the simulator would have aborted at the product name {nameless[0]!r}, which has no colour",
                clause=_CLAUSE,
            )
        # Without a group the loop over wrong colours is never entered: no pose and no name decides anything.
        rivals = [[p for p in wrong if self._alike(wanted, p)] for wanted in task.products]
        if groups and any(
            near and (wanted.pose is None or any(p.pose is None for p in near))
            for wanted, near in zip(task.products, rivals, strict=True)
        ):
            return Finding.inconclusive(
                subject, "a pose that decides about a wrong colour is not usable", clause=_CLAUSE
            )
        return self._finding(subject, self._pairs(task.products, rivals), groups)

    def _alike(self, wanted: WantedProduct, delivered: Product) -> bool:
        return base_type(delivered_type(delivered.type, self.type_names)) == base_type(wanted.type)

    def _pairs(self, ordered: Sequence[WantedProduct], rivals: Sequence[Sequence[Product]]) -> list[int]:
        """For each ordered product how many of the wrong colour lie in its place."""
        test = PoseTest(self.max_distance_m, self.min_quaternion_dot, self.max_heading_error_rad)
        return [
            sum(1 for product in near if test.passes(wanted.pose, product.pose))
            for wanted, near in zip(ordered, rivals, strict=True)
        ]

    def _finding(self, subject: str, pairs: Sequence[int], groups: int) -> Finding:
        total = sum(pairs)
        taken = sum(1 for number in pairs if number)
        counted = total * groups if self.counting == "each_delivered_type" else taken
        quantities = {"pairs": float(total), "groups": float(groups), "counted": float(counted)}
        if not total:
            made = Finding.satisfied(subject, "no wrong colour lies in the place of a right one")
        else:
            made = Finding.violated(
                subject,
                f"{total} of wrong colour in the place of a right one, {groups} ordered types delivered: "
                f"counted {counted} times",
            )
        return Finding(subject, made.verdict, made.message, quantities=quantities, clause=_CLAUSE)
