"""Worked examples of the safety monitors: every example of a file is a test.

`--standards-cases FILE` runs the examples of another file in the layout of
`worked_examples.json`; one that is given and holds none is a failure. An example names
a formula or a monitor by its key (`M1.seed`, `M11.2010.parallel`); what can be watched
is watched, on a trial made from the example's numbers, and not only computed.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.pricing import price
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.trial.velocities import centred_velocity
from ariac_score_ariac.safety import CollisionEpisodes, occurrences
from ariac_score_standards import (
    AgvProtectiveField,
    AgvSpeedClearance,
    CrushGap,
    EstopRestart,
    HandGuiding,
    MonitoredStandstill,
    PflContact,
    ReducedSpeed,
    SafeguardDistance,
    SignalCoverage,
    SpaceLimit,
    SsmResponse,
    SsmSeparation,
    StopPerformance,
)
from ariac_score_standards.body_regions import AREAS, REGIONS, body_limits
from ariac_score_standards.iec_60204_1 import stop_category
from ariac_score_standards.iso_3691_4 import braking_distance_m, protective_field_m, stopping_distance_m
from ariac_score_standards.iso_9283 import angle_performance, pose_performance
from ariac_score_standards.iso_10218_2 import (
    contact_energy_j,
    effective_robot_mass_kg,
    energy_limit_j,
    impact_force_n,
    permitted_speed_m_s,
    reduced_mass_kg,
)
from ariac_score_standards.iso_13854 import clamps
from ariac_score_standards.iso_13855 import minimum_distance
from ariac_score_standards.proxemics import time_to_collision_s, zone_of
from ariac_score_standards.signal_coverage import tracks_of
from ariac_score_standards.ssm_formula import approach_of, path_m

SHARED = Path(__file__).parents[2].parent / "shared"
DEFAULT_FILE = SHARED / "standards" / "worked_examples.json"

Inputs = Mapping[str, Any]
Outputs = Mapping[str, Any]

RUNNERS: dict[str, Callable[[Inputs], Outputs]] = {}


def runs(*keys: str) -> Callable[[Callable[[Inputs], Outputs]], Callable[[Inputs], Outputs]]:
    """Register what runs the examples of some monitor keys."""

    def register(runner: Callable[[Inputs], Outputs]) -> Callable[[Inputs], Outputs]:
        for key in keys:
            RUNNERS[key] = runner
        return runner

    return register


# Trials made from an example's numbers ---------------------------------------------------

BEFORE_S = 1e-7
"""How long before a jump its last sample lies."""

Breaks = Sequence[tuple[float, float]]
"""Times and values; straight lines between; the same time twice is a jump."""


def sampled(*profiles: Breaks, rate_hz: float = 100.0) -> tuple[Any, list[Any]]:
    """Profiles on one time base: a grid, every break, and the moment before every jump."""
    start, end = min(p[0][0] for p in profiles), max(p[-1][0] for p in profiles)
    first, last = math.ceil(start * rate_hz), math.floor(end * rate_hz)
    times = [k / rate_hz for k in range(first, last + 1)]
    for profile in profiles:
        times += [t for t, _ in profile]
        times += [a[0] - BEFORE_S for a, b in pairwise(profile) if a[0] == b[0]]
    t = np.unique(np.round(times, 9))
    t = t[(t >= start - 1e-12) & (t <= end + 1e-12)]
    return t, [values_at(profile, t) for profile in profiles]


def values_at(profile: Breaks, t: Any) -> Any:
    """Value of a profile at times; at a jump the later one."""
    times, values = (np.array(column, dtype=float) for column in zip(*profile, strict=True))
    after = np.searchsorted(times, t, side="right")
    low, high = (after - 1).clip(0), after.clip(0, len(times) - 1)
    width = times[high] - times[low]
    share = np.divide(t - times[low], width, out=np.zeros_like(t), where=width > 0)
    return values[low] + share * (values[high] - values[low])


def trial_of(
    t: Any,
    columns: Mapping[str, tuple[str, Any]],
    *,
    kinds: Mapping[str, str] | None = None,
    events: Iterable[Event] = (),
    witnessed: Iterable[str] = (),
) -> Trial:
    """A trial of a robot and a human with these signals."""
    bodies = tuple(Body(n, kind) for n, kind in (kinds or {"r": "robot", "h": "human"}).items())
    signals = {
        name: Signal(name, unit, t, np.broadcast_to(values, (len(t), *np.shape(values)[1:])))
        for name, (unit, values) in columns.items()
    }
    return Trial(
        "t",
        bodies=bodies,
        signals=signals,
        events=tuple(events),
        witnessed=frozenset(witnessed),
        recorded=Span(float(t[0]), float(t[-1])),
    )


def violations(findings: Iterable[Finding]) -> list[Finding]:
    found = list(findings)
    assert Verdict.INCONCLUSIVE not in [f.verdict for f in found], [f.message for f in found]
    return [f for f in found if f.verdict is Verdict.VIOLATED]


def total(found: Iterable[Finding], quantity: str) -> float:
    return math.fsum(f.quantities.get(quantity, 0.0) for f in found)


def largest(found: Sequence[Finding], quantity: str) -> float:
    return max((f.quantities[quantity] for f in found), default=0.0)


def each(value: Any, function: Callable[[Any], Any]) -> Any:
    """The function of a value, or of every member of a list."""
    return [function(member) for member in value] if isinstance(value, list) else function(value)


def one_or_all(given: Any, values: Any) -> Any:
    """As a list where a list was given, else the only value."""
    listed = np.atleast_1d(values).tolist()
    return listed if isinstance(given, list) else listed[0]


def first_of(inputs: Inputs, *names: str, default: Any = None) -> Any:
    """The input that an example gives under one of several names."""
    return next((inputs[name] for name in names if name in inputs), default)


# M1 to M3: speed and separation ----------------------------------------------------------


@runs("M1.seed", "M1.ariac2023", "M1.ariac2023_agent", "M1.agent")
def seed(inputs: Inputs) -> Outputs:
    names = {"t1": "t1_s", "t2": "t2_s", "B": "stopping_distance_m", "delta": "delta_m", "cap": "cap_m"}
    given = {name: inputs[key] for key, name in names.items() if inputs.get(key) is not None}
    monitor = SsmSeparation(profile=inputs.get("profile", "seed"), **given)
    human, robot = np.broadcast_arrays(*(np.atleast_1d(np.asarray(inputs[k], float)) for k in ("k_H", "k_R")))
    d_min = monitor.d_min_m(human, robot)
    listed = next((inputs[k] for k in ("k_H", "k_R") if isinstance(inputs[k], list)), 0)
    outputs = {"d_min_m": one_or_all(listed, d_min)}
    if "d" in inputs:
        outputs["violated"] = one_or_all(inputs["d"], np.atleast_1d(inputs["d"]) < d_min)
    return outputs


def standard(inputs: Inputs, **more: Any) -> SsmSeparation:
    """The full form with the example's parameters."""
    model = re.sub(r"[\s*()]", "", str(inputs.get("S_s_model", inputs.get("stop", ""))))
    given: dict[str, Any] = {"t1_s": inputs["T_r"]}
    if inputs.get("T_s") is not None:
        given["t2_s"] = inputs["T_s"]
    if "S_s" in inputs:
        given |= {"stop_model": "fixed", "stopping_distance_m": inputs["S_s"]}
    elif "a" in inputs or "2a" in model or model == "deceleration":
        given |= {"stop_model": "deceleration", "deceleration_m_s2": inputs["a"]}
    elif model in ("v_rT_s", "constant", "constant_speed", "worst_case", "worst"):
        given["stop_model"] = "constant_speed"
    else:
        given["stop_model"] = "linear"
    if "C_plus_Z" in inputs:
        given["delta_m"] = inputs["C_plus_Z"]
    else:
        margins = {"C": "intrusion_m", "Z_d": "human_uncertainty_m", "Z_r": "robot_uncertainty_m"}
        given |= {name: inputs.get(key, 0.0) for key, name in margins.items()}
    if "v_h" in inputs:
        given |= {"human_speed": "fixed", "human_speed_m_s": inputs["v_h"]}
    return SsmSeparation(profile="standard", **given, **more)


