"""Reading the team configurations of ARIAC 2017 to 2025: the sensors a team placed, and its name.

Source: ARIAC notes on log formats, section 8.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ariac_score import (
    DataFileError,
    Likeness,
    LogDescription,
    ReaderFacts,
    TeamSetup,
    Trial,
    Wanted,
    did_you_mean,
    load_yaml,
)
from ariac_score_ariac.config.config_forms import form_in, form_of, top_level_keys
from ariac_score_ariac.config.config_values import MAX_COUNT, ConfigPath, ConfigValues, shown
from ariac_score_ariac.config.sensor_grades import graded_type

__all__ = ["SENSOR_TYPES", "TeamConfigReader", "TeamNameReader"]

FORMAT = "ARIAC team configuration"
SENSOR_TYPES = (
    "break_beam",
    "camera",
    "depth_camera",
    "laser_profiler",
    "logical_camera",
    "proximity_sensor",
    "quality_control",
    "rgbd_camera",
    "advanced_logical_camera",
    "basic_logical_camera",
    "lidar",
    "proximity",
    "rgb_camera",
)
"""Types of 2017 to 2022, then those that came in 2023."""

_PLACED = ("sensors", "static_sensors")
_SWITCHED = ("robot_camera", "gantry_bin_camera", "gantry_tray_camera")
"""Cameras of 2021 and 2022 on the gantry robot; each is a type of its own."""
_KEYS_2025 = ("COMPETITOR_NAME", "CONVEYOR_SPEED", "CELL_FEED_RATE", "SENSORS")
_SENSOR_KEYS = (*_PLACED, *_SWITCHED, "robot_cameras", *_KEYS_2025)
_MAX_SPEED_M_S = 0.1
_CELLS_PER_SPEED = 2
"""The official bound of the feed rate, Hz for each m/s: `CELL_FEED_RATE <= 2 * CONVEYOR_SPEED`."""


class TeamConfigReader:
    """Reads the sensors a team placed.

    A camera on a robot is one of them when it is switched on. Sensors of 2025 are
    typed with their grade, such as `camera_1080p_30hz` (see `sensor_grades`).

    Reads:
        The sensors by name and type.
    Refuses:
        YAML that is none, and sensors whose type is not given or has no grade.
    Source:
        ARIAC notes on log formats, section 8.
    """

    facts = ReaderFacts(
        role="team_config", a_file="a team configuration", formats="team configurations of ARIAC (YAML)"
    )

    def can_read(self, path: Path) -> bool:
        """Whether it is a YAML file with sensors (2024: static ones or robot cameras) but no `orders`."""
        keys = top_level_keys(path)
        return bool(keys & set(_SENSOR_KEYS)) and "orders" not in keys

    def likeness(self, path: Path) -> Likeness:
        """What the file looks like, by the form that each edition has."""
        form = form_in(path)
        return Likeness(str(form), frozenset(map(str, form.years)))

    def describe(self, path: Path) -> LogDescription:
        """How many sensors the team has, by type."""
        try:
            trial = _trial(path)
        except DataFileError as error:
            return LogDescription(format=FORMAT, damage=str(error))
        assert trial.team is not None
        assert trial.team.sensors is not None
        types = sorted(trial.team.sensors.values())
        facts: dict[str, int | float | str] = {"sensors": len(types)}
        facts |= {kind: types.count(kind) for kind in types}
        if trial.team.name:
            facts["team"] = trial.team.name
        return LogDescription(format=FORMAT, facts=facts, defects=trial.log_defects)

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The team's set-up; its name is in files of 2025 only.

        Raises:
            DataFileError: It is malformed, it is no team configuration, or a sensor has no type or no grade.
        """
        trial = _trial(path)
        wanted.progress(1.0)
        return trial


