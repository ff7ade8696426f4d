"""Reading the trial configurations of ARIAC 2017 to 2025: what was to be done, and in what time.

Source: `nist_gear/script/gear.py` of 2017 to 2022; ARIAC notes on log formats, section 7.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ariac_score import DataFileError, Fact, Likeness, LogDescription, ReaderFacts, Trial, Wanted, load_yaml
from ariac_score_ariac.config.config_forms import form_in, form_of, top_level_keys
from ariac_score_ariac.config.config_values import ConfigPath, ConfigValues
from ariac_score_ariac.config.listed_orders import listed_orders
from ariac_score_ariac.config.order_counts import REQUIRED_KEYS, order_counts
from ariac_score_ariac.config.shipment_orders import shipment_orders
from ariac_score_ariac.work import NO_HUMAN, FaultyProducts, Order, orders_of

__all__ = ["TrialConfigReader"]

FORMAT = "ARIAC trial configuration"
MAX_TIME_LIMIT_S = 1e6
_NO_LIMIT = -1
"""What a configuration of 2017 to 2024 gives for a trial without a limit."""
_USED = ("orders", "options", "challenges", "time_limit", *REQUIRED_KEYS, "CHALLENGES")


class TrialConfigReader:
    """Reads the orders of a trial configuration, and the numbers it states of the trial.

    Orders and their updates are given side by side, without times: when each was
    announced, and so whether an update came, is only in a log of the trial.

    Reads:
        Orders with their tasks, products and poses; of 2025 how many orders of each kind.
    Refuses:
        YAML that is none, an unknown key, and a number or name that cannot be one.
    Source:
        `nist_gear/script/gear.py` of 2017 to 2022; ARIAC notes on log formats, section 7.
    """

    facts = ReaderFacts(
        role="trial_config", a_file="a trial configuration", formats="trial configurations of ARIAC (YAML)"
    )

    def can_read(self, path: Path) -> bool:
        """Whether it is a YAML file with `orders`, or the numbers of 2025, at its top level."""
        keys = top_level_keys(path)
        return "orders" in keys or len(keys & set(REQUIRED_KEYS)) > 2

    def likeness(self, path: Path) -> Likeness:
        """What the file looks like, by the form that each edition has."""
        form = form_in(path)
        return Likeness(str(form), frozenset(map(str, form.years)))

    def describe(self, path: Path) -> LogDescription:
        """How many orders, tasks and products it asks for; of 2025 its numbers."""
        try:
            trial = _trial(path)
        except DataFileError as error:
            return LogDescription(format=FORMAT, damage=str(error))
        tasks = [task for order in orders_of(trial) for task in order.tasks]
        facts: dict[str, int | float | str] = {
            "orders": sum(1 for order in orders_of(trial) if not order.updates),
            "updates": sum(1 for order in orders_of(trial) if order.updates),
            "tasks": len(tasks),
            "products": sum(len(task.products) for task in tasks),
        }
        return LogDescription(
            format=FORMAT,
            defects=trial.log_defects,
            facts=facts if trial.work else {name: _short(value) for name, value in trial.facts.items()},
        )

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The orders, in the order of the file, and the numbers; see `Trial.facts`.

        A mistake that changes no order, such as the rotation `p1/2` of official files
        where parts are put before the start, is named among the defects.

        Raises:
            DataFileError: It is malformed, it is no trial configuration, or an order or
                a number has not the shape of its year.
        """
        trial = _trial(path)
        wanted.progress(1.0)
        return trial


def _short(value: Fact) -> int | float | str:
    """A whole number as one."""
    if isinstance(value, float):
        return int(value) if value.is_integer() else value
    return "absent" if value is None else value


