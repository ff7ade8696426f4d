"""Whether the interval of a recording contains the true score, in every one of many simulated trials.

    python benchmarks/truth.py [--trials 360] [--first 0] [--seconds 4] [--states-hz 0] [--kept FILE]

A trial is simulated at 1 kHz: one or two robots and one to three humans that walk, dash, stop and turn,
none faster than the rules state. Its true score is that of all the samples. It is recorded through a model
of a recorder and measured again under `between_samples: bounded`. The true score has to lie between the
scores of the two worlds. Then an adversary leaves out samples, and the end that counts may be above neither
the truth nor, but for `CUTS`, that of the honest recording. Last, both are measured by the usual rules
(`between_samples: held`, the rate stated), whose width is reported, and how far the truth lies outside of it.
There, too, the adversary may raise nothing. Exits with 1 where anything of it fails, naming the seed.
With `--states-hz` the competition starts and ends somewhere within the recording, which has that from a topic
of so many messages a second, up to one of their intervals late. With `--kept` each trial is a line of a file,
and a run that was stopped goes on where it was.

The recorders:

    steady    every sample at its time
    jitter    samples up to 45 % of an interval early or late, stamped when they were
    late      stamped on arrival, up to 30 ms late, which the rules state as `time_error_s`
    bursts    nothing for a while, then the newest alone
    drops     15 % are lost
    killed    likewise, and nothing of the last fifth, nor of the end; up to there it says ten times a second
              that it runs
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import defaultdict
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ariac_score.engine.measure import measure_trial
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.results.doubt import left_open
from ariac_score.results.result import Measured
from ariac_score.scoring.pricing import price
from ariac_score.scoring.ruleset import rule_set_from_text
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray, Span
from ariac_score.trial.window import RAN, stated_late, stated_on, with_window

STEP_S = 0.001
HUMAN_M_S, ROBOT_M_S = 1.6, 1.0
LATE_S = 0.03
ROUNDING = 2e-6
CUTS = 2e-3
"""Points by which the worst world of fewer samples may be better: bounds are taken from the nearest sample on
either side, and where stamps may be wrong, or two bodies move, one further away may have bounded more."""

RULES = """
id: truth
title: Separation and contact, over simulated trials
source: benchmarks/truth.py
log_map: ariac2020
between_samples: {between}
bounds:
  human: {{max_speed_m_s: 1.6, source: the simulation}}
  robot: {{max_speed_m_s: 1.0, source: the simulation}}
  time_error_s: {error_s}
monitors:
  separation:
    use: iso_ts_15066.ssm_separation
    with: {{profile: seed, t1_s: 0.2, t2_s: 0.3, delta_m: 0.5, max_gap_s: 0.05}}
  human_contact:
    use: ariac.human_contact
    with: {{distance: separation, contact_distance_m: 0.05, max_gap_s: 0.05}}
