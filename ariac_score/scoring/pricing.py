"""From findings to a priced trial: the score, its ledger, and between which scores the trial lies."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from dataclasses import replace as replaced
from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal
from math import isfinite
from typing import NamedTuple

from msgspec.structs import replace

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.checks.measures import Measure
from ariac_score.errors import FormulaError, NeedsCohortError, UnknownFactError
from ariac_score.scoring.bounds import Worlds
from ariac_score.scoring.cohort import CohortValues, Contribution
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.expression import Expression, Number
from ariac_score.scoring.interval import ScoreInterval
from ariac_score.scoring.ledger import Ledger, Line, make_ledger, rounded
from ariac_score.scoring.left_open import DURATION, OF_RUNS, LeftOpen, Variable, variables_of
from ariac_score.scoring.levels import TRIAL
from ariac_score.scoring.policy import OPEN, Assumed, Assumption, assume, ideal
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.settled import Settled, ends_around, interval_around, interval_of, settle
from ariac_score.scoring.sheet import ScoreSheet
from ariac_score.scoring.worlds import tree_of

__all__ = [
    "Contributed",
    "CountedWorld",
    "Priced",
    "contribute",
    "counted_world",
    "ends_of_term",
    "price",
    "value_of",
]


NOTHING_OPEN = LeftOpen()
_SAID_DIGITS = 3
"""Decimal digits of bounds that are only told."""
_TRIED_FOR_WORDS = 64


@dataclass(frozen=True)
class Priced:
    """What findings are worth.

    Attributes:
        status: `scored`; `incomplete` when an undecided finding withholds the score, or nothing bounds
            it; `needs_cohort` when it takes values across teams that are not given.
        ledger: The score taken apart; `None` unless scored.
        task: The task score taken apart; `None` when the sheet has none, or it is withheld.
        possible: What the trial could have earned with every finding satisfied and every quantity at the
            best value that its check declares, if it declares one. Facts stay what they are in this trial:
            nothing says what better ones would be. `None` when that has no value, as when a time to be
            divided by is not known, and when it is below the score: then the formula pays for something
            else than what its checks ask for, and what could have been earned is not known.
        assumptions: What was made of undecided findings.
        missing: In words, what the score needs from all teams or what no record states.
        interval: The scores that the log allows, where it leaves any open.
    """

    status: str
    ledger: Ledger | None
    task: Ledger | None
    possible: Decimal | None
    assumptions: tuple[Assumption, ...]
    missing: str = ""
    interval: ScoreInterval | None = None


class CountedWorld(NamedTuple):
    """The world whose score counts.

    Attributes:
        findings: By id.
        trial: The scopes, outermost.
    """

    findings: Mapping[str, Finding]
    trial: Scope


@dataclass(frozen=True)
class Contributed:
    """What one trial brings to the values across teams.

    Attributes:
        values: Each contribution, counted or not.
        undecided: For each value that needs something undecided, what that is.
    """

    values: tuple[Contribution, ...]
    undecided: Mapping[str, str]


def contribute(
    findings: Mapping[str, Finding],
    scopes: Scope,
    sheet: ScoreSheet,
    policies: Mapping[str, str],
    *,
    left_open: LeftOpen = NOTHING_OPEN,
) -> Contributed:
    """What a trial brings to the values across teams; nothing where a value is undecided.

    Args:
        findings: By id.
        scopes: The scopes, outermost.
        sheet: The formulas.
        policies: What undecided findings count as, by check.
        left_open: What the log leaves open.

    Raises:
        FormulaError: A formula of the cohort has no value here.
    """
    values: list[Contribution] = []
    undecided: dict[str, str] = {}
    for name, term in sheet.cohort.items():
        used = frozenset[str]().union(*(sheet.checks_in(formula, term.level) for formula in term.formulas))
        assumed = assume(findings, policies, priced=used)
        named = frozenset[str]().union(*(sheet.facts_in(formula, term.level) for formula in term.formulas))
        among = used | (named & {DURATION})
        variables = _variables(findings, assumed, left_open, among, policies, {}, None)
        if variables:
            undecided[name] = variables[0].causes[0].text
        else:
            values += sheet.contributions(scopes, assumed.findings, only=name)
    return Contributed(tuple(values), undecided)


@in_own_decimals
def price(
    findings: Mapping[str, Finding],
    scopes: Scope,
    sheet: ScoreSheet,
    policies: Mapping[str, str],
    *,
    digits: int,
    cohort: CohortValues | None = None,
    measures: Mapping[str, Mapping[str, Measure]] | None = None,
    left_open: LeftOpen = NOTHING_OPEN,
) -> Priced:
    """Price findings.

    Args:
        findings: By id.
        scopes: The scopes, outermost.
        sheet: The formulas.
        policies: What undecided findings count as, by check.
        digits: Decimal digits of score and ledger.
        cohort: Values across teams, where there are any.
        measures: What checks declare of their quantities, by check and quantity.
        left_open: What the log leaves open, and which end of it counts.

    Raises:
        FormulaError: A formula has no value here, such as a division by zero.
    """
    cohort, measures = cohort or CohortValues(), measures or {}
    assumed = assume(findings, policies, priced=sheet.priced)
    scored = _open_in(sheet.scored, sheet.score, sheet, left_open)
    by_task = _open_in(sheet.priced_by_task, sheet.task, sheet, left_open)
    variables = _variables(findings, assumed, left_open, scored | by_task, policies, measures, cohort)
    maker = _Maker(scopes, sheet, assumed, variables, cohort, measures, digits, left_open.counts)
    task = maker.task(by_task)
    # Before any score is refused: a withheld result still says what it could have been.
    possible = _possible(ideal(findings, measures), scopes, sheet, cohort, digits)
    try:
        settled = maker.settled(sheet.score, scored, cohort)
    except NeedsCohortError as missing:
        if any(one.check in sheet.scored_across for one in variables) or not maker.bounds_all(scored):
            # What a team brings to values across teams cannot be open, so none of them can be had. Nor does
            # a team bring anything whose score nothing bounds, whatever others do.
            return Priced("incomplete", None, task, possible, maker.assumptions(None))
        return Priced("needs_cohort", None, task, possible, maker.assumptions(None), missing.cause)
    except UnknownFactError as missing:
        return Priced("incomplete", None, task, possible, maker.assumptions(None), missing.cause)
    assumptions = maker.assumptions(settled)
    withheld = maker.is_withheld(sheet.scored, settled)
    interval = interval_of(settled, digits, maker.counts_of(sheet.scored)) if settled.is_bounded else None
    if maker.is_zeroed(sheet.scored):
        withheld, interval = _withheld(assumed, sheet.scored), None
    if left_open.work_open:
        return Priced("incomplete", None, None, None, assumptions, _of_known_work(settled, digits, left_open))
    if not settled.is_bounded:
        missing_words = maker.without_bound(settled, scored)
        return Priced("incomplete", None, task, possible, assumptions, missing_words, interval)
    beside = CohortValues() if maker.is_zeroed(sheet.scored) else cohort
    if beside.beyond:
        try:
            ends = ends_around(settled, replaced(settled.worlds, beyond=_beyond(sheet)), digits)
        except FormulaError:
            ends = None
        if ends is None:
            nothing = f"{beside.beyond}; nothing bounds what that makes of the score"
            return Priced("incomplete", None, task, possible, assumptions, nothing)
        counts = maker.counts_of(sheet.scored) if withheld or beside.withheld else "known"
        interval = interval_around(interval, ends, settled.ends(digits), counts, beside.beyond)
    if withheld or beside.withheld:
        why = "" if withheld else beside.withheld
        return Priced("incomplete", None, task, possible, assumptions, why, interval)
    ledger = maker.ledger(sheet.score, settled, sheet.scored, "score")
    if possible is not None and possible < (interval.most if interval else ledger.amount):
        possible = None
    return Priced("scored", ledger, task, possible, assumptions, "", interval)


def _of_known_work(settled: Settled, digits: int, left_open: LeftOpen) -> str:
    """Why no number bounds a score of which not all the work is known, and what is known all the same."""
    if not settled.is_bounded:
        return f"{left_open.work_open}; {settled.unbounded}"
    least, most = settled.ends(digits)
    ends = f"{least.normalize():f} and {most.normalize():f}"
    return f"{left_open.work_open}; of what is known, it lies between {ends}"


def value_of(
    findings: Mapping[str, Finding],
    scopes: Scope,
    sheet: ScoreSheet,
    policies: Mapping[str, str],
    *,
    cohort: CohortValues | None = None,
    measures: Mapping[str, Mapping[str, Measure]] | None = None,
    left_open: LeftOpen = NOTHING_OPEN,
) -> Number | None:
    """The number that `price` rounds to the score; `None` when there is none.

    Raises:
        FormulaError: It has no value here.
    """
    assumed = assume(findings, policies, priced=sheet.scored)
    scored = _open_in(sheet.scored, sheet.score, sheet, left_open)
    if assumed.withheld:
        return None
    if assumed.zeroed:
        return 0
    cohort, measures = cohort or CohortValues(), measures or {}
    variables = _variables(findings, assumed, left_open, scored, policies, measures, cohort)
    if not variables:
        return sheet.evaluate(scopes, assumed.findings, cohort).value
    maker = _Maker(scopes, sheet, assumed, variables, cohort, measures, 9, left_open.counts)
    settled = maker.settled(sheet.score, scored, maker.cohort)
    if not settled.is_bounded or maker.is_withheld(sheet.scored, settled):
        return None
    return settled.value


def counted_world(
    findings: Mapping[str, Finding],
    scopes: Scope,
    sheet: ScoreSheet,
    policies: Mapping[str, str],
    *,
    cohort: CohortValues,
    measures: Mapping[str, Mapping[str, Measure]],
    left_open: LeftOpen,
) -> CountedWorld:
    """The world whose score counts; what was seen where nothing is open.

    What a rule set has a policy for stays undecided in it.

    Raises:
        FormulaError: The score has no value.
    """
    assumed = assume(findings, policies, priced=sheet.scored)
    scored = _open_in(sheet.scored, sheet.score, sheet, left_open)
    variables = _variables(findings, None, left_open, scored, policies, measures, cohort)
    if not variables:
        return CountedWorld(findings, scopes)
    maker = _Maker(scopes, sheet, assumed, variables, cohort, measures, 0, left_open.counts)
    settled = maker.settled(sheet.score, scored, cohort)
    seen = {key for one in variables for key in one.seen}
    return CountedWorld(
        {
            **{key: f for key, f in findings.items() if key not in seen},
            **{key: f for key, f in settled.findings.items() if key in seen or key not in findings},
        },
        settled.trial,
    )


def ends_of_term(
    name: str,
    findings: Mapping[str, Finding],
    scopes: Scope,
    sheet: ScoreSheet,
    policies: Mapping[str, str],
    *,
    measures: Mapping[str, Mapping[str, Measure]],
    left_open: LeftOpen,
) -> tuple[float, float]:
    """Between what a term of the trial lies; infinite where nothing bounds it.

    Raises:
        FormulaError: It has no value.
    """
    assumed, formula = assume(findings, policies, priced=sheet.scored), sheet.terms[TRIAL][name]
    used = _open_in(sheet.checks_in(formula), formula, sheet, left_open)
    variables = _variables(findings, assumed, left_open, used, policies, measures, None)
    worlds = Worlds(sheet, formula, scopes, assumed.findings, variables, CohortValues(), measures)
    return worlds.end(least=True).value, worlds.end(least=False).value


def _beyond(sheet: ScoreSheet) -> frozenset[str]:
    """What another run may have done more of than is known."""
    return frozenset(f"{OF_RUNS}{name}" for name in sheet.pooled)


def _variables(
    findings: Mapping[str, Finding],
    assumed: Assumed | None,
    left_open: LeftOpen,
    used: frozenset[str],
    policies: Mapping[str, str],
    measures: Mapping[str, Mapping[str, Measure]],
    cohort: CohortValues | None,
) -> list[Variable]:
    """What is open of some checks, and priced in the worlds that it leaves possible.

    Of a check whose undecided findings count as the rules say, that is what leaves none: a gap that is too
    short to be a finding of its own hides something all the same.
    """
    ruled = frozenset(check for check in used if policies.get(check, OPEN) in ("worst_case", "zero"))
    open_checks = frozenset(check for check in used if policies.get(check, OPEN) in (OPEN, "withhold"))
    undecided = {(f.check, f.subject) for f in findings.values() if f.verdict is Verdict.INCONCLUSIVE}
    opened = tuple(
        one
        for one in left_open.findings
        if one.check not in ruled or (one.check, one.subject) not in undecided
    )
    brief = ruled & {one.check for one in opened}
    given = findings if assumed is None else assumed.findings
    given = {
        key: f for key, f in given.items() if f.check not in brief or f.verdict is not Verdict.INCONCLUSIVE
    }
    return variables_of(given, replaced(left_open, findings=opened), open_checks | brief, measures, cohort)


def _open_in(
    used: frozenset[str], formula: Expression | None, sheet: ScoreSheet, left_open: LeftOpen
) -> frozenset[str]:
    """What a formula uses that may be open: its checks, `DURATION` where it names that, and its `runs.…`."""
    if formula is None:
        return used
    if left_open.lasted is not None:
        used |= sheet.facts_in(formula) & {DURATION}
    return used | {f"{OF_RUNS}{name}" for name in sheet.pooled if formula is sheet.score}


def _ends_in_words(name: str, least: float, most: float) -> str:
    """Between what something lies; empty where nothing bounds it.

    >>> _ends_in_words("kits", 2, 2.5), _ends_in_words("penalties", 0, float("inf"))
    ('kits 2 to 2.5', 'penalties at least 0')
    """
    one = Decimal(1).scaleb(-_SAID_DIGITS)
    low, high = (
        f"{Decimal(repr(float(end))).quantize(one, rounding=outward).normalize() + 0:f}"
        if isfinite(end)
        else ""
        for end, outward in ((least, ROUND_FLOOR), (most, ROUND_CEILING))
    )
    if low and high:
        return f"{name} {low}" if low == high else f"{name} {low} to {high}"
    return f"{name} at least {low}" if low else f"{name} at most {high}" if high else ""


def _withheld(assumed: Assumed, used: frozenset[str]) -> bool:
    return any(assumption.check in used for assumption in assumed.withheld)


@dataclass(frozen=True)
class _Maker:
    """Makes score and task score of one trial, each in the world that counts."""

    scopes: Scope
    sheet: ScoreSheet
    assumed: Assumed
    variables: list[Variable]
    cohort: CohortValues
    measures: Mapping[str, Mapping[str, Measure]]
    digits: int
    counts: str

    def settled(self, formula: Expression, used: frozenset[str], cohort: CohortValues) -> Settled:
        """A formula in the world that counts, and its ends in all others."""
        inside = [one for one in self.variables if one.check in used]
        worlds = Worlds(
            self.sheet, formula, self.scopes, self.assumed.findings, inside, cohort, self.measures
        )
        return settle(worlds, counts=self.counts)

    def bounds_all(self, used: frozenset[str]) -> bool:
        """Whether the score has both ends, whatever other teams do: with 1 for each value across teams."""
        paths = [scope.path for scope in self.scopes.walk()]
        ones = {name: dict.fromkeys(paths, 1.0) for name in self.sheet.cohort}
        try:
            settled = self.settled(self.sheet.score, used, CohortValues(values=ones))
        except FormulaError:
            return False
        return settled.is_bounded and not self.is_withheld(self.sheet.scored, settled)

    def without_bound(self, settled: Settled, used: frozenset[str]) -> str:
        """Why no number bounds a score on one side, its other side, and between what its terms lie."""
        terms = list(dict.fromkeys(self._said_of_terms(self.sheet.score, used, {})))
        if not terms:
            return settled.unbounded
        score = _ends_in_words("the score", settled.least.value, settled.most.value)
        return f"{settled.unbounded}; what is known: {', '.join([score, *terms] if score else terms)}"

    def _said_of_terms(
        self, formula: Expression, used: frozenset[str], seen: dict[str, None]
    ) -> Iterator[str]:
        """The ends of the terms that a formula names; of one that lacks an end, those of its own terms."""
        terms = self.sheet.terms.get(self.scopes.level, {})
        named = [node for node in formula.walk() if isinstance(node, ast.Name) and node.id in terms]
        for name in [node.id for node in sorted(named, key=lambda node: (node.lineno, node.col_offset))]:
            if name in seen:
                continue
            seen[name] = None
            inside = [one for one in self.variables if one.check in used]
            worlds = Worlds(
                self.sheet,
                terms[name],
                self.scopes,
                self.assumed.findings,
                inside,
                self.cohort,
                self.measures,
            )
            try:
                least, most = (
                    worlds.end(least=end, most_tried=_TRIED_FOR_WORDS).value for end in (True, False)
                )
            except FormulaError:
                continue
            inner = (
                [] if isfinite(least) and isfinite(most) else [*self._said_of_terms(terms[name], used, seen)]
            )
            said = _ends_in_words(name, least, most)
            yield from inner if len(inner) > 1 else [said] if said else []

    def counts_of(self, used: frozenset[str]) -> str:
        return "withhold" if _withheld(self.assumed, used) else self.counts

    def is_withheld(self, used: frozenset[str], settled: Settled) -> bool:
        open_ = self.counts == "withhold" and interval_of(settled, self.digits, self.counts) is not None
        return _withheld(self.assumed, used) or open_

    def is_zeroed(self, used: frozenset[str]) -> bool:
        return any(assumption.check in used for assumption in self.assumed.zeroed)

    def ledger(self, formula: Expression, settled: Settled, used: frozenset[str], root: str) -> Ledger:
        cohort = self.cohort.at(settled.pins)
        tree = tree_of(self.sheet, formula, settled.trial, settled.findings, cohort, self.measures)
        undecided = [assumption.finding for assumption in self.assumed.assumptions]
        ledger = make_ledger(
            tree, settled.traced, settled.findings, digits=self.digits, root=root, undecided=undecided
        )
        return _zeroed(_bounded(ledger, settled.amount(self.digits)), self.assumed, used)

    def task(self, used: frozenset[str]) -> Ledger | None:
        task = self.sheet.task
        if task is None or _withheld(self.assumed, used):
            return None
        try:
            settled = self.settled(task, used, CohortValues())
        except UnknownFactError:
            return None
        if not settled.is_bounded or self.is_withheld(used, settled):
            return None
        return self.ledger(task, settled, used, "task")

    def assumptions(self, settled: Settled | None) -> tuple[Assumption, ...]:
        """What was made of everything undecided, in order of finding id."""
        made = {assumption.finding: assumption for assumption in self.assumed.assumptions}
        decided = settled is not None and settled.is_bounded
        for one in self.variables:
            seen = {key: self.assumed.findings[key] for key in one.seen}
            open_ones = {k: f for k, f in seen.items() if f.verdict is Verdict.INCONCLUSIVE} or seen
            at_worst = settled is None or settled.pins.get(one.key, self.counts != "best")
            policy = "worst" if at_worst else "best"
            if not decided or self.counts == "withhold":
                policy = "withhold"
            for key, finding in open_ones.items():
                made.setdefault(key, Assumption(key, one.check, policy, finding.message))
        return tuple(made[key] for key in sorted(made))


def _bounded(ledger: Ledger, score: Decimal) -> Ledger:
    """The ledger of a world, with a line for what the bound lies beyond it."""
    beyond = score - ledger.amount
    if not beyond:
        return ledger
    line = Line(
        f"{ledger.path}/bound",
        "not seen, bounded: several worlds are possible, and no single one is at the bound",
        "amount",
        beyond,
        0,
    )
    before = replace(ledger, path=f"{ledger.path}/before")
    return Line(ledger.path, ledger.label, "sum", score, float(score), children=(before, line))


def _possible(
    best: Mapping[str, Finding], scopes: Scope, sheet: ScoreSheet, cohort: CohortValues, digits: int
) -> Decimal | None:
    """The best score; `None` where better findings would bring numbers that nobody measured."""
    if sheet.needs_cohort:  # a faster run is not among the findings, and would move the means as well
        return None
    try:
        calm = cohort.at(dict.fromkeys(cohort.open_runs, False))
        return rounded(sheet.evaluate(scopes, best, calm).value, digits)
    except FormulaError:
        return None


def _zeroed(ledger: Ledger, assumed: Assumed, used: frozenset[str]) -> Ledger:
    """The ledger, with a line that takes everything where the rule set gives 0 for what is undecided."""
    zeroed = tuple(assumption.finding for assumption in assumed.zeroed if assumption.check in used)
    if not zeroed:
        return ledger
    reasons = ", ".join(zeroed)
    taken = Line(
        f"{ledger.path}/undecided",
        f"undecided, so the rule set gives 0: {reasons}",
        "factor",
        -ledger.amount,
        0,
        findings=zeroed,
    )
    # Not Decimal(0): a difference keeps the declared digits, which the ledger shows.
    zero = ledger.amount - ledger.amount
    before = replace(ledger, path=f"{ledger.path}/before")
    return Line(ledger.path, ledger.label, "sum", zero, 0, children=(before, taken))
