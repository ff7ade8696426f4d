"""A result as text: the final score first, then why."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from decimal import Decimal

from msgspec import structs

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.report.figures import amount_text
from ariac_score.report.often import told_once
from ariac_score.report.openness import (
    adjusted_sentence,
    bounds_text,
    is_at_worst,
    open_sentence,
    stand_in_text,
    undecided_text,
    would_narrow,
)
from ariac_score.report.places import Places
from ariac_score.report.statements import changes_nothing, held_text, left_out, rests_on
from ariac_score.report.summary import summary_of
from ariac_score.report.words import label_of, priced_check, words_of
from ariac_score.results.doubt import why_withheld
from ariac_score.results.result import Result
from ariac_score.review.lost_points import without_alone
from ariac_score.review.task_and_safety import task_and_safety
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.expression import Traced
from ariac_score.scoring.ledger import Line, taken_by
from ariac_score.scoring.scope import Scope
from ariac_score.scoring.steward import Adjusted
from ariac_score.terminal.style import Style, plain
from ariac_score.trial.clock import Clock
from ariac_score.trial.signals import Sample
from ariac_score.trial.spans import Span

__all__ = ["amount_text", "explain_text", "score_text"]

_MARKS = {
    Verdict.SATISFIED: ("ok", "green"),
    Verdict.VIOLATED: ("violated", "red"),
    Verdict.INCONCLUSIVE: ("undecided", "yellow"),
    Verdict.NOT_APPLICABLE: ("not applicable", "dim"),
}
_WIDTH = 64
_SHOWN = 12


@in_own_decimals
def score_text(result: Result, style: Style | None = None) -> str:
    """The page a team reads: score, how it came about, what cost points and when, what was not judged."""
    style = style or Style()
    sections = [
        _headline(result, style),
        _adjusted(result, style),
        _ledger(result, style),
        _losses(result, style),
        _narrowing(result, style),
        _undecided(result, style),
        _checks(result, style),
        _origin(result, style),
    ]
    return "\n\n".join("\n".join(lines) for lines in map(list, sections) if lines) + "\n"


def _headline(result: Result, style: Style) -> Iterator[str]:
    measured = result.measured
    if result.adjusted is not None:
        yield _adjusted_headline(result.adjusted, style)
        if left := adjusted_sentence(result):
            yield style(left, "yellow")
    if result.score is not None:
        looks = ("bold", "green" if result.score > 0 else "yellow")
        possible = f" of {amount_text(result.possible)} possible" if result.possible is not None else ""
        automatic = "" if result.adjusted is None else "automatic score "
        yield automatic + style(amount_text(result.score), *looks) + possible
    elif result.status == "needs_cohort":
        yield style("needs_cohort", "bold", "yellow") + f" — {plain(result.missing)}"
    else:
        why = f", because {plain(result.missing)}" if result.missing else f": {plain(why_withheld(result))}"
        yield style("no score", "bold", "yellow") + f" — withheld{why}"
    if result.interval is not None:
        yield style(open_sentence(result), "yellow")
    for reason in measured.unofficial:
        yield style(f"unofficial: {plain(reason)}", "bold", "yellow")
    told = summary_of(result, with_score=False)
    if told:
        yield told
    if result.task is not None:
        at_worst = " at worst" if is_at_worst(result) else ""
        task = style(amount_text(result.task.amount), "bold")
        yield f"task score {task}{at_worst}, before other teams are looked at"
    who = f"{plain(measured.team)}, " if measured.team else ""
    yield f"{who}{plain(measured.trial)} under {result.provenance.rule_set.id}: {result.rule_set_title}"
    if measured.window is not None:
        span = measured.window
        times = f"{span.start_s:.3f} s to {span.end_s:.3f} s ({span.duration_s:.3f} s)"
        clock = str(replace(Clock.parse(measured.clock), origin_ns=None))
        yield style(f"{plain(words_of(result).period)} from {times}, {plain(clock)}", "dim")
    official = measured.official
    if official is not None and official.total is not None:
        yield from _official(result, official.total, style)


def _adjusted_headline(adjusted: Adjusted, style: Style) -> str:
    if adjusted.disqualified:
        return style("disqualified", "bold", "red") + " by the stewards: 0"
    if adjusted.score is None:
        return style("no score", "bold", "yellow") + " even as adjusted by the stewards"
    return style(amount_text(adjusted.score), "bold", "yellow") + " as adjusted by the stewards"


def _adjusted(result: Result, style: Style) -> Iterator[str]:
    """The decisions of the stewards, each with the points that it moved."""
    if result.adjusted is None:
        return
    yield style("Adjusted by the stewards", "bold")
    if result.score is not None:
        yield _dotted("automatic score", amount_text(result.score))
    lines = [] if result.adjusted.ledger is None else result.adjusted.ledger.children
    moved = [line for line in lines if line.kind == "factor"]
    for number, decision in enumerate(result.adjusted.adjustments):
        amount = amount_text(moved[number].amount, sign=True) if moved else "-"
        yield _dotted(f"{decision.id}: {plain(decision.effect)}", amount)
        yield f"    {plain(decision.author)}, {decision.time}: {plain(decision.words)}"
    yield style(f"adjustments: sha256 {result.adjusted.sha256[:16]}…; below, the automatic result", "dim")


def _dotted(label: str, amount: str) -> str:
    return f"  {label} {'·' * max(2, _WIDTH - 2 - len(label))} {amount}"


def _official(result: Result, total: float, style: Style) -> Iterator[str]:
    official = result.measured.official
    printed = official.items.get("final_score", "") if official is not None else ""
    allowed = max(_half_a_digit(printed), _LAST_OF_OURS)

    def is_same(amount: Decimal | None) -> bool:
        return amount is not None and abs(amount - Decimal(repr(total))) <= allowed

    # Most official scorers know neither other teams nor safety: they print what here is the task score.
    ours, whose = result.score, "ours"
    if result.task is not None:
        ours, whose = result.task.amount, "our task score"
    elif not is_same(ours):
        parts = task_and_safety(result)
        if parts is not None and parts.has_safety and (is_same(parts.task) or result.interval is not None):
            ours, whose = parts.task, "our task score"
    same = is_same(ours)
    words = f"the same as {whose}" if same else f"not {whose}: rules or log differ from the official scorer's"
    if same and ours != Decimal(repr(total)):
        words += ", to the digits that " + ("are printed" if allowed > _LAST_OF_OURS else "count here")
    if not same and result.interval is not None:
        least, most = (float(end) for end in (result.interval.least, result.interval.most))
        if whose != "ours" or least - float(allowed) <= total <= most + float(allowed):
            words = f"{whose} is open, so nothing says whether it is the same"
        else:
            words = f"not {whose}, whatever is open: rules or log differ from the official scorer's"
    if ours is None:
        words = "ours is withheld, so nothing says whether it is the same"
    yield style(f"official total {total:g}: {words}", *([] if same else ["yellow"]))
    if official is not None and official.process_time_s:
        own = f"; from this log {result.measured.window.duration_s:.3f} s" if result.measured.window else ""
        yield style(f"official process time {official.process_time_s:g} s{own}", "dim")


_LAST_OF_OURS = Decimal("1e-9")
"""Measured numbers have 12 digits, so that the last of a score with more than nine decimals are not ours."""


def _half_a_digit(printed: str) -> Decimal:
    """Half of the last digit that is printed; whole numbers, and a text that is not known, are exact."""
    digits = printed.strip().partition(".")[2]
    return Decimal(5).scaleb(-len(digits) - 1) if digits.isdigit() else Decimal(0)


def _ledger(result: Result, style: Style) -> Iterator[str]:
    ledger = result.ledger or result.task
    if ledger is not None:
        yield style("Why" if result.ledger else "Why the task score", "bold")
        yield from _ledger_lines(ledger.children or (ledger,), style, Places(result), depth=1, deepest=5)


def _ledger_lines(
    lines: Sequence[Line], style: Style, places: Places, *, depth: int, deepest: int
) -> Iterator[str]:
    # Single findings are listed below with their cause; here they would bury the amounts.
    for line, *more in told_once(lines, _says):
        if more:
            yield _ledger_line(_in_all((line, *more)), style, depth)
            continue
        if line.kind == "neutral" or line.path.endswith("/neutral"):
            continue  # 'explain' shows what changed nothing
        if line.kind == "factor" and line.value == 1 and not line.amount:
            continue  # of a ledger of the former method: a gate that is open
        shown = _worth_showing(line)
        yield _ledger_line(structs.replace(shown, label=_spoken(shown, places), subject=""), style, depth)
        inner = shown.children
        if all(child.findings for child in inner) and not shown.path.endswith("/taken"):
            inner = tuple(child for child in inner if child.kind == "factor")
        if depth < deepest and inner:
            yield from _ledger_lines(inner, style, places, depth=depth + 1, deepest=deepest)


def _says(line: Line) -> Hashable:
    """What a line says of its findings, but for which they are."""
    if line.kind != "taken" or len(line.findings) != 1:
        return line.path
    return (
        line.findings[0].rpartition("#")[0],
        line.subject,
        line.label,
        line.amount,
        line.nominal,
        line.reason,
    )


def _in_all(lines: Sequence[Line]) -> Line:
    """Lines that say the same of one finding each, as one."""
    findings = tuple(key for line in lines for key in line.findings)
    amount = sum((line.amount for line in lines), Decimal())
    check = findings[0].rpartition("#")[0] if findings else ""
    label = f"{check} {len(lines)} times: {lines[0].label}"
    return structs.replace(lines[0], amount=amount, nominal=None, findings=findings, label=label)


def _spoken(line: Line, places: Places) -> str:
    """The label of a line in the words of the competition."""
    own = line.subject.rpartition("/")[2]
    if own and line.path.endswith(f"/{own}"):
        return places.own(line.subject)
    return priced_check(label_of(line))


def _worth_showing(line: Line) -> Line:
    """The line, or its only part where that is the same amount under another name."""
    while True:
        telling = [c for c in line.children if c.kind != "factor" or c.value != 1 or c.amount]
        if len(telling) != 1 or telling[0].amount != line.amount or not telling[0].children:
            return line
        line = structs.replace(telling[0], label=line.label, path=line.path, subject=line.subject)


def _ledger_line(line: Line, style: Style, depth: int) -> str:
    label = "  " * depth + plain(_name(line))
    if len(label) > _WIDTH - 3 and line.findings:  # the whole message stands with the finding
        label = label[: _WIDTH - 4] + "…"
    amount = amount_text(line.amount, sign=line.kind in ("factor", "taken"))
    looks = ("red",) if line.amount < 0 else ("dim",) if not line.amount else ()
    dots = " " + "·" * max(2, _WIDTH - len(label)) + " "
    return label + style(dots, "dim") + style(amount, *looks) + style(_beside(line), "dim")


def _beside(line: Line) -> str:
    """What else there is to say of an amount: the rule's price, or why it is 0."""
    words = []
    if line.nominal is not None and line.kind == "cap":
        how = "gives back" if line.nominal > 0 else "takes back"
        words.append(f"of the prices by the rule it {how} {amount_text(abs(line.nominal))}")
    elif line.nominal is not None:
        words.append(f"by the rule {amount_text(line.nominal, sign=True)}")
    words += [line.reason] if line.reason and line.kind != "cap" else []
    return f"  ({'; '.join(map(plain, words))})" if words else ""


