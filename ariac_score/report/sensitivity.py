"""Sensitivities as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ariac_score.review.sensitivity import Knob, RankSensitivity, ScoreSensitivity
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.terminal.style import plain

__all__ = ["ranks_text", "scores_text"]


def scores_text(found: Sequence[ScoreSensitivity], rule_set: RuleSet, of: str) -> str:
    """How a score depends on each number."""
    lines = [f"What the score of {of} under {rule_set.id} owes to each number", ""]
    varied = [each for each in found if not each.skipped]
    for each in sorted(varied, key=lambda each: -abs(each.elasticity or 0.0)):
        lines += [_head(each.knob), *(f"    {line}" for line in _score_lines(each))]
    if not varied:
        lines.append("nothing can be varied")
    return _text([*lines, *_skipped(found)])


def _score_lines(each: ScoreSensitivity) -> Iterator[str]:
    knob = each.knob
    yield (
        f"score {_number(each.low)} at {knob.low:g}, {_number(each.base)} as it is, "
        f"{_number(each.high)} at {knob.high:g}"
    )
    if each.elasticity is not None:
        yield f"one percent more of it: {each.elasticity:+.3g} percent"
    below, above = _changes(each.changes_below, knob), _changes(each.changes_above, knob)
    yield f"downwards the score {below}; upwards it {above}"


def _changes(value: float | None, knob: Knob) -> str:
    if value is None:
        return "stays"
    near = abs(value - knob.base) <= 1e-4 * max(abs(knob.high - knob.low), 1e-12)
    return "changes at once" if near else f"first changes at {value:.7g}"


def _number(score: float | None) -> str:
    return "none" if score is None else f"{score:.6g}"


def ranks_text(found: Sequence[RankSensitivity], rule_set: RuleSet, of: str) -> str:
    """How a ranking depends on each number."""
    lines = [f"What the ranks of {of} under {rule_set.id} owe to each number", ""]
    varied = [each for each in found if not each.skipped]
    for each in varied:
        lines.append(_head(each.knob))
        lines += [f"    {line}" for line in _shift_lines(each)]
    if not varied:
        lines.append("nothing can be varied")
    return _text([*lines, *_skipped(found)])


def _shift_lines(each: RankSensitivity) -> Iterator[str]:
    """The ranks beyond each value at which they change, seen from the published one."""
    if not each.shifts:
        yield "ranks stay as published in this range"
    below = [shift for shift in each.shifts if shift.value <= each.knob.base]
    above = [shift for shift in each.shifts if shift.value > each.knob.base]
    published = below[-1].after if below else above[0].before if above else {}
    for shift in reversed(below):
        yield f"below {shift.value:.7g}: {_moves(published, shift.before)}"
    for shift in above:
        yield f"from {shift.value:.7g}: {_moves(published, shift.after)}"


def _moves(published: Mapping[str, int | None], then: Mapping[str, int | None]) -> str:
    if not then:
        return "there is no ranking"
    moved = [
        f"{plain(team)} has {_rank(rank)} (published: {_rank(published.get(team))})"
        for team, rank in then.items()
        if rank != published.get(team)
    ]
    return "; ".join(moved) or "ranks as published"


def _rank(rank: int | None) -> str:
    return "no rank" if rank is None else f"rank {rank}"


def _head(knob: Knob) -> str:
    declared = "declared" if knob.declared else "half to double" if knob.base else "no range is declared"
    return f"{knob.name} = {knob.base:g}, varied from {knob.low:g} to {knob.high:g} ({declared})"


def _skipped(found: Sequence[ScoreSensitivity] | Sequence[RankSensitivity]) -> Iterator[str]:
    skipped = [each for each in found if each.skipped]
    if skipped:
        yield ""
        yield "Not varied"
    for each in skipped:
        yield f"    {each.knob.name} = {each.knob.base:g}: {each.skipped}"


def _text(lines: Sequence[str]) -> str:
    return "".join(f"{line}\n" for line in lines)
