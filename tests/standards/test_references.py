"""Every vectorised monitor against a slow one in plain Python, on random trials.

The references go through the samples one by one, as the catalogue reads. Times are
multiples of 1/64 s and values of 1/8 or so, so that limits are met exactly, too.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Trial, Verdict
from ariac_score.scoring.expression import add_up
from ariac_score_ariac.safety import CollisionEpisodes
from ariac_score_standards import (
    AgvProtectiveField,
    AgvSpeedClearance,
    Always,
    CrushGap,
    EstopRestart,
    HandGuiding,
    MonitoredStandstill,
    PflContact,
    PflSpeed,
    PoseAttained,
    ProximityComfort,
    ReducedSpeed,
    SafeguardDistance,
    SignalCoverage,
    SpaceLimit,
    SsmResponse,
    SsmSeparation,
    SsmSpeedCap,
    StopPerformance,
    Within,
)

TICK_S = 1 / 64
MAX_GAP_S = 4 * TICK_S
SQUARE = ((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (0.0, 4.0))

Bad = Sequence[bool]


def on_random_trials(check: Callable[..., None]) -> Callable[..., None]:
    """One test on 30 random trials, by their seeds: an item for each would cost more than the trial."""

    @wraps(check)
    def test(subtests: pytest.Subtests, **others: Any) -> None:
        for seed in range(30):
            with subtests.test(seed=seed):
                check(seed, **others)

    given = inspect.signature(check)
    subtests = inspect.Parameter("subtests", inspect.Parameter.POSITIONAL_OR_KEYWORD)
    others = [parameter for name, parameter in given.parameters.items() if name != "seed"]
    test.__signature__ = given.replace(parameters=[subtests, *others])  # type: ignore[attr-defined]
    return test


@dataclass
class Course:
    """Random samples, and the signals of a trial made of them."""

    rng: np.random.Generator
    t: list[float]

    @classmethod
    def of(cls, seed: int, n: int = 90) -> Course:
        rng = np.random.default_rng(seed)
        steps = rng.choice([1, 1, 1, 1, 2, 3, 4, 9], size=n - 1)
        return cls(rng, [0.0, *(np.cumsum(steps) * TICK_S).tolist()])

    def values(self, choices: Sequence[float], hold: int = 5) -> list[float]:
        """Values that stay for a few samples."""
        found: list[float] = []
        while len(found) < len(self.t):
            found += [float(self.rng.choice(choices))] * int(self.rng.integers(1, hold + 1))
        return found[: len(self.t)]

    def walk(self, step: float, low: float, high: float) -> list[float]:
        """Values that change by one step at most."""
        value, found = float(self.rng.choice([low, high])), []
        for _ in self.t:
            value = min(max(value + step * int(self.rng.integers(-1, 2)), low), high)
            found.append(value)
        return found

    def trial(
        self,
        columns: Mapping[str, tuple[str, Any]],
        *,
        events: Iterable[Event] = (),
        bodies: Sequence[Body] = (Body("h", "human"), Body("r", "robot")),
    ) -> Trial:
        signals = {
            name: Signal(name, unit, np.array(self.t), np.array(values))
            for name, (unit, values) in columns.items()
        }
        recorded = next(iter(signals.values())).span
        return Trial("t", bodies=tuple(bodies), signals=signals, events=tuple(events), recorded=recorded)

    @property
    def gaps(self) -> list[tuple[float, float]]:
        return [(a, b) for a, b in zip(self.t, self.t[1:], strict=False) if b - a > MAX_GAP_S]

    @property
    def lasts(self) -> list[float]:
        steps = [min(b - a, MAX_GAP_S) for a, b in zip(self.t, self.t[1:], strict=False)]
        return [*steps, 0.0]


@dataclass
class Slow:
    """An episode of the reference."""

    start: float
    end: float
    rows: list[int]


def episodes(course: Course, bad: Bad, *, t_on: float = 0.0, t_off: float = 1.0) -> list[Slow]:
    """Catalogue, section 1.2, sample by sample."""
    runs: list[list[int]] = []
    for i, now in enumerate(bad):
        if not now:
            continue
        if runs and runs[-1][-1] == i - 1 and course.t[i] - course.t[i - 1] <= MAX_GAP_S:
            runs[-1].append(i)
        else:
            runs.append([i])
    found: list[Slow] = []
    for run in runs:
        start, end = course.t[run[0]], course.t[run[-1]] + course.lasts[run[-1]]
        if found and start - found[-1].end < t_off:
            found[-1].rows += run
            found[-1].end = end
        elif end - start >= t_on:
            found.append(Slow(start, end, run))
    return found


def of_verdict(findings: Iterable[Finding], verdict: Verdict) -> list[Finding]:
    return [f for f in findings if f.verdict is verdict]


def assert_episodes(
    course: Course, findings: list[Finding], bad: Bad, margin: Sequence[float], **timing: float
) -> None:
    """The findings are the reference's: spans, times, robustness, gaps, and the finding when all is well."""
    wanted = episodes(course, bad, **timing)
    violated = of_verdict(findings, Verdict.VIOLATED)
    assert [(f.span.start_s, f.span.end_s) for f in violated if f.span] == [(e.start, e.end) for e in wanted]
    for finding, slow in zip(violated, wanted, strict=True):
        seconds = add_up(course.lasts[i] for i in slow.rows)
        assert finding.quantities["time_in_violation_s"] == pytest.approx(seconds)
        assert finding.robustness == pytest.approx(min(margin[i] for i in slow.rows))
    undecided = [(f.span.start_s, f.span.end_s) for f in of_verdict(findings, Verdict.INCONCLUSIVE) if f.span]
    assert undecided == course.gaps
    quiet = not wanted and not course.gaps
    assert (
        len(of_verdict(findings, Verdict.SATISFIED)) + len(of_verdict(findings, Verdict.NOT_APPLICABLE))
        == quiet
    )


