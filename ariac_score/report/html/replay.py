"""What a page replays of a trial: its moments, the margin over time, and which distances are to be kept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.report.html.scale import Scale
from ariac_score.report.html.work import worth_of
from ariac_score.results.result import Result
from ariac_score.results.sketch import DrawnChart, Sketch
from ariac_score.scoring.ledger import taken_by
from ariac_score.scoring.scope import Scope

__all__ = ["Margin", "Moment", "Replay", "Strip", "WorkState", "replay_of"]

MOST_MOMENTS = 60
MOST_ZONES = 12
HEIGHT = 1000
"""Height of the drawing of the margin in user units; in width a unit is 1 ms."""
_LONGEST_PLAY_S = 45.0
_SPEEDS = (1, 2, 5, 10, 30, 60, 120, 300, 600, 1800, 3600)


@dataclass(frozen=True)
class Moment:
    """Something that happened at a known time.

    Attributes:
        kind: `violated` or `handed_in`.
        t_s: When, s; of a violation its worst sample.
        start_s: When it began, s.
        end_s: When it was over, s.
        at: Percent of the axis.
        subject: Whom or what it is about, as in the finding.
        words: What happened.
        amount: What it took, or what the item earned; `None` where the ledger has no such line.
        finding: Id of its finding; empty where it is none.
        is_worst: Whether it is the violation that cost most.
    """

    kind: str
    t_s: float
    start_s: float
    end_s: float
    at: float
    subject: str
    words: str
    amount: Decimal | None
    finding: str = ""
    is_worst: bool = False


@dataclass(frozen=True)
class Margin:
    """The margin of the worst curve, in a box as wide as the axis in ms and `HEIGHT` high, y downwards.

    Attributes:
        curve: The curve.
        line: Path of the margin.
        zero: Where a margin of 0 lies, in user units.
        least: The least margin, in the curve's unit.
        least_s: When, s.
    """

    curve: DrawnChart
    line: str
    zero: int
    least: float
    least_s: float


@dataclass(frozen=True)
class Strip:
    """Two bodies and their distance, for logs that record no positions; at its worst moment.

    Attributes:
        first: One of them.
        second: The other.
        farthest: The largest distance, in m, which fills the width.
        distance: In m, at its worst.
        required: In m, at that time.
        t_s: When that was, s.
    """

    first: str
    second: str
    farthest: float
    distance: float
    required: float
    t_s: float


@dataclass(frozen=True)
class WorkState:
    """An outermost item of work: its path, and when it was announced and handed in, where that is known."""

    path: str
    announced_s: float | None
    handed_in_s: tuple[float, ...]


@dataclass(frozen=True)
class Replay:
    """What is replayed.

    Attributes:
        axis: The times.
        moments: In order of time; where there are very many those that cost most.
        omitted: How many violations are left out.
        margin: Of the worst curve; `None` where no distance or speed has a limit.
        zones: Places in the sketch of the curves that are distances to be kept, the worst first.
        strip: Instead of a plan; `None` where there is one, or no distance either.
        work: The outermost items.
        speed: How many times faster it is played at first, so that it takes less than a minute.
        speeds: Those to choose from.
    """

    axis: Scale
    moments: tuple[Moment, ...]
    omitted: int
    margin: Margin | None
    zones: tuple[int, ...]
    strip: Strip | None
    work: tuple[WorkState, ...]
    speed: int
    speeds: tuple[int, ...]

    @property
    def listed(self) -> Decimal:
        """What the amounts of the moments come to; less or more than the score where others have no time."""
        return sum((one.amount for one in self.moments if one.amount is not None), Decimal(0))


def replay_of(result: Result, axis: Scale | None) -> Replay | None:
    """The replay of a trial; `None` where the log shows neither a position nor a distance over time."""
    sketch = result.measured.sketch
    if sketch is None or axis is None:
        return None
    zones = _zones(sketch, result.measured.findings)
    if not sketch.routes and not zones:
        return None
    moments, omitted = _moments(result, axis)
    worst = _worst_curve(sketch, result.measured.findings)
    duration_s = axis.end - axis.start
    speed = next((s for s in _SPEEDS if duration_s / s <= _LONGEST_PLAY_S), _SPEEDS[-1])
    return Replay(
        axis,
        tuple(moments),
        omitted,
        _margin(worst, axis) if worst else None,
        tuple(zones[:MOST_ZONES]),
        None if sketch.routes else _strip(sketch.curves[zones[0]]),
        tuple(_work(result)),
        speed,
        tuple(sorted({1, *(s for s in _SPEEDS if speed / 10 <= s <= speed * 10)})),
    )


def _moments(result: Result, axis: Scale) -> tuple[list[Moment], int]:
    violated = list(_violated(result, axis))
    dearest = sorted(violated, key=lambda m: (m.amount or Decimal(0), m.t_s, m.finding))
    dearest[:1] = [replace(worst, is_worst=True) for worst in dearest[:1]]
    kept = dearest[:MOST_MOMENTS] + list(_handed_in(result, axis))[:MOST_MOMENTS]
    return sorted(kept, key=lambda m: (m.start_s, m.kind, m.finding)), max(len(violated) - MOST_MOMENTS, 0)


def _violated(result: Result, axis: Scale) -> Iterator[Moment]:
    taken = taken_by(result.ledger)
    for key, finding in result.measured.findings.items():
        if finding.verdict is Verdict.VIOLATED and finding.span is not None:
            at_s = finding.evidence[0].t_s if finding.evidence else finding.span.start_s
            at_s = min(max(at_s, finding.span.start_s), finding.span.end_s)
            amount = taken[key].amount if key in taken else None
            yield Moment(
                "violated",
                at_s,
                finding.span.start_s,
                finding.span.end_s,
                axis.at(at_s),
                finding.subject,
                finding.message,
                amount,
                key,
            )


def _handed_in(result: Result, axis: Scale) -> Iterator[Moment]:
    paths = {scope.path.rpartition("/")[2]: scope.path for scope in result.measured.scopes.walk()}
    worth = worth_of(result)
    sketch = result.measured.sketch
    for one in sketch.brought if sketch else ():
        path, t_s = paths.get(one.item, one.item), one.submitted_s
        earned = worth[path].earned if path in worth else None
        yield Moment("handed_in", t_s, t_s, t_s, axis.at(t_s), path, one.words, earned)


def _zones(sketch: Sketch, findings: Mapping[str, Finding]) -> list[int]:
    """The distances in m that a check requires two bodies to keep, one for each pair: its worst."""
    margins = _margins(findings)
    places = [
        place
        for place, curve in enumerate(sketch.curves)
        if curve.check and curve.unit == "m" and not curve.at_most and curve.subject.count("/") == 1
        if any(limit is not None for limit in curve.limit)
    ]
    places.sort(key=lambda p: (margins.get(_key(sketch.curves[p]), float("inf")), p))
    pairs: dict[str, int] = {}
    for place in places:
        pairs.setdefault(sketch.curves[place].subject, place)
    return list(pairs.values())


def _margins(findings: Mapping[str, Finding]) -> dict[tuple[str, str], float]:
    margins: dict[tuple[str, str], float] = {}
    for finding in findings.values():
        if finding.robustness is not None:
            key = finding.check, finding.subject
            margins[key] = min(finding.robustness, margins.get(key, finding.robustness))
    return margins


def _key(curve: DrawnChart) -> tuple[str, str]:
    return curve.check, curve.subject


def _worst_curve(sketch: Sketch, findings: Mapping[str, Finding]) -> DrawnChart | None:
    margins = _margins(findings)
    limited = [c for c in sketch.curves if len(c.t_s) > 1 and any(v is not None for v in c.limit)]
    return min(limited, key=lambda c: (margins.get(_key(c), float("inf")), c.subject, c.check), default=None)


def _margin(curve: DrawnChart, axis: Scale) -> Margin:
    sign = -1.0 if curve.at_most else 1.0
    margins = [
        None if limit is None else sign * (actual - limit)
        for actual, limit in zip(curve.actual, curve.limit, strict=True)
    ]
    known = [m for m in margins if m is not None]
    low, high = min(*known, 0.0) if known else 0.0, max(*known, 0.0) if known else 0.0
    room = (high - low) or 1.0
    holes = frozenset(curve.holes_s)
    pieces: list[str] = []
    drawing = False
    for t_s, margin in zip(curve.t_s, margins, strict=True):
        if margin is not None:
            x, y = round((t_s - axis.start) * 1000), round((high - margin) / room * HEIGHT)
            pieces.append(f"{'L' if drawing else 'M'}{x} {y}")
        drawing = margin is not None and t_s not in holes
    least = min(range(len(margins)), key=lambda i: float("inf") if margins[i] is None else margins[i] or 0.0)
    return Margin(
        curve, "".join(pieces), round(high / room * HEIGHT), margins[least] or 0.0, curve.t_s[least]
    )


def _strip(curve: DrawnChart) -> Strip:
    rows = [i for i, limit in enumerate(curve.limit) if limit is not None]
    worst = min(rows, key=lambda i: curve.actual[i] - (curve.limit[i] or 0.0))
    first, _, second = curve.subject.partition("/")
    farthest = max(*curve.actual, *(limit for limit in curve.limit if limit is not None), 1e-6)
    return Strip(first, second, farthest, curve.actual[worst], curve.limit[worst] or 0.0, curve.t_s[worst])


def _work(result: Result) -> Iterator[WorkState]:
    sketch = result.measured.sketch
    brought = sketch.brought if sketch else ()
    for item in result.measured.scopes.inner:
        names = {path.rpartition("/")[2] for path in _paths(item)}
        handed = tuple(sorted(one.submitted_s for one in brought if one.item in names))
        yield WorkState(item.path, result.measured.orders.get(item.path), handed)


def _paths(item: Scope) -> Sequence[str]:
    return [scope.path for scope in item.walk()]
