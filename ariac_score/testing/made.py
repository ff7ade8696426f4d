"""A trial that has everything: every well-known quantity, work, events, an official result.

For checking plugins, not for scoring: its signals are independent triangle waves,
except those of the example trial, which it contains.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ariac_score.checks.registry import Plugin, Registry
from ariac_score.errors import PluginError
from ariac_score.monitors.subjects import Subjects
from ariac_score.scoring.ruleset import RuleSet, load_rule_set
from ariac_score.testing.trials import near_miss_trial
from ariac_score.trial.events import ARM_COLLISION, ORDER_ANNOUNCED, PART_DROPPED, Event
from ariac_score.trial.model import Body, OfficialResult, TeamSetup, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray
from ariac_score.trial.vocabulary import ENVIRONMENT, QUANTITIES, Quantity
from ariac_score.trial.work import Item, Submission

__all__ = ["example_trial", "inhabited", "made_trial", "made_trial_for"]

_COMPETITIONS = "ariac_score.competitions"

_WAVES = {"m": (1.5, 1.4), "m/s": (0.6, 0.6), "N": (80.0, 80.0), "Pa": (5e5, 5e5), "m2": (1e-3, 1e-3)}
"""Middle and amplitude of a quantity in this unit; others swing about 0 by 1."""

_EVENTS = (
    Event(6.0, "emergency_stop", "robot"),
    Event(9.0, "emergency_stop_reset", "robot"),
    Event(10.0, "start", "robot"),
    Event(12.0, "pose_attained", "robot"),
    Event(16.0, "protective_stop", "robot"),
    Event(20.0, "pose_attained", "robot"),
    Event(21.0, "quality_check", "ABCD1234"),
    Event(25.0, PART_DROPPED),
    Event(28.0, "pose_attained", "robot"),
    Event(31.0, "part_assembled", "as2", "battery"),
)
_LONGEST_S, _STEP_S = 120.0, 0.01
_FLAG_PERIODS_S = (10.0, 14.0)
"""Two, so that a flag is also on while another is off."""


def made_trial(*, duration_s: float = 40.0, kinds: Sequence[str] = ()) -> Trial:
    """The example trial with every quantity of the vocabulary, work at two levels, and an official result.

    Args:
        duration_s: Length of the recording at 100 Hz, s; at least 35.
        kinds: Kinds of further bodies it shall have, such as `vehicle`; one of each.
    """
    example = near_miss_trial(duration_s=duration_s)
    bodies = (
        *(Body(f"{kind}1", kind, radius_m=0.5) for kind in kinds),
        Body("human", "human", radius_m=0.3),
        Body("robot", "robot", radius_m=0.2, links=("tcp",)),
    )
    announced = [
        Event(t_s, ORDER_ANNOUNCED, item.id) for item in _WORK if (t_s := item.announced_s) is not None
    ]
    trial = replace(
        example,
        id="made",
        bodies=bodies,
        work=_WORK,
        submissions=(Submission("object_1", 14.0), Submission("object_3", 31.0)),
        events=tuple(sorted((*example.events, *announced, *_EVENTS))),
        # Every kind of event it has, so that checks of events are not all inconclusive.
        witnessed=example.witnessed | {"bodies", ARM_COLLISION, *(event.kind for event in _EVENTS)},
        team=TeamSetup("team"),
        official=OfficialResult("made", 20.0, 37.5, {"task_1": 12.0, "task_2": 8.0}),
        facts={"time_limit_s": 600.0, "scene": "made", "finished_s": None},
    )
    t = example.signals["position/robot"].t
    made = {name: _made(name, quantity, t, k) for k, (name, quantity) in enumerate(_names(trial))}
    # Signals of the example replace waves of their name: its near miss can be checked by hand.
    return replace(trial, signals=dict(sorted({**made, **example.signals}.items())))


_WORK = (
    Item(
        "task_1",
        "task",
        {"time_limit_s": 300.0},
        (Item("object_1", "object", {"kind": "bolt"}), Item("object_2", "object", {"kind": "nut"})),
        announced_s=1.0,
    ),
    Item("task_2", "task", {"time_limit_s": 200.0}, (Item("object_3", "object", {"kind": "bolt"}),), 8.0),
)


def _usable() -> Iterator[tuple[str, Quantity]]:
    """The quantities, less those whose distributions are broken or contradict each other."""
    for name in QUANTITIES:
        with suppress(PluginError):
            yield name, QUANTITIES[name]


def _names(trial: Trial) -> Iterator[tuple[str, Quantity]]:
    """Every signal that the vocabulary allows for these bodies."""
    for name, quantity in _usable():
        if quantity.of == ENVIRONMENT:
            points: list[str] = [ENVIRONMENT]
        elif quantity.of == "body":
            points = [p for b in trial.bodies for p in (b.id, *(f"{b.id}::{link}" for link in b.links))]
        elif quantity.any_bodies:
            points = [f"{a.id}/{b.id}" for a, b in trial.body_pairs()]
        else:
            points = [f"{robot.id}/{human.id}" for robot, human in trial.pairs()]
        yield from ((f"{name}/{point}", quantity) for point in points)


def _made(name: str, quantity: Quantity, t: FloatArray, k: int) -> Signal:
    """A wave of its own period; flags are on for the first half of theirs."""
    if quantity.unit == "1":
        period_s = _FLAG_PERIODS_S[k % 2]
        return Signal(name, "1", t, (np.mod(t, period_s) < period_s / 2).astype(np.float64))
    middle, amplitude = _WAVES.get(quantity.unit, (0.0, 1.0))
    columns = [middle + amplitude * _triangle(t, 7.0 + k % 13 + c) for c in range(quantity.components)]
    values = columns[0] if quantity.components == 1 else np.stack(columns, axis=1)
    return Signal(name, quantity.unit, t, np.maximum(values, quantity.at_least))


def _triangle(t: FloatArray, period_s: float) -> FloatArray:
    """From 1 to -1 and back; no sine, whose last bits differ between machines."""
    wave: FloatArray = np.abs(np.mod(t, period_s) / period_s * 4.0 - 2.0) - 1.0
    return wave


def inhabited(trial: Trial, subjects: Subjects) -> Trial:
    """The trial with bodies that a monitor is about, and everything known of them, where it has nobody such.

    A trial without a recording, or with a very long one, stays as it is.
    """
    recorded = trial.recorded
    if subjects.of(trial.bodies) or recorded is None or recorded.duration_s > _LONGEST_S:
        return trial
    bodies = list(trial.bodies)
    for kind in dict.fromkeys(subjects.kinds):
        lacking = subjects.kinds.count(kind) - len(trial.bodies_of(kind))
        bodies += [Body(f"{kind}_made_{number + 1}", kind, radius_m=0.5) for number in range(lacking)]
    those = subjects.of(bodies)
    pairs = [subject.name for subject in those if len(subject.bodies) == 2]
    points = {"body": sorted({body for subject in those for body in subject.bodies.values()}), "pair": pairs}
    t = np.arange(recorded.start_s, recorded.end_s, _STEP_S)
    made: dict[str, Signal] = {}
    for name, quantity in _usable():
        for one in points.get(quantity.of, ()):
            made[f"{name}/{one}"] = _made(f"{name}/{one}", quantity, t, len(made))
    return replace(trial, bodies=tuple(bodies), signals={**made, **trial.signals})


def made_trial_for(plugin: Plugin, registry: Registry) -> Trial:
    """A trial that gives a plugin something to say: of the competition of its package, if there is one.

    Otherwise of the competitions of its distribution that which shows most.
    """
    own, others = [], []
    for name in registry.names(_COMPETITIONS):
        competition = registry.find(_COMPETITIONS, name)
        offer = getattr(competition.build({}), "made_trial", None)
        if offer is not None and competition.package == plugin.package:
            own.append(offer)
        elif offer is not None and competition.distribution == plugin.distribution:
            others.append(offer)
    trials: list[Trial] = [offer() for offer in own[:1] or others]
    return max(trials, key=lambda trial: len(trial.signals), default=None) or made_trial()


def example_trial(rules: str | RuleSet, *, seed: int = 2020) -> Trial:
    """The example trial of the competition that a rule set is for.

    Args:
        rules: A rule set or its name.
        seed: Same seed, same trial, on every machine.

    Raises:
        ValueError: The rule set names no competition, or that offers no example.
    """
    rule_set = rules if isinstance(rules, RuleSet) else load_rule_set(rules)
    offer = getattr(rule_set.build_competition(Registry()), "example_trial", None)
    if offer is None:
        raise ValueError(f"{rule_set.id!r} names no competition that offers an example trial")
    trial: Trial = offer(seed=seed)
    return trial