@runs("M1", "M1.full", "M1.standard")
def separation(inputs: Inputs) -> Outputs:
    monitor = standard(inputs)
    given = inputs.get("v_r", 0.0)
    v_r = np.maximum(np.atleast_1d(np.asarray(given, float)), 0.0)  # withdrawing never shrinks it
    v_h = np.full_like(v_r, inputs.get("v_h", 1.6))
    parts = {
        "S_h": monitor.human_path_m(v_h, v_r),
        "S_r": monitor.reaction_path_m(v_r),
        "S_s": monitor.stopping_path_m(v_r),
        "S_p": monitor.d_min_m(v_h, v_r),
        "T_s": monitor.stopping_time_s(v_r),
    }
    outputs = {name: one_or_all(given, part) for name, part in parts.items()}
    if "d" in inputs:
        outputs["violated"] = one_or_all(given, inputs["d"] < parts["S_p"])
        outputs["robustness_m"] = one_or_all(given, inputs["d"] - parts["S_p"])
    return outputs


@runs("M1.integral")
def integral(inputs: Inputs) -> Outputs:
    t_r, t_s = inputs["T_r"], inputs["T_s"]
    h_start = inputs.get("v_h_start", inputs.get("v_h"))
    s_h = path_m(np.array([0.0, t_r + t_s]), np.array([h_start, inputs.get("v_h_end", h_start)], float))
    r_start = inputs.get("v_r_start", inputs.get("v_r"))
    r_end = inputs.get("v_r_end", r_start)
    s_r = path_m(np.array([0.0, t_r]), np.array([r_start, r_end], float))
    stops_at = 0.0 if inputs.get("stop", "linear") == "linear" else r_end
    s_s = path_m(np.array([0.0, t_s]), np.array([r_end, stops_at], float))
    margin = inputs.get("C_plus_Z", inputs.get("C", 0.0) + inputs.get("Z_d", 0.0) + inputs.get("Z_r", 0.0))
    return {"S_h": s_h, "S_r": s_r, "S_s": s_s, "S_p": s_h + s_r + s_s + margin}


@runs("M1.directed")
def directed(inputs: Inputs) -> Outputs:
    row = {key: np.array([inputs[key]], float) for key in ("p_r", "p_h", "v_r", "v_h")}
    found = approach_of(row["p_r"], row["p_h"], row["v_r"], row["v_h"])
    scalar = {key: np.linalg.norm(row[key], axis=1) for key in ("v_r", "v_h")}
    names = {"t1": "t1_s", "t2": "t2_s", "B": "stopping_distance_m", "delta": "delta_m"}
    monitor = SsmSeparation(**{name: inputs[key] for key, name in names.items() if key in inputs})
    clamped = [np.maximum(v, 0.0) for v in (found.human_m_s, found.robot_m_s)]
    return {
        "d": float(found.distance_m[0]),
        "v_r_dir": float(found.robot_m_s[0]),
        "v_h_dir": float(found.human_m_s[0]),
        "v_r_abs": float(scalar["v_r"][0]),
        "v_h_abs": float(scalar["v_h"][0]),
        "d_dot": float(found.distance_rate_m_s[0]),
        "d_min_seed_scalar": float(monitor.d_min_m(scalar["v_h"], scalar["v_r"])[0]),
        "d_min_seed_directed": float(monitor.d_min_m(*clamped)[0]),
    }


def breaks_of(inputs: Any) -> list[tuple[float, float]]:
    """A chart as words: `3.0 to 1.0 m linearly in 4 s, back to 3.0 in 4 s, hold 2 s`; or as [t, value]."""
    if isinstance(inputs, list):
        return [(float(t), float(v)) for t, v in inputs]
    number = r"(-?[\d.]+)"
    start = re.match(rf"\s*{number}", inputs)
    assert start, inputs
    breaks = [(0.0, float(start[1]))]
    parts = re.finditer(
        rf"to {number}(?: m)?(?: linearly)? in {number} s|(?:hold|holds|stays|constant)[^\d]*{number} s",
        inputs,
    )
    for part in parts:
        t, value = breaks[-1]
        breaks.append((t + float(part[3]), value) if part[3] else (t + float(part[2]), float(part[1])))
    return breaks


