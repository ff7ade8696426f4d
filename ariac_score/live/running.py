"""What is known of a trial while it goes on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from decimal import Decimal

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.results.result import Result

__all__ = ["Instant", "Margin", "Note", "Place", "Running", "margins_of", "status_text"]


@dataclass(frozen=True)
class Note:
    """Something that whoever watches should know, said once.

    Attributes:
        at_s: When, s since the first message; 0 before it.
        kind: `lost`, `disconnected`, `reconnected`, `clock`, `type` or `log`.
        text: In words.
    """

    at_s: float
    kind: str
    text: str


@dataclass(frozen=True)
class Margin:
    """How far something is from its limit.

    Attributes:
        check: By its name in the rule set.
        subject: Whom it is about.
        value: Negative: violated.
        unit: Of the value.
        message: What the check says of it.
    """

    check: str
    subject: str
    value: float
    unit: str
    message: str


@dataclass(frozen=True)
class Instant:
    """What a monitor measured at this moment, and its limit.

    Attributes:
        check: By its name in the rule set.
        subject: Whom it is about.
        what: The quantity, such as `distance`.
        at_s: When, s since the first message.
        actual: Its value.
        limit: Its limit.
        unit: Of both.
        at_most: Whether the limit is an upper one.
    """

    check: str
    subject: str
    what: str
    at_s: float
    actual: float
    limit: float
    unit: str
    at_most: bool = False

    @property
    def margin(self) -> float:
        """How far it is from its limit; negative: violated."""
        return self.limit - self.actual if self.at_most else self.actual - self.limit


@dataclass(frozen=True)
class Place:
    """Where a body is.

    Attributes:
        body: Its id; of a link `model::link`.
        kind: Such as `robot` or `human`.
        x_m: m.
        y_m: m.
    """

    body: str
    kind: str
    x_m: float
    y_m: float


@dataclass(frozen=True)
class Running:
    """The state of a trial at an instant.

    Attributes:
        source: Its address.
        elapsed_s: From the first to the latest message, s.
        messages: How many have come.
        connected: Whether the source is there.
        result: The trial so far, scored as a recording that goes no further: what is still to come is open,
            so its interval lies between all that can still be lost and gained. `None` while there is nothing
            to score; of rules that compare teams its `task`, for their cohort is not there yet.
        so_far: The same as if nothing more came, neither good nor bad.
        judged_until_s: Up to when the result goes, s since the first message.
        open: Why there is no result yet, in words; empty where there is one.
        notes: What was lost, and what else was noticed, in order of time.
        ended: Why nothing comes any more; empty while the trial goes on.
        now: The margins of this moment, from the last second alone; they are ahead of the result.
        places: Where bodies are at this moment, as far as the log shows positions.
        sees_losses: Whether the source can see every loss of a message.
        monitors: The checks that watch how things were done, by name: their margins are shown.
    """

    source: str
    elapsed_s: float = 0.0
    messages: int = 0
    connected: bool = True
    result: Result | None = None
    so_far: Result | None = None
    judged_until_s: float = 0.0
    open: str = "no message yet"
    notes: tuple[Note, ...] = ()
    ended: str = ""
    now: tuple[Instant, ...] = ()
    places: tuple[Place, ...] = ()
    sees_losses: bool = True
    monitors: frozenset[str] = frozenset()

    @property
    def interval(self) -> tuple[Decimal, Decimal] | None:
        """The worst and the best score that are still possible; `None` while nothing says."""
        result = self.result
        if result is None:
            return None
        if result.interval is not None:
            return result.interval.least, result.interval.most
        return None if result.score is None else (result.score, result.score)

    @property
    def worst_margin(self) -> Margin | None:
        """The least margin of a monitor; `None` while none has one."""
        own = (margin for margin in margins_of(self.result) if margin.check in self.monitors)
        return min(own, key=lambda margin: margin.value, default=None)

    @property
    def undecided(self) -> tuple[str, ...]:
        """The checks that cannot say everything yet."""
        if self.result is None:
            return ()
        found = self.result.measured.findings
        open_ = {_check_of(name) for name, one in found.items() if one.verdict is Verdict.INCONCLUSIVE}
        return tuple(sorted(open_ | {one.check for one in self.result.measured.open}))


def margins_of(result: Result | None) -> Iterator[Margin]:
    """The margins of all findings of a result that have one."""
    for name, finding in {} if result is None else result.measured.findings.items():
        if finding.robustness is not None and finding.verdict is not Verdict.INCONCLUSIVE:
            yield _margin(name, finding)


def _margin(name: str, finding: Finding) -> Margin:
    assert finding.robustness is not None
    return Margin(_check_of(name), finding.subject, finding.robustness, finding.unit, finding.message)


def _check_of(finding: str) -> str:
    return finding.partition("#")[0]


def status_text(running: Running) -> str:
    """The state in one line.

    >>> status_text(Running("replay:trial.mcap"))
    '0:00  score open: no message yet'
    """
    minutes, seconds = divmod(int(running.elapsed_s), 60)
    parts = [f"{minutes}:{seconds:02}"]
    if not running.connected:
        parts.append("SOURCE GONE")
    interval = running.interval
    if interval is None:
        parts.append(f"score open: {running.open or _withheld(running.result)}")
    elif interval[0] == interval[1]:
        parts.append(f"score {interval[0]:f}")
    else:
        parts.append(f"score {interval[0]:f} to {interval[1]:f}")
    margin = running.worst_margin
    if margin is not None:
        verb = "violated" if margin.value < 0 else "worst margin"
        parts.append(f"{verb} {margin.value:+.3g} {margin.unit} ({margin.check} of {margin.subject})")
    if running.now:
        nearest = min(running.now, key=lambda one: one.margin)
        parts.append(f"now {nearest.margin:+.3g} {nearest.unit}")
    if running.undecided:
        shown = ", ".join(running.undecided[:3]) + (", …" if len(running.undecided) > 3 else "")
        parts.append(f"open: {shown}")
    lost = sum(note.kind in ("lost", "disconnected") for note in running.notes)
    if lost:
        parts.append(f"{lost} gap{'s' if lost > 1 else ''}")
    return "  ".join(parts)


def _withheld(result: Result | None) -> str:
    if result is None:
        return ""
    if result.task is not None:
        return f"task {result.task.amount:f}; the score needs all teams"
    return result.missing or result.status
