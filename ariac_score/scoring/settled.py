"""The world that counts for a score, the interval around it, and what would narrow that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from math import inf, isfinite

from msgspec import UNSET, UnsetType
from msgspec.structs import replace as replaced

from ariac_score.checks.findings import Finding
from ariac_score.checks.open_findings import by_source
from ariac_score.errors import FormulaError
from ariac_score.scoring.bounds import MOST_TRIED, Bound, Pins, Worlds
from ariac_score.scoring.expression import Number, Traced
from ariac_score.scoring.interval import Narrowing, ScoreInterval
from ariac_score.scoring.ledger import rounded
from ariac_score.scoring.scope import Scope

__all__ = ["Settled", "ends_around", "interval_around", "interval_of", "settle"]

MOST_CAUSES = 40
"""Of more causes nobody asks how much each is worth."""
MOST_TRIED_FOR_CAUSES = 1024
"""Evaluations that all of them together may take: what then is left has no number, rather than minutes."""
_CLOSE = 1e-9
"""Bounds are added up in another order than scores; what differs by so little is the same."""


@dataclass(frozen=True)
class Settled:
    """A formula in the world that counts, and how far other worlds are from it.

    Attributes:
        worlds: The formula in all worlds.
        findings: Those of the world that counts.
        trial: Its scopes, outermost.
        traced: The formula there.
        pins: Where each thing that is open is there; `True`: at its worst.
        least: The least that the formula can be.
        most: The most.
        at_least: The value in the world of that end; `None` where that has none.
        at_most: Likewise.
        counts_least: Whether the least is what counts.
    """

    worlds: Worlds
    findings: Mapping[str, Finding]
    trial: Scope
    traced: Traced
    pins: Mapping[str, bool]
    least: Bound
    most: Bound
    at_least: Number | None
    at_most: Number | None
    counts_least: bool

    @property
    def is_bounded(self) -> bool:
        """Whether both ends are numbers."""
        return isfinite(self.least.value) and isfinite(self.most.value)

    @property
    def unbounded(self) -> str:
        """What nothing bounds, in words."""
        return next(
            iter(self.worlds.unbounded),
            "the formula of the score has no value in some of the possible worlds",
        )

    @property
    def value(self) -> Number:
        """The number that counts."""
        end, at = (self.least, self.at_least) if self.counts_least else (self.most, self.at_most)
        return at if at is not None and _are_close(at, end.value) else end.value

    def ends(self, digits: int) -> tuple[Decimal, Decimal]:
        """Least and most with so many digits."""
        return (
            _rounded_end(self.least.value, self.at_least, digits, ROUND_FLOOR),
            _rounded_end(self.most.value, self.at_most, digits, ROUND_CEILING),
        )

    def amount(self, digits: int) -> Decimal:
        """The score."""
        return self.ends(digits)[0 if self.counts_least else 1]


def _rounded_end(bound: float, attained: Number | None, digits: int, outward: str) -> Decimal:
    """An end: rounded as a score where a world has it, else so that it stays a bound."""
    if attained is not None and _are_close(attained, bound):
        return rounded(attained, digits)
    return Decimal(repr(float(bound))).quantize(Decimal(1).scaleb(-digits), rounding=outward) + Decimal(0)


def ends_around(settled: Settled, wider: Worlds, digits: int) -> tuple[Decimal, Decimal] | None:
    """The ends of a formula where more is open than in what was settled.

    Args:
        settled: The formula with less open; an end that stays is rounded as it is there.
        wider: The formula with more open.
        digits: Decimal digits.

    Returns:
        Least and most; `None` where one of them is infinite.
    """
    if not settled.is_bounded:
        return None
    found = []
    for least, end, own, rounding in zip(
        (True, False),
        (settled.least, settled.most),
        settled.ends(digits),
        (ROUND_FLOOR, ROUND_CEILING),
        strict=True,
    ):
        value = wider.end(least=least).value
        if not isfinite(value):
            return None
        found.append(own if _are_close(value, end.value) else _rounded_end(value, None, digits, rounding))
    return found[0], found[1]


def _are_close(one: float, other: float) -> bool:
    return abs(one - other) <= _CLOSE * (1 + abs(other))


def settle(worlds: Worlds, *, counts: str) -> Settled:
    """Find the ends of a formula, and the world that counts.

    Args:
        worlds: The formula in all worlds.
        counts: `worst`, `best` or `withhold`.

    Raises:
        FormulaError: It has no value, whatever is open.
    """
    if not worlds.variables:
        traced = _evaluated(worlds, worlds.findings, {})
        end = Bound(float(traced.value), {}, True)
        return Settled(
            worlds, worlds.findings, worlds.trial, traced, {}, end, end, traced.value, traced.value, True
        )
    least, most = worlds.end(least=True), worlds.end(least=False)
    counts_least = counts != "best"
    traced = Traced("", 0, "number")
    nowhere = Settled(
        worlds, worlds.findings, worlds.trial, traced, {}, least, most, None, None, counts_least
    )
    if not nowhere.is_bounded:
        return nowhere
    low, high = worlds.world(least.pins, worst=True), worlds.world(most.pins, worst=False)
    try:
        at_least, at_most = _evaluated(worlds, low, least.pins), _evaluated(worlds, high, most.pins)
    except FormulaError as error:
        worlds.unbounded[error.cause] = None
        return replace(nowhere, least=replace(least, value=-inf))
    pins = (least if counts_least else most).pins
    return Settled(
        worlds,
        low if counts_least else high,
        worlds.trial_in(pins),
        at_least if counts_least else at_most,
        pins,
        least,
        most,
        at_least.value,
        at_most.value,
        counts_least,
    )


def _evaluated(worlds: Worlds, findings: Mapping[str, Finding], pins: Pins) -> Traced:
    sheet = worlds.sheet
    return sheet.value_of(worlds.formula, worlds.trial_in(pins), findings, worlds.cohort_in(pins))


def interval_of(settled: Settled, digits: int, counts: str) -> ScoreInterval | None:
    """The interval of a score; `None` where both ends are the same number.

    Args:
        settled: With both ends bounded.
        digits: Decimal digits of the score.
        counts: Which end is the score.
    """
    if not settled.is_bounded:
        return None
    least, most = settled.ends(digits)
    if least == most:
        return None
    tight, narrowing = _is_tight(settled), _narrowing(settled, digits)
    return ScoreInterval(least, most, tight, counts, narrowing, _unseen(settled, digits))


def interval_around(
    known: ScoreInterval | None,
    ends: tuple[Decimal, Decimal],
    own: tuple[Decimal, Decimal],
    counts: str,
    why: str,
) -> ScoreInterval | None:
    """The interval of a score that more leaves open than its own log; `None` where it is one number.

    Args:
        known: What its own log leaves open.
        ends: Of all that is open.
        own: Of what its own log leaves open.
        counts: Which end is the score then.
        why: What leaves it open beyond them.
    """
    if ends == own or ends[0] == ends[1]:
        return known
    # As bad as can be, it leaves nothing for all else to decide.
    cause = Narrowing(why, (), (), ends[1] - ends[0])
    if known is None:
        return ScoreInterval(*ends, tight=False, counts=counts, narrowing=(cause,))
    narrowing = (cause, *known.narrowing)
    return replaced(known, least=ends[0], most=ends[1], tight=False, counts=counts, narrowing=narrowing)


def _unseen(settled: Settled, digits: int) -> Decimal | UnsetType:
    """By how much a score is lower for what monitors did not see; nothing where that is not known."""
    worlds, found = settled.worlds, dict(settled.findings)
    if not settled.counts_least:
        return UNSET
    for one in worlds.variables:
        if not one.is_verdict:
            for key in (*one.best, *one.worst):
                found.pop(key, None)
            found |= {key: worlds.findings[key] for key in one.seen}
    try:
        samples = rounded(_evaluated(worlds, found, {}).value, digits)
    except FormulaError:
        return UNSET
    unseen = samples - settled.amount(digits)
    return unseen if unseen > 0 else UNSET


def _is_tight(settled: Settled) -> bool:
    """Whether a world that the log allows has each end, as far as is known."""
    variables = settled.worlds.variables
    for end, at in ((settled.least, settled.at_least), (settled.most, settled.at_most)):
        moved = [one for one in variables if one.key in end.pins or _inner(one.key, end.pins)]
        sides = {end.pins.get(one.key) for one in moved}
        # Verdicts that have to be wrong and right at once may exclude each other, and so may several about
        # one item: what lies in one slot lies in no other, and a simulator that stops judges none.
        items = [one.subject.partition("/")[0] for one in moved if one.is_verdict]
        if len(sides) > 1 or len({*items}) < len(items) or not all(one.tight for one in moved):
            return False
        if not end.is_reached or at is None or not _are_close(at, end.value):
            return False
    return True


def _inner(key: str, pins: Mapping[str, bool]) -> list[str]:
    return [name for name in pins if name.startswith(f"{key}#")]


def _narrowing(settled: Settled, digits: int) -> tuple[Narrowing, ...]:
    """What would narrow the interval, most first."""
    width = settled.most.value - settled.least.value
    variables, budget = settled.worlds.variables, MOST_TRIED_FOR_CAUSES
    matter = []
    for one in variables if len(variables) <= MOST_CAUSES else ():
        matters, tried = _matters(settled, one.key, _CLOSE * (1 + width), budget)
        matter += [one] if matters else []
        budget -= tried
    matter = matter or [*variables]
    causes = by_source([one.causes if one in matter else () for one in variables])
    least, most = settled.ends(digits)
    found = []
    budget = budget if len(causes) <= MOST_CAUSES else 0
    for cause, numbers in causes.items():
        among = [settled.worlds.variables[number] for number in numbers]
        by, widths = None, []
        for worst in (True, False):
            decided, tried = _width(settled, [one.key for one in among], worst=worst, most_tried=budget)
            budget -= tried
            widths.append(decided)
        if budget > 0:
            by = max(0.0, width - min(widths))
        if by is None or by > _CLOSE * (1 + width):
            found.append(
                Narrowing(
                    cause,
                    tuple(sorted({one.check for one in among if not one.is_input})),
                    tuple(dict.fromkeys(key for one in among for key in one.seen)),
                    None if by is None else min(most - least, _rounded_end(by, None, digits, ROUND_CEILING)),
                )
            )
    # Of those that are worth the same, the first of its variable first: an unknown end before the gaps.
    return tuple(sorted(found, key=lambda one: -(one.at_most or Decimal(0))))


def _matters(settled: Settled, key: str, more_than: float, most_tried: int) -> tuple[bool, int]:
    """Whether the score is open for this alone, all else at its worst or its best; and how much that took."""
    others = [one.key for one in settled.worlds.variables if one.key != key]
    at_worst, tried = _width(settled, others, worst=True, most_tried=most_tried)
    at_best, more = _width(settled, others, worst=False, most_tried=most_tried - tried)
    return max(at_worst, at_best) > more_than, tried + more


def _width(settled: Settled, keys: list[str], *, worst: bool, most_tried: int) -> tuple[float, int]:
    """How long the interval is where some of what is open is decided, and how many evaluations that took."""
    both = {**settled.least.pins, **settled.most.pins}
    pins = {name: worst for name in both if name.partition("#")[0] in keys}
    pins.update(dict.fromkeys(keys, worst))
    ends, tried = [], 0
    for least in (False, True):
        may = min(MOST_TRIED, most_tried - tried)
        if may <= 0:
            return inf, tried
        ends.append(settled.worlds.end(least=least, pins=pins, most_tried=may).value)
        tried += settled.worlds.tried
    return ends[0] - ends[1], tried
