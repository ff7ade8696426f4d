"""The page of one trial: prepares a result for its template."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timezone
from decimal import Decimal
from typing import Any

from markupsafe import Markup

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.engine.ask import ONLY_OFFICIAL
from ariac_score.report.html.charts import Chart, chart_of
from ariac_score.report.html.page import page, shipped
from ariac_score.report.html.panels import panels_of
from ariac_score.report.html.parameters import parameters_shown
from ariac_score.report.html.parts import parts_of
from ariac_score.report.html.plan import plan_of, side_of
from ariac_score.report.html.replay import replay_of
from ariac_score.report.html.scale import Scale
from ariac_score.report.html.timeline import axis_of, timeline_of
from ariac_score.report.html.waterfall import waterfall_of
from ariac_score.report.html.wording import brief, file_name, number, seconds
from ariac_score.report.html.work import grouped, work_of
from ariac_score.report.openness import is_at_worst, which_counts, would_narrow
from ariac_score.report.places import Places
from ariac_score.report.statements import changes_nothing, is_held
from ariac_score.report.summary import summary_of
from ariac_score.report.words import capital, words_of
from ariac_score.results.adjustments import interval_that_counts
from ariac_score.results.doubt import why_withheld
from ariac_score.results.result import Result
from ariac_score.results.sketch import Sketch
from ariac_score.review.lost_points import recoverable_losses
from ariac_score.review.task_and_safety import task_and_safety
from ariac_score.scoring.decimals import in_own_decimals
from ariac_score.scoring.policy import MADE, POLICIES
from ariac_score.scoring.ruleset import rule_set_from_text
from ariac_score.scoring.steward import Adjustment
from ariac_score.trial.clock import Clock
from ariac_score.trial.words import Words

__all__ = ["SCRIPT", "anchor", "embedded_result", "trial_page"]

NOTHING_ABOVE = Markup("")
SCRIPT = shipped("times.js") + shipped("replay.js")
"""The one script of the page, as its content policy names it."""
MOST_CHARTS = 12
MOST_LOSSES = 12
# In `\\u003c` the backslash itself is escaped, and plain text follows: ours stands only after an even
# number of backslashes.
_ESCAPED = re.compile(r"((?<!\\)(?:\\\\)*)\\u003c")
_EMBEDDED = re.compile(r'<script type="application/json" id="ariac-score-result">\n(.*?)</script>', re.DOTALL)


@in_own_decimals
def trial_page(
    result: Result, stored: str, home: str = "", above: Markup = NOTHING_ABOVE, run: str = ""
) -> str:
    """The page of a trial: one file that needs nothing else.

    Args:
        result: The result.
        stored: The same as canonical JSON, which the page carries inside.
        home: Link to the page of its competition; empty for none.
        above: What stands before it on the page, escaped.
        run: Which run of the trial it is, such as `run 2 of 3`; empty where that is not known.
    """
    measured, findings = result.measured, result.measured.findings
    rule_set = rule_set_from_text(result.rules, file="the rules in the result")
    monitors = [name for name, check in rule_set.checks.items() if check.group == "ariac_score.monitors"]
    ledger = result.ledger or result.task
    falls = waterfall_of(ledger, findings) if ledger else None
    sketch = measured.sketch
    axis = axis_of(result)
    charts, omitted = _charts(result, axis)
    losses = recoverable_losses(result, rule_set)
    words, idle = words_of(result), _idle(result, monitors)
    split = task_and_safety(result, rule_set)
    return page(
        "trial.html.j2",
        script=SCRIPT,
        home=home,
        above=above,
        run=run,
        summary=summary_of(result, rule_set),
        parts=parts_of(result, split) if split else None,
        places=Places(result),
        result=result,
        why_none=why_withheld(result),
        task_at_worst=is_at_worst(result),
        measured=measured,
        stored=stored,
        decisions=_decisions(result),
        decided={one.finding: one for one, _ in _decisions(result) if one.finding},
        counts=Counter(f.verdict.value for f in findings.values()),
        ledger=ledger,
        falls=falls,
        chart_words=_chart_words,
        policies=POLICIES,
        assumed=_assumed(result),
        no_difference=all(changes_nothing(one.policy, result) for one in result.assumptions),
        open_ends=interval_that_counts(result),
        is_held=is_held(result),
        lacking=[] if result.score is not None else would_narrow(result),
        which_counts=which_counts,
        only_official=any(one.message == ONLY_OFFICIAL for one in result.assumptions),
        clock=_clock(measured.clock),
        losses=losses[:MOST_LOSSES],
        loss_decimals=min(result.digits, 2),
        timeline=timeline_of(result, monitors, axis),
        axis=axis,
        replay=replay_of(result, axis),
        charts=charts,
        omitted=omitted,
        plan=plan_of(sketch, findings) if sketch else None,
        side=side_of(sketch, findings) if sketch else None,
        sketch=sketch,
        work=work_of(result),
        words=words,
        capital=capital,
        period=words.period,
        series_heading=_series_heading(charts, sketch),
        shown=_shown(result, words, charts, idle),
        panels=panels_of(result),
        groups=_groups(result, monitors),
        idle=idle,
        anchor=anchor,
        checks=parameters_shown(result),
        grouped=grouped,
        verdicts=[verdict.value for verdict in Verdict],
    )


def anchor(name: str, kind: str = "f") -> str:
    """The id of the element that shows a finding, an item of work or a check; safe to link to.

    >>> anchor("separation#1"), anchor("order 0", "o")
    ('f-separation.1', 'o-order-0-202f8b12ba2c')
    """
    check, mark, number = name.rpartition("#")
    return f"{kind}-{file_name(check)}.{number}" if mark else f"{kind}-{file_name(name)}"


@dataclass(frozen=True)
class _Group:
    """The findings of one check, violations first."""

    name: str
    check: Mapping[str, Any]
    monitor: bool
    counts: Mapping[str, int]
    clauses: tuple[str, ...]
    findings: tuple[tuple[str, Finding], ...]


_ORDER = (Verdict.VIOLATED, Verdict.INCONCLUSIVE, Verdict.SATISFIED, Verdict.NOT_APPLICABLE)


def _groups(result: Result, monitors: list[str]) -> list[_Group]:
    groups = []
    for name, check in result.checks.items():
        found = result.measured.of(name)
        ordered = sorted(found.items(), key=lambda item: _ORDER.index(item[1].verdict))
        groups.append(
            _Group(
                name,
                check,
                name in monitors,
                Counter(f.verdict.value for f in found.values()),
                tuple(dict.fromkeys(f.clause for f in found.values() if f.clause)),
                tuple(ordered),
            )
        )
    return sorted(groups, key=lambda group: (not group.counts.get("violated"), not group.monitor))


def _shown(
    result: Result, words: Words, charts: list[Chart], idle: Mapping[str, list[str]]
) -> frozenset[str]:
    """The sections that have something to say: a competition without a clock or bodies has none of these."""
    measured = result.measured
    found = measured.findings.values()
    timed = measured.window or measured.coverage or any(finding.span for finding in found)
    undecided = any(f.verdict is Verdict.INCONCLUSIVE for f in found) and measured.coverage
    sections = {
        "timeline": timed or any(t_s is not None for t_s in measured.orders.values()),
        "series": charts or idle or undecided or measured.sketch is None,
        "plan": measured.coverage or measured.sketch is None or measured.sketch.routes,
        "work": words.of_work or measured.scopes.inner,
    }
    return frozenset(name for name, something in sections.items() if something)


def _series_heading(charts: list[Chart], sketch: Sketch | None) -> str:
    """What the charts show; distances by the kinds of bodies that they are between, where these are alike."""
    distances = all("distance" in c.curve.what or "separation" in c.curve.what for c in charts)
    if not charts or not distances:
        return "Measured over time"
    kinds = {route.body: route.kind for route in sketch.routes} if sketch else {}
    between = {tuple(kinds.get(body, body) for body in c.curve.subject.split("/")) for c in charts}
    return f"Separation of {' and '.join(between.pop())}" if len(between) == 1 else "Separation"


def _idle(result: Result, monitors: list[str]) -> dict[str, list[str]]:
    """The monitors that had nothing to judge in the whole trial, by reason."""
    idle: dict[str, list[str]] = {}
    for name in monitors:
        found = result.measured.of(name).values()
        reasons = {f.message for f in found if f.verdict is Verdict.NOT_APPLICABLE and f.subject == "trial"}
        # A monitor that says something else too had something to judge.
        if len(found) == 1 and reasons:
            idle.setdefault(reasons.pop(), []).append(name)
    return idle


def _decisions(result: Result) -> list[tuple[Adjustment, Decimal | None]]:
    """The decisions of stewards, and the points that each one moved; `None` where there is no score."""
    if result.adjusted is None:
        return []
    # The adjusted ledger is the automatic score and a factor for each decision, in their order.
    lines = result.adjusted.ledger.children if result.adjusted.ledger else ()
    moved: list[Decimal | None] = [line.amount for line in lines if line.kind == "factor"]
    decided = result.adjusted.adjustments
    return list(zip(decided, moved or [None] * len(decided), strict=True))


_NO_DIFFERENCE = "makes no difference"


def _assumed(result: Result) -> list[tuple[str, str, list[str]]]:
    """What was made of undecided findings, the reason, and whom both concern."""
    alike: dict[tuple[str, str], list[str]] = {}
    for one in result.assumptions:
        policy = _NO_DIFFERENCE if changes_nothing(one.policy, result) else {**POLICIES, **MADE}[one.policy]
        alike.setdefault((policy, one.message), []).append(one.finding)
    return [(policy, message, found) for (policy, message), found in alike.items()]


@dataclass(frozen=True)
class _ClockShown:
    """A clock in words: what it shows, how times were taken from it, and what is 0 s on the page."""

    kind: str
    detail: str
    origin: str


_SINCE_1970 = 10**18
"""A clock that shows more ns than this counts from 1970: 2001 and later; simulated clocks show far less."""


def _clock(said: str) -> _ClockShown:
    clock = Clock.parse(said)
    if clock.origin_ns is None:
        return _ClockShown(clock.kind, clock.detail, "")
    whole_s, ns = divmod(clock.origin_ns, 10**9)
    exact = f"{whole_s}.{ns:09d}".rstrip("0").rstrip(".") + " s of that clock"
    if clock.origin_ns < _SINCE_1970:
        return _ClockShown(clock.kind, clock.detail, exact)
    date = datetime.fromtimestamp(whole_s, tz=timezone.utc)
    return _ClockShown(clock.kind, clock.detail, f"{date:%Y-%m-%d %H:%M:%S} UTC, {exact}")


def _charts(result: Result, axis: Scale | None) -> tuple[list[Chart], int]:
    """The charts, those with the worst margins first, and how many were left out."""
    sketch = result.measured.sketch
    if sketch is None:
        return [], 0
    margins: dict[tuple[str, str], float] = {}
    for finding in result.measured.findings.values():
        if finding.robustness is not None:
            key = finding.check, finding.subject
            margins[key] = min(finding.robustness, margins.get(key, finding.robustness))
    curves = sorted(
        sketch.curves, key=lambda c: (margins.get((c.check, c.subject), float("inf")), c.subject, c.check)
    )
    drawn = [chart_of(curve, result.measured.findings, axis) for curve in curves[:MOST_CHARTS]]
    return [chart for chart in drawn if chart is not None], max(len(curves) - MOST_CHARTS, 0)


def _chart_words(chart: Chart) -> str:
    """A chart in a sentence, for screen readers."""
    curve, mark = chart.curve, chart.marks[-1]
    words = f"{brief(curve.what)} of {brief(curve.subject)}"
    words += f" from {seconds(chart.x.start)} to {seconds(chart.x.end)}"
    limit = f", limit there {number(mark.limit)} {curve.unit}" if mark.limit is not None else ""
    broken = f"; {len(chart.findings)} violations" if chart.findings else ""
    return f"{words}; at its worst {number(mark.value)} {curve.unit} at {seconds(mark.t_s)}{limit}{broken}"


def embedded_result(text: str) -> str | None:
    """The result inside a page, byte for byte; `None` where the text is no such page."""
    found = _EMBEDDED.search(text)
    return None if found is None else _ESCAPED.sub(r"\1<", found.group(1))