score: 20 * gate(human_contact) / (1 + 0.4 * demerits(separation, tau_s=5) + seconds(separation) / 10)
"""

RATES_HZ = (2.0, 5.0, 10.0, 25.0, 50.0, 100.0)
RUNS_HZ = 10.0
"""How often a simulator says that the competition runs."""
MODELS = ("steady", "jitter", "late", "bursts", "drops", "killed")
ADVERSARIES = ("the worst", "every other", "all but a few", "whatever is near", "the rest of it")


# The world -------------------------------------------------------------------------------------


def walk(random: np.random.Generator, steps: int, fastest_m_s: float, start: FloatArray) -> FloatArray:
    """Positions of a body that walks, dashes, stops and turns, shape (steps, 3), m."""
    most = int(steps * STEP_S / 0.05) + 1  # as many stretches of the shortest kind as there can be
    lasts = (random.uniform(0.05, 1.2, size=most) / STEP_S).astype(int)
    speeds = fastest_m_s * np.choose(
        random.integers(3, size=most), [np.zeros(most), random.random(most), 1.0]
    )
    # Onwards, back, or anywhere.
    turns = np.choose(random.integers(3, size=most), [0.0, np.pi, random.uniform(0, 2 * np.pi, size=most)])
    headings = np.cumsum(turns)
    velocity = np.repeat(
        speeds[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=1), lasts, axis=0
    )
    places = start + np.concatenate([np.zeros((1, 2)), np.cumsum(velocity[: steps - 1] * STEP_S, axis=0)])
    return np.column_stack([places, np.ones(steps)])


def world(random: np.random.Generator, seconds: float) -> Trial:
    """A trial as it was, every millisecond."""
    steps = int(seconds / STEP_S) + 1
    t = np.arange(steps, dtype=np.float64) * STEP_S
    bodies = [Body(f"robot_{k}", "robot", 0.2) for k in range(int(random.integers(1, 3)))]
    bodies += [Body(f"human_{k}", "human", 0.2) for k in range(int(random.integers(1, 4)))]
    signals = {}
    for body in bodies:
        fastest = ROBOT_M_S if body.kind == "robot" else HUMAN_M_S
        start = random.uniform(-2.5, 2.5, size=2)
        name = f"position/{body.id}"
        signals[name] = Signal(name, "m", t, walk(random, steps, fastest, start), f"/{body.id}")
    return Trial(
        "truth",
        bodies=tuple(bodies),
        signals=signals,
        events=(Event(0.0, COMPETITION_STARTED), Event(float(t[-1]), COMPETITION_ENDED)),
        witnessed=frozenset({"bodies"}),
        recorded=Span(0.0, float(t[-1])),
    )


# Recorders -------------------------------------------------------------------------------------


def kept_rows(random: np.random.Generator, steps: int, rate_hz: float, model: str) -> Any:
    """The steps that a recorder kept."""
    every = 1.0 / (rate_hz * STEP_S)
    rows = np.arange(0.0, steps, every)
    if model == "jitter":
        rows = rows + random.uniform(-0.45, 0.45, size=len(rows)) * every
    if model == "bursts":
        rows = rows[random.random(len(rows)) >= 0.3]
    if model in ("drops", "killed"):
        rows = rows[random.random(len(rows)) > 0.15]
    found = np.unique(np.clip(np.round(rows), 0, steps - 1).astype(int))
    return found if model != "killed" else found[found < steps * 0.8]


def recorded(random: np.random.Generator, trial: Trial, rate_hz: float, model: str) -> Trial:
    """The trial as a recorder has it."""
    signals = {}
    for name, signal in trial.signals.items():
        rows = kept_rows(random, len(signal), rate_hz, model)
        t, values = signal.t[rows], signal.values[rows]
        if model == "late":  # messages come in their order, and of those that come at once the newest counts
            t = np.maximum.accumulate(t + random.uniform(0.0, LATE_S, size=len(t)))
            newest = np.append(np.diff(t) > 0, True) & (t <= signal.t[-1])
            t, values = t[newest], values[newest]
        signals[name] = replace(signal, t=t, values=values)
    found = replace(trial, signals=signals)
    return cut_off(found) if model == "killed" else found


def robbed(random: np.random.Generator, trial: Trial, truth: Measured, adversary: str) -> Trial:
    """What an adversary, who knows the truth, leaves of a recording."""
    spans = [f.span for f in truth.findings.values() if f.span is not None and f.verdict.value == "violated"]
    signals = {}
    for name, one in trial.signals.items():
        stays = np.ones(len(one.t), dtype=bool)
        if adversary == "every other":
            stays = np.arange(len(one.t)) % 2 == 0
        elif adversary == "all but a few":
            stays = random.random(len(one.t)) < 0.2
        elif adversary == "the rest of it" and spans:
            stays = one.t < min(span.start_s for span in spans)
        elif adversary == "whatever is near":
            for span in spans:
                stays &= (one.t < span.start_s - 0.1) | (one.t > span.end_s + 0.1)
        elif spans:
            worst = max(spans, key=lambda span: (span.duration_s, span.start_s))
            stays = np.abs(one.t - worst.start_s) > 0.2
        signals[name] = replace(one, t=one.t[stays], values=one.values[stays]) if stays.any() else one
    left = replace(trial, signals=signals)
    return cut_off(left) if adversary == "the rest of it" else left


def cut_off(trial: Trial) -> Trial:
    """The trial without its end, recorded as far as its samples go; up to there it says that it runs."""
    end_s = max((float(one.t[-1]) for one in trial.signals.values() if len(one)), default=0.0)
    span, started = Span(0.0, max(end_s, STEP_S)), trial.events[0]
    ran_s = np.floor((end_s - started.t_s) * RUNS_HZ) / RUNS_HZ
    told = replace(started, numbers=tuple(one for one in started.numbers if one.name != RAN))
    told = stated_on(told, float(ran_s)) if ran_s > 0.0 else told
    return with_window(replace(trial, events=(told,), recorded=span), "")


def within(random: np.random.Generator, trial: Trial) -> Trial:
    """The trial with a competition that starts after the recording and ends before it."""
    assert trial.recorded is not None  # as `world` makes it
    starts_s, ends_s = random.uniform(0.2, 0.8), trial.recorded.end_s - random.uniform(0.2, 0.8)
    return replace(trial, events=(Event(starts_s, COMPETITION_STARTED), Event(ends_s, COMPETITION_ENDED)))


def stated(random: np.random.Generator, events: tuple[Event, ...], states_hz: float) -> tuple[Event, ...]:
    """Start and end as a topic that states them at a rate tells them: with its next message."""
    phase = random.uniform(0.0, 1.0)
    found = []
    for event in events:
        t_s = (np.ceil(event.t_s * states_hz - phase) + phase) / states_hz
        found.append(stated_late(replace(event, t_s=float(t_s)), 1.0 / states_hz))
    return tuple(found)


# Scores ----------------------------------------------------------------------------------------


@cache
def rules(between: str, error_s: float = 0.001) -> Prepared:
    """The rules, prepared."""
    return prepare(rule_set_from_text(RULES.format(between=between, error_s=error_s), file="truth"))


def score_of(measured: Measured, prepared: Prepared) -> tuple[float, float]:
    """Least and greatest score, as every result has them; infinite where nothing bounds it."""
    rule_set = prepared.rule_set
    priced = price(
        measured.findings,
        measured.scopes,
        rule_set.sheet,
        rule_set.policies,
        digits=6,
        measures=measured.measures,
        left_open=left_open(measured, rule_set),
    )
    if priced.interval is not None:
        return float(priced.interval.least), float(priced.interval.most)
    if priced.ledger is None:
        return -np.inf, np.inf
    return float(priced.ledger.amount), float(priced.ledger.amount)


def at_rate(trial: Trial, rate_hz: float) -> Trial:
    """The trial as a log map reads it that states how often each body is published."""
    rated = {name: replace(signal, stated_rate_hz=rate_hz) for name, signal in trial.signals.items()}
    return replace(trial, signals=rated)


def ends_of(trial: Trial, prepared: Prepared) -> tuple[float, float]:
    """Least and greatest score of a recording."""
    return score_of(measure_trial(prepared.derived(trial), prepared), prepared)


@dataclass(frozen=True)
class Tried:
    """One simulated trial.

    Attributes:
        seed: By which it is made again.
        rate_hz: Of its recording.
        model: Of its recorder.
        true: Its score.
        least: Of its recording, in the worst world.
        most: In the best world.
        held: Width of the interval where every usual interval counts as seen.
        adversary: Who left samples out.
        robbed: The worst end then.
        gained_held: By how much he raised the worst end where every usual interval counts as seen.
        missed_held: How far the truth lies outside of the interval there: above it, or below it (negative).
    """

    seed: int
    rate_hz: float
    model: str
    true: float
    least: float
    most: float
    held: float
    adversary: str
    robbed: float
    gained_held: float
    missed_held: float

    @property
    def width(self) -> float:
        """How long the interval is; infinite where nothing bounds it."""
        return self.most - self.least

    @property
    def holds(self) -> bool:
        """Whether the interval contains the truth, and the adversary gained nothing."""
        inside = self.least - ROUNDING <= self.true <= self.most + ROUNDING
        return inside and self.robbed <= min(self.true + ROUNDING, self.least + CUTS)


def tried(seed: int, seconds: float, states_hz: float = 0.0) -> Tried:
    """One trial, simulated, recorded and scored."""
    random = np.random.default_rng(seed)
    rate_hz, model = RATES_HZ[seed % len(RATES_HZ)], MODELS[(seed // len(RATES_HZ)) % len(MODELS)]
    adversary = ADVERSARIES[(seed // (len(RATES_HZ) * len(MODELS))) % len(ADVERSARIES)]
    truth, error_s = world(random, seconds), LATE_S if model == "late" else 0.001
    bounded, held = rules("bounded", error_s), rules("held", error_s)
    of_states = np.random.default_rng((seed, 1))  # its own: the motion of a seed is the same with and without
    truth = within(of_states, truth) if states_hz else truth
    whole = measure_trial(held.derived(truth), held)
    told = replace(truth, events=stated(of_states, truth.events, states_hz)) if states_hz else truth
    log = recorded(random, told, rate_hz, model)
    least, most = ends_of(log, bounded)
    left = robbed(random, log, whole, adversary)
    least_held, most_held = ends_of(at_rate(log, rate_hz), held)
    again, again_held = ends_of(left, bounded)[0], ends_of(at_rate(left, rate_hz), held)[0]
    true, _ = score_of(whole, held)
    gained = again_held - least_held if again_held > least_held else 0.0
    missed = true - min(max(true, least_held), most_held)
    width = most_held - least_held
    return Tried(seed, rate_hz, model, true, least, most, width, adversary, again, gained, missed)


# Reports ---------------------------------------------------------------------------------------


def table(found: list[Tried]) -> str:
    """By rate and recorder: the mean width, bounded and held, and how many intervals hold the truth."""
    groups: dict[tuple[float, str], list[Tried]] = defaultdict(list)
    for one in found:
        groups[one.rate_hz, one.model].append(one)
    lines = ["| rate, Hz | " + " | ".join(MODELS) + " |", "|---:|" + "---:|" * len(MODELS)]
    for rate_hz in RATES_HZ:
        cells = [_cell(groups.get((rate_hz, model), [])) for model in MODELS]
        lines.append(f"| {rate_hz:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _cell(own: list[Tried]) -> str:
    if not own:
        return ""
    width, held = (float(np.mean([number(one) for one in own])) for number in (_width, _held))
    return f"{width:.2f}, {held:.2f} ({sum(one.holds for one in own)} of {len(own)})"


def _missed(found: list[Tried]) -> str:
    """How many intervals the truth lies outside of where usual intervals count as seen, and how far."""
    above = [one.missed_held for one in found if one.missed_held > ROUNDING]
    below = [-one.missed_held for one in found if one.missed_held < -ROUNDING]
    said = [
        f"{len(some)} lie {side} their interval, by {max(some, default=0.0):.3f} at most"
        for some, side in ((above, "above"), (below, "below"))
    ]
    return f"of the true scores {', '.join(said)}"


def _width(one: Tried) -> float:
    return one.width


def _held(one: Tried) -> float:
    return one.held


def kept(file: Path | None) -> list[Tried]:
    """The trials that an earlier run left in a file."""
    if file is None or not file.exists():
        return []
    lines = file.read_text(encoding="utf-8").splitlines()
    return [Tried(**json.loads(line)) for line in lines]


def main() -> int:
    """Try many trials, print the table, and name the seeds that fail."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=360)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--states-hz", type=float, default=0.0)
    parser.add_argument("--kept", type=Path)
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.trials)
    known = {one.seed: one for one in kept(given.kept)}
    for seed in seeds:
        if seed in known:
            continue
        one = known[seed] = tried(seed, given.seconds, given.states_hz)
        if not one.holds:
            print(f"does not hold: {one}", flush=True)
        if given.kept:
            with given.kept.open("a", encoding="utf-8") as file:
                file.write(json.dumps(asdict(one)) + "\n")
    found = [known[seed] for seed in seeds]
    failed = [one.seed for one in found if not one.holds]
    gained = sum(one.robbed > one.least + ROUNDING for one in found)
    print(table(found), end="")
    print(f"{len(found)} trials, {len(failed)} fail{': ' + str(failed[:20]) if failed else ''}")
    print(f"bounded: {gained} adversaries raised the end that counts above that of the honest recording")
    print(f"held: {_missed(found)}")
    held = {one.seed: one.gained_held for one in found if one.gained_held > ROUNDING}
    named = "".join(f", {seed}: {points:.3f}" for seed, points in sorted(held.items()))
    print(f"held: {len(held)} adversaries raised it{named}")
    return 1 if failed or held else 0


if __name__ == "__main__":
    sys.exit(main())