class TeamNameReader:
    """Reads the team's name from its entry for the official evaluation of 2023 and 2024.

    Such a file holds an access token. Nothing but the name is taken from it, and no
    message quotes from it.

    Reads:
        `team_name`, and nothing else.
    Refuses:
        A name that is no text.
    Source:
        ARIAC notes on log formats, section 8.
    """

    facts = ReaderFacts(role="team_name", a_file="a team entry")

    def can_read(self, path: Path) -> bool:
        """Whether it is a YAML file with `team_name` and what to fetch or launch."""
        keys = top_level_keys(path)
        return "team_name" in keys and bool(keys & {"github", "build", "competition"})

    def describe(self, path: Path) -> LogDescription:
        """The name of the team."""
        try:
            return LogDescription(format=f"{FORMAT} (entry)", facts={"team": _entry_name(path)})
        except DataFileError as error:
            return LogDescription(format=f"{FORMAT} (entry)", damage=str(error))

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The team's name; which sensors it placed is not in such a file.

        Raises:
            DataFileError: It is malformed, or has no name.
        """
        name = _entry_name(path)
        wanted.progress(1.0)
        return Trial(id=path.stem, team=TeamSetup(name))


def _entry_name(path: Path) -> str:
    try:
        root = load_yaml(path).data
    except DataFileError as error:
        # Its own words may quote the file.
        raise DataFileError(
            "it cannot be read as YAML", file=path, place=error.place, hint="check indentation and quotes"
        ) from None
    name = root.get("team_name") if isinstance(root, dict) else None
    if not isinstance(name, str) or not name:
        raise DataFileError("the team has no name", file=path, hint="give 'team_name', a text")
    return name


def _trial(path: Path) -> Trial:
    document = load_yaml(path, may_repeat=_is_unused)
    values = ConfigValues(document)
    if document.data is None:
        values.refuse((), "the file is empty", "a team without sensors writes 'sensors: {}'")
    root = values.mapping(document.data, ())
    if "orders" in root or not root.keys() & set(_SENSOR_KEYS):
        values.refuse(
            (),
            f"it looks like {form_of(root)}, not like a team configuration",
            "name the file with the team's sensors: 'sensors' (2017 to 2023), 'static_sensors' (2024) "
            "or 'SENSORS' (2025)",
        )
    if root.keys() & set(_KEYS_2025):
        name, sensors = _team_of_2025(values, root)
    else:
        name, sensors = "", _sensors(values, root)
    if len(sensors) > MAX_COUNT:
        values.refuse((), f"{len(sensors)} sensors cannot be placed", f"give {MAX_COUNT} at most")
    team = TeamSetup(name, MappingProxyType(dict(sorted(sensors.items()))))
    return Trial(id=path.stem, team=team, log_defects=values.mistakes())


def _is_unused(path: ConfigPath) -> bool:
    """Whether a key says where a sensor stands, or nothing about sensors: no cost depends on it."""
    return path[0] not in _SENSOR_KEYS or any(str(key).lower() == "pose" for key in path[2:])


def _sensors(values: ConfigValues, root: Mapping[Any, Any]) -> dict[str, str]:
    """The sensors of 2017 to 2024."""
    sensors: dict[str, str] = {}
    for key in _PLACED:
        if root.get(key) is not None:
            for name, sensor in values.mapping(root[key], (key,)).items():
                _add(values, sensors, str(name), _placed_type(values, sensor, (key, str(name))), key)
            # No cost depends on where a sensor stands, so an odd number there is named and no more.
            values.note_numbers(root[key], (key,), lambda path: path[-2] in ("xyz", "rpy"))
    if root.get("robot_cameras") is not None:
        for name, camera in values.mapping(root["robot_cameras"], ("robot_cameras",)).items():
            path: ConfigPath = ("robot_cameras", str(name))
            on_robot = values.mapping(camera, path)
            if values.truth(on_robot, "active", path):
                kind = f"robot_{values.one_of(on_robot, 'type', ('rgb', 'rgbd'), path)}_camera"
                _add(values, sensors, str(name), kind, "robot_cameras")
    for name in _SWITCHED:
        camera = root.get(name)
        if camera is not None and values.truth(values.mapping(camera, (name,)), "enable", (name,)):
            _add(values, sensors, name, name, name)
    return sensors


def _add(values: ConfigValues, sensors: dict[str, str], name: str, kind: str, key: str) -> None:
    """Take one sensor; one that replaced another of its name would not be paid for."""
    if name in sensors:
        values.refuse((key, name), f"sensor {shown(name)} is given twice", "give each its own name")
    sensors[name] = kind


def _placed_type(values: ConfigValues, sensor: Any, path: ConfigPath) -> str:
    kind = values.text(values.given(values.mapping(sensor, path), "type", path), (*path, "type"))
    # Noted and not refused: the price list of the rule set decides what it knows.
    if kind not in SENSOR_TYPES:
        values.note(
            "unknown_sensor_type",
            (*path, "type"),
            f"{shown(kind)} is no sensor type of 2017 to 2024",
            did_you_mean(kind, SENSOR_TYPES),
        )
    return kind


def _team_of_2025(values: ConfigValues, root: Mapping[Any, Any]) -> tuple[str, dict[str, str]]:
    for key in root:
        if key not in _KEYS_2025:
            values.refuse((str(key),), f"unknown key {shown(key)}", did_you_mean(str(key), _KEYS_2025))
    name = values.text(values.given(root, "COMPETITOR_NAME", ()), ("COMPETITOR_NAME",))
    _check_conveyor(values, root)
    sensors: dict[str, str] = {}
    for number, value in enumerate(values.sequence(values.given(root, "SENSORS", ()), ("SENSORS",))):
        path: ConfigPath = ("SENSORS", number)
        sensor = values.mapping(value, path)
        sensor_name = values.text(values.given(sensor, "NAME", path), (*path, "NAME"))
        if sensor_name in sensors:
            values.refuse(
                (*path, "NAME"), f"sensor {shown(sensor_name)} is given twice", "give each its own name"
            )
        sensors[sensor_name] = graded_type(values, sensor, path)
        values.note_numbers(sensor.get("POSE"), (*path, "POSE"), lambda place: place[-2] in ("XYZ", "RPY"))
    return name, sensors


def _check_conveyor(values: ConfigValues, root: Mapping[Any, Any]) -> None:
    """Speed and feed rate within what the simulator accepts; no cost depends on them."""
    speed_m_s = values.number(values.given(root, "CONVEYOR_SPEED", ()), ("CONVEYOR_SPEED",))
    if not 0 < speed_m_s <= _MAX_SPEED_M_S:
        values.refuse(("CONVEYOR_SPEED",), f"{speed_m_s:g} m/s is no speed of the conveyor", "give up to 0.1")
    rate_hz = values.number(values.given(root, "CELL_FEED_RATE", ()), ("CELL_FEED_RATE",))
    if not 0 < rate_hz <= _CELLS_PER_SPEED * speed_m_s or math.isinf(rate_hz):
        values.refuse(
            ("CELL_FEED_RATE",), f"{rate_hz:g} is no feed rate at this speed", "give up to twice the speed"
        )
