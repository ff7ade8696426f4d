"""How deep a violation is over time: measured by its monitor, stored with it, priced by the rule set.

A depth holds from its time until the next one, as a sample of a monitor stands until the next sample; so the
integral of a profile is the integral that the monitor measured.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ariac_score.trial.spans import FloatArray

__all__ = ["FILLED_S", "DepthProfile", "depth_profile", "joined_profiles"]

FILLED_S = 1.0
"""Valleys of a profile up to this long are filled, which changes no charge that lasts at least as long, s."""

_DECIMALS = 9
"""So many more than a score has; a billionth of a limit is finer than any sensor."""


@dataclass(frozen=True)
class DepthProfile:
    """Relative depth of one violation over time, in steps.

    Attributes:
        t_s: When each step begins, in time order, s of trial time; the last one is the end of the violation.
            A step of no length begins and ends at the same time.
        depth: Relative depth from each of them to the next, between 0 (kept) and 1 (nothing of the limit is
            left); the last is 0.

    >>> [*DepthProfile((1.0, 2.0, 4.0), (0.5, 0.25, 0.0)).steps()]
    [(1.0, 2.0, 0.5), (2.0, 4.0, 0.25)]
    """

    t_s: tuple[float, ...]
    depth: tuple[float, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "t_s", tuple(self.t_s))
        object.__setattr__(self, "depth", tuple(self.depth))
        if len(self.t_s) != len(self.depth) or len(self.t_s) < 2:
            raise ValueError("a profile of depth has as many depths as times, and at least two")
        if not all(map(math.isfinite, self.t_s)) or any(
            later < sooner for sooner, later in zip(self.t_s, self.t_s[1:], strict=False)
        ):
            raise ValueError("the times of a profile of depth are not in time order")
        if not all(0.0 <= depth <= 1.0 for depth in self.depth) or self.depth[-1] != 0.0:
            raise ValueError("the depths of a profile lie between 0 and 1, and the last of them is 0")

    def steps(self) -> Iterator[tuple[float, float, float]]:
        """Beginning, end and depth of each step that is not 0."""
        for begins_s, ends_s, depth in zip(self.t_s, self.t_s[1:], self.depth, strict=False):
            if depth > 0.0:
                yield begins_s, ends_s, depth

    def at(self, t_s: float) -> float:
        """The depth at a time; 0 before the violation and after it."""
        step = bisect_right(self.t_s, t_s) - 1
        return self.depth[step] if step >= 0 else 0.0


def depth_profile(t_s: FloatArray, lasts_s: FloatArray, depth: FloatArray) -> DepthProfile:
    """The profile of the violating samples of one violation, with its valleys filled.

    Args:
        t_s: When each sample was taken, shape (n,), n at least 1, s, increasing.
        lasts_s: How long each stands, shape (n,), s.
        depth: Relative depth of each, shape (n,), above 0 and up to 1.

    >>> t, lasts = np.array([0.0, 0.1, 0.2, 3.0]), np.array([0.1, 0.1, 0.1, 0.1])
    >>> found = depth_profile(t, lasts, np.array([0.5, 0.2, 0.5, 0.1]))
    >>> [round(t, 9) for t in found.t_s], found.depth
    ([0.0, 0.3, 3.0, 3.1], (0.5, 0.0, 0.1, 0.0))
    """
    # Rounding keeps the order of depths, and what is violated at all stays above 0.
    values = [min(1.0, max(round(float(one), _DECIMALS), 10.0**-_DECIMALS)) for one in depth]
    steps: list[tuple[float, float, float]] = []
    for begins_s, length_s, value in zip(t_s.tolist(), lasts_s.tolist(), values, strict=True):
        if steps and begins_s - steps[-1][1] > 1e-9:
            steps.append((steps[-1][1], begins_s, 0.0))
        elif steps and steps[-1][2] == value:  # samples of one depth are one step
            steps[-1] = (steps[-1][0], begins_s + length_s, value)
            continue
        steps.append((begins_s, begins_s + length_s, value))
    return _stepped(_filled(steps))


def joined_profiles(profiles: Sequence[DepthProfile]) -> DepthProfile:
    """One profile of several violations: the deepest of those that overlap, none in pauses between them."""
    ordered = sorted(profiles, key=lambda one: one.t_s)
    if any(one.t_s[-1] > other.t_s[0] for one, other in pairwise(ordered)):
        t_s = sorted({t for one in ordered for t in one.t_s})
        deepest = [max(one.at(t) for one in ordered) for t in t_s[:-1]]
        return _stepped(list(zip(t_s, t_s[1:], deepest, strict=False)))
    steps: list[tuple[float, float, float]] = []
    for profile in ordered:
        if steps and profile.t_s[0] > steps[-1][1]:
            steps.append((steps[-1][1], profile.t_s[0], 0.0))
        steps += zip(profile.t_s, profile.t_s[1:], profile.depth, strict=False)
    return _stepped(steps)


def _filled(steps: Sequence[tuple[float, float, float]]) -> list[tuple[float, float, float]]:
    """The steps with every valley of up to `FILLED_S` raised to the lower one of its two sides."""
    depth = np.array([one[2] for one in steps])
    raised = depth.copy()
    sides: list[int] = []
    """Steps to which nothing as deep has come yet; each is less deep than the one before, or as deep."""
    for here, (begins_s, _, value) in enumerate(steps):
        while sides:
            side = sides[-1]
            if begins_s - steps[side][1] <= FILLED_S:
                raised[side + 1 : here] = np.maximum(raised[side + 1 : here], min(value, depth[side]))
            if depth[side] > value:
                break
            sides.pop()
        sides.append(here)
    return [(one[0], one[1], float(value)) for one, value in zip(steps, raised, strict=True)]


def _stepped(steps: Sequence[tuple[float, float, float]]) -> DepthProfile:
    t_s: list[float] = []
    depth: list[float] = []
    for begins_s, _, value in steps:
        if not depth or value != depth[-1]:
            t_s.append(begins_s)
            depth.append(value)
    return DepthProfile((*t_s, max(steps[-1][1], t_s[-1])), (*depth, 0.0))