def assert_met(
    course: Course,
    findings: list[Finding],
    distance: Sequence[float],
    speed: Sequence[float],
    towards: tuple[Sequence[float], Sequence[float]] | None = None,
    *,
    before: bool = False,
) -> None:
    """Exposure and blame are those of the catalogue, sections 1.3 and 1.5; directed speeds: robot, human."""
    exposed = add_up(
        last for last, d, v in zip(course.lasts, distance, speed, strict=True) if d <= 5 and v > 0.01
    )
    for finding in of_verdict(findings, Verdict.SATISFIED) + of_verdict(findings, Verdict.VIOLATED):
        assert finding.quantities["exposure_s"] == pytest.approx(exposed)
    for finding in of_verdict(findings, Verdict.VIOLATED):
        assert finding.span is not None
        onset = max(course.t.index(finding.span.start_s) - before, 0)
        by = "unknown"
        if towards is not None:
            robot, human = (values[onset] > 0.01 for values in towards)
            by = "both" if robot and human else "robot" if robot else "human" if human else "neither"
        assert finding.labels["closing_by"] == by
        inside = [v for t, v in zip(course.t, speed, strict=True) if within(finding, t)]
        if max(inside) <= 0.01:
            assert finding.labels["robot_moving"] == "no"
        if min(inside) > 0.01:
            assert finding.labels["robot_moving"] == "yes"


def within(finding: Finding, t: float) -> bool:
    return finding.span is not None and finding.span.start_s <= t < max(finding.span.end_s, t + 1e-9)


def common(course: Course) -> dict[str, float]:
    return {"max_gap_s": MAX_GAP_S, "t_on_s": 2 * TICK_S, "t_off_s": 5 * TICK_S}


TIMING = {"t_on": 2 * TICK_S, "t_off": 5 * TICK_S}


def pair_columns(course: Course) -> dict[str, tuple[str, list[float]]]:
    return {
        "separation/r/h": ("m", course.walk(0.125, 0.0, 2.0)),
        "approach_speed_human/r/h": ("m/s", course.values([-0.5, 0.0, 0.5, 1.0])),
        "approach_speed_robot/r/h": ("m/s", course.values([-0.5, 0.0, 0.25, 1.0])),
        "speed/r": ("m/s", course.values([0.0, 0.01, 0.25, 1.0])),
    }


# Speed and separation ----------------------------------------------------------------------


def slow_required(v_h: float, v_r: float, model: str) -> float:
    """S_h + S_r + S_s + C + Z_d + Z_r, term by term."""
    reaction, stop = 0.125, 0.25
    v_r = v_r if v_r > 0 else 0.0
    v_h = v_h if v_h > 0 else 0.0
    if model == "deceleration":
        stop = v_r / 2.0
    walked = v_h * (reaction + stop)
    reacted = v_r * reaction
    stopped = {
        "linear": v_r * stop / 2,
        "deceleration": v_r * v_r / (2 * 2.0),
        "constant_speed": v_r * stop,
    }[model]
    return walked + reacted + stopped + 0.125 + 0.25 + 0.0625