@runs("M1.episode")
def episode(inputs: Inputs) -> Outputs:
    chart = breaks_of(inputs["d_profile"])
    t, (distance,) = sampled(chart, rate_hz=inputs.get("rate_hz", 100))
    columns = {"centre_distance/r/h": ("m", distance), "speed/h": ("m/s", 0.0), "speed/r": ("m/s", 0.0)}
    limits = {
        name: inputs[key] for key, name in {"t_on": "t_on_s", "t_off": "t_off_s"}.items() if key in inputs
    }
    found = violations(SsmSeparation(delta_m=inputs["S_p"], **limits).watch(trial_of(t, columns)))
    margins = [f.robustness for f in found if f.robustness is not None]
    return {
        "episodes": len(found),
        "time_in_violation_s": total(found, "time_in_violation_s"),
        "max_depth_m": largest(found, "depth_max_m"),
        "integrated_depth_m_s": total(found, "depth_integral_m_s"),
        "relative_integral_s": total(found, "relative_depth_integral_s"),
        "robustness_m": min(margins) if found else float(distance.min() - inputs["S_p"]),
        "start_s": found[0].span.start_s if found and found[0].span else None,
        "end_s": found[-1].span.end_s if found and found[-1].span else None,
        "violated": bool(found),
    }


@runs("M2.linear", "M2.deceleration", "M2.constant_speed", "M2.worst_case")
def speed_cap(inputs: Inputs) -> Outputs:
    monitor = standard({**inputs, "stop": inputs.get("stop", "linear")})
    return cap_outputs(monitor, inputs, inputs["v_h"])


def cap_outputs(monitor: SsmSeparation, inputs: Inputs, human_m_s: float) -> Outputs:
    outputs: dict[str, Any] = {}
    distance = inputs.get("d")
    if distance is None:  # a round trip: the distance a speed needs, and the speed it permits
        v = np.atleast_1d(np.asarray(inputs["v"], float))
        distance_m = monitor.d_min_m(np.full_like(v, human_m_s), v)
        outputs["S_p"] = one_or_all(inputs["v"], distance_m)
        distance = inputs["v"]
    else:
        distance_m = np.atleast_1d(np.asarray(distance, float))
    cap = monitor.speed_cap_m_s(distance_m, np.full_like(distance_m, human_m_s))
    outputs["v_max"] = one_or_all(distance, cap)
    if "d" in inputs and ("v_r" in inputs or "v" in inputs):
        outputs["violated"] = bool(inputs.get("v_r", inputs.get("v")) > cap[0])
    return outputs


@runs("M2.seed")
def speed_cap_of_the_seed(inputs: Inputs) -> Outputs:
    names = {"t1": "t1_s", "t2": "t2_s", "B": "stopping_distance_m", "delta": "delta_m"}
    monitor = SsmSeparation(**{name: inputs[key] for key, name in names.items() if key in inputs})
    return cap_outputs(monitor, inputs, inputs["k_H"])


def robot_course(inputs: str, start_s: float) -> list[tuple[float, float]]:
    """`0.8 to 10.1, linear to 0 at 10.5`: a speed held to a time, then straight lines."""
    held = re.match(r"\s*([\d.]+)(?: m/s)? (?:to|until) ([\d.]+)", inputs)
    assert held, inputs
    breaks = [(start_s, float(held[1])), (float(held[2]), float(held[1]))]
    for part in re.finditer(r"(?:linear |ramp |down )?to ([\d.]+) (?:at|by) ([\d.]+)", inputs):
        breaks.append((float(part[2]), float(part[1])))
    return breaks


@runs("M3")
def response(inputs: Inputs) -> Outputs:
    t_b = inputs["t_b"]
    robot = robot_course(inputs["robot"], t_b - 1.0)
    until = max(robot[-1][0], t_b + inputs["T_r"] + inputs["T_s"]) + 1.0
    robot.append((until, robot[-1][1]))
    far = [(t_b - 1.0, 99.0), (t_b, 99.0), (t_b, 0.1), (until, 0.1)]
    t, (speed, distance) = sampled(robot, far)
    columns = {"centre_distance/r/h": ("m", distance), "speed/h": ("m/s", 0.0), "speed/r": ("m/s", speed)}
    monitor = SsmResponse(t1_s=inputs["T_r"], t2_s=inputs["T_s"], tolerance_m_s=inputs.get("tol", 0.02))
    findings = list(monitor.watch(trial_of(t, columns)))
    found = violations(findings)
    worst = max(found, key=lambda f: f.quantities["excess_max_m_s"], default=None)
    return {
        "violated": bool(found),
        "travel_m": max(f.quantities["travel_m"] for f in findings),
        "extra_travel_m": max(f.quantities["extra_travel_m"] for f in findings),
        "peak_excess": largest(findings, "excess_max_m_s"),
        "peak_at_s": worst.evidence[0].t_s if worst else None,
        "episodes": len(found),
        "start_s": found[0].span.start_s if found and found[0].span else None,
        "end_s": found[-1].span.end_s if found and found[-1].span else None,
    }


# M4, M5: contact -------------------------------------------------------------------------


def place_on_the_body(inputs: str) -> str:
    """A region or area of the table by a name people use: `back of hand, non-dominant`."""
    plain = re.sub(r"[^a-z0-9]+", "_", inputs.lower()).strip("_")
    if plain in REGIONS or plain in AREAS:
        return plain
    titles = {re.sub(r"[^a-z0-9]+", "_", region.title.lower()): name for name, region in REGIONS.items()}
    if plain in titles:
        return titles[plain]
    spoken = plain.replace("non_dominant", "nondominant").split("_")
    words = [word for word in spoken if word not in ("the", "of", "c7")]
    for name in AREAS:
        area = name.replace("non_dominant", "nondominant").split("_")
        kept = [w for w in words if w != "hand" or "hand" in area]
        if set(kept) == set(area) - {"of"}:
            return name
    titled = {n: set(re.findall(r"[a-z]+", region.title.lower())) for n, region in REGIONS.items()}
    near = [n for n, title in titled.items() if set(words) & title]
    return near[0] if len(near) == 1 else inputs


