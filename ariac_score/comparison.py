"""One trial under two rule sets: which points differ, why, and where that is written.

A rule set that differs from another on purpose says so under `differs`. A number that is
another one without such an entry is unexplained.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
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
            made_of = [changes[key] for key in _terms_in(one.traced, other.traced) if key in changes]
            asking = _Asking(first, second, level, path, term)
            direct = tuple(asking.reasons((one.traced, other.traced), made_of))
            inherited = dict.fromkeys(reason for change in made_of for reason in change.reasons)
            changes[path, term] = Change(
                level,
                path,
                term,
                one.traced.value,
                other.traced.value,
                reasons=direct or tuple(inherited),
                follows=bool(made_of) and not direct,
            )
    for certain in (first, second):
        if certain.rule_set.sheet.needs_cohort:
            reason = f"{certain.rule_set.id} compares teams; its score is known when all are ranked"
            undecided.append(("trial", "", _SCORE, reason))
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


@dataclass(frozen=True)
class _Asking:
    """Looks for the differences that the number of one term shows."""

    first: Certain
    second: Certain
    level: str
    path: str
    term: str

    def reasons(self, traces: tuple[Traced, Traced], made_of: Sequence[Change]) -> Iterator[Difference]:
        """Those of a check that says something else here, and those named for a formula that is another.

        Where what a term is made of differs too, a formula that is merely written in
        another way explains nothing; the score alone is always another formula.
        """
        names = {f"{self.level}.{self.term}"}
        if self._is_score:
            names |= {_SCORE, "task", *self._one_sided(*traces)}
        sources = [formula.source for formula in self._formulas]
        by_name = sources[0] != sources[1] and (self._is_score or not made_of)
        differs = self.second.rule_set.differs
        for difference in differs.because if differs else ():
            named = bool(names & set(difference.terms))
            telling = {check for check in difference.checks if self._tells(check)}
            if (named and (telling or by_name)) or telling & self._asked(0) | telling & self._asked(1):
                yield difference

    @property
    def _is_score(self) -> bool:
        return self.term in (_SCORE, _TASK_SCORE)

    @property
    def _formulas(self) -> list[Expression]:
        sheets = [certain.rule_set.sheet for certain in (self.first, self.second)]
        return [sheet.score if self._is_score else sheet.terms[self.level][self.term] for sheet in sheets]

    def _asked(self, which: int) -> set[str]:
        """The checks that the term's own formula asks under one of the two rule sets."""
        checks = (self.first, self.second)[which].rule_set.sheet.checks
        nodes = self._formulas[which].walk()
        return {node.id for node in nodes if isinstance(node, ast.Name) and node.id in checks}

    def _tells(self, check: str) -> bool:
        """Whether a check says something else here, or is asked by one of the two formulas alone."""
        one_asks = (check in self._asked(0)) != (check in self._asked(1))
        return one_asks or _says(self.first, check, self.path) != _says(self.second, check, self.path)

    def _one_sided(self, *traces: Traced) -> set[str]:
        """Terms a score is made of that only one of the two rule sets has."""
        found = {f"{_level_of(path)}.{name}" for path, name in _terms_in(*traces)}
        first, second = (_all_terms(certain.rule_set) for certain in (self.first, self.second))
        return found & (first ^ second)


def _level_of(path: str) -> str:
    return LEVELS[::-1][len(path.split("/")) if path else 0]


def _all_terms(rule_set: RuleSet) -> set[str]:
    return {f"{level}.{name}" for level, named in rule_set.sheet.terms.items() for name in named}


def _says(certain: Certain, check: str, path: str) -> list[tuple[str, str, tuple[tuple[str, float], ...]]]:
    """What a check says within a scope."""
    return [
        (finding.subject, finding.verdict.value, tuple(sorted(finding.quantities.items())))
        for finding in certain.measured.of(check).values()
        if not path or finding.subject == path or finding.subject.startswith(f"{path}/")
    ]