@on_random_trials
@pytest.mark.parametrize("model", ["linear", "deceleration", "constant_speed"])
def test_separation_in_its_full_form(seed: int, model: Any) -> None:
    course = Course.of(seed)
    columns = pair_columns(course)
    monitor = SsmSeparation(
        profile="standard",
        t1_s=0.125,
        t2_s=0.25,
        stop_model=model,
        intrusion_m=0.125,
        human_uncertainty_m=0.25,
        robot_uncertainty_m=0.0625,
        human_speed="measured",
        **common(course),
    )

    distance, human, robot, speed = (values for _, values in columns.values())
    margin = [d - slow_required(h, r, model) for d, h, r in zip(distance, human, robot, strict=True)]
    bad = [m < 0 and v > 0.01 for m, v in zip(margin, speed, strict=True)]
    findings = list(monitor.watch(course.trial(columns)))
    assert_episodes(course, findings, bad, margin, **TIMING)
    for finding in of_verdict(findings, Verdict.VIOLATED):
        assert finding.span is not None
        onset = course.t.index(finding.span.start_s)
        closes = [name for name, v in (("robot", robot[onset]), ("human", human[onset])) if v > 0.01]
        by = "both" if len(closes) == 2 else closes[0] if closes else "neither"
        assert dict(finding.labels) == {"robot_moving": "yes", "closing_by": by}
    assert_met(course, findings, distance, speed, (robot, human))


@on_random_trials
@pytest.mark.parametrize("model", ["linear", "deceleration", "constant_speed"])
def test_the_speed_cap_agrees_with_the_separation(seed: int, model: Any) -> None:
    """Both are one requirement; here the reference is a search for the largest speed that is enough."""
    course = Course.of(seed)
    columns = pair_columns(course)
    numbers: dict[str, Any] = {
        "profile": "standard",
        "t1_s": 0.125,
        "t2_s": 0.25,
        "stop_model": model,
        "intrusion_m": 0.125,
        "human_uncertainty_m": 0.25,
        "robot_uncertainty_m": 0.0625,
        "human_speed": "measured",
    }
    distance, human, robot, speed = (values for _, values in columns.values())
    caps = []
    for d, h in zip(distance, human, strict=True):
        low, high = 0.0, 64.0
        if slow_required(h, 0.0, model) >= d:
            high = 0.0
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if slow_required(h, middle, model) <= d else (low, middle)
        caps.append(low)
    found = SsmSpeedCap(**numbers).speed_cap_m_s(np.array(distance), np.maximum(human, 0.0))
    assert found == pytest.approx(np.array(caps), abs=1e-9)

    margin = [float(c) - max(r, 0.0) for c, r in zip(found, robot, strict=True)]
    bad = [m < 0 and v > 0.01 for m, v in zip(margin, speed, strict=True)]
    findings = list(SsmSpeedCap(**numbers, **common(course)).watch(course.trial(columns)))
    assert_episodes(course, findings, bad, margin, **TIMING)
    assert_met(course, findings, distance, speed, (robot, human))


@on_random_trials
@pytest.mark.parametrize("poses", [False, True])
def test_the_response_to_a_breach(seed: int, poses: bool) -> None:
    course = Course.of(seed)
    distance, speed = course.walk(0.25, 2.0, 4.0), course.values([0.0, 0.25, 0.5, 1.0])
    columns = {
        "centre_distance/r/h": ("m", distance),
        "speed/h": ("m/s", [0.0] * len(course.t)),
        "speed/r": ("m/s", speed),
    }
    towards = course.values([-0.5, 0.0, 0.5]), course.values([-0.5, 0.0, 0.5])
    if poses:
        for who, values in zip(("robot", "human"), towards, strict=True):
            columns[f"approach_speed_{who}/r/h"] = ("m/s", values)
    monitor = SsmResponse(t1_s=0.0625, t2_s=0.125, delta_m=2.5, tolerance_m_s=0.02, **common(course))
    bad, margin, since = [], [], None
    for i, t in enumerate(course.t):
        breach = distance[i] < speed[i] * 0.0625 + 2.5
        if not breach:
            since = None
        elif since is None or t - course.t[i - 1] > MAX_GAP_S:
            since = i
        allowed = math.inf
        if since is not None:
            share = 1 - max(t - course.t[since] - 0.0625, 0.0) / 0.125
            allowed = speed[since] * max(share, 0.0) + 0.02
        margin.append(allowed - speed[i])
        bad.append(margin[-1] < 0)
    findings = list(monitor.watch(course.trial(columns)))
    assert_episodes(course, findings, bad, margin, **TIMING)
    assert_met(course, findings, distance, speed, towards if poses else None)


# Contact -------------------------------------------------------------------------------------


@on_random_trials
def test_contact_against_the_limits_of_the_hand(seed: int) -> None:
    course = Course.of(seed)
    force = course.values([0.0, 0.0, 5.0, 6.0, 139.0, 140.0, 141.0, 280.0, 281.0], hold=12)
    monitor = PflContact(region="hand", transient_window_s=0.25, max_gap_s=MAX_GAP_S, t_off_s=5 * TICK_S)
    found = list(monitor.watch(course.trial({"contact_force/r/h": ("N", force)})))

    wanted = episodes(course, [f > 5 for f in force], t_off=5 * TICK_S)
    contacts = [f for f in found if f.quantities.get("contacts") == 1.0]
    assert [(f.span.start_s, f.span.end_s) for f in contacts if f.span] == [(e.start, e.end) for e in wanted]
    for finding, slow in zip(contacts, wanted, strict=True):
        above, worst = 0.0, 0.0
        for i in slow.rows:
            limit = 280.0 if course.t[i] - slow.start <= 0.25 else 140.0
            worst = max(worst, force[i] / limit)
            above += course.lasts[i] if force[i] > limit else 0.0
        assert finding.verdict is (Verdict.VIOLATED if worst > 1 else Verdict.SATISFIED)
        assert finding.critical == (worst > 1)
        assert finding.quantities["ratio_max"] == pytest.approx(worst)
        assert finding.quantities["time_in_violation_s"] == pytest.approx(above)


