"""The engine's own result, `scoring.yaml`: read, added up in its order, and written as it writes it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

from ariac_score import (
    DataFileError,
    LogDescription,
    OfficialResult,
    ReaderFacts,
    Record,
    Trial,
    Wanted,
    YamlDocument,
    load_yaml,
)
from ariac_score_aic.run_config import text_at_top
from ariac_score_aic.task_times import STEP_NS, TaskTimes

__all__ = [
    "AicScoringReader",
    "OfficialRun",
    "OfficialTrial",
    "Tier",
    "as_written",
    "official_of",
    "sum_in_order",
    "times_from",
    "written",
]

FORMAT = "scoring.yaml of the AI for Industry Challenge"
TIERS = ("tier_1", "tier_2", "tier_3")
_AGAIN = "copy the file again after the engine has ended; a cut one says less than it seems"
_DURATION = re.compile(r"Task duration: (-?[0-9]+\.[0-9]{2}) seconds\.")
_LEAST_S, _MOST_S, _POINTS = 5.0, 60.0, 12.0
"""Durations between which the points for it fall, in s, and the most points: from February 25, PR 351."""


@dataclass(frozen=True)
class Tier:
    """Points and words of one tier, or of one category of it.

    Attributes:
        score: As read; of binary floating point numbers with 17 digits nothing is lost.
        message: As printed.
        categories: Of tier 2 where it was scored, in alphabetical order.
    """

    score: float
    message: str
    categories: tuple[tuple[str, Tier], ...] = ()


@dataclass(frozen=True)
class OfficialTrial:
    """What the engine says of one trial, tier by tier."""

    id: str
    tiers: tuple[Tier, Tier, Tier]

    @property
    def scored(self) -> bool:
        """Whether its recording was scored."""
        return bool(self.tiers[1].categories)

    @property
    def total(self) -> float:
        """The sum of its tiers, added as the engine adds them."""
        return sum_in_order(tier.score for tier in self.tiers)


@dataclass(frozen=True)
class OfficialRun(Record):
    """What the engine says of a run: its total and its trials, in the order of the file."""

    file: str
    total: float
    trials: tuple[OfficialTrial, ...] = field(default=())

    def trial(self, trial_id: str) -> OfficialTrial | None:
        """The trial of that id."""
        return next((trial for trial in self.trials if trial.id == trial_id), None)

    @property
    def summed(self) -> float:
        """The total, added as the engine does it: alphabetically by trial, tier by tier."""
        trials = sorted(self.trials, key=lambda trial: trial.id.encode())
        return sum_in_order(tier.score for trial in trials for tier in trial.tiers)


def sum_in_order(numbers: Iterable[float]) -> float:
    """Numbers added one after the other, from 0, in binary floating point.

    >>> sum_in_order([0.1, 0.2, 0.3])
    0.6000000000000001
    """
    total = 0.0
    for number in numbers:
        total = total + number
    return total


class AicScoringReader:
    """Reads `scoring.yaml`, which the engine writes beside the recordings of a run.

    Reads:
        The total, and of every trial the points and words of its tiers and categories.
    Refuses:
        A file that was cut off, a tier without points, points that are no numbers.
    Source:
        `aic_engine.cpp` and `TierScore.hh` of intrinsic-dev/aic.
    """

    facts = ReaderFacts(
        role="official", a_file="an official result of the engine", formats="scoring.yaml of AIC 2026"
    )

    def can_read(self, path: Path) -> bool:
        """Whether it is YAML that begins with `total:`, and is about tiers or called `scoring.yaml`.

        One of that name that ends before it says so much is its file as well: the engine was stopped.
        """
        text = text_at_top(path)
        if path.name == "scoring.yaml":
            return "total:".startswith(text.strip()[:6])
        return text.startswith("total:") and "tier_1:" in text

    def describe(self, path: Path) -> LogDescription:
        """The total and the trials."""
        try:
            run = read_official(path)
        except DataFileError as error:
            return LogDescription(FORMAT, damage=str(error))
        facts: dict[str, int | float | str] = {"layout": "aic", "total": run.total, "trials": len(run.trials)}
        return LogDescription(FORMAT, facts={**facts, **{trial.id: trial.total for trial in run.trials}})

    def read(self, path: Path, wanted: Wanted) -> Trial:
        """The result of the whole run; the name of the recording says which trial is meant.

        Raises:
            DataFileError: It is malformed, or cut off.
        """
        run = read_official(path)
        wanted.progress(1.0)
        alone = official_of(run, run.trials[0].id) if len(run.trials) == 1 else None
        return Trial(id=path.stem, records=(run,), official=alone)


def read_official(path: Path) -> OfficialRun:
    """The result in a file.

    Raises:
        DataFileError: It is malformed, or cut off.
    """
    document = load_yaml(path)
    data = document.data
    if not isinstance(data, dict) or "total" not in data:
        _refuse(document, (), "it has no total")
    total = _number(document, data["total"], ("total",))
    trials = tuple(_trial(document, str(name), data[name]) for name in data if name != "total")
    run = OfficialRun(path.name, total, trials)
    if not trials:
        _refuse(document, (), "it holds no trial: it was cut off, or the engine ended before the first")
    return run


def _refuse(document: YamlDocument, place: tuple[str | int, ...], cause: str) -> NoReturn:
    raise DataFileError(cause, file=document.file, place=document.place(place), hint=_AGAIN)


def _number(document: YamlDocument, value: Any, place: tuple[str | int, ...]) -> float:
    if isinstance(value, str):  # YAML 1.1 takes 1e-05 without a point for a text
        try:
            value = float(value)
        except ValueError:
            value = None
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        _refuse(document, place, "a score is missing, or no number")
    return float(value)


def _trial(document: YamlDocument, name: str, data: Any) -> OfficialTrial:
    if not isinstance(data, dict):
        _refuse(document, (name,), f"trial {name!r} has no tiers")
    for tier in TIERS:
        if not isinstance(data.get(tier), dict):
            _refuse(document, (name,), f"trial {name!r} has no {tier}")
    first, second, third = (_tier(document, data[tier], (name, tier)) for tier in TIERS)
    return OfficialTrial(name, (first, second, third))


def _tier(document: YamlDocument, data: Mapping[str, Any], place: tuple[str | int, ...]) -> Tier:
    for key in ("score", "message"):
        if key not in data:
            _refuse(document, place, f"{place[-1]!r} has no {key}")
    score, message = _number(document, data["score"], (*place, "score")), data["message"]
    listed = data.get("categories", {})
    if not isinstance(listed, dict) or not all(isinstance(one, dict) for one in listed.values()):
        _refuse(document, (*place, "categories"), "its categories are no maps")
    categories = tuple((str(k), _tier(document, v, (*place, "categories", k))) for k, v in listed.items())
    return Tier(score, "" if message is None else str(message), categories)


def official_of(run: OfficialRun, trial_id: str) -> OfficialResult | None:
    """What the engine says of one trial, as the audit takes it; `None` where it says nothing of it."""
    trial = run.trial(trial_id)
    if trial is None:
        return None
    items = {"final_score": as_written(trial.total)}
    for name, tier in zip(TIERS, trial.tiers, strict=True):
        items[name] = as_written(tier.score)
        for category, one in tier.categories:
            items[category.replace(" ", "_")] = as_written(one.score)
    return OfficialResult(run.file, trial.total, None, items=items)


def times_from(trial: OfficialTrial, source: str) -> TaskTimes:
    """What an official result says of the times of the task.

    The points for the duration are 60 - 55 s / 12 turned round, exactly, where they are neither 0 nor all;
    otherwise the message prints it to 0.01 s. "Not completed" is a statement of its own.
    """
    categories = dict(trial.tiers[1].categories)
    duration = categories.get("duration")
    third = trial.tiers[2].message
    if "not completed" in third or (duration and duration.message == "Task not completed."):
        return TaskTimes(end_known=True, completed=False, source=source)
    printed = _DURATION.fullmatch(duration.message) if duration else None
    if duration is None or printed is None:
        return TaskTimes(completed=True if trial.tiers[2].score > 0 else None, source=source)
    about_s = float(printed[1])
    span_s = _MOST_S - _LEAST_S
    exact_s = _MOST_S - span_s * duration.score / _POINTS
    if 0 < duration.score < _POINTS and abs(exact_s - about_s) <= 0.0051:
        steps = round(exact_s * 1e9 / STEP_NS)
        return TaskTimes(completed=True, duration_s=steps * STEP_NS / 1e9, source=source)
    return TaskTimes(completed=True, duration_s=about_s, exact=False, source=source)


def as_written(number: float) -> str:
    """A number as the engine writes it: up to 17 digits, whole ones bare.

    >>> as_written(75.0), as_written(0.1)
    ('75', '0.10000000000000001')
    """
    return f"{number:.17g}"


def written(run: OfficialRun) -> str:
    """A result as the engine writes it: block style, no line break at the end.

    >>> tier = Tier(1.0, "Model validation succeeded.")
    >>> written(OfficialRun("", 1.0, (OfficialTrial("trial_1", (tier, tier, tier)),))).splitlines()[:4]
    ['total: 1', 'trial_1:', '  tier_1:', '    score: 1']
    """
    lines = [f"total: {as_written(run.total)}"]
    for trial in sorted(run.trials, key=lambda trial: trial.id.encode()):
        lines.append(f"{_plain_key(trial.id)}:")
        for name, tier in zip(TIERS, trial.tiers, strict=True):
            lines += [f"  {name}:", *_lines(tier, "    ")]
    return "\n".join(lines)


def _lines(tier: Tier, indent: str) -> list[str]:
    found = [f"{indent}score: {as_written(tier.score)}", f"{indent}message: {_scalar(tier.message)}"]
    if tier.categories:
        found.append(f"{indent}categories:")
        for name, one in sorted(tier.categories):
            found += [f"{indent}  {name}:", *_lines(one, f"{indent}    ")]
    return found


def _plain_key(name: str) -> str:
    return name if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name) else _quoted(name)


def _scalar(text: str) -> str:
    """A text plain where yaml-cpp writes it plainly, else in double quotes."""
    special = not text or text != text.strip() or re.search(r": |:$| #|[\n\t\"\\]|[^ -~]", text)
    return _quoted(text) if special or re.match(r"[-?:,\[\]{}#&*!|>'\"%@`]", text) else text


def _quoted(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n").replace("\t", "\\t")
    return f'"{escaped}"'
