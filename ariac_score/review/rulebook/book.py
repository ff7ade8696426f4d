"""The rulebook of a rule set: what a referee reads, made from the rules, their plugins and made trials.

Prices come from tables and named numbers, costs and examples from pricing made trials, tolerances from
the plugins: nothing is stated here a second time.
"""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from ariac_score.checks.contracts import Monitor
from ariac_score.checks.findings import COUNT, POINTS
from ariac_score.checks.measures import Measure, measures_of
from ariac_score.checks.parameters import parameter_meanings, sections_of
from ariac_score.checks.registry import Registry
from ariac_score.engine.prepared import Prepared, prepare
from ariac_score.engine.settings import settings_of
from ariac_score.errors import FormulaError
from ariac_score.review.laws.cases import Case, Violation
from ariac_score.review.laws.proving import bridged_pauses, event_checks
from ariac_score.review.proofs.proving import Judged, prove
from ariac_score.review.proofs.subject import subject_of_rules
from ariac_score.review.proofs.words import exploit_in_words
from ariac_score.review.rulebook.blocks import (
    Block,
    Bullets,
    Curve,
    Grid,
    Number,
    Rulebook,
    Section,
    Text,
    code,
    figure,
    in_words,
    with_unit,
)
from ariac_score.review.rulebook.formulas import Speaker, quoted
from ariac_score.review.rulebook.made import PARTS, Made, Step, place_in_words, violation
from ariac_score.scoring.expression import Expression
from ariac_score.scoring.forms import OTHERWISE, Table, is_block
from ariac_score.scoring.levels import TRIAL
from ariac_score.scoring.ruleset import RuleSet
from ariac_score.trial.words import Words

__all__ = ["CASES", "rulebook"]

_STEPS = 150
"""Tries to make a counter-example plainer."""

CASES = 40
"""Random trials for each law: a page is made in seconds; `rules check` tries more."""

_LENGTHS_S = (0, 0.1, 1, 2, 3, 5, 7, 10, 15, 20, 25, 30)
_TIMES = (0, 1, 2, 3, 4, 5, 6)
_LONG_S = 10
_LITTLE = 0.2
"""An example that leaves less of what the work is worth shows nothing."""

_DIFF = "DIFF"
_OPEN = {
    "worst": "The least score that is possible counts; what would be possible at best is shown beside it.",
    "best": "The greatest score that is possible counts; what would be possible at worst is shown beside it.",
    "withhold": "There is no score unless it is the same whatever happened; least and greatest are shown.",
}
_UNSEEN = {
    "open": "",
    "withhold": "There is no score until it is known.",
    "zero": "The trial scores 0.",
    "worst_case": "It counts as a critical violation, at full depth for all of the time that was not seen.",
    "exclude": "It is left out, as if it had not been looked at.",
}


def rulebook(rules: str | RuleSet, registry: Registry | None = None) -> Rulebook:
    """The rulebook of a rule set.

    Raises:
        PluginError: A plugin of the rule set is not installed or broken.
        RuleSetError: There is no such rule set, or a plugin refuses its parameters.
    """
    book = _Book(prepare(rules, registry=registry or Registry()))
    sections = (
        book.in_short(),
        book.earned(),
        book.costs(),
        book.examples(),
        book.looked_at(),
        book.tolerances(),
        book.formulas(),
        book.unseen(),
        book.differences(),
        book.notes(),
        book.ranking(),
        book.laws(),
    )
    rule_set = book.rules
    return Rulebook(
        rule_set.id,
        rule_set.title,
        rule_set.source,
        rule_set.sha256,
        tuple(section for section in sections if section.blocks),
    )


