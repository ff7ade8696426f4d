"""Whether the interval of a recording contains the true score, in every one of many simulated trials.

    python benchmarks/truth.py [--trials 300] [--first 0] [--seconds 8] [--table FILE]

A trial is simulated at 1 kHz: one or two robots and one to three humans that walk, dash, stop and turn,
none faster than the rules state. Its true score is that of all the samples. It is recorded through a model
of a recorder (its rate, jitter, bursts, drops, a kill) and measured again under `between_samples: bounded`.
The true score has to lie between the scores of the two worlds. Then an adversary leaves out the samples
around the worst violation, and the worst end may not be above the truth. Exits with 1 where anything of it
fails, naming the seed.
"""

from __future__ import annotations

import argparse
import sys
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ariac_score.checks.findings import Finding
from ariac_score.engine.measure import measure_trial
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.results.result import Measured
from ariac_score.scoring.pricing import price
from ariac_score.scoring.ruleset import rule_set_from_text
from ariac_score.trial.events import COMPETITION_ENDED, COMPETITION_STARTED, Event
from ariac_score.trial.model import Body, Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.spans import FloatArray, Span

STEP_S = 0.001
HUMAN_M_S, ROBOT_M_S = 1.6, 1.0

RULES = """
id: truth
title: Separation and contact, over simulated trials
source: benchmarks/truth.py
log_map: ariac2020
between_samples: {between}
bounds:
  human: {{max_speed_m_s: 1.6, source: the simulation}}
  robot: {{max_speed_m_s: 1.0, source: the simulation}}
  time_error_s: 0.001
monitors:
  separation:
    use: iso_ts_15066.ssm_separation
    with: {{profile: seed, t1_s: 0.2, t2_s: 0.3, delta_m: 0.5, max_gap_s: {gap}}}
  human_contact:
    use: ariac.human_contact
    with: {{distance: separation, contact_distance_m: 0.05, max_gap_s: {gap}}}
score: 20 * gate(human_contact) / (1 + 0.4 * demerits(separation, tau_s=5)) - seconds(separation) / 10
"""

RATES_HZ = (2.0, 5.0, 10.0, 25.0, 50.0, 100.0)
MODELS = ("steady", "jitter", "bursts", "drops", "killed")


# The world -------------------------------------------------------------------------------------


def walk(random: np.random.Generator, steps: int, fastest_m_s: float, start: FloatArray) -> FloatArray:
    """Positions of a body that walks, dashes, stops and turns, shape (steps, 3), m."""
    velocity, left = np.zeros((steps, 2)), 0
    heading, speed = random.uniform(0, 2 * np.pi), 0.0
    for step in range(steps):
        if left == 0:
            left = int(random.uniform(0.05, 1.2) / STEP_S)
            speed = fastest_m_s * random.choice([0.0, random.random(), 1.0])
            heading = random.choice([heading, heading + np.pi, random.uniform(0, 2 * np.pi)])
        velocity[step] = speed * np.cos(heading), speed * np.sin(heading)
        left -= 1
    places = start + np.concatenate([np.zeros((1, 2)), np.cumsum(velocity[:-1] * STEP_S, axis=0)])
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
        start = random.uniform(-1.5, 1.5, size=2)
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
    if model == "bursts":  # nothing for a while, then the newest alone
        silent = random.random(len(rows)) < 0.3
        rows = rows[~silent]
    if model in ("drops", "killed"):
        rows = rows[random.random(len(rows)) > 0.15]
    found = np.unique(np.clip(np.round(rows), 0, steps - 1).astype(int))
    return found if model != "killed" else found[found < steps * 0.8]


def recorded(random: np.random.Generator, trial: Trial, rate_hz: float, model: str) -> Trial:
    """The trial as a recorder has it."""
    signals = {}
    for name, signal in trial.signals.items():
        rows = kept_rows(random, len(signal), rate_hz, model)
        signals[name] = replace(signal, t=signal.t[rows], values=signal.values[rows])
    if model != "killed":
        return replace(trial, signals=signals)
    end_s = max((float(one.t[-1]) for one in signals.values() if len(one)), default=0.0)
    span = Span(0.0, max(end_s, STEP_S))
    return replace(trial, signals=signals, events=trial.events[:1], recorded=span)


def without_the_worst(trial: Trial, measured: Measured) -> Trial:
    """What an adversary leaves of a recording: nothing within 0.2 s of where the worst violation begins."""
    bad = [f for f in measured.findings.values() if f.robustness is not None and f.span is not None]
    if not bad:
        return trial
    worst = min(bad, key=lambda f: (f.robustness or 0.0, f.subject))
    at_s = worst.span.start_s if worst.span else 0.0
    signals = {
        name: replace(one, t=one.t[far], values=one.values[far])
        for name, one in trial.signals.items()
        if (far := np.abs(one.t - at_s) > 0.2).any()
    }
    return replace(trial, signals={**trial.signals, **signals})


