"""What a YAML file of ARIAC looks like: trial, team, or something else, and of which years.

Each edition wrote its configurations in its own form. Told apart by their keys, so that
a file that is not the one asked for can be called by its name.

Source: ARIAC notes on log formats, sections 7 and 8, and the official files themselves.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ariac_score.datafiles import load_yaml
from ariac_score.errors import DataFileError

__all__ = ["looks_like", "top_level_keys", "years_in"]

_SNIFFED_BYTES = 4_000_000
_KEY = re.compile(rb"""^(?:\xef\xbb\xbf)?["']?([A-Za-z_][A-Za-z0-9_]*)["']?[ \t]*:""", re.MULTILINE)
_NAMED_KEYS = 5

_TRIAL_2025 = frozenset({"SEED", "DEFECT_RATE", "TIME_LIMIT", "NUM_KITS", "NUM_MODULES"})
_SENSORS_2023 = frozenset(
    {"proximity", "lidar", "rgb_camera", "basic_logical_camera", "advanced_logical_camera"}
)

_SENSORS_OF_BOTH = frozenset({"break_beam", "laser_profiler", "rgbd_camera"})
"""Sensor types that until 2022 and in 2023 have one name."""


def top_level_keys(path: Path) -> frozenset[str]:
    """The keys that begin a line of a YAML file; none when it is no such file. Never an error."""
    try:
        if path.suffix not in (".yaml", ".yml") or not path.is_file():
            return frozenset()
        with path.open("rb") as file:
            head = file.read(_SNIFFED_BYTES)
    except OSError:
        return frozenset()
    return frozenset(key.decode() for key in _KEY.findall(head))


def looks_like(path: Path) -> str:
    """What a file looks like, in words that end `it looks like …`, such as `a trial configuration of 2022`.

    No value of the file is part of the words: team files hold access tokens.
    """
    try:
        data = load_yaml(path, may_repeat=lambda _path: True).data
    except DataFileError:
        return "no YAML file that can be read"
    if data is None:
        return "an empty file"
    if not isinstance(data, dict):
        return "a YAML file without keys"
    return form_of(data)


def years_in(words: str) -> frozenset[int]:
    """The years that the words of `looks_like` name; none when they name none.

    >>> sorted(years_in("a trial configuration of 2018 to 2020"))
    [2018, 2019, 2020]
    >>> sorted(years_in("a trial configuration of 2023 or 2024")), sorted(years_in("a rule set"))
    ([2023, 2024], [])
    """
    years = [int(year) for year in re.findall(r"\b20\d\d\b", words)]
    return frozenset(range(min(years), max(years) + 1)) if years else frozenset()


def form_of(root: Mapping[Any, Any]) -> str:
    """What a document with these keys looks like; see `looks_like`."""
    for words in (_trial(root), _team(root), _other(root)):
        if words:
            return words
    keys = sorted(str(key)[:40] for key in root)
    more = ", …" if len(keys) > _NAMED_KEYS else ""
    return f"a YAML file with the keys {', '.join(keys[:_NAMED_KEYS])}{more}"


def _trial(root: Mapping[Any, Any]) -> str:
    if len(_TRIAL_2025 & root.keys()) > 1:
        return "a trial configuration of 2025"
    if "orders" not in root:
        surroundings = ("kitting_trays", "models_over_bins", "models_over_shelves", "agv_infos", "time_limit")
        return "a trial configuration without orders" if any(key in root for key in surroundings) else ""
    years = "2023 or 2024" if isinstance(root["orders"], list) else _shipment_years(root)
    return f"a trial configuration of {years}"


def _shipment_years(root: Mapping[Any, Any]) -> str:
    orders = root["orders"]
    keys = {key for order in _maps(orders) for key in order}
    if keys & {"kitting", "assembly"}:
        blocks = [key for order in _maps(orders) for block in _maps(order) for key in block]
        return "2022" if "trays" in blocks or "table_tray_infos" in root else "2021 or 2022"
    if keys & {"kit_count", "parts"}:
        return "2017"
    return "2019 or 2020" if "destinations" in keys or "shelf_layout" in root else "2018 to 2020"


def _maps(value: Any) -> Iterator[Mapping[Any, Any]]:
    """The maps a map holds."""
    return (
        (inner for inner in value.values() if isinstance(inner, dict))
        if isinstance(value, dict)
        else iter(())
    )


def _team(root: Mapping[Any, Any]) -> str:
    if "COMPETITOR_NAME" in root or "SENSORS" in root:
        return "a team configuration of 2025"
    if "team_name" in root:
        return "a team's entry for the evaluation of 2023 or 2024"
    if "static_sensors" in root or "robot_cameras" in root:
        return "a team configuration of 2024"
    if "gantry_bin_camera" in root or "gantry_tray_camera" in root:
        return "a team configuration of 2022"
    if "robot_camera" in root:
        return "a team configuration of 2021 or 2022"
    if "sensors" in root:
        types = {sensor["type"] for sensor in _maps(root["sensors"]) if isinstance(sensor.get("type"), str)}
        years = (
            "2023"
            if types & _SENSORS_2023
            else "2017 to 2022"
            if types - _SENSORS_OF_BOTH
            else "2017 to 2023"
        )
        return f"a team configuration of {years}"
    return ""


def _other(root: Mapping[Any, Any]) -> str:
    if "models_to_spawn" in root:
        return "models put into the simulation for a test of the scorer, without orders"
    if {"WEIGHTS", "PENALTIES"} & root.keys():
        return "the scoring weights of 2025"
    if "DEFECT_TYPES" in root:
        return "the list of cell defects of 2025"
    if {"bins", "assembly_stations", "conveyor_belt"} & root.keys():
        return "the places of bins and stations in the simulation of 2024"
    if any("ros__parameters" in node for node in _maps(root)):
        return "parameters of ROS nodes"
    if "score" in root and {"rules", "monitors"} & root.keys():
        return "a rule set"
    return ""