@on_random_trials
@pytest.mark.parametrize("when", ["contact", "near"])
def test_the_speed_of_a_contact(seed: int, when: Any) -> None:
    course = Course.of(seed)
    distance = course.walk(0.0625, 0.0, 0.25)
    columns = {
        "separation/r/h": ("m", distance),
        "relative_speed/r/h": ("m/s", course.values([0.25, 0.5, 1.0])),
        "approach_speed_robot/r/h": ("m/s", course.values([-0.5, 0.25, 0.5])),
        "approach_speed_human/r/h": ("m/s", course.values([-0.5, 0.25, 0.5])),
        "speed/r": ("m/s", course.values([0.0, 0.01, 0.5])),
    }
    monitor = PflSpeed(region="chest", when=when, max_gap_s=MAX_GAP_S, t_off_s=5 * TICK_S)
    mu = 1 / (1 / 40 + 1 / (33.5 / 2))
    limit = min(2 * 140.0, 2 * 120.0 * 1.0) / math.sqrt(mu * 25000)
    bad, margin = [], []
    for i, d in enumerate(distance):
        if when == "contact":
            v = columns["relative_speed/r/h"][1][i]
            touched = i > 0 and distance[i - 1] <= 0 and course.t[i] - course.t[i - 1] <= MAX_GAP_S
            applies = d <= 0 and not touched
        else:
            v = columns["approach_speed_robot/r/h"][1][i] + columns["approach_speed_human/r/h"][1][i]
            applies = d < 0.1
        margin.append(limit - v)
        bad.append(applies and v > limit)
    findings = list(monitor.watch(course.trial(columns)))
    assert_episodes(course, findings, bad, margin, t_off=5 * TICK_S)
    towards = columns["approach_speed_robot/r/h"][1], columns["approach_speed_human/r/h"][1]
    assert_met(course, findings, distance, columns["speed/r"][1], towards, before=when == "contact")


# Speeds and stops ------------------------------------------------------------------------------


@on_random_trials
def test_reduced_speed_in_manual_mode(seed: int) -> None:
    course = Course.of(seed)
    speed, manual = course.values([0.125, 0.25, 0.2500001, 0.5]), course.values([0.0, 1.0], hold=20)
    columns = {"speed/r": ("m/s", speed), "manual_mode/r": ("1", manual)}
    monitor = ReducedSpeed(applies="manual_mode", **common(course))

    bad = [v > 0.25 and m > 0.5 for v, m in zip(speed, manual, strict=True)]
    margin = [0.25 - v for v in speed]
    assert_episodes(course, list(monitor.watch(course.trial(columns))), bad, margin, **TIMING)


@on_random_trials
def test_standing_still_while_somebody_is_inside(seed: int) -> None:
    course = Course.of(seed)
    x, speed = course.values([-1.0, 0.0, 2.0, 5.0], hold=20), course.values([0.0, 0.01, 0.25], hold=8)
    where = [[value, 2.0, 0.0] for value in x]
    apart = course.walk(0.5, 3.0, 7.0)
    columns = {"position/h": ("m", where), "speed/r": ("m/s", speed), "separation/r/h": ("m", apart)}
    monitor = MonitoredStandstill(workspace=SQUARE, grace_s=0.125, **common(course))

    bad, entered = [], None
    for i, value in enumerate(x):
        if not 0 <= value <= 4:
            entered = None
        elif entered is None or course.t[i] - course.t[i - 1] > MAX_GAP_S:
            entered = course.t[i]
        bad.append(entered is not None and course.t[i] - entered >= 0.125 and speed[i] > 0.01)
    margin = [0.01 - v for v in speed]
    findings = list(monitor.watch(course.trial(columns)))
    assert_episodes(course, findings, bad, margin, **TIMING)
    assert_met(course, findings, apart, speed)


