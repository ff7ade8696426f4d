"""An audit as text: the verdict first, then what differs, does not add up, or cannot be judged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ariac_score.review.audit import AGREE, CANNOT_BE_JUDGED, DIFFER, Audit, Item, Sum
from ariac_score.review.comparison import Change, Comparison
from ariac_score.scoring.printed import RELATIONS, number_of
from ariac_score.terminal.style import Style, plain

__all__ = ["audit_text"]

_LABEL = 44
_IN_WORDS: Mapping[str, str] = {
    "summary_score": "score in the summary",
    "summary_max_score": "max_score in the summary",
    "summary_submitted": "submitted in the summary",
    "summary_priority": "priority in the summary",
    "summary_duration_s": "duration_s in the summary",
}
"""Labels that are ours (`FACTS_OF_TEXT`); every other one is what the text itself prints."""


def audit_text(audit: Audit, style: Style | None = None) -> str:
    """The audit as an organiser needs it in a protest."""
    style = style or Style()
    sections = [
        _headline(audit, style),
        _differing(audit, style),
        _not_adding_up(audit, style),
        _agreeing(audit, style),
        _resting(audit, style),
        _not_judged(audit, style),
        *(_comparison(comparison, style) for comparison in audit.comparisons),
    ]
    return "\n\n".join("\n".join(lines) for lines in map(list, sections) if lines) + "\n"


def _headline(audit: Audit, style: Style) -> Iterator[str]:
    if audit.outcome:
        yield style(f"nothing to compare: {plain(audit.outcome)}", "bold", "yellow")
        yield f"{plain(audit.trial)}: {plain(audit.source)}"
        return
    rests = sum(1 for item in audit.items if item.verdict == AGREE and not item.independent)
    own = f" ({rests} of them rest on the official file itself)" if rests else ""
    differ, cannot = audit.count(DIFFER), audit.count(CANNOT_BE_JUDGED)
    yield " · ".join(
        [
            style(f"agree {audit.count(AGREE)}", "bold", "green") + own,
            style(f"differ {differ}", "bold", *(["red"] if differ else [])),
            style(f"cannot be judged {cannot}", "bold", *(["yellow"] if cannot else [])),
        ]
    )
    wrong = sum(1 for one in audit.sums if one.verdict == DIFFER)
    tried = len(audit.sums)
    words = f"{tried - wrong} of {tried} sums hold" if wrong else f"all {tried} sums hold"
    yield f"the text against itself: {style(words, 'red' if wrong else 'green')}"
    yield f"{plain(audit.trial)}, {plain(audit.source)} in the layout of {plain(audit.layout)}"
    yield f"under {audit.rule_set.id}, sha256 {audit.rule_set.sha256[:16]}…"


def _differing(audit: Audit, style: Style) -> Iterator[str]:
    found = [item for item in audit.items if item.verdict == DIFFER]
    if found:
        yield style("Differs from the log", "bold")
    for item in found:
        yield (
            _line("-", item, style, "red")
            + f"printed {plain(item.printed)}, ours {item.ours:g}{_within(item)}"
        )
        if not item.independent:
            yield style(f"      {plain(item.reason)}", "dim")


def _not_adding_up(audit: Audit, style: Style) -> Iterator[str]:
    found = [one for one in audit.sums if one.verdict != AGREE]
    if found:
        yield style("Does not add up in the text", "bold")
    for one in found:
        yield _line("-", one, style, "red") + _sum_words(one)
        for path, label, printed in one.rests_on if one.expected is not None else ():
            yield style(f"      {plain(_name(path, label))}: {plain(printed)}", "dim")


def _sum_words(one: Sum) -> str:
    if one.expected is None:
        return f"printed {plain(one.printed)}; {plain(one.reason)}"
    because = f"; {one.reason}" if one.reason else ""
    words = f"{RELATIONS[one.relation]} {one.formula}"
    return f"printed {plain(one.printed)}, but it {words} = {one.expected:g}{because}"


def _agreeing(audit: Audit, style: Style) -> Iterator[str]:
    found = [item for item in audit.items if item.verdict == AGREE and item.independent]
    if found:
        yield style("Agrees with the log", "bold")
    for item in found:
        yield _line(" ", item, style, "dim") + _both(item)


def _resting(audit: Audit, style: Style) -> Iterator[str]:
    found = [item for item in audit.items if item.verdict == AGREE and not item.independent]
    yield from _by_reason("Agrees, but rests on the official file itself", found, style)


def _not_judged(audit: Audit, style: Style) -> Iterator[str]:
    found = [item for item in audit.items if item.verdict == CANNOT_BE_JUDGED]
    yield from _by_reason("Cannot be judged", found, style)


def _by_reason(title: str, items: list[Item], style: Style) -> Iterator[str]:
    """Items grouped by reason, in the order of the text."""
    reasons: dict[str, list[Item]] = {}
    for item in items:
        reasons.setdefault(item.reason, []).append(item)
    if reasons:
        yield style(title, "bold")
    for reason, alike in reasons.items():
        yield style(f"  {plain(reason)}", "yellow")
        for item in alike:
            yield _line(" ", item, style, "dim") + _both(item)


def _both(item: Item) -> str:
    """The printed number, and ours where it is written differently."""
    # Texts print true, 1 and 1.0 for the same: compared as numbers, shown as printed.
    number = number_of(item.printed)
    if item.ours is None or number == item.ours:
        return plain(item.printed)
    return f"{plain(item.printed)} (ours {item.ours:g}{_within(item)})"


def _line(mark: str, one: Item | Sum, style: Style, look: str) -> str:
    return style(f"  {mark} {plain(_name(one.path, one.label)):<{_LABEL}} ", look)


def _name(path: str, label: str) -> str:
    """The place of an item in the official text: the block and the label it is printed under."""
    words = _IN_WORDS.get(label, label)
    return f"{path}: {words}" if path else words


def _within(item: Item) -> str:
    if not item.tolerance:
        return ""
    because = f", as {plain(item.because)}" if item.because else ", as it is rounded"
    return f"; within {item.tolerance:g}{because}"


# Two rule sets -------------------------------------------------------------------------


def _comparison(comparison: Comparison, style: Style) -> Iterator[str]:
    yield style(f"The same trial under {comparison.second}", "bold")
    if not comparison.changes:
        yield "  nothing that both decide differs"
    for change in comparison.changes:
        yield from _change(change, style)
    reasons: dict[str, list[str]] = {}
    for each in comparison.undecided:
        reasons.setdefault(each.reason, []).append(f"{each.path}: {each.term}" if each.path else each.term)
    for reason, names in reasons.items():
        yield style(f"  cannot be compared: {plain(reason)}", "yellow")
        yield style(f"    {plain(', '.join(names))}", "dim")


def _change(change: Change, style: Style) -> Iterator[str]:
    name = f"{change.path}: {change.term}" if change.path else change.term
    numbers = style(f"{change.before:g} -> {change.after:g}", "bold")
    yield f"  {plain(name):<{_LABEL}} {numbers}" + ("  (follows)" if change.follows else "")
    if change.unexplained:
        yield style("      unexplained: the rule set does not say why", "red")
    for reason in change.reasons if not change.follows else ():
        yield f"      {reason.name}"
        yield f"        coded: {plain(reason.coded)}"
        yield f"        documented: {plain(reason.documented)}"
        yield style(f"        {plain(reason.source)}", "dim")
