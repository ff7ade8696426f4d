"""Recordings as files, what was left out of them, and rules over them: the end that counts rises for nobody.

Found by an outsider; each case raised it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from ariac_score import Body, Event, Finding, Signal, Span, Trial, Verdict, load_rule_set, score_trial
from ariac_score.checks.open_findings import Worlds
from ariac_score.trial.bounds import between_samples
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED
from ariac_score.trial.model import Due
from ariac_score_ariac.safety import CollisionEpisodes
from ariac_score_standards import (
    AgvSpeedClearance,
    HandGuiding,
    MonitoredStandstill,
    PflContact,
    ReducedSpeed,
    StopPerformance,
)

LASTS_S = 6.0
STOPS = ("emergency_stop", "protective_stop", "emergency_stop_reset", "start")
At = Callable[[float], object]


@dataclass(frozen=True)
class Case:
    """What is recorded, what is left out of it, and who counts what.

    Attributes:
        monitor: As a rule set names it, under the name `it`.
        score: The formula.
        signals: How often each is recorded, Hz, and its values over time.
        left_out: Which sample of which signal, by its time.
        events: When, what and of whom.
        bodies: Kind by name.
    """

    monitor: str
    score: str
    signals: Mapping[str, tuple[float, At]]
    left_out: Callable[[str, float], bool]
    events: Sequence[tuple[float, str, str]] = ()
    bodies: tuple[tuple[str, str], ...] = (("robot", "robot"), ("ann", "human"))

    def lines(self, *, robbed: bool) -> list[dict[str, object]]:
        """The records of the log."""
        samples: dict[float, dict[str, object]] = {}
        for name, (rate_hz, value) in self.signals.items():
            for k in range(round(LASTS_S * rate_hz) + 1):
                t_s = round(k / rate_hz, 4)
                if not (robbed and self.left_out(name, t_s)):
                    samples.setdefault(t_s, {})[name] = value(t_s)
        rows: list[tuple[float, dict[str, object]]] = [
            (0.0, {"record": "event", "kind": "competition_started"}),
            *((t_s, {"record": "sample", "values": values}) for t_s, values in samples.items()),
            *(
                (t_s, {"record": "event", "kind": kind, "subject": subject})
                for t_s, kind, subject in self.events
            ),
            (LASTS_S, {"record": "event", "kind": "competition_ended"}),
        ]
        head = {
            "record": "trial",
            "format": "ariac-score-trial-log/1",
            "id": "t",
            "witnessed": ["bodies", *STOPS],
        }
        bodies = [{"record": "body", "id": name, "kind": kind} for name, kind in self.bodies]
        timed = [{**row, "t_s": t_s} for t_s, row in sorted(rows, key=lambda one: one[0])]
        return [head, *bodies, *timed, {"record": "end", "records": len(bodies) + len(timed) + 2}]


def scored(case: Case, folder: Path, *, robbed: bool, mode: str) -> tuple[float, float]:
    """The least and the most of the score, from a file."""
    log, rules = folder / "log.jsonl", folder / "rules.yaml"
    log.write_text("".join(json.dumps(line) + "\n" for line in case.lines(robbed=robbed)))
    (folder / "map.yaml").write_text("{id: nothing, title: none, source: none}\n")
    rules.write_text(f"""
id: left_out
title: left out
source: the test
log_map: ./map.yaml
between_samples: {mode}
bounds:
  human: {{max_speed_m_s: 2.5, source: the test}}
  robot: {{max_speed_m_s: 2.0, source: the test}}
  agv: {{max_speed_m_s: 3.0, source: the test}}
monitors:
  it: {{{case.monitor}}}
