"""The rulebook of a rule set: what a referee reads, made from the rule set and from trials made for it.

Nothing here knows a formula: prices come from tables and parameters, costs from scoring made trials.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from ariac_score.checks.registry import Registry, parameters_of
from ariac_score.errors import FormulaError
from ariac_score.review.laws.cases import TICKS_PER_S, Case, Violation, World
from ariac_score.review.laws.proving import Outcome, check_laws, event_checks
from ariac_score.scoring.expression import Expression, Number
from ariac_score.scoring.forms import OTHERWISE, Table
from ariac_score.scoring.levels import TRIAL
from ariac_score.scoring.named import NamedParameter
from ariac_score.scoring.ruleset import RuleSet

__all__ = ["Curve", "Grid", "Rulebook", "Section", "rulebook"]

CASES = 40
"""Random trials for each law: a page is made in seconds; `rules check` tries more."""

_PARTS = 3
"""Pieces of work in the trial that examples start from."""

_LENGTHS_S = (0, 1, 2, 5, 10, 20, 30)
_TIMES = (1, 2, 3)
_POINTS = ("points", "demerits")
_UNSEEN = {
    "withhold": "There is no score until it is known.",
    "zero": "The trial scores 0.",
    "worst_case": "It counts as one violation at full depth for all of the time that was not seen.",
    "exclude": "It is left out, as if it had not been looked at.",
}


@dataclass(frozen=True)
class Grid:
    """A table of a rulebook: its caption, head and rows, all as text."""

    caption: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


@dataclass(frozen=True)
class Curve:
    """What is left of the score for violations of one check that last longer and longer.

    Attributes:
        check: In words.
        seconds: How long one violation lasts, in s.
        left: What is left of the score, in percent.
    """

    check: str
    seconds: tuple[float, ...]
    left: tuple[float, ...]


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it: sentences, tables and curves, in this order."""

    title: str
    text: tuple[str, ...] = ()
    grids: tuple[Grid, ...] = ()
    curves: tuple[Curve, ...] = ()


@dataclass(frozen=True)
class Rulebook:
    """Everything that is printed.

    Attributes:
        id: Of the rule set.
        title: Its title.
        source: Where the rules come from.
        sections: In the order of the page.
    """

    id: str
    title: str
    source: str
    sections: tuple[Section, ...]


def rulebook(rule_set: RuleSet, registry: Registry) -> Rulebook:
    """The rulebook of a rule set.

    Raises:
        PluginError: A plugin of the rule set is not installed or broken.
        RuleSetError: A plugin refuses its parameters.
    """
    events = event_checks(rule_set, registry)
    made = _Made(_of_one_team(rule_set), events)
    sections = (
        _earned(rule_set),
        _costs(made),
        _examples(made),
        _tolerances(rule_set, registry),
        _unseen(rule_set),
        _differences(rule_set),
        _laws(rule_set, check_laws(rule_set, cases=CASES, events=events, smallest=False)),
        _formulas(rule_set),
    )
    return Rulebook(
        rule_set.id,
        rule_set.title,
        rule_set.source,
        tuple(one for one in sections if one.text or one.grids or one.curves),
    )


def _of_one_team(rule_set: RuleSet) -> RuleSet:
    """Rules that give a made trial a score: where teams are compared, those of the task."""
    task = rule_set.expanded.get("task")
    return rule_set.with_score(str(task)) if rule_set.sheet.needs_cohort and task else rule_set


def in_words(name: str) -> str:
    """A name of a rule set as words.

    >>> in_words("points.right_type")
    'points: right type'
    """
    return name.replace(".", ": ").replace("_", " ")


def _number(value: Number) -> str:
    return f"{value:.6g}" if abs(value) < 1e6 else f"{value:.0f}"


# What earns points ---------------------------------------------------------------------


def _earned(rule_set: RuleSet) -> Section:
    priced = {name: one for name, one in rule_set.parameters.items() if one.unit in _POINTS}
    prices = Grid(
        "Prices",
        ("", "", "what for"),
        tuple(
            (in_words(name), f"{_number(one.value)} {one.unit}", one.meaning) for name, one in priced.items()
        ),
    )
    tables = tuple(_as_grid(table, rule_set) for table in rule_set.tables)
    factors = {
        name: one
        for name, one in rule_set.parameters.items()
        if one.unit == "1" and name in rule_set.sheet.parameters_named()
    }
    other = Grid(
        "Factors",
        ("", "", "what for"),
        tuple((in_words(name), _number(one.value), one.meaning) for name, one in factors.items()),
    )
    lists = tuple(_lists(rule_set.parameters))
    text = "The numbers have names, by which the formulas at the end of this page use them."
    grids = tuple(grid for grid in (*tables, prices, other, *lists) if grid.rows)
    return Section("What earns points", (text,) if grids else (), grids)