@runs("M4")
def contact(inputs: Inputs) -> Outputs:
    place = place_on_the_body(inputs.get("area") or inputs["region"])
    limits, force = body_limits(place), float(inputs["force_N"])
    monitor = PflContact(region=place, clamped=bool(inputs.get("clamped", False)))
    lasts = float(inputs.get("contact_s", 0.1 if inputs.get("phase") != "quasi-static" else 1.0))
    end = 1.0 + lasts
    breaks = [(0.0, 0.0), (1.0, 0.0), (1.0, force), (end, force), (end, 0.0), (end + 2.0, 0.0)]
    t, (chart,) = sampled(breaks)
    columns = {"contact_force/r/h": ("N", chart)}
    if "area_cm2" in inputs:
        columns["contact_area/r/h"] = ("m2", np.full_like(t, inputs["area_cm2"] * 1e-4))
    if "pressure_N_cm2" in inputs:
        columns["contact_pressure/r/h"] = ("Pa", np.where(chart > 0, inputs["pressure_N_cm2"] * 1e4, 0.0))
    findings = list(monitor.watch(trial_of(t, columns)))
    found = violations(findings)
    phases = {"transient": np.array([True]), "quasi-static": np.array([False])}
    force_limit = {name: float(monitor.limit_n(limits, phase)[0]) for name, phase in phases.items()}
    pressure_limit = {name: float(monitor.limit_pa(limits, phase)[0]) for name, phase in phases.items()}
    at_s = inputs.get("at_s", 0.0 if "contact_s" not in inputs else min(lasts, monitor.transient_window_s))
    short = bool(monitor.transient(np.array([at_s]), monitor.clamped)[0])
    phase = inputs.get("phase", "transient" if short else "quasi-static").replace("_", "-")
    pressure = (
        force / inputs["area_cm2"] * 1e4 if "area_cm2" in inputs else inputs.get("pressure_N_cm2", 0.0) * 1e4
    )
    ratios = force / force_limit[phase], pressure / pressure_limit[phase]
    return {
        "ratio": force / force_limit[phase],
        "force_ratio": force / force_limit[phase],
        "pressure_ratio": pressure / pressure_limit[phase],
        "ratio_transient": force / force_limit["transient"],
        "ratio_quasi_static": force / force_limit["quasi-static"],
        "limit_N": force_limit[phase],
        "limit_N_cm2": pressure_limit[phase] / 1e4,
        "time_above_s": total(findings, "time_in_violation_s"),
        "violated": max(ratios) > 1 if "phase" in inputs else bool(found),
        "critical": any(f.critical for f in findings),
        "peak_ratio": largest(findings, "ratio_max"),
    }


@runs("M5")
def impact(inputs: Inputs) -> Outputs:
    limits = body_limits(place_on_the_body(inputs["region"]))
    region = limits.region
    stiffness = inputs["K_N_per_mm"] * 1000.0 if "K_N_per_mm" in inputs else region.stiffness_n_m
    factor = inputs.get("factor")
    if factor is None:
        factor = region.transient_factor() if inputs.get("phase", "transient") == "transient" else 1.0
    force = inputs.get("F_N", region.force_n) * factor
    if "A_cm2" in inputs:
        on_area = inputs.get("p_N_per_cm2", limits.pressure_pa / 1e4) * factor * inputs["A_cm2"]
        force = on_area if inputs.get("basis") == "pressure" else min(force, on_area)
    given = inputs.get("m_R", None)
    robots = given if given is not None else effective_robot_mass_kg(inputs["M"], inputs.get("m_L", 0.0))
    mu = each(robots, lambda m_r: reduced_mass_kg(inputs.get("m_H", region.mass_kg), m_r))
    outputs = {
        "m_R": robots,
        "mu": mu,
        "v_rel_max": each(mu, lambda m: permitted_speed_m_s(force, m, stiffness)),
        "E_J": energy_limit_j(force, stiffness),
        "E_max_J": energy_limit_j(force, stiffness),
        "F_max_N": force,
    }
    if "v_rel" in inputs:
        v = inputs["v_rel"]
        outputs |= {"E_J": contact_energy_j(mu, v), "F_N": impact_force_n(v, mu, stiffness)}
        outputs |= {"ratio": outputs["F_N"] / force, "v_ratio": v / outputs["v_rel_max"]}
        outputs["violated"] = v > outputs["v_rel_max"]
    return outputs


# M6 to M10: speed, standing still, stopping ------------------------------------------------


def steps(segments: Sequence[Sequence[float]], *, rest_s: float = 2.0) -> list[tuple[float, float]]:
    """Speeds held for durations, at rest before and after."""
    breaks, t = [(-rest_s, 0.0), (0.0, 0.0)], 0.0
    for value, duration in segments:
        breaks += [(t, value), (t + duration, value)]
        t += duration
    return [*breaks, (t, 0.0), (t + rest_s, 0.0)]


@runs("M6")
def reduced_speed(inputs: Inputs) -> Outputs:
    limit = inputs.get("limit", 0.25)
    monitor = ReducedSpeed(max_speed_m_s=limit)
    if "segments" not in inputs:
        speeds = inputs.get("speeds", inputs.get("v"))

        def too_fast(v: float) -> bool:
            return bool(violations(monitor.watch(trial_of(np.arange(10) / 100, {"speed/r": ("m/s", v)}))))

        return {"violated": each(speeds, too_fast)}
    t, (speed,) = sampled(steps(inputs["segments"]))
    found = violations(monitor.watch(trial_of(t, {"speed/r": ("m/s", speed)})))
    return {
        "episodes": len(found),
        "duration_s": total(found, "time_in_violation_s"),
        "time_s": total(found, "time_in_violation_s"),
        "integrated_excess_m": total(found, "excess_integral_m"),
        "relative_integral_s": total(found, "relative_depth_integral_s"),
        "peak_relative": largest(found, "relative_depth_max"),
        "peak_excess": largest(found, "excess_max_m_s"),
        "violated": bool(found),
    }


@runs("M7")
def standstill(inputs: Inputs) -> Outputs:
    names = {"grace": "grace_s", "v_ss": "standstill_speed_m_s", "drift": "drift_m"}
    given = {name: inputs[key] for key, name in names.items() if key in inputs}
    monitor = MonitoredStandstill(workspace=((0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)), **given)
    if "person" in inputs:
        enters, leaves = inputs["person"]
        a, b = inputs["moving"]
        v = inputs["robot_speed"]
        robot = [(enters - 1, 0.0), (a, 0.0), (a, v), (b, v), (b, 0.0), (leaves + 1, 0.0)]
    else:
        enters, v = inputs["person_enters"], inputs["v0"]
        leaves = inputs.get("person_leaves", max(inputs["stops_at"], enters + monitor.grace_s) + 2.0)
        begins = inputs.get("brake_start", enters)
        robot = [(enters - 1, v), (begins, v), (inputs["stops_at"], 0.0), (leaves + 1, 0.0)]
    away, within = -9.0, 1.0
    person = [(enters - 1, away), (enters, away), (enters, within), (leaves, within), (leaves, away)]
    person.append((leaves + 1, away))
    t, (speed, x) = sampled(robot, person)
    where = np.stack([x, np.ones_like(x), np.zeros_like(x)], axis=1)
    columns = {"position/h": ("m", where), "speed/r": ("m/s", speed)}
    found = violations(monitor.watch(trial_of(t, columns)))
    return {
        "episodes": len(found),
        "time_s": total(found, "time_in_violation_s"),
        "travel_m": total(found, "travel_m"),
        "travel_after_grace_m": total(found, "travel_m"),
        "speed_at_grace_end": largest(found, "speed_max_m_s"),
        "peak_speed": largest(found, "speed_max_m_s"),
        "start_s": found[0].span.start_s if found and found[0].span else None,
        "violated": bool(found),
    }


