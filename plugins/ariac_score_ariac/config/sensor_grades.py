"""The graded sensors of 2025: what a sensor can do decides what it costs.

DIFF: a lidar of 10 Hz and exactly 200 samples belongs to the cheaper grade by the rulebook, to the dearer
one by the simulator's code (`ariac_setup/structures.py`). The rulebook is followed.

Source: ARIAC 2025 rulebook, section "sensor grades"; `ariac_setup/config/user_config_schema.json` of
branch ariac2025.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ariac_score_ariac.config.config_values import ConfigPath, ConfigValues

__all__ = ["MAX_LIDAR_SAMPLES", "graded_type"]

MAX_LIDAR_SAMPLES = 400
"""Horizontal times vertical samples; a lidar with more is not built."""
SMALL_LIDAR_SAMPLES = 200
_TYPES = ("break_beam", "distance", "camera", "lidar")
_RESOLUTIONS = ("720p", "1080p")
_RATES_HZ = (10, 30)
_CAMERA_RATE_HZ = 30
_LIDAR_RATES_HZ = (10, 20)


def graded_type(values: ConfigValues, sensor: Mapping[Any, Any], path: ConfigPath) -> str:
    """The type of a sensor with its grade, which a price list names.

    One of `break_beam_10hz`, `break_beam_30hz`, `distance_10hz`, `distance_30hz`,
    `camera_720p_30hz`, `camera_1080p_30hz`, `lidar_20hz`, `lidar_10hz_400_samples`
    (more than 200) and `lidar_10hz_200_samples` (up to 200).

    Raises:
        DataFileError: A sensor has no such grade.
    """
    kind = values.one_of(sensor, "TYPE", _TYPES, path)
    rate_hz = values.number(values.given(sensor, "UPDATE_RATE", path), (*path, "UPDATE_RATE"))
    if kind == "camera":
        return _camera(values, sensor, rate_hz, path)
    if kind == "lidar":
        return _lidar(values, sensor, rate_hz, path)
    if rate_hz not in _RATES_HZ:
        _refuse_rate(values, kind, rate_hz, path, "10 or 30")
    return f"{kind}_{rate_hz:.0f}hz"


def _refuse_rate(values: ConfigValues, kind: str, rate_hz: float, path: ConfigPath, known: str) -> None:
    values.refuse((*path, "UPDATE_RATE"), f"there is no {kind} of {rate_hz:g} Hz", f"give {known}")


def _camera(values: ConfigValues, sensor: Mapping[Any, Any], rate_hz: float, path: ConfigPath) -> str:
    # The simulator's own default.
    resolution = values.one_of({"RESOLUTION": "720p", **sensor}, "RESOLUTION", _RESOLUTIONS, path)
    if not 1 <= rate_hz <= _CAMERA_RATE_HZ:
        _refuse_rate(values, "camera", rate_hz, path, "30")
    if rate_hz != _CAMERA_RATE_HZ:
        values.note(
            "configuration_mistake",
            (*path, "UPDATE_RATE"),
            f"there is no grade for a camera of {rate_hz:g} Hz",
            "it counts as one of 30 Hz, as in the simulator, which goes by the resolution",
        )
    return f"camera_{resolution}_{_CAMERA_RATE_HZ}hz"


def _lidar(values: ConfigValues, sensor: Mapping[Any, Any], rate_hz: float, path: ConfigPath) -> str:
    if rate_hz not in _LIDAR_RATES_HZ:
        _refuse_rate(values, "lidar", rate_hz, path, "10 or 20")
    samples = _samples(values, sensor, "HORIZONTAL", path) * _samples(values, sensor, "VERTICAL", path)
    if samples > MAX_LIDAR_SAMPLES:
        values.refuse(
            path, f"a lidar of {samples} samples is not allowed", f"give {MAX_LIDAR_SAMPLES} in all at most"
        )
    if rate_hz == max(_LIDAR_RATES_HZ):
        return "lidar_20hz"
    # DIFF at exactly 200, see above.
    most = SMALL_LIDAR_SAMPLES if samples <= SMALL_LIDAR_SAMPLES else MAX_LIDAR_SAMPLES
    return f"lidar_10hz_{most}_samples"


def _samples(values: ConfigValues, sensor: Mapping[Any, Any], direction: str, path: ConfigPath) -> int:
    place = (*path, direction)
    scan = values.mapping(values.given(sensor, direction, path), place)
    samples = values.given(scan, "SAMPLES", place)
    return values.whole(
        samples, (*place, "SAMPLES"), at_least=1, at_most=MAX_LIDAR_SAMPLES, what="samples are not allowed"
    )
