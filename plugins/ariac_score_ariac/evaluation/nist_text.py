"""The organisers' evaluation of 2023 and 2024, reproduced from its texts, quirks included.

The program reads `trial_log.txt` by line positions and `sensor_cost.txt` by line number,
looks an order up by the first line that contains its id, silently keeps the value of the
order before where it finds none, and ends with an exception at several things a run can
hold. Here each such exception is a named stop: what it concerns is set aside, and the
other teams are evaluated all the same.

Source: jfernandez37/ARIAC_evaluation, automated_evaluation/scoring (score_trial.py at 0acf89b,
score_competition.py at 09a2382); ARIAC rulebook notes, section 9; log formats, sections 5.1,
6 and 9. Where the notes and the program differ, the program is followed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ariac_score import Entry, Evaluation, PlannedItem, Stop, add_up

__all__ = ["NistTextEvaluation", "RunTexts", "evaluate", "results_csv"]

MAX_TEXT_BYTES = 4_000_000
"""An official text has a few kilobytes."""

_SUMMARY, _DETAILS = "Order Summary", "Order Details"
_LINES_OF_AN_ORDER, _SCORE_IN_ORDER = 8, 5
_COMPLETION_LINE = 6
_COST_LINE = 15
_SCORE_AFTER_ID, _DURATION_AFTER_ID = 5, 7
_PRIORITY_FACTOR = 3


@dataclass(frozen=True)
class RunTexts:
    """The texts of one run as the program finds them.

    Attributes:
        folder: Name of the run's folder, such as `kitting_2`.
        trial_log: Text of `trial_log.txt`; `None` when there is none.
        sensor_cost: Text of `sensor_cost.txt`; `None` when there is none.
    """

    folder: str
    trial_log: str | None
    sensor_cost: str | None

    @property
    def trial(self) -> str:
        """The folder's name without what follows its last underscore."""
        return self.folder.rpartition("_")[0]


class NistTextEvaluation:
    """NIST's evaluation of 2023 and 2024, from the texts in the folders of runs.

    Reads:
        `<team>/<trial>_<n>/trial_log.txt` and `sensor_cost.txt`.
    Source:
        jfernandez37/ARIAC_evaluation, automated_evaluation/scoring.
    """

    def evaluate(self, logs: Path, work: Mapping[str, Sequence[PlannedItem]]) -> Evaluation:
        """Evaluate every team folder, whether or not the competition lists the team."""
        teams = {team.name: [_texts(run) for run in _folders(team)] for team in _folders(logs)}
        # The program takes trials from the folders; of one without a configuration it knows no order.
        found = {run.trial for runs in teams.values() for run in runs}
        return evaluate(teams, {trial: work.get(trial, []) for trial in found})

    def results_csv(self, evaluation: Evaluation) -> str:
        """The table `scores.csv` of the program."""
        return results_csv(evaluation)


def _folders(folder: Path) -> list[Path]:
    return sorted(entry for entry in folder.iterdir() if entry.is_dir())


def _texts(folder: Path) -> RunTexts:
    return RunTexts(folder.name, _text(folder / "trial_log.txt"), _text(folder / "sensor_cost.txt"))


def _text(file: Path) -> str | None:
    try:
        if file.stat().st_size > MAX_TEXT_BYTES:
            return None  # no text of the program's; as if it were missing
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return None


class _StoppedError(Exception):
    """The program ends here; caught in this module."""

    def __init__(self, exception: str, cause: str) -> None:
        super().__init__(exception, cause)
        self.exception, self.cause = exception, cause


def evaluate(
    teams: Mapping[str, Sequence[RunTexts]], orders: Mapping[str, Sequence[PlannedItem]]
) -> Evaluation:
    """Evaluate as the organisers' program does.

    Args:
        teams: For each team its runs, both in the order in which the program lists them.
        orders: For each trial its orders, in the order of the trial file.
    """
    stops: list[Stop] = []
    trials: dict[str, dict[str, Entry]] = {}
    run_at_all = {run.trial for runs in teams.values() for run in runs}
    for trial in sorted(run_at_all & orders.keys()):
        found = {
            team: entry
            for team, runs in teams.items()
            if (entry := _entry(trial, team, runs, orders[trial], stops)) is not None
        }
        trials[trial] = _scored(trial, found, orders[trial], stops)
    return Evaluation(trials, orders, _leaderboard(teams, trials, stops), tuple(sorted(stops)))