@runs("M8")
def stop(inputs: Inputs) -> Outputs:
    if "power_off" in inputs:
        categories = each(inputs["power_off"], lambda off: stop_category(off, inputs["stop"]))
        return {"category": categories, "estop_allowed": each(categories, lambda category: category < 2)}
    request, v = inputs["request"], inputs["v"]
    breaks = [(request - 1, v), (inputs.get("brake_start", request), v), (inputs["stop"], 0.0)]
    breaks.append((inputs["stop"] + 3, 0.0))
    t, (speed,) = sampled(breaks)

    def watched(limit: float) -> Finding:
        names = {"v_ss": "standstill_speed_m_s", "t_hold": "hold_s", "s_limit": "max_distance_m"}
        given = {name: inputs[key] for key, name in names.items() if key in inputs}
        events = [Event(request, "protective_stop")]
        trial = trial_of(t, {"speed/r": ("m/s", speed)}, events=events)
        (finding,) = StopPerformance(max_time_s=limit, **given).watch(trial)
        return finding

    limit = first_of(inputs, "limit", "limits", "limit_s", "t_limit", "T_allowed", default=0.5)
    first = watched(limit[0] if isinstance(limit, list) else limit)
    return {
        "s_stop_m": first.quantities["stop_distance_m"],
        "t_stop_s": first.quantities["stop_time_s"],
        "violated": each(limit, lambda value: watched(value).verdict is Verdict.VIOLATED),
        "excess_s": each(limit, lambda value: watched(value).quantities["excess_s"]),
        "violated_by_s": each(limit, lambda value: watched(value).quantities["excess_s"]),
    }


@runs("M9")
def restart(inputs: Inputs) -> Outputs:
    kinds = {"estop": "emergency_stop", "reset": "emergency_stop_reset", "start": "start"}
    events = [Event(inputs[key], kind) for key, kind in kinds.items() if inputs.get(key) is not None]

    def watched(moves_at: float) -> list[Finding]:
        end = max([moves_at, *(event.t_s for event in events)]) + 2.0
        begin = inputs["estop"] - 1.0
        rests = moves_at + 0.5
        breaks = [(begin, 0.0), (moves_at, 0.0), (moves_at, 0.2), (rests, 0.2), (rests, 0.0), (end, 0.0)]
        t, (speed,) = sampled(breaks)
        columns = {"speed/r": ("m/s", speed)}
        trial = trial_of(t, columns, events=events, witnessed=kinds.values())
        return violations(EstopRestart().watch(trial))

    motion = inputs["motion"]
    return {
        "violated": each(motion, lambda at: bool(watched(at))),
        "before_start_s": each(motion, lambda at: largest(watched(at), "before_start_s")),
        "state": each(motion, lambda at: next((f.labels["state"] for f in watched(at)), None)),
    }


@runs("M10")
def hand_guiding(inputs: Inputs) -> Outputs:
    limit = inputs.get("limit", 0.25)
    if "release" not in inputs:
        t, v, held = np.arange(101) / 100, inputs["v"], inputs.get("held", True)
        flag = {"enabling_device/r": ("1", float(held)), "speed/r": ("m/s", v)}
        found = violations(HandGuiding(max_speed_m_s=limit).watch(trial_of(t, flag)))
        return {"violated": bool(found), "violation_s": total(found, "time_in_violation_s")}
    released, still_at, v = inputs["release"], inputs["still_at"], inputs.get("v", 0.1)
    breaks = [(released - 1, v), (still_at, v), (still_at, 0.0), (still_at + 2, 0.0)]
    if still_at < released:
        breaks = [(released - 1, 0.0), (released + 2, 0.0)]
    t, (speed,) = sampled(breaks)
    events = [Event(released, "enabling_device", "r", "off")]
    monitor = HandGuiding(max_speed_m_s=limit, stop_within_s=inputs["T_allowed"])
    found = violations(monitor.watch(trial_of(t, {"speed/r": ("m/s", speed)}, events=events)))
    return {"violation_s": total(found, "time_in_violation_s"), "violated": bool(found)}


# M11: distance of safeguards ---------------------------------------------------------------

_ARRANGEMENTS: Mapping[str, Any] = {
    "orthogonal": "orthogonal",
    "whole_body": "whole_body",
    "beams": "whole_body",
    "coarse": "whole_body",
    "parallel": "parallel",
    "two_hand": "two_hand",
    "guard": "interlocked_guard",
    "interlocked_guard": "interlocked_guard",
}


def safeguard(edition: Any, arrangement: Any) -> Callable[[Inputs], Outputs]:
    def run(inputs: Inputs) -> Outputs:
        found = minimum_distance(
            edition,
            arrangement,
            inputs["T"],
            resolution_m=inputs.get("d", 30) / 1000.0,
            height_m=inputs.get("H", 0) / 1000.0,
            supplement_m=inputs.get("Z", 0) / 1000.0,
            reach_m=inputs.get("reach", inputs.get("reach_mm", inputs.get("C", 0))) / 1000.0,
            covered=bool(inputs.get("covered", False)),
        )
        return {
            "S_mm": 1000 * found.total_m,
            "S_step1_mm": 1000 * found.first_step_m,
            "C_mm": 1000 * found.intrusion_m,
            "D_mm": 1000 * found.intrusion_m,
            "S_m": found.total_m,
        }

    return run


for _edition in ("2010", "2024"):
    for _word, _arrangement in _ARRANGEMENTS.items():
        RUNNERS[f"M11.{_edition}.{_word}"] = safeguard(_edition, _arrangement)


