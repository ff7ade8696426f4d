"""`docs/penalties.md`: which penalty keeps which law, and what can be made of those that do not."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from ariac_score.checks.registry import Registry
from ariac_score.review.laws.prices import ALL_LAWS
from ariac_score.review.laws.reference import DEFAULT, reference_rules
from ariac_score.review.proofs.baselines import baselines
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
    return "".join([*head, *_table(found), baselines(), *_laws(), *_shipped(), *_pages(found)])


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

A rule set repeats what a competition did, faults included. Those that break a law say so in their file,
under `breaks`; `rules check` repeats it with the counter-example, and fails with `--strict` alone. What is
known of the others is in [the table of laws](laws.md). `extends` does not take `breaks` over.

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
extends: paper2020.published
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

`ariac-score rules prove NAME` proves fourteen laws ([how](laws.md)), and for one that does not hold shows the
smallest exploit it finds. Findings are drawn independently of each other: an exploit shows what the formulas
allow, not that a trial will come to it. Below is that for every penalty, on a made competition: a point for
each part of the right type and color, two off for anything unwanted, so that what was earned can be negative;
separation, human contact and arm collision as safety checks; what is undecided counts as the worst case.
Of the laws some exclude each other, so no penalty keeps them all. This page is generated; a test compares it.
What once paid, before and after, on logs: [fairness](fairness.md#what-once-paid).
"""

_REASONS = """
## Why the default charges depth over time and not episodes

The monitor catalogue suggests 1 + (integral of relative depth) / 5 s for each episode; `demerits(check,
tau_s=5)` is that, and `paper2020.published` has it. It breaks a law: violating in the pause between two near
misses makes one episode of them, and one can be cheaper than two. That cannot be mended by other numbers: two
instants T apart are part of every violation that lasts from one to the other, so what is charged for
each of them has to be charged again for every T that the longer one lasts.

`charged(…)` does so for every depth. At each moment a violation presses with its weight times its relative
depth, to the power of `severity`; what has no depth, such as a contact, is as deep as can be. What counts
is the most that pressed on a pair of bodies in the last T = 5 s, over time, divided by T. From that
follows:

- Doing more, longer or deeper never costs less: there are no episodes to be merged or split.
- One rise and fall costs its peak plus its integral / T: at one depth, weight times depth times 1 + length
  / T.
- Two that are at least T apart cost what each costs alone; nearer ones never more than that.
- What lies between two that are at least as deep, and at most T apart, changes nothing; so a stored profile
  of depth has its valleys of up to 1 s filled, and a T below 1 s is refused.
- A little deeper or longer costs a little more. The one step left is the first sample: an instant costs its
  depth at once. So depth counts beyond the stated error of a distance (`distance_error_m`), and one bad
  sample within it is no violation.
- What happens in the shadow of something heavier is free: one event is charged once, whichever monitors saw
  it.

Of several runs the worst counts. Nothing else leaves a team where it is when it repeats a run, and never
lets another run help: a sum breaks the one, a mean the other.

Negative points are mirrored, earned * (2 - gate * multiplier), because dividing them would make violations
a gift. The gate has no threshold on demerits: it would make it pay to stop just before. A critical
violation costs everything at once, in the first piece of work as in any other; teams that it leaves
at 0 are separated by their demerits.

## Which penalty keeps which law

"""
