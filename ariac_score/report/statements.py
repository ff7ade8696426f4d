"""Whose statement a result rests on, in words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import lru_cache

from ariac_score.report.figures import amount_text
from ariac_score.results.result import Result
from ariac_score.review.left_out import scores_with_an_event
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text
from ariac_score.trial.statements import NOBODY, Statement

__all__ = ["changes_nothing", "held_text", "is_held", "is_unattested", "left_out", "rests_on", "unattested"]

_ORDER = ("work", "window", "set-up", "completeness")
_OPEN = {"window": "window undecided", "completeness": "completeness not attested"}


def rests_on(statements: Iterable[Statement]) -> str:
    """Who states what, in one line; empty for results that do not say.

    >>> rests_on([Statement("work", "run", ("trial.yaml",)), Statement("completeness", "nobody")])
    'work: trial.yaml (run); completeness not attested'
    """
    in_order = sorted(statements, key=lambda one: (*_ORDER, one.fact).index(one.fact))
    return "; ".join(map(_one, in_order))


def left_out(result: Result) -> tuple[str, ...]:
    """What an unattested log would not show, had it been left out; empty where nothing hangs on it.

    That is an event, with the score that it would have cost, and samples of what nobody states a rate of.
    """
    found = scores_with_an_event(result)
    each = ", ".join(f"{amount_text(one.score)} with one of {one.check}" for one in found)
    said = [f"were an event left out of the log, the score would have been {each}"] if each else []
    unrated = ", ".join(one or "its signals" for one in result.measured.unrated)
    if unrated and _is_open(result) and is_held(result):
        said.append(f"nobody states the rate of {unrated}: samples left out evenly would show nowhere")
    return tuple(said)


def is_held(result: Result) -> bool:
    """Whether its rules take each sample to stand until the next one."""
    return _rules(result.rules).between_samples == "held"


def held_text(result: Result) -> str:
    """What an interval leaves out where samples are held; empty where nothing is open, or all is bounded."""
    if result.interval is None or not is_held(result):
        return ""
    return "a sample stands until the next one (between_samples: held): what is shorter is in neither end"


def changes_nothing(policy: str, result: Result) -> bool:
    """Whether an undecided finding makes no difference: the best and the worst world have the same score."""
    return policy in ("worst", "best") and result.score is not None and result.interval is None


def is_unattested(result: Result) -> bool:
    """Whether nobody attests its logs as complete, and its rules do not say what such logs are worth."""
    return _is_open(result) and not _rules(result.rules).authority.completeness


def _is_open(result: Result) -> bool:
    return any(one.fact == "completeness" and one.by == NOBODY for one in result.measured.statements)


@lru_cache(maxsize=8)  # the runs of a ranking have the same rules
def _rules(rules: str) -> RuleSet:
    return rule_set_from_text(rules, file="the rules in the result")


def unattested(open_: Sequence[bool]) -> str:
    """How many runs of a ranking rest on logs that nobody attests as complete; empty where none does.

    Args:
        open_: Of each run that has a result, whether it does.
    """
    if not any(open_):
        return ""
    return (
        f"completeness not attested in {sum(open_)} of {len(open_)} runs: what their logs do not hold, such "
        "as a collision, counts as not having happened; 'completeness:' in the rules says if that is meant"
    )


def _one(statement: Statement) -> str:
    if statement.by == NOBODY:
        words = _OPEN.get(statement.fact, f"{statement.fact}: nobody says")
        return f"{words} ({statement.detail})" if statement.detail else words
    source = ", ".join(statement.source)
    said = f"{source} ({statement.by})" if source else f"the {statement.by}"
    return f"{statement.fact}: {said}" + (f", {statement.detail}" if statement.detail else "")
