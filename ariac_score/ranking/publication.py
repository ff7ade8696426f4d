"""A ranking as canonical JSON: every number that entered it, by team, trial and run; and back."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from decimal import Decimal
from pathlib import Path
from typing import Any

from ariac_score.documents.schema import schema_errors
from ariac_score.errors import DataFileError
from ariac_score.ranking.compare import Difference
from ariac_score.ranking.competition import RunKey
from ariac_score.ranking.evaluation import Evaluation
from ariac_score.ranking.rank import Cell, Ranking, RunOutcome, Standing, Stewarded, final_ranking
from ariac_score.ranking.spec import COUNT_BACK, Intervals, Key, Spec
from ariac_score.ranking.statistics import Group, Pair, Statistics, TeamOdds
from ariac_score.results.cohort_file import cohort_text
from ariac_score.results.result_file import adjustment_data, adjustment_from

__all__ = ["Publication", "StoredResult", "load_publication", "ranking_json"]

SCHEMA = "ariac-score/ranking/2"
METHOD = "bootstrap by trial and run, paired between teams; PCG64"
"""What the statistics were made by; docs/ranking.md."""


@dataclass(frozen=True)
class StoredResult:
    """Where the result of a run is kept.

    Attributes:
        file: Below the folder of results, with `/` between its parts.
        sha256: Of the file.
    """

    file: str
    sha256: str


@dataclass(frozen=True)
class Publication:
    """A ranking as it is published.

    Attributes:
        ranking: The ranking, with what stewards made of it; of its runs all but their results.
        how: How runs became ranks, as the rules say it: `ranking` of the JSON.
        statistics: How sure it is, as stewards left it; `None` where that was not asked.
        folder: Where the results are, relative to the file; empty when they are not given.
        results: For each run its result.
        inputs: For each run SHA-256 of the files it was scored from, by role and name.
    """

    ranking: Ranking
    how: Mapping[str, Any]
    statistics: Statistics | None = None
    folder: str = ""
    results: Mapping[RunKey, StoredResult] = field(default_factory=dict)
    inputs: Mapping[RunKey, tuple[tuple[str, str, str], ...]] = field(default_factory=dict)

    @property
    def final(self) -> Ranking:
        """The ranking that counts: the adjusted one, where stewards decided something."""
        return final_ranking(self.ranking)


def ranking_json(
    ranking: Ranking,
    spec: Spec,
    statistics: Statistics | None = None,
    adjusted: Statistics | None = None,
    strict: Evaluation | None = None,
    differences: tuple[Difference, ...] = (),
    *,
    folder: str = "",
    results: Mapping[RunKey, StoredResult] | None = None,
) -> str:
    """A ranking as its canonical text, with a newline at its end.

    Args:
        ranking: The ranking.
        spec: How its runs became it.
        statistics: How sure it is.
        adjusted: How sure it is as stewards left it, where they decided something.
        strict: The organisers' own evaluation beside it, where it was reproduced.
        differences: Between both.
        folder: Where the results are, relative to the file this will be.
        results: The result of each run, where they were written.
    """
    stored = results or {}
    data = {
        "schema": SCHEMA,
        "competition": ranking.competition,
        "title": ranking.title,
        "rule_set": {"id": ranking.rule_set[0], "sha256": ranking.rule_set[1]},
        "trials": list(ranking.trials),
        "ranking": _how(spec),
        "standings": [_standing(standing) for standing in ranking.standings],
        "statistics": None if statistics is None else _statistics(statistics),
        "worst": {trial: float(amount) for trial, amount in ranking.worst.items()},
        "results": folder or None,
        "runs": [_run(run, stored.get(run.key)) for run in ranking.runs],
        "cohort": None if ranking.cohort is None else json.loads(cohort_text(ranking.cohort)),
        "strangers": list(ranking.strangers),
        "strict": None if strict is None else _strict(strict, differences),
    }
    if ranking.stewarded is not None:
        data["adjusted"] = _stewarded(ranking.stewarded, adjusted)
    text = json.dumps(data, sort_keys=True, indent=1, ensure_ascii=False, allow_nan=False)
    # Half a surrogate pair, which a file name may hold, has no place in UTF-8 but has one in JSON.
    return text.encode("utf-8", "backslashreplace").decode("utf-8") + "\n"


def _stewarded(stewarded: Stewarded, statistics: Statistics | None) -> dict[str, Any]:
    """What the stewards made of it: what remains when this key is taken away is the automatic ranking."""
    return {
        "sha256": stewarded.sha256,
        "adjustments": [adjustment_data(decision) for decision in stewarded.adjustments],
        "standings": [_standing(standing) for standing in stewarded.ranking.standings],
        "runs": [_run(run, None) for run in stewarded.ranking.runs],
        "worst": {trial: float(amount) for trial, amount in stewarded.ranking.worst.items()},
        "statistics": None if statistics is None else _statistics(statistics),
    }


def _amount(value: Decimal | None) -> float | None:
    return None if value is None else float(value)


def _how(spec: Spec) -> dict[str, Any]:
    return {
        "keep": spec.keep,
        "by": [_key(key) for key in spec.by],
        "missing_run": "zero" if spec.fill else "leave_out",
        "judges": spec.judges,
        "value": spec.value.source,
        "best": "highest" if spec.highest else "lowest",
        "ties": [_key(key) for key in spec.ties],
        "intervals": _intervals(spec.intervals),
    }


def _key(key: Key) -> dict[str, str]:
    if key.name == COUNT_BACK:
        return {COUNT_BACK: "places"}
    return {"highest" if key.highest else "lowest": key.name}


def _intervals(declared: Intervals) -> dict[str, Any]:
    return {
        "resample": declared.resample,
        "draws": declared.draws,
        "seed": declared.seed,
        "level": declared.level,
    }


def _standing(standing: Standing) -> dict[str, Any]:
    return {
        "rank": standing.rank,
        "team": standing.team,
        "name": standing.name,
        "value": standing.value,
        "execution": _amount(standing.execution),
        "judges": _amount(standing.judges),
        "ties": dict(standing.ties),
        "trials": {trial: _cell(cell) for trial, cell in standing.cells.items()},
        "remarks": list(standing.remarks),
        "places": list(standing.places),
        "separated_by": standing.separated_by,
        "disqualified": standing.disqualified,
    }


def _cell(cell: Cell) -> dict[str, Any]:
    return {
        "score": _amount(cell.score),
        "outcome": cell.outcome,
        "reason": cell.reason,
        "runs": list(cell.runs),
        "made": cell.made,
    }


def _run(run: RunOutcome, stored: StoredResult | None) -> dict[str, Any]:
    inputs = run.result.provenance.inputs if run.result else ()
    return {
        "team": run.team,
        "trial": run.trial,
        "run": run.number,
        "outcome": run.outcome,
        "reason": run.reason,
        "task": _amount(run.task),
        "score": _amount(run.score),
        "kept": run.kept,
        "terms": dict(run.terms),
        "inputs": [{"role": s.role, "name": s.name, "sha256": s.sha256} for s in inputs],
        "result": None if stored is None else {"file": stored.file, "sha256": stored.sha256},
    }


def _statistics(found: Statistics) -> dict[str, Any]:
    return {
        "declared": _intervals(found.intervals),
        "method": METHOD,
        "resampled": found.resample or None,
        "widened_by": found.widened_by,
        "notes": list(found.notes),
        "teams": [
            {
                "team": odds.team,
                "rank_low": odds.low,
                "rank_high": odds.high,
                "chances": list(odds.chances),
                "execution": list(odds.execution),
            }
            for odds in found.teams
        ],
        "pairs": [
            {
                "first": pair.first,
                "second": pair.second,
                "ahead": pair.ahead,
                "interval": [pair.low, pair.high],
                "joint_interval": [pair.joint_low, pair.joint_high],
                "chance": pair.chance,
                "told_apart": pair.told_apart,
            }
            for pair in found.pairs
        ],
        "groups": [{"label": group.label, "teams": list(group.teams)} for group in found.groups],
    }


def _strict(strict: Evaluation, differences: tuple[Difference, ...]) -> dict[str, Any]:
    trials: Mapping[str, Any] = {
        trial: {
            team: {
                "run": entry.run,
                "raw": entry.raw,
                "cost": entry.cost,
                "scores": dict(entry.scores),
                "durations_s": dict(entry.durations_s),
                "score": entry.score,
                "remarks": list(entry.remarks),
            }
            for team, entry in entries.items()
        }
        for trial, entries in strict.trials.items()
    }
    return {
        "leaderboard": [{"team": team, "score": score} for team, score in strict.leaderboard],
        "trials": trials,
        "stops": [
            {"trial": s.trial, "team": s.team, "run": s.run, "exception": s.exception, "cause": s.cause}
            for s in strict.stops
        ],
        "differences": [
            {"team": d.team, "what": d.what, "strict": d.strict, "robust": d.robust, "because": d.because}
            for d in differences
        ],
    }


# And back --------------------------------------------------------------------------------


def load_publication(path: Path) -> Publication:
    """Read a published ranking.

    Raises:
        DataFileError: Missing, not a ranking, or one that contradicts itself.
    """
    hint = "give the JSON that 'rank --output-format json' wrote"
    try:
        data = json.loads(path.read_text(encoding="utf-8"), parse_float=Decimal)
    except OSError as cause:
        raise DataFileError(f"cannot be read: {cause.strerror}", file=path, hint="check the path") from None
    except (ValueError, RecursionError) as cause:
        raise DataFileError(f"not a ranking: {cause}", file=path, hint=hint) from None
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        told = data.get("schema") if isinstance(data, dict) else None
        raise DataFileError(f"its schema is {told!r}, not {SCHEMA!r}", file=path, place="$.schema", hint=hint)
    plain = _plain(data)
    faults = schema_errors(plain, "ranking")
    if faults:
        where = "$" + "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in faults[0][0])
        raise DataFileError(faults[0][1], file=path, place=where, hint="rank again with this version")
    publication = _publication(data, plain)
    _refuse_contradictions(publication, path)
    return publication


def _plain(value: Any) -> Any:
    """A value of the file with floats for decimals, all the way down."""
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list):
        return [_plain(inner) for inner in value]
    return float(value) if isinstance(value, Decimal) else value


def _publication(data: Mapping[str, Any], plain: Mapping[str, Any]) -> Publication:
    runs = tuple(_run_of(run) for run in data["runs"])
    statistics = plain.get("adjusted", plain)["statistics"]
    return Publication(
        ranking=Ranking(
            competition=data["competition"],
            title=data["title"],
            rule_set=(data["rule_set"]["id"], data["rule_set"]["sha256"]),
            trials=tuple(data["trials"]),
            standings=tuple(_standing_of(standing) for standing in data["standings"]),
            runs=runs,
            cohort=None,
            strangers=tuple(data["strangers"]),
            worst=_worst_of(data),
            stewarded=_stewarded_of(data) if "adjusted" in data else None,
        ),
        how=plain["ranking"],
        statistics=None if statistics is None else _statistics_of(statistics),
        folder=data["results"] or "",
        results={
            run.key: StoredResult(entry["result"]["file"], entry["result"]["sha256"])
            for run, entry in zip(runs, data["runs"], strict=True)
            if entry["result"] is not None
        },
        inputs={
            run.key: tuple((source["role"], source["name"], source["sha256"]) for source in entry["inputs"])
            for run, entry in zip(runs, data["runs"], strict=True)
        },
    )


def _stewarded_of(data: Mapping[str, Any]) -> Stewarded:
    adjusted = data["adjusted"]
    return Stewarded(
        Ranking(
            competition=data["competition"],
            title=data["title"],
            rule_set=(data["rule_set"]["id"], data["rule_set"]["sha256"]),
            trials=tuple(data["trials"]),
            standings=tuple(_standing_of(standing) for standing in adjusted["standings"]),
            runs=tuple(_run_of(run) for run in adjusted["runs"]),
            cohort=None,
            strangers=tuple(data["strangers"]),
            worst=_worst_of(adjusted),
        ),
        tuple(adjustment_from(decision) for decision in adjusted["adjustments"]),
        adjusted["sha256"],
    )


def _worst_of(data: Mapping[str, Any]) -> dict[str, Decimal]:
    return {trial: _decimal(amount) or Decimal(0) for trial, amount in data["worst"].items()}


def _decimal(value: Any) -> Decimal | None:
    """An amount as written, without the zero that makes a whole number a float."""
    if value is None:
        return None
    number = Decimal(value)
    return number.quantize(Decimal(1)) if number == number.to_integral_value() else number


def _standing_of(data: Mapping[str, Any]) -> Standing:
    plain = _plain(data)
    return Standing(
        rank=data["rank"],
        team=data["team"],
        name=data["name"],
        value=plain["value"],
        execution=_decimal(data["execution"]) or Decimal(0),
        judges=_decimal(data["judges"]),
        ties=plain["ties"],
        cells={trial: _cell_of(cell) for trial, cell in data["trials"].items()},
        remarks=tuple(data["remarks"]),
        places=tuple(data["places"]),
        separated_by=data["separated_by"],
        disqualified=data["disqualified"],
    )


def _cell_of(data: Mapping[str, Any]) -> Cell:
    score = _decimal(data["score"]) or Decimal(0)
    return Cell(score, data["outcome"], data["reason"], tuple(data["runs"]), data["made"])


def _run_of(data: Mapping[str, Any]) -> RunOutcome:
    return RunOutcome(
        team=data["team"],
        trial=data["trial"],
        number=data["run"],
        outcome=data["outcome"],
        reason=data["reason"],
        task=_decimal(data["task"]),
        score=_decimal(data["score"]),
        kept=data["kept"],
        terms=_plain(data["terms"]),
    )


def _statistics_of(data: Mapping[str, Any]) -> Statistics:
    return Statistics(
        intervals=Intervals(**data["declared"]),
        resample=data["resampled"] or "",
        widened_by=data["widened_by"],
        notes=tuple(data["notes"]),
        teams=tuple(
            TeamOdds(t["team"], t["rank_low"], t["rank_high"], tuple(t["chances"]), tuple(t["execution"]))
            for t in data["teams"]
        ),
        pairs=tuple(
            Pair(
                first=p["first"],
                second=p["second"],
                ahead=p["ahead"],
                low=p["interval"][0],
                high=p["interval"][1],
                joint_low=p["joint_interval"][0],
                joint_high=p["joint_interval"][1],
                chance=p["chance"],
            )
            for p in data["pairs"]
        ),
        groups=tuple(Group(g["label"], tuple(g["teams"])) for g in data["groups"]),
    )


def _refuse_contradictions(found: Publication, path: Path) -> None:
    """Trials must add up to the execution, and everything speak of the teams and trials listed.

    Raises:
        DataFileError: It does not.
    """
    for ranking in (found.ranking, found.final):
        _refuse_wrong_sums(ranking, path)
    hint = "it was edited or damaged: rank again"
    if {run.key for run in found.ranking.runs} != {run.key for run in found.final.runs}:
        raise DataFileError(
            "its adjusted ranking has other runs", file=path, place="$.adjusted.runs", hint=hint
        )
    outside = [stored.file for stored in found.results.values() if not _stays_inside(stored.file)]
    if outside:
        raise DataFileError(
            f"{outside[0]!r} leads out of the folder of results", file=path, place="$.runs", hint=hint
        )
    teams = {standing.team for standing in found.final.standings}
    if found.statistics is not None and not {odds.team for odds in found.statistics.teams} <= teams:
        raise DataFileError("its statistics are of other teams", file=path, place="$.statistics", hint=hint)


def _refuse_wrong_sums(ranking: Ranking, path: Path) -> None:
    """Trials must add up to the execution of every team, and runs be of teams and trials listed.

    Raises:
        DataFileError: It is not so.
    """
    hint = "it was edited or damaged: rank again"
    teams = {standing.team for standing in ranking.standings}
    if len(teams) < len(ranking.standings) or len(set(ranking.trials)) < len(ranking.trials):
        raise DataFileError("a team or trial stands in it twice", file=path, place="$.standings", hint=hint)
    for number, standing in enumerate(ranking.standings):
        place = f"$.standings[{number}]"
        if set(standing.cells) != set(ranking.trials):
            raise DataFileError("it has other trials than are listed", file=path, place=place, hint=hint)
        total = sum((cell.score for cell in standing.cells.values()), Decimal(0))
        # Each amount is a float of its own, which keeps 15 digits of what was added up.
        if abs(total - standing.execution) > max(abs(total), Decimal(1)) * Decimal("1e-12"):
            raise DataFileError(
                f"its trials add up to {total:f}, not to {standing.execution:f}",
                file=path,
                place=f"{place}.execution",
                hint=hint,
            )
    strangers = [run for run in ranking.runs if run.team not in teams or run.trial not in ranking.trials]
    if strangers:
        told = f"{strangers[0].team!r}, {strangers[0].trial!r}"
        raise DataFileError(f"a run of {told} is of nobody listed", file=path, place="$.runs", hint=hint)


def _stays_inside(name: str) -> bool:
    parts = name.split("/")
    plain = not set(name) & set("\\:\0") and name.isprintable()
    return plain and all(part not in ("", ".", "..") for part in parts)