def _as_grid(table: Table, rule_set: RuleSet) -> Grid:
    """A table with numbers in place of formulas that hold only named ones."""
    rows = tuple(
        (row.name, _ways(row.when), *(_worth(row.worth[column], rule_set) for column in table.columns))
        for row in table.rows
    )
    columns = table.columns if len(table.columns) > 1 else ("points",)
    caption = f"{in_words(table.name)}: one row applies to each {table.level}"
    return Grid(caption, ("", "when", *map(in_words, columns)), rows)


def _ways(when: Sequence[Mapping[str, str]]) -> str:
    said = [", ".join(f"{in_words(check)} {word}" for check, word in one.items()) for one in when]
    return "; or ".join(said) if said else OTHERWISE


def _worth(formula: str, rule_set: RuleSet) -> str:
    parsed = Expression.parse(formula)
    try:
        value = parsed.columns({**rule_set.sheet.parameters, "": 0})
    except FormulaError:  # it names more than parameters
        return f"`{formula}`"
    return _number(float(value))


def _lists(parameters: Mapping[str, NamedParameter]) -> Iterator[Grid]:
    """Prices in another coin, such as those of sensors."""
    for unit in dict.fromkeys(one.unit for one in parameters.values()):
        if unit in (*_POINTS, *_TOLERANCES, "1"):
            continue
        named = {name: one for name, one in parameters.items() if one.unit == unit}
        rows = tuple(
            (in_words(name), f"{_number(one.value)} {unit}", one.meaning) for name, one in named.items()
        )
        yield Grid(f"In {unit}", ("", "", "what for"), rows)


# What costs points ---------------------------------------------------------------------


class _Made:
    """Made trials of a rule set, and what they score."""

    def __init__(self, rule_set: RuleSet, events: frozenset[str]) -> None:
        self.rule_set = rule_set
        self.world = World(rule_set, events)

    def score(self, case: Case) -> Number | None:
        """The score of a made trial; `None` where it has none."""
        try:
            return self.world.score(case)
        except FormulaError:
            return None

    def perfect(self, kind: str = "") -> Case:
        """One order with everything right, of one kind of task."""
        measured = self.world.measured.items()
        case = Case(
            ((_PARTS,),), numbers={f"{check}.{name}": 100.0 for check, names in measured for name in names}
        )
        kinds: Mapping[str, str] = self.rule_set.expanded.get("kinds", {})
        before = list(kinds)[: list(kinds).index(kind)] if kind else []
        others = {check for one in before for check in self.world.kinds if check in str(kinds[one])}
        failed = {(check, subject) for check in others for subject in self.world.subjects(case, check)}
        return replace(case, failed=frozenset(failed))

    @property
    def measures(self) -> bool:
        """Whether its points are read from a record, of which none can be made up."""
        return bool(set(self.world.measured) - set(self.world.safety))


def _costs(made: _Made) -> Section:
    world, case = made.world, made.perfect()
    whole = made.score(case)
    if made.measures or not whole or not world.safety:
        return Section("What violations cost")
    curves = tuple(Curve(in_words(check), *_left(made, case, check, whole)) for check in world.watched)
    rows = []
    for check in world.safety:
        for times in _TIMES:
            found = made.score(replace(case, violations=tuple(_event(check, 100 * n) for n in range(times))))
            if found is not None:
                rows.append((in_words(check), f"{times}", _percent(found, whole)))
    critical = []
    for check in world.safety:
        found = made.score(replace(case, violations=(replace(_event(check, 0), critical=True),)))
        if found is not None:
            critical.append((in_words(check), _percent(found, whole)))
    return Section(
        "What violations cost",
        (
            f"Worked from a made trial that earns {_number(whole)} points: what is left of its score when "
            "these things happen and nothing else. Every violation is as deep as it can be.",
        ),
        (
            Grid(
                "Violations of no length, 10 s apart",
                ("what is violated", "how often", "left of the score"),
                tuple(rows),
            ),
            Grid("One critical violation", ("what is violated", "left of the score"), tuple(critical)),
        ),
        curves,
    )


def _event(check: str, start: int, ticks: int = 0) -> Violation:
    return Violation(check, 0, start, start + ticks)


def _left(made: _Made, case: Case, check: str, whole: Number) -> tuple[tuple[float, ...], tuple[float, ...]]:
    found = [
        (float(s), made.score(replace(case, violations=(_event(check, 0, s * TICKS_PER_S),))))
        for s in _LENGTHS_S
    ]
    known = [(s, 100 * score / whole) for s, score in found if score is not None]
    return tuple(s for s, _ in known), tuple(left for _, left in known)


def _percent(score: Number, whole: Number) -> str:
    return f"{100 * score / whole:.4g} %"


# Examples ------------------------------------------------------------------------------


def _examples(made: _Made) -> Section:
    title = "Examples"
    if made.measures:
        return Section(
            title, ("None: its points are read from the record of a run, and none is made up here.",)
        )
    kinds = list(made.rule_set.expanded.get("kinds", {})) or [""]
    grids = tuple(grid for kind in kinds if (grid := _example(made, kind)))
    inner = made.world.rule_set.sheet.levels[0]
    work = f"{_PARTS} {inner}s in one piece of work" if inner != TRIAL else "no work"
    compared = " Shown is the task score, before teams are compared." if made.rule_set.sheet.task else ""
    text = f"A made trial with {work}, everything as it should be; then one thing wrong at a time.{compared}"
    return Section(title, (text,) if grids else (), grids)