score: {case.score}
round: 6
""")
    result = score_trial(log, load_rule_set(rules))
    if result.interval is None:
        assert result.score is not None
        return float(result.score), float(result.score)
    return float(result.interval.least), float(result.interval.most)


def of_signal(name: str, within: Callable[[float], bool] = lambda _t: True) -> Callable[[str, float], bool]:
    return lambda signal, t_s: signal == name and within(t_s)


TURNS_PER_S = 12.5
RADIUS_M = 1 / (2 * math.pi * TURNS_PER_S)
ANSWER = (
    'use: formula.within, with: {trigger: "d < 1.2", response: "v < 0.2", within_s: 0.4, '
    'signals: {d: "centre_distance/{robot}/{human}", v: "speed/{robot}"}}'
)


def circling(t_s: float) -> list[float]:
    angle = 2 * math.pi * TURNS_PER_S * t_s
    return [round(RADIUS_M * math.cos(angle), 6), round(RADIUS_M * math.sin(angle), 6), 1.0]


def coming(t_s: float) -> list[float]:
    x_m = 2.0 if t_s < 2 else max(0.7, 2.0 - 1.3 * (t_s - 2)) if t_s < 4 else min(2.0, 0.7 + 1.3 * (t_s - 4))
    return [round(x_m, 6), 0.0, 1.0]


def coming_nearer_every_2_s(t_s: float) -> float:
    phase = (t_s % 2 - 0.15) / 0.3
    return 1.1 - 0.1 * (1 - math.cos(2 * math.pi * phase)) if 0 < phase < 1 else 1.1


def three_stops(score: str) -> Case:
    """None of them is obeyed, and the topic that shows it is left out."""
    return Case(
        "use: iec_60204_1.stop_performance",
        score,
        {"speed/robot": (100, lambda _t: 0.5), "speed/ann": (100, lambda _t: 0.0)},
        of_signal("speed/robot"),
        [(1.0 + k, "protective_stop", "robot") for k in range(3)],
    )


CASES: Mapping[str, Case] = {
    "gaps that are too short to be found, by the rules' own policy": Case(
        "use: iso_10218_1.reduced_speed, with: {max_speed_m_s: 0.25, t_on_s: 0}, on_inconclusive: worst_case",
        "10 / (1 + seconds(it))",
        {"speed/robot": (100, lambda t_s: 0.5 if 2 <= t_s < 4 and round(t_s * 100) % 2 else 0.1)},
        of_signal("speed/robot", lambda t_s: 2 <= t_s < 4 and round(t_s * 100) % 2 == 1),
    ),
    "places between which it was never at rest": Case(
        ANSWER,
        "10 - seconds(it)",
        {"position/robot": (100, circling), "position/ann": (100, coming)},
        # A whole turn lies between those that are left.
        of_signal("position/robot", lambda t_s: round(t_s * 100) % 8 != 0),
    ),
    "places at which it seems to be at rest": Case(
        ANSWER,
        "10 / (1 + count(it))",
        {"position/robot": (100, circling), "position/ann": (100, coming)},
        of_signal("position/robot", lambda t_s: round(t_s * 100) % 4 != 0),
    ),
    "all but two speeds": Case(
        ANSWER.replace("1.2", "1.0"),
        "20 - 3 * count(it)",
        {
            "centre_distance/robot/ann": (100, coming_nearer_every_2_s),
            "speed/robot": (100, lambda t_s: 0.5 if 0.2 <= t_s % 2 < 0.9 else 0.1),
            "speed/ann": (100, lambda _t: 0.0),
        },
        of_signal("speed/robot", lambda t_s: t_s not in (0.1, 5.9)),
    ),
    "the speed of three stops": three_stops("10 - seconds(it)"),
    "how often, of three stops": three_stops("10 / (1 + count(it))"),
    "what parted gaps of which none can have mattered": Case(
        "use: iso_13850.estop_restart",
        "10 / (1 + count(it))",
        {"speed/robot": (100, lambda _t: 0.5)},
        lambda _name, t_s: 2.0 < t_s < 4.0,
    ),
    "one speed of a truck whose clearance nobody recorded": Case(
        "use: iso_3691_4.agv_speed_clearance",
        "10 * gate(it)",
        {"speed/truck": (100, lambda _t: 1.0)},
        of_signal("speed/truck", lambda t_s: t_s == 2.0),
        bodies=(("truck", "agv"),),
    ),
    "samples of a mode, beside a violation in the last instant": Case(
        "use: iso_10218_1.reduced_speed, with: {applies: manual_mode, t_on_s: 0, t_off_s: 10.0}",
        "10 / (1 + charged(it=1))",
        {
            "speed/robot": (100, lambda t_s: 0.5 if 1 <= t_s < 1.6 or t_s >= 5.995 else 0.0),
            "manual_mode/robot": (20, lambda _t: 1),
        },
        of_signal("manual_mode/robot", lambda t_s: 1.2 < t_s < 1.45),
    ),
    "whether a response was due at all, which earns points": Case(
        ANSWER.replace("1.2", "1.0"),
        "5 * points(it)",
        {"centre_distance/robot/ann": (100, lambda _t: 1.1), "speed/robot": (100, lambda _t: 0.1)},
        of_signal("centre_distance/robot/ann", lambda t_s: 2.0 < t_s < 2.1),
    ),
}


def is_thinned(case: Case) -> bool:
    """Held, nobody misses what is thinned out evenly, where nobody states how often it is recorded."""
    return "position/robot" in case.signals


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        (name, mode)
        for name, case in CASES.items()
        for mode in ("held", "bounded")
        if mode == "bounded" or not is_thinned(case)
    ],
)
def test_the_end_that_counts_does_not_rise(name: str, mode: str, tmp_path: Path) -> None:
    case = CASES[name]
    honest = scored(case, tmp_path, robbed=False, mode=mode)
    robbed = scored(case, tmp_path, robbed=True, mode=mode)

    assert robbed[0] <= honest[0] + 2e-6


def test_bounded_nobody_gains_by_thinning_out_a_flag_whose_rate_nobody_states(tmp_path: Path) -> None:
    pulse = {
        "speed/robot": (100.0, lambda _t: 0.5),
        "manual_mode/robot": (20.0, lambda t_s: int(2.0 < t_s < 2.45)),
    }
    thinned = of_signal("manual_mode/robot", lambda t_s: round(t_s * 20) % 10 != 0)
    use = "use: iso_10218_1.reduced_speed, with: {applies: manual_mode}"
    case = Case(use, "10 / (1 + demerits(it))", pulse, thinned)
    honest = scored(case, tmp_path, robbed=False, mode="bounded")

    assert honest[0] <= 4.81 <= honest[1]  # it was too fast for 0.4 s
    assert scored(case, tmp_path, robbed=True, mode="bounded")[0] <= honest[0]


def test_of_stops_that_none_asked_for_gaps_leave_nothing_open(tmp_path: Path) -> None:
    case = CASES["what parted gaps of which none can have mattered"]

    assert scored(case, tmp_path, robbed=True, mode="held") == (10.0, 10.0)


# What an organiser says is published --------------------------------------------------------------

T = np.arange(301) / 100
SQUARE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0))


def pulse(from_s: float, to_s: float, value: float = 1.0) -> np.ndarray:
    return np.where((from_s <= T) & (to_s > T), value, 0.0)


def places(x_m: np.ndarray | float) -> np.ndarray:
    return np.stack([np.broadcast_to(x_m, T.shape), np.zeros(len(T)), np.zeros(len(T))], axis=1)


DUE: Mapping[str, tuple[object, dict[str, tuple[str, np.ndarray]], list[Event]]] = {
    "manual_mode/arm": (
        ReducedSpeed(applies="manual_mode"),
        {"speed/arm": ("m/s", np.full(301, 0.5)), "manual_mode/arm": ("1", pulse(1.0, 2.0))},
        [],
    ),
    "enabling_device/arm": (
        HandGuiding(),
        {"speed/arm": ("m/s", np.full(301, 0.2)), "enabling_device/arm": ("1", pulse(0.0, 1.0))},
        [],
    ),
    "drive_enabled/arm": (
        StopPerformance(),
        {"speed/arm": ("m/s", pulse(0.0, 1.2)), "drive_enabled/arm": ("1", np.ones(301))},
        [Event(1.0, "emergency_stop", "arm")],
    ),
    "personnel_detection/cart": (
        AgvSpeedClearance(),
        {
            "speed/cart": ("m/s", np.ones(301)),
            "clearance/cart": ("m", np.full(301, 2.0)),
            "personnel_detection/cart": ("1", 1.0 - pulse(1.0, 2.0)),
        },
        [],
    ),
    "joint_speed/arm": (
        MonitoredStandstill(workspace=SQUARE),
        {
            "position/ann": ("m", places(0.0)),
            "speed/arm": ("m/s", np.zeros(301)),
            "joint_speed/arm": ("rad/s", pulse(1.0, 2.0)),
        },
        [],
    ),
    "position/arm": (
        MonitoredStandstill(workspace=SQUARE),
        {
            "position/ann": ("m", places(0.0)),
            "speed/arm": ("m/s", np.full(301, 0.005)),
            "position/arm": ("m", places(T / 100)),
        },
        [],
    ),
    "contact_pressure/arm/ann": (
        PflContact(region="chest"),
        {
            "contact_force/arm/ann": ("N", pulse(1.0, 2.0, 20.0)),
            "contact_pressure/arm/ann": ("Pa", pulse(1.0, 2.0, 9e6)),
        },
        [],
    ),
}


def worst_of(monitor: object, given: Trial) -> tuple[int, float]:
    """How many violations there are at worst, and for how long, s."""
    everything = list(monitor.watch_worlds(given))  # type: ignore[attr-defined]
    opened = [one for one in everything if isinstance(one, Worlds)]
    seen = [one for one in everything if isinstance(one, Finding)]
    worst: Iterable[Finding] = [f for one in opened for f in one.worst] if opened else seen
    broken = [f for f in worst if f.verdict is Verdict.VIOLATED]
    return len(broken), sum(f.quantities.get("time_in_violation_s", 0.0) for f in broken)


@pytest.mark.parametrize("every", [False, True], ids=["held", "bounded"])
@pytest.mark.parametrize("name", DUE)
def test_what_is_published_and_not_in_the_log_lacks(name: str, every: bool) -> None:
    """As a log map says by `rate_hz`; a log that nobody says this of may well have none."""
    monitor, columns, events = DUE[name]
    signals = {
        one: Signal(one, unit, T, values, f"/{one}", stated_rate_hz=100.0)
        for one, (unit, values) in columns.items()
    }
    bounds = {kind: {"max_speed_m_s": 1.0, "source": "the test"} for kind in ("robot", "human", "agv")}
    honest = Trial(
        "t",
        bodies=(Body("arm", "robot", 0.0), Body("ann", "human", 0.0), Body("cart", "agv", 0.0)),
        signals=signals,
        events=(Event(0.0, COMPETITION_STARTED), *events, Event(3.0, COMPETITION_ENDED)),
        witnessed=frozenset({"bodies", "contact", *STOPS}),
        recorded=Span(0.0, 3.0),
        between=between_samples(bounds, {}, every=every),
    )
    left = {one: signal for one, signal in signals.items() if one != name}
    robbed = replace(honest, signals=left, stand_ins={name: Due(f"/{name}", 100.0)})

    number, lasts_s = worst_of(monitor, honest)
    assert number >= 1
    lacking = worst_of(monitor, robbed)
    assert lacking[0] >= number
    assert lacking[1] >= lasts_s - 1e-9


@pytest.mark.parametrize(
    ("monitor", "lacks", "also"),
    [
        (PflContact(region="chest"), "contact_force/arm/ann", {}),
        (CollisionEpisodes(), "in_contact/arm/cart", {}),
        # 3 N are no touch, and beside what the simulator reports of it they show nothing.
        (CollisionEpisodes(), "in_contact/arm/cart", {"contact_force/arm/cart": ("N", pulse(1.0, 2.0, 3.0))}),
        (
            CollisionEpisodes(),
            "contact_force/cart/arm",
            {"body_separation/arm/cart": ("m", np.full(301, 0.001))},
        ),
    ],
)
@pytest.mark.parametrize("published", [False, True])
def test_who_watched_for_touches_vouches_for_no_signal_that_is_published_and_lacks(
    monitor: PflContact | CollisionEpisodes,
    lacks: str,
    also: Mapping[str, tuple[str, np.ndarray]],
    published: bool,
) -> None:
    given = Trial(
        "t",
        bodies=(Body("arm", "robot", 0.0), Body("ann", "human", 0.0), Body("cart", "agv", 0.0)),
        signals={name: Signal(name, unit, T, values, f"/{name}") for name, (unit, values) in also.items()},
        events=(Event(0.0, COMPETITION_STARTED), Event(3.0, COMPETITION_ENDED)),
        witnessed=frozenset({"bodies", "contact", "in_contact"}),
        recorded=Span(0.0, 3.0),
        between=between_samples({}, {}),
        stand_ins={lacks: Due(f"/{lacks}", 100.0)} if published else {},
    )

    (found,) = (one for one in monitor.watch_worlds(given) if isinstance(one, Finding))
    assert (found.verdict, found.span) == (
        (Verdict.INCONCLUSIVE, Span(0.0, 3.0)) if published else (Verdict.SATISFIED, None)
    )


@pytest.mark.parametrize(
    ("score", "least"), [("max(-10, 10 - 4 * seconds(it))", -10), ("10 - seconds(it)", None)]
)
def test_of_a_log_that_tells_of_no_time_the_worst_is_what_the_formula_has_at_least(
    tmp_path: Path, score: str, least: int | None
) -> None:
    head = {"record": "trial", "format": "ariac-score-trial-log/1", "id": "t", "witnessed": ["bodies"]}
    body = {"record": "body", "id": "robot", "kind": "robot"}
    log = tmp_path / "log.jsonl"
    lines = [head, body, {"record": "end", "records": 3}]
    log.write_text("\n".join(map(json.dumps, lines)), encoding="utf-8")
    rules = tmp_path / "rules.yaml"
    rules.write_text(
        "id: r\ntitle: r\nsource: r\nlog_map: paper2020\nmonitors: {it: {use: iso_10218_1.reduced_speed}}\n"
        f"task: 0\nscore: {score}\n",
        encoding="utf-8",
    )

    assert score_trial(log, load_rule_set(rules)).score == least
