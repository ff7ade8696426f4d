"""The organisers' evaluation of 2023 and 2024, reproduced from its texts, quirks included.

The program reads `trial_log.txt` by line positions and `sensor_cost.txt` by line number,
looks an order up by the first line that contains its id, silently keeps the value of the
order before where it finds none, and ends with an exception at several things a run can
hold. Here each such exception is a named stop: what it concerns is set aside, and the
other teams are evaluated all the same.

Source: jfernandez37/ARIAC_evaluation@main 4e900c2, automated_evaluation/scoring; ARIAC
rulebook notes, section 9; log formats, sections 5.1, 6 and 9.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ariac_score.expression import add_up

__all__ = ["Evaluation", "OrderPlan", "RunTexts", "Stop", "evaluate", "results_csv"]

_SUMMARY = "Order Summary"
_SCORE_LINE = "Actual task score"
_COMPLETION_LINE = 6
_COST_LINE = 15
_SCORE_AFTER_ID, _DURATION_AFTER_ID = 5, 7
_PRIORITY_FACTOR = 3


@dataclass(frozen=True)
class OrderPlan:
    """An order of the trial file: its id and whether it is a priority order."""

    id: str
    priority: bool


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


@dataclass(frozen=True, order=True)
class Stop:
    """Where the program would have ended: trial, team, run (empty for the team), exception, cause."""

    trial: str
    team: str
    run: str
    exception: str
    cause: str


@dataclass(frozen=True)
class Entry:
    """What the program makes of one team in one trial.

    Attributes:
        run: Folder of the best run; empty when there is none.
        raw: Integer sum of its task scores.
        scores: By order; `None` where it was not submitted.
        durations_s: By order, s.
        cost: Sensor cost, dollars.
        score: Trial score.
        remarks: Quirks that moved a number.
    """

    run: str
    raw: int
    scores: Mapping[str, int | None]
    durations_s: Mapping[str, float | None]
    cost: int
    score: float = 0
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Evaluation:
    """The whole evaluation.

    Attributes:
        trials: By trial (sorted by name) what each team got; teams set aside are missing.
        orders: The orders of each trial.
        leaderboard: Team and sum, best first; equal ones in the order of the teams.
        stops: Where the program would have ended.
    """

    trials: Mapping[str, Mapping[str, Entry]]
    orders: Mapping[str, Sequence[OrderPlan]]
    leaderboard: tuple[tuple[str, float], ...]
    stops: tuple[Stop, ...]


class _StoppedError(Exception):
    """The program ends here; caught in this module."""

    def __init__(self, exception: str, cause: str) -> None:
        super().__init__(exception, cause)
        self.exception, self.cause = exception, cause


def evaluate(
    teams: Mapping[str, Sequence[RunTexts]], orders: Mapping[str, Sequence[OrderPlan]]
) -> Evaluation:
    """Evaluate as the organisers' program does.

    Args:
        teams: For each team its runs, both in the order in which the program lists them.
        orders: For each trial its orders, in the order of the trial file.
    """
    stops: list[Stop] = []
    trials: dict[str, dict[str, Entry]] = {}
    for trial in sorted(orders):
        found = {
            team: entry
            for team, runs in teams.items()
            if (entry := _entry(trial, team, runs, orders[trial], stops)) is not None
        }
        trials[trial] = _scored(trial, found, orders[trial], stops)
    return Evaluation(trials, orders, _leaderboard(teams, trials, stops), tuple(sorted(stops)))


def _entry(
    trial: str, team: str, runs: Sequence[RunTexts], orders: Sequence[OrderPlan], stops: list[Stop]
) -> Entry | None:
    """The best run of a team; a run at which the program ends is set aside."""
    ranked: list[tuple[tuple[int, float], RunTexts]] = []
    for run in (run for run in runs if run.trial == trial):
        try:
            ranked.append((_key(run), run))
        except _StoppedError as stop:
            stops.append(Stop(trial, team, run.folder, stop.exception, stop.cause))
    for (negative_raw, _), run in sorted(ranked, key=lambda item: item[0]):
        try:
            scores, durations, remarks = _orders(run, orders)
        except _StoppedError as stop:
            stops.append(Stop(trial, team, run.folder, stop.exception, stop.cause))
            continue
        cost = _cost(run)
        if cost is None:
            return None
        return Entry(run.folder, -negative_raw, scores, durations, cost, remarks=remarks)
    cost = _cost(runs[0]) if runs else None
    nothing = dict.fromkeys(order.id for order in orders)
    return None if cost is None else Entry("", 0, nothing, dict(nothing), cost)


def _key(run: RunTexts) -> tuple[int, float]:
    """What the best run is the first by: raw score, highest first, then completion time."""
    if run.trial_log is None:
        raise _StoppedError("FileNotFoundError", "there is no trial_log.txt")
    lines = run.trial_log.split("\n")
    if not any(_SUMMARY in line for line in lines):
        raise _StoppedError("ValueError", f"trial_log.txt does not hold the words {_SUMMARY!r}")
    try:
        raw = sum(int(_after_colon(line)) for line in lines if _SCORE_LINE in line)
        return -raw, float(_after_colon(lines[_COMPLETION_LINE]))
    except (ValueError, IndexError) as cause:
        raise _StoppedError(type(cause).__name__, f"a score or the completion time: {cause}") from None


def _after_colon(line: str) -> str:
    return line.partition(":")[2].strip()


def _orders(
    run: RunTexts, orders: Sequence[OrderPlan]
) -> tuple[dict[str, int | None], dict[str, float | None], tuple[str, ...]]:
    assert run.trial_log is not None  # `_key` has refused a run without
    lines = run.trial_log.split("\n")
    start = next(i for i, line in enumerate(lines) if _SUMMARY in line)
    scores: dict[str, int | None] = {}
    durations: dict[str, float | None] = {}
    remarks: list[str] = []
    at: int | None = None
    for order in orders:
        found = next((i for i in range(start, len(lines)) if order.id in lines[i]), None)
        if found is None and at is None:
            raise _StoppedError("UnboundLocalError", f"order {order.id!r} is not in trial_log.txt")
        if found is None:
            remarks.append(
                f"order {order.id!r} is not in the log, so the value of the order before is used again"
            )
        elif _after_colon(lines[found]) != order.id:
            remarks.append(f"order {order.id!r} is read from the line {lines[found].strip()!r}")
        at = at if found is None else found
        assert at is not None  # refused above
        duration_s = _number(lines, at + _DURATION_AFTER_ID)
        score = None if duration_s is None else _number(lines, at + _SCORE_AFTER_ID)
        scores[order.id], durations[order.id] = None if score is None else int(score), duration_s
    return scores, durations, tuple(remarks)


def _number(lines: Sequence[str], at: int) -> float | None:
    try:
        return float(_after_colon(lines[at]))
    except (ValueError, IndexError):
        return None


def _cost(run: RunTexts) -> int | None:
    """The sensor cost; `None` leaves the team out."""
    lines = (run.sensor_cost or "").split("\n")
    try:
        return int(lines[_COST_LINE].partition("$")[2])
    except (ValueError, IndexError):
        return None


def _scored(
    trial: str, found: Mapping[str, Entry], orders: Sequence[OrderPlan], stops: list[Stop]
) -> dict[str, Entry]:
    scoring = [entry.cost for entry in found.values() if entry.raw != 0]
    mean_cost = add_up(scoring) / len(scoring) if scoring else 0
    mean_s = {}
    for order in orders:
        durations = [
            entry.durations_s[order.id] for entry in found.values() if entry.scores[order.id] is not None
        ]
        mean_s[order.id] = add_up(durations) / len(durations) if durations else 0
    scored = {}
    for team, entry in found.items():
        if entry.cost == 0 and any(score is not None for score in entry.scores.values()):
            stops.append(Stop(trial, team, entry.run, "ZeroDivisionError", "the sensor cost is 0"))
            continue
        scored[team] = _with_score(entry, orders, mean_cost, mean_s)
    return scored


def _with_score(
    entry: Entry, orders: Sequence[OrderPlan], mean_cost: float, mean_s: Mapping[str, float]
) -> Entry:
    total: float = 0
    for order in orders:
        score, duration_s = entry.scores[order.id], entry.durations_s[order.id]
        if score is None or not duration_s:
            continue
        efficiency = mean_s[order.id] / duration_s
        total += (_PRIORITY_FACTOR if order.priority else 1) * efficiency * score
    if any(score is not None for score in entry.scores.values()):
        total = total * mean_cost / entry.cost
    return Entry(entry.run, entry.raw, entry.scores, entry.durations_s, entry.cost, total, entry.remarks)


def _leaderboard(
    teams: Mapping[str, object], trials: Mapping[str, Mapping[str, Entry]], stops: list[Stop]
) -> tuple[tuple[str, float], ...]:
    totals = []
    for team in teams:
        missing = [trial for trial, entries in trials.items() if team not in entries]
        if missing:
            cause = "the team is missing in this trial, so it has no sum"
            stops += [Stop(trial, team, "", "KeyError", cause) for trial in missing]
        else:
            totals.append((team, float(add_up(entries[team].score for entries in trials.values()))))
    return tuple(sorted(totals, key=lambda item: -item[1]))


def results_csv(evaluation: Evaluation) -> str:
    """The text of `ARIAC_results.csv`.

    Source: ARIAC notes on log formats, section 9.
    """
    lines = ["Leaderboard:", "", *(f"{team},{score!r}" for team, score in evaluation.leaderboard)]
    lines += ["", "", "", "Score Breakdown:", ""]
    for trial, entries in evaluation.trials.items():
        orders = evaluation.orders[trial]
        columns = [
            f"Order {i}({o.id}) {what}" for i, o in enumerate(orders) for what in ("Score", "Duration")
        ]
        lines += [f"{trial}:", ",".join(["Team", *columns, "trial_score"])]
        for team, entry in entries.items():
            values = [v for o in orders for v in (entry.scores[o.id], entry.durations_s[o.id])]
            lines.append(
                ",".join([team, *("N/A" if v is None else repr(v) for v in values), repr(entry.score)])
            )
        lines.append("")
    return "\n".join(lines) + "\n"