@on_random_trials
def test_a_guided_robot(seed: int) -> None:
    course = Course.of(seed)
    held, speed = course.values([0.0, 1.0], hold=15), course.values([0.0, 0.01, 0.125, 0.25, 0.375])
    columns = {"speed/r": ("m/s", speed), "enabling_device/r": ("1", held)}
    monitor = HandGuiding(stop_within_s=0.125, **common(course))

    bad, margin, released = [], [], -math.inf
    for i, t in enumerate(course.t):
        if i and held[i - 1] > 0.5 and held[i] < 0.5:
            released = t
        limit = 0.25 if held[i] > 0.5 or t - released < 0.125 else 0.01
        margin.append(limit - speed[i])
        bad.append(speed[i] > limit)
    assert_episodes(course, list(monitor.watch(course.trial(columns))), bad, margin, **TIMING)


@on_random_trials
def test_stopping(seed: int) -> None:
    course = Course.of(seed)
    course.t = [i * TICK_S for i in range(len(course.t))]  # without gaps: what they do is tested elsewhere
    speed = course.walk(0.125, 0.0, 0.5)
    request = course.t[20]
    trial = course.trial({"speed/r": ("m/s", speed)}, events=[Event(request, "protective_stop")])
    monitor = StopPerformance(max_time_s=0.25, hold_s=0.0625, max_gap_s=MAX_GAP_S)
    (finding,) = monitor.watch(trial)

    reached = None
    for i in range(20, len(course.t)):
        begins = speed[i] <= 0.01 and (i == 20 or speed[i - 1] > 0.01)
        if reached is not None or not begins:
            continue
        since = course.t[i]
        if speed[i - 1] > 0.01 and i > 20:
            since = course.t[i - 1] + TICK_S * (speed[i - 1] - 0.01) / (speed[i - 1] - speed[i])
        last = i
        while last + 1 < len(course.t) and speed[last + 1] <= 0.01:
            last += 1
        if course.t[min(last + 1, len(course.t) - 1)] - since >= 0.0625 - 1e-9:
            reached = since
    if reached is None:
        assert finding.verdict is Verdict.VIOLATED
        return
    assert finding.quantities["stop_time_s"] == pytest.approx(reached - request)
    way, step = 0.0, TICK_S / 64
    for k in range(round((reached + 0.0625 - request) / step)):
        at = request + (k + 0.5) * step
        i = min(int(at / TICK_S), len(speed) - 2)
        way += step * (speed[i] + (at / TICK_S - i) * (speed[i + 1] - speed[i]))
    end = min(reached + 0.0625, course.t[-1])
    if end == reached + 0.0625:
        assert finding.quantities["stop_distance_m"] == pytest.approx(way, abs=5e-4)
    late = reached - request > 0.25 + 1e-9
    assert finding.verdict is (Verdict.VIOLATED if late else Verdict.SATISFIED)


@on_random_trials
def test_no_restart_by_itself(seed: int) -> None:
    course = Course.of(seed)
    speed = course.values([0.0, 0.0, 0.0, 0.25], hold=9)
    stop, reset, start = (course.t[i] for i in sorted(course.rng.choice(90, 3, replace=False).tolist()))
    events = [Event(stop, "emergency_stop"), Event(reset, "emergency_stop_reset"), Event(start, "start")]
    monitor = EstopRestart(stop_within_s=0.25, hold_s=0.0625, max_gap_s=MAX_GAP_S, t_off_s=5 * TICK_S)
    findings = list(monitor.watch(course.trial({"speed/r": ("m/s", speed)}, events=events)))

    latched = stop + 0.25  # at the latest
    for i, t in enumerate(course.t):
        if t < stop or speed[i] > 0.01 or (i and course.t[i - 1] >= stop and speed[i - 1] <= 0.01):
            continue
        since = t
        if i and speed[i - 1] > 0.01:
            since = course.t[i - 1] + (t - course.t[i - 1]) * (speed[i - 1] - 0.01) / (
                speed[i - 1] - speed[i]
            )
        since, last = max(since, stop), i
        while last + 1 < len(speed) and speed[last + 1] <= 0.01:
            last += 1
        end = course.t[min(last + 1, len(speed) - 1)]
        if end - since >= 0.0625 - 1e-9:
            latched = min(latched, since)
            break
    bad = [v > 0.01 and latched - 1e-9 <= t < start for v, t in zip(speed, course.t, strict=True)]
    wanted = episodes(course, bad, t_off=5 * TICK_S)
    violated = of_verdict(findings, Verdict.VIOLATED)
    assert [(f.span.start_s, f.span.end_s) for f in violated if f.span] == [(e.start, e.end) for e in wanted]
    for finding in violated:
        assert finding.span is not None
        assert finding.labels["state"] == ("LATCHED" if finding.span.start_s < reset else "READY")


# Safeguards, trucks -----------------------------------------------------------------------------


