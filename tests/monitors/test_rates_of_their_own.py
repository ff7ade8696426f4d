"""Signals that each come at a rate and a phase of their own: leaving out samples makes no worst world better.

Random recordings, and random samples that are left out of them, of some or of all signals.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.checks.open_findings import Worlds
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score.trial.spans import FloatArray
from ariac_score_standards import (
    AgvSpeedClearance,
    EstopRestart,
    HandGuiding,
    MonitoredStandstill,
    PflContact,
    ReducedSpeed,
    SafeguardDistance,
    StopPerformance,
)

LASTS_S = 3.0
BODIES = (Body("arm", "robot", 0.1), Body("ann", "human", 0.2), Body("cart", "agv", 0.3))
WITNESSED = frozenset(
    {"bodies", "contact", "emergency_stop", "protective_stop", "emergency_stop_reset", "start"}
)
SQUARE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))


@dataclass
class Made:
    """A recording that is being made.

    Attributes:
        rng: What decides.
        signals: By name.
        events: Besides start and end.
    """

    rng: np.random.Generator
    signals: dict[str, Signal] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)

    def _times(self) -> tuple[FloatArray, float]:
        rate_hz = float(self.rng.choice([10, 20, 25, 50, 100]))
        phase_s = float(self.rng.choice([0.0, self.rng.random() / rate_hz]))
        t = np.arange(0.0, LASTS_S + 1e-9, 1.0 / rate_hz) + phase_s
        return t[t <= LASTS_S], rate_hz

    def add(self, name: str, unit: str, choices: list[float], *, turns: float = 0.2) -> None:
        """A value of some that turns to another one at some of its samples."""
        t, rate_hz = self._times()
        turning = np.maximum.accumulate(np.where(self.rng.random(len(t)) < turns, np.arange(len(t)), 0))
        values = self.rng.choice(choices, len(t))[turning]
        self.signals[name] = Signal(name, unit, t, values, f"/{name}", stated_rate_hz=rate_hz)

    def walk(self, name: str, furthest_m: float) -> None:
        """Places on straight ways through random ones."""
        t, rate_hz = self._times()
        knots = np.linspace(0.0, LASTS_S, 7)
        x_m, y_m = (np.interp(t, knots, self.rng.uniform(-0.5, furthest_m, 7)) for _ in range(2))
        values = np.stack([x_m, y_m, np.zeros(len(t))], axis=1)
        self.signals[name] = Signal(name, "m", t, values, f"/{name}", stated_rate_hz=rate_hz)

    def happen(self, kinds: list[str], most: int) -> None:
        times = np.sort(self.rng.random(int(self.rng.integers(1, most + 1)))) * LASTS_S
        self.events += [Event(float(t), str(self.rng.choice(kinds)), "arm") for t in times]

    def of(self, *choices: float) -> float:
        return float(self.rng.choice(choices))

    def trial(self, *, every: bool) -> Trial:
        bounds = {
            kind: {"max_speed_m_s": speed, "source": "the test"}
            for kind, speed in {"human": 3.0, "robot": 1.0, "agv": 2.0}.items()
        }
        edges = [Event(0.0, COMPETITION_STARTED), Event(LASTS_S, COMPETITION_ENDED)]
        return Trial(
            "t",
            bodies=BODIES,
            signals=self.signals,
            events=tuple(sorted([*edges, *self.events], key=lambda one: one.t_s)),
            witnessed=WITNESSED,
            recorded=Span(0.0, LASTS_S),
            between=between_samples(bounds, {}, every=every),
        )


def reduced_speed(made: Made) -> object:
    made.add("speed/arm", "m/s", [0.0, 0.2, 0.28, 0.5])
    made.add("manual_mode/arm", "1", [0.0, 1.0], turns=made.of(0.05, 0.3, 0.7))
    return ReducedSpeed(
        applies="manual_mode", t_on_s=made.of(0.0, 0.03), t_off_s=made.of(0.02, 1.0), max_gap_s=0.25
    )


def hand_guiding(made: Made) -> object:
    made.add("speed/arm", "m/s", [0.0, 0.2, 0.28, 0.5])
    made.add("enabling_device/arm", "1", [0.0, 1.0], turns=made.of(0.05, 0.3))
    return HandGuiding(
        stop_within_s=made.of(0.0, 0.1, 0.3), max_speed_m_s=0.4, t_off_s=made.of(0.02, 1.0), max_gap_s=0.25
    )


def clearance(made: Made) -> object:
    made.add("speed/cart", "m/s", [0.0, 0.6, 1.5])
    made.add("clearance/cart", "m", [0.3, 0.45, 0.55, 2.0])
    made.add("personnel_detection/cart", "1", [0.0, 1.0], turns=0.1)
    return AgvSpeedClearance(t_on_s=made.of(0.0, 0.03), t_off_s=made.of(0.02, 1.0), max_gap_s=0.25)


def standstill(made: Made) -> object:
    made.walk("position/ann", 3.0)
    made.add("speed/arm", "m/s", [0.0, 0.0, 0.5])
    made.walk("position/arm", -0.48)
    made.add("joint_speed/arm", "rad/s", [0.0, 0.0, 0.5])
    return MonitoredStandstill(
        workspace=SQUARE, grace_s=made.of(0.0, 0.1, 0.5), t_off_s=made.of(0.02, 1.0), max_gap_s=0.25
    )


def contact(made: Made) -> object:
    made.add("contact_force/arm/ann", "N", [0.0, 0.0, 20.0, 300.0])
    made.add("contact_pressure/arm/ann", "Pa", [0.0, 1e5, 3e6])
    return PflContact(region="chest", t_off_s=made.of(0.02, 1.0), max_gap_s=0.25)


def emergency_stops(made: Made) -> object:
    made.add("speed/arm", "m/s", [0.0, 0.0, 0.5])
    made.happen(["emergency_stop", "emergency_stop", "emergency_stop_reset", "start"], 5)
    return EstopRestart(t_off_s=made.of(0.02, 0.1, 1.0), max_gap_s=0.25)


def stops(made: Made) -> object:
    made.add("speed/arm", "m/s", [0.0, 0.1, 0.5])
    made.add("drive_enabled/arm", "1", [0.0, 1.0], turns=0.1)
    made.happen(["emergency_stop", "protective_stop"], 4)
    return StopPerformance(max_gap_s=0.25)


def line(made: Made) -> object:
    made.walk("position/ann", 3.0)
    made.add("speed/arm", "m/s", [0.0, 0.5])
    return SafeguardDistance(
        line=((-2.0, 1.5), (2.0, 1.5)), hazard=SQUARE, stopping_time_s=made.of(0.05, 0.3), max_gap_s=0.25
    )


RECORDINGS: Mapping[str, Callable[[Made], object]] = {
    one.__name__: one
    for one in (reduced_speed, hand_guiding, clearance, standstill, contact, emergency_stops, stops, line)
}


def robbed(given: Trial, rng: np.random.Generator) -> Trial:
    """A stretch, or some samples, of one signal, or of all."""
    names = [*given.signals] if rng.random() < 0.3 else [str(rng.choice([*given.signals]))]
    from_s, to_s = np.sort(rng.random(2)) * LASTS_S
    a_stretch = rng.random() < 0.6
    left = {}
    for name in names:
        one = given.signals[name]
        kept = (one.t < from_s) | (one.t >= to_s) if a_stretch else rng.random(len(one)) > 0.3
        if np.count_nonzero(kept) > 1:
            left[name] = replace(one, t=one.t[kept], values=one.values[kept])
    return replace(given, signals={**given.signals, **left})


def at_worst(monitor: object, given: Trial) -> tuple[int, float, float]:
    """How many violations there are, for how long, s, and how deep they are over time, s."""
    everything = list(monitor.watch_worlds(given))  # type: ignore[attr-defined]
    opened = {one.subject: one for one in everything if isinstance(one, Worlds)}
    seen = [one for one in everything if isinstance(one, Finding) and one.subject not in opened]
    worst = [*seen, *(finding for one in opened.values() for finding in one.worst)]
    broken = [one for one in worst if one.verdict is Verdict.VIOLATED]
    lasts_s, deep_s = (
        sum(one.quantities.get(name, 0.0) for one in broken)
        for name in ("time_in_violation_s", "relative_depth_integral_s")
    )
    return len(broken), lasts_s, deep_s


@pytest.mark.parametrize("every", [False, True], ids=["held", "bounded"])
@pytest.mark.parametrize("name", RECORDINGS)
def test_whoever_leaves_out_samples_makes_no_worst_world_better(name: str, every: bool) -> None:
    for seed in range(12):
        made = Made(np.random.default_rng(seed))
        monitor = RECORDINGS[name](made)
        honest = made.trial(every=every)
        number, lasts_s, deep_s = at_worst(monitor, honest)

        for _ in range(3):
            found = at_worst(monitor, robbed(honest, made.rng))
            assert found[0] >= number, f"seed {seed}"
            assert found[1] >= lasts_s - 1e-6, f"seed {seed}"
            # Between its samples a force is read by straight lines, where those of the pressure are.
            assert found[2] >= deep_s - (2e-3 if name == "contact" else 1e-6), f"seed {seed}"
