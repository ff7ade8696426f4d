"""`docs/penalties.md`: which penalty keeps which law, and what can be made of those that do not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ariac_score.checks.registry import Registry
from ariac_score.review.laws.prices import ALL_LAWS
from ariac_score.review.laws.reference import DEFAULT, reference_rules
from ariac_score.review.proofs.proving import Judged, prove
from ariac_score.review.proofs.solver import find_solver
from ariac_score.review.proofs.subject import subject_of
from ariac_score.review.proofs.words import judged_lines
from ariac_score.scoring.named import named_parameters
from ariac_score.scoring.penalties import Penalty, load_penalty, penalty_names
from ariac_score.scoring.ruleset import installed_rule_sets

__all__ = ["penalties_page"]

Found = tuple[Penalty, tuple[Judged, ...]]


def penalties_page(*, cases: int = 60, seed: int = 0) -> str:
    """`docs/penalties.md`, with the table and the smallest counter-examples; the solver must be installed."""
    solver = find_solver()
    found: list[Found] = []
    for name in sorted(penalty_names(), key=lambda name: (name != DEFAULT, name)):
        subject = subject_of(name, Registry())
        judged = prove(subject, cases=cases, seed=seed, solver=solver)
        found.append((load_penalty(name, folder=Path()), judged))
    default, _ = found[0]
    head = [_INTRODUCTION, *_classes(default), _REASONS]
    return "".join([*head, *_table(found), *_laws(), *_shipped(), *_pages(found)])


def _table(found: list[Found]) -> Iterator[str]:
    names = [f"`{penalty.id.removeprefix('penalty.')}`" for penalty, _ in found]
    yield f"| law | {' | '.join(names)} |\n"
    yield f"|---|{'---|' * len(found)}\n"
    words = {"proven": "proven", "refuted": "**no**", "not_applicable": "", "open": "?"}
    for of_law in zip(*(judged for _, judged in found), strict=True):
        yield f"| {of_law[0].law.says} | {' | '.join(words[one.verdict] for one in of_law)} |\n"


def _laws() -> Iterator[str]:
    yield "\n## How a law is tried where it is not proven\n\n| law | how |\n|---|---|\n"
    for law in ALL_LAWS:
        yield f"| {law.says} | {law.how} |\n"


def _numbers(penalty: Penalty) -> Iterator[str]:
    """The parameters of a penalty, which a rule set may set otherwise."""
    numbers = named_parameters(penalty.parameters)
    if numbers:
        yield "\n| parameter | default | meaning |\n|---|---|---|\n"
    for name, (value, unit, meaning) in numbers.items():
        yield f"| `{name}` | {value:g}{'' if unit == '1' else f' {unit}'} | {meaning} |\n"


def _classes(penalty: Penalty) -> Iterator[str]:
    yield "\nWhat a violation of each class weighs (`rules/penalty/classes.yaml`):\n\n"
    yield "| class | weight | meaning |\n|---|---|---|\n"
    for name, (weight, _, meaning) in penalty.classes.items():
        yield f"| `{name}` | {weight:g} | {meaning} |\n"


def _shipped() -> Iterator[str]:
    """What shipped rule sets say about themselves."""
    yield _SHIPPED
    laws = {law.name: law.says for law in ALL_LAWS}
    for rule_set in installed_rule_sets():
        for law, because in rule_set.breaks.items():
            yield f"| `{rule_set.id}` | {laws[law]} | {because} |\n"


def _pages(found: list[Found]) -> Iterator[str]:
    levels = reference_rules(DEFAULT).sheet.levels
    yield "\n## The penalties\n"
    for penalty, judged in found:
        default = " (default)" if penalty.id == DEFAULT else ""
        yield f"\n### `{penalty.id}`{default}: {penalty.title}\n\n{penalty.in_words}\n"
        yield f"\nFrom: {penalty.source}.\n"
        yield from _numbers(penalty)
        broken = [one for one in judged if one.verdict == "refuted"]
        yield "\nIt keeps every law.\n" if not broken else "\n```\n"
        for one in broken:
            yield "".join(f"{line}\n" for line in judged_lines(one, levels))
        yield "```\n" if broken else ""


_SHIPPED = """
## Which shipped rule sets break a law

A rule set repeats what a competition did, faults included. Those that break a law say so in their file, under
`breaks`; `rules check` repeats it with the counter-example, and fails all the same. What is known of the
others is in [the table of laws](laws.md). `extends` does not take `breaks` over.

| rule set | law | because |
|---|---|---|
"""

_INTRODUCTION = """\
# Penalties

A rule set says what a trial earned; a penalty says what its violations do to that. It is included by name,
with the checks that are charged:

```yaml
id: mine
title: The rules of the paper with a penalised final score
source: this page
extends: paper2020
score: task
include: [penalty.gated_hyperbolic]
safety:
  separation: {class: separation}                    # the weight of its class, 0.4
  human_contact: {class: contact, weight: 1.0}
  no_arm_collision: {class: robot_collision, critical: false}
  scale: 1.0                                         # turns all demerits up or down
```

What comes out is a plain rule set (`ariac-score rules show mine.yaml --expanded`): the `score` of the rule
set becomes the term `earned`, each weight a parameter `weight_of_<check>`, the terms of the penalty follow,
and `penalised_score` is the score. A rule set changes a penalty by having a term or parameter of the same
name itself; a plain number keeps unit and meaning of the penalty's own. `critical: false` keeps the
critical violations of a check from closing the gate. The hash of the rule set covers the penalty. A
class of your own needs a weight.

`ariac-score rules prove NAME` proves thirteen laws ([how](laws.md)), and for one that does not hold shows the
smallest exploit it finds. Findings are drawn independently of each other: an exploit shows what the formulas
allow, not that a trial will come to it. Below is that for every penalty, on a made competition: a point for
each part of the right type and color, two off for anything unwanted, so that what was earned can be negative;
separation, human contact and arm collision as safety checks; what is undecided counts as the worst case.
Of the laws some exclude each other, so no penalty keeps them all. This page is generated; a test compares it.
"""

_REASONS = """
## Why the default charges time and not episodes

The monitor catalogue suggests 1 + (integral of relative depth) / 5 s for each episode; `demerits(check,
tau_s=5)` is that, and `paper2020` has it. It breaks a law: violating in the pause between two near misses
makes one episode of them, and one can be cheaper than two. That cannot be mended by other numbers. Two
instants T apart that cost 2 are part of every violation that lasts from one to the other; if more
violations never help, one of length L costs at least 1 + (how often T fits into L), however shallow it is.
So length must be charged at that rate, and depth cannot lower it.

`charged(…)` is the smooth charge of that kind: the time in violation together with the 5 s after it,
divided by 5 s. One violation of length L costs its weight times 1 + L / 5 s; two at least 5 s apart cost
what each costs alone; between nearer ones the time they share is charged once. At each moment the heaviest
violation of a pair of bodies counts and no other, so that one physical event is charged once, whichever
monitors saw it. Adding violations can only add to the time that is covered; a pause shorter than 5 s is
covered anyway; an end that moves by a sample moves the charge by a sample / 5 s. What is deeper than a
breach of separation, a contact say, is a check of its own in a heavier class.

Negative points are mirrored, earned * (2 - gate * multiplier), because dividing them would make violations
a gift. The gate has no threshold on demerits: it would make it pay to stop just before. A critical
violation costs everything at once, in the first piece of work as in any other.

## Which penalty keeps which law

"""
