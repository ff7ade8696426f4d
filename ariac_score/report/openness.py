"""Scores that a log leaves open, in words: their ends, which end counts, what would narrow them."""

from __future__ import annotations

import re
from collections.abc import Callable

from msgspec import UnsetType

from ariac_score.checks.open_findings import by_source, stood_for
from ariac_score.report.figures import amount_text
from ariac_score.results.adjustments import interval_that_counts
from ariac_score.results.doubt import undecided_text
from ariac_score.results.result import Result
from ariac_score.scoring.interval import Narrowing, ScoreInterval
from ariac_score.scoring.ledger import taken_by

__all__ = [
    "adjusted_sentence",
    "between",
    "bounds_text",
    "is_at_worst",
    "narrowing_text",
    "open_sentence",
    "stand_in_text",
    "undecided_text",
    "which_counts",
    "would_narrow",
]

_MAX_SPEED = re.compile(r"bounds\..+\.max_speed_m_s")
_MAX_ACCELERATION = re.compile(r"bounds\..+\.max_acceleration_m_s2")

_COUNTS = {
    "worst": "the lower end counts",
    "best": "the upper end counts",
    "withhold": "neither counts until that is decided",
    "known": "what is known counts, for a lost log costs nobody",
}


def between(interval: ScoreInterval) -> str:
    """Both ends of an interval, exactly: rounded ones might lie within it.

    >>> from decimal import Decimal
    >>> between(ScoreInterval(Decimal("19.761677"), Decimal("28.000000"), True, "worst"))
    'between 19.761677 and 28'
    """
    return f"between {amount_text(interval.least)} and {amount_text(interval.most)}"


def which_counts(interval: ScoreInterval) -> str:
    """Which end is the score."""
    return _COUNTS[interval.counts]


def open_sentence(result: Result) -> str:
    """Between which ends the score lies, and which one counts; empty where the log leaves nothing open.

    Args:
        result: The result.
    """
    interval = result.interval
    if interval is None:
        return ""
    automatic = "automatic " if result.adjusted is not None else ""
    loosely = "" if interval.tight else "somewhere "
    counts = f"{which_counts(interval)}{_not_the_team_s(interval)}"
    return f"the {automatic}score lies {loosely}{between(interval)}; {counts}"


def adjusted_sentence(result: Result) -> str:
    """Between which ends the adjusted score lies; empty where there is none, or one number."""
    left = None if result.adjusted is None else interval_that_counts(result)
    if left is None:
        return ""
    return (
        f"the adjusted score lies {'' if left.tight else 'somewhere '}{between(left)}; {which_counts(left)}"
    )


def _not_the_team_s(interval: ScoreInterval) -> str:
    """What of it hangs on what was not recorded; empty where nothing does."""
    if isinstance(interval.unseen, UnsetType) or interval.counts != "worst":
        return ""
    return f"; {amount_text(interval.unseen)} less for what was not recorded, no doing of the team"


def bounds_text(result: Result) -> str:
    """How fast bodies are taken to be between samples, and who says so; empty where it fills no gap.

    Our defaults are far from what a competition knows of its own robot, so how to state that is said as well.
    """
    filled = {one.check for one in result.measured.open}
    settings = (result.measured.settings or {}).items()
    stated = [one for check, of in settings if check in filled for one in of.parameters]
    found = {one.name.split(".")[1]: one for one in stated if _MAX_SPEED.fullmatch(one.name)}
    driven = {one.name.split(".")[1] for one in stated if _MAX_ACCELERATION.fullmatch(one.name)}
    if not found:
        return ""
    said = [
        f"a {kind} at most {one.value:g} {one.unit}" + (f" ({one.source})" if one.origin != "default" else "")
        for kind, one in sorted(found.items())
    ]
    ours = ", by our defaults" if any(one.origin == "default" for one in found.values()) else ""
    free = ", whatever the acceleration" if found.keys() - driven else ""
    remedy = "; state what is so under 'bounds:' of the log map or the rule set" if ours or free else ""
    return f"between samples: {', '.join(said)}{ours}{free}{remedy}"


def stand_in_text(result: Result) -> str:
    """What to do about a topic for which others stand, where nobody publishes it; empty where none does."""
    causes = () if result.interval is None else (one.cause for one in result.interval.narrowing)
    topics = sorted({topics for cause in causes if (topics := stood_for(cause))})
    if not topics:
        return ""
    there = " and ".join(topics)
    return f"{there}: where nobody publishes it, score with a log map that states no rate of it (--log-map)"


def is_at_worst(result: Result) -> bool:
    """Whether something undecided took of the task score, which is what it is before others are looked at."""
    taken = taken_by(result.task)
    return any(one.finding in taken for one in result.assumptions)


def would_narrow(result: Result, spoken: Callable[[str], str] = str) -> list[str]:
    """What would narrow the score that counts, most first; without a score all that lacks for one.

    Args:
        result: The result.
        spoken: What makes texts harmless to show.
    """
    interval = interval_that_counts(result)
    if interval is not None:
        return [narrowing_text(one, spoken) for one in interval.narrowing]
    if result.final is not None or result.adjusted is not None:
        return []
    # Without a score nobody can say what each is worth, but what lacks is known.
    lacking = [*by_source([one.causes for one in result.measured.open])]
    if lacking:
        filled = {one.check for one in result.measured.open}
        lacking += dict.fromkeys(one.message for one in result.assumptions if one.check not in filled)
    return [spoken(one) for one in lacking]


def narrowing_text(one: Narrowing, spoken: Callable[[str], str] = str) -> str:
    """What would narrow an interval, and by how much.

    Args:
        one: A cause.
        spoken: What makes its text harmless to show.
    """
    if one.at_most is None:
        return f"{spoken(one.cause)}: nobody can say how much"
    points = amount_text(one.at_most)
    return f"{spoken(one.cause)}: at most {points} {'point' if one.at_most == 1 else 'points'}"