def _entry(
    trial: str, team: str, runs: Sequence[RunTexts], orders: Sequence[PlannedItem], stops: list[Stop]
) -> Entry | None:
    """The best run of a team; a run at which the program ends is set aside."""
    ranked: list[tuple[tuple[int, float], RunTexts]] = []
    for run in (run for run in runs if run.trial == trial and run.trial_log is not None):
        try:
            ranked.append((_key(run), run))
        except _StoppedError as stop:
            stops.append(Stop(trial, team, run.folder, stop.exception, stop.cause))
    # A stable sort: of equal runs the first in the program's listing, as there.
    for (negative_raw, _), run in sorted(ranked, key=lambda item: item[0]):
        try:
            scores, durations, remarks = _orders(run, orders)
            cost = _cost(run)
        except _StoppedError as stop:
            stops.append(Stop(trial, team, run.folder, stop.exception, stop.cause))
            continue
        if cost is None:
            return None
        return Entry(run.folder, -negative_raw, scores, durations, cost, remarks=remarks)
    return _without_run(trial, team, runs, orders, stops)


def _without_run(
    trial: str, team: str, runs: Sequence[RunTexts], orders: Sequence[PlannedItem], stops: list[Stop]
) -> Entry | None:
    try:
        cost = _first_cost(runs)
    except _StoppedError as stop:
        stops.append(Stop(trial, team, "", stop.exception, stop.cause))
        return None
    if cost is None:
        return None
    return Entry("", 0, {o.id: None for o in orders}, {o.id: None for o in orders}, cost)


def lines_of(text: str) -> list[str]:
    """The lines of a text as the program reads them, without their ends.

    Not `splitlines`: the program opens files in text mode, where only line feeds and
    carriage returns end a line.
    """
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return lines if lines[-1] else lines[:-1]


def _summary(text: str) -> list[str]:
    """The lines of the order summary, as the program cuts them out."""
    lines = lines_of(text)
    bounds = []
    for words in (_SUMMARY, _DETAILS):
        found = next((i for i, line in enumerate(lines) if words in line), None)
        if found is None:
            raise _StoppedError("ValueError", f"trial_log.txt does not hold the words {words!r}")
        bounds.append(found)
    # Without the heading and the row of `=` below it, and without the blank line and the row above the next.
    return lines[bounds[0] + 2 : bounds[1] - 2]


