"""The official text of a trial compared with the log, and with itself.

Every number that the official scorer printed is looked up in the rule set (`printed`),
computed again from the log, and compared within its stated tolerance. Where the log does
not decide our number, the item cannot be judged, with the reason. The printed numbers must
also add up among themselves (`adds_up`), whatever the log shows.

Some facts about a trial come only from the official file, such as a collision that nothing
else records. Each item is therefore computed a second time without that file: where this
gives no number, the agreement rests on the official file itself.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

from msgspec import Meta

from ariac_score.checks.contracts import Reader, Wanted, reader_facts
from ariac_score.checks.findings import canonical_number
from ariac_score.checks.registry import Registry
from ariac_score.engine.measure import measure_trial
from ariac_score.engine.prepared import prepare
from ariac_score.engine.read import find_trial, read_needed, refuse_unlikely
from ariac_score.errors import FormulaError, NothingToScoreError, UsageError
from ariac_score.logs.bundle import Bundle
from ariac_score.results.codec import Format
from ariac_score.results.result import Pinned
from ariac_score.review.certainty import Certain, Value
from ariac_score.review.comparison import Comparison, compare_rules, rule_sets_differing_from
from ariac_score.scoring.expression import Number
from ariac_score.scoring.printed import PrintedBlock, PrintedItem, PrintedText, number_of
from ariac_score.scoring.ruleset import RuleSet, installed_rule_sets, load_rule_set
from ariac_score.scoring.scope import Level
from ariac_score.trial.channels import LogMap
from ariac_score.trial.model import OfficialOrder, OfficialResult, Trial
from ariac_score.trial.work import WorkItem

__all__ = ["AGREE", "AUDIT", "CANNOT_BE_JUDGED", "DIFFER", "Audit", "Item", "Sum", "audit"]

AGREE, DIFFER, CANNOT_BE_JUDGED = "agree", "differ", "cannot_be_judged"
Judgement = Annotated[str, Meta(pattern="^(agree|differ|cannot_be_judged)$")]

STATE_LOG_ROUNDING: Mapping[str, float] = {"m": 0.01, "rad": 0.01}
"""How exact poses of a Gazebo state.log are: three significant digits, which is 1 cm beyond 1 m.

