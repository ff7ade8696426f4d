"""What lies on the tray: types, colours, missing, unwanted and faulty products."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

from ariac_score import Finding, Order, Product, Task, Trial
from ariac_score_kitting.claims import EMPTY_KIT, NOT_SUBMITTED, claimed, kitting_tasks, not_kits, undecidable


def base_type(product_type: str) -> str:
    """The product type without its colour: the text before the last underscore.

    >>> base_type("gear_part_red")
    'gear_part'
    """
    return product_type.rpartition("_")[0] or product_type


def _full_type(product_type: str) -> str:
    return product_type


def _sound(contents: tuple[Product, ...]) -> list[Product]:
    return [product for product in contents if not product.faulty]


@dataclass(frozen=True)
class Presence:
    """Each wanted product is on the tray.

    Measures:
        For each wanted product whether a delivered product that is not faulty takes
        its place: of each type as many are satisfied as were delivered, in slot order.
    Violated when:
        Fewer products of the type (or of the type in that colour) were delivered
        than ordered, or the shipment was never submitted.
    Source:
        ARIAC 2020, scoring: product type and product colour presence; as coded,
        min(ordered, delivered) for each type.
    """

    compare: Literal["type", "type_and_color"] = "type_and_color"

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each wanted product of each kitting task."""
        clause = "ARIAC scoring, product presence"
        key = base_type if self.compare == "type" else _full_type
        yield from not_kits(order)
        for subject, task in kitting_tasks(order):
            if not task.products:
                yield Finding.not_applicable(subject, EMPTY_KIT, clause=clause)
                continue
            submission = claimed(trial, order, task)
            unknown = undecidable(trial, submission, subject, clause)
            if unknown or submission is None:
                for wanted in task.products:
                    slot = f"{subject}/{wanted.slot}"
                    yield undecidable(trial, submission, slot, clause) or Finding.violated(
                        slot, f"{wanted.type}: {NOT_SUBMITTED}", clause=clause
                    )
                continue
            yield from self._present(subject, task, submission.contents or (), key, clause)

    def _present(
        self, subject: str, task: Task, contents: tuple[Product, ...], key: Callable[[str], str], clause: str
    ) -> Iterator[Finding]:
        left = Counter(key(product.type) for product in _sound(contents))
        delivered = ", ".join(sorted(p.type for p in _sound(contents))) or "nothing"
        for wanted in task.products:
            slot, kind = f"{subject}/{wanted.slot}", key(wanted.type)
            if left[kind] > 0:
                left[kind] -= 1
                yield Finding.satisfied(slot, f"{kind} is on the tray", clause=clause)
            else:
                yield Finding.violated(slot, f"no {kind} for it; delivered: {delivered}", clause=clause)


_BONUS = "ARIAC scoring, all-products bonus"


def _counts(task: Task, contents: tuple[Product, ...]) -> tuple[Counter[str], Counter[str]]:
    ordered = Counter(wanted.type for wanted in task.products)
    delivered = Counter(product.type for product in _sound(contents))
    return ordered, delivered


def _listed(counts: Counter[str]) -> str:
    return ", ".join(f"{n} {kind}" for kind, n in sorted(counts.items()))


def _each_tray(
    trial: Trial,
    order: Order,
    clause: str,
    unsubmitted: Callable[..., Finding],
    faults: Callable[[Task, tuple[Product, ...]], str],
    fine: str,
) -> Iterator[Finding]:
    """One finding for each kitting task: what `faults` finds on its tray, in words, violates."""
    yield from not_kits(order)
    for subject, task in kitting_tasks(order):
        submission = claimed(trial, order, task)
        unknown = undecidable(trial, submission, subject, clause)
        if unknown:
            yield unknown
        elif submission is None:
            yield unsubmitted(subject, NOT_SUBMITTED, clause=clause)
        elif found := faults(task, submission.contents or ()):
            yield Finding.violated(subject, found, clause=clause)
        else:
            yield Finding.satisfied(subject, fine, clause=clause)


@dataclass(frozen=True)
class NoneMissing:
    """Nothing that was ordered is missing from the tray.

    Measures:
        Ordered products of each exact type against delivered ones that are not faulty.
    Violated when:
        Fewer were delivered than ordered, or the shipment was never submitted.
    Source:
        ARIAC 2019-2022, scoring: the all-products bonus asks for it.
    """

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task."""
        return _each_tray(trial, order, _BONUS, Finding.violated, self._missing, "nothing is missing")

    @staticmethod
    def _missing(task: Task, contents: tuple[Product, ...]) -> str:
        ordered, delivered = _counts(task, contents)
        return f"missing: {_listed(ordered - delivered)}" if ordered - delivered else ""


@dataclass(frozen=True)
class NoneUnwanted:
    """Nothing lies on the tray that was not ordered.

    Measures:
        Delivered products of each exact type, not faulty, against ordered ones.
    Violated when:
        More were delivered than ordered.
    Source:
        ARIAC 2019-2022, scoring: the all-products bonus asks for it.
    """

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task."""
        return _each_tray(trial, order, _BONUS, Finding.not_applicable, self._unwanted, "nothing is unwanted")

    @staticmethod
    def _unwanted(task: Task, contents: tuple[Product, ...]) -> str:
        ordered, delivered = _counts(task, contents)
        return f"unwanted: {_listed(delivered - ordered)}" if delivered - ordered else ""


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

    def judge(self, trial: Trial, order: Order) -> Iterator[Finding]:
        """One finding for each kitting task."""
        clause = "ARIAC scoring, faulty products"
        return _each_tray(trial, order, clause, Finding.not_applicable, self._faulty, "no product is faulty")

    @staticmethod
    def _faulty(_task: Task, contents: tuple[Product, ...]) -> str:
        faulty = sorted(product.name or product.type for product in contents if product.faulty)
        return f"faulty: {', '.join(faulty)}" if faulty else ""