def _name(line: Line) -> str:
    if line.kind == "taken" and len(line.findings) == 1:
        return f"{line.findings[0]} {line.label}"
    if line.kind in ("factor", "rounding") or not line.subject or line.subject in line.label:
        return line.label
    own = line.subject.rpartition("/")[2]
    return own if line.path.endswith(f"/{own}") else line.label


def _losses(result: Result, style: Style) -> Iterator[str]:
    """Every violation the score depends on, and what else took points, those without a time last."""
    costs, earned, taken = _costs(result), _earned(result), taken_by(result.ledger)
    priced = [name for name, check in result.checks.items() if check["priced"]]
    found = [
        (key, finding)
        for key, finding in result.measured.in_all_worlds.items()
        if finding.check in priced
        and (key in taken or (finding.verdict is Verdict.VIOLATED and key in result.findings))
    ]
    if found:
        yield style("What cost points", "bold")
        places = Places(result)
        timed = sorted(found, key=lambda item: (item[1].span is None, item[1].subject, _in_order(item[0])))
        rows = told_once(timed, lambda item: _same(item[1], costs.get(item[0], "")))
        for row in rows[: 2 * _SHOWN]:
            (key, finding), number = row[0], len(row)
            cost = costs.get(key) or (f" (it earned {amount_text(earned[key])})" if earned.get(key) else "")
            if number > 1:
                finding = replace(finding, span=_from_first_to_last([one for _, one in row]))
                key, cost = f"{finding.check} {number} times", f"{cost[:-1]} each)" if cost else ""
            look = "red" if finding.verdict is Verdict.VIOLATED else "dim"
            where = _where(finding, places.of(finding.subject))
            yield f"  {style(f'{key:<24}', look)} {where}{plain(finding.message)}{cost}"
        yield from _more(len(rows) - 2 * _SHOWN, style)


