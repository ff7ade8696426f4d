"""Reads the results file that the leaderboard writes: `_checkpoint.records`, one for each route."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ariac_score import (
    LogDescription,
    LogError,
    NothingToScoreError,
    OfficialResult,
    ReaderFacts,
    TopicDescription,
    Trial,
    Wanted,
)
from carla_leaderboard.route import KINDS, Route

__all__ = ["ResultsReader"]

_FORMAT = "results of the CARLA Leaderboard"
_MAX_BYTES = 20_000_000
_AGAIN = "let the leaderboard finish the file: it is rewritten after every route"
_SCORES = ("score_composed", "score_route", "score_penalty")


class ResultsReader:
    """Reads results of the CARLA Leaderboard, of version 2.0 or 2.1.

    Reads:
        Of each route how much was driven and every infraction with the simulator's words; the
        official scores of each route and of the entry are kept beside.
    Refuses:
        A file that is cut off or not finished, a record without one of its keys, a completion that
        is no percentage.
    Source:
        `leaderboard/utils/statistics_manager.py` of github.com/carla-simulator/leaderboard.
    """

    facts = ReaderFacts(a_file="a results file of the leaderboard", formats=_FORMAT)

    def can_read(self, path: Path) -> bool:
        """Whether it is JSON that begins like a results file."""
        if not path.is_file() or path.suffix != ".json":
            return False
        try:
            with path.open("rb") as stream:
                return b'"_checkpoint"' in stream.read(4096)
        except OSError:
            return False

    def describe(self, path: Path) -> LogDescription:
        """The routes and their infractions."""
        try:
            routes, _ = _read(path)
        except LogError as error:
            return LogDescription(_FORMAT, damage=str(error))
        counts = {kind: sum(len(route.infractions[kind]) for route in routes) for kind in KINDS}
        topics = tuple(TopicDescription(kind, "infraction", n) for kind, n in sorted(counts.items()) if n)
        return LogDescription(_FORMAT, topics, facts={"layout": "leaderboard", "routes": len(routes)})

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The entry: its routes as work items, and the official scores."""
        routes, official = _read(path)
        return Trial(id=path.stem, work=tuple(routes), official=official)


def _read(path: Path) -> tuple[list[Route], OfficialResult]:
    data = _parsed(path)
    checkpoint = _get(path, data, "_checkpoint", dict)
    done, total = _progress(path, checkpoint)
    records = _get(path, checkpoint, "records", list, "_checkpoint")
    if not records:
        raise NothingToScoreError("it holds no route", file=path, hint="did the leaderboard start?")
    if done != total or len(records) != total:
        raise LogError(
            f"{done} of {total} routes are done, and {len(records)} recorded",
            file=path,
            place="_checkpoint.progress",
            hint=_AGAIN,
        )
    routes = [_route(path, record, f"_checkpoint.records[{i}]") for i, record in enumerate(records)]
    twice = {route.id for route in routes if [r.id for r in routes].count(route.id) > 1}
    if twice:
        raise LogError(f"route {min(twice)!r} is recorded twice", file=path, hint="merge the files again")
    return routes, _official(path, checkpoint, records)


def _parsed(path: Path) -> Mapping[str, Any]:
    if path.stat().st_size > _MAX_BYTES:
        raise LogError(f"it is larger than {_MAX_BYTES:,} bytes", file=path, hint="give one results file")
    try:
        data = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as cause:
        raise LogError(f"it is not JSON: {cause}", file=path, hint=_AGAIN) from cause
    if not isinstance(data, dict):
        raise LogError("it is not a JSON object", file=path, hint=_AGAIN)
    return data


def _get(path: Path, data: object, key: str, kind: type, place: str = "") -> Any:
    """A value of a JSON object, of the kind it must have.

    Raises:
        LogError: It is missing or of another kind.
    """
    value = data.get(key) if isinstance(data, dict) else None
    if not isinstance(value, kind) or isinstance(value, bool):
        raise LogError(
            f"{key!r} is missing" if value is None else f"{key!r} is {str(value)[:40]!r}",
            file=path,
            place=place,
            hint=f"a results file of version 2 has {key!r} there",
        )
    return value


def _number(path: Path, data: object, key: str, place: str) -> float:
    value = _get(path, data, key, (int, float), place)  # type: ignore[arg-type]  # isinstance takes both
    if not abs(value) <= 1e12:  # also for NaN
        raise LogError(f"{key!r} is {value!r}", file=path, place=place, hint="it must be a number")
    return float(value)


def _progress(path: Path, checkpoint: object) -> tuple[int, int]:
    progress = _get(path, checkpoint, "progress", list, "_checkpoint")
    if len(progress) != 2 or not all(isinstance(n, int) for n in progress):
        raise LogError(f"'progress' is {progress!r}", file=path, place="_checkpoint", hint=_AGAIN)
    return progress[0], progress[1]


def _route(path: Path, record: object, place: str) -> Route:
    scores = _get(path, record, "scores", dict, place)
    meta = _get(path, record, "meta", dict, place)
    listed = _get(path, record, "infractions", dict, place)
    unknown = sorted(set(listed) - set(KINDS))
    if unknown:  # silence would be a lower penalty
        raise LogError(
            f"infraction {unknown[0]!r} is unknown", file=path, place=place, hint=f"known: {', '.join(KINDS)}"
        )
    completion = _number(path, scores, "score_route", f"{place}.scores")
    if not 0 <= completion <= 100:
        raise LogError(
            f"'score_route' is {completion!r}", file=path, place=f"{place}.scores", hint="it is a percentage"
        )
    return Route(
        _identifier(path, record, place),
        {
            "length_m": _number(path, meta, "route_length", f"{place}.meta"),
            "duration_s": _number(path, meta, "duration_game", f"{place}.meta"),
            "status": str(_get(path, record, "status", str, place)),
        },
        completion,
        {kind: _messages(path, listed, kind, f"{place}.infractions") for kind in KINDS},
    )


def _identifier(path: Path, record: object, place: str) -> str:
    name: str = _get(path, record, "route_id", str, place)
    if not name or "/" in name or not name.isprintable():
        raise LogError(f"route_id {name[:40]!r} is no name", file=path, place=place, hint="use a name")
    return name


def _messages(path: Path, listed: object, kind: str, place: str) -> tuple[str, ...]:
    messages = _get(path, listed, kind, list, place)
    if not all(isinstance(message, str) for message in messages):
        raise LogError(f"{kind!r} is not a list of texts", file=path, place=place, hint=_AGAIN)
    return tuple(messages)


def _official(path: Path, checkpoint: object, records: list[Any]) -> OfficialResult:
    """The scores as the leaderboard wrote them, of the entry and of each route."""
    entry = _get(path, checkpoint, "global_record", dict, "_checkpoint")
    mean = _get(path, entry, "scores_mean", dict, "_checkpoint.global_record")
    items = _scores(path, mean, "_checkpoint.global_record.scores_mean")
    items["final_score"] = items.pop("score_composed")
    for i, record in enumerate(records):
        own = _scores(path, record["scores"], f"_checkpoint.records[{i}].scores")
        items |= {f"{record['route_id']}/{name}": value for name, value in own.items()}
    return OfficialResult(path.name, float(items["final_score"]), None, items=items)


def _scores(path: Path, scores: object, place: str) -> dict[str, str]:
    """Scores as printed: the leaderboard rounds them to six digits, and JSON drops zeros at the end."""
    return {name: f"{_number(path, scores, name, place):.6f}" for name in _SCORES}
