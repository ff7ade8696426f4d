"""The trial from start to end: work, what was handed in, and a lane for each monitor."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from ariac_score.checks.findings import Finding, Verdict
from ariac_score.report.html.scale import Scale
from ariac_score.report.html.wording import brief, seconds
from ariac_score.report.words import words_of
from ariac_score.results.result import Result
from ariac_score.trial.model import OfficialOrder
from ariac_score.trial.spans import Span
from ariac_score.trial.words import HANDED_IN, Words

__all__ = ["Block", "Lane", "Timeline", "axis_of", "timeline_of"]

MOST_BLOCKS = 400
"""A lane with more episodes than this shows the longest."""
_CLOCKS_AGREE_S = 1.0
"""A record that dates a submission later than this after the end is of another clock."""


@dataclass(frozen=True)
class Block:
    """A stretch of a lane.

    Attributes:
        state: `violated`, `inconclusive`, `work` or `submitted`.
        left: Where it begins, percent of the width.
        width: How long it is, percent of the width.
        title: What it is, in words.
        finding: Id of the finding it leads to; empty where there is none.
    """

    state: str
    left: float
    width: float
    title: str
    finding: str = ""


@dataclass(frozen=True)
class Lane:
    """One row of the timeline.

    Attributes:
        name: The check, the item of work, or what else it shows.
        use: The plugin, for a check.
        ground: The state between the blocks: `satisfied`, `not_applicable`, `inconclusive` or empty.
        blocks: In order of time.
        counts: How many findings there are, by verdict.
        untimed: Ids of violations that have no time.
    """

    name: str
    use: str = ""
    ground: str = ""
    blocks: tuple[Block, ...] = ()
    counts: Mapping[str, int] | None = None
    untimed: tuple[str, ...] = ()


@dataclass(frozen=True)
class Timeline:
    """The lanes, over one scale of time."""

    scale: Scale
    work: tuple[Lane, ...]
    monitors: tuple[Lane, ...]


def axis_of(result: Result) -> Scale | None:
    """The one scale of time of a page, for the trial and all that is drawn; `None`: nothing has a time."""
    measured, sketch = result.measured, result.measured.sketch
    times = [] if measured.window is None else [measured.window.start_s, measured.window.end_s]
    if sketch:
        drawn = [*(c.t_s for c in sketch.curves), *(route.t_s for route in sketch.routes)]
        times += [end for t_s in drawn for end in (t_s[0], t_s[-1])]
    return Scale(min(times), max(times)) if times and min(times) < max(times) else None


def timeline_of(result: Result, monitors: Iterable[str], axis: Scale | None = None) -> Timeline | None:
    """The timeline of a trial; `None` where the log does not say when it began and ended.

    Args:
        result: The result.
        monitors: Names of the checks that have a lane.
        axis: The times of the page, which all its drawings share; by default those of the trial.
    """
    window = result.measured.window
    if window is None or window.duration_s <= 0:
        return None
    scale = axis or Scale(window.start_s, window.end_s)
    lanes = [_monitor(name, result, scale) for name in monitors]
    return Timeline(scale, tuple(_work(result, scale, window)), tuple(lanes))


def _work(result: Result, scale: Scale, window: Span) -> Iterable[Lane]:
    words = words_of(result)
    announced = words.hands_in or any(t_s is not None for t_s in result.measured.orders.values())
    for item_id, announced_s in result.measured.orders.items():
        handed, otherwise = _handed_in(result, item_id, words)
        # Without a known beginning or end the block reaches to the edge of the timeline.
        start_s = window.start_s if announced_s is None else announced_s
        said = f"announced at {seconds(start_s)}"
        if announced_s is None:
            said = "announced at an unknown time" if announced else ""
        said += otherwise or (f", last {words.one(HANDED_IN)} at {seconds(handed[-1])}" if handed else "")
        end_s = handed[-1] if handed else window.end_s
        blocks = [Block("work", *scale.stretch(start_s, end_s), said.removeprefix(", "))]
        blocks += [Block("submitted", scale.at(t), 0.0, f"submitted at {seconds(t)}") for t in handed]
        yield Lane(item_id, blocks=tuple(blocks))


def _handed_in(result: Result, item_id: str, words: Words) -> tuple[list[float], str]:
    """The times, s, at which an item was handed in; without any, the end of a sentence."""
    measured = result.measured
    own = [item for item in measured.scopes.inner if item.path == item_id]
    # What has nothing inside is handed in itself.
    inside = {scope.path.rpartition("/")[2] for item in own for scope in (item, *item.inner)}
    brought = measured.sketch.brought if measured.sketch else ()
    handed = sorted(one.submitted_s for one in brought if one.item in inside)
    if handed:
        return handed, ""
    summaries = measured.official.summaries if measured.official else ()
    for summary in summaries:
        if summary.id == item_id and summary.submitted_s is not None:
            return _by_the_record(result, summary)
        if summary.id == item_id and summary.submitted is not None:
            return [], f", {'' if summary.submitted else 'not '}submitted by the official record"
    if not any(item.inner for item in own) or not words.hands_in:
        return [], ""
    # Only a log that would have shown submissions can say that there was none.
    if measured.sketch and "submissions" in measured.witnessed:
        return [], ", never submitted"
    return [], f", no {words.one(HANDED_IN)} is recorded"


def _by_the_record(result: Result, summary: OfficialOrder) -> tuple[list[float], str]:
    """When an official record dates the submission of an item; on the clock of the trial where known."""
    assert summary.submitted_s is not None  # the caller has looked
    said = f", submitted at {seconds(summary.submitted_s)} by the official record"
    announced_s, window = result.measured.orders.get(summary.id), result.measured.window
    if announced_s is None or summary.announced_s is None or window is None:
        return [], said
    # The record may count from another zero than the log; how long an item took is the same on both clocks.
    at_s = announced_s + summary.submitted_s - summary.announced_s
    inside = announced_s <= at_s <= window.end_s + _CLOCKS_AGREE_S
    return ([min(at_s, window.end_s)] if inside else []), said


def _monitor(name: str, result: Result, scale: Scale) -> Lane:
    found = result.measured.of(name)
    counts: dict[str, int] = {}
    for finding in found.values():
        counts[finding.verdict.value] = counts.get(finding.verdict.value, 0) + 1
    shown = _longest((key, f) for key, f in found.items() if f.span and _marked(f))
    blocks = [
        Block(
            finding.verdict.value,
            *scale.stretch(finding.span.start_s, finding.span.end_s),
            f"{brief(finding.subject)}, {seconds(finding.span.start_s)} to {seconds(finding.span.end_s)}",
            key,
        )
        for key, finding in shown
        if finding.span
    ]
    untimed = tuple(key for key, f in found.items() if _marked(f) and not f.span)
    return Lane(
        name, result.checks[name]["use"], _ground(counts, untimed, found), tuple(blocks), counts, untimed
    )


def _marked(finding: Finding) -> bool:
    return finding.verdict in (Verdict.VIOLATED, Verdict.INCONCLUSIVE)


def _longest(found: Iterable[tuple[str, Finding]]) -> Sequence[tuple[str, Finding]]:
    kept = sorted(found, key=lambda item: -item[1].span.duration_s if item[1].span else 0.0)[:MOST_BLOCKS]
    return sorted(kept, key=lambda item: item[1].span.start_s if item[1].span else 0.0)


def _ground(counts: Mapping[str, int], untimed: Sequence[str], found: Mapping[str, Finding]) -> str:
    """The state that a lane shows between its blocks."""
    # Undecided without a time means undecided all of the time.
    if any(found[key].verdict is Verdict.INCONCLUSIVE for key in untimed):
        return "inconclusive"
    if counts.get("satisfied") or counts.get("violated"):
        return "satisfied"
    return "not_applicable" if counts.get("not_applicable") and not counts.get("inconclusive") else ""
