"""What a log map makes of a recording: bodies, signals, rates, motion."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import words_of
from ariac_score.engine.read import competition_of
from ariac_score.trial.channels import LogMap
from ariac_score.trial.derive import Derivation, derive_signals
from ariac_score.trial.model import Trial
from ariac_score.trial.signals import Signal
from ariac_score.trial.words import HANDED_IN

__all__ = ["bodies_shown", "rate_of"]

_ACROSS_S = 1.0
"""Speeds and distances are shown across gaps up to this, s; a monitor may accept less."""


def rate_of(signal: Signal) -> str:
    """How often, from when to when, with the longest gap."""
    if len(signal) < 2:
        return f"{len(signal)} sample"
    t = signal.t
    rate = (len(t) - 1) / float(t[-1] - t[0])
    gap_s = float(np.diff(t).max())
    return f"{rate:.1f} Hz from {t[0]:.3f} s to {t[-1]:.3f} s, longest gap {gap_s:.3f} s"


def bodies_shown(trial: Trial, log_map: LogMap, registry: Registry) -> Iterator[str]:
    """The bodies and signals of a trial, what was to be done in it, and what its log lacks.

    Args:
        trial: As read with every quantity.
        log_map: By which it was read.
        registry: The installed plugins.
    """
    for body in trial.bodies:
        yield f"{body.kind} {body.id}" + (f", {len(body.links)} links" if body.links else "")
    for name, signal in trial.signals.items():
        if "::" not in name:
            yield f"  {name}: {rate_of(signal)}, from {signal.source}"
    yield from _motion(trial)
    words = words_of(competition_of(log_map, registry))
    if trial.work:
        yield f"{words.many(words.outermost)}: {', '.join(item.id for item in trial.work)}"
    if trial.submissions:
        yield f"{words.many(HANDED_IN)}: {len(trial.submissions)}"
    if trial.window is not None:
        yield f"watched from {trial.window.start_s:.3f} s to {trial.window.end_s:.3f} s"
    yield from (f"times: {clock}" for clock in trial.clocks)
    yield from (f"not recorded: {named}" for named in trial.unrecorded)
    yield from (f"note: {d.where}: {d.message} ({d.count})" for d in trial.log_defects)


def _motion(trial: Trial) -> Iterator[str]:
    """How fast bodies are, and how near they come to each other."""
    wanted = ("speed", "centre_distance")
    derived = derive_signals(trial, [Derivation(quantity, _ACROSS_S) for quantity in wanted])
    for name, signal in derived.signals.items():
        quantity, _, subject = name.partition("/")
        if not len(signal) or "::" in name:
            continue
        if quantity == "speed":
            yield f"  {subject} is at most {float(signal.values.max()):.2f} m/s fast"
        elif quantity == "centre_distance":
            at = int(signal.values.argmin())
            apart = f"{float(signal.values[at]):.2f} m apart, at {signal.t[at]:.3f} s"
            yield f"  {' and '.join(subject.split('/'))} are at least {apart}"