@runs("M11.runtime")
def behind_the_line(inputs: Inputs) -> Outputs:
    crossed = inputs["t_cross"]
    monitor = SafeguardDistance(
        stopping_time_s=inputs["T"], line=((0.0, 0.0), (0.0, 4.0)), hazard=((5, 1), (6, 1), (6, 3), (5, 3))
    )

    def late(rests_at: float) -> float:
        end = max(rests_at, crossed) + 1.0
        walk = [(crossed - 1.0, -1.0), (crossed, 0.0), (crossed + 0.5, 0.5), (end, 0.5)]
        robot = [(crossed - 1.0, 0.5), (rests_at, 0.5), (rests_at, 0.0), (end, 0.0)]
        t, (x, speed) = sampled(walk, robot)
        where = np.stack([x, np.full_like(x, 2.0), np.zeros_like(x)], axis=1)
        columns = {"position/h": ("m", where), "speed/r": ("m/s", speed)}
        return total(violations(monitor.watch(trial_of(t, columns))), "time_in_violation_s")

    return {
        "violation_s": each(inputs["standstill"], late),
        "violated": each(inputs["standstill"], lambda at: late(at) > 0),
    }


# M12, M13: trucks --------------------------------------------------------------------------


@runs("M12")
def truck_speed(inputs: Inputs) -> Outputs:
    names = {
        "rated": "rated_speed_m_s",
        "v_rated": "rated_speed_m_s",
        "rated_speed": "rated_speed_m_s",
        "limit": "reduced_speed_m_s",
    }
    given = {name: inputs[key] for key, name in names.items() if key in inputs}
    assumed = 0.4 if "limit" in inputs else 9.0
    clearance = first_of(inputs, "clearance", "clearance_m", default=assumed)
    detection = first_of(inputs, "detection", "detection_active", default=not inputs.get("muted", False))
    active = detection not in (False, 0, "muted", "off", "inactive")
    monitor = AgvSpeedClearance(**given, confined=bool(inputs.get("confined", False)))

    def found(v: float) -> list[Finding]:
        t, (speed,) = sampled(steps([[v, first_of(inputs, "duration", "duration_s", default=1.0)]]))
        columns = {
            "speed/agv1": ("m/s", speed),
            "clearance/agv1": ("m", clearance),
            "personnel_detection/agv1": ("1", float(active)),
        }
        return violations(monitor.watch(trial_of(t, columns, kinds={"agv1": "agv"})))

    return {
        "integrated_excess_m": each(inputs["v"], lambda v: total(found(v), "excess_integral_m")),
        "relative_integral_s": each(inputs["v"], lambda v: total(found(v), "relative_depth_integral_s")),
        "excess": each(inputs["v"], lambda v: largest(found(v), "excess_max_m_s")),
        "violated": each(inputs["v"], lambda v: bool(found(v))),
        "limit": float(monitor.allowed_speed_m_s(np.array([clearance]), active)[0]),
    }


@runs("M13")
def truck_stop(inputs: Inputs) -> Outputs:
    v_m_s = each(inputs["v_mm_s"], lambda v: v / 1000.0) if "v_mm_s" in inputs else inputs["v"]
    brake_m = inputs["brake_mm"] / 1000.0 if "brake_mm" in inputs else inputs.get("brake_m")
    z_m = [z / 1000.0 for z in inputs["Z_mm"]] if "Z_mm" in inputs else inputs.get("Z_m", [])

    def stopping(v: float) -> float:
        speed = np.array([v], float)
        if brake_m is None:
            monitor = AgvProtectiveField(reaction_s=inputs["reaction_s"], deceleration_m_s2=inputs["a"])
            assert monitor.stopping_distance_m(speed) == stopping_distance_m(
                speed, inputs["reaction_s"], braking_distance_m(speed, inputs["a"])
            )
            return float(monitor.stopping_distance_m(speed)[0])
        return float(stopping_distance_m(speed, inputs["reaction_s"], np.array([brake_m]))[0])

    field = each(v_m_s, lambda v: float(protective_field_m(np.array([stopping(v)]), *z_m)[0]))
    stops = each(v_m_s, stopping)
    return {
        "S_A_m": stops,
        "S_A_mm": each(stops, lambda s: 1000 * s),
        "PF_m": field,
        "PF_mm": each(field, lambda s: 1000 * s),
    }


# M14 to M19 --------------------------------------------------------------------------------


@runs("M14")
def space(inputs: Inputs) -> Outputs:
    angles = ("angle_rad", "angle", "q", "q_rad", "joint", "joint_rad", "limit_rad")
    joint = any(key in inputs for key in angles)
    value = first_of(inputs, "x", "x_m", "position", "position_m", "value", *angles[:-1])
    limit = first_of(inputs, "limit", "limit_rad", "limit_m", "joint_limit", "joint_limit_rad", "box")
    lasts = first_of(inputs, "duration", "duration_s")
    t, (chart,) = sampled(steps([[value, lasts]]))
    if joint:
        monitor = SpaceLimit(joint="j", joint_low_rad=-limit, joint_high_rad=limit)
        columns = {"joint_position/r::j": ("rad", chart)}
    else:
        monitor = SpaceLimit(box_low_m=(-limit, -9.0), box_high_m=(limit, 9.0))
        columns = {"position/r": ("m", np.stack([chart, 0 * chart, 0 * chart], axis=1))}
    found = violations(monitor.watch(trial_of(t, columns)))
    unit = "rad" if joint else "m"
    return {
        f"depth_{unit}": largest(found, f"depth_max_{unit}"),
        f"integrated_{unit}_s": total(found, f"depth_integral_{unit}_s"),
        "time_s": total(found, "time_in_violation_s"),
        "episodes": len(found),
        "violated": bool(found),
    }


@runs("M15")
def crush(inputs: Inputs) -> Outputs:
    part = inputs["part"]

    def clamped(gap_mm: float) -> bool:
        step = -1e-6 if inputs.get("closing", True) else 1e-6
        gap = gap_mm / 1000.0 - step * 0.5 + step * np.arange(2)
        trial = trial_of(np.arange(2) / 100, {"crush_gap/r/h": ("m", gap)})
        found = violations(CrushGap(part=part).watch(trial))
        formula = bool(clamps(part, np.array([gap_mm / 1000.0]), inputs.get("closing", True))[0])
        assert formula == bool(found), "formula and monitor differ"
        return formula

    return {"clamped": each(inputs["gap_mm"], clamped)}


