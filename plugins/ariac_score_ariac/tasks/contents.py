"""What lies on the tray: types, colours, missing, unwanted and faulty products."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

from ariac_score import Finding, Trial
from ariac_score_ariac.parts import spoken
from ariac_score_ariac.tasks.claims import (
    EMPTY_KIT,
    NOT_SUBMITTED,
    CountsFrom,
    KindOfTask,
    claimed,
    kitting_tasks,
    not_kits,
    undecidable,
)
from ariac_score_ariac.tasks.names import TypeNames, base_type, delivered_type
from ariac_score_ariac.work import Order, Product, Task


def _full_type(product_type: str) -> str:
    return product_type


def sound(contents: Sequence[Product]) -> list[Product]:
    """The products that are not faulty, in order of delivery."""
    return [product for product in contents if not product.faulty]


@dataclass(frozen=True)
class Presence:
    """Each wanted product is on the tray.

    Measures:
        For each wanted product whether a delivered product that is not faulty takes
        its place: of each type as many are satisfied as were delivered, in slot order.
    Violated when:
        Fewer products of the type (or of the type in that colour) were delivered
        than ordered, or the shipment was never submitted. With `without_color:
        aborts` a name without `_` that the comparison of types meets is
        inconclusive: the simulator would have aborted. With `aborts_unless_exact` it
        looks for the exact name first, which compares no types.
    Source:
        ARIAC 2017-2022, scoring: product presence; as coded, min(ordered, delivered)
        for each type. The abort: rulebook, section 4, code; that of 2020 as in
        AriacScorer.cpp of usnistgov/ARIAC@da4d2a8.
    Attributes:
        compare: What of a part must be right.
        without_color: What a name without a colour is.
        type_names: Which part of a name is the type.
        counts_from: The version of the order since which submissions count.
    """

    when_cut: ClassVar[str] = "witnessed"

    compare: Literal["type", "type_and_color"] = "type_and_color"
    without_color: Literal["whole_name", "aborts", "aborts_unless_exact"] = "whole_name"
    type_names: TypeNames = "whole"
    counts_from: CountsFrom = "update"

    @property
    def mistake(self) -> tuple[str, str]:
        """What people call a violation."""
        return ("wrong part", "wrong parts") if self.compare == "type" else ("wrong color", "wrong colors")

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each wanted product of each kitting task."""
        clause = "ARIAC scoring, product presence"
        yield from not_kits(order)
        for subject, task in kitting_tasks(order):
            if not task.products:
                yield Finding.not_applicable(subject, EMPTY_KIT, clause=clause)
                continue
            submission = claimed(trial, order, task, self.counts_from)
            unknown = undecidable(trial, submission, subject, clause, task, order=order)
            if unknown or submission is None:
                for wanted in task.products:
                    slot = f"{subject}/{wanted.slot}"
                    yield undecidable(trial, submission, slot, clause, task, order=order) or Finding.violated(
                        slot, f"{spoken(wanted.type)}: {NOT_SUBMITTED}", clause=clause
                    )
                continue
            # Faulty products are worth nothing, so they take no slot.
            types = [delivered_type(p.type, self.type_names) for p in sound(submission.contents or ())]
            yield from self._present(subject, task, types, clause)

    def _present(self, subject: str, task: Task, types: Sequence[str], clause: str) -> Iterator[Finding]:
        key: Callable[[str], str] = base_type if self.compare == "type" else _full_type
        exact_first = self.without_color == "aborts_unless_exact"
        aborts = self.without_color != "whole_name"
        aborting = _first_without_color(task, types, exact_first=exact_first) if aborts else None
        # Taking one off for each slot satisfies min(ordered, delivered) slots of a type, the first in order.
        left = Counter(key(kind) for kind in types)
        delivered = ", ".join(map(spoken, sorted(types))) or "nothing"
        for wanted in task.products:
            slot, kind = f"{subject}/{wanted.slot}", key(wanted.type)
            if aborting is not None:
                yield Finding.inconclusive(
                    slot,
                    f"the simulator would have aborted at the product name {aborting!r}, which has no colour",
                    clause=clause,
                )
            elif left[kind] > 0:
                left[kind] -= 1
                yield Finding.satisfied(slot, f"{spoken(kind)} is on the tray", clause=clause)
            else:
                yield Finding.violated(
                    slot, f"no {spoken(kind)} for it; delivered: {delivered}", clause=clause
                )


