"""What a YAML file of ARIAC looks like: trial, team, or something else, and of which years.

Each edition wrote its configurations in its own form, which shows in the keys. So a message
about a wrong file can say what the file is instead.

Source: ARIAC notes on log formats, sections 7 and 8, and the official files themselves.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ariac_score import DataFileError, load_yaml

__all__ = ["Form", "form_in", "form_of", "looks_like", "top_level_keys"]

_TRIAL, _TEAM = "a trial configuration", "a team configuration"
_SNIFFED_BYTES = 4_000_000
_KEY = re.compile(rb"""^(?:\xef\xbb\xbf)?["']?([A-Za-z_][A-Za-z0-9_]*)["']?[ \t]*:""", re.MULTILINE)
_NAMED_KEYS = 5
"""So many keys of an unknown file are named in a message."""

_TRIAL_2025 = frozenset({"SEED", "DEFECT_RATE", "TIME_LIMIT", "NUM_KITS", "NUM_MODULES"})
_SENSORS_2023 = frozenset(
    {"proximity", "lidar", "rgb_camera", "basic_logical_camera", "advanced_logical_camera"}
)

_SENSORS_OF_BOTH = frozenset({"break_beam", "laser_profiler", "rgbd_camera"})
"""Sensor types that until 2022 and in 2023 have one name."""


@dataclass(frozen=True)
class Form:
    """What a YAML file looks like.

    Attributes:
        what: In words, such as `a trial configuration`; no value of the file is part of them.
        years: The editions that wrote it in this form, in order; empty where none is known.
    """

    what: str
    years: tuple[int, ...] = ()

    def __str__(self) -> str:
        """Words that end `it looks like …`.

        >>> str(Form("a trial configuration", (2019, 2020))), str(Form("a team", (2017, 2018, 2019)))
        ('a trial configuration of 2019 or 2020', 'a team of 2017 to 2019')
        """
        if not self.years:
            return self.what
        first, last = self.years[0], self.years[-1]
        between = " or " if last == first + 1 else " to "
        return f"{self.what} of {first}" + (f"{between}{last}" if last > first else "")


def top_level_keys(path: Path) -> frozenset[str]:
    """The keys that begin a line of a YAML file; none when it is no such file. Never an error."""
    try:
        if path.suffix not in (".yaml", ".yml") or not path.is_file():
            return frozenset()
        with path.open("rb") as file:
            head = file.read(_SNIFFED_BYTES)
    except OSError:
        return frozenset()
    # Not by a parser: readers are tried on every file of a folder, and a file need not be whole to be known.
    return frozenset(key.decode() for key in _KEY.findall(head))


def looks_like(path: Path) -> str:
    """What a file looks like, in words that end `it looks like …`."""
    return str(form_in(path))


def form_in(path: Path) -> Form:
    """What a file looks like. No value of the file is part of it: team files hold access tokens."""
    try:
        # A key given twice is a mistake of the file, and no reason not to say what it looks like.
        data = load_yaml(path, may_repeat=lambda _path: True).data
    except DataFileError:
        return Form("no YAML file that can be read")
    if data is None:
        return Form("an empty file")
    if not isinstance(data, dict):
        return Form("a YAML file without keys")
    return form_of(data)


def form_of(root: Mapping[Any, Any]) -> Form:
    """What a document with these keys looks like."""
    form = _trial(root) or _team(root) or _other(root)
    if form:
        return form
    keys = sorted(str(key)[:40] for key in root)
    more = ", …" if len(keys) > _NAMED_KEYS else ""
    return Form(f"a YAML file with the keys {', '.join(keys[:_NAMED_KEYS])}{more}")


def _years(first: int, last: int) -> tuple[int, ...]:
    return tuple(range(first, last + 1))


def _trial(root: Mapping[Any, Any]) -> Form | None:
    # One alone, such as SEED, may stand in a file of any kind.
    if len(_TRIAL_2025 & root.keys()) > 1:
        return Form(_TRIAL, (2025,))
    if "orders" not in root:
        surroundings = ("kitting_trays", "models_over_bins", "models_over_shelves", "agv_infos", "time_limit")
        return Form(f"{_TRIAL} without orders") if any(key in root for key in surroundings) else None
    return Form(_TRIAL, (2023, 2024) if isinstance(root["orders"], list) else _shipment_years(root))


def _shipment_years(root: Mapping[Any, Any]) -> tuple[int, ...]:
    orders = root["orders"]
    keys = {key for order in _maps(orders) for key in order}
    if keys & {"kitting", "assembly"}:
        blocks = [key for order in _maps(orders) for block in _maps(order) for key in block]
        return (2022,) if "trays" in blocks or "table_tray_infos" in root else (2021, 2022)
    # Kits of parts are words of 2017. Destinations came in 2019, shelves in 2020.
    if keys & {"kit_count", "parts"}:
        return (2017,)
    return (2019, 2020) if "destinations" in keys or "shelf_layout" in root else _years(2018, 2020)


def _maps(value: Any) -> Iterator[Mapping[Any, Any]]:
    """The maps a map holds."""
    return (
        (inner for inner in value.values() if isinstance(inner, dict))
        if isinstance(value, dict)
        else iter(())
    )


def _team(root: Mapping[Any, Any]) -> Form | None:
    if "COMPETITOR_NAME" in root or "SENSORS" in root:
        return Form(_TEAM, (2025,))
    if "team_name" in root:
        return Form("a team's entry for the evaluation", (2023, 2024))
    if "static_sensors" in root or "robot_cameras" in root:
        return Form(_TEAM, (2024,))
    if "gantry_bin_camera" in root or "gantry_tray_camera" in root:
        return Form(_TEAM, (2022,))
    if "robot_camera" in root:
        return Form(_TEAM, (2021, 2022))
    if "sensors" not in root:
        return None
    # Until 2022 and in 2023 the keys are the same: only the types differ, and some of these do not.
    types = {sensor["type"] for sensor in _maps(root["sensors"]) if isinstance(sensor.get("type"), str)}
    if types & _SENSORS_2023:
        return Form(_TEAM, (2023,))
    return Form(_TEAM, _years(2017, 2022 if types - _SENSORS_OF_BOTH else 2023))


def _other(root: Mapping[Any, Any]) -> Form | None:
    if "models_to_spawn" in root:
        return Form("models put into the simulation for a test of the scorer, without orders")
    if {"WEIGHTS", "PENALTIES"} & root.keys():
        return Form("the scoring weights", (2025,))
    if "DEFECT_TYPES" in root:
        return Form("the list of cell defects", (2025,))
    if {"bins", "assembly_stations", "conveyor_belt"} & root.keys():
        return Form("the places of bins and stations in the simulation", (2024,))
    if any("ros__parameters" in node for node in _maps(root)):
        return Form("parameters of ROS nodes")
    if "score" in root and {"rules", "monitors"} & root.keys():
        return Form("a rule set")
    return None