def _in_order(key: str) -> tuple[str, int]:
    """Sorts `separation#2` before `separation#10`."""
    name = key.rstrip("0123456789")
    return name, int(key[len(name) :] or 0)


def _same(finding: Finding, cost: str) -> Hashable:
    """What findings that differ in their moment alone have in common."""
    lasts_s = id(finding) if finding.span is None else finding.span.duration_s
    return finding.check, finding.subject, finding.verdict, finding.message, cost, lasts_s


def _from_first_to_last(findings: Sequence[Finding]) -> Span:
    spans = [one.span for one in findings if one.span is not None]
    return Span(min(one.start_s for one in spans), max(one.end_s for one in spans))


def _costs(result: Result) -> dict[str, str]:
    """What each finding took; in a ledger of the former method, the factor behind which it was."""
    costs = {
        key: f" ({amount_text(line.amount, sign=True)})" for key, line in taken_by(result.ledger).items()
    }
    if not result.is_former:
        lines = result.ledger.walk() if result.ledger else ()
        why = {key: f" (0: {plain(line.reason)})" for line in lines if line.reason for key in line.findings}
        return why | costs
    for line in result.ledger.walk() if result.ledger else ():
        if line.kind == "factor" and line.amount < 0:
            for key in line.findings:
                costs.setdefault(key, f" ({amount_text(line.amount)}, {plain(line.label)})")
    return costs