def _first_without_color(task: Task, types: Sequence[str], *, exact_first: bool = False) -> str | None:
    """The first name without `_` that the simulator's comparison of base types would meet.

    It takes each ordered product in turn and scans what is left of the delivered ones
    up to the first of its base type; with `exact_first` only where none of its exact
    name is left.
    """
    # The order of the scans is that of AriacScorer.cpp: which name is met first decides whether it aborts.
    left = list(types)
    for wanted in task.products:
        if "_" not in wanted.type:
            return wanted.type
        if exact_first and wanted.type in left:
            left.remove(wanted.type)
            continue
        for i, kind in enumerate(left):
            if "_" not in kind:
                return kind
            if base_type(kind) == base_type(wanted.type):
                del left[i]
                break
    return None


_BONUS = "ARIAC scoring, all-products bonus"


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{n} {spoken(kind, n)}" for kind, n in sorted(counts.items()))


Faults = Callable[[Task, tuple[Product, ...]], str]
"""What is wrong with a tray, in words; empty when nothing is."""


def _each_tray(
    trial: Trial,
    order: Order,
    clause: str,
    unsubmitted: Callable[..., Finding],
    faults: Faults,
    fine: str,
    *,
    kind: KindOfTask = "kitting",
    counts_from: CountsFrom = "update",
) -> Iterator[Finding]:
    """One finding for each task of the kind: what `faults` finds on its tray, in words, violates."""
    yield from not_kits(order, kind)
    for subject, task in kitting_tasks(order, kind):
        submission = claimed(trial, order, task, counts_from)
        unknown = undecidable(trial, submission, subject, clause, task, order=order)
        if unknown:
            yield unknown
        elif submission is None:
            yield unsubmitted(subject, NOT_SUBMITTED, clause=clause)
        elif found := faults(task, submission.contents or ()):
            yield Finding.violated(subject, found, clause=clause)
        else:
            yield Finding.satisfied(subject, fine, clause=clause)


@dataclass(frozen=True)
class _Counted:
    """What the checks on numbers of products have in common."""

    when_cut: ClassVar[str] = "witnessed"

    type_names: TypeNames = "whole"
    counts_from: CountsFrom = "update"
    kind: KindOfTask = "kitting"

    def _counts(self, task: Task, contents: tuple[Product, ...]) -> tuple[Counter[str], Counter[str]]:
        ordered = Counter(wanted.type for wanted in task.products)
        delivered = Counter(delivered_type(p.type, self.type_names) for p in sound(contents))
        return ordered, delivered

    def _each(
        self, trial: Trial, order: Order, unsubmitted: Callable[..., Finding], faults: Faults, fine: str
    ) -> Iterator[Finding]:
        return _each_tray(
            trial,
            order,
            _BONUS,
            unsubmitted,
            faults,
            fine,
            kind=self.kind,
            counts_from=self.counts_from,
        )


