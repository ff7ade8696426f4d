"""Trial configurations of 2025: how many kits and modules to build, and what goes wrong meanwhile.

They name no order: kits and modules are counted, and high-priority orders come by the way.

Source: ARIAC notes on log formats, section 7.4; `ariac_setup/config/trial_schema.json` of branch ariac2025.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

from ariac_score import did_you_mean
from ariac_score_ariac.config.config_values import MAX_COUNT, ConfigPath, ConfigValues, shown

__all__ = ["REQUIRED_KEYS", "order_counts"]

REQUIRED_KEYS = ("ID", "SEED", "DEFECT_RATE", "TIME_LIMIT", "NUM_KITS", "NUM_MODULES")
_KEYS = (*REQUIRED_KEYS, "POSSIBLE_DEFECTS", "CHALLENGES")
_ID = re.compile(r"[A-Z0-9]{8}")
_LARGEST = 10**9
# What the simulator's own schema accepts. More is noted and not refused: its score is defined all the same.
_OFFICIAL_MOST: Mapping[str, int] = MappingProxyType({"NUM_KITS": 12, "NUM_MODULES": 16})
_CHALLENGES: Mapping[str, Mapping[str, tuple[int, int]]] = MappingProxyType(
    {
        "CONVEYOR_MALFUNCTIONS": {"START_TIME": (0, _LARGEST), "DURATION": (1, _LARGEST)},
        "VOLTAGE_TESTER_MALFUNCTIONS": {
            "START_TIME": (0, _LARGEST),
            "DURATION": (0, _LARGEST),
            "TESTER": (1, 2),
        },
        "VACUUM_TOOL_MALFUNCTIONS": {"TOOL": (1, 2), "GRASP_OCCURRENCE": (1, _LARGEST)},
        "HIGH_PRIORITY_ORDERS": {"START_TIME": (0, _LARGEST)},
    }
)
"""Whole numbers of each challenge, with their limits."""


def order_counts(values: ConfigValues, root: Mapping[Any, Any]) -> dict[str, float]:
    """The numbers that a trial configuration of 2025 states, by name.

    Raises:
        DataFileError: A key is missing or unknown, or a value is out of its range.
    """
    _refuse_unknown(values, root, _KEYS, ())
    for key in REQUIRED_KEYS:
        values.given(root, key, ())
    _check_id(values, root["ID"])
    values.whole(root["SEED"], ("SEED",), at_least=0, at_most=2**63, what="is no seed")
    if not 0 <= values.number(root["DEFECT_RATE"], ("DEFECT_RATE",)) <= 1:
        values.refuse(("DEFECT_RATE",), f"{root['DEFECT_RATE']!r} is no rate", "give 0 to 1")
    _check_defects(values, root)
    limit_s = values.whole(
        root["TIME_LIMIT"], ("TIME_LIMIT",), at_least=100, at_most=_LARGEST, what="s is no time limit"
    )
    return {
        "num_high_priority": float(_high_priority(values, root)),
        "num_kits": float(_number_of(values, root, "NUM_KITS")),
        "num_modules": float(_number_of(values, root, "NUM_MODULES")),
        "time_limit_s": float(limit_s),
    }


def _refuse_unknown(
    values: ConfigValues, parts: Mapping[Any, Any], known: Sequence[str], path: ConfigPath
) -> None:
    """The official software refuses unknown keys too; a misspelt one would be lost without a word."""
    for key in parts:
        if key not in known:
            values.refuse((*path, str(key)), f"unknown key {shown(key)}", did_you_mean(str(key), known))


def _check_id(values: ConfigValues, trial_id: Any) -> None:
    if not isinstance(trial_id, str) or not _ID.fullmatch(trial_id):
        values.refuse(
            ("ID",),
            f"{shown(trial_id)} is no trial id",
            "give 8 capital letters and digits, in quotes if they could be taken for a number",
        )


def _check_defects(values: ConfigValues, root: Mapping[Any, Any]) -> None:
    if "POSSIBLE_DEFECTS" in root:
        path = ("POSSIBLE_DEFECTS",)
        for number, defect in enumerate(values.sequence(root["POSSIBLE_DEFECTS"], path)):
            values.whole(defect, (*path, number), at_least=1, at_most=MAX_COUNT, what="is no type of defect")


def _number_of(values: ConfigValues, root: Mapping[Any, Any], key: str) -> int:
    words = {"NUM_KITS": "kits", "NUM_MODULES": "modules"}[key]
    number = values.whole(root[key], (key,), at_least=0, at_most=MAX_COUNT, what=f"{words} cannot be ordered")
    if number > _OFFICIAL_MOST[key]:
        values.note(
            "configuration_mistake",
            (key,),
            f"{number} {words} are more than the simulator accepts",
            f"at most {_OFFICIAL_MOST[key]} can be ordered",
        )
    return number


def _high_priority(values: ConfigValues, root: Mapping[Any, Any]) -> int:
    """The number of high-priority orders; all challenges are checked."""
    challenges = root.get("CHALLENGES")
    if challenges is None:
        return 0
    path: ConfigPath = ("CHALLENGES",)
    _refuse_unknown(values, values.mapping(challenges, path), [*_CHALLENGES], path)
    for kind, listed in challenges.items():
        for number, challenge in enumerate(values.sequence(listed, (*path, kind))):
            _check_challenge(values, kind, challenge, (*path, kind, number))
    orders = challenges.get("HIGH_PRIORITY_ORDERS", [])
    if len(orders) > MAX_COUNT:
        values.refuse(
            (*path, "HIGH_PRIORITY_ORDERS"),
            f"{len(orders)} orders cannot be given",
            f"give up to {MAX_COUNT}",
        )
    seen: set[str] = set()
    for number, order in enumerate(orders):
        if order["ID"] in seen:
            values.note(
                "configuration_mistake",
                (*path, "HIGH_PRIORITY_ORDERS", number, "ID"),
                f"high-priority order {shown(order['ID'])} is given twice",
                "both count, as in the official score",
            )
        seen.add(order["ID"])
    return len(orders)  # as the simulator fills `num_high_priority` of its database


def _check_challenge(values: ConfigValues, kind: str, challenge: Any, path: ConfigPath) -> None:
    parts = values.mapping(challenge, path)
    limits = _CHALLENGES[kind]
    named = ("ID",) if kind == "HIGH_PRIORITY_ORDERS" else ()
    _refuse_unknown(values, parts, [*limits, *named], path)
    for key, (low, high) in limits.items():
        words = f"is no {key}"
        values.whole(values.given(parts, key, path), (*path, key), at_least=low, at_most=high, what=words)
    for key in named:
        values.text(values.given(parts, key, path), (*path, key))
