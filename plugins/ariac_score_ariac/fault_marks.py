"""Which products of a kit are faulty, where the record of the kit shows only their names."""

from __future__ import annotations

from dataclasses import replace

from ariac_score import Trial
from ariac_score_ariac.parts import FAULTY_ENDING
from ariac_score_ariac.work import Product, Task, faulty_products

__all__ = ["by_challenges", "by_list"]


def by_list(contents: tuple[Product, ...], trial: Trial, _task: Task | None) -> tuple[Product, ...] | None:
    """Faulty is what the trial's configuration lists; unknown where no configuration is at hand.

    Source: ARIAC 2017 to 2022: the list names individuals. They are compared by the whole
    name of the instance, without what stands before its last `|`.
    """
    listed = faulty_products(trial)
    if listed is None and contents:
        return None
    return tuple(replace(p, faulty=p.name.rpartition("|")[2] in (listed or ())) for p in contents)


def by_challenges(
    contents: tuple[Product, ...], _trial: Trial, task: Task | None
) -> tuple[Product, ...] | None:
    """Faulty is what a quality check has renamed; unknown where the challenges of the order are.

    A part keeps its name until it is inspected. So a name without the ending means a sound
    part only where it is known which quadrants have a faulty-part challenge.

    Source: ARIAC 2023 and 2024 as coded; parts of assemblies are never faulty.
    """
    kit = task is None or task.kind == "kitting"
    unknown = task is None or any(wanted.challenged is None for wanted in task.products)
    if kit and unknown and contents:
        return None
    return tuple(replace(p, faulty=kit and p.name.endswith(FAULTY_ENDING)) for p in contents)