def _example(made: _Made, kind: str) -> Grid | None:
    world, case = made.world, made.perfect(kind)
    whole = made.score(case)
    if whole is None:
        return None
    rows = [("everything as it should be", _number(whole), "")]
    for check in world.task:
        first, *others = world.subjects(case, check)
        score = made.score(replace(case, failed=case.failed | {(check, first)}))
        if score is None or (score == whole and kind):
            continue
        one = f"of one {world.levels[check]}" if others else f"of the {world.levels[check]}"
        rows.append((f"{in_words(check)} {one} violated", _number(score), _number(score - whole)))
    return Grid(in_words(kind) if kind else "One thing wrong", ("", "score", "less"), tuple(rows))


# Tolerances, what is not seen ----------------------------------------------------------

_TOLERANCES = ("m", "rad", "s", "m/s", "N", "Pa", "K", "kg", "J")


def _tolerances(rule_set: RuleSet, registry: Registry) -> Section:
    named = {name: one for name, one in rule_set.parameters.items() if one.unit in _TOLERANCES}
    used = rule_set.sheet.parameters_named()
    plain = {name: one for name, one in rule_set.parameters.items() if one.unit == "1" and name not in used}
    rows = [
        (in_words(n), _with_unit(one.value, one.unit), one.meaning) for n, one in {**named, **plain}.items()
    ]
    given = list(_given(rule_set, registry))
    grids = (
        Grid("Tolerances", ("", "", "what it limits"), tuple(rows)),
        Grid("Numbers given to checks", ("check", "parameter", ""), tuple(given)),
    )
    return Section("Tolerances", (), tuple(grid for grid in grids if grid.rows))


def _given(rule_set: RuleSet, registry: Registry) -> Iterator[tuple[str, str, str]]:
    for check in rule_set.checks.values():
        declared = parameters_of(rule_set.plugin(check.name, registry).load())
        for name, value in check.parameters.items():
            if name in check.named or isinstance(value, bool) or not isinstance(value, int | float):
                continue
            yield in_words(check.name), f"`{name}`", _with_unit(value, declared[name].facts.unit)


def _with_unit(value: Number, unit: str) -> str:
    return _number(value) if unit in ("", "1") else f"{_number(value)} {unit}"


def _unseen(rule_set: RuleSet) -> Section:
    priced = [check for check in rule_set.checks.values() if check.name in rule_set.sheet.priced]
    rows = tuple(
        (", ".join(in_words(check.name) for check in priced if check.on_inconclusive == policy), words)
        for policy, words in _UNSEEN.items()
        if any(check.on_inconclusive == policy for check in priced)
    )
    silent = ", ".join(in_words(name) for name in rule_set.checks if name not in rule_set.sheet.priced)
    text = f"Looked at and shown, but without effect on the score: {silent}." if silent else ""
    grid = Grid("When the log does not show what a check needs", ("what is looked at", "then"), rows)
    return Section("What is not seen", (text,) if text else (), (grid,) if rows else ())


# Differences, laws, formulas -----------------------------------------------------------


def _differences(rule_set: RuleSet) -> Section:
    stated = rule_set.differs
    rows = tuple((in_words(one.name), one.coded, one.documented) for one in stated.because) if stated else ()
    grid = (
        Grid(f"Where it differs from {stated.other}", ("", "the code", "the document"), rows)
        if stated
        else None
    )
    title = "What a referee should know"
    return Section(title, rule_set.notes, (grid,) if grid else ())


def _laws(rule_set: RuleSet, outcomes: Sequence[Outcome]) -> Section:
    verdicts = {"holds": "holds", "broken": "does not hold", "not_applicable": "does not apply"}
    rows = tuple(
        (
            one.law.says,
            verdicts.get(one.verdict, "not tried"),
            rule_set.breaks.get(one.law.name, one.reason),
        )
        for one in outcomes
    )
    more = f"`ariac-score rules check {rule_set.id}` tries more, and shows any exception."
    text = f"Tried on {CASES} made trials each; {more}"
    return Section("Laws", (text,), (Grid("Whether the score is fair", ("law", "", "because"), rows),))


def _formulas(rule_set: RuleSet) -> Section:
    rows = [
        (f"each {level}" if level != TRIAL else "the trial", name, f"`{formula.source}`")
        for level, terms in rule_set.sheet.terms.items()
        for name, formula in terms.items()
    ]
    rows += [("the trial", "score", f"`{rule_set.sheet.score.source}`")]
    digits = f"The score is rounded to {rule_set.digits} decimal digits."
    checks = tuple((in_words(one.name), f"`{one.use}`") for one in rule_set.checks.values())
    return Section(
        "How the score is made",
        (digits,),
        (
            Grid("What is looked at", ("check", "plugin"), checks),
            Grid("Formulas, from the inside out", ("of", "", ""), tuple(rows)),
        ),
    )
