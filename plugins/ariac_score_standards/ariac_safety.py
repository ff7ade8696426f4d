"""Safety rules that ARIAC itself has: collisions cost the whole score."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ariac_score import Finding, SignalNeed, Span, Trial, Verdict
from ariac_score_standards.severity import episodes_below
from ariac_score_standards.watching import Watched, watch_pairs

_CONTACT_CLAUSE = "ARIAC 2022 scoring, robot-human collision"


@dataclass(frozen=True)
class HumanContact:
    """No robot touches a human.

    Measures:
        For every robot and human the distance less `contact_distance_m`, in m. With
        `separation` (surface to surface) contact is 0 m; where a log has only the
        distance between centres, the two bodies' extent must be allowed for.
    Violated when:
        The distance is at or below `contact_distance_m`. Every such episode is a
        critical event.
    Source:
        ARIAC 2020-2022, documented scoring: a collision with a human zeroes the
        trial; the simulator never checked it. The distance that stands for contact
        between centres is our choice.
    """

    distance: Literal["centre_distance", "centre_distance_2d", "separation"] = "separation"
    contact_distance_m: float = 0.0
    max_gap_s: float = 0.05
    t_off_s: float = 1.0

    def __post_init__(self) -> None:
        for name in ("contact_distance_m", "t_off_s"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"{name} is {getattr(self, name):g} but cannot be negative")
        if not self.max_gap_s > 0:
            raise ValueError(f"max_gap_s is {self.max_gap_s:g} but must be positive")

    def needs(self) -> Iterator[SignalNeed]:
        """The distance between the two."""
        yield SignalNeed(self.distance, "m", self.max_gap_s)

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """Findings for every pair: its contacts, or its closest moment."""
        wanted = {f"{self.distance}/{{robot}}/{{human}}": "m"}
        return watch_pairs(trial, wanted, max_gap_s=self.max_gap_s, clause=_CONTACT_CLAUSE, judge=self._judge)

    def _judge(self, subject: str, watched: Watched) -> Iterator[Finding]:
        (distance_m,) = watched.columns.values()
        # Contact is at the limit too, so the limit itself must count as below it.
        beyond = np.nextafter(self.contact_distance_m, np.inf)
        margin_m = distance_m - beyond
        required_m = np.full_like(distance_m, beyond)
        episodes = episodes_below(watched, margin_m, required_m, t_on_s=0.0, t_off_s=self.t_off_s)
        for episode in episodes:
            worst = episode.worst
            yield Finding(
                subject,
                Verdict.VIOLATED,
                f"contact: {distance_m[worst]:.3f} m at {watched.t[worst]:.3f} s",
                span=episode.span,
                robustness=float(distance_m[worst] - self.contact_distance_m),
                unit="m",
                quantities=episode.quantities,
                evidence=watched.samples(worst),
                clause=_CONTACT_CLAUSE,
                critical=True,
            )
        if not episodes and not watched.gaps:
            closest = int(np.argmin(distance_m))
            yield Finding(
                subject,
                Verdict.SATISFIED,
                f"never nearer than {distance_m[closest]:.3f} m, at {watched.t[closest]:.3f} s",
                robustness=float(distance_m[closest] - self.contact_distance_m),
                unit="m",
                evidence=watched.samples(closest),
                clause=_CONTACT_CLAUSE,
            )


@dataclass(frozen=True)
class NoEvent:
    """Something that a log would have recorded did not happen.

    Measures:
        The events of one kind, such as `arm_collision` or `part_dropped`.
    Violated when:
        The log holds such an event; each is one violation. A log that would not have
        recorded the kind is inconclusive, not clean.
    Source:
        ARIAC 2019-2022, scoring: arm collisions zero the trial; 2021-2022: every
        dropped product costs a point.
    """

    kind: str = "arm_collision"
    critical: bool = False

    def needs(self) -> Iterator[SignalNeed]:
        """No signal: events come with every log."""
        return iter(())

    def watch(self, trial: Trial) -> Iterator[Finding]:
        """One finding for each event, or one that there was none."""
        name = self.kind.replace("_", " ")
        events = trial.events_of(self.kind)
        for event in events:
            yield Finding(
                event.subject or "trial",
                Verdict.VIOLATED,
                f"{name} at {event.t_s:.3f} s{': ' if event.detail else ''}{event.detail}",
                span=Span(event.t_s, event.t_s),
                critical=self.critical,
                clause="ARIAC scoring",
            )
        if not events and self.kind in trial.witnessed:
            yield Finding.satisfied("trial", f"the log records no {name}", clause="ARIAC scoring")
        elif not events:
            yield Finding.inconclusive(
                "trial", f"the log does not show whether there was any {name}", clause="ARIAC scoring"
            )
