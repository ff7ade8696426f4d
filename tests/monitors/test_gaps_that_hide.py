"""What somebody left out, and what followed from it: none of it may make the worst world better.

Each recording is at 100 Hz for 3 s with its rates stated; an outsider found how to gain from it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict
from ariac_score.checks.open_findings import Worlds
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score.trial.spans import FloatArray
from ariac_score_standards import (
    AgvProtectiveField,
    EstopRestart,
    HandGuiding,
    MonitoredStandstill,
    PflContact,
    PflSpeed,
    ReducedSpeed,
    SafeguardDistance,
    SsmResponse,
    StopPerformance,
    Within,
)

N = 301
T = np.arange(N) / 100
BODIES = (Body("arm", "robot", 0.0), Body("ann", "human", 0.0), Body("cart", "agv", 0.0))
WITNESSED = frozenset(
    {"bodies", "emergency_stop", "emergency_stop_reset", "start", "protective_stop", "contact"}
)
BOUNDS = {
    "human": {"max_speed_m_s": 1.6, "source": "the test"},
    "robot": {"max_speed_m_s": 0.3, "source": "the test"},
}
SQUARE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))


def rows(*spans: tuple[int, int]) -> FloatArray:
    """1 in the samples from each first to before each last one, 0 in others."""
    column = np.zeros(N)
    for first, behind in spans:
        column[first:behind] = 1.0
    return column


def along_x(x_m: FloatArray | float) -> FloatArray:
    """Places, or velocities, along the first axis, shape (n, 3)."""
    return np.stack([np.broadcast_to(x_m, N), np.zeros(N), np.zeros(N)], axis=1)


@dataclass(frozen=True)
class Attack:
    """A recording, what is left out of it, and who judges it.

    Attributes:
        monitor: Who.
        columns: Unit and values by signal, of N samples each.
        left_out: The numbers of the samples that are left out.
        of: Of which signals; empty: of all, as whole messages.
        events: What happened.
    """

    monitor: object
    columns: Mapping[str, tuple[str, FloatArray]]
    left_out: Iterable[int]
    of: Sequence[str] = ()
    events: Sequence[Event] = field(default=())

    def recorded(self, *, every: bool) -> Trial:
        signals = [
            Signal(name, unit, T, values, f"/{name}", stated_rate_hz=100.0)
            for name, (unit, values) in self.columns.items()
        ]
        return Trial(
            "t",
            bodies=BODIES,
            signals={one.name: one for one in signals},
            events=(Event(0.0, COMPETITION_STARTED), *self.events, Event(3.0, COMPETITION_ENDED)),
            witnessed=WITNESSED,
            recorded=Span(0.0, 3.0),
            between=between_samples(BOUNDS, {}, every=every),
        )

    def robbed(self, *, every: bool) -> Trial:
        given, kept = self.recorded(every=every), np.setdiff1d(np.arange(N), [*self.left_out])
        fewer = {
            name: replace(one, t=one.t[kept], values=one.values[kept])
            for name, one in given.signals.items()
            if not self.of or name in self.of
        }
        return replace(given, signals={**given.signals, **fewer})


def drifts() -> dict[str, tuple[str, FloatArray]]:
    """An arm that comes to rest at 0.5 s, is moved by 2 cm 20 ms later, and stays there; somebody is near."""
    moves = rows((0, 50))
    place = np.where(T < 0.5, T / 2 - 0.25, 0.0)
    place[52:] = 0.02
    return {
        "position/ann": ("m", along_x(0.0)),
        "speed/arm": ("m/s", moves / 2),
        "position/arm": ("m", along_x(place)),
    }


def round_the_corner() -> FloatArray:
    """A human who steps through the last 10 cm of a line, and aside behind it."""
    y_m = np.maximum(6.5 - 1.4 * np.maximum(T - 0.3, 0.0), 5.9)
    turns = int(np.flatnonzero(y_m <= 5.95)[0])
    x_m = 1.9 + 1.4 * np.clip(T - T[turns], 0.0, 0.6)
    return np.stack([x_m, y_m, np.zeros(N)], axis=1)


def cart(speeds_m_s: FloatArray) -> dict[str, tuple[str, FloatArray]]:
    """A cart, in whose way somebody steps at 1 s, 1 m ahead, and stays there."""
    x_m = np.cumsum(speeds_m_s) / 100
    return {
        "position/cart": ("m", along_x(x_m)),
        "velocity/cart": ("m/s", along_x(speeds_m_s)),
        "position/ann": ("m", along_x(np.where(T < 1.0, x_m + 5.0, x_m + 1.0))),
    }


# On at samples that none of the cells of 16 ms begins with, into which a gap of 1 s is cut.
BETWEEN_CELLS = np.array(
    [
        1.0 if 100 <= k < 200 and not any(k - 1e-4 <= m / 0.64 <= k + 1.0001 for m in range(N)) else 0.0
        for k in range(N)
    ]
)
CONTACTS = rows((50, 60), (100, 110), (150, 160))
FORCE, PRESSURE = "contact_force/arm/ann", "contact_pressure/arm/ann"
CHEST = PflContact(region="chest", t_off_s=0.05)
RESTS = MonitoredStandstill(workspace=SQUARE, t_on_s=0.0, t_off_s=0.05)
# Requested at 0.5 and at 0.9 s, each 0.1 s before the latest rest; at rest for 90 ms only in between.
TOO_LATE = {"speed/arm": ("m/s", 0.5 * rows((0, 56), (65, 107)))}
TWO_STOPS = [Event(0.5, "emergency_stop", "arm"), Event(0.9, "emergency_stop", "arm")]
LINE = SafeguardDistance(line=((-2.0, 6.0), (2.0, 6.0)), hazard=SQUARE, stopping_time_s=0.1, t_off_s=0.05)
ENTRY = 1.0 + 0.03 * rows((101, 104))
NEAR_FROM_1_S = np.where((T >= 1.0) & (T < 2.5), 1.0, 9.0)
ASKED = rows(*((k, k + 1) for k in range(3, N, 7)))


def asks(**given: float) -> Within:
    signals = {"a": "speed/arm", "b": "speed/cart"}
    return Within(trigger="a > 0.5", response="b > 0.5", signals=signals, max_gap_s=0.05, **given)


ATTACKS: Mapping[str, Callable[[], Attack]] = {
    "a mode that is on within a gap of the speed alone": lambda: Attack(
        ReducedSpeed(applies="manual_mode", t_on_s=0.0, t_off_s=0.02),
        {"speed/arm": ("m/s", np.full(N, 0.28)), "manual_mode/arm": ("1", BETWEEN_CELLS)},
        range(95, 205),
        ["speed/arm"],
    ),
    "a device that is let go within a gap of the speed alone": lambda: Attack(
        HandGuiding(stop_within_s=0.0, t_off_s=0.02, max_speed_m_s=0.5),
        {"speed/arm": ("m/s", np.full(N, 0.28)), "enabling_device/arm": ("1", 1.0 - BETWEEN_CELLS)},
        range(95, 205),
        ["speed/arm"],
    ),
    "two stops and one gap": lambda: Attack(
        StopPerformance(max_time_s=0.1), TOO_LATE, range(64, 108), events=TWO_STOPS
    ),
    "nine of ten samples of what asks for a response": lambda: Attack(
        asks(within_s=0.05, t_off_s=0.0),
        {"speed/arm": ("m/s", ASKED), "speed/cart": ("m/s", rows((290, N)))},
        [k for k in range(N) if k % 10],
    ),
    "the middle of what asks for a response": lambda: Attack(
        asks(within_s=0.2, t_on_s=0.25, t_off_s=0.05),
        {"speed/arm": ("m/s", rows((50, 90), (150, 190))), "speed/cart": ("m/s", rows((110, 115), (210, N)))},
        [*range(65, 75), *range(165, 175)],
    ),
    "how a gap closed just before each contact": lambda: Attack(
        CHEST,
        {
            FORCE: ("N", 200.0 * CONTACTS),
            "crush_gap/arm/ann": ("m", 1.0 - 0.6 * rows((50, 70), (100, 120), (150, 170))),
        },
        [48, 49, 98, 99, 148, 149],
        ["crush_gap/arm/ann"],
    ),
    "the one pressure of a brief contact": lambda: Attack(
        CHEST,
        {FORCE: ("N", 50.0 * rows((50, 51))), PRESSURE: ("Pa", 9e6 * rows((50, 51)))},
        [50],
        [PRESSURE],
    ),
    "the pressure where the area is recorded as 0": lambda: Attack(
        CHEST,
        {
            FORCE: ("N", 50.0 * CONTACTS),
            PRESSURE: ("Pa", 9e6 * CONTACTS),
            "contact_area/arm/ann": ("m2", np.zeros(N)),
        },
        [*range(50, 60), *range(100, 110), *range(150, 160)],
        [PRESSURE],
    ),
    "all of the pressure": lambda: Attack(
        CHEST, {FORCE: ("N", 50.0 * CONTACTS), PRESSURE: ("Pa", 9e6 * CONTACTS)}, range(N), [PRESSURE]
    ),
    "something far from every contact": lambda: Attack(
        PflContact(t_off_s=0.05),
        {FORCE: ("N", 50.0 * rows((50, 60), (200, 210)))},
        [260, 261],
        events=[
            Event(0.63, "contact", "arm/ann", "skull_forehead"),
            Event(2.03, "contact", "arm/ann", "abdomen"),
        ],
    ),
    "the beginning of a breach": lambda: Attack(
        SsmResponse(profile="seed", t1_s=0.2, t2_s=0.3, delta_m=2.6, t_off_s=0.05),
        {
            "centre_distance/arm/ann": ("m", NEAR_FROM_1_S),
            "speed/arm": ("m/s", np.where(T < 1.02, 0.1, 1.0)),
            "speed/ann": ("m/s", np.zeros(N)),
        },
        [100, 101],
    ),
    "where it came to rest": lambda: Attack(RESTS, drifts(), [50, 51]),
    "its place where it came to rest": lambda: Attack(RESTS, drifts(), [50, 51], ["position/arm"]),
    "the first samples of the joints": lambda: Attack(
        MonitoredStandstill(workspace=SQUARE, grace_s=0.0, t_on_s=0.0, t_off_s=0.05),
        {
            "position/ann": ("m", along_x(0.0)),
            "speed/arm": ("m/s", np.zeros(N)),
            "joint_speed/arm": ("rad/s", 0.05 * rows((0, 4), (150, 160))),
        },
        range(4),
        ["joint_speed/arm"],
    ),
    "the first and the last distances of a cart": lambda: Attack(
        AgvProtectiveField(t_off_s=0.05),
        {**cart(np.full(N, 1.0)), "body_separation/cart/ann": ("m", 1.0 - rows((0, 4), (N - 4, N)))},
        [*range(4), *range(N - 4, N)],
        ["body_separation/cart/ann"],
    ),
    "how fast a cart was when somebody stepped in": lambda: Attack(
        AgvProtectiveField(t_off_s=0.05), cart(ENTRY), [100, 101, 102]
    ),
    "a step through the end of a line": lambda: Attack(
        LINE,
        {"position/ann": ("m", round_the_corner()), "speed/arm": ("m/s", np.full(N, 0.5))},
        range(64, 115),
    ),
    "ten stops": lambda: Attack(
        EstopRestart(stop_within_s=0.05),
        {"speed/arm": ("m/s", np.full(N, 0.28))},
        range(50, 150),
        events=[Event(0.5 + k / 10, "emergency_stop", "arm") for k in range(10)],
    ),
    "the last distance of a cart": lambda: Attack(
        AgvProtectiveField(t_off_s=0.05),
        {**cart(np.full(N, 1.0)), "body_separation/cart/ann": ("m", 1.0 - rows((N - 1, N)))},
        [N - 1],
        ["body_separation/cart/ann"],
    ),
    "the last sample of a mode": lambda: Attack(
        ReducedSpeed(applies="manual_mode", t_on_s=0.0, t_off_s=0.02),
        {"speed/arm": ("m/s", np.full(N, 0.28)), "manual_mode/arm": ("1", rows((0, 50), (N - 1, N)))},
        [N - 1],
        ["manual_mode/arm"],
    ),
    "the pressure beside an area that is recorded": lambda: Attack(
        CHEST,
        {
            FORCE: ("N", 50.0 * CONTACTS),
            PRESSURE: ("Pa", 9e6 * CONTACTS),
            "contact_area/arm/ann": ("m2", np.full(N, 0.01)),
        },
        [*range(50, 60), *range(100, 110), *range(150, 160)],
        [PRESSURE],
    ),
    "where a contact was": lambda: Attack(
        PflContact(t_off_s=0.05),
        {FORCE: ("N", 300.0 * CONTACTS), "contact_height/arm/ann": ("m", np.full(N, 1.3))},
        range(90, 120),
        ["contact_height/arm/ann"],
    ),
    "the beginning of a contact": lambda: Attack(
        PflSpeed(t_off_s=0.2),
        {
            "separation/arm/ann": ("m", 1.0 - rows((100, 150), (200, 250))),
            "relative_speed/arm/ann": ("m/s", rows((100, 101), (200, 201))),
        },
        [100, 200],
    ),
}


def found(monitor: object, given: Trial) -> tuple[tuple[int, float], tuple[int, float]]:
    """How many violations there are and for how long, s: at best and at worst."""
    everything = list(monitor.watch_worlds(given))  # type: ignore[attr-defined]
    opened = [one for one in everything if isinstance(one, Worlds)]
    seen = [one for one in everything if isinstance(one, Finding)]
    best = [f for one in opened for f in one.best] if opened else seen
    worst = [f for one in opened for f in one.worst] if opened else seen
    # What stays undecided where nothing is open is priced as one violation, or as none.
    undecided = [] if opened else [f for f in seen if f.verdict is Verdict.INCONCLUSIVE]
    at_best, at_worst = (
        (len(each), sum(f.quantities.get("time_in_violation_s", 0.0) for f in each))
        for each in ([f for f in world if f.verdict is Verdict.VIOLATED] for world in (best, worst))
    )
    open_s = sum(f.span.duration_s for f in undecided if f.span)
    return at_best, (at_worst[0] + len(undecided), at_worst[1] + open_s)


@pytest.mark.parametrize("every", [False, True], ids=["held", "bounded"])
@pytest.mark.parametrize("name", ATTACKS)
def test_whoever_leaves_it_out_gains_nothing(name: str, every: bool) -> None:
    attack = ATTACKS[name]()
    honest = found(attack.monitor, attack.recorded(every=every))
    best, worst = found(attack.monitor, attack.robbed(every=every))

    assert worst[0] >= honest[1][0] >= 1
    assert worst[1] >= honest[1][1] - 1e-9
    assert best[0] <= honest[0][0] or best[1] <= honest[0][1] + 1e-9