@runs("M16")
def collisions(inputs: Inputs) -> Outputs:
    weight = 2 if inputs.get("robot_robot") else 1
    options = {"closed_right": inputs.get("closed_right", True), "every_s": inputs.get("every_s", 5.0)}
    if "touches" not in inputs:
        durations = inputs.get("durations_s", inputs.get("duration_s"))
        return {"occurrences": each(durations, lambda d: watched_collision(d, weight, options))}

    def found(gap: float) -> list[Finding]:
        breaks: list[tuple[float, float]] = [(0.0, 0.0)]
        for k in range(inputs["touches"]):
            at = 1.0 + k * (inputs["touch_s"] + gap)
            breaks += [(at, 0.0), (at, 1.0), (at + inputs["touch_s"], 1.0), (at + inputs["touch_s"], 0.0)]
        breaks.append((breaks[-1][0] + 3.0, 0.0))
        return touching(breaks, CollisionEpisodes(t_off_s=inputs.get("t_off", 1.0), **options), 1)

    return {
        "episodes": each(inputs["gap_s"], lambda gap: len(found(gap))),
        "length_s": each(inputs["gap_s"], lambda gap: found(gap)[0].quantities["length_s"]),
        "contact_time_s": each(inputs["gap_s"], lambda gap: total(found(gap), "time_in_violation_s")),
        "occurrences": each(inputs["gap_s"], lambda gap: total(found(gap), "occurrences")),
    }


def touching(breaks: Breaks, monitor: CollisionEpisodes, weight: int) -> list[Finding]:
    t, (flag,) = sampled(breaks)
    kinds = {"a": "robot", "b": "robot" if weight == 2 else "agv"}
    columns = {"in_contact/a/b": ("1", (flag >= 0.5).astype(float))}
    return violations(monitor.watch(trial_of(t, columns, kinds=kinds)))


def watched_collision(duration: float, weight: int, options: Mapping[str, Any]) -> float:
    end = 1.0 + duration
    breaks = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (end, 1.0), (end, 0.0), (end + 2.0, 0.0)]
    (finding,) = touching(breaks, CollisionEpisodes(**options), weight)
    assert finding.quantities["occurrences"] == occurrences(duration, weight=weight, **options)
    return finding.quantities["occurrences"]


@runs("M17")
def poses(inputs: Inputs) -> Outputs:
    outputs: dict[str, Any] = {}
    if "points" in inputs:
        commanded = np.array(inputs["commanded"], float)
        found = pose_performance(np.array(inputs["points"], float), commanded)
        outputs |= {
            "bar": list(found.mean_m),
            "AP": found.accuracy_m,
            "l_bar": found.spread_mean_m,
            "S_l": found.spread_deviation_m,
            "RP": found.repeatability_m,
            "n": found.n,
        }
        outputs |= {f"AP_{axis}": found.mean_m[i] - float(commanded[i]) for i, axis in enumerate("xyz")}
    if "yaw" in inputs:
        command = inputs.get("commanded_yaw", 0.0)
        ap, rp = angle_performance(np.array(inputs["yaw"], float), command)
        outputs |= {"mean": ap + command, "AP_c": ap, "RP_c": rp}
    return outputs


@runs("M18")
def comfort(inputs: Inputs) -> Outputs:
    outputs: dict[str, Any] = {}
    distance = first_of(inputs, "d", "distance", "distances", "distance_m", "distances_m")
    if distance is not None:
        outputs["zone"] = outputs["zones"] = each(distance, zone_of)
    if "r" in inputs:
        x, v = np.atleast_2d(inputs["x"]).astype(float), inputs["v"]
        pairs = v if isinstance(v[0], list) else [v]

        def until_contact(pair: Sequence[float]) -> float:
            apart = np.array([[x[0][1] - x[0][0], 0.0]])
            relative = np.array([[pair[1] - pair[0], 0.0]], float)
            return float(time_to_collision_s(apart, relative, float(sum(inputs["r"])))[0])

        times = [until_contact(pair) for pair in pairs]
        outputs["TTC_s"] = times if isinstance(v[0], list) else times[0]
        outputs["flagged"] = each(outputs["TTC_s"], lambda time: time < inputs.get("threshold", 0.95))
    return outputs


@runs("M19")
def coverage(inputs: Inputs) -> Outputs:
    outputs: dict[str, Any] = {}
    if "exposure_s" in inputs:
        end, missing = inputs["exposure_s"], inputs["missing_s"]
        t = np.array([k / 100 for k in range(round(100 * end) + 1)])
        t = t[(t <= 1.0 + 1e-9) | (t >= 1.0 + missing - 1e-9)]
        trial = trial_of(t, {"position/h": ("m", np.zeros((len(t), 3)))}, kinds={"h": "human"})
        (finding,) = SignalCoverage(min_coverage=inputs.get("min_coverage", 0.99)).watch(trial)
        status = {Verdict.SATISFIED: "ok", Verdict.INCONCLUSIVE: "inconclusive"}
        outputs |= {"coverage": finding.quantities["coverage"], "status": status[finding.verdict]}
    jump = inputs.get("teleport_m", inputs.get("jump_m", inputs.get("step_m")))
    if jump is not None:
        t = np.arange(21) * inputs.get("dt_s", inputs.get("dt", 0.01))
        x = np.where(np.arange(21) < 10, 0.0, float(jump))
        where = np.stack([x, 0 * x, 0 * x], axis=1)
        velocity = centred_velocity(t, where)[1]
        outputs |= {
            "tracks": len(tracks_of(t, where, teleport_speed_m_s=5.0)),
            "split": len(tracks_of(t, where, teleport_speed_m_s=5.0)) > 1,
            "max_speed_m_s": float(np.abs(velocity).max(initial=0.0)),
        }
    return outputs


# What violations cost ------------------------------------------------------------------------


def priced(score: str, findings: Sequence[Finding]) -> float:
    """A score as a rule set would have it."""
    checks = frozenset(finding.check for finding in findings)
    sheet = ScoreSheet({}, Expression.parse(score), checks, {})
    numbered = {f"{f.check}#{i}": f for i, f in enumerate(findings, start=1)}
    scopes = Scope("trial", "", {"duration_s": 0.0, "orders": 0})
    ledger = price(numbered, scopes, sheet, dict.fromkeys(checks, "withhold"), digits=9).ledger
    assert ledger is not None
    return float(ledger.amount)


def violation(check: str = "m", **quantities: float) -> Finding:
    return Finding("r/h", Verdict.VIOLATED, "made", quantities=quantities, check=check)