@on_random_trials
def test_behind_a_sensing_line(seed: int) -> None:
    course = Course.of(seed)
    x, y, speed = course.walk(0.5, -1.0, 3.0), course.values([0.5, 5.0], hold=40), course.values([0.0, 0.25])
    columns = {
        "position/h": ("m", [[a, b, 0.0] for a, b in zip(x, y, strict=True)]),
        "speed/r": ("m/s", speed),
    }
    apart = course.walk(0.5, 3.0, 7.0)
    towards = course.values([-0.5, 0.0, 0.5]), course.values([-0.5, 0.0, 0.5])
    columns["separation/r/h"] = ("m", apart)
    for who, values in zip(("robot", "human"), towards, strict=True):
        columns[f"approach_speed_{who}/r/h"] = ("m/s", values)
    hazard = ((2.5, 0.0), (4.0, 0.0), (4.0, 1.0), (2.5, 1.0))
    monitor = SafeguardDistance(
        stopping_time_s=0.125, line=((0.25, 0.0), (0.25, 1.0)), hazard=hazard, **common(course)
    )
    findings = [f for f in monitor.watch(course.trial(columns)) if f.subject != "trial"]

    bad: list[bool] = []
    since: float | None = None
    for i, t in enumerate(course.t):
        fresh = i == 0 or t - course.t[i - 1] > MAX_GAP_S
        if x[i] < 0.25:
            since = None
        elif fresh or x[i - 1] < 0.25:
            since = None
            if fresh:  # when the line was crossed is not known
                since = t if 0 <= y[i] <= 1 else None
            else:
                part = (0.25 - x[i - 1]) / (x[i] - x[i - 1])
                height = y[i - 1] + part * (y[i] - y[i - 1])
                since = course.t[i - 1] + part * (t - course.t[i - 1]) if 0 <= height <= 1 else None
        dx = max(2.5 - x[i], x[i] - 4.0, 0.0)
        dy = max(0.0 - y[i], y[i] - 1.0, 0.0)
        near = math.hypot(dx, dy) < 8 * (0.03 - 0.014) - 1e-12
        late = since is not None and t - since >= 0.125 - 1e-9
        bad.append(since is not None and (late or near) and speed[i] > 0.01)
    assert_episodes(course, findings, bad, [0.01 - v for v in speed], **TIMING)
    assert_met(course, findings, apart, speed, towards)


@on_random_trials
def test_the_speed_of_a_truck(seed: int) -> None:
    course = Course.of(seed)
    speed, free = course.values([0.0, 0.25, 0.3, 0.5, 1.5, 1.75]), course.values([0.25, 0.5, 0.625])
    active = course.values([0.0, 1.0], hold=20)
    columns = {
        "speed/a": ("m/s", speed),
        "clearance/a": ("m", free),
        "personnel_detection/a": ("1", active),
    }
    monitor = AgvSpeedClearance(**common(course))

    limit = [1.5 if f > 0.5 and a > 0.5 else 0.3 for f, a in zip(free, active, strict=True)]
    margin = [high - v for high, v in zip(limit, speed, strict=True)]
    trial = course.trial(columns, bodies=(Body("a", "agv"),))
    assert_episodes(course, list(monitor.watch(trial)), [m < 0 for m in margin], margin, **TIMING)


@on_random_trials
def test_a_truck_that_meets_a_person(seed: int) -> None:
    course = Course.of(seed)
    x, y, v = (
        course.walk(0.125, 0.5, 3.0),
        course.values([0.0, 0.7, 2.0], hold=30),
        course.walk(0.125, 0.0, 1.0),
    )
    columns = {
        "position/a": ("m", [[0.0, 0.0, 0.0]] * len(course.t)),
        "velocity/a": ("m/s", [[speed, 0.0, 0.0] for speed in v]),
        "position/h": ("m", [[a, b, 0.0] for a, b in zip(x, y, strict=True)]),
    }
    of_human = course.values([-0.5, 0.0, 0.5])  # along x: towards the truck where negative
    if seed % 2:
        columns["velocity/h"] = ("m/s", [[speed, 0.0, 0.0] for speed in of_human])
    bodies = (Body("a", "agv", 0.5), Body("h", "human", 0.25))
    monitor = AgvProtectiveField(reaction_s=0.125, deceleration_m_s2=0.5, **common(course))
    bad, margin, entered = [], [], None
    for i, t in enumerate(course.t):
        swept = v[i] > 0 and x[i] > 0 and abs(y[i]) <= 0.4 + 0.1 + 0.25
        left = max(x[i] - 0.6 - 0.25, 0.0)
        needed = v[i] * 0.125 + v[i] * v[i] / (2 * 0.5)
        if not (swept and left < needed and v[i] > 0.01):
            entered = None
        elif entered is None or t - course.t[i - 1] > MAX_GAP_S:
            entered = i
        bad.append(
            entered is not None and t - course.t[entered] >= 0.125 - 1e-9 and not v[i] < v[entered] - 0.02
        )
        margin.append(left - needed)
    findings = list(monitor.watch(course.trial(columns, bodies=bodies)))
    assert_episodes(course, findings, bad, margin, **TIMING)
    centres = [math.hypot(a, b) for a, b in zip(x, y, strict=True)]
    along = [a / d for a, d in zip(x, centres, strict=True)]
    towards = (
        [s * u for s, u in zip(v, along, strict=True)],
        [-s * u for s, u in zip(of_human, along, strict=True)],
    )
    assert_met(course, findings, [d - 0.75 for d in centres], v, towards if seed % 2 else None)