def _where(finding: Finding, whom: str = "") -> str:
    when = f", {finding.span.start_s:.2f} s to {finding.span.end_s:.2f} s" if finding.span else ""
    return f"{whom or plain(finding.subject)}{when}: "


def _more(count: int, style: Style) -> Iterator[str]:
    if count > 0:
        yield style(f"  … and {count} more; see 'ariac-score explain'", "dim")


def _narrowing(result: Result, style: Style) -> Iterator[str]:
    """What would narrow the score, most first."""
    lines = would_narrow(result, plain)
    if not lines:
        return
    yield style("What would narrow it", "bold")
    yield from (f"  {one}" for one in lines[:_SHOWN])
    if result.score is None:
        yield from _more(len(lines) - _SHOWN, style)
        return
    if len(lines) > _SHOWN:
        yield style(f"  … and {len(lines) - _SHOWN} more; see the result", "dim")
    bounds = bounds_text(result)
    for remedy in (bounds, held_text(result) if bounds else "", stand_in_text(result)):
        if remedy:
            yield style(f"  {plain(remedy)}", "dim")


_POLICY_WORDS = {
    "withhold": "no score",
    "zero": "scores 0",
    "worst_case": "counted as violated",
    "exclude": "left out",
    "worst": "counted at its worst",
    "best": "counted at its best",
}