@dataclass(frozen=True)
class NoneMissing(_Counted):
    """Nothing that was ordered is missing from the tray.

    Measures:
        Ordered products against delivered ones that are not faulty: of each exact
        type, or (`compare: number`) only how many there are.
    Violated when:
        Fewer were delivered than ordered, or the shipment was never submitted.
    Source:
        ARIAC 2017-2022, scoring: the all-products bonus asks for it; 2022 as coded,
        assembly: types are not looked at.
    Attributes:
        type_names: Which part of a name is the type.
        counts_from: The version of the order since which submissions count.
    """

    mistake: ClassVar[tuple[str, str]] = ("shipment with missing parts", "shipments with missing parts")

    compare: Literal["type_and_color", "number"] = "type_and_color"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each task of the kind."""
        return self._each(trial, order, Finding.violated, self._missing, "nothing is missing")

    def _missing(self, task: Task, contents: tuple[Product, ...]) -> str:
        # The difference of two counters keeps what is positive.
        ordered, delivered = self._counts(task, contents)
        if self.compare == "number":
            have, need = len(sound(contents)), len(task.products)
            return f"{have} of {need} products" if have < need else ""
        return f"{_listed(ordered - delivered)} missing" if ordered - delivered else ""


@dataclass(frozen=True)
class NoneUnwanted(_Counted):
    """Nothing lies on the tray that was not ordered.

    Measures:
        Delivered products of each exact type, not faulty, against ordered ones.
    Violated when:
        More were delivered than ordered.
    Source:
        ARIAC 2019-2022, scoring: the all-products bonus asks for it.
    Attributes:
        type_names: Which part of a name is the type.
        counts_from: The version of the order since which submissions count.
    """

    mistake: ClassVar[tuple[str, str]] = ("shipment with unwanted parts", "shipments with unwanted parts")

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each task of the kind."""
        return self._each(trial, order, Finding.not_applicable, self._unwanted, "nothing is unwanted")

    def _unwanted(self, task: Task, contents: tuple[Product, ...]) -> str:
        ordered, delivered = self._counts(task, contents)
        return f"{_listed(delivered - ordered)} unwanted" if delivered - ordered else ""


@dataclass(frozen=True)
class RightNumber:
    """As many objects lie on the tray as were ordered, whatever they are.

    Measures:
        The number of delivered products, faulty ones included unless `count_faulty`
        is false, against the number ordered.
    Violated when:
        They differ, or the shipment was never submitted.
    Source:
        ARIAC 2017 and 2018 as coded: the all-parts bonus asks for it, so that a faulty
        product too many costs the bonus.
    Attributes:
        count_faulty: Whether faulty parts are counted.
        counts_from: The version of the order since which submissions count.
    """

    when_cut: ClassVar[str] = "witnessed"
    mistake: ClassVar[tuple[str, str]] = (
        "shipment with a wrong number of parts",
        "shipments with a wrong number of parts",
    )

    count_faulty: bool = True
    counts_from: CountsFrom = "update"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task."""
        return _each_tray(
            trial,
            order,
            _BONUS,
            Finding.violated,
            self._differs,
            "as many objects as ordered",
            counts_from=self.counts_from,
        )

    def _differs(self, task: Task, contents: tuple[Product, ...]) -> str:
        # As coded faulty products are set apart and still counted in the total.
        have = len(contents) if self.count_faulty else len(sound(contents))
        return "" if have == len(task.products) else f"{have} objects, ordered {len(task.products)}"


@dataclass(frozen=True)
class NoneFaulty:
    """No faulty product lies on the tray.

    Measures:
        The fault mark of each delivered product.
    Violated when:
        One of them is faulty.
    Source:
        ARIAC 2017-2022, scoring: faulty products earn nothing and cost the bonus.
    """

    when_cut: ClassVar[str] = "witnessed"
    mistake: ClassVar[tuple[str, str]] = ("shipment with faulty parts", "shipments with faulty parts")

    counts_from: CountsFrom = "update"
    kind: KindOfTask = "kitting"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each task of the kind."""
        clause = "ARIAC scoring, faulty products"
        return _each_tray(
            trial,
            order,
            clause,
            Finding.not_applicable,
            self._faulty,
            "no product is faulty",
            kind=self.kind,
            counts_from=self.counts_from,
        )

    @staticmethod
    def _faulty(_task: Task, contents: tuple[Product, ...]) -> str:
        faulty = sorted(product.name or spoken(product.type) for product in contents if product.faulty)
        return f"faulty: {', '.join(faulty)}" if faulty else ""
