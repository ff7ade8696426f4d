"""A ranking as text and as CSV."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence

from ariac_score.ranking.compare import Difference
from ariac_score.ranking.nist_text import Evaluation
from ariac_score.ranking.rank import OUTCOMES, Ranking, RunOutcome, Standing
from ariac_score.report.style import Style, plain
from ariac_score.report.text import amount_text

__all__ = ["changes_text", "ranking_csv", "ranking_text", "strict_text"]

_ORDINARY = ("scored",)


def ranking_text(
    ranking: Ranking,
    strict: Evaluation | None = None,
    differences: Sequence[Difference] = (),
    style: Style | None = None,
) -> str:
    """The leaderboard, then what is out of the ordinary, then what the organisers' program makes of it."""
    style = style or Style()
    sections = [
        _head(ranking, style),
        _leaderboard(ranking, style),
        _unusual(ranking, style),
        _cohort(ranking, style),
        _strict(strict, differences, style) if strict else (),
    ]
    return "\n\n".join("\n".join(lines) for lines in map(list, sections) if lines) + "\n"


def _head(ranking: Ranking, style: Style) -> Iterator[str]:
    yield style(plain(ranking.title), "bold") + f" by {ranking.rule_set[0]}"
    counted = (
        _many(len(ranking.standings), "team"),
        _many(len(ranking.trials), "trial"),
        _many(len(ranking.runs), "run"),
    )
    yield style(f"{', '.join(counted)}, {sum(run.kept for run in ranking.runs)} of them count", "dim")


def _many(number: int, what: str) -> str:
    """A number of things.

    >>> _many(1, "trial"), _many(3, "trial")
    ('1 trial', '3 trials')
    """
    return f"{number} {what}{'' if number == 1 else 's'}"