def _undecided(result: Result, style: Style) -> Iterator[str]:
    """What could not be judged and how that counts; checks with the same reason share a line."""
    assumed = {a.finding: a for a in result.assumptions}
    reasons: dict[tuple[str, str, str], list[str]] = {}
    since_s: dict[str, float] = {}
    for key, finding in result.measured.findings.items():
        if finding.verdict in (Verdict.INCONCLUSIVE, Verdict.NOT_APPLICABLE):
            one = assumed.get(key)
            made = "" if one is None else one.policy
            policy = "makes no difference" if changes_nothing(made, result) else _POLICY_WORDS.get(made, "")
            # What is not applicable by its samples is undecided where it is counted as something else.
            judged = finding.verdict if one is None else Verdict.INCONCLUSIVE
            message = finding.message if one is None else undecided_text(result, one)
            reasons.setdefault((judged.value, policy, message), []).append(finding.check)
            since_s.setdefault(message, finding.span.start_s if finding.span else 0.0)
    if not reasons:
        return
    yield style("Not judged", "bold")
    # Undecided comes before not applicable. A reason that concerns few checks is the more telling one,
    # so it comes before one that concerns many; then by time.
    shown = sorted(
        reasons.items(),
        key=lambda item: (item[0][0], len(set(item[1])), since_s[item[0][2]], item[0][2]),
    )
    for (verdict, policy, message), checks in shown[:_SHOWN]:
        mark, look = _MARKS[Verdict(verdict)]
        effect = f" → {policy}" if policy else ""
        times = f" ({len(checks)} times)" if len(checks) > len(set(checks)) else ""
        names = ", ".join(dict.fromkeys(checks))
        yield f"  {names}: {style(mark + effect, look)}: {plain(message)}{times}"
    yield from _more(len(shown) - _SHOWN, style)


def _checks(result: Result, style: Style) -> Iterator[str]:
    yield style("Checks", "bold")
    for name, check in result.checks.items():
        counts = Counter(f.verdict for f in result.measured.of(name).values())
        parts = [
            style(f"{counts[verdict]} {word}", *([look] if look != "dim" else ["dim"]))
            for verdict, (word, look) in _MARKS.items()
            if counts[verdict]
        ]
        unpriced = "" if check["priced"] else style("  (not priced)", "dim")
        yield f"  {name:<20} {check['use']:<28} {', '.join(parts)}{unpriced}"


def _origin(result: Result, style: Style) -> Iterator[str]:
    for defect in result.measured.log_defects:
        yield f"log: {plain(defect.where)}: {plain(defect.message)} ({defect.count})"
    undecided = any(f.verdict is Verdict.INCONCLUSIVE for f in result.measured.findings.values())
    for missing in result.measured.unrecorded if undecided else ():
        yield f"log: not recorded: {plain(missing)}"
    for note in result.notes:
        yield style(f"note: {note}", "dim")
    if said := rests_on(result.measured.statements):
        yield style(f"rests on: {plain(said)}", "dim")
    for said in left_out(result):
        yield style(f"not attested: {plain(said)}", "dim")
    for source in result.provenance.inputs:
        parts = "" if source.read_bytes is None else f" of the {source.read_bytes} bytes that were read"
        yield style(f"{source.role}: {plain(source.name)}, sha256 {source.sha256[:16]}…{parts}", "dim")


# explain -------------------------------------------------------------------------------


def explain_text(result: Result, path: str, style: Style | None = None) -> str:
    """The ledger, or every line and finding that a path or name leads to, down to the samples.

    Args:
        result: The result.
        path: A ledger path or a part of one (`order_0`), an item of work, a check, a finding id
            (`separation#1`), a subject, a term of the rule set (`demerits`), or empty for the whole ledger.
        style: Colours or none.

    Returns:
        Empty when nothing matches.
    """
    style = style or Style()
    lines: list[str] = []
    adjusted = result.adjusted.ledger if result.adjusted else None
    if adjusted is not None:
        for line in _matching(adjusted, path):
            lines += [*_explained(line, _Explained(result), style, 0), ""]
    matching = _matching(result.ledger, path) if result.ledger is not None else []
    taken = [key for line in matching for key in taken_by(line)]
    explained = _Explained(result, without_alone(result, taken))
    items = _items(result, path)
    for item in items:
        lines += [*_item_lines(item, style), ""]
    for line in matching:
        lines += [style(plain(line.path), "bold"), *_explained(line, explained, style, 1), ""]
    if not path:
        return "\n".join(lines)
    term, used = ([], set()) if matching else _term(result, path, style)
    shown = {
        key for line in matching for inner in line.walk() if not inner.children for key in inner.findings
    }
    prices = _prices(result)
    for key, finding in result.measured.findings.items():
        named = path in (key, finding.check, finding.subject) or finding.check in used
        # An item that earned and cost nothing has no line, and is explained by what was found about it.
        named |= not matching and any(item.path and item.contains(finding.subject) for item in items)
        if named and key not in shown:
            term += [*_finding_lines(key, finding, style, 0, prices[key]), ""]
    return "\n".join(lines + term + [*_open_lines(result, path, shown, style)])