@runs("score", "score.occurrence")
def demerit(inputs: Inputs) -> Outputs:
    w = inputs["w"]
    if "relative_integral_s" in inputs and inputs.get("mode") != "occurrence":
        integrals = np.atleast_1d(inputs["relative_integral_s"]).tolist()
        found = [violation(relative_depth_integral_s=value) for value in integrals]
        demerits = f"{w!r} * demerits(m, tau_s={inputs.get('tau', 5.0)!r})"
    else:
        durations = np.atleast_1d(inputs.get("duration_s", inputs.get("durations_s"))).tolist()
        found = [violation(occurrences=float(occurrences(duration))) for duration in durations]
        demerits = f"{w!r} * measure(m, occurrences)"
    return {"demerit": priced(demerits, found), "multiplier": priced(f"1 / (1 + {demerits})", found)}


@runs("score.hyperbolic")
def hyperbolic(inputs: Inputs) -> Outputs:
    found = [violation(f"c{i}", relative_depth_integral_s=0.0) for i, _ in enumerate(inputs["demerits"])]
    terms = " + ".join(f"{d!r} * demerits(c{i})" for i, d in enumerate(inputs["demerits"]))
    return {"multiplier": priced(f"1 / (1 + {terms})", found)}


@runs("score.geometric")
def geometric(inputs: Inputs) -> Outputs:
    def penalty(infractions: Sequence[str]) -> float:
        found = [violation(kind) for kind in infractions]
        factors = [f"product({kind}, p={inputs['factors'][kind]!r})" for kind in sorted(set(infractions))]
        return priced(" * ".join(factors) or "1", found)

    several = bool(inputs["infractions"]) and isinstance(inputs["infractions"][0], list)
    penalties = each(inputs["infractions"], penalty) if several else penalty(inputs["infractions"])
    return {"score_penalty": penalties, "multiplier": penalties}


# The tests -----------------------------------------------------------------------------------


def file_of(config: pytest.Config) -> Path:
    given = config.getoption("--standards-cases")
    return Path(given) if given else DEFAULT_FILE


def examples_in(file: Path) -> list[dict[str, Any]]:
    """The examples of a file in the layout of `worked_examples.json`; none of one that is not there."""
    if not file.is_file():
        return []
    try:
        examples = list(json.loads(file.read_text(encoding="utf-8"))["examples"])
        lacking = [
            f"example {number} has no {key!r}"
            for number, example in enumerate(examples, start=1)
            for key in ("id", "monitor", "inputs", "expected")
            if key not in example
        ]
    except (ValueError, KeyError, TypeError) as cause:
        lacking = [f"{type(cause).__name__}: {cause}"]
    if lacking:
        raise pytest.UsageError(f"{file} is no file of worked examples: {lacking[0]}")
    return examples


def test_the_file_of_worked_examples_is_not_empty(request: pytest.FixtureRequest) -> None:
    file = file_of(request.config)
    if not file.is_file() and not request.config.getoption("--standards-cases"):
        pytest.skip("the worked examples (../shared/standards) are not here")
    assert examples_in(file), f"no example in {file}"


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("{", "JSONDecodeError"),
        ("[]", "TypeError"),
        ("{}", "'examples'"),
        ('{"examples": [{"id": "W1", "monitor": "M1.seed", "inputs": {}}]}', "example 1 has no 'expected'"),
        ('{"examples": [7]}', "TypeError"),
    ],
)
def test_a_file_of_another_layout_is_named(tmp_path: Path, text: str, cause: str) -> None:
    (tmp_path / "cases.json").write_text(text, encoding="utf-8")

    with pytest.raises(pytest.UsageError, match=rf"cases\.json is no file of worked examples: .*{cause}"):
        examples_in(tmp_path / "cases.json")


def run_example(example: Mapping[str, Any]) -> None:
    """Compute what an example asks for and compare it, number by number."""
    key = example["monitor"]
    assert key in RUNNERS, f"monitor {key!r} is unknown; known: {', '.join(sorted(RUNNERS))}"
    outputs = RUNNERS[key](example["inputs"])
    for name, wanted in example["expected"].items():
        assert name in outputs, f"{key} gives no {name!r}, only {', '.join(outputs)}"
        assert_like(outputs[name], wanted, example.get("tolerance", 1e-6), name)


def assert_like(found: Any, wanted: Any, tolerance: float, name: str) -> None:
    if isinstance(wanted, list):
        assert isinstance(found, list), f"{name} is {found!r}, not a list"
        assert len(found) == len(wanted), name
        for one, other in zip(found, wanted, strict=True):
            assert_like(one, other, tolerance, name)
    elif isinstance(wanted, bool | str) or wanted is None:
        if isinstance(wanted, str) and wanted.lower() in ("inf", "infinity"):
            assert math.isinf(found), f"{name} is {found!r}"
        elif wanted is None and isinstance(found, float):
            assert not math.isfinite(found), f"{name} is {found!r}"
        else:
            assert found == wanted, name
    else:
        assert found == pytest.approx(wanted, abs=tolerance, rel=0), name


def test_the_worked_examples(request: pytest.FixtureRequest, subtests: pytest.Subtests) -> None:
    for example in examples_in(file_of(request.config)):
        with subtests.test(example["id"]):
            run_example(example)


@pytest.mark.parametrize("key", ["M99", "M1.sead", ""])
def test_an_unknown_monitor_key_fails_and_says_so(key: str) -> None:
    with pytest.raises(AssertionError, match=f"monitor {key!r} is unknown; known: .*M1.seed"):
        run_example({"monitor": key, "inputs": {}, "expected": {}})


def test_a_number_the_runner_does_not_give_fails_and_says_so() -> None:
    inputs = {"points": [[0, 0, 0]], "commanded": [0, 0, 0]}
    with pytest.raises(AssertionError, match="M17 gives no 'QP'"):
        run_example({"monitor": "M17", "inputs": inputs, "expected": {"QP": 1.0}})


def test_a_wrong_number_fails() -> None:
    inputs = {"k_H": 1.0, "k_R": 0.5, "t1": 1.0, "t2": 1.5, "B": 0.0, "delta": 2.6, "cap": None}
    example = {"monitor": "M1.seed", "inputs": inputs, "expected": {"d_min_m": 5.6}, "tolerance": 1e-6}
    run_example(example)
    with pytest.raises(AssertionError, match="d_min_m"):
        run_example({**example, "expected": {"d_min_m": 5.6001}})


def test_every_monitor_of_the_catalogue_can_be_run() -> None:
    assert {f"M{number}" for number in range(1, 20)} <= {key.partition(".")[0] for key in RUNNERS}