def _leaderboard(ranking: Ranking, style: Style) -> Iterator[str]:
    judged = any(standing.judges is not None for standing in ranking.standings)
    head = ["rank", "team", *(["value", "execution", "judges"] if judged else ["score"]), *ranking.trials]
    rows = [head, *(_row(standing, ranking, judged=judged) for standing in ranking.standings)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(head))]
    for number, row in enumerate(rows):
        cells = [
            cell.ljust(width) if i == 1 else cell.rjust(width)
            for i, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        line = "  ".join(cells).rstrip()
        yield style(line, "dim") if number == 0 else line
    shared = [s.rank for s in ranking.standings if s.rank is not None]
    if len(set(shared)) < len(shared):
        yield style("= shares its rank: nothing the rules name separates these teams", "dim")
    if any(cell.outcome not in _ORDINARY for s in ranking.standings for cell in s.cells.values()):
        yield style("* see below", "dim")


def _row(standing: Standing, ranking: Ranking, *, judged: bool) -> list[str]:
    same = sum(1 for other in ranking.standings if other.rank == standing.rank)
    rank = "-" if standing.rank is None else f"{standing.rank}{'=' if same > 1 else ''}"
    value = "-" if standing.value is None else f"{standing.value:.10g}"
    judges = "-" if standing.judges is None else amount_text(standing.judges)
    execution = amount_text(standing.execution)
    cells = [
        amount_text(standing.cells[trial].score) + ("" if standing.cells[trial].outcome in _ORDINARY else "*")
        for trial in ranking.trials
    ]
    return [rank, plain(standing.name), *([value, execution, judges] if judged else [execution]), *cells]


def _unusual(ranking: Ranking, style: Style) -> Iterator[str]:
    """Every run that did not simply get a score, and every trial without one."""
    lines = [
        f"  {plain(s.team)}, {plain(trial)}: {OUTCOMES['no_run']}, so the trial brings 0"
        for s in ranking.standings
        for trial, cell in s.cells.items()
        if cell.outcome == "no_run"
    ]
    lines += _run_lines([run for run in ranking.runs if run.outcome not in _ORDINARY])
    lines += [f"  passed over: {plain(stranger)}" for stranger in ranking.strangers]
    lines += [
        f"  {plain(s.team)}: {plain(remark)}"
        for s in ranking.standings
        for remark in s.remarks
        if remark.startswith(("no value", "marks of"))
    ]
    if lines:
        yield style("Out of the ordinary", "bold")
        yield from lines


def _run_lines(runs: Sequence[RunOutcome]) -> Iterator[str]:
    """A line for each run; runs of a team and trial with one reason share one."""
    groups: dict[tuple[str, str, str, str], list[int]] = {}
    for run in runs:
        reason = run.reason or OUTCOMES[run.outcome]
        groups.setdefault((run.team, run.trial, run.outcome, reason), []).append(run.number)
    for (team, trial, outcome, reason), numbers in groups.items():
        which = f"run{'s' if len(numbers) > 1 else ''} {', '.join(map(str, numbers))}"
        yield f"  {plain(team)}, {plain(trial)}, {which}: {outcome}: {plain(reason)}"


def _cohort(ranking: Ranking, style: Style) -> Iterator[str]:
    if ranking.cohort is None:
        return
    yield style("Across teams", "bold")
    if not any(means for values in ranking.cohort.trials.values() for means in values.values()):
        yield "  nothing: no run counts"
    for trial, values in ranking.cohort.trials.items():
        for name, means in values.items():
            for path, mean in means.items():
                where = f"{plain(trial)}{'/' + plain(path) if path else ''}"
                value = "none" if mean.value is None else f"{mean.value:.10g}"
                left_out = f", {mean.left_out} left out" if mean.left_out else ""
                yield f"  {where}: mean {name} {value} ({_many(mean.teams, 'team')}{left_out})"


def _strict(strict: Evaluation, differences: Sequence[Difference], style: Style) -> Iterator[str]:
    yield style("The organisers' own program", "bold")
    if strict.stops:
        yield "  it would have ended without a ranking; without what stopped it:"
        for stop in strict.stops:
            where = ", ".join(plain(part) for part in (stop.team, stop.run or stop.trial))
            yield f"  {where}: {stop.exception}: {plain(stop.cause)}"
    if not differences:
        yield "  gives the same scores and ranks"
    for d in differences:
        theirs, ours = ("none" if v is None else f"{v:.10g}" for v in (d.strict, d.robust))
        yield f"  {plain(d.team)}, {plain(d.what)}: {theirs} there, {ours} here: {plain(d.because)}"


def strict_text(strict: Evaluation, style: Style | None = None) -> str:
    """The organisers' leaderboard, and what would have stopped their program."""
    style = style or Style()
    lines = [style("Leaderboard of the organisers' own program", "bold")]
    lines += [
        f"  {place}. {plain(team)}  {score!r}" for place, (team, score) in enumerate(strict.leaderboard, 1)
    ]
    lines += ["", *_strict_stops(strict)] if strict.stops else []
    return "\n".join(lines) + "\n"


def _strict_stops(strict: Evaluation) -> Iterator[str]:
    yield "It would have ended without a ranking; these figures leave out what stopped it:"
    for stop in strict.stops:
        where = ", ".join(plain(part) for part in (stop.trial, stop.team, stop.run) if part)
        yield f"  {where}: {stop.exception}: {plain(stop.cause)}"


def ranking_csv(ranking: Ranking) -> str:
    """One line for each team, best first, with the score and outcome of each trial."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    columns = [f"{trial} {what}" for trial in ranking.trials for what in ("score", "outcome", "runs")]
    writer.writerow(["rank", "team", "name", "value", "execution", "judges", *columns, "remarks"])
    for standing in ranking.standings:
        row: list[str] = [
            "" if standing.rank is None else str(standing.rank),
            _safe(standing.team),
            _safe(standing.name),
            "" if standing.value is None else repr(standing.value),
            f"{standing.execution:f}",
            "" if standing.judges is None else f"{standing.judges:f}",
        ]
        for trial in ranking.trials:
            cell = standing.cells[trial]
            row += [f"{cell.score:f}", cell.outcome, " ".join(map(str, cell.runs))]
        writer.writerow([*row, _safe("; ".join(standing.remarks))])
    return out.getvalue()


def _safe(text: str) -> str:
    """Text that a spreadsheet does not take for a formula."""
    return f"'{text}" if text[:1] in ("=", "+", "-", "@", "\t", "\r") else text


def changes_text(before: Ranking, after: Ranking) -> Iterator[str]:
    """What another rule set changes: the runs whose score moves, then every team's score and rank."""
    runs = {run.key: run for run in after.runs}
    unchanged = 0
    for run in before.runs:
        then = runs[run.key]
        if (run.score, run.outcome) == (then.score, then.outcome):
            unchanged += 1
        else:
            yield f"{plain(run.team)}, {plain(run.trial)}, run {run.number}: {_told(run)} -> {_told(then)}"
    yield f"{unchanged} of {len(before.runs)} runs are worth the same"
    standings = {standing.team: standing for standing in after.standings}
    for standing in before.standings:
        then_standing = standings[standing.team]
        sums = " -> ".join(amount_text(s.execution) for s in (standing, then_standing))
        yield f"{plain(standing.name)}: {sums}, rank {_rank_change(standing.rank, then_standing.rank)}"


def _told(run: RunOutcome) -> str:
    return run.outcome if run.score is None else amount_text(run.score)


def _rank_change(before: int | None, after: int | None) -> str:
    shown = ["none" if rank is None else str(rank) for rank in (before, after)]
    return f"{shown[0]} (unchanged)" if before == after else f"{shown[0]} -> {shown[1]}"