INTERVAL = "interval"
"""The name under which all that is open is explained."""


def _open_lines(result: Result, path: str, shown: Collection[str], style: Style) -> Iterator[str]:
    """What is open for a check or a subject: when, and what would be found in the best and worst world."""
    for one in result.measured.open:
        if path not in (INTERVAL, one.check, one.subject, *one.best, *one.worst):
            continue
        yield style(plain(f"open: {one.check} of {one.subject}"), "bold")
        for cause in one.causes:
            yield f"  {plain(cause.text)}"
            spans = [f"{span.start_s:.3f} to {span.end_s:.3f} s" for span in cause.spans[:_MOST_GAPS]]
            spans += [f"… and {len(cause.spans) - _MOST_GAPS} more"] if len(cause.spans) > _MOST_GAPS else []
            yield from (f"    {span}" for span in spans)
        for world, findings in (("best", one.best), ("worst", one.worst)):
            for key, finding in findings.items():
                if key not in shown:
                    yield style(f"  in the {world} world", "dim")
                    yield from _finding_lines(key, finding, style, 2)
        yield ""


_MOST_GAPS = 50
"""Of a cause, when so many of its gaps were is said."""


def _items(result: Result, path: str) -> list[Scope]:
    """The items of work that a path names, wholly or by its last parts; the trial by `trial`."""
    scopes = [*result.measured.scopes.walk()]
    if not path or path == result.measured.scopes.level:
        return scopes[:1] if path else []
    wanted = f"/{path.strip('/')}"
    exact = [scope for scope in scopes if f"/{scope.path}" == wanted]
    return exact or [scope for scope in scopes if f"/{scope.path}".endswith(wanted)]


def _item_lines(item: Scope, style: Style) -> Iterator[str]:
    """An item of work and its facts, which formulas take as they are."""
    yield style(plain(f"{item.level} {item.path}".strip()), "bold")
    for name, fact in item.facts.items():
        if isinstance(fact, int | float):
            yield f"  {plain(name)} = {fact:.9g}"
        else:
            yield f"  {plain(name)}: {'known to be absent' if fact is None else plain(fact)}"
    if not item.facts:
        yield style("  no facts are known about it", "dim")


def _earned(result: Result) -> dict[str, Decimal]:
    """What each finding earned by itself."""
    earned: dict[str, Decimal] = {}
    for line in result.ledger.walk() if result.ledger else ():
        if line.kind == "amount" and len(line.findings) == 1 and not line.children:
            earned[line.findings[0]] = earned.get(line.findings[0], Decimal(0)) + line.amount
    return earned


def _prices(result: Result) -> dict[str, str]:
    """What each finding took or earned, or why it changed nothing."""
    earned = _earned(result)
    priced = {name for name, check in result.checks.items() if check["priced"]}
    prices = {
        key: "" if finding.check in priced else " (not priced)"
        for key, finding in result.measured.findings.items()
    }
    prices |= {key: f" ({amount_text(amount, sign=True)})" for key, amount in earned.items() if amount}
    return prices | _costs(result)


def _matching(ledger: Line, path: str) -> list[Line]:
    """The topmost lines whose path is, ends with or contains the wanted segments, or that rest on a check."""
    if not path:
        return [ledger]
    wanted = f"/{path.strip('/')}/"
    paths = [(f"/{line.path}/", line) for line in ledger.walk()]
    of_check = [line for _, line in paths if _rests_on(line, wanted.strip("/"))]
    # From the exact path to the loosest reading; the first that finds anything is meant.
    for found in (
        [line for path, line in paths if path == wanted],
        of_check,
        [line for path, line in paths if path.endswith(wanted)],
        [line for path, line in paths if wanted in path],
        [line for _, line in paths if wanted.strip("/") in re.findall(r"\w+", line.label)],
    ):
        if found:
            return [line for line in found if not any(_below(line, other) for other in found)]
    return []