@dataclass(frozen=True)
class _Book:
    """A rule set with what its sections are made of."""

    prepared: Prepared

    @property
    def rules(self) -> RuleSet:
        """The rule set."""
        return self.prepared.rule_set

    @cached_property
    def words(self) -> Words:
        """The words of its competition."""
        return self.prepared.words

    @cached_property
    def events(self) -> frozenset[str]:
        """Its monitors of single events."""
        return event_checks(self.rules, self.prepared.registry)

    @cached_property
    def speaker(self) -> Speaker:
        """Says its formulas."""
        return Speaker(
            self.rules.parameters,
            frozenset(self.rules.checks),
            self.words,
            self.rules.sheet.levels[0],
            self.measures,
        )

    @cached_property
    def measures(self) -> Mapping[str, Mapping[str, Measure]]:
        """What its checks measure, by their names."""
        return {name: measures_of(each.check) for name, each in self.prepared.checks.items()}

    @cached_property
    def made(self) -> Made:
        """Trials made for it."""
        bridged = bridged_pauses(self.rules, self.prepared.registry)
        competition = self.prepared.competition
        parts = getattr(competition.check, "usual_items", PARTS) if competition else PARTS
        return Made(self.rules, self.events, bridged, self.measures, parts)

    @cached_property
    def alone(self) -> Made:
        """The same, worth what it is before teams are compared: a point is a point there."""
        task = self.rules.expanded.get("task")
        if not self.rules.sheet.needs_cohort or task is None:
            return self.made
        return replace(self.made, rule_set=self.rules.with_score(str(task)))

    @cached_property
    def directions(self) -> dict[str, int]:
        """Which named numbers earn points (1), which cost some (-1), which do neither."""
        named = self.rules.sheet.parameters_named()
        return {name: self.made.direction(name) if name in named else 0 for name in self.rules.parameters}

    # In short --------------------------------------------------------------------------

    def in_short(self) -> Section:
        rules, trial = self.rules, self.words.one(TRIAL)
        said = [f"The score of a {trial} is {self.speaker.says(rules.sheet.score)}."]
        if rules.sheet.needs_cohort:
            said.append("It depends on all teams, so it is known when all of them have run.")
        if rules.sheet.task is not None:
            said.append(
                f"Before teams are compared, a {trial} is worth {self.speaker.says(rules.sheet.task)}."
            )
        inner = self.words.of_work
        if inner:
            chain = ", ".join(f"each {self.words.one(level)}" for level in inner)
            said.append(f"It is made from the inside out: {chain}, the {trial}.")
        digits = "a whole number" if rules.digits == 0 else f"{rules.digits} decimal digits"
        said.append(f"It is rounded to {digits}.")
        said.append(f"{quoted('Such words')} are names, explained below.")
        return Section("In short", (Bullets(tuple(said)),))

    # What earns points -----------------------------------------------------------------

    def earned(self) -> Section:
        tables = [self._table(table) for table in self._tables()]
        prices = self._named("What it is worth", 1)
        others = self._grid_of("More numbers in points, which no made trial meets", self._unmet)
        return Section("What earns points", (*tables, *prices, *others))

    @cached_property
    def _unmet(self) -> list[str]:
        """The prices that no made trial shows the direction of."""
        return [
            name
            for name, one in self.rules.parameters.items()
            if one.unit == POINTS and not self.directions[name]
        ]

    def _tables(self) -> list[Table]:
        used = {formula.where for formula in self.rules.sheet.reached(self.rules.sheet.score)}
        return [
            table
            for table in self.rules.tables
            if any(f"$.terms.{table.level}.{column}" in used for column in table.columns)
        ]

    def _table(self, table: Table) -> Grid:
        rows = tuple(
            (row.name, _ways(row.when), *(self._worth(row.worth[column]) for column in table.columns))
            for row in table.rows
        )
        head = tuple(map(in_words, table.columns)) if len(table.columns) > 1 else ("points",)
        one = self.words.one(table.level)
        caption = f"{_capital(in_words(table.name))}: exactly one row applies to each {one}"
        return Grid(caption, ("", "when", *head), rows, frozenset(range(2, 2 + len(head))))

    def _worth(self, formula: str) -> str:
        parsed = Expression.parse(formula)
        value = _constant(parsed, self.rules.sheet.parameters)
        return self.speaker.says(parsed) if value is None else figure(value)

    def _named(self, caption: str, direction: int) -> Iterator[Grid]:
        return self._grid_of(caption, [name for name, way in self.directions.items() if way == direction])

    def _grid_of(self, caption: str, names: Sequence[str]) -> Iterator[Grid]:
        """Named numbers as a table, if there are any; their groups only where there are some."""
        named = [(name, self.rules.parameters[name]) for name in names]
        rows = [(_capital(in_words(n)), with_unit(o.value, o.unit), o.meaning, _group(n)) for n, o in named]
        width = 4 if any(group for *_, group in rows) else 3
        head = ("", "number", "meaning", "of")[:width]
        if rows:
            yield Grid(caption, head, tuple(row[:width] for row in rows), frozenset({1}))

    # What costs points -----------------------------------------------------------------

    def costs(self) -> Section:
        blocks: list[Block] = [*self._named("Prices of mistakes", -1)]
        for kind in self.made.kinds:
            blocks += self._mistakes(kind)
        blocks += self._violations()
        return Section("What costs points", tuple(blocks))

    def _mistakes(self, kind: str) -> Iterator[Grid]:
        whole = self.alone.score(self.alone.perfect(kind))
        if whole is None:
            return
        rows = []
        for check, case in self.alone.mistakes(kind):
            score = self.alone.score(case)
            level = self.alone.world.levels[check]
            if score is not None and score != whole:
                what = f"{quoted(check)} violated for one {self.words.one(level)}"
                rows.append((what, figure(score), figure(score - whole)))
        if rows:
            of = f" of kind {quoted(kind)}" if kind else ""
            compared = " before teams are compared" if self.alone is not self.made else ""
            worth = f"worth {figure(whole)} when all is right{compared}"
            caption = f"One mistake in {self._a_trial()}{of} that is {worth}"
            yield Grid(caption, ("mistake", "then worth", "change"), tuple(rows), frozenset({1, 2}))

    def _a_trial(self) -> str:
        inner = self.words.of_work
        if not inner:
            return f"a made {self.words.one(TRIAL)}"
        parts, word = self.made.parts, self.words
        of = word.one(inner[0]) if parts == 1 else word.many(inner[0])
        return f"a made {word.one(inner[-1])}" + (f" with {parts} {of}" if len(inner) > 1 else "")

    def _violations(self) -> Iterator[Block]:
        case = self._worth_something()
        whole = self.alone.score(case)
        if not self.alone.world.safety or whole is None:
            return
        rows, curves, silent = [], [], []
        for check in self.alone.world.safety:
            row = [self._change(case, whole, check, times) for times in (1, 2)]
            long = "" if check in self.events else self._change(case, whole, check, 1, _LONG_S)
            if {*row, long} <= {"", "0"}:
                silent.append(check)
                continue
            rows.append((quoted(check), *row, long))
            curves.append(self._curve(case, check))
        if rows:
            head = ("violated", "once", "twice", f"for {_LONG_S} s")
            yield Grid(
                f"What violations take from {self._a_trial()} that is worth {figure(whole)} without them "
                "(each as deep as it can be; one that is not of a moment lasts 1 s)",
                head,
                tuple(rows),
                frozenset({1, 2, 3}),
            )
        yield from _merged(curve for curve in curves if curve is not None)
        if silent:
            yield Text(f"Violations of {_listed(silent)} take nothing here.")

    def _worth_something(self) -> Case:
        """The kind of work that is worth the most, all of it right."""
        cases = [self.alone.perfect(kind) for kind in self.alone.kinds]
        return max(cases, key=lambda case: self.alone.score(case) or 0)

    def _change(self, case: Case, whole: Number, check: str, times: int, seconds: float = 1) -> str:
        happened = tuple(self._violation(check, 20 * n, seconds) for n in range(times))
        score = self.alone.score(replace(case, violations=happened))
        return "" if score is None else figure(score - whole, 4)

    def _violation(self, check: str, start_s: float, seconds: float) -> Violation:
        """A violation of a check, critical where its plugin says that each of them is."""
        length = 0 if check in self.events else seconds
        return violation(check, start_s, length, critical=self._is_critical(check))

    def _is_critical(self, check: str) -> bool:
        return getattr(self.prepared.checks[check].check, "critical", False) is True

    def _curve(self, case: Case, check: str) -> Curve | None:
        moments = check in self.events
        scores = []
        for x in _TIMES if moments else _LENGTHS_S:
            happened = (
                tuple(self._violation(check, 8 * n, 0) for n in range(int(x)))
                if moments
                else (self._violation(check, 0, x),) * (x > 0)
            )
            scores.append((float(x), self.alone.score(replace(case, violations=happened))))
        known = [(x, float(found)) for x, found in scores if found is not None]
        if len({score for _, score in known}) < 2:
            return None
        what = "violations" if moments else "seconds in violation"
        along, score = tuple(x for x, _ in known), tuple(score for _, score in known)
        return Curve(quoted(check), what, along, score, moments)

    # Examples --------------------------------------------------------------------------

    def examples(self) -> Section:
        blocks = [block for kind in self.made.kinds for block in self._example(kind)]
        return Section("Worked examples", tuple(blocks))

    def _example(self, kind: str) -> Iterator[Block]:
        perfect = self.made.perfect(kind)
        whole = self.made.score(perfect)
        if whole is None:
            return
        case, wrong = self._with_a_mistake(perfect, whole, kind)
        watched = [check for check in self.made.world.watched if self._curve(case, check)]
        watched.sort(key=self._is_critical)
        if watched:
            case = replace(case, violations=(self._violation(watched[0], 10, 3),))
            wrong = [*wrong, f"{quoted(watched[0])} is violated for 3 s, as deep as can be"]
        of = f" of kind {quoted(kind)}" if kind else ""
        happened = _capital("; ".join(wrong) or "all is right")
        yield Text(f"{_capital(self._a_trial())}{of}. {happened}.{self._measured()}")
        rows = tuple(self._row(step) for step in self.made.steps(case))
        yield Grid(
            f"Example{of}: every line uses those above it",
            ("", "of", "calculation", "gives"),
            rows,
            frozenset({3}),
        )

    def _with_a_mistake(self, perfect: Case, whole: Number, kind: str) -> tuple[Case, list[str]]:
        """The case with the mistake that costs the least, and what it is in words."""
        found = []
        for check, case in self.made.mistakes(kind):
            score = self.made.score(case)
            counted = any(function == "count" for _, function in self.made.world.uses[check])
            if score is not None and _LITTLE * whole < score < whole and not counted:
                found.append((whole - score, check, case))
        if not found:
            return perfect, []
        _, check, case = min(found, key=lambda one: one[:2])
        subject = next(s for c, s in sorted(case.failed - perfect.failed) if c == check)
        where = place_in_words(subject, self._one) or f"the {self.words.one(TRIAL)}"
        return case, [f"{quoted(check)} is violated for {where}"]

    def _measured(self) -> str:
        """The numbers that a made trial measures, in words."""
        said: dict[str, list[str]] = {}
        for key, value in self.made.perfect().numbers.items():
            check, _, name = key.rpartition(".")
            declared = self.made.measures.get(check, {}).get(name)
            unit = declared.unit if declared else ""
            amount = figure(value) if in_words(name) == unit or unit == COUNT else with_unit(value, unit)
            said.setdefault(check, []).append(f"{in_words(name)} {amount}")
        by = "; ".join(f"by {quoted(check)} {', '.join(each)}" for check, each in said.items())
        others = " Means over all teams are a fifth above its own." if self.rules.sheet.needs_cohort else ""
        return f" Measured {by}.{others}" if said else ""

    @cached_property
    def _one(self) -> dict[str, str]:
        return {level: self.words.one(level) for level in self.words.levels}

    def _row(self, step: Step) -> tuple[str, ...]:
        where = [place_in_words(path, self._one) for path in step.paths]
        of = ", ".join(name for name in where if name) or f"the {self.words.one(TRIAL)}"
        return (_capital(in_words(step.term)), of, step.how, figure(step.value))

    # What is looked at, tolerances -----------------------------------------------------

    def looked_at(self) -> Section:
        uses: dict[str, list[str]] = {}
        for name, check in self.rules.checks.items():
            uses.setdefault(check.use, []).append(name)
        rows = []
        for use, names in uses.items():
            each = self.prepared.checks[names[0]].check
            asks, when = _docstring(type(each))
            kind = "monitor" if isinstance(each, Monitor) else "rule"
            looked = "; ".join(self._variant(name, names) for name in names)
            rows.append((_capital(looked), asks, when, f"{kind} {code(use)}"))
        unpriced = [name for name in self.rules.checks if name not in self.rules.sheet.priced]
        blocks: list[Block] = []
        if rows:
            blocks.append(Grid("", ("check", "what it asks", "violated when", "plugin"), tuple(rows)))
        if unpriced:
            blocks.append(Text(f"Looked at and shown, but without effect on the score: {_listed(unpriced)}."))
        return Section("What is looked at", tuple(blocks))

    def _variant(self, name: str, names: Sequence[str]) -> str:
        """A check, and what it is given that others of its plugin are given otherwise."""
        given = [self.rules.checks[each].parameters for each in names]
        own = {
            key: value
            for key, value in self.rules.checks[name].parameters.items()
            if isinstance(value, str) and any(each.get(key) != value for each in given)
        }
        said = ", ".join(f"{in_words(key)}: {_setting(value, '')}" for key, value in own.items())
        return f"{quoted(name)} ({said})" if said else quoted(name)

    def tolerances(self) -> Section:
        neither = {
            name: one
            for name, one in self.rules.parameters.items()
            if not self.directions[name] and name not in self._unmet
        }
        used_by = {
            name: [c.name for c in self.rules.checks.values() if name in c.named.values()] for name in neither
        }
        rows = tuple(
            (
                f"{_capital(_group(name))}: {in_words(name)}" if _group(name) else _capital(in_words(name)),
                with_unit(one.value, one.unit),
                one.meaning,
                ", ".join(map(quoted, used_by[name])),
            )
            for name, one in neither.items()
        )
        grids = [
            Grid(
                "Numbers that have a name in these rules",
                ("", "number", "meaning", "used by"),
                rows,
                frozenset({1}),
            ),
            Grid(
                "Settings of the checks",
                ("check", "setting", "value", "meaning", "chosen by"),
                tuple(self._settings()),
                frozenset({2}),
            ),
        ]
        return Section("Tolerances and settings", tuple(grid for grid in grids if grid.rows))

    def _settings(self) -> Iterator[tuple[str, str, str, str, str]]:
        """What is in force: everything given, and every number with a unit; alike ones in one row."""
        found: dict[tuple[str, str, str, str], list[str]] = {}
        for check, settings in settings_of(self.prepared).items():
            if check not in self.rules.sheet.priced:
                continue
            meanings = parameter_meanings(type(self.prepared.checks[check].check))
            for each in settings.parameters:
                named = each.name in self.rules.checks[check].named
                given = each.origin == "rule_set" and each.value is not None
                if named or not (given or each.unit not in ("", "1")):
                    continue
                because = {
                    "rule_set": "these rules",
                    "derived": "follows from others",
                    "default": "; ".join(filter(None, ("its plugin", each.source))),
                }[each.origin]
                value = _setting(each.value, each.unit)
                key = (_capital(in_words(each.name)), value, meanings.get(each.name, ""), because)
                found.setdefault(key, []).append(check)
        for row, checks in found.items():
            yield (", ".join(map(quoted, checks)), *row)

    # How the score is made -------------------------------------------------------------

    def formulas(self) -> Section:
        blocks: list[Block] = []
        rows = []
        for level in self.rules.sheet.levels:
            of = f"each {self.words.one(level)}" if level != TRIAL else f"the {self.words.one(TRIAL)}"
            for name, kind, source in self._stated(level):
                formula = Expression.parse(source, texts=True)
                label = f"{of}, {in_words(kind)}" if kind else of
                rows.append(
                    (_capital(in_words(name)), label, self.speaker.says(formula), code(formula.source))
                )
        for name, term in self.rules.sheet.cohort.items():
            where = f", of teams for which {self.speaker.condition(term.where)}" if term.where else ""
            rows.append(
                (
                    _capital(in_words(name)),
                    "all teams",
                    f"the mean of {self.speaker.says(term.value)}{where}",
                    code(term.value.source),
                )
            )
        score = self.rules.sheet.score
        rows.append(("Score", f"the {self.words.one(TRIAL)}", self.speaker.says(score), code(score.source)))
        kinds: Mapping[str, str] = self.rules.expanded.get("kinds", {})
        if kinds:
            said = [f"{in_words(kind)}: {self._asked(when)}" for kind, when in kinds.items()]
            blocks.append(Text(f"Kinds of work, the first that applies: {'; '.join(said)}."))
        blocks.append(Grid("From the inside out", ("", "of", "in words", "as written"), tuple(rows)))
        facts = tuple(
            (f"{in_words(name)} of the {self.words.one(level)}", with_fact(fact.unit), fact.meaning)
            for level in self.rules.sheet.levels
            for name, fact in self.rules.sheet.facts_of(level).items()
            if f"{level}.{name}" in self.rules.sheet.facts_in(score)
        )
        if facts:
            blocks.append(Grid("What is taken from the record as it is", ("", "unit", "meaning"), facts))
        return Section("How the score is made", tuple(blocks))

    def _asked(self, when: str) -> str:
        if when == OTHERWISE:
            return "everything else"
        return f"where {self.speaker.condition(Expression.parse(when, texts=True))}"

    def _stated(self, level: str) -> Iterator[tuple[str, str, str]]:
        """The terms of a level as the file has them: name, kind of task, formula; tables are shown above."""
        for name, body in self.rules.expanded.get("terms", {}).get(level, {}).items():
            if is_block(body):
                for inner, formula in body.items():
                    if not isinstance(formula, Mapping):
                        yield inner, name, str(formula)
            elif not isinstance(body, Mapping):
                yield name, "", str(body)

    # What is not seen, differences, notes ----------------------------------------------

    def unseen(self) -> Section:
        priced = [c for c in self.rules.checks.values() if c.name in self.rules.sheet.priced]
        rows = tuple(
            (
                words or _OPEN[self.rules.counts],
                _listed([c.name for c in priced if c.on_inconclusive == policy]),
            )
            for policy, words in _UNSEEN.items()
            if any(c.on_inconclusive == policy for c in priced)
        )
        if not rows:
            return Section("What is not seen")
        text = (
            "What a log does not show is never taken for kept, nor for violated. Where a check needs what "
            "is not there, this happens:"
        )
        return Section("What is not seen", (Text(text), Grid("", ("then", "for"), rows)))

    def differences(self) -> Section:
        blocks: list[Block] = []
        noted = tuple(_without_mark(note) for note in self.rules.notes if note.startswith(_DIFF))
        if noted:
            blocks.append(Bullets(noted))
        stated = self.rules.differs
        if stated:
            rows = tuple(
                (_capital(in_words(one.name)), one.coded, one.documented, one.source)
                for one in stated.because
            )
            caption = f"Where these rules and {code(stated.other)} differ"
            blocks.append(Grid(caption, ("", "as coded", "as documented", "source"), rows))
        printed = self.rules.printed
        reasons = [(item.name, item.because) for item in printed.items]
        reasons += [(each.name, each.because) for each in printed.sums]
        because = tuple(
            dict.fromkeys(f"{_capital(in_words(name))}: {words}" for name, words in reasons if words)
        )
        if because:
            blocks.append(Text("In what the official programs print:"))
            blocks.append(Bullets(because))
        return Section("Where it differs from the official text", tuple(blocks))

    def notes(self) -> Section:
        others = tuple(note for note in self.rules.notes if not note.startswith(_DIFF))
        return Section("What else to know", (Bullets(others),) if others else ())

    def ranking(self) -> Section:
        stated = self.rules.ranking
        rows = tuple((_capital(in_words(key)), _setting(value, "")) for key, value in stated.items())
        return Section("From runs to a ranking", (Grid("", ("", ""), rows),) if rows else ())

    # Laws ------------------------------------------------------------------------------

    def laws(self) -> Section:
        subject = subject_of_rules(self.rules, self.prepared.registry)
        # Without a solver, so that the page does not hang on whether one is installed.
        judged = prove(subject, cases=CASES, steps=_STEPS)
        rows = tuple((_capital(one.law.says), _fared(one), self._because(one)) for one in judged)
        text = (
            "Whether the score is fair. What is proven holds in every trial there can be; the rest was tried "
            f"on {CASES} random trials, and where one breaks a law, what a team can make of it is shown. "
            f"{code(f'ariac-score rules prove {self.rules.id}')} tries more and gives the reasons."
        )
        return Section("Laws", (Text(text), Grid("", ("law", "", "because"), rows)))

    def _because(self, judged: Judged) -> str:
        exploit = exploit_in_words(judged, self.rules.sheet.levels)
        if judged.declared:
            return f"{judged.declared}. {_capital(exploit)}" if exploit else judged.declared
        return exploit or (judged.because[0] if judged.verdict != "proven" else "")