# Space, gaps, collisions --------------------------------------------------------------------------


@on_random_trials
def test_the_space_of_a_robot(seed: int) -> None:
    course = Course.of(seed)
    x, y = course.walk(0.25, -2.0, 2.0), course.walk(0.25, -2.0, 2.0)
    columns = {"position/r": ("m", [[a, b, 0.0] for a, b in zip(x, y, strict=True)])}
    zone = ((0.5, 0.5), (1.0, 0.5), (1.0, 1.0), (0.5, 1.0))
    monitor = SpaceLimit(box_low_m=(-1.5, -1.5), box_high_m=(1.5, 1.5), keep_out=(zone,), **common(course))

    margin = []
    for a, b in zip(x, y, strict=True):
        left = min(a + 1.5, 1.5 - a, b + 1.5, 1.5 - b)
        within = min(a - 0.5, 1.0 - a, b - 0.5, 1.0 - b)
        dx, dy = max(0.5 - a, a - 1.0, 0.0), max(0.5 - b, b - 1.0, 0.0)
        margin.append(min(left, -within if within > 0 else math.hypot(dx, dy)))
    findings = list(monitor.watch(course.trial(columns)))
    assert_episodes(course, findings, [m < 0 for m in margin], margin, **TIMING)


@on_random_trials
def test_a_gap_that_closes(seed: int) -> None:
    course = Course.of(seed)
    gap = course.walk(0.0125, 0.05, 0.15)
    columns = {"crush_gap/r/h": ("m", gap)}
    bad = []
    for i in range(len(gap)):
        before = i > 0 and gap[i] < gap[i - 1]
        after = i + 1 < len(gap) and gap[i + 1] < gap[i]
        bad.append((before or after) and gap[i] < 0.1)
    findings = list(CrushGap(part="hand", **common(course)).watch(course.trial(columns)))
    assert_episodes(course, findings, bad, [g - 0.1 for g in gap], **TIMING)


@on_random_trials
def test_collisions(seed: int) -> None:
    course = Course.of(seed)
    flag = course.values([0.0, 0.0, 1.0], hold=9)
    bodies = (Body("r", "robot"), Body("s", "robot"))
    monitor = CollisionEpisodes(every_s=0.25, max_gap_s=MAX_GAP_S, t_off_s=5 * TICK_S)
    found = list(monitor.watch(course.trial({"in_contact/r/s": ("1", flag)}, bodies=bodies)))

    wanted = episodes(course, [f > 0.5 for f in flag], t_off=5 * TICK_S)
    violated = of_verdict(found, Verdict.VIOLATED)
    assert [(f.span.start_s, f.span.end_s) for f in violated if f.span] == [(e.start, e.end) for e in wanted]
    for finding, slow in zip(violated, wanted, strict=True):
        times, left = 1, slow.end - slow.start
        while left >= 0.25 - 1e-9:
            times, left = times + 1, left - 0.25
        assert finding.quantities["occurrences"] == 2 * times


# Poses, comfort, coverage, formulas ------------------------------------------------------------------


@on_random_trials
def test_attained_poses(seed: int) -> None:
    course = Course.of(seed)
    points = [[float(v) for v in course.rng.normal(0, 0.01, 3)] for _ in course.t]
    rows = sorted(course.rng.choice(90, 5, replace=False).tolist())
    events = [Event(course.t[i], "pose_attained", "r") for i in rows]
    (finding,) = PoseAttained(commanded_m=(0.0, 0.0, 0.0)).watch(
        course.trial({"position/r": ("m", points)}, events=events)
    )

    bar = [add_up(points[i][axis] for i in rows) / 5 for axis in range(3)]
    spread = [math.dist(points[i], bar) for i in rows]
    mean = add_up(spread) / 5
    deviation = math.sqrt(add_up((s - mean) ** 2 for s in spread) / 4)
    assert finding.quantities["accuracy_m"] == pytest.approx(math.dist(bar, [0, 0, 0]))
    assert finding.quantities["repeatability_m"] == pytest.approx(mean + 3 * deviation)