def _key(run: RunTexts) -> tuple[int, float]:
    """What the best run is the first by: raw score, highest first, then completion time."""
    assert run.trial_log is not None  # runs without one are passed over
    summary = _summary(run.trial_log)
    try:
        raw = 0
        for i in range(len(summary) // _LINES_OF_AN_ORDER):
            raw += int(_after_colon(summary[i * _LINES_OF_AN_ORDER + _SCORE_IN_ORDER]))
        return -raw, float(_after_colon(lines_of(run.trial_log)[_COMPLETION_LINE]))
    except (ValueError, IndexError) as cause:
        raise _StoppedError(type(cause).__name__, f"a score or the completion time: {cause}") from None


def _after_colon(line: str) -> str:
    return line.rpartition(":")[2].strip()


def _orders(
    run: RunTexts, orders: Sequence[PlannedItem]
) -> tuple[dict[str, int | None], dict[str, float | None], tuple[str, ...]]:
    assert run.trial_log is not None  # runs without one are passed over
    summary = _summary(run.trial_log)
    scores: dict[str, int | None] = {}
    durations: dict[str, float | None] = {}
    remarks: list[str] = []
    read: tuple[int | None, float | None] | None = None
    for order in orders:
        # Anywhere in any line, as the program looks: an id may be part of another.
        at = next((i for i, line in enumerate(summary) if order.id in line), None)
        if at is None and read is None:
            raise _StoppedError("UnboundLocalError", f"order {order.id!r} is not in trial_log.txt")
        if at is None:
            remarks.append(
                f"order {order.id!r} is not in the log, so the value of the order before is used again"
            )
        else:
            read = _order_at(summary, at)
            if _after_colon(summary[at]) != order.id:
                remarks.append(f"order {order.id!r} is read from the line {summary[at].strip()!r}")
        assert read is not None  # refused above
        scores[order.id], durations[order.id] = read
    return scores, durations, tuple(remarks)


def _order_at(summary: Sequence[str], at: int) -> tuple[int | None, float | None]:
    """Score and duration below the line with the id; nothing where either is no number."""
    try:
        return (
            int(_after_colon(summary[at + _SCORE_AFTER_ID])),
            float(_after_colon(summary[at + _DURATION_AFTER_ID])),
        )
    except (ValueError, IndexError):
        return None, None


def _cost(run: RunTexts) -> int | None:
    """The sensor cost; `None` leaves the team out."""
    if run.sensor_cost is None:
        return None
    lines = lines_of(run.sensor_cost)
    if len(lines) <= _COST_LINE:
        raise _StoppedError("IndexError", f"sensor_cost.txt has no line {_COST_LINE + 1}")
    try:
        return int(lines[_COST_LINE].rpartition("$")[2])
    except ValueError:
        return None


def _first_cost(runs: Sequence[RunTexts]) -> int | None:
    """The cost of a team without a run of the trial: the first readable one of any of its folders."""
    for run in runs:
        if run.sensor_cost is None:
            return None
        cost = _cost(run)
        if cost is not None:
            return cost
    return None


def _scored(
    trial: str, found: Mapping[str, Entry], orders: Sequence[PlannedItem], stops: list[Stop]
) -> dict[str, Entry]:
    stops += [
        Stop(trial, team, entry.run, "ZeroDivisionError", "the sensor cost is 0")
        for team, entry in found.items()
        if entry.cost == 0
    ]
    found = {team: entry for team, entry in found.items() if entry.cost != 0}
    # The mean cost is over teams that scored; the mean duration over all that handed the order in.
    scoring = [e.cost for e in found.values() if add_up(s for s in e.scores.values() if s is not None) != 0]
    mean_cost = add_up(scoring) / len(scoring) if scoring else 0
    mean_s = {}
    for order in orders:
        durations = [e.durations_s[order.id] for e in found.values() if e.durations_s[order.id] is not None]
        mean_s[order.id] = add_up(durations) / len(durations) if durations else 0
    scored = {}
    for team, entry in found.items():
        total: float = 0
        for order in orders:
            total += _value(order, entry, mean_s[order.id])
        # 1.0 is the program's weight. It stays, with the brackets, so that every product rounds as there.
        scored[team] = replace(entry, score=total * (1.0 * (mean_cost / entry.cost)))
    return scored


def _value(order: PlannedItem, entry: Entry, mean_s: float) -> float:
    """What an order brings; one that was handed in at once brings nothing."""
    score, duration_s = entry.scores[order.id], entry.durations_s[order.id]
    if score is None or not duration_s:
        return 0
    efficiency = 1.0 * (mean_s / duration_s)
    return (_PRIORITY_FACTOR if order.priority else 1) * efficiency * score


def _leaderboard(
    teams: Mapping[str, object], trials: Mapping[str, Mapping[str, Entry]], stops: list[Stop]
) -> tuple[tuple[str, float], ...]:
    # A team without an entry has no sum: the program looks each of them up, and stops.
    totals = []
    for team in teams:
        missing = [trial for trial, entries in trials.items() if team not in entries]
        if missing:
            cause = "the team is missing in this trial, so it has no sum"
            stops += [Stop(trial, team, "", "KeyError", cause) for trial in missing]
        else:
            totals.append((team, float(add_up(entries[team].score for entries in trials.values()))))
    return tuple(sorted(totals, key=lambda item: -item[1]))  # ties stay in the order of the folders


def results_csv(evaluation: Evaluation) -> str:
    """The text of `ARIAC_results.csv`.

    Source: ARIAC notes on log formats, section 9.
    """
    lines = ["Leaderboard:", "", *(f"{team},{score!r}" for team, score in evaluation.leaderboard)]
    lines += ["", "", "", "Score Breakdown:", ""]
    for trial, entries in evaluation.trials.items():
        orders = evaluation.work[trial]
        columns = [
            f"Order {i}({o.id}) {what}" for i, o in enumerate(orders) for what in ("Score", "Duration")
        ]
        lines += [f"{trial}:", ",".join(["Team", *columns, "trial_score"])]
        for team, entry in entries.items():
            values = [v for o in orders for v in (entry.scores[o.id], entry.durations_s[o.id])]
            lines.append(
                ",".join([team, *("N/A" if v is None else repr(v) for v in values), repr(entry.score)])
            )
        lines += ["", ""]
    return "\n".join(lines) + "\n"