def _fared(judged: Judged) -> str:
    if judged.verdict == "open" and judged.declared:
        return "does not always hold"  # the file says so, and knows more than a few trials
    verdicts = {
        "proven": "proven",
        "refuted": "does not hold",
        "not_applicable": "does not apply",
        "open": "not proven; no counter-example found",
    }
    return verdicts[judged.verdict]


def _constant(formula: Expression, parameters: Mapping[str, Number]) -> Number | None:
    """The number that a formula of named numbers alone is; `None` for any other."""
    try:
        return float(formula.columns({**parameters, "": 0}))
    except FormulaError:
        return None


def _ways(when: Sequence[Mapping[str, str]]) -> str:
    said = [
        " and ".join(f"{quoted(check)} {'kept' if word == 'holds' else word}" for check, word in one.items())
        for one in when
    ]
    return "; or ".join(said) if said else "in every other case"


def _docstring(kind: type) -> tuple[str, str]:
    """What a plugin asks, and when that is violated, in its own words."""
    text = inspect.cleandoc(kind.__doc__ or "") + "\n"
    violated = " ".join(sections_of(kind).get("Violated when", "").split())
    return " ".join(text.partition("\n\n")[0].split()), violated


def _setting(value: object, unit: str) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return with_unit(value, unit)
    if isinstance(value, Mapping):
        return ", ".join(f"{in_words(str(key))} {_setting(inner, unit)}" for key, inner in value.items())
    if isinstance(value, list | tuple):
        return ", ".join(_setting(inner, unit) for inner in value)
    return in_words(str(value)) if str(value).isidentifier() else code(value)


def with_fact(unit: str) -> str:
    """The unit of a fact; nothing for a number without."""
    return "" if unit == "1" else unit


def _without_mark(note: str) -> str:
    return _capital(note.removeprefix(_DIFF).lstrip(": "))


def _group(name: str) -> str:
    return in_words(name.rpartition(".")[0])


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(quoted, names))


def _capital(words: str) -> str:
    return words[:1].upper() + words[1:]


def _merged(curves: Iterator[Curve]) -> Iterator[Curve]:
    """Curves, those of checks that cost the same in one."""
    alike: dict[tuple[object, ...], list[Curve]] = {}
    for curve in curves:
        alike.setdefault((curve.what, curve.x, curve.score), []).append(curve)
    for same in alike.values():
        yield replace(same[0], title=", ".join(curve.title for curve in same))