@on_random_trials
def test_time_to_collision(seed: int) -> None:
    course = Course.of(seed)
    n = len(course.t)
    robot, human = course.rng.uniform(-2, 2, (n, 3)), course.rng.uniform(-2, 2, (n, 3))
    v_r, v_h = course.rng.uniform(-1, 1, (n, 3)), course.rng.uniform(-1, 1, (n, 3))
    columns = {
        "separation/r/h": ("m", course.walk(0.125, 0.0, 4.0)),
        "position/r": ("m", robot),
        "position/h": ("m", human),
        "velocity/r": ("m/s", v_r),
        "velocity/h": ("m/s", v_h),
        "speed/r": ("m/s", course.values([0.0, 0.01, 0.5])),
    }
    bodies = (Body("h", "human", 0.25), Body("r", "robot", 0.4))
    monitor = ProximityComfort(**common(course))
    found = list(monitor.watch(course.trial(columns, bodies=bodies)))

    def time_to_contact(i: int) -> float:
        dx, dy = human[i][0] - robot[i][0], human[i][1] - robot[i][1]
        vx, vy = v_h[i][0] - v_r[i][0], v_h[i][1] - v_r[i][1]
        if math.hypot(dx, dy) <= 0.65:
            return 0.0
        a, b, c = vx * vx + vy * vy, 2 * (dx * vx + dy * vy), dx * dx + dy * dy - 0.65 * 0.65
        root = b * b - 4 * a * c
        times = [(-b - math.sqrt(root)) / (2 * a)] if root >= 0 and a > 0 else []
        return min([t for t in times if t >= 0], default=math.inf)

    times = [min(time_to_contact(i), 3.0) for i in range(n)]
    margin = [t - 0.95 for t in times]
    assert_episodes(course, found, [m < 0 for m in margin], margin, **TIMING)
    distance = columns["separation/r/h"][1]
    near = add_up(last for last, d in zip(course.lasts, distance, strict=True) if d < 0.45)
    assert_met(course, found, distance, columns["speed/r"][1])
    for finding in of_verdict(found, Verdict.VIOLATED):
        assert finding.quantities["share_intimate"] == pytest.approx(near / add_up(course.lasts))


@on_random_trials
def test_coverage_of_a_signal(seed: int) -> None:
    course = Course.of(seed)
    columns = {"position/r": ("m", [[0.0, 0.0, 0.0]] * len(course.t))}
    (finding,) = SignalCoverage(max_gap_s=MAX_GAP_S).watch(course.trial(columns))

    whole = course.t[-1] - course.t[0]
    missing = add_up(b - a for a, b in course.gaps)
    assert finding.quantities["coverage"] == pytest.approx((whole - missing) / whole)
    assert finding.verdict is (Verdict.SATISFIED if 1 - missing / whole >= 0.99 else Verdict.INCONCLUSIVE)


@on_random_trials
def test_a_formula(seed: int) -> None:
    course = Course.of(seed)
    a, b = course.values([0.0, 0.5, 1.0, 2.0]), course.values([0.0, 0.5, 1.0])
    columns = {"speed/r": ("m/s", a), "speed/h": ("m/s", b)}
    monitor = Always(
        holds="b == 0 or a / b <= limit if a < 2 else not b > 0",
        signals={"a": "speed/{robot}", "b": "speed/{human}"},
        parameters={"limit": 1.0},
        **common(course),
    )
    margin = []
    for x, y in zip(a, b, strict=True):
        if x < 2:
            margin.append(0.0 if y == 0 else max(-abs(y), 1.0 - x / y))
        else:
            margin.append(-y)
    bad = [m < 0 for m in margin]
    assert_episodes(course, list(monitor.watch(course.trial(columns))), bad, margin, **TIMING)


@on_random_trials
def test_a_formula_in_time(seed: int) -> None:
    course = Course.of(seed)
    course.t = [i * TICK_S for i in range(len(course.t))]
    a, b = course.values([0.0, 0.0, 1.0], hold=8), course.values([0.0, 0.0, 1.0], hold=8)
    monitor = Within(
        trigger="a > 0.5",
        response="b > 0.5",
        within_s=8 * TICK_S,
        signals={"a": "speed/{robot}", "b": "speed/{human}"},
        max_gap_s=MAX_GAP_S,
        t_off_s=0.0,
    )
    late, open_ended = [], []
    for i in range(len(a)):
        if not (a[i] > 0.5 and (i == 0 or a[i - 1] <= 0.5)):
            continue
        answer = next((k for k in range(i, len(b)) if b[k] > 0.5), None)
        if answer is not None and answer - i <= 8:
            continue
        (late if i + 8 <= len(b) - 1 else open_ended).append(course.t[i])
    found = list(monitor.watch(course.trial({"speed/r": ("m/s", a), "speed/h": ("m/s", b)})))
    assert [f.span.start_s for f in of_verdict(found, Verdict.VIOLATED) if f.span] == late
    assert [f.span.start_s for f in of_verdict(found, Verdict.INCONCLUSIVE) if f.span] == open_ended
