"""What doing worse, hiding and trying again bring under each penalty, and under changes of the default."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ariac_score.review.laws.cases import TICKS_PER_S, Case, Violation, World
from ariac_score.review.laws.reference import (
    DEFAULT,
    REFERENCE_EVENTS,
    REFERENCE_UNGRADED,
    reference_rules,
)
from ariac_score.scoring.penalties import load_penalty
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["baselines"]

_PARTS = 10
"""Points that the made trial earns without violations."""


@dataclass(frozen=True)
class _Exploit:
    """Something that should not pay.

    Attributes:
        title: Of its column.
        said: What is done, in words.
        scores: What honesty gives, and what doing it gives.
        pays: Whether that is an exploit.
    """

    title: str
    said: str
    scores: Callable[[World], tuple[float, float]]
    pays: Callable[[float, float], bool]


def _near(start_s: float, lasts_s: float, depth: float = 1.0, check: str = "separation") -> Violation:
    start, lasts = round(start_s * TICKS_PER_S), round(lasts_s * TICKS_PER_S)
    return Violation(check, 0, start, start + lasts, depth)


def _trial(*violations: Violation, pieces: int = 1, duration_s: float = 60) -> Case:
    orders = ((_PARTS // 2,),) * pieces if pieces > 1 else ((_PARTS,),)
    return Case(orders, violations=tuple(sorted(violations)), duration=round(duration_s * TICKS_PER_S))


def _scores(*cases: Case) -> Callable[[World], tuple[float, float]]:
    def scores(world: World) -> tuple[float, float]:
        first, second = (world.score(case) or 0 for case in cases)
        return float(first), float(second)

    return scores


def _going_on(world: World) -> tuple[float, float]:
    """What one of four equal pieces of work brings, and all four, each with the same contact of 1 s."""

    def done(count: int) -> float:
        contacts = [_near(30 * k, 1, 1.0, "human_contact") for k in range(count)]
        case = _trial(*contacts, pieces=4, duration_s=120)
        left = world.scopes(case).inner[count:]
        undone = frozenset(
            ("part_color", subject)
            for subject in world.subjects(case, "part_color")
            if any(piece.contains(subject) for piece in left)
        )
        return float(world.score(replace(case, failed=undone)) or 0)

    return done(4), max(done(count) for count in range(4))


def _rises(before: float, after: float) -> bool:
    return after > before + 1e-9


def _same(before: float, after: float) -> bool:
    return abs(after - before) <= 1e-9


_TWO = (_near(10, 0.5, 0.3), _near(12, 0.5, 0.3))
_LONG = _near(10, 10)
_EXPLOITS: tuple[_Exploit, ...] = (
    _Exploit(
        "merging",
        "two near misses of 0.5 s, 1.5 s apart; then violated in between as well, hardly",
        _scores(_trial(*_TWO), _trial(*_TWO, _near(10.5, 1.5, 0.01))),
        _rises,
    ),
    _Exploit(
        "splitting",
        "10 s too near; then with a pause of 1.2 s in it",
        _scores(_trial(_LONG), _trial(_near(10, 4), _near(15.2, 4.8))),
        _rises,
    ),
    _Exploit(
        "going deeper",
        "10 s at 0.1 % and at 100 % of the distance",
        _scores(_trial(_near(10, 10, 0.001)), _trial(_LONG)),
        _same,
    ),
    _Exploit(
        "staying longer",
        "0.5 s and 10 s at full depth",
        _scores(_trial(_near(10, 0.5)), _trial(_LONG)),
        lambda before, after: after >= before - 1e-9,
    ),
    _Exploit(
        "waiting",
        "10 s too near; then 10 min more without anything",
        _scores(_trial(_LONG), _trial(_LONG, duration_s=660)),
        _rises,
    ),
    _Exploit(
        "stopping early",
        "four equal pieces of work, 1 s of contact in each; or stopping after the best number of them",
        _going_on,
        _rises,
    ),
    _Exploit(
        "running again",
        "a run with 10 s too near; the same twice",
        lambda world: (
            float(world.score(_trial(_LONG)) or 0),
            float(world.score(_trial(_LONG), runs=2) or 0),
        ),
        lambda before, after: not _same(before, after),
    ),
    _Exploit(
        "again after it",
        "one contact that is critical, and another 20 s later",
        _scores(
            _trial(replace(_near(5, 0.5, 1.0, "human_contact"), critical=True)),
            _trial(
                replace(_near(5, 0.5, 1.0, "human_contact"), critical=True),
                _near(25, 0.5, 1.0, "human_contact"),
            ),
        ),
        lambda before, after: after >= before - 1e-9,
    ),
)

_BASELINES = (
    DEFAULT,
    "penalty.hyperbolic",
    "penalty.product",
    "penalty.multiplier_times_weighted_mean",
    "penalty.lexicographic",
    "penalty.gate",
    "penalty.occurrences_per_5_s",
    "penalty.subtractive",
)

_EPISODES = "earned * safety_gate / (1 + weight_of_separation * demerits(separation, tau_s=5))"

_ABLATIONS: tuple[tuple[str, dict[str, float]], ...] = (
    ("as it is", {}),
    ("T = 1 s", {"safety_again_after_s": 1}),
    ("T = 20 s", {"safety_again_after_s": 20}),
    ("weights halved", {"safety_scale": 0.5}),
    ("weights doubled", {"safety_scale": 2}),
    ("depth not counted (severity 0)", {"safety_severity": 0}),
    ("depth squared (severity 2)", {"safety_severity": 2}),
    ("no gate", {}),
)


def _world(rules: RuleSet) -> World:
    return World(rules, REFERENCE_EVENTS, ungraded=REFERENCE_UNGRADED)


def _without_gate(rules: RuleSet) -> RuleSet:
    return rules.with_score("earned * safety_multiplier")


def baselines() -> str:
    """The tables: each penalty, and each change of the default, against each exploit."""
    penalties = [(f"`{name}`, {_after(name)}", _world(reference_rules(name))) for name in _BASELINES]
    default = reference_rules(DEFAULT)
    penalties.append(("`paper2020.published`, by episodes", _world(default.with_score(_EPISODES))))
    changed = [
        (name, _world(_without_gate(default) if name == "no gate" else default.with_parameters(**numbers)))
        for name, numbers in _ABLATIONS
    ]
    lines = [_HEAD, *_table("penalty", penalties), _CHANGES, *_table("default", changed), _AT_REST]
    return "".join(lines)


def _after(name: str) -> str:
    """Whose form it is, the first words of the penalty's own source."""
    if name == DEFAULT:
        return "ours"
    return re.split(r"[,;:(]", load_penalty(name, folder=Path()).source)[0].strip()