def _trial(path: Path) -> Trial:
    # Official files repeat keys in their surroundings; where it could change an order, that is refused.
    document = load_yaml(path, may_repeat=_is_unused)
    values = ConfigValues(document)
    if document.data is None:
        values.refuse((), "the file is empty", "this official file holds no trial; choose another")
    root = values.mapping(document.data, ())
    orders: tuple[Order, ...] = ()
    faulty: frozenset[str] | None = None
    if "orders" in root:
        faulty = _faulty_products(values, root)
        orders, facts = _orders(values, root), _time_limit(values, root)
    # With some keys missing it is still meant as one of 2025; the message then names the first of them.
    elif len(root.keys() & set(REQUIRED_KEYS)) > 2:
        facts = order_counts(values, root)
    else:
        values.refuse(
            (),
            f"it looks like {form_of(root)}: there are no orders in it",
            "name the file of the trial: it has 'orders' (2017 to 2024), or NUM_KITS and NUM_MODULES (2025)",
        )
    return Trial(
        id=path.stem,
        witnessed=frozenset() if _may_have_a_human(root) else frozenset({NO_HUMAN}),
        work=orders,
        facts=facts,
        log_defects=values.mistakes(),
        records=() if faulty is None else (FaultyProducts(faulty),),
    )


def _may_have_a_human(root: Mapping[Any, Any]) -> bool:
    """Whether somebody may walk about: until 2022 people are surroundings, from 2023 on a challenge."""
    if isinstance(root.get("orders"), dict):
        return True
    challenges = root.get("challenges")
    return isinstance(challenges, list) and any("human" in c for c in challenges if isinstance(c, dict))


def _faulty_products(values: ConfigValues, root: Mapping[Any, Any]) -> frozenset[str] | None:
    """The individuals that are faulty (2017 to 2022); from 2023 on challenges make parts faulty."""
    if isinstance(root.get("orders"), list):
        return None
    path: ConfigPath = ("faulty_products",)
    listed = values.sequence(root.get("faulty_products") or [], path)
    return frozenset(values.text(name, (*path, i)) for i, name in enumerate(listed))


def _is_unused(path: ConfigPath) -> bool:
    """Whether a key is about the surroundings of a trial, which no score depends on."""
    if path[0] == "options":
        return len(path) > 1 and path[1] != "model_type_aliases"
    return path[0] not in _USED


def _orders(values: ConfigValues, root: Mapping[Any, Any]) -> tuple[Order, ...]:
    """The orders in either form; numbers elsewhere that are none are noted."""
    if isinstance(root["orders"], list):
        orders = listed_orders(values, root)
        values.note_numbers(root.get("parts"), ("parts",), lambda path: path[-1] in ("rotation", "offset"))
        inserts = ("assembly_inserts",)
        values.note_numbers(root.get("assembly_inserts"), inserts, lambda path: True)  # noqa: ARG005
        return orders
    orders = shipment_orders(values, root)
    for key, tree in root.items():
        # The surroundings of the trial: official files have mistakes there that change no order.
        if key not in ("orders", "options"):
            values.note_numbers(tree, (str(key),), _is_part_of_pose)
    return orders


def _is_part_of_pose(path: ConfigPath) -> bool:
    return len(path) > 1 and path[-2] in ("xyz", "rpy", "xyz_start", "xyz_end")


def _time_limit(values: ConfigValues, root: Mapping[Any, Any]) -> dict[str, float]:
    """The time limit of 2017 to 2024; nothing when there is none, or the file does not say."""
    if "time_limit" not in root:
        options = root.get("options")
        if isinstance(options, dict) and "time_limit" in options:
            values.note(
                "ignored_key",
                ("options", "time_limit"),
                "'time_limit' stands below 'options'",
                "it is ignored, as the start-up script does; put it at the top level",
            )
        return {}
    path: ConfigPath = ("time_limit",)
    limit_s = values.number(root["time_limit"], path)
    if limit_s == _NO_LIMIT:
        return {}
    if not 0 <= limit_s <= MAX_TIME_LIMIT_S:
        values.refuse(path, f"{limit_s:g} s is no time limit", "give a number of seconds, or -1 for none")
    return {"time_limit_s": limit_s}