def _rests_on(line: Line, check: str) -> bool:
    """Whether all that a line rests on are findings of this check."""
    found = [key for inner in line.walk() for key in inner.findings]
    return bool(found) and all(key.rpartition("#")[0] == check for key in found)


def _term(result: Result, name: str, style: Style) -> tuple[list[str], set[str]]:
    """A term of the score that has no line of its own: how its value came about, and the checks it uses."""
    for line in result.ledger.walk() if result.ledger else ():
        found = next((t for t in _all_traced(line.trace) if t.label == name), None)
        if found is not None:
            labels = " ".join(traced.label for traced in _all_traced(found))
            used = set(re.findall(r"\w+", labels)) & set(result.checks)
            return [style(f"{plain(line.path)}: {plain(name)}", "bold"), *_traced(found, style, 1), ""], used
    return [], set()


def _all_traced(traced: Traced | None) -> Iterator[Traced]:
    if traced is not None:
        yield traced
        for child in traced.children:
            yield from _all_traced(child)


def _below(line: Line, other: Line) -> bool:
    return line.path.startswith(f"{other.path}/")


@dataclass(frozen=True)
class _Explained:
    """A result, and for findings the score as it would be without each of them alone."""

    result: Result
    alone: Mapping[str, Decimal] = field(default_factory=dict)


def _explained(line: Line, of: _Explained, style: Style, depth: int) -> Iterator[str]:
    yield _ledger_line(line, style, depth)
    if line.kind == "taken" and len(line.findings) == 1 and line.findings[0] in of.alone:
        score = of.alone[line.findings[0]]
        gain = amount_text(score - (of.result.score or Decimal(0)), sign=True)
        yield style(f"{'  ' * (depth + 1)}without it alone: {amount_text(score)} ({gain})", "cyan")
    if line.children and line.trace is not None:
        yield from _traced(line.trace, style, depth + 1)
    for child in line.children:
        yield from _explained(child, of, style, depth + 1)
    if line.kind == "neutral" and depth > 1:
        yield style(f"{'  ' * (depth + 1)}{', '.join(line.findings)}", "dim")
    elif not line.children:
        if line.trace is not None and line.trace.children:
            yield from _traced(line.trace, style, depth + 1)
        for key in line.findings:
            yield from _finding_lines(key, of.result.measured.in_all_worlds[key], style, depth + 1)


def _traced(traced: Traced, style: Style, depth: int) -> Iterator[str]:
    yield style(f"{'  ' * depth}{plain(traced.label)} = {traced.value:.9g}", "cyan")
    for child in traced.children:
        if child.kind != "number":
            yield from _traced(child, style, depth + 1)


def _finding_lines(key: str, finding: Finding, style: Style, depth: int, cost: str = "") -> Iterator[str]:
    space = "  " * depth
    mark, look = _MARKS[finding.verdict]
    yield f"{space}{key} {style(mark, look)} {_where(finding)}{plain(finding.message)}{cost}"
    if finding.robustness is not None:
        yield f"{space}  margin {finding.robustness:.9g} {finding.unit}"
    for name, value in finding.quantities.items():
        yield f"{space}  {name} = {value:.9g}"
    for name, word in finding.labels.items():
        yield f"{space}  {name}: {plain(word)}"
    for sample in finding.evidence:
        yield f"{space}  {_sample(sample)}"
    if finding.clause:
        yield style(f"{space}  {finding.clause}", "dim")


def _sample(sample: Sample) -> str:
    value = sample.value
    number = ", ".join(f"{v:.9g}" for v in value) if isinstance(value, tuple) else f"{value:.9g}"
    return f"at {sample.t_s:.3f} s: {plain(sample.signal)} = {number} {sample.unit}"
