"""A trial in two or three sentences: what was done, what went wrong, what it cost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from functools import cached_property

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.errors import ScoreError
from ariac_score.report.figures import amount_text, count_in_words, rounded_points, said
from ariac_score.report.openness import open_sentence
from ariac_score.report.places import Places
from ariac_score.report.words import capital
from ariac_score.results.doubt import counted, why_withheld
from ariac_score.results.result import Result
from ariac_score.results.safety import safety_checks
from ariac_score.results.sketch import DrawnChart
from ariac_score.review.task_and_safety import TaskAndSafety, task_and_safety
from ariac_score.scoring.ledger import taken_by
from ariac_score.scoring.ruleset import RuleSet, rule_set_from_text
from ariac_score.scoring.scope import Scope
from ariac_score.terminal.style import plain
from ariac_score.trial.words import HANDED_IN, spelled

__all__ = ["sentences_of", "summary_of"]

_MOST_MISTAKES = 4
_LONGEST_MESSAGE = 160


def summary_of(result: Result, rule_set: RuleSet | None = None, *, with_score: bool = True) -> str:
    """The sentences about a trial as one text: printable characters only, of bounded length.

    Args:
        result: The result.
        rule_set: The rules in the result, where the caller has read them already.
        with_score: Whether to say why there is no score, and what stewards made of it.
    """
    return " ".join(sentences_of(result, rule_set, with_score=with_score))


def sentences_of(
    result: Result, rule_set: RuleSet | None = None, *, with_score: bool = True
) -> tuple[str, ...]:
    """What was done and what was wrong with it, the worst of safety and its cost, why there is no score.

    Made of findings, ledger and the words of the competition, for any competition. What nobody
    recorded is said to be undecided; nothing is concluded from silence.

    Args:
        result: The result.
        rule_set: The rules in the result, where the caller has read them already.
        with_score: Whether to say why there is no score, and what stewards made of it.
    """
    try:
        rules = rule_set or rule_set_from_text(result.rules, file="the rules in the result")
    except ScoreError:  # a page of a result whose rules this version cannot read has no sentence
        return ()
    teller = _Teller(result, rules)
    said_ = [teller.work(), teller.safety()]
    said_ += [teller.open(), teller.decided()] if with_score else []
    # An id such as `ceiling_robot` is no word, and keeps its letters.
    return tuple(f"{capital(one) if one.split()[0].strip(',:').isalpha() else one}." for one in said_ if one)


@dataclass(frozen=True)
class _Teller:
    result: Result
    rules: RuleSet

    # The work ----------------------------------------------------------------------------

    def work(self) -> str:
        """What was handed in or to be done, and the mistakes in it."""
        if not self.work_checks:
            return ""
        scopes, words = self.result.measured.scopes, self.places.words
        if not scopes.inner:
            return words.none_announced() if words.of_work else self._of_the_trial()
        done, undone = self._done(), self.undone
        mistakes = self._mistakes(undone)
        if mistakes:
            return f"{done}, {_listed(mistakes)}"
        of_work = (one for one in self.found.values() if one.check in self.work_checks)
        undecided = sum(one.verdict is Verdict.INCONCLUSIVE for one in of_work)
        if undecided:
            return f"{done}, {count_in_words(undecided, 'check', 'checks')} of the work undecided"
        return done if undone else f"{done}, nothing wrong"

    def _of_the_trial(self) -> str:
        """Of a competition without items of work, what the first check of it found."""
        found = [one for one in self.found.values() if one.check in self.work_checks]
        worst = next((one for one in found if one.verdict is Verdict.VIOLATED), None)
        return self._told(worst or found[0]) if found else ""

    def _done(self) -> str:
        words = self.places.words
        items = self.to_hand_in
        if not items:
            outermost = self.result.measured.scopes.inner
            one, many = words.one(outermost[0].level), words.many(outermost[0].level)
            return count_in_words(len(outermost), one, many)
        level = HANDED_IN if HANDED_IN in words.spoken else items[0].level
        all_of_them = count_in_words(len(items), words.one(level), words.many(level))
        missing = len(self.undone)
        if not missing:
            return f"{all_of_them} delivered"
        if missing < len(items):
            return f"{count_in_words(len(items) - missing)} of {all_of_them} delivered"
        if "submissions" in self.result.measured.witnessed:
            if self._is_open():
                return f"{all_of_them}, what was delivered is open"
            return f"nothing delivered of {all_of_them}"
        return f"{all_of_them}, no delivery recorded"

    def _is_open(self) -> bool:
        """Whether the log leaves open of each item that was not handed in what became of it."""
        of_work = [one for one in self.found.values() if one.check in self.work_checks]
        undecided = (one.subject for one in of_work if one.verdict is Verdict.INCONCLUSIVE)
        open_ = {path for subject in undecided for path in _on_the_way(subject)}
        return self.undone <= open_

    @cached_property
    def to_hand_in(self) -> Sequence[Scope]:
        """The items that are handed in one by one; none where the competition has no such thing."""
        measured, words = self.result.measured, self.places.words
        if measured.sketch is None or not words.hands_in:
            return ()
        every = list(measured.scopes.walk())[1:]
        named = [scope for scope in every if scope.level == HANDED_IN]
        answered = {one.item for one in measured.sketch.brought}
        levels = {scope.level for scope in every if _own(scope) in answered}
        return named or [scope for scope in every if scope.level in levels] or list(measured.scopes.inner)

    @cached_property
    def undone(self) -> frozenset[str]:
        """Paths of the items that were not handed in, as far as the log shows."""
        sketch = self.result.measured.sketch
        answered = {one.item for one in sketch.brought} if sketch else set()
        return frozenset(scope.path for scope in self.to_hand_in if _own(scope) not in answered)

    def _mistakes(self, undone: frozenset[str]) -> list[str]:
        """How often each kind of mistake was made, each item counted once, by its first one.

        What is wrong with an item is said of the smallest item that it is wrong with: a kit with
        one wrong part is not a second mistake. What was never handed in has none.
        """
        wrong: dict[str, str] = {}
        for one in self.found.values():
            of_work = one.verdict is Verdict.VIOLATED and one.check in self.work_checks
            if of_work and undone.isdisjoint(_on_the_way(one.subject)):
                kept = wrong.get(one.subject, one.check)
                wrong[one.subject] = min(kept, one.check, key=lambda check: self.order[check])
        around = {path for subject in wrong for path in _on_the_way(subject) if path != subject}
        counts = Counter(check for subject, check in wrong.items() if subject not in around)
        listed = sorted(counts, key=lambda check: self.order[check])
        told = [self._mistake(check, counts[check]) for check in listed[:_MOST_MISTAKES]]
        rest = sum(counts[check] for check in listed[_MOST_MISTAKES:])
        return [*told, count_in_words(rest, "other mistake", "other mistakes")] if rest else told

    def _mistake(self, check: str, count: int) -> str:
        kept = (self.result.measured.settings or {}).get(check)
        if kept is not None and len(kept.mistake) == 2:
            return count_in_words(count, *(_cut(spelled(word), 60) for word in kept.mistake))
        name = _named(check)
        return count_in_words(count, f"mistake in {name}", f"mistakes in {name}")

    # Safety ------------------------------------------------------------------------------

    def safety(self) -> str:
        """The worst that happened, and what safety cost."""
        if not self.about_safety:
            return "these rules have no check of safety"
        found = {key: one for key, one in self.found.items() if one.check in self.about_safety}
        broken = {key: one for key, one in found.items() if one.verdict is Verdict.VIOLATED}
        if not broken:
            if self._is_certain():
                return "it was not safe, how much so is open" + (self._cost(1) if self.supposed else "")
            if any(one.verdict is Verdict.INCONCLUSIVE for one in found.values()):
                return "whether it was safe is undecided" + (self._cost(1) if self.supposed else "")
            kept = any(one.verdict is Verdict.SATISFIED for one in found.values())
            return "no violation of safety" if kept else "nothing was there to judge for safety"
        taken = taken_by(self.result.ledger)
        key = min(
            broken,
            key=lambda k: (taken[k].amount if k in taken else Decimal(0), broken[k].robustness or 0.0, k),
        )
        told = self._told(broken[key])
        if len(broken) > 1:
            told += f", the worst of {count_in_words(len(broken))} violations of safety"
        return told + self._cost(len(broken))

    def _is_certain(self) -> bool:
        """Whether every world has a violation of safety, though no sample shows one."""
        return any(
            finding.verdict is Verdict.VIOLATED
            for one in self.result.measured.open
            if one.check in self.about_safety
            for finding in one.best.values()
        )

    def _cost(self, count: int) -> str:
        parts, digits = self.parts, self.result.digits
        if parts is None:
            return ""
        it = "that" if count == 1 else "together they"
        it = f"with what was not seen {it}" if self.supposed else it
        if not parts.safety:
            return f"; {it} cost nothing"
        if parts.safety > 0:
            return ""
        cost = amount_text(rounded_points(-parts.safety, digits, 1))
        whole = amount_text(rounded_points(parts.task, digits, 1))
        if parts.safety == -parts.task:
            return f"; {it} cost all {whole} points"
        amount = f"{cost} of {whole}" if parts.task > 0 else cost
        return f"; {it} cost {amount} {'point' if amount.split()[-1] == '1' else 'points'}"

    def _told(self, finding: Finding) -> str:
        """A finding as a sentence: of a measured margin what it means, of others the check's own words."""
        curve = self._curve(finding)
        if finding.verdict is Verdict.VIOLATED and finding.robustness is not None and curve is not None:
            return self._margin(finding, curve, -finding.robustness) + _when(finding)
        who = "" if finding.subject in ("", "trial") else f"{self.places.of(finding.subject)}: "
        return f"{who}{_cut(finding.message, _LONGEST_MESSAGE)}{_at(finding)}"

    def _margin(self, finding: Finding, curve: DrawnChart, by: float) -> str:
        amount = f"{said(by)} {_cut(finding.unit, 12)}"
        first, mark, second = finding.subject.partition("/")
        if mark and finding.unit == "m" and not curve.at_most:
            return f"{self._body(first)} came {amount} too near to {self._body(second)}"
        what = f"{_cut(curve.what, 40)} of {self._body(finding.subject)}"
        return f"{what} was {amount} {'above its limit' if curve.at_most else 'below what is required'}"

    def _curve(self, finding: Finding) -> DrawnChart | None:
        sketch = self.result.measured.sketch
        of = (finding.check, finding.subject, finding.unit)
        curves = sketch.curves if sketch else ()
        return next((c for c in curves if (c.check, c.subject, c.unit) == of), None)

    def _body(self, name: str) -> str:
        """`the robot` where an id is no name but what the body is."""
        sketch = self.result.measured.sketch
        kinds = {route.body.partition("::")[0]: route.kind for route in (sketch.routes if sketch else ())}
        if name in {"robot", "human", *kinds.values()}:
            return f"the {name}"
        return (
            f"the {_cut(kinds[name], 40)} {self.places.of(name)}" if name in kinds else self.places.of(name)
        )

    # What is open ------------------------------------------------------------------------

    def open(self) -> str:
        result, many = self.result, len(self.result.assumptions)
        if result.status == "needs_cohort":
            task = "" if result.task is None else f"; the task score is {amount_text(result.task.amount)}"
            return f"the score waits for the other teams{task}"
        about = count_in_words(many, "finding is", "findings are")
        if result.interval is not None:
            why = _cut(result.interval.narrowing[0].cause, 80) if result.interval.narrowing else ""
            rest = len(result.interval.narrowing) - 1
            more = f" and {count_in_words(rest, 'other cause', 'other causes')}" if rest > 0 else ""
            return open_sentence(result) + (f" (open because of {why}{more})" if why else "")
        if result.score is None:
            if not many or result.missing:
                why = _cut(why_withheld(result), _LONGEST_MESSAGE)
                return f"there is no score, because {why}"
            first = _cut(result.assumptions[0].message, _LONGEST_MESSAGE)
            return f"there is no score, because {about} undecided ({first})"
        return f"{about} undecided and {'counts' if many == 1 else 'count'} as the rules say" if many else ""

    def decided(self) -> str:
        adjusted = self.result.adjusted
        if adjusted is None:
            return ""
        if adjusted.disqualified:
            return "the stewards disqualified it"
        if adjusted.score is None:
            return "even as adjusted by the stewards it has no score"
        score = amount_text(rounded_points(adjusted.score, self.result.digits))
        return f"the stewards made that {score} points"

    # What it is told of ------------------------------------------------------------------

    @cached_property
    def found(self) -> Mapping[str, Finding]:
        return self.result.measured.findings

    @cached_property
    def supposed(self) -> bool:
        """Whether the world whose score counts has violations of safety that nobody saw."""
        if self.result.score is None:
            return False
        with suppress(ScoreError):
            return any(
                one.verdict is Verdict.VIOLATED
                and one.check in self.about_safety
                and self.found.get(key) != one
                for key, one in counted(self.result, self.rules).findings.items()
            )
        return False

    @cached_property
    def places(self) -> Places:
        return Places(self.result)

    @cached_property
    def order(self) -> Mapping[str, int]:
        return {name: place for place, name in enumerate(self.rules.checks)}

    @cached_property
    def about_safety(self) -> frozenset[str]:
        return frozenset(safety_checks(self.rules, self.result.measured))

    @cached_property
    def work_checks(self) -> frozenset[str]:
        """The checks of the work that the score depends on."""
        return (self.rules.sheet.priced & self.rules.checks.keys()) - self.about_safety

    @cached_property
    def parts(self) -> TaskAndSafety | None:
        with suppress(ScoreError):
            return task_and_safety(self.result, self.rules)
        return None


def _own(scope: Scope) -> str:
    return scope.path.rpartition("/")[2]


def _on_the_way(subject: str) -> list[str]:
    """A path and those of all it is inside."""
    names = subject.split("/")
    return ["/".join(names[: i + 1]) for i in range(len(names))]


def _named(check: str) -> str:
    return _cut(spelled(check.replace("_", " ")), 40)


def _cut(text: str, longest: int) -> str:
    shown = plain(text)
    return shown if len(shown) <= longest else f"{shown[: longest - 1]}\u2026"


def _listed(words: Sequence[str]) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def _when(finding: Finding) -> str:
    if finding.span is None:
        return ""
    long = f" for {said(finding.span.duration_s)} s" if finding.span.duration_s > 0 else ""
    return f"{long} at {said(finding.span.start_s, 3)} s"


def _at(finding: Finding) -> str:
    """When, unless the message says so itself."""
    if finding.span is None or " s" in finding.message:
        return ""
    return f", at {said(finding.span.start_s, 3)} s"