# Scores ----------------------------------------------------------------------------------------


def rules(between: str, gap_s: float) -> Prepared:
    """The rules, prepared."""
    return prepare(rule_set_from_text(RULES.format(between=between, gap=gap_s), file="truth"))


def score_of(measured: Measured, prepared: Prepared, findings: Mapping[str, Finding]) -> float:
    """The score of some findings; NaN where it is withheld."""
    sheet, policies = prepared.rule_set.sheet, prepared.rule_set.policies
    priced = price(findings, measured.scopes, sheet, policies, digits=9, measures=measured.measures)
    return float("nan") if priced.ledger is None else float(priced.ledger.amount)


def ends_of(measured: Measured, prepared: Prepared) -> tuple[float, float]:
    """The scores of the worst and of the best world; the formula falls with every violation."""
    opened = {(one.check, one.subject) for one in measured.open}
    seen = {k: f for k, f in measured.findings.items() if (f.check, f.subject) not in opened}
    worlds = [dict(seen), dict(seen)]
    for one in measured.open:
        worlds[0] |= {f"{key}/{one.subject}": f for key, f in one.worst.items()}
        worlds[1] |= {f"{key}/{one.subject}": f for key, f in one.best.items()}
    worst, best = (score_of(measured, prepared, findings) for findings in worlds)
    return worst, best


@dataclass(frozen=True)
class Tried:
    """One simulated trial.

    Attributes:
        seed: By which it is made again.
        rate_hz: Of its recording.
        model: Of its recorder.
        true: Its score.
        least: Of its recording in the worst world.
        most: In the best world.
        robbed: The worst end once an adversary left samples out.
    """

    seed: int
    rate_hz: float
    model: str
    true: float
    least: float
    most: float
    robbed: float

    @property
    def holds(self) -> bool:
        """Whether the interval contains the truth, and the adversary gained nothing."""
        return (
            self.least <= self.true + 1e-6
            and self.true <= self.most + 1e-6
            and self.robbed <= self.true + 1e-6
        )


def tried(seed: int, seconds: float) -> Tried:
    """One trial, simulated, recorded and scored."""
    random = np.random.default_rng(seed)
    rate_hz, model = RATES_HZ[seed % len(RATES_HZ)], MODELS[(seed // len(RATES_HZ)) % len(MODELS)]
    truth = world(random, seconds)
    seen, bounded = rules("held", 0.05), rules("bounded", 0.05)
    whole = measure_trial(seen.derived(truth), seen)
    log = recorded(random, truth, rate_hz, model)
    measured = measure_trial(bounded.derived(log), bounded)
    robbed = without_the_worst(log, whole)
    again = measure_trial(bounded.derived(robbed), bounded)
    least, most = ends_of(measured, bounded)
    true = score_of(whole, seen, whole.findings)
    return Tried(seed, rate_hz, model, true, least, most, ends_of(again, bounded)[0])


def table(found: list[Tried]) -> str:
    """Trials, how many hold, and the mean width, by rate and recorder."""
    groups: dict[tuple[float, str], list[Tried]] = defaultdict(list)
    for one in found:
        groups[one.rate_hz, one.model].append(one)
    lines = ["| rate, Hz | " + " | ".join(MODELS) + " |", "|---:|" + "---:|" * len(MODELS)]
    for rate_hz in RATES_HZ:
        cells = []
        for model in MODELS:
            own = groups.get((rate_hz, model), [])
            width = float(np.mean([one.most - one.least for one in own])) if own else float("nan")
            cells.append(f"{width:.2f} ({sum(one.holds for one in own)} of {len(own)})" if own else "")
        lines.append(f"| {rate_hz:g} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Try many trials, print the table, and name the seeds that fail."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=8.0)
    parser.add_argument("--table", type=Path)
    given = parser.parse_args()
    found = []
    for seed in range(given.first, given.first + given.trials):
        found.append(tried(seed, given.seconds))
        if not found[-1].holds:
            print(f"does not hold: {found[-1]}", flush=True)
        if given.table and seed % 25 == 24:
            given.table.write_text(table(found), encoding="utf-8")
    print(table(found), end="")
    failed = [one.seed for one in found if not one.holds]
    print(f"{len(found)} trials, {len(failed)} fail{': ' + str(failed[:20]) if failed else ''}")
    if given.table:
        given.table.write_text(table(found), encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
