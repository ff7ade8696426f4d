"""One trial under two rule sets: which points differ, why, and where that is written.

A rule set that differs from another on purpose says so under `differs`. A number that is
another one without such an entry is unexplained.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass

from ariac_score.certain import Certain
from ariac_score.expression import Expression, Number, Traced
from ariac_score.ruleset import Difference, RuleSet, load_rule_set, rule_set_names
from ariac_score.scoring.scope import LEVELS, Scope

__all__ = ["Change", "Comparison", "compare_rules", "rule_sets_differing_from"]

_SCORE, _TASK_SCORE = "score", "task score"


@dataclass(frozen=True)
class Change:
    """One term that is another number under the second rule set.

    Attributes:
        level: One of `LEVELS`.
        path: Path of the scope; empty for the trial.
        term: Its name; `score` for the score, `task score` where one of the two compares
            teams and so has no score yet.
        before: Under the first rule set.
        after: Under the second.
        reasons: Why; those of what it is made of when it only follows.
        follows: Whether it differs only because what it is made of does.
    """

    level: str
    path: str
    term: str
    before: Number
    after: Number
    reasons: tuple[Difference, ...] = ()
    follows: bool = False

    @property
    def unexplained(self) -> bool:
        """Whether no entry of the rule set says why; what only follows is explained where it comes from."""
        return not self.reasons and not self.follows


@dataclass(frozen=True)
class Comparison:
    """One trial under two rule sets.

    Attributes:
        first: Id of the first rule set.
        second: Id of the second.
        changes: What differs, from the parts outwards, the score last.
        undecided: Terms that one of the two leaves open, as level, path, term and reason.
    """

    first: str
    second: str
    changes: tuple[Change, ...]
    undecided: tuple[tuple[str, str, str, str], ...] = ()


def rule_sets_differing_from(rule_set: RuleSet) -> tuple[RuleSet, ...]:
    """The shipped rule sets that say how they differ from this one."""
    shipped = (load_rule_set(name) for name in rule_set_names())
    return tuple(one for one in shipped if one.differs and one.differs.other == rule_set.id)


def compare_rules(first: Certain, second: Certain) -> Comparison:
    """Every term that both rule sets have, in every scope that both know, and the score."""
    changes: dict[tuple[str, str], Change] = {}
    undecided: list[tuple[str, str, str, str]] = []
    for level, path, term, before, after in _pairs(first, second):
        one, other = first.value(before, level, path), second.value(after, level, path)
        if one.traced is None or other.traced is None:
            undecided.append((level, path, term, one.reason or other.reason))
        elif one.traced.value != other.traced.value:
            numbers = (one.traced.value, other.traced.value)
            direct = tuple(_reasons(first, second, level, path, term))
            made_of = [changes[key] for key in _terms_in(one.traced, other.traced) if key in changes]
            inherited = dict.fromkeys(reason for change in made_of for reason in change.reasons)
            follows = bool(made_of) and not direct
            changes[path, term] = Change(level, path, term, *numbers, direct or tuple(inherited), follows)
    return Comparison(first.rule_set.id, second.rule_set.id, tuple(changes.values()), tuple(undecided))


def _pairs(first: Certain, second: Certain) -> Iterator[tuple[str, str, str, Expression, Expression]]:
    """What can be compared, from the parts outwards: level, path, term, and its formula in each."""
    sheets = first.rule_set.sheet, second.rule_set.sheet
    for level in LEVELS:
        paths = [scope.path for scope in _scopes(first.measured.scopes, level)]
        for path in paths:
            for term in sheets[0].terms.get(level, {}):
                if term in sheets[1].terms.get(level, {}):
                    name = Expression.parse(term)
                    yield level, path, term, name, name
    scores = [(sheet.task if sheet.needs_cohort else None) or sheet.score for sheet in sheets]
    whole = _TASK_SCORE if any(sheet.needs_cohort for sheet in sheets) else _SCORE
    yield "trial", "", whole, scores[0], scores[1]


def _scopes(trial: Scope, level: str) -> list[Scope]:
    return [trial] if level == "trial" else list(trial.each(level))


def _terms_in(*traces: Traced) -> list[tuple[str, str]]:
    """The terms numbers are made of, by path and name."""
    found: dict[tuple[str, str], None] = {}
    open_ = list(traces)
    while open_:
        node = open_.pop()
        if node.kind == "term":
            found[node.subject, node.label] = None
        open_ += node.children
    return list(found)


def _reasons(first: Certain, second: Certain, level: str, path: str, term: str) -> Iterator[Difference]:
    """The differences that a number shows: those named for its term, or for a check that it asks itself.

    One that names checks shows only where one of these says something else.
    """
    names = {_SCORE, "task"} if term in (_SCORE, _TASK_SCORE) else {f"{level}.{term}"}
    asked = _asked_itself(first.rule_set, level, term) | _asked_itself(second.rule_set, level, term)
    differs = second.rule_set.differs
    for difference in differs.because if differs else ():
        saying = {
            check for check in difference.checks if _says(first, check, path) != _says(second, check, path)
        }
        named = bool(names & set(difference.terms)) and (bool(saying) or not difference.checks)
        if named or saying & asked:
            yield difference


def _asked_itself(rule_set: RuleSet, level: str, term: str) -> set[str]:
    sheet = rule_set.sheet
    formula = sheet.terms[level][term] if term in sheet.terms.get(level, {}) else sheet.score
    return {node.id for node in formula.walk() if isinstance(node, ast.Name) and node.id in sheet.checks}


def _says(certain: Certain, check: str, path: str) -> list[tuple[str, str, tuple[tuple[str, float], ...]]]:
    """What a check says within a scope."""
    return [
        (finding.subject, finding.verdict.value, tuple(sorted(finding.quantities.items())))
        for finding in certain.measured.of(check).values()
        if not path or finding.subject == path or finding.subject.startswith(f"{path}/")
    ]