def _table(what: str, rows: Sequence[tuple[str, World]]) -> Iterator[str]:
    yield f"\n| {what} | {' | '.join(one.title for one in _EXPLOITS)} |\n|---|{'---|' * len(_EXPLOITS)}\n"
    for name, world in rows:
        yield f"| {name} | {' | '.join(_shown(one, world) for one in _EXPLOITS)} |\n"
    yield "\n"


def _shown(exploit: _Exploit, world: World) -> str:
    before, after = exploit.scores(world)
    text = f"{_number(before)} → {_number(after)}"
    return f"**{text}**" if exploit.pays(before, after) else text


def _number(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".") if value else "0"


_HEAD = (
    """
## Against what others do

The same made trials under each penalty: what honesty gives, and what doing worse, hiding or trying again
gives. Ten points are earned (twenty in four pieces of five); what is **bold** pays, or does not cost though
it is worse.

| column | what is done |
|---|---|
"""
    + "".join(f"| {one.title} | {one.said} |\n" for one in _EXPLOITS)
    + """
Whose form each is, and where that is published, stands under "The penalties" below; weights are those of the
table above, so that the forms are compared and not their numbers. Before, the default added demerits up over
runs, which took 10 points with demerits D to 10 / (1 + 2 D) for the same run twice.
"""
)

_CHANGES = """
What each part of the default is for, by leaving it out or turning it:
"""

_AT_REST = """
A human who walks into a robot that stands still is no matter of the penalty but of the check: with
`robot_must_move` `ssm_separation` and `human_contact` find nothing in it, and the trial keeps its points;
without, as in `paper2020.published`, it is a critical contact, and the trial is worth 0. Two readings of
the standard have names: `yes` asks whether the robot moves at all, `towards_human` whether it closes the
distance.

A stricter charge, with a small share of the sum over all violations besides, would make those in the shadow
of something heavier cost as well. It is not offered: a pause within a violation would then save something,
and with it the law on short pauses would go, which lets a monitor bridge them.
"""
