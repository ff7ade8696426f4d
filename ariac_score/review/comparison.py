"""One trial under two rule sets: which numbers differ, why, and which source says so.

A rule set that differs from another on purpose says so under `differs`. A number that
differs without such an entry is unexplained.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

from ariac_score.checks.findings import canonical_number
from ariac_score.review.certainty import Certain
from ariac_score.scoring.expression import Expression, Number, Traced
from ariac_score.scoring.levels import TRIAL
from ariac_score.scoring.ruleset import RuleDifference, RuleSet, installed_rule_sets_differing_from
from ariac_score.scoring.scope import Level, Scope, is_inside

__all__ = ["Change", "Comparison", "Undecided", "compare_rules", "rule_sets_differing_from"]

_SCORE, _TASK_SCORE = _WHOLE = "score", "task score"


@dataclass(frozen=True)
class Undecided:
    """One term that is undecided under one of two rule sets.

    Attributes:
        level: One of the levels of the rule sets.
        path: Path of the scope; empty for the trial.
        term: Its name.
        reason: Why it is undecided.
    """

    level: Level
    path: str
    term: str
    reason: str


@dataclass(frozen=True)
class Change:
    """One term with another value under the second rule set.

    Attributes:
        level: One of the levels of the rule sets.
        path: Path of the scope; empty for the trial.
        term: Its name; `score` for the score, `task score` where one of the two compares
            teams and so has no score yet.
        before: Under the first rule set.
        after: Under the second.
        reasons: Why; when it only follows, the reasons of the terms it is made of.
        follows: Whether it differs only because terms it is made of differ.
    """

    level: Level
    path: str
    term: str
    before: Number
    after: Number
    reasons: tuple[RuleDifference, ...] = ()
    follows: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "before", canonical_number(self.before))
        object.__setattr__(self, "after", canonical_number(self.after))

    @property
    def unexplained(self) -> bool:
        """Whether no entry says why; a term that only follows is explained by those it is made of."""
        return not self.reasons and not self.follows


@dataclass(frozen=True)
class Comparison:
    """One trial under two rule sets.

    Attributes:
        first: Id of the first rule set.
        second: Id of the second.
        changes: What differs, from the parts outwards, the score last.
        undecided: Terms that are undecided under one of the two, from the parts outwards.
    """

    first: str
    second: str
    changes: tuple[Change, ...]
    undecided: tuple[Undecided, ...] = ()


def rule_sets_differing_from(rule_set: RuleSet) -> tuple[RuleSet, ...]:
    """The installed rule sets that say how they differ from this one."""
    return tuple(installed_rule_sets_differing_from(rule_set.id))


def compare_rules(first: Certain, second: Certain) -> Comparison:
    """Compare every term that both rule sets have, in every scope that both have, and the score.

    Terms that no order depends on are left out, such as the value of a part had it been in a
    task of another kind.
    """
    comparing = _Comparing(first, second)
    # From the parts outwards: a change inside must be known when what is made of it is explained.
    for pair in _pairs(first, second):
        comparing.take(*pair)
    comparing.explain_from_outside()
    for rule_set in (first.rule_set, second.rule_set):
        if rule_set.sheet.needs_cohort:
            reason = f"{rule_set.id} compares teams; its score is known when all are ranked"
            comparing.undecided.append(Undecided("trial", "", _SCORE, reason))
    return Comparison(
        first.rule_set.id, second.rule_set.id, tuple(comparing.shown()), tuple(comparing.undecided)
    )


_Key = tuple[str, str]
"""Path and name of a term."""


@dataclass
class _Comparing:
    """A comparison in progress: what differs so far, and which terms are made of which."""

    first: Certain
    second: Certain
    changes: dict[_Key, Change] = field(default_factory=dict)
    undecided: list[Undecided] = field(default_factory=list)
    inner: dict[_Key, list[_Key]] = field(default_factory=dict)
    counting: set[_Key] = field(default_factory=set)
    decided: set[str] = field(default_factory=set)

    def take(self, level: str, path: str, term: str, before: Expression, after: Expression) -> None:
        """Compare one term in one scope."""
        one, other = self.first.value(before, level, path), self.second.value(after, level, path)
        if one.traced is None or other.traced is None:
            self.undecided.append(Undecided(level, path, term, one.reason or other.reason))
            return
        # What outermost work is made of matters; a term further in that nothing uses does not.
        if level in self.first.rule_set.sheet.levels[-2:]:
            self.counting |= {(path, term), *_terms_in(one.traced, other.traced)}
            self.decided.add(path)
        if one.traced.value != other.traced.value:
            self._differs(level, path, term, (one.traced, other.traced))

    def _differs(self, level: str, path: str, term: str, traces: tuple[Traced, Traced]) -> None:
        self.inner[path, term] = [key for key in _terms_in(*traces) if key in self.changes]
        made_of = [self.changes[key] for key in self.inner[path, term]]
        inherited = tuple(dict.fromkeys(reason for change in made_of for reason in change.reasons))
        reasons = _Reasons(self.first, self.second, level, path, term)
        direct = tuple(reasons.of(traces, bool(made_of), bool(inherited)))
        before, after = (traced.value for traced in traces)
        follows = bool(made_of) and not direct
        self.changes[path, term] = Change(level, path, term, before, after, direct or inherited, follows)

    def explain_from_outside(self) -> None:
        """Give unexplained terms the reasons of explained terms that are made of them."""
        for key, change in self.changes.items():
            if change.unexplained:
                around = [c for k, c in self.changes.items() if key in self.inner[k] and c.term not in _WHOLE]
                reasons = dict.fromkeys(r for outer in around if not outer.follows for r in outer.reasons)
                self.changes[key] = replace(change, reasons=tuple(reasons))

    def shown(self) -> Iterator[Change]:
        """The changes an order depends on; every change of an order without any decided term."""
        for key, change in self.changes.items():
            if key in self.counting or change.path.partition("/")[0] not in self.decided:
                yield change


def _pairs(first: Certain, second: Certain) -> Iterator[tuple[str, str, str, Expression, Expression]]:
    """What can be compared, from the parts outwards: level, path, term, and both formulas."""
    sheets = first.rule_set.sheet, second.rule_set.sheet
    for level in sheets[0].levels:
        paths = [scope.path for scope in _scopes(first.measured.scopes, level)]
        for path in paths:
            for term in sheets[0].terms.get(level, {}):
                if term in sheets[1].terms.get(level, {}):
                    name = Expression.parse(term)  # by name: each rule set evaluates its own formula
                    yield level, path, term, name, name
    # Where a rule set compares teams, one trial has a task score and no score.
    scores = [(sheet.task if sheet.needs_cohort else None) or sheet.score for sheet in sheets]
    whole = _TASK_SCORE if any(sheet.needs_cohort for sheet in sheets) else _SCORE
    yield TRIAL, "", whole, scores[0], scores[1]


def _scopes(trial: Scope, level: str) -> list[Scope]:
    return [trial] if level == TRIAL else list(trial.each(level))


def _terms_in(*traces: Traced) -> list[tuple[str, str]]:
    """The terms that numbers are made of, by path and name."""
    found: dict[tuple[str, str], None] = {}
    open_ = list(traces)
    while open_:
        node = open_.pop()
        if node.kind == "term":
            found[node.subject, node.label] = None
        open_ += node.children
    return list(found)


@dataclass(frozen=True)
class _Reasons:
    """Finds the stated differences that explain the change of one term."""

    first: Certain
    second: Certain
    level: str
    path: str
    term: str

    def of(
        self, traces: tuple[Traced, Traced], is_made_of: bool, is_explained: bool
    ) -> Iterator[RuleDifference]:
        """Differences of checks with other findings here, and differences of formulas, by name of the term.

        Where the terms it is made of differ too and are explained, another formula explains
        nothing, for it may only be written differently. The score is exempt: its formulas
        always differ.

        Args:
            traces: The number under each rule set.
            is_made_of: Whether it is made of terms that differ.
            is_explained: Whether any of these is explained.
        """
        names = {f"{self.level}.{self.term}"}
        if self._is_score:
            names |= {_SCORE, "task", *self._one_sided(*traces)}
        sources = [formula.source for formula in self._formulas]
        other = sources[0] != sources[1]
        by_name = other if self._is_score else (other or is_made_of) and not is_explained
        differs = self.second.rule_set.differs
        for difference in differs.because if differs else ():
            named = bool(names & set(difference.terms))
            differing = {check for check in difference.checks if self._differs(check)}
            used = self._checks_in(0) | self._checks_in(1)
            if (named and (differing or by_name)) or differing & used:
                yield difference

    @property
    def _is_score(self) -> bool:
        return self.term in _WHOLE

    @property
    def _formulas(self) -> list[Expression]:
        sheets = [certain.rule_set.sheet for certain in (self.first, self.second)]
        return [sheet.score if self._is_score else sheet.terms[self.level][self.term] for sheet in sheets]

    def _checks_in(self, which: int) -> set[str]:
        """The checks in the term's own formula under one of the two rule sets."""
        checks = (self.first, self.second)[which].rule_set.sheet.checks
        nodes = self._formulas[which].walk()
        return {node.id for node in nodes if isinstance(node, ast.Name) and node.id in checks}

    def _differs(self, check: str) -> bool:
        """Whether a check has other findings here, or stands in only one of the two formulas."""
        only_one = (check in self._checks_in(0)) != (check in self._checks_in(1))
        return only_one or _found(self.first, check, self.path) != _found(self.second, check, self.path)

    def _one_sided(self, *traces: Traced) -> set[str]:
        """Terms a score is made of that only one of the two rule sets has."""
        level_of = {scope.path: scope.level for scope in self.first.measured.scopes.walk()}
        found = {f"{level_of.get(path, TRIAL)}.{name}" for path, name in _terms_in(*traces)}
        first, second = (_all_terms(certain.rule_set) for certain in (self.first, self.second))
        return found & (first ^ second)


def _all_terms(rule_set: RuleSet) -> set[str]:
    return {f"{level}.{name}" for level, named in rule_set.sheet.terms.items() for name in named}


def _found(certain: Certain, check: str, path: str) -> list[tuple[str, str, tuple[tuple[str, float], ...]]]:
    """The findings of a check within a scope, without their words."""
    return [
        (finding.subject, finding.verdict.value, tuple(sorted(finding.quantities.items())))
        for finding in certain.measured.of(check).values()
        if is_inside(finding.subject, path)
    ]