Source: ARIAC notes on log formats, section 4.2.
"""

_OUTCOMES = {
    "crashed": "the simulator crashed; no score was recorded",
    "cancelled": "the run was cancelled by its user; no score was recorded",
}

_NO_TRIAL = "the other parts are no record of a trial"

Progress = Callable[[float], None]


def _no_progress(_done: float) -> None:
    """Show nothing."""


@dataclass(frozen=True)
class Item:
    """One printed number compared with ours.

    Attributes:
        level: Level of the block it is printed in.
        path: Path of that block in the text; empty for the trial.
        label: As the reader spells it.
        printed: As printed.
        ours: Our number; `None` when there is none.
        verdict: `agree`, `differ` or `cannot_be_judged`.
        reason: Why it cannot be judged, or what the agreement rests on; else empty.
        tolerance: The largest difference that agrees.
        because: Why that tolerance.
        independent: Whether ours is the same without the file of the official text.
        scope: Path of the item that it was compared with.
    """

    level: Level
    path: str
    label: str
    printed: str
    ours: Number | None
    verdict: Judgement
    reason: str = ""
    tolerance: float = 0.0
    because: str = ""
    independent: bool = False
    scope: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "ours", canonical_number(self.ours))


@dataclass(frozen=True)
class Sum:
    """One printed number compared with what the other printed numbers require.

    Attributes:
        level: Level of the block it is printed in.
        path: Path of that block; empty for the trial.
        label: As the reader spells it.
        printed: As printed.
        expected: What the other numbers require; `None` when they give no number.
        formula: The formula, over printed items.
        relation: `equal`, `at_most` or `at_least`.
        verdict: `agree` or `differ`, or `cannot_be_judged`.
        reason: Why it cannot be judged, why the relation is not equality, or what else may be
            the cause when it differs.
        rests_on: Path, label and text of every printed number that `expected` is made of.
    """

    level: Level
    path: str
    label: str
    printed: str
    expected: Number | None
    formula: str
    relation: Annotated[str, Meta(pattern="^(equal|at_most|at_least)$")]
    verdict: Judgement
    reason: str = ""
    rests_on: tuple[tuple[str, str, str], ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "expected", canonical_number(self.expected))


_NO_RULES = Pinned("", "")


@dataclass(frozen=True)
class Audit:
    """The numbers of an official text, compared with the log and with each other.

    Attributes:
        trial: Name of the trial.
        source: File of the official text.
        layout: The layout of the text, as the reader names it.
        outcome: How the run ended where no score was printed, in words; else empty.
        rule_set: By which it was compared; empty where there was nothing to compare.
        items: Every printed item, in the order of the text.
        sums: Everything that must add up, in the order of the text.
        comparisons: The same trial under other rule sets.
        counts: How many items have each verdict.
    """

    trial: str
    source: str
    layout: str
    outcome: str = ""
    rule_set: Pinned = _NO_RULES
    items: tuple[Item, ...] = ()
    sums: tuple[Sum, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    counts: Mapping[str, int] = field(init=False)

    def __post_init__(self) -> None:
        judged = Counter(item.verdict for item in self.items)
        counts = {verdict: judged[verdict] for verdict in (AGREE, DIFFER, CANNOT_BE_JUDGED)}
        object.__setattr__(self, "counts", counts)

    @property
    def differs(self) -> bool:
        """Whether something differs, or does not add up."""
        return DIFFER in [*(item.verdict for item in self.items), *(one.verdict for one in self.sums)]

    def count(self, verdict: str) -> int:
        """How many items have a verdict."""
        return self.counts[verdict]


AUDIT = Format("audit", 2, Audit, made_by="'audit -o FILE.json'")
"""How an audit is stored."""


def audit(
    path: Path,
    rules: str | RuleSet = "",
    *,
    against: str | RuleSet = "",
    registry: Registry | None = None,
    progress: Progress = _no_progress,
) -> Audit:
    """Compare the official text of a trial with its log, and with itself.

    Args:
        path: A log, a bundle folder or a `bundle.yaml`, with an official text.
        rules: The rule set or its name; empty for the one that declares the text's layout.
        against: A second rule set whose differences are listed; empty for those that state
            how they differ from the first.
        registry: The installed plugins, where the caller has them already.
        progress: Called with the share done, 0 to 1.

    Raises:
        NothingToScoreError: There is no official text.
        UsageError: No rule set, or more than one, declares the layout of the text.
        ScoreError: For everything else a user can act on.
    """
    registry = registry or Registry()
    bundle, readers = find_trial(path, registry)
    official, layout = _official(bundle, readers)
    # A run that crashed has no score to compare; that is a finding of the audit, not an error.
    if not official.summaries and official.total is None:
        outcome = _OUTCOMES.get(official.outcome, official.outcome or "the text holds no score")
        return Audit(bundle.id, official.source, layout, outcome)
    rule_set = _chosen(rules, layout, official, registry)
    competition = rule_set.build_competition(registry)
    block = _block_of(official, competition)
    refuse_unlikely(bundle, readers, prepare(rule_set, registry=registry))
    look = _Look(bundle, readers, registry, progress)
    trial, ours = look.at(rule_set)
    outermost = getattr(competition, "levels", ("item", "trial"))[-2]
    place = getattr(competition, "place", _plain_place)
    items = _Items(
        rule_set.printed, trial.work, outermost, place, ours, look.without_text(rule_set), official.source
    )
    others = _others(against, rule_set)
    return Audit(
        trial.id,
        official.source,
        layout,
        rule_set=Pinned(rule_set.id, rule_set.sha256),
        items=tuple(items.of(block)),
        sums=tuple(_sums(rule_set.printed, block)),
        comparisons=tuple(compare_rules(ours, look.at(other)[1]) for other in others),
    )


def _others(against: str | RuleSet, first: RuleSet) -> tuple[RuleSet, ...]:
    """The rule sets to list the differences to."""
    if not against:
        return rule_sets_differing_from(first)
    return (load_rule_set(against) if isinstance(against, str) else against,)


# The text ------------------------------------------------------------------------------


def _official(bundle: Bundle, readers: Mapping[str, Reader]) -> tuple[OfficialResult, str]:
    """The official result alone, and the layout it is printed in."""
    # The log comes last: some competitions write their scores into the file that is their log.
    for part in sorted(bundle.parts, key=lambda part: part.role != "official"):
        if part.role in ("official", "log"):
            reader = readers[part.reader]
            # No log map: an official text has no signals.
            official = reader.read(part.path, Wanted(LogMap("audit"), run=part.run)).official
            if official is not None:
                layout = reader.describe(part.path).facts.get("layout", "")
                return official, str(layout)
    raise NothingToScoreError(
        "there is no official score to audit",
        file=bundle.root,
        hint=_hint_for_texts(readers),
    )


def _hint_for_texts(readers: Mapping[str, Reader]) -> str:
    """What to add, by what the installed readers know."""
    known = {f.formats for r in readers.values() if (f := reader_facts(r)).role == "official" and f.formats}
    if not known:
        return "no installed plugin reads official texts"
    return f"add what the official scorer wrote, to its end; these are known: {', '.join(sorted(known))}"


def _block_of(official: OfficialResult, competition: Any) -> PrintedBlock:
    """The text as blocks: the trial, its outermost items, what is printed of anything inside them."""
    # Readers write the place of an item into its label: `bolt_2/placed`.
    values = {label: value for label, value in official.items.items() if "/" not in label}
    if official.total is not None:
        values.setdefault("final_score", f"{official.total:.12g}")
    return PrintedBlock(
        "trial", "", values, inner=tuple(_item_block(one, competition) for one in official.summaries)
    )


def _item_block(item: OfficialOrder, competition: Any) -> PrintedBlock:
    blocks: dict[str, dict[str, str]] = {"": _facts_of(item)}
    for label, value in item.items.items():
        inside, _, own = label.rpartition("/")
        blocks.setdefault(inside, {})[own] = value
    of_item = blocks.pop("")
    # A competition without levels of work may have a text that summarises items all the same.
    levels = getattr(competition, "levels", ())[:-1] or ("item",)
    level_of = getattr(competition, "printed_level", lambda _name: levels[0])
    inner = tuple(_inner_block(item, level_of(name), name, values) for name, values in blocks.items())
    return PrintedBlock(levels[-1], item.id, of_item, item.kind, inner)


def _inner_block(item: OfficialOrder, level: str, name: str, values: Mapping[str, str]) -> PrintedBlock:
    """Something inside an item, known by its printed id or else by its name in the text."""
    own = {label: value for label, value in values.items() if label != "id"}
    return PrintedBlock(level, f"{item.id}/{values.get('id', name)}", own, item.kind)


def _facts_of(item: OfficialOrder) -> dict[str, str]:
    """What the reader took from a summary, under the names that formulas use."""
    facts: dict[str, object] = {
        "summary_score": item.score,
        "summary_max_score": item.max_score,
        "summary_submitted": item.submitted,
        "summary_priority": item.priority,
    }
    return {
        name: f"{value:g}" if isinstance(value, float) else str(value).lower()
        for name, value in facts.items()
        if value is not None
    }


def _chosen(rules: str | RuleSet, layout: str, official: OfficialResult, registry: Registry) -> RuleSet:
    """The rule set to audit under: the given one, or the only one that declares this layout."""
    if rules:
        rule_set = load_rule_set(rules) if isinstance(rules, str) else rules
        if not rule_set.printed.items:
            raise UsageError(
                f"rule set {rule_set.id!r} does not say what an official text prints",
                hint="add the keys 'printed' and 'adds_up', or choose another with --rules",
            )
        return rule_set
    if not layout:
        raise UsageError(
            "this record prints no score: it holds counts, out of which a score is worked out",
            hint="there is nothing to hold it against; 'score' and 'explain' show how it comes about",
        )
    shipped = installed_rule_sets()
    fitting = [one for one in shipped if layout in one.printed.layouts]
    # Rule sets share layouts; the one that knows every printed label is meant, where it is one.
    knowing = [
        one for one in fitting if one.printed.knows(_block_of(official, one.build_competition(registry)))
    ]
    fitting = knowing or fitting
    if len(fitting) != 1:
        named = ", ".join(one.id for one in fitting) or ", ".join(
            one.id for one in shipped if one.printed.layouts
        )
        cause = "the text may be of more than one rule set" if fitting else "no installed rule set is of it"
        raise UsageError(f"layout {layout!r}: {cause}", hint=f"choose with --rules: {named}")
    return fitting[0]


def _sums(text: PrintedText, block: PrintedBlock) -> Iterator[Sum]:
    for inner in block.walk():
        for one in text.sums_of(inner):
            label, printed = text.printed(inner, one.name)
            made = Sum(
                inner.level,
                inner.path,
                label,
                printed,
                None,
                one.formula.source,
                one.relation,
                CANNOT_BE_JUDGED,
                one.because,
                tuple(text.rests_on(inner, one)),
            )
            try:
                expected = text.expected(inner, one)
            except FormulaError as error:
                yield replace(made, reason=error.cause)
                continue
            got = number_of(printed)
            assert got is not None  # sums are only of what is printed as a number
            holds = {"equal": got == expected, "at_most": got <= expected, "at_least": got >= expected}
            yield replace(made, expected=expected, verdict=AGREE if holds[one.relation] else DIFFER)


# The log -------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Look:
    """Reads and measures one bundle, with or without its official text."""

    bundle: Bundle
    readers: Mapping[str, Reader]
    registry: Registry
    progress: Progress

    def at(self, rule_set: RuleSet) -> tuple[Trial, Certain]:
        """The trial, and the values of the rule set for it."""
        return self._measured(self.bundle, rule_set)

    def without_text(self, rule_set: RuleSet) -> Certain | None:
        """The values of the rule set for the other parts alone; `None` when these are no trial."""
        parts = tuple(part for part in self.bundle.parts if part.role != "official")
        try:
            return self._measured(replace(self.bundle, parts=parts), rule_set)[1]
        except NothingToScoreError:
            return None

    def _measured(self, bundle: Bundle, rule_set: RuleSet) -> tuple[Trial, Certain]:
        prepared = prepare(rule_set, registry=self.registry)
        trial = prepared.derived(read_needed(bundle, self.readers, prepared, progress=self.progress))
        measured = measure_trial(trial, prepared)
        timed = trial.started_s is not None and trial.ended_s is not None
        return trial, Certain(rule_set, measured, _rounding(bundle), timed)


def _rounding(bundle: Bundle) -> Mapping[str, float]:
    """How exact poses are, by unit, where only a state.log records them; empty for exact."""
    logs = [part.reader for part in bundle.parts if part.role == "log"]
    return STATE_LOG_ROUNDING if logs and all(reader == "gazebo" for reader in logs) else {}


# Items ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Items:
    """Compares the items of a text with our numbers."""

    text: PrintedText
    work: Sequence[WorkItem]
    outermost: str
    place: Callable[[Any, str, str], tuple[str, str]]
    ours: Certain
    alone: Certain | None
    source: str

    def of(self, block: PrintedBlock) -> Iterator[Item]:
        """The items of a block and of all inside, those of each block in the order of the text."""
        path, problem = self._place(block)
        for item, label in self.text.items_of(block):
            yield self._item(block, item, label, path, problem)
        for label in self.text.unknown(block):
            reason = "the rule set does not say what this is"
            yield Item(block.level, block.path, label, block.values[label], None, CANNOT_BE_JUDGED, reason)
        for inner in block.inner:
            yield from self.of(inner)

    def _item(self, block: PrintedBlock, item: PrintedItem, label: str, path: str, problem: str) -> Item:
        printed = block.values[label]
        number = number_of(printed)
        tolerance = _tolerance(printed) if item.within is None else item.within
        made = Item(
            level=block.level,
            path=block.path,
            label=label,
            printed=printed,
            ours=None,
            verdict=CANNOT_BE_JUDGED,
            reason=problem,
            tolerance=tolerance,
            because=item.because,
            scope="" if problem else path,
        )
        if item.formula is None:
            return replace(made, reason=item.because or "there is no counterpart in the rule set", because="")
        if number is None:
            return replace(made, reason="it is not printed as a number")
        if problem:
            return made
        value = self.ours.value(item.formula, block.level, path)
        if value.traced is None:
            return replace(made, reason=value.reason)
        ours = value.traced.value
        made = replace(made, ours=ours, verdict=AGREE if abs(number - ours) <= tolerance else DIFFER)
        # Once more without the official file: agreement with itself would prove nothing.
        again = self.alone.value(item.formula, block.level, path) if self.alone else Value(reason=_NO_TRIAL)
        if again.traced is None:
            return replace(made, reason=f"without {self.source}: {again.reason}")
        if again.traced.value != ours:
            return replace(made, reason=f"without {self.source} it would be {again.traced.value:g}")
        return replace(made, independent=True)

    def _place(self, block: PrintedBlock) -> tuple[str, str]:
        """The path of our scope for a block, and why there is none."""
        if block.level == "trial":
            return "", ""
        item_id, _, name = block.path.partition("/")
        item = next((item for item in self.work if item.id == item_id), None)
        if item is None:
            return block.path, f"the log shows no such {self.outermost}"
        if not name:
            return item.id, ""
        if getattr(item, "outline", False):
            return block.path, "what was asked for is not recorded, only what was given for it"
        return self.place(item, block.level, name)


def _plain_place(item: WorkItem, _level: str, name: str) -> tuple[str, str]:
    """The path of an item that a text calls by its id, and why there is none."""
    found = any(inner.id == name for inner in item.items)
    return f"{item.id}/{name}", "" if found else f"{item.level} {item.id!r} has no such item"


def _tolerance(printed: str) -> float:
    """Half of the last printed digit; whole numbers are exact."""
    digits = printed.strip().partition(".")[2]
    return 0.5 * 10.0 ** -len(digits) if digits.isdigit() else 0.0
